//! One session with one headset: what the runtime gave us, and how a frame gets to the eyes.

use super::board::Board;
use super::capture::{Capture, LeftEye, capture, left_eye};
use super::clock::budget_ms;
use super::error::{Named, VrError};
use super::eye_mirror::{EyeMirror, reflect};
use super::fit::{Fit, GpuLoad};
use super::input::{Input, located};
use super::interop::{self, EyeDepth, Graphics};
use super::lifecycle::{Lifecycle, Order};
use super::passes;
use super::runtime::Runtime;
use super::space::{Placement, Pose};
use super::swapchain::Images;
use crate::app::{FrameCounters, FrameTarget, FrameView};
use crate::config::VrSettings;
use crate::diagnostics::Stages;
use crate::gpu::{
    Bounds, DrawOptions, Fov, Instrument, LineSegment, Passes, RenderTarget, Scenery, ViewPose, ViewSet, VisibilityMask,
};
use crate::host::mirror::Mirror;
use openxr as xr;
use std::time::Instant;

const STEREO: xr::ViewConfigurationType = xr::ViewConfigurationType::PRIMARY_STEREO;
/// Nearest that something is drawn: metres in the room.
const NEAR: f64 = 0.03;
/// Largest side of an eye's picture, whatever a runtime recommends.
const LARGEST: u32 = 8192;

/// A session. Dropped in the order that OpenXR wants: pictures, spaces, frame loop, actions, session, Vulkan, instance.
pub struct Headset {
    mirror: Mirror,
    images: Option<Images>,
    /// Depth of the same pictures, where the compositor takes it.
    depth: Option<Images>,
    base: xr::Space,
    head: xr::Space,
    stream: xr::FrameStream<xr::Vulkan>,
    waiter: xr::FrameWaiter,
    /// Hands and buttons.
    pub input: Input,
    /// The session.
    pub session: xr::Session<xr::Vulkan>,
    graphics: Graphics,
    /// Runtime and headset.
    pub runtime: Runtime,
    blend: xr::EnvironmentBlendMode,
    /// What the lenses hide of each eye; none if nothing, or if the runtime does not say.
    masks: Vec<VisibilityMask>,
    masks_wanted: bool,
    /// How much of the pictures is drawn.
    fit: Fit,
    /// Whether both eyes are drawn in one pass.
    passes: Passes,
    events: xr::EventDataBuffer,
    /// Where the session stands.
    pub life: Lifecycle,
    /// Which space the room is.
    pub base_name: &'static str,
    /// Pictures a second that were asked for, if the headset lets us choose.
    pub refresh_hz: Option<f32>,
}

/// The eyes of one frame, as they were located, and the pixels that were drawn.
pub struct Shown {
    views: Vec<xr::View>,
    part: (u32, u32),
}

impl Headset {
    /// Finds a headset and opens a session.
    pub fn open(settings: &VrSettings) -> Result<Self, VrError> {
        let runtime = Runtime::start()?;
        let graphics = interop::open_graphics(&runtime.instance, runtime.system)?;
        let (session, waiter, stream) = interop::create_session(&runtime.instance, runtime.system, &graphics)?;
        let input = Input::new(&runtime, &session)?;
        let (base, base_name) = base_space(&runtime, &session)?;
        let head =
            session.create_reference_space(xr::ReferenceSpaceType::VIEW, xr::Posef::IDENTITY).named("the space of the head")?;
        let views = runtime.instance.enumerate_view_configuration_views(runtime.system, STEREO).named("the eyes' sizes")?;
        let size = eye_size(&views);
        let images = Images::new(&session, &graphics.context, size, 2)?;
        let passes = passes::choose(settings.multiview, &graphics.context, graphics.context.samples_of(images.format()));
        let depth = if runtime.extensions.khr_composition_layer_depth {
            Images::depth(&session, &graphics.context, size, 2)?
        } else {
            None
        };
        let blend = runtime
            .instance
            .enumerate_environment_blend_modes(runtime.system, STEREO)
            .named("its blend modes")?
            .first()
            .copied()
            .unwrap_or(xr::EnvironmentBlendMode::OPAQUE);
        let refresh_hz = ask_for_rate(&runtime, &session, settings.refresh_rate);
        let mut headset = Self {
            mirror: Mirror::new(graphics.context.clone()),
            images: Some(images),
            depth,
            base,
            head,
            stream,
            waiter,
            input,
            session,
            graphics,
            runtime,
            blend,
            masks: Vec::new(),
            fit: Fit::new(settings.resolution_floor),
            masks_wanted: settings.visibility_mask,
            passes,
            events: xr::EventDataBuffer::new(),
            life: Lifecycle::default(),
            base_name,
            refresh_hz,
        };
        headset.load_masks();
        headset.compile()?;
        if !headset.mirror.renderer_mut().set_timing(true) {
            tracing::info!("this adapter tells no times, so pictures keep their size");
        }
        Ok(headset)
    }

