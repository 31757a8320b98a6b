//! The runtime's own menu opens in the middle of a stroke: frames go on, the hands are the menu's. Monado takes the focus only together
//! with the picture, so a layer between program and runtime takes it here (see focus_layer.c).

use super::buttons::tear;
use super::driver::{Led, log_of};
use super::service::{Compositor, Service, compile};
use super::validation::Layers;
use glam::DVec3;
use std::path::Path;

const RIGHT: usize = 1;
const AWAY: usize = 12;
const NAME: &str = "XR_APILAYER_incise_focus";

/// Makes the layer; returns the folder of its manifest.
fn layer(service: &Service) -> String {
    let library = compile(service, "focus_layer.c", &[]);
    let text = format!(
        r#"{{"file_format_version":"1.0.0","api_layer":{{"name":"{NAME}","library_path":"{}","api_version":"1.0","implementation_version":"1","description":"Takes the focus"}}}}"#,
        library.display()
    );
    std::fs::write(service.folder.join("focus_layer.json"), text).expect("written");
    service.folder.display().to_string()
}

/// One frame of a blade that goes down the front with the trigger held.
fn lead(led: &mut Led, step: usize, meanwhile: impl FnOnce()) {
    let (size, middle) = (led.high - led.low, 0.5 * (led.low + led.high));
    let tip = DVec3::new(middle.x, middle.y + size.y * (0.2 - 0.01 * step as f64), led.high.z - 0.25 * size.z);
    led.hand(RIGHT).position = led.grip_for(tip, 0.5);
    led.hand(RIGHT).trigger = 0.5;
    led.frame_after(false, meanwhile);
}

#[test]
#[ignore = "scripts/test-vr runs it"]
fn a_menu_of_the_runtime_takes_the_hands_and_gives_them_back() {
    let service = Service::start("focus", Compositor::Null);
    let layers = Layers::of(&service);
    let away = service.folder.join("away");
    let folders = format!("{}:{}", layer(&service), std::env::var("XR_API_LAYER_PATH").unwrap_or_default());
    let both = format!("{}:{NAME}", Layers::OPENXR);
    let mut environment = layers.environment().to_vec();
    // what comes later counts
    environment.extend([
        ("XR_API_LAYER_PATH", folders.as_str()),
        ("XR_ENABLE_API_LAYERS", both.as_str()),
        ("INCISE_FOCUS_AWAY", away.to_str().expect("a plain name")),
    ]);
    let mut led = Led::heart(&service, &[], &environment);
    for _ in 0..3 {
        led.frame(false);
    }
    for step in 0..14 {
        lead(&mut led, step, || ());
    }
    lead(&mut led, 14, || std::fs::write(&away, "").expect("written"));
    led.focused = false;
    let lost = led.frames();
    for step in 0..AWAY - 1 {
        lead(&mut led, 15 + step, || ());
    }
    lead(&mut led, 14 + AWAY, || std::fs::remove_file(Path::new(&away)).expect("it was there"));
    led.focused = true;
    let back = led.frames();
    // It comes back with the trigger still held, as it is that has pressed on the menu.
    for step in 0..4 {
        lead(&mut led, 15 + AWAY + step, || ());
    }
    led.hand(RIGHT).trigger = 0.0;
    led.frame(false);
    let again = led.frames();
    tear(&mut led, 0.2);
    let report = led.report(&service);
    layers.check(&log_of(&service));

    let frames = report["frames"].as_array().expect("frames");
    assert_eq!(back - lost, AWAY);
    for (i, frame) in frames.iter().enumerate() {
        assert_eq!(frame["focused"], !(lost..back).contains(&i), "frame {i}");
        assert!(frame["draws"].as_u64() > Some(0), "frame {i} is drawn");
    }
    assert!(frames[lost]["commands"].as_u64() > Some(0), "the stroke is ended where the focus is lost");
    for (i, frame) in frames.iter().enumerate().take(again).skip(lost + 1) {
        assert_eq!(frame["commands"], 0, "frame {i}: no hand does anything");
    }
    let time = |i: usize| frames[i]["time"].as_f64().expect("seconds");
    assert!((time(back) - time(lost) - AWAY as f64 / 90.0).abs() < 1e-9, "the scene goes on meanwhile");
    let edits = report["edits"].as_array().expect("edits");
    let at = |i: usize| edits[i]["frame"].as_u64().expect("a frame") as usize;
    assert_eq!(edits.iter().map(|e| e["outcome"].as_str().expect("a word")).collect::<Vec<_>>(), ["torn", "torn"]);
    assert_eq!(at(0), lost, "the stroke ends where the focus is lost, and stays");
    assert!(at(1) >= again, "and work goes on");
}
