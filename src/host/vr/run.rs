//! The loop: sessions one after another, frames one after another.
//!
//! A frame: wait -> actions -> begin -> hands and head -> app (edits, step) -> late eyes, draw -> end.

use super::board::Board;
use super::clock::StepClock;
use super::error::VrError;
use super::hands::{Around, Hands, HandsOutput, Tool};
use super::haptics::Haptics;
use super::headset::{Capture, EyeTarget, Headset};
use super::input::HandsInput;
use super::lifecycle::Order;
use super::lockstep::{Expected, Lockstep, wait_until_seen};
use super::space::{Placement, Pose};
use crate::app::{App, FrameCounters, FrameReport, FrameTarget};
use crate::config::{Config, VrSettings};
use crate::diagnostics::Stages;
use crate::formats::BUNDLED;
use crate::gpu::LineSegment;
use crate::host::headless::visible_bounds;
use crate::input::InputFrame;
use crate::panel::{PanelAction, PanelState};
use crate::physics::NetworkSettings;
use crate::scene::{EditCommand, Outcome, TissueId};
use glam::DVec3;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

pub use super::headset::Capture as EyePictures;

/// A step of a lockstep run: the clock of a runtime without a headset is the wall's, and no two runs would be alike.
const LOCKSTEP_S: f64 = 1.0 / 90.0;
/// How long to wait for a runtime to come back after it has gone.
const COMES_BACK: Duration = Duration::from_secs(3);
/// The user stands here where the head is not tracked yet.
const STANDING: Pose = Pose { position: DVec3::new(0.0, 1.6, 0.0), rotation: glam::DQuat::IDENTITY };

/// How to run.
#[derive(Clone, Debug, Default)]
pub struct VrOptions {
    /// The configuration.
    pub config: Config,
    /// The model's name, for the panel.
    pub model: String,
    /// Leave after this many frames that were seen.
    pub frames: Option<u64>,
    /// A test driver to be led by.
    pub lockstep: Option<SocketAddr>,
    /// Keep every frame's report: for runs that are looked at afterwards.
    pub keep_reports: bool,
}

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
    /// Width and height of an eye's picture.
    pub eye_size: (u32, u32),
    /// Frames that were drawn.
    pub drawn: u64,
    /// Frames that the runtime wanted no picture for.
    pub undrawn: u64,
    /// Frames whose predicted period was nonsense.
    pub nonsense_periods: u64,
    /// Vibrations that the runtime took.
    pub pulses: u64,
    /// Sessions that were lost and made again.
    pub recreated: u64,
    /// Where the model stands.
    pub placement: Option<Placement>,
    /// Frames, if they were kept.
    pub reports: Vec<FrameReport>,
    /// Commanded tips while tearing, model space, if reports were kept.
    pub tips: Vec<DVec3>,
    /// The last pictures that the driver asked for.
    pub pictures: Option<Capture>,
    /// Instruments of those pictures.
    pub lines: Vec<LineSegment>,
}

/// How a session ended.
enum Ended {
    Left,
    Lost,
}

/// Runs until the user or the runtime wants to leave. The scene stays with the caller, whatever happens: after an error it holds
/// everything that was done.
pub fn run(app: &mut App, options: &VrOptions, outcome: &mut VrOutcome) -> Result<(), VrError> {
    let mut user = User::new(options);
    if let Some(address) = options.lockstep {
        user.lockstep = Some(Lockstep::connect(address)?);
    }
    let mut headset = Headset::open(&options.config.vr)?;
    loop {
        let ended = session(&mut headset, app, &mut user, options, outcome);
        user.put_down(app);
        let why = match ended {
            Ok(Ended::Left) => return Ok(()),
            Ok(Ended::Lost) => VrError::Lost("it asked for a new session".into()),
            Err(error) if error.is_loss() => error,
            Err(error) => return Err(error),
        };
        tracing::warn!("{why}; waiting for it to come back");
        if let Some(board) = &mut user.board {
            board.end_session();
        }
        drop(headset);
        headset = reopen(&options.config.vr).ok_or(why)?;
        outcome.recreated += 1;
    }
}

