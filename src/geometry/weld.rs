//! Corners of loops that coincide but for rounding, taken out before a triangulation and put back after it.
//!
//! A plane that passes a vertex by less than a rounding crosses every edge around it at one place, and the crossings, rounded, lie in no
//! order along the loop: it crosses itself there, and with holes that leaves no proper ears. One corner of such a run stands for all; each
//! of the others gets a triangle of its own, without area as any with its edges must be.

use super::fx::FxHashMap;
use super::triangulate::NO_OPPOSITE;

/// Points this near to each other coincide, as a share of the largest coordinate: some fifty roundings of a projected crossing.
const COINCIDE: f64 = 1e-14;

/// Loops without such corners; what was taken out.
#[derive(Debug, Default)]
pub(super) struct Welded {
    /// Points, of which those that coincide across loops are one.
    pub(super) points: Vec<[f64; 2]>,
    pub(super) corners: Vec<u32>,
    pub(super) starts: Vec<u32>,
    /// The corner that stands for one that was taken out, that one, and the one after it; to be put back from the end.
    out: Vec<[u32; 3]>,
    order: Vec<u32>,
    joined: FxHashMap<[u32; 2], ()>,
    /// Half-edges along the loops, by their corners.
    along: FxHashMap<[u32; 2], u32>,
}

impl Welded {
    /// Takes out what coincides along loops `corners[starts[i]..starts[i + 1]]`; false if nothing does. Three corners are left of each, and
    /// a loop stays as it is where putting back would join two corners that an edge of the loops, or one that is `taken`, joins already.
    pub(super) fn weld(&mut self, points: &[[f64; 2]], corners: &[u32], starts: &[u32], taken: &[[u32; 2]]) -> bool {
        let largest = corners.iter().flat_map(|&c| points[c as usize]).fold(0.0, |most: f64, x| most.max(x.abs()));
        let near = COINCIDE * largest;
        let coincide = |a: u32, b: u32| {
            let (p, q) = (points[a as usize], points[b as usize]);
            (p[0] - q[0]).abs() <= near && (p[1] - q[1]).abs() <= near
        };
        let rings = || starts.windows(2).map(|span| &corners[span[0] as usize..span[1] as usize]);
        let has_near = |ring: &[u32]| {
            let ends = ring.last().zip(ring.first());
            ring.windows(2).any(|pair| coincide(pair[0], pair[1])) || ends.is_some_and(|(&a, &b)| coincide(a, b))
        };
        if !rings().any(has_near) {
            return false;
        }
        let key = |a: u32, b: u32| [a.min(b), a.max(b)];
        self.joined.clear();
        self.joined.extend(rings().flat_map(|ring| (0..ring.len()).map(|i| (key(ring[i], ring[(i + 1) % ring.len()]), ()))));
        self.joined.extend(taken.iter().map(|&[a, b]| (key(a, b), ())));
        self.corners.clear();
        self.starts.clear();
        self.starts.push(0);
        self.out.clear();
        for ring in rings() {
            let (begin, out, n) = (self.corners.len(), self.out.len(), ring.len());
            let first = (0..n).find(|&i| !coincide(ring[(i + n - 1) % n], ring[i]));
            for i in 0..n {
                let at = |i: usize| ring[(first.unwrap_or(0) + i) % n];
                match self.corners[begin..].last() {
                    Some(&kept) if coincide(kept, at(i)) => self.out.push([kept, at(i), at(i + 1)]),
                    _ => self.corners.push(at(i)),
                }
            }
            let is_joined = self.out[out..].iter().any(|&[kept, _, after]| self.joined.insert(key(kept, after), ()).is_some());
            if is_joined || first.is_none() || self.corners.len() - begin < 3 {
                self.corners.truncate(begin);
                self.corners.extend_from_slice(ring);
                self.out.truncate(out);
            }
            self.starts.push(self.corners.len() as u32);
        }
        self.points.clear();
        self.points.extend_from_slice(points);
        self.join_across(near);
        !self.out.is_empty()
    }

    /// Corners of different loops, or places of one, that coincide are at one point: loops touch there and do not cross.
    fn join_across(&mut self, near: f64) {
        let Self { points, corners, order, .. } = self;
        order.clear();
        order.extend_from_slice(corners);
        order.sort_unstable_by(|&a, &b| points[a as usize][0].total_cmp(&points[b as usize][0]).then(a.cmp(&b)));
        for i in 0..order.len() {
            let p = points[order[i] as usize];
            for &other in &order[i + 1..] {
                let [x, y] = points[other as usize];
                if x - p[0] > near {
                    break;
                }
                if (y - p[1]).abs() <= near {
                    points[other as usize] = p;
                }
            }
        }
    }

    /// Puts back what was taken out, into `triangles` with the half-edges `opposite` theirs: [`super::Triangulator::opposite`].
    pub(super) fn put_back(&mut self, triangles: &mut Vec<[u32; 3]>, opposite: &mut Vec<u32>, first: usize) {
        let Self { out, along, .. } = self;
        along.clear();
        let loop_edges = (0..opposite.len()).filter(|&h| opposite[h] == NO_OPPOSITE);
        along.extend(loop_edges.map(|h| {
            let t = triangles[first + h / 3];
            ([t[h % 3], t[(h + 1) % 3]], h as u32)
        }));
        while let Some([kept, corner, after]) = out.pop() {
            let Some(h) = along.remove(&[kept, after]) else { continue };
            let new = opposite.len() as u32;
            triangles.push([kept, corner, after]);
            opposite[h as usize] = new + 2;
            opposite.extend([NO_OPPOSITE, NO_OPPOSITE, h]);
            along.extend([([kept, corner], new), ([corner, after], new + 1)]);
        }
    }
}
