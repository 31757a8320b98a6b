//! The soft layer: sampling, the particle map, strips, the update after a wound (MATHS 3).

pub mod particle_map;

pub use particle_map::{Influence, Link, ParticleMap, ParticleMapDelta};
