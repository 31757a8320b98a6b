//! Instruments in the picture: scalpel, forceps, a poking sphere, the preview of a cut's plane. Plain data; free when there are
//! none, and uploaded only when they move.

use super::belt::Belt;
use super::context::Context;
use super::pipelines::{PipelineFamily, PipelineKey, Shape};
use super::stage::{Stage, storage_entry};
use super::tool_meshes::{self, Corners, Stuff, ToolMeshes};
use super::types::ToolVertex;
use glam::DAffine3;

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

    fn append(&self, meshes: &ToolMeshes, out: &mut Corners) {
        let first = out.len();
        match self.tool {
            Tool::Scalpel => out.extend_from_slice(&meshes.scalpel),
            Tool::Forceps { opening } => {
                out.extend_from_slice(&meshes.forceps);
                tool_meshes::open_forceps(opening, &mut out[first..]);
            }
            Tool::Sphere => out.extend_from_slice(&meshes.sphere),
            Tool::Plane => out.extend_from_slice(&meshes.sheet),
        }
        let colour = u32::from_le_bytes(self.colour.map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8));
        let linear = self.world_from_tool.matrix3;
        let cofactor = glam::DMat3::from_cols(
            linear.y_axis.cross(linear.z_axis),
            linear.z_axis.cross(linear.x_axis),
            linear.x_axis.cross(linear.y_axis),
        );
        for corner in &mut out[first..] {
            let local = glam::Vec3::from_array(corner.position).as_dvec3();
            let normal = cofactor * glam::Vec3::from_array(corner.normal).as_dvec3();
            corner.position = self.world_from_tool.transform_point3(local).as_vec3().to_array();
            corner.normal = normal.normalize_or(glam::DVec3::Y).as_vec3().to_array();
            corner.colour = colour;
        }
    }

    fn is_sound(&self) -> bool {
        let opening = if let Tool::Forceps { opening } = self.tool { opening } else { 0.0 };
        self.world_from_tool.is_finite() && opening.is_finite()
    }
}

/// Pipelines and buffer of the instruments.
#[derive(Debug)]
pub struct InstrumentPass {
    layout: wgpu::BindGroupLayout,
    solid: PipelineFamily,
    clear: PipelineFamily,
    meshes: ToolMeshes,
    shown: Vec<Instrument>,
    corners: Corners,
    /// Corners of solid parts; translucent ones follow.
    solid_corners: u32,
    buffer: Option<(wgpu::Buffer, wgpu::BindGroup)>,
}

impl InstrumentPass {
    /// Compiles nothing yet.
    pub fn new(context: &Context, stage: &Stage) -> Self {
        let entries = [storage_entry(0, wgpu::ShaderStages::VERTEX)];
        let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some("instruments"), entries: &entries };
        let layout = context.device().create_bind_group_layout(&descriptor);
        let solid = Shape { shader: "instruments", vertex: "tool_corner", fragment: Some("tool_surface"), ..Shape::SOLID };
        let clear = Shape { blend: true, depth_write: false, ..solid };
        Self {
            solid: PipelineFamily::new(context, solid, &[&stage.layout, &layout]),
            clear: PipelineFamily::new(context, clear, &[&stage.layout, &layout]),
            layout,
            meshes: ToolMeshes::new(),
            shown: Vec::new(),
            corners: Corners::new(),
            solid_corners: 0,
            buffer: None,
        }
    }

    /// Brings the GPU's copy up to date, if an instrument has moved. Those that are not finite are left out.
    pub fn prepare(&mut self, context: &Context, belt: &mut Belt, instruments: &[Instrument]) {
        if self.shown == instruments {
            return;
        }
        self.shown.clear();
        self.shown.extend_from_slice(instruments);
        self.corners.clear();
        let translucent = |i: &&Instrument| matches!(i.tool, Tool::Plane | Tool::Sphere);
        let sound = || instruments.iter().filter(|i| i.is_sound());
        sound().filter(|i| !translucent(i)).for_each(|i| i.append(&self.meshes, &mut self.corners));
        self.solid_corners = self.corners.len() as u32;
        sound().filter(translucent).for_each(|i| i.append(&self.meshes, &mut self.corners));
        if self.corners.is_empty() {
            return;
        }
        let bytes = (self.corners.len() * size_of::<ToolVertex>()) as u64;
        if self.buffer.as_ref().is_none_or(|b| b.0.size() < bytes) {
            let buffer = context.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some("instruments"),
                size: bytes + bytes / 2,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            let group = context.device().create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("instruments"),
                layout: &self.layout,
                entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
            });
            self.buffer = Some((buffer, group));
        }
        if let Some((buffer, _)) = &self.buffer {
            belt.write(buffer, 0, &self.corners);
        }
    }

    /// Compiles what a target needs, if there is anything to draw.
    pub fn prepare_target(&mut self, context: &Context, key: PipelineKey) {
        if !self.corners.is_empty() {
            self.compile(context, key);
        }
    }

    /// Compiles what a target needs, whatever there is to draw.
    pub fn compile(&mut self, context: &Context, key: PipelineKey) {
        self.solid.prepare(context, key);
        self.clear.prepare(context, key);
    }

    /// Draws the solid parts, or the translucent ones, which come after all else. Returns draws.
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>, key: PipelineKey, view: u32, solid: bool) -> u64 {
        let all = self.corners.len() as u32;
        let (family, range) = if solid { (&self.solid, 0..self.solid_corners) } else { (&self.clear, self.solid_corners..all) };
        let Some((_, group)) = self.buffer.as_ref().filter(|_| !range.is_empty()) else { return 0 };
        if !family.set(pass, key) {
            return 0;
        }
        pass.set_bind_group(1, group, &[]);
        pass.draw(range, view..view + 1);
        1
    }
}

/// The numbers of [`Stuff`], as the shader has them.
pub const STUFF: [(&str, u32); 4] = [
    ("STEEL", Stuff::Steel as u32),
    ("BLADE", Stuff::Blade as u32),
    ("SHEET", Stuff::Sheet as u32),
    ("GLASS", Stuff::Glass as u32),
];
