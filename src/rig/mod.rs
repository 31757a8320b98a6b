//! Skeleton, animation, vertex rows and skinning (MATHS 1).

pub mod animation;
pub mod deform;
pub mod rows;
pub mod skeleton;
pub mod skinning;

pub use animation::{Animation, Channel, Interpolation, Keys, Property};
pub use deform::{FADE_BLOCK, Fades, displaced, final_position};
pub use rows::{BoneWeight, RowEntry, VertexRows, VertexRowsDelta};
pub(crate) use rows::{RoundedApart, rounded};
pub use skeleton::{Joint, LocalTransform, Node, PoseScratch, Rig, RigError, Skin, Trs};
pub use skinning::{JointMatrix, Pose};
