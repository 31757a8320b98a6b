//! cut and tear.

use super::files::{ACROSS_THE_BEAM, Gltf, PAST_THE_BEAM, TETRAHEDRON, THROUGH_THE_BEAM};
use super::models::check_map;
use super::support::{Is, Place, close, count, files_in, has, list, number};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The keys that every edit has.
pub fn check_edit(edit: &Value) {
    has(
        edit,
        &[
            (Is::Text, &["outcome"]),
            (Is::Count, &["vertices", "faces", "new_vertices", "promoted_vertices", "intersection_points"]),
            (Is::Count, &["max_row_entries", "faces_visited", "bytes_uploaded"]),
            (Is::Number, &["area_before", "volume_before"]),
            (Is::List, &["pieces"]),
            (Is::Object, &["time_ms"]),
        ],
    );
    has(&edit["time_ms"], &[(Is::Number, &["total"])]);
    for piece in list(&edit["pieces"]) {
        has(
            piece,
            &[
                (Is::Count, &["faces", "boundary_edges", "non_manifold_edges", "degenerate_faces"]),
                (Is::Number, &["area", "volume"]),
                (Is::Flag, &["closed"]),
                (Is::MaybeText, &["side"]),
            ],
        );
    }
    assert_eq!(list(&edit["pieces"]).iter().map(|p| count(&p["faces"])).sum::<u64>(), count(&edit["faces"]));
}

fn check_tear(edit: &Value) {
    check_edit(edit);
    has(edit, &[(Is::Number, &["export_deviation"])]);
    for segment in list(&edit["segments"]) {
        let rows: &[&str] = &["perform_tear", "update_particles", "disconnect_particles", "bind", "update_mesh", "total"];
        has(segment, &[(Is::Number, rows)]);
    }
}

fn areas(edit: &Value) -> f64 {
    list(&edit["pieces"]).iter().map(|p| number(&p["area"])).sum()
}

/// Cuts, and checks the report against the files that were written.
fn cut(place: &Place, model: &str, arguments: &str, ending: &str) -> Value {
    let edit = place.ok_json(&format!("cut {model} {arguments} --out pieces-{ending} --format {ending}"));
    check_edit(&edit);
    has(&edit, &[(Is::Number, &["max_plane_distance", "export_deviation"])]);
    let pieces = list(&edit["pieces"]);
    let names: Vec<String> = (0..pieces.len()).map(|i| format!("piece-{i}.{ending}")).collect();
    assert_eq!(files_in(&place.path(&format!("pieces-{ending}"))), names);
    for (name, piece) in names.iter().zip(pieces) {
        let found = place.ok_json(&format!("inspect pieces-{ending}/{name}"));
        assert_eq!(count(&found["faces"]), count(&piece["faces"]), "{model} {name}");
        assert_eq!(count(&found["boundary_edges"]), count(&piece["boundary_edges"]), "{model} {name}");
        assert_eq!(count(&found["non_manifold_edges"]), 0, "{model} {name}");
        if !arguments.contains("--time") {
            close(number(&found["area"]), number(&piece["area"]), 1e-5);
        }
    }
    edit
}

#[test]
fn a_cut_tells_of_the_pieces_that_an_earlier_one_has_left() {
    let place = Place::new();
    let cut = |offset: &str| place.run(&format!("cut sphere --plane 0,1,0,{offset} --no-particles --out pieces"));
    let words = "piece-1.glb and those after it are an earlier run's";
    assert!(!cut("0").stderr.contains(words));
    let missed = cut("10");
    assert!(missed.code == 0 && missed.stderr.contains(words), "{}", missed.stderr);
    assert_eq!(files_in(&place.path("pieces")), ["piece-0.glb", "piece-1.glb"]);
}

