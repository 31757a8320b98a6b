//! Binds strips to the tissue: what a cut did to the mesh, told to the particle map part by part.

use super::strip_ends::{StripPart, find_made};
use super::wound_line::WoundLine;
use super::{SegmentReport, TearStroke};
use crate::diagnostics::Stages;
use crate::geometry::VertexId;
use crate::particles::wound_lines::OnLine;
use crate::particles::{LipVertex, MapUpdateReport};
use crate::surgery::insert::NewVertex;
use crate::surgery::tear::LipPoint;
use crate::tissue::Tissue;
use crate::tissue::edit::NewStrips;
use glam::DVec3;

/// What a cut did to the mesh.
#[derive(Default)]
pub(in crate::tissue) struct Cut<'a> {
    /// Sides as boxes and leaves have them.
    pub(in crate::tissue) lips: &'a [LipPoint],
    /// Vertices that it has made, in order; they have rows by now.
    pub(in crate::tissue) made: &'a [NewVertex],
    pub(in crate::tissue) removed: &'a [VertexId],
    /// Vertices along what it has left closed.
    pub(in crate::tissue) closed: &'a [VertexId],
    pub(in crate::tissue) has_width: bool,
    /// It was below the skin alone: its strips run beside the lines of all wounds.
    pub(in crate::tissue) is_beside: bool,
    /// How far its strips are extended, metres: the radius of influence, or nothing.
    pub(in crate::tissue) reach: f64,
    /// The number of its slit.
    pub(in crate::tissue) slit: u32,
    /// The strip that it goes on from, where vertices at the joint have sides only now.
    pub(in crate::tissue) goes_on_from: Option<usize>,
    /// The line that it goes on along, and whether it does so in the skin, from an edge that it shares with what came before.
    pub(in crate::tissue) goes_on_along: Option<WoundLine>,
    pub(in crate::tissue) shares_edge: bool,
}

impl Cut<'_> {
    /// The new strip of a part of what the cut swept, and what that does to the particle map; gives the strip's number and the line of its
    /// wound, too. What the cut has made and removed comes with its `is_first` part. A nick leaves no strip: its lips wait in `nicked`
    /// for that which goes on from it.
    /// `seen` tells where vertices are seen that the cut has not made; `lips` is scratch.
    pub(in crate::tissue) fn bind(
        &self,
        tissue: &mut Tissue,
        (part, is_first, is_nick): (&StripPart, bool, bool),
        seen: impl Fn(&Tissue, VertexId) -> DVec3,
        (lips, nicked): (&mut Vec<LipVertex>, &mut Vec<LipPoint>),
        stages: &mut Stages,
    ) -> (MapUpdateReport, Option<usize>, Option<WoundLine>) {
        let line = if is_nick { self.goes_on_along } else { None };
        let pushed = stages.time("disconnect_particles", || if is_nick { None } else { self.push_strip(tissue, part, is_first) });
        let (strip, opened, line) = pushed.map_or((None, [0.0; 2], line), |p| (Some(p.strip), p.opened, p.line));
        lips.clear();
        if is_nick {
            nicked.extend(self.lips_of(part, |v| seen(tissue, v)));
        } else if let Some(strip) = strip {
            let points = self.lips_of(part, |v| seen(tissue, v)).chain(nicked.drain(..));
            let beside = (points, self.made, self.closed);
            tissue.list_lips((strip, part.blades), beside, self.has_width, |v| seen(tissue, v), lips);
        }
        let (made, removed) = if is_first { (self.made, self.removed) } else { Default::default() };
        let update = stages.time("update_particles", || {
            let strips = strip.map_or(0..0, |s| s..s + 1);
            let goes_on_from = self.goes_on_from.filter(|_| is_first && strip.is_some());
            tissue.update_map(made, removed, NewStrips { strips, goes_on_from, opened }, lips)
        });
        (update, strip, line)
    }

    /// [`Cut::bind`] for the parts of a cut that goes on from nothing, all at once: parts of one line, each from where the one before ended.
    pub(in crate::tissue) fn bind_all(
        &mut self,
        tissue: &mut Tissue,
        parts: &[StripPart],
        stages: &mut Stages,
    ) -> (MapUpdateReport, Option<WoundLine>) {
        let (mut lips, mut of_part, mut opened, mut strips) = (Vec::new(), Vec::new(), [0.0; 2], 0..0);
        stages.time("disconnect_particles", || {
            for part in parts {
                let Some(pushed) = self.push_strip(tissue, part, true) else { continue };
                if strips.is_empty() {
                    (strips, opened) = (pushed.strip..pushed.strip, pushed.opened);
                }
                strips.end = pushed.strip + 1;
                (self.goes_on_along, self.shares_edge) = (pushed.line, true);
                let beside = (self.lips_of(part, |v| tissue.position(v)), self.made, self.closed);
                tissue.list_lips((pushed.strip, part.blades), beside, self.has_width, |v| tissue.position(v), &mut of_part);
                lips.append(&mut of_part);
            }
        });
        let update = stages.time("update_particles", || {
            tissue.update_map(self.made, self.removed, NewStrips { strips, goes_on_from: None, opened }, &lips)
        });
        (update, self.goes_on_along)
    }

    /// The lips of a part; `seen` tells where vertices are seen that the cut has not made.
    fn lips_of(&self, part: &StripPart, seen: impl Fn(VertexId) -> DVec3) -> impl Iterator<Item = LipPoint> {
        let place = move |v| find_made(self.made, v).map_or_else(|| seen(v), |n| n.position);
        self.lips.iter().filter(move |l| part.holds(|| place(l.vertex))).copied()
    }

    /// The strip of a part at rest; nothing without particles, or where the part is no strip.
    fn push_strip(&self, tissue: &mut Tissue, part: &StripPart, is_first: bool) -> Option<Pushed> {
        let layer = tissue.layer.as_ref()?;
        let [start, end] = part.at_rest;
        let (mut on, mut opened, mut line) = (OnLine::BESIDE, [0.0; 2], None);
        if !self.is_beside {
            let edge = self.skin_edge(tissue, part);
            let begins = self.line(tissue, &layer.strips, (part, is_first), edge);
            let strip = begins.strip(edge[1], self.length(part, begins.end.distance(edge[1])));
            (opened, line) = (begins.opened, Some(begins.after(&strip)));
            on = if begins.is_on_offer() { OnLine::BESIDE } else { strip };
        }
        let corners = [start[0], end[0], end[1], start[1]];
        let strip = tissue.layer.as_mut()?.strips.push_strip(corners, self.reach, self.slit, on).ok()?;
        Some(Pushed { strip, opened, line })
    }
}

