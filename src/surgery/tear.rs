//! Takes the inside of a convex body out of a surface: one step of the tear (the paper's Tearing Algorithm, MATHS 5.6).
//!
//! Stages: values of the candidate faces' corners, clip each face, insert vertices on edges and in faces, second pass over
//! neighbours across split edges, retriangulate, replace, split vertices left with several fans; a closed tear then lines the
//! hole ([`super::tear_walls`]). No vertex is moved.

use super::boxes::Side;
use super::clip::{Carrier, ClippedFace, MAX_PLANES, PlaneValues, Point, point_sign, point_weights};
use super::insert::{EdgePoint, EdgePoints, NewVertex, WedgeMaker, copy_marks};
use super::region::{Region, RegionPoint};
use super::tear_walls::{WallScratch, WallSpec};
use crate::geometry::room::fit;
use crate::geometry::{FaceId, FaceInfo, HalfEdge, Mesh, NewFace, Plane, SplitVertex, TopologyScratch, VertexId, WedgeId};
use glam::DVec3;
use smallvec::SmallVec;

/// A convex body: the meet of the negative sides of its planes, at most [`MAX_PLANES`].
#[derive(Clone, Copy, Debug)]
pub struct Body<'a> {
    /// Planes with outward normals.
    pub planes: &'a [Plane],
    /// What each plane is for.
    pub sides: &'a [Side],
    /// Bounds, padded by rounding.
    pub min: DVec3,
    /// Bounds, padded by rounding.
    pub max: DVec3,
}

/// A vertex with the planes of a body it lies on by construction, bit `k` for plane `k` (MATHS 5.6: zero by tag).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OnPlanes {
    /// The vertex.
    pub vertex: VertexId,
    /// Planes.
    pub planes: u16,
}

/// A vertex on a lip of the slit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LipPoint {
    /// The vertex.
    pub vertex: VertexId,
    /// -1 on the minus wall, +1 on the plus wall.
    pub side: i8,
}

/// What one body did to the mesh.
#[derive(Clone, Debug, Default)]
pub struct TearStep {
    /// Vertices inserted, in order of their ids.
    pub new_vertices: Vec<NewVertex>,
    /// Vertices on the lips, sorted.
    pub lips: Vec<LipPoint>,
    /// Vertices on the end joint, with all planes they lie on: the next body's tags.
    pub on_end: Vec<OnPlanes>,
    /// Faces removed or replaced.
    pub faces_removed: usize,
    /// Faces put in.
    pub added_faces: Vec<FaceId>,
    /// Corners of the removed faces: what the particle layer and the normals must look at again. Sorted.
    pub touched: Vec<VertexId>,
    /// Candidate faces looked at.
    pub faces_visited: usize,
    /// Points where planes cross edges or pierce faces.
    pub intersection_points: usize,
    /// Area taken out, square metres, in the pose of the edit.
    pub area_removed: f64,
    /// Faces of walls and floor, with the side of the body that they line (closed tears).
    pub walls: Vec<(FaceId, Side)>,
    /// Faces of older walls that have got other corners (closed tears): they may reach farther now.
    pub widened_faces: Vec<FaceId>,
    /// What has come of faces of older walls: which, and a face of its place.
    pub recut: Vec<(FaceId, FaceId)>,
    /// Edges of the hole's rim that belong to no closed loop, and got no wall: the model was open there.
    pub unclosed_edges: usize,
    /// Faces of older walls that the body cut or swallowed, but those it was told to (closed tears).
    pub walls_cut: usize,
    /// Faces of the model's own surface that the body cut or swallowed.
    pub skin_cut: usize,
    /// Corners of the body (bits) that the walls go round though they were seen outside the solid.
    pub corners_outside: u8,
    /// Sine of the smallest angle of the faces put in; infinite without any.
    pub smallest_sine: f64,
}

impl TearStep {
    /// Forgets everything but the buffers.
    pub fn clear(&mut self) {
        let Self { new_vertices, lips, on_end, added_faces, touched, walls, widened_faces, recut, .. } = std::mem::take(self);
        let smallest_sine = f64::INFINITY;
        let kept = Self { new_vertices, lips, on_end, added_faces, touched, walls, widened_faces, recut, ..Self::default() };
        *self = Self { smallest_sine, ..kept };
        self.widened_faces.clear();
        self.recut.clear();
        self.new_vertices.clear();
        self.lips.clear();
        self.on_end.clear();
        self.added_faces.clear();
        self.touched.clear();
        self.walls.clear();
    }
}

