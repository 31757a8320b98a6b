//! What is uploaded and run, and when: dirty ranges, growth, sleep, fades; asserted by counters and by results.
#![cfg(feature = "gpu")]

mod gpu_support;

use glam::DVec3;
use gpu_support::{Model, bar, bend, context, sphere};
use incise::geometry::topology::{NewFace, TopologyScratch};
use incise::geometry::{FaceId, ParticleId, Turn, Wedge, WedgeId};
use incise::gpu::arenas::bytes_per_model;
use incise::gpu::context::device_descriptor;
use incise::gpu::{Camera, Context, DrawOptions, GpuCounters, GpuError, Renderer, TissueDirty, Variant};
use incise::particles::Influence;
use std::sync::Arc;

fn renderer() -> Renderer {
    Renderer::new(context())
}

fn camera() -> Camera {
    Camera { eye: DVec3::new(0.0, 1.0, 3.0), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.8 }
}

fn frame(renderer: &mut Renderer, model: &Model, dirty: &TissueDirty) -> GpuCounters {
    renderer.take_counters();
    renderer.sync(1, &model.view(), dirty).expect("sync");
    renderer.draw(&camera(), (64, 48), &DrawOptions::default()).expect("draw");
    renderer.take_counters()
}

fn clean() -> TissueDirty {
    TissueDirty::clean()
}

/// Splits a face into three around an embedded vertex, moved by particle 0 if there is one.
fn split_face(model: &mut Model, face: FaceId) {
    let corners = model.mesh.face(face);
    let wedges = model.mesh.face_wedges(face);
    let centre = model.rows.push_embedded(&corners.map(|c| (c, 1.0 / 3.0)));
    assert_eq!(model.mesh.add_vertex(), centre);
    let influences: &[Influence] = if model.map.is_empty() { &[] } else { &[Influence { particle: ParticleId(0), weight: 1.0 }] };
    model.map.influences.push_row(influences);
    let normal = model.mesh.wedge(wedges[0]).normal;
    let wedge = model.mesh.add_wedge(Wedge { vertex: centre, group: WedgeId::NONE, uv: [0.0; 2], normal, colour: u32::MAX });
    let info = model.mesh.face_info(face);
    let part = |k: usize| NewFace {
        corners: [corners[k], corners[(k + 1) % 3], centre],
        wedges: [wedges[k], wedges[(k + 1) % 3], wedge],
        info,
        side: 0,
    };
    model.mesh.replace_faces(&[face], &[part(0), part(1), part(2)], |_| 0, &mut TopologyScratch::default());
}

fn take_dirty(model: &mut Model) -> TissueDirty {
    TissueDirty::from_deltas(&model.mesh.take_delta(), &model.rows.take_delta(), &model.map.take_delta())
}

/// Positions, and normals with lips, after a fresh, full upload.
fn fresh(model: &Model) -> (Vec<[f32; 3]>, Vec<[f32; 4]>) {
    let mut other = renderer();
    other.sync(1, &model.view(), &TissueDirty::Full).expect("sync");
    other.deform().expect("deform");
    results(&other, 1)
}

fn results(renderer: &Renderer, key: u64) -> (Vec<[f32; 3]>, Vec<[f32; 4]>) {
    (renderer.read_positions(key).expect("positions"), renderer.read_normals(key).expect("normals"))
}

/// A bent bar under two particles, one displaced.
fn soft_bar() -> Model {
    let particles = [(DVec3::new(0.1, 0.1, 0.0), DVec3::new(0.0, 0.03, 0.0)), (DVec3::new(-0.3, 0.1, 0.0), DVec3::ZERO)];
    let mut model = bar(6).with_particles(&particles, 0.4);
    model.pose = bend(0.6);
    model
}

#[test]
fn a_frame_with_nothing_new_uploads_and_dispatches_nothing() {
    let mut renderer = renderer();
    let model = soft_bar();
    let first = frame(&mut renderer, &model, &TissueDirty::Full);
    assert!(first.dispatches == 2 && first.bytes_uploaded > 0 && first.draws > 0);
    let asleep = frame(&mut renderer, &model, &clean());
    assert_eq!((asleep.dispatches, asleep.bytes_uploaded), (0, 0));
    // The shadow map still holds what was drawn.
    assert_eq!(asleep.draws, first.draws - 1);
}

