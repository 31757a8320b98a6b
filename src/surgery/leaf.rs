//! Leaves: flat convex pieces of the surface that a blade of width 0 sweeps, and where they meet a face (MATHS 5.3, 5.6).
//!
//! A leaf is a plane and the bounds that cut a convex polygon out of it. As in [`super::clip`] no point is ever evaluated
//! to find its side: a point of a face is a corner, the crossing of a face edge with a plane, or the meeting of the leaf's
//! plane with a bound inside the face, and every sign is an exact determinant of the corners' values. What lies exactly on
//! the leaf's plane is cut there; what lies exactly on a bound is outside.

use super::boxes::{Slit, plane_side};
use super::clip::edge_parameter;
use crate::geometry::Plane;
use crate::geometry::predicates::{sign_cross, sign_det2, sign_det3};
use glam::DVec3;
use smallvec::{SmallVec, smallvec};

/// Lines that a leaf may share with another, as bits: vertices made on them lie exactly on both (MATHS 5.6: zero by tag).
pub mod line {
    /// The blade at the earlier sample.
    pub const START: u8 = 1;
    /// The blade at the later sample.
    pub const END: u8 = 2;
    /// The diagonal between a strip's two triangles.
    pub const DIAGONAL: u8 = 4;
}

/// One side of a leaf's polygon.
#[derive(Clone, Copy, Debug)]
pub struct Bound {
    /// Negative on the leaf's side.
    pub plane: Plane,
    /// Which of [`mod@line`] the polygon's edge is; 0 for none.
    pub line: u8,
}

/// A convex polygon in a plane.
#[derive(Clone, Debug)]
pub struct Leaf {
    /// The plane; its positive side is the plus side of the cut.
    pub plane: Plane,
    /// One for each edge of the polygon.
    pub bounds: SmallVec<[Bound; 4]>,
    /// Lines shared with other leaves: the plane contains them.
    pub lines: u8,
    /// A vertex this near to the plane counts as on it, metres; 0: only one that lies on it exactly. It is not moved: the
    /// cut runs through it instead of past it.
    pub tolerance: f64,
    /// The tolerance that it was made with: slivers are as thin as so many of that, whatever else counts as on the plane.
    pub grain: f64,
    /// Bounds, padded by rounding.
    pub min: DVec3,
    /// Bounds, padded by rounding.
    pub max: DVec3,
}

/// The bound through an edge of a polygon, if another leaf or a joint prescribes it.
type Given = Option<(Plane, u8)>;

impl Leaf {
    /// The leaf of a convex polygon with `corners` in order, exactly in a plane or a triangle; `given` holds bounds that are
    /// shared with others. `None` if it has no area or is not strictly convex.
    fn new(corners: &[DVec3], given: &[Given]) -> Option<Self> {
        let n = corners.len();
        let normal = polygon_normal(corners);
        let size = corners.iter().map(|p| p.distance(corners[0])).fold(0.0, f64::max);
        let unit = normal.try_normalize().filter(|_| size.is_finite())?;
        // the three corners that span the plane best
        let triple = best_triple(corners)?;
        let mut leaf = Self {
            plane: Plane::Points(triple),
            bounds: SmallVec::new(),
            lines: 0,
            tolerance: 0.0,
            grain: 0.0,
            min: corners.iter().copied().reduce(DVec3::min)?,
            max: corners.iter().copied().reduce(DVec3::max)?,
        };
        let pad = DVec3::splat(1e-9 * size);
        (leaf.min, leaf.max) = (leaf.min - pad, leaf.max + pad);
        for k in 0..n {
            let (a, b) = (corners[k], corners[(k + 1) % n]);
            let (plane, line) = given.get(k).copied().flatten().unwrap_or((Plane::Points([a, b, a + unit * size]), 0));
            let others = || (2..n).map(|j| corners[(k + j) % n]);
            let plane = if others().all(|p| plane.value(p) < 0.0) { plane } else { plane.flipped() };
            if !others().all(|p| plane.value(p) < 0.0) {
                return None;
            }
            leaf.bounds.push(Bound { plane, line });
            leaf.lines |= line;
        }
        Some(leaf)
    }

    /// A convex polygon with nothing next to it: the part of a plane that a blade swept. The plane is that of the three
    /// successive corners that span it best. `None` if it has no area or is not strictly convex.
    pub fn polygon(corners: &[DVec3]) -> Option<Self> {
        if corners.len() < 3 || !corners.iter().all(|p| p.is_finite()) {
            return None;
        }
        Self::new(corners, &[])
    }

