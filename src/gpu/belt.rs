//! The one staging belt: all uploads of a frame and the moves between them, noted in order and encoded together, so that an
//! edit of many small ranges costs no buffer each and an arena that grows in the middle loses nothing.

use super::context::Context;

/// What was noted.
#[derive(Debug)]
enum Step {
    /// Bytes `start..start + len` of the notes, to a place of a buffer.
    Write { target: wgpu::Buffer, offset: u64, start: usize, len: usize },
    /// Zeros.
    Clear { target: wgpu::Buffer, offset: u64, len: u64 },
    /// Bytes of one buffer to another.
    Copy { from: (wgpu::Buffer, u64), to: (wgpu::Buffer, u64), len: u64 },
}

/// Notes of uploads and copies, in order.
#[derive(Debug)]
pub struct Belt {
    staging: wgpu::util::StagingBelt,
    bytes: Vec<u8>,
    steps: Vec<Step>,
    uploaded: u64,
}

/// Staging memory comes in pieces of this size, or larger where one write is.
const PIECE: u64 = 64 << 10;
/// Bytes of a frame, and ranges that they go to, that there is room for at first.
const BYTES: usize = 1 << 20;
const STEPS: usize = 4096;
/// After an upload larger than this (a new model) the memory for it is given back.
const KEEP: usize = 16 << 20;

impl Belt {
    /// Nothing noted.
    pub fn new(context: &Context) -> Self {
        let staging = wgpu::util::StagingBelt::new(context.device().clone(), PIECE);
        Self { staging, bytes: Vec::with_capacity(BYTES), steps: Vec::with_capacity(STEPS), uploaded: 0 }
    }

    /// Bytes noted for upload so far, in all.
    pub fn bytes_uploaded(&self) -> u64 {
        self.uploaded
    }

    /// Counts an upload that goes another way.
    pub fn count(&mut self, bytes: usize) {
        self.uploaded += bytes as u64;
    }

    /// Notes an upload of plain values to a place of a buffer.
    pub fn write<T: bytemuck::Pod>(&mut self, target: &wgpu::Buffer, offset: u64, values: &[T]) {
        self.write_each(target, offset, values.iter().copied());
    }

    /// Notes an upload of what an iterator gives.
    pub fn write_each<T: bytemuck::Pod>(&mut self, target: &wgpu::Buffer, offset: u64, values: impl Iterator<Item = T>) {
        let start = self.bytes.len();
        values.for_each(|v| self.bytes.extend_from_slice(bytemuck::bytes_of(&v)));
        let len = self.bytes.len() - start;
        if len > 0 {
            self.steps.push(Step::Write { target: target.clone(), offset, start, len });
            self.uploaded += len as u64;
        }
    }

    /// Notes a copy on the GPU, after everything noted before.
    pub fn copy(&mut self, from: (&wgpu::Buffer, u64), to: (&wgpu::Buffer, u64), len: u64) {
        if len > 0 {
            self.steps.push(Step::Copy { from: (from.0.clone(), from.1), to: (to.0.clone(), to.1), len });
        }
    }

    /// Notes that a place of a buffer becomes zero.
    pub fn clear(&mut self, target: &wgpu::Buffer, offset: u64, len: u64) {
        if len > 0 {
            self.steps.push(Step::Clear { target: target.clone(), offset, len });
        }
    }

    /// Encodes everything noted. The encoder must be submitted.
    pub fn flush(&mut self, context: &Context, encoder: &mut wgpu::CommandEncoder) {
        if self.steps.is_empty() {
            return;
        }
        if context.check().is_err() {
            // A lost device maps no memory; whoever comes next begins with everything anew.
            self.steps.clear();
            self.bytes.clear();
            return;
        }
        let whole = self.stage(context);
        for step in self.steps.drain(..) {
            match step {
                Step::Write { target, offset, start, len } => {
                    if let Some((staged, first)) = &whole {
                        encoder.copy_buffer_to_buffer(staged, first + start as u64, &target, offset, len as u64);
                        continue;
                    }
                    let Some(size) = wgpu::BufferSize::new(len as u64) else { continue };
                    let mut view = self.staging.write_buffer(encoder, &target, offset, size);
                    view.copy_from_slice(&self.bytes[start..start + len]);
                }
                Step::Clear { target, offset, len } => encoder.clear_buffer(&target, offset, Some(len)),
                Step::Copy { from, to, len } => encoder.copy_buffer_to_buffer(&from.0, from.1, &to.0, to.1, len),
            }
        }
        self.staging.finish_and_recall_on_submit(encoder);
        if self.bytes.len() > KEEP {
            self.bytes = Vec::new();
            self.staging = wgpu::util::StagingBelt::new(context.device().clone(), PIECE);
        }
        self.bytes.clear();
    }

    /// All bytes in one piece of staging memory, and where in its buffer, unless they are too many: a piece for each of an edit's
    /// many writes takes longer.
    fn stage(&mut self, context: &Context) -> Option<(wgpu::Buffer, u64)> {
        let most = context.device().limits().max_buffer_size.min(KEEP as u64);
        let size = wgpu::BufferSize::new(self.bytes.len() as u64).filter(|size| size.get() <= most)?;
        let slice = self.staging.allocate(size, wgpu::BufferSize::new(wgpu::COPY_BUFFER_ALIGNMENT)?);
        slice.get_mapped_range_mut().ok()?.copy_from_slice(&self.bytes);
        Some((slice.buffer().clone(), slice.offset()))
    }
}
