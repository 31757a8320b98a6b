//! Triangulates the walls of one facet: directed loops in its plane, region to the left, any number, holes allowed.
//!
//! Every directed loop edge lies in exactly one triangle and every other edge in two opposed ones, whatever the geometry:
//! ears are only *chosen* by geometry. Two edges that run back and forth between the same points cancel instead. No edge joins
//! two points that one joins already, here or elsewhere in the mesh: the next box could not tell them apart.

use crate::geometry::Pairs;
use crate::geometry::predicates::orient2d;

/// Doubled area over the longest side squared that counts as none. A lip on a flat skin is a straight line but for rounding:
/// an ear that cut off all of it would leave slivers.
const FLAT: f64 = 1e-11;

/// Rings and holes of a facet that there is room for at first.
const RINGS: usize = 16;

/// The rings of one facet, holes joined to them, and the one that is being cut up.
#[derive(Clone, Debug, Default)]
pub struct FacetMesh {
    rings: Vec<Vec<u32>>,
    ring: Vec<u32>,
    corners: Vec<Corner>,
    /// Which of the loops are holes.
    holes: Vec<Hole>,
    /// Scratch: a ring that grows by a hole.
    grown: Vec<u32>,
    /// Rings that are no more.
    spare: Vec<Vec<u32>>,
}

/// A hole: its number among the loops, and how far it goes to the right.
type Hole = (usize, f64);

/// Points of all facets as the mesh knows them, and which of them are joined.
#[derive(Debug, Default)]
pub struct Joined {
    /// A number for each point, the same for points that are one vertex.
    pub vertices: Vec<u32>,
    /// Pairs of such numbers.
    pub pairs: Pairs,
}

impl Joined {
    /// Makes room for so many points.
    pub fn make_room(&mut self, points: usize) {
        self.vertices.reserve(points);
        self.pairs.make_room(4 * points);
    }

    /// True if an edge joins the points.
    fn holds(&self, a: u32, b: u32) -> bool {
        self.pairs.contains(self.vertices[a as usize], self.vertices[b as usize])
    }

    /// Notes an edge.
    pub fn join(&mut self, a: u32, b: u32) {
        self.pairs.insert(self.vertices[a as usize], self.vertices[b as usize]);
    }
}

