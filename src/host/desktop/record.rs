//! What a window did, for those who check it.

use crate::app::FrameReport;
use crate::input::tools::StrokeTrace;
use crate::scene::Scene;
use glam::DVec3;

/// One frame that was drawn.
#[derive(Clone, Debug)]
pub struct FrameNote {
    /// Seconds since the program started.
    pub at_s: f64,
    /// What it did.
    pub report: FrameReport,
}

/// One stroke of the pointer: where it went over the tissue, and how far from there the wound is.
#[derive(Clone, Debug, PartialEq)]
pub struct StrokeNote {
    /// Number of the frame that it ended in.
    pub frame: usize,
    /// Its places.
    pub samples: Vec<StrokeSample>,
}

/// A place that the pointer tore at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrokeSample {
    /// Pixels from the window's upper left corner.
    pub pixel: [f64; 2],
    /// The point of the surface there, tissue space at rest, metres.
    pub rest: DVec3,
    /// Distance at rest to the nearest vertex that an edit inserted, metres; infinite if there is none.
    pub lip_distance: f64,
}

impl StrokeNote {
    /// Measures a trace against what the edits have made of the scene. `origin` is the picture's upper left pixel.
    pub fn new(trace: &StrokeTrace, scene: &Scene, frame: usize, origin: [f64; 2]) -> Self {
        let inserted: Vec<DVec3> = scene
            .tissues()
            .flat_map(|(_, t)| {
                let made = t.mesh().live_vertices().filter(|v| !t.rows().rows.row(v.index()).is_empty());
                made.map(|v| t.rest_positions()[v.index()])
            })
            .collect();
        let sample = |s: &crate::input::tools::TraceSample| StrokeSample {
            pixel: [s.pixel[0] + origin[0], s.pixel[1] + origin[1]],
            rest: s.rest,
            lip_distance: inserted.iter().map(|p| p.distance(s.rest)).fold(f64::INFINITY, f64::min),
        };
        Self { frame, samples: trace.samples.iter().map(sample).collect() }
    }
}