    /// The part of `plane` inside a convex polygon whose corners lie on it but for rounding; positive is the side from
    /// which the corners run counter-clockwise. `None` as for [`Leaf::polygon`].
    pub fn in_plane(plane: Plane, corners: &[DVec3]) -> Option<Self> {
        let leaf = Self::polygon(corners)?;
        let along = plane.normal().dot(leaf.plane.normal());
        (along != 0.0).then(|| Self { plane: if along > 0.0 { plane } else { plane.flipped() }, ..leaf })
    }

    /// The triangles of a slit, the one at the start first; one quadrangle where they lie exactly in one plane. Triangles
    /// without area are left out. `tolerance` should cover the grid that blades lie on: a path that aims at a vertex would
    /// else run beside it by the grid's rounding and leave slivers as thin as that.
    pub fn of_slit(slit: &Slit, tolerance: f64) -> SmallVec<[Self; 2]> {
        let c = slit.corners;
        let end = |k: usize| {
            let space = &slit.ends[k];
            let plane = Plane::Points(space.points);
            Some((if space.flipped { plane.flipped() } else { plane }, if k == 0 { line::START } else { line::END }))
        };
        if plane_side(&[c[0], c[1], c[2]], c[3]) == 0.0
            && let Some(leaf) = Self::new(&c, &[None, end(1), None, end(0)])
        {
            return smallvec![Self { tolerance, grain: tolerance, ..leaf }];
        }
        let across = |t: [usize; 3]| (c[t[1]] - c[t[0]]).cross(c[t[2]] - c[t[0]]).normalize_or_zero();
        let normal = across([0, 1, 2]) + across([0, 2, 3]);
        let diagonal = Plane::Points([c[0], c[2], c[0] + normal.normalize_or_zero() * c[0].distance(c[2])]);
        let diagonal = Some((diagonal, line::DIAGONAL));
        let first = Self::new(&[c[0], c[2], c[3]], &[diagonal, None, end(0)]);
        let second = Self::new(&[c[0], c[1], c[2]], &[None, end(1), diagonal]);
        first.into_iter().chain(second).map(|leaf| Self { tolerance, grain: tolerance, ..leaf }).collect()
    }

    /// Counts vertices as on the plane that are so near to it, metres, if that is more than before.
    pub fn tolerate(&mut self, tolerance: f64) {
        if tolerance > self.tolerance {
            // a leaf runs along edges beside it
            let pad = DVec3::splat(tolerance);
            (self.tolerance, self.min, self.max) = (tolerance, self.min - pad, self.max + pad);
        }
    }

    /// Value of the leaf's plane at a vertex, 0 within the tolerance.
    pub fn value(&self, p: DVec3) -> f64 {
        let value = self.plane.value(p);
        if self.tolerance > 0.0 && self.plane.distance(p).abs() <= self.tolerance { 0.0 } else { value }
    }

    /// Plane 0 is the leaf's own, plane `k + 1` its bound `k`.
    pub fn plane_at(&self, k: usize) -> &Plane {
        if k == 0 { &self.plane } else { &self.bounds[k - 1].plane }
    }

    /// A leaf that nothing bounds, for crossings that are told: its plane means nothing.
    pub(super) fn unbounded() -> Self {
        let plane = Plane::Points([DVec3::ZERO, DVec3::X, DVec3::Y]);
        Self { plane, bounds: SmallVec::new(), lines: 0, tolerance: 0.0, grain: 0.0, min: DVec3::ZERO, max: DVec3::ZERO }
    }
}

/// Twice the polygon's area along its normal.
fn polygon_normal(corners: &[DVec3]) -> DVec3 {
    let fan = corners.windows(2).map(|w| (w[0] - corners[0]).cross(w[1] - corners[0]));
    fan.sum()
}

/// The largest triangle of three successive corners, in their order.
fn best_triple(corners: &[DVec3]) -> Option<[DVec3; 3]> {
    let n = corners.len();
    let triples = (0..n).map(|k| [corners[k], corners[(k + 1) % n], corners[(k + 2) % n]]);
    let area = |t: &[DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]).length_squared();
    // the first of equal ones, so that a strip's plane does not depend on the rest
    triples.fold(None, |best: Option<[DVec3; 3]>, t| if best.is_none_or(|b| area(&t) > area(&b)) { Some(t) } else { best })
}

