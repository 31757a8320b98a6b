//! A stroke: poses in, tear segments out. The sampler, the clip of the blade and the chain builder in one.

use super::blade_path::{BladePose, Met, Sampling, Surface};
use super::boxes::TearSegment;
use super::chain::ChainBuilder;
use super::path_sampler::{ClippedSample, PathSample, PathSampler, SampleKind};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// What lines a tear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WallMode {
    /// Nothing: the surface is clipped (the paper).
    #[default]
    Open,
    /// Walls and a floor, so that a closed model stays closed (MATHS 5.7).
    Closed,
}

/// One stroke of the blade, from the moment it is taken up to its release.
#[derive(Clone, Debug)]
pub struct Stroke {
    sampling: Sampling,
    sampler: PathSampler,
    builder: ChainBuilder,
    previous: Option<ClippedSample>,
    samples: Vec<PathSample>,
}

/// Samples of a pose that there is room for at first.
const SAMPLES: usize = 64;

impl Stroke {
    /// A stroke of `width` metres (0: a slit).
    pub fn new(width: f64, sampling: Sampling) -> Self {
        Self {
            sampling,
            sampler: PathSampler::new(sampling),
            builder: ChainBuilder::new(width, &sampling),
            previous: None,
            samples: Vec::new(),
        }
    }

    /// A stroke of `width` metres in the buffers of one that is over.
    pub fn again(mut self, width: f64, sampling: Sampling) -> Self {
        self.samples.clear();
        let (sampler, builder) = (PathSampler::new(sampling), self.builder.again(width, &sampling));
        Self { sampling, sampler, builder, previous: None, samples: self.samples }
    }

    /// Boxes that come are of `width` metres. Before the first pose.
    pub fn set_width(&mut self, width: f64) {
        self.builder.set_width(width, &self.sampling);
    }

    /// Makes room for a usual stroke.
    pub fn make_room(&mut self) {
        self.builder.make_room();
        self.samples.reserve(SAMPLES);
    }

    /// Takes the next pose; `surface` is the tissue as it is now. Appends the segments that are complete.
    pub fn push(&mut self, pose: BladePose, surface: &(impl Surface + ?Sized), out: &mut Vec<TearSegment>) {
        self.samples.clear();
        self.sampler.push(pose, &mut self.samples);
        self.feed(surface, out);
    }

    /// Appends what is due since the blade has left the surface: to be called before the next pose, if ever.
    pub fn close_left(&mut self, out: &mut Vec<TearSegment>) {
        self.builder.close_left(out);
    }

    /// Ends the stroke at the last pose and appends the rest.
    pub fn release(&mut self, surface: &(impl Surface + ?Sized), out: &mut Vec<TearSegment>) {
        self.samples.clear();
        self.sampler.finish(&mut self.samples);
        self.feed(surface, out);
        self.builder.release(out);
        self.previous = None;
    }

    /// Tip and base of the newest pose and of the last sample where the tissue has carried them.
    pub fn carried(&self) -> Option<[[DVec3; 2]; 2]> {
        self.sampler.carried()
    }

    /// The tissue has carried those by so much since (MATHS 5.5).
    pub fn carry(&mut self, by: [[DVec3; 2]; 2]) {
        self.sampler.carry(by);
        if let Some(previous) = &mut self.previous {
            previous.carry(by[1]);
        }
    }

    /// The chain builder: pending quads to re-pose, counts.
    pub fn builder(&mut self) -> &mut ChainBuilder {
        &mut self.builder
    }

    fn feed(&mut self, surface: &(impl Surface + ?Sized), out: &mut Vec<TearSegment>) {
        for i in 0..self.samples.len() {
            let mut clipped = ClippedSample::clip(&self.samples[i], surface, &self.sampling);
            if let Some(between) = self.between(&clipped, surface) {
                self.take(between, surface, out);
                // it leaves what it has met, and does not end there
                clipped.kind = SampleKind::Move;
            }
            self.take(clipped, surface, out);
        }
    }

