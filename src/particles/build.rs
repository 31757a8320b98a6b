//! Building a [`ParticleMap`] from anchors: influences and neighbours by the sheet rule (MATHS 2.1, 3.1).

use super::flood::Flood;
use super::particle_map::{Influence, Link, ParticleMap};
use super::point_grid::PointGrid;
use super::settings::ParticleSettings;
use crate::geometry::{Mesh, ParticleId, SlotCsr, VertexId};
use glam::DVec3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Closest that two particles count for a link's weight, over the mean link length: coinciding ones stay finite.
const LEAST_LINK_LENGTH: f64 = 0.05;

/// What [`ParticleMap::build`] reports.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BuildReport {
    /// Largest sum of normalised weights that the limit of influences cut off at a vertex.
    pub truncation_error: f64,
    /// Vertices that no particle reached, given the nearest connected one.
    pub unreached: usize,
}

/// Weight of a particle at `distance` with radius of influence `radius`: a smooth sigmoid, 1 at 0 and 0 at the radius
/// with two vanishing derivatives at both ends (MATHS 2.1).
#[inline]
pub fn sigmoid_weight(distance: f64, radius: f64) -> f64 {
    let t = (distance / radius).clamp(0.0, 1.0);
    1.0 - t * t * t * (t * (6.0 * t - 15.0) + 10.0)
}

/// Weight of a link: inversely proportional to its length, 1 at `mean`.
#[inline]
pub(super) fn link_weight(distance: f64, mean: f64) -> f32 {
    (mean / distance.max(LEAST_LINK_LENGTH * mean)) as f32
}

impl ParticleMap {
    /// Map of particles anchored to `anchors` (live vertices). `rest` has a position for every vertex slot.
    ///
    /// Particle j reaches vertex i iff they are less than `radius` apart and an edge path within `radius` of either joins
    /// them; the strongest `max_influences` are kept and normalised. A vertex that none reaches gets the nearest
    /// connected one. Pairs are neighbours by the same rule with `neighbours`.
    pub fn build(mesh: &Mesh, rest: &[DVec3], anchors: &[VertexId], settings: &ParticleSettings) -> (Self, BuildReport) {
        let mut flood = Flood::default();
        let mut pairs = reached_by_anchors(mesh, rest, anchors, settings.radius, &mut flood);
        reached_from_vertices(mesh, rest, anchors, settings.radius, &mut flood, &mut pairs);
        let (influences, report) = influence_rows(mesh, rest, anchors, settings, &pairs);
        let neighbours = neighbour_rows(mesh, rest, anchors, settings.neighbours, &mut flood);
        let mut map = Self {
            anchors: anchors.to_vec().into(),
            rest_displacement: vec![[0.0; 3]; anchors.len()].into(),
            influences,
            neighbours,
            mean_link: 0.0,
        };
        map.mean_link = map.mean_link_length(rest).unwrap_or(0.0);
        (map, report)
    }

    /// True for wound particles: those that rest displaced (MATHS 3.3).
    #[inline]
    pub fn is_wound(&self, particle: ParticleId) -> bool {
        let [x, y, z] = self.rest_displacement[particle.index()];
        (x != 0.0) | (y != 0.0) | (z != 0.0)
    }

    /// The mean link length that neighbour weights refer to: as it was when the map was built; without that, recovered from
    /// the first link there is. None without links.
    pub fn mean_link_length(&self, rest: &[DVec3]) -> Option<f64> {
        if self.mean_link > 0.0 {
            return Some(self.mean_link);
        }
        let at = |p: ParticleId| rest[self.anchors[p.index()].index()];
        (0..self.len()).map(ParticleId::new).find_map(|j| {
            // Links at the least length have a clamped weight, which says nothing.
            let unclamped = |l: &&Link| f64::from(l.weight) < 0.99 / LEAST_LINK_LENGTH;
            let link = self.neighbours.row(j.index()).iter().find(unclamped)?;
            Some(f64::from(link.weight) * at(j).distance(at(link.particle)))
        })
    }

    /// Number of live particles.
    pub fn live(&self) -> usize {
        self.anchors.iter().filter(|a| a.is_some()).count()
    }
}

/// `(vertex, particle)` pairs joined by a path near the anchor, by particle.
fn reached_by_anchors(
    mesh: &Mesh,
    rest: &[DVec3],
    anchors: &[VertexId],
    radius: f64,
    flood: &mut Flood,
) -> Vec<(u32, ParticleId)> {
    let mut pairs = Vec::new();
    for (j, &anchor) in anchors.iter().enumerate() {
        let centre = rest[anchor.index()];
        for &v in flood.ball(mesh, rest, anchor, radius) {
            if v == anchor || rest[v.index()].distance_squared(centre) < radius * radius {
                pairs.push((v.0, ParticleId::new(j)));
            }
        }
    }
    pairs
}

