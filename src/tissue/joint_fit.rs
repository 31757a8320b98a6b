//! Where a joint's quad is after the tissue has moved: that is told by the vertices that lie on it (MATHS 5.5).

use crate::geometry::VertexId;
use glam::DVec3;

/// Vertices that a quad is fitted to at most.
const PINS: usize = 16;

/// Vertices that spread less over the quad than the root of this share of it tell where it is, but not how it has turned and stretched.
const RIDGE: f64 = 0.005;

/// A vertex of a joint.
#[derive(Clone, Copy)]
struct Pin {
    vertex: VertexId,
    /// Where it lies: shares of the way from the minus side to the plus, and from the tip to the top.
    at: [f64; 2],
    /// What is left of its position then, metres.
    off: DVec3,
}

/// Vertices that were made on a joint, and where they lie on its quad.
#[derive(Default)]
pub(super) struct Pins {
    pins: [Option<Pin>; PINS],
}

impl Pins {
    /// Those `on_joint`, or some of them where they are many, on a parallelogram of corners tip-, tip+, top+, top-.
    pub(super) fn new(
        quad: &[DVec3; 4],
        on_joint: impl Iterator<Item = VertexId> + Clone,
        position: impl Fn(VertexId) -> DVec3,
    ) -> Self {
        let mut pins = [None; PINS];
        let each = on_joint.clone().count().div_ceil(PINS).max(1);
        for (pin, vertex) in pins.iter_mut().zip(on_joint.step_by(each)) {
            let p = position(vertex);
            let at = shares(quad, p);
            *pin = Some(Pin { vertex, at, off: p - point(quad, at) });
        }
        Self { pins }
    }

