//! The particle map's influences the other way round: the vertices that each particle holds, in blocks with bounds.

use super::lists::Lists;
use super::particle_map::{Influence, ParticleMap};
use crate::geometry::room::{fit, rows_headroom, with_headroom};
use crate::geometry::{ParticleId, StateHash, VertexId};
use glam::{DVec3, Vec3A};

/// Vertices a block.
const BLOCK: usize = 16;
/// Blocks that are looked at together first.
const BLOCKS: usize = 8;
/// Bounds of nothing.
const UNBOUNDED: [Vec3A; 2] = [Vec3A::INFINITY, Vec3A::NEG_INFINITY];

/// Vertices by particle. A superset, which makes it cheap to keep: what a particle has once held stays listed, so undo and redo change
/// nothing here, and who asks looks at the map too. What an undo takes back may be made again: only then is it looked for first.
#[derive(Clone, Debug, Default)]
pub(super) struct Holders {
    /// What each particle holds or has held.
    vertices: Lists<VertexId>,
    /// Bounds of each block of vertices at rest, rounded outwards.
    bounds: Lists<[Vec3A; 2]>,
    /// Bounds of each [`BLOCKS`] blocks.
    outer: Lists<[Vec3A; 2]>,
    /// Of each vertex whose row was noted after an undo or a redo that knew it, a hash of the row and of where the vertex was; 0 of others.
    noted: Vec<u64>,
    /// One more than the highest vertex ever listed, and the same at the last undo or redo.
    ends: usize,
    ends_before: usize,
}

