//! Golden pictures of edited scenes: wounds open and closed, a cut, a stereo pair, every inspection layer; and what a steady
//! frame allocates. Compared as in gpu_pictures.rs.
#![cfg(feature = "gpu")]

mod common;
mod gpu_support;

use common::models::scene;
use glam::{DQuat, DVec3};
use gpu_support::golden::{MOST_OFF, TOLERANCE, compare, difference, load, share_off};
use gpu_support::{context, plain_context};
use incise::app::{App, FrameCounters, FrameTarget, FrameView};
use incise::diagnostics::Stages;
use incise::geometry::{Plane, VertexId};
use incise::gpu::{Camera, Context, DrawOptions, Fov, GpuError, Instrument, Passes, Tool, ViewPose};
use incise::host::layers::error_points;
use incise::host::mirror::Mirror;
use incise::input::{InputFrame, Layer};
use incise::physics::RigidPose;
use incise::scene::EditCommand;
use incise::surgery::{BladePose, WallMode};
use std::sync::Arc;

const SIZE: (u32, u32) = (160, 120);

struct Target {
    mirror: Mirror,
    views: Vec<ViewPose>,
    instruments: Vec<Instrument>,
    pictures: Vec<Vec<u8>>,
    lines: usize,
    draws: u64,
    /// When drawing begins, seconds.
    from_s: f64,
}

impl Target {
    fn new(views: Vec<ViewPose>) -> Self {
        Self::on(context(), views)
    }

    fn on(context: Arc<Context>, views: Vec<ViewPose>) -> Self {
        Self {
            mirror: Mirror::new(context),
            views,
            instruments: Vec::new(),
            pictures: Vec::new(),
            lines: 0,
            draws: 0,
            from_s: 0.0,
        }
    }
}

impl FrameTarget for Target {
    type Error = GpuError;

    fn present(&mut self, view: &FrameView, _: &mut Stages, counters: &mut FrameCounters) -> Result<(), GpuError> {
        self.mirror.sync(view)?;
        if view.time_s < self.from_s {
            return Ok(()); // Only the last pictures are looked at.
        }
        let lines = self.mirror.layer_lines(view);
        self.lines = lines.len();
        let options = DrawOptions { lines: &lines, instruments: &self.instruments, passes: Passes::Each, ..Default::default() };
        let renderer = self.mirror.renderer_mut();
        renderer.draw_views(&self.views, SIZE, &options)?;
        self.pictures = (0..self.views.len() as u32).map(|v| renderer.read_picture(v)).collect::<Result<_, _>>()?;
        self.mirror.count(counters);
        self.draws = counters.draws;
        Ok(())
    }
}

fn eye(position: DVec3) -> ViewPose {
    let camera = Camera { eye: position, target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.75 };
    ViewPose::from_camera(&camera, f64::from(SIZE.0) / f64::from(SIZE.1)).expect("a camera")
}

fn from_above() -> Vec<ViewPose> {
    vec![eye(DVec3::new(0.22, 0.36, 0.42))]
}

fn frame(app: &mut App, target: &mut Target, number: usize, commands: Vec<EditCommand>, show: &[(Layer, bool)]) {
    let input =
        InputFrame { time_s: number as f64 / 60.0, step_s: 1.0 / 60.0, commands, show: show.to_vec(), ..InputFrame::default() };
    app.frame(&input, target).expect("a frame");
}

fn tear() -> Vec<EditCommand> {
    let mut commands = vec![EditCommand::StrokeBegin { width: 0.012 }];
    for k in 0..7 {
        let tip = DVec3::new(-0.12 + 0.04 * f64::from(k), 0.015, -0.02 + 0.006 * f64::from(k));
        commands.push(EditCommand::StrokePose(BladePose { t: 0.1 * f64::from(k), tip, base: tip + DVec3::Y * 0.3 }));
    }
    commands.push(EditCommand::StrokeEnd);
    commands
}

/// A torn beam, opened, and what the eyes see.
fn torn(wall: WallMode, views: Vec<ViewPose>) -> (App, Target) {
    torn_before(Target::new(views), wall)
}

