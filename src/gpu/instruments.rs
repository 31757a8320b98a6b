//! Instruments in the picture: scalpel, forceps, a poking sphere, the preview of a cut's plane. Plain data; free when there are
//! none, and uploaded only when they move.

use super::belt::Belt;
use super::context::Context;
use super::pipelines::{PipelineFamily, PipelineKey, Shape};
use super::stage::{Stage, storage_entry};
use super::tool_meshes::{Stuff, ToolMeshes};
use super::types::{ToolPlace, ToolVertex};
use crate::geometry::cofactor;
use glam::{DAffine3, DMat3, DVec3};
use std::ops::Range;

/// Which instrument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tool {
    /// Tip at the origin, handle along +y, edge towards +x; 16 cm.
    Scalpel,
    /// Tips around the origin, along x, this many metres apart; handle along +y, 13 cm.
    Forceps {
        /// Metres between the tips.
        opening: f64,
    },
    /// The unit sphere that pokes or squeezes.
    Sphere,
    /// The plane z = 0 of a cut, from -1 to 1 both ways.
    Plane,
}

/// An instrument, and where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instrument {
    /// Which.
    pub tool: Tool,
    /// Where. May scale: a model the size of a house wants a larger scalpel.
    pub world_from_tool: DAffine3,
    /// Linear RGBA that tints it; the alpha of sphere and plane.
    pub colour: [f32; 4],
}

impl Instrument {
    /// A scalpel whose blade runs from `tip` towards `base`, its edge towards `travel` as far as it can, of true size times
    /// `scale`.
    pub fn scalpel(tip: glam::DVec3, base: glam::DVec3, travel: glam::DVec3, scale: f64) -> Self {
        let up = (base - tip).normalize_or(glam::DVec3::Y);
        let edge = travel.reject_from_normalized(up).normalize_or(up.any_orthonormal_vector());
        let axes = glam::DMat3::from_cols(edge, up, edge.cross(up));
        let world_from_tool = DAffine3::from_mat3_translation(axes * scale, tip);
        Self { tool: Tool::Scalpel, world_from_tool, colour: [1.0; 4] }
    }

    fn place(&self) -> ToolPlace {
        let place = self.world_from_tool;
        let linear = place.matrix3;
        let cofactor = cofactor(linear);
        // Of no size of its own: the shader makes normals unit, and those of a tiny or huge tool would be out of its range.
        let largest = cofactor.to_cols_array().iter().fold(0.0f64, |m, x| m.max(x.abs())).max(f64::MIN_POSITIVE);
        let rows = |m: DMat3, t: DVec3| [0, 1, 2].map(|k| m.row(k).extend(t[k]).as_vec4().to_array());
        let opening = if let Tool::Forceps { opening } = self.tool { opening as f32 } else { 0.0 };
        ToolPlace {
            world_from_tool: rows(linear, place.translation),
            normal_from_tool: rows(cofactor * (1.0 / largest), DVec3::ZERO),
            colour: self.colour.map(|c| c.clamp(0.0, 1.0)),
            opening: [opening, 0.0, 0.0, 0.0],
        }
    }

    fn mesh(&self) -> usize {
        match self.tool {
            Tool::Plane => 0,
            Tool::Scalpel => 1,
            Tool::Forceps { .. } => 2,
            Tool::Sphere => 3,
        }
    }

    /// True for steel, which throws shadows; false for what one sees through.
    pub fn is_solid(&self) -> bool {
        matches!(self.tool, Tool::Scalpel | Tool::Forceps { .. })
    }

    fn is_sound(&self) -> bool {
        let opening = if let Tool::Forceps { opening } = self.tool { opening } else { 0.0 };
        self.world_from_tool.is_finite() && opening.is_finite()
    }
}

/// A place in the buffer of places: as far apart as offsets into uniform buffers have to be.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Slot {
    place: ToolPlace,
    rest: [f32; (SLOT as usize - size_of::<ToolPlace>()) / 4],
}

/// Bytes from one place to the next.
const SLOT: u32 = 256;

/// Pipelines and buffers of the instruments. The meshes are uploaded once, places when one has changed.
#[derive(Debug)]
pub struct InstrumentPass {
    layout: wgpu::BindGroupLayout,
    solid: PipelineFamily,
    clear: PipelineFamily,
    shadow: PipelineFamily,
    meshes: wgpu::Buffer,
    ranges: [Range<u32>; 4],
    shown: Vec<Instrument>,
    slots: Vec<Slot>,
    /// Corners of each slot's mesh, and whether it is solid; the translucent are drawn last.
    drawn: Vec<(Range<u32>, bool)>,
    places: (wgpu::Buffer, wgpu::BindGroup),
}

