//! The damped oscillator in closed form (MATHS 4.2): the scalar functions whose matrix counterparts move the network.
//!
//! For `e'' + c e' + x e = r0 + q t` read at the present state (`r0` the acceleration left after damping is set aside,
//! `q` its rate of change), one step of length `h` is exactly
//!
//! ```text
//! e(h) - e = sine v + force r0 + ramp q          v(h) = keep v + sine r0 + force q
//! ```
//!
//! Measured from the present state, so an equilibrium (`r0 = v = q = 0`) stays put whatever the error of the functions.

/// The four functions at one `x` (squared frequency of the undamped mode, 1/s^2), for one step length and damping.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Propagator {
    /// `e^(-ch/2) sin(h w) / w` with `w^2 = x - c^2/4`: displacement per velocity, and velocity per acceleration. Seconds.
    pub sine: f64,
    /// Velocity kept: the derivative of `sine`.
    pub keep: f64,
    /// Displacement per constant acceleration, the integral of `sine`. Seconds squared.
    pub force: f64,
    /// Displacement per constant rate of acceleration, the integral of `force`. Seconds cubed.
    pub ramp: f64,
}

/// Under this size of `c h + h^2 |x|` the Taylor series of the equation is used: no cancellation, and at most 24 terms.
const TAYLOR_LIMIT: f64 = 1.0;

impl Propagator {
    /// The functions at `x >= 0` (1/s^2), damping rate `c >= 0` (1/s: the coefficient of `M u'`) and step `h >= 0` (s).
    /// `c` up to 2000 times `sqrt x` (beyond it `ramp` loses digits). Stable at critical damping, near `x = 0` and for any size of `c h` or `h^2 x`: nothing overflows, since the decay
    /// is taken inside the hyperbolic functions.
    pub fn new(x: f64, c: f64, h: f64) -> Self {
        if c * h + h * h * x.abs() < TAYLOR_LIMIT { Self::taylor(x, c, h) } else { Self::direct(x, c, h) }
    }

    /// Power series of `y'' + c y' + x y = t` in `t`, summed at `h`: `ramp` and its three derivatives.
    fn taylor(x: f64, c: f64, h: f64) -> Self {
        let (damping, stiffness) = (c * h, x * h * h);
        // Terms a_n h^n of y; a_3 = 1/6 is the first, the source acts at n = 1 only.
        let (mut before, mut term) = (0.0, h * h * h / 6.0);
        let mut sums = [0.0; 4];
        let mut n = 3.0;
        for _ in 0..28 {
            sums[0] += term;
            sums[1] += n * term;
            sums[2] += n * (n - 1.0) * term;
            sums[3] += n * (n - 1.0) * (n - 2.0) * term;
            let next = -(damping * n * term + stiffness * before) / (n * (n + 1.0));
            (before, term) = (term, next);
            n += 1.0;
        }
        if h == 0.0 {
            return Self { keep: 1.0, ..Self::default() };
        }
        Self { ramp: sums[0], force: sums[1] / h, sine: sums[2] / (h * h), keep: sums[3] / (h * h * h) }
    }

    fn direct(x: f64, c: f64, h: f64) -> Self {
        let half = 0.5 * c;
        let discriminant = half * half - x;
        let root = discriminant.abs().sqrt();
        let angle = h * root;
        let (sine, keep, lost);
        if discriminant > 0.0 && angle > 0.5 {
            // Two real rates; the slow one without cancellation.
            let fast = -(half + root);
            let slow = x / fast;
            let (decay_slow, decay_fast) = ((slow * h).exp(), (fast * h).exp());
            let gap = 2.0 * root;
            sine = (decay_slow - decay_fast) / gap;
            keep = (slow * decay_slow - fast * decay_fast) / gap;
            // (1 - e^(-ch/2)(C + c/2 S)) with expm1, so that a slow mode keeps its digits.
            lost = (fast * (slow * h).exp_m1() - slow * (fast * h).exp_m1()) / gap;
        } else {
            let decay = (-half * h).exp();
            let (cosine, sinc) =
                if angle < 0.5 { cos_sinc_series(h * h * discriminant) } else { (angle.cos(), angle.sin() / angle) };
            sine = decay * h * sinc;
            keep = decay * cosine - half * sine;
            lost = 1.0 - decay * cosine - half * sine;
        }
        let force = lost / x;
        Self { sine, keep, force, ramp: (h - c * force - sine) / x }
    }
}

