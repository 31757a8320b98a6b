//! The pictures of the documentation, 1600 x 1200, from the bundled models: `cargo test --test gpu_gallery -- --ignored` draws
//! them anew into docs/images. Look at them before you keep them.
#![cfg(feature = "gpu")]

mod gpu_support;

use glam::{DQuat, DVec3};
use gpu_support::context;
use incise::app::{App, FrameCounters, FrameTarget, FrameView};
use incise::diagnostics::Stages;
use incise::formats;
use incise::geometry::Plane;
use incise::gpu::{Camera, DrawOptions, GpuError, Instrument, Tool};
use incise::host::mirror::Mirror;
use incise::input::{InputFrame, Layer};
use incise::particles::ParticleSettings;
use incise::physics::{NetworkSettings, RigidPose};
use incise::scene::{EditCommand, Scene, SceneSettings};
use incise::surgery::{BladePose, SamplingSettings, WallMode};
use incise::tissue::{Tissue, TissueSettings};

const SIZE: (u32, u32) = (1600, 1200);

/// Keeps up with the scene and draws when it is asked to.
struct Gallery {
    mirror: Mirror,
    camera: Camera,
    instruments: Vec<Instrument>,
    shot: Option<&'static str>,
}

impl FrameTarget for Gallery {
    type Error = GpuError;

    fn present(&mut self, view: &FrameView, _: &mut Stages, _: &mut FrameCounters) -> Result<(), GpuError> {
        self.mirror.sync(view)?;
        if let Some(name) = self.shot.take() {
            let lines = self.mirror.layer_lines(view);
            let options = DrawOptions { lines: &lines, instruments: &self.instruments, ..Default::default() };
            let pixels = self.mirror.renderer_mut().render_to_image(&self.camera, SIZE, &options)?;
            let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/images");
            let path = folder.join(format!("{name}.png"));
            image::save_buffer(path, &pixels, SIZE.0, SIZE.1, image::ExtendedColorType::Rgba8).expect("writable");
        }
        Ok(())
    }
}

fn app(name: &str, animation: Option<usize>) -> App {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(format!("{name}.glb"));
    std::fs::write(&path, formats::generate(name, None).expect("bundled")).expect("writable");
    let model = formats::load(path.to_str().expect("UTF-8")).expect("loads");
    let rest: Vec<_> = (0..model.rows.len()).map(|v| model.rows.rest(incise::geometry::VertexId::new(v))).collect();
    let settings = TissueSettings {
        particles: Some(ParticleSettings::for_model(&model.mesh, &rest)),
        network: NetworkSettings::SOFT,
        opening_s: 0.4,
        section_faces: 64,
        fade_s: 0.25,
    };
    let tissue = Tissue::new(model, &settings).expect("a tissue");
    let tools = SceneSettings { sampling: SamplingSettings::default(), sample_distance: None, sample_time: None };
    let mut scene = Scene::new(tissue, tools);
    scene.set_animation(animation);
    App::new(scene, 1.0, || 0)
}

fn play(
    app: &mut App,
    gallery: &mut Gallery,
    frames: usize,
    mut commands: Vec<EditCommand>,
    show: &[(Layer, bool)],
    shot: &'static str,
) {
    for frame in 0..frames {
        if frame + 1 == frames {
            gallery.shot = Some(shot);
        }
        let input = InputFrame {
            time_s: frame as f64 / 60.0,
            step_s: 1.0 / 60.0,
            commands: std::mem::take(&mut commands),
            show: show.to_vec(),
            camera: None,
        };
        app.frame(&input, gallery).expect("a frame");
    }
}

fn tear(width: f64, path: &[([f64; 3], [f64; 3])]) -> Vec<EditCommand> {
    let mut commands = vec![EditCommand::StrokeBegin { width }];
    for (k, (tip, base)) in path.iter().enumerate() {
        let (tip, base) = (DVec3::from_array(*tip), DVec3::from_array(*base));
        commands.push(EditCommand::StrokePose(BladePose { t: 0.2 * k as f64, tip, base }));
    }
    commands.push(EditCommand::StrokeEnd);
    commands
}

/// Down the front in a bow, as a hand draws it.
fn heart_wound() -> Vec<EditCommand> {
    let pose = |k: u32| {
        let s = f64::from(k) / 24.0;
        let (x, y) = (0.010 + 0.006 * s - 0.020 * s * s, 0.034 - 0.053 * s);
        ([x, y, 0.020 - 0.008 * s * (1.0 - s)], [x - 0.0005, 1.25 * y, 0.140])
    };
    tear(0.0004, &(0..25).map(pose).collect::<Vec<_>>())
}

/// A scalpel that lies on the tray: `at` is its tip.
fn lying(at: DVec3, towards: DVec3) -> Instrument {
    Instrument::scalpel(at, at + towards, DVec3::new(1.0, 0.0, 0.3), 1.0)
}

