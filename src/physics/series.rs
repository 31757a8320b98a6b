//! Chebyshev series of the four [`Propagator`] functions on a network's spectrum (MATHS 4.2).
//!
//! MATHS writes them as functions of `B = A - c^2/4`; as functions of `A` on the shifted interval they are the same
//! polynomials, with the decay `e^(-ch/2)` taken inside so that nothing overflows.

use super::propagator::Propagator;

/// What a series was computed for; it is reused while this stays the same.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SeriesKey {
    /// Lower end of the spectrum, 1/s^2.
    pub low: f64,
    /// Upper end (Gershgorin), 1/s^2.
    pub high: f64,
    /// Damping rate `c`, 1/s.
    pub damping: f64,
    /// Step, s.
    pub step: f64,
    /// Wanted error a step, relative, in the energy norm.
    pub tolerance: f64,
}

/// Coefficients `[sine, keep, force, ramp]` by degree, the constant term already halved.
#[derive(Clone, Debug, Default)]
pub struct Series {
    key: SeriesKey,
    coefficients: Vec<[f64; 4]>,
    degree: usize,
    error_bound: f64,
    cosines: Vec<f64>,
    samples: Vec<[f64; 4]>,
    /// How often coefficients were computed: a steady run computes them once.
    pub updates: u64,
}

/// Longest series tried; more needs a step of `h omega_max` near 2000.
pub const MAX_DEGREE: usize = 1024;

/// Nodes that room is made for at first: steps of an `h omega_max` up to 400.
const NODES: usize = 256;

impl Series {
    /// Makes room for series of usual length.
    pub fn make_room(&mut self) {
        self.cosines.reserve(4 * NODES);
        self.samples.reserve(NODES);
        self.coefficients.reserve(NODES);
    }

    /// Makes the series fit `key`; at once if it does already. Returns false if no series of [`MAX_DEGREE`] does.
    pub fn fit(&mut self, key: SeriesKey) -> bool {
        if self.key == key && self.degree > 0 {
            return true;
        }
        self.updates += 1;
        self.degree = 0;
        self.key = key;
        let reach = 0.5 * key.step * key.high.sqrt();
        let mut nodes = (1.1 * reach) as usize + 16;
        while nodes <= 2 * MAX_DEGREE {
            self.sample(nodes);
            if self.truncate(nodes) {
                return true;
            }
            nodes += nodes / 2;
        }
        false
    }

    /// Values at the Chebyshev nodes, then the cosine transform.
    fn sample(&mut self, nodes: usize) {
        let SeriesKey { damping, step, .. } = self.key;
        let (middle, half) = self.interval();
        let turn = 4 * nodes;
        self.cosines.clear();
        self.cosines.extend((0..turn).map(|m| (std::f64::consts::TAU * m as f64 / turn as f64).cos()));
        self.samples.clear();
        for j in 0..nodes {
            let p = Propagator::new(middle + half * self.cosines[2 * j + 1], damping, step);
            self.samples.push([p.sine, p.keep, p.force, p.ramp]);
        }
        self.coefficients.clear();
        for k in 0..nodes {
            let mut sum = [0.0; 4];
            let mut at = k;
            for sample in &self.samples {
                let cosine = self.cosines[at];
                for (s, value) in sum.iter_mut().zip(sample) {
                    *s += cosine * value;
                }
                at += 2 * k;
                if at >= turn {
                    at -= turn;
                }
            }
            let scale = if k == 0 { 1.0 } else { 2.0 } / nodes as f64;
            self.coefficients.push(sum.map(|s| s * scale));
        }
    }

    /// Finds the lowest degree whose tail is within the tolerance. The tail counts every function in units of the
    /// stiffest mode (`v` as `omega e`, `r` as `omega^2 e`): a bound of the energy-norm error a step.
    fn truncate(&mut self, nodes: usize) -> bool {
        let rate = self.key.high.sqrt();
        let mut tail = 0.0;
        let mut k = nodes - 1;
        loop {
            let [sine, keep, force, _] = self.coefficients[k];
            let next = tail + 2.0 * rate * sine.abs() + keep.abs() + self.key.high * force.abs();
            // Dropping all but the constant term would lose the operator altogether: keep degree 1 at least.
            if next > self.key.tolerance || k == 1 {
                break;
            }
            tail = next;
            k -= 1;
        }
        // Aliasing of a transform with too few nodes is as large as the tail beyond them.
        if k + 3 >= nodes {
            return false;
        }
        self.degree = k;
        self.error_bound = tail;
        true
    }

