//! Section bounds in the current pose (MATHS 5.8): where an edit need not look.

use super::positions::Rounds;
use crate::geometry::{Mesh, SectionId, VertexId};
use crate::rig::{JointMatrix, Pose, VertexRows};
use glam::{DAffine3, DVec3};
use std::ops::Range;

/// Bounds of the rest positions that one joint moves; `joint` is [`STATIC`] for those that none does.
#[derive(Clone, Copy, Debug)]
struct JointBounds {
    joint: u32,
    min: DVec3,
    max: DVec3,
}

/// Bounds are widened by this fraction of the diagonal: bone weights are f32 and sum to 1 only to about 1e-7.
pub(super) const SECTION_MARGIN: f64 = 1e-6;

const STATIC: u32 = u32::MAX;

/// Sections that are looked at together: an edit need not look at any of them where it misses them all.
const GROUP: usize = 16;

/// Bounds by joint of many parts of a mesh.
#[derive(Clone, Debug)]
struct JointRows {
    start: Vec<u32>,
    joints: Vec<JointBounds>,
}

impl Default for JointRows {
    fn default() -> Self {
        Self { start: vec![0], joints: Vec::new() }
    }
}

impl JointRows {
    fn len(&self) -> usize {
        self.start.len() - 1
    }

    fn range(&self, row: usize) -> Range<usize> {
        self.start[row] as usize..self.start[row + 1] as usize
    }

    fn row(&self, row: usize) -> &[JointBounds] {
        &self.joints[self.range(row)]
    }

    /// Widens the row that has not ended yet.
    fn add(&mut self, by: &JointBounds) {
        let first = self.start[self.len()] as usize;
        if !join(&mut self.joints[first..], by) {
            self.joints.push(*by);
        }
    }

    /// Ends the row that the last joints belong to.
    fn end_row(&mut self) {
        self.start.push(self.joints.len() as u32);
    }

    /// Rows for runs of [`GROUP`] rows each.
    fn grouped(&self) -> Self {
        let mut groups = Self::default();
        for first in (0..self.len()).step_by(GROUP) {
            (first..(first + GROUP).min(self.len())).flat_map(|s| self.row(s)).for_each(|by| groups.add(by));
            groups.end_row();
        }
        groups
    }

    /// Widens a row by bounds.
    fn widen(&mut self, row: usize, by: &JointBounds) {
        let range = self.range(row);
        let end = range.end;
        if !join(&mut self.joints[range], by) {
            self.joints.insert(end, *by);
            self.start[row + 1..].iter_mut().for_each(|start| *start += 1);
        }
    }
}

/// Widens those of `joints` that have the joint of `by`; false if there are none.
fn join(joints: &mut [JointBounds], by: &JointBounds) -> bool {
    let known = joints.iter_mut().find(|b| b.joint == by.joint);
    known.map(|b| (b.min, b.max) = (b.min.min(by.min), b.max.max(by.max))).is_some()
}

/// Bounds of every section, joint by joint at rest, and posed when asked for.
///
/// Rows of surface vertices are convex combinations of base vertices of the same section, so what an edit inserts stays
/// inside; only walls inside the volume widen them ([`SectionBounds::widen_by`]).
#[derive(Clone, Debug, Default)]
pub struct SectionBounds {
    sections: JointRows,
    /// Of [`GROUP`] sections each.
    groups: JointRows,
    posed: Rounds<u64, Bounds>,
    posed_groups: Rounds<u64, Bounds>,
    /// The pose's joints; each moves boxes of many sections.
    frames: Vec<Frame>,
}

/// Low and high corner.
type Bounds = (DVec3, DVec3);

/// What moves a box: the columns of a joint's matrix in f64, their sizes, and the translation.
#[derive(Clone, Copy, Debug)]
struct Frame {
    columns: [DVec3; 3],
    sizes: [DVec3; 3],
    translation: DVec3,
}

impl Frame {
    fn of(matrix: &JointMatrix) -> Self {
        let DAffine3 { matrix3, translation } = matrix.affine();
        let columns = [matrix3.x_axis, matrix3.y_axis, matrix3.z_axis];
        Self { columns, sizes: columns.map(DVec3::abs), translation }
    }
}

