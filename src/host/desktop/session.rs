//! What a window shows and does, without the window: the app, the tools in hand, the panel's state, and the model that is being
//! loaded behind its back.

use super::record::{FrameNote, Inserted, StrokeNote, inserted_vertices};
use super::{Loaded, Request, Setup};
use crate::app::{App, FrameReport};
use crate::gpu::{Bounds, Camera, GpuError};
use crate::host::models::{self, Arrival, Loader};
use crate::host::writer::{Order, Wake, Writer};
use crate::input::tools::{OrbitCamera, PointerTools, Preview, ToolSettings};
use crate::input::{CameraPose, InputFrame};
use crate::panel::{PanelAction, PanelState, TimingRow};
use crate::scene::{EditCommand, EditReport};
use glam::DVec3;
use std::time::Instant;

/// Longest step, seconds: a slow frame slows the scene down rather than tearing it apart.
const LONGEST_STEP_S: f64 = 0.05;
/// Step after a rest, and of a single step, seconds.
const STEP_S: f64 = 1.0 / 90.0;
/// Full vertical angle of view, radians.
const FOV_Y: f64 = 0.7;

/// What a window does beside its frames: what only the window can do.
#[derive(Clone, Debug, PartialEq)]
pub enum Wish {
    /// Ask the system for a file.
    OpenDialog,
    /// Write a picture of the next frame.
    Screenshot,
    /// Frames with the display's clock or without.
    Vsync(bool),
}

/// A running window's insides.
pub struct Session {
    /// Scene and clock.
    pub app: App,
    /// The pointer's tools.
    pub tools: PointerTools,
    /// The panel.
    pub panel: PanelState,
    /// What only the window can do.
    pub wishes: Vec<Wish>,
    /// Everything on the GPU is of a scene that is gone.
    pub scene_changed: bool,
    setup: Setup,
    loader: Loader,
    writer: Writer,
    input: InputFrame,
    time_s: f64,
    last_frame: Option<Instant>,
    single_step: bool,
    /// Something is to be drawn, though nothing moves by itself.
    dirty: bool,
    /// Frames and strokes, if somebody will ask for them.
    pub frames: Vec<FrameNote>,
    /// See `frames`.
    pub strokes: Vec<StrokeNote>,
    /// Vertices that edits have inserted so far, at rest, if somebody will ask for strokes.
    inserted: Inserted,
    frame_count: usize,
}

impl Session {
    /// A session with a model. `wake` wakes the window's loop.
    pub fn new(setup: Setup, first: Loaded, size: [f64; 2], wake: Wake) -> Self {
        let panel =
            PanelState { config: setup.config.clone(), bundled: crate::formats::BUNDLED.to_vec(), ..PanelState::default() };
        let Loaded { scene, name, warnings } = first;
        let pose = CameraPose { eye: DVec3::Z, target: DVec3::ZERO, up: DVec3::Y, fov_y: FOV_Y };
        let tools = PointerTools::new(OrbitCamera::new(&pose, 1.0), ToolSettings::for_diagonal(1.0, 0.01), size);
        let app = App::new(scene, 1.0, setup.allocations);
        let mut session = Self {
            app,
            tools,
            panel,
            wishes: Vec::new(),
            scene_changed: true,
            setup,
            loader: Loader::new(wake.clone()),
            writer: Writer::new(wake),
            input: InputFrame::default(),
            time_s: 0.0,
            last_frame: None,
            single_step: false,
            dirty: true,
            frames: Vec::new(),
            strokes: Vec::new(),
            inserted: Inserted::default(),
            frame_count: 0,
        };
        session.begin(name, size);
        if !warnings.is_empty() {
            session.panel.tell(warnings.join("\n"));
        }
        session
    }

