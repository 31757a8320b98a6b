//! `incise tear`.

use super::CliError;
use super::common::{
    Format, NO_WALLS, ParticleArgs, PoseArgs, check_width, diagonal, export_pieces, load, load_path, piece_names, posed_scene,
    print_json, print_line, scene_glb, write_file,
};
use super::report_json;
use crate::config::Config;
use crate::formats::export_obj;
use crate::particles::map_json;
use crate::scene::{EditCommand, Scene};
use crate::surgery::{WallMode, write_boxes, write_slits};
use clap::Args;
use std::path::PathBuf;

/// What lines the slit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum Wall {
    /// The surface is clipped and stays open.
    #[default]
    Open,
    /// Walls and a floor: a closed model stays closed.
    Closed,
}

impl From<Wall> for WallMode {
    fn from(wall: Wall) -> Self {
        match wall {
            Wall::Open => WallMode::Open,
            Wall::Closed => WallMode::Closed,
        }
    }
}

/// Arguments.
#[derive(Args)]
pub struct Tear {
    /// A .glb, .gltf, .obj or .stl file, or a bundled name.
    model: String,
    /// JSON file with the blade's poses.
    #[arg(long, value_name = "PATH.json")]
    path: PathBuf,
    /// Width of the slit, metres; 0 opens the surface along the blade's path and takes nothing out (open walls only).
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    width: f64,
    /// Wall mode.
    #[arg(long, value_enum, default_value_t)]
    wall: Wall,
    #[command(flatten)]
    pose: PoseArgs,
    #[command(flatten)]
    particles: ParticleArgs,
    /// Leave the soft layer out.
    #[arg(long)]
    no_particles: bool,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Its format (default: what its ending says, else glb).
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// Write the tear's boxes, as OBJ: one closed object each, `chain<k>_box<i>`. With --width 0: its strips, two triangles
    /// each, `chain<k>_slit<i>`.
    #[arg(long, value_name = "FILE.obj")]
    boxes: Option<PathBuf>,
    /// Write the particle map after the tear, as JSON. Of a model that was severed, that of the piece which stays.
    #[arg(long, value_name = "FILE.json")]
    map_out: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

impl Tear {
    pub fn run(self, config: &Config) -> Result<(), CliError> {
        // before anything is read; against the model's size once that is known
        self.check_width(f64::INFINITY)?;
        if self.wall == Wall::Closed && self.width == 0.0 {
            return Err(CliError::Input(format!("--wall closed with --width 0: {NO_WALLS}")));
        }
        if self.no_particles && self.map_out.is_some() {
            return Err(CliError::Input("--map-out needs particles; leave --no-particles out".into()));
        }
        let outputs = [("--boxes", &self.boxes), ("--map-out", &self.map_out)];
        for (i, (option, file)) in outputs.iter().enumerate() {
            let Some(file) = file else { continue };
            if *file == self.out || outputs[..i].iter().any(|(_, other)| other.as_ref() == Some(file)) {
                return Err(CliError::Input(format!("{option} {}: another option writes this file", file.display())));
            }
        }
        let path = load_path(&self.path)?;
        let model = load(&self.model)?;
        self.check_width(diagonal(&model))?;
        let particles = if self.no_particles { None } else { Some(self.particles.settings(&model, config)?) };
        let mut scene = posed_scene(model, &self.pose, particles, config)?;
        scene.set_wall(self.wall.into());
        scene.edit(EditCommand::StrokeBegin { width: self.width });
        for pose in path.poses() {
            scene.edit(EditCommand::StrokePose(*pose));
        }
        let report = scene.edit(EditCommand::StrokeEnd).pop().unwrap_or_default();
        let deviation = self.write(&scene)?;
        if let Some(file) = &self.boxes {
            let mut bytes = Vec::new();
            if self.width > 0.0 {
                write_boxes(&mut bytes, scene.last_tear_boxes(), glam::DVec3::ZERO).map_err(CliError::run)?;
            } else {
                write_slits(&mut bytes, scene.last_tear_slits(), glam::DVec3::ZERO).map_err(CliError::run)?;
            }
            write_file(file, &bytes)?;
        }
        self.write_map(&scene)?;
        if self.map_out.is_some() && report.pieces.len() > 1 {
            tracing::warn!("--map-out: the map is that of the piece which stays; {} came off", report.pieces.len() - 1);
        }
        if report.unclosed_edges > 0 {
            tracing::warn!("the model is open where the blade went: {} edges of the slit got no wall", report.unclosed_edges);
        }
        if self.json {
            let mut value = report_json::edit(&report);
            value["export_deviation"] = serde_json::json!(deviation);
            print_json(&value);
            return Ok(());
        }
        print_line(&format!(
            "{}: {} segment(s), {} new vertices, {:.6e} m2 taken out, {} piece(s) in {}",
            report.outcome.as_str(),
            report.segments.len(),
            report.new_vertices,
            report.area_removed,
            report.pieces.len(),
            self.out.display()
        ));
        Ok(())
    }

    fn check_width(&self, diagonal: f64) -> Result<(), CliError> {
        check_width(self.width, diagonal).map_err(|why| CliError::Input(format!("--width {}: {why}", self.width)))
    }

    fn write(&self, scene: &Scene) -> Result<f64, CliError> {
        let Some((_, first)) = scene.tissues().next() else { return Ok(0.0) };
        match Format::of(self.format, &self.out) {
            Format::Glb => {
                let (bytes, deviation) = scene_glb(scene)?;
                write_file(&self.out, &bytes)?;
                Ok(deviation)
            }
            Format::Obj => {
                let names = piece_names(scene);
                let bytes = export_obj(&export_pieces(scene, &names), first.offset(), first.pose());
                write_file(&self.out, bytes.as_bytes())?;
                Ok(0.0)
            }
        }
    }

    /// The map of what is left of the model; severed pieces have maps of their own and are left out.
    fn write_map(&self, scene: &Scene) -> Result<(), CliError> {
        let (Some(file), Some((_, tissue))) = (&self.map_out, scene.tissues().next()) else { return Ok(()) };
        let Some(layer) = tissue.layer() else { return Ok(()) };
        let json = map_json(tissue.mesh(), tissue.rest_positions(), &layer.map, &layer.strips, tissue.offset());
        write_file(file, &serde_json::to_vec(&json).map_err(CliError::run)?)
    }
}
