//! Does a straight link cross a strip? Exact predicates on the two triangles of an extended strip (MATHS 3.2).

use super::sight::Sight;
use glam::{DVec3, Vec4};
use robust::{Coord3D, orient3d};
use std::borrow::Borrow;

/// A strip as it is tested: extended by `d` above the base and `d / 4` below the tip, less where the blades before and after meet nearby,
/// and cut along a fixed diagonal.
#[derive(Clone, Debug)]
pub struct StripGeometry {
    /// `(tip0, tip1, base1)` and `(tip0, base1, base0)`, extended. Of a strip that is folded the smaller one is turned over; a needle that
    /// faces elsewhere gives way to the other, which stands twice then.
    pub triangles: [[DVec3; 3]; 2],
    /// `tip0, tip1, base1, base0`, extended.
    corners: [DVec3; 4],
    /// Cross product of each triangle's edges: twice its area long, towards side +1.
    normals: [DVec3; 2],
    /// The same, of unit length; zero for a triangle without area.
    units: [DVec3; 2],
    /// That of both together.
    normal: DVec3,
    /// A thousand roundings of a height over each triangle, for a point one metre off (sum of coordinates).
    roundings: [f64; 2],
    /// Dual vectors of the two edges that leave a triangle's first corner: they give a point's coordinates along those edges.
    /// NaN, which decides nothing, for a triangle too thin for rounded coordinates.
    duals: [[DVec3; 2]; 2],
    /// Bounds of both triangles.
    pub low: DVec3,
    /// Bounds of both triangles.
    pub high: DVec3,
    /// How far outside of the bounds a lip of a neighbouring strip may lie and still be known by its side, metres.
    pub margin: f64,
}

/// One end of a link: where it is, and the side it is known to be on for lip vertices.
#[derive(Clone, Copy, Debug)]
pub struct LinkEnd {
    /// Where it is tested from, if it knows no side: its rest position, or for some lips their mirror image.
    pub at: DVec3,
    /// Known side of this strip: from the strip itself or from the one before or after it in the slit.
    pub side: Option<KnownSide>,
}

/// A side known by birth and not by geometry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownSide {
    /// +1 on the side that the strip's normal `(tip1 - tip0) x (base - tip)` points to, -1 on the other.
    pub side: i8,
    /// True if the vertex is a lip of the very strip, false if of a strip that shares an edge with it.
    pub own: bool,
}

/// How a vertex that knows its side of a strip lies to it: what a test of any of its links needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct LipView {
    at: DVec3,
    known: KnownSide,
    /// How each triangle is tested.
    by: [LipTest; 2],
    /// Where it would be on its side of the strip that tells, if it lies beyond that one: see [`StripGeometry::on_side`].
    beside: Option<DVec3>,
}

/// How a link of a lip is tested against one triangle.
#[derive(Clone, Copy, Debug)]
enum LipTest {
    /// As any link: the lip lies on its known side, or too far from the plane to be taken for it.
    Geometry,
    /// Only the other end's side counts.
    OtherSide,
    /// From the lip's mirror image, which is on the known side.
    Mirrored(DVec3),
}

/// Where the blades before and after lean towards each other, a strip is extended by no more than this share of the way to where they
/// meet: beyond, it would be turned over, and its sides with it; and the narrower its end, the more a blade a little askew turns a
/// triangle's normal.
const MOST_OF_WAY: f64 = 0.25;

/// A triangle of a strip is a needle if its area is less than this share of the other's.
const NEEDLE: f64 = 1e-2;

/// Cosine of the angle between the normals of a strip's triangles, below which a needle is skewed.
const SKEWED: f64 = 0.9;

/// The same, below which the strip is folded; what lies between is twisted.
const FOLDED: f64 = -0.97;

/// The same, below which a lip on its side of one triangle is taken to be on its side of the strip.
const ASKEW: f64 = 0.7;

