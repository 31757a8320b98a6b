//! Edits of the scene: strokes and cuts over every tissue, pieces that come off, one unit of history each.

use super::changes::Changes;
use super::history::{Change, Unit};
use super::report::{EditReport, Outcome, PieceReport};
use super::{Scene, TissueId};
use crate::geometry::{Distinct, FaceId, Part, PartsBefore, Plane};
use crate::physics::{RigidPose, RigidShape};
use crate::surgery::cap::CapOutcome;
use crate::surgery::{BladePose, Sampling};
use crate::tissue::measure::Sums;
use crate::tissue::stroke::TearStroke;
use crate::tissue::{Tissue, TissueDelta};
use glam::DVec3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A user's wish. Positions in model space, metres.
#[derive(Clone, Debug)]
pub enum EditCommand {
    /// Takes up the scalpel: a tear of `width` metres begins.
    StrokeBegin {
        /// Metres; 0 is a slit that takes nothing out.
        width: f64,
    },
    /// The scalpel is here.
    StrokePose(BladePose),
    /// The scalpel is lifted: the stroke is one unit of undo.
    StrokeEnd,
    /// Cuts everything along a plane.
    Cut(Plane),
    /// Cuts everything along a plane into closed pieces: each closed loop of the cut gets a cap on both sides.
    CutClosed(Plane),
    /// Cuts everything along the part of a plane that the blade swept.
    CutBounded {
        /// The plane.
        plane: Plane,
        /// A convex triangle or quadrangle in it: the blade's tip before and after, then its other end after and before.
        corners: Vec<DVec3>,
        /// Whether the pieces are closed, where the cut goes right through.
        closed: bool,
    },
    /// Cuts everything along the plane that a blade means which moves through `poses`: [`Scene::plane_of_blade`]. A blade that means
    /// none cuts nothing.
    CutByBlade {
        /// In order.
        poses: Vec<BladePose>,
        /// Whether the pieces are closed.
        closed: bool,
    },
    /// Takes back the newest unit.
    Undo,
    /// Does it again.
    Redo,
    /// Takes back everything.
    Reset,
    /// Takes hold of the particles within `radius` of `center`.
    GrabBegin {
        /// Names the grab until it ends.
        id: u32,
        /// Model space.
        center: DVec3,
        /// Metres.
        radius: f64,
    },
    /// Moves a grab by this much from where it began.
    GrabMove {
        /// Which grab.
        id: u32,
        /// Metres.
        by: DVec3,
    },
    /// Lets go.
    GrabEnd {
        /// Which grab.
        id: u32,
    },
    /// Puts a rigid body (an instrument, a hand) into the scene, or moves it: over the next step it goes from where it is to
    /// `pose` and pushes what is in its way (MATHS 4.4).
    PlaceCollider {
        /// Names it until it is removed.
        id: u32,
        /// Another shape under the same id is a new body.
        shape: RigidShape,
        /// Model space.
        pose: RigidPose,
    },
    /// Takes it away.
    RemoveCollider {
        /// Which one.
        id: u32,
    },
}

/// A tissue before a stroke: for its report, and to tell new components from old ones.
#[derive(Default)]
pub(super) struct Before {
    pub(super) area: f64,
    pub(super) volume: f64,
    parts: PartsBefore,
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

impl StrokeOf {
    fn new(id: TissueId, before: Before, stroke: TearStroke) -> Self {
        let [undo, rest] = Default::default();
        Self { id, stroke, before, undo, rest, bytes: 0, distinct: Distinct::default() }
    }

    /// Some that are over before they begin, for their buffers: the first strokes find room as the later ones do. The last, which is
    /// taken first, has room for all of `tissue`.
    pub(super) fn spares(id: TissueId, tissue: &Tissue, sampling: Sampling) -> Vec<Self> {
        let spare = |stroke| {
            let [undo, rest] = [4, 1].map(TissueDelta::with_room);
            Self { undo, rest, ..Self::new(id, Before::default(), stroke) }
        };
        let stroke = || TearStroke::with_room(tissue, sampling);
        let first = stroke().prepare_for(tissue);
        (1..SPARE_STROKES).map(|_| stroke()).chain([first]).map(spare).collect()
    }

