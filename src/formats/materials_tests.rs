//! Laws of materials from file to file: what is not base colour passes through, or is told of.

use super::glb_writer;
use super::import_tests::{cube, edit_json, export, read, scene};
use super::*;
use serde_json::{Value, json};
use std::sync::Arc;

fn pixel(grey: u8) -> Texture {
    Texture { width: 1, height: 1, rgba: vec![grey, grey, grey, 255], encoded: None }
}

fn jpeg() -> Vec<u8> {
    let mut out = Vec::new();
    image::codecs::jpeg::JpegEncoder::new(&mut out).encode(&[9, 99, 199], 1, 1, image::ExtendedColorType::Rgb8).unwrap();
    out
}

/// A file of a cube with texture coordinates in sets 0 and 1, four textures, of which 3 is a JPEG, and materials of this JSON.
fn file(materials: Value) -> Vec<u8> {
    let mut laid = cube([0.0; 3]);
    laid.uvs = laid.positions.iter().map(|p| [p[0], p[1] + 0.25 * p[2]]).collect();
    let mut scene = scene(vec![laid]);
    let mut last = pixel(3);
    last.encoded = Some(Arc::new(Picture::new(jpeg()).unwrap()));
    let pixels = [pixel(0), pixel(1), pixel(2), last];
    scene.materials =
        pixels.into_iter().map(|texture| Material { texture: Some(Arc::new(texture)), ..Material::default() }).collect();
    edit_json(&glb_writer::write(&scene).unwrap(), |root| {
        root["samplers"] = json!([{ "wrapS": 33071, "wrapT": 33071 }]);
        root["textures"][1]["sampler"] = json!(0);
        let primitives = root["meshes"][0]["primitives"].as_array_mut().unwrap();
        primitives[0]["attributes"]["TEXCOORD_1"] = primitives[0]["attributes"]["TEXCOORD_0"].clone();
        for material in 1..materials.as_array().unwrap().len() {
            primitives.push(primitives[0].clone());
            primitives[material]["material"] = json!(material);
        }
        root["materials"] = materials;
    })
}

/// A file's JSON, and the bytes of its images.
fn opened(bytes: &[u8]) -> (Value, Vec<Vec<u8>>) {
    let mut root = Value::Null;
    edit_json(bytes, |json| root = json.clone());
    let start = 28 + u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let image = |image: &Value| {
        let view = &root["bufferViews"][image["bufferView"].as_u64().unwrap() as usize];
        let [at, length] = ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap() as usize);
        bytes[start + at..start + at + length].to_vec()
    };
    let images = root["images"].as_array().into_iter().flatten().map(image).collect();
    (root, images)
}

/// The only material after a way in and out, and what was told on it.
fn passed(material: Value) -> (Value, Vec<String>) {
    let model = read(&file(json!([material]))).unwrap();
    let (root, _) = opened(&export(&model, &model.rig.rest_pose()).0);
    (root["materials"][0].clone(), model.report.warnings)
}

#[test]
fn a_material_passes_through_whole() {
    let whole = json!({
        "name": "skin", "doubleSided": true, "extras": { "of": "a shop" },
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.25, 1.0, 1.0], "baseColorTexture": { "index": 0 },
            "metallicFactor": 0.1, "roughnessFactor": 0.7, "metallicRoughnessTexture": { "index": 1 },
        },
        "normalTexture": { "index": 2, "scale": 0.3 },
        "occlusionTexture": { "index": 1, "strength": 0.9 },
        "emissiveTexture": { "index": 3 }, "emissiveFactor": [0.1, 0.2, 0.3],
        "extensions": {
            "KHR_materials_emissive_strength": { "emissiveStrength": 5.0 },
            "KHR_materials_clearcoat": {
                "clearcoatFactor": 0.4, "clearcoatTexture": { "index": 2 },
                "clearcoatNormalTexture": { "index": 2, "scale": 2.0, "extensions": { "KHR_texture_transform": { "scale": [2.0, 3.0] } } },
            },
        },
    });
    let plain = json!({ "doubleSided": false, "pbrMetallicRoughness": { "baseColorFactor": [1.0, 1.0, 1.0, 1.0] } });
    let bytes = file(json!([whole, whole, plain]));
    let model = read(&bytes).unwrap();
    assert!(model.report.warnings.is_empty(), "{:?}", model.report.warnings);
    let exported = export(&model, &model.rig.rest_pose()).0;
    let ((before, images), (after, kept)) = (opened(&bytes), opened(&exported));
    let used = |root: &Value| root["extensionsUsed"].clone();
    let index = |key: &str| after["materials"][0][key]["index"].as_u64().unwrap() as usize;
    let picture = |key: &str| &kept[after["textures"][index(key)]["source"].as_u64().unwrap() as usize];
    assert_eq!((picture("normalTexture"), picture("occlusionTexture")), (&images[2], &images[1]));
    assert_eq!((picture("emissiveTexture"), kept.len(), images.len()), (&jpeg(), 4, 4));
    let emissive = &after["images"][after["textures"][index("emissiveTexture")]["source"].as_u64().unwrap() as usize];
    assert_eq!(emissive["mimeType"], "image/jpeg");
    assert_eq!(after["textures"][index("occlusionTexture")]["sampler"], 0);
    let blank = |mut value: Value| {
        let mut blank = |info: &mut serde_json::Map<String, Value>| -> Result<(), ()> {
            info.insert("index".into(), Value::Null);
            Ok(())
        };
        gltf_extensions::texture_infos(&mut value, &mut blank).unwrap();
        value
    };
    assert_eq!(blank(after["materials"][0].clone()), blank(before["materials"][0].clone()));
    assert_eq!(after["materials"].as_array().unwrap().len(), 2, "two that are equal are one");
    assert_eq!(after["materials"][1], plain, "and gains nothing: by the specification it is metal");
    let all = ["KHR_materials_clearcoat", "KHR_materials_emissive_strength", "KHR_texture_transform"];
    assert_eq!(used(&after), json!(all));
    let again = read(&exported).unwrap();
    assert_eq!(again.materials, [0, 2].map(|i| model.materials[i].clone()));
    assert_eq!(export(&again, &again.rig.rest_pose()).0, exported);
}

