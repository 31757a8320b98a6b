//! Hosts own their loops: headless, a window, a headset.

#[cfg(feature = "desktop")]
pub mod desktop;
pub mod headless;
mod instruments;
pub mod layers;
pub mod mirror;
#[cfg(any(feature = "desktop", feature = "vr"))]
pub mod models;
#[cfg(feature = "vr")]
pub mod spectator;
#[cfg(feature = "vr")]
pub mod vr;
#[cfg(any(feature = "desktop", feature = "vr"))]
pub mod writer;

/// True if there seems to be a display: what plain `incise` decides by.
#[cfg(any(feature = "desktop", feature = "vr"))]
pub fn has_display() -> bool {
    let set = |name: &str| std::env::var_os(name).is_some_and(|v| !v.is_empty());
    cfg!(not(all(unix, not(target_os = "macos")))) || ["WAYLAND_DISPLAY", "WAYLAND_SOCKET", "DISPLAY"].into_iter().any(set)
}
