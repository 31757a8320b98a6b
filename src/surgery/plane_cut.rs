//! The plane cut (the paper's Cutting Algorithm, MATHS 6): every vertex classified once, every crossed edge cut once, every
//! crossed face split, the surface opened along the plane.
//!
//! Ties: a vertex exactly on the plane is not moved and makes no sliver: faces are split at it. A face all of whose corners
//! lie on the plane goes to the side of the solid behind it, so that no flat piece is cut off. A plane with nothing strictly
//! on one of its sides only grazes the model: a miss.

use super::clip::edge_parameter;
use super::insert::{EdgePoints, NewVertex, WedgeMaker};
use crate::geometry::{FaceId, HalfEdge, Mesh, NewFace, Plane, SplitVertex, TopologyScratch, VertexId, WedgeId};
use glam::DVec3;

/// Sides of new faces.
const POSITIVE: u8 = 1;
const NEGATIVE: u8 = 2;

/// What a plane cut did to the mesh.
#[derive(Clone, Debug, Default)]
pub struct PlaneCutOutcome {
    /// Vertices inserted, in order of their ids: crossings first, then copies of vertices split between the sides.
    pub new_vertices: Vec<NewVertex>,
    /// Crossed edges.
    pub intersection_points: usize,
    /// Faces that were split.
    pub faces_split: usize,
    /// Edges in the plane that were opened.
    pub opened_edges: usize,
    /// Faces looked at.
    pub faces_visited: usize,
    /// Faces that came out of split ones.
    pub added_faces: Vec<FaceId>,
}

impl PlaneCutOutcome {
    /// True if the plane separated nothing.
    pub fn missed(&self) -> bool {
        self.faces_split == 0 && self.opened_edges == 0
    }
}

/// Buffers kept between cuts.
#[derive(Debug, Default)]
pub struct PlaneCutScratch {
    /// Values of the vertices that were looked at: those whose `seen` is the cut's number.
    values: Vec<f64>,
    seen: Vec<u32>,
    cut: u32,
    /// Vertices before the cut.
    loaded: usize,
    removed: Vec<FaceId>,
    added: Vec<NewFace>,
    edge_points: EdgePoints,
    wedges: WedgeMaker,
    topology: TopologyScratch,
    on_plane: Vec<VertexId>,
    incident: Vec<FaceId>,
    split: Vec<SplitVertex>,
    /// Of each split face: the two sides of its cut, as places in `added` and corners.
    cuts: Vec<[(u32, u8); 2]>,
    rim: Vec<[HalfEdge; 2]>,
    taken: Vec<[VertexId; 2]>,
}

impl PlaneCutScratch {
    /// Edges along which the last cut opened the surface: the half-edge on the positive side, then its partner on the negative.
    /// What a cap is made from (MATHS 6).
    pub fn rim(&self) -> &[[HalfEdge; 2]] {
        &self.rim
    }

    /// Pairs of vertices in the plane that the surface joins already, other than along the rim: no edge of a cap may join
    /// them again. Empty unless vertices lay on the plane before the last cut.
    pub fn taken(&self) -> &[[VertexId; 2]] {
        &self.taken
    }
}

/// Where a plane may cross a mesh.
#[derive(Clone, Copy, Debug)]
pub struct Reach<'a> {
    /// All faces that the plane crosses or touches, and maybe others; each once.
    pub faces: &'a [FaceId],
    /// Whether faces that are left out lie strictly on the positive side, and on the negative.
    pub beyond: [bool; 2],
}

/// Cuts `mesh` along `plane` in place. `position` gives final positions of live vertices (what the user sees). The mesh is
/// untouched when the plane misses it or only grazes it.
pub fn plane_cut(
    mesh: &mut Mesh,
    plane: &Plane,
    position: impl Fn(VertexId) -> DVec3,
    scratch: &mut PlaneCutScratch,
) -> PlaneCutOutcome {
    let faces: Vec<FaceId> = mesh.live_faces().collect();
    plane_cut_within(mesh, plane, Reach { faces: &faces, beyond: [false; 2] }, position, scratch)
}

