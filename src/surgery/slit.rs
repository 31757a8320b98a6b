//! Opens a surface along leaves: the tear of width 0 and the bounded plane cut (MATHS 5.3, 6).
//!
//! Stages for each leaf: values of the candidate faces' corners, the part of the leaf inside each face, vertices on crossed
//! edges and where the leaf ends inside a face, second pass over neighbours, retriangulation with the crossing as an edge,
//! then those edges are opened and each side gets vertices of its own, except at the slit's ends. Nothing is taken out and
//! no vertex is moved. Edges that lie in the leaf's plane are opened as they are; ties follow the plane cut's rule.

use super::insert::{EdgePoint, EdgePoints, NewVertex, WedgeMaker};
use super::leaf::{At, Leaf, Seen, along_edge, crossing, inner_weights, line, sign_at};
use super::plane_cut::collect_joined;
use super::region::{Region, RegionPoint};
use super::tear::{LipPoint, flatten};
use crate::geometry::room::fit;
use crate::geometry::{FaceId, HalfEdge, Mesh, NewFace, SplitVertex, TopologyScratch, VertexId, WedgeId};
use glam::DVec3;

/// A vertex that lies, by construction, on lines that leaves share; bits of [`super::leaf::line`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OnLines {
    /// The vertex.
    pub vertex: VertexId,
    /// Lines.
    pub lines: u8,
}

/// What the leaves of one step did to the mesh.
#[derive(Clone, Debug, Default)]
pub struct SlitStep {
    /// Vertices inserted, in order of their ids; parents come before their children.
    pub new_vertices: Vec<NewVertex>,
    /// Vertices on the lips: side -1 where the leaf's plane is positive (a box's minus wall). Ends of the slit, which lie on
    /// both, are not listed.
    pub lips: Vec<LipPoint>,
    /// Ends of the slit on shared lines: the tags of the leaf or strip that goes on from there.
    pub tags: Vec<OnLines>,
    /// Edges opened.
    pub opened_edges: usize,
    /// Faces split.
    pub faces_split: usize,
    /// Faces put in that are still there.
    pub added_faces: Vec<FaceId>,
    /// Vertices of the faces that changed. Sorted.
    pub touched: Vec<VertexId>,
    /// Candidate faces looked at.
    pub faces_visited: usize,
    /// Points where the leaves cross edges or end inside faces.
    pub intersection_points: usize,
    /// Vertices that cuts run through or end at, copies aside.
    pub met: Vec<VertexId>,
    /// Vertices along what the step has cut and left closed: they belong to the lip beside them.
    pub closed: Vec<VertexId>,
    /// Sine of the smallest angle of the faces put in; infinite without any.
    pub smallest_sine: f64,
    first_new: usize,
}

impl SlitStep {
    /// Vertices where cuts end: met by one only. Sorted.
    pub fn ends(&self, out: &mut Vec<VertexId>) {
        out.clear();
        out.extend_from_slice(&self.met);
        out.sort_unstable();
        let (mut i, mut kept) = (0, 0);
        while i < out.len() {
            let run = out[i..].iter().take_while(|&&v| v == out[i]).count();
            if run == 1 {
                out[kept] = out[i];
                kept += 1;
            }
            i += run;
        }
        out.truncate(kept);
    }

    fn sort_touched(&mut self) {
        self.touched.sort_unstable();
        self.touched.dedup();
    }

    /// True if one lip of what the step has opened leads from vertex `a` to `b`.
    pub fn is_one_cut(&self, mesh: &Mesh, a: VertexId, b: VertexId) -> bool {
        let border = |v: VertexId| mesh.border_from(v).map(|h| mesh.to(h));
        std::iter::successors(Some(a), |&v| border(v)).take(self.met.len() + 1).any(|v| v == b)
    }

    /// Forgets everything but the buffers.
    fn clear(&mut self) {
        let Self { mut new_vertices, mut lips, mut tags, mut added_faces, mut touched, mut met, mut closed, .. } =
            std::mem::take(self);
        new_vertices.clear();
        lips.clear();
        tags.clear();
        added_faces.clear();
        [&mut touched, &mut met, &mut closed].into_iter().for_each(|list| list.clear());
        let smallest_sine = f64::INFINITY;
        *self = Self { new_vertices, lips, tags, added_faces, touched, met, closed, smallest_sine, ..Self::default() };
    }
}

