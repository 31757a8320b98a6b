//! A tissue's data on the GPU: its ranges in the arenas, what was uploaded last, and what has to be run again.

use super::arenas::{ArenaKind, Arenas, Slot};
use super::camera::Bounds;
use super::clusters::Clusters;
use super::context::Context;
use super::cpu_deform::Deformed;
use super::deform::GROUP;
use super::error::GpuError;
use super::groups::Groups;
use super::lips::Lips;
use super::rest_bounds::{RestBounds, largest_turn, transformed};
use super::types::{DISPLACED, FADING, FaceRecord, ROTATED, SKINNED, Term, TissueRecord, VertexRecord, WHOLE, WOUNDED};
use super::view::{DirtyRanges, TissueDirty, TissueView, ViewVersions};
use super::views::ViewPose;
use crate::geometry::room::{fit, headroom, with_headroom};
use crate::geometry::{FaceId, HalfEdge, VertexId};
use crate::rig::{FADE_BLOCK, JointMatrix};
use glam::{DAffine3, DVec3};
use std::ops::Range;

/// Most tissues: 15 bits of a face's draw word.
pub const MAX_TISSUES: usize = (1 << 15) - 1;

/// The slots of one tissue.
#[derive(Clone, Copy, Debug, Default)]
struct Slots {
    vertices: Slot,
    bones: Slot,
    rows: Slot,
    influences: Slot,
    joints: Slot,
    displacements: Slot,
    fades: Slot,
    rotations: Slot,
    faces: Slot,
    wedges: Slot,
    positions: Slot,
    normals: Slot,
}

impl Slots {
    fn all(&mut self) -> [(ArenaKind, &mut Slot); 12] {
        [
            (ArenaKind::Vertices, &mut self.vertices),
            (ArenaKind::Terms, &mut self.bones),
            (ArenaKind::Terms, &mut self.rows),
            (ArenaKind::Terms, &mut self.influences),
            (ArenaKind::Vectors, &mut self.joints),
            (ArenaKind::Vectors, &mut self.displacements),
            (ArenaKind::Vectors, &mut self.fades),
            (ArenaKind::Vectors, &mut self.rotations),
            (ArenaKind::Faces, &mut self.faces),
            (ArenaKind::Wedges, &mut self.wedges),
            (ArenaKind::Deformed, &mut self.positions),
            (ArenaKind::Deformed, &mut self.normals),
        ]
    }
}

/// One tissue on the GPU.
#[derive(Debug)]
pub struct GpuTissue {
    /// The record as it should be in the table.
    pub record: TissueRecord,
    stale: Stale,
    groups: Groups,
    /// Displacements as last uploaded.
    displacements: Vec<DVec3>,
    slots: Slots,
    versions: Option<ViewVersions>,
    /// Fades as uploaded, to find what changed.
    fades: Vec<[f32; 4]>,
    /// The latest of the writes that were looked at.
    fades_seen: u64,
    /// When the last fade ends, seconds.
    fades_end_s: f64,
    rest_bounds: RestBounds,
    posed: Bounds,
    largest_displacement: f64,
    rotated: bool,
    lips: Lips,
    /// It had no border at the last full upload.
    was_closed: bool,
    /// An edit has given it one since, and not all edits were undone.
    was_opened: bool,
    long_rows: bool,
    /// Farthest that a turned particle may carry a vertex.
    largest_turn: f64,
    /// Length of the longest fade, metres.
    largest_fade: f64,
    world_from_tissue: DAffine3,
    clusters: Clusters,
    /// Joint matrices of the last sync.
    joints: Vec<JointMatrix>,
    /// Where the CPU deforms: its scratch.
    deformed: Deformed,
}

/// What was computed and is out of date, until the next deform pass.
#[derive(Debug, Default)]
struct Stale {
    /// Everything.
    all: bool,
    /// What hangs on these particles.
    particles: Vec<bool>,
    any: bool,
}

