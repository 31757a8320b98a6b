//! Tear boxes: convex hulls of two joint quads, as ten exact half-spaces (MATHS 5.2, 5.3).
//!
//! A joint quad has the corners tip-, tip+, base+, base- (0 to 3): counter-clockwise seen from ahead, so its normal is
//! the direction of travel. Corners lie on a dyadic grid about 1e-12 of the model's diagonal wide, and `tip- = tip - h`,
//! `tip+ = tip + h` and so on hold without rounding: a quad is an exact parallelogram, its four corners are exactly
//! coplanar, and the blade's line lies exactly in its plane.

use glam::DVec3;
use robust::{Coord3D, orient3d};

/// A joint: a sample's plane, where two boxes of a chain meet. Ids rise in the order of the stroke.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JointId(pub u32);

/// A plane of a stroke. The two boxes at a joint name it by the same id; all other planes have their own. A vertex made
/// on a plane carries the plane's id as its tag (MATHS 5.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PlaneId(pub u32);

/// Which side of a box a plane bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    /// The joint that the blade comes from.
    Start,
    /// The joint that the blade goes to.
    End,
    /// Below the tip.
    Floor,
    /// The lip at tip+ and base+.
    Plus,
    /// Above the entry.
    Top,
    /// The lip at tip- and base-.
    Minus,
}

/// The lateral sides in the order of the quad edges that they hold: edge `k` runs from corner `k` to corner `k + 1`.
pub const LATERAL_SIDES: [Side; 4] = [Side::Floor, Side::Plus, Side::Top, Side::Minus];

/// Exact side of `p` to the plane through `triple`: positive on the side from which the triple runs counter-clockwise,
/// zero only if the four points are exactly coplanar. (Shewchuk's predicate, sign turned.)
#[inline]
pub fn plane_side(triple: &[DVec3; 3], p: DVec3) -> f64 {
    let c = |v: DVec3| Coord3D { x: v.x, y: v.y, z: v.z };
    -orient3d(c(triple[0]), c(triple[1]), c(triple[2]), c(p))
}

/// A half-space by three points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfSpace {
    /// Three points of the plane. Both boxes at a joint have the same triple (tip-, tip+, base+), bit for bit.
    pub points: [DVec3; 3],
    /// True where the outward normal is the opposite of the triple's (start planes).
    pub flipped: bool,
    /// The plane's tag.
    pub id: PlaneId,
    /// The side that it bounds.
    pub side: Side,
}

impl HalfSpace {
    /// Exact: positive outside, negative inside, 0 on the plane. The magnitude is six times a tetrahedron's volume.
    #[inline]
    pub fn sign(&self, p: DVec3) -> f64 {
        let side = plane_side(&self.points, p);
        if self.flipped { -side } else { side }
    }

    /// Outward unit normal (rounded).
    pub fn normal(&self) -> DVec3 {
        let [a, b, c] = self.points;
        let n = (b - a).cross(c - a).normalize_or_zero();
        if self.flipped { -n } else { n }
    }
}

/// A joint's quad in the making and after: the clipped blade and half of the width vector, all on the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointFrame {
    /// The point of the blade.
    pub tip: DVec3,
    /// The upper end of the clipped blade.
    pub top: DVec3,
    /// From the blade's line to the plus side; its length is `w / (2 cos(theta / 2))`.
    pub half: DVec3,
}

impl JointFrame {
    /// Corners tip-, tip+, base+, base-.
    pub fn quad(&self) -> [DVec3; 4] {
        [self.tip - self.half, self.tip + self.half, self.top + self.half, self.top - self.half]
    }

    /// The parallelogram nearest to four corners that have been moved, on the grid (MATHS 5.5).
    pub fn fitted(quad: &[DVec3; 4], grid: Grid) -> Self {
        let mid = |a: DVec3, b: DVec3| grid.snap(a + (b - a) * 0.5);
        let half = ((quad[1] - quad[0]) + (quad[2] - quad[3])) * 0.25;
        Self { tip: mid(quad[0], quad[1]), top: mid(quad[3], quad[2]), half: grid.snap(half) }
    }
}

/// The dyadic grid that corners lie on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Spacing, metres: a power of two near 1e-12 of the diagonal.
    pub step: f64,
}

