//! One face against one convex body: the part of the face inside, as a convex polygon with provenance (MATHS 5.6).
//!
//! Sequential clipping by half-spaces, on signs alone. Points are never evaluated: a point is a corner of the face, the
//! crossing of a face edge with a plane, or the meeting of two planes inside the face, and each sign is an exact
//! determinant of the corners' plane values. So the result is a convex polygon whatever the rounding.

use crate::geometry::predicates::{det2, sign_det2, sign_det3};

/// Planes a body can have: two joints and four sides of two triangles each.
pub const MAX_PLANES: usize = 10;

/// Values of every plane at one vertex; negative inside. Entry `k` belongs to plane `k`.
pub type PlaneValues = [f64; MAX_PLANES];

/// A point of a clipped face, by what it lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Point {
    /// Corner of the face, 0 to 2.
    Corner(u8),
    /// Where face edge `edge` (from corner `edge` to the next) crosses `plane`.
    Edge {
        /// Face edge, 0 to 2.
        edge: u8,
        /// Plane.
        plane: u8,
    },
    /// Where two planes meet inside the face; `planes[0] < planes[1]`.
    Inner {
        /// The two planes.
        planes: [u8; 2],
    },
}

/// What an edge of the polygon runs along.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carrier {
    /// An edge of the face.
    Face(u8),
    /// A plane of the body.
    Plane(u8),
}

/// The part of a face inside the body: points in the face's orientation; `carriers[i]` lies under the edge from point `i`
/// to the next.
#[derive(Clone, Debug, Default)]
pub struct ClippedFace {
    /// Points, counter-clockwise like the face.
    pub points: Vec<Point>,
    /// Carriers of the edges that start at the points.
    pub carriers: Vec<Carrier>,
    spare: (Vec<Point>, Vec<Carrier>),
    signs: Vec<i32>,
}

impl ClippedFace {
    /// Makes room for so many points.
    pub fn make_room(&mut self, points: usize) {
        for (points_of, carriers) in [(&mut self.points, &mut self.carriers), (&mut self.spare.0, &mut self.spare.1)] {
            points_of.reserve(points);
            carriers.reserve(points);
        }
        self.signs.reserve(points);
    }

    /// Clips the face with corner `values` to the inside of the first `planes` planes. Returns false, leaving the polygon
    /// empty, if no point of the face lies strictly inside. Points exactly on a plane count as outside (MATHS 6).
    pub fn clip(&mut self, values: &[&PlaneValues; 3], planes: usize) -> bool {
        self.points.clear();
        self.carriers.clear();
        // most candidate faces lie outside one plane altogether
        if (0..planes).any(|k| values.iter().all(|v| v[k] >= 0.0)) {
            return false;
        }
        self.points.extend((0..3).map(Point::Corner));
        self.carriers.extend((0..3).map(Carrier::Face));
        for plane in 0..planes {
            if !self.clip_plane(values, plane) {
                self.points.clear();
                self.carriers.clear();
                return false;
            }
        }
        true
    }

    fn clip_plane(&mut self, values: &[&PlaneValues; 3], plane: usize) -> bool {
        self.signs.clear();
        self.signs.extend(self.points.iter().map(|&p| point_sign(p, values, plane)));
        if !self.signs.iter().any(|&s| s < 0) {
            return false;
        }
        if !self.signs.iter().any(|&s| s > 0) {
            return true;
        }
        let n = self.points.len();
        let (points, carriers) = &mut self.spare;
        points.clear();
        carriers.clear();
        let mut push = |point: Point, carrier: Carrier| {
            points.push(point);
            carriers.push(carrier);
        };
        for i in 0..n {
            let (here, next, carrier) = (self.signs[i], self.signs[(i + 1) % n], self.carriers[i]);
            if here <= 0 {
                // leaving at a point on the plane: from here on the polygon runs along the plane
                push(self.points[i], if here == 0 && next > 0 { Carrier::Plane(plane as u8) } else { carrier });
            }
            if here < 0 && next > 0 {
                push(crossing(carrier, plane as u8), Carrier::Plane(plane as u8));
            } else if here > 0 && next < 0 {
                push(crossing(carrier, plane as u8), carrier);
            }
        }
        std::mem::swap(&mut self.points, points);
        std::mem::swap(&mut self.carriers, carriers);
        true
    }
}