/// Adds the pairs that only a path near the *vertex* joins. Such a path stays within `2 radius` of the anchor, so one
/// wider flood an anchor settles all but a few; only those flood from their vertex.
fn reached_from_vertices(
    mesh: &Mesh,
    rest: &[DVec3],
    anchors: &[VertexId],
    radius: f64,
    flood: &mut Flood,
    pairs: &mut Vec<(u32, ParticleId)>,
) {
    let grid = PointGrid::build(anchors.iter().map(|a| Some(rest[a.index()])), radius);
    let near_count = pairs.len();
    let mut open: Vec<(ParticleId, VertexId)> = Vec::new();
    let known = SlotCsr::from_pairs(mesh.vertex_slots(), pairs);
    for v in mesh.live_vertices() {
        let p = rest[v.index()];
        grid.visit(p - radius, p + radius, |j| {
            let j = ParticleId(j);
            let q = rest[anchors[j.index()].index()];
            if q.distance_squared(p) < radius * radius && !known.row(v.index()).contains(&j) {
                open.push((j, v));
            }
        });
    }
    open.sort_unstable();
    for run in open.chunk_by_mut(|a, b| a.0 == b.0) {
        let anchor = anchors[run[0].0.index()];
        flood.ball(mesh, rest, anchor, 2.0 * radius);
        for pair in run {
            if !flood.has_reached(pair.1) {
                pair.0 = ParticleId::NONE;
            }
        }
    }
    open.retain(|pair| pair.0.is_some());
    open.sort_unstable_by_key(|pair| (pair.1, pair.0));
    for run in open.chunk_by(|a, b| a.1 == b.1) {
        flood.ball(mesh, rest, run[0].1, radius);
        for &(j, v) in run.iter().filter(|pair| flood.has_reached(anchors[pair.0.index()])) {
            pairs.push((v.0, j));
        }
    }
    if pairs.len() > near_count {
        pairs.sort_unstable_by_key(|pair| pair.1);
    }
}

fn influence_rows(
    mesh: &Mesh,
    rest: &[DVec3],
    anchors: &[VertexId],
    settings: &ParticleSettings,
    pairs: &[(u32, ParticleId)],
) -> (SlotCsr<Influence>, BuildReport) {
    let reaching = SlotCsr::from_pairs(mesh.vertex_slots(), pairs);
    let mut report = BuildReport::default();
    let mut nearest: Option<Vec<ParticleId>> = None;
    let mut out: Vec<(u32, Influence)> = Vec::with_capacity(pairs.len());
    let mut row: Vec<(f64, ParticleId)> = Vec::new();
    for v in mesh.live_vertices() {
        row.clear();
        row.extend(reaching.row(v.index()).iter().map(|&j| {
            let distance = rest[anchors[j.index()].index()].distance(rest[v.index()]);
            (sigmoid_weight(distance, settings.radius), j)
        }));
        report.truncation_error = report.truncation_error.max(normalise(&mut row, settings.max_influences));
        if row.is_empty() {
            let nearest = nearest.get_or_insert_with(|| nearest_connected(mesh, rest, anchors));
            if nearest[v.index()].is_some() {
                report.unreached += 1;
                row.push((1.0, nearest[v.index()]));
            }
        }
        out.extend(row.iter().map(|&(w, j)| (v.0, Influence { particle: j, weight: w as f32 })));
    }
    (SlotCsr::from_pairs(mesh.vertex_slots(), &out), report)
}

/// Keeps the `limit` strongest of `row`, drops weights that vanish in f32, normalises to sum 1 and sorts by particle.
/// Returns the share that the limit cut off.
pub(super) fn normalise(row: &mut Vec<(f64, ParticleId)>, limit: usize) -> f64 {
    let sum = |row: &[(f64, ParticleId)]| row.iter().map(|e| e.0).sum::<f64>();
    let total = sum(row);
    let mut kept = total;
    if row.len() > limit {
        row.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        row.truncate(limit);
        kept = sum(row);
    }
    let mut left = kept;
    if row.iter().any(|e| e.0 <= 2.0 * f64::from(f32::MIN_POSITIVE) * kept) {
        row.retain(|e| ((e.0 / kept) as f32) >= f32::MIN_POSITIVE);
        left = sum(row);
    }
    row.iter_mut().for_each(|e| e.0 /= left);
    if !row.is_sorted_by_key(|e| e.1) {
        row.sort_unstable_by_key(|e| e.1);
    }
    if total > 0.0 { 1.0 - kept / total } else { 0.0 }
}

