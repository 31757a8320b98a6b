//! Triangulates what a body leaves of a face: the face's polygon, with the points on its edges, less a convex polygon.
//!
//! Connectivity is combinatorial: every point enters, none is added or moved, and the result is a triangulated disk (or
//! annulus) whatever the rounding. Geometry only chooses among triangulations, for large angles. Points that share a
//! face edge or a plane are collinear by tag, never by evaluation (MATHS 5.6).

use crate::geometry::predicates::orient2d;
use glam::DVec3;

/// A point of the region, in the face's own plane.
#[derive(Clone, Copy, Debug, Default)]
pub struct RegionPoint {
    /// Coordinates, isometric to the face up to scale.
    pub at: [f64; 2],
    /// Bit `e`: lies on face edge `e`. Bit `3 + k`: lies on plane `k`.
    pub lines: u32,
}

/// The face polygon and the polygon to take out of it, as indices into `points`; reused between faces.
#[derive(Clone, Debug, Default)]
pub struct Region {
    /// All points.
    pub points: Vec<RegionPoint>,
    /// The face's boundary, counter-clockwise, points on edges included.
    pub outer: Vec<u16>,
    /// The polygon to take out, counter-clockwise; may be empty. Two points are a slit: nothing is taken out, and the
    /// segment between them becomes an edge.
    pub inner: Vec<u16>,
    /// Whether the inner polygon's edge from point `i` to the next runs along the face's boundary.
    pub inner_on_face: Vec<bool>,
    /// Result: triangles, counter-clockwise.
    pub triangles: Vec<[u16; 3]>,
    from_outer: Vec<u16>,
    from_inner: Vec<u16>,
    ring: Vec<u16>,
}

const NONE: u16 = u16::MAX;

impl Region {
    /// Sine of the smallest angle of the triangles; infinite without any.
    pub fn smallest_sine(&self) -> f64 {
        let at = |l: u16| DVec3::new(self.points[l as usize].at[0], self.points[l as usize].at[1], 0.0);
        let sines = self.triangles.iter().map(|&[p, q, r]| smallest_sine(at(p), at(q), at(r)));
        sines.fold(f64::INFINITY, f64::min)
    }

    /// Makes room for so many points.
    pub fn make_room(&mut self, points: usize) {
        self.points.reserve(points);
        for list in [&mut self.outer, &mut self.inner, &mut self.from_outer, &mut self.from_inner, &mut self.ring] {
            list.reserve(points);
        }
        self.inner_on_face.reserve(points);
        self.triangles.reserve(2 * points);
    }

    /// Forgets everything but the buffers.
    pub fn clear(&mut self) {
        self.points.clear();
        self.outer.clear();
        self.inner.clear();
        self.inner_on_face.clear();
        self.triangles.clear();
    }

    /// Fills `triangles` with a triangulation of outer minus inner. Every boundary edge of the region is an edge of
    /// exactly one triangle.
    pub fn triangulate(&mut self) {
        self.triangles.clear();
        self.collect_boundary();
        let inner_is_hole = !self.inner.is_empty() && !self.inner.iter().any(|p| self.outer.contains(p));
        if inner_is_hole {
            self.bridge_hole();
            self.clip_ears();
        } else {
            while let Some(start) = (0..self.points.len()).find(|&p| self.from_outer[p] != NONE || self.from_inner[p] != NONE) {
                self.trace_loop(start as u16);
                self.clip_ears();
            }
        }
        self.improve();
    }

    /// Directed boundary edges of the region, region on the left: outer edges that the inner polygon does not cover, and
    /// inner edges reversed.
    fn collect_boundary(&mut self) {
        for from in [&mut self.from_outer, &mut self.from_inner] {
            from.clear();
            from.resize(self.points.len(), NONE);
        }
        let n = self.outer.len();
        for i in 0..n {
            self.from_outer[self.outer[i] as usize] = self.outer[(i + 1) % n];
        }
        let m = self.inner.len();
        for i in 0..m {
            let (a, b) = (self.inner[i], self.inner[(i + 1) % m]);
            if !self.inner_on_face[i] {
                self.from_inner[b as usize] = a;
                continue;
            }
            let mut at = a;
            while at != b && self.from_outer[at as usize] != NONE {
                at = std::mem::replace(&mut self.from_outer[at as usize], NONE);
            }
        }
    }

