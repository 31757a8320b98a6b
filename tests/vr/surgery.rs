//! A person tears, pulls and cuts; the program's own report says what came of it.

use super::driver::{Led, log_of};
use super::service::{Compositor, Display, Screen, Service};
use super::validation::Layers;
use glam::DVec3;
use incise::gpu::blit::middle_part;
use serde_json::Value;
use std::path::Path;

/// What a run was told and what it says.
struct Run {
    report: Value,
    /// Tips that were commanded while the trigger was held, model space.
    tips: Vec<DVec3>,
    log: String,
    diagonal: f64,
    /// What the compositor showed at the end, where it shows anything.
    screen: Option<Screen>,
    /// What the window beside the headset showed, where there is a display for it.
    mirror: Option<Screen>,
    /// Frames in which the forceps pulled, and how far, metres.
    pulled: (std::ops::Range<usize>, f64),
}

const PULL: f32 = 0.5;
const STROKE_FRAMES: usize = 40;

/// Tears down the front with the right hand, pulls with the left, cuts in two with the right; from then on the GPU takes `gpu_ms`.
fn operate(service: &Service, more: &[(&str, &str)], gpu_ms: f64) -> Run {
    let mut led = Led::heart(service, &[], more);
    let (low, high) = (led.low, led.high);
    let size = high - low;
    let middle = 0.5 * (low + high);
    for _ in 0..5 {
        led.frame(false);
    }
    // Into the front, a tenth of the model deep.
    let mut tips = Vec::new();
    let front = |u: f64| DVec3::new(middle.x, middle.y + size.y * (0.15 - 0.3 * u), high.z - 0.25 * size.z);
    for i in 0..STROKE_FRAMES {
        let tip = front(i as f64 / (STROKE_FRAMES - 1) as f64);
        led.hand(1).position = led.grip_for(tip, PULL);
        led.hand(1).trigger = PULL;
        led.frame(false);
        tips.push(tip);
    }
    led.hand(1).trigger = 0.0;
    for _ in 0..3 {
        led.frame(false);
    }
    // Forceps at the left of the wound, pulled towards the user.
    let first = led.frames();
    for i in 0..15 {
        let tip = DVec3::new(middle.x - 0.15 * size.x, middle.y, high.z - 0.1 * size.z + 0.1 * size.z * i as f64 / 15.0);
        led.hand(0).position = led.grip_for(tip, 0.0);
        led.hand(0).trigger = if i > 2 { 1.0 } else { 0.0 };
        led.frame(false);
    }
    let pulled = (first + 3..led.frames(), 0.1 * size.z * 12.0 / 15.0);
    led.hand(0).trigger = 0.0;
    led.frame(false);
    // The plane tool, upright through the right half.
    led.press_a(1);
    led.hand(1).position = led.grip_for(DVec3::new(middle.x + 0.2 * size.x, middle.y, high.z), 0.0);
    for trigger in [1.0, 1.0, 0.0, 0.0, 0.0] {
        led.hand(1).trigger = trigger;
        led.frame(false);
    }
    for _ in 0..8 {
        led.frame(false);
    }
    led.gpu_ms = gpu_ms;
    // The panel, opened and closed again, and opened for the picture.
    led.press_b(1);
    led.press_b(1);
    led.press_b(1);
    for _ in 0..6 {
        led.frame(true);
    }
    let [screen, mirror] = [&service.display, &service.desktop].map(|d| d.as_ref().map(Display::settled));
    let report = led.report(service);
    Run { report, tips, log: log_of(service), diagonal: size.length(), screen, mirror, pulled }
}

fn points(value: &Value) -> Vec<DVec3> {
    let point = |v: &Value| DVec3::from_array([0, 1, 2].map(|i| v[i].as_f64().expect("a number")));
    value.as_array().expect("points").iter().map(point).collect()
}

