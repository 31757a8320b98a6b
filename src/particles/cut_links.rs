//! The links that a new strip cuts (MATHS 3.2).
//!
//! Which influences cross it? A particle throws the strip's shadow on what lies behind it, and only the vertices in there are
//! looked at. Where a known side stands in for geometry there is no shadow, and all that such an end links to is tested.

use super::map_update::{Update, UpdateScratch};
use super::sight::Sight;
use super::strip_test::StripGeometry;
use crate::geometry::room::fit;
use crate::geometry::{ParticleId, VertexId};
use glam::DVec3;

/// A bit beside those of an outcode: the particle's anchor knows its side of the strip.
const KNOWS_SIDE: u16 = 1 << 15;

/// Outcodes of particles to one strip, in an array that is clean between uses.
#[derive(Clone, Debug, Default)]
pub(super) struct Codes {
    codes: Vec<u16>,
    set: Vec<ParticleId>,
}

impl Codes {
    /// Makes room for so many particles.
    pub(super) fn make_room(&mut self, particles: usize) {
        self.codes.reserve(particles);
        self.set.reserve(particles);
    }

    /// All bits set: parted from everything.
    fn begin(&mut self, particles: usize) {
        for j in self.set.drain(..) {
            self.codes[j.index()] = u16::MAX;
        }
        fit(&mut self.codes, particles, u16::MAX);
    }

    fn set(&mut self, j: ParticleId, code: u16) {
        self.codes[j.index()] = code;
        self.set.push(j);
    }

    fn of(&self, j: ParticleId) -> u16 {
        self.codes[j.index()]
    }

    /// 0 for a particle that was not looked at.
    fn known(&self, j: ParticleId) -> u16 {
        if self.is_looked_at(j) { self.of(j) } else { 0 }
    }

    fn is_looked_at(&self, j: ParticleId) -> bool {
        self.of(j) != u16::MAX
    }

    /// True if the link between a particle with this code and another does not cross the strip. Two that know their sides are parted by
    /// those, past its ends as well.
    #[inline]
    fn part(&self, code: u16, j: ParticleId) -> bool {
        let other = self.codes[j.index()];
        if code & other & KNOWS_SIDE != 0 {
            StripGeometry::planes_part(code, other)
        } else {
            StripGeometry::codes_part(code, other)
        }
    }
}

impl Update<'_, '_> {
    /// The strips to test links against, as far as they exist.
    pub(super) fn tested_strips(&self) -> impl Iterator<Item = usize> + use<> {
        let last = self.strips.len();
        let new = self.edit.new_strips.start.min(last)..self.edit.new_strips.end.min(last);
        self.edit.goes_on_from.filter(|&k| k < new.start).into_iter().chain(new)
    }

    /// Influences of old vertices and neighbour links that cross a new strip.
    pub(super) fn cut_links(&mut self) {
        for k in self.tested_strips() {
            self.cut_behind_strip(k);
            self.cut_unshadowed(k);
            self.cut_neighbours(k);
            self.cut_by_new_sides(k);
            self.cut_links_of_lips_beyond(k);
        }
    }

    /// Links of lips that lie beyond a strip of their own, and are tested from their mirror images: those of strips in line before `k` across
    /// that, and those of lips of `k` across the strips before.
    fn cut_links_of_lips_beyond(&mut self, k: usize) {
        let reach = self.reach();
        let mut next = self.strips.last_in_line(k, k, reach);
        while let Some(m) = next {
            let lips = if self.strips.may_have_lips_beyond(self.rest, m) { self.strips.lips_of(m).len() } else { 0 };
            for i in 0..lips {
                let v = self.strips.lips_of(m)[i];
                if !self.lives(v) || self.strips.knows_side(k, v) {
                    continue;
                }
                if let Some(image) = self.strips.image(k, self.rest, v) {
                    self.cut_all_of(v, k, self.strips.geometry(k).outcode(image));
                }
            }
            next = self.strips.last_in_line(m, k, reach);
        }
        for lip in self.edit.lips.iter().filter(|l| l.strip == k) {
            let v = lip.vertex;
            // a vertex that is new has no row yet
            let is_old = self.lives(v) && !self.map.influences.row(v.index()).is_empty();
            if !is_old || !self.strips.is_beyond_own(self.rest, v) {
                continue;
            }
            let mut next = self.strips.last_in_line(k, k, reach);
            while let Some(m) = next {
                self.cut_all_of(v, m, 0);
                next = self.strips.last_in_line(m, k, reach);
            }
        }
    }

