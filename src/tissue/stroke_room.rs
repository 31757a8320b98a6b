//! Room for a usual stroke, found once at load: a frame that tears looks for none.

use super::{ENDS_KEPT, Ended, TearStroke};
use crate::geometry::Distinct;
use crate::geometry::room::rows_headroom;
use crate::surgery::Sampling;
use crate::tissue::{Tissue, TissueDelta};

/// Entries of a list of what one segment touches: vertices, faces, planes.
const SEGMENT_ROOM: usize = 2048;
/// Segments of a stroke.
const SEGMENTS: usize = 256;
/// Wounds that a stroke is in at once.
const WOUNDS: usize = 32;
/// Deltas that are under way: one is filled while others are with those who mirror the tissue.
const DELTAS: usize = 4;

impl TearStroke {
    /// [`TearStroke::new`] with room for a usual stroke, to be taken up by [`TearStroke::again`].
    pub fn with_room(tissue: &Tissue, sampling: Sampling) -> Self {
        let mut stroke = Self::new(tissue, 0.0, sampling);
        let Self { candidates, near, nearby, made, origins, removed, joined, tags, lips, nicked, .. } = &mut stroke;
        candidates.reserve(4 * SEGMENT_ROOM);
        for list in [near, nearby, removed] {
            list.reserve(SEGMENT_ROOM);
        }
        made.reserve(SEGMENT_ROOM);
        origins.reserve(SEGMENT_ROOM);
        joined.reserve(SEGMENTS * 16);
        tags.reserve(SEGMENT_ROOM);
        lips.reserve(SEGMENT_ROOM);
        nicked.reserve(SEGMENT_ROOM);
        stroke.wounds.reserve(WOUNDS);
        stroke.ended.reserve(ENDS_KEPT);
        stroke.spare_ended.resize_with(ENDS_KEPT + 2, Ended::with_room);
        stroke.segments.reserve(16);
        stroke.boxes.reserve(SEGMENTS);
        stroke.reports.reserve(SEGMENTS);
        stroke.ties.reserve(8);
        stroke.deltas.reserve(16);
        stroke.spare_deltas.resize_with(DELTAS, || TissueDelta::with_room(1));
        stroke.distinct = Distinct::with_room(rows_headroom(16 * tissue.mesh().vertex_slots()));
        stroke.planes.make_room();
        stroke.stroke.make_room();
        stroke.slits.make_room(SEGMENT_ROOM);
        stroke.scratch.make_room(SEGMENT_ROOM);
        stroke.step.make_room(SEGMENT_ROOM);
        stroke
    }

    /// Finds room for as many positions and places as `tissue` has vertices.
    pub fn prepare_for(mut self, tissue: &Tissue) -> Self {
        self.positions.refresh(tissue);
        self.scratch.make_room_for_mesh(tissue.mesh().vertex_slots());
        self.slits.make_room_for_mesh(tissue.mesh().vertex_slots());
        self
    }
}

impl Ended {
    fn with_room() -> Self {
        let mut ended = Self::default();
        ended.tags.reserve(SEGMENT_ROOM / 4);
        ended.end_wall.reserve(SEGMENT_ROOM / 4);
        ended.other_walls.reserve(SEGMENT_ROOM / 4);
        ended.lips.reserve(SEGMENT_ROOM / 4);
        ended.near.reserve(SEGMENT_ROOM / 2);
        ended
    }
}
