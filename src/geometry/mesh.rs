//! The triangle mesh that every edit works on: faces in reusable slots, half-edge adjacency, wedges for seams.
//!
//! Topology and attributes are apart: a face has three [`VertexId`] corners (what is connected) and three [`WedgeId`]
//! corners (what is drawn). Positions live elsewhere, since a vertex has many: at rest, skinned, displaced.
//! All arrays are [`Tracked`], so an edit costs and undoes in proportion to what it touches.

use super::ids::{FaceId, HalfEdge, SectionId, VertexId, WedgeId};
use super::room::headroom;
use super::tracked::Tracked;
use bytemuck::{Pod, Zeroable};

/// One vertex with one set of corner attributes. 32 bytes, mirrored by the GPU as it is.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Wedge {
    /// The topological vertex it dresses.
    pub vertex: VertexId,
    /// Smoothing group: the first wedge of this vertex that shares its normal. Face normals are gathered over a group.
    pub group: WedgeId,
    /// Texture coordinates, glTF convention (v down).
    pub uv: [f32; 2],
    /// Unit normal at rest.
    pub normal: [f32; 3],
    /// RGBA8 vertex colour, linear, little-endian (red lowest); white where the model has none.
    pub colour: u32,
}

/// What a face carries besides its corners.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct FaceInfo {
    /// Index into the tissue's materials.
    pub material: u32,
    /// Provenance: the face of the model as loaded (dense index) that this one is a part of; `u32::MAX` for caps and walls.
    pub origin: u32,
    /// The section that lists it.
    pub section: SectionId,
}

impl FaceInfo {
    /// True for caps and walls: faces that edits made inside the body, and no part of the surface as loaded.
    #[inline]
    pub fn is_interior(&self) -> bool {
        self.origin == u32::MAX
    }
}

/// A triangle mesh with adjacency. See the module's text.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    pub(super) faces: Tracked<[VertexId; 3]>,
    pub(super) opposite: Tracked<[HalfEdge; 3]>,
    pub(super) face_wedges: Tracked<[WedgeId; 3]>,
    pub(super) face_info: Tracked<FaceInfo>,
    pub(super) vertex_half_edge: Tracked<HalfEdge>,
    pub(super) wedges: Tracked<Wedge>,
    pub(super) free_faces: Tracked<FaceId>,
    pub(super) section_head: Tracked<FaceId>,
    pub(super) section_links: Tracked<[FaceId; 2]>,
}

crate::tracked_arrays!(Mesh => MeshDelta {
    faces: [VertexId; 3],
    opposite: [HalfEdge; 3],
    face_wedges: [WedgeId; 3],
    face_info: FaceInfo,
    vertex_half_edge: HalfEdge,
    wedges: Wedge,
    free_faces: FaceId,
    section_head: FaceId,
    section_links: [FaceId; 2],
});

impl Mesh {
    /// Makes room for the wedges of walls, which share few: three times what [`Mesh::make_room`] makes.
    pub fn make_room_for_walls(&mut self) {
        self.wedges.reserve(3 * headroom(self.wedges.len()));
    }

    /// Builds a mesh from `faces` (shape F x 3, indices below `vertices`, no face with a repeated vertex), their wedges
    /// (F x 3) and infos (F). Every face starts in section 0. Half-edges are paired where exactly two faces share an
    /// edge in opposite directions; other shared edges stay open. Vertices whose faces form several fans are *not*
    /// split here; see [`Mesh::split_fans`].
    pub fn build(
        vertices: usize,
        faces: Vec<[VertexId; 3]>,
        face_wedges: Vec<[WedgeId; 3]>,
        materials: &[u32],
        wedges: Vec<Wedge>,
    ) -> Self {
        debug_assert!(faces.len() == face_wedges.len() && faces.len() == materials.len());
        let face_info = (0..faces.len())
            .map(|f| FaceInfo { material: materials[f], origin: f as u32, section: SectionId(0) })
            .collect::<Vec<_>>();
        let mut mesh = Self {
            opposite: pair_half_edges(&faces).into(),
            vertex_half_edge: vec![HalfEdge::NONE; vertices].into(),
            faces: faces.into(),
            face_wedges: face_wedges.into(),
            face_info: face_info.into(),
            wedges: wedges.into(),
            free_faces: Vec::new().into(),
            section_head: Vec::new().into(),
            section_links: Vec::new().into(),
        };
        let mut first = vec![HalfEdge::NONE; vertices];
        for f in (0..mesh.faces.len()).rev() {
            for k in 0..3 {
                first[mesh.faces[f][k].index()] = HalfEdge::of(FaceId::new(f), k);
            }
        }
        mesh.vertex_half_edge = first.into();
        mesh.assign_sections(1, &vec![SectionId(0); mesh.faces.len()]);
        mesh
    }

