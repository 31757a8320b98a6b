//! Reads a scene, deforms and draws it, never changes it. wgpu is known here (and to hosts) only.
//!
//! [`Renderer`] owns all: [`Renderer::sync`] per tissue, [`Renderer::deform`], [`Renderer::draw`].

pub mod allocator;
pub mod arenas;
pub mod camera;
pub mod context;
pub mod deform;
pub mod error;
pub mod lines;
pub mod materials;
pub mod readback;
pub mod renderer;
pub mod stage;
pub mod targets;
pub mod tissue_pass;
pub mod tissue_store;
pub mod types;
pub mod view;

pub use camera::{Bounds, Camera, Scenery};
pub use context::{AdapterChoice, AdapterKind, Context, ContextOptions};
pub use error::GpuError;
pub use lines::LineSegment;
pub use renderer::{DrawOptions, GpuCounters, Renderer};
pub use view::{DirtyRanges, MaterialView, TextureView, TissueDirty, TissueView, ViewVersions};
