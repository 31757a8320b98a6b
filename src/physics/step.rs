//! One step of a network, as a list of stages: plan, wake, residual, propagate, commit (MATHS 4).
//!
//! Rule of the method: lone particles by the closed form; linked ones by the Chebyshev series up to a step of
//! `h omega_max` = [`SERIES_REACH`], and beyond it as long as the series costs at most [`SERIES_WORK`]; else the implicit
//! step. Steps over [`MAX_STEP`] are shortened to it; one under [`LEAST_STEP`], or that is no number, does nothing.

use super::implicit::{self, ImplicitInput, ImplicitScratch};
use super::matrix::{Lanes, Pair, add_scaled, fused, fused_blend, minus};
use super::network::{INPUT_LIMIT, Network, REST_THRESHOLD, unpadded};
use super::propagator::Propagator;
use super::series::{Series, SeriesKey};
use std::ops::Range;

/// Longest step, s.
pub const MAX_STEP: f64 = 1.0;
/// Shorter steps are none, s: whoever is moved by a collider or a hand would leave it at its way over nearly nothing.
pub const LEAST_STEP: f64 = 1e-6;
/// `h omega_max` up to which the series is always used. MATHS 4.2 says about 15; measured, the implicit step needs as long
/// as a series of degree 100 (200 particles and 20,000 alike) and is not accurate there, so the series goes on to its cost.
pub const SERIES_REACH: f64 = 200.0;
/// Passes times (springs' entries + particles) that a longer series may cost: about half a millisecond.
pub const SERIES_WORK: usize = 1_000_000;
/// Wanted bound of the error of a second of steps, relative, in the energy norm, for a step of `h omega_max` up to 2; beyond, in
/// proportion. It bounds all modes at once, and the stiffer the network the fewer of them count: measured as MATHS 4.3 asks
/// (1e-3), the error is a tenth of it at 2 and less than a hundredth at 15 (`benches/network.rs`).
pub const ERROR_PER_SECOND: f64 = 4e-3;
/// Rows that a sweep of several passes works on, about a megabyte of them: so many stay in a core's second cache.
const ROWS_AT_HAND: usize = 2500;
/// Most passes in one sweep: beyond, the cache has to hold more than the passes save.
const MOST_PASSES: usize = 4;
/// Rows that a sweep moves on by.
const STRIDE: usize = 64;

/// How the linked particles were moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StepMethod {
    /// Nothing was awake.
    #[default]
    Asleep,
    /// Only lone particles: the closed form.
    ClosedForm,
    /// The Chebyshev series.
    Chebyshev,
    /// The implicit step.
    Implicit,
    /// The result was not finite, or beyond [`INPUT_LIMIT`]: the state is the last good one.
    Quarantined,
}

/// What a step did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepReport {
    /// How.
    pub method: StepMethod,
    /// Degree of the series, or iterations of the implicit solver.
    pub degree: usize,
    /// Step times the Gershgorin bound of the highest frequency.
    pub h_omega_max: f64,
    /// Bound of the relative error of this step in the energy norm, over all modes the network may have.
    pub error_bound: f64,
    /// Particles that were moved.
    pub awake: usize,
    /// The step taken, s.
    pub step: f64,
}

/// Work space of a step; may be shared by networks that step one after the other. Grows to the largest, then stays.
#[derive(Clone, Debug, Default)]
pub struct StepScratch {
    series: Series,
    state: Vec<Pair>,
    newer: Vec<Pair>,
    newest: Vec<Pair>,
    drift: Vec<Lanes>,
    ramp: Vec<Lanes>,
    implicit: ImplicitScratch,
}

impl StepScratch {
    /// Makes room for so many particles.
    pub fn make_room(&mut self, particles: usize) {
        for list in [&mut self.state, &mut self.newer, &mut self.newest] {
            list.reserve(particles);
        }
        self.drift.reserve(particles);
        self.ramp.reserve(particles);
        self.series.make_room();
    }

    /// How often series coefficients were computed.
    pub fn series_updates(&self) -> u64 {
        self.series.updates
    }

    /// Heap capacities, in elements: unchanged by a steady step.
    pub fn capacities(&self) -> [usize; 5] {
        [self.state.capacity(), self.newer.capacity(), self.newest.capacity(), self.drift.capacity(), self.ramp.capacity()]
    }
}

