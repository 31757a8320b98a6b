//! Final positions on the CPU: `f = s + sum w (u + (R - I)(s - a)) + alpha A c` (MATHS 2.1, 2.2), the f64 twin of
//! `shaders/deform.wgsl`.

use super::rows::VertexRows;
use super::skinning::Pose;
use crate::geometry::room::with_headroom;
use crate::geometry::{Turn, VertexId};
use glam::{DVec3, Vec3};
use std::ops::Range;

/// Entries of [`Fades`] whose changes are told together.
pub const FADE_BLOCK: usize = 64;

/// Offsets that hold inserted and reweighted vertices where they were at the instant of an edit, and fade (MATHS 2.2).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fades {
    entries: Vec<[f32; 4]>,
    written: Vec<u64>,
    writes: u64,
    /// Zeros for the first fade: no memory before they are written to.
    room: Vec<[f32; 4]>,
    /// When the last one ends, seconds.
    pub end_s: f64,
    /// How long one takes, seconds; 0: offsets stay for good.
    pub duration_s: f64,
    /// No `c` of those that run is longer, metres.
    pub longest: f64,
}

impl Fades {
    /// Fades that take `duration_s`; no vertex has one.
    pub fn new(duration_s: f64) -> Self {
        Self { duration_s, ..Self::default() }
    }

    /// Makes room for the first fade of so many vertices.
    pub fn make_room(&mut self, vertices: usize) {
        let all = with_headroom(vertices);
        if self.entries.is_empty() && self.room.len() < vertices {
            self.room = vec![[0.0; 4]; all];
        }
        self.written.reserve(all.div_ceil(FADE_BLOCK).saturating_sub(self.written.len()));
    }

    /// `c` in the rest frame (metres) and the start time (seconds) of each vertex; zero `c` for none. Empty: no vertex fades.
    pub fn entries(&self) -> &[[f32; 4]] {
        &self.entries
    }

    /// A number for each [`FADE_BLOCK`] entries, which becomes larger than all others whenever one of them is written; 0 for blocks
    /// that never were.
    pub fn written(&self) -> &[u64] {
        &self.written
    }

    /// The same rules and times for the vertices of a piece, which were `from` here.
    pub fn extract(&self, from: &[VertexId]) -> Self {
        let mut piece = Self { writes: self.writes, end_s: self.end_s, longest: self.longest, ..Self::new(self.duration_s) };
        if !self.entries.is_empty() {
            let known = |v: &VertexId| self.entries.get(v.index()).copied().unwrap_or_default();
            piece.entries.extend(from.iter().map(known));
            piece.note(0..from.len());
        }
        piece
    }

    /// To be called after vertices have come or gone at the end: there are `vertices` now. Those that come have no fade.
    pub fn follow(&mut self, vertices: usize) {
        let known = self.entries.len();
        if known > 0 && known != vertices {
            self.entries.resize(vertices, [0.0; 4]);
            self.note(known.min(vertices)..vertices);
        }
    }

    /// Remembers that entries were written.
    fn note(&mut self, entries: Range<usize>) {
        self.writes += 1;
        self.written.resize(self.entries.len().div_ceil(FADE_BLOCK), 0);
        self.written[entries.start / FADE_BLOCK..entries.end.div_ceil(FADE_BLOCK)].fill(self.writes);
    }

    /// Weight of a fade that began at `start`: a smoothstep from 1 to 0.
    pub fn alpha(&self, start: f32, time_s: f64) -> f64 {
        if self.duration_s <= 0.0 { 1.0 } else { Self::weight(start, time_s, self.duration_s) }
    }

    /// [`Fades::alpha`] of a fade that takes `duration_s`; 0 if that is no time.
    pub fn weight(start: f32, time_s: f64, duration_s: f64) -> f64 {
        if duration_s <= 0.0 {
            return 0.0;
        }
        let x = ((time_s - f64::from(start)) / duration_s).clamp(0.0, 1.0);
        1.0 - x * x * (3.0 - 2.0 * x)
    }

    /// True while any vertex fades.
    pub fn running(&self, time_s: f64) -> bool {
        !self.entries.is_empty() && (time_s < self.end_s || self.duration_s <= 0.0)
    }

    /// Offset of a vertex before the blended matrix `A` is applied, metres, rest frame.
    pub fn offset(&self, v: VertexId, time_s: f64) -> DVec3 {
        match self.entries.get(v.index()) {
            Some(&[x, y, z, start]) if x != 0.0 || y != 0.0 || z != 0.0 => {
                Vec3::new(x, y, z).as_dvec3() * self.alpha(start, time_s)
            }
            _ => DVec3::ZERO,
        }
    }

