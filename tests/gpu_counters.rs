//! What a window's or a headset's frame costs, from the app through the mirror into a swapchain's image: code run, read-backs, and
//! bytes sent, asleep, in motion, and while the model is torn and cut.
#![cfg(feature = "gpu")]

mod common;
mod gpu_support;

use common::models::scene_of;
use glam::{DQuat, DVec3};
use gpu_support::{context, eyes};
use incise::app::{App, FrameCounters, FrameTarget, FrameView};
use incise::diagnostics::Stages;
use incise::geometry::Plane;
use incise::gpu::targets::Picture;
use incise::gpu::types::{Frame, Material, TissueRecord, WorkItem};
use incise::gpu::{Camera, DrawOptions, Fov, GpuCounters, GpuError, RenderTarget, Variant, ViewPose, ViewSet};
use incise::host::mirror::Mirror;
use incise::input::{InputFrame, Layer};
use incise::scene::{EditCommand, EditReport};
use incise::surgery::BladePose;

/// Draws into images of others, as a headset's frame does, with late poses and without a wait.
struct Target {
    mirror: Mirror,
    colour: Picture,
    counters: GpuCounters,
}

impl Target {
    fn new() -> Self {
        let context = context();
        let colour = eyes(&context);
        Self { mirror: Mirror::new(context), colour, counters: GpuCounters::default() }
    }
}

impl FrameTarget for Target {
    type Error = GpuError;

    fn present(&mut self, view: &FrameView, _: &mut Stages, _: &mut FrameCounters) -> Result<(), GpuError> {
        self.mirror.sync(view)?;
        let lines = self.mirror.layer_lines(view);
        let renderer = self.mirror.renderer_mut();
        let context = renderer.context().clone();
        let mut encoder = context.device().create_command_encoder(&Default::default());
        let eye = |x: f64| ViewPose {
            position: DVec3::new(x, 0.1, 0.6),
            rotation: DQuat::IDENTITY,
            fov: Fov::symmetric(0.9, 1.3),
            near: 0.01,
        };
        let views = [eye(-0.03), eye(0.03)];
        let options = DrawOptions { lines: &lines, ..Default::default() };
        renderer.encode(&mut encoder, &ViewSet::new(&views), &RenderTarget::new(self.colour.target()), &options)?;
        renderer.set_late_views(&views.map(|v| ViewPose { position: v.position + DVec3::X * 1e-3, ..v }))?;
        context.queue().submit([encoder.finish()]);
        self.counters = renderer.take_counters();
        Ok(())
    }
}

fn frame(app: &mut App, target: &mut Target, number: usize, commands: Vec<EditCommand>) -> (GpuCounters, Vec<EditReport>) {
    let input = InputFrame { time_s: number as f64 / 90.0, step_s: 1.0 / 90.0, commands, ..InputFrame::default() };
    let report = app.frame(&input, target).expect("a frame");
    (target.counters, report.edits)
}

fn stroke(width: f64) -> Vec<EditCommand> {
    let mut commands = vec![EditCommand::StrokeBegin { width }];
    for k in 0..6 {
        let tip = DVec3::new(-0.05 + 0.02 * f64::from(k), 0.03, 0.0);
        commands.push(EditCommand::StrokePose(BladePose { t: 0.1 * f64::from(k), tip, base: tip + DVec3::Y * 0.3 }));
    }
    commands.push(EditCommand::StrokeEnd);
    commands
}

/// A model's first frame, and one with an edit: bytes of the whole model, counters and report of the edit, and what came of it.
fn first_and(name: &str, faces: usize, soft: bool, commands: Vec<EditCommand>) -> (u64, GpuCounters, EditReport, App) {
    let mut app = App::new(scene_of(name, faces, soft).0, 1.0, || 0);
    let mut target = Target::new();
    let (whole, _) = frame(&mut app, &mut target, 0, Vec::new());
    let (counters, mut edits) = frame(&mut app, &mut target, 0, commands);
    (whole.structure_bytes, counters, edits.remove(0), app)
}