    /// Compiles all that the eyes will ever need, before there is a frame to be late for.
    fn compile(&mut self) -> Result<(), VrError> {
        let Some(images) = &self.images else { return Ok(()) };
        let depth = self.depth.as_ref().map(|d| d.target(0));
        let target = RenderTarget { depth, ..RenderTarget::new(images.target(0)) };
        Ok(self.mirror.renderer_mut().compile_for(&target, 2, self.passes)?)
    }

    /// Another scene: nothing that was drawn is of use any more.
    pub fn forget_scene(&mut self) {
        self.mirror.forget();
    }

    /// Name of the graphics card.
    pub fn adapter(&self) -> &str {
        self.graphics.context.adapter_name()
    }

    /// True if both eyes are drawn in one pass.
    pub fn multiview(&self) -> bool {
        self.passes == Passes::AtOnce
    }

    /// True if the compositor is told how far away things are.
    pub fn gives_depth(&self) -> bool {
        self.depth.is_some()
    }

    /// Width and height of an eye's picture, pixels.
    pub fn eye_size(&self) -> (u32, u32) {
        self.images.as_ref().map_or((0, 0), Images::size)
    }

    /// The smallest share of each side that was drawn because the GPU fell behind.
    pub fn least_resolution(&self) -> f64 {
        self.fit.least()
    }

    /// Where all tissues are, model space, as last drawn.
    pub fn bounds(&self) -> Bounds {
        self.mirror.renderer().bounds()
    }

    /// Takes the runtime's events up to the first that asks for something.
    pub fn poll(&mut self) -> Result<Order, VrError> {
        let mut remask = false;
        let mut order = Order::None;
        while order == Order::None {
            let Some(event) = self.runtime.instance.poll_event(&mut self.events).named("its events")? else { break };
            match event {
                xr::Event::SessionStateChanged(change) => {
                    tracing::info!("the session is {:?}", change.state());
                    order = self.life.enter(change.state());
                }
                xr::Event::InstanceLossPending(_) => order = Order::Recreate,
                xr::Event::VisibilityMaskChangedKHR(_) => remask = true,
                xr::Event::DisplayRefreshRateChangedFB(change) => self.refresh_hz = Some(change.to_display_refresh_rate()),
                xr::Event::InteractionProfileChanged(_) => self.input.look_for_bare_hands(&self.session),
                xr::Event::EventsLost(lost) => tracing::warn!("the runtime lost {} events", lost.lost_event_count()),
                _ => {}
            }
        }
        if remask {
            self.load_masks();
        }
        match order {
            Order::Begin => drop(self.session.begin(STEREO).named("the session's begin")?),
            Order::End => drop(self.session.end().named("the session's end")?),
            _ => {}
        }
        Ok(order)
    }

    /// Waits until the runtime wants a frame.
    pub fn wait(&mut self) -> Result<xr::FrameState, VrError> {
        self.waiter.wait().named("xrWaitFrame")
    }

    /// Begins the frame that was waited for.
    pub fn begin(&mut self) -> Result<(), VrError> {
        self.stream.begin().named("xrBeginFrame")
    }

    /// What the board draws with.
    pub fn context(&self) -> std::sync::Arc<crate::gpu::Context> {
        self.graphics.context.clone()
    }

    /// Ends the frame, with what was drawn for it, and the board in front of it.
    pub fn end(&mut self, state: &xr::FrameState, shown: Option<&Shown>, board: Option<&Board>) -> Result<(), VrError> {
        let time = state.predicted_display_time;
        let (Some(shown), Some(images)) = (shown, &self.images) else {
            return self.stream.end(time, self.blend, &[]).named("xrEndFrame");
        };
        let rect = from_corner(shown.part);
        let swapchain = images.lock();
        let depths = self.depth.as_ref().map(Images::lock);
        let depths = depths.as_ref().map(|d| [0, 1].map(|layer| EyeDepth::new(d, layer, rect, NEAR as f32)));
        let eye = |i: usize| {
            let image = xr::SwapchainSubImage::new().swapchain(&swapchain).image_array_index(i as u32).image_rect(rect);
            let view = &shown.views[i];
            let eye = xr::CompositionLayerProjectionView::new().pose(view.pose).fov(view.fov).sub_image(image);
            match &depths {
                Some(depths) => depths[i].of(eye),
                None => eye,
            }
        };
        let eyes = [eye(0), eye(1)];
        let layer = xr::CompositionLayerProjection::new().space(&self.base).views(&eyes);
        let Some((picture, place, (wide, high))) = board.and_then(Board::shown) else {
            return self.stream.end(time, self.blend, &[&layer]).named("xrEndFrame");
        };
        let rect = from_corner(picture.size());
        let quad_images = picture.lock();
        let quad = xr::CompositionLayerQuad::new()
            .space(&self.base)
            .eye_visibility(xr::EyeVisibility::BOTH)
            .sub_image(xr::SwapchainSubImage::new().swapchain(&quad_images).image_array_index(0).image_rect(rect))
            .pose(place.to_xr())
            .size(xr::Extent2Df { width: wide as f32, height: high as f32 });
        self.stream.end(time, self.blend, &[&layer, &quad]).named("xrEndFrame")
    }

