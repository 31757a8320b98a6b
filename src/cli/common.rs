//! Arguments and steps that sub-commands share.

use super::CliError;
use crate::config::Config;
use crate::formats::{self, FormatError, Material, Model};
use crate::geometry::Mesh;
#[cfg(any(feature = "desktop", feature = "vr"))]
use crate::host::{
    models::{Loaded, Request, Tell},
    writer::Encode,
};
use crate::input::ParticleOverrides;
use crate::particles::ParticleSettings;
use crate::physics::NetworkSettings;
use crate::rig::{Pose, Rig, VertexRows};
use crate::scene::{Scene, SceneSettings};
use crate::surgery::{BladePath, PathError};
use crate::tissue::{Tissue, TissueSettings};
#[cfg(feature = "gpu")]
use crate::{surgery::WallMode, tissue::forces::BodyForces};
use clap::Args;
use glam::DVec3;
use std::io::Write;
use std::path::Path;

/// A blade's path from a file; errors name it.
pub fn load_path(file: &Path) -> Result<BladePath, CliError> {
    BladePath::load(file).map_err(|e| match e {
        PathError::Unreadable { .. } => CliError::input(e),
        other => CliError::Input(format!("{}: {other}", file.display())),
    })
}

/// POSE of CONTRACT.
#[derive(Args, Clone, Debug, Default)]
pub struct PoseArgs {
    /// Animation that poses the model (default: the rest pose).
    #[arg(long, value_name = "NAME")]
    pub animation: Option<String>,
    /// Time in the animation, seconds. It goes round: past its end it begins anew, and at its end it is at its start.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub time: f64,
}

/// PARTICLES of CONTRACT.
#[derive(Args, Clone, Debug, Default)]
pub struct ParticleArgs {
    /// Least distance of particles, metres (default: about 200 particles).
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub spacing: Option<f64>,
    /// Radius of a particle's influence, metres, above the spacing.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub radius: Option<f64>,
    /// Distance up to which particles are joined by springs, metres.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub neighbours: Option<f64>,
    /// Seed of the sampling.
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
}

impl ParticleArgs {
    /// Settings for a model: the configuration's, with what was given.
    pub fn settings(&self, model: &Model, config: &Config) -> Result<ParticleSettings, CliError> {
        let given = ParticleOverrides {
            spacing: self.spacing,
            radius: self.radius,
            neighbours: self.neighbours,
            ..ParticleOverrides::default()
        };
        particle_settings(model, config, &given, self.seed)
    }
}

/// Particle settings for a model: the configuration's, with what a user or a script gives.
pub fn particle_settings(
    model: &Model,
    config: &Config,
    given: &ParticleOverrides,
    seed: u64,
) -> Result<ParticleSettings, CliError> {
    let spacing = given.spacing.unwrap_or_else(|| {
        let rest: Vec<DVec3> = (0..model.rows.len()).map(|v| model.rows.rest(crate::geometry::VertexId::new(v))).collect();
        ParticleSettings::for_count(&model.mesh, &rest, config.particles.count as usize).spacing
    });
    let mut settings = ParticleSettings::with_spacing(spacing);
    settings.radius = given.radius.unwrap_or(config.particles.radius * spacing);
    settings.neighbours = given.neighbours.unwrap_or(config.particles.neighbours * spacing);
    settings.wound.gap = config.tear.gap * diagonal(model);
    settings.seed = seed;
    check_particles(&settings)?;
    Ok(settings)
}

/// Checks particle settings and passes their warnings on.
pub fn check_particles(settings: &ParticleSettings) -> Result<(), CliError> {
    for warning in settings.validate().map_err(CliError::input)? {
        tracing::warn!("{warning}");
    }
    Ok(())
}

/// Diagonal of a model's bounds at rest, metres.
pub fn diagonal(model: &Model) -> f64 {
    let rest = model.mesh.live_vertices().map(|v| model.rows.rest(v));
    let (low, high) = rest.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    (high - low).length()
}

/// Why walls need a width.
pub const NO_WALLS: &str = "the walls of a slit of width 0 would be two sheets in one place; give a width above 0, or open walls";

/// Checks a tear's width against the model that it is for.
pub fn check_width(width: f64, diagonal: f64) -> Result<(), String> {
    if !(width.is_finite() && width >= 0.0) {
        return Err("give a width of 0 or more, in metres".into());
    }
    // A slit that wide has no shape: its mitred joints would reach past each other whatever the path.
    if width > WIDEST * diagonal {
        return Err(format!("more than {WIDEST} times the model's diagonal, {diagonal:.4e} m; widths are in metres"));
    }
    Ok(())
}

