//! Polygons of a file into triangles: a fan from the first corner where that covers the polygon, and otherwise what covers it.

use crate::geometry::Triangulator;
use glam::{DVec2, DVec3};

/// A triangle no thicker than this, by its longest edge, may lie upside down: projecting rounds, and the corners of many a
/// convex polygon lie on one line.
const SLIVER: f64 = 1e-9;

/// Polygons of more corners stay fans: to see whether edges cross can take the square of their number.
const MOST_CORNERS: usize = 20_000;

/// Doubled areas below this may have either sign, of polygons of the size 1.
const ROUNDING: f64 = 1e-14;

/// Cuts polygons; buffers are kept.
#[derive(Default)]
pub(super) struct PolygonCutter {
    corners: Vec<DVec3>,
    /// The corners along the polygon's normal, which looks at the viewer: the first in the origin, the farthest about 1 away.
    points: Vec<[f64; 2]>,
    ring: Vec<u32>,
    /// The edges from the left to the right.
    order: Vec<u32>,
    triangulator: Triangulator,
    triangles: Vec<[u32; 3]>,
}

impl PolygonCutter {
    /// The `n - 2` triangles of a polygon of `n` corners, by the corners' numbers. A polygon without an area or one that crosses
    /// itself is a fan.
    pub fn cut(&mut self, corners: impl Iterator<Item = DVec3>) -> &[[u32; 3]] {
        self.corners.clear();
        self.corners.extend(corners);
        self.triangles.clear();
        let concave = self.corners.len() > 3 && self.project() && !self.fan_covers();
        if !(concave && self.cover()) {
            self.triangles.clear();
            self.triangles.extend((2..self.corners.len() as u32).map(|k| [0, k - 1, k]));
        }
        &self.triangles
    }

    /// Projects the corners along Newell's normal; false if there is none.
    fn project(&mut self) -> bool {
        let first = self.corners[0];
        let mut size = 0.0f64;
        for p in &mut self.corners {
            *p -= first;
            // not with `max` alone, which passes over what is no number
            size = if p.is_finite() { size.max(p.abs().max_element()) } else { f64::INFINITY };
        }
        if !(size > 0.0 && size.is_finite()) {
            return false;
        }
        for p in &mut self.corners {
            *p /= size;
        }
        let normal: DVec3 = self.corners.windows(2).map(|w| w[0].cross(w[1])).sum();
        let length = normal.length();
        if !(length > SLIVER && length.is_finite()) {
            return false;
        }
        let (right, up) = (normal / length).any_orthonormal_pair();
        self.points.clear();
        self.points.extend(self.corners.iter().map(|p| [p.dot(right), p.dot(up)]));
        true
    }

    fn is_turned_over(&self, triangle: [u32; 3]) -> bool {
        let [a, b, c] = triangle.map(|k| DVec2::from_array(self.points[k as usize]));
        let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
        (b - a).perp_dot(c - a) < -SLIVER * longest
    }

    /// True if the fan from corner 0 covers the polygon and nothing else, if anything can: no triangle of it is turned over.
    /// (A fan that goes around corner 0 more than once belongs to a polygon that crosses itself.)
    fn fan_covers(&self) -> bool {
        !(2..self.points.len() as u32).any(|k| self.is_turned_over([0, k - 1, k]))
    }

    /// True if two edges cross and do not only touch.
    fn crosses_itself(&mut self) -> bool {
        let points = &self.points;
        let edge = |k: u32| [points[k as usize], points[(k as usize + 1) % points.len()]].map(DVec2::from_array);
        let low = |k: u32| edge(k)[0].x.min(edge(k)[1].x);
        self.order.clear();
        self.order.extend(0..points.len() as u32);
        self.order.sort_unstable_by(|&i, &j| low(i).total_cmp(&low(j)).then(i.cmp(&j)));
        let apart = |[a, b]: [DVec2; 2], [c, d]: [DVec2; 2]| {
            let (left, right) = ((b - a).perp_dot(c - a), (b - a).perp_dot(d - a));
            left.min(right) < -ROUNDING && left.max(right) > ROUNDING
        };
        (0..points.len()).any(|at| {
            let [a, b] = edge(self.order[at]);
            let (right, bottom, top) = (a.x.max(b.x), a.y.min(b.y), a.y.max(b.y));
            self.order[at + 1..]
                .iter()
                .map(|&k| edge(k))
                .take_while(|[c, d]| c.x.min(d.x) <= right)
                .any(|[c, d]| c.y.min(d.y) <= top && c.y.max(d.y) >= bottom && apart([a, b], [c, d]) && apart([c, d], [a, b]))
        })
    }

