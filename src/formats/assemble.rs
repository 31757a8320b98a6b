//! From a stored surface to a mesh with rows: wedges, normals, one fan a vertex, tissue coordinates.

use super::flats::flip_flat;
use super::stored::{Dress, Stored, check_finite};
use super::weld::{Welded, classes, weld};
use super::{FormatError, LoadReport};
use crate::geometry::topology::TopologyScratch;
use crate::geometry::{FaceId, HalfEdge, Mesh, SlotCsr, VertexId, Wedge, WedgeId};
use crate::rig::{RoundedApart, VertexRows};
use glam::DVec3;
use std::collections::HashMap;

/// Most vertices and faces that a model may have: half-edges are numbered with 32 bits.
const LIMIT: u64 = 1 << 30;

/// Origin of tissue space for bounds (MATHS 1.7): their centre, snapped to a power of two of about an eighth of the
/// diagonal. The snapping makes the subtraction exact for nearly all f32 coordinates, so a file goes through unchanged.
pub(crate) fn origin_of(min: DVec3, max: DVec3) -> DVec3 {
    let diagonal = (max - min).length();
    if diagonal == 0.0 || !diagonal.is_finite() {
        return if min.is_finite() { min } else { DVec3::ZERO };
    }
    let step = 2f64.powi(diagonal.log2().floor() as i32 - 3);
    ((min + max) * 0.5 / step).round() * step
}

/// Builds mesh and rows of a stored surface, with `origin` as the origin of tissue space.
pub(crate) fn assemble(stored: &Stored, origin: DVec3, report: &mut LoadReport) -> Result<(Mesh, VertexRows), FormatError> {
    check(stored)?;
    let places = classes(stored);
    let (stored, flipped) = flip_flat(stored, &places);
    let stored = &*stored;
    let welded = weld(stored, &places);
    report.vertices_stored = stored.positions.len();
    report.degenerate_faces = flipped + welded.degenerate_faces;
    report.duplicate_faces = welded.duplicate_faces;
    report.largest_weight_difference = welded.largest_weight_difference;
    if welded.faces.is_empty() {
        let detail = if stored.faces.is_empty() { "" } else { " with an area" };
        return Err(FormatError::NoFaces { detail: detail.into() });
    }
    let mut mesh = build_mesh(stored, &welded);
    count_non_manifold(&mesh, &welded.class, report);
    let mut first = welded.first;
    split_fans(&mut mesh, &mut first);
    report.vertices_welded = first.len();
    let is_open = || mesh.live_faces().any(|f| mesh.all_opposites()[f.index()].iter().any(|h| h.is_none()));
    if welded.flat_faces > 0 && is_open() {
        let text = "faces without an area are left out, and the model is open: what they closed is open now";
        report.warnings.push(format!("{} {text}", welded.flat_faces));
    }
    let mut apart = RoundedApart::default();
    let rest = first.iter().map(|&v| apart.round(stored.positions[v as usize] - origin).to_array()).collect();
    let bones = SlotCsr::from_rows(first.iter().map(|&v| stored.bones(v as usize)));
    mesh.take_delta(); // loading is not an edit
    Ok((mesh, VertexRows::from_base(rest, bones)))
}

fn check(stored: &Stored) -> Result<(), FormatError> {
    for (what, count) in [("vertices", stored.positions.len()), ("faces", stored.faces.len())] {
        if count as u64 > LIMIT {
            return Err(FormatError::TooLarge { what, count: count as u64, limit: LIMIT });
        }
    }
    // f32 carries what the GPU is given: beyond its range a position is as bad as an infinite one
    match stored.positions.iter().position(|p| check_finite(*p).is_err()) {
        Some(v) => Err(FormatError::NotFinite { what: format!("the position of vertex {v}") }),
        None => Ok(()),
    }
}

