//! Closed tears: walls and floors leave a closed manifold whose volume is that of the exact boolean difference (MATHS 5.7).

mod common;
#[path = "tear_closed/flush.rs"]
mod flush;
#[path = "tear_closed/found.rs"]
mod found;

use common::Solid;
use common::bodies::{Hexahedron, any_box, tear};
use common::models::{self, model_of_obj};
use common::reference::{volume, volume_of_difference};
use glam::{DMat3, DVec3};
use incise::formats::Model;
use incise::geometry::VertexId;
use incise::scene::{EditCommand, EditReport, Outcome, Scene, SceneSettings};
use incise::surgery::{BladePose, SamplingSettings, TearBox, WallMode};
use incise::tissue::{Tissue, TissueSettings};
use proptest::prelude::*;

fn triangles(solid: &Solid) -> Vec<[u32; 3]> {
    solid.mesh.live_faces().map(|f| solid.mesh.face(f).map(|v| v.0)).collect()
}

fn hull(body: &Hexahedron) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let quads = (0..6).map(|k| body.facets.cycle(k).iter().map(|&c| u32::from(c)).collect::<Vec<_>>());
    (body.facets.corners.to_vec(), quads.flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect())
}

/// A single body out of a closed solid: closed, sound, and of the right volume.
fn check(before: &Solid, after: &Solid, bodies: &[Hexahedron]) -> Result<(), TestCaseError> {
    prop_assert_eq!(after.mesh.validate(), Ok(()));
    prop_assert_eq!(after.open_half_edges().len(), 0);
    let whole = volume(&before.positions, &triangles(before));
    let hulls: Vec<_> = bodies.iter().map(hull).collect();
    let expected = volume_of_difference(&before.positions, &triangles(before), &hulls).unwrap();
    let found = volume(&after.positions, &triangles(after));
    let off = (found - expected).abs();
    let removed = whole - expected;
    prop_assert!(off <= 1e-6 * whole && off <= 1e-3 * removed + 1e-10 * whole, "{found} for {expected} of {whole}");
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn bodies_leave_a_closed_solid_of_the_right_volume(boxes in prop::collection::vec(any_box(1.2, 0.8), 1..4), levels in 0usize..4) {
        let before = Solid::sphere(1.0, levels);
        let mut solid = before.clone();
        let mut torn = Vec::new();
        for body in boxes {
            // a body that no face reaches into is left alone by rule, even inside the solid
            if tear(&mut solid, &body, true).0 {
                torn.push(body);
            }
        }
        check(&before, &solid, &torn)?;
    }
}

/// A broken wall is caught: the same check on a solid that lacks what one wall face spans.
#[test]
fn a_broken_wall_is_caught() {
    let before = Solid::sphere(1.0, 2);
    let body = Hexahedron::new(DVec3::X, DMat3::IDENTITY, DVec3::splat(0.3));
    let mut after = before.clone();
    let (_, step) = tear(&mut after, &body, true);
    let torn = [body];
    assert!(check(&before, &after, &torn).is_ok());
    let corner = step.new_vertices.iter().find(|n| n.parent_count == 0).unwrap().vertex;
    let mut moved = after.clone();
    moved.positions[corner.index()].y += 1e-3;
    assert!(check(&before, &moved, &torn).is_err(), "a corner of the floor 1e-3 off");
    let (wall, _) = step.walls[0];
    after.mesh.replace_faces(&[wall], &[], |_| 0, &mut Default::default());
    assert!(check(&before, &after, &torn).is_err(), "a wall face too few");
}

/// A scene without particles, at rest, and its surface in model space.
fn still_scene(name: &str, faces: usize) -> (Scene, Vec<DVec3>, Vec<[u32; 3]>) {
    still(models::model(name, faces))
}