fn torn_before(mut target: Target, wall: WallMode) -> (App, Target) {
    target.from_s = 22.5 / 60.0;
    let mut scene = scene("beam", 2400).0;
    scene.set_wall(wall);
    let mut app = App::new(scene, 1.0, || 0);
    frame(&mut app, &mut target, 0, tear(), &[]);
    for number in 1..24 {
        frame(&mut app, &mut target, number, Vec::new(), &[]);
    }
    (app, target)
}

#[test]
fn open_and_closed_wounds() {
    let (_, open) = torn(WallMode::Open, from_above());
    compare("open-wound", SIZE, &open.pictures[0]);
    let (_, closed) = torn(WallMode::Closed, from_above());
    compare("closed-wound", SIZE, &closed.pictures[0]);
    // The walls, and half of the thinnest layer, are more than a picture may be off.
    assert!(share_off(&open.pictures[0], &load("closed-wound")) > MOST_OFF, "the walls must show");
    for layer in ["boxes", "edges", "strips", "wireframe", "particles", "sections", "influences"] {
        let share = share_off(&open.pictures[0], &load(&format!("layer-{layer}")));
        assert!(share > 2.0 * MOST_OFF, "{layer}: {share}");
    }
}

/// One that has neither multiview nor storage buffers enough: the CPU deforms.
#[test]
fn wounds_caps_and_layers_look_the_same_on_a_plain_adapter() {
    let plain = plain_context();
    assert!(!plain.deforms());
    for (wall, name) in [(WallMode::Open, "open-wound"), (WallMode::Closed, "closed-wound")] {
        let (mut app, mut target) = torn_before(Target::on(plain.clone(), from_above()), wall);
        compare(name, SIZE, &target.pictures[0]);
        if wall == WallMode::Open {
            frame(&mut app, &mut target, 24, Vec::new(), &[(Layer::Edges, true)]);
            compare("layer-edges", SIZE, &target.pictures[0]);
        }
        let whole = target.pictures[0].clone();
        let plane = Plane::Equation { normal: DVec3::new(1.0, 0.1, 0.2), offset: 0.1 };
        frame(&mut app, &mut target, 25, vec![EditCommand::CutClosed(plane)], &[]);
        assert_eq!(app.scene.tissues().count(), 2);
        assert!(difference(&target.pictures[0], &whole) > 0.05, "the cut must show");
        assert!(target.mirror.gpu_error(&app.scene).expect("read back") < 1e-6);
    }
}

#[test]
fn a_cut_in_two_with_instruments() {
    let mut target = Target::new(from_above());
    let mut app = App::new(scene("beam", 2400).0, 1.0, || 0);
    let plane = Plane::Equation { normal: DVec3::new(1.0, 0.2, 0.1), offset: 0.05 };
    frame(&mut app, &mut target, 0, vec![EditCommand::Cut(plane)], &[]);
    let without = target.pictures[0].clone();
    let mut forceps = Instrument::scalpel(DVec3::new(-0.1, 0.07, 0.03), DVec3::new(-0.15, 0.2, 0.1), DVec3::X, 1.0);
    forceps.tool = Tool::Forceps { opening: 0.01 };
    let sheet = glam::DAffine3::from_scale_rotation_translation(
        DVec3::splat(0.12),
        DQuat::from_rotation_arc(DVec3::Z, DVec3::X),
        DVec3::new(0.05, 0.0, 0.0),
    );
    target.instruments = vec![
        Instrument { tool: Tool::Plane, world_from_tool: sheet, colour: [0.2, 0.7, 1.0, 0.3] },
        forceps,
        Instrument::scalpel(DVec3::new(0.05, 0.065, 0.03), DVec3::new(0.15, 0.2, 0.12), DVec3::Z, 1.0),
        Instrument { tool: Tool::Plane, world_from_tool: glam::DAffine3::from_translation(DVec3::NAN), colour: [1.0; 4] },
    ];
    let draws = target.draws;
    frame(&mut app, &mut target, 1, Vec::new(), &[]);
    compare("cut", SIZE, &target.pictures[0]);
    assert!(difference(&without, &load("cut")) > TOLERANCE, "instruments must show");
    assert_eq!(target.draws, draws + 5, "scalpel, forceps and the plane, and two shadows");
    frame(&mut app, &mut target, 2, Vec::new(), &[]);
    assert_eq!(target.draws, draws + 2, "nothing has moved: the shadows are there, the tissue's among them");
}