impl Network {
    /// Moves the network by `h` seconds. Never fails: see [`StepReport`]. No allocation once `scratch` has grown.
    pub fn step(&mut self, h: f64, scratch: &mut StepScratch) -> StepReport {
        let forward = h >= LEAST_STEP;
        if !forward || self.activity.asleep() {
            return self.rest_report(h);
        }
        let h = h.min(MAX_STEP);
        let mut report = self.plan(h, scratch);
        let reach = if report.method == StepMethod::Chebyshev { report.degree } else { usize::MAX };
        self.wake(reach);
        let sweep = self.sweep();
        report.awake = self.activity.awake.len();
        let ramped = self.prescribe(h, scratch);
        let iterations =
            pulp::Arch::new().dispatch(Propagation { network: self, h, ramped, method: report.method, sweep, scratch });
        report.degree = report.degree.max(iterations);
        if self.is_sound(scratch) {
            self.commit(h, ramped, scratch);
        } else {
            self.quarantine();
            report.method = StepMethod::Quarantined;
        }
        report
    }

    fn rest_report(&mut self, h: f64) -> StepReport {
        let forward = h >= LEAST_STEP;
        if forward {
            self.settle();
        }
        StepReport { step: if forward { h.min(MAX_STEP) } else { 0.0 }, ..Default::default() }
    }

    /// Chooses the method and fits the series; the fit is kept while step, spectrum and damping stay the same.
    fn plan(&self, h: f64, scratch: &mut StepScratch) -> StepReport {
        let (low, high) = self.matrix.spectrum();
        let mut report = StepReport { h_omega_max: h * high.sqrt(), step: h, ..Default::default() };
        if self.linked == 0 {
            report.method = StepMethod::ClosedForm;
            report.h_omega_max = h * low.sqrt();
            return report;
        }
        let (damping, decay) = (self.settings.damping_rate(), self.settings.slowest_decay());
        // An error of the series must not outweigh the damping, or keep energy alive: a hundredth of the decay at most.
        let loss = if decay > 0.0 { 0.01 * decay * h } else { 0.0 };
        let wanted = ERROR_PER_SECOND * h * (0.5 * report.h_omega_max).max(1.0);
        let tolerance = wanted.min(loss).max(1e-11);
        let work = self.matrix.entries() + self.linked;
        let estimate = 0.5 * report.h_omega_max + 8.0;
        if report.h_omega_max <= SERIES_REACH || estimate * work as f64 <= SERIES_WORK as f64 {
            let key = SeriesKey { low, high, damping, step: h, tolerance };
            if scratch.series.fit(key) {
                report.method = StepMethod::Chebyshev;
                report.degree = scratch.series.degree();
                report.error_bound = scratch.series.error_bound();
                return report;
            }
        }
        report.method = StepMethod::Implicit;
        report.error_bound = implicit::error_bound(low, high, damping, decay, h);
        report
    }

    /// Finds the awake rows; those that fell asleep are put to rest.
    fn wake(&mut self, reach: usize) {
        let Self { activity, matrix, linked, held, .. } = self;
        activity.update(matrix, *linked, held, reach);
        let rows = std::mem::take(&mut self.activity.dropped);
        rows.iter().for_each(|row| self.put_to_rest(*row as usize));
        self.activity.dropped = rows;
    }

    /// Stops a row. If it is within the threshold of its rest displacement it is put there exactly, so that a resting model is
    /// drawn without the displacement.
    fn put_to_rest(&mut self, row: usize) {
        self.v[row] = [0.0; 4];
        let near = self.e[row].iter().all(|x| x.abs() <= REST_THRESHOLD * self.length);
        if near && self.force[row] == [0.0; 4] && !self.held[row] {
            self.e[row] = [0.0; 4];
            self.displacement[self.order[row] as usize] = unpadded(&self.u(row)).into();
        }
    }

    /// Writes how fast `e` is moved by what is prescribed (rest displacements, grabs) into `drift`; false if nothing is.
    fn prescribe(&mut self, h: f64, scratch: &mut StepScratch) -> bool {
        if self.moved.is_empty() && self.grabs.is_empty() {
            return false;
        }
        let drift = &mut scratch.drift;
        drift.clear();
        drift.resize(self.e.len(), [0.0; 4]);
        let mut any = false;
        for row in self.moved.iter().map(|row| *row as usize) {
            drift[row] = minus(&self.rest[row], &self.next_rest[row]).map(|x| x / h);
            any = true;
        }
        for grab in &self.grabs {
            let row = grab.row as usize;
            drift[row] = add_scaled(&drift[row], 1.0 / h, &minus(&grab.target, &self.u(row)));
            any |= drift[row] != [0.0; 4];
        }
        any
    }

