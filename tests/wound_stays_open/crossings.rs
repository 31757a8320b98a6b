//! Slits without width across wounds that stand open.

use super::lips::{folded_skin, strains_along_lips};
use super::*;
use crate::common::border_loops;
use incise::particles::LipSide;

/// A slit across an open wound leaves it open: without width its first strips on the other side were bound together with those of the
/// wound, which was set anew as if the blade were still in it, and one of its arms closed.
#[test]
fn a_slit_across_a_wound_leaves_both_its_arms_open() {
    for (width, rising) in [(0.0, 1.0), (0.0, -1.0), (WIDTH, 1.0), (WIDTH, -1.0)] {
        let mut scene = users_scene("sphere", 17_328, 0.3);
        stroke(&mut scene, width, 0.0, |x| [DVec3::new(x, 0.004, 0.4), DVec3::new(1.3 * x, 0.004, 1.0)]);
        let first: Vec<(VertexId, f64)> = lip_openings(&scene).collect();
        let onwards = |y: f64| rising * y;
        stroke(&mut scene, width, 2.0, |y| [DVec3::new(0.003, onwards(y), 0.4), DVec3::new(0.003, 1.3 * onwards(y), 1.0)]);
        let mut seen = 0;
        for (v, now) in lip_openings(&scene) {
            let Some((_, was)) = first.iter().find(|lip| lip.0 == v) else { continue };
            assert!(now > 0.8 * was - 0.0005, "{width}: {v:?} was {was} off its place and is {now}");
            seen += 1;
        }
        assert!(seen > 60 && first.iter().any(|lip| lip.1 > 0.01), "{width}: {seen}");
    }
}

/// Slow strokes across a wound that stands open, of a bar: what the blade cuts beyond that is a wound of its own, however little it nicks of the lip
/// first, and however near its way is to that of the older one where it begins. On the older one's line it stood open up to the blade, which
/// cut to the left and to the right of its own way, and lips went over each other.
#[test]
fn what_a_slow_blade_cuts_beyond_a_wound_is_another() {
    for degrees in [20.0, 30.0, 60.0, 90.0_f64] {
        for width in [0.0, 0.0004, 0.002] {
            let mut scene = users_scene("beam", 18_000, 0.3);
            let (sin, cos) = degrees.to_radians().sin_cos();
            let ways = [DVec3::X, DVec3::new(cos, 0.0, sin)];
            for (k, way) in ways.into_iter().enumerate() {
                let to = 0.034 * way + 0.03 * DVec3::Y;
                let from = to - 0.068 * way;
                stroke_in(&mut scene, width, (5.0 * k as f64, 60, 1.0 / 30.0), |x| blade_down_the_top([from, to], x));
            }
            let strips = &only(&scene).layer().unwrap().strips;
            let of_second = (0..strips.len()).filter(|&k| strips.slit_start(k) > 0);
            let way_of = |k: usize| {
                let [from, to] = strips.as_slice()[k].skin_edge();
                (to - from).normalize_or_zero()
            };
            let off = |k: &usize| way_of(*k).dot(DVec3::X).abs() < 0.9;
            let on_first = of_second.clone().filter(|&k| strips.as_slice()[k].wound == 0).filter(off).count();
            assert!(of_second.filter(off).count() > 4, "{degrees}, {width}: it was cut");
            assert_eq!(on_first, 0, "{degrees}, {width}: strips that lie on the line of a wound which they leave");
        }
    }
}

/// How far lips of the first slit have moved apart where another crosses it no nearer than a twelfth of the ball's width.
fn lip_openings(scene: &Scene) -> impl Iterator<Item = (VertexId, f64)> + '_ {
    let tissue = only(scene);
    let (rest, strips) = (tissue.rest_positions(), &tissue.layer().unwrap().strips);
    let is_lip = |v: &VertexId| strips.lip_sides(*v).iter().any(|lip| strips.slit_start(lip.strip as usize) == 0);
    let in_arm = |v: &VertexId| rest[v.index()].x.abs() > 0.08;
    let lips = tissue.mesh().live_vertices().filter(is_lip).filter(in_arm);
    lips.map(|v| (v, (tissue.position(v) - rest[v.index()]).y.abs()))
}