fn crossing(carrier: Carrier, plane: u8) -> Point {
    match carrier {
        Carrier::Face(edge) => Point::Edge { edge, plane },
        Carrier::Plane(other) => Point::Inner { planes: [other.min(plane), other.max(plane)] },
    }
}

fn sign(x: f64) -> i32 {
    i32::from(x > 0.0) - i32::from(x < 0.0)
}

/// Exact sign of `plane` at a point of the face.
pub fn point_sign(point: Point, values: &[&PlaneValues; 3], plane: usize) -> i32 {
    match point {
        Point::Corner(c) => sign(values[c as usize][plane]),
        Point::Edge { edge, plane: k } => {
            let k = k as usize;
            if k == plane {
                return 0;
            }
            let (a, b) = (values[edge as usize], values[(edge as usize + 1) % 3]);
            // value at the crossing = (a_k b_n - b_k a_n) / (a_k - b_k)
            sign_det2(a[k], a[plane], b[k], b[plane]) * sign(a[k] - b[k])
        }
        Point::Inner { planes: [k, m] } => {
            let (k, m) = (k as usize, m as usize);
            if k == plane || m == plane {
                return 0;
            }
            let row = |n: usize| [values[0][n], values[1][n], values[2][n]];
            let (rk, rm) = (row(k), row(m));
            let weight_sign = (0..3)
                .map(|i| {
                    let (p, q) = ((i + 1) % 3, (i + 2) % 3);
                    sign_det2(rk[p], rk[q], rm[p], rm[q])
                })
                .find(|&s| s != 0)
                .unwrap_or(1);
            sign_det3(rk, rm, row(plane)) * weight_sign
        }
    }
}

/// Barycentric weights of a point over the face's corners: not negative, sum 1, exact zeros where it lies on an edge.
pub fn point_weights(point: Point, values: &[&PlaneValues; 3]) -> [f64; 3] {
    let mut weights = [0.0; 3];
    match point {
        Point::Corner(c) => weights[c as usize] = 1.0,
        Point::Edge { edge, plane } => {
            let (i, j) = (edge as usize, (edge as usize + 1) % 3);
            let t = edge_parameter(values[i][plane as usize], values[j][plane as usize]);
            (weights[i], weights[j]) = (1.0 - t, t);
        }
        Point::Inner { planes: [k, m] } => {
            let (k, m) = (k as usize, m as usize);
            let raw: [f64; 3] = std::array::from_fn(|i| {
                let (p, q) = ((i + 1) % 3, (i + 2) % 3);
                // two planes may meet the face in lines that all but coincide: the products cancel to nothing but rounding
                det2(values[p][k], values[q][k], values[p][m], values[q][m])
            });
            let total = raw[0] + raw[1] + raw[2];
            let clamped = raw.map(|w| (w * total.signum()).max(0.0));
            let sum: f64 = clamped.iter().sum();
            weights = if sum > 0.0 { clamped.map(|w| w / sum) } else { middle_of_line(values, k) };
        }
    }
    weights
}

/// The middle of the line in which plane `k` crosses a face.
fn middle_of_line(values: &[&PlaneValues; 3], k: usize) -> [f64; 3] {
    let mut weights = [0.0; 3];
    for (i, j) in [(0, 1), (1, 2), (2, 0)] {
        let (a, b) = (values[i][k], values[j][k]);
        if sign(a) * sign(b) < 0 {
            let t = edge_parameter(a, b);
            weights[i] += 1.0 - t;
            weights[j] += t;
        } else if a == 0.0 {
            weights[i] += 1.0;
        }
    }
    let sum: f64 = weights.iter().sum();
    if sum > 0.0 { weights.map(|w| w / sum) } else { [1.0 / 3.0; 3] }
}

