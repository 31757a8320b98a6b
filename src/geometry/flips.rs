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
        let first = |(h, &back): (u32, &u32)| back != NONE && h < back;
        self.queued.clear();
        self.queued.extend((0..).zip(opposite).map(first));
        self.stack.extend((0..).zip(opposite).filter(|h| first(*h)).map(|(h, _)| h));
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
        let after = |k: usize| if k == 2 { 0 } else { k + 1 };
        let before = |k: usize| if k == 0 { 2 } else { k - 1 };
        let (own, other) = (&triangles[h as usize / 3], &triangles[back as usize / 3]);
        let (k, l) = (h as usize % 3, back as usize % 3);
        [own[k], own[after(k)], own[before(k)], other[before(l)]]
    }

    fn gains(&self, points: &[[f64; 2]], triangles: &[[u32; 3]], pairs: &Pairs, h: u32, back: u32) -> bool {
        let quad = Self::quad(triangles, h, back);
        if quad[2] == quad[3] || h / 3 == back / 3 {
            return false;
        }
        let corners = quad.map(|i| points[i as usize]);
        surely_gains(corners).unwrap_or_else(|| gains_exactly(corners)) && !pairs.contains(quad[2], quad[3])
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

/// Whether the edge `a`, `b` between the triangles (a, b, c) and (b, a, d) is to be flipped, without rounding.
fn gains_exactly([a, b, c, d]: [[f64; 2]; 4]) -> bool {
    if orient2d(d, b, c) <= 0.0 || orient2d(c, a, d) <= 0.0 {
        return false;
    }
    let at = |p: [f64; 2]| robust::Coord { x: p[0], y: p[1] };
    let spoilt = orient2d(a, b, c) <= 0.0 || orient2d(b, a, d) <= 0.0;
    spoilt || robust::incircle(at(a), at(b), at(c), at(d)) > 0.0
}

/// [`gains_exactly`] where rounding leaves no doubt, by the error bounds of Shewchuk's predicates; nearly always.
fn surely_gains([a, b, c, d]: [[f64; 2]; 4]) -> Option<bool> {
    const ORIENT: f64 = 8.0 * f64::EPSILON;
    const INCIRCLE: f64 = 16.0 * f64::EPSILON;
    let less = |p: [f64; 2]| [p[0] - d[0], p[1] - d[1]];
    let [a, b, c] = [less(a), less(b), less(c)];
    // a determinant and what its rounding is measured by
    let cross = |u: [f64; 2], v: [f64; 2]| {
        let (x, y) = (u[0] * v[1], u[1] * v[0]);
        (x - y, x.abs() + y.abs())
    };
    let square = |u: [f64; 2]| u[0] * u[0] + u[1] * u[1];
    let (bc, ca, ab) = (cross(b, c), cross(c, a), cross(a, b));
    let lifts = [square(a), square(b), square(c)];
    let circle = lifts[0] * bc.0 + lifts[1] * ca.0 + lifts[2] * ab.0;
    let doubt = INCIRCLE * (lifts[0] * bc.1 + lifts[1] * ca.1 + lifts[2] * ab.1);
    if circle < -doubt {
        // the edge stays if both triangles turn left: (b, a, d) and (a, b, c)
        let sum = (ab.0 + bc.0 + ca.0, ab.1 + bc.1 + ca.1);
        let sound = -ab.0 > ORIENT * ab.1 && sum.0 > ORIENT * sum.1;
        return sound.then_some(false);
    }
    let turn = bc.0 > ORIENT * bc.1 && ca.0 > ORIENT * ca.1;
    (circle > doubt && turn).then_some(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sure_is_exact() {
        let (mut sure, mut unsure) = (0, 0);
        for i in 0..40_000u32 {
            let at = |k: u32| {
                let coarse = i.wrapping_mul(2_654_435_761).wrapping_add(k.wrapping_mul(40_503)) >> 7;
                // a grid has collinear and cocircular corners, a shift keeps them so but for rounding
                f64::from(coarse.wrapping_mul(k + 1) >> (3 + k % 5) & 7) * 0.1 + if i % 2 == 0 { 0.0 } else { 1e3 / 3.0 }
            };
            let corners = [0, 2, 4, 6].map(|k| [at(k), at(k + 1)]);
            match surely_gains(corners) {
                Some(gains) => {
                    sure += 1;
                    assert_eq!(gains, gains_exactly(corners), "{corners:?}");
                }
                None => unsure += 1,
            }
        }
        assert!(sure > 1000 && unsure > 1000, "{sure} {unsure}");
    }
}
