//! How long each pass took on the GPU, where the adapter tells: timestamps around every pass, brought back a few frames later
//! without waiting. Off unless asked for, since it is a read-back.

use super::context::Context;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// Most passes of one frame that are timed: deform, shadow, and eight views.
const MOST_PASSES: usize = 10;
/// Frames under way at once.
pub const FRAMES: usize = 4;

/// Milliseconds of each pass of a frame, in the order of the passes; several of one name where there are several views.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GpuTimes {
    passes: [(&'static str, f64); MOST_PASSES],
    len: usize,
    frame: u64,
}

impl GpuTimes {
    /// Names and milliseconds.
    pub fn passes(&self) -> &[(&'static str, f64)] {
        &self.passes[..self.len]
    }

    /// Which of the frames that were timed, from 1.
    pub fn frame(&self) -> u64 {
        self.frame
    }

    /// Sum of all passes, milliseconds.
    pub fn total_ms(&self) -> f64 {
        self.passes().iter().map(|p| p.1).sum()
    }

    fn push(&mut self, name: &'static str, ms: f64) {
        if self.len < MOST_PASSES {
            self.passes[self.len] = (name, ms);
            self.len += 1;
        }
    }
}

const FREE: u8 = 0;
const UNDER_WAY: u8 = 1;
const READY: u8 = 2;

#[derive(Debug)]
struct Frame {
    buffer: wgpu::Buffer,
    state: Arc<AtomicU8>,
    names: [&'static str; MOST_PASSES],
    len: usize,
    number: u64,
}

/// Queries and buffers; nothing at all where the adapter has no timestamps.
#[derive(Debug)]
pub struct Timer {
    on: bool,
    queries: Option<(wgpu::QuerySet, wgpu::Buffer)>,
    frames: Vec<Frame>,
    /// The frame being encoded.
    current: Option<usize>,
    number: u64,
    ms_per_tick: f64,
    latest: Option<GpuTimes>,
}

impl Timer {
    /// Off.
    pub fn new(context: &Context) -> Self {
        let ms_per_tick = f64::from(context.queue().get_timestamp_period()) * 1e-6;
        Self { on: false, queries: None, frames: Vec::new(), current: None, number: 0, ms_per_tick, latest: None }
    }

    /// Turns timing on or off. False if the adapter has no timestamps: it stays off.
    pub fn set(&mut self, context: &Context, on: bool) -> bool {
        let device = context.device();
        let can = device.features().contains(wgpu::Features::TIMESTAMP_QUERY) && self.ms_per_tick > 0.0;
        self.on = on && can;
        if self.on && self.queries.is_none() {
            let set = device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("pass times"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * MOST_PASSES as u32,
            });
            let buffer = |usage| {
                device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("pass times"),
                    size: 16 * MOST_PASSES as u64,
                    usage,
                    mapped_at_creation: false,
                })
            };
            self.queries = Some((set, buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC)));
            self.frames.extend((0..FRAMES).map(|_| Frame {
                buffer: buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ),
                state: Arc::new(AtomicU8::new(FREE)),
                names: [""; MOST_PASSES],
                len: 0,
                number: 0,
            }));
        }
        can
    }

    /// Starts a frame; one that finds no buffer free is not timed.
    pub fn begin(&mut self) {
        self.collect();
        self.current = None;
        if self.on {
            self.current = self.frames.iter().position(|f| f.state.load(Ordering::Acquire) == FREE);
        }
        if let Some(frame) = self.current {
            self.number += 1;
            self.frames[frame].len = 0;
            self.frames[frame].number = self.number;
        }
    }

    /// The query set and the two queries of the next pass.
    fn next(&mut self, name: &'static str) -> Option<(&wgpu::QuerySet, u32)> {
        let frame = &mut self.frames[self.current?];
        let (set, _) = self.queries.as_ref()?;
        if frame.len == MOST_PASSES {
            return None;
        }
        frame.names[frame.len] = name;
        frame.len += 1;
        Some((set, 2 * (frame.len as u32 - 1)))
    }

    /// What a compute pass is to write.
    pub fn compute(&mut self, name: &'static str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        self.next(name).map(|(query_set, first)| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        })
    }

    /// What a render pass is to write.
    pub fn render(&mut self, name: &'static str) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        self.next(name).map(|(query_set, first)| wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        })
    }

    /// Ends a frame: its times come back once the encoder has been submitted and run.
    pub fn end(&mut self, encoder: &mut wgpu::CommandEncoder) {
        let (Some(current), Some((set, resolved))) = (self.current.take(), &self.queries) else { return };
        let frame = &self.frames[current];
        if frame.len == 0 {
            return;
        }
        encoder.resolve_query_set(set, 0..2 * frame.len as u32, resolved, 0);
        encoder.copy_buffer_to_buffer(resolved, 0, &frame.buffer, 0, 16 * frame.len as u64);
        frame.state.store(UNDER_WAY, Ordering::Release);
        let state = Arc::clone(&frame.state);
        encoder.map_buffer_on_submit(&frame.buffer, wgpu::MapMode::Read, .., move |result| {
            state.store(if result.is_ok() { READY } else { FREE }, Ordering::Release);
        });
    }

    /// The latest frame whose times have come back.
    pub fn latest(&mut self) -> Option<GpuTimes> {
        self.collect();
        self.latest
    }

    fn collect(&mut self) {
        let mut newest = 0;
        for frame in self.frames.iter().filter(|f| f.state.load(Ordering::Acquire) == READY) {
            let mut times = GpuTimes { frame: frame.number, ..GpuTimes::default() };
            if let Ok(data) = frame.buffer.get_mapped_range(..) {
                let ticks = |at: usize| data[8 * at..8 * at + 8].try_into().map_or(0, u64::from_le_bytes);
                for pass in 0..frame.len {
                    let between = ticks(2 * pass + 1).saturating_sub(ticks(2 * pass));
                    times.push(frame.names[pass], between as f64 * self.ms_per_tick);
                }
            }
            frame.buffer.unmap();
            frame.state.store(FREE, Ordering::Release);
            if frame.number > newest {
                newest = frame.number;
                self.latest = Some(times);
            }
        }
    }
}