fn build_mesh(stored: &Stored, welded: &Welded) -> Mesh {
    let normals = smooth_normals(stored, welded);
    let mut wedges: Vec<Wedge> = Vec::new();
    let mut face_wedges = Vec::with_capacity(welded.faces.len());
    let mut ids: HashMap<[u32; 7], WedgeId> = HashMap::new(); // looked up only: its order decides nothing
    let mut groups: HashMap<[u32; 4], WedgeId> = HashMap::new();
    for (face, corners) in welded.faces.iter().zip(&welded.corners) {
        face_wedges.push(std::array::from_fn(|k| {
            let vertex = corners[k];
            let dress: Dress = stored.dresses[face.dresses[k] as usize];
            let normal = dress.normal.unwrap_or(normals[vertex.index()]);
            let [u, v] = dress.uv.map(f32::to_bits);
            let [x, y, z] = normal.map(f32::to_bits);
            *ids.entry([vertex.0, u, v, x, y, z, dress.colour]).or_insert_with(|| {
                let id = WedgeId::new(wedges.len());
                let group = *groups.entry([vertex.0, x, y, z]).or_insert(id);
                wedges.push(Wedge { vertex, group, uv: dress.uv, normal, colour: dress.colour });
                id
            })
        }));
    }
    let materials: Vec<u32> = welded.faces.iter().map(|f| f.material).collect();
    Mesh::build(welded.first.len(), welded.corners.clone(), face_wedges, &materials, wedges)
}

/// Area-weighted normals of the topological vertices.
fn smooth_normals(stored: &Stored, welded: &Welded) -> Vec<[f32; 3]> {
    let mut sums = vec![DVec3::ZERO; welded.first.len()];
    for corners in &welded.corners {
        let [a, b, c] = corners.map(|v| stored.positions[welded.first[v.index()] as usize]);
        let area = (b - a).cross(c - a);
        for v in corners {
            sums[v.index()] += area;
        }
    }
    sums.iter().map(|n| n.normalize_or(DVec3::Z).as_vec3().to_array()).collect()
}

/// Counts edges where more than two faces meet, or two in the same direction: groups of coincident open half-edges.
fn count_non_manifold(mesh: &Mesh, class: &[u32], report: &mut LoadReport) {
    let mut open: Vec<((u32, u32), bool)> = Vec::new();
    for f in mesh.live_faces() {
        for h in (0..3).map(|k| HalfEdge::of(f, k)).filter(|&h| mesh.opposite(h).is_none()) {
            let (a, b) = (class[mesh.from(h).index()], class[mesh.to(h).index()]);
            open.push(((a.min(b), a.max(b)), a < b));
        }
    }
    open.sort_unstable();
    for run in open.chunk_by(|a, b| a.0 == b.0) {
        let one_way = run.windows(2).all(|w| w[0].1 == w[1].1);
        if run.len() > 2 || (run.len() == 2 && one_way) {
            report.non_manifold_edges += 1;
            report.non_manifold_half_edges += run.len();
            report.one_way_edges += usize::from(run.len() == 2);
        }
    }
}

/// Gives every fan a vertex of its own; `first` grows by the stored vertex of each copy.
fn split_fans(mesh: &mut Mesh, first: &mut Vec<u32>) {
    let mut corners = vec![0u32; mesh.vertex_slots()];
    for v in mesh.faces().iter().flatten() {
        corners[v.index()] += 1;
    }
    let several: Vec<VertexId> = mesh.live_vertices().filter(|&v| mesh.fan(v).count() < corners[v.index()] as usize).collect();
    if several.is_empty() {
        return;
    }
    let touches = |f: &FaceId| mesh.face(*f).iter().any(|v| several.binary_search(v).is_ok());
    let incident: Vec<FaceId> = mesh.live_faces().filter(touches).collect();
    let mut copies = Vec::new();
    mesh.split_fans(&several, &incident, &mut TopologyScratch::default(), &mut copies);
    first.extend(copies.iter().map(|copy| first[copy.from.index()]).collect::<Vec<_>>());
}
