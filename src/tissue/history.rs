//! Going back and forth between the states of a tissue (MATHS 7), and checking them.

use super::{SoftLayer, Tissue, TissueDelta, springs, topology};
use crate::geometry::{Distinct, ParticleId, Plane, VertexId};
use glam::DVec3;
use std::sync::Arc;

/// A network of more particles than this, half of which have other springs, is laid out anew: neighbours lie near each other again.
const MANY_PARTICLES: usize = 1024;

/// Ascending, each once.
fn sorted<T: Ord>(items: impl Iterator<Item = T>) -> Vec<T> {
    let mut items: Vec<T> = items.collect();
    items.sort_unstable();
    items.dedup();
    items
}

impl TissueDelta {
    /// Empty, with room for what so many usual edits change.
    pub fn with_room(edits: usize) -> Self {
        let mut delta = Self::default();
        delta.mesh.make_room(edits);
        delta.rows.make_room(edits);
        delta.map.make_room(edits);
        delta.strips.make_room(edits);
        delta
    }

    /// Bytes that a GPU mirror needs to follow: the records of what differs, each once.
    pub fn upload_bytes(&self, distinct: &mut Distinct) -> usize {
        let Self { mesh, rows, map, .. } = self;
        let spans = rows.rows.spans.written().chain(rows.bones.spans.written()).chain(map.influences.spans.written());
        let vertices = distinct.count(mesh.vertex_half_edge.written().chain(rows.rest_position.written()).chain(spans));
        let corners = mesh.faces.written().chain(mesh.face_wedges.written());
        let faces = distinct.count(corners.chain(mesh.opposite.written()).chain(mesh.face_info.written()));
        vertices * VERTEX_BYTES
            + faces * FACE_BYTES
            + mesh.wedges.dirty_bytes(distinct)
            + rows.rows.entries.dirty_bytes(distinct) / 2 // weights travel as f32
            + rows.bones.entries.dirty_bytes(distinct)
            + map.influences.entries.dirty_bytes(distinct)
    }

    /// Adds what the next edit changed.
    pub fn append(&mut self, later: &Self) {
        self.mesh.append(&later.mesh);
        self.rows.append(&later.rows);
        self.map.append(&later.map);
        self.strips.append(&later.strips);
    }
}

/// Bytes of a vertex' record on the GPU: rest position, half-edge, and where its bones, row and influences lie.
const VERTEX_BYTES: usize = 40;
/// Bytes of a face's: wedges, opposite half-edges, material, section.
const FACE_BYTES: usize = 32;