struct Affected {
    face: FaceId,
    /// Range in the polygon arena; empty for a face that only has split edges.
    first: usize,
    len: usize,
}

/// Buffers kept between steps.
#[derive(Default)]
pub struct TearScratch {
    pub(super) slot: Vec<u32>,
    slotted: Vec<VertexId>,
    pub(super) positions: Vec<DVec3>,
    values: Vec<PlaneValues>,
    /// Slots whose values are known.
    valued: Vec<bool>,
    clipped: ClippedFace,
    affected: Vec<Affected>,
    points: Vec<(Point, Carrier)>,
    edge_points: EdgePoints,
    on_edge: Vec<EdgePoint>,
    wedges: WedgeMaker,
    region: Region,
    locals: Vec<(VertexId, WedgeId)>,
    removed: Vec<FaceId>,
    added: Vec<NewFace>,
    pub(super) topology: TopologyScratch,
    pub(super) split: Vec<SplitVertex>,
    pub(super) incident: Vec<FaceId>,
    vertices: Vec<VertexId>,
    pub(super) zero: Vec<OnPlanes>,
    /// The walls of a closed tear.
    pub(super) lining: WallScratch,
    is_closed: bool,
    /// As in [`WallSpec`]; 0 for an open tear.
    grain: f64,
}

/// What is beyond a plane by this share of the body's size is so for certain, however its distance is rounded.
const CLEARLY: f64 = 1e-6;

const NO_SLOT: u32 = u32::MAX;

#[path = "tear_room.rs"]
mod tear_room;

/// Takes the inside of `body` out of `mesh`. `candidates` must hold every face whose bounds meet the body's; `position` gives
/// final positions of live vertices; `tags` (sorted by vertex) lists vertices that lie on planes of this body by
/// construction. Fills `out`; returns false, with the mesh untouched, if no face reaches inside.
///
/// With `walls` the hole is lined with walls and a floor (MATHS 5.7): a closed mesh stays closed. Their corners inside the volume
/// are new vertices with `parent_count` 0. A body that no face reaches into is left alone, even inside a solid.
#[allow(clippy::too_many_arguments)]
pub fn tear_step(
    mesh: &mut Mesh,
    body: &Body,
    walls: Option<&WallSpec>,
    candidates: &[FaceId],
    position: &impl Fn(VertexId) -> DVec3,
    tags: &[OnPlanes],
    scratch: &mut TearScratch,
    out: &mut TearStep,
) -> bool {
    out.clear();
    out.faces_visited = candidates.len();
    scratch.begin(mesh, walls);
    scratch.clip_candidates(mesh, body, walls, candidates, position, tags);
    if scratch.affected.is_empty() && scratch.removed.is_empty() {
        scratch.end();
        return false;
    }
    scratch.insert_on_edges(mesh, out);
    scratch.second_pass(mesh, body, position, tags);
    scratch.retriangulate(mesh, body, out);
    scratch.replace(mesh, body, walls, position, tags, out);
    if let Some(walls) = walls {
        scratch.line(mesh, body, walls, position, tags, out);
    }
    scratch.finish(mesh, out);
    scratch.end();
    true
}

impl TearScratch {
    fn begin(&mut self, mesh: &Mesh, walls: Option<&WallSpec>) {
        fit(&mut self.slot, mesh.vertex_slots(), NO_SLOT);
        self.slotted.clear();
        self.positions.clear();
        self.values.clear();
        self.valued.clear();
        self.affected.clear();
        self.points.clear();
        self.edge_points.clear();
        self.wedges.clear();
        self.removed.clear();
        self.added.clear();
        self.topology.ties.clear();
        self.zero.clear();
        self.is_closed = walls.is_some();
        self.grain = walls.map_or(0.0, |w| w.grain);
        if let Some(walls) = walls {
            self.lining.clear();
            self.removed.extend(walls.remove.iter().filter(|&&f| mesh.is_live(f)));
        }
    }

    fn end(&mut self) {
        for v in &self.slotted {
            self.slot[v.index()] = NO_SLOT;
        }
    }

    /// The vertex's slot with its position and values, made when first asked for.
    pub(super) fn slot(
        &mut self,
        mesh: &Mesh,
        v: VertexId,
        body: &Body,
        position: &impl Fn(VertexId) -> DVec3,
        tags: &[OnPlanes],
    ) -> usize {
        let slot = self.placed_slot(v, position);
        self.give_values(mesh, slot, body, position, tags);
        slot
    }

