//! Laws of the capped plane cut on bare meshes (MATHS 6): closed in, closed out; volumes and areas add up; new vertices on the
//! plane; whatever the plane touches. A broken cap must fail.

mod common;

use common::Solid;
use glam::DVec3;
use incise::geometry::measure::{measure, measure_faces};
use incise::geometry::{Components, FaceId, HalfEdge, Plane, TopologyScratch, VertexId};
use incise::surgery::cap::{CapDress, CapOutcome, CapScratch, cap};
use incise::surgery::plane_cut::{PlaneCutOutcome, PlaneCutScratch, plane_cut};
use std::collections::BTreeMap;

/// A small generator: the same numbers everywhere.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ z >> 31) as f64 / u64::MAX as f64
    }

    fn below(&mut self, n: u32) -> u32 {
        ((self.next() * f64::from(n)) as u32).min(n - 1)
    }

    fn unit(&mut self) -> DVec3 {
        loop {
            let v = DVec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0;
            if v.length() > 0.1 && v.length() < 1.0 {
                return v.normalize();
            }
        }
    }
}

/// Cuts and caps a solid in place.
fn cut_closed(solid: &mut Solid, plane: &Plane) -> (PlaneCutOutcome, CapOutcome) {
    let mut scratch = PlaneCutScratch::default();
    let positions = std::mem::take(&mut solid.positions);
    let outcome = plane_cut(&mut solid.mesh, plane, |v| positions[v.index()], &mut scratch);
    solid.positions = positions;
    if outcome.missed() {
        return (outcome, CapOutcome::default());
    }
    for new in &outcome.new_vertices {
        assert_eq!(new.vertex.index(), solid.positions.len());
        solid.positions.push(new.position);
    }
    let dress = CapDress { normal: plane.normal(), material: 7 };
    let at = |v: VertexId| solid.positions[v.index()];
    let normal = |_: VertexId, n: DVec3| n.as_vec3().to_array();
    let capped = cap(&mut solid.mesh, scratch.rim(), scratch.taken(), dress, at, normal, &mut CapScratch::default());
    (outcome, capped)
}

/// No open half-edge, and every pair of vertices is joined by exactly two opposed half-edges or by none.
fn closed_manifold(solid: &Solid) -> Result<(), String> {
    let mut edges: BTreeMap<(VertexId, VertexId), (i32, i32)> = BTreeMap::new();
    for f in solid.mesh.live_faces() {
        let corners = solid.mesh.face(f);
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if solid.mesh.opposite(HalfEdge::of(f, k)).is_none() {
                return Err(format!("edge {a:?}-{b:?} of face {f:?} is open"));
            }
            let entry = edges.entry((a.min(b), a.max(b))).or_default();
            *(if a < b { &mut entry.0 } else { &mut entry.1 }) += 1;
        }
    }
    match edges.iter().find(|(_, n)| **n != (1, 1)) {
        Some((edge, n)) => Err(format!("edge {edge:?} has {n:?} half-edges")),
        None => solid.mesh.validate().map_err(|e| format!("{e:?}")),
    }
}

/// All laws of one cut. Returns whether it cut at all.
fn check(before: &Solid, plane: &Plane, manifold: bool) -> Result<bool, String> {
    let mut solid = before.clone();
    let (outcome, caps) = cut_closed(&mut solid, plane);
    if outcome.missed() {
        return if solid.mesh.faces() == before.mesh.faces() { Ok(false) } else { Err("a miss changed the mesh".into()) };
    }
    if manifold {
        closed_manifold(&solid)?;
    } else {
        solid.mesh.validate().map_err(|e| format!("{e:?}"))?;
        if !solid.open_half_edges().is_empty() {
            return Err("open half-edges".into());
        }
    }
    if caps.unclosed_edges != 0 || caps.triangulation.repeated_edges != 0 {
        return Err(format!("{caps:?}"));
    }
    laws(before, &solid, plane, &outcome)?;
    Ok(true)
}

