//! Inserted vertices lie on the original deformed faces in every pose (MATHS 1.1), and the usual interpolation of rest
//! positions and bone weights does not.

mod common;

use common::models::{model, settings};
use glam::DVec3;
use incise::geometry::{Plane, VertexId};
use incise::rig::Pose;
use incise::scene::{EditCommand, Scene, SceneSettings, TissueId};
use incise::surgery::{BladePose, SamplingSettings};
use incise::tissue::Tissue;

/// Distance of `p` from the triangle `a b c`.
fn distance(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a).normalize();
    let foot = p - normal * normal.dot(p - a);
    let inside = [(a, b), (b, c), (c, a)].iter().all(|&(u, v)| normal.dot((v - u).cross(foot - u)) >= 0.0);
    let edge = |u: DVec3, v: DVec3| p.distance(u + (v - u) * ((p - u).dot(v - u) / (v - u).length_squared()).clamp(0.0, 1.0));
    if inside { p.distance(foot) } else { edge(a, b).min(edge(b, c)).min(edge(c, a)) }
}

/// What most programs do: one vertex with interpolated rest position and bone weights.
fn plain_interpolation(tissue: &Tissue, pose: &Pose, v: VertexId) -> DVec3 {
    let rows = tissue.rows();
    let rest = rows.rest(v);
    rows.rows
        .row(v.index())
        .iter()
        .flat_map(|e| rows.bones.row(e.base.index()).iter().map(move |b| (b.joint, f64::from(b.weight) * e.weight)))
        .map(|(joint, weight)| pose.joint_matrices[joint as usize].transform(rest) * weight)
        .sum()
}

fn torn_and_cut(name: &str, faces: usize) -> (Scene, Tissue) {
    let loaded = model(name, faces);
    let tissue_settings = settings(&loaded);
    let untouched = Tissue::new(loaded.clone(), &tissue_settings).unwrap();
    let tools = SceneSettings { sampling: SamplingSettings::default(), sample_distance: None, sample_time: None };
    let mut scene = Scene::new(Tissue::new(loaded, &tissue_settings).unwrap(), tools);
    scene.set_animation(Some(0));
    scene.pose(0.4, 0.4);
    let (low, high) = scene.tissue(TissueId(0)).unwrap().bounds();
    let (centre, half) = ((low + high) / 2.0, (high - low) / 2.0);
    // twice through the same place, so that cut faces are cut again
    for slant in [0.5, -0.5] {
        scene.edit(EditCommand::StrokeBegin { width: 0.02 * half.length() });
        for k in 0..5 {
            let t = f64::from(k) / 4.0;
            let tip = centre + half * DVec3::new(-0.5 + t, slant * (t - 0.5), -0.2);
            scene.edit(EditCommand::StrokePose(BladePose { t, tip, base: tip + DVec3::Z * half.length() * 2.0 }));
        }
        scene.edit(EditCommand::StrokeEnd);
    }
    let normal = DVec3::new(1.0, 0.3, 0.2);
    scene.edit(EditCommand::Cut(Plane::Equation { normal, offset: normal.dot(centre) }));
    (scene, untouched)
}

#[test]
fn inserted_vertices_ride_on_the_original_faces() {
    for (name, faces) in [("beam", 600), ("heart", 1500)] {
        let (scene, original) = torn_and_cut(name, faces);
        let (mut exact, mut plain, mut checked) = (0.0f64, 0.0f64, 0);
        for animation in 0..original.rig().animations.len() {
            let duration = original.rig().animations[animation].duration_s;
            for k in 0..100 {
                let pose = original.rig().pose_at(Some(animation), duration * f64::from(k) / 99.0);
                for (_, tissue) in scene.tissues() {
                    for f in tissue.mesh().live_faces() {
                        let origin = incise::geometry::FaceId(tissue.mesh().face_info(f).origin);
                        let triangle = original.mesh().face(origin).map(|v| pose.skin(original.rows(), v));
                        for v in tissue.mesh().face(f).into_iter().filter(|&v| !tissue.rows().is_base(v)) {
                            exact = exact.max(distance(pose.skin(tissue.rows(), v), triangle) / original.diagonal());
                            plain = plain.max(distance(plain_interpolation(tissue, &pose, v), triangle) / original.diagonal());
                            checked += 1;
                        }
                    }
                }
            }
        }
        assert!(checked > 10_000, "{name}: only {checked} places were looked at");
        assert!(exact <= 1e-6, "{name}: {exact} of the diagonal off the deformed face");
        assert!(plain > 1e-5, "{name}: plain interpolation is off by {plain} only, so this test shows nothing");
        println!("{name}: rows {exact:.1e}, plain interpolation {plain:.1e} of the diagonal");
    }
}
