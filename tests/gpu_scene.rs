//! The picture's geometry equals the f64 reference before and after edits (MATHS 1.7), through the headless host.
#![cfg(feature = "gpu")]

mod common;

use common::models::scene;
use glam::DVec3;
use incise::app::App;
use incise::geometry::Plane;
use incise::gpu::Camera;
use incise::host::headless::HeadlessTarget;
use incise::input::InputFrame;
use incise::scene::EditCommand;
use incise::surgery::BladePose;

fn frame(app: &mut App, target: &mut HeadlessTarget, number: usize, commands: Vec<EditCommand>) -> incise::app::FrameReport {
    let input = InputFrame { time_s: number as f64 / 90.0, step_s: 1.0 / 90.0, commands, ..InputFrame::default() };
    app.frame(&input, target).unwrap()
}

#[test]
fn gpu_and_reference_agree_through_edits() {
    let camera = Camera { eye: DVec3::new(0.0, 0.3, 0.9), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.9 };
    let mut target = HeadlessTarget::new((32, 24), camera).expect("a Vulkan adapter, real or software");
    let (mut scene, _) = scene("beam", 900);
    scene.set_animation(Some(0));
    let mut app = App::new(scene, 1.0, || 0);
    let check = |app: &App, target: &HeadlessTarget, what: &str| {
        let error = target.gpu_error(app).unwrap();
        assert!(error <= 1e-6, "{what}: {error} of the diagonal");
    };
    frame(&mut app, &mut target, 0, Vec::new());
    check(&app, &target, "before");
    let mut tear = vec![EditCommand::StrokeBegin { width: 0.01 }];
    for k in 0..6 {
        let tip = DVec3::new(-0.1 + 0.04 * f64::from(k), 0.02, -0.03 + 0.01 * f64::from(k));
        tear.push(EditCommand::StrokePose(BladePose { t: f64::from(k) * 0.1, tip, base: tip + DVec3::Y * 0.3 }));
    }
    tear.push(EditCommand::StrokeEnd);
    let torn = frame(&mut app, &mut target, 1, tear);
    assert!(torn.edits[0].new_vertices > 0 && torn.counters.bytes_uploaded > 0);
    check(&app, &target, "torn");
    for number in 2..12 {
        frame(&mut app, &mut target, number, Vec::new());
    }
    check(&app, &target, "opening");
    let plane = Plane::Equation { normal: DVec3::new(1.0, 0.2, 0.1), offset: 0.05 };
    frame(&mut app, &mut target, 12, vec![EditCommand::Cut(plane)]);
    assert_eq!(app.scene.tissues().count(), 2);
    check(&app, &target, "cut");
    for (number, command) in [(13, EditCommand::Undo), (14, EditCommand::Redo), (15, EditCommand::Undo), (16, EditCommand::Undo)]
    {
        frame(&mut app, &mut target, number, vec![command]);
        check(&app, &target, "undone");
    }
    // the comparison can fail: the CPU goes on, the picture does not
    app.scene.pose(0.5, 0.5);
    assert!(target.gpu_error(&app).unwrap() > 1e-4);
}

/// While time stands still edits go on, and the picture follows: a particle that an edit puts into skin that is held aside begins there.
#[test]
fn gpu_and_reference_agree_while_time_stands_still() {
    let camera = Camera { eye: DVec3::new(0.0, 0.3, 0.9), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.9 };
    let mut target = HeadlessTarget::new((32, 24), camera).expect("a Vulkan adapter, real or software");
    let (mut scene, _) = scene("heart", 6_000);
    scene.set_animation(None);
    let mut app = App::new(scene, 1.0, || 0);
    let stroke = |y: f64, lean: f64| {
        let pose = |k: u32| {
            let tip = DVec3::new(0.004 * f64::from(k) - 0.03, y + lean * f64::from(k), 0.01);
            EditCommand::StrokePose(BladePose { t: 0.1 * f64::from(k), tip, base: tip + DVec3::Z * 0.3 })
        };
        let begin = EditCommand::StrokeBegin { width: 0.0006 };
        [begin].into_iter().chain((0..16).map(pose)).chain([EditCommand::StrokeEnd]).collect::<Vec<_>>()
    };
    frame(&mut app, &mut target, 0, stroke(0.0, 0.0));
    for number in 1..20 {
        frame(&mut app, &mut target, number, Vec::new());
    }
    let still = |commands| InputFrame { time_s: 19.0 / 90.0, step_s: 0.0, commands, ..InputFrame::default() };
    for commands in [Vec::new(), stroke(-0.01, 0.0013), Vec::new()] {
        app.frame(&still(commands), &mut target).unwrap();
        let error = target.gpu_error(&app).unwrap();
        assert!(error <= 1e-6, "{error} of the diagonal");
    }
}

#[test]
fn a_sleeping_scene_costs_nothing() {
    let camera = Camera { eye: DVec3::new(0.0, 0.3, 0.9), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.9 };
    let mut target = HeadlessTarget::new((32, 24), camera).expect("a Vulkan adapter, real or software");
    let mut app = App::new(scene("sphere", 500).0, 1.0, || 0);
    frame(&mut app, &mut target, 0, Vec::new());
    for number in 1..4 {
        let asleep = frame(&mut app, &mut target, number, Vec::new());
        assert_eq!((asleep.counters.dispatches, asleep.counters.bytes_uploaded), (0, 0));
    }
}

#[test]
fn a_lost_device_is_replaced_and_everything_goes_on() {
    let camera = Camera { eye: DVec3::new(0.0, 0.3, 0.9), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.9 };
    let play = |lose: bool| {
        let mut target = HeadlessTarget::new((64, 48), camera).expect("a Vulkan adapter, real or software");
        let mut app = App::new(scene("beam", 900).0, 1.0, || 0);
        frame(&mut app, &mut target, 0, Vec::new());
        let plane = Plane::Equation { normal: DVec3::new(1.0, 0.2, 0.1), offset: 0.05 };
        frame(&mut app, &mut target, 1, vec![EditCommand::Cut(plane)]);
        if lose {
            target.mirror().renderer().context().device().destroy();
        }
        let after = frame(&mut app, &mut target, 2, Vec::new());
        assert!(target.gpu_error(&app).unwrap() <= 1e-6);
        (after.counters.bytes_uploaded, target.pixels().to_vec())
    };
    let (usual, with_one) = play(false);
    let (anew, with_two) = play(true);
    assert!(with_one == with_two, "the picture is the same");
    assert!(anew > usual + 50_000, "everything was uploaded again: {anew} bytes");
}
