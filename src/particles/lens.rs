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
use super::unfold::{Free, Unfold};
use crate::geometry::room::fit;
use crate::geometry::{Mesh, ParticleId, VertexId};
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
/// The most beside another wound: the skin between both folds beyond that.
const MOST_IN_CROSSING: f64 = 1.5;
/// Two wounds whose lips on a strip of skin between them go against each other, as a cosine: each has half of what both would take (-0.985, 10
/// degrees off parallel), or each stands on its own lens (-0.92, 23 degrees).
const AGAINST: [f64; 2] = [-0.985, -0.92];
/// A lip that what draws it draws less alike than this, a cosine, is drawn two ways at once.
const ALIKE: f64 = 0.5;
/// Beside a wound that opens by more than this share of its particles' radius to each side skin would turn over, too.
const WIDE: f64 = 0.45;
/// Older wounds that are looked at again where a new one pushes their lips.
const MOST_CROSSED: usize = 8;

/// Scratch of [`Lens::displace_wound`], kept between updates.
#[derive(Clone, Debug, Default)]
pub(super) struct Lens {
    marks: Vec<Marked>,
    /// By particle, its place among `marks`; all [`NONE`] between uses.
    place_of: Vec<u32>,
    shares: Vec<Share>,
    /// Wounds that the new one pushes at.
    crossed: Vec<u32>,
    unfold: Unfold,
    /// Lips of a leg of the slit.
    pub(super) leg: Vec<LegLip>,
}

/// Particles that there is room for at first, of a slit and of some that it crosses ([`WoundSettings::max_particles`] each), and of those that move one of
/// its lips.
const MARKS: usize = 512;
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

/// What counts of a push that another wound gives a lip, by the cosine between that and the lip's own way.
fn share_against(cosine: f64) -> f64 {
    let [none, all] = AGAINST;
    ((cosine - none) / (all - none)).clamp(0.0, 1.0)
}

/// A wound particle of the slit.
#[derive(Clone, Copy, Debug)]
struct Marked {
    particle: ParticleId,
    anchor: VertexId,
    /// Among the wound particles of all strips.
    mark: u32,
    wound: u32,
    /// Where it is on the wound's line, metres, and whether in another skin than that.
    place: f64,
    is_elsewhere: bool,
    /// Unit vector away from the slit.
    outwards: DVec3,
    /// Half of what the wound opens at its widest, how far out the lip belongs, and how far out the particle is set, metres.
    half_gap: f64,
    lip: f64,
    set: f64,
    /// The furthest that it may be set, in half gaps.
    most: f64,
    /// How far particles of wounds that are not listed push the lip out, metres.
    pushed: f64,
    /// How far the lip is off that, and how far the particle goes for all lips that are.
    off: f64,
    step: f64,
}

impl Marked {
    /// The particle of a mark, by the mark's place among those of all strips; `None` if it has retired. What its wound is like is to follow.
    fn of(map: &ParticleMap, strips: &Strips, (i, mark): (usize, &WoundMark)) -> Option<Self> {
        Some(Self {
            particle: mark.particle,
            anchor: map.anchors.get(mark.particle.index()).copied().filter(|a| a.is_some())?,
            mark: i as u32,
            wound: strips.as_slice()[mark.strip as usize].wound,
            place: 0.0,
            is_elsewhere: false,
            outwards: strips.geometry(mark.strip as usize).normal() * f64::from(mark.side),
            half_gap: 0.0,
            lip: 0.0,
            set: 0.0,
            most: MOST[1],
            pushed: 0.0,
            off: 0.0,
            step: 0.0,
        })
    }

    /// What the lip counts for: an end that gapes is seen more than a middle that is a little narrow.
    fn weight(&self) -> f64 {
        self.half_gap / (0.25 * self.half_gap + self.lip)
    }