#[test]
#[ignore = "draws the documentation's pictures"]
fn heart() {
    let camera = Camera { eye: DVec3::new(0.10, 0.15, 0.30), target: DVec3::new(0.0, -0.018, 0.01), up: DVec3::Y, fov_y: 0.62 };
    let mut gallery = Gallery { mirror: Mirror::new(context()), camera, instruments: Vec::new(), shot: None };
    let mut torn = app("heart", None);
    torn.scene.set_wall(WallMode::Closed);
    let mut forceps = Instrument::scalpel(DVec3::new(0.019, 0.008, 0.047), DVec3::new(0.10, 0.10, 0.10), DVec3::X, 1.0);
    forceps.tool = Tool::Forceps { opening: 0.004 };
    gallery.instruments = vec![lying(DVec3::new(-0.130, -0.0555, 0.005), DVec3::new(0.08, 0.002, 0.065)), forceps];
    play(&mut torn, &mut gallery, 70, heart_wound(), &[], "heart");
    gallery.instruments.clear();
    gallery.camera = Camera { eye: DVec3::new(0.045, 0.045, 0.135), target: DVec3::new(0.004, 0.006, 0.03), ..camera };
    play(&mut torn, &mut gallery, 1, Vec::new(), &[], "heart-wound");
    gallery.camera = Camera { eye: DVec3::new(0.07, 0.09, 0.22), target: DVec3::ZERO, ..camera };
    play(&mut torn, &mut gallery, 1, Vec::new(), &[(Layer::Particles, true)], "particles");
    let mut cut = app("heart", None);
    let mut gallery = Gallery { mirror: Mirror::new(context()), camera: gallery.camera, instruments: Vec::new(), shot: None };
    let plane = Plane::Equation { normal: DVec3::new(0.25, 0.9, 0.35), offset: 0.012 };
    play(&mut cut, &mut gallery, 8, vec![EditCommand::CutClosed(plane)], &[], "heart-cut");
    // The upper part is laid aside, so that both faces of the cut show.
    let upper = cut.scene.tissues().max_by(|a, b| a.1.bounds().1.y.total_cmp(&b.1.bounds().1.y)).expect("a piece").0;
    let pose = RigidPose { translation: DVec3::new(0.085, -0.03, 0.035), rotation: DQuat::from_rotation_z(-2.1) };
    cut.scene.tissue_mut(upper).expect("the piece").set_frame(pose);
    gallery.camera = Camera { eye: DVec3::new(0.07, 0.17, 0.22), target: DVec3::new(0.035, -0.02, 0.0), ..camera };
    play(&mut cut, &mut gallery, 1, Vec::new(), &[], "heart-cut");
}

#[test]
#[ignore = "draws the documentation's pictures"]
fn beam() {
    let camera = Camera { eye: DVec3::new(0.28, 0.36, 0.52), target: DVec3::new(0.0, 0.0, 0.0), up: DVec3::Y, fov_y: 0.72 };
    let mut gallery = Gallery { mirror: Mirror::new(context()), camera, instruments: Vec::new(), shot: None };
    let mut app = app("beam", Some(0));
    app.scene.set_wall(WallMode::Closed);
    let path: Vec<([f64; 3], [f64; 3])> = (0..6)
        .map(|k| {
            let z = 0.075 - 0.03 * f64::from(k);
            ([0.008 * f64::from(k) - 0.02, 0.015, z], [0.008 * f64::from(k) - 0.02, 0.25, z])
        })
        .collect();
    let mut commands = tear(0.0015, &path);
    commands.push(EditCommand::CutClosed(Plane::Equation { normal: DVec3::new(1.0, 0.15, 0.1), offset: 0.12 }));
    play(&mut app, &mut gallery, 60, commands, &[], "beam");
    let end = app.scene.tissues().max_by(|a, b| a.1.bounds().1.x.total_cmp(&b.1.bounds().1.x)).expect("a piece").0;
    let pose = RigidPose { translation: DVec3::new(0.045, -0.02, 0.0), rotation: DQuat::from_rotation_y(-0.35) };
    app.scene.tissue_mut(end).expect("the piece").set_frame(pose);
    play(&mut app, &mut gallery, 1, Vec::new(), &[], "beam");
}

#[test]
#[ignore = "draws the documentation's pictures"]
fn sphere() {
    let camera = Camera { eye: DVec3::new(0.8, 1.5, 2.4), target: DVec3::new(0.36, -0.14, 0.1), up: DVec3::Y, fov_y: 0.62 };
    let mut gallery = Gallery { mirror: Mirror::new(context()), camera, instruments: Vec::new(), shot: None };
    let mut app = app("sphere", None);
    app.scene.set_wall(WallMode::Closed);
    let path: Vec<([f64; 3], [f64; 3])> = (0..9)
        .map(|k| {
            let turn = 0.9 - 0.26 * f64::from(k);
            let at = |r: f64| [r * turn.sin(), 0.05 * r * (1.0 - turn * turn), r * turn.cos()];
            (at(0.34), at(0.9))
        })
        .collect();
    let mut commands = tear(0.003, &path);
    commands.push(EditCommand::CutClosed(Plane::Equation { normal: DVec3::new(0.25, 1.0, -0.1), offset: 0.25 }));
    play(&mut app, &mut gallery, 30, commands, &[], "sphere");
    let lid = app.scene.tissues().max_by(|a, b| a.1.bounds().1.y.total_cmp(&b.1.bounds().1.y)).expect("a piece").0;
    let pose = RigidPose { translation: DVec3::new(0.98, -0.30, 0.15), rotation: DQuat::from_rotation_z(-2.3) };
    app.scene.tissue_mut(lid).expect("the piece").set_frame(pose);
    play(&mut app, &mut gallery, 1, Vec::new(), &[], "sphere");
}