impl GpuTissue {
    /// Nothing yet, at a place of the table.
    pub fn new(slot: u32) -> Self {
        Self {
            record: TissueRecord { slot, ..Default::default() },
            stale: Stale { all: true, ..Stale::default() },
            groups: Groups::default(),
            displacements: Vec::new(),
            slots: Slots::default(),
            versions: None,
            fades: Vec::new(),
            fades_seen: 0,
            fades_end_s: f64::NEG_INFINITY,
            rest_bounds: RestBounds::default(),
            posed: Bounds::EMPTY,
            largest_displacement: 0.0,
            rotated: false,
            lips: Lips::default(),
            was_closed: false,
            was_opened: false,
            long_rows: false,
            largest_turn: 0.0,
            largest_fade: 0.0,
            world_from_tissue: DAffine3::IDENTITY,
            clusters: Clusters::default(),
            joints: Vec::new(),
            deformed: Deformed::default(),
        }
    }

    /// True until the next deform pass if something computed is out of date.
    pub fn needs_deform(&self) -> bool {
        self.stale.all || self.stale.any
    }

    /// Calls `found` with stage (0: vertices, 1: wedges) and first element of every workgroup that has to run, which then is done.
    pub fn work(&mut self, mut found: impl FnMut(usize, u32)) {
        let Self { stale, groups, record, .. } = self;
        if stale.all {
            for (stage, count) in [record.vertex_count, record.wedge_count].into_iter().enumerate() {
                (0..count).step_by(GROUP as usize).for_each(|first| found(stage, first));
            }
        } else if stale.any {
            groups.visit(|j| stale.particles.get(j).copied().unwrap_or(true), found);
        }
        (stale.all, stale.any) = (false, false);
        stale.particles.fill(false);
    }

    /// True if some row has more than three entries, or had them before an undo.
    pub fn has_long_rows(&self) -> bool {
        self.long_rows
    }

    /// Face slots in the face arena: first and number.
    pub fn faces(&self) -> (u32, u32) {
        (self.slots.faces.start, self.slots.faces.len)
    }

    /// Final positions in the deformed arena.
    pub fn positions(&self) -> Slot {
        self.slots.positions
    }

    /// Final normals in the deformed arena.
    pub fn normals(&self) -> Slot {
        self.slots.normals
    }

    /// True if the materials were not seen in this version.
    pub fn wants_materials(&self, versions: ViewVersions) -> bool {
        self.versions.is_none_or(|v| v.materials != versions.materials)
    }

    /// Bounds at rest, world space.
    pub fn rest_bounds(&self) -> Bounds {
        let all = self.rest_bounds.at_rest();
        transformed(all, |p| self.world_from_tissue.transform_point3(p))
    }

    /// Bounds in the pose of the last sync, world space; wide enough for all displacements.
    pub fn posed_bounds(&self) -> Bounds {
        self.placed(self.posed, self.largest_displacement + self.largest_turn)
    }

    /// Bounds of posed positions widened by `reach`, world space.
    fn placed(&self, posed: Bounds, reach: f64) -> Bounds {
        let wide = Bounds { min: posed.min - reach, max: posed.max + reach };
        transformed(wide, |p| self.world_from_tissue.transform_point3(p))
    }

    /// Calls `found` with the slots of the face arena that some view may see. Returns the number of those that none can; all of
    /// them for a tissue out of sight.
    pub fn visible_faces(&mut self, views: &[ViewPose], mut found: impl FnMut(Range<u32>)) -> u32 {
        let Slot { start, len, .. } = self.slots.faces;
        let bounds = self.posed_bounds();
        if !views.iter().any(|v| v.may_see(&bounds)) {
            return len;
        }
        if !self.clusters.is_worth_a_look() || views.iter().any(|v| v.sees_whole(&bounds)) {
            found(start..start + len);
            return 0;
        }
        let reach = self.largest_displacement + self.largest_turn + self.largest_fade;
        let mut clusters = std::mem::take(&mut self.clusters);
        let mut seen = 0;
        let may_see = |posed: Bounds| {
            let bounds = self.placed(posed, reach);
            views.iter().any(|v| v.may_see(&bounds))
        };
        clusters.visit(&self.joints, may_see, |slots| {
            let end = slots.end.min(len);
            seen += end - slots.start;
            found(start + slots.start..start + end);
        });
        self.clusters = clusters;
        len - seen
    }