impl Grid {
    /// The grid for a model of this diagonal (metres).
    pub fn new(diagonal: f64) -> Self {
        let exponent = if diagonal > 0.0 && diagonal.is_finite() { diagonal.log2().ceil().clamp(-400.0, 400.0) } else { 0.0 };
        Self { step: 2f64.powi(exponent as i32 - 40) }
    }

    /// The nearest grid point.
    pub fn snap(self, v: DVec3) -> DVec3 {
        // Adding zero turns -0 into 0, so that equal places have equal bits.
        (v / self.step).round() * self.step + DVec3::ZERO
    }
}

/// What a chain goes on from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ChainStart {
    /// It begins by itself, or goes on from a joint that it shares.
    #[default]
    Free,
    /// The box that ended at this joint, without sharing it: the wound is one all the same.
    Box(JointId),
    /// A box that came the other way: the wound ends there.
    Hairpin,
}

/// The convex hull of two joint quads: ten half-spaces. Corners 0 to 3 are the start quad's, 4 to 7 the end quad's.
#[derive(Clone, Debug, PartialEq)]
pub struct TearBox {
    /// Start and end quad: corners tip-, tip+, base+, base-.
    pub quads: [[DVec3; 4]; 2],
    /// The clipped blade `[tip, top]` at the start and at the end.
    pub blades: [[DVec3; 2]; 2],
    /// Start and end joint.
    pub joints: [JointId; 2],
    /// Start, end, then two for each of [`LATERAL_SIDES`]: `2 + 2k` holds edge `k` of the start quad and `3 + 2k` holds
    /// edge `k` of the end quad, whichever diagonal the side has.
    pub planes: [HalfSpace; 10],
    /// Corner indices (0 to 7) of the lateral triangles `planes[2..10]`, outward.
    pub triangles: [[u8; 3]; 8],
    /// For each of [`LATERAL_SIDES`]: how far the corner that its first triangle leaves out lies from that triangle's
    /// plane, metres. Exactly 0 where the side is one flat quad; rounding size where it would be but for the grid.
    pub bulge: [f64; 4],
    /// The chain it belongs to, from 0 within a stroke.
    pub chain: u32,
    /// Its place in the chain, from 0.
    pub index: u32,
    /// What its chain goes on from, if it is the chain's first box.
    pub from: ChainStart,
}

impl TearBox {
    /// The same box moved by `by` (metres); corners and planes are rounded.
    pub fn translated(&self, by: DVec3) -> Self {
        self.carried(|p| p + by)
    }

    /// The same box elsewhere: `to` is a rigid motion of its points, which are rounded.
    pub fn carried(&self, to: impl Fn(DVec3) -> DVec3) -> Self {
        Self {
            quads: self.quads.map(|quad| quad.map(&to)),
            blades: self.blades.map(|blade| blade.map(&to)),
            planes: self.planes.map(|plane| HalfSpace { points: plane.points.map(&to), ..plane }),
            ..self.clone()
        }
    }

    /// How far the middle of the blade goes from start to end, metres.
    pub fn length(&self) -> f64 {
        let [[tip, top], [end_tip, end_top]] = self.blades;
        (end_tip + end_top - tip - top).length() / 2.0
    }

    /// The eight corners.
    pub fn corners(&self) -> [DVec3; 8] {
        let [a, b] = &self.quads;
        [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]
    }

    /// All twelve triangles of the hull, outward, as corner indices: the quads' first, then [`TearBox::triangles`].
    pub fn hull_triangles(&self) -> [[u8; 3]; 12] {
        let mut all = [[0; 3]; 12];
        // The start quad runs counter-clockwise seen from ahead: from outside (behind) it is turned.
        all[..4].copy_from_slice(&[[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]]);
        all[4..].copy_from_slice(&self.triangles);
        all
    }

    /// The index in `planes` of the side triangle that holds edge `k` of the start (`quad` 0) or end (`quad` 1) quad.
    pub fn plane_of_edge(quad: usize, k: usize) -> usize {
        2 + 2 * k + quad
    }

    /// Smallest and largest corner.
    pub fn bounds(&self) -> [DVec3; 2] {
        let c = self.corners();
        c.iter().fold([c[0], c[0]], |[lo, hi], p| [lo.min(*p), hi.max(*p)])
    }

    /// True if `p` is inside or on the box (exact).
    pub fn contains(&self, p: DVec3) -> bool {
        self.planes.iter().all(|plane| plane.sign(p) <= 0.0)
    }

