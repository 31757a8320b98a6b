//! Runs of face slots with bounds: of a large model that is partly out of sight, the part in sight is drawn (MATHS 5.8).
//!
//! Face slots are the order of drawing, so a cluster is a run of them and costs no index buffer. Files list faces that lie near each
//! other one after the other; where one does not, clusters overlap and less is left out, never too much.

use super::camera::Bounds;
use super::rest_bounds::transformed;
use super::view::TissueView;
use crate::geometry::room::headroom;
use crate::geometry::{FaceId, VertexId};
use crate::rig::JointMatrix;
use std::ops::Range;

/// Face slots a cluster.
const CLUSTER: usize = 1024;

/// Rest positions of what one joint moves in a cluster.
#[derive(Clone, Copy, Debug)]
struct Part {
    /// [`UNMOVED`] for what no joint moves.
    joint: u32,
    rest: Bounds,
}

const UNMOVED: u32 = u32::MAX;

/// Bounds of every 1024 face slots of one tissue, in the pose they were last asked for.
#[derive(Debug, Default)]
pub struct Clusters {
    parts: Vec<Vec<Part>>,
    /// Empty ones for slots to come.
    spare: Vec<Vec<Part>>,
    posed: Vec<Bounds>,
}

/// Joints that move the faces of a cluster, as many as there is room for at first.
const JOINTS: usize = 16;

impl Clusters {
    /// Takes in the faces of some slots as they are now. `anew` forgets all others: what a face slot once held is kept otherwise, so
    /// bounds only ever widen.
    pub fn grow(&mut self, view: &TissueView<'_>, slots: impl Iterator<Item = Range<usize>>, anew: bool) {
        let clusters = view.mesh.face_slots().div_ceil(CLUSTER);
        if anew {
            self.parts.clear();
            self.spare.resize_with(clusters + headroom(view.mesh.face_slots()) / CLUSTER, || Vec::with_capacity(JOINTS));
            self.parts.reserve(self.spare.len());
            self.posed.reserve(self.spare.len());
        }
        self.parts.resize_with(clusters, || self.spare.pop().unwrap_or_default());
        for f in slots.flatten().map(FaceId::new).filter(|&f| view.mesh.is_live(f)) {
            let parts = &mut self.parts[f.index() / CLUSTER];
            for v in view.mesh.face(f) {
                let row = view.rows.rows.row(v.index());
                if row.is_empty() {
                    add_base(parts, view, v);
                }
                row.iter().for_each(|entry| add_base(parts, view, entry.base));
            }
        }
        self.posed.clear();
    }

    /// The pose has changed.
    pub fn moved(&mut self) {
        self.posed.clear();
    }

    /// True if there is more than one: less than that is not worth the look.
    pub fn is_worth_a_look(&self) -> bool {
        self.parts.len() > 1
    }

    /// Calls `found` with the slots of each cluster whose bounds, tissue space and without displacements, pass `seen`.
    pub fn visit(&mut self, joints: &[JointMatrix], seen: impl Fn(Bounds) -> bool, mut found: impl FnMut(Range<u32>)) {
        if self.posed.len() != self.parts.len() {
            self.posed.clear();
            self.posed.extend(self.parts.iter().map(|parts| posed(parts, joints)));
        }
        for (k, &bounds) in self.posed.iter().enumerate() {
            if !bounds.is_empty() && seen(bounds) {
                let first = (k * CLUSTER) as u32;
                found(first..first + CLUSTER as u32);
            }
        }
    }
}

fn add_base(parts: &mut Vec<Part>, view: &TissueView<'_>, v: VertexId) {
    let rest = glam::Vec3::from_array(view.rows.rest_position[v.index()]).as_dvec3();
    let known = view.pose.joint_matrices.len() as u32;
    let bones = view.rows.bones.row(v.index());
    let joints = bones.iter().filter(|b| b.weight > 0.0 && b.joint < known).map(|b| b.joint);
    for joint in joints.chain(bones.is_empty().then_some(UNMOVED)) {
        match parts.iter_mut().find(|p| p.joint == joint) {
            Some(part) => part.rest = part.rest.with(rest),
            None => parts.push(Part { joint, rest: Bounds::EMPTY.with(rest) }),
        }
    }
}

fn posed(parts: &[Part], joints: &[JointMatrix]) -> Bounds {
    let place = |part: &Part| match joints.get(part.joint as usize) {
        Some(matrix) => transformed(part.rest, |p| matrix.transform(p)),
        None => part.rest,
    };
    parts.iter().fold(Bounds::EMPTY, |all, part| all.union(place(part)))
}
