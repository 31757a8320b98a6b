//! Blade paths, boxes, the tear, the plane cut.

pub mod blade_path;
pub mod path_sampler;

pub use blade_path::{BladePath, BladePose, EntryPoint, PathError, Sampling, SamplingSettings, SettingError, Surface};
pub use path_sampler::{PathSample, PathSampler, SampleKind};