/// Heights of lips over their strips at rest, as a share of the strip's size, that come from rounding.
const ROUNDED: f64 = 1e-5;

impl StripGeometry {
    /// From the corners `(tip0, tip1, base1, base0)` and the extension `d`.
    pub fn new([tip0, tip1, base1, base0]: [DVec3; 4], d: f64) -> Self {
        let ups = [base0 - tip0, base1 - tip1].map(DVec3::normalize_or_zero);
        let (opening, travel) = (ups[1] - ups[0], tip1 - tip0 + base1 - base0);
        let [up, down] = [(base1 - base0, opening, d), (tip1 - tip0, -opening, 0.25 * d)].map(|(edge, widens, most)| {
            let (edge, narrows) = (edge.dot(travel), -widens.dot(travel));
            if edge > 0.0 && narrows > 0.0 { most.min(MOST_OF_WAY * edge / narrows) } else { most }
        });
        let (tip0, tip1) = (tip0 - ups[0] * down, tip1 - ups[1] * down);
        let (base0, base1) = (base0 + ups[0] * up, base1 + ups[1] * up);
        let (triangles, normals) = agreed([[tip0, tip1, base1], [tip0, base1, base0]]);
        let corners = [tip0, tip1, base1, base0];
        let low = corners.into_iter().fold(DVec3::INFINITY, DVec3::min);
        let high = corners.into_iter().fold(DVec3::NEG_INFINITY, DVec3::max);
        let units = normals.map(DVec3::normalize_or_zero);
        let normal = (normals[0] + normals[1]).normalize_or_zero();
        // the normal of a needle is a difference of products that nearly cancel
        let products = triangles.map(|[p, q, s]| (q - p).length() * (s - p).length());
        let roundings = [0, 1].map(|t| 1e-13 * normals[t].abs().element_sum() + 4e-15 * products[t]);
        let duals = triangles.map(duals);
        Self { triangles, corners, normals, units, normal, roundings, duals, low, high, margin: 0.25 * d }
    }

    /// Unit normal towards side +1, zero for a strip without area.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// The side of the strip that a point over or under it lies on; 0 for one beside it.
    pub fn side_over(&self, p: DVec3) -> i8 {
        let d = p - self.triangles[0][0]; // both triangles start there
        let is_over = |t: &usize| {
            let [x, y] = self.duals[*t].map(|dual| dual.dot(d));
            x >= 0.0 && y >= 0.0 && x + y <= 1.0
        };
        (0..2).find(is_over).map_or(0, |t| self.side(t, p))
    }

    /// The side of the strip that a point lies on, if it were as long and as deep as that takes.
    pub fn side_near(&self, p: DVec3) -> i8 {
        let sides = [0, 1].map(|t| self.side(t, p));
        let distance = |t: usize| distance_squared_to_triangle(p, self.triangles[t]);
        sides[usize::from(sides[0] != sides[1] && distance(1) < distance(0))]
    }

    /// True if the segment from `a` to `b` crosses the strip. A point in the plane of a triangle counts as on side +1.
    pub fn crosses(&self, a: DVec3, b: DVec3) -> bool {
        !self.is_beside(a, b, 0.0) && (0..2).any(|t| self.triangle_crosses(t, a, b))
    }

    /// What a point lies beyond, a bit each: the six sides of the bounds, then the two sides of each triangle's plane by more
    /// than rounding. See [`StripGeometry::codes_part`].
    pub fn outcode(&self, p: DVec3) -> u16 {
        self.bounds_code(p) | self.planes_code(p)
    }

    fn bounds_code(&self, p: DVec3) -> u16 {
        let (below, above) = (p.cmplt(self.low).bitmask() as u16, p.cmpgt(self.high).bitmask() as u16);
        below | above << 3
    }

