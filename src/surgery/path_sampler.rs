//! Blade poses in, samples out (MATHS 5.1): by distance or time, whichever comes first, and extra where the tip turns
//! or changes speed. The path between two poses is a straight interpolation, so a stream of poses and a file of the
//! same poses give the same bits.
//!
//! In tissue that moves the way is that through the tissue, and so are its length and its turns: what passes under a slow blade is
//! sampled as finely as what a fast one passes over. A blade that stands still gives no samples all the same.

use super::blade_path::{BladePose, Sampling, Surface};
use glam::DVec3;

/// Most samples between two poses: beyond it the spacing grows, so that a wild jump costs a bounded time.
const MOST_SAMPLES_PER_POSE: u32 = 10_000;

/// What a sample says about the blade.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleKind {
    /// The blade has travelled across its own line since the last sample.
    Move,
    /// The blade has only slid along its line since the last [`SampleKind::Move`]: its depth changes, nothing else.
    Axial,
    /// The path's last pose, less than the least travel after the last sample: it takes that one's place.
    End,
}

/// One sample of a blade path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathSample {
    /// Where the blade is.
    pub pose: BladePose,
    /// What has happened since the last sample.
    pub kind: SampleKind,
}

/// A sample with the blade clipped to the tissue (MATHS 5.1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClippedSample {
    /// The whole blade.
    pub pose: BladePose,
    /// What has happened since the last sample.
    pub kind: SampleKind,
    /// Upper end of the clipped blade, margin included; `None` if the blade does not touch the tissue.
    pub top: Option<DVec3>,
    /// How much further up the top should reach, metres, because the surface rises between this sample and a neighbour.
    pub raise: f64,
}

impl ClippedSample {
    /// Casts the blade at `surface` and clips it to [entry point - margin, tip].
    pub fn clip(sample: &PathSample, surface: &(impl Surface + ?Sized), sampling: &Sampling) -> Self {
        let pose = surface.clear(sample.pose);
        let BladePose { tip, base, .. } = pose;
        let length = (base - tip).length();
        let entered = |pose: BladePose| surface.entry(pose.tip, pose.base).filter(|e| e.s.is_finite());
        let mut entry = entered(pose);
        if let (Some(e), true) = (&mut entry, pose != sample.pose) {
            // a blade in a face enters where that begins
            e.s = entered(sample.pose).map_or(e.s, |touched| touched.s.min(e.s));
        }
        let top = entry.map(|e| {
            let rise = if e.rise.is_finite() { e.rise.max(0.0) } else { 0.0 };
            let above = length * e.s.clamp(0.0, 1.0) - sampling.entry_margin - rise;
            if above <= 0.0 { base } else { base + (tip - base) * (above / length) }
        });
        Self { pose, kind: sample.kind, top, raise: 0.0 }
    }

    /// Moves the blade's tip and base by so much, metres, and what is clipped of it with them.
    pub(super) fn carry(&mut self, by: [DVec3; 2]) {
        let pose = self.pose.moved(by);
        if let Some(top) = &mut self.top {
            let share = (*top - self.pose.tip).length() / (self.pose.base - self.pose.tip).length();
            *top += by[0].lerp(by[1], share);
        }
        self.pose = pose;
    }
}

/// Direction across the blade (unit) and speed (m/s) of the tip when a sample was taken.
#[derive(Clone, Copy, Debug)]
struct Heading {
    direction: DVec3,
    speed: f64,
}

/// The streaming sampler. Feed it poses as they come; [`PathSampler::finish`] when the blade is let go.
#[derive(Clone, Debug)]
pub struct PathSampler {
    sampling: Sampling,
    pose: Option<BladePose>,
    /// Where the tissue has carried that since.
    carried: Option<BladePose>,
    /// The last sample but axial ones.
    sample: Option<Sampled>,
    axial_tip: DVec3,
    heading: Option<Heading>,
}

/// Where a sample was taken, and where the tissue has carried it since.
#[derive(Clone, Copy, Debug)]
struct Sampled {
    seen: BladePose,
    carried: BladePose,
}

/// The ways from one pose to the next.
struct Ways {
    /// The poses.
    seen: [BladePose; 2],
    /// Where the tissue has carried the first since: the way through the tissue goes from there to the second.
    from: BladePose,
}

