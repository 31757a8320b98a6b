//! Positions that an edit asks for again and again while the tissue holds still.

use super::Tissue;
use crate::geometry::VertexId;
use crate::geometry::room::fit;
use glam::DVec3;
use std::cell::Cell;

/// Values by index (positions by vertex), each computed when first asked for and known for as long as `key` stays what it is.
#[derive(Clone, Debug, Default)]
pub(super) struct Rounds<K, T: Copy = DVec3> {
    at: Vec<Cell<T>>,
    /// The round in which each was computed.
    known: Vec<Cell<u32>>,
    round: u32,
    key: K,
}

impl<K: PartialEq, T: Copy + Default> Rounds<K, T> {
    /// To be called before values are asked for: forgets them if `key` is another, which it returns, and makes room for `slots`.
    pub(super) fn refresh(&mut self, key: K, slots: usize) -> bool {
        let is_new = self.round == 0 || key != self.key;
        if is_new {
            if self.round == u32::MAX {
                self.known.iter().for_each(|k| k.set(0));
                self.round = 0;
            }
            self.round += 1;
            self.key = key;
        }
        self.grow(slots);
        is_new
    }

    fn grow(&mut self, slots: usize) {
        fit(&mut self.known, slots, Cell::new(0));
        fit(&mut self.at, slots, Cell::new(T::default()));
    }

    /// Makes room for so many values.
    pub(super) fn make_room(&mut self, slots: usize) {
        self.known.reserve(slots.saturating_sub(self.known.len()));
        self.at.reserve(slots.saturating_sub(self.at.len()));
    }

    /// Forgets one value.
    pub(super) fn forget(&self, i: usize) {
        if let Some(known) = self.known.get(i) {
            known.set(0);
        }
    }

    /// Value `i`, from `compute` if it is not known. Those beyond the slots of the last refresh are computed.
    #[inline]
    pub(super) fn get(&self, i: usize, compute: impl FnOnce() -> T) -> T {
        let Some(known) = self.known.get(i) else { return compute() };
        if known.get() != self.round {
            self.at[i].set(compute());
            known.set(self.round);
        }
        self.at[i].get()
    }
}

/// What all final positions depend on together: versions of pose, displacements, rotations and fades, and the clock while vertices fade.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Moment {
    pose: u64,
    displacements: u64,
    rotations: u64,
    fades: u64,
    time_bits: u64,
}

/// Positions as [`Tissue::position`] gives them, bit for bit. Empties itself when the tissue moves; an edit has to say which
/// vertices it concerned.
#[derive(Debug, Default)]
pub(super) struct PositionCache(Rounds<Moment>);

impl PositionCache {
    fn moment(tissue: &Tissue) -> Moment {
        let time_s = if tissue.fades.running(tissue.time_s) { tissue.time_s } else { 0.0 };
        let versions = tissue.versions;
        Moment {
            pose: versions.pose,
            displacements: versions.displacements,
            rotations: versions.rotations,
            fades: versions.fades,
            time_bits: time_s.to_bits(),
        }
    }

    /// Knows nothing any more.
    pub(super) fn forget(&mut self) {
        self.0.key.pose = u64::MAX;
    }

    /// To be called before positions are asked for: forgets them if the tissue has moved, and makes room for new vertices.
    pub(super) fn refresh(&mut self, tissue: &Tissue) {
        self.0.refresh(Self::moment(tissue), tissue.mesh.vertex_slots());
    }

    /// An edit that has just ended: `changed` vertices (removed ones may be left out) are computed anew, all others stand where they
    /// stood.
    pub(super) fn edited(&mut self, tissue: &Tissue, changed: impl Iterator<Item = VertexId>) {
        self.0.grow(tissue.mesh.vertex_slots());
        changed.for_each(|v| self.0.forget(v.index()));
        self.0.key = Self::moment(tissue);
    }

    /// [`Rounds::get`].
    #[inline]
    pub(super) fn get(&self, v: VertexId, compute: impl FnOnce() -> DVec3) -> DVec3 {
        self.0.get(v.index(), compute)
    }

    /// [`Tissue::position`] through the cache.
    #[inline]
    pub(super) fn of(&self, tissue: &Tissue, v: VertexId) -> DVec3 {
        self.get(v, || tissue.position(v))
    }
}

/// Skinned positions of a tissue as it stands: the corners of a box look along lines that are near each other. No edit changes the
/// row of a vertex that there was, but for undo and redo: [`Skins::forget`].
#[derive(Clone, Debug, Default)]
pub(super) struct Skins(Rounds<u64>);

impl Skins {
    /// Makes room for so many vertices.
    pub(super) fn make_room(&mut self, vertices: usize) {
        self.0.make_room(vertices);
    }

    /// Knows nothing any more.
    pub(super) fn forget(&mut self) {
        self.0.key = u64::MAX;
    }

    /// To be called before positions are asked for: forgets them if the pose is another.
    pub(super) fn refresh(&mut self, tissue: &Tissue) {
        self.0.refresh(tissue.versions.pose, tissue.rows.len());
    }

    /// [`Tissue::skinned`] through the cache.
    #[inline]
    pub(super) fn of(&self, tissue: &Tissue, v: VertexId) -> DVec3 {
        self.0.get(v.index(), || tissue.skinned(v))
    }
}
