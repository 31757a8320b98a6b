//! The adapter, the device and the one queue. Made here without a window, or elsewhere (by an XR runtime, a window) and
//! handed over in parts.

use super::error::GpuError;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

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
    /// Leaves out everything that we can do without (multiview, timestamps, half the storage buffers of a shader), as on an
    /// adapter that lacks it.
    pub plain: bool,
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
    /// What the driver reported first, out of turn.
    failure: Arc<OnceLock<String>>,
    deforms: bool,
    pipelines: AtomicU64,
    read_backs: AtomicU64,
    /// [`Context::samples_of`] as far as it was asked: the driver takes its time to answer.
    samples: Mutex<Vec<(wgpu::TextureFormat, u32)>>,
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
        let instance = headless_instance(descriptor);
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
        let adapter = best_adapter(adapters, options.adapter)?;
        let mut descriptor = device_descriptor(&adapter)?;
        if options.plain {
            descriptor.required_features = wgpu::Features::empty();
            descriptor.required_limits.max_multiview_view_count = 0;
            descriptor.required_limits.max_storage_buffers_per_shader_stage = FEWEST_STORAGE_BUFFERS;
        }
        let (device, queue) = request(&adapter, &descriptor)?;
        Ok(Self::from_parts(instance, adapter, device, queue))
    }

    /// Takes parts that others made. The device needs the limits of [`required_limits`].
    pub fn from_parts(instance: wgpu::Instance, adapter: wgpu::Adapter, device: wgpu::Device, queue: wgpu::Queue) -> Self {
        let info = adapter.get_info();
        let failure = watch(&device);
        let queue = Mutex::new(queue);
        let deforms = device.limits().max_storage_buffers_per_shader_stage >= DEFORM_STORAGE_BUFFERS;
        Self {
            kind: kind_of(&info),
            name: info.name,
            instance,
            adapter,
            device,
            queue,
            failure,
            deforms,
            pipelines: AtomicU64::new(0),
            read_backs: AtomicU64::new(0),
            samples: Mutex::default(),
        }
    }

    /// Another device on the same adapter, after this one was lost. Errors: the adapter is gone too.
    pub fn reopen(&self) -> Result<Self, GpuError> {
        let mut descriptor = device_descriptor(&self.adapter)?;
        descriptor.required_features &= self.device.features();
        let limits = self.device.limits();
        descriptor.required_limits.max_multiview_view_count = limits.max_multiview_view_count;
        descriptor.required_limits.max_storage_buffers_per_shader_stage = limits.max_storage_buffers_per_shader_stage;
        let (device, queue) = request(&self.adapter, &descriptor)?;
        Ok(Self::from_parts(self.instance.clone(), self.adapter.clone(), device, queue))
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

    /// Pipelines compiled on this device so far.
    pub fn pipelines_made(&self) -> u64 {
        self.pipelines.load(Ordering::Relaxed)
    }

    /// Counts a pipeline that was compiled.
    pub(crate) fn note_pipeline(&self) {
        self.pipelines.fetch_add(1, Ordering::Relaxed);
    }

    /// Times that something was brought back from the GPU so far. (Pass times, where they are asked for, come back without a wait and
    /// are not counted.)
    pub fn read_backs(&self) -> u64 {
        self.read_backs.load(Ordering::Relaxed)
    }

    /// Counts a read-back.
    pub(crate) fn note_read_back(&self) {
        self.read_backs.fetch_add(1, Ordering::Relaxed);
    }

    /// True if shaders may read enough buffers for the deform pass; else the CPU deforms ([`super::cpu_deform`]).
    pub fn deforms(&self) -> bool {
        self.deforms
    }

    /// Samples a pixel of our own pictures: 4 where the adapter has them, else 1.
    pub fn samples(&self) -> u32 {
        self.samples_of(COLOUR_FORMAT)
    }

    /// Samples a pixel of pictures of a colour format: 4 where colour and depth formats take it, else 1.
    pub fn samples_of(&self, format: wgpu::TextureFormat) -> u32 {
        let mut known = self.samples.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(&(_, samples)) = known.iter().find(|k| k.0 == format) {
            return samples;
        }
        let samples = self.ask_samples_of(format);
        known.push((format, samples));
        samples
    }

    fn ask_samples_of(&self, format: wgpu::TextureFormat) -> u32 {
        let four = |format: wgpu::TextureFormat| {
            let promised = format.guaranteed_format_features(self.device.features()).flags;
            let has = self.adapter.get_texture_format_features(format).flags;
            promised.sample_count_supported(4) && has.sample_count_supported(4)
        };
        let resolves = |format: wgpu::TextureFormat| {
            let promised = format.guaranteed_format_features(self.device.features()).flags;
            promised.contains(wgpu::TextureFormatFeatureFlags::MULTISAMPLE_RESOLVE)
        };
        if four(format) && four(DEPTH_FORMAT) && resolves(format) { 4 } else { 1 }
    }

    /// True if one pass can draw this many views, each into its layer.
    pub fn draws_views_at_once(&self, views: u32, samples: u32) -> bool {
        let features = self.device.features();
        views <= self.device.limits().max_multiview_view_count
            && features.contains(wgpu::Features::MULTIVIEW)
            && (samples == 1 || features.contains(wgpu::Features::MULTISAMPLE_ARRAY))
    }

    /// True if it should, where it can. Mesa 22's software driver draws what is clipped into the first layer, whichever view it
    /// belongs to, and a pass each costs the CPU no more.
    pub fn prefers_views_at_once(&self) -> bool {
        self.kind != AdapterKind::Software
    }

    /// True if a pass may resolve its samples into any layer of a texture. Mesa 22's software driver always takes the first.
    pub fn resolves_into_layers(&self) -> bool {
        self.kind != AdapterKind::Software
    }

    /// Waits until everything submitted so far has run. Errors: as [`Context::check`], and a GPU that has not come to an end within
    /// [`PATIENCE`]: one that hangs, which its driver does not tell.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.wait_for(PATIENCE)
    }

    fn wait_for(&self, patience: Duration) -> Result<(), GpuError> {
        let wait = wgpu::PollType::Wait { submission_index: None, timeout: Some(patience) };
        self.device.poll(wait).map_err(|e| match e {
            wgpu::PollError::Timeout => hangs(patience),
            other => GpuError::Lost(other.to_string()),
        })?;
        self.check()
    }

    /// Takes in what has run meanwhile, without waiting.
    pub fn look(&self) -> Result<(), GpuError> {
        self.device.poll(wgpu::PollType::Poll).map_err(|e| GpuError::Lost(e.to_string()))?;
        self.check()
    }

    /// Errors if the device was lost, ran out of memory, or refused a call.
    pub fn check(&self) -> Result<(), GpuError> {
        self.failure.get().map_or(Ok(()), |text| Err(GpuError::Lost(text.clone())))
    }
}

