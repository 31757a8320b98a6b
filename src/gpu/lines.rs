//! Coloured segments and points on top of the picture: what the inspection layers are made of. Free when there are none.

use super::belt::Belt;
use super::context::Context;
use super::pipelines::{PipelineFamily, PipelineKey, Shape};
use super::stage::{Stage, storage_entry};
use super::types::Line;
use glam::DVec3;

/// A segment in world space; a point where both ends are the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineSegment {
    /// One end.
    pub a: DVec3,
    /// The other.
    pub b: DVec3,
    /// Linear RGBA, 0 to 1.
    pub colour: [f32; 4],
    /// Pixels; of a point, its diameter.
    pub width: f32,
    /// Shows through what lies a little in front of it, up to a thirtieth of the way to the eye: for chords of a curved surface.
    pub over: bool,
}

impl LineSegment {
    /// A thin segment.
    pub fn new(a: DVec3, b: DVec3, colour: [f32; 4]) -> Self {
        Self { a, b, colour, width: 1.5, over: false }
    }

    /// A disc that faces the eye.
    pub fn point(at: DVec3, colour: [f32; 4], diameter: f32) -> Self {
        Self { a: at, b: at, colour, width: diameter, over: false }
    }

    fn record(&self) -> Line {
        let colour = self.colour.map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
        Line {
            a: self.a.as_vec3().to_array(),
            width: if self.over { -self.width } else { self.width },
            b: self.b.as_vec3().to_array(),
            colour: u32::from_le_bytes(colour),
        }
    }
}

/// Pipeline and buffer of the lines.
#[derive(Debug)]
pub struct LinePass {
    layout: wgpu::BindGroupLayout,
    pipelines: PipelineFamily,
    records: Vec<Line>,
    uploaded: Vec<Line>,
    buffer: Option<(wgpu::Buffer, wgpu::BindGroup)>,
}

impl LinePass {
    /// Compiles the pipeline.
    pub fn new(context: &Context, stage: &Stage) -> Self {
        let entries = [storage_entry(0, wgpu::ShaderStages::VERTEX)];
        let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some("lines"), entries: &entries };
        let layout = context.device().create_bind_group_layout(&descriptor);
        let shape =
            Shape { shader: "lines", vertex: "capsule", fragment: Some("ink"), blend: true, depth_write: false, ..Shape::SOLID };
        let pipelines = PipelineFamily::new(context, shape, &[&stage.layout, &layout]);
        Self { layout, pipelines, records: Vec::new(), uploaded: Vec::new(), buffer: None }
    }

    /// Compiles what a target needs, if there is anything to draw.
    pub fn prepare_target(&mut self, context: &Context, key: PipelineKey) {
        if !self.records.is_empty() {
            self.compile(context, key);
        }
    }

    /// Compiles what a target needs, whatever there is to draw.
    pub fn compile(&mut self, context: &Context, key: PipelineKey) {
        self.pipelines.prepare(context, key);
    }

    /// Uploads the lines of the next picture, if they differ from the last. Lines with an end that is not
    /// finite are left out; those over the adapter's buffer limit too.
    pub fn prepare(&mut self, context: &Context, belt: &mut Belt, lines: &[LineSegment]) {
        let most = context.device().limits().max_storage_buffer_binding_size as usize / size_of::<Line>();
        let finite = |l: &&LineSegment| l.a.is_finite() && l.b.is_finite() && l.width.is_finite();
        self.records.clear();
        self.records.extend(lines.iter().filter(finite).take(most).map(LineSegment::record));
        if self.records.is_empty() || self.records == self.uploaded {
            return;
        }
        let bytes: &[u8] = bytemuck::cast_slice(&self.records);
        if self.buffer.as_ref().is_none_or(|b| b.0.size() < bytes.len() as u64) {
            let room = (self.records.len() * 3 / 2).min(most).max(64);
            self.buffer = Some(self.make_buffer(context, room));
        }
        if let Some((buffer, _)) = &self.buffer {
            belt.write(buffer, 0, bytes);
        }
        self.uploaded.clone_from(&self.records);
    }

    fn make_buffer(&self, context: &Context, lines: usize) -> (wgpu::Buffer, wgpu::BindGroup) {
        let buffer = context.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("lines"),
            size: (lines * size_of::<Line>()) as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let group = context.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("lines"),
            layout: &self.layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
        });
        (buffer, group)
    }

    /// Draws the lines of the last [`LinePass::prepare`]. Returns draws.
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>, key: PipelineKey, view: u32) -> u64 {
        let Some((_, group)) = self.buffer.as_ref().filter(|_| !self.records.is_empty()) else { return 0 };
        if !self.pipelines.set(pass, key) {
            return 0;
        }
        pass.set_bind_group(1, group, &[]);
        pass.draw(0..6 * self.records.len() as u32, view..view + 1);
        1
    }
}
