//! Coloured segments and points on top of the picture: what the inspection layers are made of. Free when there are none.

use super::context::Context;
use super::stage::{PipelineShape, Stage};
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
}

impl LineSegment {
    /// A thin segment.
    pub fn new(a: DVec3, b: DVec3, colour: [f32; 4]) -> Self {
        Self { a, b, colour, width: 1.5 }
    }

    /// A disc that faces the eye.
    pub fn point(at: DVec3, colour: [f32; 4], diameter: f32) -> Self {
        Self { a: at, b: at, colour, width: diameter }
    }

    fn record(&self) -> Line {
        let colour = self.colour.map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
        Line {
            a: self.a.as_vec3().to_array(),
            width: self.width,
            b: self.b.as_vec3().to_array(),
            colour: u32::from_le_bytes(colour),
        }
    }
}

/// Pipeline and buffer of the lines.
#[derive(Debug)]
pub struct LinePass {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::RenderPipeline,
    records: Vec<Line>,
    uploaded: Vec<Line>,
    buffer: Option<(wgpu::Buffer, wgpu::BindGroup)>,
}

impl LinePass {
    /// Compiles the pipeline.
    pub fn new(context: &Context, stage: &Stage) -> Self {
        let entry = wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::VERTEX,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only: true },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some("lines"), entries: &[entry] };
        let layout = context.device().create_bind_group_layout(&descriptor);
        let pipeline = PipelineShape {
            shader: "lines",
            vertex: "capsule",
            fragment: Some("ink"),
            layouts: &[Some(&stage.layout), Some(&layout)],
            topology: wgpu::PrimitiveTopology::TriangleStrip,
            cull: None,
            blend: true,
            depth_write: false,
            depth_test: true,
            samples: context.samples(),
        }
        .build(context);
        Self { layout, pipeline, records: Vec::new(), uploaded: Vec::new(), buffer: None }
    }

    /// Uploads the lines of the next picture, if they differ from the last. Returns bytes. Lines with an end that is not
    /// finite are left out; those over the adapter's buffer limit too.
    pub fn prepare(&mut self, context: &Context, lines: &[LineSegment]) -> u64 {
        let most = context.device().limits().max_storage_buffer_binding_size as usize / size_of::<Line>();
        let finite = |l: &&LineSegment| l.a.is_finite() && l.b.is_finite() && l.width.is_finite();
        self.records.clear();
        self.records.extend(lines.iter().filter(finite).take(most).map(LineSegment::record));
        if self.records.is_empty() || self.records == self.uploaded {
            return 0;
        }
        let bytes: &[u8] = bytemuck::cast_slice(&self.records);
        if self.buffer.as_ref().is_none_or(|b| b.0.size() < bytes.len() as u64) {
            let room = (self.records.len() * 3 / 2).min(most).max(64);
            self.buffer = Some(self.make_buffer(context, room));
        }
        if let Some((buffer, _)) = &self.buffer {
            context.queue().write_buffer(buffer, 0, bytes);
        }
        self.uploaded.clone_from(&self.records);
        bytes.len() as u64
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
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>) -> u64 {
        let Some((_, group)) = self.buffer.as_ref().filter(|_| !self.records.is_empty()) else { return 0 };
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(1, group, &[]);
        pass.draw(0..4, 0..self.records.len() as u32);
        1
    }
}
