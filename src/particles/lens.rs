//! The shape of an open wound: rest displacements of its wound particles, such that its lips stand apart as a lens does (MATHS 3.3).
//!
//! A lip follows a blend of the particles around, so a lip whose particles stood on the lens would not: ends would gape, drawn open by what
//! stands beside them, and the middle would open less than it should. That is good enough while the blade goes on, and cheap. Once it has
//! left, the particles are set such that the lip is where it belongs at each of them, as far as that goes without waves: a few rounds of
//! Landweber's iteration (1951) for least squares.

use super::legs::{LegLip, MOST_LIPS};
use super::particle_map::ParticleMap;
use super::settings::WoundSettings;
use super::strips::{Strips, WoundMark};
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

/// Scratch of [`Lens::displace_slit`], kept between updates.
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

/// A wound particle of the slit.
#[derive(Clone, Copy, Debug)]
struct Marked {
    particle: ParticleId,
    anchor: VertexId,
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

/// How a slit stands open.
#[derive(Clone, Copy, Debug)]
pub(super) struct Opening {
    /// The slit's first strip.
    pub(super) start: usize,
    /// It begins so many metres before that, on its leg where it runs over an edge.
    pub(super) before: f64,
    /// It stands open from there to so many metres along its strips.
    pub(super) open: f64,
    /// Whether the lips meet where that ends.
    pub(super) is_shut: bool,
    /// Whether the blade has left it.
    pub(super) is_done: bool,
}

/// Marks of the slit that starts at strip `start` and goes on to the newest strip.
pub(super) fn slit_marks(strips: &Strips, start: usize) -> impl Iterator<Item = &WoundMark> {
    strips.wounds().iter().rev().take_while(move |m| m.strip as usize >= start)
}

impl Lens {
    /// Makes room for a usual slit in a map of so many particles.
    pub(super) fn make_room(&mut self, particles: usize) {
        fit(&mut self.place_of, particles, NONE);
        self.marks.reserve(MARKS);
        self.shares.reserve(SHARES * MARKS);
        self.leg.reserve(2 * MOST_LIPS);
    }

    /// Sets the rest displacements of a slit: a parabola along its open metres, closed behind. It is half the gap at the middle and nothing at
    /// the ends; an end where lips do not meet is as wide as the middle would be. The start is shut if a wound particle holds it. Tells
    /// the particles whose displacement changed.
    pub(super) fn displace_slit(
        &mut self,
        map: &mut ParticleMap,
        strips: &Strips,
        wound: &WoundSettings,
        opening: Opening,
        mut changed: impl FnMut(ParticleId),
    ) {
        let half_gap = 0.5 * wound.gap.min(GAP_OVER_LENGTH * (opening.before + opening.open));
        self.list(map, strips, wound, opening, half_gap);
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

    /// Collects the slit's live wound particles, where their lips belong and where they are set.
    fn list(&mut self, map: &ParticleMap, strips: &Strips, wound: &WoundSettings, opening: Opening, half_gap: f64) {
        let Opening { start, before, is_shut, .. } = opening;
        let open = before + opening.open;
        let place = |mark: &WoundMark| before + strips.stretch(mark.strip as usize).0 + mark.along;
        let profile: fn(f64) -> f64 = match (slit_marks(strips, start).any(|m| place(m) < 0.5 * wound.spacing), is_shut) {
            (true, true) => |x| 4.0 * x * (1.0 - x),
            (true, false) => |x| x * (2.0 - x),
            (false, true) => |x| 1.0 - x * x,
            (false, false) => |_| 1.0,
        };
        fit(&mut self.place_of, map.len(), NONE);
        self.marks.clear();
        for mark in slit_marks(strips, start) {
            let (particle, k) = (mark.particle, mark.strip as usize);
            let Some(&anchor) = map.anchors.get(particle.index()).filter(|a| a.is_some()) else { continue };
            if strips.as_slice()[k].slit != strips.as_slice()[start].slit {
                continue;
            }
            let x = if open > 0.0 { place(mark) / open } else { f64::INFINITY };
            let share = if x <= 1.0 { profile(x) } else { f64::from(u8::from(!is_shut)) };
            let outwards = strips.geometry(k).normal() * f64::from(mark.side);
            let lip = half_gap * share;
            self.place_of[particle.index()] = self.marks.len() as u32;
            self.marks.push(Marked { particle, anchor, outwards, lip, set: lip, off: 0.0, step: 0.0 });
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
