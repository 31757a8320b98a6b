//! What a steady frame allocates: nothing of ours, from input to the notes of the upload. A test program of its own, since the
//! allocator that counts is the program's.
#![cfg(feature = "gpu")]

mod common;

use common::models::scene;
use common::strokes::{HeartStrokes, WildStroke};
use glam::DVec3;
use incise::app::{App, FrameCounters, FrameTarget, FrameView};
use incise::diagnostics::Stages;
use incise::gpu::{Camera, Context, ContextOptions, DrawOptions, GpuError, Scenery};
use incise::host::mirror::Mirror;
use incise::input::InputFrame;
use incise::scene::EditCommand;
use incise::surgery::WallMode;
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use std::alloc::System;
use std::sync::Arc;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// The counter is the program's, so one test at a time.
static ALONE: std::sync::Mutex<()> = std::sync::Mutex::new(());

/// What assertions make of whole models is none of a frame's.
fn alone() -> std::sync::MutexGuard<'static, ()> {
    incise::diagnostics::set_audits(false);
    ALONE.lock().unwrap_or_else(|e| e.into_inner())
}

fn allocations() -> u64 {
    let stats = ALLOCATOR.stats();
    (stats.allocations + stats.reallocations) as u64
}

struct Target {
    mirror: Mirror,
    in_sync: u64,
    /// Allocates on purpose.
    leaky: bool,
}

impl FrameTarget for Target {
    type Error = GpuError;

    fn present(&mut self, view: &FrameView, _: &mut Stages, counters: &mut FrameCounters) -> Result<(), GpuError> {
        let before = allocations();
        self.mirror.sync(view)?;
        let lines = self.mirror.layer_lines(view);
        if self.leaky {
            std::hint::black_box(Vec::<u8>::with_capacity(64));
        }
        self.in_sync = allocations() - before;
        let camera = Camera { eye: DVec3::new(0.0, 0.3, 0.9), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.9 };
        // the picture is not looked at, and a software adapter draws shadows slowly
        let scenery = Scenery { shadow: false, ..Scenery::default() };
        let options = DrawOptions { scenery, lines: &lines, ..Default::default() };
        self.mirror.renderer_mut().draw(&camera, (32, 24), &options)?;
        self.mirror.renderer().context().wait()?;
        self.mirror.count(counters);
        Ok(())
    }
}

#[test]
fn a_steady_frame_allocates_nothing_of_ours() {
    let _alone = alone();
    let context = Arc::new(Context::headless(ContextOptions::default()).expect("an adapter"));
    let mut target = Target { mirror: Mirror::new(context), in_sync: 0, leaky: false };
    let (mut scene, animated) = scene("beam", 900);
    scene.set_animation(animated.then_some(0));
    let mut app = App::new(scene, 1.0, allocations);
    let mut counts = Vec::new();
    for number in 0..40 {
        target.leaky = number == 39;
        let input = InputFrame { time_s: f64::from(number) / 90.0, step_s: 1.0 / 90.0, ..InputFrame::default() };
        let report = app.frame(&input, &mut target).expect("a frame");
        assert!(report.counters.dispatches == 2, "the beam moves in every frame");
        counts.push((report.counters.allocations, target.in_sync));
    }
    assert!(counts[30..39].iter().all(|c| *c == (0, 0)), "{counts:?}");
    assert_eq!(counts[39], (0, 1), "the control is noticed");
}

/// A hand that takes hold and drags the tissue along costs no allocation either.
#[test]
fn a_steady_grab_allocates_nothing_of_ours() {
    let _alone = alone();
    let context = Arc::new(Context::headless(ContextOptions::default()).expect("an adapter"));
    let mut target = Target { mirror: Mirror::new(context), in_sync: 0, leaky: false };
    let mut app = App::new(scene("beam", 900).0, 1.0, allocations);
    let mut counts = Vec::new();
    for number in 0..40 {
        let by = DVec3::Y * 0.002 * f64::from(number);
        let commands = match number {
            20 => vec![EditCommand::GrabBegin { id: 1, center: DVec3::new(0.0, 0.05, 0.0), radius: 0.12 }],
            _ => vec![EditCommand::GrabMove { id: 1, by }],
        };
        target.leaky = number == 39;
        let input = InputFrame { time_s: f64::from(number) / 90.0, step_s: 1.0 / 90.0, commands, ..InputFrame::default() };
        let report = app.frame(&input, &mut target).expect("a frame");
        assert!(number < 22 || (report.counters.particles_awake > 0 && report.counters.dispatches == 2), "{number}");
        counts.push((report.counters.allocations, target.in_sync));
    }
    assert!(counts[20..39].iter().all(|c| *c == (0, 0)), "{counts:?}");
    assert_eq!(counts[39], (0, 1), "the control is noticed");
}