    /// Notes what has changed since the last call, and tells those who keep a mirror.
    fn note_changes(&mut self, tissue: &mut Tissue, changes: &mut Changes) {
        let Self { id, stroke, undo, rest, bytes, distinct, .. } = self;
        tissue.take_delta_into(rest);
        let mut note = |delta: &mut TissueDelta| {
            undo.append(delta);
            changes.take_over(*id, delta);
        };
        *bytes += stroke.drain_deltas(&mut note);
        if !rest.is_empty() {
            *bytes += rest.upload_bytes(distinct);
            note(rest);
        }
    }
}

/// Adds what a tissue changed to `deltas`, and tells those who keep a mirror.
pub(super) fn note_delta(changes: &mut Changes, id: TissueId, delta: TissueDelta, deltas: &mut Vec<Arc<TissueDelta>>) {
    if !delta.is_empty() {
        let delta = Arc::new(delta);
        changes.share(id, &delta);
        deltas.push(delta);
    }
}

/// Bytes that a mirror needs to follow.
pub(super) fn upload_bytes(deltas: &[Arc<TissueDelta>]) -> usize {
    let mut distinct = Distinct::default();
    deltas.iter().map(|delta| delta.upload_bytes(&mut distinct)).sum()
}

impl Scene {
    /// Carries out a command. Returns the reports of the edits that it completed: of a stroke at its end, of a cut, an undo, a
    /// redo, a reset. Those four end a stroke that is in progress, so that history stays a sequence.
    pub fn edit(&mut self, command: EditCommand) -> Vec<EditReport> {
        let mut reports = Vec::new();
        if matches!(
            command,
            EditCommand::Cut(_)
                | EditCommand::CutClosed(_)
                | EditCommand::CutBounded { .. }
                | EditCommand::CutByBlade { .. }
                | EditCommand::Undo
                | EditCommand::Redo
                | EditCommand::Reset
        ) {
            reports.extend(self.end_stroke());
        }
        match command {
            EditCommand::StrokeBegin { width } => self.begin_stroke(width),
            EditCommand::StrokePose(pose) => self.stroke_pose(pose),
            EditCommand::StrokeEnd => reports.extend(self.end_stroke()),
            EditCommand::Cut(plane) => reports.push(self.cut(&plane, false)),
            EditCommand::CutClosed(plane) => reports.push(self.cut(&plane, true)),
            EditCommand::CutBounded { plane, corners, closed } => reports.push(self.cut_bounded(&plane, &corners, closed)),
            EditCommand::CutByBlade { poses, closed } => reports.push(match self.plane_of_blade(&poses) {
                Some(plane) => self.cut(&plane, closed),
                None => self.missed_cut(),
            }),
            EditCommand::Undo => reports.push(self.step_history("undo", Outcome::Undone, Self::undo)),
            EditCommand::Redo => reports.push(self.step_history("redo", Outcome::Redone, Self::redo)),
            EditCommand::Reset => reports.push(self.step_history("reset", Outcome::Reset, Self::reset)),
            EditCommand::GrabBegin { id, center, radius } => self.begin_grab(id, center, radius),
            EditCommand::GrabMove { id, by } => self.move_grab(id, by),
            EditCommand::GrabEnd { id } => self.end_grab(id),
            EditCommand::PlaceCollider { id, shape, pose } => self.place_collider(id, shape, pose),
            EditCommand::RemoveCollider { id } => self.remove_collider(id),
        }
        reports
    }

    fn step_history(&mut self, kind: &'static str, outcome: Outcome, step: impl FnOnce(&mut Self) -> bool) -> EditReport {
        let mut report = EditReport { kind, ..EditReport::default() };
        self.measure_before(&mut report);
        let travelled = self.history.travelled_bytes;
        if report.stages.time(kind, || step(self)) {
            report.outcome = outcome;
        }
        report.bytes_uploaded = self.history.travelled_bytes - travelled;
        self.finish_report(&mut report, Vec::new());
        report
    }

