//! `incise vr`: a headset and two hands.

use super::CliError;
use super::common::{
    PoseArgs, export, find_animation, live_model, live_scene, load, make_folder, particle_settings, print_line, scene_glb,
    tissue_settings, write_file,
};
use super::report_json;
use crate::app::App;
use crate::config::Config;
use crate::gpu::{Context, ContextOptions, DrawOptions, GpuError};
use crate::host::vr::space::Placement;
use crate::host::vr::{EyePictures, FrameNote, VrOptions, VrOutcome, run, scenery};
use crate::input::ParticleOverrides;
use crate::scene::{Scene, SceneSettings};
use crate::tissue::Tissue;
use clap::Args;
use glam::DVec3;
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Arguments.
#[derive(Args)]
pub struct Vr {
    /// A .glb, .gltf, .obj or .stl file, or a bundled name.
    #[arg(default_value = "heart")]
    model: String,
    /// Animation to play (default: the model's first; "none" for the rest pose).
    #[arg(long, value_name = "NAME")]
    animation: Option<String>,
    /// Seed of the particle sampling.
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true)]
    seed: u64,
    /// Leave after so many frames.
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
    /// Folder for report.json and, after a failure, for the rescued model (default: no report; rescue in the current folder).
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Address of a test driver that leads the run.
    #[arg(long, value_name = "ADDRESS", hide = true)]
    lockstep: Option<SocketAddr>,
}

impl Vr {
    /// What plain `incise` does with a headset.
    pub fn plain() -> Self {
        Self { model: "heart".into(), animation: None, seed: 1, frames: None, out: None, lockstep: None }
    }

    pub fn run(self, config: &Config, file: Option<&Path>, allocations: fn() -> u64) -> Result<(), CliError> {
        self.open(config, file, allocations)?.map_err(CliError::Run)
    }

    /// [`Vr::run`]. The inner error, a sentence: there is no headset that a picture could be shown in, and nothing was begun.
    pub fn open(self, config: &Config, file: Option<&Path>, allocations: fn() -> u64) -> Result<Result<(), String>, CliError> {
        let scene = self.make_scene(config)?;
        let mut app = App::new(scene, 1.0, allocations);
        let options = VrOptions {
            config: config.clone(),
            config_file: file.map_or_else(|| "config.toml".into(), Path::to_path_buf),
            load: Some(Arc::new(|request, tell| live_model(request, tell).map_err(CliError::into_message))),
            export: Some(export),
            allocations,
            model: self.model.clone(),
            frames: self.frames,
            lockstep: self.lockstep,
            keep_reports: self.out.is_some(),
        };
        let mut outcome = VrOutcome::default();
        let result = run(&mut app, &options, &mut outcome);
        let changed = app.scene.undo_depth() > 0;
        if let Err(error) = result {
            if outcome.drawn + outcome.undrawn + outcome.rested == 0 {
                return Ok(Err(error.to_string()));
            }
            return Err(CliError::Run(if changed { self.rescue(&app.scene, &error.to_string()) } else { error.to_string() }));
        }
        if outcome.ended_by_runtime && changed {
            tracing::warn!("{}", self.rescue(&app.scene, "the OpenXR runtime ended the session"));
        }
        if let Some(folder) = &self.out {
            make_folder(folder)?;
            let eyes = outcome.pictures.as_ref().map(|p| write_eyes(folder, &app, p, &outcome)).transpose()?;
            write_file(&folder.join("report.json"), format!("{:#}\n", report(&app, &outcome, eyes)).as_bytes())?;
        }
        print_line(&format!("{} frames on {} ({})", outcome.drawn, outcome.headset, outcome.runtime));
        Ok(Ok(()))
    }

    fn make_scene(&self, config: &Config) -> Result<Scene, CliError> {
        let model = load(&self.model)?;
        let first = model.rig.animations.first().map(|a| a.name.clone());
        let animation = self.animation.clone().or(first).filter(|name| name != "none");
        let animation = find_animation(&model.rig, &PoseArgs { animation, time: 0.0 })?;
        let particles = particle_settings(&model, config, &ParticleOverrides::default(), self.seed)?;
        let tissue = Tissue::new(model, &tissue_settings(config, Some(particles))).map_err(CliError::input)?;
        let tools = SceneSettings { sampling: config.sampling, sample_distance: None, sample_time: None };
        let mut scene = live_scene(tissue, tools, config.tear.wall, config);
        scene.set_animation(animation);
        scene.set_measuring(false); // frames wait for its edits
        scene.pose(0.0, 0.0);
        Ok(scene)
    }

    /// Keeps the work of a session that broke off, beside what was kept before; returns what to tell the user.
    fn rescue(&self, scene: &Scene, error: &str) -> String {
        let folder = self.out.clone().unwrap_or_default();
        let names = (2..).map(|n| format!("incise-rescued-{n}.glb"));
        let mut files = std::iter::once("incise-rescued.glb".to_string()).chain(names).map(|name| folder.join(name));
        let file = files.find(|file| !file.exists()).expect("names without end");
        let saved = scene_glb(scene).and_then(|(bytes, _)| write_file(&file, &bytes));
        match saved {
            Ok(()) => format!("{error}. Your work is kept in {}", file.display()),
            Err(CliError::Run(why) | CliError::Input(why)) => format!("{error}. Your work could not be kept: {why}"),
        }
    }
}

