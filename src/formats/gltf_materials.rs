//! Materials of a glTF file. Base colour is read for the tissue pass; what else the file says of a material passes through as it
//! stands ([`Finish`]), for files that go out, with its pictures as they were encoded.

use super::gltf_data::{Document, read_uri};
use super::gltf_extensions::{TextureInfo, TextureTransform, texture_infos};
use super::gltf_rig::warn_once;
use super::material::{AlphaMode, Finish, Map, Material, Picture, Sampler, Texture, decode};
use gltf::json;
use json::validation::Checked;
use serde_json::{Map as Object, Value};
use std::path::Path;
use std::sync::Arc;

/// Extensions of a material that mean nothing without one of others.
const NEEDS: [(&str, &[&str]); 3] = [
    ("KHR_materials_emissive_strength", &["emissiveFactor"]),
    ("KHR_materials_volume", &["KHR_materials_transmission", "KHR_materials_diffuse_transmission"]),
    ("KHR_materials_dispersion", &["KHR_materials_volume"]),
];

/// The texture coordinates that the surface of a material keeps: one set, as its base colour texture is laid.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Laid {
    pub uv_set: u32,
    /// Baked into them.
    pub transform: Option<TextureTransform>,
}

/// How a material is laid. Without a base colour texture, by the set that most of its other textures have.
fn laid(document: &Document, material: usize, warnings: &mut Vec<String>) -> Laid {
    if let Some(info) = document.extensions.base_colour(material) {
        let transform = info.transform(warnings);
        return Laid { uv_set: info.uv_set(transform), transform };
    }
    let mut sets = Vec::new();
    let mut raw = document.extensions.material(material).clone();
    let _ = texture_infos(&mut raw, &mut |info| -> Result<(), ()> {
        let info = TextureInfo(info);
        sets.push(info.uv_set(info.transform(&mut Vec::new())));
        Ok(())
    });
    let users = |set: u32| sets.iter().filter(|s| **s == set).count();
    let most = sets.iter().copied().max_by_key(|&set| (users(set), std::cmp::Reverse(set)));
    Laid { uv_set: most.unwrap_or(0), transform: None }
}

/// All materials of the file, in its order, and how each is laid; what cannot be kept is left out with a warning.
pub(crate) fn read(document: &Document, folder: Option<&Path>, warnings: &mut Vec<String>) -> (Vec<Material>, Vec<Laid>) {
    let images = document.root.images.len();
    let mut reader = Reader { document, folder, warnings, pictures: vec![None; images], decoded: vec![None; images] };
    (0..document.root.materials.len()).map(|material| reader.material(material)).unzip()
}

struct Reader<'a> {
    document: &'a Document<'a>,
    folder: Option<&'a Path>,
    warnings: &'a mut Vec<String>,
    /// Each image once it was asked for: as it is encoded, and as pixels; `None` in it where it cannot be used.
    pictures: Vec<Option<Option<Arc<Picture>>>>,
    decoded: Vec<Option<Option<Arc<Texture>>>>,
}

