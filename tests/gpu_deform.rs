//! Final positions and normals from the GPU against the formula in f64 (MATHS 2).
#![cfg(feature = "gpu")]

mod gpu_support;

use glam::DVec3;
use gpu_support::{Model, bar, bend, context, sphere};
use incise::geometry::{Turn, VertexId, WedgeId};
use incise::gpu::{Renderer, TissueDirty};

/// The reach of DESIGN 4.
const TOLERANCE: f64 = 1e-6;

/// alpha(t) of MATHS 2.2.
fn alpha(model: &Model, start: f32) -> f64 {
    let x = ((model.time_s - f64::from(start)) / model.fade_duration_s).clamp(0.0, 1.0);
    1.0 - x * x * (3.0 - 2.0 * x)
}

/// f of MATHS 2, from the skinned position.
fn displaced(model: &Model, v: VertexId, skinned: DVec3) -> DVec3 {
    let influences = model.map.influences.row(v.index());
    let carried = |p: usize| model.displacements[p] + model.rotations.get(p).map_or(DVec3::ZERO, |t| t.carries(skinned));
    let moved: DVec3 = influences.iter().map(|i| carried(i.particle.index()) * f64::from(i.weight)).sum();
    let faded = match model.fades.get(v.index()) {
        Some(f) => {
            let c = DVec3::new(f64::from(f[0]), f64::from(f[1]), f64::from(f[2]));
            model.pose.blended_linear(&model.rows, v) * c * alpha(model, f[3])
        }
        None => DVec3::ZERO,
    };
    skinned + moved + faded
}

fn reference(model: &Model) -> Vec<DVec3> {
    model.vertices().map(|v| displaced(model, v, model.pose.skin(&model.rows, v))).collect()
}

/// Largest difference over the diagonal.
fn error(model: &Model, gpu: &[[f32; 3]], cpu: &[DVec3]) -> f64 {
    assert_eq!(gpu.len(), cpu.len());
    let worst = gpu.iter().zip(cpu).map(|(g, c)| (glam::Vec3::from_array(*g).as_dvec3() - c).length()).fold(0.0, f64::max);
    worst / model.diagonal()
}

/// A bent bar with embedded vertices of 2, 3 and 5 entries, displaced particles and a fade half-way.
fn busy_bar() -> Model {
    let mut model = bar(6);
    let mut embedded = Vec::new();
    let count = model.mesh.face_slots();
    for f in (0..count).step_by(7) {
        let [a, b, c] = model.mesh.faces()[f];
        let d = model.mesh.faces()[(f + count / 2) % count][0];
        let e = model.mesh.faces()[(f + 11) % count][1];
        let two = model.rows.push_embedded(&[(a, 0.3), (b, 0.7)]);
        let three = model.rows.push_embedded(&[(a, 0.2), (b, 0.5), (c, 0.3)]);
        let five = model.rows.push_embedded(&[(a, 0.4), (b, 0.35), (c, 0.45), (d, -0.1), (e, -0.1)]);
        embedded.extend([two, three, five]);
    }
    while model.mesh.vertex_slots() < model.rows.len() {
        model.mesh.add_vertex();
    }
    let lengths: Vec<usize> = embedded.iter().map(|v| model.rows.rows.row(v.index()).len()).collect();
    assert!([2, 3].iter().all(|n| lengths.contains(n)) && lengths.iter().any(|&n| n >= 4));
    let particle = |k: usize| {
        let t = k as f64;
        (DVec3::new(-0.45 + 0.1 * t, 0.1, 0.0), DVec3::new(0.01 * t.sin(), 0.03 * t.cos(), 0.02))
    };
    let mut model = model.with_particles(&(0..10).map(particle).collect::<Vec<_>>(), 0.22);
    model.pose = bend(1.2);
    model.time_s = 5000.1;
    model.fades = (0..model.rows.len())
        .map(|v| if v % 3 == 0 { [0.02, -0.01 * (v % 5) as f32, 0.005, 4999.95] } else { [0.0; 4] })
        .collect();
    model
}

/// The same with turned particles: the middle ones by up to a right angle.
fn twisted_bar() -> Model {
    let mut model = busy_bar();
    let turn = |k: usize| {
        let angle = if (3..8).contains(&k) { 0.4 * k as f64 - 1.6 } else { 0.0 };
        let spin = glam::DMat3::from_axis_angle(DVec3::new(1.0, 0.3, -0.2).normalize(), angle) - glam::DMat3::IDENTITY;
        Turn { spin, about: DVec3::new(-0.45 + 0.1 * k as f64, 0.1, 0.02) }
    };
    model.rotations = (0..model.displacements.len()).map(turn).collect();
    model
}

fn renderer() -> Renderer {
    Renderer::new(context())
}

fn deform(renderer: &mut Renderer, model: &Model) -> Vec<[f32; 3]> {
    renderer.sync(1, &model.view(), &TissueDirty::Full).expect("sync");
    renderer.deform().expect("deform");
    renderer.read_positions(1).expect("positions")
}

