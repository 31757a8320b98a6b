//! The deform pass: skins and displaces all tissues in one dispatch, then all normals in another (MATHS 2).

use super::arenas::{ArenaKind, Arenas};
use super::belt::Belt;
use super::context::Context;
use super::types::{self, WorkItem};

/// Vertices or wedges a workgroup.
pub const GROUP: u32 = 64;
/// Most workgroups along one axis of a dispatch.
const MOST_GROUPS: u32 = 65_535;

/// Which code the shaders hold. A static scene runs no skinning code, a resting one no displacement code.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Variant {
    /// Some tissue has joints.
    pub skinned: bool,
    /// Some tissue is displaced or fading.
    pub displaced: bool,
    /// Some tissue has turned particles; such a tissue is displaced too.
    pub rotated: bool,
    /// Some tissue has rows of more than three entries.
    pub long_rows: bool,
}

impl Variant {
    /// All that the deform shader has; normals are gathered from final positions, and know nothing of turns and rows.
    const DEFORM: Self = Self::of(0b1111);
    const NORMALS: Self = Self::of(0b0011);

    const fn of(bits: u8) -> Self {
        Self { skinned: bits & 1 != 0, displaced: bits & 2 != 0, rotated: bits & 4 != 0, long_rows: bits & 8 != 0 }
    }

    fn bits(self) -> u8 {
        let bit = |on: bool, bit: u8| if on { bit } else { 0 };
        bit(self.skinned, 1) | bit(self.displaced, 2) | bit(self.rotated, 4) | bit(self.long_rows, 8)
    }

    /// The code of both.
    pub fn with(self, other: Self) -> Self {
        Self::of(self.bits() | other.bits())
    }

    /// The code that both have.
    fn common(self, other: Self) -> Self {
        Self::of(self.bits() & other.bits())
    }

    /// All parts of this one that there are to compile.
    fn parts(self) -> impl Iterator<Item = Self> {
        let all = (0..=self.bits()).map(Self::of);
        all.filter(move |part| part.common(self) == *part && (part.displaced || !part.rotated))
    }
}

/// One of the two stages: a list of work, and a pipeline for each variant.
#[derive(Debug)]
struct Stage {
    name: &'static str,
    layout: wgpu::BindGroupLayout,
    /// What of a variant it can tell apart.
    knows: Variant,
    pipelines: Vec<(Variant, wgpu::ComputePipeline)>,
    work: WorkList,
    bind_group: Option<(u64, wgpu::BindGroup)>,
    storage: &'static [ArenaKind],
}

/// The two stages.
#[derive(Debug)]
pub struct DeformPass {
    stages: [Stage; 2],
}

/// Most arenas that a stage binds.
const MOST_ARENAS: usize = 6;
/// Arenas at bindings 2 and up; 5 is written.
const DEFORM_ARENAS: [ArenaKind; 4] = [ArenaKind::Vertices, ArenaKind::Terms, ArenaKind::Vectors, ArenaKind::Deformed];
const NORMALS_ARENAS: [ArenaKind; 6] =
    [ArenaKind::Vertices, ArenaKind::Terms, ArenaKind::Vectors, ArenaKind::Deformed, ArenaKind::Faces, ArenaKind::Wedges];

impl DeformPass {
    /// Compiles the pipelines.
    pub fn new(context: &Context) -> Self {
        Self {
            stages: [
                Stage::new(context, "deform", &DEFORM_ARENAS, Variant::DEFORM),
                Stage::new(context, "normals", &NORMALS_ARENAS, Variant::NORMALS),
            ],
        }
    }

    /// Starts new lists of work.
    pub fn begin(&mut self) {
        self.stages.iter_mut().for_each(|s| s.work.items.clear());
    }

    /// True if there is no work.
    pub fn is_idle(&self) -> bool {
        self.stages[0].work.items.is_empty()
    }

    /// Adds a workgroup: the tissue's vertices from `first` on to stage 0, or wedges to stage 1.
    pub fn add(&mut self, stage: usize, tissue: u32, first: u32) {
        self.stages[stage].work.items.push(WorkItem { tissue, first });
    }

    /// Workgroups of both stages.
    pub fn groups(&self) -> u64 {
        self.stages.iter().map(|s| s.work.items.len() as u64).sum()
    }

    /// Encodes all uploads noted so far and the work that was added. `table` is the tissue table and a number that changes when
    /// it is replaced. Returns dispatches.
    pub fn encode(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        arenas: &mut Arenas,
        table: (&wgpu::Buffer, u64),
        variant: Variant,
        timestamps: Option<wgpu::ComputePassTimestampWrites<'_>>,
    ) -> u64 {
        let mut dispatches = 0;
        if self.stages[0].work.items.is_empty() {
            return 0;
        }
        let groups = self.stages.each_mut().map(|stage| stage.work.upload(context, arenas.belt()));
        arenas.belt().flush(context, encoder);
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("deform"), timestamp_writes: timestamps });
        for (stage, groups) in self.stages.iter_mut().zip(groups) {
            stage.bind(context, arenas, table);
            let known = variant.common(stage.knows);
            let pipeline = stage.pipelines.iter().find(|p| p.0 == known);
            if let (Some((_, bind_group)), Some((_, pipeline)), 1..) = (&stage.bind_group, pipeline, groups.0) {
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, bind_group, &[]);
                pass.dispatch_workgroups(groups.0, groups.1, 1);
                dispatches += 1;
            }
        }
        dispatches
    }
}

