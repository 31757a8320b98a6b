//! What the GPU layer is shown of a tissue, and what changed in it: plain borrowed data, so that it depends on no owner.

use super::error::GpuError;
use crate::geometry::{Delta, Mesh, MeshDelta, Turn};
use crate::particles::{ParticleMap, ParticleMapDelta};
use crate::rig::{Pose, VertexRows, VertexRowsDelta};
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
    /// See [`crate::rig::Fades::written`]; none at all: each of them may be another than it was.
    pub fades_written: &'a [u64],
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
        let mut ranges = DirtyRanges::default();
        ranges.lists().into_iter().for_each(|list| list.reserve(RANGES));
        Self::Ranges(ranges)
    }

    /// What an edit changed.
    pub fn from_deltas(mesh: &MeshDelta, rows: &VertexRowsDelta, map: &ParticleMapDelta) -> Self {
        let mut ranges = DirtyRanges::default();
        ranges.add(mesh, rows, map);
        ranges.settle();
        Self::Ranges(ranges)
    }

    /// What several edits changed, in the lists that were there before.
    pub fn gather<'a>(&mut self, edits: impl Iterator<Item = (&'a MeshDelta, &'a VertexRowsDelta, &'a ParticleMapDelta)>) {
        if let Self::Full = self {
            *self = Self::clean();
        }
        if let Self::Ranges(ranges) = self {
            ranges.lists().into_iter().for_each(|list| list.clear());
            edits.for_each(|(mesh, rows, map)| ranges.add(mesh, rows, map));
            ranges.settle();
        }
    }
}

/// Ranges of a frame's edits that each list has room for at first.
const RANGES: usize = 4096;

impl DirtyRanges {
    fn lists(&mut self) -> [&mut Vec<Range<usize>>; 6] {
        let Self { vertices, bones, rows, influences, faces, wedges } = self;
        [vertices, bones, rows, influences, faces, wedges]
    }

    /// Lists what an edit changed, as it comes.
    fn add(&mut self, mesh: &MeshDelta, rows: &VertexRowsDelta, map: &ParticleMapDelta) {
        fn note<T: Copy>(list: &mut Vec<Range<usize>>, delta: &Delta<T>) {
            delta.touched_ranges().for_each(|range| match list.last_mut() {
                // what is written next to each other is mostly noted in that order
                Some(last) if (last.start..=last.end).contains(&range.start) => last.end = last.end.max(range.end),
                _ => list.push(range),
            });
        }
        note(&mut self.vertices, &mesh.vertex_half_edge);
        note(&mut self.vertices, &rows.rest_position);
        note(&mut self.vertices, &rows.rows.spans);
        note(&mut self.vertices, &rows.bones.spans);
        note(&mut self.vertices, &map.influences.spans);
        note(&mut self.bones, &rows.bones.entries);
        note(&mut self.rows, &rows.rows.entries);
        note(&mut self.influences, &map.influences.entries);
        note(&mut self.faces, &mesh.faces);
        note(&mut self.faces, &mesh.face_wedges);
        note(&mut self.faces, &mesh.opposite);
        note(&mut self.faces, &mesh.face_info);
        note(&mut self.wedges, &mesh.wedges);
    }

    /// Sorts the lists and merges what is near each other.
    fn settle(&mut self) {
        self.lists().into_iter().for_each(unite);
    }
}

/// Sorts ranges and merges those with no more than [`GAP`] between them.
fn unite(ranges: &mut Vec<Range<usize>>) {
    ranges.sort_unstable_by_key(|r| r.start);
    ranges.dedup_by(|next, last| {
        let is_near = next.start <= last.end + GAP;
        if is_near {
            last.end = last.end.max(next.end);
        }
        is_near
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unions_cover_and_merge() {
        let united = |mut ranges: Vec<Range<usize>>| {
            unite(&mut ranges);
            ranges
        };
        assert_eq!(united(vec![40..50, 200..210, 0..5, 45..60]), [0..5, 40..60, 200..210]);
        let joined = |start: usize| united(vec![0..5, start..start + 3]).len();
        assert_eq!((joined(5 + GAP), joined(6 + GAP)), (1, 2));
    }

    #[test]
    fn what_is_gathered_takes_the_place_of_what_was() {
        let mut dirty = TissueDirty::Ranges(DirtyRanges { wedges: vec![3..4, 3..4], ..Default::default() });
        let (mesh, rows, map) = Default::default();
        for _ in 0..2 {
            dirty.gather([(&mesh, &rows, &map)].into_iter());
            assert!(matches!(&dirty, TissueDirty::Ranges(r) if *r == DirtyRanges::default()));
            dirty = TissueDirty::Full;
        }
    }
}