#[test]
fn positions_equal_the_f64_formula() {
    let model = busy_bar();
    let mut renderer = renderer();
    let gpu = deform(&mut renderer, &model);
    let found = error(&model, &gpu, &reference(&model));
    println!("gpu against cpu: {found:.3e} of the diagonal");
    assert!(found < TOLERANCE, "{found:e}");
}

#[test]
fn rotations_equal_the_f64_formula_and_go_away_again() {
    let mut model = twisted_bar();
    let mut renderer = renderer();
    let gpu = deform(&mut renderer, &model);
    let found = error(&model, &gpu, &reference(&model));
    println!("gpu against cpu with rotations: {found:.3e} of the diagonal");
    assert!(found < TOLERANCE, "{found:e}");
    // Broken twins: no rotations, and rotations about the origin.
    assert!(error(&model, &gpu, &reference(&busy_bar())) > 100.0 * TOLERANCE);
    let mut astray = twisted_bar();
    astray.rotations.iter_mut().for_each(|t| t.about = DVec3::ZERO);
    assert!(error(&model, &gpu, &reference(&astray)) > 100.0 * TOLERANCE);
    // Without them the tissue is what it was, to the bit.
    model.rotations.clear();
    model.versions.rotations += 1;
    renderer.sync(1, &model.view(), &TissueDirty::clean()).expect("sync");
    renderer.deform().expect("deform");
    assert_eq!(renderer.read_positions(1).expect("positions"), deform(&mut self::renderer(), &busy_bar()));
}

/// What is off costs nothing: not a byte, and three vectors a particle when it is on.
#[test]
fn rotations_are_uploaded_only_where_there_are_any() {
    let mut renderer = renderer();
    let mut bytes = |model: &Model| {
        renderer.sync(1, &model.view(), &TissueDirty::clean()).expect("sync");
        renderer.deform().expect("deform");
        renderer.take_counters().bytes_uploaded
    };
    let mut model = busy_bar();
    bytes(&model);
    assert_eq!(bytes(&model), 0);
    model.versions.displacements += 1;
    let plain = bytes(&model);
    model.rotations = twisted_bar().rotations;
    (model.versions.displacements, model.versions.rotations) = (2, 1);
    let first = bytes(&model);
    (model.versions.displacements, model.versions.rotations) = (3, 2);
    // the tissue's record changed with the first
    assert_eq!(bytes(&model), plain + 48 * model.rotations.len() as u64);
    assert!(first > plain + 48 * model.rotations.len() as u64);
}

/// Where shaders may not read enough buffers the CPU deforms, and what is drawn is the same: positions, normals, lips.
#[test]
fn an_adapter_with_few_storage_buffers_is_deformed_on_the_cpu() {
    let model = twisted_bar();
    let mut usual = renderer();
    let mut plain = Renderer::new(gpu_support::plain_context());
    let (gpu, cpu) = (deform(&mut usual, &model), deform(&mut plain, &model));
    assert!(usual.take_counters().dispatches == 2 && plain.take_counters().dispatches == 0);
    let exact = reference(&model);
    assert!(error(&model, &cpu, &exact) < TOLERANCE && error(&model, &gpu, &exact) < TOLERANCE);
    let (a, b) = (usual.read_normals(1).expect("normals"), plain.read_normals(1).expect("normals"));
    let angle = |(a, b): (&[f32; 4], &[f32; 4])| {
        let (a, b) = (vector(a), vector(b));
        a.cross(b).length().atan2(a.dot(b))
    };
    let worst = a.iter().zip(&b).map(angle).fold(0.0, f64::max);
    println!("normals of the CPU against the GPU's: {worst:.2e} rad");
    assert!(worst < 1e-3 && a.len() == b.len());
    // A later pose goes the same way, and one that the GPU did not see differs.
    let mut later = twisted_bar();
    later.pose = bend(0.4);
    (later.versions.pose, later.versions.fades) = (1, 1);
    later.fades.fill([0.0; 4]);
    plain.sync(1, &later.view(), &TissueDirty::clean()).expect("sync");
    plain.deform().expect("deform");
    let moved = plain.read_positions(1).expect("positions");
    assert!(error(&later, &moved, &reference(&later)) < TOLERANCE && error(&model, &moved, &exact) > 100.0 * TOLERANCE);
    let bytes = plain.take_counters().bytes_uploaded;
    plain.sync(1, &later.view(), &TissueDirty::clean()).expect("sync");
    plain.deform().expect("deform");
    assert!(bytes > 0 && plain.take_counters().bytes_uploaded == 0, "asleep, nothing is computed or sent");
}