    /// How much of what the particle is set moves this lip outwards, if it moves the lip by all of it.
    fn share_of(&self, particle: &Self) -> f64 {
        let cosine = particle.outwards.dot(self.outwards);
        if particle.wound == self.wound { cosine } else { cosine * share_against(cosine) }
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
    /// Makes room for a usual slit in a mesh of so many vertices with so many particles.
    pub(super) fn make_room(&mut self, vertices: usize, particles: usize) {
        self.unfold.make_room(vertices);
        fit(&mut self.place_of, particles, NONE);
        self.marks.reserve(MARKS);
        self.shares.reserve(SHARES * MARKS);
        self.crossed.reserve(MOST_CROSSED);
        self.leg.reserve(2 * MOST_LIPS);
    }

    /// Sets the rest displacements of a wound: a parabola along its open metres, closed behind. It is half the gap at the middle and nothing
    /// at the ends; an end where lips do not meet is as wide as the middle would be. Once the blade has left, older wounds whose lips it
    /// pushes at stay as wide as they were. Tells the particles whose displacement changed.
    pub(super) fn displace_wound(
        &mut self,
        mesh: &Mesh,
        (map, rest): (&mut ParticleMap, &[DVec3]),
        strips: &mut Strips,
        wound: &WoundSettings,
        opening: Opening,
        mut changed: impl FnMut(ParticleId),
    ) {
        let half_gap = 0.5 * wound.gap.min(GAP_OVER_LENGTH * (opening.open[1] - opening.open[0]).max(0.0));
        self.list((map, rest), strips, wound, opening, half_gap);
        let mut may_fold = false;
        if opening.is_done && half_gap > 0.0 {
            for m in &self.marks {
                let mark = strips.wounds[m.mark as usize];
                if mark.lip != m.lip as f32 {
                    strips.wounds.set(m.mark as usize, WoundMark { lip: m.lip as f32, ..mark });
                }
            }
            self.list_crossed(map, strips, opening.wound);
            let (pace, is_pulled) = self.weigh(map);
            may_fold = is_pulled || half_gap > WIDE * wound.radius;
            for _ in 0..ROUNDS {
                if !self.round(pace) {
                    break;
                }
            }
        }
        let least = LEAST_SHARE * wound.gap;
        self.unfold.free.clear();
        self.unfold.free.extend(self.marks.iter().map(|m| {
            let share = if m.set.abs() < least { least } else { m.set };
            Free::new(m.particle, m.anchor, m.outwards * share)
        }));
        if may_fold {
            self.unfold.run((mesh, rest), map, &self.place_of, wound.gap);
        }
        for m in &self.unfold.free {
            self.place_of[m.particle.index()] = NONE;
            let u0 = m.displacement.to_array();
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
        for (i, mark) in strips.marks_of(opening.wound) {
            let Some(marked) = Marked::of(map, strips, (i, mark)) else { continue };
            let place = strips.place_of(mark).0;
            let is_elsewhere = !strips.as_slice()[mark.strip as usize].is_near_skin(rest[marked.anchor.index()], wound.spacing);
            if is_elsewhere {
                (first, last) = (first.min(place), last.max(place));
            }
            self.push(Marked { place, is_elsewhere, half_gap, ..marked });
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

    fn push(&mut self, marked: Marked) {
        self.place_of[marked.particle.index()] = self.marks.len() as u32;
        self.marks.push(marked);
    }

    /// Collects the particles of older wounds that stand open with lips that this one's particles move: across a wound that another crosses
    /// its lens pushes one lip farther than the other, towards it where the skin between both is a wedge.
    fn list_crossed(&mut self, map: &ParticleMap, strips: &Strips, wound: u32) {
        self.crossed.clear();
        for mark in strips.wounds.iter().filter(|m| m.lip > 0.0) {
            let other = strips.as_slice()[mark.strip as usize].wound;
            if other == wound || self.crossed.contains(&other) || self.crossed.len() == MOST_CROSSED {
                continue;
            }
            let Some(&anchor) = map.anchors.get(mark.particle.index()).filter(|a| a.is_some()) else { continue };
            let is_own = |p: ParticleId| self.place_of[p.index()] != NONE;
            if map.influences.row(anchor.index()).iter().any(|i| is_own(i.particle)) {
                self.crossed.push(other);
            }
        }
        for k in 0..self.crossed.len() {
            let other = self.crossed[k];
            let half_gap = f64::from(strips.marks_of(other).map(|(_, m)| m.lip).fold(0.0, f32::max));
            for (i, mark) in strips.marks_of(other) {
                let Some(marked) = Marked::of(map, strips, (i, mark)) else { continue };
                let set = marked.outwards.dot(DVec3::from_array(map.rest_displacement[mark.particle.index()]));
                self.push(Marked { half_gap, lip: f64::from(mark.lip), set, ..marked });
            }
        }
    }

    /// Collects what moves each lip. How far the iteration may go in a round, and whether a lip is drawn two ways at once.
    fn weigh(&mut self, map: &ParticleMap) -> (f64, bool) {
        self.shares.clear();
        let mut is_pulled = false;
        for i in 0..self.marks.len() {
            let lip = self.marks[i];
            let (mut pushed, mut is_crossed) = (0.0, false);
            for influence in map.influences.row(lip.anchor.index()) {
                let (k, weight) = (self.place_of[influence.particle.index()], f64::from(influence.weight));
                if let Some(m) = self.marks.get_mut(k as usize) {
                    self.shares.push(Share { lip: i as u32, particle: k, share: lip.share_of(m) * weight });
                    is_pulled |= m.outwards.dot(lip.outwards) < ALIKE;
                    if m.wound != lip.wound {
                        m.most = MOST_IN_CROSSING;
                        is_crossed = true;
                    }
                    continue;
                }
                let push = DVec3::from_array(map.rest_displacement[influence.particle.index()]);
                if let Some(way) = push.try_normalize() {
                    pushed += weight * share_against(way.dot(lip.outwards)) * push.dot(lip.outwards);
                    is_crossed = true;
                }
            }
            self.marks[i].pushed = pushed;
            if is_crossed {
                self.marks[i].most = MOST_IN_CROSSING;
                is_pulled = true;
            }
        }
        for &Share { lip, particle, share } in &self.shares {
            let weight = self.marks[lip as usize].weight();
            self.marks[particle as usize].step += share.abs() * weight;
        }
        let largest = self.marks.iter().map(|m| m.step).fold(1.0, f64::max);
        (1.0 / largest, is_pulled)
    }

    /// One round. False if no lip is off by more than [`CLOSE`].
    fn round(&mut self, pace: f64) -> bool {
        for m in &mut self.marks {
            (m.off, m.step) = (m.lip - m.pushed, 0.0);
        }
        for &Share { lip, particle, share } in &self.shares {
            self.marks[lip as usize].off -= self.marks[particle as usize].set * share;
        }
        if self.marks.iter().all(|m| m.off.abs() <= CLOSE * m.half_gap) {
            return false;
        }
        for m in &mut self.marks {
            m.off *= m.weight();
        }
        for &Share { lip, particle, share } in &self.shares {
            self.marks[particle as usize].step += share * self.marks[lip as usize].off;
        }
        for m in &mut self.marks {
            m.set = (m.set + m.step * pace).clamp(MOST[0] * m.half_gap, m.most * m.half_gap);
        }
        true
    }
}
