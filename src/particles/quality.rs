//! Figures of a sample set (MATHS 3.1).

use super::flood::Flood;
use super::point_grid::PointGrid;
use super::settings::face_area;
use crate::geometry::{Mesh, VertexId};
use glam::DVec3;

/// How good a Poisson-disk set is. Lengths in metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleQuality {
    /// Least distance of two samples of one sheet: joined by a path no further away than the spacing or than they are apart.
    /// Infinite if none are.
    pub min_spacing_same_sheet: f64,
    /// Least distance of any two samples, whatever their sheets; infinite for fewer than two.
    pub min_spacing_euclidean: f64,
    /// Largest distance of a live vertex from the nearest sample of its sheet: at most the spacing where the set is maximal;
    /// infinite if a vertex has none.
    pub coverage: f64,
    /// Spacing over that of a hexagonal packing of as many samples, `sqrt(2 A / (sqrt(3) N))`: 1 at best.
    pub radius_ratio: f64,
    /// Standard deviation of the distances to the nearest sample of the same sheet over their mean: 0 for a lattice, 0.5 for
    /// random points.
    pub nearest_cv: f64,
}

/// Figures of `samples` taken with `spacing` on `mesh`; `rest` has a position for every vertex slot.
pub fn sample_quality(mesh: &Mesh, rest: &[DVec3], samples: &[VertexId], spacing: f64) -> SampleQuality {
    let mut nearest_sample = vec![f64::INFINITY; mesh.vertex_slots()];
    let mut nearest = vec![f64::INFINITY; samples.len()];
    let mut index = vec![u32::MAX; mesh.vertex_slots()];
    for (j, v) in samples.iter().enumerate() {
        index[v.index()] = j as u32;
    }
    let mut flood = Flood::default();
    for &sample in samples {
        let centre = rest[sample.index()];
        for &v in flood.ball(mesh, rest, sample, spacing) {
            let at = &mut nearest_sample[v.index()];
            *at = at.min(rest[v.index()].distance(centre));
        }
    }
    // joined by a path near the vertex only, or by none within the spacing
    for v in mesh.live_vertices() {
        let mut reach = spacing;
        while nearest_sample[v.index()] == f64::INFINITY && reach <= 4.0 * spacing {
            let found = flood.ball(mesh, rest, v, reach).iter().filter(|u| index[u.index()] != u32::MAX);
            nearest_sample[v.index()] = found.map(|u| rest[u.index()].distance(rest[v.index()])).fold(f64::INFINITY, f64::min);
            reach *= 2.0;
        }
    }
    for (j, &sample) in samples.iter().enumerate() {
        nearest[j] = nearest_on_sheet(mesh, rest, sample, spacing, &index, &mut flood);
    }
    let area: f64 = mesh.live_faces().map(|f| face_area(mesh.face(f).map(|v| rest[v.index()]))).sum();
    let hexagonal = (2.0 * area / (3f64.sqrt() * samples.len().max(1) as f64)).sqrt();
    SampleQuality {
        min_spacing_same_sheet: nearest.iter().copied().fold(f64::INFINITY, f64::min),
        min_spacing_euclidean: min_spacing(rest, samples, spacing),
        coverage: mesh.live_vertices().map(|v| nearest_sample[v.index()]).fold(0.0, f64::max),
        radius_ratio: if hexagonal > 0.0 { spacing / hexagonal } else { 0.0 },
        nearest_cv: variation(&nearest),
    }
}

