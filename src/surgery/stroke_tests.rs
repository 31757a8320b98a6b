//! The laws of MATHS 5.1 to 5.5 over whole strokes.

use super::*;
use crate::surgery::blade_path::{EntryPoint, SamplingSettings};
use crate::surgery::boxes::{Side, TearBox, plane_side};
use proptest::prelude::*;

const CASES: u32 = 96;
const DISTANCE: f64 = 0.01;

fn sampling() -> Sampling {
    SamplingSettings { distance: DISTANCE, ..Default::default() }.scaled(1.0)
}

/// Tissue fills y <= 0.
fn half_space(tip: DVec3, base: DVec3) -> Option<EntryPoint> {
    let s = if base.y <= 0.0 { 0.0 } else { base.y / (base.y - tip.y) };
    (tip.y < 0.0).then_some(EntryPoint { s, rise: 0.0 })
}

/// A slab 0 <= x <= 0.1 of the half-space.
fn slab(tip: DVec3, base: DVec3) -> Option<EntryPoint> {
    half_space(tip, base).filter(|_| (0.0..=0.1).contains(&tip.x))
}

fn upright(t: f64, x: f64, y: f64, z: f64) -> BladePose {
    BladePose { t, tip: DVec3::new(x, y, z), base: DVec3::new(x, y + 0.3, z) }
}

fn boxes(poses: &[BladePose], width: f64) -> Vec<TearBox> {
    boxes_in(poses, width, &half_space)
}

fn boxes_in(poses: &[BladePose], width: f64, surface: &impl Surface) -> Vec<TearBox> {
    tear_segments(poses, width, sampling(), surface).into_iter().filter_map(|s| s.as_box().cloned()).collect()
}

fn chains(boxes: &[TearBox]) -> usize {
    boxes.iter().map(|b| b.chain as usize + 1).max().unwrap_or(0)
}

/// Why `b` is not a closed, outward, convex box with planes that are its triangles; `None` if it is.
fn broken_box(b: &TearBox) -> Option<&'static str> {
    let corners = b.corners();
    let mut directed: Vec<(u8, u8)> = b.hull_triangles().iter().flat_map(|t| (0..3).map(|k| (t[k], t[(k + 1) % 3]))).collect();
    directed.sort_unstable();
    if directed.windows(2).any(|w| w[0] == w[1]) || directed.iter().any(|&(x, y)| directed.binary_search(&(y, x)).is_err()) {
        return Some("not a closed surface");
    }
    if b.volume() <= 0.0 {
        return Some("inside out");
    }
    if b.planes.iter().any(|plane| corners.iter().any(|c| plane.sign(*c) > 0.0)) {
        return Some("a corner is outside a plane");
    }
    for (plane, triangle) in b.planes[2..].iter().zip(&b.triangles) {
        if plane.points != triangle.map(|k| corners[k as usize]) {
            return Some("a plane is not its triangle");
        }
    }
    for quad in 0..2u8 {
        for k in 0..4u8 {
            let triangle = b.triangles[TearBox::plane_of_edge(quad as usize, k as usize) - 2];
            if !(triangle.contains(&(4 * quad + k)) && triangle.contains(&(4 * quad + (k + 1) % 4))) {
                return Some("an edge is not in its plane");
            }
        }
    }
    let sides = [b.planes[0].side, b.planes[1].side];
    (sides != [Side::Start, Side::End]).then_some("sides out of order")
}

/// Why boxes do not form chains; `None` if they do.
fn broken_chains(boxes: &[TearBox]) -> Option<String> {
    for (i, b) in boxes.iter().enumerate() {
        if let Some(why) = broken_box(b) {
            return Some(format!("box {i}: {why}"));
        }
        if !b.blades.iter().flatten().all(|p| b.contains(*p)) {
            return Some(format!("box {i}: its blade sticks out"));
        }
        for other in &boxes[..i] {
            let consecutive = other.chain == b.chain && other.index + 1 == b.index;
            let shared = other.planes[1].points == b.planes[0].points
                && other.planes[1].id == b.planes[0].id
                && other.joints[1] == b.joints[0]
                && other.quads[1] == b.quads[0]
                && other.planes[1].flipped != b.planes[0].flipped;
            if consecutive && !shared {
                return Some(format!("box {i}: the joint is not shared"));
            }
            if other.chain == b.chain && !other.is_apart_from(b) {
                return Some(format!("box {i} overlaps box {} of its chain", other.index));
            }
        }
    }
    None
}

