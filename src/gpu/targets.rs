//! What is drawn into: a colour texture of ours or of a window or headset, and the samples and depth behind it.

use super::context::{COLOUR_FORMAT, Context, DEPTH_FORMAT};
use super::depth_copy::DepthCopy;
use super::error::GpuError;
use super::pipelines::PipelineKey;

/// A colour texture to draw into, one layer a view. Make it once for each image of a swapchain, not once a frame.
#[derive(Debug)]
pub struct ColourTarget {
    format: wgpu::TextureFormat,
    size: (u32, u32),
    /// All layers, where there are several.
    array: Option<wgpu::TextureView>,
    layers: Vec<wgpu::TextureView>,
}

impl ColourTarget {
    /// All layers of a texture. `format` is that of the views: the texture's own, or its sRGB twin if the texture allows it.
    /// Without an sRGB format the shaders apply the curve themselves.
    pub fn of_texture(texture: &wgpu::Texture, format: wgpu::TextureFormat) -> Self {
        let layers = texture.depth_or_array_layers();
        let view = |dimension, first, count| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                label: Some("colour target"),
                format: Some(format),
                usage: Some(wgpu::TextureUsages::RENDER_ATTACHMENT),
                dimension: Some(dimension),
                base_array_layer: first,
                array_layer_count: Some(count),
                mip_level_count: Some(1),
                ..Default::default()
            })
        };
        Self {
            format,
            size: (texture.width(), texture.height()),
            array: (layers > 1).then(|| view(wgpu::TextureViewDimension::D2Array, 0, layers)),
            layers: (0..layers).map(|layer| view(wgpu::TextureViewDimension::D2, layer, 1)).collect(),
        }
    }

    /// One view that others made, of one layer.
    pub fn of_view(view: wgpu::TextureView, format: wgpu::TextureFormat, size: (u32, u32)) -> Self {
        Self { format, size, array: None, layers: vec![view] }
    }

    /// Colour format of the views.
    pub fn format(&self) -> wgpu::TextureFormat {
        self.format
    }

    /// Width and height, pixels.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Layers: as many views as one call may draw.
    pub fn layers(&self) -> usize {
        self.layers.len()
    }
}

/// Where one call draws.
#[derive(Clone, Copy, Debug)]
pub struct RenderTarget<'a> {
    /// View `i` goes to layer `i`.
    pub colour: &'a ColourTarget,
    /// Draws into the upper left part of this size only, at that resolution ([`super::Resolution`]); `None`: all of it.
    pub viewport: Option<(u32, u32)>,
    /// Keeps the depth, in [`DEPTH_FORMAT`], with as many layers and the same size: for a compositor that wants it. Of several
    /// samples a pixel the first is kept.
    pub depth: Option<&'a ColourTarget>,
    /// Several samples a pixel, where adapter and format have them.
    pub smooth: bool,
}

impl<'a> RenderTarget<'a> {
    /// All of a colour target.
    pub fn new(colour: &'a ColourTarget) -> Self {
        Self { colour, viewport: None, depth: None, smooth: true }
    }

    /// The pixels drawn.
    pub fn viewport_size(&self) -> (u32, u32) {
        let full = self.colour.size;
        self.viewport.map_or(full, |v| (v.0.clamp(1, full.0.max(1)), v.1.clamp(1, full.1.max(1))))
    }

    /// Errors: more views than layers, a depth target that does not match.
    pub fn check(&self, views: usize) -> Result<(), GpuError> {
        if views > self.colour.layers() {
            return Err(GpuError::BadTarget(format!("{views} views and {} layers", self.colour.layers())));
        }
        match self.depth {
            Some(d) if d.size != self.colour.size || d.layers() != self.colour.layers() || d.format != DEPTH_FORMAT => {
                Err(GpuError::BadTarget("the depth target must have the colour target's size and layers".into()))
            }
            _ => Ok(()),
        }
    }
}

/// How several views are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Passes {
    /// At once where the adapter does that well.
    #[default]
    Auto,
    /// At once where the adapter can and the target has as many layers as there are views.
    AtOnce,
    /// A pass for each.
    Each,
}

