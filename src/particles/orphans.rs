//! Vertices that an update leaves without a particle (MATHS 3.2).

use super::map_update::{Update, is_within};
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
                    self.link_particles(0);
                    self.scratch.rows.list(&mut self.scratch.work);
                }
            }
        }
    }

    /// Of the particles within reach that edges lead to and that no strip parts from the vertex, the strongest, if there is one.
    fn nearest_connected(&mut self, v: VertexId) -> Option<ParticleId> {
        self.flood_around(v);
        let mut best: Option<(f64, ParticleId)> = None;
        for i in 0..self.scratch.near.len() {
            let j = self.scratch.near[i];
            if !self.scratch.flood.has_reached(self.map.anchors[j.index()]) {
                continue;
            }
            let weight = self.weight(v, j);
            let is_stronger = weight > 0.0 && best.is_none_or(|(most, k)| weight > most || weight == most && j < k);
            if is_stronger && self.connects(j, v) {
                best = Some((weight, j));
            }
        }
        best.map(|b| b.1)
    }

    /// Floods over edges from a vertex to those nearby.
    fn flood_around(&mut self, v: VertexId) {
        let Self { mesh, rest, settings, .. } = *self;
        let (p, reach, mut visited) = (rest[v.index()], 2.0 * settings.radius, 0);
        self.scratch.flood.run(mesh, &[v], |w| {
            visited += 1;
            visited <= ORPHAN_FLOOD && is_within(rest[w.index()], p - reach, p + reach)
        });
    }
}
