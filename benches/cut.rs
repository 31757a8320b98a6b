//! The plane cut against the goals: in place without caps, and into two closed pieces; every attribute, binding and the
//! particle map included. Medians, milliseconds; beside it parry3d's split on the same triangles.
//!
//! `cargo bench --bench cut [-- MOST_FACES [LEAST_FACES]]`
//! `cargo bench --bench cut -- --export FOLDER` writes the models for other libraries' programs instead: `benches/peers/run`.

use glam::DVec3;
use incise::diagnostics::Stages;
use incise::formats;
use incise::geometry::{Plane, VertexId};
use incise::particles::ParticleSettings;
use incise::physics::NetworkSettings;
use incise::scene::{EditCommand, Scene, SceneSettings};
use incise::surgery::SamplingSettings;
use incise::tissue::edit::CutScratch;
use incise::tissue::{Tissue, TissueSettings};
use parry3d::shape::TriMesh;
use std::time::Instant;

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
    let folder = std::env::temp_dir().join(format!("incise-cut-{}-{faces}.glb", std::process::id()));
    std::fs::write(&folder, formats::generate("sphere", Some(faces)).expect("a bundled model")).expect("a temporary file");
    let model = formats::load(&folder.to_string_lossy()).expect("a written model");
    std::fs::remove_file(&folder).ok();
    let rest: Vec<DVec3> = (0..model.rows.len()).map(|v| model.rows.rest(VertexId::new(v))).collect();
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

fn export(folder: &str) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    for faces in SIZES {
        let (points, triangles) = soup(&tissue(faces, false));
        let mut text = String::new();
        points.iter().for_each(|p| text += &format!("v {} {} {}\n", p.x, p.y, p.z));
        triangles.iter().for_each(|f| text += &format!("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1));
        std::fs::write(format!("{folder}/cut-{faces}.obj"), text)?;
    }
    Ok(())
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let Some(folder) = arguments.iter().position(|a| a == "--export").and_then(|i| arguments.get(i + 1)) {
        export(folder).expect("room for the files");
        return;
    }
    let mut sizes = std::env::args().filter_map(|a| a.parse().ok());
    let (most, least) = (sizes.next().unwrap_or(1_000_000usize), sizes.next().unwrap_or(0));
    for faces in SIZES.into_iter().filter(|f| (least..=most).contains(f)) {
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
                    subject.travel(vec![std::sync::Arc::new(delta)]);
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

/// Positions and triangles.
fn soup(subject: &Tissue) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let points = (0..subject.mesh().vertex_slots()).map(|v| subject.position(VertexId::new(v))).collect();
    (points, subject.mesh().live_faces().map(|f| subject.mesh().face(f).map(|v| v.0)).collect())
}

fn peers(faces: usize, rounds: usize) {
    let (points, triangles) = soup(&tissue(faces, false));
    let vertices = points.iter().map(|p| parry3d::math::Vector::from(p.as_vec3().to_array())).collect();
    let Ok(mesh) = TriMesh::new(vertices, triangles) else { return };
    let axis = parry3d::math::Vector::new(0.3, 1.0, 0.2).normalize();
    let times = (0..rounds.min(11)).map(|_| ms(|| drop(std::hint::black_box(mesh.local_split(axis, 0.001, 1e-6))))).collect();
    report("parry3d local_split, two closed", faces, times, &[]);
}
