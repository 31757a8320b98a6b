//! Areas, volumes and counts of a tissue or of a part of it, in the pose the user sees.

use super::Tissue;
use crate::geometry::measure::measure_faces;
use crate::geometry::{FaceId, Measures};

impl Tissue {
    /// Measures `faces` at their final positions. f64 sums; square and cubic metres.
    pub fn measure(&self, faces: impl Iterator<Item = FaceId>) -> Measures {
        measure_faces(&self.mesh, faces, |v| self.position(v))
    }

    /// Measures the whole tissue.
    pub fn measure_all(&self) -> Measures {
        self.measure(self.mesh.live_faces())
    }
}
