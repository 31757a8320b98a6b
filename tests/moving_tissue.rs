//! Tears through tissue that moves under the blade leave what tears through tissue at rest leave: one wound, and no bridges across it.

mod common;

use common::models::users_scene;
use common::{border_loops, open_half_edges};
use glam::DVec3;
use incise::geometry::{Components, Mesh};
use incise::scene::{EditCommand, Scene};
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

/// Openings and handles after a stroke in half a second or more, from place `k` of a spiral over the front of a heart that beats.
fn torn(k: u32, wall: WallMode) -> (usize, usize) {
    let mut scene = heart();
    scene.set_wall(wall);
    let (turn, begins) = (2.4 * f64::from(k), 0.17 * f64::from(k));
    let step = |scene: &mut Scene, i: u32| {
        scene.pose(f64::from(i) * STEP, begins + f64::from(i) * STEP);
        scene.step(STEP);
    };
    (0..5).for_each(|i| step(&mut scene, i));
    let at = |turn: f64, by: f64| by * DVec3::new(turn.cos(), turn.sin(), 0.0);
    let middle = at(turn, 0.001 * f64::from(k));
    let (way, poses) = (at(1.7 * turn, 1.0), 40 + 4 * k);
    // the blade goes through the skin from the first pose to the last, however that moves
    let base = middle + 0.1 * DVec3::Z;
    let (share, _) = scene.tissues().next().unwrap().1.blade_entry(middle, base).expect("skin in front of the middle");
    let skin = base.lerp(middle, share);
    let depth = 0.005 + 0.0002 * f64::from(k);
    scene.edit(EditCommand::StrokeBegin { width: 0.0004 });
    for i in 0..=poses {
        let share = f64::from(i) / f64::from(poses);
        let p = middle + way * 0.03 * (share - 0.5) + way.cross(DVec3::Z) * 0.002 * (9.0 * share).sin();
        let tip = p.with_z(skin.z - depth - 0.002 * (2.0 * share - 1.0).powi(2));
        scene.edit(EditCommand::StrokePose(BladePose { t: f64::from(i) * STEP, tip, base: tip + 0.06 * DVec3::Z }));
        step(&mut scene, 5 + i);
    }
    scene.edit(EditCommand::StrokeEnd);
    assert_eq!(scene.validate(), Ok(()));
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
