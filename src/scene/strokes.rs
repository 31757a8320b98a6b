//! Strokes of the scalpel: a tear through every tissue that the blade meets, one unit of history each.

use super::changes::Changes;
use super::report::{EditReport, Outcome};
use super::{Scene, TissueId};
use crate::geometry::room::rows_headroom;
use crate::geometry::{Distinct, FaceId, Part, PartsBefore, VertexId};
use crate::surgery::{BladePose, Sampling};
use crate::tissue::stroke::TearStroke;
use crate::tissue::{Tissue, TissueDelta};
use glam::DVec3;

/// A tissue before a stroke: for its report, and to tell new components from old ones.
#[derive(Default)]
pub(super) struct Before {
    pub(super) area: f64,
    pub(super) volume: f64,
    parts: PartsBefore,
    /// Scratch: the largest part of each component there was, by the component.
    largest: Vec<(u32, usize)>,
    keep: Vec<usize>,
    crumbs: Vec<FaceId>,
}

/// Tissues that a stroke may go through before it has to find room for one more.
const SPARE_STROKES: usize = 4;

/// A stroke in progress through one tissue, with what it has changed so far.
pub(super) struct StrokeOf {
    id: TissueId,
    stroke: TearStroke,
    before: Before,
    /// The way back over all of it.
    undo: TissueDelta,
    /// Scratch: what has changed besides the boxes.
    rest: TissueDelta,
    /// Bytes that a mirror had to follow.
    bytes: usize,
    distinct: Distinct,
}

/// Components of a model that there is room for at first.
const PARTS: usize = 64;

impl StrokeOf {
    fn new(id: TissueId, before: Before, stroke: TearStroke) -> Self {
        let [undo, rest] = Default::default();
        Self { id, stroke, before, undo, rest, bytes: 0, distinct: Distinct::default() }
    }

    /// Some that are over before they begin, for their buffers: the first strokes find room as the later ones do. The last, which is
    /// taken first, has room for all of `tissue`.
    pub(super) fn spares(id: TissueId, tissue: &mut Tissue, sampling: Sampling) -> Vec<Self> {
        let mut before = Before::default();
        tissue.make_room_for_parts(&mut before.parts);
        before.largest.reserve(PARTS);
        before.keep.reserve(PARTS);
        before.crumbs.reserve(PARTS);
        let numbers = rows_headroom(16 * tissue.mesh().vertex_slots());
        let spare = |stroke| {
            let [undo, rest] = [4, 1].map(TissueDelta::with_room);
            Self { undo, rest, distinct: Distinct::with_room(numbers), ..Self::new(id, Before::default(), stroke) }
        };
        let stroke = || TearStroke::with_room(tissue, sampling);
        let first = stroke().prepare_for(tissue);
        let mut spares: Vec<Self> = (1..SPARE_STROKES).map(|_| stroke()).chain([first]).map(spare).collect();
        spares.last_mut().expect("there is one").before = before;
        spares
    }

    /// Notes what has changed since the last call, and tells those who keep a mirror.
    fn note_changes(&mut self, tissue: &mut Tissue, changes: &mut Changes, measuring: bool) {
        let Self { id, stroke, undo, rest, bytes, distinct, .. } = self;
        tissue.take_delta_into(rest);
        let mut note = |delta: &mut TissueDelta| {
            undo.append(delta);
            changes.take_over(*id, delta);
        };
        *bytes += stroke.drain_deltas(&mut note);
        if !rest.is_empty() {
            *bytes += if measuring { rest.upload_bytes(distinct) } else { 0 };
            note(rest);
        }
    }
}

impl Scene {
    pub(super) fn begin_stroke(&mut self, width: f64) {
        if !self.strokes.is_empty() {
            return;
        }
        self.last_boxes.clear();
        self.last_slits.clear();
        for (&id, tissue) in &mut self.tissues {
            let sampling = self.settings.sampling(tissue);
            let mut stroke = match self.spare_strokes.pop() {
                Some(spare) => StrokeOf { id, stroke: spare.stroke.again(tissue, width, sampling), bytes: 0, ..spare },
                None => StrokeOf::new(id, Before::default(), TearStroke::new(tissue, width, sampling)),
            };
            stroke.before.renew(tissue, self.measuring);
            stroke.stroke.set_wall(self.wall);
            stroke.stroke.set_counting(self.measuring);
            tissue.take_delta_into(&mut stroke.undo);
            debug_assert!(stroke.undo.is_empty(), "an edit has left notes");
            self.strokes.push(stroke);
        }
    }

    pub(super) fn stroke_pose(&mut self, pose: BladePose) {
        for stroke in &mut self.strokes {
            if let Some(tissue) = self.tissues.get_mut(&stroke.id) {
                let (tip, base) = (tissue.to_tissue(pose.tip), tissue.to_tissue(pose.base));
                stroke.stroke.push(tissue, BladePose { tip, base, ..pose });
                stroke.note_changes(tissue, &mut self.changes, self.measuring);
            }
        }
    }

    /// Where the vertices stand of what a stroke is in progress through.
    pub(super) fn stands_in_stroke(&self) -> Vec<(TissueId, Vec<(VertexId, DVec3)>)> {
        let tissues = self.strokes.iter().filter_map(|s| Some((s.id, self.tissues.get(&s.id)?)));
        tissues.map(|(id, tissue)| (id, tissue.stands())).collect()
    }