    /// Area and volume of everything as it is now, into a report.
    pub(super) fn measure_before(&mut self, report: &mut EditReport) {
        if !self.measuring {
            (report.area_before, report.volume_before) = (f64::NAN, f64::NAN);
            return;
        }
        for tissue in self.tissues.values_mut() {
            let measured = tissue.sums().measures;
            report.area_before += measured.area;
            report.volume_before += measured.volume_about(tissue.to_tissue(DVec3::ZERO));
        }
    }

    fn begin_stroke(&mut self, width: f64) {
        if !self.strokes.is_empty() {
            return;
        }
        self.last_boxes.clear();
        self.last_slits.clear();
        for (&id, tissue) in &mut self.tissues {
            let before = Before::of(tissue, self.measuring);
            let sampling = self.settings.sampling(tissue);
            let mut stroke = match self.spare_strokes.pop() {
                Some(spare) => StrokeOf { id, before, stroke: spare.stroke.again(tissue, width, sampling), bytes: 0, ..spare },
                None => StrokeOf::new(id, before, TearStroke::new(tissue, width, sampling)),
            };
            stroke.stroke.set_wall(self.wall);
            tissue.take_delta_into(&mut stroke.undo);
            debug_assert!(stroke.undo.is_empty(), "an edit has left notes");
            self.strokes.push(stroke);
        }
    }

    fn stroke_pose(&mut self, pose: BladePose) {
        for stroke in &mut self.strokes {
            if let Some(tissue) = self.tissues.get_mut(&stroke.id) {
                let (tip, base) = (tissue.to_tissue(pose.tip), tissue.to_tissue(pose.base));
                stroke.stroke.push(tissue, BladePose { tip, base, ..pose });
                stroke.note_changes(tissue, &mut self.changes);
            }
        }
    }

    fn end_stroke(&mut self) -> Option<EditReport> {
        if self.strokes.is_empty() {
            return None;
        }
        let mut report = EditReport { kind: "tear", ..EditReport::default() };
        let mut unit = Unit::default();
        let mut pieces = Vec::new();
        let mut strokes = std::mem::take(&mut self.strokes);
        for ended in &mut strokes {
            let Some(tissue) = self.tissues.get_mut(&ended.id) else { continue };
            ended.stroke.release(tissue);
            ended.note_changes(tissue, &mut self.changes);
            let StrokeOf { id, ref stroke, ref before, .. } = *ended;
            report.area_before += before.area;
            report.volume_before += before.volume;
            add_segments(&mut report, stroke);
            self.last_boxes.extend(stroke.boxes().iter().map(|b| b.carried(|p| tissue.to_model(p))));
            self.last_slits.extend(stroke.slits().iter().map(|s| s.carried(|p| tissue.to_model(p))));
            if !stroke.has_torn() {
                continue;
            }
            report.bytes_uploaded += ended.bytes;
            let deltas = vec![Arc::new(ended.undo.clone())];
            if report.outcome == Outcome::Missed {
                report.outcome = Outcome::Torn;
            }
            let severed = report.stages.time("components", || {
                let mut severed = before.new_components(tissue);
                tissue.drop_crumbs(&mut severed);
                severed
            });
            if !severed.is_empty() {
                report.outcome = Outcome::Severed;
            }
            pieces.extend(self.separate(id, severed, deltas, &mut unit, &mut report));
        }
        self.spare_strokes.append(&mut strokes);
        self.strokes = strokes;
        let order = self.tissues.keys().copied().filter(|id| !pieces.contains(id)).collect::<Vec<_>>();
        let all = order.into_iter().chain(pieces).map(|id| (id, 0)).collect();
        self.commit(unit);
        self.finish_report(&mut report, all);
        Some(report)
    }