    /// Volume, cubic metres.
    pub fn volume(&self) -> f64 {
        let c = self.corners();
        let six = |t: &[u8; 3]| {
            let [a, b, d] = t.map(|k| c[k as usize] - c[0]);
            a.dot(b.cross(d))
        };
        self.hull_triangles().iter().map(six).sum::<f64>() / 6.0
    }

    /// The mid-surface, for the particle layer: tip, next tip, next top, top.
    pub fn strip_corners(&self) -> [DVec3; 4] {
        let [[tip, top], [next_tip, next_top]] = self.blades;
        [tip, next_tip, next_top, top]
    }

    /// True if a plane of either box has the other on or beyond it, exactly: then they share no volume. (Boxes that only
    /// an edge-edge plane separates count as overlapping; a chain that is ended needlessly does no harm.)
    pub fn is_apart_from(&self, other: &Self) -> bool {
        if boxes_apart(&self.bounds(), &other.bounds()) {
            return true;
        }
        let beyond = |a: &Self, b: &Self| a.planes.iter().any(|plane| b.corners().iter().all(|p| plane.sign(*p) >= 0.0));
        beyond(self, other) || beyond(other, self)
    }
}

/// A piece of a tear of width 0: two triangles between two blades (MATHS 5.3).
#[derive(Clone, Debug, PartialEq)]
pub struct Slit {
    /// Tip, next tip, next top, top; the fixed diagonal runs from corner 0 to corner 2.
    pub corners: [DVec3; 4],
    /// Start and end joint.
    pub joints: [JointId; 2],
    /// Start and end plane; each contains its blade exactly. Their triples span a nominal width.
    pub ends: [HalfSpace; 2],
    /// Tags of the planes of the two [`Slit::TRIANGLES`].
    pub plane_ids: [PlaneId; 2],
    /// The chain it belongs to, from 0 within a stroke.
    pub chain: u32,
    /// Its place in the chain, from 0.
    pub index: u32,
}

impl Slit {
    /// The same strip elsewhere: `to` is a rigid motion of its points, which are rounded.
    pub fn carried(&self, to: impl Fn(DVec3) -> DVec3) -> Self {
        let ends = self.ends.map(|end| HalfSpace { points: end.points.map(&to), ..end });
        Self { corners: self.corners.map(&to), ends, ..self.clone() }
    }

    /// Its two triangles as indices into [`Slit::corners`].
    pub const TRIANGLES: [[u8; 3]; 2] = [[0, 1, 2], [0, 2, 3]];
}

/// What a step of a tear removes: a box, or with width 0 a slit.
#[derive(Clone, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "they come one at a time, into a buffer that stays")]
pub enum TearSegment {
    /// Width above 0.
    Box(TearBox),
    /// Width 0.
    Slit(Slit),
}

impl TearSegment {
    /// The box, if it is one.
    pub fn as_box(&self) -> Option<&TearBox> {
        match self {
            Self::Box(b) => Some(b),
            Self::Slit(_) => None,
        }
    }

    /// The mid-surface: tip, next tip, next top, top.
    pub fn strip_corners(&self) -> [DVec3; 4] {
        match self {
            Self::Box(b) => b.strip_corners(),
            Self::Slit(s) => s.corners,
        }
    }

    /// Chain and place in it.
    pub fn place(&self) -> (u32, u32) {
        match self {
            Self::Box(b) => (b.chain, b.index),
            Self::Slit(s) => (s.chain, s.index),
        }
    }
}

/// True if two axis-aligned boxes share no volume.
pub(super) fn boxes_apart(a: &[DVec3; 2], b: &[DVec3; 2]) -> bool {
    a[0].cmpge(b[1]).any() || b[0].cmpge(a[1]).any()
}

/// The lateral hull of two quads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hull {
    pub(super) triangles: [[u8; 3]; 8],
    pub(super) bulge: [f64; 4],
}

