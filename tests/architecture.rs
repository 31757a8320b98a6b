//! The house and its arrows, read from the sources (ARCHITECTURE.md draws the same map).
//!
//! The tables below are the rules. Test-only code is exempt from the module arrows: it is no part of the library.

#[path = "architecture/source.rs"]
mod source;

use source::Source;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Everything from `geometry` up to `scene`: what a library user gets without a GPU.
const CORE: [&str; 8] = ["scene", "tissue", "formats", "particles", "physics", "rig", "surgery", "geometry"];

/// Which module may name which. Besides, a module may name itself, all but geometry may name `diagnostics`, and the
/// crate's root (lib.rs, main.rs) may name everything.
const ARROWS: [(&str, &[&str]); 16] = [
    ("geometry", &[]),
    ("diagnostics", &["geometry"]),
    ("rig", &["geometry"]),
    ("surgery", &["geometry"]),
    ("particles", &["geometry"]),
    ("physics", &["geometry"]),
    ("formats", &["rig", "geometry"]),
    ("tissue", &["formats", "particles", "physics", "rig", "surgery", "geometry"]),
    ("scene", &["tissue", "surgery", "particles", "physics", "rig", "geometry", "formats"]),
    // Tools pick on the tissues as they are seen, so they read them; scripts name the rigid shapes of physics.
    ("input", &["scene", "tissue", "physics", "surgery", "geometry"]),
    ("gpu", &["scene", "tissue", "particles", "rig", "geometry"]),
    // Plain settings of every part, handed down by those who may read them: app, host, cli.
    ("config", &["gpu", "input", "scene", "tissue", "formats", "particles", "physics", "rig", "surgery", "geometry"]),
    // The control panel: a function of plain state, so that a window and a board in the world can show the same one.
    ("panel", &["config", "input", "surgery"]),
    ("app", &["config", "gpu", "input", "CORE"]),
    // A host owns its loop and calls the app's frame, so the arrow between the two points this way.
    ("host", &["app", "panel", "config", "gpu", "input", "CORE"]),
    ("cli", &["app", "host", "config", "gpu", "input", "CORE"]),
];

/// Which crates are named in which places only (paths below `src`, a file or a folder of that name).
const CRATES: [(&str, &[&str]); 14] = [
    ("wgpu", &["gpu", "host"]),
    ("naga", &["gpu"]),
    ("openxr", &["host/vr"]),
    ("winit", &["host/desktop", "host/spectator"]),
    ("egui", &["gpu/ui", "panel", "app/panel", "host/panel"]),
    // besides the renderer, the choice of a surface format that egui can draw into
    ("egui_wgpu", &["gpu/ui", "host/desktop"]),
    ("egui_winit", &["host/desktop"]),
    ("rfd", &["host/desktop"]),
    ("rapier3d", &["physics"]),
    ("gltf", &["formats"]),
    ("gltf_json", &["formats"]),
    ("tobj", &["formats"]),
    ("stl_io", &["formats"]),
    ("clap", &["cli", "main"]),
];

/// Where `unsafe` may stand: where OpenXR and wgpu meet.
const UNSAFE: [&str; 1] = ["host/vr"];

/// "Not much over 500 lines."
const LINES: usize = 600;

/// One file below `src`: its place (`gpu/deform`, `rig` for `rig/mod.rs`, `lib`, `main`) and what it says.
struct File {
    name: String,
    place: String,
    source: Source,
}

impl File {
    fn new(name: &str, text: &str) -> Self {
        let place = name.trim_end_matches(".rs").trim_end_matches("/mod").to_string();
        Self { name: name.to_string(), place, source: source::read(text) }
    }

    fn is_root(&self) -> bool {
        matches!(self.place.as_str(), "lib" | "main")
    }

    fn modules(&self) -> Vec<String> {
        if self.is_root() { Vec::new() } else { self.place.split('/').map(String::from).collect() }
    }

    fn is_at(&self, places: &[&str]) -> bool {
        places.iter().any(|p| {
            let rest = self.place.strip_prefix(p);
            // `host/vr*`: vr.rs, vr/.., vr_session.rs
            rest.is_some_and(|r| r.is_empty() || r.starts_with('/') || r.starts_with('_'))
        })
    }
}

fn allowed(from: &str) -> Option<BTreeSet<&'static str>> {
    let (_, to) = ARROWS.iter().find(|(module, _)| *module == from)?;
    let mut set: BTreeSet<&str> = to.iter().copied().collect();
    if set.remove("CORE") {
        set.extend(CORE);
    }
    if !matches!(from, "geometry" | "diagnostics") {
        set.insert("diagnostics");
    }
    Some(set)
}