impl Holders {
    /// From all influences of a map; blocks are of vertices that lie near each other.
    pub(super) fn build(map: &ParticleMap, rest: &[DVec3]) -> Self {
        let rows = map.influences.rows().min(rest.len());
        let (low, high) = rest[..rows].iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), &p| (l.min(p), h.max(p)));
        let scale = 1023.0 / (high - low).max_element().max(f64::MIN_POSITIVE);
        let mut order: Vec<(u32, u32)> = (0..rows).map(|v| (along_curve((rest[v] - low) * scale), v as u32)).collect();
        order.sort_unstable();
        // zeros that nothing has written to are no memory yet
        let mut holders = Self { noted: vec![0; with_headroom(rows)], ends: rows, ..Self::default() };
        let mut counts = vec![0; map.len()];
        (0..rows).flat_map(|v| map.influences.row(v)).for_each(|i| counts[i.particle.index()] += 1);
        for (j, &count) in counts.iter().enumerate() {
            let room: usize = count + count / 4 + BLOCK;
            holders.vertices.widen(j, room, VertexId::NONE);
            holders.bounds.widen(j, room.div_ceil(BLOCK), UNBOUNDED);
            holders.outer.widen(j, room.div_ceil(BLOCKS * BLOCK), UNBOUNDED);
        }
        holders.vertices.reserve(rows_headroom(holders.vertices.room()));
        holders.bounds.reserve(rows_headroom(holders.bounds.room()));
        holders.outer.reserve(rows_headroom(holders.outer.room()));
        for (_, v) in order {
            let at = rest[v as usize];
            let bounds = [below(at), above(at)];
            for influence in map.influences.row(v as usize) {
                holders.push(influence.particle, VertexId(v), bounds);
            }
        }
        holders
    }

    /// Notes the row of `v`, which is at `at`. What the row was before, `old`, is known. Both in order of particles; were they not,
    /// some would be listed twice.
    pub(super) fn note_row(&mut self, v: VertexId, at: DVec3, row: &[Influence], mut old: &[Influence]) {
        let may_be_listed = v.index() < self.ends_before;
        self.ends = self.ends.max(v.index() + 1);
        if may_be_listed {
            fit(&mut self.noted, self.ends_before, 0);
            let hash = row_hash(at, row);
            if std::mem::replace(&mut self.noted[v.index()], hash) == hash {
                return;
            }
        }
        let bounds = [below(at), above(at)];
        for influence in row {
            let j = influence.particle;
            while let [first, rest @ ..] = old
                && first.particle < j
            {
                old = rest;
            }
            let is_known = old.first().is_some_and(|o| o.particle == j) || may_be_listed && self.lists(j, v, at);
            if !is_known {
                self.push(j, v, bounds);
            }
        }
    }

    /// Notes that `j` holds `v`, with the bounds of where that is.
    fn push(&mut self, j: ParticleId, v: VertexId, at: [Vec3A; 2]) {
        let (j, held) = (j.index(), self.vertices.get(j.index()).len());
        for (bounds, of) in [(&mut self.bounds, BLOCK), (&mut self.outer, BLOCKS * BLOCK)] {
            if held.is_multiple_of(of) {
                bounds.push(j, at);
            } else if let Some([low, high]) = bounds.get_mut(j).last_mut() {
                (*low, *high) = (low.min(at[0]), high.max(at[1]));
            }
        }
        self.vertices.push(j, v);
    }

    /// To be called after an undo or a redo: what comes may be listed already.
    pub(super) fn note_travel(&mut self) {
        self.ends_before = self.ends;
    }

    /// Number of vertices that a particle has listed, with those listed twice.
    #[cfg(test)]
    pub(super) fn count(&self, j: ParticleId) -> usize {
        self.vertices.get(j.index()).len()
    }

    /// True if `j` is known to hold `v`, at `at`.
    pub(super) fn lists(&self, j: ParticleId, v: VertexId, at: DVec3) -> bool {
        let mut is_listed = false;
        self.visit(j, at, at, |w| is_listed |= w == v);
        is_listed
    }

    /// Calls `found` for the vertices of the particle's blocks that meet a box, in the order they were noted; some lie outside, some
    /// come twice, some are held no more.
    pub(super) fn visit(&self, j: ParticleId, low: DVec3, high: DVec3, found: impl FnMut(VertexId)) {
        self.visit_seen(j, low, high, |_, _| true, found);
    }

    /// [`Holders::visit`] without the blocks whose bounds do not meet a second condition.
    pub(super) fn visit_seen(
        &self,
        j: ParticleId,
        low: DVec3,
        high: DVec3,
        is_seen: impl Fn(Vec3A, Vec3A) -> bool,
        mut found: impl FnMut(VertexId),
    ) {
        let (low, high) = (below(low), above(high));
        let meets = |&[from, to]: &[Vec3A; 2]| (from.cmple(high) & to.cmpge(low)).all() && is_seen(from, to);
        let (vertices, bounds) = (self.vertices.get(j.index()), self.bounds.get(j.index()));
        let outer = vertices.chunks(BLOCKS * BLOCK).zip(bounds.chunks(BLOCKS)).zip(self.outer.get(j.index()));
        for ((vertices, bounds), _) in outer.filter(|(_, bounds)| meets(bounds)) {
            for (block, _) in vertices.chunks(BLOCK).zip(bounds).filter(|(_, bounds)| meets(bounds)) {
                for &v in block {
                    found(v);
                }
            }
        }
    }
}

/// Vertices in the order they were noted, each once.
#[derive(Clone, Debug, Default)]
pub(super) struct VertexSet {
    listed: Vec<VertexId>,
    /// A bit a vertex.
    bits: Vec<u64>,
}

impl VertexSet {
    /// Makes room for so many of vertices below a number.
    pub(super) fn reserve(&mut self, listed: usize, vertices: usize) {
        self.listed.reserve(listed);
        self.bits.reserve(vertices.div_ceil(64));
    }

    pub(super) fn insert(&mut self, v: VertexId) {
        let (word, bit) = (v.index() / 64, 1 << (v.index() % 64));
        if self.bits.len() <= word {
            self.bits.resize(word + 1, 0);
        }
        if self.bits[word] & bit == 0 {
            self.bits[word] |= bit;
            self.listed.push(v);
        }
    }

    pub(super) fn contains(&self, v: VertexId) -> bool {
        self.bits.get(v.index() / 64).is_some_and(|word| word >> (v.index() % 64) & 1 == 1)
    }

    pub(super) fn iter(&self) -> std::slice::Iter<'_, VertexId> {
        self.listed.iter()
    }
}

impl FromIterator<VertexId> for VertexSet {
    fn from_iter<I: IntoIterator<Item = VertexId>>(vertices: I) -> Self {
        let mut set = Self::default();
        set.extend(vertices);
        set
    }
}

