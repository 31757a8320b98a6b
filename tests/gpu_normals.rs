//! Normals and lips of wounded models from the GPU, against f64: normals of the final positions (MATHS 2.3), and the CPU's twin of the
//! deform pass, which is what an adapter with few storage buffers runs.
#![cfg(feature = "gpu")]

mod common;
mod gpu_support;

use common::models::scene_of;
use glam::{DQuat, DVec3};
use gpu_support::{context, plain_context};
use incise::app::{App, FrameCounters, FrameTarget, FrameView};
use incise::diagnostics::Stages;
use incise::geometry::{FaceId, HalfEdge, Mesh, Plane, VertexId, WedgeId};
use incise::gpu::GpuError;
use incise::host::mirror::Mirror;
use incise::input::InputFrame;
use incise::scene::EditCommand;
use incise::surgery::{BladePose, WallMode};
use incise::tissue::Tissue;
use std::collections::BTreeSet;

/// The reach of DESIGN 4, radians.
const TOLERANCE: f64 = 1e-3;

/// The same scene, deformed on the GPU and on the CPU.
struct Twins {
    gpu: Mirror,
    cpu: Mirror,
}

impl FrameTarget for Twins {
    type Error = GpuError;

    fn present(&mut self, view: &FrameView, _: &mut Stages, _: &mut FrameCounters) -> Result<(), GpuError> {
        for mirror in [&mut self.gpu, &mut self.cpu] {
            mirror.sync(view)?;
            mirror.renderer_mut().deform()?;
        }
        Ok(())
    }
}

/// 24 frames of an animated model, with particles or without.
fn play(name: &str, faces: usize, soft: bool, wall: WallMode, commands: impl Fn(usize) -> Vec<EditCommand>) -> (App, Twins) {
    let mut twins = Twins { gpu: Mirror::new(context()), cpu: Mirror::new(plain_context()) };
    let (mut scene, _) = scene_of(name, faces, soft);
    scene.set_animation(Some(0));
    scene.set_wall(wall);
    let mut app = App::new(scene, 1.0, || 0);
    for number in 0..24 {
        let time_s = number as f64 / 60.0;
        let input = InputFrame { time_s, step_s: 1.0 / 60.0, commands: commands(number), ..InputFrame::default() };
        app.frame(&input, &mut twins).expect("a frame");
    }
    (app, twins)
}

fn tear(number: usize) -> Vec<EditCommand> {
    let mut commands = Vec::new();
    if number == 0 {
        commands.push(EditCommand::StrokeBegin { width: 0.012 });
        for k in 0..7 {
            let tip = DVec3::new(-0.12 + 0.04 * f64::from(k), 0.015, -0.02 + 0.006 * f64::from(k));
            commands.push(EditCommand::StrokePose(BladePose { t: 0.1 * f64::from(k), tip, base: tip + DVec3::Y * 0.3 }));
        }
        commands.push(EditCommand::StrokeEnd);
        commands.push(EditCommand::GrabBegin { id: 1, center: DVec3::new(0.0, 0.05, 0.05), radius: 0.08 });
        commands.push(EditCommand::GrabMove { id: 1, by: DVec3::new(0.0, 0.01, 0.02) });
    }
    commands
}

fn capped_cut(number: usize) -> Vec<EditCommand> {
    let plane = Plane::Equation { normal: DVec3::new(0.2, 0.95, 0.25), offset: 0.005 };
    if number == 4 { vec![EditCommand::CutClosed(plane)] } else { tear(number) }
}

fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

/// The first three of three or four numbers.
fn vector<const N: usize>(n: &[f32; N]) -> DVec3 {
    glam::Vec3::from_slice(n).as_dvec3()
}

/// How far the GPU is off, over all wedges in use of all tissues.
#[derive(Debug, Default)]
struct Found {
    wedges: usize,
    /// Wedges whose normal the rounding of positions to f32 alone may turn by more than [`TOLERANCE`]: all that a sliver knows of its
    /// own normal is lost when its corners are stored.
    slivers: usize,
    /// Radians from the f64 normal of the f64 positions, slivers apart.
    worst: f64,
    /// Radians from the f64 normal of the positions that the GPU itself came to; no wedge is left out but for any between sliver and not.
    worst_of_own: f64,
    /// Wedges whose faces edits have changed, and radians from what these faces alone say of their normals.
    edited: usize,
    of_facets: f64,
    /// Radians from the normals without displacements: the control.
    undisplaced: f64,
    /// Wedges nearer to a lip than what does not look like one, and the largest difference, diagonals.
    near_lips: usize,
    worst_lip: f64,
}