/// No frame that tears a beating heart, with walls, without, and with width 0, allocates anything of ours after the first second: not one
/// in which a stroke begins, goes on or ends, or a hand takes hold of a lip, nor what mirrors it, wgpu's buffers included.
#[test]
fn a_tear_of_a_beating_heart_allocates_nothing_of_ours() {
    let _alone = alone();
    let context = Arc::new(Context::headless(ContextOptions::default()).expect("an adapter"));
    let mut target = Target { mirror: Mirror::new(context), in_sync: 0, leaky: false };
    let (mut scene, animated) = scene("heart", 4_000);
    scene.set_animation(animated.then_some(0));
    scene.set_measuring(false);
    let mut app = App::new(scene, 1.0, allocations);
    let (mut allocated, mut segments) = (Vec::new(), 0);
    for number in 0..HeartStrokes::FRAMES {
        let input = HeartStrokes::input(&mut app, number);
        let version = |app: &App| app.scene.tissues().map(|(_, t)| t.versions().structure).sum::<u64>();
        let before = version(&app);
        let report = app.frame(&input, &mut target).expect("a frame");
        segments += u32::from(version(&app) > before);
        let (in_app, edits) = (report.counters.allocations, report.edits.len());
        app.give_back(report);
        if HeartStrokes::is_counted(number) && (in_app, target.in_sync) != (0, 0) {
            allocated.push((number, in_app, target.in_sync, edits));
        }
    }
    assert_eq!(app.scene.tissues().count(), 1, "a piece that comes off makes arrays of its own");
    assert!(segments > 100 && app.scene.undo_depth() == HeartStrokes::COUNT, "{segments} segments");
    assert!(
        allocated.is_empty(),
        "frames, what they allocated here and in the mirror, and the edits that they ended: {allocated:?}"
    );
    // the control
    target.leaky = true;
    app.frame(&InputFrame { time_s: 8.0, step_s: 1.0 / 90.0, ..InputFrame::default() }, &mut target).expect("a frame");
    assert_eq!(target.in_sync, 1, "the control is noticed");
}

/// What mirrors strokes that turn, dive and cross old wounds allocates nothing either: some of a run, since drawing takes its time.
#[test]
fn the_mirror_of_wild_strokes_allocates_nothing_of_ours() {
    let _alone = alone();
    let context = Arc::new(Context::headless(ContextOptions::default()).expect("an adapter"));
    let (mut allocated, mut segments) = (Vec::new(), 0);
    for seed in 0..4 {
        let mut target = Target { mirror: Mirror::new(context.clone()), in_sync: 0, leaky: false };
        let (mut scene, animated) = scene("heart", 4_000);
        scene.set_animation(animated.then_some(0));
        scene.set_measuring(false);
        // the material of walls comes with the first that are asked for
        scene.set_wall(WallMode::Closed);
        let mut app = App::new(scene, 1.0, allocations);
        let structure = |app: &App| app.scene.tissues().map(|(_, t)| t.versions().structure).sum::<u64>();
        let mut number = 0;
        for stroke in 0..3 {
            let wild = WildStroke::draw(seed, stroke);
            app.scene.set_wall(wild.wall);
            for k in 0..wild.end() {
                let before = structure(&app);
                let report = app.frame(&wild.input(number, k), &mut target).expect("a frame");
                app.give_back(report);
                segments += u32::from(structure(&app) > before);
                number += 1;
                if number > 90 && target.in_sync > 0 {
                    allocated.push((seed, stroke, k, target.in_sync));
                }
            }
            app.frame(&wild.input(number, wild.end()), &mut target).expect("a frame");
            if app.scene.tissues().count() > 1 {
                break;
            }
        }
    }
    assert!(segments > 50, "{segments} segments");
    assert!(allocated.is_empty(), "run, stroke, frame, and what its mirror allocated: {allocated:?}");
}