#[test]
fn a_straight_stroke_is_one_chain_of_flat_boxes() {
    let b = boxes(&[upright(0.0, 0.0, -0.1, 0.0), upright(0.1, 0.1, -0.1, 0.0)], 0.004);
    assert_eq!((chains(&b), broken_chains(&b)), (1, None));
    assert!(b.len() >= 9 && b.iter().all(|b| b.bulge.iter().all(|h| *h < 1e-12)));
    let volume: f64 = b.iter().map(TearBox::volume).sum();
    // Depth 0.1, margin above it 0.5 sample distances, or 0.5 + 0.5 where the probe asks for more.
    let depth = volume / (0.1 * 0.004);
    assert!((0.1..0.1 + 1.01 * DISTANCE).contains(&depth), "{depth}");
    assert!(b[0].strip_corners()[0].abs_diff_eq(DVec3::new(0.0, -0.1, 0.0), 1e-11));
}

#[test]
fn a_mitred_turn_keeps_one_chain_and_a_sharp_one_breaks_it() {
    let turn = |degrees: f64| {
        let (s, c) = degrees.to_radians().sin_cos();
        let poses = [upright(0.0, -0.1, -0.1, 0.0), upright(0.1, 0.0, -0.1, 0.0), upright(0.2, 0.1 * c, -0.1, 0.1 * s)];
        boxes(&poses, 0.002)
    };
    for degrees in [0.0, 30.0, 60.0, 90.0, 115.0] {
        let b = turn(degrees);
        assert_eq!((chains(&b), broken_chains(&b)), (1, None), "{degrees}");
        let widest = b.iter().map(|b| (b.quads[1][1] - b.quads[1][0]).length()).fold(0.0, f64::max);
        assert!((widest - 0.002 / (degrees.to_radians() / 2.0).cos()).abs() < 1e-9, "{degrees}: {widest}");
    }
    for degrees in [125.0, 150.0, 180.0] {
        let b = turn(degrees);
        assert_eq!((chains(&b), broken_chains(&b)), (2, None), "{degrees}");
    }
}

#[test]
fn standing_and_sliding_blades_cut_nothing_sideways() {
    let stand: Vec<_> = (0..90).map(|i| upright(f64::from(i) / 90.0, 0.0, -0.1, 0.0)).collect();
    assert!(boxes(&stand, 0.004).is_empty());
    let stab = [upright(0.0, 0.0, 0.1, 0.0), upright(1.0, 0.0, -0.1, 0.0), upright(2.0, 0.0, 0.1, 0.0)];
    assert!(boxes(&stab, 0.004).is_empty());
}

#[test]
fn a_plunge_starts_at_its_full_depth_and_a_withdrawal_ends_the_chain() {
    let poses = [
        upright(0.0, 0.0, 0.05, 0.0),
        upright(1.0, 0.0, -0.1, 0.0),
        upright(2.0, 0.05, -0.1, 0.0),
        upright(3.0, 0.05, 0.05, 0.0),
        upright(4.0, 0.1, 0.05, 0.0),
    ];
    let b = boxes(&poses, 0.004);
    assert_eq!((chains(&b), broken_chains(&b)), (1, None));
    let (first, last) = (b.first().unwrap(), b.last().unwrap());
    assert!((first.blades[0][0] - DVec3::new(0.0, -0.1, 0.0)).length() < 0.26 * DISTANCE, "{}", first.blades[0][0]);
    assert!((last.blades[1][0].x - 0.05).abs() < 1e-3, "nothing is cut where the blade hovers: {}", last.blades[1][0]);
}

#[test]
fn leaving_and_coming_back_makes_two_chains_that_cover_the_rims() {
    let poses = [
        upright(0.0, -0.0333, -0.1, 0.0),
        upright(1.0, 0.1333, -0.1, 0.0),
        upright(1.1, 0.1333, -0.1, 0.05),
        upright(2.0, -0.0333, -0.1, 0.05),
    ];
    let b = boxes_in(&poses, 0.004, &slab);
    assert_eq!((chains(&b), broken_chains(&b)), (2, None));
    for chain in 0..2 {
        let xs = || b.iter().filter(|b| b.chain == chain).flat_map(|b| b.blades).map(|blade| blade[0].x);
        let (low, high) = (xs().fold(f64::MAX, f64::min), xs().fold(f64::MIN, f64::max));
        assert!(low < 0.0 && low > -2.0 * DISTANCE && high > 0.1 && high < 0.1 + 2.0 * DISTANCE, "{low} {high}");
    }
}