impl Reader<'_> {
    fn material(&mut self, number: usize) -> (Material, Laid) {
        let material = &self.document.root.materials[number];
        let pbr = &material.pbr_metallic_roughness;
        let base = pbr.base_color_texture.as_ref().map(|info| info.index.value());
        let texture = base.and_then(|index| self.image(index)).and_then(|image| self.pixels(image));
        let laid = laid(self.document, number, self.warnings);
        let material = Material {
            name: material.name.clone().unwrap_or_default(),
            base_colour: pbr.base_color_factor.0.map(|c| if c.is_finite() { c } else { 1.0 }),
            texture,
            sampler: base.map(|index| self.sampler(index)).unwrap_or_default(),
            alpha: alpha(material),
            double_sided: material.double_sided,
            finish: Some(Arc::new(self.finish(number, laid))),
        };
        (material, laid)
    }

    /// The image of a texture.
    fn image(&mut self, texture: usize) -> Option<usize> {
        let root = &self.document.root;
        let image = root.textures.get(texture).map(|t| t.source.value()).filter(|&image| image < root.images.len());
        if image.is_none() {
            let warning = match self.document.extensions.of_picture(texture) {
                Some(name) => format!("textures whose pictures only {name} gives are left out"),
                None => format!("texture {texture} is left out: the file has no picture for it"),
            };
            warn_once(self.warnings, &warning);
        }
        image
    }

    fn sampler(&self, texture: usize) -> Sampler {
        let root = &self.document.root;
        let named = root.textures.get(texture).and_then(|t| t.sampler);
        named.and_then(|s| root.samplers.get(s.value())).map(sampler).unwrap_or_default()
    }

    fn picture(&mut self, image: usize) -> Option<Arc<Picture>> {
        if self.pictures[image].is_none() {
            let read = read_picture(self.document, image, self.folder);
            self.pictures[image] = Some(self.usable(image, read));
        }
        self.pictures[image].clone().flatten()
    }

    fn pixels(&mut self, image: usize) -> Option<Arc<Texture>> {
        if self.decoded[image].is_none() {
            let read = self.picture(image).map(decode);
            self.decoded[image] = Some(read.and_then(|read| self.usable(image, read)));
        }
        self.decoded[image].clone().flatten()
    }

    fn usable<T>(&mut self, image: usize, read: Result<T, String>) -> Option<Arc<T>> {
        let warn = |error| self.warnings.push(format!("image {image} is left out: {error}"));
        read.map(Arc::new).map_err(warn).ok()
    }

    /// What the file says of a material besides base colour, alpha and sides.
    fn finish(&mut self, number: usize, laid: Laid) -> Finish {
        let raw = self.document.extensions.material(number);
        let mut keep = Keep { reader: self, laid, label: label(raw, number), maps: Vec::new(), lost: Vec::new() };
        let pbr = raw.get("pbrMetallicRoughness").unwrap_or(&Value::Null);
        let mut pbr = parts(pbr, &["metallicFactor", "roughnessFactor", "metallicRoughnessTexture", "extras"]);
        // factors are nothing without their texture: all metal, or all alight
        if !keep.texture(&mut pbr, "metallicRoughnessTexture") {
            pbr = Finish::plain_factors();
        }
        let kept = ["normalTexture", "occlusionTexture", "emissiveTexture", "emissiveFactor", "extras"];
        let mut json = parts(raw, &kept);
        keep.texture(&mut json, "normalTexture");
        keep.texture(&mut json, "occlusionTexture");
        if !keep.texture(&mut json, "emissiveTexture") {
            json.remove("emissiveFactor");
            keep.lost.push("emissiveFactor".into());
        }
        let extensions = keep.extensions(raw);
        let maps = keep.maps;
        for (key, value) in [("pbrMetallicRoughness", pbr), ("extensions", extensions)] {
            if !value.is_empty() {
                json.insert(key.into(), Value::Object(value));
            }
        }
        Finish { json, maps }
    }
}

/// What a material keeps.
struct Keep<'a, 'b> {
    reader: &'a mut Reader<'b>,
    laid: Laid,
    label: String,
    maps: Vec<Map>,
    /// Extensions, and factors that extensions need.
    lost: Vec<String>,
}

impl Keep<'_, '_> {
    /// Makes a texture of an object one of `maps`; false if it was one and had to go.
    fn texture(&mut self, object: &mut Object<String, Value>, key: &str) -> bool {
        let Some(Value::Object(info)) = object.get_mut(key) else { return true };
        let kept = self.map(info);
        if let Err(why) = kept {
            self.tell(key, why);
            object.remove(key);
        }
        kept.is_ok()
    }

    fn tell(&mut self, what: &str, why: &str) {
        warn_once(self.reader.warnings, &format!("{what} of {} is left out, as {why}", self.label));
    }