    /// Degree of the polynomial: the number of matrix passes.
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// Bound of the relative error a step in the energy norm.
    pub fn error_bound(&self) -> f64 {
        self.error_bound
    }

    /// `[sine, keep, force, ramp]` of degree `k`.
    pub fn coefficient(&self, k: usize) -> [f64; 4] {
        self.coefficients[k]
    }

    /// Middle and half-width of the interval; never of zero width.
    pub fn interval(&self) -> (f64, f64) {
        let SeriesKey { low, high, .. } = self.key;
        (0.5 * (low + high), (0.5 * (high - low)).max(1e-6 * high))
    }

    /// The series as a function: what it makes of a mode with squared frequency `x`.
    pub fn evaluate(&self, x: f64) -> Propagator {
        let (middle, half) = self.interval();
        let t = (x - middle) / half;
        let (mut b1, mut b2) = ([0.0; 4], [0.0; 4]);
        for k in (1..=self.degree).rev() {
            let b: [f64; 4] = std::array::from_fn(|m| self.coefficients[k][m] + 2.0 * t * b1[m] - b2[m]);
            (b2, b1) = (b1, b);
        }
        let [sine, keep, force, ramp] = std::array::from_fn(|m| self.coefficients[0][m] + t * b1[m] - b2[m]);
        Propagator { sine, keep, force, ramp }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(reach: f64, damping_ratio: f64, tolerance: f64) -> SeriesKey {
        let step = 1.0 / 60.0;
        let high = (reach / step).powi(2);
        let low = high / 30.0;
        SeriesKey { low, high, damping: 2.0 * damping_ratio * low.sqrt(), step, tolerance }
    }

    fn worst(series: &Series, key: SeriesKey) -> f64 {
        (0..=1000).fold(0.0, |worst, k| {
            let x = key.low + (key.high - key.low) * k as f64 / 1000.0;
            let (a, b) = (series.evaluate(x), Propagator::new(x, key.damping, key.step));
            let rate = x.sqrt();
            let e = 2.0 * (a.sine - b.sine).abs() * rate + (a.keep - b.keep).abs() + (a.force - b.force).abs() * x;
            f64::max(worst, e)
        })
    }

    #[test]
    fn the_bound_holds_at_every_reach_and_damping() {
        for reach in [1e-3, 0.1, 2.0, 7.0, 15.0, 60.0, 500.0] {
            for ratio in [0.0, 0.1, 1.0, 5.0, 100.0] {
                for tolerance in [1e-3, 1e-6, 1e-10] {
                    let key = key(reach, ratio, tolerance);
                    let mut series = Series::default();
                    assert!(series.fit(key), "reach {reach} ratio {ratio}");
                    let error = worst(&series, key);
                    assert!(series.error_bound() <= tolerance);
                    assert!(error <= tolerance + 1e-11, "reach {reach} ratio {ratio} tolerance {tolerance}: {error}");
                }
            }
        }
    }

    /// Broken twin: one degree less misses the wanted error, or the rule wastes passes.
    #[test]
    fn a_degree_less_is_worse() {
        let key = key(7.0, 0.1, 1e-6);
        let mut series = Series::default();
        series.fit(key);
        series.degree -= 2;
        assert!(worst(&series, key) > 1e-6);
    }

    #[test]
    fn degrees_are_those_of_maths_4_2() {
        for (reach, degree) in [(2.0, 4), (4.0, 6), (7.0, 8), (13.0, 12)] {
            let mut series = Series::default();
            series.fit(key(reach, 0.1, 1e-4));
            assert!(series.degree().abs_diff(degree) <= 1, "reach {reach}: {}", series.degree());
        }
    }

    #[test]
    fn the_same_key_is_not_computed_twice() {
        let mut series = Series::default();
        series.fit(key(7.0, 0.1, 1e-6));
        let capacity = series.coefficients.capacity();
        series.fit(key(7.0, 0.1, 1e-6));
        assert_eq!((series.updates, series.coefficients.capacity()), (1, capacity));
        series.fit(key(7.1, 0.1, 1e-6));
        assert_eq!(series.updates, 2);
    }
}
