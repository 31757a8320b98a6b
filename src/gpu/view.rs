//! What the GPU layer is shown of a tissue, and what changed in it: plain borrowed data, so that it depends on no owner.

use super::error::GpuError;
use crate::geometry::{Mesh, MeshDelta, SlotCsrDelta, Turn};
use crate::particles::{ParticleMap, ParticleMapDelta};
use crate::rig::{Pose, VertexRows, VertexRowsDelta};
use bytemuck::Pod;
use glam::{DAffine3, DVec3};
use std::ops::Range;

/// A picture for a material, RGBA8, sRGB, rows from the top.
#[derive(Clone, Copy, Debug)]
pub struct TextureView<'a> {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height * 4` bytes.
    pub rgba: &'a [u8],
}

/// How a surface answers light.
#[derive(Clone, Copy, Debug)]
pub struct MaterialView<'a> {
    /// Linear RGBA factor.
    pub base_colour: [f32; 4],
    /// Base colour texture.
    pub texture: Option<TextureView<'a>>,
    /// Roughness under the film, 0 to 1.
    pub roughness: f32,
    /// 0 dry, 1 under a film of water.
    pub wetness: f32,
    /// 0 opaque, 1 flesh.
    pub scatter: f32,
}

impl MaterialView<'_> {
    /// Moist flesh: what a model without materials is made of.
    pub const FLESH: Self =
        Self { base_colour: [0.27, 0.058, 0.047, 1.0], texture: None, roughness: 0.48, wetness: 0.8, scatter: 1.0 };
}

/// Numbers that change when an array does; equal numbers mean that nothing has to be uploaded or run again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ViewVersions {
    /// Of the joint matrices.
    pub pose: u64,
    /// Of the displacements.
    pub displacements: u64,
    /// Of the fades.
    pub fades: u64,
    /// Of the rotations.
    pub rotations: u64,
    /// Of the materials.
    pub materials: u64,
}

/// One tissue as the GPU sees it. V vertices, P particles.
#[derive(Clone, Copy, Debug)]
pub struct TissueView<'a> {
    /// Topology and wedges.
    pub mesh: &'a Mesh,
    /// Rest positions, bones, rows (V).
    pub rows: &'a VertexRows,
    /// Influences (V rows). An empty map, of no rows, stands for a tissue without particles.
    pub map: &'a ParticleMap,
    /// Displacement `u` of each particle, tissue space, metres (P).
    pub displacements: &'a [DVec3],
    /// Turn of each particle about its skinned anchor (P), or none at all (MATHS 2.1).
    pub rotations: &'a [Turn],
    /// `c` in the rest frame and start time in seconds, for each vertex (V), or none at all (MATHS 2.2).
    pub fades: &'a [[f32; 4]],
    /// How long a fade takes, seconds.
    pub fade_duration_s: f64,
    /// The time, on the clock of the fades' start times.
    pub time_s: f64,
    /// Joint matrices.
    pub pose: &'a Pose,
    /// Materials, by [`crate::geometry::FaceInfo::material`]. Empty: flesh.
    pub materials: &'a [MaterialView<'a>],
    /// Diagonal of the model it comes from, metres: what the size of surface detail is measured by, so that a piece looks as
    /// it did before it came off.
    pub diagonal: f64,
    /// Where the tissue stands.
    pub world_from_tissue: DAffine3,
    /// See [`ViewVersions`].
    pub versions: ViewVersions,
}

impl TissueView<'_> {
    /// Checks that the slices fit together, at a cost that does not grow with the model.
    pub fn check(&self) -> Result<(), GpuError> {
        let vertices = self.mesh.vertex_slots();
        let expect = |what: &str, has: usize, wants: usize| {
            if has == wants { Ok(()) } else { Err(GpuError::BadView(format!("{what}: {has} entries where {wants} belong"))) }
        };
        expect("rows", self.rows.len(), vertices)?;
        expect("bones", self.rows.bones.rows(), vertices)?;
        expect("row spans", self.rows.rows.rows(), vertices)?;
        if self.map.influences.rows() != 0 {
            expect("influences", self.map.influences.rows(), vertices)?;
        }
        expect("displacements", self.displacements.len(), self.map.len())?;
        if !self.rotations.is_empty() {
            expect("rotations", self.rotations.len(), self.map.len())?;
        }
        if !self.fades.is_empty() {
            expect("fades", self.fades.len(), vertices)?;
        }
        if self.materials.len() > MAX_MATERIALS {
            return Err(GpuError::BadView(format!("{} materials where {MAX_MATERIALS} are the most", self.materials.len())));
        }
        match self.materials.iter().filter_map(|m| m.texture).find(|t| !t.is_sound()) {
            Some(t) => Err(GpuError::BadView(format!("a texture of {} x {} has {} bytes", t.width, t.height, t.rgba.len()))),
            None => Ok(()),
        }
    }
}