/// Widest slit, in diagonals of the model.
const WIDEST: f64 = 10.0;

/// Loads a model and passes its warnings on. Errors name the file.
pub fn load(spec: &str) -> Result<Model, CliError> {
    let model = formats::load(spec).map_err(|e| match e {
        FormatError::NotFound { .. }
        | FormatError::UnknownExtension { .. }
        | FormatError::IsFolder { .. }
        | FormatError::Io { .. } => CliError::input(e),
        other => CliError::Input(format!("{spec}: {other}")),
    })?;
    for warning in &model.report.warnings {
        tracing::warn!("{spec}: {warning}");
    }
    Ok(model)
}

/// Index of the animation that was asked for.
pub fn find_animation(rig: &Rig, pose: &PoseArgs) -> Result<Option<usize>, CliError> {
    if !pose.time.is_finite() {
        return Err(CliError::Input(format!("--time {}: give a finite number of seconds", pose.time)));
    }
    let Some(name) = &pose.animation else {
        if pose.time != 0.0 {
            tracing::warn!("--time {} without --animation: the model is in its rest pose", pose.time);
        }
        return Ok(None);
    };
    rig.animation_by_name(name).map(Some).ok_or_else(|| {
        let names: Vec<&str> = rig.animations.iter().map(|a| a.name.as_str()).collect();
        let known = if names.is_empty() { "the model has none".to_string() } else { format!("it has: {}", names.join(", ")) };
        CliError::Input(format!("no animation {name:?}; {known}"))
    })
}

/// Springs of the active material.
pub fn network_settings(config: &Config) -> NetworkSettings {
    config.dynamics.active().into()
}

/// How the scene's tissue is made.
pub fn tissue_settings(config: &Config, particles: Option<ParticleSettings>) -> TissueSettings {
    TissueSettings {
        particles,
        network: network_settings(config),
        opening_s: config.tear.opening_time,
        section_faces: config.sections.faces as usize,
        fade_s: config.dynamics.fade_time,
    }
}

/// A scene with the model in the given pose.
pub fn posed_scene(
    model: Model,
    pose: &PoseArgs,
    particles: Option<ParticleSettings>,
    config: &Config,
) -> Result<Scene, CliError> {
    let animation = find_animation(&model.rig, pose)?;
    let tissue = Tissue::new(model, &tissue_settings(config, particles)).map_err(CliError::input)?;
    let settings = SceneSettings { sampling: config.sampling, sample_distance: None, sample_time: None };
    let mut scene = Scene::new(tissue, settings);
    scene.set_animation(animation);
    scene.pose(0.0, pose.time);
    Ok(scene)
}

/// A scene that runs: what lines its tears, what becomes of pieces, and what pulls at the tissue, as the configuration says.
#[cfg(feature = "gpu")]
pub fn live_scene(tissue: Tissue, tools: SceneSettings, wall: WallMode, config: &Config) -> Scene {
    let mut scene = Scene::new(tissue, tools);
    scene.set_wall(wall);
    scene.set_pieces(config.pieces.for_scene());
    scene.set_body_forces(BodyForces { gravity: config.dynamics.gravity, inertia: config.dynamics.inertia });
    scene
}

/// A scene of a model, at rest, as the settings have it.
#[cfg(any(feature = "desktop", feature = "vr"))]
pub fn live_model(request: &Request, tell: Tell) -> Result<Loaded, CliError> {
    let Request { model: name, config, spacing } = request;
    tell("reading", 0.0);
    let model = load(name)?;
    tell("placing particles", 0.2);
    let warnings = model.report.warnings.clone();
    let given = ParticleOverrides { spacing: *spacing, ..ParticleOverrides::default() };
    let particles = particle_settings(&model, config, &given, 1)?;
    tell("joining them to the surface", 0.5);
    let tissue = Tissue::new(model, &tissue_settings(config, Some(particles))).map_err(CliError::input)?;
    let settings = SceneSettings { sampling: config.sampling, sample_distance: None, sample_time: None };
    let mut scene = live_scene(tissue, settings, config.tear.wall, config);
    // frames wait for its edits
    scene.set_measuring(false);
    scene.pose(0.0, 0.0);
    Ok(Loaded { scene, name: name.clone(), warnings })
}

