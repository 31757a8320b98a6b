//! Exact predicates (MATHS 5.6): on which side of a plane a vertex lies, and on which side of a third plane two others meet.
//!
//! A face sees a plane only through its three corners' *values*: f64 numbers whose sign is exact (adaptive arithmetic) and
//! whose size is rounded. The linear function they span over the face is then taken as given, and every further sign is an
//! exact determinant of such values. So neighbours never disagree about a shared edge, and a polygon cut by any number
//! of planes stays convex, whatever the rounding.

use glam::DVec3;
use num_bigint::{BigInt, Sign};

/// A plane, oriented: values are positive on the side its normal points to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Plane {
    /// Through three points; normal `(b - a) x (c - a)`.
    Points([DVec3; 3]),
    /// `normal . x = offset`; any normal but zero.
    Equation {
        /// Normal, of any length but zero.
        normal: DVec3,
        /// Offset along it, scaled like the normal.
        offset: f64,
    },
}

/// Largest coordinate of a plane's points: its fourth power is finite, which the length of their normal takes.
const FARTHEST_POINT: f64 = 1e75;

impl Plane {
    /// Largest number of a plane's equation: no model reaches as far, and products with it are finite.
    pub const FARTHEST: f64 = 1e150;

    /// Value of the plane at `p`: its sign is exact for the plane as given, its size is rounded and scales with the
    /// plane's representation. Zero exactly on the plane.
    #[inline]
    pub fn value(&self, p: DVec3) -> f64 {
        match self {
            Plane::Points([a, b, c]) => -robust::orient3d(coord(*a), coord(*b), coord(*c), coord(p)),
            Plane::Equation { normal, offset } => dot_minus(*normal, p, *offset),
        }
    }

    /// The value without rounding.
    fn exact(&self, p: DVec3) -> Dyadic {
        let less = |p: DVec3, a: DVec3| [0, 1, 2].map(|k| Dyadic::from(p[k]) + Dyadic::from(-a[k]));
        match self {
            Plane::Points([a, b, c]) => {
                let (u, v, w) = (less(*b, *a), less(*c, *a), less(p, *a));
                (0..3).fold(Dyadic::from(0.0), |sum, k| {
                    let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                    let minor = u[i].clone() * v[j].clone() + Dyadic::from(-1.0) * u[j].clone() * v[i].clone();
                    sum + minor * w[k].clone()
                })
            }
            Plane::Equation { normal, offset } => {
                (0..3).fold(Dyadic::from(-offset), |sum, k| sum + Dyadic::from(normal[k]) * Dyadic::from(p[k]))
            }
        }
    }

    /// The same plane seen from the other side; values change sign and nothing else.
    pub fn flipped(&self) -> Self {
        match *self {
            Plane::Points([a, b, c]) => Plane::Points([b, a, c]),
            Plane::Equation { normal, offset } => Plane::Equation { normal: -normal, offset: -offset },
        }
    }

    /// Unit normal; zero for a degenerate plane.
    pub fn normal(&self) -> DVec3 {
        match *self {
            Plane::Points([a, b, c]) => (b - a).cross(c - a).normalize_or_zero(),
            Plane::Equation { normal, .. } => normal.normalize_or_zero(),
        }
    }

    /// True if it is one: finite, with a normal that is not zero, and nowhere so far away that products with it would not be finite.
    pub fn is_sound(&self) -> bool {
        let within = |p: DVec3, most: f64| p.abs().max_element() <= most && p.is_finite();
        match *self {
            Plane::Points(points) => points.iter().all(|&p| within(p, FARTHEST_POINT)) && self.normal() != DVec3::ZERO,
            Plane::Equation { normal, offset } => {
                within(normal, Self::FARTHEST) && offset.abs() <= Self::FARTHEST && normal.normalize_or_zero() != DVec3::ZERO
            }
        }
    }

    /// Signed distance of `p`, metres, rounded.
    pub fn distance(&self, p: DVec3) -> f64 {
        match *self {
            Plane::Points([a, ..]) => self.normal().dot(p - a),
            Plane::Equation { normal, offset } => (normal.dot(p) - offset) / normal.length(),
        }
    }