/// Where an edge with end values `a` and `b` of opposite signs crosses zero: 0 at `a`, 1 at `b`, strictly between.
pub fn edge_parameter(a: f64, b: f64) -> f64 {
    let t = a / (a - b);
    t.clamp(f64::EPSILON, 1.0 - f64::EPSILON)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn values(rows: &[[f64; 3]]) -> [PlaneValues; 3] {
        std::array::from_fn(|c| std::array::from_fn(|k| rows.get(k).map_or(-1.0, |r| r[c])))
    }

    #[test]
    fn a_corner_is_cut_off() {
        let v = values(&[[-1.0, 1.0, 1.0]]);
        let mut face = ClippedFace::default();
        assert!(face.clip(&[&v[0], &v[1], &v[2]], 1));
        assert_eq!(face.points, [Point::Corner(0), Point::Edge { edge: 0, plane: 0 }, Point::Edge { edge: 2, plane: 0 }]);
        assert_eq!(face.carriers, [Carrier::Face(0), Carrier::Plane(0), Carrier::Face(2)]);
    }

    #[test]
    fn a_face_in_a_plane_is_outside() {
        let v = values(&[[0.0, 0.0, 0.0]]);
        assert!(!ClippedFace::default().clip(&[&v[0], &v[1], &v[2]], 1));
    }

    /// Planes that cross a face in all but the same line meet on that line, whatever rounding makes of the products.
    #[test]
    fn planes_that_all_but_coincide_meet_on_their_line() {
        let row = [0.3, -0.7, 0.11];
        for (n, by) in [1e-9, 1e-13, 1e-15, 3e-16].into_iter().enumerate() {
            let tilted = [row[0] * (1.0 + by), row[1], row[2] * (1.0 - 2.0 * by)];
            let v = values(&[row, tilted]);
            let refs = [&v[0], &v[1], &v[2]];
            let weights = point_weights(Point::Inner { planes: [0, 1] }, &refs);
            let value = |weights: [f64; 3]| (0..3).map(|i| weights[i] * row[i]).sum::<f64>();
            assert!(value(weights).abs() < 1e-15, "{n}: {weights:?}");
            let middle = middle_of_line(&refs, 0);
            assert!(value(middle).abs() < 1e-15 && middle.iter().all(|w| *w > 0.0), "{middle:?}");
            assert!(value([1.0 / 3.0; 3]).abs() > 0.05, "the middle of the face is not on it");
        }
    }

    proptest! {
        /// The area inside plus the areas cut off, plane by plane, equals the whole; coarse values force every tie.
        #[test]
        fn areas_add_up(rows in prop::collection::vec(prop::array::uniform3(-3i32..4), 1..MAX_PLANES)) {
            let rows: Vec<[f64; 3]> = rows.iter().map(|r| r.map(f64::from)).collect();
            let v = values(&rows);
            let refs = [&v[0], &v[1], &v[2]];
            let mut face = ClippedFace::default();
            let inside = face.clip(&refs, rows.len());
            let points: Vec<[f64; 3]> = face.points.iter().map(|&p| point_weights(p, &refs)).collect();
            let area: f64 = (0..points.len()).map(|i| {
                let (a, b) = (points[i], points[(i + 1) % points.len()]);
                a[1] * b[2] - b[1] * a[2]
            }).sum();
            // reference: clip with f64 polygon arithmetic on the same linear functions
            let mut reference = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            for row in &rows {
                let value = |p: &[f64; 3]| p[0] * row[0] + p[1] * row[1] + p[2] * row[2];
                let mut next = Vec::new();
                for i in 0..reference.len() {
                    let (a, b): ([f64; 3], [f64; 3]) = (reference[i], reference[(i + 1) % reference.len()]);
                    let (da, db) = (value(&a), value(&b));
                    if da <= 0.0 { next.push(a); }
                    if da * db < 0.0 {
                        let t = da / (da - db);
                        next.push(std::array::from_fn(|k| a[k] + t * (b[k] - a[k])));
                    }
                }
                reference = next;
            }
            let expected: f64 = (0..reference.len()).map(|i| {
                let (a, b) = (reference[i], reference[(i + 1) % reference.len()]);
                a[1] * b[2] - b[1] * a[2]
            }).sum();
            if rows.iter().any(|r| r.iter().all(|&x| x == 0.0)) {
                prop_assert!(!inside, "a face in a plane counts as outside");
            } else {
                prop_assert!(inside || expected.abs() < 1e-12);
                prop_assert!((area - expected).abs() < 1e-12, "{} {}", area, expected);
            }
        }
    }
}
