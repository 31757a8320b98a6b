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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::test_models;

    #[test]
    fn experiment() {
        for (n, per) in [(50usize, 26.0f64), (350, 50.0), (350, 20.0), (350, 100.0)] {
          for jitter in [0.0, 0.5] {
            let (mesh, rest) = if jitter > 0.0 { test_models::grid(n, jitter, 4) } else { test_models::sphere(n / 2) };
            let area = if jitter > 0.0 { 1.0 } else { 4.0 * 3.14159 };
            let edge = test_models::mean_edge(&mesh, &rest);
            let r = 0.72 * (1.1547 * per * area / rest.len() as f64).sqrt();
            let mut sc = PoissonScratch::default();
            let mut out = Vec::new();
            for seed in 0..4 {
                let t = std::time::Instant::now();
                sample_with(&mesh, &rest, r, seed, &mut sc, &mut out);
                let dt = t.elapsed().as_secs_f64() * 1e3;
                let ratio = r / (2.0 * area / (3f64.sqrt() * out.len() as f64)).sqrt();
                println!("n {} v {} r/e {:.2} samples {} ratio {ratio:.4} {dt:.3} ms", n, rest.len(), r / edge, out.len());
            }
          }
        }
    }
}