#[test]
fn a_blade_that_leaves_gives_one_segment_a_pose() {
    // ninety poses a second, by a third of the sample distance: in, through, out, back in beside it, and let go inside
    let there = (0..60).map(|i| (f64::from(i), -0.0333 + 0.0033 * f64::from(i), 0.0));
    let back = (60..100).map(|i| (f64::from(i), 0.1614 - 0.0033 * f64::from(i - 60), 0.05));
    let poses: Vec<_> = there.chain(back).map(|(i, x, z)| upright(i / 90.0, x, -0.1, z)).collect();
    let (mut stroke, mut live, mut at_once) = (Stroke::new(0.004, sampling()), Vec::new(), Vec::new());
    for pose in &poses {
        let before = live.len();
        stroke.close_left(&mut live);
        let closed = live.len() - before;
        stroke.push(*pose, &slab, &mut live);
        at_once.push([closed, live.len() - before]);
    }
    stroke.release(&slab, &mut live);
    assert_eq!(live, tear_segments(&poses, 0.004, sampling(), &slab), "when they are asked for makes no difference");
    assert_eq!(at_once.iter().filter(|n| n[0] == 1).count(), 1, "the blade leaves once");
    assert_eq!(at_once.iter().map(|n| n[1]).max(), Some(1));
    // without the delay the last two come together
    let (mut eager, mut out) = (Stroke::new(0.004, sampling()), Vec::new());
    let most = poses.iter().map(|pose| {
        let before = out.len();
        eager.push(*pose, &slab, &mut out);
        eager.close_left(&mut out);
        out.len() - before
    });
    assert_eq!(most.max(), Some(2));
}

/// A blade of 0.2 that turns in the plane z = 0, by `angle` from upright, about the point a share `pivot` up from its tip; that
/// point is at `(x, -0.1)`, deep enough for all of the blade.
fn turned(t: f64, angle: f64, pivot: f64, x: f64) -> BladePose {
    let up = 0.2 * DVec3::new(angle.sin(), angle.cos(), 0.0);
    let tip = DVec3::new(x, -0.3, 0.0) - up * pivot;
    BladePose { t, tip, base: tip + up }
}

/// Boxes of a path inside, with how much of the sampled blades lies in none: the longest stretch of one, as a share of it.
fn covered(poses: &[BladePose]) -> (Vec<TearBox>, f64) {
    let b = boxes(poses, 0.002);
    let (mut sampler, mut samples) = (PathSampler::new(sampling()), Vec::new());
    poses.iter().for_each(|p| sampler.push(*p, &mut samples));
    let inside = |p: DVec3| b.iter().any(|b| b.planes.iter().all(|h| h.normal().dot(p - h.points[0]) < 1e-9));
    let bare = |sample: &PathSample| {
        let misses = |k: &u32| !inside(sample.pose.tip.lerp(sample.pose.base, f64::from(*k) / 1000.0));
        (0..=1000).filter(misses).count() as f64 / 1000.0
    };
    let worst = samples.iter().map(bare).fold(0.0, f64::max);
    (b, worst)
}

#[test]
fn a_pivot_makes_two_chains_side_by_side_that_nearly_meet() {
    for pivot in [0.5, 0.3, 0.9] {
        let (b, bare) = covered(&(0..=10).map(|i| turned(f64::from(i), f64::from(i) * 0.1, pivot, 0.0)).collect::<Vec<_>>());
        assert_eq!((chains(&b), broken_chains(&b)), (2, None), "{pivot}");
        let [below, above] = [0, 1].map(|chain| b.iter().filter(|b| b.chain == chain).collect::<Vec<_>>());
        assert!(below.len() == above.len() && below.len() >= 10, "{pivot}: {} and {}", below.len(), above.len());
        assert!(below.iter().all(|b| above.iter().all(|a| a.is_apart_from(b))));
        assert!((1e-3..6e-3).contains(&bare), "{pivot}: the bridge at the pivot is small: {bare}");
    }
}

