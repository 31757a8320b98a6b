//! Section bounds in the current pose (MATHS 5.8): where an edit need not look.

use crate::geometry::{Mesh, SectionId, VertexId};
use crate::rig::{Pose, VertexRows};
use glam::DVec3;

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

    /// Widens a section by the base vertices that `v` leans on, at rest and as last posed.
    pub fn widen(&mut self, section: SectionId, rows: &VertexRows, v: VertexId, pose: &Pose) {
        self.widen_by(section, rows, std::iter::once(v), pose);
    }

    /// [`SectionBounds::widen`] by many vertices.
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
            *posed = pose_all(&self.joints[range], pose);
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
            for s in 0..self.len() {
                let range = self.start[s] as usize..self.start[s + 1] as usize;
                self.posed.push(pose_all(&self.joints[range], pose));
            }
        }
        &self.posed
    }
}

/// Box around all of a section's joints.
fn pose_all(joints: &[JointBounds], pose: &Pose) -> (DVec3, DVec3) {
    joints.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), b| {
        let (l, h) = pose_bounds(b, pose);
        (low.min(l), high.max(h))
    })
}

/// Box around a box transformed by its joint.
fn pose_bounds(b: &JointBounds, pose: &Pose) -> (DVec3, DVec3) {
    let Some(matrix) = pose.joint_matrices.get(b.joint as usize) else {
        return (b.min, b.max);
    };
    let centre = matrix.transform((b.min + b.max) / 2.0);
    let linear = matrix.linear();
    let half = (b.max - b.min) / 2.0;
    let reach = linear.x_axis.abs() * half.x + linear.y_axis.abs() * half.y + linear.z_axis.abs() * half.z;
    (centre - reach, centre + reach)
}
