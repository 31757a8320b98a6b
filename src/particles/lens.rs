//! The shape of an open wound: rest displacements of its wound particles, such that its lips stand apart as a lens does (MATHS 3.3).
//!
//! A lip follows a blend of the particles around, so a lip whose particles stood on the lens would not: ends would gape, drawn open by what
//! stands beside them, and the middle would open less than it should. That is good enough while the blade goes on, and cheap. Once it has
//! left, the particles are set such that the lip is where it belongs at each of them, as far as that goes without waves: a few rounds of
//! Landweber's iteration (1951) for least squares.

use super::legs::{LegLip, MOST_LIPS};
use super::particle_map::ParticleMap;
use super::settings::WoundSettings;
use super::strips::Strips;
use crate::geometry::room::fit;
use crate::geometry::{ParticleId, VertexId};
use glam::DVec3;

/// Widest opening over the length of the slit: a short slit opens less than the gap.
const GAP_OVER_LENGTH: f64 = 0.35;
/// Least share of the gap, so that a wound particle never counts as an ordinary one.
pub(super) const LEAST_SHARE: f64 = 1e-3;
/// Most rounds of the iteration.
const ROUNDS: usize = 24;
/// A lip is where it belongs if it is no further off than this share of the half gap.
const CLOSE: f64 = 0.005;
/// No particle is further out than so many half gaps, nor further in.
const MOST: [f64; 2] = [-1.0, 2.0];

/// Scratch of [`Lens::displace_wound`], kept between updates.
#[derive(Clone, Debug, Default)]
pub(super) struct Lens {
    marks: Vec<Marked>,
    /// By particle, its place among `marks`; all [`NONE`] between uses.
    place_of: Vec<u32>,
    shares: Vec<Share>,
    /// Lips of a leg of the slit.
    pub(super) leg: Vec<LegLip>,
}

/// Particles of a slit that there is room for at first, more than [`WoundSettings::max_particles`] mostly is, and of those that move one of
/// its lips.
const MARKS: usize = 256;
const SHARES: usize = 16;

const NONE: u32 = u32::MAX;

/// How wide a wound stands open at a place, over its half gap: a parabola from end to end, half of one from an end that is not shut.
fn share_of_gap(place: f64, [low, high]: [f64; 2], is_shut: [bool; 2]) -> f64 {
    let x = if high > low { (place - low) / (high - low) } else { f64::INFINITY };
    match (x, is_shut) {
        (x, [shut, _]) if x < 0.0 => f64::from(u8::from(!shut)),
        (x, [_, shut]) if x.is_nan() || x > 1.0 => f64::from(u8::from(!shut)),
        (x, [true, true]) => 4.0 * x * (1.0 - x),
        (x, [true, false]) => x * (2.0 - x),
        (x, [false, true]) => 1.0 - x * x,
        (_, [false, false]) => 1.0,
    }
}

/// A wound particle of the slit.
#[derive(Clone, Copy, Debug)]
struct Marked {
    particle: ParticleId,
    anchor: VertexId,
    /// Where it is on the wound's line, metres, and whether in another skin than that.
    place: f64,
    is_elsewhere: bool,
    /// Unit vector away from the slit.
    outwards: DVec3,
    /// How far out the lip belongs, and how far out the particle is set, metres.
    lip: f64,
    set: f64,
    /// How far the lip is off that, and how far the particle goes for all lips that are.
    off: f64,
    step: f64,
}

impl Marked {
    /// What the lip counts for: an end that gapes is seen more than a middle that is a little narrow.
    fn weight(&self, half_gap: f64) -> f64 {
        half_gap / (0.25 * half_gap + self.lip)
    }
}

/// How far a particle of the slit, by its place among the marks, moves the lip of another along that one's way, over how far it is set.
#[derive(Clone, Copy, Debug)]
struct Share {
    lip: u32,
    particle: u32,
    share: f64,
}

/// How a wound stands open.
#[derive(Clone, Copy, Debug)]
pub(super) struct Opening {
    pub(super) wound: u32,
    /// From where to where on its line, metres; a leg, where it runs over an edge, goes on beyond its strips.
    pub(super) open: [f64; 2],
    /// Whether the lips meet at both ends.
    pub(super) is_shut: [bool; 2],
    /// Whether the blade has left it.
    pub(super) is_done: bool,
}

impl Lens {
    /// Makes room for a usual slit in a map of so many particles.
    pub(super) fn make_room(&mut self, particles: usize) {
        fit(&mut self.place_of, particles, NONE);
        self.marks.reserve(MARKS);
        self.shares.reserve(SHARES * MARKS);
        self.leg.reserve(2 * MOST_LIPS);
    }

