//! What weight and motion do to a tissue's own particles (MATHS 4.1): optional, and off by default, since a model is usually
//! made as it hangs.

use super::Tissue;
use crate::physics::GRAVITY;
use glam::DVec3;

/// Accelerations are cut off here, m/s^2: an animation that jumps back to its start has none in truth.
const MOST_ACCELERATION: f64 = 10.0 * GRAVITY;

/// How much of its weight and of its anchors' inertia a particle feels: 0 nothing, 1 all of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BodyForces {
    /// Of its weight; up is the scene's y axis.
    pub gravity: f64,
    /// Of the acceleration of its anchor, by animation or because the piece falls and is pushed.
    pub inertia: f64,
}

/// Settings, and how the anchors have moved.
#[derive(Clone, Debug, Default)]
pub(super) struct ForceState {
    pub settings: BodyForces,
    /// Place (model space) and velocity of each anchor at the last step.
    before: Vec<(DVec3, Option<DVec3>)>,
}

impl ForceState {
    /// The same settings, nothing moved yet.
    pub fn fresh(&self) -> Self {
        Self { settings: self.settings, before: Vec::new() }
    }
}

impl Tissue {
    /// Sets how much of weight and inertia the particles feel; values outside 0 to 1 are brought there, nonsense is 0.
    pub fn set_body_forces(&mut self, forces: BodyForces) {
        let share = |x: f64| if x.is_finite() { x.clamp(0.0, 1.0) } else { 0.0 };
        self.forces.settings = BodyForces { gravity: share(forces.gravity), inertia: share(forces.inertia) };
        self.forces.before.clear();
        if let Some(layer) = self.layer.as_mut().filter(|_| self.forces.settings == BodyForces::default()) {
            layer.network.clear_forces();
        }
    }

    /// Puts weight and inertia of a step of `h` seconds on the particles.
    pub(super) fn push_particles(&mut self, h: f64) {
        let BodyForces { gravity, inertia } = self.forces.settings;
        if (gravity == 0.0 && inertia == 0.0) || h.is_nan() || h <= 0.0 {
            return;
        }
        let Self { layer: Some(layer), forces, rows, pose, frame, .. } = self else { return };
        if forces.before.len() != layer.map.len() {
            forces.before.clear();
        }
        for p in 0..layer.map.len() {
            let anchor = layer.map.anchors[p];
            let at = if anchor.is_some() { frame.point(pose.skin(rows, anchor)) } else { DVec3::ZERO };
            let (mut velocity, mut acceleration) = (None, DVec3::ZERO);
            if let Some(&(before, then)) = forces.before.get(p) {
                let now = (at - before) / h;
                acceleration = then.map_or(DVec3::ZERO, |then| (now - then) / h).clamp_length_max(MOST_ACCELERATION);
                velocity = Some(now);
            }
            match forces.before.get_mut(p) {
                Some(known) => *known = (at, velocity),
                None => forces.before.push((at, velocity)),
            }
            // The network's masses are 1 kg.
            let force = -gravity * GRAVITY * DVec3::Y - inertia * acceleration;
            let particle = crate::geometry::ParticleId::new(p);
            layer.network.set_force(particle, if anchor.is_some() { frame.direction_in(force) } else { DVec3::ZERO });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::ParticleSettings;
    use crate::physics::{NetworkSettings, RigidPose};
    use crate::tissue::TissueSettings;

    fn tissue() -> Tissue {
        let settings = TissueSettings {
            particles: Some(ParticleSettings::with_spacing(0.2)),
            network: NetworkSettings { damping_ratio: 1.0, ..NetworkSettings::FIRM },
            opening_s: 0.0,
            section_faces: 64,
            fade_s: 0.0,
        };
        Tissue::new(crate::formats::load("sphere").unwrap(), &settings).unwrap()
    }

    fn mean(tissue: &Tissue) -> DVec3 {
        let u = tissue.layer().unwrap().displacements();
        u.iter().sum::<DVec3>() / u.len() as f64
    }

    /// A force on all particles alike meets only the anchor springs: they give way by `a / omega^2`.
    #[test]
    fn weight_and_acceleration_shift_the_layer_by_a_over_omega_squared() {
        let rate = NetworkSettings::FIRM.anchor_rate();
        let step = 1.0 / 90.0;
        for (gravity, inertia) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 1.0)] {
            let mut tissue = tissue();
            tissue.set_body_forces(BodyForces { gravity, inertia });
            let pull = DVec3::new(3.0, 0.0, 1.0);
            for k in 0..300 {
                let t = f64::from(k) * step;
                tissue.set_frame(RigidPose::at(0.5 * t * t * pull));
                tissue.step(step);
            }
            let expected = (-gravity * GRAVITY * DVec3::Y - inertia * pull) / rate;
            // As near as a layer that has come to rest is.
            assert!((mean(&tissue) - expected).length() < 2e-6 * tissue.diagonal(), "{} {expected}", mean(&tissue));
            // Broken twin: another acceleration.
            assert!(inertia == 0.0 || (mean(&tissue) - expected + 0.1 * pull / rate).length() > 2e-6 * tissue.diagonal());
        }
    }

    #[test]
    fn it_sleeps_under_its_weight_and_rises_when_the_weight_goes() {
        let mut tissue = tissue();
        tissue.set_body_forces(BodyForces { gravity: 7.0, inertia: f64::NAN });
        assert_eq!(tissue.forces.settings, BodyForces { gravity: 1.0, inertia: 0.0 });
        (0..900).for_each(|_| tissue.step(1.0 / 90.0));
        assert!(tissue.is_asleep() && mean(&tissue).y < -1e-3);
        tissue.set_body_forces(BodyForces::default());
        (0..900).for_each(|_| tissue.step(1.0 / 90.0));
        assert!(tissue.is_asleep() && mean(&tissue).length() < 1e-5);
    }
}
