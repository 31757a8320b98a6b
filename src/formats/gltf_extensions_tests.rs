//! Laws of what glTF files ask for by extensions: read where it can be, told of where it is left out.

use super::glb_writer;
use super::import_tests::{cube, edit_json, export, read, scene};
use super::*;
use serde_json::{Value, json};

fn edited(edit: impl FnOnce(&mut Value)) -> Model {
    let mut laid = cube([0.0; 3]);
    laid.uvs = laid.positions.iter().map(|p| [p[0], p[1]]).collect();
    let mut scene = scene(vec![laid]);
    let texture = Texture { width: 1, height: 1, rgba: vec![255; 4] };
    scene.materials[0].texture = Some(std::sync::Arc::new(texture));
    let model = read(&edit_json(&glb_writer::write(&scene).unwrap(), edit)).unwrap();
    model.rig.validate().unwrap();
    model
}

/// The sums of the corners' texture coordinates.
fn laid(model: &Model) -> [f32; 2] {
    let wedges = model.mesh.live_faces().flat_map(|f| model.mesh.face_wedges(f));
    wedges.map(|w| model.mesh.wedge(w).uv).fold([0.0; 2], |[a, b], [u, v]| [a + u, b + v])
}

#[test]
fn the_control_has_nothing_to_tell() {
    let plain = edited(|_| {});
    assert!(plain.report.warnings.is_empty() && plain.materials[0].texture.is_some(), "{:?}", plain.report.warnings);
}

#[test]
fn channels_without_a_node_are_left_out() {
    for (path, required) in [("translation", json!([])), ("pointer", json!(["KHR_animation_pointer"]))] {
        let model = edited(|root| {
            let channel = json!({ "sampler": 0, "target": { "path": path } });
            root["animations"] = json!([{ "name": "none", "channels": [channel], "samplers": [{ "input": 0, "output": 0 }] }]);
            root["extensionsRequired"] = required;
        });
        assert_eq!(model.report.warnings, ["animation channels that name no node are left out"]);
        assert!(model.rig.animations[0].channels.is_empty() && model.rig.animations[0].duration_s == 0.0);
        model.rig.pose_at(Some(0), 1.0);
        assert!(read(&export(&model, &model.rig.rest_pose()).0).unwrap().report.warnings.is_empty());
    }
}

#[test]
fn textures_without_a_picture_are_told_of() {
    for name in ["KHR_texture_basisu", "EXT_texture_webp"] {
        let by_extension = json!({ "extensions": { name: { "source": 0 } } });
        let gone = edited(|root| root["textures"][0] = by_extension.clone());
        let told = &gone.report.warnings;
        assert!(gone.materials[0].texture.is_none() && told.len() == 1 && told[0].contains(name), "{told:?}");
        let kept = edited(|root| root["textures"][0]["extensions"] = by_extension["extensions"].clone());
        assert!(kept.materials[0].texture.is_some() && kept.report.warnings.is_empty(), "a plain picture is there too");
    }
    let none = edited(|root| root["textures"][0] = json!({}));
    assert_eq!(none.report.warnings, ["texture 0 is left out: the file has no picture for it"]);
}

#[test]
fn instances_are_told_of() {
    let model = edited(|root| {
        root["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 0 } } });
    });
    let told = &model.report.warnings;
    assert!(told.len() == 1 && told[0].contains("EXT_mesh_gpu_instancing"), "{told:?}");
}

#[test]
fn texture_transforms_are_applied() {
    let with = |value: Value| {
        edited(|root| {
            let texture = &mut root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
            assert!(texture.is_object());
            texture["extensions"] = json!({ "KHR_texture_transform": value });
            // a second set of coordinates, all zero
            let accessors = root["accessors"].as_array_mut().unwrap();
            accessors.push(json!({ "componentType": 5126, "count": 24, "type": "VEC2" }));
            let last = accessors.len() - 1;
            root["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = json!(last);
        })
    };
    let [u, v] = laid(&edited(|_| {}));
    let corners = 36.0;
    let close = |found: [f32; 2], expected: [f32; 2]| {
        assert!((0..2).all(|k| (found[k] - expected[k]).abs() < 1e-4), "{found:?} is not {expected:?}");
    };
    close(laid(&with(json!({}))), [u, v]);
    let moved = with(json!({ "offset": [0.5, 0.25], "scale": [2, 3] }));
    assert!(moved.report.warnings.is_empty());
    close(laid(&moved), [2.0 * u + 0.5 * corners, 3.0 * v + 0.25 * corners]);
    close(laid(&with(json!({ "rotation": std::f64::consts::FRAC_PI_2, "scale": [2, 3] }))), [3.0 * v, -2.0 * u]);
    close(laid(&with(json!({ "offset": [0.5, 0.25], "texCoord": 1 }))), [0.5 * corners, 0.25 * corners]);
    let unread = with(json!({ "scale": "large" }));
    assert!(unread.report.warnings.len() == 1 && unread.report.warnings[0].contains("KHR_texture_transform"));
    close(laid(&unread), [u, v]);
}
