//! The plane cut (the paper's Cutting Algorithm, MATHS 6): every vertex classified once, every crossed edge cut once, every
//! crossed face split, the surface opened along the plane.
//!
//! Ties: a vertex exactly on the plane is not moved and makes no sliver: faces are split at it. A face all of whose corners
//! lie on the plane goes to the side of the solid behind it, so that no flat piece is cut off. A plane with nothing strictly
//! on one of its sides only grazes the model: a miss.

use super::insert::NewVertex;
use super::plane_split::{Crossed, FaceSplitter, NO_EDGE};
use crate::geometry::{FaceId, HalfEdge, Mesh, Plane, SplitVertex, TopologyScratch, VertexId};
use glam::DVec3;

/// Sides of faces.
const POSITIVE: u8 = 1;
const NEGATIVE: u8 = 2;

/// What a plane cut did to the mesh.
#[derive(Clone, Debug, Default)]
pub struct PlaneCutOutcome {
    /// Vertices inserted, in order of their ids: for each crossed edge one on the positive side and its copy on the negative,
    /// then copies of vertices that lay on the plane.
    pub new_vertices: Vec<NewVertex>,
    /// Crossed edges.
    pub intersection_points: usize,
    /// Faces that were split.
    pub faces_split: usize,
    /// Edges in the plane that were opened.
    pub opened_edges: usize,
    /// Faces looked at.
    pub faces_visited: usize,
    /// Parts of split faces.
    pub added_faces: Vec<FaceId>,
    /// Whether there are vertices strictly on both sides: if nothing was split then, components lie apart.
    pub on_both_sides: bool,
}

impl PlaneCutOutcome {
    /// True if the plane went through nothing.
    pub fn missed(&self) -> bool {
        self.faces_split == 0 && self.opened_edges == 0
    }
}

/// A vertex that the cut has looked at.
#[derive(Clone, Copy, Debug)]
pub(super) struct Visited {
    /// Value of the plane, exact in sign.
    pub value: f64,
    /// Final position.
    pub position: DVec3,
}

/// Buffers kept between cuts.
#[derive(Debug, Default)]
pub struct PlaneCutScratch {
    /// The cut that looked at a vertex last, and the vertex's place in `visited`.
    slots: Vec<[u32; 2]>,
    pub(super) visited: Vec<Visited>,
    /// The cut that found a face crossed and has not split it yet, and the face's place in `crossed`.
    pub(super) waiting: Vec<[u32; 2]>,
    pub(super) crossed: Vec<Crossed>,
    pub(super) cut: u32,
    /// Vertices before the cut.
    loaded: usize,
    topology: TopologyScratch,
    on_plane: Vec<VertexId>,
    incident: Vec<FaceId>,
    split: Vec<SplitVertex>,
    pub(super) rim: Vec<[HalfEdge; 2]>,
    taken: Vec<[VertexId; 2]>,
}

impl PlaneCutScratch {
    /// Edges along which the last cut opened the surface: the half-edge on the positive side, then its partner on the negative.
    /// What a cap is made from (MATHS 6). Those of split faces follow one another along the cut.
    pub fn rim(&self) -> &[[HalfEdge; 2]] {
        &self.rim
    }

    /// Pairs of vertices in the plane that the surface joins already, other than along the rim: no edge of a cap may join
    /// them again. Empty unless vertices lay on the plane before the last cut.
    pub fn taken(&self) -> &[[VertexId; 2]] {
        &self.taken
    }

