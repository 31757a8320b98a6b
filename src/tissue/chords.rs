//! Points inside the body, hung on its skin: a point divides a chord of the body through it, and goes on to divide it in every pose.
//! So it stays between two points of the skin, wherever their bones turn; bones of its own, blended from the skin, would carry it
//! out of the body near a joint, and far from its neighbours.

use super::Tissue;
use super::positions::Skins;
use super::sections::SECTION_MARGIN;
use crate::geometry::{FaceId, SectionId, VertexId};
use crate::surgery::insert::NewVertex;
use glam::{DVec2, DVec3, Vec2};

/// Ways that chords take: across each other, and in no plane that a blade is likely to move in, since corners lie in its walls.
const WAYS: [DVec3; 3] = [
    DVec3::new(6.0 / 7.0, 2.0 / 7.0, 3.0 / 7.0),
    DVec3::new(-3.0 / 7.0, 6.0 / 7.0, 2.0 / 7.0),
    DVec3::new(-2.0 / 7.0, -3.0 / 7.0, 6.0 / 7.0),
];

/// Faces whose projection along a chord is smaller than this, against the squared reach of their corners, are seen edge on.
const EDGE_ON: f64 = 1e-6;

/// Corners of the two faces that a chord ends on, with their shares of the point: they sum to 1.
pub(super) type Hanging = [(VertexId, f64); 6];

/// What a search for chords needs, kept between edits.
#[derive(Clone, Debug, Default)]
pub(super) struct ChordScratch {
    skins: Skins,
    /// One for each of [`WAYS`].
    bundles: [Bundle; 3],
}

/// The chords of all corners of an edit along one way: they lie near each other, so that the faces they may end on are looked for once.
#[derive(Clone, Debug, Default)]
struct Bundle {
    /// Bounds of the corners, seen along the way.
    corners: Window,
    /// What the faces cover, and the faces.
    covered: Window,
    faces: Vec<Ending>,
    /// Where vertices are seen, rounded: what most faces are ruled out by.
    seen: Skins<Vec2>,
}

/// A face that a chord may end on: its corners' vertices, and where bones alone put them.
#[derive(Clone, Copy, Debug)]
struct Ending {
    vertices: [VertexId; 3],
    corners: [DVec3; 3],
}

/// Low and high corner of a part of the plane across a way, metres.
#[derive(Clone, Copy, Debug)]
struct Window {
    low: DVec2,
    high: DVec2,
}

impl Default for Window {
    fn default() -> Self {
        Self { low: DVec2::INFINITY, high: DVec2::NEG_INFINITY }
    }
}

impl Window {
    fn around(points: impl Iterator<Item = DVec2>) -> Self {
        points.fold(Self::default(), |w, p| Self { low: w.low.min(p), high: w.high.max(p) })
    }

    fn meets(&self, other: &Self) -> bool {
        (self.low.cmple(other.high) & self.high.cmpge(other.low)).all()
    }

    /// In f32, larger by more than that rounds what is seen.
    fn rounded_outwards(&self) -> (Vec2, Vec2) {
        let rounding = 4.0 * f64::from(f32::EPSILON) * self.low.abs().max(self.high.abs());
        ((self.low - rounding).as_vec2(), (self.high + rounding).as_vec2())
    }
}

/// The plane across a way.
#[derive(Clone, Copy)]
struct Across([DVec3; 2]);

impl Across {
    fn to(way: DVec3) -> Self {
        let (one, other) = way.any_orthonormal_pair();
        Self([one, other])
    }

    fn of(&self, p: DVec3) -> DVec2 {
        DVec2::new(p.dot(self.0[0]), p.dot(self.0[1]))
    }

    /// A box as it is seen along the way, `margin` larger.
    fn of_box(&self, (low, high): (DVec3, DVec3), margin: f64) -> Window {
        let (middle, half) = (self.of((low + high) / 2.0), (high - low) / 2.0);
        let reach = DVec2::from(self.0.map(|axis| axis.abs().dot(half))) + margin;
        Window { low: middle - reach, high: middle + reach }
    }
}

/// Where a chord leaves the body.
#[derive(Clone, Copy)]
struct Exit {
    /// How far from the point, metres.
    away: f64,
    /// Corners of the face there, with their shares of the place.
    corners: [(VertexId, f64); 3],
    /// False if the face is seen from outside there.
    leaves: bool,
}

/// Faces of a bundle that room is made for at first.
const BUNDLE_ROOM: usize = 8192;

impl ChordScratch {
    /// Makes room for a tissue of so many vertices.
    pub(super) fn make_room(&mut self, vertices: usize) {
        self.skins.make_room(vertices);
        for bundle in &mut self.bundles {
            bundle.faces.reserve(BUNDLE_ROOM);
            bundle.seen.make_room(vertices);
        }
    }

    /// To be called when rows of vertices that there were may be other ones: after an undo or a redo.
    pub(super) fn forget(&mut self) {
        self.skins.forget();
        self.bundles.iter_mut().for_each(|bundle| bundle.seen.forget());
    }

    /// To be called before an edit's corners are hung: nothing is known of what the last ones hung on.
    pub(super) fn begin(&mut self, made: &[NewVertex]) {
        let corners = made.iter().filter(|n| n.parent_count == 0).map(|n| n.position);
        if corners.clone().next().is_none() {
            return;
        }
        for (bundle, way) in self.bundles.iter_mut().zip(WAYS) {
            let across = Across::to(way);
            bundle.corners = Window::around(corners.clone().map(|p| across.of(p)));
            bundle.covered = Window::default();
        }
    }
}

