//! Every button does what docs/CONTROLS.md says of it; the program's own report says what came of each.

use super::driver::{HEAD, Led, log_of};
use super::service::{Compositor, Service};
use super::validation::Layers;
use glam::{DQuat, DVec3};
use incise::host::vr::space::{Placement, Pose};
use serde_json::Value;

const STROKE_FRAMES: usize = 20;
const LEFT: usize = 0;
const RIGHT: usize = 1;

/// Tears down the front with the right hand, this share of the width beside the middle.
pub fn tear(led: &mut Led, beside: f64) {
    let (size, middle) = (led.high - led.low, 0.5 * (led.low + led.high));
    led.hand(RIGHT).turn = [0.0; 2];
    for i in 0..STROKE_FRAMES {
        let down = i as f64 / (STROKE_FRAMES - 1) as f64 - 0.5;
        let tip = DVec3::new(middle.x + beside * size.x, middle.y - 0.3 * size.y * down, led.high.z - 0.25 * size.z);
        led.hand(RIGHT).position = led.grip_for(tip, 0.5);
        led.hand(RIGHT).trigger = 0.5;
        led.frame(false);
    }
    led.hand(RIGHT).trigger = 0.0;
    led.hand(RIGHT).position = [0.3, 1.0, 0.2];
    for _ in 0..2 {
        led.frame(false);
    }
}

/// Closes the left fist beside the model and moves it; returns nothing, the model goes along.
fn carry(led: &mut Led, from: DVec3, to: DVec3) {
    for i in 0..=10 {
        let way = f64::from((i - 2).max(0)) / 8.0;
        led.hand(LEFT).position = from.lerp(to, way).as_vec3().to_array();
        led.hand(LEFT).squeeze = if i > 0 { 1.0 } else { 0.0 };
        led.frame(false);
    }
    led.hand(LEFT).squeeze = 0.0;
    led.frame(false);
}

/// What the report says of the model after each edit: what it was, faces, hash.
pub fn states(report: &Value) -> Vec<(String, u64, String)> {
    let frames = report["frames"].as_array().expect("frames");
    let state = |edit: &Value| {
        let frame = &frames[edit["frame"].as_u64().expect("a frame") as usize];
        let faces = frame["faces"].as_u64().expect("faces");
        (edit["outcome"].as_str().expect("an outcome").into(), faces, frame["edit_hash"].as_str().expect("a hash").into())
    };
    report["edits"].as_array().expect("edits").iter().map(state).collect()
}

/// Where the model's middle is in a frame, in the room.
fn middle(report: &Value, frame: usize, (low, high): (DVec3, DVec3)) -> DVec3 {
    let stands = &report["frames"][frame]["placement"];
    let number = |v: &Value| v.as_f64().expect("a number");
    let position = DVec3::from_array([0, 1, 2].map(|i| number(&stands["position"][i])));
    Placement { position, yaw: number(&stands["yaw"]), scale: number(&stands["scale"]) }.to_world(0.5 * (low + high))
}

#[test]
#[ignore = "scripts/test-vr runs it"]
fn undo_redo_reset_and_recentre_do_what_their_buttons_say() {
    let service = Service::start("buttons", Compositor::Null);
    let layers = Layers::of(&service);
    let mut led = Led::heart(&service, &[], &layers.environment());
    for _ in 0..3 {
        led.frame(false);
    }
    tear(&mut led, -0.1);
    tear(&mut led, 0.1);
    led.press_a(LEFT);
    led.press_b(LEFT);
    led.press_stick(RIGHT);
    let bounds = (led.low, led.high);
    let before = led.frames() - 1;
    carry(&mut led, DVec3::new(-0.4, 1.2, -0.2), DVec3::new(-0.4, 1.5, 0.4));
    let away = led.frames() - 1;
    led.press_stick(LEFT);
    let back = led.frames() - 1;
    let report = led.report(&service);
    layers.check(&log_of(&service));

    let states = states(&report);
    let outcomes: Vec<&str> = states.iter().map(|s| s.0.as_str()).collect();
    assert_eq!(outcomes, ["torn", "torn", "undone", "redone", "reset"]);
    let frames = report["frames"].as_array().expect("frames");
    let whole = (frames[0]["faces"].as_u64().expect("faces"), frames[0]["edit_hash"].as_str().expect("a hash").to_string());
    let state = |i: usize| (states[i].1, states[i].2.clone());
    assert!(state(0) != whole && state(1) != state(0) && state(1) != whole, "each tear changes the model: {states:?}");
    assert!(states[0].1 > whole.0 && states[1].1 > states[0].1, "and brings faces: {states:?}, before {}", whole.0);
    assert_eq!(state(2), state(0), "undo takes one stroke back");
    assert_eq!(state(3), state(1), "redo brings it again");
    assert_eq!(state(4), whole, "reset takes all back");
    assert_eq!(report["edit_hash"], frames[0]["edit_hash"]);

    let head = Pose { position: DVec3::from_array(HEAD.map(f64::from)), rotation: DQuat::IDENTITY };
    let reach = Placement::within_reach(bounds.0, bounds.1, &head).to_world(0.5 * (bounds.0 + bounds.1));
    let off = |frame: usize| middle(&report, frame, bounds).distance(reach);
    assert!(off(before) < 0.01, "{} m from where it stood at first", off(before));
    assert!(off(away) > 0.5, "carried {} m away", off(away));
    assert!(off(back) < 0.01, "{} m from within reach", off(back));
}
