//! Opens what leaves have cut, and tells the lips.

use super::{SlitScratch, SlitStep};
use crate::geometry::{HalfEdge, Mesh, SplitVertex, VertexId};
use crate::surgery::insert::{NewVertex, copy_marks};
use crate::surgery::leaf::line;
use crate::surgery::tear::LipPoint;
use glam::DVec3;

impl SlitScratch {
    /// Opens the cut edges and gives each side its own vertices.
    pub(super) fn open(&mut self, mesh: &mut Mesh, out: &mut SlitStep) {
        self.drop_spurs(out);
        self.vertices.clear();
        self.vertices.extend(self.cuts.iter().flatten());
        out.touched.extend(&self.vertices);
        out.met.extend(&self.vertices);
        self.incident.clear();
        for &v in &self.vertices {
            self.incident.extend(mesh.fan(v).map(HalfEdge::face));
        }
        for &[a, b] in &self.cuts {
            let h = mesh.fan(a).find(|&h| mesh.to(h) == b);
            let pair = h.map(|h| [h, mesh.opposite(h)]).filter(|[_, back]| back.is_some());
            debug_assert!(pair.is_some(), "a cut became no edge");
            self.opened.extend(pair);
        }
        for &[h, _] in &self.opened {
            mesh.open_edge(h);
        }
        out.opened_edges += self.opened.len();
        self.split.clear();
        mesh.split_fans(&self.vertices, &self.incident, &mut self.topology, &mut self.split);
        for i in 0..self.split.len() {
            self.note_split(self.split[i], out);
        }
        self.part_single_edges(mesh, out);
        self.note_lips(mesh, out);
    }

    /// Where a vertex along the cut lies.
    pub(super) fn place_of(&self, v: VertexId, out: &SlitStep) -> DVec3 {
        let made = out.new_vertices.iter().find(|n| n.vertex == v).map(|n| n.position);
        made.unwrap_or_else(|| self.positions[self.slot[v.index()] as usize])
    }

    /// A copy made by a fan split lies where its original lies.
    pub(super) fn note_split(&mut self, split: SplitVertex, out: &mut SlitStep) {
        out.new_vertices.push(NewVertex::copy_of(split, self.place_of(split.from, out)));
        copy_marks(&mut out.lips, split, |lip| &mut lip.vertex);
        copy_marks(&mut out.tags, split, |tag| &mut tag.vertex);
    }

    /// Sides of the vertices along the opened edges; a vertex on both is an end of the slit.
    fn note_lips(&mut self, mesh: &Mesh, out: &mut SlitStep) {
        for &[h, back] in &self.opened {
            self.sides.extend([(mesh.from(h), -1), (mesh.to(h), -1), (mesh.from(back), 1), (mesh.to(back), 1)]);
        }
        self.sides.sort_unstable();
        self.sides.dedup();
        for run in self.sides.chunk_by(|a, b| a.0 == b.0) {
            if let [(vertex, side)] = *run {
                let lip = LipPoint { vertex, side };
                if !out.lips.contains(&lip) {
                    out.lips.push(lip);
                }
            }
        }
    }

    /// Leaves closed what a leaf cut behind the end of the slit that it goes on from: where tissue has moved, skin beside that end may have
    /// come over the blade's line, and a second cut leads from there back to the line. Opened, it would part a flap from its lip.
    fn drop_spurs(&mut self, out: &mut SlitStep) {
        for i in 0..self.starts.len() {
            let start = self.starts[i];
            let mut k = 0;
            while k < self.cuts.len() {
                let is_one_of_many = self.cuts[k].contains(&start) && self.cuts.iter().filter(|c| c.contains(&start)).count() > 1;
                let end = if is_one_of_many { self.follow_spur(start, k, out) } else { None };
                k += 1;
                if let Some(end) = end {
                    let passed = self.spur.iter().flat_map(|&cut| self.cuts[cut]);
                    out.closed.extend(passed.filter(|&v| v != start));
                    self.spur.sort_unstable();
                    self.spur.drain(..).rev().for_each(|cut| _ = self.cuts.remove(cut));
                    out.tags.retain(|t| t.vertex != end);
                    k = 0;
                }
            }
        }
    }

    /// Follows cuts from a start to where they end: that vertex, with the cuts in `self.spur`, if it is a new one on the first blade.
    fn follow_spur(&mut self, start: VertexId, first: usize, out: &SlitStep) -> Option<VertexId> {
        let other = |[a, b]: [VertexId; 2], v: VertexId| if a == v { b } else { a };
        self.spur.clear();
        let (mut at, mut next) = (start, Some(first));
        while let Some(k) = next {
            self.spur.push(k);
            at = other(self.cuts[k], at);
            let mut onward = (0..self.cuts.len()).filter(|&j| self.cuts[j].contains(&at) && !self.spur.contains(&j));
            next = onward.next();
            if onward.next().is_some() || self.starts.contains(&at) {
                return None;
            }
        }
        out.tags.iter().any(|t| t.vertex == at && t.lines & line::START != 0).then_some(at)
    }
}
