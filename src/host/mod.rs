//! Hosts own their loops: headless here; window and headset come beside it.

pub mod headless;
mod layers;