    /// The vertex's slot with its position; most corners of candidates need no more.
    fn placed_slot(&mut self, v: VertexId, position: &impl Fn(VertexId) -> DVec3) -> usize {
        let known = self.slot[v.index()];
        if known != NO_SLOT {
            return known as usize;
        }
        let slot = self.slotted.len();
        self.slot[v.index()] = slot as u32;
        self.slotted.push(v);
        self.positions.push(position(v));
        self.values.push([-1.0; MAX_PLANES]);
        self.valued.push(false);
        slot
    }

    /// Vertices of a wall that lies in a plane within the grain count as on it: where a blade goes through its slot again, walls
    /// would be cut into slivers of rounding.
    fn give_values(&mut self, mesh: &Mesh, slot: usize, body: &Body, position: &impl Fn(VertexId) -> DVec3, tags: &[OnPlanes]) {
        if std::mem::replace(&mut self.valued[slot], true) {
            return;
        }
        let (v, at) = (self.slotted[slot], self.positions[slot]);
        let tagged = tags.binary_search_by_key(&v, |t| t.vertex).map_or(0, |i| tags[i].planes);
        let is_wall = self.is_closed && mesh.fan(v).any(|h| mesh.is_interior(h.face()));
        for (k, plane) in body.planes.iter().enumerate() {
            let is_on = tagged >> k & 1 == 1
                || is_wall && plane.distance(at).abs() <= self.grain && wall_within(mesh, v, plane, self.grain, position);
            self.values[slot][k] = if is_on { 0.0 } else { plane.value(at) };
        }
    }

    /// Bits of the planes that the vertex of a slot with values lies on.
    pub(super) fn planes_through(&self, slot: usize, body: &Body) -> u16 {
        debug_assert!(self.valued[slot]);
        (0..body.planes.len()).filter(|&k| self.values[slot][k] == 0.0).fold(0, |m, k| m | 1 << k)
    }

    fn clip_candidates(
        &mut self,
        mesh: &Mesh,
        body: &Body,
        walls: Option<&WallSpec>,
        candidates: &[FaceId],
        position: &impl Fn(VertexId) -> DVec3,
        tags: &[OnPlanes],
    ) {
        let slack = CLEARLY * (body.max - body.min).length();
        let reach = body.min.abs().max(body.max.abs()).length();
        let level = |plane: &Plane| slack + plane.rounding(reach) - plane.distance(DVec3::ZERO);
        let beyond: SmallVec<[(DVec3, f64); MAX_PLANES]> =
            body.planes.iter().map(|plane| (plane.normal(), level(plane))).collect();
        let spared = |f: &FaceId| walls.is_some_and(|w| w.remove.binary_search(f).is_ok() || w.keep.binary_search(f).is_ok());
        for &face in candidates {
            let corners = mesh.corners(face, position);
            let (low, high) = (corners[0].min(corners[1]).min(corners[2]), corners[0].max(corners[1]).max(corners[2]));
            if low.cmpgt(body.max).any() || high.cmplt(body.min).any() {
                continue;
            }
            // most are beyond one plane by more than rounding: their exact values say no more
            if beyond.iter().any(|(n, level)| corners.iter().all(|p| n.dot(*p) > *level)) || spared(&face) {
                continue;
            }
            let slots = mesh.face(face).map(|v| self.placed_slot(v, position));
            slots.iter().for_each(|&s| self.give_values(mesh, s, body, position, tags));
            let values = slots.map(|s| &self.values[s]);
            if self.clipped.clip(&values, body.planes.len()) {
                let first = self.points.len();
                self.points.extend(self.clipped.points.iter().copied().zip(self.clipped.carriers.iter().copied()));
                self.affected.push(Affected { face, first, len: self.clipped.points.len() });
            }
        }
        // so that the result does not depend on the order of the candidates
        self.affected.sort_unstable_by_key(|a| a.face);
    }

