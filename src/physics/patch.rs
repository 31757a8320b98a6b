//! Mending a network after an edit: the springs of a few particles, in time that follows those springs and not the network.
//!
//! Rows with springs come first and lone rows last. A row that changes camp is swapped across the border, which renames it in
//! its neighbours' rows; then the changed rows are rewritten.

use super::network::{Grab, Network};
use crate::geometry::ParticleId;

impl Network {
    /// Brings the springs of the particles `changed` in line with `row`, which lists a particle's springs as `(other, weight)`.
    /// The network then has `particles` particles, no fewer than before; new ones start at rest at 0 with a mass of 1.
    /// `changed` (sorted, each once) names both ends of every spring that came, went or changed. As after
    /// [`Network::set_topology`], state is kept by particle and only those away from rest are woken; the order of rows differs.
    pub fn update_springs<R>(&mut self, particles: usize, changed: &[ParticleId], row: impl Fn(usize) -> R)
    where
        R: IntoIterator<Item = (u32, f32)>,
    {
        debug_assert!(particles >= self.len() && changed.windows(2).all(|w| w[0] < w[1]));
        self.append_rows(particles);
        let sound = |p: usize, (other, weight): &(u32, f32)| {
            *other as usize != p && (*other as usize) < particles && weight.is_finite() && *weight > 0.0
        };
        let mut swapped = false;
        for p in changed.iter().map(|p| p.index()).filter(|&p| p < particles) {
            let has_springs = row(p).into_iter().any(|spring| sound(p, &spring));
            swapped |= self.change_camp(p, has_springs);
        }
        let mut springs = Vec::new();
        for p in changed.iter().map(|p| p.index()).filter(|&p| p < particles) {
            let own = self.row_of[p] as usize;
            springs.clear();
            for (other, weight) in row(p).into_iter().filter(|spring| sound(p, spring)) {
                let other = self.row_of[other as usize];
                let mass = 0.5 * (self.masses[own] + self.masses[other as usize]);
                springs.push((other, (f64::from(weight) * mass) as f32));
            }
            self.matrix.replace_row(own, &springs, self.settings.coupling, self.masses[own]);
        }
        self.matrix.settle_rows();
        if swapped {
            self.restart_activity();
        } else {
            self.activity.grow(particles);
            for p in changed.iter().map(|p| p.index()).filter(|&p| p < particles) {
                self.disturb_if_unrested(self.row_of[p] as usize);
            }
        }
    }

    /// Lone rows at rest for new particles, at the end.
    fn append_rows(&mut self, particles: usize) {
        for p in self.len()..particles {
            self.order.push(p as u32);
            self.row_of.push(p as u32);
            for vector in [&mut self.e, &mut self.v, &mut self.rest, &mut self.force, &mut self.next_rest] {
                vector.push([0.0; 4]);
            }
            self.masses.push(1.0);
            self.held.push(false);
            self.displacement.push([0.0; 3]);
            self.matrix.push_lone_row(self.settings.coupling, 1.0);
        }
        // so that a steady step allocates nothing
        self.reserve_lists(particles);
    }

    /// Puts the row of `p` among those with springs or among the lone ones. True if rows traded places.
    fn change_camp(&mut self, p: usize, has_springs: bool) -> bool {
        let row = self.row_of[p] as usize;
        let border = match (row < self.linked, has_springs) {
            (false, true) => {
                self.linked += 1;
                self.linked - 1
            }
            (true, false) => {
                self.linked -= 1;
                self.linked
            }
            _ => return false,
        };
        self.swap_rows(row, border);
        row != border
    }

    fn swap_rows(&mut self, a: usize, b: usize) {
        if a == b {
            return;
        }
        self.matrix.swap_rows(a, b);
        for vector in [&mut self.e, &mut self.v, &mut self.rest, &mut self.force, &mut self.next_rest] {
            vector.swap(a, b);
        }
        self.masses.swap(a, b);
        self.held.swap(a, b);
        self.order.swap(a, b);
        self.row_of.swap(self.order[a] as usize, self.order[b] as usize);
        let renamed = |row: u32| match row as usize {
            r if r == a => b as u32,
            r if r == b => a as u32,
            _ => row,
        };
        self.moved.iter_mut().for_each(|row| *row = renamed(*row));
        self.grabs.iter_mut().for_each(|grab: &mut Grab| grab.row = renamed(grab.row));
    }
}

#[cfg(test)]
mod tests {
    use super::super::reference::SplitMix;
    use super::super::{Network, NetworkSettings, NetworkTopology, StepScratch};
    use crate::geometry::ParticleId;
    use glam::DVec3;

    type Rows = Vec<Vec<(u32, f32)>>;

