//! Areas, volumes and counts of a tissue or of a part of it, in the pose the user sees.

use super::Tissue;
use crate::geometry::measure::measure_faces;
use crate::geometry::{FaceId, Measures, VertexId};
use glam::DVec3;

impl Tissue {
    /// Measures `faces` at their final positions. f64 sums; square and cubic metres.
    pub fn measure(&self, faces: impl Iterator<Item = FaceId>) -> Measures {
        measure_faces(&self.mesh, faces, |v| self.position(v))
    }

    /// Measures the whole tissue.
    pub fn measure_all(&self) -> Measures {
        // each vertex is posed once, not once for each of its faces
        let position = |v: VertexId| if self.mesh.vertex_is_live(v) { self.position(v) } else { DVec3::ZERO };
        let positions: Vec<DVec3> = (0..self.mesh.vertex_slots()).map(|v| position(VertexId::new(v))).collect();
        measure_faces(&self.mesh, self.mesh.live_faces(), |v| positions[v.index()])
    }
}
