//! The closed tear: what [`super::tear`] does besides when walls line the slit (MATHS 5.7).

use super::boxes::Side;
use super::insert::NewVertex;
use super::region::smallest_sine;
use super::tear::{Body, LipPoint, OnPlanes, TearScratch, TearStep};
use super::wall_thin::{Slack, Thinner};
use super::walls::{Facets, RimEdge, WallPoint, Walls, facet_axes};
use crate::geometry::{FaceId, FaceInfo, FxHashMap, HalfEdge, Mesh, NewFace, SectionId, SplitVertex, VertexId, Wedge, WedgeId};
use glam::{DMat3, DVec3};

/// What a closed tear is told besides the body.
#[derive(Clone, Copy, Debug)]
pub struct WallSpec<'a> {
    /// The body's facets, one a plane.
    pub facets: &'a Facets,
    /// Faces that go in any case, sorted: the end wall of the box before.
    pub remove: &'a [FaceId],
    /// Faces that the body leaves alone, sorted: the other walls of the box before, which only touch it.
    pub keep: &'a [FaceId],
    /// Material of the walls.
    pub material: u32,
    /// What stored positions cannot tell apart, metres: old walls that the body cuts are thinned to it.
    pub grain: f64,
    /// ... and those that tissue has bent since they were made to this: the same where it has held still, and lips are thinned, too.
    pub bent: f64,
    /// Turns a normal of the pose into one at rest, up to its length.
    pub rest_from_posed: DMat3,
}

/// Buffers of the walls, kept between steps.
#[derive(Default)]
pub(super) struct WallScratch {
    /// Half-edges of faces around the hole, then the rim.
    rim: Vec<HalfEdge>,
    /// Directed edges that were open before.
    borders: Vec<(VertexId, VertexId)>,
    /// Planes that inserted vertices lie on.
    bits: Vec<(VertexId, u16)>,
    edges: Vec<RimEdge>,
    walls: Walls,
    /// Vertices of the rim that edges of the surface join.
    taken: Vec<[u32; 2]>,
    vertices: Vec<VertexId>,
    wedges: FxHashMap<u64, WedgeId>,
    faces: Vec<NewFace>,
    split: Vec<SplitVertex>,
    /// Faces of walls that the body cuts and that are neither to go nor to be left alone.
    walls_cut: usize,
    thinner: Thinner,
    /// Scratch: the rim's vertices, sorted, and the sections of the faces across its edges.
    rim_vertices: Vec<VertexId>,
    sections: Vec<SectionId>,
    /// Scratch: vertices that may go, and what is tagged, each with its tag.
    thinned: Vec<VertexId>,
    tagged: Vec<(VertexId, i8)>,
}

impl WallScratch {
    /// Makes room for walls on rims of so many edges.
    pub(super) fn make_room(&mut self, edges: usize) {
        self.rim.reserve(2 * edges);
        self.borders.reserve(2 * edges);
        self.bits.reserve(edges);
        self.edges.reserve(edges);
        self.walls.make_room(edges);
        self.taken.reserve(2 * edges);
        self.vertices.reserve(edges);
        self.wedges.reserve(2 * edges);
        self.faces.reserve(2 * edges);
        self.split.reserve(edges);
        self.rim_vertices.reserve(edges);
        self.sections.reserve(edges);
        self.thinner.make_room(edges);
        self.thinned.reserve(8 * edges);
        self.tagged.reserve(edges);
    }

    pub(super) fn clear(&mut self) {
        self.walls_cut = 0;
        self.rim.clear();
        self.borders.clear();
        self.bits.clear();
        self.edges.clear();
        self.vertices.clear();
        self.wedges.clear();
        self.faces.clear();
        self.split.clear();
    }

    /// Notes the planes of a point of the clipped polygon.
    pub(super) fn note_bits(&mut self, vertex: VertexId, planes: u16) {
        self.bits.push((vertex, planes));
    }

    /// Notes a piece of an edge that was open before.
    pub(super) fn note_border(&mut self, from: VertexId, to: VertexId) {
        self.borders.push((from, to));
    }

