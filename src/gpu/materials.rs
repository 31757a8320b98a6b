//! Materials of all tissues in one table, and their textures as layers of one array, so that one draw serves them all.
//! Equal pictures share a layer: the pieces of a cut model do not multiply its textures.

use super::context::Context;
use super::error::GpuError;
use super::types::Material;
use super::view::{MaterialView, TextureView};
use crate::geometry::StateHash;

/// Side of a layer, texels. Other sizes are resampled to it.
pub const LAYER_SIDE: u32 = 1024;
const LEVELS: u32 = LAYER_SIDE.ilog2() + 1;

#[derive(Clone, Copy, Debug)]
struct Layer {
    hash: u64,
    users: u32,
}

/// Table and textures.
#[derive(Debug)]
pub struct Materials {
    table: Vec<Material>,
    /// First material and number of each tissue slot.
    ranges: Vec<(u32, u32)>,
    layers: Vec<Layer>,
    buffer: wgpu::Buffer,
    texture: wgpu::Texture,
    generation: u64,
}

impl Materials {
    /// The white layer alone.
    pub fn new(context: &Context) -> Self {
        let texture = make_array(context.device(), 1);
        let white = vec![255; (LAYER_SIDE * LAYER_SIDE * 4) as usize];
        for level in 0..LEVELS {
            write_level(&context.queue(), &texture, 0, level, &white);
        }
        Self {
            table: Vec::new(),
            ranges: Vec::new(),
            layers: vec![Layer { hash: 0, users: 1 }],
            buffer: make_table(context.device(), 16),
            texture,
            generation: 0,
        }
    }

