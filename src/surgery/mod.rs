//! Blade paths, boxes, the tear, the plane cut.
