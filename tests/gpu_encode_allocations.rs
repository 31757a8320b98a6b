//! What a steady frame allocates from its start to its submission, encoding and drawing included: wgpu allocates for every pass, we
//! do not. The profiler notes a backtrace for each allocation, and the innermost crate of ours or wgpu's in it is whose it is. A test
//! program of its own, since the allocator is the program's.
#![cfg(feature = "gpu")]

mod common;
mod gpu_support;

use common::models::scene;
use glam::{DQuat, DVec3};
use gpu_support::{context, eyes};
use incise::app::{App, FrameCounters, FrameTarget, FrameView};
use incise::diagnostics::Stages;
use incise::gpu::targets::Picture;
use incise::gpu::{DrawOptions, Fov, GpuError, Instrument, LineSegment, RenderTarget, ViewPose, ViewSet, VisibilityMask};
use incise::host::mirror::Mirror;
use incise::input::InputFrame;
use incise::scene::EditCommand;
use std::collections::BTreeMap;

#[global_allocator]
static ALLOCATOR: dhat::Alloc = dhat::Alloc;

/// A headset's frame: two masked views with late poses, a scalpel and lines that move.
struct Target {
    mirror: Mirror,
    colour: Picture,
    frames: u32,
    lines: usize,
}

impl FrameTarget for Target {
    type Error = GpuError;

    fn present(&mut self, view: &FrameView, _: &mut Stages, _: &mut FrameCounters) -> Result<(), GpuError> {
        self.frames += 1;
        let by = DVec3::Y * 1e-3 * f64::from(self.frames);
        self.mirror.sync(view)?;
        let renderer = self.mirror.renderer_mut();
        let context = renderer.context().clone();
        let mut encoder = context.device().create_command_encoder(&Default::default());
        let fov = Fov::symmetric(0.9, 1.3);
        let eye = |x: f64| ViewPose { position: DVec3::new(x, 0.1, 0.6), rotation: DQuat::IDENTITY, fov, near: 0.01 };
        let views = [eye(-0.03), eye(0.03)];
        let lines = &[LineSegment::new(DVec3::ZERO, DVec3::X + by, [1.0; 4]); 1000][..self.lines];
        let instruments = [Instrument::scalpel(by, by + DVec3::Y * 0.1, DVec3::X, 1.0)];
        let options = DrawOptions { lines, instruments: &instruments, ..Default::default() };
        let set = ViewSet { views: &views, masked: true };
        renderer.encode(&mut encoder, &set, &RenderTarget::new(self.colour.target()), &options)?;
        renderer.set_late_views(&views.map(|v| ViewPose { position: v.position + by, ..v }))?;
        context.queue().submit([encoder.finish()]);
        context.wait()
    }
}

/// Files of the library, from `src` on.
fn our_files() -> Vec<String> {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mut folders, mut files) = (vec![root.join("src")], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder").map(|e| e.expect("an entry").path()) {
            match entry.is_dir() {
                true => folders.push(entry),
                // every crate has one of that name, and ours holds no code
                false if entry.ends_with("src/lib.rs") => {}
                false => files.push(entry.strip_prefix(root).expect("below").to_string_lossy().into_owned()),
            }
        }
    }
    files
}

/// The source file of a frame of a backtrace, "0x1234: function (file:line:column)"; of a long path the last three parts.
fn file_of(frame: &str) -> &str {
    let at = frame.rfind(" (").map_or("", |at| &frame[at + 2..]);
    at.split(':').next().unwrap_or("")
}