    /// By how much [`Plane::distance`] may be off at points within `reach` of the origin, metres: much where the plane's own points
    /// are far away, or nearly in a line.
    pub fn rounding(&self, reach: f64) -> f64 {
        let (away, spread) = match *self {
            Plane::Points([a, b, c]) => {
                let (u, v) = (b - a, c - a);
                (a.length(), u.length() * v.length() / u.cross(v).length())
            }
            Plane::Equation { normal, offset } => (offset.abs() / normal.length(), 1.0),
        };
        16.0 * f64::EPSILON * (1.0 + spread) * (away + reach)
    }
}

fn coord(p: DVec3) -> robust::Coord3D<f64> {
    robust::Coord3D { x: p.x, y: p.y, z: p.z }
}

/// `n . p - d` with an exact sign.
fn dot_minus(n: DVec3, p: DVec3, d: f64) -> f64 {
    let products = n * p;
    let value = products.x + products.y + products.z - d;
    let bound = 4.0 * f64::EPSILON * (products.x.abs() + products.y.abs() + products.z.abs() + d.abs());
    if value.abs() > bound {
        return value;
    }
    let exact = (0..3).fold(Dyadic::from(-d), |sum, k| sum + Dyadic::from(n[k]) * Dyadic::from(p[k]));
    with_sign(value, exact.sign())
}

/// `value` given the sign that exact arithmetic found.
fn with_sign(value: f64, sign: i32) -> f64 {
    match sign {
        0 => 0.0,
        s => f64::from(s) * value.abs().max(f64::MIN_POSITIVE),
    }
}

/// `a * d - b * c`, right to a few units in its last place, however much the products cancel; short of underflow.
#[inline]
pub fn det2(a: f64, b: f64, c: f64, d: f64) -> f64 {
    let (p, q) = (a * d, b * c);
    (p - q) + (a.mul_add(d, -p) - b.mul_add(c, -q))
}

/// Exact sign of `a * d - b * c`. Rounding is monotone, so the rounded products decide unless they are equal.
#[inline]
pub fn sign_det2(a: f64, b: f64, c: f64, d: f64) -> i32 {
    let (p, q) = (a * d, b * c);
    if p != q {
        return if p > q { 1 } else { -1 };
    }
    let (rest_p, rest_q) = (a.mul_add(d, -p), b.mul_add(c, -q));
    if rest_p == rest_q && p.abs() < 1e-250 && (a != 0.0 && d != 0.0 || b != 0.0 && c != 0.0) {
        return (Dyadic::from(a) * Dyadic::from(d) + Dyadic::from(-b) * Dyadic::from(c)).sign();
    }
    i32::from(rest_p > rest_q) - i32::from(rest_p < rest_q)
}

/// Exact sign of `a(p) b(q) - a(q) b(p)`: on which side of `b` the line through `p` and `q` crosses `a`, up to orientation.
/// `values` are `[a(p), a(q)]` and `[b(p), b(q)]` as [`Plane::value`] gives them; one that is 0 counts as 0. Where their sizes,
/// which are rounded, leave any doubt, the planes are evaluated again without rounding: three planes that share a line
/// then give the same answer on every edge.
pub fn sign_cross(a: &Plane, b: &Plane, [p, q]: [DVec3; 2], values: [[f64; 2]; 2]) -> i32 {
    let [[ap, aq], [bp, bq]] = values;
    let det = ap * bq - aq * bp;
    if det.abs() > 1e-10 * (ap.abs() + aq.abs()) * (bp.abs() + bq.abs()) {
        return if det > 0.0 { 1 } else { -1 };
    }
    let exact = |plane: &Plane, p: DVec3, value: f64| if value == 0.0 { Dyadic::from(0.0) } else { plane.exact(p) };
    (exact(a, p, ap) * exact(b, q, bq) + Dyadic::from(-1.0) * exact(a, q, aq) * exact(b, p, bp)).sign()
}

