//! The plane cut against the goals: in place without caps, and into two closed pieces; every attribute, binding and the
//! particle map included. Medians, milliseconds; beside it parry3d's split on the same triangles.
//!
//! `cargo bench --bench cut [-- MOST_FACES [LEAST_FACES]]`
//! `cargo bench --bench cut -- --export FOLDER [MOST_FACES [LEAST_FACES]]` writes the models for other libraries' programs instead: `benches/peers/run`.

mod support;

use glam::DVec3;
use incise::diagnostics::Stages;
use incise::geometry::Plane;
use incise::particles::ParticleSettings;
use incise::physics::NetworkSettings;
use incise::scene::{EditCommand, Scene, SceneSettings};
use incise::surgery::SamplingSettings;
use incise::tissue::edit::CutScratch;
use incise::tissue::{Tissue, TissueSettings};
use parry3d::shape::TriMesh;
use std::path::Path;
use std::time::Instant;
use support::{bundled, soup, write_soup};

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn ms(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64() * 1e3
}

fn tissue(faces: usize, particles: bool) -> Tissue {
    let (model, rest) = bundled("sphere", faces);
    let settings = TissueSettings {
        particles: particles.then(|| ParticleSettings::for_model(&model.mesh, &rest)),
        network: NetworkSettings::SOFT,
        opening_s: 0.3,
        section_faces: 64,
        fade_s: 0.25,
    };
    Tissue::new(model, &settings).expect("good settings")
}

fn report(name: &str, faces: usize, times: Vec<f64>, stages: &[Stages]) {
    let mut line = format!("{faces:>8} faces  {name:<34} {:>9.3} ms", median(times));
    for &(stage, _) in stages.first().map(Stages::rows).unwrap_or_default() {
        line += &format!("  {stage} {:.3}", median(stages.iter().map(|s| s.get(stage)).collect()));
    }
    println!("{line}");
}

const SIZES: [usize; 5] = [768, 5_000, 18_000, 100_000, 1_000_000];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let numbers: Vec<usize> = arguments.iter().filter_map(|a| a.parse().ok()).collect();
    let (most, least) = (numbers.first().copied().unwrap_or(usize::MAX), numbers.get(1).copied().unwrap_or(0));
    let folder = arguments.iter().position(|a| a == "--export").and_then(|i| arguments.get(i + 1));
    for faces in SIZES.into_iter().filter(|f| (least..=most).contains(f)) {
        if let Some(folder) = folder {
            std::fs::create_dir_all(folder).expect("a folder to write to");
            let path = Path::new(folder).join(format!("cut-{faces}.obj"));
            write_soup(&path, &soup(&tissue(faces, false))).expect("room for the file");
            continue;
        }
        let rounds = (200_000 / faces).clamp(5, 41);
        for particles in [false, true] {
            let mut subject = tissue(faces, particles);
            let (low, high) = subject.bounds();
            let normal = DVec3::new(0.3, 1.0, 0.2).normalize();
            let plane = Plane::Equation { normal, offset: normal.dot((low + high) / 2.0) + 0.01 * (high - low).length() };
            let with = if particles { "with particles" } else { "no particles" };
            let mut scratch = CutScratch::default();
            for closed in [false, true] {
                let (mut times, mut all) = (Vec::new(), Vec::new());
                for _ in 0..=rounds {
                    let mut stages = Stages::default();
                    times.push(ms(|| {
                        if closed {
                            subject.cut_closed(&plane, &mut scratch, &mut stages);
                        } else {
                            subject.cut(&plane, &mut scratch.split, &mut stages);
                        }
                    }));
                    all.push(stages);
                    let delta = subject.take_delta();
                    subject.travel(vec![std::sync::Arc::new(delta)], std::iter::empty());
                }
                // the first grows the buffers
                let name = format!("in place{}, {with}", if closed { " with caps" } else { "" });
                report(&name, subject.mesh().face_count(), times.split_off(1), &all.split_off(1));
            }
            let tools = SceneSettings { sampling: SamplingSettings::default(), sample_distance: None, sample_time: None };
            let offset = subject.offset();
            let Plane::Equation { normal, offset: d } = plane else { continue };
            let world = Plane::Equation { normal, offset: d + normal.dot(offset) };
            let mut scene = Scene::new(subject, tools);
            scene.set_measuring(false); // areas and volumes are the report's, not the cut's; peers have none either
            let (mut times, mut all) = (Vec::new(), Vec::new());
            for _ in 0..=rounds {
                let mut stages = Stages::default();
                times.push(ms(|| stages = scene.edit(EditCommand::CutClosed(world)).pop().map(|r| r.stages).unwrap_or_default()));
                all.push(stages);
                scene.edit(EditCommand::Undo);
            }
            report(&format!("two closed pieces, {with}"), faces, times.split_off(1), &all.split_off(1));
        }
        peers(faces, rounds);
    }
}

fn peers(faces: usize, rounds: usize) {
    let (points, triangles) = soup(&tissue(faces, false));
    let vertices = points.iter().map(|p| parry3d::math::Vector::from(p.as_vec3().to_array())).collect();
    let Ok(mesh) = TriMesh::new(vertices, triangles) else { return };
    let axis = parry3d::math::Vector::new(0.3, 1.0, 0.2).normalize();
    let times = (0..rounds.min(11)).map(|_| ms(|| drop(std::hint::black_box(mesh.local_split(axis, 0.001, 1e-6))))).collect();
    report("parry3d local_split, two closed", faces, times, &[]);
}