/// Writes both eyes, and beside them what a device of our own makes of the same scene from the same views. Returns how much they
/// differ: the mean and the share of pixels that differ by more than 8 of 255.
fn write_eyes(folder: &Path, app: &App, pictures: &EyePictures, outcome: &VrOutcome) -> Result<Value, CliError> {
    let twins = headless_twins(app, pictures, outcome).map_err(CliError::run)?;
    let mut eyes = Vec::new();
    for (eye, (seen, twin)) in pictures.eyes.iter().zip(&twins).enumerate() {
        write_png(&folder.join(format!("eye-{eye}.png")), seen, pictures.size)?;
        write_png(&folder.join(format!("headless-{eye}.png")), twin, pictures.size)?;
        let differences = seen.iter().zip(twin).map(|(a, b)| a.abs_diff(*b));
        let mean = differences.clone().map(f64::from).sum::<f64>() / seen.len().max(1) as f64;
        let far = differences.filter(|&d| d > 8).count() as f64 / seen.len().max(1) as f64;
        let (width, height) = pictures.size;
        eyes.push(json!({ "mean_difference": mean, "share_above_8": far, "size": [width, height] }));
    }
    Ok(Value::Array(eyes))
}

/// The same scene, from the same views, one after the other, on a device that has seen none of its history.
fn headless_twins(app: &App, pictures: &EyePictures, outcome: &VrOutcome) -> Result<Vec<Vec<u8>>, GpuError> {
    let context = Arc::new(Context::headless(ContextOptions::default())?);
    let mut mirror = crate::host::mirror::Mirror::new(context);
    mirror.sync(&app.view())?;
    let scenery = scenery(&app.scene);
    let mut twins = Vec::new();
    for (eye, view) in pictures.views.iter().enumerate() {
        mirror.renderer_mut().set_visibility_masks(pictures.masks.get(eye..=eye).unwrap_or_default());
        let options = DrawOptions {
            lines: &outcome.lines,
            instruments: &outcome.instruments,
            scenery,
            masked: !pictures.masks.is_empty(),
            ..DrawOptions::default()
        };
        mirror.renderer_mut().draw_views(&[*view], pictures.size, &options)?;
        twins.push(mirror.renderer().read_picture(0)?);
    }
    Ok(twins)
}

fn write_png(path: &Path, pixels: &[u8], (width, height): (u32, u32)) -> Result<(), CliError> {
    image::save_buffer(path, pixels, width, height, image::ColorType::Rgba8)
        .map_err(|e| CliError::Run(format!("cannot write {}: {e}", path.display())))
}

fn report(app: &App, outcome: &VrOutcome, eyes: Option<Value>) -> Value {
    let points = |points: &[DVec3]| points.iter().map(|p| json!(p.to_array())).collect::<Vec<_>>();
    let middles: Vec<DVec3> = app.scene.last_tear_boxes().iter().map(|b| b.corners().iter().sum::<DVec3>() / 8.0).collect();
    let stands = |p: &Placement| json!({ "position": p.position.to_array(), "yaw": p.yaw, "scale": p.scale });
    let hex = |hash: u64| format!("{hash:016x}");
    let frame = |note: &FrameNote| {
        let FrameNote { report, gpu, commands, core_ms, allocations, displaced, focused, faces, panel, .. } = note;
        json!({
            "time": report.time_s,
            "stages_ms": report_json::stages(&report.stages),
            "gpu_ms": report_json::stages(gpu),
            "core_ms": core_ms,
            "dispatches": report.counters.dispatches,
            "draws": report.counters.draws,
            "bytes_uploaded": report.counters.bytes_uploaded,
            "particles_awake": report.counters.particles_awake,
            "allocations": allocations,
            "commands": commands,
            "displaced": displaced,
            "pipelines": report.counters.pipelines,
            "focused": focused,
            "placement": note.placement.as_ref().map(stands),
            "faces": faces,
            "edit_hash": note.edit_hash.map(hex),
            "panel": { "draws": panel.draws, "bytes_uploaded": panel.bytes_uploaded },
        })
    };
    json!({
        "runtime": outcome.runtime,
        "headset": outcome.headset,
        "adapter": outcome.adapter,
        "space": outcome.space,
        "refresh_hz": outcome.refresh_hz,
        "multiview": outcome.multiview,
        "depth": outcome.depth,
        "eye_size": [outcome.eye_size.0, outcome.eye_size.1],
        "least_resolution": outcome.least_resolution,
        "drawn": outcome.drawn,
        "undrawn": outcome.undrawn,
        "rested": outcome.rested,
        "nonsense_periods": outcome.nonsense_periods,
        "pulses": outcome.pulses.iter().flatten().sum::<u64>(),
        "pulses_by_cause": outcome.pulses.map(|[contact, segments, severed]| {
            json!({ "contact": contact, "segments": segments, "severed": severed })
        }),
        "recreated": outcome.recreated,
        "mirrored": outcome.mirrored,
        "placement": outcome.placement.as_ref().map(stands),
        "eyes": eyes,
        "tips": points(&outcome.tips),
        "last_boxes": points(&middles),
        "edit_hash": hex(app.scene.edit_hash()),
        "state_hash": hex(app.scene.state_hash()),
        "edits": report_json::edits(outcome.frames.iter().map(|note| &note.report)),
        "frames": outcome.frames.iter().map(frame).collect::<Vec<_>>(),
    })
}