/// A blade that goes round an axis leans so that its boxes run inwards at the tip of the cone: were they to share joints up to there, the
/// inner lip would run backwards.
#[test]
fn a_cone_is_two_chains_and_a_few_boxes_of_its_tip() {
    let apex = DVec3::new(0.0, -0.4, 0.0);
    let round = |i: i32| {
        let (sin, cos) = (f64::from(i) * 0.1).sin_cos();
        let way = DVec3::new(cos, 2.0, sin).normalize();
        BladePose { t: f64::from(i), tip: apex - 0.05 * way, base: apex + 0.2 * way }
    };
    let (b, bare) = covered(&(0..=62).map(round).collect::<Vec<_>>());
    assert_eq!(broken_chains(&b), None);
    let count = |chain: u32| b.iter().filter(|b| b.chain == chain).count();
    let mut counts: Vec<usize> = (0..chains(&b) as u32).map(count).collect();
    counts.sort_unstable_by(|a, b| b.cmp(a));
    // one box a chain where joints begin at the tip
    assert!(4 * (counts[0] + counts[1]) > 3 * b.len() && counts[5] == 1, "{counts:?}");
    assert!(bare < 6e-3, "the tip is cut up to the bridge: {bare}");
}

#[test]
fn a_lever_is_one_chain() {
    for pivot in [0.0, 1.0, 0.005] {
        let (b, bare) = covered(&(0..=10).map(|i| turned(f64::from(i), f64::from(i) * 0.1, pivot, 0.0)).collect::<Vec<_>>());
        assert_eq!((chains(&b), broken_chains(&b)), (1, None), "{pivot}");
        assert!(b.len() >= 10 && bare < 1e-2, "{pivot}: {} boxes, {bare}", b.len());
    }
    // the point is now a little above the tip, now a little below it
    let wavering = |i: i32| turned(f64::from(i), f64::from(i) * 0.1, if i % 2 == 0 { 0.004 } else { -0.004 }, 0.0);
    let (b, bare) = covered(&(0..=10).map(wavering).collect::<Vec<_>>());
    assert_eq!(broken_chains(&b), None);
    assert!(chains(&b) <= 10 && b.len() >= 80 && bare < 2e-2, "{} chains of {}, {bare}", chains(&b), b.len());
}

#[test]
fn lanes_begin_and_end_with_the_pivot() {
    // straight, a turn about the middle, straight
    let path = |i: i32| match i {
        0..10 => turned(f64::from(i), 0.0, 0.5, f64::from(i - 10) * 0.01),
        10..20 => turned(f64::from(i), f64::from(i - 10) * 0.1, 0.5, 0.0),
        _ => turned(f64::from(i), 0.9, 0.5, f64::from(i - 19) * 0.02),
    };
    let (b, bare) = covered(&(0..30).map(path).collect::<Vec<_>>());
    assert_eq!(broken_chains(&b), None);
    // one before, two or, where the turn goes over into the way on, four, one after
    assert!((4..=6).contains(&chains(&b)) && bare < 6e-3, "{} chains, {bare}", chains(&b));
    let whole = |b: &TearBox| (b.blades[0][1] - b.blades[0][0]).length() > 0.19;
    assert!(whole(&b[0]) && whole(&b[b.len() - 1]) && !whole(&b[b.len() / 2]));
    // there and back: each lane ends where it turns back, and begins anew
    let forth_and_back = |i: i32| turned(f64::from(i), 0.8 - 0.1 * f64::from((i - 8).abs()), 0.4, 0.0);
    let (b, bare) = covered(&(0..=16).map(forth_and_back).collect::<Vec<_>>());
    assert_eq!((chains(&b), broken_chains(&b)), (4, None));
    assert!(bare < 6e-3, "{bare}");
}

#[test]
fn a_pivot_that_wanders_leaves_little_uncut() {
    for step in [0.01, 0.1] {
        let wander = |i: i32| {
            let share = 0.3 + step * f64::from(if i % 8 < 4 { i % 4 } else { 4 - i % 4 });
            turned(f64::from(i), f64::from(i) * 0.1, share, 0.0)
        };
        let (b, bare) = covered(&(0..=16).map(wander).collect::<Vec<_>>());
        assert_eq!(broken_chains(&b), None);
        assert!(6 * chains(&b) < b.len(), "{step}: {} chains of {} boxes", chains(&b), b.len());
        assert!(bare < 5e-2, "{step}: {bare}");
    }
}