/// The hull of two joint quads, or `None` if they do not make a valid box (MATHS 5.3): each quad strictly on its side of
/// the other's plane, and the eight side triangles convex. All exact.
pub(super) fn hull(start: &JointFrame, end: &JointFrame) -> Option<Hull> {
    let (a, b) = (start.quad(), end.quad());
    let behind = a.iter().all(|p| plane_side(&[b[0], b[1], b[2]], *p) < 0.0);
    let ahead = behind && b.iter().all(|p| plane_side(&[a[0], a[1], a[2]], *p) > 0.0);
    if !ahead {
        return None;
    }
    let corners = [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]];
    let mut hull = Hull { triangles: [[0; 3]; 8], bulge: [0.0; 4] };
    for k in 0..4u8 {
        let next = (k + 1) % 4;
        let (a0, a1, b0, b1) = (k, next, k + 4, next + 4);
        let first = [a0, a1, b1].map(|i| corners[i as usize]);
        let side = plane_side(&first, corners[b0 as usize]);
        let area = (first[1] - first[0]).cross(first[2] - first[0]).length();
        hull.bulge[k as usize] = if side == 0.0 { 0.0 } else { side.abs() / area };
        // The outward diagonal: the corner that is left out lies inside.
        let pair = if side <= 0.0 { [[a0, a1, b1], [a0, b1, b0]] } else { [[a0, a1, b0], [a1, b1, b0]] };
        hull.triangles[2 * k as usize..2 * k as usize + 2].copy_from_slice(&pair);
    }
    is_convex(&corners, &hull.triangles).then_some(hull)
}

/// True if the side triangles are convex. The fourth corner of a triangle's own side is not asked again: the diagonal
/// was chosen by it.
fn is_convex(corners: &[DVec3; 8], triangles: &[[u8; 3]; 8]) -> bool {
    triangles.iter().enumerate().all(|(t, triangle)| {
        let triple = triangle.map(|k| corners[k as usize]);
        let own = [t / 2, (t / 2 + 1) % 4];
        (0..8).all(|k| own.contains(&(k % 4)) || plane_side(&triple, corners[k]) <= 0.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(x: f64, lean: f64, half: f64) -> JointFrame {
        let grid = Grid::new(1.0);
        let tip = DVec3::new(x, 0.0, 0.0);
        let snap = |v| grid.snap(v);
        JointFrame { tip, top: snap(DVec3::new(x, 0.3, lean)), half: snap(DVec3::new(0.0, lean, -0.3).normalize() * half) }
    }

    #[test]
    fn quads_are_exact_parallelograms() {
        let q = JointFrame { ..frame(0.123_456_789, 0.111, 0.017) };
        let q = JointFrame { tip: Grid::new(1.0).snap(q.tip), ..q }.quad();
        assert_eq!(plane_side(&[q[0], q[1], q[2]], q[3]), 0.0);
        let off = q[3] + DVec3::X * 1e-16;
        assert_ne!(plane_side(&[q[0], q[1], q[2]], off), 0.0, "one rounding off is seen");
    }

    #[test]
    fn a_straight_box_is_flat_and_a_twisted_one_bulges() {
        let straight = hull(&frame(0.0, 0.0, 0.01), &frame(0.1, 0.0, 0.01)).unwrap();
        assert_eq!(straight.bulge, [0.0; 4]);
        let twisted = hull(&frame(0.0, 0.0, 0.01), &frame(0.1, 0.2, 0.01)).unwrap();
        assert!(twisted.bulge[1] > 1e-3 && twisted.bulge[3] > 1e-3, "{:?}", twisted.bulge);
    }

    #[test]
    fn invalid_pairs_are_refused() {
        let (a, b) = (frame(0.0, 0.0, 0.01), frame(0.1, 0.0, 0.01));
        assert!(hull(&a, &b).is_some());
        assert!(hull(&b, &a).is_none(), "backwards");
        assert!(hull(&a, &a).is_none(), "no travel");
        let turned = JointFrame { half: DVec3::new(0.2, 0.0, -0.2), ..b };
        assert!(hull(&a, &turned).is_none(), "a corner behind the other plane");
        let nan = JointFrame { tip: DVec3::NAN, ..b };
        assert!(hull(&a, &nan).is_none());
    }

    #[test]
    fn fitting_gives_back_what_was_not_moved_and_planarises_what_was() {
        let grid = Grid::new(1.0);
        let a = frame(0.25, 0.1, 0.02);
        assert_eq!(JointFrame::fitted(&a.quad(), grid), a);
        let mut moved = a.quad();
        moved[2] += DVec3::new(0.003, 0.001, -0.002);
        assert_ne!(plane_side(&[moved[0], moved[1], moved[2]], moved[3]), 0.0);
        let q = JointFrame::fitted(&moved, grid).quad();
        assert_eq!(plane_side(&[q[0], q[1], q[2]], q[3]), 0.0);
        assert!(q.iter().zip(&moved).all(|(p, m)| (*p - *m).length() < 0.003));
    }
}
