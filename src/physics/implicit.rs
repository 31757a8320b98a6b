//! The step for stiff networks, where a series would be too long (MATHS 4.2): unconditionally stable, one kind of solve.
//!
//! Damping is proportional to mass, so every mode decays at a known rate, and that rate is taken out exactly:
//! `y = e^(-st) Y` with `s` the slowest decay of any mode leaves `Y'' + c' Y' + (A - sigma) Y = 0` with `c' = c - 2s` and
//! `sigma = s (c - s)`, whose matrix is positive semi-definite. `Y` is stepped by the L-stable two-stage SDIRK method
//! (Alexander 1977), or without any damping by the midpoint rule, which keeps the energy. Taking a network's decay from the
//! method instead would leave 5 % of the amplitude after one step of h omega = 100 at damping ratio 0.1, where the law leaves
//! 5e-5.

use super::matrix::{Lanes, Matrix, Pair, add_scaled, blend, minus};
use super::propagator::Propagator;
use std::ops::Range;

const GAMMA: f64 = 1.0 - std::f64::consts::FRAC_1_SQRT_2;
/// Iterations of one conjugate-gradient solve at most; what it then has is smaller than the solution, never larger.
const MAX_ITERATIONS: usize = 600;
/// Wanted residual relative to the right-hand side: with damping, and without, where it is energy for ever.
const TOLERANCE: f64 = 1e-8;
const TOLERANCE_UNDAMPED: f64 = 1e-13;

type Vector = Vec<Lanes>;

/// Work space of the implicit step.
#[derive(Clone, Debug, Default)]
pub struct ImplicitScratch {
    residual: Vector,
    search: Vector,
    image: Vector,
    right: Vector,
    offset: Vector,
    slope: Vector,
    y: Vector,
    w: Vector,
    /// Inverse diagonal of the system at hand.
    inverse: Vec<f64>,
}

/// What the implicit step reads. Vectors by row; zero in rows that are held.
#[derive(Clone, Copy)]
pub struct ImplicitInput<'a> {
    /// The matrix.
    pub matrix: &'a Matrix,
    /// Rows to propagate.
    pub ranges: &'a [Range<u32>],
    /// Masses, kg.
    pub masses: &'a [f64],
    /// Velocity and acceleration (damping set aside).
    pub state: &'a [Pair],
    /// Rate of change of the acceleration over the step, if any.
    pub ramp: Option<&'a [Lanes]>,
    /// Displacement from rest: where the search for the equilibrium starts.
    pub e: &'a [Lanes],
    /// Damping rate `c`, 1/s.
    pub damping: f64,
    /// Slowest decay rate of any mode `s`, 1/s.
    pub decay: f64,
    /// Step, s.
    pub step: f64,
}

/// Worst energy-norm error a step over the modes between `low` and `high` (1/s^2), relative: what the method makes of
/// each mode against the closed form. At large steps without damping it is 2: such modes are kept bounded, not followed.
pub fn error_bound(low: f64, high: f64, damping: f64, decay: f64, step: f64) -> f64 {
    let left = (-decay * step).exp();
    let sigma = decay * (damping - decay);
    let extra = damping - 2.0 * decay;
    let (from, to) = (((low - sigma).max(0.0)).sqrt() * step, (high - sigma).max(0.0).sqrt() * step);
    let mut worst: f64 = 0.0;
    for k in 0..=48 {
        let angle = from.max(1e-3 * to) * (to / from.max(1e-3 * to)).powf(k as f64 / 48.0);
        if angle == 0.0 {
            continue;
        }
        // One mode in scaled phase space: Y = 1, W = 0 in units of its frequency; the error in both components.
        let exact = Propagator::new(angle * angle, extra * step, 1.0);
        let (y, w) = scalar_step(angle, extra * step, damping == 0.0);
        let error = (y - 1.0 + angle * angle * exact.force).hypot(w + angle * exact.sine);
        worst = worst.max(error);
    }
    left * worst
}