    /// Cuts every tissue along `plane` (model space); with `closed`, pieces get caps.
    fn cut(&mut self, plane: &Plane, closed: bool) -> EditReport {
        let mut report = EditReport { kind: "cut", max_plane_distance: Some(0.0), ..EditReport::default() };
        let mut unit = Unit::default();
        let mut sides = Vec::new();
        for id in self.tissues.keys().copied().collect::<Vec<_>>() {
            let Some(tissue) = self.tissues.get_mut(&id) else { continue };
            let local = in_frame(plane, &tissue.frame());
            let measured = report.measuring.time("before", || tissue.sums_before(self.measuring).measures);
            report.area_before += measured.area;
            report.volume_before += measured.volume_about(tissue.to_tissue(DVec3::ZERO));
            let promoted = tissue.promoted_vertices();
            let (outcome, caps) = if closed {
                tissue.cut_closed(&local, &mut self.cut_scratch, &mut report.stages)
            } else {
                (tissue.cut(&local, &mut self.cut_scratch.split, &mut report.stages), CapOutcome::default())
            };
            report.promoted_vertices += tissue.promoted_vertices() - promoted;
            report.caps.add(&caps);
            report.faces_visited += outcome.faces_visited;
            // between two components it goes through nothing and yet parts them
            if outcome.missed() && !outcome.on_both_sides {
                sides.push((id, tissue.side_of(&local)));
                continue;
            }
            report.outcome = Outcome::Cut;
            report.new_vertices += outcome.new_vertices.len();
            report.intersection_points += outcome.intersection_points;
            report.max_plane_distance = report.measuring.time("plane", || {
                let off = outcome.new_vertices.iter().map(|n| local.distance(tissue.position(n.vertex)).abs());
                Some(off.fold(report.max_plane_distance.unwrap_or(0.0), f64::max))
            });
            let rim = self.cut_scratch.split.rim();
            let mut parts = report.stages.time("components", || tissue.parts_after_cut(&local, rim));
            let measuring = self.measuring;
            let mut known: Vec<_> = report.measuring.time("pieces", || {
                let measured = |part: &Part| measuring.then(|| tissue.measure_part(part));
                let counts = |part: &Part| (part.vertices, part.lowest_origin);
                parts.iter().map(|part| (measured(part), counts(part), tissue.side_of_part(part, &local))).collect()
            });
            let largest = (0..parts.len()).max_by_key(|&c| (parts[c].faces, std::cmp::Reverse(c))).unwrap_or(0);
            parts.remove(largest);
            let stays = known.remove(largest);
            let faces = report.stages.time("components", || parts.iter().map(|p| p.sorted_faces(tissue.mesh())).collect());
            let made = self.separate(id, faces, Vec::new(), &mut unit, &mut report);
            for (id, (sums, counts, side)) in std::iter::once(id).chain(made).zip(std::iter::once(stays).chain(known)) {
                sides.push((id, side));
                match (self.tissues.get_mut(&id), sums) {
                    (Some(tissue), Some(sums)) => tissue.adopt_sums(sums),
                    (Some(tissue), None) => tissue.adopt_counts(counts.0, counts.1),
                    (None, _) => {}
                }
            }
        }
        self.commit(unit);
        self.finish_report(&mut report, sides);
        report
    }

    /// Moves sets of faces of a tissue into tissues of their own; notes everything in `unit`, `deltas` first, whose bytes the report
    /// knows. Returns the new ids.
    pub(super) fn separate(
        &mut self,
        id: TissueId,
        parts: Vec<Vec<FaceId>>,
        mut deltas: Vec<Arc<TissueDelta>>,
        unit: &mut Unit,
        report: &mut EditReport,
    ) -> Vec<TissueId> {
        let mut made = Vec::new();
        let Some(tissue) = self.tissues.get_mut(&id) else { return made };
        let known = deltas.len();
        let pieces = report.stages.time("pieces", || tissue.sever(&parts));
        report.stages.time("history", || note_delta(&mut self.changes, id, tissue.take_delta(), &mut deltas));
        if self.measuring {
            report.bytes_uploaded += report.measuring.time("bytes", || {
                upload_bytes(&deltas[known..]) + pieces.iter().map(|piece| piece.full_upload_bytes()).sum::<usize>()
            });
        }
        unit.changes.push(Change::Edited(id, deltas));
        for piece in pieces {
            let new = TissueId(self.next_id);
            self.next_id += 1;
            self.tissues.insert(new, piece);
            unit.changes.push(Change::Made(new, None));
            made.push(new);
        }
        self.pieces_came_off(id, &made);
        debug_assert!(self.validate().is_ok(), "{:?}", self.validate());
        made
    }

