//! A session without a window: models that come and do not come, settings that are saved.

use super::*;
use crate::config::Config;
use crate::geometry::Plane;
use crate::physics::NetworkSettings;
use crate::scene::{Scene, SceneSettings};
use crate::surgery::BladePose;
use crate::tissue::{Tissue, TissueSettings};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const SIZE: [f64; 2] = [800.0, 600.0];

fn scene(name: &str) -> Result<Scene, String> {
    let model = crate::formats::load(name).map_err(|e| e.to_string())?;
    let settings =
        TissueSettings { particles: None, network: NetworkSettings::SOFT, opening_s: 0.5, section_faces: 128, fade_s: 0.25 };
    let tissue = Tissue::new(model, &settings).map_err(|e| e.to_string())?;
    let tools = SceneSettings { sampling: Config::default().sampling, sample_distance: None, sample_time: None };
    Ok(Scene::new(tissue, tools))
}

fn loaded(name: &str) -> Result<Loaded, String> {
    Ok(Loaded { scene: scene(name)?, name: name.to_string(), warnings: Vec::new() })
}

/// A session with a sphere, whose settings are saved in `file`, and the requests that its loader was given.
fn session(file: &Path) -> (Session, Arc<Mutex<Vec<Request>>>) {
    let asked = Arc::new(Mutex::new(Vec::new()));
    let noted = asked.clone();
    let setup = Setup {
        config: Config::default(),
        config_file: file.to_path_buf(),
        load: Arc::new(move |request, tell| {
            noted.lock().expect("one thread").push(request.clone());
            tell("reading", 0.5);
            loaded(&request.model)
        }),
        export: |_| Box::new(|| Ok(Vec::new())),
        started: Instant::now(),
        record: false,
        size: (800, 600),
        allocations: || 0,
    };
    let first = loaded("sphere").expect("bundled");
    (Session::new(setup, first, SIZE, Wake::default()), asked)
}

/// Lets the loader finish.
fn settle(session: &mut Session) {
    for _ in 0..6000 {
        session.take_loaded(SIZE);
        if session.panel.loading.is_none() {
            return;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("the loader does not end");
}

#[test]
fn a_broken_model_leaves_the_current_one_and_says_so() {
    let (mut session, _) = session(Path::new("unused"));
    let before = session.app.scene.state_hash();
    session.scene_changed = false;
    session.act(PanelAction::Open("no-such-model".into()), SIZE);
    assert!(session.panel.loading.is_some());
    settle(&mut session);
    let notice = session.panel.notice.clone().expect("an error");
    assert!(notice.error && notice.text.contains("no-such-model") && notice.text.contains("stays"), "{}", notice.text);
    assert_eq!((session.panel.model.as_str(), session.scene_changed), ("sphere", false));
    assert_eq!(session.app.scene.state_hash(), before);
    (session.panel.undo_depth, session.panel.redo_depth) = (2, 1);
    session.act(PanelAction::Open("beam".into()), SIZE);
    settle(&mut session);
    assert_eq!((session.panel.model.as_str(), session.scene_changed), ("beam", true));
    assert_eq!((session.panel.undo_depth, session.panel.redo_depth), (0, 0), "another model's edits cannot be redone");
    assert!(session.panel.notice.is_none() && session.app.scene.state_hash() != before);
}

#[test]
fn of_several_wishes_the_last_one_counts() {
    let (mut session, asked) = session(Path::new("unused"));
    for model in ["beam", "heart", "no-such-model", "beam"] {
        session.act(PanelAction::Open(model.into()), SIZE);
    }
    settle(&mut session);
    assert_eq!(session.panel.model, "beam");
    assert!(session.panel.notice.is_none());
    let asked: Vec<String> = asked.lock().expect("one thread").iter().map(|r| r.model.clone()).collect();
    assert_eq!(asked, ["beam", "beam"], "what was overtaken is not loaded");
}

#[test]
fn other_particles_are_seen_from_where_the_model_was_and_another_model_is_not() {
    let (mut session, asked) = session(Path::new("unused"));
    let pose = |session: &Session| session.tools.camera.pose();
    session.tools.camera.turn(0.7, 0.1);
    let turned = pose(&session);
    session.panel.spacing = Some(0.125);
    session.act(PanelAction::Regenerate, SIZE);
    settle(&mut session);
    assert_eq!(asked.lock().expect("one thread")[0].spacing, Some(0.125));
    assert_eq!((pose(&session), session.panel.spacing), (turned, Some(0.125)));
    session.act(PanelAction::Open("sphere".into()), SIZE);
    settle(&mut session);
    assert!((pose(&session).eye - turned.eye).length() > 0.1 && session.panel.spacing.is_none());
}

/// Saves the settings and waits for what is told of it.
fn save(session: &mut Session) {
    session.panel.notice = None;
    session.act(PanelAction::SaveConfig, SIZE);
    let start = Instant::now();
    while session.panel.notice.is_none() {
        assert!(start.elapsed().as_secs() < 60, "no word");
        session.take_written();
        std::thread::yield_now();
    }
}

#[test]
fn saved_settings_keep_the_files_words_and_a_broken_file_is_left_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("config.toml");
    let (mut session, _) = session(&file);
    save(&mut session);
    let fresh = std::fs::read_to_string(&file).expect("written");
    assert!(fresh.contains("# what a tear looks like"), "a new file explains its keys");
    std::fs::write(&file, "# mine\n[tear]\ngap = 0.03 # wide\n").expect("written");
    session.panel.config.tear.gap = 0.05;
    save(&mut session);
    assert_eq!(std::fs::read_to_string(&file).expect("there"), "# mine\n[tear]\ngap = 0.05 # wide\n");
    std::fs::write(&file, "[tear\n").expect("written");
    save(&mut session);
    assert!(session.panel.notice.as_ref().is_some_and(|n| n.error && n.text.contains("not saved")));
    assert_eq!(std::fs::read_to_string(&file).expect("there"), "[tear\n");
}

#[test]
fn an_edit_that_outgrows_the_adapter_is_undone_and_a_model_that_does_gives_way() {
    let (mut session, asked) = session(Path::new("unused"));
    let full = GpuError::TooManyTissues { most: 1 };
    let whole = session.app.scene.edit_hash();
    let cut = EditCommand::Cut(Plane::Equation { normal: DVec3::X, offset: 0.0 });
    for in_progress in [false, true] {
        if in_progress {
            session.app.scene.edit(EditCommand::StrokeBegin { width: 0.01 });
            for i in 0..20 {
                let (t, y) = (f64::from(i) * 0.05, 0.1 - 0.01 * f64::from(i));
                let pose = BladePose { t, tip: DVec3::new(0.0, y, 0.0), base: DVec3::new(0.0, y, 1.0) };
                session.app.scene.edit(EditCommand::StrokePose(pose));
            }
        } else {
            session.app.scene.edit(cut.clone());
        }
        assert_ne!(session.app.scene.edit_hash(), whole);
        session.scene_changed = false;
        session.does_not_fit(&full, SIZE);
        assert_eq!((session.app.scene.edit_hash(), session.scene_changed), (whole, true));
        let notice = session.panel.notice.take().expect("told");
        assert!(notice.error && notice.text.contains("undone"), "{}", notice.text);
    }
    assert!(asked.lock().expect("one thread").is_empty(), "the model stays");
    session.does_not_fit(&full, SIZE);
    settle(&mut session);
    assert_eq!(session.panel.model, "beam");
}