/// A face to be split: the crossing inside it, if any, directed with the leaf's positive side on the left.
struct Affected {
    face: FaceId,
    cut: Option<[At; 2]>,
}

/// A mesh edge in the leaf's plane, as half-edge `edge` of `face`, and the part of it to be opened, directed as above.
struct PlaneEdge {
    face: FaceId,
    edge: usize,
    cut: [At; 2],
}

/// Buffers kept between steps.
#[derive(Default)]
pub struct SlitScratch {
    slot: Vec<u32>,
    slotted: Vec<VertexId>,
    positions: Vec<DVec3>,
    /// `planes` values a slot: the leaf's plane, then its bounds.
    values: Vec<f64>,
    planes: usize,
    faces: Vec<FaceId>,
    /// Those of them whose bounds meet the leaf's, and whether they are slivers.
    reached: Vec<(FaceId, bool)>,
    affected: Vec<Affected>,
    plane_edges: Vec<PlaneEdge>,
    edge_points: EdgePoints,
    on_edge: Vec<EdgePoint>,
    wedges: WedgeMaker,
    region: Region,
    locals: Vec<(VertexId, WedgeId)>,
    removed: Vec<FaceId>,
    added: Vec<NewFace>,
    topology: TopologyScratch,
    split: Vec<SplitVertex>,
    incident: Vec<FaceId>,
    vertices: Vec<VertexId>,
    /// Ends of the slit that this one goes on from.
    starts: Vec<VertexId>,
    cuts: Vec<[VertexId; 2]>,
    spur: Vec<usize>,
    opened: Vec<[HalfEdge; 2]>,
    sides: Vec<(VertexId, i8)>,
    ways: slit_way::Ways,
}

/// How thin a sliver is, in grains of a leaf.
const SLIVER: f64 = 100.0;

/// Where a leaf meets more slivers than this, those are not cut: a blade whose tip goes along in the skin
/// leaves them at the same points again and again, and each leaf would cut them all in two.
const MOST_SLIVERS: usize = 48;

const NO_SLOT: u32 = u32::MAX;

/// The positions that a step sees: those of the caller, and those of the vertices that the step has made.
struct Places<'a, P> {
    position: &'a P,
    first_new: usize,
}

impl<P: Fn(VertexId) -> DVec3> Places<'_, P> {
    fn of(&self, v: VertexId, new: &[NewVertex]) -> DVec3 {
        if v.index() < self.first_new { (self.position)(v) } else { new[v.index() - self.first_new].position }
    }
}

/// Opens `mesh` along `leaves`, one after the other. `candidates` must hold every face whose bounds meet a leaf's;
/// `position` gives final positions of live vertices; `tags` lists vertices that lie on shared lines by construction. Fills
/// `out`; returns false, with the mesh untouched, if no leaf crosses a face.
pub fn slit_step(
    mesh: &mut Mesh,
    leaves: &[Leaf],
    candidates: &[FaceId],
    position: &impl Fn(VertexId) -> DVec3,
    tags: &[OnLines],
    scratch: &mut SlitScratch,
    out: &mut SlitStep,
) -> bool {
    out.clear();
    out.tags.extend_from_slice(tags);
    scratch.starts.clear();
    scratch.starts.extend(tags.iter().filter(|t| t.lines & line::START != 0).map(|t| t.vertex));
    out.first_new = mesh.vertex_slots();
    out.faces_visited = candidates.len();
    let places = Places { position, first_new: out.first_new };
    for leaf in leaves {
        scratch.open_leaf(mesh, leaf, candidates, &places, out);
    }
    out.sort_touched();
    out.opened_edges > 0
}

#[path = "slit_open.rs"]
mod slit_open;
#[path = "slit_room.rs"]
mod slit_room;
#[path = "slit_single.rs"]
mod slit_single;
#[path = "slit_way.rs"]
mod slit_way;

