//! Laws of reading and writing: topology by MATHS 1.6, transforms, round trips, and that no bytes make a reader panic.

use super::glb_writer::{self, GlbMesh, GlbPrimitive, GlbScene, GlbSkin};
use super::*;
use crate::geometry::measure::measure;
use crate::geometry::{FaceId, HalfEdge, VertexId};
use crate::rig::animation::{Animation, Channel, Interpolation, Keys, Property, key3};
use crate::rig::{LocalTransform, Node, Pose, Trs};
use glam::{DAffine3, DMat3, DQuat};
use proptest::prelude::*;
use std::fmt::Write;

const CUBE: [[[f32; 3]; 4]; 6] = [
    [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
    [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]],
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]],
    [[0.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 0.0]],
    [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 1.0, 0.0]],
    [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [1.0, 0.0, 1.0]],
];

/// A unit cube whose sides share no stored vertex.
pub(super) fn cube(at: [f32; 3]) -> GlbPrimitive {
    let mut out = GlbPrimitive::default();
    for (s, side) in (0u32..).zip(CUBE) {
        out.positions.extend(side.map(|p| [p[0] + at[0], p[1] + at[1], p[2] + at[2]]));
        out.indices.extend([0, 1, 2, 0, 2, 3].map(|k| 4 * s + k));
    }
    out
}

