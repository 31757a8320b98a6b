//! What a frame is told: plain data, whoever holds the tools.

use super::script::Layer;
use crate::scene::EditCommand;
use glam::DVec3;

/// Where the picture is taken from, model space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPose {
    /// Metres.
    pub eye: DVec3,
    /// Metres.
    pub target: DVec3,
    /// Any length but zero, not along the view.
    pub up: DVec3,
    /// Vertical field of view, radians.
    pub fov_y: f64,
}

/// One frame's input.
#[derive(Clone, Debug, Default)]
pub struct InputFrame {
    /// Seconds on the scene's clock.
    pub time_s: f64,
    /// Length of the simulation step, seconds.
    pub step_s: f64,
    /// Edits, in order.
    pub commands: Vec<EditCommand>,
    /// Inspection layers to turn on or off.
    pub show: Vec<(Layer, bool)>,
    /// A new place for the camera.
    pub camera: Option<CameraPose>,
}
