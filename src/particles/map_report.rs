//! What an update of the particle map did.

use crate::geometry::{ParticleId, VertexId};

/// What [`super::update_after_edit`] or [`super::release_wound`] did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapUpdateReport {
    /// Vertices whose influences changed, each once. New vertices are among them.
    pub vertices_changed: Vec<VertexId>,
    /// Particles whose anchor, rest displacement or neighbours changed, sorted. New particles are among them.
    pub particles_changed: Vec<ParticleId>,
    /// Particles whose neighbours changed, sorted.
    pub relinked: Vec<ParticleId>,
    /// Particles added, wound particles and others.
    pub particles_added: Vec<ParticleId>,
    /// Particles whose anchor was clipped and that found no other.
    pub retired: Vec<ParticleId>,
    /// Particles whose anchor was clipped and replaced.
    pub reanchored: Vec<ParticleId>,
    /// Neighbour pairs removed since they crossed a new strip or lost an end.
    pub links_removed: usize,
    /// Influences removed since they crossed a new strip.
    pub influences_removed: usize,
    /// Vertices that the update looked at, once for each particle and strip that it looked at them for.
    pub vertices_visited: usize,
}

impl MapUpdateReport {
    /// Nothing, in the same lists.
    pub(super) fn emptied(self) -> Self {
        let Self { mut vertices_changed, mut particles_changed, mut relinked, mut particles_added, .. } = self;
        let Self { mut retired, mut reanchored, .. } = self;
        vertices_changed.clear();
        let lists = [&mut particles_changed, &mut relinked, &mut particles_added, &mut retired, &mut reanchored];
        lists.into_iter().for_each(Vec::clear);
        let counts = Self::default();
        Self { vertices_changed, particles_changed, relinked, particles_added, retired, reanchored, ..counts }
    }
}
