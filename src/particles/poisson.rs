//! Poisson-disk sampling on mesh vertices, sheet by sheet (MATHS 3.1).
//!
//! Vertices p and q conflict iff |p - q| < r and an edge path joins them whose vertices all lie within r of p, or all
//! within r of q. A sample marks what it covers by a flood that visits each vertex once over the whole run: it stops at
//! vertices that are covered already. What such a flood misses, and what conflicts by a path near the other end, is
//! settled before a candidate is taken: if a sample is near in space, full floods decide by the rule. So the result is
//! valid and maximal for any order of candidates, and where sheets lie apart nothing but the marking is ever done.
//!
//! The order decides density and speed. Samples advance as a front: candidates are the vertices just outside the disks
//! taken so far, oldest disk first, which packs them closer than random darts and keeps the working set small.

use super::flood::{FanQueue, Flood};
use super::point_grid::PointGrid;
use super::random::draw;
use super::settings::spacing_for_count;
use crate::geometry::{Mesh, VertexId};
use glam::{DVec3, Vec3};
use std::cell::Cell;
use std::collections::VecDeque;

/// A sample whose rim may still hold candidates.
#[derive(Clone, Copy, Debug)]
struct Disk {
    centre: VertexId,
    /// The sample that this one was found from.
    from: VertexId,
    /// Its open rim in the arena.
    start: u32,
    end: u32,
}

/// A vertex as the marking sees it: place and mark in one sixteen-byte read.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(16))]
struct Spot {
    /// Relative to the middle of the model, rounded: decides all but the closest calls.
    at: Vec3,
    /// [`COVERED`], else open: the last sample that saw it, counted from 1.
    mark: u32,
}

/// The mark of vertices that conflict with a sample or are one.
const COVERED: u32 = u32::MAX;

/// Scratch of [`sample_with`].
#[derive(Clone, Debug, Default)]
pub struct PoissonScratch {
    spots: Vec<Spot>,
    fans: FanQueue,
    disks: VecDeque<Disk>,
    rims: Vec<VertexId>,
    /// Samples by place.
    grid: PointGrid,
    near: Vec<VertexId>,
    flood: Flood,
}

/// A valid and maximal Poisson-disk set of live vertices with radius `spacing` (metres), in the order it was found.
/// `rest` has a position for every vertex slot. A `spacing` of 0 takes every live vertex; NaN or below 0 takes none.
pub fn sample(mesh: &Mesh, rest: &[DVec3], spacing: f64, seed: u64) -> Vec<VertexId> {
    let mut samples = Vec::new();
    sample_with(mesh, rest, spacing, seed, &mut PoissonScratch::default(), &mut samples);
    samples
}

/// [`sample`] with the caller's scratch and output; `samples` is cleared first.
pub fn sample_with(
    mesh: &Mesh,
    rest: &[DVec3],
    spacing: f64,
    seed: u64,
    scratch: &mut PoissonScratch,
    samples: &mut Vec<VertexId>,
) {
    samples.clear();
    let vertices = mesh.vertex_slots();
    if spacing.is_nan() || spacing < 0.0 || vertices == 0 {
        return;
    }
    let (low, high) = bounds(&rest[..vertices]);
    let middle = 0.5 * (low + high);
    scratch.spots.clear();
    scratch.spots.extend(rest[..vertices].iter().map(|p| Spot { at: (p - middle).as_vec3(), mark: 0 }));
    // What rounding may make of a squared distance near the limit: each place is off by half a unit in its last digit.
    let doubt = 4.0 * f64::from(f32::EPSILON) * ((high - low).length() * spacing + spacing * spacing);
    scratch.disks.clear();
    scratch.rims.clear();
    scratch.grid = PointGrid::between(low, high, 2.0 * spacing);
    let first = (draw(seed, 0) % vertices as u64) as usize;
    let limit = spacing * spacing;
    let (sure, possible) = ((limit - doubt) as f32, (limit + doubt) as f32);
    let mut sampler = Sampler { mesh, rest, spacing, limit, sure, possible, scratch, samples };
    for start in (first..vertices).chain(0..first).map(VertexId::new) {
        if sampler.is_open(start) && mesh.vertex_is_live(start) {
            // Every component starts here, and so does a pocket that no rim saw.
            sampler.take(start, start);
            sampler.advance();
        }
    }
}