    /// Starts the fade of `v`: `moved` is what the vertex must be moved by now (metres, as seen), `offset` what it has yet to go by an earlier
    /// fade, as [`Fades::offset`] tells it; `pose` and `rows` are its skin.
    pub fn start(&mut self, rows: &VertexRows, pose: &Pose, v: VertexId, (moved, offset): (DVec3, DVec3), time_s: f64) {
        if self.entries.is_empty() {
            if self.room.len() < rows.len() {
                self.make_room(rows.len());
            }
            self.entries = std::mem::take(&mut self.room);
            self.entries.truncate(rows.len());
        }
        self.follow(rows.len());
        if !self.running(time_s) {
            self.longest = 0.0;
        }
        let linear = pose.blended_linear(rows, v);
        // a blend that is near singular has no inverse worth using: the offset then stays in the posed frame's axes
        let inverse = if linear.determinant().abs() > 1e-9 { linear.inverse() } else { glam::DMat3::IDENTITY };
        let c = (inverse * moved + offset).as_vec3();
        self.entries[v.index()] = [c.x, c.y, c.z, time_s as f32];
        self.note(v.index()..v.index() + 1);
        self.longest = self.longest.max(c.as_dvec3().length());
        self.end_s = self.end_s.max(f64::from(time_s as f32) + self.duration_s);
    }

    /// Forgets the fade of `v`.
    pub fn clear(&mut self, v: VertexId) {
        if let Some(entry) = self.entries.get_mut(v.index()).filter(|e| **e != [0.0; 4]) {
            *entry = [0.0; 4];
            self.note(v.index()..v.index() + 1);
        }
    }
}

/// Where particles carry a vertex whose skinned position is `skinned`; `influences` as for [`final_position`].
#[inline]
pub fn displaced<'a>(skinned: DVec3, influences: impl Iterator<Item = (DVec3, Option<&'a Turn>, f64)>) -> DVec3 {
    let mut position = skinned;
    for (mut displacement, turn, weight) in influences {
        if let Some(turn) = turn {
            displacement += turn.carries(skinned);
        }
        position += displacement * weight;
    }
    position
}

/// Final position of a vertex. `influences` lists `(displacement of the particle, its turn if it has one, weight)`.
#[inline]
pub fn final_position<'a>(
    rows: &VertexRows,
    pose: &Pose,
    fades: &Fades,
    time_s: f64,
    v: VertexId,
    influences: impl Iterator<Item = (DVec3, Option<&'a Turn>, f64)>,
) -> DVec3 {
    let mut position = displaced(pose.skin(rows, v), influences);
    let offset = fades.offset(v, time_s);
    if offset != DVec3::ZERO {
        position += pose.blended_carry(rows, v, offset);
    }
    position
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn writes_are_told_block_by_block() {
        let vertices = 3 * FADE_BLOCK - 5;
        let mut rows = VertexRows::default();
        for _ in 0..vertices {
            rows.push_base([0.0; 3], &[]);
        }
        let mut fades = Fades::new(1.0);
        assert!(fades.entries().is_empty() && fades.written().is_empty());
        let newer = |fades: &Fades, seen: u64| -> Vec<bool> { fades.written().iter().map(|&at| at > seen).collect() };
        let latest = |fades: &Fades| fades.written().iter().copied().max().unwrap_or(0);
        fades.start(&rows, &Pose::default(), VertexId::new(FADE_BLOCK), (DVec3::X, DVec3::ZERO), 0.0);
        assert_eq!((fades.entries().len(), newer(&fades, 0)), (vertices, vec![false, true, false]));
        let mut seen = latest(&fades);
        fades.clear(VertexId(3)); // has none
        assert_eq!(latest(&fades), seen);
        fades.clear(VertexId::new(FADE_BLOCK));
        assert_eq!(newer(&fades, seen), [false, true, false]);
        seen = latest(&fades);
        // vertices that come, also in the place of others that went
        fades.follow(vertices + 10);
        assert_eq!(newer(&fades, seen), [false, false, true, true]);
        fades.follow(FADE_BLOCK + 1);
        seen = latest(&fades);
        fades.follow(vertices);
        assert_eq!(newer(&fades, seen), [false, true, true]);
        let piece = fades.extract(&[VertexId(0), VertexId(70)]);
        assert_eq!((piece.entries().len(), newer(&piece, 0)), (2, vec![true]));
    }
}