/// The method on `Y'' + extra Y' + angle^2 Y = 0`, unit step, from Y = 1, W = 0; returns Y and W / angle.
fn scalar_step(angle: f64, extra: f64, undamped: bool) -> (f64, f64) {
    let stiffness = angle * angle;
    if undamped {
        let y = 2.0 / (1.0 + 0.25 * stiffness) - 1.0;
        return (y, 2.0 * (y - 1.0) / angle);
    }
    let solve = |a: f64, b: f64| {
        let p = ((1.0 + GAMMA * extra) * a + GAMMA * b) / (1.0 + GAMMA * extra + GAMMA * GAMMA * stiffness);
        (p, (p - a) / GAMMA)
    };
    let (p, q) = solve(1.0, 0.0);
    let ahead = (1.0 - GAMMA) / GAMMA;
    let (y, w) = solve(1.0 + ahead * (p - 1.0), ahead * q);
    (y, w / angle)
}

/// Writes displacement change and new velocity of each row of the ranges into `result`; returns the solver's iterations.
#[inline(always)]
pub fn implicit_step(input: &ImplicitInput, scratch: &mut ImplicitScratch, result: &mut [Pair]) -> usize {
    let ImplicitInput { ranges, state, step: h, damping, decay: s, .. } = *input;
    scratch.resize(state.len());
    let mut iterations = particular(input, scratch);
    let ImplicitScratch { offset, slope, y, w, .. } = scratch;
    for row in rows(ranges) {
        for k in 0..4 {
            y[row][k] = -offset[row][k];
            w[row][k] = state[row].first[k] - slope[row][k] + s * y[row][k];
        }
    }
    iterations += if damping == 0.0 { midpoint(input, scratch) } else { sdirk(input, scratch) };
    let left = (-s * h).exp();
    let ImplicitScratch { offset, slope, y, w, .. } = scratch;
    for row in rows(ranges) {
        let change = std::array::from_fn(|k| offset[row][k] + h * slope[row][k] + left * y[row][k]);
        let velocity = std::array::from_fn(|k| slope[row][k] + left * (w[row][k] - s * y[row][k]));
        result[row] = Pair { first: change, second: velocity };
    }
    iterations
}

/// The particular solution `offset + slope t` of `d'' + c d' + A d = r + q t`: `A slope = q`, `A offset = r - c slope`.
#[inline(always)]
fn particular(input: &ImplicitInput, scratch: &mut ImplicitScratch) -> usize {
    let ImplicitInput { ranges, state, ramp, e, damping, .. } = *input;
    let mut iterations = 0;
    if let Some(ramp) = ramp {
        for row in rows(ranges) {
            scratch.right[row] = ramp[row];
        }
        iterations += solve(input, (0.0, 1.0), scratch, |s| &mut s.slope);
    }
    for row in rows(ranges) {
        scratch.right[row] = add_scaled(&state[row].second, -damping, &scratch.slope[row]);
        // Without forces and grabs the equilibrium is e = 0: the guess is the answer.
        scratch.offset[row] = e[row].map(|x| -x);
    }
    iterations + solve(input, (0.0, 1.0), scratch, |s| &mut s.offset)
}

/// The undamped midpoint rule on (y, w).
#[inline(always)]
fn midpoint(input: &ImplicitInput, scratch: &mut ImplicitScratch) -> usize {
    let ImplicitInput { ranges, step: h, .. } = *input;
    let ImplicitScratch { y, w, right, offset, .. } = scratch;
    for row in rows(ranges) {
        for k in 0..4 {
            right[row][k] = 2.0 * y[row][k] + h * w[row][k];
            // y becomes the sum of old and new; -offset still holds the old.
            y[row][k] = offset[row][k];
        }
    }
    let iterations = solve(input, (1.0, 0.25 * h * h), scratch, |s| &mut s.y);
    let ImplicitScratch { y, w, offset, .. } = scratch;
    for row in rows(ranges) {
        for k in 0..4 {
            let old = -offset[row][k];
            y[row][k] -= old;
            w[row][k] = 2.0 * (y[row][k] - old) / h - w[row][k];
        }
    }
    iterations
}

