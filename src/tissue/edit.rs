//! What every edit of a tissue shares: inserted vertices get rows, influences and fades, so that nothing pops (MATHS 2.2);
//! and the plane cut itself. Tears are in [`super::stroke`].

use super::walls::LONGEST_ROW;
use super::{Posed, SoftLayer, Tissue, motions, springs};
use crate::diagnostics::Stages;
use crate::geometry::{HalfEdge, Plane, VertexId};
use crate::particles::{
    Influence, LipVertex, MapEdit, MapUpdateReport, ParticleMap, PlaneCutVertices, release_wound, update_after_edit,
    update_after_plane_cut,
};
use crate::rig::{displaced, final_position};
use crate::surgery::cap::{CapDress, CapOutcome, CapScratch, cap};
use crate::surgery::insert::NewVertex;
use crate::surgery::plane_cut::{PlaneCutOutcome, PlaneCutScratch, Reach, plane_cut_within};
use glam::DVec3;
use std::ops::Range;

/// Offsets below this are rounding and start no fade, as a fraction of the diagonal.
const FADE_THRESHOLD: f64 = 1e-10;

/// Buffers of a cut, kept between cuts.
#[derive(Debug, Default)]
pub struct CutScratch {
    /// Of the split.
    pub split: PlaneCutScratch,
    /// Of the caps.
    pub cap: CapScratch,
}

/// Where a cut along a plane has opened the surface.
#[derive(Clone, Copy)]
pub(super) struct Opened<'a> {
    /// Half-edges on the positive side, with their partners on the negative.
    pub rim: &'a [[HalfEdge; 2]],
    /// Pairs of rim vertices that the surface joins otherwise.
    pub taken: &'a [[VertexId; 2]],
    /// Vertices that the cut made, in order of their ids, without a gap.
    pub new_vertices: &'a [NewVertex],
}

/// Strips that an edit has pushed.
#[derive(Default)]
pub(super) struct NewStrips {
    pub(super) strips: Range<usize>,
    /// The one that the first of them goes on from, and what of their wound stood open: see [`MapEdit`].
    pub(super) goes_on_from: Option<usize>,
    pub(super) opened: [f64; 2],
}

impl Tissue {
    /// [`Tissue::cut`], and closes what was opened: each closed loop of the cut gets a cap on both sides (MATHS 6).
    pub fn cut_closed(&mut self, plane: &Plane, scratch: &mut CutScratch, stages: &mut Stages) -> (PlaneCutOutcome, CapOutcome) {
        let outcome = self.cut(plane, &mut scratch.split, stages);
        if outcome.missed() {
            return (outcome, CapOutcome::default());
        }
        let opened = Opened { rim: scratch.split.rim(), taken: scratch.split.taken(), new_vertices: &outcome.new_vertices };
        let capped = stages.time("caps", || self.cap(plane, opened, &mut scratch.cap));
        (outcome, capped)
    }

