//! Models out as OBJ: shapes in one pose, without rig or materials.

use super::gltf_export::ExportPiece;
use super::obj::TOPOLOGY_COMMENT;
use crate::geometry::{Mesh, VertexId, WedgeId, cofactor};
use crate::rig::{Pose, VertexRows};
use glam::DVec3;
use std::fmt::Write;

/// Pieces as OBJ text: posed positions in model space (`origin` is the rig's), normals and texture coordinates. Numbers
/// are written so that reading gives the same f64. One object a piece; vertices are shared as topology has it, and a
/// comment asks our own reader to keep it so (MATHS 1.6).
pub fn export_obj(pieces: &[ExportPiece<'_>], origin: DVec3, pose: &Pose) -> String {
    let mut out = format!("{TOPOLOGY_COMMENT}\n");
    let (mut vertices, mut wedges) = (1, 1);
    for piece in pieces {
        line(&mut out, format_args!("o {}", piece.name.replace(char::is_whitespace, "_")));
        let vertex_of = write_positions(&mut out, piece, origin, pose, &mut vertices);
        let wedge_of = write_wedges(&mut out, piece.mesh, piece.rows, pose, &mut wedges);
        for f in piece.mesh.live_faces() {
            let (corners, dress) = (piece.mesh.face(f), piece.mesh.face_wedges(f));
            let word = |k: usize| {
                let w = wedge_of[dress[k].index()];
                format!("{}/{w}/{w}", vertex_of[corners[k].index()])
            };
            line(&mut out, format_args!("f {} {} {}", word(0), word(1), word(2)));
        }
    }
    out
}

fn line(out: &mut String, text: std::fmt::Arguments<'_>) {
    let written = writeln!(out, "{text}");
    debug_assert!(written.is_ok(), "writing to a string cannot fail");
}

fn write_positions(out: &mut String, piece: &ExportPiece<'_>, origin: DVec3, pose: &Pose, next: &mut usize) -> Vec<usize> {
    let mut numbers = vec![0; piece.mesh.vertex_slots()];
    for v in piece.mesh.live_vertices() {
        let p = pose.skin(piece.rows, v) + origin;
        line(out, format_args!("v {} {} {}", p.x, p.y, p.z));
        numbers[v.index()] = *next;
        *next += 1;
    }
    numbers
}

/// Texture coordinate and normal of each wedge in use.
fn write_wedges(out: &mut String, mesh: &Mesh, rows: &VertexRows, pose: &Pose, next: &mut usize) -> Vec<usize> {
    let mut numbers = vec![0; mesh.wedges().len()];
    for w in mesh.live_faces().flat_map(|f| mesh.face_wedges(f)) {
        if numbers[w.index()] == 0 {
            let wedge = mesh.wedge(w);
            let n = posed_normal(mesh, rows, pose, w, wedge.vertex);
            line(out, format_args!("vt {} {}", wedge.uv[0], 1.0 - f64::from(wedge.uv[1])));
            line(out, format_args!("vn {} {} {}", n.x as f32, n.y as f32, n.z as f32));
            numbers[w.index()] = *next;
            *next += 1;
        }
    }
    numbers
}

/// The cofactor of the blended matrix takes normals along (MATHS 2.3).
fn posed_normal(mesh: &Mesh, rows: &VertexRows, pose: &Pose, w: WedgeId, v: VertexId) -> DVec3 {
    let normal = DVec3::from_array(mesh.wedge(w).normal.map(f64::from));
    (cofactor(pose.blended_linear(rows, v)) * normal).normalize_or(normal)
}
