//! The blade that a pointer leads: it stands on the surface, goes in to a depth, and leans if told to.

use crate::surgery::BladePose;
use glam::DVec3;

/// Depth and lean of the blade under a pointer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointerBlade {
    /// How far the tip is under the surface, metres.
    pub depth: f64,
    /// Lean to the right as the viewer sees it, radians; 0 is perpendicular to the surface.
    pub tilt: f64,
    /// How far the blade reaches above the surface, metres.
    pub reach: f64,
}

impl PointerBlade {
    /// The blade on a surface `point` with unit `normal`, seen with `right` to the right, at time `t`.
    pub fn pose(&self, t: f64, point: DVec3, normal: DVec3, right: DVec3) -> BladePose {
        let up = self.up(normal, right);
        // a leaning blade goes further to be as deep
        let length = self.depth / up.dot(normal).max(0.2);
        BladePose { t, tip: point - up * length, base: point + up * self.reach }
    }

    /// Direction from the tip to the base.
    fn up(&self, normal: DVec3, right: DVec3) -> DVec3 {
        let sideways = (right - normal * right.dot(normal)).normalize_or_zero();
        (normal * self.tilt.cos() + sideways * self.tilt.sin()).normalize_or(normal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tip_is_as_deep_as_asked_whatever_the_lean() {
        for tilt in [0.0, 0.5, -1.0] {
            let blade = PointerBlade { depth: 0.02, tilt, reach: 0.1 };
            let pose = blade.pose(1.5, DVec3::ONE, DVec3::Y, DVec3::new(1.0, 0.3, 0.0));
            assert!((pose.tip.y - 0.98).abs() < 1e-12 && pose.base.y > 1.0, "{pose:?}");
            assert!((pose.base - DVec3::ONE).length() - 0.1 < 1e-12);
            assert_eq!((pose.base.x - 1.0).partial_cmp(&0.0), tilt.partial_cmp(&0.0), "the handle leans to the right");
            assert_eq!(pose.t, 1.5);
        }
    }

    #[test]
    fn a_surface_seen_edge_on_still_has_a_blade() {
        let blade = PointerBlade { depth: 0.02, tilt: 0.5, reach: 0.1 };
        let pose = blade.pose(0.0, DVec3::ZERO, DVec3::X, DVec3::X);
        assert!(pose.is_finite() && pose.has_length());
    }
}
