//! A plane drawn by hand: through the eye and a line on the picture.

use super::pick::Picker;
use crate::geometry::Plane;
use crate::scene::Scene;
use glam::DVec3;

/// Lines shorter than this fraction of the distance to the eye give no direction.
const LEAST_ANGLE: f64 = 1e-3;

/// The plane through an eye and two points before it; its positive side is to the left of the way from `a` to `b` as the eye
/// sees it. `None` if the three are nearly in line.
pub fn plane_through(eye: DVec3, a: DVec3, b: DVec3) -> Option<Plane> {
    let (to_a, to_b) = (a - eye, b - eye);
    let cross = to_b.cross(to_a);
    let wide = cross.length() > LEAST_ANGLE * to_a.length() * to_b.length();
    // the order makes (second - first) x (third - first) point to the left
    (wide && cross.is_finite()).then_some(Plane::Points([eye, b, a]))
}

/// What a plane would do, for the eye, before it is done.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlanePreview {
    /// Where it would cross the surface, segment by segment, model space.
    pub contour: Vec<[DVec3; 2]>,
    /// A quad in the plane around what it crosses.
    pub outline: [DVec3; 4],
}

impl PlanePreview {
    /// Looks where `plane` (through `eye`, `a` and `b`) meets the tissues as `picker` last saw them.
    pub fn new(picker: &Picker, scene: &Scene, plane: &Plane, [eye, a, b]: [DVec3; 3]) -> Self {
        let mut contour = Vec::new();
        picker.contour(scene, plane, &mut contour);
        let ahead = ((a + b) / 2.0 - eye).normalize_or(DVec3::NEG_Z);
        let normal = (b - eye).cross(a - eye).normalize_or(DVec3::Y);
        let across = ahead.cross(normal);
        let points = contour.iter().flatten().copied().chain([a, b]);
        let (mut near, mut far, mut low, mut high) = (f64::INFINITY, 0.0f64, f64::INFINITY, f64::NEG_INFINITY);
        for p in points {
            let (depth, side) = ((p - eye).dot(ahead), (p - eye).dot(across));
            (near, far, low, high) = (near.min(depth), far.max(depth), low.min(side), high.max(side));
        }
        let margin = 0.08 * (high - low).max(far - near);
        let corner = |depth: f64, side: f64| eye + ahead * depth + across * side;
        let (near, far, low, high) = (near - margin, far + margin, low - margin, high + margin);
        Self { contour, outline: [corner(near, low), corner(near, high), corner(far, high), corner(far, low)] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plane_holds_its_points_and_left_is_positive() {
        let (eye, a, b) = (DVec3::new(0.0, 0.0, 5.0), DVec3::new(-1.0, 0.3, 0.0), DVec3::new(2.0, 0.1, 0.0));
        let plane = plane_through(eye, a, b).unwrap();
        for p in [eye, a, b, (a + b) / 2.0] {
            assert!(plane.distance(p).abs() < 1e-12);
        }
        // going right, left is up
        assert!(plane.distance(DVec3::Y * 2.0) > 0.0 && plane.distance(DVec3::NEG_Y * 2.0) < 0.0);
        assert!(plane_through(eye, b, a).unwrap().distance(DVec3::Y * 2.0) < 0.0);
    }

    #[test]
    fn a_point_is_no_line() {
        let eye = DVec3::new(0.0, 0.0, 5.0);
        for b in [DVec3::ZERO, DVec3::X * 1e-3, DVec3::NEG_Z, DVec3::NAN, eye] {
            assert!(plane_through(eye, DVec3::ZERO, b).is_none(), "{b}");
        }
        assert!(plane_through(eye, DVec3::ZERO, DVec3::X * 0.1).is_some());
    }
}
