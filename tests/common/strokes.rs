//! Strokes for the counts of allocations.

use glam::DVec3;
use incise::app::App;
use incise::input::InputFrame;
use incise::scene::EditCommand;
use incise::surgery::{BladePose, WallMode};

/// Frames from one stroke's begin to the next.
const STROKE: u32 = 80;
/// The frame of a stroke in which it ends.
const END: u32 = 50;

/// Eight strokes across the bundled heart, frame by frame at 90 a second: without walls, with, and of width 0; a hand takes hold of a
/// lip of the last kind.
pub struct HeartStrokes;

impl HeartStrokes {
    pub const FRAMES: u32 = 8 * STROKE;
    pub const COUNT: usize = 8;

    /// Input of frame `number`; sets the walls where a stroke begins.
    pub fn input(app: &mut App, number: u32) -> InputFrame {
        let (stroke, k) = (number / STROKE, number % STROKE);
        let (x, y) = (0.002 * f64::from(k) - 0.05, 0.028 - 0.006 * f64::from(stroke));
        let (tip, base) = (DVec3::new(x, y, 0.02), DVec3::new(x, y, 0.12));
        let pose = EditCommand::StrokePose(BladePose { t: f64::from(k) / 90.0, tip, base });
        let commands = match k {
            0 => vec![EditCommand::StrokeBegin { width: if stroke % 3 == 2 { 0.0 } else { 0.002 } }, pose],
            END => vec![EditCommand::StrokeEnd],
            // Where the next stroke finds tissue that swings back, ties take exact arithmetic, which allocates; open strokes have the fewest.
            _ if k > END && stroke % 3 != 2 => Vec::new(),
            52 => vec![EditCommand::GrabBegin { id: 1, center: DVec3::new(0.0, y - 0.01, 0.04), radius: 0.015 }],
            53..58 => vec![EditCommand::GrabMove { id: 1, by: DVec3::new(0.0, 0.001 * f64::from(k - 52), 0.002) }],
            58 => vec![EditCommand::GrabEnd { id: 1 }],
            _ if k < END => vec![pose],
            _ => Vec::new(),
        };
        if k == 0 {
            app.scene.set_wall(if stroke % 3 == 1 { WallMode::Closed } else { WallMode::Open });
        }
        InputFrame { time_s: f64::from(number) / 90.0, step_s: 1.0 / 90.0, commands, ..InputFrame::default() }
    }

    /// True for frames that may allocate nothing: those after the first second.
    pub fn is_counted(number: u32) -> bool {
        number >= 90
    }
}

/// A stroke into the bundled heart whose blade turns and dives, at 90 poses a second.
pub struct WildStroke {
    pub wall: WallMode,
    width: f64,
    poses: u32,
    from: DVec3,
    to: DVec3,
    /// How far the blade turns, radians.
    turn: f64,
}

impl WildStroke {
    /// Frames after the end in which the tissue swings.
    const REST: u32 = 15;

    /// Always the same for the same numbers.
    pub fn draw(seed: u64, stroke: u64) -> Self {
        let mut state = (seed * 7_919 + stroke * 104_729 + 13) | 1;
        let mut draw = |low: f64, high: f64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            low + (high - low) * ((state >> 33) as f64 / (1u64 << 31) as f64)
        };
        for _ in 0..4 {
            draw(0.0, 1.0);
        }
        let wall = if draw(0.0, 1.0) < 0.5 { WallMode::Closed } else { WallMode::Open };
        let width = [0.0, 0.0005, 0.002, 0.004][draw(0.0, 4.0) as usize];
        let side = if draw(0.0, 1.0) < 0.5 { 1.0 } else { -1.0 };
        let (reach, depth) = (side * draw(0.01, 0.06), draw(0.005, 0.03));
        let mut end = |x: f64| DVec3::new(x, draw(-0.03, 0.04), depth);
        let (from, to) = (end(-reach), end(reach));
        Self { wall, width, poses: draw(30.0, 80.0) as u32, from, to, turn: draw(-3.0, 3.0) }
    }

    /// The frame in which it ends.
    pub fn end(&self) -> u32 {
        self.poses
    }

    /// Frames to play.
    pub fn frames(&self) -> u32 {
        self.poses + Self::REST
    }

    /// Input of its `k`th frame, the `number`th in all.
    pub fn input(&self, number: u32, k: u32) -> InputFrame {
        let part = f64::from(k) / f64::from(self.poses);
        let (sin, cos) = (self.turn * part).sin_cos();
        let tip = self.from.lerp(self.to, part) + DVec3::new(0.0, 0.01 * sin, 0.008 * sin * cos);
        let base = tip + DVec3::new(0.02 * sin, 0.02 * cos, 0.1);
        let pose = EditCommand::StrokePose(BladePose { t: f64::from(k) / 90.0, tip, base });
        let commands = match k {
            0 => vec![EditCommand::StrokeBegin { width: self.width }, pose],
            _ if k < self.poses => vec![pose],
            _ if k == self.poses => vec![EditCommand::StrokeEnd],
            _ => Vec::new(),
        };
        InputFrame { time_s: f64::from(number) / 90.0, step_s: 1.0 / 90.0, commands, ..InputFrame::default() }
    }
}
