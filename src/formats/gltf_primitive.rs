//! One glTF primitive: its triangles and its vertex attributes.

use super::FormatError;
use super::gltf_data::Document;
use super::gltf_rig::warn_once;
use super::stored::NO_MARK;
use crate::rig::BoneWeight;
use gltf::json;
use json::mesh::{Mode, Primitive, Semantic};
use json::validation::Checked;

/// Name of the vertex attribute that decides topology (MATHS 1.6), without its leading underscore.
pub(crate) const MARK_ATTRIBUTE: &str = "INCISE_VERTEX";

/// Vertex attributes; optional ones are empty where the primitive has none.
#[derive(Debug, Default)]
pub(crate) struct Attributes {
    pub positions: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    pub uvs: Vec<[f32; 2]>,
    pub colours: Vec<u32>,
    pub marks: Vec<u32>,
    bone_ends: Vec<u32>,
    pub bones: Vec<BoneWeight>,
}

impl Attributes {
    /// Bones of a vertex.
    pub fn bones(&self, vertex: usize) -> &[BoneWeight] {
        let start = if vertex == 0 { 0 } else { self.bone_ends[vertex - 1] };
        &self.bones[start as usize..self.bone_ends[vertex] as usize]
    }
}

fn accessor(primitive: &Primitive, semantic: Semantic) -> Option<usize> {
    primitive.attributes.get(&Checked::Valid(semantic)).map(|a| a.value())
}

fn position_accessor(primitive: &Primitive, label: &str) -> Result<usize, FormatError> {
    accessor(primitive, Semantic::Positions).ok_or_else(|| FormatError::gltf(format!("{label} has no positions")))
}

/// Triangles of a primitive with indices in range, or `None` where it has no faces (points and lines).
pub(crate) fn triangles(
    document: &Document,
    primitive: &Primitive,
    label: &str,
    warnings: &mut Vec<String>,
) -> Result<Option<Vec<[u32; 3]>>, FormatError> {
    let Checked::Valid(mode) = primitive.mode else {
        return Err(FormatError::gltf(format!("{label} has an unknown mode")));
    };
    if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
        warn_once(warnings, "points and lines are left out");
        return Ok(None);
    }
    let count = document.count(position_accessor(primitive, label)?)?;
    let indices: Vec<u32> = match primitive.indices {
        Some(indices) => document.integers::<1>(indices.value())?.concat(),
        None if count as u64 > u64::from(u32::MAX) => {
            return Err(FormatError::TooLarge { what: "vertices", count: count as u64, limit: u32::MAX.into() });
        }
        None => {
            document.floats::<3>(position_accessor(primitive, label)?)?; // before the count is trusted
            (0..count as u32).collect()
        }
    };
    if let Some(&index) = indices.iter().find(|&&i| i as usize >= count) {
        return Err(FormatError::range(format!("a face of {label}"), "vertex", index.into(), count));
    }
    if mode == Mode::Triangles && !indices.len().is_multiple_of(3) {
        warn_once(warnings, "indices that do not fill a triangle are left out");
    }
    Ok(Some(match mode {
        Mode::TriangleStrip => indices
            .windows(3)
            .enumerate()
            .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] })
            .collect(),
        Mode::TriangleFan => indices.get(1..).unwrap_or_default().windows(2).map(|w| [w[0], w[1], indices[0]]).collect(),
        _ => indices.as_chunks::<3>().0.to_vec(),
    }))
}

/// Reads the attributes. `joints` is the palette of the primitive's skin; weights are checked where a face uses them.
pub(crate) fn read_attributes(
    document: &Document,
    primitive: &Primitive,
    uv_set: u32,
    joints: Option<&[u32]>,
    faces: &[[u32; 3]],
    label: &str,
) -> Result<Attributes, FormatError> {
    let mut out = Attributes { positions: document.floats(position_accessor(primitive, label)?)?, ..Attributes::default() };
    let count = out.positions.len();
    if let Some(v) = out.positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
        return Err(FormatError::NotFinite { what: format!("the position of vertex {v} of {label}") });
    }
    if let Some(a) = accessor(primitive, Semantic::Normals) {
        out.normals = same_length(document.floats(a)?, count, "normals", label)?;
    }
    if let Some(a) = accessor(primitive, Semantic::TexCoords(uv_set)).or_else(|| accessor(primitive, Semantic::TexCoords(0))) {
        out.uvs = same_length(document.floats(a)?, count, "texture coordinates", label)?;
    }
    if let Some(a) = accessor(primitive, Semantic::Colors(0)) {
        out.colours = same_length(read_colours(document, a)?, count, "colours", label)?;
    }
    if let Some(a) = accessor(primitive, Semantic::Extras(MARK_ATTRIBUTE.into())) {
        let marks = document.floats::<1>(a)?.into_iter().map(|[m]| mark(m)).collect();
        out.marks = same_length(marks, count, "_INCISE_VERTEX values", label)?;
    }
    if let Some(joints) = joints {
        read_bones(document, primitive, joints, faces, label, &mut out)?;
    }
    Ok(out)
}

