//! Edge-connected floods: the sheet rule of MATHS 3.1 as a primitive.
//!
//! Two points that are near in space may lie on different sheets (the two sides of a thin organ, the walls of a fold).
//! Whatever the soft layer links must therefore be joined by an edge path that stays near. A flood walks round the fan of
//! every reached vertex once.

use crate::geometry::room::fit;
use crate::geometry::{HalfEdge, Mesh, VertexId};
use glam::DVec3;
use std::cell::Cell;

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
        is_new: impl FnMut(VertexId) -> bool,
        mut is_reached: impl FnMut(VertexId) -> bool,
    ) {
        self.start(mesh, starts);
        self.go_on(is_new, |found, next, count| {
            for i in next..next + count {
                let (v, h) = found[i];
                if is_reached(v) {
                    walk(mesh, h, |h| found.push(leaving(mesh, h)));
                }
            }
        });
    }

    /// The same where `are_reached` is asked about a few vertices at a time, up to [`AHEAD`]: the first is the lowest bit of its answer.
    pub(super) fn spread_together(
        &mut self,
        mesh: &Mesh,
        starts: impl IntoIterator<Item = VertexId>,
        is_new: impl FnMut(VertexId) -> bool,
        mut are_reached: impl FnMut(&[VertexId]) -> u32,
    ) {
        self.start(mesh, starts);
        self.go_on(is_new, |found, next, count| {
            let mut few = [VertexId::NONE; AHEAD];
            few.iter_mut().zip(&found[next..next + count]).for_each(|(v, found)| *v = found.0);
            let reached = are_reached(&few[..count]);
            for i in (0..count).filter(|i| reached >> i & 1 == 1) {
                walk(mesh, found[next + i].1, |h| found.push(leaving(mesh, h)));
            }
        });
    }

    /// Finds what is next to the starts.
    fn start(&mut self, mesh: &Mesh, starts: impl IntoIterator<Item = VertexId>) {
        let found = &mut self.found;
        found.clear();
        for start in starts {
            let h = mesh.all_vertex_half_edges()[start.index()];
            found.extend([leaving(mesh, h.next()), leaving(mesh, h.prev())]);
            walk(mesh, h, |h| found.push(leaving(mesh, h)));
        }
    }

    /// Calls `walk_on` with what was found, the place of the next few new ones and their number, until there are none: it adds what those
    /// lead to.
    #[inline]
    fn go_on(&mut self, mut is_new: impl FnMut(VertexId) -> bool, mut walk_on: impl FnMut(&mut Vec<Found>, usize, usize)) {
        let found = &mut self.found;
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
            let count = AHEAD.min(queued - next);
            walk_on(found, next, count);
            next += count;
        }
    }
}

/// The half-edge with the vertex that it leaves.
#[inline(always)]
fn leaving(mesh: &Mesh, h: HalfEdge) -> Found {
    (mesh.faces().as_flattened()[h.0 as usize], h)
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
        self.begin(mesh, starts);
        let (taken, reached) = (2 * self.round + 1, &mut self.reached);
        // both closures write stamps
        let stamps = Cell::from_mut(&mut self.stamps[..]).as_slice_of_cells();
        let live = starts.iter().copied().filter(|&v| mesh.vertex_is_live(v));
        self.fans.spread(mesh, live, is_new(stamps, taken), |v| {
            let is_inside = inside(v);
            if is_inside {
                stamps[v.index()].set(taken);
                reached.push(v);
            }
            is_inside
        });
        &self.reached
    }

    /// The same from one live vertex, where `inside` is asked about a few at a time: the first is the lowest bit of its answer.
    pub fn run_together(&mut self, mesh: &Mesh, from: VertexId, mut inside: impl FnMut(&[VertexId]) -> u32) -> &[VertexId] {
        self.begin(mesh, &[from]);
        let (taken, reached) = (2 * self.round + 1, &mut self.reached);
        let stamps = Cell::from_mut(&mut self.stamps[..]).as_slice_of_cells();
        self.fans.spread_together(mesh, [from], is_new(stamps, taken), |few| {
            let are_inside = inside(few);
            for (_, v) in few.iter().enumerate().filter(|(i, _)| are_inside >> i & 1 == 1) {
                stamps[v.index()].set(taken);
                reached.push(*v);
            }
            are_inside
        });
        &self.reached
    }

    /// True if the last flood reached `v`.
    #[inline]
    pub fn has_reached(&self, v: VertexId) -> bool {
        self.stamps.get(v.index()) == Some(&(2 * self.round + 1))
    }

    fn begin(&mut self, mesh: &Mesh, starts: &[VertexId]) {
        if self.round >= u32::MAX / 2 - 1 {
            self.stamps.fill(0);
            self.round = 0;
        }
        self.round += 1;
        fit(&mut self.stamps, mesh.vertex_slots(), 0);
        self.reached.clear();
        let taken = 2 * self.round + 1;
        for &start in starts {
            if mesh.vertex_is_live(start) && self.stamps[start.index()] != taken {
                self.stamps[start.index()] = taken;
                self.reached.push(start);
            }
        }
    }
}

/// Whether a vertex is seen for the first time in the round whose reached vertices are stamped `taken`; it is seen then.
#[inline(always)]
fn is_new(stamps: &[Cell<u32>], taken: u32) -> impl FnMut(VertexId) -> bool {
    let seen = taken - 1;
    move |v| {
        let stamp = &stamps[v.index()];
        let before = stamp.get();
        stamp.set(before.max(seen));
        before < seen
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
    fn a_flood_that_asks_about_a_few_at_a_time_reaches_the_same() {
        let mut floods = [Flood::default(), Flood::default()];
        for (mesh, rest) in [test_models::grid(9, 0.3, 7), test_models::sphere(4), test_models::fold(14, 0.1)] {
            for v in mesh.live_vertices() {
                let inside = |w: VertexId| rest[w.index()].distance(rest[v.index()]) <= 0.4 && w.0 % 5 != 1;
                let [one, few] = &mut floods;
                let mut asked = 0;
                few.run_together(&mesh, v, |few| {
                    asked += few.len();
                    assert!((1..=AHEAD).contains(&few.len()));
                    few.iter().enumerate().map(|(i, &w)| u32::from(inside(w)) << i).sum()
                });
                assert_eq!(few.reached, one.run(&mesh, &[v], inside));
                assert!(asked + 1 >= few.reached.len() && mesh.live_vertices().all(|w| one.has_reached(w) == few.has_reached(w)));
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