/// Tries for a while to open a session anew.
fn reopen(settings: &VrSettings) -> Option<Headset> {
    let start = Instant::now();
    while start.elapsed() < COMES_BACK {
        if let Ok(headset) = Headset::open(settings) {
            return Some(headset);
        }
        std::thread::sleep(Duration::from_millis(250));
    }
    None
}

/// The user, over all sessions.
struct User {
    hands: Option<Hands>,
    board: Option<Board>,
    haptics: Haptics,
    clock: StepClock,
    lockstep: Option<Lockstep>,
    time_s: f64,
    leaving: bool,
    output: HandsOutput,
    frame: InputFrame,
    lines: Vec<LineSegment>,
}

impl User {
    fn new(options: &VrOptions) -> Self {
        Self {
            hands: None,
            board: None,
            haptics: Haptics::new(options.config.vr.haptics),
            clock: StepClock::default(),
            lockstep: None,
            time_s: 0.0,
            leaving: false,
            output: HandsOutput::default(),
            frame: InputFrame::default(),
            lines: Vec::new(),
        }
    }

    /// Ends what the hands are in the middle of: nothing sticks while nobody listens.
    fn put_down(&mut self, app: &mut App) {
        self.clock.pause();
        let Some(hands) = self.hands.as_mut().filter(|h| h.is_busy()) else { return };
        let mut commands = Vec::new();
        hands.put_down(&mut commands);
        for command in commands {
            app.scene.edit(command);
        }
    }
}

fn session(
    headset: &mut Headset,
    app: &mut App,
    user: &mut User,
    options: &VrOptions,
    outcome: &mut VrOutcome,
) -> Result<Ended, VrError> {
    describe(headset, outcome);
    loop {
        match headset.poll()? {
            Order::Leave => return Ok(Ended::Left),
            Order::Recreate => return Ok(Ended::Lost),
            Order::None => {}
            Order::Begin | Order::End => continue,
        }
        if !headset.life.is_running() {
            std::thread::sleep(Duration::from_millis(10));
            continue;
        }
        let state = headset.wait()?;
        headset.input.sync(&headset.session)?;
        let led = if headset.life.listens() && !user.leaving { led(headset, app, user, &state)? } else { Led::Free };
        headset.begin()?;
        if let Led::Quit = led {
            leave(headset, user)?;
        }
        let rests = user.leaving || !headset.life.is_seen();
        if rests {
            user.put_down(app);
            headset.end(&state, None, None)?;
            continue;
        }
        let capture = matches!(led, Led::Capture);
        let shown = if user.lockstep.is_some() && !headset.life.listens() {
            look_only(headset, app, user, &state)?
        } else {
            frame(headset, app, user, &state, capture, options, outcome)?
        };
        headset.end(&state, shown.as_ref(), user.board.as_ref().filter(|b| b.is_open()))?;
        *(if shown.is_some() { &mut outcome.drawn } else { &mut outcome.undrawn }) += 1;
        outcome.nonsense_periods = user.clock.nonsense();
        if options.frames.is_some_and(|most| outcome.drawn + outcome.undrawn >= most) && !user.leaving {
            leave(headset, user)?;
        }
    }
}

fn leave(headset: &Headset, user: &mut User) -> Result<(), VrError> {
    use super::error::Named;
    user.leaving = true;
    headset.session.request_exit().named("leaving")
}

fn describe(headset: &Headset, outcome: &mut VrOutcome) {
    outcome.runtime = headset.runtime.name.clone();
    outcome.headset = headset.runtime.headset.clone();
    outcome.adapter = headset.adapter().to_string();
    outcome.space = headset.base_name;
    outcome.refresh_hz = headset.refresh_hz;
    outcome.multiview = headset.multiview();
    outcome.eye_size = headset.eye_size();
    let (width, height) = headset.eye_size();
    tracing::info!("{} on {}, {width} x {height} an eye, {}", headset.runtime.headset, headset.runtime.name, headset.adapter());
}

