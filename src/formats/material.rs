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

/// Base colour and sides: what the tissue pass needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the file, or empty.
    pub name: String,
    /// Base colour factor, linear RGBA.
    pub base_colour: [f32; 4],
    /// Base colour texture, multiplied with the factor.
    pub texture: Option<Arc<Texture>>,
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
        Self { name: String::new(), base_colour: [1.0; 4], texture: None, double_sided: false }
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
