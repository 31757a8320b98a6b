//! Binds strips to the tissue: what a cut did to the mesh, told to the particle map part by part.

use super::strip_ends::{StripPart, find_made};
use super::{SegmentReport, TearStroke};
use crate::diagnostics::Stages;
use crate::geometry::VertexId;
use crate::particles::{LipVertex, MapUpdateReport};
use crate::surgery::insert::NewVertex;
use crate::surgery::tear::LipPoint;
use crate::tissue::Tissue;
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
    /// It was below the skin alone: its strips run beside the line of their slit.
    pub(in crate::tissue) is_beside: bool,
    /// How far its strips are extended, metres: the radius of influence, or nothing.
    pub(in crate::tissue) reach: f64,
    /// The number of its slit.
    pub(in crate::tissue) slit: u32,
    /// The strip that it goes on from, where vertices at the joint have sides only now.
    pub(in crate::tissue) goes_on_from: Option<usize>,
}

impl Cut<'_> {
    /// The new strip of a part of what the cut swept, and what that does to the particle map; gives the strip's number, too. What the cut
    /// has made and removed comes with its `is_first` part. A nick leaves no strip: its lips wait in `nicked` for that which goes on from it.
    /// `seen` tells where vertices are seen that the cut has not made; `lips` is scratch.
    pub(in crate::tissue) fn bind(
        &self,
        tissue: &mut Tissue,
        (part, is_first, is_nick): (&StripPart, bool, bool),
        seen: impl Fn(&Tissue, VertexId) -> DVec3,
        (lips, nicked): (&mut Vec<LipVertex>, &mut Vec<LipPoint>),
        stages: &mut Stages,
    ) -> (MapUpdateReport, Option<usize>) {
        let strip = stages.time("disconnect_particles", || {
            let layer = tissue.layer.as_mut().filter(|_| !is_nick)?;
            let [start, end] = part.at_rest;
            let corners = [start[0], end[0], end[1], start[1]];
            layer.strips.push_strip(corners, self.reach, self.slit, self.is_beside).ok()
        });
        lips.clear();
        let place = |v| find_made(self.made, v).map_or_else(|| seen(tissue, v), |n| n.position);
        let points = self.lips.iter().filter(|l| part.holds(|| place(l.vertex))).copied();
        if is_nick {
            nicked.extend(points);
        } else if let Some(strip) = strip {
            let points = points.chain(nicked.drain(..));
            let beside = (points, self.made, self.closed);
            tissue.list_lips((strip, part.blades), beside, self.has_width, |v| seen(tissue, v), lips);
        }
        let (made, removed) = if is_first { (self.made, self.removed) } else { Default::default() };
        let update = stages.time("update_particles", || {
            let strips = strip.map_or(0..0, |s| s..s + 1);
            tissue.update_map(made, removed, (strips, self.goes_on_from.filter(|_| is_first && strip.is_some())), lips)
        });
        (update, strip)
    }
}

impl TearStroke {
    /// Binds what a cut swept, part by part: the number of its last strip.
    pub(super) fn bind_strips(
        &mut self,
        tissue: &mut Tissue,
        cut: &mut Cut<'_>,
        (parts, blades): (&[Option<StripPart>], [[DVec3; 2]; 2]),
        report: &mut SegmentReport,
    ) -> Option<usize> {
        let mut last = None;
        for (i, part) in parts.iter().flatten().enumerate() {
            if part.is_apart {
                self.begin_slit(tissue, false);
            }
            cut.slit = self.slit;
            let Self { lips, nicked, positions, .. } = &mut *self;
            let seen = |tissue: &Tissue, v| positions.of(tissue, v);
            let of_part = (part, i == 0, part.is_nick(blades));
            let (update, strip) = cut.bind(tissue, of_part, seen, (lips, nicked), &mut report.stages);
            let made = cut.made.iter().map(|n| n.vertex);
            self.positions.edited(tissue, update.vertices_changed.iter().copied().chain(made));
            report.wound_particles += update.particles_added.len();
            report.vertices_visited += update.vertices_visited;
            tissue.scratch.update.reuse(update);
            last = strip.or(last);
        }
        last
    }
}
