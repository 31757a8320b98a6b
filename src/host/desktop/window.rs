//! The window and its event loop.

use super::dialog::{self, Answer};
use super::in_hand;
use super::keys::{self, KeyCommand};
use super::panel_events::panel_on;
use super::screen::{Acquired, Screen, Shot, WindowTarget};
use super::session::{Session, Wish};
use super::{DesktopError, DesktopRun, Loaded, Setup};
use crate::diagnostics::Stages;
use crate::gpu::GpuError;
use crate::gpu::ui::UiFrame;
use crate::host::words_of_window;
use crate::host::writer::{Album, Order, Wake as WakeCall};
use crate::input::tools::{Button, Modifiers};
use crate::panel::{Panel, PanelAction, short_name};
use std::sync::Arc;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::{LogicalSize, PhysicalPosition};
use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::keyboard::{Key, ModifiersState, NamedKey};
use winit::window::{Fullscreen, Window, WindowId};

/// Time between frames of a window that another one covers or that has not the focus.
const BACKGROUND: Duration = Duration::from_millis(100);
/// Least size of the window, points.
const LEAST_SIZE: (u32, u32) = (480, 320);

/// What reaches the loop from outside the window system.
#[derive(Debug)]
enum Wake {
    /// The panel wants to be drawn again after this long.
    Repaint(Duration),
    /// A model has been loaded, or a file written, or could not be.
    Loaded,
    /// The system's dialog was answered.
    Chosen(Answer),
}

pub(super) fn run(setup: Setup, first: Loaded) -> Result<DesktopRun, DesktopError> {
    // A missing libxkbcommon-x11 makes the window library panic rather than say so.
    let built = std::panic::catch_unwind(|| EventLoop::<Wake>::with_user_event().build());
    let events = match built {
        Ok(Ok(events)) => events,
        Ok(Err(why)) => return Err(DesktopError::NoDisplay(words_of_window(why))),
        Err(_) => {
            let hint =
                "a library of the window system is missing: `apt-get install libxkbcommon-x11-0 libx11-xcb1 libxcursor1 libxi6`";
            return Err(DesktopError::NoDisplay(hint.into()));
        }
    };
    let proxy = events.create_proxy();
    let mut desktop = Desktop { begin: Some((setup, first)), live: None, proxy, failure: None };
    events.run_app(&mut desktop).map_err(|e| DesktopError::NoWindow(words_of_window(e)))?;
    if let Some(failure) = desktop.failure {
        return Err(failure);
    }
    Ok(desktop.live.map(Live::finish).unwrap_or_default())
}

struct Desktop {
    begin: Option<(Setup, Loaded)>,
    live: Option<Live>,
    proxy: EventLoopProxy<Wake>,
    failure: Option<DesktopError>,
}

/// A window that is open.
struct Live {
    window: Arc<Window>,
    screen: Screen,
    panel: Panel,
    events: egui_winit::State,
    session: Session,
    proxy: EventLoopProxy<Wake>,
    keys: ModifiersState,
    cursor: PhysicalPosition<f64>,
    /// What the panel leaves of the window, pixels: left, top, right, bottom.
    canvas: [f64; 4],
    focused: bool,
    hidden: bool,
    /// The surface gave nothing to draw into.
    unseen: bool,
    wake_at: Option<Instant>,
    last_frame: Instant,
    /// Every frame was written, the last time that one was looked at.
    recorded: bool,
    wants_shot: bool,
    /// A redraw has been asked for and has not come yet.
    asked: bool,
    /// A press on the panel that it has not answered yet: what is typed after it may be meant for it.
    pressed_panel: bool,
    /// The window has said that it rests.
    rests: bool,
    frames: u64,
    /// Devices lost since the last frame that was drawn; more than three are no accident.
    losses: u32,
    closing: bool,
}