pub(super) fn scene(primitives: Vec<GlbPrimitive>) -> GlbScene<'static> {
    GlbScene {
        meshes: vec![GlbMesh { name: "m".into(), skin: None, primitives }],
        materials: vec![Material::default()],
        ..GlbScene::default()
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<Model, FormatError> {
    gltf_import::read(bytes, "test", None)
}

pub(super) fn model(scene: &GlbScene<'_>) -> Model {
    let model = read(&glb_writer::write(scene).unwrap()).unwrap();
    model.rig.validate().unwrap();
    model
}

pub(super) fn inspected(model: &Model) -> Inspection {
    inspect(model, &model.rig.rest_pose())
}

pub(super) fn export(model: &Model, pose: &Pose) -> (Vec<u8>, ExportReport) {
    let piece = ExportPiece { name: "piece", mesh: &model.mesh, rows: &model.rows, materials: &model.materials };
    export_glb(&model.rig, &[piece], pose).unwrap()
}

/// The glTF crate's own validation, as an outside opinion.
fn is_valid_gltf(bytes: &[u8]) -> bool {
    gltf::Gltf::from_slice(bytes).is_ok()
}

#[test]
fn unshared_sides_zip_closed() {
    let found = inspected(&model(&scene(vec![cube([0.0; 3])])));
    assert_eq!((found.vertices_stored, found.vertices_welded, found.faces), (24, 8, 12));
    assert!(found.closed && (found.volume - 1.0).abs() < 1e-12 && (found.area - 6.0).abs() < 1e-12);
    let mut open = cube([0.0; 3]);
    open.indices.truncate(30);
    let found = inspected(&model(&scene(vec![open])));
    assert!(!found.closed && found.boundary_edges == 4, "the control: one side missing");
}

#[test]
fn touching_parts_are_not_glued() {
    for shift in [[1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [1.0, 0.0, 0.0]] {
        let touching = inspected(&model(&scene(vec![cube([0.0; 3]), cube(shift)])));
        if shift == [1.0, 0.0, 0.0] {
            // A whole side in common: its edges have four faces each, and inner ones still tell the cubes apart.
            assert!(touching.vertices_welded >= 16, "{touching:?}");
        } else {
            assert_eq!((touching.components, touching.vertices_welded, touching.closed), (2, 16, true), "{shift:?}");
        }
    }
    // The control: welding by position would leave 14 vertices and an edge with four faces.
    let mut positions: Vec<[u32; 3]> =
        [cube([0.0; 3]), cube([1.0, 1.0, 0.0])].iter().flat_map(|c| c.positions.clone()).map(|p| p.map(f32::to_bits)).collect();
    positions.sort_unstable();
    positions.dedup();
    assert_eq!(positions.len(), 14);
}

/// Some programs begin a text with the mark of UTF-8, where the first keyword is.
#[test]
fn a_mark_before_the_text_costs_no_vertex() {
    let obj = "\u{feff}v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nf 1 2 3\n";
    let stl = "\u{feff}solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid s\n";
    for (text, format) in [(obj, Format::Obj), (stl, Format::Stl)] {
        let model = load_bytes(text.as_bytes(), format, "marked", None).unwrap();
        let corners: Vec<DVec3> = model.mesh.face(FaceId::new(0)).map(|v| model.rows.rest(v) + model.offset).into();
        assert_eq!(corners, [DVec3::ZERO, DVec3::X, DVec3::Y], "{format:?}");
    }
}

#[test]
fn text_soup_zips_like_gltf_and_obj_keeps_its_indices() {
    let soup = cube([0.0; 3]);
    let mut text = String::from("solid cube\n");
    let mut obj = String::new();
    for p in &soup.positions {
        writeln!(obj, "v {} {} {}", p[0], p[1], p[2]).unwrap();
    }
    for f in soup.indices.as_chunks::<3>().0 {
        text += "facet normal 0 0 0\nouter loop\n";
        for &v in f {
            let p = soup.positions[v as usize];
            writeln!(text, "vertex {} {} {}", p[0], p[1], p[2]).unwrap();
        }
        text += "endloop\nendfacet\n";
        writeln!(obj, "f {} {} {}", f[0] + 1, f[1] + 1, f[2] + 1).unwrap();
    }
    text += "endsolid cube\n";
    for (bytes, format, stored) in [(&text, Format::Stl, 36), (&obj, Format::Obj, 24)] {
        let found = inspected(&load_bytes(bytes.as_bytes(), format, "cube", None).unwrap());
        assert_eq!((found.vertices_stored, found.vertices_welded, found.closed), (stored, 8, true));
    }
    let kept = format!("{}\n{obj}", obj::TOPOLOGY_COMMENT);
    let found = inspected(&load_bytes(kept.as_bytes(), Format::Obj, "cube", None).unwrap());
    assert_eq!((found.vertices_welded, found.components), (24, 6), "our own files say what is connected");
}

#[test]
fn bow_ties_get_a_vertex_a_fan_and_bad_edges_stay_open() {
    let bow_tie = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv -1 0 0\nv 0 -1 0\nf 1 2 3\nf 1 4 5\n";
    let found = inspected(&load_bytes(bow_tie.as_bytes(), Format::Obj, "", None).unwrap());
    assert_eq!((found.vertices_welded, found.components, found.boundary_edges), (6, 2, 6));
    let fin = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 -1 0\nv 0 0 1\nf 1 2 3\nf 2 1 4\nf 1 2 5\n";
    let found = inspected(&load_bytes(fin.as_bytes(), Format::Obj, "", None).unwrap());
    assert_eq!((found.non_manifold_edges, found.boundary_edges, found.closed), (1, 6, false));
    let doubled = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 2 3 1\nf 3 2 1\nf 1 2 4\nf 1 1 3\n";
    let model = load_bytes(doubled.as_bytes(), Format::Obj, "", None).unwrap();
    assert_eq!((model.report.duplicate_faces, model.report.degenerate_faces, model.mesh.face_count()), (2, 2, 1));
}

#[test]
fn seam_copies_with_other_weights_are_reported() {
    let mut skinned = beam_scene_parts();
    let (_, weights) = &mut skinned.meshes[0].primitives[0].bones[0];
    let differing = weights.iter().position(|w| w[0] == 1.0).unwrap();
    weights[differing] = [0.75, 0.25, 0.0, 0.0];
    let model = model(&skinned);
    assert!((model.report.largest_weight_difference - 0.25).abs() < 1e-6);
    assert_eq!(load("beam").unwrap().report.largest_weight_difference, 0.0);
}

/// A small skinned box with two joints.
pub(super) fn beam_scene_parts() -> GlbScene<'static> {
    let mut primitive = cube([0.0; 3]);
    let far = |p: &[f32; 3]| p[0] > 0.5;
    let joints = primitive.positions.iter().map(|p| [u16::from(far(p)), 1 - u16::from(far(p)), 0, 0]).collect();
    let weights = vec![[1.0, 0.0, 0.0, 0.0]; primitive.positions.len()];
    primitive.bones = vec![(joints, weights)];
    let node = |parent, x: f64| Node {
        name: None,
        parent,
        local: LocalTransform::Trs(Trs { translation: glam::DVec3::X * x, ..Trs::IDENTITY }),
    };
    GlbScene {
        nodes: vec![node(None, 0.0), node(Some(0), 0.5)],
        skins: vec![GlbSkin {
            name: None,
            joints: vec![(0, DAffine3::IDENTITY), (1, DAffine3::from_translation(glam::DVec3::X * -0.5))],
            skeleton: None,
        }],
        meshes: vec![GlbMesh { name: "m".into(), skin: Some(0), primitives: vec![primitive] }],
        materials: vec![Material::default()],
        ..GlbScene::default()
    }
}

/// Rewrites the JSON chunk of a .glb.
pub(super) fn edit_json(bytes: &[u8], change: impl FnOnce(&mut serde_json::Value)) -> Vec<u8> {
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let mut root = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    change(&mut root);
    let mut text = serde_json::to_vec(&root).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut out = bytes[..8].to_vec();
    out.extend(((20 + text.len() + bytes.len() - 20 - length) as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(text);
    out.extend(&bytes[20 + length..]);
    out
}

#[test]
fn node_transforms_are_honoured() {
    let bytes = glb_writer::write(&scene(vec![cube([0.0; 3])])).unwrap();
    let placed = |change: &dyn Fn(&mut serde_json::Value)| read(&edit_json(&bytes, |root| change(root))).unwrap();
    let trs = placed(&|root| {
        root["nodes"][0]["translation"] = serde_json::json!([10.0, 0.0, 0.0]);
        root["nodes"][0]["scale"] = serde_json::json!([2.0, 1.0, 1.0]);
        root["nodes"][0]["rotation"] = serde_json::json!([0, 0, 1, 1]);
    });
    let found = inspected(&trs);
    assert!(found.closed && (found.volume - 2.0).abs() < 1e-6);
    let expected = Bounds { min: [9.0, 0.0, 0.0], max: [10.0, 2.0, 1.0], diagonal: 6f64.sqrt() };
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near(found.bounds.min, expected.min) && near(found.bounds.max, expected.max), "{:?}", found.bounds);
    // A mirrored matrix under a moved parent: faces still point outward.
    let mirrored = placed(&|root| {
        root["nodes"][0]["matrix"] = serde_json::json!([-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 5, 0, 1]);
        root["nodes"].as_array_mut().unwrap().push(serde_json::json!({"children": [0], "translation": [0, 0, 3]}));
        root["scenes"][0]["nodes"] = serde_json::json!([1]);
    });
    let found = inspected(&mirrored);
    assert!((found.volume - 1.0).abs() < 1e-9 && near(found.bounds.min, [-1.0, 5.0, 3.0]), "{found:?}");
    let w = mirrored.mesh.wedge(mirrored.mesh.face_wedges(FaceId(0))[0]);
    let out = mirrored.rows.rest(w.vertex).dot(glam::Vec3::from_array(w.normal).as_dvec3());
    assert!(out > 0.0, "computed normals point outward too");
}

#[test]
fn a_skinned_mesh_ignores_its_own_node() {
    let bytes = glb_writer::write(&beam_scene_parts()).unwrap();
    let moved = edit_json(&bytes, |root| root["nodes"][2]["translation"] = serde_json::json!([7.0, 7.0, 7.0]));
    let still = inspected(&read(&moved).unwrap());
    assert_eq!(still.bounds, inspected(&read(&bytes).unwrap()).bounds);
    let joint = edit_json(&bytes, |root| root["nodes"][0]["translation"] = serde_json::json!([7.0, 7.0, 7.0]));
    assert!((inspected(&read(&joint).unwrap()).bounds.min[1] - 7.0).abs() < 1e-6, "the control: a joint moves it");
}

#[test]
fn an_animated_node_carries_its_mesh() {
    let spin = Animation {
        name: "spin".into(),
        duration_s: 1.0,
        channels: vec![Channel {
            node: 0,
            property: Property::Translation,
            keys: Keys {
                interpolation: Interpolation::Linear,
                times: vec![0.0, 1.0],
                values: vec![key3(glam::DVec3::ZERO), key3(glam::DVec3::Y * 3.0)],
            },
        }],
    };
    let animations = [spin];
    let scene = GlbScene {
        nodes: vec![Node { name: None, parent: None, local: LocalTransform::Trs(Trs::IDENTITY) }],
        animations: &animations,
        ..scene(vec![cube([0.0; 3])])
    };
    let bytes = edit_json(&glb_writer::write(&scene).unwrap(), |root| {
        root["nodes"][0]["children"] = serde_json::json!([1]);
        root["scenes"][0]["nodes"] = serde_json::json!([0]);
    });
    let model = read(&bytes).unwrap();
    assert_eq!((model.rig.joints.len(), model.rig.skins.len()), (1, 0));
    let height = |m: &Model, t: f64| inspect(m, &m.rig.pose_at(Some(0), t)).bounds.min[1];
    assert!((height(&model, 0.0)).abs() < 1e-6 && (height(&model, 0.5) - 1.5).abs() < 1e-6);
    let (exported, _) = export(&model, &model.rig.rest_pose());
    assert!(is_valid_gltf(&exported));
    let again = read(&exported).unwrap();
    assert!((height(&again, 0.5) - 1.5).abs() < 1e-6 && inspected(&again).closed);
}

#[test]
fn bind_spaces_of_another_size_are_brought_to_the_models() {
    let mut scene = beam_scene_parts();
    // Bind space in centimetres, far away; the inverse binds bring it home.
    let home = DAffine3 { matrix3: DMat3::from_diagonal(glam::DVec3::splat(0.01)), translation: glam::DVec3::splat(-40.0) };
    for p in &mut scene.meshes[0].primitives[0].positions {
        *p = p.map(|x| x * 100.0 + 4000.0);
    }
    for joint in &mut scene.skins[0].joints {
        joint.1 *= home;
    }
    let model = model(&scene);
    let found = inspected(&model);
    assert!((found.volume - 1.0).abs() < 1e-4 && (found.bounds.diagonal - 3f64.sqrt()).abs() < 1e-4);
    let rest = measure(&model.mesh, |v| model.rows.rest(v));
    assert!((rest.volume - 1.0).abs() < 1e-4 && rest.max.length() < 2.0, "rest positions have the posed size: {rest:?}");
}

#[test]
fn recentring_is_accurate_and_reversible() {
    let far = [4096.0, -512.25, 77.5];
    let model = model(&scene(vec![cube(far)]));
    assert!(model.rows.rest_position.iter().flatten().all(|x| x.abs() <= 0.75), "near the origin");
    let mut placed: Vec<[f64; 3]> = model.mesh.live_vertices().map(|v| (model.rows.rest(v) + model.offset).to_array()).collect();
    placed.sort_by(|a, b| a.partial_cmp(b).unwrap());
    assert_eq!(placed[0], far.map(f64::from), "bit for bit");
    assert!((inspected(&model).volume - 1.0).abs() < 1e-12);
    let again = read(&export(&model, &Pose::default()).0).unwrap();
    assert_eq!(again.rows.rest_position.to_vec().len(), 8);
    assert_eq!(again.offset, model.offset);
}

#[test]
fn the_beam_survives_a_round_trip() {
    for name in ["beam", "heart"] {
        let model = load(name).unwrap();
        let (bytes, report) = export(&model, &model.rig.rest_pose());
        assert!(is_valid_gltf(&bytes));
        assert_eq!((report.deviation_m, report.deviation), (0.0, 0.0), "all are base vertices");
        let again = read(&bytes).unwrap();
        let (a, b) = (inspected(&model), inspected(&again));
        assert_eq!((a.vertices_welded, a.faces, a.closed, a.components), (b.vertices_welded, b.faces, b.closed, b.components));
        assert_eq!(model.rig.nodes, again.rig.nodes);
        assert_eq!((a.joints, a.skins, &a.animations, &a.materials), (b.joints, b.skins, &b.animations, &b.materials));
        assert!((a.area - b.area).abs() < 1e-9 * a.area && (a.volume - b.volume).abs() < 1e-9 * a.area);
        for t in [0.0, 0.3, 0.7] {
            let area = |m: &Model| inspect(m, &m.rig.pose_at(Some(0), t)).area;
            assert!((area(&model) - area(&again)).abs() < 1e-6 * area(&model));
        }
        assert_eq!(export(&again, &again.rig.rest_pose()).0.len(), bytes.len(), "and a second one changes nothing");
    }
}

/// Opens an edge chain of the sphere: a slit of width 0.
fn slit(model: &mut Model) -> usize {
    let mut open = Vec::new();
    let mut h = HalfEdge::of(FaceId(40), 0);
    for _ in 0..4 {
        open.push(h);
        let ahead = h.next();
        h = model.mesh.opposite(model.mesh.opposite(ahead).next()).next(); // about straight on
    }
    let mut touched: Vec<VertexId> = Vec::new();
    for &h in &open {
        touched.extend([model.mesh.from(h), model.mesh.to(h)]);
        model.mesh.open_edge(h);
    }
    let faces: Vec<FaceId> = model.mesh.live_faces().collect();
    let mut copies = Vec::new();
    model.mesh.split_fans(&touched, &faces, &mut Default::default(), &mut copies);
    for copy in copies {
        let v = model.rows.push_embedded(&[(copy.from, 1.0)]);
        assert_eq!(v, copy.vertex);
    }
    measure(&model.mesh, |v| model.rows.rest(v)).boundary_edges
}

#[test]
fn a_slit_of_width_zero_stays_open() {
    let mut model = load("sphere").unwrap();
    let open = slit(&mut model);
    assert!(open > 0);
    let (bytes, report) = export(&model, &Pose::default());
    assert!(is_valid_gltf(&bytes) && report.deviation < 1e-7);
    let again = inspected(&read(&bytes).unwrap());
    assert_eq!((again.boundary_edges, again.closed, again.non_manifold_edges), (open, false, 0));
    let unmarked = edit_json(&bytes, |root| {
        for primitive in root["meshes"][0]["primitives"].as_array_mut().unwrap() {
            primitive["attributes"].as_object_mut().unwrap().remove("_INCISE_VERTEX");
        }
    });
    assert!(inspected(&read(&unmarked).unwrap()).closed, "the control: without the attribute it is zipped");
    let piece = ExportPiece { name: "a b", mesh: &model.mesh, rows: &model.rows, materials: &model.materials };
    let obj = export_obj(&[piece], model.offset, &Pose::default());
    let again = inspected(&load_bytes(obj.as_bytes(), Format::Obj, "", None).unwrap());
    assert_eq!((again.boundary_edges, again.faces), (open, 768));
}

#[test]
fn embedded_vertices_are_exact_in_the_exported_pose() {
    let mut model = load("beam").unwrap();
    // Splits nothing, but dresses one vertex in a row over an edge across the first joint's fade.
    let at = |v: VertexId| model.rows.rest(v).x;
    let v = model.mesh.live_vertices().min_by(|&a, &b| (at(a) + 0.1).abs().total_cmp(&(at(b) + 0.1).abs())).unwrap();
    let ends: Vec<VertexId> = model.mesh.neighbours(v).collect();
    let (a, b) = (
        *ends.iter().min_by(|a, b| at(**a).total_cmp(&at(**b))).unwrap(),
        *ends.iter().max_by(|a, b| at(**a).total_cmp(&at(**b))).unwrap(),
    );
    let row = [a, b].map(|base| crate::rig::RowEntry { base, padding: 0, weight: 0.5 });
    model.rows.rows.set_row(v.index(), &row);
    model.rows.bones.set_row(v.index(), &[]);
    let pose = model.rig.pose_at(Some(0), 0.5);
    let (bytes, report) = export(&model, &pose);
    assert!(report.deviation_in_pose_m < 1e-7 && report.deviation_m > 1e-5, "{report:?}");
    let again = read(&bytes).unwrap();
    let posed = again.rig.pose_at(Some(0), 0.5);
    let target = pose.skin(&model.rows, v);
    let nearest = again.mesh.live_vertices().map(|u| posed.skin(&again.rows, u).distance(target)).fold(f64::MAX, f64::min);
    assert!(nearest < 1e-6 * 0.6, "{nearest}");
}

#[test]
fn bad_files_say_what_is_wrong() {
    let bytes = glb_writer::write(&beam_scene_parts()).unwrap();
    let error = |change: &dyn Fn(&mut serde_json::Value)| read(&edit_json(&bytes, |root| change(root))).unwrap_err();
    assert!(matches!(read(b""), Err(FormatError::Empty)));
    assert!(matches!(read(&bytes[..bytes.len() / 2]), Err(FormatError::Truncated { .. })));
    assert!(matches!(read(b"{\"asset\":{\"vers"), Err(FormatError::Truncated { .. })));
    assert!(matches!(read(b"{]"), Err(FormatError::Syntax { .. })));
    assert!(matches!(error(&|r| r["buffers"][0]["uri"] = "gone.bin".into()), FormatError::MissingBuffer { .. }));
    assert!(matches!(
        error(&|r| r["nodes"][1]["children"] = serde_json::json!([0])),
        FormatError::NodeCycle { .. } | FormatError::NoFaces { .. }
    ));
    assert!(matches!(error(&|r| r["nodes"][0]["children"] = serde_json::json!([1, 1])), FormatError::NodeCycle { .. }));
    assert!(matches!(error(&|r| r["nodes"][2]["mesh"] = 9.into()), FormatError::IndexOutOfRange { target: "mesh", .. }));
    assert!(matches!(error(&|r| r["nodes"][2]["skin"] = 9.into()), FormatError::IndexOutOfRange { target: "skin", .. }));
    assert!(matches!(error(&|r| r["scene"] = 9.into()), FormatError::IndexOutOfRange { target: "scene", .. }));
    assert!(matches!(
        error(&|r| r["skins"][0]["joints"] = serde_json::json!([0])),
        FormatError::IndexOutOfRange { target: "joint", .. }
    ));
    assert!(matches!(error(&|r| r["meshes"][0]["primitives"][0]["mode"] = 1.into()), FormatError::NoFaces { .. }));
    assert!(matches!(
        error(&|r| r["extensionsRequired"] = serde_json::json!(["KHR_draco_mesh_compression"])),
        FormatError::UnsupportedExtension { .. }
    ));
    let faulty = |change: &dyn Fn(&mut GlbPrimitive)| {
        let mut scene = beam_scene_parts();
        change(&mut scene.meshes[0].primitives[0]);
        read(&glb_writer::write(&scene).unwrap()).unwrap_err()
    };
    let far = faulty(&|p| p.indices[5] = 99);
    assert!(matches!(far, FormatError::IndexOutOfRange { target: "vertex", index: 99, count: 24, .. }));
    // JSON cannot hold NaN, so the range is given as null by the writer and does not matter to the reader.
    let nan = faulty(&|p| p.positions[3][1] = f32::NAN);
    assert!(matches!(&nan, FormatError::NotFinite { what } if what.contains("vertex 3")), "{nan}");
    let zero = faulty(&|p| p.bones[0].1[7] = [0.0; 4]);
    assert!(matches!(&zero, FormatError::SkinWeights { vertex: 7, problem: "sum to 0", .. }), "{zero}");
    assert!(matches!(faulty(&|p| p.bones[0].1[7][0] = -1.0), FormatError::SkinWeights { vertex: 7, .. }));
    let flat = faulty(&|p| p.positions.iter_mut().for_each(|p| *p = [p[0]; 3]));
    assert!(matches!(&flat, FormatError::NoFaces { detail } if detail.contains("area")));
    let none = load("no-such-model").unwrap_err().to_string();
    assert!(none.contains("beam, heart, sphere"));
    let folder = tempfile::tempdir().unwrap();
    let odd = folder.path().join("model.xyz");
    std::fs::write(&odd, b"x").unwrap();
    assert!(matches!(load(odd.to_str().unwrap()), Err(FormatError::UnknownExtension { .. })));
    let point = folder.path().join("point.glb");
    let to_a_point = |r: &mut serde_json::Value| {
        r["nodes"].as_array_mut().unwrap().iter_mut().for_each(|n| n["scale"] = serde_json::json!([0, 0, 0]));
    };
    std::fs::write(&point, edit_json(&bytes, to_a_point)).unwrap();
    assert!(matches!(load(point.to_str().unwrap()), Err(FormatError::NoSize)));
    let upper = folder.path().join("MODEL.GLB");
    std::fs::write(&upper, &bytes).unwrap();
    assert_eq!(load(upper.to_str().unwrap()).unwrap().name, "MODEL");
}

#[test]
fn rotation_keys_survive_writing() {
    let beam = load("beam").unwrap();
    let again = read(&export(&beam, &beam.rig.rest_pose()).0).unwrap();
    assert_eq!(beam.rig.animations, again.rig.animations);
    let turned = beam.rig.pose_at(Some(0), 0.5).joint_matrices[1].linear();
    let expected = DMat3::from_quat(DQuat::from_rotation_z(0.7));
    assert!((turned - expected).to_cols_array().iter().all(|x| x.abs() < 1e-6));
}

fn small_glb() -> Vec<u8> {
    let beam = super::generate("beam", Some(44)).unwrap();
    assert!(read(&beam).is_ok());
    beam
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_change_of_bytes_makes_gltf_panic(flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8), cut in any::<prop::sample::Index>(), whole in any::<bool>()) {
        let mut bytes = small_glb();
        for (at, value) in flips {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if !whole {
            bytes.truncate(cut.index(bytes.len()));
        }
        if let Ok(model) = read(&bytes) {
            prop_assert!(model.rig.validate().is_ok());
            inspected(&model);
        }
    }

    #[test]
    fn no_change_of_numbers_in_the_json_makes_gltf_panic(digit in any::<prop::sample::Index>(), value in prop::sample::select(vec![b'0', b'1', b'7', b'9', b'-', b'e', b'"'])) {
        let mut bytes = small_glb();
        let length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
        let digits: Vec<usize> = (20..20 + length).filter(|&i| bytes[i].is_ascii_digit()).collect();
        bytes[digits[digit.index(digits.len())]] = value;
        if let Ok(model) = read(&bytes) {
            prop_assert!(model.rig.validate().is_ok());
            inspected(&model);
        }
    }

    #[test]
    fn no_text_makes_obj_or_stl_panic(text in "(solid|facet|endloop|endsolid|vertex|v|vt|vn|f|usemtl|l)?[ 0-9/.eE\\-]{0,12}\n?(v 0 1 2\nf 1 -1 1/|vertex nan 1 2\n){0,3}[ -~]{0,20}", bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        for input in [text.as_bytes(), &bytes] {
            let _ = load_bytes(input, Format::Obj, "", None);
            let _ = load_bytes(input, Format::Stl, "", None);
        }
    }
}

#[test]
fn transforms_that_are_none_are_told_of() {
    let with = |key: &str, value: serde_json::Value| {
        let bytes = edit_json(&glb_writer::write(&scene(vec![cube([0.0; 3])])).unwrap(), |root| root["nodes"][0][key] = value);
        read(&bytes).unwrap().report.warnings
    };
    let mut matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
    assert!(with("matrix", serde_json::json!(matrix)).is_empty() && with("rotation", serde_json::json!([0, 0, 0, 1])).is_empty());
    matrix[11] = 1;
    assert!(with("matrix", serde_json::json!(matrix))[0].contains("0 0 0 1"));
    assert!(with("rotation", serde_json::json!([0, 0, 0, 0]))[0].contains("zeros"));
}
