//! Laws of what glTF files ask for by extensions: read where it can be, told of where it is left out.

use super::glb_writer;
use super::import_tests::{cube, edit_json, export, read, scene};
use super::*;
use serde_json::{Value, json};

fn edited(edit: impl FnOnce(&mut Value)) -> Model {
    let mut laid = cube([0.0; 3]);
    laid.uvs = laid.positions.iter().map(|p| [p[0], p[1]]).collect();
    let mut scene = scene(vec![laid]);
    let texture = Texture { width: 1, height: 1, rgba: vec![255; 4], encoded: None };
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
        let whole = "animations are left out of which nothing that they move is read: none";
        assert_eq!(model.report.warnings, ["animation channels that name no node are left out", whole]);
        assert!(model.rig.animations.is_empty(), "nothing that would play for 0 s");
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

/// A morph target's weight that goes from 0 to 1 in 2 s, alone or beside a node that is raised in 1 s.
#[test]
fn animations_of_morph_targets_alone_are_told_of() {
    for beside in [false, true] {
        let model = edited(|root| {
            let accessors = root["accessors"].as_array_mut().unwrap();
            let first = accessors.len();
            accessors.push(json!({ "componentType": 5126, "count": 24, "type": "VEC3" }));
            for (count, kind) in [(2, "SCALAR"), (2, "VEC3")] {
                accessors.push(json!({ "componentType": 5126, "count": count, "type": kind }));
            }
            root["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": first }]);
            let channel =
                |path: &str| json!({ "sampler": usize::from(path != "weights"), "target": { "node": 0, "path": path } });
            let samplers = json!([{ "input": first + 1, "output": first + 1 }, { "input": first + 1, "output": first + 2 }]);
            let channels = if beside { json!([channel("weights"), channel("translation")]) } else { json!([channel("weights")]) };
            root["animations"] = json!([{ "name": "blink", "channels": channels, "samplers": samplers }]);
        });
        let told = &model.report.warnings;
        assert_eq!((model.rig.animations.len(), told.len()), if beside { (1, 1) } else { (0, 2) }, "{told:?}");
        assert!(told.iter().any(|w| w == "morph targets are left out"));
        assert!(beside || told[1].ends_with("is read: blink"), "{told:?}");
    }
}

#[test]
fn what_alpha_means_and_how_pictures_are_looked_up_is_kept() {
    let model = edited(|root| {
        root["samplers"] = json!([
            { "wrapS": 33071, "wrapT": 33648, "magFilter": 9728, "minFilter": 9985 },
            { "wrapS": 7, "magFilter": 7 },
            {},
        ]);
        root["textures"] = json!([{ "source": 0, "sampler": 0 }, { "source": 0, "sampler": 1 }, { "source": 0 }]);
        let material = |texture: usize, more: Value| {
            let mut material = more;
            material["pbrMetallicRoughness"] = json!({ "baseColorTexture": { "index": texture } });
            material
        };
        root["materials"] = json!([
            material(0, json!({ "alphaMode": "MASK", "alphaCutoff": 0.25 })),
            material(0, json!({ "alphaMode": "MASK" })),
            material(1, json!({ "alphaMode": "BLEND" })),
            material(2, json!({ "alphaMode": "OPAQUE", "alphaCutoff": 0.25 })),
        ]);
        let primitives = root["meshes"][0]["primitives"].as_array_mut().unwrap();
        for material in 1..4 {
            let mut other = primitives[0].clone();
            other["material"] = json!(material);
            primitives.push(other);
        }
    });
    let sampled = Sampler { magnified: Some(9728), minified: Some(9985), wrap: [33071, 33648] };
    let expected = [
        (AlphaMode::Mask(0.25), sampled),
        (AlphaMode::Mask(0.5), sampled),
        (AlphaMode::Blend, Sampler::default()),
        (AlphaMode::Opaque, Sampler::default()),
    ];
    let told = |m: &Model| m.materials.iter().map(|m| (m.alpha, m.sampler)).collect::<Vec<_>>();
    assert_eq!(told(&model), expected);
    let bytes = export(&model, &model.rig.rest_pose()).0;
    let mut root = Value::Null;
    edit_json(&bytes, |json| root = json.clone());
    assert_eq!([&root["images"], &root["textures"], &root["samplers"]].map(|a| a.as_array().unwrap().len()), [1, 2, 1]);
    let again = read(&bytes).unwrap();
    assert_eq!(told(&again), expected);
    assert_eq!(again.materials, model.materials);
}

#[test]
fn compressed_meshes_are_told_of_as_such() {
    let refused = |edit: &dyn Fn(&mut Value)| {
        let bytes = edit_json(&glb_writer::write(&scene(vec![cube([0.0; 3])])).unwrap(), |root| edit(root));
        read(&bytes).err().map(|error| error.to_string())
    };
    // as gltfpack writes it: the buffer that the views name has no data
    let error = refused(&|root| {
        root["extensionsRequired"] = json!(["KHR_mesh_quantization", "EXT_meshopt_compression"]);
        root["buffers"].as_array_mut().unwrap().push(json!({ "byteLength": 64 }));
    });
    assert!(error.as_ref().is_some_and(|e| e.contains("EXT_meshopt_compression")), "{error:?}");
    let compressed = |root: &mut Value| {
        root["meshes"][0]["primitives"][0]["extensions"] = json!({ "KHR_draco_mesh_compression": { "bufferView": 0 } });
    };
    assert_eq!(refused(&compressed), None, "the plain form is there too");
    let error = refused(&|root| {
        compressed(root);
        for accessor in root["accessors"].as_array_mut().unwrap() {
            accessor.as_object_mut().unwrap().remove("bufferView");
        }
    });
    assert!(error.as_ref().is_some_and(|e| e.contains("KHR_draco_mesh_compression")), "{error:?}");
}
