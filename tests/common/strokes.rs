//! Strokes for the counts of allocations.

use glam::DVec3;
use incise::app::App;
use incise::input::InputFrame;
use incise::scene::EditCommand;
use incise::surgery::{BladePose, WallMode};

/// Frames from one stroke's begin to the next.
const STROKE: u32 = 60;
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
            // Where the next stroke finds tissue that swings back, ties take exact arithmetic, and boxes that go wrong are taken back: both
            // allocate, and open strokes have the fewest.
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

    /// True for frames that may allocate nothing: those after the first second, but for the ends of strokes where assertions are checked:
    /// those look at everything, in lists of their own.
    pub fn is_counted(number: u32) -> bool {
        number >= 90 && !(number % STROKE == END && cfg!(debug_assertions))
    }
}
