//! The loop: sessions one after another, frames one after another.
//!
//! A frame: wait -> actions -> begin -> hands and head -> app (edits, step) -> late eyes, draw -> end.

use super::clock::StepClock;
use super::desk::{Desk, Work};
use super::drawn;
use super::error::VrError;
use super::eye_mirror::EyeMirror;
use super::fit::GpuLoad;
use super::hands::{Around, Hands, HandsOutput};
use super::haptics::Haptics;
use super::headset::{AT_EYES, EyeTarget, Headset};
use super::input::HandsInput;
use super::lifecycle::Order;
use super::lockstep::{Asked, Expected, Lockstep, wait_until_seen};
use super::outcome::{FrameNote, VrOutcome};
use super::space::{Placement, Pose};
use crate::app::{App, FrameCounters, FrameReport, FrameTarget};
use crate::config::{Config, VrSettings};
use crate::diagnostics::{Stages, core_seconds};
use crate::gpu::ui::UiCost;
use crate::gpu::{Instrument, LineSegment};
use crate::host::models::{Export, Load};
use crate::input::InputFrame;
use crate::scene::{EditCommand, Outcome};
use glam::DVec3;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// A step of a lockstep run: the clock of a runtime without a headset is the wall's, and no two runs would be alike.
const LOCKSTEP_S: f64 = 1.0 / 90.0;
/// The user stands here where the head is not tracked yet; the room's origin is on the floor or, where there is none, at the eyes.
fn standing(room: &str) -> Pose {
    let eyes = if room == AT_EYES { 0.0 } else { 1.6 };
    Pose { position: DVec3::new(0.0, eyes, 0.0), rotation: glam::DQuat::IDENTITY }
}

/// How to run.
#[derive(Clone)]
pub struct VrOptions {
    /// The configuration.
    pub config: Config,
    /// Where the panel saves the settings.
    pub config_file: PathBuf,
    /// How the panel opens models; none if it cannot.
    pub load: Option<Load>,
    /// How it writes them.
    pub export: Option<Export>,
    /// Counts heap allocations so far.
    pub allocations: fn() -> u64,
    /// The model's name, for the panel.
    pub model: String,
    /// Leave after this many frames that were seen.
    pub frames: Option<u64>,
    /// A test driver to be led by.
    pub lockstep: Option<SocketAddr>,
    /// Keep every frame's report: for runs that are looked at afterwards.
    pub keep_reports: bool,
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
    let mut losses = Losses::default();
    if options.config.vr.mirror {
        user.mirror = EyeMirror::open();
    }
    loop {
        let ended = session(&mut headset, app, &mut user, options, outcome);
        user.put_down(app, outcome);
        if let Some(desk) = &mut user.desk {
            desk.finish_files();
        }
        if let Some(mirror) = &mut user.mirror {
            mirror.end();
            outcome.mirrored = mirror.frames();
        }
        let why = match ended {
            Ok(Ended::Left) => return Ok(()),
            Ok(Ended::Lost) => VrError::Lost("it asked for a new session".into()),
            Err(error) if error.is_loss() => error,
            Err(error) => return Err(error),
        };
        if losses.one_more(outcome.drawn + outcome.undrawn) {
            return Err(why);
        }
        tracing::warn!("{why}; waiting for it to come back");
        if let Some(desk) = &mut user.desk {
            desk.board.end_session();
        }
        drop(headset);
        headset = reopen(&options.config.vr).ok_or(why)?;
        outcome.recreated += 1;
    }
}

/// Sessions lost one after the other: if none of them lasts, the next will not either.
#[derive(Debug, Default)]
struct Losses {
    in_a_row: u32,
    /// Frames at the last loss.
    frames: u64,
}

impl Losses {
    /// A session was lost after so many frames of all sessions; true if it is time to give up.
    fn one_more(&mut self, frames: u64) -> bool {
        if frames.saturating_sub(self.frames) >= LASTING_FRAMES {
            self.in_a_row = 0;
        }
        self.frames = frames;
        self.in_a_row += 1;
        self.in_a_row > MOST_LOSSES
    }
}

/// A session of this many frames has lasted: about a second.
const LASTING_FRAMES: u64 = 90;
/// So many losses in a row are followed by another attempt.
const MOST_LOSSES: u32 = 3;

