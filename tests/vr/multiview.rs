//! Both eyes in one pass, where the software adapter would choose two: the same pictures.

use super::buttons::tear;
use super::driver::{Led, log_of};
use super::service::{Compositor, Service};
use super::surgery::difference;
use super::validation::Layers;
use serde_json::Value;

/// A run with this setting of `vr.multiview`: its report and both eyes.
fn run(multiview: &str) -> (Value, [image::RgbImage; 2]) {
    let service = Service::start(&format!("multiview-{multiview}"), Compositor::Null);
    let layers = Layers::of(&service);
    let settings = service.folder.join("multiview.toml");
    std::fs::write(&settings, format!("[vr]\nmultiview = \"{multiview}\"\n")).expect("written");
    let settings = settings.to_str().expect("a plain name");
    let mut led = Led::heart(&service, &["--config", settings], &layers.environment());
    led.frame(false);
    tear(&mut led, 0.1);
    for _ in 0..4 {
        led.frame(true);
    }
    let report = led.report(&service);
    layers.check(&log_of(&service));
    let eye = |i: usize| image::open(service.folder.join(format!("out/eye-{i}.png"))).expect("an eye").to_rgb8();
    (report, [eye(0), eye(1)])
}

#[test]
#[ignore = "scripts/test-vr runs it"]
fn eyes_drawn_at_once_are_those_drawn_in_turn() {
    let (at_once, one_pass) = run("on");
    let (in_turn, two_passes) = run("off");
    assert_eq!((&at_once["multiview"], &in_turn["multiview"]), (&Value::from(true), &Value::from(false)));
    assert_eq!(at_once["edit_hash"], in_turn["edit_hash"]);
    let draws = |report: &Value| report["frames"].as_array().and_then(|f| f.last()).and_then(|f| f["draws"].as_u64());
    assert!(draws(&at_once) < draws(&in_turn), "{:?} draws at once, {:?} in turn", draws(&at_once), draws(&in_turn));
    for eye in 0..2 {
        let off = difference(&one_pass[eye], &two_passes[eye]);
        assert!(off < 0.3, "eye {eye} differs by {off} of 255");
        let twin = at_once["eyes"][eye]["mean_difference"].as_f64().expect("compared");
        assert!(twin < 0.3, "eye {eye} differs by {twin} from the headless picture");
    }
    assert!(difference(&one_pass[0], &two_passes[1]) > 1.0, "the measure tells one eye from the other");
}
