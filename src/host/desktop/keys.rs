//! Which key does what.

use crate::panel::PanelAction;
use winit::keyboard::{Key, NamedKey};

/// What a key asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum KeyCommand {
    /// The same as on the panel.
    Panel(PanelAction),
    /// Stops or starts the clock.
    TogglePause,
    /// The next animation, after the last one the rest pose.
    NextAnimation,
    /// Starts or stops recording.
    ToggleRecord,
    /// Shows or hides the table of keys.
    ToggleHelp,
    /// Shows or hides counters and times over the picture.
    ToggleCounters,
    /// Shows or hides the panel.
    TogglePanel,
    /// Fills the screen, or no more.
    ToggleFullScreen,
    /// Turns the camera: steps to the right, and up.
    Orbit(f64, f64),
    /// Nearer, in notches of the wheel.
    Zoom(f64),
    /// The blade deeper, in notches.
    Deepen(f64),
    /// The blade to the right, in notches.
    Lean(f64),
    /// Squeezes for as long as it is held.
    Squeeze,
    /// Drops what is in hand.
    Cancel,
    /// Ends the program.
    Quit,
}

/// What a key that went down asks for; `ctrl` is command where that is the custom.
pub fn command(key: &Key, ctrl: bool, shift: bool) -> Option<KeyCommand> {
    use KeyCommand::*;
    use PanelAction as P;
    Some(match key.as_ref() {
        Key::Named(NamedKey::Space) => Squeeze,
        Key::Named(NamedKey::Escape) => Cancel,
        Key::Named(NamedKey::Tab) => TogglePanel,
        Key::Named(NamedKey::F1) => ToggleHelp,
        Key::Named(NamedKey::F3) => ToggleCounters,
        Key::Named(NamedKey::F10) => ToggleRecord,
        Key::Named(NamedKey::F11) => ToggleFullScreen,
        Key::Named(NamedKey::F12) => Panel(P::Screenshot),
        Key::Named(NamedKey::ArrowLeft) => Orbit(-1.0, 0.0),
        Key::Named(NamedKey::ArrowRight) => Orbit(1.0, 0.0),
        Key::Named(NamedKey::ArrowUp) => Orbit(0.0, 1.0),
        Key::Named(NamedKey::ArrowDown) => Orbit(0.0, -1.0),
        Key::Character(text) => match (text.to_lowercase().as_str(), ctrl) {
            ("z", true) if shift => Panel(P::Redo),
            ("z", true) => Panel(P::Undo),
            ("y", true) => Panel(P::Redo),
            ("o", true) => Panel(P::OpenDialog),
            ("s", true) => Panel(P::SaveConfig),
            ("e", true) => Panel(P::Export),
            ("q", true) => Quit,
            ("r", false) => Panel(P::Reset),
            ("f", false) => Panel(P::Frame),
            ("a", false) => NextAnimation,
            ("p", false) => TogglePause,
            ("n", false) => Panel(P::Step),
            ("h", false) => ToggleHelp,
            ("q", false) => Lean(-1.0),
            ("e", false) => Lean(1.0),
            ("[", false) => Deepen(-1.0),
            ("]", false) => Deepen(1.0),
            ("+" | "=", false) => Zoom(1.0),
            ("-", false) => Zoom(-1.0),
            _ => return None,
        },
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_mean_one_thing_with_control_and_another_without() {
        let key = |text: &str| Key::Character(text.into());
        assert_eq!(command(&key("z"), true, false), Some(KeyCommand::Panel(PanelAction::Undo)));
        assert_eq!(command(&key("Z"), true, true), Some(KeyCommand::Panel(PanelAction::Redo)));
        assert_eq!(command(&key("z"), false, false), None);
        assert_eq!(command(&key("q"), true, false), Some(KeyCommand::Quit));
        assert_eq!(command(&key("q"), false, false), Some(KeyCommand::Lean(-1.0)));
        assert_eq!(command(&Key::Named(NamedKey::Space), false, false), Some(KeyCommand::Squeeze));
        assert_eq!(command(&Key::Named(NamedKey::Shift), false, true), None);
    }
}
