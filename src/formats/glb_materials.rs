//! Materials of a written glTF file, with the textures, samplers and images that they name: each once, however many use it.

use super::FormatError;
use super::gltf_extensions::texture_infos;
use super::material::{AlphaMode, Finish, Material, Picture, Sampler, Texture, encode_png};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::sync::Arc;

/// These arrays of the file, and the extensions that they use.
#[derive(Debug, Default)]
pub(crate) struct Looks {
    pub materials: Vec<Value>,
    pub textures: Vec<Value>,
    pub samplers: Vec<Value>,
    pub images: Vec<Value>,
    pub extensions: BTreeSet<String>,
}

/// What an image is made from.
#[derive(Clone, Copy, PartialEq)]
enum Source<'a> {
    Encoded(&'a Arc<Picture>),
    Pixels(&'a Arc<Texture>),
}

/// Collects textures as materials ask for them.
#[derive(Default)]
struct Textures<'a> {
    sources: Vec<Source<'a>>,
    textures: Vec<(usize, Sampler)>,
}

impl<'a> Textures<'a> {
    fn number(&mut self, source: Source<'a>, sampler: Sampler) -> usize {
        let image = place(&mut self.sources, source);
        place(&mut self.textures, (image, sampler))
    }
}

/// Where a value is in a list; it is appended if it is not there.
fn place<T: PartialEq>(list: &mut Vec<T>, value: T) -> usize {
    let known = list.iter().position(|v| *v == value);
    known.unwrap_or_else(|| {
        list.push(value);
        list.len() - 1
    })
}

/// Lists materials; `store` puts an encoded picture into the file and returns its buffer view.
pub(crate) fn write(materials: &[Material], mut store: impl FnMut(&[u8]) -> usize) -> Result<Looks, FormatError> {
    let (mut looks, mut textures) = (Looks::default(), Textures::default());
    for material in materials {
        looks.materials.push(written(material, &mut textures, &mut looks.extensions));
    }
    for source in textures.sources {
        let (view, mime_type) = match source {
            Source::Encoded(picture) => (store(picture.bytes()), picture.mime_type()),
            Source::Pixels(texture) => {
                let png = encode_png(texture).map_err(|detail| FormatError::Encode { detail })?;
                (store(&png), "image/png")
            }
        };
        looks.images.push(json!({ "bufferView": view, "mimeType": mime_type }));
    }
    let mut samplers = Vec::new();
    for (image, sampler) in textures.textures {
        let mut texture = json!({ "source": image });
        if sampler != Sampler::default() {
            texture["sampler"] = json!(place(&mut samplers, sampler)); // one that asks for nothing is not written
        }
        looks.textures.push(texture);
    }
    looks.samplers = samplers.into_iter().map(sampler).collect();
    Ok(looks)
}

fn written<'a>(material: &'a Material, textures: &mut Textures<'a>, extensions: &mut BTreeSet<String>) -> Value {
    let base = material.texture.as_ref().map(|texture| {
        let source = texture.encoded.as_ref().map_or(Source::Pixels(texture), Source::Encoded);
        textures.number(source, material.sampler)
    });
    let mut value = match &material.finish {
        Some(finish) => finished(finish, textures, extensions),
        None => json!({ "pbrMetallicRoughness": Finish::plain_factors() }),
    };
    let pbr = &mut value["pbrMetallicRoughness"];
    pbr["baseColorFactor"] = json!(material.base_colour);
    if let Some(index) = base {
        pbr["baseColorTexture"] = json!({ "index": index });
    }
    value["doubleSided"] = json!(material.double_sided);
    match material.alpha {
        AlphaMode::Opaque => {}
        AlphaMode::Mask(cutoff) => {
            value["alphaMode"] = json!("MASK");
            value["alphaCutoff"] = json!(cutoff);
        }
        AlphaMode::Blend => value["alphaMode"] = json!("BLEND"),
    }
    if !material.name.is_empty() {
        value["name"] = json!(material.name);
    }
    value
}

/// A finish with the file's numbers of its textures.
fn finished<'a>(finish: &'a Finish, textures: &mut Textures<'a>, extensions: &mut BTreeSet<String>) -> Value {
    let mut value = Value::Object(finish.json.clone());
    let _: Result<(), ()> = texture_infos(&mut value, &mut |info| {
        let map = info.get("index").and_then(Value::as_u64).and_then(|i| finish.maps.get(i as usize));
        if let Some(map) = map {
            info.insert("index".into(), textures.number(Source::Encoded(&map.picture), map.sampler).into());
        }
        extensions.extend(names(info.get("extensions")));
        Ok(())
    });
    extensions.extend(names(value.get("extensions")));
    value
}

fn names(extensions: Option<&Value>) -> impl Iterator<Item = String> {
    extensions.and_then(Value::as_object).into_iter().flat_map(|e| e.keys().cloned())
}

fn sampler(sampler: Sampler) -> Value {
    let mut value = json!({ "wrapS": sampler.wrap[0], "wrapT": sampler.wrap[1] });
    for (key, filter) in [("magFilter", sampler.magnified), ("minFilter", sampler.minified)] {
        if let Some(filter) = filter {
            value[key] = json!(filter);
        }
    }
    value
}
