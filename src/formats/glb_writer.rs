//! Writes a binary glTF file: nodes, meshes, skins, animations, materials. The same input gives the same bytes.

use super::FormatError;
use super::glb_materials;
use super::material::Material;
use crate::rig::{Animation, Interpolation, LocalTransform, Node, Property};
use glam::{DAffine3, DVec3};
use serde_json::{Map, Value, json};

const ARRAY_BUFFER: u32 = 34_962;
const ELEMENT_ARRAY_BUFFER: u32 = 34_963;

/// A skin to be written.
#[derive(Clone, Debug, Default)]
pub(crate) struct GlbSkin {
    pub name: Option<String>,
    /// Node and inverse bind transform of each joint.
    pub joints: Vec<(u32, DAffine3)>,
    pub skeleton: Option<u32>,
}

/// A mesh node at the scene's root.
#[derive(Clone, Debug, Default)]
pub(crate) struct GlbMesh {
    pub name: String,
    pub skin: Option<u32>,
    pub primitives: Vec<GlbPrimitive>,
}

/// JOINTS_n and WEIGHTS_n, a row a vertex.
pub(crate) type BoneSet = (Vec<[u16; 4]>, Vec<[f32; 4]>);

/// Triangles of one material. Optional arrays are empty.
#[derive(Clone, Debug, Default)]
pub(crate) struct GlbPrimitive {
    pub positions: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    /// Along u, and 1 or -1 where v points the other way.
    pub tangents: Vec<[f32; 4]>,
    pub uvs: Vec<[f32; 2]>,
    /// RGBA8, red lowest.
    pub colours: Vec<u32>,
    pub bones: Vec<BoneSet>,
    /// `_INCISE_VERTEX`, exact in f32.
    pub marks: Vec<f32>,
    pub indices: Vec<u32>,
    pub material: u32,
}

/// Everything that goes into a file.
#[derive(Clone, Debug, Default)]
pub(crate) struct GlbScene<'a> {
    pub nodes: Vec<Node>,
    pub animations: &'a [Animation],
    pub skins: Vec<GlbSkin>,
    pub meshes: Vec<GlbMesh>,
    /// Translation of the nodes of meshes without a skin, metres. Inverse binds have to know it by themselves.
    pub mesh_origin: DVec3,
    pub materials: Vec<Material>,
}

/// Encodes a scene as .glb.
pub(crate) fn write(scene: &GlbScene<'_>) -> Result<Vec<u8>, FormatError> {
    let mut writer = Writer::default();
    let meshes: Vec<Value> = scene.meshes.iter().map(|m| writer.mesh(m)).collect();
    let skins: Vec<Value> = scene.skins.iter().map(|s| writer.skin(s, &scene.nodes)).collect();
    let animations: Vec<Value> =
        scene.animations.iter().filter(|a| !a.channels.is_empty()).map(|a| writer.animation(a)).collect();
    let looks = glb_materials::write(&scene.materials, |picture| writer.view(picture, None))?;
    let (nodes, roots) = nodes(scene);
    let mut root = Map::new();
    root.insert("asset".into(), json!({"version": "2.0", "generator": concat!("incise ", env!("CARGO_PKG_VERSION"))}));
    root.insert("scene".into(), json!(0));
    // what is empty is left out: where all of a model was torn away there is not even a buffer
    root.insert("scenes".into(), if roots.is_empty() { json!([{}]) } else { json!([{ "nodes": roots }]) });
    let bin_length = writer.bin.len().next_multiple_of(4);
    let arrays = [
        ("nodes", nodes),
        ("meshes", meshes),
        ("skins", skins),
        ("animations", animations),
        ("materials", looks.materials),
        ("textures", looks.textures),
        ("samplers", looks.samplers),
        ("images", looks.images),
        ("extensionsUsed", looks.extensions.into_iter().map(Value::from).collect()),
        ("accessors", writer.accessors),
        ("bufferViews", writer.views),
        ("buffers", if bin_length > 0 { vec![json!({ "byteLength": bin_length })] } else { Vec::new() }),
    ];
    for (key, values) in arrays {
        if !values.is_empty() {
            root.insert(key.into(), Value::Array(values));
        }
    }
    container(&Value::Object(root), writer.bin)
}

