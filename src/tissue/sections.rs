//! Section bounds in the current pose (MATHS 5.8): where an edit need not look.

use super::positions::Rounds;
use crate::geometry::room::headroom;
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
    /// Bounds at rest of those parts whose joints' bounds reach beyond them: what hangs on a chord of the body leans on its far ends.
    rest: Vec<Option<Bounds>>,
}

impl Default for JointRows {
    fn default() -> Self {
        Self { start: vec![0], joints: Vec::new(), rest: Vec::new() }
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
    fn end_row(&mut self, rest: Option<Bounds>) {
        self.start.push(self.joints.len() as u32);
        self.rest.push(rest);
    }

    /// Bounds of a row at rest.
    fn rest_of(&self, row: usize) -> Bounds {
        self.rest[row].unwrap_or_else(|| unite(self.row(row).iter().map(|b| (b.min, b.max))))
    }

    /// None, with room for so many rows of a joint each.
    fn with_room(rows: usize) -> Self {
        let mut start = Vec::with_capacity(rows + 1);
        start.push(0);
        Self { start, joints: Vec::with_capacity(rows), rest: Vec::with_capacity(rows) }
    }

    /// Rows for runs of [`GROUP`] rows each.
    fn grouped(&self) -> Self {
        let mut groups = Self::with_room(self.len().div_ceil(GROUP));
        for first in (0..self.len()).step_by(GROUP) {
            let group = first..(first + GROUP).min(self.len());
            group.clone().flat_map(|s| self.row(s)).for_each(|by| groups.add(by));
            let reaches_beyond = self.rest[group.clone()].iter().any(Option::is_some);
            groups.end_row(reaches_beyond.then(|| unite(group.map(|s| self.rest_of(s)))));
        }
        groups
    }

    /// Makes room for what edits add.
    fn make_room(&mut self) {
        self.joints.reserve(headroom(self.joints.len()));
    }

    /// Widens a row by what a vertex that rests at `rest` leans on.
    fn widen_by(&mut self, row: usize, rest: DVec3, leans_on: impl FnOnce(&mut dyn FnMut(&JointBounds))) {
        let (low, high) = self.rest_of(row);
        self.rest[row] = Some((low.min(rest), high.max(rest)));
        leans_on(&mut |by| self.widen(row, by));
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
/// inside; only walls inside the volume and vertices that are promoted widen them ([`SectionBounds::widen_by`]).
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
        Self::new([matrix3.x_axis, matrix3.y_axis, matrix3.z_axis], translation)
    }

    fn new(columns: [DVec3; 3], translation: DVec3) -> Self {
        Self { columns, sizes: columns.map(DVec3::abs), translation }
    }

    fn mean<'a>(frames: impl Iterator<Item = &'a Self> + Clone) -> Self {
        let share = 1.0 / frames.clone().count().max(1) as f64;
        let columns = [0, 1, 2].map(|k| frames.clone().map(|f| f.columns[k]).sum::<DVec3>() * share);
        Self::new(columns, frames.map(|f| f.translation).sum::<DVec3>() * share)
    }

    /// What it moves by more than another does.
    fn less(&self, other: &Self) -> Self {
        Self::new([0, 1, 2].map(|k| self.columns[k] - other.columns[k]), self.translation - other.translation)
    }

    /// Box around a box that it has moved.
    fn pose(&self, (low, high): Bounds) -> Bounds {
        let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
        let [x, y, z] = self.columns;
        let centre = x * middle.x + y * middle.y + z * middle.z + self.translation;
        let reach = self.sizes[0] * half.x + self.sizes[1] * half.y + self.sizes[2] * half.z;
        (centre - reach, centre + reach)
    }
}

impl SectionBounds {
    /// Gathers the bounds of every section's faces.
    pub fn build(mesh: &Mesh, rows: &VertexRows) -> Self {
        let mut sections = JointRows::default();
        for s in 0..mesh.sections() {
            for v in mesh.section_faces(SectionId::new(s)).flat_map(|f| mesh.face(f)) {
                each_base(rows, |v| rows.rest(v), v, |by| sections.add(by));
            }
            sections.end_row(None);
        }
        Self { groups: sections.grouped(), sections, ..Self::default() }
    }

    /// Makes room for bones that sections lean on after edits.
    pub fn make_room(&mut self) {
        self.sections.make_room();
        self.groups.make_room();
    }

    /// Widens a section by the base vertices that `vertices` lean on. `rest` has the rest position of each.
    pub fn widen_by(&mut self, section: SectionId, rows: &VertexRows, rest: &[DVec3], vertices: impl Iterator<Item = VertexId>) {
        let s = section.index();
        if s >= self.len() {
            return;
        }
        let Self { sections, groups, .. } = self;
        let (mut low, mut high) = sections.rest_of(s);
        // what one joint moves is gathered before the section is widened by it: mostly that is all
        let mut gathered: Option<JointBounds> = None;
        for v in vertices {
            let at = rest[v.index()];
            (low, high) = (low.min(at), high.max(at));
            sections.rest[s] = Some((low, high));
            let gather = |by: &JointBounds| {
                if let Some(known) = &mut gathered
                    && join(std::slice::from_mut(known), by)
                {
                    return;
                }
                if let Some(last) = gathered.replace(*by) {
                    sections.widen(s, &last);
                }
            };
            each_base(rows, |v| rest[v.index()], v, gather);
        }
        if let Some(last) = gathered {
            sections.widen(s, &last);
        }
        // the group holds all its sections
        let (low, high) = sections.rest_of(s);
        groups.widen_by(s / GROUP, low, |each| sections.row(s).iter().for_each(each));
        groups.widen_by(s / GROUP, high, |_| {});
        self.posed.forget(s);
        self.posed_groups.forget(s / GROUP);
    }

