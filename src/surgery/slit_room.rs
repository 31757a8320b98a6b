//! Room for what a step of a slit looks at and makes, found before the first.

use super::{SlitScratch, SlitStep};
use crate::geometry::room::with_headroom;

impl SlitScratch {
    /// Makes room for meshes of so many vertices.
    pub fn make_room_for_mesh(&mut self, vertices: usize) {
        self.slot.reserve(with_headroom(vertices));
    }

    /// Makes room for a step that looks at so many vertices.
    pub fn make_room(&mut self, room: usize) {
        self.slotted.reserve(4 * room);
        self.positions.reserve(4 * room);
        self.values.reserve(20 * room);
        self.faces.reserve(4 * room);
        self.reached.reserve(4 * room);
        self.affected.reserve(room);
        self.plane_edges.reserve(room);
        self.edge_points.make_room(room / 4);
        self.on_edge.reserve(room);
        self.wedges.make_room(room / 4);
        self.region.make_room(room);
        self.locals.reserve(room);
        self.removed.reserve(room);
        self.added.reserve(2 * room);
        self.topology.make_room(room);
        self.split.reserve(room);
        self.incident.reserve(room);
        self.vertices.reserve(room);
        self.cuts.reserve(room);
        self.starts.reserve(room);
        self.spur.reserve(room);
        self.opened.reserve(room);
        self.sides.reserve(room);
        self.ways.make_room();
    }
}

impl SlitStep {
    /// Makes room for a step that touches so many vertices.
    pub fn make_room(&mut self, room: usize) {
        self.new_vertices.reserve(room);
        self.lips.reserve(room);
        self.tags.reserve(room);
        self.added_faces.reserve(2 * room);
        self.touched.reserve(room);
        self.met.reserve(room);
        self.closed.reserve(room);
    }
}
