//! Cuts along the plane that a blade in a hand means (the paper's Section 3.2).

use super::Scene;
use super::report::EditReport;
use crate::geometry::Plane;
use crate::surgery::{BladePose, PlaneFromHand};
use glam::DVec3;

/// The blade's ends count once the blade has moved this fraction of the diagonal from the contact.
const STEP: f64 = 0.02;
/// Looks for the contact in a step.
const LOOKS: f64 = 4.0;
/// Looks between two poses, at most: poses that are farther apart are looked at less closely.
const MOST_LOOKS: f64 = 1000.0;

impl Scene {
    /// The plane through the point where the blade first touches anything on its way through `poses` (model space), and through the
    /// blade's two ends a step later; `None` if it touches nothing, or the three stay in line.
    pub fn plane_of_blade(&mut self, poses: &[BladePose]) -> Option<Plane> {
        self.refresh_sections();
        let diagonal = self.tissues.values().map(|t| t.diagonal()).fold(0.0, f64::max);
        let step = STEP * diagonal;
        let mut hand = PlaneFromHand::new(step);
        let mut last: Option<BladePose> = None;
        for pose in poses.iter().filter(|p| p.tip.is_finite() && p.base.is_finite()) {
            let before = last.replace(*pose).unwrap_or(*pose);
            let way = before.tip.distance(pose.tip).max(before.base.distance(pose.base));
            let looks = (LOOKS * way / step.max(f64::MIN_POSITIVE)).ceil().clamp(1.0, MOST_LOOKS);
            for look in 1..=looks as usize {
                let now = before.lerp(pose, look as f64 / looks);
                let touched = if hand.contact().is_none() { self.first_touch(&now) } else { None };
                if let Some(plane) = hand.push(&now, touched) {
                    return Some(plane);
                }
            }
        }
        None
    }

    /// Brings what [`Scene::first_touch`] looks by to the current poses.
    pub fn refresh_sections(&mut self) {
        self.tissues.values_mut().for_each(|tissue| tissue.refresh_sections());
    }

    /// Where a blade (model space) meets the first tissue on its way from its base to its tip. Call [`Scene::refresh_sections`]
    /// first.
    pub fn first_touch(&self, pose: &BladePose) -> Option<DVec3> {
        let entries = self.tissues.values().filter_map(|t| t.blade_entry(t.to_tissue(pose.tip), t.to_tissue(pose.base)));
        let s = entries.map(|e| e.0).min_by(f64::total_cmp)?;
        Some(pose.base.lerp(pose.tip, s))
    }

    /// A cut that found nothing to cut.
    pub(super) fn missed_cut(&mut self) -> EditReport {
        let mut report = EditReport { kind: "cut", max_plane_distance: Some(0.0), ..EditReport::default() };
        self.measure_before(&mut report);
        self.finish_report(&mut report, Vec::new());
        report
    }
}
