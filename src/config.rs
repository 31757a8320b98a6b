//! `config.toml` as plain settings. Read once at the top and handed down; nothing below `app` reads it.
//!
//! Every key has a default, and the bundled `config.toml` says what the defaults are. Lengths are fractions of the
//! model's bounding diagonal unless the key's text says otherwise, so that one file serves every model.

mod save;

use crate::physics::NetworkSettings;
use crate::surgery::{SamplingSettings, SettingError, WallMode};
use serde::{Deserialize, Deserializer, Serialize};
use std::path::Path;
use thiserror::Error;

/// Why a configuration cannot be used.
#[derive(Debug, Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the configuration {path}: {source}")]
    Unreadable {
        /// The file.
        path: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// Not TOML, an unknown key, or a value of the wrong type; the text names the line.
    #[error("{origin}: {source}")]
    Parse {
        /// The file.
        origin: String,
        /// What is wrong, with the line.
        source: Box<toml::de::Error>,
    },
    /// A value out of its range.
    #[error("{origin}: {source}")]
    Setting {
        /// The file.
        origin: String,
        /// The key, its value and the rule.
        source: SettingError,
    },
}

/// All settings.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// How a blade's path is sampled.
    pub sampling: SamplingSettings,
    /// What a tear looks like.
    pub tear: TearSettings,
    /// The particle layer.
    pub particles: ParticleSettings,
    /// How the layer moves.
    pub dynamics: DynamicsSettings,
    /// What comes off.
    pub pieces: PieceSettings,
    /// Sections.
    pub sections: SectionSettings,
    /// Pictures.
    pub render: RenderSettings,
    /// The headset.
    pub vr: VrSettings,
}

/// What a tear looks like.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TearSettings {
    /// Width of the slit that the blade removes, fraction of the diagonal; 0 is a pure slit.
    pub width: f64,
    /// What lines the slit.
    pub wall: WallMode,
    /// How far the wound particles draw the lips apart, fraction of the diagonal.
    pub gap: f64,
    /// Seconds until a wound stands open.
    pub opening_time: f64,
}

/// The particle layer (MATHS 3.1).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ParticleSettings {
    /// About how many particles a model gets where no spacing is given.
    pub count: u32,
    /// Influence radius d, in spacings: above 1 (MATHS 2.1), from 1.5 on without a warning.
    pub radius: f64,
    /// Neighbour distance delta, in spacings.
    pub neighbours: f64,
}

/// A material of the soft layer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DynamicsPreset {
    /// Natural frequency of a lone anchored particle, Hz.
    pub frequency: f64,
    /// Damping ratio: 0 rings for ever, 1 is critical, more is sluggish.
    pub damping: f64,
    /// Stiffness of a neighbour spring at the mean distance, in anchor stiffnesses.
    pub coupling: f64,
    /// Particles turn with their neighbourhood: large bends keep their shape.
    pub rotations: bool,
}

/// Names of the presets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PresetName {
    /// Follows the hand far and comes back slowly.
    #[default]
    Soft,
    /// Gives little and settles at once.
    Firm,
    /// Gives locally and creeps back.
    Sponge,
}

/// How the layer moves (MATHS 4).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DynamicsSettings {
    /// The preset in use.
    pub preset: PresetName,
    /// Seconds over which an edit's correction fades, so that nothing pops (MATHS 2.2).
    pub fade_time: f64,
    /// Share of its weight that a particle feels, 0 to 1: models are usually made as they hang.
    pub gravity: f64,
    /// Share of its anchor's acceleration that a particle feels, 0 to 1.
    pub inertia: f64,
    /// The soft preset.
    #[serde(deserialize_with = "soft")]
    pub soft: DynamicsPreset,
    /// The firm preset.
    #[serde(deserialize_with = "firm")]
    pub firm: DynamicsPreset,
    /// The sponge preset.
    #[serde(deserialize_with = "sponge")]
    pub sponge: DynamicsPreset,
}

/// What a file says of a preset: keys left out keep their values.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GivenPreset {
    frequency: Option<f64>,
    damping: Option<f64>,
    coupling: Option<f64>,
    rotations: Option<bool>,
}

fn over<'de, D: Deserializer<'de>>(preset: NetworkSettings, given: D) -> Result<DynamicsPreset, D::Error> {
    let GivenPreset { frequency, damping, coupling, rotations } = GivenPreset::deserialize(given)?;
    let known = DynamicsPreset::from(preset);
    Ok(DynamicsPreset {
        frequency: frequency.unwrap_or(known.frequency),
        damping: damping.unwrap_or(known.damping),
        coupling: coupling.unwrap_or(known.coupling),
        rotations: rotations.unwrap_or(known.rotations),
    })
}