impl SlitScratch {
    /// Edges along which the last leaf opened the surface, as [`super::plane_cut::PlaneCutScratch::rim`]; in no order.
    pub fn rim(&self) -> &[[HalfEdge; 2]] {
        &self.opened
    }

    /// As [`super::plane_cut::PlaneCutScratch::taken`].
    pub fn taken(&self, mesh: &Mesh) -> Vec<[VertexId; 2]> {
        let mut taken = Vec::new();
        collect_joined(mesh, self.opened.iter().flatten().flat_map(|&h| [mesh.from(h), mesh.to(h)]).collect(), &mut taken);
        taken
    }

    fn open_leaf<P: Fn(VertexId) -> DVec3>(
        &mut self,
        mesh: &mut Mesh,
        leaf: &Leaf,
        candidates: &[FaceId],
        places: &Places<'_, P>,
        out: &mut SlitStep,
    ) {
        self.begin(mesh, leaf.bounds.len() + 1);
        self.faces.extend(candidates.iter().chain(&out.added_faces).filter(|f| mesh.is_live(**f)));
        self.faces.sort_unstable();
        self.faces.dedup();
        self.cross_faces(mesh, leaf, places, out);
        if !self.affected.is_empty() || !self.plane_edges.is_empty() {
            self.insert_on_edges(mesh, out);
            self.second_pass(mesh, leaf, places, out);
            self.retriangulate(mesh, leaf, out);
            self.replace(mesh, out);
            self.open(mesh, out);
        }
        self.free_slots();
    }

    fn free_slots(&mut self) {
        for v in &self.slotted {
            self.slot[v.index()] = NO_SLOT;
        }
    }

    fn begin(&mut self, mesh: &Mesh, planes: usize) {
        fit(&mut self.slot, mesh.vertex_slots(), NO_SLOT);
        self.planes = planes;
        self.slotted.clear();
        self.positions.clear();
        self.values.clear();
        self.faces.clear();
        self.affected.clear();
        self.plane_edges.clear();
        self.edge_points.clear();
        self.wedges.clear();
        self.removed.clear();
        self.added.clear();
        self.cuts.clear();
        self.opened.clear();
        self.sides.clear();
    }

    /// The vertex's slot with its position and values, made when first asked for.
    fn slot<P: Fn(VertexId) -> DVec3>(&mut self, v: VertexId, leaf: &Leaf, places: &Places<'_, P>, out: &SlitStep) -> usize {
        let known = self.slot[v.index()];
        if known != NO_SLOT {
            return known as usize;
        }
        let at = places.of(v, &out.new_vertices);
        let slot = self.new_slot(v, at);
        let tagged = out.tags.iter().filter(|t| t.vertex == v).fold(0, |m, t| m | t.lines);
        self.values.push(if tagged & leaf.lines != 0 { 0.0 } else { leaf.value(at) });
        for bound in &leaf.bounds {
            self.values.push(if tagged & bound.line != 0 { 0.0 } else { bound.plane.value(at) });
        }
        slot
    }

    /// A slot for a vertex that has none; its values are still to be pushed.
    fn new_slot(&mut self, v: VertexId, at: DVec3) -> usize {
        let slot = self.slotted.len();
        self.slot[v.index()] = slot as u32;
        self.slotted.push(v);
        self.positions.push(at);
        slot
    }

    /// The face with its corners' values; all have slots.
    fn seen<'a>(&'a self, mesh: &Mesh, face: FaceId, leaf: &'a Leaf) -> Seen<'a> {
        let slots = mesh.face(face).map(|v| self.slot[v.index()] as usize);
        let rows = slots.map(|s| &self.values[s * self.planes..(s + 1) * self.planes]);
        Seen { leaf, corners: slots.map(|s| self.positions[s]), rows }
    }

