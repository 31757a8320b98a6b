//! Connected components by face adjacency: what falls apart after a cut.

use super::ids::{FaceId, HalfEdge};
use super::mesh::Mesh;

/// Component of a dead face slot.
pub const NO_COMPONENT: u32 = u32::MAX;

/// Faces grouped by component. Components are ordered by their lowest face, faces ascend within each.
#[derive(Clone, Debug, Default)]
pub struct Components {
    /// Component of each face slot, [`NO_COMPONENT`] where dead. Shape: [`Mesh::face_slots`].
    pub of_face: Vec<u32>,
    offsets: Vec<u32>,
    faces: Vec<FaceId>,
    stack: Vec<FaceId>,
}

impl Components {
    /// Components of all live faces.
    pub fn find(mesh: &Mesh) -> Self {
        let mut components = Self::default();
        components.update(mesh);
        components
    }

    /// Finds them anew, reusing the allocations.
    pub fn update(&mut self, mesh: &Mesh) {
        self.of_face.clear();
        self.of_face.resize(mesh.face_slots(), NO_COMPONENT);
        let mut count = 0;
        for seed in mesh.live_faces() {
            if self.of_face[seed.index()] == NO_COMPONENT {
                self.flood(mesh, seed, count);
                count += 1;
            }
        }
        self.group(count as usize);
    }

    /// Number of components.
    pub fn count(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Faces of one component, ascending.
    pub fn faces(&self, component: usize) -> &[FaceId] {
        &self.faces[self.offsets[component] as usize..self.offsets[component + 1] as usize]
    }

    fn flood(&mut self, mesh: &Mesh, seed: FaceId, component: u32) {
        self.of_face[seed.index()] = component;
        self.stack.push(seed);
        while let Some(f) = self.stack.pop() {
            for k in 0..3 {
                let across = mesh.opposite(HalfEdge::of(f, k));
                if across.is_some() && self.of_face[across.face().index()] == NO_COMPONENT {
                    self.of_face[across.face().index()] = component;
                    self.stack.push(across.face());
                }
            }
        }
    }

    /// Count, scan, fill.
    fn group(&mut self, count: usize) {
        self.offsets.clear();
        self.offsets.resize(count + 1, 0);
        for &c in self.of_face.iter().filter(|&&c| c != NO_COMPONENT) {
            self.offsets[c as usize + 1] += 1;
        }
        for i in 0..count {
            self.offsets[i + 1] += self.offsets[i];
        }
        self.faces.clear();
        self.faces.resize(self.offsets[count] as usize, FaceId::NONE);
        let mut cursor = self.offsets.clone();
        for (f, &c) in self.of_face.iter().enumerate() {
            if c != NO_COMPONENT {
                let at = &mut cursor[c as usize];
                self.faces[*at as usize] = FaceId::new(f);
                *at += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{VertexId, Wedge, WedgeId};

    fn mesh(vertices: usize, faces: &[[u32; 3]]) -> Mesh {
        let wedges = (0..vertices)
            .map(|v| Wedge { vertex: VertexId::new(v), group: WedgeId::new(v), uv: [0.0; 2], normal: [0.0; 3], colour: u32::MAX })
            .collect();
        Mesh::build(
            vertices,
            faces.iter().map(|f| f.map(VertexId)).collect(),
            faces.iter().map(|f| f.map(WedgeId)).collect(),
            &vec![0; faces.len()],
            wedges,
        )
    }

    #[test]
    fn ordered_by_lowest_face() {
        let mesh = mesh(9, &[[4, 5, 6], [0, 1, 2], [6, 5, 7], [2, 1, 3]]);
        let components = Components::find(&mesh);
        assert_eq!(components.count(), 2);
        assert_eq!(components.faces(0), &[FaceId(0), FaceId(2)]);
        assert_eq!(components.faces(1), &[FaceId(1), FaceId(3)]);
        assert_eq!(components.of_face, [0, 1, 0, 1]);
    }

    #[test]
    fn a_shared_vertex_does_not_connect_and_a_missing_edge_cuts() {
        assert_eq!(Components::find(&mesh(5, &[[0, 1, 2], [2, 3, 4]])).count(), 2);
        assert_eq!(Components::find(&mesh(4, &[[0, 1, 2], [2, 1, 3]])).count(), 1);
    }

    #[test]
    fn no_faces_no_components() {
        assert_eq!(Components::default().count(), 0);
        assert_eq!(Components::find(&Mesh::default()).count(), 0);
    }
}