#[test]
fn cuts_add_up_and_their_pieces_come_in_order() {
    for (model, arguments, pieces) in [
        ("beam", "--plane 1,0.15,0.1,0.12", 2),
        ("beam", "--plane 1,0.15,0.1,0.12 --animation bend --time 0.7", 2),
        ("sphere", "--plane -1,2,0.5,0.1 --no-particles", 2),
        ("heart", "--plane 1,0.1,0,0 --animation beat --time 0.3", 4),
    ] {
        let place = Place::new();
        let edit = cut(&place, model, arguments, "glb");
        assert_eq!((edit["outcome"].as_str(), list(&edit["pieces"]).len()), (Some("cut"), pieces), "{model}");
        let whole = number(&edit["area_before"]);
        close(areas(&edit), whole, 1e-6);
        assert!(number(&list(&edit["pieces"])[0]["area"]) < 0.9 * whole, "one piece alone is not the whole");
        let diagonal = number(&place.ok_json(&format!("inspect {model}"))["bounds"]["diagonal"]);
        assert!(number(&edit["max_plane_distance"]) < 1e-6 * diagonal, "{edit}");
        assert!(count(&edit["new_vertices"]) > 0 && count(&edit["max_row_entries"]) <= 3);
        let key = |p: &Value| (p["side"] == "negative", -number(&p["area"]));
        let keys: Vec<_> = list(&edit["pieces"]).iter().map(key).collect();
        assert!(keys.is_sorted_by(|a, b| a <= b), "positive first, then the larger: {keys:?}");
        assert!(keys[0].0 != keys[pieces - 1].0, "both sides are there");
    }
}

#[test]
fn obj_pieces_hold_the_given_pose() {
    let place = Place::new();
    let arguments = "--plane 1,0,0,0.12 --animation bend --time 0.7";
    let edit = cut(&place, "beam", arguments, "obj");
    for (i, piece) in list(&edit["pieces"]).iter().enumerate() {
        let found = place.ok_json(&format!("inspect pieces-obj/piece-{i}.obj"));
        close(number(&found["area"]), number(&piece["area"]), 1e-6);
        let (low, high) = (number(&found["bounds"]["min"][0]), number(&found["bounds"]["max"][0]));
        let side = if piece["side"] == "positive" { low } else { high };
        assert!((side - 0.12).abs() < 1e-6, "it ends on the plane: {found}");
        assert_eq!(count(&found["joints"]), 0);
    }
}

#[test]
fn the_files_of_a_cut_animated_model_are_still_animated() {
    let place = Place::new();
    cut(&place, "beam", "--plane 1,0,0,0.12", "glb");
    for i in 0..2 {
        let found = place.ok_json(&format!("inspect pieces-glb/piece-{i}.glb"));
        assert_eq!((count(&found["joints"]), count(&found["skins"])), (3, 1));
        assert_eq!(found["animations"][0]["name"], "bend");
        let again =
            place.ok_json(&format!("cut pieces-glb/piece-{i}.glb --plane 0,0,1,0.01 --animation bend --time 0.7 --out again"));
        assert_eq!(again["outcome"], "cut");
        close(areas(&again), number(&again["area_before"]), 1e-6);
    }
}

#[test]
fn a_plane_that_misses_changes_nothing() {
    for ending in ["glb", "obj"] {
        let place = Place::new();
        let edit = cut(&place, "beam", "--plane -1,0,0,9", ending);
        let whole = place.ok_json("inspect beam");
        assert_eq!(edit["outcome"], "missed");
        assert_eq!((count(&edit["faces"]), count(&edit["vertices"])), (2816, count(&whole["vertices_welded"])));
        assert_eq!((list(&edit["pieces"]).len(), count(&edit["new_vertices"])), (1, 0));
        let piece = place.ok_json(&format!("inspect pieces-{ending}/piece-0.{ending}"));
        assert_eq!(piece["vertices_welded"], whole["vertices_welded"]);
        close(number(&piece["area"]), number(&whole["area"]), 1e-6);
    }
}

#[test]
fn capped_pieces_are_closed_in_the_report_and_in_the_files() {
    let place = Place::new();
    for ending in ["glb", "obj"] {
        let edit = cut(&place, "heart", "--plane 0,1,0.15,0.01 --cap --no-particles", ending);
        assert_eq!((list(&edit["pieces"]).len(), count(&edit["caps"]["loops"])), (2, 4));
        assert!(list(&edit["pieces"]).iter().all(|p| p["closed"] == true));
        let sum: f64 = list(&edit["pieces"]).iter().map(|p| number(&p["volume"])).sum();
        close(sum, number(&edit["volume_before"]), 1e-6);
        for i in 0..2 {
            let piece = place.ok_json(&format!("inspect pieces-{ending}/piece-{i}.{ending}"));
            assert_eq!(piece["closed"], true, "piece-{i}.{ending}");
        }
    }
    // the twin: without --cap both stay open
    let open = cut(&place, "heart", "--plane 0,1,0.15,0.01 --no-particles", "glb");
    assert!(list(&open["pieces"]).iter().all(|p| p["closed"] == false));
}