    fn planes_code(&self, p: DVec3) -> u16 {
        let d = p - self.triangles[0][0]; // both triangles start there
        let size = d.abs().element_sum();
        let mut code = 0;
        for (t, n) in self.normals.iter().enumerate() {
            let (height, bound) = (n.dot(d), self.roundings[t] * size);
            code |= (u16::from(height > bound) | u16::from(height < -bound) << 1) << (6 + 2 * t);
        }
        code
    }

    /// [`StripGeometry::codes_part`] for a point's outcode and another point, of which no more than needed is worked out.
    #[inline]
    pub fn parts(&self, code: u16, p: DVec3) -> bool {
        self.bounds_code(p) & code != 0 || (code & 0o1700 != 0 && Self::codes_part(code & 0o1700, self.planes_code(p)))
    }

    /// Bounds of the shadow that a point throws through the strip as far as `radius`: of all ends of links from the point, that long
    /// at most, that cross. `None` if there are none.
    pub fn shadow(&self, from: DVec3, radius: f64) -> Option<(DVec3, DVec3)> {
        if from.cmplt(self.low - radius).any() || from.cmpgt(self.high + radius).any() {
            return None;
        }
        let d = from - self.corners[0];
        let heights = self.units.map(|n| n.dot(d));
        // on one side of both planes the link has at least the height to the nearer to go
        let nearest = if heights[0] * heights[1] > 0.0 { heights[0].abs().min(heights[1].abs()) } else { 0.0 };
        if nearest > radius {
            return None;
        }
        // ends lie between the strip and the strip seen from the point and scaled so far that it is out of reach everywhere
        let (mut low, mut high) = (self.low, self.high);
        if nearest > 0.0 {
            let scale = radius / nearest;
            for corner in self.corners {
                let far = from + (corner - from) * scale;
                (low, high) = (low.min(far), high.max(far));
            }
        } else {
            (low, high) = (DVec3::NEG_INFINITY, DVec3::INFINITY);
        }
        let slack = 1e-9 * (radius + (self.high - self.low).length());
        Some((low.max(from - radius) - slack, high.min(from + radius) + slack))
    }

    /// How a point sees the strip, for links to points of the box of half-width `radius` around it.
    pub fn sight(&self, from: DVec3, radius: f64) -> Sight {
        // a point that lies in the strip: which side it is on is for exact arithmetic to tell
        let reach = 1e-9 * (self.high - self.low).length();
        let is_in = |t: usize| {
            self.height(t, from).abs() <= reach && distance_squared_to_triangle(from, self.triangles[t]) <= reach * reach
        };
        if is_in(0) || is_in(1) {
            return Sight::everywhere(from);
        }
        let corners = self.corners.map(|c| c - from);
        let mut normals = [[0.0f32; 4]; 3];
        for i in 0..4 {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            let n = a.cross(b);
            let squared = n.length_squared();
            let others = [corners[(i + 2) % 4], corners[(i + 3) % 4]];
            let heights = others.map(|c| n.dot(c));
            // a plane that is ill defined, or that has corners on both sides as one of a twisted strip may, bounds nothing
            let inwards = [1.0, -1.0].into_iter().find(|s| heights[0] * s >= 0.0 && heights[1] * s >= 0.0);
            if let Some(sign) = inwards.filter(|_| squared > 1e-8 * a.length_squared() * b.length_squared()) {
                let unit = n * (sign / squared.sqrt());
                for d in 0..3 {
                    normals[d][i] = unit[d] as f32;
                }
            }
        }
        let before = self.plane_before(corners);
        Sight { from, normals: normals.map(Vec4::from_array), before, slack: Sight::slack(radius) }
    }

    /// [`Sight::before`] for the way to each corner: over the strip, or where that tells less, across the way to its middle.
    fn plane_before(&self, corners: [DVec3; 4]) -> [f32; 4] {
        let middle = corners.into_iter().sum::<DVec3>().normalize_or_zero();
        let height = |n: DVec3| corners.into_iter().map(|c| n.dot(c)).fold(f64::INFINITY, f64::min);
        let over = if self.normal.dot(middle) < 0.0 { -self.normal } else { self.normal };
        let [h, m] = [over, middle].map(height);
        match if h >= m { (over, h) } else { (middle, m) } {
            (n, height) if height > 0.0 => [n.x as f32, n.y as f32, n.z as f32, height as f32],
            _ => [0.0; 4],
        }
    }

