//! What the benches of edits share: tissues of bundled models, and those models as files for other libraries.

use glam::DVec3;
use incise::formats::{self, Model};
use incise::geometry::VertexId;
use incise::tissue::Tissue;
use std::path::Path;

/// A bundled model of about so many faces, as its file gives it, and its vertices at rest, metres.
pub fn bundled(name: &str, faces: usize) -> (Model, Vec<DVec3>) {
    let bytes = formats::generate(name, Some(faces)).expect("a bundled name");
    let file = tempfile::Builder::new().suffix(".glb").tempfile().expect("a temporary file");
    std::fs::write(file.path(), bytes).expect("room for the model");
    let model = formats::load(&file.path().to_string_lossy()).expect("a sound model");
    let rest = (0..model.rows.len()).map(|v| model.rows.rest(VertexId::new(v))).collect();
    (model, rest)
}

/// Positions of all vertices and the corners of the faces.
pub fn soup(tissue: &Tissue) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let mesh = tissue.mesh();
    let points = (0..mesh.vertex_slots()).map(|v| tissue.position(VertexId::new(v))).collect();
    (points, mesh.live_faces().map(|f| mesh.face(f).map(|v| v.0)).collect())
}

/// Writes a [`soup`] as OBJ.
pub fn write_soup(path: &Path, (points, triangles): &(Vec<DVec3>, Vec<[u32; 3]>)) -> std::io::Result<()> {
    let mut text = String::new();
    points.iter().for_each(|p| text += &format!("v {} {} {}\n", p.x, p.y, p.z));
    triangles.iter().for_each(|f| text += &format!("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1));
    std::fs::write(path, text)
}
