//! Rigid transforms and solid shapes in f64: what the soft layer sees of the rigid world (MATHS 4.4).

use glam::{DAffine3, DMat3, DQuat, DVec3};

/// A rigid transform, `parent_from_local`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidPose {
    /// Unit quaternion.
    pub rotation: DQuat,
    /// Metres.
    pub translation: DVec3,
}

impl Default for RigidPose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl RigidPose {
    /// Changes nothing.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// A translation.
    pub fn at(translation: DVec3) -> Self {
        Self { translation, ..Self::IDENTITY }
    }

    /// True if nothing is turned: points are then moved by one addition, exactly as if there were no rotation.
    pub fn is_translation(&self) -> bool {
        self.rotation == DQuat::IDENTITY
    }

    /// A share of the way to `to`. All of it ends exactly there, and one that leads nowhere stays exactly where it is: shared out, it would
    /// round.
    pub fn toward(&self, to: &Self, share: f64) -> Self {
        if share >= 1.0 || self == to {
            return *to;
        }
        Self { rotation: self.rotation.slerp(to.rotation, share), translation: self.translation.lerp(to.translation, share) }
    }

    /// Carries a point out.
    pub fn point(&self, p: DVec3) -> DVec3 {
        if self.is_translation() { p + self.translation } else { self.rotation * p + self.translation }
    }

    /// Carries a point in.
    pub fn point_in(&self, p: DVec3) -> DVec3 {
        let away = p - self.translation;
        if self.is_translation() { away } else { self.rotation.conjugate() * away }
    }

    /// Carries a direction out.
    pub fn direction(&self, d: DVec3) -> DVec3 {
        if self.is_translation() { d } else { self.rotation * d }
    }

    /// Carries a direction in.
    pub fn direction_in(&self, d: DVec3) -> DVec3 {
        if self.is_translation() { d } else { self.rotation.conjugate() * d }
    }

    /// First `inner`, then this one.
    pub fn after(&self, inner: &Self) -> Self {
        Self { rotation: (self.rotation * inner.rotation).normalize(), translation: self.point(inner.translation) }
    }

    /// The way back.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: rotation * -self.translation }
    }

    /// As a matrix.
    pub fn affine(&self) -> DAffine3 {
        DAffine3 { matrix3: DMat3::from_quat(self.rotation), translation: self.translation }
    }

    /// The same pose with a unit quaternion; `None` if anything is not finite, or there is no rotation to speak of.
    pub fn checked(self) -> Option<Self> {
        let length = self.rotation.length();
        let sound = self.translation.is_finite() && length.is_finite() && length > 1e-6;
        let rotation = if (length - 1.0).abs() < 1e-12 { self.rotation } else { self.rotation * (1.0 / length) };
        sound.then_some(Self { rotation, ..self })
    }
}

/// A rigid shape a user can bring along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RigidShape {
    /// A ball.
    Sphere {
        /// Metres.
        radius: f64,
    },
    /// A cylinder along the local y axis with round ends: an instrument's shaft, a finger.
    Capsule {
        /// Half the length between the middles of the ends, metres.
        half_length: f64,
        /// Metres.
        radius: f64,
    },
}

impl RigidShape {
    /// The shape if its sizes are finite and its radius is above 0.
    pub fn checked(self) -> Option<Self> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        match self {
            Self::Sphere { radius } => positive(radius),
            Self::Capsule { half_length, radius } => positive(radius) && half_length.is_finite() && half_length >= 0.0,
        }
        .then_some(self)
    }

    /// Radius of the ball around the origin that holds it.
    pub fn reach(&self) -> f64 {
        match self {
            Self::Sphere { radius } => *radius,
            Self::Capsule { half_length, radius } => half_length + radius,
        }
    }
}

/// What a point's distance is measured to. In f64 and closed form, so that a contact at rest has the same bits every frame.
#[derive(Clone)]
pub(super) enum Solid {
    Simple(RigidShape),
    /// Below all of these planes: unit normal and offset. The distance is that from the farthest plane: exact inside and over
    /// faces, too small off edges and corners, where a sweep then takes shorter steps.
    Convex {
        planes: Vec<(DVec3, f64)>,
        middle: DVec3,
        reach: f64,
    },
}

impl Solid {
    /// Signed distance of `p` (the solid's frame), negative inside, and the direction in which it grows.
    pub fn distance(&self, p: DVec3) -> (f64, DVec3) {
        match self {
            Self::Simple(RigidShape::Sphere { radius }) => outward(p, *radius),
            Self::Simple(RigidShape::Capsule { half_length, radius }) => {
                outward(p - DVec3::Y * p.y.clamp(-half_length, *half_length), *radius)
            }
            Self::Convex { planes, .. } => {
                let over = |best: (f64, DVec3), plane: &(DVec3, f64)| {
                    let distance = plane.0.dot(p) - plane.1;
                    if distance > best.0 { (distance, plane.0) } else { best }
                };
                planes.iter().fold((f64::NEG_INFINITY, DVec3::Y), over)
            }
        }
    }