/// The upper part is turned aside, so that both caps show.
#[test]
fn a_cut_with_caps() {
    let cut = |command: fn(Plane) -> EditCommand| {
        let mut target = Target::new(from_above());
        let mut app = App::new(scene("heart", 3000).0, 1.0, || 0);
        target.views = vec![eye(DVec3::new(0.06, 0.14, 0.24))];
        let plane = Plane::Equation { normal: DVec3::new(0.2, 0.95, 0.25), offset: 0.005 };
        frame(&mut app, &mut target, 0, vec![command(plane)], &[]);
        let upper = app.scene.tissues().max_by(|a, b| a.1.bounds().1.y.total_cmp(&b.1.bounds().1.y)).expect("a piece").0;
        let pose = RigidPose { translation: DVec3::new(0.075, -0.02, 0.01), rotation: DQuat::from_rotation_z(-2.2) };
        app.scene.tissue_mut(upper).expect("the piece").set_frame(pose);
        frame(&mut app, &mut target, 1, Vec::new(), &[]);
        (app.scene.tissues().count(), target.pictures[0].clone())
    };
    let (pieces, capped) = cut(EditCommand::CutClosed);
    assert_eq!(pieces, 2);
    compare("capped-cut", SIZE, &capped);
    assert!(difference(&cut(EditCommand::Cut).1, &load("capped-cut")) > TOLERANCE, "the caps must show");
}

/// From so near that what is small shows: relief and the film's gleam, the lip's width and its walls, light inside a wound; and the
/// ruler on the tray.
#[test]
fn details_from_near() {
    let near = |eye: [f64; 3], target: [f64; 3]| {
        let camera = Camera { eye: eye.into(), target: target.into(), up: DVec3::Y, fov_y: 0.5 };
        ViewPose::from_camera(&camera, f64::from(SIZE.0) / f64::from(SIZE.1)).expect("a camera")
    };
    let wound = near([0.045, 0.03, 0.125], [0.004, 0.006, 0.04]);
    let ruler = near([-0.06, 0.02, 0.17], [-0.06, -0.075, 0.08]);
    for (wall, name) in [(WallMode::Open, "open-near"), (WallMode::Closed, "closed-near")] {
        let mut scene = scene("heart", 6000).0;
        scene.set_wall(wall);
        let (mut app, mut target) = (App::new(scene, 1.0, || 0), Target::new(vec![wound, ruler]));
        target.from_s = 23.5 / 60.0;
        let pose = |t: f64| {
            let at = DVec3::new(0.012 - 0.012 * t, 0.03 - 0.045 * t, 0.0);
            EditCommand::StrokePose(BladePose { t, tip: at + DVec3::Z * 0.02, base: at + DVec3::Z * 0.14 })
        };
        let stroke = [EditCommand::StrokeBegin { width: 0.003 }, pose(0.0), pose(0.5), pose(1.0), EditCommand::StrokeEnd];
        frame(&mut app, &mut target, 0, stroke.to_vec(), &[]);
        (1..25).for_each(|number| frame(&mut app, &mut target, number, Vec::new(), &[]));
        compare(name, SIZE, &target.pictures[0]);
        compare("ruler", SIZE, &target.pictures[1]);
    }
}

/// Where corners of large faces lie on lips, or near, that are no edge of them the faces are skin none the less: they were pale all over, and a
/// needle of skin that a wound had drawn wide gleamed white.
#[test]
fn a_spiral_over_large_faces() {
    let camera = Camera { eye: DVec3::new(0.3, 0.4, 1.35), target: DVec3::new(0.0, 0.0, 0.45), up: DVec3::Y, fov_y: 0.6 };
    let view = ViewPose::from_camera(&camera, f64::from(SIZE.0) / f64::from(SIZE.1)).expect("a camera");
    let mut scene = scene("sphere", 768).0;
    scene.set_wall(WallMode::Open);
    let (mut app, mut target) = (App::new(scene, 1.0, || 0), Target::new(vec![view]));
    target.from_s = 39.5 / 60.0;
    let mut commands = vec![EditCommand::StrokeBegin { width: 0.006 }];
    for k in 0..=90 {
        let turn = f64::from(k) / 90.0;
        let (sin, cos) = (2.3 * std::f64::consts::TAU * turn).sin_cos();
        let at = (0.04 + 0.24 * turn) * DVec3::new(cos, sin, 0.0);
        commands.push(EditCommand::StrokePose(BladePose { t: turn, tip: at + 0.38 * DVec3::Z, base: 1.3 * at + DVec3::Z }));
    }
    commands.push(EditCommand::StrokeEnd);
    frame(&mut app, &mut target, 0, commands, &[]);
    (1..41).for_each(|number| frame(&mut app, &mut target, number, Vec::new(), &[]));
    compare("coarse-spiral", SIZE, &target.pictures[0]);
}

