//! What a reader hands to the assembler: stored vertices and faces, before topology is decided.

use crate::rig::BoneWeight;
use glam::DVec3;

/// Colour of a vertex without one.
pub(crate) const WHITE: u32 = u32::MAX;
/// [`Stored::marks`] of a vertex without a mark.
pub(crate) const NO_MARK: u32 = u32::MAX;

/// Refuses a vertex that f32 does not hold, with what to tell of it.
pub(crate) fn check_finite(at: DVec3) -> Result<(), &'static str> {
    if at.as_vec3().is_finite() { Ok(()) } else { Err("the vertex is not finite, or is beyond 3.4e38") }
}

/// Corner attributes of a stored face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Dress {
    /// Texture coordinates, v down.
    pub uv: [f32; 2],
    /// Unit normal at rest, or `None` to compute it.
    pub normal: Option<[f32; 3]>,
    /// RGBA8.
    pub colour: u32,
}

impl Dress {
    pub const PLAIN: Self = Self { uv: [0.0; 2], normal: None, colour: WHITE };
}

/// A face by stored indices.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StoredFace {
    /// Into [`Stored::positions`]: shared indices are shared topology.
    pub corners: [u32; 3],
    /// Into [`Stored::dresses`].
    pub dresses: [u32; 3],
    /// Into the model's materials.
    pub material: u32,
}

/// Everything a file stores about a surface. Positions are at rest in model space, f64.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stored {
    pub positions: Vec<DVec3>,
    /// `_INCISE_VERTEX` of each position, [`NO_MARK`] where it has none; equal marks are one vertex (MATHS 1.6).
    pub marks: Vec<u32>,
    /// Tells positions apart that are equal in numbers alone (see `gltf_import`); empty where none are.
    pub places: Vec<u32>,
    /// End of each position's run in `bones`.
    pub bone_ends: Vec<u32>,
    pub bones: Vec<BoneWeight>,
    /// Joints that leave vertices where they are: to follow one is to follow none. In order.
    pub still: Vec<u32>,
    pub dresses: Vec<Dress>,
    pub faces: Vec<StoredFace>,
    /// True if the stored indices alone decide the topology (our own OBJ files).
    pub indices_decide: bool,
}

impl Stored {
    /// Appends a position with its bones.
    pub fn push(&mut self, position: DVec3, mark: u32, bones: &[BoneWeight]) -> u32 {
        self.positions.push(position);
        self.marks.push(mark);
        self.bones.extend_from_slice(bones);
        self.bone_ends.push(self.bones.len() as u32);
        self.positions.len() as u32 - 1
    }

    /// Bones of a stored vertex.
    pub fn bones(&self, vertex: usize) -> &[BoneWeight] {
        let start = if vertex == 0 { 0 } else { self.bone_ends[vertex - 1] };
        &self.bones[start as usize..self.bone_ends[vertex] as usize]
    }
}