/// Exact sign of the determinant with rows `a`, `b`, `c`.
pub fn sign_det3(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> i32 {
    let mut det = 0.0;
    let mut permanent = 0.0;
    for k in 0..3 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let (p, q) = (a[i] * b[j], a[j] * b[i]);
        det += (p - q) * c[k];
        permanent += (p.abs() + q.abs()) * c[k].abs();
    }
    if det.abs() > 8.0 * f64::EPSILON * permanent && permanent > 1e-250 {
        return if det > 0.0 { 1 } else { -1 };
    }
    let exact = |x: f64| Dyadic::from(x);
    (0..3)
        .fold(Dyadic::from(0.0), |sum, k| {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            sum + exact(a[i]) * exact(b[j]) * exact(c[k]) + exact(-a[j]) * exact(b[i]) * exact(c[k])
        })
        .sign()
}

/// Orientation of three points in the plane: positive when counter-clockwise; the sign is exact.
#[inline]
pub fn orient2d(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    let at = |p: [f64; 2]| robust::Coord { x: p[0], y: p[1] };
    robust::orient2d(at(a), at(b), at(c))
}

/// An exact dyadic number `mantissa * 2^exponent`: the last resort of the predicates.
#[derive(Clone, Debug)]
struct Dyadic {
    mantissa: BigInt,
    exponent: i64,
}

impl From<f64> for Dyadic {
    fn from(x: f64) -> Self {
        debug_assert!(x.is_finite());
        let bits = x.to_bits();
        let biased = (bits >> 52 & 0x7ff) as i64;
        let fraction = (bits & ((1 << 52) - 1)) as i64;
        let (mantissa, exponent) = if biased == 0 { (fraction, -1074) } else { (fraction | 1 << 52, biased - 1075) };
        Self { mantissa: BigInt::from(if x.is_sign_negative() { -mantissa } else { mantissa }), exponent }
    }
}

impl std::ops::Mul for Dyadic {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self { mantissa: self.mantissa * other.mantissa, exponent: self.exponent + other.exponent }
    }
}

impl std::ops::Add for Dyadic {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let exponent = self.exponent.min(other.exponent);
        Self { mantissa: self.scaled_to(exponent) + other.scaled_to(exponent), exponent }
    }
}

impl Dyadic {
    /// The mantissa for a smaller exponent.
    fn scaled_to(self, exponent: i64) -> BigInt {
        self.mantissa << (self.exponent - exponent) as usize
    }