    /// Changes whenever buffer or texture is replaced.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// The table.
    pub fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }

    /// All layers.
    pub fn texture_view(&self) -> wgpu::TextureView {
        self.texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        })
    }

    /// First material and number of materials of a tissue slot.
    pub fn range(&self, slot: usize) -> (u32, u32) {
        self.ranges.get(slot).copied().unwrap_or_default()
    }

    /// Gives a tissue slot its materials (flesh if there are none). Returns bytes uploaded. Ranges of other slots may
    /// move: ask [`Materials::range`] again.
    pub fn set(&mut self, context: &Context, slot: usize, views: &[MaterialView<'_>]) -> Result<usize, GpuError> {
        let mut bytes = 0;
        let flesh = [MaterialView::FLESH];
        let views = if views.is_empty() { &flesh } else { views };
        let mut records = Vec::with_capacity(views.len());
        for view in views {
            let layer = match view.texture {
                Some(texture) => self.layer_of(context, texture, &mut bytes)?,
                None => 0,
            };
            records.push(Material {
                base_colour: view.base_colour,
                layer,
                roughness: view.roughness.clamp(0.0, 1.0),
                wetness: view.wetness.clamp(0.0, 1.0),
                scatter: view.scatter.clamp(0.0, 1.0),
            });
        }
        self.splice(slot, &records);
        Ok(bytes + self.upload_table(context))
    }

    /// Forgets a tissue slot's materials; layers that nobody uses any more may be taken by others.
    pub fn clear(&mut self, slot: usize) {
        self.splice(slot, &[]);
    }

    fn splice(&mut self, slot: usize, records: &[Material]) {
        if self.ranges.len() <= slot {
            self.ranges.resize(slot + 1, (0, 0));
        }
        let (first, count) = self.ranges[slot];
        for record in records {
            self.layers[record.layer as usize].users += 1;
        }
        for record in &self.table[first as usize..(first + count) as usize] {
            self.layers[record.layer as usize].users -= 1;
        }
        let mut table = Vec::with_capacity(self.table.len() + records.len());
        for (s, range) in self.ranges.iter_mut().enumerate() {
            let start = table.len() as u32;
            let kept = &self.table[range.0 as usize..(range.0 + range.1) as usize];
            table.extend_from_slice(if s == slot { records } else { kept });
            *range = (start, table.len() as u32 - start);
        }
        self.table = table;
    }

    fn upload_table(&mut self, context: &Context) -> usize {
        let bytes: &[u8] = bytemuck::cast_slice(&self.table);
        if self.buffer.size() < bytes.len() as u64 {
            self.buffer = make_table(context.device(), self.table.len() * 2);
            self.generation += 1;
        }
        context.queue().write_buffer(&self.buffer, 0, bytes);
        bytes.len()
    }

    fn layer_of(&mut self, context: &Context, view: TextureView<'_>, bytes: &mut usize) -> Result<u32, GpuError> {
        let mut hash = StateHash::default();
        hash.word(u64::from(view.width) << 32 | u64::from(view.height));
        hash.bytes(view.rgba);
        let hash = hash.finish();
        if let Some(known) = self.layers.iter().skip(1).position(|l| l.hash == hash) {
            return Ok(known as u32 + 1);
        }
        let unused = self.layers.iter().position(|l| l.users == 0);
        let layer = match unused {
            Some(layer) => layer,
            None => self.add_layer(context)?,
        };
        self.layers[layer].hash = hash;
        let mut image = resample(view);
        for level in 0..LEVELS {
            let encoded = image.encode();
            write_level(&context.queue(), &self.texture, layer as u32, level, &encoded);
            *bytes += encoded.len();
            image = image.halve();
        }
        Ok(layer as u32)
    }

    fn add_layer(&mut self, context: &Context) -> Result<usize, GpuError> {
        let layer = self.layers.len();
        self.layers.push(Layer { hash: 0, users: 0 });
        let room = self.texture.depth_or_array_layers();
        if layer < room as usize {
            return Ok(layer);
        }
        let limit = context.device().limits().max_texture_array_layers;
        if room >= limit {
            self.layers.pop();
            let layer_bytes = u64::from(LAYER_SIDE * LAYER_SIDE * 4);
            return Err(GpuError::TooLarge {
                what: "textures",
                needed_bytes: (u64::from(room) + 1) * layer_bytes,
                limit_bytes: u64::from(limit) * layer_bytes,
            });
        }
        let grown = make_array(context.device(), (room * 2).min(limit));
        let mut encoder =
            context.device().create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("texture growth") });
        for level in 0..LEVELS {
            let side = LAYER_SIDE >> level;
            let extent = wgpu::Extent3d { width: side, height: side, depth_or_array_layers: room };
            encoder.copy_texture_to_texture(at_level(&self.texture, 0, level), at_level(&grown, 0, level), extent);
        }
        context.queue().submit([encoder.finish()]);
        self.texture = grown;
        self.generation += 1;
        Ok(layer)
    }
}

fn make_table(device: &wgpu::Device, materials: usize) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("materials"),
        size: (materials * size_of::<Material>()) as u64,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn make_array(device: &wgpu::Device, layers: u32) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some("textures"),
        size: wgpu::Extent3d { width: LAYER_SIDE, height: LAYER_SIDE, depth_or_array_layers: layers },
        mip_level_count: LEVELS,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8UnormSrgb,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

fn at_level(texture: &wgpu::Texture, layer: u32, level: u32) -> wgpu::TexelCopyTextureInfo<'_> {
    wgpu::TexelCopyTextureInfo {
        texture,
        mip_level: level,
        origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
        aspect: wgpu::TextureAspect::All,
    }
}

fn write_level(queue: &wgpu::Queue, texture: &wgpu::Texture, layer: u32, level: u32, rgba: &[u8]) {
    let side = LAYER_SIDE >> level;
    queue.write_texture(
        at_level(texture, layer, level),
        &rgba[..(side * side * 4) as usize],
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(side * 4), rows_per_image: None },
        wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 1 },
    );
}

/// Linear colours, straight alpha.
struct LinearImage {
    width: usize,
    height: usize,
    texels: Vec<[f32; 4]>,
}

