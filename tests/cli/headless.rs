//! Scripts played without a window.

use super::edits::check_edit;
use super::support::{Is, Place, close, count, files_in, has, list, number};
use serde_json::Value;

const SIZE: &str = "--size 64x48";

const TEAR: &str = r#"
[[action]]
kind = "tear"
at = 0.1
poses = [
    { t = 0.0, tip = [-0.01, -0.01, 0.09], base = [-0.01, 0.25, 0.11] },
    { t = 0.3, tip = [0.01, -0.01, -0.09], base = [0.01, 0.25, -0.11] },
]
"#;

/// A script on the bending beam with a coarse step.
fn script(place: &Place, frames: usize, actions: &str) {
    let head = format!("model = \"beam\"\nanimation = \"bend\"\nstep = 0.1\nframes = {frames}\n[tear]\nwidth = 0.004\n");
    place.write("script.toml", format!("{head}{actions}"));
}

fn action(kind: &str, at: f64, rest: &str) -> String {
    format!("[[action]]\nkind = \"{kind}\"\nat = {at}\n{rest}\n")
}

fn all_actions() -> String {
    [
        TEAR,
        &action("show", 0.0, "layer = \"boxes\""),
        &action("undo", 0.6, ""),
        &action("redo", 0.7, ""),
        &action("cut", 0.8, "plane = [1.0, 0.15, 0.1, 0.12]\ncap = false"),
        &action(
            "grab",
            0.9,
            "center = [-0.28, 0.0, 0.0]\nradius = 0.06\nuntil = 1.2\nmoves = [{ t = 0.2, by = [0.0, 0.03, 0.0] }]",
        ),
    ]
    .concat()
}

fn play(place: &Place, out: &str) -> Value {
    place.ok(&format!("headless --script script.toml {SIZE} --out {out}"));
    place.json(&format!("{out}/report.json"))
}

/// Pictures of a run, by name.
fn pictures(place: &Place, out: &str) -> Vec<(String, Vec<u8>)> {
    let names = files_in(&place.path(out)).into_iter().filter(|n| n.ends_with(".png"));
    names.map(|n| (n.clone(), std::fs::read(place.path(out).join(n)).unwrap())).collect()
}

#[test]
fn a_script_leaves_pictures_and_a_report() {
    let place = Place::new();
    script(&place, 15, &all_actions());
    let report = play(&place, "first");
    let names: Vec<String> = (0..15).map(|i| format!("frame-{i:04}.png")).chain(["report.json".into()]).collect();
    assert_eq!(files_in(&place.path("first")), names);
    has(
        &report,
        &[(Is::Text, &["adapter", "edit_hash", "state_hash"]), (Is::List, &["edits", "frames"]), (Is::Object, &["errors"])],
    );
    has(&report["errors"], &[(Is::Number, &["gpu_vs_cpu_max"])]);
    assert!(number(&report["errors"]["gpu_vs_cpu_max"]) < 1e-6);
    assert_eq!(list(&report["frames"]).len(), 15);
    for (i, frame) in list(&report["frames"]).iter().enumerate() {
        has(frame, &[(Is::Number, &["time"]), (Is::Object, &["stages_ms", "counters"])]);
        has(&frame["stages_ms"], &[(Is::Number, &["tools", "edit", "pose", "physics", "upload", "deform", "draw", "total"])]);
        let counters: &[&str] = &["dispatches", "draws", "bytes_uploaded", "faces_visited", "particles_awake", "allocations"];
        has(&frame["counters"], &[(Is::Count, counters)]);
        assert!((number(&frame["time"]) - 0.1 * i as f64).abs() < 1e-12);
    }
    let edits: Vec<(u64, &str, &str)> = list(&report["edits"])
        .iter()
        .map(|e| {
            check_edit(e);
            (count(&e["frame"]), e["kind"].as_str().unwrap(), e["outcome"].as_str().unwrap())
        })
        .collect();
    let found: Vec<(u64, &str)> = edits.iter().map(|&(frame, kind, _)| (frame, kind)).collect();
    assert_eq!(found, [(4, "tear"), (6, "undo"), (7, "redo"), (8, "cut")]);
    assert_eq!((edits[0].2, edits[3].2), ("torn", "cut"));
    let edit = |i: usize| &report["edits"][i];
    assert_eq!(count(&edit(1)["faces"]), 2816, "undo brings the beam back");
    assert_eq!(edit(2)["faces"], edit(0)["faces"], "redo tears it again");
    let area = |e: &Value| number(&e["pieces"][0]["area"]);
    close(number(&edit(1)["area_before"]), area(edit(0)), 0.02); // two frames of the animation lie between
    assert!(area(edit(1)) > 1.001 * number(&edit(1)["area_before"]), "what was torn out is back");
    assert!(list(&report["frames"])[11]["counters"]["particles_awake"].as_u64() > Some(0), "a hand wakes the layer");

    // again, and with another number of threads: the same bits
    let ran = place.run_with(&format!("headless --script script.toml {SIZE} --out second"), &[("RAYON_NUM_THREADS", "1")]);
    assert_eq!(ran.code, 0, "{}", ran.stderr);
    let again = place.json("second/report.json");
    for key in ["edit_hash", "state_hash"] {
        assert_eq!(report[key], again[key], "{key}");
    }
    let first = pictures(&place, "first");
    assert!(first == pictures(&place, "second"), "the same pictures");
    assert!(first[0].1 != first[14].1, "pictures can differ");
}