/// Share of the commanded stroke, its two ends left out, that some box of the wound lies beside (seen along the blade).
fn torn_share(tips: &[DVec3], boxes: &[DVec3], reach: f64) -> f64 {
    let inner = &tips[tips.len() / 8..tips.len() - tips.len() / 8];
    let beside = |tip: &&DVec3| boxes.iter().any(|b| (*b - **tip).truncate().length() < reach);
    inner.iter().filter(beside).count() as f64 / inner.len() as f64
}

fn check_surgery(run: &Run) {
    let edits = run.report["edits"].as_array().expect("edits");
    let outcomes: Vec<&str> = edits.iter().filter_map(|e| e["outcome"].as_str()).collect();
    assert_eq!(outcomes, ["torn", "cut"], "{}", run.log);
    // The program saw the hand where it was led ...
    let seen = points(&run.report["tips"]);
    let nearest = |p: &DVec3| seen.iter().map(|s| s.distance(*p)).fold(f64::INFINITY, f64::min);
    let off = run.tips.iter().map(nearest).fold(0.0, f64::max);
    assert!(off < 1e-5, "{off} m off");
    // ... and tore there, and nowhere else.
    let boxes = points(&run.report["last_boxes"]);
    let reach = 0.03 * run.diagonal;
    assert!(boxes.len() > 3, "{} boxes", boxes.len());
    assert_eq!(torn_share(&run.tips, &boxes, reach), 1.0);
    let elsewhere: Vec<DVec3> = run.tips.iter().map(|p| p + DVec3::X * 0.1 * run.diagonal).collect();
    assert_eq!(torn_share(&elsewhere, &boxes, reach), 0.0, "the measure sees a wound that is elsewhere");
    let right = &run.report["pulses_by_cause"][1];
    let felt = |cause: &str| right[cause].as_u64().expect("counted");
    assert!(
        felt("contact") > 0 && felt("segments") > 1 && felt("severed") == 1,
        "contact, segments and the cut are felt: {right}"
    );
    assert!(edits[1]["pieces"].as_array().is_some_and(|p| p.len() >= 2));
    assert!(edits[0]["new_vertices"].as_u64() > Some(10));
    let frames = run.report["frames"].as_array().expect("frames");
    assert!(frames.len() > STROKE_FRAMES && run.report["drawn"].as_u64() >= Some(frames.len() as u64));
    let displaced = |frame: usize| frames[frame]["displaced"].as_f64().expect("metres");
    let (held, by) = (&run.pulled.0, run.pulled.1);
    let further = displaced(held.end - 1) - displaced(held.start - 1);
    assert!(further > 0.3 * by, "the forceps were pulled by {by} m and took the tissue {further} m along");
}

/// Mean difference of two pictures, of 255.
pub fn difference(a: &image::RgbImage, b: &image::RgbImage) -> f64 {
    a.as_raw().iter().zip(b.as_raw()).map(|(x, y)| f64::from(x.abs_diff(*y))).sum::<f64>() / a.as_raw().len() as f64
}

/// Both eyes show the model, each from its own place, and as a device draws it that has seen none of the edits happen.
fn check_eyes(run: &Run, folder: &Path) {
    let open = |name: &str| image::open(folder.join(name)).unwrap_or_else(|e| panic!("{name}: {e}")).to_rgb8();
    let eyes = [open("eye-0.png"), open("eye-1.png")];
    for (i, eye) in eyes.iter().enumerate() {
        let twin = open(&format!("headless-{i}.png"));
        let off = difference(eye, &twin);
        assert!(off < 0.3, "eye {i} differs by {off} of 255 from the headless picture");
        let colours: std::collections::BTreeSet<&[u8]> = eye.as_raw().chunks(3).collect();
        assert!(colours.len() > 500, "eye {i} has {} colours", colours.len());
    }
    assert!(difference(&eyes[0], &eyes[1]) > 1.0, "the eyes see from different places");
    assert!(run.report["eyes"][1]["mean_difference"].as_f64().is_some_and(|d| d < 0.3));
}

