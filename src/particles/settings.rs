//! Plain settings of the soft layer, with their defaults from a model and their rules.

use super::build::sigmoid_weight;
use super::particle_map::ParticleMap;
use crate::geometry::{Mesh, ParticleId, VertexId};
use glam::DVec3;
use thiserror::Error;

/// Particles aimed at where nothing is said.
pub const DEFAULT_PARTICLES: usize = 200;
/// Largest `max_influences` that may be asked for.
pub const MAX_INFLUENCES: usize = 16;
/// Default radius of influence over the spacing: about 7 particles reach a vertex.
const RADIUS_OVER_SPACING: f64 = 1.75;
/// Default neighbour distance over the spacing: about 12 neighbours.
const NEIGHBOURS_OVER_SPACING: f64 = 2.5;
/// Squared distances above this many squared radii are out of reach, however they round.
const FAR: f64 = 1.0 + 1e-12;
/// Density of [`super::poisson::sample`]: spacing over that of a hexagonal packing of as many samples.
const EXPECTED_RATIO: f64 = 0.85;

/// Settings of sampling and of the particle map. Lengths in metres at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParticleSettings {
    /// Poisson-disk radius `r` of the anchors.
    pub spacing: f64,
    /// Radius of influence `d` of a particle, above `spacing` (MATHS 2.1).
    pub radius: f64,
    /// Largest distance `delta` of neighbours.
    pub neighbours: f64,
    /// Strongest influences kept a vertex when the map is built, 1 to [`MAX_INFLUENCES`].
    pub max_influences: usize,
    /// Seed of the sampling.
    pub seed: u64,
    /// Wound particles.
    pub wound: WoundSettings,
}

/// What an anchored particle's weights come from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    /// Its anchor at rest.
    pub(super) at: DVec3,
    /// Radius of influence, metres.
    pub(super) radius: f64,
    /// Weight over that of an ordinary particle.
    pub(super) strength: f64,
}

impl Reach {
    /// Nowhere.
    pub(super) const NONE: Self = Self { at: DVec3::NAN, radius: 0.0, strength: 0.0 };
}

/// Settings of wound particles (MATHS 3.3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WoundSettings {
    /// Width that a long slit opens to, metres; 0 makes no wound particles. Shorter slits open less.
    pub gap: f64,
    /// Distance of wound particles along a lip, metres.
    pub spacing: f64,
    /// Radius of influence, metres, at most that of ordinary particles: how far from the lip the opening is felt.
    pub radius: f64,
    /// Weight of a wound particle over that of an ordinary one at the same fraction of its radius. Above 1 it moves all within its radius
    /// more alike, and skin folds beyond that where wounds open wide.
    pub strength: f64,
    /// How far behind an advancing blade the slit stays closed, metres; it opens there once the blade has left.
    pub front: f64,
    /// Most wound particles of one slit; none are added beyond it.
    pub max_particles: usize,
}

/// What is wrong with [`ParticleSettings`].
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SettingsError {
    /// Not a number, infinite, zero or negative where it must be above zero.
    #[error("{name} is {value}; it must be a finite number above 0")]
    NotPositive {
        /// The setting.
        name: &'static str,
        /// What it was.
        value: f64,
    },
    /// `radius` does not exceed `spacing`, so vertices between particles would be left without one.
    #[error(
        "the radius of influence {radius} must be above the spacing {spacing}; give a larger --radius or a smaller --spacing"
    )]
    RadiusBelowSpacing {
        /// Radius of influence, metres.
        radius: f64,
        /// Spacing, metres.
        spacing: f64,
    },
    /// `max_influences` out of range.
    #[error("{0} influences a vertex; it must be 1 to {MAX_INFLUENCES}")]
    Influences(usize),
}

impl ParticleSettings {
    /// Defaults for a spacing: `d = 1.75 r`, `delta = 2.5 r`, 8 influences a vertex.
    pub fn with_spacing(spacing: f64) -> Self {
        let radius = RADIUS_OVER_SPACING * spacing;
        Self {
            spacing,
            radius,
            neighbours: NEIGHBOURS_OVER_SPACING * spacing,
            max_influences: 8,
            seed: 0,
            wound: WoundSettings::for_spacing(spacing, radius),
        }
    }

    /// Defaults for a model: a spacing that makes about [`DEFAULT_PARTICLES`]. `rest` has a position for every vertex
    /// slot. A model without area takes the spacing from its bounds; one without extent gets a spacing of 1.
    pub fn for_model(mesh: &Mesh, rest: &[DVec3]) -> Self {
        Self::for_count(mesh, rest, DEFAULT_PARTICLES)
    }

    /// Defaults for a model with about `count` particles.
    pub fn for_count(mesh: &Mesh, rest: &[DVec3], count: usize) -> Self {
        Self::with_spacing(spacing_for_count(mesh, rest, count))
    }

    /// Checks the rules; `Ok` carries warnings for a reader.
    pub fn validate(&self) -> Result<Vec<String>, SettingsError> {
        let wound = &self.wound;
        for (name, value, may_be_zero) in [
            ("spacing", self.spacing, false),
            ("radius", self.radius, false),
            ("neighbours", self.neighbours, false),
            ("wound gap", wound.gap, true),
            ("wound spacing", wound.spacing, false),
            ("wound radius", wound.radius, false),
            ("wound strength", wound.strength, false),
            ("wound front", wound.front, true),
        ] {
            if !value.is_finite() || value < 0.0 || (value == 0.0 && !may_be_zero) {
                return Err(SettingsError::NotPositive { name, value });
            }
        }
        if self.radius <= self.spacing {
            return Err(SettingsError::RadiusBelowSpacing { radius: self.radius, spacing: self.spacing });
        }
        if !(1..=MAX_INFLUENCES).contains(&self.max_influences) {
            return Err(SettingsError::Influences(self.max_influences));
        }
        let mut warnings = Vec::new();
        if self.radius < 1.5 * self.spacing {
            warnings.push(format!(
                "the radius of influence {} is under 1.5 times the spacing {}: displacements will look faceted",
                self.radius, self.spacing
            ));
        }
        if self.neighbours <= self.spacing {
            warnings.push(format!(
                "the neighbour distance {} does not exceed the spacing {}: no particle has a neighbour",
                self.neighbours, self.spacing
            ));
        }
        Ok(warnings)
    }