#[test]
fn a_new_pose_uploads_its_joints_only() {
    let mut renderer = renderer();
    let mut model = soft_bar();
    frame(&mut renderer, &model, &TissueDirty::Full);
    model.pose = bend(0.7);
    model.versions.pose += 1;
    let counters = frame(&mut renderer, &model, &clean());
    // The frame's record moves with the shadow map's; nothing else.
    let record = size_of::<incise::gpu::types::Frame>();
    assert_eq!((counters.dispatches, counters.bytes_uploaded), (2, (3 * 48 + record) as u64));
    assert_eq!(results(&renderer, 1), fresh(&model));
}

/// Particles that move wake what hangs on them and what shares a face with it, and the result is that of a full pass.
#[test]
fn a_poke_deforms_only_what_hangs_on_its_particles() {
    let particles = [(DVec3::X, DVec3::ZERO), (DVec3::NEG_Z, DVec3::ZERO)];
    let mut model = sphere(24, 1.0).with_particles(&particles, 0.4);
    let mut renderer = renderer();
    let whole = frame(&mut renderer, &model, &TissueDirty::Full).workgroups;
    let mut before = results(&renderer, 1);
    for (j, u) in [(0, DVec3::new(0.0, -0.03, 0.01)), (0, DVec3::new(0.01, 0.02, 0.0)), (1, DVec3::Z * 0.02), (0, DVec3::ZERO)] {
        model.displacements[j] = u;
        model.versions.displacements += 1;
        let counters = frame(&mut renderer, &model, &clean());
        assert_eq!(counters.dispatches, 2);
        assert!(counters.workgroups > 0 && counters.workgroups * 2 < whole, "{} of {whole}", counters.workgroups);
        let now = results(&renderer, 1);
        assert!(now != before, "a pass left out would be noticed");
        assert_eq!(now, fresh(&model));
        before = now;
    }
    // A pose, an edit, or a fade concerns everything.
    model.versions.pose += 1;
    assert_eq!(frame(&mut renderer, &model, &clean()).workgroups, whole);
    split_face(&mut model, FaceId::new(7));
    let dirty = take_dirty(&mut model);
    assert!(frame(&mut renderer, &model, &dirty).workgroups >= whole);
    model.displacements[1] = DVec3::Y * 0.01;
    model.versions.displacements += 1;
    assert!(frame(&mut renderer, &model, &clean()).workgroups * 2 < whole, "an edit is taken in");
    assert_eq!(results(&renderer, 1), fresh(&model));
}

#[test]
fn edits_upload_in_proportion_and_give_the_same_bits_as_a_full_upload() {
    let mut renderer = renderer();
    let mut model = soft_bar();
    let neighbour = sphere(8, 1.0);
    renderer.sync(0, &neighbour.view(), &TissueDirty::Full).expect("sync");
    let whole = frame(&mut renderer, &model, &TissueDirty::Full).bytes_uploaded;
    let neighbour_before = results(&renderer, 0);
    let mut most = 0;
    let mut face = 5;
    for edit in 0..400 {
        let faces = model.mesh.face_slots();
        split_face(&mut model, FaceId::new(face % faces));
        face = (face * 7 + 3) % 100_003;
        let dirty = take_dirty(&mut model);
        let counters = frame(&mut renderer, &model, &dirty);
        assert_eq!(counters.dispatches, 2);
        most = most.max(counters.bytes_uploaded);
        if edit % 80 == 79 {
            assert_eq!(results(&renderer, 1), fresh(&model), "edit {edit}");
        }
    }
    println!("whole model {whole} bytes, largest edit {most} bytes");
    assert!(most * 10 < whole, "largest edit {most}, whole model {whole}");
    assert_eq!(results(&renderer, 0), neighbour_before, "growth must not disturb a neighbour");
}