    /// True if the outcodes of two points without known sides show that the link between them does not cross: both beyond one
    /// side of the bounds, or on one side of both planes.
    #[inline]
    pub fn codes_part(a: u16, b: u16) -> bool {
        let both = a & b;
        both & 0o77 != 0 || (both & 0o300 != 0 && both & 0o1400 != 0)
    }

    /// True if the outcodes of two points show that both are on one side of both planes.
    #[inline]
    pub fn planes_part(a: u16, b: u16) -> bool {
        Self::codes_part(a & 0o1700, b & 0o1700)
    }

    /// True if a point with this outcode is on `side` of both triangles' planes by more than rounding: a known side then says no
    /// more than geometry.
    pub fn is_on_side(code: u16, side: i8) -> bool {
        let wanted = if side > 0 { 0o500 } else { 0o1200 };
        code & 0o1700 == wanted
    }

    /// True if the bounds of a link and of the strip are more than `margin` apart.
    pub fn is_beside(&self, a: DVec3, b: DVec3, margin: f64) -> bool {
        a.max(b).cmplt(self.low - margin).any() || a.min(b).cmpgt(self.high + margin).any()
    }

    /// For ends of which none lies beyond the strip that tells its side.
    #[cfg(test)]
    fn crosses_link(&self, ends: [LinkEnd; 2]) -> bool {
        self.crosses_viewed(ends, |end, known| self.view_of_lip(ends[end].at, known, None))
    }

    /// [`Self::crosses`] for ends that may know their side: `view` tells how such an end lies to the strip.
    pub(super) fn crosses_viewed<V: Borrow<LipView>>(
        &self,
        ends: [LinkEnd; 2],
        view: impl FnOnce(usize, KnownSide) -> V,
    ) -> bool {
        match ends.map(|end| end.side) {
            [None, None] => self.crosses(ends[0].at, ends[1].at),
            [Some(x), Some(y)] => x.side != y.side,
            [Some(known), None] => self.lip_crosses(view(0, known).borrow(), ends[1].at),
            [None, Some(known)] => self.lip_crosses(view(1, known).borrow(), ends[0].at),
        }
    }

    /// A lip vertex may lie in the strip, or beyond it by rounding or because the slit was cut in a bent pose: there its
    /// known side stands in for geometry. `beside` is where a lip of a neighbouring strip lies on its own side of that one.
    pub(super) fn view_of_lip(&self, at: DVec3, known: KnownSide, beside: Option<DVec3>) -> LipView {
        // where the lip lies on its known side, geometry needs no help
        let plain = [0, 1].map(|t| self.side(t, at) == known.side && self.height(t, at) != 0.0);
        if plain == [true; 2] {
            return LipView { at, known, by: [LipTest::Geometry; 2], beside };
        }
        let squared = self.triangles.map(|t| distance_squared_to_triangle(at, t));
        let nearest = usize::from(squared[1] < squared[0]);
        let (own_height, extent) = (self.height(nearest, at).abs(), (self.high - self.low).length());
        // the sides of one triangle tell nothing of the other where that one faces elsewhere
        let is_askew = self.units[0].dot(self.units[1]) < ASKEW && plain.contains(&true);
        let by = [0, 1].map(|t| match self.height(t, at) {
            _ if plain[t] || is_askew => LipTest::Geometry,
            _ if known.own && t == nearest => LipTest::OtherSide,
            height if height.abs() > 4.0 * own_height + 1e-9 * extent => LipTest::Geometry,
            height => LipTest::Mirrored(at - self.units[t] * (2.0 * height)),
        });
        LipView { at, known, by, beside }
    }

