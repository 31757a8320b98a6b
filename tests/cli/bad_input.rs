//! What is refused, and with which words.

use super::files::{ACROSS_THE_BEAM, Gltf, TETRAHEDRON};
use super::support::Place;

#[test]
fn no_file_is_written_twice() {
    let place = Place::new();
    place.write("path.json", ACROSS_THE_BEAM);
    place.refused("tear beam --path path.json --width 0.01 --out t.obj --boxes t.obj", &["--boxes", "t.obj"]);
    assert!(!place.path("t.obj").exists());
}

#[test]
fn models_that_cannot_be_read() {
    let place = Place::new();
    let beam = include_bytes!("../../assets/models/beam.glb");
    for ending in ["glb", "gltf", "obj", "stl"] {
        place.write(&format!("empty.{ending}"), "");
        place.refused(&format!("inspect empty.{ending}"), &[&format!("empty.{ending}: "), "is empty"]);
    }
    place.write("cut-off.glb", &beam[..beam.len() / 2]);
    place.refused("inspect cut-off.glb --json", &["cut-off.glb: ", "truncated"]);
    place.write("cut-off.stl", {
        let mut bytes = vec![0u8; 80];
        bytes.extend(4u32.to_le_bytes());
        bytes.extend([0u8; 70]);
        bytes
    });
    place.refused("inspect cut-off.stl", &["cut-off.stl: ", "truncated"]);
    place.refused("inspect no-such.glb", &["no-such.glb", "beam, heart, sphere"]);
    place.refused("inspect liver", &["\"liver\"", "beam, heart, sphere"]);
    place.write("model.txt", TETRAHEDRON);
    place.refused("inspect model.txt", &["model.txt", ".glb, .gltf, .obj or .stl"]);
    std::fs::create_dir(place.path("folder.obj")).unwrap();
    place.refused("inspect folder.obj", &["\"folder.obj\" is a folder"]);
    place.write("noise.gltf", "{ not json");
    place.refused("inspect noise.gltf", &["noise.gltf: ", "not valid glTF"]);
    place.write("points.obj", "v 0 0 0\nv 1 0 0\n");
    place.refused("inspect points.obj", &["points.obj: ", "no faces"]);
    for command in ["cut empty.obj --plane 1,0,0,0 --out d", "particles empty.obj"] {
        place.refused(command, &["empty.obj: ", "is empty"]);
    }
}

#[test]
fn models_whose_numbers_make_no_sense() {
    let place = Place::new();
    Gltf { with_buffer: false, ..Gltf::default() }.write(&place);
    place.refused("inspect model.gltf", &["model.gltf: ", "buffer 0 is missing", "model.bin"]);
    Gltf { indices: vec![0, 2, 1, 0, 1, 9], ..Gltf::default() }.write(&place);
    place.refused("inspect model.gltf", &["model.gltf: ", "9", "only 4"]);
    let mut nan = Gltf::default();
    nan.positions[2][1] = f32::NAN;
    nan.write(&place);
    place.refused("inspect model.gltf", &["model.gltf: ", "not a finite number"]);
    let mut loose = Gltf::default();
    loose.weights[1] = [0.0; 4];
    loose.write(&place);
    place.refused("inspect model.gltf", &["model.gltf: ", "weights of vertex 1", "sum to 0"]);
    let mut boneless = Gltf::default();
    boneless.joints[3][0] = 5;
    boneless.write(&place);
    place.refused("inspect model.gltf", &["model.gltf: ", "joint", "5"]);
    place.write("far.obj", TETRAHEDRON.replace("f 2 3 4", "f 2 3 77"));
    place.refused("inspect far.obj", &["far.obj: ", "77", "only 4"]);
    for bad in ["nan", "inf", "1e300"] {
        place.write("bad.obj", TETRAHEDRON.replace("v 1 0 0", &format!("v {bad} 0 0")));
        place.refused("inspect bad.obj", &["bad.obj: ", "line 2", "not finite, or is beyond 3.4e38"]);
    }
    // nothing is wrong with it unspoilt
    Gltf::default().write(&place);
    place.ok("inspect model.gltf");
}

