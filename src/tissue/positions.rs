//! Positions that an edit asks for again and again while the tissue holds still.

use super::Tissue;
use crate::geometry::VertexId;
use crate::geometry::room::fit;
use glam::DVec3;
use std::cell::Cell;

/// Positions by vertex, each computed when first asked for and known for as long as `key` stays what it is.
#[derive(Clone, Debug, Default)]
pub(super) struct Rounds<K> {
    at: Vec<Cell<DVec3>>,
    /// The round in which each was computed.
    known: Vec<Cell<u32>>,
    round: u32,
    key: K,
}

impl<K: PartialEq> Rounds<K> {
    /// To be called before positions are asked for: forgets them if `key` is another, and makes room for vertices.
    pub(super) fn refresh(&mut self, key: K, slots: usize) {
        if self.round == 0 || key != self.key {
            if self.round == u32::MAX {
                self.known.iter().for_each(|k| k.set(0));
                self.round = 0;
            }
            self.round += 1;
            self.key = key;
        }
        self.grow(slots);
    }

    fn grow(&mut self, slots: usize) {
        fit(&mut self.known, slots, Cell::new(0));
        fit(&mut self.at, slots, Cell::new(DVec3::ZERO));
    }

    /// The position of `v`, from `compute` if it is not known. Vertices made since the last refresh are computed.
    #[inline]
    pub(super) fn get(&self, v: VertexId, compute: impl FnOnce() -> DVec3) -> DVec3 {
        let Some(known) = self.known.get(v.index()) else { return compute() };
        if known.get() != self.round {
            self.at[v.index()].set(compute());
            known.set(self.round);
        }
        self.at[v.index()].get()
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
        changed.for_each(|v| self.0.known[v.index()].set(0));
        self.0.key = Self::moment(tissue);
    }

    /// [`Rounds::get`].
    #[inline]
    pub(super) fn get(&self, v: VertexId, compute: impl FnOnce() -> DVec3) -> DVec3 {
        self.0.get(v, compute)
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
        self.0.get(v, || tissue.skinned(v))
    }
}
