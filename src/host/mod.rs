//! Hosts own their loops: headless, a window; a headset comes beside them.

#[cfg(feature = "desktop")]
pub mod desktop;
pub mod headless;
mod instruments;
mod layers;
pub mod mirror;
#[cfg(feature = "vr")]
pub mod vr;
