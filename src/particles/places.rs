//! What is where, for updates of the particle map.

use super::holders::{Holders, VertexSet};
use super::link_tests::LinkTests;
use super::lists::Lists;
use super::particle_map::{Influence, ParticleMap};
use super::point_grid::PointGrid;
use super::settings::ParticleSettings;
use super::strips::{LipSide, STROKES_ROOM, Strips};
use crate::geometry::room::rows_headroom;
use crate::geometry::{ParticleId, SlotCsr, VertexId};
use glam::{DVec3, Vec3A};

/// What is where, for updates that look around a wound. All of it holds supersets. Undo and redo leave it as it is: whatever comes
/// back was put in when it was made. Where that may not be so, they forget that they were built.
#[derive(Clone, Debug, Default)]
pub(super) struct Places {
    /// Particles by their anchor.
    pub(super) anchors: PointGrid,
    /// Vertices by particle.
    pub(super) holders: Holders,
    /// Strips near the particles.
    pub(super) links: LinkTests,
    /// Vertices that are or once were lips of each strip.
    pub(super) lips: Lists<VertexId>,
    /// True for strips that no lip lies beyond, as far as that has been looked up.
    pub(super) none_beyond: Vec<bool>,
    /// One more than the highest strip that a lip was ever noted for, and the same at the last undo or redo.
    strips: usize,
    strips_before: usize,
    /// Vertices that are or once were held from beyond a particle's radius.
    pub(super) far: VertexSet,
    /// At least the length of the longest link of a particle that a cut has given another anchor, metres.
    pub(super) longest_moved: f64,
    /// Radius of an ordinary particle, and of a wound particle, metres.
    pub(super) radii: [f64; 2],
    pub(super) is_built: bool,
    /// Built after edits that can be taken back, as in a severed piece: what was there before them is not known.
    pub(super) is_late: bool,
}

impl Places {
    /// The one pass over everything. `reach` is the longest link.
    pub(super) fn build(rest: &[DVec3], map: &ParticleMap, lips: &SlotCsr<LipSide>, settings: &ParticleSettings) -> Self {
        let positions = map.anchors.iter().map(|a| a.is_some().then(|| rest[a.index()]));
        let held = |v: VertexId| map.influences.row(v.index()).iter().map(|i| i.particle);
        let is_far = |&v: &VertexId| held(v).any(|j| settings.weight(map, rest, v, j) <= 0.0);
        let rows = map.influences.rows().min(rest.len());
        let mut places = Self {
            anchors: PointGrid::build(positions, settings.reach()),
            holders: Holders::build(map, rest),
            radii: [settings.radius, settings.wound.radius.min(settings.radius)],
            is_built: true,
            ..Self::default()
        };
        // a piece may have such from the tissue it was part of
        places.longest_moved = (0..map.len()).map(ParticleId::new).map(|j| longest_link(map, rest, j)).fold(0.0, f64::max);
        places.far.extend((0..rows).map(VertexId::new).filter(is_far));
        for v in 0..lips.rows() {
            lips.row(v).iter().for_each(|l| places.note_lip(VertexId::new(v), l.strip as usize));
        }
        places
    }

    /// Makes room for what edits will add.
    pub(super) fn make_room(&mut self, vertices: usize, particles: usize) {
        self.lips.reserve(rows_headroom(vertices));
        self.none_beyond.reserve(STROKES_ROOM);
        self.anchors.make_room();
        self.links.make_room(particles);
    }

    pub(super) fn note_lip(&mut self, v: VertexId, strip: usize) {
        if let Some(none_beyond) = self.none_beyond.get_mut(strip) {
            *none_beyond = false;
        }
        if strip >= self.strips_before || !self.lips.get(strip).contains(&v) {
            self.strips = self.strips.max(strip + 1);
            self.lips.push(strip, v);
        }
    }

    /// Vertices that some particles hold or once held, ascending, each once. `None` if that is not known, or they are more than `most`.
    pub(super) fn held_by(&self, particles: impl Iterator<Item = ParticleId>, most: usize) -> Option<Vec<VertexId>> {
        let mut held = Vec::new();
        for j in particles.take_while(|_| self.is_built) {
            self.holders.visit(j, DVec3::NEG_INFINITY, DVec3::INFINITY, |v| held.push(v));
            if held.len() > most {
                return None;
            }
        }
        held.sort_unstable();
        held.dedup();
        self.is_built.then_some(held)
    }

    /// To be called after an undo or a redo: what comes may be noted already, and strips may be other ones.
    pub(super) fn note_travel(&mut self) {
        self.is_built &= !self.is_late;
        self.strips_before = self.strips;
        self.none_beyond.clear();
        self.holders.note_travel();
        self.links.clear();
    }
}

impl Strips {
    /// Checks that what updates look up knows every influence of the map and every anchor, where they are now.
    pub(super) fn check_places(&self, map: &ParticleMap, rest: &[DVec3]) -> Result<(), String> {
        if !self.places.is_built {
            return Ok(());
        }
        for v in (0..map.influences.rows().min(rest.len())).map(VertexId::new) {
            for influence in map.influences.row(v.index()) {
                if !self.places.holders.lists(influence.particle, v, rest[v.index()]) {
                    return Err(format!("{:?} holds vertex {v:?}, and updates do not know it", influence.particle));
                }
            }
        }
        Ok(())
    }

    /// Notes that `j` has another anchor and keeps what it holds, which may lie beyond its radius now.
    pub(super) fn note_moved(&mut self, map: &ParticleMap, rest: &[DVec3], j: ParticleId) {
        let at = rest[map.anchors[j.index()].index()];
        let Places { anchors, holders, far, radii, is_built, longest_moved, .. } = &mut self.places;
        if *is_built {
            anchors.insert(j.0, at);
            *longest_moved = longest_moved.max(longest_link(map, rest, j));
            let radius = radii[usize::from(map.is_wound(j))];
            let holds = |v: VertexId| map.influences.row(v.index()).iter().any(|i| i.particle == j);
            let far_off = 0.999 * radius * radius;
            let has_far = |low: Vec3A, high: Vec3A| (high.as_dvec3() - at).max(at - low.as_dvec3()).length_squared() >= far_off;
            holders.visit_seen(j, DVec3::NEG_INFINITY, DVec3::INFINITY, has_far, |v| {
                let is_far = rest.get(v.index()).is_some_and(|p| p.distance_squared(at) >= far_off);
                if is_far && v.index() < map.influences.rows() && holds(v) {
                    far.insert(v);
                }
            });
        }
    }

    /// Notes a row of influences that was written by other means than an update; `far` unless all are within their radius.
    pub(super) fn note_held(&mut self, v: VertexId, at: DVec3, row: &[Influence], far: bool) {
        if self.places.is_built {
            self.places.holders.note_row(v, at, row, &[]);
            self.places.far.extend(far.then_some(v));
        }
    }
}

/// Length of the longest link of a particle, metres.
pub(super) fn longest_link(map: &ParticleMap, rest: &[DVec3], j: ParticleId) -> f64 {
    let at = |j: ParticleId| rest.get(map.anchors[j.index()].index()).copied();
    let lengths = map.neighbours.row(j.index()).iter().filter_map(|l| Some(at(l.particle)?.distance(at(j)?)));
    lengths.fold(0.0, f64::max)
}
