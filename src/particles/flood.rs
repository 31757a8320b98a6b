//! Edge-connected floods: the sheet rule of MATHS 3.1 as a primitive.
//!
//! Two points that are near in space may lie on different sheets (the two sides of a thin organ, the walls of a fold).
//! Whatever the soft layer links must therefore be joined by an edge path that stays near. A flood walks round the fan of
//! every reached vertex once.

use crate::geometry::room::fit;
use crate::geometry::{HalfEdge, Mesh, VertexId};
use glam::DVec3;

/// Fans that a flood walks round before it looks at what they led to: memory answers many questions as fast as one.
const AHEAD: usize = 8;

/// A vertex, and a half-edge that leaves it in the face that it was found in.
type Found = (VertexId, HalfEdge);

/// The queue of a flood, kept between floods.
#[derive(Clone, Debug, Default)]
pub(super) struct FanQueue {
    found: Vec<Found>,
}

impl FanQueue {
    /// Floods from live vertices. `is_new` is asked about vertices next to reached ones, again and again: it holds the
    /// first time, if at all. `is_reached` is then asked once whether the flood goes on from there.
    pub(super) fn spread(
        &mut self,
        mesh: &Mesh,
        starts: impl IntoIterator<Item = VertexId>,
        mut is_new: impl FnMut(VertexId) -> bool,
        mut is_reached: impl FnMut(VertexId) -> bool,
    ) {
        let corners = mesh.faces().as_flattened();
        let leaving = |h: HalfEdge| (corners[h.0 as usize], h);
        let found = &mut self.found;
        found.clear();
        for start in starts {
            let h = mesh.all_vertex_half_edges()[start.index()];
            found.extend([leaving(h.next()), leaving(h.prev())]);
            walk(mesh, h, |h| found.push(leaving(h)));
        }
        let (mut next, mut queued) = (0, 0);
        loop {
            let settled = queued;
            for k in settled..found.len() {
                // without a branch: which way it goes is a coin toss
                found[queued] = found[k];
                queued += usize::from(is_new(found[k].0));
            }
            found.truncate(queued);
            if next == queued {
                break;
            }
            for _ in 0..AHEAD.min(queued - next) {
                let (v, h) = found[next];
                next += 1;
                if is_reached(v) {
                    walk(mesh, h, |h| found.push(leaving(h)));
                }
            }
        }
    }
}

/// Calls `note` with a half-edge out of every vertex next to the one that `first` leaves, but for those of its own face.
#[inline(always)]
fn walk(mesh: &Mesh, first: HalfEdge, mut note: impl FnMut(HalfEdge)) {
    let opposites = mesh.all_opposites().as_flattened();
    let last = opposites[first.0 as usize];
    let mut h = opposites[first.prev().0 as usize];
    while h.is_some() {
        let back = h.prev();
        if back == last {
            return;
        }
        note(back);
        h = opposites[back.0 as usize];
    }
    // a border: what lies the other way round
    h = last;
    while h.is_some() {
        note(h.prev());
        h = opposites[h.next().0 as usize];
    }
}

/// Scratch of the floods, sized by the mesh and kept between calls.
#[derive(Clone, Debug, Default)]
pub struct Flood {
    fans: FanQueue,
    /// `2 * round + 1` where reached, `2 * round` where seen and refused.
    stamps: Vec<u32>,
    round: u32,
    /// Vertices reached by the last flood, the starts first, in the order they were reached.
    pub reached: Vec<VertexId>,
}

impl Flood {
    /// Makes room for floods of so many vertices on a mesh of so many.
    pub(super) fn make_room(&mut self, vertices: usize, slots: usize) {
        self.stamps.reserve(slots);
        self.fans.found.reserve(4 * vertices);
        self.reached.reserve(4 * vertices);
    }

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
        // both closures write stamps
        let stamps = std::cell::Cell::from_mut(&mut stamps[..]).as_slice_of_cells();
        let live = starts.iter().copied().filter(|&v| mesh.vertex_is_live(v));
        let is_new = |v: VertexId| {
            let stamp = &stamps[v.index()];
            let before = stamp.get();
            stamp.set(before.max(seen));
            before < seen
        };
        self.fans.spread(mesh, live, is_new, |v| {
            let is_inside = inside(v);
            if is_inside {
                stamps[v.index()].set(taken);
                reached.push(v);
            }
            is_inside
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
