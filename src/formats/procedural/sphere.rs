//! The paper's sphere: 515 vertices as stored, 768 faces, radius 0.5 m.

use super::cube_sphere::{build, edge_for};
use crate::formats::glb_writer::{GlbMesh, GlbPrimitive, GlbScene};
use crate::formats::material::Material;

pub(super) fn scene(faces: Option<usize>) -> GlbScene<'static> {
    let sphere = build(edge_for(faces.unwrap_or(768)));
    let primitive = GlbPrimitive {
        positions: sphere.directions.iter().map(|d| (d.normalize() * 0.5).as_vec3().to_array()).collect(),
        normals: sphere.directions.iter().map(|d| d.normalize().as_vec3().to_array()).collect(),
        uvs: sphere.uvs.iter().map(|uv| uv.map(|x| x as f32)).collect(),
        indices: sphere.faces.into_flattened(),
        ..GlbPrimitive::default()
    };
    GlbScene {
        meshes: vec![GlbMesh { name: "sphere".into(), skin: None, primitives: vec![primitive] }],
        materials: vec![Material { name: "clay".into(), base_colour: [0.75, 0.45, 0.38, 1.0], ..Material::default() }],
        ..GlbScene::default()
    }
}