#[test]
fn leaving_a_term_out_is_noticed() {
    let model = busy_bar();
    let mut renderer = renderer();
    let gpu = deform(&mut renderer, &model);
    let none: Vec<DVec3> = model.vertices().map(|v| model.pose.skin(&model.rows, v)).collect();
    let mut still = busy_bar();
    still.fades.clear();
    let mut unmoved = busy_bar();
    unmoved.displacements.fill(DVec3::ZERO);
    for (what, wrong) in [("all", none), ("fade", reference(&still)), ("particles", reference(&unmoved))] {
        assert!(error(&model, &gpu, &wrong) > 100.0 * TOLERANCE, "{what}");
    }
}

/// The usual way, rest position and bone weights interpolated, leaves the deformed face (MATHS 1.1).
#[test]
fn plain_weight_interpolation_is_noticed() {
    let model = busy_bar();
    let mut renderer = renderer();
    let gpu = deform(&mut renderer, &model);
    let plain = |v: VertexId| {
        let row = model.rows.rows.row(v.index());
        if row.is_empty() {
            return model.pose.skin(&model.rows, v);
        }
        let rest = model.rows.rest(v);
        let bone =
            |b: &incise::rig::BoneWeight| model.pose.joint_matrices[b.joint as usize].transform(rest) * f64::from(b.weight);
        row.iter().map(|e| e.weight * model.rows.bones.row(e.base.index()).iter().map(bone).sum::<DVec3>()).sum()
    };
    let wrong: Vec<DVec3> = model.vertices().map(|v| displaced(&model, v, plain(v))).collect();
    assert!(error(&model, &gpu, &wrong) > 100.0 * TOLERANCE);
}

/// A normal, without its distance from a lip.
fn vector(n: &[f32; 4]) -> DVec3 {
    glam::Vec4::from_array(*n).truncate().as_dvec3()
}

/// Normals in f64 by MATHS 2.3 from final positions.
fn reference_normal(model: &Model, f: &[DVec3], w: WedgeId) -> DVec3 {
    let wedge = model.mesh.wedge(w);
    let mut sum = DVec3::ZERO;
    for h in model.mesh.fan(wedge.vertex) {
        let face = h.face();
        if model.mesh.wedge(model.mesh.face_wedges(face)[h.corner()]).group == wedge.group {
            let [a, b, c] = model.mesh.face(face).map(|v| f[v.index()]);
            sum += (b - a).cross(c - a);
        }
    }
    sum.normalize()
}

#[test]
fn normals_of_displaced_vertices_follow_the_surface() {
    // A dent: positions move, and the blended matrix alone would keep the shading of the sphere.
    let dent = [(DVec3::Z, DVec3::new(0.0, 0.0, -0.4))];
    let model = sphere(10, 1.0).with_particles(&dent, 0.8);
    let mut renderer = renderer();
    deform(&mut renderer, &model);
    let normals = renderer.read_normals(1).expect("normals");
    let f = reference(&model);
    let (mut worst, mut flat, mut compared) = (0.0_f64, 0.0_f64, 0);
    for (w, n) in normals.iter().enumerate() {
        let wedge = model.mesh.wedge(WedgeId::new(w));
        let gpu = vector(n);
        if !model.map.influences.row(wedge.vertex.index()).is_empty() {
            let cpu = reference_normal(&model, &f, WedgeId::new(w));
            worst = worst.max(gpu.cross(cpu).length().atan2(gpu.dot(cpu)));
            flat = flat.max(cpu.angle_between(glam::Vec3::from_array(wedge.normal).as_dvec3()));
            compared += 1;
        }
    }
    println!("normals: {worst:.3e} rad over {compared} wedges; the rest normals are {flat:.2} rad off");
    assert!(compared > 20 && worst < 1e-3, "{worst:e}");
    assert!(flat > 0.1, "the negative control must differ");
}

#[test]
fn normals_elsewhere_are_the_cofactor_of_the_blend() {
    let mut model = bar(5);
    model.pose = bend(0.9);
    let mut renderer = renderer();
    deform(&mut renderer, &model);
    let normals = renderer.read_normals(1).expect("normals");
    let mut worst = 0.0_f64;
    for (w, n) in normals.iter().enumerate() {
        let wedge = model.mesh.wedge(WedgeId::new(w));
        let a = model.pose.blended_linear(&model.rows, wedge.vertex);
        let rest = glam::Vec3::from_array(wedge.normal).as_dvec3();
        let cpu = (a.inverse().transpose() * a.determinant() * rest).normalize();
        let gpu = vector(n);
        worst = worst.max(gpu.cross(cpu).length().atan2(gpu.dot(cpu)));
    }
    assert!(worst < 1e-3, "{worst:e}");
}

#[test]
fn the_same_input_gives_the_same_bits() {
    let model = busy_bar();
    let first = deform(&mut renderer(), &model);
    let mut second = renderer();
    let other = sphere(4, 1.0);
    second.sync(0, &other.view(), &TissueDirty::Full).expect("sync");
    assert_eq!(first, deform(&mut second, &model), "the place in the arenas must not matter");
}
