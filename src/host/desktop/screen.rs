//! A window's surface: what a frame is drawn into and how it gets on the display.

use super::DesktopError;
use crate::app::{FrameCounters, FrameTarget, FrameView};
use crate::diagnostics::Stages;
use crate::gpu::context::open_device;
use crate::gpu::readback::PictureCopy;
use crate::gpu::ui::{UiFrame, UiPass};
use crate::gpu::{
    Bounds, ColourTarget, Context, DrawOptions, GpuError, Instrument, LineSegment, RenderTarget, Scenery, ViewPose, ViewSet,
};
use crate::host::mirror::Mirror;
use crate::host::writer::Encode;
use crate::input::CameraPose;
use glam::{DMat3, DQuat, DVec3};
use std::sync::Arc;
use winit::event_loop::ActiveEventLoop;
use winit::window::Window;

/// The surface of one window, and all that is drawn into it.
pub struct Screen {
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    /// Format of the view that the scene is drawn into.
    scene_format: wgpu::TextureFormat,
    context: Arc<Context>,
    mirror: Mirror,
    ui: UiPass,
    readable: bool,
}

/// What came of asking for something to draw into.
pub enum Acquired {
    /// A texture of the surface.
    Frame(wgpu::SurfaceTexture),
    /// The surface has to be asked again.
    Again,
    /// Nothing can be drawn now: the window is hidden.
    Hidden,
}

/// A picture of the window on its way back: width, height, and what waits for its RGBA8.
pub type Shot = (u32, u32, Encode);

impl Screen {
    /// Opens an adapter that can draw into the window. Errors: no such adapter, no device.
    pub fn new(events: &ActiveEventLoop, window: &Arc<Window>) -> Result<Self, DesktopError> {
        let display = Box::new(events.owned_display_handle());
        let mut descriptor = wgpu::InstanceDescriptor::new_with_display_handle_from_env(display);
        descriptor.backends &= wgpu::Backends::PRIMARY;
        let instance = wgpu::Instance::new(descriptor);
        let no_surface = |e: &dyn std::fmt::Display| DesktopError::NoSurface(e.to_string());
        let surface = instance.create_surface(window.clone()).map_err(|e| no_surface(&e))?;
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            compatible_surface: Some(&surface),
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options)).map_err(|e| no_surface(&e))?;
        let (device, queue) = open_device(&adapter)?;
        let caps = surface.get_capabilities(&adapter);
        let format = egui_wgpu::preferred_framebuffer_format(&caps.formats).map_err(|e| no_surface(&e))?;
        let twins = adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::SURFACE_VIEW_FORMATS);
        let scene_format = if twins { format.add_srgb_suffix() } else { format };
        let readable = caps.usages.contains(wgpu::TextureUsages::COPY_SRC);
        let usage = if readable { wgpu::TextureUsages::COPY_SRC } else { wgpu::TextureUsages::empty() };
        let size = window.inner_size();
        let config = wgpu::SurfaceConfiguration {
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
            format,
            color_space: wgpu::SurfaceColorSpace::Auto,
            width: size.width.max(1),
            height: size.height.max(1),
            present_mode: wgpu::PresentMode::AutoVsync,
            desired_maximum_frame_latency: 2,
            alpha_mode: wgpu::CompositeAlphaMode::Auto,
            view_formats: if scene_format == format { Vec::new() } else { vec![scene_format] },
        };
        let context = Arc::new(Context::from_parts(instance, adapter, device, queue));
        surface.configure(context.device(), &config);
        let ui = UiPass::new(&context, format);
        Ok(Self { surface, config, scene_format, mirror: Mirror::new(context.clone()), context, ui, readable })
    }

    /// See [`Mirror::gpu_error`]; infinite if the GPU does not answer.
    pub fn gpu_error(&self, scene: &crate::scene::Scene) -> f64 {
        self.mirror.gpu_error(scene).unwrap_or(f64::INFINITY)
    }

    /// Name of the adapter.
    pub fn adapter_name(&self) -> &str {
        self.context.adapter_name()
    }

    /// Longest side of a texture, pixels.
    pub fn longest_side(&self) -> u32 {
        self.context.device().limits().max_texture_dimension_2d
    }

    /// Pixels that can be read back for a picture.
    pub fn is_readable(&self) -> bool {
        self.readable
    }

    /// Width and height, pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.config.width, self.config.height)
    }

    /// The window has another size now; a side of 0 is a window that cannot be seen and changes nothing.
    pub fn resize(&mut self, width: u32, height: u32) {
        let most = self.longest_side();
        if width > 0 && height > 0 {
            (self.config.width, self.config.height) = (width.min(most), height.min(most));
            self.configure();
        }
    }

    /// Frames wait for the display's clock, or do not.
    pub fn set_vsync(&mut self, on: bool) {
        self.config.present_mode = if on { wgpu::PresentMode::AutoVsync } else { wgpu::PresentMode::AutoNoVsync };
        self.configure();
    }

    fn configure(&self) {
        self.surface.configure(self.context.device(), &self.config);
    }

    /// Another scene: nothing on the GPU is of use any more.
    pub fn forget(&mut self) {
        self.mirror.replace_device(self.context.clone());
    }

    /// Another device on the same adapter, after this one was lost. The user interface's textures are gone too.
    pub fn replace_lost_device(&mut self) -> Result<(), GpuError> {
        self.context = Arc::new(self.context.reopen()?);
        self.configure();
        self.ui = UiPass::new(&self.context, self.config.format);
        self.forget();
        Ok(())
    }

    /// Asks for something to draw into; a surface that was lost or no longer fits is set up again.
    pub fn acquire(&mut self) -> Acquired {
        match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(frame) | wgpu::CurrentSurfaceTexture::Suboptimal(frame) => {
                Acquired::Frame(frame)
            }
            // one that never hands a picture back is set up again, too
            wgpu::CurrentSurfaceTexture::Outdated | wgpu::CurrentSurfaceTexture::Lost | wgpu::CurrentSurfaceTexture::Timeout => {
                self.configure();
                Acquired::Again
            }
            wgpu::CurrentSurfaceTexture::Occluded | wgpu::CurrentSurfaceTexture::Validation => Acquired::Hidden,
        }
    }
}

