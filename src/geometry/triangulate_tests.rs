//! Laws of the triangulation: every loop edge once, inner edges in opposed pairs, areas add up, Delaunay; and broken twins.

use super::*;
use proptest::prelude::*;
use std::f64::consts::TAU;

struct Region {
    points: Vec<[f64; 2]>,
    corners: Vec<u32>,
    starts: Vec<u32>,
}

impl Region {
    fn new(loops: &[Vec<[f64; 2]>]) -> Self {
        let mut region = Self { points: Vec::new(), corners: Vec::new(), starts: vec![0] };
        for ring in loops {
            region.corners.extend((0..ring.len() as u32).map(|i| region.points.len() as u32 + i));
            region.points.extend(ring);
            region.starts.push(region.corners.len() as u32);
        }
        region
    }

    fn triangulate(&self) -> (Vec<[u32; 3]>, TriangulationOutcome) {
        let mut out = Vec::new();
        let outcome = Triangulator::default().triangulate(&self.points, &self.corners, &self.starts, &[], &mut out);
        (out, outcome)
    }

    fn area(&self, t: &[u32; 3]) -> f64 {
        let [a, b, c] = t.map(|i| self.points[i as usize]);
        crate::geometry::predicates::orient2d(a, b, c) / 2.0
    }

    fn loop_area(&self) -> f64 {
        let ring = |s: &[u32]| {
            let ids = &self.corners[s[0] as usize..s[1] as usize];
            let at = |i: usize| self.points[ids[i % ids.len()] as usize];
            (0..ids.len()).map(|i| at(i)[0] * at(i + 1)[1] - at(i)[1] * at(i + 1)[0]).sum::<f64>() / 2.0
        };
        self.starts.windows(2).map(ring).sum()
    }

    /// Triangles, after checking: valid, all turn left, areas add up, nothing forced.
    fn sound(&self) -> Vec<[u32; 3]> {
        let (triangles, outcome) = self.triangulate();
        validate_triangulation(&self.corners, &self.starts, &triangles).unwrap();
        assert_eq!(outcome, TriangulationOutcome::default());
        assert!(triangles.iter().all(|t| self.area(t) > 0.0), "a triangle is flat or turned over");
        let (sum, whole) = (triangles.iter().map(|t| self.area(t)).sum::<f64>(), self.loop_area());
        assert!((sum - whole).abs() <= 1e-12 * whole.abs(), "{sum} of {whole}");
        triangles
    }

    /// Inner edges that are not locally Delaunay.
    fn not_delaunay(&self, triangles: &[[u32; 3]]) -> usize {
        let at = |i: u32| robust::Coord { x: self.points[i as usize][0], y: self.points[i as usize][1] };
        let mut of_edge: std::collections::BTreeMap<(u32, u32), u32> = Default::default();
        for t in triangles {
            of_edge.extend((0..3).map(|k| ((t[k], t[(k + 1) % 3]), t[(k + 2) % 3])));
        }
        let bad = |(&(a, b), &c): (&(u32, u32), &u32)| {
            let Some(&d) = of_edge.get(&(b, a)) else { return false };
            let convex = self.area(&[d, b, c]) > 0.0 && self.area(&[c, a, d]) > 0.0;
            convex && robust::incircle(at(a), at(b), at(c), at(d)) > 0.0
        };
        of_edge.iter().filter(|&e| bad(e)).count()
    }
}

fn circle(n: usize, centre: [f64; 2], radius: impl Fn(f64) -> f64) -> Vec<[f64; 2]> {
    let at = |i: usize| TAU * i as f64 / n as f64;
    (0..n).map(|i| [centre[0] + radius(at(i)) * at(i).cos(), centre[1] + radius(at(i)) * at(i).sin()]).collect()
}

fn reversed(mut ring: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    ring.reverse();
    ring
}

#[test]
fn collinear_corners_are_kept_and_make_no_flat_triangle() {
    let square = (0..40).map(|i| {
        let (side, s) = (i / 10, f64::from(i % 10));
        [[s, 0.0], [10.0, s], [10.0 - s, 10.0], [0.0, 10.0 - s]][side as usize]
    });
    let region = Region::new(&[square.collect()]);
    assert_eq!(region.sound().len(), 38);
}

#[test]
fn nested_loops_are_regions_with_holes_to_any_depth() {
    let ring = |r: f64, n: usize| circle(n, [0.3, -0.2], |_| r);
    let loops = [ring(5.0, 50), reversed(ring(4.0, 31)), ring(3.0, 40), reversed(ring(2.0, 9)), ring(1.0, 12)];
    Region::new(&loops).sound();
    let spots = (0..9).map(|i| reversed(circle(8, [f64::from(i % 3) - 1.0, f64::from(i / 3) - 1.0], |_| 0.3)));
    let many: Vec<_> = [ring(5.0, 20)].into_iter().chain(spots).chain([circle(9, [20.0, 0.0], |_| 2.0)]).collect();
    let region = Region::new(&many);
    let triangles = region.sound();
    assert_eq!(region.not_delaunay(&triangles), 0);
}