    /// Longest link that a map update makes or looks for, metres.
    pub fn reach(&self) -> f64 {
        self.radius.max(self.neighbours)
    }

    /// Radius of influence of a particle, metres.
    pub fn radius_of(&self, map: &ParticleMap, particle: ParticleId) -> f64 {
        if map.is_wound(particle) { self.wound.radius.min(self.radius) } else { self.radius }
    }

    /// Weight of a particle at a vertex before normalisation; 0 if it is retired or out of reach.
    pub fn weight(&self, map: &ParticleMap, rest: &[DVec3], v: VertexId, particle: ParticleId) -> f64 {
        if map.anchors[particle.index()].is_none() {
            return 0.0;
        }
        self.weight_within(&self.reach_of(map, rest, particle), rest[v.index()])
    }

    /// Where an anchored particle is and how far it reaches.
    pub(super) fn reach_of(&self, map: &ParticleMap, rest: &[DVec3], particle: ParticleId) -> Reach {
        let strength = if map.is_wound(particle) { self.wound.strength } else { 1.0 };
        let at = rest[map.anchors[particle.index()].index()];
        Reach { at, radius: self.radius_of(map, particle), strength }
    }

    /// Weight of a particle at a rest position before normalisation; 0 if it is out of reach.
    #[inline]
    pub(super) fn weight_within(&self, reach: &Reach, p: DVec3) -> f64 {
        let squared = reach.at.distance_squared(p);
        if squared > FAR * self.radius * self.radius {
            return 0.0;
        }
        reach.strength * sigmoid_weight(squared.sqrt(), reach.radius)
    }
}

impl WoundSettings {
    /// Defaults for a particle spacing and a radius of influence: a gap of a third of the spacing.
    pub fn for_spacing(spacing: f64, radius: f64) -> Self {
        let radius = radius.min(0.9 * spacing);
        Self { gap: spacing / 3.0, spacing: 0.35 * spacing, radius, strength: 1.0, front: radius, max_particles: 128 }
    }
}

/// The spacing at which [`super::poisson::sample`] is expected to give `count` particles: from the area, else the
/// diagonal, else 1.
pub(super) fn spacing_for_count(mesh: &Mesh, rest: &[DVec3], count: usize) -> f64 {
    let area: f64 = mesh.live_faces().map(|f| face_area(mesh.face(f).map(|v| rest[v.index()]))).sum();
    let hexagonal = (2.0 * area / (3f64.sqrt() * count.max(1) as f64)).sqrt();
    let mut bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for v in mesh.live_vertices() {
        bounds = (bounds.0.min(rest[v.index()]), bounds.1.max(rest[v.index()]));
    }
    let diagonal = (bounds.1 - bounds.0).length();
    [EXPECTED_RATIO * hexagonal, 0.05 * diagonal].into_iter().find(|x| x.is_finite() && *x > 0.0).unwrap_or(1.0)
}

/// Area of a triangle.
pub(super) fn face_area([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::test_models;

    #[test]
    fn each_bad_setting_has_its_own_error() {
        let good = ParticleSettings::with_spacing(0.1);
        assert_eq!(good.validate(), Ok(vec![]));
        for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            for bad in [
                ParticleSettings { spacing: value, ..good },
                ParticleSettings { radius: value, ..good },
                ParticleSettings { neighbours: value, ..good },
                ParticleSettings { wound: WoundSettings { radius: value, ..good.wound }, ..good },
            ] {
                assert!(matches!(bad.validate(), Err(SettingsError::NotPositive { .. })), "{bad:?}");
            }
        }
        let close = ParticleSettings { radius: 0.1, ..good };
        assert!(matches!(close.validate(), Err(SettingsError::RadiusBelowSpacing { .. })));
        let none = ParticleSettings { max_influences: 0, ..good };
        assert_eq!(none.validate(), Err(SettingsError::Influences(0)));
        assert_eq!(ParticleSettings { radius: 0.14, ..good }.validate().map(|w| w.len()), Ok(1));
        assert_eq!(ParticleSettings { wound: WoundSettings { gap: 0.0, ..good.wound }, ..good }.validate(), Ok(vec![]));
    }

    #[test]
    fn defaults_make_about_two_hundred_particles() {
        for (mesh, rest) in [test_models::grid(60, 0.3, 1), test_models::sphere(30)] {
            let settings = ParticleSettings::for_model(&mesh, &rest);
            assert!(settings.validate().is_ok());
            let count = crate::particles::sample(&mesh, &rest, settings.spacing, 1).len();
            assert!((160..=240).contains(&count), "{count}");
        }
    }

    #[test]
    fn a_model_without_extent_has_usable_defaults() {
        let (mesh, rest) = test_models::build(vec![DVec3::ONE; 3], vec![[0, 1, 2]]);
        assert!(ParticleSettings::for_model(&mesh, &rest).validate().is_ok());
    }
}
