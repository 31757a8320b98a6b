//! Mending a network after an edit: the springs of a few particles, in time that follows those springs and not the network.
//!
//! Rows with springs come first and lone rows last. A row that changes camp is swapped across the border, which renames it in
//! its neighbours' rows; then the changed rows are rewritten.

use super::matrix::Lanes;
use super::network::{Grab, Network, unpadded};
use crate::geometry::ParticleId;
use std::ops::Range;

impl Network {
    /// Brings the springs of the particles `changed` in line with `row`, which lists a particle's springs as `(other, weight)`.
    /// The network then has `particles` particles; new ones start at rest at 0 with a mass of 1, and those beyond are dropped, with their
    /// springs. `changed` (sorted, each once) names both ends of every spring that came, went or changed. As after
    /// [`Network::set_topology`], state is kept by particle and only those away from rest are woken; the order of rows differs.
    pub fn update_springs<R>(&mut self, particles: usize, changed: &[ParticleId], row: impl Fn(usize) -> R)
    where
        R: IntoIterator<Item = (u32, f32)>,
    {
        debug_assert!(changed.windows(2).all(|w| w[0] < w[1]));
        self.append_rows(particles);
        let dropped = particles..self.len();
        let sound = |p: usize, (other, weight): &(u32, f32)| {
            *other as usize != p && (*other as usize) < particles && weight.is_finite() && *weight > 0.0
        };
        let mut swapped = false;
        for p in changed.iter().map(|p| p.index()).filter(|&p| p < particles) {
            let has_springs = row(p).into_iter().any(|spring| sound(p, &spring));
            swapped |= self.change_camp(p, has_springs);
        }
        for p in dropped.clone() {
            swapped |= self.change_camp(p, false);
        }
        let mut springs = std::mem::take(&mut self.springs);
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
        self.springs = springs;
        swapped |= !dropped.is_empty();
        self.drop_rows(dropped);
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

    /// Tells where the network has not `particles` particles, or other springs than `row` lists of each as `(other, weight)`.
    pub fn check_springs<R>(&self, particles: usize, row: impl Fn(usize) -> R) -> Result<(), String>
    where
        R: IntoIterator<Item = (u32, f32)>,
    {
        if self.len() != particles {
            return Err(format!("{} particles in the network, {particles} in the map", self.len()));
        }
        let (mut has, mut should) = (Vec::new(), Vec::new());
        for p in 0..particles {
            let own = self.row_of[p] as usize;
            has.clear();
            has.extend(self.matrix.springs(own).filter(|spring| spring.1 != 0.0));
            should.clear();
            should.extend(row(p).into_iter().filter(|s| s.0 as usize != p && s.1.is_finite() && s.1 > 0.0).map(
                |(other, weight)| {
                    let other = self.row_of.get(other as usize).copied().unwrap_or(u32::MAX);
                    let mass = self.masses.get(other as usize).map_or(f64::NAN, |mass| 0.5 * (self.masses[own] + mass));
                    (other, f64::from(weight) * mass)
                },
            ));
            has.sort_unstable_by_key(|spring| spring.0);
            should.sort_unstable_by_key(|spring| spring.0);
            let alike = |(a, b): (&(u32, f64), &(u32, f64))| a.0 == b.0 && (a.1 - b.1).abs() <= 1e-6 * b.1;
            if has.len() != should.len() || !has.iter().zip(&should).all(alike) || (own < self.linked) == has.is_empty() {
                return Err(format!(
                    "particle {p} has {} springs in the network and {} in the map, or others",
                    has.len(),
                    should.len()
                ));
            }
        }
        Ok(())
    }

    /// A network of some of this one's particles, which keep state, targets and holds: `kept[new]` is the old particle, or
    /// [`ParticleId::NONE`] for a new one, at rest at 0 with a mass of 1. `row(new)` lists the springs of each as `(other,
    /// weight)`, in both their rows. Rows keep their order, so that neighbours stay near each other. Those away from rest are
    /// awake. Takes time in proportion to both networks' particles and the springs that are left.
    pub fn subset<R>(&self, kept: &[ParticleId], row: impl Fn(usize) -> R) -> Self
    where
        R: IntoIterator<Item = (u32, f32)>,
    {
        let n = kept.len();
        let sound = |new: u32, (other, weight): &(u32, f32)| {
            *other != new && (*other as usize) < n && weight.is_finite() && *weight > 0.0
        };
        let linked = |new: u32| row(new as usize).into_iter().any(|spring| sound(new, &spring));
        let mut subset = self.rows_of(kept, linked);
        for (new, mass) in subset.order.iter().zip(&subset.masses) {
            let springs = row(*new as usize).into_iter().filter(|spring| sound(*new, spring));
            let springs = springs.map(|(other, weight)| {
                let other = subset.row_of[other as usize];
                (other, (f64::from(weight) * (0.5 * (mass + subset.masses[other as usize]))) as f32)
            });
            subset.matrix.push_row(springs, self.settings.coupling, *mass);
        }
        subset.matrix.settle_rows();
        subset.restart_activity();
        subset
    }

    /// [`Network::subset`] with the springs that this network has, between those particles of the subset that are still `tied` (asked by
    /// their new numbers). Faster: the rows are copied.
    pub fn part(&self, kept: &[ParticleId], tied: impl Fn(usize) -> bool) -> Self {
        let mut goes_on = vec![false; self.len()];
        for (_, old) in kept.iter().enumerate().filter(|(new, old)| old.is_some() && tied(*new)) {
            goes_on[self.row_of[old.index()] as usize] = true;
        }
        let is_linked = |old: ParticleId| {
            let row = self.row_of[old.index()] as usize;
            goes_on[row] && self.matrix.neighbours(row).any(|other| other as usize != row && goes_on[other as usize])
        };
        let mut part = self.rows_of(kept, |new| kept.get(new as usize).is_some_and(|old| old.is_some() && is_linked(*old)));
        let mut new_row = vec![u32::MAX; self.len()];
        for (row, new) in (0u32..).zip(&part.order[..part.linked]) {
            new_row[self.row_of[kept[*new as usize].index()] as usize] = row;
        }
        for new in &part.order[..part.linked] {
            part.matrix.push_part(&self.matrix, self.row_of[kept[*new as usize].index()] as usize, &new_row);
        }
        for mass in &part.masses[part.linked..] {
            part.matrix.push_lone_row(self.settings.coupling, *mass);
        }
        part.matrix.settle_rows();
        part.restart_activity();
        part
    }

    /// What [`Network::subset`] says of all but the springs; the matrix has no row yet. `is_linked` tells of a new number whether the
    /// particle will have springs.
    fn rows_of(&self, kept: &[ParticleId], is_linked: impl Fn(u32) -> bool) -> Self {
        let n = kept.len();
        let mut new_of = vec![u32::MAX; self.len()];
        for (new, old) in kept.iter().enumerate().filter(|(_, old)| old.is_some()) {
            new_of[old.index()] = new as u32;
        }
        let known = self.order.iter().map(|old| new_of[*old as usize]).filter(|new| *new != u32::MAX);
        let fresh = (0..n as u32).filter(|new| kept[*new as usize].is_none());
        // those with springs from the front, lone ones from the back
        let (mut order, mut linked, mut lone) = (vec![0; n], 0, n);
        for new in known.chain(fresh) {
            if is_linked(new) {
                order[linked] = new;
                linked += 1;
            } else {
                lone -= 1;
                order[lone] = new;
            }
        }
        order[linked..].reverse();
        let mut row_of = vec![0; n];
        for (row, new) in order.iter().enumerate() {
            row_of[*new as usize] = row as u32;
        }
        let old_row = |new: &u32| self.row_of.get(kept[*new as usize].index()).copied().unwrap_or(u32::MAX);
        let old_rows: Vec<u32> = order.iter().map(old_row).collect();
        let has_fresh = kept.iter().any(|old| old.is_none());
        let carried = |values: &[Lanes]| -> Vec<Lanes> {
            if has_fresh {
                return old_rows.iter().map(|row| values.get(*row as usize).copied().unwrap_or_default()).collect();
            }
            old_rows.iter().map(|row| values[*row as usize]).collect()
        };
        let mass = |row: &u32| self.masses.get(*row as usize).copied().unwrap_or(1.0);
        let renamed = |row: u32| row_of.get(new_of[self.order[row as usize] as usize] as usize).copied();
        let mut rows = Self {
            settings: self.settings,
            length: self.length,
            matrix: self.matrix.room_like(n),
            linked,
            masses: old_rows.iter().map(mass).collect(),
            e: carried(&self.e),
            v: carried(&self.v),
            rest: carried(&self.rest),
            force: carried(&self.force),
            next_rest: carried(&self.next_rest),
            moved: self.moved.iter().filter_map(|row| renamed(*row)).collect(),
            grabs: self.grabs.iter().filter_map(|grab| Some(Grab { row: renamed(grab.row)?, ..*grab })).collect(),
            held: vec![false; n],
            ..Self::default()
        };
        for grab in &rows.grabs {
            rows.held[grab.row as usize] = true;
        }
        rows.displacement = row_of.iter().map(|row| unpadded(&rows.u(*row as usize)).into()).collect();
        (rows.order, rows.row_of) = (order, row_of);
        rows.reserve_lists(n);
        rows
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
        self.resize_turns(particles);
        // so that a steady step allocates nothing
        self.reserve_lists(particles);
    }

    /// Drops particles, the last ones, whose springs no other row names any more.
    fn drop_rows(&mut self, particles: Range<usize>) {
        let left = particles.start;
        for p in particles.clone() {
            let row = self.row_of[p] as usize;
            self.matrix.replace_row(row, &[], self.settings.coupling, self.masses[row]);
        }
        for p in particles.rev() {
            // as many rows as particles are left: this one goes to the end
            self.swap_rows(self.row_of[p] as usize, p);
            self.matrix.pop_row();
        }
        self.moved.retain(|row| (*row as usize) < left);
        self.grabs.retain(|grab| (grab.row as usize) < left);
        for vector in [&mut self.e, &mut self.v, &mut self.rest, &mut self.force, &mut self.next_rest] {
            vector.truncate(left);
        }
        self.order.truncate(left);
        self.row_of.truncate(left);
        self.masses.truncate(left);
        self.held.truncate(left);
        self.displacement.truncate(left);
        self.resize_turns(left);
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

    fn sorted(changed: &[ParticleId], particles: usize) -> Vec<ParticleId> {
        let mut changed: Vec<_> = changed.iter().copied().filter(|p| p.index() < particles).collect();
        changed.sort_unstable();
        changed.dedup();
        changed
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
            // the last ones go, and what they had springs to is told of
            for _ in 0..if round % 16 == 9 { 1 + pick(3) } else { 0 } {
                let last = rows.len() - 1;
                for (other, weight) in rows[last].clone() {
                    toggle(&mut rows, last, other as usize, weight);
                    changed.push(ParticleId(other));
                }
                rows.pop();
                // in place of it a new one may come
                if pick(2) == 0 && !changed.is_empty() {
                    network.update_springs(rows.len(), &sorted(&changed, rows.len()), |p| rows[p].iter().copied());
                    rows.push(Vec::new());
                }
            }
            for _ in 0..1 + pick(4) {
                let (a, b) = (pick(rows.len()), pick(rows.len()));
                if a != b {
                    toggle(&mut rows, a, b, 0.5 + pick(8) as f32);
                    changed.extend([a, b].map(ParticleId::new));
                }
            }
            network.update_springs(rows.len(), &sorted(&changed, rows.len()), |p| rows[p].iter().copied());
            assert_eq!(network.len(), rows.len());
            assert_eq!(agree(&network, &rows), Ok(()), "round {round}");
            assert_eq!(network.check_springs(rows.len(), |p| rows[p].iter().copied()), Ok(()), "round {round}");
            network.step(0.003, &mut scratch);
        }
        // the comparison can fail: a spring that the network was not told of
        let (a, b) = (0, rows.len() - 1);
        network.set_state(ParticleId::new(a), DVec3::ONE, DVec3::ZERO);
        toggle(&mut rows, a, b, 3.0);
        assert!(agree(&network, &rows).is_err());
        assert!(network.check_springs(rows.len(), |p| rows[p].iter().copied()).is_err());
    }

    #[test]
    fn a_subset_moves_as_a_network_built_anew() {
        let mut rows: Rows = vec![Vec::new(); 30];
        for p in 0..30usize {
            for step in [1, 7] {
                toggle(&mut rows, p, (p + step) % 30, 0.5 + (p % 5) as f32);
            }
        }
        let mut network = Network::new(&topology(&rows), NetworkSettings::SOFT, 1e-30).unwrap();
        for p in 0..30 {
            network.set_state(ParticleId::new(p), DVec3::new(0.1 * p as f64, 1.0, -0.3), DVec3::X * p as f64);
        }
        network.set_rest_displacement(ParticleId(4), DVec3::Y);
        network.set_grabs(&[(ParticleId(8), DVec3::Z), (ParticleId(9), DVec3::Z)]);
        // some particles, one of them lone in the end, and a new one
        let mut kept: Vec<ParticleId> = [0, 1, 2, 3, 4, 7, 8, 20, 25].map(ParticleId).to_vec();
        kept.push(ParticleId::NONE);
        let new = |old: u32| kept.iter().position(|k| k.0 == old).map(|new| new as u32);
        let of = |k: &ParticleId| match rows.get(k.index()) {
            Some(row) => row.iter().filter_map(|s| Some((new(s.0)?, s.1))).filter(|s| k.0 != 20 && s.0 != 7).collect(),
            None => Vec::new(),
        };
        let part: Rows = kept.iter().map(of).collect();
        let mut subset = network.subset(&kept, |p| part[p].iter().copied());
        assert_eq!((subset.len(), subset.linked), (10, part.iter().filter(|row| !row.is_empty()).count()));
        for (new, old) in kept.iter().enumerate().take(9) {
            let new = ParticleId::new(new);
            assert_eq!((subset.displacement(new), subset.velocity(new)), (network.displacement(*old), network.velocity(*old)));
            assert_eq!(subset.is_grabbed(new), old.0 == 8);
        }
        subset.set_grabs(&[]);
        assert_eq!(subset.next_rest[subset.row_of[4] as usize][1], 1.0);
        subset.set_rest_displacement(ParticleId(4), DVec3::ZERO);
        assert_eq!(agree(&subset, &part), Ok(()));
        // the comparison can fail: a spring that only one of them has
        let mut other = part.clone();
        toggle(&mut other, 0, 5, 2.0);
        assert!(agree(&subset, &other).is_err());
        // the same from this network's own springs, in all orders of who goes on
        for shift in 0..kept.len() {
            kept.rotate_left(1);
            for untied in [20, 3] {
                let place = |old: u32| kept.iter().position(|k| k.0 == old);
                let new = |old: u32| place(old).filter(|_| old != untied).map(|new| new as u32);
                let of = |k: &ParticleId| match rows.get(k.index()).filter(|_| k.0 != untied) {
                    Some(row) => row.iter().filter_map(|s| Some((new(s.0)?, s.1))).collect(),
                    None => Vec::new(),
                };
                let expected: Rows = kept.iter().map(of).collect();
                let mut part = network.part(&kept, |p| kept[p].0 != untied);
                let told = network.subset(&kept, |p| expected[p].iter().copied());
                let state = |n: &Network| (n.order.clone(), n.linked, n.matrix.entries(), n.displacement.clone(), n.held.clone());
                assert_eq!(state(&part), state(&told), "{shift}");
                part.set_grabs(&[]);
                part.set_rest_displacement(ParticleId::new(place(4).unwrap()), DVec3::ZERO);
                assert_eq!(agree(&part, &expected), Ok(()), "{shift}");
            }
        }
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
