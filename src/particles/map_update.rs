//! The Particle Update Algorithm: mending the particle map after a wound, near the wound only (MATHS 3.2, 3.3).
//!
//! Links that were there are kept unless they cross a new strip; links that are new are tested against every strip.
//! Stages: lips, zone, links cut, new vertices, clipped anchors, what those hold, regained links, wound particles, neighbours, orphans,
//! write. Rows are worked on in scratch and written once, and only where they differ.

use super::build::{link_weight, normalise};
use super::cut_links::Codes;
use super::flood::Flood;
use super::lens::Lens;
use super::link_tests::{AskedFirst, LinkTests};
use super::links_wanted::{LinksWanted, ParticleBits};
use super::map_edit::{LipVertex, MapEdit};
use super::map_report::MapUpdateReport;
use super::particle_map::{Influence, Link, ParticleMap};
use super::reaches::Reaches;
use super::settings::ParticleSettings;
use super::strips::{LipSide, Strips};
use super::work_rows::WorkRows;
use super::wound;
use crate::geometry::room::fit;
use crate::geometry::{Mesh, ParticleId, VertexId};
use glam::DVec3;
use std::ops::Range;

/// Influences a row may hold beyond [`ParticleSettings::max_influences`] after updates: room for wound particles, so that
/// they push out no link that was there.
pub const EXTRA_INFLUENCES: usize = 16;

/// Scratch of [`update_after_edit`], kept between updates.
#[derive(Clone, Debug, Default)]
pub struct UpdateScratch {
    pub(super) flood: Flood,
    pub(super) rows: WorkRows,
    /// Bounds of the wound: a link that crosses a new strip has both ends within its length of them.
    pub(super) zone: (DVec3, DVec3),
    /// Live and clipped particles near the wound, sorted.
    pub(super) near: Vec<ParticleId>,
    /// To put lists of particles in order.
    bits: ParticleBits,
    /// The tissue's, for the time of an update.
    pub(super) tests: LinkTests,
    pub(super) asked: AskedFirst,
    pub(super) codes: Codes,
    pub(super) reaches: Reaches,
    pub(super) work: Vec<VertexId>,
    weighted: Vec<(f64, ParticleId)>,
    pub(super) links: Vec<Link>,
    row_of_links: Vec<Link>,
    /// The last visit of [`Update::regain`] that looked at each particle, and the number of visits.
    tried: Vec<u32>,
    visits: u32,
    untried: Vec<ParticleId>,
    /// Vertices around one.
    ring: Vec<VertexId>,
    /// Particles whose links are to be found: new and re-anchored ones.
    pub(super) unlinked: Vec<ParticleId>,
    /// Rows that the update rewrote, as they were: vertex and range of `old_entries`.
    old_rows: Vec<(VertexId, Range<usize>)>,
    old_entries: Vec<Influence>,
    /// Sides that all parents of a new vertex are on.
    common: Vec<LipSide>,
    candidates: Vec<ParticleId>,
    /// Links that new vertices may have, and those of one particle among them that are short enough.
    wanted: LinksWanted,
    pub(super) in_reach: Vec<VertexId>,
    row: Vec<Influence>,
    pub(super) lost: Vec<ParticleId>,
    /// Lips of the strip that a slit ends with.
    pub(super) lips: Vec<LipVertex>,
    pub(super) lens: Lens,
    /// A report that nobody needs any more.
    report: MapUpdateReport,
}

#[path = "update_room.rs"]
mod update_room;

impl UpdateScratch {
    /// The number of the next visit; never one that `tried` holds.
    fn visit(&mut self) -> u32 {
        if self.visits == u32::MAX {
            self.tried.fill(0);
            self.visits = 0;
        }
        self.visits += 1;
        self.visits
    }

    /// Takes a report back, for the room of its lists.
    pub fn reuse(&mut self, report: MapUpdateReport) {
        self.report = report;
    }

