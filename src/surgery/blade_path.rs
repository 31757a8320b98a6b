//! The blade's path: poses, the path file of CONTRACT, and the thresholds it is sampled with (MATHS 5.1).
//!
//! A blade is the segment from `tip` (the point) to `base` (the handle's end). All lengths are metres in the space of
//! the tissue; times are seconds.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Coordinates and times beyond this are refused: their squares would leave the range that exact predicates work in.
const LARGEST_COORDINATE: f64 = 1e12;

/// Where the blade is at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BladePose {
    /// Seconds, from a start that the path's owner defines.
    pub t: f64,
    /// The point of the blade, metres.
    pub tip: DVec3,
    /// The end of the blade at the handle, metres.
    pub base: DVec3,
}

impl BladePose {
    /// The pose a fraction `u` of the way to `other` (0 gives `self`, 1 gives `other`, bit for bit).
    pub fn lerp(&self, other: &Self, u: f64) -> Self {
        if u <= 0.0 {
            return *self;
        }
        if u >= 1.0 {
            return *other;
        }
        Self {
            t: self.t + (other.t - self.t) * u,
            tip: self.tip + (other.tip - self.tip) * u,
            base: self.base + (other.base - self.base) * u,
        }
    }

    /// The pose with its tip and base moved by so much, metres.
    pub(super) fn moved(&self, by: [DVec3; 2]) -> Self {
        Self { tip: self.tip + by[0], base: self.base + by[1], ..*self }
    }

    /// Unit vector from tip to base; zero for a blade without length.
    pub fn up(&self) -> DVec3 {
        (self.base - self.tip).normalize_or_zero()
    }

    /// True if every number is finite and within the range of the predicates.
    pub fn is_finite(&self) -> bool {
        let small = |x: f64| x.abs() <= LARGEST_COORDINATE;
        small(self.t) && self.tip.to_array().into_iter().chain(self.base.to_array()).all(small)
    }

    /// True if the blade has a direction.
    pub fn has_length(&self) -> bool {
        self.up() != DVec3::ZERO
    }
}