    /// Walks one loop from `start`, using up its edges. Where the inner polygon touches the face's boundary the walk
    /// changes from one to the other, which keeps loops simple.
    fn trace_loop(&mut self, start: u16) {
        self.ring.clear();
        let mut came_by_outer = self.from_outer[start as usize] == NONE;
        let mut at = start;
        loop {
            let (outer, inner) = (self.from_outer[at as usize], self.from_inner[at as usize]);
            let take_outer = outer != NONE && (inner == NONE || !came_by_outer);
            let next = if take_outer { outer } else { inner };
            if next == NONE {
                break;
            }
            self.ring.push(at);
            (if take_outer { &mut self.from_outer } else { &mut self.from_inner })[at as usize] = NONE;
            came_by_outer = take_outer;
            at = next;
            // a walk that left a touching point along the face's boundary ends when it comes back along the inner polygon
            if at == start && !came_by_outer {
                break;
            }
        }
    }

    /// Joins the hole to the outer polygon by the shortest bridge from a corner to a hole point it can see.
    fn bridge_hole(&mut self) {
        let m = self.inner.len();
        let mut best = (f64::INFINITY, 0, 0);
        for (i, &corner) in self.outer.iter().enumerate() {
            let c = self.points[corner as usize].at;
            for j in 0..m {
                let at = |k: usize| self.points[self.inner[k % m] as usize].at;
                let seen = orient2d(at(j), at(j + 1), c) < 0.0 || orient2d(at(j + m - 1), at(j), c) < 0.0;
                let distance = squared(c, at(j)) * if seen { 1.0 } else { 1e6 };
                if distance < best.0 {
                    best = (distance, i, j);
                }
            }
        }
        let (_, i, j) = best;
        self.ring.clear();
        self.ring.extend_from_slice(&self.outer[..=i]);
        self.ring.extend((0..=m).map(|k| self.inner[(j + m - k) % m]));
        self.ring.extend_from_slice(&self.outer[i..]);
    }

    /// Cuts the best-shaped ear until three points are left. When rounding leaves no proper ear, the least bad one goes, so
    /// that connectivity is always complete.
    fn clip_ears(&mut self) {
        let mut ring = std::mem::take(&mut self.ring);
        // along a slit the ring runs there and back, and an ear could join two points a second time
        let slit = self.inner.len() == 2;
        // and its end may lie beyond the edge that it is near to, by rounding
        let slack = if slit { 1e-9 } else { 0.0 };
        while ring.len() > 3 {
            let n = ring.len();
            let mut best = (f64::NEG_INFINITY, 0);
            for i in 0..n {
                let [a, b, c] = [ring[(i + n - 1) % n], ring[i], ring[(i + 1) % n]];
                if a == c || a == b || b == c {
                    continue;
                }
                let quality = self.quality(a, b, c);
                let blocked = quality > 0.0
                    && ring.iter().any(|&p| p != a && p != b && p != c && self.in_closed_triangle(p, [a, b, c], slack));
                // points of one face edge that are not next to each other: the face across might join them too
                let along = self.points[a as usize].lines & self.points[c as usize].lines & 7 != 0;
                let score = if (slit && (self.has_edge(a, c) || has_side(&ring, a, c))) || (along && !has_side(&ring, a, c)) {
                    quality - 20.0
                } else if blocked {
                    quality - 10.0
                } else if quality > 0.0 {
                    quality
                } else {
                    quality - 5.0
                };
                if score > best.0 {
                    best = (score, i);
                }
            }
            let i = best.1;
            let triangle = [ring[(i + n - 1) % n], ring[i], ring[(i + 1) % n]];
            if best.0 > f64::NEG_INFINITY {
                self.triangles.push(triangle);
            }
            ring.remove(i);
        }
        if let [a, b, c] = ring[..]
            && a != b
            && b != c
            && a != c
        {
            self.triangles.push([a, b, c]);
        }
        self.ring = ring;
    }

    /// Flips inner edges while that enlarges the worse of the two triangles' shapes.
    fn improve(&mut self) {
        for _ in 0..2 * self.triangles.len() {
            if !self.flip_once() {
                return;
            }
        }
    }