/// The way from one pose to the next, seen from the last sample: two points of the blade, across that sample's line.
struct Leg {
    from: BladePose,
    to: BladePose,
    /// For the tip and a point up the blade: offset across the last sample's line at `u = 0`, and its change to `u = 1`.
    across: [(DVec3, DVec3); 2],
    /// Offset of the tip along the line since the last axial sample at `u = 0`, and its change.
    along: (f64, f64),
}

impl PathSampler {
    /// A sampler for one stroke.
    pub fn new(sampling: Sampling) -> Self {
        Self { sampling, pose: None, carried: None, sample: None, axial_tip: DVec3::ZERO, heading: None }
    }

    /// Takes the next pose and appends the samples between the one before and it. Poses that are not finite, have no
    /// length, or go back in time are ignored: a tracker may lose its way, a stroke goes on.
    pub fn push(&mut self, pose: BladePose, out: &mut Vec<PathSample>) {
        if !pose.is_finite() || !pose.has_length() {
            return;
        }
        let Some(from) = self.pose else {
            self.pose = Some(pose);
            self.emit(pose, pose, SampleKind::Move, out);
            return;
        };
        if pose.t < from.t {
            return;
        }
        self.pose = Some(pose);
        // bit for bit what they are in tissue that stands still
        let ways = Ways { seen: [from, pose], from: self.carried.take().unwrap_or(from) };
        self.corner(&ways, out);
        self.walk(&ways, out);
    }

    /// Tip and base of the newest pose and of the last sample where the tissue has carried them, for a caller whose tissue moves.
    pub fn carried(&self) -> Option<[[DVec3; 2]; 2]> {
        let newest = self.carried.or(self.pose)?;
        Some([newest, self.sample.map_or(newest, |s| s.carried)].map(|p| [p.tip, p.base]))
    }

    /// The tissue has carried what the blade was in at the newest pose and at the last sample away by so much, at their tips and bases,
    /// metres (MATHS 5.5). Samples on the way to the next pose are placed between there and that: the blade goes on in the tissue from
    /// where it was in it.
    pub fn carry(&mut self, [newest, sample]: [[DVec3; 2]; 2]) {
        self.carried = self.carried.or(self.pose).map(|p| p.moved(newest));
        self.sample = self.sample.map(|s| Sampled { carried: s.carried.moved(sample), ..s });
        self.axial_tip += sample[0];
    }

    /// Ends the stroke: the last pose becomes a sample if it is not one already.
    pub fn finish(&mut self, out: &mut Vec<PathSample>) {
        if let (Some(seen), Some(sample)) = (self.pose, self.sample)
            && (seen.tip != sample.seen.tip || seen.base != sample.seen.base)
        {
            let pose = self.carried.unwrap_or(seen);
            let lateral = |sample: &BladePose, pose: BladePose| self.leg(sample, pose, pose).lateral(0.0);
            let lateral = lateral(&sample.carried, pose).min(lateral(&sample.seen, seen));
            let kind = if lateral >= self.sampling.least_travel {
                SampleKind::Move
            } else if lateral > 1e-2 * self.sampling.least_travel {
                SampleKind::End
            } else {
                SampleKind::Axial
            };
            self.emit(pose, seen, kind, out);
        }
        *self = Self::new(self.sampling);
    }

    /// A sample at `pose` in the tissue, taken where the blade was `seen`.
    fn emit(&mut self, pose: BladePose, seen: BladePose, kind: SampleKind, out: &mut Vec<PathSample>) {
        out.push(PathSample { pose, kind });
        self.axial_tip = pose.tip;
        if kind != SampleKind::Axial {
            self.sample = Some(Sampled { seen, carried: pose });
        }
    }

    /// An extra sample where the leg begins, where the path has turned or changed speed since the last sample.
    fn corner(&mut self, ways: &Ways, out: &mut Vec<PathSample>) {
        let Ways { seen: [seen, to], from } = ways;
        let up = from.up();
        let step = reject(to.tip - from.tip, up);
        let length = step.length();
        if length <= 1e-6 * self.sampling.least_travel {
            return;
        }
        let heading = Heading { direction: step / length, speed: length / (to.t - from.t) };
        let Some(old) = self.heading else {
            self.heading = Some(heading);
            return;
        };
        let turned = old.direction.dot(heading.direction) < self.sampling.turn_cosine;
        let (slow, fast) = (old.speed.min(heading.speed), old.speed.max(heading.speed));
        if turned || fast > slow * self.sampling.speed_factor {
            self.heading = Some(heading);
            let Some(sample) = self.sample else { return };
            let has_gone =
                |sample: &BladePose, to: &BladePose| self.leg(sample, *to, *to).lateral(0.0) >= self.sampling.least_travel;
            let stands_still = from == seen && sample.carried == sample.seen;
            if has_gone(&sample.carried, from) && (stands_still || has_gone(&sample.seen, seen)) {
                self.emit(*from, *seen, SampleKind::Move, out);
            }
        }
    }