/// Why a blade path cannot be used.
#[derive(Debug, Error)]
pub enum PathError {
    /// The file cannot be read.
    #[error("cannot read the blade path {path}: {source}")]
    Unreadable {
        /// The file.
        path: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// Not the JSON that is expected.
    #[error("the blade path is not JSON of the form {{\"poses\":[{{\"t\":0.0,\"tip\":[x,y,z],\"base\":[x,y,z]}}, ...]}}: {0}")]
    Json(#[from] serde_json::Error),
    /// Fewer than two poses.
    #[error("the blade path has {count} pose(s); a tear needs at least two, at different places")]
    TooFewPoses {
        /// How many there are.
        count: usize,
    },
    /// All poses are the same.
    #[error("all {count} poses of the blade path coincide; a tear needs a blade that moves")]
    Coinciding {
        /// How many there are.
        count: usize,
    },
    /// NaN, infinite, or out of range.
    #[error("pose {pose} of the blade path holds a number that is not finite or is beyond 1e12")]
    NotFinite {
        /// Index of the pose, from 0.
        pose: usize,
    },
    /// Tip and base are the same point.
    #[error("pose {pose} of the blade path has its tip on its base; give the blade a length")]
    ZeroLengthBlade {
        /// Index of the pose, from 0.
        pose: usize,
    },
    /// Time runs backwards.
    #[error("pose {pose} of the blade path is earlier than the one before it; sort the poses by \"t\"")]
    TimeDecreases {
        /// Index of the pose, from 0.
        pose: usize,
    },
}

/// A blade path that has been checked: at least two poses, finite, in order of time, not all the same.
#[derive(Clone, Debug, PartialEq)]
pub struct BladePath {
    poses: Vec<BladePose>,
}

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct RawPath {
    poses: Vec<RawPose>,
}

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct RawPose {
    t: f64,
    tip: [f64; 3],
    base: [f64; 3],
}

impl BladePath {
    /// Checks poses. Poses that repeat the one before are fine (the blade stands); all of them the same is an error.
    pub fn new(poses: Vec<BladePose>) -> Result<Self, PathError> {
        if let Some(pose) = poses.iter().position(|p| !p.is_finite()) {
            return Err(PathError::NotFinite { pose });
        }
        if let Some(pose) = poses.iter().position(|p| !p.has_length()) {
            return Err(PathError::ZeroLengthBlade { pose });
        }
        if let Some(before) = poses.windows(2).position(|w| w[1].t < w[0].t) {
            return Err(PathError::TimeDecreases { pose: before + 1 });
        }
        let count = poses.len();
        if count < 2 {
            return Err(PathError::TooFewPoses { count });
        }
        if poses.iter().all(|p| p.tip == poses[0].tip && p.base == poses[0].base) {
            return Err(PathError::Coinciding { count });
        }
        Ok(Self { poses })
    }

    /// Parses the path file of CONTRACT: `{"poses":[{"t":0.0,"tip":[x,y,z],"base":[x,y,z]}, ...]}`.
    pub fn parse(json: &str) -> Result<Self, PathError> {
        let raw: RawPath = serde_json::from_str(json)?;
        let pose = |p: &RawPose| BladePose { t: p.t, tip: p.tip.into(), base: p.base.into() };
        Self::new(raw.poses.iter().map(pose).collect())
    }

    /// Reads and parses a path file.
    pub fn load(path: &std::path::Path) -> Result<Self, PathError> {
        let unreadable = |source| PathError::Unreadable { path: path.display().to_string(), source };
        Self::parse(&std::fs::read_to_string(path).map_err(unreadable)?)
    }

    /// The path as CONTRACT's JSON; [`BladePath::parse`] gives the same numbers back, to the last place.
    pub fn to_json(&self) -> String {
        let pose = |p: &BladePose| RawPose { t: p.t, tip: p.tip.to_array(), base: p.base.to_array() };
        let raw = RawPath { poses: self.poses.iter().map(pose).collect() };
        serde_json::to_string(&raw).unwrap_or_default()
    }

    /// The poses, in order of time.
    pub fn poses(&self) -> &[BladePose] {
        &self.poses
    }

    /// The path moved by `offset` (file space to tissue space, MATHS 1.7).
    pub fn translated(&self, offset: DVec3) -> Self {
        let shift = |p: &BladePose| BladePose { t: p.t, tip: p.tip + offset, base: p.base + offset };
        Self { poses: self.poses.iter().map(shift).collect() }
    }
}

/// How a blade path is sampled, in fractions of the model's diagonal, so that one setting serves every model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SamplingSettings {
    /// A sample at least every so much travel across the blade, fraction of the diagonal.
    pub distance: f64,
    /// A sample at least every so many seconds while the blade travels.
    pub time: f64,
    /// An extra sample where the tip has turned by more than this since the last one, radians.
    pub turn_angle: f64,
    /// An extra sample where the tip's speed has grown or fallen by more than this factor since the last one.
    pub speed_factor: f64,
    /// No two samples nearer than this, fraction of `distance`: a hand's tremor is not a path.
    pub least_travel: f64,
    /// Motion along the blade's axis is looked at in steps of this, fraction of `distance`.
    pub axial_step: f64,
    /// The blade is clipped this far above its entry point, fraction of `distance`, so that no bridge of skin is left.
    pub entry_margin: f64,
    /// How many blades between two samples are tried for a surface that rises higher than at the samples.
    pub probes: u32,
}

impl Default for SamplingSettings {
    fn default() -> Self {
        Self {
            distance: 0.02,
            time: 0.1,
            turn_angle: 0.2,
            speed_factor: 3.0,
            least_travel: 0.1,
            axial_step: 0.25,
            entry_margin: 0.5,
            probes: 1,
        }
    }
}

/// A setting that is out of its range.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{key} = {value} is out of range: {rule}")]
pub struct SettingError {
    /// The key, as the file spells it.
    pub key: String,
    /// The value given.
    pub value: f64,
    /// What is allowed.
    pub rule: &'static str,
}

/// Least sample distance, fraction of the diagonal: finer ones take hours and gigabytes.
pub const LEAST_DISTANCE: f64 = 1e-4;

impl SamplingSettings {
    /// Checks every value; the error names the key.
    pub fn validate(&self) -> Result<(), SettingError> {
        let positive = "a finite number above 0";
        let fraction = "more than 0 and at most 1";
        let rules: [(&str, f64, bool, &'static str); 8] = [
            ("distance", self.distance, (LEAST_DISTANCE..=1.0).contains(&self.distance), "from 0.0001 to 1 (of the diagonal)"),
            ("time", self.time, self.time > 0.0 && self.time.is_finite(), positive),
            ("turn_angle", self.turn_angle, self.turn_angle > 0.0 && self.turn_angle.is_finite(), positive),
            ("speed_factor", self.speed_factor, self.speed_factor > 1.0, "a number above 1 (inf turns it off)"),
            ("least_travel", self.least_travel, self.least_travel > 0.0 && self.least_travel <= 0.5, "from 0 to 0.5, not 0"),
            ("axial_step", self.axial_step, self.axial_step > 0.0 && self.axial_step <= 1.0, fraction),
            ("entry_margin", self.entry_margin, (0.0..=100.0).contains(&self.entry_margin), "from 0 to 100"),
            ("probes", f64::from(self.probes), self.probes <= 16, "at most 16"),
        ];
        match rules.into_iter().find(|r| !r.2) {
            Some((key, value, _, rule)) => Err(SettingError { key: key.to_owned(), value, rule }),
            None => Ok(()),
        }
    }

    /// The thresholds for a model of this bounding diagonal (metres, above 0).
    pub fn scaled(&self, diagonal: f64) -> Sampling {
        self.with_distance(self.distance * diagonal, diagonal)
    }

    /// The same with a sample distance in metres, as a script may give it.
    pub fn with_distance(&self, distance: f64, diagonal: f64) -> Sampling {
        let distance = distance.max(1e-12);
        Sampling {
            diagonal,
            distance,
            time: self.time,
            turn_cosine: self.turn_angle.min(std::f64::consts::PI).cos(),
            speed_factor: self.speed_factor,
            least_travel: self.least_travel * distance,
            axial_step: self.axial_step * distance,
            entry_margin: self.entry_margin * distance,
            probes: self.probes,
        }
    }
}

/// [`SamplingSettings`] for one model, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// The model's bounding diagonal.
    pub diagonal: f64,
    /// Largest travel across the blade between samples.
    pub distance: f64,
    /// Longest time between samples of a blade that travels, seconds.
    pub time: f64,
    /// Cosine of the turn that forces a sample.
    pub turn_cosine: f64,
    /// Factor of the speed that forces a sample.
    pub speed_factor: f64,
    /// Least travel between samples.
    pub least_travel: f64,
    /// Step of motion along the axis.
    pub axial_step: f64,
    /// How far above the entry point the blade is clipped.
    pub entry_margin: f64,
    /// Blades tried between two samples.
    pub probes: u32,
}

/// Where a blade enters the tissue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EntryPoint {
    /// Parameter along the blade from base (0) to tip (1) at which it first meets the tissue; 0 if the base is inside.
    pub s: f64,
    /// How much further, metres, the surface may rise before the next sample, as far as the caller knows; 0 if unknown.
    pub rise: f64,
}