    /// Middle and radius of a ball around it, in its own frame; the radius of a half-space is infinite.
    pub fn ball(&self) -> (DVec3, f64) {
        match self {
            Self::Simple(shape) => (DVec3::ZERO, shape.reach()),
            Self::Convex { middle, reach, .. } => (*middle, *reach),
        }
    }

    /// Everything below `normal . p = 0`.
    pub fn below(normal: DVec3) -> Self {
        Self::Convex { planes: vec![(normal, 0.0)], middle: DVec3::ZERO, reach: f64::INFINITY }
    }

    /// The inside of a closed convex surface; `None` if it has too few faces to close.
    pub fn convex(points: &[DVec3], faces: &[[u32; 3]]) -> Option<Self> {
        let middle = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
        let reach = points.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
        let plane = |f: &[u32; 3]| {
            let [a, b, c] = f.map(|k| points[k as usize]);
            let normal = (b - a).cross(c - a).try_normalize()?;
            Some((normal, normal.dot(a)))
        };
        let planes: Vec<(DVec3, f64)> = faces.iter().filter_map(plane).collect();
        (planes.len() >= 4).then_some(Self::Convex { planes, middle, reach })
    }
}

/// Distance from a ball around the origin; straight up from its middle.
fn outward(p: DVec3, radius: f64) -> (f64, DVec3) {
    let length = p.length();
    (length - radius, if length > 0.0 { p / length } else { DVec3::Y })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rapier3d::parry::shape::SharedShape;

    #[test]
    fn poses_go_there_and_back() {
        let pose =
            RigidPose { rotation: DQuat::from_scaled_axis(DVec3::new(0.3, -1.0, 0.4)), translation: DVec3::new(1.0, 2.0, -3.0) };
        let p = DVec3::new(0.2, 0.7, -0.4);
        assert!((pose.point_in(pose.point(p)) - p).length() < 1e-15);
        assert!((pose.inverse().point(pose.point(p)) - p).length() < 1e-14);
        assert!((pose.after(&pose.inverse()).point(p) - p).length() < 1e-14);
        assert!((pose.affine().transform_point3(p) - pose.point(p)).length() < 1e-15);
        assert!((pose.direction_in(pose.direction(p)) - p).length() < 1e-15);
        // Broken twin: the translation alone.
        assert!((RigidPose::at(pose.translation).point(p) - pose.point(p)).length() > 0.1);
        assert!(RigidPose { rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..pose }.checked().is_none());
        assert!(RigidPose { translation: DVec3::NAN, ..pose }.checked().is_none());
    }

    #[test]
    fn distances_are_those_of_rapiers_shapes() {
        let corners: Vec<DVec3> =
            (0..8).map(|k| DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2 & 1)) * 0.6 - 0.3).collect();
        let single: Vec<glam::Vec3> = corners.iter().map(|p| p.as_vec3()).collect();
        let hull = SharedShape::convex_hull(&single).unwrap();
        let (points, faces) = hull.as_convex_polyhedron().unwrap().to_trimesh();
        let points: Vec<DVec3> = points.iter().map(|p| p.as_dvec3()).collect();
        let pairs = [
            (Solid::Simple(RigidShape::Sphere { radius: 0.3 }), SharedShape::ball(0.3)),
            (Solid::Simple(RigidShape::Capsule { half_length: 0.5, radius: 0.2 }), SharedShape::capsule_y(0.5, 0.2)),
            (Solid::convex(&points, &faces).unwrap(), hull),
        ];
        for (ours, theirs) in pairs {
            for k in 0..200 {
                let noise = |m: u32| f64::from((k * 37 + m * 101) % 97) / 48.5 - 1.0;
                let p = DVec3::new(noise(1), noise(2), noise(3));
                let (a, n) = ours.distance(p);
                let projection = theirs.project_local_point(p.as_vec3(), false);
                let b = (p - projection.point.as_dvec3()).length() * if projection.is_inside { -1.0 } else { 1.0 };
                let off_an_edge =
                    matches!(ours, Solid::Convex { .. }) && p.abs().cmpgt(DVec3::splat(0.3)).bitmask().count_ones() > 1;
                assert!((a - b).abs() < 1e-6 || (off_an_edge && a > 0.0 && a < b), "{p}: {a} {b}");
                // The direction is the way out.
                assert!((ours.distance(p + 1e-3 * n).0 - a - 1e-3).abs() < 1e-9);
            }
            assert!(ours.distance(DVec3::ZERO).1.is_finite());
        }
        assert!(RigidShape::Sphere { radius: 0.0 }.checked().is_none());
        assert!(RigidShape::Capsule { half_length: f64::NAN, radius: 1.0 }.checked().is_none());
    }
}