    fn walk(&mut self, ways: &Ways, out: &mut Vec<PathSample>) {
        let Ways { seen: [seen, to], from } = *ways;
        let mut u = 0.0;
        let travel = (to.tip - from.tip).length().max((to.base - from.base).length());
        let coarse = travel / f64::from(MOST_SAMPLES_PER_POSE);
        // Rounding far from the origin could keep a sample due for ever: the count ends it.
        for _ in 0..4 * MOST_SAMPLES_PER_POSE {
            let Some(sample) = self.sample else { return };
            if from != seen || sample.carried != sample.seen {
                u = self.leaves(&self.leg_from(&sample.seen, sample.seen.tip, seen, to), u);
            }
            let leg = self.leg(&sample.carried, from, to);
            let (next, kind) = self.next_event(&leg, &sample.carried, u, coarse);
            if next.is_nan() || next > 1.0 {
                return;
            }
            u = next;
            self.emit(from.lerp(&to, u), seen.lerp(&to, u), kind, out);
        }
    }

    /// The first `u` from `after` on at which the blade is not seen where the leg's sample was taken; infinite if it stands there.
    fn leaves(&self, seen: &Leg, after: f64) -> f64 {
        seen.reaches(self.sampling.least_travel, after).min(seen.slides(self.sampling.axial_step, after))
    }

    /// The first `u` past `after` at which a sample is due (infinite if none is), and its kind.
    fn next_event(&self, leg: &Leg, sample: &BladePose, after: f64, coarse: f64) -> (f64, SampleKind) {
        let s = &self.sampling;
        let by_distance = leg.reaches(s.distance.max(coarse), after);
        let least = leg.reaches(s.least_travel.max(coarse), after);
        let due = sample.t + s.time;
        let span = leg.to.t - leg.from.t;
        let by_time = if due <= leg.from.t {
            after
        } else if due <= leg.to.t && span > 0.0 {
            after.max((due - leg.from.t) / span)
        } else {
            f64::INFINITY
        };
        let moved = by_distance.min(by_time.max(least));
        let slid = leg.slides(s.axial_step.max(coarse), after);
        if slid < moved && slid < least { (slid, SampleKind::Axial) } else { (moved, SampleKind::Move) }
    }

    fn leg(&self, sample: &BladePose, from: BladePose, to: BladePose) -> Leg {
        self.leg_from(sample, self.axial_tip, from, to)
    }

    fn leg_from(&self, sample: &BladePose, axial_tip: DVec3, from: BladePose, to: BladePose) -> Leg {
        let axis = sample.up();
        // Of a blade much longer than the model only the part that can reach it counts: one and the same part all along the leg,
        // so that a point between two poses moves evenly, as the blade does.
        let longest = (from.base - from.tip).length().max((to.base - to.tip).length());
        let part = (self.sampling.diagonal / longest).min(1.0);
        let reach = |p: &BladePose| p.tip + (p.base - p.tip) * part;
        let across = |seen: DVec3, a: DVec3, b: DVec3| (reject(a - seen, axis), reject(b - a, axis));
        Leg {
            from,
            to,
            across: [across(sample.tip, from.tip, to.tip), across(reach(sample), reach(&from), reach(&to))],
            along: ((from.tip - axial_tip).dot(axis), (to.tip - from.tip).dot(axis)),
        }
    }
}

impl Leg {
    /// Travel across the line at `u`, metres: the larger of the two points.
    fn lateral(&self, u: f64) -> f64 {
        self.across.iter().map(|(a, b)| (*a + *b * u).length()).fold(0.0, f64::max)
    }