    /// The influences that the last update replaced: each vertex of [`MapUpdateReport::vertices_changed`] once, with its row
    /// as it was.
    pub fn rows_before(&self) -> impl Iterator<Item = (VertexId, &[Influence])> + '_ {
        self.old_rows.iter().map(|(v, range)| (*v, &self.old_entries[range.clone()]))
    }
}

/// Mends `map` and `strips` after an edit of `mesh`. `rest` has a position for every vertex slot, removed ones included.
/// `settings` are those the map was built with, or near.
pub fn update_after_edit(
    mesh: &Mesh,
    rest: &[DVec3],
    map: &mut ParticleMap,
    strips: &mut Strips,
    edit: &MapEdit<'_>,
    settings: &ParticleSettings,
    scratch: &mut UpdateScratch,
) -> MapUpdateReport {
    let mut update = Update::begin((mesh, rest), map, strips, edit, settings, scratch);
    update.mark_lips();
    if update.find_zone() {
        update.cut_links();
        update.give_new_vertices_rows();
        let moved = update.move_clipped_anchors();
        update.regain();
        wound::add_particles(&mut update);
        update.link_particles(moved);
        update.adopt_orphans();
        update.write_rows();
    }
    update.finish()
}

/// One update under way.
pub(super) struct Update<'a, 'e> {
    pub(super) mesh: &'a Mesh,
    pub(super) rest: &'a [DVec3],
    pub(super) map: &'a mut ParticleMap,
    pub(super) strips: &'a mut Strips,
    pub(super) edit: &'a MapEdit<'e>,
    pub(super) settings: &'a ParticleSettings,
    pub(super) scratch: &'a mut UpdateScratch,
    pub(super) report: MapUpdateReport,
}

impl<'a, 'e> Update<'a, 'e> {
    pub(super) fn begin(
        (mesh, rest): (&'a Mesh, &'a [DVec3]),
        map: &'a mut ParticleMap,
        strips: &'a mut Strips,
        edit: &'a MapEdit<'e>,
        settings: &'a ParticleSettings,
        scratch: &'a mut UpdateScratch,
    ) -> Self {
        scratch.old_rows.clear();
        scratch.old_entries.clear();
        scratch.tests = std::mem::take(&mut strips.places.links);
        scratch.asked.clear();
        let report = std::mem::take(&mut scratch.report).emptied();
        Self { mesh, rest, map, strips, edit, settings, scratch, report }
    }
}

impl Update<'_, '_> {
    /// Lips given by the edit, and new vertices whose parents are all on one lip, though not all of one strip: they are on it too.
    fn mark_lips(&mut self) {
        for new in self.edit.new_vertices.iter().filter(|n| !n.is_apart) {
            let parents = new.parents.into_iter().filter(|p| p.is_some());
            let (strips, common) = (&mut *self.strips, &mut self.scratch.common);
            common.clear();
            for lip in parents.clone().flat_map(|p| strips.lip_sides(p)) {
                let is_there =
                    |p| strips.known_side(lip.strip as usize, p).is_some_and(|known| i32::from(known.side) == lip.side);
                if !common.contains(lip) && parents.clone().all(is_there) {
                    common.push(*lip);
                }
            }
            for lip in common {
                strips.set_lip(new.vertex, lip.strip as usize, lip.side as i8);
            }
        }
        let strips = self.strips.len();
        for lip in self.edit.lips.iter().filter(|l| l.strip < strips) {
            self.strips.set_lip(lip.vertex, lip.strip, lip.side);
        }
    }