    /// The bounds of some sections, for a piece that they come along with. They hold what is left of each, and may hold more.
    pub fn extract(&self, from: &[SectionId]) -> Self {
        let mut sections = JointRows::with_room(from.len());
        for s in from.iter().map(|s| s.index()).filter(|&s| s < self.len()) {
            sections.joints.extend_from_slice(self.sections.row(s));
            sections.end_row(self.sections.rest[s]);
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
        self.posed.get(section, || self.sections.posed(section, &self.frames))
    }

    /// Runs of sections, with bounds of each as a whole.
    pub fn groups(&self) -> impl Iterator<Item = (Range<usize>, (DVec3, DVec3))> {
        (0..self.groups.len()).map(|g| {
            let bounds = self.posed_groups.get(g, || self.groups.posed(g, &self.frames));
            (GROUP * g..(GROUP * (g + 1)).min(self.len()), bounds)
        })
    }
}

/// Rest positions that a vertex leans on, with the joints that move them.
fn each_base(rows: &VertexRows, rest: impl Fn(VertexId) -> DVec3, v: VertexId, mut each: impl FnMut(&JointBounds)) {
    let mut base = |v: VertexId| {
        let rest = rest(v);
        let bones = rows.bones.row(v.index());
        let mut moved = |joint: u32| each(&JointBounds { joint, min: rest, max: rest });
        if bones.is_empty() {
            moved(STATIC);
        }
        bones.iter().filter(|b| b.weight != 0.0).for_each(|b| moved(b.joint));
    };
    let row = rows.rows.row(v.index());
    if row.is_empty() {
        base(v);
    }
    row.iter().for_each(|entry| base(entry.base));
}

impl JointRows {
    /// Box around a row in a pose.
    fn posed(&self, row: usize, frames: &[Frame]) -> Bounds {
        let still = Frame::of(&JointMatrix::IDENTITY);
        let joints = || self.row(row).iter().map(|b| (frames.get(b.joint as usize).unwrap_or(&still), (b.min, b.max)));
        let (low, high) = unite(joints().map(|(frame, bounds)| frame.pose(bounds)));
        let Some(rest) = self.rest[row] else { return (low, high) };
        // What joints together move from x, is moved by their mean, and besides by shares of what each moves otherwise: that is little
        // where they move alike, however far off what they move by themselves is.
        let mean = Frame::mean(joints().map(|(frame, _)| frame));
        let (from, to) = mean.pose(rest);
        let (less, more) = unite(joints().map(|(frame, bounds)| frame.less(&mean).pose(bounds)));
        (low.max(from + less), high.min(to + more))
    }
}

/// Box around boxes.
fn unite(bounds: impl Iterator<Item = Bounds>) -> Bounds {
    bounds.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), (l, h)| (low.min(l), high.max(h)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::random::draw;
    use glam::{DMat3, DQuat};

    /// A section on one side of a body that two joints move, with a corner on a chord to its other side.
    fn row(reaches_beyond: bool) -> (JointRows, [JointBounds; 2], DVec3) {
        let skin = JointBounds { joint: 0, min: DVec3::new(0.9, 0.0, 0.0), max: DVec3::new(1.0, 0.1, 0.1) };
        let ends = [(0, 0.95), (1, -1.0)].map(|(joint, x)| {
            let at = DVec3::new(x, 0.05, 0.05);
            JointBounds { joint, min: at, max: at }
        });
        let corner = 0.9 * ends[0].min + 0.1 * ends[1].min;
        let mut rows = JointRows::default();
        rows.add(&skin);
        rows.end_row(None);
        rows.widen_by(0, corner, |each| ends.iter().for_each(each));
        if !reaches_beyond {
            rows.rest[0] = None;
        }
        (rows, ends, corner)
    }

    fn frame(turn: f64, shift: DVec3) -> Frame {
        let m = DMat3::from_quat(DQuat::from_rotation_z(turn));
        Frame::new([m.x_axis, m.y_axis, m.z_axis], shift)
    }

    #[test]
    fn bounds_hold_what_hangs_on_the_far_side_and_stay_small() {
        let (rows, ends, corner) = row(true);
        let mut counter = 0;
        let mut unit = || {
            counter += 1;
            (draw(9, counter) >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
        };
        for size in [0.0, 0.02, 0.3, 3.0] {
            for _ in 0..50 {
                let mut any = || frame(size * unit(), size * DVec3::new(unit(), unit(), unit()));
                let frames = [any(), any()];
                let moved = |k: usize, p: DVec3| {
                    let [x, y, z] = frames[k].columns;
                    x * p.x + y * p.y + z * p.z + frames[k].translation
                };
                let at = 0.9 * moved(0, ends[0].min) + 0.1 * moved(1, ends[1].min);
                let (low, high) = rows.posed(0, &frames);
                let skin = [moved(0, DVec3::new(0.9, 0.0, 0.0)), moved(0, DVec3::new(1.0, 0.1, 0.1))];
                for p in skin.into_iter().chain([at]) {
                    let (from, to) = (low - SECTION_MARGIN, high + SECTION_MARGIN);
                    assert!(p.cmpge(from).all() && p.cmple(to).all(), "{size}: {p} outside {low} .. {high}");
                }
                if size < 0.1 {
                    // what the joints move by more than each other adds, and not the chord
                    assert!((high - low).x < 0.3 + 8.0 * size, "{size}: {low} .. {high} around {corner}");
                }
            }
        }
        // broken twin: without its bounds at rest the section is as long as the chord
        let still = [frame(0.0, DVec3::ZERO), frame(0.0, DVec3::ZERO)];
        let (low, high) = row(false).0.posed(0, &still);
        assert!((high - low).x > 1.9);
    }
}