    #[inline(always)]
    /// Gathers velocity and acceleration `r = F/m - A e` of every row to move, and the rate `q = -A drift` of the latter.
    fn residual(&self, ramped: bool, scratch: &mut StepScratch) {
        let StepScratch { state, drift, ramp, .. } = scratch;
        let partial = self.activity.moving() != self.linked;
        state.resize(self.e.len(), Pair::default());
        if partial {
            state.fill(Pair::default());
        }
        if ramped {
            ramp.clear();
            ramp.resize(self.e.len(), [0.0; 4]);
        }
        for row in self.moving_rows() {
            let pull = self.matrix.apply_row(row, &self.e);
            let inverse = 1.0 / self.masses[row];
            let r = std::array::from_fn(|k| self.force[row][k] * inverse - pull[k]);
            state[row] = Pair { first: self.v[row], second: r };
            if ramped {
                ramp[row] = self.matrix.apply_row(row, drift).map(|x| -x);
            }
        }
    }

    #[inline(always)]
    fn moving_rows(&self) -> impl Iterator<Item = usize> + '_ {
        let lone = self.activity.lone.iter().map(|row| *row as usize);
        self.activity.ranges.iter().flat_map(|r| r.start as usize..r.end as usize).chain(lone)
    }

    /// How to run the passes of the series: several in one sweep where the rows do not fit into the cache and springs reach but
    /// a little way in the order of rows.
    fn sweep(&mut self) -> Sweep {
        let whole = self.activity.moving() == self.linked && self.activity.ranges.len() == 1;
        if !whole || self.linked <= ROWS_AT_HAND {
            return Sweep { passes: 1, width: 0 };
        }
        let width = self.matrix.width();
        Sweep { passes: (ROWS_AT_HAND / (width + STRIDE)).clamp(1, MOST_PASSES), width }
    }

    /// Evaluates the series by Clenshaw's recurrence; the result ends in `newest`. The passes of a sweep run together over
    /// the rows, each behind the one before by the reach of a spring: every row sees the same operations as in passes one after
    /// the other, while the matrix comes from memory once for all of them.
    #[inline(always)]
    fn chebyshev(&self, ramped: bool, sweep: Sweep, scratch: &mut StepScratch) {
        let StepScratch { series, state, newer, newest, ramp, .. } = scratch;
        let rows = self.e.len();
        newer.resize(rows, Pair::default());
        newest.resize(rows, Pair::default());
        if self.activity.moving() != self.linked {
            // Held rows must read as zero.
            newer.fill(Pair::default());
            newest.fill(Pair::default());
        }
        let ramp = if ramped { Some(ramp.as_slice()) } else { None };
        let degree = series.degree();
        for range in self.activity.ranges.iter().map(whole) {
            for row in range {
                newer[row] = term(series.coefficient(degree), &state[row], ramp.map(|q| &q[row]));
                newest[row] = Pair::default();
            }
        }
        let mut left = degree;
        while left > 0 {
            let count = sweep.passes.clamp(1, MOST_PASSES).min(left);
            if count == 1 {
                for range in self.activity.ranges.iter().map(whole) {
                    self.pass(series, left - 1, range, (state, ramp), newer, newest);
                }
            }
            let mut done = [0; MOST_PASSES];
            while count > 1 && done[count - 1] < self.linked {
                let mut end = (done[0] + STRIDE).min(self.linked);
                for (j, done) in done.iter_mut().enumerate().take(count) {
                    let (from, to) = if j % 2 == 0 { (&*newer, &mut *newest) } else { (&*newest, &mut *newer) };
                    self.pass(series, left - 1 - j, *done..end.max(*done), (state, ramp), from, to);
                    *done = end.max(*done);
                    end = if *done == self.linked { *done } else { done.saturating_sub(sweep.width) };
                }
            }
            left -= count;
            // The last sum must end in `newest`, any other in `newer`.
            if (count % 2 == 1) == (left > 0) {
                std::mem::swap(newer, newest);
            }
        }
    }

    /// The pass that adds degree `k`, on some rows.
    #[inline(always)]
    fn pass(
        &self,
        series: &Series,
        k: usize,
        range: Range<usize>,
        (state, ramp): (&[Pair], Option<&[Lanes]>),
        newer: &[Pair],
        newest: &mut [Pair],
    ) {
        let coefficient = series.coefficient(k);
        let (twice, shift) = self.matrix.mapping(series.interval());
        // The last sum takes T once, not twice.
        let mapping = if k == 0 { (0.5 * twice, 0.5 * shift) } else { (twice, shift) };
        match ramp {
            None => {
                let input = |row: usize| term(coefficient, &state[row], None);
                self.matrix.clenshaw_pass(range, mapping, input, newer, newest);
            }
            Some(ramp) => {
                let input = |row: usize| term(coefficient, &state[row], Some(&ramp[row]));
                self.matrix.clenshaw_pass(range, mapping, input, newer, newest);
            }
        }
    }

    #[inline(always)]
    fn implicit(&self, h: f64, ramped: bool, scratch: &mut StepScratch) -> usize {
        let StepScratch { state, newest, ramp, implicit, .. } = scratch;
        newest.resize(self.e.len(), Pair::default());
        let input = ImplicitInput {
            matrix: &self.matrix,
            ranges: &self.activity.ranges,
            masses: &self.masses,
            state,
            ramp: ramped.then_some(ramp.as_slice()),
            e: &self.e,
            damping: self.settings.damping_rate(),
            decay: self.settings.slowest_decay(),
            step: h,
        };
        implicit::implicit_step(&input, implicit, newest)
    }

    /// Lone particles: a spring and its anchor.
    fn closed_form(&self, h: f64, ramped: bool, scratch: &mut StepScratch) {
        if self.activity.lone.is_empty() {
            return;
        }
        let StepScratch { state, newest, ramp, .. } = scratch;
        newest.resize(self.e.len(), Pair::default());
        let p = Propagator::new(self.settings.anchor_rate(), self.settings.damping_rate(), h);
        for row in self.activity.lone.iter().map(|row| *row as usize) {
            newest[row] = term([p.sine, p.keep, p.force, p.ramp], &state[row], ramped.then(|| &ramp[row]));
        }
    }

    /// False for a state that is no number, or so far off that what is worked out from it would be none.
    fn is_sound(&self, scratch: &StepScratch) -> bool {
        // NaN and infinity survive a sum of absolute values, and no comparison.
        let size = |p: &Pair| p.first.iter().chain(&p.second).map(|x| x.abs()).sum::<f64>();
        let sum: f64 = self.moving_rows().map(|row| size(&scratch.newest[row])).sum();
        sum <= INPUT_LIMIT
    }

    /// Takes the new state over and notes who is still restless.
    fn commit(&mut self, h: f64, ramped: bool, scratch: &StepScratch) {
        self.quarantined_in_a_row = 0;
        self.commit_prescribed(h);
        let amplitude = REST_THRESHOLD * self.length;
        let (speed, pull) = (amplitude * self.settings.anchor_rate().sqrt(), amplitude * self.settings.anchor_rate());
        let Self { activity, e, v, rest, displacement, order, .. } = self;
        activity.restless.clear();
        let ranges = activity.ranges.iter().flat_map(|r| r.start..r.end);
        for row32 in ranges.chain(activity.lone.iter().copied()) {
            let row = row32 as usize;
            let (result, pulled) = (&scratch.newest[row], &scratch.state[row].second);
            e[row] = add_scaled(&e[row], 1.0, &result.first);
            if ramped {
                e[row] = add_scaled(&e[row], h, &scratch.drift[row]);
            }
            (e[row], v[row]) = (flushed(&e[row]), flushed(&result.second));
            let u = add_scaled(&e[row], 1.0, &rest[row]);
            displacement[order[row] as usize] = [u[0], u[1], u[2]];
            // Not short-circuited: a branch a row costs more than the comparisons.
            let restless = (0..3).fold(false, |any, k| any | (v[row][k].abs() > speed) | (pulled[k].abs() > pull));
            if restless {
                activity.restless.push(row32);
            }
        }
        // A grabbed particle that arrived stops at the next step, unless it is pulled on.
        activity.restless.extend(self.grabs.iter().map(|g| g.row).filter(|row| v[*row as usize] != [0.0; 4]));
    }

    /// Grabbed particles and rest displacements arrive.
    fn commit_prescribed(&mut self, h: f64) {
        for grab in &self.grabs {
            let row = grab.row as usize;
            let way = minus(&grab.target, &self.u(row));
            self.v[row] = if self.is_motion(unpadded(&way)) { way.map(|x| x / h) } else { [0.0; 4] };
            self.displacement[self.order[row] as usize] = unpadded(&grab.target).into();
        }
        for row in self.moved.drain(..).map(|row| row as usize) {
            self.rest[row] = self.next_rest[row];
        }
        for grab in &self.grabs {
            let row = grab.row as usize;
            self.e[row] = minus(&grab.target, &self.rest[row]);
        }
    }

    /// Everything came to rest.
    fn settle(&mut self) {
        let rows = std::mem::take(&mut self.activity.awake);
        rows.iter().for_each(|row| self.put_to_rest(*row as usize));
        self.activity.awake = rows;
        self.activity.awake.clear();
    }

    /// The step is dropped: the state stays the last good one, without velocities and forces; if that is not enough, the
    /// particles go back to rest.
    #[cold]
    fn quarantine(&mut self) {
        self.quarantined += 1;
        self.quarantined_in_a_row += 1;
        if self.quarantined_in_a_row == 1 {
            tracing::warn!(count = self.quarantined, "a particle step left all bounds; kept the last good state");
        }
        let reset = self.quarantined_in_a_row > 1;
        for row in self.moved.drain(..).map(|row| row as usize) {
            self.next_rest[row] = self.rest[row];
        }
        for row in self.activity.awake.iter().map(|row| *row as usize) {
            self.v[row] = [0.0; 4];
            self.force[row] = [0.0; 4];
            if reset && !self.held[row] {
                self.e[row] = [0.0; 4];
                self.displacement[self.order[row] as usize] = unpadded(&self.u(row)).into();
            }
        }
        let Self { activity, .. } = self;
        activity.restless.clear();
        activity.restless.extend_from_slice(&activity.awake);
    }
}