/// The half-edges that leave a wedge's vertex in the faces of its smoothing group.
fn around(mesh: &Mesh, w: WedgeId) -> impl Iterator<Item = HalfEdge> + '_ {
    let group = mesh.wedge(w).group;
    mesh.fan(mesh.wedge(w).vertex).filter(move |h| mesh.wedge(mesh.face_wedges(h.face())[h.corner()]).group == group)
}

/// Area-weighted normal of a wedge, not of length 1, and the length of all edges that went in.
fn gathered(mesh: &Mesh, w: WedgeId, positions: &[DVec3]) -> (DVec3, f64) {
    let corners = around(mesh, w).map(|h| mesh.face(h.face()).map(|v| positions[v.index()]));
    corners.fold((DVec3::ZERO, 0.0), |(sum, edges), [a, b, c]| {
        (sum + (b - a).cross(c - a), edges + a.distance(b) + b.distance(c) + c.distance(a))
    })
}

/// True for a wedge of the skin in whose faces there are vertices that edits put there.
fn is_edited(tissue: &Tissue, w: WedgeId) -> bool {
    let (mesh, rows) = (tissue.mesh(), tissue.rows());
    let inserted = |f: FaceId| mesh.face(f).into_iter().any(|v| !rows.is_base(v));
    around(mesh, w).map(HalfEdge::face).any(|f| !mesh.is_interior(f) && inserted(f))
}

/// How much wider than the shaders' SLIVER the faces of a wedge are at rest, slivers that normals are not told from.
fn width_at_rest(mesh: &Mesh, w: WedgeId, at_rest: &[DVec3]) -> f64 {
    let place = |v: VertexId| at_rest[v.index()];
    let legs =
        |h: HalfEdge| place(mesh.from(h)).distance(place(mesh.to(h))) * place(mesh.from(h)).distance(place(mesh.from(h.prev())));
    gathered(mesh, w, at_rest).0.length() / around(mesh, w).map(legs).sum::<f64>() / 1e-3
}

/// The normal of a wedge in displaced tissue, of length 1 (MATHS 2.3), at `positions`; where edits have put vertices around, it is turned
/// from what the wedge's own normal is by how the area-weighted one has turned since it was `at_rest`.
fn displaced_normal(tissue: &Tissue, w: WedgeId, positions: &[DVec3], at_rest: &[DVec3]) -> DVec3 {
    let (mesh, wedge) = (tissue.mesh(), tissue.mesh().wedge(w));
    let now = gathered(mesh, w, positions).0.normalize();
    if !is_edited(tissue, w) || width_at_rest(mesh, w, at_rest) < 1.0 {
        return now;
    }
    let linear = tissue.pose().blended_linear(tissue.rows(), wedge.vertex);
    let posed = |n: DVec3| (linear.inverse().transpose() * linear.determinant() * n).normalize();
    let before = posed(gathered(mesh, w, at_rest).0);
    // what is folded right over has no shortest turn to speak of
    if before.dot(now) > -0.9 { DQuat::from_rotation_arc(before, now) * posed(vector(&wedge.normal)) } else { now }
}

