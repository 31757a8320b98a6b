//! What a glTF file says that the glTF crate does not read or would refuse: animation channels without a node, and the
//! extensions that change what is read here.

use super::FormatError;
use super::gltf_rig::warn_once;
use glam::{DAffine2, DMat2, DVec2};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::borrow::Cow;

/// Compressed meshes.
pub(crate) const DRACO: &str = "KHR_draco_mesh_compression";

/// An error if a file requires an extension that changes how geometry is stored, or that nobody knows.
pub(crate) fn check(required: &[String]) -> Result<(), FormatError> {
    let known = ["KHR_mesh_quantization", "KHR_animation_pointer", "KHR_xmp_json_ld"];
    let harmless = |name: &str| {
        known.contains(&name) || name.starts_with("KHR_materials_") || name.starts_with("KHR_lights") || name.contains("texture")
    };
    match required.iter().find(|name| !harmless(name)) {
        Some(name) => Err(FormatError::UnsupportedExtension { name: name.clone() }),
        None => Ok(()),
    }
}

/// Axes of a texture transform are off a right angle by less than this, radians: a hundredth of a pixel of large pictures.
const SHEAR: f64 = 1e-6;

/// Those parts of a file, by the numbers of its nodes, meshes, textures and materials.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Extensions {
    animations: Vec<RawAnimation>,
    materials: Vec<Value>,
    meshes: Vec<RawMesh>,
    nodes: Vec<Extended>,
    textures: Vec<Extended>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct RawAnimation {
    channels: Vec<RawChannel>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct RawChannel {
    target: Option<RawTarget>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct RawTarget {
    node: Option<Value>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct RawMesh {
    primitives: Vec<Extended>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Extended {
    extensions: Value,
}

/// How a texture is laid (KHR_texture_transform).
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(default)]
pub(crate) struct TextureTransform {
    offset: [f64; 2],
    rotation: f64,
    scale: [f64; 2],
    /// The set of texture coordinates to take, where it is another than the texture's own.
    #[serde(rename = "texCoord")]
    pub uv_set: Option<u32>,
}

impl Default for TextureTransform {
    fn default() -> Self {
        Self { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2], uv_set: None }
    }
}

impl TextureTransform {
    /// Scales, turns counter-clockwise as seen on the picture (v points down there), and shifts.
    pub fn apply(&self, uv: [f32; 2]) -> [f32; 2] {
        let (sin, cos) = self.rotation.sin_cos();
        let [u, v] = [0, 1].map(|k| f64::from(uv[k]) * self.scale[k]);
        [cos * u + sin * v + self.offset[0], cos * v - sin * u + self.offset[1]].map(|x| x as f32)
    }

    fn affine(&self) -> DAffine2 {
        let (sin, cos) = self.rotation.sin_cos();
        let [u, v] = [DVec2::new(cos, -sin) * self.scale[0], DVec2::new(sin, cos) * self.scale[1]];
        DAffine2 { matrix2: DMat2::from_cols(u, v), translation: self.offset.into() }
    }

    /// The transform of coordinates that went through `base` already which lays them as `own` lays plain ones. None where there is
    /// no such: after a turn, a scale that differs along u and v is a shear, and from nothing nothing comes back.
    pub fn relative(own: Option<Self>, base: Option<Self>) -> Option<Self> {
        let [own, base] = [own, base].map(|t| Self { uv_set: None, ..t.unwrap_or_default() });
        if own == base || base == Self::default() {
            return Some(if own == base { Self::default() } else { own });
        }
        let whole = own.affine() * base.affine().inverse();
        let [x, y] = [whole.matrix2.x_axis, whole.matrix2.y_axis];
        if !whole.is_finite() || x.dot(y).abs() > SHEAR * x.length() * y.length() {
            return None;
        }
        // (sin, cos) is the direction of v
        let along_v = if x == DVec2::ZERO { y } else { DVec2::new(-x.y, x.x) }.try_normalize().unwrap_or(DVec2::Y);
        let scale = [x.length(), y.dot(along_v)];
        Some(Self { offset: whole.translation.to_array(), rotation: along_v.x.atan2(along_v.y), scale, uv_set: None })
    }

    /// A texture's extensions that say so; None where there is nothing to say.
    pub fn extensions(&self) -> Option<Value> {
        let plain = Self::default();
        let mut out = Map::new();
        let mut add = |key: &str, says: bool, value: Value| says.then(|| out.insert(key.into(), value));
        add("offset", self.offset != plain.offset, json!(self.offset));
        add("rotation", self.rotation != plain.rotation, json!(self.rotation));
        add("scale", self.scale != plain.scale, json!(self.scale));
        (!out.is_empty()).then(|| json!({ "KHR_texture_transform": out }))
    }
}

impl Extensions {
    /// Reads them; of a text that is no glTF there are none, as the glTF crate says more clearly what is wrong with it.
    pub fn read(text: &[u8]) -> Self {
        serde_json::from_slice(text).unwrap_or_default()
    }

    /// True if an animation channel names no node. Such are valid: an extension may name something else to move.
    pub fn have_channels_without_node(&self) -> bool {
        let nodeless = |c: &RawChannel| c.target.as_ref().is_some_and(|t| t.node.is_none());
        self.animations.iter().flat_map(|a| &a.channels).any(nodeless)
    }

    /// The file's text without these channels, which the glTF crate would refuse.
    pub fn readable<'a>(&self, text: &'a [u8]) -> Cow<'a, [u8]> {
        let without = || {
            let mut root: Value = serde_json::from_slice(text).ok()?;
            for animation in root.get_mut("animations")?.as_array_mut()? {
                if let Some(channels) = animation.get_mut("channels").and_then(Value::as_array_mut) {
                    channels.retain(|c| c.get("target").is_none_or(|t| t.get("node").is_some_and(|n| !n.is_null())));
                }
            }
            serde_json::to_vec(&root).ok()
        };
        if self.have_channels_without_node() { without().map_or(text.into(), Cow::Owned) } else { text.into() }
    }

    /// True if a node asks for many instances of its mesh.
    pub fn is_instanced(&self, node: usize) -> bool {
        self.nodes.get(node).is_some_and(|n| n.extensions.get("EXT_mesh_gpu_instancing").is_some())
    }

    /// True if a primitive of a mesh has a compressed form, beside its plain one or in its stead.
    pub fn is_compressed(&self, mesh: usize, primitive: usize) -> bool {
        let primitive = self.meshes.get(mesh).and_then(|m| m.primitives.get(primitive));
        primitive.is_some_and(|p| p.extensions.get(DRACO).is_some())
    }

    /// The extension that names a texture's picture, such as KHR_texture_basisu.
    pub fn of_picture(&self, texture: usize) -> Option<&str> {
        let extensions = self.textures.get(texture)?.extensions.as_object()?;
        extensions.iter().find(|(_, value)| value.get("source").is_some()).map(|(name, _)| name.as_str())
    }

    /// All that the file says of a material; null where it has none of that number.
    pub fn material(&self, material: usize) -> &Value {
        self.materials.get(material).unwrap_or(&Value::Null)
    }

    /// Where a material names its base colour texture.
    pub fn base_colour(&self, material: usize) -> Option<TextureInfo<'_>> {
        self.material(material).get("pbrMetallicRoughness")?.get("baseColorTexture")?.as_object().map(TextureInfo)
    }
}