/// Resolves a path to the top-level name below the crate's root that it goes through, if it does.
fn root_name(file: &File, path: &source::Path) -> Option<String> {
    let mut module = file.modules();
    module.extend(path.inline_modules.iter().cloned());
    let mut segments = path.segments.iter().map(String::as_str).peekable();
    match *segments.peek()? {
        "crate" => {
            segments.next();
            module.clear();
        }
        "self" | "super" => {}
        _ => return None,
    }
    while let Some(&step @ ("self" | "super")) = segments.peek() {
        segments.next();
        if step == "super" {
            module.pop();
        }
    }
    if module.is_empty() { Some(segments.next().unwrap_or("*").to_string()) } else { Some(module[0].clone()) }
}

/// Every broken arrow, as a sentence each.
fn module_violations(files: &[File]) -> Vec<String> {
    let macros: BTreeMap<&str, String> = files
        .iter()
        .flat_map(|f| f.source.exported_macros.iter().map(|m| (m.as_str(), f.modules().first().cloned().unwrap_or_default())))
        .collect();
    let mut found = Vec::new();
    for file in files.iter().filter(|f| !f.is_root() && !is_test_file(f, files)) {
        let from = file.modules()[0].clone();
        let Some(allowed) = allowed(&from) else {
            found.push(format!("{}: module `{from}` has no row in ARROWS", file.name));
            continue;
        };
        for path in &file.source.paths {
            let Some(name) = root_name(file, path) else { continue };
            let to = macros.get(name.as_str()).cloned().unwrap_or(name);
            if !to.is_empty() && to != from && !allowed.contains(to.as_str()) {
                let written = path.segments.join("::");
                found.push(format!("{}:{}: `{from}` must not know `{to}` ({written})", file.name, path.line));
            }
        }
    }
    found
}

/// True if an ancestor declares this file's module under `#[cfg(test)]`.
fn is_test_file(file: &File, files: &[File]) -> bool {
    let modules = file.modules();
    (0..modules.len()).any(|depth| {
        let parent = modules[..depth].join("/");
        let declares = |f: &&File| if depth == 0 { f.place == "lib" } else { f.place == parent };
        files.iter().filter(declares).any(|f| f.source.test_modules.contains(&modules[depth]))
    })
}

/// Every crate named where it must not be, and every `unsafe` out of place.
fn crate_violations(files: &[File]) -> Vec<String> {
    let mut found = Vec::new();
    for file in files {
        for path in &file.source.paths {
            let first = path.segments[0].as_str();
            let rule = CRATES.iter().find(|(name, _)| *name == first);
            if let Some((name, places)) = rule
                && !file.source.local_names.contains(*name)
                && !file.is_at(places)
            {
                found.push(format!("{}:{}: crate `{name}` belongs in {places:?} only", file.name, path.line));
            }
        }
        if !file.is_at(&UNSAFE) {
            let lines = &file.source.unsafe_lines;
            found.extend(lines.iter().map(|line| format!("{}:{line}: `unsafe` belongs in {UNSAFE:?} only", file.name)));
        }
    }
    found
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Files with one of these endings below `folder`, as (path relative to it, text), sorted; none if it does not exist.
fn texts(folder: &Path, endings: &[&str]) -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(dir) = open.pop() {
        for entry in std::fs::read_dir(&dir).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().and_then(|e| e.to_str()).is_some_and(|e| endings.contains(&e)) {
                let name = path.strip_prefix(folder).expect("found below it").to_string_lossy().replace('\\', "/");
                found.push((name, std::fs::read_to_string(&path).expect("sources are UTF-8")));
            }
        }
    }
    found.sort();
    found
}

fn sources() -> Vec<File> {
    let files: Vec<File> = texts(&root().join("src"), &["rs"]).iter().map(|(name, text)| File::new(name, text)).collect();
    assert!(files.iter().any(|f| f.place == "lib"), "the sources were not found");
    files
}

fn assert_none(found: &[String]) {
    assert!(found.is_empty(), "\n{}\n", found.join("\n"));
}

#[test]
fn modules_know_only_what_lies_below_them() {
    assert_none(&module_violations(&sources()));
}

#[test]
fn crates_and_unsafe_stay_in_their_places() {
    assert_none(&crate_violations(&sources()));
}

#[test]
fn the_table_itself_points_down() {
    let mut placed: BTreeSet<&str> = BTreeSet::new();
    while placed.len() < ARROWS.len() {
        let ready = |m: &str| allowed(m).is_some_and(|to| to.iter().all(|t| placed.contains(t)));
        let next = ARROWS.iter().find(|(m, _)| !placed.contains(m) && ready(m));
        let (module, _) = next.expect("the arrows of the table run in a circle");
        placed.insert(module);
    }
}