fn container(root: &Value, mut bin: Vec<u8>) -> Result<Vec<u8>, FormatError> {
    let mut text = serde_json::to_vec(root).map_err(|e| FormatError::Encode { detail: e.to_string() })?;
    text.resize(text.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let bin_header = if bin.is_empty() { 0 } else { 8 };
    let length = 20 + text.len() as u64 + bin_header + bin.len() as u64;
    if length > u64::from(u32::MAX) {
        return Err(FormatError::TooLarge { what: "bytes", count: length, limit: u32::MAX.into() });
    }
    let mut head = Vec::with_capacity(28 + text.len());
    head.extend(b"glTF");
    for word in [2, length as u32, text.len() as u32] {
        head.extend(word.to_le_bytes());
    }
    head.extend(b"JSON");
    head.extend(text);
    if !bin.is_empty() {
        head.extend((bin.len() as u32).to_le_bytes());
        head.extend(b"BIN\0");
    }
    bin.splice(0..0, head); // where it is: pictures may be most of it, and need not be there twice
    Ok(bin)
}

/// A node and what is above it, upwards.
fn upwards(nodes: &[Node], node: u32) -> impl Iterator<Item = u32> {
    std::iter::successors(Some(node), |&n| nodes[n as usize].parent)
}

/// True if all joints of each skin hang on one root, as glTF demands.
fn have_roots(scene: &GlbScene<'_>) -> bool {
    let root = |joint: &(u32, DAffine3)| upwards(&scene.nodes, joint.0).last();
    scene.skins.iter().all(|skin| skin.joints.windows(2).all(|pair| root(&pair[0]) == root(&pair[1])))
}

/// Nodes of the rig in their order, then one a mesh, then one that holds the rig together if a skin needs it; and the scene's roots.
fn nodes(scene: &GlbScene<'_>) -> (Vec<Value>, Vec<usize>) {
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); scene.nodes.len()];
    let mut roots = Vec::new();
    for (i, node) in scene.nodes.iter().enumerate() {
        match node.parent {
            Some(parent) => children[parent as usize].push(i),
            None => roots.push(i),
        }
    }
    let mut out: Vec<Value> = scene.nodes.iter().zip(children).map(|(node, children)| rig_node(node, children)).collect();
    for (m, mesh) in scene.meshes.iter().enumerate() {
        roots.push(out.len());
        let mut value = json!({ "name": mesh.name, "mesh": m });
        match mesh.skin {
            Some(skin) => value["skin"] = json!(skin),
            None if scene.mesh_origin != DVec3::ZERO => {
                value["translation"] = json!(scene.mesh_origin.to_array().map(|x| x as f32));
            }
            None => {}
        }
        out.push(value);
    }
    if !have_roots(scene) {
        let (of_rig, of_meshes) = roots.into_iter().partition::<Vec<_>, _>(|&root| root < scene.nodes.len());
        roots = of_meshes;
        roots.push(out.len());
        out.push(json!({ "name": "rig", "children": of_rig }));
    }
    (out, roots)
}

fn rig_node(node: &Node, children: Vec<usize>) -> Value {
    let mut value = json!({});
    match &node.local {
        LocalTransform::Trs(trs) => {
            let single = |v: f64| v as f32;
            if trs.translation != DVec3::ZERO {
                value["translation"] = json!(trs.translation.to_array().map(single));
            }
            if trs.rotation != glam::DQuat::IDENTITY {
                value["rotation"] = json!(trs.rotation.to_array().map(single));
            }
            if trs.scale != DVec3::ONE {
                value["scale"] = json!(trs.scale.to_array().map(single));
            }
        }
        LocalTransform::Matrix(m) => value["matrix"] = json!(columns(m)),
    }
    if let Some(name) = &node.name {
        value["name"] = json!(name);
    }
    if !children.is_empty() {
        value["children"] = json!(children);
    }
    value
}

/// Column-major 4 x 4.
fn columns(m: &DAffine3) -> [f32; 16] {
    glam::DMat4::from(*m).to_cols_array().map(|x| x as f32)
}

#[derive(Default)]
struct Writer {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Writer {
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bin.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor(&mut self, view: usize, component_type: u32, kind: &str, count: usize) -> usize {
        self.accessors.push(json!({ "bufferView": view, "componentType": component_type, "type": kind, "count": count }));
        self.accessors.len() - 1
    }