    fn flip_once(&mut self) -> bool {
        for i in 0..self.triangles.len() {
            for j in 0..i {
                for k in 0..3 {
                    let [a, b, c] = rotated(self.triangles[i], k);
                    let Some(l) = (0..3).find(|&l| self.triangles[j][l] == b && self.triangles[j][(l + 1) % 3] == a) else {
                        continue;
                    };
                    let d = self.triangles[j][(l + 2) % 3];
                    if c == d || self.is_slit(a, b) {
                        continue;
                    }
                    let before = self.quality(a, b, c).min(self.quality(b, a, d));
                    let after = self.quality(c, d, b).min(self.quality(d, c, a));
                    if after > before * (1.0 + 1e-9) && after > 0.0 && !self.has_edge(c, d) {
                        self.triangles[i] = [c, d, b];
                        self.triangles[j] = [d, c, a];
                        return true;
                    }
                }
            }
        }
        false
    }

    /// True for the edge of an inner polygon of two points: a slit, which takes nothing out and stays an edge.
    fn is_slit(&self, a: u16, b: u16) -> bool {
        matches!(self.inner[..], [p, q] if [a, b] == [p, q] || [a, b] == [q, p])
    }

    fn has_edge(&self, a: u16, b: u16) -> bool {
        self.triangles.iter().any(|t| t.contains(&a) && t.contains(&b))
    }

    /// Shape of a triangle: doubled signed area over the longest side squared; at most 0.87, 0 when collinear.
    fn quality(&self, a: u16, b: u16, c: u16) -> f64 {
        let [p, q, r] = [a, b, c].map(|i| self.points[i as usize]);
        if p.lines & q.lines & r.lines != 0 {
            return 0.0;
        }
        orient2d(p.at, q.at, r.at) / squared(p.at, q.at).max(squared(q.at, r.at)).max(squared(r.at, p.at))
    }

    /// `slack`: how far outside still counts, in lengths of the side.
    fn in_closed_triangle(&self, p: u16, [a, b, c]: [u16; 3], slack: f64) -> bool {
        let side = |x: u16, y: u16| {
            let [p, x, y] = [p, x, y].map(|i| self.points[i as usize]);
            if p.lines & x.lines & y.lines != 0 { 0.0 } else { orient2d(x.at, y.at, p.at) + slack * squared(x.at, y.at) }
        };
        side(a, b) >= 0.0 && side(b, c) >= 0.0 && side(c, a) >= 0.0
    }
}

/// True if `a` and `b` follow one another in the ring.
fn has_side(ring: &[u16], a: u16, b: u16) -> bool {
    let n = ring.len();
    (0..n).any(|i| [ring[i], ring[(i + 1) % n]] == [a, b] || [ring[i], ring[(i + 1) % n]] == [b, a])
}

fn rotated(t: [u16; 3], k: usize) -> [u16; 3] {
    [t[k], t[(k + 1) % 3], t[(k + 2) % 3]]
}

fn squared(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
}