fn soft<'de, D: Deserializer<'de>>(given: D) -> Result<DynamicsPreset, D::Error> {
    over(NetworkSettings::SOFT, given)
}

fn firm<'de, D: Deserializer<'de>>(given: D) -> Result<DynamicsPreset, D::Error> {
    over(NetworkSettings::FIRM, given)
}

fn sponge<'de, D: Deserializer<'de>>(given: D) -> Result<DynamicsPreset, D::Error> {
    over(NetworkSettings::SPONGE, given)
}

/// What becomes of severed pieces (MATHS 6).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PieceSettings {
    /// Whether pieces that come off fall, and may be pushed and picked up.
    pub fall: bool,
    /// Which piece stays.
    pub fixed: FixedPiece,
    /// kg/m^3.
    pub density: f64,
}

/// Which piece stays when a tissue comes apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FixedPiece {
    /// The one with the largest surface.
    #[default]
    Largest,
    /// The one on the skeleton's first joint; without a skeleton, the largest.
    Root,
}

impl PieceSettings {
    /// As the scene wants them.
    pub fn for_scene(&self) -> crate::scene::PieceSettings {
        let fixed = match self.fixed {
            FixedPiece::Largest => crate::scene::Fixed::Largest,
            FixedPiece::Root => crate::scene::Fixed::Root,
        };
        crate::scene::PieceSettings { fall: self.fall, fixed, density: self.density }
    }
}

/// Sections (MATHS 5.8).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SectionSettings {
    /// Faces per section, about.
    pub faces: u32,
}

/// Pictures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RenderSettings {
    /// Width of a picture, pixels.
    pub width: u32,
    /// Height of a picture, pixels.
    pub height: u32,
}

/// The better hand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Dexterity {
    /// Forceps in the right hand.
    Left,
    /// Forceps in the left hand.
    #[default]
    Right,
}

impl Dexterity {
    /// The better hand's number: 0 is the left one.
    pub fn hand(self) -> usize {
        if self == Self::Left { 0 } else { 1 }
    }

    /// The other hand is the better one.
    pub fn other(self) -> Self {
        if self == Self::Left { Self::Right } else { Self::Left }
    }
}

/// Whether both eyes are drawn in one pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Multiview {
    /// Where the adapter does that well.
    #[default]
    Auto,
    /// Wherever the adapter can.
    On,
    /// Never: a pass for each eye.
    Off,
}

/// The headset. Metres here are metres in the room.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VrSettings {
    /// The hand that holds the scalpel; the other one holds forceps.
    pub hand: Dexterity,
    /// Strength of vibrations: 0 for none, 1 for the strongest.
    pub haptics: f64,
    /// From the grip to the tip of the instrument, metres: x right, y up, -z forwards as the controller is held.
    pub tip_offset: [f64; 3],
    /// How much deeper the scalpel goes with the trigger fully pulled, metres.
    pub reach: f64,
    /// Radians of one snap turn.
    pub snap_turn: f64,
    /// Pictures a second; 0 leaves it to the headset.
    pub refresh_rate: f64,
    /// How far the eyes' pictures may shrink while the GPU does not keep up: share of each side. 1 keeps them whole.
    pub resolution_floor: f64,
    /// Whether both eyes are drawn in one pass.
    pub multiview: Multiview,
    /// Leaves out the pixels that the lenses hide, where the runtime tells them.
    pub visibility_mask: bool,
    /// Shows one eye in a window, too, where there is a display.
    pub mirror: bool,
    /// How long a runtime that has stopped is waited for, seconds; then the work is saved and the program ends.
    pub return_time: f64,
}

impl Default for VrSettings {
    fn default() -> Self {
        Self {
            hand: Dexterity::Right,
            haptics: 0.7,
            tip_offset: [0.0, 0.0, -0.12],
            reach: 0.03,
            snap_turn: 0.5,
            refresh_rate: 0.0,
            resolution_floor: 0.6,
            multiview: Multiview::Auto,
            visibility_mask: true,
            mirror: true,
            return_time: 5.0,
        }
    }
}

impl Default for TearSettings {
    fn default() -> Self {
        Self { width: 0.003, wall: WallMode::Open, gap: 0.03, opening_time: 0.5 }
    }
}

impl Default for ParticleSettings {
    fn default() -> Self {
        Self { count: 200, radius: 1.75, neighbours: 2.5 }
    }
}

impl Default for DynamicsSettings {
    fn default() -> Self {
        Self {
            preset: PresetName::Soft,
            fade_time: 0.25,
            gravity: 0.0,
            inertia: 0.0,
            soft: NetworkSettings::SOFT.into(),
            firm: NetworkSettings::FIRM.into(),
            sponge: NetworkSettings::SPONGE.into(),
        }
    }
}

