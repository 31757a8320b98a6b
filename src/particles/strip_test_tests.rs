//! Links and strips: what crosses, what does not, and what lips know.

use super::*;
use crate::particles::test_models::noise;

/// A strip in the plane y = 0 from x = 0 to 1, tip at z = -1, base at z = 0; side +1 is towards -y.
fn strip(d: f64) -> StripGeometry {
    StripGeometry::new([DVec3::new(0.0, 0.0, -1.0), DVec3::new(1.0, 0.0, -1.0), DVec3::new(1.0, 0.0, 0.0), DVec3::ZERO], d)
}

/// Blades that meet a little below the tip or above the base, as round the tip of a cone: the strip ends before, and has one side.
#[test]
fn blades_that_meet_leave_a_strip_its_sides() {
    let (low, high) = (-1.0, 0.0);
    for meet in [-1.1, -1.01, 0.1, 0.7] {
        let at = |x: f64, z: f64| DVec3::new(x * (z - meet), 0.0, z);
        let ends = [(0.1, low), (-0.1, low), (-0.1, high), (0.1, high)];
        let corners = ends.map(|(x, z)| at(x, z));
        let (strip, bare) = (StripGeometry::new(corners, 0.8), StripGeometry::new(corners, 0.0));
        assert!(strip.normals[0].dot(strip.normals[1]) > 0.0 && strip.normal().dot(bare.normal()) > 0.99, "{meet}");
        let (below, above) = (meet < low, meet > high);
        // towards where they meet it ends there, the other way as far as ever
        let reach = [strip.low.z, strip.high.z];
        assert!(if below { reach[0] > meet } else { reach[0] < -1.19 }, "{meet}: {reach:?}");
        assert!(if above { reach[1] < meet } else { reach[1] > 0.79 }, "{meet}: {reach:?}");
        let off = DVec3::new(0.0, 0.05, 0.0);
        for z in [-0.9, -0.5, -0.1] {
            let p = at(0.0, z);
            let sides = [off, -off].map(|d| strip.side_near(p + d));
            assert_eq!(sides, [off, -off].map(|d| bare.side_over(p + d)), "{meet} {z}");
            assert!(strip.crosses(p + off, p - off) && !strip.crosses(p + off, at(0.05, z) + off));
        }
    }
}

/// A blade that moves sideways at its tip, as it is carried to rest: the lower triangle is a needle that stands across the upper. A lip beside
/// the upper end is on its side of the strip, whatever the side of that needle's plane; it lost what lies behind it along the cut.
#[test]
fn a_lip_of_a_twisted_strip_keeps_what_lies_behind_it() {
    let p = |x, y, z| DVec3::new(x, y, z);
    let strip =
        StripGeometry::new([p(-0.54, 21.3, 25.97), p(-0.33, 21.38, 25.92), p(-0.33, 35.83, 31.15), p(-0.54, 35.42, 30.32)], 13.9);
    let [plus, minus] = [(p(-0.822, 33.269, 30.415), 1), (p(0.09, 33.61, 30.01), -1)].map(|(at, side)| lip(at, side));
    assert!(!strip.crosses_link([plus, point(p(-2.106, 31.771, 27.888))]), "behind it on its side");
    assert!(!strip.crosses_link([plus, point(p(-0.41, 33.94, 32.0))]), "before it on its side");
    for other in [minus, point(p(0.3, 33.3, 29.8))] {
        assert!(strip.crosses_link([plus, other]), "on the other side");
    }
}

