//! The panel in the room: opened with its button, pointed at with a hand's ray, pressed with the trigger.

use super::buttons::{states, tear};
use super::driver::{HEAD, Led, log_of};
use super::service::{Compositor, Service, finish};
use super::validation::Layers;
use glam::{DQuat, DVec3};
use incise::formats::BUNDLED;
use incise::host::vr::board::{POINTS, SHARPNESS, placed, point_of};
use incise::host::vr::space::Pose;
use incise::panel::{Panel, PanelAction, PanelState};
use incise::surgery::WallMode;
use serde_json::Value;

const RIGHT: usize = 1;

/// The panel as the headset shows it over a heart with so many edits.
fn shown(edits: usize) -> PanelState {
    PanelState {
        in_room: true,
        bundled: BUNDLED.to_vec(),
        model: "heart".into(),
        diagonal: 0.16,
        undo_depth: edits,
        ..PanelState::default()
    }
}

/// The middle of what does this when it is pressed, in points: found by pressing everywhere.
fn place_of(state: &PanelState, does: impl Fn(&PanelAction, &PanelState) -> bool) -> [f32; 2] {
    let mut panel = Panel::new();
    let mut hit = |at: [f32; 2]| {
        let mut state = state.clone();
        let mut actions = Vec::new();
        // sections that an earlier press has closed are open again
        panel.context().memory_mut(|memory| memory.data.clear());
        for (at, press) in [(Some(at), None), (Some(at), Some(true)), (Some(at), Some(false)), (None, None)] {
            let mut frame = panel.run_pointer((POINTS, SHARPNESS), at, press, &mut state);
            frame.textures.clear();
            actions.extend(frame.actions);
        }
        actions.iter().any(|action| does(action, &state))
    };
    let rows = (4..POINTS[1] as u32).step_by(6);
    let mut places = rows.flat_map(|y| (8..POINTS[0] as u32).step_by(8).map(move |x| [x as f32, y as f32]));
    let corner = places.find(|&at| hit(at)).expect("there is such a button");
    let mut last = |axis: usize| {
        let mut at = corner;
        while hit(at) {
            at[axis] += 2.0;
        }
        at[axis] - 2.0
    };
    [0.5 * (corner[0] + last(0)), 0.5 * (corner[1] + last(1))]
}

/// Points the right hand at a point of the open board, its blade's tip at `tip` (model space), and pulls the trigger and lets it go,
/// while the hand goes down by a few millimetres.
fn press(led: &mut Led, tip: DVec3, at: DVec3) {
    for (i, trigger) in [0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0].into_iter().enumerate() {
        let down = DVec3::Y * 0.001 * (i as f64 - 4.0);
        led.point(RIGHT, tip - down / led.placement.scale, at - down);
        led.hand(RIGHT).trigger = trigger;
        led.frame(false);
    }
}

