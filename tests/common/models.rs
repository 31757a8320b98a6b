//! Small bundled models as scenes.

use incise::formats::{self, Model};
use incise::geometry::VertexId;
use incise::particles::ParticleSettings;
use incise::physics::NetworkSettings;
use incise::scene::{Scene, SceneSettings};
use incise::surgery::SamplingSettings;
use incise::tissue::{SoftLayer, Tissue, TissueSettings};
use std::collections::BTreeMap;
use std::sync::{LazyLock, Mutex};

static LOADED: LazyLock<Mutex<BTreeMap<(String, usize), Model>>> = LazyLock::new(Default::default);

/// A bundled model with about `faces` faces, loaded through a file like any other.
pub fn model(name: &str, faces: usize) -> Model {
    let mut loaded = LOADED.lock().unwrap();
    let key = (name.to_string(), faces);
    loaded
        .entry(key)
        .or_insert_with(|| {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join(format!("{name}.glb"));
            std::fs::write(&path, formats::generate(name, Some(faces)).unwrap()).unwrap();
            formats::load(path.to_str().unwrap()).unwrap()
        })
        .clone()
}

/// A model given as the text of an OBJ file.
pub fn model_of_obj(text: &str) -> Model {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.obj");
    std::fs::write(&path, text).unwrap();
    formats::load(path.to_str().unwrap()).unwrap()
}

/// Settings with about 40 particles.
pub fn settings(model: &Model) -> TissueSettings {
    let rest: Vec<_> = (0..model.rows.len()).map(|v| model.rows.rest(VertexId::new(v))).collect();
    let spacing = 2.2 * ParticleSettings::for_model(&model.mesh, &rest).spacing;
    TissueSettings {
        particles: Some(ParticleSettings::with_spacing(spacing)),
        network: NetworkSettings::SOFT,
        opening_s: 0.1,
        section_faces: 32,
        fade_s: 0.25,
    }
}

/// A scene with one tissue; the flag tells whether the model has an animation.
pub fn scene(name: &str, faces: usize) -> (Scene, bool) {
    scene_of(name, faces, true)
}

/// [`scene`] with particles or without.
pub fn scene_of(name: &str, faces: usize, soft: bool) -> (Scene, bool) {
    let model = model(name, faces);
    let animated = !model.rig.animations.is_empty();
    let mut settings = settings(&model);
    settings.particles = settings.particles.filter(|_| soft);
    let tissue = Tissue::new(model, &settings).unwrap();
    let tools = SceneSettings { sampling: SamplingSettings::default(), sample_distance: None, sample_time: None };
    (Scene::new(tissue, tools), animated)
}

/// The heart with its default number of faces, and with as many particles as a user's, which lets its wounds open in half a second.
pub fn heart() -> Scene {
    users_scene("heart", 18_000, 0.5)
}

/// A model with about `faces` faces and as many particles as a user's; its wounds open in so many seconds.
pub fn users_scene(name: &str, faces: usize, opening_s: f64) -> Scene {
    users_scene_of(model(name, faces), opening_s)
}

/// [`users_scene`] of a model.
pub fn users_scene_of(model: Model, opening_s: f64) -> Scene {
    users_scene_with(model, NetworkSettings::SOFT, opening_s)
}

/// [`users_scene_of`] of a material.
pub fn users_scene_with(model: Model, network: NetworkSettings, opening_s: f64) -> Scene {
    users_scene_wide(model, network, opening_s, 1.0)
}

/// [`users_scene`] whose wounds open so many times as wide in 0.3 s.
pub fn users_scene_opening(name: &str, faces: usize, wide: f64) -> Scene {
    users_scene_wide(model(name, faces), NetworkSettings::SOFT, 0.3, wide)
}

fn users_scene_wide(model: Model, network: NetworkSettings, opening_s: f64, wide: f64) -> Scene {
    let rest: Vec<_> = (0..model.rows.len()).map(|v| model.rows.rest(VertexId::new(v))).collect();
    let mut particles = ParticleSettings { seed: 1, ..ParticleSettings::for_count(&model.mesh, &rest, 200) };
    particles.wound.gap *= wide;
    let settings = TissueSettings { particles: Some(particles), network, opening_s, ..settings(&model) };
    let tools = SceneSettings { sampling: SamplingSettings::default(), sample_distance: None, sample_time: None };
    Scene::new(Tissue::new(model, &settings).unwrap(), tools)
}

/// A vertex with at least two influences.
pub fn first_row(layer: &SoftLayer) -> usize {
    (0..layer.map.influences.rows()).find(|&v| layer.map.influences.row(v).len() > 1).unwrap()
}
