//! Vertex rows: every vertex that an edit inserts is an affine combination of base vertices (MATHS 1.1, 1.2).
//!
//! *Base* vertices are those the model was loaded with (and promoted ones); they carry a rest position and bone weights.
//! All others are *embedded*: a sparse row of weights over base vertices that sums to 1, skinned as the same
//! combination of skinned positions, so they stay on the deformed surface in every pose.

use crate::geometry::room::rows_headroom;
use crate::geometry::{Delta, SlotCsr, SlotCsrDelta, StateHash, Tracked, VertexId};
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use std::collections::HashMap;

/// One term of an embedded vertex's row.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RowEntry {
    /// The base vertex.
    pub base: VertexId,
    /// Zero; keeps the layout explicit.
    pub padding: u32,
    /// Affine weight; those of a row sum to 1.
    pub weight: f64,
}

/// One bone of a base vertex.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct BoneWeight {
    /// Index into the pose's joint matrices.
    pub joint: u32,
    /// Weight; those of a vertex sum to 1.
    pub weight: f32,
}

/// Rest positions, bone weights and rows of all vertices of a tissue, indexed by [`VertexId`].
#[derive(Clone, Debug, Default)]
pub struct VertexRows {
    /// Rest position in tissue space, metres. Exact for base vertices; for embedded ones the row decides, and this is its
    /// rounded value.
    pub rest_position: Tracked<[f32; 3]>,
    /// Row of each vertex; empty for base vertices.
    pub rows: SlotCsr<RowEntry>,
    /// Bones of each base vertex; empty for embedded vertices and for those that no joint moves.
    pub bones: SlotCsr<BoneWeight>,
    /// The row that is being put together.
    pub(crate) scratch: Vec<RowEntry>,
}

/// What an edit changed in [`VertexRows`].
#[derive(Clone, Debug, Default)]
pub struct VertexRowsDelta {
    /// Changes of the rest positions.
    pub rest_position: Delta<[f32; 3]>,
    /// Changes of the rows.
    pub rows: SlotCsrDelta<RowEntry>,
    /// Changes of the bone weights.
    pub bones: SlotCsrDelta<BoneWeight>,
}

impl VertexRowsDelta {
    /// [`Delta::make_room`] for every list.
    pub fn make_room(&mut self, edits: usize) {
        self.rest_position.make_room(edits);
        self.rows.make_room(edits);
        self.bones.make_room(edits);
    }

    /// Adds what the next edit changed.
    pub fn append(&mut self, later: &Self) {
        self.rest_position.append(&later.rest_position);
        self.rows.append(&later.rows);
        self.bones.append(&later.bones);
    }
}

/// Terms of a row that is being made, as many as there is room for at first.
const ROW_ROOM: usize = 64;

impl VertexRows {
    /// Rows of a freshly loaded model: every vertex is a base vertex. `bones` has a row a vertex.
    pub fn from_base(rest_position: Vec<[f32; 3]>, bones: SlotCsr<BoneWeight>) -> Self {
        debug_assert_eq!(rest_position.len(), bones.rows());
        let vertices = rest_position.len();
        Self { rest_position: rest_position.into(), rows: SlotCsr::with_rows(vertices), bones, scratch: Vec::new() }
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.rest_position.len()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.rest_position.is_empty()
    }

    /// True for base vertices.
    #[inline]
    pub fn is_base(&self, v: VertexId) -> bool {
        self.rows.spans()[v.index()].len == 0
    }

    /// Rest position in f64: the stored one of a base vertex, the row's combination otherwise.
    pub fn rest(&self, v: VertexId) -> DVec3 {
        let row = self.rows.row(v.index());
        if row.is_empty() {
            return widen(self.rest_position[v.index()]);
        }
        row.iter().map(|e| widen(self.rest_position[e.base.index()]) * e.weight).sum()
    }

    /// Appends the embedded vertex `sum of weight * parent` (parents may be embedded themselves; weights sum to 1).
    /// Terms over the same base vertex are merged, exact zeros dropped, and the row kept sorted by base vertex.
    pub fn push_embedded(&mut self, parents: &[(VertexId, f64)]) -> VertexId {
        let entry = |base: VertexId, weight: f64| RowEntry { base, padding: 0, weight };
        match *parents {
            [(a, wa), (b, wb)] if self.is_base(a) && self.is_base(b) && a != b && wa != 0.0 && wb != 0.0 => {
                return self.push_row(&if a < b { [entry(a, wa), entry(b, wb)] } else { [entry(b, wb), entry(a, wa)] });
            }
            [(a, 1.0)] if self.is_base(a) => return self.push_row(&[entry(a, 1.0)]),
            [(a, 1.0)] => {
                let vertex = VertexId::new(self.rest_position.push(self.rest_position[a.index()]));
                self.rows.push_copy(a.index());
                self.bones.push_row(&[]);
                return vertex;
            }
            _ => {}
        }
        let mut row = std::mem::take(&mut self.scratch);
        row.clear();
        for &(parent, weight) in parents {
            let entries = self.rows.row(parent.index());
            if entries.is_empty() {
                merge(&mut row, parent, weight);
            }
            for entry in entries {
                merge(&mut row, entry.base, entry.weight * weight);
            }
        }
        row.retain(|e| e.weight != 0.0);
        row.sort_unstable_by_key(|e| e.base);
        let vertex = self.push_row(&row);
        self.scratch = row;
        vertex
    }