    /// Makes tools, camera and panel ready for the scene that is now in the app.
    fn begin(&mut self, name: String, size: [f64; 2]) {
        let (low, high) = self.app.scene.bounds();
        let diagonal = (high - low).length();
        let diagonal = if diagonal.is_finite() && diagonal > 0.0 { diagonal } else { 1.0 };
        let width = self.panel.config.tear.width * diagonal;
        let pose = CameraPose { eye: DVec3::Z, target: DVec3::ZERO, up: DVec3::Y, fov_y: FOV_Y };
        let settings = ToolSettings::for_diagonal(diagonal, width);
        self.tools = PointerTools::new(OrbitCamera::new(&pose, diagonal), settings, size);
        self.frame_model(size);
        let panel = &mut self.panel;
        panel.model = name;
        panel.diagonal = diagonal;
        (panel.spacing, panel.stale) = (None, false);
        panel.depth_range = settings.depth_range();
        (panel.depth, panel.tilt, panel.grab_radius) = (settings.depth, settings.tilt, settings.grab_radius);
        (panel.undo_depth, panel.redo_depth) = (0, 0);
        panel.last_edit.clear();
        panel.table.clear();
        panel.animation = None;
        let rig = self.app.scene.tissues().next().map(|(_, t)| t.rig().clone());
        panel.animations = rig.iter().flat_map(|rig| rig.animations.iter().map(|a| (a.name.clone(), a.duration_s))).collect();
        let layer = self.app.scene.tissues().next().and_then(|(_, t)| t.layer());
        panel.spacing_used = layer.map_or(0.05 * diagonal, |l| l.settings.spacing);
        self.app.set_speed(panel.speed, self.time_s);
        self.input.show.extend(panel.layers.iter().map(|&layer| (layer, true)));
        self.scene_changed = true;
        self.inserted = inserted_vertices(&self.app.scene);
        self.count();
    }

    /// Shows the whole model from the front.
    pub fn frame_model(&mut self, size: [f64; 2]) {
        let (min, max) = self.app.scene.bounds();
        let direction = DVec3::new(0.25, 0.35, 1.0);
        let aspect = (size[0] / size[1].max(1.0)).max(0.1);
        let camera = Camera::framing(Bounds { min, max }, direction, DVec3::Y, FOV_Y, aspect);
        let pose = CameraPose { eye: camera.eye, target: camera.target, up: camera.up, fov_y: camera.fov_y };
        self.tools.camera = OrbitCamera::new(&pose, (max - min).length().clamp(1e-9, 1e9));
        self.dirty = true;
    }

    /// Seconds on the clock of gestures: that of the machine, so that a blade has a speed though the scene stands.
    pub fn gesture_time_s(&self) -> f64 {
        self.setup.started.elapsed().as_secs_f64()
    }

    /// Something has changed that a frame has to show.
    pub fn touch(&mut self) {
        self.dirty = true;
    }

    /// Hands tool calls the scene and the list of commands.
    pub fn with_tools(&mut self, act: impl FnOnce(&mut PointerTools, f64, &crate::scene::Scene, &mut Vec<EditCommand>)) {
        let time_s = self.gesture_time_s();
        act(&mut self.tools, time_s, &self.app.scene, &mut self.input.commands);
        let settings = self.tools.settings;
        (self.panel.depth, self.panel.tilt) = (settings.depth, settings.tilt);
        self.dirty = true;
    }

    /// An edit of the keyboard's.
    pub fn command(&mut self, command: EditCommand) {
        self.with_tools(|tools, _, _, out| tools.cancel(out));
        self.input.commands.push(command);
    }

    /// The adapter cannot show the scene: what made it so is undone, or, if it was so from the start, a small model is opened.
    pub fn does_not_fit(&mut self, why: &GpuError, size: [f64; 2]) {
        self.scene_changed = true;
        self.with_tools(|tools, _, _, out| tools.cancel(out));
        if why.is_outgrown() && self.app.scene.take_back() {
            self.panel.fail(format!("{why}. The last edit is undone"));
            self.count();
        } else {
            self.panel.fail(why.to_string());
            self.act(PanelAction::Open("beam".into()), size);
        }
    }