    fn lives(&self, v: VertexId) -> bool {
        v.index() < self.map.influences.rows() && self.mesh.vertex_is_live(v)
    }

    /// All links of a vertex, and of particles that are anchored to it, that cross strip `k`. `code` is the vertex's outcode to the strip
    /// whose outcodes of particles are kept; 0 tests all.
    fn cut_all_of(&mut self, v: VertexId, k: usize, code: u16) {
        let UpdateScratch { rows, codes, .. } = &mut *self.scratch;
        let mut is_anchor = false;
        for influence in self.map.influences.row(v.index()) {
            is_anchor |= self.map.anchors[influence.particle.index()] == v;
            if StripGeometry::planes_part(code, codes.known(influence.particle)) {
                continue;
            }
            if self.strips.crosses(k, self.rest, self.map.anchors[influence.particle.index()], v) {
                self.report.influences_removed += usize::from(rows.open(v, self.map).part(influence.particle));
            }
        }
        // particles hold what they are anchored to; a wound particle may stand where another does
        let near = if is_anchor { self.scratch.near.len() } else { 0 };
        for i in 0..near {
            let j = self.scratch.near[i];
            if self.map.anchors[j.index()] == v {
                self.cut_all_that_cross(k, j);
            }
        }
    }

    /// Links across the strip before strip `k`, of old vertices that know their side of that one since they are lips of `k`: a blade that
    /// goes back through its own slit makes such.
    fn cut_by_new_sides(&mut self, k: usize) {
        let Some(before) = self.strips.last_of(k) else { return };
        for lip in self.edit.lips.iter().filter(|l| l.strip == k) {
            let v = lip.vertex;
            if self.lives(v) && self.strips.knows_side_by(before, k, v) {
                self.cut_all_of(v, before, 0);
            }
        }
    }

    /// All links of a particle that cross strip `k`, wherever they lead.
    fn cut_all_that_cross(&mut self, k: usize, j: ParticleId) {
        let anchor = self.map.anchors[j.index()];
        let crosses = |w: VertexId| self.strips.crosses(k, self.rest, w, anchor);
        let UpdateScratch { rows, work, lost, .. } = &mut *self.scratch;
        work.clear();
        self.strips.places.holders.visit(j, DVec3::NEG_INFINITY, DVec3::INFINITY, |w| work.push(w));
        for &w in work.iter().filter(|w| w.index() < self.rest.len() && self.mesh.vertex_is_live(**w)) {
            if rows.holds(w, j, self.map) && crosses(w) {
                self.report.influences_removed += usize::from(rows.open(w, self.map).part(j));
            }
        }
        lost.clear();
        lost.extend(self.map.neighbours.row(j.index()).iter().map(|l| l.particle));
        lost.retain(|other| crosses(self.map.anchors[other.index()]));
        self.report.links_removed += lost.len();
        for i in 0..self.scratch.lost.len() {
            let other = self.scratch.lost[i];
            self.remove_link(j, other);
            self.remove_link(other, j);
        }
    }

