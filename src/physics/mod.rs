//! The linear particle network and its exact propagation.