#[test]
fn an_undone_edit_returns_to_the_same_bits() {
    let mut renderer = renderer();
    let mut model = soft_bar();
    take_dirty(&mut model);
    frame(&mut renderer, &model, &TissueDirty::Full);
    let before = results(&renderer, 1);
    split_face(&mut model, FaceId(40));
    let deltas = (model.mesh.take_delta(), model.rows.take_delta(), model.map.take_delta());
    let dirty = TissueDirty::from_deltas(&deltas.0, &deltas.1, &deltas.2);
    frame(&mut renderer, &model, &dirty);
    assert_ne!(results(&renderer, 1), before);
    let back = (model.mesh.apply_delta(deltas.0), model.rows.apply_delta(deltas.1), model.map.apply_delta(deltas.2));
    frame(&mut renderer, &model, &TissueDirty::from_deltas(&back.0, &back.1, &back.2));
    assert_eq!(results(&renderer, 1), before);
}

#[test]
fn an_edit_that_is_not_told_is_noticed() {
    let mut renderer = renderer();
    let mut model = soft_bar();
    frame(&mut renderer, &model, &TissueDirty::Full);
    split_face(&mut model, FaceId(3));
    frame(&mut renderer, &model, &clean());
    assert_ne!(results(&renderer, 1), fresh(&model));
}

#[test]
fn a_fade_keeps_the_pass_running_until_it_ends() {
    let mut renderer = renderer();
    let mut model = soft_bar();
    let still = fresh(&model);
    model.fades = vec![[0.0; 4]; model.rows.len()];
    model.fades[7] = [0.05, 0.0, 0.0, 10.0];
    model.time_s = 10.0;
    frame(&mut renderer, &model, &TissueDirty::Full);
    let at_start = results(&renderer, 1);
    assert_ne!(at_start, still);
    let mut dispatches = Vec::new();
    for step in 1..=6 {
        model.time_s = 10.0 + 0.1 * f64::from(step) + 1e-3;
        dispatches.push(frame(&mut renderer, &model, &clean()).dispatches);
    }
    assert_eq!(dispatches, [2, 2, 2, 0, 0, 0]); // the third takes the fade off
    assert_eq!(results(&renderer, 1), still);
}

#[test]
fn only_fades_that_changed_are_uploaded() {
    let mut renderer = renderer();
    let mut model = soft_bar();
    model.fades = vec![[0.0; 4]; model.rows.len()];
    frame(&mut renderer, &model, &TissueDirty::Full);
    model.fades[20] = [0.01, 0.0, 0.0, 0.0];
    model.versions.fades += 1;
    let counters = frame(&mut renderer, &model, &clean());
    assert!(counters.bytes_uploaded < 16 + 512, "{counters:?}");
    assert_eq!(results(&renderer, 1), fresh(&model));
}

/// What the arenas hold of a model, in use and all told, against its counts.
fn memory_of(name: &str, model: &Model) -> f64 {
    let mut renderer = renderer();
    assert_eq!(renderer.memory().used, 0);
    let empty = renderer.memory().held;
    renderer.sync(1, &model.view(), &TissueDirty::Full).expect("sync");
    let terms = model.rows.bones.arena().len() + model.rows.rows.arena().len() + model.map.influences.arena().len();
    let (v, w, f) = (model.mesh.vertex_slots(), model.mesh.wedges().len(), model.mesh.face_slots());
    let joints = 3 * model.pose.joint_matrices.len();
    let vectors = joints + model.displacements.len() + 3 * model.rotations.len() + model.fades.len();
    let memory = renderer.memory();
    let documented = bytes_per_model(v, w, f, terms, vectors) as u64;
    assert_eq!(memory.used, documented, "{name}");
    assert_eq!(documented, (v * 56 + w * 48 + f * 32 + terms * 8 + vectors * 16) as u64);
    // Headroom is a quarter, to small ranges, which are multiples of 64 entries, eight times what there is; a buffer is at least half as
    // much again as it was.
    let ample = (8 * memory.used).min(8 << 20);
    assert!(
        memory.held >= memory.used && memory.held <= memory.used * 5 / 4 + ample + empty + 12 * 64 * 40,
        "{name}: {memory:?}"
    );
    println!("{name}: {:.0} bytes a vertex, {:.0} with headroom", documented as f64 / v as f64, memory.held as f64 / v as f64);
    renderer.remove(1);
    assert_eq!(renderer.memory().used, 0, "{name}");
    documented as f64 / v as f64
}

