//! What is missing is named, and what was done is kept.

use super::driver::{Led, log_of};
use super::service::{Compositor, HANG, Kept, Service, compile, complaint, finish, within};
use glam::DVec3;
use std::process::Command;

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

/// The manifest of a runtime made of bare_runtime.c, with these flags of the compiler's, in the service's folder.
fn bare_runtime(service: &Service, flags: &[&str]) -> String {
    let library = compile(service, "bare_runtime.c", flags);
    let manifest = service.folder.join("bare_runtime.json");
    let library = library.display();
    std::fs::write(&manifest, format!(r#"{{"file_format_version":"1.0.0","runtime":{{"library_path":"{library}"}}}}"#))
        .expect("written");
    manifest.display().to_string()
}

/// Something that is not there.
struct Absence {
    what: &'static str,
    /// The variable that makes it so.
    variable: Option<(&'static str, String)>,
    /// Words of the sentence that says it.
    sentence: &'static str,
}

fn absences(service: &Service) -> [Absence; 4] {
    let set = |name, value: &str| Some((name, value.to_string()));
    let loader = set("INCISE_OPENXR_LOADER", "/no/such/loader.so");
    let runtime = set("XR_RUNTIME_JSON", "/no/such/runtime.json");
    let headset = set("XR_RUNTIME_JSON", &bare_runtime(service, &[]));
    let absence = |what, variable, sentence| Absence { what, variable, sentence };
    [
        absence("loader", loader, "no OpenXR loader was found (INCISE_OPENXR_LOADER=/no/such"),
        absence("runtime", runtime, "no OpenXR runtime is set up (XR_RUNTIME_JSON=/no/such/runtime.json names none)"),
        absence("service", None, "service does not answer"),
        absence("headset", headset, "Bare Runtime runs, but sees no headset"),
    ]
}

#[test]
#[ignore = "scripts/test-vr runs it"]
fn a_start_without_loader_runtime_service_or_headset_says_which() {
    let absent = Service::absent("absent");
    for Absence { what, variable, sentence } in absences(&absent) {
        let said = refusal(&absent, &variable.iter().map(|(name, value)| (*name, value.as_str())).collect::<Vec<_>>());
        assert!(said.contains(sentence), "no {what}: {said}");
    }
}

/// A program that runs for itself, and where it writes what it has to say.
struct Free {
    program: Kept,
    log: std::path::PathBuf,
}

impl Free {
    fn start(service: &Service, name: &str, mut command: Command) -> Self {
        let log = service.folder.join(format!("{name}.log"));
        let file = std::fs::File::create(&log).expect("a log");
        let program = Kept::spawn(command.stdout(file.try_clone().expect("a log")).stderr(file));
        Self { program, log }
    }

    fn said(&self) -> String {
        std::fs::read_to_string(&self.log).unwrap_or_default()
    }

    /// Waits until it has said these words; they must come while it runs.
    fn says(&mut self, words: &str) {
        within(HANG, || self.said().contains(words) || self.program.has_ended());
        assert!(self.said().contains(words) && !self.program.has_ended(), "{words:?}: {}", self.said());
    }
}

#[test]
#[ignore = "scripts/test-vr runs it"]
fn plain_incise_opens_the_headset_and_without_one_a_window() {
    let absent = Service::absent("plain");
    for Absence { what, variable, sentence } in absences(&absent) {
        let display = absent.display(what);
        let mut command = absent.incise(&["-v"]);
        command.envs(variable.clone()).env("DISPLAY", display.name());
        let mut plain = Free::start(&absent, what, command);
        plain.says("first frame after");
        assert!(plain.said().contains(sentence), "no {what}: {}", plain.said());
        // and says so to those, too, who did not ask for more words
        let mut command = absent.incise(&[]);
        command.envs(variable).env("DISPLAY", display.name());
        Free::start(&absent, &format!("{what}-unasked"), command).says(sentence);
    }
    let present = Service::start("present", Compositor::Null);
    Free::start(&present, "present", present.incise(&["-v"])).says("the session is FOCUSED");
}

#[test]
#[ignore = "scripts/test-vr runs it"]
fn plain_incise_goes_on_to_the_window_where_a_headset_gives_no_session() {
    let service = Service::absent("no-session");
    let display = service.display("desktop");
    let runtime = bare_runtime(&service, &["-DHEADSET"]);
    let sentence = "refused its Vulkan requirements";
    let plain = |arguments: &[&str], shows: bool| {
        let mut command = service.incise(arguments);
        command.env("XR_RUNTIME_JSON", &runtime);
        if shows {
            command.env("DISPLAY", display.name());
        }
        command
    };
    let mut window = Free::start(&service, "window", plain(&["-v"], true));
    window.says("first frame after");
    assert!(window.said().contains(sentence), "{}", window.said());
    // Whoever asks for the headset gets no window instead of it.
    let said = refusal(&service, &[("XR_RUNTIME_JSON", &runtime), ("DISPLAY", display.name())]);
    assert!(said.contains(sentence), "{said}");
    // Without a display, too, plain incise goes on: to the demo.
    let mut demo = Free::start(&service, "demo", plain(&[], false));
    demo.says("headless demo");
    assert!(demo.said().contains(sentence), "{}", demo.said());
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
    let mut led = Led::heart(&service, &["--config", &settings], &[]);
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

/// Another program takes the headset for a while, which for ours is the same as its being off: the scene rests, the stroke in
/// progress ends and stays, and then it goes on.
#[test]
#[ignore = "scripts/test-vr runs it"]
fn a_headset_that_is_off_for_a_while_rests_the_scene() {
    let service = Service::start("off", Compositor::Null);
    let mut led = Led::start(&service, &["heart", "--out", "out"], &[]);
    tear(&mut led);
    let mut other = Free::start(&service, "other", service.incise(&["-v", "vr"]));
    other.says("the session is FOCUSED");
    // Ours asks for no input from here on until it has the headset back.
    led.pass();
    drop(other);
    led.hand(1).trigger = 0.0;
    for _ in 0..10 {
        led.frame(false);
    }
    assert!(led.quit(), "{}", log_of(&service));
    let report = std::fs::read_to_string(service.folder.join("out/report.json")).expect("a report");
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    assert!(report["rested"].as_u64() > Some(0), "{}", report["rested"]);
    assert_eq!(report["recreated"], 0);
    assert!(report["last_boxes"].as_array().is_some_and(|b| b.len() > 3), "the wound is still there");
    let times: Vec<f64> = report["frames"].as_array().expect("frames").iter().filter_map(|f| f["time"].as_f64()).collect();
    assert_eq!(times.len(), 25 + 10);
    let step = 1.0 / 90.0;
    assert!(times.windows(2).all(|t| (t[1] - t[0] - step).abs() < 1e-9), "time stands meanwhile: {times:?}");
}
