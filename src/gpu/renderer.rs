//! Owns everything on the GPU and runs a frame's stages: sync each tissue, deform, draw.

use super::arenas::{ArenaKind, Arenas, Slot};
use super::camera::{Bounds, Camera, Scenery, view_record};
use super::context::Context;
use super::deform::{DeformPass, Variant};
use super::error::GpuError;
use super::lines::{LinePass, LineSegment};
use super::materials::Materials;
use super::readback;
use super::stage::Stage;
use super::targets::{Attachments, Targets};
use super::tissue_pass::TissuePass;
use super::tissue_store::{GpuTissue, MAX_TISSUES};
use super::types::{DISPLACED, FADING, SKINNED, TissueRecord, View};
use super::view::{TissueDirty, TissueView};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What was done since the counters were last taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GpuCounters {
    /// Compute dispatches.
    pub dispatches: u64,
    /// Draw calls, those of the shadow pass included.
    pub draws: u64,
    /// Bytes sent to the GPU.
    pub bytes_uploaded: u64,
}

/// What a picture shows besides the tissues.
#[derive(Clone, Copy, Debug, Default)]
pub struct DrawOptions<'a> {
    /// Tray, shadow, up.
    pub scenery: Scenery,
    /// Inspection layers.
    pub lines: &'a [LineSegment],
}

/// The GPU's side of a scene. Tissues are known by keys of the caller.
#[derive(Debug)]
pub struct Renderer {
    context: Arc<Context>,
    arenas: Arenas,
    materials: Materials,
    deform: DeformPass,
    stage: Stage,
    tissue_pass: TissuePass,
    lines: LinePass,
    targets: Option<Targets>,
    tissues: BTreeMap<u64, GpuTissue>,
    table: Table,
    free_slots: Vec<u32>,
    counters: GpuCounters,
}

impl Renderer {
    /// Compiles all pipelines.
    pub fn new(context: Arc<Context>) -> Self {
        let stage = Stage::new(&context);
        Self {
            arenas: Arenas::new(&context),
            materials: Materials::new(&context),
            deform: DeformPass::new(&context),
            tissue_pass: TissuePass::new(&context, &stage),
            lines: LinePass::new(&context, &stage),
            stage,
            targets: None,
            tissues: BTreeMap::new(),
            table: Table::new(&context, 16),
            free_slots: Vec::new(),
            counters: GpuCounters::default(),
            context,
        }
    }

    /// The adapter and device.
    pub fn context(&self) -> &Arc<Context> {
        &self.context
    }

    /// What was done since the last call.
    pub fn take_counters(&mut self) -> GpuCounters {
        std::mem::take(&mut self.counters)
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
        let before = self.arenas.bytes_uploaded();
        let result = self.sync_known(key, view, dirty);
        self.counters.bytes_uploaded += self.arenas.bytes_uploaded() - before;
        if result.is_err() {
            self.remove(key);
        }
        result
    }

    fn sync_known(&mut self, key: u64, view: &TissueView<'_>, dirty: &TissueDirty) -> Result<(), GpuError> {
        let Some(tissue) = self.tissues.get_mut(&key) else { return Err(GpuError::UnknownTissue(key)) };
        if tissue.wants_materials(view.versions) || matches!(dirty, TissueDirty::Full) {
            let bytes = self.materials.set(&self.context, tissue.record.slot as usize, view.materials)?;
            self.arenas.count_upload(bytes);
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
        }
    }

