//! The tear of width 0: strips of the blade's surface instead of boxes; the surface is opened along them and nothing is
//! taken out.
//!
//! Strips that follow one another share a blade line, and the slit has to run through it: its ends on that line are tagged
//! and the next strip starts at exactly those vertices. Where the tissue has moved in between they no longer lie on the
//! line; an end that the next strip misses is joined to the nearest start of it by a leaf between the two, out of the skin.

use super::strip_ends::{StripStart, way_between};
use super::wound_line::WoundLine;
use super::{Cut, ENDS_KEPT, SegmentReport, Swath, TearStroke};
use crate::geometry::{FaceId, VertexId};
use crate::surgery::leaf::{Leaf, line};
use crate::surgery::slit::{OnLines, SlitScratch, SlitStep, slit_step};
use crate::surgery::{JointId, Slit};
use crate::tissue::Tissue;
use glam::DVec3;

/// A strip goes on from another if its first blade lies on the other's last to this fraction of the diagonal.
const SAME_LINE: f64 = 1e-9;
/// A vertex this near to a strip is cut through, as a fraction of the diagonal: a few steps of the grid of the blades.
const ON_PLANE: f64 = 1e-11;

/// The same where the tissue has stirred since the strip before ended, by no more than that: its own wound, opening, moves it by so much.
/// Beside an edge there is no telling on which side of it the blade is, and a cut there leaves slivers that fold over as the wound opens
/// on: the next strip met those in several sheets, and bands of skin were left across the slit.
const STIRRED: f64 = 3e-4;

/// In fine skin no more than this share of a mean edge counts as [`STIRRED`]: a strip is not to run through all there is.
const STIRRED_EDGES: f64 = 0.02;

/// An end of a strip that is farther from its last blade, as a fraction of the diagonal, is none: a strip may run through a vertex that is
/// [`STIRRED`] off it, and then many roundings of a position.
const OFF_LINE: f64 = STIRRED + 1e-5;

/// Ends that have come further apart over the skin, as a fraction of the diagonal, are left apart: tissue that jumps is not cut along its way.
const MOST_JOINED: f64 = 0.02;

/// Ends of a strip off its first blade are joined to only within this share of that.
const BESIDE: f64 = 0.1;

/// Where a strip ended.
struct Ended {
    /// The strip's last joint.
    joint: JointId,
    /// Tip and top of the blade, as seen and at rest.
    blade: [DVec3; 2],
    at_rest: [DVec3; 2],
    /// Its number among the tissue's strips, if it met anything.
    strip: Option<usize>,
    /// The line of the wound on which it did.
    line: Option<WoundLine>,
    /// Ends of the slit on that line.
    vertices: Vec<VertexId>,
}

impl Ended {
    /// True if the tissue has carried the blade that `slit` begins at since, by no more than [`STIRRED`].
    fn has_stirred(&self, slit: &Slit, diagonal: f64) -> bool {
        let way = way_between([self.blade, [slit.corners[0], slit.corners[3]]]);
        way > 0.0 && way <= STIRRED * diagonal
    }
}

/// Strips of a stroke that there is room for at first.
const COMMITTED: usize = 256;

/// What a stroke of width 0 keeps between its strips.
#[derive(Default)]
pub(super) struct SlitState {
    scratch: SlitScratch,
    step: SlitStep,
    ended: Vec<Ended>,
    committed: Vec<Slit>,
    /// Scratch: tags of the starts, those still on the line, and starts that were missed with those of the strip that are free and its
    /// other ends.
    starts: Vec<OnLines>,
    on_line: Vec<OnLines>,
    missed: Vec<VertexId>,
    free: Vec<VertexId>,
    others: Vec<VertexId>,
    /// Room for where strips to come end.
    spare_ends: Vec<Vec<VertexId>>,
}