/// Tries for a while to open a session anew.
fn reopen(settings: &VrSettings) -> Option<Headset> {
    let start = Instant::now();
    while start.elapsed().as_secs_f64() < settings.return_time {
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
    desk: Option<Desk>,
    haptics: Haptics,
    clock: StepClock,
    lockstep: Option<Lockstep>,
    time_s: f64,
    leaving: bool,
    /// The model stands before a head that was tracked while the user's hands were ours.
    placed: bool,
    output: HandsOutput,
    frame: InputFrame,
    instruments: Vec<Instrument>,
    lines: Vec<LineSegment>,
    mirror: Option<EyeMirror>,
}

/// Commands of a frame and instruments in the hands that there is room for at first.
const COMMANDS: usize = 32;
const INSTRUMENTS: usize = 8;

impl User {
    fn new(options: &VrOptions) -> Self {
        Self {
            hands: None,
            desk: None,
            haptics: Haptics::new(options.config.vr.haptics),
            clock: StepClock::default(),
            lockstep: None,
            time_s: 0.0,
            leaving: false,
            placed: false,
            output: HandsOutput { commands: Vec::with_capacity(COMMANDS), ..HandsOutput::default() },
            frame: InputFrame { commands: Vec::with_capacity(COMMANDS), ..InputFrame::default() },
            instruments: Vec::with_capacity(INSTRUMENTS),
            lines: Vec::with_capacity(INSTRUMENTS),
            mirror: None,
        }
    }

    /// Ends what the hands are in the middle of: nothing sticks while nobody listens. The last frame gets the reports of what that
    /// completed.
    fn put_down(&mut self, app: &mut App, outcome: &mut VrOutcome) {
        self.clock.pause();
        let Some(hands) = &mut self.hands else { return };
        let mut commands = Vec::new();
        hands.step_away(&mut commands);
        for command in commands {
            let edits = app.scene.edit(command);
            if let Some(last) = outcome.frames.last_mut().filter(|_| !edits.is_empty()) {
                last.report.edits.extend(edits);
                last.edit_hash = Some(app.scene.edit_hash());
            }
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
    let desk = user.desk.get_or_insert_with(|| Desk::new(app, options, headset.adapter()));
    desk.board.prepare(&headset.session, &headset.context())?;
    if let Some(mirror) = &mut user.mirror {
        mirror.begin(&headset.context());
    }
    loop {
        match headset.poll()? {
            Order::Leave => {
                outcome.ended_by_runtime = !user.leaving;
                return Ok(Ended::Left);
            }
            Order::Recreate => return Ok(Ended::Lost),
            Order::None => {}
            Order::Begin | Order::End => continue,
        }
        if !headset.life.is_running() {
            if user.mirror.as_ref().is_some_and(EyeMirror::is_closed) {
                return Ok(Ended::Left);
            }
            std::thread::sleep(Duration::from_millis(10));
            continue;
        }
        let state = headset.wait()?;
        headset.input.sync(&headset.session)?;
        let asks = headset.life.listens() || (headset.life.is_seen() && user.hands.is_some());
        let led = if asks && !user.leaving { led(headset, app, user, &state)? } else { Led::Free };
        headset.begin()?;
        if let Led::Quit = led {
            leave(headset, user)?;
        }
        let rests = user.leaving || !headset.life.is_seen();
        if rests {
            user.put_down(app, outcome);
            headset.end(&state, None, None)?;
            outcome.rested += u64::from(!user.leaving);
            continue;
        }
        let shown = match led {
            Led::Asked(asked) => frame(headset, app, user, &state, asked, options, outcome)?,
            Led::Free if user.lockstep.is_none() => frame(headset, app, user, &state, Asked::default(), options, outcome)?,
            _ => look_only(headset, app, user, &state)?,
        };
        headset.end(&state, shown.as_ref(), user.desk.as_ref().map(|d| &d.board).filter(|b| b.is_open()))?;
        if let Some(mirror) = &mut user.mirror {
            mirror.show();
        }
        *(if shown.is_some() { &mut outcome.drawn } else { &mut outcome.undrawn }) += 1;
        outcome.nonsense_periods = user.clock.nonsense();
        outcome.least_resolution = headset.least_resolution();
        let enough = options.frames.is_some_and(|most| outcome.drawn + outcome.undrawn >= most);
        let closed = user.mirror.as_ref().is_some_and(EyeMirror::is_closed);
        if (enough || closed) && !user.leaving {
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
    outcome.depth = headset.gives_depth();
    outcome.eye_size = headset.eye_size();
    let (width, height) = headset.eye_size();
    tracing::info!("{} on {}, {width} x {height} an eye, {}", headset.runtime.headset, headset.runtime.name, headset.adapter());
}

/// What the test driver wants of a frame.
enum Led {
    Free,
    Asked(Asked),
    Pass,
    Quit,
}

/// Lets the driver, if there is one, set the frame's input and waits until it has come through the runtime.
fn led(headset: &Headset, app: &App, user: &mut User, state: &openxr::FrameState) -> Result<Led, VrError> {
    let Some(lockstep) = &mut user.lockstep else { return Ok(Led::Free) };
    if user.hands.is_none() {
        let (low, high) = app.scene.bounds();
        lockstep.ready(&format!(r#"{{"low":{:?},"high":{:?}}}"#, low.to_array(), high.to_array()))?;
    }
    let focused = headset.life.listens();
    match lockstep.input(focused)? {
        Expected::Quit => Ok(Led::Quit),
        Expected::Pass => Ok(Led::Pass),
        Expected::Hands(wanted, asked) => {
            if focused {
                wait_until_seen(&wanted, || headset.look_at_hands(state.predicted_display_time))?;
            }
            Ok(Led::Asked(asked))
        }
    }
}

/// Shows the scene as it is: while a test driver is not in control, nothing may move.
fn look_only(
    headset: &mut Headset,
    app: &App,
    user: &mut User,
    state: &openxr::FrameState,
) -> Result<Option<super::headset::Shown>, VrError> {
    let (low, high) = app.scene.bounds();
    let placement =
        user.hands.as_ref().map_or_else(|| Placement::within_reach(low, high, &standing(headset.base_name)), |h| *h.placement());
    let mut target = eye_target(headset, state, placement, (&[], &[]), &mut user.mirror);
    target.load = GpuLoad::Told(0.0);
    target.present(&app.view(), &mut Stages::default(), &mut FrameCounters::default())?;
    Ok(target.shown)
}

fn eye_target<'a>(
    headset: &'a mut Headset,
    state: &openxr::FrameState,
    placement: Placement,
    (instruments, lines): (&'a [Instrument], &'a [LineSegment]),
    mirror: &'a mut Option<EyeMirror>,
) -> EyeTarget<'a> {
    EyeTarget {
        headset,
        gpu: Stages::default(),
        time: state.predicted_display_time,
        period: state.predicted_display_period,
        load: GpuLoad::Measured,
        render: state.should_render,
        placement,
        instruments,
        lines,
        mirror,
        capture: false,
        asks_picture: false,
        shown: None,
        captured: None,
        picture: None,
        changes: 0,
        allocations: || 0,
        allocated: 0,
        core_clock: || None,
        core_elsewhere: 0.0,
    }
}

/// One frame that the user sees.
fn frame(
    headset: &mut Headset,
    app: &mut App,
    user: &mut User,
    state: &openxr::FrameState,
    asked: Asked,
    options: &VrOptions,
    outcome: &mut VrOutcome,
) -> Result<Option<super::headset::Shown>, VrError> {
    let time = state.predicted_display_time;
    let core_clock: fn() -> Option<f64> = if options.keep_reports { core_seconds } else { || None };
    let (began, core, allocated) = (Instant::now(), core_clock(), (options.allocations)());
    let step_s = match user.lockstep {
        Some(_) => LOCKSTEP_S,
        None => user.clock.step(time.as_nanos(), state.predicted_display_period.as_nanos()),
    };
    let tracked = headset.head(time)?;
    let head = tracked.unwrap_or_else(|| standing(headset.base_name));
    let hands = user.hands.get_or_insert_with(|| {
        let (low, high) = app.scene.bounds();
        Hands::new(options.config.vr, options.config.tear.width, Placement::within_reach(low, high, &head))
    });
    let mut pointer = None;
    user.frame.commands.clear();
    user.frame.show.clear();
    // a headset that lies on a desk while the session starts is put on later
    if !user.placed && tracked.is_some() && headset.life.listens() {
        user.placed = true;
        hands.recentre(app.scene.bounds(), &head, &mut user.frame.commands);
    }
    let Some(desk) = &mut user.desk else { return Ok(None) };
    if headset.life.listens() {
        let mut input = headset.hands(time)?;
        hands.gestures(&mut input, &head);
        let mut work = Work { app: &mut *app, hands: &mut *hands, head: &head, options, frame: &mut user.frame };
        let (on_panel, changed) = desk.frame(headset, (&input, state.should_render), &mut work)?;
        if changed {
            user.time_s = 0.0;
        }
        let seen = headset.bounds();
        let bounds = if seen.is_empty() { app.scene.bounds() } else { (seen.min, seen.max) };
        app.scene.refresh_sections();
        let around = Around { scene: &app.scene, bounds, head: &head, on_panel, step_s };
        hands.frame(&input, &around, &mut user.output);
        user.output.commands.append(&mut user.frame.commands);
        if let Some(found) = user.output.calibrated.take() {
            desk.calibrated(hands, found);
        }
        user.haptics.set_strength(desk.board.state.config.vr.haptics);
        pointer = desk.board.ray(&input.hands);
    } else {
        // The runtime's own menu is open: the scene goes on, the hands are the menu's.
        user.output = HandsOutput { commands: std::mem::take(&mut user.output.commands), ..HandsOutput::default() };
        user.output.commands.clear();
        hands.step_away(&mut user.output.commands);
        desk.board.look_away();
        drop(headset.hands(time).map(|_: HandsInput| ()));
    }
    let placement = *hands.placement();
    outcome.placement = Some(placement);
    drawn::instruments(&user.output, placement.length_to_model(1.0), &mut user.instruments);
    user.lines.clear();
    if let Some(ray) = pointer {
        let [a, b] = ray.map(|p| placement.to_model(p));
        user.lines.push(LineSegment::new(a, b, RAY));
    }
    let step_s = desk.step(step_s);
    user.time_s += step_s;
    user.frame.time_s = user.time_s;
    user.frame.step_s = step_s;
    std::mem::swap(&mut user.frame.commands, &mut user.output.commands);
    let (input_s, mut allocations) = (began.elapsed().as_secs_f64(), (options.allocations)() - allocated);
    if options.keep_reports {
        outcome.tips.extend(user.frame.commands.iter().filter_map(|command| match command {
            EditCommand::StrokePose(pose) => Some(pose.tip),
            _ => None,
        }));
    }
    let asks_picture = desk.wants_picture();
    let mut target = eye_target(headset, state, placement, (&user.instruments, &user.lines), &mut user.mirror);
    (target.capture, target.asks_picture) = (asked.capture, asks_picture);
    if user.lockstep.is_some() {
        target.load = GpuLoad::Told(asked.gpu_ms);
    }
    target.allocations = options.allocations;
    target.core_clock = core_clock;
    let presented = app.frame(&user.frame, &mut target);
    let EyeTarget { shown, captured, picture, changes, allocated, core_elsewhere, gpu, .. } = target;
    let core_ms = core.and_then(|core| Some(1e3 * (core_clock()? - core - core_elsewhere)));
    let mut report = match presented {
        Err(why) if why.is_outgrown() && take_back(headset, app, user, &why, outcome) => return Ok(None),
        presented => presented?,
    };
    allocations += report.counters.allocations + allocated;
    report.stages.add("input", 1e3 * input_s);
    feel(headset, user, &report, changes, outcome)?;
    let mut panel = UiCost::default();
    if let Some(desk) = &mut user.desk {
        panel = desk.board.take_cost();
        desk.note(app, &report, gpu);
        if let Some(picture) = picture {
            desk.write_picture(picture);
        }
    }
    if let Some(pictures) = captured {
        outcome.pictures = Some(pictures);
        outcome.instruments.clone_from(&user.instruments);
        outcome.lines.clone_from(&user.lines);
    }
    if options.keep_reports {
        let layers = app.scene.tissues().filter_map(|(_, t)| t.layer());
        let displaced = layers.flat_map(|l| l.displacements()).map(|u| u.length()).fold(0.0, f64::max);
        let changed = outcome.frames.is_empty() || !report.edits.is_empty();
        outcome.frames.push(FrameNote {
            report: report.clone(),
            gpu,
            commands: user.frame.commands.len(),
            core_ms,
            allocations,
            displaced,
            focused: headset.life.listens(),
            placement: Some(placement),
            faces: app.scene.tissues().map(|(_, t)| t.mesh().face_count()).sum(),
            edit_hash: changed.then(|| app.scene.edit_hash()),
            panel,
        });
    }
    app.give_back(report);
    Ok(shown)
}

/// The last edit was too much for the adapter: it is undone, and the user goes on from there. False if there is none.
fn take_back(headset: &mut Headset, app: &mut App, user: &mut User, why: &VrError, outcome: &mut VrOutcome) -> bool {
    user.put_down(app, outcome);
    headset.forget_scene();
    let done = app.scene.take_back();
    if let Some(desk) = user.desk.as_mut().filter(|_| done) {
        desk.board.state.fail(format!("{why}. The last edit is undone"));
    }
    done
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
        outcome.pulses[pulse.hand][pulse.cause as usize] += 1;
    }
    Ok(())
}

const RAY: [f32; 4] = [0.9, 0.9, 0.5, 0.9];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sessions_that_do_not_last_are_given_up() {
        let mut losses = Losses::default();
        assert_eq!([10, 20, 20, 30].map(|frames| losses.one_more(frames)), [false, false, false, true]);
        let mut lasting = Losses::default();
        assert!((1..20).all(|i| !lasting.one_more(i * LASTING_FRAMES)));
    }
}
