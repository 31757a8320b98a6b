//! Blade paths, boxes, the tear, the plane cut (MATHS 5 and 6).

pub mod blade_path;
pub mod boxes;
pub mod boxes_obj;
pub mod cap;
pub mod chain;
pub mod clip;
mod hub;
pub mod insert;
mod lane;
pub mod leaf;
pub mod path_sampler;
mod pivot;
pub mod plane_cut;
pub mod plane_from_hand;
mod plane_split;
pub mod region;
pub mod slit;
pub mod stroke;
pub mod tear;
pub mod tear_walls;
mod wall_mesh;
mod wall_thin;
pub mod walls;

pub use blade_path::{BladePath, BladePose, EntryPoint, Met, PathError, Sampling, SamplingSettings, SettingError, Surface};
pub use boxes::{ChainStart, HalfSpace, JointId, LATERAL_SIDES, PlaneId, Side, Slit, TearBox, TearSegment, plane_side};
pub use boxes_obj::{write_boxes, write_slits};
pub use chain::{ChainBuilder, PendingQuad};
pub use path_sampler::{ClippedSample, PathSample, PathSampler, SampleKind};
pub use plane_from_hand::PlaneFromHand;
pub use stroke::{Stroke, WallMode, tear_segments};
