//! One eye in a window, for those who look on. It takes the picture that the headset gets anyway, and never waits: a frame that
//! finds the window busy is not shown there.

use super::swapchain::Images;
use crate::gpu::Context;
use crate::gpu::blit::{Blit, middle_part};
use crate::host::has_display;
use crate::host::spectator::{Ready, Spectator};
use std::sync::Arc;

/// The window, points.
const SIZE: (u32, u32) = (960, 720);
/// How much of the eye's picture is shown: its rim is what the lenses hide or blur.
const KEEP: f32 = 0.75;

/// What this session's pictures are shown with.
struct Shown {
    blit: Blit,
    /// One an image of the eyes' swapchain.
    sources: Vec<wgpu::BindGroup>,
    format: wgpu::TextureFormat,
}

/// A window that mirrors the left eye.
pub struct EyeMirror {
    window: Spectator,
    shown: Option<Shown>,
    drawn: bool,
    frames: u64,
}

impl EyeMirror {
    /// Opens the window, if there is a display. None where there is not, or where it gives no window; the log says why.
    pub fn open() -> Option<Self> {
        if !has_display() {
            tracing::info!("no display, so no mirror of the headset");
            return None;
        }
        match Spectator::open("Incise (what the left eye sees)", SIZE) {
            Ok(window) => Some(Self { window, shown: None, drawn: false, frames: 0 }),
            Err(why) => {
                tracing::warn!("no mirror of the headset: {why}");
                None
            }
        }
    }

    /// A session begins.
    pub fn begin(&mut self, context: &Arc<Context>) {
        self.window.attach(context);
    }

    /// A session ends: nothing of its device is held on to.
    pub fn end(&mut self) {
        self.shown = None;
        self.drawn = false;
        self.window.detach();
    }

    /// True once the user has closed the window.
    pub fn is_closed(&self) -> bool {
        self.window.is_closed()
    }

    /// Frames that were shown.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Draws the left eye's image, of which the upper left pixels were drawn, for the window, if that is ready, and leaves the image as the runtime wants it back. Errors:
    /// this session cannot be mirrored.
    pub fn draw(&mut self, images: &Images, index: usize, drawn: (u32, u32)) -> Result<(), String> {
        let Some(Ready { context, texture, format }) = self.window.ready()? else { return Ok(()) };
        let context = context.clone();
        if self.shown.as_ref().is_none_or(|s| s.format != format) {
            let blit = Blit::new(&context, images.format(), format);
            let source = |i: usize| {
                let left = wgpu::TextureViewDescriptor {
                    dimension: Some(wgpu::TextureViewDimension::D2),
                    array_layer_count: Some(1),
                    ..Default::default()
                };
                blit.source(&context, &images.texture(i).create_view(&left))
            };
            let sources = (0..images.len()).map(source).collect();
            self.shown = Some(Shown { blit, sources, format });
        }
        let Some(Shown { blit, sources, .. }) = &mut self.shown else { return Ok(()) };
        let share = [drawn.0 as f32 / images.size().0 as f32, drawn.1 as f32 / images.size().1 as f32];
        let middle = middle_part(drawn, (texture.width(), texture.height()), KEEP);
        let part = [middle[0] * share[0], middle[1] * share[1], middle[2] * share[0], middle[3] * share[1]];
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let mut encoder = context.device().create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("mirror") });
        blit.encode(&context, &mut encoder, &sources[index], part, &view);
        images.give_back(index, &mut encoder);
        context.queue().submit([encoder.finish()]);
        self.drawn = true;
        Ok(())
    }

    /// Shows what was drawn, once the headset has its frame.
    pub fn show(&mut self) {
        if std::mem::take(&mut self.drawn) {
            self.frames += u64::from(self.window.show());
        }
    }
}

/// Draws one eye for the mirror, if there is one; a mirror that cannot be drawn is closed, and the headset goes on.
pub fn reflect(mirror: &mut Option<EyeMirror>, images: &Images, index: usize, drawn: (u32, u32)) {
    if let Some(Err(why)) = mirror.as_mut().map(|m| m.draw(images, index, drawn)) {
        tracing::warn!("no mirror of the headset: {why}");
        *mirror = None;
    }
}
