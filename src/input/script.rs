//! Scripts: what is done to a model, when and where (CONTRACT, Scripts).
//!
//! Times are seconds, positions metres in model space. [`Action::at`] and every `until` count from the script's start;
//! the times inside an action's poses, moves and paths count from its `at`.

use crate::surgery::{BladePath, WallMode};
use glam::DVec3;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a script cannot be used.
#[derive(Debug, Error)]
pub enum ScriptError {
    /// The file cannot be read.
    #[error("cannot read the script {path}: {source}")]
    Unreadable {
        /// The file.
        path: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// Not TOML, an unknown or missing key, or a value of the wrong type; the text names the line and shows it.
    #[error("{origin}: {source}")]
    Parse {
        /// The file.
        origin: String,
        /// What is wrong, with the line.
        source: Box<toml::de::Error>,
    },
    /// Well-formed but without sense.
    #[error("{origin}, line {line}: {message}")]
    Invalid {
        /// The file.
        origin: String,
        /// Line, from 1.
        line: usize,
        /// What is wrong and what is allowed.
        message: String,
    },
}

/// A script, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Script {
    /// Bundled name, or a path relative to the script; the command line's model wins.
    pub model: Option<String>,
    /// Animation to play, by name.
    pub animation: Option<String>,
    /// Playback speed of the animation.
    pub speed: f64,
    /// Fixed step, seconds.
    pub step: f64,
    /// Number of frames, where given; see [`Script::total_frames`].
    pub frames: Option<u32>,
    /// Seed of everything that uses chance.
    pub seed: u64,
    /// The camera.
    pub camera: Camera,
    /// Settings of the particle layer that the script overrides.
    pub particles: ParticleOverrides,
    /// Settings of the tear that the script overrides.
    pub tear: TearOverrides,
    /// The actions in order of `at`; those at the same time keep the file's order.
    pub actions: Vec<Action>,
    /// The file it came from.
    pub origin: PathBuf,
}

/// The camera. Without `eye` it frames the model from the front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Where it stands.
    pub eye: Option<DVec3>,
    /// What it looks at; the middle of the model if left out.
    pub target: Option<DVec3>,
    /// Which way is up.
    pub up: DVec3,
    /// Vertical field of view, radians.
    pub fov_y: f64,
    /// Turns about the target, radians per second.
    pub orbit: f64,
}

/// Settings of the particle layer that a script may override.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ParticleOverrides {
    /// Spacing r, metres.
    pub spacing: Option<f64>,
    /// Influence radius d, metres.
    pub radius: Option<f64>,
    /// Neighbour distance delta, metres.
    pub neighbours: Option<f64>,
    /// Natural frequency, Hz.
    pub frequency: Option<f64>,
    /// Damping ratio.
    pub damping: Option<f64>,
    /// Stiffness of neighbour springs, in anchor stiffnesses.
    pub coupling: Option<f64>,
}

/// Settings of the tear that a script may override.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TearOverrides {
    /// Width of the slit, metres.
    pub width: Option<f64>,
    /// What lines it.
    pub wall: Option<WallMode>,
    /// How far the lips are drawn apart, metres.
    pub gap: Option<f64>,
    /// Seconds until it stands open.
    pub opening_time: Option<f64>,
    /// Sample distance, metres.
    pub sample_distance: Option<f64>,
    /// Sample time, seconds.
    pub sample_time: Option<f64>,
}

/// Something that is done at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct Action {
    /// When it starts, seconds from the script's start.
    pub at: f64,
    /// Line of the script that it starts on, from 1, for messages.
    pub line: usize,
    /// What is done.
    pub kind: ActionKind,
}

/// A place at a time, counted from the action's `at`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Seconds from the action's `at`.
    pub t: f64,
    /// Metres: an offset for a grab, a position for a poke.
    pub to: DVec3,
}

/// The plane of a cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutPlane {
    /// Unit normal.
    pub normal: DVec3,
    /// `normal . x = distance` on the plane, metres.
    pub distance: f64,
}

/// What is done.
#[derive(Clone, Debug, PartialEq)]
pub enum ActionKind {
    /// A blade moves along a path and tears.
    Tear {
        /// Times from the action's `at`.
        path: BladePath,
    },
    /// A plane cuts.
    Cut {
        /// Where.
        plane: CutPlane,
        /// Whether the pieces are closed.
        cap: bool,
        /// The polygon in the plane that the blade swept, three or four corners; empty for all of the plane.
        bounded: Vec<DVec3>,
    },
    /// A blade cuts along the plane that its way means.
    CutByBlade {
        /// The way; its times do not matter.
        path: BladePath,
        /// Whether the pieces are closed.
        cap: bool,
    },
    /// Particles inside a ball follow a hand.
    Grab {
        /// Middle of the ball.
        center: DVec3,
        /// Radius of the ball, metres.
        radius: f64,
        /// When it is let go.
        until: f64,
        /// Offsets of the hand, in order of time; linear between, (0, zero) before the first.
        moves: Vec<Motion>,
    },
    /// A rigid sphere pushes.
    Poke {
        /// Radius of the sphere, metres.
        radius: f64,
        /// When it is taken away.
        until: f64,
        /// Positions of the sphere, in order of time; linear between.
        path: Vec<Motion>,
    },
    /// Two rigid spheres close in on each other until `until`.
    Squeeze {
        /// Start of the first.
        a: DVec3,
        /// Start of the second.
        b: DVec3,
        /// Radius of each, metres.
        radius: f64,
        /// When they are taken away.
        until: f64,
    },
    /// Takes the last edit back.
    Undo,
    /// Does it again.
    Redo,
    /// Back to the model as loaded.
    Reset,
    /// Shows or hides a debug layer.
    Show {
        /// Which.
        layer: Layer,
        /// Whether it is shown.
        on: bool,
    },
}

