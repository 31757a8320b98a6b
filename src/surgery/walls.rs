//! Walls and a floor for what a body took out: the part of the body's surface that lies inside the solid (MATHS 5.7).
//!
//! The rim of the hole is a set of closed loops. Each of its edges lies on a facet of the body; where a loop goes over from one
//! facet to the next it crosses an edge of the body, and the wall goes on along that edge to the next crossing, or to a
//! corner of the body. So a facet's outline is made of rim chains and of pieces of body edges, and each piece is shared by
//! two facets. Which corners lie inside the solid follows from counting crossings; the counts agree around every
//! facet by construction. Therefore the walls close the hole as a combinatorial 2-manifold whatever the labels and
//! the rounding: geometry only decides where they run.

#[path = "wall_joins.rs"]
mod wall_joins;

use super::wall_mesh::{FacetMesh, Joined};
use crate::geometry::{HalfEdge, Plane, VertexId};
use glam::DVec3;
use wall_joins::Pairing;

/// The facets of a body: one a plane, with their corners.
#[derive(Clone, Debug, Default)]
pub struct Facets {
    /// Corners of the body.
    pub corners: [DVec3; 8],
    /// Corners of each plane's facet, counter-clockwise from outside: three or four.
    pub cycles: Vec<([u8; 4], usize)>,
    /// Facets (bits) that a rim does not pass through on its way round a corner: the joint that the blade comes from, whose
    /// corners are vertices of the rim already.
    pub avoided: u16,
    /// For each corner (bits), where it was looked at: whether it lies inside the solid.
    pub seen_inside: Option<u8>,
}

impl Facets {
    /// Adds the facet of the next plane.
    pub fn push(&mut self, cycle: &[u8]) {
        let mut all = [0; 4];
        all[..cycle.len()].copy_from_slice(cycle);
        self.cycles.push((all, cycle.len()));
    }

    /// Corners of facet `k`.
    pub fn cycle(&self, k: usize) -> &[u8] {
        let (all, len) = &self.cycles[k];
        &all[..*len]
    }

    /// Distance of the corner farthest from the first, metres; never 0.
    fn size(&self) -> f64 {
        self.corners.iter().map(|c| c.distance(self.corners[0])).fold(f64::MIN_POSITIVE, f64::max)
    }

    /// Bits of the planes whose facets hold corner `c`.
    pub fn planes_at(&self, c: u8) -> u16 {
        (0..self.cycles.len()).filter(|&k| self.cycle(k).contains(&c)).fold(0, |m, k| m | 1 << k)
    }
}

/// An edge of the hole's rim, in the direction that the wall's half-edge takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RimEdge {
    /// From here.
    pub from: VertexId,
    /// To here.
    pub to: VertexId,
    /// Planes that hold both ends by construction.
    pub planes: u16,
    /// The open half-edge of the surface, which runs the other way.
    pub open: HalfEdge,
}

/// A point of a wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WallPoint {
    /// A vertex of the rim.
    Rim(VertexId),
    /// A corner of the body, inside the solid.
    Corner(u8),
}

/// A triangle of a wall: indices into [`Walls::points`], counter-clockwise from inside the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WallTriangle {
    /// Its corners.
    pub corners: [u32; 3],
    /// The facet that it lies on.
    pub facet: u8,
}

/// Where two facets meet.
#[derive(Clone, Copy, Debug)]
struct BodyEdge {
    /// Lower facet, higher facet.
    facets: [u8; 2],
    /// Corners, in the order in which a wall on the lower facet runs past them.
    ends: [u8; 2],
}

#[derive(Clone, Copy, Debug)]
struct Chain {
    facet: u8,
    first: u32,
    len: u32,
    next: u32,
}

/// A rim loop goes over from one facet to another.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    edge: u8,
    /// Along the edge, 0 to 1.
    t: f64,
    /// True if it goes from the lower facet to the higher.
    rises: bool,
    leaves: u32,
    enters: u32,
}

/// What one end of a piece of a body edge is.
#[derive(Clone, Copy, Debug)]
enum End {
    Corner(u8, u16),
    Crossing(u32),
}

