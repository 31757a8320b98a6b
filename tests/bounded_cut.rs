//! A bounded cut through tissue that bends parts what lies on both sides of it, and opens as a tear does, whichever of its ends is named first.

mod common;

use common::models::users_scene;
use glam::DVec3;
use incise::geometry::Plane;
use incise::scene::{EditCommand, Outcome, Scene};
use incise::tissue::Tissue;
use std::collections::BTreeMap;

/// Of the links across a cut one in so many may stay: past its ends a strip at rest is not where the cut was.
const FEW: usize = 40;

/// A bar that bends, a moment of that.
fn bar(time_s: f64) -> Scene {
    let mut scene = users_scene("beam", 6_000, 0.5);
    scene.set_animation(Some(0));
    scene.pose(time_s, time_s);
    scene
}

fn tissue(scene: &Scene) -> &Tissue {
    scene.tissues().next().unwrap().1
}

/// A rectangle through the middle of the bar and out on one side, along it or across, tips first: its corners, and the unit normal.
fn rectangle(scene: &Scene, normal: DVec3) -> [DVec3; 4] {
    let (low, high) = tissue(scene).bounds();
    let (middle, size) = (0.5 * (low + high), (high - low).length());
    let along = DVec3::X.reject_from_normalized(normal).try_normalize().unwrap_or(DVec3::Z);
    let (half, up) = (along * 0.3 * size, normal.cross(along) * 0.3 * size);
    [middle - half, middle + half, middle + half + up, middle - half + up]
}

/// Influences and springs whose ends lie on both sides of a rectangle, seen through it, in the pose and undisplaced.
fn across(scene: &Scene, [a, b, c, d]: [DVec3; 4]) -> usize {
    let tissue = tissue(scene);
    let map = &tissue.layer().unwrap().map;
    let (normal, size) = ((b - a).cross(d - a).normalize(), tissue.diagonal());
    let is_through = |p: DVec3| {
        let inside = |from: DVec3, to: DVec3| (to - from).normalize().cross(p - from).dot(normal) > 3e-3 * size;
        inside(a, b) && inside(b, c) && inside(c, d) && inside(d, a)
    };
    let crosses = |[p, q]: [DVec3; 2]| {
        let [dp, dq] = [p, q].map(|p| (p - a).dot(normal));
        dp * dq < 0.0 && dp.abs().min(dq.abs()) > 1e-5 * size && is_through(p.lerp(q, dp / (dp - dq)))
    };
    let anchor = |j: usize| tissue.skinned(map.anchors[j]);
    let influences = tissue.mesh().live_vertices().flat_map(|v| {
        let anchors = map.influences.row(v.index()).iter().map(|e| anchor(e.particle.index()));
        anchors.map(move |p| [tissue.skinned(v), p])
    });
    let anchored = (0..map.len()).filter(|&j| map.anchors[j].is_some());
    let springs = anchored.flat_map(|j| map.neighbours.row(j).iter().map(move |l| [anchor(j), anchor(l.particle.index())]));
    influences.chain(springs).filter(|ends| crosses(*ends)).count()
}

/// How far lips that were one vertex have come apart, ascending, metres.
fn openings(tissue: &Tissue, first_new: usize) -> Vec<f64> {
    let mut places: BTreeMap<[u64; 3], Vec<DVec3>> = BTreeMap::new();
    for v in tissue.mesh().live_vertices().filter(|v| v.index() >= first_new) {
        let place = tissue.rest_positions()[v.index()].to_array().map(f64::to_bits);
        places.entry(place).or_default().push(tissue.position(v));
    }
    let mut open: Vec<f64> = places.values().filter(|p| p.len() == 2).map(|p| p[0].distance(p[1])).collect();
    open.sort_by(f64::total_cmp);
    open
}

/// Cuts a bar along a rectangle named from its corner `first` on. How many links led across, how many do, and how far the lips open.
fn cut(time_s: f64, normal: DVec3, first: usize) -> (usize, usize, Vec<f64>) {
    let mut scene = bar(time_s);
    let mut corners = rectangle(&scene, normal);
    corners.rotate_left(first);
    let (before, slots) = (across(&scene, corners), tissue(&scene).mesh().vertex_slots());
    let plane = Plane::Equation { normal, offset: normal.dot(corners[0]) };
    let reports = scene.edit(EditCommand::CutBounded { plane, corners: corners.to_vec(), closed: false });
    assert_eq!((reports[0].outcome, scene.validate()), (Outcome::Cut, Ok(())));
    let after = across(&scene, corners);
    (0..120).for_each(|_| scene.step(1.0 / 90.0));
    (before, after, openings(tissue(&scene), slots))
}

#[test]
fn a_bounded_cut_parts_tissue_that_bends() {
    let mut opened = 0;
    for time_s in [0.0, 0.25, 0.5] {
        for normal in [DVec3::Z, DVec3::Y, DVec3::X, DVec3::new(1.0, 2.0, 0.3).normalize()] {
            let [(before, after, open), other] = [0, 2].map(|first| cut(time_s, normal, first));
            assert!(before > 400, "the control: {before} links lead across what is to be cut");
            assert!(FEW * after <= before, "{after} of {before} at {time_s} s, {normal}");
            let middle = |open: &[f64]| open.get(open.len() / 2).copied().unwrap_or(0.0);
            let (lips, others) = (middle(&open), middle(&other.2));
            assert!(after == other.1 && (lips - others).abs() <= 1e-6, "{after}, {lips} m; the other way up {other:?}");
            // where a cut was bent few vertices of the two lips were one
            if open.len() > 20 {
                let most = open[open.len() - 1];
                assert!(lips > 0.4 * most, "{lips} of {most} m at {time_s} s, {normal}");
                opened += 1;
            }
        }
    }
    assert!(opened >= 6, "{opened} cuts whose opening was looked at");
}