#[test]
fn the_pieces_of_a_model_far_away_add_up_in_the_files() {
    let place = Place::new();
    place.ok("cut sphere --plane 0,1,0,-100 --no-particles --format obj --out near");
    let moved = |line: &str| match line.strip_prefix("v ") {
        Some(numbers) => {
            let mut at = numbers.split(' ').zip([2000.0, -4000.0, 1000.0]).map(|(x, by)| x.parse::<f64>().unwrap() + by);
            format!("v {} {} {}\n", at.next().unwrap(), at.next().unwrap(), at.next().unwrap())
        }
        None => format!("{line}\n"),
    };
    place.write("far.obj", place.read("near/piece-0.obj").lines().map(moved).collect::<String>());
    let far = place.ok_json("cut far.obj --plane 0.2,1,0.1,-3499.9 --cap --no-particles --out far");
    assert!(number(&far["export_deviation"]) < 1e-7, "{far:#}");
    let volumes = [0, 1].map(|k| number(&place.ok_json(&format!("inspect far/piece-{k}.glb"))["volume"]));
    assert!(volumes.iter().all(|&v| v > 0.0));
    close(volumes.iter().sum(), number(&far["volume_before"]), 1e-6);
}

#[test]
fn a_posed_beam_is_torn_and_stays_rigged() {
    let place = Place::new();
    place.write("path.json", ACROSS_THE_BEAM);
    let edit = place.ok_json(
        "tear beam --path path.json --width 0.004 --animation bend --time 0.7 --out torn.glb --boxes boxes.obj --map-out map.json",
    );
    check_tear(&edit);
    assert_eq!((edit["outcome"].as_str(), list(&edit["pieces"]).len()), (Some("torn"), 1));
    assert!(!list(&edit["segments"]).is_empty() && count(&edit["max_row_entries"]) <= 3);
    let removed = number(&edit["area_removed"]);
    assert!(removed > 0.0);
    close(areas(&edit) + removed, number(&edit["area_before"]), 1e-6);
    let piece = &edit["pieces"][0];
    let found = place.ok_json("inspect torn.glb");
    assert_eq!((count(&found["joints"]), count(&found["skins"])), (3, 1));
    assert_eq!((found["animations"][0]["name"].as_str(), found["animations"][0]["duration"].as_f64()), (Some("bend"), Some(2.0)));
    assert_eq!((count(&found["non_manifold_edges"]), count(&found["components"])), (0, 1));
    assert!(count(&found["boundary_edges"]) > 0);
    for key in ["faces", "boundary_edges"] {
        assert_eq!(found[key], piece[key], "{key}");
    }
    check_boxes(&place.read("boxes.obj"), list(&edit["segments"]).len());
    let map = place.json("map.json");
    check_map(&map);
    assert!(!list(&map["strips"]).is_empty());
    assert_eq!(list(&map["vertices"]).len() as u64, count(&edit["vertices"]));
}

