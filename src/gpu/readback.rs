//! Bringing data back from the GPU: pictures, and results for error checks. Never part of a steady frame.

use super::context::Context;
use super::error::GpuError;

/// Reads bytes of a buffer; waits for the GPU.
pub fn read_buffer(context: &Context, buffer: &wgpu::Buffer, offset: u64, bytes: u64) -> Result<Vec<u8>, GpuError> {
    if bytes == 0 {
        return Ok(Vec::new());
    }
    read(context, bytes, |encoder, staging| encoder.copy_buffer_to_buffer(buffer, offset, staging, 0, bytes))
}

/// Reads a layer of a picture of 4 bytes a pixel, rows from the top, without padding; waits for the GPU.
pub fn read_texture(context: &Context, texture: &wgpu::Texture, layer: u32) -> Result<Vec<u8>, GpuError> {
    let layers = texture.depth_or_array_layers();
    if layer >= layers {
        return Err(GpuError::BadTarget(format!("layer {layer} of {layers}")));
    }
    let size = wgpu::Extent3d { depth_or_array_layers: 1, ..texture.size() };
    let row = size.width * 4;
    let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let bytes = u64::from(padded) * u64::from(size.height);
    let all = read(context, bytes, |encoder, staging| {
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded), rows_per_image: None };
        let to = wgpu::TexelCopyBufferInfo { buffer: staging, layout };
        let origin = wgpu::Origin3d { x: 0, y: 0, z: layer };
        encoder.copy_texture_to_buffer(wgpu::TexelCopyTextureInfo { origin, ..texture.as_image_copy() }, to, size);
    })?;
    Ok(all.chunks_exact(padded as usize).flat_map(|r| &r[..row as usize]).copied().collect())
}

fn read(context: &Context, bytes: u64, copy: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::Buffer)) -> Result<Vec<u8>, GpuError> {
    let staging = context.device().create_buffer(&wgpu::BufferDescriptor {
        label: Some("read-back"),
        size: bytes,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = context.device().create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("read-back") });
    copy(&mut encoder, &staging);
    context.note_read_back();
    context.queue().submit([encoder.finish()]);
    let (sender, receiver) = std::sync::mpsc::channel();
    staging.map_async(wgpu::MapMode::Read, .., move |result| drop(sender.send(result)));
    context.wait()?;
    let lost = |e: &dyn std::fmt::Display| GpuError::Lost(e.to_string());
    receiver.recv().map_err(|e| lost(&e))?.map_err(|e| lost(&e))?;
    let data = staging.get_mapped_range(..).map_err(|e| lost(&e))?.to_vec();
    staging.unmap();
    Ok(data)
}
