//! Shows a picture again in another size: what a mirror window does with one eye.

use super::context::Context;
use super::types;

/// Draws pictures of one format into targets of another.
#[derive(Debug)]
pub struct Blit {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::RenderPipeline,
    sampler: wgpu::Sampler,
    part: wgpu::Buffer,
    shown: Option<[f32; 4]>,
}

impl Blit {
    /// From views of format `from` to views of format `to`; of formats that are not sRGB it is taken that their numbers are
    /// coded.
    pub fn new(context: &Context, from: wgpu::TextureFormat, to: wgpu::TextureFormat) -> Self {
        let device = context.device();
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
            ty,
            count: None,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("blit"),
            entries: &[
                entry(
                    0,
                    wgpu::BindingType::Texture {
                        sample_type: wgpu::TextureSampleType::Float { filterable: true },
                        view_dimension: wgpu::TextureViewDimension::D2,
                        multisampled: false,
                    },
                ),
                entry(1, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
                entry(
                    2,
                    wgpu::BindingType::Buffer {
                        ty: wgpu::BufferBindingType::Uniform,
                        has_dynamic_offset: false,
                        min_binding_size: None,
                    },
                ),
            ],
        });
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("blit"),
            source: wgpu::ShaderSource::Wgsl(types::shader("blit").into()),
        });
        let flag = |on: bool| f64::from(u8::from(on));
        let constants = [("decode_srgb", flag(!from.is_srgb())), ("encode_srgb", flag(!to.is_srgb()))];
        let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("blit"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        context.note_pipeline();
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("blit"),
            layout: Some(&pipeline_layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("blit_corner"),
                compilation_options: options.clone(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("blit"),
                compilation_options: options,
                targets: &[Some(to.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("blit"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let part = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("blit"),
            size: 16,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Self { layout, pipeline, sampler, part, shown: None }
    }

    /// What one picture is shown through: make it once for each image of a swapchain.
    pub fn source(&self, context: &Context, picture: &wgpu::TextureView) -> wgpu::BindGroup {
        context.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("blit"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(picture) },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&self.sampler) },
                wgpu::BindGroupEntry { binding: 2, resource: self.part.as_entire_binding() },
            ],
        })
    }

    /// Fills `to` with a part of the picture: left, top, width and height, 0 to 1.
    pub fn encode(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        source: &wgpu::BindGroup,
        part: [f32; 4],
        to: &wgpu::TextureView,
    ) {
        if self.shown != Some(part) {
            context.queue().write_buffer(&self.part, 0, bytemuck::cast_slice(&part));
            self.shown = Some(part);
        }
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("blit"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: to,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, source, &[]);
        pass.draw(0..3, 0..1);
    }
}

/// The middle of a picture of size `from` that has the shape of `to`, as large as it can be, and a share `keep` of that:
/// left, top, width and height, 0 to 1.
pub fn middle_part(from: (u32, u32), to: (u32, u32), keep: f32) -> [f32; 4] {
    let aspect = |(w, h): (u32, u32)| w.max(1) as f32 / h.max(1) as f32;
    let wider = aspect(to) / aspect(from);
    let (width, height) = (wider.min(1.0) * keep, (1.0 / wider).min(1.0) * keep);
    [0.5 * (1.0 - width), 0.5 * (1.0 - height), width, height]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::ContextOptions;
    use crate::gpu::readback::read_texture;

    #[test]
    fn the_middle_has_the_shape_of_the_window() {
        for (from, to) in [((1344, 1512), (960, 720)), ((100, 100), (10, 40)), ((64, 64), (64, 64))] {
            let [left, top, width, height] = middle_part(from, to, 0.8);
            let shape = (width * from.0 as f32) / (height * from.1 as f32);
            assert!((shape - to.0 as f32 / to.1 as f32).abs() < 1e-3, "{shape}");
            assert!((width.max(height) - 0.8).abs() < 1e-6);
            assert!((2.0 * left + width - 1.0).abs() < 1e-6 && (2.0 * top + height - 1.0).abs() < 1e-6);
        }
    }

    fn texture(context: &Context, format: wgpu::TextureFormat, size: (u32, u32)) -> wgpu::Texture {
        context.device().create_texture(&wgpu::TextureDescriptor {
            label: Some("test"),
            size: wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_DST
                | wgpu::TextureUsages::COPY_SRC
                | wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        })
    }

    #[test]
    fn a_picture_keeps_its_colours_whatever_the_formats_and_its_sides() {
        let context = Context::headless(ContextOptions::default()).expect("an adapter");
        let (srgb, plain) = (wgpu::TextureFormat::Rgba8UnormSrgb, wgpu::TextureFormat::Rgba8Unorm);
        // Left half one colour, right half another; the part shown is the right half and a little of the left.
        let colour = |x: u32| if x < 32 { [200, 30, 90, 255] } else { [10, 120, 250, 255] };
        let pixels: Vec<u8> = (0..64 * 64).flat_map(|i: u32| colour(i % 64)).collect();
        for (from, to) in [(srgb, srgb), (srgb, plain), (plain, srgb), (plain, plain)] {
            let (source, target) = (texture(&context, from, (64, 64)), texture(&context, to, (64, 32)));
            let extent = wgpu::Extent3d { width: 64, height: 64, depth_or_array_layers: 1 };
            let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(256), rows_per_image: None };
            context.queue().write_texture(source.as_image_copy(), &pixels, layout, extent);
            let mut blit = Blit::new(&context, from, to);
            let view = source.create_view(&wgpu::TextureViewDescriptor::default());
            let group = blit.source(&context, &view);
            let mut encoder = context.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let target_view = target.create_view(&wgpu::TextureViewDescriptor::default());
            blit.encode(&context, &mut encoder, &group, [0.25, 0.0, 0.5, 1.0], &target_view);
            context.queue().submit([encoder.finish()]);
            let out = read_texture(&context, &target, 0).expect("pixels");
            let near = |x: usize, wanted: [u8; 4]| {
                let pixel = &out[4 * (16 * 64 + x)..][..4];
                assert!(pixel.iter().zip(wanted).all(|(a, b)| a.abs_diff(b) <= 1), "{from:?} {to:?} {pixel:?} {wanted:?}");
            };
            near(8, colour(0));
            near(56, colour(63));
            context.check().expect("no call was refused");
        }
    }
}