/// The longest that anything submitted may take: software adapters draw large pictures of large models in less.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// What a GPU is called that has not come to an end.
pub(crate) fn hangs(patience: Duration) -> GpuError {
    GpuError::Lost(format!("it has not finished what it was given {} seconds ago", patience.as_secs()))
}

/// One for the whole process: NVIDIA's driver is no longer found where a process has let it go and loaded it a dozen times.
fn headless_instance(descriptor: wgpu::InstanceDescriptor) -> wgpu::Instance {
    static INSTANCE: OnceLock<wgpu::Instance> = OnceLock::new();
    INSTANCE.get_or_init(|| wgpu::Instance::new(descriptor)).clone()
}

/// Storage buffers that the normals shader reads and writes; those of the deform shader are fewer.
const DEFORM_STORAGE_BUFFERS: u32 = 8;
/// What drawing needs a stage, and what every Vulkan adapter has.
const FEWEST_STORAGE_BUFFERS: u32 = 4;

/// What we cannot do without: the WebGPU defaults, but for storage buffers, of which drawing needs half as many a stage.
pub fn required_limits() -> wgpu::Limits {
    wgpu::Limits { max_storage_buffers_per_shader_stage: FEWEST_STORAGE_BUFFERS, ..wgpu::Limits::defaults() }
}

/// What is used where an adapter has it: stereo in one pass, and times on the GPU.
pub fn wanted_features() -> wgpu::Features {
    wgpu::Features::MULTIVIEW | wgpu::Features::MULTISAMPLE_ARRAY | wgpu::Features::TIMESTAMP_QUERY
}

