//! Bringing data back from the GPU: pictures, and results for error checks. Never part of a steady frame.

use super::context::{Context, PATIENCE, hangs};
use super::error::GpuError;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Reads bytes of a buffer; waits for the GPU.
pub fn read_buffer(context: &Context, buffer: &wgpu::Buffer, offset: u64, bytes: u64) -> Result<Vec<u8>, GpuError> {
    if bytes == 0 {
        return Ok(Vec::new());
    }
    let copy = Copy::new(context, bytes, |encoder, staging| encoder.copy_buffer_to_buffer(buffer, offset, staging, 0, bytes));
    context.wait()?;
    copy.bytes(context)
}

/// Reads a layer of a picture of 4 bytes a pixel, rows from the top, without padding; waits for the GPU.
pub fn read_texture(context: &Context, texture: &wgpu::Texture, layer: u32) -> Result<Vec<u8>, GpuError> {
    let copy = PictureCopy::new(context, texture, layer)?;
    context.wait()?;
    copy.pixels(context)
}

/// A layer of a picture as it was when it was asked for, on its way back. A frame asks, and another thread takes it.
#[derive(Debug)]
pub struct PictureCopy {
    copy: Copy,
    /// Bytes a row that count, and with what fills them up.
    row: [usize; 2],
}

impl PictureCopy {
    /// Asks for a layer of a picture of 4 bytes a pixel, behind all that was submitted. Does not wait.
    pub fn new(context: &Context, texture: &wgpu::Texture, layer: u32) -> Result<Self, GpuError> {
        let layers = texture.depth_or_array_layers();
        if layer >= layers {
            return Err(GpuError::BadTarget(format!("layer {layer} of {layers}")));
        }
        let size = wgpu::Extent3d { depth_or_array_layers: 1, ..texture.size() };
        let row = size.width * 4;
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let copy = Copy::new(context, u64::from(padded) * u64::from(size.height), |encoder, staging| {
            let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded), rows_per_image: None };
            let to = wgpu::TexelCopyBufferInfo { buffer: staging, layout };
            let origin = wgpu::Origin3d { x: 0, y: 0, z: layer };
            encoder.copy_texture_to_buffer(wgpu::TexelCopyTextureInfo { origin, ..texture.as_image_copy() }, to, size);
        });
        Ok(Self { copy, row: [row, padded].map(|bytes| bytes as usize) })
    }

    /// The pixels, rows from the top, without padding. Waits until they are there, but in nobody's way: other threads go on submitting.
    pub fn pixels(self, context: &Context) -> Result<Vec<u8>, GpuError> {
        let [row, padded] = self.row;
        let all = self.copy.bytes(context)?;
        Ok(all.chunks_exact(padded).flat_map(|r| &r[..row]).copied().collect())
    }
}

/// How long to wait for a word of the GPU's before it is asked whether there is any.
const PAUSE: Duration = Duration::from_millis(1);

/// Bytes on their way back.
#[derive(Debug)]
struct Copy {
    staging: wgpu::Buffer,
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
}

impl Copy {
    fn new(context: &Context, bytes: u64, copy: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::Buffer)) -> Self {
        let staging = context.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("read-back"),
            size: bytes,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let label = wgpu::CommandEncoderDescriptor { label: Some("read-back") };
        let mut encoder = context.device().create_command_encoder(&label);
        copy(&mut encoder, &staging);
        context.note_read_back();
        context.queue().submit([encoder.finish()]);
        let (sender, mapped) = channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| drop(sender.send(result)));
        Self { staging, mapped }
    }

    /// The bytes, once they are there. Asks now and then: waiting in the driver would hold up who submits meanwhile.
    fn bytes(self, context: &Context) -> Result<Vec<u8>, GpuError> {
        let lost = |e: &dyn std::fmt::Display| GpuError::Lost(e.to_string());
        let asked = Instant::now();
        loop {
            match self.mapped.recv_timeout(PAUSE) {
                Ok(result) => break result.map_err(|e| lost(&e))?,
                Err(RecvTimeoutError::Timeout) if asked.elapsed() > PATIENCE => return Err(hangs(PATIENCE)),
                Err(RecvTimeoutError::Timeout) => context.look()?,
                Err(gone) => return Err(lost(&gone)),
            }
        }
        let data = self.staging.get_mapped_range(..).map_err(|e| lost(&e))?.to_vec();
        self.staging.unmap();
        Ok(data)
    }
}

#[cfg(test)]
mod tests {
    use super::super::context::ContextOptions;
    use super::*;

    #[test]
    fn a_picture_on_its_way_back_is_what_it_was_when_it_was_asked_for_and_nobody_has_waited() {
        let context = Context::headless(ContextOptions::default()).expect("an adapter");
        // rows that are not as long as those of a copy
        let size = wgpu::Extent3d { width: 5, height: 3, depth_or_array_layers: 2 };
        let texture = context.device().create_texture(&wgpu::TextureDescriptor {
            label: None,
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let paint = |first: u8| {
            let pixels: Vec<u8> = (0..2 * 4 * 5 * 3).map(|i| first.wrapping_add(i)).collect();
            let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(20), rows_per_image: Some(3) };
            context.queue().write_texture(texture.as_image_copy(), &pixels, layout, size);
            context.queue().submit([]);
            pixels
        };
        let before = paint(0);
        let copies = [0, 1].map(|layer| PictureCopy::new(&context, &texture, layer).expect("it has that layer"));
        assert!(copies[1].copy.mapped.try_recv().is_err(), "it is on its way");
        let after = paint(100);
        let there = std::thread::scope(|threads| {
            copies.map(|copy| threads.spawn(|| copy.pixels(&context).expect("read"))).map(|t| t.join().expect("no panic"))
        });
        assert_eq!(there.concat(), before);
        assert_eq!([0, 1].map(|layer| read_texture(&context, &texture, layer).expect("read")).concat(), after);
        assert!(PictureCopy::new(&context, &texture, 2).is_err());
    }
}
