//! inspect, generate, particles, and help.

use super::files::{Gltf, TETRAHEDRON, tetrahedron_stl};
use super::support::{Is, Place, close, count, has, list, number, point};

#[test]
fn every_sub_command_has_help() {
    let place = Place::new();
    for command in ["", "inspect", "cut", "tear", "particles", "generate", "bench"] {
        let help = place.ok(&format!("{command} --help"));
        assert!(help.contains("Usage: incise"), "{help}");
    }
    if cfg!(feature = "gpu") {
        assert!(place.ok("headless --help").contains("--script"));
    }
    assert!(place.ok("--version").starts_with("incise "));
    for wrong in ["inspect beam --jsn", "cut beam --nonsense", "nonsense", "inspect", "inspect beam heart", "--nonsense"] {
        let ran = place.run(wrong);
        assert_eq!((ran.code, ran.stdout.as_str()), (2, ""), "incise {wrong}");
        assert!(ran.stderr.starts_with("error: "), "{}", ran.stderr);
    }
}

#[test]
fn inspect_has_every_key() {
    let place = Place::new();
    for (name, faces, components, animation) in
        [("sphere", 768, 1, None), ("beam", 2816, 1, Some("bend")), ("heart", 18096, 2, Some("beat"))]
    {
        let found = place.ok_json(&format!("inspect {name}"));
        has(
            &found,
            &[
                (Is::Count, &["vertices_stored", "vertices_welded", "faces", "components", "boundary_edges"]),
                (Is::Count, &["non_manifold_edges", "degenerate_faces", "duplicate_faces", "joints", "skins"]),
                (Is::Flag, &["closed"]),
                (Is::Number, &["area", "volume"]),
                (Is::Object, &["bounds"]),
                (Is::List, &["animations", "materials", "warnings"]),
            ],
        );
        has(&found["bounds"], &[(Is::List, &["min", "max"]), (Is::Number, &["diagonal"])]);
        let (min, max) = (point(&found["bounds"]["min"]), point(&found["bounds"]["max"]));
        close(number(&found["bounds"]["diagonal"]), (0..3).map(|k| (max[k] - min[k]).powi(2)).sum::<f64>().sqrt(), 1e-12);
        assert_eq!((count(&found["faces"]), count(&found["components"])), (faces, components));
        assert_eq!(found["closed"], true);
        assert_eq!(list(&found["animations"]).first().and_then(|a| a["name"].as_str()), animation);
        for animation in list(&found["animations"]) {
            has(animation, &[(Is::Text, &["name"]), (Is::Number, &["duration"])]);
        }
        let text = place.ok(&format!("inspect {name}"));
        assert!(text.contains(&format!("{faces} in {components} component")), "{text}");
    }
}

#[test]
fn the_generated_sphere_is_the_papers() {
    let place = Place::new();
    assert_eq!(place.ok("generate sphere --out sphere.glb").trim(), "sphere.glb");
    let found = place.ok_json("inspect sphere.glb");
    assert_eq!((count(&found["vertices_stored"]), count(&found["faces"])), (515, 768));
    let stored = std::fs::read(place.path("sphere.glb")).unwrap();
    assert_eq!(stored, include_bytes!("../../assets/models/sphere.glb"), "generate writes what is bundled");
}

#[test]
fn faces_steers_every_generator() {
    let place = Place::new();
    for name in ["sphere", "beam", "heart"] {
        place.ok(&format!("generate {name} --faces 5000 --out deep/er/{name}.glb"));
        let found = place.ok_json(&format!("inspect deep/er/{name}.glb"));
        close(count(&found["faces"]) as f64, 5000.0, 0.08);
        assert_eq!(found["closed"], true);
    }
}

#[test]
fn the_same_solid_in_every_format_measures_the_same() {
    let place = Place::new();
    place.write("solid.obj", TETRAHEDRON);
    place.write("solid.stl", tetrahedron_stl());
    let mut binary = vec![0u8; 80];
    binary.extend(4u32.to_le_bytes());
    let p = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for f in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
        binary.extend([0u8; 12]);
        binary.extend(f.iter().flat_map(|&v: &usize| p[v]).flat_map(f32::to_le_bytes));
        binary.extend([0u8; 2]);
    }
    place.write("binary.stl", binary);
    Gltf::default().write(&place);
    for file in ["solid.obj", "solid.stl", "binary.stl", "model.gltf"] {
        let found = place.ok_json(&format!("inspect {file}"));
        assert_eq!((count(&found["faces"]), count(&found["vertices_welded"])), (4, 4), "{file}: {found}");
        assert_eq!(found["closed"], true, "{file}");
        close(number(&found["volume"]), 1.0 / 6.0, 1e-7);
        close(number(&found["area"]), 1.5 + 3f64.sqrt() / 2.0, 1e-7);
        let skins = u64::from(file == "model.gltf");
        assert_eq!((count(&found["skins"]), count(&found["joints"])), (skins, skins));
    }
    // a face less: an open solid has to show
    place.write("open.obj", TETRAHEDRON.replace("f 2 3 4\n", ""));
    let open = place.ok_json("inspect open.obj");
    assert_eq!((open["closed"].as_bool(), count(&open["boundary_edges"])), (Some(false), 3));
}