impl FacetMesh {
    /// Triangulates `loops` (indices into `points`), appending to `out`. `joined` holds the edges of the loops, and gets the
    /// edges between triangles.
    pub fn triangulate<'a>(
        &mut self,
        points: &[[f64; 2]],
        joined: &mut Joined,
        loops: impl Iterator<Item = &'a [u32]> + Clone,
        out: &mut Vec<[u32; 3]>,
    ) {
        self.spare.append(&mut self.rings);
        let mut holes = std::mem::take(&mut self.holes);
        holes.clear();
        for (i, points_of) in loops.clone().enumerate() {
            if doubled_area(points, points_of) >= 0.0 {
                self.push_ring(points_of);
            } else {
                holes.push((i, points_of.iter().map(|&p| points[p as usize][0]).fold(f64::NEG_INFINITY, f64::max)));
            }
        }
        // from the right to the left, as rings grow by the holes they swallow
        holes.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        for hole in holes.iter().filter_map(|hole| loops.clone().nth(hole.0)) {
            match self.ring_around(points, hole) {
                Some(ring) => self.bridge(points, joined, ring, hole),
                None => self.push_ring(hole),
            }
        }
        self.holes = holes;
        for ring in 0..self.rings.len() {
            std::mem::swap(&mut self.ring, &mut self.rings[ring]);
            self.clip_ears(points, joined, out);
        }
    }

    /// Makes room for facets of so many edges.
    pub fn make_room(&mut self, edges: usize) {
        self.rings.reserve(RINGS);
        self.spare.resize_with(RINGS, || Vec::with_capacity(edges));
        self.ring.reserve(edges);
        self.corners.reserve(edges);
        self.holes.reserve(RINGS);
        self.grown.reserve(edges);
    }

    fn push_ring(&mut self, points_of: &[u32]) {
        let mut ring = self.spare.pop().unwrap_or_default();
        ring.clear();
        ring.extend_from_slice(points_of);
        self.rings.push(ring);
    }

    /// The smallest ring that holds the hole's first point.
    fn ring_around(&self, points: &[[f64; 2]], hole: &[u32]) -> Option<usize> {
        let p = points[hole[0] as usize];
        let around = (0..self.rings.len()).filter(|&r| contains(points, &self.rings[r], p));
        let area = |r: usize| doubled_area(points, &self.rings[r]);
        let inside = around.min_by(|&a, &b| area(a).total_cmp(&area(b)));
        inside.or_else(|| (0..self.rings.len()).max_by(|&a, &b| area(a).total_cmp(&area(b))))
    }

    /// Joins a hole to a ring by the shortest bridge that crosses nothing.
    fn bridge(&mut self, points: &[[f64; 2]], joined: &mut Joined, ring: usize, hole: &[u32]) {
        let outer = &self.rings[ring];
        let at = |p: u32| points[p as usize];
        let mut best = (f64::INFINITY, 0, 0);
        let mut shortest = (f64::INFINITY, 0, 0);
        // what was in the way of one bridge mostly is in the way of the next
        let (mut in_outer, mut in_hole) = (0, 0);
        for i in 0..outer.len() {
            for j in 0..hole.len() {
                let (p, q) = (at(outer[i]), at(hole[j]));
                let length = squared(p, q);
                if length < shortest.0 {
                    shortest = (length, i, j);
                }
                if length < best.0
                    && !joined.holds(outer[i], hole[j])
                    && in_sector(points, outer, i, q)
                    && !crosses(points, outer, [p, q], &mut in_outer)
                    && !crosses(points, hole, [p, q], &mut in_hole)
                {
                    best = (length, i, j);
                }
            }
        }
        let (_, i, j) = if best.0 < f64::INFINITY { best } else { shortest };
        joined.join(outer[i], hole[j]);
        let m = hole.len();
        let inner = (0..=m).map(|k| hole[(j + k) % m]);
        self.grown.clear();
        self.grown.extend(outer[..=i].iter().copied().chain(inner).chain(outer[i..].iter().copied()));
        std::mem::swap(&mut self.rings[ring], &mut self.grown);
    }

    /// Cuts ears, the best-shaped proper one first; where there is none, the least bad one.
    fn clip_ears(&mut self, points: &[[f64; 2]], joined: &mut Joined, out: &mut Vec<[u32; 3]>) {
        let mut ring = std::mem::take(&mut self.ring);
        let mut corners = std::mem::take(&mut self.corners);
        cancel_spikes(&mut ring);
        corners.clear();
        corners.resize(ring.len(), Corner::default());
        while ring.len() > 3 {
            let n = ring.len();
            let corner = |i: usize| [ring[(i + n - 1) % n], ring[i], ring[(i + 1) % n]];
            for (i, known) in corners.iter_mut().enumerate().filter(|(_, c)| c.quality.is_nan()) {
                *known = Corner { quality: shape(points, corner(i)), blocker: None };
            }
            let best = loop {
                let mut best = (FLAT, None);
                for (i, known) in corners.iter().enumerate() {
                    if known.quality > best.0 && known.blocker.is_none() {
                        best = (known.quality, Some(i));
                    }
                }
                let Some(i) = best.1 else { break None };
                let [a, _, c] = corner(i);
                corners[i].blocker = if joined.holds(a, c) { Some(NOBODY) } else { blocker(points, corner(i), &ring) };
                if corners[i].blocker.is_none() {
                    break Some(i);
                }
            };
            let fitness = |i: usize| (!joined.holds(corner(i)[0], corner(i)[2]), corners[i].quality);
            let forced = || (0..n).reduce(|a, b| if fitness(b) > fitness(a) { b } else { a }).unwrap_or(0);
            let i = best.unwrap_or_else(forced);
            let [a, _, c] = corner(i);
            joined.join(a, c);
            out.push(corner(i));
            let gone = ring.remove(i);
            corners.remove(i);
            let spiked = ring.len();
            cancel_spikes(&mut ring);
            if ring.len() < spiked {
                corners.clear();
                corners.resize(ring.len(), Corner::default());
                continue;
            }
            // its neighbours have other corners now, and those that it was in the way of may be ears
            for k in [(i + n - 2) % (n - 1), i % (n - 1)] {
                corners[k] = Corner::default();
            }
            corners.iter_mut().filter(|c| c.blocker == Some(gone)).for_each(|c| c.blocker = None);
        }
        if let [a, b, c] = ring[..] {
            out.push([a, b, c]);
        }
        ring.clear();
        (self.ring, self.corners) = (ring, corners);
    }
}