    /// True if a frame would show something new.
    pub fn wants_frame(&self) -> bool {
        let plays = self.panel.animation.is_some() && self.panel.speed > 0.0;
        let moves = !self.panel.paused && (plays || !self.app.scene.is_asleep());
        self.dirty || self.single_step || moves || !self.input.commands.is_empty() || !self.input.show.is_empty()
    }

    /// The next frame's input.
    pub fn next_input(&mut self, now: Instant) -> InputFrame {
        let since = self.last_frame.map(|last| now.duration_since(last).as_secs_f64());
        let moving = !self.dirty || since.is_some_and(|s| s < 0.25);
        let step = if moving { since.unwrap_or(STEP_S).clamp(0.0, LONGEST_STEP_S) } else { STEP_S };
        let step = match (self.panel.paused, std::mem::take(&mut self.single_step)) {
            (true, false) => 0.0,
            (true, true) => STEP_S,
            (false, _) => step,
        };
        self.last_frame = Some(now);
        self.dirty = false;
        self.time_s += step;
        let time_s = self.gesture_time_s();
        if self.tools.tick(time_s, &mut self.input.commands) {
            self.dirty = true;
        }
        let mut input = std::mem::take(&mut self.input);
        (input.time_s, input.step_s) = (self.time_s, step);
        input
    }

    /// What the tools show.
    pub fn preview(&mut self) -> Preview {
        self.tools.preview(&self.app.scene)
    }

    /// Takes in what a frame did. `origin` is the picture's upper left pixel in the window.
    pub fn frame_done(&mut self, report: FrameReport, origin: [f64; 2]) {
        for edit in &report.edits {
            self.tell_edit(edit);
        }
        if !report.edits.is_empty() {
            self.count();
            self.dirty = true; // the panel's words come a frame later
        }
        (self.panel.undo_depth, self.panel.redo_depth) = (self.app.scene.undo_depth(), self.app.scene.redo_depth());
        let traces = self.tools.take_traces();
        if self.setup.record && !report.edits.is_empty() {
            let before = std::mem::replace(&mut self.inserted, inserted_vertices(&self.app.scene));
            let made: Vec<DVec3> = self.inserted.iter().filter(|(id, _)| !before.contains_key(id)).map(|(_, p)| *p).collect();
            self.strokes.extend(traces.iter().map(|trace| StrokeNote::new(trace, &made, self.frame_count, origin)));
        }
        self.panel.note_frame(report.stages, report.counters.rows());
        if self.setup.record {
            self.frames.push(FrameNote { at_s: self.setup.started.elapsed().as_secs_f64(), report: report.clone() });
        }
        self.app.give_back(report);
        self.frame_count += 1;
    }

    fn tell_edit(&mut self, edit: &EditReport) {
        let pieces = match edit.pieces.len() {
            1 => "1 piece".to_string(),
            more => format!("{more} pieces"),
        };
        let time = edit.stages.total();
        self.panel.last_edit =
            format!("{}: {}, {} new vertices, {pieces}, {time:.2} ms", edit.kind, edit.outcome.as_str(), edit.new_vertices);
        tracing::info!("{}", self.panel.last_edit);
        if edit.segments.is_empty() {
            return;
        }
        let rows = ["perform_tear", "update_particles", "disconnect_particles", "bind", "update_mesh"];
        self.panel.table = rows
            .map(|name| {
                let mut ms: Vec<f64> = edit.segments.iter().map(|s| s.stages.get(name)).collect();
                ms.sort_by(f64::total_cmp);
                TimingRow { name, median_ms: ms[ms.len() / 2], most_ms: ms[ms.len() - 1] }
            })
            .to_vec();
    }

    fn count(&mut self) {
        self.panel.counts = models::counts(&self.app.scene);
    }