/// Boxes are named, closed, outward, and given with 17 digits.
fn check_boxes(text: &str, at_least: usize) {
    let mut points: Vec<[f64; 3]> = Vec::new();
    let mut boxes: BTreeMap<String, Vec<[usize; 3]>> = BTreeMap::new();
    let mut name = String::new();
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["o", object] => name = object.to_string(),
            ["v", x, y, z] => points.push([x, y, z].map(|w| w.parse().unwrap())),
            ["f", a, b, c] => {
                boxes
                    .entry(name.clone())
                    .or_default()
                    .push([a, b, c].map(|w| w.split('/').next().unwrap().parse::<usize>().unwrap() - 1));
            }
            ["f", ..] => panic!("{line} is no triangle"),
            _ => {}
        }
    }
    assert!(boxes.len() >= at_least, "{} boxes for {at_least} segments", boxes.len());
    assert!(boxes.contains_key("chain0_box0"), "{:?}", boxes.keys());
    for (name, faces) in &boxes {
        let (chain, index) = name.strip_prefix("chain").and_then(|n| n.split_once("_box")).unwrap();
        assert!(chain.parse::<u32>().is_ok() && index.parse::<u32>().is_ok(), "{name}");
        let edges: Vec<(usize, usize)> = faces.iter().flat_map(|f| (0..3).map(move |k| (f[k], f[(k + 1) % 3]))).collect();
        assert!(edges.iter().all(|&(a, b)| edges.iter().filter(|&&e| e == (b, a)).count() == 1), "{name} is closed");
        let volume = |f: &[usize; 3]| {
            let [a, b, c] = f.map(|v| glam::DVec3::from(points[v]));
            a.dot(b.cross(c)) / 6.0
        };
        assert!(faces.iter().map(volume).sum::<f64>() > 0.0, "{name} faces outward");
    }
    let longest = text.lines().filter(|l| l.starts_with("v ")).flat_map(|l| l.split(' ')).map(|w| w.split('e').next().unwrap());
    let digits = |w: &str| w.trim_start_matches(['-', '0', '.']).bytes().filter(u8::is_ascii_digit).count();
    assert!(longest.map(digits).max() >= Some(16), "17 significant digits");
}

/// Opened edges lie on top of one another, so what is written has to keep them apart.
#[test]
fn width_zero_takes_nothing_out_and_stays_open_in_files() {
    let place = Place::new();
    place.write("path.json", ACROSS_THE_BEAM);
    let whole = place.ok_json("inspect beam");
    for (ending, more) in [("glb", "--map-out map.json"), ("obj", "--no-particles")] {
        let edit = place.ok_json(&format!("tear beam --path path.json --width 0 --out slit.{ending} --boxes strips.obj {more}"));
        check_tear(&edit);
        assert_eq!((edit["outcome"].as_str(), list(&edit["pieces"]).len()), (Some("torn"), 1));
        assert_eq!(number(&edit["area_removed"]), 0.0);
        assert!((1e-9..0.8).contains(&number(&edit["smallest_angle"])), "{}", edit["smallest_angle"]);
        close(areas(&edit), number(&edit["area_before"]), 1e-12);
        let found = place.ok_json(&format!("inspect slit.{ending}"));
        assert_eq!((count(&found["non_manifold_edges"]), count(&found["components"])), (0, 1));
        assert!(count(&found["boundary_edges"]) >= 2 + count(&whole["boundary_edges"]));
        assert_eq!(found["boundary_edges"], edit["pieces"][0]["boundary_edges"], "{ending}");
        let strips = place.read("strips.obj");
        let count_of = |start: &str| strips.lines().filter(|l| l.starts_with(start)).count();
        assert_eq!((count_of("v "), count_of("f ")), (4 * count_of("o chain"), 2 * count_of("o chain")));
        assert!(count_of("o chain0_slit") > 0 && count_of("o chain") >= list(&edit["segments"]).len());
    }
    let map = place.json("map.json");
    check_map(&map);
    assert!(!list(&map["strips"]).is_empty());
    place.write("path.json", THROUGH_THE_BEAM);
    let edit = place.ok_json("tear beam --path path.json --width 0 --out torn.glb");
    assert_eq!((edit["outcome"].as_str(), list(&edit["pieces"]).len()), (Some("severed"), 2));
    close(areas(&edit), number(&edit["area_before"]), 1e-12);
    assert_eq!(count(&place.ok_json("inspect torn.glb")["components"]), 2);
}