/// One run under way.
struct Sampler<'a> {
    mesh: &'a Mesh,
    rest: &'a [DVec3],
    spacing: f64,
    limit: f64,
    /// Rounded squared distances below this are below the limit, those above `possible` are not.
    sure: f32,
    possible: f32,
    scratch: &'a mut PoissonScratch,
    samples: &'a mut Vec<VertexId>,
}

impl Sampler<'_> {
    fn is_open(&self, v: VertexId) -> bool {
        self.scratch.spots[v.index()].mark != COVERED
    }

    /// Fills the rims of all disks, oldest first; each pick lies as near as it may to the pick before it.
    fn advance(&mut self) {
        while let Some(mut disk) = self.scratch.disks.pop_front() {
            let mut last = disk.from;
            while let Some(candidate) = self.nearest_open(&mut disk, last) {
                if self.take(candidate, disk.centre) {
                    last = candidate;
                }
            }
        }
        self.scratch.rims.clear();
    }

    /// The open vertex of a disk's rim that is nearest to `last`, the first among equals. Drops covered ones from the rim.
    fn nearest_open(&mut self, disk: &mut Disk, last: VertexId) -> Option<VertexId> {
        let PoissonScratch { spots, rims, .. } = &mut *self.scratch;
        let from = spots[last.index()].at;
        let rim = &mut rims[disk.start as usize..disk.end as usize];
        let (mut kept, mut best, mut least) = (0, None, f32::INFINITY);
        for k in 0..rim.len() {
            let v = rim[k];
            let Spot { at, mark } = spots[v.index()];
            rim[kept] = v;
            if mark != COVERED {
                kept += 1;
                let distance = (at - from).length_squared();
                if distance < least || best.is_none() {
                    (best, least) = (Some(v), distance);
                }
            }
        }
        disk.end = disk.start + kept as u32;
        best
    }

    /// Makes an open vertex a sample unless one conflicts with it.
    fn take(&mut self, candidate: VertexId, from: VertexId) -> bool {
        if self.conflicts(candidate) {
            self.scratch.spots[candidate.index()].mark = COVERED;
            return false;
        }
        self.scratch.grid.insert(self.samples.len() as u32, self.rest[candidate.index()]);
        self.samples.push(candidate);
        self.cover(candidate, from);
        true
    }

    /// The rule itself, for a candidate that no sample's marks have covered.
    fn conflicts(&mut self, candidate: VertexId) -> bool {
        let centre = self.rest[candidate.index()];
        let (samples, rest, limit) = (&*self.samples, self.rest, self.limit);
        let near = &mut self.scratch.near;
        near.clear();
        self.scratch.grid.visit(centre - self.spacing, centre + self.spacing, |j| {
            let sample = samples[j as usize];
            if (rest[sample.index()] - centre).length_squared() < limit {
                near.push(sample);
            }
        });
        if near.is_empty() {
            return false;
        }
        let flood = &mut self.scratch.flood;
        flood.ball(self.mesh, rest, candidate, self.spacing);
        near.iter().any(|&s| flood.has_reached(s))
            || near.iter().any(|&s| flood.ball(self.mesh, rest, s, self.spacing).contains(&candidate))
    }

    /// Marks open vertices in conflict with the newest sample, as far as open ones lead, and queues the rim beyond them.
    fn cover(&mut self, sample: VertexId, from: VertexId) {
        let seen = self.samples.len() as u32;
        let (rest, limit, sure, possible) = (self.rest, self.limit, self.sure, self.possible);
        let in_doubt = |distance: f32| distance <= possible || distance.is_nan();
        let PoissonScratch { spots, fans, rims, disks, .. } = &mut *self.scratch;
        let start = rims.len() as u32;
        spots[sample.index()].mark = COVERED;
        let (centre, exact_centre) = (spots[sample.index()].at, rest[sample.index()]);
        let spots = Cell::from_mut(&mut spots[..]).as_slice_of_cells();
        let is_new = |v: VertexId| {
            let spot = &spots[v.index()];
            let Spot { at, mark } = spot.get();
            spot.set(Spot { at, mark: mark.max(seen) });
            mark < seen
        };
        fans.spread(self.mesh, [sample], is_new, |v| {
            let Spot { at, .. } = spots[v.index()].get();
            let distance = (at - centre).length_squared();
            let near = distance < sure || (in_doubt(distance) && (rest[v.index()] - exact_centre).length_squared() < limit);
            if near {
                spots[v.index()].set(Spot { at, mark: COVERED });
            } else {
                rims.push(v);
            }
            near
        });
        let end = rims.len() as u32;
        if start < end {
            disks.push_back(Disk { centre: sample, from, start, end });
        }
    }
}