/// What was drawn of the eyes' pictures in the end, a share of each side; and the GPU told what its passes took.
fn check_resolution(report: &Value, share: f64) {
    assert_eq!(report["least_resolution"].as_f64(), Some(share));
    for side in 0..2 {
        let (full, drawn) = (report["eye_size"][side].as_f64(), report["eyes"][0]["size"][side].as_f64());
        let (full, drawn) = (full.expect("pixels"), drawn.expect("pixels"));
        assert!((drawn - share * full).abs() <= 8.0, "{drawn} of {full} pixels");
    }
    let last = report["frames"].as_array().and_then(|f| f.last()).expect("frames");
    assert!(last["gpu_ms"]["views"].as_f64() > Some(0.0), "{}", last["gpu_ms"]);
}

/// The mirror shows the middle of what the left eye sees.
fn check_mirror(run: &Run, eye: &Screen) {
    assert!(run.report["mirrored"].as_u64() > Some(20), "{}", run.report["mirrored"]);
    let mirror = run.mirror.as_ref().expect("a window beside the headset");
    let [left, top, width, height] = middle_part(eye.dimensions(), mirror.dimensions(), 0.75);
    let off = |shift: f32| {
        let mut sum = 0.0;
        let mut count = 0.0;
        for (x, y, pixel) in mirror.enumerate_pixels().filter(|(x, y, _)| x % 5 == 0 && y % 5 == 0) {
            let along = |at: u32, of: u32| (at as f32 + 0.5) / of as f32;
            let u = left + width * along(x, mirror.width()) + shift;
            let v = top + height * along(y, mirror.height());
            let place = |t: f32, of: u32| ((t * of as f32) as u32).min(of - 1);
            let there = eye.get_pixel(place(u, eye.width()), place(v, eye.height()));
            sum += (0..3).map(|c| f64::from(pixel.0[c].abs_diff(there.0[c]))).sum::<f64>() / 3.0;
            count += 1.0;
        }
        sum / count
    };
    let (here, beside) = (off(0.0), off(0.1));
    assert!(here < 3.0, "{here} steps a channel from the eye's picture");
    assert!(beside > 2.0 * here, "the measure sees a picture that is elsewhere: {beside} and {here}");
}

#[test]
#[ignore = "scripts/test-vr runs it"]
fn a_person_tears_pulls_and_cuts_and_every_run_is_the_same() {
    let window = Service::start("window", Compositor::Window(20)).with_desktop();
    let layers = Layers::of(&window);
    let validated = operate(&window, &layers.environment(), 0.0);
    check_resolution(&validated.report, 1.0);
    check_surgery(&validated);
    check_eyes(&validated, &window.folder.join("out"));
    let eye = image::open(window.folder.join("out/eye-0.png")).expect("the left eye").to_rgb8();
    check_mirror(&validated, &eye);
    layers.check(&validated.log);

    let null = Service::start("null", Compositor::Null);
    let again = operate(&null, &[], 500.0);
    check_surgery(&again);
    check_eyes(&again, &null.folder.join("out"));
    check_resolution(&again.report, 0.6);
    for hash in ["edit_hash", "state_hash"] {
        assert_eq!(validated.report[hash], again.report[hash], "two runs, one {hash}");
    }
    keep(&window.folder.join("out"), &[&validated.screen, &validated.mirror]);
}

/// Leaves pictures and report where INCISE_XR_KEEP says.
fn keep(out: &Path, screens: &[&Option<Screen>; 2]) {
    let Some(folder) = std::env::var_os("INCISE_XR_KEEP").map(std::path::PathBuf::from) else { return };
    std::fs::create_dir_all(&folder).expect("a folder");
    for name in ["eye-0.png", "eye-1.png", "headless-0.png", "headless-1.png", "report.json"] {
        let _ = std::fs::copy(out.join(name), folder.join(name));
    }
    for (screen, name) in screens.iter().zip(["composited.png", "mirror.png"]) {
        screen.as_ref().expect("a window that shows something").save(folder.join(name)).expect("written");
    }
}