/// The blade's tip and its other end go along in the skin, and every strip ends there at one point: without a bound each of them cuts
/// all slivers that the ones before have left there in two.
#[test]
fn a_blade_whose_tip_goes_along_in_the_skin_leaves_the_model_in_proportion() {
    let place = Place::new();
    let corner = |k: i32| [k & 4, k & 2, k & 1].map(|bit| if bit == 0 { "-0.5" } else { "0.5" }).join(" ");
    let corners: String = (0..8).map(|k| format!("v {}\n", corner(k))).collect();
    let faces = ["2 4 1", "5 2 1", "1 4 3", "3 5 1", "2 8 4", "6 2 5", "6 8 2", "4 8 3", "7 5 3", "3 8 7", "7 6 5", "8 6 7"];
    let faces: String = faces.iter().map(|f| format!("f {f}\n")).collect();
    place.write("cube.obj", format!("{corners}{faces}"));
    let pose = |t: f64, tip: [f64; 3], base: [f64; 3]| serde_json::json!({ "t": t, "tip": tip, "base": base });
    // half way the faces were 4,530, and from there on half as many again with each strip
    let poses = [pose(0.0, [-0.5, 0.5, -0.5], [0.5, -0.5, -0.5]), pose(0.125, [0.0, 0.0, -0.5], [0.0, -0.5, 0.0])];
    place.write("path.json", serde_json::json!({ "poses": poses }).to_string());
    let edit = place.ok_json("tear cube.obj --path path.json --width 0 --no-particles --out torn.obj");
    check_tear(&edit);
    assert_eq!(edit["outcome"], "torn");
    assert!(count(&edit["faces"]) < 1500, "{}", edit["faces"]);
    assert!((areas(&edit) - 6.0).abs() < 1e-9, "{}", areas(&edit));
}

#[test]
fn a_bounded_cut_ends_where_the_blade_did() {
    let place = Place::new();
    let part = "cut sphere --plane 0,1,0,0.01 --bounded -9,0,0.5,9,0,0.5,9,0,9,-9,0,9";
    let edit = place.ok_json(&format!("{part} --out part"));
    assert_eq!((edit["outcome"].as_str(), list(&edit["pieces"]).len()), (Some("missed"), 1), "the sphere is smaller");
    let edit = place.ok_json("cut sphere --plane 0,1,0,0.01 --bounded -9,0,0.01,9,0,0.01,9,0,9,-9,0,9 --out part");
    assert_eq!((edit["outcome"].as_str(), list(&edit["pieces"]).len()), (Some("cut"), 1));
    close(areas(&edit), number(&edit["area_before"]), 1e-12);
    assert!(number(&edit["max_plane_distance"]) < 1e-9 && count(&edit["pieces"][0]["boundary_edges"]) > 0);
    let edit = place.ok_json("cut sphere --plane 0,1,0,0.01 --bounded -9,0,-9,9,0,-9,9,0,9,-9,0,9 --out all");
    assert_eq!((edit["outcome"].as_str(), list(&edit["pieces"]).len()), (Some("cut"), 2), "it severs");
    let sides: Vec<_> = list(&edit["pieces"]).iter().map(|p| p["side"].clone()).collect();
    assert_eq!(sides, ["positive", "negative"]);
}

#[test]
fn a_bounded_cut_gets_caps_where_it_goes_right_through() {
    let place = Place::new();
    let volumes = |edit: &Value| list(&edit["pieces"]).iter().map(|p| number(&p["volume"])).collect::<Vec<_>>();
    // whichever way round the blade's corners are given, it is the cut along the whole plane; the heart's chamber makes a hole
    let corners = ["-9,0.005,-9", "9,0.005,-9", "9,0.005,9", "-9,0.005,9"];
    let whole = place.ok_json("cut heart --plane 0.2,1,0.1,0.005 --cap --out whole");
    for turn in [[0, 1, 2, 3], [3, 2, 1, 0]] {
        let blade = turn.map(|k| corners[k]).join(",");
        let edit = place.ok_json(&format!("cut heart --plane 0.2,1,0.1,0.005 --bounded={blade} --cap --out through"));
        check_edit(&edit);
        assert_eq!((&edit["caps"], count(&edit["caps"]["loops"])), (&whole["caps"], 4), "{edit}");
        assert!(list(&edit["pieces"]).len() == 2 && list(&edit["pieces"]).iter().all(|p| p["closed"] == true), "{edit}");
        close(volumes(&edit).iter().sum(), number(&edit["volume_before"]), 1e-9);
        volumes(&edit).iter().zip(volumes(&whole)).for_each(|(&part, all)| close(part, all, 1e-9));
    }
    // it ends inside: a wound, and nothing closes it
    let ran = place.run("cut beam --plane 1,0,0,0.01 --bounded 0.01,-9,0,0.01,9,0,0.01,9,9,0.01,-9,9 --cap --out part --json");
    let edit: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert!(ran.code == 0 && ran.stderr.contains("no closed loop"), "{}", ran.stderr);
    assert!(count(&edit["caps"]["loops"]) == 0 && count(&edit["caps"]["unclosed_edges"]) > 0, "{edit}");
    assert!(list(&edit["pieces"]).len() == 1 && edit["pieces"][0]["closed"] == false, "{edit}");
}