#[test]
fn undo_returns_exactly() {
    let place = Place::new();
    let play = |frames: usize, actions: &str, out: &str| {
        script(&place, frames, actions);
        let report = play(&place, out);
        assert!(number(&report["errors"]["gpu_vs_cpu_max"]) < 1e-6, "{out}: {}", report["errors"]);
        report["edit_hash"].as_str().unwrap().to_string()
    };
    let none = play(1, "", "none");
    let torn = play(6, TEAR, "torn");
    let undone = play(8, &format!("{TEAR}{}", action("undo", 0.6, "")), "undone");
    let redone = play(9, &format!("{TEAR}{}{}", action("undo", 0.6, ""), action("redo", 0.7, "")), "redone");
    let cut = action("cut", 0.6, "plane = [1.0, 0.0, 0.0, 0.12]\ncap = false");
    let reset = play(9, &format!("{TEAR}{cut}{}", action("reset", 0.8, "")), "reset");
    assert_ne!(none, torn);
    assert_eq!((&undone, &redone, &reset), (&none, &torn, &none));
}

#[test]
fn an_edit_that_falls_into_a_tear_waits_for_its_end() {
    let place = Place::new();
    let cut = action("cut", 0.2, "plane = [1.0, 0.0, 0.0, 0.12]\ncap = false");
    let undo = |at: f64| action("undo", at, "");
    script(&place, 10, &format!("{TEAR}{cut}{}{}", undo(0.6), undo(0.7)));
    let report = play(&place, "mixed");
    let found: Vec<(u64, &str)> =
        list(&report["edits"]).iter().map(|e| (count(&e["frame"]), e["kind"].as_str().unwrap())).collect();
    assert_eq!(found, [(4, "tear"), (4, "cut"), (6, "undo"), (7, "undo")]);
    assert_eq!(count(&report["edits"][3]["faces"]), 2816, "both are taken back");
}

#[test]
fn inspection_layers_change_pictures_and_nothing_else() {
    let place = Place::new();
    script(&place, 6, TEAR);
    let plain = play(&place, "plain");
    let layers = ["particles", "wireframe", "sections", "boxes", "influences", "strips"];
    let shows: String = layers.map(|layer| action("show", 0.0, &format!("layer = \"{layer}\"\non = true"))).concat();
    script(&place, 6, &format!("{TEAR}{shows}"));
    let shown = play(&place, "shown");
    for key in ["edit_hash", "state_hash"] {
        assert_eq!(plain[key], shown[key], "{key}");
    }
    assert!(pictures(&place, "plain")[5] != pictures(&place, "shown")[5]);
}

#[test]
fn a_model_without_a_script_rests() {
    let place = Place::new();
    let said = place.ok(&format!("headless sphere {SIZE} --frames 3 --out rest"));
    assert!(said.contains("3 frame(s)"), "{said}");
    let report = place.json("rest/report.json");
    let still = pictures(&place, "rest");
    assert!(still.len() == 3 && still.iter().all(|p| p.1 == still[0].1));
    assert!(list(&report["edits"]).is_empty());
    assert_eq!(count(&report["frames"][2]["counters"]["particles_awake"]), 0);
    place.ok(&format!("headless beam --animation bend {SIZE} --frames 40 --out moves"));
    let moving = pictures(&place, "moves");
    assert!(moving.len() == 40 && moving[0].1 != moving[39].1);
    place.ok("headless sphere --size 16x12 --out one");
    assert_eq!(files_in(&place.path("one")), ["frame-0000.png", "report.json"]);
}

#[test]
fn a_shorter_run_tells_of_the_pictures_that_a_longer_one_has_left() {
    let place = Place::new();
    let run = |frames: usize| place.run(&format!("headless sphere --size 16x12 --frames {frames} --out one"));
    let words = "frame-0001.png and those after it are an earlier run's";
    assert!(!run(3).stderr.contains(words));
    let shorter = run(1);
    assert!(shorter.code == 0 && shorter.stderr.contains(words), "{}", shorter.stderr);
    assert_eq!(files_in(&place.path("one")).len(), 4, "and takes nothing away");
    // what cannot be written is told of before anything is drawn
    std::fs::create_dir_all(place.path("taken/report.json")).unwrap();
    place.fails("headless sphere --size 16x12 --out taken", 1, &["cannot write", "report.json"]);
    assert_eq!(files_in(&place.path("taken")), ["report.json"]);
}

