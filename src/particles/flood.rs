//! Edge-connected floods: the sheet rule of MATHS 3.1 as a primitive.
//!
//! Two points that are near in space may lie on different sheets (the two sides of a thin organ, the walls of a fold).
//! Whatever the soft layer links must therefore be joined by an edge path that stays near. A flood enters every face
//! with a reached corner once (two faces a vertex, where walking all fans would take six steps a vertex).

use crate::geometry::{HalfEdge, Mesh, VertexId};
use glam::DVec3;

/// Scratch of the floods, sized by the mesh and kept between calls: a stamp replaces clearing.
#[derive(Clone, Debug, Default)]
pub struct Flood {
    /// `2 * round + 1` where reached, `2 * round` where seen and refused.
    vertex_stamp: Vec<u32>,
    face_stamp: Vec<u32>,
    round: u32,
    /// Half-edges that faces were entered across, times 4, plus which ends are reached; longer than its content.
    queue: Vec<u64>,
    /// Vertices reached by the last flood, the start first, in the order they were reached.
    pub reached: Vec<VertexId>,
    /// Vertices seen next to reached ones and refused, in the order they were seen.
    pub rim: Vec<VertexId>,
}

impl Flood {
    /// Floods from `from` over vertices within `radius` of it (the border included). Returns `reached`.
    pub fn ball(&mut self, mesh: &Mesh, rest: &[DVec3], from: VertexId, radius: f64) -> &[VertexId] {
        let centre = rest[from.index()];
        let limit = radius * radius;
        self.run(mesh, &[from], |v| (rest[v.index()] - centre).length_squared() <= limit)
    }

    /// Floods from `starts` (taken whatever `inside` says; dead ones are skipped) over vertices that are `inside`.
    pub fn run(&mut self, mesh: &Mesh, starts: &[VertexId], inside: impl Fn(VertexId) -> bool) -> &[VertexId] {
        self.begin(mesh);
        for &start in starts {
            if mesh.vertex_is_live(start) && self.vertex_stamp[start.index()] != 2 * self.round + 1 {
                self.vertex_stamp[start.index()] = 2 * self.round + 1;
                self.reached.push(start);
            }
        }
        let mut queued = 0;
        for i in 0..self.reached.len() {
            // The face on either side of one edge of the start; the flood goes round the fan from there.
            let h = mesh.all_vertex_half_edges()[self.reached[i].index()];
            let other = u64::from(self.classify(mesh.to(h), &inside));
            self.enter(h, 1 | other << 1, &mut queued);
            self.enter(mesh.opposite(h), other | 2, &mut queued);
        }
        let (faces, opposites) = (mesh.faces(), mesh.all_opposites());
        let mut next = 0;
        while next < queued {
            let (h, flags) = (HalfEdge((self.queue[next] >> 2) as u32), self.queue[next] & 3);
            next += 1;
            // The face was entered across `h`, whose ends are known; only the corner opposite may be new.
            let (f, k) = (h.face().index(), h.corner());
            let (k1, k2) = ([1, 2, 0][k], [2, 0, 1][k]);
            let apex = u64::from(self.classify(faces[f][k2], &inside));
            self.enter(opposites[f][k1], apex | (flags & 2), &mut queued);
            self.enter(opposites[f][k2], (flags & 1) | apex << 1, &mut queued);
        }
        &self.reached
    }

    /// Whether `v` is reached, settled at the first sight of it next to a reached vertex.
    #[inline]
    fn classify(&mut self, v: VertexId, inside: &impl Fn(VertexId) -> bool) -> bool {
        let stamp = &mut self.vertex_stamp[v.index()];
        if *stamp < 2 * self.round {
            if inside(v) {
                *stamp = 2 * self.round + 1;
                self.reached.push(v);
            } else {
                *stamp = 2 * self.round;
                self.rim.push(v);
            }
        }
        *stamp & 1 == 1
    }

    /// Queues the face of `h` unless it was queued, `h` is absent, or neither end is reached (bit 0 of `flags`: the
    /// vertex that `h` leaves, bit 1: the one it reaches). Without a branch: which way it goes is a coin toss.
    #[inline]
    fn enter(&mut self, h: HalfEdge, flags: u64, queued: &mut usize) {
        if *queued == self.queue.len() {
            self.queue.resize(self.queue.len() * 2 + 64, 0);
        }
        let sentinel = self.face_stamp.len() - 1; // always stamped: where an absent half-edge ends up
        let stamp = &mut self.face_stamp[h.face().index().min(sentinel)];
        let fresh = (flags != 0) & (*stamp != self.round);
        *stamp = if fresh { self.round } else { *stamp };
        self.queue[*queued] = u64::from(h.0) << 2 | flags;
        *queued += usize::from(fresh);
    }

    /// True if the last flood reached `v`.
    #[inline]
    pub fn has_reached(&self, v: VertexId) -> bool {
        self.vertex_stamp.get(v.index()) == Some(&(2 * self.round + 1))
    }

    fn begin(&mut self, mesh: &Mesh) {
        if self.round >= u32::MAX / 2 - 1 {
            self.vertex_stamp.fill(0);
            self.face_stamp.fill(0);
            self.round = 0;
        }
        self.round += 1;
        if self.vertex_stamp.len() < mesh.vertex_slots() {
            self.vertex_stamp.resize(mesh.vertex_slots(), 0);
        }
        if self.face_stamp.len() <= mesh.face_slots() {
            self.face_stamp.resize(mesh.face_slots() + 1, 0);
        }
        if let Some(sentinel) = self.face_stamp.last_mut() {
            *sentinel = self.round;
        }
        self.reached.clear();
        self.rim.clear();
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
                    assert!(flood.rim.iter().all(|&w| !flood.has_reached(w)));
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