/// The L-stable two-stage SDIRK method on (y, w).
#[inline(always)]
fn sdirk(input: &ImplicitInput, scratch: &mut ImplicitScratch) -> usize {
    let ImplicitInput { ranges, step: h, damping, decay, .. } = *input;
    let (reach, extra) = (GAMMA * h, damping - 2.0 * decay);
    let sigma = decay * (damping - decay);
    let own = 1.0 + reach * extra;
    let shift = (own - reach * reach * sigma, reach * reach);
    let ahead = (1.0 - GAMMA) / GAMMA;
    let mut iterations = 0;
    for stage in 0..2 {
        let ImplicitScratch { y, w, right, .. } = scratch;
        for row in rows(ranges) {
            for k in 0..4 {
                right[row][k] = own * y[row][k] + reach * w[row][k];
            }
        }
        // The solve overwrites y; its start is recovered below from `right` and w.
        iterations += solve(input, shift, scratch, |s| &mut s.y);
        let ImplicitScratch { y, w, right, .. } = scratch;
        for row in rows(ranges) {
            for k in 0..4 {
                let start = (right[row][k] - reach * w[row][k]) / own;
                let start_w = w[row][k];
                let stage_w = (y[row][k] - start) / reach;
                if stage == 0 {
                    y[row][k] = start + ahead * (y[row][k] - start);
                    w[row][k] = start_w + ahead * (stage_w - start_w);
                } else {
                    w[row][k] = stage_w;
                }
            }
        }
    }
    iterations
}

#[inline(always)]
fn rows(ranges: &[Range<u32>]) -> impl Iterator<Item = usize> + '_ {
    ranges.iter().flat_map(|r| r.start as usize..r.end as usize)
}

impl ImplicitScratch {
    fn resize(&mut self, rows: usize) {
        let Self { residual, search, image, right, offset, slope, y, w, inverse } = self;
        inverse.resize(rows, 0.0);
        for vector in [residual, search, image, right, offset, slope, y, w] {
            vector.clear();
            vector.resize(rows, [0.0; 4]);
        }
    }
}

/// Solves `(alpha + beta A) x = right` by conjugate gradients in the mass inner product, preconditioned by the diagonal,
/// the three components side by side. `x` enters as the guess.
#[inline(always)]
fn solve(
    input: &ImplicitInput,
    shift: (f64, f64),
    scratch: &mut ImplicitScratch,
    unknown: impl Fn(&mut ImplicitScratch) -> &mut Vector,
) -> usize {
    let mut x = std::mem::take(unknown(scratch));
    let (goal, mut rho) = start(input, shift, scratch, &x);
    let mut iterations = 0;
    while iterations < MAX_ITERATIONS && (0..3).any(|k| rho[k] > goal[k]) {
        iterations += 1;
        let curvature = curve(input, shift, scratch);
        let length: Lanes = std::array::from_fn(|k| if curvature[k] > 0.0 { rho[k] / curvature[k] } else { 0.0 });
        let next = advance(input, scratch, &length, &mut x);
        let turn: Lanes = std::array::from_fn(|k| if rho[k] > 0.0 { next[k] / rho[k] } else { 0.0 });
        for range in input.ranges.iter().map(whole) {
            for row in range {
                let fresh = scratch.residual[row].map(|r| scratch.inverse[row] * r);
                scratch.search[row] = add_product(&fresh, &turn, &scratch.search[row]);
            }
        }
        rho = next;
    }
    *unknown(scratch) = x;
    iterations
}

/// Residual, first direction, and the squared norms to reach and at hand.
#[inline(always)]
fn start(input: &ImplicitInput, (alpha, beta): (f64, f64), scratch: &mut ImplicitScratch, x: &[Lanes]) -> (Lanes, Lanes) {
    let ImplicitScratch { residual, search, right, inverse, .. } = scratch;
    let (mut goal, mut rho) = ([0.0; 4], [0.0; 4]);
    for range in input.ranges.iter().map(whole) {
        for row in range {
            inverse[row] = 1.0 / (alpha + beta * input.matrix.diagonal(row));
            let image = blend(alpha, &x[row], beta, &input.matrix.apply_row(row, x));
            residual[row] = minus(&right[row], &image);
            search[row] = residual[row].map(|r| inverse[row] * r);
            let weight = input.masses[row] * inverse[row];
            goal = add_scaled(&goal, weight, &product(&right[row], &right[row]));
            rho = add_scaled(&rho, weight, &product(&residual[row], &residual[row]));
        }
    }
    let tolerance = if input.damping == 0.0 { TOLERANCE_UNDAMPED } else { TOLERANCE };
    (goal.map(|g| g * tolerance * tolerance), rho)
}

