//! Laws of which way a model faces and where it stands.

use super::glb_writer::{self, GlbScene};
use super::import_tests::{beam_scene_parts, export, inspected, model, read};
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
                    let nearest = found.mesh.live_vertices().map(|u| posed(found, &pose, u).distance(expected));
                    assert!(nearest.fold(f64::MAX, f64::min) < 1e-6 * size, "{what}, {scale} at {t}: it moves as before");
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
