//! Models in and out: glTF, OBJ, STL and procedural ones.
//!
//! A reader fills a stored surface (vertices and faces as the file has them); the assembler decides topology by MATHS 1.6
//! and recentres by 1.7; [`export_glb`] goes the other way by 1.8. No input makes any of them panic.

mod assemble;
mod error;
mod export_weights;
mod facing;
mod flats;
mod glb_materials;
mod glb_writer;
mod gltf_data;
mod gltf_export;
mod gltf_extensions;
mod gltf_import;
mod gltf_materials;
mod gltf_primitive;
mod gltf_rig;
mod gltf_skins;
mod gltf_tangents;
mod inspect;
mod material;
mod mtl;
mod obj;
mod obj_export;
mod polygon;
mod procedural;
mod stl;
mod stored;
mod weld;

#[cfg(test)]
mod gltf_extensions_tests;
#[cfg(test)]
mod import_tests;
#[cfg(test)]
mod materials_tests;
#[cfg(test)]
mod placement_tests;
#[cfg(test)]
mod skins_tests;

pub use error::FormatError;
pub use gltf_export::{ExportPiece, ExportReport, export_glb};
pub use inspect::{AnimationInfo, Bounds, Inspection, MaterialInfo, inspect};
pub use material::{AlphaMode, Finish, Material, Picture, Sampler, Texture};
pub use obj_export::export_obj;
pub use procedural::{NAMES as BUNDLED, generate};

use crate::geometry::Mesh;
use crate::rig::{Rig, VertexRows};
use glam::DVec3;
use std::borrow::Cow;
use std::path::Path;

/// The bytes of a text without the mark of UTF-8 that some programs begin one with.
fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

/// The text that they are.
fn text_of(bytes: &[u8]) -> Cow<'_, str> {
    String::from_utf8_lossy(without_mark(bytes))
}

/// A model as loaded: everything a tissue is made from.
#[derive(Clone, Debug)]
pub struct Model {
    /// File name without its ending, or the bundled name.
    pub name: String,
    /// Topology and corner attributes; every vertex has one fan, all faces are in section 0.
    pub mesh: Mesh,
    /// Rest positions (tissue space) and bones; all vertices are base vertices.
    pub rows: VertexRows,
    /// Skeleton and animations; without joints for a static model.
    pub rig: Rig,
    /// Materials, by [`crate::geometry::FaceInfo::material`]; at least one.
    pub materials: Vec<Material>,
    /// Translation of `world_from_tissue`, metres: model space = tissue space + offset (MATHS 1.7). Equals `rig.origin`.
    pub offset: DVec3,
    /// What was found on the way in.
    pub report: LoadReport,
}

/// What loading found and changed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadReport {
    /// Vertices in the file (of all instances that are part of the model).
    pub vertices_stored: usize,
    /// Topological vertices.
    pub vertices_welded: usize,
    /// Skins in the file; those over the same joints are one in the rig.
    pub skins_stored: usize,
    /// Faces with a repeated vertex or exactly zero area. Dropped, but where one closes the surface: the
    /// face beyond it is divided in its stead. An exported topology is kept as it is.
    pub degenerate_faces: usize,
    /// Faces that repeat another; dropped.
    pub duplicate_faces: usize,
    /// Edges that more than two faces share, or two in the same direction; they stay open.
    pub non_manifold_edges: usize,
    /// Of these, such as exactly two faces run through, in the same direction: the faces are wound against each other.
    pub one_way_edges: usize,
    /// Open half-edges at non-manifold edges.
    pub non_manifold_half_edges: usize,
    /// Largest difference of a joint's weight between stored copies of one vertex; the first copy counts (MATHS 1.6).
    pub largest_weight_difference: f32,
    /// What was left out or looks wrong, one sentence each.
    pub warnings: Vec<String>,
}

/// File formats by ending.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Gltf,
    Obj,
    Stl,
}

fn format_of(path: &Path) -> Option<Format> {
    match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
        "glb" | "gltf" => Some(Format::Gltf),
        "obj" => Some(Format::Obj),
        "stl" => Some(Format::Stl),
        _ => None,
    }
}

/// Loads a model: `spec` is a path (.glb, .gltf, .obj, .stl) or a bundled name. An existing file wins over a name.
pub fn load(spec: &str) -> Result<Model, FormatError> {
    let path = Path::new(spec);
    if !path.is_file() {
        if let Some(bytes) = procedural::bundled(spec) {
            return load_bytes(bytes, Format::Gltf, spec, None);
        }
        if path.is_dir() {
            return Err(FormatError::IsFolder { path: path.into() });
        }
        if !path.exists() {
            return Err(FormatError::NotFound { spec: spec.into(), bundled: BUNDLED.join(", ") });
        }
    }
    load_file(path)
}

/// A procedural model (see [`generate`]) with about `faces` faces, read back like a file.
pub fn load_generated(name: &str, faces: usize) -> Result<Model, FormatError> {
    load_bytes(&generate(name, Some(faces))?, Format::Gltf, name, None)
}

fn load_file(path: &Path) -> Result<Model, FormatError> {
    let format = format_of(path).ok_or_else(|| FormatError::UnknownExtension { path: path.into() })?;
    let bytes = std::fs::read(path).map_err(|source| FormatError::Io { path: path.into(), source })?;
    let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    load_bytes(&bytes, format, &name, path.parent())
}

/// A file that another one names: not what may never end, such as a device or a pipe.
fn read_named(path: &Path) -> std::io::Result<Vec<u8>> {
    if std::fs::metadata(path)?.is_file() { std::fs::read(path) } else { Err(std::io::Error::other("this is no regular file")) }
}

fn load_bytes(bytes: &[u8], format: Format, name: &str, folder: Option<&Path>) -> Result<Model, FormatError> {
    let mut model = match format {
        Format::Gltf => gltf_import::read(bytes, name, folder)?,
        Format::Obj => {
            let file = obj::read(bytes, folder)?;
            let report = LoadReport { warnings: file.warnings, ..LoadReport::default() };
            static_model(&file.stored, name, file.materials, report)?
        }
        Format::Stl => static_model(&stl::read(bytes)?, name, vec![Material::default()], LoadReport::default())?,
    };
    facing::check(&mut model)?;
    Ok(model)
}

fn static_model(
    stored: &stored::Stored,
    name: &str,
    materials: Vec<Material>,
    mut report: LoadReport,
) -> Result<Model, FormatError> {
    let finite = stored.positions.iter().filter(|p| p.is_finite());
    let (min, max) = finite.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), &p| (min.min(p), max.max(p)));
    let origin = assemble::origin_of(min, max);
    let (mesh, rows) = assemble::assemble(stored, origin, &mut report)?;
    let rig = Rig { origin, ..Rig::default() };
    Ok(Model { name: name.into(), mesh, rows, rig, materials, offset: origin, report })
}