/// A point of a face by what it lies on. Plane 0 is the leaf's, plane `k + 1` its bound `k`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At {
    /// Corner of the face, 0 to 2.
    Corner(u8),
    /// Where face edge `edge` (from corner `edge` to the next) crosses `plane`.
    Edge {
        /// Face edge, 0 to 2.
        edge: u8,
        /// Plane.
        plane: u8,
    },
    /// Where the leaf's plane and `plane`, one of its bounds, meet inside the face.
    Inner {
        /// Plane of the bound, above 0.
        plane: u8,
    },
}

/// A face as a leaf sees it.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// The leaf.
    pub leaf: &'a Leaf,
    /// Corners.
    pub corners: [DVec3; 3],
    /// Values of all planes at each corner: exact in sign, 0 also by tag.
    pub rows: [&'a [f64]; 3],
}

fn sign(x: f64) -> i32 {
    i32::from(x > 0.0) - i32::from(x < 0.0)
}

/// Exact sign of `plane` at a point of the face.
pub fn sign_at(at: At, face: &Seen<'_>, plane: usize) -> i32 {
    let rows = &face.rows;
    match at {
        At::Corner(c) => sign(rows[c as usize][plane]),
        At::Edge { plane: k, .. } | At::Inner { plane: k } if usize::from(k) == plane => 0,
        At::Inner { .. } if plane == 0 => 0,
        At::Edge { edge, plane: k } => {
            let (i, j, k) = (edge as usize, (edge as usize + 1) % 3, k as usize);
            let (a, b) = (rows[i], rows[j]);
            let planes = [k, plane].map(|n| face.leaf.plane_at(n));
            let values = [[a[k], b[k]], [a[plane], b[plane]]];
            sign_cross(planes[0], planes[1], [face.corners[i], face.corners[j]], values) * sign(a[k] - b[k])
        }
        At::Inner { plane: k } => {
            let row = |n: usize| [rows[0][n], rows[1][n], rows[2][n]];
            let (h, b) = (row(0), row(k as usize));
            let weight = (0..3).map(|i| sign_det2(h[(i + 1) % 3], h[(i + 2) % 3], b[(i + 1) % 3], b[(i + 2) % 3]));
            sign_det3(h, b, row(plane)) * weight.into_iter().find(|&s| s != 0).unwrap_or(1)
        }
    }
}

/// Barycentric weights of a point where the leaf's plane meets bound plane `k` inside the face: not negative, sum 1. It is
/// sought along the leaf's plane, so it lies there even where the bound runs along it and the meeting is ill-conditioned.
pub fn inner_weights(k: usize, rows: &[&[f64]; 3]) -> [f64; 3] {
    let Some(ends) = crossing_ends(rows) else { return [1.0 / 3.0; 3] };
    let [a, b] = ends.map(|at| end_weights(at, rows));
    let value = |w: &[f64; 3]| (0..3).map(|c| w[c] * rows[c][k]).sum::<f64>();
    let (va, vb) = (value(&a), value(&b));
    let t = if va * vb < 0.0 { va / (va - vb) } else { f64::from(u8::from(va.abs() > vb.abs())) };
    let t = t.clamp(f64::EPSILON, 1.0 - f64::EPSILON);
    std::array::from_fn(|c| a[c] * (1.0 - t) + b[c] * t)
}

/// Weights of a corner or of a crossing of an edge with the leaf's plane.
fn end_weights(at: At, rows: &[&[f64]; 3]) -> [f64; 3] {
    let mut weights = [0.0; 3];
    match at {
        At::Corner(c) => weights[c as usize] = 1.0,
        At::Edge { edge, .. } => {
            let (i, j) = (edge as usize, (edge as usize + 1) % 3);
            let t = edge_parameter(rows[i][0], rows[j][0]);
            (weights[i], weights[j]) = (1.0 - t, t);
        }
        At::Inner { .. } => weights = [1.0 / 3.0; 3],
    }
    weights
}

/// The part of the leaf inside a face that it crosses, directed so that the leaf's positive side is on the left (the face
/// seen from outside). `None` if it only touches the face, or runs along an edge of it.
pub fn crossing(face: &Seen<'_>) -> Option<[At; 2]> {
    clip_ends(crossing_ends(&face.rows)?, face, |k| At::Inner { plane: k })
}

