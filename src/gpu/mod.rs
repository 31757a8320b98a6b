//! Reads a scene, deforms and draws it, never changes it. wgpu is known here (and to hosts) only.
//!
//! [`Renderer`] owns all: [`Renderer::sync`] per tissue, [`Renderer::deform`], [`Renderer::draw`].

pub mod allocator;
pub mod arenas;
pub mod belt;
pub mod blit;
pub mod camera;
pub mod clusters;
pub mod context;
pub mod cpu_deform;
pub mod deform;
pub mod depth_copy;
pub mod error;
pub mod groups;
pub mod instruments;
pub mod lines;
mod lips;
pub mod materials;
pub mod pipelines;
pub mod readback;
pub mod renderer;
pub mod rest_bounds;
pub mod stage;
pub mod table;
pub mod targets;
pub mod timing;
pub mod tissue_pass;
pub mod tissue_store;
pub mod tool_meshes;
pub mod types;
#[cfg(any(feature = "desktop", feature = "vr"))]
pub mod ui;
pub mod view;
pub mod views;

pub use camera::{Bounds, Camera, Scenery};
pub use context::{AdapterChoice, AdapterKind, Context, ContextOptions};
pub use deform::Variant;
pub use error::GpuError;
pub use instruments::{Instrument, Tool};
pub use lines::LineSegment;
pub use renderer::{DrawOptions, GpuCounters, Memory, Renderer};
pub use stage::VisibilityMask;
pub use targets::{ColourTarget, Passes, RenderTarget};
pub use timing::GpuTimes;
pub use view::{DirtyRanges, MaterialView, TextureView, TissueDirty, TissueView, ViewVersions};
pub use views::{Fov, MOST_VIEWS, Resolution, ViewPose, ViewSet};
