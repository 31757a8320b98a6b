//! What the user does at the board: opens models, sets materials, calibrates the tip, steps the clock. The board shows it, the
//! desk carries it out.

use super::VrError;
use super::board::Board;
use super::capture::LeftEye;
use super::hands::Hands;
use super::headset::Headset;
use super::input::HandsInput;
use super::run::VrOptions;
use super::space::Pose;
use crate::app::{App, FrameReport};
use crate::diagnostics::Stages;
use crate::formats::BUNDLED;
use crate::host::models::{self, Arrival, Loaded, Loader, Request};
use crate::host::writer::{Album, Order, Writer};
use crate::input::InputFrame;
use crate::panel::{PanelAction, PanelState};
use crate::scene::EditCommand;

/// Step of a clock that stands, seconds.
const SINGLE_STEP_S: f64 = 1.0 / 90.0;

/// What the desk works on in a frame.
pub struct Work<'a> {
    /// Scene and clock.
    pub app: &'a mut App,
    /// The user's hands.
    pub hands: &'a mut Hands,
    /// The user's head, in the room.
    pub head: &'a Pose,
    /// How the program was started.
    pub options: &'a VrOptions,
    /// The frame to come.
    pub frame: &'a mut InputFrame,
}

/// The board and what is under way behind it.
pub struct Desk {
    /// The board.
    pub board: Board,
    loader: Loader,
    writer: Writer,
    steps: u32,
    wants_picture: bool,
}

impl Desk {
    /// A closed board over what the app shows.
    pub fn new(app: &App, options: &VrOptions, adapter: &str) -> Self {
        let mut state = PanelState {
            in_room: true,
            bundled: BUNDLED.to_vec(),
            model: options.model.clone(),
            config: options.config.clone(),
            adapter: adapter.to_string(),
            ..PanelState::default()
        };
        describe(app, &mut state);
        let (loader, writer) = (Loader::default(), Writer::default());
        Self { board: Board::new(state), loader, writer, steps: 0, wants_picture: false }
    }

    /// Seconds that the scene is to go on by, where the clock of the headset has gone on by `step_s`.
    pub fn step(&mut self, step_s: f64) -> f64 {
        match (self.board.state.paused, self.steps) {
            (false, _) => step_s,
            (true, 0) => 0.0,
            (true, _) => {
                self.steps -= 1;
                SINGLE_STEP_S
            }
        }
    }

    /// True if the picture of this frame is to be kept.
    pub fn wants_picture(&mut self) -> bool {
        std::mem::take(&mut self.wants_picture)
    }

    /// Opens, closes and runs the board; what it asks for is carried out or goes into the frame. Where the runtime wants no picture it
    /// rests. Returns the hands that point at it, and true if another model has taken the place of the one there was.
    pub fn frame(
        &mut self,
        headset: &mut Headset,
        (input, render): (&HandsInput, bool),
        work: &mut Work<'_>,
    ) -> Result<([bool; 2], bool), VrError> {
        if input.menu {
            self.board.toggle(work.head);
            self.board.state.counts = models::counts(&work.app.scene);
        }
        self.writer.take(&mut self.board.state);
        let changed = self.take_loaded(work);
        if changed {
            headset.forget_scene();
        }
        if !self.board.is_open() {
            return Ok(([false; 2], changed));
        }
        self.board.state.plane_tool = work.hands.uses_plane();
        let actions = if render { self.board.frame(&input.hands, &headset.session, &headset.context())? } else { Vec::new() };
        for action in actions {
            self.act(action, work);
        }
        let config = &self.board.state.config;
        work.hands.set_settings(&config.vr, config.tear.width);
        Ok((self.board.pointed_at(&input.hands), changed))
    }

    fn act(&mut self, action: PanelAction, work: &mut Work<'_>) {
        let Work { app, hands, head, options, frame } = work;
        let state = &mut self.board.state;
        match action {
            PanelAction::Open(model) => self.load(model, None, options),
            PanelAction::Regenerate => {
                let (model, spacing) = (state.model.clone(), state.spacing);
                self.load(model, spacing, options);
            }
            PanelAction::Undo => edit(EditCommand::Undo, hands, frame),
            PanelAction::Redo => edit(EditCommand::Redo, hands, frame),
            PanelAction::Reset => edit(EditCommand::Reset, hands, frame),
            PanelAction::Show(layer, on) => {
                frame.show.push((layer, on));
                if on {
                    state.layers.insert(layer)
                } else {
                    state.layers.remove(&layer)
                };
            }
            PanelAction::Frame => hands.recentre(app.scene.bounds(), head, &mut frame.commands),
            PanelAction::Animate(animation) => {
                state.animation = animation;
                app.scene.set_animation(animation);
            }
            PanelAction::Speed(speed) => {
                state.speed = speed;
                app.set_speed(speed, frame.time_s);
            }
            PanelAction::Pause(paused) => state.paused = paused,
            PanelAction::Step => self.steps += u32::from(state.paused),
            PanelAction::Material(_) | PanelAction::SettingsChanged => models::apply_settings(app, state),
            PanelAction::SwapHands => {
                hands.swap_tools(&mut frame.commands);
                state.config.vr.hand = state.config.vr.hand.other();
            }
            PanelAction::PlaneTool(on) => hands.use_plane(on, &mut frame.commands),
            PanelAction::Calibrate(on) => {
                state.calibrating = on;
                hands.calibrate(on, &mut frame.commands);
            }
            PanelAction::Export => match options.export {
                Some(export) => self.writer.order(models::export(&app.scene, export)),
                None => state.fail("this build writes no models"),
            },
            PanelAction::SaveConfig => self.writer.order(models::save_config(&options.config_file, state)),
            PanelAction::Screenshot => self.wants_picture = true,
            PanelAction::OpenDialog | PanelAction::Record(_) | PanelAction::Vsync(_) => {} // a window's; not on this board
        }
    }