    /// Influences of the particles near strip `k` on what is behind it; their outcodes are kept for their neighbour links.
    fn cut_behind_strip(&mut self, k: usize) {
        let reach = self.reach();
        let Self { mesh, rest, settings, .. } = *self;
        let (map, strips, report) = (&*self.map, &*self.strips, &mut self.report);
        let UpdateScratch { rows, codes, near, zone, .. } = &mut *self.scratch;
        let geometry = strips.geometry(k);
        codes.begin(map.len());
        let (low, high) = *zone;
        for &j in near.iter() {
            let anchor = map.anchors[j.index()];
            let at = rest[anchor.index()];
            if at.distance_squared(at.clamp(low, high)) > reach * reach {
                continue;
            }
            let radius = settings.radius_of(map, j);
            let own = strips.code_of(k, rest, anchor);
            codes.set(j, if strips.knows_side(k, anchor) { own | KNOWS_SIDE } else { own });
            let bounds = if own == 0 { Some((at - radius, at + radius)) } else { geometry.shadow(at, radius) };
            let Some((low, high)) = bounds else { continue };
            let sight = if own == 0 { Sight::everywhere(at) } else { geometry.sight(at, radius) };
            let is_seen = |low, high| sight.may_meet_box(low, high);
            strips.places.holders.visit_seen(j, low, high, is_seen, |v| {
                report.vertices_visited += 1;
                let Some(&p) = rest.get(v.index()) else { return };
                if !sight.may_meet(p) || p.cmplt(low).any() || p.cmpgt(high).any() || geometry.parts(own, p) {
                    return;
                }
                if v.index() < map.influences.rows()
                    && map.influences.row(v.index()).iter().any(|i| i.particle == j)
                    && mesh.vertex_is_live(v)
                    && strips.crosses(k, rest, v, anchor)
                {
                    report.influences_removed += usize::from(rows.open(v, map).part(j));
                }
            });
        }
    }

    /// Influences of vertices that know their side of strip `k`, and those beyond the radius of their particle.
    fn cut_unshadowed(&mut self, k: usize) {
        let Self { mesh, rest, .. } = *self;
        let (map, strips, report) = (&*self.map, &*self.strips, &mut self.report);
        let UpdateScratch { rows, codes, .. } = &mut *self.scratch;
        let lips = strips.lips_near(k).filter(|&&v| v.index() < rest.len() && strips.knows_side(k, v));
        for &v in lips.chain(strips.places.far.iter()) {
            if v.index() >= map.influences.rows() || !mesh.vertex_is_live(v) {
                continue;
            }
            // a side that geometry tells too is good for a first look
            let code = strips.code_of(k, rest, v);
            for influence in map.influences.row(v.index()) {
                let j = influence.particle;
                if StripGeometry::planes_part(code, codes.known(j)) {
                    continue;
                }
                if strips.crosses(k, rest, v, map.anchors[j.index()]) {
                    report.influences_removed += usize::from(rows.open(v, map).part(j));
                }
            }
        }
    }

    /// Neighbour links that cross strip `k`.
    fn cut_neighbours(&mut self, k: usize) {
        for i in 0..self.scratch.near.len() {
            let j = self.scratch.near[i];
            let anchor = self.map.anchors[j.index()];
            let row = self.map.neighbours.row(j.index());
            let UpdateScratch { codes, links, lost, .. } = &mut *self.scratch;
            let own = codes.of(j);
            // A link is in two rows, and one that crosses has an end that is not behind the strip: the first such end that is looked
            // at says whether it is cut.
            let says = |j: ParticleId| codes.is_looked_at(j) && !StripGeometry::is_on_side(codes.of(j), -1);
            if !says(j) {
                continue;
            }
            let is_done = |other: ParticleId| other < j && says(other);
            if row.iter().all(|link| is_done(link.particle) || codes.part(own, link.particle)) {
                continue;
            }
            links.clear();
            links.extend(row.iter().filter(|link| {
                let other = self.map.anchors[link.particle.index()];
                codes.part(own, link.particle) || !self.strips.crosses(k, self.rest, anchor, other)
            }));
            if links.len() == row.len() {
                continue;
            }
            // Both rows lose the link now: a lip of the strip before may be known to lie across and yet be out of reach.
            lost.clear();
            lost.extend(row.iter().filter(|link| !links.contains(link)).map(|link| link.particle));
            self.map.neighbours.set_row(j.index(), links);
            self.report.links_removed += lost.len();
            self.report.relinked.push(j);
            for i in 0..self.scratch.lost.len() {
                self.remove_link(self.scratch.lost[i], j);
            }
        }
    }
}
