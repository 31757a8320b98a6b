//! Poses, and where the model stands in the room: the world of the runtime's reference space, and model space inside it.

use glam::{DQuat, DVec3};

/// A rigid pose, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Where.
    pub position: DVec3,
    /// Turned how.
    pub rotation: DQuat,
}

impl Pose {
    /// No turn, at the origin.
    pub const IDENTITY: Self = Self { position: DVec3::ZERO, rotation: DQuat::IDENTITY };

    /// From the runtime's; none if it is not finite, or its turn is no turn.
    pub fn from_xr(pose: &openxr::Posef) -> Option<Self> {
        let (p, q) = (pose.position, pose.orientation);
        let position = DVec3::new(p.x.into(), p.y.into(), p.z.into());
        let rotation = DQuat::from_xyzw(q.x.into(), q.y.into(), q.z.into(), q.w.into());
        let length = rotation.length();
        let sound = position.is_finite() && (0.5..2.0).contains(&length);
        sound.then(|| Self { position, rotation: rotation.normalize() })
    }

    /// For the runtime.
    pub fn to_xr(self) -> openxr::Posef {
        let (p, q) = (self.position.as_vec3(), self.rotation.as_quat());
        openxr::Posef {
            position: openxr::Vector3f { x: p.x, y: p.y, z: p.z },
            orientation: openxr::Quaternionf { x: q.x, y: q.y, z: q.z, w: q.w },
        }
    }

    /// A point given in the pose's own frame.
    pub fn at(&self, local: DVec3) -> DVec3 {
        self.position + self.rotation * local
    }

    /// Where it points.
    pub fn forward(&self) -> DVec3 {
        self.rotation * DVec3::NEG_Z
    }

    /// Its turn about the vertical, radians: 0 looks along -z.
    pub fn yaw(&self) -> f64 {
        let f = self.forward();
        if f.x.hypot(f.z) < 1e-6 { 0.0 } else { (-f.x).atan2(-f.z) }
    }
}

/// `world_from_model`: the model's size, turn about the vertical and place in the room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Where the model's origin is.
    pub position: DVec3,
    /// About the vertical, radians.
    pub yaw: f64,
    /// Metres in the room for each of the model's.
    pub scale: f64,
}

/// Sizes at which a model can be worked on at arm's length; others are scaled. Metres.
const COMFORTABLE: std::ops::RangeInclusive<f64> = 0.15..=0.6;
/// The size that others are scaled to. Metres.
const COMFORTABLE_SIZE: f64 = 0.4;
/// From the eyes to the model's centre, forwards and down. Metres.
const REACH: (f64, f64) = (0.5, 0.25);
/// Two hands cannot scale beyond these.
const SCALES: (f64, f64) = (1e-4, 1e4);

impl Placement {
    /// Puts the centre of a box of model space within arm's reach of a head, at its height, facing it.
    pub fn within_reach(low: DVec3, high: DVec3, head: &Pose) -> Self {
        let size = (high - low).length();
        let scale = if COMFORTABLE.contains(&size) || size <= 0.0 || !size.is_finite() { 1.0 } else { COMFORTABLE_SIZE / size };
        let yaw = head.yaw();
        let forward = DQuat::from_rotation_y(yaw) * DVec3::NEG_Z;
        let centre = head.position + forward * REACH.0 - DVec3::Y * REACH.1;
        let mut placement = Self { position: DVec3::ZERO, yaw, scale };
        let middle = 0.5 * (low + high);
        placement.position = centre - placement.vector_to_world(if middle.is_finite() { middle } else { DVec3::ZERO });
        placement
    }

    fn rotation(&self) -> DQuat {
        DQuat::from_rotation_y(self.yaw)
    }

    /// A point of the room in model space.
    pub fn to_model(&self, world: DVec3) -> DVec3 {
        self.rotation().inverse() * (world - self.position) / self.scale
    }

    /// A point of model space in the room.
    pub fn to_world(&self, model: DVec3) -> DVec3 {
        self.position + self.vector_to_world(model)
    }

    fn vector_to_world(&self, model: DVec3) -> DVec3 {
        self.rotation() * model * self.scale
    }

    /// A pose of the room in model space; its size is not carried along.
    pub fn pose_to_model(&self, world: &Pose) -> Pose {
        Pose { position: self.to_model(world.position), rotation: self.rotation().inverse() * world.rotation }
    }

    /// A length of the room in model space.
    pub fn length_to_model(&self, metres: f64) -> f64 {
        metres / self.scale
    }

    /// Carried by one hand from `from` to `to`.
    pub fn carried(&self, from: DVec3, to: DVec3) -> Self {
        Self { position: self.position + (to - from), ..*self }
    }

    /// Held with two hands that have moved: scaled by their distance, turned about the vertical by their direction.
    pub fn stretched(&self, from: [DVec3; 2], to: [DVec3; 2]) -> Self {
        let (old, new) = (from[1] - from[0], to[1] - to[0]);
        if old.length() < 0.02 || new.length() < 0.02 {
            return *self; // hands that touch have no direction
        }
        let scale = (self.scale * new.length() / old.length()).clamp(SCALES.0, SCALES.1);
        let flat = |v: DVec3| (v.x.hypot(v.z) > 0.02).then(|| (-v.z).atan2(v.x));
        let turn = flat(old).zip(flat(new)).map_or(0.0, |(a, b)| b - a);
        let grown = scale / self.scale;
        let (old_middle, new_middle) = (0.5 * (from[0] + from[1]), 0.5 * (to[0] + to[1]));
        let arm = DQuat::from_rotation_y(turn) * (self.position - old_middle) * grown;
        Self { position: new_middle + arm, yaw: self.yaw + turn, scale }
    }

