//! Models in and out.
