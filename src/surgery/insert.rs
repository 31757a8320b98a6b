//! Inserting vertices: one per crossed edge and plane, with parents for its row and wedges for its corners (MATHS 1.2, 1.5).

use crate::geometry::{FxHashMap, HalfEdge, Mesh, NewFace, SplitVertex, VertexId, Wedge, WedgeId};
use glam::{DVec3, Vec3};

/// A vertex that an edit inserted: `sum of weight * parent`, weights sum to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewVertex {
    /// The vertex.
    pub vertex: VertexId,
    /// Two ends of the cut edge, three corners of the pierced face, or one vertex that was split.
    pub parents: [(VertexId, f64); 3],
    /// How many parents are meant.
    pub parent_count: usize,
    /// Final position in the pose of the edit: the same combination of the parents' final positions (MATHS 2.2).
    pub position: DVec3,
}

impl NewVertex {
    /// On the edge from `a` to `b`, given with their places, at parameter `t`.
    pub fn on_edge(vertex: VertexId, [a, b]: [(VertexId, DVec3); 2], t: f64) -> Self {
        let parents = [(a.0, 1.0 - t), (b.0, t), (VertexId::NONE, 0.0)];
        Self { vertex, parents, parent_count: 2, position: a.1.lerp(b.1, t) }
    }

    /// The copy that a fan split made: it lies where its original lies.
    pub fn copy_of(split: SplitVertex, position: DVec3) -> Self {
        let none = (VertexId::NONE, 0.0);
        Self { vertex: split.vertex, parents: [(split.from, 1.0), none, none], parent_count: 1, position }
    }

    /// The parents that are meant.
    pub fn parents(&self) -> &[(VertexId, f64)] {
        &self.parents[..self.parent_count]
    }
}

/// Gives the copy that a fan split made the marks of its original. `vertex` is whose a mark is.
pub fn copy_marks<T: Copy>(marks: &mut Vec<T>, split: SplitVertex, vertex: impl Fn(&mut T) -> &mut VertexId) {
    for i in 0..marks.len() {
        let mut mark = marks[i];
        if *vertex(&mut mark) == split.from {
            *vertex(&mut mark) = split.vertex;
            marks.push(mark);
        }
    }
}

/// A point where a plane crosses a mesh edge.
#[derive(Clone, Copy, Debug)]
pub struct EdgePoint {
    /// The vertex made there.
    pub vertex: VertexId,
    /// Plane number.
    pub plane: u8,
    /// Parameter from the lower vertex id to the higher.
    pub t: f64,
    /// True if the value falls from the lower vertex to the higher: on the way in.
    pub entering: bool,
    next: u32,
}

/// Points on mesh edges, keyed by the edge's sorted ends: neighbours find the same vertex.
#[derive(Debug, Default)]
pub struct EdgePoints {
    heads: FxHashMap<u64, u32>,
    points: Vec<EdgePoint>,
}

fn edge_key(a: VertexId, b: VertexId) -> u64 {
    u64::from(a.0.min(b.0)) << 32 | u64::from(a.0.max(b.0))
}

impl EdgePoints {
    /// Makes room for so many points.
    pub fn make_room(&mut self, points: usize) {
        self.heads.reserve(points);
        self.points.reserve(points);
    }

    /// Forgets all points.
    pub fn clear(&mut self) {
        self.heads.clear();
        self.points.clear();
    }

    /// True if nothing was inserted.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// True if the edge has points.
    pub fn contains(&self, a: VertexId, b: VertexId) -> bool {
        self.heads.contains_key(&edge_key(a, b))
    }

    /// The vertex of `plane` on edge `a`-`b`, if it was made already.
    pub fn find(&self, a: VertexId, b: VertexId, plane: u8) -> Option<VertexId> {
        self.on_edge(a, b).find(|p| p.plane == plane).map(|p| p.vertex)
    }

    /// Notes `vertex` on the edge from `a` to `b`, whose ends have values `value_a` and `value_b` of opposite signs.
    pub fn insert(&mut self, (a, value_a): (VertexId, f64), (b, value_b): (VertexId, f64), plane: u8, vertex: VertexId) {
        let (low, high) = if a < b { (value_a, value_b) } else { (value_b, value_a) };
        let index = self.points.len() as u32;
        let next = self.heads.insert(edge_key(a, b), index).unwrap_or(u32::MAX);
        self.points.push(EdgePoint { vertex, plane, t: super::clip::edge_parameter(low, high), entering: low > 0.0, next });
    }

    /// Points on an edge, newest first.
    pub fn on_edge(&self, a: VertexId, b: VertexId) -> impl Iterator<Item = &EdgePoint> + '_ {
        let mut next = self.heads.get(&edge_key(a, b)).copied().unwrap_or(u32::MAX);
        std::iter::from_fn(move || {
            let point = self.points.get(next as usize)?;
            next = point.next;
            Some(point)
        })
    }

    /// Points on the edge from `a` to `b` in that order, into `out`.
    pub fn sorted(&self, a: VertexId, b: VertexId, out: &mut Vec<EdgePoint>) {
        out.clear();
        out.extend(self.on_edge(a, b));
        out.sort_by(|p, q| p.t.total_cmp(&q.t).then(q.entering.cmp(&p.entering)));
        if a > b {
            out.reverse();
        }
    }
}

