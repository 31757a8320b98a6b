//! What a soft material is made of, in numbers a user can turn.

use std::f64::consts::TAU;
use std::ops::RangeInclusive;
use thiserror::Error;

/// Material of a network (MATHS 4.1). The stiffness of a particle of mass `m` to its anchor is `m (2 pi f)^2`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NetworkSettings {
    /// Frequency of a particle on its anchor spring alone, Hz.
    pub frequency_hz: f64,
    /// Damping relative to critical damping of the lone anchor spring: 0 rings for ever, 1 does not overshoot.
    pub damping_ratio: f64,
    /// Stiffness of a neighbour spring of weight 1 relative to the anchor spring: how far a push spreads.
    pub coupling: f64,
    /// Particles turn with their neighbourhood, so that large bends keep their shape (`R_j` of MATHS 2.1).
    pub rotations: bool,
}

/// A setting outside its range.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("{name} = {value} is outside {low} to {high}")]
pub struct SettingsError {
    /// The setting.
    pub name: &'static str,
    /// What was asked for.
    pub value: f64,
    /// Least value allowed.
    pub low: f64,
    /// Largest value allowed.
    pub high: f64,
}

impl Default for NetworkSettings {
    fn default() -> Self {
        Self::SOFT
    }
}

impl NetworkSettings {
    /// Gives far and swings: skin over fat.
    pub const SOFT: Self = Self { frequency_hz: 3.0, damping_ratio: 0.5, coupling: 2.0, rotations: false };
    /// Gives little and settles at once: liver, muscle.
    pub const FIRM: Self = Self { frequency_hz: 8.0, damping_ratio: 0.8, coupling: 1.0, rotations: false };
    /// Creeps back without a swing: foam, lung.
    pub const SPONGE: Self = Self { frequency_hz: 2.0, damping_ratio: 1.5, coupling: 0.3, rotations: false };

    /// Frequencies that there may be, Hz.
    pub const FREQUENCIES_HZ: RangeInclusive<f64> = 1e-3..=1e6;
    /// Damping ratios that there may be.
    pub const DAMPING_RATIOS: RangeInclusive<f64> = 0.0..=100.0;
    /// Couplings that there may be.
    pub const COUPLINGS: RangeInclusive<f64> = 0.0..=1e6;

    /// A preset by name: `soft`, `firm` or `sponge`.
    pub fn preset(name: &str) -> Option<Self> {
        match name {
            "soft" => Some(Self::SOFT),
            "firm" => Some(Self::FIRM),
            "sponge" => Some(Self::SPONGE),
            _ => None,
        }
    }

    /// The same settings if they are in range.
    pub fn checked(self) -> Result<Self, SettingsError> {
        let ranges = [
            ("frequency_hz", self.frequency_hz, Self::FREQUENCIES_HZ),
            ("damping_ratio", self.damping_ratio, Self::DAMPING_RATIOS),
            ("coupling", self.coupling, Self::COUPLINGS),
        ];
        for (name, value, range) in ranges {
            if !range.contains(&value) {
                return Err(SettingsError { name, value, low: *range.start(), high: *range.end() });
            }
        }
        Ok(self)
    }

    /// Squared frequency of the lone anchor spring, 1/s^2: the lower end of every spectrum.
    pub fn anchor_rate(&self) -> f64 {
        (TAU * self.frequency_hz).powi(2)
    }

    /// `c` of `M u'' + c M u' + ...`, 1/s.
    pub fn damping_rate(&self) -> f64 {
        2.0 * self.damping_ratio * TAU * self.frequency_hz
    }

    /// The slowest decay rate of any mode, 1/s: `c/2`, or for more than critical damping that of the softest mode.
    pub fn slowest_decay(&self) -> f64 {
        let (half, stiffness) = (0.5 * self.damping_rate(), self.anchor_rate());
        let discriminant = half * half - stiffness;
        if discriminant > 0.0 { stiffness / (half + discriminant.sqrt()) } else { half }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_in_range_and_nonsense_is_refused() {
        for name in ["soft", "firm", "sponge"] {
            assert!(NetworkSettings::preset(name).unwrap().checked().is_ok());
        }
        assert!(NetworkSettings::preset("granite").is_none());
        for broken in [
            NetworkSettings { frequency_hz: 0.0, ..Default::default() },
            NetworkSettings { frequency_hz: f64::NAN, ..Default::default() },
            NetworkSettings { damping_ratio: -0.1, ..Default::default() },
            NetworkSettings { coupling: f64::INFINITY, ..Default::default() },
        ] {
            assert!(broken.checked().is_err());
        }
    }

    #[test]
    fn the_slowest_decay_is_a_root_of_the_softest_mode() {
        for damping_ratio in [1.5, 10.0, 100.0] {
            let s = NetworkSettings { damping_ratio, ..Default::default() };
            let rate = s.slowest_decay();
            let residual = rate * rate - s.damping_rate() * rate + s.anchor_rate();
            assert!(residual.abs() < 1e-9 * s.anchor_rate(), "{residual}");
        }
    }
}