/// What a blade meets on its way between two places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Met {
    /// A share of the way at which it is in the tissue.
    pub share: f64,
    /// The least parameter along the blade, from base (0) to tip (1), at which it meets tissue anywhere on the way.
    pub s: f64,
}

/// Shares of a way at which a surface that cannot tell is tried.
const TRIED_BETWEEN: [f64; 7] = [0.5, 0.25, 0.75, 0.125, 0.625, 0.375, 0.875];

/// A surface that a blade can enter. The caller casts the ray; closures do.
pub trait Surface {
    /// Where the blade `base -> tip` enters; `None` if it does not touch the tissue.
    fn entry(&self, tip: DVec3, base: DVec3) -> Option<EntryPoint>;

    /// What a blade meets on the straight way between two places; `None` if nothing.
    fn met_between(&self, from: &BladePose, to: &BladePose) -> Option<Met> {
        let met = TRIED_BETWEEN.into_iter().filter_map(|share| {
            let BladePose { tip, base, .. } = from.lerp(to, share);
            self.entry(tip, base).map(|entry| Met { share, s: entry.s })
        });
        met.reduce(|first, other| Met { s: first.s.min(other.s), ..first })
    }

    /// Where the blade is to be taken to be: at `pose`, unless a box that ends there would touch the surface rather than cross it or
    /// miss it.
    fn clear(&self, pose: BladePose) -> BladePose {
        pose
    }
}