    /// Hands the images of the frame to the compositor.
    fn release(&self) -> Result<(), VrError> {
        self.images.iter().chain(&self.depth).try_for_each(Images::release)
    }

    /// The hands and their buttons at `time`.
    pub fn hands(&mut self, time: xr::Time) -> Result<super::input::HandsInput, VrError> {
        self.input.read(&self.session, &self.base, time)
    }

    /// The hands alone, after asking the runtime anew.
    pub fn look_at_hands(&self, time: xr::Time) -> Result<[super::input::Hand; 2], VrError> {
        self.input.sync(&self.session)?;
        self.input.hands(&self.session, &self.base, time)
    }

    /// The head at `time`, if it is tracked.
    pub fn head(&self, time: xr::Time) -> Result<Option<Pose>, VrError> {
        located(&self.head, &self.base, time)
    }

    /// The eyes at `time`, if they are known.
    fn eyes(&self, time: xr::Time) -> Result<Option<Vec<xr::View>>, VrError> {
        let (flags, views) = self.session.locate_views(STEREO, time, &self.base).named("xrLocateViews")?;
        let valid = xr::ViewStateFlags::POSITION_VALID | xr::ViewStateFlags::ORIENTATION_VALID;
        Ok((flags.contains(valid) && views.len() == 2).then_some(views))
    }

    /// What the lenses hide of each eye, if the runtime knows.
    fn load_masks(&mut self) {
        if !self.masks_wanted || !self.runtime.extensions.khr_visibility_mask {
            return;
        }
        let mask = |eye| {
            let hidden = xr::VisibilityMaskTypeKHR::HIDDEN_TRIANGLE_MESH;
            let mask = self.session.get_visibility_mask_khr(STEREO, eye, hidden).ok()?;
            let corners = mask.vertices.iter().map(|v| [v.x, v.y]).collect();
            Some(VisibilityMask { corners, indices: mask.indices })
        };
        let masks: Vec<VisibilityMask> = (0..2).filter_map(mask).collect();
        let hides = masks.len() == 2 && masks.iter().any(|m| !m.indices.is_empty());
        self.masks = if hides { masks } else { Vec::new() };
        self.mirror.renderer_mut().set_visibility_masks(&self.masks);
    }
}

impl Drop for Headset {
    fn drop(&mut self) {
        // The compositor's images go back before the session ends: what still uses them runs out first. Errors mean that the
        // device is gone, and with it what there was to wait for.
        let _ = self.graphics.context.wait();
        (self.images, self.depth) = (None, None);
        let _ = self.graphics.context.wait();
    }
}

/// The upper left pixels of an image.
fn from_corner((width, height): (u32, u32)) -> xr::Rect2Di {
    xr::Rect2Di { offset: xr::Offset2Di { x: 0, y: 0 }, extent: xr::Extent2Di { width: width as i32, height: height as i32 } }
}

/// A room whose origin is where the eyes were, and not on the floor.
pub const AT_EYES: &str = "local";

/// The room: floor-level and centred on the user if there is such a space, else the play area, else centred at eye height.
fn base_space(runtime: &Runtime, session: &xr::Session<xr::Vulkan>) -> Result<(xr::Space, &'static str), VrError> {
    let offered = session.enumerate_reference_spaces().named("its spaces")?;
    let wanted = [
        (xr::ReferenceSpaceType::LOCAL_FLOOR, "local floor", runtime.extensions.ext_local_floor),
        (xr::ReferenceSpaceType::STAGE, "stage", true),
        (xr::ReferenceSpaceType::LOCAL, AT_EYES, true),
    ];
    let (kind, name, _) = wanted.into_iter().find(|(kind, _, known)| *known && offered.contains(kind)).unwrap_or((
        xr::ReferenceSpaceType::LOCAL,
        AT_EYES,
        true,
    ));
    Ok((session.create_reference_space(kind, xr::Posef::IDENTITY).named("the space of the room")?, name))
}