#[test]
fn dropped_faces_are_counted() {
    let place = Place::new();
    place.write("odd.obj", format!("{TETRAHEDRON}f 1 3 2\nf 1 1 2\n"));
    let found = place.ok_json("inspect odd.obj");
    assert_eq!((count(&found["faces"]), found["closed"].as_bool()), (4, Some(true)));
    assert_eq!((count(&found["degenerate_faces"]), count(&found["duplicate_faces"])), (1, 1));
}

#[test]
fn winding_that_looks_wrong_is_told_before_every_edit() {
    let place = Place::new();
    place.write("inward.obj", TETRAHEDRON.replace("f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4", "f 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3"));
    place.write("mixed.obj", TETRAHEDRON.replace("f 2 3 4", "f 2 4 3"));
    place.write("right.obj", TETRAHEDRON);
    for (name, words) in [("inward", "is inside out"), ("mixed", "wound against each other at 3 edges"), ("right", "")] {
        let told = place.ok_json(&format!("inspect {name}.obj"))["warnings"].clone();
        let cut = place.run(&format!("cut {name}.obj --plane 1,0,0,0.3 --no-particles --out {name}"));
        assert_eq!(cut.code, 0, "{}", cut.stderr);
        if words.is_empty() {
            assert!(list(&told).is_empty() && cut.stderr.is_empty(), "{told} {}", cut.stderr);
        } else {
            assert!(told[0].as_str().unwrap().contains(words) && cut.stderr.contains(words), "{told} {}", cut.stderr);
        }
    }
}

#[test]
fn particles_have_every_key_and_a_map() {
    let place = Place::new();
    for (model, arguments) in
        [("beam", ""), ("sphere", "--spacing 0.2 --radius 0.4 --neighbours 0.5"), ("heart", "--animation beat --time 0.3")]
    {
        let found = place.ok_json(&format!("particles {model} {arguments} --out map.json"));
        has(&found, &[(Is::Count, &["particles", "influences", "neighbours"]), (Is::Object, &["quality", "time_ms"])]);
        has(&found["time_ms"], &[(Is::Number, &["total"])]);
        let figures: &[&str] =
            &["min_spacing_same_sheet", "min_spacing_euclidean", "coverage", "radius_ratio", "nearest_cv", "truncation_error"];
        has(&found["quality"], &[(Is::Number, figures)]);
        let map = place.json("map.json");
        check_map(&map);
        assert_eq!(list(&map["particles"]).len() as u64, count(&found["particles"]));
        assert_eq!(list(&map["influences"]).len() as u64, count(&found["influences"]));
        assert_eq!(list(&map["neighbours"]).len() as u64, count(&found["neighbours"]));
        assert!(list(&map["strips"]).is_empty());
        let welded = count(&place.ok_json(&format!("inspect {model}"))["vertices_welded"]);
        assert_eq!(list(&map["vertices"]).len() as u64, welded);
    }
    let about = count(&place.ok_json("particles heart")["particles"]);
    assert!((150..=250).contains(&about), "about 200 particles: {about}");
}

#[test]
fn the_sampling_depends_on_its_seed_alone() {
    let place = Place::new();
    let map = |arguments: &str, name: &str| {
        place.ok(&format!("particles beam {arguments} --out {name}"));
        place.read(name)
    };
    let first = map("--seed 7", "a.json");
    assert_eq!(first, map("--seed 7", "b.json"));
    assert_ne!(first, map("--seed 8", "c.json"));
    place.run_with("particles beam --seed 7 --out one.json", &[("RAYON_NUM_THREADS", "1")]);
    assert_eq!(first, place.read("one.json"));
}

/// Shapes, ranges and normalisation of a particle map.
pub fn check_map(map: &serde_json::Value) {
    has(map, &[(Is::List, &["particles", "vertices", "influences", "neighbours", "strips"])]);
    let vertices: Vec<[f64; 3]> = list(&map["vertices"]).iter().map(point).collect();
    let particles = list(&map["particles"]);
    let mut reached = vec![0.0; vertices.len()];
    for particle in particles {
        let vertex = count(&particle["vertex"]) as usize;
        assert!((0..3).all(|k| (vertices[vertex][k] - point(&particle["anchor"])[k]).abs() < 1e-12), "an anchor is its vertex");
    }
    for influence in list(&map["influences"]) {
        let weight = number(&influence["weight"]);
        assert!(weight > 0.0 && weight < 1.0 + 1e-6, "{influence}");
        assert!((count(&influence["particle"]) as usize) < particles.len());
        reached[count(&influence["vertex"]) as usize] += weight;
    }
    // a vertex that no particle reaches stays with the pose
    assert!(reached.iter().all(|&sum| sum == 0.0 || (sum - 1.0).abs() < 1e-6), "normalised");
    assert!(reached.iter().filter(|&&sum| sum > 0.0).count() * 10 > vertices.len() * 9, "nearly all are reached");
    let mut pairs = std::collections::BTreeSet::new();
    for link in list(&map["neighbours"]) {
        let (a, b) = (count(&link["a"]), count(&link["b"]));
        assert!(a != b && (a.max(b) as usize) < particles.len() && number(&link["weight"]) > 0.0, "{link}");
        assert!(pairs.insert((a.min(b), a.max(b))), "{link} is listed twice");
    }
    for strip in list(&map["strips"]) {
        assert_eq!(list(&strip["corners"]).iter().map(point).count(), 4);
    }
}