#[test]
fn memory_is_what_the_documentation_says() {
    let still = memory_of("static", &sphere(40, 1.0));
    let skinned = memory_of("skinned", &bar(20));
    let mut torn = bar(20).with_particles(&[(DVec3::ZERO, DVec3::Y * 0.01)], 2.0);
    let whole = memory_of("soft", &torn);
    for face in 0..200 {
        split_face(&mut torn, FaceId::new(7 * face));
    }
    torn.fades = vec![[0.0; 4]; torn.rows.len()];
    let torn = memory_of("torn", &torn);
    // Two faces a vertex and one wedge: 168; bones and influences come at 8 each, fades at 16.
    assert!((still - 168.0).abs() < 0.2 && skinned > still + 8.0 && whole > skinned + 7.9 && torn > whole + 16.0);
    assert_eq!(bytes_per_model(1000, 1000, 2000, 6000, 0), 216_000);
    assert_eq!(bytes_per_model(1000, 1000, 2000, 6000, 1000), 232_000);
}

/// A static scene runs no skinning code, an undisplaced one none that displaces, and one without long rows no loop over them; a pass
/// with other code would be told apart.
#[test]
fn a_pass_runs_only_the_code_that_its_tissues_need() {
    let none = Variant::default();
    let (skinned, displaced) = (Variant { skinned: true, ..none }, Variant { displaced: true, ..none });
    let ran = |model: &Model| {
        let mut renderer = renderer();
        let first = frame(&mut renderer, model, &TissueDirty::Full);
        let asleep = frame(&mut renderer, model, &clean());
        assert_eq!((first.dispatches, asleep.dispatches, asleep.code), (2, 0, none));
        first.code
    };
    let still = [(DVec3::X, DVec3::ZERO)];
    let poked = [(DVec3::X, DVec3::X * 0.1)];
    assert_eq!(ran(&sphere(4, 1.0)), none);
    assert_eq!(ran(&sphere(4, 1.0).with_particles(&still, 0.5)), none, "particles that rest");
    assert_eq!(ran(&sphere(4, 1.0).with_particles(&poked, 0.5)), displaced);
    assert_eq!(ran(&bar(4)), skinned);
    assert_eq!(ran(&soft_bar()), skinned.with(displaced));
    let mut fading = sphere(4, 1.0);
    fading.fades = vec![[0.0; 4]; fading.rows.len()];
    assert_eq!(ran(&fading), none, "fades of zero");
    fading.fades[3] = [0.1, 0.0, 0.0, 0.0];
    assert_eq!(frame(&mut renderer(), &fading, &TissueDirty::Full).code, displaced);
    let mut turned = sphere(4, 1.0).with_particles(&still, 0.5);
    turned.rotations = vec![Turn { spin: glam::DMat3::from_rotation_z(0.5) - glam::DMat3::IDENTITY, about: DVec3::X }];
    assert_eq!(ran(&turned), Variant { rotated: true, ..displaced });
    // Rows of three entries take the short way; one of four does not.
    let mut torn = sphere(4, 1.0);
    split_face(&mut torn, FaceId::new(0));
    assert_eq!(ran(&torn), none);
    let mut renderer = renderer();
    frame(&mut renderer, &torn, &TissueDirty::Full);
    take_dirty(&mut torn);
    let corners = [0, 1, 2, 3].map(|k| (torn.mesh.face(FaceId::new(5 * k))[0], 0.25));
    torn.rows.push_embedded(&corners);
    torn.mesh.add_vertex();
    torn.map.influences.push_row(&[]);
    let dirty = take_dirty(&mut torn);
    assert_eq!(frame(&mut renderer, &torn, &dirty).code, Variant { long_rows: true, ..none });
    assert_eq!(results(&renderer, 1), fresh(&torn));
    // One dispatch serves all tissues, with the code that any of them needs.
    renderer.sync(2, &soft_bar().view(), &TissueDirty::Full).expect("sync");
    torn.versions.pose += 1;
    let all = Variant { long_rows: true, ..skinned.with(displaced) };
    assert_eq!(frame(&mut renderer, &torn, &clean()).code, all);
}