#[test]
fn two_joints_are_open_at_a_pivot_and_their_quads_have_names_of_their_own() {
    let (mut stroke, mut out) = (Stroke::new(0.002, sampling()), Vec::new());
    for i in 0..=10 {
        for quad in stroke.builder().pending_quads_mut() {
            quad.corners.iter_mut().for_each(|corner| corner.z += 1e-4);
        }
        stroke.push(turned(f64::from(i), f64::from(i) * 0.1, 0.5, 0.0), &half_space, &mut out);
        let mut serials: Vec<u32> = stroke.builder().pending_quads_mut().map(|q| q.serial).collect();
        serials.sort_unstable();
        serials.dedup();
        assert_eq!(serials.len(), stroke.builder().pending_quads_mut().count());
        if i > 2 {
            let last = |chain: u32| out.iter().rev().find_map(|s| s.as_box().filter(|b| b.chain == chain)).unwrap().joints[1];
            let chains: Vec<u32> = stroke.builder().open_chains().collect();
            assert_eq!(chains.len(), 2);
            assert!(stroke.builder().open_joints().eq(chains.into_iter().map(last)));
        }
    }
    stroke.release(&half_space, &mut out);
    let b: Vec<_> = out.iter().filter_map(|s| s.as_box().cloned()).collect();
    assert!(b.iter().all(|b| broken_box(b).is_none()) && b.len() > 100);
    assert_eq!(stroke.builder().open_joints().count(), 0);
}

#[test]
fn a_blade_that_goes_deeper_while_it_turns_keeps_its_pivot() {
    let deeper = |i: i32| {
        let pose = turned(f64::from(i / 2), f64::from(i / 2) * 0.1, 0.5, 0.0);
        // every other pose only slides down, a little farther each time
        BladePose { tip: pose.tip - pose.up() * (0.005 * f64::from((i + 1) / 2)), ..pose }
    };
    let b = boxes(&(0..=20).map(deeper).collect::<Vec<_>>(), 0.002);
    assert_eq!((chains(&b), broken_chains(&b)), (2, None));
    let pivot = DVec3::new(0.0, -0.3, 0.0);
    let gaps = b.iter().map(|b| b.blades[0].map(|p| p.distance(pivot))).map(|[tip, top]| tip.min(top));
    let (least, most) = gaps.fold((f64::MAX, 0.0_f64), |(least, most), gap| (least.min(gap), most.max(gap)));
    assert!(least > 1e-4 && most < 3e-3, "boxes stop {least} to {most} short of the pivot");
    let deepest = b.iter().flat_map(|b| b.blades[1]).map(|p| p.distance(pivot)).fold(0.0, f64::max);
    assert!(deepest > 0.14, "{deepest}");
}

#[test]
fn a_path_that_crosses_itself_is_cut_into_chains() {
    let loop_path: Vec<_> = (0..=60)
        .map(|i| {
            let a = f64::from(i) * 0.12;
            upright(a, 0.05 * a.sin(), -0.1, 0.05 * a.cos())
        })
        .collect();
    let b = boxes(&loop_path, 0.004);
    assert_eq!(broken_chains(&b), None);
    assert!(chains(&b) > 1);
    let merged: Vec<_> = b.iter().map(|b| TearBox { chain: 0, ..b.clone() }).collect();
    assert!(broken_chains(&merged).is_some(), "the check sees the crossing");
}

#[test]
fn width_zero_gives_slits_that_share_their_blades() {
    let s = tear_segments(&[upright(0.0, 0.0, -0.1, 0.0), upright(0.1, 0.1, -0.1, 0.02)], 0.0, sampling(), &half_space);
    assert!(s.len() >= 9 && s.iter().all(|s| matches!(s, TearSegment::Slit(_))));
    for w in s.windows(2) {
        let (a, b) = (w[0].strip_corners(), w[1].strip_corners());
        assert_eq!((a[1], a[2]), (b[0], b[3]));
        let (TearSegment::Slit(x), TearSegment::Slit(y)) = (&w[0], &w[1]) else { unreachable!() };
        assert_eq!((x.joints[1], x.ends[1].points, x.ends[1].id), (y.joints[0], y.ends[0].points, y.ends[0].id));
        assert!(x.ends[1].sign(a[1]) == 0.0 && x.ends[1].sign(a[2]) == 0.0 && x.ends[1].sign(a[0]) < 0.0);
    }
}