    /// One vertex for each (edge, plane) crossing.
    fn insert_on_edges(&mut self, mesh: &mut Mesh, out: &mut TearStep) {
        for affected in &self.affected {
            let corners = mesh.face(affected.face);
            for &(point, _) in &self.points[affected.first..affected.first + affected.len] {
                let Point::Edge { edge, plane } = point else { continue };
                let (mut a, mut b) = (corners[edge as usize], corners[(edge as usize + 1) % 3]);
                if b < a {
                    std::mem::swap(&mut a, &mut b);
                }
                if self.edge_points.find(a, b, plane).is_some() {
                    continue;
                }
                let [slot_a, slot_b] = [a, b].map(|v| self.slot[v.index()] as usize);
                let [value_a, value_b] = [slot_a, slot_b].map(|s| self.values[s][plane as usize]);
                let vertex = mesh.add_vertex();
                self.edge_points.insert((a, value_a), (b, value_b), plane, vertex);
                let t = super::clip::edge_parameter(value_a, value_b);
                let ends = [(a, self.positions[slot_a]), (b, self.positions[slot_b])];
                out.new_vertices.push(NewVertex::on_edge(vertex, ends, t));
            }
        }
    }

    /// Faces across a split edge that the body itself does not reach are split too, so that no T-junction is left.
    fn second_pass(&mut self, mesh: &Mesh, body: &Body, position: &impl Fn(VertexId) -> DVec3, tags: &[OnPlanes]) {
        self.removed.extend(self.affected.iter().map(|a| a.face));
        self.removed.sort_unstable();
        for i in 0..self.affected.len() {
            for k in 0..3 {
                let h = HalfEdge::of(self.affected[i].face, k);
                let back = mesh.opposite(h);
                if back.is_none() || !self.edge_points.contains(mesh.from(h), mesh.to(h)) {
                    continue;
                }
                if let Err(at) = self.removed.binary_search(&back.face()) {
                    self.removed.insert(at, back.face());
                    self.affected.push(Affected { face: back.face(), first: 0, len: 0 });
                    for v in mesh.face(back.face()) {
                        self.slot(mesh, v, body, position, tags);
                    }
                }
            }
        }
    }

    fn retriangulate(&mut self, mesh: &mut Mesh, body: &Body, out: &mut TearStep) {
        for i in 0..self.affected.len() {
            let (face, info) = (self.affected[i].face, mesh.face_info(self.affected[i].face));
            self.build_region(mesh, body, i, out);
            self.region.triangulate();
            out.area_removed += self.area_taken();
            out.smallest_sine = out.smallest_sine.min(self.region.smallest_sine());
            self.emit_faces(info);
            if self.is_closed {
                self.tie_faces(mesh, face, i);
                // which face it will be is known when they are put in
                out.recut.extend(self.region.triangles.iter().map(|_| (face, FaceId::NONE)));
            }
            out.touched.extend(mesh.face(face));
        }
    }

    /// The face with the points on its edges, and the polygon to take out.
    fn build_region(&mut self, mesh: &mut Mesh, body: &Body, i: usize, out: &mut TearStep) {
        let Affected { face, first, len } = self.affected[i];
        let corners = mesh.face(face);
        let wedges = mesh.face_wedges(face);
        let slots = corners.map(|v| self.slot[v.index()] as usize);
        let frame = flatten(slots.map(|s| self.positions[s]));
        self.region.clear();
        self.locals.clear();
        let zeros = |values: &PlaneValues| (0..body.planes.len()).filter(|&k| values[k] == 0.0).fold(0u32, |m, k| m | 8 << k);
        for k in 0..3 {
            let lines = 1 << k | 1 << ((k + 2) % 3) | zeros(&self.values[slots[k]]);
            self.region.points.push(RegionPoint { at: frame[k], lines });
            self.locals.push((corners[k], wedges[k]));
        }
        for k in 0..3 {
            self.region.outer.push(k as u16);
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            self.edge_points.sorted(a, b, &mut self.on_edge);
            // an edge enters a convex body before it leaves it, also where both parameters round to one
            self.on_edge.sort_by_key(|p| p.entering != (a < b));
            if self.is_closed && mesh.opposite(HalfEdge::of(face, k)).is_none() {
                let stops = self.on_edge.iter().map(|p| p.vertex);
                let mut from = a;
                for to in stops.chain([b]) {
                    self.lining.note_border(from, to);
                    from = to;
                }
            }
            for j in 0..self.on_edge.len() {
                let p = self.on_edge[j];
                let t = if a < b { p.t } else { 1.0 - p.t };
                let at = std::array::from_fn(|d| frame[k][d] + (frame[(k + 1) % 3][d] - frame[k][d]) * t);
                let wedge = self.wedges.on_edge(mesh, p.vertex, wedges[k], wedges[(k + 1) % 3], t);
                self.region.outer.push(self.region.points.len() as u16);
                self.region.points.push(RegionPoint { at, lines: 1 << k | 8 << p.plane });
                self.locals.push((p.vertex, wedge));
            }
        }
        for j in first..first + len {
            let (point, carrier) = self.points[j];
            let local = self.local_of(mesh, face, point, &frame, slots, out);
            self.region.inner.push(local);
            self.region.inner_on_face.push(matches!(carrier, Carrier::Face(_)));
            self.note_planes(body, point, slots, local, out);
        }
    }

