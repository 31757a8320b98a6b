//! Edge-connected floods: the sheet rule of MATHS 3.1 as a primitive.
//!
//! Two points that are near in space may lie on different sheets (the two sides of a thin organ, the walls of a fold).
//! Whatever the soft layer links must therefore be joined by an edge path that stays near. A flood enters every face
//! with a reached corner once (two faces a vertex, where walking all fans would take six steps a vertex).

use crate::geometry::room::fit;
use crate::geometry::{HalfEdge, Mesh, VertexId};
use glam::DVec3;

/// Faces that a flood looks at together.
const AHEAD: usize = 16;

/// Enters every face next to a reached vertex once. Kept between floods: a stamp replaces clearing.
#[derive(Clone, Debug, Default)]
pub(super) struct FaceQueue {
    stamps: Vec<u32>,
    round: u32,
    /// Half-edges that faces were entered across, times 4, plus which ends are reached; longer than its content.
    entered: Vec<u64>,
    queued: usize,
}

impl FaceQueue {
    /// Forgets the last flood.
    fn begin(&mut self, mesh: &Mesh) {
        if self.round == u32::MAX {
            self.stamps.fill(0);
            self.round = 0;
        }
        self.round += 1;
        fit(&mut self.stamps, mesh.face_slots() + 1, 0);
        if let Some(sentinel) = self.stamps.last_mut() {
            *sentinel = self.round;
        }
        self.queued = 0;
    }

    /// Floods from live vertices that `is_reached` holds for. It is asked about vertices next to reached ones, again and
    /// again, and must not change its mind.
    pub(super) fn spread(
        &mut self,
        mesh: &Mesh,
        starts: impl IntoIterator<Item = VertexId>,
        mut is_reached: impl FnMut(VertexId) -> bool,
    ) {
        self.begin(mesh);
        for start in starts {
            // The face on either side of one edge of the start; the flood goes round the fan from there.
            let h = mesh.all_vertex_half_edges()[start.index()];
            let other = u64::from(is_reached(mesh.to(h)));
            self.enter(h, 1 | other << 1);
            self.enter(mesh.opposite(h), other | 2);
        }
        let (faces, opposites) = (mesh.faces(), mesh.all_opposites());
        let mut next = 0;
        while next < self.queued {
            // what a few faces lead to is read at once, for memory answers many questions as fast as one
            let mut ahead = [(VertexId::NONE, [HalfEdge::NONE; 2], 0); AHEAD];
            let count = AHEAD.min(self.queued - next);
            let round = self.round;
            for (slot, &entered) in ahead.iter_mut().zip(&self.entered[next..next + count]) {
                let (h, flags) = (HalfEdge((entered >> 2) as u32), entered & 3);
                // The face was entered across `h`, whose ends are known; only the corner opposite may be new.
                let (f, k) = (h.face().index(), h.corner());
                let (k1, k2) = ([1, 2, 0][k], [2, 0, 1][k]);
                let across = [opposites[f][k1], opposites[f][k2]];
                let fresh = |h: HalfEdge| match self.stamps.get(h.face().index()) {
                    Some(&stamp) if stamp != round => h,
                    _ => HalfEdge::NONE,
                };
                *slot = (faces[f][k2], across.map(fresh), flags);
            }
            next += count;
            for &(corner, [left, right], flags) in &ahead[..count] {
                let apex = u64::from(is_reached(corner));
                self.enter(left, apex | (flags & 2));
                self.enter(right, (flags & 1) | apex << 1);
            }
        }
    }

    /// Queues the face of `h` unless it was queued, `h` is absent, or neither end is reached (bit 0 of `flags`: the
    /// vertex that `h` leaves, bit 1: the one it reaches). Without a branch: which way it goes is a coin toss.
    #[inline]
    fn enter(&mut self, h: HalfEdge, flags: u64) {
        if self.queued == self.entered.len() {
            self.entered.resize(self.entered.len() * 2 + 64, 0);
        }
        let sentinel = self.stamps.len() - 1; // always stamped: where an absent half-edge ends up
        let stamp = &mut self.stamps[h.face().index().min(sentinel)];
        let fresh = (flags != 0) & (*stamp != self.round);
        *stamp = if fresh { self.round } else { *stamp };
        self.entered[self.queued] = u64::from(h.0) << 2 | flags;
        self.queued += usize::from(fresh);
    }
}

