//! The adapter, the device and the one queue. Made here without a window, or elsewhere (by an XR runtime, a window) and
//! handed over in parts.

use super::error::GpuError;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// Which adapter to look for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// A real GPU if there is one, else a software adapter.
    #[default]
    Best,
    /// A software adapter only: what golden pictures are made on.
    Software,
    /// A real GPU only.
    Hardware,
}

/// What [`Context::headless`] may be told.
#[derive(Clone, Copy, Debug, Default)]
pub struct ContextOptions {
    /// Which adapter to look for.
    pub adapter: AdapterChoice,
}

/// What kind of machine draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdapterKind {
    /// A card of its own.
    Discrete,
    /// Part of the processor.
    Integrated,
    /// Seen through a virtual machine.
    Virtual,
    /// The CPU plays GPU.
    Software,
    /// The driver does not say.
    Other,
}

/// An adapter with a device on it, and its one queue behind one mutex (an XR runtime submits on the same queue).
#[derive(Debug)]
pub struct Context {
    instance: wgpu::Instance,
    adapter: wgpu::Adapter,
    device: wgpu::Device,
    queue: Mutex<wgpu::Queue>,
    name: String,
    kind: AdapterKind,
    samples: u32,
    /// What the driver reported first, out of turn.
    failure: Arc<OnceLock<String>>,
}

/// Format of the pictures.
pub const COLOUR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;
/// Format of the depth buffers; reversed, 1 at the near plane, 0 at infinity.
pub const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

impl Context {
    /// Opens an adapter without a window. Errors: no adapter, limits too low, no device.
    pub fn headless(options: ContextOptions) -> Result<Self, GpuError> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
        descriptor.backends &= wgpu::Backends::PRIMARY;
        let instance = wgpu::Instance::new(descriptor);
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
        let adapter = best_adapter(adapters, options.adapter)?;
        let (device, queue) = open_device(&adapter)?;
        Ok(Self::from_parts(instance, adapter, device, queue))
    }

    /// Takes parts that others made. The device needs the limits of [`required_limits`].
    pub fn from_parts(instance: wgpu::Instance, adapter: wgpu::Adapter, device: wgpu::Device, queue: wgpu::Queue) -> Self {
        let info = adapter.get_info();
        let samples = sample_count(&adapter);
        let failure = watch(&device);
        Self { kind: kind_of(&info), name: info.name, instance, adapter, device, queue: Mutex::new(queue), samples, failure }
    }

    /// The instance.
    pub fn instance(&self) -> &wgpu::Instance {
        &self.instance
    }

    /// The adapter.
    pub fn adapter(&self) -> &wgpu::Adapter {
        &self.adapter
    }

    /// The device.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// The queue, for as long as the guard lives. Never hold it over a wait.
    pub fn queue(&self) -> MutexGuard<'_, wgpu::Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adapter name, as the driver gives it.
    pub fn adapter_name(&self) -> &str {
        &self.name
    }

    /// Adapter kind.
    pub fn adapter_kind(&self) -> AdapterKind {
        self.kind
    }

    /// Samples a pixel: 4 where colour and depth formats take it, else 1.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Waits until everything submitted so far has run.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| GpuError::Lost(e.to_string()))?;
        self.check()
    }

    /// Errors if the device was lost, ran out of memory, or refused a call.
    pub fn check(&self) -> Result<(), GpuError> {
        self.failure.get().map_or(Ok(()), |text| Err(GpuError::Lost(text.clone())))
    }
}

/// What our shaders need of an adapter: the WebGPU defaults, 8 storage buffers a stage among them.
pub fn required_limits() -> wgpu::Limits {
    wgpu::Limits::defaults()
}

/// Opens a device with [`required_limits`], and buffers and textures as large as the adapter has them.
pub fn open_device(adapter: &wgpu::Adapter) -> Result<(wgpu::Device, wgpu::Queue), GpuError> {
    let name = adapter.get_info().name;
    let has = adapter.limits();
    let mut limits = required_limits().using_resolution(has.clone());
    let mut missing = None;
    limits.check_limits_with_fail_fn(&has, false, |limit, needed, allowed| {
        missing.get_or_insert((limit, needed, allowed));
    });
    if let Some((limit, needed, allowed)) = missing {
        return Err(GpuError::MissingLimit { adapter: name, name: limit, needed, allowed });
    }
    limits.max_buffer_size = has.max_buffer_size;
    limits.max_storage_buffer_binding_size = has.max_storage_buffer_binding_size;
    let descriptor = wgpu::DeviceDescriptor { label: Some("incise"), required_limits: limits, ..Default::default() };
    pollster::block_on(adapter.request_device(&descriptor)).map_err(|source| GpuError::Device { adapter: name, source })
}

/// Notes the first error that comes outside a call's own result; by itself wgpu would end the program.
fn watch(device: &wgpu::Device) -> Arc<OnceLock<String>> {
    let failure = Arc::new(OnceLock::new());
    let note = Arc::clone(&failure);
    device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| drop(note.set(error.to_string()))));
    let note = Arc::clone(&failure);
    device.set_device_lost_callback(move |reason, text| {
        if reason != wgpu::DeviceLostReason::Destroyed {
            drop(note.set(text));
        }
    });
    failure
}

fn best_adapter(adapters: Vec<wgpu::Adapter>, choice: AdapterChoice) -> Result<wgpu::Adapter, GpuError> {
    let rank = |adapter: &wgpu::Adapter| match kind_of(&adapter.get_info()) {
        AdapterKind::Discrete => 0,
        AdapterKind::Integrated => 1,
        AdapterKind::Virtual => 2,
        AdapterKind::Other => 3,
        AdapterKind::Software => 4,
    };
    let wanted = |adapter: &wgpu::Adapter| match choice {
        AdapterChoice::Best => true,
        AdapterChoice::Software => rank(adapter) == 4,
        AdapterChoice::Hardware => rank(adapter) != 4,
    };
    let what = match choice {
        AdapterChoice::Best => "graphics adapter",
        AdapterChoice::Software => "software graphics adapter",
        AdapterChoice::Hardware => "graphics card",
    };
    // `min_by_key` keeps the first of equals: the driver's own order decides.
    adapters.into_iter().filter(wanted).min_by_key(rank).ok_or(GpuError::NoAdapter { wanted: what })
}

fn kind_of(info: &wgpu::AdapterInfo) -> AdapterKind {
    match info.device_type {
        wgpu::DeviceType::DiscreteGpu => AdapterKind::Discrete,
        wgpu::DeviceType::IntegratedGpu => AdapterKind::Integrated,
        wgpu::DeviceType::VirtualGpu => AdapterKind::Virtual,
        wgpu::DeviceType::Cpu => AdapterKind::Software,
        wgpu::DeviceType::Other => AdapterKind::Other,
    }
}

fn sample_count(adapter: &wgpu::Adapter) -> u32 {
    let four = |format| adapter.get_texture_format_features(format).flags.sample_count_supported(4);
    if four(COLOUR_FORMAT) && four(DEPTH_FORMAT) { 4 } else { 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_adapter_names_the_package() {
        let text = best_adapter(Vec::new(), AdapterChoice::Best).unwrap_err().to_string();
        assert!(text.contains("mesa-vulkan-drivers") && text.contains("libvulkan1"), "{text}");
    }
}
