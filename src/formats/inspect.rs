//! What `incise inspect` reports.

use super::Model;
use crate::geometry::Components;
use crate::geometry::measure::measure;
use crate::rig::Pose;
use serde::Serialize;

/// Axis-aligned bounds, model space, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bounds {
    /// Lowest coordinates.
    pub min: [f64; 3],
    /// Highest coordinates.
    pub max: [f64; 3],
    /// Length of the diagonal.
    pub diagonal: f64,
}

/// Name and length of an animation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AnimationInfo {
    /// Its name.
    pub name: String,
    /// Seconds.
    pub duration: f64,
}

/// A material in short.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MaterialInfo {
    /// Its name, possibly empty.
    pub name: String,
    /// Base colour factor, linear RGBA.
    pub base_colour: [f32; 4],
    /// Width and height of the base colour texture, pixels.
    pub texture: Option<[u32; 2]>,
    /// True if the back is drawn too.
    pub double_sided: bool,
}

/// The keys of CONTRACT's `inspect`. Area, volume and bounds are in the given pose, model space, summed in f64.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)] // the names say it; CONTRACT defines them
pub struct Inspection {
    pub name: String,
    pub vertices_stored: usize,
    pub vertices_welded: usize,
    pub faces: usize,
    pub components: usize,
    pub closed: bool,
    pub boundary_edges: usize,
    pub non_manifold_edges: usize,
    pub degenerate_faces: usize,
    pub duplicate_faces: usize,
    pub area: f64,
    pub volume: f64,
    pub bounds: Bounds,
    pub joints: usize,
    /// As the file has them: those over the same joints are one in [`Model::rig`].
    pub skins: usize,
    pub animations: Vec<AnimationInfo>,
    pub materials: Vec<MaterialInfo>,
    /// Largest difference of one joint's weight between stored copies of a vertex (MATHS 1.6).
    pub largest_weight_difference: f32,
    pub warnings: Vec<String>,
}

/// Inspects a model as loaded in a pose.
pub fn inspect(model: &Model, pose: &Pose) -> Inspection {
    let report = &model.report;
    let measures = measure(&model.mesh, |v| pose.skin(&model.rows, v));
    let boundary_edges = measures.boundary_edges.saturating_sub(report.non_manifold_half_edges);
    let mut warnings = report.warnings.clone();
    if report.largest_weight_difference > 0.0 {
        warnings.push(format!(
            "copies of a vertex along a seam differ by up to {} in a skin weight; the first copy counts",
            report.largest_weight_difference
        ));
    }
    Inspection {
        name: model.name.clone(),
        vertices_stored: report.vertices_stored,
        vertices_welded: report.vertices_welded,
        faces: measures.faces,
        components: Components::find(&model.mesh).count(),
        closed: measures.boundary_edges == 0 && report.non_manifold_edges == 0,
        boundary_edges,
        non_manifold_edges: report.non_manifold_edges,
        degenerate_faces: report.degenerate_faces,
        duplicate_faces: report.duplicate_faces,
        area: measures.area,
        volume: measures.volume_about(-model.offset),
        bounds: Bounds {
            min: (measures.min + model.offset).to_array(),
            max: (measures.max + model.offset).to_array(),
            diagonal: measures.diagonal(),
        },
        joints: model.rig.joints.len(),
        skins: report.skins_stored,
        animations: model.rig.animations.iter().map(|a| AnimationInfo { name: a.name.clone(), duration: a.duration_s }).collect(),
        materials: model
            .materials
            .iter()
            .map(|m| MaterialInfo {
                name: m.name.clone(),
                base_colour: m.base_colour,
                texture: m.texture.as_ref().map(|t| [t.width, t.height]),
                double_sided: m.double_sided,
            })
            .collect(),
        largest_weight_difference: report.largest_weight_difference,
        warnings,
    }
}
