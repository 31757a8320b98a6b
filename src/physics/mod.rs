//! The linear particle network and its exact propagation (MATHS 4), direct displacement (MATHS 3.4), and contact with the
//! rigid world (MATHS 4.4).
//!
//! [`Network`] holds displacement and velocity of the particles; [`Network::step`] moves them. Built from a
//! [`NetworkTopology`] and [`NetworkSettings`]; [`mod@reference`] holds what it is judged by. [`RigidWorld`] holds instruments,
//! hands and loose pieces; [`Contacts`] is what one soft layer touches of it.

mod activity;
mod body;
pub mod contact;
pub mod direct_displacement;
mod hulls;
mod implicit;
mod matrix;
mod network;
mod patch;
pub mod propagator;
pub mod reference;
mod rigid;
mod rotation;
pub mod series;
mod settings;
mod step;
mod topology;
mod world;

#[cfg(test)]
mod contact_tests;
#[cfg(test)]
mod laws;
#[cfg(test)]
mod world_tests;

pub use contact::{Contacts, Skin};
pub use network::{INPUT_LIMIT, Network, REST_THRESHOLD};
pub use rigid::{RigidPose, RigidShape};
pub use settings::{NetworkSettings, SettingsError};
pub use step::{ERROR_PER_SECOND, LEAST_STEP, MAX_STEP, SERIES_REACH, SERIES_WORK, StepMethod, StepReport, StepScratch};
pub use topology::NetworkTopology;
pub use world::{BodyId, FARTHEST, GRAVITY, MAX_SUBSTEPS, RIGID_STEP, RigidWorld};
