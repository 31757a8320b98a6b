//! Blade paths, boxes, the tear, the plane cut (MATHS 5 and 6).

pub mod clip;
pub mod insert;
pub mod plane_cut;
pub mod region;
pub mod tear;