    /// Looks for triangles that cover a concave polygon; false if there are none.
    fn cover(&mut self) -> bool {
        let count = self.points.len();
        if count > MOST_CORNERS || self.crosses_itself() {
            return false;
        }
        if count == 4 {
            self.triangles.extend([[1, 2, 3], [1, 3, 0]]);
        } else {
            self.ring.clear();
            self.ring.extend(0..count as u32);
            let starts = [0, count as u32];
            let outcome = self.triangulator.triangulate(&self.points, &self.ring, &starts, &[], &mut self.triangles);
            if outcome.forced_ears > 0 || outcome.fans > 0 {
                return false;
            }
        }
        self.triangles.len() == count - 2 && !self.triangles.iter().any(|&t| self.is_turned_over(t))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn fan(count: u32) -> Vec<[u32; 3]> {
        (2..count).map(|k| [0, k - 1, k]).collect()
    }

    /// Cuts a plane polygon that is tilted, moved and scaled.
    fn cut(points: &[[f64; 2]]) -> Vec<[u32; 3]> {
        let (right, up) = (DVec3::new(2.0, 1.0, 2.0) / 3.0, DVec3::new(-2.0, 2.0, 1.0) / 3.0);
        let place = |p: &[f64; 2]| (right * p[0] + up * p[1]) * 0.01 + DVec3::new(5.0, -3.0, 1.0);
        PolygonCutter::default().cut(points.iter().map(place)).to_vec()
    }

    fn doubled(points: &[[f64; 2]], t: &[u32; 3]) -> f64 {
        let [a, b, c] = t.map(|k| DVec2::from_array(points[k as usize]));
        (b - a).perp_dot(c - a)
    }

    /// Asserts that, from whichever corner and whichever way around, the triangles cover the polygon, which has this area.
    fn assert_covered(points: &[[f64; 2]], area: f64) {
        let mut points = points.to_vec();
        for sign in [1.0, -1.0] {
            for _ in 0..points.len() {
                let triangles = cut(&points);
                assert_eq!(triangles.len(), points.len() - 2);
                let areas: Vec<f64> = triangles.iter().map(|t| sign * doubled(&points, t) / 2.0).collect();
                assert!(areas.iter().all(|&a| a > -1e-9), "{points:?}: {triangles:?}");
                assert!((areas.iter().sum::<f64>() - area).abs() < 1e-9, "{areas:?}");
                points.rotate_left(1);
            }
            points.reverse();
        }
    }

    fn star(tips: u32, inner: f64) -> Vec<[f64; 2]> {
        let corner = |k: u32| {
            let angle = f64::from(k) * TAU / f64::from(2 * tips);
            let radius = if k.is_multiple_of(2) { 1.0 } else { inner };
            [radius * angle.cos(), radius * angle.sin()]
        };
        (0..2 * tips).map(corner).collect()
    }

    #[test]
    fn convex_polygons_stay_fans() {
        for count in [3, 4, 5, 17, 1000] {
            let round: Vec<_> = star(count, 1.0).into_iter().step_by(2).collect();
            assert_eq!(cut(&round), fan(count));
        }
        // with corners on one line, from every corner
        let mut square =
            [[0.0, 0.0], [0.3, 0.0], [0.7, 0.0], [1.0, 0.0], [1.0, 0.1], [1.0, 1.0], [0.1, 1.0], [0.0, 1.0], [0.0, 0.9]];
        for _ in 0..square.len() {
            assert_eq!(cut(&square), fan(9), "{square:?}");
            square.rotate_left(1);
        }
        // not plane
        let bent = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [1.0, 1.0, 0.0], [0.0, 1.0, 0.5]].map(DVec3::from_array);
        assert_eq!(PolygonCutter::default().cut(bent.into_iter()), fan(4));
    }

