//! The linear particle network and its exact propagation.

pub mod propagator;
pub mod series;
pub mod settings;
pub mod topology;