/// No frame of a window or a headset waits for the GPU, whatever it does; what reads a picture or positions is counted.
#[test]
fn steady_frames_bring_nothing_back() {
    let (mut scene, _) = scene_of("beam", 2400, true);
    scene.set_animation(None);
    let (mut app, mut target) = (App::new(scene, 1.0, || 0), Target::new());
    frame(&mut app, &mut target, 0, Vec::new());
    let nothing = Variant::default();
    for number in 1..4 {
        let (asleep, _) = frame(&mut app, &mut target, number, Vec::new());
        assert_eq!((asleep.read_backs, asleep.dispatches, asleep.structure_bytes, asleep.code), (0, 0, 0, nothing));
        // The eyes' late poses are all that is sent.
        assert_eq!(asleep.bytes_uploaded, 2 * size_of::<Frame>() as u64);
    }
    app.scene.set_animation(Some(0));
    let hand = EditCommand::GrabBegin { id: 1, center: DVec3::new(0.0, 0.05, 0.0), radius: 0.1 };
    frame(&mut app, &mut target, 4, vec![hand, EditCommand::GrabMove { id: 1, by: DVec3::Y * 0.01 }]);
    let moving = Variant { skinned: true, displaced: true, ..nothing };
    for number in 5..8 {
        let (active, _) = frame(&mut app, &mut target, number, Vec::new());
        assert_eq!((active.read_backs, active.dispatches, active.structure_bytes, active.code), (0, 2, 0, moving));
    }
    let mut sent = 0;
    for (k, command) in stroke(0.004).into_iter().enumerate() {
        let (torn, _) = frame(&mut app, &mut target, 8 + k, vec![command]);
        assert_eq!((torn.read_backs, torn.dispatches), (0, 2));
        assert!(torn.code.skinned && torn.code.displaced);
        sent += torn.structure_bytes;
    }
    assert!(sent > 0);
    let camera = Camera { eye: DVec3::new(0.0, 0.3, 0.9), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.9 };
    let renderer = target.mirror.renderer_mut();
    renderer.render_to_image(&camera, (8, 8), &DrawOptions::default()).expect("a picture");
    assert_eq!(renderer.take_counters().read_backs, 1);
    let input = InputFrame { show: vec![(Layer::Errors, true)], ..InputFrame::default() };
    app.frame(&input, &mut target).expect("a frame");
    assert_eq!(target.counters.read_backs, 1, "the layer of errors reads positions");
}

/// Rows grow with every cut through what was cut before; from four entries on another pipeline runs, and never before.
#[test]
fn cuts_across_cuts_take_the_way_of_long_rows() {
    let (mut app, mut target) = (App::new(scene_of("sphere", 500, false).0, 1.0, || 0), Target::new());
    frame(&mut app, &mut target, 0, Vec::new());
    let mut long = Vec::new();
    for (number, normal) in
        [DVec3::new(1.0, 0.1, 0.0), DVec3::new(0.1, 1.0, 0.2), DVec3::new(0.0, 0.1, 1.0)].into_iter().enumerate()
    {
        let plane = Plane::Equation { normal, offset: 0.02 };
        let (counters, edits) = frame(&mut app, &mut target, number + 1, vec![EditCommand::CutClosed(plane)]);
        assert_eq!(counters.dispatches, 2);
        let wanted = Variant { long_rows: edits[0].max_row_entries > 3, ..Variant::default() };
        assert_eq!(counters.code, wanted, "a static model runs no other code: {} entries", edits[0].max_row_entries);
        long.push(wanted.long_rows);
    }
    assert!(!long[0] && long[2], "{long:?}");
}

/// Of a wound that severs nothing the mesh's part falls with the model's size, since it goes with the length of the wound. Its
/// particles' part does not: every vertex that they hold is tied anew.
#[test]
fn an_edit_that_severs_nothing_is_a_small_share() {
    for (soft, least_fall) in [(false, 1.5), (true, 1.0)] {
        let mut last = f64::INFINITY;
        for faces in [5_000, 20_000, 80_000] {
            let (whole, counters, edit, app) = first_and("beam", faces, soft, stroke(0.004));
            assert_eq!(app.scene.tissues().count(), 1);
            let share = counters.structure_bytes as f64 / whole as f64;
            println!("{faces} faces, soft {soft}: {} of {whole} bytes, {:.2} %", counters.structure_bytes, 100.0 * share);
            assert!(edit.bytes_uploaded > 0 && share < 0.2 && share * least_fall < last, "{share} after {last}");
            last = share;
        }
    }
}

/// A piece that comes off is a tissue of its own, with numbers of its own for its vertices, wedges and faces, so it is sent whole; its
/// faces are sent a second time at most, as the dead slots that they leave behind.
#[test]
fn a_severing_sends_its_pieces_and_what_they_leave_behind() {
    for faces in [5_000, 20_000] {
        for command in [EditCommand::Cut, EditCommand::CutClosed] {
            let plane = Plane::Equation { normal: DVec3::new(1.0, 0.2, 0.1), offset: 0.15 };
            let (whole, counters, _, app) = first_and("beam", faces, true, vec![command(plane)]);
            let pieces: usize = app.scene.tissues().skip(1).map(|(_, t)| t.full_upload_bytes()).sum();
            println!("{faces} faces: {} bytes, {pieces} of the piece, {whole} of the model", counters.structure_bytes);
            assert!(counters.structure_bytes as usize > pieces && (counters.structure_bytes as usize) < 2 * pieces);
            assert!(counters.structure_bytes < whole, "not the whole model");
        }
    }
}

/// What small edits send besides, bytes: records that have not changed, between two that have and at most 16 apart.
const GAPS: u64 = 8192;