/// The box around all finite points; empty (infinite the wrong way round) without any.
fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    let finite = points.iter().filter(|p| p.is_finite());
    let (low, high) = finite.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    if low.x <= high.x { (low, high) } else { (DVec3::ZERO, DVec3::ZERO) }
}

/// Samples about `wanted` vertices: searches the spacing (metres), which it returns with the samples. The count is within
/// a few percent of what is wanted, unless components or vertices are too few to choose from.
pub fn sample_count(mesh: &Mesh, rest: &[DVec3], wanted: usize, seed: u64) -> (f64, Vec<VertexId>) {
    let mut scratch = PoissonScratch::default();
    let mut samples = Vec::new();
    let mut spacing = spacing_for_count(mesh, rest, wanted);
    let mut best: (f64, Vec<VertexId>) = (spacing, Vec::new());
    let off = |count: usize| count.abs_diff(wanted);
    for round in 0..8 {
        sample_with(mesh, rest, spacing, seed, &mut scratch, &mut samples);
        if round == 0 || off(samples.len()) < off(best.1.len()) {
            best = (spacing, samples.clone());
        }
        if 100 * off(best.1.len()) <= wanted {
            break;
        }
        // The count goes with the inverse square of the spacing.
        spacing *= (samples.len() as f64 / wanted.max(1) as f64).sqrt().clamp(0.25, 4.0);
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::test_models::{self, Model};

    /// The rule of MATHS 3.1, word by word and slowly, sharing nothing with the sampler.
    struct Oracle {
        rest: Vec<DVec3>,
        edges: Vec<Vec<usize>>,
        live: Vec<usize>,
    }

    impl Oracle {
        fn new((mesh, rest): &Model) -> Self {
            let mut edges = vec![Vec::new(); rest.len()];
            for f in mesh.live_faces() {
                for k in 0..3 {
                    let (a, b) = (mesh.face(f)[k].index(), mesh.face(f)[(k + 1) % 3].index());
                    edges[a].push(b);
                    edges[b].push(a);
                }
            }
            let live = (0..rest.len()).filter(|&v| !edges[v].is_empty()).collect();
            Self { rest: rest.clone(), edges, live }
        }

        /// For each vertex, whether a path within `r` of `p` leads to it.
        fn near(&self, p: usize, r: f64) -> Vec<bool> {
            let mut is_near = vec![false; self.rest.len()];
            is_near[p] = true;
            let mut stack = vec![p];
            while let Some(v) = stack.pop() {
                for &w in &self.edges[v] {
                    if !is_near[w] && self.rest[w].distance(self.rest[p]) <= r {
                        is_near[w] = true;
                        stack.push(w);
                    }
                }
            }
            is_near
        }

        /// What is wrong with a sample set.
        fn check(&self, samples: &[VertexId], r: f64) -> Result<(), String> {
            let near: Vec<Vec<bool>> = (0..self.rest.len()).map(|v| self.near(v, r)).collect();
            let conflict =
                |p: usize, q: usize| p != q && self.rest[p].distance_squared(self.rest[q]) < r * r && (near[p][q] || near[q][p]);
            for p in samples {
                if let Some(q) = samples.iter().find(|q| conflict(p.index(), q.index())) {
                    return Err(format!("not valid: {p:?} and {q:?}"));
                }
            }
            for &v in &self.live {
                let is_sample = samples.contains(&VertexId::new(v));
                if !is_sample && !samples.iter().any(|s| conflict(v, s.index())) {
                    return Err(format!("not maximal at {v}"));
                }
            }
            Ok(())
        }
    }

    fn models() -> Vec<Model> {
        vec![
            test_models::grid(16, 0.8, 7),
            test_models::sphere(8),
            test_models::two_sheets(10, 0.02),
            test_models::fold(22, 0.1),
            test_models::spikes(18, 0.35),
        ]
    }

    #[test]
    fn samples_are_valid_and_maximal() {
        for model in models() {
            let oracle = Oracle::new(&model);
            for (seed, r) in [(0, 0.12), (1, 0.2), (2, 0.45), (3, 1.3)] {
                let samples = sample(&model.0, &model.1, r, seed);
                oracle.check(&samples, r).unwrap();
                let mut crowded = samples.clone();
                let edge = model.0.neighbours(samples[0]).next().unwrap();
                crowded.push(edge);
                if model.1[edge.index()].distance(model.1[samples[0].index()]) < r {
                    assert!(oracle.check(&crowded, r).unwrap_err().contains("valid"));
                }
                assert!(oracle.check(&samples[1..], r).unwrap_err().contains("maximal"));
            }
        }
    }

    #[test]
    fn sheets_are_sampled_apart() {
        let (mesh, rest) = test_models::two_sheets(20, 0.01);
        let samples = sample(&mesh, &rest, 0.2, 1);
        let low = samples.iter().filter(|v| v.index() < rest.len() / 2).count();
        assert!(low > 15 && samples.len() - low > 15, "each sheet has its own samples");
    }

    #[test]
    fn the_seed_decides_and_nothing_else() {
        let (mesh, rest) = test_models::sphere(20);
        assert_eq!(sample(&mesh, &rest, 0.3, 5), sample(&mesh, &rest, 0.3, 5));
        assert_ne!(sample(&mesh, &rest, 0.3, 5), sample(&mesh, &rest, 0.3, 6));
    }

    #[test]
    fn odd_input_is_survived() {
        let (mesh, mut rest) = test_models::grid(6, 0.3, 1);
        assert_eq!(sample(&mesh, &rest, 0.0, 1).len(), rest.len());
        assert!(sample(&mesh, &rest, f64::NAN, 1).is_empty());
        assert!(sample(&mesh, &rest, -1.0, 1).is_empty());
        assert_eq!(sample(&mesh, &rest, f64::INFINITY, 1).len(), 1);
        rest[5] = DVec3::NAN;
        assert!(!sample(&mesh, &rest, 0.3, 1).is_empty());
        assert!(sample(&Mesh::default(), &[], 0.3, 1).is_empty());
        let coinciding = vec![DVec3::ONE; rest.len()];
        assert_eq!(sample(&mesh, &coinciding, 0.3, 1).len(), 1);
    }

    #[test]
    fn a_wanted_count_is_met() {
        for wanted in [20, 200, 1000] {
            let (mesh, rest) = test_models::sphere(40);
            let (spacing, samples) = sample_count(&mesh, &rest, wanted, 1);
            assert!(samples.len().abs_diff(wanted) * 20 <= wanted, "{} for {wanted}", samples.len());
            assert_eq!(samples, sample(&mesh, &rest, spacing, 1));
        }
        let (mesh, rest) = test_models::grid(2, 0.0, 1);
        assert_eq!(sample_count(&mesh, &rest, 1000, 1).1.len(), rest.len());
    }
}