    /// Before the faces are replaced: half-edges of faces that stay, along the hole.
    pub(super) fn note_surroundings(&mut self, mesh: &Mesh, removed: &[FaceId], spec: &WallSpec) {
        let is_old = |f: &FaceId| spec.remove.binary_search(f).is_err() && spec.keep.binary_search(f).is_err();
        self.walls_cut = removed.iter().filter(|f| mesh.is_interior(**f) && is_old(f)).count();
        for h in removed.iter().flat_map(|&f| (0..3).map(move |k| HalfEdge::of(f, k))) {
            let back = mesh.opposite(h);
            if back.is_some() && removed.binary_search(&back.face()).is_err() {
                self.rim.push(back);
            }
        }
    }

    /// After it, and before vertices are split: what is open now and was not.
    pub(super) fn collect_rim(&mut self, mesh: &Mesh, added: &[FaceId]) {
        self.borders.sort_unstable();
        let borders = &self.borders;
        let inner = added.iter().flat_map(|&f| (0..3).map(move |k| HalfEdge::of(f, k)));
        self.rim.extend(inner.filter(|&h| borders.binary_search(&(mesh.from(h), mesh.to(h))).is_err()));
        self.rim.retain(|&h| mesh.opposite(h).is_none());
        self.rim.sort_unstable();
        self.rim.dedup();
    }

    /// The planes of `v`'s original, if it was inserted.
    fn inserted_bits(&self, v: VertexId) -> u16 {
        let first = self.bits.partition_point(|b| b.0 < v);
        self.bits[first..].iter().take_while(|b| b.0 == v).fold(0, |m, b| m | b.1)
    }
}

impl TearScratch {
    /// Lines the hole that the clip has left.
    pub(super) fn line(
        &mut self,
        mesh: &mut Mesh,
        body: &Body,
        spec: &WallSpec,
        position: &impl Fn(VertexId) -> DVec3,
        tags: &[OnPlanes],
        out: &mut TearStep,
    ) {
        let mut lining = std::mem::take(&mut self.lining);
        lining.bits.sort_unstable();
        let first_new = out.new_vertices.first().map_or(mesh.vertex_slots(), |n| n.vertex.index());
        for i in 0..lining.rim.len() {
            let open = lining.rim[i];
            let (from, to) = (mesh.to(open), mesh.from(open));
            let [a, b] = [from, to].map(|v| self.planes_of(mesh, v, first_new, &lining, body, position, tags));
            lining.edges.push(RimEdge { from, to, planes: without_start(a & b, body), open });
        }
        let at = |v: VertexId| match v.index().checked_sub(first_new) {
            Some(i) => out.new_vertices[i].position,
            None => self.positions[self.slot[v.index()] as usize],
        };
        lining.note_taken(mesh);
        lining.walls.build(&mut lining.edges, &lining.taken, body.planes, spec.facets, at);
        out.unclosed_edges = lining.walls.unclosed_edges;
        out.corners_outside = lining.walls.outside;
        lining.make_vertices(mesh, spec);
        for (i, &vertex) in lining.vertices.iter().enumerate().skip(lining.edges.len()) {
            let (WallPoint::Corner(c), at) = lining.walls.points[i] else { continue };
            let parent = lining.nearest_rim(mesh, at);
            let none = (VertexId::NONE, 0.0);
            out.new_vertices.push(NewVertex { vertex, parents: [(parent, 1.0), none, none], parent_count: 0, position: at });
            self.note_corner(body, vertex, spec.facets.planes_at(c), out);
        }
        lining.make_faces(mesh, body, spec);
        mesh.line_rim(lining.rim.iter().copied(), &lining.faces, &mut self.topology);
        for t in &lining.walls.triangles {
            let [p, q, r] = t.corners.map(|c| lining.walls.points[c as usize].1);
            out.smallest_sine = out.smallest_sine.min(smallest_sine(p, q, r));
        }
        let sides = lining.walls.triangles.iter().map(|t| body.sides[t.facet as usize]);
        out.walls.extend(self.topology.added.iter().copied().zip(sides));
        self.incident.extend_from_slice(&self.topology.added);
        lining.split.clear();
        mesh.split_fans(&lining.vertices, &self.incident, &mut self.topology, &mut lining.split);
        for &split in &lining.split {
            self.note_split(split, out);
        }
        out.walls_cut = lining.walls_cut;
        if lining.walls_cut > 0 {
            self.thin(mesh, &mut lining, spec, position, out);
        }
        self.lining = lining;
    }

