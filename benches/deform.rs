//! The deform pass of a model of a million vertices against a plain copy of as many bytes on the same adapter: what is left to gain.
//! Prints medians and ratios. By the GPU's own clock; on a software adapter, whose timestamps do not wait for the work, by the time from
//! submission to the end, and the figures are the CPU's.

#[path = "../tests/gpu_support/mod.rs"]
mod gpu_support;

use glam::DVec3;
use gpu_support::{Model, bar, bend};
use incise::gpu::readback::read_buffer;
use incise::gpu::{AdapterKind, Camera, Context, ContextOptions, DrawOptions, Renderer, Scenery, TissueDirty, Variant};
use std::sync::Arc;
use std::time::Instant;

const FRAMES: usize = 24;
/// Most bytes that are copied, read and written together: every adapter's buffers hold half of it. More are reckoned from them.
const MOST: u64 = 200_000_000;

const COPY: &str = "
@group(0) @binding(0) var<storage, read> from_here: array<vec4u>;
@group(0) @binding(1) var<storage, read_write> to_there: array<vec4u>;
@compute @workgroup_size(64)
fn copy(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = id.x + id.y * groups.x * 64u;
    if (k < arrayLength(&from_here)) {
        to_there[k] = from_here[k];
    }
}";

fn is_software(context: &Context) -> bool {
    context.adapter_kind() == AdapterKind::Software
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Milliseconds that a compute shader takes to read and to write `bytes / 2`.
fn copy_ms(context: &Context, bytes: u64) -> f64 {
    let device = context.device();
    let usage = wgpu::BufferUsages::STORAGE;
    let buffer =
        |size, usage| device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let [source, target] = [buffer(bytes / 32 * 16, usage), buffer(bytes / 32 * 16, usage)];
    let resolved = buffer(16, wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC);
    let module =
        device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source: wgpu::ShaderSource::Wgsl(COPY.into()) });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("copy"),
        compilation_options: Default::default(),
        cache: None,
    });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: source.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: target.as_entire_binding() },
        ],
    });
    let descriptor = wgpu::QuerySetDescriptor { label: None, ty: wgpu::QueryType::Timestamp, count: 2 };
    let query_set = &device.create_query_set(&descriptor);
    let timestamp_writes = Some(wgpu::ComputePassTimestampWrites {
        query_set,
        beginning_of_pass_write_index: Some(0),
        end_of_pass_write_index: Some(1),
    });
    let groups = (source.size() / 16).div_ceil(64) as u32;
    let once = |_| {
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes: timestamp_writes.clone() });
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(groups.div_ceil(groups.div_ceil(65_535)), groups.div_ceil(65_535), 1);
        drop(pass);
        encoder.resolve_query_set(query_set, 0..2, &resolved, 0);
        let start = Instant::now();
        context.queue().submit([encoder.finish()]);
        context.wait().expect("done");
        if is_software(context) {
            return start.elapsed().as_secs_f64() * 1e3;
        }
        let ticks: Vec<u64> = bytemuck::pod_collect_to_vec(&read_buffer(context, &resolved, 0, 16).expect("timestamps"));
        ticks[1].saturating_sub(ticks[0]) as f64 * f64::from(context.queue().get_timestamp_period()) * 1e-6
    };
    median((0..FRAMES).map(once).collect())
}

/// Milliseconds of the deform pass while the model bends.
fn deform_ms(renderer: &mut Renderer, model: &mut Model, code: Variant) -> f64 {
    let camera = Camera { eye: DVec3::Z * 5.0, target: DVec3::Z * 6.0, up: DVec3::Y, fov_y: 0.5 };
    let scenery = Scenery { tray: false, shadow: false, ..Default::default() };
    renderer.remove(1);
    renderer.sync(1, &model.view(), &TissueDirty::Full).expect("sync");
    let mut times = Vec::new();
    for frame in 0..FRAMES {
        model.pose = bend(0.02 * frame as f64);
        model.versions.pose += 1;
        renderer.sync(1, &model.view(), &TissueDirty::clean()).expect("sync");
        renderer.take_counters();
        let start = Instant::now();
        if is_software(renderer.context()) {
            renderer.deform().expect("deformed");
            renderer.context().wait().expect("done");
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        renderer.draw(&camera, (8, 8), &DrawOptions { scenery, ..Default::default() }).expect("drawn");
        renderer.context().wait().expect("done");
        let counters = renderer.take_counters();
        let groups = model.mesh.vertex_slots().div_ceil(64) + model.mesh.wedges().len().div_ceil(64);
        assert_eq!((counters.code, counters.dispatches, counters.workgroups), (code, 2, groups as u64));
        let passes = renderer.gpu_times().unwrap_or_default();
        times.extend(passes.passes().iter().filter(|p| p.0 == "deform").map(|p| p.1));
    }
    median(times)
}

fn main() {
    let context = Arc::new(Context::headless(ContextOptions::default()).expect("an adapter"));
    let kind = if is_software(&context) { "a software adapter: the CPU's figures" } else { "a GPU" };
    println!("{}, {kind}", context.adapter_name());
    let mut renderer = Renderer::new(context.clone());
    if !is_software(&context) && !renderer.set_timing(true) {
        println!("no timestamps, nothing to measure");
        return;
    }
    let skinned = Variant { skinned: true, ..Variant::default() };
    let particles: Vec<_> = (0..10).map(|k| (DVec3::X * (0.1 * f64::from(k) - 0.45), DVec3::Y * 0.01)).collect();
    for (name, displaced) in [("skinned", false), ("skinned and displaced", true)] {
        let mut model = if displaced { bar(214).with_particles(&particles, 0.2) } else { bar(214) };
        let ms = deform_ms(&mut renderer, &mut model, Variant { displaced, ..skinned });
        // What has to be read and written once: vertex records and bones by both dispatches, wedges, positions, normals; if displaced,
        // influences, and positions and faces for the normals.
        let (v, w, f) = (model.mesh.vertex_slots(), model.mesh.wedges().len(), model.mesh.face_slots());
        let bones = model.rows.bones.arena().len();
        let moved = if displaced { model.map.influences.arena().len() * 8 + v * 16 + f * 32 } else { 0 };
        let bytes = (2 * (v * 40 + bones * 8) + v * 16 + w * (32 + 16) + moved) as u64;
        let part = bytes.min(MOST);
        let copied = copy_ms(&context, part) * bytes as f64 / part as f64;
        let rate = |ms: f64| bytes as f64 / ms * 1e-6;
        println!(
            "{name}: {v} vertices, {:.0} MB; deform {ms:.3} ms ({:.1} GB/s), copy {copied:.3} ms ({:.1} GB/s), ratio {:.2}",
            bytes as f64 * 1e-6,
            rate(ms),
            rate(copied),
            ms / copied
        );
    }
}