/// Tissue bent about a point near the end of the blade: at rest one end went back, or all but stood, a little out of the plane.
#[test]
fn a_folded_strip_has_the_same_sides_everywhere() {
    let mut facing = 0;
    for (back, out) in
        [(0.02, 0.0), (0.2, 0.0), (0.2, 1e-5), (0.6, 0.0), (1e-3, 1e-5), (1e-3, -1e-5), (1e-4, 1e-4), (1e-4, -1e-4)]
    {
        for at_base in [false, true] {
            let [near, far] = if at_base { [0.0, -1.0] } else { [-1.0, 0.0] };
            let mut corners = [(0.0, near), (-back, near), (1.0, far), (0.0, far)].map(|(x, z)| DVec3::new(x, 0.0, z));
            corners[1].y = out;
            if at_base {
                corners.reverse();
            }
            let [p, q, r, s] = corners;
            facing += usize::from((q - p).cross(r - p).dot((r - p).cross(s - p)) > 0.0);
            for d in [0.0, 0.2] {
                let strip = StripGeometry::new(corners, d);
                let side = |p: DVec3| strip.side_near(p);
                let off = 0.05 * strip.normal();
                let places: Vec<DVec3> = (1..8)
                    .flat_map(|i| (1..8).map(move |j| DVec3::new(-0.1 + 0.14 * f64::from(i), 0.0, -0.125 * f64::from(j))))
                    .collect();
                for &p in &places {
                    assert_eq!([side(p + off), side(p - off)], [1, -1], "{back} {out} {at_base} {d}: {p}");
                    for &q in &places {
                        for (sign, known) in [(1.0, 1), (-1.0, -1)] {
                            let ends = [p, q].map(|p| p + sign * off);
                            assert!(!strip.crosses(ends[0], ends[1]));
                            assert!(!strip.crosses_link([lip(ends[0], known), point(ends[1])]));
                        }
                    }
                }
                let middle = DVec3::new(0.3, 0.0, far + 0.2 * (near - far));
                assert!(strip.crosses(middle + off, middle - off), "{back} {out} {at_base} {d}");
                assert!(strip.crosses_link([lip(middle + off, 1), point(middle - off)]));
            }
        }
    }
    assert!(facing < 8, "{facing} of 16 are not folded");
}

#[test]
fn a_point_in_a_strip_sees_it_on_both_sides() {
    let strip = StripGeometry::new([DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y], 0.2);
    let off = DVec3::new(0.1, 0.05, 0.3);
    for at in [DVec3::new(0.4, 0.3, 0.0), DVec3::new(0.5, 0.0, 0.0), DVec3::new(0.5, 0.5, 1e-17), DVec3::X] {
        let sight = strip.sight(at, 1.0);
        let crossing = [off, -off].map(|d| strip.crosses(at, at + d));
        assert!(crossing.contains(&true) || at == DVec3::X, "{at}");
        for (d, crosses) in [off, -off].into_iter().zip(crossing) {
            assert!(!crosses || sight.may_meet(at + d), "{at} {d}");
        }
    }
    // a twisted one: its other triangle's corner lies to one side
    for twist in [0.2, -0.2, 1e-4] {
        let strip = StripGeometry::new([DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::new(0.0, 1.0, twist)], 0.0);
        let at = DVec3::new(0.6, 0.3, 0.0);
        let crossing = [off, -off].map(|d| strip.crosses(at, at + d));
        assert!(crossing.contains(&true));
        for (d, crosses) in [off, -off].into_iter().zip(crossing) {
            assert!(!crosses || strip.sight(at, 1.0).may_meet(at + d), "{twist} {d}");
        }
    }
    // beside it in its plane nothing crosses, and a little above it one side does
    let beside = strip.sight(DVec3::new(2.0, 0.5, 0.0), 1.5);
    assert!(!beside.may_meet(DVec3::new(1.0, 0.5, 0.3)) && !beside.may_meet(DVec3::new(1.0, 0.5, -0.3)));
    let above = strip.sight(DVec3::new(0.4, 0.3, 0.01), 1.0);
    assert!(above.may_meet(DVec3::new(0.4, 0.3, -0.3)) && !above.may_meet(DVec3::new(0.4, 0.3, 0.3)));
}

#[test]
fn a_point_sees_no_further_than_the_strip() {
    let draw = |i: u64| DVec3::from_array([0, 1, 2].map(|d| noise(3 * i + d) - 0.5));
    let (mut crossing, mut short, mut seen) = (0, 0, 0);
    for i in 0..4_000 {
        let [a, b, c, d, e] = [0, 1, 2, 3, 4].map(|k| draw(5 * i + k));
        // twisted, leaning and flat ones, some no wider than a hair
        let strip = StripGeometry::new([a, a + 0.3 * b, a + 0.3 * b + 0.5 * c, a + 0.5 * c + 0.1 * (i % 3) as f64 * d], 0.05);
        let (from, towards) = (1.5 * d, a + 0.15 * b + 0.25 * c + 0.3 * e);
        let way = 1.6 * (towards - from);
        let sight = strip.sight(from, 2.5);
        for share in [0.2, 0.4, 0.6, 0.8, 1.0] {
            let p = from + way * share;
            if strip.crosses(from, p) {
                crossing += 1;
                assert!(sight.may_meet(p), "{i} {share}");
                let (low, high) = ((p - 0.01).as_vec3a(), (p + 0.02).as_vec3a());
                assert!(sight.may_meet_box(low, high), "{i} {share}");
            } else if strip.crosses(from, from + way) {
                short += 1;
                seen += usize::from(sight.may_meet(p));
            }
        }
    }
    assert!(crossing > 300 && short > 300, "{crossing} cross, {short} end before");
    assert!(seen < short / 2, "{seen} of {short} links that end before the strip are looked at");
}

