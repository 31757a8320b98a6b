//! What a window did, for those who check it.

use crate::app::FrameReport;
use crate::geometry::VertexId;
use crate::input::tools::{StrokeTrace, TraceSample};
use crate::scene::{Scene, TissueId};
use crate::tissue::Tissue;
use glam::DVec3;
use std::collections::BTreeMap;

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
    /// Vertices that the stroke inserted.
    pub inserted: usize,
    /// Largest distance at rest of one of those from the line through the places, metres; infinite if either is missing.
    pub stray: f64,
}

/// A place that the pointer tore at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrokeSample {
    /// Pixels from the window's upper left corner.
    pub pixel: [f64; 2],
    /// The point of the surface there, tissue space at rest, metres.
    pub rest: DVec3,
    /// Distance at rest to the nearest vertex that the stroke inserted, metres; infinite if there is none.
    pub lip_distance: f64,
}

/// Rest positions of vertices that edits have inserted, by tissue and vertex.
pub type Inserted = BTreeMap<(TissueId, VertexId), DVec3>;

/// What edits have inserted into a scene so far.
pub fn inserted_vertices(scene: &Scene) -> Inserted {
    let of_tissue = |(id, t): (TissueId, &'_ Tissue)| {
        let made = t.mesh().live_vertices().filter(|v| !t.rows().rows.row(v.index()).is_empty());
        made.map(|v| ((id, v), t.rest_positions()[v.index()])).collect::<Vec<_>>()
    };
    scene.tissues().flat_map(of_tissue).collect()
}

impl StrokeNote {
    /// Measures a trace against the vertices that its stroke inserted, at rest. `origin` is the picture's upper left pixel.
    pub fn new(trace: &StrokeTrace, inserted: &[DVec3], frame: usize, origin: [f64; 2]) -> Self {
        let sample = |s: &TraceSample| StrokeSample {
            pixel: [s.pixel[0] + origin[0], s.pixel[1] + origin[1]],
            rest: s.rest,
            lip_distance: inserted.iter().map(|p| p.distance(s.rest)).fold(f64::INFINITY, f64::min),
        };
        let samples: Vec<StrokeSample> = trace.samples.iter().map(sample).collect();
        let off = |p: &DVec3| {
            let alone = samples.iter().map(|s| s.rest.distance(*p));
            let between = samples.windows(2).map(|s| from_segment(*p, s[0].rest, s[1].rest));
            alone.chain(between).fold(f64::INFINITY, f64::min)
        };
        let stray = inserted.iter().map(off).reduce(f64::max).unwrap_or(f64::INFINITY);
        Self { frame, samples, inserted: inserted.len(), stray }
    }
}

/// Distance of a point from a segment.
fn from_segment(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let along = b - a;
    let t = ((p - a).dot(along) / along.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    p.distance(a + along * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wound_beside_the_stroke_is_told_from_one_under_it() {
        let sample = |x: f64| TraceSample { pixel: [x, 5.0], tissue: TissueId(0), rest: DVec3::X * x };
        let trace = StrokeTrace { samples: vec![sample(0.0), sample(2.0)] };
        let lips = [DVec3::new(0.0, 0.1, 0.0), DVec3::new(1.0, -0.1, 0.0), DVec3::new(2.0, 0.1, 0.0)];
        let note = StrokeNote::new(&trace, &lips, 3, [300.0, 10.0]);
        assert_eq!((note.frame, note.inserted, note.samples[1].pixel), (3, 3, [302.0, 15.0]));
        assert!((note.stray - 0.1).abs() < 1e-12 && note.samples.iter().all(|s| (s.lip_distance - 0.1).abs() < 1e-12));
        let beside = lips.map(|p| p + DVec3::Y);
        assert!(StrokeNote::new(&trace, &beside, 3, [0.0; 2]).stray > 1.0);
        let nothing = StrokeNote::new(&trace, &[], 3, [0.0; 2]);
        assert!(nothing.stray.is_infinite() && nothing.samples[0].lip_distance.is_infinite());
    }
}
