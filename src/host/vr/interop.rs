//! Where OpenXR and wgpu meet: the only file with `unsafe` in it. The runtime makes the Vulkan instance and device
//! (XR_KHR_vulkan_enable2) from what wgpu asks for, wgpu-hal takes them over, and the runtime's images become textures.

#![allow(unsafe_code)]

use super::error::{Named, VrError, VrUnavailable};
use crate::gpu::GpuError;
use crate::gpu::context::{Context, required_limits, wanted_features};
use ash::vk::{self, Handle};
use openxr as xr;
use std::ffi::CStr;
use std::marker::PhantomData;
use std::sync::{Arc, Mutex};
use wgpu::hal::{self, api::Vulkan};

/// The version that wgpu-hal itself asks for: it chooses code paths by what the device was made with.
const VULKAN_VERSION: u32 = vk::API_VERSION_1_3;
/// wgpu-hal uses the first queue of the first family too.
const QUEUE_FAMILY: u32 = 0;

/// Names the loader's library where it is not where the system looks.
const LOADER_VARIABLE: &str = "INCISE_OPENXR_LOADER";

/// The OpenXR loader: the file that INCISE_OPENXR_LOADER names, else the built-in one, else the system's.
pub fn load_entry() -> Result<xr::Entry, VrUnavailable> {
    if let Some(file) = std::env::var_os(LOADER_VARIABLE) {
        let said = |e| VrUnavailable::NamedNoLoader(format!("{LOADER_VARIABLE}={}: {e}", file.to_string_lossy()));
        // SAFETY: the user says that this file is an OpenXR loader.
        return unsafe { xr::Entry::load_from(file.as_ref(), &()) }.map_err(said);
    }
    #[cfg(feature = "static-loader")]
    return xr::Entry::linked(&()).map_err(|e| VrUnavailable::NoLoader(e.to_string()));
    // SAFETY: a library of this name is the OpenXR loader, as the specification defines it; there is no other way to get at a
    // runtime, and nothing to check it by.
    #[cfg(not(feature = "static-loader"))]
    return unsafe { xr::Entry::load(&()) }.map_err(|e| VrUnavailable::NoLoader(e.to_string()));
}

/// A device that the runtime made, as wgpu knows it and as the runtime does.
pub struct Graphics {
    /// Ready for the renderer.
    pub context: Arc<Context>,
    instance: vk::Instance,
    physical: vk::PhysicalDevice,
    device: vk::Device,
}

