//! Lines of wounds: where strips lie that open as one (MATHS 3.3).
//!
//! A wound is what a lens is made for, from the one end where its lips meet to the other. Strips of one stroke are several where it cut skin in several
//! places; a later stroke that goes on from an end of a wound, or comes back along it, adds to that one's line.

use super::particle_map::ParticleMap;
use super::slit_line::Strip;
use super::strips::{StripError, Strips, WoundMark};
use glam::DVec3;

/// The wound of strips that run beside the lines of all.
pub const NO_WOUND: u32 = u32::MAX;

/// Where a strip lies on the line of a wound: see [`Strip`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnLine {
    /// The wound.
    pub wound: u32,
    /// Where its earlier end lies on the line, metres.
    pub place: f64,
    /// +1 along the line, -1 back over it, 0 beside.
    pub way: i32,
    /// Where it cut the skin, at its earlier and its later end, metres in rest space.
    pub skin: [DVec3; 2],
    /// How long it counts as there, metres.
    pub length: f64,
}

impl OnLine {
    /// Below the skin: it parts what it parts, and holds no wound particles.
    pub const BESIDE: Self = Self { wound: NO_WOUND, place: 0.0, way: 0, skin: [DVec3::ZERO; 2], length: 0.0 };
}

/// What is known of a wound: its first strip, and how far its strips reach on its line, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WoundRange {
    pub(super) first: usize,
    pub(super) low: f64,
    pub(super) high: f64,
}

impl WoundRange {
    /// Takes in strip `k`.
    pub(super) fn take(ranges: &mut Vec<Self>, k: usize, strip: &Strip) {
        if strip.is_beside() {
            return;
        }
        let ends = [strip.place, strip.end_place()];
        let [low, high] = [ends[0].min(ends[1]), ends[0].max(ends[1])];
        // a wound that is unknown as yet has none of its strips here
        while ranges.len() <= strip.wound as usize {
            ranges.push(Self { first: k, low, high });
        }
        let range = &mut ranges[strip.wound as usize];
        *range = Self { first: range.first, low: range.low.min(low), high: range.high.max(high) };
    }
}

impl Strips {
    /// Number of the next wound, for [`OnLine`].
    pub fn next_wound(&self) -> u32 {
        self.derived.ranges.len() as u32
    }

    /// Adds the strip `(tip0, tip1, base1, base0)` in rest space and returns its index. `reach` is the radius of
    /// influence `d`; `slit` is the last strip's where this one goes on from it, else [`Strips::next_slit`]. It lies on the line of that
    /// slit's last strip with its base in the skin, or on that of a new wound.
    pub fn push(&mut self, corners: [DVec3; 4], reach: f64, slit: u32) -> Result<usize, StripError> {
        let of_slit = self.strips.iter().rev().take_while(|s| s.slit == slit);
        let last = of_slit.filter(|s| !s.is_beside()).map(|s| (s.wound, s.end_place())).next();
        let (wound, place) = last.unwrap_or((self.next_wound(), 0.0));
        self.push_strip(
            corners,
            reach,
            slit,
            OnLine { wound, place, way: 1, skin: [corners[3], corners[2]], length: corners[3].distance(corners[2]) },
        )
    }

    /// [`Strips::push`] of a strip whose place on a wound's line is known. `on.wound` is at most [`Strips::next_wound`], or it runs beside.
    pub(crate) fn push_strip(&mut self, corners: [DVec3; 4], reach: f64, slit: u32, on: OnLine) -> Result<usize, StripError> {
        let numbers = corners.iter().chain(&on.skin).flat_map(|c| c.to_array()).chain([reach, on.place, on.length]);
        if !numbers.into_iter().all(f64::is_finite) || reach < 0.0 {
            return Err(StripError::NotFinite);
        }
        let OnLine { wound, place, way, skin, length } = if on.way == 0 { OnLine::BESIDE } else { on };
        let (corners, skin) = (corners.map(|c| c.to_array()), skin.map(|p| p.to_array()));
        let index = self.strips.push(Strip { corners, reach, slit, wound, place, skin, length, way: way.signum(), padding: 0 });
        self.derive();
        Ok(index)
    }

    /// How far the strips of a wound reach on its line, `[low, high]` in metres; `None` if there is no such wound.
    pub fn wound_range(&self, wound: u32) -> Option<[f64; 2]> {
        self.derived.ranges.get(wound as usize).map(|r| [r.low, r.high])
    }

    /// The strips of a wound, in the order they were made.
    pub(super) fn of_wound(&self, wound: u32) -> impl Iterator<Item = usize> + use<'_> {
        let first = self.derived.ranges.get(wound as usize).map_or(self.len(), |r| r.first);
        (first..self.len()).filter(move |&k| self.strips[k].wound == wound)
    }

    /// True if a chain of the blade's way has its first strip on any wound's line here: what it begins in is not its own wound.
    pub(super) fn begins_chain(&self, k: usize) -> bool {
        (self.slit_start(k)..k).all(|i| self.strips[i].slit != self.strips[k].slit || self.strips[i].is_beside())
    }

    /// Marks of a wound and their places among all, newest first.
    pub(super) fn marks_of(&self, wound: u32) -> impl Iterator<Item = (usize, &WoundMark)> {
        self.wounds.iter().enumerate().rev().filter(move |(_, m)| self.strips[m.strip as usize].wound == wound)
    }

    /// Where a mark lies on its wound's line, metres, and on which side of that: a strip that runs back has its own other way round.
    pub(super) fn place_of(&self, mark: &WoundMark) -> (f64, i32) {
        let strip = &self.strips[mark.strip as usize];
        (strip.place_at(mark.along), strip.way * mark.side)
    }

    /// True if a wound particle is less than `near` metres from a place on a wound's line.
    pub(super) fn is_held(&self, map: &ParticleMap, wound: u32, place: f64, near: f64) -> bool {
        let lives = |m: &WoundMark| map.anchors.get(m.particle.index()).is_some_and(|a| a.is_some());
        self.marks_of(wound).any(|(_, m)| (self.place_of(m).0 - place).abs() < near && lives(m))
    }
}
