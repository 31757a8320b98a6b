//! A left hand without a controller, its fingers made up by the runtime: its palm opens the panel, and elsewhere a pinch grabs.

use super::driver::{Led, log_of};
use super::service::{Compositor, Service};
use super::validation::Layers;
use serde_json::Value;
use std::f32::consts::{FRAC_PI_2, PI};

const LEFT: usize = 0;

/// Pinches for three frames and lets go for two; returns the first of them.
fn pinch(led: &mut Led) -> usize {
    let first = led.frames();
    for closed in [1.0, 1.0, 1.0, 0.0, 0.0] {
        led.hand(LEFT).trigger = closed;
        led.frame(false);
    }
    first
}

#[test]
#[ignore = "scripts/test-vr runs it"]
fn a_bare_hand_opens_the_panel_with_its_palm_and_grabs_with_a_pinch() {
    let service = Service::start("bare", Compositor::Null);
    let layers = Layers::of(&service);
    let mut led = Led::heart(&service, &[], &layers.environment());
    led.frame(false);
    // Fingers up, the palm to the face, beside the model.
    led.hand(LEFT).bare = true;
    led.hand(LEFT).position = [-0.2, 1.5, -0.4];
    led.hand(LEFT).turn = [PI, -FRAC_PI_2];
    led.frame(false);
    led.frame(false);
    let opened = pinch(&mut led);
    let closed = pinch(&mut led);
    // The palm down, fingers at the model.
    led.hand(LEFT).turn = [0.0; 2];
    led.hand(LEFT).position = (led.placement.to_world(0.5 * (led.low + led.high))).as_vec3().to_array();
    led.frame(false);
    let grabbed = pinch(&mut led);
    let report = led.report(&service);
    layers.check(&log_of(&service));

    let frames = report["frames"].as_array().expect("frames");
    let shown = |frame: &Value| frame["panel"]["draws"].as_u64() > Some(0);
    for (i, frame) in frames.iter().enumerate() {
        assert_eq!(shown(frame), (opened..closed).contains(&i), "frame {i}, opened in {opened}, closed in {closed}");
        assert!(i >= grabbed || frame["commands"] == 0, "frame {i}: a palm that is shown grabs nothing");
    }
    assert!(frames[grabbed]["commands"].as_u64() > Some(0), "a pinch elsewhere closes the forceps");
}
