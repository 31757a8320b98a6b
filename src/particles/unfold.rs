//! Skin that its wounds draw apart from both sides is narrower than what they draw it by, and would turn over (MATHS 3.3): the tips between wounds
//! that cross, and what lies beside a wound that opens far.
//!
//! A face keeps some of its area, seen along its normal at rest. Where it would not, the particles that move it go along the slopes of that area,
//! all at once, in steps that would bring a linear system to rest (Cimmino 1938, with momentum): as little as that takes, so that a tip is drawn
//! back and lips elsewhere stay.

use super::particle_map::ParticleMap;
use crate::geometry::room::fit;
use crate::geometry::{Mesh, ParticleId, VertexId};
use glam::DVec3;

/// Most rounds, and fewest where so much skin is moved that all rounds would place more vertices than that.
const ROUNDS: usize = 24;
const FEW_ROUNDS: usize = 6;
const MOST_PLACED: usize = 96_000;
/// Steps over those of Cimmino's method, which converges below 2, and the share of the last step that is gone again.
const PACE: f64 = 1.6;
const MOMENTUM: f64 = 0.5;
/// A particle that hardly moves what is folded goes less far than that: as if it moved this share of what the one does that moves most.
const LEAST_MOVED: f64 = 0.1;
/// Share of its area that a face keeps.
const KEPT: f64 = 0.05;
/// What a face may lack of that, in squares of the gap: too little to be seen.
const LEAST: f64 = 0.002;
/// The furthest that a particle goes in a round, in gaps, and that it is set, unless it was set farther.
const STEP: f64 = 0.1;
const MOST: f64 = 1.0;

/// A face that keeps more than this share of its area is looked at again after so many rounds.
const AT_RISK: f64 = 0.5;
const LISTED_EVERY: usize = 6;

const NONE: u32 = u32::MAX;

/// A particle whose rest displacement may change.
#[derive(Clone, Copy, Debug)]
pub(super) struct Free {
    pub(super) particle: ParticleId,
    pub(super) displacement: DVec3,
    /// Where it sits at rest.
    anchor: VertexId,
    /// How far it went in the last round.
    last: DVec3,
    /// What lacks of faces times its slopes, and what all particles together get of that for each metre that it goes.
    pull: DVec3,
    moved: f64,
}

impl Free {
    pub(super) fn new(particle: ParticleId, anchor: VertexId, displacement: DVec3) -> Self {
        Self { particle, displacement, anchor, last: DVec3::ZERO, pull: DVec3::ZERO, moved: 0.0 }
    }
}

/// A vertex that free particles move, or a corner of a face with such a one.
#[derive(Clone, Copy, Debug)]
struct Held {
    vertex: VertexId,
    /// Which of the shares are its own.
    shares: [u32; 2],
    /// Where other particles put it, and where all do.
    fixed: DVec3,
    at: DVec3,
}

/// A face, by its corners' places among what is held, with its normal at rest and twice its area.
#[derive(Clone, Copy, Debug)]
struct Skin {
    corners: [u32; 3],
    normal: DVec3,
    area: f64,
}

impl Skin {
    /// Twice its area as it is, seen along its normal at rest; negative if it is turned over.
    fn seen(&self, held: &[Held]) -> f64 {
        let [a, b, c] = self.corners.map(|c| held[c as usize].at);
        (b - a).cross(c - a).dot(self.normal)
    }
}

/// Scratch of [`Unfold::run`], kept between updates.
#[derive(Clone, Debug, Default)]
pub(super) struct Unfold {
    pub(super) free: Vec<Free>,
    held: Vec<Held>,
    /// By vertex, its place among `held`; all [`NONE`] between uses.
    place_of: Vec<u32>,
    /// Free particles that move a vertex, with what it gets of their displacement.
    shares: Vec<(u32, f64)>,
    skin: Vec<Skin>,
    /// Places among `skin`.
    at_risk: Vec<u32>,
}

/// Vertices that there is room for at first, and free particles.
const HELD: usize = 4096;
const FREE: usize = 512;

impl Unfold {
    /// Makes room for a usual slit in a mesh of so many vertices.
    pub(super) fn make_room(&mut self, vertices: usize) {
        fit(&mut self.place_of, vertices, NONE);
        self.free.reserve(FREE);
        self.held.reserve(HELD);
        self.shares.reserve(4 * HELD);
        self.skin.reserve(2 * HELD);
        self.at_risk.reserve(2 * HELD);
    }