/// Builds walls; buffers are kept.
#[derive(Debug, Default)]
pub struct Walls {
    /// Result: points. The first are those of the rim.
    pub points: Vec<(WallPoint, DVec3)>,
    /// Result: triangles.
    pub triangles: Vec<WallTriangle>,
    /// Result: rim edges that belong to no closed loop, and get no wall.
    pub unclosed_edges: usize,
    /// Corners of the body (bits) that the walls go round though they were seen outside the solid.
    pub outside: u8,
    next: Vec<u32>,
    /// Edges of chains with a free end.
    open: Vec<bool>,
    labels: Vec<u8>,
    used: Vec<bool>,
    ring: Vec<u32>,
    edges: Vec<BodyEdge>,
    chains: Vec<Chain>,
    chain_points: Vec<u32>,
    sequence: Vec<u32>,
    crossings: Vec<Crossing>,
    flags: [u16; 8],
    corner_chains: Vec<(u8, u8, u16, u32)>,
    corner_points: Vec<(u8, u16, u32)>,
    outlines: Vec<(u8, u32, u32)>,
    outline_points: Vec<u32>,
    flat: Vec<[f64; 2]>,
    facet_mesh: FacetMesh,
    joined: Joined,
    facet_triangles: Vec<[u32; 3]>,
    /// Edges that one has been found to follow.
    follows: Vec<bool>,
    labels_before: Vec<u8>,
    pairing: Pairing,
}

const NONE: u32 = u32::MAX;
/// Edges and corners of a body, of one copy or two, that there is room for at first.
const BODY_EDGES: usize = 64;
/// What is no farther from a plane than this lies in it, in sizes of the body: as far as positions are stored.
const FLAT: f64 = 1e-6;

impl Walls {
    /// Makes room for walls on rims of so many edges.
    pub fn make_room(&mut self, edges: usize) {
        self.points.reserve(edges);
        self.triangles.reserve(2 * edges);
        for list in [&mut self.next, &mut self.ring, &mut self.chain_points, &mut self.sequence, &mut self.outline_points] {
            list.reserve(2 * edges);
        }
        for list in [&mut self.open, &mut self.used, &mut self.follows] {
            list.reserve(edges);
        }
        self.labels.reserve(edges);
        self.labels_before.reserve(edges);
        self.edges.reserve(BODY_EDGES);
        self.chains.reserve(edges);
        self.crossings.reserve(edges);
        self.corner_chains.reserve(BODY_EDGES);
        self.corner_points.reserve(BODY_EDGES);
        self.outlines.reserve(edges);
        self.flat.reserve(edges);
        self.facet_triangles.reserve(2 * edges);
        self.facet_mesh.make_room(edges);
        self.joined.make_room(edges);
        self.pairing.make_room(edges);
    }

    /// Builds the walls that close `rim` on the body with these `planes` and `facets`. Sorts `rim`.
    /// `taken` lists pairs of the rim's vertices that edges join.
    pub fn build(
        &mut self,
        rim: &mut [RimEdge],
        taken: &[[u32; 2]],
        planes: &[Plane],
        facets: &Facets,
        position: impl Fn(VertexId) -> DVec3,
    ) {
        self.clear();
        rim.sort_unstable_by_key(|e| (e.from, e.open));
        self.points.extend(rim.iter().map(|e| (WallPoint::Rim(e.from), position(e.from))));
        self.link(rim);
        self.label(rim, planes, facets);
        self.find_edges(facets);
        self.lay_rings(facets);
        self.find_flags(planes, facets);
        let wrong = self.contradictions(facets);
        if wrong > 0 {
            self.labels_before.clone_from(&self.labels);
            self.flatten_rings(planes, facets);
            self.lay_rings(facets);
            self.find_flags(planes, facets);
            if self.contradictions(facets) >= wrong {
                std::mem::swap(&mut self.labels, &mut self.labels_before);
                self.lay_rings(facets);
                self.find_flags(planes, facets);
            }
        }
        let seen = facets.seen_inside.unwrap_or(u8::MAX);
        self.outside = (0..8).filter(|&c| self.flags[c] > 0 && seen >> c & 1 == 0).fold(0, |bits, c| bits | 1 << c);
        for e in 0..self.edges.len() {
            self.join_along(e, facets);
        }
        self.trace_outlines();
        self.note_joined(taken);
        self.triangulate(planes, facets);
    }

