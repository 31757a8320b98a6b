//! Draws all tissues, and their shadows: vertex pulling from the arenas, one draw for each unbroken run of face slots.

use super::arenas::{ArenaKind, Arenas};
use super::context::Context;
use super::materials::Materials;
use super::pipelines::{PipelineFamily, PipelineKey, Shape};
use super::stage::Stage;
use std::ops::Range;

/// Pipelines and bind groups of the tissues.
#[derive(Debug)]
pub struct TissuePass {
    layout: wgpu::BindGroupLayout,
    shadow_layout: wgpu::BindGroupLayout,
    tissue: PipelineFamily,
    shadow: PipelineFamily,
    sampler: wgpu::Sampler,
    groups: Option<(u64, wgpu::BindGroup, wgpu::BindGroup)>,
    /// First face slot and one past the last, of the arena: what the eyes may see.
    runs: Vec<(u32, u32)>,
    /// The same of all tissues: out of sight they may still throw shadows.
    all_runs: Vec<(u32, u32)>,
}

/// Bindings 1 to 4; the tissue table is 0.
const ARENAS: [ArenaKind; 4] = [ArenaKind::Vertices, ArenaKind::Faces, ArenaKind::Wedges, ArenaKind::Deformed];
/// Which of the bindings the shadow pass has: all but the rest positions.
const SHADOW_BINDINGS: [u32; 4] = [0, 2, 3, 4];

impl TissuePass {
    /// Compiles the pipelines.
    pub fn new(context: &Context, stage: &Stage) -> Self {
        let device = context.device();
        let entries = layout_entries(!context.deforms());
        let shadow_entries: Vec<_> = SHADOW_BINDINGS.iter().map(|&b| entries[b as usize]).collect();
        let make_layout = |entries: &[wgpu::BindGroupLayoutEntry]| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("tissue"), entries })
        };
        let (layout, shadow_layout) = (make_layout(&entries), make_layout(&shadow_entries));
        let tissue = Shape { shader: "tissue", vertex: "corner", fragment: Some("surface"), ..Shape::SOLID };
        let tissue = PipelineFamily::new(context, tissue, &[&stage.layout, &layout]);
        let shadow = Shape { shader: "shadow", vertex: "lamp_corner", ..Shape::SOLID };
        let mut shadow = PipelineFamily::new(context, shadow, &[&stage.frame_layout, &shadow_layout]);
        shadow.prepare(context, PipelineKey::DEPTH);
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("textures"),
            address_mode_u: wgpu::AddressMode::Repeat,
            address_mode_v: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        Self { layout, shadow_layout, tissue, shadow, sampler, groups: None, runs: Vec::new(), all_runs: Vec::new() }
    }

    /// Compiles what a target needs.
    pub fn prepare_target(&mut self, context: &Context, key: PipelineKey) {
        self.tissue.prepare(context, key);
    }

    /// Begins a new picture, of no faces.
    pub fn begin(&mut self) {
        self.runs.clear();
        self.all_runs.clear();
    }

    /// All face slots of a tissue of the picture: they throw shadows.
    pub fn add(&mut self, slots: Range<u32>) {
        self.all_runs.extend((!slots.is_empty()).then_some((slots.start, slots.end)));
    }

    /// Face slots that an eye may see.
    pub fn add_seen(&mut self, slots: Range<u32>) {
        self.runs.extend((!slots.is_empty()).then_some((slots.start, slots.end)));
    }

    /// Brings bind groups up to date and closes the lists.
    pub fn prepare(&mut self, context: &Context, arenas: &Arenas, table: (&wgpu::Buffer, u64), materials: &Materials) {
        merge_runs(&mut self.runs);
        merge_runs(&mut self.all_runs);
        let generation = arenas.generation() + table.1 + materials.generation();
        if self.groups.as_ref().is_some_and(|g| g.0 == generation) {
            return;
        }
        let textures = materials.texture_view();
        let entries: [_; 8] = std::array::from_fn(|b| {
            let resource = match b {
                0 => table.0.as_entire_binding(),
                1..=4 => arenas.buffer(ARENAS[b - 1]).as_entire_binding(),
                5 => materials.buffer().as_entire_binding(),
                6 => wgpu::BindingResource::TextureView(&textures),
                _ => wgpu::BindingResource::Sampler(&self.sampler),
            };
            wgpu::BindGroupEntry { binding: b as u32, resource }
        });
        let shadow_entries = SHADOW_BINDINGS.map(|b| entries[b as usize].clone());
        let make = |layout: &wgpu::BindGroupLayout, entries: &[wgpu::BindGroupEntry<'_>]| {
            context.device().create_bind_group(&wgpu::BindGroupDescriptor { label: Some("tissue"), layout, entries })
        };
        self.groups = Some((generation, make(&self.layout, &entries), make(&self.shadow_layout, &shadow_entries)));
    }

    /// Draws what the lamp sees. Returns draws.
    pub fn draw_shadow(&self, pass: &mut wgpu::RenderPass<'_>) -> u64 {
        let Some((_, _, group)) = &self.groups else { return 0 };
        if !self.shadow.set(pass, PipelineKey::DEPTH) {
            return 0;
        }
        pass.set_bind_group(1, group, &[]);
        draw_runs(pass, &self.all_runs, 0)
    }

    /// Draws what the eye sees. Returns draws.
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>, key: PipelineKey, view: u32) -> u64 {
        let Some((_, group, _)) = &self.groups else { return 0 };
        if !self.tissue.set(pass, key) {
            return 0;
        }
        pass.set_bind_group(1, group, &[]);
        draw_runs(pass, &self.runs, view)
    }
}

