//! Owns everything on the GPU and runs a frame's stages: sync each tissue, deform, draw.
//!
//! A host with a window or a headset calls, once a frame: [`Renderer::sync`] for each tissue, then [`Renderer::encode`] into an
//! encoder of its own (deform pass, shadow and all views), then, if it has later poses, [`Renderer::set_late_views`], and
//! submits. What is encoded must be submitted: the renderer takes it for done. One without either calls [`Renderer::draw`].

use super::arenas::{ArenaKind, Arenas, Slot};
use super::camera::{Bounds, Camera, Lit, Scenery, frame_record};
use super::context::Context;
use super::deform::{DeformPass, Variant};
use super::error::GpuError;
use super::instruments::{Instrument, InstrumentPass};
use super::lines::{LinePass, LineSegment};
use super::materials::Materials;
use super::pipelines::PipelineKey;
use super::readback;
use super::stage::{Stage, VisibilityMask};
use super::table::Table;
use super::targets::{PassKind, Passes, Picture, RenderTarget, TargetPool};
use super::timing::{GpuTimes, Timer};
use super::tissue_pass::TissuePass;
use super::tissue_store::{GpuTissue, MAX_TISSUES};
use super::types::{DISPLACED, FADING, ROTATED, SKINNED, TissueRecord, UNIFORM_TISSUES};
use super::view::{TissueDirty, TissueView};
use super::views::{ViewPose, ViewSet, check_views};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What was done since the counters were last taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GpuCounters {
    /// Compute dispatches.
    pub dispatches: u64,
    /// Workgroups of 64 vertices or wedges that were dispatched.
    pub workgroups: u64,
    /// Draw calls, those of the shadow pass included.
    pub draws: u64,
    /// Bytes sent to the GPU.
    pub bytes_uploaded: u64,
    /// Those of them that follow edits: records of vertices, faces and wedges, and their terms.
    pub structure_bytes: u64,
    /// Tissues that no view could see and that were not drawn.
    pub culled: u64,
    /// Face slots that no view could see and that were left out, those of such tissues among them.
    pub faces_culled: u64,
    /// Pipelines compiled: a hitch each, so none once a host is under way.
    pub pipelines: u64,
    /// Code that the deform passes ran; none of it if there was no pass.
    pub code: Variant,
    /// Pictures and buffers brought back, each a wait for the GPU: none in a steady frame.
    pub read_backs: u64,
}

/// GPU memory of the tissues' data, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// In use: [`super::arenas::bytes_per_model`], summed over all tissues.
    pub used: u64,
    /// Of the buffers that hold it, headroom and all.
    pub held: u64,
}

/// What a picture shows besides the tissues.
#[derive(Clone, Copy, Debug, Default)]
pub struct DrawOptions<'a> {
    /// Tray, shadow, up.
    pub scenery: Scenery,
    /// Inspection layers.
    pub lines: &'a [LineSegment],
    /// Scalpels, forceps, planes.
    pub instruments: &'a [Instrument],
    /// Leaves out the pixels of [`Renderer::set_visibility_masks`] in offscreen pictures.
    pub masked: bool,
    /// How several views are drawn.
    pub passes: Passes,
}

/// The GPU's side of a scene. Tissues are known by keys of the caller.
#[derive(Debug)]
pub struct Renderer {
    context: Arc<Context>,
    arenas: Arenas,
    materials: Materials,
    /// None where the CPU deforms.
    deform: Option<DeformPass>,
    stage: Stage,
    tissue_pass: TissuePass,
    lines: LinePass,
    instruments: InstrumentPass,
    targets: TargetPool,
    timer: Timer,
    picture: Option<Picture>,
    /// The lamp's frame that the shadow map was drawn in, as long as it holds what is there.
    shadow_of: Option<[[f32; 4]; 4]>,
    tissues: BTreeMap<u64, GpuTissue>,
    table: Table,
    free_slots: Vec<u32>,
    counters: GpuCounters,
    /// Bytes that the counters have seen.
    bytes_counted: u64,
    /// Bytes of structure that they have seen.
    structure_counted: u64,
    /// Pipelines of the context that they have seen.
    pipelines_counted: u64,
    /// Read-backs of the context that they have seen.
    read_backs_counted: u64,
}