impl SlitState {
    /// Makes room for strips that touch so many vertices.
    pub(super) fn make_room(&mut self, vertices: usize) {
        self.scratch.make_room(vertices);
        self.step.make_room(vertices);
        self.ended.reserve(ENDS_KEPT);
        self.committed.reserve(COMMITTED);
        for list in [&mut self.starts, &mut self.on_line] {
            list.reserve(vertices);
        }
        self.missed.reserve(vertices);
        self.free.reserve(vertices);
        self.others.reserve(vertices);
        self.spare_ends.resize_with(ENDS_KEPT + 1, || Vec::with_capacity(vertices / 4));
    }

    /// Makes room for meshes of so many vertices.
    pub(super) fn make_room_for_mesh(&mut self, vertices: usize) {
        self.scratch.make_room_for_mesh(vertices);
    }

    fn forget_ends(&mut self) {
        self.spare_ends.extend(self.ended.drain(..).map(|end| end.vertices));
    }

    pub(super) fn committed(&self) -> &[Slit] {
        &self.committed
    }

    pub(super) fn release(&mut self) {
        self.forget_ends();
    }

    /// Another stroke.
    pub(super) fn begin(&mut self) {
        self.forget_ends();
        self.committed.clear();
    }

    /// Ends of the slit that `slit` goes on from, and the strip that it follows.
    fn starts(&self, slit: &Slit, diagonal: f64, tags: &mut Vec<OnLines>) -> Option<&Ended> {
        let blade = [slit.corners[0], slit.corners[3]];
        // a chain that crosses itself goes on from the same joint under another number
        let follows = |e: &&Ended| e.joint == slit.joints[0];
        let same = |e: &&Ended| blade.iter().all(|&p| distance_to_line(p, e.blade) <= SAME_LINE * diagonal);
        let from = self.ended.iter().filter(|e| follows(e) || same(e));
        tags.clear();
        tags.extend(from.flat_map(|e| &e.vertices).map(|&vertex| OnLines { vertex, lines: line::START }));
        tags.sort_unstable_by_key(|t| t.vertex);
        tags.dedup();
        self.ended.iter().rev().find(follows)
    }

    /// The end of the last slit, nearest to the handle, if that ends in this blade (tip, top).
    pub(super) fn end_on(&self, tissue: &Tissue, blade: [DVec3; 2]) -> Option<VertexId> {
        let slack = SAME_LINE * tissue.diagonal();
        let ended = self.ended.iter().rev().find(|e| (0..2).all(|k| e.blade[k].distance(blade[k]) <= slack))?;
        let live = ended.vertices.iter().copied().filter(|&v| tissue.mesh.vertex_is_live(v));
        let below = live.map(|v| ((tissue.position(v) - blade[1]).dot(blade[0] - blade[1]), v));
        below.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))).map(|(_, v)| v)
    }

    /// `strays` says of a vertex and of the strip's last blade whether they are apart.
    fn end(
        &mut self,
        slit: &Slit,
        (at_rest, line): ([DVec3; 2], Option<WoundLine>),
        strip: Option<usize>,
        strays: impl Fn(VertexId, [DVec3; 2]) -> bool,
    ) {
        if self.ended.len() == ENDS_KEPT {
            self.spare_ends.push(self.ended.remove(0).vertices);
        }
        let mut vertices = self.spare_ends.pop().unwrap_or_default();
        vertices.clear();
        let tags = self.step.tags.iter().filter(|t| t.lines & line::END != 0);
        let (joint, blade) = (slit.joints[1], [slit.corners[1], slit.corners[2]]);
        // Where tissue has moved, starts by tag are not where the blade is, and what is cut beside them may seem to end there as well:
        // as starts of the next strip those would part it anew, and again.
        vertices.extend(tags.map(|t| t.vertex).filter(|&v| !strays(v, blade)));
        self.ended.push(Ended { joint, blade, at_rest, strip, line, vertices });
        self.committed.push(slit.clone());
    }
}

pub(in crate::tissue) fn distance_to_line(p: DVec3, [a, b]: [DVec3; 2]) -> f64 {
    (p - a).reject_from_normalized((b - a).normalize_or(DVec3::X)).length()
}