fn same_length<T>(values: Vec<T>, count: usize, what: &str, label: &str) -> Result<Vec<T>, FormatError> {
    if values.len() == count {
        Ok(values)
    } else {
        Err(FormatError::gltf(format!("{label} has {count} positions but {} {what}", values.len())))
    }
}

fn mark(value: f32) -> u32 {
    if value >= 0.0 && value.fract() == 0.0 && value <= 16_777_216.0 { value as u32 } else { NO_MARK }
}

fn read_colours(document: &Document, accessor: usize) -> Result<Vec<u32>, FormatError> {
    let pack = |c: [f32; 4]| c.iter().rev().fold(0, |n, x| n << 8 | (x.clamp(0.0, 1.0) * 255.0).round() as u32);
    Ok(match document.components(accessor)? {
        3 => document.floats::<3>(accessor)?.into_iter().map(|[r, g, b]| pack([r, g, b, 1.0])).collect(),
        _ => document.floats::<4>(accessor)?.into_iter().map(pack).collect(),
    })
}

/// Joins all JOINTS_n and WEIGHTS_n sets, drops zeros, merges repeats and normalises.
fn read_bones(
    document: &Document,
    primitive: &Primitive,
    palette: &[u32],
    faces: &[[u32; 3]],
    label: &str,
    out: &mut Attributes,
) -> Result<(), FormatError> {
    let count = out.positions.len();
    let mut sets = Vec::new();
    for set in 0.. {
        let (Some(joints), Some(weights)) =
            (accessor(primitive, Semantic::Joints(set)), accessor(primitive, Semantic::Weights(set)))
        else {
            break;
        };
        let joints = same_length(document.integers::<4>(joints)?, count, "joints", label)?;
        sets.push((joints, same_length(document.floats::<4>(weights)?, count, "weights", label)?));
    }
    if sets.is_empty() {
        return Ok(()); // an unskinned primitive under a skinned node: it moves with the node
    }
    let mut used = vec![false; count];
    for v in faces.iter().flatten() {
        used[*v as usize] = true;
    }
    for (vertex, &used) in used.iter().enumerate() {
        let start = out.bones.len();
        for (joints, weights) in &sets {
            for (&joint, &weight) in joints[vertex].iter().zip(&weights[vertex]) {
                match palette.get(joint as usize) {
                    _ if weight == 0.0 => {} // some exporters leave any joint there
                    Some(&joint) => add_bone(&mut out.bones, start, BoneWeight { joint, weight }),
                    None if used => {
                        let what = format!("vertex {vertex} of {label}");
                        return Err(FormatError::range(what, "joint", joint.into(), palette.len()));
                    }
                    None => {}
                }
            }
        }
        if let Err(problem) = normalise(&mut out.bones[start..]) {
            if used {
                return Err(FormatError::SkinWeights { vertex, mesh: label.into(), problem });
            }
            out.bones.truncate(start);
        }
        out.bone_ends.push(out.bones.len() as u32);
    }
    Ok(())
}

fn add_bone(bones: &mut Vec<BoneWeight>, start: usize, bone: BoneWeight) {
    match bones[start..].iter_mut().find(|b| b.joint == bone.joint) {
        Some(known) => known.weight += bone.weight,
        None => bones.push(bone),
    }
}

/// Scales weights to a sum of 1, in f64.
fn normalise(bones: &mut [BoneWeight]) -> Result<(), &'static str> {
    let sum: f64 = bones.iter().map(|b| f64::from(b.weight)).sum();
    if !sum.is_finite() || bones.iter().any(|b| b.weight < 0.0) {
        return Err("are negative or not finite");
    }
    if sum == 0.0 {
        return Err("sum to 0");
    }
    for bone in bones {
        bone.weight = (f64::from(bone.weight) / sum) as f32;
    }
    Ok(())
}
