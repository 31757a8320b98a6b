//! Laws of which way a model faces and where it stands.

use super::glb_writer::{self, GlbMesh, GlbScene};
use super::import_tests::{beam_scene_parts, cube, edit_json, export, inspected, model, read, scene};
use super::*;
use crate::geometry::{VertexId, cofactor};
use crate::rig::animation::{Animation, Channel, Interpolation, Keys, Property};
use crate::rig::{LocalTransform, Node, Pose, Trs};
use glam::DQuat;

/// Turns a node about z.
fn bend(node: u32) -> Animation {
    let keys = Keys {
        interpolation: Interpolation::Linear,
        times: vec![0.0, 1.0],
        values: [0.0, 0.7].map(|angle| DQuat::from_rotation_z(angle).to_array()).to_vec(),
    };
    Animation { name: "bend".into(), duration_s: 1.0, channels: vec![Channel { node, property: Property::Rotation, keys }] }
}

/// The skinned box with normals, under a root.
fn under_a_root(root: Trs, animations: &[Animation]) -> GlbScene<'_> {
    let mut scene = GlbScene { animations, ..beam_scene_parts() };
    for node in &mut scene.nodes {
        node.parent = Some(node.parent.map_or(0, |p| p + 1));
    }
    scene.nodes.insert(0, Node { name: None, parent: None, local: LocalTransform::Trs(root) });
    for joint in &mut scene.skins[0].joints {
        joint.0 += 1;
    }
    let primitive = &mut scene.meshes[0].primitives[0];
    for corners in primitive.positions.as_chunks::<4>().0 {
        let [a, b, c, _] = corners.map(|p| DVec3::from_array(p.map(f64::from)));
        primitive.normals.extend([(b - a).cross(c - a).normalize().as_vec3().to_array(); 4]);
    }
    scene
}

fn posed(model: &Model, pose: &Pose, v: VertexId) -> DVec3 {
    pose.skin(&model.rows, v) + model.offset
}

/// Least cosine between a face and the normals of its corners, as posed.
fn worst_normal(model: &Model, pose: &Pose) -> f64 {
    let of_face = |f| {
        let [a, b, c] = model.mesh.face(f).map(|v| pose.skin(&model.rows, v));
        let face = (b - a).cross(c - a).normalize();
        let corner = |w| {
            let wedge = model.mesh.wedge(w);
            let normal = DVec3::from_array(wedge.normal.map(f64::from));
            (cofactor(pose.blended_linear(&model.rows, wedge.vertex)) * normal).normalize().dot(face)
        };
        model.mesh.face_wedges(f).map(corner).into_iter().fold(1.0, f64::min)
    };
    model.mesh.live_faces().map(of_face).fold(1.0, f64::min)
}

#[test]
fn a_rig_that_mirrors_its_skin_leaves_faces_outward() {
    let animations = [bend(2)];
    let plain = model(&under_a_root(Trs::IDENTITY, &animations));
    for scale in [DVec3::new(-2.0, 2.0, 2.0), DVec3::new(1.0, -1.0, 1.0), DVec3::splat(-0.01), DVec3::new(1.0, 1.0, -3.0)] {
        let size = scale.abs().max_element();
        let translation = DVec3::X * f64::from((3.0 * size) as f32);
        let scale = scale.as_vec3().as_dvec3(); // as a file has it
        let root = Trs { translation, scale, ..Trs::IDENTITY };
        let scene = under_a_root(root, &animations);
        let mirrored = model(&scene);
        let mut without = scene.clone();
        without.meshes[0].primitives[0].normals.clear();
        let again = read(&export(&mirrored, &mirrored.rig.rest_pose()).0).unwrap();
        for (what, found) in [("as it is", &mirrored), ("without normals", &model(&without)), ("written and read", &again)] {
            for t in [0.0, 0.5, 1.0] {
                let (straight, pose) = (plain.rig.pose_at(Some(0), t), found.rig.pose_at(Some(0), t));
                let volume = inspect(&plain, &straight).volume * scale.element_product().abs();
                assert!((inspect(found, &pose).volume / volume - 1.0).abs() < 1e-5, "{what}, {scale} at {t}");
                for v in plain.mesh.live_vertices() {
                    let expected = posed(&plain, &straight, v) * scale + translation;
                    assert!(nearest(found, &pose, expected) < 1e-6 * size, "{what}, {scale} at {t}: it moves as before");
                }
                let least = if what == "without normals" { 0.1 } else { 0.7 }; // smooth corners of a cube
                assert!(worst_normal(found, &pose) > least, "{what}, {scale} at {t}: {}", worst_normal(found, &pose));
            }
            let rest = crate::geometry::measure::measure(&found.mesh, |v| found.rows.rest(v));
            assert!(rest.volume > 0.0, "{what}: outward at rest too");
        }
    }
}