    fn push_row(&mut self, row: &[RowEntry]) -> VertexId {
        let rest: DVec3 = row.iter().map(|e| widen(self.rest_position[e.base.index()]) * e.weight).sum();
        let vertex = VertexId::new(self.rest_position.push(rest.as_vec3().to_array()));
        self.rows.push_row(row);
        self.bones.push_row(&[]);
        vertex
    }

    /// How many base vertices a combination of `parents` leans on.
    pub fn merged_len(&self, parents: &[(VertexId, f64)]) -> usize {
        let bases = || {
            parents.iter().flat_map(|&(parent, _)| {
                let row = self.rows.row(parent.index());
                row.iter().map(|e| e.base).chain(row.is_empty().then_some(parent))
            })
        };
        bases().enumerate().filter(|&(i, base)| bases().take(i).all(|b| b != base)).count()
    }

    /// Appends a base vertex: a corner inside the volume, or a vertex whose row has grown too long (MATHS 1.4).
    pub fn push_base(&mut self, rest: [f32; 3], bones: &[BoneWeight]) -> VertexId {
        let vertex = VertexId::new(self.rest_position.len());
        self.rest_position.push(rest);
        self.rows.push_row(&[]);
        self.bones.push_row(bones);
        vertex
    }

    /// Checks every row: sorted base parents, weights that sum to 1 to 1e-12, bones with weights that sum to 1 to 1e-4.
    pub fn validate(&self) -> Result<(), String> {
        if self.rows.rows() != self.len() || self.bones.rows() != self.len() {
            return Err("rows, bones and rest positions differ in length".into());
        }
        for v in 0..self.len() {
            let (row, bones) = (self.rows.row(v), self.bones.row(v));
            if row.windows(2).any(|w| w[0].base >= w[1].base) {
                return Err(format!("the row of vertex {v} is not sorted"));
            }
            if row.iter().any(|e| e.base.index() >= self.len() || !self.is_base(e.base)) {
                return Err(format!("vertex {v} leans on a vertex that is no base vertex"));
            }
            if !row.is_empty() && (row.iter().map(|e| e.weight).sum::<f64>() - 1.0).abs() > 1e-12 {
                return Err(format!("the weights of vertex {v} do not sum to 1"));
            }
            if !bones.is_empty() && (bones.iter().map(|b| f64::from(b.weight)).sum::<f64>() - 1.0).abs() > 1e-4 {
                return Err(format!("the bone weights of vertex {v} do not sum to 1"));
            }
            if !row.is_empty() && !bones.is_empty() {
                return Err(format!("embedded vertex {v} has bones"));
            }
            if self.rest_position[v].iter().any(|x| !x.is_finite()) {
                return Err(format!("the rest position of vertex {v} is not finite"));
            }
        }
        Ok(())
    }

    /// Makes room for what edits will append.
    pub fn make_room(&mut self) {
        self.rest_position.make_room();
        self.rows.make_room();
        // a base vertex has no terms of its own
        self.rows.reserve(0, rows_headroom(self.rest_position.len()));
        self.scratch.reserve(ROW_ROOM);
        self.bones.make_room();
    }

    /// Everything changed since the last call.
    pub fn take_delta(&mut self) -> VertexRowsDelta {
        let mut delta = VertexRowsDelta::default();
        self.take_delta_into(&mut delta);
        delta
    }

    /// The same into a delta whose room is used again.
    pub fn take_delta_into(&mut self, delta: &mut VertexRowsDelta) {
        self.rest_position.take_delta_into(&mut delta.rest_position);
        self.rows.take_delta_into(&mut delta.rows);
        self.bones.take_delta_into(&mut delta.bones);
    }

    /// Goes back by the newest delta and returns the way forward.
    pub fn apply_delta(&mut self, delta: VertexRowsDelta) -> VertexRowsDelta {
        VertexRowsDelta {
            rest_position: self.rest_position.apply(delta.rest_position),
            rows: self.rows.apply_delta(delta.rows),
            bones: self.bones.apply_delta(delta.bones),
        }
    }

