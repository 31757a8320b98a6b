//! Positions that an edit asks for again and again while the tissue holds still.

use super::Tissue;
use crate::geometry::VertexId;
use crate::geometry::room::fit;
use glam::DVec3;
use std::cell::Cell;

/// Values by index (positions by vertex), each computed when first asked for and known for as long as `key` stays what it is.
#[derive(Clone, Debug, Default)]
pub(super) struct Rounds<K, T: Copy = DVec3> {
    values: Vec<Known<T>>,
    round: u32,
    key: K,
}

/// A value with the round in which it was computed.
#[derive(Clone, Debug, Default)]
struct Known<T: Copy> {
    value: Cell<T>,
    round: Cell<u32>,
}

impl<K: PartialEq, T: Copy + Default> Rounds<K, T> {
    /// To be called before values are asked for: forgets them if `key` is another, which it returns, and makes room for `slots`.
    pub(super) fn refresh(&mut self, key: K, slots: usize) -> bool {
        let is_new = self.round == 0 || key != self.key;
        if is_new {
            if self.round == u32::MAX {
                self.values.iter().for_each(|k| k.round.set(0));
                self.round = 0;
            }
            self.round += 1;
            self.key = key;
        }
        self.grow(slots);
        is_new
    }

    fn grow(&mut self, slots: usize) {
        fit(&mut self.values, slots, Known::default());
    }

    /// Makes room for so many values.
    pub(super) fn make_room(&mut self, slots: usize) {
        self.values.reserve(slots.saturating_sub(self.values.len()));
    }

    /// Forgets one value.
    pub(super) fn forget(&self, i: usize) {
        if let Some(known) = self.values.get(i) {
            known.round.set(0);
        }
    }

    /// Value `i`, from `compute` if it is not known. Those beyond the slots of the last refresh are computed.
    #[inline(always)]
    pub(super) fn get(&self, i: usize, compute: impl FnOnce() -> T) -> T {
        match self.values.get(i) {
            Some(known) if known.round.get() == self.round => known.value.get(),
            _ => self.find(i, compute),
        }
    }

    /// [`Rounds::get`] of one that is not known: apart from that, which is asked for each corner of many faces.
    #[inline(never)]
    fn find(&self, i: usize, compute: impl FnOnce() -> T) -> T {
        let value = compute();
        if let Some(known) = self.values.get(i) {
            known.value.set(value);
            known.round.set(self.round);
        }
        value
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

/// What is known of skinned vertices of a tissue as it stands, their positions for one: the corners of a box look along lines that are near
/// each other. No edit changes the row of a vertex that there was, but for undo and redo: [`Skins::forget`].
#[derive(Clone, Debug, Default)]
pub(super) struct Skins<T: Copy + Default = DVec3>(Rounds<u64, T>);

impl<T: Copy + Default> Skins<T> {
    /// Makes room for so many vertices.
    pub(super) fn make_room(&mut self, vertices: usize) {
        self.0.make_room(vertices);
    }

    /// Knows nothing any more.
    pub(super) fn forget(&mut self) {
        self.0.key = u64::MAX;
    }

    /// To be called before values are asked for: forgets them if the pose is another.
    pub(super) fn refresh(&mut self, tissue: &Tissue) {
        self.0.refresh(tissue.versions.pose, tissue.rows.len());
    }

    /// [`Rounds::get`].
    #[inline(always)]
    pub(super) fn get(&self, v: VertexId, compute: impl FnOnce() -> T) -> T {
        self.0.get(v.index(), compute)
    }
}

impl Skins {
    /// [`Tissue::skinned`] through the cache.
    #[inline]
    pub(super) fn of(&self, tissue: &Tissue, v: VertexId) -> DVec3 {
        self.get(v, || tissue.skinned(v))
    }
}
