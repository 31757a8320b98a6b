//! One segment of a tear: the five rows of the paper's table, on models from 768 to a million faces, against exact boolean
//! differences of the same boxes. Prints medians and 99th percentiles over the segments of one stroke.
//!
//! `cargo bench --bench tear` runs everything; `cargo bench --bench tear -- heart` only the cases whose name has `heart` in it.
//! `cargo bench --bench tear -- --export FOLDER [MOST_FACES]` writes the models and boxes for other libraries' programs instead.
//!
//! *Scaled*: width, depth and sample distance shrink with the model's edges, so that a segment crosses as many faces as at
//! 18k. *Unscaled*: they stay, so it crosses more.

mod support;

use glam::DVec3;
use incise::particles::ParticleSettings;
use incise::physics::NetworkSettings;
use incise::surgery::{BladePose, SamplingSettings, TearBox, WallMode, write_boxes};
use incise::tissue::stroke::{SegmentReport, TearStroke};
use incise::tissue::{Tissue, TissueSettings};
use std::path::Path;
use std::time::Instant;
use support::{bundled, soup, write_soup};

/// The five rows, in the paper's order.
const ROWS: [&str; 5] = ["perform_tear", "bind", "disconnect_particles", "update_particles", "update_mesh"];
/// Faces of the model that scaled paths are scaled to.
const SCALE_FACES: f64 = 18_000.0;

/// What is torn, and how.
struct Case {
    name: &'static str,
    model: &'static str,
    faces: usize,
    scaled: bool,
    wall: WallMode,
    segments: usize,
    /// The soft layer moves between the samples.
    live: bool,
    /// Differences of boxes that are timed with the reference, 0 for none.
    booleans: usize,
}

const fn case(name: &'static str, model: &'static str, faces: usize, segments: usize) -> Case {
    Case { name, model, faces, scaled: true, wall: WallMode::Open, segments, live: false, booleans: 0 }
}

fn cases() -> Vec<Case> {
    vec![
        Case { scaled: false, ..case("sphere 768", "sphere", 768, 60) },
        Case { scaled: false, ..case("sphere 5k", "sphere", 5_000, 150) },
        Case { booleans: 60, ..case("heart 18k", "heart", 18_000, 150) },
        Case { live: true, ..case("heart 18k live", "heart", 18_000, 150) },
        Case { wall: WallMode::Closed, ..case("heart 18k closed", "heart", 18_000, 150) },
        Case { booleans: 20, ..case("sphere 18k", "sphere", 18_000, 150) },
        case("sphere 100k scaled", "sphere", 100_000, 150),
        Case { booleans: 3, ..case("sphere 1M scaled", "sphere", 1_000_000, 150) },
        Case { scaled: false, ..case("sphere 1M unscaled", "sphere", 1_000_000, 60) },
        case("heart 18k 1000 segments", "heart", 18_000, 1_000),
        case("sphere 18k 1000 segments", "sphere", 18_000, 1_000),
    ]
}

fn build(case: &Case) -> Tissue {
    let (model, rest) = bundled(case.model, case.faces);
    let settings = TissueSettings {
        particles: Some(ParticleSettings::for_count(&model.mesh, &rest, particles(case))),
        network: NetworkSettings::SOFT,
        opening_s: 0.5,
        section_faces: 128,
        fade_s: 0.25,
    };
    Tissue::new(model, &settings).expect("sound settings")
}

/// Particles aimed at: of a scaled path the soft layer is scaled too, so that as many vertices lie within a particle's reach.
fn particles(case: &Case) -> usize {
    if case.scaled { (224.0 * case.faces as f64 / SCALE_FACES) as usize } else { 224 }
}

/// Lengths of a case: the sample distance and the scale of width and depth, as fractions of the diagonal.
fn scale(case: &Case) -> f64 {
    if case.scaled { (SCALE_FACES / case.faces as f64).sqrt() } else { 1.0 }
}

/// A spiral over the model, as seen from its middle: each blade stands on the surface and reaches a little into it.
fn path(tissue: &Tissue, case: &Case) -> Vec<BladePose> {
    let (low, high) = tissue.bounds();
    let (centre, diagonal, scale) = ((low + high) / 2.0, tissue.diagonal(), scale(case));
    let step = 0.02 * scale * diagonal;
    let radius = (high - low).min_element() / 2.0;
    let pitch = (4.0 * step).max(0.04 * radius);
    let (mut angle, mut tilt) = (0.0f64, -0.6f64);
    let mut poses = Vec::new();
    while poses.len() < case.segments + 2 && tilt < 1.3 {
        let out = DVec3::new(tilt.cos() * angle.cos(), tilt.sin(), tilt.cos() * angle.sin());
        let turn = step / (radius * tilt.cos());
        angle += turn;
        tilt += pitch / radius * turn / std::f64::consts::TAU;
        let far = centre + out * diagonal;
        let Some((s, _)) = tissue.blade_entry(centre, far) else { continue };
        let at = far.lerp(centre, s);
        let (tip, base) = (at - out * (0.03 * scale * diagonal), at + out * (0.05 * scale * diagonal));
        poses.push(BladePose { t: poses.len() as f64 / 90.0, tip, base });
    }
    poses
}

/// Median and 99th percentile.
fn quantiles(mut values: Vec<f64>) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    let at = |q: f64| values.get(((values.len() as f64 - 1.0) * q).round() as usize).copied().unwrap_or(f64::NAN);
    (at(0.5), at(0.99))
}

fn total(report: &SegmentReport) -> f64 {
    ROWS.iter().map(|row| report.stages.get(row)).sum()
}