#[test]
fn removed_tissues_leave_no_trace() {
    let mut renderer = renderer();
    let empty = renderer.render_to_image(&camera(), (64, 48), &DrawOptions::default()).expect("an empty scene");
    let model = soft_bar();
    frame(&mut renderer, &model, &TissueDirty::Full);
    let with = renderer.render_to_image(&camera(), (64, 48), &DrawOptions::default()).expect("a picture");
    renderer.remove(1);
    renderer.remove(99);
    let without = renderer.render_to_image(&camera(), (64, 48), &DrawOptions::default()).expect("a picture");
    assert!(empty == without && empty != with);
    assert!(matches!(renderer.read_positions(1), Err(GpuError::UnknownTissue(1))));
    frame(&mut renderer, &model, &clean());
    assert_eq!(results(&renderer, 1), fresh(&model), "a new tissue is uploaded whole, whatever the caller says");
}

#[test]
fn inconsistent_views_and_sizes_are_refused() {
    let mut renderer = renderer();
    let mut model = soft_bar();
    model.displacements.pop();
    assert!(matches!(renderer.sync(1, &model.view(), &TissueDirty::Full), Err(GpuError::BadView(_))));
    let mut model = soft_bar();
    model.fades = vec![[0.0; 4]; 3];
    assert!(matches!(renderer.sync(1, &model.view(), &TissueDirty::Full), Err(GpuError::BadView(_))));
    assert_eq!(renderer.keys().count(), 0);
    for size in [(0, 10), (10, 0), (1 << 20, 10)] {
        assert!(matches!(renderer.draw(&camera(), size, &DrawOptions::default()), Err(GpuError::BadSize { .. })));
    }
    assert!(renderer.draw(&camera(), (1, 1), &DrawOptions::default()).is_ok());
}

#[test]
fn empty_and_nan_models_do_not_harm() {
    let mut renderer = renderer();
    let empty = Model::new(Vec::new(), Vec::new(), Default::default());
    let mut odd = sphere(3, 1.0);
    odd.displacements.clear();
    odd.rows.rest_position.set(0, [f32::NAN; 3]);
    frame(&mut renderer, &empty, &TissueDirty::Full);
    assert_eq!(results(&renderer, 1), (Vec::new(), Vec::new()));
    frame(&mut renderer, &odd, &TissueDirty::Full);
    assert_eq!(results(&renderer, 1).0.len(), odd.rows.len());
}

/// A device whose buffers end at a mebibyte stands for a model too large for any.
#[test]
fn a_model_over_the_limits_is_refused_in_words_and_others_go_on() {
    let wide = context();
    let mut descriptor = device_descriptor(wide.adapter()).expect("limits");
    (descriptor.required_limits.max_storage_buffer_binding_size, descriptor.required_limits.max_buffer_size) = (1 << 20, 1 << 20);
    let (device, queue) = pollster::block_on(wide.adapter().request_device(&descriptor)).expect("a device");
    let narrow = Context::from_parts(wide.instance().clone(), wide.adapter().clone(), device, queue);
    let mut renderer = Renderer::new(Arc::new(narrow));
    let small = soft_bar();
    renderer.sync(1, &small.view(), &TissueDirty::Full).expect("fits");
    let large = sphere(64, 1.0);
    let error = renderer.sync(2, &large.view(), &TissueDirty::Full).expect_err("49152 faces do not fit");
    assert!(matches!(error, GpuError::TooLarge { limit_bytes: 1_048_576, .. }), "{error:?}");
    let text = error.to_string();
    assert!(text.contains("simplify the model") && text.contains("1048576"), "{text}");
    renderer.deform().expect("goes on");
    assert_eq!(results(&renderer, 1), fresh(&small));
    assert_eq!(renderer.keys().collect::<Vec<_>>(), [1]);
}

#[test]
fn many_tissues_are_one_dispatch_and_one_draw() {
    let mut renderer = renderer();
    let few = frame(&mut renderer, &sphere(4, 1.0), &TissueDirty::Full);
    for key in 2..40 {
        renderer.sync(key, &sphere(4, 1.0).view(), &TissueDirty::Full).expect("sync");
    }
    renderer.take_counters();
    renderer.draw(&camera(), (64, 48), &DrawOptions::default()).expect("draw");
    let many = renderer.take_counters();
    assert_eq!((many.dispatches, many.draws), (2, few.draws));
}
