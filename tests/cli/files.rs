//! Files that the tests write: models, paths, scripts.

use super::support::Place;
use serde_json::{Value, json};

/// A blade path across the top of the bundled beam, half way down, along z.
pub const ACROSS_THE_BEAM: &str = r#"{"poses":[
    {"t":0.0,"tip":[-0.01,-0.01,0.09],"base":[-0.01,0.25,0.11]},
    {"t":0.5,"tip":[0.0,-0.01,0.0],"base":[0.0,0.25,0.0]},
    {"t":1.0,"tip":[0.01,-0.01,-0.09],"base":[0.01,0.25,-0.11]}]}"#;

/// The same, far above it.
pub const PAST_THE_BEAM: &str = r#"{"poses":[
    {"t":0.0,"tip":[0.0,1.0,0.09],"base":[0.0,1.25,0.09]},
    {"t":1.0,"tip":[0.0,1.0,-0.09],"base":[0.0,1.25,-0.09]}]}"#;

/// A blade that goes all the way through the beam: one end falls off.
pub const THROUGH_THE_BEAM: &str = r#"{"poses":[
    {"t":0.0,"tip":[0.15,-0.2,0.2],"base":[0.15,0.3,0.2]},
    {"t":1.0,"tip":[0.15,-0.2,-0.2],"base":[0.15,0.3,-0.2]}]}"#;

/// A tetrahedron as OBJ: 4 vertices, 4 faces, volume 1/6.
pub const TETRAHEDRON: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

/// The same as STL text.
pub fn tetrahedron_stl() -> String {
    let p = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"];
    let facet = |f: [usize; 3]| {
        let corners: String = f.iter().map(|&v| format!("vertex {}\n", p[v])).collect();
        format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
    };
    let facets: String = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(facet).concat();
    format!("solid t\n{facets}endsolid t\n")
}

/// A skinned tetrahedron as glTF with a buffer beside it; the fields may be spoilt before it is written.
pub struct Gltf {
    pub positions: Vec<[f32; 3]>,
    pub indices: Vec<u16>,
    pub weights: Vec<[f32; 4]>,
    pub joints: Vec<[u8; 4]>,
    pub with_buffer: bool,
}

impl Default for Gltf {
    fn default() -> Self {
        Self {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            indices: vec![0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3],
            weights: vec![[1.0, 0.0, 0.0, 0.0]; 4],
            joints: vec![[0; 4]; 4],
            with_buffer: true,
        }
    }
}

impl Gltf {
    /// Writes `model.gltf`, and `model.bin` unless it is to be missing.
    pub fn write(&self, place: &Place) {
        let mut bytes = Vec::new();
        let mut views: Vec<Value> = Vec::new();
        let mut put = |part: Vec<u8>| {
            views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": part.len()}));
            bytes.extend(part);
            bytes.resize(bytes.len().next_multiple_of(4), 0);
        };
        put(self.positions.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect());
        put(self.indices.iter().flat_map(|i| i.to_le_bytes()).collect());
        put(self.joints.concat());
        put(self.weights.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect());
        let n = self.positions.len();
        let accessor = |view: usize, kind: u32, count: usize, shape: &str| json!({"bufferView": view, "componentType": kind, "count": count, "type": shape});
        let mut positions = accessor(0, 5126, n, "VEC3");
        positions["min"] = json!([0.0, 0.0, 0.0]);
        positions["max"] = json!([1.0, 1.0, 1.0]);
        let file = json!({
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0, 1]}],
            "nodes": [{"mesh": 0, "skin": 0}, {"name": "bone"}],
            "skins": [{"joints": [1]}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}, "indices": 1}]}],
            "accessors": [positions, accessor(1, 5123, self.indices.len(), "SCALAR"),
                accessor(2, 5121, n, "VEC4"), accessor(3, 5126, n, "VEC4")],
            "bufferViews": views,
            "buffers": [{"uri": "model.bin", "byteLength": bytes.len()}],
        });
        place.write("model.gltf", file.to_string());
        if self.with_buffer {
            place.write("model.bin", bytes);
        }
    }
}
