//! Render pipelines, compiled on first use for each kind of target: colour format, samples, views a pass.

use super::context::{Context, DEPTH_FORMAT};
use super::types;
use std::num::NonZeroU32;

/// What a target asks of a pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PipelineKey {
    /// Colour format; `None` for depth alone.
    pub format: Option<wgpu::TextureFormat>,
    /// Samples a pixel.
    pub samples: u32,
    /// Views that one pass draws: more than 1 is multiview.
    pub views: u32,
}

impl PipelineKey {
    /// A depth-only pass.
    pub const DEPTH: Self = Self { format: None, samples: 1, views: 1 };

    /// The layers that a pass draws, where it draws several.
    pub fn multiview_mask(self) -> Option<NonZeroU32> {
        if self.views > 1 { NonZeroU32::new(((1u64 << self.views) - 1) as u32) } else { None }
    }
}

/// What makes a pipeline itself, on any target.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Shader and label.
    pub shader: &'static str,
    /// Vertex entry point.
    pub vertex: &'static str,
    /// Fragment entry point; none draws depth only.
    pub fragment: Option<&'static str>,
    /// Which side is not drawn.
    pub cull: Option<wgpu::Face>,
    /// Blends over what is there.
    pub blend: bool,
    /// Writes depth. All compare it: a fragment must be at least as near as what is there.
    pub depth_write: bool,
}

impl Shape {
    /// Solid triangles, both sides.
    pub const SOLID: Self = Self { shader: "", vertex: "", fragment: None, cull: None, blend: false, depth_write: true };
}

/// One shape's pipelines.
#[derive(Debug)]
pub struct PipelineFamily {
    shape: Shape,
    layout: wgpu::PipelineLayout,
    /// For one view a pass, and for several.
    modules: [Option<wgpu::ShaderModule>; 2],
    made: Vec<(PipelineKey, wgpu::RenderPipeline)>,
}

impl PipelineFamily {
    /// Compiles nothing yet.
    pub fn new(context: &Context, shape: Shape, layouts: &[&wgpu::BindGroupLayout]) -> Self {
        let layouts: Vec<_> = layouts.iter().map(|l| Some(*l)).collect();
        let layout = context.device().create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(shape.shader),
            bind_group_layouts: &layouts,
            immediate_size: 0,
        });
        Self { shape, layout, modules: [None, None], made: Vec::new() }
    }

    /// Compiles the pipeline of a target, if there is none yet.
    pub fn prepare(&mut self, context: &Context, key: PipelineKey) {
        if self.made.iter().all(|m| m.0 != key) {
            let multiview = key.views > 1;
            let module = self.modules[usize::from(multiview)].get_or_insert_with(|| {
                let text = types::shader_for(self.shape.shader, multiview);
                let text = if context.deforms() { text } else { types::with_uniform_table(&text) };
                context.device().create_shader_module(wgpu::ShaderModuleDescriptor {
                    label: Some(self.shape.shader),
                    source: wgpu::ShaderSource::Wgsl(text),
                })
            });
            let pipeline = build(context, &self.shape, &self.layout, module, key);
            context.note_pipeline();
            self.made.push((key, pipeline));
        }
    }

    /// Sets the pipeline of a target. False, and nothing happens, if it was not prepared.
    pub fn set(&self, pass: &mut wgpu::RenderPass<'_>, key: PipelineKey) -> bool {
        let made = self.made.iter().find(|m| m.0 == key);
        if let Some((_, pipeline)) = made {
            pass.set_pipeline(pipeline);
        }
        made.is_some()
    }
}

fn build(
    context: &Context,
    shape: &Shape,
    layout: &wgpu::PipelineLayout,
    module: &wgpu::ShaderModule,
    key: PipelineKey,
) -> wgpu::RenderPipeline {
    let targets = key.format.map(|format| {
        [Some(wgpu::ColorTargetState {
            format,
            blend: shape.blend.then_some(wgpu::BlendState::ALPHA_BLENDING),
            write_mask: wgpu::ColorWrites::ALL,
        })]
    });
    let constants = [("encode_srgb", f64::from(u8::from(key.format.is_some_and(|f| !f.is_srgb()))))];
    let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
    context.device().create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(shape.vertex),
        layout: Some(layout),
        vertex: wgpu::VertexState { module, entry_point: Some(shape.vertex), compilation_options: options.clone(), buffers: &[] },
        // Lists only: Mesa 22's software driver draws every view's strips into the first layer.
        primitive: wgpu::PrimitiveState { cull_mode: shape.cull, ..Default::default() },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(shape.depth_write),
            depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: wgpu::MultisampleState { count: key.samples, ..Default::default() },
        fragment: shape.fragment.zip(targets.as_ref()).map(|(entry, targets)| wgpu::FragmentState {
            module,
            entry_point: Some(entry),
            compilation_options: options,
            targets,
        }),
        multiview_mask: key.multiview_mask(),
        cache: None,
    })
}