#[test]
fn slits_of_a_pivot_go_on_side_by_side() {
    let poses: Vec<_> = (0..=10).map(|i| turned(f64::from(i), f64::from(i) * 0.1, 0.5, 0.0)).collect();
    let s = tear_segments(&poses, 0.0, sampling(), &half_space);
    for chain in 0..2 {
        let lane: Vec<_> = s.iter().filter(|s| s.place().0 == chain).collect();
        assert!(2 * lane.len() == s.len() && lane.len() >= 10);
        for w in lane.windows(2) {
            let (a, b) = (w[0].strip_corners(), w[1].strip_corners());
            assert_eq!((a[1], a[2]), (b[0], b[3]));
        }
    }
}

#[test]
fn the_margin_covers_a_ridge_between_samples() {
    // A ridge 0.03 high and one sample wide, in the middle between two samples.
    let ridge = |tip: DVec3, base: DVec3| {
        let height = 0.03 * (1.0 - ((tip.x - 0.055).abs() / (0.4 * DISTANCE)).min(1.0));
        (tip.y < height).then_some(EntryPoint { s: (base.y - height) / (base.y - tip.y), rise: 0.0 })
    };
    let poses = [upright(0.0, 0.0, -0.1, 0.0), upright(0.1, 0.11, -0.1, 0.0)];
    let top_at_ridge = |probes: u32| {
        let sampling = Sampling { probes, ..sampling() };
        let all = tear_segments(&poses, 0.002, sampling, &ridge);
        let crest = DVec3::new(0.055, 0.0299, 0.0);
        all.iter().filter_map(|s| s.as_box()).any(|b| b.contains(crest))
    };
    assert!(top_at_ridge(1));
    assert!(!top_at_ridge(0), "without a probe the bridge of skin is left");
}

#[test]
fn reposed_quads_become_flat_and_boxes_stay_valid() {
    let poses: Vec<_> = (0..=20).map(|i| upright(f64::from(i) * 0.01, 0.01 * f64::from(i), -0.1, 0.0)).collect();
    let (mut stroke, mut out) = (Stroke::new(0.004, sampling()), Vec::new());
    for pose in &poses {
        for quad in stroke.builder().pending_quads_mut() {
            for (k, corner) in quad.corners.iter_mut().enumerate() {
                *corner += DVec3::new(0.0003, 0.0007 * (k as f64 - 1.5), 0.0001 * f64::from(quad.serial % 3));
            }
        }
        stroke.push(*pose, &half_space, &mut out);
    }
    stroke.release(&half_space, &mut out);
    let b: Vec<_> = out.iter().filter_map(|s| s.as_box().cloned()).collect();
    assert!(b.len() > 10);
    assert!(b.iter().all(|b| broken_box(b).is_none()));
    let q = &b[5].quads[0];
    assert_eq!(plane_side(&[q[0], q[1], q[2]], q[3]), 0.0);
    assert!(b.windows(2).any(|w| w[0].quads[1] != w[1].quads[0]), "the joint moved with the tissue");
    assert!(b.windows(2).all(|w| w[0].chain != w[1].chain || w[0].joints[1] == w[1].joints[0]));
}

/// Tissue that turns about a point of the blade, slower where that has come to, turns the start of a box against the way that it goes.
#[test]
fn a_start_that_tissue_has_turned_back_is_cut_below_and_above_its_pivot() {
    let (mut stroke, mut out) = (Stroke::new(0.004, sampling()), Vec::new());
    let (sin, cos) = 0.3_f64.sin_cos();
    for i in 0..=20 {
        let x = 0.01 * f64::from(i);
        let middle = DVec3::new(x, -0.05, 0.0);
        let newest = stroke.builder().pending_quads_mut().map(|quad| quad.serial).max();
        for quad in stroke.builder().pending_quads_mut().filter(|quad| Some(quad.serial) != newest) {
            for corner in quad.corners.iter_mut() {
                let d = *corner - middle;
                *corner = middle + DVec3::new(cos * d.x + sin * d.y, cos * d.y - sin * d.x, d.z);
            }
        }
        stroke.push(upright(f64::from(i) * 0.01, x, -0.1, 0.0), &half_space, &mut out);
    }
    assert_eq!(stroke.builder().skipped(), 0);
    stroke.release(&half_space, &mut out);
    let b: Vec<_> = out.iter().filter_map(|s| s.as_box().cloned()).collect();
    assert!(b.iter().all(|b| broken_box(b).is_none()));
    let parts = |is_above: bool| b.iter().filter(|b| (b.blades[0][0].y > -0.06) == is_above).count();
    assert!(parts(true) > 5 && parts(false) > 5, "{} below, {} above", parts(false), parts(true));
}