    /// True if the link between a lip and a point that knows no side crosses.
    pub(super) fn lip_crosses(&self, lip: &LipView, x: DVec3) -> bool {
        // A link well beside the strip's bounds is none of its business, whatever side the lip has of the strip before: the
        // updates look at links that reach into the bounds, and no further.
        if !lip.known.own && self.is_beside(lip.at, x, self.margin) {
            return false;
        }
        let crosses = (0..2).any(|t| match lip.by[t] {
            LipTest::Geometry => self.triangle_crosses(t, lip.at, x),
            LipTest::OtherSide => self.side(t, x) != lip.known.side,
            // The segment from the mirror image ends at x: the line through the lip itself goes on for ever, and met strips far
            // from either end.
            LipTest::Mirrored(mirrored) => self.side(t, x) != lip.known.side && line_meets(self.triangles[t], mirrored, x),
        });
        // Where `beside` lies beyond this strip as well, a link from there leads back, and tells nothing.
        let leads_out = |t: usize, from: DVec3| self.side(t, from) == lip.known.side && self.triangle_crosses(t, from, x);
        crosses || lip.beside.is_some_and(|from| (0..2).any(|t| leads_out(t, from)))
    }

    /// The mirror image, on `side`, of a lip that lies on the other side by more than rounding: its slit was cut in bent tissue. Where the
    /// slit bends, a link from the lip itself passes round the corner between this strip and the next.
    pub(super) fn on_side(&self, at: DVec3, side: i8) -> Option<DVec3> {
        let grain = ROUNDED * (self.high - self.low).length();
        let heights = [0, 1].map(|t| self.height(t, at));
        if heights.iter().all(|h| h * f64::from(side) > -grain) {
            return None;
        }
        let squared = self.triangles.map(|t| distance_squared_to_triangle(at, t));
        let nearest = usize::from(squared[1] < squared[0]);
        let height = heights[nearest];
        (height * f64::from(side) < -grain).then(|| at - self.units[nearest] * (2.0 * height))
    }

    /// +1 or -1; points in the plane count as +1.
    fn side(&self, t: usize, x: DVec3) -> i8 {
        let [p, q, s] = self.triangles[t];
        let d = x - p;
        let (height, bound) = (self.normals[t].dot(d), self.roundings[t] * d.abs().element_sum());
        match height {
            h if h > bound => 1,
            h if h < -bound => -1,
            _ if orient(p, q, s, x) <= 0.0 => 1,
            _ => -1,
        }
    }

    /// Distance to the plane of a triangle, signed; 0 for a triangle without area.
    fn height(&self, t: usize, x: DVec3) -> f64 {
        self.units[t].dot(x - self.triangles[t][0])
    }

    fn triangle_crosses(&self, t: usize, a: DVec3, b: DVec3) -> bool {
        // Far from the plane on the same side: settled without exact arithmetic. The bound is a thousand roundings.
        let (n, p) = (self.normals[t], self.triangles[t][0]);
        let (da, db) = (a - p, b - p);
        let (ha, hb) = (n.dot(da), n.dot(db));
        let bound = self.roundings[t] * (da.abs() + db.abs()).element_sum();
        if (ha > bound && hb > bound) || (ha < -bound && hb < -bound) {
            return false;
        }
        if (ha > bound && hb < -bound) || (ha < -bound && hb > bound) {
            // where the link meets the plane, in coordinates along two edges; well inside or well outside needs no more
            let x = da + (db - da) * (ha / (ha - hb));
            let [s, r] = self.duals[t].map(|g| g.dot(x));
            let size = (self.duals[t][0].abs() + self.duals[t][1].abs()).element_sum() * (da.abs() + db.abs()).element_sum();
            let doubt = size * (1e-11 + 0.1 * bound / (ha - hb).abs()) + 1e-12;
            let least = s.min(r).min(1.0 - s - r);
            if least.abs() > doubt {
                return least > 0.0;
            }
        }
        self.side(t, a) != self.side(t, b) && line_meets(self.triangles[t], a, b)
    }
}