impl Passes {
    /// True if so many views, a layer each, are drawn at once, with so many samples.
    pub fn at_once(self, context: &Context, views: usize, samples: u32) -> bool {
        let wanted = match self {
            Self::Auto => context.prefers_views_at_once(),
            Self::AtOnce => true,
            Self::Each => false,
        };
        wanted && context.draws_views_at_once(views as u32, samples)
    }
}

/// How a pass reaches the views of a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PassKind {
    /// All layers at once.
    Multiview,
    /// This layer alone.
    Layer(usize),
}

/// Samples and depth of one kind of target.
#[derive(Debug)]
struct Behind {
    size: (u32, u32),
    layers: usize,
    key: PipelineKey,
    samples: Option<ColourTarget>,
    depth: ColourTarget,
    depth_texture: wgpu::Texture,
    /// The samples of a layer's depth as a shader reads them; made when a target wants its depth kept.
    depth_samples: Vec<wgpu::BindGroup>,
    last_used: u64,
}

/// Samples and depth, kept between frames; those of targets that are gone are dropped.
#[derive(Debug, Default)]
pub struct TargetPool {
    entries: Vec<Behind>,
    depth_copy: Option<DepthCopy>,
    clock: u64,
}

/// Kinds of targets that are kept: eyes, a mirror window, a picture.
const MOST_KINDS: usize = 4;

impl TargetPool {
    /// The key and place of what lies behind a target, for this many views; made if it is not there.
    pub fn prepare(
        &mut self,
        context: &Context,
        target: &RenderTarget<'_>,
        views: usize,
        passes: Passes,
    ) -> (PipelineKey, usize) {
        let most = if target.smooth { context.samples_of(target.colour.format) } else { 1 };
        let multiview = views > 1 && views == target.colour.layers() && passes.at_once(context, views, most);
        let samples = if views > 1 && !multiview && !context.resolves_into_layers() { 1 } else { most };
        let key = PipelineKey { format: Some(target.colour.format), samples, views: if multiview { views as u32 } else { 1 } };
        self.clock += 1;
        // One view a pass needs one layer, used over and over.
        let layers = if multiview { views } else { 1 };
        let same = |b: &Behind| b.size == target.colour.size && b.key == key && b.layers == layers;
        let place = match self.entries.iter().position(same) {
            Some(place) => place,
            None => {
                if self.entries.len() >= MOST_KINDS {
                    let oldest = (0..self.entries.len()).min_by_key(|&i| self.entries[i].last_used).unwrap_or(0);
                    self.entries.remove(oldest);
                }
                self.entries.push(Behind::new(context, target.colour.size, layers, key));
                self.entries.len() - 1
            }
        };
        self.entries[place].last_used = self.clock;
        (key, place)
    }

    /// Copies the depth of what was drawn into the target's own, where it wants that and several samples a pixel lie between.
    /// Call it after the pass of the same kind.
    pub fn keep_depth(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        target: &RenderTarget<'_>,
        place: usize,
        kind: PassKind,
    ) {
        let behind = &mut self.entries[place];
        let Some(kept) = target.depth.filter(|_| behind.key.samples > 1) else { return };
        let copy = self.depth_copy.get_or_insert_with(|| DepthCopy::new(context));
        if behind.depth_samples.is_empty() {
            behind
                .depth_samples
                .extend((0..behind.layers as u32).map(|layer| copy.source(context, &behind.depth_texture, layer)));
        }
        match kind {
            PassKind::Multiview => {
                for (source, layer) in behind.depth_samples.iter().zip(&kept.layers) {
                    copy.encode(encoder, source, layer);
                }
            }
            PassKind::Layer(layer) => copy.encode(encoder, &behind.depth_samples[0], &kept.layers[layer]),
        }
    }

    /// Compiles what [`TargetPool::keep_depth`] will need.
    pub fn compile_depth(&mut self, context: &Context, target: &RenderTarget<'_>, key: PipelineKey) {
        if target.depth.is_some() && key.samples > 1 {
            self.depth_copy.get_or_insert_with(|| DepthCopy::new(context));
        }
    }