    /// The region's index of a polygon point; a point inside the face becomes a new vertex.
    fn local_of(
        &mut self,
        mesh: &mut Mesh,
        face: FaceId,
        point: Point,
        frame: &[[f64; 2]; 3],
        slots: [usize; 3],
        out: &mut TearStep,
    ) -> u16 {
        let corners = mesh.face(face);
        match point {
            Point::Corner(c) => u16::from(c),
            Point::Edge { edge, plane } => {
                let vertex = self.edge_points.find(corners[edge as usize], corners[(edge as usize + 1) % 3], plane);
                let found = self.locals.iter().position(|l| Some(l.0) == vertex);
                found.expect("a crossing was inserted for every edge point") as u16
            }
            Point::Inner { planes } => {
                let weights = point_weights(point, &slots.map(|s| &self.values[s]));
                let vertex = mesh.add_vertex();
                let at = (0..3).map(|k| self.positions[slots[k]] * weights[k]).sum();
                let parents = std::array::from_fn(|k| (corners[k], weights[k]));
                out.new_vertices.push(NewVertex { vertex, parents, parent_count: 3, position: at });
                let wedge = self.wedges.in_face(mesh, vertex, mesh.face_wedges(face), weights);
                self.locals.push((vertex, wedge));
                let flat = std::array::from_fn(|d| (0..3).map(|k| frame[k][d] * weights[k]).sum());
                self.region.points.push(RegionPoint { at: flat, lines: 8 << planes[0] | 8 << planes[1] });
                (self.region.points.len() - 1) as u16
            }
        }
    }

    /// Notes lips and points on the end joint, by exact signs.
    fn note_planes(&mut self, body: &Body, point: Point, slots: [usize; 3], local: u16, out: &mut TearStep) {
        let values = slots.map(|s| &self.values[s]);
        let planes = (0..body.planes.len()).filter(|&k| point_sign(point, &values, k) == 0).fold(0u16, |m, k| m | 1 << k);
        if planes == 0 {
            return;
        }
        self.region.points[local as usize].lines |= u32::from(planes) << 3;
        let vertex = self.locals[local as usize].0;
        if self.is_closed {
            self.lining.note_bits(vertex, planes);
        }
        let on = |side: Side| (0..body.planes.len()).any(|k| planes >> k & 1 == 1 && body.sides[k] == side);
        if on(Side::Minus) {
            out.lips.push(LipPoint { vertex, side: -1 });
        } else if on(Side::Plus) {
            out.lips.push(LipPoint { vertex, side: 1 });
        }
        if on(Side::End) {
            self.zero.push(OnPlanes { vertex, planes });
        }
    }

    /// Area of the part taken out of the current region, square metres: the frame is isometric.
    fn area_taken(&self) -> f64 {
        let polygon = &self.region.inner;
        let doubled: f64 = (0..polygon.len())
            .map(|i| {
                let [p, q] = [polygon[i], polygon[(i + 1) % polygon.len()]].map(|l| self.region.points[l as usize].at);
                p[0] * q[1] - p[1] * q[0]
            })
            .sum();
        doubled / 2.0
    }

    /// Lists the region's triangles as new faces.
    fn emit_faces(&mut self, info: FaceInfo) {
        self.added.extend(self.region.triangles.iter().map(|t| {
            let at = t.map(|l| self.locals[l as usize]);
            NewFace { corners: at.map(|l| l.0), wedges: at.map(|l| l.1), info, side: 0 }
        }));
    }

    /// Notes which edges of the old `face` the region's triangles lie on.
    fn tie_faces(&mut self, mesh: &Mesh, face: FaceId, region: usize) {
        let points = &self.region.points;
        self.topology.ties.extend(self.region.triangles.iter().map(|t| {
            std::array::from_fn(|k| {
                let shared = points[t[k] as usize].lines & points[t[(k + 1) % 3] as usize].lines & 7;
                let h = HalfEdge::of(face, shared.trailing_zeros() as usize % 3);
                let back = mesh.opposite(h);
                if shared == 0 { u32::MAX - region as u32 } else { h.0.min(if back.is_some() { back.0 } else { h.0 }) }
            })
        }));
    }

