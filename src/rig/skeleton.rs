//! The skeleton: a node hierarchy, the joints that skin vertices, and posing (MATHS 1.1, 1.7).

use super::animation::Animation;
use super::skinning::{JointMatrix, Pose};
use glam::{DAffine3, DMat3, DQuat, DVec3};

/// Where a node sits in its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LocalTransform {
    /// Translation (metres), rotation, scale: what animations change.
    Trs(Trs),
    /// A fixed matrix.
    Matrix(DAffine3),
}

/// Translation, rotation, scale; applied in the order scale, rotation, translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trs {
    /// Metres.
    pub translation: DVec3,
    /// Unit quaternion.
    pub rotation: DQuat,
    /// Factors an axis.
    pub scale: DVec3,
}

impl Trs {
    /// The identity.
    pub const IDENTITY: Self = Self { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE };

    /// As a transform.
    pub fn affine(&self) -> DAffine3 {
        DAffine3 { matrix3: DMat3::from_quat(self.rotation) * DMat3::from_diagonal(self.scale), translation: self.translation }
    }

    /// The nearest translation, rotation and scale of a transform (shear is lost).
    pub fn from_affine(m: DAffine3) -> Self {
        let (scale, rotation, translation) = m.to_scale_rotation_translation();
        let rotation = if rotation.is_finite() { rotation } else { DQuat::IDENTITY };
        Self { translation, rotation, scale }
    }
}

impl LocalTransform {
    /// As a transform.
    pub fn affine(&self) -> DAffine3 {
        match self {
            Self::Trs(trs) => trs.affine(),
            Self::Matrix(m) => *m,
        }
    }
}

/// A node of the hierarchy.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Name in the file, if it has one.
    pub name: Option<String>,
    /// Index of the parent, always lower than the node's own; `None` for roots.
    pub parent: Option<u32>,
    /// Place in the parent as stored, without animation.
    pub local: LocalTransform,
}

/// What moves skinned vertices: a node seen through an inverse bind transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// Index of the node.
    pub node: u32,
    /// From model space at rest to the node's space.
    pub inverse_bind: DAffine3,
    /// Index of the skin it belongs to; `None` for a rigid joint, which carries an unskinned part of an animated node.
    pub skin: Option<u32>,
}

/// A skin: a set of joints under a name.
#[derive(Clone, Debug, PartialEq)]
pub struct Skin {
    /// Name in the file, if it has one.
    pub name: Option<String>,
    /// Joint indices (into [`Rig::joints`]) in the file's order.
    pub joints: Vec<u32>,
    /// Index of the node that the file names as the skeleton's root.
    pub skeleton: Option<u32>,
}

/// Nodes, joints and animations of a model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rig {
    /// Parents come before children.
    pub nodes: Vec<Node>,
    /// The palette: [`Pose::joint_matrices`] follows its order.
    pub joints: Vec<Joint>,
    /// Skins, each a part of the palette.
    pub skins: Vec<Skin>,
    /// Animations in the file's order.
    pub animations: Vec<Animation>,
    /// Origin of tissue space in model space, metres (MATHS 1.7).
    pub origin: DVec3,
}

/// Scratch of [`Rig::pose`]; keep one so that posing does not allocate.
#[derive(Clone, Debug, Default)]
pub struct PoseScratch {
    locals: Vec<LocalTransform>,
    worlds: Vec<DAffine3>,
}

impl PoseScratch {
    /// World transforms of the last pose, model space, one a node.
    pub fn worlds(&self) -> &[DAffine3] {
        &self.worlds
    }
}

/// A rule of [`Rig::validate`] that does not hold.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RigError {
    /// A parent does not come before its child.
    #[error("node {node} has parent {parent}, which does not come before it")]
    ParentOrder {
        /// The child.
        node: usize,
        /// Its parent.
        parent: u32,
    },
    /// A transform holds a number that is not finite.
    #[error("{what} {index} is not finite")]
    NotFinite {
        /// "node" or "joint".
        what: &'static str,
        /// Its index.
        index: usize,
    },
    /// An index points past the end.
    #[error("{what} {index} refers to something that does not exist")]
    Dangling {
        /// "joint", "skin" or "animation".
        what: &'static str,
        /// Its index.
        index: usize,
    },
    /// An animation's keys are not usable.
    #[error("animation {animation}, channel {channel}: times must not decrease and must match the values")]
    Keys {
        /// Index of the animation.
        animation: usize,
        /// Index of the channel.
        channel: usize,
    },
}