    /// GPU bytes in use.
    pub fn bytes(&self, arenas: &Arenas) -> u64 {
        { self.slots }.all().iter().map(|(kind, slot)| arenas.bytes_used(*kind, **slot)).sum()
    }

    /// Gives all ranges back.
    pub fn release(&mut self, arenas: &mut Arenas) {
        for (kind, slot) in self.slots.all() {
            arenas.release(kind, slot);
        }
    }

    /// Brings the GPU's copy up to date. On an error the tissue is unusable: release it.
    pub fn sync(
        &mut self,
        context: &Context,
        arenas: &mut Arenas,
        view: &TissueView<'_>,
        dirty: &TissueDirty,
    ) -> Result<(), GpuError> {
        let full = self.versions.is_none() || matches!(dirty, TissueDirty::Full);
        self.reserve(context, arenas, view)?;
        let whole;
        let ranges = match dirty {
            TissueDirty::Ranges(ranges) if !full => ranges,
            _ => {
                whole = full_ranges(view);
                &whole
            }
        };
        self.long_rows &= !full;
        if full {
            self.fades.clear();
            self.fades_seen = 0;
            self.was_closed = is_closed(view, 0..view.mesh.face_slots());
            self.was_opened = false;
            self.make_room(view);
            self.lips.make_room(view.mesh.vertex_slots());
        } else {
            let mut changed = clamped(&ranges.faces, view.mesh.face_slots() as u32);
            self.was_opened =
                !view.rows.rows.arena().is_empty() && (self.was_opened || !changed.all(|faces| is_closed(view, faces)));
        }
        self.upload_structure(arenas, view, ranges);
        if self.rest_bounds.grow(view, clamped(&ranges.vertices, view.rows.len() as u32), full) {
            self.posed = self.rest_bounds.posed(view);
        }
        self.clusters.grow(view, clamped(&ranges.faces, self.slots.faces.len), full);
        self.upload_motion(arenas, view);
        self.fill_record(view);
        if !context.deforms() {
            self.deform(arenas, view);
        }
        self.versions = Some(view.versions);
        Ok(())
    }

    /// Makes room for what particles move, at load.
    fn make_room(&mut self, view: &TissueView<'_>) {
        if view.displacements.is_empty() {
            return;
        }
        self.fades.reserve(2 * headroom(view.mesh.vertex_slots()));
        self.displacements.reserve(with_headroom(view.displacements.len()));
        self.stale.particles.reserve(with_headroom(view.displacements.len()));
        self.groups.make_room(with_headroom(view.mesh.vertex_slots()), with_headroom(view.mesh.wedges().len()));
    }

    /// The deform pass on the CPU.
    fn deform(&mut self, arenas: &mut Arenas, view: &TissueView<'_>) {
        if self.needs_deform() {
            self.stale = Stale::default();
            let Self { deformed, slots, .. } = self;
            deformed.compute(view, self.record.flags & FADING != 0);
            arenas.upload(ArenaKind::Deformed, slots.positions, 0..deformed.positions.len(), |v| deformed.positions[v]);
            arenas.upload(ArenaKind::Deformed, slots.normals, 0..deformed.normals.len(), |w| deformed.normals[w]);
        }
    }

    fn reserve(&mut self, context: &Context, arenas: &mut Arenas, view: &TissueView<'_>) -> Result<(), GpuError> {
        let (vertices, wedges) = (view.mesh.vertex_slots(), view.mesh.wedges().len());
        let fades = if view.fades.is_empty() { self.slots.fades.len as usize } else { vertices };
        let rotations = if view.rotations.is_empty() { self.slots.rotations.len as usize } else { view.rotations.len() * 3 };
        let lengths = [
            vertices,
            view.rows.bones.arena().len(),
            view.rows.rows.arena().len(),
            view.map.influences.arena().len(),
            view.pose.joint_matrices.len() * 3,
            view.displacements.len(),
            fades,
            rotations,
            view.mesh.face_slots(),
            wedges,
            vertices,
            wedges,
        ];
        let before = (self.slots.positions, self.slots.normals);
        for ((kind, slot), len) in self.slots.all().into_iter().zip(lengths) {
            // What the deform pass writes, it writes anew after a move.
            arenas.resize(context, kind, slot, len, kind != ArenaKind::Deformed)?;
        }
        // base vertices have no terms, and nothing fades before the first edit
        let none_yet = [(ArenaKind::Terms, &mut self.slots.rows), (ArenaKind::Vectors, &mut self.slots.fades)];
        for (kind, slot) in none_yet.into_iter().filter(|(_, slot)| slot.room == 0 && !view.displacements.is_empty()) {
            arenas.resize(context, kind, slot, vertices, false)?;
            slot.len = 0;
        }
        self.stale.all |= before != (self.slots.positions, self.slots.normals);
        Ok(())
    }

