//! The CPU's side of a frame at 18k faces and 224 particles, up to the submission: tools, pose, physics, upload notes, the encoding
//! of deform, shadow and both eyes, and wgpu's own work on the command buffer; while the model sleeps, while it moves, and while it
//! beats and is torn. Prints medians, and what a frame did.
//!
//! Three times: with the CPU free for it, as where a GPU draws (two eyes of 2,064 by 2,208 pixels; what was encoded is dropped), frame
//! after frame and at a headset's pace, 90 a second, asleep in between; and with what was encoded submitted and waited for. On the
//! software adapter the CPU then draws between the frames, small eyes, and each begins with other people's caches; a GPU draws the
//! whole eyes, and what its passes and the submission took is printed too.

use glam::DVec3;
use incise::app::{App, FrameCounters, FrameTarget, FrameView};
use incise::diagnostics::Stages;
use incise::formats;
use incise::geometry::VertexId;
use incise::gpu::targets::Picture;
use incise::gpu::{
    AdapterKind, Camera, Context, ContextOptions, DrawOptions, GpuError, GpuTimes, RenderTarget, ViewPose, ViewSet,
};
use incise::host::mirror::Mirror;
use incise::input::InputFrame;
use incise::particles::ParticleSettings;
use incise::physics::NetworkSettings;
use incise::scene::{EditCommand, Scene, SceneSettings};
use incise::surgery::{BladePose, SamplingSettings};
use incise::tissue::{Tissue, TissueSettings};
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use std::alloc::System;
use std::sync::Arc;
use std::time::{Duration, Instant};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

fn allocations() -> u64 {
    let stats = ALLOCATOR.stats();
    (stats.allocations + stats.reallocations) as u64
}

const FRAMES: usize = 400;

/// Width and height of an eye.
const EYE: (u32, u32) = (2064, 2208);
const SMALL_EYE: (u32, u32) = (64, 64);

/// What the machine does between two frames.
#[derive(Clone, Copy, PartialEq)]
enum Between {
    /// The next frame.
    Nothing,
    /// It sleeps until the next picture of a headset is due.
    Sleep,
    /// It draws, where the adapter is a software one.
    Draw,
}

/// Times everything but the submission.
struct Target {
    mirror: Mirror,
    between: Between,
    due: Instant,
    colour: Picture,
    views: [ViewPose; 2],
    sync_ms: f64,
    encode_ms: f64,
    submit_ms: f64,
    sync_allocations: u64,
    gpu: Passes,
}

/// What a GPU's passes took, and handing it the work, milliseconds a frame.
#[derive(Default)]
struct Passes {
    frame: u64,
    passes: Vec<(&'static str, Vec<f64>)>,
    submit: Vec<f64>,
}

impl Passes {
    /// Takes in the times of a frame that are not known yet.
    fn add(&mut self, times: Option<GpuTimes>) {
        let Some(times) = times.filter(|t| t.frame() > self.frame) else { return };
        self.frame = times.frame();
        for &(name, _) in times.passes() {
            if self.passes.iter().all(|(known, _)| *known != name) {
                self.passes.push((name, Vec::new()));
            }
        }
        for (name, all) in &mut self.passes {
            all.push(times.passes().iter().filter(|p| p.0 == *name).map(|p| p.1).sum());
        }
    }

    /// Prints what has come together, and begins anew.
    fn print(&mut self, what: &str) {
        if self.submit.is_empty() || self.passes.is_empty() {
            return;
        }
        let rows: Vec<String> = self.passes.iter_mut().map(|(name, ms)| format!("{name} {}", row(ms))).collect();
        println!("{what}, on the GPU: {} ms; submission {}", rows.join(", "), row(&mut self.submit));
        (self.passes, self.submit) = Default::default();
    }
}

impl Target {
    fn new(camera: &Camera, between: Between) -> Self {
        let context = Arc::new(Context::headless(ContextOptions::default()).expect("an adapter"));
        let is_gpu = context.adapter_kind() != AdapterKind::Software;
        let (drawing, size) = match between {
            Between::Nothing => ("not drawn", EYE),
            Between::Sleep => ("not drawn, 90 frames a second", EYE),
            Between::Draw => ("drawn between the frames", if is_gpu { EYE } else { SMALL_EYE }),
        };
        println!("{drawing}, adapter {}", context.adapter_name());
        let colour = Picture::new(&context, size, 2).expect("a picture");
        let eye = |side: f64| {
            let eye = camera.eye + DVec3::X * (0.032 * side);
            ViewPose::from_camera(&Camera { eye, ..*camera }, f64::from(EYE.0) / f64::from(EYE.1)).expect("a view")
        };
        let mut mirror = Mirror::new(context);
        mirror.renderer_mut().set_timing(is_gpu && between == Between::Draw);
        Self {
            colour,
            mirror,
            between,
            due: Instant::now(),
            views: [eye(-1.0), eye(1.0)],
            sync_ms: 0.0,
            encode_ms: 0.0,
            submit_ms: 0.0,
            sync_allocations: 0,
            gpu: Passes::default(),
        }
    }
}

impl Target {
    /// Waits for the next frame.
    fn pace(&mut self) {
        if self.between == Between::Sleep {
            std::thread::sleep(self.due.saturating_duration_since(Instant::now()));
            self.due = Instant::now().max(self.due) + Duration::from_secs_f64(1.0 / 90.0);
        }
    }
}

impl FrameTarget for Target {
    type Error = GpuError;