/// Sine of a triangle's smallest angle: the angle between its two longer sides.
pub(super) fn smallest_sine(p: DVec3, q: DVec3, r: DVec3) -> f64 {
    let [a, b, c] = [p - q, q - r, r - p].map(DVec3::length_squared);
    let shortest = a.min(b).min(c);
    let product = if shortest > 0.0 { (a * b * c / shortest).sqrt() } else { 0.0 };
    if product > 0.0 { (q - p).cross(r - p).length() / product } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(points: &[([f64; 2], u32)], outer: &[u16], inner: &[u16], on_face: &[bool]) -> Region {
        let mut region = Region {
            points: points.iter().map(|&(at, lines)| RegionPoint { at, lines }).collect(),
            outer: outer.to_vec(),
            inner: inner.to_vec(),
            inner_on_face: on_face.to_vec(),
            ..Region::default()
        };
        region.triangulate();
        region
    }

    fn area(region: &Region) -> f64 {
        region
            .triangles
            .iter()
            .map(|t| {
                orient2d(region.points[t[0] as usize].at, region.points[t[1] as usize].at, region.points[t[2] as usize].at) / 2.0
            })
            .sum()
    }

    /// Every directed edge occurs once, and those without a partner are the region's boundary.
    fn boundary(region: &Region) -> Vec<(u16, u16)> {
        let edges: Vec<(u16, u16)> = region.triangles.iter().flat_map(|t| (0..3).map(|k| (t[k], t[(k + 1) % 3]))).collect();
        let mut sorted = edges.clone();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), edges.len(), "an edge occurs twice");
        sorted.into_iter().filter(|&(a, b)| !edges.contains(&(b, a))).collect()
    }

    const CORNERS: [([f64; 2], u32); 3] = [([0.0, 0.0], 0b101), ([4.0, 0.0], 0b011), ([0.0, 4.0], 0b110)];

    #[test]
    fn points_on_edges_make_no_flat_triangle() {
        let mut points = CORNERS.to_vec();
        points.extend([([1.0, 0.0], 1), ([2.0, 0.0], 1), ([3.0, 0.0], 1)]);
        let r = region(&points, &[0, 3, 4, 5, 1, 2], &[], &[]);
        assert_eq!(r.triangles.len(), 4);
        assert!((area(&r) - 8.0).abs() < 1e-12);
        assert_eq!(boundary(&r).len(), 6);
    }

    #[test]
    fn a_hole_leaves_an_annulus() {
        let mut points = CORNERS.to_vec();
        points.extend([([0.5, 0.5], 0), ([1.5, 0.5], 0), ([1.5, 1.0], 0), ([0.5, 1.0], 0)]);
        let r = region(&points, &[0, 1, 2], &[3, 4, 5, 6], &[false; 4]);
        assert!((area(&r) - 7.5).abs() < 1e-12);
        assert_eq!((r.triangles.len(), boundary(&r).len()), (7, 7));
    }

    #[test]
    fn a_band_through_the_face_leaves_two_parts() {
        let mut points = CORNERS.to_vec();
        points.extend([([1.0, 0.0], 1 | 8), ([2.0, 0.0], 1 | 16), ([2.0, 2.0], 2 | 16), ([1.0, 3.0], 2 | 8)]);
        let r = region(&points, &[0, 3, 4, 1, 5, 6, 2], &[3, 4, 5, 6], &[true, false, true, false]);
        assert!((area(&r) - (8.0 - 2.5)).abs() < 1e-12);
        assert_eq!(boundary(&r).len(), 7);
    }

    #[test]
    fn a_polygon_that_touches_the_edge_in_a_point_leaves_a_pinched_ring() {
        let mut points = CORNERS.to_vec();
        points.extend([([2.0, 0.0], 1), ([2.5, 1.0], 0), ([1.5, 1.0], 0)]);
        let r = region(&points, &[0, 3, 1, 2], &[3, 4, 5], &[false; 3]);
        assert!((area(&r) - 7.5).abs() < 1e-12);
        assert_eq!(boundary(&r).len(), 7);
    }

    #[test]
    fn a_polygon_that_touches_a_corner_leaves_one_ring() {
        let mut points = CORNERS.to_vec();
        points.extend([([2.0, 1.0], 0), ([1.0, 2.0], 0)]);
        let r = region(&points, &[0, 1, 2], &[0, 3, 4], &[false; 3]);
        assert!((area(&r) - 6.5).abs() < 1e-12);
        assert_eq!(boundary(&r).len(), 6);
    }

    #[test]
    fn slits_take_nothing_out_and_stay_edges() {
        // inside, from an edge inwards, across, and a hair too short for its length to be seen
        let e = 1e-17;
        let (inside, edge) = ([([1.0, 1.0], 8), ([1.5, 0.5], 8)], [([2.0, 0.0], 1 | 8), ([1.0, 1.0], 8)]);
        let (across, hair) = ([([2.0, 0.0], 1 | 8), ([2.0, 2.0], 2 | 8)], [([2.0, 0.0], 1 | 8), ([2.0, e], 8)]);
        for (ends, outer) in [(inside, &[0, 1, 2][..]), (edge, &[0, 3, 1, 2]), (across, &[0, 3, 1, 4, 2]), (hair, &[0, 3, 1, 2])]
        {
            let mut points = CORNERS.to_vec();
            points.extend(ends);
            let r = region(&points, outer, &[3, 4], &[false; 2]);
            assert!((area(&r) - 8.0).abs() < 1e-12);
            assert_eq!(boundary(&r).len(), outer.len());
            let has = |a, b| r.triangles.iter().any(|t| (0..3).any(|k| rotated(*t, k)[..2] == [a, b]));
            assert!(has(3, 4) && has(4, 3), "{:?}", r.triangles);
        }
    }

    #[test]
    fn all_taken_leaves_nothing() {
        let r = region(&CORNERS, &[0, 1, 2], &[0, 1, 2], &[true; 3]);
        assert!(r.triangles.is_empty());
    }
}
