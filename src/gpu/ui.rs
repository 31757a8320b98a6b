//! Draws egui's triangles over a picture, or into a texture of their own (a panel in the world).

use super::context::Context;

/// egui's renderer for one kind of target.
pub struct UiPass {
    renderer: egui_wgpu::Renderer,
    /// Freed once the pass that may still use them has been submitted.
    free: Vec<egui::TextureId>,
    cost: UiCost,
}

/// What frames of a user interface have cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UiCost {
    /// Draw calls.
    pub draws: u64,
    /// Bytes sent to the GPU: corners, indices, glyphs.
    pub bytes_uploaded: u64,
}

/// One frame of a user interface.
pub struct UiFrame {
    /// Triangles, in points.
    pub jobs: Vec<egui::ClippedPrimitive>,
    /// Textures that are new, changed or no longer used.
    pub textures: egui::TexturesDelta,
    /// Pixels a point.
    pub pixels_per_point: f32,
}

impl UiPass {
    /// A pass into views of `format`; a format that is not sRGB gives the colours that egui means.
    pub fn new(context: &Context, format: wgpu::TextureFormat) -> Self {
        context.note_pipeline();
        let options = egui_wgpu::RendererOptions { msaa_samples: 1, dithering: false, ..Default::default() };
        Self { renderer: egui_wgpu::Renderer::new(context.device(), format, options), free: Vec::new(), cost: UiCost::default() }
    }

    /// What was drawn since it was last asked.
    pub fn take_cost(&mut self) -> UiCost {
        std::mem::take(&mut self.cost)
    }

    /// Encodes the frame into `view`, of `size` pixels, over what is there, or over nothing if `clear`. The command buffers
    /// returned are to be submitted before the encoder's.
    pub fn encode(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        view: &wgpu::TextureView,
        size: (u32, u32),
        frame: UiFrame,
        clear: bool,
    ) -> Vec<wgpu::CommandBuffer> {
        let UiFrame { jobs, mut textures, pixels_per_point } = frame;
        let queue = context.queue();
        for id in self.free.drain(..) {
            self.renderer.free_texture(&id);
        }
        for (id, deltas) in textures.set.drain() {
            for delta in deltas {
                let [width, height] = delta.image.size();
                self.cost.bytes_uploaded += (width * height * delta.image.bytes_per_pixel()) as u64;
                self.renderer.update_texture(context.device(), &queue, id, &delta);
            }
        }
        self.free.extend(textures.free.drain());
        for job in &jobs {
            if let egui::epaint::Primitive::Mesh(mesh) = &job.primitive {
                self.cost.draws += 1;
                self.cost.bytes_uploaded += (size_of_val(&mesh.vertices[..]) + size_of_val(&mesh.indices[..])) as u64;
            }
        }
        let screen = egui_wgpu::ScreenDescriptor { size_in_pixels: [size.0, size.1], pixels_per_point };
        let buffers = self.renderer.update_buffers(context.device(), &queue, encoder, &jobs, &screen);
        let load = if clear { wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT) } else { wgpu::LoadOp::Load };
        let mut pass = encoder
            .begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("ui"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
                })],
                ..Default::default()
            })
            .forget_lifetime();
        self.renderer.render(&mut pass, &jobs, &screen);
        buffers
    }
}
