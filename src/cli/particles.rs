//! `incise particles`.

use super::CliError;
use super::common::{ParticleArgs, PoseArgs, load, posed_scene, print_json, print_line, write_file};
use crate::config::Config;
use crate::particles::{map_json, sample_quality};
use clap::Args;
use std::path::PathBuf;

/// Arguments.
#[derive(Args)]
pub struct Particles {
    /// A .glb, .gltf, .obj or .stl file, or a bundled name.
    model: String,
    #[command(flatten)]
    particles: ParticleArgs,
    #[command(flatten)]
    pose: PoseArgs,
    /// Write the particle map, as JSON. Positions are those of the rest shape, where the map is made.
    #[arg(long, value_name = "FILE.json")]
    out: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

impl Particles {
    pub fn run(self, config: &Config) -> Result<(), CliError> {
        let model = load(&self.model)?;
        let settings = self.particles.settings(&model, config)?;
        let mut stages = crate::diagnostics::Stages::default();
        let scene = stages.time("sample_and_map", || posed_scene(model, &self.pose, Some(settings), config))?;
        let Some((_, tissue)) = scene.tissues().next() else { return Ok(()) };
        let Some(layer) = tissue.layer() else { return Ok(()) };
        let quality = sample_quality(tissue.mesh(), tissue.rest_positions(), &layer.map.anchors, settings.spacing);
        let (influences, links) = (layer.map.influences.len(), layer.map.neighbours.len() / 2);
        if let Some(file) = &self.out {
            let json = map_json(tissue.mesh(), tissue.rest_positions(), &layer.map, &layer.strips, tissue.offset());
            write_file(file, &serde_json::to_vec(&json).map_err(CliError::run)?)?;
        }
        if self.json {
            print_json(&serde_json::json!({
                "particles": layer.map.live(),
                "influences": influences,
                "neighbours": links,
                "spacing": settings.spacing,
                "radius": settings.radius,
                "neighbour_distance": settings.neighbours,
                "quality": {
                    "min_spacing_same_sheet": quality.min_spacing_same_sheet,
                    "min_spacing_euclidean": quality.min_spacing_euclidean,
                    "coverage": quality.coverage,
                    "radius_ratio": quality.radius_ratio,
                    "nearest_cv": quality.nearest_cv,
                    "truncation_error": layer.truncation_error,
                },
                "time_ms": super::report_json::stages(&stages),
            }));
            return Ok(());
        }
        print_line(&format!("{} particles, {influences} influences, {links} springs", layer.map.live()));
        print_line(&format!(
            "  spacing {:.4e} m, radius {:.4e} m, neighbours within {:.4e} m",
            settings.spacing, settings.radius, settings.neighbours
        ));
        print_line(&format!(
            "  least spacing on a sheet {:.4e} m, coverage {:.4e} m, radius ratio {:.3}",
            quality.min_spacing_same_sheet, quality.coverage, quality.radius_ratio
        ));
        Ok(())
    }
}
