//! A window that shows what somebody else draws, to those who look on: no panel, no tools, no vertical synchronisation.
//!
//! It lives on a thread of its own, which alone waits: for the window system, and for something to draw into. Who draws asks
//! [`Spectator::ready`] once a frame and takes what is there.

use crate::gpu::Context;
use crate::host::words_of_window;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::dpi::LogicalSize;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoop, EventLoopBuilder, EventLoopProxy};
use winit::window::{Window, WindowId};

/// How long the window's thread may take to open or to let go of a device.
const PATIENCE: Duration = Duration::from_secs(5);
/// A surface that no longer fits, or has nothing to give, is asked again after this.
const AGAIN: Duration = Duration::from_millis(500);
/// Doublings of that, at most, while fitting it does not help.
const MOST_DOUBLINGS: u32 = 6;

/// What is asked of the window's thread.
enum Ask {
    /// A surface for this device's instance.
    Attach(Arc<Context>),
    /// Something to draw into.
    Next,
    /// Let go of the surface.
    Detach,
    /// Close.
    Leave,
}

/// What it answers.
enum Answer {
    Open(EventLoopProxy<Ask>),
    Surface(Arc<wgpu::Surface<'static>>, (u32, u32)),
    Frame(wgpu::SurfaceTexture),
    Nothing(Lack),
    Detached,
    /// There is no window, or no surface of it.
    Refused(String),
}

/// Why there is nothing to draw into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lack {
    /// The window is hidden, or its pictures are all in use: there will be something again by itself.
    ForNow,
    /// The surface does not fit the window any more, whose size this is. Fitting it waits until the GPU has nothing to do, and the
    /// headset waits, too: its queue is the same.
    Unfit((u32, u32)),
}

/// A device's hold on the window.
struct Attached {
    /// Something to draw into; above the surface, which must outlive it.
    frame: Option<wgpu::SurfaceTexture>,
    context: Arc<Context>,
    surface: Arc<wgpu::Surface<'static>>,
    config: wgpu::SurfaceConfiguration,
    /// Something was asked for and has not come yet.
    asked: bool,
    /// Ask again then, and fit the surface to the window before if this is true.
    again: Option<(Instant, bool)>,
    /// So often it was fitted in a row, and gave nothing all the same.
    unfit: u32,
}

/// Something to draw into.
pub struct Ready<'a> {
    /// The device that it belongs to.
    pub context: &'a Arc<Context>,
    /// The window's next picture.
    pub texture: &'a wgpu::Texture,
    /// The format to see it in.
    pub format: wgpu::TextureFormat,
}

/// The window, as those see it who draw.
pub struct Spectator {
    asks: EventLoopProxy<Ask>,
    answers: Receiver<Answer>,
    closed: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    coming: Option<Arc<Context>>,
    attached: Option<Attached>,
}

impl Spectator {
    /// Opens a window of this size, in points. Errors: no display, no window, as a sentence.
    pub fn open(title: &str, size: (u32, u32)) -> Result<Self, String> {
        let (sender, answers) = channel();
        let closed = Arc::new(AtomicBool::new(false));
        let window = Onlooker { title: title.into(), size, answers: sender, closed: closed.clone(), window: None, surface: None };
        let thread = std::thread::Builder::new().name("spectator".into()).spawn(move || window.run());
        let thread = thread.map_err(|e| e.to_string())?;
        match answers.recv_timeout(PATIENCE) {
            Ok(Answer::Open(asks)) => Ok(Self { asks, answers, closed, thread: Some(thread), coming: None, attached: None }),
            Ok(Answer::Refused(why)) => Err(why),
            _ => Err("the window system does not answer".into()),
        }
    }

    /// True once the user has closed the window.
    pub fn is_closed(&self) -> bool {
        self.closed.load(Ordering::Relaxed)
    }

    /// Draws with this device from now on, as soon as the window's thread has made it a surface.
    pub fn attach(&mut self, context: &Arc<Context>) {
        self.detach();
        self.coming = Some(context.clone());
        self.ask(Ask::Attach(context.clone()));
    }

