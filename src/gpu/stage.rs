//! What all drawing shares: the frame's record, the lamp's shadow map, the ground, the backdrop, and the mask of a headset.

use super::camera::SHADOW_SIZE;
use super::context::{Context, DEPTH_FORMAT};
use super::pipelines::{PipelineFamily, PipelineKey, Shape};
use super::types::Frame;
use super::views::ViewPose;

/// What a headset's lenses hide of one view: triangles, corners as tangents from the eye (x right, y up, on the plane one metre
/// ahead), as `XR_KHR_visibility_mask` gives them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VisibilityMask {
    /// Corners.
    pub corners: Vec<[f32; 2]>,
    /// Three a triangle; indices past the end are dropped with their triangle.
    pub indices: Vec<u32>,
}

/// Frame records, shadow map, backdrop, tray and mask.
#[derive(Debug)]
pub struct Stage {
    frames: FrameRing,
    shadow_map: wgpu::TextureView,
    /// Group 0 of everything that is lit: frame, shadow map, its sampler.
    pub layout: wgpu::BindGroupLayout,
    /// Group 0 of everything that is not: the frame alone.
    pub frame_layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
    frame_group: wgpu::BindGroup,
    backdrop: PipelineFamily,
    tray: PipelineFamily,
    mask: PipelineFamily,
    mask_layout: wgpu::BindGroupLayout,
    hidden: Option<(wgpu::BindGroup, u32)>,
}

impl Stage {
    /// Makes the shadow map; pipelines follow with the first target.
    pub fn new(context: &Context) -> Self {
        let device = context.device();
        let frames = FrameRing::new(device);
        let shadow_map = make_shadow_map(device);
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadow"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            compare: Some(wgpu::CompareFunction::GreaterEqual),
            ..Default::default()
        });
        let entries = frame_layout_entries();
        let make_layout = |label, entries: &[wgpu::BindGroupLayoutEntry]| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries })
        };
        let (layout, frame_layout) = (make_layout("frame", &entries), make_layout("frame", &entries[..1]));
        let mask_layout = make_layout("mask", &[storage_entry(0, wgpu::ShaderStages::VERTEX)]);
        let frame =
            wgpu::BufferBinding { buffer: &frames.buffer, offset: 0, size: std::num::NonZeroU64::new(size_of::<Frame>() as u64) };
        let resources = [
            wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::Buffer(frame) },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(&shadow_map) },
            wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::Sampler(&sampler) },
        ];
        let make_group = |layout: &wgpu::BindGroupLayout, entries: &[wgpu::BindGroupEntry<'_>]| {
            device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("frame"), layout, entries })
        };
        let (group, frame_group) = (make_group(&layout, &resources), make_group(&frame_layout, &resources[..1]));
        let ground = Shape { shader: "ground", ..Shape::SOLID };
        let backdrop = Shape { vertex: "screen", fragment: Some("sky"), depth_write: false, ..ground };
        let tray = Shape { vertex: "tray", fragment: Some("drape"), cull: Some(wgpu::Face::Back), blend: true, ..ground };
        let mask = Shape { vertex: "mask_corner", fragment: Some("mask"), ..ground };
        Self {
            backdrop: PipelineFamily::new(context, backdrop, &[&layout]),
            tray: PipelineFamily::new(context, tray, &[&layout]),
            mask: PipelineFamily::new(context, mask, &[&layout, &mask_layout]),
            frames,
            shadow_map,
            layout,
            frame_layout,
            group,
            frame_group,
            mask_layout,
            hidden: None,
        }
    }

    /// Compiles what a target needs.
    pub fn prepare(&mut self, context: &Context, key: PipelineKey) {
        self.backdrop.prepare(context, key);
        self.tray.prepare(context, key);
        self.mask.prepare(context, key);
    }

    /// Makes a frame the current one; uploads it unless it is there already. Returns bytes.
    pub fn set_frame(&mut self, context: &Context, frame: &Frame) -> u64 {
        self.frames.set(context, frame)
    }

    /// Gives the current frame's views other poses, for everything that is encoded and not yet submitted. Returns bytes.
    pub fn set_late_views(&mut self, context: &Context, views: &[ViewPose]) -> u64 {
        self.frames.set_views(context, views)
    }

    /// What each view hides; none for no mask. Bad triangles are left out.
    pub fn set_masks(&mut self, context: &Context, masks: &[VisibilityMask]) {
        let mut corners: Vec<[f32; 4]> = Vec::new();
        for (view, mask) in masks.iter().enumerate() {
            for triangle in mask.indices.as_chunks::<3>().0 {
                let corner = |i: u32| mask.corners.get(i as usize).filter(|c| c[0].is_finite() && c[1].is_finite());
                if let [Some(a), Some(b), Some(c)] = triangle.map(corner) {
                    corners.extend([a, b, c].map(|p| [p[0], p[1], view as f32, 0.0]));
                }
            }
        }
        if corners.is_empty() {
            self.hidden = None;
            return;
        }
        let bytes: &[u8] = bytemuck::cast_slice(&corners);
        let buffer = context.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("mask"),
            size: bytes.len() as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        context.queue().write_buffer(&buffer, 0, bytes);
        let group = context.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("mask"),
            layout: &self.mask_layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
        });
        self.hidden = Some((group, corners.len() as u32));
    }

    /// The depth-only pass of the lamp.
    pub fn begin_shadow<'a>(
        &self,
        encoder: &'a mut wgpu::CommandEncoder,
        timestamps: Option<wgpu::RenderPassTimestampWrites<'_>>,
    ) -> wgpu::RenderPass<'a> {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("shadow"),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.shadow_map,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            timestamp_writes: timestamps,
            ..Default::default()
        });
        pass.set_bind_group(0, &self.frame_group, &[self.frames.offset()]);
        pass
    }

    /// Binds the current frame for lit drawing.
    pub fn bind(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_bind_group(0, &self.group, &[self.frames.offset()]);
    }

    /// Draws what the lenses hide, before everything else: nothing behind it is shaded. Returns draws.
    pub fn draw_mask(&self, pass: &mut wgpu::RenderPass<'_>, key: PipelineKey, view: u32) -> u64 {
        let Some((group, corners)) = &self.hidden else { return 0 };
        if !self.mask.set(pass, key) {
            return 0;
        }
        pass.set_bind_group(1, group, &[]);
        pass.draw(0..*corners, view..view + 1);
        1
    }

    /// Draws the backdrop where nothing else was drawn. Returns draws.
    pub fn draw_backdrop(&self, pass: &mut wgpu::RenderPass<'_>, key: PipelineKey, view: u32) -> u64 {
        draw(&self.backdrop, pass, key, 6, view)
    }

    /// Draws the tray, after everything that stands on it: what is hidden is not shaded. Returns draws.
    pub fn draw_tray(&self, pass: &mut wgpu::RenderPass<'_>, key: PipelineKey, view: u32) -> u64 {
        draw(&self.tray, pass, key, 6, view)
    }
}