/// Distance of `sample` from the nearest other one of its sheet: joined by a path that goes no further from `sample` than the
/// spacing or that other one, whichever is more. So the far side of a thin plate is another sheet, though a path round the
/// rim leads there. Infinite if there is none within twice the spacing.
fn nearest_on_sheet(mesh: &Mesh, rest: &[DVec3], sample: VertexId, spacing: f64, index: &[u32], flood: &mut Flood) -> f64 {
    let centre = rest[sample.index()];
    let others = flood.ball(mesh, rest, sample, 2.0 * spacing).iter().filter(|v| **v != sample && index[v.index()] != u32::MAX);
    let mut others: Vec<(f64, VertexId)> = others.map(|&v| (rest[v.index()].distance(centre), v)).collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    // a hair more than the distance, so that the other one itself is within
    let mut joined =
        |&(distance, v): &(f64, VertexId)| flood.ball(mesh, rest, sample, distance.max(spacing) * (1.0 + 1e-12)).contains(&v);
    others.iter().find(|other| joined(other)).map_or(f64::INFINITY, |other| other.0)
}

/// Least distance of two samples, by a grid that is widened until it finds a pair.
fn min_spacing(rest: &[DVec3], samples: &[VertexId], spacing: f64) -> f64 {
    let at = |j: usize| rest[samples[j].index()];
    let mut reach = spacing;
    while samples.len() > 1 && reach.is_finite() && reach > 0.0 {
        let grid = PointGrid::build((0..samples.len()).map(|j| Some(at(j))), reach);
        let mut least = f64::INFINITY;
        for j in 0..samples.len() {
            grid.visit(at(j) - reach, at(j) + reach, |k| {
                if k as usize != j {
                    least = least.min(at(j).distance(at(k as usize)));
                }
            });
        }
        if least <= reach {
            return least;
        }
        reach *= 4.0;
    }
    f64::INFINITY
}

/// Standard deviation over mean of the finite values; 0 for fewer than two.
fn variation(values: &[f64]) -> f64 {
    let finite = || values.iter().copied().filter(|x| x.is_finite());
    let count = finite().count();
    if count < 2 {
        return 0.0;
    }
    let mean = finite().sum::<f64>() / count as f64;
    let variance = finite().map(|x| (x - mean) * (x - mean)).sum::<f64>() / count as f64;
    if mean > 0.0 { variance.sqrt() / mean } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::{sample, test_models};

    #[test]
    fn the_front_packs_densely_on_flat_and_curved_models() {
        for (mesh, rest) in [test_models::grid(60, 0.6, 4), test_models::sphere(30)] {
            let edge = test_models::mean_edge(&mesh, &rest);
            for (seed, edges) in [(1, 4.0), (2, 5.0), (3, 6.5)] {
                let spacing = edges * edge;
                let samples = sample(&mesh, &rest, spacing, seed);
                let q = sample_quality(&mesh, &rest, &samples, spacing);
                assert!(q.radius_ratio >= 0.75, "{q:?}");
                assert!(q.min_spacing_same_sheet >= spacing && q.coverage <= spacing, "{q:?}");
                assert!(q.nearest_cv < 0.2);
                let every_other: Vec<VertexId> = samples.iter().copied().step_by(2).collect();
                let thin = sample_quality(&mesh, &rest, &every_other, spacing);
                assert!(thin.coverage > spacing && thin.radius_ratio < 0.7, "a thinned set must fail");
            }
        }
    }

    #[test]
    fn sheets_are_told_apart() {
        let (mesh, rest) = test_models::two_sheets(20, 0.01);
        let samples = sample(&mesh, &rest, 0.2, 1);
        let q = sample_quality(&mesh, &rest, &samples, 0.2);
        assert!(q.min_spacing_same_sheet >= 0.2 && q.min_spacing_euclidean < 0.2);
    }

    #[test]
    fn the_least_distance_is_that_of_all_pairs() {
        let rest: Vec<DVec3> = (0..60).map(|i| DVec3::new(test_models::noise(i), test_models::noise(i + 99), 0.0)).collect();
        let samples: Vec<VertexId> = (0..60).map(VertexId::new).collect();
        let all = (0..60).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| rest[i].distance(rest[j]));
        let least = all.fold(f64::INFINITY, f64::min);
        assert_eq!(min_spacing(&rest, &samples, 1e-4), least);
        assert_eq!(min_spacing(&rest, &samples[..1], 1e-4), f64::INFINITY);
    }
}