    /// The first `u` from `after` on at which the travel across the line is `distance` or more; infinite if never.
    fn reaches(&self, distance: f64, after: f64) -> f64 {
        let root = |&(a, b): &(DVec3, DVec3)| {
            let a = a + b * after;
            let (aa, ab, bb) = (a.length_squared() - distance * distance, a.dot(b), b.length_squared());
            if aa >= 0.0 {
                return 0.0;
            }
            if bb == 0.0 {
                return f64::INFINITY;
            }
            // aa < 0: one root is positive. Taken in the form that does not cancel.
            let d = (ab * ab - bb * aa).sqrt();
            if ab > 0.0 { -aa / (ab + d) } else { (d - ab) / bb }
        };
        after + self.across.iter().map(root).fold(f64::INFINITY, f64::min)
    }

    /// The first `u` from `after` on at which the tip has slid by `step` along the line, either way; infinite if never.
    fn slides(&self, step: f64, after: f64) -> f64 {
        let (a, b) = (self.along.0 + self.along.1 * after, self.along.1);
        if a.abs() >= step {
            return after;
        }
        if b == 0.0 { f64::INFINITY } else { after + (step.copysign(b) - a) / b }
    }
}

/// The part of `v` across the unit vector `axis`.
pub(super) fn reject(v: DVec3, axis: DVec3) -> DVec3 {
    v - axis * v.dot(axis)
}

#[cfg(test)]
mod tests {
    use super::super::blade_path::SamplingSettings;
    use super::*;
    use proptest::prelude::*;

    fn sampling() -> Sampling {
        SamplingSettings { distance: 0.01, ..Default::default() }.scaled(1.0)
    }

    fn pose(t: f64, tip: [f64; 3]) -> BladePose {
        BladePose { t, tip: tip.into(), base: DVec3::from(tip) + DVec3::Y * 0.2 }
    }

    fn run(poses: &[BladePose]) -> Vec<PathSample> {
        let (mut sampler, mut out) = (PathSampler::new(sampling()), Vec::new());
        poses.iter().for_each(|p| sampler.push(*p, &mut out));
        sampler.finish(&mut out);
        out
    }

    fn moves(samples: &[PathSample]) -> usize {
        samples.iter().filter(|s| s.kind == SampleKind::Move).count()
    }

    #[test]
    fn a_fast_blade_is_sampled_by_distance() {
        let out = run(&[pose(0.0, [0.0; 3]), pose(0.1, [0.1, 0.0, 0.0])]);
        assert!((11..=12).contains(&out.len()), "{}", out.len());
        for w in out.windows(2).take(9) {
            assert!((w[1].pose.tip.x - w[0].pose.tip.x - 0.01).abs() < 1e-12);
        }
        assert!((out.last().unwrap().pose.tip.x - 0.1).abs() < 1e-12);
    }

    /// Tissue that goes up at an even speed under a blade that goes straight: in the tissue its way is a straight line down, however samples
    /// fall between poses. Where poses stay behind while the tissue moves, it is a staircase.
    #[test]
    fn the_way_between_poses_is_one_through_the_tissue() {
        let (step, up) = (1.0 / 60.0, 0.3);
        let worst = |carries: bool| {
            let (mut sampler, mut out, mut worst) = (PathSampler::new(sampling()), Vec::new(), 0.0f64);
            for k in 0..60 {
                let t = f64::from(k) * step;
                if carries && k > 0 {
                    sampler.carry([[DVec3::Y * up * step; 2]; 2]);
                }
                sampler.push(pose(t, [0.37 * t, 0.0, 0.0]), &mut out);
                for sample in out.drain(..) {
                    for p in [sample.pose.tip, sample.pose.base - DVec3::Y * 0.2] {
                        worst = worst.max((p.y - up * t + up / 0.37 * p.x).abs());
                    }
                }
            }
            worst
        };
        assert!(worst(true) < 1e-12, "{}", worst(true));
        assert!(worst(false) > 0.5 * up * step, "{}", worst(false));
        let still = [pose(0.0, [0.0; 3]), pose(0.1, [0.1, 0.0, 0.03])];
        let (mut sampler, mut out) = (PathSampler::new(sampling()), Vec::new());
        for p in still {
            sampler.carry([[DVec3::ZERO; 2]; 2]);
            sampler.push(p, &mut out);
        }
        sampler.finish(&mut out);
        assert_eq!(out, run(&still), "to the bit");
    }

    #[test]
    fn a_slow_blade_is_sampled_by_time() {
        let out = run(&[pose(0.0, [0.0; 3]), pose(1.0, [0.02, 0.0, 0.0])]);
        assert!((11..=12).contains(&out.len()), "{}", out.len());
        assert!((out[1].pose.t - 0.1).abs() < 1e-12);
    }