/// How many passes of a series run together, and how far behind each other, in rows.
#[derive(Clone, Copy, Debug)]
struct Sweep {
    passes: usize,
    width: usize,
}

/// The stages between the old state and the new, compiled once for AVX2 with FMA and once without and chosen at run time. Both
/// do the same operations in the same order, each rounded alike: the same bits on every machine.
struct Propagation<'a> {
    network: &'a Network,
    h: f64,
    ramped: bool,
    method: StepMethod,
    sweep: Sweep,
    scratch: &'a mut StepScratch,
}

impl pulp::WithSimd for Propagation<'_> {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> usize {
        let Self { network, h, ramped, method, sweep, scratch } = self;
        network.residual(ramped, scratch);
        let iterations = match method {
            StepMethod::Chebyshev => {
                network.chebyshev(ramped, sweep, scratch);
                0
            }
            StepMethod::Implicit => network.implicit(h, ramped, scratch),
            _ => 0,
        };
        network.closed_form(h, ramped, scratch);
        iterations
    }
}

/// Without what is too small to matter (a part in 1e-90): a component that nothing drives would decay into denormal numbers,
/// with which a step takes a hundred times as long. Larger values keep their bits.
#[inline(always)]
fn flushed(x: &Lanes) -> Lanes {
    const GRAIN: f64 = 1e-90;
    x.map(|x| (x + GRAIN) - GRAIN)
}