impl Stage {
    fn new(context: &Context, name: &'static str, storage: &'static [ArenaKind], knows: Variant) -> Self {
        let device = context.device();
        let entries: Vec<_> = (0..storage.len() as u32 + 2).map(|b| storage_entry(b, b != 5)).collect();
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(name), entries: &entries });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(name),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(name),
            source: wgpu::ShaderSource::Wgsl(types::shader_for(name, true)),
        });
        let compile = |variant: Variant| {
            context.note_pipeline();
            let on = |is: bool| f64::from(u8::from(is));
            let constants = [
                ("skinned", on(variant.skinned)),
                ("displaced", on(variant.displaced)),
                ("rotated", on(variant.rotated)),
                ("long_rows", on(variant.long_rows)),
            ];
            let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(name),
                layout: Some(&pipeline_layout),
                module: &module,
                entry_point: Some(name),
                compilation_options: wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() },
                cache: None,
            });
            (variant, pipeline)
        };
        let pipelines = knows.parts().map(compile).collect();
        Self { name, layout, knows, pipelines, work: WorkList::new(context), bind_group: None, storage }
    }

    fn bind(&mut self, context: &Context, arenas: &Arenas, table: (&wgpu::Buffer, u64)) {
        let generation = arenas.generation() + table.1 + self.work.generation;
        if self.bind_group.as_ref().is_some_and(|b| b.0 == generation) {
            return;
        }
        let buffer = |b: usize| match b {
            0 => table.0,
            1 => &self.work.buffer,
            b => arenas.buffer(self.storage[(b - 2).min(self.storage.len() - 1)]),
        };
        let entries: [_; 2 + MOST_ARENAS] = std::array::from_fn(|b| entry(b as u32, buffer(b)));
        let bind_group = context.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.name),
            layout: &self.layout,
            entries: &entries[..2 + self.storage.len()],
        });
        self.bind_group = Some((generation, bind_group));
    }
}

fn storage_entry(binding: u32, read_only: bool) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    }
}

fn entry(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }
}

/// A list of workgroups' work, kept on the GPU as long as it stays the same.
#[derive(Debug)]
struct WorkList {
    items: Vec<WorkItem>,
    uploaded: Vec<WorkItem>,
    buffer: wgpu::Buffer,
    generation: u64,
}

impl WorkList {
    fn new(context: &Context) -> Self {
        Self { items: Vec::new(), uploaded: Vec::new(), buffer: Self::make(context, 256), generation: 0 }
    }

    fn make(context: &Context, items: usize) -> wgpu::Buffer {
        context.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("work"),
            size: (items * size_of::<WorkItem>()) as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// Workgroups along x and y.
    fn upload(&mut self, context: &Context, belt: &mut Belt) -> (u32, u32) {
        let groups = dispatch_shape(self.items.len() as u32);
        self.items.resize(groups.0 as usize * groups.1 as usize, WorkItem { tissue: u32::MAX, first: 0 });
        let same = self.items.iter().zip(&self.uploaded).take_while(|(a, b)| a == b).count();
        let mut first = same;
        if self.buffer.size() < (self.items.len() * size_of::<WorkItem>()) as u64 {
            self.buffer = Self::make(context, self.items.len() * 3 / 2);
            self.generation += 1;
            first = 0;
        }
        // What is on the GPU past the list's end stays valid, so going back to a longer list costs nothing either.
        if first == self.items.len() {
            return groups;
        }
        belt.write(&self.buffer, (first * size_of::<WorkItem>()) as u64, &self.items[first..]);
        self.uploaded.truncate(first);
        self.uploaded.extend_from_slice(&self.items[first..]);
        groups
    }
}

/// The flattest rectangle that holds `groups` workgroups.
fn dispatch_shape(groups: u32) -> (u32, u32) {
    if groups == 0 {
        return (0, 0);
    }
    let rows = groups.div_ceil(MOST_GROUPS);
    (groups.div_ceil(rows), rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_variant_finds_its_pipeline() {
        for (stage, count) in [(Variant::DEFORM, 12), (Variant::NORMALS, 4)] {
            let parts: Vec<Variant> = stage.parts().collect();
            assert_eq!(parts.len(), count);
            // a turned tissue is displaced too
            let wanted = (0..16).map(Variant::of).filter(|v| v.displaced || !v.rotated);
            assert!(wanted.map(|v| v.common(stage)).all(|v| parts.contains(&v)));
        }
    }

    #[test]
    fn dispatches_hold_all_groups_within_limits() {
        for groups in [0, 1, 64, 65_535, 65_536, 1_000_000, 50_000_000] {
            let (x, y) = dispatch_shape(groups);
            assert!(x <= MOST_GROUPS && u64::from(x) * u64::from(y) >= u64::from(groups));
            assert!(u64::from(x) * u64::from(y) < u64::from(groups) + u64::from(y.max(1)));
        }
    }
}