/// Blocks allocated while `work` runs: how many of wgpu's, and ours by the place in our sources. An allocation is wgpu's if one of
/// its files lies between the allocator and the first file of ours; all else below a file of ours is ours.
fn allocated(work: impl FnOnce()) -> (u64, BTreeMap<String, u64>) {
    let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("encode-allocations.json");
    let profiler = dhat::Profiler::builder().file_name(&path).trim_backtraces(None).build();
    work();
    drop(profiler);
    let text = std::fs::read(&path).expect("the profile");
    let profile: serde_json::Value = serde_json::from_slice(&text).expect("JSON");
    let array = |value: &serde_json::Value| value.as_array().expect("an array").clone();
    let (frames, files) = (array(&profile["ftbl"]), our_files());
    let is_ours = |file: &str| !file.is_empty() && files.iter().any(|f| f.ends_with(file) || file.ends_with(f.as_str()));
    let is_wgpu = |file: &str| ["wgpu", "src/api/", "src/backend/", "src/util/"].iter().any(|start| file.starts_with(start));
    let (mut theirs, mut ours) = (0, BTreeMap::new());
    for point in array(&profile["pps"]) {
        let blocks = point["tbk"].as_u64().expect("blocks");
        let fs = array(&point["fs"]);
        let mut backtrace = fs.iter().filter_map(|f| frames.get(f.as_u64()? as usize)?.as_str());
        match backtrace.find(|frame| is_ours(file_of(frame)) || is_wgpu(file_of(frame))) {
            Some(frame) if is_ours(file_of(frame)) => *ours.entry(frame.to_string()).or_default() += blocks,
            Some(_) => theirs += blocks,
            None => {}
        }
    }
    (theirs, ours)
}

#[test]
fn a_steady_frame_s_encoding_allocates_nothing_of_ours() {
    let context = context();
    let colour = eyes(&context);
    let mut target = Target { mirror: Mirror::new(context), colour, frames: 0, lines: 1 };
    let mask = VisibilityMask { corners: vec![[-2.0, -2.0], [0.0, -2.0], [-2.0, 0.0]], indices: vec![0, 1, 2] };
    target.mirror.renderer_mut().set_visibility_masks(&[mask.clone(), mask]);
    let mut app = App::new(scene("beam", 2400).0, 1.0, || 0);
    let mut number = 0;
    let mut frames = |app: &mut App, target: &mut Target, count: usize, commands: Vec<EditCommand>| {
        let mut input = InputFrame { step_s: 1.0 / 90.0, commands, ..InputFrame::default() };
        for _ in 0..count {
            number += 1;
            input.time_s = f64::from(number) / 90.0;
            app.frame(&input, target).expect("a frame");
            input.commands.clear();
        }
    };
    frames(&mut app, &mut target, 30, Vec::new());
    let (theirs, ours) = allocated(|| frames(&mut app, &mut target, 10, Vec::new()));
    println!("asleep: {} a frame of wgpu's, {ours:?}", theirs / 10);
    assert!(ours.is_empty(), "asleep: {ours:#?}");
    assert!(theirs > 10, "frames were seen");
    app.scene.set_animation(Some(0));
    let grab = EditCommand::GrabBegin { id: 1, center: DVec3::new(0.0, 0.05, 0.0), radius: 0.1 };
    frames(&mut app, &mut target, 30, vec![grab, EditCommand::GrabMove { id: 1, by: DVec3::Y * 0.01 }]);
    // a hand that stays where it is lets the springs come to rest
    let moved = |k: u32| vec![EditCommand::GrabMove { id: 1, by: DVec3::Y * (0.01 + 0.001 * f64::from(k)) }];
    let mut active = || (0..10).for_each(|k| frames(&mut app, &mut target, 1, moved(k)));
    active();
    let (theirs, ours) = allocated(active);
    println!("active: {} a frame of wgpu's, {ours:?}", theirs / 10);
    assert!(ours.is_empty(), "active: {ours:#?}");
    assert!(theirs > 10, "frames were seen");
    // The control: more lines than there is room for are kept in lists of ours.
    target.lines = 1000;
    let (_, ours) = allocated(|| frames(&mut app, &mut target, 1, Vec::new()));
    assert!(ours.keys().any(|place| place.contains("src/gpu/lines.rs")), "{ours:#?}");
}
