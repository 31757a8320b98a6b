//! Edits of the scene: strokes and cuts over every tissue, pieces that come off, one unit of history each.

use super::changes::Changes;
use super::history::{Change, Unit};
use super::report::{EditReport, Outcome, PieceReport};
use super::{Scene, TissueId};
use crate::diagnostics::audits;
use crate::geometry::{Distinct, FaceId, Part, Plane};
use crate::physics::{RigidPose, RigidShape};
use crate::surgery::BladePose;
use crate::surgery::cap::CapOutcome;
use crate::tissue::measure::Sums;
use crate::tissue::{Tissue, TissueDelta};
use glam::DVec3;
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
    /// Cuts everything along a plane. One that is none ([`Plane::is_sound`]) cuts nothing.
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
        /// Another shape under the same id is a new body. One larger than the world ([`crate::physics::FARTHEST`]) is none.
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

/// Reports that are kept for their room.
const MOST_SPARE_REPORTS: usize = 4;

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
        self.edit_into(command, &mut reports);
        reports
    }

    /// [`Scene::edit`], with the reports added to others.
    pub fn edit_into(&mut self, command: EditCommand, reports: &mut Vec<EditReport>) {
        // what the end of a stroke lets fall, its undo brings back at once
        let brings_back = matches!(command, EditCommand::Undo | EditCommand::Reset);
        let stood = if brings_back { self.stands_in_stroke() } else { Vec::new() };
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
        for (id, stood) in stood {
            if let Some(tissue) = self.tissues.get_mut(&id) {
                tissue.hold(stood);
            }
        }
    }

    /// Takes reports back that nobody reads any more: the next ones use their room.
    pub fn give_back_reports(&mut self, reports: &mut Vec<EditReport>) {
        let room = MOST_SPARE_REPORTS.saturating_sub(self.spare_reports.len());
        self.spare_reports.extend(reports.drain(..).take(room));
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

    /// Cuts every tissue along `plane` (model space); with `closed`, pieces get caps.
    fn cut(&mut self, plane: &Plane, closed: bool) -> EditReport {
        if !plane.is_sound() {
            return self.missed_cut();
        }
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
                let off = tissue.farthest_off(&local, outcome.new_vertices.iter().map(|n| n.vertex));
                Some(off.max(report.max_plane_distance.unwrap_or(0.0)))
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
        let held = self.held_before_parting(id);
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
        self.hold_pieces(id, &made, &held);
        self.pieces_came_off(id, &made);
        debug_assert!(!audits() || self.validate().is_ok(), "{:?}", self.validate());
        made
    }

    /// Totals over all tissues, and the pieces in CONTRACT's order. `sides` lists tissues with their sides; empty: all, those that
    /// came off last, as their ids are.
    pub(super) fn finish_report(&mut self, report: &mut EditReport, sides: Vec<(TissueId, i8)>) {
        let (mut measuring, measured) = (std::mem::take(&mut report.measuring), self.measuring);
        measuring.time("after", || {
            report.max_row_entries = self.tissues.values().map(|tissue| tissue.longest_row()).max().unwrap_or(0);
            let mut all = std::mem::take(&mut self.sums);
            all.clear();
            all.extend(self.tissues.iter_mut().map(|(&id, tissue)| (id, tissue.sums_if(measured))));
            report.vertices = all.iter().map(|(_, s)| s.vertices).sum();
            report.faces = all.iter().map(|(_, s)| s.measures.faces).sum();
            let tissues = &self.tissues;
            let piece = |(id, side): (TissueId, i8)| {
                let sums = all.binary_search_by_key(&id, |s| s.0).ok()?;
                Some(piece_report(id, tissues.get(&id)?, &all[sums].1, side)).filter(|p| p.faces > 0)
            };
            match sides.is_empty() {
                true => report.pieces.extend(tissues.keys().filter_map(|&id| piece((id, 0)))),
                false => report.pieces.extend(sides.into_iter().filter_map(piece)),
            }
            self.sums = all;
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

/// A plane of model space in tissue space.
pub(super) fn in_frame(plane: &Plane, frame: &RigidPose) -> Plane {
    match *plane {
        Plane::Points(points) => Plane::Points(points.map(|p| frame.point_in(p))),
        Plane::Equation { normal, offset: d } => {
            Plane::Equation { normal: frame.direction_in(normal), offset: d - normal.dot(frame.translation) }
        }
    }
}