/// As the runtime recommends, both eyes alike: they are layers of one image.
fn eye_size(views: &[xr::ViewConfigurationView]) -> (u32, u32) {
    let largest = |side: fn(&xr::ViewConfigurationView) -> u32| views.iter().map(side).max().unwrap_or(0).clamp(1, LARGEST);
    (largest(|v| v.recommended_image_rect_width), largest(|v| v.recommended_image_rect_height))
}

/// Asks for the offered rate nearest to `wanted` (0: none).
fn ask_for_rate(runtime: &Runtime, session: &xr::Session<xr::Vulkan>, wanted: f64) -> Option<f32> {
    if !runtime.extensions.fb_display_refresh_rate {
        return None;
    }
    if wanted > 0.0 {
        let rates = session.enumerate_display_refresh_rates().unwrap_or_default();
        let distance = |rate: &f32| (f64::from(*rate) - wanted).abs();
        if let Some(&rate) = rates.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))
            && let Err(answer) = session.request_display_refresh_rate(rate)
        {
            tracing::warn!("the headset does not change to {rate} pictures a second ({answer})");
        }
    }
    session.get_display_refresh_rate().ok()
}

/// Brings a frame to the eyes.
pub struct EyeTarget<'a> {
    /// The session.
    pub headset: &'a mut Headset,
    /// What the GPU's passes took, a few frames ago.
    pub gpu: Stages,
    /// When the frame is seen.
    pub time: xr::Time,
    /// How long its picture is shown, as the runtime predicts.
    pub period: xr::Duration,
    /// What the GPU's load is taken from.
    pub load: GpuLoad,
    /// False where the runtime wants no picture.
    pub render: bool,
    /// Where the model stands.
    pub placement: Placement,
    /// What the hands hold, and the plane of a cut, model space.
    pub instruments: &'a [Instrument],
    /// The pointer's ray, model space.
    pub lines: &'a [LineSegment],
    /// Waits for the pictures of this frame: a test driver's wish.
    pub capture: bool,
    /// Asks for a picture of what the left eye sees: a user's, which nobody waits for.
    pub asks_picture: bool,
    /// The window that shows one eye, too.
    pub mirror: &'a mut Option<EyeMirror>,
    /// What was drawn.
    pub shown: Option<Shown>,
    /// The pictures that were waited for.
    pub captured: Option<Capture>,
    /// The picture that was asked for.
    pub picture: Option<LeftEye>,
    /// Deltas of edits that the frame brought: something was torn.
    pub changes: usize,
    /// Counts heap allocations so far.
    pub allocations: fn() -> u64,
    /// Those of bringing the renderer up to date.
    pub allocated: u64,
    /// Seconds that this thread has been on a core so far, where somebody wants to know.
    pub core_clock: fn() -> Option<f64>,
    /// Of the time this thread was on a core, what went to waiting for the compositor, the driver and the runtime. Seconds.
    pub core_elsewhere: f64,
}