fn look(tissue: &Tissue, twins: &Twins, key: u64, found: &mut Found) {
    let normals = |mirror: &Mirror| mirror.renderer().read_normals(key).expect("normals");
    let (gpu, cpu) = (normals(&twins.gpu), normals(&twins.cpu));
    let own: Vec<DVec3> = twins.gpu.renderer().read_positions(key).expect("positions").iter().map(vector).collect();
    let mesh = tissue.mesh();
    let vertices = || (0..mesh.vertex_slots()).map(VertexId::new);
    let exact: Vec<DVec3> = vertices().map(|v| tissue.position(v)).collect();
    let skinned: Vec<DVec3> = vertices().map(|v| tissue.skinned(v)).collect();
    let at_rest = tissue.rest_positions();
    // as the GPU has them
    let own_rest: Vec<DVec3> = at_rest.iter().map(|p| p.as_vec3().as_dvec3()).collect();
    let used: BTreeSet<WedgeId> = mesh.live_faces().flat_map(|f| mesh.face_wedges(f)).collect();
    for w in used {
        let (normal, lip) = (vector(&gpu[w.index()]), gpu[w.index()][3]);
        let v = mesh.wedge(w).vertex;
        let moved = |v: VertexId| exact[v.index()] != skinned[v.index()];
        found.wedges += 1;
        if mesh.fan(v).any(|h| mesh.face(h.face()).into_iter().any(moved)) {
            let (sum, edges) = gathered(mesh, w, &exact);
            let (at_rest_sum, at_rest_edges) = gathered(mesh, w, at_rest);
            let is_sliver =
                |sum: DVec3, edges: f64| f64::from(f32::EPSILON) * tissue.diagonal() * edges > TOLERANCE * sum.length();
            if is_sliver(sum, edges) || (is_edited(tissue, w) && is_sliver(at_rest_sum, at_rest_edges)) {
                found.slivers += 1;
            } else {
                found.worst = found.worst.max(angle(normal, displaced_normal(tissue, w, &exact, at_rest)));
            }
            // at the width itself rounding says which it is
            if !is_edited(tissue, w) || (width_at_rest(mesh, w, &own_rest) - 1.0).abs() > 0.01 {
                found.worst_of_own = found.worst_of_own.max(angle(normal, displaced_normal(tissue, w, &own, &own_rest)));
            }
            if is_edited(tissue, w) {
                found.edited += 1;
                found.of_facets = found.of_facets.max(angle(normal, gathered(mesh, w, &own).0));
            }
            found.undisplaced = found.undisplaced.max(angle(normal, gathered(mesh, w, &skinned).0));
        } else {
            let a = tissue.pose().blended_linear(tissue.rows(), v);
            let rest = vector(&mesh.wedge(w).normal);
            found.worst = found.worst.max(angle(normal, a.inverse().transpose() * a.determinant() * rest));
            found.undisplaced = found.undisplaced.max(angle(normal, rest));
        }
        found.near_lips += usize::from(cpu[w.index()][3] < 0.03);
        found.worst_lip = found.worst_lip.max(f64::from((lip - cpu[w.index()][3]).abs()));
    }
}

#[test]
fn normals_and_lips_of_wounded_models_equal_the_f64_ones() {
    type Play = fn(usize) -> Vec<EditCommand>;
    for (what, name, faces, soft, wall, commands, pieces) in [
        ("torn open", "beam", 2400, true, WallMode::Open, tear as Play, 1),
        ("torn closed", "beam", 2400, true, WallMode::Closed, tear, 1),
        ("torn, cut, capped", "beam", 2400, true, WallMode::Closed, capped_cut, 2),
        ("torn, cut, capped", "heart", 6000, true, WallMode::Closed, capped_cut, 2),
        ("without particles", "beam", 2400, false, WallMode::Closed, capped_cut, 2),
    ] {
        let (app, twins) = play(name, faces, soft, wall, commands);
        let mut found = Found::default();
        for (id, tissue) in app.scene.tissues() {
            look(tissue, &twins, u64::from(id.0), &mut found);
        }
        println!("{name}, {what}: {found:?}");
        assert_eq!(app.scene.tissues().count(), pieces, "{name}, {what}");
        assert!(found.worst < TOLERANCE && found.worst_of_own < TOLERANCE, "{name}, {what}: {found:?}");
        assert!(found.slivers * 50 < found.wedges, "{name}, {what}: {found:?}");
        assert!(found.near_lips > 100 && found.worst_lip < 1e-6, "{name}, {what}: {found:?}");
        // Coarse faces that an edit has split are flat, and what was there was round.
        let is_round = name == "heart";
        assert!(!is_round || (found.edited > 100 && found.of_facets > 100.0 * TOLERANCE), "{name}, {what}: {found:?}");
        // The control: normals without displacements, or where there are none, without the pose.
        assert!(found.undisplaced > 100.0 * TOLERANCE, "{name}, {what}: {found:?}");
    }
}

