//! Flips inner edges until a triangulation is constrained Delaunay (Lawson): the last step of [`super::triangulate`].
//!
//! An edge is flipped if both triangles that come of it turn left and either one of the old ones does not, or a corner lies
//! inside the other triangle's circle (exact). Flips keep every border edge and every corner.

use super::ears::{NONE, Pairs};
use super::predicates::orient2d;

/// Flips an edge at most this often on average; Lawson's flips end long before, whatever rounding does not.
const MOST_FLIPS_AN_EDGE: usize = 64;

/// Buffers of the flips.
#[derive(Debug, Default)]
pub(super) struct Flips {
    /// Result: opposite half-edges.
    pub opposite: Vec<u32>,
    stack: Vec<u32>,
    queued: Vec<bool>,
}

impl Flips {
    /// Improves `triangles`, whose half-edge `3 t + k` has `opposite[3 t + k]` on its other side.
    pub fn improve(&mut self, points: &[[f64; 2]], opposite: &[u32], pairs: &mut Pairs, triangles: &mut [[u32; 3]]) {
        self.opposite.clear();
        self.opposite.extend_from_slice(opposite);
        self.stack.clear();
        // one half-edge an edge
        let first = |h: u32| opposite[h as usize] != NONE && h < opposite[h as usize];
        self.stack.extend((0..opposite.len() as u32).filter(|&h| first(h)));
        self.queued.clear();
        self.queued.extend((0..opposite.len() as u32).map(first));
        let mut left = MOST_FLIPS_AN_EDGE * opposite.len();
        while let Some(h) = self.stack.pop() {
            self.queued[h as usize] = false;
            let back = self.opposite[h as usize];
            if back == NONE || left == 0 {
                continue;
            }
            if self.gains(points, triangles, pairs, h, back) {
                self.flip(triangles, pairs, h, back);
                left -= 1;
            }
        }
    }

    /// Corners `a`, `b` of half-edge `h`, then `c` across in its triangle and `d` in the other.
    fn quad(triangles: &[[u32; 3]], h: u32, back: u32) -> [u32; 4] {
        let at = |h: u32, k: u32| triangles[h as usize / 3][((h % 3 + k) % 3) as usize];
        [at(h, 0), at(h, 1), at(h, 2), at(back, 2)]
    }

    fn gains(&self, points: &[[f64; 2]], triangles: &[[u32; 3]], pairs: &Pairs, h: u32, back: u32) -> bool {
        let quad = Self::quad(triangles, h, back);
        let [a, b, c, d] = quad.map(|i| points[i as usize]);
        if quad[2] == quad[3] || h / 3 == back / 3 || orient2d(d, b, c) <= 0.0 || orient2d(c, a, d) <= 0.0 {
            return false;
        }
        let at = |p: [f64; 2]| robust::Coord { x: p[0], y: p[1] };
        let spoilt = orient2d(a, b, c) <= 0.0 || orient2d(b, a, d) <= 0.0;
        (spoilt || robust::incircle(at(a), at(b), at(c), at(d)) > 0.0) && !pairs.contains(quad[2], quad[3])
    }

    /// Triangles (a, b, c) and (b, a, d) become (d, b, c) and (c, a, d).
    fn flip(&mut self, triangles: &mut [[u32; 3]], pairs: &mut Pairs, h: u32, back: u32) {
        let [a, b, c, d] = Self::quad(triangles, h, back);
        let step = |h: u32, k: u32| h / 3 * 3 + (h % 3 + k) % 3;
        let [bc, ca, ad, db] = [step(h, 1), step(h, 2), step(back, 1), step(back, 2)].map(|e| self.opposite[e as usize]);
        let (t, u) = (h / 3, back / 3);
        triangles[t as usize] = [d, b, c];
        triangles[u as usize] = [c, a, d];
        for (at, across) in [(3 * t, db), (3 * t + 1, bc), (3 * t + 2, 3 * u + 2), (3 * u, ca), (3 * u + 1, ad)] {
            self.opposite[at as usize] = across;
            if across != NONE {
                self.opposite[across as usize] = at;
            }
        }
        pairs.remove(a, b);
        pairs.insert(c, d);
        for e in [3 * t, 3 * t + 1, 3 * u, 3 * u + 1] {
            let back = self.opposite[e as usize];
            if back != NONE && !self.queued[e as usize] && !self.queued[back as usize] {
                self.queued[e as usize] = true;
                self.stack.push(e);
            }
        }
    }
}