/// Keeps a corner from being an ear for good: its neighbours are joined already.
const NOBODY: u32 = u32::MAX;

/// What is known of a corner of the ring that ears are cut from.
#[derive(Clone, Copy, Debug)]
struct Corner {
    /// Its [`shape`]; NaN where it is to be worked out.
    quality: f64,
    /// A point that keeps it from being an ear; none where there is none or none was looked for.
    blocker: Option<u32>,
}

impl Default for Corner {
    fn default() -> Self {
        Self { quality: f64::NAN, blocker: None }
    }
}

/// Takes out repeated points and edges that run back and forth.
fn cancel_spikes(ring: &mut Vec<u32>) {
    loop {
        let n = ring.len();
        if n < 3 {
            ring.clear();
            return;
        }
        let same = (0..n).find(|&i| ring[i] == ring[(i + 1) % n]);
        let spike = (0..n).find(|&i| ring[(i + n - 1) % n] == ring[(i + 1) % n]);
        match (same, spike) {
            (Some(i), _) => {
                ring.remove(i);
            }
            (None, Some(i)) => {
                let after = (i + 1) % n;
                ring.remove(i.max(after));
                ring.remove(i.min(after));
            }
            (None, None) => return,
        }
    }
}

fn squared(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
}

/// Twice the signed area of a polygon.
pub fn doubled_area(points: &[[f64; 2]], polygon: &[u32]) -> f64 {
    let at = |i: usize| points[polygon[i % polygon.len()] as usize];
    let o = at(0);
    (1..polygon.len()).map(|i| (at(i)[0] - o[0]) * (at(i + 1)[1] - o[1]) - (at(i + 1)[0] - o[0]) * (at(i)[1] - o[1])).sum()
}

/// Shape of a triangle: doubled signed area over the longest side squared.
fn shape(points: &[[f64; 2]], t: [u32; 3]) -> f64 {
    let [p, q, r] = t.map(|i| points[i as usize]);
    let longest = squared(p, q).max(squared(q, r)).max(squared(r, p));
    if longest > 0.0 { orient2d(p, q, r) / longest } else { 0.0 }
}

/// A point of the ring that lies in the closed triangle, or off it by rounding, and is none of its corners.
fn blocker(points: &[[f64; 2]], t: [u32; 3], ring: &[u32]) -> Option<u32> {
    let [a, b, c] = t.map(|i| points[i as usize]);
    let longest = squared(a, b).max(squared(b, c)).max(squared(c, a));
    let rounding = -FLAT * longest;
    // a flat triangle is met, within rounding, by points beyond its ends, but none further than its length
    let reach = longest.sqrt();
    let low: [f64; 2] = std::array::from_fn(|d| a[d].min(b[d]).min(c[d]) - reach);
    let high: [f64; 2] = std::array::from_fn(|d| a[d].max(b[d]).max(c[d]) + reach);
    let blocks = |p: [f64; 2]| {
        let is_near = (0..2).all(|d| p[d] >= low[d] && p[d] <= high[d]);
        is_near && orient2d(a, b, p) >= rounding && orient2d(b, c, p) >= rounding && orient2d(c, a, p) >= rounding
    };
    ring.iter().copied().find(|&p| !t.contains(&p) && blocks(points[p as usize]))
}

/// Even-odd rule with exact sides.
fn contains(points: &[[f64; 2]], ring: &[u32], p: [f64; 2]) -> bool {
    let n = ring.len();
    let crossed = (0..n).filter(|&i| {
        let (a, b) = (points[ring[i] as usize], points[ring[(i + 1) % n] as usize]);
        (a[1] > p[1]) != (b[1] > p[1]) && (orient2d(a, b, p) > 0.0) == (b[1] > a[1])
    });
    crossed.count() % 2 == 1
}