impl TearStroke {
    /// A chain of boxes or strips that goes on from no other is a slit of its own, unless it runs beside one that it does not turn back
    /// on (`turns_back`).
    pub(super) fn begin_slit(&mut self, tissue: &Tissue, turns_back: bool) {
        self.nicked.clear();
        let next = tissue.layer.as_ref().map_or(0, |l| l.strips.next_slit());
        if turns_back || self.stroke.builder().is_alone() {
            self.slit = self.slit.max(next);
        }
    }

    pub(super) fn tear_slit(&mut self, tissue: &mut Tissue, slit: &Slit) {
        let mut report = SegmentReport::default();
        let mut starts = std::mem::take(&mut self.slits.starts);
        let before = self.slits.starts(slit, tissue.diagonal(), &mut starts);
        let has_stirred = before.is_some_and(|e| e.has_stirred(slit, tissue.diagonal()));
        let mut line = before.and_then(|e| e.line);
        let (joint, before) = (before.map(|e| e.at_rest), before.and_then(|e| e.strip));
        if joint.is_none() {
            self.begin_slit(tissue, false);
        }
        let mut leaves = Leaf::of_slit(slit, ON_PLANE * tissue.diagonal());
        let c = slit.corners;
        let near = tissue.diagonal() * if has_stirred { STIRRED } else { 1e-9 };
        let margin = DVec3::splat(near);
        let (low, high) = (c.into_iter().fold(c[0], DVec3::min) - margin, c.into_iter().fold(c[0], DVec3::max) + margin);
        let hit = report.stages.time("perform_tear", || {
            tissue.faces_near(low, high, &mut self.candidates);
            self.candidates.sort_unstable();
            if has_stirred {
                let near = near.min(STIRRED_EDGES * mean_edge(tissue, &self.candidates));
                leaves.iter_mut().for_each(|leaf| leaf.tolerate(near));
            }
            let SlitState { scratch, step, on_line, .. } = &mut self.slits;
            // where the tissue has moved, a tag would stand against everything around its vertex
            on_line.clear();
            let far = OFF_LINE * tissue.diagonal();
            on_line.extend(starts.iter().filter(|t| distance_to_line(tissue.position(t.vertex), [c[0], c[3]]) <= far));
            let (mesh, posed) = tissue.split_borrow();
            let hit = slit_step(mesh, &leaves, &self.candidates, &|v| posed.position(v), on_line, scratch, step);
            if hit {
                self.join_ends(tissue, slit, &starts);
            }
            hit
        });
        let step = std::mem::take(&mut self.slits.step);
        report.faces_visited = step.faces_visited;
        let mut strip = None;
        let blades = [[c[0], c[3]], [c[1], c[2]]];
        let end;
        if hit {
            report.new_vertices = step.new_vertices.len();
            report.intersection_points = step.intersection_points;
            report.opened_edges = step.opened_edges;
            report.smallest_angle = step.smallest_sine.min(1.0).asin();
            report.stages.time("bind", || tissue.add_vertices(&step.new_vertices));
            // vertices at the joint have sides only now
            let has_joint = step.tags.iter().any(|t| t.lines & line::START != 0);
            let parts;
            (parts, end) = self.slit_swath(tissue, &step).strip_parts(
                blades,
                joint.map_or(StripStart::Free, |edge| StripStart::Edge(edge, has_joint)),
                self.slit,
            );
            let newest = || tissue.layer.as_ref().and_then(|l| l.strips.len().checked_sub(1));
            let mut cut = Cut {
                goes_on_from: if has_joint { before.or_else(newest) } else { None },
                goes_on_along: line,
                shares_edge: joint.is_some() && has_joint,
                ..slit_cut(tissue, &step)
            };
            (strip, line) = self.bind_strips(tissue, &mut cut, (&parts, blades), &mut report);
            tissue.versions.structure += 1;
            self.close_notes(tissue, &mut report);
        } else {
            end = self.slit_swath(tissue, &step).rest_edge(blades[1]);
        }
        (self.slits.starts, self.slits.step) = (starts, step);
        let far = OFF_LINE * tissue.diagonal();
        self.slits.end(slit, (end, line), strip, |v, blade| distance_to_line(tissue.position(v), blade) > far);
        self.reports.push(report);
    }