/// A strip that was added.
struct Pushed {
    /// Its number.
    strip: usize,
    /// What of its wound stood open.
    opened: [f64; 2],
    /// The line of its wound, from its end on.
    line: Option<WoundLine>,
}

impl Cut<'_> {
    /// How long a strip counts as: as long as what it cut of the skin. That of a slit without width runs from vertex to vertex, and where such
    /// slits cross it folded a tenth more of the skin than the mean of both edges of the strip.
    fn length(&self, part: &StripPart, in_skin: f64) -> f64 {
        let [start, end] = part.at_rest;
        if self.has_width { in_skin } else { 0.5 * (start[0].distance(end[0]) + start[1].distance(end[1])) }
    }
}

impl TearStroke {
    /// Binds what a cut swept, part by part: the number of its last strip, and the line on which a next one goes on.
    pub(super) fn bind_strips(
        &mut self,
        tissue: &mut Tissue,
        cut: &mut Cut<'_>,
        (parts, blades): (&[Option<StripPart>], [[DVec3; 2]; 2]),
        report: &mut SegmentReport,
    ) -> (Option<usize>, Option<WoundLine>) {
        let (mut last, mut line) = (None, cut.goes_on_along);
        for (i, part) in parts.iter().flatten().enumerate() {
            if part.is_apart {
                self.begin_slit(tissue, false);
            }
            cut.slit = self.slit;
            let Self { lips, nicked, positions, .. } = &mut *self;
            let seen = |tissue: &Tissue, v| positions.of(tissue, v);
            let of_part = (part, i == 0, part.is_nick(blades));
            let (update, strip, on) = cut.bind(tissue, of_part, seen, (lips, nicked), &mut report.stages);
            let made = cut.made.iter().map(|n| n.vertex);
            self.positions.edited(tissue, update.vertices_changed.iter().copied().chain(made));
            report.wound_particles += update.particles_added.len();
            report.vertices_visited += update.vertices_visited;
            tissue.scratch.update.reuse(update);
            last = strip.or(last);
            line = on;
            if let Some(line) = on.filter(|line| !line.is_on_offer()) {
                self.lies_on(tissue, line.wound);
            }
        }
        (last, line)
    }

    /// Notes that the blade is in a wound. It has left the others, unless chains of several are cut side by side: not where one begins, as it
    /// may be one's that the blade turns back in, and what opens under it is not cut where it goes.
    fn lies_on(&mut self, tissue: &mut Tissue, wound: u32) {
        if self.wounds.contains(&wound) {
            return;
        }
        if self.stroke.builder().is_alone() {
            self.release_wounds(tissue);
        }
        self.wounds.push(wound);
    }

    /// The blade has left its wounds: they open over all their length.
    pub(super) fn release_wounds(&mut self, tissue: &mut Tissue) {
        for wound in self.wounds.drain(..) {
            let report = tissue.release_wound(wound);
            self.positions.edited(tissue, report.vertices_changed.iter().copied());
            tissue.scratch.update.reuse(report);
        }
    }
}
