//! Who is tied to whom: the springs between particles, in CSR, and an order of the particles that keeps neighbours close.

/// Neighbour springs of a network: symmetric CSR, one row a particle. No self-links, finite positive weights only.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NetworkTopology {
    offsets: Vec<u32>,
    columns: Vec<u32>,
    weights: Vec<f32>,
}

impl NetworkTopology {
    /// From springs `(a, b, weight)`, each listed once, in any order. Springs that name a particle out of range or twice
    /// the same, or whose weight is not finite and positive, are dropped.
    pub fn from_pairs(particles: usize, pairs: impl Iterator<Item = (u32, u32, f32)> + Clone) -> Self {
        let mut topology = Self::default();
        topology.set_pairs(particles, pairs);
        topology
    }

    /// From one row a particle that lists every spring in both its rows, as the particle map does; the weight in the
    /// row of the lower index counts.
    pub fn from_rows<R>(particles: usize, row: impl Fn(usize) -> R) -> Self
    where
        R: IntoIterator<Item = (u32, f32)>,
    {
        let mut topology = Self::default();
        topology.set_rows(particles, row);
        topology
    }

    /// As [`Self::from_pairs`], reusing the memory.
    pub fn set_pairs(&mut self, particles: usize, pairs: impl Iterator<Item = (u32, u32, f32)> + Clone) {
        self.build(particles, |visit| pairs.clone().for_each(|(a, b, weight)| visit(a, b, weight)));
    }

    /// As [`Self::from_rows`], reusing the memory.
    pub fn set_rows<R>(&mut self, particles: usize, row: impl Fn(usize) -> R)
    where
        R: IntoIterator<Item = (u32, f32)>,
    {
        self.build(particles, |visit| {
            for a in 0..particles {
                for (b, weight) in row(a) {
                    if b as usize > a {
                        visit(a as u32, b, weight);
                    }
                }
            }
        });
    }

    /// Count, scan, fill over the springs that `each` visits, twice and in the same order.
    fn build(&mut self, particles: usize, each: impl Fn(&mut dyn FnMut(u32, u32, f32))) {
        let count = particles as u32;
        let sound = |a: u32, b: u32, weight: f32| a != b && a < count && b < count && weight.is_finite() && weight > 0.0;
        self.offsets.clear();
        self.offsets.resize(particles + 1, 0);
        each(&mut |a, b, weight| {
            if sound(a, b, weight) {
                self.offsets[a as usize] += 1;
                self.offsets[b as usize] += 1;
            }
        });
        let mut total = 0;
        for offset in &mut self.offsets {
            total += *offset;
            *offset = total;
        }
        // Offsets now hold the row ends; filling from the back turns them into starts.
        self.columns.clear();
        self.columns.resize(total as usize, 0);
        self.weights.clear();
        self.weights.resize(total as usize, 0.0);
        each(&mut |a, b, weight| {
            if sound(a, b, weight) {
                for (row, column) in [(a, b), (b, a)] {
                    let at = &mut self.offsets[row as usize];
                    *at -= 1;
                    self.columns[*at as usize] = column;
                    self.weights[*at as usize] = weight;
                }
            }
        });
    }