#[test]
fn a_stereo_pair() {
    let view = |side: f64| ViewPose {
        position: DVec3::new(0.22 + 0.032 * side, 0.36, 0.42),
        fov: Fov { left: -0.45 - 0.04 * side, right: 0.45 - 0.04 * side, down: -0.36, up: 0.34 },
        ..from_above()[0]
    };
    let (_, target) = torn(WallMode::Open, vec![view(-1.0), view(1.0)]);
    compare("stereo-left", SIZE, &target.pictures[0]);
    compare("stereo-right", SIZE, &target.pictures[1]);
    assert!(difference(&target.pictures[1], &load("stereo-left")) > 2.0 * TOLERANCE, "the eyes differ");
}

/// Errors of the layer's whole range, made up: from a tenth of a billionth of the diagonal at one end to a hundred thousandth at
/// the other.
#[test]
fn errors_have_their_colours() {
    let (mut app, mut target) = torn(WallMode::Open, from_above());
    let picture = |target: &mut Target, app: &App, largest: f64| {
        let mut lines = Vec::new();
        for (_, tissue) in app.scene.tissues() {
            let (low, high) = tissue.bounds();
            let gpu: Vec<[f32; 3]> = (0..tissue.mesh().vertex_slots())
                .map(|v| {
                    let p = tissue.position(VertexId::new(v));
                    let along = ((p.x - low.x) / (high.x - low.x)).clamp(0.0, 1.0);
                    // downwards in steps that f32 can hold
                    let error = if along < 0.3 { 0.0 } else { largest * 10f64.powf(4.0 * (along - 1.0)) };
                    (p - DVec3::Y * error * tissue.diagonal()).as_vec3().to_array()
                })
                .collect();
            error_points(tissue, &gpu, &mut lines);
        }
        let renderer = target.mirror.renderer_mut();
        let options = DrawOptions { lines: &lines, passes: Passes::Each, ..Default::default() };
        renderer.draw_views(&target.views, SIZE, &options).expect("drawn");
        renderer.read_picture(0).expect("read")
    };
    frame(&mut app, &mut target, 24, Vec::new(), &[]);
    let small = picture(&mut target, &app, 1e-9);
    compare("layer-errors", SIZE, &picture(&mut target, &app, 1e-5));
    assert!(difference(&small, &load("layer-errors")) > TOLERANCE, "errors that are small look otherwise");
}

#[test]
fn every_inspection_layer_shows_and_costs_nothing_when_off() {
    let (mut app, mut target) = torn(WallMode::Open, from_above());
    let plain = target.pictures[0].clone();
    let (draws, mut number) = (target.draws, 24);
    let layers = [
        ("particles", Layer::Particles),
        ("wireframe", Layer::Wireframe),
        ("sections", Layer::Sections),
        ("boxes", Layer::Boxes),
        ("influences", Layer::Influences),
        ("strips", Layer::Strips),
        ("edges", Layer::Edges),
        ("errors", Layer::Errors),
    ];
    for (name, layer) in layers {
        frame(&mut app, &mut target, number, Vec::new(), &[(layer, true)]);
        assert!(target.lines > 0 && target.draws <= draws + 1, "{name}: {} lines, {} draws", target.lines, target.draws);
        if name == "errors" {
            // Rounding differs between drivers, so the colours do: only that they show. See `errors_have_their_colours`.
            assert!(difference(&plain, &target.pictures[0]) > TOLERANCE);
        } else {
            compare(&format!("layer-{name}"), SIZE, &target.pictures[0]);
            assert!(difference(&plain, &load(&format!("layer-{name}"))) > 0.15, "{name} must show");
        }
        frame(&mut app, &mut target, number + 1, Vec::new(), &[(layer, false)]);
        assert!(target.lines == 0 && target.draws <= draws, "{name} is off");
        number += 2;
    }
}
