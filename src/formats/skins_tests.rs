//! Laws of skins: what is one is read as one, what is not stays apart, and neither grows from file to file.

use super::glb_writer::{self, GlbMesh, GlbPrimitive, GlbScene};
use super::import_tests::{beam_scene_parts, edit_json, export, inspected, model, read};
use super::*;
use crate::rig::animation::{Animation, Channel, Interpolation, Keys, Property, key3};
use glam::{DAffine3, DVec3};

/// Raises a node at x = 0.5 by 1 m in 1 s.
fn rise(node: u32) -> Animation {
    let values = vec![key3(DVec3::X * 0.5), key3(DVec3::X * 0.5 + DVec3::Y)];
    let keys = Keys { interpolation: Interpolation::Linear, times: vec![0.0, 1.0], values };
    Animation { name: "rise".into(), duration_s: 1.0, channels: vec![Channel { node, property: Property::Translation, keys }] }
}

/// Some sides of a primitive of the cube.
fn sides(of: &GlbPrimitive, range: std::ops::Range<usize>) -> GlbPrimitive {
    let corners = 4 * range.start..4 * range.end;
    let indices = of.indices[6 * range.start..6 * range.end].iter().map(|i| i - corners.start as u32).collect();
    let bones = of.bones.iter().map(|(j, w)| (j[corners.clone()].to_vec(), w[corners.clone()].to_vec())).collect();
    GlbPrimitive { positions: of.positions[corners.clone()].to_vec(), indices, bones, ..GlbPrimitive::default() }
}

/// The skinned box in two meshes, whose second skin has its joints in another order.
fn in_two_skins(animations: &[Animation]) -> GlbScene<'_> {
    let mut scene = GlbScene { animations, ..beam_scene_parts() };
    let whole = scene.meshes[0].primitives.remove(0);
    let mut other = sides(&whole, 3..6);
    for (joints, weights) in &mut other.bones {
        for (joints, weights) in joints.iter_mut().zip(weights) {
            *joints = [0, 1, 2, 3].map(|k| if weights[k] > 0.0 { 1 - joints[k] } else { 0 });
        }
    }
    scene.meshes[0].primitives.push(sides(&whole, 0..3));
    scene.meshes.push(GlbMesh { name: "other".into(), skin: Some(1), primitives: vec![other] });
    let mut skin = scene.skins[0].clone();
    skin.joints.reverse();
    scene.skins.push(skin);
    scene
}

/// The model after each of some exports and imports.
fn trips(first: &Model) -> Vec<Model> {
    let again = |m: &Model| Some(read(&export(m, &m.rig.rest_pose()).0).unwrap());
    std::iter::successors(again(first), again).take(3).collect()
}

/// Lowest and highest y of the corners at x = 0 and at x = 1, in a pose.
fn heights(model: &Model, animation: usize, time: f64) -> [f64; 4] {
    let pose = model.rig.pose_at(Some(animation), time);
    let mut out = [f64::MAX, f64::MIN, f64::MAX, f64::MIN];
    for v in model.mesh.live_vertices() {
        let p = pose.skin(&model.rows, v) + model.offset;
        let at = if p.x > 0.5 { 2 } else { 0 };
        out[at] = out[at].min(p.y);
        out[at + 1] = out[at + 1].max(p.y);
    }
    out
}

fn assert_heights(model: &Model, expected: [f64; 4]) {
    let found = heights(model, 0, 1.0);
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} is not {expected:?}");
}

#[test]
fn skins_over_the_same_joints_are_one() {
    let animations = [rise(1)];
    let first = model(&in_two_skins(&animations));
    let found = inspected(&first);
    assert_eq!((found.skins, first.rig.skins.len(), found.joints), (2, 1, 2));
    assert!(found.closed && found.warnings.is_empty() && found.largest_weight_difference == 0.0, "{found:?}");
    assert_heights(&first, [0.0, 1.0, 1.0, 2.0]);
    for again in trips(&first) {
        let found = inspected(&again);
        assert_eq!((found.skins, found.joints, again.rig.nodes.len()), (1, 2, first.rig.nodes.len()));
        assert!(found.closed && found.warnings.is_empty());
        assert_heights(&again, [0.0, 1.0, 1.0, 2.0]);
    }
}

#[test]
fn a_mesh_with_a_bind_space_of_its_own_shares_the_joints() {
    let animations = [rise(1)];
    for change in [DAffine3::from_scale(DVec3::new(4.0, 0.5, 2.0)), DAffine3::from_translation(DVec3::new(0.0, 8.0, 0.0))] {
        let mut scene = in_two_skins(&animations);
        scene.skins[1].joints.iter_mut().for_each(|j| j.1 *= change);
        for p in &mut scene.meshes[1].primitives[0].positions {
            *p = change.inverse().transform_point3(DVec3::from_array(p.map(f64::from))).as_vec3().to_array();
        }
        let found = model(&scene);
        assert_eq!((found.rig.skins.len(), found.rig.joints.len()), (1, 2));
        assert!(inspected(&found).closed, "powers of two: nothing is rounded");
        assert_heights(&found, [0.0, 1.0, 1.0, 2.0]);
    }
}