impl InstrumentPass {
    /// Uploads the meshes; compiles nothing yet.
    pub fn new(context: &Context, stage: &Stage) -> Self {
        let place = wgpu::BindGroupLayoutEntry {
            binding: 1,
            visibility: wgpu::ShaderStages::VERTEX,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: true,
                min_binding_size: None,
            },
            count: None,
        };
        let entries = [storage_entry(0, wgpu::ShaderStages::VERTEX), place];
        let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some("instruments"), entries: &entries };
        let layout = context.device().create_bind_group_layout(&descriptor);
        let solid = Shape { shader: "instruments", vertex: "tool_corner", fragment: Some("tool_surface"), ..Shape::SOLID };
        let clear = Shape { blend: true, depth_write: false, ..solid };
        let ToolMeshes { corners, ranges } = ToolMeshes::new();
        let meshes = context.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("instruments"),
            size: (corners.len() * size_of::<ToolVertex>()) as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        context.queue().write_buffer(&meshes, 0, bytemuck::cast_slice(&corners));
        let shadow = Shape { shader: "instrument_shadow", vertex: "tool_lamp_corner", ..Shape::SOLID };
        let mut shadow = PipelineFamily::new(context, shadow, &[&stage.frame_layout, &layout]);
        shadow.prepare(context, PipelineKey::DEPTH);
        Self {
            shadow,
            solid: PipelineFamily::new(context, solid, &[&stage.layout, &layout]),
            clear: PipelineFamily::new(context, clear, &[&stage.layout, &layout]),
            places: make_places(context, &layout, &meshes, 8),
            layout,
            meshes,
            ranges,
            shown: Vec::new(),
            slots: Vec::new(),
            drawn: Vec::new(),
        }
    }

    /// Brings the GPU's copy up to date, if an instrument has moved. Those that are not finite are left out. True if one has
    /// moved that throws a shadow.
    pub fn prepare(&mut self, context: &Context, belt: &mut Belt, instruments: &[Instrument]) -> bool {
        if self.shown == instruments {
            return false;
        }
        let solid = |i: &&Instrument| i.is_solid();
        let moved = !self.shown.iter().filter(solid).eq(instruments.iter().filter(solid));
        self.shown.clear();
        self.shown.extend_from_slice(instruments);
        self.slots.clear();
        self.drawn.clear();
        for instrument in instruments.iter().filter(|i| i.is_sound()) {
            self.slots.push(Slot { place: instrument.place(), rest: bytemuck::Zeroable::zeroed() });
            self.drawn.push((self.ranges[instrument.mesh()].clone(), instrument.is_solid()));
        }
        let bytes: &[u8] = bytemuck::cast_slice(&self.slots);
        if self.places.0.size() < bytes.len() as u64 {
            self.places = make_places(context, &self.layout, &self.meshes, 2 * self.slots.len() as u64);
        }
        belt.write(&self.places.0, 0, bytes);
        moved
    }

    /// Compiles what a target needs, if there is anything to draw.
    pub fn prepare_target(&mut self, context: &Context, key: PipelineKey) {
        if !self.drawn.is_empty() {
            self.compile(context, key);
        }
    }

    /// Compiles what a target needs, whatever there is to draw.
    pub fn compile(&mut self, context: &Context, key: PipelineKey) {
        self.solid.prepare(context, key);
        self.clear.prepare(context, key);
    }

    /// Draws the solid ones, or the translucent, which come after all else. Returns draws.
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>, key: PipelineKey, view: u32, solid: bool) -> u64 {
        self.draw_with(if solid { &self.solid } else { &self.clear }, pass, key, view, solid)
    }

    /// Draws the solid ones as the lamp sees them. Returns draws.
    pub fn draw_shadow(&self, pass: &mut wgpu::RenderPass<'_>) -> u64 {
        self.draw_with(&self.shadow, pass, PipelineKey::DEPTH, 0, true)
    }

    fn draw_with(
        &self,
        family: &PipelineFamily,
        pass: &mut wgpu::RenderPass<'_>,
        key: PipelineKey,
        view: u32,
        solid: bool,
    ) -> u64 {
        let wanted = || self.drawn.iter().enumerate().filter(|(_, (_, is_solid))| *is_solid == solid);
        if wanted().next().is_none() || !family.set(pass, key) {
            return 0;
        }
        wanted().fold(0, |draws, (slot, (corners, _))| {
            pass.set_bind_group(1, &self.places.1, &[slot as u32 * SLOT]);
            pass.draw(corners.clone(), view..view + 1);
            draws + 1
        })
    }
}

fn make_places(
    context: &Context,
    layout: &wgpu::BindGroupLayout,
    meshes: &wgpu::Buffer,
    slots: u64,
) -> (wgpu::Buffer, wgpu::BindGroup) {
    let buffer = context.device().create_buffer(&wgpu::BufferDescriptor {
        label: Some("places of instruments"),
        size: slots * u64::from(SLOT),
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let size = std::num::NonZeroU64::new(size_of::<ToolPlace>() as u64);
    let place = wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &buffer, offset: 0, size });
    let group = context.device().create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("instruments"),
        layout,
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: meshes.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: place },
        ],
    });
    (buffer, group)
}

/// The numbers of [`Stuff`], as the shader has them.
pub const STUFF: [(&str, u32); 4] = [
    ("STEEL", Stuff::Steel as u32),
    ("BLADE", Stuff::Blade as u32),
    ("SHEET", Stuff::Sheet as u32),
    ("GLASS", Stuff::Glass as u32),
];