    /// Something to draw into, if there is. Never waits. Errors: this window can show nothing of this device, or it is gone.
    pub fn ready(&mut self) -> Result<Option<Ready<'_>>, String> {
        while let Some(answer) = next(&self.answers, self.is_closed())? {
            match answer {
                Answer::Surface(surface, size) => {
                    let Some(context) = self.coming.take() else { continue };
                    self.attached = Some(Attached::new(context, surface, size)?);
                    self.ask_for_frame();
                }
                Answer::Frame(frame) => {
                    if let Some(attached) = &mut self.attached {
                        (attached.frame, attached.asked, attached.unfit) = (Some(frame), false, 0);
                    }
                }
                Answer::Nothing(lack) => {
                    if let Some(attached) = &mut self.attached {
                        attached.lacks(lack);
                    }
                }
                Answer::Refused(why) => return Err(why),
                Answer::Open(_) | Answer::Detached => {}
            }
        }
        let due = self.attached.as_ref().and_then(|a| a.again).filter(|(at, _)| *at <= Instant::now());
        if let (Some((_, fit)), Some(attached)) = (due, &mut self.attached) {
            attached.again = None;
            if fit {
                attached.surface.configure(attached.context.device(), &attached.config);
            }
            self.ask_for_frame();
        }
        let Some(attached) = &mut self.attached else { return Ok(None) };
        let Attached { context, frame, config, .. } = attached;
        Ok(frame.as_ref().map(|frame| Ready { context, texture: &frame.texture, format: config.format }))
    }

    /// Shows what was drawn into the texture of the last [`Spectator::ready`], and asks for another. Nothing is waited for: the
    /// surface shows pictures as they come. False if there was nothing.
    pub fn show(&mut self) -> bool {
        let Some((attached, frame)) = self.attached.as_mut().and_then(|a| a.frame.take().map(|f| (a, f))) else { return false };
        attached.context.queue().present(frame);
        self.ask_for_frame();
        true
    }

    /// Lets go of the device; waits until the window's thread has, too. What the surface has given goes before it.
    pub fn detach(&mut self) {
        let Some(attached) = self.attached.take() else {
            if self.coming.take().is_some() {
                self.ask(Ask::Detach);
                self.wait_for(|answer| matches!(answer, Answer::Detached));
            }
            return;
        };
        if attached.asked {
            self.wait_for(|answer| matches!(answer, Answer::Frame(_) | Answer::Nothing(_)));
        }
        drop(attached);
        self.ask(Ask::Detach);
        self.wait_for(|answer| matches!(answer, Answer::Detached));
    }

    /// Waits for an answer, and drops it and those before it.
    fn wait_for(&self, is_it: fn(&Answer) -> bool) {
        let start = Instant::now();
        while let Some(left) = PATIENCE.checked_sub(start.elapsed()) {
            match self.answers.recv_timeout(left) {
                Ok(answer) if !is_it(&answer) => {}
                _ => return,
            }
        }
    }

    fn ask_for_frame(&mut self) {
        if let Some(attached) = &mut self.attached {
            attached.asked = true;
        }
        self.ask(Ask::Next);
    }

    fn ask(&self, ask: Ask) {
        drop(self.asks.send_event(ask)); // a window that is gone needs nothing
    }
}