    fn upload_structure(&mut self, arenas: &mut Arenas, view: &TissueView<'_>, ranges: &DirtyRanges) {
        let slots = &self.slots;
        let before = arenas.bytes_uploaded();
        let (vertices, faces) = (clamped(&ranges.vertices, slots.vertices.len), clamped(&ranges.faces, slots.faces.len));
        let lips = &mut self.lips;
        lips.look(view, vertices, faces);
        for range in clamped(&ranges.vertices, slots.vertices.len) {
            self.long_rows |= range.clone().any(|v| view.rows.rows.row(v).len() > 3);
            arenas.upload(ArenaKind::Vertices, slots.vertices, range, |v| vertex_record(view, lips, v));
        }
        for v in lips.changed() {
            arenas.upload(ArenaKind::Vertices, slots.vertices, v..v + 1, |v| vertex_record(view, lips, v));
        }
        for range in clamped(&ranges.bones, slots.bones.len) {
            let bones = view.rows.bones.arena();
            let term = |k: usize| Term { index: bones[k].joint, weight: bones[k].weight };
            arenas.upload(ArenaKind::Terms, slots.bones, range, term);
        }
        for range in clamped(&ranges.rows, slots.rows.len) {
            let rows = view.rows.rows.arena();
            let term = |k: usize| Term { index: rows[k].base.0, weight: rows[k].weight as f32 };
            arenas.upload(ArenaKind::Terms, slots.rows, range, term);
        }
        for range in clamped(&ranges.influences, slots.influences.len) {
            let influences = view.map.influences.arena();
            let term = |k: usize| Term { index: influences[k].particle.0, weight: influences[k].weight };
            arenas.upload(ArenaKind::Terms, slots.influences, range, term);
        }
        for range in clamped(&ranges.faces, slots.faces.len) {
            let tissue = self.record.slot;
            arenas.upload(ArenaKind::Faces, slots.faces, range, |f| face_record(view, f, tissue));
        }
        for range in clamped(&ranges.wedges, slots.wedges.len) {
            arenas.upload(ArenaKind::Wedges, slots.wedges, range, |w| view.mesh.wedges()[w]);
        }
        if arenas.bytes_uploaded() != before {
            self.stale.all = true;
            self.groups.forget();
        }
    }

    /// Joint matrices, displacements and fades, each only if its version is new.
    fn upload_motion(&mut self, arenas: &mut Arenas, view: &TissueView<'_>) {
        let new = |pick: fn(&ViewVersions) -> u64| self.versions.is_none_or(|old| pick(&old) != pick(&view.versions));
        let (pose, displacements, fades) = (new(|v| v.pose), new(|v| v.displacements), new(|v| v.fades));
        let rotations = new(|v| v.rotations);
        if pose {
            let joints = &view.pose.joint_matrices;
            let row = |k: usize| joints[k / 3].rows[k % 3];
            arenas.upload(ArenaKind::Vectors, self.slots.joints, 0..joints.len() * 3, row);
            self.posed = self.rest_bounds.posed(view);
            self.joints.clone_from(joints);
            self.clusters.moved();
        }
        self.stale.all |= pose || fades || rotations;
        if displacements {
            let vector = |p: usize| view.displacements[p].as_vec3().extend(0.0).to_array();
            arenas.upload(ArenaKind::Vectors, self.slots.displacements, 0..view.displacements.len(), vector);
            self.largest_displacement = view.displacements.iter().map(|u| u.length()).fold(0.0, f64::max);
            self.note_displaced(view);
        }
        if rotations {
            let vector = |k: usize| {
                let turn = &view.rotations[k / 3];
                turn.spin.row(k % 3).extend(turn.about[k % 3]).as_vec4().to_array()
            };
            arenas.upload(ArenaKind::Vectors, self.slots.rotations, 0..view.rotations.len() * 3, vector);
            self.rotated = !view.rotations.is_empty();
        }
        if pose || rotations {
            self.largest_turn = largest_turn(self.posed, view.rotations);
        }
        if fades || self.fades.len() < view.fades.len() {
            self.upload_fades(arenas, view);
        }
    }

