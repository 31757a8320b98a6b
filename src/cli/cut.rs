//! `incise cut`.

use super::CliError;
use super::common::{
    Format, ParticleArgs, PoseArgs, load, load_path, make_folder, posed_scene, print_json, print_line, warn_of_leftovers,
    write_file,
};
use super::report_json;
use crate::config::Config;
use crate::formats::{ExportPiece, export_glb, export_obj};
use crate::geometry::Plane;
use crate::scene::{EditCommand, EditReport, Outcome, Scene};
use crate::surgery::leaf::Leaf;
use clap::Args;
use glam::DVec3;
use std::path::PathBuf;

/// Arguments.
#[derive(Args)]
pub struct Cut {
    /// A .glb, .gltf, .obj or .stl file, or a bundled name.
    model: String,
    /// The plane n.x = d in model space, metres; any n but zero.
    #[arg(long, value_name = "nx,ny,nz,d", allow_hyphen_values = true, required_unless_present = "blade")]
    plane: Option<String>,
    /// The plane that a blade means instead: a path as `incise tear` takes it. The plane goes through the point where the blade
    /// first touches the model and through its two ends a step later.
    #[arg(long, value_name = "PATH.json", conflicts_with_all = ["plane", "bounded"])]
    blade: Option<PathBuf>,
    /// Cut only the part of the plane that the blade swept: three or four points, convex, metres: the tip before and after,
    /// then the blade's other end after (and before). Points off the plane are dropped onto it. The cut ends inside the
    /// model where they do; only one that goes right through all that it meets gets caps.
    #[arg(long, value_name = "x,y,z,x,y,z,x,y,z[,x,y,z]", allow_hyphen_values = true)]
    bounded: Option<String>,
    /// Close the pieces with caps. Where the model is open, loops that are not closed get none; a warning says so.
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
        let command = self.command()?;
        let model = load(&self.model)?;
        let particles = if self.no_particles { None } else { Some(self.particles.settings(&model, config)?) };
        let mut scene = posed_scene(model, &self.pose, particles, config)?;
        make_folder(&self.out)?;
        let report = scene.edit(command).pop().unwrap_or_default();
        if report.caps.unclosed_edges > 0 {
            tracing::warn!("--cap: {} edges of the cut are in no closed loop and stay open", report.caps.unclosed_edges);
        }
        let deviation = self.write_pieces(&scene, &report)?;
        warn_of_leftovers(&self.out, |i| self.file_name(i), report.pieces.len());
        if self.json {
            let mut value = report_json::edit(&report);
            value["export_deviation"] = serde_json::json!(deviation);
            print_json(&value);
            return Ok(());
        }
        print_line(&format!("{}: {} piece(s) in {}", report.outcome.as_str(), report.pieces.len(), self.out.display()));
        for (i, piece) in report.pieces.iter().enumerate() {
            let side = if report.outcome == Outcome::Missed || piece.side == 0 {
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

    fn command(&self) -> Result<EditCommand, CliError> {
        if let Some(path) = &self.blade {
            let path = load_path(path)?;
            return Ok(EditCommand::CutByBlade { poses: path.poses().to_vec(), closed: self.cap });
        }
        let plane = parse_plane(self.plane.as_deref().unwrap_or_default())?;
        Ok(match &self.bounded {
            Some(text) => EditCommand::CutBounded { plane, corners: parse_bounded(text, &plane)?, closed: self.cap },
            None if self.cap => EditCommand::CutClosed(plane),
            None => EditCommand::Cut(plane),
        })
    }

    fn file_name(&self, i: usize) -> String {
        let ending = match self.format {
            Format::Glb => "glb",
            Format::Obj => "obj",
        };
        format!("{}.{ending}", piece_name(i))
    }

    /// Writes the pieces in the report's order; returns the largest deviation of an exported vertex, as a fraction of the
    /// diagonal of all of them.
    fn write_pieces(&self, scene: &Scene, report: &EditReport) -> Result<f64, CliError> {
        let mut deviation_m = 0.0f64;
        for (i, piece) in report.pieces.iter().enumerate() {
            let Some(tissue) = scene.tissue(piece.tissue) else { continue };
            let name = piece_name(i);
            let part = ExportPiece { name: &name, mesh: tissue.mesh(), rows: tissue.rows(), materials: tissue.materials() };
            match self.format {
                Format::Glb => {
                    let (bytes, exported) = export_glb(tissue.rig(), &[part], tissue.pose()).map_err(CliError::run)?;
                    deviation_m = deviation_m.max(exported.deviation_m);
                    write_file(&self.out.join(self.file_name(i)), &bytes)?;
                }
                Format::Obj => {
                    let text = export_obj(&[part], tissue.offset(), tissue.pose());
                    write_file(&self.out.join(self.file_name(i)), text.as_bytes())?;
                }
            }
        }
        if deviation_m == 0.0 {
            return Ok(0.0);
        }
        let (low, high) = scene.bounds();
        Ok(deviation_m / (high - low).length())
    }
}

fn piece_name(i: usize) -> String {
    format!("piece-{i}")
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
    let exponent = -(normal.abs().max_element().log2().floor() as i32);
    // in two steps: no power of two brings the smallest numbers up in one
    let [a, b] = [exponent / 2, exponent - exponent / 2].map(|e| 2f64.powi(e));
    Ok(Plane::Equation { normal: normal * a * b, offset: (d * a * b).clamp(-Plane::FARTHEST, Plane::FARTHEST) })
}

/// Parses the corners of a bounded cut and drops them onto the plane.
fn parse_bounded(text: &str, plane: &Plane) -> Result<Vec<DVec3>, CliError> {
    let bad = |why: &str| CliError::Input(format!("--bounded {text:?}: {why}; give three or four points x,y,z in a row"));
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
    let numbers = numbers.map_err(|_| bad("not all are numbers"))?;
    if !matches!(numbers.len(), 9 | 12) {
        return Err(bad("not nine or twelve numbers"));
    }
    if numbers.iter().any(|x| x.is_nan() || x.abs() > 1e12) {
        return Err(bad("not all numbers are finite and below 1e12"));
    }
    let onto = |p: &[f64]| {
        let p = DVec3::from_slice(p);
        p - plane.normal() * plane.distance(p)
    };
    let corners: Vec<DVec3> = numbers.chunks(3).map(onto).collect();
    match Leaf::in_plane(*plane, &corners) {
        Some(_) => Ok(corners),
        None => Err(bad("on the plane these are no convex polygon with an area, in order around it")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_parse_or_say_why_not() {
        let plane = Plane::Equation { normal: DVec3::Y, offset: 0.5 };
        let corners = parse_bounded("0,0,0, 1,0.4,0, 1,0.5,1, 0,9,1", &plane).unwrap();
        assert!(corners.iter().all(|p| p.y == 0.5) && corners.len() == 4);
        let why = |text: &str| match parse_bounded(text, &plane) {
            Err(CliError::Input(message)) => message,
            other => panic!("{other:?}"),
        };
        assert!(why("0,0,0,1,0,0,1,0").contains("nine or twelve"));
        assert!(why("0,0,0,1,0,0,1,0,x").contains("numbers"));
        assert!(why("0,0,0,1,0,0,1,0,inf").contains("finite"));
        assert!(why("0,0,0,1,0,0,2,0,0").contains("convex"), "in line");
        assert!(why("0,0,0,1,0,1,1,0,0,0,0,1").contains("convex"), "a bow tie");
        assert!(why("0,0,0,0,1,0,1,2,0").contains("convex"), "in line once dropped onto the plane");
    }

    #[test]
    fn planes_parse_or_say_why_not() {
        assert!(matches!(parse_plane("1, 0.3,0.2,-1"), Ok(Plane::Equation { .. })));
        for text in ["5e-324,0,0,0", "1e-310,1e-311,0,1", "1e308,0,-1e308,-1e308"] {
            let plane = parse_plane(text);
            let is_sound = |p: &Plane| matches!(p, Plane::Equation { normal, offset } if normal.is_finite() && normal.length() >= 1.0 && offset.is_finite());
            assert!(plane.as_ref().is_ok_and(is_sound), "{text}: {plane:?}");
        }
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