/// Makes wedges for inserted vertices; the faces on both sides of a smooth edge get the same one.
#[derive(Debug, Default)]
pub struct WedgeMaker {
    on_edges: FxHashMap<(u64, u32), WedgeId>,
    groups: FxHashMap<(u64, u32), WedgeId>,
}

impl WedgeMaker {
    /// Makes room for so many wedges.
    pub fn make_room(&mut self, wedges: usize) {
        self.on_edges.reserve(wedges);
        self.groups.reserve(wedges);
    }

    /// Forgets the wedges made so far.
    pub fn clear(&mut self) {
        self.on_edges.clear();
        self.groups.clear();
    }

    /// The two faces that the face of `h` becomes once `middle` halves that edge: the part of its start, then that of its end.
    pub fn halves(&mut self, mesh: &mut Mesh, h: HalfEdge, middle: VertexId) -> [NewFace; 2] {
        let (f, k) = (h.face(), h.corner());
        let (wedges, info) = (mesh.face_wedges(f), mesh.face_info(f));
        let [from, to, far] = [k, (k + 1) % 3, (k + 2) % 3].map(|k| wedges[k]);
        let [start, end, tip] = [mesh.from(h), mesh.to(h), mesh.from(h.prev())];
        let at_middle = self.on_edge(mesh, middle, from, to, 0.5);
        [
            NewFace { corners: [start, middle, tip], wedges: [from, at_middle, far], info, side: 0 },
            NewFace { corners: [middle, end, tip], wedges: [at_middle, to, far], info, side: 0 },
        ]
    }

    /// The wedge of `vertex` at parameter `t` from wedge `a` to wedge `b` of one face.
    pub fn on_edge(&mut self, mesh: &mut Mesh, vertex: VertexId, a: WedgeId, b: WedgeId, t: f64) -> WedgeId {
        let key = |a: WedgeId, b: WedgeId| (u64::from(a.0.min(b.0)) << 32 | u64::from(a.0.max(b.0)), vertex.0);
        if let Some(&wedge) = self.on_edges.get(&key(a, b)) {
            return wedge;
        }
        let (wa, wb) = (mesh.wedge(a), mesh.wedge(b));
        let groups = key(wa.group, wb.group);
        let mut wedge = blend(&[(wa, 1.0 - t), (wb, t)], vertex);
        wedge.group = self.groups.get(&groups).copied().unwrap_or(WedgeId::NONE);
        let id = mesh.add_wedge(wedge);
        self.groups.entry(groups).or_insert(id);
        self.on_edges.insert(key(a, b), id);
        id
    }

    /// The wedge of `vertex` pierced in a face with wedges `wedges`.
    pub fn in_face(&mut self, mesh: &mut Mesh, vertex: VertexId, wedges: [WedgeId; 3], weights: [f64; 3]) -> WedgeId {
        let corners: [(Wedge, f64); 3] = std::array::from_fn(|k| (mesh.wedge(wedges[k]), weights[k]));
        mesh.add_wedge(blend(&corners, vertex))
    }
}

/// Attributes at parameter `t` from wedge `a` to wedge `b` (MATHS 1.5); vertex and group are those of `a`.
pub(super) fn along_edge(a: &Wedge, b: &Wedge, t: f64) -> Wedge {
    let mix = |x: f32, y: f32| (f64::from(x) * (1.0 - t) + f64::from(y) * t) as f32;
    let normal = Vec3::from_array(std::array::from_fn(|k| mix(a.normal[k], b.normal[k])));
    let channel = |k: u32| {
        let [x, y] = [a.colour, b.colour].map(|c| f64::from(c >> (8 * k) & 0xff));
        ((x * (1.0 - t) + y * t).round() as u32) << (8 * k)
    };
    Wedge {
        uv: std::array::from_fn(|k| mix(a.uv[k], b.uv[k])),
        normal: normal.try_normalize().map_or(a.normal, |n| n.to_array()),
        colour: if a.colour == b.colour { a.colour } else { (0..4).fold(0, |all, k| all | channel(k)) },
        ..*a
    }
}

/// Attributes blended with the weights of the row (MATHS 1.5).
fn blend(corners: &[(Wedge, f64)], vertex: VertexId) -> Wedge {
    let sum = |f: &dyn Fn(&Wedge) -> f64| corners.iter().map(|(w, t)| f(w) * t).sum::<f64>();
    let normal = Vec3::from_array(std::array::from_fn(|k| sum(&|w| f64::from(w.normal[k])) as f32));
    let normal = normal.try_normalize().unwrap_or(Vec3::from_array(corners[0].0.normal));
    let colour = (0..4).fold(0, |all, k| all | (sum(&|w| f64::from(w.colour >> (8 * k) & 0xff)).round() as u32) << (8 * k));
    Wedge {
        vertex,
        group: WedgeId::NONE,
        uv: std::array::from_fn(|k| sum(&|w| f64::from(w.uv[k])) as f32),
        normal: normal.to_array(),
        colour,
    }
}
