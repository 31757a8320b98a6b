//! Triangulates a region of the plane given by directed loops, the region to their left: outer loops run counter-clockwise,
//! holes clockwise, any number, nested to any depth.
//!
//! Combinatorics first: each directed loop edge is in exactly one triangle, in its direction, and every other edge in exactly
//! two opposed ones; no corner is dropped or added, whatever the geometry (collinear, coincident, touching or rounding-crossing
//! loops). Geometry, by exact predicates, only chooses among the triangulations. Corners that coincide but for rounding are welded
//! for the time (`weld.rs`), holes are joined to the loop around them by bridges, the ring is cut into ears (`ears.rs`), and flips
//! make it constrained Delaunay (`flips.rs`).

use super::ears::{Ears, Pairs};
use super::flips::Flips;
use super::predicates::orient2d;
use super::weld::Welded;

/// How a triangulation came out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TriangulationOutcome {
    /// Loops with fewer than three corners: they get no triangle.
    pub skipped_loops: usize,
    /// Ears that geometry would have refused; 0 for loops that neither cross nor touch.
    pub forced_ears: usize,
    /// Rings for which geometry found no way and a fan was laid without it.
    pub fans: usize,
    /// Inner edges that join two points which another edge joins already. Always 0, unless a loop repeats a corner or `taken`
    /// leaves no other way.
    pub repeated_edges: usize,
}

/// Triangulates loops; buffers are kept between calls.
#[derive(Debug, Default)]
pub struct Triangulator {
    loops: Vec<Loop>,
    holes: Vec<u32>,
    pairs: Pairs,
    ears: Ears,
    flips: Flips,
    opposite: Vec<u32>,
    welded: Welded,
}

/// In place of a half-edge: a loop edge is here.
pub const NO_OPPOSITE: u32 = u32::MAX;

/// A loop and what is known of it.
#[derive(Clone, Copy, Debug)]
struct Loop {
    first: u32,
    len: u32,
    doubled_area: f64,
    low: [f64; 2],
    high: [f64; 2],
    /// Loop that a hole belongs to; itself for an outer loop.
    owner: u32,
}

impl Triangulator {
    /// Triangulates the loops `corners[starts[i]..starts[i + 1]]` (indices into `points`), appending to `out` triangles that
    /// turn the way their loop does. No inner edge joins a pair of points in `taken` if that can be helped.
    ///
    /// A loop that repeats a corner is cut all the same and each of its edges is covered, but a triangle may then repeat a
    /// corner, and inner edges may join the same two points more than once.
    pub fn triangulate(
        &mut self,
        points: &[[f64; 2]],
        corners: &[u32],
        starts: &[u32],
        taken: &[[u32; 2]],
        out: &mut Vec<[u32; 3]>,
    ) -> TriangulationOutcome {
        let mut welded = std::mem::take(&mut self.welded);
        let before = out.len();
        let is_welded = welded.weld(points, corners, starts, taken);
        let loops =
            if is_welded { (&welded.points[..], &welded.corners[..], &welded.starts[..]) } else { (points, corners, starts) };
        let outcome = self.triangulate_loops(loops, taken, out);
        if is_welded {
            welded.put_back(out, &mut self.opposite, before);
        }
        self.welded = welded;
        outcome
    }

    fn triangulate_loops(
        &mut self,
        (points, corners, starts): (&[[f64; 2]], &[u32], &[u32]),
        taken: &[[u32; 2]],
        out: &mut Vec<[u32; 3]>,
    ) -> TriangulationOutcome {
        let mut outcome = TriangulationOutcome::default();
        let before = out.len();
        self.opposite.clear();
        self.measure(points, corners, starts, &mut outcome);
        self.assign_holes(points, corners);
        for outer in 0..self.loops.len() as u32 {
            if self.loops[outer as usize].owner != outer {
                continue;
            }
            self.holes.clear();
            self.holes.extend((0..self.loops.len() as u32).filter(|&h| h != outer && self.loops[h as usize].owner == outer));
            self.region(points, corners, outer, taken, out, &mut outcome);
            // regions count their half-edges each from 0
            let first = self.opposite.len() as u32;
            let number = |&h: &u32| if h == NO_OPPOSITE { h } else { h + first };
            self.opposite.extend(self.flips.opposite.iter().map(number));
            debug_assert_eq!(self.opposite.len(), 3 * (out.len() - before));
        }
        outcome
    }

    /// How the triangles of the last call meet: half-edge `3 t + k` leaves corner `k` of the call's triangle `t`, and this is
    /// the one across, or [`NO_OPPOSITE`] along the loops.
    pub fn opposite(&self) -> &[u32] {
        &self.opposite
    }

