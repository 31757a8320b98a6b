//! What a run has to tell when it is over.

use super::capture::Capture;
use super::space::Placement;
use crate::app::FrameReport;
use crate::diagnostics::Stages;
use crate::gpu::ui::UiCost;
use crate::gpu::{Instrument, LineSegment};
use glam::DVec3;

pub use super::capture::Capture as EyePictures;

/// What happened.
#[derive(Debug, Default)]
pub struct VrOutcome {
    /// The runtime's name and version.
    pub runtime: String,
    /// The headset's name.
    pub headset: String,
    /// The graphics card's name.
    pub adapter: String,
    /// Which space the room is.
    pub space: &'static str,
    /// Pictures a second, if the headset says.
    pub refresh_hz: Option<f32>,
    /// True if both eyes were drawn in one pass.
    pub multiview: bool,
    /// True if the compositor was told how far away things are.
    pub depth: bool,
    /// Width and height of an eye's picture.
    pub eye_size: (u32, u32),
    /// The smallest share of each side that was drawn because the GPU fell behind; 0 before the first session.
    pub least_resolution: f64,
    /// Frames that were drawn.
    pub drawn: u64,
    /// Frames that the runtime wanted no picture for.
    pub undrawn: u64,
    /// Frames in which the headset was off, or showed another program: nothing moved.
    pub rested: u64,
    /// Frames whose predicted period was nonsense.
    pub nonsense_periods: u64,
    /// Frames that a window beside the headset showed.
    pub mirrored: u64,
    /// Vibrations that the runtime took, of the left and of the right hand, for contact, segments, and what was severed or cut.
    pub pulses: [[u64; 3]; 2],
    /// True if the runtime ended the last session, and not the user.
    pub ended_by_runtime: bool,
    /// Sessions that were lost and made again.
    pub recreated: u64,
    /// Where the model stands.
    pub placement: Option<Placement>,
    /// Frames, if they were kept.
    pub frames: Vec<FrameNote>,
    /// Commanded tips while tearing, model space, if reports were kept.
    pub tips: Vec<DVec3>,
    /// The last pictures that the driver asked for.
    pub pictures: Option<Capture>,
    /// The instruments in those pictures.
    pub instruments: Vec<Instrument>,
    /// The pointer's ray in those pictures.
    pub lines: Vec<LineSegment>,
}

/// A frame that was kept.
#[derive(Clone, Debug, Default)]
pub struct FrameNote {
    /// The app's report. Besides the app's stages: `input` (hands and board); and what is none of our work, `image` (waiting for
    /// the compositor's image) and `submit` (driver and runtime take over what was encoded).
    pub report: FrameReport,
    /// Milliseconds of the GPU's passes, of a few frames before; empty where the adapter does not tell.
    pub gpu: Stages,
    /// Edit commands of the hands and the board.
    pub commands: usize,
    /// Milliseconds for which the frame's thread ran on a core for all of the app's stages and `input`: unlike theirs, without time in
    /// which the system ran something else there. None where the system does not tell.
    pub core_ms: Option<f64>,
    /// Heap allocations of ours: from the hands' poses to the notes of the upload.
    pub allocations: u64,
    /// Largest displacement of a particle, metres.
    pub displaced: f64,
    /// False while the runtime's own menu has the hands.
    pub focused: bool,
    /// Where the model stands.
    pub placement: Option<Placement>,
    /// Faces of all tissues.
    pub faces: usize,
    /// The scene's edit hash in the first frame and in those in which an edit was done, taken back or done again; elsewhere it is
    /// what it was.
    pub edit_hash: Option<u64>,
    /// What the panel has cost.
    pub panel: UiCost,
}
