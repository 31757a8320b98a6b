//! Skeleton, animation, vertex rows and skinning (MATHS 1).

pub mod deform;
pub mod rows;
pub mod skinning;

pub use deform::{Fades, final_position};
pub use rows::{BoneWeight, RowEntry, VertexRows, VertexRowsDelta};
pub use skinning::{JointMatrix, Pose};