#[test]
fn joints_that_disagree_keep_the_winding() {
    let mut scene = beam_scene_parts();
    let LocalTransform::Trs(trs) = &mut scene.nodes[1].local else { panic!() };
    trs.scale.y = -1.0;
    let found = model(&scene);
    let stored = model(&beam_scene_parts());
    assert_eq!(found.mesh.faces(), stored.mesh.faces());
    // a joint that flattens decides nothing
    let mut scene = under_a_root(Trs { scale: DVec3::new(-1.0, 1.0, 1.0), ..Trs::IDENTITY }, &[]);
    let LocalTransform::Trs(trs) = &mut scene.nodes[2].local else { panic!() };
    trs.scale.y = 0.0;
    assert!(inspected(&read(&glb_writer::write(&scene).unwrap()).unwrap()).volume > 0.0);
}

/// The faces of nested tetrahedra as OBJ: `size`, and whether each is turned inward.
fn nested(parts: &[(f64, bool)]) -> String {
    let mut text = String::new();
    for (part, &(size, _)) in parts.iter().enumerate() {
        let at = 0.1 * part as f64;
        for corner in [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
            let [x, y, z] = corner.map(|x| 50.0 + at + size * x);
            text += &format!("v {x} {y} {z}\n");
        }
    }
    for (part, &(_, inward)) in parts.iter().enumerate() {
        for [a, b, c] in [[1, 3, 2], [1, 2, 4], [1, 4, 3], [2, 3, 4]].map(|f| f.map(|v| v + 4 * part)) {
            text += &if inward { format!("f {a} {c} {b}\n") } else { format!("f {a} {b} {c}\n") };
        }
    }
    text
}

fn warnings(obj: &str) -> Vec<String> {
    load_bytes(obj.as_bytes(), Format::Obj, "", None).unwrap().report.warnings
}

#[test]
fn a_closed_model_that_is_inside_out_is_told() {
    let told = warnings(&nested(&[(1.0, true)]));
    assert!(told.len() == 1 && told[0].contains("inside out") && told[0].contains("recalculate the normals"), "{told:?}");
    assert_eq!(warnings(&nested(&[(0.2, false), (1.0, true)])).len(), 1, "the whole counts");
    // the controls: a solid, one with a cavity, one without volume, and an open one
    assert!(warnings(&nested(&[(1.0, false)])).is_empty());
    assert!(warnings(&nested(&[(1.0, false), (0.2, true)])).is_empty(), "a cavity faces inward");
    let sheet = "v 0 0 0\nv 1 0 0\nv 0.3 1 0.2\nf 1 2 3\nf 3 2 1\n";
    assert!(warnings(sheet).is_empty());
    let open = nested(&[(1.0, true)]).replace("f 2 4 3\n", "");
    assert!(warnings(&open).is_empty());
    for name in BUNDLED {
        assert!(load(name).unwrap().report.warnings.is_empty(), "{name}");
    }
}

#[test]
fn a_skinned_model_is_judged_as_posed() {
    let mut scene = beam_scene_parts();
    for node in &mut scene.nodes {
        let LocalTransform::Trs(trs) = &mut node.local else { panic!() };
        trs.scale.y = if node.parent.is_some() { -1.0 } else { 0.1 };
    }
    let told = |scene: &GlbScene<'_>| {
        let bytes = glb_writer::write(scene).unwrap();
        load_bytes(&bytes, Format::Gltf, "", None).unwrap().report.warnings
    };
    assert!(told(&scene).is_empty(), "{:?}", told(&scene));
    scene.skins[0].joints[1].1.matrix3.y_axis.y = 20.0;
    assert_eq!(told(&scene).len(), 1, "the joint that mirrors has most of the volume");
}

