//! The GPU's picture of a scene, kept up to date frame by frame: what every host does between a frame and its drawing.

use super::instruments::Instruments;
use super::layers;
use crate::app::{FrameCounters, FrameView};
use crate::diagnostics::Stages;
use crate::formats::Material;
use crate::gpu::{Context, GpuError, LineSegment, MaterialView, Renderer, TextureView, TissueDirty, TissueView, ViewVersions};
use crate::input::Layer;
use crate::particles::ParticleMap;
use crate::scene::{Scene, TissueId};
use crate::tissue::Tissue;
use std::sync::Arc;

/// A renderer, and what it knows of the scene.
pub struct Mirror {
    renderer: Renderer,
    /// Tissues on the GPU and how many materials of each, by id.
    known: Vec<(TissueId, usize)>,
    /// What has changed in a tissue.
    dirty: TissueDirty,
    instruments: Instruments,
}

impl Mirror {
    /// An empty picture.
    pub fn new(context: Arc<Context>) -> Self {
        let renderer = Renderer::new(context);
        Self { renderer, known: Vec::new(), dirty: TissueDirty::clean(), instruments: Instruments::default() }
    }

    /// What draws.
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// What draws.
    pub fn renderer_mut(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// Forgets everything of the scene, for another one; what was compiled stays.
    pub fn forget(&mut self) {
        for (id, _) in self.known.drain(..) {
            self.renderer.remove(u64::from(id.0));
        }
        self.instruments.forget(&mut self.renderer);
    }

    /// Begins anew on another device: the next [`Mirror::sync`] brings everything over from the scene, which has all that there
    /// is to know.
    pub fn replace_device(&mut self, context: Arc<Context>) {
        *self = Self::new(context);
    }

    /// [`Mirror::replace_device`] with a new device on the same adapter, after the old one was lost. A window or a headset has
    /// to hand its own over. Errors: the adapter gives none.
    pub fn replace_lost_device(&mut self) -> Result<(), GpuError> {
        let context = self.renderer.context().reopen()?;
        self.replace_device(Arc::new(context));
        Ok(())
    }

    /// Brings the GPU's copy of the scene up to date, by what the frame says has changed. Errors: the device, or a model over
    /// the adapter's limits.
    pub fn sync(&mut self, view: &FrameView) -> Result<(), GpuError> {
        let Self { renderer, known, dirty, instruments } = self;
        renderer.context().check()?;
        known.retain(|&(id, _)| {
            let stays = view.scene.tissue(id).is_some();
            if !stays {
                renderer.remove(u64::from(id.0));
            }
            stays
        });
        for (id, tissue) in view.scene.tissues() {
            let count = tissue.materials().len();
            let place = known.binary_search_by_key(&id, |k| k.0);
            let old = place.ok().map(|at| known[at].1);
            match old {
                Some(_) => {
                    let edits = view.changes.iter().filter(|(tissue, _)| *tissue == id);
                    dirty.gather(edits.map(|(_, delta)| (&delta.mesh, &delta.rows, &delta.map)));
                }
                None => *dirty = TissueDirty::Full,
            }
            // Pictures are looked at only when they are new.
            let materials = if old == Some(count) { Vec::new() } else { material_views(tissue.materials()) };
            renderer.sync(u64::from(id.0), &tissue_view(tissue, &materials), dirty)?;
            match place {
                Ok(at) => known[at].1 = count,
                Err(at) => known.insert(at, (id, count)),
            }
        }
        instruments.sync(renderer, view)
    }

    /// Lines of the inspection layers that are on; none, and nothing is built, without one. The layer of errors reads positions
    /// back, so it waits for the GPU.
    pub fn layer_lines(&mut self, view: &FrameView) -> Vec<LineSegment> {
        let mut lines = layers::layer_lines(view);
        if view.layers.contains(&Layer::Errors) && self.renderer.deform().is_ok() {
            for (id, tissue) in view.scene.tissues() {
                if let Ok(positions) = self.renderer.read_positions(u64::from(id.0)) {
                    layers::error_points(tissue, &positions, &mut lines);
                }
            }
        }
        lines
    }

    /// Hands the renderer's counters over to a frame's.
    pub fn count(&mut self, counters: &mut FrameCounters) {
        let gpu = self.renderer.take_counters();
        (counters.dispatches, counters.draws) = (gpu.dispatches, gpu.draws);
        (counters.bytes_uploaded, counters.pipelines) = (gpu.bytes_uploaded, gpu.pipelines);
    }

    /// Times the passes on the GPU from now on, or no longer. What those of a frame took, a few frames ago; empty where nobody asked
    /// or the adapter cannot tell.
    pub fn time_passes(&mut self, on: bool) -> Stages {
        if self.renderer.set_timing(on) { self.gpu_stages() } else { Stages::default() }
    }

    /// What the passes took of the latest frame whose times have come back; empty while they are not timed.
    pub fn gpu_stages(&mut self) -> Stages {
        let mut stages = Stages::default();
        if let Some(times) = self.renderer.gpu_times() {
            times.passes().iter().for_each(|&(name, ms)| stages.add(name, ms));
        }
        stages
    }

    /// Largest distance between the GPU's positions and the f64 reference over all live vertices, as a fraction of the
    /// diagonal. Reads back; for tests and reports.
    pub fn gpu_error(&self, scene: &Scene) -> Result<f64, GpuError> {
        let mut worst = 0.0f64;
        for (id, tissue) in scene.tissues() {
            let gpu = self.renderer.read_positions(u64::from(id.0))?;
            for v in tissue.mesh().live_vertices() {
                let p = glam::Vec3::from_array(gpu[v.index()]).as_dvec3();
                worst = worst.max(p.distance(tissue.position(v)) / tissue.diagonal());
            }
        }
        Ok(worst)
    }
}

static NO_PARTICLES: std::sync::LazyLock<ParticleMap> = std::sync::LazyLock::new(ParticleMap::default);

fn tissue_view<'a>(tissue: &'a Tissue, materials: &'a [MaterialView<'a>]) -> TissueView<'a> {
    let versions = tissue.versions();
    TissueView {
        mesh: tissue.mesh(),
        rows: tissue.rows(),
        map: tissue.layer().map_or(&NO_PARTICLES, |l| &l.map),
        displacements: tissue.layer().map_or(&[], |l| l.displacements()),
        rotations: tissue.layer().map_or(&[], |l| l.network.turns()),
        fades: tissue.fades().entries(),
        fades_written: tissue.fades().written(),
        fade_duration_s: tissue.fades().duration_s,
        time_s: tissue.time_s(),
        pose: tissue.pose(),
        materials,
        diagonal: tissue.diagonal(),
        world_from_tissue: tissue.frame().affine(),
        versions: ViewVersions {
            pose: versions.pose,
            displacements: versions.displacements + versions.starts,
            fades: versions.fades,
            rotations: versions.rotations,
            materials: tissue.materials().len() as u64,
        },
    }
}