    /// Carries out what the panel, a key or a dropped file asks for.
    pub fn act(&mut self, action: PanelAction, size: [f64; 2]) {
        self.dirty = true;
        match action {
            PanelAction::Open(model) => {
                self.load(Request { model, config: self.panel.config.clone(), spacing: None });
            }
            PanelAction::Regenerate => {
                let (model, spacing) = (self.panel.model.clone(), self.panel.spacing.or(Some(self.panel.spacing_used)));
                self.load(Request { model, config: self.panel.config.clone(), spacing });
            }
            PanelAction::Material(_) | PanelAction::SettingsChanged => models::apply_settings(&mut self.app, &mut self.panel),
            PanelAction::Animate(animation) => {
                self.panel.animation = animation;
                self.app.scene.set_animation(animation);
            }
            PanelAction::Speed(speed) => {
                self.panel.speed = speed;
                self.app.set_speed(speed, self.time_s);
            }
            PanelAction::Pause(paused) => self.panel.paused = paused,
            PanelAction::Step => self.single_step = self.panel.paused,
            PanelAction::Show(layer, on) => {
                if on {
                    self.panel.layers.insert(layer)
                } else {
                    self.panel.layers.remove(&layer)
                };
                self.input.show.push((layer, on));
            }
            PanelAction::Undo => self.command(EditCommand::Undo),
            PanelAction::Redo => self.command(EditCommand::Redo),
            PanelAction::Reset => self.command(EditCommand::Reset),
            PanelAction::Frame => self.frame_model(size),
            PanelAction::Export => self.write(models::export(&self.app.scene, self.setup.export)),
            PanelAction::SaveConfig => {
                let order = models::save_config(&self.setup.config_file, &mut self.panel);
                self.write(order);
            }
            PanelAction::Screenshot => self.wishes.push(Wish::Screenshot),
            PanelAction::Record(on) => self.panel.recording = on,
            PanelAction::SwapHands | PanelAction::PlaneTool(_) | PanelAction::Calibrate(_) => {} // a mouse has none of these
            PanelAction::OpenDialog => self.wishes.push(Wish::OpenDialog),
            PanelAction::Vsync(on) => {
                self.panel.vsync = on;
                self.wishes.push(Wish::Vsync(on));
            }
        }
    }

    /// The panel's numbers go to the tools.
    pub fn take_panel_values(&mut self) {
        let panel = &self.panel;
        let settings = &mut self.tools.settings;
        (settings.depth, settings.tilt, settings.grab_radius) = (panel.depth, panel.tilt, panel.grab_radius);
        settings.width = panel.config.tear.width * panel.diagonal;
    }

    fn load(&mut self, request: Request) {
        self.loader.begin(&self.setup.load, request, &mut self.panel);
    }

    /// Has a file written.
    pub fn write(&mut self, order: Order) {
        self.writer.order(order);
    }

    /// Tells what has been written meanwhile.
    pub fn take_written(&mut self) {
        if self.writer.take(&mut self.panel) {
            self.dirty = true;
        }
    }

    /// Takes a model that has been loaded meanwhile. A broken one leaves the current one in place.
    pub fn take_loaded(&mut self, size: [f64; 2]) {
        match self.loader.take(&mut self.panel) {
            Arrival::Nothing => return,
            Arrival::Told => {}
            Arrival::Model(came) => {
                let (wanted, loaded) = *came;
                self.show(loaded, wanted.spacing.is_some(), size);
            }
        }
        self.dirty = true;
    }

    /// Shows a model; `again` is the one that is there with other particles, which is seen from where it was and goes on moving.
    fn show(&mut self, Loaded { scene, name, .. }: Loaded, again: bool, size: [f64; 2]) {
        let (camera, animation, spacing) = (self.tools.camera, self.panel.animation, self.panel.spacing);
        self.input = InputFrame::default();
        self.app = App::new(scene, 1.0, self.setup.allocations);
        self.time_s = 0.0;
        tracing::info!("shown: {name}");
        self.begin(name, size);
        if again {
            self.tools.camera = camera;
            (self.panel.animation, self.panel.spacing) = (animation, spacing);
            self.app.scene.set_animation(animation);
        }
    }
}

#[cfg(test)]
#[path = "session_tests.rs"]
mod tests;