/// Scratch of the floods, sized by the mesh and kept between calls.
#[derive(Clone, Debug, Default)]
pub struct Flood {
    faces: FaceQueue,
    /// `2 * round + 1` where reached, `2 * round` where seen and refused.
    stamps: Vec<u32>,
    round: u32,
    /// Vertices reached by the last flood, the starts first, in the order they were reached.
    pub reached: Vec<VertexId>,
}

impl Flood {
    /// Floods from `from` over vertices within `radius` of it (the border included). Returns `reached`.
    pub fn ball(&mut self, mesh: &Mesh, rest: &[DVec3], from: VertexId, radius: f64) -> &[VertexId] {
        let centre = rest[from.index()];
        let limit = radius * radius;
        self.run(mesh, &[from], |v| (rest[v.index()] - centre).length_squared() <= limit)
    }

    /// Floods from `starts` (taken whatever `inside` says; dead ones are skipped) over vertices that are `inside`.
    pub fn run(&mut self, mesh: &Mesh, starts: &[VertexId], mut inside: impl FnMut(VertexId) -> bool) -> &[VertexId] {
        self.begin(mesh);
        let (seen, taken) = (2 * self.round, 2 * self.round + 1);
        let (stamps, reached) = (&mut self.stamps, &mut self.reached);
        for &start in starts {
            if mesh.vertex_is_live(start) && stamps[start.index()] != taken {
                stamps[start.index()] = taken;
                reached.push(start);
            }
        }
        let live = starts.iter().copied().filter(|&v| mesh.vertex_is_live(v));
        self.faces.spread(mesh, live, |v| {
            let stamp = &mut stamps[v.index()];
            if *stamp < seen {
                *stamp = seen;
                if inside(v) {
                    *stamp = taken;
                    reached.push(v);
                }
            }
            *stamp == taken
        });
        &self.reached
    }

    /// True if the last flood reached `v`.
    #[inline]
    pub fn has_reached(&self, v: VertexId) -> bool {
        self.stamps.get(v.index()) == Some(&(2 * self.round + 1))
    }

    fn begin(&mut self, mesh: &Mesh) {
        if self.round >= u32::MAX / 2 - 1 {
            self.stamps.fill(0);
            self.round = 0;
        }
        self.round += 1;
        fit(&mut self.stamps, mesh.vertex_slots(), 0);
        self.reached.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::test_models;

    /// The same set by walking the fans, vertex by vertex.
    fn by_fans(mesh: &Mesh, rest: &[DVec3], from: VertexId, radius: f64) -> Vec<VertexId> {
        let mut found = vec![from];
        let mut next = 0;
        while next < found.len() {
            for v in mesh.neighbours(found[next]) {
                if !found.contains(&v) && rest[v.index()].distance(rest[from.index()]) <= radius {
                    found.push(v);
                }
            }
            next += 1;
        }
        found.sort_unstable();
        found
    }

    #[test]
    fn a_flood_reaches_what_a_walk_over_fans_reaches() {
        let mut flood = Flood::default();
        for (mesh, rest) in [test_models::grid(9, 0.3, 7), test_models::sphere(4), test_models::fold(14, 0.1)] {
            for v in mesh.live_vertices() {
                for radius in [0.0, 0.2, 0.45] {
                    let mut got = flood.ball(&mesh, &rest, v, radius).to_vec();
                    got.sort_unstable();
                    assert_eq!(got, by_fans(&mesh, &rest, v, radius));
                    assert!(mesh.live_vertices().all(|w| flood.has_reached(w) == got.contains(&w)));
                }
            }
        }
    }

    #[test]
    fn a_flood_does_not_jump_between_sheets() {
        let (mesh, rest) = test_models::two_sheets(8, 0.01);
        let mut flood = Flood::default();
        let sheet = rest.len() / 2;
        flood.ball(&mesh, &rest, VertexId(0), 10.0);
        assert_eq!(flood.reached.len(), sheet);
        let near = (0..rest.len()).filter(|&i| rest[i].distance(rest[0]) <= 10.0).count();
        assert_ne!(flood.reached.len(), near, "distance alone must not pass for the sheet rule");
    }
}