/// [`still_scene`] of any model.
fn still(model: Model) -> (Scene, Vec<DVec3>, Vec<[u32; 3]>) {
    let settings = TissueSettings { particles: None, ..models::settings(&model) };
    let tissue = Tissue::new(model, &settings).unwrap();
    let mut positions = vec![DVec3::ZERO; tissue.mesh().vertex_slots()];
    for v in tissue.mesh().live_vertices() {
        positions[v.index()] = tissue.position(v) + tissue.offset();
    }
    let faces = tissue.mesh().live_faces().map(|f| tissue.mesh().face(f).map(|v| v.0)).collect();
    let tools = SceneSettings { sampling: SamplingSettings::default(), sample_distance: None, sample_time: None };
    let mut scene = Scene::new(tissue, tools);
    scene.set_wall(WallMode::Closed);
    (scene, positions, faces)
}

fn stroke(scene: &mut Scene, width: f64, poses: &[BladePose]) -> EditReport {
    scene.edit(EditCommand::StrokeBegin { width });
    for pose in poses {
        scene.edit(EditCommand::StrokePose(*pose));
    }
    scene.edit(EditCommand::StrokeEnd).pop().unwrap()
}

fn box_hull(b: &TearBox) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    (b.corners().to_vec(), b.hull_triangles().iter().map(|t| t.map(u32::from)).collect())
}

/// A path through a model with these bounds: the tip wanders, the blade reaches far out and tilts.
#[derive(Clone, Debug)]
struct Wander {
    start: [f64; 3],
    steps: Vec<[f64; 3]>,
    up: [f64; 3],
    width: f64,
}

impl Wander {
    fn any() -> impl Strategy<Value = Self> {
        let unit = || prop::array::uniform3(-1.0f64..1.0);
        (unit(), prop::collection::vec(unit(), 1..5), unit(), 0.002f64..0.08).prop_map(|(start, steps, up, width)| Self {
            start,
            steps,
            up,
            width,
        })
    }

    fn poses(&self, low: DVec3, high: DVec3) -> Vec<BladePose> {
        let (centre, half) = ((low + high) / 2.0, (high - low) / 2.0);
        let diagonal = (high - low).length();
        let mut tip = centre + half * DVec3::from_array(self.start) * 0.9;
        let mut up = DVec3::from_array(self.up).try_normalize().unwrap_or(DVec3::Y);
        let mut poses = vec![BladePose { t: 0.0, tip, base: tip + up * diagonal * 1.2 }];
        for (i, step) in self.steps.iter().enumerate() {
            let step = DVec3::from_array(*step);
            let across = step - up * step.dot(up) * 0.8;
            tip += across * diagonal * 0.2;
            up = (up + DVec3::new(step.y, step.z, step.x) * 0.1).normalize();
            poses.push(BladePose { t: (i + 1) as f64 * 0.3, tip, base: tip + up * diagonal * 1.2 });
        }
        poses
    }
}

fn bounds(positions: &[DVec3]) -> (DVec3, DVec3) {
    (positions.iter().copied().reduce(DVec3::min).unwrap(), positions.iter().copied().reduce(DVec3::max).unwrap())
}

fn check_stroke(name: &str, faces: usize, path: &Wander) -> Result<bool, TestCaseError> {
    let poses = |(low, high): (DVec3, DVec3)| (path.width * (high - low).length(), path.poses(low, high));
    Ok(check_poses(name, faces, poses)?.is_some())
}

/// Closed pieces whose volumes add up to the boolean difference with the union of the boxes. `poses` makes width and poses of the
/// model's bounds. The numbers of faces and of pieces after, if anything was torn.
fn check_poses(
    name: &str,
    faces: usize,
    poses: impl Fn((DVec3, DVec3)) -> (f64, Vec<BladePose>),
) -> Result<Option<[usize; 2]>, TestCaseError> {
    check_solid(&format!("{name} {faces}"), still_scene(name, faces), poses)
}