/// A stroke without width over the front of a ball, or of a heart a tenth of that long, which may beat; a second in all, for its wound to
/// open.
fn slit_over_the_front(scene: &mut Scene, (is_heart, beats): (bool, bool), begins: f64, [from, to]: [DVec3; 2]) {
    scene.edit(EditCommand::StrokeBegin { width: 0.0 });
    for k in 0..110 {
        let t = begins + f64::from(k) * STEP;
        let at = from.lerp(to, f64::from(k.min(45)) / 45.0);
        let [tip, base] = blade_over_the_front(is_heart, at);
        if k <= 45 {
            scene.edit(EditCommand::StrokePose(BladePose { t, tip, base }));
        }
        if k == 45 {
            scene.edit(EditCommand::StrokeEnd);
        }
        scene.pose(t, if beats { t } else { 0.0 });
        scene.step(STEP);
    }
}

/// Tip and base of a blade over a place on the front of a ball, or of a heart a tenth of that long.
pub fn blade_over_the_front(is_heart: bool, at: DVec3) -> [DVec3; 2] {
    match is_heart {
        true => [0.024, 0.2].map(|z| 0.1 * at + z * DVec3::Z),
        false => [at + 0.4 * DVec3::Z, 1.3 * at + DVec3::Z],
    }
}

/// While the blade stands in the air between two lips, the wrong one may be the nearer: a strip that was carried to rest by it ended beyond
/// the wound, where the lips touch, and the next ran back from there. Both parted what was theirs from what draws it open, and what was
/// not: of these crossings every fifth had such strips, arms of the first wound were drawn a third too far or closed, and skin was turned
/// over.
#[test]
fn strips_across_a_wound_go_the_way_of_the_blade() {
    for (is_heart, beats) in [(false, false), (true, false), (true, true)] {
        let (name, scale) = if is_heart { ("heart", 0.1) } else { ("sphere", 1.0) };
        let mut all_folded = 0.0;
        for angle in [90.0, 270.0, 60.0, 240.0, 120.0, 300.0_f64] {
            for place in [-0.06, 0.003, 0.09] {
                let mut scene = users_scene(name, if is_heart { 18_000 } else { 17_328 }, 0.3);
                scene.set_wall(WallMode::Open);
                scene.set_animation(beats.then_some(0));
                let (sin, cos) = angle.to_radians().sin_cos();
                let (middle, onwards) = (DVec3::new(place, 0.004, 0.0), DVec3::new(cos, sin, 0.0));
                let along_x = [-0.25, 0.25].map(|x| middle.with_x(x));
                slit_over_the_front(&mut scene, (is_heart, beats), 0.0, along_x);
                let first = only(&scene).layer().unwrap().strips.len();
                // lips of its arms, and how far they stand off their places
                let rest = |scene: &Scene, v: VertexId| only(scene).rest_positions()[v.index()];
                let off = |scene: &Scene, v: VertexId| (only(scene).position(v) - rest(scene, v)).length();
                let is_lip = |v: &VertexId| !only(&scene).layer().unwrap().strips.lip_sides(*v).is_empty();
                let in_arm = |v: &VertexId| (rest(&scene, *v).x - scale * place).abs() > 0.08 * scale;
                let lips = only(&scene).mesh().live_vertices().filter(is_lip).filter(in_arm);
                let arms: Vec<(VertexId, f64)> = lips.map(|v| (v, off(&scene, v))).collect();
                slit_over_the_front(&mut scene, (is_heart, beats), 2.0, [-0.25, 0.25].map(|y| middle + y * onwards));

                let told = format!("{name}, beats {beats}, at {angle} degrees, {place}");
                let tissue = only(&scene);
                let layer = tissue.layer().unwrap();
                assert!(
                    layer.strips.len() > first + 8 && layer.strips.next_slit() > 2,
                    "{told}: the blade leaves the first wound"
                );
                for (k, strip) in layer.strips.as_slice().iter().enumerate().skip(first) {
                    let [tip, next_tip, next_base, base] = strip.corners.map(DVec3::from_array);
                    assert!((next_tip - tip + next_base - base).dot(onwards) > 0.0, "{told}: strip {k} runs backwards");
                }
                // one that crosses at a right angle draws the first wound nowhere but at its own
                if sin.abs() > 0.99 && !beats {
                    let gap = layer.settings.wound.gap;
                    let moved = arms.iter().map(|&(v, was)| (off(&scene, v) - was).abs()).fold(0.0, f64::max);
                    assert!(arms.len() > 60 && moved < 0.15 * gap, "{told}: an arm's lip has moved by {moved} of {gap}");
                }
                // nor is a bridge of skin left where a lip has come over the blade that was in the air
                assert!(beats || border_loops(tissue.mesh()) == 1, "{told}: a bridge");
                let length = |a: VertexId, b: VertexId| rest(&scene, a).distance(rest(&scene, b));
                let strains = strains_along_lips(tissue, first).into_iter();
                let step = strains.map(|(a, b, strain)| strain * length(a, b)).fold(0.0, f64::max);
                assert!(step < 0.022 * scale, "{told}: a dart, {step} metres high, on a lip");
                let folded = folded_skin(tissue);
                assert!(folded < 2e-4 * scale * scale, "{told}: {folded} square metres are folded over");
                all_folded += folded;
            }
        }
        assert!(all_folded < 1.5e-3 * scale * scale, "{name}, beats {beats}: {all_folded} square metres are folded over");
    }
}

