//! Finding a headset: loader, runtime, service, system, each with its own failure.

use super::error::{Named, VrError, VrUnavailable};
use super::interop;
use openxr as xr;
use openxr::sys::Result as Answer;

/// A runtime with a headset.
pub struct Runtime {
    /// The runtime's instance.
    pub instance: xr::Instance,
    /// The headset.
    pub system: xr::SystemId,
    /// Extensions that are on.
    pub extensions: xr::ExtensionSet,
    /// The runtime's name and version.
    pub name: String,
    /// The headset's name.
    pub headset: String,
}

impl Runtime {
    /// Finds the loader, the runtime, its service and a headset.
    pub fn start() -> Result<Self, VrError> {
        let entry = interop::load_entry()?;
        let offered = entry.enumerate_extensions().map_err(absence)?;
        if !offered.khr_vulkan_enable2 {
            return Err(VrUnavailable::NoVulkan.into());
        }
        let extensions = chosen(&offered);
        let application = xr::ApplicationInfo {
            application_name: "Incise",
            application_version: 1,
            engine_name: "Incise",
            engine_version: 1,
            api_version: xr::Version::new(1, 0, 0),
        };
        let instance = entry.create_instance(&application, &extensions, &[], &()).map_err(absence)?;
        let properties = instance.properties().named("its name")?;
        let runtime = || properties.runtime_name.clone();
        let system = instance.system(xr::FormFactor::HEAD_MOUNTED_DISPLAY).map_err(|answer| match answer {
            Answer::ERROR_FORM_FACTOR_UNAVAILABLE | Answer::ERROR_FORM_FACTOR_UNSUPPORTED => {
                VrError::from(VrUnavailable::NoHeadset { runtime: runtime() })
            }
            other => absence(other),
        })?;
        let headset = instance.system_properties(system).named("the headset's name")?.system_name;
        let name = format!("{} {}", properties.runtime_name, properties.runtime_version);
        Ok(Self { instance, system, extensions, name, headset })
    }

    /// True if the headset's hands can be tracked without controllers.
    pub fn tracks_hands(&self) -> bool {
        self.extensions.ext_hand_tracking && self.instance.supports_hand_tracking(self.system).unwrap_or(false)
    }
}

/// What the first calls of a runtime that is not there answer.
fn absence(answer: Answer) -> VrError {
    match answer {
        Answer::ERROR_RUNTIME_UNAVAILABLE => {
            let named = std::env::var_os("XR_RUNTIME_JSON").filter(|file| !file.is_empty());
            let told = named.map(|file| format!(" (XR_RUNTIME_JSON={} names none)", file.display()));
            VrUnavailable::NoRuntime(told.unwrap_or_default()).into()
        }
        Answer::ERROR_RUNTIME_FAILURE | Answer::ERROR_INITIALIZATION_FAILED | Answer::ERROR_INSTANCE_LOST => {
            VrUnavailable::NoService(answer.to_string()).into()
        }
        result => VrError::Call { call: "an instance", result },
    }
}

/// The extensions that we use, of those offered. None but the first is required.
fn chosen(offered: &xr::ExtensionSet) -> xr::ExtensionSet {
    let mut on = xr::ExtensionSet::default();
    on.khr_vulkan_enable2 = true;
    on.khr_visibility_mask = offered.khr_visibility_mask;
    on.khr_composition_layer_depth = offered.khr_composition_layer_depth;
    on.ext_local_floor = offered.ext_local_floor;
    on.ext_hand_tracking = offered.ext_hand_tracking;
    on.ext_hand_interaction = offered.ext_hand_interaction;
    on.bd_controller_interaction = offered.bd_controller_interaction;
    on.fb_display_refresh_rate = offered.fb_display_refresh_rate;
    on
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_asked_for_that_is_not_offered() {
        let none = chosen(&xr::ExtensionSet::default());
        assert!(none.khr_vulkan_enable2 && none.names().len() == 1);
        let mut some = xr::ExtensionSet::default();
        some.ext_local_floor = true;
        some.khr_opengl_enable = true;
        let on = chosen(&some);
        assert!(on.ext_local_floor && !on.khr_opengl_enable);
    }

    #[test]
    fn a_missing_runtime_and_a_silent_service_are_told_apart() {
        let text = |a| absence(a).to_string();
        assert!(text(Answer::ERROR_RUNTIME_UNAVAILABLE).contains("no OpenXR runtime"));
        assert!(text(Answer::ERROR_RUNTIME_FAILURE).contains("service"));
        assert!(matches!(absence(Answer::ERROR_OUT_OF_MEMORY), VrError::Call { .. }));
    }
}
