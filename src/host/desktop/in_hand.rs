//! What the pointer's tools look like: a scalpel, the plane of a cut, the tissue that is held.

use crate::gpu::{Instrument, LineSegment, Tool};
use crate::input::tools::Preview;
use glam::{DAffine3, DMat3, DVec3};

/// Length of the scalpel, diagonals of the model.
const LENGTH: f64 = 0.55;
/// Length of the renderer's scalpel, metres.
const TRUE_LENGTH: f64 = 0.16;
/// How far the handle leans ahead in the plane that it cuts, radians: upright it would hide its own wound.
const AHEAD: f64 = 0.4;

const CONTOUR: [f32; 4] = [1.0, 0.85, 0.3, 1.0];
const OUTLINE: [f32; 4] = [0.6, 0.8, 1.0, 0.8];
const HOLD: [f32; 4] = [0.55, 0.95, 0.7, 0.22];

/// Instruments that a preview shows. `diagonal` of the model, metres.
pub fn instruments(preview: &Preview, diagonal: f64) -> Vec<Instrument> {
    let scalpel = preview.blade.map(|blade| scalpel(blade, preview.travel, diagonal));
    let held = preview.held.map(|(middle, radius)| Instrument {
        tool: Tool::Sphere,
        world_from_tool: DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::splat(radius)), middle),
        colour: HOLD,
    });
    [scalpel, held].into_iter().flatten().collect()
}

/// Lines that a preview shows: where a plane would cross the surface, and the line that was drawn. The plane itself is seen edge
/// on, since it goes through the eye.
pub fn lines(preview: &Preview) -> Vec<LineSegment> {
    let mut lines = Vec::new();
    if let Some(plane) = &preview.plane {
        let [a, b, ..] = plane.outline;
        lines.push(LineSegment::new(a, b, OUTLINE));
        lines.extend(plane.contour.iter().map(|[a, b]| LineSegment { width: 2.5, ..LineSegment::new(*a, *b, CONTOUR) }));
    }
    lines
}

/// The scalpel with its tip where the blade's is and its flat in the plane that it cuts.
fn scalpel([tip, base]: [DVec3; 2], travel: DVec3, diagonal: f64) -> Instrument {
    let up = (base - tip).normalize_or(DVec3::Y);
    let ahead = travel.reject_from_normalized(up).normalize_or_zero();
    let handle = up * AHEAD.cos() + ahead * AHEAD.sin();
    Instrument::scalpel(tip, tip + handle, ahead - up, LENGTH * diagonal / TRUE_LENGTH)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scalpel_stands_where_the_blade_is_and_cuts_along_its_way() {
        let blade = [DVec3::new(0.1, 0.2, 0.0), DVec3::new(0.1, 0.5, 0.0)];
        for travel in [DVec3::X * 0.01, DVec3::ZERO, DVec3::new(-0.01, 5.0, 0.0)] {
            let shown = scalpel(blade, travel, 0.5);
            let at = shown.world_from_tool;
            assert!((at.translation - blade[0]).length() < 1e-12);
            let handle = at.transform_vector3(DVec3::Y);
            assert!(handle.y > 0.0 && handle.is_finite(), "it stands above the skin");
            if travel != DVec3::ZERO {
                assert!(handle.z.abs() < 1e-9 && handle.x * travel.x > 0.0, "it leans ahead in the plane of the cut: {handle}");
                assert!(at.transform_vector3(DVec3::X).y < 0.0, "the edge is towards the tissue");
            }
        }
    }
}