/// One frame on its way to the display.
pub struct WindowTarget<'a> {
    /// Where it goes.
    pub screen: &'a mut Screen,
    /// What it is drawn into; taken when it is presented.
    pub frame: Option<wgpu::SurfaceTexture>,
    /// The user interface over it; taken when it is drawn.
    pub ui: Option<UiFrame>,
    /// Where it is seen from.
    pub camera: CameraPose,
    /// Left edge of the picture beside the panel, pixels.
    pub left: f64,
    /// Instruments in hand.
    pub instruments: Vec<Instrument>,
    /// Lines that the tools draw.
    pub lines: Vec<LineSegment>,
    /// Bring the pixels back.
    pub wants_shot: bool,
    /// Those, if they were wanted.
    pub shot: Option<Shot>,
    /// The window is told just before it is shown.
    pub window: &'a Window,
    /// The passes are to be timed on the GPU.
    pub times_passes: bool,
    /// What they took a few frames ago.
    pub passes: Stages,
}

impl FrameTarget for WindowTarget<'_> {
    type Error = GpuError;

    fn present(&mut self, view: &FrameView, stages: &mut Stages, counters: &mut FrameCounters) -> Result<(), GpuError> {
        let screen = &mut *self.screen;
        let Some(frame) = self.frame.take() else { return Ok(()) };
        self.passes = screen.mirror.time_passes(self.times_passes);
        stages.time("upload", || screen.mirror.sync(view))?;
        if !self.times_passes {
            // else it goes with the picture, where it is timed like the other passes
            stages.time("deform", || screen.mirror.renderer_mut().deform())?;
        }
        stages.time("draw", || {
            let mut lines = screen.mirror.layer_lines(view);
            lines.append(&mut self.lines);
            let size = screen.size();
            let view_of =
                |format| frame.texture.create_view(&wgpu::TextureViewDescriptor { format: Some(format), ..Default::default() });
            let colour = ColourTarget::of_view(view_of(screen.scene_format), screen.scene_format, size);
            let (min, max) = view.scene.ground_bounds();
            let scenery = Scenery { ground: Some(Bounds { min, max }), ..Scenery::default() };
            let options = DrawOptions { scenery, lines: &lines, instruments: &self.instruments, ..Default::default() };
            let views = [view_beside(&self.camera, self.left, size)];
            let label = wgpu::CommandEncoderDescriptor { label: Some("window") };
            let mut encoder = screen.context.device().create_command_encoder(&label);
            let renderer = screen.mirror.renderer_mut();
            renderer.encode(&mut encoder, &ViewSet::new(&views), &RenderTarget::new(&colour), &options)?;
            let mut buffers = Vec::new();
            if let Some(ui) = self.ui.take() {
                let over = view_of(screen.config.format);
                buffers = screen.ui.encode(&screen.context, &mut encoder, &over, size, ui, false);
            }
            buffers.push(encoder.finish());
            screen.context.queue().submit(buffers);
            if self.wants_shot && screen.readable {
                let copy = PictureCopy::new(&screen.context, &frame.texture, 0)?;
                let (context, format) = (screen.context.clone(), screen.config.format);
                let pixels = move || copy.pixels(&context).map(|pixels| rgba(pixels, format)).map_err(|e| e.to_string());
                self.shot = Some((size.0, size.1, Box::new(pixels)));
            }
            self.window.pre_present_notify();
            screen.context.queue().present(frame);
            screen.context.check()
        })?;
        screen.mirror.count(counters);
        Ok(())
    }
}

