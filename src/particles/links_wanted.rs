//! Links that an update is to test, by particle, and particles in order: without sorting.

use crate::geometry::room::fit;
use crate::geometry::{ParticleId, VertexId};

/// Vertices by particle, in chains: nothing is sorted.
#[derive(Clone, Debug, Default)]
pub(super) struct LinksWanted {
    /// The last link of each particle, one more than its index; 0 for none.
    last: Vec<u32>,
    /// Particle, vertex, and the link of the same particle before.
    links: Vec<(ParticleId, VertexId, u32)>,
}

impl LinksWanted {
    pub(super) fn make_room(&mut self, particles: usize, links: usize) {
        fit(&mut self.last, particles, 0);
        self.links.reserve(links);
    }

    /// Forgets all.
    pub(super) fn begin(&mut self, particles: usize) {
        self.links.iter().for_each(|link| self.last[link.0.index()] = 0);
        self.links.clear();
        fit(&mut self.last, particles, 0);
    }

    pub(super) fn push(&mut self, j: ParticleId, v: VertexId) {
        self.links.push((j, v, self.last[j.index()]));
        self.last[j.index()] = self.links.len() as u32;
    }

    /// Sets the bits of the particles that there are links of.
    pub(super) fn particles(&self, bits: &mut ParticleBits) {
        self.links.iter().for_each(|link| bits.set(link.0));
    }

    /// The vertices of a particle's links, the last first.
    pub(super) fn of(&self, j: ParticleId) -> impl Iterator<Item = VertexId> + '_ {
        let mut next = self.last[j.index()];
        std::iter::from_fn(move || {
            let (_, v, before) = *self.links.get((next as usize).checked_sub(1)?)?;
            next = before;
            Some(v)
        })
    }
}

/// A bit a particle, none of them set between uses.
#[derive(Clone, Debug, Default)]
pub(super) struct ParticleBits(Vec<u64>);

impl ParticleBits {
    pub(super) fn fit(&mut self, particles: usize) {
        fit(&mut self.0, particles.div_ceil(64), 0);
    }

    pub(super) fn set(&mut self, j: ParticleId) {
        self.0[j.index() / 64] |= 1 << (j.index() % 64);
    }

    /// Clears all bits, and calls `found` for those that were set, ascending.
    pub(super) fn drain(&mut self, mut found: impl FnMut(ParticleId)) {
        for (word, bits) in self.0.iter_mut().enumerate() {
            while *bits != 0 {
                found(ParticleId::new(64 * word + bits.trailing_zeros() as usize));
                *bits &= *bits - 1;
            }
        }
    }

    /// Puts a list in order, each once.
    pub(super) fn sort(&mut self, list: &mut Vec<ParticleId>) {
        list.drain(..).for_each(|j| self.set(j));
        self.drain(|j| list.push(j));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_come_back_by_particle_and_lists_in_order() {
        let (mut wanted, mut bits) = (LinksWanted::default(), ParticleBits::default());
        for round in 0..3 {
            wanted.begin(200);
            for (j, v) in [(130, 7), (3, 1), (130, 9), (64, 2), (130, 8)].iter().skip(round) {
                wanted.push(ParticleId(*j), VertexId(*v));
            }
            bits.fit(200);
            wanted.particles(&mut bits);
            let mut found = Vec::new();
            bits.drain(|j| found.push((j.0, wanted.of(j).map(|v| v.0).collect::<Vec<_>>())));
            let expected = [
                vec![(3, vec![1]), (64, vec![2]), (130, vec![8, 9, 7])],
                vec![(3, vec![1]), (64, vec![2]), (130, vec![8, 9])],
                vec![(64, vec![2]), (130, vec![8, 9])],
            ];
            assert_eq!(found, expected[round]);
            assert_eq!(wanted.of(ParticleId(5)).next(), None);
        }
        let mut list = [70, 3, 70, 0, 199].map(ParticleId).to_vec();
        bits.sort(&mut list);
        assert_eq!(list, [0, 3, 70, 199].map(ParticleId));
    }
}