/// Where `p` lies along a strip `(tip0, tip1, base1, base0)` with this unit normal: 0 at its start, 1 at its end. A blade that leans sweeps
/// a fan, and a place in it lies between the two ends as its distances from them say.
pub fn share_between([tip0, tip1, base1, base0]: [DVec3; 4], normal: DVec3, p: DVec3) -> f64 {
    let inside = |tip: DVec3, base: DVec3, others: DVec3| {
        let inwards = normal.cross(base - tip).normalize_or_zero();
        (p - tip).dot(inwards) * (others - tip - base).dot(inwards).signum()
    };
    let (start, end) = (inside(tip0, base0, tip1 + base1), inside(tip1, base1, tip0 + base0));
    if start + end > 0.0 { start / (start + end) } else { 0.5 }
}

/// The triangles of a strip and their normals, so that side +1 is the same for both. A blade that turned about a point at its end as it
/// was seen may have turned about one of its own at rest, and the strip is folded there: the smaller triangle is turned over. A needle
/// that faces elsewhere than the other triangle has no sides that mean anything, and gives way to the other, which stands twice then.
fn agreed(mut triangles: [[DVec3; 3]; 2]) -> ([[DVec3; 3]; 2], [DVec3; 2]) {
    let cross = |[p, q, s]: [DVec3; 3]| (q - p).cross(s - p);
    let normals = triangles.map(cross);
    let lengths = normals.map(DVec3::length);
    let smaller = usize::from(lengths[1] < lengths[0]);
    let cosine = normals[0].dot(normals[1]) / (lengths[0] * lengths[1]);
    if lengths[smaller] < NEEDLE * lengths[1 - smaller] && cosine < SKEWED {
        triangles[smaller] = triangles[1 - smaller];
    } else if cosine < FOLDED {
        triangles[smaller].swap(1, 2);
    }
    (triangles, triangles.map(cross))
}

/// See [`StripGeometry::duals`].
fn duals([p, q, s]: [DVec3; 3]) -> [DVec3; 2] {
    let (u, w) = (q - p, s - p);
    let n = u.cross(w);
    let squared = n.length_squared();
    if squared > 1e-8 * u.length_squared() * w.length_squared() {
        [w.cross(n) / squared, n.cross(u) / squared]
    } else {
        [DVec3::NAN; 2]
    }
}

/// True if the line through `a` and `b` meets the triangle, its border included.
fn line_meets([p, q, s]: [DVec3; 3], a: DVec3, b: DVec3) -> bool {
    let signs = [orient(a, b, p, q), orient(a, b, q, s), orient(a, b, s, p)];
    signs.iter().all(|x| *x >= 0.0) || signs.iter().all(|x| *x <= 0.0)
}

fn orient(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> f64 {
    let coord = |p: DVec3| Coord3D { x: p.x, y: p.y, z: p.z };
    orient3d(coord(a), coord(b), coord(c), coord(d))
}

/// Squared distance from a point to a triangle (Ericson, Real-Time Collision Detection, 5.1.5).
pub fn distance_squared_to_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    let along = |from: DVec3, edge: DVec3| {
        let length = edge.length_squared();
        let t = if length > 0.0 { (p - from).dot(edge) / length } else { 0.0 };
        (p - from - edge * t.clamp(0.0, 1.0)).length_squared()
    };
    let sum = va + vb + vc;
    if va > 0.0 && vb > 0.0 && vc > 0.0 && sum > 0.0 {
        return (ap - ab * (vb / sum) - ac * (vc / sum)).length_squared();
    }
    along(a, ab).min(along(b, c - b)).min(along(a, ac))
}

#[cfg(test)]
#[path = "strip_test_tests.rs"]
mod tests;
