//! What drives a scene: scripts (and, with their hosts, plain input frames and tools).

pub mod script;
mod script_text;

pub use script::{Action, ActionKind, Camera, CutPlane, Layer, Motion, ParticleOverrides, Script, ScriptError, TearOverrides};
