//! Changing a [`Mesh`]: replacing faces by others, opening edges, splitting vertices whose faces fall into several fans.

use super::ids::{FaceId, HalfEdge, SectionId, VertexId, WedgeId};
use super::mesh::{FaceInfo, Mesh, Wedge};

/// A face to be put in by [`Mesh::replace_faces`].
#[derive(Clone, Copy, Debug)]
pub struct NewFace {
    /// Corners, counter-clockwise from outside.
    pub corners: [VertexId; 3],
    /// Wedges of the corners.
    pub wedges: [WedgeId; 3],
    /// Material, provenance, section.
    pub info: FaceInfo,
    /// Faces are joined only to faces of the same side: 0 for all but a plane cut, where the sides are 1 and 2.
    pub side: u8,
}

/// A vertex made by splitting another whose faces fell into several fans.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SplitVertex {
    /// The new vertex.
    pub vertex: VertexId,
    /// The vertex it was split from.
    pub from: VertexId,
}

/// Half-edges between the same two vertices that there is room for at once.
const TIED: usize = 16;

/// Scratch of the topology edits, kept between edits so that they do not allocate.
#[derive(Debug, Default)]
pub struct TopologyScratch {
    edges: Vec<(u64, u8, HalfEdge)>,
    removed: Vec<FaceId>,
    vertices: Vec<VertexId>,
    half_edges: Vec<HalfEdge>,
    order: Vec<u64>,
    /// Wedges of a fan, and their copies.
    copies: Vec<(WedgeId, WedgeId)>,
    /// Half-edges that stay, with the ones across them that went.
    cut: Vec<(HalfEdge, HalfEdge)>,
    /// Half-edges between the same two vertices, by the edges that they lie on.
    tied: Vec<(u32, HalfEdge)>,
    /// For each face to add the edges that its half-edges lie on: the lower half-edge of an edge that goes, or a number of its
    /// own for one that is new. It tells edges between the same two vertices apart. May be empty; used up by
    /// [`Mesh::replace_faces`].
    pub ties: Vec<[u32; 3]>,
    /// Faces added by the last [`Mesh::replace_faces`], in the order they were given.
    pub added: Vec<FaceId>,
}

impl TopologyScratch {
    /// Makes room for edits of so many faces.
    pub fn make_room(&mut self, faces: usize) {
        self.edges.reserve(6 * faces);
        self.removed.reserve(faces);
        self.vertices.reserve(faces);
        self.half_edges.reserve(3 * faces);
        self.order.reserve(6 * faces);
        self.copies.reserve(faces);
        self.cut.reserve(3 * faces);
        self.tied.reserve(TIED);
        self.ties.reserve(2 * faces);
        self.added.reserve(2 * faces);
    }
}

impl Mesh {
    /// Appends a vertex without faces.
    pub fn add_vertex(&mut self) -> VertexId {
        VertexId::new(self.vertex_half_edge.push(HalfEdge::NONE))
    }

    /// Appends a wedge; a `group` of [`WedgeId::NONE`] starts a group of its own.
    pub fn add_wedge(&mut self, mut wedge: Wedge) -> WedgeId {
        let id = WedgeId::new(self.wedges.len());
        if wedge.group.is_none() {
            wedge.group = id;
        }
        self.wedges.push(wedge);
        id
    }