impl ApplicationHandler<Wake> for Desktop {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        let Some((setup, first)) = self.begin.take() else { return };
        match Live::open(events, setup, first, self.proxy.clone()) {
            Ok(live) => self.live = Some(live),
            Err(why) => {
                self.failure = Some(why);
                events.exit();
            }
        }
    }

    fn user_event(&mut self, _: &ActiveEventLoop, event: Wake) {
        let Some(live) = &mut self.live else { return };
        match event {
            Wake::Repaint(after) => live.repaint_in(after),
            Wake::Loaded => live.redraw(),
            Wake::Chosen(Answer::File(file)) => live.act(PanelAction::Open(file.display().to_string())),
            Wake::Chosen(Answer::NoDialog) => {
                live.session.panel.fail(dialog::NO_DIALOG_TEXT);
                live.session.touch();
            }
            Wake::Chosen(Answer::Dismissed) => {}
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(live) = &mut self.live else { return };
        let result = live.handle(event);
        if let Err(why) = result {
            self.failure = Some(why);
        }
        if live.closing || self.failure.is_some() {
            events.exit();
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let Some(live) = &mut self.live else { return };
        events.set_control_flow(live.schedule());
    }
}

impl Live {
    fn open(events: &ActiveEventLoop, setup: Setup, first: Loaded, proxy: EventLoopProxy<Wake>) -> Result<Self, DesktopError> {
        let attributes = Window::default_attributes()
            .with_title(title(&first.name))
            .with_inner_size(LogicalSize::new(setup.size.0, setup.size.1))
            .with_min_inner_size(LogicalSize::new(LEAST_SIZE.0, LEAST_SIZE.1));
        let window = Arc::new(events.create_window(attributes).map_err(|e| DesktopError::NoWindow(words_of_window(e)))?);
        let screen = Screen::new(events, &window)?;
        let (panel, state) = panel_on(&window, &screen, events, repaint_by(&proxy));
        let waker = proxy.clone();
        let wake = WakeCall::new(move || drop(waker.send_event(Wake::Loaded)));
        let scale = window.scale_factor();
        let (width, height) = screen.size();
        let canvas = [f64::from(crate::panel::WIDTH) * scale, 0.0, f64::from(width), f64::from(height)];
        let size = [canvas[2] - canvas[0], canvas[3]];
        let mut session = Session::new(setup, first, size, wake);
        session.panel.adapter = screen.adapter_name().to_string();
        window.request_redraw();
        Ok(Self {
            window,
            screen,
            panel,
            events: state,
            session,
            proxy,
            keys: ModifiersState::empty(),
            cursor: PhysicalPosition::new(0.0, 0.0),
            canvas,
            focused: true,
            hidden: false,
            unseen: false,
            wake_at: None,
            last_frame: Instant::now(),
            recorded: false,
            wants_shot: false,
            asked: true,
            pressed_panel: false,
            rests: false,
            frames: 0,
            losses: 0,
            closing: false,
        })
    }

    fn redraw(&mut self) {
        self.asked = true;
        self.window.request_redraw();
    }

    /// Sees to it that there is a frame `after` this long; never is never.
    fn repaint_in(&mut self, after: Duration) {
        if after.is_zero() {
            self.redraw();
        } else if let Some(at) = Instant::now().checked_add(after) {
            self.wake_at = Some(self.wake_at.map_or(at, |other| other.min(at)));
        }
    }

    /// Asks for the frames that are due and says how long to wait.
    fn schedule(&mut self) -> ControlFlow {
        let now = Instant::now();
        if self.hidden {
            return ControlFlow::Wait; // what shows it again is an event
        }
        if self.wake_at.is_some_and(|at| at <= now) {
            self.wake_at = None;
            self.redraw();
        }
        let mut next = self.wake_at;
        if self.session.wants_frame() {
            let due = due(now, self.last_frame, self.focused && !self.unseen);
            if due > now {
                next = Some(next.map_or(due, |other| other.min(due)));
            } else if !self.focused && self.window.is_minimized() == Some(true) {
                // X11 says nothing of its own when a window is minimised
                self.hide(true);
                return ControlFlow::Wait;
            } else {
                self.redraw();
            }
        }
        let rests = next.is_none() && !self.asked;
        if rests && !self.rests {
            tracing::debug!("at rest after frame {}", self.frames);
        }
        self.rests = rests;
        next.map_or(ControlFlow::Wait, ControlFlow::WaitUntil)
    }

    fn hide(&mut self, hidden: bool) {
        tracing::debug!("{} after frame {}", if hidden { "hidden" } else { "shown" }, self.frames);
        self.hidden = hidden;
    }

    fn size(&self) -> [f64; 2] {
        [(self.canvas[2] - self.canvas[0]).max(1.0), (self.canvas[3] - self.canvas[1]).max(1.0)]
    }

    fn act(&mut self, action: PanelAction) {
        self.session.act(action, self.size());
        self.redraw();
    }

    fn modifiers(&self) -> Modifiers {
        let keys = self.keys;
        Modifiers { shift: keys.shift_key(), ctrl: keys.control_key() || keys.super_key(), alt: keys.alt_key() }
    }

    /// The cursor is over the picture, not over the panel or a window of it.
    fn on_canvas(&self) -> bool {
        let PhysicalPosition { x, y } = self.cursor;
        let [left, top, right, bottom] = self.canvas;
        let scale = f64::from(self.panel.context().pixels_per_point());
        (left..right).contains(&x) && (top..bottom).contains(&y) && !self.panel.covers((x / scale) as f32, (y / scale) as f32)
    }

    fn handle(&mut self, event: WindowEvent) -> Result<(), DesktopError> {
        // not for egui, which would answer each with a wish for another
        if matches!(event, WindowEvent::RedrawRequested) {
            if self.hidden {
                self.asked = false;
                self.session.touch(); // drawn when it is shown again
                return Ok(());
            }
            return self.draw();
        }
        // keys are the panel's only while it is being typed into: else a button in focus would take them
        let typing = self.panel.is_typing() || self.pressed_panel;
        let for_panel = match event {
            WindowEvent::KeyboardInput { .. } => typing,
            // egui draws without end while a file is held over it
            WindowEvent::HoveredFile(_) | WindowEvent::HoveredFileCancelled | WindowEvent::DroppedFile(_) => false,
            _ => true,
        };
        // a shift or a control key alone changes nothing that is seen
        let seen = for_panel && self.events.on_window_event(&self.window, &event).repaint;
        if seen && !matches!(event, WindowEvent::ModifiersChanged(_)) {
            self.redraw();
        }
        let keys = self.modifiers();
        // who is clicked or typed at is seen, whatever the window system said last
        let used =
            matches!(event, WindowEvent::MouseInput { .. } | WindowEvent::KeyboardInput { .. } | WindowEvent::Focused(true));
        if used && self.hidden {
            self.hide(false);
        }
        match event {
            WindowEvent::CloseRequested => self.closing = true,
            WindowEvent::Resized(size) => {
                self.hidden = size.width == 0 || size.height == 0;
                self.screen.resize(size.width, size.height);
                tracing::debug!("the window has {} x {} pixels", size.width, size.height);
                self.session.touch();
            }
            WindowEvent::Occluded(hidden) => {
                self.hide(hidden);
                self.session.touch();
            }
            WindowEvent::Focused(focused) => {
                self.focused = focused;
                tracing::debug!("focus {} after frame {}", if focused { "gained" } else { "lost" }, self.frames);
                if !focused {
                    self.session.with_tools(|tools, _, _, out| tools.cancel(out));
                }
            }
            WindowEvent::ModifiersChanged(keys) => self.keys = keys.state(),
            WindowEvent::CursorMoved { position, .. } => self.moved(position),
            WindowEvent::MouseInput { state, button, .. } => {
                let button = match button {
                    MouseButton::Left => Button::Left,
                    MouseButton::Middle => Button::Middle,
                    MouseButton::Right => Button::Right,
                    _ => return Ok(()),
                };
                if state == ElementState::Released {
                    tracing::debug!("{button:?} button up at {:.0}, {:.0}", self.cursor.x, self.cursor.y);
                    self.session.with_tools(|tools, _, _, out| tools.release(button, out));
                } else if self.on_canvas() {
                    self.session.with_tools(|tools, t, scene, out| tools.press(button, keys, t, scene, out));
                } else {
                    self.pressed_panel = true;
                }
            }
            WindowEvent::MouseWheel { delta, .. } if self.on_canvas() || self.session.tools.is_busy() => {
                let notches = match delta {
                    // shift turns the wheel sideways on some systems
                    MouseScrollDelta::LineDelta(x, y) => f64::from(if y == 0.0 { x } else { y }),
                    MouseScrollDelta::PixelDelta(by) => (if by.y == 0.0 { by.x } else { by.y }) / 40.0,
                };
                self.session.with_tools(|tools, t, scene, out| tools.wheel(notches, keys, t, scene, out));
            }
            WindowEvent::PinchGesture { delta, .. } if self.on_canvas() => {
                self.session.with_tools(|tools, _, scene, _| tools.zoom(1.0 / (1.0 + delta).max(0.1), scene));
            }
            WindowEvent::KeyboardInput { event, is_synthetic: false, .. } if !typing => self.key(&event),
            WindowEvent::HoveredFile(file) => {
                let name = file.file_name().unwrap_or_default().display().to_string();
                tracing::debug!("{name} is held over the window");
                self.session.panel.hovered = Some(name);
                self.session.touch();
            }
            WindowEvent::HoveredFileCancelled => {
                tracing::debug!("no longer held over the window");
                self.session.panel.hovered = None;
                self.session.touch();
            }
            WindowEvent::DroppedFile(file) => {
                self.session.panel.hovered = None;
                self.act(PanelAction::Open(file.display().to_string()));
            }
            _ => {}
        }
        Ok(())
    }

    fn moved(&mut self, position: PhysicalPosition<f64>) {
        self.cursor = position;
        let pixel = [position.x - self.canvas[0], position.y - self.canvas[1]];
        let busy = self.session.tools.is_busy();
        let (time_s, scene) = (self.session.gesture_time_s(), &self.session.app.scene);
        if busy {
            self.session.with_tools(|tools, t, scene, out| tools.moved(pixel, t, scene, out));
        } else {
            // a cursor that only passes by changes nothing that is seen
            let mut none = Vec::new();
            self.session.tools.moved(pixel, time_s, scene, &mut none);
        }
    }

    fn key(&mut self, event: &KeyEvent) {
        let keys = self.modifiers();
        let space = event.logical_key == Key::Named(NamedKey::Space);
        if event.state == ElementState::Released {
            if space {
                self.session.with_tools(|tools, t, scene, out| tools.squeeze(false, t, scene, out));
            }
            return;
        }
        let Some(command) = keys::command(&event.logical_key, keys.ctrl, keys.shift) else { return };
        tracing::debug!("key: {command:?}");
        let panel = &mut self.session.panel;
        match command {
            KeyCommand::Panel(action) => return self.act(action),
            KeyCommand::TogglePause => return self.act(PanelAction::Pause(!self.session.panel.paused)),
            KeyCommand::ToggleRecord => return self.act(PanelAction::Record(!self.session.panel.recording)),
            KeyCommand::NextAnimation => {
                let next = panel.animation.map_or(0, |now| now + 1);
                let next = (next < panel.animations.len()).then_some(next);
                return self.act(PanelAction::Animate(next));
            }
            KeyCommand::ToggleHelp => panel.help = !panel.help,
            KeyCommand::ToggleCounters => panel.counters_shown = !panel.counters_shown,
            KeyCommand::TogglePanel => panel.open = !panel.open,
            KeyCommand::ToggleFullScreen => {
                let full = self.window.fullscreen().is_none().then_some(Fullscreen::Borderless(None));
                self.window.set_fullscreen(full);
            }
            KeyCommand::Orbit(right, up) => self.session.tools.camera.turn(0.08 * right, 0.08 * up),
            KeyCommand::Zoom(notches) => {
                self.session.with_tools(|tools, _, scene, _| tools.zoom(0.88f64.powf(notches), scene));
            }
            KeyCommand::Deepen(notches) => {
                let [low, high] = panel.depth_range;
                panel.depth = (panel.depth * 1.15f64.powf(notches)).clamp(low, high);
            }
            KeyCommand::Lean(notches) => panel.tilt = (panel.tilt + 0.1 * notches).clamp(-1.2, 1.2),
            KeyCommand::Squeeze if event.repeat => return,
            KeyCommand::Squeeze => {
                self.session.with_tools(|tools, t, scene, out| tools.squeeze(true, t, scene, out));
            }
            KeyCommand::Cancel => {
                panel.notice = None;
                panel.help = false;
                self.session.with_tools(|tools, _, _, out| tools.cancel(out));
            }
            KeyCommand::Quit => self.closing = true,
        }
        self.session.take_panel_values();
        self.session.touch();
    }

    fn draw(&mut self) -> Result<(), DesktopError> {
        // asked for and drawn may be one turn of the loop: a frame ends a rest all the same
        (self.asked, self.rests) = (false, false);
        let frame = match self.screen.acquire() {
            Acquired::Frame(frame) => frame,
            Acquired::Again => {
                self.redraw();
                return Ok(());
            }
            Acquired::Hidden => {
                // nothing says when it can be drawn into again: asked now and then
                (self.unseen, self.last_frame) = (true, Instant::now());
                self.session.touch();
                return Ok(());
            }
        };
        self.unseen = false;
        self.session.take_loaded(self.size());
        self.session.take_written();
        self.pressed_panel = false;
        let raw = self.events.take_egui_input(&self.window);
        let ui = self.panel.run(raw, &mut self.session.panel);
        self.events.handle_platform_output(&self.window, ui.platform);
        let scale = f64::from(ui.pixels_per_point);
        let before = self.canvas;
        self.canvas = ui.canvas.map(|edge| f64::from(edge) * scale);
        if self.canvas != before {
            self.session.tools.resize(self.size());
        }
        for action in ui.actions {
            self.session.act(action, self.size());
        }
        self.session.take_panel_values();
        self.carry_out_wishes();
        let recording = self.session.panel.recording;
        if std::mem::replace(&mut self.recorded, recording) && !recording {
            self.session.write(Order::EndRecording);
        }
        if std::mem::take(&mut self.session.scene_changed) {
            self.screen.forget();
            self.window.set_title(&title(&self.session.panel.model));
        }
        let now = Instant::now();
        self.last_frame = now;
        self.frames += 1;
        if !self.focused {
            tracing::debug!("frame {} in the background", self.frames);
        }
        let input = self.session.next_input(now);
        let preview = self.session.preview();
        let mut target = WindowTarget {
            camera: self.session.tools.camera.pose(),
            instruments: in_hand::instruments(&preview, self.session.tools.settings.diagonal),
            lines: in_hand::lines(&preview),
            screen: &mut self.screen,
            frame: Some(frame),
            ui: Some(UiFrame { jobs: ui.jobs, textures: ui.textures, pixels_per_point: ui.pixels_per_point }),
            left: self.canvas[0],
            wants_shot: std::mem::take(&mut self.wants_shot) || recording,
            shot: None,
            window: &self.window,
            times_passes: self.session.panel.counters_shown,
            passes: Stages::default(),
        };
        match self.session.app.frame(&input, &mut target) {
            Ok(report) => {
                self.losses = 0;
                let shot = target.shot.take();
                self.session.panel.gpu_stages = target.passes;
                if self.frames == 1 {
                    tracing::info!("first frame after {:.2} s", self.session.gesture_time_s());
                }
                self.session.frame_done(report, [self.canvas[0], self.canvas[1]]);
                if let Some(shot) = shot {
                    self.write_shot(shot, recording);
                }
            }
            Err(why @ GpuError::Lost(_)) if self.losses == 3 => return Err(why.into()),
            Err(GpuError::Lost(why)) => {
                self.losses += 1;
                tracing::warn!("the GPU was lost ({why}); starting another device");
                self.screen.replace_lost_device()?;
                let repaint = repaint_by(&self.proxy);
                (self.panel, self.events) = panel_on(&self.window, &self.screen, &self.window, repaint);
                self.session.touch();
            }
            Err(why) => self.session.does_not_fit(&why, self.size()),
        }
        self.repaint_in(ui.repaint_after);
        Ok(())
    }

    fn carry_out_wishes(&mut self) {
        for wish in std::mem::take(&mut self.session.wishes) {
            match wish {
                Wish::Vsync(on) => self.screen.set_vsync(on),
                Wish::Screenshot if self.screen.is_readable() => self.wants_shot = true,
                Wish::Screenshot => self
                    .session
                    .panel
                    .fail("this display's pictures cannot be read back; use the system's own screenshot, or `incise headless`"),
                Wish::OpenDialog => self.ask_for_file(),
            }
        }
    }

    fn ask_for_file(&self) {
        let proxy = self.proxy.clone();
        dialog::ask(&self.window, move |answer| drop(proxy.send_event(Wake::Chosen(answer))));
    }

    fn write_shot(&mut self, (width, height, pixels): Shot, recording: bool) {
        let album = if recording { Album::Recording } else { Album::Screenshots };
        self.session.write(Order::Picture { album, width, height, pixels });
    }

    fn finish(self) -> DesktopRun {
        let seconds = self.session.gesture_time_s();
        let Session { app, panel, frames, strokes, .. } = self.session;
        DesktopRun {
            adapter: panel.adapter,
            model: panel.model,
            seconds,
            edit_hash: app.scene.edit_hash(),
            state_hash: app.scene.state_hash(),
            gpu_error: self.screen.gpu_error(&app.scene),
            frames,
            strokes,
        }
    }
}

fn title(model: &str) -> String {
    format!("Incise: {}", short_name(model))
}

/// When the next frame of what moves is due: at once where it is looked at, else not more than ten times a second.
fn due(now: Instant, last_frame: Instant, in_front: bool) -> Instant {
    if in_front { now } else { last_frame + BACKGROUND }
}

/// How the panel's wish for another frame wakes the loop.
fn repaint_by(proxy: &EventLoopProxy<Wake>) -> impl Fn(Duration) + Send + Sync + 'static {
    let proxy = proxy.clone();
    move |after| drop(proxy.send_event(Wake::Repaint(after)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_in_the_background_draws_ten_frames_a_second_at_most() {
        let last = Instant::now();
        let now = last + Duration::from_millis(3);
        assert_eq!(due(now, last, true), now);
        assert_eq!(due(now, last, false), last + Duration::from_millis(100));
    }
}