#[test]
fn a_plane_between_two_parts_of_a_model_takes_them_apart() {
    let place = Place::new();
    let [first, second] = [0.0, 2.0].map(|x| {
        let corners = [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0], [x, 0.0, 1.0]];
        corners.map(|[x, y, z]| format!("v {x} {y} {z}\n")).concat()
    });
    let faces = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\nf 5 7 6\nf 5 6 8\nf 5 8 7\nf 6 7 8\n";
    place.write("two.obj", format!("{first}{second}{faces}"));
    for (at, outcome, sides) in [(1.5, "cut", vec!["positive", "negative"]), (3.5, "missed", vec!["negative"])] {
        let edit = place.ok_json(&format!("cut two.obj --plane 1,0,0,{at} --cap --out halves"));
        check_edit(&edit);
        let found: Vec<_> = list(&edit["pieces"]).iter().map(|p| p["side"].as_str().unwrap()).collect();
        assert_eq!((edit["outcome"].as_str(), found), (Some(outcome), sides), "{edit}");
    }
}

#[test]
fn a_cut_by_the_way_of_a_blade() {
    let place = Place::new();
    place.write("path.json", THROUGH_THE_BEAM);
    let edit = place.ok_json("cut beam --blade path.json --cap --out halves");
    check_edit(&edit);
    assert_eq!((edit["outcome"].as_str(), list(&edit["pieces"]).len()), (Some("cut"), 2));
    assert!(list(&edit["pieces"]).iter().all(|p| p["closed"] == true), "{edit}");
    place.write("past.json", PAST_THE_BEAM);
    let edit = place.ok_json("cut beam --blade past.json --out none");
    assert_eq!((edit["outcome"].as_str(), list(&edit["pieces"]).len()), (Some("missed"), 1));
    place.refused("cut beam --out none", &["--plane"]);
    place.refused("cut beam --blade nowhere.json --out none", &["nowhere.json"]);
    place.refused("cut beam --blade path.json --plane 1,0,0,0 --out none", &["--plane", "--blade"]);
}

#[test]
fn a_tear_right_through_severs() {
    let place = Place::new();
    place.write("path.json", THROUGH_THE_BEAM);
    let edit = place.ok_json("tear beam --path path.json --width 0.004 --out torn.glb");
    check_tear(&edit);
    assert_eq!((edit["outcome"].as_str(), list(&edit["pieces"]).len()), (Some("severed"), 2));
    let found = place.ok_json("inspect torn.glb");
    assert_eq!((count(&found["components"]), count(&found["faces"])), (2, count(&edit["faces"])));
    assert_eq!((count(&found["joints"]), count(&found["skins"])), (3, 1), "both pieces hang on one skeleton");
    close(areas(&edit) + number(&edit["area_removed"]), number(&edit["area_before"]), 1e-6);
}

/// A vertex of the way out is a lip of the way back, and knows its side of what was cut before that for it: whatever it holds, and
/// whoever is anchored to it, must be asked again. (The program validates itself in tests.)
#[test]
fn a_blade_that_goes_back_through_its_slit_leaves_no_link_across_it() {
    let place = Place::new();
    let there = r#""tip": [-0.05, -0.023, 0.046], "base": [-0.349, -0.102, 0.083]"#;
    let turn = r#""tip": [-0.04, -0.069, 0.028], "base": [-0.339, -0.148, 0.065]"#;
    let poses = [(0.0, there), (3.08, turn), (3.16, there)].map(|(t, at)| format!("{{\"t\": {t}, {at}}}"));
    place.write("path.json", format!("{{\"poses\": [{}]}}", poses.join(", ")));
    let edit = place.ok_json("tear beam --path path.json --width 6.235383126342517e-06 --wall closed --out torn.glb");
    assert_eq!((edit["outcome"].as_str(), count(&edit["pieces"][0]["boundary_edges"])), (Some("torn"), 0));
}

