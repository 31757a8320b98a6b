//! Skeleton, animation, vertex rows and skinning (MATHS 1).

pub mod rows;
pub mod skinning;

pub use rows::{BoneWeight, RowEntry, VertexRows, VertexRowsDelta};
pub use skinning::{JointMatrix, Pose};
