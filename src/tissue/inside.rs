//! Where points and blades lie to the tissue as it stands: where they enter, inside or outside, or in its skin.

use super::Tissue;
use super::positions::PositionCache;
use super::surface::{bounds, boxes_meet, edges, segment_crosses, segment_meets_box, segment_triangle};
use crate::geometry::FaceId;
use crate::surgery::{BladePose, EntryPoint, Met, Surface, TearBox};
use glam::DVec3;

/// How far from the skin a blade of a closed tear is kept that would lie or end in it, and how much wider its boxes are, as a
/// fraction of the diagonal. What is half as near as that counts as in the skin.
pub(super) const CLEARANCE: f64 = 2e-8;

/// A tissue as a blade meets it.
pub(super) struct Seen<'a> {
    pub(super) tissue: &'a Tissue,
    pub(super) positions: &'a PositionCache,
    /// Width and clearance of boxes with walls, metres.
    pub(super) walled: Option<(f64, f64)>,
}

impl Surface for Seen<'_> {
    fn entry(&self, tip: DVec3, base: DVec3) -> Option<EntryPoint> {
        let found = self.tissue.blade_entry_at(tip, base, |v| self.positions.of(self.tissue, v));
        found.map(|(s, _)| EntryPoint { s, rise: 0.0 })
    }

    fn met_between(&self, from: &BladePose, to: &BladePose) -> Option<Met> {
        let ends = [from.tip, from.base, to.tip, to.base];
        let [low, high] = ends.iter().fold([ends[0]; 2], |[low, high], p| [low.min(*p), high.max(*p)]);
        let (mut widest, mut s) = (None, f64::INFINITY);
        for f in self.tissue.faces_where(move |l, h| boxes_meet((l, h), (low, high))) {
            let face = self.tissue.mesh.corners(f, |v| self.positions.of(self.tissue, v));
            if !boxes_meet(bounds(face), (low, high)) {
                continue;
            }
            let [mut first, mut last] = [1.0f64, 0.0];
            each_swept(from, to, face, |share, along| {
                (first, last) = (first.min(share), last.max(share));
                s = s.min(along);
            });
            if first > last {
                continue;
            }
            // in a face that it lies in, or at its edge, the blade does not go through what it meets
            let BladePose { tip, base, .. } = from.lerp(to, 0.5 * (first + last));
            if widest.is_none_or(|(width, _)| last - first > width) && self.entry(tip, base).is_some() {
                widest = Some((last - first, 0.5 * (first + last)));
            }
        }
        widest.map(|(_, share)| Met { share, s })
    }

    /// In a closed tear a blade that lies or ends in a face of the skin, to within rounding, is taken to be a little outside: walls of
    /// a box that touches the skin would lie in it, or stand in the air behind it, as rounding has it.
    fn clear(&self, pose: BladePose) -> BladePose {
        let Some((width, clearance)) = self.walled else { return pose };
        let near = 0.5 * clearance;
        let (tip, base) = (pose.tip, pose.base);
        let mut outward = [DVec3::ZERO; 2];
        // as far along this normal as along those before it, which it need not be square to
        let push = |by: &mut DVec3, normal: DVec3| *by += normal * (clearance - by.dot(normal)).max(0.0);
        let reach = width + near;
        for f in self.tissue.faces_where(move |low, high| segment_meets_box(tip, base, low - reach, high + reach)) {
            if self.tissue.mesh.is_interior(f) {
                continue;
            }
            let [a, b, c] = self.tissue.mesh.corners(f, |v| self.positions.of(self.tissue, v));
            let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
            let above = |s: f64| normal.dot(tip.lerp(base, s) - a);
            let Some((low, high)) = part_over([a, b, c], normal, reach, tip, base) else { continue };
            let [low_in, high_in] = [low, high].map(|s| above(s).abs() <= near);
            let along = low_in && high_in;
            if along || low_in && low == 0.0 {
                push(&mut outward[0], normal);
            }
            if along || high_in && high == 1.0 {
                push(&mut outward[1], normal);
            }
        }
        BladePose { tip: tip + outward[0], base: base + outward[1], ..pose }
    }
}

/// Calls `found` with each point of a triangle's edges that a blade sweeps between two places, and with each that its ends go through: the share of
/// the way, and where along the blade, from base (0) to tip (1).
fn each_swept(from: &BladePose, to: &BladePose, triangle: [DVec3; 3], mut found: impl FnMut(f64, f64)) {
    for (p, q) in edges(triangle) {
        for swept in [[from.tip, to.tip, to.base], [from.tip, to.base, from.base]] {
            if let Some(at) = segment_triangle(p, q, swept) {
                let p = p.lerp(q, at);
                let [gone, ahead] = [from, to].map(|blade| (p - blade.tip).reject_from(blade.base - blade.tip).length());
                let share = gone / (gone + ahead).max(f64::MIN_POSITIVE);
                let BladePose { tip, base, .. } = from.lerp(to, share);
                let up = base - tip;
                found(share, (1.0 - (p - tip).dot(up) / up.length_squared()).clamp(0.0, 1.0));
            }
        }
    }
    for (p, q, s) in [(from.tip, to.tip, 1.0), (from.base, to.base, 0.0)] {
        if let Some(share) = segment_triangle(p, q, triangle) {
            found(share, s);
        }
    }
}

