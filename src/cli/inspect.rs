//! `incise inspect`.

use super::CliError;
use super::common::{load, print_json, print_line};
use crate::formats::inspect;
use clap::Args;

/// Arguments.
#[derive(Args)]
pub struct Inspect {
    /// A .glb, .gltf, .obj or .stl file, or a bundled name.
    model: String,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

impl Inspect {
    pub fn run(self) -> Result<(), CliError> {
        let model = load(&self.model)?;
        let found = inspect(&model, &model.rig.rest_pose());
        if self.json {
            print_json(&serde_json::to_value(&found).map_err(CliError::run)?);
            return Ok(());
        }
        print_line(&found.name);
        print_line(&format!("  vertices    {} stored, {} welded", found.vertices_stored, found.vertices_welded));
        print_line(&format!("  faces       {} in {} component(s)", found.faces, found.components));
        let closed = if found.closed { "closed".into() } else { format!("open: {} boundary edges", found.boundary_edges) };
        print_line(&format!("  surface     {closed}, {} non-manifold edges", found.non_manifold_edges));
        print_line(&format!("  dropped     {} degenerate, {} duplicate faces", found.degenerate_faces, found.duplicate_faces));
        print_line(&format!("  area        {:.6e} m2", found.area));
        print_line(&format!("  volume      {:.6e} m3", found.volume));
        print_line(&format!("  bounds      {:?} to {:?} m", found.bounds.min, found.bounds.max));
        print_line(&format!("  rig         {} joints in {} skin(s)", found.joints, found.skins));
        for animation in &found.animations {
            print_line(&format!("  animation   {} ({:.3} s)", animation.name, animation.duration));
        }
        for material in &found.materials {
            print_line(&format!("  material    {}", material.name));
        }
        Ok(())
    }
}
