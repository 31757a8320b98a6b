//! What all drawing shares: the view record, the lamp's shadow map, and the ground and backdrop themselves.

use super::camera::SHADOW_SIZE;
use super::context::{COLOUR_FORMAT, Context, DEPTH_FORMAT};
use super::types::{self, View};

/// View record, shadow map, backdrop and tray.
#[derive(Debug)]
pub struct Stage {
    view: wgpu::Buffer,
    uploaded: Option<View>,
    shadow_map: wgpu::TextureView,
    /// Group 0 of everything that is lit: view, shadow map, its sampler.
    pub layout: wgpu::BindGroupLayout,
    /// Group 0 of everything that is not: the view alone.
    pub view_layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
    view_group: wgpu::BindGroup,
    backdrop: wgpu::RenderPipeline,
    tray: wgpu::RenderPipeline,
}

/// How a pipeline differs from the others.
pub struct PipelineShape<'a> {
    /// Shader and label.
    pub shader: &'static str,
    /// Vertex entry point.
    pub vertex: &'static str,
    /// Fragment entry point; none draws depth only.
    pub fragment: Option<&'static str>,
    /// Bind group layouts.
    pub layouts: &'a [Option<&'a wgpu::BindGroupLayout>],
    /// How vertices become triangles.
    pub topology: wgpu::PrimitiveTopology,
    /// Which side is not drawn.
    pub cull: Option<wgpu::Face>,
    /// Blends over what is there.
    pub blend: bool,
    /// Writes depth.
    pub depth_write: bool,
    /// Compares depth.
    pub depth_test: bool,
    /// Samples a pixel.
    pub samples: u32,
}

impl PipelineShape<'_> {
    /// Compiles it.
    pub fn build(&self, context: &Context) -> wgpu::RenderPipeline {
        let device = context.device();
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(self.shader),
            source: wgpu::ShaderSource::Wgsl(types::shader(self.shader).into()),
        });
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(self.shader),
            bind_group_layouts: self.layouts,
            immediate_size: 0,
        });
        let targets = [Some(wgpu::ColorTargetState {
            format: COLOUR_FORMAT,
            blend: self.blend.then_some(wgpu::BlendState::ALPHA_BLENDING),
            write_mask: wgpu::ColorWrites::ALL,
        })];
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.shader),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(self.vertex),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState { topology: self.topology, cull_mode: self.cull, ..Default::default() },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH_FORMAT,
                depth_write_enabled: Some(self.depth_write),
                depth_compare: Some(if self.depth_test {
                    wgpu::CompareFunction::GreaterEqual
                } else {
                    wgpu::CompareFunction::Always
                }),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: wgpu::MultisampleState { count: self.samples, ..Default::default() },
            fragment: self.fragment.map(|entry| wgpu::FragmentState {
                module: &module,
                entry_point: Some(entry),
                compilation_options: Default::default(),
                targets: &targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

impl Stage {
    /// Compiles the pipelines and makes the shadow map.
    pub fn new(context: &Context) -> Self {
        let device = context.device();
        let view = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("view"),
            size: size_of::<View>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let shadow_map = make_shadow_map(device);
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadow"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            compare: Some(wgpu::CompareFunction::GreaterEqual),
            ..Default::default()
        });
        let entries = view_layout_entries();
        let make_layout = |entries: &[wgpu::BindGroupLayoutEntry]| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("view"), entries })
        };
        let (layout, view_layout) = (make_layout(&entries), make_layout(&entries[..1]));
        let resources = [
            wgpu::BindGroupEntry { binding: 0, resource: view.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(&shadow_map) },
            wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::Sampler(&sampler) },
        ];
        let make_group = |layout: &wgpu::BindGroupLayout, entries: &[wgpu::BindGroupEntry<'_>]| {
            device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("view"), layout, entries })
        };
        let (group, view_group) = (make_group(&layout, &resources), make_group(&view_layout, &resources[..1]));
        let layouts = [Some(&layout)];
        let shape = PipelineShape {
            shader: "ground",
            vertex: "screen",
            fragment: Some("sky"),
            layouts: &layouts,
            topology: wgpu::PrimitiveTopology::TriangleStrip,
            cull: None,
            blend: false,
            depth_write: false,
            depth_test: false,
            samples: context.samples(),
        };
        let backdrop = shape.build(context);
        let tray = PipelineShape {
            vertex: "tray",
            fragment: Some("drape"),
            cull: Some(wgpu::Face::Back),
            blend: true,
            depth_write: true,
            depth_test: true,
            ..shape
        }
        .build(context);
        Self { view, uploaded: None, shadow_map, layout, view_layout, group, view_group, backdrop, tray }
    }

    /// Uploads the view if it is another than the last. Returns bytes.
    pub fn set_view(&mut self, context: &Context, view: View) -> u64 {
        if self.uploaded == Some(view) {
            return 0;
        }
        context.queue().write_buffer(&self.view, 0, bytemuck::bytes_of(&view));
        self.uploaded = Some(view);
        size_of::<View>() as u64
    }

    /// The depth-only pass of the lamp.
    pub fn begin_shadow<'a>(&self, encoder: &'a mut wgpu::CommandEncoder) -> wgpu::RenderPass<'a> {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("shadow"),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.shadow_map,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_bind_group(0, &self.view_group, &[]);
        pass
    }

    /// Binds the view for lit drawing and draws the backdrop. Returns draws.
    pub fn draw_backdrop(&self, pass: &mut wgpu::RenderPass<'_>) -> u64 {
        pass.set_bind_group(0, &self.group, &[]);
        pass.set_pipeline(&self.backdrop);
        pass.draw(0..3, 0..1);
        1
    }

    /// Draws the tray, after everything that stands on it: what is hidden is not shaded. Returns draws.
    pub fn draw_tray(&self, pass: &mut wgpu::RenderPass<'_>) -> u64 {
        pass.set_pipeline(&self.tray);
        pass.draw(0..4, 0..1);
        1
    }
}

fn view_layout_entries() -> [wgpu::BindGroupLayoutEntry; 3] {
    let entry = |binding, visibility, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let uniform =
        wgpu::BindingType::Buffer { ty: wgpu::BufferBindingType::Uniform, has_dynamic_offset: false, min_binding_size: None };
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