    pub(super) fn end_stroke(&mut self) -> Option<EditReport> {
        if self.strokes.is_empty() {
            return None;
        }
        let mut report = self.spare_reports.pop().unwrap_or_default().again("tear");
        let mut unit = self.history.unit();
        let mut strokes = std::mem::take(&mut self.strokes);
        for ended in &mut strokes {
            let Some(tissue) = self.tissues.get_mut(&ended.id) else { continue };
            ended.stroke.release(tissue);
            ended.note_changes(tissue, &mut self.changes, self.measuring);
            let StrokeOf { id, ref stroke, ref mut before, .. } = *ended;
            report.area_before += before.area;
            report.volume_before += before.volume;
            add_segments(&mut report, stroke);
            self.last_boxes.extend(stroke.boxes().iter().map(|b| b.carried(|p| tissue.to_model(p))));
            self.last_slits.extend(stroke.slits().iter().map(|s| s.carried(|p| tissue.to_model(p))));
            if !stroke.has_torn() {
                continue;
            }
            let (severed, crumbs) = report.stages.time("components", || before.new_components(tissue, stroke.shreds()));
            if crumbs > 0.0 {
                report.area_removed += crumbs;
                ended.note_changes(tissue, &mut self.changes, self.measuring);
            }
            report.bytes_uploaded += ended.bytes;
            let deltas = self.history.take_over(&mut ended.undo);
            report.outcome = match report.outcome {
                _ if !severed.is_empty() => Outcome::Severed,
                Outcome::Missed => Outcome::Torn,
                before => before,
            };
            self.separate(id, severed, deltas, &mut unit, &mut report);
        }
        // the last is taken first: each tissue finds its own again
        self.spare_strokes.extend(strokes.drain(..).rev());
        self.strokes = strokes;
        self.commit(unit);
        self.finish_report(&mut report, Vec::new());
        Some(report)
    }
}

fn add_segments(report: &mut EditReport, stroke: &TearStroke) {
    report.segments.reserve(stroke.reports().len());
    for segment in stroke.reports() {
        report.new_vertices += segment.new_vertices;
        report.intersection_points += segment.intersection_points;
        report.faces_visited += segment.faces_visited;
        report.area_removed += segment.area_removed;
        report.promoted_vertices += segment.promoted_vertices;
        report.wall_faces += segment.wall_faces;
        report.unclosed_edges += segment.unclosed_edges;
        report.wall_deviation = report.wall_deviation.max(segment.wall_deviation);
        if segment.smallest_angle > 0.0 || segment.new_vertices > 0 {
            let known = report.smallest_angle.unwrap_or(f64::INFINITY);
            report.smallest_angle = Some(known.min(segment.smallest_angle)).filter(|a| a.is_finite());
        }
        report.stages.merge(&segment.stages);
        report.segments.push(segment.clone());
    }
}

impl Before {
    pub(super) fn of(tissue: &mut Tissue, measuring: bool) -> Self {
        let mut before = Self::default();
        before.renew(tissue, measuring);
        before
    }

    /// [`Before::of`] in the room of another.
    fn renew(&mut self, tissue: &mut Tissue, measuring: bool) {
        let m = tissue.sums_before(measuring).measures;
        (self.area, self.volume) = (m.area, m.volume_about(tissue.to_tissue(DVec3::ZERO)));
        tissue.note_parts(&mut self.parts);
    }

    /// Components that were split off: of each component there was, all parts but the largest, with the cavities inside them. Faces
    /// ascending. Crumbs among them ([`Tissue::crumb_area`], which `shreds` is for) are dropped; the second is their surface, square metres.
    pub(super) fn new_components(&mut self, tissue: &mut Tissue, shreds: f64) -> (Vec<Vec<FaceId>>, f64) {
        let mut now = tissue.parts();
        self.find_largest(tissue, &now);
        let Self { keep, crumbs, .. } = &mut *self;
        crumbs.clear();
        let mut dropped = 0.0;
        for (_, part) in now.iter().enumerate().filter(|(i, _)| !keep.contains(i)) {
            if let Some(area) = tissue.crumb_area(part, shreds) {
                crumbs.extend(part.all_faces(tissue.mesh()));
                dropped += area;
            }
        }
        if !crumbs.is_empty() {
            crumbs.sort_unstable();
            tissue.keep_parts(now);
            tissue.drop_crumbs(crumbs);
            now = tissue.parts();
            self.find_largest(tissue, &now);
        }
        let keep = &self.keep;
        for (cavity, around) in tissue.severed_cavities(&now, keep) {
            let cavity = now[cavity].take();
            now[around].absorb(cavity);
        }
        let left = now.iter().enumerate().filter(|(i, _)| !keep.contains(i));
        let left: Vec<_> = left.map(|(_, part)| part.sorted_faces(tissue.mesh())).collect();
        if left.is_empty() {
            tissue.keep_parts(now);
        }
        (left, dropped)
    }

    /// Sets `keep` to the largest part of each component there was. What has walls alone is of none: it has come off, out of the inside,
    /// unless it is a cavity.
    fn find_largest(&mut self, tissue: &Tissue, now: &[Part]) {
        let Self { parts, largest, keep, .. } = self;
        largest.clear();
        keep.clear();
        for (i, part) in now.iter().enumerate() {
            let component = parts.of(tissue.mesh(), part);
            if component == u32::MAX && now.len() > 1 {
                let measures = tissue.measure_part(part).measures;
                if !measures.closed() || measures.volume <= 0.0 {
                    keep.push(i);
                }
                continue;
            }
            match largest.binary_search_by_key(&component, |l| l.0) {
                Ok(k) if now[largest[k].1].faces < part.faces => largest[k].1 = i,
                Ok(_) => {}
                Err(k) => largest.insert(k, (component, i)),
            }
        }
        keep.extend(largest.iter().map(|l| l.1));
        // where no skin is left at all
        if largest.is_empty() {
            let body = (0..now.len()).filter(|i| !keep.contains(i)).max_by_key(|&i| now[i].faces);
            keep.extend(body);
        }
    }
}
