//! What every edit of a tissue shares: inserted vertices get rows, influences and fades, so that nothing pops (MATHS 2.2);
//! and the plane cut itself. Tears are in [`super::stroke`].

use super::{Posed, Tissue, topology};
use crate::diagnostics::Stages;
use crate::geometry::{Plane, VertexId};
use crate::particles::{Influence, LipVertex, MapEdit, MapUpdateReport, update_after_edit};
use crate::surgery::insert::NewVertex;
use crate::surgery::plane_cut::{PlaneCutOutcome, PlaneCutScratch, plane_cut};
use glam::DVec3;
use std::ops::Range;

/// Offsets below this are rounding and start no fade, as a fraction of the diagonal.
const FADE_THRESHOLD: f64 = 1e-10;

impl Tissue {
    /// Cuts the tissue in place along `plane` (tissue space) in the pose the user sees. The surface is opened along the
    /// plane; pieces are told apart by [`Tissue::component_faces`]. Untouched on a miss.
    pub fn cut(&mut self, plane: &Plane, scratch: &mut PlaneCutScratch, stages: &mut Stages) -> PlaneCutOutcome {
        let outcome = stages.time("split", || {
            let (mesh, posed) = self.split_borrow();
            plane_cut(mesh, plane, |v| posed.position(v), scratch)
        });
        if !outcome.missed() {
            stages.time("rows", || self.add_vertices(&outcome.new_vertices));
            stages.time("particle_map", || self.update_map(&outcome.new_vertices, &[], 0..0, &[]));
            self.versions.structure += 1;
        }
        outcome
    }

    /// The mesh to edit, and everything that final positions need.
    pub(super) fn split_borrow(&mut self) -> (&mut crate::geometry::Mesh, Posed<'_>) {
        let Self { mesh, rows, pose, fades, layer, time_s, .. } = self;
        (mesh, Posed { rows, pose, fades, layer: layer.as_ref(), time_s: *time_s })
    }

    /// Rows and rest positions of inserted vertices.
    pub(super) fn add_vertices(&mut self, new: &[NewVertex]) {
        for vertex in new {
            let id = self.rows.push_embedded(vertex.parents());
            debug_assert_eq!(id, vertex.vertex);
            self.rest.push(self.rows.rest(id));
        }
        if !self.fades.entries.is_empty() {
            self.fades.entries.resize(self.rows.len(), [0.0; 4]);
        }
    }

    /// Brings the particle map up to date after an edit and holds every vertex it concerns where it was: inserted ones on
    /// the cut edge, others at their own place. `removed` lists vertices that no face uses any more. `strips` are new ones, already pushed; `lips` their lip sides.
    pub(super) fn update_map(
        &mut self,
        new: &[NewVertex],
        removed: &[VertexId],
        strips: Range<usize>,
        lips: &[LipVertex],
    ) -> MapUpdateReport {
        let Some(layer) = &mut self.layer else {
            self.fade_from(new.iter().map(|n| (n.vertex, n.position)));
            return MapUpdateReport::default();
        };
        let vertices: Vec<_> =
            new.iter().map(|n| crate::particles::NewVertex { vertex: n.vertex, parents: n.parents.map(|p| p.0) }).collect();
        let edit = MapEdit { new_vertices: &vertices, removed_vertices: removed, new_strips: strips, lips };
        let old_len = layer.map.influences.rows();
        let untouched = layer.map.influences.clone();
        let scratch = &mut self.scratch.update;
        let report =
            update_after_edit(&self.mesh, &self.rest, &mut layer.map, &mut layer.strips, &edit, &layer.settings, scratch);
        layer.network.set_topology(&topology(&layer.map), None);
        let displaced = |row: &[Influence]| -> DVec3 {
            row.iter().map(|i| layer.displacements()[i.particle.index()] * f64::from(i.weight)).sum()
        };
        let moved: Vec<(VertexId, DVec3)> = report
            .vertices_changed
            .iter()
            .filter(|v| v.index() < old_len && self.mesh.vertex_is_live(**v))
            .map(|&v| (v, displaced(untouched.row(v.index())) - displaced(layer.map.influences.row(v.index()))))
            .collect();
        let inserted = new.iter().map(|n| (n.vertex, n.position));
        let targets: Vec<(VertexId, DVec3)> =
            moved.into_iter().map(|(v, by)| (v, self.position(v) + by)).chain(inserted).collect();
        self.fade_from(targets.into_iter());
        report
    }

    /// Starts fades so that each vertex stands at its target now.
    pub(super) fn fade_from(&mut self, targets: impl Iterator<Item = (VertexId, DVec3)>) {
        let threshold = FADE_THRESHOLD * self.diagonal;
        for (v, target) in targets {
            let had = self.fades.offset(v, self.time_s) != DVec3::ZERO;
            self.fades.clear(v);
            let moved = target - self.position(v);
            if moved.length() > threshold {
                self.fades.start(&self.rows, &self.pose, v, moved, self.time_s);
            }
            self.versions.fades += u64::from(had || moved.length() > threshold);
        }
    }
}