impl Default for PieceSettings {
    fn default() -> Self {
        Self { fall: true, fixed: FixedPiece::Largest, density: 1000.0 }
    }
}

impl Default for SectionSettings {
    fn default() -> Self {
        Self { faces: 128 }
    }
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self { width: 640, height: 480 }
    }
}

impl From<NetworkSettings> for DynamicsPreset {
    fn from(settings: NetworkSettings) -> Self {
        let NetworkSettings { frequency_hz, damping_ratio, coupling, rotations } = settings;
        Self { frequency: frequency_hz, damping: damping_ratio, coupling, rotations }
    }
}

impl From<DynamicsPreset> for NetworkSettings {
    fn from(preset: DynamicsPreset) -> Self {
        let DynamicsPreset { frequency, damping, coupling, rotations } = preset;
        Self { frequency_hz: frequency, damping_ratio: damping, coupling, rotations }
    }
}

impl DynamicsSettings {
    /// The preset in use.
    pub fn active(&self) -> DynamicsPreset {
        match self.preset {
            PresetName::Soft => self.soft,
            PresetName::Firm => self.firm,
            PresetName::Sponge => self.sponge,
        }
    }
}

/// Collects the first broken rule.
struct Rules(Result<(), SettingError>);

impl Rules {
    fn check(&mut self, key: &str, value: f64, holds: bool, rule: &'static str) {
        if self.0.is_ok() && !holds {
            self.0 = Err(SettingError { key: key.to_owned(), value, rule });
        }
    }

    fn range(&mut self, key: &str, value: f64, low: f64, high: f64, rule: &'static str) {
        self.check(key, value, (low..=high).contains(&value), rule);
    }
}

impl Config {
    /// Checks every value; the error names the key.
    pub fn validate(&self) -> Result<(), SettingError> {
        self.sampling.validate().map_err(|e| SettingError { key: format!("sampling.{}", e.key), ..e })?;
        let mut rules = Rules(Ok(()));
        let Self { tear, particles, dynamics, pieces, sections, render, vr, .. } = self;
        rules.range("tear.width", tear.width, 0.0, 1.0, "from 0 to 1 (of the diagonal)");
        rules.range("tear.gap", tear.gap, 0.0, 1.0, "from 0 to 1 (of the diagonal)");
        rules.range("tear.opening_time", tear.opening_time, 0.0, 3600.0, "from 0 to 3600 s");
        rules.range("particles.count", f64::from(particles.count), 1.0, 1e6, "from 1 to 1000000");
        let radius = particles.radius;
        rules.check("particles.radius", radius, radius > 1.0 && radius <= 100.0, "above 1 spacing, at most 100");
        rules.range("particles.neighbours", particles.neighbours, 0.0, 100.0, "from 0 to 100 spacings");
        rules.range("dynamics.fade_time", dynamics.fade_time, 0.0, 3600.0, "from 0 to 3600 s");
        rules.range("dynamics.gravity", dynamics.gravity, 0.0, 1.0, "from 0 to 1");
        rules.range("dynamics.inertia", dynamics.inertia, 0.0, 1.0, "from 0 to 1");
        for (name, preset) in [("soft", dynamics.soft), ("firm", dynamics.firm), ("sponge", dynamics.sponge)] {
            let key = |what: &str| format!("dynamics.{name}.{what}");
            let DynamicsPreset { frequency, damping, coupling, .. } = preset;
            rules.check(
                &key("frequency"),
                frequency,
                NetworkSettings::FREQUENCIES_HZ.contains(&frequency),
                "from 0.001 to 1e6 Hz",
            );
            rules.check(&key("damping"), damping, NetworkSettings::DAMPING_RATIOS.contains(&damping), "from 0 to 100");
            rules.check(&key("coupling"), coupling, NetworkSettings::COUPLINGS.contains(&coupling), "from 0 to 1e6");
        }
        rules.range("pieces.density", pieces.density, 1e-3, 1e5, "from 0.001 to 100000 kg/m^3");
        rules.range("sections.faces", f64::from(sections.faces), 1.0, 1e9, "1 or more");
        rules.range("render.width", f64::from(render.width), 1.0, 16384.0, "from 1 to 16384 pixels");
        rules.range("render.height", f64::from(render.height), 1.0, 16384.0, "from 1 to 16384 pixels");
        rules.range("vr.haptics", vr.haptics, 0.0, 1.0, "from 0 to 1");
        for x in vr.tip_offset {
            rules.range("vr.tip_offset", x, -1.0, 1.0, "from -1 to 1 m each way");
        }
        rules.range("vr.reach", vr.reach, 0.0, 1.0, "from 0 to 1 m");
        rules.range("vr.snap_turn", vr.snap_turn, 0.0, std::f64::consts::PI, "from 0 to pi radians");
        rules.range("vr.return_time", vr.return_time, 0.0, 3600.0, "from 0 to 3600 s");
        rules.range("vr.resolution_floor", vr.resolution_floor, 0.1, 1.0, "from 0.1 to 1 (of each side)");
        rules.range("vr.refresh_rate", vr.refresh_rate, 0.0, 1000.0, "from 0 to 1000 a second");
        rules.0
    }

