//! What is missing is named, and what was done is kept.

use super::driver::{Led, log_of};
use super::service::{Compositor, Service, complaint, finish};
use glam::DVec3;

/// The program's last word, for a start that fails.
fn refusal(service: &Service, more: &[(&str, &str)]) -> String {
    let mut command = service.incise(&["vr"]);
    command.envs(more.iter().copied());
    let output = finish(&mut command);
    assert_eq!(output.status.code(), Some(1), "{}", complaint(&output));
    let complaint = complaint(&output);
    assert!(!complaint.contains("panicked"), "{complaint}");
    let ours = complaint.lines().filter(|l| l.starts_with("incise: ")).collect::<Vec<_>>();
    assert_eq!(ours.len(), 1, "one sentence of ours: {complaint}");
    ours[0].to_string()
}

#[test]
#[ignore = "scripts/test-vr runs it"]
fn a_start_without_loader_runtime_or_service_says_which() {
    let absent = Service::absent("absent");
    let loader = refusal(&absent, &[("INCISE_OPENXR_LOADER", "/no/such/loader.so")]);
    assert!(loader.contains("no OpenXR loader") && loader.contains("/no/such/loader.so"), "{loader}");
    let runtime = refusal(&absent, &[("XR_RUNTIME_JSON", "/no/such/runtime.json")]);
    assert!(runtime.contains("no OpenXR runtime is set up"), "{runtime}");
    let service = refusal(&absent, &[]);
    assert!(service.contains("service does not answer"), "{service}");
}

/// A file of settings that has the program wait so many seconds for a runtime to come back.
fn patience(service: &Service, seconds: f64) -> String {
    let file = service.folder.join("patience.toml");
    std::fs::write(&file, format!("[vr]\nreturn_time = {seconds}\n")).expect("written");
    file.display().to_string()
}

/// Tears across the front and keeps the blade in.
fn tear(led: &mut Led) {
    let (low, high) = (led.low, led.high);
    for i in 0..25 {
        let x = low.x + (high.x - low.x) * (0.35 + 0.3 * f64::from(i) / 24.0);
        let tip = DVec3::new(x, 0.5 * (low.y + high.y), high.z - 0.25 * (high.z - low.z));
        led.hand(1).position = led.grip_for(tip, 1.0);
        led.hand(1).trigger = 1.0;
        led.frame(false);
    }
}

#[test]
#[ignore = "scripts/test-vr runs it"]
fn a_runtime_that_dies_leaves_the_work() {
    let mut service = Service::start("dies", Compositor::Null);
    let settings = patience(&service, 0.5);
    let mut led = Led::start(&service, &["heart", "--animation", "none", "--config", &settings], &[]);
    tear(&mut led);
    service.kill();
    assert!(!led.ends_well(), "it cannot go on");
    let log = log_of(&service);
    assert!(log.contains("stopped in mid-session") && log.contains("kept in") && !log.contains("panicked"), "{log}");
    let output = finish(&mut service.incise(&["inspect", "incise-rescued.glb", "--json"]));
    let kept: serde_json::Value = serde_json::from_slice(&output.stdout).expect("the file can be read");
    assert!(kept["boundary_edges"].as_u64() > Some(10), "the wound is in it: {kept:#}");
}

#[test]
#[ignore = "scripts/test-vr runs it"]
fn a_runtime_that_comes_back_is_used_again() {
    let mut service = Service::start("back", Compositor::Null);
    let settings = patience(&service, 120.0);
    let mut led = Led::start(&service, &["heart", "--animation", "none", "--out", "out", "--config", &settings], &[]);
    tear(&mut led);
    service.kill();
    service.start_monado();
    led.reconnect(&service);
    led.hand(1).trigger = 0.0;
    for _ in 0..3 {
        led.frame(false);
    }
    assert!(led.quit(), "{}", log_of(&service));
    let report = std::fs::read_to_string(service.folder.join("out/report.json")).expect("a report");
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    assert_eq!(report["recreated"], 1);
    assert!(report["last_boxes"].as_array().is_some_and(|b| b.len() > 3), "the wound is still there");
}
