//! Storage buffers shared by all tissues, a range each, with headroom.
//!
//! A range that outgrows its room moves; its content is copied on the GPU, so that an edit never uploads a whole mesh
//! again. An arena that is full is replaced by a larger one the same way.
//!
//! Memory: [`bytes_per_model`]. Headroom adds a quarter (a half, up to 65,536 elements), and to what is small as much as twice what
//! there is (to terms, which edits write anew most, eight times; 8 MB a tissue at most): a range that moves costs a frame a copy and two
//! allocations. Where memory is short there is none.

use super::allocator::RangeAllocator;
use super::belt::Belt;
use super::context::Context;
use super::error::GpuError;
use super::types::{FaceRecord, Term, VertexRecord};
use crate::geometry::Wedge;
use std::ops::Range;

/// Which buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArenaKind {
    /// Vertex records.
    Vertices,
    /// Bones, rows and influences.
    Terms,
    /// Joint matrices, displacements, fades, turns.
    Vectors,
    /// Face records.
    Faces,
    /// Wedges.
    Wedges,
    /// Final positions and normals; written on the GPU only.
    Deformed,
}

const KINDS: [(ArenaKind, &str, usize); 6] = [
    (ArenaKind::Vertices, "vertices", size_of::<VertexRecord>()),
    (ArenaKind::Terms, "bones, rows and influences", size_of::<Term>()),
    (ArenaKind::Vectors, "joints, displacements and fades", 16),
    (ArenaKind::Faces, "faces", size_of::<FaceRecord>()),
    (ArenaKind::Wedges, "wedges", size_of::<Wedge>()),
    (ArenaKind::Deformed, "final positions and normals", 16),
];

/// GPU bytes that a model takes without headroom, from its counts: vertices 40 + 16 (final position), wedges 32 + 16
/// (final normal), faces 32, 8 a bone, row entry or influence (`terms`), 16 a vector: three a joint, one a particle's displacement
/// (four while particles turn), and, once anything has faded, one a vertex.
///
/// A closed surface has two faces a vertex. With one wedge a vertex, two bones and four influences that makes 216 bytes a vertex, and
/// 232 once it was torn.
pub fn bytes_per_model(vertices: usize, wedges: usize, faces: usize, terms: usize, vectors: usize) -> usize {
    vertices * (size_of::<VertexRecord>() + 16)
        + wedges * (size_of::<Wedge>() + 16)
        + faces * size_of::<FaceRecord>()
        + terms * size_of::<Term>()
        + vectors * 16
}

/// Elements of an arena that belong to one stream of one tissue: `start .. start + len` in use, more reserved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Slot {
    /// First element.
    pub start: u32,
    /// Elements in use.
    pub len: u32,
    /// Elements reserved.
    pub room: u32,
}

impl Slot {
    fn reserved(self) -> Range<u32> {
        self.start..self.start + self.room
    }
}

#[derive(Debug)]
struct Arena {
    name: &'static str,
    stride: u64,
    buffer: wgpu::Buffer,
    allocator: RangeAllocator,
}

/// Bytes that a buffer may hold.
fn most_bytes(context: &Context) -> u64 {
    let limits = context.device().limits();
    limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
}

impl Arena {
    fn most_elements(&self, context: &Context) -> u64 {
        (most_bytes(context) / self.stride).min(u64::from(u32::MAX / 4))
    }
}

/// All arenas.
#[derive(Debug)]
pub struct Arenas {
    arenas: [Arena; 6],
    /// Counts up whenever a buffer was replaced, so that bind groups know.
    generation: u64,
    belt: Belt,
    structure_bytes: u64,
}

const USAGE: wgpu::BufferUsages =
    wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST).union(wgpu::BufferUsages::COPY_SRC);

/// Half as much again is given up to this many elements, a quarter beyond.
const MOST_HALF: u64 = 1 << 16;
/// Room that a small range gets, elements at most: vertices and wedges; faces; terms; vectors, as strokes add particles.
const MOST_MORE: u64 = 1 << 13;
const MOST_FACES_MORE: u64 = super::tissue_pass::GAP as u64 - 64;
const MOST_TERMS_MORE: u64 = 1 << 18;
const MOST_VECTORS_MORE: u64 = 1 << 12;
/// Small ranges get that while their arena holds less than this share of what a buffer may hold.
const AMPLE: u64 = 8;
/// Smallest capacity of an arena, elements.
const SMALLEST: u32 = 1024;

impl Arenas {
    /// Empty arenas on a device.
    pub fn new(context: &Context) -> Self {
        let arenas = KINDS.map(|(_, name, stride)| {
            let mut allocator = RangeAllocator::default();
            allocator.grow(SMALLEST);
            let buffer = make_buffer(context.device(), name, u64::from(SMALLEST) * stride as u64);
            Arena { name, stride: stride as u64, buffer, allocator }
        });
        Self { arenas, generation: 0, belt: Belt::new(context), structure_bytes: 0 }
    }

    /// The buffer of a kind.
    pub fn buffer(&self, kind: ArenaKind) -> &wgpu::Buffer {
        &self.arenas[kind as usize].buffer
    }

    /// Changes whenever a buffer is replaced.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// Bytes uploaded so far.
    pub fn bytes_uploaded(&self) -> u64 {
        self.belt.bytes_uploaded()
    }

    /// Those of them that were structure: records and terms.
    pub fn structure_bytes(&self) -> u64 {
        self.structure_bytes
    }

    /// Bytes of all buffers.
    pub fn bytes_held(&self) -> u64 {
        self.arenas.iter().map(|a| a.buffer.size()).sum()
    }