    fn present(&mut self, view: &FrameView, _: &mut Stages, counters: &mut FrameCounters) -> Result<(), GpuError> {
        let ms = |start: Instant| start.elapsed().as_secs_f64() * 1e3;
        let (start, before) = (Instant::now(), allocations());
        self.mirror.sync(view)?;
        let lines = self.mirror.layer_lines(view);
        (self.sync_ms, self.sync_allocations) = (ms(start), allocations() - before);
        let context = self.mirror.renderer().context().clone();
        let start = Instant::now();
        let mut encoder = context.device().create_command_encoder(&Default::default());
        let options = DrawOptions { lines: &lines, ..Default::default() };
        let target = RenderTarget::new(self.colour.target());
        self.mirror.renderer_mut().encode(&mut encoder, &ViewSet::new(&self.views), &target, &options)?;
        let commands = encoder.finish();
        self.encode_ms = ms(start);
        let start = Instant::now();
        if self.between == Between::Draw {
            context.queue().submit([commands]);
            self.gpu.submit.push(ms(start));
            context.wait()?;
            self.gpu.add(self.mirror.renderer_mut().gpu_times());
        } else {
            drop(commands);
        }
        self.submit_ms = ms(start);
        self.mirror.count(counters);
        Ok(())
    }
}

fn app() -> App {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("heart.glb");
    std::fs::write(&path, formats::generate("heart", Some(18_000)).expect("bundled")).expect("writable");
    let model = formats::load(path.to_str().expect("UTF-8")).expect("loads");
    let rest: Vec<_> = (0..model.rows.len()).map(|v| model.rows.rest(VertexId::new(v))).collect();
    let settings = TissueSettings {
        particles: Some(ParticleSettings::for_model(&model.mesh, &rest)),
        network: NetworkSettings::SOFT,
        opening_s: 0.4,
        section_faces: 64,
        fade_s: 0.25,
    };
    let faces = model.mesh.live_faces().count();
    let tissue = Tissue::new(model, &settings).expect("a tissue");
    println!("\n{faces} faces, {} particles", tissue.layer().map_or(0, |l| l.map.len()));
    let tools = SceneSettings { sampling: SamplingSettings::default(), sample_distance: None, sample_time: None };
    App::new(Scene::new(tissue, tools), 1.0, allocations)
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Runs frames and prints their medians; the first ones are left out. Those that are measured do the work that they stand for: asleep
/// none, animated a deform pass, and neither allocates.
fn measure(name: &str, app: &mut App, target: &mut Target, first: usize, animated: bool) {
    let (mut app_ms, mut sync_ms, mut encode_ms, mut all_ms) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut last = FrameCounters::default();
    for k in 0..FRAMES {
        let time_s = if animated { (first + k) as f64 / 90.0 } else { 0.0 };
        // a hand that stays where it is lets the springs come to rest
        let by = DVec3::new(0.0, 0.001 * (time_s * 5.0).sin(), 0.01);
        let commands = if animated { vec![EditCommand::GrabMove { id: 1, by }] } else { Vec::new() };
        let input = InputFrame { time_s, step_s: 1.0 / 90.0, commands, ..InputFrame::default() };
        target.pace();
        let start = Instant::now();
        let report = app.frame(&input, target).expect("a frame");
        let whole = start.elapsed().as_secs_f64() * 1e3 - target.submit_ms;
        if k >= FRAMES / 4 {
            app_ms.push(whole - target.sync_ms - target.encode_ms);
            sync_ms.push(target.sync_ms);
            encode_ms.push(target.encode_ms);
            all_ms.push(whole);
            last = report.counters;
            let FrameCounters { dispatches, bytes_uploaded, particles_awake, .. } = last;
            assert_eq!((last.allocations, target.sync_allocations), (0, 0), "{name}, frame {k}");
            assert_eq!(
                (dispatches > 0, bytes_uploaded > 0, particles_awake > 0),
                (animated, animated, animated),
                "{name}, frame {k}"
            );
        }
    }
    println!(
        "{name}: {:.4} ms (app {:.4}, sync {:.4}, encode {:.4}); allocations {} + {}, dispatches {}, bytes {}, awake {}",
        median(&mut all_ms),
        median(&mut app_ms),
        median(&mut sync_ms),
        median(&mut encode_ms),
        last.allocations,
        target.sync_allocations,
        last.dispatches,
        last.bytes_uploaded,
        last.particles_awake
    );
    target.gpu.print(name);
}

/// Median, 99 of 100 and most.
fn row(times: &mut [f64]) -> String {
    let middle = median(times);
    format!("{middle:.4} (99 %: {:.4}, most {:.4})", times[times.len() * 99 / 100], times[times.len() - 1])
}

/// Grows with every segment.
fn vertex_slots(app: &App) -> usize {
    app.scene.tissues().map(|(_, t)| t.mesh().vertex_slots()).sum()
}

/// Tears the beating heart, ten strokes of a second, and prints what the frames took in which a stroke began, the blade moved,
/// a segment was cut, and the stroke ended; the first stroke warms up.
fn tear(app: &mut App, target: &mut Target, first: usize) {
    const STROKE: usize = 90;
    app.scene.set_measuring(false);
    let (mut began, mut moved, mut cut, mut ended) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut allocations = [0; 4];
    let mut stages: [Vec<f64>; 5] = Default::default();
    for stroke in 0..11 {
        let y = 0.03 - 0.006 * stroke as f64;
        for k in 0..STROKE + 45 {
            let pose = |k: usize| {
                let x = 0.05 * (2.0 * k as f64 / STROKE as f64 - 1.0);
                let (tip, base) = (DVec3::new(x, y, 0.02), DVec3::new(x, y, 0.12));
                EditCommand::StrokePose(BladePose { t: k as f64 / 90.0, tip, base })
            };
            let commands = match k {
                0 => vec![EditCommand::StrokeBegin { width: 0.002 }, pose(0)],
                STROKE => vec![EditCommand::StrokeEnd],
                k if k < STROKE => vec![pose(k)],
                _ => Vec::new(),
            };
            let time_s = (first + stroke * (STROKE + 45) + k) as f64 / 90.0;
            let input = InputFrame { time_s, step_s: 1.0 / 90.0, commands, ..InputFrame::default() };
            let slots = vertex_slots(app);
            target.pace();
            let start = Instant::now();
            let report = app.frame(&input, target).expect("a frame");
            let whole = start.elapsed().as_secs_f64() * 1e3 - target.submit_ms;
            assert_eq!(report.counters.dispatches, 2, "the heart beats");
            let (counters, frame_stages) = (report.counters, report.stages);
            app.give_back(report);
            let (times, most) = match k {
                _ if stroke == 0 => continue,
                0 => (&mut began, 0),
                STROKE => (&mut ended, 3),
                k if k > STROKE => continue,
                _ if vertex_slots(app) > slots => {
                    let app_ms = ["edit", "pose", "physics"].map(|stage| frame_stages.get(stage));
                    let all = app_ms.into_iter().chain([target.sync_ms, target.encode_ms]);
                    stages.iter_mut().zip(all).for_each(|(stage, ms)| stage.push(ms));
                    (&mut cut, 2)
                }
                _ => (&mut moved, 1),
            };
            times.push(whole);
            allocations[most] = (counters.allocations + target.sync_allocations).max(allocations[most]);
        }
    }
    let segments = cut.len();
    assert!(segments > 100, "{segments} frames in which the blade cut");
    assert_eq!(allocations, [0; 4], "no frame of a stroke allocates");
    let mut all: Vec<f64> = [&began, &moved, &cut, &ended].into_iter().flatten().copied().collect();
    println!("torn: all frames of the strokes {} ms", row(&mut all));
    println!(
        "torn: a stroke begins {} ms, the blade moves {}, cuts {}, ends {}; {segments} cuts, no allocations",
        row(&mut began),
        row(&mut moved),
        row(&mut cut),
        row(&mut ended),
    );
    let [edit, pose, physics, sync, encode] = stages.each_mut().map(|stage| row(stage));
    target.gpu.print("torn");
    println!("a cut: edit {edit} ms, pose {pose}, physics {physics}, sync {sync}, encode {encode}");
}

fn run(between: Between) {
    let mut app = app();
    let camera = Camera { eye: DVec3::new(0.05, 0.04, 0.26), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.7 };
    let mut target = Target::new(&camera, between);
    measure("asleep", &mut app, &mut target, 0, false);
    app.scene.set_animation(Some(0));
    // A hand that moves a few particles keeps the springs awake.
    let center = DVec3::new(0.0, 0.0, 0.045);
    app.scene.edit(EditCommand::GrabBegin { id: 1, center, radius: 0.02 });
    measure("active", &mut app, &mut target, FRAMES, true);
    app.scene.edit(EditCommand::GrabEnd { id: 1 });
    tear(&mut app, &mut target, 2 * FRAMES);
}

fn main() {
    [Between::Nothing, Between::Sleep, Between::Draw].into_iter().for_each(run);
}