    /// Begins a pass that clears and draws.
    pub fn begin<'e>(
        &self,
        encoder: &'e mut wgpu::CommandEncoder,
        target: &RenderTarget<'_>,
        place: usize,
        kind: PassKind,
        timestamps: Option<wgpu::RenderPassTimestampWrites<'_>>,
    ) -> wgpu::RenderPass<'e> {
        let behind = &self.entries[place];
        let pick = |t: &'_ ColourTarget, layer: usize| match (kind, &t.array) {
            (PassKind::Multiview, Some(array)) => array.clone(),
            _ => t.layers[layer.min(t.layers.len() - 1)].clone(),
        };
        let layer = if let PassKind::Layer(layer) = kind { layer } else { 0 };
        let colour = pick(target.colour, layer);
        let samples = behind.samples.as_ref().map(|s| pick(s, 0));
        let (view, resolve_target, store) = match &samples {
            Some(samples) => (samples, Some(&colour), wgpu::StoreOp::Discard),
            None => (&colour, None, wgpu::StoreOp::Store),
        };
        let (depth, depth_store) = match target.depth {
            Some(depth) if behind.key.samples == 1 => (pick(depth, layer), wgpu::StoreOp::Store),
            Some(_) => (pick(&behind.depth, 0), wgpu::StoreOp::Store),
            None => (pick(&behind.depth, 0), wgpu::StoreOp::Discard),
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("scene"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: depth_store }),
                stencil_ops: None,
            }),
            timestamp_writes: timestamps,
            multiview_mask: behind.key.multiview_mask(),
            ..Default::default()
        });
        let (width, height) = target.viewport_size();
        if (width, height) != target.colour.size {
            pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
            pass.set_scissor_rect(0, 0, width, height);
        }
        pass
    }
}

impl Behind {
    fn new(context: &Context, size: (u32, u32), layers: usize, key: PipelineKey) -> Self {
        let make = |label, format, more| make_texture(context, label, size, layers as u32, format, key.samples, more);
        let samples = key.format.filter(|_| key.samples > 1).map(|format| {
            let texture = make("samples", format, wgpu::TextureUsages::empty());
            ColourTarget::of_texture(&texture, format)
        });
        let depth_texture = make("depth", DEPTH_FORMAT, wgpu::TextureUsages::TEXTURE_BINDING);
        let depth = ColourTarget::of_texture(&depth_texture, DEPTH_FORMAT);
        Self { size, layers, key, samples, depth, depth_texture, depth_samples: Vec::new(), last_used: 0 }
    }
}

fn make_texture(
    context: &Context,
    label: &str,
    size: (u32, u32),
    layers: u32,
    format: wgpu::TextureFormat,
    samples: u32,
    more: wgpu::TextureUsages,
) -> wgpu::Texture {
    context.device().create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: samples,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | more,
        view_formats: &[],
    })
}

/// An offscreen picture that can be read back, a layer a view.
#[derive(Debug)]
pub struct Picture {
    texture: wgpu::Texture,
    target: ColourTarget,
}

impl Picture {
    /// Errors: a side of 0 or one longer than the adapter's textures, or more layers than it has.
    pub fn new(context: &Context, size: (u32, u32), layers: u32) -> Result<Self, GpuError> {
        Self::check_size(context, size)?;
        let limits = context.device().limits();
        if layers == 0 || layers > limits.max_texture_array_layers {
            return Err(GpuError::BadTarget(format!("{layers} layers; 1 to {} there are", limits.max_texture_array_layers)));
        }
        let texture = make_texture(context, "picture", size, layers, COLOUR_FORMAT, 1, wgpu::TextureUsages::COPY_SRC);
        let target = ColourTarget::of_texture(&texture, COLOUR_FORMAT);
        Ok(Self { texture, target })
    }

    /// Errors: a side of 0 or one longer than the adapter's textures.
    pub fn check_size(context: &Context, size: (u32, u32)) -> Result<(), GpuError> {
        let limit = context.device().limits().max_texture_dimension_2d;
        if size.0 == 0 || size.1 == 0 || size.0 > limit || size.1 > limit {
            return Err(GpuError::BadSize { width: size.0, height: size.1, limit });
        }
        Ok(())
    }

    /// What holds the pixels.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.texture
    }

    /// What is drawn into.
    pub fn target(&self) -> &ColourTarget {
        &self.target
    }
}
