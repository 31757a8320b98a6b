//! The headset: finds an OpenXR runtime, draws both eyes, and puts tools into tracked hands.
//!
//! | file | what it holds |
//! |---|---|
//! | [`runtime`] | loader, runtime, service, headset: each with its own failure |
//! | `interop` | Vulkan made by the runtime and handed to wgpu: all `unsafe` of the crate |
//! | [`lifecycle`] | the session's states and what they ask for |
//! | [`bindings`], [`input`] | the action set, its bindings, what the hands do |
//! | [`hands`], [`haptics`] | tools in the hands, what the hands feel |
//! | [`palm`] | the gesture that opens the panel without a controller |
//! | [`drawn`], [`calibrate`] | the tools as they are drawn; where their tips are |
//! | [`space`] | where the model stands; scaling, turning, snap turns |
//! | [`board`], [`desk`] | the panel on a board in the room; what it asks for is carried out |
//! | [`fit`] | how much of the pictures is drawn: as much as the GPU has time for |
//! | `capture`, [`eye_mirror`] | pictures brought back; one eye in a window, for those who look on |
//! | `headset`, `passes` | one session: swapchain, spaces, a frame; whether both eyes are drawn at once |
//! | [`mod@run`], [`outcome`] | the loop over frames and sessions; what it has to tell in the end |
//! | [`lockstep`] | a test driver's hold on the loop |

pub mod bindings;
pub mod board;
pub mod calibrate;
mod capture;
pub mod clock;
pub mod desk;
pub mod drawn;
pub mod error;
pub mod eye_mirror;
pub mod fit;
pub mod hands;
pub mod haptics;
mod headset;
pub mod input;
mod interop;
pub mod lifecycle;
pub mod lockstep;
pub mod outcome;
pub mod palm;
mod passes;
pub mod run;
pub mod runtime;
pub mod space;
mod swapchain;

pub use error::{VrError, VrUnavailable};
pub use headset::scenery;
pub use outcome::{EyePictures, FrameNote, VrOutcome};
pub use run::{VrOptions, run};

/// Looks for a headset without starting a session: for deciding between headset and window.
pub fn available() -> Result<(), VrUnavailable> {
    match runtime::Runtime::start() {
        Ok(_) => Ok(()),
        Err(VrError::Unavailable(why)) => Err(why),
        Err(other) => Err(VrUnavailable::NoService(other.to_string())),
    }
}
