//! What drives a scene: input frames as plain data, tools that turn gestures into commands, scripts.

pub mod frame;
pub mod player;
pub mod script;
mod script_text;
pub mod tools;

pub use frame::{CameraPose, InputFrame};
pub use player::ScriptPlayer;
pub use script::{Action, ActionKind, Camera, CutPlane, Layer, Motion, ParticleOverrides, Script, ScriptError, TearOverrides};