    fn region(
        &mut self,
        points: &[[f64; 2]],
        corners: &[u32],
        outer: u32,
        taken: &[[u32; 2]],
        out: &mut Vec<[u32; 3]>,
        outcome: &mut TriangulationOutcome,
    ) {
        let of = |l: &Loop| &corners[l.first as usize..(l.first + l.len) as usize];
        // from the left to the right, so that a bridge to the left meets what was joined already
        let left = |h: &u32| of(&self.loops[*h as usize]).iter().map(|&c| points[c as usize][0]).fold(f64::INFINITY, f64::min);
        let mut holes = std::mem::take(&mut self.holes);
        holes.sort_by(|a, b| left(a).total_cmp(&left(b)).then(a.cmp(b)));
        let rings: Vec<&[u32]> = std::iter::once(&outer).chain(&holes).map(|&l| of(&self.loops[l as usize])).collect();
        let single = rings.len() == 1 && taken.is_empty();
        let first = out.len();
        self.pairs.reset(&rings, taken, single);
        let mut forced = self.ears.cut(points, &rings, &mut self.pairs, out);
        if forced.is_some_and(|n| n > 0 || turned_over(points, &out[first..]) > 0.0) {
            forced = self.cut_from_elsewhere(points, &rings, (taken, single), out, first);
        }
        outcome.forced_ears += forced.unwrap_or(0);
        if forced.is_none() {
            out.truncate(first);
            self.pairs.reset(&rings, taken, false);
            outcome.fans += 1;
            outcome.repeated_edges += self.ears.fan(&rings, &mut self.pairs, out);
        }
        self.flips.improve(points, &self.ears.opposite, &mut self.pairs, &mut out[first..]);
        self.holes = holes;
    }

    /// Loops that cross themselves have no triangulation that covers nothing twice, and what of them is depends on where ears are cut first:
    /// of several starts that one is taken from which the least is turned over. Returns how many ears were forced and how many turned over.
    fn cut_from_elsewhere(
        &mut self,
        points: &[[f64; 2]],
        rings: &[&[u32]],
        (taken, single): (&[[u32; 2]], bool),
        out: &mut Vec<[u32; 3]>,
        first: usize,
    ) -> Option<usize> {
        let mut turned: Vec<u32> = rings[0].to_vec();
        let starts = (MOST_CUT_AGAIN / rings.iter().map(|r| r.len()).sum::<usize>()).clamp(2, STARTS);
        let mut best = (f64::INFINITY, 0);
        let mut forced = None;
        for start in (0..starts).map(Some).chain([None]) {
            // the last time the best again
            let start = start.unwrap_or(best.1);
            let by = start * turned.len() / starts;
            turned.rotate_left(by);
            let others = rings[1..].iter().copied();
            let from_there: Vec<&[u32]> = [&turned[..]].into_iter().chain(others).collect();
            out.truncate(first);
            self.pairs.reset(rings, taken, single);
            forced = self.ears.cut(points, &from_there, &mut self.pairs, out);
            let over = if forced.is_some() { turned_over(points, &out[first..]) } else { f64::INFINITY };
            if (over, start) < best {
                best = (over, start);
            }
            turned.rotate_right(by);
        }
        let is_over = |t: &&[u32; 3]| orient2d(points[t[0] as usize], points[t[1] as usize], points[t[2] as usize]) < 0.0;
        forced.map(|n| n.max(out[first..].iter().filter(is_over).count()))
    }

    fn measure(&mut self, points: &[[f64; 2]], corners: &[u32], starts: &[u32], outcome: &mut TriangulationOutcome) {
        self.loops.clear();
        for span in starts.windows(2) {
            let ring = &corners[span[0] as usize..span[1] as usize];
            if ring.len() < 3 {
                outcome.skipped_loops += usize::from(!ring.is_empty());
                continue;
            }
            let at = |i: usize| points[ring[i % ring.len()] as usize];
            let origin = at(0);
            let (mut low, mut high) = (origin, origin);
            let mut doubled_area = 0.0;
            for i in 0..ring.len() {
                let (p, q) = (at(i), at(i + 1));
                doubled_area += (p[0] - origin[0]) * (q[1] - origin[1]) - (p[1] - origin[1]) * (q[0] - origin[0]);
                for k in 0..2 {
                    low[k] = low[k].min(p[k]);
                    high[k] = high[k].max(p[k]);
                }
            }
            let owner = self.loops.len() as u32;
            self.loops.push(Loop { first: span[0], len: ring.len() as u32, doubled_area, low, high, owner });
        }
    }

