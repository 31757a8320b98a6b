//! What a surface looks like.

use serde_json::{Map as Object, Value, json};
use std::sync::Arc;

/// A picture as it is stored: PNG or JPEG. Kept for files that go out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    bytes: Vec<u8>,
    mime_type: &'static str,
}

impl Picture {
    /// Takes the bytes of a PNG or JPEG of at most 16,384 pixels a side, of which the header alone is looked at; an error, in words,
    /// if they are none.
    pub fn new(bytes: Vec<u8>) -> Result<Self, String> {
        let reader = reader(&bytes)?;
        let mime_type = match reader.format() {
            Some(image::ImageFormat::Png) => "image/png",
            Some(image::ImageFormat::Jpeg) => "image/jpeg",
            _ => return Err("it is neither PNG nor JPEG".into()),
        };
        reader.into_dimensions().map_err(|e| e.to_string())?;
        Ok(Self { bytes, mime_type })
    }

    /// The file.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// What it is, as glTF calls it.
    pub fn mime_type(&self) -> &'static str {
        self.mime_type
    }
}

/// A decoded picture, 8 bits a channel, sRGB colour as stored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// RGBA, row by row from the top: `4 * width * height` bytes.
    pub rgba: Vec<u8>,
    /// What it was decoded from, which is written in its stead; None if the pixels are to be.
    pub encoded: Option<Arc<Picture>>,
}

/// What alpha means. The tissue pass draws everything opaque; it is kept for files that go out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlphaMode {
    /// Nothing.
    #[default]
    Opaque,
    /// What has less than this is not there.
    Mask(f32),
    /// A share of what is behind shows through.
    Blend,
}

/// How a picture is looked up between its pixels and beyond its edges, in glTF's numbers. The tissue pass has its own way; it is
/// kept for files that go out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampler {
    /// Filter of what is magnified, if the file asks for one.
    pub magnified: Option<u32>,
    /// Filter of what is made smaller, if the file asks for one.
    pub minified: Option<u32>,
    /// What is beyond the edges, along u and v.
    pub wrap: [u32; 2],
}

impl Sampler {
    /// The picture again and again.
    pub const REPEAT: u32 = 10_497;
}

impl Default for Sampler {
    fn default() -> Self {
        Self { magnified: None, minified: None, wrap: [Self::REPEAT; 2] }
    }
}

/// A picture and how it is looked up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Map {
    pub picture: Arc<Picture>,
    pub sampler: Sampler,
}

/// What a glTF file says of a material besides base colour, alpha and sides: metal and roughness, maps of normals, occlusion and
/// emission, Khronos's extensions. The tissue pass has its own way with light; it is kept for files that go out.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Finish {
    /// The material's JSON without what [`Material`] holds; each texture's `index` is into `maps`.
    pub(crate) json: Object<String, Value>,
    pub(crate) maps: Vec<Map>,
}

impl Finish {
    /// What its JSON has at a pointer such as `/normalTexture`.
    pub(crate) fn value(&self, pointer: &str) -> Option<&Value> {
        let mut names = pointer.split('/').skip(1);
        let first = self.json.get(names.next()?)?;
        names.try_fold(first, |value, name| value.get(name))
    }

    /// Metal and roughness of what has no finish, as `pbrMetallicRoughness` of glTF has them.
    pub(crate) fn plain_factors() -> Object<String, Value> {
        Object::from_iter([("metallicFactor".into(), json!(0.0)), ("roughnessFactor".into(), json!(0.6))])
    }
}

/// Base colour and sides: what the tissue pass needs, and what it passes on.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the file, or empty.
    pub name: String,
    /// Base colour factor, linear RGBA.
    pub base_colour: [f32; 4],
    /// Base colour texture, multiplied with the factor.
    pub texture: Option<Arc<Texture>>,
    /// How that is looked up.
    pub sampler: Sampler,
    /// What the colour's alpha means.
    pub alpha: AlphaMode,
    /// True if the back is drawn too.
    pub double_sided: bool,
    /// The rest of a glTF material; what has none is written as smooth, damp and no metal.
    pub finish: Option<Arc<Finish>>,
}

impl Material {
    /// Base colour of what has no colour of its own: flesh.
    pub const FLESH: [f32; 4] = [0.27, 0.058, 0.047, 1.0];

    /// A material of which only the name is known.
    pub fn named(name: &str) -> Self {
        Self { name: name.into(), base_colour: Self::FLESH, ..Self::default() }
    }

    /// True if it needs texture coordinates.
    pub(crate) fn is_textured(&self) -> bool {
        self.texture.is_some() || self.finish.as_ref().is_some_and(|f| !f.maps.is_empty())
    }
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            base_colour: [1.0; 4],
            texture: None,
            sampler: Sampler::default(),
            alpha: AlphaMode::Opaque,
            double_sided: false,
            finish: None,
        }
    }
}

/// A reader of a picture that knows its format and the largest size.
fn reader(bytes: &[u8]) -> Result<image::ImageReader<std::io::Cursor<&[u8]>>, String> {
    let mut reader = image::ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(16_384);
    limits.max_image_height = Some(16_384);
    reader.limits(limits);
    Ok(reader)
}

/// Decodes a picture, and keeps it.
pub(crate) fn decode(encoded: Arc<Picture>) -> Result<Texture, String> {
    let pixels = reader(&encoded.bytes)?.decode().map_err(|e| e.to_string())?.into_rgba8();
    Ok(Texture { width: pixels.width(), height: pixels.height(), rgba: pixels.into_raw(), encoded: Some(encoded) })
}

/// Encodes as PNG.
pub(crate) fn encode_png(texture: &Texture) -> Result<Vec<u8>, String> {
    use image::ImageEncoder;
    let mut out = Vec::new();
    image::codecs::png::PngEncoder::new(&mut out)
        .write_image(&texture.rgba, texture.width, texture.height, image::ExtendedColorType::Rgba8)
        .map_err(|e| e.to_string())?;
    Ok(out)
}