impl Drop for Spectator {
    fn drop(&mut self) {
        self.detach();
        self.ask(Ask::Leave);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Attached {
    fn new(context: Arc<Context>, surface: Arc<wgpu::Surface<'static>>, size: (u32, u32)) -> Result<Self, String> {
        let caps = surface.get_capabilities(context.adapter());
        let present_mode = unhurried(&caps.present_modes)?;
        let format = caps.formats.iter().copied().find(wgpu::TextureFormat::is_srgb).or(caps.formats.first().copied());
        let config = wgpu::SurfaceConfiguration {
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            format: format.ok_or("the headset's graphics card draws into no window")?,
            color_space: wgpu::SurfaceColorSpace::Auto,
            width: size.0.max(1),
            height: size.1.max(1),
            present_mode,
            desired_maximum_frame_latency: 2,
            alpha_mode: wgpu::CompositeAlphaMode::Auto,
            view_formats: Vec::new(),
        };
        surface.configure(context.device(), &config);
        Ok(Self { context, surface, config, frame: None, asked: false, again: None, unfit: 0 })
    }

    /// The surface has given nothing.
    fn lacks(&mut self, lack: Lack) {
        self.asked = false;
        self.again = Some(match lack {
            Lack::ForNow => (Instant::now() + AGAIN, false),
            Lack::Unfit(size) => {
                (self.config.width, self.config.height) = (size.0.max(1), size.1.max(1));
                self.unfit += 1;
                (Instant::now() + before_fitting(self.unfit), true)
            }
        });
    }
}

/// How long to wait before the surface is fitted to the window, for so many times in a row that it did not fit.
fn before_fitting(times: u32) -> Duration {
    AGAIN * 2u32.pow(times.saturating_sub(1).min(MOST_DOUBLINGS))
}

/// What a surface that gave no picture lacks, for a window of this size. One that is minimised cannot be fitted to.
fn lack(given: &wgpu::CurrentSurfaceTexture, minimised: bool, size: (u32, u32)) -> Lack {
    use wgpu::CurrentSurfaceTexture::{Occluded, Timeout};
    if minimised || size.0 == 0 || size.1 == 0 || matches!(given, Timeout | Occluded) {
        return Lack::ForNow;
    }
    Lack::Unfit(size)
}

/// How pictures are shown without waiting for the display's clock. Errors: all ways wait.
fn unhurried(offered: &[wgpu::PresentMode]) -> Result<wgpu::PresentMode, String> {
    let wanted = [wgpu::PresentMode::Mailbox, wgpu::PresentMode::Immediate];
    let found = wanted.into_iter().find(|mode| offered.contains(mode));
    found.ok_or_else(|| format!("this display shows pictures at its own pace only ({offered:?}), and the headset cannot wait"))
}

/// The window itself, on its thread.
struct Onlooker {
    title: String,
    size: (u32, u32),
    answers: Sender<Answer>,
    closed: Arc<AtomicBool>,
    window: Option<Arc<Window>>,
    surface: Option<Arc<wgpu::Surface<'static>>>,
}

impl Onlooker {
    fn run(mut self) {
        // A missing libxkbcommon-x11 makes the window library panic rather than say so.
        let events = match std::panic::catch_unwind(event_loop) {
            Ok(Ok(events)) => events,
            Ok(Err(why)) => return self.answer(Answer::Refused(why)),
            Err(_) => return self.answer(Answer::Refused("a library of the window system is missing".into())),
        };
        self.answer(Answer::Open(events.create_proxy()));
        if let Err(why) = events.run_app(&mut self) {
            self.answer(Answer::Refused(words_of_window(why)));
        }
    }

    fn answer(&self, answer: Answer) {
        drop(self.answers.send(answer)); // who does not listen has left
    }

    fn is_minimised(&self) -> bool {
        self.window.as_ref().and_then(|w| w.is_minimized()).unwrap_or(false)
    }

    fn inner_size(&self) -> (u32, u32) {
        self.window.as_ref().map_or(self.size, |w| w.inner_size().into())
    }

    fn attach(&mut self, context: &Context) {
        let made = match &self.window {
            Some(window) => {
                let target = wgpu::SurfaceTarget::DisplayAndWindow(Box::new(window.clone()));
                context.instance().create_surface(target).map_err(|e| e.to_string())
            }
            None => Err("there is no window".into()),
        };
        match made {
            Ok(surface) => {
                let surface = Arc::new(surface);
                self.surface = Some(surface.clone());
                self.answer(Answer::Surface(surface, self.inner_size()));
            }
            Err(why) => self.answer(Answer::Refused(why)),
        }
    }

    fn next(&self) {
        let Some(surface) = &self.surface else { return };
        self.answer(match surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(frame) | wgpu::CurrentSurfaceTexture::Suboptimal(frame) => Answer::Frame(frame),
            none => Answer::Nothing(lack(&none, self.is_minimised(), self.inner_size())),
        });
    }
}

fn event_loop() -> Result<EventLoop<Ask>, String> {
    let mut builder = EventLoop::<Ask>::with_user_event();
    off_the_main_thread(&mut builder)?;
    builder.build().map_err(words_of_window)
}

#[cfg(target_os = "windows")]
fn off_the_main_thread(builder: &mut EventLoopBuilder<Ask>) -> Result<(), String> {
    winit::platform::windows::EventLoopBuilderExtWindows::with_any_thread(builder, true);
    Ok(())
}

#[cfg(all(unix, not(any(target_os = "macos", target_os = "ios", target_os = "android"))))]
fn off_the_main_thread(builder: &mut EventLoopBuilder<Ask>) -> Result<(), String> {
    winit::platform::x11::EventLoopBuilderExtX11::with_any_thread(builder, true);
    Ok(())
}

#[cfg(not(any(target_os = "windows", all(unix, not(any(target_os = "macos", target_os = "ios", target_os = "android"))))))]
fn off_the_main_thread(_: &mut EventLoopBuilder<Ask>) -> Result<(), String> {
    Err("on this system windows belong to the main thread, which the headset needs".into())
}

impl ApplicationHandler<Ask> for Onlooker {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.window.is_some() {
            return;
        }
        let size = LogicalSize::new(self.size.0, self.size.1);
        // Of one size: another one would have the device stand still for a moment, which is the headset's, too.
        let attributes = Window::default_attributes().with_title(&self.title).with_inner_size(size).with_resizable(false);
        match events.create_window(attributes) {
            Ok(window) => self.window = Some(Arc::new(window)),
            Err(why) => {
                self.answer(Answer::Refused(words_of_window(why)));
                events.exit();
            }
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, ask: Ask) {
        match ask {
            Ask::Attach(context) => self.attach(&context),
            Ask::Next => self.next(),
            Ask::Detach => {
                self.surface = None;
                self.answer(Answer::Detached);
            }
            Ask::Leave => events.exit(),
        }
    }

