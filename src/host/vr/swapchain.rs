//! The images that the headset shows: swapchains of two layers, an eye each, of colours and of depth.

use super::error::{Named, VrError};
use super::interop::{self, ImageShape};
use crate::gpu::context::DEPTH_FORMAT;
use crate::gpu::{ColourTarget, Context};
use openxr as xr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Formats by preference, as Vulkan numbers them and as wgpu names them: sRGB, so that blending and sampling are linear; where a
/// runtime has none, the shaders apply the curve.
const FORMATS: [(u32, wgpu::TextureFormat); 4] = [
    (43, wgpu::TextureFormat::Rgba8UnormSrgb),
    (50, wgpu::TextureFormat::Bgra8UnormSrgb),
    (37, wgpu::TextureFormat::Rgba8Unorm),
    (44, wgpu::TextureFormat::Bgra8Unorm),
];

/// D32_SFLOAT, as Vulkan numbers it: what our depth buffers are made of.
const DEPTH: u32 = 126;

/// How long to wait for the compositor to give an image back, nanoseconds. Longer is a hang, and an error is better than one; a
/// software compositor on a busy machine takes seconds.
const IMAGE_TIMEOUT: i64 = 60_000_000_000;

/// A swapchain and its images as render targets.
pub struct Images {
    targets: Vec<ColourTarget>,
    textures: Vec<wgpu::Texture>,
    swapchain: Arc<Mutex<xr::Swapchain<xr::Vulkan>>>,
    shape: ImageShape,
}

impl Images {
    /// Makes a swapchain of `layers` layers.
    pub fn new(
        session: &xr::Session<xr::Vulkan>,
        context: &Context,
        (width, height): (u32, u32),
        layers: u32,
    ) -> Result<Self, VrError> {
        let offered = session.enumerate_swapchain_formats().named("its picture formats")?;
        let (code, format) = choose(&offered)
            .ok_or_else(|| VrError::Graphics(format!("the runtime offers no 8-bit colour format, only {offered:?}")))?;
        let usage =
            xr::SwapchainUsageFlags::COLOR_ATTACHMENT | xr::SwapchainUsageFlags::SAMPLED | xr::SwapchainUsageFlags::TRANSFER_SRC;
        Self::make(session, context, (code, usage), ImageShape { width, height, layers, format })
    }

    /// Makes a swapchain for the depth of pictures; none where the runtime has no such format.
    pub fn depth(
        session: &xr::Session<xr::Vulkan>,
        context: &Context,
        (width, height): (u32, u32),
        layers: u32,
    ) -> Result<Option<Self>, VrError> {
        if !session.enumerate_swapchain_formats().named("its picture formats")?.contains(&DEPTH) {
            return Ok(None);
        }
        let usage = xr::SwapchainUsageFlags::DEPTH_STENCIL_ATTACHMENT | xr::SwapchainUsageFlags::SAMPLED;
        Self::make(session, context, (DEPTH, usage), ImageShape { width, height, layers, format: DEPTH_FORMAT }).map(Some)
    }

    fn make(
        session: &xr::Session<xr::Vulkan>,
        context: &Context,
        (format, usage_flags): (u32, xr::SwapchainUsageFlags),
        shape: ImageShape,
    ) -> Result<Self, VrError> {
        let info = xr::SwapchainCreateInfo {
            create_flags: xr::SwapchainCreateFlags::EMPTY,
            usage_flags,
            format,
            sample_count: 1,
            width: shape.width,
            height: shape.height,
            face_count: 1,
            array_size: shape.layers,
            mip_count: 1,
        };
        let swapchain = Arc::new(Mutex::new(session.create_swapchain(&info).named("a swapchain")?));
        let textures = interop::import_images(context, &swapchain, shape)?;
        let targets = textures.iter().map(|t| ColourTarget::of_texture(t, shape.format)).collect();
        Ok(Self { targets, textures, swapchain, shape })
    }

    /// Width and height of an eye, pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.shape.width, self.shape.height)
    }

    /// Format of the images.
    pub fn format(&self) -> wgpu::TextureFormat {
        self.shape.format
    }

    /// The next image to draw into, once the compositor is done with it.
    pub fn acquire(&self) -> Result<usize, VrError> {
        let mut swapchain = self.lock();
        let index = swapchain.acquire_image().named("an image")?;
        swapchain.wait_image(xr::Duration::from_nanos(IMAGE_TIMEOUT)).named("waiting for an image")?;
        Ok(index as usize)
    }

    /// Hands the image to the compositor.
    pub fn release(&self) -> Result<(), VrError> {
        self.lock().release_image().named("giving an image back")
    }

    /// How many images there are.
    pub fn len(&self) -> usize {
        self.textures.len()
    }

    /// Leaves an image that was read as the runtime wants it back: as a colour attachment.
    pub fn give_back(&self, index: usize, encoder: &mut wgpu::CommandEncoder) {
        let texture = &self.textures[index];
        let back = wgpu::TextureTransition { texture, selector: None, state: wgpu::TextureUses::COLOR_TARGET };
        encoder.transition_resources(std::iter::empty(), std::iter::once(back));
    }

    /// An image to draw into.
    pub fn target(&self, index: usize) -> &ColourTarget {
        &self.targets[index]
    }

    /// An image to copy from.
    pub fn texture(&self, index: usize) -> &wgpu::Texture {
        &self.textures[index]
    }

    /// The swapchain, for naming it in a layer.
    pub fn lock(&self) -> MutexGuard<'_, xr::Swapchain<xr::Vulkan>> {
        self.swapchain.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn choose(offered: &[u32]) -> Option<(u32, wgpu::TextureFormat)> {
    FORMATS.into_iter().find(|(code, _)| offered.contains(code))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_is_preferred_whatever_the_runtime_lists_first() {
        assert_eq!(choose(&[97, 37, 50]), Some((50, wgpu::TextureFormat::Bgra8UnormSrgb)));
        assert_eq!(choose(&[44, 43, 50]), Some((43, wgpu::TextureFormat::Rgba8UnormSrgb)));
        assert_eq!(choose(&[44]), Some((44, wgpu::TextureFormat::Bgra8Unorm)));
        assert_eq!(choose(&[97]), None);
    }
}
