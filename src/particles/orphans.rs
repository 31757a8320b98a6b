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

    /// Of the particles within reach that no strip parts from the vertex, the strongest that edges lead to, else none.
    fn nearest_connected(&mut self, v: VertexId) -> Option<ParticleId> {
        let mut within = std::mem::take(&mut self.scratch.within);
        within.clear();
        let near = self.scratch.near.iter();
        within.extend(near.map(|&j| (self.weight(v, j), j)).filter(|(weight, _)| *weight > 0.0));
        // often there is none at all, and mostly edges lead to the strongest: so nothing is put in order yet
        let mut first: Option<(f64, ParticleId)> = None;
        for &(weight, j) in &within {
            let is_stronger = first.is_none_or(|(most, k)| weight > most || weight == most && j < k);
            if is_stronger && self.connects(j, v) {
                first = Some((weight, j));
            }
        }
        let mut found = first.map(|f| f.1);
        if let Some(first) = found
            && !self.flood_to(v, self.map.anchors[first.index()])
        {
            within.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            found = within.iter().map(|w| w.1).find(|&j| self.has_reached(j) && self.connects(j, v));
        }
        self.scratch.within = within;
        found
    }

    /// True if edges lead from one vertex to another through the vertices nearby; if none do, the flood has reached all of those that
    /// it may.
    fn flood_to(&mut self, v: VertexId, to: VertexId) -> bool {
        let Self { mesh, rest, settings, .. } = *self;
        let (p, reach) = (rest[v.index()], 2.0 * settings.radius);
        let (mut is_found, mut visited) = (to == v, 0);
        self.scratch.flood.run(mesh, &[v], |w| {
            let is_reached = !is_found && visited < ORPHAN_FLOOD && is_within(rest[w.index()], p - reach, p + reach);
            is_found |= w == to;
            visited += 1;
            is_reached
        });
        is_found
    }

    /// True if the last flood has reached a particle's anchor.
    fn has_reached(&self, j: ParticleId) -> bool {
        self.scratch.flood.has_reached(self.map.anchors[j.index()])
    }
}