impl Extend<VertexId> for VertexSet {
    fn extend<I: IntoIterator<Item = VertexId>>(&mut self, vertices: I) {
        vertices.into_iter().for_each(|v| self.insert(v));
    }
}

fn row_hash(at: DVec3, row: &[Influence]) -> u64 {
    let mut hash = StateHash::default();
    at.to_array().iter().for_each(|x| hash.word(x.to_bits()));
    row.iter().for_each(|i| hash.word(i.particle.0.into()));
    hash.finish()
}

/// Beyond every coordinate, and finite: what is added to it or taken off keeps it so.
const FAR_OFF: Vec3A = Vec3A::splat(1e38);

/// More than an f32 rounds by, with the rounding of that.
fn rounding(p: Vec3A) -> Vec3A {
    p.abs() * (2.0 * f32::EPSILON) + f32::MIN_POSITIVE
}

/// No higher in any coordinate, as f32; what is infinite becomes 1e38 or so.
#[inline]
pub(super) fn below(p: DVec3) -> Vec3A {
    let p = p.as_vec3a().clamp(-FAR_OFF, FAR_OFF);
    p - rounding(p)
}

/// No lower in any coordinate, as f32; what is infinite becomes 1e38 or so.
#[inline]
pub(super) fn above(p: DVec3) -> Vec3A {
    let p = p.as_vec3a().clamp(-FAR_OFF, FAR_OFF);
    p + rounding(p)
}

/// Place along the Z-order curve of a point with coordinates from 0 to 1023; others are clamped.
fn along_curve(p: DVec3) -> u32 {
    let spread = |x: f64| {
        let mut x = (x as u32).min(1023);
        x = (x | x << 16) & 0x0300_00ff;
        x = (x | x << 8) & 0x0300_f00f;
        x = (x | x << 4) & 0x030c_30c3;
        (x | x << 2) & 0x0924_9249
    };
    spread(p.x) | spread(p.y) << 1 | spread(p.z) << 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_rounded_outwards() {
        let values = [0.0, 1.0, 0.1, -0.1, 1.0 / 3.0, 1e12, -1e12 / 3.0, 1e-30, 1e-40, 3.7e-46, f64::MIN_POSITIVE, f64::INFINITY];
        for x in values.into_iter().chain((1..2000).map(|i| f64::from(i).sqrt() / 77.0)) {
            for x in [x, -x] {
                let [low, high] = [below(DVec3::splat(x)).x, above(DVec3::splat(x)).x].map(f64::from);
                assert!(low.is_finite() && high.is_finite() && low < high, "{x}: {low} {high}");
                assert!(x.is_infinite() || (low <= x && x <= high && high - low <= 1e-6 * x.abs() + 1e-37), "{x}: {low} {high}");
            }
        }
    }

    #[test]
    fn what_is_done_again_after_an_undo_is_not_listed_again() {
        let mut holders = Holders::default();
        let row = [3, 5].map(|j| Influence { particle: ParticleId(j), weight: 0.5 });
        let (v, at) = (VertexId(7), DVec3::new(0.1, 0.2, 0.3));
        let counts = |holders: &Holders| [3, 5].map(|j| holders.count(ParticleId(j)));
        holders.note_row(v, at, &row[..1], &[]);
        holders.note_row(v, at, &row, &row[..1]);
        assert_eq!(counts(&holders), [1, 1]);
        for _ in 0..3 {
            holders.note_travel();
            holders.note_row(v, at, &row, &[]); // the same again
            holders.note_row(v, at, &row[1..], &[]); // another row of what is listed
            assert_eq!(counts(&holders), [1, 1]);
        }
        // elsewhere it must be found there too
        holders.note_row(v, at + 1.0, &row, &[]);
        assert_eq!(counts(&holders), [2, 2]);
        assert!(holders.lists(ParticleId(5), v, at + 1.0) && !holders.lists(ParticleId(4), v, at));
        // a vertex that no undo has passed is listed without a look
        holders.note_row(VertexId(8), at, &row, &[]);
        assert_eq!(counts(&holders), [3, 3]);
    }
}
