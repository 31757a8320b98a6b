//! Section bounds in the current pose (MATHS 5.8): where an edit need not look.

use crate::geometry::{Mesh, SectionId, VertexId};
use crate::rig::{JointMatrix, Pose, VertexRows};
use glam::{DAffine3, DVec3};

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

/// Bounds of every section, joint by joint at rest, and posed when asked for.
///
/// Rows of surface vertices are convex combinations of base vertices of the same section, so what an edit inserts stays
/// inside; only walls inside the volume widen them ([`SectionBounds::widen`]).
#[derive(Clone, Debug, Default)]
pub struct SectionBounds {
    start: Vec<u32>,
    joints: Vec<JointBounds>,
    posed: Vec<(DVec3, DVec3)>,
    posed_version: u64,
    /// The pose's joints; each moves boxes of many sections.
    frames: Vec<Frame>,
}

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
        let mut bounds = Self { start: vec![0], posed_version: u64::MAX, ..Self::default() };
        for s in 0..mesh.sections() {
            let first = bounds.joints.len();
            for v in mesh.section_faces(SectionId::new(s)).flat_map(|f| mesh.face(f)) {
                let row = rows.rows.row(v.index());
                if row.is_empty() {
                    bounds.add_base(first, rows, v);
                }
                for entry in row {
                    bounds.add_base(first, rows, entry.base);
                }
            }
            bounds.start.push(bounds.joints.len() as u32);
        }
        bounds
    }

    fn add_base(&mut self, first: usize, rows: &VertexRows, v: VertexId) {
        let rest = rows.rest(v);
        let bones = rows.bones.row(v.index());
        let statics = bones.is_empty().then_some(STATIC);
        for joint in bones.iter().filter(|b| b.weight != 0.0).map(|b| b.joint).chain(statics) {
            match self.joints[first..].iter_mut().find(|b| b.joint == joint) {
                Some(b) => (b.min, b.max) = (b.min.min(rest), b.max.max(rest)),
                None => self.joints.push(JointBounds { joint, min: rest, max: rest }),
            }
        }
    }

    /// Widens a section by the base vertices that `vertices` lean on, at rest and as last posed.
    pub fn widen_by(&mut self, section: SectionId, rows: &VertexRows, vertices: impl Iterator<Item = VertexId>, pose: &Pose) {
        let s = section.index();
        if s >= self.len() {
            return;
        }
        let after = self.start[s + 1] as usize;
        let mut own = Self { joints: self.joints[self.start[s] as usize..after].to_vec(), ..Self::default() };
        for v in vertices {
            let row = rows.rows.row(v.index());
            if row.is_empty() {
                own.add_base(0, rows, v);
            }
            for entry in row {
                own.add_base(0, rows, entry.base);
            }
        }
        let more = own.joints.len() - (after - self.start[s] as usize);
        self.joints.splice(self.start[s] as usize..after, own.joints);
        for start in &mut self.start[s + 1..] {
            *start += more as u32;
        }
        if let Some(posed) = self.posed.get_mut(s) {
            let range = self.start[s] as usize..self.start[s + 1] as usize;
            let frames: Vec<Frame> = pose.joint_matrices.iter().map(Frame::of).collect();
            *posed = pose_all(&self.joints[range], &frames);
        }
    }

    /// The bounds of some sections, for a piece that they come along with. They hold what is left of each, and may hold more.
    pub fn extract(&self, sections: &[SectionId]) -> Self {
        let mut part = Self { start: vec![0], posed_version: self.posed_version, ..Self::default() };
        for s in sections.iter().map(|s| s.index()).filter(|&s| s < self.len()) {
            part.joints.extend_from_slice(&self.joints[self.start[s] as usize..self.start[s + 1] as usize]);
            part.start.push(part.joints.len() as u32);
            part.posed.extend(self.posed.get(s));
        }
        part
    }

    /// Number of sections.
    fn len(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    /// What [`SectionBounds::posed`] last computed.
    pub fn current(&self) -> &[(DVec3, DVec3)] {
        &self.posed
    }

    /// Bounds of every section in `pose`, without displacements; recomputed only when `version` changes.
    pub fn posed(&mut self, pose: &Pose, version: u64) -> &[(DVec3, DVec3)] {
        if self.posed_version != version {
            self.posed_version = version;
            self.posed.clear();
            self.frames.clear();
            self.frames.extend(pose.joint_matrices.iter().map(Frame::of));
            for range in self.start.windows(2) {
                self.posed.push(pose_all(&self.joints[range[0] as usize..range[1] as usize], &self.frames));
            }
        }
        &self.posed
    }
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
