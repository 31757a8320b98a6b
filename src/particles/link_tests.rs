//! Strip tests of many links that share an end: what the end has in common with each strip is worked out once.

use super::particle_map::ParticleMap;
use super::strip_test::StripGeometry;
use super::strips::Strips;
use crate::geometry::{ParticleId, VertexId};
use glam::DVec3;

/// No outcode has all bits set.
const UNKNOWN: u16 = u16::MAX;

/// Tests against the strips near a wound. Begun once an update; then [`LinkTests::from`] sets the shared end.
#[derive(Clone, Debug, Default)]
pub(super) struct LinkTests {
    /// Strips near the wound, sorted.
    strips: Vec<u32>,
    /// Longest link, metres.
    reach: f64,
    /// Round and row of `codes` of each particle.
    rows: Vec<(u32, u32)>,
    round: u32,
    /// Outcodes of particles' anchors, a row of `strips.len()` each.
    codes: Vec<u16>,
    /// The shared end; none before the first.
    end: VertexId,
    /// Places in `strips` of those that a link from the end may meet, newest first, with the end's outcodes.
    local: Vec<(u32, u16)>,
}

impl LinkTests {
    /// Starts an update around the box `low..high`; no link is longer than `reach`.
    pub(super) fn begin(&mut self, strips: &Strips, (low, high): (DVec3, DVec3), reach: f64, particles: usize) {
        strips.near(low, high, &mut self.strips);
        self.reach = reach;
        if self.round == u32::MAX {
            self.rows.fill((0, 0));
            self.round = 0;
        }
        self.round += 1;
        if self.rows.len() < particles {
            self.rows.resize(particles, (0, 0));
        }
        self.codes.clear();
        self.end = VertexId::NONE;
    }

    /// Forgets what is known of a particle, whose anchor has changed.
    pub(super) fn moved(&mut self, j: ParticleId) {
        if let Some(row) = self.rows.get_mut(j.index()) {
            *row = (0, 0);
        }
        self.end = VertexId::NONE;
    }

    /// Sets the shared end of the links that follow.
    pub(super) fn from(&mut self, strips: &Strips, rest: &[DVec3], end: VertexId) {
        if self.end == end {
            return;
        }
        self.end = end;
        self.local.clear();
        let at = rest[end.index()];
        let lips = strips.lip_sides(end);
        for (i, &k) in self.strips.iter().enumerate().rev() {
            let geometry = strips.geometry(k as usize);
            let near = self.reach + geometry.margin;
            let is_near = at.cmpge(geometry.low - near).all() && at.cmple(geometry.high + near).all();
            // a known side holds wherever the end lies, for the strips next to its own too
            if is_near || lips.iter().any(|l| l.strip.abs_diff(k) <= 1) {
                self.local.push((i as u32, strips.outcode(k as usize, rest, end)));
            }
        }
    }

    /// Outcode of a particle's anchor to strip `k`, which must be near.
    pub(super) fn code(&mut self, strips: &Strips, rest: &[DVec3], map: &ParticleMap, k: usize, j: ParticleId) -> u16 {
        let Ok(i) = self.strips.binary_search(&(k as u32)) else { return 0 };
        let row = self.row(j);
        let known = &mut self.codes[row + i];
        if *known == UNKNOWN {
            *known = strips.outcode(k, rest, map.anchors[j.index()]);
        }
        *known
    }

    /// True if no strip lies between the shared end and a particle's anchor.
    pub(super) fn connects_particle(&mut self, strips: &Strips, rest: &[DVec3], map: &ParticleMap, j: ParticleId) -> bool {
        let anchor = map.anchors[j.index()];
        let row = self.row(j);
        for &(i, code) in &self.local {
            let k = self.strips[i as usize] as usize;
            let known = &mut self.codes[row + i as usize];
            if *known == UNKNOWN {
                *known = strips.outcode(k, rest, anchor);
            }
            if !StripGeometry::codes_part(code, *known) && strips.crosses(k, rest, self.end, anchor) {
                return false;
            }
        }
        !self.known_side_crosses(strips, rest, anchor)
    }

    /// True if no strip lies between the shared end and a vertex.
    pub(super) fn connects_vertex(&self, strips: &Strips, rest: &[DVec3], v: VertexId) -> bool {
        let is_plain = strips.lip_sides(v).is_empty();
        for &(i, code) in &self.local {
            let k = self.strips[i as usize] as usize;
            let parted = is_plain && strips.geometry(k).parts(code, rest[v.index()]);
            if !parted && strips.crosses(k, rest, self.end, v) {
                return false;
            }
        }
        is_plain || !self.known_side_crosses(strips, rest, v)
    }

    /// The other end may know its side of strips that are not near the shared end.
    fn known_side_crosses(&self, strips: &Strips, rest: &[DVec3], v: VertexId) -> bool {
        let is_local = |k: u32| self.local.iter().any(|l| self.strips[l.0 as usize] == k);
        strips.lip_sides(v).iter().any(|lip| {
            let last = (strips.len() as u32).min(lip.strip + 2);
            (lip.strip.saturating_sub(1)..last).any(|k| !is_local(k) && strips.crosses(k as usize, rest, self.end, v))
        })
    }

    fn row(&mut self, j: ParticleId) -> usize {
        if self.rows.len() <= j.index() {
            self.rows.resize(j.index() + 1, (0, 0));
        }
        let row = &mut self.rows[j.index()];
        if row.0 != self.round {
            *row = (self.round, self.codes.len() as u32);
            self.codes.resize(self.codes.len() + self.strips.len(), UNKNOWN);
        }
        row.1 as usize
    }
}
