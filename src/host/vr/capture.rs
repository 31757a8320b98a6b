//! Brings what the eyes see back from the headset's images.

use super::error::VrError;
use super::swapchain::Images;
use crate::gpu::readback::{PictureCopy, read_texture};
use crate::gpu::{Context, ViewPose, VisibilityMask};
use crate::host::writer::Encode;
use std::sync::Arc;

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

/// Reads the upper left `part` of both layers of an image that was drawn into and not yet released. Waits for the GPU: for runs that are
/// looked at afterwards.
pub fn capture(
    context: &Context,
    images: &Images,
    index: usize,
    part: (u32, u32),
    views: &[ViewPose; 2],
    masks: &[VisibilityMask],
) -> Result<Capture, VrError> {
    let eye =
        |layer| read_texture(context, images.texture(index), layer).map(|p| seen(p, images.size().0, part, images.format()));
    let eyes = vec![eye(0)?, eye(1)?];
    give_back(context, images, index);
    Ok(Capture { eyes, size: part, views: views.to_vec(), masks: masks.to_vec() })
}

/// What the left eye sees of one frame, on its way back.
pub struct LeftEye {
    /// Width and height of what was drawn.
    pub size: (u32, u32),
    /// Its pixels, RGBA8, sRGB, rows from the top: for a thread that may wait.
    pub pixels: Encode,
}

/// Asks for the upper left `part` of the first layer of an image that was drawn into and not yet released. Does not wait.
pub fn left_eye(context: &Arc<Context>, images: &Images, index: usize, size: (u32, u32)) -> Result<LeftEye, VrError> {
    let copy = PictureCopy::new(context, images.texture(index), 0)?;
    give_back(context, images, index);
    let (context, width, format) = (context.clone(), images.size().0, images.format());
    let pixels = Box::new(move || {
        let pixels = copy.pixels(&context).map_err(|e| e.to_string())?;
        Ok(seen(pixels, width, size, format))
    });
    Ok(LeftEye { size, pixels })
}

/// Leaves an image that was read as the runtime wants it.
fn give_back(context: &Context, images: &Images, index: usize) {
    let mut encoder = context.device().create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("give back") });
    images.give_back(index, &mut encoder);
    context.queue().submit([encoder.finish()]);
}

/// What was drawn of an image `width` pixels wide, as RGBA8.
fn seen(pixels: Vec<u8>, width: u32, part: (u32, u32), format: wgpu::TextureFormat) -> Vec<u8> {
    let mut pixels = upper_left(pixels, width, part);
    if matches!(format, wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Bgra8UnormSrgb) {
        pixels.as_chunks_mut::<4>().0.iter_mut().for_each(|pixel| pixel.swap(0, 2));
    }
    pixels
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

    #[test]
    fn whatever_the_order_of_an_image_is_a_picture_is_red_green_blue() {
        let blue_first = vec![3, 2, 1, 4];
        assert_eq!(seen(blue_first.clone(), 1, (1, 1), wgpu::TextureFormat::Bgra8UnormSrgb), [1, 2, 3, 4]);
        assert_eq!(seen(blue_first, 1, (1, 1), wgpu::TextureFormat::Rgba8Unorm), [3, 2, 1, 4]);
    }
}
