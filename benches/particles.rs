//! Poisson-disk sampling and building the particle map. Mending it is a row of `cargo bench --bench tear`: `update_particles`.
//!
//! Models are made here, so that the figures need no file: unit spheres (octahedra, each face split n x n).

use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;
use incise::geometry::{Mesh, VertexId, Wedge, WedgeId};
use incise::particles::{ParticleMap, ParticleSettings, PoissonScratch, sample, sample_count, sample_with};

fn sphere(n: usize) -> (Mesh, Vec<DVec3>) {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];
    let octants = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]];
    let mut corners = Vec::new();
    for [a, b, c] in octants {
        let at = |i: usize, j: usize| axes[a] * (n - i - j) as f64 + axes[b] * i as f64 + axes[c] * j as f64;
        for i in 0..n {
            for j in 0..n - i {
                corners.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
                if i + j + 1 < n {
                    corners.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
    }
    let key = |p: DVec3| [p.z as i64, p.y as i64, p.x as i64];
    let mut keys: Vec<[i64; 3]> = corners.iter().flatten().map(|&p| key(p)).collect();
    keys.sort_unstable();
    keys.dedup();
    let faces: Vec<[u32; 3]> = corners.iter().map(|t| t.map(|p| keys.binary_search(&key(p)).unwrap_or(0) as u32)).collect();
    let rest: Vec<DVec3> = keys.iter().map(|k| DVec3::new(k[2] as f64, k[1] as f64, k[0] as f64).normalize()).collect();
    let wedge =
        |v: usize| Wedge { vertex: VertexId::new(v), group: WedgeId::new(v), uv: [0.0; 2], normal: [0.0; 3], colour: u32::MAX };
    let mesh = Mesh::build(
        rest.len(),
        faces.iter().map(|f| f.map(VertexId)).collect(),
        faces.iter().map(|f| f.map(WedgeId)).collect(),
        &vec![0; faces.len()],
        (0..rest.len()).map(wedge).collect(),
    );
    (mesh, rest)
}

fn sampling(c: &mut Criterion) {
    for (name, n, wanted) in [("5k vertices, 190 samples", 35, 190), ("1M vertices, 20k samples", 500, 20_000)] {
        let (mesh, rest) = sphere(n);
        let (spacing, _) = sample_count(&mesh, &rest, wanted, 1);
        let (mut scratch, mut samples) = (PoissonScratch::default(), Vec::new());
        let mut group = c.benchmark_group("poisson");
        group.sample_size(if n > 100 { 10 } else { 50 });
        group.bench_function(name, |b| b.iter(|| sample_with(&mesh, &rest, spacing, 1, &mut scratch, &mut samples)));
        group.finish();
    }
}

fn building(c: &mut Criterion) {
    let (mesh, rest) = sphere(48);
    let settings = ParticleSettings::for_model(&mesh, &rest);
    let anchors = sample(&mesh, &rest, settings.spacing, 1);
    let name = format!("{} faces, {} particles", mesh.face_count(), anchors.len());
    c.benchmark_group("map").bench_function(name, |b| b.iter(|| ParticleMap::build(&mesh, &rest, &anchors, &settings)));
}

criterion_group!(benches, sampling, building);
criterion_main!(benches);