    /// A sample where the blade has met the tissue since the last, if that is outside as the new one is: a strip between wounds, say, is
    /// thinner than the way between samples.
    fn between(&self, new: &ClippedSample, surface: &(impl Surface + ?Sized)) -> Option<ClippedSample> {
        let previous =
            self.previous.as_ref().filter(|p| p.top.is_none() && new.top.is_none() && new.kind != SampleKind::Axial)?;
        let share = surface.met_between(&previous.pose, &new.pose)?.share;
        let met = PathSample { pose: previous.pose.lerp(&new.pose, share), kind: SampleKind::Move };
        Some(ClippedSample::clip(&met, surface, &self.sampling)).filter(|met| met.top.is_some())
    }

    fn take(&mut self, mut clipped: ClippedSample, surface: &(impl Surface + ?Sized), out: &mut Vec<TearSegment>) {
        if let Some(previous) = &self.previous {
            if previous.top.is_none() && clipped.top.is_some() {
                self.builder.keep_outside(&clipped.pose, |pose| surface.entry(pose.tip, pose.base).is_none());
            }
            clipped.raise = rise_between(previous, &clipped, surface, &self.sampling);
            if previous.top.is_some() {
                self.builder.raise_last(clipped.raise);
            }
        }
        self.builder.push(&clipped, out);
        if clipped.kind != SampleKind::Axial || clipped.top.is_none() {
            self.previous = Some(clipped);
        }
    }
}

/// How much higher than the line between two tops the surface comes on the way, margin included (MATHS 5.1).
fn rise_between(a: &ClippedSample, b: &ClippedSample, surface: &(impl Surface + ?Sized), sampling: &Sampling) -> f64 {
    if b.kind != SampleKind::Move {
        return 0.0;
    }
    let (top_a, top_b) = match (a.top, b.top) {
        (Some(top_a), Some(top_b)) => (top_a, top_b),
        (Some(top), None) => return rise_beside(a, top, surface.met_between(&a.pose, &b.pose), sampling),
        (None, Some(top)) => return rise_beside(b, top, surface.met_between(&a.pose, &b.pose), sampling),
        (None, None) => return 0.0,
    };
    // a ridge right beside the lower top reaches as high as the higher one
    let mut rise = (top_b - top_a).dot(b.pose.up()).abs();
    for k in 1..=sampling.probes {
        let u = f64::from(k) / f64::from(sampling.probes + 1);
        let blade = a.pose.lerp(&b.pose, u);
        if let Some(entry) = surface.entry(blade.tip, blade.base) {
            let point: DVec3 = blade.base + (blade.tip - blade.base) * entry.s;
            let above = (point - (top_a + (top_b - top_a) * u)).dot(blade.up());
            rise = rise.max(risen(above, sampling));
        }
    }
    rise
}

/// How much higher than its top the surface comes on the way between a blade inside and one outside, margin included: a blade that leans enters a
/// part by its side.
fn rise_beside(inside: &ClippedSample, top: DVec3, met: Option<Met>, sampling: &Sampling) -> f64 {
    let BladePose { tip, base, .. } = inside.pose;
    let above = met.map_or(f64::NEG_INFINITY, |met| (base - tip).length() * (1.0 - met.s) - (top - tip).length());
    risen(above, sampling)
}

/// How far a top is raised for a surface so far above it, metres: not at all for one that stays well within the margin.
fn risen(above: f64, sampling: &Sampling) -> f64 {
    if above > -0.5 * sampling.entry_margin { above + sampling.entry_margin } else { 0.0 }
}

/// All segments of a whole path: what a live stroke gives for the same poses over the same surface, bit for bit.
pub fn tear_segments(poses: &[BladePose], width: f64, sampling: Sampling, surface: &(impl Surface + ?Sized)) -> Vec<TearSegment> {
    let (mut stroke, mut out) = (Stroke::new(width, sampling), Vec::new());
    for pose in poses {
        stroke.push(*pose, surface, &mut out);
    }
    stroke.release(surface, &mut out);
    out
}

#[cfg(test)]
#[path = "stroke_tests.rs"]
mod tests;

#[cfg(test)]
#[path = "stroke_moving_tests.rs"]
mod moving_tests;