#[test]
fn a_script_names_its_model_beside_itself_and_the_command_line_wins() {
    let place = Place::new();
    std::fs::create_dir(place.path("deep")).unwrap();
    place.ok("generate sphere --faces 200 --out deep/ball.glb");
    place.write("deep/script.toml", "model = \"ball.glb\"\nframes = 1\n");
    assert!(place.ok("headless --script deep/script.toml --size 16x16 --out a").contains("ball.glb"));
    assert!(place.ok("headless beam --script deep/script.toml --size 16x16 --out b").starts_with("beam"));
    let hash = |out: &str| place.json(&format!("{out}/report.json"))["edit_hash"].clone();
    assert_ne!(hash("a"), hash("b"));
    place.ok("headless beam --script deep/script.toml --seed 9 --size 16x16 --out c");
    assert_ne!(hash("b"), hash("c"), "another seed, other particles");
}

#[test]
fn the_bundled_scripts_play() {
    let place = Place::new();
    for name in ["demo", "beam"] {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/scripts");
        place.ok(&format!("headless --script {file}/{name}.toml --frames 2 --size 32x24 --out {name}"));
    }
}

#[test]
fn scripts_that_cannot_be_played() {
    let place = Place::new();
    let tear_without = TEAR.replace("poses", "path");
    for (text, words) in [
        ("model = \"beam\"\nspeeed = 2.0\n", &["line 2", "speeed"][..]),
        ("model = \"beam\"\n[camera]\neye = [0, 0, 1]\nzoom = 2\n", &["line 4", "zoom"]),
        ("model = \"beam\"\n[[action]]\nkind = \"slice\"\nat = 0.0\n", &["line 3", "slice", "squeeze"]),
        ("model = \"beam\"\n[[action]]\nkind = \"undo\"\nat = 0.0\nlayer = \"boxes\"\n", &["line 5", "layer"]),
        ("model = \"beam\"\n[[action]]\nkind = \"cut\"\nat = 0.0\nplane = [0, 0, 0, 1]\n", &["line 5", "normal"]),
        ("model = \"beam\"\n[[action]]\nkind = \"cut\"\nat = 0.0\n", &["line 2", "plane"]),
        ("model = \"beam\"\n[tear]\nwidth = -1\n", &["line 3", "width"]),
        ("model = \"beam\"\nstep = nan\n", &["line 2", "step"]),
        (
            "model = \"beam\"\n[[action]]\nkind = \"poke\"\nat = 0\nuntil = 1\nradius = 1e9\npath = [{ t = 0, at = [0,0,0] }]\n",
            &["line 2", "radius = 1e9", "diagonal"],
        ),
        ("model = \"beam\"\nframes = 0\n", &["line 2", "frames"]),
        ("model = \"beam\"\nanimation = \"walk\"\n", &["walk", "bend"]),
        ("model = \"nothing.glb\"\n", &["nothing.glb"]),
        ("frames = 1\n", &["no model"]),
        ("model = \"beam\"\n[particles]\nspacing = 0.1\nradius = 0.05\n", &["line 4", "radius"]),
        ("model = beam\n", &["line 1"]),
        (&format!("model = \"beam\"\n{tear_without}"), &["line 7", "base"]),
        (&format!("model = \"beam\"\n[tear]\nwall = \"ajar\"\n{TEAR}"), &["line 3", "ajar"]),
        (&format!("model = \"beam\"\n[tear]\nwidth = 0\nwall = \"closed\"\n{TEAR}"), &["wall", "width = 0", "two sheets"]),
    ] {
        place.write("bad.toml", text);
        let mut all = words.to_vec();
        if !text.starts_with("frames") && !text.contains("walk") && !text.contains("nothing") {
            all.push("bad.toml");
        }
        place.refused("headless --script bad.toml --size 8x8 --out bad", &all);
    }
    place.refused("headless --script none.toml --out bad", &["none.toml"]);
    for size in ["0x8", "8", "axb", "8x-8", "99999x8"] {
        place.refused(&format!("headless sphere --size {size} --out bad"), &["--size", size, "640x480"]);
    }
    for frames in ["0", "-1", "some"] {
        place.refused(&format!("headless sphere --frames {frames} --out bad"), &["--frames", frames]);
    }
    place.refused("headless --out bad", &["no model"]);
    place.refused("headless sphere", &["--out"]);
    assert!(!place.path("bad").exists(), "nothing is written for bad input");
}