    /// Takes out what the walls around the hole do not need. What is tagged stays as it is, or goes into what is tagged alike.
    fn thin(
        &mut self,
        mesh: &mut Mesh,
        lining: &mut WallScratch,
        spec: &WallSpec,
        position: &impl Fn(VertexId) -> DVec3,
        out: &mut TearStep,
    ) {
        let faces = out.walls.iter().map(|w| w.0).chain(out.added_faces.iter().copied());
        let WallScratch { thinned, tagged, thinner, .. } = lining;
        thinned.clear();
        thinned.extend(faces.flat_map(|f| mesh.face(f)));
        tagged.clear();
        tagged.extend(self.zero.iter().map(|z| (z.vertex, 0)));
        tagged.extend(out.lips.iter().map(|l| (l.vertex, l.side)));
        tagged.sort_unstable();
        let may = |v: VertexId, into: VertexId| {
            let first = tagged.partition_point(|t| t.0 < v);
            tagged[first..].iter().take_while(|t| t.0 == v).all(|t| tagged.binary_search(&(into, t.1)).is_ok())
        };
        let first_new = out.new_vertices.first().map_or(mesh.vertex_slots(), |n| n.vertex.index());
        let at = |v: VertexId| v.index().checked_sub(first_new).map_or_else(|| position(v), |i| out.new_vertices[i].position);
        thinner.thin(mesh, thinned, Slack { grain: spec.grain, bent: spec.bent }, &at, &may);
        out.walls.retain(|w| mesh.is_live(w.0));
        out.added_faces.retain(|&f| mesh.is_live(f));
        out.widened_faces.extend(lining.thinner.changed.iter().filter(|&&f| mesh.is_live(f)));
        out.touched.extend(lining.thinner.gone.iter().filter(|v| v.index() < first_new));
        out.touched.sort_unstable();
        out.touched.dedup();
    }

    /// Planes that `v` lies on by construction or exactly.
    #[allow(clippy::too_many_arguments)]
    fn planes_of(
        &mut self,
        mesh: &Mesh,
        v: VertexId,
        first_new: usize,
        lining: &WallScratch,
        body: &Body,
        position: &impl Fn(VertexId) -> DVec3,
        tags: &[OnPlanes],
    ) -> u16 {
        let mut v = v;
        while let Some(split) = self.split.iter().find(|s| s.vertex == v) {
            v = split.from;
        }
        if v.index() >= first_new {
            return lining.inserted_bits(v);
        }
        let slot = self.slot(mesh, v, body, position, tags);
        self.planes_through(slot, body)
    }

    /// A corner of the body is on a lip, and may be on the end joint.
    fn note_corner(&mut self, body: &Body, vertex: VertexId, planes: u16, out: &mut TearStep) {
        let on = |side: Side| (0..body.planes.len()).any(|k| planes >> k & 1 == 1 && body.sides[k] == side);
        if on(Side::Minus) || on(Side::Plus) {
            out.lips.push(LipPoint { vertex, side: if on(Side::Minus) { -1 } else { 1 } });
        }
        if on(Side::End) {
            self.zero.push(OnPlanes { vertex, planes });
        }
    }
}

/// Rim edges on the start joint belong to the side that goes on from there, if there is one.
fn without_start(planes: u16, body: &Body) -> u16 {
    let start = (0..body.planes.len()).filter(|&k| body.sides[k] == Side::Start).fold(0, |m, k| m | 1 << k);
    if planes & !start != 0 { planes & !start } else { planes }
}