#[test]
fn checks_see_broken_boxes() {
    let good = boxes(&[upright(0.0, 0.0, -0.1, 0.0), upright(0.1, 0.1, -0.1, 0.0)], 0.004);
    let mut b = good[1].clone();
    b.triangles.swap(0, 2);
    assert!(broken_box(&b).is_some());
    let mut b = good[1].clone();
    b.triangles[3].swap(0, 1);
    assert_eq!(broken_box(&b), Some("not a closed surface"));
    let mut b = good[1].clone();
    b.quads[1][2] += DVec3::Z * 1e-12;
    assert!(broken_box(&b).is_some());
    let mut moved = good.clone();
    moved[2].quads[0][0].x = moved[2].quads[0][0].x.next_up();
    assert!(broken_chains(&moved).is_some());
}

#[test]
fn wild_widths_and_lengths_do_no_harm() {
    let poses: Vec<_> = (0..40)
        .map(|i| {
            let a = f64::from(i) * 0.3;
            BladePose { t: a * 0.05, tip: DVec3::new(0.1 * a.sin(), -0.2, 0.07 * a), base: DVec3::new(0.0, 1e5, 0.01 * a) }
        })
        .collect();
    for width in [0.0, 1e-15, 1e-9, 1e-4, 0.1, 1.0, 1e3, f64::MAX, f64::NAN, -1.0] {
        assert_eq!(broken_chains(&boxes(&poses, width)), None, "{width}");
    }
    for diagonal in [0.0, 1e-300, 1e300, f64::NAN] {
        let s = Sampling { distance: DISTANCE, ..SamplingSettings::default().scaled(diagonal) };
        tear_segments(&poses, 0.01, s, &half_space);
    }
}

fn walk() -> impl Strategy<Value = Vec<BladePose>> {
    let step = (-1.0f64..1.0, -0.1f64..0.1, -0.04f64..0.04, -0.05f64..0.05, -0.05f64..0.05);
    (proptest::collection::vec(step, 3..40), any::<bool>()).prop_map(|(steps, wild)| {
        let (mut heading, mut tip, mut t) = (0.0f64, DVec3::new(0.0, -0.05, 0.0), 0.0);
        steps
            .iter()
            .map(|&(turn, depth, length, lean_x, lean_z)| {
                heading += if wild { turn * 3.5 } else { turn * 0.5 };
                tip += DVec3::new(heading.cos(), 0.0, heading.sin()) * length.abs();
                t += 0.011;
                let tip = DVec3::new(tip.x, -0.05 + if wild { depth } else { 0.3 * depth }, tip.z);
                let lean = if wild { 3.0 } else { 0.3 };
                BladePose { t, tip, base: tip + DVec3::new(lean * lean_x, 0.25, lean * lean_z) }
            })
            .collect()
    })
}