    /// Changes the displacements of [`Self::free`] such that they turn no skin over. `free_of` has the place in that of each particle, or `u32::MAX`;
    /// `gap` is what wounds open by, metres.
    pub(super) fn run(&mut self, (mesh, rest): (&Mesh, &[DVec3]), map: &ParticleMap, free_of: &[u32], gap: f64) {
        self.collect((mesh, rest), map, free_of);
        let mut until_listed = 0;
        for _ in 0..(MOST_PLACED / self.held.len().max(1)).clamp(FEW_ROUNDS, ROUNDS) {
            self.place();
            let is_listed = until_listed == 0;
            if is_listed {
                self.list_at_risk();
                until_listed = LISTED_EVERY;
            }
            until_listed -= 1;
            if !self.round(gap) {
                if is_listed {
                    break;
                }
                until_listed = 0;
            }
        }
        for h in &self.held {
            self.place_of[h.vertex.index()] = NONE;
        }
    }

    /// Lists all skin that free particles move.
    fn collect(&mut self, (mesh, rest): (&Mesh, &[DVec3]), map: &ParticleMap, free_of: &[u32]) {
        fit(&mut self.place_of, mesh.vertex_slots(), NONE);
        self.held.clear();
        self.shares.clear();
        self.skin.clear();
        for i in 0..self.free.len() {
            self.hold(self.free[i].anchor, rest, (map, free_of));
        }
        let mut next = 0;
        while let Some(&Held { vertex, shares: [first, end], .. }) = self.held.get(next) {
            next += 1;
            if first == end {
                continue;
            }
            for h in mesh.fan(vertex) {
                let corners = mesh.face(h.face()).map(|v| self.hold(v, rest, (map, free_of)));
                let is_listed = |c: u32| {
                    let [first, end] = self.held[c as usize].shares;
                    (c as usize) < next - 1 && first < end
                };
                if mesh.is_interior(h.face()) || corners.into_iter().any(is_listed) {
                    continue;
                }
                let [a, b, c] = mesh.face(h.face()).map(|v| rest[v.index()]);
                if let (normal, area @ f64::MIN_POSITIVE..) = (b - a).cross(c - a).normalize_and_length() {
                    self.skin.push(Skin { corners, normal, area });
                }
            }
        }
    }

    /// The place of a vertex among what is held.
    fn hold(&mut self, vertex: VertexId, rest: &[DVec3], (map, free_of): (&ParticleMap, &[u32])) -> u32 {
        let place = &mut self.place_of[vertex.index()];
        if *place == NONE {
            *place = self.held.len() as u32;
            let first = self.shares.len() as u32;
            let mut fixed = rest[vertex.index()];
            for influence in map.influences.row(vertex.index()) {
                let (p, weight) = (influence.particle.index(), f64::from(influence.weight));
                match free_of.get(p) {
                    Some(&k) if k != NONE => self.shares.push((k, weight)),
                    _ => fixed += weight * DVec3::from_array(map.rest_displacement[p]),
                }
            }
            self.held.push(Held { vertex, shares: [first, self.shares.len() as u32], fixed, at: fixed });
        }
        *place
    }

    /// Finds where everything held is.
    fn place(&mut self) {
        for h in &mut self.held {
            let [first, end] = h.shares.map(|s| s as usize);
            let moved = self.shares[first..end].iter().map(|&(k, weight)| weight * self.free[k as usize].displacement);
            h.at = h.fixed + moved.sum::<DVec3>();
        }
    }

    /// Lists the faces that a few rounds may turn over.
    fn list_at_risk(&mut self) {
        let Self { skin, held, at_risk, .. } = self;
        at_risk.clear();
        at_risk.extend((0..skin.len() as u32).filter(|&i| skin[i as usize].seen(held) < AT_RISK * skin[i as usize].area));
    }