    /// Puts every face into a section: `section[f]` below `sections`. Not an edit: open notes are dropped.
    pub fn assign_sections(&mut self, sections: usize, section: &[SectionId]) {
        let mut head = vec![FaceId::NONE; sections];
        let mut links = vec![[FaceId::NONE; 2]; self.faces.len()];
        let mut info = self.face_info.to_vec();
        for f in (0..self.faces.len()).rev().filter(|&f| self.is_live(FaceId::new(f))) {
            let s = section[f].index();
            info[f].section = section[f];
            links[f] = [FaceId::NONE, head[s]];
            if head[s].is_some() {
                links[head[s].index()][0] = FaceId::new(f);
            }
            head[s] = FaceId::new(f);
        }
        self.face_info = info.into();
        self.section_head = head.into();
        self.section_links = links.into();
    }

    /// Number of face slots, dead ones included: the length of every per-face array.
    pub fn face_slots(&self) -> usize {
        self.faces.len()
    }

    /// Number of live faces.
    pub fn face_count(&self) -> usize {
        self.faces.len() - self.free_faces.len()
    }

    /// Number of vertices ever made, dead ones included: the length of every per-vertex array.
    pub fn vertex_slots(&self) -> usize {
        self.vertex_half_edge.len()
    }

    /// True if some live face uses the vertex.
    pub fn vertex_is_live(&self, v: VertexId) -> bool {
        self.vertex_half_edge[v.index()].is_some()
    }

    /// True if the slot holds a face.
    #[inline]
    pub fn is_live(&self, f: FaceId) -> bool {
        self.faces[f.index()][0].is_some()
    }