/// [`check_poses`] on a scene and its surface.
fn check_solid(
    name: &str,
    (mut scene, positions, triangles): (Scene, Vec<DVec3>, Vec<[u32; 3]>),
    poses: impl Fn((DVec3, DVec3)) -> (f64, Vec<BladePose>),
) -> Result<Option<[usize; 2]>, TestCaseError> {
    let (width, poses) = poses(bounds(&positions));
    let report = stroke(&mut scene, width, &poses);
    for (_, tissue) in scene.tissues() {
        prop_assert_eq!(tissue.validate(), Ok(()));
        prop_assert_eq!(double_edges(tissue), 0);
    }
    if report.outcome == Outcome::Missed {
        return Ok(None);
    }
    prop_assert!(report.pieces.iter().all(|p| p.closed), "{:?}", report.pieces);
    let whole = volume(&positions, &triangles);
    let boxes: Vec<_> = scene.last_tear_boxes().iter().map(box_hull).collect();
    let Ok(expected) = volume_of_difference(&positions, &triangles, &boxes) else { return Ok(None) };
    let found: f64 = report.pieces.iter().map(|p| p.volume).sum();
    let off = (found - expected).abs();
    let removed = whole - expected;
    prop_assert!(
        off <= 1e-6 * whole && off <= 1e-3 * removed + 1e-9 * whole,
        "{}: {} for {}, {:e} of the whole, {:e} of the removed; boxes {:?}",
        name,
        found,
        expected,
        off / whole,
        off / removed,
        scene
            .last_tear_boxes()
            .iter()
            .zip(&report.segments)
            .map(|(b, s)| (b.chain, b.index, b.volume() / whole, s.wall_faces))
            .collect::<Vec<_>>()
    );
    Ok(Some([scene.tissues().map(|(_, t)| t.mesh().face_count()).sum(), report.pieces.len()]))
}

/// Edges that more than two faces share, to whoever knows corners and no half-edges.
fn double_edges(tissue: &Tissue) -> usize {
    let faces: Vec<[u32; 3]> = tissue.mesh().live_faces().map(|f| tissue.mesh().face(f).map(|v| v.0)).collect();
    edges_of_more_than_two(&faces)
}

fn edges_of_more_than_two(faces: &[[u32; 3]]) -> usize {
    let ends = |a: u32, b: u32| [a.min(b), a.max(b)];
    let mut edges: Vec<[u32; 2]> = faces.iter().flat_map(|&[a, b, c]| [ends(a, b), ends(b, c), ends(c, a)]).collect();
    edges.sort_unstable();
    edges.chunk_by(|a, b| a == b).filter(|run| run.len() > 2).count()
}

/// For each of three models.
const STROKES: u32 = 170;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(STROKES))]

    #[test]
    fn strokes_on_a_sphere(path in Wander::any(), fine in any::<bool>()) {
        check_stroke("sphere", if fine { 768 } else { 150 }, &path)?;
    }

    #[test]
    fn strokes_on_a_beam(path in Wander::any(), fine in any::<bool>()) {
        check_stroke("beam", if fine { 800 } else { 200 }, &path)?;
    }

    #[test]
    fn strokes_on_a_heart(path in Wander::any()) {
        check_stroke("heart", 500, &path)?;
    }
}

fn across(scene: &Scene, share: f64, depth: f64, count: usize) -> Vec<BladePose> {
    let (_, tissue) = scene.tissues().next().unwrap();
    let (low, high) = tissue.bounds();
    let (low, high) = (low + tissue.offset(), high + tissue.offset());
    let size = high - low;
    let at = |i: usize| low.x + size.x * (0.25 + 0.5 * i as f64 / (count - 1) as f64);
    let pose = |i: usize| {
        let tip = DVec3::new(at(i), high.y - size.y * depth, low.z + size.z * (share + 0.02 * (i as f64).sin()));
        BladePose { t: i as f64 * 0.05, tip, base: tip + DVec3::Y * size.length() }
    };
    (0..count).map(pose).collect()
}