/// A blade across an open wound at an angle draws the lips of its arms along, and where the skin between both is a wedge it draws that side the
/// more: the outer half of such an arm was pressed shut, its lips by up to 6 mm into each other. Each wound keeps its own lens.
#[test]
fn a_stroke_obliquely_across_a_wound_shuts_none_of_its_arms() {
    let top = 0.06;
    let [from, to] = [DVec3::new(-0.03, 0.03, -0.005), DVec3::new(0.03, 0.03, 0.005)];
    let along = (to - from).normalize();
    let across = DVec3::new(along.z, 0.0, -along.x);
    for degrees in [25.0, 40.0, 60.0, 90.0, 120.0, 140.0, 155.0_f64] {
        for share in [0.3, 0.5] {
            let mut scene = users_scene("beam", 2_816, 0.0);
            scene.set_wall(WallMode::Open);
            stroke_down_the_top(&mut scene, 0.0, [from, to]);
            let opened = |scene: &Scene| arm_openings(scene, (from.with_y(top), along, across));
            let before = opened(&scene);
            let (sin, cos) = degrees.to_radians().sin_cos();
            let (middle, way) = (from.lerp(to, share), (0.025 / sin).min(0.06) * DVec3::new(cos, 0.0, sin));
            stroke_down_the_top(&mut scene, 2.0, [middle - way, middle + way]);
            let crossing = (middle - from).dot(along);
            let arms = |all: Vec<(f64, f64)>| all.into_iter().filter(move |p| (p.0 - crossing).abs() > 0.004);
            let least = arms(opened(&scene)).map(|p| p.1).fold(f64::INFINITY, f64::min);
            let told = format!("at {degrees} degrees, {share}");
            assert!(arms(before).all(|p| p.1 > 0.0005), "{told}: it stood open");
            let is_acute = sin < 0.5 && cos > 0.0;
            assert!(least > if is_acute { -0.001 } else { 0.0005 }, "{told}: lips are {least} metres apart");
        }
    }
}

/// A stroke down through a bar's top.
fn stroke_down_the_top(scene: &mut Scene, begins: f64, [from, to]: [DVec3; 2]) {
    stroke(scene, 0.002, begins, |x| blade_down_the_top([from, to], x));
}

/// Tip and base of a blade whose tip goes from place to place, while `x` goes from -0.25 to 0.25.
fn blade_down_the_top([from, to]: [DVec3; 2], x: f64) -> [DVec3; 2] {
    let tip = from.lerp(to, 2.0 * x + 0.5);
    [tip, tip + 0.23 * DVec3::Y]
}

/// How far the lips of the first wound in a bar's top have moved apart, every 2 mm along it, by what lies between those on either side.
fn arm_openings(scene: &Scene, (origin, along, across): (DVec3, DVec3, DVec3)) -> Vec<(f64, f64)> {
    let tissue = only(scene);
    let (rest, strips) = (tissue.rest_positions(), &tissue.layer().unwrap().strips);
    let mut sides: [Vec<(f64, f64)>; 2] = Default::default();
    for v in tissue.mesh().live_vertices().filter(|v| rest[v.index()].y > origin.y - 1e-4) {
        let of_first = |lip: &&LipSide| strips.as_slice()[lip.strip as usize].wound == 0;
        if let Some(lip) = strips.lip_sides(v).iter().find(of_first) {
            let moved = (tissue.position(v) - rest[v.index()]).dot(across);
            sides[usize::from(lip.side > 0)].push(((rest[v.index()] - origin).dot(along), moved));
        }
    }
    sides.iter_mut().for_each(|side| side.sort_by(|a, b| a.0.total_cmp(&b.0)));
    let at = |side: &[(f64, f64)], x: f64| {
        let [a, b] = side.windows(2).map(|w| [w[0], w[1]]).find(|[a, b]| a.0 <= x && x <= b.0)?;
        Some(a.1 + (b.1 - a.1) * (x - a.0) / (b.0 - a.0).max(f64::MIN_POSITIVE))
    };
    let opening = |x: f64| Some((x, at(&sides[0], x)? - at(&sides[1], x)?));
    (2..30).filter_map(|k| opening(0.002 * f64::from(k))).collect()
}