    fn cross_faces<P: Fn(VertexId) -> DVec3>(&mut self, mesh: &Mesh, leaf: &Leaf, places: &Places<'_, P>, out: &SlitStep) {
        let (mut reached, mut slivers) = (std::mem::take(&mut self.reached), 0);
        reached.clear();
        for i in 0..self.faces.len() {
            let face = self.faces[i];
            let slots = mesh.face(face).map(|v| self.slot(v, leaf, places, out));
            let corners = slots.map(|s| self.positions[s]);
            let (low, high) = (corners[0].min(corners[1]).min(corners[2]), corners[0].max(corners[1]).max(corners[2]));
            if !(low.cmpgt(leaf.max).any() || high.cmplt(leaf.min).any()) {
                let is_sliver = is_thinner(corners, SLIVER * leaf.grain);
                slivers += usize::from(is_sliver);
                reached.push((face, is_sliver));
            }
        }
        let is_crowded = slivers > MOST_SLIVERS;
        for &(face, is_sliver) in &reached {
            if is_crowded && is_sliver {
                continue;
            }
            if let Some(cut) = crossing(&self.seen(mesh, face, leaf)) {
                self.affected.push(Affected { face, cut: Some(cut) });
            }
            for edge in 0..3 {
                self.cross_edge(mesh, HalfEdge::of(face, edge), leaf, places, out);
            }
        }
        self.reached = reached;
    }

    /// Notes a mesh edge that lies in the leaf's plane between faces of different sides.
    fn cross_edge<P: Fn(VertexId) -> DVec3>(
        &mut self,
        mesh: &Mesh,
        h: HalfEdge,
        leaf: &Leaf,
        places: &Places<'_, P>,
        out: &SlitStep,
    ) {
        let back = mesh.opposite(h);
        let value = |s: &Self, v: VertexId| s.values[s.slot[v.index()] as usize * s.planes];
        if back.is_none() || value(self, mesh.from(h)) != 0.0 || value(self, mesh.to(h)) != 0.0 {
            return;
        }
        // once an edge: at its lower face, unless only the other one is a candidate
        if back.face() < h.face() && self.faces.binary_search(&back.face()).is_ok() {
            return;
        }
        self.slot(mesh.from(back.prev()), leaf, places, out);
        let positive = self.is_positive(mesh, h.face(), leaf);
        if positive == self.is_positive(mesh, back.face(), leaf) {
            return;
        }
        if let Some([a, b]) = along_edge(h.corner(), &self.seen(mesh, h.face(), leaf)) {
            let cut = if positive { [a, b] } else { [b, a] };
            self.plane_edges.push(PlaneEdge { face: h.face(), edge: h.corner(), cut });
        }
    }

    /// The side of a face that the plane does not cross; a face in the plane goes to the side of the solid behind it.
    fn is_positive(&self, mesh: &Mesh, face: FaceId, leaf: &Leaf) -> bool {
        let slots = mesh.face(face).map(|v| self.slot[v.index()] as usize);
        let values = slots.map(|s| self.values[s * self.planes]);
        if values == [0.0; 3] {
            let [a, b, c] = slots.map(|s| self.positions[s]);
            return (b - a).cross(c - a).dot(leaf.plane.normal()) <= 0.0;
        }
        !values.iter().any(|&d| d < 0.0)
    }

    /// One vertex for each crossing of an edge.
    fn insert_on_edges(&mut self, mesh: &mut Mesh, out: &mut SlitStep) {
        let crossed = self.affected.iter().filter_map(|a| a.cut.map(|cut| (a.face, cut)));
        let all = crossed.chain(self.plane_edges.iter().map(|e| (e.face, e.cut)));
        for (face, at) in all.flat_map(|(face, cut)| cut.map(|at| (face, at))) {
            let At::Edge { edge, plane } = at else { continue };
            let corners = mesh.face(face);
            let (mut a, mut b) = (corners[edge as usize], corners[(edge as usize + 1) % 3]);
            if b < a {
                std::mem::swap(&mut a, &mut b);
            }
            if self.edge_points.find(a, b, plane).is_some() {
                continue;
            }
            let [slot_a, slot_b] = [a, b].map(|v| self.slot[v.index()] as usize);
            let [value_a, value_b] = [slot_a, slot_b].map(|s| self.values[s * self.planes + plane as usize]);
            let vertex = mesh.add_vertex();
            self.edge_points.insert((a, value_a), (b, value_b), plane, vertex);
            let t = super::clip::edge_parameter(value_a, value_b);
            let ends = [(a, self.positions[slot_a]), (b, self.positions[slot_b])];
            out.new_vertices.push(NewVertex::on_edge(vertex, ends, t));
        }
    }