/// [`plane_cut`] for a caller who knows where the plane may cross: nothing else is looked at.
pub fn plane_cut_within(
    mesh: &mut Mesh,
    plane: &Plane,
    reach: Reach<'_>,
    position: impl Fn(VertexId) -> DVec3,
    scratch: &mut PlaneCutScratch,
) -> PlaneCutOutcome {
    let mut outcome = PlaneCutOutcome { faces_visited: reach.faces.len(), ..Default::default() };
    if !classify(mesh, plane, reach, &position, scratch) {
        return outcome;
    }
    split_faces(mesh, reach.faces, &position, scratch, &mut outcome);
    outcome.intersection_points = outcome.new_vertices.len();
    outcome.faces_split = scratch.removed.len();
    collect_incident(mesh, scratch);
    let sides = Sides { values: &scratch.values, seen: (&scratch.seen, scratch.cut), position: &position, plane };
    outcome.opened_edges = open_edges_on_plane(mesh, &scratch.incident, &sides, &mut scratch.rim);
    if !scratch.removed.is_empty() {
        mesh.replace_faces(&scratch.removed, &scratch.added, |corners| sides.of(corners), &mut scratch.topology);
        outcome.added_faces.extend_from_slice(&scratch.topology.added);
    }
    let half_edge = |(face, corner): (u32, u8)| HalfEdge::of(scratch.topology.added[face as usize], usize::from(corner));
    scratch.rim.extend(scratch.cuts.iter().map(|cut| cut.map(half_edge)));
    split_vertices(mesh, &position, scratch, &mut outcome);
    collect_taken(mesh, scratch);
    outcome
}

/// Values of the corners of all faces within reach, exact in sign. True if some vertices lie strictly on each side.
fn classify(
    mesh: &Mesh,
    plane: &Plane,
    reach: Reach<'_>,
    position: &impl Fn(VertexId) -> DVec3,
    scratch: &mut PlaneCutScratch,
) -> bool {
    let PlaneCutScratch { values, seen, cut, on_plane, loaded, .. } = scratch;
    *loaded = mesh.vertex_slots();
    if *cut == u32::MAX {
        seen.clear();
        *cut = 0;
    }
    *cut += 1;
    values.resize(values.len().max(*loaded), 0.0);
    seen.resize(seen.len().max(*loaded), 0);
    on_plane.clear();
    let [mut above, mut below] = reach.beyond;
    for &f in reach.faces {
        for v in mesh.face(f) {
            if std::mem::replace(&mut seen[v.index()], *cut) == *cut {
                continue;
            }
            let value = plane.value(position(v));
            above |= value > 0.0;
            below |= value < 0.0;
            values[v.index()] = value;
            if value == 0.0 {
                on_plane.push(v);
            }
        }
    }
    above && below
}

/// Tells the side of a face that the plane does not cross.
struct Sides<'a, P> {
    values: &'a [f64],
    seen: (&'a [u32], u32),
    position: &'a P,
    plane: &'a Plane,
}

impl<P: Fn(VertexId) -> DVec3> Sides<'_, P> {
    fn value(&self, v: VertexId) -> f64 {
        // a face at the rim may have a corner that no face within reach has
        if self.seen.0[v.index()] == self.seen.1 { self.values[v.index()] } else { self.plane.value((self.position)(v)) }
    }

    fn of(&self, corners: [VertexId; 3]) -> u8 {
        let values = corners.map(|v| self.value(v));
        if values == [0.0; 3] {
            let [a, b, c] = corners.map(self.position);
            return if (b - a).cross(c - a).dot(self.plane.normal()) > 0.0 { NEGATIVE } else { POSITIVE };
        }
        if values.iter().any(|&d| d < 0.0) { NEGATIVE } else { POSITIVE }
    }
}

fn split_faces(
    mesh: &mut Mesh,
    faces: &[FaceId],
    position: &impl Fn(VertexId) -> DVec3,
    scratch: &mut PlaneCutScratch,
    outcome: &mut PlaneCutOutcome,
) {
    scratch.removed.clear();
    scratch.added.clear();
    scratch.cuts.clear();
    scratch.rim.clear();
    scratch.edge_points.clear();
    scratch.wedges.clear();
    for &f in faces {
        let values = mesh.face(f).map(|v| scratch.values[v.index()]);
        if values.iter().any(|&d| d < 0.0) && values.iter().any(|&d| d > 0.0) {
            split_face(mesh, f, values, position, scratch, outcome);
        }
    }
}

