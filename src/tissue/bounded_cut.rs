//! The bounded plane cut: the surface is opened along the part of a plane that the blade swept, as by a slit: of one strip, or in tissue
//! that bends of several.

use super::Tissue;
use super::edit::Opened;
use super::inside::which_inside;
use super::stroke::{Cut, StripPart, Swath, blade_at, distance_to_line, mean_edge, slit_cut, way_between};
use crate::diagnostics::Stages;
use crate::geometry::{FaceId, Plane, VertexId};
use crate::surgery::cap::{CapOutcome, CapScratch, closes};
use crate::surgery::leaf::Leaf;
use crate::surgery::slit::{SlitScratch, SlitStep, slit_step};
use glam::DVec3;

/// A cut that is as straight at rest as it is seen, but for this share of its way, leaves one strip.
const BENT: f64 = 0.002;
/// A cut through tissue that bends leaves no more strips.
const MOST_SLICES: usize = 32;
/// Points of the way of a blade's end that are looked at for whether they lie inside the tissue.
const LOOKS: usize = 5;

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
        let leaf = Leaf::in_plane(*plane, corners).filter(|_| (3..=4).contains(&corners.len()))?;
        self.refresh_sections();
        let (mut step, mut scratch) = (SlitStep::default(), SlitScratch::default());
        let mut candidates = Vec::new();
        self.faces_near(leaf.min, leaf.max, &mut candidates);
        candidates.sort_unstable();
        let edges = self.blades_of(corners);
        let at_rest = self.edges_at_rest(edges, &candidates);
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
        let mut cut = Cut { slit, ..slit_cut(self, &step) };
        // where a slice has cut nothing there is nothing to part
        let has_cut = |part: &StripPart| step.new_vertices.iter().any(|n| part.holds(|| n.position));
        let parts: Vec<_> = StripPart::slices(edges, &at_rest).filter(has_cut).collect();
        let (report, line) = cut.bind_all(self, &parts, stages);
        self.scratch.update.reuse(report);
        self.versions.structure += 1;
        if let Some(line) = line {
            let report = self.release_wound(line.wound);
            self.scratch.update.reuse(report);
        }
        let capped =
            if closed { stages.time("caps", || self.cap_bounded(&leaf.plane, &step, &scratch)) } else { CapOutcome::default() };
        Some((step, capped))
    }

    /// The blades (tip, top) at both ends of a cut through a triangle or quadrangle: as its corners are named, or the other way up, if so
    /// more of the tips' way lies inside the tissue, and more of the tops' outside.
    fn blades_of(&self, corners: &[DVec3]) -> [[DVec3; 2]; 2] {
        let [tip, next_tip, next_top] = [0, 1, 2].map(|k| corners[k]);
        let top = *corners.get(3).unwrap_or(&next_top);
        let inside = |from: DVec3, to: DVec3| {
            let points = std::array::from_fn::<_, LOOKS, _>(|k| from.lerp(to, (k as f64 + 0.5) / LOOKS as f64));
            which_inside(self, points).into_iter().filter(|inside| *inside).count()
        };
        let is_upside_down = inside(top, next_top) > inside(tip, next_tip);
        if is_upside_down { [[next_top, next_tip], [top, tip]] } else { [[tip, top], [next_tip, next_top]] }
    }

    /// The blades at the ends of slices of a cut between two `edges` (tip, top), at rest: as many slices as it takes for each to be as
    /// straight at rest as it is seen, in tissue that bends. `candidates` are the faces around it, uncut.
    fn edges_at_rest(&self, edges: [[DVec3; 2]; 2], candidates: &[FaceId]) -> Vec<[DVec3; 2]> {
        let mut near: Vec<VertexId> = candidates.iter().flat_map(|&f| self.mesh.face(f)).collect();
        near.sort_unstable();
        near.dedup();
        let uncut = Swath {
            tissue: self,
            made: &[],
            near: &near,
            candidates,
            half_width: 0.5 * mean_edge(self, candidates),
            elsewhere: |v| self.position(v),
        };
        let way = way_between(edges);
        let spacing = self.layer().map_or(f64::INFINITY, |l| l.settings.spacing);
        let is_at_rest = self.posed().rest.is_some();
        let slices = if is_at_rest { 1 } else { ((way / spacing).ceil() as usize).clamp(1, MOST_SLICES) };
        let share = |k: usize| k as f64 / slices as f64;
        let at_rest: Vec<_> = (0..=slices).map(|k| uncut.rest_edge(blade_at(edges, share(k)))).collect();
        let ends = [at_rest[0], at_rest[slices]];
        // the blades end in the air where they are carried to
        let off = |k: usize| at_rest[k].map(|p| distance_to_line(p, blade_at(ends, share(k)))).into_iter().fold(0.0, f64::max);
        if (1..slices).all(|k| off(k) <= BENT * way) {
            return ends.to_vec();
        }
        at_rest
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