/// The particle nearest along edges to each vertex slot; none where no particle is connected.
pub(super) fn nearest_connected(mesh: &Mesh, rest: &[DVec3], anchors: &[VertexId]) -> Vec<ParticleId> {
    let mut nearest = vec![ParticleId::NONE; mesh.vertex_slots()];
    let mut heap = BinaryHeap::new();
    // Lengths are not negative, so their bits sort as they do.
    for (j, &anchor) in anchors.iter().enumerate().filter(|(_, a)| a.is_some()) {
        heap.push(Reverse((0u64, anchor, ParticleId::new(j))));
    }
    while let Some(Reverse((bits, v, j))) = heap.pop() {
        if nearest[v.index()].is_some() {
            continue;
        }
        nearest[v.index()] = j;
        for w in mesh.neighbours(v).filter(|w| nearest[w.index()].is_none()) {
            let length = f64::from_bits(bits) + rest[v.index()].distance(rest[w.index()]);
            heap.push(Reverse((length.to_bits(), w, j)));
        }
    }
    nearest
}

fn neighbour_rows(mesh: &Mesh, rest: &[DVec3], anchors: &[VertexId], delta: f64, flood: &mut Flood) -> SlotCsr<Link> {
    let grid = PointGrid::build(anchors.iter().map(|a| Some(rest[a.index()])), delta);
    let mut links: Vec<(ParticleId, ParticleId)> = Vec::new();
    for (j, &anchor) in anchors.iter().enumerate() {
        let (j, p) = (ParticleId::new(j), rest[anchor.index()]);
        flood.ball(mesh, rest, anchor, delta);
        grid.visit(p - delta, p + delta, |k| {
            let k = ParticleId(k);
            let other = anchors[k.index()];
            let near = rest[other.index()].distance_squared(p) < delta * delta;
            if k != j && near && flood.has_reached(other) {
                links.push((j.min(k), j.max(k)));
            }
        });
    }
    links.sort_unstable();
    links.dedup();
    let length = |&(j, k): &(ParticleId, ParticleId)| rest[anchors[j.index()].index()].distance(rest[anchors[k.index()].index()]);
    let mean = links.iter().map(length).sum::<f64>() / links.len().max(1) as f64;
    let mut entries: Vec<(u32, Link)> = Vec::with_capacity(2 * links.len());
    for link in &links {
        let weight = if mean > 0.0 { link_weight(length(link), mean) } else { 1.0 };
        entries.push((link.0.0, Link { particle: link.1, weight }));
        entries.push((link.1.0, Link { particle: link.0, weight }));
    }
    entries.sort_unstable_by_key(|e| (e.0, e.1.particle));
    SlotCsr::from_pairs(anchors.len(), &entries)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::test_models::{self, Model};
    use crate::particles::{Strips, sample};

    /// The sheet rule by walking fans.
    fn joined(mesh: &Mesh, rest: &[DVec3], p: VertexId, q: VertexId, radius: f64) -> bool {
        let path = |from: VertexId, to: VertexId| {
            let mut found = vec![from];
            let mut next = 0;
            while next < found.len() {
                let v = found[next];
                next += 1;
                for w in mesh.neighbours(v) {
                    if !found.contains(&w) && rest[w.index()].distance(rest[from.index()]) <= radius {
                        found.push(w);
                    }
                }
            }
            found.contains(&to)
        };
        p == q || (rest[p.index()].distance_squared(rest[q.index()]) < radius * radius && (path(p, q) || path(q, p)))
    }

    fn check(model: &Model, settings: &ParticleSettings) -> usize {
        let (mesh, rest) = model;
        let anchors = sample(mesh, rest, settings.spacing, 2);
        let (map, report) = ParticleMap::build(mesh, rest, &anchors, settings);
        map.validate(mesh, rest, &Strips::default()).unwrap();
        assert_eq!((report.unreached, report.truncation_error), (0, 0.0));
        let mut near_only = 0;
        for v in mesh.live_vertices() {
            for (j, &anchor) in anchors.iter().enumerate() {
                let is_linked = map.influences.row(v.index()).iter().any(|e| e.particle.index() == j);
                assert_eq!(is_linked, joined(mesh, rest, v, anchor, settings.radius), "{v:?} {j}");
                let distance = rest[v.index()].distance(rest[anchor.index()]);
                near_only += usize::from(!is_linked && distance < settings.radius);
            }
        }
        for (j, &a) in anchors.iter().enumerate() {
            for (k, &b) in anchors.iter().enumerate().filter(|(k, _)| *k != j) {
                let is_linked = map.neighbours.row(j).iter().any(|l| l.particle.index() == k);
                assert_eq!(is_linked, joined(mesh, rest, a, b, settings.neighbours));
            }
        }
        near_only
    }

    #[test]
    fn influences_and_neighbours_are_those_of_the_sheet_rule() {
        let settings = |spacing: f64| ParticleSettings { max_influences: 16, ..ParticleSettings::with_spacing(spacing) };
        assert_eq!(check(&test_models::grid(12, 0.3, 1), &settings(0.25)), 0);
        for model in [test_models::two_sheets(8, 0.02), test_models::fold(14, 0.1)] {
            assert!(check(&model, &settings(0.3)) > 0, "distance alone must not pass for the rule");
        }
        check(&test_models::spikes(10, 0.4), &settings(0.3));
    }

    #[test]
    fn weights_fall_smoothly_from_one_to_zero() {
        assert_eq!((sigmoid_weight(0.0, 2.0), sigmoid_weight(2.0, 2.0), sigmoid_weight(3.0, 2.0)), (1.0, 0.0, 0.0));
        assert!((sigmoid_weight(1.0, 2.0) - 0.5).abs() < 1e-15);
        let steps: Vec<f64> = (0..=100).map(|i| sigmoid_weight(f64::from(i) * 0.01, 1.0)).collect();
        assert!(steps.is_sorted_by(|a, b| a >= b) && 1.0 - steps[1] < 1e-4 && steps[99] < 1e-4);
    }

    #[test]
    fn truncation_is_reported_and_small_by_default() {
        let (mesh, rest) = test_models::grid(50, 0.5, 1);
        let settings = ParticleSettings::with_spacing(0.1);
        let anchors = sample(&mesh, &rest, settings.spacing, 2);
        let (map, report) = ParticleMap::build(&mesh, &rest, &anchors, &settings);
        assert!(report.truncation_error < 0.02, "{report:?}");
        assert!((0..rest.len()).all(|v| map.influences.row(v).len() <= 8));
        let few = ParticleSettings { max_influences: 2, ..settings };
        assert!(ParticleMap::build(&mesh, &rest, &anchors, &few).1.truncation_error > 0.2);
    }

    #[test]
    fn links_have_mean_weight_one_at_the_mean_length_and_stay_finite() {
        let (mesh, rest) = test_models::grid(20, 0.5, 1);
        let mut rest = rest;
        let settings = ParticleSettings::with_spacing(0.2);
        let anchors = sample(&mesh, &rest, settings.spacing, 2);
        rest[anchors[1].index()] = rest[anchors[0].index()];
        let (map, _) = ParticleMap::build(&mesh, &rest, &anchors, &settings);
        let mut product = Vec::new();
        for j in 0..map.len() {
            for l in map.neighbours.row(j) {
                let length = rest[anchors[j].index()].distance(rest[anchors[l.particle.index()].index()]);
                product.push(length * f64::from(l.weight));
                assert!(l.weight.is_finite() && l.weight <= 20.0);
            }
        }
        let mean = map.mean_link_length(&rest).unwrap();
        let off = product.iter().filter(|p| (*p - mean).abs() > 1e-5 * mean).count();
        assert!(off <= 2, "all but the coinciding pair are inverse to the length");
    }

    #[test]
    fn unreached_vertices_get_the_nearest_connected_particle() {
        let (mesh, rest) = test_models::two_sheets(10, 0.01);
        let settings = ParticleSettings::with_spacing(0.1);
        let anchors = [VertexId(0), VertexId(120)];
        let (map, report) = ParticleMap::build(&mesh, &rest, &anchors, &settings);
        assert!(report.unreached > 50);
        for v in 0..121 {
            let nearer = if rest[v].distance(rest[0]) < rest[v].distance(rest[120]) { 0 } else { 1 };
            let row = map.influences.row(v);
            assert_eq!(row.len(), 1);
            let slack = (rest[v].distance(rest[0]) - rest[v].distance(rest[120])).abs() < 0.4;
            assert!(row[0].particle.index() == nearer || slack, "edge paths may be longer than the straight line");
        }
        assert!((121..242).all(|v| map.influences.row(v).is_empty()), "the other sheet has no particle");
    }
}