    /// Collects the particles, vertices and strips that the edit may concern. False if it concerns nothing.
    ///
    /// A link is shorter than the reach, so one that crosses a new strip has both ends within the reach of it. They are
    /// looked up by place, not by a flood: links may outlive the edge path that once joined their ends.
    pub(super) fn find_zone(&mut self) -> bool {
        self.map.influences.grow_rows(self.mesh.vertex_slots());
        let Some((low, high)) = self.bounds() else { return false };
        let (mesh, map, rest) = (self.mesh, &*self.map, self.rest);
        self.strips.prepare_late(rest, map, self.settings);
        let reach = self.reach();
        let places = &self.strips.places;
        let s = &mut *self.scratch;
        s.zone = (low, high);
        s.near.clear();
        s.bits.fit(map.len());
        places.anchors.visit(low - reach, high + reach, |j| {
            if let Some(anchor) = map.anchors.get(j as usize).filter(|a| a.is_some())
                && is_within(rest[anchor.index()], low - reach, high + reach)
            {
                s.bits.set(ParticleId(j));
            }
        });
        s.reaches.begin(map.len());
        s.bits.drain(|j| {
            s.near.push(j);
            s.reaches.note(self.settings, map, rest, j);
        });
        s.rows.begin(mesh.vertex_slots());
        s.unlinked.clear();
        true
    }

    /// No link is longer, metres.
    pub(super) fn reach(&self) -> f64 {
        self.settings.reach().max(self.strips.places.longest_moved)
    }

