//! Rotations of the particles (`R_j` of MATHS 2.1), by shape matching: how the springs of a particle, taken together, have
//! turned against the shape in which they rest. Optional; without it this costs nothing.

use super::network::Network;
use crate::geometry::Turn;
use crate::geometry::turn::best_spin;
use glam::{DMat3, DVec3};

impl Network {
    /// `R_j - I` and anchor of every particle, or nothing at all while no particle is turned. As of the last
    /// [`Network::update_turns`].
    pub fn turns(&self) -> &[Turn] {
        &self.turns
    }

    /// Finds the turn of every particle anew. `anchors`: skinned anchors, metres, tissue space, by particle; `rest`:
    /// displacements in which the particles rest (MATHS 3.3): a neighbourhood in which all are as far from rest as each other
    /// is not turned, so that at rest all turns are exactly zero. Returns true if any turn is, or was, other than zero.
    pub fn update_turns(&mut self, anchors: &[DVec3], rest: &[DVec3]) -> bool {
        let was = !self.turns.is_empty();
        let count = self.len().min(anchors.len()).min(rest.len());
        self.turns.clear();
        if !self.settings.rotations {
            return was;
        }
        let Self { matrix, order, row_of, displacement, turns, .. } = self;
        let strain = |p: usize| DVec3::from(displacement[p]) - rest[p];
        let mut any = false;
        for p in 0..count {
            let own = strain(p);
            let mut moments = DMat3::ZERO;
            let mut strained = false;
            for (column, spring) in matrix.springs(row_of[p] as usize) {
                let other = order[column as usize] as usize;
                if other >= count {
                    continue;
                }
                let offset = (anchors[other] + rest[other]) - (anchors[p] + rest[p]);
                let change = strain(other) - own;
                strained |= change != DVec3::ZERO;
                let pulled = spring * (offset + change);
                moments += DMat3::from_cols(pulled * offset.x, pulled * offset.y, pulled * offset.z);
            }
            let spin = if strained { best_spin(moments) } else { DMat3::ZERO };
            any |= spin != DMat3::ZERO;
            turns.push(Turn { spin, about: anchors[p] });
        }
        turns.resize(order.len(), Turn::default());
        if !any {
            turns.clear();
        }
        any || was
    }

    /// Particles that came are not turned until the next [`Network::update_turns`].
    pub(super) fn resize_turns(&mut self, particles: usize) {
        if !self.turns.is_empty() {
            self.turns.resize(particles, Turn::default());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::reference::benchmark_network;
    use super::super::{Network, NetworkSettings};
    use crate::geometry::ParticleId;
    use glam::{DMat3, DQuat, DVec3};

    fn network(rotations: bool) -> (Network, Vec<DVec3>) {
        let (places, topology) = benchmark_network(60, 300);
        let settings = NetworkSettings { rotations, ..NetworkSettings::SOFT };
        (Network::new(&topology, settings, 1.0).unwrap(), places.into_iter().map(DVec3::from).collect())
    }

    fn turn_all(network: &mut Network, places: &[DVec3], rest: &[DVec3], q: DQuat) {
        for (k, (place, rest)) in places.iter().zip(rest).enumerate() {
            let shape = *place + *rest;
            network.set_state(ParticleId::new(k), *rest + (q * shape - shape) + DVec3::X, DVec3::ZERO);
        }
    }

    #[test]
    fn a_rigid_rotation_is_every_particles_turn_from_any_rest_shape() {
        let q = DQuat::from_rotation_z(1.1) * DQuat::from_rotation_x(0.4);
        let expected = DMat3::from_quat(q) - DMat3::IDENTITY;
        let off = |m: DMat3| (m - expected).to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
        let (mut network, places) = network(true);
        for gap in [0.0, 0.1] {
            let rest: Vec<DVec3> = (0..places.len()).map(|k| DVec3::new(0.0, gap * (k % 3) as f64, 0.0)).collect();
            turn_all(&mut network, &places, &rest, q);
            assert!(network.update_turns(&places, &rest));
            assert_eq!(network.turns().len(), places.len());
            network.turns().iter().for_each(|t| assert!(off(t.spin) < 1e-6, "{t:?}"));
            // Broken twin: measured against another rest shape.
            let other: Vec<DVec3> = (0..places.len()).map(|k| DVec3::new(0.0, 0.1 * (k % 2) as f64, 0.0)).collect();
            network.update_turns(&places, &other);
            assert!(network.turns().iter().any(|t| off(t.spin) > 1e-2));
        }
    }

    #[test]
    fn at_rest_and_under_a_shift_nothing_is_turned() {
        let (mut network, places) = network(true);
        let rest: Vec<DVec3> = (0..places.len()).map(|k| DVec3::new(0.0, 0.1 * (k % 3) as f64, 0.0)).collect();
        turn_all(&mut network, &places, &vec![DVec3::ZERO; places.len()], DQuat::IDENTITY);
        assert!(!network.update_turns(&places, &vec![DVec3::ZERO; places.len()]) && network.turns().is_empty());
        for (k, rest) in rest.iter().enumerate() {
            network.set_state(ParticleId::new(k), *rest, DVec3::ZERO);
        }
        assert!(!network.update_turns(&places, &rest) && network.turns().is_empty());
        network.set_state(ParticleId(7), DVec3::Y, DVec3::ZERO);
        assert!(network.update_turns(&places, &rest) && !network.turns().is_empty());
    }

    #[test]
    fn without_the_setting_there_are_none_and_switching_it_off_takes_them_away() {
        let (mut off, places) = network(false);
        let rest = vec![DVec3::ZERO; places.len()];
        turn_all(&mut off, &places, &rest, DQuat::from_rotation_y(1.0));
        assert!(!off.update_turns(&places, &rest) && off.turns().is_empty());
        let (mut on, _) = network(true);
        turn_all(&mut on, &places, &rest, DQuat::from_rotation_y(1.0));
        assert!(on.update_turns(&places, &rest));
        on.set_settings(NetworkSettings::SOFT).unwrap();
        assert!(on.update_turns(&places, &rest) && on.turns().is_empty());
    }
}