impl TextureView<'_> {
    fn is_sound(&self) -> bool {
        let bytes = u64::from(self.width) * u64::from(self.height) * 4;
        bytes > 0 && bytes == self.rgba.len() as u64
    }
}

/// A face's material is 16 bits wide on the GPU.
pub const MAX_MATERIALS: usize = 1 << 16;

/// What changed in a tissue's structure since the last sync. Poses, displacements, rotations and fades are told by their versions.
#[derive(Clone, Debug)]
pub enum TissueDirty {
    /// Everything, or the tissue is new.
    Full,
    /// These entries only; empty for none.
    Ranges(DirtyRanges),
}

/// Entries that changed, by array. Ranges may reach past an array's end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DirtyRanges {
    /// Vertices whose rest position, half-edge, or any span changed.
    pub vertices: Vec<Range<usize>>,
    /// Entries of the bone arena.
    pub bones: Vec<Range<usize>>,
    /// Entries of the row arena.
    pub rows: Vec<Range<usize>>,
    /// Entries of the influence arena.
    pub influences: Vec<Range<usize>>,
    /// Face slots whose wedges, opposites or info changed.
    pub faces: Vec<Range<usize>>,
    /// Wedges.
    pub wedges: Vec<Range<usize>>,
}

/// Gaps of clean entries that are uploaded rather than split around.
const GAP: usize = 16;

impl TissueDirty {
    /// Nothing changed.
    pub fn clean() -> Self {
        Self::Ranges(DirtyRanges::default())
    }

    /// What an edit changed.
    pub fn from_deltas(mesh: &MeshDelta, rows: &VertexRowsDelta, map: &ParticleMapDelta) -> Self {
        fn spans<T: Copy + Pod>(delta: &SlotCsrDelta<T>) -> Vec<Range<usize>> {
            delta.spans.dirty_ranges(GAP)
        }
        let ranges = DirtyRanges {
            vertices: union([
                mesh.vertex_half_edge.dirty_ranges(GAP),
                rows.rest_position.dirty_ranges(GAP),
                spans(&rows.rows),
                spans(&rows.bones),
                spans(&map.influences),
            ]),
            bones: rows.bones.entries.dirty_ranges(GAP),
            rows: rows.rows.entries.dirty_ranges(GAP),
            influences: map.influences.entries.dirty_ranges(GAP),
            faces: union([mesh.face_wedges.dirty_ranges(GAP), mesh.opposite.dirty_ranges(GAP), mesh.face_info.dirty_ranges(GAP)]),
            wedges: mesh.wedges.dirty_ranges(GAP),
        };
        Self::Ranges(ranges)
    }

    /// Adds what a later edit changed.
    pub fn merge(&mut self, later: Self) {
        match (&mut *self, later) {
            (Self::Full, _) => {}
            (_, Self::Full) => *self = Self::Full,
            (Self::Ranges(a), Self::Ranges(b)) => {
                let join = |a: &mut Vec<Range<usize>>, b| *a = union([std::mem::take(a), b]);
                join(&mut a.vertices, b.vertices);
                join(&mut a.bones, b.bones);
                join(&mut a.rows, b.rows);
                join(&mut a.influences, b.influences);
                join(&mut a.faces, b.faces);
                join(&mut a.wedges, b.wedges);
            }
        }
    }
}

/// Sorted, merged ranges that cover all lists.
fn union<const N: usize>(lists: [Vec<Range<usize>>; N]) -> Vec<Range<usize>> {
    let mut all: Vec<Range<usize>> = lists.into_iter().flatten().filter(|r| !r.is_empty()).collect();
    all.sort_unstable_by_key(|r| r.start);
    let mut merged: Vec<Range<usize>> = Vec::with_capacity(all.len());
    for range in all {
        match merged.last_mut() {
            Some(last) if range.start <= last.end + GAP => last.end = last.end.max(range.end),
            _ => merged.push(range),
        }
    }
    merged
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unions_cover_and_merge() {
        assert_eq!(union([vec![40..50, 200..210], vec![0..5, 45..60]]), [0..5, 40..60, 200..210]);
        let joined = |start: usize| union([vec![0..5, start..start + 3], Vec::new()]).len();
        assert_eq!((joined(5 + GAP), joined(6 + GAP)), (1, 2));
    }

    #[test]
    fn full_stays_full() {
        let mut dirty = TissueDirty::clean();
        dirty.merge(TissueDirty::Ranges(DirtyRanges { wedges: union([vec![3..4, 3..4]]), ..Default::default() }));
        assert!(matches!(&dirty, TissueDirty::Ranges(r) if r.wedges.len() == 1 && r.wedges[0] == (3..4)));
        dirty.merge(TissueDirty::Full);
        dirty.merge(TissueDirty::clean());
        assert!(matches!(dirty, TissueDirty::Full));
    }
}
