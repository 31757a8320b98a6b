//! Vertices that an update leaves without a particle (MATHS 3.2).

use super::map_update::{Update, UpdateScratch, is_within};
use crate::geometry::{ParticleId, VertexId};
use glam::DVec3;

/// Vertices that the way from an orphan to a particle may pass: among the shreds of many slits each orphan would look at all others.
const ORPHAN_FLOOD: usize = 2048;

impl Update<'_, '_> {
    /// Vertices left without a particle get the nearest connected one that no strip parts from them; where there is none
    /// within reach, a new particle is anchored to the vertex itself.
    pub(super) fn adopt_orphans(&mut self) {
        self.scratch.rows.list(&mut self.scratch.work);
        let mut next = 0;
        while next < self.scratch.work.len() {
            let v = self.scratch.work[next];
            next += 1;
            if !self.mesh.vertex_is_live(v) || self.scratch.rows.open(v, self.map).len() > 0 {
                continue;
            }
            match self.nearest_connected(v) {
                Some(j) => self.scratch.rows.open(v, self.map).add(j),
                None => {
                    self.add_particle(v, DVec3::ZERO);
                    self.link_orphan();
                    self.scratch.rows.list(&mut self.scratch.work);
                }
            }
        }
    }

    fn nearest_connected(&mut self, v: VertexId) -> Option<ParticleId> {
        // those that no strip parts from the orphan, strongest first; often there is none
        let mut seen = std::mem::take(&mut self.scratch.seen);
        seen.clear();
        for i in 0..self.scratch.near.len() {
            let j = self.scratch.near[i];
            let weight = self.weight(v, j);
            if weight > 0.0 && self.connects(j, v) {
                seen.push((weight, j));
            }
        }
        seen.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let Self { mesh, rest, map, settings, .. } = self;
        let anchor = |j: ParticleId| map.anchors[j.index()];
        let flood = &mut self.scratch.flood;
        let best = seen.first().and_then(|&(_, first)| {
            let (p, reach) = (rest[v.index()], 2.0 * settings.radius);
            let (mut is_found, mut visited) = (anchor(first) == v, 0);
            flood.run(mesh, &[v], |w| {
                let is_reached = !is_found && visited < ORPHAN_FLOOD && is_within(rest[w.index()], p - reach, p + reach);
                is_found |= w == anchor(first);
                visited += 1;
                is_reached
            });
            let found = seen.iter().map(|s| s.1).find(|&j| flood.has_reached(anchor(j)));
            if is_found { Some(first) } else { found }
        });
        self.scratch.seen = seen;
        best
    }

    /// [`Update::link_particles`] for a particle that holds what no other reaches, often a shred between slits: its flood does not
    /// go on beyond a strip. What lies around a corner has particles of its own.
    fn link_orphan(&mut self) {
        let Some(j) = self.scratch.unlinked.pop() else { return };
        let Self { mesh, rest, map, strips, settings, .. } = self;
        let anchor = map.anchors[j.index()];
        let (centre, radius) = (rest[anchor.index()], settings.radius_of(map, j));
        let UpdateScratch { flood, tests, .. } = &mut *self.scratch;
        flood.run(mesh, &[anchor], |v| {
            rest[v.index()].distance_squared(centre) <= radius * radius && tests.connects(strips, rest, map, settings, (j, v))
        });
        for i in 0..self.scratch.flood.reached.len() {
            let v = self.scratch.flood.reached[i];
            if self.weight(v, j) > 0.0 {
                self.scratch.rows.open(v, self.map).add(j);
            }
        }
        self.find_neighbours(j, anchor);
    }
}