    /// Numbers the points and notes which are joined before any facet is triangulated.
    fn note_joined(&mut self, taken: &[[u32; 2]]) {
        let Self { points, joined, outlines, outline_points, .. } = self;
        joined.vertices.clear();
        joined.vertices.extend(points.iter().enumerate().map(|(i, (point, _))| match point {
            WallPoint::Rim(v) => v.0,
            WallPoint::Corner(_) => u32::MAX - i as u32,
        }));
        joined.pairs.reset(&[], taken, false);
        for &(_, start, len) in outlines.iter() {
            let at = |i: u32| outline_points[(start + i % len) as usize];
            (0..len).for_each(|i| joined.join(at(i), at(i + 1)));
        }
    }

    fn clear(&mut self) {
        self.points.clear();
        self.triangles.clear();
        self.edges.clear();
        self.corner_chains.clear();
        self.corner_points.clear();
    }

    fn lay_rings(&mut self, facets: &Facets) {
        self.chains.clear();
        self.chain_points.clear();
        self.crossings.clear();
        self.outlines.clear();
        self.outline_points.clear();
        self.used.clone_from(&self.open);
        for i in 0..self.next.len() {
            if !self.used[i] {
                self.collect_ring(i);
                self.lay_ring(facets);
            }
        }
    }

    /// Corners not where they were seen: slivers of a rim in the plane of a facet may seem to go round an end of the body.
    fn contradictions(&self, facets: &Facets) -> usize {
        let differs = |c: usize, seen: u8| (self.flags[c] > 0) != (seen >> c & 1 == 1);
        facets.seen_inside.map_or(0, |seen| (0..8).filter(|&c| differs(c, seen)).count())
    }

    /// Lays every ring that runs in the plane of one facet onto that facet, but for the joint that the blade comes from.
    fn flatten_rings(&mut self, planes: &[Plane], facets: &Facets) {
        let thin = FLAT * facets.size();
        self.used.clone_from(&self.open);
        for start in 0..self.next.len() {
            if self.used[start] {
                continue;
            }
            self.collect_ring(start);
            let is_flat = |k: &usize| self.ring.iter().all(|&i| planes[*k].distance(self.points[i as usize].1).abs() <= thin);
            if let Some(k) = (0..planes.len()).filter(|k| facets.avoided >> k & 1 == 0).find(is_flat) {
                self.ring.iter().for_each(|&i| self.labels[i as usize] = k as u8);
            }
        }
    }

    /// Which edge follows which, and which are on chains with a free end.
    fn link(&mut self, rim: &[RimEdge]) {
        self.unclosed_edges = 0;
        self.next.clear();
        self.next.resize(rim.len(), NONE);
        self.open.clear();
        self.open.resize(rim.len(), false);
        let mut follows = std::mem::take(&mut self.follows);
        follows.clear();
        follows.resize(rim.len(), false);
        for i in 0..rim.len() {
            let mut at = rim.partition_point(|e| e.from < rim[i].to);
            while at < rim.len() && rim[at].from == rim[i].to && follows[at] {
                at += 1;
            }
            if at < rim.len() && rim[at].from == rim[i].to {
                self.next[i] = at as u32;
                follows[at] = true;
            }
        }
        for i in (0..rim.len()).filter(|&i| !follows[i]) {
            let mut at = i as u32;
            while at != NONE {
                self.open[at as usize] = true;
                self.unclosed_edges += 1;
                at = self.next[at as usize];
            }
        }
        self.follows = follows;
    }

    /// The facet of every rim edge: by tags, else the nearest.
    fn label(&mut self, rim: &[RimEdge], planes: &[Plane], facets: &Facets) {
        self.labels.clear();
        self.labels.resize(rim.len(), 0);
        for i in (0..rim.len()).filter(|&i| self.next[i] != NONE) {
            let (p, q) = (self.points[i].1, self.points[self.next[i] as usize].1);
            let all = (1u16 << planes.len()) - 1;
            let tagged = if rim[i].planes & all == 0 { all } else { rim[i].planes & all };
            let choice = (0..planes.len()).filter(|&k| tagged >> k & 1 == 1);
            let nearest = if tagged.count_ones() == 1 {
                tagged.trailing_zeros() as usize
            } else {
                let away = |k: usize| facet_distance(planes, facets, k, (p + q) / 2.0);
                choice.min_by(|&a, &b| away(a).total_cmp(&away(b))).unwrap_or(0)
            };
            self.labels[i] = nearest as u8;
        }
    }

