//! Wounds that cross in one place: the tips between them are narrower than what they open by.

use super::crossings::blade_over_the_front;
use super::lips::folded_skin;
use super::*;
use crate::common::models::users_scene_opening;

/// Two and three strokes across one place, gaps as they are and twice as wide. Both lips of a tip are drawn apart from it, into it: it was turned
/// over, by up to a quarter of the square of the gap.
#[test]
fn tips_between_wounds_that_cross_are_not_turned_over() {
    for (name, scale) in [("sphere", 1.0), ("heart", 0.1)] {
        let is_heart = name == "heart";
        let (mut all_folded, mut all_opened) = (0.0, 0.0);
        for (wide, width) in [(1.0, 0.0), (1.0, 0.002), (2.0, 0.0), (2.0, 0.002)] {
            let mut scene = users_scene_opening(name, if is_heart { 18_000 } else { 17_328 }, wide);
            scene.set_wall(WallMode::Open);
            let gap = only(&scene).layer().unwrap().settings.wound.gap;
            for (k, degrees) in [0.0, 90.0, 45.0_f64].into_iter().enumerate() {
                let (sin, cos) = degrees.to_radians().sin_cos();
                stroke(&mut scene, width * scale, 2.0 * k as f64, |x| {
                    blade_over_the_front(is_heart, 0.68 * x * DVec3::new(cos, sin, 0.0))
                });
                let folded = folded_skin(only(&scene)) / (gap * gap);
                assert!(folded < 0.05, "{name}, {wide}, {width}: {folded} of a squared gap is turned over after stroke {k}");
                all_folded += folded;
            }
            all_opened += mean_opening(only(&scene));
        }
        assert!(all_folded < 0.1, "{name}: {all_folded} squared gaps are turned over");
        assert!(all_opened > 0.6, "{name}: lips are out by {} of a gap in the mean", all_opened / 4.0);
    }
}

/// How far lips are out along their strips' normals, in gaps.
fn mean_opening(tissue: &Tissue) -> f64 {
    let layer = tissue.layer().unwrap();
    let out = |v: VertexId| {
        let lip = layer.strips.lip_sides(v).iter().next()?;
        let outwards = layer.strips.geometry(lip.strip as usize).normal() * f64::from(lip.side);
        Some((tissue.position(v) - tissue.rest_positions()[v.index()]).dot(outwards) / layer.settings.wound.gap)
    };
    let all: Vec<f64> = tissue.mesh().live_vertices().filter_map(out).collect();
    all.iter().sum::<f64>() / all.len() as f64
}

/// Three strokes beside each other and three across: the squares between come off. What is left of the strips between wide wounds is narrower than
/// the way from a sample to the next, and the blade went over it from wound to wound and left it whole.
#[test]
fn strips_between_wounds_are_cut_through() {
    let mut scene = users_scene_opening("heart", 18_000, 1.31);
    scene.set_wall(WallMode::Open);
    for (k, place) in [-0.082, 0.0, 0.082, -0.082, 0.0, 0.082].into_iter().enumerate() {
        stroke(&mut scene, 0.002, 2.0 * k as f64, |x| {
            let at = 0.72 * x;
            let at = if k < 3 { DVec3::new(at, place, 0.0) } else { DVec3::new(place, at, 0.0) };
            [0.022, 0.086].map(|z| 0.1 * at + z * DVec3::Z)
        });
    }
    assert_eq!(scene.tissues().count(), 5, "the heart and four squares");
}