    /// Removes `removed` (live, each once) and puts in `added`, joined among themselves and to the faces around the
    /// hole along edges with the same ends, opposite directions and the same side. Edges left without a partner become
    /// open. `side_of` tells the side of a surviving face at the hole's rim from its corners. Vertices may be left with several fans: call
    /// [`Mesh::split_fans`]. The ids of the added faces are left in `scratch.added`.
    pub fn replace_faces(
        &mut self,
        removed: &[FaceId],
        added: &[NewFace],
        side_of: impl Fn([VertexId; 3]) -> u8,
        scratch: &mut TopologyScratch,
    ) {
        scratch.edges.clear();
        scratch.cut.clear();
        scratch.removed.clear();
        scratch.removed.extend_from_slice(removed);
        scratch.removed.sort_unstable();
        for &f in &scratch.removed {
            for k in 0..3 {
                let out = self.opposite(HalfEdge::of(f, k));
                if out.is_some() && scratch.removed.binary_search(&out.face()).is_err() {
                    scratch.edges.push((self.edge_key(out), side_of(self.face(out.face())), out));
                    scratch.cut.push((out, HalfEdge::of(f, k)));
                    self.set_opposite(out, HalfEdge::NONE);
                }
            }
        }
        self.retarget_vertices(removed, scratch);
        for &f in removed {
            self.kill_face(f);
        }
        scratch.added.clear();
        for face in added {
            let id = self.put_face(face);
            scratch.added.push(id);
            for k in 0..3 {
                let h = HalfEdge::of(id, k);
                scratch.edges.push((self.edge_key(h), face.side, h));
            }
        }
        scratch.edges.sort_unstable();
        let mut tied = std::mem::take(&mut scratch.tied);
        for run in scratch.edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            if let [(.., a), (.., b)] = *run {
                self.pair(a, b);
            } else if run.len() > 2 && !scratch.ties.is_empty() {
                self.join_tied(run, scratch, &mut tied);
            }
        }
        scratch.tied = tied;
        scratch.ties.clear();
    }

    /// Joins half-edges between the same two vertices by the edges that they lie on.
    fn join_tied(&mut self, run: &[(u64, u8, HalfEdge)], scratch: &TopologyScratch, tied: &mut Vec<(u32, HalfEdge)>) {
        let tie = |h: HalfEdge| match scratch.added.iter().position(|&f| f == h.face()) {
            Some(i) => scratch.ties[i][h.corner()],
            None => scratch.cut.iter().find(|c| c.0 == h).map_or(h.0, |c| h.0.min(c.1.0)),
        };
        tied.clear();
        tied.extend(run.iter().map(|e| (tie(e.2), e.2)));
        tied.sort_unstable();
        for pair in tied.chunk_by(|a, b| a.0 == b.0) {
            if let [(_, a), (_, b)] = *pair {
                self.pair(a, b);
            }
        }
    }

    fn pair(&mut self, a: HalfEdge, b: HalfEdge) {
        if self.from(a) != self.from(b) {
            self.set_opposite(a, b);
            self.set_opposite(b, a);
        }
    }

    /// Puts in `added`, joined among themselves and to the open half-edges `rim` of faces that are there. Where more than two
    /// half-edges share their ends, they are joined in opposite pairs, so that a rim that is lined all along is closed.
    /// Vertices may be left with several fans: call [`Mesh::split_fans`]. The ids are left in `scratch.added`.
    pub fn line_rim(&mut self, rim: impl Iterator<Item = HalfEdge>, added: &[NewFace], scratch: &mut TopologyScratch) {
        scratch.edges.clear();
        scratch.edges.extend(rim.map(|h| (self.edge_key(h), 0, h)));
        scratch.added.clear();
        for face in added {
            let id = self.put_face(face);
            scratch.added.push(id);
            scratch.edges.extend((0..3).map(|k| HalfEdge::of(id, k)).map(|h| (self.edge_key(h), face.side, h)));
        }
        scratch.edges.sort_unstable();
        let TopologyScratch { edges, half_edges, .. } = scratch;
        for run in edges.chunk_by(|a, b| a.0 == b.0) {
            if let [(.., a), (.., b)] = *run {
                self.pair(a, b);
                continue;
            }
            // those that rise, then those that fall, each as they come
            let up = |h: &HalfEdge| self.from(*h) < self.to(*h);
            half_edges.clear();
            half_edges.extend(run.iter().map(|e| e.2).filter(up));
            let rising = half_edges.len();
            half_edges.extend(run.iter().map(|e| e.2).filter(|h| !up(h)));
            let (rising, falling) = half_edges.split_at(rising);
            for (&a, &b) in rising.iter().zip(falling) {
                self.set_opposite(a, b);
                self.set_opposite(b, a);
            }
        }
    }

    /// Joins two open half-edges that run between the same vertices in opposite directions.
    pub fn close_edge(&mut self, a: HalfEdge, b: HalfEdge) {
        debug_assert!(self.from(a) == self.to(b) && self.to(a) == self.from(b));
        self.set_opposite(a, b);
        self.set_opposite(b, a);
    }

    /// Opens an edge: the two faces no longer touch along it.
    pub fn open_edge(&mut self, h: HalfEdge) {
        let back = self.opposite(h);
        if back.is_some() {
            self.set_opposite(h, HalfEdge::NONE);
            self.set_opposite(back, HalfEdge::NONE);
        }
    }

    /// Gives each fan of faces around each of `vertices` a vertex of its own. The fan with the lowest half-edge keeps the
    /// vertex; the others get copies, appended to `out`. `incident` lists candidate faces around those vertices (all of
    /// them, in any order, repeats and dead ones allowed).
    pub fn split_fans(
        &mut self,
        vertices: &[VertexId],
        incident: &[FaceId],
        scratch: &mut TopologyScratch,
        out: &mut Vec<SplitVertex>,
    ) {
        scratch.vertices.clear();
        scratch.vertices.extend_from_slice(vertices);
        scratch.vertices.sort_unstable();
        scratch.vertices.dedup();
        // by vertex, then by half-edge
        scratch.order.clear();
        for &f in incident.iter().filter(|&&f| self.is_live(f)) {
            let face = self.face(f);
            for k in 0..3 {
                if scratch.vertices.binary_search(&face[k]).is_ok() {
                    scratch.order.push(u64::from(face[k].0) << 32 | u64::from(HalfEdge::of(f, k).0));
                }
            }
        }
        scratch.order.sort_unstable();
        scratch.order.dedup();
        let order = std::mem::take(&mut scratch.order);
        let vertex_of = |i: usize| VertexId((order[i] >> 32) as u32);
        let mut at = 0;
        while at < order.len() {
            let v = vertex_of(at);
            let end = (at..order.len()).find(|&i| vertex_of(i) != v).unwrap_or(order.len());
            let mut first_fan = true;
            for i in at..end {
                let h = HalfEdge(order[i] as u32);
                if self.from(h) != v {
                    continue; // an earlier fan of this vertex took it
                }
                if first_fan {
                    first_fan = false;
                    self.set_vertex_half_edge(v, h);
                    self.mark_fan(h, &mut scratch.edges);
                    continue;
                }
                if scratch.edges.binary_search_by_key(&h, |e| e.2).is_ok() {
                    continue;
                }
                let copy = self.add_vertex();
                self.reassign_fan(h, v, copy, &mut scratch.copies);
                out.push(SplitVertex { vertex: copy, from: v });
            }
            at = end;
        }
        scratch.order = order;
    }

    /// Collapses the edge `h` into its end: the faces on both sides go, and those around its start, `spokes`, named by the
    /// half-edges that leave it, get the end and a wedge of it instead. The caller has made sure that no two faces fall together
    /// (link condition) and that no edge around the start is open.
    pub fn collapse_edge(&mut self, h: HalfEdge, spokes: &[(HalfEdge, WedgeId)]) {
        let (from, to, back) = (self.from(h), self.to(h), self.opposite(h));
        for &(spoke, wedge) in spokes {
            let (f, k) = (spoke.face().index(), spoke.corner());
            let (mut corners, mut wedges) = (self.faces[f], self.face_wedges[f]);
            (corners[k], wedges[k]) = (to, wedge);
            self.faces.set(f, corners);
            self.face_wedges.set(f, wedges);
        }
        let gone = [h.face(), back.face()];
        // what stays on either side of a face that goes, the half-edge that leaves the collapsed edge first
        let beside = [[h.prev(), h.next()], [back.next(), back.prev()]].map(|s| s.map(|e| self.opposite(e)));
        let ends = [self.from(h.prev()), self.from(back.prev())];
        for ([a, b], tip) in [(beside[0], ends[0]), (beside[1], ends[1])] {
            for (at, across) in [(a, b), (b, a)] {
                if at.is_some() {
                    self.set_opposite(at, across);
                }
            }
            for v in [tip, to] {
                if gone.contains(&self.vertex_half_edge[v.index()].face()) {
                    let leaves = [a, a.next()].into_iter().find(|&e| self.from(e) == v);
                    self.set_vertex_half_edge(v, leaves.unwrap_or(HalfEdge::NONE));
                }
            }
        }
        self.set_vertex_half_edge(from, HalfEdge::NONE);
        gone.into_iter().for_each(|f| self.kill_face(f));
    }

    fn mark_fan(&self, h: HalfEdge, marked: &mut Vec<(u64, u8, HalfEdge)>) {
        marked.clear();
        let start = self.fan_start(h);
        let mut at = start;
        while at.is_some() {
            marked.push((0, 0, at));
            at = self.opposite(at.prev());
            if at == start {
                break;
            }
        }
        marked.sort_unstable_by_key(|e| e.2);
    }

    /// Moves the fan of `h` from vertex `v` to `copy`, with copies of its wedges.
    fn reassign_fan(&mut self, h: HalfEdge, v: VertexId, copy: VertexId, copies: &mut Vec<(WedgeId, WedgeId)>) {
        let start = self.fan_start(h);
        copies.clear();
        let mut at = start;
        while at.is_some() {
            let (f, k) = (at.face().index(), at.corner());
            let mut corners = self.faces[f];
            debug_assert_eq!(corners[k], v);
            corners[k] = copy;
            self.faces.set(f, corners);
            let mut wedges = self.face_wedges[f];
            wedges[k] = self.copy_wedge(wedges[k], copy, copies);
            self.face_wedges.set(f, wedges);
            at = self.opposite(at.prev());
            if at == start {
                break;
            }
        }
        self.set_vertex_half_edge(copy, h);
    }

    fn copy_wedge(&mut self, wedge: WedgeId, vertex: VertexId, copies: &mut Vec<(WedgeId, WedgeId)>) -> WedgeId {
        if let Some(&(_, copy)) = copies.iter().find(|c| c.0 == wedge) {
            return copy;
        }
        let old = self.wedge(wedge);
        let group = copies.iter().find(|c| self.wedge(c.0).group == old.group).map(|c| self.wedge(c.1).group);
        let copy = self.add_wedge(Wedge { vertex, group: group.unwrap_or(WedgeId::NONE), ..old });
        copies.push((wedge, copy));
        copy
    }

    /// Points vertices that lean on a face of `removed` at a surviving face of the hole's rim, or at none.
    fn retarget_vertices(&mut self, removed: &[FaceId], scratch: &mut TopologyScratch) {
        scratch.half_edges.clear();
        for &(.., out) in &scratch.edges {
            scratch.half_edges.extend([out, out.next()]); // in a surviving face: they leave the edge's two ends
        }
        scratch.half_edges.sort_unstable_by_key(|&h| (self.from(h), h));
        for &f in removed {
            for v in self.face(f) {
                let at = self.vertex_half_edge[v.index()];
                if at.is_some() && scratch.removed.binary_search(&at.face()).is_ok() {
                    let i = scratch.half_edges.partition_point(|&h| self.from(h) < v);
                    let survivor = scratch.half_edges.get(i).copied().filter(|&h| self.from(h) == v);
                    self.set_vertex_half_edge(v, survivor.unwrap_or(HalfEdge::NONE));
                }
            }
        }
    }

    fn kill_face(&mut self, f: FaceId) {
        self.unlink_section(f);
        self.faces.set(f.index(), [VertexId::NONE; 3]);
        self.opposite.set(f.index(), [HalfEdge::NONE; 3]);
        self.free_faces.push(f);
    }

    fn put_face(&mut self, face: &NewFace) -> FaceId {
        let id = match self.free_faces.pop() {
            Some(f) => {
                self.faces.set(f.index(), face.corners);
                self.face_wedges.set(f.index(), face.wedges);
                self.face_info.set(f.index(), face.info);
                if self.opposite[f.index()] != [HalfEdge::NONE; 3] {
                    self.opposite.set(f.index(), [HalfEdge::NONE; 3]); // the slot of a piece that has left
                }
                f
            }
            None => {
                self.face_wedges.push(face.wedges);
                self.face_info.push(face.info);
                self.opposite.push([HalfEdge::NONE; 3]);
                self.section_links.push([FaceId::NONE; 2]);
                FaceId::new(self.faces.push(face.corners))
            }
        };
        self.link_section(id, face.info.section);
        for k in 0..3 {
            if self.vertex_half_edge[face.corners[k].index()].is_none() {
                self.set_vertex_half_edge(face.corners[k], HalfEdge::of(id, k));
            }
        }
        id
    }

    pub(super) fn link_section(&mut self, f: FaceId, section: SectionId) {
        let head = self.section_head[section.index()];
        self.section_links.set(f.index(), [FaceId::NONE, head]);
        if head.is_some() {
            let [_, next] = self.section_links[head.index()];
            self.section_links.set(head.index(), [f, next]);
        }
        self.section_head.set(section.index(), f);
    }

    fn unlink_section(&mut self, f: FaceId) {
        let [prev, next] = self.section_links[f.index()];
        if next.is_some() {
            let [_, after] = self.section_links[next.index()];
            self.section_links.set(next.index(), [prev, after]);
        }
        if prev.is_some() {
            let [before, _] = self.section_links[prev.index()];
            self.section_links.set(prev.index(), [before, next]);
        } else {
            self.section_head.set(self.face_info[f.index()].section.index(), next);
        }
        self.section_links.set(f.index(), [FaceId::NONE; 2]);
    }

    fn set_opposite(&mut self, h: HalfEdge, to: HalfEdge) {
        let f = h.face().index();
        let mut row = self.opposite[f];
        row[h.corner()] = to;
        self.opposite.set(f, row);
    }

    fn set_vertex_half_edge(&mut self, v: VertexId, h: HalfEdge) {
        if self.vertex_half_edge[v.index()] != h {
            self.vertex_half_edge.set(v.index(), h);
        }
    }

    fn edge_key(&self, h: HalfEdge) -> u64 {
        let (a, b) = (self.from(h).0, self.to(h).0);
        u64::from(a.min(b)) << 32 | u64::from(a.max(b))
    }
}