    #[test]
    fn concave_polygons_are_covered() {
        let dart = [[0.0, 0.0], [2.0, -1.0], [0.5, 0.0], [2.0, 1.0]];
        assert_eq!(cut(&[dart[1], dart[2], dart[3], dart[0]]), [[1, 2, 3], [1, 3, 0]], "the other diagonal");
        let turned = [dart[2], dart[3], dart[0], dart[1]];
        assert_eq!(cut(&turned), fan(4), "the fan of the corner within is right");
        let l = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        assert_covered(&l, 3.0);
        for (tips, inner) in [(3, 0.1), (5, 0.3), (40, 0.9)] {
            let area = f64::from(tips) * inner * (TAU / f64::from(2 * tips)).sin();
            assert_covered(&star(tips, inner), area);
        }
        // a spiral
        let arm = |k: i32, wide: f64| {
            let angle = f64::from(k) * 0.4;
            [(angle + wide) * angle.cos(), (angle + wide) * angle.sin()]
        };
        let spiral: Vec<_> = (0..40).map(|k| arm(k, 2.0)).chain((0..40).rev().map(|k| arm(k, 0.5))).collect();
        let area = fan(80).iter().map(|t| doubled(&spiral, t) / 2.0).sum::<f64>();
        assert_covered(&spiral, area);
        // a hole, by a bridge there and back
        let frame = [
            [0.0, 0.0],
            [3.0, 0.0],
            [3.0, 3.0],
            [0.0, 3.0],
            [0.0, 0.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [2.0, 2.0],
            [2.0, 1.0],
            [1.0, 1.0],
        ];
        assert_covered(&frame, 8.0);
    }

    #[test]
    fn what_has_no_cover_is_a_fan() {
        let bow_tie = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.5]];
        let pentagram: Vec<_> = (0..5).map(|k| star(5, 1.0)[4 * k % 10]).collect();
        let eight = [[0.0, 0.0], [2.0, 2.0], [2.0, 3.0], [1.0, 3.0], [1.0, 2.0], [3.0, 0.0]];
        let line = [0.0, 3.0, 1.0, 2.0, -1.0].map(|x| [x, 2.0 * x]);
        let point = [[1.0, 1.0]; 6];
        for polygon in [&bow_tie[..], &pentagram, &eight, &line, &point] {
            assert_eq!(cut(polygon), fan(polygon.len() as u32), "{polygon:?}");
        }
        for x in [f64::NAN, f64::INFINITY, f64::MAX] {
            for at in 0..5 {
                let mut l = [[0.0, 0.0], [-2.0, 0.0], [2.0, -1.0], [1.0, 1.0], [1.0, 2.0]].map(|p| DVec3::new(p[0], p[1], -x));
                l[at].z = x;
                assert_eq!(PolygonCutter::default().cut(l.into_iter()).len(), 3);
            }
        }
        for few in 0..3 {
            assert!(cut(&point[..few]).is_empty());
        }
    }

    #[test]
    fn the_size_does_not_matter() {
        let l = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        let mut cutter = PolygonCutter::default();
        let mut of = |scale: f64| cutter.cut((1..7).map(|k| DVec3::new(l[k % 6][0], 0.0, l[k % 6][1]) * scale)).to_vec();
        let expected = of(1.0);
        assert_ne!(expected, fan(6));
        assert_eq!((of(1e-200), of(1e200)), (expected.clone(), expected));
    }

    #[test]
    fn large_polygons_take_no_time() {
        let round: Vec<_> = star(100_000, 1.0).into_iter().step_by(2).collect();
        assert_eq!(cut(&round), fan(100_000));
        assert_ne!(cut(&star(2500, 0.5)), fan(5000));
        // looking for its ears would take minutes
        let number = |k: u32, step: u32| f64::from(k.wrapping_mul(step) >> 8);
        let wild: Vec<_> = (0..10_000).map(|k| [number(k, 2_654_435_761), number(k, 2_246_822_519)]).collect();
        assert_eq!(cut(&wild), fan(10_000));
    }
}
