//! Linear-blend skinning on the CPU: the f64 twin of the shader, over the same f32 data (MATHS 1.1, 1.7).

use super::rows::{VertexRows, widen};
use crate::geometry::VertexId;
use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3};

/// A joint matrix `joint_world * inverse_bind` in tissue space: three rows of four f32, as the shader reads it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct JointMatrix {
    /// Row-major 3 x 4: each row is `[linear x3, translation]`.
    pub rows: [[f32; 4]; 3],
}

impl JointMatrix {
    /// The identity.
    pub const IDENTITY: Self = Self { rows: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] };

    /// Rounds an f64 transform once (MATHS 1.7).
    pub fn from_affine(m: glam::DAffine3) -> Self {
        let row = |r: usize| {
            [m.matrix3.x_axis[r] as f32, m.matrix3.y_axis[r] as f32, m.matrix3.z_axis[r] as f32, m.translation[r] as f32]
        };
        Self { rows: [row(0), row(1), row(2)] }
    }

    fn row(&self, r: usize) -> (DVec3, f64) {
        let [x, y, z, w] = self.rows[r];
        (glam::Vec3::new(x, y, z).as_dvec3(), f64::from(w))
    }

    /// Transforms a point, in f64.
    #[inline]
    pub fn transform(&self, p: DVec3) -> DVec3 {
        let at = |r: usize| {
            let (linear, translation) = self.row(r);
            linear.dot(p) + translation
        };
        DVec3::new(at(0), at(1), at(2))
    }

    /// Transforms a direction, in f64: the linear part alone.
    #[inline]
    pub fn carry(&self, c: DVec3) -> DVec3 {
        DVec3::new(self.row(0).0.dot(c), self.row(1).0.dot(c), self.row(2).0.dot(c))
    }

    /// As an f64 transform.
    pub fn affine(&self) -> glam::DAffine3 {
        let translation = DVec3::new(self.row(0).1, self.row(1).1, self.row(2).1);
        glam::DAffine3 { matrix3: self.linear(), translation }
    }

    /// The linear part, in f64.
    pub fn linear(&self) -> DMat3 {
        DMat3::from_cols(self.row(0).0, self.row(1).0, self.row(2).0).transpose()
    }
}

/// A pose: one matrix a joint. Empty for a static model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pose {
    /// Joint matrices, indexed by [`super::BoneWeight::joint`].
    pub joint_matrices: Vec<JointMatrix>,
}

impl Pose {
    /// Skinned position `s` of a vertex (MATHS 1.1).
    pub fn skin(&self, rows: &VertexRows, v: VertexId) -> DVec3 {
        let row = rows.rows.row(v.index());
        if row.is_empty() {
            return self.skin_base(rows, v);
        }
        row.iter().map(|e| self.skin_base(rows, e.base) * e.weight).sum()
    }

    /// Blended linear skin matrix `A` of a vertex (MATHS 2.2): that of a base vertex, the row's combination otherwise.
    pub fn blended_linear(&self, rows: &VertexRows, v: VertexId) -> DMat3 {
        let row = rows.rows.row(v.index());
        if row.is_empty() {
            return self.base_linear(rows, v);
        }
        row.iter().fold(DMat3::ZERO, |sum, e| sum + self.base_linear(rows, e.base) * e.weight)
    }

    /// `A c` for the blended linear skin matrix `A` of a vertex, which need not be known for it.
    pub fn blended_carry(&self, rows: &VertexRows, v: VertexId, c: DVec3) -> DVec3 {
        let base = |v: VertexId| {
            let bones = rows.bones.row(v.index());
            if bones.is_empty() {
                return c;
            }
            bones.iter().map(|b| self.joint_matrices[b.joint as usize].carry(c) * f64::from(b.weight)).sum()
        };
        let row = rows.rows.row(v.index());
        if row.is_empty() { base(v) } else { row.iter().map(|e| base(e.base) * e.weight).sum() }
    }

    #[inline]
    fn skin_base(&self, rows: &VertexRows, v: VertexId) -> DVec3 {
        let rest = widen(rows.rest_position[v.index()]);
        let bones = rows.bones.row(v.index());
        if bones.is_empty() {
            return rest;
        }
        bones.iter().map(|b| self.joint_matrices[b.joint as usize].transform(rest) * f64::from(b.weight)).sum()
    }

    fn base_linear(&self, rows: &VertexRows, v: VertexId) -> DMat3 {
        let bones = rows.bones.row(v.index());
        if bones.is_empty() {
            return DMat3::IDENTITY;
        }
        bones.iter().fold(DMat3::ZERO, |sum, b| sum + self.joint_matrices[b.joint as usize].linear() * f64::from(b.weight))
    }
}