/// A blade that turns about points of its own, which wander along it and move a little.
fn turn() -> impl Strategy<Value = Vec<BladePose>> {
    let step = (-0.1f64..0.3, -0.1f64..0.1, -0.004f64..0.004, -0.02f64..0.02);
    (proptest::collection::vec(step, 3..30), -0.1f64..1.1).prop_map(|(steps, pivot)| {
        let (mut angle, mut pivot, mut x, mut lean) = (0.0, pivot, 0.0, 0.0);
        let pose = |(i, &(turn, along, by, tilt)): (usize, &(f64, f64, f64, f64))| {
            (angle, pivot, x, lean) = (angle + turn, pivot + 0.2 * along, x + by, lean + tilt);
            let pose = turned(i as f64 * 0.05, angle, pivot, x);
            BladePose { base: pose.base + DVec3::Z * (0.2 * lean), ..pose }
        };
        steps.iter().enumerate().map(pose).collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(CASES) })]

    #[test]
    fn every_stroke_gives_valid_chains(poses in walk(), log_width in -4.0f64..-0.5) {
        prop_assert_eq!(broken_chains(&boxes(&poses, 10f64.powf(log_width))), None);
    }

    #[test]
    fn every_turn_gives_valid_chains(poses in turn(), log_width in -4.0f64..-1.5) {
        prop_assert_eq!(broken_chains(&boxes(&poses, 10f64.powf(log_width))), None);
    }

    #[test]
    fn live_and_offline_give_the_same_bits(poses in prop_oneof![walk(), turn()]) {
        let offline = tear_segments(&poses, 0.003, sampling(), &half_space);
        // The stages run apart: all samples first, then the boxes one sample at a time.
        let (mut sampler, mut samples) = (PathSampler::new(sampling()), Vec::new());
        poses.iter().for_each(|p| sampler.push(*p, &mut samples));
        sampler.finish(&mut samples);
        let (mut stroke, mut live) = (Stroke::new(0.003, sampling()), Vec::new());
        for sample in samples {
            stroke.samples = vec![sample];
            stroke.feed(&half_space, &mut live);
        }
        stroke.builder.release(&mut live);
        prop_assert_eq!(&live, &offline);
        let mut nudged = poses.clone();
        nudged.iter_mut().for_each(|p| p.tip.z += 1e-9);
        prop_assert!(offline.is_empty() || tear_segments(&nudged, 0.003, sampling(), &half_space) != offline);
    }

    #[test]
    fn gentle_strokes_cover_every_sample(
        bend in -3.0f64..3.0, lean in -0.05f64..0.05, depth in 0.02f64..0.2, width in 1e-4f64..0.01
    ) {
        let poses: Vec<_> = (0..=40).map(|i| {
            let x = f64::from(i) * 0.005;
            let tip = DVec3::new(x, -depth, bend * x * x);
            BladePose { t: f64::from(i) / 90.0, tip, base: tip + DVec3::new(lean, 0.3, 2.0 * lean * x) }
        }).collect();
        let b = boxes(&poses, width);
        prop_assert_eq!(broken_chains(&b), None);
        prop_assert_eq!(chains(&b), 1);
        let (mut sampler, mut samples) = (PathSampler::new(sampling()), Vec::new());
        poses.iter().for_each(|p| sampler.push(*p, &mut samples));
        sampler.finish(&mut samples);
        let inside = |p: DVec3| b.iter().any(|b| b.planes.iter().all(|h| h.normal().dot(p - h.points[0]) < 1e-11));
        for (i, sample) in samples.iter().enumerate() {
            let replaced = samples.get(i + 1).is_some_and(|next| next.kind == SampleKind::End);
            if replaced || sample.kind == SampleKind::Axial {
                continue; // its place was taken by the path's last pose; or it is no place of its own
            }
            let clipped = ClippedSample::clip(sample, &half_space, &sampling());
            prop_assert!(inside(sample.pose.tip) && inside(clipped.top.unwrap()), "{sample:?}");
        }
        prop_assert!(!inside(poses[20].tip - DVec3::Y * 1e-3), "below the tip nothing is cut");
    }
}

/// A lip that comes over the blade between two samples, as its wound closes, is cut from outside.
#[test]
fn a_chain_begins_outside_though_skin_has_come_over_its_first_blade() {
    for by in [0.0, 1e-4, 0.004] {
        let (mut stroke, mut out) = (Stroke::new(0.001, sampling()), Vec::new());
        let from = |edge: f64| move |tip: DVec3, base: DVec3| half_space(tip, base).filter(|_| tip.x > edge);
        let edge = -0.001 - by;
        for (k, x) in [-0.001, 0.012, 0.03].into_iter().enumerate() {
            stroke.push(upright(0.1 * k as f64, x, -0.05, 0.0), &from(if k == 0 { 0.0 } else { edge }), &mut out);
        }
        let begins = out[0].as_box().unwrap().blades[0][0].x;
        assert!(if by > 0.0 { begins < edge } else { (begins - edge).abs() < 1e-9 }, "{by}: {begins}");
        assert!(begins > edge - 0.01, "{by}: {begins}");
    }
}
