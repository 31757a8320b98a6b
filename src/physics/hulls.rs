//! Hulls of pieces as rapier can hold them.

use super::rigid::Solid;
use glam::{DVec3, Vec3};
use rapier3d::parry::shape::{ConvexPolyhedron, SharedShape};

/// Corners of a face beside the four that hold it lie this far behind it, for each metre that they are beyond the edges between those: a slope
/// of three degrees, twice of what parry takes for one face.
const DRAWN_IN: f32 = 0.052;

/// The hull of a set of points for rapier, and as soft layers would feel it.
pub(super) fn convex(points: &[DVec3]) -> Option<(SharedShape, Solid)> {
    let whole = round_hull(points)?;
    let (points, faces) = whole.to_trimesh();
    let points: Vec<DVec3> = points.iter().map(|p| p.as_dvec3()).collect();
    let solid = Solid::convex(&points, &faces)?;
    Some((four_cornered(whole), solid))
}

/// The hull of a set of points, thickened where they lie in a plane.
fn round_hull(points: &[DVec3]) -> Option<ConvexPolyhedron> {
    let (low, high) = points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    let extent = high - low;
    if !(extent.is_finite() && extent.max_element() > 0.0) {
        return None;
    }
    let thin = 0.01 * extent.max_element();
    let mut all: Vec<Vec3> = points.iter().map(|p| p.as_vec3()).collect();
    let thinnest = if extent.x <= extent.y.min(extent.z) {
        DVec3::X
    } else if extent.y <= extent.z {
        DVec3::Y
    } else {
        DVec3::Z
    };
    if extent.min_element() < thin {
        let by = (thin * thinnest).as_vec3();
        all = all.iter().flat_map(|p| [*p - by, *p + by]).collect();
    }
    ConvexPolyhedron::from_convex_hull(&all).or_else(|| {
        // Points in a plane askew to the axes, or in a line: the box around them.
        let half = (0.5 * extent).max(DVec3::splat(thin));
        let corners: Vec<Vec3> = (0..8)
            .map(|k| {
                0.5 * (low + high) + half * DVec3::from_array(std::array::from_fn(|m| if k >> m & 1 == 0 { -1.0 } else { 1.0 }))
            })
            .map(|p| p.as_vec3())
            .collect();
        ConvexPolyhedron::from_convex_hull(&corners)
    })
}

/// Rapier holds a face by four of its corners, the first four: a piece that lies on a face with more tips over where there is none, and
/// sinks in. So of such a face, as a cut leaves, the four that span most stay where they are, as a face of their own, and the others are
/// drawn in a little behind it.
fn four_cornered(whole: ConvexPolyhedron) -> SharedShape {
    let mut points = whole.points().to_vec();
    for face in whole.faces() {
        let (first, count) = (face.first_vertex_or_edge as usize, face.num_vertices_or_edges as usize);
        let corners = &whole.vertices_adj_to_face()[first..first + count];
        if count <= 4 {
            continue;
        }
        let at = |k: usize| whole.points()[corners[k % count] as usize];
        let held = widest_four(count, at);
        for (side, &from) in held.iter().enumerate() {
            let to = if side == 3 { held[0] + count } else { held[side + 1] };
            let along = (at(to) - at(from)).normalize_or_zero();
            for k in from + 1..to {
                let beyond = (at(k) - at(from)).reject_from_normalized(along).length();
                points[corners[k % count] as usize] -= DRAWN_IN * beyond * face.normal;
            }
        }
    }
    let drawn_in = (points != whole.points()).then(|| ConvexPolyhedron::from_convex_hull(&points)).flatten();
    SharedShape::new(drawn_in.unwrap_or(whole))
}

/// Of a convex polygon's `count` corners, five or more, the four whose quadrangle has the largest area, ascending.
fn widest_four(count: usize, at: impl Fn(usize) -> Vec3) -> [usize; 4] {
    let across = |a: usize, b: usize, c: usize| (at(b % count) - at(a)).cross(at(c % count) - at(a)).length();
    let mut best = (f32::NEG_INFINITY, [0, 1, 2, 3]);
    for a in 0..count - 2 {
        // on each side of the diagonal the corner farthest from it, which goes round as the diagonal turns
        let (mut b, mut d) = (a + 1, a + 3);
        for c in a + 2..count.min(a + count - 1) {
            while b + 1 < c && across(a, c, b + 1) >= across(a, c, b) {
                b += 1;
            }
            d = d.max(c + 1);
            while d + 1 < a + count && across(a, c, d + 1) >= across(a, c, d) {
                d += 1;
            }
            let area = across(a, c, b) + across(a, c, d);
            if area > best.0 {
                best = (area, [a, b, c, d % count]);
            }
        }
    }
    let (_, mut four) = best;
    four.sort_unstable();
    four
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A drum of `n` corners at each end, one metre across, 0.4 high.
    fn drum(n: usize) -> Vec<DVec3> {
        let corner = |k: usize| {
            let (sin, cos) = (k as f64 / n as f64 * std::f64::consts::TAU).sin_cos();
            DVec3::new(0.5 * cos, 0.0, 0.5 * sin)
        };
        (0..n).flat_map(|k| [corner(k) - 0.2 * DVec3::Y, corner(k) + 0.2 * DVec3::Y]).collect()
    }

    /// Faces of the shape that look up or down, by their corners.
    fn ends(shape: &SharedShape) -> Vec<u32> {
        let faces = shape.as_convex_polyhedron().unwrap().faces();
        faces.iter().filter(|f| f.normal.y.abs() > 0.9999).map(|f| f.num_vertices_or_edges).collect()
    }

    #[test]
    fn a_face_has_the_four_corners_that_span_most() {
        for n in [5, 6, 7, 12, 16, 31] {
            let whole = round_hull(&drum(n)).unwrap();
            assert_eq!(ends(&SharedShape::new(whole)), [n as u32; 2], "as it was");
            let shape = convex(&drum(n)).unwrap().0;
            assert_eq!(ends(&shape), [4; 2], "{n} corners");
            let held = shape.as_convex_polyhedron().unwrap();
            let top: Vec<&Vec3> = held.points().iter().filter(|p| p.y > 0.1999).collect();
            assert_eq!(top.len(), 4, "{n} corners");
            // a square has 0.64 of the circle, and no five corners leave less than 0.85 of that
            let middle = top.iter().copied().sum::<Vec3>() / 4.0;
            assert!(middle.with_y(0.0).length() < 0.17, "{n} corners: {middle}");
            let lowest = held.points().iter().map(|p| p.y.abs()).fold(1.0, f32::min);
            assert!(lowest > 0.2 - 0.02, "{n} corners: drawn in to {lowest}");
        }
        let cube: Vec<DVec3> =
            (0..8).map(|k| DVec3::from_array(std::array::from_fn(|m| if k >> m & 1 == 0 { -1.0 } else { 1.0 }))).collect();
        let known = convex(&cube).unwrap().0;
        assert!(known.as_convex_polyhedron().unwrap().points().iter().all(|p| p.abs() == Vec3::ONE), "a cube stays one");
    }
}
