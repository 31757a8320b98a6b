//! `incise desktop`, and plain `incise` where there is a display.

use super::CliError;
use super::common::{export, live_model, write_file};
use super::headless::{frame_json, parse_size};
use super::report_json;
use crate::config::Config;
use crate::host::desktop::{DesktopError, DesktopRun, Request, Setup, StrokeNote, run};
use clap::Args;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// The model of a window that is told none.
const FIRST: &str = "heart";

/// Arguments.
#[derive(Args)]
pub struct Desktop {
    /// A .glb, .gltf, .obj or .stl file, or a bundled name (default: heart).
    model: Option<String>,
    /// Size of the window, points.
    #[arg(long, value_name = "WxH", value_parser = parse_size, default_value = "1280x800")]
    size: (u32, u32),
    /// Write what was done, frame by frame, when the window is closed.
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
}

impl Desktop {
    /// What plain `incise` opens.
    pub fn plain() -> Self {
        Self { model: None, size: (1280, 800), report: None }
    }

    pub fn run(self, config: &Config, file: Option<&Path>, allocations: fn() -> u64) -> Result<(), CliError> {
        self.open(config, file, allocations)?.map_err(CliError::run)
    }

    /// The inner error is that there is no window to be had, before anything was done.
    pub fn open(
        self,
        config: &Config,
        file: Option<&Path>,
        allocations: fn() -> u64,
    ) -> Result<Result<(), DesktopError>, CliError> {
        let started = Instant::now();
        let model = self.model.unwrap_or_else(|| FIRST.into());
        let first = live_model(&Request { model, config: config.clone(), spacing: None }, &|_, _| {})?;
        let setup = Setup {
            config: config.clone(),
            config_file: file.map_or_else(|| "config.toml".into(), Path::to_path_buf),
            load: Arc::new(|request, tell| live_model(request, tell).map_err(CliError::into_message)),
            export,
            started,
            record: self.report.is_some(),
            size: self.size,
            allocations,
        };
        let done = match run(setup, first) {
            Ok(done) => done,
            Err(why) => return Ok(Err(why)),
        };
        if let Some(path) = &self.report {
            write_file(path, format!("{:#}\n", report(&done)).as_bytes())?;
        }
        Ok(Ok(()))
    }
}

fn report(done: &DesktopRun) -> Value {
    let frames = done.frames.iter().map(|note| {
        let mut value = frame_json(&note.report);
        value["at"] = json!(note.at_s);
        value
    });
    let stroke = |stroke: &StrokeNote| {
        let sample = |s: &crate::host::desktop::StrokeSample| json!({ "pixel": s.pixel, "rest": s.rest.to_array(), "lip_distance": s.lip_distance });
        json!({
            "frame": stroke.frame,
            "inserted": stroke.inserted,
            "stray": stroke.stray,
            "samples": stroke.samples.iter().map(sample).collect::<Vec<_>>(),
        })
    };
    json!({
        "adapter": done.adapter,
        "seconds": done.seconds,
        "model": done.model,
        "edit_hash": format!("{:016x}", done.edit_hash),
        "state_hash": format!("{:016x}", done.state_hash),
        "edits": report_json::edits(done.frames.iter().map(|note| &note.report)),
        "strokes": done.strokes.iter().map(stroke).collect::<Vec<_>>(),
        "errors": { "gpu_vs_cpu_max": done.gpu_error },
        "frames": frames.collect::<Vec<_>>(),
    })
}