/// The comparison of lips can fail.
#[test]
fn lips_of_another_wound_are_noticed() {
    let (app, torn) = play("beam", 2400, true, WallMode::Closed, tear);
    let id = u64::from(app.scene.tissues().next().expect("a tissue").0.0);
    let (_, whole) = play("beam", 2400, true, WallMode::Closed, |_| Vec::new());
    let lips = |mirror: &Mirror| mirror.renderer().read_normals(id).expect("normals").iter().map(|n| n[3]).collect::<Vec<_>>();
    let (torn, whole) = (lips(&torn.gpu), lips(&whole.cpu));
    assert!(torn.iter().zip(&whole).any(|(a, b)| (a - b).abs() > 0.01));
}

/// A stroke down the front of the heart.
fn down_the_front(number: usize) -> Vec<EditCommand> {
    if number > 0 {
        return Vec::new();
    }
    let pose = |k: u32| {
        let tip = DVec3::new(0.002, 0.03 - 0.004 * f64::from(k), 0.015);
        EditCommand::StrokePose(BladePose { t: 0.1 * f64::from(k), tip, base: tip + DVec3::Z * 0.3 })
    };
    let begin = EditCommand::StrokeBegin { width: 0.0006 };
    [begin].into_iter().chain((0..16).map(pose)).chain([EditCommand::StrokeEnd]).collect()
}

/// The pale edge beside a wound is as wide where vertices of the skin lie close to the cut, so that it goes on in faces with no corner on
/// the lip: what the corners of all its faces are told is their distance from the nearest stretch of the lip, over all of them, in f64.
#[test]
fn the_skin_beside_a_wound_knows_how_far_it_is() {
    // the shaders' LIP_WIDTH and FAR_FROM_LIP, diagonals
    const PALE: f64 = 0.0045;
    const FAR: f64 = 0.03;
    let (app, twins) = play("heart", 18_000, false, WallMode::Open, down_the_front);
    let (id, tissue) = app.scene.tissues().next().expect("a tissue");
    let told = twins.gpu.renderer().read_normals(u64::from(id.0)).expect("normals");
    let mesh = tissue.mesh();
    let place = |v: VertexId| tissue.position(v);
    let mut lip: Vec<[DVec3; 2]> = Vec::new();
    for f in mesh.live_faces() {
        let corners = mesh.face(f);
        let on = |k: usize| told[mesh.face_wedges(f)[k % 3].index()][3] == 0.0;
        for k in (0..3).filter(|&k| on(k) && on(k + 1)) {
            lip.push([place(corners[k]), place(corners[(k + 1) % 3])]);
        }
    }
    assert!(lip.len() > 100, "{} stretches", lip.len());
    let to_stretch = |p: DVec3, [a, b]: [DVec3; 2]| {
        let along = b - a;
        p.distance(a + along * ((p - a).dot(along) / along.length_squared()).clamp(0.0, 1.0))
    };
    let (mut beside, mut beyond, mut worst) = (0, 0, 0.0f64);
    for f in mesh.live_faces() {
        let corners = mesh.face(f);
        let away =
            corners.map(|v| lip.iter().map(|&s| to_stretch(place(v), s)).fold(f64::INFINITY, f64::min) / tissue.diagonal());
        if away.into_iter().fold(f64::INFINITY, f64::min) > PALE {
            continue;
        }
        for (k, w) in mesh.face_wedges(f).into_iter().enumerate() {
            let around = mesh.fan(corners[k]).flat_map(|h| mesh.face_wedges(h.face()));
            beside += 1;
            beyond += usize::from(around.into_iter().all(|w| told[w.index()][3] > 0.0));
            worst = worst.max((f64::from(told[w.index()][3]) - away[k].min(FAR)).abs());
        }
    }
    println!("{beside} corners beside the lip, {beyond} in no face with it, off by {worst} at most");
    assert!(beside > 100 && beyond > 0, "{beside}, {beyond}");
    assert!(worst < 0.1 * PALE, "off by {worst} diagonals");
}