#[test]
fn what_has_no_finish_is_written_as_no_metal() {
    let (root, _) = opened(&glb_writer::write(&scene(vec![cube([0.0; 3])])).unwrap());
    let pbr = &root["materials"][0]["pbrMetallicRoughness"];
    assert_eq!((&pbr["metallicFactor"], &pbr["roughnessFactor"]), (&json!(0.0), &json!(0.6)));
    let none = read(&edit_json(&glb_writer::write(&scene(vec![cube([0.0; 3])])).unwrap(), |root| {
        root["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("material");
        root.as_object_mut().unwrap().remove("materials");
    }));
    let none = none.unwrap();
    let (root, _) = opened(&export(&none, &none.rig.rest_pose()).0);
    let pbr = &root["materials"][0]["pbrMetallicRoughness"];
    assert!(pbr.get("metallicFactor").is_none(), "a face without a material is metal in glTF: {pbr}");
}

/// A texture that goes takes along what is nothing without it: factors alone would make all metal, alight or glass.
#[test]
fn other_texture_coordinates_are_told_of() {
    let other = json!({ "index": 1, "texCoord": 1 });
    let material = json!({
        "name": "m",
        "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "metallicFactor": 0.9, "metallicRoughnessTexture": other },
        "normalTexture": { "index": 2 }, "occlusionTexture": other, "emissiveTexture": other, "emissiveFactor": [1.0, 1.0, 1.0],
        "extensions": {
            "KHR_materials_emissive_strength": { "emissiveStrength": 5.0 },
            "KHR_materials_transmission": { "transmissionFactor": 1.0, "transmissionTexture": other },
            "KHR_materials_volume": { "thicknessFactor": 1.0, "thicknessTexture": { "index": 3 } },
            "KHR_materials_dispersion": { "dispersion": 0.1 },
            "KHR_materials_ior": { "ior": 1.4 },
            "VENDOR_materials": { "node": 0 },
        },
    });
    let (found, told) = passed(material.clone());
    let expected = json!({
        "name": "m", "doubleSided": false, "normalTexture": { "index": 1 },
        "pbrMetallicRoughness": {
            "baseColorFactor": [1.0, 1.0, 1.0, 1.0], "baseColorTexture": { "index": 0 }, "metallicFactor": 0.0, "roughnessFactor": 0.6,
        },
        "extensions": { "KHR_materials_ior": { "ior": 1.4 } },
    });
    assert_eq!(found["extensions"], expected["extensions"]);
    let mut found = found;
    let [base, normal] =
        [&found["pbrMetallicRoughness"]["baseColorTexture"], &found["normalTexture"]].map(|t| t["index"].as_u64().unwrap());
    assert_ne!(base, normal);
    found["pbrMetallicRoughness"]["baseColorTexture"]["index"] = json!(0);
    found["normalTexture"]["index"] = json!(1);
    assert_eq!(found, expected);
    let reason = "of material \"m\" is left out, as its texture coordinates are not those that are kept";
    for what in ["metallicRoughnessTexture", "occlusionTexture", "emissiveTexture", "KHR_materials_transmission"] {
        assert!(told.contains(&format!("{what} {reason}")), "{what}: {told:?}");
    }
    for what in ["KHR_materials_volume of", "KHR_materials_dispersion of", "KHR_materials_emissive_strength of", "VENDOR_"] {
        assert!(told.iter().any(|t| t.starts_with(what)), "{what}: {told:?}");
    }
    assert_eq!(told.len(), 8, "{told:?}");
    // without base colour, the set that most have is kept
    let mut without = material;
    without["pbrMetallicRoughness"].as_object_mut().unwrap().remove("baseColorTexture");
    let (found, told) = passed(without);
    assert!(found.get("normalTexture").is_none() && found["occlusionTexture"].is_object(), "{found}");
    assert!(found["pbrMetallicRoughness"]["metallicFactor"] == 0.9 && found["emissiveFactor"] == json!([1.0, 1.0, 1.0]));
    assert!(found["occlusionTexture"].get("texCoord").is_none() && told.len() == 4, "{told:?}");
}

/// The base colour's transform is baked into the coordinates that are kept: other textures' are told relative to it.
#[test]
fn textures_lie_where_they_lay() {
    let laid = |base: Value, own: Value| {
        let with =
            |index: usize, transform: &Value| json!({ "index": index, "extensions": { "KHR_texture_transform": transform } });
        let base_colour = json!({ "baseColorTexture": with(0, &base) });
        let material = json!({ "pbrMetallicRoughness": base_colour, "normalTexture": with(1, &own) });
        let model = read(&file(json!([material]))).unwrap();
        let (root, _) = opened(&export(&model, &model.rig.rest_pose()).0);
        let normal = root["materials"][0]["normalTexture"].clone();
        let used = root.get("extensionsUsed").is_some();
        assert_eq!(used, normal.pointer("/extensions/KHR_texture_transform").is_some());
        (normal, model.report.warnings)
    };
    let scaled = json!({ "scale": [4.0, 2.0], "offset": [0.5, 0.0] });
    let same = laid(scaled.clone(), scaled.clone());
    assert!(same.0.is_object() && same.0.get("extensions").is_none() && same.1.is_empty(), "{same:?}");
    let plain = laid(scaled.clone(), json!({}));
    assert_eq!(plain.0["extensions"]["KHR_texture_transform"], json!({ "scale": [0.25, 0.5], "offset": [-0.125, 0.0] }));
    let alone = laid(json!({}), json!({ "rotation": 0.7, "scale": [-1.0, 2.0] }));
    assert_eq!(alone.0["extensions"]["KHR_texture_transform"], json!({ "rotation": 0.7, "scale": [-1.0, 2.0] }));
    for (base, own) in [(json!({ "rotation": 0.7, "scale": [4, 2] }), json!({})), (json!({ "scale": [0, 1] }), json!({}))] {
        let (gone, told) = laid(base, own);
        assert!(gone.is_null() && told.len() == 1 && told[0].contains("KHR_texture_transform"), "{told:?}");
    }
    let sets = laid(json!({ "texCoord": 1 }), json!({ "texCoord": 1 }));
    assert!(sets.0.is_object() && sets.1.is_empty(), "{sets:?}");
    let (gone, told) = laid(json!({ "texCoord": 1 }), json!({}));
    assert!(gone.is_null() && told.len() == 1, "{told:?}");
}

/// Coordinates of all zero are left out, but not where a texture needs some.
#[test]
fn what_is_textured_has_texture_coordinates() {
    let normal = json!({ "index": 1 });
    for (material, expected) in [(json!({ "normalTexture": normal }), true), (json!({}), false)] {
        let bare = edit_json(&file(json!([material])), |root| {
            let attributes = root["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap();
            attributes.retain(|key, _| !key.starts_with("TEXCOORD"));
        });
        let model = read(&bare).unwrap();
        let (root, _) = opened(&export(&model, &model.rig.rest_pose()).0);
        let has = root["meshes"][0]["primitives"][0]["attributes"].get("TEXCOORD_0").is_some();
        assert_eq!(has, expected);
    }
}

#[test]
fn pictures_that_are_none_are_told_of_once() {
    let normal = json!({ "normalTexture": { "index": 1 } });
    let broken = edit_json(&file(json!([normal, normal])), |root| {
        let view = root["images"][1]["bufferView"].as_u64().unwrap() as usize;
        root["bufferViews"][view]["byteLength"] = json!(12);
    });
    let model = read(&broken).unwrap();
    let told = &model.report.warnings;
    assert!(told.len() == 3 && told[0].starts_with("image 1 is left out"), "{told:?}");
    assert!(told[1].starts_with("normalTexture of material 0") && told[2].starts_with("normalTexture of material 1"), "{told:?}");
    assert!(Picture::new(b"GIF89a\x01\x00\x01\x00\x00\x00\x00;".to_vec()).is_err() && Picture::new(Vec::new()).is_err());
    assert_eq!(Picture::new(jpeg()).unwrap().mime_type(), "image/jpeg");
}