    /// The room turned about a head by `angle`: what the user sees when turning on the spot.
    pub fn turned_about(&self, head: DVec3, angle: f64) -> Self {
        let pivot = DVec3::new(head.x, self.position.y, head.z);
        let position = pivot + DQuat::from_rotation_y(angle) * (self.position - pivot);
        Self { position, yaw: self.yaw + angle, scale: self.scale }
    }
}

/// One turn for each push of the stick, never a smooth one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SnapTurn {
    pushed: bool,
}

impl SnapTurn {
    /// Radians to turn by now, for a stick at `x` (-1 to 1, right positive). Pushed past 0.7 it turns once, and again only after
    /// it has come back within 0.3.
    pub fn turn(&mut self, x: f64, step: f64) -> f64 {
        if self.pushed {
            self.pushed = x.abs() > 0.3;
            return 0.0;
        }
        self.pushed = x.abs() > 0.7;
        // Turning the user to the right turns the world to the left, counter-clockwise seen from above.
        if self.pushed { step * x.signum() } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(yaw: f64) -> Pose {
        Pose { position: DVec3::new(0.3, 1.6, -0.2), rotation: DQuat::from_rotation_y(yaw) }
    }

    #[test]
    fn a_model_of_any_size_stands_within_arms_reach() {
        for size in [1e-3, 0.2, 5.0, 1e4] {
            for yaw in [0.0, 1.0, -3.0] {
                let (low, high) = (DVec3::splat(2.0 * size), DVec3::splat(3.0 * size));
                let placement = Placement::within_reach(low, high, &head(yaw));
                let centre = placement.to_world(0.5 * (low + high));
                let to = centre - head(yaw).position;
                assert!((0.3..0.8).contains(&to.length()), "{to}");
                assert!(to.dot(head(yaw).forward()) > 0.4, "before the user, whichever way they look");
                let shown = (high - low).length() * placement.scale;
                assert!((0.15..=0.61).contains(&shown), "{shown}");
            }
        }
        assert!(Placement::within_reach(DVec3::INFINITY, DVec3::NEG_INFINITY, &head(0.0)).position.is_finite());
    }

    #[test]
    fn model_space_and_world_are_inverse() {
        let placement = Placement { position: DVec3::new(1.0, 2.0, 3.0), yaw: 0.7, scale: 2.5 };
        let p = DVec3::new(0.1, -0.2, 0.3);
        assert!(placement.to_model(placement.to_world(p)).distance(p) < 1e-12);
        let pose = head(0.4);
        let moved = placement.pose_to_model(&pose);
        assert!(placement.to_world(moved.at(DVec3::NEG_Z)).distance(pose.at(DVec3::NEG_Z * 2.5)) < 1e-12);
    }

    #[test]
    fn two_hands_keep_what_they_hold() {
        let placement = Placement { position: DVec3::new(0.1, 1.0, -0.5), yaw: 0.2, scale: 1.0 };
        let from = [DVec3::new(-0.2, 1.1, -0.4), DVec3::new(0.2, 1.1, -0.4)];
        let to = [DVec3::new(-0.1, 1.2, -0.8), DVec3::new(0.1, 1.2, -0.1)];
        let after = placement.stretched(from, to);
        let middle = placement.to_model(0.5 * (from[0] + from[1]));
        assert!(after.to_world(middle).distance(0.5 * (to[0] + to[1])) < 1e-12);
        for hand in 0..2 {
            let held = placement.to_model(from[hand]);
            assert!(after.to_world(held).distance(to[hand]) < 1e-12, "level hands hold their points exactly");
        }
        assert_eq!(placement.stretched(from, [to[0], to[0]]), placement, "hands that touch");
        assert_ne!(placement.stretched(from, to), placement);
    }

    #[test]
    fn a_snap_turn_happens_once_a_push_and_leaves_the_head_where_it_is() {
        let mut snap = SnapTurn::default();
        let turns: Vec<f64> = [0.0, 0.5, 0.8, 1.0, 0.6, 0.2, -0.9, -0.4, 0.0].iter().map(|&x| snap.turn(x, 0.5)).collect();
        assert_eq!(turns, [0.0, 0.0, 0.5, 0.0, 0.0, 0.0, -0.5, 0.0, 0.0]);
        let placement = Placement { position: DVec3::new(0.0, 1.0, -0.5), yaw: 0.0, scale: 1.0 };
        let h = head(0.0).position;
        let after = placement.turned_about(h, 0.5);
        let local = |p: &Placement| p.to_model(h);
        assert!((local(&placement).length() - local(&after).length()).abs() < 1e-12, "turned about the head");
        // a right turn brings what was on the right (+x) to the front (-z)
        let right = Placement { position: h + DVec3::X, yaw: 0.0, scale: 1.0 };
        assert!((right.turned_about(h, std::f64::consts::FRAC_PI_2).position - h).distance(DVec3::NEG_Z) < 1e-12);
    }

    #[test]
    fn broken_poses_are_refused() {
        let mut pose = head(0.3).to_xr();
        let back = Pose::from_xr(&pose).expect("sound");
        assert!(back.position.distance(head(0.3).position) < 1e-6 && (back.yaw() - 0.3).abs() < 1e-6);
        pose.position.x = f32::NAN;
        assert_eq!(Pose::from_xr(&pose), None);
        let zero = openxr::Posef { orientation: openxr::Quaternionf { x: 0.0, y: 0.0, z: 0.0, w: 0.0 }, ..head(0.0).to_xr() };
        assert_eq!(Pose::from_xr(&zero), None);
    }
}