#[test]
fn a_concave_loop_of_ten_thousand_corners_is_delaunay() {
    let region = Region::new(&[
        circle(10_000, [0.0; 2], |a| 3.0 + (7.0 * a).sin() + 0.2 * (90.0 * a).cos()),
        reversed(circle(3_000, [0.0; 2], |a| 1.0 + 0.2 * (40.0 * a).cos())),
    ]);
    let triangles = region.sound();
    assert_eq!(region.not_delaunay(&triangles), 0);
    // the twin: one flipped edge is noticed
    let mut broken = triangles.clone();
    'search: for i in 0..broken.len() {
        for j in 0..i {
            let shared = (0..3)
                .find(|&k| (0..3).any(|l| [broken[j][(l + 1) % 3], broken[j][l]] == [broken[i][k], broken[i][(k + 1) % 3]]));
            if let Some(k) = shared {
                let (a, b, c) = (broken[i][k], broken[i][(k + 1) % 3], broken[i][(k + 2) % 3]);
                let d = broken[j].into_iter().find(|&d| d != a && d != b).unwrap();
                if region.area(&[d, b, c]) > 0.0 && region.area(&[c, a, d]) > 0.0 {
                    (broken[i], broken[j]) = ([d, b, c], [c, a, d]);
                    break 'search;
                }
            }
        }
    }
    validate_triangulation(&region.corners, &region.starts, &broken).unwrap();
    assert!(region.not_delaunay(&broken) > 0);
}

#[test]
fn loops_that_touch_stay_apart() {
    // a hole that touches its loop in a corner, and two loops that meet in one
    let outer = vec![[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
    let hole = reversed(vec![[0.0, 0.0], [2.0, 1.0], [1.0, 2.0]]);
    let other = vec![[4.0, 4.0], [6.0, 4.0], [6.0, 6.0]];
    let region = Region::new(&[outer, hole, other]);
    let (triangles, outcome) = region.triangulate();
    validate_triangulation(&region.corners, &region.starts, &triangles).unwrap();
    assert_eq!((outcome.fans, outcome.repeated_edges), (0, 0));
    assert!(triangles.iter().all(|t| region.area(t) >= 0.0), "a triangle is turned over");
    assert!((triangles.iter().map(|t| region.area(t)).sum::<f64>() - region.loop_area()).abs() < 1e-12);
}

#[test]
fn taken_pairs_are_left_alone() {
    let region = Region::new(&[vec![[0.0, 0.0], [1.0, 0.0], [1.1, 1.1], [0.0, 1.0]]]);
    let joins = |taken: &[[u32; 2]], a: u32, b: u32| {
        let mut out = Vec::new();
        Triangulator::default().triangulate(&region.points, &region.corners, &region.starts, taken, &mut out);
        validate_triangulation(&region.corners, &region.starts, &out).unwrap();
        out.iter().all(|t| t.contains(&a) && t.contains(&b))
    };
    let (free, other) = if joins(&[], 0, 2) { ((0, 2), (1, 3)) } else { ((1, 3), (0, 2)) };
    assert!(joins(&[[free.0, free.1]], other.0, other.1));
}

#[test]
fn the_fan_is_sound_for_any_number_of_holes() {
    for holes in 0..5u32 {
        for size in 3..6u32 {
            let rings: Vec<Vec<u32>> = (0..=holes).map(|i| (i * size..(i + 1) * size).collect()).collect();
            let slices: Vec<&[u32]> = rings.iter().map(Vec::as_slice).collect();
            let (mut pairs, mut ears, mut out) = (Pairs::default(), Ears::default(), Vec::new());
            pairs.reset(&slices, &[], false);
            assert_eq!(ears.fan(&slices, &mut pairs, &mut out), 0);
            let starts: Vec<u32> = (0..=holes + 1).map(|i| i * size).collect();
            validate_triangulation(&rings.concat(), &starts, &out).unwrap();
            assert_adjacent(&out, &ears.opposite);
        }
    }
}

fn assert_adjacent(triangles: &[[u32; 3]], opposite: &[u32]) {
    let ends = |h: u32| (triangles[h as usize / 3][h as usize % 3], triangles[h as usize / 3][(h as usize + 1) % 3]);
    for (h, &back) in opposite.iter().enumerate().filter(|(_, back)| **back != u32::MAX) {
        assert_eq!(opposite[back as usize], h as u32);
        let (a, b) = ends(h as u32);
        assert_eq!(ends(back), (b, a));
    }
}

#[test]
fn each_broken_rule_is_found() {
    let region = Region::new(&[circle(6, [0.0; 2], |_| 1.0)]);
    let (good, _) = region.triangulate();
    let check = |t: &[[u32; 3]]| validate_triangulation(&region.corners, &region.starts, t);
    assert_eq!(check(&good), Ok(()));
    assert!(check(&good[1..]).is_err(), "a triangle is missing");
    let mut turned = good.clone();
    turned[0].swap(0, 1);
    assert!(check(&turned).is_err());
    let mut flat = good.clone();
    flat[0][0] = flat[0][1];
    assert!(check(&flat).unwrap_err().contains("repeats"));
    // a T-junction: corner 1 is left out of its ear
    let short = Region { points: region.points.clone(), corners: vec![0, 2, 3, 4, 5], starts: vec![0, 5] };
    assert!(check(&short.triangulate().0).is_err());
}

/// Loops on a coarse grid: everything touches, crosses and coincides.
fn coarse() -> impl Strategy<Value = Vec<Vec<[f64; 2]>>> {
    let point = prop::array::uniform2(-3i32..4).prop_map(|p| p.map(f64::from));
    prop::collection::vec(prop::collection::vec(point, 3..12), 1..6)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]
    #[test]
    fn connectivity_holds_whatever_the_geometry(loops in coarse()) {
        let region = Region::new(&loops);
        let (triangles, outcome) = region.triangulate();
        prop_assert_eq!(validate_triangulation(&region.corners, &region.starts, &triangles), Ok(()));
        prop_assert_eq!(outcome.repeated_edges, 0);
        // signed areas add up however the loops cross
        let (sum, whole) = (triangles.iter().map(|t| region.area(t)).sum::<f64>(), region.loop_area());
        prop_assert!((sum - whole).abs() < 1e-9, "{} of {}", sum, whole);
    }

    #[test]
    fn star_loops_with_holes_are_cut_properly(
        radii in prop::collection::vec(0.6f64..1.0, 3..60),
        holes in prop::collection::vec(0.1f64..0.25, 3..20),
    ) {
        let star = |r: &[f64]| -> Vec<[f64; 2]> {
            (0..r.len()).map(|i| { let a = TAU * i as f64 / r.len() as f64; [r[i] * a.cos(), r[i] * a.sin()] }).collect()
        };
        let region = Region::new(&[star(&radii), reversed(star(&holes))]);
        let triangles = region.sound();
        prop_assert_eq!(region.not_delaunay(&triangles), 0);
    }
}

/// A ring with a hole; at each of its corners several that lie within some roundings of one another, in any order: what the section of a
/// torus is where vertices lie in the plane but for rounding.
fn section_through_vertices(seed: u64, grain: f64) -> Region {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1u32 << 30) - 1.0
    };
    let mut circle = |radius: f64, direction: f64| -> Vec<[f64; 2]> {
        let corners = (0..24).flat_map(|i| [i; 4]);
        let angle = |i: i32| direction * f64::from(i) * TAU / 24.0 + 0.1;
        corners.map(|i| [radius * angle(i).cos() + grain * random(), radius * angle(i).sin() + grain * random()]).collect()
    };
    Region::new(&[circle(1.0, 1.0), circle(0.6, -1.0)])
}

