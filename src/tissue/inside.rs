//! Whether points lie inside the tissue as it stands: by a look along a line.

use super::Tissue;
use super::positions::PositionCache;
use crate::surgery::TearBox;
use glam::DVec3;

/// True if a box that no face reaches lies inside the solid. It leaves no void there, so it is none of the boxes that the wound is
/// made of.
pub(super) fn is_buried(tissue: &Tissue, positions: &PositionCache, tear_box: &TearBox) -> bool {
    let centre = tear_box.corners().iter().sum::<DVec3>() / 8.0;
    let way = (tear_box.blades[0][1] - tear_box.blades[0][0]).normalize_or(DVec3::Y);
    is_inside(tissue, positions, tissue.sections_extent(), centre, way)
}

/// True if the first thing that a look from `p` along `way` meets is seen from within. `low` and `high` bound the tissue.
fn is_inside(tissue: &Tissue, positions: &PositionCache, (low, high): (DVec3, DVec3), p: DVec3, way: DVec3) -> bool {
    if p.cmplt(low).any() || p.cmpgt(high).any() {
        return false;
    }
    let far = p + way * 2.0 * (high - low).length();
    tissue.blade_entry_at(far, p, |v| positions.of(tissue, v)).is_some_and(|(s, _)| s == 0.0)
}

/// Corners of a box (bits) that lie inside the tissue, looked at from a little within the box: it may share planes with walls.
pub(super) fn corners_inside(tissue: &Tissue, positions: &PositionCache, corners: &[DVec3; 8]) -> u8 {
    let centre = corners.iter().sum::<DVec3>() / 8.0;
    // in no plane that a blade is likely to move in
    let way = DVec3::new(0.536_1, 0.741_7, 0.403_3).normalize();
    let extent = tissue.sections_extent();
    let inside = |p: &DVec3| is_inside(tissue, positions, extent, p.lerp(centre, 0.02), way);
    corners.iter().enumerate().fold(0, |bits, (c, p)| bits | u8::from(inside(p)) << c)
}