/// A place in a material that names a texture (`textureInfo`).
#[derive(Clone, Copy, Debug)]
pub(crate) struct TextureInfo<'a>(pub &'a Map<String, Value>);

impl TextureInfo<'_> {
    /// How it is laid, where it says so; what cannot be read is told of.
    pub fn transform(self, warnings: &mut Vec<String>) -> Option<TextureTransform> {
        let read = TextureTransform::deserialize(self.0.get("extensions")?.get("KHR_texture_transform")?);
        if let Err(error) = &read {
            warn_once(warnings, &format!("a texture's KHR_texture_transform is left out: {error}"));
        }
        read.ok()
    }

    /// The set of texture coordinates that it asks for, with its transform.
    pub fn uv_set(self, transform: Option<TextureTransform>) -> u32 {
        let own = || self.0.get("texCoord").and_then(Value::as_u64).and_then(|set| u32::try_from(set).ok());
        transform.and_then(|t| t.uv_set).or_else(own).unwrap_or(0)
    }
}

/// Visits the places in a material, or an extension of one, that name a texture: by the names that the specifications give them.
pub(crate) fn texture_infos<E>(
    value: &mut Value,
    visit: &mut impl FnMut(&mut Map<String, Value>) -> Result<(), E>,
) -> Result<(), E> {
    match value {
        Value::Object(members) => {
            members.iter_mut().filter(|(key, _)| *key != "extras").try_for_each(|(key, value)| match value {
                Value::Object(info) if key.ends_with("Texture") => visit(info),
                value => texture_infos(value, visit),
            })
        }
        Value::Array(values) => values.iter_mut().try_for_each(|value| texture_infos(value, visit)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By the specification's words and as three.js does: the coordinates turn counter-clockwise on the picture.
    #[test]
    fn texture_coordinates_are_scaled_turned_and_shifted() {
        let half_pi = std::f64::consts::FRAC_PI_2;
        let whole = TextureTransform { offset: [0.25, 0.5], rotation: half_pi, scale: [2.0, 3.0], uv_set: None };
        for (uv, expected) in [([0.0, 0.0], [0.25, 0.5]), ([1.0, 0.0], [0.25, -1.5]), ([0.0, 1.0], [3.25, 0.5])] {
            let found = whole.apply(uv);
            assert!((0..2).all(|k| (found[k] - expected[k]).abs() < 1e-6f32), "{uv:?}: {found:?}");
        }
        assert_eq!(TextureTransform::default().apply([0.3, 0.7]), [0.3, 0.7]);
        // the specification's example: "only the lower left quadrant of the source image, rotated clockwise 90 degrees"
        let quadrant = TextureTransform { offset: [0.0, 1.0], rotation: half_pi, scale: [0.5, 0.5], uv_set: None };
        for (uv, expected) in
            [([0.0, 0.0], [0.0, 1.0]), ([1.0, 0.0], [0.0, 0.5]), ([0.0, 1.0], [0.5, 1.0]), ([1.0, 1.0], [0.5, 0.5])]
        {
            let found = quadrant.apply(uv);
            assert!((0..2).all(|k| (found[k] - expected[k]).abs() < 1e-6f32), "{uv:?}: {found:?}");
        }
    }

    #[test]
    fn relative_transforms_lead_to_the_same_place() {
        let transform = |offset, rotation, scale| Some(TextureTransform { offset, rotation, scale, uv_set: None });
        let turned = transform([0.1, -0.2], 2.5, [3.0, 3.0]);
        let straight = transform([1.0, 2.0], 0.0, [4.0, -10.0]);
        let quarter = transform([0.1, -0.2], -std::f64::consts::FRAC_PI_2, [3.0, 5.0]);
        let cases = [
            (None, turned),
            (transform([0.5, 0.25], -1.0, [2.0, -2.0]), turned),
            (transform([0.5, 0.25], -1.0, [-2.0, 2.0]), turned),
            (transform([0.7, 0.0], 0.0, [0.0, 0.0]), turned),
            (transform([0.3, 0.0], 0.4, [2.0, 5.0]), quarter),
            (transform([0.3, 0.0], 0.4, [2.0, 5.0]), straight),
            (transform([0.0, 0.0], 1.4, [0.0, 2.0]), straight),
            (transform([0.0, 0.0], 1.4, [2.0, 0.0]), straight),
        ];
        for (own, base) in cases {
            let relative = TextureTransform::relative(own, base).unwrap();
            for uv in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.3, 0.7]] {
                let expected = own.unwrap_or_default().apply(uv);
                let found = relative.apply(base.unwrap_or_default().apply(uv));
                assert!(
                    (0..2).all(|k| (found[k] - expected[k]).abs() < 1e-5f32),
                    "{own:?} {base:?} {uv:?}: {found:?} {expected:?}"
                );
            }
        }
        assert_eq!(TextureTransform::relative(transform([0.0; 2], 0.0, [1.0, 2.0]), turned), None, "a shear");
    }

    #[test]
    fn only_channels_without_a_node_are_dropped() {
        let text = br#"{"animations":[{"channels":[{"target":{"node":0}},{"target":{}},{"target":{"node":null}}]}]}"#;
        let found = Extensions::read(text);
        assert!(found.have_channels_without_node());
        let left: Value = serde_json::from_slice(&found.readable(text)).unwrap();
        assert_eq!(left, serde_json::json!({ "animations": [{ "channels": [{ "target": { "node": 0 } }] }] }));
        for plain in [&br#"{"animations":[{"channels":[{"target":{"node":0}},{}]}]}"#[..], b"{", b"[]", b"7"] {
            assert!(matches!(Extensions::read(plain).readable(plain), Cow::Borrowed(same) if same == plain));
        }
    }
}
