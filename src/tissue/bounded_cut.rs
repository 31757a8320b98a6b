//! The bounded plane cut: the surface is opened along the part of a plane that the blade swept, as by a slit of one strip.

use super::Tissue;
use super::stroke::{at_rest, bind_slit};
use crate::diagnostics::Stages;
use crate::geometry::Plane;
use crate::surgery::leaf::Leaf;
use crate::surgery::slit::{SlitScratch, SlitStep, slit_step};
use glam::DVec3;

impl Tissue {
    /// Cuts the tissue in place along the part of `plane` inside a triangle or quadrangle: the blade's tip before and after,
    /// then its other end after and (for a quadrangle) before, tissue space. The wound is held and opened as a tear's is.
    /// `None`, with nothing changed, if the corners span no convex polygon or it meets no face.
    pub fn cut_bounded(&mut self, plane: &Plane, corners: &[DVec3], stages: &mut Stages) -> Option<SlitStep> {
        let (&[tip, next_tip, next_top], top) = (corners.first_chunk::<3>()?, corners.get(3).copied());
        let leaf = Leaf::in_plane(*plane, corners).filter(|_| corners.len() <= 4)?;
        self.refresh_sections();
        let mut step = SlitStep::default();
        let mut candidates = Vec::new();
        self.faces_near(leaf.min, leaf.max, &mut candidates);
        candidates.sort_unstable();
        let edges = [[tip, top.unwrap_or(next_top)], [next_tip, next_top]];
        let [start, end] = edges.map(|edge| at_rest(self, &candidates, edge));
        let hit = stages.time("split", || {
            let (mesh, posed) = self.split_borrow();
            let leaves = std::slice::from_ref(&leaf);
            slit_step(mesh, leaves, &candidates, &|v| posed.position(v), &[], &mut SlitScratch::default(), &mut step)
        });
        if !hit {
            return None;
        }
        let slit = self.layer().map_or(0, |l| l.strips.next_slit());
        bind_slit(self, &step, [start[0], end[0], end[1], start[1]], slit, None, stages);
        if let Some(layer) = &mut self.layer {
            crate::particles::release_slit(&mut layer.map, &layer.strips, &layer.settings.wound);
        }
        Some(step)
    }
}