impl Rig {
    /// Index of the animation of that name; the exact name first, then ignoring case.
    pub fn animation_by_name(&self, name: &str) -> Option<usize> {
        let find = |f: &dyn Fn(&str) -> bool| self.animations.iter().position(|a| f(&a.name));
        find(&|n| n == name).or_else(|| find(&|n| n.eq_ignore_ascii_case(name)))
    }

    /// The pose at `time_s` of an animation (clamped to its range), or the stored node transforms for `None` or an index
    /// out of range. Writes one matrix a joint: `T(-origin) * joint_world * inverse_bind * T(origin)`, composed in f64
    /// and rounded once (MATHS 1.7). Does not allocate once `scratch` and `out` have grown.
    pub fn pose(&self, animation: Option<usize>, time_s: f64, scratch: &mut PoseScratch, out: &mut Pose) {
        self.pose_nodes(animation, time_s, scratch);
        out.joint_matrices.clear();
        out.joint_matrices.extend(self.joints.iter().map(|joint| {
            let mut m = scratch.worlds[joint.node as usize] * joint.inverse_bind;
            m.translation += m.matrix3 * self.origin - self.origin;
            JointMatrix::from_affine(m)
        }));
    }

    /// World transforms of all nodes, left in [`PoseScratch::worlds`].
    pub fn pose_nodes(&self, animation: Option<usize>, time_s: f64, scratch: &mut PoseScratch) {
        scratch.locals.clear();
        scratch.locals.extend(self.nodes.iter().map(|n| n.local));
        if let Some(animation) = animation.and_then(|a| self.animations.get(a)) {
            animation.apply(time_s, &mut scratch.locals);
        }
        scratch.worlds.clear();
        for (node, local) in self.nodes.iter().zip(&scratch.locals) {
            let local = local.affine();
            let world = node.parent.map_or(local, |parent| scratch.worlds[parent as usize] * local);
            scratch.worlds.push(world);
        }
    }

    /// [`Rig::pose`] into a new pose.
    pub fn pose_at(&self, animation: Option<usize>, time_s: f64) -> Pose {
        let mut pose = Pose::default();
        self.pose(animation, time_s, &mut PoseScratch::default(), &mut pose);
        pose
    }

    /// The pose of the stored node transforms.
    pub fn rest_pose(&self) -> Pose {
        self.pose_at(None, 0.0)
    }

    /// For each node: true if an animation changes it or a node above it.
    pub fn moving_nodes(&self) -> Vec<bool> {
        let mut moves = vec![false; self.nodes.len()];
        for channel in self.animations.iter().flat_map(|a| &a.channels) {
            if let Some(moves) = moves.get_mut(channel.node as usize) {
                *moves = true;
            }
        }
        for (i, node) in self.nodes.iter().enumerate() {
            moves[i] |= node.parent.is_some_and(|p| moves[p as usize]);
        }
        moves
    }