    /// Finds the particles whose displacement is another than it was, if that is all that has changed and it is known what hangs on
    /// them; else everything is out of date.
    fn note_displaced(&mut self, view: &TissueView<'_>) {
        let Self { stale, groups, displacements, .. } = self;
        let known = displacements.len() == view.displacements.len() && view.rotations.is_empty();
        if known && !stale.all && groups.advance(view) {
            stale.particles.truncate(displacements.len());
            fit(&mut stale.particles, displacements.len(), false);
            for ((stale, old), new) in stale.particles.iter_mut().zip(&*displacements).zip(view.displacements) {
                *stale |= old != new;
            }
            stale.any = true;
        } else {
            stale.all = true;
        }
        displacements.truncate(view.displacements.len());
        fit(displacements, view.displacements.len(), DVec3::ZERO);
        displacements.copy_from_slice(view.displacements);
    }

    /// Uploads the fades that differ from those on the GPU. Blocks that were not written since are not looked at.
    fn upload_fades(&mut self, arenas: &mut Arenas, view: &TissueView<'_>) {
        if view.time_s >= self.fades_end_s || view.fades_written.is_empty() {
            // all that runs comes anew
            (self.fades_end_s, self.largest_fade) = (f64::NEG_INFINITY, 0.0);
        }
        let (known, len) = (self.fades.len().min(view.fades.len()), view.fades.len());
        // what comes after those on the GPU is whatever was there
        arenas.clear(ArenaKind::Vectors, self.slots.fades, known..len);
        self.fades.truncate(known);
        fit(&mut self.fades, len, [0.0; 4]);
        let (seen, mut dirty) = (self.fades_seen, None::<Range<usize>>);
        for (block, fades) in view.fades.chunks(FADE_BLOCK).enumerate() {
            let written = view.fades_written.get(block).copied();
            self.fades_seen = self.fades_seen.max(written.unwrap_or(0));
            if written.is_some_and(|at| at <= seen) && (block + 1) * FADE_BLOCK <= known {
                continue;
            }
            for (v, fade) in (block * FADE_BLOCK..).zip(fades) {
                if fade[..3] != [0.0; 3] {
                    self.largest_fade = self.largest_fade.max(f64::from(fade[0].abs() + fade[1].abs() + fade[2].abs()));
                    self.fades_end_s = self.fades_end_s.max(f64::from(fade[3]) + view.fade_duration_s);
                }
                if self.fades[v].map(f32::to_bits) == fade.map(f32::to_bits) {
                    continue;
                }
                self.fades[v] = *fade;
                match &mut dirty {
                    Some(run) if v <= run.end + 8 => run.end = v + 1,
                    _ => {
                        if let Some(run) = dirty.replace(v..v + 1) {
                            arenas.upload(ArenaKind::Vectors, self.slots.fades, run, |k| view.fades[k]);
                        }
                    }
                }
            }
        }
        if let Some(run) = dirty {
            arenas.upload(ArenaKind::Vectors, self.slots.fades, run, |k| view.fades[k]);
        }
    }

