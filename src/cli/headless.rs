//! `incise headless`, and the demo of plain `incise`.

use super::CliError;
use super::common::{
    NO_WALLS, PoseArgs, check_particles, check_width, diagonal, find_animation, live_scene, load, particle_settings, print_line,
    tissue_settings, warn_of_leftovers, write_file,
};
use super::report_json;
use crate::app::{App, FrameReport};
use crate::config::Config;
use crate::formats::Model;
use crate::gpu::{Bounds, Camera, GpuError};
use crate::host::headless::{HeadlessTarget, run};
use crate::input::{ActionKind, CameraPose, Script, ScriptPlayer};
use crate::physics::FARTHEST;
use crate::scene::{Scene, SceneSettings};
use crate::surgery::WallMode;
use crate::surgery::blade_path::LEAST_DISTANCE;
use crate::tissue::Tissue;
use clap::Args;
use glam::DVec3;
use serde_json::{Value, json};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

const DEMO: &str = include_str!("../../assets/scripts/demo.toml");

/// Arguments.
#[derive(Args)]
pub struct Headless {
    /// A .glb, .gltf, .obj or .stl file, or a bundled name (default: the script's).
    model: Option<String>,
    /// Script to play.
    #[arg(long, value_name = "S.toml")]
    script: Option<PathBuf>,
    /// Animation to play (default: the script's).
    #[arg(long, value_name = "NAME")]
    animation: Option<String>,
    /// Seed of the particle sampling (default: the script's).
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    seed: Option<u64>,
    /// Number of frames (default: the script's; without a script 1 s of the animation, or 1 frame at rest).
    #[arg(long, value_name = "N", allow_negative_numbers = true,
        value_parser = clap::value_parser!(u32).range(1..=i64::from(Script::MOST_FRAMES)))]
    frames: Option<u32>,
    /// Size of the pictures, pixels (default: the configuration's, 640x480).
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<(u32, u32)>,
    /// Folder for frame-0000.png, ... and report.json.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[arg(skip)]
    demo: bool,
}

impl Headless {
    /// What plain `incise` does: the bundled demo script into `out/`.
    pub fn demo() -> Self {
        Self { model: None, script: None, animation: None, seed: None, frames: None, size: None, out: "out".into(), demo: true }
    }

    pub fn run(mut self, config: &Config, allocations: fn() -> u64) -> Result<(), CliError> {
        let mut script = self.read_script()?;
        let rests = self.script.is_none() && !self.demo && self.animation.is_none();
        script.frames = self.frames.or(script.frames).or(rests.then_some(1));
        script.seed = self.seed.unwrap_or(script.seed);
        let (model, name) = self.read_model(&script)?;
        self.animation = self.animation.take().or(script.animation.take());
        let size = self.size.unwrap_or((config.render.width, config.render.height));
        let pose = PoseArgs { animation: self.animation.clone(), time: 0.0 };
        let animation = find_animation(&model.rig, &pose)?;
        let (mut scene, width) = make_scene(model, &script, config)?;
        scene.set_animation(animation);
        scene.pose(0.0, 0.0);
        let mut app = App::new(scene, script.speed, allocations);
        let camera = default_camera(&app, &script, size);
        let mut target = HeadlessTarget::new(size, camera).map_err(CliError::run)?;
        // where the report cannot be written no picture need be drawn
        self.write_report("")?;
        let default = CameraPose { eye: camera.eye, target: camera.target, up: camera.up, fov_y: camera.fov_y };
        let reports = self.play(&mut app, &mut target, ScriptPlayer::new(script, width, default))?;
        self.write_report(&format!("{:#}\n", self.report(&app, &target, &reports)?))?;
        warn_of_leftovers(&self.out, frame_name, reports.len());
        print_line(&format!("{name}: {} frame(s) and report.json in {}", reports.len(), self.out.display()));
        Ok(())
    }

    fn read_script(&self) -> Result<Script, CliError> {
        match &self.script {
            Some(path) => Script::load_for(path, self.frames).map_err(CliError::input),
            None if self.demo => Script::parse(DEMO, Path::new("demo.toml")).map_err(CliError::input),
            None => Ok(Script::default()),
        }
    }

    /// The command line's model wins; the script's is a bundled name or a path relative to the script.
    fn read_model(&self, script: &Script) -> Result<(Model, String), CliError> {
        if let Some(name) = &self.model {
            return Ok((load(name)?, name.clone()));
        }
        let Some(name) = &script.model else {
            return Err(CliError::Input("no model: give one, or a --script that names one".into()));
        };
        if crate::formats::BUNDLED.contains(&name.as_str()) {
            return Ok((load(name)?, name.clone()));
        }
        let path = script.resolve(name).display().to_string();
        Ok((load(&path)?, path))
    }

    fn play(&self, app: &mut App, target: &mut HeadlessTarget, mut player: ScriptPlayer) -> Result<Vec<FrameReport>, CliError> {
        let frames = player.frames();
        let bar = if std::io::stderr().is_terminal() {
            indicatif::ProgressBar::new(frames as u64)
        } else {
            indicatif::ProgressBar::hidden()
        };
        let size = target.size();
        let reports = run(
            app,
            target,
            frames,
            |frame| player.frame(frame),
            |frame, _, target| {
                bar.inc(1);
                write_png(&self.out.join(frame_name(frame)), target.pixels(), size)
            },
        )?;
        bar.finish_and_clear();
        Ok(reports)
    }