/// RGBA8 with opaque alpha, whatever the surface's order is.
fn rgba(mut pixels: Vec<u8>, format: wgpu::TextureFormat) -> Vec<u8> {
    let swapped = matches!(format, wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Bgra8UnormSrgb);
    for pixel in pixels.chunks_exact_mut(4) {
        if swapped {
            pixel.swap(0, 2);
        }
        pixel[3] = 255;
    }
    pixels
}

/// A camera whose picture is the part of the window right of `left`; what lies behind the panel is drawn, too, so that the two
/// meet without a seam.
fn view_beside(camera: &CameraPose, left: f64, size: (u32, u32)) -> ViewPose {
    let back = (camera.eye - camera.target).normalize_or(DVec3::Z);
    let right = camera.up.cross(back).normalize_or(back.any_orthonormal_vector());
    let axes = DMat3::from_cols(right, back.cross(right), back);
    let (width, height) = (f64::from(size.0), f64::from(size.1.max(1)));
    let left = left.clamp(0.0, width - 1.0);
    let tan = (0.5 * camera.fov_y).tan();
    let fov = crate::gpu::Fov {
        left: -(tan * (width + left) / height).atan(),
        right: (tan * (width - left) / height).atan(),
        down: -0.5 * camera.fov_y,
        up: 0.5 * camera.fov_y,
    };
    let rotation = DQuat::from_mat3(&axes).normalize();
    ViewPose { position: camera.eye, rotation, fov, near: 1e-3 * camera.eye.distance(camera.target).max(1e-9) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_target_is_seen_in_the_middle_of_what_the_panel_leaves() {
        let camera = CameraPose { eye: DVec3::new(1.0, 2.0, 3.0), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.8 };
        for left in [0.0, 300.0] {
            let view = view_beside(&camera, left, (1200, 800));
            let clip = view.clip_from_world() * camera.target.extend(1.0);
            let x = (clip.x / clip.w + 1.0) * 600.0;
            assert!((x - (left + (1200.0 - left) / 2.0)).abs() < 1e-9, "{x}");
            assert!((clip.y / clip.w).abs() < 1e-12 && view.check().is_ok());
        }
    }
}