#[test]
fn planes_that_are_none() {
    let place = Place::new();
    for (plane, words) in [
        ("0,0,0,1", "normal is zero"),
        ("-0,0,0.0,1", "normal is zero"),
        ("1,2,3", "four numbers"),
        ("1,2,3,4,5", "four numbers"),
        ("1,,3,4", "four numbers"),
        ("x,y,z,d", "four numbers"),
        ("NaN,0,1,0", "finite"),
        ("0,0,1,inf", "finite"),
    ] {
        place.refused(&format!("cut sphere --plane {plane} --out d"), &["--plane", plane, words, "0,1,0,0.05"]);
    }
    assert!(!place.path("d").exists(), "nothing is written for bad input");
    for (bounded, words) in [
        ("0,0,0,1,0,0", "nine or twelve"),
        ("0,0,0,1,0,0,1,0,NaN", "finite"),
        ("0,0,0,1,0,0,2,0,0", "convex"),
        ("0,0,0,1,0,0,2,0,1,one", "numbers"),
    ] {
        place.refused(&format!("cut sphere --plane 0,1,0,0 --bounded {bounded} --out d"), &["--bounded", bounded, words]);
    }
    place.refused("cut sphere --out d", &["--plane"]);
    place.refused("cut sphere --plane 1,0,0,0", &["--out"]);
}

#[test]
fn widths_and_walls() {
    let place = Place::new();
    place.write("path.json", ACROSS_THE_BEAM);
    for width in ["-0.01", "NaN", "inf"] {
        place.refused(&format!("tear beam --path path.json --width {width} --out t.glb"), &["--width", width, "0 or more"]);
    }
    place.refused("tear beam --path path.json --width 1e3 --out t.glb", &["--width", "diagonal"]);
    place.refused("tear beam --path path.json --width wide --out t.glb", &["--width", "wide"]);
    place.refused("tear beam --path path.json --out t.glb", &["--width"]);
    place
        .refused("tear beam --path path.json --width 0 --wall closed --out t.glb", &["--wall closed", "--width 0", "two sheets"]);
    place.refused("tear beam --path path.json --width 0.01 --wall ajar --out t.glb", &["--wall", "ajar"]);
    place.refused("tear beam --path path.json --width 0.01 --no-particles --map-out m.json --out t.glb", &["--map-out"]);
    place.refused("tear beam --path path.json --width=-inf --out t.glb", &["--width -inf", "0 or more"]);
    assert!(!place.path("t.glb").exists());
}