    fn report(&self, app: &App, target: &HeadlessTarget, reports: &[FrameReport]) -> Result<Value, CliError> {
        Ok(json!({
            "adapter": target.adapter_name(),
            "edit_hash": format!("{:016x}", app.scene.edit_hash()),
            "state_hash": format!("{:016x}", app.scene.state_hash()),
            "edits": report_json::edits(reports.iter()),
            "errors": { "gpu_vs_cpu_max": target.gpu_error(app).map_err(CliError::run)? },
            "frames": reports.iter().map(frame_json).collect::<Vec<_>>(),
        }))
    }

    fn write_report(&self, text: &str) -> Result<(), CliError> {
        write_file(&self.out.join("report.json"), text.as_bytes())
    }
}

impl From<GpuError> for CliError {
    fn from(error: GpuError) -> Self {
        CliError::run(error)
    }
}

fn frame_name(frame: usize) -> String {
    format!("frame-{frame:04}.png")
}

/// The scene of a script, and the width of its tears in metres.
fn make_scene(model: Model, script: &Script, config: &Config) -> Result<(Scene, f64), CliError> {
    let diagonal = diagonal(&model);
    let width = script.tear.width.unwrap_or(config.tear.width * diagonal);
    let tears = script.actions.iter().any(|a| matches!(a.kind, ActionKind::Tear { .. }));
    let in_script = |why: String| CliError::Input(format!("{}: [tear] {why}", script.origin.display()));
    if tears {
        check_width(width, diagonal).map_err(|why| in_script(format!("width = {width}: {why}")))?;
        if width == 0.0 && script.tear.wall.unwrap_or(config.tear.wall) == WallMode::Closed {
            return Err(in_script(format!("wall = \"closed\" with width = 0: {NO_WALLS}")));
        }
    }
    for action in &script.actions {
        if let ActionKind::Poke { radius, .. } | ActionKind::Squeeze { radius, .. } = action.kind
            && radius > FARTHEST * diagonal
        {
            return Err(CliError::Input(format!(
                "{}, line {}: radius = {radius:e} is more than {FARTHEST} times the model's diagonal, {diagonal:.4e} m",
                script.origin.display(),
                action.line
            )));
        }
    }
    let mut particles = particle_settings(&model, config, &script.particles, script.seed)?;
    particles.wound.gap = script.tear.gap.unwrap_or(particles.wound.gap);
    check_particles(&particles)?;
    let mut settings = tissue_settings(config, Some(particles));
    settings.opening_s = script.tear.opening_time.unwrap_or(settings.opening_s);
    let network = &mut settings.network;
    network.frequency_hz = script.particles.frequency.unwrap_or(network.frequency_hz);
    network.damping_ratio = script.particles.damping.unwrap_or(network.damping_ratio);
    network.coupling = script.particles.coupling.unwrap_or(network.coupling);
    let tissue = Tissue::new(model, &settings).map_err(CliError::input)?;
    if let Some(distance) = script.tear.sample_distance.filter(|d| *d < LEAST_DISTANCE * diagonal) {
        return Err(in_script(format!(
            "sample_distance = {distance} is less than {LEAST_DISTANCE} of the model's diagonal of {diagonal} m: tears would take hours"
        )));
    }
    let scene = SceneSettings {
        sampling: config.sampling,
        sample_distance: script.tear.sample_distance,
        sample_time: script.tear.sample_time,
    };
    Ok((live_scene(tissue, scene, script.tear.wall.unwrap_or(config.tear.wall), config), width))
}

/// A frame, all keys of the report.
pub(super) fn frame_json(report: &FrameReport) -> serde_json::Value {
    let stage = |name: &str| report.stages.get(name);
    json!({
        "time": report.time_s,
        "stages_ms": {
            "tools": stage("tools"), "edit": stage("edit"), "pose": stage("pose"), "physics": stage("physics"),
            "upload": stage("upload"), "deform": stage("deform"), "draw": stage("draw"), "total": report.stages.total(),
        },
        "counters": {
            "dispatches": report.counters.dispatches,
            "draws": report.counters.draws,
            "bytes_uploaded": report.counters.bytes_uploaded,
            "faces_visited": report.counters.faces_visited,
            "particles_awake": report.counters.particles_awake,
            "quarantined": report.counters.quarantined,
            "allocations": report.counters.allocations,
        },
    })
}

/// Frames the model from the front.
fn default_camera(app: &App, script: &Script, size: (u32, u32)) -> Camera {
    let (min, max) = app.scene.bounds();
    let aspect = f64::from(size.0) / f64::from(size.1);
    Camera::framing(Bounds { min, max }, DVec3::new(0.25, 0.35, 1.0), script.camera.up, script.camera.fov_y, aspect)
}

fn write_png(path: &Path, pixels: &[u8], (width, height): (u32, u32)) -> Result<(), CliError> {
    image::save_buffer(path, pixels, width, height, image::ColorType::Rgba8)
        .map_err(|e| CliError::Run(format!("cannot write {}: {e}", path.display())))
}

pub(super) fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let side = |text: &str| text.parse::<u32>().ok().filter(|n| (1..=8192).contains(n));
    text.split_once(['x', 'X'])
        .and_then(|(w, h)| Some((side(w)?, side(h)?)))
        .ok_or_else(|| "give WIDTHxHEIGHT in pixels, each 1 to 8192, for example 640x480".into())
}
