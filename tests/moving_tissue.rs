//! Tears through tissue that moves under the blade leave what tears through tissue at rest leave: one wound, and no bridges across it.

mod common;

use common::models::users_scene;
use common::{border_loops, open_half_edges};
use glam::DVec3;
use incise::geometry::{Components, Mesh, VertexId};
use incise::scene::{EditCommand, Outcome, Scene};
use incise::surgery::{BladePose, WallMode};

const STEP: f64 = 1.0 / 90.0;

/// A heart of 3,000 faces with as many particles as a user's.
fn heart() -> Scene {
    let mut scene = users_scene("heart", 3_000, 0.3);
    scene.set_animation(Some(0));
    scene
}

/// Handles of a surface: bridges across its wounds, and ways through it.
fn handles(mesh: &Mesh) -> usize {
    let [faces, vertices, components] =
        [mesh.face_count(), mesh.live_vertices().count(), Components::find(mesh).count()].map(|n| n as i64);
    let open = open_half_edges(mesh).len() as i64;
    let characteristic = vertices - (3 * faces + open) / 2 + faces + border_loops(mesh) as i64;
    usize::try_from(components - characteristic / 2).unwrap()
}

/// Brings a model that began to move at `begins`, seconds, to its frame `i` of a scene.
fn step(scene: &mut Scene, begins: f64, i: u32) {
    scene.pose(f64::from(i) * STEP, begins + f64::from(i) * STEP);
    scene.step(STEP);
}

/// A stroke through a model that moves, a pose a frame from frame 5 on; `blade` gives `[tip, base]` at a share of the way.
fn draw_through(scene: &mut Scene, begins: f64, (width, poses): (f64, u32), blade: impl Fn(f64) -> [DVec3; 2]) {
    scene.edit(EditCommand::StrokeBegin { width });
    for i in 0..=poses {
        let [tip, base] = blade(f64::from(i) / f64::from(poses));
        scene.edit(EditCommand::StrokePose(BladePose { t: f64::from(i) * STEP, tip, base }));
        step(scene, begins, 5 + i);
    }
    scene.edit(EditCommand::StrokeEnd);
    assert_eq!(scene.validate(), Ok(()));
}

/// Openings and handles after a stroke in half a second or more, from place `k` of a spiral over the front of a heart that beats.
fn torn(k: u32, wall: WallMode) -> (usize, usize) {
    let mut scene = heart();
    scene.set_wall(wall);
    let (turn, begins) = (2.4 * f64::from(k), 0.17 * f64::from(k));
    (0..5).for_each(|i| step(&mut scene, begins, i));
    let at = |turn: f64, by: f64| by * DVec3::new(turn.cos(), turn.sin(), 0.0);
    let middle = at(turn, 0.001 * f64::from(k));
    let (way, poses) = (at(1.7 * turn, 1.0), 40 + 4 * k);
    // the blade goes through the skin from the first pose to the last, however that moves
    let base = middle + 0.1 * DVec3::Z;
    let (share, _) = scene.tissues().next().unwrap().1.blade_entry(middle, base).expect("skin in front of the middle");
    let skin = base.lerp(middle, share);
    let depth = 0.005 + 0.0002 * f64::from(k);
    draw_through(&mut scene, begins, (0.0004, poses), |share| {
        let p = middle + way * 0.03 * (share - 0.5) + way.cross(DVec3::Z) * 0.002 * (9.0 * share).sin();
        let tip = p.with_z(skin.z - depth - 0.002 * (2.0 * share - 1.0).powi(2));
        [tip, tip + 0.06 * DVec3::Z]
    });
    scene.tissues().fold((0, 0), |(openings, all), (_, t)| (openings + border_loops(t.mesh()), all + handles(t.mesh())))
}

#[test]
fn a_beating_heart_is_torn_without_bridges() {
    for k in 0..16 {
        assert_eq!(torn(k, WallMode::Open), (1, 0), "open, stroke {k}");
        // 11 of the 16 left a bridge or two where the quad that waits did not follow the vertices on it
        assert_eq!(torn(k, WallMode::Closed), (0, 0), "closed, stroke {k}");
    }
}