    /// Feeds rows, rest positions and bones into `hash`.
    pub fn hash_into(&self, hash: &mut StateHash) {
        self.rest_position.hash_into(hash);
        self.rows.hash_into(hash);
        self.bones.hash_into(hash);
    }
}

fn merge(row: &mut Vec<RowEntry>, base: VertexId, weight: f64) {
    match row.iter_mut().find(|e| e.base == base) {
        Some(entry) => entry.weight += weight,
        None => row.push(RowEntry { base, padding: 0, weight }),
    }
}

pub(crate) fn widen(p: [f32; 3]) -> DVec3 {
    Vec3::from_array(p).as_dvec3()
}

/// The stored position nearest to `p` that is free: rounded, else a grain of the largest coordinate beside that. Rounded if none is.
pub(crate) fn rounded(p: DVec3, mut is_free: impl FnMut(&Vec3) -> bool) -> Vec3 {
    let nearest = p.as_vec3();
    if is_free(&nearest) {
        return nearest;
    }
    let grain = nearest.abs().max_element() * f32::EPSILON;
    let mut beside = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z].map(|axis| nearest + axis * grain);
    beside.sort_by(|a, b| a.as_dvec3().distance_squared(p).total_cmp(&b.as_dvec3().distance_squared(p)));
    beside.into_iter().find(is_free).unwrap_or(nearest)
}

/// Two positions no farther apart than this, as a fraction of the largest coordinate, are one place that was computed twice.
const SAME: f64 = 1e-12;

/// Rounds places so that no two of them share a stored position: where the nearest f32 is that of another place already, to the next.
#[derive(Debug, Default)]
pub(crate) struct RoundedApart {
    /// The place that each stored position is of; looked up only, so its order decides nothing.
    taken: HashMap<[u32; 3], DVec3>,
}

impl RoundedApart {
    /// The stored position of `p`: the same for the same place.
    pub fn round(&mut self, p: DVec3) -> Vec3 {
        rounded(p, |stored| {
            let key = (*stored + 0.0).to_array().map(f32::to_bits);
            p.distance(*self.taken.entry(key).or_insert(p)) <= SAME * p.abs().max_element()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle() -> VertexRows {
        VertexRows::from_base(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], SlotCsr::with_rows(3))
    }

    #[test]
    fn places_keep_apart() {
        let mut rounded = RoundedApart::default();
        let p = DVec3::new(0.7, 1e-9, -0.25);
        let first = rounded.round(p);
        assert_eq!((first, rounded.round(p), rounded.round(p + DVec3::Y * 1e-22)), (p.as_vec3(), first, first));
        let mut all = vec![first];
        for k in 1..7 {
            let near = p + DVec3::Z * 1e-11 * f64::from(k);
            let next = rounded.round(near);
            assert!(near.distance(next.as_dvec3()) < 1.5e-7 && !all.contains(&next), "{k}: {next}");
            all.push(next);
        }
    }

    #[test]
    fn rows_of_rows_lean_on_base_vertices() {
        let mut rows = triangle();
        let middle = rows.push_embedded(&[(VertexId(0), 0.5), (VertexId(1), 0.5)]);
        let inner = rows.push_embedded(&[(middle, 0.5), (VertexId(2), 0.5)]);
        assert_eq!(rows.rest(inner), DVec3::new(0.25, 0.5, 0.0));
        assert_eq!(rows.rows.row(inner.index()).len(), 3);
        assert_eq!(rows.validate(), Ok(()));
    }

    #[test]
    fn each_broken_rule_is_found() {
        let entry = |base, weight| RowEntry { base: VertexId(base), padding: 0, weight };
        let broken = |row: &[RowEntry]| {
            let mut rows = triangle();
            rows.push_embedded(&[(VertexId(0), 0.5), (VertexId(1), 0.5)]);
            rows.rows.set_row(3, row);
            rows.validate().unwrap_err()
        };
        assert!(broken(&[entry(1, 0.5), entry(0, 0.5)]).contains("sorted"));
        assert!(broken(&[entry(0, 0.5), entry(3, 0.5)]).contains("no base vertex"));
        assert!(broken(&[entry(0, 0.5), entry(1, 0.6)]).contains("sum to 1"));
        let mut rows = triangle();
        rows.rest_position.set(1, [f32::NAN; 3]);
        assert!(rows.validate().unwrap_err().contains("finite"));
        let mut rows = triangle();
        rows.bones.set_row(0, &[BoneWeight { joint: 0, weight: 0.5 }]);
        assert!(rows.validate().unwrap_err().contains("bone weights"));
    }
}
