//! Room for what an update of the particle map looks at and changes, found before the first.

use super::{MapUpdateReport, UpdateScratch};
use crate::geometry::room::with_headroom;

/// Vertices, faces and links of an edit.
const EDIT_ROOM: usize = 4096;

impl UpdateScratch {
    /// Makes room for updates of so many particles on a mesh of so many vertices.
    pub fn make_room(&mut self, vertices: usize, particles: usize) {
        let all = with_headroom(particles);
        let slots = with_headroom(vertices);
        self.flood.make_room(EDIT_ROOM, slots);
        self.rows.make_room(EDIT_ROOM, slots);
        self.reaches.make_room(all);
        self.near.reserve(all);
        self.bits.fit(all);
        self.codes.make_room(all);
        self.work.reserve(4 * EDIT_ROOM);
        self.weighted.reserve(EDIT_ROOM);
        self.links.reserve(EDIT_ROOM);
        self.row_of_links.reserve(EDIT_ROOM);
        self.tried.reserve(all);
        self.untried.reserve(EDIT_ROOM);
        self.ring.reserve(EDIT_ROOM);
        self.unlinked.reserve(EDIT_ROOM);
        self.asked.make_room();
        self.old_rows.reserve(EDIT_ROOM);
        self.old_entries.reserve(16 * EDIT_ROOM);
        self.common.reserve(EDIT_ROOM);
        self.candidates.reserve(EDIT_ROOM);
        self.wanted.make_room(all, 16 * EDIT_ROOM);
        self.in_reach.reserve(EDIT_ROOM);
        self.row.reserve(EDIT_ROOM);
        self.lost.reserve(EDIT_ROOM);
        self.lips.reserve(EDIT_ROOM);
        self.lens.make_room(slots, all);
        self.report.make_room(EDIT_ROOM);
    }
}

impl MapUpdateReport {
    fn make_room(&mut self, room: usize) {
        let Self { vertices_changed, particles_changed, relinked, particles_added, retired, reanchored, .. } = self;
        vertices_changed.reserve(4 * room);
        for list in [particles_changed, relinked, particles_added, retired, reanchored] {
            list.reserve(room);
        }
    }
}
