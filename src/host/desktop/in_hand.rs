//! What the pointer's tools look like: a scalpel, the plane of a cut, the tissue that is held.

use crate::gpu::{Instrument, LineSegment, Tool};
use crate::input::tools::{PlanePreview, Preview};
use glam::{DAffine3, DMat3, DVec3};

/// Length of the scalpel, diagonals of the model.
const LENGTH: f64 = 0.55;
/// Length of the renderer's scalpel, metres.
const TRUE_LENGTH: f64 = 0.16;
/// How far the handle leans ahead in the plane that it cuts, radians: upright it would hide its own wound.
const AHEAD: f64 = 0.9;

const STEEL: [f32; 4] = [0.85, 0.9, 1.0, 1.0];
const CONTOUR: [f32; 4] = [1.0, 0.85, 0.3, 1.0];
const SHEET: [f32; 4] = [0.5, 0.75, 1.0, 0.35];
const HOLD: [f32; 4] = [0.55, 0.95, 0.7, 0.22];

/// Instruments that a preview shows. `diagonal` of the model, metres.
pub fn instruments(preview: &Preview, diagonal: f64) -> Vec<Instrument> {
    let scalpel = preview.blade.map(|blade| scalpel(blade, preview.travel, diagonal));
    let sheet = preview.plane.as_ref().map(sheet);
    let held = preview.held.map(|(middle, radius)| Instrument {
        tool: Tool::Sphere,
        world_from_tool: DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::splat(radius)), middle),
        colour: HOLD,
    });
    [scalpel, sheet, held].into_iter().flatten().collect()
}

/// Lines that a preview shows: where a plane would cross the surface, and the shaft of the blade.
pub fn lines(preview: &Preview) -> Vec<LineSegment> {
    let blade = preview.blade.iter().map(|[tip, base]| LineSegment::new(*tip, *base, STEEL));
    let contour = preview.plane.iter().flat_map(|plane| &plane.contour);
    blade.chain(contour.map(|[a, b]| LineSegment { width: 2.5, ..LineSegment::new(*a, *b, CONTOUR) })).collect()
}

/// The scalpel with its tip where the blade's is and its flat in the plane that it cuts.
fn scalpel([tip, base]: [DVec3; 2], travel: DVec3, diagonal: f64) -> Instrument {
    let up = (base - tip).normalize_or(DVec3::Y);
    let ahead = travel.reject_from_normalized(up).normalize_or_zero();
    let handle = up * AHEAD.cos() + ahead * AHEAD.sin();
    Instrument::scalpel(tip, tip + handle, ahead - up, LENGTH * diagonal / TRUE_LENGTH)
}

/// A translucent sheet over a plane's outline.
fn sheet(plane: &PlanePreview) -> Instrument {
    let [a, b, c, d] = plane.outline;
    let (u, v) = ((b - a) / 2.0, (d - a) / 2.0);
    let normal = u.cross(v).normalize_or(DVec3::Z);
    let world_from_tool = DAffine3::from_mat3_translation(DMat3::from_cols(u, v, normal), (a + c) / 2.0);
    Instrument { tool: Tool::Plane, world_from_tool, colour: SHEET }
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

    #[test]
    fn a_sheet_covers_the_outline() {
        let outline = [DVec3::ZERO, DVec3::X * 2.0, DVec3::new(2.0, 0.0, 3.0), DVec3::Z * 3.0];
        let sheet = sheet(&PlanePreview { contour: Vec::new(), outline });
        let corner = |x: f64, y: f64| sheet.world_from_tool.transform_point3(DVec3::new(x, y, 0.0));
        let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        assert!(corners.iter().zip(outline).all(|(a, b)| a.distance(b) < 1e-12), "{corners:?}");
    }
}