/// The device that we want of an adapter: [`required_limits`], buffers and textures as large as it has them, and what it has of
/// [`wanted_features`]. For those who make the device themselves, too. Errors: limits too low.
pub fn device_descriptor(adapter: &wgpu::Adapter) -> Result<wgpu::DeviceDescriptor<'static>, GpuError> {
    let has = adapter.limits();
    let mut limits = required_limits().using_resolution(has.clone());
    let mut missing = None;
    limits.check_limits_with_fail_fn(&has, false, |limit, needed, allowed| {
        missing.get_or_insert((limit, needed, allowed));
    });
    if let Some((limit, needed, allowed)) = missing {
        return Err(GpuError::MissingLimit { adapter: adapter.get_info().name, name: limit, needed, allowed });
    }
    limits.max_buffer_size = has.max_buffer_size;
    limits.max_storage_buffer_binding_size = has.max_storage_buffer_binding_size;
    limits.max_multiview_view_count = has.max_multiview_view_count;
    limits.max_storage_buffers_per_shader_stage = has.max_storage_buffers_per_shader_stage.min(DEFORM_STORAGE_BUFFERS);
    Ok(wgpu::DeviceDescriptor {
        label: Some("incise"),
        required_features: adapter.features() & wanted_features(),
        required_limits: limits,
        ..Default::default()
    })
}

/// Opens a device as [`device_descriptor`] has it.
pub fn open_device(adapter: &wgpu::Adapter) -> Result<(wgpu::Device, wgpu::Queue), GpuError> {
    request(adapter, &device_descriptor(adapter)?)
}

fn request(adapter: &wgpu::Adapter, descriptor: &wgpu::DeviceDescriptor<'_>) -> Result<(wgpu::Device, wgpu::Queue), GpuError> {
    pollster::block_on(adapter.request_device(descriptor))
        .map_err(|source| GpuError::Device { adapter: adapter.get_info().name, source })
}

/// Notes the first error that comes outside a call's own result; by itself wgpu would end the program.
fn watch(device: &wgpu::Device) -> Arc<OnceLock<String>> {
    let failure = Arc::new(OnceLock::new());
    let note = Arc::clone(&failure);
    device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| drop(note.set(error.to_string()))));
    let note = Arc::clone(&failure);
    device.set_device_lost_callback(move |reason, text| {
        let text = if reason == wgpu::DeviceLostReason::Destroyed { "it was given up".into() } else { text };
        drop(note.set(text));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_adapter_names_the_package() {
        let text = best_adapter(Vec::new(), AdapterChoice::Best).unwrap_err().to_string();
        assert!(text.contains("mesa-vulkan-drivers") && text.contains("libvulkan1"), "{text}");
    }

    /// Counts for a good part of a second.
    const SLOW: &str = "
        @group(0) @binding(0) var<storage, read_write> sum: array<u32>;
        @compute @workgroup_size(1)
        fn count(@builtin(global_invocation_id) id: vec3u) {
            for (var i = 0u; i < 100000000u; i++) { sum[id.x] = sum[id.x] * 1664525u + i; }
        }";

    #[test]
    fn a_gpu_that_does_not_come_to_an_end_is_not_waited_for_for_ever() {
        let context = Context::headless(ContextOptions { adapter: AdapterChoice::Software, plain: false });
        let Ok(context) = context else { return };
        let device = context.device();
        let source = wgpu::ShaderSource::Wgsl(SLOW.into());
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            cache: None,
        });
        let usage = wgpu::BufferUsages::STORAGE;
        let buffer = device.create_buffer(&wgpu::BufferDescriptor { label: None, size: 4, usage, mapped_at_creation: false });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
        });
        // on a busy machine this thread may come back to it only when the work is done: then it was too little
        let waited = [1, 8, 64].into_iter().find_map(|workgroups| {
            let mut encoder = device.create_command_encoder(&Default::default());
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(workgroups, 1, 1);
            drop(pass);
            context.queue().submit([encoder.finish()]);
            context.wait_for(Duration::from_millis(1)).err()
        });
        let text = waited.expect("it is not done in a millisecond").to_string();
        assert!(text.contains("stopped answering") && text.contains("has not finished"), "{text}");
        // it was merely slow
        context.wait().expect("done");
    }
}