    fn find_edges(&mut self, facets: &Facets) {
        for k in 0..facets.cycles.len() {
            let cycle = facets.cycle(k);
            for i in 0..cycle.len() {
                let (a, b) = (cycle[i], cycle[(i + 1) % cycle.len()]);
                let across = (k + 1..facets.cycles.len()).find(|&m| {
                    let other = facets.cycle(m);
                    (0..other.len()).any(|j| other[j] == b && other[(j + 1) % other.len()] == a)
                });
                if let Some(m) = across {
                    self.edges.push(BodyEdge { facets: [k as u8, m as u8], ends: [b, a] });
                }
            }
        }
    }

    fn edge_between(&self, a: u8, b: u8) -> Option<usize> {
        self.edges.iter().position(|e| e.facets == [a.min(b), a.max(b)])
    }

    fn collect_ring(&mut self, start: usize) {
        self.ring.clear();
        let mut at = start;
        while !self.used[at] {
            self.used[at] = true;
            self.ring.push(at as u32);
            at = self.next[at] as usize;
        }
    }

    /// Cuts a closed rim loop into chains, one a facet, and notes where it goes from facet to facet.
    fn lay_ring(&mut self, facets: &Facets) {
        let n = self.ring.len();
        let label = |w: &Self, i: usize| w.labels[w.ring[i % n] as usize];
        let Some(first) = (0..n).find(|&i| label(self, i) != label(self, i + n - 1)) else {
            let start = self.outline_points.len() as u32;
            self.outline_points.extend_from_slice(&self.ring);
            self.outlines.push((label(self, 0), start, n as u32));
            return;
        };
        self.sequence.clear();
        let mut start = first;
        while start < first + n {
            let facet = label(self, start);
            let end = (start + 1..first + n).find(|&i| label(self, i) != facet).unwrap_or(first + n);
            let from = self.chain_points.len() as u32;
            self.chain_points.extend((start..=end).map(|i| self.ring[i % n]));
            self.push_chain(facet, from);
            let to = label(self, end);
            let at = self.ring[end % n];
            let (path, len) = self.route(facet, to, self.points[at as usize].1, facets);
            for &between in &path[..len] {
                let from = self.chain_points.len() as u32;
                self.chain_points.push(at);
                self.push_chain(between, from);
            }
            start = end;
        }
        for i in 0..self.sequence.len() {
            let (leaves, enters) = (self.sequence[i], self.sequence[(i + 1) % self.sequence.len()]);
            let (a, b) = (self.chains[leaves as usize], self.chains[enters as usize]);
            let Some(edge) = self.edge_between(a.facet, b.facet) else { continue };
            let p = self.points[self.chain_points[b.first as usize] as usize].1;
            let t = edge_share(&self.edges[edge], facets, p);
            self.crossings.push(Crossing { edge: edge as u8, t, rises: a.facet < b.facet, leaves, enters });
        }
    }

    fn push_chain(&mut self, facet: u8, first: u32) {
        self.sequence.push(self.chains.len() as u32);
        let len = self.chain_points.len() as u32 - first;
        self.chains.push(Chain { facet, first, len, next: NONE });
    }

    /// How often each corner of the body is covered: once if it lies inside the solid, not at all outside. Differences
    /// along the body's edges follow from the crossings; if they leave it open, the constant follows from where the corners were
    /// seen, or from lengths and areas.
    fn find_flags(&mut self, planes: &[Plane], facets: &Facets) {
        let mut relative = [None::<i32>; 8];
        for c in 0..8u8 {
            if relative[c as usize].is_some() || facets.planes_at(c) == 0 {
                continue;
            }
            relative[c as usize] = Some(0);
            for _ in 0..8 {
                for (e, edge) in self.edges.iter().enumerate() {
                    let on = self.crossings.iter().filter(|x| x.edge as usize == e);
                    let rise: i32 = on.map(|x| if x.rises { 1 } else { -1 }).sum();
                    let [a, b] = edge.ends.map(usize::from);
                    match (relative[a], relative[b]) {
                        (Some(f), None) => relative[b] = Some(f + rise),
                        (None, Some(f)) => relative[a] = Some(f - rise),
                        _ => {}
                    }
                }
            }
        }
        let known = || relative.iter().flatten().copied();
        let (low, high) = (known().min().unwrap_or(0), known().max().unwrap_or(0));
        let all_inside = low == high
            && match facets.seen_inside {
                // a sliver of rounding in a plane of old walls covers nothing
                Some(seen) if seen.count_ones() % 8 == 0 => seen > 0,
                _ => self.covered(planes, facets) < 0.0,
            };
        self.flags = relative.map(|f| f.map_or(0, |f| (f - low + i32::from(all_inside)) as u16));
    }

