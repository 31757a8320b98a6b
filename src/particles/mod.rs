//! The soft layer: sampling, the particle map, strips, the update after a wound (MATHS 3).

pub mod anchor_grid;
pub mod build;
pub mod flood;
pub mod particle_map;
pub mod poisson;
pub mod random;
pub mod settings;
pub mod strip_test;
pub mod strips;
#[cfg(test)]
mod test_models;

pub use particle_map::{Influence, Link, ParticleMap, ParticleMapDelta};
pub use build::{BuildReport, sigmoid_weight};
pub use poisson::sample;
pub use settings::{ParticleSettings, SettingsError, WoundSettings};
pub use strips::{LipSide, Strip, StripError, Strips, StripsDelta, WoundMark};