#[test]
fn files_are_not_much_over_500_lines() {
    let mut long = Vec::new();
    for folder in ["src", "tests", "benches", "examples", "shaders"] {
        for (name, text) in texts(&root().join(folder), &["rs", "wgsl"]) {
            let lines = text.lines().count();
            if lines > LINES {
                long.push(format!("{folder}/{name}: {lines} lines, at most {LINES}"));
            }
        }
    }
    assert_none(&long);
}

#[test]
fn the_map_names_every_module() {
    let map = std::fs::read_to_string(root().join("ARCHITECTURE.md")).expect("ARCHITECTURE.md is there");
    let modules: BTreeSet<String> = sources().iter().filter_map(|f| f.modules().first().cloned()).collect();
    let missing = modules.iter().filter(|m| !map.contains(&format!("`{m}`")));
    assert_none(&missing.map(|m| format!("ARCHITECTURE.md lacks `{m}`")).collect::<Vec<_>>());
}

/// Which glam each package of a Cargo.lock depends on, by package name. nalgebra is left out: it lists every glam that
/// it could convert to, and builds none of them unless asked.
fn glam_users(lock: &str) -> Vec<(String, String)> {
    let mut users = Vec::new();
    let mut glams = Vec::new();
    for package in lock.split("[[package]]").skip(1) {
        let field = |key: &str| {
            package.lines().find_map(|l| l.strip_prefix(&format!("{key} = "))).map(|v| v.trim_matches('"').to_string())
        };
        let name = field("name").unwrap_or_default();
        if name == "glam" {
            glams.extend(field("version"));
        }
        let uses = package.lines().map(|l| l.trim().trim_end_matches(',').trim_matches('"'));
        let uses = uses.filter(|l| *l == "glam" || l.starts_with("glam "));
        // nalgebra can convert to many; boolmesh is a reference of the tests and no part of the program
        users.extend(
            uses.filter(|_| !["nalgebra", "boolmesh"].contains(&name.as_str()))
                .map(|l| (name.clone(), l["glam".len()..].trim().to_string())),
        );
    }
    // The lock file leaves the version out where there is but one.
    users.iter().map(|(n, v)| (n.clone(), if v.is_empty() { glams.join(" ") } else { v.clone() })).collect()
}

#[test]
fn one_glam_in_the_tree() {
    let lock = std::fs::read_to_string(root().join("Cargo.lock")).expect("Cargo.lock is checked in");
    let users = glam_users(&lock);
    assert!(users.iter().any(|(name, _)| name == "incise"), "incise uses glam itself");
    let versions: BTreeSet<&str> = users.iter().map(|(_, v)| v.as_str()).collect();
    assert_eq!(versions.len(), 1, "glam as rapier and parry use it, and no other: {users:?}");
}

// ---- Controls: each rule must report a source that breaks it, and leave its neighbour alone. ----

fn arrows_of(name: &str, text: &str) -> usize {
    module_violations(&[File::new(name, text)]).len()
}

#[test]
fn a_forbidden_arrow_is_reported_however_it_is_written() {
    for text in [
        "use crate::rig::Pose;",
        "use crate::{geometry::Mesh, rig::{Pose}};",
        "fn f() { let x = crate::rig::Pose::default(); }",
        "use super::super::rig;",
        "use super::super::{rig::Pose};",
        "mod inner { use super::super::super::rig::Pose; }",
        "#[derive(Debug)] struct S { pose: crate::rig::Pose }",
        "impl From<crate::rig::Pose> for u8 {}",
        "macro_rules! m { () => { $crate::rig::Pose }; }",
        "use crate::*;",
        "use crate as root;",
        "#[cfg(test)] mod tests { fn f() {} } use crate::rig;",
        "#[cfg(test)] const N: [u8; 2] = [1, 2]; use crate::rig;",
        "#[cfg(any(test, feature = \"gpu\"))] use crate::rig;",
        "fn f<'a>(x: &'a str) -> char { '\"' } use crate::rig;",
        "const S: &str = r#\" \" \"#; use crate::rig;",
    ] {
        assert_eq!(arrows_of("geometry/mesh.rs", text), 1, "{text}");
    }
    assert_eq!(arrows_of("geometry/mod.rs", "use super::rig;"), 1);
    assert_eq!(arrows_of("config.rs", "use super::app::App;"), 1);
    assert_eq!(arrows_of("scene/edit.rs", "use crate::config::Config;"), 1);
    assert_eq!(arrows_of("app.rs", "use crate::host::Host;"), 1);
    assert_eq!(arrows_of("bone/mod.rs", "fn f() {}"), 1, "a module without a row");
}