impl SectionBounds {
    /// Gathers the bounds of every section's faces.
    pub fn build(mesh: &Mesh, rows: &VertexRows) -> Self {
        let mut sections = JointRows::default();
        for s in 0..mesh.sections() {
            for v in mesh.section_faces(SectionId::new(s)).flat_map(|f| mesh.face(f)) {
                each_base(rows, v, |by| sections.add(by));
            }
            sections.end_row();
        }
        Self { groups: sections.grouped(), sections, ..Self::default() }
    }

    /// Widens a section by the base vertices that `vertices` lean on.
    pub fn widen_by(&mut self, section: SectionId, rows: &VertexRows, vertices: impl Iterator<Item = VertexId>) {
        let s = section.index();
        if s >= self.len() {
            return;
        }
        for v in vertices {
            each_base(rows, v, |by| {
                self.sections.widen(s, by);
                self.groups.widen(s / GROUP, by);
            });
        }
        self.posed.forget(s);
        self.posed_groups.forget(s / GROUP);
    }

    /// The bounds of some sections, for a piece that they come along with. They hold what is left of each, and may hold more.
    pub fn extract(&self, from: &[SectionId]) -> Self {
        let mut sections = JointRows::default();
        for s in from.iter().map(|s| s.index()).filter(|&s| s < self.len()) {
            sections.joints.extend_from_slice(self.sections.row(s));
            sections.end_row();
        }
        Self { groups: sections.grouped(), sections, frames: self.frames.clone(), ..Self::default() }
    }

    /// Number of sections.
    pub fn len(&self) -> usize {
        self.sections.len()
    }

    /// To be called before bounds are asked for: takes up `pose`, if `version` is another than it was.
    pub fn refresh(&mut self, pose: &Pose, version: u64) {
        self.posed_groups.refresh(version, self.groups.len());
        if self.posed.refresh(version, self.sections.len()) {
            self.frames.clear();
            self.frames.extend(pose.joint_matrices.iter().map(Frame::of));
        }
    }

    /// Bounds of a section in the pose, without displacements.
    pub fn of(&self, section: usize) -> (DVec3, DVec3) {
        self.posed.get(section, || pose_all(self.sections.row(section), &self.frames))
    }

    /// Runs of sections, with bounds of each as a whole.
    pub fn groups(&self) -> impl Iterator<Item = (Range<usize>, (DVec3, DVec3))> {
        (0..self.groups.len()).map(|g| {
            let bounds = self.posed_groups.get(g, || pose_all(self.groups.row(g), &self.frames));
            (GROUP * g..(GROUP * (g + 1)).min(self.len()), bounds)
        })
    }
}

/// Rest positions that a vertex leans on, with the joints that move them.
fn each_base(rows: &VertexRows, v: VertexId, mut each: impl FnMut(&JointBounds)) {
    let mut base = |v: VertexId| {
        let rest = rows.rest(v);
        let bones = rows.bones.row(v.index());
        let statics = bones.is_empty().then_some(STATIC);
        for joint in bones.iter().filter(|b| b.weight != 0.0).map(|b| b.joint).chain(statics) {
            each(&JointBounds { joint, min: rest, max: rest });
        }
    };
    let row = rows.rows.row(v.index());
    if row.is_empty() {
        base(v);
    }
    row.iter().for_each(|entry| base(entry.base));
}

/// Box around all of a section's joints.
fn pose_all(joints: &[JointBounds], frames: &[Frame]) -> (DVec3, DVec3) {
    joints.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), b| {
        let (l, h) = pose_bounds(b, frames);
        (low.min(l), high.max(h))
    })
}

/// Box around a box transformed by its joint.
fn pose_bounds(b: &JointBounds, frames: &[Frame]) -> (DVec3, DVec3) {
    let Some(Frame { columns, sizes, translation }) = frames.get(b.joint as usize) else {
        return (b.min, b.max);
    };
    let (middle, half) = ((b.min + b.max) / 2.0, (b.max - b.min) / 2.0);
    let centre = columns[0] * middle.x + columns[1] * middle.y + columns[2] * middle.z + *translation;
    let reach = sizes[0] * half.x + sizes[1] * half.y + sizes[2] * half.z;
    (centre - reach, centre + reach)
}