/// `cosh(sqrt z)` and `sinh(sqrt z) / sqrt z` for small `|z|`, either sign: through critical damping without a branch.
fn cos_sinc_series(z: f64) -> (f64, f64) {
    let (mut cosine, mut sinc) = (0.0, 0.0);
    let mut term = 1.0;
    for k in 0..10 {
        let even = (2 * k) as f64;
        cosine += term;
        sinc += term / (even + 1.0);
        term *= z / ((even + 1.0) * (even + 2.0));
    }
    (cosine, sinc)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Classical RK4 of `y'' + c y' + x y = t`, `steps` steps: an independent reference of all four functions.
    fn reference(x: f64, c: f64, h: f64, steps: usize) -> Propagator {
        let run = |mut y: f64, mut v: f64, source: fn(f64) -> f64| {
            let dt = h / steps as f64;
            let f = |t: f64, y: f64, v: f64| (v, source(t) - c * v - x * y);
            for k in 0..steps {
                let t = k as f64 * dt;
                let a = f(t, y, v);
                let b = f(t + dt / 2.0, y + dt / 2.0 * a.0, v + dt / 2.0 * a.1);
                let d = f(t + dt / 2.0, y + dt / 2.0 * b.0, v + dt / 2.0 * b.1);
                let e = f(t + dt, y + dt * d.0, v + dt * d.1);
                y += dt / 6.0 * (a.0 + 2.0 * b.0 + 2.0 * d.0 + e.0);
                v += dt / 6.0 * (a.1 + 2.0 * b.1 + 2.0 * d.1 + e.1);
            }
            (y, v)
        };
        let (sine, keep) = run(0.0, 1.0, |_| 0.0);
        let (force, _) = run(0.0, 0.0, |_| 1.0);
        let (ramp, _) = run(0.0, 0.0, |t| t);
        Propagator { sine, keep, force, ramp }
    }

    fn distance(a: Propagator, b: Propagator, x: f64, h: f64) -> f64 {
        // In units of the functions' own scale: a step or a period, whichever is shorter.
        let scale = h.min(1.0 / x.sqrt());
        let parts = [
            (a.sine - b.sine) / scale,
            a.keep - b.keep,
            (a.force - b.force) / scale.powi(2),
            (a.ramp - b.ramp) / (h * scale.powi(2)),
        ];
        parts.into_iter().fold(0.0, |m, p| m.max(p.abs()))
    }

    #[test]
    fn matches_a_converged_reference_in_every_regime() {
        for (x, c, h) in [
            (100.0, 1.0, 0.05),
            (100.0, 0.0, 0.5),
            (100.0, 20.0, 0.3),
            (100.0, 20.0 + 1e-7, 0.3),
            (100.0, 20.0 - 1e-7, 0.3),
            (100.0, 100.0, 0.3),
            (1e-6, 3.0, 1.0),
            (1e-6, 0.01, 1.0),
            (1e-10, 0.0, 1e-3),
            (4000.0, 8.0, 1.0 / 60.0),
        ] {
            let exact = reference(x, c, h, 4000);
            let got = Propagator::new(x, c, h);
            assert!(distance(got, exact, x, h) < 2e-9, "x {x} c {c} h {h}: {got:?} {exact:?}");
            // Broken twin: one per cent more stiffness is told apart wherever stiffness matters at all.
            if x * h * h > 1e-3 {
                assert!(distance(Propagator::new(1.01 * x, c, h), exact, x, h) > 1e-6);
            }
        }
    }

    #[test]
    fn taylor_and_direct_agree_where_they_meet() {
        for (x, c, h) in [(0.9, 0.09, 1.0), (0.1, 0.9, 1.0), (0.4, 0.6, 1.0), (0.49, 1.4, 0.6)] {
            let (a, b) = (Propagator::taylor(x, c, h), Propagator::direct(x, c, h));
            assert!(distance(a, b, x, h) < 1e-13, "{a:?} {b:?}");
        }
    }

    #[test]
    fn extreme_arguments_stay_finite_and_bounded() {
        for x in [1e-4, 1.0, 1e9, 1e15] {
            for c in [0.0, 1e-6, 1.0, 2.0, 20.0, 2000.0].map(|ratio| ratio * f64::sqrt(x)) {
                for h in [0.0, 1e-9, 1e-5, 1.0 / 60.0, 1.0] {
                    let p = Propagator::new(x, c, h);
                    let bounded = p.keep.abs() <= 1.0 + 1e-12
                        && p.sine.abs() <= h * (1.0 + 1e-12)
                        && p.force >= -1e-12 * h * h
                        && p.force <= 0.5 * h * h * (1.0 + 1e-9)
                        && p.ramp <= h * h * h / 6.0 * (1.0 + 1e-9);
                    assert!(bounded, "x {x} c {c} h {h}: {p:?}");
                }
            }
        }
    }

    /// 1e-6 over 20 s at any frequency: many steps against one.
    #[test]
    fn twenty_seconds_of_steps_equal_one_closed_form() {
        for k in [1.0, 1e3, 1e6, 1e9] {
            for ratio in [0.0, 1e-4, 1.0, 3.0] {
                for h in [1.0f64 / 90.0, 1.0 / 60.0, 1.0] {
                    let c = 2.0 * ratio * f64::sqrt(k);
                    let steps = (20.0 / h).round();
                    let p = Propagator::new(k, c, h);
                    let (mut u, mut v) = (1.0, 0.0);
                    for _ in 0..steps as usize {
                        let r = -k * u;
                        (u, v) = (u + p.sine * v + p.force * r, p.keep * v + p.sine * r);
                    }
                    let total = h * steps;
                    let exact = 1.0 - k * Propagator::new(k, c, total).force;
                    assert!((u - exact).abs() < 1e-6, "k {k} ratio {ratio} h {h}: {u} {exact}");
                    let wrong = 1.0 - k * Propagator::new(k * 1.001, c, total).force;
                    assert!(ratio > 0.5 || (u - wrong).abs() > 1e-6, "k {k} ratio {ratio}");
                }
            }
        }
    }
}