impl WallScratch {
    /// Notes which vertices of the rim are joined.
    fn note_taken(&mut self, mesh: &Mesh) {
        let rim = &mut self.rim_vertices;
        rim.clear();
        rim.extend(self.edges.iter().map(|e| e.from));
        rim.sort_unstable();
        rim.dedup();
        self.taken.clear();
        for &v in &*rim {
            let near = mesh.neighbours(v).filter(|w| *w > v && rim.binary_search(w).is_ok());
            self.taken.extend(near.map(|w| [v.0, w.0]));
        }
    }

    /// Vertices of the wall's points: the rim's, then new ones for corners inside the solid.
    fn make_vertices(&mut self, mesh: &mut Mesh, spec: &WallSpec) {
        debug_assert_eq!(spec.facets.corners.len(), 8);
        let vertex = |point: &(WallPoint, DVec3)| match point.0 {
            WallPoint::Rim(v) => v,
            WallPoint::Corner(_) => mesh.add_vertex(),
        };
        self.vertices.extend(self.walls.points.iter().map(vertex));
    }

    /// The rim's vertex nearest to a corner of the body: what moves it besides bones, and what those are where it hangs on no skin. One
    /// of the model's own surface, where there is any: from walls, bones would be handed on from box to box along the whole slit.
    fn nearest_rim(&self, mesh: &Mesh, p: DVec3) -> VertexId {
        let key = |i: usize| {
            let is_wall = mesh.is_interior(self.edges[i].open.face());
            (is_wall, self.walls.points[i].1.distance_squared(p))
        };
        let rim = (0..self.edges.len()).map(|i| (key(i), i));
        let nearest = rim.min_by(|a, b| a.0.0.cmp(&b.0.0).then(a.0.1.total_cmp(&b.0.1)));
        nearest.map_or(VertexId::NONE, |(_, i)| self.vertices[i])
    }

    fn make_faces(&mut self, mesh: &mut Mesh, body: &Body, spec: &WallSpec) {
        let section_of = |open: HalfEdge| mesh.face_info(open.face()).section;
        let mut sections = std::mem::take(&mut self.sections);
        sections.clear();
        sections.extend(self.edges.iter().map(|e| section_of(e.open)));
        for t in 0..self.walls.triangles.len() {
            let triangle = self.walls.triangles[t];
            let near = triangle.corners.iter().find_map(|&p| sections.get(p as usize)).or(sections.first());
            let section = near.copied().unwrap_or(SectionId(0));
            let wedges = triangle.corners.map(|p| self.wedge(mesh, body, spec, triangle.facet, p));
            let info = FaceInfo { material: spec.material, origin: u32::MAX, section };
            let corners = triangle.corners.map(|p| self.vertices[p as usize]);
            self.faces.push(NewFace { corners, wedges, info, side: triangle.facet + 1 });
        }
        self.sections = sections;
    }

    /// The wedge of a point on one facet: a group of its own, so that the facet is shaded flat; uv in metres along it.
    fn wedge(&mut self, mesh: &mut Mesh, body: &Body, spec: &WallSpec, facet: u8, point: u32) -> WedgeId {
        let key = u64::from(facet) << 32 | u64::from(point);
        if let Some(&known) = self.wedges.get(&key) {
            return known;
        }
        let [u, v] = facet_axes(body.planes, spec.facets, facet as usize);
        let from_corner =
            self.walls.points[point as usize].1 - spec.facets.corners[spec.facets.cycle(facet as usize)[0] as usize];
        let normal = (spec.rest_from_posed * u.cross(v)).try_normalize().unwrap_or(DVec3::Z);
        let id = mesh.add_wedge(Wedge {
            vertex: self.vertices[point as usize],
            group: WedgeId::NONE,
            uv: [from_corner.dot(u) as f32, from_corner.dot(v) as f32],
            normal: normal.as_vec3().to_array(),
            colour: u32::MAX,
        });
        self.wedges.insert(key, id);
        id
    }
}
