//! What an edit allocates in its frame: nothing, from the first second on. Like `gpu_allocations` without what mirrors it: `scripts/test`
//! runs this once more in the profile that users have, where the ends of strokes count too.

mod common;

use common::models::scene;
use common::strokes::HeartStrokes;
use incise::app::{App, FrameCounters, FrameTarget, FrameView};
use incise::diagnostics::Stages;
use incise::input::InputFrame;
use incise::scene::EditCommand;
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use std::alloc::System;
use std::convert::Infallible;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

fn allocations() -> u64 {
    let stats = ALLOCATOR.stats();
    (stats.allocations + stats.reallocations) as u64
}

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
    let input = InputFrame { time_s: 6.0, step_s: 1.0 / 90.0, commands: vec![EditCommand::Undo], ..InputFrame::default() };
    let Ok(report) = app.frame(&input, &mut Nowhere);
    assert!(report.counters.allocations > 0, "the control is noticed");
}
