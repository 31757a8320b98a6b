//! The system's dialog for a file, where there is one.

use std::path::PathBuf;
use std::time::{Duration, Instant};
use winit::window::Window;

/// A dialog that is dismissed sooner than any hand could was never there: nothing else tells the two apart.
const NO_DIALOG: Duration = Duration::from_millis(150);
/// What to tell where there is none.
pub const NO_DIALOG_TEXT: &str = "This system has no file dialog (xdg-desktop-portal or zenity brings one). Drop a file on the \
                                  window, or type its path into the panel.";

/// How a dialog was answered.
#[derive(Debug)]
pub enum Answer {
    /// With a file.
    File(PathBuf),
    /// Not at all.
    Dismissed,
    /// There was no dialog.
    NoDialog,
}

/// Asks for a model's file; `answer` is called on another thread.
pub fn ask(window: &Window, answer: impl FnOnce(Answer) + Send + 'static) {
    if !may_be_there() {
        return answer(Answer::NoDialog);
    }
    let dialog = rfd::AsyncFileDialog::new()
        .set_title("Open a model")
        .add_filter("Models", &["glb", "gltf", "obj", "stl"])
        .set_parent(window)
        .pick_file();
    let wait = move || {
        let asked = Instant::now();
        answer(match pollster::block_on(dialog) {
            Some(file) => Answer::File(file.path().to_path_buf()),
            None if asked.elapsed() < NO_DIALOG => Answer::NoDialog,
            None => Answer::Dismissed,
        });
    };
    if let Err(why) = std::thread::Builder::new().name("dialog".into()).spawn(wait) {
        tracing::warn!("no file dialog: {why}; drop a file on the window instead");
    }
}

/// A portal is asked over the session's bus, zenity is a program; without either there is nobody to ask.
#[cfg(all(unix, not(target_os = "macos")))]
fn may_be_there() -> bool {
    use std::env::{split_paths, var_os};
    let bus = var_os("DBUS_SESSION_BUS_ADDRESS").is_some_and(|address| !address.is_empty())
        || var_os("XDG_RUNTIME_DIR").is_some_and(|folder| PathBuf::from(folder).join("bus").exists());
    bus || var_os("PATH").is_some_and(|path| split_paths(&path).any(|folder| folder.join("zenity").is_file()))
}

#[cfg(not(all(unix, not(target_os = "macos"))))]
fn may_be_there() -> bool {
    true
}