/// What the test driver wants of a frame.
enum Led {
    Free,
    Capture,
    Quit,
}

/// Lets the driver, if there is one, set the frame's input and waits until it has come through the runtime.
fn led(headset: &Headset, app: &App, user: &mut User, state: &openxr::FrameState) -> Result<Led, VrError> {
    let Some(lockstep) = &mut user.lockstep else { return Ok(Led::Free) };
    if user.hands.is_none() {
        let (low, high) = visible_bounds(app);
        lockstep.ready(&format!(r#"{{"low":{:?},"high":{:?}}}"#, low.to_array(), high.to_array()))?;
    }
    match lockstep.input()? {
        Expected::Quit => Ok(Led::Quit),
        Expected::Hands(wanted, capture) => {
            wait_until_seen(&wanted, || headset.look_at_hands(state.predicted_display_time))?;
            Ok(if capture { Led::Capture } else { Led::Free })
        }
    }
}

/// Shows the scene as it is: while a test driver is not in control, nothing may move.
fn look_only(
    headset: &mut Headset,
    app: &App,
    user: &User,
    state: &openxr::FrameState,
) -> Result<Option<super::headset::Shown>, VrError> {
    let (low, high) = visible_bounds(app);
    let placement = user.hands.as_ref().map_or_else(|| Placement::within_reach(low, high, &STANDING), |h| *h.placement());
    let mut target = eye_target(headset, state, placement, &[], false);
    target.present(&app.view(), &mut Stages::default(), &mut FrameCounters::default())?;
    Ok(target.shown)
}

fn eye_target<'a>(
    headset: &'a mut Headset,
    state: &openxr::FrameState,
    placement: Placement,
    lines: &'a [LineSegment],
    capture: bool,
) -> EyeTarget<'a> {
    EyeTarget {
        headset,
        time: state.predicted_display_time,
        render: state.should_render,
        placement,
        lines,
        capture,
        shown: None,
        captured: None,
        changes: 0,
    }
}

/// One frame that the user sees.
fn frame(
    headset: &mut Headset,
    app: &mut App,
    user: &mut User,
    state: &openxr::FrameState,
    capture: bool,
    options: &VrOptions,
    outcome: &mut VrOutcome,
) -> Result<Option<super::headset::Shown>, VrError> {
    let time = state.predicted_display_time;
    let step_s = match user.lockstep {
        Some(_) => LOCKSTEP_S,
        None => user.clock.step(time.as_nanos(), state.predicted_display_period.as_nanos()),
    };
    let head = headset.head(time)?.unwrap_or(STANDING);
    let hands = user.hands.get_or_insert_with(|| {
        let (low, high) = visible_bounds(app);
        Hands::new(options.config.vr, options.config.tear.width, Placement::within_reach(low, high, &head))
    });
    let mut pointer = None;
    user.frame.commands.clear();
    if headset.life.listens() {
        let input = headset.hands(time)?;
        let seen = headset.bounds();
        let bounds = if seen.is_empty() { visible_bounds(app) } else { (seen.min, seen.max) };
        user.frame.show.clear();
        let on_panel = point(headset, app, &mut user.board, hands, &input, &head, options, &mut user.frame)?;
        let around = Around { scene: &app.scene, bounds, head: &head, on_panel, step_s };
        hands.frame(&input, &around, &mut user.output);
        user.output.commands.append(&mut user.frame.commands);
        pointer = user.board.as_ref().and_then(|b| b.ray(&input.hands));
    } else {
        // The runtime's own menu is open: the scene goes on, the hands are the menu's.
        user.output.commands.clear();
        hands.put_down(&mut user.output.commands);
        (user.output.instruments, user.output.plane) = ([None; 2], None);
        drop(headset.hands(time).map(|_: HandsInput| ()));
    }
    let placement = *hands.placement();
    outcome.placement = Some(placement);
    instrument_lines(&user.output, placement.length_to_model(1.0), &mut user.lines);
    if let Some(ray) = pointer {
        let [a, b] = ray.map(|p| placement.to_model(p));
        user.lines.push(LineSegment::new(a, b, RAY));
    }
    user.time_s += step_s;
    user.frame.time_s = user.time_s;
    user.frame.step_s = step_s;
    std::mem::swap(&mut user.frame.commands, &mut user.output.commands);
    if options.keep_reports {
        outcome.tips.extend(user.frame.commands.iter().filter_map(|command| match command {
            EditCommand::StrokePose(pose) => Some(pose.tip),
            _ => None,
        }));
    }
    let mut target = eye_target(headset, state, placement, &user.lines, capture);
    let report = app.frame(&user.frame, &mut target)?;
    let EyeTarget { shown, captured, changes, .. } = target;
    feel(headset, user, &report, changes, outcome)?;
    if let Some(pictures) = captured {
        outcome.pictures = Some(pictures);
        outcome.lines.clone_from(&user.lines);
    }
    if let Some(board) = user.board.as_mut().filter(|b| b.is_open()) {
        board.state.note_frame(report.stages);
        (board.state.undo_depth, board.state.redo_depth) = (app.scene.undo_depth(), app.scene.redo_depth());
    }
    if options.keep_reports {
        outcome.reports.push(report);
    }
    Ok(shown)
}