/// Runs a stroke; returns the reports, the boxes and the milliseconds of each push.
fn tear(tissue: &mut Tissue, case: &Case, poses: &[BladePose]) -> (Vec<SegmentReport>, Vec<TearBox>, Vec<f64>) {
    let (diagonal, scale) = (tissue.diagonal(), scale(case));
    let sampling = SamplingSettings::default().with_distance(0.02 * scale * diagonal, diagonal);
    let mut stroke = TearStroke::new(tissue, 0.01 * scale * diagonal, sampling).walled(case.wall);
    let mut pushes = Vec::new();
    for pose in poses {
        if case.live {
            tissue.set_pose(pose.t, None, 0.0);
            tissue.step(1.0 / 90.0);
        }
        let start = Instant::now();
        stroke.push(tissue, *pose);
        pushes.push(start.elapsed().as_secs_f64() * 1e3);
        stroke.drain_deltas(|_| {});
    }
    stroke.release(tissue);
    let reports = stroke.reports().iter().filter(|r| r.new_vertices > 0).cloned().collect();
    (reports, stroke.boxes().to_vec(), pushes)
}

/// Milliseconds of each difference of the result so far and the next box, with a port of manifold, one core.
fn booleans((points, triangles): &(Vec<DVec3>, Vec<[u32; 3]>), boxes: &[TearBox]) -> Vec<f64> {
    use boolmesh::prelude::{Manifold, OpType, compute_boolean};
    let positions: Vec<f64> = points.iter().flat_map(|p| p.to_array()).collect();
    let indices: Vec<usize> = triangles.iter().flatten().map(|&v| v as usize).collect();
    let Ok(mut whole) = Manifold::<f64>::new(&positions, &indices) else { return Vec::new() };
    let mut times = Vec::new();
    for tear_box in boxes {
        let corners: Vec<f64> = tear_box.corners().iter().flat_map(|c| c.to_array()).collect();
        let triangles: Vec<usize> = tear_box.hull_triangles().iter().flatten().map(|&k| usize::from(k)).collect();
        let Ok(part) = Manifold::<f64>::new(&corners, &triangles) else { continue };
        let start = Instant::now();
        let result = compute_boolean(&whole, &part, OpType::Subtract);
        times.push(start.elapsed().as_secs_f64() * 1e3);
        if let Ok(result) = result {
            whole = result;
        }
    }
    times
}

fn run(case: &Case) {
    let mut tissue = build(case);
    let before = (case.booleans > 0).then(|| soup(&tissue));
    let particles = tissue.layer().map_or(0, |l| l.map.len());
    let poses = path(&tissue, case);
    let (reports, boxes, pushes) = tear(&mut tissue, case, &poses);
    let (median, p99) = quantiles(reports.iter().map(total).collect());
    let mean = |f: &dyn Fn(&SegmentReport) -> usize| reports.iter().map(f).sum::<usize>() as f64 / reports.len().max(1) as f64;
    println!(
        "{}: {} faces, {particles} particles, {} segments: {median:.4} ms median, {p99:.4} ms p99; a whole push {:.4} / {:.4} ms; \
         {:.1} vertices inserted, {:.1} faces looked at, {:.2} us a vertex inserted",
        case.name,
        tissue.mesh().face_count(),
        reports.len(),
        quantiles(pushes.clone()).0,
        quantiles(pushes).1,
        mean(&|r| r.new_vertices),
        mean(&|r| r.faces_visited),
        1e3 * median / mean(&|r| r.new_vertices).max(1.0),
    );
    for row in ROWS {
        let (median, p99) = quantiles(reports.iter().map(|r| r.stages.get(row)).collect());
        println!("    {row:22} {median:.4} ms median, {p99:.4} ms p99");
    }
    if reports.len() >= 1_000 {
        let medians: Vec<String> =
            reports.chunks(200).map(|part| format!("{:.4}", quantiles(part.iter().map(total).collect()).0)).collect();
        println!("    medians of 200 after each other: {} ms", medians.join(", "));
    }
    if let Some(soup) = before {
        let times = booleans(&soup, &boxes[..case.booleans.min(boxes.len())]);
        let (boolean, _) = quantiles(times);
        println!("    boolmesh (port of manifold), one box: {boolean:.3} ms median; {:.0} x ours", boolean / median);
    }
}

/// Writes each model as loaded and its boxes, as OBJ, for other libraries.
fn export(case: &Case, folder: &Path) -> std::io::Result<()> {
    let mut tissue = build(case);
    let stem = case.name.replace(' ', "-");
    write_soup(&folder.join(format!("{stem}.obj")), &soup(&tissue))?;
    let poses = path(&tissue, case);
    let (_, boxes, _) = tear(&mut tissue, case, &poses[..poses.len().min(22)]);
    let mut bytes = Vec::new();
    write_boxes(&mut bytes, &boxes, DVec3::ZERO)?;
    std::fs::write(folder.join(format!("{stem}-boxes.obj")), bytes)
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    if arguments.iter().any(|a| a == "--test") {
        run(&Case { segments: 10, ..case("sphere 768", "sphere", 768, 10) });
        return;
    }
    let folder = arguments.iter().position(|a| a == "--export").and_then(|i| arguments.get(i + 1));
    if let Some(folder) = folder {
        std::fs::create_dir_all(folder).expect("a folder to write to");
        let most = arguments.iter().find_map(|a| a.parse().ok()).unwrap_or(usize::MAX);
        for case in cases().iter().filter(|c| c.booleans > 0 && c.faces <= most) {
            export(case, Path::new(folder)).expect("room for the files");
        }
        return;
    }
    let wanted = arguments.first().cloned().unwrap_or_default();
    for case in cases().iter().filter(|c| c.name.contains(&wanted)) {
        run(case);
    }
}
