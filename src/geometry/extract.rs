//! Taking whole components out of a mesh into a mesh of their own, connectivity and all (MATHS 6: pieces).
//!
//! Both sides are linear in the faces that go: tables tell where each vertex, wedge and face went, and nothing is sorted.

use super::ids::{FaceId, HalfEdge, SectionId, VertexId, WedgeId};
use super::mesh::{FaceInfo, Mesh, Wedge};
use super::topology::TopologyScratch;
use super::tracked::Tracked;
use std::collections::BTreeMap;

/// What went where when a mesh was taken apart. Kept between pieces, so that its tables are allocated once.
#[derive(Clone, Debug, Default)]
pub struct Extraction {
    /// Old vertex of each new one, ascending.
    pub vertex_from: Vec<VertexId>,
    /// New vertex of each old one; [`VertexId::NONE`] where it stays behind.
    pub vertex_to: Vec<VertexId>,
    /// Old section of each new one.
    pub section_from: Vec<SectionId>,
    wedge_from: Vec<WedgeId>,
    wedge_to: Vec<WedgeId>,
    pub(super) face_to: Vec<FaceId>,
    pub(super) section_to: Vec<SectionId>,
}

impl Extraction {
    /// Marks what `faces` and the rows of their vertices use, and numbers the faces.
    fn mark<P>(&mut self, mesh: &Mesh, faces: &[FaceId], parents: impl Fn(VertexId) -> P)
    where
        P: IntoIterator<Item = VertexId>,
    {
        refill(&mut self.vertex_to, mesh.vertex_slots(), VertexId::NONE);
        refill(&mut self.wedge_to, mesh.wedges.len(), WedgeId::NONE);
        refill(&mut self.face_to, mesh.face_slots(), FaceId::NONE);
        refill(&mut self.section_to, mesh.sections(), SectionId::NONE);
        // slices of everything: the loops are all there is, and they are not to look lengths up
        let (vertex_to, wedge_to, face_to) = (&mut self.vertex_to[..], &mut self.wedge_to[..], &mut self.face_to[..]);
        let (corners, wedges) = (&mesh.faces[..], &mesh.face_wedges[..]);
        for (new, &f) in faces.iter().enumerate() {
            face_to[f.index()] = FaceId(new as u32);
            for v in corners[f.index()] {
                vertex_to[v.index()] = VertexId(0);
            }
            for w in wedges[f.index()] {
                wedge_to[w.index()] = WedgeId(0);
            }
        }
        for v in 0..vertex_to.len() {
            if vertex_to[v].is_some() {
                for parent in parents(VertexId(v as u32)) {
                    vertex_to[parent.index()] = VertexId(0);
                }
            }
        }
    }

    /// Wedges in their order, on their new vertices; of a smoothing group whose leader stays behind, the first one leads.
    fn take_wedges(&mut self, mesh: &Mesh) -> Vec<Wedge> {
        let mut orphaned: BTreeMap<WedgeId, WedgeId> = BTreeMap::new();
        let (wedges, vertex_to, wedge_to) = (&mesh.wedges[..], &self.vertex_to[..], &self.wedge_to[..]);
        let taken = |old: &WedgeId| {
            let wedge = &wedges[old.index()];
            let mut group = wedge_to[wedge.group.index()];
            if group.is_none() {
                group = *orphaned.entry(wedge.group).or_insert(wedge_to[old.index()]);
            }
            Wedge { vertex: vertex_to[wedge.vertex.index()], group, ..*wedge }
        };
        self.wedge_from.iter().map(taken).collect()
    }
}

/// Numbers the marked entries of a table in their order and lists them.
macro_rules! number {
    ($index:ident, $to:expr, $from:expr, $most:expr) => {
        $from.clear();
        $from.reserve($most.min($to.len()));
        for (old, new) in $to.iter_mut().enumerate() {
            if new.is_some() {
                *new = $index($from.len() as u32);
                $from.push($index(old as u32));
            }
        }
    };
}

/// `map` over three entries; the array's own is not inlined.
#[inline(always)]
fn three<T, U>([a, b, c]: [T; 3], map: impl Fn(T) -> U) -> [U; 3] {
    [map(a), map(b), map(c)]
}

fn refill<T: Copy>(table: &mut Vec<T>, len: usize, value: T) {
    table.clear();
    table.resize(len, value);
}