    /// Sets the rest displacements of a wound: a parabola along its open metres, closed behind. It is half the gap at the middle and nothing
    /// at the ends; an end where lips do not meet is as wide as the middle would be. Tells the particles whose displacement changed.
    pub(super) fn displace_wound(
        &mut self,
        (map, rest): (&mut ParticleMap, &[DVec3]),
        strips: &Strips,
        wound: &WoundSettings,
        opening: Opening,
        mut changed: impl FnMut(ParticleId),
    ) {
        let half_gap = 0.5 * wound.gap.min(GAP_OVER_LENGTH * (opening.open[1] - opening.open[0]).max(0.0));
        self.list((map, rest), strips, wound, opening, half_gap);
        if opening.is_done && half_gap > 0.0 {
            let pace = self.weigh(map, half_gap);
            for _ in 0..ROUNDS {
                if !self.round(half_gap, pace) {
                    break;
                }
            }
        }
        for m in &self.marks {
            self.place_of[m.particle.index()] = NONE;
            let least = LEAST_SHARE * wound.gap;
            let share = if m.set.abs() < least { least } else { m.set };
            let u0 = (m.outwards * share).to_array();
            if map.rest_displacement[m.particle.index()] != u0 && u0 != [0.0; 3] {
                map.rest_displacement.set(m.particle.index(), u0);
                changed(m.particle);
            }
        }
    }

    /// Collects the wound's live particles, where their lips belong and where they are set.
    fn list(
        &mut self,
        (map, rest): (&ParticleMap, &[DVec3]),
        strips: &Strips,
        wound: &WoundSettings,
        opening: Opening,
        half_gap: f64,
    ) {
        let Opening { open: [low, high], is_shut, .. } = opening;
        fit(&mut self.place_of, map.len(), NONE);
        self.marks.clear();
        let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
        for mark in strips.marks_of(opening.wound) {
            let particle = mark.particle;
            let Some(&anchor) = map.anchors.get(particle.index()).filter(|a| a.is_some()) else { continue };
            let place = strips.place_of(mark).0;
            let is_elsewhere = !strips.as_slice()[mark.strip as usize].is_near_skin(rest[anchor.index()], wound.spacing);
            if is_elsewhere {
                (first, last) = (first.min(place), last.max(place));
            }
            let outwards = strips.geometry(mark.strip as usize).normal() * f64::from(mark.side);
            self.place_of[particle.index()] = self.marks.len() as u32;
            self.marks.push(Marked { particle, anchor, place, is_elsewhere, outwards, lip: 0.0, set: 0.0, off: 0.0, step: 0.0 });
        }
        // What the blade cut of another skin may end before the wound does, whose lips meet where it ends: there that one's do.
        let (first, last) = (first - 0.5 * wound.spacing, last + 0.5 * wound.spacing);
        let ends = [is_shut[0] && first > low + wound.spacing, is_shut[1] && last < high - wound.spacing];
        let other = [if ends[0] { first } else { low }, if ends[1] { last } else { high }];
        for m in &mut self.marks {
            let open = if m.is_elsewhere { other } else { [low, high] };
            m.lip = half_gap * share_of_gap(m.place, open, is_shut);
            m.set = m.lip;
        }
    }

    /// Collects what moves each lip, and how far the iteration may go in a round.
    fn weigh(&mut self, map: &ParticleMap, half_gap: f64) -> f64 {
        self.shares.clear();
        for (i, lip) in self.marks.iter().enumerate() {
            // what an older wound does to the lip is that one's
            for influence in map.influences.row(lip.anchor.index()) {
                let k = self.place_of[influence.particle.index()];
                if let Some(m) = self.marks.get(k as usize) {
                    let share = m.outwards.dot(lip.outwards) * f64::from(influence.weight);
                    self.shares.push(Share { lip: i as u32, particle: k, share });
                }
            }
        }
        for &Share { lip, particle, share } in &self.shares {
            let weight = self.marks[lip as usize].weight(half_gap);
            self.marks[particle as usize].step += share.abs() * weight;
        }
        let largest = self.marks.iter().map(|m| m.step).fold(1.0, f64::max);
        1.0 / largest
    }

    /// One round. False if no lip is off by more than [`CLOSE`].
    fn round(&mut self, half_gap: f64, pace: f64) -> bool {
        for m in &mut self.marks {
            (m.off, m.step) = (m.lip, 0.0);
        }
        for &Share { lip, particle, share } in &self.shares {
            self.marks[lip as usize].off -= self.marks[particle as usize].set * share;
        }
        if self.marks.iter().all(|m| m.off.abs() <= CLOSE * half_gap) {
            return false;
        }
        for m in &mut self.marks {
            m.off *= m.weight(half_gap);
        }
        for &Share { lip, particle, share } in &self.shares {
            self.marks[particle as usize].step += share * self.marks[lip as usize].off;
        }
        for m in &mut self.marks {
            m.set = (m.set + m.step * pace).clamp(MOST[0] * half_gap, MOST[1] * half_gap);
        }
        true
    }
}
