//! What an edit allocates in its frame: nothing, from the first second on. Like `gpu_allocations` without what mirrors it.

mod common;

use common::models::{model, model_of_obj, scene, settings};
use common::strokes::{HeartStrokes, WildStroke};
use glam::DVec3;
use incise::app::{App, FrameCounters, FrameTarget, FrameView};
use incise::diagnostics::Stages;
use incise::geometry::VertexId;
use incise::input::InputFrame;
use incise::particles::ParticleSettings;
use incise::scene::{EditCommand, Outcome, Scene, SceneSettings};
use incise::surgery::{BladePose, SamplingSettings};
use incise::tissue::{Tissue, TissueSettings};
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use std::alloc::System;
use std::convert::Infallible;
use std::sync::Mutex;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// The counter is the program's, so one test at a time.
static ALONE: Mutex<()> = Mutex::new(());

/// What assertions make of whole models is none of a frame's.
fn alone() -> std::sync::MutexGuard<'static, ()> {
    incise::diagnostics::set_audits(false);
    ALONE.lock().unwrap_or_else(|e| e.into_inner())
}

fn allocations() -> u64 {
    let stats = ALLOCATOR.stats();
    (stats.allocations + stats.reallocations) as u64
}

/// Frames of the first second.
const FIRST_SECOND: u32 = 90;
/// Runs of [`no_frame_of_a_wild_stroke_allocates`].
const SEEDS: u64 = 40;

/// Vertices that a loaded model has room for beyond half as many as it has.
const ROOM: usize = 4096;

/// Draws nothing.
struct Nowhere;

impl FrameTarget for Nowhere {
    type Error = Infallible;

    fn present(&mut self, _: &FrameView, _: &mut Stages, _: &mut FrameCounters) -> Result<(), Infallible> {
        Ok(())
    }
}

#[test]
fn no_frame_of_a_stroke_allocates_neither_its_first_nor_its_last() {
    let _alone = alone();
    let (mut scene, animated) = scene("heart", 4_000);
    scene.set_animation(animated.then_some(0));
    scene.set_measuring(false);
    let mut app = App::new(scene, 1.0, allocations);
    let mut allocated = Vec::new();
    for number in 0..HeartStrokes::FRAMES {
        let input = HeartStrokes::input(&mut app, number);
        let Ok(report) = app.frame(&input, &mut Nowhere);
        if HeartStrokes::is_counted(number) && report.counters.allocations > 0 {
            allocated.push((number, report.counters.allocations));
        }
        app.give_back(report);
    }
    assert_eq!((app.scene.tissues().count(), app.scene.undo_depth()), (1, HeartStrokes::COUNT));
    assert!(allocated.is_empty(), "frames, and what they allocated: {allocated:?}");
    // the control: an undo is told of with a list of its tissues
    let input = InputFrame { time_s: 8.0, step_s: 1.0 / 90.0, commands: vec![EditCommand::Undo], ..InputFrame::default() };
    let Ok(report) = app.frame(&input, &mut Nowhere);
    assert!(report.counters.allocations > 0, "the control is noticed");
}

/// Strokes that turn, dive, cross each other and each other's wounds, with walls, without, of any width, in a heart that beats: nothing is
/// allocated while they go on. Where something comes off at the end the rest of a run is not looked at: pieces make arrays of their
/// own, and so does what is left of one that crumbs with particles came off; nor where the model has grown by what there was room for.
#[test]
fn no_frame_of_a_wild_stroke_allocates() {
    let _alone = alone();
    let (mut allocated, mut segments) = (Vec::new(), 0);
    for seed in 0..SEEDS {
        let (mut scene, animated) = scene("heart", 4_000);
        scene.set_animation(animated.then_some(0));
        scene.set_measuring(false);
        let mut app = App::new(scene, 1.0, allocations);
        let slots = |app: &App| app.scene.tissues().map(|(_, t)| t.mesh().vertex_slots()).sum::<usize>();
        let room = slots(&app) + ROOM;
        let structure = |app: &App| app.scene.tissues().map(|(_, t)| t.versions().structure).sum::<u64>();
        let mut number = 0;
        'run: for stroke in 0..6 {
            let wild = WildStroke::draw(seed, stroke);
            app.scene.set_wall(wild.wall);
            for k in 0..wild.frames() {
                let before = structure(&app);
                let Ok(report) = app.frame(&wild.input(number, k), &mut Nowhere);
                let in_app = report.counters.allocations;
                app.give_back(report);
                segments += u32::from(structure(&app) > before);
                number += 1;
                if slots(&app) > room || in_app > 0 && k == wild.end() {
                    break 'run;
                }
                if number <= FIRST_SECOND || in_app == 0 {
                    continue;
                }
                allocated.push((seed, stroke, k, in_app));
            }
        }
    }
    assert!(segments > 1_000, "{segments} segments");
    assert!(allocated.is_empty(), "run, stroke, frame, and what it allocated: {allocated:?}");
}

/// Two spheres in one tissue, the first of which is torn; bytes that undo and redo then ask for.
fn bytes_of_history(faces_beside: usize) -> [usize; 2] {
    let beside = model("sphere", faces_beside);
    let mut text = String::new();
    let mut first = 1;
    for (model, shift) in [(model("sphere", 1_000), 0.0), (beside, 10.0)] {
        let position = |v: usize| model.rows.rest(VertexId::new(v)) + DVec3::X * shift;
        (0..model.rows.len()).map(position).for_each(|p| text += &format!("v {} {} {}\n", p.x, p.y, p.z));
        let corner = |v: VertexId| v.index() + first;
        model
            .mesh
            .live_faces()
            .map(|f| model.mesh.face(f).map(corner))
            .for_each(|f| text += &format!("f {} {} {}\n", f[0], f[1], f[2]));
        first += model.rows.len();
    }
    let model = model_of_obj(&text);
    let settings = TissueSettings { particles: Some(ParticleSettings::with_spacing(0.03)), ..settings(&model) };
    let tissue = Tissue::new(model, &settings).unwrap();
    let settings = SceneSettings { sampling: SamplingSettings::default(), sample_distance: Some(0.01), sample_time: None };
    let mut scene = Scene::new(tissue, settings);
    scene.set_measuring(false);
    let edit = |scene: &mut Scene, command: EditCommand| {
        let before = ALLOCATOR.stats().bytes_allocated;
        let reports = scene.edit(command);
        (ALLOCATOR.stats().bytes_allocated - before, reports)
    };
    scene.edit(EditCommand::StrokeBegin { width: 0.004 });
    for k in 0..10 {
        let (x, far) = (0.01 * f64::from(k) - 0.05, 1.0);
        scene.edit(EditCommand::StrokePose(BladePose {
            t: f64::from(k) / 90.0,
            tip: DVec3::new(x, 0.0, 0.03),
            base: DVec3::new(x, 0.0, far),
        }));
    }
    assert_eq!(edit(&mut scene, EditCommand::StrokeEnd).1[0].outcome, Outcome::Torn);
    [EditCommand::Undo, EditCommand::Redo].map(|command| {
        (0..20).for_each(|_| scene.step(1.0 / 90.0));
        edit(&mut scene, command).0
    })
}

/// What an undo looks at, and finds room for, follows the wound, not the model.
#[test]
fn undo_and_redo_take_no_more_in_a_larger_model() {
    let _alone = alone();
    let (small, large) = (bytes_of_history(500), bytes_of_history(20_000));
    for (small, large) in small.into_iter().zip(large) {
        assert!(small > 1_000 && large < small + small / 4, "{small} bytes beside 500 faces, {large} beside 20,000");
    }
}
