//! Taking faces out of a mesh into a mesh of their own, connectivity and all (MATHS 6: pieces).

use super::ids::{FaceId, HalfEdge, SectionId, VertexId, WedgeId};
use super::mesh::{FaceInfo, Mesh, Wedge};
use super::topology::TopologyScratch;
use super::tracked::Tracked;

/// What went where when a mesh was taken apart.
#[derive(Clone, Debug, Default)]
pub struct Extraction {
    /// Old vertex of each new one, ascending.
    pub vertex_from: Vec<VertexId>,
    /// New vertex of each old one; [`VertexId::NONE`] where it stays behind.
    pub vertex_to: Vec<VertexId>,
}

impl Mesh {
    /// A copy of `faces` (live, ascending, each once) as a mesh of its own, in one section. Vertices come along in order;
    /// `also` (ascending) names vertices that must come although none of the faces uses them, such as row parents. Edges
    /// to faces outside become open; edges that are open stay open.
    pub fn extract(&self, faces: &[FaceId], also: &[VertexId]) -> (Mesh, Extraction) {
        let mut used = vec![false; self.vertex_slots()];
        for v in faces.iter().flat_map(|&f| self.face(f)).chain(also.iter().copied()) {
            used[v.index()] = true;
        }
        let vertex_from: Vec<VertexId> = (0..used.len()).filter(|&v| used[v]).map(VertexId::new).collect();
        let mut vertex_to = vec![VertexId::NONE; used.len()];
        for (new, old) in vertex_from.iter().enumerate() {
            vertex_to[old.index()] = VertexId::new(new);
        }
        let mut wedge_to = vec![WedgeId::NONE; self.wedges.len()];
        let mut wedges: Vec<Wedge> = Vec::new();
        let mut face_to = vec![FaceId::NONE; self.face_slots()];
        for (new, &f) in faces.iter().enumerate() {
            face_to[f.index()] = FaceId::new(new);
            for w in self.face_wedges(f) {
                if wedge_to[w.index()].is_none() {
                    wedge_to[w.index()] = WedgeId::new(wedges.len());
                    wedges.push(self.wedge(w));
                }
            }
        }
        regroup(&mut wedges, &vertex_to);
        let opposite = |f: FaceId, k: usize| {
            let back = self.opposite(HalfEdge::of(f, k));
            if back.is_none() || face_to[back.face().index()].is_none() {
                return HalfEdge::NONE;
            }
            HalfEdge::of(face_to[back.face().index()], back.corner())
        };
        let mut vertex_half_edge = vec![HalfEdge::NONE; vertex_from.len()];
        for (new, &f) in faces.iter().enumerate().rev() {
            for (k, v) in self.face(f).into_iter().enumerate() {
                vertex_half_edge[vertex_to[v.index()].index()] = HalfEdge::of(FaceId::new(new), k);
            }
        }
        let corners: Vec<[VertexId; 3]> = faces.iter().map(|&f| self.face(f).map(|v| vertex_to[v.index()])).collect();
        let face_wedges: Vec<[WedgeId; 3]> = faces.iter().map(|&f| self.face_wedges(f).map(|w| wedge_to[w.index()])).collect();
        let infos: Vec<FaceInfo> = faces.iter().map(|&f| FaceInfo { section: SectionId(0), ..self.face_info(f) }).collect();
        let mut mesh = Mesh {
            opposite: faces.iter().map(|&f| std::array::from_fn(|k| opposite(f, k))).collect::<Vec<_>>().into(),
            faces: corners.into(),
            face_wedges: face_wedges.into(),
            face_info: infos.into(),
            vertex_half_edge: vertex_half_edge.into(),
            wedges: wedges.into(),
            free_faces: Tracked::default(),
            section_head: Tracked::default(),
            section_links: Tracked::default(),
        };
        let sections = vec![SectionId(0); mesh.face_slots()];
        mesh.assign_sections(1, &sections);
        (mesh, Extraction { vertex_from, vertex_to })
    }

    /// Removes `faces` (live, each once) and puts nothing in their place.
    pub fn remove_faces(&mut self, faces: &[FaceId], scratch: &mut TopologyScratch) {
        self.replace_faces(faces, &[], |_| 0, scratch);
    }
}

/// Points wedges at their new vertices and gives each smoothing group its first surviving wedge.
fn regroup(wedges: &mut [Wedge], vertex_to: &[VertexId]) {
    let mut first: std::collections::BTreeMap<WedgeId, WedgeId> = std::collections::BTreeMap::new();
    for (w, wedge) in wedges.iter_mut().enumerate() {
        wedge.vertex = vertex_to[wedge.vertex.index()];
        wedge.group = *first.entry(wedge.group).or_insert(WedgeId::new(w));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::validate::tests::octahedron;

    #[test]
    fn halves_are_sound_and_hold_all_faces() {
        let mesh = octahedron();
        let top: Vec<FaceId> = (0..4).map(FaceId).collect();
        let (piece, map) = mesh.extract(&top, &[]);
        assert_eq!(piece.validate(), Ok(()));
        assert_eq!((piece.face_count(), map.vertex_from.len()), (4, 5));
        let mut rest = mesh.clone();
        rest.remove_faces(&top, &mut TopologyScratch::default());
        assert_eq!(rest.validate(), Ok(()));
        assert_eq!(rest.face_count(), 4);
        let delta = rest.take_delta();
        rest.apply_delta(delta);
        assert_eq!(rest.faces(), mesh.faces());
        assert_eq!(rest.validate(), Ok(()));
    }
}
