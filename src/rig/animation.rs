//! Keyframe animation: step, linear and cubic-spline channels, as glTF 2.0 (appendix C) defines them.

use super::skeleton::{LocalTransform, Trs};
use glam::{DQuat, DVec3, DVec4};

/// What a channel changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Property {
    /// Translation, metres.
    Translation,
    /// Rotation, a unit quaternion xyzw.
    Rotation,
    /// Scale.
    Scale,
}

/// What happens between keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// The last key's value.
    Step,
    /// Straight line; for rotations the shortest arc.
    Linear,
    /// Hermite spline: three values a key (in-tangent, value, out-tangent).
    CubicSpline,
}

/// Keys of a channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Keys {
    /// What happens between them.
    pub interpolation: Interpolation,
    /// Key times in seconds, not decreasing, at least one.
    pub times: Vec<f32>,
    /// Values (xyz0 or a quaternion xyzw): one a key, or three for a cubic spline.
    pub values: Vec<[f64; 4]>,
}

/// One animated property of one node.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Index of the node.
    pub node: u32,
    /// What it changes.
    pub property: Property,
    /// Its keys.
    pub keys: Keys,
}

/// A named set of channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Animation {
    /// Name in the file, or `animation-<index>`.
    pub name: String,
    /// Time of the last key, seconds.
    pub duration_s: f64,
    /// Its channels.
    pub channels: Vec<Channel>,
}

impl Keys {
    /// True if times do not decrease, are finite, and match the values.
    pub fn are_valid(&self) -> bool {
        let per_key = if self.interpolation == Interpolation::CubicSpline { 3 } else { 1 };
        !self.times.is_empty()
            && self.values.len() == self.times.len() * per_key
            && self.times.iter().all(|t| t.is_finite())
            && self.times.is_sorted()
            && self.values.iter().flatten().all(|v| v.is_finite())
    }

    /// The value at `time_s`, held before the first and after the last key. Rotations are not yet normalised.
    pub fn sample(&self, time_s: f64, property: Property) -> DVec4 {
        let after = self.times.partition_point(|&t| f64::from(t) <= time_s);
        if after == 0 {
            return self.value(0);
        }
        let before = after - 1;
        if after == self.times.len() {
            return self.value(before);
        }
        let (t0, t1) = (f64::from(self.times[before]), f64::from(self.times[after]));
        let t = (time_s - t0) / (t1 - t0); // t1 > time_s >= t0
        match self.interpolation {
            Interpolation::Step => self.value(before),
            Interpolation::Linear if property == Property::Rotation => {
                let (a, b) = (quaternion(self.value(before)), quaternion(self.value(after)));
                DVec4::from_array(a.slerp(b, t).to_array())
            }
            Interpolation::Linear => self.value(before).lerp(self.value(after), t),
            Interpolation::CubicSpline => self.spline(before, t, t1 - t0),
        }
    }

    fn value(&self, key: usize) -> DVec4 {
        let at = if self.interpolation == Interpolation::CubicSpline { 3 * key + 1 } else { key };
        DVec4::from_array(self.values[at])
    }

    fn spline(&self, key: usize, t: f64, step: f64) -> DVec4 {
        let at = |i: usize| DVec4::from_array(self.values[i]);
        let (out_tangent, in_tangent) = (at(3 * key + 2) * step, at(3 * key + 3) * step);
        let (t2, t3) = (t * t, t * t * t);
        self.value(key) * (2.0 * t3 - 3.0 * t2 + 1.0)
            + out_tangent * (t3 - 2.0 * t2 + t)
            + self.value(key + 1) * (3.0 * t2 - 2.0 * t3)
            + in_tangent * (t3 - t2)
    }
}

impl Animation {
    /// Writes the channels' values at `time_s` into the locals of the nodes.
    pub fn apply(&self, time_s: f64, locals: &mut [LocalTransform]) {
        for channel in &self.channels {
            let Some(local) = locals.get_mut(channel.node as usize) else { continue };
            let mut trs = match *local {
                LocalTransform::Trs(trs) => trs,
                LocalTransform::Matrix(m) => Trs::from_affine(m),
            };
            let value = channel.keys.sample(time_s, channel.property);
            match channel.property {
                Property::Translation => trs.translation = value.truncate(),
                Property::Rotation => trs.rotation = quaternion(value),
                Property::Scale => trs.scale = value.truncate(),
            }
            *local = LocalTransform::Trs(trs);
        }
    }
}

