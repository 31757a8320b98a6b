//! Room for what a step looks at and makes, found before the first.

use super::{TearScratch, TearStep};
use crate::geometry::room::with_headroom;

/// Points of a face that a box has clipped.
const POLYGON: usize = 32;

impl TearScratch {
    /// Makes room for meshes of so many vertices.
    pub fn make_room_for_mesh(&mut self, vertices: usize) {
        self.slot.reserve(with_headroom(vertices));
    }

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
        self.incident.reserve(4 * room);
        self.vertices.reserve(room);
        self.zero.reserve(room);
        self.topology.make_room(room);
        self.edge_points.make_room(room / 4);
        self.wedges.make_room(room / 4);
        self.lining.make_room(room);
        self.clipped.make_room(POLYGON);
        self.region.make_room(room);
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
        self.walls.reserve(room);
        self.widened_faces.reserve(room);
        self.recut.reserve(2 * room);
    }
}
