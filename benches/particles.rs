//! Poisson-disk sampling, building the particle map, and mending it after one tear segment.
//!
//! Models are made here, so that the figures need no file: unit spheres (octahedra, each face split n x n).

use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;
use incise::geometry::topology::TopologyScratch;
use incise::geometry::{HalfEdge, Mesh, VertexId, Wedge, WedgeId};
use incise::particles::{
    LipVertex, MapEdit, NewVertex, ParticleMap, ParticleSettings, PoissonScratch, Strips, UpdateScratch, sample, sample_count,
    sample_with, update_after_edit,
};
use std::hint::black_box;
use std::time::{Duration, Instant};

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

/// A slit of width 0 along five edges of the equator of an 18k-face sphere.
fn updating(c: &mut Criterion) {
    let (mut mesh, mut rest) = sphere(48);
    let settings = ParticleSettings::for_model(&mesh, &rest);
    let anchors = sample(&mesh, &rest, settings.spacing, 1);
    let (map, _) = ParticleMap::build(&mesh, &rest, &anchors, &settings);
    let line: Vec<VertexId> = mesh
        .live_vertices()
        .filter(|v| rest[v.index()].z == 0.0 && rest[v.index()].y.abs() < 0.09 && rest[v.index()].x > 0.0)
        .collect();
    for f in mesh.live_faces().collect::<Vec<_>>() {
        for k in 0..3 {
            let h = HalfEdge::of(f, k);
            if line.contains(&mesh.from(h)) && line.contains(&mesh.to(h)) {
                mesh.open_edge(h);
            }
        }
    }
    let faces: Vec<_> = mesh.live_faces().collect();
    let mut copies = Vec::new();
    mesh.split_fans(&line, &faces, &mut TopologyScratch::default(), &mut copies);
    let new: Vec<NewVertex> = copies
        .iter()
        .map(|s| NewVertex { vertex: s.vertex, parents: [s.from, VertexId::NONE, VertexId::NONE], is_apart: false })
        .collect();
    rest.extend(copies.iter().map(|s| rest[s.from.index()]).collect::<Vec<_>>());
    let mut strips = Strips::default();
    let ys: Vec<f64> = line.iter().map(|v| rest[v.index()].y).collect();
    let (y0, y1) = (ys.iter().copied().fold(1.0, f64::min), ys.iter().copied().fold(-1.0, f64::max));
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let pushed = strips.push([at(0.9, y0), at(0.9, y1), at(1.01, y1), at(1.01, y0)], settings.radius, 0);
    assert!(pushed.is_ok());
    let side_of = |v: VertexId| {
        let up = mesh.fan(v).map(|h| mesh.face(h.face()).iter().map(|u| rest[u.index()].z).sum::<f64>()).sum::<f64>();
        if (up > 0.0) == (strips.geometry(0).normal().z > 0.0) { 1 } else { -1 }
    };
    let lips: Vec<LipVertex> = copies
        .iter()
        .flat_map(|s| [s.from, s.vertex])
        .map(|vertex| LipVertex { vertex, strip: 0, side: side_of(vertex) })
        .collect();
    let mut warm = (map.clone(), strips.clone());
    let mut scratch = UpdateScratch::default();
    let edit = MapEdit { new_vertices: &new, removed_vertices: &[], new_strips: 0..1, lips: &lips };
    // The first update of a tissue builds its grids and grows the tables; a tear in progress has them.
    let report = update_after_edit(&mesh, &rest, &mut warm.0, &mut warm.1, &edit, &settings, &mut scratch);
    println!(
        "one segment at {} faces: {} visited, {} changed, {} influences and {} links cut, {} particles added",
        mesh.face_count(),
        report.vertices_visited,
        report.vertices_changed.len(),
        report.influences_removed,
        report.links_removed,
        report.particles_added.len()
    );
    let (map, strips) = (&mut warm.0, &mut warm.1);
    let undo = |map: &mut ParticleMap, strips: &mut Strips| {
        let deltas = (map.take_delta(), strips.take_delta());
        map.apply_delta(deltas.0);
        strips.apply_delta(deltas.1);
    };
    undo(map, strips);
    c.benchmark_group("map").bench_function("update after one segment, 18k faces", |b| {
        b.iter_custom(|rounds| {
            let mut total = Duration::ZERO;
            for _ in 0..rounds {
                let start = Instant::now();
                black_box(update_after_edit(&mesh, &rest, map, strips, &edit, &settings, &mut scratch));
                total += start.elapsed();
                undo(map, strips);
            }
            total
        });
    });
}

criterion_group!(benches, sampling, building, updating);
criterion_main!(benches);