    fn window_event(&mut self, _: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        if matches!(event, WindowEvent::CloseRequested) {
            self.closed.store(true, Ordering::Relaxed);
        }
    }
}

/// The next answer, if there is one. Errors: there will be none, and it is not the user who `closed` the window.
fn next(answers: &Receiver<Answer>, closed: bool) -> Result<Option<Answer>, String> {
    match answers.try_recv() {
        Ok(answer) => Ok(Some(answer)),
        Err(TryRecvError::Disconnected) if !closed => Err("the window system has taken the window away".into()),
        Err(_) => Ok(None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wgpu::PresentMode;

    #[test]
    fn a_window_that_is_gone_is_told_of_unless_the_user_closed_it() {
        let (sender, answers) = channel();
        assert!(matches!(next(&answers, false), Ok(None)), "it is there, and has nothing to say");
        sender.send(Answer::Detached).expect("it is heard");
        drop(sender);
        assert!(matches!(next(&answers, false), Ok(Some(Answer::Detached))), "its last words come first");
        assert!(next(&answers, false).is_err() && matches!(next(&answers, true), Ok(None)));
    }

    #[test]
    fn a_window_that_is_hidden_is_not_fitted_to_and_others_ever_more_seldom() {
        use wgpu::CurrentSurfaceTexture::{Lost, Occluded, Outdated, Timeout};
        let shown = (960, 720);
        for given in [Outdated, Lost] {
            assert_eq!(lack(&given, false, shown), Lack::Unfit(shown));
            assert_eq!([lack(&given, true, shown), lack(&given, false, (0, 0))], [Lack::ForNow; 2], "minimised");
        }
        assert_eq!([lack(&Timeout, false, shown), lack(&Occluded, false, shown)], [Lack::ForNow; 2]);
        let waits: Vec<Duration> = (1..20).map(before_fitting).collect();
        assert_eq!(waits[0], AGAIN);
        assert!(waits.windows(2).all(|w| w[1] >= w[0]) && waits[1] == 2 * AGAIN && waits[18] == 64 * AGAIN);
    }

    #[test]
    fn the_display_s_clock_is_never_waited_for() {
        assert_eq!(unhurried(&[PresentMode::Fifo, PresentMode::Immediate]), Ok(PresentMode::Immediate));
        assert_eq!(unhurried(&[PresentMode::Immediate, PresentMode::Fifo, PresentMode::Mailbox]), Ok(PresentMode::Mailbox));
        assert!(unhurried(&[PresentMode::Fifo, PresentMode::FifoRelaxed]).is_err());
    }
}