    /// Totals over all tissues, and the pieces in CONTRACT's order. `sides` lists tissues with their sides; empty: all.
    pub(super) fn finish_report(&mut self, report: &mut EditReport, sides: Vec<(TissueId, i8)>) {
        let (mut measuring, measured) = (std::mem::take(&mut report.measuring), self.measuring);
        measuring.time("after", || {
            let sides = if sides.is_empty() { self.tissues.keys().map(|&id| (id, 0)).collect() } else { sides };
            report.max_row_entries = self.tissues.values().map(|tissue| tissue.longest_row()).max().unwrap_or(0);
            let tissues = &mut self.tissues;
            let sums: BTreeMap<TissueId, Sums> = tissues.iter_mut().map(|(&id, tissue)| (id, tissue.sums_if(measured))).collect();
            report.vertices = sums.values().map(|s| s.vertices).sum();
            report.faces = sums.values().map(|s| s.measures.faces).sum();
            let piece = |(id, side)| Some(piece_report(id, tissues.get(&id)?, sums.get(&id)?, side));
            report.pieces = sides.into_iter().filter_map(piece).filter(|p| p.faces > 0).collect();
        });
        report.measuring = measuring;
        if report.kind == "cut" {
            report
                .pieces
                .sort_by(|a, b| b.side.cmp(&a.side).then(b.area.total_cmp(&a.area)).then(a.lowest_origin.cmp(&b.lowest_origin)));
        }
    }
}

fn piece_report(id: TissueId, tissue: &Tissue, sums: &Sums, side: i8) -> PieceReport {
    let m = &sums.measures;
    PieceReport {
        tissue: id,
        faces: m.faces,
        area: m.area,
        volume: m.volume_about(tissue.to_tissue(DVec3::ZERO)),
        closed: m.closed(),
        boundary_edges: m.boundary_edges,
        non_manifold_edges: m.non_manifold_edges,
        degenerate_faces: m.degenerate_faces,
        side,
        lowest_origin: sums.lowest_origin,
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

/// A plane of model space in tissue space.
pub(super) fn in_frame(plane: &Plane, frame: &RigidPose) -> Plane {
    match *plane {
        Plane::Points(points) => Plane::Points(points.map(|p| frame.point_in(p))),
        Plane::Equation { normal, offset: d } => {
            Plane::Equation { normal: frame.direction_in(normal), offset: d - normal.dot(frame.translation) }
        }
    }
}

impl Before {
    pub(super) fn of(tissue: &mut Tissue, measuring: bool) -> Self {
        let m = tissue.sums_before(measuring).measures;
        let parts = tissue.parts_before();
        Self { area: m.area, volume: m.volume_about(tissue.to_tissue(DVec3::ZERO)), parts }
    }

    /// Components that the stroke split off: of each component there was, all parts but the largest, with the cavities inside them.
    /// Faces ascending.
    pub(super) fn new_components(&self, tissue: &mut Tissue) -> Vec<Vec<FaceId>> {
        let mut now = tissue.parts();
        let mesh = tissue.mesh();
        let mut largest: BTreeMap<u32, usize> = BTreeMap::new();
        for (i, part) in now.iter().enumerate() {
            let kept = largest.entry(self.parts.of(mesh, part)).or_insert(i);
            if now[*kept].faces < part.faces {
                *kept = i;
            }
        }
        let keep: Vec<usize> = largest.into_values().collect();
        for (cavity, around) in tissue.severed_cavities(&now, &keep) {
            let cavity = now[cavity].take();
            now[around].absorb(cavity);
        }
        let left = now.iter().enumerate().filter(|(i, _)| !keep.contains(i));
        let left: Vec<_> = left.map(|(_, part)| part.sorted_faces(mesh)).collect();
        if left.is_empty() {
            tissue.keep_parts(now);
        }
        left
    }
}