/// Where the leaf's plane enters and leaves the face, bounds aside.
fn crossing_ends(rows: &[&[f64]; 3]) -> Option<[At; 2]> {
    let signs: [i32; 3] = std::array::from_fn(|c| sign(rows[c][0]));
    if !signs.contains(&1) || !signs.contains(&-1) {
        return None;
    }
    let at_edge = |edge: usize| At::Edge { edge: edge as u8, plane: 0 };
    let (ends, forward) = if let Some(i) = (0..3).find(|&i| signs[i] == 0) {
        ([At::Corner(i as u8), at_edge((i + 1) % 3)], signs[(i + 2) % 3] > 0)
    } else {
        let i = (0..3).find(|&i| signs[i] != signs[(i + 1) % 3] && signs[i] != signs[(i + 2) % 3])?;
        ([at_edge(i), at_edge((i + 2) % 3)], signs[i] > 0)
    };
    Some(if forward { ends } else { [ends[1], ends[0]] })
}

/// The part of the leaf along face edge `edge`, both ends of which lie on its plane, in the edge's direction.
pub fn along_edge(edge: usize, face: &Seen<'_>) -> Option<[At; 2]> {
    let ends = [At::Corner(edge as u8), At::Corner((edge as u8 + 1) % 3)];
    clip_ends(ends, face, |k| At::Edge { edge: edge as u8, plane: k })
}

/// A segment clipped to the inside of all bounds; `None` if nothing of it is strictly inside one of them.
fn clip_ends([mut a, mut b]: [At; 2], face: &Seen<'_>, meet: impl Fn(u8) -> At) -> Option<[At; 2]> {
    for k in 1..=face.leaf.bounds.len() {
        let (sa, sb) = (sign_at(a, face, k), sign_at(b, face, k));
        if sa >= 0 && sb >= 0 {
            return None;
        }
        if sa > 0 {
            a = meet(k as u8);
        } else if sb > 0 {
            b = meet(k as u8);
        }
    }
    Some([a, b])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_face_is_crossed_with_the_positive_side_on_the_left() {
        // corner 0 above, the others below: the cut runs from edge 0 to edge 2 and has corner 0 on its left
        let mut leaf = Leaf::polygon(&[DVec3::ZERO, DVec3::X, DVec3::Y]).unwrap();
        leaf.bounds.truncate(1);
        let edge = |edge| At::Edge { edge, plane: 0 };
        let corners = [DVec3::ZERO; 3];
        let cross = |rows: [[f64; 2]; 3]| crossing(&Seen { leaf: &leaf, corners, rows: [&rows[0], &rows[1], &rows[2]] });
        assert_eq!(cross([[1.0, -1.0], [-1.0, -1.0], [-1.0, -1.0]]), Some([edge(0), edge(2)]));
        assert_eq!(cross([[-1.0, -1.0], [1.0, -1.0], [1.0, -1.0]]), Some([edge(2), edge(0)]));
        assert_eq!(cross([[0.0, -1.0], [-1.0, -1.0], [1.0, -1.0]]), Some([At::Corner(0), edge(1)]));
        let bounded = [[0.0, 1.0], [-1.0, -2.0], [1.0, -2.0]];
        assert_eq!(cross(bounded), Some([At::Inner { plane: 1 }, edge(1)]));
        let weights = inner_weights(1, &[&bounded[0], &bounded[1], &bounded[2]]);
        assert!((DVec3::from(weights) - DVec3::new(4.0, 1.0, 1.0) / 6.0).length() < 1e-15);
        let touched = [[0.0, -1.0], [0.0, -1.0], [1.0, -1.0]];
        assert_eq!(cross(touched), None);
        let seen = Seen { leaf: &leaf, corners, rows: [&touched[0], &touched[1], &touched[2]] };
        assert_eq!(along_edge(0, &seen), Some([At::Corner(0), At::Corner(1)]));
        assert_eq!(cross([[0.0, 0.0], [-1.0, 1.0], [1.0, 0.0]]), None, "on a bound is outside");
    }

    #[test]
    fn polygons_must_be_convex_and_have_area() {
        let p = |x: f64, y: f64| DVec3::new(x, y, 0.3);
        assert!(Leaf::polygon(&[p(0.0, 0.0), p(1.0, 0.0), p(1.0, 1.0), p(0.0, 1.0)]).is_some());
        assert!(Leaf::polygon(&[p(0.0, 0.0), p(1.0, 0.0), p(0.1, 0.1), p(0.0, 1.0)]).is_none(), "a notch");
        assert!(Leaf::polygon(&[p(0.0, 0.0), p(1.0, 1.0), p(1.0, 0.0), p(0.0, 1.0)]).is_none(), "a bow tie");
        assert!(Leaf::polygon(&[p(0.0, 0.0), p(1.0, 1.0), p(2.0, 2.0)]).is_none(), "a line");
        assert!(Leaf::polygon(&[p(0.0, 0.0), p(1.0, f64::NAN), p(2.0, 2.0)]).is_none());
    }
}
