//! Where the particles near a wound are and how far they reach, side by side: an update asks for the same few, again and again.

use super::particle_map::ParticleMap;
use super::settings::{ParticleSettings, Reach};
use crate::geometry::room::fit;
use crate::geometry::{ParticleId, VertexId};
use glam::DVec3;

/// Reaches by particle, for one update.
#[derive(Clone, Debug, Default)]
pub(super) struct Reaches {
    /// With the update it was worked out for.
    of: Vec<(u32, Reach)>,
    round: u32,
}

impl Reaches {
    /// Makes room for so many particles.
    pub(super) fn make_room(&mut self, particles: usize) {
        self.of.reserve(particles);
    }

    /// Forgets all.
    pub(super) fn begin(&mut self, particles: usize) {
        if self.round == u32::MAX {
            self.of.clear();
            self.round = 0;
        }
        self.round += 1;
        fit(&mut self.of, particles, (0, Reach::NONE));
    }

    /// Works out that of an anchored particle.
    pub(super) fn note(&mut self, settings: &ParticleSettings, map: &ParticleMap, rest: &[DVec3], j: ParticleId) {
        fit(&mut self.of, j.index() + 1, (0, Reach::NONE));
        self.of[j.index()] = (self.round, settings.reach_of(map, rest, j));
    }

    /// Forgets that of a particle.
    pub(super) fn forget(&mut self, j: ParticleId) {
        if let Some(known) = self.of.get_mut(j.index()) {
            known.0 = 0;
        }
    }

    /// [`ParticleSettings::weight`].
    #[inline]
    pub(super) fn weight(
        &self,
        settings: &ParticleSettings,
        map: &ParticleMap,
        rest: &[DVec3],
        v: VertexId,
        j: ParticleId,
    ) -> f64 {
        match self.of.get(j.index()) {
            Some((round, reach)) if *round == self.round => settings.weight_within(reach, rest[v.index()]),
            _ => settings.weight(map, rest, v, j),
        }
    }
}