    fn replace(
        &mut self,
        mesh: &mut Mesh,
        body: &Body,
        walls: Option<&WallSpec>,
        position: &impl Fn(VertexId) -> DVec3,
        tags: &[OnPlanes],
        out: &mut TearStep,
    ) {
        out.intersection_points = out.new_vertices.len();
        if let Some(walls) = walls {
            self.lining.note_surroundings(mesh, &self.removed, walls);
            for i in 0..self.removed.len() {
                for v in mesh.face(self.removed[i]) {
                    self.slot(mesh, v, body, position, tags);
                    out.touched.push(v);
                }
            }
        }
        out.touched.sort_unstable();
        out.touched.dedup();
        self.incident.clear();
        for &v in &out.touched {
            self.incident.extend(mesh.fan(v).map(HalfEdge::face));
        }
        out.skin_cut = self.removed.iter().filter(|&&f| !mesh.is_interior(f)).count();
        mesh.replace_faces(&self.removed, &self.added, |_| 0, &mut self.topology);
        out.faces_removed = self.removed.len();
        out.added_faces.extend_from_slice(&self.topology.added);
        self.incident.extend_from_slice(&out.added_faces);
        // most are around several of the vertices
        self.incident.sort_unstable();
        self.incident.dedup();
        if self.is_closed {
            self.lining.collect_rim(mesh, &out.added_faces);
            out.recut.iter_mut().zip(&out.added_faces).for_each(|(recut, &to)| recut.1 = to);
            out.recut.retain(|recut| mesh.is_interior(recut.1));
        }
        self.split.clear();
        self.vertices.clear();
        self.vertices.extend(out.touched.iter().copied().chain(out.new_vertices.iter().map(|n| n.vertex)));
        mesh.split_fans(&self.vertices, &self.incident, &mut self.topology, &mut self.split);
        for i in 0..self.split.len() {
            self.note_split(self.split[i], out);
        }
    }

    fn finish(&mut self, mesh: &Mesh, out: &mut TearStep) {
        out.lips.sort_unstable_by_key(|l| (l.vertex, l.side));
        out.lips.dedup();
        out.lips.retain(|l| mesh.vertex_is_live(l.vertex));
        self.zero.sort_unstable_by_key(|z| (z.vertex, z.planes));
        self.zero.dedup();
        out.on_end.extend(self.zero.iter().filter(|z| mesh.vertex_is_live(z.vertex)));
    }

    /// A copy made by a fan split lies where its original lies.
    pub(super) fn note_split(&mut self, split: SplitVertex, out: &mut TearStep) {
        let old = out.new_vertices.iter().find(|n| n.vertex == split.from).map(|n| n.position);
        let position = old.unwrap_or_else(|| self.positions[self.slot[split.from.index()] as usize]);
        out.new_vertices.push(NewVertex::copy_of(split, position));
        copy_marks(&mut out.lips, split, |lip| &mut lip.vertex);
        copy_marks(&mut self.zero, split, |zero| &mut zero.vertex);
    }
}

/// True if a wall at `v`, and no mere sliver of one, lies in `plane` within the grain.
fn wall_within(mesh: &Mesh, v: VertexId, plane: &Plane, grain: f64, position: &impl Fn(VertexId) -> DVec3) -> bool {
    mesh.fan(v).filter(|h| mesh.is_interior(h.face())).any(|h| {
        let [p, q, r] = mesh.face(h.face()).map(position);
        let longest = p.distance(q).max(q.distance(r)).max(r.distance(p));
        let height = (q - p).cross(r - p).length() / longest;
        height > 100.0 * grain && [p, q, r].iter().all(|&c| plane.distance(c).abs() <= grain)
    })
}

/// The face laid flat, isometrically: first corner at the origin, first edge along x.
pub(super) fn flatten([a, b, c]: [DVec3; 3]) -> [[f64; 2]; 3] {
    let (ab, ac) = (b - a, c - a);
    let length = ab.length();
    if length == 0.0 {
        return [[0.0; 2], [0.0; 2], [0.0, ac.length()]];
    }
    [[0.0; 2], [length, 0.0], [ac.dot(ab) / length, ab.cross(ac).length() / length]]
}