impl Tissue {
    /// Applies deltas, last to first, and returns those that lead back. Vertices that stay alive fade from where they stand,
    /// those of `pieces` that go back into the tissue from where they stand in them, and particles that stay keep their displacements.
    pub fn travel<'a>(
        &mut self,
        deltas: Vec<Arc<TissueDelta>>,
        pieces: impl Iterator<Item = &'a Tissue>,
    ) -> Vec<Arc<TissueDelta>> {
        let mut before = self.stands_of(&deltas);
        if self.layer.is_some() {
            before.extend(pieces.flat_map(Tissue::stands_in_parent));
        }
        let mut fresh = self.without_anchor(&deltas);
        let relinked = sorted(deltas.iter().flat_map(|d| d.map.neighbours.changed_rows()).map(ParticleId::new));
        let inverse = deltas.into_iter().rev().map(|delta| Arc::new(self.apply(Arc::unwrap_or_clone(delta)))).collect();
        self.scratch.hands.pulls.under_blade = None;
        self.follow_rows();
        if let Some(SoftLayer { map, network, .. }) = &mut self.layer {
            if map.len() > MANY_PARTICLES && 2 * relinked.len() > map.len() {
                network.set_topology(&topology(map), None);
            } else {
                network.update_springs(map.len(), &relinked, |p| springs(map, p));
            }
            fresh.retain(|p| map.anchors.get(p.index()).is_some_and(|anchor| anchor.is_some()));
        }
        self.forget_lost_holds();
        self.start_particles(&fresh);
        self.refresh_turns();
        self.hold(before);
        self.versions.structure += 1;
        self.versions.displacements += 1;
        inverse
    }

    /// Where every vertex stands, if anything displaces them.
    pub(crate) fn stands(&self) -> Vec<(VertexId, DVec3)> {
        match &self.layer {
            Some(_) => self.mesh.live_vertices().map(|v| (v, self.position(v))).collect(),
            None => Vec::new(),
        }
    }

    /// Where those vertices stand that applying `deltas` may move, if anything displaces them: what their skinning and influences are, the
    /// deltas tell; turned particles may move any.
    fn stands_of(&self, deltas: &[Arc<TissueDelta>]) -> Vec<(VertexId, DVec3)> {
        let Some(layer) = &self.layer else { return Vec::new() };
        if layer.network.settings().rotations || !layer.network.turns().is_empty() {
            return self.stands();
        }
        let touched = deltas.iter().flat_map(|delta| {
            let TissueDelta { rows, map, .. } = &**delta;
            rows.rest_position
                .touched()
                .chain(rows.rows.changed_rows())
                .chain(rows.bones.changed_rows())
                .chain(map.influences.changed_rows())
        });
        let is_live = |v: &VertexId| v.index() < self.mesh.vertex_slots() && self.mesh.vertex_is_live(*v);
        sorted(touched.map(VertexId::new)).into_iter().filter(is_live).map(|v| (v, self.position(v))).collect()
    }

    /// Particles without anchor that applying `deltas` may give one.
    fn without_anchor(&self, deltas: &[Arc<TissueDelta>]) -> Vec<ParticleId> {
        let Some(layer) = &self.layer else { return Vec::new() };
        let has_none = |p: &ParticleId| layer.map.anchors.get(p.index()).is_none_or(|anchor| anchor.is_none());
        sorted(deltas.iter().flat_map(|delta| delta.map.anchors.touched()).map(ParticleId::new).filter(has_none))
    }

    /// Fades those of the vertices that are live, and elsewhere, from where they stood.
    pub(crate) fn hold(&mut self, stood: Vec<(VertexId, DVec3)>) {
        let threshold = 1e-10 * self.diagonal;
        let moved: Vec<_> = stood
            .into_iter()
            .filter(|(v, _)| v.index() < self.mesh.vertex_slots() && self.mesh.vertex_is_live(*v))
            .filter(|(v, target)| self.position(*v).distance(*target) > threshold)
            .collect();
        self.fade_from(moved.into_iter());
    }

    /// Takes back what the mesh noted since its last delta.
    pub(super) fn step_back(&mut self) {
        self.note_edits();
        let mut delta = std::mem::take(&mut self.scratch.taken_back);
        self.mesh.take_delta_into(&mut delta);
        self.mesh.exchange_delta(&mut delta);
        self.note_travel(&delta);
        self.scratch.taken_back = delta;
    }

    fn apply(&mut self, delta: TissueDelta) -> TissueDelta {
        let (map, strips) = match &mut self.layer {
            Some(layer) => (layer.map.apply_delta(delta.map), layer.strips.apply_delta(delta.strips)),
            None => Default::default(),
        };
        let mesh = self.mesh.apply_delta(delta.mesh);
        self.note_travel(&mesh);
        TissueDelta { mesh, rows: self.rows.apply_delta(delta.rows), map, strips }
    }

    /// Brings the arrays derived from rows to their length.
    fn follow_rows(&mut self) {
        let len = self.rows.len();
        self.rest.truncate(len);
        for v in self.rest.len()..len {
            self.rest.push(self.rows.rest(VertexId::new(v)));
        }
        self.fades.follow(len);
        self.versions.fades += 1;
    }

    /// Bytes of everything that a GPU mirrors of a fresh tissue.
    pub fn full_upload_bytes(&self) -> usize {
        let influences = self.layer.as_ref().map_or(0, |l| l.map.influences.arena().len());
        self.mesh.face_slots() * FACE_BYTES
            + self.mesh.wedges().len() * 32
            + self.rows.len() * VERTEX_BYTES
            + (self.rows.rows.arena().len() + self.rows.bones.arena().len() + influences) * 8
    }

    /// Number of terms of the longest row.
    pub fn longest_row(&self) -> usize {
        self.rows.rows.spans().iter().map(|s| s.len as usize).max().unwrap_or(0)
    }

    /// The side of `plane` (tissue space) that the tissue lies on: by its sections, as a cut has brought them to the pose, or by
    /// the vertex farthest from the plane.
    pub fn side_of(&self, plane: &Plane) -> i8 {
        let mut near = Vec::new();
        match self.faces_across(plane, &mut near) {
            [true, false] if near.is_empty() => return 1,
            [false, true] if near.is_empty() => return -1,
            _ => {}
        }
        let away = |p: &DVec3| plane.distance(*p).abs();
        let farthest = self.mesh.live_vertices().map(|v| self.position(v)).max_by(|a, b| away(a).total_cmp(&away(b)));
        if farthest.is_some_and(|p| plane.value(p) < 0.0) { -1 } else { 1 }
    }

    /// Checks every structure from scratch.
    pub fn validate(&self) -> Result<(), String> {
        self.mesh.validate().map_err(|e| e.to_string())?;
        self.rows.validate()?;
        self.rig.validate().map_err(|e| e.to_string())?;
        if self.rows.len() != self.mesh.vertex_slots() || self.rest.len() != self.rows.len() {
            return Err(format!("{} rows for {} vertices", self.rows.len(), self.mesh.vertex_slots()));
        }
        self.validate_sections()?;
        if let Some(layer) = &self.layer {
            layer.strips.validate()?;
            layer.map.validate(&self.mesh, &self.rest, &layer.strips)?;
            layer.network.check_springs(layer.map.len(), |p| springs(&layer.map, p))?;
        }
        Ok(())
    }

    /// Every vertex of a section lies in the section's posed bounds.
    fn validate_sections(&self) -> Result<(), String> {
        let mut sections = self.sections.clone();
        let margin = DVec3::splat(super::sections::SECTION_MARGIN * self.diagonal);
        sections.refresh(&self.pose, u64::MAX);
        for f in self.mesh.live_faces() {
            let (low, high) = sections.of(self.mesh.face_info(f).section.index());
            for v in self.mesh.face(f) {
                let p = self.skinned(v);
                if p.cmplt(low - margin).any() || p.cmpgt(high + margin).any() {
                    return Err(format!("{v:?} of {f:?} lies outside the bounds of its section"));
                }
            }
        }
        Ok(())
    }
}
