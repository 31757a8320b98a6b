//! Tools: what hands do, turned into edit commands. Devices differ (a mouse, a tracked controller), commands do not.
//!
//! | tool | in | out |
//! |---|---|---|
//! | [`Scalpel`] | blade pose, pressed or not | a stroke |
//! | [`Forceps`] | point, closed or not | a grab |
//! | [`Squeeze`] | [`Pinch`], held or not | two rigid fingertips that close in on each other |
//! | [`plane_through`] | eye and two points | a plane to cut along |
//! | [`PointerTools`] | mouse and keys on a picture | all of these, and the camera |
//!
//! A pointer sees a picture only, so it needs [`Picker`] to find the surface, [`PointerBlade`] to give it a blade, and
//! [`OrbitCamera`] to look from somewhere.

mod blade;
mod forceps;
mod orbit;
mod pick;
mod plane;
mod pointer;
#[cfg(test)]
mod pointer_tests;
mod scalpel;
#[cfg(test)]
mod test_scene;

pub use blade::PointerBlade;
pub use forceps::{Forceps, Pinch, Squeeze};
pub use orbit::OrbitCamera;
pub use pick::{Hit, Picker, Ray};
pub use plane::{PlanePreview, plane_through};
pub use pointer::{Button, Modifiers, PointerTools, Preview, StrokeTrace, ToolSettings, TraceSample};
pub use scalpel::Scalpel;
