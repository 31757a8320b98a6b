//! What the panel shows and what it can ask for: plain data.

use crate::config::{Config, PresetName};
use crate::diagnostics::Stages;
use crate::input::Layer;
use std::collections::{BTreeSet, VecDeque};

/// What the user wants.
#[derive(Clone, Debug, PartialEq)]
pub enum PanelAction {
    /// A model: a file or a bundled name.
    Open(String),
    /// A model, chosen in the system's dialog.
    OpenDialog,
    /// The model anew with the particle settings as they are now; edits are lost.
    Regenerate,
    /// Springs of the material as they are now in the settings.
    Material(PresetName),
    /// Springs, wound opening, width, walls: as they are now in the settings.
    SettingsChanged,
    /// An animation, by index; `None` rests.
    Animate(Option<usize>),
    /// Speed of the animation, 1 is the model's own.
    Speed(f64),
    /// Stops or starts the clock.
    Pause(bool),
    /// One step of a stopped clock.
    Step,
    /// An inspection layer.
    Show(Layer, bool),
    /// The last edit back.
    Undo,
    /// The last edit again.
    Redo,
    /// All edits back.
    Reset,
    /// The camera back, or the model within reach.
    Frame,
    /// The model as it is, into a file.
    Export,
    /// The settings into config.toml.
    SaveConfig,
    /// A picture.
    Screenshot,
    /// A picture of every frame from now on, or no more.
    Record(bool),
    /// Frames with the display's clock, or as many as there can be.
    Vsync(bool),
    /// The tools of the two hands exchanged.
    SwapHands,
    /// The scalpel cuts along planes from now on, or tears again.
    PlaneTool(bool),
    /// The tip of the instrument is to be found anew by turning it about a point, or no longer.
    Calibrate(bool),
}

/// Something to be told.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notice {
    /// The words; an error names its remedy.
    pub text: String,
    /// Something went wrong.
    pub error: bool,
}

/// How far the loading of a model is.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// The model and what is being done with it.
    pub text: String,
    /// From 0 to 1.
    pub part: f32,
}

/// The paper's rows of one tear, milliseconds a segment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimingRow {
    /// Name of the row.
    pub name: &'static str,
    /// Median over the segments.
    pub median_ms: f64,
    /// Longest.
    pub most_ms: f64,
}

/// All that the panel shows. Lengths in metres, angles in radians, times in seconds unless the name says otherwise.
#[derive(Clone, Debug)]
pub struct PanelState {
    /// The panel is shown.
    pub open: bool,
    /// The panel stands in a room and there are two hands; else it is part of a window, beside a mouse and keys.
    pub in_room: bool,
    /// The tip of the instrument is being calibrated.
    pub calibrating: bool,
    /// The scalpel cuts along planes.
    pub plane_tool: bool,
    /// The table of keys is shown.
    pub help: bool,
    /// Bundled models.
    pub bundled: Vec<&'static str>,
    /// The model that is shown.
    pub model: String,
    /// What is being typed as a path.
    pub path: String,
    /// What is being loaded.
    pub loading: Option<Progress>,
    /// A file that is held over the window and not let go yet.
    pub hovered: Option<String>,
    /// What there is to be told.
    pub notice: Option<Notice>,
    /// The settings.
    pub config: Config,
    /// Spacing of particles, where the user has set one.
    pub spacing: Option<f64>,
    /// The particles that are there are not those of the settings.
    pub stale: bool,
    /// Spacing in use.
    pub spacing_used: f64,
    /// Diagonal of the model.
    pub diagonal: f64,
    /// Live vertices, faces, particles, pieces.
    pub counts: [usize; 4],
    /// Names and lengths of the animations.
    pub animations: Vec<(String, f64)>,
    /// The one that plays.
    pub animation: Option<usize>,
    /// Its speed.
    pub speed: f64,
    /// The clock stands.
    pub paused: bool,
    /// Depth of the blade.
    pub depth: f64,
    /// Least and largest depth.
    pub depth_range: [f64; 2],
    /// Lean of the blade.
    pub tilt: f64,
    /// Radius of a grab.
    pub grab_radius: f64,
    /// Layers that are on.
    pub layers: BTreeSet<Layer>,
    /// Edits that can be taken back.
    pub undo_depth: usize,
    /// Edits that can be done again.
    pub redo_depth: usize,
    /// Every frame is written.
    pub recording: bool,
    /// Frames wait for the display.
    pub vsync: bool,
    /// What draws.
    pub adapter: String,
    /// Stages of the last frame.
    pub stages: Stages,
    /// Counters and times stand over the picture.
    pub counters_shown: bool,
    /// Counters of the last frame, by name.
    pub counters: [(&'static str, u64); 8],
    /// What the passes took on the GPU, a few frames ago; none where the adapter cannot tell or nobody looks.
    pub gpu_stages: Stages,
    /// Total milliseconds of the last frames, oldest first.
    pub frame_ms: VecDeque<f32>,
    /// The last edit in words.
    pub last_edit: String,
    /// The paper's table of the last tear.
    pub table: Vec<TimingRow>,
}

impl Default for PanelState {
    fn default() -> Self {
        Self {
            open: true,
            in_room: false,
            calibrating: false,
            plane_tool: false,
            help: false,
            bundled: Vec::new(),
            model: String::new(),
            path: String::new(),
            loading: None,
            hovered: None,
            notice: None,
            config: Config::default(),
            spacing: None,
            stale: false,
            spacing_used: 0.0,
            diagonal: 1.0,
            counts: [0; 4],
            animations: Vec::new(),
            animation: None,
            speed: 1.0,
            paused: false,
            depth: 0.01,
            depth_range: [0.001, 0.5],
            tilt: 0.0,
            grab_radius: 0.05,
            layers: BTreeSet::new(),
            undo_depth: 0,
            redo_depth: 0,
            recording: false,
            vsync: true,
            adapter: String::new(),
            stages: Stages::default(),
            counters_shown: false,
            counters: [("", 0); 8],
            gpu_stages: Stages::default(),
            frame_ms: VecDeque::new(),
            last_edit: String::new(),
            table: Vec::new(),
        }
    }
}

/// Frames in the timing plot.
const PLOTTED: usize = 120;

impl PanelState {
    /// The model in a few words: its bundled name, or its file's without the folders.
    pub fn model_name(&self) -> &str {
        short_name(&self.model)
    }

    /// Adds a frame to the plot, with its counters.
    pub fn note_frame(&mut self, stages: Stages, counters: [(&'static str, u64); 8]) {
        self.counters = counters;
        if self.frame_ms.len() == PLOTTED {
            self.frame_ms.pop_front();
        }
        self.frame_ms.push_back(stages.total() as f32);
        self.stages = stages;
    }

    /// Tells an error, in the window and on stderr.
    pub fn fail(&mut self, text: impl Into<String>) {
        let text = text.into();
        tracing::warn!("{text}");
        self.notice = Some(Notice { text, error: true });
    }

    /// Tells something.
    pub fn tell(&mut self, text: impl Into<String>) {
        let text = text.into();
        tracing::info!("{text}");
        self.notice = Some(Notice { text, error: false });
    }
}

/// The last part of a path; a bundled name is one already.
pub fn short_name(model: &str) -> &str {
    std::path::Path::new(model).file_name().and_then(|name| name.to_str()).unwrap_or(model)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_called_by_its_name() {
        assert_eq!(["heart", "models/arm.glb", "/a b/c.obj", ".."].map(short_name), ["heart", "arm.glb", "c.obj", ".."]);
    }
}