    /// What a strip has cut; nothing if it has met nothing. What it has made lies in it, and would at rest as well: on neither side.
    fn slit_swath<'a>(&'a self, tissue: &'a Tissue, step: &'a SlitStep) -> Swath<'a, impl Fn(VertexId) -> DVec3> {
        let elsewhere = |v| self.positions.of(tissue, v);
        let made = step.new_vertices.as_slice();
        let old = made.first().map_or(step.touched.len(), |n| step.touched.partition_point(|v| *v < n.vertex));
        Swath { tissue, made, near: &step.touched[..old], candidates: &self.candidates, half_width: 0.0, elsewhere }
    }

    /// Joins ends of the slit that the strip has missed to its own nearest starts, over the skin, if those are near; where there are
    /// none, to other ends of the strip beside them. Starts that are left over are those of a fold that the strip began in: the skin
    /// between them lies behind the blade, and they are joined to each other.
    fn join_ends(&mut self, tissue: &mut Tissue, slit: &Slit, starts: &[OnLines]) {
        let SlitState { scratch, step, missed, free, others, .. } = &mut self.slits;
        missed.clear();
        missed.extend(starts.iter().map(|t| t.vertex).filter(|v| !step.met.contains(v)));
        if missed.is_empty() {
            return;
        }
        let is_on = |v: VertexId, line: u8| step.tags.contains(&OnLines { vertex: v, lines: line });
        step.ends(others);
        others.retain(|&v| !is_on(v, line::END) && !starts.iter().any(|t| t.vertex == v));
        free.clear();
        free.extend(others.extract_if(.., |v| is_on(*v, line::START)));
        let up = slit.corners[3] - slit.corners[0];
        let most = up.length().min(MOST_JOINED * tissue.diagonal());
        let (mesh, posed) = tissue.split_borrow();
        let position = |v: VertexId| posed.position(v);
        for &from in &*missed {
            // a start whose cut ran into the slit before goes on from it as it is
            if free.iter().any(|&v| step.is_one_cut(mesh, v, from) || step.is_one_cut(mesh, from, v)) {
                continue;
            }
            let joined = scratch
                .join(mesh, (from, free), (most, up), &position, step)
                .or_else(|| scratch.join(mesh, (from, others), (BESIDE * most, up), &position, step));
            for list in [&mut *free, &mut *others] {
                list.retain(|&v| Some(v) != joined);
            }
        }
        while let Some(from) = free.pop() {
            // what both ends of one cut were joined around would fall out
            others.clear();
            others.extend(free.iter().filter(|&&v| !step.is_one_cut(mesh, from, v)));
            let joined = scratch.join(mesh, (from, others), (most, up), &position, step);
            free.retain(|&v| Some(v) != joined);
        }
    }
}

/// What a slit has opened, as its strips are bound.
pub(in crate::tissue) fn slit_cut<'a>(tissue: &Tissue, step: &'a SlitStep) -> Cut<'a> {
    let reach = tissue.layer.as_ref().map_or(0.0, |layer| layer.settings.radius);
    Cut { lips: &step.lips, made: &step.new_vertices, closed: &step.closed, reach, ..Cut::default() }
}

/// Mean length of the edges of `faces` at rest, metres; 0 without faces.
pub(in crate::tissue) fn mean_edge(tissue: &Tissue, faces: &[FaceId]) -> f64 {
    let length = |[a, b, c]: [DVec3; 3]| a.distance(b) + b.distance(c) + c.distance(a);
    let sum: f64 = faces.iter().map(|&f| length(tissue.mesh.face(f).map(|v| tissue.rest[v.index()]))).sum();
    sum / (3.0 * faces.len().max(1) as f64)
}