/// A blade through the model that turns about a point within it.
fn turning(scene: &Scene, share: f64, count: usize) -> Vec<BladePose> {
    let (_, tissue) = scene.tissues().next().unwrap();
    let (low, high) = tissue.bounds();
    let (low, high) = (low + tissue.offset(), high + tissue.offset());
    let size = high - low;
    let about = low + size * DVec3::new(share, 0.6, 0.5);
    let pose = |i: usize| {
        let (sin, cos) = (0.06 * i as f64 - 0.4).sin_cos();
        let up = DVec3::new(sin, cos, 0.0);
        BladePose { t: i as f64 * 0.05, tip: about - size.y * 1.2 * up, base: about + size.length() * up }
    };
    (0..count).map(pose).collect()
}

fn all_closed(scene: &Scene) -> bool {
    scene.tissues().all(|(_, t)| t.measure_all().closed())
}

/// Strokes while the model is animated and displaced: walls stay closed, nothing pops, undo leads back.
#[test]
fn walls_on_moving_displaced_tissue() {
    for (name, faces) in [("beam", 800), ("heart", 900)] {
        let (mut scene, animated) = models::scene(name, faces);
        scene.set_wall(WallMode::Closed);
        scene.set_animation(animated.then_some(0));
        let diagonal = scene.tissues().next().unwrap().1.diagonal();
        let untouched = scene.edit_hash();
        let (mut time, mut torn_strokes) = (0.0, 0);
        for (stroke, share) in [0.5, 0.42, 0.58, 0.3].into_iter().enumerate() {
            let poses = match stroke {
                3 => turning(&scene, share, 14),
                _ => across(&scene, share, if stroke == 2 { 1.2 } else { 0.5 }, 14),
            };
            let edit = |scene: &mut Scene, command: EditCommand| {
                let before: Vec<(VertexId, DVec3)> =
                    scene.tissues().next().map(|(_, t)| t.mesh().live_vertices().map(|v| (v, t.position(v))).collect()).unwrap();
                let reports = scene.edit(command);
                let (_, tissue) = scene.tissues().next().unwrap();
                for (v, p) in before.into_iter().filter(|(v, _)| tissue.mesh().vertex_is_live(*v)) {
                    assert!(tissue.position(v).distance(p) < 1e-6 * diagonal, "{name}: {v:?} pops");
                }
                reports
            };
            edit(&mut scene, EditCommand::StrokeBegin { width: 0.012 * diagonal });
            for pose in poses {
                time += 1.0 / 30.0;
                scene.pose(time, time);
                scene.step(1.0 / 30.0);
                edit(&mut scene, EditCommand::StrokePose(pose));
                assert!(all_closed(&scene), "{name}: open during stroke {stroke}");
            }
            let report = edit(&mut scene, EditCommand::StrokeEnd).pop().unwrap();
            assert_eq!(report.unclosed_edges, 0);
            torn_strokes += usize::from(report.wall_faces > 0);
            assert!(report.pieces.iter().all(|p| p.closed && p.non_manifold_edges == 0), "{name}: {:?}", report.pieces);
            assert!(report.wall_deviation < 0.05 * diagonal, "{name}: {}", report.wall_deviation);
            for (_, tissue) in scene.tissues() {
                assert_eq!(tissue.validate(), Ok(()));
            }
            for _ in 0..10 {
                time += 1.0 / 30.0;
                scene.pose(time, time);
                scene.step(1.0 / 30.0);
            }
        }
        assert!(torn_strokes > 1, "{name}: {torn_strokes} strokes met the model");
        let torn = scene.edit_hash();
        (0..torn_strokes).for_each(|_| drop(scene.edit(EditCommand::Undo)));
        assert_eq!(scene.edit_hash(), untouched);
        (0..torn_strokes).for_each(|_| drop(scene.edit(EditCommand::Redo)));
        assert_eq!(scene.edit_hash(), torn);
    }
}