#[test]
#[ignore = "scripts/test-vr runs it"]
fn the_panel_is_opened_pointed_at_and_pressed_and_costs_nothing_closed() {
    let service = Service::start("panel", Compositor::Null);
    let layers = Layers::of(&service);
    let mut led = Led::heart(&service, &[], &layers.environment());
    let board = placed(&Pose { position: DVec3::from_array(HEAD.map(f64::from)), rotation: DQuat::IDENTITY });
    let wall = place_of(&shown(0), |_, state| state.config.tear.wall == WallMode::Closed);
    let undo = place_of(&shown(1), |action, _| *action == PanelAction::Undo);
    // Where the blade is in the tissue while its hand points at the board, and where it is in the air.
    let (size, middle) = (led.high - led.low, 0.5 * (led.low + led.high));
    let inside = DVec3::new(middle.x, middle.y, led.high.z - 0.25 * size.z);
    let outside = inside + DVec3::new(0.0, 0.0, 3.0 * size.z);

    for _ in 0..3 {
        led.frame(false);
    }
    let mut open = Vec::new();
    let mut opened = |led: &mut Led, press_at: &dyn Fn(&mut Led)| {
        led.press_b(RIGHT);
        let first = led.frames() - 4;
        press_at(led);
        open.push(first..led.frames());
        led.press_b(RIGHT);
    };
    opened(&mut led, &|led| press(led, outside, point_of(&board, wall)));
    tear(&mut led, 0.1);
    opened(&mut led, &|led| press(led, inside, point_of(&board, undo)));
    // The control: the same hand does tear where no panel is open.
    press(&mut led, inside, point_of(&board, undo));
    let last = led.frames();
    let report = led.report(&service);
    layers.check(&log_of(&service));

    let edits = report["edits"].as_array().expect("edits");
    let states = states(&report);
    let outcomes: Vec<&str> = states.iter().map(|s| s.0.as_str()).collect();
    assert_eq!(outcomes, ["torn", "undone", "torn"], "a trigger on the panel tears nothing, and elsewhere it does");
    assert!(edits[0]["wall_faces"].as_u64() > Some(10), "the panel has chosen walls: {}", edits[0]["wall_faces"]);
    assert_eq!(states[1].2, report["frames"][0]["edit_hash"].as_str().expect("a hash"), "the panel's undo brings all back");
    let undone = edits[1]["frame"].as_u64().expect("a frame") as usize;
    assert!(open[1].contains(&undone), "undone in frame {undone}, the panel open in {open:?}");

    let frames = report["frames"].as_array().expect("frames");
    assert_eq!(frames.len(), last);
    let cost = |frame: &Value, of: &str| frame["panel"][of].as_u64().expect("counted");
    for (i, frame) in frames.iter().enumerate() {
        let cost = ["draws", "bytes_uploaded"].map(|of| cost(frame, of));
        if open.iter().any(|frames| frames.contains(&i)) {
            assert!(cost[0] > 0 && cost[1] > 1000, "the open panel is drawn in frame {i}: {cost:?}");
        } else {
            assert_eq!(cost, [0, 0], "frame {i}, in which no panel is open");
        }
    }
}

#[test]
#[ignore = "scripts/test-vr runs it"]
fn what_the_panel_has_written_is_written_behind_the_frames_back() {
    let service = Service::start("files", Compositor::Null);
    let mut led = Led::heart(&service, &[], &[]);
    let board = placed(&Pose { position: DVec3::from_array(HEAD.map(f64::from)), rotation: DQuat::IDENTITY });
    let outside = led.high + DVec3::new(0.0, 0.0, 3.0 * (led.high - led.low).z);
    tear(&mut led, 0.1);
    led.press_b(RIGHT);
    let wanted = [PanelAction::Export, PanelAction::Screenshot, PanelAction::SaveConfig];
    let places = wanted.map(|wanted| place_of(&shown(1), |action, _| *action == wanted));
    let calls = led.file_calls();
    assert!(calls > 0, "reads at the start are counted");
    for at in places {
        press(&mut led, outside, point_of(&board, at));
    }
    for _ in 0..5 {
        led.frame(false);
    }
    let calls = led.file_calls() - calls;
    let torn = led.report(&service);
    assert_eq!(calls, 0, "reads and writes of files by the frames' thread");
    let picture = image::open(service.folder.join("screenshots/incise-vr-0001.png")).expect("a picture");
    assert_eq!(Some(u64::from(picture.width())), torn["eye_size"][0].as_u64());
    let settings = std::fs::read_to_string(service.folder.join("config.toml")).expect("settings");
    assert!(settings.contains("# the headset"), "with their comments");
    let output = finish(&mut service.incise(&["inspect", "export.glb", "--json"]));
    let model: Value = serde_json::from_slice(&output.stdout).expect("the model can be read");
    assert_eq!(model["faces"], torn["edits"][0]["faces"], "the torn heart");
}