/// Brings a picture to the size of a layer: halved while more than twice as large, then bilinear, all in linear light.
fn resample(view: TextureView<'_>) -> LinearImage {
    let decode: Vec<f32> = (0..256).map(|v| srgb_to_linear(v as f32 / 255.0)).collect();
    let texel = |p: &[u8; 4]| [decode[p[0] as usize], decode[p[1] as usize], decode[p[2] as usize], f32::from(p[3]) / 255.0];
    let texels = view.rgba.as_chunks::<4>().0.iter().map(texel).collect();
    let mut image = LinearImage { width: view.width as usize, height: view.height as usize, texels };
    let side = LAYER_SIDE as usize;
    while image.width >= 2 * side && image.height >= 2 * side {
        image = image.halve();
    }
    if (image.width, image.height) == (side, side) {
        return image;
    }
    let texels = (0..side * side).map(|i| image.bilinear(i % side, i / side, side)).collect();
    LinearImage { width: side, height: side, texels }
}

impl LinearImage {
    fn halve(&self) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let at = |x: usize, y: usize| self.texels[y.min(self.height - 1) * self.width + x.min(self.width - 1)];
        let mean = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            let four = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
            std::array::from_fn(|c| 0.25 * (four[0][c] + four[1][c] + four[2][c] + four[3][c]))
        };
        Self { width, height, texels: (0..width * height).map(mean).collect() }
    }

    /// Texel `(x, y)` of a square of `side` texels.
    fn bilinear(&self, x: usize, y: usize, side: usize) -> [f32; 4] {
        let place = |i: usize, len: usize| {
            let p = ((i as f32 + 0.5) * len as f32 / side as f32 - 0.5).clamp(0.0, (len - 1) as f32);
            (p as usize, (p as usize + 1).min(len - 1), p.fract())
        };
        let ((x0, x1, fx), (y0, y1, fy)) = (place(x, self.width), place(y, self.height));
        let at = |x: usize, y: usize| self.texels[y * self.width + x];
        let (a, b, c, d) = (at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1));
        std::array::from_fn(|k| (a[k] + (b[k] - a[k]) * fx) * (1.0 - fy) + (c[k] + (d[k] - c[k]) * fx) * fy)
    }

    fn encode(&self) -> Vec<u8> {
        let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        let texel =
            |t: &[f32; 4]| [byte(linear_to_srgb(t[0])), byte(linear_to_srgb(t[1])), byte(linear_to_srgb(t[2])), byte(t[3])];
        self.texels.iter().flat_map(texel).collect()
    }
}

fn srgb_to_linear(v: f32) -> f32 {
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

fn linear_to_srgb(v: f32) -> f32 {
    if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_of_the_right_size_comes_through_unchanged() {
        let side = LAYER_SIDE as usize;
        let rgba: Vec<u8> = (0..side * side * 4).map(|i| (i * 31 % 251) as u8).collect();
        let image = resample(TextureView { width: LAYER_SIDE, height: LAYER_SIDE, rgba: &rgba });
        assert_eq!(image.encode(), rgba);
    }

    #[test]
    fn halving_mixes_light_not_codes() {
        let texels = vec![[0.0, 0.0, 0.0, 1.0], [1.0; 4], [1.0; 4], [0.0, 0.0, 0.0, 1.0]];
        let grey = LinearImage { width: 2, height: 2, texels }.halve().encode();
        assert_eq!(grey[0], 188); // half the light; 128 would be half the code
    }

    #[test]
    fn odd_sizes_are_resampled_smoothly() {
        let rgba: Vec<u8> = (0..3 * 5).flat_map(|i| [if i % 3 == 0 { 0 } else { 255 }, 0, 0, 255]).collect();
        let image = resample(TextureView { width: 3, height: 5, rgba: &rgba });
        let row: Vec<f32> = (0..LAYER_SIDE as usize).map(|x| image.texels[x][0]).collect();
        assert!(row.windows(2).all(|w| w[0] <= w[1]) && row[0] == 0.0 && row[LAYER_SIDE as usize - 1] == 1.0);
    }
}