impl Renderer {
    /// Compiles all pipelines.
    pub fn new(context: Arc<Context>) -> Self {
        let stage = Stage::new(&context);
        Self {
            arenas: Arenas::new(&context),
            materials: Materials::new(&context),
            deform: context.deforms().then(|| DeformPass::new(&context)),
            tissue_pass: TissuePass::new(&context, &stage),
            lines: LinePass::new(&context, &stage),
            instruments: InstrumentPass::new(&context, &stage),
            stage,
            targets: TargetPool::default(),
            timer: Timer::new(&context),
            picture: None,
            shadow_of: None,
            tissues: BTreeMap::new(),
            table: Table::new(&context, 16),
            free_slots: Vec::new(),
            counters: GpuCounters::default(),
            bytes_counted: 0,
            structure_counted: 0,
            pipelines_counted: 0,
            read_backs_counted: 0,
            context,
        }
    }

    /// The adapter and device.
    pub fn context(&self) -> &Arc<Context> {
        &self.context
    }

    /// What was done since the last call.
    pub fn take_counters(&mut self) -> GpuCounters {
        let made = self.context.pipelines_made();
        self.counters.pipelines = made - std::mem::replace(&mut self.pipelines_counted, made);
        let read = self.context.read_backs();
        self.counters.read_backs = read - std::mem::replace(&mut self.read_backs_counted, read);
        let structure = self.arenas.structure_bytes();
        self.counters.structure_bytes = structure - std::mem::replace(&mut self.structure_counted, structure);
        std::mem::take(&mut self.counters)
    }

    /// Compiles whatever drawing this many views into a target may ever need, so that no later frame has to. Errors: the target.
    pub fn compile_for(&mut self, target: &RenderTarget<'_>, views: usize, passes: Passes) -> Result<(), GpuError> {
        target.check(views)?;
        let (key, _) = self.targets.prepare(&self.context, target, views, passes);
        self.stage.prepare(&self.context, key);
        self.tissue_pass.prepare_target(&self.context, key);
        self.lines.compile(&self.context, key);
        self.instruments.compile(&self.context, key);
        self.targets.compile_depth(&self.context, target, key);
        self.context.check()
    }

    /// Brings the GPU's copy of a tissue up to date; a new key starts one (whatever `dirty` says). With nothing dirty and
    /// equal versions nothing is uploaded. Errors: an inconsistent view (the copy stays as it was), or a model over the
    /// adapter's limits (the copy is removed).
    pub fn sync(&mut self, key: u64, view: &TissueView<'_>, dirty: &TissueDirty) -> Result<(), GpuError> {
        view.check()?;
        if !self.tissues.contains_key(&key) {
            let slot = self.new_slot()?;
            self.tissues.insert(key, GpuTissue::new(slot));
        }
        let result = self.sync_known(key, view, dirty);
        if result.is_err() {
            self.remove(key);
        }
        result
    }

    fn sync_known(&mut self, key: u64, view: &TissueView<'_>, dirty: &TissueDirty) -> Result<(), GpuError> {
        let Some(tissue) = self.tissues.get_mut(&key) else { return Err(GpuError::UnknownTissue(key)) };
        if tissue.wants_materials(view.versions) || matches!(dirty, TissueDirty::Full) {
            let bytes = self.materials.set(&self.context, tissue.record.slot as usize, view.materials)?;
            self.arenas.belt().count(bytes);
        }
        tissue.sync(&self.context, &mut self.arenas, view, dirty)
    }

    /// Forgets a tissue; unknown keys are ignored.
    pub fn remove(&mut self, key: u64) {
        if let Some(mut tissue) = self.tissues.remove(&key) {
            tissue.release(&mut self.arenas);
            let slot = tissue.record.slot;
            self.materials.clear(slot as usize);
            self.table.set(slot, TissueRecord { slot, ..Default::default() });
            self.free_slots.push(slot);
            self.shadow_of = None;
        }
    }