/// A debug layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layer {
    /// Particles and springs.
    Particles,
    /// Edges of the mesh.
    Wireframe,
    /// Bounds of the sections.
    Sections,
    /// Boxes of the tear.
    Boxes,
    /// Influences of particles.
    Influences,
    /// Strips of earlier tears.
    Strips,
    /// Edges of wounds and cuts.
    Edges,
    /// Error of the GPU's positions against the f64 reference.
    Errors,
}

impl Default for Camera {
    fn default() -> Self {
        Self { eye: None, target: None, up: DVec3::Y, fov_y: 0.9, orbit: 0.0 }
    }
}

impl Default for Script {
    fn default() -> Self {
        Self {
            model: None,
            animation: None,
            speed: 1.0,
            step: 1.0 / 90.0,
            frames: None,
            seed: 1,
            camera: Camera::default(),
            particles: ParticleOverrides::default(),
            tear: TearOverrides::default(),
            actions: Vec::new(),
            origin: PathBuf::new(),
        }
    }
}

impl CutPlane {
    /// The plane `n.x = d`; `None` if `n` is zero or anything is not finite.
    pub fn new(n: DVec3, d: f64) -> Option<Self> {
        // Scaled first: the square of a tiny or huge normal would leave the range of f64.
        let scale = n.abs().max_element();
        if !(n.is_finite() && d.is_finite() && scale > 0.0) {
            return None;
        }
        let length = (n / scale).length();
        let plane = Self { normal: n / scale / length, distance: d / scale / length };
        (plane.normal.is_finite() && plane.distance.is_finite()).then_some(plane)
    }

    /// The plane through three points, counter-clockwise seen from its positive side; `None` if they are in line.
    pub fn through(points: [DVec3; 3]) -> Option<Self> {
        let [a, b, c] = points;
        let normal = (b - a).try_normalize()?.cross((c - a).try_normalize()?);
        let plane = Self::new(normal, normal.dot(a))?;
        (normal.length() > 1e-12).then_some(plane)
    }
}

impl Action {
    /// When it has ended, seconds from the script's start.
    pub fn end(&self) -> f64 {
        match &self.kind {
            ActionKind::Tear { path } => self.at + path.poses().last().map_or(0.0, |p| p.t),
            ActionKind::Grab { until, .. } | ActionKind::Poke { until, .. } | ActionKind::Squeeze { until, .. } => *until,
            _ => self.at,
        }
    }
}

impl Motion {
    /// The place at time `t` on a list in order of time: linear between entries, held after the last, `start` at
    /// `t = 0` if the first entry is later.
    pub fn sample(list: &[Self], start: DVec3, t: f64) -> DVec3 {
        let mut before = Self { t: 0.0, to: start };
        for next in list {
            if next.t > t {
                let span = next.t - before.t;
                let u = if span > 0.0 { ((t - before.t) / span).clamp(0.0, 1.0) } else { 1.0 };
                return before.to + (next.to - before.to) * u;
            }
            before = *next;
        }
        before.to
    }
}

impl Script {
    /// Most frames that a script may ask for.
    pub const MOST_FRAMES: u32 = 1_000_000;

    /// Parses and checks a script. `origin` is the file it came from: it is named in errors, and paths in the script are
    /// relative to it.
    pub fn parse(text: &str, origin: &Path) -> Result<Self, ScriptError> {
        super::script_text::parse(text, origin, None)
    }

    /// Reads and parses a script.
    pub fn load(path: &Path) -> Result<Self, ScriptError> {
        Self::load_for(path, None)
    }

    /// The same to play so many frames of, where given: they go before the script's.
    pub fn load_for(path: &Path, frames: Option<u32>) -> Result<Self, ScriptError> {
        let unreadable = |source| ScriptError::Unreadable { path: path.display().to_string(), source };
        let text = std::fs::read_to_string(path).map_err(unreadable)?;
        super::script_text::parse(&text, path, frames)
    }

    /// A path in the script, relative to the script's folder.
    pub fn resolve(&self, path: &str) -> PathBuf {
        self.origin.parent().unwrap_or(Path::new("")).join(path)
    }

    /// When the last action has ended, seconds; 0 without actions.
    pub fn end(&self) -> f64 {
        self.actions.iter().map(Action::end).fold(0.0, f64::max)
    }

    /// How many frames are drawn: `frames`, else until the last action has ended plus one second.
    pub fn total_frames(&self) -> u32 {
        // A hair less than the exact quotient, so that 90.0000001 steps are 90.
        let steps = ((self.end() + 1.0) / self.step - 1e-6).ceil();
        self.frames.unwrap_or((steps.clamp(1.0, f64::from(Self::MOST_FRAMES))) as u32)
    }

    /// Time of a frame, seconds from the start.
    pub fn time_of(&self, frame: u32) -> f64 {
        f64::from(frame) * self.step
    }
}
