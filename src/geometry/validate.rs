//! Checks a [`Mesh`] from scratch. Called after every edit in tests and debug builds.

use super::ids::{FaceId, HalfEdge, VertexId};
use super::mesh::Mesh;

/// A rule that a mesh breaks, with where.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MeshFault {
    /// A live face repeats a vertex or names one that does not exist.
    #[error("face {0:?} has repeated or missing corners")]
    Corners(FaceId),
    /// A wedge of a face dresses another vertex than the face's corner.
    #[error("face {0:?} has a wedge of another vertex")]
    Wedge(FaceId),
    /// Two half-edges that should be each other's opposites are not, or do not share their ends.
    #[error("half-edge {0:?} and its opposite disagree")]
    Opposite(HalfEdge),
    /// A vertex's half-edge does not leave it, or is missing though faces use the vertex, or present though none do.
    #[error("vertex {0:?} leans on a wrong half-edge")]
    VertexHalfEdge(VertexId),
    /// Not all faces around a vertex form one fan.
    #[error("the faces around vertex {0:?} form more than one fan")]
    Fans(VertexId),
    /// The free list and the dead slots differ.
    #[error("the free list is wrong at face {0:?}")]
    FreeList(FaceId),
    /// A section's list misses a face or holds one of another section.
    #[error("the list of its section is wrong at face {0:?}")]
    Section(FaceId),
}

impl Mesh {
    /// Recomputes every invariant. O(faces).
    pub fn validate(&self) -> Result<(), MeshFault> {
        self.validate_faces()?;
        self.validate_fans()?;
        self.validate_lists()
    }

    fn validate_faces(&self) -> Result<(), MeshFault> {
        for f in self.live_faces() {
            let c = self.face(f);
            if c[0] == c[1] || c[1] == c[2] || c[2] == c[0] || c.iter().any(|v| v.index() >= self.vertex_slots()) {
                return Err(MeshFault::Corners(f));
            }
            for k in 0..3 {
                let wedge = self.face_wedges(f)[k];
                if wedge.index() >= self.wedges.len() || self.wedge(wedge).vertex != c[k] {
                    return Err(MeshFault::Wedge(f));
                }
                let h = HalfEdge::of(f, k);
                let back = self.opposite(h);
                if back.is_some() {
                    let known = back.face().index() < self.face_slots() && self.is_live(back.face());
                    if !known || self.opposite(back) != h || self.from(back) != self.to(h) || self.to(back) != self.from(h) {
                        return Err(MeshFault::Opposite(h));
                    }
                }
            }
        }
        Ok(())
    }

    fn validate_fans(&self) -> Result<(), MeshFault> {
        let mut uses = vec![0u32; self.vertex_slots()];
        for v in self.live_faces().flat_map(|f| self.face(f)) {
            uses[v.index()] += 1;
        }
        for v in (0..self.vertex_slots()).map(VertexId::new) {
            let h = self.vertex_half_edge[v.index()];
            let leaves = h.is_some() && h.face().index() < self.face_slots() && self.is_live(h.face()) && self.from(h) == v;
            if leaves != (uses[v.index()] > 0) || h.is_some() && !leaves {
                return Err(MeshFault::VertexHalfEdge(v));
            }
            if leaves && self.fan(v).take(uses[v.index()] as usize + 1).count() as u32 != uses[v.index()] {
                return Err(MeshFault::Fans(v));
            }
        }
        Ok(())
    }

    fn validate_lists(&self) -> Result<(), MeshFault> {
        let mut free = self.free_faces.to_vec();
        free.sort_unstable();
        let dead = (0..self.face_slots()).map(FaceId::new).filter(|&f| !self.is_live(f));
        if let Some((_, f)) = free.iter().copied().zip(dead.clone()).find(|(a, b)| a != b) {
            return Err(MeshFault::FreeList(f));
        }
        if free.len() != dead.count() {
            return Err(MeshFault::FreeList(FaceId::NONE));
        }
        let mut listed = vec![false; self.face_slots()];
        for s in 0..self.sections() {
            let mut previous = FaceId::NONE;
            for f in self.section_faces(super::SectionId::new(s)).take(self.face_slots() + 1) {
                if listed[f.index()]
                    || !self.is_live(f)
                    || self.face_info(f).section.index() != s
                    || self.section_links[f.index()][0] != previous
                {
                    return Err(MeshFault::Section(f));
                }
                listed[f.index()] = true;
                previous = f;
            }
        }
        match self.live_faces().find(|f| !listed[f.index()]) {
            Some(f) => Err(MeshFault::Section(f)),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::geometry::{SectionId, Wedge, WedgeId};

    /// A closed octahedron.
    pub(crate) fn octahedron() -> Mesh {
        let faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
        let wedge = |v| Wedge { vertex: VertexId(v), group: WedgeId(v), uv: [0.0; 2], normal: [0.0, 0.0, 1.0], colour: u32::MAX };
        Mesh::build(
            6,
            faces.map(|f| f.map(VertexId)).to_vec(),
            faces.map(|f| f.map(WedgeId)).to_vec(),
            &[0; 8],
            (0..6).map(wedge).collect(),
        )
    }

    #[test]
    fn a_sound_mesh_passes_and_each_broken_rule_is_named() {
        let sound = octahedron();
        assert_eq!(sound.validate(), Ok(()));
        let broken = |change: &dyn Fn(&mut Mesh)| {
            let mut mesh = sound.clone();
            change(&mut mesh);
            mesh.validate().unwrap_err()
        };
        assert_eq!(broken(&|m| m.faces.set(0, [VertexId(0), VertexId(0), VertexId(4)])), MeshFault::Corners(FaceId(0)));
        assert_eq!(broken(&|m| m.face_wedges.set(1, [WedgeId(0); 3])), MeshFault::Wedge(FaceId(1)));
        assert!(matches!(broken(&|m| m.opposite.set(0, [HalfEdge(5); 3])), MeshFault::Opposite(_)));
        assert_eq!(broken(&|m| m.vertex_half_edge.set(3, HalfEdge(0))), MeshFault::VertexHalfEdge(VertexId(3)));
        assert!(matches!(
            broken(&|m| {
                m.add_vertex();
                m.vertex_half_edge.set(6, HalfEdge(1))
            }),
            MeshFault::VertexHalfEdge(_)
        ));
        assert!(matches!(broken(&|m| assert_eq!(m.free_faces.push(FaceId(0)), 0)), MeshFault::FreeList(_)));
        assert!(matches!(broken(&|m| m.section_links.set(2, [FaceId::NONE; 2])), MeshFault::Section(_)));
        assert!(matches!(
            broken(&|m| {
                let mut i = m.face_info(FaceId(1));
                i.section = SectionId(9);
                m.face_info.set(1, i)
            }),
            MeshFault::Section(_)
        ));
        // two separate edges at one vertex leave two fans
        let fans = broken(&|m| {
            for h in m.fan(VertexId(4)).enumerate().filter(|(i, _)| i % 2 == 0).map(|(_, h)| h).collect::<Vec<_>>() {
                m.open_edge(h);
            }
        });
        assert_eq!(fans, MeshFault::Fans(VertexId(4)));
    }
}