fn laws(before: &Solid, after: &Solid, plane: &Plane, outcome: &PlaneCutOutcome) -> Result<(), String> {
    let at = |v: VertexId| after.at(v);
    let whole = measure(&before.mesh, |v| before.at(v));
    let diagonal = whole.diagonal();
    let components = Components::find(&after.mesh);
    let mut volume = 0.0;
    for c in 0..components.count() {
        let piece = measure_faces(&after.mesh, components.faces(c).iter().copied(), at);
        if !piece.closed() {
            return Err(format!("piece {c} is not closed: {piece:?}"));
        }
        volume += piece.volume;
        let side = |v: VertexId| plane.distance(at(v));
        let corners = || components.faces(c).iter().flat_map(|&f| after.mesh.face(f));
        let (low, high) = corners().map(side).fold((0f64, 0f64), |(l, h), d| (l.min(d), h.max(d)));
        if low < -1e-9 * diagonal && high > 1e-9 * diagonal {
            return Err(format!("piece {c} is on both sides: {low} {high}"));
        }
    }
    // the yardstick: absolute volume, since signed volumes of crumpled meshes cancel
    let scale = whole.volume.abs().max(1e-3 * whole.area * diagonal);
    if (volume - whole.volume).abs() > 1e-6 * scale.min(whole.area * diagonal) {
        return Err(format!("volumes {volume} of {}", whole.volume));
    }
    let skin: f64 = after.mesh.live_faces().filter(|&f| !after.mesh.is_interior(f)).map(|f| after.face_area(f)).sum();
    if (skin - whole.area).abs() > 1e-6 * whole.area {
        return Err(format!("areas {skin} of {}", whole.area));
    }
    let off = outcome.new_vertices.iter().map(|n| plane.distance(at(n.vertex)).abs()).fold(0.0, f64::max);
    if off > 1e-6 * diagonal { Err(format!("{off} off the plane")) } else { Ok(()) }
}

/// A torus with bumps: concave, its sections are one or two loops, nested or not.
fn torus(n: u32, m: u32, random: &mut Random) -> Solid {
    let mut positions = Vec::new();
    for i in 0..n {
        for j in 0..m {
            let (a, b) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(m));
            let (a, b) = (a * std::f64::consts::TAU, b * std::f64::consts::TAU);
            let r = 0.4 * (1.0 + 0.3 * random.next());
            positions.push(DVec3::new((1.0 + r * b.cos()) * a.cos(), (1.0 + r * b.cos()) * a.sin(), r * b.sin()));
        }
    }
    let at = |i: u32, j: u32| i % n * m + j % m;
    let quad = |(i, j)| {
        let q = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]
    };
    Solid::new(positions, (0..n).flat_map(|i| (0..m).map(move |j| (i, j))).flat_map(quad).collect())
}

/// A bumpy ball with `cavities` bumpy hollows, turned inside out.
fn hollow(levels: usize, cavities: usize, random: &mut Random) -> Solid {
    let ball = Solid::sphere(1.0, levels);
    let faces: Vec<[u32; 3]> = ball.mesh.faces().iter().map(|f| f.map(|v| v.0)).collect();
    let mut all = (Vec::new(), Vec::new());
    let mut put = |centre: DVec3, radius: f64, turned: bool, random: &mut Random| {
        let first = all.0.len() as u32;
        all.0.extend(ball.positions.iter().map(|&p| centre + p * radius * (0.85 + 0.15 * random.next())));
        all.1.extend(faces.iter().map(|f| f.map(|v| v + first)).map(|[a, b, c]| if turned { [a, c, b] } else { [a, b, c] }));
    };
    put(DVec3::ZERO, 1.0, false, random);
    for i in 0..cavities {
        let angle = std::f64::consts::TAU * i as f64 / cavities.max(1) as f64;
        put(DVec3::new(0.45 * angle.cos(), 0.45 * angle.sin(), 0.1), 0.22, true, random);
    }
    Solid::new(all.0, all.1)
}

#[test]
fn two_thousand_random_planes_leave_closed_pieces_that_add_up() {
    let mut random = Random(1);
    let mut cuts = 0;
    let mut nested = 0;
    for round in 0..20 {
        let models = [
            Solid::sphere(1.0, 3),
            torus(17 + round % 5, 11, &mut random),
            hollow(2, 1, &mut random),
            hollow(2, 4, &mut random),
            Solid::cube(3),
        ];
        for model in &models {
            let centre = model.positions.iter().sum::<DVec3>() / model.positions.len() as f64;
            let reach = model.positions.iter().map(|p| p.distance(centre)).fold(0.0, f64::max);
            for _ in 0..20 {
                let (normal, at) = (random.unit(), centre + random.unit() * reach * random.next());
                let plane = Plane::Equation { normal, offset: normal.dot(at) };
                match check(model, &plane, true) {
                    Ok(cut) => cuts += usize::from(cut),
                    Err(why) => panic!("{plane:?}: {why}"),
                }
                let mut solid = model.clone();
                nested += usize::from(cut_closed(&mut solid, &plane).1.loops > 2);
            }
        }
    }
    assert!(cuts > 1500 && nested > 200, "{cuts} cuts, {nested} with several loops");
}