/// A blade that turns about its tip as it goes sweeps sides that are not flat. What the tissue had moved of a lip was taken for a part of all
/// planes of such a side: the next box's slit narrowed to a point and left a bridge (11 over six of these strokes).
#[test]
fn a_blade_that_turns_in_moving_tissue_leaves_no_bridges() {
    for k in [4, 5, 7, 9, 15, 17].map(f64::from) {
        let mut scene = users_scene("heart", 400, 0.3);
        scene.set_wall(WallMode::Closed);
        scene.set_animation(Some(0));
        let begins = 0.07 * k;
        (1..5).for_each(|i| step(&mut scene, begins, i));
        let tissue = scene.tissues().next().unwrap().1;
        let (low, high) = tissue.bounds();
        let (middle, size, turn) = ((low + high) / 2.0, tissue.diagonal(), 0.4 * k);
        let blade = size * DVec3::new(0.0, 0.1 * (2.0 * turn).sin(), 0.5);
        let (share, _) = tissue.blade_entry(middle, middle + blade).expect("skin in front of the middle");
        let inside = (middle + blade).lerp(middle, share) - 0.08 * size * DVec3::Z;
        let way = 0.3 * size * DVec3::new(turn.cos(), 0.4 * turn.sin(), 0.0);
        let leans = 0.3 * size * (3.0 * turn).sin() * DVec3::Y;
        draw_through(&mut scene, begins, (0.003 * size, 54), |share| {
            let tip = inside + (share - 0.5) * way;
            [tip, tip + blade + (share - 0.5) * leans]
        });
        assert_eq!(scene.tissues().map(|(_, t)| handles(t.mesh())).sum::<usize>(), 0, "stroke {k}");
    }
}

/// A blade that goes through the heart from side to side leaves what is above it and below as a bridge over its slot: a handle.
#[test]
fn bridges_are_counted() {
    let mut scene = heart();
    scene.set_wall(WallMode::Closed);
    let all = |scene: &Scene| scene.tissues().map(|(_, t)| handles(t.mesh())).sum::<usize>();
    assert_eq!(all(&scene), 0);
    scene.edit(EditCommand::StrokeBegin { width: 0.001 });
    for i in 0..=20 {
        let tip = DVec3::new(-0.06, 0.0, -0.001 + 0.0001 * f64::from(i));
        scene.edit(EditCommand::StrokePose(BladePose { t: f64::from(i) * STEP, tip, base: tip + 0.12 * DVec3::X }));
    }
    scene.edit(EditCommand::StrokeEnd);
    assert!(all(&scene) > 0);
}

/// A blade over the edge of a bar, whose wound opens behind it: a flake of two skins with nothing between them comes off.
#[test]
fn a_flake_without_thickness_is_no_piece() {
    let path = [
        ([0.2674, -0.0758, 0.0532], [0.2125, -0.0280, 0.3636]),
        ([0.2685, -0.0696, 0.0532], [0.2137, -0.0219, 0.3636]),
        ([0.2690, -0.0641, 0.0532], [0.2142, -0.0164, 0.3636]),
        ([0.2681, -0.0600, 0.0532], [0.2133, -0.0123, 0.3636]),
        ([0.2656, -0.0576, 0.0532], [0.2108, -0.0098, 0.3636]),
        ([0.2614, -0.0568, 0.0532], [0.2066, -0.0090, 0.3636]),
        ([0.2560, -0.0573, 0.0532], [0.2012, -0.0096, 0.3636]),
        ([0.2498, -0.0585, 0.0532], [0.1950, -0.0108, 0.3636]),
        ([0.2436, -0.0598, 0.0532], [0.1888, -0.0120, 0.3636]),
        ([0.2382, -0.0603, 0.0532], [0.1834, -0.0125, 0.3636]),
        ([0.2341, -0.0594, 0.0532], [0.1793, -0.0117, 0.3636]),
        ([0.2317, -0.0569, 0.0532], [0.1768, -0.0092, 0.3636]),
        ([0.2309, -0.0527, 0.0532], [0.1760, -0.0050, 0.3636]),
        ([0.2313, -0.0472, 0.0532], [0.1765, 0.0005, 0.3636]),
        ([0.2325, -0.0410, 0.0532], [0.1777, 0.0067, 0.3636]),
        ([0.2337, -0.0348, 0.0532], [0.1789, 0.0129, 0.3636]),
        ([0.2341, -0.0294, 0.0532], [0.1793, 0.0183, 0.3636]),
        ([0.2332, -0.0254, 0.0532], [0.1783, 0.0223, 0.3636]),
        ([0.2306, -0.0230, 0.0532], [0.1758, 0.0247, 0.3636]),
        ([0.2264, -0.0222, 0.0532], [0.1715, 0.0255, 0.3636]),
        ([0.2209, -0.0228, 0.0532], [0.1660, 0.0249, 0.3636]),
    ];
    let mut scene = users_scene("beam", 600, 0.3);
    scene.set_wall(WallMode::Closed);
    let before = scene.edit_hash();
    scene.edit(EditCommand::StrokeBegin { width: 0.0018706149184595465 });
    for (i, (tip, base)) in path.into_iter().enumerate() {
        let t = i as f64 / 45.0;
        scene.edit(EditCommand::StrokePose(BladePose { t, tip: tip.into(), base: base.into() }));
        scene.pose(t, 0.0);
        scene.step(1.0 / 45.0);
    }
    let report = scene.edit(EditCommand::StrokeEnd).pop().unwrap();
    assert_eq!((report.outcome, report.pieces.len(), scene.validate()), (Outcome::Torn, 1, Ok(())));
    let (_, tissue) = scene.tissues().next().unwrap();
    assert_eq!(open_half_edges(tissue.mesh()).len(), 0);
    let clipped: f64 = report.segments.iter().map(|s| s.area_removed).sum();
    assert!(report.area_removed > clipped + 1e-6, "nothing has come off: {} and {clipped}", report.area_removed);
    let torn = scene.edit_hash();
    assert!(scene.undo() && scene.edit_hash() == before && scene.redo() && scene.edit_hash() == torn);
}