/// Makes the Vulkan instance and device that the headset's pictures are drawn with. `system` must belong to `runtime`.
pub fn open_graphics(runtime: &xr::Instance, system: xr::SystemId) -> Result<Graphics, VrError> {
    let said = |what: &str, why: &dyn std::fmt::Display| VrError::Graphics(format!("{what}: {why}"));
    // The runtime wants to be asked before anything else; the answer's lowest version is below ours on every runtime.
    runtime.graphics_requirements::<xr::Vulkan>(system).named("its Vulkan requirements")?;
    // SAFETY: as for the OpenXR loader: a library of this name is the Vulkan loader.
    let entry = unsafe { ash::Entry::load() }.map_err(|e| said("no Vulkan loader", &e))?;
    let proc_address = entry.static_fn().get_instance_proc_addr;
    // SAFETY: both are vkGetInstanceProcAddr's type, declared by two crates.
    let proc_address: xr::sys::platform::VkGetInstanceProcAddr = unsafe { std::mem::transmute(proc_address) };

    let flags = wgpu::InstanceFlags::empty();
    let extensions = hal::vulkan::Instance::desired_extensions(&entry, VULKAN_VERSION, flags).map_err(|e| said("Vulkan", &e))?;
    let names: Vec<_> = extensions.iter().map(|e| e.as_ptr()).collect();
    let application = vk::ApplicationInfo::default().application_name(c"Incise").engine_name(c"wgpu").api_version(VULKAN_VERSION);
    let info = vk::InstanceCreateInfo::default().application_info(&application).enabled_extension_names(&names);
    // SAFETY: `info` and all it points to live until the call returns; the loader's function is a valid one.
    let raw = unsafe { runtime.create_vulkan_instance(system, proc_address, (&raw const info).cast()) };
    let raw = raw.named("a Vulkan instance")?.map_err(|code| said("vkCreateInstance", &vk::Result::from_raw(code)))?;
    // SAFETY: the runtime made `raw` with the loader behind `entry`, and nobody else owns it.
    let ash_instance = unsafe { ash::Instance::load(entry.static_fn(), vk::Instance::from_raw(raw as usize as u64)) };
    let instance = ash_instance.handle();
    // SAFETY: made just now with exactly these extensions and this version; without a drop callback wgpu owns and destroys it.
    let hal_instance = unsafe {
        hal::vulkan::Instance::from_raw(
            entry,
            ash_instance.clone(),
            VULKAN_VERSION,
            0,
            None,
            extensions,
            flags,
            wgpu::MemoryBudgetThresholds::default(),
            false,
            None,
        )
    }
    .map_err(|e| said("Vulkan instance", &e))?;

    // SAFETY: the instance is the one that the runtime has just made.
    let physical = unsafe { runtime.vulkan_graphics_device(system, instance.as_raw() as usize as *const _) };
    let physical = vk::PhysicalDevice::from_raw(physical.named("the headset's graphics card")? as usize as u64);
    let exposed = hal_instance.expose_adapter(physical);
    let exposed = exposed.ok_or_else(|| said("the headset's graphics card", &"it lacks what wgpu needs"))?;
    let features = exposed.features & wanted_features();
    let limits = exposed.capabilities.limits.clone();
    check_limits(&exposed.info.name, &limits)?;

    let extensions: Vec<&'static CStr> = exposed.adapter.required_device_extensions(features);
    let names: Vec<_> = extensions.iter().map(|e| e.as_ptr()).collect();
    let mut physical_features = exposed.adapter.physical_device_features(&extensions, features);
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(QUEUE_FAMILY).queue_priorities(&[1.0])];
    let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_extension_names(&names);
    let info = physical_features.add_to_device_create(info);
    // SAFETY: `info` and all it points to live until the call returns; the physical device is of the runtime's instance.
    let raw = unsafe {
        runtime.create_vulkan_device(system, proc_address, physical.as_raw() as usize as *const _, (&raw const info).cast())
    };
    let raw = raw.named("a Vulkan device")?.map_err(|code| said("vkCreateDevice", &vk::Result::from_raw(code)))?;
    // SAFETY: the runtime made `raw` from this instance, and nobody else owns it.
    let ash_device = unsafe { ash::Device::load(ash_instance.fp_v1_0(), vk::Device::from_raw(raw as usize as u64)) };
    let device = ash_device.handle();
    let hints = wgpu::MemoryHints::Performance;
    // SAFETY: made with exactly these extensions, features and queue family; without a drop callback wgpu owns it.
    let open =
        unsafe { exposed.adapter.device_from_raw(ash_device, None, &extensions, features, &limits, &hints, QUEUE_FAMILY, 0) }
            .map_err(|e| said("Vulkan device", &e))?;

    // SAFETY: the hal objects above belong together and are handed over once.
    let (wgpu_instance, adapter, made) = unsafe {
        let wgpu_instance = wgpu::Instance::from_hal::<Vulkan>(hal_instance);
        let adapter = wgpu_instance.create_adapter_from_hal::<Vulkan>(exposed);
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("headset"),
            required_features: features,
            required_limits: limits,
            memory_hints: hints,
            ..Default::default()
        };
        let made = adapter.create_device_from_hal::<Vulkan>(open, &descriptor);
        (wgpu_instance, adapter, made)
    };
    let (wgpu_device, queue) = made.map_err(|e| said("device", &e))?;
    let context = Arc::new(Context::from_parts(wgpu_instance, adapter, wgpu_device, queue));
    Ok(Graphics { context, instance, physical, device })
}

fn check_limits(adapter: &str, has: &wgpu::Limits) -> Result<(), GpuError> {
    let mut missing = None;
    required_limits().using_resolution(has.clone()).check_limits_with_fail_fn(has, false, |name, needed, allowed| {
        missing.get_or_insert((name, needed, allowed));
    });
    match missing {
        Some((name, needed, allowed)) => Err(GpuError::MissingLimit { adapter: adapter.to_owned(), name, needed, allowed }),
        None => Ok(()),
    }
}

/// A session with its two halves of the frame loop.
pub type SessionParts = (xr::Session<xr::Vulkan>, xr::FrameWaiter, xr::FrameStream<xr::Vulkan>);

/// Makes a session that draws with `graphics`.
pub fn create_session(runtime: &xr::Instance, system: xr::SystemId, graphics: &Graphics) -> Result<SessionParts, VrError> {
    let info = xr::vulkan::SessionCreateInfo {
        instance: graphics.instance.as_raw() as usize as *const _,
        physical_device: graphics.physical.as_raw() as usize as *const _,
        device: graphics.device.as_raw() as usize as *const _,
        queue_family_index: QUEUE_FAMILY,
        queue_index: 0,
    };
    // The guard keeps the device alive until the runtime has destroyed the session, whoever drops what first.
    let guard = Box::new(graphics.context.clone());
    // SAFETY: the handles are those the runtime itself made in `open_graphics`, alive as long as the guard; the queue is used
    // by one thread only, ours, which also makes the runtime's calls that submit to it.
    unsafe { runtime.create_session_with_guard::<xr::Vulkan>(system, &info, guard) }.named("a session")
}