/// Vertices and wedges of a face to be.
type Corners = [(VertexId, WedgeId); 3];

/// Splits a face with corners on both sides: into two where a corner lies on the plane, else into three.
fn split_face(
    mesh: &mut Mesh,
    f: FaceId,
    values: [f64; 3],
    position: &impl Fn(VertexId) -> DVec3,
    scratch: &mut PlaneCutScratch,
    outcome: &mut PlaneCutOutcome,
) {
    let (corners, wedges, info) = (mesh.face(f), mesh.face_wedges(f), mesh.face_info(f));
    // start at the corner that is alone on its side, or at the one on the plane
    let sign = |k: usize| (values[k] > 0.0) as i32 - (values[k] < 0.0) as i32;
    let apex =
        (0..3).find(|&k| sign(k) == 0).or_else(|| (0..3).find(|&k| sign(k) != sign((k + 1) % 3) && sign(k) != sign((k + 2) % 3)));
    let Some(i) = apex else { return };
    let (j, k) = ((i + 1) % 3, (i + 2) % 3);
    let mut crossing = |mesh: &mut Mesh, scratch: &mut PlaneCutScratch, a: usize, b: usize| {
        let ends = [(corners[a], values[a]), (corners[b], values[b])];
        let vertex = edge_vertex(mesh, ends, position, scratch, outcome);
        let t = edge_parameter(values[a], values[b]);
        (vertex, scratch.wedges.on_edge(mesh, vertex, wedges[a], wedges[b], t))
    };
    let corner = |c: usize| (corners[c], wedges[c]);
    let side = |c: usize| if values[c] < 0.0 { NEGATIVE } else { POSITIVE };
    let mut faces: [Option<(Corners, u8)>; 3] = [None; 3];
    // where the cut runs in the first face, and in which other face it runs back from which corner
    let (cut, back);
    if values[i] == 0.0 {
        (cut, back) = (2, (1, 0));
        let m = crossing(mesh, scratch, j, k);
        faces[0] = Some(([corner(i), corner(j), m], side(j)));
        faces[1] = Some(([corner(i), m, corner(k)], side(k)));
    } else {
        let (p, q) = (crossing(mesh, scratch, i, j), crossing(mesh, scratch, k, i));
        faces[0] = Some(([corner(i), p, q], side(i)));
        // the quadrangle p, j, k, q along its better diagonal
        let at = |mesh: &Mesh, v: VertexId| point(mesh, v, position, outcome);
        let [pp, pj, pk, pq] = [p.0, corners[j], corners[k], q.0].map(|v| at(mesh, v));
        let along_pk = shape(pp, pj, pk).min(shape(pp, pk, pq));
        let along_jq = shape(pp, pj, pq).min(shape(pj, pk, pq));
        (cut, back) = (1, (if along_pk >= along_jq { 2 } else { 1 }, 2));
        if along_pk >= along_jq {
            faces[1] = Some(([p, corner(j), corner(k)], side(j)));
            faces[2] = Some(([p, corner(k), q], side(j)));
        } else {
            faces[1] = Some(([p, corner(j), q], side(j)));
            faces[2] = Some(([corner(j), corner(k), q], side(j)));
        }
    }
    let first = scratch.added.len() as u32;
    let ends = [(first, cut), (first + back.0, back.1)];
    let first_is_positive = faces[0].is_some_and(|face| face.1 == POSITIVE);
    scratch.cuts.push(if first_is_positive { ends } else { [ends[1], ends[0]] });
    scratch.removed.push(f);
    for (points, side) in faces.into_iter().flatten() {
        scratch.added.push(NewFace { corners: points.map(|p| p.0), wedges: points.map(|p| p.1), info, side });
    }
}

fn point(mesh: &Mesh, v: VertexId, position: &impl Fn(VertexId) -> DVec3, outcome: &PlaneCutOutcome) -> DVec3 {
    let first_new = mesh.vertex_slots() - outcome.new_vertices.len();
    if v.index() >= first_new { outcome.new_vertices[v.index() - first_new].position } else { position(v) }
}

