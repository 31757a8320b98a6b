//! A body of the rigid world, and how it comes to rest.

use super::rigid::{RigidPose, Solid};
use super::world::GRAVITY;
use glam::DVec3;
use rapier3d::dynamics::{RigidBody, RigidBodyHandle};
use rapier3d::pipeline::PhysicsWorld;

/// What damps a loose body, linear and angular, 1/s.
pub(super) const DAMPING: [f32; 2] = [0.3, 1.0];
/// A loose body that nothing has stirred for so many seconds is damped the more, this much more in every second after, and sleeps after
/// this many unless it falls. Rapier's own sleep looks at velocities, and a heap of hulls may rock on its corners for ever.
const STIRRED_S: f64 = 1.5;
const CALMING: f64 = 20.0;
const STILL_S: f64 = 4.0;
/// What falls has more than this share of the speed at which damping bears its weight.
const FALLS: f64 = 0.5;

/// What the soft layers do to a body in one step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Push {
    /// N, and N m about the world's origin.
    pub force: DVec3,
    pub torque: DVec3,
    /// How the force answers to a move of the body: N/m, N s/m, and the same for turns about the body's origin.
    pub stiffness: f64,
    pub damping: f64,
    pub turn_stiffness: f64,
    pub turn_damping: f64,
}

/// A body, and what has been done to it.
#[derive(Clone)]
pub(super) struct Body {
    pub(super) handle: Option<RigidBodyHandle>,
    pub(super) solid: Solid,
    pub(super) before: RigidPose,
    pub(super) now: RigidPose,
    pub(super) next: Option<RigidPose>,
    /// Loose bodies only: kg.
    pub(super) mass: f64,
    pub(super) push: Push,
    /// Force that the soft layers put on it before the last step.
    pub(super) last_force: DVec3,
    /// True until its first step: what it then overlaps, it was born in.
    pub(super) fresh: bool,
    /// Whether soft layers feel it.
    pub(super) soft: bool,
    /// For how long nothing has stirred it, s.
    pub(super) still_s: f64,
}

impl Body {
    pub(super) fn new(handle: Option<RigidBodyHandle>, solid: Solid, pose: RigidPose, mass: f64) -> Self {
        let (push, last_force) = (Push::default(), DVec3::ZERO);
        Self { handle, solid, before: pose, now: pose, next: None, mass, push, last_force, fresh: true, soft: true, still_s: 0.0 }
    }

    /// Something stirs it.
    pub(super) fn rouse(&mut self, world: &mut PhysicsWorld) {
        self.still_s = 0.0;
        if let Some(handle) = self.handle {
            world.wake_up(handle, true);
        }
    }

    /// Damps a body that nothing stirs, and lets it sleep in the end.
    pub(super) fn calm(&mut self, rigid: &mut RigidBody, h: f64) {
        self.still_s += h;
        let factor = 1.0 + CALMING * (self.still_s - STIRRED_S).max(0.0);
        let [linear, angular] = DAMPING.map(|d| d * factor as f32);
        rigid.set_linear_damping(linear);
        rigid.set_angular_damping(angular);
        if self.still_s > STILL_S && f64::from(rigid.linvel().length() * linear) < FALLS * GRAVITY {
            rigid.sleep();
        }
    }

    /// True if the last step moved it.
    pub fn moved(&self) -> bool {
        self.before != self.now
    }

    /// True for bodies that fall.
    pub fn is_loose(&self) -> bool {
        self.mass > 0.0
    }
}
