//! What a surface looks like.

use std::sync::Arc;

/// A decoded picture, 8 bits a channel, sRGB colour as stored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// RGBA, row by row from the top: `4 * width * height` bytes.
    pub rgba: Vec<u8>,
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
}

impl Material {
    /// Base colour of what has no colour of its own: flesh.
    pub const FLESH: [f32; 4] = [0.27, 0.058, 0.047, 1.0];

    /// A material of which only the name is known.
    pub fn named(name: &str) -> Self {
        Self { name: name.into(), base_colour: Self::FLESH, ..Self::default() }
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
        }
    }
}

/// Decodes a PNG or JPEG.
pub(crate) fn decode(bytes: &[u8]) -> Result<Texture, String> {
    let mut reader = image::ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(16_384);
    limits.max_image_height = Some(16_384);
    reader.limits(limits);
    let picture = reader.decode().map_err(|e| e.to_string())?.into_rgba8();
    Ok(Texture { width: picture.width(), height: picture.height(), rgba: picture.into_raw() })
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