    /// Bounds of the new strips, extended, and of all vertices made or removed and all lips: a slit that was cut in a bent
    /// pose may leave lips outside its strip.
    fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let mut bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let mut grow = |low: DVec3, high: DVec3| bounds = (bounds.0.min(low), bounds.1.max(high));
        for k in self.tested_strips() {
            let strip = self.strips.geometry(k);
            grow(strip.low - strip.margin, strip.high + strip.margin);
        }
        let made = self.edit.new_vertices.iter().map(|n| n.vertex);
        let lips = self.edit.lips.iter().map(|l| l.vertex);
        for v in made.chain(lips).chain(self.edit.removed_vertices.iter().copied()) {
            grow(self.rest[v.index()], self.rest[v.index()]);
        }
        (bounds.0.cmple(bounds.1).all()).then_some(bounds)
    }

    /// Rows of new vertices: what reached their parents and still connects.
    fn give_new_vertices_rows(&mut self) {
        fit(&mut self.scratch.tried, self.map.len(), 0);
        self.scratch.wanted.begin(self.map.len());
        for new in self.edit.new_vertices.iter().filter(|n| self.mesh.vertex_is_live(n.vertex)) {
            let visit = self.scratch.visit();
            let UpdateScratch { rows, tried, candidates, wanted, .. } = &mut *self.scratch;
            candidates.clear();
            let mut note = |j: ParticleId| {
                if std::mem::replace(&mut tried[j.index()], visit) != visit {
                    candidates.push(j);
                }
            };
            for parent in new.parents.into_iter().filter(|p| p.is_some()) {
                rows.inherited(parent).iter().for_each(|&j| note(j));
                self.map.influences.row(parent.index()).iter().for_each(|e| note(e.particle));
            }
            rows.open_new(new.vertex, candidates);
            candidates.iter().for_each(|&j| wanted.push(j, new.vertex));
        }
        // particle by particle: what is known of its strips serves all of its links
        let Self { rest, settings, scratch, .. } = self;
        let (map, strips, rest, settings) = (&*self.map, &*self.strips, *rest, *settings);
        let UpdateScratch { rows, reaches, tests, in_reach, wanted, bits, .. } = &mut **scratch;
        wanted.particles(bits);
        bits.drain(|j| {
            in_reach.clear();
            in_reach.extend(wanted.of(j).filter(|&v| reaches.weight(settings, map, rest, v, j) > 0.0));
            if !in_reach.is_empty() {
                tests.each_near((strips, rest, map, settings), j, in_reach, |v, parted_by| {
                    let row = rows.open(v, map);
                    if parted_by.is_none() { row.add(j) } else { row.refuse(j) }
                });
            }
        });
    }

    /// True if `j` is near enough to move `v` and no strip lies between them.
    fn may_link(&mut self, v: VertexId, j: ParticleId) -> bool {
        self.weight(v, j) > 0.0 && self.connects(j, v)
    }

    /// Weight of `j` at `v` before normalisation; 0 out of reach or retired.
    pub(super) fn weight(&self, v: VertexId, j: ParticleId) -> f64 {
        self.scratch.reaches.weight(self.settings, self.map, self.rest, v, j)
    }

    /// True if no strip lies between the anchor of `j` and `v`.
    pub(super) fn connects(&mut self, j: ParticleId, v: VertexId) -> bool {
        let UpdateScratch { tests, asked, .. } = &mut *self.scratch;
        tests.connects((self.strips, self.rest, self.map, self.settings), (j, v), asked)
    }

    /// True if a particle near the wound is anchored to `v`.
    pub(super) fn is_anchor(&self, v: VertexId) -> bool {
        self.scratch.near.iter().any(|j| self.map.anchors[j.index()] == v)
    }

    /// Rows that lost links and new rows take what reaches the vertices next to them: links that the limit had cut off,
    /// and those that no parent had.
    fn regain(&mut self) {
        let limit = self.settings.max_influences;
        // a vertex that was there and is a lip only now knows its side, and what its neighbours on that side have
        for lip in
            self.edit.lips.iter().filter(|l| self.strips.lip_sides(l.vertex).len() == 1 && self.mesh.vertex_is_live(l.vertex))
        {
            self.scratch.rows.open(lip.vertex, self.map);
        }
        self.hold_lips_before();
        self.scratch.rows.list(&mut self.scratch.work);
        let mut next = 0;
        while next < self.scratch.work.len() {
            let v = self.scratch.work[next];
            next += 1;
            let row = self.scratch.rows.open(v, self.map);
            // a vertex that is a lip only now has the room of a new one: what it lost as it lay beyond a strip may be what is nearest
            let has_room = row.is_new() || row.len() >= limit && self.edit.lips.iter().any(|l| l.vertex == v);
            let limit = if has_room { limit + EXTRA_INFLUENCES / 2 } else { limit };
            if row.len() >= limit {
                continue;
            }
            let mut gained = false;
            self.list_untried(v);
            for i in 0..self.scratch.untried.len() {
                let j = self.scratch.untried[i];
                if self.may_link(v, j) {
                    gained = true;
                    let row = self.scratch.rows.open(v, self.map);
                    row.add(j);
                    if row.len() >= limit {
                        break;
                    }
                }
            }
            if gained {
                let s = &mut *self.scratch;
                s.work.extend(self.mesh.neighbours(v).filter(|&n| s.rows.is_open(n)));
            }
        }
    }

    /// Collects the particles that hold vertices next to `v` and not `v` itself, each once, but for those that a strip is known to
    /// part from it.
    fn list_untried(&mut self, v: VertexId) {
        let visit = self.scratch.visit();
        let UpdateScratch { rows, tried, untried, ring, .. } = &mut *self.scratch;
        untried.clear();
        rows.each(v, self.map, |j| tried[j.index()] = visit);
        // one that has another anchor since was refused at its old one
        let stands = |j: &&ParticleId| !self.report.reanchored.contains(j);
        rows.refused(v).iter().filter(stands).for_each(|j| tried[j.index()] = visit);
        self.mesh.list_neighbours(v, ring);
        for &n in &*ring {
            rows.each(n, self.map, |j| {
                // what one neighbour has, the others mostly have too
                if std::mem::replace(&mut tried[j.index()], visit) != visit {
                    untried.push(j);
                }
            });
        }
    }

    /// Removes a particle from its neighbours' rows and clears its own.
    pub(super) fn unlink(&mut self, j: ParticleId) {
        let count = self.map.neighbours.row(j.index()).len();
        for i in 0..count {
            self.remove_link(self.map.neighbours.row(j.index())[i].particle, j);
        }
        if count > 0 {
            self.map.neighbours.set_row(j.index(), &[]);
            self.report.relinked.push(j);
            self.report.links_removed += count;
        }
    }

    /// Removes `j` from the neighbours of `of`.
    pub(super) fn remove_link(&mut self, of: ParticleId, j: ParticleId) {
        let links = &mut self.scratch.links;
        links.clear();
        links.extend(self.map.neighbours.row(of.index()).iter().filter(|l| l.particle != j));
        self.map.neighbours.set_row(of.index(), links);
        self.report.relinked.push(of);
    }

    /// Appends a particle; its links are found by [`Update::link_particles`].
    pub(super) fn add_particle(&mut self, anchor: VertexId, rest_displacement: DVec3) -> ParticleId {
        let j = ParticleId::new(self.map.anchors.push(anchor));
        self.map.rest_displacement.push(rest_displacement.to_array());
        self.map.neighbours.push_row(&[]);
        self.strips.places.anchors.insert(j.0, self.rest[anchor.index()]);
        self.scratch.near.push(j);
        self.scratch.reaches.note(self.settings, self.map, self.rest, j);
        self.scratch.unlinked.push(j);
        self.report.particles_added.push(j);
        self.report.particles_changed.push(j);
        j
    }

    /// Finds the neighbours of new and re-anchored particles, and the influences of all but the first `moved`, which hold theirs.
    pub(super) fn link_particles(&mut self, moved: usize) {
        while let Some(j) = self.scratch.unlinked.pop() {
            if self.scratch.unlinked.len() >= moved {
                self.find_influences(j);
            }
            self.find_neighbours(j, self.map.anchors[j.index()]);
        }
    }

    /// A particle holds the vertices around its anchor, as far as its radius and as the next strip: what lies round a corner has
    /// particles of its own.
    pub(super) fn find_influences(&mut self, j: ParticleId) {
        let (map, strips, rest, settings) = (&*self.map, &*self.strips, self.rest, self.settings);
        let UpdateScratch { flood, rows, reaches, tests, in_reach, .. } = &mut *self.scratch;
        let (anchor, radius) = (map.anchors[j.index()], settings.radius_of(map, j));
        let centre = rest[anchor.index()];
        flood.run_together(self.mesh, anchor, |few| {
            in_reach.clear();
            in_reach.extend(few.iter().filter(|v| rest[v.index()].distance_squared(centre) <= radius * radius));
            let mut seen = 0;
            if !in_reach.is_empty() {
                tests.each_near((strips, rest, map, settings), j, in_reach, |v, parted_by| {
                    let place = few.iter().position(|&w| w == v).unwrap_or_default();
                    seen |= u32::from(parted_by.is_none()) << place;
                });
            }
            seen
        });
        // a full row that nothing has left takes nobody in: what was there goes before what comes
        let most = settings.max_influences + EXTRA_INFLUENCES;
        for &v in &flood.reached {
            let has_room = rows.is_open(v) || map.influences.row(v.index()).len() < most;
            if has_room && reaches.weight(settings, map, rest, v, j) > 0.0 {
                rows.open(v, map).add(j);
            }
        }
    }

    /// A new particle is joined to those that hold its anchor: near, on its sheet, and on its side of every strip.
    pub(super) fn find_neighbours(&mut self, j: ParticleId, anchor: VertexId) {
        let delta = self.settings.neighbours;
        let mean = self.map.mean_link_length(self.rest).unwrap_or(0.6 * delta);
        let mut row = std::mem::take(&mut self.scratch.row_of_links);
        row.clear();
        row.extend_from_slice(self.map.neighbours.row(j.index()));
        let known = row.len();
        let mut i = 0;
        while let Some(k) = self.scratch.rows.particle(anchor, i, self.map) {
            i += 1;
            let other = self.map.anchors[k.index()];
            if k == j || other.is_none() || row.iter().any(|l| l.particle == k) {
                continue;
            }
            let distance = self.rest[other.index()].distance(self.rest[anchor.index()]);
            if distance < delta && self.strips.connects_vertices(self.rest, anchor, other) {
                let weight = link_weight(distance, mean);
                row.push(Link { particle: k, weight });
                self.insert_link(k, Link { particle: j, weight });
            }
        }
        if row.len() > known {
            row.sort_unstable_by_key(|l| l.particle);
            self.map.neighbours.set_row(j.index(), &row);
            self.report.relinked.push(j);
        }
        self.scratch.row_of_links = row;
    }

    fn insert_link(&mut self, of: ParticleId, link: Link) {
        let links = &mut self.scratch.links;
        links.clear();
        links.extend_from_slice(self.map.neighbours.row(of.index()));
        let at = links.partition_point(|l| l.particle < link.particle);
        links.insert(at, link);
        self.map.neighbours.set_row(of.index(), links);
        self.report.relinked.push(of);
    }

    /// Writes the rows that differ from the map's.
    pub(super) fn write_rows(&mut self) {
        for &v in self.edit.removed_vertices.iter().filter(|&&v| !self.mesh.vertex_is_live(v)) {
            if !self.map.influences.row(v.index()).is_empty() {
                self.replace_row(v, &[]);
            }
        }
        let limit = self.settings.max_influences + EXTRA_INFLUENCES;
        let mut row = std::mem::take(&mut self.scratch.row);
        for i in 0..self.scratch.rows.count() {
            let v = self.scratch.rows.vertex(i);
            if !self.mesh.vertex_is_live(v) {
                continue;
            }
            let mut weighted = std::mem::take(&mut self.scratch.weighted);
            weighted.clear();
            let particles = self.scratch.rows.particles(i);
            weighted.extend(particles.iter().map(|&j| (self.weight(v, j), j)));
            let limit = if self.scratch.rows.is_new(i) { self.settings.max_influences + EXTRA_INFLUENCES / 2 } else { limit };
            if weighted.len() > limit {
                // What was there goes before what comes in, however strong.
                let was_there = |j: ParticleId| self.map.influences.row(v.index()).iter().any(|e| e.particle == j);
                weighted
                    .sort_unstable_by(|a, b| was_there(b.1).cmp(&was_there(a.1)).then(b.0.total_cmp(&a.0)).then(a.1.cmp(&b.1)));
                weighted.truncate(limit);
            }
            normalise(&mut weighted, limit);
            row.clear();
            row.extend(weighted.iter().map(|&(w, j)| Influence { particle: j, weight: w as f32 }));
            if row.is_empty() {
                // Only links beyond the radius, as a map built from few anchors has: the first stands for all.
                row.extend(particles.first().map(|&j| Influence { particle: j, weight: 1.0 }));
                self.strips.places.far.insert(v);
            }
            self.scratch.weighted = weighted;
            if self.map.influences.row(v.index()) != row.as_slice() {
                self.replace_row(v, &row);
            }
        }
        self.scratch.row = row;
    }

    /// Writes a row and keeps what it was.
    fn replace_row(&mut self, v: VertexId, row: &[Influence]) {
        let s = &mut *self.scratch;
        let start = s.old_entries.len();
        let old = self.map.influences.row(v.index());
        self.strips.places.holders.note_row(v, self.rest[v.index()], row, old);
        s.old_entries.extend_from_slice(old);
        s.old_rows.push((v, start..s.old_entries.len()));
        self.map.influences.set_row(v.index(), row);
        self.report.vertices_changed.push(v);
    }

    pub(super) fn finish(self) -> MapUpdateReport {
        let Self { strips, scratch, mut report, map, .. } = self;
        report.vertices_visited += std::mem::take(&mut scratch.tests.tested);
        strips.places.links = std::mem::take(&mut scratch.tests);
        let bits = &mut scratch.bits;
        bits.fit(map.len());
        bits.sort(&mut report.relinked);
        report.particles_changed.extend_from_slice(&report.relinked);
        bits.sort(&mut report.particles_changed);
        report
    }
}

pub(super) fn is_within(p: DVec3, low: DVec3, high: DVec3) -> bool {
    p.cmpge(low).all() && p.cmple(high).all()
}
