//! Joins two ends of a slit along a way over the surface. Where tissue has moved between two strips, the end of one lies off the
//! other's plane, or over a fold: no plane leads from end to end, but the faces between them do.

use super::{Affected, NO_SLOT, Places, SlitScratch, SlitStep};
use crate::geometry::measure::vertex_normal;
use crate::geometry::{FaceId, HalfEdge, Mesh, VertexId};
use crate::surgery::insert::NewVertex;
use crate::surgery::leaf::{At, Leaf};
use glam::DVec3;

/// A way keeps off the ends of the edges that it crosses by this fraction of them.
const CLEAR: f64 = 0.02;
/// Faces that a way is looked for in.
const MOST_FACES: usize = 128;
/// How often the points of a way are drawn straight between their neighbours.
const SWEEPS: usize = 8;

/// An edge that a way may cross.
struct Crossing {
    /// The edge, in the face that the way comes from.
    over: HalfEdge,
    at: DVec3,
    /// Of the way up to there.
    length: f64,
    /// The crossing before, if there is one.
    before: Option<usize>,
    is_done: bool,
}

/// Ways that are looked for, and the one that was found.
#[derive(Default)]
pub(super) struct Ways {
    crossings: Vec<Crossing>,
    seen: Vec<FaceId>,
    /// Edges crossed, in order, and where: from the edge's start.
    way: Vec<(HalfEdge, f64)>,
}

impl Ways {
    pub(super) fn make_room(&mut self) {
        self.crossings.reserve(2 * MOST_FACES + 8);
        self.seen.reserve(MOST_FACES + 8);
        self.way.reserve(MOST_FACES);
    }

    /// Looks for the shortest way from a vertex to one of `goals`, `most` metres at most: the goal, with the way in `self.way`. None if
    /// there is no way, or if one of them is the next along the border.
    fn find(
        &mut self,
        mesh: &Mesh,
        from: VertexId,
        goals: &[VertexId],
        most: f64,
        place: &impl Fn(VertexId) -> DVec3,
    ) -> Option<VertexId> {
        self.crossings.clear();
        self.seen.clear();
        let start = place(from);
        // length, goal, last crossing
        let mut best: Option<(f64, VertexId, Option<usize>)> = None;
        let mut offer = |length: f64, goal: VertexId, last: Option<usize>| {
            if length <= most && best.is_none_or(|b| length < b.0) {
                best = Some((length, goal, last));
            }
            best.map_or(most, |b| b.0)
        };
        let mut bound = most;
        for h in mesh.fan(from) {
            self.seen.push(h.face());
            for (v, is_border) in
                [(mesh.to(h), mesh.opposite(h).is_none()), (mesh.from(h.prev()), mesh.opposite(h.prev()).is_none())]
            {
                if goals.contains(&v) {
                    if is_border {
                        return None;
                    }
                    bound = offer(place(v).distance(start), v, None);
                }
            }
            self.cross(mesh, h.next(), (start, 0.0, None), place);
        }
        while self.seen.len() < MOST_FACES {
            let open = (0..self.crossings.len()).filter(|&i| !self.crossings[i].is_done);
            let nearest = open.min_by(|&i, &j| self.crossings[i].length.total_cmp(&self.crossings[j].length));
            let Some(i) = nearest.filter(|&i| self.crossings[i].length < bound) else { break };
            self.crossings[i].is_done = true;
            let Crossing { over, at, length, .. } = self.crossings[i];
            let back = mesh.opposite(over);
            if self.seen.contains(&back.face()) {
                continue;
            }
            self.seen.push(back.face());
            let across = mesh.from(back.prev());
            if goals.contains(&across) {
                bound = offer(length + at.distance(place(across)), across, Some(i));
            }
            for edge in [back.next(), back.prev()] {
                self.cross(mesh, edge, (at, length, Some(i)), place);
            }
        }
        let (_, goal, mut last) = best?;
        self.way.clear();
        while let Some(i) = last {
            let Crossing { over, at, before, .. } = self.crossings[i];
            let [a, b] = [place(mesh.from(over)), place(mesh.to(over))];
            self.way.push((over, parameter(at, [a, b])));
            last = before;
        }
        self.way.reverse();
        self.straighten(mesh, [start, place(goal)], place);
        Some(goal)
    }

    /// Notes that a way may leave its face over an edge, where that is nearest to the crossing before.
    fn cross(
        &mut self,
        mesh: &Mesh,
        over: HalfEdge,
        (from, length, before): (DVec3, f64, Option<usize>),
        place: &impl Fn(VertexId) -> DVec3,
    ) {
        let back = mesh.opposite(over);
        if back.is_some() && !self.seen.contains(&back.face()) {
            let edge = [place(mesh.from(over)), place(mesh.to(over))];
            let at = edge[0].lerp(edge[1], parameter(from, edge));
            self.crossings.push(Crossing { over, at, length: length + from.distance(at), before, is_done: false });
        }
    }

    /// Moves each crossing of the way to where its edge is nearest to the line between the points before and after it.
    fn straighten(&mut self, mesh: &Mesh, [start, goal]: [DVec3; 2], place: &impl Fn(VertexId) -> DVec3) {
        let ends = |h: HalfEdge| [place(mesh.from(h)), place(mesh.to(h))];
        let at = |(h, t): (HalfEdge, f64)| ends(h)[0].lerp(ends(h)[1], t);
        for _ in 0..if self.way.len() > 1 { SWEEPS } else { 1 } {
            for i in 0..self.way.len() {
                let before = if i == 0 { start } else { at(self.way[i - 1]) };
                let after = self.way.get(i + 1).map_or(goal, |&next| at(next));
                let edge = ends(self.way[i].0);
                self.way[i].1 = parameter(nearest_on(before, after, edge), edge);
            }
        }
    }
}

