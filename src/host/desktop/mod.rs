//! A window: the same scalpel under a mouse. winit calls us; a frame is drawn only when something has changed.

mod dialog;
mod in_hand;
mod keys;
mod panel_events;
mod record;
mod screen;
mod session;
mod window;

pub use super::has_display;
pub use super::models::{Export, Load, Loaded, Request, Tell};
pub use record::{FrameNote, StrokeNote, StrokeSample};

use crate::config::Config;
use crate::gpu::GpuError;
use std::path::PathBuf;
use std::time::Instant;

/// What a window is given.
pub struct Setup {
    /// The settings to begin with.
    pub config: Config,
    /// Where the settings are saved.
    pub config_file: PathBuf,
    /// How models are loaded.
    pub load: Load,
    /// How they are written.
    pub export: Export,
    /// When the program started.
    pub started: Instant,
    /// Note every frame and stroke for the end.
    pub record: bool,
    /// Width and height of the window, points.
    pub size: (u32, u32),
    /// Counts heap allocations so far.
    pub allocations: fn() -> u64,
}

/// What a window did.
#[derive(Debug, Default)]
pub struct DesktopRun {
    /// What drew.
    pub adapter: String,
    /// The model that was shown last.
    pub model: String,
    /// From the program's start to the window's end.
    pub seconds: f64,
    /// See [`crate::scene::Scene::edit_hash`].
    pub edit_hash: u64,
    /// See [`crate::scene::Scene::state_hash`].
    pub state_hash: u64,
    /// Largest distance between GPU and CPU, fraction of the diagonal, at the end.
    pub gpu_error: f64,
    /// Every frame.
    pub frames: Vec<FrameNote>,
    /// Every stroke of the pointer.
    pub strokes: Vec<StrokeNote>,
}

/// Why there is no window.
#[derive(Debug, thiserror::Error)]
pub enum DesktopError {
    /// There is no display to open it on.
    #[error(
        "no display: {0}. Run this where there is a screen (over ssh: `ssh -X`, or set DISPLAY or WAYLAND_DISPLAY), or draw \
         pictures with `incise headless`"
    )]
    NoDisplay(String),
    /// The window system refused.
    #[error("the window system gave no window: {0}; `incise headless` works without one")]
    NoWindow(String),
    /// No adapter draws into the window.
    #[error(
        "no graphics adapter can draw into a window ({0}). `apt-get install mesa-vulkan-drivers libvulkan1` on Debian or Ubuntu \
         brings a software one; a graphics card needs its vendor's driver"
    )]
    NoSurface(String),
    /// The adapter failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// Opens a window and runs it until it is closed. Errors: no display, no adapter; a window that opened ends without one unless
/// its adapter fails for good.
pub fn run(setup: Setup, first: Loaded) -> Result<DesktopRun, DesktopError> {
    window::run(setup, first)
}