impl<F: Fn(DVec3, DVec3) -> Option<EntryPoint>> Surface for F {
    fn entry(&self, tip: DVec3, base: DVec3) -> Option<EntryPoint> {
        self(tip, base)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose(t: f64, x: f64) -> BladePose {
        BladePose { t, tip: DVec3::new(x, 0.0, 0.0), base: DVec3::new(x, 1.0, 0.0) }
    }

    #[test]
    fn a_good_path_parses() {
        let json = r#"{"poses":[{"t":0.0,"tip":[0,0,0],"base":[0,1,0]},{"t":1,"tip":[0.1,0,0],"base":[0.1,1,0]}]}"#;
        assert_eq!(BladePath::parse(json).unwrap().poses(), &[pose(0.0, 0.0), pose(1.0, 0.1)]);
    }

    #[test]
    fn each_bad_path_has_its_own_error() {
        let one = r#"{"poses":[{"t":0,"tip":[0,0,0],"base":[0,1,0]}]}"#;
        assert!(matches!(BladePath::parse(one), Err(PathError::TooFewPoses { count: 1 })));
        assert!(matches!(BladePath::parse(r#"{"poses":[]}"#), Err(PathError::TooFewPoses { count: 0 })));
        for json in ["", "{", "[]", r#"{"poses":[{"t":0}]}"#, r#"{"poses":[{"t":0,"tip":[0,0,1e999],"base":[0,1,0]}]}"#] {
            assert!(matches!(BladePath::parse(json), Err(PathError::Json(_))), "{json}");
        }
        let error = |poses: &[BladePose]| BladePath::new(poses.to_vec()).unwrap_err();
        assert!(matches!(error(&[pose(0.0, 1.0), pose(1.0, 1.0)]), PathError::Coinciding { count: 2 }));
        assert!(matches!(error(&[pose(0.0, 0.0), pose(1.0, f64::NAN)]), PathError::NotFinite { pose: 1 }));
        assert!(matches!(error(&[pose(f64::INFINITY, 0.0), pose(1.0, 1.0)]), PathError::NotFinite { pose: 0 }));
        assert!(matches!(error(&[pose(1.0, 0.0), pose(0.5, 1.0)]), PathError::TimeDecreases { pose: 1 }));
        let flat = BladePose { t: 2.0, tip: DVec3::ONE, base: DVec3::ONE };
        assert!(matches!(error(&[pose(0.0, 0.0), flat]), PathError::ZeroLengthBlade { pose: 1 }));
        assert!(BladePath::new(vec![pose(0.0, 0.0), pose(0.5, 0.0), pose(1.0, 1.0)]).is_ok(), "a blade may stand a while");
        assert!(matches!(BladePath::load(std::path::Path::new("no/such/file")), Err(PathError::Unreadable { .. })));
    }

    #[test]
    fn settings_out_of_range_name_the_key() {
        assert_eq!(SamplingSettings::default().validate(), Ok(()));
        let bad = SamplingSettings { time: f64::NAN, ..Default::default() };
        assert_eq!(bad.validate().unwrap_err().key, "time");
        let bad = SamplingSettings { distance: -0.1, ..Default::default() };
        assert_eq!(bad.validate().unwrap_err().key, "distance");
    }

    proptest! {
        #[test]
        fn json_gives_the_same_path_back(xs in proptest::collection::vec(-1e3f64..1e3, 2..20)) {
            let poses: Vec<_> = xs.iter().enumerate().map(|(i, &x)| pose(i as f64 / 90.0, x)).collect();
            let path = BladePath::new(poses).unwrap();
            let back = BladePath::parse(&path.to_json());
            // serde_json parses to within an ulp unless told otherwise: assert what it promises.
            for (a, b) in back.unwrap().poses().iter().zip(path.poses()) {
                prop_assert!((a.tip - b.tip).length() <= 1e-12 && (a.t - b.t).abs() <= 1e-12);
            }
        }
    }
}