/// Straight lips on a flat skin, on tilted blades: no wall face without area.
#[test]
fn walls_along_straight_lips_have_no_face_without_area() {
    let (mut scene, ..) = still_scene("beam", 3000);
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let pose = |t: f64, tip: DVec3, base: DVec3| BladePose { t, tip, base };
    let poses = [
        pose(0.0, at(-0.1, 0.02, 0.0), at(-0.1, 0.5, 0.02)),
        pose(0.5, at(0.0, 0.0, 0.01), at(0.0, 0.5, 0.0)),
        pose(1.0, at(0.1, 0.02, 0.0), at(0.1, 0.5, 0.0)),
    ];
    let report = stroke(&mut scene, 0.01, &poses);
    assert_eq!(report.pieces[0].degenerate_faces, 0);
    assert!(report.pieces[0].closed && report.smallest_angle.unwrap() > 0.0, "{:?}", report.smallest_angle);
}

/// A blade that goes back and forth in its own slot takes out what one pass does, and nothing else: the walls of the way back lie in
/// the planes of the first walls, up to the rounding of their corners.
#[test]
fn sawing_takes_out_what_one_pass_does() {
    let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
    for (name, faces, seed) in
        [("sphere", 800, 8), ("heart", 3000, 5), ("heart", 3000, 19), ("sphere", 800, 43), ("heart", 3000, 33)]
    {
        let random = |k: u64| {
            let x = (seed as f64 * 12.9898 + k as f64 * 78.233).sin() * 43_758.545_3;
            2.0 * (x - x.floor()) - 1.0
        };
        let (scene, ..) = still_scene(name, faces);
        let (low, high) = scene.tissues().next().expect("a tissue").1.bounds();
        let radius = 0.5 * (high - low).min_element();
        let down = DVec3::new(random(0), random(1), random(2)).normalize();
        let along = down.cross(DVec3::new(random(3), random(4), random(5))).normalize();
        let pose = |t: f64, x: f64| {
            let at = (low + high) / 2.0 + along * (0.9 * radius * x) + down.cross(along) * (0.1 * radius);
            BladePose { t, tip: at + down * (0.4 * radius), base: at + down * (2.0 * radius) }
        };
        let removed = |count: usize, turns: f64| {
            let (mut scene, ..) = still_scene(name, faces);
            scene.set_wall(WallMode::Closed);
            let share = |k: usize| k as f64 / (count - 1) as f64;
            let way = |k: usize| pose(2.0 * share(k), (std::f64::consts::PI * turns * share(k)).cos());
            let poses: Vec<BladePose> = (0..count).map(way).collect();
            let report = stroke(&mut scene, 0.02 * radius, &poses);
            assert!(all_closed(&scene));
            report.volume_before - report.pieces.iter().map(|p| p.volume).sum::<f64>()
        };
        let once = removed(8, 1.0);
        let sawn = removed(43, 6.0);
        worst = worst.max((sawn - once).abs() / once);
        largest = largest.max(once);
    }
    println!("sawing against one pass: {worst:.1e} of what is removed");
    assert!(largest > 0.0 && worst < 2e-3, "{worst:e}");
}

/// The third pass of a saw met slivers of the first two and took out what was gone already.
#[test]
fn a_saw_takes_out_the_union_of_its_boxes() {
    let saws = [
        (800, 47, 0.001844, [0.024737, 0.251067, 0.276839], [0.278953, 0.215149, -0.220046], [0.042405, 0.430387, 0.474567]),
        (3000, 23, 0.010385, [0.394753, 0.104743, 0.082819], [-0.124767, 0.444422, 0.032627], [0.570403, 0.15135, 0.11967]),
    ];
    for (faces, count, width, middle, along, up) in saws {
        let [middle, along, up] = [middle, along, up].map(DVec3::from_array);
        let pose = |k: usize| {
            let share = k as f64 / (count - 1) as f64;
            let tip = middle + along * (6.0 * std::f64::consts::PI * share).cos();
            BladePose { t: 2.0 * share, tip, base: tip + up }
        };
        let torn = check_poses("sphere", faces, |_| (width, (0..count).map(pose).collect())).unwrap();
        assert!(torn.is_some_and(|[n, _]| n < 3 * faces), "{torn:?}");
    }
}

