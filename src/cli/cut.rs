//! `incise cut`.

use super::CliError;
use super::common::{Format, ParticleArgs, PoseArgs, load, make_folder, posed_scene, print_json, print_line, write_file};
use super::report_json;
use crate::config::Config;
use crate::formats::{ExportPiece, export_glb, export_obj};
use crate::geometry::Plane;
use crate::scene::{EditCommand, EditReport, Outcome, Scene};
use clap::Args;
use glam::DVec3;
use std::path::PathBuf;

/// Arguments.
#[derive(Args)]
pub struct Cut {
    /// A .glb, .gltf, .obj or .stl file, or a bundled name.
    model: String,
    /// The plane n.x = d in model space, metres; any n but zero.
    #[arg(long, value_name = "nx,ny,nz,d", allow_hyphen_values = true)]
    plane: String,
    /// Close the pieces with caps. Not built yet: the pieces stay open, and a warning says so.
    #[arg(long)]
    cap: bool,
    #[command(flatten)]
    pose: PoseArgs,
    #[command(flatten)]
    particles: ParticleArgs,
    /// Leave the soft layer out.
    #[arg(long)]
    no_particles: bool,
    /// Folder for piece-0, piece-1, ...
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Format of the pieces.
    #[arg(long, value_enum, default_value_t)]
    format: Format,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

impl Cut {
    pub fn run(self, config: &Config) -> Result<(), CliError> {
        let plane = parse_plane(&self.plane)?;
        let model = load(&self.model)?;
        let particles = if self.no_particles { None } else { Some(self.particles.settings(&model, config)?) };
        let mut scene = posed_scene(model, &self.pose, particles, config)?;
        if self.cap {
            tracing::warn!("--cap: caps are not built yet; the pieces stay open along the cut");
        }
        make_folder(&self.out)?;
        let report = scene.edit(EditCommand::Cut(plane)).pop().unwrap_or_default();
        let deviation = self.write_pieces(&scene, &report)?;
        if self.json {
            let mut value = report_json::edit(&report);
            value["export_deviation"] = serde_json::json!(deviation);
            print_json(&value);
            return Ok(());
        }
        print_line(&format!("{}: {} piece(s) in {}", report.outcome.as_str(), report.pieces.len(), self.out.display()));
        for (i, piece) in report.pieces.iter().enumerate() {
            let side = if report.outcome == Outcome::Missed {
                ""
            } else if piece.side < 0 {
                ", negative side"
            } else {
                ", positive side"
            };
            print_line(&format!("  piece-{i}: {} faces, {:.6e} m2{side}", piece.faces, piece.area));
        }
        Ok(())
    }

    /// Writes the pieces in the report's order; returns the largest deviation of an exported vertex, as a fraction of the
    /// diagonal.
    fn write_pieces(&self, scene: &Scene, report: &EditReport) -> Result<f64, CliError> {
        let mut deviation = 0.0f64;
        for (i, piece) in report.pieces.iter().enumerate() {
            let Some(tissue) = scene.tissue(piece.tissue) else { continue };
            let name = format!("piece-{i}");
            let part = ExportPiece { name: &name, mesh: tissue.mesh(), rows: tissue.rows(), materials: tissue.materials() };
            match self.format {
                Format::Glb => {
                    let (bytes, exported) = export_glb(tissue.rig(), &[part], tissue.pose()).map_err(CliError::run)?;
                    deviation = deviation.max(exported.deviation);
                    write_file(&self.out.join(format!("{name}.glb")), &bytes)?;
                }
                Format::Obj => {
                    let text = export_obj(&[part], tissue.offset(), tissue.pose());
                    write_file(&self.out.join(format!("{name}.obj")), text.as_bytes())?;
                }
            }
        }
        Ok(deviation)
    }
}

/// Parses `nx,ny,nz,d`.
fn parse_plane(text: &str) -> Result<Plane, CliError> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
    let bad = |why: &str| CliError::Input(format!("--plane {text:?}: {why}; give nx,ny,nz,d, for example 0,1,0,0.05"));
    let numbers = numbers.map_err(|_| bad("not four numbers"))?;
    let [x, y, z, d] = numbers[..] else { return Err(bad("not four numbers")) };
    let normal = DVec3::new(x, y, z);
    if !normal.is_finite() || !d.is_finite() {
        return Err(bad("not all numbers are finite"));
    }
    if normal == DVec3::ZERO {
        return Err(bad("the normal is zero"));
    }
    // a normal of ordinary length keeps the exact predicates away from under- and overflow
    let scale = 2f64.powi(-(normal.abs().max_element().log2().floor() as i32));
    Ok(Plane::Equation { normal: normal * scale, offset: d * scale })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_parse_or_say_why_not() {
        assert!(matches!(parse_plane("1, 0.3,0.2,-1"), Ok(Plane::Equation { .. })));
        let why = |text: &str| match parse_plane(text) {
            Err(CliError::Input(message)) => message,
            other => panic!("{other:?}"),
        };
        assert!(why("0,0,0,1").contains("normal is zero"));
        assert!(why("1,2,3").contains("four numbers"));
        assert!(why("1,NaN,0,0").contains("finite"));
        assert!(why("a,b,c,d").contains("four numbers"));
    }
}