/// A bar bends at its own speed about a blade that goes along it slowly: what is pending turns with the tissue, about points of the blade.
/// Such boxes were given up, sample by sample, and of the whole stroke a hole as long as it was wide was left.
#[test]
fn a_blade_that_tissue_turns_about_leaves_a_wound() {
    for wall in [WallMode::Open, WallMode::Closed] {
        let mut scene = users_scene("beam", 3_000, 0.5);
        scene.set_animation(Some(0));
        scene.set_wall(wall);
        scene.pose(0.0, 0.5);
        scene.edit(EditCommand::StrokeBegin { width: 0.0019 });
        for i in 0..=90 {
            let t = f64::from(i) * STEP;
            scene.pose(t, 0.5 + t);
            let tip = 0.1 * t * DVec3::X;
            scene.edit(EditCommand::StrokePose(BladePose { t, tip, base: tip + 0.2 * DVec3::Y }));
            scene.step(STEP);
        }
        assert_eq!(scene.edit(EditCommand::StrokeEnd)[0].outcome, Outcome::Torn);
        assert_eq!(scene.validate(), Ok(()));
        let (_, tissue) = scene.tissues().next().unwrap();
        let (mesh, layer) = (tissue.mesh(), tissue.layer().unwrap());
        let lips = mesh.live_vertices().filter(|v| !layer.strips.lip_sides(*v).is_empty());
        let places = lips.map(|v| tissue.rest_positions()[v.index()].x);
        let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
        assert!(high - low > 0.03, "{wall:?}: from {low} to {high}");
        assert_eq!(open_half_edges(mesh).is_empty(), wall == WallMode::Closed);
    }
}

/// Where the blade first goes through the skin, at rest.
fn entry_at_rest(scene: &Scene, blade: BladePose) -> Option<DVec3> {
    let (_, tissue) = scene.tissues().next().unwrap();
    let (from, way) = (blade.base, blade.tip - blade.base);
    let hits = tissue.mesh().live_faces().filter_map(|f| {
        let vertices = tissue.mesh().face(f);
        let [a, b, c] = vertices.map(|v| tissue.position(v));
        let normal = (b - a).cross(c - a);
        let along = (a - from).dot(normal) / way.dot(normal);
        let p = from + way * along;
        let weight = |q: DVec3, r: DVec3| (q - p).cross(r - p).dot(normal) / normal.length_squared();
        let weights = [weight(b, c), weight(c, a), weight(a, b)];
        let is_hit = (0.0..=1.0).contains(&along) && weights.iter().all(|w| *w >= -1e-9);
        let rest = vertices.map(|v| tissue.rest_positions()[v.index()]);
        is_hit.then(|| (along, rest[0] * weights[0] + rest[1] * weights[1] + rest[2] * weights[2]))
    });
    hits.min_by(|a, b| a.0.total_cmp(&b.0)).map(|hit| hit.1)
}