#[test]
fn a_blade_that_never_touches_changes_nothing() {
    let place = Place::new();
    place.write("path.json", PAST_THE_BEAM);
    let whole = place.ok_json("inspect beam");
    for ending in ["glb", "obj"] {
        let edit = place.ok_json(&format!("tear beam --path path.json --width 0.004 --out same.{ending} --map-out map.json"));
        check_tear(&edit);
        assert_eq!(edit["outcome"], "missed");
        assert_eq!((count(&edit["new_vertices"]), number(&edit["area_removed"])), (0, 0.0));
        let found = place.ok_json(&format!("inspect same.{ending}"));
        for key in ["faces", "vertices_welded", "closed"] {
            assert_eq!(found[key], whole[key], "{ending}: {key}");
        }
        assert!(list(&place.json("map.json")["strips"]).is_empty());
    }
}

#[test]
fn a_static_model_tears_without_particles_into_obj() {
    let place = Place::new();
    place.write("solid.obj", TETRAHEDRON);
    place.write(
        "path.json",
        r#"{"poses":[{"t":0,"tip":[0.3,0.1,-0.5],"base":[0.3,2,-0.5]},{"t":1,"tip":[0.3,0.1,1.5],"base":[0.3,2,1.5]}]}"#,
    );
    let edit = place.ok_json("tear solid.obj --path path.json --width 0.05 --no-particles --out torn.obj --wall open");
    check_tear(&edit);
    assert_eq!(edit["outcome"], "torn");
    let found = place.ok_json("inspect torn.obj");
    assert_eq!((found["faces"].as_u64(), count(&found["non_manifold_edges"])), (edit["faces"].as_u64(), 0));
    assert!(place.read("torn.obj").lines().any(|l| l.starts_with("f ")), "the ending says OBJ");
}

#[test]
fn edits_give_the_same_bits_whatever_the_thread_count() {
    let place = Place::new();
    place.write("path.json", ACROSS_THE_BEAM);
    let tear = |name: &str, time: &str, threads: &str| {
        let arguments =
            format!("tear beam --path path.json --width 0.004 --animation bend --time {time} --out {name} --map-out {name}.json");
        assert_eq!(place.run_with(&arguments, &[("RAYON_NUM_THREADS", threads)]).code, 0);
        (std::fs::read(place.path(name)).unwrap(), place.read(&format!("{name}.json")))
    };
    let one = tear("one.glb", "0.7", "1");
    assert!(one == tear("four.glb", "0.7", "4"));
    assert!(one != tear("other.glb", "0.8", "4"));
}

#[test]
fn what_is_cut_keeps_its_look() {
    let place = Place::new();
    Gltf::default().write(&place);
    let mut file = place.json("model.gltf");
    let pixel = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg==";
    let ior = json!({ "KHR_materials_ior": { "ior": 1.4 } });
    file["images"] = json!([{ "uri": format!("data:image/png;base64,{pixel}") }]);
    file["textures"] = json!([{ "source": 0 }]);
    file["materials"] = json!([{
        "name": "skin", "doubleSided": true, "normalTexture": { "index": 0, "scale": 0.5 }, "extensions": ior,
        "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.25, 1.0, 1.0], "metallicFactor": 0.25, "roughnessFactor": 0.75 },
    }]);
    file["meshes"][0]["primitives"][0]["material"] = json!(0);
    place.write("model.gltf", file.to_string());
    let edit = place.ok_json("cut model.gltf --plane 1,0,0,0.25 --cap --out pieces");
    assert_eq!(list(&edit["pieces"]).len(), 2, "{edit}");
    for piece in 0..2 {
        let bytes = std::fs::read(place.path(&format!("pieces/piece-{piece}.glb"))).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let found: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        assert_eq!(found["materials"][0], file["materials"][0]);
        let attributes = &found["meshes"][0]["primitives"][0]["attributes"];
        assert!(["TEXCOORD_0", "TANGENT"].iter().all(|a| attributes.get(a).is_some()), "{attributes}");
        let cap = &found["materials"][1];
        assert_eq!((&cap["name"], &cap["pbrMetallicRoughness"]["metallicFactor"]), (&json!("cap"), &json!(0.0)));
        assert_eq!((list(&found["images"]).len(), &found["extensionsUsed"]), (1, &json!(["KHR_materials_ior"])));
    }
}
