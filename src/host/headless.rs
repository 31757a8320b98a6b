//! Frames into pictures, without a window: for CI, for scripts, for machines without a display.

use super::mirror::Mirror;
use crate::app::{App, FrameCounters, FrameReport, FrameTarget, FrameView};
use crate::diagnostics::Stages;
use crate::gpu::{Bounds, Camera, Context, ContextOptions, DrawOptions, GpuError, Instrument, Scenery};
use crate::input::InputFrame;
use crate::scene::{EditCommand, Scene};
use crate::surgery::BladePose;
use glam::DVec3;
use std::sync::Arc;

/// Draws frames into memory.
pub struct HeadlessTarget {
    mirror: Mirror,
    size: (u32, u32),
    camera: Camera,
    scenery: Scenery,
    pixels: Vec<u8>,
    blade: Blade,
}

impl HeadlessTarget {
    /// Opens an adapter: a real GPU if there is one, else a software one.
    pub fn new(size: (u32, u32), camera: Camera) -> Result<Self, GpuError> {
        let context = Arc::new(Context::headless(ContextOptions::default())?);
        Ok(Self {
            mirror: Mirror::new(context),
            size,
            camera,
            scenery: Scenery::default(),
            pixels: Vec::new(),
            blade: Blade::default(),
        })
    }

    /// Name of the adapter.
    pub fn adapter_name(&self) -> &str {
        self.mirror.renderer().context().adapter_name()
    }

    /// The camera of the next frame.
    pub fn camera_mut(&mut self) -> &mut Camera {
        &mut self.camera
    }

    /// RGBA8 sRGB pixels of the last frame, rows from the top.
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// Width and height, pixels.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// See [`Mirror::gpu_error`].
    pub fn gpu_error(&self, app: &App) -> Result<f64, GpuError> {
        self.mirror.gpu_error(&app.scene)
    }
}

impl FrameTarget for HeadlessTarget {
    type Error = GpuError;

    fn present(&mut self, view: &FrameView, stages: &mut Stages, counters: &mut FrameCounters) -> Result<(), GpuError> {
        match self.draw(view, stages, counters) {
            Err(GpuError::Lost(why)) => {
                tracing::warn!("the GPU was lost ({why}); starting another device");
                self.mirror.replace_lost_device()?;
                self.draw(view, stages, counters)
            }
            result => result,
        }
    }
}

impl HeadlessTarget {
    fn draw(&mut self, view: &FrameView, stages: &mut Stages, counters: &mut FrameCounters) -> Result<(), GpuError> {
        stages.time("upload", || self.mirror.sync(view))?;
        stages.time("deform", || {
            self.mirror.renderer_mut().deform()?;
            self.mirror.renderer().context().wait()
        })?;
        stages.time("draw", || {
            let lines = self.mirror.layer_lines(view);
            let (min, max) = view.scene.ground_bounds();
            self.scenery.ground = Some(Bounds { min, max });
            let scalpel = self.blade.scalpel(view.scene);
            let instruments = scalpel.as_slice();
            let options = DrawOptions { scenery: self.scenery, lines: &lines, instruments, ..Default::default() };
            self.pixels = self.mirror.renderer_mut().render_to_image(&self.camera, self.size, &options)?;
            Ok::<(), GpuError>(())
        })?;
        self.mirror.count(counters);
        Ok(())
    }

    /// The picture of the scene, for checks.
    pub fn mirror(&self) -> &Mirror {
        &self.mirror
    }
}

/// The scalpel of a script: in the picture while a stroke lasts.
#[derive(Clone, Copy, Debug, Default)]
struct Blade {
    pose: Option<BladePose>,
    travel: DVec3,
}

impl Blade {
    fn follow(&mut self, commands: &[EditCommand]) {
        for command in commands {
            match command {
                EditCommand::StrokeBegin { .. } | EditCommand::StrokeEnd => *self = Self::default(),
                EditCommand::StrokePose(pose) => {
                    let step = self.pose.map_or(DVec3::ZERO, |last| pose.tip - last.tip);
                    self.travel = if step.length_squared() > 0.0 { step } else { self.travel };
                    self.pose = Some(*pose);
                }
                _ => {}
            }
        }
    }

    /// Of its true size beside a model of two centimetres to half a metre, else in proportion.
    fn scalpel(&self, scene: &Scene) -> Option<Instrument> {
        let pose = self.pose?;
        let diagonal = scene.tissues().map(|(_, t)| t.diagonal()).fold(0.0, f64::max);
        let scale = (diagonal / 0.5).max((diagonal / 0.02).clamp(1e-9, 1.0)).min(1e6);
        Some(Instrument::scalpel(pose.tip, pose.base, self.travel, scale))
    }
}

/// Runs `frames` frames of fixed `step_s`; `input` makes the frame's input, `done` takes its report and pixels.
pub fn run<E: From<GpuError>>(
    app: &mut App,
    target: &mut HeadlessTarget,
    frames: usize,
    mut input: impl FnMut(usize) -> InputFrame,
    mut done: impl FnMut(usize, &FrameReport, &HeadlessTarget) -> Result<(), E>,
) -> Result<Vec<FrameReport>, E> {
    let mut reports = Vec::with_capacity(frames);
    for frame in 0..frames {
        let input = input(frame);
        if let Some(camera) = input.camera {
            *target.camera_mut() = Camera { eye: camera.eye, target: camera.target, up: camera.up, fov_y: camera.fov_y };
        }
        target.blade.follow(&input.commands);
        let report = app.frame(&input, target)?;
        done(frame, &report, target)?;
        reports.push(report);
    }
    Ok(reports)
}
