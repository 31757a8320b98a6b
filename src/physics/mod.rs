//! The linear particle network and its exact propagation (MATHS 4), and direct displacement (MATHS 3.4).
//!
//! [`Network`] holds displacement and velocity of the particles; [`Network::step`] moves them. Built from a
//! [`NetworkTopology`] and [`NetworkSettings`]; [`mod@reference`] holds what it is judged by.

mod activity;
pub mod direct_displacement;
mod implicit;
mod matrix;
mod network;
pub mod propagator;
pub mod reference;
pub mod series;
mod settings;
mod step;
mod topology;

#[cfg(test)]
mod laws;

pub use network::{INPUT_LIMIT, Network, REST_THRESHOLD};
pub use settings::{NetworkSettings, SettingsError};
pub use step::{ERROR_PER_SECOND, MAX_STEP, SERIES_REACH, SERIES_WORK, StepMethod, StepReport, StepScratch};
pub use topology::NetworkTopology;