/// The shape of a swapchain's images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageShape {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Array layers: an eye each.
    pub layers: u32,
    /// As wgpu names it; the runtime's own format must be the same.
    pub format: wgpu::TextureFormat,
}

/// The runtime's images as textures, in the runtime's order. Each holds on to the swapchain.
pub fn import_images(
    context: &Context,
    swapchain: &Arc<Mutex<xr::Swapchain<xr::Vulkan>>>,
    shape: ImageShape,
) -> Result<Vec<wgpu::Texture>, VrError> {
    let images = swapchain.lock().unwrap_or_else(std::sync::PoisonError::into_inner).enumerate_images();
    let size = wgpu::Extent3d { width: shape.width, height: shape.height, depth_or_array_layers: shape.layers };
    let (uses, usage) = if shape.format.is_depth_stencil_format() {
        (wgpu::TextureUses::DEPTH_STENCIL_WRITE, wgpu::TextureUsages::RENDER_ATTACHMENT)
    } else {
        (
            wgpu::TextureUses::COLOR_TARGET | wgpu::TextureUses::COPY_SRC | wgpu::TextureUses::RESOURCE,
            wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::TEXTURE_BINDING,
        )
    };
    let mut textures = Vec::new();
    for image in images.named("the images of a swapchain")? {
        let keep = swapchain.clone();
        let device = context.device();
        let descriptor = hal::TextureDescriptor {
            label: None, // a name would need VK_EXT_debug_utils
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: shape.format,
            usage: uses,
            memory_flags: hal::MemoryFlags::empty(),
            view_formats: Vec::new(),
        };
        // SAFETY: the image is of this device and has this shape, format and usage (`swapchain.rs` asked for them). The drop
        // callback says that wgpu must not destroy it, and keeps the swapchain, its owner, alive meanwhile.
        let texture = unsafe {
            let Some(hal_device) = device.as_hal::<Vulkan>() else {
                return Err(VrError::Graphics("the device is not Vulkan's".into()));
            };
            hal_device.texture_from_raw(
                vk::Image::from_raw(image),
                &descriptor,
                Some(Box::new(move || drop(keep))),
                hal::vulkan::TextureMemory::External,
            )
        };
        let descriptor = wgpu::TextureDescriptor {
            label: Some("headset"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: shape.format,
            usage,
            view_formats: &[],
        };
        // SAFETY: the same image, described alike. Every frame clears it before anything reads it, so its first state is free.
        textures
            .push(unsafe { device.create_texture_from_hal::<Vulkan>(texture, &descriptor, wgpu::TextureUses::UNINITIALIZED) });
    }
    Ok(textures)
}

/// Depth of one eye's picture, for the compositor (XR_KHR_composition_layer_depth).
pub struct EyeDepth<'a> {
    info: xr::sys::CompositionLayerDepthInfoKHR,
    _images: PhantomData<&'a xr::Swapchain<xr::Vulkan>>,
}

impl<'a> EyeDepth<'a> {
    /// Reversed depth with an infinite far plane, as our shaders write it: 1 at `near` metres, 0 at infinity.
    pub fn new(images: &'a xr::Swapchain<xr::Vulkan>, layer: u32, rect: xr::Rect2Di, near: f32) -> Self {
        let sub_image = xr::sys::SwapchainSubImage { swapchain: images.as_raw(), image_rect: rect, image_array_index: layer };
        let info = xr::sys::CompositionLayerDepthInfoKHR {
            ty: xr::sys::StructureType::COMPOSITION_LAYER_DEPTH_INFO_KHR,
            next: std::ptr::null(),
            sub_image,
            min_depth: 0.0,
            max_depth: 1.0,
            near_z: f32::MAX, // of depth 0: infinity, where some compositors want a number
            far_z: near,
        };
        Self { info, _images: PhantomData }
    }

    /// An eye's view with this depth.
    pub fn of<'v>(
        &'v self,
        view: xr::CompositionLayerProjectionView<'v, xr::Vulkan>,
    ) -> xr::CompositionLayerProjectionView<'v, xr::Vulkan> {
        let mut raw = view.into_raw();
        raw.next = (&raw const self.info).cast();
        // SAFETY: the view keeps the lifetime of what it named, and what it names now, `self` and its swapchain, lives as long.
        unsafe { xr::CompositionLayerProjectionView::from_raw(raw) }
    }
}
