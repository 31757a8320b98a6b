//! Frames into pictures, without a window: for CI, for scripts, for machines without a display.

use super::layers::layer_lines;
use crate::app::{App, FrameCounters, FrameReport, FrameTarget, FrameView};
use crate::diagnostics::Stages;
use crate::formats::Material;
use crate::gpu::{
    Camera, Context, ContextOptions, DrawOptions, GpuError, MaterialView, Renderer, Scenery, TextureView, TissueDirty,
    TissueView, ViewVersions,
};
use crate::input::InputFrame;
use crate::particles::ParticleMap;
use crate::scene::TissueId;
use crate::tissue::Tissue;
use glam::DAffine3;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Draws frames into memory.
pub struct HeadlessTarget {
    renderer: Renderer,
    size: (u32, u32),
    camera: Camera,
    scenery: Scenery,
    known: BTreeSet<TissueId>,
    pixels: Vec<u8>,
}

impl HeadlessTarget {
    /// Opens an adapter: a real GPU if there is one, else a software one.
    pub fn new(size: (u32, u32), camera: Camera) -> Result<Self, GpuError> {
        let context = Arc::new(Context::headless(ContextOptions::default())?);
        Ok(Self {
            renderer: Renderer::new(context),
            size,
            camera,
            scenery: Scenery::default(),
            known: BTreeSet::new(),
            pixels: Vec::new(),
        })
    }

    /// Name of the adapter.
    pub fn adapter_name(&self) -> &str {
        self.renderer.context().adapter_name()
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

    /// Largest distance between the GPU's positions and the f64 reference over all live vertices, as a fraction of the
    /// diagonal. Reads back; for tests and reports.
    pub fn gpu_error(&self, app: &App) -> Result<f64, GpuError> {
        let mut worst = 0.0f64;
        for (id, tissue) in app.scene.tissues() {
            let gpu = self.renderer.read_positions(u64::from(id.0))?;
            for v in tissue.mesh().live_vertices() {
                let p = glam::Vec3::from_array(gpu[v.index()]).as_dvec3();
                worst = worst.max(p.distance(tissue.position(v)) / tissue.diagonal());
            }
        }
        Ok(worst)
    }

    fn sync(&mut self, view: &FrameView) -> Result<(), GpuError> {
        let mut dirty: BTreeMap<TissueId, TissueDirty> = BTreeMap::new();
        for (id, delta) in view.changes {
            let ranges = TissueDirty::from_deltas(&delta.mesh, &delta.rows, &delta.map);
            match dirty.get_mut(id) {
                Some(all) => all.merge(ranges),
                None => drop(dirty.insert(*id, ranges)),
            }
        }
        let now: BTreeSet<TissueId> = view.scene.tissues().map(|(id, _)| id).collect();
        for gone in self.known.difference(&now) {
            self.renderer.remove(u64::from(gone.0));
        }
        for (id, tissue) in view.scene.tissues() {
            let ranges =
                if self.known.contains(&id) { dirty.remove(&id).unwrap_or_else(TissueDirty::clean) } else { TissueDirty::Full };
            let materials = material_views(tissue.materials());
            self.renderer.sync(u64::from(id.0), &tissue_view(tissue, &materials), &ranges)?;
        }
        self.known = now;
        Ok(())
    }
}

impl FrameTarget for HeadlessTarget {
    type Error = GpuError;

    fn present(&mut self, view: &FrameView, stages: &mut Stages, counters: &mut FrameCounters) -> Result<(), GpuError> {
        stages.time("upload", || self.sync(view))?;
        stages.time("deform", || {
            self.renderer.deform()?;
            self.renderer.context().wait()
        })?;
        stages.time("draw", || {
            let lines = layer_lines(view);
            let options = DrawOptions { scenery: self.scenery, lines: &lines };
            self.pixels = self.renderer.render_to_image(&self.camera, self.size, &options)?;
            Ok::<(), GpuError>(())
        })?;
        let gpu = self.renderer.take_counters();
        (counters.dispatches, counters.draws, counters.bytes_uploaded) = (gpu.dispatches, gpu.draws, gpu.bytes_uploaded);
        Ok(())
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
        let report = app.frame(&input, target)?;
        done(frame, &report, target)?;
        reports.push(report);
    }
    Ok(reports)
}

static NO_PARTICLES: std::sync::LazyLock<ParticleMap> = std::sync::LazyLock::new(ParticleMap::default);

fn tissue_view<'a>(tissue: &'a Tissue, materials: &'a [MaterialView<'a>]) -> TissueView<'a> {
    let versions = tissue.versions();
    TissueView {
        mesh: tissue.mesh(),
        rows: tissue.rows(),
        map: tissue.layer().map_or(&NO_PARTICLES, |l| &l.map),
        displacements: tissue.layer().map_or(&[], |l| l.displacements()),
        fades: &tissue.fades().entries,
        fade_duration_s: tissue.fades().duration_s,
        time_s: tissue.time_s(),
        pose: tissue.pose(),
        materials,
        diagonal: tissue.diagonal(),
        world_from_tissue: DAffine3::from_translation(tissue.offset()),
        versions: ViewVersions {
            pose: versions.pose,
            displacements: versions.displacements,
            fades: versions.fades,
            materials: 0,
        },
    }
}

fn material_views(materials: &[Material]) -> Vec<MaterialView<'_>> {
    materials
        .iter()
        .map(|m| MaterialView {
            base_colour: m.base_colour,
            texture: m.texture.as_ref().map(|t| TextureView { width: t.width, height: t.height, rgba: &t.rgba }),
            // a picture on the surface is skin or fur: drier and less translucent than bare flesh
            wetness: if m.texture.is_some() { 0.25 } else { MaterialView::FLESH.wetness },
            scatter: if m.texture.is_some() { 0.4 } else { MaterialView::FLESH.scatter },
            ..MaterialView::FLESH
        })
        .collect()
}

/// Positions of a tissue's live vertices in model space: what a picture shows.
pub fn visible_bounds(app: &App) -> (glam::DVec3, glam::DVec3) {
    let tissues = app.scene.tissues().map(|(_, t)| {
        let (low, high) = t.bounds();
        (low + t.offset(), high + t.offset())
    });
    tissues.fold((glam::DVec3::INFINITY, glam::DVec3::NEG_INFINITY), |(l, h), (low, high)| (l.min(low), h.max(high)))
}