#[test]
fn paths_that_are_none() {
    let place = Place::new();
    let pose = |t: &str, x: &str| format!(r#"{{"t":{t},"tip":[{x},0,0],"base":[{x},1,0]}}"#);
    let path = |poses: &[String]| format!(r#"{{"poses":[{}]}}"#, poses.join(","));
    for (text, words) in [
        (path(&[]), "0 pose(s)"),
        (path(&[pose("0", "0")]), "1 pose(s)"),
        (path(&[pose("0", "0"), pose("1", "0")]), "coincide"),
        (path(&[pose("1", "0"), pose("0", "1")]), "earlier"),
        (path(&[pose("0", "0"), pose("1", "1e300")]), "finite"),
        (path(&[pose("0", "0"), r#"{"t":1,"tip":[1,2,3],"base":[1,2,3]}"#.into()]), "tip on its base"),
        (path(&[pose("0", "0"), pose("1", "1").replace("base", "bass")]), "bass"),
        (path(&[pose("0", "0"), pose("1", "1")]).replace("poses", "places"), "places"),
        (path(&[pose("0", "0"), pose("1", "1").replace(",0]", "]")]), "JSON"),
        (path(&[pose("0", "NaN"), pose("1", "1")]), "JSON"),
        (path(&[pose("0", "0"), pose("1", "1").replace("\"t\"", "\"time\":0,\"t\"")]), "time"),
        ("no json at all".into(), "JSON"),
        (String::new(), "JSON"),
        ("[1,2]".into(), "JSON"),
    ] {
        place.write("path.json", &text);
        place.refused("tear beam --path path.json --width 0.01 --out t.glb", &["path.json", words]);
    }
    place.refused("tear beam --path none.json --width 0.01 --out t.glb", &["none.json"]);
    place.write("path.json", path(&[pose("0", "0"), pose("1", "1")]));
    place.ok("tear beam --path path.json --width 0.01 --out t.glb");
}

#[test]
fn poses_and_particles() {
    let place = Place::new();
    place.refused("cut beam --plane 1,0,0,0 --animation walk --out d", &["no animation \"walk\"", "bend"]);
    place.refused("cut sphere --plane 1,0,0,0 --animation walk --out d", &["no animation \"walk\"", "has none"]);
    place.refused("particles beam --animation bend --time NaN", &["--time", "finite"]);
    for spacing in ["-0.1", "NaN", "0", "inf"] {
        place.refused(&format!("particles beam --spacing {spacing}"), &["spacing", spacing, "above 0"]);
        place.refused(&format!("cut beam --plane 1,0,0,0 --out d --spacing {spacing}"), &["spacing", spacing, "above 0"]);
    }
    place.refused("particles beam --spacing 0.1 --radius 0.1", &["radius", "above the spacing"]);
    place.refused("particles beam --spacing 0.1 --radius -1", &["radius", "-1", "above 0"]);
    place.refused("particles beam --neighbours NaN", &["neighbours", "NaN"]);
    place.refused("particles beam --seed -1", &["'-1'", "--seed"]);
    let warned = place.run("particles beam --spacing 0.1 --radius 0.12 --json");
    assert!(warned.code == 0 && warned.stderr.contains("1.5 times"), "{}", warned.stderr);
    let still = place.run("particles beam --time 0.5");
    assert!(still.code == 0 && still.stderr.contains("without --animation"), "{}", still.stderr);
}

#[test]
fn generators() {
    let place = Place::new();
    place.refused("generate liver --out l.glb", &["\"liver\"", "beam, heart, sphere"]);
    for faces in ["0", "-5", "many"] {
        place.refused(&format!("generate beam --faces {faces} --out b.glb"), &["--faces", faces]);
    }
    place.refused("generate beam --faces 99999999999 --out b.glb", &["99999999999", "20000000"]);
    place.refused("generate beam --out beam.obj", &["beam.obj", ".glb"]);
}

#[test]
fn places_that_cannot_be_written_fail_the_run() {
    let place = Place::new();
    place.write("file", "in the way");
    place.write("path.json", ACROSS_THE_BEAM);
    place.fails("generate sphere --out file/s.glb", 1, &["cannot", "file"]);
    place.fails("cut sphere --plane 1,0,0,0 --out file/d", 1, &["cannot", "file/d"]);
    place.fails("tear beam --path path.json --width 0.01 --out file/t.glb", 1, &["cannot", "file"]);
    place.fails("particles sphere --out file/m.json", 1, &["cannot", "file"]);
    std::fs::create_dir(place.path("taken.glb")).unwrap();
    place.fails("generate sphere --out taken.glb", 1, &["cannot write taken.glb"]);
    if cfg!(feature = "gpu") {
        place.fails("headless sphere --size 8x8 --out file", 1, &["cannot", "file"]);
    }
}

#[test]
fn settings_that_are_no_file() {
    let place = Place::new();
    std::fs::create_dir(place.path("config.toml")).unwrap();
    place.refused("inspect beam", &["config.toml"]);
    #[cfg(unix)]
    {
        let place = Place::new();
        std::os::unix::fs::symlink("nowhere", place.path("config.toml")).unwrap();
        place.refused("inspect beam", &["config.toml"]);
    }
}
