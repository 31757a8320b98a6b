//! Poisson-disk sampling on mesh vertices, sheet by sheet (MATHS 3.1).
//!
//! Vertices p and q conflict iff |p - q| < r and an edge path joins them whose vertices all lie within r of p, or all
//! within r of q. One flood from a candidate settles everything about it: it finds every sample that conflicts by a path
//! near the *candidate*; conflicts by a path near the *sample* were marked when that sample was taken; and if it is
//! taken itself, what it reached is what it covers. So the result is valid and maximal for any order of candidates.
//!
//! The order decides density and speed. Samples advance as a front: candidates are the vertices just outside the disks
//! taken so far, oldest disk first, which packs them closer than random darts and keeps the working set small.

use super::flood::Flood;
use super::random::draw;
use super::settings::spacing_for_count;
use crate::geometry::{Mesh, VertexId};
use glam::DVec3;
use std::collections::VecDeque;

const OPEN: u8 = 0;
const COVERED: u8 = 1;
const SAMPLE: u8 = 2;

/// A sample whose rim may still hold candidates.
#[derive(Clone, Copy, Debug)]
struct Disk {
    centre: VertexId,
    /// Where the last candidate was taken, or the sample that this one was found from.
    last: VertexId,
    /// Its open rim in the arena.
    start: u32,
    end: u32,
}

/// Scratch of [`sample_with`].
#[derive(Clone, Debug, Default)]
pub struct PoissonScratch {
    flood: Flood,
    state: Vec<u8>,
    disks: VecDeque<Disk>,
    rims: Vec<VertexId>,
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
    scratch.state.clear();
    scratch.state.resize(vertices, OPEN);
    scratch.disks.clear();
    scratch.rims.clear();
    let first = (draw(seed, 0) % vertices as u64) as usize;
    for start in (first..vertices).chain(0..first).map(VertexId::new) {
        if scratch.state[start.index()] == OPEN && mesh.vertex_is_live(start) {
            // Every component starts here, and so does a pocket whose rims were seen while they were still covered.
            scratch.take(mesh, rest, spacing, start, start, samples);
            scratch.advance(mesh, rest, spacing, samples);
        }
    }
}

impl PoissonScratch {
    /// Fills the rims of all disks, oldest first; each pick lies as near as it may to the pick before it.
    fn advance(&mut self, mesh: &Mesh, rest: &[DVec3], spacing: f64, samples: &mut Vec<VertexId>) {
        while let Some(disk) = self.disks.pop_front() {
            let mut last = disk.last;
            while let Some(candidate) = self.nearest_open(rest, disk, last) {
                if self.take(mesh, rest, spacing, candidate, disk.centre, samples) {
                    last = candidate;
                }
            }
        }
        self.rims.clear();
    }

    fn nearest_open(&self, rest: &[DVec3], disk: Disk, last: VertexId) -> Option<VertexId> {
        let mut best = None;
        let mut least = f64::INFINITY;
        for &v in &self.rims[disk.start as usize..disk.end as usize] {
            if self.state[v.index()] == OPEN {
                let distance = (rest[v.index()] - rest[last.index()]).length_squared();
                if distance < least || best.is_none() {
                    (best, least) = (Some(v), distance);
                }
            }
        }
        best
    }

    /// Makes `candidate` a sample unless a sample conflicts with it by a path near the candidate.
    fn take(
        &mut self,
        mesh: &Mesh,
        rest: &[DVec3],
        spacing: f64,
        candidate: VertexId,
        found_from: VertexId,
        samples: &mut Vec<VertexId>,
    ) -> bool {
        let centre = rest[candidate.index()];
        let limit = spacing * spacing;
        let conflicts = |v: VertexId| (rest[v.index()] - centre).length_squared() < limit;
        self.flood.ball(mesh, rest, candidate, spacing);
        let state = &mut self.state;
        state[candidate.index()] = COVERED;
        if self.flood.reached.iter().any(|&v| state[v.index()] == SAMPLE && conflicts(v)) {
            return false;
        }
        for &v in &self.flood.reached {
            if conflicts(v) {
                state[v.index()] = COVERED;
            }
        }
        state[candidate.index()] = SAMPLE;
        samples.push(candidate);
        let start = self.rims.len() as u32;
        self.rims.extend(self.flood.rim.iter().filter(|v| state[v.index()] == OPEN));
        let end = self.rims.len() as u32;
        if end > start {
            self.disks.push_back(Disk { centre: candidate, last: found_from, start, end });
        }
        true
    }
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
