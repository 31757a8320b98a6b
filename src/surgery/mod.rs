//! Blade paths, boxes, the tear, the plane cut (MATHS 5 and 6).

pub mod clip;
