//! The application: a scene, a clock, and one frame that reads as a list of stages. Knows no window, headset or file.

use crate::diagnostics::Stages;
use crate::input::{InputFrame, Layer};
use crate::scene::{EditReport, Scene, TissueId};
use crate::tissue::TissueDelta;
use std::collections::BTreeSet;
use std::sync::Arc;

/// What a frame cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounters {
    /// Compute dispatches.
    pub dispatches: u64,
    /// Draw calls.
    pub draws: u64,
    /// Bytes sent to the GPU.
    pub bytes_uploaded: u64,
    /// Pipelines compiled.
    pub pipelines: u64,
    /// Faces that edits looked at.
    pub faces_visited: u64,
    /// Particles that the solver moved.
    pub particles_awake: u64,
    /// Particle steps taken back since the start because they were not finite or beyond all bounds: such states are never drawn.
    pub quarantined: u64,
    /// Heap allocations between the frame's start and the hand-over to the target.
    pub allocations: u64,
}

impl FrameCounters {
    /// All, with their names in words.
    pub fn rows(&self) -> [(&'static str, u64); 8] {
        [
            ("dispatches", self.dispatches),
            ("draws", self.draws),
            ("bytes uploaded", self.bytes_uploaded),
            ("pipelines compiled", self.pipelines),
            ("faces visited", self.faces_visited),
            ("particles awake", self.particles_awake),
            ("steps quarantined", self.quarantined),
            ("allocations", self.allocations),
        ]
    }
}

/// What a frame did.
#[derive(Clone, Debug, Default)]
pub struct FrameReport {
    /// Seconds on the scene's clock.
    pub time_s: f64,
    /// Milliseconds: tools, edit, pose, physics, upload, deform, draw.
    pub stages: Stages,
    /// Counts.
    pub counters: FrameCounters,
    /// Edits that were completed in this frame.
    pub edits: Vec<EditReport>,
}

/// What a target may look at while it presents a frame.
pub struct FrameView<'a> {
    /// The scene, read only.
    pub scene: &'a Scene,
    /// Edits since the last frame, undone and redone ones too.
    pub changes: &'a [(TissueId, Arc<TissueDelta>)],
    /// Inspection layers that are on.
    pub layers: &'a BTreeSet<Layer>,
    /// Seconds on the scene's clock.
    pub time_s: f64,
}

/// Where a frame goes: a picture, a window, a headset. Uploads, deforms and draws, and says what it cost.
pub trait FrameTarget {
    /// Why a frame could not be presented.
    type Error;

    /// Presents one frame: stages `upload`, `deform`, `draw`; dispatches, draws and bytes into `counters`.
    fn present(&mut self, view: &FrameView, stages: &mut Stages, counters: &mut FrameCounters) -> Result<(), Self::Error>;
}

static NO_LAYERS: BTreeSet<Layer> = BTreeSet::new();

/// The scene and its clock.
pub struct App {
    /// What is torn and cut.
    pub scene: Scene,
    layers: BTreeSet<Layer>,
    speed: f64,
    /// Animation time at scene time 0 for the speed of now: a change of speed goes on from where the animation is.
    animation_offset_s: f64,
    allocations: fn() -> u64,
    /// Empty: the room of a report that came back.
    spare_edits: Vec<EditReport>,
}

/// Edits of a frame that there is room for at first.
const EDITS_ROOM: usize = 4;

impl App {
    /// An application over `scene`, whose animation plays at `speed`. `allocations` counts heap allocations so far, where the
    /// program has a counting allocator (else a function that returns 0).
    pub fn new(mut scene: Scene, speed: f64, allocations: fn() -> u64) -> Self {
        scene.watch_changes();
        let spare_edits = Vec::with_capacity(EDITS_ROOM);
        Self { scene, layers: BTreeSet::new(), speed, animation_offset_s: 0.0, allocations, spare_edits }
    }

    /// Plays the animation at another speed from `now_s` on the scene's clock.
    pub fn set_speed(&mut self, speed: f64, now_s: f64) {
        self.animation_offset_s += now_s * (self.speed - speed);
        self.speed = speed;
    }

    /// The scene as it is now, for a target that is shown it between frames: nothing has changed, no layer is on.
    pub fn view(&self) -> FrameView<'_> {
        FrameView { scene: &self.scene, changes: &[], layers: &NO_LAYERS, time_s: 0.0 }
    }

    /// One frame: tools -> edits -> pose -> physics -> target (upload, deform, draw). Edits finish before the simulation step.
    pub fn frame<T: FrameTarget>(&mut self, input: &InputFrame, target: &mut T) -> Result<FrameReport, T::Error> {
        let mut report =
            FrameReport { time_s: input.time_s, edits: std::mem::take(&mut self.spare_edits), ..FrameReport::default() };
        let allocated = (self.allocations)();
        let FrameReport { stages, counters, edits, .. } = &mut report;
        let commands = stages.time("tools", || {
            for &(layer, on) in &input.show {
                if on {
                    self.layers.insert(layer)
                } else {
                    self.layers.remove(&layer)
                };
            }
            &input.commands
        });
        stages.time("edit", || {
            for command in commands {
                self.scene.edit_into(command.clone(), edits);
            }
        });
        let animation_s = input.time_s * self.speed + self.animation_offset_s;
        stages.time("pose", || self.scene.pose(input.time_s, animation_s));
        if input.step_s > 0.0 {
            stages.time("physics", || self.scene.step(input.step_s));
        }
        counters.faces_visited = edits.iter().map(|e| e.faces_visited as u64).sum();
        counters.particles_awake =
            self.scene.tissues().filter_map(|(_, t)| t.layer()).map(|l| l.network.awake_particles() as u64).sum();
        counters.quarantined = self.scene.tissues().filter_map(|(_, t)| t.layer()).map(|l| l.network.quarantined()).sum();
        let changes = self.scene.take_changes();
        counters.allocations = (self.allocations)() - allocated;
        let view = FrameView { scene: &self.scene, changes: &changes, layers: &self.layers, time_s: input.time_s };
        target.present(&view, stages, counters)?;
        self.scene.give_back_changes(changes);
        self.scene.make_room();
        Ok(report)
    }

    /// Takes a report back that nobody reads any more: the next frames use its room.
    pub fn give_back(&mut self, mut report: FrameReport) {
        self.scene.give_back_reports(&mut report.edits);
        self.spare_edits = report.edits;
    }
}