/// A bar bends at its own speed, three times as fast as the blade goes across it: the wound in the skin is where the blade went through it,
/// which another bar that bends alike and is not torn tells exactly.
#[test]
fn the_wound_follows_the_blade_s_way_through_the_skin() {
    const WIDTH: f64 = 0.004;
    let (mut scene, mut whole) = (users_scene("beam", 3_000, 0.5), users_scene("beam", 3_000, 0.5));
    let pose = |scene: &mut Scene, t: f64| {
        scene.set_animation(Some(0));
        scene.pose(t, 0.5 + t);
        scene.step(STEP);
    };
    pose(&mut scene, 0.0);
    pose(&mut whole, 0.0);
    scene.edit(EditCommand::StrokeBegin { width: WIDTH });
    let mut way: Vec<DVec3> = Vec::new();
    for i in 1..=54 {
        let t = f64::from(i) * STEP;
        let tip = DVec3::new(0.01 - 0.04 * t, 0.02, 0.035 - 0.14 * t);
        let blade = BladePose { t, tip, base: tip + 0.25 * DVec3::Y };
        way.extend(entry_at_rest(&whole, blade));
        scene.edit(EditCommand::StrokePose(blade));
        pose(&mut scene, t);
        pose(&mut whole, t);
    }
    scene.edit(EditCommand::StrokeEnd);
    assert_eq!(scene.validate(), Ok(()));
    let (_, tissue) = scene.tissues().next().unwrap();
    let rest = |v: VertexId| tissue.rest_positions()[v.index()];
    let is_top = |p: DVec3| (p.y - 0.06).abs() < 1e-6;
    let fine: Vec<DVec3> = way.windows(2).flat_map(|w| (0..16).map(|k| w[0].lerp(w[1], f64::from(k) / 16.0))).collect();
    let off = |p: DVec3| fine.iter().map(|q| q.distance(p)).fold(f64::INFINITY, f64::min);
    assert!(way.iter().all(|p| is_top(*p)) && way.len() == 54, "{way:?}");
    // before that the blade grazes the skin, which goes by a centimetre a frame
    let in_bend = |p: &DVec3| p.x < 0.07;
    let left: Vec<[DVec3; 3]> = tissue.mesh().live_faces().map(|f| tissue.mesh().face(f).map(rest)).collect();
    let covers = |t: &[DVec3; 3], p: DVec3| {
        let turn = |k: usize| (t[(k + 1) % 3] - t[k]).cross(p - t[k]).y;
        t.iter().all(|q| is_top(*q)) && (0..3).all(|k| turn(k) >= 0.0)
    };
    let uncut = fine.iter().filter(|p| in_bend(p) && left.iter().any(|t| covers(t, **p))).count();
    assert_eq!(uncut, 0, "of {} points of the way", fine.len());
    let lips = open_half_edges(tissue.mesh()).into_iter().map(|h| rest(tissue.mesh().from(h)));
    let mut offs: Vec<f64> = lips.filter(|p| is_top(*p) && in_bend(p)).map(off).collect();
    offs.sort_by(f64::total_cmp);
    let [few, half, most] = [offs.len() / 20, offs.len() / 2, offs.len() - 1].map(|k| offs[k] / (0.5 * WIDTH));
    assert!(offs.len() > 60 && few > 0.6 && (0.99..1.1).contains(&half) && most < 1.35, "{few} {half} {most} of half the width");
}

/// A bar that bends while a blade longer than it is thick is drawn through its upper half: it turns about a point in the blade. Half a second
/// later.
fn torn_in_a_bending_bar(width: f64, wall: WallMode) -> Scene {
    let mut scene = users_scene("beam", 2_816, 0.5);
    scene.set_wall(wall);
    scene.set_animation(Some(0));
    scene.edit(EditCommand::StrokeBegin { width });
    for frame in 0..135 {
        let t = f64::from(frame) * STEP;
        scene.pose(0.5 + t, 0.5 + t);
        if frame <= 90 {
            let tip = DVec3::new(0.1 * t, 0.0, 0.0);
            scene.edit(EditCommand::StrokePose(BladePose { t, tip, base: tip + 0.2 * DVec3::Y }));
        }
        if frame == 90 {
            scene.edit(EditCommand::StrokeEnd);
        }
        scene.step(STEP);
    }
    assert_eq!(scene.validate(), Ok(()));
    scene
}