fn whole(range: &Range<u32>) -> Range<usize> {
    range.start as usize..range.end as usize
}

/// One degree's term: `[sine v + force r + ramp q, keep v + sine r + force q]`.
#[inline(always)]
fn term([sine, keep, force, ramp]: [f64; 4], state: &Pair, q: Option<&Lanes>) -> Pair {
    let mut first = fused_blend(sine, &state.first, force, &state.second);
    let mut second = fused_blend(keep, &state.first, sine, &state.second);
    if let Some(q) = q {
        first = fused(&first, ramp, q);
        second = fused(&second, force, q);
    }
    Pair { first, second }
}

#[cfg(test)]
mod tests {
    use super::super::NetworkSettings;
    use super::super::reference::{SplitMix, benchmark_network};
    use super::*;
    use crate::geometry::ParticleId;
    use glam::DVec3;

    #[test]
    fn passes_that_share_a_sweep_give_the_same_bits_as_one_after_the_other() {
        let (_, topology) = benchmark_network(4000, 28_000);
        let mut network = Network::new(&topology, NetworkSettings::SOFT, 1e-30).unwrap();
        let mut random = SplitMix(7);
        for p in 0..4000 {
            let mut place = || DVec3::from_array(std::array::from_fn(|_| random.signed()));
            network.set_state(ParticleId(p), place(), place());
        }
        let mut scratch = StepScratch::default();
        network.step(LEAST_STEP, &mut scratch); // all are awake
        let chosen = network.sweep();
        assert!(chosen.passes > 1 && chosen.width < 1000, "{chosen:?}");
        let report = network.plan(0.3, &mut scratch);
        assert!(report.degree > 6, "{report:?}");
        let mut run = |passes: usize, width: usize| {
            network.residual(false, &mut scratch);
            network.chebyshev(false, Sweep { passes, width }, &mut scratch);
            scratch.newest.clone()
        };
        let apart = run(1, 0);
        for passes in 2..=MOST_PASSES {
            assert!(run(passes, chosen.width) == apart, "{passes} passes");
        }
        // Broken twin: a pass that does not keep its distance reads rows that the one before has not written yet.
        assert!(run(2, chosen.width / 8) != apart);
    }
}