fn draw(family: &PipelineFamily, pass: &mut wgpu::RenderPass<'_>, key: PipelineKey, vertices: u32, view: u32) -> u64 {
    if !family.set(pass, key) {
        return 0;
    }
    pass.draw(0..vertices, view..view + 1);
    1
}

/// Frame records in turn, so that several calls may be encoded before one submission.
#[derive(Debug)]
struct FrameRing {
    buffer: wgpu::Buffer,
    stride: u32,
    uploaded: [Option<Box<Frame>>; SLOTS],
    current: usize,
}

/// Calls that one submission may hold.
const SLOTS: usize = 8;

impl FrameRing {
    fn new(device: &wgpu::Device) -> Self {
        let align = device.limits().min_uniform_buffer_offset_alignment.max(1);
        let stride = (size_of::<Frame>() as u32).next_multiple_of(align);
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("frames"),
            size: u64::from(stride) * SLOTS as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Self { buffer, stride, uploaded: [const { None }; SLOTS], current: 0 }
    }

    fn offset(&self) -> u32 {
        self.current as u32 * self.stride
    }

    fn set(&mut self, context: &Context, frame: &Frame) -> u64 {
        if let Some(known) = self.uploaded.iter().position(|u| u.as_deref() == Some(frame)) {
            self.current = known;
            return 0;
        }
        self.current = (self.current + 1) % SLOTS;
        self.write(context, frame)
    }

    fn set_views(&mut self, context: &Context, views: &[ViewPose]) -> u64 {
        let Some(mut frame) = self.uploaded[self.current].as_deref().copied() else { return 0 };
        for (record, view) in frame.views.iter_mut().zip(views) {
            let [width, height, ..] = record.size;
            *record = view.record((width as u32, height as u32));
        }
        if self.uploaded[self.current].as_deref() == Some(&frame) { 0 } else { self.write(context, &frame) }
    }

    fn write(&mut self, context: &Context, frame: &Frame) -> u64 {
        context.queue().write_buffer(&self.buffer, u64::from(self.offset()), bytemuck::bytes_of(frame));
        match &mut self.uploaded[self.current] {
            Some(known) => **known = *frame,
            none => *none = Some(Box::new(*frame)),
        }
        size_of::<Frame>() as u64
    }
}

/// A storage buffer that is read.
pub fn storage_entry(binding: u32, visibility: wgpu::ShaderStages) -> wgpu::BindGroupLayoutEntry {
    let ty = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Storage { read_only: true },
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None }
}

fn frame_layout_entries() -> [wgpu::BindGroupLayoutEntry; 3] {
    let entry = |binding, visibility, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let uniform =
        wgpu::BindingType::Buffer { ty: wgpu::BufferBindingType::Uniform, has_dynamic_offset: true, min_binding_size: None };
    let depth = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Depth,
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    [
        entry(0, wgpu::ShaderStages::VERTEX_FRAGMENT, uniform),
        entry(1, wgpu::ShaderStages::FRAGMENT, depth),
        entry(2, wgpu::ShaderStages::FRAGMENT, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison)),
    ]
}

fn make_shadow_map(device: &wgpu::Device) -> wgpu::TextureView {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("shadow map"),
        size: wgpu::Extent3d { width: SHADOW_SIZE, height: SHADOW_SIZE, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: DEPTH_FORMAT,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}