#[test]
fn faces_that_are_wound_against_each_other_are_told() {
    let flipped = nested(&[(1.0, false)]).replace("f 2 3 4\n", "f 2 4 3\n");
    let told = warnings(&flipped);
    assert!(told.len() == 1 && told[0].contains("at 3 edges") && told[0].contains("recalculate the normals"), "{told:?}");
    let soup = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 0\nv 1 0 0\nv 0 -1 0\nf 1 2 3\nf 4 5 6\n";
    assert!(warnings(soup)[0].contains("at 1 edge:"), "copies of vertices too");
    // the controls: wound alike, and an edge with three faces
    assert!(warnings(&soup.replace("f 4 5 6", "f 4 6 5")).is_empty());
    assert!(warnings("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 -1 0\nv 0 0 1\nf 1 2 3\nf 2 1 4\nf 1 2 5\n").is_empty());
}

/// Far enough that f32 in model space moves vertices by 1e-4.
const AWAY: DVec3 = DVec3::new(1000.0, 500.0, -3000.0);

/// Two boxes side by side, one of which rises with its node.
fn one_of_two_rises(away: DVec3, animations: &[Animation]) -> Vec<u8> {
    let still = Node { name: None, parent: None, local: LocalTransform::Trs(Trs { translation: away, ..Trs::IDENTITY }) };
    let mut scene = GlbScene { nodes: vec![still.clone(), still], animations, ..scene(vec![cube([0.0; 3])]) };
    scene.meshes.push(GlbMesh { primitives: vec![cube([0.5, 2.0, 0.0])], ..scene.meshes[0].clone() });
    edit_json(&glb_writer::write(&scene).unwrap(), |root| {
        root["nodes"][0]["children"] = serde_json::json!([2]);
        root["nodes"][1]["children"] = serde_json::json!([3]);
        root["scenes"][0]["nodes"] = serde_json::json!([0, 1]);
    })
}

/// Far models of each kind, with the same one at the origin.
fn far_and_near() -> Vec<(&'static str, Model, Model)> {
    let root = |translation| Trs { translation, rotation: DQuat::from_rotation_y(0.4), scale: DVec3::splat(0.75) };
    let skinned = |at| model(&under_a_root(root(at), &[bend(2)]));
    let still = |at: DVec3| {
        let node = Node { name: None, parent: None, local: LocalTransform::Trs(Trs { translation: at, ..Trs::IDENTITY }) };
        let bytes = glb_writer::write(&GlbScene { nodes: vec![node], ..scene(vec![cube([0.0; 3])]) }).unwrap();
        read(&edit_json(&bytes, |root| {
            root["nodes"][0]["children"] = serde_json::json!([1]);
            root["scenes"][0]["nodes"] = serde_json::json!([0]);
        }))
        .unwrap()
    };
    let rises = |at| read(&one_of_two_rises(at, &[bend(1)])).unwrap();
    vec![
        ("skinned", skinned(AWAY), skinned(DVec3::ZERO)),
        ("static", still(AWAY), still(DVec3::ZERO)),
        ("rigid", rises(AWAY), rises(DVec3::ZERO)),
    ]
}

/// Dresses the last vertex in a row over the first and the last but one; returns it.
fn embed(model: &mut Model) -> VertexId {
    let [first, other, last] = [0, model.mesh.vertex_slots() - 2, model.mesh.vertex_slots() - 1].map(VertexId::new);
    let row = [(first, 0.3), (other, 0.7)].map(|(base, weight)| crate::rig::RowEntry { base, padding: 0, weight });
    model.rows.rows.set_row(last.index(), &row);
    model.rows.bones.set_row(last.index(), &[]);
    last
}

/// Nearest distance of a vertex of `model` to a place, model space.
fn nearest(model: &Model, pose: &Pose, place: DVec3) -> f64 {
    model.mesh.live_vertices().map(|u| posed(model, pose, u).distance(place)).fold(f64::MAX, f64::min)
}

/// Animations, and the node that each channel moves, without its parent: a node that holds the rig together comes before it.
fn told_by_nodes(rig: &Rig) -> Vec<(crate::rig::Animation, Vec<crate::rig::Node>)> {
    let mut animations = rig.animations.clone();
    let node = |n: u32| crate::rig::Node { parent: None, ..rig.nodes[n as usize].clone() };
    let moved = |a: &mut crate::rig::Animation| a.channels.iter_mut().map(|c| node(std::mem::take(&mut c.node))).collect();
    animations.iter_mut().map(|a| (moved(a), a.clone())).map(|(nodes, a)| (a, nodes)).collect()
}