/// A blade that turns about a point inside cuts its own walls with every box: vertices that the walls do not need go again. Without
/// that there were 34,000 faces here, of which the shape needs 6,000.
#[test]
fn a_blade_that_turns_inside_leaves_no_dust() {
    let poses = |(low, high): (DVec3, DVec3)| {
        let radius = (high - low).min_element() / 2.0;
        let pose = |i: usize| {
            let (sin, cos) = (0.2 + 0.125 * i as f64).sin_cos();
            let up = DVec3::new(sin, cos, 0.05 * (3.0 * i as f64).sin());
            let at = (low + high) / 2.0 + DVec3::new(0.0, 0.1 * (i as f64).sin(), 0.13) * radius;
            BladePose { t: 0.1 * i as f64, tip: at - up * (0.5 * radius), base: at + up * (3.0 * radius) }
        };
        (0.03 * (high - low).length(), (0..5).map(pose).collect())
    };
    let faces = check_poses("sphere", 800, poses).unwrap();
    assert!(faces.is_some_and(|[n, _]| (2000..12_000).contains(&n)), "{faces:?}");
}

/// A blade right through the model that turns about a point of its own: what is below the point and what is above are a chain of boxes
/// each, which share their joints. When each pose had boxes of its own, they cut each other's walls: the first of these had 4,900
/// faces in 16 pieces, the last 51,000 in 202.
#[test]
fn a_blade_that_turns_about_its_own_point_leaves_no_shreds() {
    let turn = |name: &str, faces: usize, pivot: f64, [first, step]: [f64; 2], trembling: f64| {
        let poses = |(low, high): (DVec3, DVec3)| {
            let diagonal = (high - low).length();
            let random =
                |i: usize, k: usize| 2.0 * ((i as f64 * 12.9898 + k as f64 * 78.233).sin() * 43_758.545_3).rem_euclid(1.0) - 1.0;
            let axis = DVec3::new(0.07, 0.05, 1.03).normalize();
            let pose = |i: usize| {
                let hand = DVec3::from_array(std::array::from_fn(|k| random(i, k))) * trembling;
                let up = (glam::DQuat::from_axis_angle(axis, first + step * i as f64) * axis.any_orthonormal_vector()
                    + 2.0 * hand)
                    .normalize();
                let tip = (low + high) / 2.0 + diagonal * (hand - 3.0 * pivot * up);
                BladePose { t: 0.1 * i as f64, tip, base: tip + 3.0 * diagonal * up }
            };
            (0.01 * diagonal, (0..8).map(pose).collect())
        };
        let torn = check_poses(name, faces, poses).unwrap().expect("it meets the model");
        println!("{name}, about {pivot}: {torn:?} faces and pieces");
        torn
    };
    for (name, faces) in [("sphere", 800), ("heart", 900)] {
        for pivot in [0.5, 0.4, 0.3, 0.0] {
            let [after, pieces] = turn(name, faces, pivot, [0.3, 0.143], 0.0);
            assert!(after < 4 * faces && pieces <= 2, "{name}, about {pivot}: {after} faces in {pieces} pieces");
        }
        // half a turn and more
        let [after, pieces] = turn(name, faces, 0.5, [0.3, 0.5], 0.0);
        assert!(after < 9 * faces && pieces <= 3, "{name}: {after} faces in {pieces} pieces");
        let [after, pieces] = turn(name, faces, 0.4, [0.3, 0.1], 0.004);
        assert!(after < 10 * faces && pieces <= 5, "{name}, a hand that trembles: {after} faces in {pieces} pieces");
    }
}