fn draw_runs(pass: &mut wgpu::RenderPass<'_>, runs: &[(u32, u32)], view: u32) -> u64 {
    for &(first, end) in runs {
        pass.draw(first * 3..end * 3, view..view + 1);
    }
    runs.len() as u64
}

/// Face slots that are nobody's are nothing to look at, so a small gap costs less than a draw.
pub(super) const GAP: u32 = 4096;

fn merge_runs(runs: &mut Vec<(u32, u32)>) {
    runs.sort_unstable();
    let mut kept = 0;
    for i in 1..runs.len() {
        if runs[i].0 <= runs[kept].1 + GAP {
            runs[kept].1 = runs[kept].1.max(runs[i].1);
        } else {
            kept += 1;
            runs[kept] = runs[i];
        }
    }
    runs.truncate(kept + 1);
}

/// `uniform_table`: the table of tissues comes as a uniform buffer.
fn layout_entries(uniform_table: bool) -> [wgpu::BindGroupLayoutEntry; 8] {
    let entry = |binding: u32, visibility, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let storage = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Storage { read_only: true },
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let table = match uniform_table {
        true => {
            wgpu::BindingType::Buffer { ty: wgpu::BufferBindingType::Uniform, has_dynamic_offset: false, min_binding_size: None }
        }
        false => storage,
    };
    let textures = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: true },
        view_dimension: wgpu::TextureViewDimension::D2Array,
        multisampled: false,
    };
    std::array::from_fn(|b| match b {
        0 => entry(0, wgpu::ShaderStages::VERTEX, table),
        1..=4 => entry(b as u32, wgpu::ShaderStages::VERTEX, storage),
        5 => entry(5, wgpu::ShaderStages::FRAGMENT, storage),
        6 => entry(6, wgpu::ShaderStages::FRAGMENT, textures),
        _ => entry(7, wgpu::ShaderStages::FRAGMENT, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_merge_over_small_gaps_only() {
        let mut runs = vec![(20_000, 20_100), (0, 100), (128, 300)];
        merge_runs(&mut runs);
        assert_eq!(runs, [(0, 300), (20_000, 20_100)]);
        merge_runs(&mut Vec::new());
    }
}
