//! Blade paths, boxes, the tear, the plane cut.

pub mod blade_path;
pub mod boxes;
pub mod boxes_obj;
pub mod chain;
pub mod path_sampler;
pub mod stroke;

pub use blade_path::{BladePath, BladePose, EntryPoint, PathError, Sampling, SamplingSettings, SettingError, Surface};
pub use boxes::{HalfSpace, JointId, LATERAL_SIDES, PlaneId, Side, Slit, TearBox, TearSegment, plane_side};
pub use boxes_obj::write_boxes;
pub use chain::ChainBuilder;
pub use path_sampler::{ClippedSample, PathSample, PathSampler, SampleKind};
pub use stroke::{Stroke, WallMode, tear_segments};