    fn floats<const N: usize>(&mut self, values: &[[f32; N]], target: Option<u32>, with_range: bool) -> usize {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes, target);
        let kind = match N {
            1 => "SCALAR",
            2 => "VEC2",
            3 => "VEC3",
            4 => "VEC4",
            _ => "MAT4",
        };
        let accessor = self.accessor(view, 5126, kind, values.len());
        if with_range {
            let fold = |start: f32, f: fn(f32, f32) -> f32| -> Vec<f32> {
                (0..N).map(|k| values.iter().map(|v| v[k]).fold(start, f)).collect()
            };
            self.accessors[accessor]["min"] = json!(fold(f32::INFINITY, f32::min));
            self.accessors[accessor]["max"] = json!(fold(f32::NEG_INFINITY, f32::max));
        }
        accessor
    }

    fn mesh(&mut self, mesh: &GlbMesh) -> Value {
        let primitives: Vec<Value> = mesh.primitives.iter().map(|p| self.primitive(p)).collect();
        json!({ "name": mesh.name, "primitives": primitives })
    }

    fn primitive(&mut self, p: &GlbPrimitive) -> Value {
        let vertex_data = Some(ARRAY_BUFFER);
        let mut attributes = Map::new();
        attributes.insert("POSITION".into(), json!(self.floats(&p.positions, vertex_data, true)));
        if !p.normals.is_empty() {
            attributes.insert("NORMAL".into(), json!(self.floats(&p.normals, vertex_data, false)));
        }
        if !p.tangents.is_empty() {
            attributes.insert("TANGENT".into(), json!(self.floats(&p.tangents, vertex_data, false)));
        }
        if !p.uvs.is_empty() {
            attributes.insert("TEXCOORD_0".into(), json!(self.floats(&p.uvs, vertex_data, false)));
        }
        if !p.colours.is_empty() {
            let bytes: Vec<u8> = p.colours.iter().flat_map(|c| c.to_le_bytes()).collect();
            let view = self.view(&bytes, vertex_data);
            let accessor = self.accessor(view, 5121, "VEC4", p.colours.len());
            self.accessors[accessor]["normalized"] = json!(true);
            attributes.insert("COLOR_0".into(), json!(accessor));
        }
        for (set, (joints, weights)) in p.bones.iter().enumerate() {
            let narrow = joints.iter().flatten().all(|&j| j < 256);
            let bytes: Vec<u8> = match narrow {
                true => joints.iter().flatten().map(|&j| j as u8).collect(),
                false => joints.iter().flatten().flat_map(|j| j.to_le_bytes()).collect(),
            };
            let view = self.view(&bytes, vertex_data);
            let accessor = self.accessor(view, if narrow { 5121 } else { 5123 }, "VEC4", joints.len());
            attributes.insert(format!("JOINTS_{set}"), json!(accessor));
            attributes.insert(format!("WEIGHTS_{set}"), json!(self.floats(weights, vertex_data, false)));
        }
        if !p.marks.is_empty() {
            let marks: Vec<[f32; 1]> = p.marks.iter().map(|&m| [m]).collect();
            attributes.insert("_INCISE_VERTEX".into(), json!(self.floats(&marks, vertex_data, false)));
        }
        let indices = self.indices(&p.indices);
        json!({ "attributes": attributes, "indices": indices, "material": p.material })
    }

    fn indices(&mut self, indices: &[u32]) -> usize {
        let narrow = indices.iter().all(|&i| i < 0xffff);
        let bytes: Vec<u8> = match narrow {
            true => indices.iter().flat_map(|&i| (i as u16).to_le_bytes()).collect(),
            false => indices.iter().flat_map(|i| i.to_le_bytes()).collect(),
        };
        let view = self.view(&bytes, Some(ELEMENT_ARRAY_BUFFER));
        self.accessor(view, if narrow { 5123 } else { 5125 }, "SCALAR", indices.len())
    }