/// The part of the segment `tip -> base` that lies over or under a triangle, or up to `reach` metres beside it: parameters.
fn part_over([a, b, c]: [DVec3; 3], normal: DVec3, reach: f64, tip: DVec3, base: DVec3) -> Option<(f64, f64)> {
    let (mut low, mut high) = (0.0f64, 1.0f64);
    for (from, to) in [(a, b), (b, c), (c, a)] {
        let inward = normal.cross(to - from).normalize_or_zero();
        let (at_tip, at_base) = (inward.dot(tip - from) + reach, inward.dot(base - from) + reach);
        if at_tip < 0.0 && at_base < 0.0 {
            return None;
        }
        let crossing = at_tip / (at_tip - at_base);
        if at_tip < 0.0 {
            low = low.max(crossing);
        } else if at_base < 0.0 {
            high = high.min(crossing);
        }
    }
    (low <= high).then_some((low, high))
}

/// True if a box that no face reaches lies inside the solid. It leaves no void there, so it is none of the boxes that the wound is
/// made of.
pub(super) fn is_buried(tissue: &Tissue, positions: &PositionCache, tear_box: &TearBox) -> bool {
    let centre = tear_box.corners().iter().sum::<DVec3>() / 8.0;
    let way = (tear_box.blades[0][1] - tear_box.blades[0][0]).normalize_or(DVec3::Y);
    is_inside(tissue, positions, tissue.sections_extent(), centre, way)
}

/// True if `p` lies inside the solid: a look from there along `way` leaves it once more often than it enters it. What is met first does
/// not tell, since rounding may turn round the two sides of a film. `low` and `high` bound the tissue.
fn is_inside(tissue: &Tissue, positions: &PositionCache, (low, high): (DVec3, DVec3), p: DVec3, way: DVec3) -> bool {
    if p.cmplt(low).any() || p.cmpgt(high).any() {
        return false;
    }
    let far = p + way * 2.0 * (high - low).length();
    let near = tissue.faces_where(move |low, high| segment_meets_box(far, p, low, high));
    let crossings = near.filter_map(|f| segment_crosses(p, far, tissue.mesh.face(f).map(|v| positions.of(tissue, v))));
    crossings.map(|(_, leaves)| if leaves { 1 } else { -1 }).sum::<i32>() > 0
}

/// A direction in no plane that a blade is likely to move in.
const ANY_WAY: DVec3 = DVec3::new(0.536_1, 0.741_7, 0.403_3);

/// Which of `points` lie inside the solid.
pub(super) fn which_inside<const N: usize>(tissue: &Tissue, points: [DVec3; N]) -> [bool; N] {
    let positions = PositionCache::default(); // keeps none: few faces are looked at, of however large a model
    points.map(|p| is_inside(tissue, &positions, tissue.sections_extent(), p, ANY_WAY))
}

/// Pieces of a face of the loaded model that one box may leave around it.
const CRUMPLED: usize = 48;

/// True if faces of the loaded model are in so many pieces around a box, among those it has put in, that the skin must lie in folds
/// there. Where tissue runs along the blade, boxes that reach back would cut the folds of those before them, twice as many with each.
pub(super) fn is_crumpled(tissue: &Tissue, added: &[FaceId], origins: &mut Vec<u32>) -> bool {
    let skin = added.iter().map(|&f| tissue.mesh.face_info(f)).filter(|info| !info.is_interior());
    origins.clear();
    origins.extend(skin.map(|info| info.origin));
    let pieces = origins.len();
    origins.sort_unstable();
    origins.dedup();
    pieces > CRUMPLED * origins.len()
}

/// How far from a corner towards the middle of its box, of the whole way, the look from there begins.
const PULLED: f64 = 0.02;

/// Corners of a box (bits) that lie inside the tissue. They are looked at from a little within the box, since it may share planes with
/// walls; skin between is no such wall. `near` are all faces that reach into the box. Looks go to the middle of the box, and count how
/// often they leave the solid and enter it; on through the body they go only from there, and only where the corners tell no inside from
/// outside.
pub(super) fn corners_inside(tissue: &Tissue, positions: &PositionCache, corners: &[DVec3; 8], near: &[FaceId]) -> u8 {
    let centre = corners.iter().sum::<DVec3>() / 8.0;
    // how much oftener the solid covers each corner than the middle
    let mut cover = [0i32; 8];
    let [low, high] = corners.iter().fold([centre; 2], |[low, high], p| [low.min(*p), high.max(*p)]);
    for &f in near {
        let face = tissue.mesh.corners(f, |v| positions.of(tissue, v));
        if !boxes_meet(bounds(face), (low, high)) {
            continue;
        }
        let is_wall = tissue.mesh.is_interior(f);
        for (cover, &p) in cover.iter_mut().zip(corners) {
            if let Some((s, leaves)) = segment_crosses(p, centre, face)
                && (s >= PULLED || !is_wall)
            {
                *cover += if leaves { 1 } else { -1 };
            }
        }
    }
    let (least, most) = cover.iter().fold((0, 0), |(least, most), &c| (c.min(least), c.max(most)));
    let at_centre = if most - least == 1 {
        -least
    } else {
        i32::from(is_inside(tissue, positions, tissue.sections_extent(), centre, ANY_WAY))
    };
    (0..8).fold(0, |bits, k| bits | u8::from(at_centre + cover[k] > 0) << k)
}