impl EyeTarget<'_> {
    fn view_poses(&self, views: &[xr::View]) -> Option<[ViewPose; 2]> {
        let pose = |view: &xr::View| {
            let eye = self.placement.pose_to_model(&Pose::from_xr(&view.pose)?);
            let angle = |a: f32| f64::from(a);
            let fov = Fov {
                left: angle(view.fov.angle_left),
                right: angle(view.fov.angle_right),
                down: angle(view.fov.angle_down),
                up: angle(view.fov.angle_up),
            };
            let near = self.placement.length_to_model(NEAR);
            Some(ViewPose { position: eye.position, rotation: eye.rotation, fov, near }).filter(|v| v.check().is_ok())
        };
        Some([pose(&views[0])?, pose(&views[1])?])
    }

    /// Draws both eyes.
    fn draw(&mut self, view: &FrameView) -> Result<Elsewhere, VrError> {
        let mut elsewhere = Elsewhere::default();
        let Some(views) = self.headset.eyes(self.time)? else { return Ok(elsewhere) };
        let Some(poses) = self.view_poses(&views) else { return Ok(elsewhere) };
        let layers = self.headset.mirror.layer_lines(view);
        let all: Vec<LineSegment>;
        let lines = match (layers.is_empty(), self.lines.is_empty()) {
            (true, _) => self.lines,
            (false, true) => &layers,
            (false, false) => {
                all = layers.iter().chain(self.lines).copied().collect();
                &all
            }
        };
        let instruments = self.instruments;
        let Headset { mirror, images, depth, graphics, masks, fit, refresh_hz, passes, .. } = &mut *self.headset;
        let options = DrawOptions { lines, instruments, scenery: scenery(view.scene), passes: *passes, ..DrawOptions::default() };
        let Some(images) = images else { return Ok(elsewhere) };
        let context = graphics.context.clone();
        let times = mirror.renderer_mut().gpu_times();
        let part = fit.frame(self.load, times, budget_ms(*refresh_hz, self.period.as_nanos()), images.size());
        let start = Moment::now(self.core_clock);
        let index = images.acquire()?;
        let depth = match depth {
            Some(depth) => Some(depth.target(depth.acquire()?)),
            None => None,
        };
        elsewhere.image_s = start.passed(&mut elsewhere.core_s);
        let mut encoder = context.device().create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("eyes") });
        let set = ViewSet { views: &poses, masked: !masks.is_empty() };
        let target = RenderTarget { depth, viewport: Some(part), ..RenderTarget::new(images.target(index)) };
        if let Err(error) = mirror.renderer_mut().encode(&mut encoder, &set, &target, &options) {
            self.headset.release()?;
            return Err(error.into());
        }
        // The head has moved on while we drew: the latest poses win, and those are what the compositor is told.
        let late = self.headset.eyes(self.time)?.and_then(|views| Some((self.view_poses(&views)?, views)));
        let (poses, views) = late.unwrap_or((poses, views));
        let Headset { mirror, images, masks, .. } = &mut *self.headset;
        let Some(images) = images else { return Ok(elsewhere) };
        mirror.renderer_mut().set_late_views(&poses)?;
        let commands = encoder.finish();
        let start = Moment::now(self.core_clock);
        context.queue().submit([commands]);
        elsewhere.submit_s = start.passed(&mut elsewhere.core_s);
        if self.capture {
            self.captured = Some(capture(&context, images, index, part, &poses, masks)?);
        }
        if self.asks_picture {
            self.picture = Some(left_eye(&context, images, index, part)?);
        }
        reflect(self.mirror, images, index, part);
        let start = Moment::now(self.core_clock);
        self.headset.release()?;
        elsewhere.submit_s += start.passed(&mut elsewhere.core_s);
        context.check()?;
        self.shown = Some(Shown { views, part });
        Ok(elsewhere)
    }
}

/// What of a frame's drawing is none of our work. Seconds.
#[derive(Clone, Copy, Default)]
struct Elsewhere {
    /// Waiting for the compositor to give an image back.
    image_s: f64,
    /// In the driver and the runtime, which take over what was encoded. A software adapter runs much of it there and then.
    submit_s: f64,
    /// For so long this thread was on a core in all that.
    core_s: f64,
}

/// A moment, by the clock and by what the thread has used of a core.
struct Moment {
    clock: Instant,
    core_s: f64,
    core_clock: fn() -> Option<f64>,
}

impl Moment {
    fn now(core_clock: fn() -> Option<f64>) -> Self {
        Self { core_s: core_clock().unwrap_or(0.0), clock: Instant::now(), core_clock }
    }

    /// Seconds since; those on a core are added to `core_s`.
    fn passed(self, core_s: &mut f64) -> f64 {
        let seconds = self.clock.elapsed().as_secs_f64();
        *core_s += (self.core_clock)().unwrap_or(0.0) - self.core_s;
        seconds
    }
}

impl FrameTarget for EyeTarget<'_> {
    type Error = VrError;

    fn present(&mut self, view: &FrameView, stages: &mut Stages, counters: &mut FrameCounters) -> Result<(), VrError> {
        self.changes = view.changes.len();
        let before = (self.allocations)();
        stages.time("upload", || self.headset.mirror.sync(view))?;
        self.allocated = (self.allocations)() - before;
        if self.render {
            let start = Instant::now();
            let Elsewhere { image_s, submit_s, core_s } = self.draw(view)?;
            stages.add("draw", 1e3 * (start.elapsed().as_secs_f64() - image_s - submit_s));
            stages.add("image", 1e3 * image_s);
            stages.add("submit", 1e3 * submit_s);
            self.core_elsewhere = core_s;
            self.gpu = self.headset.mirror.gpu_stages();
        }
        self.headset.mirror.count(counters);
        Ok(())
    }
}

/// What stands around the model: level, since the model is only ever turned about the vertical.
pub fn scenery(scene: &crate::scene::Scene) -> Scenery {
    let (min, max) = scene.ground_bounds();
    Scenery { ground: Some(Bounds { min, max }), ..Scenery::default() }
}