fn material_views(materials: &[Material]) -> Vec<MaterialView<'_>> {
    materials.iter().map(material_view).collect()
}

/// How a material of a model answers light. Edits name theirs: "wound" lines a slit, "cap" closes a cut.
fn material_view(material: &Material) -> MaterialView<'_> {
    let texture = material.texture.as_ref().map(|t| TextureView { width: t.width, height: t.height, rgba: &t.rgba });
    let view = MaterialView { base_colour: material.base_colour, texture, ..MaterialView::FLESH };
    match material.name.as_str() {
        "wound" => MaterialView { roughness: 0.6, wetness: 0.45, ..view },
        "cap" => MaterialView { roughness: 0.55, wetness: 0.4, ..view },
        // A picture on the surface is skin or fur: drier and less translucent than bare flesh.
        _ if texture.is_some() => MaterialView { wetness: 0.25, scatter: 0.4, ..view },
        _ => view,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::App;
    use crate::config::Config;
    use crate::geometry::Plane;
    use crate::gpu::ContextOptions;
    use crate::gpu::context::device_descriptor;
    use crate::physics::NetworkSettings;
    use crate::scene::{EditCommand, SceneSettings};
    use crate::tissue::TissueSettings;
    use glam::DVec3;

    #[test]
    fn what_has_no_colour_is_flesh_to_the_reader_and_to_the_renderer() {
        assert_eq!(Material::FLESH, MaterialView::FLESH.base_colour);
    }

    /// A device whose buffers are small: a few pieces are too many.
    fn narrow() -> Arc<Context> {
        let wide = Context::headless(ContextOptions::default()).expect("an adapter");
        let mut descriptor = device_descriptor(wide.adapter()).expect("limits");
        let bytes = 1 << 19;
        (descriptor.required_limits.max_storage_buffer_binding_size, descriptor.required_limits.max_buffer_size) = (bytes, bytes);
        let (device, queue) = pollster::block_on(wide.adapter().request_device(&descriptor)).expect("a device");
        Arc::new(Context::from_parts(wide.instance().clone(), wide.adapter().clone(), device, queue))
    }

    #[test]
    fn a_scene_that_outgrew_the_device_is_shown_again_once_the_edit_is_undone() {
        let model = crate::formats::load("sphere").expect("bundled");
        let settings =
            TissueSettings { particles: None, network: NetworkSettings::SOFT, opening_s: 0.5, section_faces: 128, fade_s: 0.25 };
        let tissue = Tissue::new(model, &settings).expect("a tissue");
        let radius = 0.5 * tissue.diagonal() / 3f64.sqrt();
        let tools = SceneSettings { sampling: Config::default().sampling, sample_distance: None, sample_time: None };
        let mut app = App::new(Scene::new(tissue, tools), 1.0, || 0);
        let mut mirror = Mirror::new(narrow());
        mirror.sync(&app.view()).expect("one sphere fits");
        let refused = (1..60).find_map(|i| {
            let angle = f64::from(i) * 2.4;
            let normal = DVec3::new(angle.cos(), angle.sin(), (0.7 * angle).sin());
            let offset = radius * normal.length() * 0.1 * f64::from(i % 7 - 3);
            app.scene.edit(EditCommand::CutClosed(Plane::Equation { normal, offset }));
            let changes = app.scene.take_changes();
            mirror.sync(&FrameView { changes: &changes, ..app.view() }).err()
        });
        assert!(refused.as_ref().is_some_and(GpuError::is_outgrown), "{refused:?}");
        assert!(app.scene.take_back() && app.scene.undo_depth() > 0);
        app.scene.take_changes();
        mirror.forget();
        mirror.sync(&app.view()).expect("it fitted before");
        mirror.renderer_mut().deform().expect("drawn on");
        assert!(mirror.gpu_error(&app.scene).expect("read back") < 1e-6);
    }
}