    /// Parses a configuration; keys left out have their defaults, unknown ones are errors. `origin` names it in errors.
    pub fn parse(text: &str, origin: &str) -> Result<Self, ConfigError> {
        let parse = |e| ConfigError::Parse { origin: origin.to_owned(), source: Box::new(e) };
        let config: Self = toml::from_str(text).map_err(parse)?;
        config.validate().map_err(|source| ConfigError::Setting { origin: origin.to_owned(), source })?;
        Ok(config)
    }

    /// Reads and parses a configuration file.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let origin = path.display().to_string();
        match std::fs::read_to_string(path) {
            Ok(text) => Self::parse(&text, &origin),
            Err(source) => Err(ConfigError::Unreadable { path: origin, source }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUNDLED: &str = include_str!("../config.toml");

    #[test]
    fn the_bundled_file_is_the_defaults_key_by_key() {
        assert_eq!(Config::parse(BUNDLED, "config.toml").unwrap(), Config::default());
        let bundled: toml::Table = BUNDLED.parse().unwrap();
        let defaults = toml::Table::try_from(Config::default()).unwrap();
        assert_eq!(bundled, defaults, "every key is there");
        let keys = BUNDLED.lines().filter(|l| l.contains('=') && !l.starts_with('#'));
        assert!(keys.clone().count() > 25);
        for line in keys {
            assert!(line.contains('#'), "no comment: {line}");
        }
    }

    #[test]
    fn an_empty_file_is_the_defaults() {
        assert_eq!(Config::parse("", "x").unwrap(), Config::default());
    }

    #[test]
    fn eyes_are_drawn_as_the_file_says() {
        let given = |text: &str| Config::parse(text, "x").unwrap().vr.multiview;
        assert_eq!(given("[vr]\nmultiview = \"on\""), Multiview::On);
        assert_eq!((given("[vr]\nmultiview = \"off\""), given("[vr]")), (Multiview::Off, Multiview::Auto));
    }

    #[test]
    fn errors_name_the_line_or_the_key() {
        let error = |text: &str| Config::parse(text, "my.toml").unwrap_err().to_string();
        let unknown = error("[tear]\nwidth = 0.1\nwidht = 0.2\n");
        assert!(unknown.contains("my.toml") && unknown.contains("line 3") && unknown.contains("widht"), "{unknown}");
        assert!(error("[tera]\n").contains("line 1"));
        assert!(error("[tear]\nwall = \"ajar\"").contains("line 2"));
        assert!(error("[vr]\nmultiview = true").contains("line 2"));
        for (text, key) in [
            ("[tear]\nwidth = nan", "tear.width"),
            ("[tear]\nwidth = -0.1", "tear.width"),
            ("[particles]\nradius = 1.0", "particles.radius"),
            ("[sampling]\ntime = 0.0", "sampling.time"),
            ("[dynamics.firm]\nfrequency = 0\ndamping = 1\ncoupling = 1", "dynamics.firm.frequency"),
            ("[render]\nwidth = 0", "render.width"),
        ] {
            assert!(error(text).contains(key), "{text}: {}", error(text));
        }
        assert!(matches!(Config::load(Path::new("no/such/file")), Err(ConfigError::Unreadable { .. })));
        assert!(Config::parse("[tear]\nwidth = 0.1", "x").is_ok(), "the checks let good values through");
    }

    #[test]
    fn a_file_with_some_keys_of_a_preset_changes_only_those() {
        let (given, known) = (Config::parse("[dynamics.sponge]\nfrequency = 5.0", "x").unwrap(), Config::default());
        assert_eq!(given.dynamics.sponge, DynamicsPreset { frequency: 5.0, ..known.dynamics.sponge });
        assert_eq!((given.dynamics.soft, given.dynamics.firm), (known.dynamics.soft, known.dynamics.firm));
        let turning = Config::parse("[dynamics.firm]\nrotations = true", "x").unwrap().dynamics.firm;
        assert_eq!(turning, DynamicsPreset { rotations: true, ..known.dynamics.firm });
        assert!(Config::parse("[dynamics.soft]\nfrequenzy = 5.0", "x").is_err());
    }
}