    /// Value of the plane of the last cut at a vertex that it looked at, exact in sign.
    pub fn value(&self, v: VertexId) -> Option<f64> {
        let &[cut, place] = self.slots.get(v.index())?;
        (cut == self.cut).then(|| self.visited[place as usize].value)
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
    outcome.on_both_sides = classify(mesh, plane, reach, &position, scratch);
    if !outcome.on_both_sides {
        return outcome;
    }
    scratch.rim.clear();
    collect_incident(mesh, scratch);
    if !scratch.on_plane.is_empty() {
        // faces at such an edge are not split, so this may go first, while every vertex still has one fan
        outcome.opened_edges = open_edges_on_plane(mesh, plane, &position, scratch);
    }
    FaceSplitter { mesh: &mut *mesh, scratch: &mut *scratch, outcome: &mut outcome }.split_all();
    outcome.intersection_points = outcome.new_vertices.len() / 2;
    outcome.faces_split = scratch.crossed.len();
    if !scratch.on_plane.is_empty() {
        split_vertices(mesh, &position, scratch, &mut outcome);
    }
    collect_taken(mesh, scratch);
    outcome
}

/// Values of the corners of all faces within reach, exact in sign, each vertex posed once; collects the crossed faces. True if
/// some vertices lie strictly on each side.
fn classify(
    mesh: &Mesh,
    plane: &Plane,
    reach: Reach<'_>,
    position: &impl Fn(VertexId) -> DVec3,
    scratch: &mut PlaneCutScratch,
) -> bool {
    scratch.begin(mesh);
    let PlaneCutScratch { slots, visited, waiting, crossed, cut, on_plane, .. } = scratch;
    let [mut above, mut below] = reach.beyond;
    let (faces, slots) = (mesh.faces(), &mut slots[..]);
    for &f in reach.faces {
        let [a, b, c] = faces[f.index()];
        if [a, b, c].iter().any(|v| slots[v.index()][0] != *cut) {
            for v in [a, b, c] {
                let slot = &mut slots[v.index()];
                if slot[0] == *cut {
                    continue;
                }
                *slot = [*cut, visited.len() as u32];
                let position = position(v);
                let value = plane.value(position);
                visited.push(Visited { value, position });
                above |= value > 0.0;
                below |= value < 0.0;
                if value == 0.0 {
                    on_plane.push(v);
                }
            }
        }
        let corners = [slots[a.index()][1], slots[b.index()][1], slots[c.index()][1]];
        let value = |k: usize| visited[corners[k] as usize].value;
        let [a, b, c] = [value(0), value(1), value(2)];
        if (a > 0.0 || b > 0.0 || c > 0.0) && (a < 0.0 || b < 0.0 || c < 0.0) {
            waiting[f.index()] = [*cut, crossed.len() as u32];
            let edge = |falls: bool| {
                let ends = [[a, b], [b, c], [c, a]];
                ends.iter().position(|e| if falls { e[0] > 0.0 && e[1] < 0.0 } else { e[0] < 0.0 && e[1] > 0.0 })
            };
            let [entry, exit] = [true, false].map(|falls| edge(falls).map_or(NO_EDGE, |k| k as u8));
            crossed.push(Crossed { face: f, corners, entry, exit });
        }
    }
    above && below
}

impl PlaneCutScratch {
    fn begin(&mut self, mesh: &Mesh) {
        self.loaded = mesh.vertex_slots();
        if self.cut == u32::MAX {
            self.slots.fill([0; 2]);
            self.waiting.fill([0; 2]);
            self.cut = 0;
        }
        self.cut += 1;
        grow(&mut self.slots, mesh.vertex_slots());
        grow(&mut self.waiting, mesh.face_slots());
        self.visited.clear();
        self.crossed.clear();
        self.on_plane.clear();
    }
}

/// Room for `len` stamps. A fresh array of zeros costs nothing until it is touched.
fn grow(stamps: &mut Vec<[u32; 2]>, len: usize) {
    if stamps.is_empty() {
        *stamps = vec![[0; 2]; len + len / 4];
    } else if stamps.len() < len {
        stamps.resize(len + len / 4, [0; 2]);
    }
}

/// Tells the side of a face that the plane does not cross.
struct Sides<'a, P> {
    scratch: &'a PlaneCutScratch,
    position: &'a P,
    plane: &'a Plane,
}

impl<P: Fn(VertexId) -> DVec3> Sides<'_, P> {
    fn value(&self, v: VertexId) -> f64 {
        // a face at the rim may have a corner that no face within reach has
        self.scratch.value(v).unwrap_or_else(|| self.plane.value((self.position)(v)))
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

/// Faces around the vertices that lie on the plane.
fn collect_incident(mesh: &Mesh, scratch: &mut PlaneCutScratch) {
    scratch.incident.clear();
    for &v in &scratch.on_plane {
        scratch.incident.extend(mesh.fan(v).map(HalfEdge::face));
    }
}

/// Opens edges that lie in the plane between faces of different sides; returns how many.
fn open_edges_on_plane(
    mesh: &mut Mesh,
    plane: &Plane,
    position: &impl Fn(VertexId) -> DVec3,
    scratch: &mut PlaneCutScratch,
) -> usize {
    let mut rim = std::mem::take(&mut scratch.rim);
    let sides = Sides { scratch, position, plane };
    for h in scratch.incident.iter().flat_map(|&f| (0..3).map(move |k| HalfEdge::of(f, k))) {
        let back = mesh.opposite(h);
        if back.is_none() || sides.value(mesh.from(h)) != 0.0 || sides.value(mesh.to(h)) != 0.0 {
            continue;
        }
        let side = sides.of(mesh.face(h.face()));
        if side != sides.of(mesh.face(back.face())) {
            mesh.open_edge(h);
            rim.push(if side == POSITIVE { [h, back] } else { [back, h] });
        }
    }
    scratch.rim = rim;
    scratch.rim.len()
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
    let loaded = scratch.loaded;
    for split in &scratch.split {
        debug_assert!(split.from.index() < loaded, "only vertices on the plane fall into fans");
        let position = position(split.from);
        let parents = [(split.from, 1.0), (VertexId::NONE, 0.0), (VertexId::NONE, 0.0)];
        outcome.new_vertices.push(NewVertex { vertex: split.vertex, parents, parent_count: 1, position });
    }
}

/// Edges in the plane that stay closed, between vertices that lay on the plane and their copies.
fn collect_taken(mesh: &Mesh, scratch: &mut PlaneCutScratch) {
    scratch.taken.clear();
    if scratch.on_plane.is_empty() {
        return;
    }
    let mut on_plane = scratch.on_plane.clone();
    on_plane.extend(scratch.split.iter().map(|s| s.vertex));
    collect_joined(mesh, on_plane, &mut scratch.taken);
}

/// Pairs of `vertices` that the surface joins.
pub(super) fn collect_joined(mesh: &Mesh, mut vertices: Vec<VertexId>, out: &mut Vec<[VertexId; 2]>) {
    vertices.sort_unstable();
    vertices.dedup();
    for &v in &vertices {
        let around = mesh.fan(v).filter(|&h| mesh.opposite(h).is_some()).map(|h| [v, mesh.to(h)]);
        out.extend(around.filter(|edge| edge[0] < edge[1] && vertices.binary_search(&edge[1]).is_ok()));
    }
}
