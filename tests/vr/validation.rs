//! Khronos' validation layers over a run, Vulkan's and OpenXR's: neither may have anything to say.

use super::service::Service;

/// Where OpenXR's layer writes; Vulkan's writes to the program's log.
pub struct Layers {
    openxr: String,
}

impl Layers {
    /// The name of OpenXR's.
    pub const OPENXR: &str = "XR_APILAYER_LUNARG_core_validation";

    /// For a run on this service.
    pub fn of(service: &Service) -> Self {
        Self { openxr: service.folder.join("openxr-validation.txt").to_str().expect("a plain name").into() }
    }

    /// What turns them on.
    pub fn environment(&self) -> [(&str, &str); 5] {
        [
            ("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation"),
            ("XR_ENABLE_API_LAYERS", Self::OPENXR),
            ("VK_LOADER_DEBUG", "layer"),
            ("XR_CORE_VALIDATION_EXPORT_TYPE", "text"),
            ("XR_CORE_VALIDATION_FILE_NAME", &self.openxr),
        ]
    }

    /// Both layers were there, and neither had anything to say. `log`: the program's.
    pub fn check(&self, log: &str) {
        let inserted = |l: &str| l.contains("VK_LAYER_KHRONOS_validation") && l.to_lowercase().contains("insert");
        assert!(log.lines().any(inserted), "Vulkan's layer was not loaded:\n{log}");
        let marks = ["VUID", "Validation Error", "Validation Warning"];
        let found: Vec<&str> = log.lines().filter(|l| marks.iter().any(|m| l.contains(m))).collect();
        assert!(found.is_empty(), "Vulkan validation:\n{}", found.join("\n"));
        let openxr = std::fs::read_to_string(&self.openxr).unwrap_or_default();
        assert!(openxr.contains("Core Validation Layer is initialized"), "OpenXR's layer was not loaded:\n{openxr}");
        let found: Vec<&str> = openxr.lines().filter(|l| !l.trim().is_empty() && !l.contains("VALID_DEBUG")).collect();
        assert!(found.is_empty(), "OpenXR validation:\n{}", found.join("\n"));
    }
}