/// The scene as .glb, pieces as nodes of their own: taken as it is now, encoded later.
#[cfg(any(feature = "desktop", feature = "vr"))]
pub fn export(scene: &Scene) -> Encode {
    let first = scene.tissues().next().map(|(_, t)| (t.rig().clone(), t.pose().clone()));
    let pieces: Vec<_> = scene.tissues().map(|(_, t)| (t.mesh().clone(), t.rows().clone(), t.materials().clone())).collect();
    let names = piece_names(scene);
    Box::new(move || {
        let first = first.as_ref().map(|(rig, pose)| (&**rig, pose));
        let pieces = named(&names, pieces.iter().map(|(mesh, rows, materials)| (mesh, rows, &***materials)));
        glb(first, &pieces).map(|(bytes, _)| bytes).map_err(CliError::into_message)
    })
}

/// Names of the scene's tissues as files call them: the model's own, and pieces by number.
pub fn piece_names(scene: &Scene) -> Vec<String> {
    let name = |(id, t): (crate::scene::TissueId, &Tissue)| match id.0 {
        0 => t.name.clone(),
        piece => format!("{}-{piece}", t.name),
    };
    scene.tissues().map(name).collect()
}

/// The scene's tissues as exporters take them.
pub fn export_pieces<'a>(scene: &'a Scene, names: &'a [String]) -> Vec<formats::ExportPiece<'a>> {
    named(names, scene.tissues().map(|(_, t)| (t.mesh(), t.rows(), &***t.materials())))
}

/// Pieces as exporters take them, of what each is made of.
fn named<'a>(
    names: &'a [String],
    parts: impl Iterator<Item = (&'a Mesh, &'a VertexRows, &'a [Material])>,
) -> Vec<formats::ExportPiece<'a>> {
    names.iter().zip(parts).map(|(name, (mesh, rows, materials))| formats::ExportPiece { name, mesh, rows, materials }).collect()
}

/// Pieces as binary glTF, with rig and pose of the first, and the largest deviation of their plain skin weights (MATHS 1.8).
fn glb(first: Option<(&Rig, &Pose)>, pieces: &[formats::ExportPiece<'_>]) -> Result<(Vec<u8>, f64), CliError> {
    let Some((rig, pose)) = first else { return Err(CliError::Run("the scene is empty".into())) };
    let (bytes, report) = formats::export_glb(rig, pieces, pose).map_err(CliError::run)?;
    Ok((bytes, report.deviation))
}

/// The whole scene as binary glTF, a node a piece, and the largest deviation of its plain skin weights (MATHS 1.8).
pub fn scene_glb(scene: &Scene) -> Result<(Vec<u8>, f64), CliError> {
    let names = piece_names(scene);
    glb(scene.tissues().next().map(|(_, t)| (&**t.rig(), t.pose())), &export_pieces(scene, &names))
}

/// The output format.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Binary glTF: skin, animations, materials.
    #[default]
    Glb,
    /// Wavefront OBJ, in the given pose.
    Obj,
}

impl Format {
    /// The format that was asked for, else the one that the file's ending names, else .glb.
    pub fn of(asked: Option<Self>, file: &Path) -> Self {
        let ending = file.extension().and_then(|e| e.to_str()).unwrap_or_default();
        let named = match ending.to_ascii_lowercase().as_str() {
            "glb" => Some(Self::Glb),
            "obj" => Some(Self::Obj),
            _ => None,
        };
        let format = asked.or(named).unwrap_or_default();
        if named != Some(format) {
            tracing::warn!("{} will hold {}, whatever its ending says", file.display(), format!("{format:?}").to_lowercase());
        }
        format
    }
}

/// Writes a file, with its folder if that is missing.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    if let Some(folder) = path.parent().filter(|f| !f.as_os_str().is_empty()) {
        make_folder(folder)?;
    }
    std::fs::write(path, bytes).map_err(|e| CliError::Run(format!("cannot write {}: {e}", path.display())))
}

/// Makes a folder and those above it.
pub fn make_folder(folder: &Path) -> Result<(), CliError> {
    std::fs::create_dir_all(folder).map_err(|e| CliError::Run(format!("cannot make the folder {}: {e}", folder.display())))
}

/// Warns of what an earlier run left in `folder`: files by the names of this one's, which are numbered and were `count`, and beyond them.
pub fn warn_of_leftovers(folder: &Path, name: impl Fn(usize) -> String, count: usize) {
    let next = folder.join(name(count));
    if next.exists() {
        tracing::warn!("{} and those after it are an earlier run's", next.display());
    }
}

/// Prints one line on stdout; a closed pipe is no error.
pub fn print_line(text: &str) {
    let _ = writeln!(std::io::stdout(), "{text}");
}

/// Prints one JSON object on stdout.
pub fn print_json(value: &serde_json::Value) {
    print_line(&format!("{value:#}"));
}