    /// Gives each hole the smallest outer loop around it. A hole without one is a region of its own: turned over, but closed.
    fn assign_holes(&mut self, points: &[[f64; 2]], corners: &[u32]) {
        for h in 0..self.loops.len() {
            let hole = self.loops[h];
            if hole.doubled_area >= 0.0 {
                continue;
            }
            let ring = &corners[hole.first as usize..(hole.first + hole.len) as usize];
            let mut best = (f64::INFINITY, h as u32);
            for (o, outer) in self.loops.iter().enumerate() {
                let fits = (0..2).all(|k| outer.low[k] <= hole.low[k] && outer.high[k] >= hole.high[k]);
                // a hole cannot be larger than what it is in; equal ones touch all along
                let larger = outer.doubled_area >= -hole.doubled_area;
                if !(fits && larger) || outer.doubled_area >= best.0 {
                    continue;
                }
                let around = &corners[outer.first as usize..(outer.first + outer.len) as usize];
                if holds(points, around, ring) {
                    best = (outer.doubled_area, o as u32);
                }
            }
            self.loops[h].owner = best.1;
        }
    }
}

/// Starts that are tried for a loop that crosses itself, at most, and how many corners are cut again.
const STARTS: usize = 24;
const MOST_CUT_AGAIN: usize = 12_000;

/// The area of the triangles that turn right, as a share of that of all others, roundings aside.
fn turned_over(points: &[[f64; 2]], triangles: &[[u32; 3]]) -> f64 {
    let (mut over, mut other) = (0.0, 0.0);
    for t in triangles {
        let [a, b, c] = t.map(|corner| points[corner as usize]);
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        *if area < 0.0 { &mut over } else { &mut other } += area.abs();
    }
    if over > 1e-12 * other { over / other } else { 0.0 }
}

/// True if the first corner of `hole` that does not lie on `ring` lies inside it; true if all lie on it.
fn holds(points: &[[f64; 2]], ring: &[u32], hole: &[u32]) -> bool {
    hole.iter().map(|&c| side_of_ring(points, ring, points[c as usize])).find(|&s| s != 0).unwrap_or(1) > 0
}

/// 1 inside, 0 on the ring, -1 outside; exact.
fn side_of_ring(points: &[[f64; 2]], ring: &[u32], p: [f64; 2]) -> i32 {
    let mut inside = false;
    let mut b = points[ring[ring.len() - 1] as usize];
    for &c in ring {
        let a = std::mem::replace(&mut b, points[c as usize]);
        if a == p || b == p {
            return 0;
        }
        if (a[1] > p[1]) == (b[1] > p[1]) {
            let level = a[1] == p[1] && b[1] == p[1];
            if level && (a[0] > p[0]) != (b[0] > p[0]) {
                return 0;
            }
            continue;
        }
        let turn = orient2d(a, b, p);
        if turn == 0.0 {
            return 0;
        }
        inside ^= (turn > 0.0) == (b[1] > a[1]);
    }
    if inside { 1 } else { -1 }
}

/// Checks what [`Triangulator::triangulate`] promises, from scratch; for tests.
pub fn validate_triangulation(corners: &[u32], starts: &[u32], triangles: &[[u32; 3]]) -> Result<(), String> {
    let mut counts: std::collections::BTreeMap<(u32, u32), i64> = Default::default();
    let mut wanted: std::collections::BTreeMap<(u32, u32), i64> = Default::default();
    let mut expected = 0i64;
    for t in triangles {
        if t[0] == t[1] || t[1] == t[2] || t[2] == t[0] {
            return Err(format!("triangle {t:?} repeats a corner"));
        }
        for k in 0..3 {
            *counts.entry((t[k], t[(k + 1) % 3])).or_default() += 1;
        }
    }
    for ring in starts.windows(2).map(|s| &corners[s[0] as usize..s[1] as usize]).filter(|r| r.len() >= 3) {
        for i in 0..ring.len() {
            *wanted.entry((ring[i], ring[(i + 1) % ring.len()])).or_default() += 1;
            expected += 1;
        }
    }
    let inner = 3 * triangles.len() as i64 - expected;
    if inner < 0 || inner % 2 != 0 {
        return Err(format!("{} triangles cannot have {expected} border edges", triangles.len()));
    }
    for (&(a, b), &n) in &counts {
        let border = wanted.remove(&(a, b)).unwrap_or(0);
        let reverse_border = wanted.get(&(b, a)).copied().unwrap_or(0);
        let back = counts.get(&(b, a)).copied().unwrap_or(0);
        match (n, border, back) {
            (1, 1, 0) | (1, 0, 1) => {}
            _ => return Err(format!("edge {a}-{b}: {n} times, {back} times back, border {border} and {reverse_border}")),
        }
    }
    match wanted.keys().next() {
        Some(edge) => Err(format!("border edge {edge:?} is in no triangle")),
        None => Ok(()),
    }
}

#[cfg(test)]
#[path = "triangulate_tests.rs"]
mod tests;