/// Opens, closes and runs the board; what it asks for goes into the frame. Returns the hands that point at it.
#[allow(clippy::too_many_arguments)]
fn point(
    headset: &Headset,
    app: &mut App,
    board: &mut Option<Board>,
    hands: &mut Hands,
    input: &HandsInput,
    head: &Pose,
    options: &VrOptions,
    frame: &mut InputFrame,
) -> Result<[bool; 2], VrError> {
    if input.menu {
        board.get_or_insert_with(|| Board::new(panel_state(app, options, headset.adapter()))).toggle(head);
    }
    let Some(board) = board.as_mut().filter(|b| b.is_open()) else { return Ok([false; 2]) };
    for action in board.frame(&input.hands, &headset.session, &headset.context())? {
        match action {
            PanelAction::Undo => frame.commands.push(EditCommand::Undo),
            PanelAction::Redo => frame.commands.push(EditCommand::Redo),
            PanelAction::Reset => frame.commands.push(EditCommand::Reset),
            PanelAction::Show(layer, on) => {
                frame.show.push((layer, on));
                if on {
                    board.state.layers.insert(layer)
                } else {
                    board.state.layers.remove(&layer)
                };
            }
            PanelAction::Frame => {
                let (low, high) = visible_bounds(app);
                hands.set_placement(Placement::within_reach(low, high, head));
            }
            PanelAction::Animate(animation) => {
                board.state.animation = animation;
                app.scene.set_animation(animation);
            }
            PanelAction::Material(_) | PanelAction::SettingsChanged => apply(app, &mut board.state),
            _ => board.state.tell("Take the headset off for that: it is done from the desktop window or the command line."),
        }
    }
    hands.set_tear_width(board.state.config.tear.width);
    Ok(board.pointed_at(&input.hands))
}

/// What the panel shows when it is first opened.
fn panel_state(app: &App, options: &VrOptions, adapter: &str) -> PanelState {
    let mut state = PanelState {
        bundled: BUNDLED.to_vec(),
        model: options.model.clone(),
        config: options.config.clone(),
        adapter: adapter.to_string(),
        ..PanelState::default()
    };
    if let Some((_, tissue)) = app.scene.tissues().next() {
        state.diagonal = tissue.diagonal();
        state.animations = tissue.rig().animations.iter().map(|a| (a.name.clone(), a.duration_s)).collect();
        let particles = tissue.layer().map_or(0, |l| l.map.len());
        let mesh = tissue.mesh();
        state.counts = [mesh.live_vertices().count(), mesh.face_count(), particles, app.scene.tissues().count()];
    }
    state
}