    fn load(&mut self, model: String, spacing: Option<f64>, options: &VrOptions) {
        let state = &mut self.board.state;
        let Some(load) = &options.load else { return state.fail("this build loads no other models") };
        let request = Request { model, config: state.config.clone(), spacing };
        self.loader.begin(load, request, state);
    }

    /// Takes a model that has been loaded meanwhile; it stands where one stands at the start.
    fn take_loaded(&mut self, work: &mut Work<'_>) -> bool {
        let Work { app, hands, head, options, frame } = work;
        let state = &mut self.board.state;
        let Arrival::Model(came) = self.loader.take(state) else { return false };
        let Loaded { mut scene, name, .. } = came.1;
        let plays = scene.tissues().next().is_some_and(|(_, t)| !t.rig().animations.is_empty());
        scene.set_animation(plays.then_some(0));
        scene.pose(0.0, 0.0);
        // What the hands are in the middle of belongs to a scene that is gone.
        hands.put_down(&mut frame.commands);
        frame.commands.clear();
        let speed = state.speed;
        **app = App::new(scene, speed, options.allocations);
        frame.show.extend(state.layers.iter().map(|&layer| (layer, true)));
        state.model = name;
        describe(app, state);
        hands.recentre(app.scene.bounds(), head, &mut frame.commands);
        true
    }

    /// Takes in what a frame did; nothing is done for a closed board.
    pub fn note(&mut self, app: &App, report: &FrameReport, gpu: Stages) {
        if !self.board.is_open() {
            return;
        }
        let state = &mut self.board.state;
        state.note_frame(report.stages, report.counters.rows());
        state.gpu_stages = gpu;
        (state.undo_depth, state.redo_depth) = (app.scene.undo_depth(), app.scene.redo_depth());
        if let Some(edit) = report.edits.last() {
            let (kind, outcome, pieces) = (edit.kind, edit.outcome.as_str(), edit.pieces.len());
            state.last_edit = format!("{kind}: {outcome}, {} new vertices, {pieces} piece(s)", edit.new_vertices);
            state.counts = models::counts(&app.scene);
        }
    }

    /// Takes in what came of a calibration.
    pub fn calibrated(&mut self, hands: &Hands, found: Result<super::calibrate::Tip, String>) {
        let state = &mut self.board.state;
        state.calibrating = false;
        match found {
            Ok(tip) => {
                state.config.vr.tip_offset = hands.tip_offset();
                let mm = tip.strayed * 1e3;
                state.tell(format!("The tip is found; it kept its place to {mm:.1} mm. \"Save settings\" keeps it."));
            }
            Err(why) => state.fail(why),
        }
    }

    /// Has a picture written that the user asked for.
    pub fn write_picture(&mut self, LeftEye { size: (width, height), pixels }: LeftEye) {
        self.writer.order(Order::Picture { album: Album::Headset, width, height, pixels });
    }

    /// Waits until all is written: a session's device goes with it, and pictures may still be on their way from there.
    pub fn finish_files(&mut self) {
        self.writer.finish();
    }
}

fn edit(command: EditCommand, hands: &mut Hands, frame: &mut InputFrame) {
    hands.put_down(&mut frame.commands);
    frame.commands.push(command);
}

/// What the panel says of the model that is there.
fn describe(app: &App, state: &mut PanelState) {
    state.counts = models::counts(&app.scene);
    state.last_edit.clear();
    state.spacing = None;
    state.animation = app.scene.animation();
    state.animations.clear();
    if let Some((_, tissue)) = app.scene.tissues().next() {
        state.diagonal = tissue.diagonal();
        state.animations.extend(tissue.rig().animations.iter().map(|a| (a.name.clone(), a.duration_s)));
        state.spacing_used = tissue.layer().map_or(0.05 * state.diagonal, |l| l.settings.spacing);
    }
}

#[cfg(test)]
#[path = "desk_tests.rs"]
mod tests;
