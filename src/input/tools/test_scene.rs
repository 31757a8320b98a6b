//! Scenes that the tools' tests work on.

use crate::formats::load;
use crate::scene::{Scene, SceneSettings};
use crate::surgery::SamplingSettings;
use crate::tissue::{Tissue, TissueSettings};

fn scene(name: &str, particles: bool) -> Scene {
    let model = load(name).expect("a bundled name");
    let rest: Vec<_> = model.mesh.live_vertices().map(|v| model.rows.rest(v)).collect();
    let settings = TissueSettings {
        particles: particles.then(|| crate::particles::ParticleSettings::for_count(&model.mesh, &rest, 60)),
        network: Default::default(),
        opening_s: 0.5,
        section_faces: 128,
        fade_s: 0.25,
    };
    let settings_of_scene = SceneSettings { sampling: SamplingSettings::default(), sample_distance: None, sample_time: None };
    Scene::new(Tissue::new(model, &settings).expect("sound settings"), settings_of_scene)
}

/// A rigged beam, 0.6 m long, without particles.
pub fn beam() -> Scene {
    scene("beam", false)
}

/// A sphere about the origin, 1 m across, with about 60 particles.
pub fn sphere() -> Scene {
    scene("sphere", true)
}