/// Springs, wounds and walls as the panel has them.
fn apply(app: &mut App, state: &mut PanelState) {
    let preset = state.config.dynamics.active();
    let network = NetworkSettings { frequency_hz: preset.frequency, damping_ratio: preset.damping, coupling: preset.coupling };
    app.scene.set_wall(state.config.tear.wall);
    let ids: Vec<TissueId> = app.scene.tissues().map(|(id, _)| id).collect();
    for id in ids {
        let Some(layer) = app.scene.tissue_mut(id).and_then(|t| t.layer_mut()) else { continue };
        layer.settings.wound.gap = state.config.tear.gap * state.diagonal;
        layer.opening_s = state.config.tear.opening_time;
        if let Err(why) = layer.network.set_settings(network) {
            state.fail(format!("{why}; the springs stay as they were"));
        }
    }
}

/// Lets the hands feel what the frame did.
fn feel(
    headset: &Headset,
    user: &mut User,
    report: &FrameReport,
    changes: usize,
    outcome: &mut VrOutcome,
) -> Result<(), VrError> {
    let mut felt = user.output.felt;
    let severed = report.edits.iter().any(|e| matches!(e.outcome, Outcome::Severed | Outcome::Cut));
    felt.severed = user.output.editing.filter(|_| severed);
    felt.torn = user.output.editing.filter(|_| changes > 0);
    for pulse in user.haptics.frame(felt).into_iter().flatten() {
        headset.input.pulse(&headset.session, pulse.hand, pulse.amplitude, pulse.seconds)?;
        outcome.pulses += 1;
    }
    Ok(())
}

const RAY: [f32; 4] = [0.9, 0.9, 0.5, 0.9];
const STEEL: [f32; 4] = [0.75, 0.78, 0.82, 1.0];
const EDGE: [f32; 4] = [1.0, 1.0, 1.0, 1.0];
const PLANE: [f32; 4] = [0.3, 0.8, 1.0, 0.6];
/// Half a side of the plane's picture, and how many lines it is made of. Metres in the room.
const PLANE_SIZE: f64 = 0.2;
const PLANE_LINES: i32 = 8;

/// The instruments and the plane as lines, model space. `room` is a metre of the room.
fn instrument_lines(output: &HandsOutput, room: f64, lines: &mut Vec<LineSegment>) {
    lines.clear();
    for instrument in output.instruments.iter().flatten() {
        let along = (instrument.base - instrument.tip).normalize_or(DVec3::Z);
        let side = along.any_orthonormal_vector() * (0.008 * room * (1.0 - 0.8 * instrument.closed));
        match instrument.tool {
            Tool::Scalpel => {
                let edge = instrument.tip + along * (0.03 * room);
                lines.push(LineSegment { width: 5.0, ..LineSegment::new(edge, instrument.base, STEEL) });
                lines.push(LineSegment { width: 3.0, ..LineSegment::new(instrument.tip, edge, EDGE) });
            }
            Tool::Forceps => {
                for side in [side, -side] {
                    lines.push(LineSegment { width: 3.0, ..LineSegment::new(instrument.tip + side, instrument.base, STEEL) });
                }
            }
        }
    }
    let Some((point, normal)) = output.plane else { return };
    let (u, v) = (normal.any_orthonormal_vector(), normal.cross(normal.any_orthonormal_vector()));
    for i in -PLANE_LINES..=PLANE_LINES {
        let t = f64::from(i) / f64::from(PLANE_LINES) * PLANE_SIZE * room;
        let reach = PLANE_SIZE * room;
        lines.push(LineSegment::new(point + u * t - v * reach, point + u * t + v * reach, PLANE));
        lines.push(LineSegment::new(point + v * t - u * reach, point + v * t + u * reach, PLANE));
    }
}