    fn sign(&self) -> i32 {
        match self.mantissa.sign() {
            Sign::Plus => 1,
            Sign::NoSign => 0,
            Sign::Minus => -1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn values_are_zero_only_on_the_plane() {
        let plane = Plane::Equation { normal: DVec3::new(0.1, 0.2, 0.3), offset: 0.0 };
        let p = DVec3::new(3.0, 0.0, -1.0);
        // 0.1 * 3 - 0.3 is not zero in f64: 0.1 and 0.3 are not exact, and the exact value is tiny but positive
        assert!(plane.value(p) > 0.0 && plane.value(p) < 1e-16);
        assert_eq!(plane.value(DVec3::ZERO), 0.0);
        assert!(plane.flipped().value(p) < 0.0);
        let tilted = Plane::Points([DVec3::ZERO, DVec3::X, DVec3::Y]);
        assert!(tilted.value(DVec3::Z) > 0.0 && tilted.flipped().value(DVec3::Z) < 0.0);
        assert_eq!(tilted.value(DVec3::new(0.3, 0.7, 0.0)), 0.0);
    }

    #[test]
    fn what_is_no_plane_is_told_from_what_is_one() {
        let equation = |normal: [f64; 3], offset| Plane::Equation { normal: normal.into(), offset }.is_sound();
        assert!(equation([0.0, -3.0, 0.0], 1e9) && equation([1e-9, 0.0, 0.0], 0.0));
        assert!(!equation([0.0; 3], 1.0) && !equation([f64::NAN, 1.0, 0.0], 0.0) && !equation([1.0, f64::INFINITY, 0.0], 0.0));
        assert!(!equation([1.0, 0.0, 0.0], f64::NAN) && !equation([1.0, 0.0, 0.0], 1e200) && !equation([1e200, 0.0, 0.0], 0.0));
        let points = |c: DVec3| Plane::Points([DVec3::ZERO, DVec3::X, c]).is_sound();
        assert!(points(DVec3::Y) && points(DVec3::new(0.0, 1e30, 0.0)));
        assert!(!points(DVec3::ZERO) && !points(DVec3::X * 2.0) && !points(DVec3::NAN) && !points(DVec3::Z * f64::INFINITY));
        assert!(!points(DVec3::Y * 1e200));
    }

    #[test]
    fn planes_through_one_line_agree_without_rounding() {
        let third = 1.0 / 3.0;
        let (o, along) = (DVec3::new(0.1, third, 0.7), DVec3::new(0.25, 0.5, -0.125));
        let through = |x: DVec3| Plane::Points([o, o + along, x]);
        let ends = [o + along * 0.5 - DVec3::Y, o + along * 0.5 + DVec3::Y];
        let sign = |a: &Plane, b: &Plane| sign_cross(a, b, ends, [ends.map(|p| a.value(p)), ends.map(|p| b.value(p))]);
        let planes = [through(DVec3::X), through(DVec3::new(9.0, 0.1, 0.0)), through(DVec3::new(0.0, 0.3, 7.0))];
        // whatever the line's own rounding makes of it, a crossing is beside it on one side for all
        let value = |a: &Plane, p: DVec3| a.exact(p).sign();
        for a in &planes {
            for p in ends {
                assert_eq!(value(a, p), i32::from(a.value(p) > 0.0) - i32::from(a.value(p) < 0.0));
            }
            for b in &planes {
                assert_eq!(sign(a, b), -sign(b, a));
            }
            assert_eq!(sign(a, a), 0);
        }
    }

    #[test]
    fn naive_arithmetic_fails_where_the_exact_sign_holds() {
        let (a, b, c, d) = (1.0 + f64::EPSILON, 1.0, 1.0 + 2.0 * f64::EPSILON, 1.0 + f64::EPSILON);
        // (1+e)^2 - (1+2e) = e^2 > 0, which rounds away
        assert_eq!(a * d - b * c, 0.0);
        assert_eq!(sign_det2(a, b, c, d), 1);
        assert_eq!(sign_det3([a, b, 0.0], [c, d, 0.0], [0.0, 0.0, 1.0]), 1);
    }

    proptest! {
        /// Near or far, well spread or nearly in a line: who is farther off than the rounding is on the side that the distance says.
        #[test]
        fn a_distance_over_its_rounding_has_the_side_of_the_exact_value(
            points in prop::array::uniform3(prop::array::uniform3(-1.0f64..1.0)), p in prop::array::uniform3(-1.0f64..1.0),
            far in 0.0f64..40.0, thin in 0.0f64..16.0, equation in any::<bool>(),
        ) {
            let [a, b, c] = points.map(DVec3::from_array);
            let (p, size) = (DVec3::from_array(p), 10f64.powf(far));
            let c = a + (b - a) * c.x + (c - a) * 10f64.powf(-thin);
            let plane = if equation {
                Plane::Equation { normal: a, offset: size * b.x }
            } else {
                Plane::Points([a, b, c].map(|q| q * size))
            };
            let (distance, value) = (plane.distance(p), plane.value(p));
            if distance.abs() > plane.rounding(p.length()) {
                prop_assert_eq!(distance > 0.0, value > 0.0, "{} of {:?} {}", distance, plane, value);
            }
        }
        #[test]
        fn determinants_agree_with_integers(m in prop::array::uniform9(-40i64..40)) {
            let f = m.map(|x| x as f64);
            let det2 = m[0] * m[3] - m[1] * m[2];
            prop_assert_eq!(sign_det2(f[0], f[1], f[2], f[3]), det2.signum() as i32);
            let det3 = m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
            prop_assert_eq!(sign_det3([f[0], f[1], f[2]], [f[3], f[4], f[5]], [f[6], f[7], f[8]]), det3.signum() as i32);
        }
    }
}