    /// Live faces, by slot.
    pub fn live_faces(&self) -> impl Iterator<Item = FaceId> + '_ {
        (0..self.faces.len()).map(FaceId::new).filter(|&f| self.is_live(f))
    }

    /// Live vertices, by index.
    pub fn live_vertices(&self) -> impl Iterator<Item = VertexId> + '_ {
        (0..self.vertex_slots()).map(VertexId::new).filter(|&v| self.vertex_is_live(v))
    }

    /// Corners of a face slot; all [`VertexId::NONE`] when dead.
    #[inline]
    pub fn face(&self, f: FaceId) -> [VertexId; 3] {
        self.faces[f.index()]
    }

    /// What `of` says of each corner of a face. For innermost loops, where a map over the array is not inlined.
    #[inline(always)]
    pub fn corners<T>(&self, f: FaceId, of: impl Fn(VertexId) -> T) -> [T; 3] {
        let [a, b, c] = self.face(f);
        [of(a), of(b), of(c)]
    }

    /// Wedges of a face slot.
    #[inline]
    pub fn face_wedges(&self, f: FaceId) -> [WedgeId; 3] {
        self.face_wedges[f.index()]
    }

    /// True for a face of a cap or a wall: [`FaceInfo::is_interior`].
    #[inline]
    pub fn is_interior(&self, f: FaceId) -> bool {
        self.face_info[f.index()].is_interior()
    }

    /// Material, provenance and section of a face.
    #[inline]
    pub fn face_info(&self, f: FaceId) -> FaceInfo {
        self.face_info[f.index()]
    }

    /// One wedge.
    #[inline]
    pub fn wedge(&self, w: WedgeId) -> Wedge {
        self.wedges[w.index()]
    }

    /// All wedges: what the GPU mirrors.
    pub fn wedges(&self) -> &[Wedge] {
        &self.wedges
    }

    /// All face slots (F x 3 vertices).
    pub fn faces(&self) -> &[[VertexId; 3]] {
        &self.faces
    }

    /// All face slots (F x 3 wedges): the index buffer, where a dead slot repeats one wedge.
    pub fn all_face_wedges(&self) -> &[[WedgeId; 3]] {
        &self.face_wedges
    }

    /// Opposite half-edges of all face slots (F x 3).
    pub fn all_opposites(&self) -> &[[HalfEdge; 3]] {
        &self.opposite
    }

    /// One half-edge a vertex, [`HalfEdge::NONE`] where dead.
    pub fn all_vertex_half_edges(&self) -> &[HalfEdge] {
        &self.vertex_half_edge
    }

    /// Per-face infos of all slots.
    pub fn all_face_infos(&self) -> &[FaceInfo] {
        &self.face_info
    }

    /// The half-edge on the other side, [`HalfEdge::NONE`] at a border.
    #[inline]
    pub fn opposite(&self, h: HalfEdge) -> HalfEdge {
        self.opposite[h.face().index()][h.corner()]
    }

    /// The vertex that a half-edge leaves.
    #[inline]
    pub fn from(&self, h: HalfEdge) -> VertexId {
        self.faces[h.face().index()][h.corner()]
    }

    /// The vertex that a half-edge reaches.
    #[inline]
    pub fn to(&self, h: HalfEdge) -> VertexId {
        self.from(h.next())
    }

    /// Number of sections.
    pub fn sections(&self) -> usize {
        self.section_head.len()
    }

    /// Faces of a section.
    pub fn section_faces(&self, section: SectionId) -> impl Iterator<Item = FaceId> + '_ {
        let mut next = self.section_head[section.index()];
        std::iter::from_fn(move || {
            let f = next;
            f.is_some().then(|| {
                next = self.section_links[f.index()][1];
                f
            })
        })
    }

    /// Outgoing half-edges of `v`, counter-clockwise around its one fan, starting at a border if it has one.
    /// Visits only the fan of [`Mesh::all_vertex_half_edges`]; a valid mesh has no other.
    pub fn fan(&self, v: VertexId) -> impl Iterator<Item = HalfEdge> + '_ {
        let first = self.fan_start(self.vertex_half_edge[v.index()]);
        let mut next = first;
        std::iter::from_fn(move || {
            let h = next;
            h.is_some().then(|| {
                next = self.opposite(h.prev());
                if next == first {
                    next = HalfEdge::NONE;
                }
                h
            })
        })
    }

    /// The half-edge that leaves `v` along its border, if it has one.
    pub fn border_from(&self, v: VertexId) -> Option<HalfEdge> {
        self.fan(v).next().filter(|&h| self.opposite(h).is_none())
    }

    /// Vertices joined to `v` by an edge, counter-clockwise, each once.
    pub fn neighbours(&self, v: VertexId) -> impl Iterator<Item = VertexId> + '_ {
        let mut open_end = None;
        let mut fan = self.fan(v);
        std::iter::from_fn(move || match fan.next() {
            Some(h) => {
                open_end = self.opposite(h.prev()).is_none().then(|| self.from(h.prev()));
                Some(self.to(h))
            }
            None => open_end.take(),
        })
    }

    /// [`Mesh::neighbours`] as a list, which is cleared first: a closed fan, as most are, is walked round once.
    pub fn list_neighbours(&self, v: VertexId, out: &mut Vec<VertexId>) {
        out.clear();
        let (corners, opposites) = (self.faces.as_flattened(), self.opposite.as_flattened());
        let first = self.vertex_half_edge[v.index()];
        let mut h = first;
        while h.is_some() {
            out.push(corners[h.next().0 as usize]);
            h = opposites[h.prev().0 as usize];
            if h == first {
                return;
            }
        }
        out.clear();
        out.extend(self.neighbours(v));
    }

    /// Clockwise-most half-edge of the fan that holds `h` (`h` itself in a closed fan).
    pub(super) fn fan_start(&self, h: HalfEdge) -> HalfEdge {
        if h.is_none() {
            return h;
        }
        let mut at = h;
        loop {
            let back = self.opposite(at);
            if back.is_none() {
                return at;
            }
            at = back.next();
            if at == h {
                return h;
            }
        }
    }
}

/// Opposite half-edges of a triangle soup; edges that are not one opposite pair stay open.
fn pair_half_edges(faces: &[[VertexId; 3]]) -> Vec<[HalfEdge; 3]> {
    let mut edges: Vec<(u64, HalfEdge)> = Vec::with_capacity(faces.len() * 3);
    for (f, corners) in faces.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (corners[k].0, corners[(k + 1) % 3].0);
            edges.push((u64::from(a.min(b)) << 32 | u64::from(a.max(b)), HalfEdge::of(FaceId::new(f), k)));
        }
    }
    edges.sort_unstable();
    let mut opposite = vec![[HalfEdge::NONE; 3]; faces.len()];
    let from = |h: HalfEdge| faces[h.face().index()][h.corner()];
    for run in edges.chunk_by(|a, b| a.0 == b.0) {
        if let [(_, a), (_, b)] = *run
            && from(a) != from(b)
        {
            opposite[a.face().index()][a.corner()] = b;
            opposite[b.face().index()][b.corner()] = a;
        }
    }
    opposite
}