#[test]
fn a_model_far_away_goes_out_about_its_own_origin() {
    for (kind, mut far, mut near) in far_and_near() {
        let (embedded, _) = (embed(&mut far), embed(&mut near));
        for t in [0.0, 0.5, 1.0] {
            let pose = far.rig.pose_at(Some(0), t);
            let (bytes, report) = export(&far, &pose);
            let again = read(&bytes).unwrap();
            assert_eq!(told_by_nodes(&again.rig), told_by_nodes(&far.rig));
            let found = again.rig.pose_at(Some(0), t);
            let size = inspected(&far).bounds.diagonal;
            let worst = |pose: &Pose, found: &Pose, with: bool| {
                let all = far.mesh.live_vertices().filter(|&v| with || v != embedded);
                all.map(|v| nearest(&again, found, posed(&far, pose, v))).fold(0.0, f64::max) / size
            };
            assert!(worst(&pose, &found, true) < 1e-7, "{kind}, exported at {t}: {}", worst(&pose, &found, true));
            for s in [0.25, 0.75] {
                let (pose, found) = (far.rig.pose_at(Some(0), s), again.rig.pose_at(Some(0), s));
                assert!(worst(&pose, &found, false) < 1e-7, "{kind}, at {s}: {}", worst(&pose, &found, false));
            }
            let at_home = export(&near, &near.rig.pose_at(Some(0), t)).1;
            assert!(report.deviation_in_pose_m < 1e-7 * size, "{kind}: {report:?}");
            assert!((report.deviation - at_home.deviation).abs() < 1e-6, "{kind}: {report:?}, {at_home:?}");
        }
    }
}

#[test]
fn a_model_near_by_goes_out_in_model_space() {
    let stored = |bytes: &[u8]| {
        let mut root = serde_json::Value::Null;
        edit_json(bytes, |json| root = json.clone());
        let mesh = root["nodes"].as_array().unwrap().iter().find(|n| !n["mesh"].is_null()).unwrap();
        (root["accessors"][0]["max"][1].as_f64().unwrap(), mesh["translation"].is_null())
    };
    let out = |y: f32| stored(&export(&model(&scene(vec![cube([0.0, y, 0.0])])), &Pose::default()).0);
    assert_eq!(out(4.0), (5.0, true));
    assert_eq!(out(40.0), (0.5, false), "the control: far away");
}

#[test]
fn rounding_that_moves_base_vertices_is_reported() {
    // far enough to round, near enough to go out in model space
    let text = "v 5.1 0 0\nv 6.1 0 0\nv 5.1 1 0\nv 5.1 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    let model = load_bytes(text.as_bytes(), Format::Obj, "", None).unwrap();
    let (bytes, report) = export(&model, &Pose::default());
    let again = read(&bytes).unwrap();
    let all = model.mesh.live_vertices();
    let worst = all.map(|v| nearest(&again, &Pose::default(), posed(&model, &Pose::default(), v))).fold(0.0, f64::max);
    assert!(worst > 0.0 && (report.deviation_m / worst - 1.0).abs() < 1e-6, "{worst}, {report:?}");
}

#[test]
fn far_below_a_turned_root_nothing_moves_either() {
    for k in 0..40 {
        let angles = [0.37, 1.3, 1.0].map(|step| step * f64::from(k));
        let rotation = DQuat::from_euler(glam::EulerRot::XYZ, angles[0], angles[1], angles[2] + 0.2 * f64::from(k));
        let mut scene = under_a_root(Trs { rotation, ..Trs::IDENTITY }, &[]);
        let LocalTransform::Trs(trs) = &mut scene.nodes[1].local else { panic!() };
        trs.translation = AWAY;
        let far = model(&scene);
        let pose = far.rig.rest_pose();
        let again = read(&export(&far, &pose).0).unwrap();
        let found = again.rig.rest_pose();
        let worst = far.mesh.live_vertices().map(|v| nearest(&again, &found, posed(&far, &pose, v))).fold(0.0, f64::max);
        assert!(worst < 1e-7, "{k}: {worst}");
    }
}
