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

/// What the window library says, without the place in its source that it puts in front of what the system says, and the stop after it.
#[cfg(any(feature = "desktop", feature = "vr"))]
fn words_of_window(why: impl std::fmt::Display) -> String {
    let words = why.to_string();
    let told = words.strip_prefix("os error at ").and_then(|rest| {
        let (_, after) = rest.split_once(".rs:")?;
        Some(after.split_once(": ")?.1)
    });
    told.unwrap_or(&words).trim_end_matches('.').to_string()
}

#[cfg(all(test, any(feature = "desktop", feature = "vr")))]
mod tests {
    #[test]
    fn a_user_is_not_told_where_the_window_library_was_built() {
        let words = super::words_of_window;
        assert_eq!(words("os error at /home/me/winit/src/mod.rs:765: DISPLAY is not set."), "DISPLAY is not set");
        assert_eq!(words("os error at C:\\me\\mod.rs:7: code 3: no"), "code 3: no");
        assert_eq!(words("Exit Failure: 1"), "Exit Failure: 1");
        assert_eq!(words("os error at hand: none"), "os error at hand: none");
    }
}