    /// Number of particles.
    pub fn particles(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Number of springs.
    pub fn springs(&self) -> usize {
        self.columns.len() / 2
    }

    /// Neighbours of a particle and the spring weights.
    #[inline]
    pub fn row(&self, particle: usize) -> (&[u32], &[f32]) {
        let span = self.offsets[particle] as usize..self.offsets[particle + 1] as usize;
        (&self.columns[span.clone()], &self.weights[span])
    }

    /// Checks the structure from scratch: spans in order, columns in range, no self-link, symmetric positive weights.
    pub fn validate(&self) -> Result<(), String> {
        let n = self.particles();
        if n > 0 && (self.offsets[n] as usize != self.columns.len() || self.columns.len() != self.weights.len()) {
            return Err("the last offset is not the number of entries".into());
        }
        for a in 0..n {
            if self.offsets[a] > self.offsets[a + 1] {
                return Err(format!("row {a} ends before it starts"));
            }
            let (columns, weights) = self.row(a);
            for (b, weight) in columns.iter().zip(weights) {
                if *b as usize >= n || *b as usize == a {
                    return Err(format!("row {a} names particle {b}"));
                }
                if !(weight.is_finite() && *weight > 0.0) {
                    return Err(format!("spring {a}-{b} has weight {weight}"));
                }
                let (back, back_weights) = self.row(*b as usize);
                if !back.iter().zip(back_weights).any(|(c, w)| *c as usize == a && w == weight) {
                    return Err(format!("spring {a}-{b} is not in row {b}"));
                }
            }
        }
        Ok(())
    }

    /// Writes an order of the particles (Cuthill-McKee: breadth first, component by component) into `order`, particles
    /// without springs last, and returns the number of particles that have any. Neighbours end up near each other, so
    /// that a pass over the matrix stays in the cache.
    pub fn cuthill_mckee(&self, order: &mut Vec<u32>, seen: &mut Vec<bool>) -> usize {
        let n = self.particles();
        order.clear();
        order.reserve(n);
        seen.clear();
        seen.resize(n, false);
        for start in 0..n {
            if seen[start] || self.row(start).0.is_empty() {
                continue;
            }
            // One sweep finds a far end of the component, the next starts there: long and thin, small bandwidth.
            let first = order.len();
            self.sweep(start as u32, order, seen);
            let far = order[order.len() - 1];
            for k in first..order.len() {
                seen[order[k] as usize] = false;
            }
            order.truncate(first);
            self.sweep(far, order, seen);
        }
        let linked = order.len();
        order.extend((0..n as u32).filter(|p| self.row(*p as usize).0.is_empty()));
        linked
    }

    fn sweep(&self, start: u32, order: &mut Vec<u32>, seen: &mut [bool]) {
        let mut next = order.len();
        seen[start as usize] = true;
        order.push(start);
        while next < order.len() {
            for b in self.row(order[next] as usize).0 {
                if !std::mem::replace(&mut seen[*b as usize], true) {
                    order.push(*b);
                }
            }
            next += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_and_rows_build_the_same_valid_network() {
        let pairs = [(0, 1, 1.0), (2, 1, 0.5), (4, 0, 2.0)];
        let a = NetworkTopology::from_pairs(6, pairs.into_iter());
        assert_eq!((a.particles(), a.springs()), (6, 3));
        a.validate().unwrap();
        let rows: Vec<Vec<(u32, f32)>> =
            (0..6).map(|p| a.row(p).0.iter().copied().zip(a.row(p).1.iter().copied()).collect()).collect();
        let b = NetworkTopology::from_rows(6, |p| rows[p].iter().copied());
        b.validate().unwrap();
        assert_eq!(b.springs(), 3);
    }

    #[test]
    fn nonsense_springs_are_dropped() {
        let pairs = [(0, 0, 1.0), (0, 9, 1.0), (0, 1, f32::NAN), (0, 1, -1.0), (1, 2, 0.0), (1, 2, 1.0)];
        let a = NetworkTopology::from_pairs(3, pairs.into_iter());
        a.validate().unwrap();
        assert_eq!(a.springs(), 1);
        NetworkTopology::from_pairs(0, std::iter::empty()).validate().unwrap();
    }

    #[test]
    fn each_broken_rule_is_found() {
        let good = NetworkTopology::from_pairs(3, [(0, 1, 1.0), (1, 2, 1.0)].into_iter());
        let broken = |change: fn(&mut NetworkTopology)| {
            let mut t = good.clone();
            change(&mut t);
            t.validate()
        };
        assert!(broken(|_| ()).is_ok());
        assert!(broken(|t| t.offsets[3] = 3).is_err());
        assert!(broken(|t| t.columns[0] = 7).is_err());
        assert!(broken(|t| t.columns[0] = 0).is_err());
        assert!(broken(|t| t.weights[0] = 2.0).is_err());
        assert!(broken(|t| t.weights.iter_mut().for_each(|w| *w = -1.0)).is_err());
    }

    #[test]
    fn the_order_is_a_permutation_with_lone_particles_last() {
        let t = NetworkTopology::from_pairs(7, [(6, 2, 1.0), (2, 4, 1.0), (1, 5, 1.0)].into_iter());
        let (mut order, mut seen) = (Vec::new(), Vec::new());
        let linked = t.cuthill_mckee(&mut order, &mut seen);
        assert_eq!(linked, 5);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..7).collect::<Vec<_>>());
        assert_eq!(&order[5..], &[0, 3]);
    }
}