/// The system's image of the search direction; returns their product.
#[inline(always)]
fn curve(input: &ImplicitInput, (alpha, beta): (f64, f64), scratch: &mut ImplicitScratch) -> Lanes {
    let ImplicitScratch { search, image, .. } = scratch;
    let mut curvature = [0.0; 4];
    for range in input.ranges.iter().map(whole) {
        for row in range {
            image[row] = blend(alpha, &search[row], beta, &input.matrix.apply_row(row, search));
            curvature = add_scaled(&curvature, input.masses[row], &product(&search[row], &image[row]));
        }
    }
    curvature
}

/// Goes along the search direction; returns the new squared norm of the residual.
#[inline(always)]
fn advance(input: &ImplicitInput, scratch: &mut ImplicitScratch, length: &Lanes, x: &mut [Lanes]) -> Lanes {
    let ImplicitScratch { residual, search, image, inverse, .. } = scratch;
    let back = length.map(|l| -l);
    let mut next = [0.0; 4];
    for range in input.ranges.iter().map(whole) {
        for row in range {
            x[row] = add_product(&x[row], length, &search[row]);
            residual[row] = add_product(&residual[row], &back, &image[row]);
            next = add_scaled(&next, input.masses[row] * inverse[row], &product(&residual[row], &residual[row]));
        }
    }
    next
}

#[inline(always)]
fn whole(range: &Range<u32>) -> Range<usize> {
    range.start as usize..range.end as usize
}

#[inline(always)]
fn product(x: &Lanes, y: &Lanes) -> Lanes {
    std::array::from_fn(|k| x[k] * y[k])
}

#[inline(always)]
fn add_product(x: &Lanes, a: &Lanes, y: &Lanes) -> Lanes {
    std::array::from_fn(|k| x[k] + a[k] * y[k])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::NetworkTopology;

    /// One step of a network that is rigidly shifted: only the anchors pull, so it is one mode, with a known answer.
    fn shifted(damping_ratio: f64, h: f64) -> (f64, f64) {
        let topology = NetworkTopology::from_pairs(3, [(0, 1, 1.0), (1, 2, 2.0)].into_iter());
        let mut matrix = Matrix::default();
        matrix.set_rows(&topology, &[0, 1, 2], &[0, 1, 2], &[1.0; 3]);
        matrix.set_stiffness(1.0, 1.0, [1.0; 3].into_iter());
        let e = [[1.0, 0.0, 0.0, 0.0]; 3];
        let state: Vec<Pair> =
            (0..3).map(|row| Pair { first: [0.0; 4], second: matrix.apply_row(row, &e).map(|x| -x) }).collect();
        let damping = 2.0 * damping_ratio;
        let decay =
            if damping_ratio > 1.0 { damping_ratio - (damping_ratio * damping_ratio - 1.0).sqrt() } else { damping_ratio };
        let (masses, range) = ([1.0; 3], 0..3);
        let input = ImplicitInput {
            matrix: &matrix,
            ranges: std::slice::from_ref(&range),
            masses: &masses,
            state: &state,
            ramp: None,
            e: &e,
            damping,
            decay,
            step: h,
        };
        let mut result = vec![Pair::default(); 3];
        implicit_step(&input, &mut ImplicitScratch::default(), &mut result);
        let exact = Propagator::new(1.0, damping, h);
        ((result[1].first[0] + exact.force).abs(), (result[1].second[0] + exact.sine).abs())
    }

    #[test]
    fn it_is_of_second_order_in_every_regime() {
        for damping_ratio in [0.0, 0.1, 0.9, 3.0] {
            let error = |h: f64| {
                let (u, v) = shifted(damping_ratio, h);
                u.max(v)
            };
            // Third order in one step; a first-order method (broken twin) would quarter it.
            let ratio = error(0.08) / error(0.04);
            assert!(error(0.08) < 1e-3 && (5.5..11.0).contains(&ratio), "{damping_ratio}: {ratio}");
        }
    }

    #[test]
    fn the_bound_covers_a_mode_and_falls_with_the_step() {
        for h in [0.01, 0.1, 1.0, 10.0] {
            let bound = error_bound(1.0, 4.0, 0.2, 0.1, h);
            let (u, _) = shifted(0.1, h);
            assert!(u <= 1.5 * bound + 1e-9, "h {h}: {u} {bound}");
        }
        assert!(error_bound(1.0, 4.0, 0.2, 0.1, 0.01) < 1e-5);
        assert!(error_bound(1.0, 4.0, 0.0, 0.0, 100.0) > 0.5);
    }
}
