//! Particles whose anchor was clipped away: each takes another vertex, or retires. And those whose anchor has become a lip.

use super::map_edit::LipVertex;
use super::map_update::{EXTRA_INFLUENCES, Update, UpdateScratch};
use crate::geometry::{ParticleId, VertexId};
use glam::DVec3;

/// Links of a particle to vertices next to each other that are tested together.
const TOGETHER: usize = 8;

impl Update<'_, '_> {
    /// Particles whose anchor was clipped take the nearest vertex that they still hold, if it is near, on their side of
    /// every strip and no anchor yet; else they retire. Returns how many have moved: what holds a vertex still leaves nothing to regain.
    pub(super) fn move_clipped_anchors(&mut self) -> usize {
        let clipped = |j: &ParticleId| !self.mesh.vertex_is_live(self.map.anchors[j.index()]);
        let mut lost = std::mem::take(&mut self.scratch.lost);
        lost.clear();
        lost.extend(self.scratch.near.iter().filter(|j| clipped(j)));
        let mut holds = std::mem::take(&mut self.scratch.work);
        for &j in &lost {
            let old = self.map.anchors[j.index()];
            let mut best = (self.settings.spacing, VertexId::NONE);
            holds.clear();
            let s = &*self.scratch;
            let is_held = |v: VertexId| v.index() < self.map.influences.rows() && s.rows.holds(v, j, self.map);
            let everywhere = (DVec3::NEG_INFINITY, DVec3::INFINITY);
            self.strips.places.holders.visit(j, everywhere.0, everywhere.1, |v| holds.push(v));
            holds.extend((0..s.rows.count()).map(|i| s.rows.vertex(i)));
            holds.retain(|&v| is_held(v) && self.mesh.vertex_is_live(v));
            holds.sort_unstable();
            holds.dedup();
            for &v in &holds {
                let distance = self.rest[v.index()].distance(self.rest[old.index()]);
                if (distance, v) < best && !self.is_anchor(v) && self.strips.connects_vertices(self.rest, old, v) {
                    best = (distance, v);
                }
            }
            for &v in &holds {
                self.scratch.rows.open(v, self.map).remove(j);
            }
            self.unlink(j);
            self.map.anchors.set(j.index(), best.1);
            self.scratch.reaches.forget(j);
            if best.1.is_some() {
                self.strips.places.anchors.insert(j.0, self.rest[best.1.index()]);
                self.scratch.reaches.note(self.settings, self.map, self.rest, j);
                self.hold_again(j, &holds);
                self.scratch.unlinked.push(j);
                self.report.reanchored.push(j);
            } else {
                self.map.rest_displacement.set(j.index(), [0.0; 3]);
                self.report.retired.push(j);
            }
            self.report.particles_changed.push(j);
        }
        (self.scratch.lost, self.scratch.work) = (lost, holds);
        let map = &*self.map;
        self.scratch.near.retain(|j| map.anchors[j.index()].is_some());
        self.scratch.unlinked.len()
    }

    /// A re-anchored particle holds again what it held, as far as it may from its new place: what it held is covered as before, and
    /// around the new anchor others hold what it did not.
    fn hold_again(&mut self, j: ParticleId, held: &[VertexId]) {
        let (map, strips, rest, settings) = (&*self.map, &*self.strips, self.rest, self.settings);
        let UpdateScratch { rows, reaches, tests, in_reach, .. } = &mut *self.scratch;
        in_reach.clear();
        in_reach.extend(held.iter().filter(|&&v| reaches.weight(settings, map, rest, v, j) > 0.0));
        // what stands side by side in the list mostly lies together
        for near in in_reach.chunks(TOGETHER) {
            tests.each_near((strips, rest, map, settings), j, near, |v, parted_by| {
                if parted_by.is_none() {
                    rows.open(v, map).add(j);
                }
            });
        }
    }

    /// A particle whose anchor was there before the slit and is a lip only now was no lip when the strips before were cut: what of their lips
    /// on its side it lost then, where the slit bends, it holds again.
    pub(super) fn hold_lips_before(&mut self) {
        let (mesh, edit) = (self.mesh, self.edit);
        let first_new = edit.new_vertices.first().map_or(VertexId::NONE, |n| n.vertex);
        let is_late = |l: &&LipVertex| l.vertex < first_new && mesh.vertex_is_live(l.vertex);
        for lip in edit.lips.iter().filter(is_late) {
            if self.strips.lip_sides(lip.vertex).len() != 1 {
                continue;
            }
            for i in 0..self.scratch.near.len() {
                let j = self.scratch.near[i];
                if self.map.anchors[j.index()] != lip.vertex {
                    continue;
                }
                self.hold_lips_behind(j, lip);
                self.find_neighbours(j, lip.vertex);
            }
        }
    }

    /// What a particle anchored to a lip holds again of the lips of the strips before.
    fn hold_lips_behind(&mut self, j: ParticleId, lip: &LipVertex) {
        let most = self.settings.max_influences + EXTRA_INFLUENCES;
        let mut next = self.strips.last_of(lip.strip);
        while let Some(k) = next {
            let mut is_near = false;
            for at in 0..self.strips.lips_of(k).len() {
                let v = self.strips.lips_of(k)[at];
                if v.index() >= self.rest.len() || !self.mesh.vertex_is_live(v) || self.weight(v, j) <= 0.0 {
                    continue;
                }
                is_near = true;
                if self.strips.are_of_one_lip(k, [v, lip.vertex]) && self.connects(j, v) {
                    let row = self.scratch.rows.open(v, self.map);
                    if row.len() < most {
                        row.add(j);
                    }
                }
            }
            next = self.strips.last_of(k).filter(|_| is_near);
        }
    }
}