#[test]
fn corners_that_coincide_but_for_rounding_cover_nothing_twice() {
    let covered = |region: &Region, triangles: &[[u32; 3]]| triangles.iter().map(|t| region.area(t).abs()).sum::<f64>();
    let mut worst: f64 = 0.0;
    for (seed, grain) in (0..40).flat_map(|seed| [0.0, 1e-17, 3e-16, 2e-15].map(|grain| (seed, grain))) {
        let region = section_through_vertices(seed, grain);
        let (triangles, outcome) = region.triangulate();
        validate_triangulation(&region.corners, &region.starts, &triangles).unwrap();
        assert_eq!(outcome, TriangulationOutcome::default(), "{seed} {grain}");
        let (sum, whole) = (covered(&region, &triangles), region.loop_area());
        assert!((sum - whole).abs() < 1e-12 * whole, "{seed} {grain}: {sum} of {whole}");
        let mut triangulator = Triangulator::default();
        let mut out = Vec::new();
        let as_they_are = triangulator.triangulate_loops((&region.points, &region.corners, &region.starts), &[], &mut out);
        worst = worst.max(covered(&region, &out) / whole).max(f64::from(u8::from(as_they_are.forced_ears > 0)));
    }
    assert!(worst > 1.2, "left as they are they make no trouble: {worst}");
}

#[test]
fn small_loops_and_runs_over_the_start_are_welded_too() {
    let near = 1e-17;
    // a run from the last corner over the first; a loop that would lose too much; one all in a place
    let square = vec![[near, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 1.0 + near], [0.0, 1.0], [0.0, near], [0.0, 0.0]];
    let flat = vec![[3.0, 0.0], [4.0, 0.0], [4.0, near], [3.0, near]];
    let point = vec![[5.0, 0.0], [5.0, near], [5.0 + near, 0.0]];
    for loops in [vec![square.clone()], vec![square.clone(), flat.clone(), point.clone()], vec![flat], vec![point]] {
        let region = Region::new(&loops);
        let (triangles, _) = region.triangulate();
        validate_triangulation(&region.corners, &region.starts, &triangles).unwrap();
        let covered: f64 = triangles.iter().map(|t| region.area(t).abs()).sum();
        assert!((covered - region.loop_area()).abs() < 1e-12, "{covered}");
    }
}
