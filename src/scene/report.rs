//! What an edit did, in plain data (CONTRACT: cut, tear).

use super::TissueId;
use crate::diagnostics::Stages;
use crate::surgery::cap::CapOutcome;
use crate::tissue::stroke::SegmentReport;

/// Segments of a stroke that a report has room for at first, and pieces.
const SEGMENTS: usize = 256;
const PIECES: usize = 16;

/// How an edit ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing was reached; nothing changed.
    #[default]
    Missed,
    /// A plane went through.
    Cut,
    /// The surface was torn and still hangs together.
    Torn,
    /// The tear took a piece off.
    Severed,
    /// An edit was taken back.
    Undone,
    /// An edit was done again.
    Redone,
    /// All edits were taken back.
    Reset,
}

impl Outcome {
    /// The word of CONTRACT.
    pub fn as_str(self) -> &'static str {
        match self {
            Outcome::Missed => "missed",
            Outcome::Cut => "cut",
            Outcome::Torn => "torn",
            Outcome::Severed => "severed",
            Outcome::Undone => "undone",
            Outcome::Redone => "redone",
            Outcome::Reset => "reset",
        }
    }
}

/// One piece after an edit, in the pose of the edit.
#[derive(Clone, Debug)]
pub struct PieceReport {
    /// The tissue that it is now.
    pub tissue: TissueId,
    /// Faces.
    pub faces: usize,
    /// Square metres.
    pub area: f64,
    /// Cubic metres, signed; of an open surface, the sum of tetrahedra to the origin of model space.
    pub volume: f64,
    /// No boundary and no non-manifold edge.
    pub closed: bool,
    /// Edges with one face.
    pub boundary_edges: usize,
    /// Edges with three faces or more, or two in the same direction.
    pub non_manifold_edges: usize,
    /// Faces without area.
    pub degenerate_faces: usize,
    /// +1 or -1: the side of the plane it lies on; 0 for a tear.
    pub side: i8,
    /// Lowest face of the loaded model that is a part of it.
    pub lowest_origin: u32,
}

/// Caps of a cut, both sides together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CapReport {
    /// Loops that were closed.
    pub loops: usize,
    /// Faces put in.
    pub faces: usize,
    /// Edges of the cut that belong to no closed loop, because the model is open there; they stay open.
    pub unclosed_edges: usize,
    /// Triangles for which loops that cross themselves left no place: they lie over others.
    pub forced: usize,
}

impl CapReport {
    pub(super) fn add(&mut self, caps: &CapOutcome) {
        self.loops += caps.loops;
        self.faces += caps.added_faces.len();
        self.unclosed_edges += caps.unclosed_edges;
        self.forced += caps.triangulation.forced_ears;
    }
}

/// What an edit did.
#[derive(Clone, Debug, Default)]
pub struct EditReport {
    /// "tear", "cut", "undo", "redo", "reset".
    pub kind: &'static str,
    /// How it ended.
    pub outcome: Outcome,
    /// Live vertices after it, all tissues.
    pub vertices: usize,
    /// Live faces after it, all tissues.
    pub faces: usize,
    /// The pieces: positive side first, then by area, ties by lowest original face. None is what a tear has taken out whole.
    pub pieces: Vec<PieceReport>,
    /// Vertices inserted.
    pub new_vertices: usize,
    /// Rows that grew too long and became base vertices (MATHS 1.4).
    pub promoted_vertices: usize,
    /// Points where planes crossed edges and faces.
    pub intersection_points: usize,
    /// Square metres before.
    pub area_before: f64,
    /// Cubic metres before, signed.
    pub volume_before: f64,
    /// Square metres that tears took out.
    pub area_removed: f64,
    /// Faces of walls and floors that closed tears put in.
    pub wall_faces: usize,
    /// Edges of a closed tear's rim that got no wall, because the model is open there.
    pub unclosed_edges: usize,
    /// How far the rest position and bones of a wall's corner miss its place in the pose, metres (MATHS 1.4).
    pub wall_deviation: f64,
    /// Smallest angle of the faces that tears put in, radians.
    pub smallest_angle: Option<f64>,
    /// What closed the pieces of a cut.
    pub caps: CapReport,
    /// Largest distance of an inserted vertex from the plane, metres (cuts).
    pub max_plane_distance: Option<f64>,
    /// Longest row.
    pub max_row_entries: usize,
    /// Faces looked at.
    pub faces_visited: usize,
    /// Bytes that a GPU mirror needs to follow.
    pub bytes_uploaded: usize,
    /// Milliseconds by stage.
    pub stages: Stages,
    /// Milliseconds that the figures of this report took, which are no part of the edit.
    pub measuring: Stages,
    /// Tears: one entry a segment.
    pub segments: Vec<SegmentReport>,
}

impl EditReport {
    /// An empty report of this kind, in the room of one that nobody reads any more.
    pub(super) fn again(mut self, kind: &'static str) -> Self {
        self.segments.clear();
        self.pieces.clear();
        Self { kind, segments: self.segments, pieces: self.pieces, ..Self::default() }
    }

    /// Empty, with room for the segments of a usual stroke.
    pub(super) fn with_room() -> Self {
        Self { segments: Vec::with_capacity(SEGMENTS), pieces: Vec::with_capacity(PIECES), ..Self::default() }
    }
}