    fn skin(&mut self, skin: &GlbSkin, nodes: &[Node]) -> Value {
        let matrices: Vec<[f32; 16]> = skin.joints.iter().map(|(_, m)| columns(m)).collect();
        let joints: Vec<u32> = skin.joints.iter().map(|j| j.0).collect();
        let mut value = json!({ "joints": joints, "inverseBindMatrices": self.floats(&matrices, None, false) });
        if let Some(name) = &skin.name {
            value["name"] = json!(name);
        }
        // one that is not above all joints is none, which a skin that gained joints may have
        let is_above_all = |s: &u32| skin.joints.iter().all(|j| upwards(nodes, j.0).any(|n| n == *s));
        if let Some(skeleton) = skin.skeleton.filter(is_above_all) {
            value["skeleton"] = json!(skeleton);
        }
        value
    }

    fn animation(&mut self, animation: &Animation) -> Value {
        let mut inputs: Vec<(&[f32], usize)> = Vec::new();
        let (mut channels, mut samplers) = (Vec::new(), Vec::new());
        for channel in &animation.channels {
            let keys = &channel.keys;
            let input = match inputs.iter().find(|i| i.0 == keys.times) {
                Some(&(_, accessor)) => accessor,
                None => {
                    let times: Vec<[f32; 1]> = keys.times.iter().map(|&t| [t]).collect();
                    let accessor = self.floats(&times, None, true);
                    inputs.push((&keys.times, accessor));
                    accessor
                }
            };
            let (path, output) = match channel.property {
                Property::Rotation => {
                    let values: Vec<[f32; 4]> = keys.values.iter().map(|v| v.map(|x| x as f32)).collect();
                    ("rotation", self.floats(&values, None, false))
                }
                property => {
                    let values: Vec<[f32; 3]> = keys.values.iter().map(|v| [v[0] as f32, v[1] as f32, v[2] as f32]).collect();
                    let path = if property == Property::Scale { "scale" } else { "translation" };
                    (path, self.floats(&values, None, false))
                }
            };
            let interpolation = match keys.interpolation {
                Interpolation::Step => "STEP",
                Interpolation::Linear => "LINEAR",
                Interpolation::CubicSpline => "CUBICSPLINE",
            };
            channels.push(json!({ "sampler": samplers.len(), "target": { "node": channel.node, "path": path } }));
            samplers.push(json!({ "input": input, "output": output, "interpolation": interpolation }));
        }
        json!({ "name": animation.name, "channels": channels, "samplers": samplers })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The JSON of a scene's file, and whether it has a binary chunk.
    fn written(scene: &GlbScene<'_>) -> (Value, bool) {
        let bytes = write(scene).unwrap();
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(8)), (&b"glTF"[..], bytes.len()));
        (serde_json::from_slice(&bytes[20..20 + word(12)]).unwrap(), bytes.len() > 20 + word(12))
    }

    fn node(parent: Option<u32>) -> Node {
        Node { name: None, parent, local: LocalTransform::Matrix(DAffine3::IDENTITY) }
    }

    #[test]
    fn joints_that_hang_on_several_roots_get_one() {
        let joints = |nodes: &[u32]| nodes.iter().map(|&n| (n, DAffine3::IDENTITY)).collect();
        let skin = |nodes: &[u32]| GlbSkin { name: None, joints: joints(nodes), skeleton: Some(0) };
        let nodes = || vec![node(None), node(Some(0)), node(None)];
        let apart =
            GlbScene { nodes: nodes(), skins: vec![skin(&[1, 2])], meshes: vec![GlbMesh::default()], ..Default::default() };
        let (root, _) = written(&apart);
        assert_eq!(root["scenes"][0]["nodes"], json!([3, 4]));
        assert_eq!(root["nodes"][4]["children"], json!([0, 2]));
        assert!(root["skins"][0].get("skeleton").is_none(), "it is not above node 2");
        let together = GlbScene { skins: vec![skin(&[0, 1])], ..apart };
        let (root, _) = written(&together);
        assert_eq!((&root["scenes"][0]["nodes"], &root["skins"][0]["skeleton"]), (&json!([0, 2, 3]), &json!(0)));
    }

    #[test]
    fn of_a_model_that_is_gone_no_empty_parts_are_written() {
        let (root, has_bytes) = written(&GlbScene::default());
        assert_eq!((&root["scenes"], has_bytes), (&json!([{}]), false));
        assert!(["buffers", "nodes", "meshes"].iter().all(|key| root.get(key).is_none()), "{root}");
    }
}