    /// Every face with a split edge is split, so that no T-junction is left.
    fn second_pass<P: Fn(VertexId) -> DVec3>(&mut self, mesh: &Mesh, leaf: &Leaf, places: &Places<'_, P>, out: &SlitStep) {
        self.removed.extend(self.affected.iter().map(|a| a.face));
        self.removed.sort_unstable();
        for i in 0..self.plane_edges.len() {
            let PlaneEdge { face, edge, .. } = self.plane_edges[i];
            if self.edge_points.contains(mesh.from(HalfEdge::of(face, edge)), mesh.to(HalfEdge::of(face, edge))) {
                self.affect(mesh, face, leaf, places, out);
            }
        }
        let mut i = 0;
        while i < self.affected.len() {
            for k in 0..3 {
                let h = HalfEdge::of(self.affected[i].face, k);
                let back = mesh.opposite(h);
                if back.is_some() && self.edge_points.contains(mesh.from(h), mesh.to(h)) {
                    self.affect(mesh, back.face(), leaf, places, out);
                }
            }
            i += 1;
        }
    }

    fn affect<P: Fn(VertexId) -> DVec3>(
        &mut self,
        mesh: &Mesh,
        face: FaceId,
        leaf: &Leaf,
        places: &Places<'_, P>,
        out: &SlitStep,
    ) {
        if let Err(at) = self.removed.binary_search(&face) {
            self.removed.insert(at, face);
            self.affected.push(Affected { face, cut: None });
            for v in mesh.face(face) {
                self.slot(v, leaf, places, out);
            }
        }
    }

    fn retriangulate(&mut self, mesh: &mut Mesh, leaf: &Leaf, out: &mut SlitStep) {
        for i in 0..self.plane_edges.len() {
            let PlaneEdge { face, cut, .. } = self.plane_edges[i];
            let ends = cut.map(|at| self.edge_vertex(mesh, face, at));
            self.cuts.push(ends);
            for k in 0..2 {
                self.note_lines(mesh, leaf, face, cut[k], ends[k], out);
            }
        }
        for i in 0..self.affected.len() {
            let Affected { face, cut } = self.affected[i];
            let info = mesh.face_info(face);
            self.build_region(mesh, face);
            if let Some(cut) = cut {
                let ends = cut.map(|at| self.local_of(mesh, leaf, face, at, out));
                self.region.inner.extend(ends);
                self.region.inner_on_face.extend([false; 2]);
                let ends = ends.map(|l| self.locals[l as usize].0);
                self.cuts.push(ends);
                for k in 0..2 {
                    self.note_lines(mesh, leaf, face, cut[k], ends[k], out);
                }
            }
            self.region.triangulate();
            out.smallest_sine = out.smallest_sine.min(self.region.smallest_sine());
            for t in &self.region.triangles {
                let at = t.map(|l| self.locals[l as usize]);
                self.added.push(NewFace { corners: at.map(|l| l.0), wedges: at.map(|l| l.1), info, side: 0 });
            }
        }
    }

    /// The face with the points on its edges.
    fn build_region(&mut self, mesh: &mut Mesh, face: FaceId) {
        let (corners, wedges) = (mesh.face(face), mesh.face_wedges(face));
        let slots = corners.map(|v| self.slot[v.index()] as usize);
        let frame = flatten(slots.map(|s| self.positions[s]));
        self.region.clear();
        self.locals.clear();
        for k in 0..3 {
            let on_plane = u32::from(self.values[slots[k] * self.planes] == 0.0) << 3;
            self.region.points.push(RegionPoint { at: frame[k], lines: 1 << k | 1 << ((k + 2) % 3) | on_plane });
            self.locals.push((corners[k], wedges[k]));
        }
        for k in 0..3 {
            self.region.outer.push(k as u16);
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            self.edge_points.sorted(a, b, &mut self.on_edge);
            for j in 0..self.on_edge.len() {
                let p = self.on_edge[j];
                let t = if a < b { p.t } else { 1.0 - p.t };
                let at = std::array::from_fn(|d| frame[k][d] + (frame[(k + 1) % 3][d] - frame[k][d]) * t);
                let wedge = self.wedges.on_edge(mesh, p.vertex, wedges[k], wedges[(k + 1) % 3], t);
                self.region.outer.push(self.region.points.len() as u16);
                self.region.points.push(RegionPoint { at, lines: 1 << k | u32::from(p.plane == 0) << 3 });
                self.locals.push((p.vertex, wedge));
            }
        }
    }