/// An edit's report counts records that differ. A frame sends those, gaps of a few records that join two ranges, and what moves:
/// displacements, fades, joints, and the frame's own records.
#[test]
fn a_frame_sends_what_its_edits_say() {
    let plane = |offset: f64| Plane::Equation { normal: DVec3::new(1.0, 0.2, 0.1), offset };
    let cuts = [EditCommand::Cut(plane(0.1)), EditCommand::CutClosed(plane(-0.1)), EditCommand::Undo, EditCommand::Redo];
    for soft in [false, true] {
        let (mut app, mut target) = (App::new(scene_of("beam", 5000, soft).0, 1.0, || 0), Target::new());
        frame(&mut app, &mut target, 0, Vec::new());
        for command in cuts.clone() {
            let (counters, edits) = frame(&mut app, &mut target, 0, vec![command]);
            let (said, sent) = (edits[0].bytes_uploaded as u64, counters.structure_bytes);
            assert!(said <= sent && sent <= said * 11 / 10 + GAPS, "soft {soft}: {said} said, {sent} sent");
            let vectors: usize = app
                .scene
                .tissues()
                .map(|(_, t)| {
                    t.pose().joint_matrices.len() * 3 + t.fades().entries().len() + t.layer().map_or(0, |l| l.map.len())
                })
                .sum();
            let materials: usize = app.scene.tissues().map(|(_, t)| t.materials().len() * size_of::<Material>()).sum();
            let records = app.scene.tissues().count() * size_of::<TissueRecord>() + 2 * size_of::<Frame>();
            let work = counters.workgroups as usize * size_of::<WorkItem>();
            let rest = (counters.bytes_uploaded - sent) as usize;
            assert!(rest <= vectors * 16 + 2 * materials + records + work, "soft {soft}: {rest}");
        }
        // The segments of a stroke overlap: what two of them change in one frame is sent once.
        let (mut said, mut sent) = (0, 0);
        for (k, command) in stroke(0.004).into_iter().enumerate() {
            let (counters, edits) = frame(&mut app, &mut target, k, vec![command]);
            said += edits.iter().map(|e| e.bytes_uploaded as u64).sum::<u64>();
            sent += counters.structure_bytes;
        }
        assert!(said > 0 && sent > said / 2 && sent <= said * 11 / 10 + GAPS, "soft {soft}: {said} said, {sent} sent");
    }
}

/// Edits of a displaced model start fades. Those are sent, with gaps of a few, and not an array with an entry a vertex; and the GPU
/// knows all of them, also where vertices have come and gone by undo and redo.
#[test]
fn fades_are_sent_where_they_are_written() {
    let (mut scene, _) = scene_of("beam", 20_000, true);
    scene.set_animation(None);
    let (mut app, mut target) = (App::new(scene, 1.0, || 0), Target::new());
    let hand = EditCommand::GrabBegin { id: 1, center: DVec3::new(0.0, 0.05, 0.0), radius: 0.1 };
    frame(&mut app, &mut target, 0, vec![hand, EditCommand::GrabMove { id: 1, by: DVec3::Y * 0.01 }]);
    for number in 1..4 {
        frame(&mut app, &mut target, number, Vec::new());
    }
    let (mut number, mut most) = (4, 0);
    let mut run = |commands: Vec<EditCommand>| {
        for command in commands {
            let fades = |app: &App| app.scene.tissues().map(|(_, t)| t.fades().entries().to_vec()).collect::<Vec<_>>().concat();
            let before = fades(&app);
            let (counters, _) = frame(&mut app, &mut target, number, vec![command]);
            number += 1;
            let after = fades(&app);
            let is_written = |v: &usize| after[*v] != before.get(*v).copied().unwrap_or_default();
            let (mut sent, mut last) = (0, None::<usize>);
            for v in (0..after.len()).filter(is_written) {
                let run = last.filter(|last| v <= last + 9); // gaps of eight are sent rather than left out
                sent += run.map_or(1, |last| v - last);
                last = Some(v);
            }
            most = most.max(sent);
            let vectors: usize =
                app.scene.tissues().map(|(_, t)| t.pose().joint_matrices.len() * 3 + t.layer().map_or(0, |l| l.map.len())).sum();
            let materials: usize = app.scene.tissues().map(|(_, t)| t.materials().len() * size_of::<Material>()).sum();
            let records = app.scene.tissues().count() * size_of::<TissueRecord>() + 2 * size_of::<Frame>();
            let bound = 16 * (sent + vectors) + 2 * materials + records + counters.workgroups as usize * size_of::<WorkItem>();
            let rest = (counters.bytes_uploaded - counters.structure_bytes) as usize;
            assert!(rest <= bound, "{rest} bytes with {sent} fades, {bound} expected");
            let error = target.mirror.gpu_error(&app.scene).expect("positions");
            assert!(error < 1e-6, "{error}");
        }
        most
    };
    run(stroke(0.004));
    run(vec![EditCommand::Undo, EditCommand::Redo, EditCommand::Undo]);
    let most = run(stroke(0.008));
    let all: usize = app.scene.tissues().map(|(_, t)| t.mesh().vertex_slots()).sum();
    assert!(most > 30 && most < all / 2, "{most} of {all}: the array of all fades would be more than what was allowed");
}