/// Where an edge is nearest to a point, kept off its ends.
fn parameter(p: DVec3, [a, b]: [DVec3; 2]) -> f64 {
    let t = (p - a).dot(b - a) / (b - a).length_squared();
    if t.is_finite() { t.clamp(CLEAR, 1.0 - CLEAR) } else { 0.5 }
}

/// The point of the segment from `p` to `q` that is nearest to the line through an edge.
fn nearest_on(p: DVec3, q: DVec3, [a, b]: [DVec3; 2]) -> DVec3 {
    let along = (b - a).normalize_or_zero();
    let [p_off, way] = [p - a, q - p].map(|v| v.reject_from(along));
    let s = -p_off.dot(way) / way.length_squared();
    p.lerp(q, if along != DVec3::ZERO && s.is_finite() { s.clamp(0.0, 1.0) } else { 0.5 })
}

impl SlitScratch {
    /// Opens the surface along the shortest way from `from`, an end of the slit that the step goes on from, to one of `goals`, ends of
    /// what the step has opened: that one, or none if there is no way of `most` metres or less. `up` is along the blade, towards the
    /// handle: it tells the sides where a goal has no lips yet.
    pub fn join(
        &mut self,
        mesh: &mut Mesh,
        (from, goals): (VertexId, &[VertexId]),
        (most, up): (f64, DVec3),
        position: &impl Fn(VertexId) -> DVec3,
        out: &mut SlitStep,
    ) -> Option<VertexId> {
        let places = Places { position, first_new: out.first_new };
        let place = |v: VertexId| places.of(v, &out.new_vertices);
        let goal = self.ways.find(mesh, from, goals, most, &place)?;
        let is_forward = goes_forward(mesh, goal, out).unwrap_or_else(|| vertex_normal(mesh, goal, place).dot(up) < 0.0);
        self.begin(mesh, 1);
        for v in [from, goal] {
            self.slot_with(v, 0.0, places.of(v, &out.new_vertices));
        }
        self.insert_on_way(mesh, &places, out);
        self.affect_way(mesh, from, goal, is_forward);
        if self.affected.is_empty() {
            self.cuts.push(if is_forward { [from, goal] } else { [goal, from] });
        } else {
            self.retriangulate(mesh, &Leaf::unbounded(), out);
            self.replace(mesh, out);
        }
        self.open(mesh, out);
        self.free_slots();
        out.sort_touched();
        Some(goal)
    }

    fn slot_with(&mut self, v: VertexId, value: f64, at: DVec3) {
        if self.slot[v.index()] == NO_SLOT {
            self.new_slot(v, at);
            self.values.push(value);
        }
    }

    /// A vertex on each edge that the way crosses.
    fn insert_on_way<P: Fn(VertexId) -> DVec3>(&mut self, mesh: &mut Mesh, places: &Places<'_, P>, out: &mut SlitStep) {
        for i in 0..self.ways.way.len() {
            let (over, t) = self.ways.way[i];
            for face in [over.face(), mesh.opposite(over).face()] {
                for v in mesh.face(face) {
                    self.slot_with(v, 1.0, places.of(v, &out.new_vertices));
                }
            }
            let (mut a, mut b, mut t) = (mesh.from(over), mesh.to(over), t);
            if b < a {
                (a, b, t) = (b, a, 1.0 - t);
            }
            let vertex = mesh.add_vertex();
            self.edge_points.insert((a, t), (b, t - 1.0), 0, vertex);
            let ends = [a, b].map(|v| (v, places.of(v, &out.new_vertices)));
            out.new_vertices.push(NewVertex::on_edge(vertex, ends, t));
        }
    }

    /// The faces of the way, each with its part of it.
    fn affect_way(&mut self, mesh: &Mesh, from: VertexId, goal: VertexId, is_forward: bool) {
        let way = &self.ways.way;
        let corner = |face: FaceId, v: VertexId| mesh.face(face).iter().position(|&w| w == v).map(|k| At::Corner(k as u8));
        let edge = |h: HalfEdge| At::Edge { edge: h.corner() as u8, plane: 0 };
        for i in 0..if way.is_empty() { 0 } else { way.len() + 1 } {
            let face = way.get(i).map_or_else(|| mesh.opposite(way[i - 1].0).face(), |w| w.0.face());
            let enters = if i == 0 { corner(face, from) } else { Some(edge(mesh.opposite(way[i - 1].0))) };
            let leaves = way.get(i).map_or_else(|| corner(face, goal), |w| Some(edge(w.0)));
            let (Some(a), Some(b)) = (enters, leaves) else { continue };
            self.affected.push(Affected { face, cut: Some(if is_forward { [a, b] } else { [b, a] }) });
        }
        self.removed.extend(self.affected.iter().map(|a| a.face));
        self.removed.sort_unstable();
    }
}

/// Whether the slit that begins at `goal` has its positive side on the left; none if it has no lips there.
fn goes_forward(mesh: &Mesh, goal: VertexId, out: &SlitStep) -> Option<bool> {
    let side = |v: VertexId| out.lips.iter().find(|l| l.vertex == v).map(|l| l.side);
    let leaving = mesh.border_from(goal).and_then(|h| side(mesh.to(h)));
    let coming = || mesh.fan(goal).map(HalfEdge::prev).find(|&h| mesh.opposite(h).is_none()).and_then(|h| side(mesh.from(h)));
    leaving.map(|s| s < 0).or_else(|| coming().map(|s| s > 0))
}