    /// Bytes of a slot in use.
    pub fn bytes_used(&self, kind: ArenaKind, slot: Slot) -> u64 {
        u64::from(slot.len) * self.arenas[kind as usize].stride
    }

    /// What all uploads go through.
    pub fn belt(&mut self) -> &mut Belt {
        &mut self.belt
    }

    /// Makes `slot` hold `len` elements. With `keep`, content that has to move is copied on the GPU; without it the content
    /// is lost on a move. Errors: more than a buffer of this adapter holds; then the slot is as it was.
    pub fn resize(
        &mut self,
        context: &Context,
        kind: ArenaKind,
        slot: &mut Slot,
        len: usize,
        keep: bool,
    ) -> Result<(), GpuError> {
        if len <= slot.room as usize {
            slot.len = len as u32;
            return Ok(());
        }
        let wanted = len as u64;
        let ample = ample_room(kind, wanted);
        let arena = &self.arenas[kind as usize];
        let is_short = AMPLE * (u64::from(arena.allocator.capacity()) + ample) > arena.most_elements(context);
        let room = if is_short { wanted + wanted / 4 } else { ample };
        let in_full = self.take(context, kind, room.next_multiple_of(64));
        let range = in_full.or_else(|_| self.take(context, kind, wanted.next_multiple_of(64)))?;
        let arena = &mut self.arenas[kind as usize];
        if keep && slot.len > 0 {
            move_content(context, &mut self.belt, arena, slot.start, range.start, slot.len);
        }
        arena.allocator.give(slot.reserved());
        *slot = Slot { start: range.start, len: len as u32, room: range.end - range.start };
        Ok(())
    }

    /// Gives a slot back.
    pub fn release(&mut self, kind: ArenaKind, slot: &mut Slot) {
        self.arenas[kind as usize].allocator.give(slot.reserved());
        *slot = Slot::default();
    }

    /// Uploads the entries `range` of the slot, as `element` gives them.
    pub fn upload<T: bytemuck::Pod>(
        &mut self,
        kind: ArenaKind,
        slot: Slot,
        range: Range<usize>,
        element: impl FnMut(usize) -> T,
    ) {
        debug_assert!(range.end <= slot.len as usize && size_of::<T>() as u64 == self.arenas[kind as usize].stride);
        let arena = &self.arenas[kind as usize];
        let offset = (u64::from(slot.start) + range.start as u64) * arena.stride;
        if !matches!(kind, ArenaKind::Vectors | ArenaKind::Deformed) {
            self.structure_bytes += range.len() as u64 * arena.stride;
        }
        self.belt.write_each(&arena.buffer, offset, range.map(element));
    }

    /// Makes the entries `range` of the slot zero, without an upload.
    pub fn clear(&mut self, kind: ArenaKind, slot: Slot, range: Range<usize>) {
        let arena = &self.arenas[kind as usize];
        let offset = (u64::from(slot.start) + range.start as u64) * arena.stride;
        self.belt.clear(&arena.buffer, offset, range.len() as u64 * arena.stride);
    }

    fn take(&mut self, context: &Context, kind: ArenaKind, room: u64) -> Result<Range<u32>, GpuError> {
        let arena = &mut self.arenas[kind as usize];
        let fits = u32::try_from(room).ok();
        if let Some(range) = fits.and_then(|room| arena.allocator.take(room)) {
            return Ok(range);
        }
        let (limit_bytes, limit) = (most_bytes(context), arena.most_elements(context));
        let capacity = u64::from(arena.allocator.capacity());
        let needed = capacity - u64::from(arena.allocator.tail_gap()) + room;
        if needed > limit {
            return Err(GpuError::TooLarge { what: arena.name, needed_bytes: needed * arena.stride, limit_bytes });
        }
        let grown = needed.max(capacity + capacity / 2).min(limit);
        let buffer = make_buffer(context.device(), arena.name, grown * arena.stride);
        self.belt.copy((&arena.buffer, 0), (&buffer, 0), capacity * arena.stride);
        arena.buffer = buffer;
        arena.allocator.grow(grown as u32);
        self.generation += 1;
        Ok(arena.allocator.take(room as u32).expect("the arena was grown to hold it"))
    }
}

/// Elements that a range of `len` gets, at best.
fn ample_room(kind: ArenaKind, len: u64) -> u64 {
    let more = match kind {
        ArenaKind::Terms => (8 * len).min(MOST_TERMS_MORE),
        ArenaKind::Vectors => (4 * len).min(MOST_VECTORS_MORE),
        // faces of pieces beside each other are drawn as one run, over gaps that are small
        ArenaKind::Faces => len.min(MOST_FACES_MORE),
        _ => (2 * len).min(MOST_MORE),
    };
    len + more.max(len / 4).max((len / 2).min(MOST_HALF))
}

fn make_buffer(device: &wgpu::Device, label: &str, size: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage: USAGE, mapped_at_creation: false })
}

/// Copies elements within a buffer, through a scratch buffer, since a copy may not have one buffer at both ends.
fn move_content(context: &Context, belt: &mut Belt, arena: &Arena, from: u32, to: u32, len: u32) {
    let bytes = u64::from(len) * arena.stride;
    let scratch = make_buffer(context.device(), "arena move", bytes);
    belt.copy((&arena.buffer, u64::from(from) * arena.stride), (&scratch, 0), bytes);
    belt.copy((&scratch, 0), (&arena.buffer, u64::from(to) * arena.stride), bytes);
}