impl Mesh {
    /// A copy of `faces` (live, ascending, each once) as a mesh of its own. Vertices come along in order, with those that
    /// `parents` names for a vertex although none of the faces may use them; so do wedges. Sections keep their faces and are
    /// numbered anew. Edges to faces outside become open; edges that are open stay open. What went where is left in `map`.
    pub fn extract<P>(&self, faces: &[FaceId], parents: impl Fn(VertexId) -> P, map: &mut Extraction) -> Mesh
    where
        P: IntoIterator<Item = VertexId>,
    {
        map.mark(self, faces, parents);
        number!(VertexId, map.vertex_to, map.vertex_from, faces.len());
        number!(WedgeId, map.wedge_to, map.wedge_from, faces.len());
        let wedges = map.take_wedges(self);
        let (face_info, section_head, section_links) = self.take_sections(faces, map);
        let (vertex_to, wedge_to, face_to) = (&map.vertex_to[..], &map.wedge_to[..], &map.face_to[..]);
        let half_edge = |old: HalfEdge| {
            if old.is_none() {
                return old;
            }
            let face = face_to[old.face().index()];
            if face.is_some() { HalfEdge::of(face, old.corner()) } else { HalfEdge::NONE }
        };
        let (old_corners, old_wedges, old_opposite) = (&self.faces[..], &self.face_wedges[..], &self.opposite[..]);
        let corners = faces.iter().map(|f| three(old_corners[f.index()], |v| vertex_to[v.index()]));
        let face_wedges = faces.iter().map(|f| three(old_wedges[f.index()], |w| wedge_to[w.index()]));
        let opposite = faces.iter().map(|f| three(old_opposite[f.index()], half_edge));
        let leaving = &self.vertex_half_edge[..];
        Mesh {
            faces: corners.collect::<Vec<_>>().into(),
            opposite: opposite.collect::<Vec<_>>().into(),
            face_wedges: face_wedges.collect::<Vec<_>>().into(),
            face_info: face_info.into(),
            vertex_half_edge: map.vertex_from.iter().map(|v| half_edge(leaving[v.index()])).collect::<Vec<_>>().into(),
            wedges: wedges.into(),
            free_faces: Tracked::default(),
            section_head: section_head.into(),
            section_links: section_links.into(),
        }
    }

    /// Infos of `faces`, and the lists of their sections, which are numbered in the order that faces ask.
    fn take_sections(&self, faces: &[FaceId], map: &mut Extraction) -> (Vec<FaceInfo>, Vec<FaceId>, Vec<[FaceId; 2]>) {
        let (infos, section_to) = (&self.face_info[..], &mut map.section_to[..]);
        map.section_from.clear();
        let mut links: Vec<[FaceId; 2]> = Vec::with_capacity(faces.len());
        let room = faces.len().min(section_to.len());
        let (mut heads, mut tails): (Vec<FaceId>, Vec<FaceId>) = (Vec::with_capacity(room), Vec::with_capacity(room));
        let taken = faces.iter().enumerate().map(|(new, f)| {
            let info = infos[f.index()];
            let new = FaceId(new as u32);
            let section = section_to[info.section.index()];
            if section.is_none() {
                let section = SectionId(heads.len() as u32);
                section_to[info.section.index()] = section;
                map.section_from.push(info.section);
                heads.push(new);
                tails.push(new);
                links.push([FaceId::NONE; 2]);
                return FaceInfo { section, ..info };
            }
            let before = std::mem::replace(&mut tails[section.index()], new);
            links.push([before, FaceId::NONE]);
            links[before.index()][1] = new;
            FaceInfo { section, ..info }
        });
        let infos = taken.collect();
        (infos, heads, links)
    }

    /// Removes `faces` (live, each once) and puts nothing in their place.
    pub fn remove_faces(&mut self, faces: &[FaceId], scratch: &mut TopologyScratch) {
        self.replace_faces(faces, &[], |_| 0, scratch);
    }

    /// Removes whole components: `faces` (live, each once), and `vertices`, which are theirs alone; with a face of a section that
    /// is `whole` (known to be connected in itself; sections beyond the list are not) all of it goes. Wedges, opposites and links of the
    /// dead slots stay as they are: whoever takes a slot writes them anew.
    pub fn remove_components(&mut self, faces: &[FaceId], vertices: impl Iterator<Item = VertexId>, whole: &[bool]) {
        self.faces.update(faces.iter().map(|f| f.index()), |_| [VertexId::NONE; 3]);
        debug_assert!(faces.iter().all(|f| {
            let across = self.opposite[f.index()].into_iter().filter(|h| h.is_some());
            across.into_iter().all(|h| !self.is_live(h.face()))
        }));
        self.free_faces.extend(faces);
        self.vertex_half_edge.update(vertices.map(VertexId::index), |_| HalfEdge::NONE);
        self.unlink_dead(faces, whole);
    }