    /// `quad`, which has come near to where those vertices have gone, moved, turned and stretched so that it fits them best.
    /// Bit for bit what it was if they are where it says. `position` is asked of vertices and gives none for those that are gone.
    pub(super) fn fit(&self, quad: [DVec3; 4], position: impl Fn(VertexId) -> Option<DVec3>) -> [DVec3; 4] {
        let off = |pin: &Pin| position(pin.vertex).map(|p| (pin.at, p - point(&quad, pin.at) - pin.off));
        let off = || self.pins.iter().flatten().filter_map(off);
        let count = off().count() as f64;
        if count == 0.0 {
            return quad;
        }
        let (sum_u, sum_v, sum) = off().fold((0.0, 0.0, DVec3::ZERO), |(u, v, sum), (at, by)| (u + at[0], v + at[1], sum + by));
        let (u, v, mean) = (sum_u / count, sum_v / count, sum / count);
        // least squares for mean + across * (u - mean u) + along * (v - mean v), which has to pay for its slopes
        let (mut uu, mut uv, mut vv) = (RIDGE * count, 0.0, RIDGE * count);
        let (mut by_u, mut by_v) = (DVec3::ZERO, DVec3::ZERO);
        for (at, by) in off() {
            let (du, dv) = (at[0] - u, at[1] - v);
            uu += du * du;
            uv += du * dv;
            vv += dv * dv;
            by_u += by * du;
            by_v += by * dv;
        }
        let determinant = uu * vv - uv * uv;
        let across = (by_u * vv - by_v * uv) / determinant;
        let along = (by_v * uu - by_u * uv) / determinant;
        let mut fitted = quad;
        for (corner, at) in fitted.iter_mut().zip([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) {
            *corner += mean + across * (at[0] - u) + along * (at[1] - v);
        }
        fitted
    }
}

/// The point of a parallelogram at these shares.
fn point(quad: &[DVec3; 4], at: [f64; 2]) -> DVec3 {
    quad[0] + (quad[1] - quad[0]) * at[0] + (quad[3] - quad[0]) * at[1]
}

/// The shares of the point of a parallelogram that is nearest to `p`: zero along sides of no length.
fn shares(quad: &[DVec3; 4], p: DVec3) -> [f64; 2] {
    let (across, along, p) = (quad[1] - quad[0], quad[3] - quad[0], p - quad[0]);
    let (aa, ab, bb) = (across.length_squared(), across.dot(along), along.length_squared());
    let determinant = aa * bb - ab * ab;
    if determinant > 1e-18 * aa * bb {
        let (pa, pb) = (p.dot(across), p.dot(along));
        return [(pa * bb - pb * ab) / determinant, (pb * aa - pa * ab) / determinant];
    }
    [0.0, if bb > 0.0 { p.dot(along) / bb } else { 0.0 }]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    const QUAD: [DVec3; 4] =
        [DVec3::ZERO, DVec3::new(0.002, 0.0, 0.0), DVec3::new(0.003, 0.05, 0.01), DVec3::new(0.001, 0.05, 0.01)];

    fn on_joint(at: &[[f64; 2]]) -> (Vec<VertexId>, Vec<DVec3>) {
        ((0..at.len()).map(VertexId::new).collect(), at.iter().map(|at| point(&QUAD, *at)).collect())
    }

    #[test]
    fn a_quad_follows_the_vertices_on_it_wherever_they_go() {
        let (tags, stood) = on_joint(&[[0.0, 0.0], [1.0, 0.0], [0.0, 0.8], [1.0, 0.8], [0.4, 0.81]]);
        let pins = Pins::new(&QUAD, tags.iter().copied(), |v| stood[v.index()]);
        assert!(pins.fit(QUAD, |v| Some(stood[v.index()])) == QUAD, "what has not moved keeps its bits");
        // sheared, turned and stretched across by more than its width
        let to = DMat3::from_cols(DVec3::new(2.5, 0.3, 0.1), DVec3::new(-0.2, 1.1, 0.2), DVec3::new(0.1, -0.1, 0.9));
        let moved = |p: DVec3| to * p + DVec3::new(0.004, -0.002, 0.003);
        let fitted = pins.fit(QUAD, |v| Some(moved(stood[v.index()])));
        let worst = |quad: [DVec3; 4]| quad.iter().zip(QUAD).map(|(a, b)| a.distance(moved(b))).fold(0.0, f64::max);
        assert!(worst(fitted) < 0.05 * worst(QUAD), "{} of {}", worst(fitted), worst(QUAD));
        // what it is fitted to stays a parallelogram
        assert!((fitted[0] + fitted[2] - fitted[1] - fitted[3]).length() < 1e-12);
        // and the vertices that are gone are not asked for
        let half = pins.fit(QUAD, |v| (v.index() != 4).then(|| moved(stood[v.index()])));
        assert!(worst(half) < 0.05 * worst(QUAD));
        assert!(pins.fit(QUAD, |_| None) == QUAD);
    }

    /// Two vertices in a line across tell nothing of how the blade has turned along itself.
    #[test]
    fn vertices_in_a_line_do_not_turn_the_quad_about_it() {
        let (tags, stood) = on_joint(&[[0.0, 0.8], [1.0, 0.8 + 1e-6]]);
        let pins = Pins::new(&QUAD, tags.iter().copied(), |v| stood[v.index()]);
        let apart = DVec3::new(0.0, 0.001, 0.001);
        let fitted = pins.fit(QUAD, |v| Some(stood[v.index()] + if v.index() == 1 { apart } else { DVec3::ZERO }));
        for (k, corner) in fitted.iter().enumerate() {
            let by = if k == 1 || k == 2 { apart } else { DVec3::ZERO };
            assert!(corner.distance(QUAD[k] + by) < 0.05 * apart.length(), "corner {k}");
        }
    }

    #[test]
    fn a_degenerate_quad_gives_no_nan() {
        let quad = [DVec3::ZERO, DVec3::ZERO, DVec3::Y, DVec3::Y];
        let (tags, stood) = on_joint(&[[0.0, 0.0], [1.0, 0.8]]);
        let pins = Pins::new(&quad, tags.iter().copied(), |v| stood[v.index()]);
        assert!(pins.fit(quad, |v| Some(stood[v.index()] + DVec3::X)).iter().all(|p| p.is_finite()));
        let none = Pins::new(&[DVec3::ZERO; 4], tags.iter().copied(), |v| stood[v.index()]);
        assert!(none.fit([DVec3::ZERO; 4], |_| Some(DVec3::X)).iter().all(|p| p.is_finite()));
    }
}
