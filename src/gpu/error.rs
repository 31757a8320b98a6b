//! What can go wrong between us and a graphics adapter.

/// An error of the GPU layer. Every text says what to do about it.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// No adapter of the wanted kind.
    #[error(
        "no {wanted} was found. Install a Vulkan driver: `apt-get install mesa-vulkan-drivers libvulkan1` on Debian or \
         Ubuntu brings a software one; a graphics card needs its vendor's driver"
    )]
    NoAdapter {
        /// What was looked for.
        wanted: &'static str,
    },
    /// The adapter is there but falls short of what the shaders need.
    #[error(
        "the adapter \"{adapter}\" cannot run Incise: it offers {name} = {allowed}, {needed} are needed; use another adapter"
    )]
    MissingLimit {
        /// Adapter name.
        adapter: String,
        /// The limit, as wgpu names it.
        name: &'static str,
        /// What we need.
        needed: u64,
        /// What it has.
        allowed: u64,
    },
    /// The driver refused to make a device.
    #[error("the adapter \"{adapter}\" gave no device: {source}; update its driver or use another adapter")]
    Device {
        /// Adapter name.
        adapter: String,
        /// The driver's words.
        source: wgpu::RequestDeviceError,
    },
    /// A model does not fit into one buffer of this adapter.
    #[error(
        "{what} would take {needed_bytes} bytes on the GPU, and this adapter's buffers end at {limit_bytes}; simplify the model"
    )]
    TooLarge {
        /// Which data.
        what: &'static str,
        /// Bytes asked for.
        needed_bytes: u64,
        /// Bytes there are.
        limit_bytes: u64,
    },
    /// More tissues than the shaders can tell apart.
    #[error("{most} pieces are the most that this adapter draws; undo a cut")]
    TooManyTissues {
        /// Most tissues.
        most: usize,
    },
    /// A view's slices do not fit together.
    #[error("a tissue handed to the GPU is inconsistent: {0}")]
    BadView(String),
    /// A picture of no pixels, or of more than the adapter can hold.
    #[error("a picture of {width} x {height} pixels cannot be drawn; the sides must be 1 to {limit}")]
    BadSize {
        /// Width asked for.
        width: u32,
        /// Height asked for.
        height: u32,
        /// Largest side.
        limit: u32,
    },
    /// No view, or more than one call takes.
    #[error("{views} views were asked for; one call draws 1 to {most}, call again for more")]
    BadViews {
        /// Views asked for.
        views: usize,
        /// Most views.
        most: usize,
    },
    /// A target that does not fit the views, or the pictures drawn before.
    #[error("the target does not fit: {0}")]
    BadTarget(String),
    /// A camera that looks nowhere.
    #[error("the camera is degenerate: {0}")]
    BadCamera(&'static str),
    /// The key names no tissue on the GPU.
    #[error("no tissue with key {0} is on the GPU; sync it first")]
    UnknownTissue(u64),
    /// The device stopped answering.
    #[error("the GPU stopped answering: {0}")]
    Lost(String),
}

impl GpuError {
    /// True if the scene is more than the adapter can hold: a smaller one would do.
    pub fn is_outgrown(&self) -> bool {
        matches!(self, Self::TooLarge { .. } | Self::TooManyTissues { .. })
    }
}