    /// Checks every rule from scratch.
    pub fn validate(&self) -> Result<(), RigError> {
        for (i, node) in self.nodes.iter().enumerate() {
            if let Some(parent) = node.parent.filter(|&p| p as usize >= i) {
                return Err(RigError::ParentOrder { node: i, parent });
            }
            if !node.local.affine().is_finite() {
                return Err(RigError::NotFinite { what: "node", index: i });
            }
        }
        for (i, joint) in self.joints.iter().enumerate() {
            let skin_exists = joint.skin.is_none_or(|s| (s as usize) < self.skins.len());
            if joint.node as usize >= self.nodes.len() || !skin_exists {
                return Err(RigError::Dangling { what: "joint", index: i });
            }
            if !joint.inverse_bind.is_finite() {
                return Err(RigError::NotFinite { what: "joint", index: i });
            }
        }
        for (i, skin) in self.skins.iter().enumerate() {
            if skin.joints.iter().any(|&j| self.joints.get(j as usize).is_none_or(|j| j.skin != Some(i as u32))) {
                return Err(RigError::Dangling { what: "skin", index: i });
            }
        }
        for (a, animation) in self.animations.iter().enumerate() {
            for (c, channel) in animation.channels.iter().enumerate() {
                if channel.node as usize >= self.nodes.len() {
                    return Err(RigError::Dangling { what: "animation", index: a });
                }
                if !channel.keys.are_valid() {
                    return Err(RigError::Keys { animation: a, channel: c });
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::animation::{Channel, Interpolation, Keys, Property};

    fn arm() -> Rig {
        let node = |parent, x| Node {
            name: None,
            parent,
            local: LocalTransform::Trs(Trs { translation: DVec3::X * x, ..Trs::IDENTITY }),
        };
        let joint = |node, x: f64| Joint { node, inverse_bind: DAffine3::from_translation(DVec3::X * -x), skin: Some(0) };
        let quarter = std::f64::consts::FRAC_1_SQRT_2;
        let keys = Keys {
            interpolation: Interpolation::Linear,
            times: vec![0.0, 1.0],
            values: vec![[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, quarter, quarter]],
        };
        Rig {
            nodes: vec![node(None, 1.0), node(Some(0), 1.0)],
            joints: vec![joint(0, 1.0), joint(1, 2.0)],
            skins: vec![Skin { name: None, joints: vec![0, 1], skeleton: None }],
            animations: vec![Animation {
                name: "Bend".into(),
                duration_s: 1.0,
                channels: vec![Channel { node: 1, property: Property::Rotation, keys }],
            }],
            origin: DVec3::ZERO,
        }
    }

    #[test]
    fn a_child_turns_about_its_own_joint() {
        let rig = arm();
        rig.validate().unwrap();
        assert!(rig.rest_pose().joint_matrices.iter().all(|m| *m == JointMatrix::IDENTITY));
        let pose = rig.pose_at(Some(0), 1.0);
        let tip = pose.joint_matrices[1].transform(DVec3::X * 3.0);
        assert!((tip - DVec3::new(2.0, 1.0, 0.0)).length() < 1e-7, "{tip}");
        assert_eq!(pose.joint_matrices[0], JointMatrix::IDENTITY);
        let halfway = rig.pose_at(Some(0), 0.5).joint_matrices[1].transform(DVec3::X * 3.0) - DVec3::X * 2.0;
        let angle = halfway.y.atan2(halfway.x);
        assert!((angle - std::f64::consts::FRAC_PI_4).abs() < 1e-7, "slerp keeps the angular rate");
        assert_eq!(rig.pose_at(Some(0), 7.0), pose, "clamped");
        assert_eq!(rig.pose_at(Some(9), 0.5), rig.rest_pose(), "no such animation");
        assert_eq!(rig.animation_by_name("bend"), Some(0));
    }

    #[test]
    fn recentring_keeps_accuracy_far_from_the_origin() {
        let place = DVec3::new(1000.0, -2000.0, 500.0);
        let error = |origin: DVec3| {
            let mut rig = arm();
            rig.nodes[0].local = LocalTransform::Trs(Trs { translation: DVec3::X + place, ..Trs::IDENTITY });
            for joint in &mut rig.joints {
                joint.inverse_bind.translation -= place;
            }
            rig.origin = origin;
            let at_home = arm().pose_at(Some(0), 1.0);
            let pose = rig.pose_at(Some(0), 1.0);
            let p = DVec3::new(2.7, 0.1, 0.2);
            let rest = (p + place - origin).as_vec3().as_dvec3();
            (pose.joint_matrices[1].transform(rest) + origin - place - at_home.joint_matrices[1].transform(p)).length()
        };
        assert!(error(place) < 1e-6);
        assert!(error(DVec3::ZERO) > 1e-5, "the control: without recentring the error shows");
    }

    #[test]
    fn each_rule_can_break() {
        let broken = |change: &dyn Fn(&mut Rig)| {
            let mut rig = arm();
            change(&mut rig);
            rig.validate().unwrap_err()
        };
        assert!(matches!(broken(&|r| r.nodes[0].parent = Some(1)), RigError::ParentOrder { node: 0, parent: 1 }));
        let nan = LocalTransform::Matrix(DAffine3::from_translation(DVec3::NAN));
        assert!(matches!(broken(&|r| r.nodes[1].local = nan), RigError::NotFinite { what: "node", index: 1 }));
        assert!(matches!(broken(&|r| r.joints[1].node = 2), RigError::Dangling { what: "joint", .. }));
        assert!(matches!(broken(&|r| r.joints[0].inverse_bind = DAffine3::NAN), RigError::NotFinite { what: "joint", .. }));
        assert!(matches!(broken(&|r| r.skins[0].joints[0] = 2), RigError::Dangling { what: "skin", .. }));
        assert!(matches!(broken(&|r| r.animations[0].channels[0].node = 2), RigError::Dangling { what: "animation", .. }));
        assert!(matches!(broken(&|r| r.animations[0].channels[0].keys.times[0] = 2.0), RigError::Keys { .. }));
    }
}
