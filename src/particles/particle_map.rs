//! The particle map: which particle moves which vertex, and which particles are neighbours (MATHS 3.1).

use crate::geometry::{Delta, ParticleId, SlotCsr, SlotCsrDelta, StateHash, Tracked, VertexId};
use bytemuck::{Pod, Zeroable};

/// Room for the rows of neighbours that edits write anew: each wound particle lengthens the rows of a dozen others.
const RELINKED_ROOM: usize = 1 << 16;

/// A particle's hold on a vertex. Weights of a vertex sum to 1 where any particle reaches it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Influence {
    /// The particle.
    pub particle: ParticleId,
    /// Normalised weight, 0 to 1.
    pub weight: f32,
}

/// A spring between two particles, listed in both their rows with the same weight.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Link {
    /// The other particle.
    pub particle: ParticleId,
    /// Relative stiffness, inversely proportional to the rest distance; 1 at the mean distance.
    pub weight: f32,
}

/// Anchors, influences and neighbours of one tissue's particles.
#[derive(Clone, Debug, Default)]
pub struct ParticleMap {
    /// The vertex each particle is anchored to; [`VertexId::NONE`] for a retired particle.
    pub anchors: Tracked<VertexId>,
    /// Displacement `u0` at rest in the anchor's rest frame, metres (MATHS 3.3); zero but for wound particles.
    pub rest_displacement: Tracked<[f64; 3]>,
    /// One row a vertex (rows: [`crate::geometry::Mesh::vertex_slots`]).
    pub influences: SlotCsr<Influence>,
    /// One row a particle.
    pub neighbours: SlotCsr<Link>,
    /// Length of a link of weight 1, metres: the mean when the map was built. 0 where there was no link.
    pub mean_link: f64,
}

/// What an edit changed in a [`ParticleMap`].
#[derive(Clone, Debug, Default)]
pub struct ParticleMapDelta {
    /// Changes of the anchors.
    pub anchors: Delta<VertexId>,
    /// Changes of the rest displacements.
    pub rest_displacement: Delta<[f64; 3]>,
    /// Changes of the influences.
    pub influences: SlotCsrDelta<Influence>,
    /// Changes of the neighbours.
    pub neighbours: SlotCsrDelta<Link>,
}

impl ParticleMapDelta {
    /// [`Delta::make_room`] for every list.
    pub fn make_room(&mut self, edits: usize) {
        self.anchors.make_room(edits);
        self.rest_displacement.make_room(edits);
        self.influences.make_room(edits);
        self.neighbours.make_room(edits);
    }

    /// Adds what the next edit changed.
    pub fn append(&mut self, later: &Self) {
        self.anchors.append(&later.anchors);
        self.rest_displacement.append(&later.rest_displacement);
        self.influences.append(&later.influences);
        self.neighbours.append(&later.neighbours);
    }
}

impl ParticleMap {
    /// Number of particle slots, retired ones included.
    pub fn len(&self) -> usize {
        self.anchors.len()
    }

    /// True if there are no particles.
    pub fn is_empty(&self) -> bool {
        self.anchors.is_empty()
    }

    /// Everything changed since the last call.
    pub fn take_delta(&mut self) -> ParticleMapDelta {
        let mut delta = ParticleMapDelta::default();
        self.take_delta_into(&mut delta);
        delta
    }

    /// The same into a delta whose room is used again.
    pub fn take_delta_into(&mut self, delta: &mut ParticleMapDelta) {
        self.anchors.take_delta_into(&mut delta.anchors);
        self.rest_displacement.take_delta_into(&mut delta.rest_displacement);
        self.influences.take_delta_into(&mut delta.influences);
        self.neighbours.take_delta_into(&mut delta.neighbours);
    }

    /// Goes back by the newest delta and returns the way forward.
    pub fn apply_delta(&mut self, delta: ParticleMapDelta) -> ParticleMapDelta {
        ParticleMapDelta {
            anchors: self.anchors.apply(delta.anchors),
            rest_displacement: self.rest_displacement.apply(delta.rest_displacement),
            influences: self.influences.apply_delta(delta.influences),
            neighbours: self.neighbours.apply_delta(delta.neighbours),
        }
    }

    /// Makes room in every array for what edits will append.
    pub fn make_room(&mut self) {
        self.anchors.make_room();
        self.rest_displacement.make_room();
        self.influences.make_room();
        self.neighbours.make_room();
        self.neighbours.reserve(0, RELINKED_ROOM);
    }

    /// Feeds the map into `hash`.
    pub fn hash_into(&self, hash: &mut StateHash) {
        self.anchors.hash_into(hash);
        self.rest_displacement.hash_into(hash);
        self.influences.hash_into(hash);
        self.neighbours.hash_into(hash);
    }
}