/// The vertex where the plane crosses an edge; made at the first face that asks.
fn edge_vertex(
    mesh: &mut Mesh,
    ends: [(VertexId, f64); 2],
    position: &impl Fn(VertexId) -> DVec3,
    scratch: &mut PlaneCutScratch,
    outcome: &mut PlaneCutOutcome,
) -> VertexId {
    let [(a, value_a), (b, value_b)] = if ends[0].0 < ends[1].0 { ends } else { [ends[1], ends[0]] };
    if let Some(vertex) = scratch.edge_points.find(a, b, 0) {
        return vertex;
    }
    let vertex = mesh.add_vertex();
    scratch.edge_points.insert((a, value_a), (b, value_b), 0, vertex);
    let t = edge_parameter(value_a, value_b);
    let parents = [(a, 1.0 - t), (b, t), (VertexId::NONE, 0.0)];
    outcome.new_vertices.push(NewVertex { vertex, parents, parent_count: 2, position: position(a).lerp(position(b), t) });
    scratch.on_plane.push(vertex);
    vertex
}

/// Faces around the vertices that lay on the plane before the cut.
fn collect_incident(mesh: &Mesh, scratch: &mut PlaneCutScratch) {
    scratch.incident.clear();
    let loaded = scratch.loaded;
    for &v in scratch.on_plane.iter().filter(|v| v.index() < loaded) {
        scratch.incident.extend(mesh.fan(v).map(HalfEdge::face));
    }
}

/// Opens edges that lie in the plane between faces of different sides; returns how many. Such faces have two corners on
/// the plane and are never split, so this goes before the splitting, while every vertex still has one fan.
fn open_edges_on_plane<P: Fn(VertexId) -> DVec3>(
    mesh: &mut Mesh,
    incident: &[FaceId],
    sides: &Sides<P>,
    rim: &mut Vec<[HalfEdge; 2]>,
) -> usize {
    let mut opened = 0;
    for h in incident.iter().flat_map(|&f| (0..3).map(move |k| HalfEdge::of(f, k))) {
        let back = mesh.opposite(h);
        if back.is_none() || sides.value(mesh.from(h)) != 0.0 || sides.value(mesh.to(h)) != 0.0 {
            continue;
        }
        let side = sides.of(mesh.face(h.face()));
        if side != sides.of(mesh.face(back.face())) {
            mesh.open_edge(h);
            rim.push(if side == POSITIVE { [h, back] } else { [back, h] });
            opened += 1;
        }
    }
    opened
}

/// Gives each side its own copy of the vertices on the plane.
fn split_vertices(
    mesh: &mut Mesh,
    position: &impl Fn(VertexId) -> DVec3,
    scratch: &mut PlaneCutScratch,
    outcome: &mut PlaneCutOutcome,
) {
    scratch.incident.extend_from_slice(&outcome.added_faces);
    scratch.split.clear();
    mesh.split_fans(&scratch.on_plane, &scratch.incident, &mut scratch.topology, &mut scratch.split);
    let first_new = scratch.loaded;
    for split in &scratch.split {
        let position = if split.from.index() < first_new {
            position(split.from)
        } else {
            outcome.new_vertices[split.from.index() - first_new].position
        };
        let parents = [(split.from, 1.0), (VertexId::NONE, 0.0), (VertexId::NONE, 0.0)];
        outcome.new_vertices.push(NewVertex { vertex: split.vertex, parents, parent_count: 1, position });
    }
}

/// Edges in the plane that stay closed, between vertices that lay on the plane and their copies.
fn collect_taken(mesh: &Mesh, scratch: &mut PlaneCutScratch) {
    scratch.taken.clear();
    let loaded = scratch.loaded;
    let mut on_plane: Vec<VertexId> = scratch.on_plane.iter().copied().filter(|v| v.index() < loaded).collect();
    on_plane.extend(scratch.split.iter().filter(|s| s.from.index() < loaded).map(|s| s.vertex));
    on_plane.sort_unstable();
    for &v in &on_plane {
        let around = mesh.fan(v).filter(|&h| mesh.opposite(h).is_some()).map(|h| [v, mesh.to(h)]);
        scratch.taken.extend(around.filter(|edge| edge[0] < edge[1] && on_plane.binary_search(&edge[1]).is_ok()));
    }
}

/// Shape of a triangle: doubled area over the longest side squared.
fn shape(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    if longest > 0.0 { (b - a).cross(c - a).length() / longest } else { 0.0 }
}
