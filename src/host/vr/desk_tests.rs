//! What the board asks for is done.

use super::super::space::Placement;
use super::*;
use crate::config::Dexterity;
use crate::formats::load;
use crate::input::Layer;
use crate::scene::{Scene, SceneSettings};
use crate::surgery::SamplingSettings;
use crate::tissue::{Tissue, TissueSettings};
use std::sync::Arc;

const HEAD: Pose = Pose { position: glam::DVec3::new(0.0, 1.6, 0.0), rotation: glam::DQuat::IDENTITY };

fn scene(name: &str) -> Scene {
    let model = load(name).expect("a bundled name");
    let settings =
        TissueSettings { particles: None, network: Default::default(), opening_s: 0.5, section_faces: 128, fade_s: 0.25 };
    let tissue = Tissue::new(model, &settings).expect("sound settings");
    Scene::new(tissue, SceneSettings { sampling: SamplingSettings::default(), sample_distance: None, sample_time: None })
}

struct Room {
    app: App,
    hands: Hands,
    options: VrOptions,
    frame: InputFrame,
    desk: Desk,
}

impl Room {
    fn new() -> Self {
        let load: models::Load = Arc::new(|request, _| match request.model.as_str() {
            "broken" => Err("broken: not a model".into()),
            name => Ok(Loaded { scene: scene(name), name: name.into(), warnings: Vec::new() }),
        });
        let options = VrOptions {
            config: Default::default(),
            config_file: "/no/such/folder/config.toml".into(),
            load: Some(load),
            export: Some(|_| Box::new(|| Err("the disk is full".into()))),
            allocations: || 0,
            model: "sphere".into(),
            frames: None,
            lockstep: None,
            keep_reports: false,
        };
        let app = App::new(scene("sphere"), 1.0, || 0);
        let (low, high) = app.scene.bounds();
        let hands = Hands::new(options.config.vr, 0.01, Placement::within_reach(low, high, &HEAD));
        let desk = Desk::new(&app, &options, "a card");
        Self { app, hands, options, frame: InputFrame::default(), desk }
    }

    fn act(&mut self, action: PanelAction) {
        let Self { app, hands, options, frame, desk } = self;
        desk.act(action, &mut Work { app, hands, head: &HEAD, options, frame });
    }

    fn take_loaded(&mut self) -> bool {
        let Self { app, hands, options, frame, desk } = self;
        desk.take_loaded(&mut Work { app, hands, head: &HEAD, options, frame })
    }

    /// What the panel is told of a file.
    fn told_of_file(&mut self) -> String {
        let start = std::time::Instant::now();
        while !self.desk.writer.take(&mut self.desk.board.state) {
            assert!(start.elapsed().as_secs() < 60, "no word");
            std::thread::yield_now();
        }
        self.told()
    }

    /// What the panel tells, taken from it.
    fn told(&mut self) -> String {
        self.desk.board.state.notice.take().map_or_else(String::new, |n| n.text)
    }
}

#[test]
fn a_clock_that_stands_goes_on_by_single_steps() {
    let mut room = Room::new();
    assert_eq!(room.desk.step(0.02), 0.02);
    room.act(PanelAction::Step);
    room.act(PanelAction::Pause(true));
    assert_eq!(room.desk.step(0.02), 0.0, "a step is for a clock that stands");
    room.act(PanelAction::Step);
    assert_eq!([room.desk.step(0.02), room.desk.step(0.02)], [SINGLE_STEP_S, 0.0]);
    room.act(PanelAction::Pause(false));
    assert_eq!(room.desk.step(0.02), 0.02);
}

#[test]
fn edits_layers_and_hands_are_passed_on() {
    let mut room = Room::new();
    for action in [PanelAction::Undo, PanelAction::Redo, PanelAction::Reset] {
        room.act(action);
    }
    assert!(matches!(room.frame.commands[..], [EditCommand::Undo, EditCommand::Redo, EditCommand::Reset]));
    room.act(PanelAction::Show(Layer::Wireframe, true));
    room.act(PanelAction::Show(Layer::Wireframe, false));
    assert_eq!(room.frame.show, [(Layer::Wireframe, true), (Layer::Wireframe, false)]);
    assert!(room.desk.board.state.layers.is_empty());
    let before = [room.hands.tool(0), room.hands.tool(1)];
    room.act(PanelAction::SwapHands);
    assert_eq!([room.hands.tool(1), room.hands.tool(0)], before);
    assert_eq!(room.desk.board.state.config.vr.hand, Dexterity::Left, "saved with the settings");
    room.act(PanelAction::PlaneTool(true));
    assert!(room.hands.uses_plane());
    room.hands.set_placement(Placement { scale: 3.0, ..*room.hands.placement() });
    room.act(PanelAction::Frame);
    assert!(room.hands.placement().scale < 3.0, "the model comes back");
    room.act(PanelAction::Speed(0.5));
    room.act(PanelAction::Animate(None));
    assert!(room.desk.board.state.speed == 0.5 && room.app.scene.animation().is_none());
    room.act(PanelAction::Screenshot);
    assert!(room.desk.wants_picture() && !room.desk.wants_picture(), "one picture");
    room.act(PanelAction::Calibrate(true));
    assert!(room.desk.board.state.calibrating);
    room.desk.calibrated(&room.hands, Err("it moved".into()));
    assert!(!room.desk.board.state.calibrating && room.told().contains("moved"));
}

#[test]
fn what_cannot_be_written_is_told() {
    let mut room = Room::new();
    room.act(PanelAction::Export);
    assert!(room.told_of_file().contains("disk is full"));
    room.act(PanelAction::SaveConfig);
    assert!(room.told_of_file().contains("/no/such/folder"));
}

#[test]
fn another_model_takes_the_place_of_the_one_there_was_and_a_broken_one_does_not() {
    let mut room = Room::new();
    let wait = |room: &mut Room| {
        let start = std::time::Instant::now();
        while room.desk.board.state.loading.is_some() && start.elapsed().as_secs() < 60 {
            if room.take_loaded() {
                return true;
            }
            std::thread::yield_now();
        }
        false
    };
    let before = room.app.scene.edit_hash();
    room.act(PanelAction::Open("broken".into()));
    assert!(!wait(&mut room) && room.told().contains("not a model"));
    assert_eq!(room.app.scene.edit_hash(), before);
    room.act(PanelAction::Open("beam".into()));
    assert!(wait(&mut room), "it comes");
    let state = &room.desk.board.state;
    assert_eq!((state.model.as_str(), state.animation, state.animations.len()), ("beam", Some(0), 1));
    assert!(room.app.scene.edit_hash() != before && room.app.scene.animation() == Some(0));
    let (low, high) = room.app.scene.bounds();
    assert_eq!(*room.hands.placement(), Placement::within_reach(low, high, &HEAD));
}
