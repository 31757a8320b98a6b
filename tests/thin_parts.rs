//! A blade between two places in the air meets what lies there, however thin it is beside the way from one sample to the next: strips between
//! wounds, limbs, the fingers of a hand.

mod common;

use common::models::model_of_obj;
use glam::DVec3;
use incise::formats::Model;
use incise::scene::{EditCommand, Scene, SceneSettings};
use incise::surgery::{BladePose, SamplingSettings, WallMode};
use incise::tissue::{Tissue, TissueSettings};

const RODS: usize = 40;

/// Rods along y beside each other, a metre long, each as thick along x as told, in an OBJ file.
fn rods(places: &[(f64, f64)]) -> String {
    let mut text = String::new();
    for (k, &(x, thick)) in places.iter().enumerate() {
        for corner in 0..8 {
            let at = |bit: usize, low: f64, high: f64| if corner >> bit & 1 == 0 { low } else { high };
            let (x, y, z) = (at(0, x, x + thick), at(1, -0.5, 0.5), at(2, -0.02, 0.02));
            text += &format!("v {x} {y} {z}\n");
        }
        for face in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            let [a, b, c, d] = face.map(|v| 8 * k + v + 1);
            text += &format!("f {a} {b} {c} {d}\n");
        }
    }
    text
}

/// Rods 4 to 8 sample distances from each other, two thirds of one thick at first and a hundredth at last.
fn places() -> Vec<(f64, f64)> {
    let mut x = 0.0;
    let place = |k: usize| {
        x += 0.15 + 0.011 * ((7 * k) % 13) as f64;
        (x, 0.024 * 0.9f64.powi(k as i32))
    };
    (0..RODS).map(place).collect()
}

/// A scene without particles.
fn scene_of(model: Model, sampling: SamplingSettings) -> Scene {
    let settings = TissueSettings { particles: None, ..common::models::settings(&model) };
    let tools = SceneSettings { sampling, sample_distance: None, sample_time: None };
    Scene::new(Tissue::new(model, &settings).unwrap(), tools)
}

/// How many parts are apart from each other.
fn parts(scene: &Scene) -> usize {
    scene.tissues().map(|(_, tissue)| tissue.component_faces().len()).sum()
}

/// Every rod is in two after one stroke across all of them, whatever lies between two samples, open, closed and without width.
#[test]
fn no_rod_is_too_thin_to_be_cut() {
    let places = places();
    let model = model_of_obj(&rods(&places));
    let far = places[RODS - 1].0;
    let diagonal = DVec3::new(far - places[0].0, 1.0, 0.04).length();
    // every 36 mm: samples lie in the air between rods, and seldom in one
    let sampling = SamplingSettings { distance: 0.036 / diagonal, ..SamplingSettings::default() };
    for (wall, width) in [(WallMode::Open, 0.002), (WallMode::Closed, 0.002), (WallMode::Open, 0.0)] {
        for (begins, lean) in [(-0.1, 0.0), (-0.107, 0.013), (-0.123, -0.02)] {
            let mut scene = scene_of(model.clone(), sampling);
            scene.set_wall(wall);
            scene.edit(EditCommand::StrokeBegin { width });
            let from = places[0].0 + begins;
            let steps = ((far + 0.2 - from) / 0.031).ceil() as usize;
            for i in 0..=steps {
                let x = from + 0.031 * i as f64;
                let y = 0.1 * (0.5 * x).sin();
                let (tip, base) = (DVec3::new(x, y, -0.05), DVec3::new(x + lean, y, 0.05));
                scene.edit(EditCommand::StrokePose(BladePose { t: 0.01 * i as f64, tip, base }));
            }
            scene.edit(EditCommand::StrokeEnd);
            assert_eq!(scene.validate(), Ok(()));
            assert_eq!(parts(&scene), 2 * RODS, "{wall:?}, {width}, {lean}: of {RODS} rods are so many pieces");
        }
    }
}

/// A way on which the blade meets nothing tears nothing.
#[test]
fn a_blade_over_a_part_leaves_it_whole() {
    let model = model_of_obj(&rods(&[(0.0, 0.3), (1.0, 0.3)]));
    let mut scene = scene_of(model, SamplingSettings::default());
    scene.edit(EditCommand::StrokeBegin { width: 0.002 });
    for i in 0..60 {
        let x = -0.2 + 0.03 * f64::from(i);
        let tip = DVec3::new(x, 0.0, 0.0201);
        scene.edit(EditCommand::StrokePose(BladePose { t: 0.01 * f64::from(i), tip, base: tip + 0.3 * DVec3::Z }));
    }
    let reports = scene.edit(EditCommand::StrokeEnd);
    assert!(reports.iter().all(|r| r.segments.is_empty()));
    assert_eq!(parts(&scene), 2);
}