    /// With all corners outside: how much of the body the loops cover, in lengths along edges or areas. Negative: it cannot be.
    fn covered(&self, planes: &[Plane], facets: &Facets) -> f64 {
        if !self.crossings.is_empty() {
            let length = |e: u8| {
                let [a, b] = self.edges[e as usize].ends.map(|c| facets.corners[c as usize]);
                a.distance(b)
            };
            return self.crossings.iter().map(|x| length(x.edge) * if x.rises { -x.t } else { x.t }).sum();
        }
        let loops = self.outlines.iter().map(|&(facet, start, len)| {
            let n = -planes[facet as usize].normal();
            let at = |i: u32| self.points[self.outline_points[(start + i % len) as usize] as usize].1;
            let o = at(0);
            (0..len).map(|i| (at(i) - o).cross(at(i + 1) - o).dot(n)).sum::<f64>()
        });
        loops.sum()
    }

    /// Follows chains around each facet.
    fn trace_outlines(&mut self) {
        for i in 0..self.chains.len() {
            if self.chains[i].len == 0 || self.chains[i].next == NONE {
                continue;
            }
            let start = self.outline_points.len() as u32;
            let facet = self.chains[i].facet;
            let mut at = i as u32;
            while at != NONE && self.chains[at as usize].len > 0 {
                let chain = &mut self.chains[at as usize];
                let range = chain.first as usize..(chain.first + chain.len) as usize;
                chain.len = 0;
                at = chain.next;
                self.outline_points.extend_from_slice(&self.chain_points[range]);
            }
            self.outlines.push((facet, start, self.outline_points.len() as u32 - start));
        }
    }

    fn triangulate(&mut self, planes: &[Plane], facets: &Facets) {
        for facet in 0..facets.cycles.len() {
            let of_facet = || self.outlines.iter().filter(|o| o.0 as usize == facet && o.2 > 2);
            if of_facet().next().is_none() {
                continue;
            }
            let [u, v] = facet_axes(planes, facets, facet);
            let origin = facets.corners[facets.cycle(facet)[0] as usize];
            self.flat.clear();
            self.flat.extend(self.points.iter().map(|(_, p)| [(*p - origin).dot(u), (*p - origin).dot(v)]));
            let loops = of_facet().map(|&(_, start, len)| &self.outline_points[start as usize..(start + len) as usize]);
            self.facet_triangles.clear();
            self.facet_mesh.triangulate(&self.flat, &mut self.joined, loops, &mut self.facet_triangles);
            let wall = |&corners: &[u32; 3]| WallTriangle { corners, facet: facet as u8 };
            self.triangles.extend(self.facet_triangles.iter().map(wall));
        }
    }
}

/// Unit axes of a facet's plane, `u x v` pointing into the body.
pub fn facet_axes(planes: &[Plane], facets: &Facets, facet: usize) -> [DVec3; 2] {
    let n = -planes[facet].normal();
    let cycle = facets.cycle(facet);
    let along = facets.corners[cycle[1] as usize] - facets.corners[cycle[0] as usize];
    let u = (along - n * along.dot(n)).try_normalize().unwrap_or_else(|| n.any_orthonormal_vector());
    [u, n.cross(u)]
}

/// How far `p` is from facet `k`: off its plane, or past its border.
fn facet_distance(planes: &[Plane], facets: &Facets, k: usize, p: DVec3) -> f64 {
    let cycle = facets.cycle(k);
    let n = planes[k].normal();
    let at = |i: usize| facets.corners[cycle[i % cycle.len()] as usize];
    let past = (0..cycle.len()).map(|i| {
        let side = (at(i + 1) - at(i)).cross(n).normalize_or_zero();
        (p - at(i)).dot(side)
    });
    past.fold(planes[k].distance(p).abs(), f64::max)
}

fn segment_distance(a: DVec3, b: DVec3, p: DVec3) -> f64 {
    let along = b - a;
    let t = ((p - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
    p.distance(a + along * if t.is_finite() { t } else { 0.0 })
}

/// Where `p` lies along a body edge, 0 to 1.
fn edge_share(edge: &BodyEdge, facets: &Facets, p: DVec3) -> f64 {
    let [a, b] = edge.ends.map(|c| facets.corners[c as usize]);
    let t = (p - a).dot(b - a) / (b - a).length_squared();
    if t.is_finite() { t } else { 0.5 }
}
