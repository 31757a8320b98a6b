//! Brings what both eyes see back from the headset's images.

use super::error::VrError;
use super::swapchain::Images;
use crate::gpu::readback::read_texture;
use crate::gpu::{Context, ViewPose, VisibilityMask};

/// What both eyes see of one frame.
#[derive(Clone, Debug)]
pub struct Capture {
    /// RGBA8, sRGB, rows from the top: left, right.
    pub eyes: Vec<Vec<u8>>,
    /// Width and height of what was drawn.
    pub size: (u32, u32),
    /// The eyes' views, model space.
    pub views: Vec<ViewPose>,
    /// What the lenses hide of them.
    pub masks: Vec<VisibilityMask>,
}

/// Reads the upper left `part` of both layers of an image that was drawn into and not yet released; the image is left as the
/// runtime wants it. Waits for the GPU.
pub fn capture(
    context: &Context,
    images: &Images,
    index: usize,
    part: (u32, u32),
    views: &[ViewPose; 2],
    masks: &[VisibilityMask],
) -> Result<Capture, VrError> {
    let texture = images.texture(index);
    let mut eyes = vec![read_texture(context, texture, 0)?, read_texture(context, texture, 1)?];
    for eye in &mut eyes {
        *eye = upper_left(std::mem::take(eye), images.size().0, part);
        if matches!(images.format(), wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Bgra8UnormSrgb) {
            eye.as_chunks_mut::<4>().0.iter_mut().for_each(|pixel| pixel.swap(0, 2));
        }
    }
    let mut encoder = context.device().create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("give back") });
    images.give_back(index, &mut encoder);
    context.queue().submit([encoder.finish()]);
    Ok(Capture { eyes, size: part, views: views.to_vec(), masks: masks.to_vec() })
}

/// The upper left part of a picture of four bytes a pixel and `width` pixels a row.
fn upper_left(pixels: Vec<u8>, width: u32, part: (u32, u32)) -> Vec<u8> {
    let (row, kept) = (4 * width as usize, 4 * part.0 as usize);
    if row == kept && pixels.len() == row * part.1 as usize {
        return pixels;
    }
    pixels.chunks_exact(row.max(1)).take(part.1 as usize).flat_map(|row| &row[..kept.min(row.len())]).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_upper_left_of_a_picture_is_cut_out() {
        let pixels: Vec<u8> = (0..3 * 2).flat_map(|i: u8| [i; 4]).collect();
        assert_eq!(upper_left(pixels.clone(), 3, (3, 2)), pixels);
        assert_eq!(upper_left(pixels, 3, (2, 1)), [[0; 4], [1; 4]].concat());
    }
}