#[test]
fn an_allowed_arrow_is_not_reported() {
    for text in [
        "use crate::geometry::Mesh; use super::csr; use super::super::geometry::Csr; pub(crate) fn f() {}",
        "// use crate::rig::Pose;\n/* use /* crate::rig */ crate::rig */ /// [`crate::rig::Pose`]\nfn f() {}",
        "const S: &str = \"crate::rig::Pose \\\" crate::rig\"; const R: &str = r#\"crate::rig \" \"#;",
        "#[cfg(test)] mod tests { use crate::rig::Pose; fn f() { let s = \"}\"; crate::rig::g(); } }",
        "#[cfg(test)] use crate::{rig, scene}; fn f() {}",
        "#[cfg(all(test, feature = \"gpu\"))] #[allow(dead_code)] fn f(a: u8, b: u8) { crate::rig::g(a, b) }",
        "use self::rig::Local; use rig::Other; mod rig; fn f() -> impl Sized + use<> { a::crate_like::rig() }",
    ] {
        assert_eq!(arrows_of("geometry/mesh.rs", text), 0, "{text}");
    }
    assert_eq!(arrows_of("host/headless.rs", "use crate::{app::App, config::Config, gpu, scene};"), 0);
    assert_eq!(arrows_of("cli/cut.rs", "use crate::{app, host, formats, physics, surgery::PlaneCut};"), 0);
}

#[test]
fn exported_macros_and_test_files_are_known() {
    let macros = || File::new("geometry/tracked.rs", "#[macro_export]\nmacro_rules! tracked { () => {} }");
    let user = |name| File::new(name, "crate::tracked!(A); use crate::tracked;");
    assert_eq!(module_violations(&[macros(), user("rig/rows.rs")]).len(), 0);
    assert_eq!(module_violations(&[user("rig/rows.rs")]).len(), 2, "unknown names at the root are reported");
    let tests = || File::new("rig/laws.rs", "use crate::scene::Scene;");
    assert_eq!(module_violations(&[File::new("rig/mod.rs", "#[cfg(test)] mod laws;"), tests()]).len(), 0);
    assert_eq!(module_violations(&[File::new("rig/mod.rs", "mod laws;"), tests()]).len(), 1);
}

#[test]
fn a_crate_out_of_place_is_reported() {
    let count = |name: &str, text: &str| crate_violations(&[File::new(name, text)]).len();
    for text in [
        "use wgpu::Device;",
        "use ::wgpu::Device;",
        "fn f(d: &wgpu::Device) {}",
        "fn f(d: &::wgpu::Device) {}",
        "use wgpu as graphics;",
        "extern crate wgpu;",
        "use {gltf::Gltf, std::fs};",
        "#[derive(clap::Parser)] struct A;",
        "#[cfg(feature = \"vr\")] use openxr::Entry;",
        "fn f() { unsafe { g() } }",
        "#![allow(missing_docs, unsafe_code)]",
    ] {
        assert_eq!(count("scene/edit.rs", text), 1, "{text}");
    }
    assert_eq!(count("host/vrooom.rs", "use openxr as xr;"), 1);
    assert_eq!(count("host/desktop.rs", "use rapier3d::prelude::*;"), 1);
    for (name, text) in [
        ("gpu/mod.rs", "use wgpu::Device;"),
        ("host/vr.rs", "use openxr as xr; #[allow(unsafe_code)] mod a { unsafe fn f() {} }"),
        ("host/vr_swapchain.rs", "use openxr as xr;"),
        ("formats/gltf_in/nodes.rs", "use gltf::Node;"),
        ("main.rs", "use clap::Parser;"),
        ("physics/contact.rs", "use rapier3d::prelude::*;"),
        ("cli/inspect.rs", "use crate::formats::gltf; fn f() { gltf::load(); super::wgpu::x(); self.clap; \"unsafe\"; }"),
        ("formats/mod.rs", "pub mod gltf; pub use gltf::load;"),
        ("lib.rs", "#![deny(unsafe_code)] fn f() { \"#![allow(unsafe_code)]\"; }"),
    ] {
        assert_eq!(count(name, text), 0, "{name}: {text}");
    }
}

#[test]
fn a_second_glam_is_reported() {
    let package = |name: &str, version: &str, uses: &str| {
        format!("[[package]]\nname = \"{name}\"\nversion = \"{version}\"\ndependencies = [\n \"{uses}\",\n]\n\n")
    };
    let two = [
        package("glam", "0.32.1", "libm"),
        package("glam", "0.33.0", "libm"),
        package("incise", "0.1.0", "glam 0.33.0"),
        package("nalgebra", "0.35.0", "glam 0.30.1"),
        package("other", "1.0.0", "glam 0.32.1"),
    ]
    .concat();
    let user = |name: &str, version: &str| (name.to_string(), version.to_string());
    assert_eq!(glam_users(&two), [user("incise", "0.33.0"), user("other", "0.32.1")]);
    let one = [package("glam", "0.33.0", "libm"), package("incise", "0.1.0", "glam"), package("x", "1.0.0", "glamx")].concat();
    assert_eq!(glam_users(&one), [user("incise", "0.33.0")]);
}