/// Bound otherwise at one joint: the sides meet only where the other moves them.
#[test]
fn skins_that_bind_otherwise_stay_apart_and_do_not_grow() {
    let animations = [rise(1)];
    let mut scene = in_two_skins(&animations);
    let near = scene.skins[1].joints.iter_mut().find(|j| j.0 == 0).unwrap();
    near.1 = DAffine3::from_translation(DVec3::Y * 0.25);
    let first = model(&scene);
    let found = inspected(&first);
    assert_eq!((found.skins, first.rig.skins.len(), found.joints), (2, 2, 4));
    assert_heights(&first, [0.0, 1.25, 1.0, 2.0]);
    for again in trips(&first) {
        let counts = |m: &Model| (m.rig.joints.len(), m.report.vertices_welded, m.mesh.face_count());
        assert_eq!(counts(&again), counts(&first));
        assert_eq!(inspected(&again).boundary_edges, found.boundary_edges);
        assert_heights(&again, [0.0, 1.25, 1.0, 2.0]);
    }
    let nodes: Vec<usize> = trips(&first).iter().map(|m| m.rig.nodes.len()).collect();
    assert_eq!(nodes, [nodes[0]; 3]);
}

/// Two figures with a rig each wear one mesh: in numbers all their vertices coincide.
#[test]
fn figures_that_wear_one_mesh_are_both_there() {
    for x in [0.5, 0.0] {
        let mut scene = beam_scene_parts();
        let (nodes, mut skin) = (scene.nodes.clone(), scene.skins[0].clone());
        scene.nodes.extend(nodes.into_iter().map(|n| crate::rig::Node { parent: n.parent.map(|p| p + 2), ..n }));
        let crate::rig::LocalTransform::Trs(trs) = &mut scene.nodes[2].local else { panic!() };
        trs.translation.x = x;
        skin.joints.iter_mut().for_each(|j| j.0 += 2);
        scene.skins.push(skin);
        scene.meshes.push(GlbMesh { skin: Some(1), ..scene.meshes[0].clone() });
        let found = inspected(&model(&scene));
        let expected = if x > 0.0 { (24, 2, 0) } else { (12, 1, 12) }; // the control: copies in one place
        assert_eq!((found.faces, found.components, found.duplicate_faces), expected);
        assert!(found.closed && found.joints == 4);
    }
}

/// A box half of which nothing moves: where the halves meet, a joint that stands still is written.
#[test]
fn a_joint_that_stands_still_is_written_once() {
    let animations = [rise(1)];
    let mut scene = in_two_skins(&animations);
    scene.skins.truncate(1);
    scene.meshes[1].skin = None;
    scene.meshes[1].primitives[0].bones.clear();
    scene.skins[0].joints[0].1 = DAffine3::from_translation(DVec3::Z); // so that none of its own stands still
    scene.nodes[0].local = crate::rig::LocalTransform::Matrix(DAffine3::from_translation(-DVec3::Z * 2.0));
    scene.nodes[1].local = crate::rig::LocalTransform::Matrix(DAffine3::from_translation(DVec3::new(0.5, 0.0, 2.0)));
    let first = model(&scene);
    let joints: Vec<usize> = trips(&first).iter().map(|m| m.rig.joints.len()).collect();
    assert_eq!((first.rig.joints.len(), &joints[..]), (2, &[3, 3, 3][..]));
    for again in trips(&first) {
        assert_eq!(inspected(&again).warnings.len(), 0);
        assert_eq!(heights(&again, 0, 1.0), heights(&first, 0, 1.0));
    }
}

#[test]
fn parts_that_move_as_a_whole_share_the_joints_of_a_skin() {
    let animations = [rise(1)];
    let mut scene = in_two_skins(&animations);
    scene.skins.truncate(1);
    scene.meshes[1].skin = None;
    scene.meshes[1].primitives[0].bones.clear();
    let bytes = edit_json(&glb_writer::write(&scene).unwrap(), |root| {
        root["nodes"][1]["children"] = serde_json::json!([3]);
        root["scenes"][0]["nodes"] = serde_json::json!([0, 2]);
    });
    let first = read(&bytes).unwrap();
    assert_eq!(first.rig.joints.len(), 3);
    let joints: Vec<usize> = trips(&first).iter().map(|m| m.rig.joints.len()).collect();
    assert_eq!(joints, [joints[0]; 3]);
    assert!(joints[0] <= 3);
}