    /// Caps the closed loops of what was `opened` along `plane`.
    pub(super) fn cap(&mut self, plane: &Plane, opened: Opened<'_>, scratch: &mut CapScratch) -> CapOutcome {
        let dress = CapDress { normal: plane.normal(), material: self.cap_material() };
        let rest_normal = |tissue: &Posed<'_>, v: VertexId, normal: DVec3| {
            if tissue.pose.joint_matrices.is_empty() {
                return normal.as_vec3().to_array();
            }
            // cofactors take it to `normal` in this pose
            let linear = tissue.pose.blended_linear(tissue.rows, v);
            (linear.transpose() * normal).try_normalize().unwrap_or(normal).as_vec3().to_array()
        };
        let (mesh, posed) = self.split_borrow();
        let Opened { rim, taken, new_vertices: new } = opened;
        let first_new = new.first().map_or(u32::MAX, |n| n.vertex.0);
        let position = |v: VertexId| match v.0.checked_sub(first_new) {
            Some(i) => new[i as usize].position,
            None => posed.position(v),
        };
        let normal = |v: VertexId, n: DVec3| rest_normal(&posed, v, n);
        let outcome = cap(mesh, rim, taken, dress, position, normal, scratch);
        let (positive, negative) = outcome.added_faces.split_at(outcome.positive_faces);
        for (s, faces) in [positive, negative].into_iter().enumerate() {
            if let Some(&first) = faces.first() {
                // the cap's corners, and those of chains that got none
                let corners: Vec<VertexId> = rim.iter().map(|edge| self.mesh.from(edge[s])).collect();
                self.widen_section(self.mesh.face_info(first).section, corners.into_iter());
            }
        }
        outcome
    }

    /// Cuts the tissue in place along `plane` (tissue space) in the pose the user sees. The surface is opened along the
    /// plane; pieces are told apart by [`Tissue::component_faces`]. Untouched on a miss. Particles hold vertices of the other
    /// side that they held before until the pieces are taken apart.
    pub fn cut(&mut self, plane: &Plane, scratch: &mut PlaneCutScratch, stages: &mut Stages) -> PlaneCutOutcome {
        let key = self.position_key();
        let outcome = stages.time("split", || {
            self.refresh_sections();
            let mut faces = std::mem::take(&mut self.scratch.faces);
            let beyond = self.faces_across(plane, &mut faces);
            let (mesh, posed) = self.split_borrow();
            let reach = Reach { faces: &faces, beyond };
            let outcome = plane_cut_within(mesh, plane, reach, |v| posed.position(v), scratch);
            self.scratch.faces = faces;
            outcome
        });
        if !outcome.missed() {
            stages.time("rows", || self.add_vertices(&outcome.new_vertices));
            if stages.time("particle_map", || self.map_plane_cut(plane, scratch, &outcome)) {
                self.positions_kept(key);
            }
            self.versions.structure += 1;
        }
        outcome
    }

    /// Influences of the vertices that a plane cut made, and fades that hold them on the plane. False if other vertices may have
    /// got fades too.
    fn map_plane_cut(&mut self, plane: &Plane, cut: &PlaneCutScratch, outcome: &PlaneCutOutcome) -> bool {
        let still = self.is_still();
        let new = &outcome.new_vertices;
        let (pairs, copies) = new.split_at(2 * outcome.intersection_points);
        let Self { mesh, rows, rest, pose, fades, layer, time_s, scratch, .. } = &mut *self;
        let mut all_held = true;
        if let Some(SoftLayer { map, strips, network, settings, .. }) = layer {
            let copies: Vec<_> = copies.iter().map(|n| (n.vertex, n.parents[0].0)).collect();
            let pairs = pairs.chunks_exact(2).map(|p| ([p[0].vertex, p[1].vertex], [p[0].parents[0].0, p[0].parents[1].0]));
            let displacements: &[DVec3] = bytemuck::cast_slice(network.displacements());
            let value = |map: &ParticleMap, v: VertexId| {
                let moved = motions(map.influences.row(v.index()), displacements, network.turns());
                cut.value(v).unwrap_or_else(|| plane.value(final_position(rows, pose, fades, *time_s, v, moved)))
            };
            let on_positive_side = |map: &ParticleMap, v: VertexId| match value(map, v) {
                // on the plane: the side of the faces that are left around it
                0.0 => mesh.fan(v).map(|h| cut.value(mesh.to(h)).unwrap_or(0.0)).find(|&d| d != 0.0).is_none_or(|d| d > 0.0),
                d => d > 0.0,
            };
            let made = PlaneCutVertices { pairs, copies: &copies };
            all_held = update_after_plane_cut(rest, map, strips, made, on_positive_side, settings, &mut scratch.plane_update);
        }
        if !all_held {
            let report = self.update_map(new, &[], NewStrips::default(), &[]);
            self.scratch.update.reuse(report);
        } else if still {
            // what was promoted has a rest position of its own, rounded; all others stand on the plane by their rows
            let promoted: Vec<_> = new.iter().filter(|n| self.rows.is_base(n.vertex)).map(|n| (n.vertex, n.position)).collect();
            self.fade_from(promoted.into_iter());
        } else {
            self.fade_from(new.iter().map(|n| (n.vertex, n.position)));
        }
        all_held
    }

    /// The mesh to edit, and everything that final positions need.
    pub(super) fn split_borrow(&mut self) -> (&mut crate::geometry::Mesh, Posed<'_>) {
        let still = self.is_still();
        let Self { mesh, rows, rest, pose, fades, layer, time_s, .. } = self;
        let rest = (still && pose.joint_matrices.is_empty()).then_some(rest.as_slice());
        (mesh, Posed { rows, pose, fades, layer: layer.as_ref(), time_s: *time_s, still, rest })
    }

    /// Rows and rest positions of inserted vertices.
    pub(super) fn add_vertices(&mut self, new: &[NewVertex]) {
        self.scratch.chords.begin(new);
        for vertex in new {
            let id = if vertex.parent_count == 0 { self.push_corner(vertex, new) } else { self.push_inserted(vertex) };
            debug_assert_eq!(id, vertex.vertex);
            let rest = match *vertex.parents() {
                // of the same row
                [(original, 1.0)] if !self.rows.is_base(original) && !self.rows.is_base(id) => self.rest[original.index()],
                _ => self.rows.rest(id),
            };
            self.rest.push(rest);
        }
        self.widen_around_promoted(new);
        self.fades.follow(self.rows.len());
    }

    /// The row of an inserted vertex; one that would be too long is promoted to a base vertex (MATHS 1.4).
    fn push_inserted(&mut self, vertex: &NewVertex) -> VertexId {
        let entries: usize = vertex.parents().iter().map(|p| self.rows.rows.row(p.0.index()).len().max(1)).sum();
        if entries > LONGEST_ROW && self.rows.merged_len(vertex.parents()) > LONGEST_ROW {
            let skinned: DVec3 = vertex.parents().iter().map(|p| self.pose.skin(&self.rows, p.0) * p.1).sum();
            let bones = self.blended_bones(vertex.parents());
            let rest = self.solve_rest(&bones, skinned);
            self.promoted_vertices += 1;
            return self.push_base_apart(vertex.vertex, rest, &bones);
        }
        self.rows.push_embedded(vertex.parents())
    }

    /// Brings the particle map up to date after an edit and holds every vertex it concerns where it was: inserted ones on
    /// the cut edge, others at their own place. `removed` lists vertices that no face uses any more. `lips` are the lip
    /// sides of the new strips.
    pub(super) fn update_map(
        &mut self,
        new: &[NewVertex],
        removed: &[VertexId],
        strips: NewStrips,
        lips: &[LipVertex],
    ) -> MapUpdateReport {
        let Some(layer) = &mut self.layer else {
            self.fade_from(new.iter().map(|n| (n.vertex, n.position)));
            return MapUpdateReport::default();
        };
        let made = |n: &NewVertex| {
            let parents = n.parents.map(|p| p.0);
            crate::particles::NewVertex { vertex: n.vertex, parents, is_apart: n.parent_count == 0 }
        };
        let vertices = &mut self.scratch.new_vertices;
        vertices.clear();
        vertices.extend(new.iter().map(made));
        let NewStrips { strips, goes_on_from, opened } = strips;
        let edit = MapEdit { new_vertices: vertices, removed_vertices: removed, new_strips: strips, goes_on_from, opened, lips };
        let old_len = layer.map.influences.rows();
        let scratch = &mut self.scratch.update;
        let report =
            update_after_edit(&self.mesh, &self.rest, &mut layer.map, &mut layer.strips, &edit, &layer.settings, scratch);
        self.follow_update(&report, old_len, new);
        report
    }

    /// The blade has left a wound: it opens over all its length.
    pub(super) fn release_wound(&mut self, wound: u32) -> MapUpdateReport {
        let Some(layer) = &mut self.layer else { return MapUpdateReport::default() };
        let old_len = layer.map.influences.rows();
        let scratch = &mut self.scratch.update;
        let SoftLayer { map, strips, settings, .. } = layer;
        let report = release_wound((&self.mesh, &self.rest), map, strips, wound, settings, scratch);
        self.follow_update(&report, old_len, &[]);
        report
    }

    /// Brings the springs in line with an update of the map, and holds what it concerns where it was: `new` vertices, and those of the
    /// `old_len` before them whose row is another one.
    fn follow_update(&mut self, report: &MapUpdateReport, old_len: usize, new: &[NewVertex]) {
        let Some(layer) = &mut self.layer else { return };
        let (map, network) = (&layer.map, &mut layer.network);
        network.update_springs(map.len(), &report.relinked, |p| springs(map, p));
        self.start_particles(&report.particles_added);
        let rotates = self.layer.as_ref().is_some_and(|l| l.network.settings().rotations);
        let update = std::mem::take(&mut self.scratch.update);
        let relinked = update.rows_before().filter(|(v, _)| v.index() < old_len);
        if rotates {
            let mut targets = std::mem::take(&mut self.scratch.targets);
            targets.clear();
            let live = relinked.filter(|(v, _)| self.mesh.vertex_is_live(*v));
            targets.extend(live.map(|(v, before)| (v, self.position(v) + self.moved_from(v, before))));
            targets.extend(new.iter().map(|n| (n.vertex, n.position)));
            self.refresh_turns_held(&mut targets);
            self.fade_from(targets.iter().copied());
            self.scratch.targets = targets;
        } else {
            self.hold_relinked(relinked);
            self.fade_from(new.iter().map(|n| (n.vertex, n.position)));
        }
        self.scratch.update = update;
    }

    /// How far the particles carried a vertex with the influences `before`, less how far they do now, metres.
    fn moved_from(&self, v: VertexId, before: &[Influence]) -> DVec3 {
        let Some(layer) = &self.layer else { return DVec3::ZERO };
        let (displacements, turns) = (layer.displacements(), layer.network.turns());
        // what turns do depends on the place
        let at = if turns.is_empty() { DVec3::ZERO } else { self.pose.skin(&self.rows, v) };
        let carried = |row: &[Influence]| displaced(at, motions(row, displacements, turns));
        carried(before) - carried(layer.map.influences.row(v.index()))
    }

    /// Vertices whose influences were other ones stay where they stood; dead ones are passed over.
    pub(super) fn hold_relinked<'a>(&mut self, before: impl Iterator<Item = (VertexId, &'a [Influence])>) {
        for (v, row) in before {
            let moved = if self.mesh.vertex_is_live(v) { self.moved_from(v, row) } else { DVec3::ZERO };
            if moved != DVec3::ZERO {
                let offset = self.fades.offset(v, self.time_s);
                self.end_fade(v);
                self.start_fade(v, moved, offset);
            }
        }
    }

    /// Starts fades so that each vertex stands at its target now.
    pub(super) fn fade_from(&mut self, targets: impl Iterator<Item = (VertexId, DVec3)>) {
        for (v, target) in targets {
            self.end_fade(v);
            self.start_fade(v, target - self.position(v), DVec3::ZERO);
        }
    }

    /// How far the fade of a vertex moves it now, metres.
    pub(super) fn faded(&self, v: VertexId) -> DVec3 {
        let offset = self.fades.offset(v, self.time_s);
        if offset == DVec3::ZERO { offset } else { self.pose.blended_carry(&self.rows, v, offset) }
    }

    /// Ends the fade of a vertex, if it has one.
    fn end_fade(&mut self, v: VertexId) {
        self.versions.fades += u64::from(self.fades.offset(v, self.time_s) != DVec3::ZERO);
        self.fades.clear(v);
    }

    /// Starts the fade of a vertex without one, which is to stand `moved` from its place, and by `offset` of a fade that has ended.
    fn start_fade(&mut self, v: VertexId, moved: DVec3, offset: DVec3) {
        if offset != DVec3::ZERO || moved.length() > FADE_THRESHOLD * self.diagonal {
            self.fades.start(&self.rows, &self.pose, v, (moved, offset), self.time_s);
            self.versions.fades += 1;
        }
    }
}