    /// Makes `index` that of one of `maps`, and the texture's transform one of coordinates as they are kept.
    fn map(&mut self, info: &mut Object<String, Value>) -> Result<(), &'static str> {
        let index = info.get("index").and_then(Value::as_u64).and_then(|i| usize::try_from(i).ok());
        let index = index.ok_or("it names no texture")?;
        let asked = TextureInfo(info);
        let transform = asked.transform(self.reader.warnings);
        if asked.uv_set(transform) != self.laid.uv_set {
            return Err("its texture coordinates are not those that are kept");
        }
        let relative = TextureTransform::relative(transform, self.laid.transform);
        let relative = relative.ok_or("its KHR_texture_transform does not go with that of the base colour")?;
        let picture = self.reader.image(index).and_then(|image| self.reader.picture(image)).ok_or("its picture is")?;
        let map = Map { picture, sampler: self.reader.sampler(index) };
        let known = self.maps.iter().position(|m| *m == map);
        info.insert("index".into(), known.unwrap_or(self.maps.len()).into());
        self.maps.extend(known.is_none().then_some(map));
        info.remove("texCoord");
        info.remove("extensions");
        if let Some(extensions) = relative.extensions() {
            info.insert("extensions".into(), extensions);
        }
        Ok(())
    }

    /// Those of Khronos, whose numbers are all of textures; others might name anything of the file.
    fn extensions(&mut self, raw: &Value) -> Object<String, Value> {
        let mut kept = Object::new();
        for (name, value) in raw.get("extensions").and_then(Value::as_object).into_iter().flatten() {
            if !name.starts_with("KHR_materials_") || !value.is_object() {
                warn_once(self.reader.warnings, &format!("{name} of materials is left out"));
                continue;
            }
            let (mut value, before) = (value.clone(), self.maps.len());
            value.as_object_mut().and_then(|v| v.remove("extensions"));
            if let Err(why) = texture_infos(&mut value, &mut |info| self.map(info)) {
                self.maps.truncate(before);
                self.tell(name, why);
                self.lost.push(name.clone());
                continue;
            }
            kept.insert(name.clone(), value);
        }
        for (name, needs) in NEEDS {
            let gone = needs.iter().any(|n| self.lost.iter().any(|l| l == n)) && !needs.iter().any(|n| kept.contains_key(*n));
            if gone && kept.remove(name).is_some() {
                self.tell(name, "what it belongs to is");
                self.lost.push(name.into());
            }
        }
        kept
    }
}

/// The members of these names that are something.
fn parts(object: &Value, names: &[&str]) -> Object<String, Value> {
    let found = names.iter().filter_map(|&name| Some((name.to_string(), object.get(name)?.clone())));
    found.filter(|(_, value)| !value.is_null()).collect()
}

fn label(material: &Value, number: usize) -> String {
    match material.get("name").and_then(Value::as_str) {
        Some(name) => format!("material \"{name}\""),
        None => format!("material {number}"),
    }
}

/// What a material says about alpha; opaque where that is unknown.
fn alpha(material: &json::Material) -> AlphaMode {
    match material.alpha_mode {
        Checked::Valid(json::material::AlphaMode::Mask) => AlphaMode::Mask(material.alpha_cutoff.unwrap_or_default().0),
        Checked::Valid(json::material::AlphaMode::Blend) => AlphaMode::Blend,
        _ => AlphaMode::Opaque,
    }
}

/// A sampler without what is unknown in it.
fn sampler(sampler: &json::texture::Sampler) -> Sampler {
    let wrap = [sampler.wrap_s, sampler.wrap_t].map(|wrap| match wrap {
        Checked::Valid(wrap) => wrap.as_gl_enum(),
        Checked::Invalid => Sampler::REPEAT,
    });
    let magnified = sampler.mag_filter.and_then(|f| if let Checked::Valid(f) = f { Some(f.as_gl_enum()) } else { None });
    let minified = sampler.min_filter.and_then(|f| if let Checked::Valid(f) = f { Some(f.as_gl_enum()) } else { None });
    Sampler { magnified, minified, wrap }
}

fn read_picture(document: &Document, image: usize, folder: Option<&Path>) -> Result<Picture, String> {
    let image = &document.root.images[image];
    match (&image.uri, image.buffer_view) {
        (Some(uri), _) => Picture::new(read_uri(uri, folder)?),
        (None, Some(view)) => Picture::new(document.view(view.value()).map_err(|e| e.to_string())?.to_vec()),
        (None, None) => Err("it has no data".into()),
    }
}