#[test]
fn a_lip_of_the_strip_before_is_not_known_beyond_its_reach() {
    let strip = strip(0.2);
    // a bend of the slit has left the lip on the other side of this strip's plane
    let lip = |x: f64| LinkEnd { at: DVec3::new(x, -0.01, -0.5), side: Some(KnownSide { side: -1, own: false }) };
    // the line through both goes on to the strip, the link does not
    assert!(!strip.crosses_link([lip(-0.9), point(DVec3::new(-0.6, -0.008, -0.5))]));
    assert!(!strip.crosses_link([point(DVec3::new(-1.2, -0.012, -0.5)), lip(-0.9)]));
    // at the joint it is known still
    assert!(strip.crosses_link([lip(0.001), point(DVec3::new(0.1, -0.2, -0.5))]));
    assert!(!strip.crosses_link([lip(0.001), point(DVec3::new(0.1, 0.2, -0.5))]));
}

fn point(at: DVec3) -> LinkEnd {
    LinkEnd { at, side: None }
}

fn lip(at: DVec3, side: i8) -> LinkEnd {
    LinkEnd { at, side: Some(KnownSide { side, own: true }) }
}

#[test]
fn links_cross_within_the_extended_strip_only() {
    let strip = strip(0.4);
    let across = |x: f64, z: f64| strip.crosses(DVec3::new(x, -0.1, z), DVec3::new(x, 0.1, z));
    assert!(across(0.5, -0.5) && across(0.0, -0.5) && across(1.0, -0.5));
    assert!(across(0.5, 0.39) && !across(0.5, 0.41), "d above the base");
    assert!(across(0.5, -1.09) && !across(0.5, -1.11), "d / 4 below the tip");
    assert!(!across(-0.01, -0.5) && !across(1.01, -0.5), "beyond the ends");
    assert!(!strip.crosses(DVec3::new(0.2, 0.1, -0.5), DVec3::new(0.8, 0.1, -0.4)), "same side");
}

#[test]
fn a_point_over_a_strip_is_on_a_side_and_one_beside_it_on_none() {
    let s = strip(0.0);
    let [p, q, r] = s.triangles[0];
    let (n, inside) = (s.normal(), (p + q + r) / 3.0);
    let other = s.triangles[1].into_iter().sum::<DVec3>() / 3.0;
    for height in [1e-9, 0.1, 30.0] {
        assert_eq!([inside, other].map(|x| s.side_over(x + height * n)), [1, 1]);
        assert_eq!([inside, other].map(|x| s.side_over(x - height * n)), [-1, -1]);
        assert_eq!(s.side_over(p + 1.1 * (q - p) + height * n), 0);
        assert_eq!(s.side_over(p - 0.1 * (q - p) - height * n), 0);
        assert_eq!([-0.1, 0.5, 1.1].map(|x| s.side_near(p + x * (q - p) + height * n)), [1; 3]);
        assert_eq!([-0.1, 0.5, 1.1].map(|x| s.side_near(p + x * (q - p) - height * n)), [-1; 3]);
    }
    assert_eq!(StripGeometry::new([p; 4], 0.0).side_over(p + n), 0, "a strip without area has no sides");
}

#[test]
fn a_point_in_the_plane_is_on_the_positive_side() {
    let strip = strip(0.0);
    let on = DVec3::new(0.5, 0.0, -0.25);
    assert_eq!(strip.normal(), DVec3::NEG_Y);
    assert!(!strip.crosses(on, DVec3::new(0.5, -0.1, -0.25)));
    assert!(strip.crosses(on, DVec3::new(0.5, 0.1, -0.25)));
}

