//! The cutting plane that a hand means (the paper's Section 3.2): through the point where the blade first touches the model and
//! through the two ends of the blade a step later. While those three are near collinear, a later step is waited for.

use super::BladePose;
use crate::geometry::Plane;
use glam::DVec3;

/// Sine of the angle at the contact point below which three points count as collinear.
const COLLINEAR: f64 = 0.02;

/// Gathers a plane from a blade's poses.
#[derive(Clone, Copy, Debug)]
pub struct PlaneFromHand {
    /// Metres: how far the blade has to move from the contact before its ends count.
    step: f64,
    contact: Option<DVec3>,
    plane: Option<[DVec3; 3]>,
}

impl PlaneFromHand {
    /// Waits until the blade has moved `step` metres from the contact, at least.
    pub fn new(step: f64) -> Self {
        Self { step: if step.is_finite() { step.max(0.0) } else { 0.0 }, contact: None, plane: None }
    }

    /// The blade is at `pose` and meets the model at `touched`, if it does. Returns the plane once it is known: the first
    /// pose that gives one decides, and later ones change nothing.
    pub fn push(&mut self, pose: &BladePose, touched: Option<DVec3>) -> Option<Plane> {
        if self.plane.is_none() && pose.tip.is_finite() && pose.base.is_finite() {
            match self.contact {
                None => self.contact = touched.filter(|p| p.is_finite()),
                Some(contact) => self.plane = self.through(contact, pose),
            }
        }
        self.plane()
    }

    /// The contact point, once there is one.
    pub fn contact(&self) -> Option<DVec3> {
        self.contact
    }

    /// The plane, once it is known.
    pub fn plane(&self) -> Option<Plane> {
        self.plane.map(Plane::Points)
    }

    fn through(&self, contact: DVec3, pose: &BladePose) -> Option<[DVec3; 3]> {
        let (to_tip, to_base, blade) = (pose.tip - contact, pose.base - contact, pose.tip - pose.base);
        let area = to_tip.cross(to_base).length();
        // distance of the contact from the blade's line, and the sine of the flattest angle that the three span
        let moved = area / blade.length().max(f64::MIN_POSITIVE);
        let longest = to_tip.length().max(to_base.length()).max(blade.length());
        (moved >= self.step && area > COLLINEAR * longest * blade.length()).then_some([contact, pose.tip, pose.base])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x: f64, y: f64) -> BladePose {
        BladePose { t: 0.0, tip: DVec3::new(x, y, -0.1), base: DVec3::new(x, y, 0.1) }
    }

    #[test]
    fn contact_and_the_blade_a_step_later_span_the_plane() {
        let mut hand = PlaneFromHand::new(0.005);
        assert!(hand.push(&pose(0.0, 0.0), None).is_none());
        assert!(hand.push(&pose(0.0, 0.0), Some(DVec3::ZERO)).is_none());
        assert!(hand.push(&pose(0.004, 0.0), Some(DVec3::ZERO)).is_none(), "not a step yet");
        let plane = hand.push(&pose(0.02, 0.02), None).unwrap();
        assert!(plane.normal().dot(DVec3::new(1.0, -1.0, 0.0).normalize()).abs() > 1.0 - 1e-12);
        assert_eq!(hand.push(&pose(0.0, 0.5), None), Some(plane), "the first plane stands");
    }

    #[test]
    fn collinear_points_choose_another_step() {
        let mut hand = PlaneFromHand::new(0.0);
        hand.push(&pose(0.0, 0.0), Some(DVec3::ZERO));
        // a stab along the blade's own axis spans nothing
        for i in 1..5 {
            let by = DVec3::Z * -0.01 * f64::from(i);
            let stab = BladePose { t: 0.0, tip: pose(0.0, 0.0).tip + by, base: pose(0.0, 0.0).base + by };
            assert!(hand.push(&stab, None).is_none());
        }
        assert!(hand.push(&pose(0.0, 0.03), None).is_some());
        let mut lost = PlaneFromHand::new(f64::NAN);
        assert!(lost.push(&pose(f64::NAN, 0.0), Some(DVec3::ZERO)).is_none() && lost.contact().is_none());
    }
}
