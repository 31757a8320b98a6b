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
    values: Vec<f64>,
    removed: Vec<FaceId>,
    added: Vec<NewFace>,
    edge_points: EdgePoints,
    wedges: WedgeMaker,
    topology: TopologyScratch,
    on_plane: Vec<VertexId>,
    incident: Vec<FaceId>,
    split: Vec<SplitVertex>,
}

/// Cuts `mesh` along `plane` in place. `position` gives final positions of live vertices (what the user sees). The mesh is
/// untouched when the plane misses it or only grazes it.
pub fn plane_cut(
    mesh: &mut Mesh,
    plane: &Plane,
    position: impl Fn(VertexId) -> DVec3,
    scratch: &mut PlaneCutScratch,
) -> PlaneCutOutcome {
    let mut outcome = PlaneCutOutcome { faces_visited: mesh.face_count(), ..Default::default() };
    if !classify(mesh, plane, &position, scratch) {
        return outcome;
    }
    split_faces(mesh, &position, scratch, &mut outcome);
    outcome.intersection_points = outcome.new_vertices.len();
    outcome.faces_split = scratch.removed.len();
    collect_incident(mesh, scratch);
    let sides = Sides { values: &scratch.values, position: &position, normal: plane.normal() };
    outcome.opened_edges = open_edges_on_plane(mesh, &scratch.incident, &sides);
    if !scratch.removed.is_empty() {
        mesh.replace_faces(&scratch.removed, &scratch.added, |corners| sides.of(corners), &mut scratch.topology);
        outcome.added_faces.extend_from_slice(&scratch.topology.added);
    }
    split_vertices(mesh, &position, scratch, &mut outcome);
    outcome
}

/// Values of all live vertices, exact in sign. True if some lie strictly on each side.
fn classify(mesh: &Mesh, plane: &Plane, position: &impl Fn(VertexId) -> DVec3, scratch: &mut PlaneCutScratch) -> bool {
    scratch.values.clear();
    scratch.values.resize(mesh.vertex_slots(), 0.0);
    scratch.on_plane.clear();
    let (mut above, mut below) = (false, false);
    for v in mesh.live_vertices() {
        let value = plane.value(position(v));
        above |= value > 0.0;
        below |= value < 0.0;
        scratch.values[v.index()] = value;
        if value == 0.0 {
            scratch.on_plane.push(v);
        }
    }
    above && below
}

/// Tells the side of a face that the plane does not cross.
struct Sides<'a, P> {
    values: &'a [f64],
    position: &'a P,
    normal: DVec3,
}

impl<P: Fn(VertexId) -> DVec3> Sides<'_, P> {
    fn value(&self, v: VertexId) -> f64 {
        self.values[v.index()]
    }

    fn of(&self, corners: [VertexId; 3]) -> u8 {
        let values = corners.map(|v| self.value(v));
        if values == [0.0; 3] {
            let [a, b, c] = corners.map(self.position);
            return if (b - a).cross(c - a).dot(self.normal) > 0.0 { NEGATIVE } else { POSITIVE };
        }
        if values.iter().any(|&d| d < 0.0) { NEGATIVE } else { POSITIVE }
    }
}

fn split_faces(
    mesh: &mut Mesh,
    position: &impl Fn(VertexId) -> DVec3,
    scratch: &mut PlaneCutScratch,
    outcome: &mut PlaneCutOutcome,
) {
    scratch.removed.clear();
    scratch.added.clear();
    scratch.edge_points.clear();
    scratch.wedges.clear();
    for f in 0..mesh.face_slots() {
        let f = FaceId::new(f);
        if !mesh.is_live(f) {
            continue;
        }
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
    if values[i] == 0.0 {
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
        if along_pk >= along_jq {
            faces[1] = Some(([p, corner(j), corner(k)], side(j)));
            faces[2] = Some(([p, corner(k), q], side(j)));
        } else {
            faces[1] = Some(([p, corner(j), q], side(j)));
            faces[2] = Some(([corner(j), corner(k), q], side(j)));
        }
    }
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
    let loaded = scratch.values.len();
    for &v in scratch.on_plane.iter().filter(|v| v.index() < loaded) {
        scratch.incident.extend(mesh.fan(v).map(HalfEdge::face));
    }
}

/// Opens edges that lie in the plane between faces of different sides; returns how many. Such faces have two corners on
/// the plane and are never split, so this goes before the splitting, while every vertex still has one fan.
fn open_edges_on_plane<P: Fn(VertexId) -> DVec3>(mesh: &mut Mesh, incident: &[FaceId], sides: &Sides<P>) -> usize {
    let mut opened = 0;
    for h in incident.iter().flat_map(|&f| (0..3).map(move |k| HalfEdge::of(f, k))) {
        let back = mesh.opposite(h);
        if back.is_none() || sides.value(mesh.from(h)) != 0.0 || sides.value(mesh.to(h)) != 0.0 {
            continue;
        }
        if sides.of(mesh.face(h.face())) != sides.of(mesh.face(back.face())) {
            mesh.open_edge(h);
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
    let first_new = scratch.values.len();
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

/// Shape of a triangle: doubled area over the longest side squared.
fn shape(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    if longest > 0.0 { (b - a).cross(c - a).length() / longest } else { 0.0 }
}
