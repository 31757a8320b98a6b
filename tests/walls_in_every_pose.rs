//! Walls and floors of a closed tear stay inside the body in every pose, not only in that of the tear (MATHS 1.4).

mod common;

use common::models::{model, settings};
use glam::DVec3;
use incise::scene::{EditCommand, Scene, SceneSettings, TissueId};
use incise::surgery::{BladePose, SamplingSettings, WallMode};
use incise::tissue::{Tissue, TissueSettings};
use std::f64::consts::TAU;

const STEP: f64 = 1.0 / 30.0;

/// How often a closed surface winds round `p`: 1 inside, 0 outside.
fn winding(p: DVec3, faces: &[[DVec3; 3]]) -> f64 {
    let angle = |corners: &[DVec3; 3]| {
        let [a, b, c] = corners.map(|q| q - p);
        let (x, y, z) = (a.length(), b.length(), c.length());
        2.0 * a.dot(b.cross(c)).atan2(x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y)
    };
    faces.iter().map(angle).sum::<f64>() / (2.0 * TAU)
}

fn beam(settings: &TissueSettings) -> (Scene, Tissue) {
    let tissue = || Tissue::new(model("beam", 800), settings).unwrap();
    let tools = SceneSettings { sampling: SamplingSettings::default(), sample_distance: None, sample_time: None };
    let mut scene = Scene::new(tissue(), tools);
    scene.set_wall(WallMode::Closed);
    scene.set_animation(Some(0));
    (scene, tissue())
}

/// Tears while the beam bends: the blade, much longer than the beam is high, goes from one to the next of these points in 12 frames.
fn tear(scene: &mut Scene, by: &[DVec3]) {
    scene.edit(EditCommand::StrokeBegin { width: 0.006 });
    for k in 0..=12 * (by.len() - 1) {
        let (leg, share) = ((k / 12).min(by.len() - 2), k as f64 / 12.0);
        let tip = by[leg].lerp(by[leg + 1], share - leg as f64);
        let t = k as f64 * STEP;
        scene.pose(0.5 + t, 0.5 + t);
        scene.edit(EditCommand::StrokePose(BladePose { t, tip, base: tip + DVec3::Y * 0.4 }));
    }
    scene.edit(EditCommand::StrokeEnd);
    assert_eq!(scene.validate(), Ok(()));
}

#[test]
fn floors_stay_inside_the_body_while_it_bends() {
    let (mut scene, mut uncut) = beam(&TissueSettings { particles: None, ..settings(&model("beam", 800)) });
    tear(&mut scene, &[DVec3::X * -0.15, DVec3::X * 0.2]);
    // corners of walls may lie in the skin to the last bits, on either side of it
    let top = uncut.mesh().live_vertices().map(|v| uncut.rows().rest(v).y).fold(0.0, f64::max);
    let (mut looked_at, mut outside) = (0, 0);
    for k in 0..30 {
        // fades are over
        let t = 10.0 + f64::from(k) * 2.0 * STEP;
        scene.pose(t, t);
        let tissue = scene.tissue(TissueId(0)).unwrap();
        let duration = tissue.rig().animations[0].duration_s;
        uncut.set_pose(t, Some(0), t.rem_euclid(duration));
        let skin: Vec<_> = uncut.mesh().live_faces().map(|f| uncut.mesh().face(f).map(|v| uncut.position(v))).collect();
        for v in
            tissue.mesh().live_vertices().filter(|&v| common::is_deep(tissue.mesh(), v) && tissue.rows().rest(v).y < top - 1e-6)
        {
            looked_at += 1;
            outside += usize::from(winding(tissue.position(v), &skin) < 0.5);
        }
    }
    assert!(looked_at > 300 && outside == 0, "{outside} of {looked_at} lie outside");
}

#[test]
fn a_strip_ends_not_far_above_the_wound() {
    let (mut scene, _) = beam(&settings(&model("beam", 800)));
    // on its way back the blade stands in the slit: it enters no skin, but widens the slit
    tear(&mut scene, &[DVec3::X * -0.15, DVec3::X * 0.15, DVec3::new(-0.15, 0.0, 0.002)]);
    let strips = &scene.tissue(TissueId(0)).unwrap().layer().unwrap().strips;
    let heights: Vec<f64> = strips
        .as_slice()
        .iter()
        .flat_map(|s| {
            let [tip0, tip1, base1, base0] = s.corners.map(DVec3::from_array);
            [tip0.distance(base0), tip1.distance(base1)]
        })
        .collect();
    assert!(heights.len() > 10 && heights.iter().all(|&h| h < 0.3), "{heights:.3?}");
}

/// A blade that goes along its own axis, the length of the beam, while that bends: skin gathers in folds where it enters.
#[test]
fn a_stab_along_a_bending_beam_does_not_double_its_walls() {
    let bundled = model("beam", 2_800);
    let settings = TissueSettings { particles: None, ..settings(&bundled) };
    let tools = SceneSettings { sampling: SamplingSettings::default(), sample_distance: Some(0.001_87), sample_time: None };
    let mut scene = Scene::new(Tissue::new(bundled, &settings).unwrap(), tools);
    scene.set_wall(WallMode::Closed);
    scene.set_animation(Some(0));
    scene.edit(EditCommand::StrokeBegin { width: 0.003_12 });
    let (tip, base) = (DVec3::new(0.198_02, 0.020_44, -0.023_6), DVec3::new(0.678_34, 0.330_38, -0.106_07));
    let (to_tip, to_base) = (DVec3::new(0.162_36, 0.004_59, -0.025_86), DVec3::new(0.656_27, 0.258_49, -0.099_77));
    let stroke = |scene: &mut Scene, u: f64| {
        let (tip, base) = (tip.lerp(to_tip, u), base.lerp(to_base, u));
        scene.edit(EditCommand::StrokePose(BladePose { t: 0.005_65 * u, tip, base }));
    };
    scene.pose(6.0 / 90.0, 6.0 / 90.0);
    stroke(&mut scene, 0.0);
    stroke(&mut scene, 0.17);
    scene.pose(7.0 / 90.0, 7.0 / 90.0);
    stroke(&mut scene, 0.67);
    let report = scene.edit(EditCommand::StrokeEnd).pop().unwrap();
    assert_eq!(scene.validate(), Ok(()));
    let (walls, boxes): (usize, _) = (report.segments.iter().map(|s| s.wall_faces).sum(), report.segments.len());
    // with the folds cut again by every box, 1,667 of 18 boxes and 24 shreds
    assert!(boxes > 12 && walls < 44 * boxes && report.pieces.len() == 1, "{walls} of {boxes} boxes, {:?}", report.pieces);
    // both sides of the slot, its floor and its ends: as large as they are where half as many boxes cut them, or half as many more (there
    // were 4.9 to 5.1 with both sides of a film across it, where a chain ends and another begins)
    let (_, tissue) = scene.tissues().next().unwrap();
    let mesh = tissue.mesh();
    let area = |f| {
        let [a, b, c] = mesh.face(f).map(|v| tissue.position(v));
        0.5 * (b - a).cross(c - a).length()
    };
    let lined: f64 = mesh.live_faces().filter(|f| mesh.is_interior(*f)).map(area).sum();
    assert!((0.004_5..0.004_6).contains(&lined), "{lined} m2");
}