#[test]
fn ten_thousand_coarse_grid_cases_stay_closed() {
    let mut random = Random(2);
    let shapes = [Solid::sphere(1.0, 0), Solid::sphere(1.0, 1), Solid::cube(1), Solid::cube(2), torus(4, 3, &mut random)];
    let (mut cuts, mut on_plane) = (0, 0);
    for case in 0..10_000u32 {
        let mut solid = shapes[(case % 5) as usize].clone();
        let grid = 2 + random.below(4);
        if case % 3 != 0 || case % 5 == 0 {
            for p in &mut solid.positions {
                *p = DVec3::from_array(std::array::from_fn(|_| f64::from(random.below(grid))));
            }
        }
        let plane = loop {
            let [x, y, z, d] = std::array::from_fn(|_| f64::from(random.below(5)) - 2.0);
            let normal = DVec3::new(x, y, z);
            if normal != DVec3::ZERO {
                break Plane::Equation { normal, offset: if case % 2 == 0 { d + 2.0 } else { normal.dot(DVec3::ONE) } };
            }
        };
        on_plane += usize::from(solid.positions.iter().any(|&p| plane.value(p) == 0.0));
        match check(&solid, &plane, true) {
            Ok(cut) => cuts += usize::from(cut),
            Err(why) => panic!("case {case}: {plane:?}: {why}"),
        }
    }
    assert!(cuts > 4000 && on_plane > 5000, "{cuts} cuts, {on_plane} with vertices on the plane");
}

#[test]
fn ties_cut_through_vertices_edges_and_faces() {
    for n in 1..4 {
        let cube = Solid::cube(n);
        for k in 0..=2 * n {
            for normal in [DVec3::X, DVec3::Y, -DVec3::Z, DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::ONE] {
                let plane = Plane::Equation { normal, offset: f64::from(k) / 2.0 };
                check(&cube, &plane, true).unwrap_or_else(|why| panic!("{plane:?}: {why}"));
            }
        }
    }
}

#[test]
fn cuts_through_caps_stay_closed_and_add_up() {
    let mut random = Random(3);
    let mut solid = hollow(2, 3, &mut random);
    let whole = measure(&solid.mesh, |v| solid.at(v));
    for step in 0..25 {
        let normal = random.unit();
        let plane = Plane::Equation { normal, offset: normal.dot(random.unit() * 0.6 * random.next()) };
        cut_closed(&mut solid, &plane);
        closed_manifold(&solid).unwrap_or_else(|why| panic!("step {step}: {why}"));
        let volume = measure(&solid.mesh, |v| solid.at(v)).volume;
        assert!((volume - whole.volume).abs() < 1e-9 * whole.volume, "step {step}: {volume} of {}", whole.volume);
    }
}

#[test]
fn an_open_model_gets_caps_for_its_closed_loops_only() {
    // a ball with a hole in its skin at the top, and a whole ball inside
    let mut random = Random(4);
    let mut solid = hollow(2, 1, &mut random);
    let top = |s: &Solid, f: FaceId| s.mesh.face(f).iter().all(|&v| s.at(v).z > 0.4);
    let gone: Vec<FaceId> = solid.mesh.live_faces().filter(|&f| top(&solid, f)).collect();
    solid.mesh.remove_faces(&gone, &mut TopologyScratch::default());
    let plane = Plane::Equation { normal: DVec3::X, offset: 0.45 };
    let open = solid.open_half_edges().len();
    let (outcome, caps) = cut_closed(&mut solid, &plane);
    assert!(!outcome.missed() && caps.loops == 2 && caps.unclosed_edges > 0, "{caps:?}");
    solid.mesh.validate().unwrap();
    assert!(solid.open_half_edges().len() > open, "the chain along the hole stays open");
    // below the hole everything is closed
    let mut below = hollow(2, 1, &mut random);
    let gone: Vec<FaceId> = below.mesh.live_faces().filter(|&f| top(&below, f)).collect();
    below.mesh.remove_faces(&gone, &mut TopologyScratch::default());
    let (_, caps) = cut_closed(&mut below, &Plane::Equation { normal: DVec3::Z, offset: 0.05 });
    assert_eq!((caps.loops, caps.unclosed_edges), (4, 0));
}

#[test]
fn a_broken_cap_fails() {
    let mut random = Random(5);
    let before = hollow(2, 2, &mut random);
    let plane = Plane::Equation { normal: DVec3::new(0.1, 0.2, 1.0), offset: 0.05 };
    let mut good = before.clone();
    let (outcome, caps) = cut_closed(&mut good, &plane);
    assert_eq!(laws(&before, &good, &plane, &outcome).and(closed_manifold(&good)), Ok(()));
    // a triangle of the cap is missing
    let mut holed = good.clone();
    holed.mesh.remove_faces(&caps.added_faces[3..4], &mut TopologyScratch::default());
    assert!(closed_manifold(&holed).unwrap_err().contains("open"));
    assert!(laws(&before, &holed, &plane, &outcome).unwrap_err().contains("not closed"));
    // a corner of it stands off the plane
    let mut bent = good.clone();
    let corner = outcome.new_vertices[0].vertex;
    bent.positions[corner.index()] += DVec3::Z * 1e-3;
    assert!(laws(&before, &bent, &plane, &outcome).is_err());
    // the cut without a cap
    let mut open = before.clone();
    plane_cut(&mut open.mesh, &plane, |v| before.at(v), &mut PlaneCutScratch::default());
    assert!(!open.open_half_edges().is_empty());
}
