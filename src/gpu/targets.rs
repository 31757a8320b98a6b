//! What a picture is drawn into: colour, depth, and the samples before they are resolved.

use super::context::{COLOUR_FORMAT, Context, DEPTH_FORMAT};
use super::error::GpuError;

/// Targets of one size.
#[derive(Debug)]
pub struct Targets {
    size: (u32, u32),
    colour: wgpu::Texture,
    colour_view: wgpu::TextureView,
    samples: Option<wgpu::TextureView>,
    depth: wgpu::TextureView,
}

impl Targets {
    /// Offscreen targets. Errors: a side of 0, or one longer than the adapter's textures.
    pub fn new(context: &Context, size: (u32, u32)) -> Result<Self, GpuError> {
        let limit = context.device().limits().max_texture_dimension_2d;
        if size.0 == 0 || size.1 == 0 || size.0 > limit || size.1 > limit {
            return Err(GpuError::BadSize { width: size.0, height: size.1, limit });
        }
        let make = |label, format, sample_count, usage| {
            context.device().create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let attachment = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let colour = make("picture", COLOUR_FORMAT, 1, attachment | wgpu::TextureUsages::COPY_SRC);
        let samples = context.samples();
        let whole = |texture: wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        Ok(Self {
            size,
            colour_view: colour.create_view(&wgpu::TextureViewDescriptor::default()),
            colour,
            samples: (samples > 1).then(|| whole(make("samples", COLOUR_FORMAT, samples, attachment))),
            depth: whole(make("depth", DEPTH_FORMAT, samples, attachment)),
        })
    }

    /// Width and height, pixels.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// The resolved picture.
    pub fn colour(&self) -> &wgpu::Texture {
        &self.colour
    }

    /// Where a pass draws.
    pub fn attachments(&self) -> Attachments<'_> {
        let (view, resolve_target) = match &self.samples {
            Some(samples) => (samples, Some(&self.colour_view)),
            None => (&self.colour_view, None),
        };
        Attachments { view, resolve_target, depth: &self.depth }
    }
}

/// Views that a scene pass draws into: ours, or those of a window or a headset.
#[derive(Clone, Copy, Debug)]
pub struct Attachments<'a> {
    /// Drawn into; multisampled if there is a resolve target.
    pub view: &'a wgpu::TextureView,
    /// Where the samples are resolved to.
    pub resolve_target: Option<&'a wgpu::TextureView>,
    /// Reverse depth, as many samples as `view`.
    pub depth: &'a wgpu::TextureView,
}

impl<'a> Attachments<'a> {
    /// Begins the one pass of a picture.
    pub fn begin(self, encoder: &'a mut wgpu::CommandEncoder) -> wgpu::RenderPass<'a> {
        let store = if self.resolve_target.is_some() { wgpu::StoreOp::Discard } else { wgpu::StoreOp::Store };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("scene"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: self.view,
                depth_slice: None,
                resolve_target: self.resolve_target,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: self.depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }
}