    fn toggle(rows: &mut Rows, a: usize, b: usize, weight: f32) {
        for (from, to) in [(a, b), (b, a)] {
            match rows[from].iter().position(|s| s.0 as usize == to) {
                Some(at) => {
                    rows[from].remove(at);
                }
                None => rows[from].push((to as u32, weight)),
            }
        }
    }

    fn topology(rows: &Rows) -> NetworkTopology {
        NetworkTopology::from_rows(rows.len(), |p| rows[p].iter().copied())
    }

    /// Both networks move alike for a while.
    fn agree(patched: &Network, rows: &Rows) -> Result<(), String> {
        let mut fresh = Network::new(&topology(rows), patched.settings(), 1e-30).unwrap();
        let mut patched = patched.clone();
        for p in 0..rows.len() {
            let p = ParticleId::new(p);
            fresh.set_state(p, patched.displacement(p), patched.velocity(p));
        }
        let (high, expected) = (patched.spectrum().1, fresh.spectrum().1);
        if (high - expected).abs() > 1e-9 * expected {
            return Err(format!("spectrum to {high}, expected {expected}"));
        }
        let (mut one, mut other) = (StepScratch::default(), StepScratch::default());
        for _ in 0..5 {
            patched.step(0.01, &mut one);
            fresh.step(0.01, &mut other);
        }
        for p in 0..rows.len() {
            let p = ParticleId::new(p);
            let off = patched.displacement(p).distance(fresh.displacement(p));
            if off > 1e-9 {
                return Err(format!("{p:?} is {off} off"));
            }
        }
        Ok(())
    }

    #[test]
    fn a_patched_network_moves_as_one_built_anew() {
        let mut random = SplitMix(3);
        let mut pick = |n: usize| ((random.signed() * 0.5 + 0.5) * n as f64) as usize % n;
        let mut rows: Rows = vec![Vec::new(); 12];
        let settings = NetworkSettings::SOFT;
        let mut network = Network::new(&topology(&rows), settings, 1e-30).unwrap();
        for p in 0..12 {
            network.set_state(ParticleId::new(p), DVec3::new(0.1 * p as f64, 1.0, -0.3), DVec3::X);
        }
        let mut scratch = StepScratch::default();
        for round in 0..300 {
            let mut changed = Vec::new();
            if round % 10 == 0 {
                rows.push(Vec::new());
                changed.push(ParticleId::new(rows.len() - 1));
            }
            for _ in 0..1 + pick(4) {
                let (a, b) = (pick(rows.len()), pick(rows.len()));
                if a != b {
                    toggle(&mut rows, a, b, 0.5 + pick(8) as f32);
                    changed.extend([a, b].map(ParticleId::new));
                }
            }
            changed.sort_unstable();
            changed.dedup();
            network.update_springs(rows.len(), &changed, |p| rows[p].iter().copied());
            assert_eq!(network.len(), rows.len());
            assert_eq!(agree(&network, &rows), Ok(()), "round {round}");
            network.step(0.003, &mut scratch);
        }
        // the comparison can fail: a spring that the network was not told of
        let (a, b) = (0, rows.len() - 1);
        network.set_state(ParticleId::new(a), DVec3::ONE, DVec3::ZERO);
        toggle(&mut rows, a, b, 3.0);
        assert!(agree(&network, &rows).is_err());
    }

    #[test]
    fn holds_and_rests_follow_their_particles() {
        let mut rows: Rows = vec![Vec::new(); 4];
        toggle(&mut rows, 0, 1, 1.0);
        toggle(&mut rows, 1, 2, 1.0);
        let mut network = Network::new(&topology(&rows), NetworkSettings::SOFT, 1.0).unwrap();
        network.set_grabs(&[(ParticleId(3), DVec3::Y)]);
        network.set_rest_displacement(ParticleId(2), DVec3::X);
        toggle(&mut rows, 1, 2, 1.0); // 2 becomes lone
        toggle(&mut rows, 0, 3, 1.0); // 3 is linked
        network.update_springs(4, &[0, 1, 2, 3].map(ParticleId), |p| rows[p].iter().copied());
        let mut scratch = StepScratch::default();
        network.step(0.01, &mut scratch);
        assert!(network.is_grabbed(ParticleId(3)) && !network.is_grabbed(ParticleId(2)));
        assert_eq!(network.displacement(ParticleId(3)), DVec3::Y);
        assert_eq!(network.rest_displacement(ParticleId(2)), DVec3::X);
    }

    #[test]
    fn a_resting_network_stays_asleep() {
        let mut rows: Rows = vec![Vec::new(); 3];
        let mut network = Network::new(&topology(&rows), NetworkSettings::SOFT, 1.0).unwrap();
        toggle(&mut rows, 0, 2, 1.0);
        network.update_springs(3, &[ParticleId(0), ParticleId(2)], |p| rows[p].iter().copied());
        assert!(!network.awake());
    }
}