    /// Keys of all tissues.
    pub fn keys(&self) -> impl Iterator<Item = u64> + '_ {
        self.tissues.keys().copied()
    }

    /// What the arenas hold.
    pub fn memory(&self) -> Memory {
        let used = self.tissues.values().map(|t| t.bytes(&self.arenas)).sum();
        Memory { used, held: self.arenas.bytes_held() }
    }

    /// Bounds of all tissues in their pose, world space.
    pub fn bounds(&self) -> Bounds {
        self.tissues.values().fold(Bounds::EMPTY, |all, t| all.union(t.posed_bounds()))
    }

    /// Uploads records and computes final positions and normals of every tissue that needs it; none, and nothing is
    /// dispatched or submitted. Errors: the device failed, now or earlier.
    pub fn deform(&mut self) -> Result<(), GpuError> {
        let mut encoder = self.encoder("deform");
        let before = self.bytes_counted;
        if self.encode_deform(&mut encoder) || self.bytes_counted != before {
            self.context.queue().submit([encoder.finish()]);
        }
        self.context.check()
    }

    /// [`Renderer::deform`] into an encoder of the caller's. False if there was nothing to do.
    pub fn encode_deform(&mut self, encoder: &mut wgpu::CommandEncoder) -> bool {
        self.run_deform(encoder, false)
    }

    fn run_deform(&mut self, encoder: &mut wgpu::CommandEncoder, timed: bool) -> bool {
        self.upload_table();
        let Some(deform) = &mut self.deform else {
            let before = self.bytes_counted;
            self.flush(encoder);
            if self.bytes_counted != before {
                self.shadow_of = None;
            }
            return false;
        };
        deform.begin();
        let mut variant = Variant::default();
        for tissue in self.tissues.values_mut().filter(|t| t.needs_deform()) {
            let record = tissue.record;
            tissue.work(|stage, first| deform.add(stage, record.slot, first));
            variant.skinned |= record.flags & SKINNED != 0;
            variant.displaced |= record.flags & (DISPLACED | FADING) != 0;
            variant.rotated |= record.flags & ROTATED != 0;
            variant.long_rows |= tissue.has_long_rows();
        }
        let table = self.table.buffer();
        let times = if timed && !deform.is_idle() { self.timer.compute("deform") } else { None };
        self.counters.workgroups += deform.groups();
        let dispatches = deform.encode(&self.context, encoder, &mut self.arenas, table, variant, times);
        self.counters.dispatches += dispatches;
        self.flush(encoder);
        if dispatches > 0 {
            self.shadow_of = None;
            self.counters.code = self.counters.code.with(variant);
        }
        dispatches > 0
    }

    /// Deforms what needs it and draws one view into an offscreen picture. Errors: camera, size, or the device failed.
    pub fn draw(&mut self, camera: &Camera, size: (u32, u32), options: &DrawOptions<'_>) -> Result<(), GpuError> {
        Picture::check_size(&self.context, size)?;
        let aspect = f64::from(size.0) / f64::from(size.1);
        self.draw_views(&[ViewPose::from_camera(camera, aspect)?], size, options)
    }

    /// Deforms what needs it and draws views of equal size into the layers of an offscreen picture. Errors: views, size, or the
    /// device failed.
    pub fn draw_views(&mut self, views: &[ViewPose], size: (u32, u32), options: &DrawOptions<'_>) -> Result<(), GpuError> {
        check_views(views)?;
        let fits = |p: &Picture| p.target().size() == size && p.target().layers() == views.len();
        let picture = match self.picture.take().filter(fits) {
            Some(picture) => picture,
            None => Picture::new(&self.context, size, views.len() as u32)?,
        };
        let mut encoder = self.encoder("frame");
        let masked = ViewSet { views, masked: options.masked };
        let drawn = self.encode(&mut encoder, &masked, &RenderTarget::new(picture.target()), options);
        self.picture = Some(picture);
        drawn?;
        self.context.queue().submit([encoder.finish()]);
        self.context.check()
    }

    /// Deforms what needs it and draws all views into a target, in the caller's encoder: in one pass where adapter and target
    /// allow it, else in a pass each. At most 8 calls a submission. Errors: views, target; nothing is encoded then.
    pub fn encode(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        views: &ViewSet<'_>,
        target: &RenderTarget<'_>,
        options: &DrawOptions<'_>,
    ) -> Result<(), GpuError> {
        check_views(views.views)?;
        target.check(views.views.len())?;
        let all = || self.tissues.values().fold(Bounds::EMPTY, |all, t| all.union(t.rest_bounds()));
        let rest = options.scenery.ground.unwrap_or_else(all);
        let instruments = options.instruments.iter().any(Instrument::is_solid);
        let lit = Lit { rest, posed: self.bounds(), instruments };
        let frame = frame_record(views.views, target.viewport_size(), &options.scenery, &lit)?;
        self.timer.begin();
        self.run_deform(encoder, true);
        self.counters.bytes_uploaded += self.stage.set_frame(&self.context, &frame);
        self.lines.prepare(&self.context, self.arenas.belt(), options.lines);
        if self.instruments.prepare(&self.context, self.arenas.belt(), options.instruments) {
            self.shadow_of = None;
        }
        self.flush(encoder);
        self.prepare_tissues(views.views);
        let (key, place) = self.targets.prepare(&self.context, target, views.views.len(), options.passes);
        self.stage.prepare(&self.context, key);
        self.tissue_pass.prepare_target(&self.context, key);
        self.lines.prepare_target(&self.context, key);
        self.instruments.prepare_target(&self.context, key);
        if options.scenery.shadow && self.shadow_of != Some(frame.light_from_world) {
            let mut pass = self.stage.begin_shadow(encoder, self.timer.render("shadow"));
            self.counters.draws += self.tissue_pass.draw_shadow(&mut pass) + self.instruments.draw_shadow(&mut pass);
            self.shadow_of = Some(frame.light_from_world);
        }
        for view in 0..if key.views > 1 { 1 } else { views.views.len() } {
            let kind = if key.views > 1 { PassKind::Multiview } else { PassKind::Layer(view) };
            let mut pass = self.targets.begin(encoder, target, place, kind, self.timer.render("views"));
            let tray = options.scenery.tray && !self.tissues.is_empty();
            let draws = self.draw_view(&mut pass, key, view as u32, views.masked, tray);
            self.counters.draws += draws;
            drop(pass);
            self.targets.keep_depth(&self.context, encoder, target, place, kind);
        }
        self.timer.end(encoder);
        Ok(())
    }

    /// What one pass draws, nearest to the eye first as far as is known.
    fn draw_view(&self, pass: &mut wgpu::RenderPass<'_>, key: PipelineKey, view: u32, masked: bool, tray: bool) -> u64 {
        self.stage.bind(pass);
        let mut draws = if masked { self.stage.draw_mask(pass, key, view) } else { 0 };
        draws += self.instruments.draw(pass, key, view, true);
        draws += self.tissue_pass.draw(pass, key, view);
        draws += self.stage.draw_backdrop(pass, key, view);
        if tray {
            draws += self.stage.draw_tray(pass, key, view);
        }
        draws += self.lines.draw(pass, key, view);
        draws + self.instruments.draw(pass, key, view, false)
    }

    fn prepare_tissues(&mut self, views: &[ViewPose]) {
        self.tissue_pass.begin();
        for tissue in self.tissues.values_mut() {
            let (first, count) = tissue.faces();
            self.tissue_pass.add(first..first + count);
            let unseen = tissue.visible_faces(views, |slots| self.tissue_pass.add_seen(slots));
            self.counters.culled += u64::from(unseen == count);
            self.counters.faces_culled += u64::from(unseen);
        }
        self.tissue_pass.prepare(&self.context, &self.arenas, self.table.buffer(), &self.materials);
    }

    /// Times every pass of [`Renderer::encode`] on the GPU from now on, or no longer. False where the adapter cannot.
    pub fn set_timing(&mut self, on: bool) -> bool {
        self.timer.set(&self.context, on)
    }

    /// What the passes of the latest frame took whose times have come back, a few frames ago; none while timing is off.
    pub fn gpu_times(&mut self) -> Option<GpuTimes> {
        self.timer.latest()
    }

    /// Gives the views of the last [`Renderer::encode`] later poses, until it is submitted: what was culled stays culled (by a
    /// wider frustum than the views'). Errors: a view that looks nowhere, or other than as many views.
    pub fn set_late_views(&mut self, views: &[ViewPose]) -> Result<(), GpuError> {
        check_views(views)?;
        self.counters.bytes_uploaded += self.stage.set_late_views(&self.context, views);
        Ok(())
    }

    /// Pixels that a headset's lenses hide, a mask a view; none for no masks. Used by view sets that are `masked`.
    pub fn set_visibility_masks(&mut self, masks: &[VisibilityMask]) {
        self.stage.set_masks(&self.context, masks);
    }

    /// Draws one view and brings it back: RGBA8, sRGB, rows from the top. Waits for the GPU.
    pub fn render_to_image(&mut self, camera: &Camera, size: (u32, u32), options: &DrawOptions<'_>) -> Result<Vec<u8>, GpuError> {
        self.draw(camera, size, options)?;
        self.read_picture(0)
    }

    /// A view of the last [`Renderer::draw_views`]: RGBA8, sRGB, rows from the top. Waits for the GPU.
    pub fn read_picture(&self, view: u32) -> Result<Vec<u8>, GpuError> {
        match &self.picture {
            Some(picture) => readback::read_texture(&self.context, picture.texture(), view),
            None => Ok(Vec::new()),
        }
    }

    /// Final positions of a tissue's vertices as last deformed, tissue space. For error checks: waits for the GPU.
    pub fn read_positions(&self, key: u64) -> Result<Vec<[f32; 3]>, GpuError> {
        Ok(self.read_deformed(key, GpuTissue::positions)?.iter().map(|&[x, y, z, _]| [x, y, z]).collect())
    }

    /// Final normals of a tissue's wedges as last deformed, tissue space, and how far the lip of a wound is, in diagonals. For error
    /// checks: waits for the GPU.
    pub fn read_normals(&self, key: u64) -> Result<Vec<[f32; 4]>, GpuError> {
        self.read_deformed(key, GpuTissue::normals)
    }

    fn read_deformed(&self, key: u64, pick: impl Fn(&GpuTissue) -> Slot) -> Result<Vec<[f32; 4]>, GpuError> {
        let slot = pick(self.tissues.get(&key).ok_or(GpuError::UnknownTissue(key))?);
        let buffer = self.arenas.buffer(ArenaKind::Deformed);
        let bytes = readback::read_buffer(&self.context, buffer, u64::from(slot.start) * 16, u64::from(slot.len) * 16)?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }

    fn new_slot(&mut self) -> Result<u32, GpuError> {
        if let Some(slot) = self.free_slots.pop() {
            return Ok(slot);
        }
        let slot = self.tissues.len();
        let most = if self.context.deforms() { MAX_TISSUES } else { UNIFORM_TISSUES };
        if slot >= most {
            return Err(GpuError::TooManyTissues { most });
        }
        Ok(slot as u32)
    }

    /// Writes the records that changed.
    fn upload_table(&mut self) {
        for tissue in self.tissues.values_mut() {
            let (first, count) = self.materials.range(tissue.record.slot as usize);
            (tissue.record.materials, tissue.record.material_count) = (first, count);
            self.table.set(tissue.record.slot, tissue.record);
        }
        if self.table.upload(&self.context, self.arenas.belt()) {
            self.shadow_of = None;
        }
    }

    /// Encodes the uploads noted since the last time.
    fn flush(&mut self, encoder: &mut wgpu::CommandEncoder) {
        self.arenas.belt().flush(&self.context, encoder);
        let all = self.arenas.bytes_uploaded();
        self.counters.bytes_uploaded += all - std::mem::replace(&mut self.bytes_counted, all);
    }

    fn encoder(&self, label: &str) -> wgpu::CommandEncoder {
        self.context.device().create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) })
    }
}
