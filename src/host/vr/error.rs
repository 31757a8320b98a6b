//! What can go wrong between us and a headset, a sentence each.

use crate::gpu::GpuError;
use thiserror::Error;

/// Why there is no headset to use: where plain `incise` goes on with a window instead.
#[derive(Debug, Error)]
pub enum VrUnavailable {
    /// The loader's library is not there.
    #[error(
        "no OpenXR loader was found ({0}). Install one (`apt-get install libopenxr-loader1` on Debian or Ubuntu; on Windows it \
         comes with the headset's software), or build with `--features static-loader`, which has it built in"
    )]
    NoLoader(String),
    /// The file that was to be the loader is none.
    #[error(
        "no OpenXR loader was found ({0}). INCISE_OPENXR_LOADER is to name the library itself, such as libopenxr_loader.so.1 or \
         openxr_loader.dll; start without it to take the system's"
    )]
    NamedNoLoader(String),
    /// The loader found no runtime; where it looked, if it was told.
    #[error(
        "an OpenXR loader is there, but no OpenXR runtime is set up{0}. Start the headset's software (SteamVR, Oculus, WiVRn, \
         Monado) and make it the active OpenXR runtime; XR_RUNTIME_JSON can name one too"
    )]
    NoRuntime(String),
    /// The runtime is installed but does not answer.
    #[error(
        "the OpenXR runtime is installed, but its service does not answer ({0}). Start it (SteamVR, the Oculus service, \
         `monado-service`) and try again"
    )]
    NoService(String),
    /// The runtime runs without a headset.
    #[error("the OpenXR runtime {runtime} runs, but sees no headset. Connect it, switch it on and try again")]
    NoHeadset {
        /// The runtime's name.
        runtime: String,
    },
    /// The runtime cannot take pictures from Vulkan.
    #[error("the OpenXR runtime does not offer XR_KHR_vulkan_enable2, which Incise draws through. Update it, or use another")]
    NoVulkan,
}

/// Why a session could not start or go on.
#[derive(Debug, Error)]
pub enum VrError {
    /// There is no headset to use.
    #[error(transparent)]
    Unavailable(#[from] VrUnavailable),
    /// A call of the runtime failed.
    #[error("the OpenXR runtime refused {call}: {result}")]
    Call {
        /// What was asked, in words.
        call: &'static str,
        /// The runtime's answer.
        result: openxr::sys::Result,
    },
    /// The runtime or its session is gone.
    #[error("the OpenXR runtime stopped in mid-session ({0})")]
    Lost(String),
    /// Vulkan, as the runtime made it, failed us.
    #[error("the headset's graphics could not be opened: {0}")]
    Graphics(String),
    /// Drawing failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The test driver's connection broke.
    #[error("lockstep: {0}")]
    Lockstep(String),
}

impl VrError {
    /// True if a new session might succeed where this one ended.
    pub fn is_loss(&self) -> bool {
        matches!(self, Self::Lost(_) | Self::Gpu(GpuError::Lost(_)))
    }

    /// True if the last edit made the scene more than the adapter can hold.
    pub fn is_outgrown(&self) -> bool {
        matches!(self, Self::Gpu(why) if why.is_outgrown())
    }
}

/// Names the call that gave an answer. Answers that mean the runtime is gone become [`VrError::Lost`].
pub trait Named<T> {
    /// With the call's name.
    fn named(self, call: &'static str) -> Result<T, VrError>;
}

impl<T> Named<T> for Result<T, openxr::sys::Result> {
    fn named(self, call: &'static str) -> Result<T, VrError> {
        use openxr::sys::Result as R;
        self.map_err(|result| match result {
            R::ERROR_INSTANCE_LOST | R::ERROR_SESSION_LOST | R::ERROR_RUNTIME_FAILURE | R::ERROR_RUNTIME_UNAVAILABLE => {
                VrError::Lost(format!("{call}: {result}"))
            }
            result => VrError::Call { call, result },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use openxr::sys::Result as R;

    #[test]
    fn a_runtime_that_is_gone_is_told_from_one_that_refuses() {
        for gone in [R::ERROR_INSTANCE_LOST, R::ERROR_SESSION_LOST, R::ERROR_RUNTIME_FAILURE] {
            assert!(Err::<(), R>(gone).named("xrEndFrame").unwrap_err().is_loss());
        }
        let refused = Err::<(), R>(R::ERROR_VALIDATION_FAILURE).named("xrEndFrame").unwrap_err();
        assert!(VrError::from(GpuError::Lost("x".into())).is_loss());
        assert!(!VrError::from(GpuError::UnknownTissue(1)).is_loss());
        let full = VrError::from(GpuError::TooManyTissues { most: 3 });
        assert!(full.is_outgrown() && !full.is_loss() && !VrError::from(GpuError::UnknownTissue(1)).is_outgrown());
        assert!(!refused.is_loss() && refused.to_string().contains("xrEndFrame"));
    }

    #[test]
    fn every_absence_has_a_sentence_of_its_own_that_says_what_to_do() {
        let all = [
            VrUnavailable::NoLoader("x".into()),
            VrUnavailable::NamedNoLoader("x".into()),
            VrUnavailable::NoRuntime(" (XR_RUNTIME_JSON=x names none)".into()),
            VrUnavailable::NoService("x".into()),
            VrUnavailable::NoHeadset { runtime: "x".into() },
            VrUnavailable::NoVulkan,
        ];
        let texts: std::collections::BTreeSet<String> = all.iter().map(ToString::to_string).collect();
        assert_eq!(texts.len(), all.len());
        let advice = ["nstall", "tart", "onnect", "pdate", "without it"];
        assert!(texts.iter().all(|t| advice.iter().any(|a| t.contains(a))), "{texts:?}");
    }
}