/// One pose a frame, or all at once: the same bits while the tissue rests.
#[test]
fn live_and_offline_give_the_same_bits() {
    let torn = |live: bool| {
        let (mut scene, _) = models::scene("heart", 900);
        scene.set_wall(WallMode::Closed);
        let diagonal = scene.tissues().next().unwrap().1.diagonal();
        let poses = across(&scene, 0.5, 0.3, 12);
        scene.edit(EditCommand::StrokeBegin { width: 0.01 * diagonal });
        for (i, pose) in poses.into_iter().enumerate() {
            if live {
                scene.pose(i as f64 / 90.0, 0.0);
            }
            scene.edit(EditCommand::StrokePose(pose));
        }
        scene.edit(EditCommand::StrokeEnd);
        assert!(all_closed(&scene));
        scene.edit_hash()
    };
    assert_eq!(torn(true), torn(false));
}

/// A unit ball with a ball-shaped hollow in it: two components.
fn hollow_ball(at: DVec3, radius: f64) -> Scene {
    let (outer, inner) = (Solid::sphere(1.0, 3), Solid::sphere(radius, 2));
    let mut text = String::new();
    for p in outer.positions.iter().copied().chain(inner.positions.iter().map(|p| *p + at)) {
        text += &format!("v {} {} {}\n", p.x, p.y, p.z);
    }
    let first = outer.positions.len() as u32;
    let turned = triangles(&inner).into_iter().map(|[a, b, c]| [a, c, b].map(|v| v + first));
    for [a, b, c] in triangles(&outer).into_iter().chain(turned) {
        text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
    }
    let model = model_of_obj(&text);
    let settings = TissueSettings { particles: None, ..models::settings(&model) };
    let tools = SceneSettings { sampling: SamplingSettings::default(), sample_distance: None, sample_time: None };
    let mut scene = Scene::new(Tissue::new(model, &settings).unwrap(), tools);
    scene.set_wall(WallMode::Closed);
    scene
}

/// A blade that goes right through a ball and its hollow joins both by walls, and what comes off is told all the same.
#[test]
fn what_is_severed_through_a_hollow_is_told() {
    let mut scene = hollow_ball(DVec3::ZERO, 0.5);
    let pose = |i: usize| {
        let at = DVec3::new(0.2 * i as f64 - 1.2, 0.1, 0.0);
        BladePose { t: i as f64 / 90.0, tip: at - 1.3 * DVec3::Z, base: at + 1.5 * DVec3::Z }
    };
    let report = stroke(&mut scene, 0.02, &(0..13).map(pose).collect::<Vec<_>>());
    assert_eq!(report.outcome, Outcome::Severed);
    assert!(report.pieces.len() == 2 && all_closed(&scene), "{:?}", report.pieces);
    let [a, b] = [0, 1].map(|k| report.pieces[k].volume);
    assert!(a.min(b) > 0.3 * (a + b), "{a} {b}");
}

/// A hollow that the blade does not reach goes with the piece around it, be it the smaller one.
#[test]
fn a_hollow_goes_with_the_piece_around_it() {
    for (side, hollow) in [(-1.0, [1, 2]), (1.0, [2, 1])] {
        let mut scene = hollow_ball(DVec3::new(side * 0.65, 0.0, 0.0), 0.2);
        let pose = |i: usize| {
            let at = DVec3::new(-0.3, 0.2 * i as f64 - 1.2, 0.0);
            BladePose { t: i as f64 / 90.0, tip: at - 1.3 * DVec3::Z, base: at + 1.5 * DVec3::Z }
        };
        let report = stroke(&mut scene, 0.02, &(0..13).map(pose).collect::<Vec<_>>());
        assert!(report.outcome == Outcome::Severed && report.pieces.len() == 2 && all_closed(&scene), "{:?}", report.pieces);
        let parts: Vec<usize> = scene.tissues().map(|(_, tissue)| tissue.component_faces().len()).collect();
        assert_eq!(parts, hollow, "the larger piece stays");
    }
}
