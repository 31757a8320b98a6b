//! The bounded plane cut: the surface is opened along the part of a plane that the blade swept, as by a slit of one strip.

use super::Tissue;
use super::edit::Opened;
use super::stroke::{Cut, StripPart, Swath, slit_cut};
use crate::diagnostics::Stages;
use crate::geometry::Plane;
use crate::surgery::cap::{CapOutcome, CapScratch, closes};
use crate::surgery::leaf::Leaf;
use crate::surgery::slit::{SlitScratch, SlitStep, slit_step};
use glam::DVec3;

impl Tissue {
    /// Cuts the tissue in place along the part of `plane` inside a triangle or quadrangle: the blade's tip before and after,
    /// then its other end after and (for a quadrangle) before, tissue space. The wound is held and opened as a tear's is.
    /// `None`, with nothing changed, if the corners span no convex polygon or it meets no face.
    ///
    /// With `closed`, and if the cut goes right through all that it meets, each loop of it gets a cap on both sides (MATHS 6). One
    /// that ends inside the tissue gets none: its edges count as unclosed.
    pub fn cut_bounded(
        &mut self,
        plane: &Plane,
        corners: &[DVec3],
        closed: bool,
        stages: &mut Stages,
    ) -> Option<(SlitStep, CapOutcome)> {
        let (&[tip, next_tip, next_top], top) = (corners.first_chunk::<3>()?, corners.get(3).copied());
        let leaf = Leaf::in_plane(*plane, corners).filter(|_| corners.len() <= 4)?;
        self.refresh_sections();
        let (mut step, mut scratch) = (SlitStep::default(), SlitScratch::default());
        let mut candidates = Vec::new();
        self.faces_near(leaf.min, leaf.max, &mut candidates);
        candidates.sort_unstable();
        let edges = [[tip, top.unwrap_or(next_top)], [next_tip, next_top]];
        let uncut = Swath {
            tissue: self,
            made: &[],
            near: &[],
            candidates: &candidates,
            half_width: 0.0,
            elsewhere: |v| self.position(v),
        };
        let at_rest = edges.map(|edge| uncut.rest_edge(edge));
        let hit = stages.time("split", || {
            let (mesh, posed) = self.split_borrow();
            let leaves = std::slice::from_ref(&leaf);
            slit_step(mesh, leaves, &candidates, &|v| posed.position(v), &[], &mut scratch, &mut step)
        });
        if !hit {
            return None;
        }
        let slit = self.layer().map_or(0, |l| l.strips.next_slit());
        stages.time("bind", || self.add_vertices(&step.new_vertices));
        let (cut, part) = (Cut { slit, ..slit_cut(self, &step) }, StripPart::whole(edges, at_rest));
        let lists = (&mut Vec::new(), &mut Vec::new());
        let (report, _, line) = cut.bind(self, (&part, true, false), |tissue, v| tissue.position(v), lists, stages);
        self.versions.structure += 1;
        self.scratch.update.reuse(report);
        if let Some(line) = line {
            let report = self.release_wound(line.wound);
            self.scratch.update.reuse(report);
        }
        let capped =
            if closed { stages.time("caps", || self.cap_bounded(&leaf.plane, &step, &scratch)) } else { CapOutcome::default() };
        Some((step, capped))
    }

    /// `plane` is the leaf's, whose sides those of the rim are.
    fn cap_bounded(&mut self, plane: &Plane, step: &SlitStep, slit: &SlitScratch) -> CapOutcome {
        let mut scratch = CapScratch::default();
        if !closes(&self.mesh, slit.rim(), &mut scratch) {
            return CapOutcome { unclosed_edges: 2 * slit.rim().len(), ..CapOutcome::default() };
        }
        let taken = slit.taken(&self.mesh);
        self.cap(plane, Opened { rim: slit.rim(), taken: &taken, new_vertices: &step.new_vertices }, &mut scratch)
    }
}