    fn fill_record(&mut self, view: &TissueView<'_>) {
        let slots = &self.slots;
        let fading = !view.fades.is_empty() && view.time_s < self.fades_end_s;
        // When the last fade has ended, one more pass takes it off.
        self.stale.all |= fading || self.record.flags & FADING != 0;
        let flag = |on: bool, bit: u32| if on { bit } else { 0 };
        let time_high = if fading { view.time_s as f32 } else { 0.0 };
        let size = view.diagonal;
        self.world_from_tissue = view.world_from_tissue;
        self.record = TissueRecord {
            world_from_tissue: TissueRecord::rows_of(view.world_from_tissue),
            vertices: slots.vertices.start,
            vertex_count: slots.vertices.len,
            bones: slots.bones.start,
            rows: slots.rows.start,
            influences: slots.influences.start,
            faces: slots.faces.start,
            face_count: slots.faces.len,
            wedges: slots.wedges.start,
            wedge_count: slots.wedges.len,
            joints: slots.joints.start,
            displacements: slots.displacements.start,
            fades: slots.fades.start,
            rotations: slots.rotations.start,
            positions: slots.positions.start,
            normals: slots.normals.start,
            flags: flag(!view.pose.joint_matrices.is_empty(), SKINNED)
                | flag(self.largest_displacement > 0.0, DISPLACED)
                | flag(fading, FADING)
                | flag(self.rotated, ROTATED | DISPLACED)
                | flag(!view.rows.rows.arena().is_empty(), WOUNDED)
                | flag(self.was_closed && !self.was_opened, WHOLE),
            time_high,
            time_low: if fading { (view.time_s - f64::from(time_high)) as f32 } else { 0.0 },
            fade_duration: view.fade_duration_s as f32,
            detail_scale: if size > 0.0 { (1.0 / size) as f32 } else { 1.0 },
            ..self.record
        };
    }
}

/// True if none of these faces (slots) has a border.
fn is_closed(view: &TissueView<'_>, mut faces: Range<usize>) -> bool {
    let mesh = view.mesh;
    let has_border = |f: FaceId| (0..3).any(|k| mesh.opposite(HalfEdge::of(f, k)).is_none());
    faces.all(|f| !mesh.is_live(FaceId::new(f)) || !has_border(FaceId::new(f)))
}

fn clamped(ranges: &[Range<usize>], len: u32) -> impl Iterator<Item = Range<usize>> + '_ {
    let len = len as usize;
    ranges.iter().map(move |r| r.start.min(len)..r.end.min(len)).filter(|r| !r.is_empty())
}

/// Everything, as ranges; they are clamped on use.
fn full_ranges(view: &TissueView<'_>) -> DirtyRanges {
    let all = |len: usize| Vec::from([Range { start: 0, end: len }]);
    DirtyRanges {
        vertices: all(view.mesh.vertex_slots()),
        bones: all(view.rows.bones.arena().len()),
        rows: all(view.rows.rows.arena().len()),
        influences: all(view.map.influences.arena().len()),
        faces: all(view.mesh.face_slots()),
        wedges: all(view.mesh.wedges().len()),
    }
}

/// What has no bones of its own says in their place whether it is on a lip.
fn vertex_record(view: &TissueView<'_>, lips: &Lips, v: usize) -> VertexRecord {
    let span = |spans: &[crate::geometry::Span]| spans.get(v).map_or([0, 0], |s| [s.start, s.len]);
    VertexRecord {
        rest: view.rows.rest_position[v],
        half_edge: view.mesh.all_vertex_half_edges()[v].0,
        bones: if view.rows.is_base(VertexId::new(v)) { span(view.rows.bones.spans()) } else { [u32::from(lips.contains(v)), 0] },
        row: span(view.rows.rows.spans()),
        influences: span(view.map.influences.spans()),
    }
}

fn face_record(view: &TissueView<'_>, f: usize, tissue: u32) -> FaceRecord {
    let info = view.mesh.all_face_infos()[f];
    let wall = info.is_interior();
    let [a, b, c] = view.mesh.all_face_wedges()[f].map(|w| w.0);
    let is_live = view.mesh.is_live(FaceId::new(f));
    FaceRecord {
        // dead faces are drawn as points
        wedges: if is_live { [a, b, c] } else { [a; 3] },
        draw: info.material.min(0xffff) | tissue << 16 | u32::from(wall) << 31,
        opposites: view.mesh.all_opposites()[f].map(|h| h.0),
        section: info.section.0,
    }
}