    /// Takes faces that have just died out of their sections: what is left of a list closes over each run of them. Nothing is
    /// left of those that are `whole`.
    fn unlink_dead(&mut self, faces: &[FaceId], whole: &[bool]) {
        let Self { faces: corners, face_info: infos, section_head, section_links, .. } = self;
        let (corners, infos) = (&corners[..], &infos[..]);
        let is_live = |f: FaceId| corners[f.index()][0].is_some();
        for (section, _) in whole.iter().enumerate().filter(|(_, whole)| **whole) {
            let head = section_head[section];
            if head.is_some() && !is_live(head) {
                section_head.set(section, FaceId::NONE);
            }
        }
        for &f in faces {
            let section = infos[f.index()].section.index();
            if whole.get(section) == Some(&true) {
                continue;
            }
            let [prev, next] = section_links[f.index()];
            if prev.is_some() && !is_live(prev) {
                continue; // not the first of its run
            }
            let mut after = next;
            while after.is_some() && !is_live(after) {
                after = section_links[after.index()][1];
            }
            if prev.is_some() {
                let [before, _] = section_links[prev.index()];
                section_links.set(prev.index(), [before, after]);
            } else {
                section_head.set(section, after);
            }
            if after.is_some() {
                let [_, behind] = section_links[after.index()];
                section_links.set(after.index(), [prev, behind]);
            }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::NewFace;
    use crate::geometry::validate::tests::octahedron;

    /// Two octahedra side by side, faces of both in each of two sections.
    pub fn pair() -> Mesh {
        let one = octahedron();
        let faces = [one.faces(), &one.faces().iter().map(|f| f.map(|v| VertexId(v.0 + 6))).collect::<Vec<_>>()].concat();
        let wedges = faces.iter().map(|f| f.map(|v| WedgeId(v.0))).collect();
        let dress = |v: u32| Wedge { vertex: VertexId(v), group: WedgeId(v), ..one.wedge(WedgeId(0)) };
        let mut mesh = Mesh::build(12, faces, wedges, &[0; 16], (0..12).map(dress).collect());
        let sections: Vec<SectionId> = (0..16).map(|f| SectionId(f / 5 % 2)).collect();
        mesh.assign_sections(2, &sections);
        mesh
    }

    fn none(_: VertexId) -> [VertexId; 0] {
        []
    }

    #[test]
    fn components_part_and_come_back() {
        let mesh = pair();
        let second: Vec<FaceId> = (8..16).map(FaceId).collect();
        let mut map = Extraction::default();
        let piece = mesh.extract(&second, |_| [VertexId(1)], &mut map);
        assert_eq!(piece.validate(), Ok(()));
        assert_eq!((piece.face_count(), piece.vertex_slots(), piece.live_vertices().count()), (8, 7, 6));
        assert_eq!(map.vertex_from[..2], [VertexId(1), VertexId(6)]);
        assert_eq!(map.section_from, [SectionId(1), SectionId(0)]);
        let mut rest = mesh.clone();
        rest.remove_components(&second, map.vertex_from.iter().copied().filter(|v| v.0 > 5), &[]);
        assert_eq!(rest.validate(), Ok(()));
        assert_eq!((rest.face_count(), rest.live_vertices().count()), (8, 6));
        let hash = |mesh: &Mesh| {
            let mut hash = crate::geometry::StateHash::default();
            mesh.hash_arrays(&mut hash);
            hash.finish()
        };
        let removed = hash(&rest);
        let delta = rest.take_delta();
        let redo = rest.apply_delta(delta);
        assert_eq!(hash(&rest), hash(&mesh));
        rest.apply_delta(redo);
        assert_eq!(hash(&rest), removed);
        // slots of the dead are taken again
        let info = rest.face_info(FaceId(0));
        let part =
            |a: u32, b: u32, c: u32| NewFace { corners: [a, b, c].map(VertexId), wedges: [a, b, c].map(WedgeId), info, side: 0 };
        let faces: Vec<FaceId> = rest.live_faces().collect();
        let all: Vec<NewFace> = faces.iter().map(|&f| rest.face(f).map(|v| v.0)).map(|[a, b, c]| part(a, b, c)).collect();
        rest.replace_faces(&faces, &all, |_| 0, &mut TopologyScratch::default());
        assert_eq!(rest.validate(), Ok(()));
    }

    #[test]
    fn a_part_of_a_component_has_open_edges_and_groups_keep_a_leader() {
        let mesh = octahedron();
        let top: Vec<FaceId> = (0..4).map(FaceId).collect();
        let piece = mesh.extract(&top, none, &mut Extraction::default());
        assert_eq!(piece.validate(), Ok(()));
        assert_eq!((piece.face_count(), piece.vertex_slots()), (4, 5));
        let mut dressed = mesh.clone();
        let old = dressed.wedge(WedgeId(0));
        let copies = [0; 2].map(|_| dressed.add_wedge(old)); // of the group that wedge 0 leads
        for (f, copy) in [(FaceId(0), copies[0]), (FaceId(3), copies[1])] {
            let k = dressed.face(f).iter().position(|v| *v == VertexId(0)).unwrap();
            let mut wedges = dressed.face_wedges(f);
            wedges[k] = copy;
            dressed.face_wedges.set(f.index(), wedges);
        }
        let piece = dressed.extract(&top, none, &mut Extraction::default());
        assert_eq!(piece.validate(), Ok(()));
        let groups: Vec<WedgeId> = piece.wedges().iter().filter(|w| w.vertex == VertexId(0)).map(|w| w.group).collect();
        assert!(groups.len() == 2 && groups[0] == groups[1] && piece.wedge(groups[0]).group == groups[0]);
    }
}
