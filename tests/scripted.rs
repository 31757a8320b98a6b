//! Scripts through the application, without a GPU: cuts of displaced, animated models, and determinism.

mod common;

use common::models::scene;
use glam::DVec3;
use incise::app::{App, FrameCounters, FrameTarget, FrameView};
use incise::diagnostics::Stages;
use incise::input::{CameraPose, Script, ScriptPlayer};
use incise::scene::Scene;
use std::convert::Infallible;
use std::path::Path;

/// Presents nothing.
struct Nowhere;

impl FrameTarget for Nowhere {
    type Error = Infallible;

    fn present(&mut self, _: &FrameView, _: &mut Stages, _: &mut FrameCounters) -> Result<(), Infallible> {
        Ok(())
    }
}

const CAMERA: CameraPose = CameraPose { eye: DVec3::Z, target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.9 };

fn play(text: &str) -> (App, Vec<incise::app::FrameReport>) {
    let (mut scene, _) = scene("beam", 800);
    scene.set_animation(Some(0));
    play_on(scene, text)
}

fn play_on(scene: Scene, text: &str) -> (App, Vec<incise::app::FrameReport>) {
    let script = Script::parse(text, Path::new("test.toml")).unwrap();
    let mut app = App::new(scene, script.speed, || 0);
    let mut player = ScriptPlayer::new(script, 0.004, CAMERA);
    let reports = (0..player.frames()).map(|f| app.frame(&player.frame(f), &mut Nowhere).unwrap()).collect();
    (app, reports)
}

const GRABBED: &str = r#"
model = "beam"
animation = "bend"
[[action]]
kind = "grab"
at = 0.1
center = [0.0, 0.06, 0.0]
radius = 0.08
until = 1.2
moves = [ { t = 0.3, by = [0.01, 0.05, 0.02] } ]
[[action]]
kind = "cut"
at = 0.6
plane = [1, 0.4, 0.2, 0.03]
cap = false
"#;

#[test]
fn a_cut_of_a_displaced_animated_model_is_exact() {
    let (app, reports) = play(GRABBED);
    let edit = reports.iter().flat_map(|r| &r.edits).next().unwrap();
    let tissue = app.scene.tissues().next().unwrap().1;
    let displaced = tissue.layer().unwrap().displacements().iter().map(|u| u.length()).fold(0.0, f64::max);
    assert!(displaced > 0.0, "the grab moved nothing");
    let after: f64 = edit.pieces.iter().map(|p| p.area).sum();
    assert!((after - edit.area_before).abs() <= 1e-6 * edit.area_before, "{} {after}", edit.area_before);
    assert!(edit.max_plane_distance.unwrap() <= 1e-6 * tissue.diagonal());
    assert!(edit.new_vertices > 20 && edit.pieces.len() == 2);
    // without the fade of MATHS 2.2 the recomputed weights would leave the plane: the fades are not zero
    let held = app.scene.tissues().flat_map(|(_, t)| t.fades().entries().iter()).map(|c| c[0].abs() + c[1].abs() + c[2].abs());
    assert!(held.fold(0.0, f32::max) as f64 > 1e-6 * tissue.diagonal());
}

#[test]
fn the_same_script_gives_the_same_bits() {
    let (a, b) = (play(GRABBED).0, play(GRABBED).0);
    assert_eq!((a.scene.edit_hash(), a.scene.state_hash()), (b.scene.edit_hash(), b.scene.state_hash()));
    let (other, _) = play(&GRABBED.replace("0.03]", "0.031]"));
    assert_ne!(a.scene.edit_hash(), other.scene.edit_hash());
}

#[test]
fn a_resting_scene_sleeps() {
    let (_, reports) = play("model = \"beam\"\nframes = 5\n");
    assert!(reports.iter().all(|r| r.counters.particles_awake == 0 && r.edits.is_empty()));
}

/// A cut while a blade is in the tissue ends the stroke: history stays a sequence and can be taken back.
#[test]
fn a_cut_ends_a_stroke_in_progress() {
    use incise::geometry::Plane;
    use incise::scene::{EditCommand, Outcome};
    use incise::surgery::BladePose;
    let (mut scene, _) = scene("beam", 800);
    scene.pose(0.0, 0.0);
    let untouched = scene.edit_hash();
    scene.edit(EditCommand::StrokeBegin { width: 0.01 });
    for k in 0..6 {
        let tip = DVec3::new(-0.1 + 0.04 * f64::from(k), 0.02, 0.0);
        scene.edit(EditCommand::StrokePose(BladePose { t: f64::from(k) * 0.1, tip, base: tip + DVec3::Y * 0.3 }));
    }
    let reports = scene.edit(EditCommand::Cut(Plane::Equation { normal: DVec3::X, offset: 0.02 }));
    assert_eq!(reports.iter().map(|r| r.outcome).collect::<Vec<_>>(), [Outcome::Torn, Outcome::Cut]);
    scene.validate().unwrap();
    assert_eq!(scene.undo_depth(), 2);
    scene.edit(EditCommand::Undo);
    scene.edit(EditCommand::Undo);
    scene.validate().unwrap();
    assert_eq!(scene.edit_hash(), untouched);
}

#[test]
fn a_camera_that_looks_along_its_up_takes_another() {
    let up = |camera: &str| {
        let script = Script::parse(&format!("[camera]\n{camera}\n"), Path::new("s.toml")).expect("a script");
        let pose = ScriptPlayer::new(script, 0.004, CAMERA).frame(0).camera.expect("a camera");
        assert!((pose.target - pose.eye).cross(pose.up).length() > 1e-3, "{camera}: {pose:?}");
        pose.up
    };
    assert_eq!(up("eye = [0, 1, 0]\ntarget = [0, 0, 0]"), DVec3::NEG_Z);
    assert_eq!(up("eye = [0, 0, 2]\ntarget = [0, 0, 0]\nup = [0, 0, 1]"), DVec3::Y);
    assert_eq!(up("eye = [0, 1, 0.1]\ntarget = [0, 0, 0]"), DVec3::Y, "a usual one keeps its own");
}

/// A ball that has come all the way by its first frame pushes the tissue as one does that takes its time.
#[test]
fn a_fast_poke_does_not_begin_inside_the_tissue() {
    let pushed = |seconds: f64| {
        let (scene, _) = scene("sphere", 2_000);
        let (app, _) = play_on(
            scene,
            &format!(
                "model = \"sphere\"\nframes = 60\nstep = 0.0222\n[[action]]\nkind = \"poke\"\nat = 0.1\nradius = 0.12\nuntil = 3.0\n\
                 path = [ {{ t = 0, at = [0.0, 0.1, 1.0] }}, {{ t = {seconds}, at = [0.0, 0.1, 0.3] }} ]\n"
            ),
        );
        let tissue = app.scene.tissues().next().unwrap().1;
        tissue.layer().unwrap().displacements().iter().map(|u| u.length()).fold(0.0, f64::max)
    };
    let (slow, fast) = (pushed(0.5), pushed(0.005));
    assert!(slow > 0.05 && (fast - slow).abs() < 0.4 * slow, "{slow} slowly, {fast} fast");
}