    /// Keys of all tissues.
    pub fn keys(&self) -> impl Iterator<Item = u64> + '_ {
        self.tissues.keys().copied()
    }

    /// Bounds of all tissues in their pose, world space.
    pub fn bounds(&self) -> Bounds {
        self.tissues.values().fold(Bounds::EMPTY, |all, t| all.union(t.posed_bounds()))
    }

    /// Uploads records and computes final positions and normals of every tissue that needs it; none, and nothing is
    /// dispatched or submitted. Errors: the device failed, now or earlier.
    pub fn deform(&mut self) -> Result<(), GpuError> {
        let mut encoder = self.encoder("deform");
        if self.encode_deform(&mut encoder) {
            self.context.queue().submit([encoder.finish()]);
        }
        self.context.check()
    }

    /// [`Renderer::deform`] into an encoder of the caller's. False if there was nothing to do.
    pub fn encode_deform(&mut self, encoder: &mut wgpu::CommandEncoder) -> bool {
        self.upload_table();
        self.deform.begin();
        let mut variant = Variant::default();
        for tissue in self.tissues.values_mut().filter(|t| t.needs_deform) {
            let record = &tissue.record;
            self.deform.add(record.slot, record.vertex_count, record.wedge_count);
            variant.skinned |= record.flags & SKINNED != 0;
            variant.displaced |= record.flags & (DISPLACED | FADING) != 0;
            tissue.needs_deform = false;
        }
        let table = (&self.table.buffer, self.table.generation);
        let (dispatches, bytes) = self.deform.encode(&self.context, encoder, &self.arenas, table, variant);
        self.counters.dispatches += dispatches;
        self.counters.bytes_uploaded += bytes;
        dispatches > 0
    }

    /// Deforms what needs it and draws a picture into the offscreen target. Errors: camera, size, or the device failed.
    pub fn draw(&mut self, camera: &Camera, size: (u32, u32), options: &DrawOptions<'_>) -> Result<(), GpuError> {
        if self.targets.as_ref().is_none_or(|t| t.size() != size) {
            self.targets = Some(Targets::new(&self.context, size)?);
        }
        let targets = self.targets.take().ok_or(GpuError::BadCamera("no target"))?;
        let mut encoder = self.encoder("frame");
        let drawn = self.encode(&mut encoder, targets.attachments(), camera, size, options);
        self.targets = Some(targets);
        drawn?;
        self.context.queue().submit([encoder.finish()]);
        self.context.check()
    }

    /// [`Renderer::draw`] into an encoder and views of the caller's.
    pub fn encode(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        attachments: Attachments<'_>,
        camera: &Camera,
        size: (u32, u32),
        options: &DrawOptions<'_>,
    ) -> Result<(), GpuError> {
        let rest = self.tissues.values().fold(Bounds::EMPTY, |all, t| all.union(t.rest_bounds()));
        let view = view_record(camera, size, &options.scenery, rest, self.bounds())?;
        self.encode_deform(encoder);
        self.prepare_draw(view, options.lines);
        if options.scenery.shadow {
            let mut pass = self.stage.begin_shadow(encoder);
            self.counters.draws += self.tissue_pass.draw_shadow(&mut pass);
        }
        let mut pass = attachments.begin(encoder);
        let mut draws = self.stage.draw_backdrop(&mut pass);
        draws += self.tissue_pass.draw(&mut pass);
        if options.scenery.tray && !self.tissues.is_empty() {
            draws += self.stage.draw_tray(&mut pass);
        }
        draws += self.lines.draw(&mut pass);
        self.counters.draws += draws;
        Ok(())
    }

    fn prepare_draw(&mut self, view: View, lines: &[LineSegment]) {
        self.counters.bytes_uploaded += self.stage.set_view(&self.context, view);
        self.counters.bytes_uploaded += self.lines.prepare(&self.context, lines);
        let table = (&self.table.buffer, self.table.generation);
        let faces = self.tissues.values().map(GpuTissue::faces);
        self.tissue_pass.prepare(&self.context, &self.arenas, table, &self.materials, faces);
    }

    /// Draws a picture and brings it back: RGBA8, sRGB, rows from the top. Waits for the GPU.
    pub fn render_to_image(&mut self, camera: &Camera, size: (u32, u32), options: &DrawOptions<'_>) -> Result<Vec<u8>, GpuError> {
        self.draw(camera, size, options)?;
        match &self.targets {
            Some(targets) => readback::read_texture(&self.context, targets.colour()),
            None => Ok(Vec::new()),
        }
    }

    /// Final positions of a tissue's vertices as last deformed, tissue space. For error checks: waits for the GPU.
    pub fn read_positions(&self, key: u64) -> Result<Vec<[f32; 3]>, GpuError> {
        self.read_deformed(key, GpuTissue::positions)
    }

    /// Final normals of a tissue's wedges as last deformed, tissue space. For error checks: waits for the GPU.
    pub fn read_normals(&self, key: u64) -> Result<Vec<[f32; 3]>, GpuError> {
        self.read_deformed(key, GpuTissue::normals)
    }

    fn read_deformed(&self, key: u64, pick: impl Fn(&GpuTissue) -> Slot) -> Result<Vec<[f32; 3]>, GpuError> {
        let slot = pick(self.tissues.get(&key).ok_or(GpuError::UnknownTissue(key))?);
        let buffer = self.arenas.buffer(ArenaKind::Deformed);
        let bytes = readback::read_buffer(&self.context, buffer, u64::from(slot.start) * 16, u64::from(slot.len) * 16)?;
        let (vectors, _) = bytes.as_chunks::<16>();
        let point = |bytes: &[u8; 16]| {
            let [x, y, z, _] = bytemuck::pod_read_unaligned::<[f32; 4]>(bytes);
            [x, y, z]
        };
        Ok(vectors.iter().map(point).collect())
    }

    fn new_slot(&mut self) -> Result<u32, GpuError> {
        if let Some(slot) = self.free_slots.pop() {
            return Ok(slot);
        }
        let slot = self.tissues.len();
        if slot >= MAX_TISSUES {
            return Err(GpuError::BadView(format!("{MAX_TISSUES} tissues are the most")));
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
        self.counters.bytes_uploaded += self.table.upload(&self.context);
    }

    fn encoder(&self, label: &str) -> wgpu::CommandEncoder {
        self.context.device().create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) })
    }
}

/// The records of all tissues.
#[derive(Debug)]
struct Table {
    records: Vec<TissueRecord>,
    dirty: std::ops::Range<usize>,
    buffer: wgpu::Buffer,
    generation: u64,
}

impl Table {
    fn new(context: &Context, tissues: usize) -> Self {
        Self { records: Vec::new(), dirty: 0..0, buffer: Self::make(context, tissues), generation: 0 }
    }

    fn make(context: &Context, tissues: usize) -> wgpu::Buffer {
        context.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("tissues"),
            size: (tissues * size_of::<TissueRecord>()) as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    fn set(&mut self, slot: u32, record: TissueRecord) {
        let slot = slot as usize;
        if self.records.len() <= slot {
            self.records.resize(slot + 1, TissueRecord::default());
        } else if self.records[slot] == record {
            return;
        }
        self.records[slot] = record;
        self.dirty =
            if self.dirty.is_empty() { slot..slot + 1 } else { self.dirty.start.min(slot)..self.dirty.end.max(slot + 1) };
    }

    /// Returns bytes.
    fn upload(&mut self, context: &Context) -> u64 {
        if self.dirty.is_empty() {
            return 0;
        }
        if self.buffer.size() < (self.records.len() * size_of::<TissueRecord>()) as u64 {
            self.buffer = Self::make(context, self.records.len() * 2);
            self.generation += 1;
            self.dirty = 0..self.records.len();
        }
        let range = std::mem::replace(&mut self.dirty, 0..0);
        let bytes: &[u8] = bytemuck::cast_slice(&self.records[range.clone()]);
        context.queue().write_buffer(&self.buffer, (range.start * size_of::<TissueRecord>()) as u64, bytes);
        bytes.len() as u64
    }
}