#[test]
fn a_lip_keeps_its_side_whatever_its_position() {
    let strip = strip(0.4);
    for y in [0.0, 1e-4, -1e-4, 1e-17] {
        let at = DVec3::new(0.5, y, -0.25);
        for (side, same, other) in [(1, -0.1, 0.1), (-1, 0.1, -0.1)] {
            assert!(!strip.crosses_link([lip(at, side), point(DVec3::new(0.6, same, -0.2))]), "{y} {side}");
            assert!(strip.crosses_link([lip(at, side), point(DVec3::new(0.6, other, -0.2))]), "{y} {side}");
            assert!(!strip.crosses_link([lip(at, side), lip(at, side)]));
            assert!(strip.crosses_link([lip(at, side), lip(at, -side)]));
        }
    }
    let wrong = DVec3::new(0.5, 1e-4, -0.25);
    assert!(strip.crosses(wrong, DVec3::new(0.6, -0.1, -0.2)), "geometry alone takes the lip for the other side");
}

#[test]
fn a_lip_reaches_around_the_end_of_a_slit() {
    let strip = strip(0.4);
    let side = lip(DVec3::new(0.99, -0.05, -0.25), 1);
    assert!(!strip.crosses_link([side, point(DVec3::new(1.2, 0.05, -0.25))]));
    assert!(strip.crosses_link([side, point(DVec3::new(0.9, 0.05, -0.25))]));
}

#[test]
fn what_crosses_is_in_sight() {
    use crate::particles::test_models::noise;
    let random = |i: u64| DVec3::new(noise(3 * i), noise(3 * i + 1), noise(3 * i + 2));
    let (mut crossing, mut refused) = (0, 0);
    for i in 0..4000 {
        // flat, twisted and folded strips, now and then far from the origin
        let offset = if i % 5 == 0 { DVec3::splat(30.0) } else { DVec3::ZERO };
        let at = |k: u64| offset + random(100 + 8 * i + k);
        let (tip, base, along) = (at(0), at(1), 0.4 * (random(i) - 0.5));
        let twist = if i % 2 == 0 { DVec3::ZERO } else { 0.2 * (at(2) - at(3)) };
        let fold = if i % 7 == 0 { -0.4 } else { 1.0 };
        let strip = StripGeometry::new([tip, tip + fold * along, base + along + twist, base], 0.1);
        let (a, b) = (at(4), at(5));
        let radius = 1.1 * a.distance(b);
        let sight = strip.sight(a, radius);
        let point = b.as_vec3a();
        assert!(sight.may_meet_box(point, point) || !sight.may_meet(b));
        if strip.crosses(a, b) {
            assert!(sight.may_meet(b) && sight.may_meet_box(point, point), "{i}");
            crossing += 1;
        }
        refused += usize::from(!sight.may_meet(b));
    }
    assert!(crossing > 100 && refused > 2000, "{crossing} cross, {refused} are refused");
}

#[test]
fn distance_to_a_triangle() {
    let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
    for (p, expected) in [
        (DVec3::new(0.2, 0.2, 3.0), 9.0),
        (DVec3::new(-1.0, 0.5, 0.0), 1.0),
        (DVec3::new(1.0, 1.0, 0.0), 0.5),
        (DVec3::new(2.0, -1.0, 0.0), 2.0),
    ] {
        assert!((distance_squared_to_triangle(p, triangle) - expected).abs() < 1e-12);
    }
}

#[test]
fn a_lip_beyond_its_own_strip_links_from_its_own_side() {
    let strip = |a: [f64; 2], b: [f64; 2]| {
        StripGeometry::new([(a, -1.0), (b, -1.0), (b, 0.0), (a, 0.0)].map(|([x, y], z)| DVec3::new(x, y, z)), 0.2)
    };
    let (own, next) = (strip([0.0, 0.0], [1.0, 0.0]), strip([1.0, 0.0], [2.0, -0.3]));
    let (lip, over) = (DVec3::new(0.9, 0.02, -0.5), DVec3::new(1.2, -0.035, -0.5));
    assert!(own.on_side(lip, 1).unwrap().distance(DVec3::new(0.9, -0.02, -0.5)) < 1e-12 && own.on_side(lip, -1).is_none());
    let known = KnownSide { side: 1, own: false };
    assert!(next.lip_crosses(&next.view_of_lip(lip, known, own.on_side(lip, 1)), over));
    assert!(!next.lip_crosses(&next.view_of_lip(lip, known, None), over), "from its place it passes round the corner");
}
