//! The bounded plane cut over the whole scene: only the part of the plane that the blade swept.

use super::edit::{in_frame, note_delta, upload_bytes};
use super::history::Unit;
use super::report::{EditReport, Outcome};
use super::strokes::Before;
use super::{Scene, TissueId};
use crate::geometry::Plane;
use glam::DVec3;

impl Scene {
    /// Cuts every tissue along the part of `plane` inside the polygon `corners` (both model space). What it severs becomes a
    /// tissue of its own; else the wound ends inside the tissue and there is one piece. With `closed`, a cut right through gets caps.
    pub(super) fn cut_bounded(&mut self, plane: &Plane, corners: &[DVec3], closed: bool) -> EditReport {
        if !plane.is_sound() || corners.iter().any(|p| !p.is_finite()) {
            return self.missed_cut();
        }
        let mut report = EditReport { kind: "cut", max_plane_distance: Some(0.0), ..EditReport::default() };
        let mut unit = Unit::default();
        let mut sides = Vec::new();
        for id in self.tissues.keys().copied().collect::<Vec<_>>() {
            let Some(tissue) = self.tissues.get_mut(&id) else { continue };
            let mut before = Before::of(tissue, self.measuring);
            report.area_before += before.area;
            report.volume_before += before.volume;
            let local = in_frame(plane, &tissue.frame());
            let polygon: Vec<DVec3> = corners.iter().map(|&p| tissue.to_tissue(p)).collect();
            let Some((step, caps)) = tissue.cut_bounded(&local, &polygon, closed, &mut report.stages) else {
                sides.push((id, 0));
                continue;
            };
            report.outcome = Outcome::Cut;
            report.caps.add(&caps);
            report.faces_visited += step.faces_visited;
            report.new_vertices += step.new_vertices.len();
            report.intersection_points += step.intersection_points;
            let off = step.new_vertices.iter().map(|n| local.distance(tissue.position(n.vertex)).abs());
            report.max_plane_distance = Some(off.fold(report.max_plane_distance.unwrap_or(0.0), f64::max));
            let mut deltas = Vec::new();
            note_delta(&mut self.changes, id, tissue.take_delta(), &mut deltas);
            report.bytes_uploaded += if self.measuring { upload_bytes(&deltas) } else { 0 };
            let (severed, crumbs) = report.stages.time("components", || before.new_components(tissue, 0.0));
            report.area_removed += crumbs;
            let made = self.separate(id, severed, deltas, &mut unit, &mut report);
            let side = |scene: &Self, id: TissueId| match scene.tissues.get(&id) {
                Some(tissue) if !made.is_empty() => tissue.side_of(&local),
                _ => 0,
            };
            sides.extend(std::iter::once(id).chain(made.iter().copied()).map(|id| (id, side(self, id))));
        }
        self.commit(unit);
        self.finish_report(&mut report, sides);
        report
    }
}