    /// The vertex of a corner or of a crossing that was inserted.
    fn edge_vertex(&self, mesh: &Mesh, face: FaceId, at: At) -> VertexId {
        let corners = mesh.face(face);
        match at {
            At::Corner(c) => corners[c as usize],
            At::Edge { edge, plane } => {
                let found = self.edge_points.find(corners[edge as usize], corners[(edge as usize + 1) % 3], plane);
                found.expect("a crossing was inserted for every edge point")
            }
            At::Inner { .. } => VertexId::NONE,
        }
    }

    /// The region's index of an end of the cut; one inside the face becomes a new vertex.
    fn local_of(&mut self, mesh: &mut Mesh, leaf: &Leaf, face: FaceId, at: At, out: &mut SlitStep) -> u16 {
        let At::Inner { plane } = at else {
            let vertex = self.edge_vertex(mesh, face, at);
            return self.locals.iter().position(|l| l.0 == vertex).expect("a cut ends on the face") as u16;
        };
        let weights = inner_weights(plane as usize, &self.seen(mesh, face, leaf).rows);
        let corners = mesh.face(face);
        let slots = corners.map(|v| self.slot[v.index()] as usize);
        let vertex = mesh.add_vertex();
        let position = (0..3).map(|k| self.positions[slots[k]] * weights[k]).sum();
        let parents = std::array::from_fn(|k| (corners[k], weights[k]));
        out.new_vertices.push(NewVertex { vertex, parents, parent_count: 3, position });
        let wedge = self.wedges.in_face(mesh, vertex, mesh.face_wedges(face), weights);
        self.locals.push((vertex, wedge));
        let flat = std::array::from_fn(|d| (0..3).map(|k| self.region.points[k].at[d] * weights[k]).sum());
        self.region.points.push(RegionPoint { at: flat, lines: 8 });
        (self.region.points.len() - 1) as u16
    }

    /// Tags an end of the cut with the shared lines it lies on, by exact signs.
    fn note_lines(&mut self, mesh: &Mesh, leaf: &Leaf, face: FaceId, at: At, vertex: VertexId, out: &mut SlitStep) {
        let seen = self.seen(mesh, face, leaf);
        let on = |k: usize| leaf.bounds[k].line != 0 && sign_at(at, &seen, k + 1) == 0;
        let lines = (0..leaf.bounds.len()).filter(|&k| on(k)).fold(0, |m, k| m | leaf.bounds[k].line);
        let tag = OnLines { vertex, lines };
        if lines != 0 && !out.tags.contains(&tag) {
            out.tags.push(tag);
        }
    }

    fn replace(&mut self, mesh: &mut Mesh, out: &mut SlitStep) {
        out.intersection_points = out.new_vertices.iter().filter(|n| n.parent_count > 1).count();
        out.faces_split += self.removed.len();
        out.touched.extend(self.removed.iter().flat_map(|&f| mesh.face(f)));
        mesh.replace_faces(&self.removed, &self.added, |_| 0, &mut self.topology);
        out.added_faces.retain(|f| self.removed.binary_search(f).is_err());
        out.added_faces.extend_from_slice(&self.topology.added);
    }
}

/// True for a triangle that nowhere is wider than `width` across its longest side.
fn is_thinner([a, b, c]: [DVec3; 3], width: f64) -> bool {
    let (ab, ac, bc) = (b - a, c - a, c - b);
    let longest = ab.length_squared().max(ac.length_squared()).max(bc.length_squared());
    ab.cross(ac).length_squared() <= width * width * longest
}
