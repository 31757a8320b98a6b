//! Bounds of a tissue in any pose, from the boxes of what each joint moves (MATHS 5.8).

use super::camera::Bounds;
use super::view::TissueView;
use crate::geometry::{Turn, VertexId};
use glam::DVec3;
use std::ops::Range;

/// Rest positions of the vertices each joint moves (the last: of those that no joint moves).
#[derive(Debug, Default)]
pub struct RestBounds {
    joints: Vec<Bounds>,
}

impl RestBounds {
    /// Takes in the vertices `dirty`, or, in `full`, all there are. True if anything may have changed.
    pub fn grow(&mut self, view: &TissueView<'_>, dirty: impl Iterator<Item = Range<usize>>, full: bool) -> bool {
        let joints = view.pose.joint_matrices.len();
        if full || self.joints.len() != joints + 1 {
            self.joints.clear();
            self.joints.resize(joints + 1, Bounds::EMPTY);
            self.take_in(view, 0..view.rows.len());
            return true;
        }
        let mut any = false;
        for range in dirty {
            self.take_in(view, range);
            any = true;
        }
        any
    }

    /// What all boxes span, at rest.
    pub fn at_rest(&self) -> Bounds {
        self.joints.iter().fold(Bounds::EMPTY, |all, b| all.union(*b))
    }

    /// Takes in base vertices; embedded ones lie within their parents' hull.
    fn take_in(&mut self, view: &TissueView<'_>, vertices: Range<usize>) {
        let unmoved = self.joints.len() - 1;
        for v in vertices.filter(|&v| view.rows.is_base(VertexId::new(v))) {
            let rest = glam::Vec3::from_array(view.rows.rest_position[v]).as_dvec3();
            let bones = view.rows.bones.row(v);
            if bones.is_empty() {
                self.joints[unmoved] = self.joints[unmoved].with(rest);
            }
            for bone in bones.iter().filter(|b| b.weight > 0.0 && (b.joint as usize) < unmoved) {
                let joint = &mut self.joints[bone.joint as usize];
                *joint = joint.with(rest);
            }
        }
    }

    /// Union over joints of their posed boxes (MATHS 5.8).
    pub fn posed(&self, view: &TissueView<'_>) -> Bounds {
        let mut all = self.joints.last().copied().unwrap_or(Bounds::EMPTY);
        for (joint, matrix) in self.joints.iter().zip(&view.pose.joint_matrices) {
            all = all.union(transformed(*joint, |p| matrix.transform(p)));
        }
        all
    }
}

/// Farthest that turns carry anything within `bounds` (MATHS 5.8).
pub fn largest_turn(bounds: Bounds, turns: &[Turn]) -> f64 {
    if bounds.is_empty() {
        return 0.0;
    }
    let away = |t: &Turn| (t.about - bounds.min).abs().max((bounds.max - t.about).abs()).length();
    turns.iter().map(|t| t.size() * away(t)).fold(0.0, f64::max)
}

/// The box around a moved box; empty stays empty.
pub fn transformed(bounds: Bounds, transform: impl Fn(DVec3) -> DVec3) -> Bounds {
    if bounds.is_empty() {
        return Bounds::EMPTY;
    }
    bounds.corners().into_iter().fold(Bounds::EMPTY, |all, corner| all.with(transform(corner)))
}