/// The unit quaternion of xyzw; the identity where it has no direction.
pub fn quaternion(xyzw: DVec4) -> DQuat {
    let q = DQuat::from_vec4(xyzw);
    let length = q.length();
    if length.is_finite() && length > 1e-12 { q / length } else { DQuat::IDENTITY }
}

/// The value of a translation or scale key.
pub fn key3(v: DVec3) -> [f64; 4] {
    [v.x, v.y, v.z, 0.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(interpolation: Interpolation, times: &[f32], x: &[f64]) -> Keys {
        let keys = Keys { interpolation, times: times.to_vec(), values: x.iter().map(|&x| [x, 0.0, 0.0, 0.0]).collect() };
        assert!(keys.are_valid());
        keys
    }

    fn x(keys: &Keys, t: f64) -> f64 {
        keys.sample(t, Property::Translation).x
    }

    #[test]
    fn step_holds_linear_goes_straight() {
        let step = keys(Interpolation::Step, &[1.0, 2.0, 4.0], &[5.0, 7.0, 9.0]);
        assert_eq!([0.0, 1.0, 1.999, 2.0, 3.9, 4.0, 9.0].map(|t| x(&step, t)), [5.0, 5.0, 5.0, 7.0, 7.0, 9.0, 9.0]);
        let linear = keys(Interpolation::Linear, &[1.0, 2.0, 4.0], &[5.0, 7.0, 9.0]);
        assert_eq!([0.0, 1.5, 2.0, 3.0, 9.0].map(|t| x(&linear, t)), [5.0, 6.0, 7.0, 8.0, 9.0]);
    }

    #[test]
    fn a_cubic_spline_reproduces_a_cubic() {
        let f = |t: f64| t * t * t - 2.0 * t + 1.0;
        let df = |t: f64| 3.0 * t * t - 2.0;
        let times = [0.5f32, 1.0, 2.5];
        let values: Vec<f64> = times.iter().map(|&t| f64::from(t)).flat_map(|t| [df(t), f(t), df(t)]).collect();
        let spline = keys(Interpolation::CubicSpline, &times, &values);
        for t in [0.5, 0.7, 1.0, 1.3, 2.0, 2.5] {
            assert!((x(&spline, t) - f(t)).abs() < 1e-12, "{t}");
        }
        assert!((x(&spline, 3.0) - f(3.0)).abs() > 1.0, "the control: clamped outside");
    }

    #[test]
    fn equal_times_and_zero_quaternions_stay_finite() {
        let jump = keys(Interpolation::Linear, &[0.0, 1.0, 1.0, 2.0], &[0.0, 1.0, 5.0, 6.0]);
        assert_eq!([0.5, 1.0, 1.5].map(|t| x(&jump, t)), [0.5, 5.0, 5.5]);
        let zero = Keys { interpolation: Interpolation::Linear, times: vec![0.0, 1.0], values: vec![[0.0; 4]; 2] };
        let q = quaternion(zero.sample(0.5, Property::Rotation));
        assert_eq!(q, DQuat::IDENTITY);
    }

    #[test]
    fn the_shortest_arc_is_taken() {
        let values = vec![[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -0.6, -0.8]];
        let keys = Keys { interpolation: Interpolation::Linear, times: vec![0.0, 1.0], values };
        let q = quaternion(keys.sample(0.5, Property::Rotation));
        assert!((q.to_axis_angle().1 - f64::atan2(0.6, 0.8)).abs() < 1e-12);
    }

    #[test]
    fn bad_keys_are_told() {
        let bad = |times: &[f32], n: usize| Keys {
            interpolation: Interpolation::Step,
            times: times.to_vec(),
            values: vec![[0.0; 4]; n],
        };
        assert!(bad(&[0.0, 1.0], 2).are_valid());
        assert!(!bad(&[1.0, 0.0], 2).are_valid());
        assert!(!bad(&[0.0, f32::NAN], 2).are_valid());
        assert!(!bad(&[0.0, 1.0], 3).are_valid());
        assert!(!bad(&[], 0).are_valid());
    }
}
