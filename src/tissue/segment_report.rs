//! What one segment of a stroke did.

use crate::diagnostics::Stages;

/// The paper's rows for one segment, with what it did.
#[derive(Clone, Debug, Default)]
pub struct SegmentReport {
    /// Milliseconds: perform_tear (clip, retriangulate), bind (rows of the inserted vertices), disconnect_particles (the
    /// strip), update_particles (the map), update_mesh (closing the notes that a mirror and undo follow).
    pub stages: Stages,
    /// Vertices inserted.
    pub new_vertices: usize,
    /// Faces looked at.
    pub faces_visited: usize,
    /// Vertices that the update of the particle map looked at.
    pub vertices_visited: usize,
    /// Bytes of the entries that a mirror has to follow, if they are counted.
    pub bytes_changed: usize,
    /// Crossings of planes with edges and faces.
    pub intersection_points: usize,
    /// Area taken out, square metres.
    pub area_removed: f64,
    /// Edges opened (width 0).
    pub opened_edges: usize,
    /// Particles that the wound was given.
    pub wound_particles: usize,
    /// Faces of walls and floor put in (closed tears).
    pub wall_faces: usize,
    /// Edges of the rim that got no wall, because the model was open there.
    pub unclosed_edges: usize,
    /// How far the rest position and bones of a wall's corner miss its place, metres: a fade holds it there (MATHS 1.4).
    pub wall_deviation: f64,
    /// Smallest angle of the faces put in, radians; a right angle without any.
    pub smallest_angle: f64,
    /// Rows that grew too long and became base vertices.
    pub promoted_vertices: usize,
}
