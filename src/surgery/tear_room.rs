//! Room for what a step looks at and makes, found before the first.

use super::{TearScratch, TearStep};

impl TearScratch {
    /// Makes room for a step that looks at so many vertices.
    pub fn make_room(&mut self, room: usize) {
        self.slotted.reserve(4 * room);
        self.positions.reserve(4 * room);
        self.values.reserve(4 * room);
        self.valued.reserve(4 * room);
        self.affected.reserve(room);
        self.points.reserve(room);
        self.on_edge.reserve(room);
        self.locals.reserve(room);
        self.removed.reserve(room);
        self.added.reserve(2 * room);
        self.split.reserve(room);
        self.incident.reserve(room);
        self.vertices.reserve(room);
        self.zero.reserve(room);
    }
}

impl TearStep {
    /// Makes room for a step that touches so many vertices.
    pub fn make_room(&mut self, room: usize) {
        self.new_vertices.reserve(room);
        self.lips.reserve(room);
        self.on_end.reserve(room / 4);
        self.added_faces.reserve(2 * room);
        self.touched.reserve(room);
    }
}
