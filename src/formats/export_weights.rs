//! Plain skin weights for embedded vertices (MATHS 1.8): glTF cannot carry rows, so on export a vertex gets the blended
//! weights of its parents, pruned to four joints, and the rest position that puts it where it is in the exported pose.

use crate::geometry::VertexId;
use crate::rig::{BoneWeight, Pose, VertexRows};
use glam::{DAffine3, DMat3, DVec3};

/// Stands for "no joint moves it": the share of parents without bones.
pub(crate) const STATIC: u32 = u32::MAX;
/// Joints that an embedded vertex keeps.
const KEPT: usize = 4;
/// Below this smallest singular value of the blended matrix, the dominant joint alone is used (MATHS 1.8).
const SINGULAR: f64 = 0.05;

/// A vertex as a file carries it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PlainVertex {
    /// Rest position, tissue space.
    pub rest: DVec3,
    /// Weights that sum to 1; empty for a vertex that no joint moves.
    pub bones: Vec<(u32, f64)>,
}

/// The plain form of a vertex, exact in `pose` but for rounding.
pub(crate) fn plain(rows: &VertexRows, pose: &Pose, v: VertexId) -> PlainVertex {
    let row = rows.rows.row(v.index());
    if row.is_empty() {
        let bones = rows.bones.row(v.index()).iter().map(|b| (b.joint, f64::from(b.weight))).collect();
        return PlainVertex { rest: rows.rest(v), bones };
    }
    let mut bones = blended(rows, v);
    if bones.iter().all(|b| b.0 == STATIC) {
        return PlainVertex { rest: rows.rest(v), bones: Vec::new() };
    }
    let posed = pose.skin(rows, v);
    let matrix = blend(pose, &bones);
    if smallest_singular_value(matrix.matrix3) >= SINGULAR {
        return PlainVertex { rest: matrix.inverse().transform_point3(posed), bones };
    }
    bones.truncate(1); // the dominant one: they are sorted
    bones[0].1 = 1.0;
    let matrix = blend(pose, &bones);
    let solvable = matrix.matrix3.determinant().abs() > 1e-12;
    let rest = if solvable { matrix.inverse().transform_point3(posed) } else { rows.rest(v) };
    PlainVertex { rest, bones }
}

/// Weights of the parents, merged, the four largest kept and normalised; sorted by falling weight.
fn blended(rows: &VertexRows, v: VertexId) -> Vec<(u32, f64)> {
    let mut bones: Vec<(u32, f64)> = Vec::new();
    let mut add = |joint: u32, weight: f64| match bones.iter_mut().find(|b| b.0 == joint) {
        Some(bone) => bone.1 += weight,
        None => bones.push((joint, weight)),
    };
    for entry in rows.rows.row(v.index()) {
        let parents: &[BoneWeight] = rows.bones.row(entry.base.index());
        if parents.is_empty() {
            add(STATIC, entry.weight);
        }
        for bone in parents {
            add(bone.joint, entry.weight * f64::from(bone.weight));
        }
    }
    bones.retain(|b| b.1 > 0.0);
    bones.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    bones.truncate(KEPT);
    let sum: f64 = bones.iter().map(|b| b.1).sum();
    for bone in &mut bones {
        bone.1 = f64::from((bone.1 / sum) as f32); // what the file will hold
    }
    bones
}

/// The blended matrix of plain weights.
pub(crate) fn blend(pose: &Pose, bones: &[(u32, f64)]) -> DAffine3 {
    let zero = DAffine3 { matrix3: DMat3::ZERO, translation: DVec3::ZERO };
    bones.iter().fold(zero, |sum, &(joint, weight)| {
        let m = if joint == STATIC { DAffine3::IDENTITY } else { pose.joint_matrices[joint as usize].affine() };
        DAffine3 { matrix3: sum.matrix3 + m.matrix3 * weight, translation: sum.translation + m.translation * weight }
    })
}

/// Smallest singular value, by the eigenvalues of the symmetric `m^T m` in closed form.
fn smallest_singular_value(m: DMat3) -> f64 {
    let a = m.transpose() * m;
    let (xx, yy, zz) = (a.x_axis.x, a.y_axis.y, a.z_axis.z);
    let off = DVec3::new(a.y_axis.x, a.z_axis.x, a.z_axis.y);
    let mean = (xx + yy + zz) / 3.0;
    let d = DVec3::new(xx - mean, yy - mean, zz - mean);
    let p = ((d.length_squared() + 2.0 * off.length_squared()) / 6.0).sqrt();
    if p <= 1e-15 * mean.abs() {
        return mean.max(0.0).sqrt();
    }
    let half_determinant = ((a - DMat3::from_diagonal(DVec3::splat(mean))) * (1.0 / p)).determinant() * 0.5;
    let angle = half_determinant.clamp(-1.0, 1.0).acos() / 3.0;
    let smallest = mean + 2.0 * p * (angle + std::f64::consts::TAU / 3.0).cos();
    smallest.max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::SlotCsr;
    use crate::rig::JointMatrix;

    fn two_joints(angle: f64) -> (VertexRows, Pose) {
        let bones = |w: f32| {
            [BoneWeight { joint: 0, weight: 1.0 - w }, BoneWeight { joint: 1, weight: w }].into_iter().filter(|b| b.weight > 0.0)
        };
        let table: Vec<Vec<BoneWeight>> = [0.25, 0.75].iter().map(|&w| bones(w).collect()).collect();
        let rest = vec![[0.4, 0.1, 0.0], [0.6, 0.1, 0.0]];
        let mut rows = VertexRows::from_base(rest, SlotCsr::from_rows(table.iter().map(Vec::as_slice)));
        rows.push_embedded(&[(VertexId(0), 0.3), (VertexId(1), 0.7)]);
        let turn = DAffine3::from_rotation_z(angle);
        (rows, Pose { joint_matrices: vec![JointMatrix::IDENTITY, JointMatrix::from_affine(turn)] })
    }

    #[test]
    fn exact_in_the_exported_pose_and_nowhere_else() {
        let (rows, pose) = two_joints(1.0);
        let vertex = plain(&rows, &pose, VertexId(2));
        let error =
            |pose: &Pose| (blend(pose, &vertex.bones).transform_point3(vertex.rest) - pose.skin(&rows, VertexId(2))).length();
        assert!(error(&pose) < 1e-15);
        assert!(error(&two_joints(0.3).1) > 1e-4, "the control: plain weights cannot follow a row");
    }

    #[test]
    fn a_singular_blend_falls_back_to_the_dominant_joint() {
        let (mut rows, pose) = two_joints(std::f64::consts::PI);
        let even = rows.push_embedded(&[(VertexId(0), 0.49), (VertexId(1), 0.51)]);
        let vertex = plain(&rows, &pose, even);
        assert_eq!(vertex.bones, [(1, 1.0)]);
        assert!((blend(&pose, &vertex.bones).transform_point3(vertex.rest) - pose.skin(&rows, even)).length() < 1e-6);
    }

    #[test]
    fn singular_values() {
        let of = |d: [f64; 3]| {
            let q = DMat3::from_quat(glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.0, 2.0));
            smallest_singular_value(q * DMat3::from_diagonal(DVec3::from_array(d)) * q.transpose())
        };
        for (d, smallest) in [([1.0, 1.0, 1.0], 1.0), ([3.0, -0.5, 2.0], 0.5), ([1.0, 0.0, 2.0], 0.0), ([2.0, 2.0, 0.1], 0.1)] {
            assert!((of(d) - smallest).abs() < 1e-7, "{d:?}: {}", of(d));
        }
    }
}