/// A bar bends about a point in the blade, whose ends go opposite ways through it: at rest strips are folded, and lips beside a strip's end
/// opened by 2 to 3 mm more or less than what they touch. The point moves along the blade, chains end and begin at it: films without
/// thickness hung from the lips there, and each chain stood open by itself.
#[test]
fn a_wound_cut_about_a_point_in_the_blade_opens_evenly() {
    const WIDTH: f64 = 0.002;
    let scene = torn_in_a_bending_bar(WIDTH, WallMode::Open);
    let (_, tissue) = scene.tissues().next().unwrap();
    let half_gap = 0.5 * tissue.layer().unwrap().settings.wound.gap;
    let on_border = || open_half_edges(tissue.mesh()).into_iter().map(|h| tissue.mesh().from(h));
    let rest = |v: VertexId| tissue.rest_positions()[v.index()];
    let in_skin = || on_border().map(rest).filter(|p| (p.y - 0.06).abs() < 1e-6);
    let [from, to] = [in_skin().map(|p| p.x).fold(f64::MAX, f64::min), in_skin().map(|p| p.x).fold(f64::MIN, f64::max)];
    let hangs = |p: &DVec3| p.z.abs() < 0.25 * WIDTH && (from + 0.5e-3..to - 0.5e-3).contains(&p.x);
    assert!(to - from > 0.05 && !in_skin().any(|p| hangs(&p)), "{:.4?}", in_skin().filter(hangs).collect::<Vec<_>>());
    for side in [-1.0, 1.0] {
        let is_lip = |v: &VertexId| (rest(*v).y - 0.06).abs() < 1e-6 && (rest(*v).z * side - 0.5 * WIDTH).abs() < 0.05 * WIDTH;
        let mut lip: Vec<[f64; 2]> =
            on_border().filter(is_lip).map(|v| [rest(v).x, side * (tissue.position(v) - rest(v)).z]).collect();
        lip.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let steps = lip.windows(2).map(|w| (w[1][1] - w[0][1]).abs() - 0.4 * (w[1][0] - w[0][0]));
        let (step, widest) = (steps.fold(0.0, f64::max), lip.iter().map(|l| l[1]).fold(0.0, f64::max));
        assert!(lip.len() > 30 && step < 0.5e-3, "{side}: {step}, {lip:.4?}");
        let share = widest / half_gap;
        assert!((0.8..1.1).contains(&share) && lip.iter().all(|l| l[1] > -0.1e-3), "{side}: {widest}, {lip:.4?}");
    }
}

/// At rest a strip lies where its box has cut the skin, however tissue between the blade's ends bends. It was carried there by the frame of
/// one vertex, near the blade's top: up to 40 mm beside the cut, so that links went through it, and lips with walls stood up to 7 mm on the
/// other's side.
#[test]
fn a_strip_lies_at_rest_where_its_box_has_cut_the_skin() {
    const WIDTH: f64 = 0.003;
    for wall in [WallMode::Open, WallMode::Closed] {
        let scene = torn_in_a_bending_bar(WIDTH, wall);
        let (_, tissue) = scene.tissues().next().unwrap();
        let (mesh, layer) = (tissue.mesh(), tissue.layer().unwrap());
        let mut strips = 0;
        for (k, strip) in layer.strips.as_slice().iter().enumerate().filter(|(_, s)| !s.is_beside()) {
            let ([tip, next_tip, next_base, base], [from, to]) = (strip.corners.map(DVec3::from_array), strip.skin_edge());
            if from.y < 0.0 || strip.length < WIDTH {
                continue; // the tip leaves that side of the bar on the way of its box, and one box goes on in what was cut before
            }
            let off = [(tip, base, from), (next_tip, next_base, to)].map(|(t, b, at)| (at - t).reject_from(b - t).length());
            assert!(off[0].max(off[1]) < 0.4 * WIDTH, "{wall:?}: strip {k} passes the cut by {off:?}");
            strips += 1;
        }
        assert!(strips > 6, "{wall:?}: {strips}");
        let rest = |v: VertexId| tissue.rest_positions()[v.index()];
        let is_lip = |v: &VertexId| !layer.strips.lip_sides(*v).is_empty() && (rest(*v).y - 0.06).abs() < 1e-6;
        let way = |v: VertexId| rest(v).z.signum() * (tissue.position(v) - rest(v)).z;
        let ways: Vec<f64> = mesh.live_vertices().filter(is_lip).map(way).collect();
        let widest = ways.iter().copied().fold(0.0, f64::max) / (0.5 * layer.settings.wound.gap);
        assert!(ways.len() > 60 && (0.8..1.1).contains(&widest), "{wall:?}: {widest} of half the gap");
        assert!(ways.iter().all(|way| *way > -0.1e-3), "{wall:?}: a lip stands beyond the other, {ways:.4?}");
    }
}
