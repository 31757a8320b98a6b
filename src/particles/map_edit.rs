//! What an edit did to the mesh, as far as the particle map needs to know.

use crate::geometry::VertexId;
use std::ops::Range;

/// A vertex that an edit made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewVertex {
    /// The vertex.
    pub vertex: VertexId,
    /// What it was made from: the ends of the edge it cuts, the corners of the face it pierces, or the vertex it is a copy
    /// of. [`VertexId::NONE`] where unused. A parent that is new itself comes earlier in the list.
    pub parents: [VertexId; 3],
    /// True if the parents only move it and it does not lie between them: it shares no lip with them.
    pub is_apart: bool,
}

/// A vertex on the lip of a slit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LipVertex {
    /// The vertex.
    pub vertex: VertexId,
    /// Index of the strip.
    pub strip: usize,
    /// +1 on the side of the strip's normal `(tip1 - tip0) x (base - tip)`, -1 on the other.
    pub side: i8,
}

/// What an edit did to the mesh, as far as the particle map needs to know. All slices may be empty.
#[derive(Clone, Debug, Default)]
pub struct MapEdit<'a> {
    /// Vertices that the edit made, copies included.
    pub new_vertices: &'a [NewVertex],
    /// Vertices that no face uses any more.
    pub removed_vertices: &'a [VertexId],
    /// Strips that the edit made, already pushed to [`super::Strips`].
    pub new_strips: Range<usize>,
    /// The strip that the first of them goes on from, if vertices where they meet know their side of it only now: links are tested against
    /// that one, too.
    pub goes_on_from: Option<usize>,
    /// From where to where, metres on its line, the wound of the new strips stood open before the blade came to it.
    pub opened: [f64; 2],
    /// Vertices on the lips of the new strips, those of both triangulation passes.
    pub lips: &'a [LipVertex],
}