/// True if `q` is seen from ring point `i` on the ring's inner side.
fn in_sector(points: &[[f64; 2]], ring: &[u32], i: usize, q: [f64; 2]) -> bool {
    let n = ring.len();
    let at = |k: usize| points[ring[k % n] as usize];
    let (a, b, c) = (at(i + n - 1), at(i), at(i + 1));
    let (left_in, left_out) = (orient2d(a, b, q) > 0.0, orient2d(b, c, q) > 0.0);
    if orient2d(a, b, c) > 0.0 { left_in && left_out } else { left_in || left_out }
}

/// True if segment `p`-`q` crosses or touches an edge of the polygon that it shares no end with. Edge number `first` is looked at
/// first, and then is the one that is crossed.
fn crosses(points: &[[f64; 2]], polygon: &[u32], [p, q]: [[f64; 2]; 2], first: &mut usize) -> bool {
    let n = polygon.len();
    let crossed = std::iter::once(*first).chain(0..n).find(|&i| {
        let (a, b) = (points[polygon[i] as usize], points[polygon[(i + 1) % n] as usize]);
        if a == p || a == q || b == p || b == q {
            return false;
        }
        let (s, t) = (orient2d(p, q, a), orient2d(p, q, b));
        let (u, v) = (orient2d(a, b, p), orient2d(a, b, q));
        (s > 0.0) != (t > 0.0) && (u > 0.0) != (v > 0.0)
    });
    *first = crossed.unwrap_or(*first);
    crossed.is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(points: &[[f64; 2]], loops: &[&[u32]]) -> Vec<[u32; 3]> {
        let mut out = Vec::new();
        let mut joined = Joined { vertices: (0..points.len() as u32).collect(), pairs: Pairs::default() };
        joined.pairs.reset(loops, &[], false);
        FacetMesh::default().triangulate(points, &mut joined, loops.iter().copied(), &mut out);
        out
    }

    /// Directed edges without an opposite.
    fn boundary(triangles: &[[u32; 3]]) -> Vec<(u32, u32)> {
        let mut edges: Vec<(u32, u32)> = Vec::new();
        for (a, b) in triangles.iter().flat_map(|t| (0..3).map(|k| (t[k], t[(k + 1) % 3]))) {
            match edges.iter().position(|&e| e == (b, a)) {
                Some(i) => {
                    edges.swap_remove(i);
                }
                None => edges.push((a, b)),
            }
        }
        edges.sort_unstable();
        edges
    }

    fn edges_of(loops: &[&[u32]]) -> Vec<(u32, u32)> {
        let mut edges: Vec<_> = loops.iter().flat_map(|l| (0..l.len()).map(|i| (l[i], l[(i + 1) % l.len()]))).collect();
        edges.sort_unstable();
        edges
    }

    #[test]
    fn a_square_with_a_hole_and_a_second_part() {
        let points = [
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 4.0],
            [0.0, 4.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [2.0, 2.0],
            [2.0, 1.0],
            [5.0, 0.0],
            [6.0, 0.0],
            [6.0, 1.0],
        ];
        let loops: [&[u32]; 3] = [&[0, 1, 2, 3], &[4, 5, 6, 7], &[8, 9, 10]];
        let t = run(&points, &loops);
        assert_eq!(boundary(&t), edges_of(&loops));
        let area: f64 = t.iter().map(|t| doubled_area(&points, t)).sum();
        assert!((area - 31.0).abs() < 1e-12);
        assert!(t.iter().all(|t| doubled_area(&points, t) > 0.0));
    }

    #[test]
    fn a_straight_side_with_rounding_makes_no_slivers() {
        let jitter = [0.0, 3e-17, -5e-17, 4e-17, -2e-17, 0.0];
        let mut points: Vec<[f64; 2]> = (0..6).map(|i| [0.5 - 0.1 * f64::from(i), 0.3 + jitter[i as usize]]).collect();
        points.extend([[0.0, 0.0], [0.5, 0.0]]);
        let outline: Vec<u32> = (0..8).collect();
        let t = run(&points, &[&outline]);
        assert_eq!(t.len(), 6);
        assert!(t.iter().all(|&t| shape(&points, t) > 0.01), "{t:?}");
    }

    #[test]
    fn flat_and_coincident_points_lose_no_edge() {
        let points = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 0.0], [1.0, 0.0], [0.5, 0.0]];
        let loops: [&[u32]; 1] = [&[0, 1, 2, 3, 4, 5]];
        assert_eq!(boundary(&run(&points, &loops)), edges_of(&loops));
    }
}