impl Tissue {
    /// What `p`, where bones alone put the corner that stands at `at`, hangs on: the shortest of three chords through it. `None` if none
    /// leaves the body both ways, or no bone moves anything. Walls are passed through. `made` lists the edit's vertices, whose rows may
    /// not be known yet. Call [`Tissue::refresh_sections`] and [`ChordScratch::begin`] first.
    pub(super) fn hang(&self, p: DVec3, at: DVec3, made: &[NewVertex], scratch: &mut ChordScratch) -> Option<Hanging> {
        if self.pose.joint_matrices.is_empty() {
            return None;
        }
        let ChordScratch { skins, bundles } = scratch;
        let mut best: Option<(f64, Hanging)> = None;
        for (way, bundle) in WAYS.into_iter().zip(bundles) {
            let across = Across::to(way);
            let seen = across.of(p);
            if !bundle.covered.meets(&Window { low: seen, high: seen }) {
                skins.refresh(self);
                bundle.seen.refresh(self);
                // the others are moved by about as much
                let moved = seen - across.of(at);
                let corners = Window { low: bundle.corners.low + moved, high: bundle.corners.high + moved };
                let (around, slack) =
                    (Window::around([seen, corners.low, corners.high].into_iter()), SECTION_MARGIN * self.diagonal);
                let spare = 0.1 * (around.high - around.low) + slack;
                bundle.covered = Window { low: around.low - spare, high: around.high + spare };
                self.list_endings(across, made, skins, bundle);
            }
            best = chord(p, way, across, best.map_or(f64::INFINITY, |b| b.0), &bundle.faces).or(best);
        }
        best.map(|b| b.1)
    }

    /// Lists the faces of the skin that are seen in the covered window.
    fn list_endings(&self, across: Across, made: &[NewVertex], skins: &Skins, bundle: &mut Bundle) {
        let rows = self.rows.len();
        let known = |mut v: VertexId| {
            while v.index() >= rows {
                v = made.iter().find(|m| m.vertex == v)?.parents[0].0;
            }
            Some(v)
        };
        let Bundle { covered, faces: endings, seen, .. } = bundle;
        let is_seen = |bounds: (DVec3, DVec3)| covered.meets(&across.of_box(bounds, SECTION_MARGIN * self.diagonal));
        let groups = self.sections.groups().filter(|(_, bounds)| is_seen(*bounds));
        let sections = groups.flat_map(|(group, _)| group).filter(|&s| is_seen(self.sections.of(s)));
        let faces = sections.flat_map(|s| self.mesh.section_faces(SectionId::new(s)));
        let is_skin = |f: &FaceId| !self.mesh.is_interior(*f);
        let (low, high) = covered.rounded_outwards();
        let at = |v: VertexId| seen.get(v, || across.of(skins.of(self, v)).as_vec2());
        let ending = |f: FaceId| {
            let mut vertices = self.mesh.face(f);
            if vertices.iter().any(|v| v.index() >= rows) {
                let [Some(a), Some(b), Some(c)] = vertices.map(known) else { return None };
                vertices = [a, b, c];
            }
            let [a, b, c] = [at(vertices[0]), at(vertices[1]), at(vertices[2])];
            let meets = a.min(b).min(c).cmple(high) & a.max(b).max(c).cmpge(low);
            meets.all().then(|| Ending { vertices, corners: vertices.map(|v| skins.of(self, v)) })
        };
        endings.clear();
        endings.extend(faces.filter(is_skin).filter_map(ending));
    }
}

/// Length and ends of the chord of the body through `p` along a way, if it is shorter than `limit`, among `faces`.
fn chord(p: DVec3, way: DVec3, across: Across, limit: f64, faces: &[Ending]) -> Option<(f64, Hanging)> {
    let mut exits = [None::<Exit>; 2];
    for Ending { vertices: [a, b, c], corners } in faces {
        let corners = corners.map(|c| c - p);
        let Some(shares) = origin_in(corners.map(|c| across.of(c).to_array())) else { continue };
        let along: f64 = shares.iter().zip(corners).map(|(w, c)| w * c.dot(way)).sum();
        let forth = along >= 0.0;
        let end = &mut exits[usize::from(forth)];
        if end.is_none_or(|e| along.abs() < e.away) {
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let leaves = (normal.dot(way) > 0.0) == forth;
            *end = Some(Exit { away: along.abs(), corners: [(*a, shares[0]), (*b, shares[1]), (*c, shares[2])], leaves });
        }
    }
    let [Some(a), Some(b)] = exits else { return None };
    let length = a.away + b.away;
    if !(a.leaves && b.leaves && length > 0.0 && length < limit) {
        return None;
    }
    let share = b.away / length;
    let [a0, a1, a2] = a.corners.map(|(v, w)| (v, w * share));
    let [b0, b1, b2] = b.corners.map(|(v, w)| (v, w * (1.0 - share)));
    Some((length, [a0, a1, a2, b0, b1, b2]))
}

/// The corners' shares of the origin, if it lies in their triangle.
fn origin_in([p, q, r]: [[f64; 2]; 3]) -> Option<[f64; 3]> {
    let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
    let parts = [cross(q, r), cross(r, p), cross(p, q)];
    if parts.iter().any(|&w| w < 0.0) && parts.iter().any(|&w| w > 0.0) {
        return None;
    }
    let whole: f64 = parts.iter().sum();
    let reach = [p, q, r].iter().map(|c| c[0] * c[0] + c[1] * c[1]).fold(0.0, f64::max);
    (whole.abs() > EDGE_ON * reach).then(|| parts.map(|w| w / whole))
}