    #[test]
    fn a_standing_or_trembling_blade_gives_one_sample() {
        let tremor: Vec<_> = (0..200).map(|i| pose(f64::from(i) * 0.01, [1e-5 * f64::from(i % 3), 0.0, 0.0])).collect();
        assert_eq!(moves(&run(&tremor)), 1);
        let rolls: Vec<_> = (0..200).map(|i| pose(f64::from(i) * 0.01, [0.0; 3])).collect();
        assert_eq!(run(&rolls).len(), 1);
    }

    #[test]
    fn motion_along_the_axis_only_slides() {
        let out = run(&[pose(0.0, [0.0; 3]), pose(1.0, [0.0, -0.1, 0.0])]);
        assert_eq!(moves(&out), 1);
        assert!(out.len() > 10 && out[1..].iter().all(|s| s.kind == SampleKind::Axial));
        assert!((out.last().unwrap().pose.tip.y + 0.1).abs() < 1e-3);
    }

    #[test]
    fn a_corner_and_a_change_of_speed_are_sampled() {
        let corner = pose(0.05, [0.0153, 0.0, 0.0]);
        let at_corner = |poses: &[BladePose]| run(poses).iter().any(|s| s.pose == corner);
        assert!(at_corner(&[pose(0.0, [0.0; 3]), corner, pose(0.1, [0.0153, 0.0, 0.0153])]), "turn");
        assert!(at_corner(&[pose(0.0, [0.0; 3]), corner, pose(0.055, [0.0306, 0.0, 0.0])]), "speed");
        assert!(!at_corner(&[pose(0.0, [0.0; 3]), corner, pose(0.1, [0.0306, 0.0, 0.0])]), "a straight, even path has none");
    }

    #[test]
    fn a_tilt_about_the_tip_is_travel() {
        let tilted = BladePose { t: 0.1, tip: DVec3::ZERO, base: DVec3::new(0.1, 0.17, 0.0) };
        assert!(moves(&run(&[pose(0.0, [0.0; 3]), tilted])) > 5);
    }

    #[test]
    fn a_blade_that_grows_beyond_the_model_moves_evenly() {
        let long = BladePose { t: 0.1, tip: DVec3::new(0.05, 0.0, 0.0), base: DVec3::new(0.2, 3.0, 0.4) };
        let short = BladePose { t: 0.2, tip: DVec3::new(0.08, 0.0, 0.0), base: DVec3::new(0.1, 0.3, 0.0) };
        let out = run(&[pose(0.0, [0.0; 3]), long, short, long]);
        assert!(out.len() < 400, "{} samples", out.len());
        assert!(out.windows(2).all(|w| w[0].pose != w[1].pose));
    }

    #[test]
    fn wild_input_is_bounded() {
        let nan = BladePose { t: 0.0, tip: DVec3::NAN, base: DVec3::ZERO };
        let out = run(&[nan, pose(0.0, [0.0; 3]), nan, pose(0.0, [1e9, 0.0, 0.0]), pose(-1.0, [0.0; 3])]);
        assert!(out.len() > 1000 && out.len() < 20_000, "{}", out.len());
        assert!(out.iter().all(|s| s.pose.is_finite()));
    }

    proptest! {
        #[test]
        fn spacing_is_bounded_and_every_pose_is_near_a_sample(
            points in proptest::collection::vec(
                (0.0f64..0.1, -0.2f64..0.2, -0.2f64..0.2, -0.2f64..0.2, -0.3f64..0.3, 0.1f64..4.0), 2..12)
        ) {
            let mut t = 0.0;
            let poses: Vec<_> = points.iter().map(|&(dt, x, y, z, lean, length)| {
                t += dt;
                BladePose { t, tip: DVec3::new(x, y, z), base: DVec3::new(x + lean * length, y + length, z) }
            }).collect();
            let out = run(&poses);
            let all: Vec<_> = out.iter().filter(|s| s.kind != SampleKind::Axial).collect();
            for w in all.windows(2) {
                let travel = reject(w[1].pose.tip - w[0].pose.tip, w[0].pose.up()).length();
                prop_assert!(travel <= sampling().distance * (1.0 + 1e-9), "{travel}");
                prop_assert!(w[1].pose.t >= w[0].pose.t);
            }
            prop_assert!(out.windows(2).all(|w| w[0] != w[1]));
        }
    }
}
