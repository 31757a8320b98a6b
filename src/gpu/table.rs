//! The table of tissue records, one a tissue, on the GPU.

use super::belt::Belt;
use super::context::Context;
use super::types::{TissueRecord, UNIFORM_TISSUES};

/// The records of all tissues.
#[derive(Debug)]
pub struct Table {
    records: Vec<TissueRecord>,
    dirty: std::ops::Range<usize>,
    buffer: wgpu::Buffer,
    generation: u64,
}

impl Table {
    /// Room for some; for all that there can be where shaders read it as a uniform.
    pub fn new(context: &Context, tissues: usize) -> Self {
        let tissues = if context.deforms() { tissues } else { UNIFORM_TISSUES };
        Self { records: Vec::new(), dirty: 0..0, buffer: Self::make(context, tissues), generation: 0 }
    }

    /// The buffer, and a number that changes when it is replaced.
    pub fn buffer(&self) -> (&wgpu::Buffer, u64) {
        (&self.buffer, self.generation)
    }

    fn make(context: &Context, tissues: usize) -> wgpu::Buffer {
        context.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("tissues"),
            size: (tissues * size_of::<TissueRecord>()) as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// Changes a record.
    pub fn set(&mut self, slot: u32, record: TissueRecord) {
        let slot = slot as usize;
        if self.records.len() <= slot {
            self.records.resize(slot + 1, TissueRecord::default());
        } else if self.records[slot] == record {
            return;
        }
        self.records[slot] = record;
        self.dirty =
            if self.dirty.is_empty() { slot..slot + 1 } else { self.dirty.start.min(slot)..self.dirty.end.max(slot + 1) };
    }

    /// Writes the records that changed; false if none has.
    pub fn upload(&mut self, context: &Context, belt: &mut Belt) -> bool {
        if self.dirty.is_empty() {
            return false;
        }
        if self.buffer.size() < (self.records.len() * size_of::<TissueRecord>()) as u64 {
            self.buffer = Self::make(context, self.records.len() * 2);
            self.generation += 1;
            self.dirty = 0..self.records.len();
        }
        let range = std::mem::replace(&mut self.dirty, 0..0);
        let bytes: &[u8] = bytemuck::cast_slice(&self.records[range.clone()]);
        belt.write(&self.buffer, (range.start * size_of::<TissueRecord>()) as u64, bytes);
        true
    }
}