    /// One round for what is at risk. False if nothing of it lacks more than [`LEAST`].
    fn round(&mut self, gap: f64) -> bool {
        let (held, shares) = (&self.held, &self.shares);
        for skin @ Skin { corners, normal, area } in self.at_risk.iter().map(|&i| &self.skin[i as usize]) {
            let lacks = KEPT * area - skin.seen(held);
            if lacks <= LEAST * gap * gap {
                continue;
            }
            let [a, b, c] = corners.map(|c| held[c as usize].at);
            let slopes = [c - b, a - c, b - a].map(|edge| normal.cross(edge));
            let of_corners = || {
                let slopes = corners.iter().zip(slopes);
                slopes.flat_map(|(&c, slope)| {
                    let [first, end] = held[c as usize].shares.map(|s| s as usize);
                    shares[first..end].iter().map(move |&(k, weight)| (k as usize, weight * slope))
                })
            };
            let all: f64 = of_corners().map(|(_, slope)| slope.length()).sum();
            for (k, slope) in of_corners() {
                self.free[k].pull += lacks * slope;
                self.free[k].moved += slope.length() * all;
            }
        }
        let most = self.free.iter().map(|f| f.moved).fold(0.0, f64::max);
        for f in &mut self.free {
            if f.moved > 0.0 {
                let step = (PACE / f.moved.max(LEAST_MOVED * most) * f.pull + MOMENTUM * f.last).clamp_length_max(STEP * gap);
                let to = (f.displacement + step).clamp_length_max(f.displacement.length().max(MOST * gap));
                (f.last, f.displacement) = (to - f.displacement, to);
            }
            (f.pull, f.moved) = (DVec3::ZERO, 0.0);
        }
        most > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::super::settings::ParticleSettings;
    use super::super::test_models::grid;
    use super::super::{ParticleMap, sample};
    use super::*;

    /// A sheet whose particles beside its middle are drawn towards that from both sides, by `share` of their way, and their old displacements.
    fn pressed_sheet(share: f64) -> (Mesh, Vec<DVec3>, ParticleMap, Unfold, Vec<u32>) {
        let (mesh, rest) = grid(24, 0.3, 5);
        let settings = ParticleSettings::with_spacing(0.08);
        let (map, _) = ParticleMap::build(&mesh, &rest, &sample(&mesh, &rest, settings.spacing, 3), &settings);
        let mut unfold = Unfold::default();
        let mut free_of = vec![NONE; map.len()];
        for (p, &anchor) in map.anchors.iter().enumerate() {
            let off = rest[anchor.index()].x - 0.5;
            if off.abs() < 0.1 {
                free_of[p] = unfold.free.len() as u32;
                unfold.free.push(Free::new(ParticleId::new(p), anchor, DVec3::NEG_X * off * share));
            }
        }
        (mesh, rest, map, unfold, free_of)
    }

    /// What faces lack of what they keep, and are turned over by, square metres.
    fn lacking(unfold: &mut Unfold, (mesh, rest): (&Mesh, &[DVec3]), map: &ParticleMap, free_of: &[u32]) -> f64 {
        unfold.collect((mesh, rest), map, free_of);
        unfold.place();
        let all = unfold.skin.iter().map(|s| (KEPT * s.area - s.seen(&unfold.held)).max(0.0)).sum();
        unfold.held.iter().for_each(|h| unfold.place_of[h.vertex.index()] = NONE);
        all
    }

    #[test]
    fn skin_that_is_pressed_together_is_not_turned_over() {
        let (mesh, rest, map, mut unfold, free_of) = pressed_sheet(1.6);
        let before = lacking(&mut unfold, (&mesh, &rest), &map, &free_of);
        assert!(before > 0.02, "it would be: {before}");
        unfold.run((&mesh, &rest), &map, &free_of, 0.1);
        let after = lacking(&mut unfold, (&mesh, &rest), &map, &free_of);
        assert!(after < 0.03 * before, "{before} square metres, and still {after}");
        assert!(unfold.place_of.iter().all(|&p| p == NONE));
        let kept: f64 = unfold.free.iter().map(|f| f.displacement.length()).sum();
        assert!(kept > 0.3 * 0.05 * unfold.free.len() as f64 * 1.6, "it is pressed together all the same: {kept}");
    }

    #[test]
    fn what_turns_nothing_over_stays_to_the_bit() {
        let (mesh, rest, map, mut unfold, free_of) = pressed_sheet(0.5);
        let before: Vec<DVec3> = unfold.free.iter().map(|f| f.displacement).collect();
        unfold.run((&mesh, &rest), &map, &free_of, 0.1);
        assert!(unfold.free.iter().map(|f| f.displacement).eq(before));
    }

    #[test]
    fn faces_without_area_and_wild_displacements_end_finite() {
        let (mesh, mut rest, map, mut unfold, free_of) = pressed_sheet(1.6);
        for (v, p) in rest.iter_mut().enumerate().filter(|(v, _)| v % 3 == 0) {
            *p = if v % 2 == 0 { DVec3::ZERO } else { *p * 1e-12 };
        }
        for (k, free) in unfold.free.iter_mut().enumerate() {
            free.displacement *= if k % 2 == 0 { 1e6 } else { -1e3 };
        }
        unfold.run((&mesh, &rest), &map, &free_of, 0.1);
        assert!(unfold.free.iter().all(|f| f.displacement.is_finite()));
    }
}
