//! Capped cuts of whole tissues: many in a row, in mid-animation, taken back and done again (MATHS 1.4, 2.2, 6, 7).

mod common;

use common::models::{model, model_of_obj, scene, settings};
use glam::DVec3;
use incise::diagnostics::Stages;
use incise::geometry::{FaceId, Plane, VertexId};
use incise::scene::{EditCommand, Outcome, Scene, SceneSettings, TissueId};
use incise::surgery::{BladePose, SamplingSettings};
use incise::tissue::Tissue;
use incise::tissue::edit::CutScratch;

/// Low-discrepancy numbers in 0..1: the same everywhere.
fn spread(i: usize, k: usize) -> f64 {
    let roots = [0.754_877_666_246_693, 0.569_840_290_998_053, 0.430_159_709_001_947, 0.876_715_609_4];
    (0.5 + (i + 1) as f64 * roots[k]).fract()
}

fn direction(i: usize) -> DVec3 {
    let (z, a) = (2.0 * spread(i, 0) - 1.0, std::f64::consts::TAU * spread(i, 1));
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * a.cos(), r * a.sin(), z)
}

/// Cuts a tissue into closed pieces; the first stays where it is.
fn cut(tissue: &mut Tissue, plane: &Plane, scratch: &mut CutScratch) -> Vec<Tissue> {
    let (outcome, caps) = tissue.cut_closed(plane, scratch, &mut Stages::default());
    if outcome.missed() {
        return Vec::new();
    }
    assert_eq!((caps.unclosed_edges, caps.triangulation.repeated_edges), (0, 0));
    let parts = tissue.component_faces();
    tissue.sever(&parts[1..]).into_iter().map(|piece| *piece).collect()
}

fn volume(tissue: &Tissue) -> f64 {
    tissue.measure_all().volume
}

#[test]
fn two_hundred_cuts_in_a_row_keep_every_law() {
    let loaded = model("beam", 500);
    let mut first = Tissue::new(loaded.clone(), &settings(&loaded)).unwrap();
    first.set_pose(0.0, Some(0), 0.4);
    let whole = volume(&first);
    let diagonal = first.diagonal();
    let mut pieces = vec![first];
    let mut scratch = CutScratch::default();
    let mut hits = 0;
    for step in 0..200 {
        // the largest piece of some that are picked by chance: pieces of pieces, many times over
        let picked = (0..3).map(|k| (spread(step, k) * pieces.len() as f64) as usize);
        let Some(at) = picked.max_by(|&a, &b| volume(&pieces[a]).total_cmp(&volume(&pieces[b]))) else { continue };
        let (low, high) = pieces[at].bounds();
        let normal = direction(step);
        let through = (low + high) / 2.0 + (high - low) * 0.3 * (DVec3::new(spread(step, 2), spread(step, 3), 0.5) - 0.5);
        let plane = Plane::Equation { normal, offset: normal.dot(through) };
        let before = volume(&pieces[at]);
        let new = cut(&mut pieces[at], &plane, &mut scratch);
        hits += usize::from(!new.is_empty());
        let after = volume(&pieces[at]) + new.iter().map(volume).sum::<f64>();
        assert!((after - before).abs() <= 1e-6 * whole, "step {step}: {before} became {after} of {whole}");
        for piece in std::iter::once(&pieces[at]).chain(&new) {
            piece.validate().unwrap_or_else(|why| panic!("step {step}: {why}"));
            let m = piece.measure_all();
            assert!(m.closed(), "step {step}: {m:?}");
            assert!(piece.longest_row() <= 12, "step {step}: a row of {}", piece.longest_row());
            let sides = piece.mesh().live_vertices().map(|v| plane.distance(piece.position(v)));
            let (low, high) = sides.fold((0f64, 0f64), |(l, h), d| (l.min(d), h.max(d)));
            assert!(low > -1e-6 * diagonal || high < 1e-6 * diagonal, "step {step}: both sides, {low} {high}");
        }
        pieces.extend(new);
    }
    let sum: f64 = pieces.iter().map(volume).sum();
    assert!((sum - whole).abs() <= 1e-5 * whole, "{sum} of {whole}");
    assert!(hits > 180 && pieces.len() > 180, "{hits} cuts, {} pieces", pieces.len());
}

/// Largest distance of a corner of `f` from the plane and the outside of the triangle that it is a part of.
fn off_face(tissue: &Tissue, f: FaceId, [a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a).normalize();
    let off = |p: DVec3| {
        let outside = [(a, b), (b, c), (c, a)].map(|(u, v)| -normal.cross((v - u).normalize()).dot(p - u));
        outside.into_iter().fold(normal.dot(p - a).abs(), f64::max)
    };
    tissue.mesh().face(f).into_iter().map(|v| off(tissue.position(v))).fold(0.0, f64::max)
}

#[test]
fn pieces_cut_in_mid_animation_animate_on_closed() {
    let loaded = model("beam", 600);
    let mut uncut = Tissue::new(loaded.clone(), &settings(&loaded)).unwrap();
    let (mut scene, _) = scene("beam", 600);
    scene.set_animation(Some(0));
    let mut rows = Vec::new();
    for (i, time) in [0.3, 0.7, 1.1].into_iter().enumerate() {
        scene.pose(time, time);
        let normal = direction(3 * i + 1);
        let (low, high) = scene.tissue(TissueId(0)).unwrap().bounds();
        let offset = scene.tissue(TissueId(0)).unwrap().offset();
        let plane = Plane::Equation { normal, offset: normal.dot((low + high) / 2.0 + offset) };
        let report = scene.edit(EditCommand::CutClosed(plane)).pop().unwrap();
        assert_eq!(report.outcome, Outcome::Cut);
        assert!(report.pieces.iter().all(|p| p.closed) && report.pieces.len() >= 2);
        let sum: f64 = report.pieces.iter().map(|p| p.volume).sum();
        assert!((sum - report.volume_before).abs() <= 1e-6 * report.volume_before, "{sum} of {}", report.volume_before);
        assert!(report.caps.loops >= 2 && report.caps.unclosed_edges == 0);
        rows.push(report.max_row_entries);
    }
    assert!(rows.iter().all(|&r| r <= 12), "{rows:?}");
    let promoted: usize = scene.tissues().map(|(_, t)| t.promoted_vertices()).sum();
    for time in [0.0, 0.2, 0.5, 0.9, 1.4, 1.9] {
        // long after every fade has ended
        scene.pose(100.0 + time, time);
        uncut.set_pose(100.0 + time, Some(0), time);
        let mut area_of = std::collections::BTreeMap::new();
        for (_, tissue) in scene.tissues() {
            tissue.validate().unwrap();
            assert!(tissue.measure_all().closed(), "closed in every pose");
            for f in tissue.mesh().live_faces() {
                let origin = tissue.mesh().face_info(f).origin;
                if origin == u32::MAX {
                    continue;
                }
                let face = uncut.mesh().face(FaceId(origin)).map(|v| uncut.position(v));
                let off = off_face(tissue, f, face);
                assert!(off <= 1e-6 * uncut.diagonal(), "face {f:?} is {off} off its original at {time}, {promoted} promoted");
                *area_of.entry(origin).or_insert(0.0) += tissue.measure(std::iter::once(f)).area;
            }
        }
        let whole = uncut.measure_all().area;
        assert_eq!(area_of.len(), uncut.mesh().face_count(), "no face is lost");
        assert!((area_of.values().sum::<f64>() - whole).abs() <= 1e-6 * whole);
    }
    // the twin: the surface of another moment is not this one
    uncut.set_pose(200.0, Some(0), 0.1);
    let far = scene.tissues().flat_map(|(_, t)| t.mesh().live_faces().map(move |f| (t, f))).any(|(t, f)| {
        let origin = t.mesh().face_info(f).origin;
        origin != u32::MAX
            && off_face(t, f, uncut.mesh().face(FaceId(origin)).map(|v| uncut.position(v))) > 1e-4 * uncut.diagonal()
    });
    assert!(far);
}

#[test]
fn capped_cuts_of_displaced_tissue_are_taken_back_and_done_again() {
    let (mut scene, _) = scene("heart", 900);
    let (low, high) = scene.tissue(TissueId(0)).unwrap().bounds();
    let (centre, half) = ((low + high) / 2.0, (high - low) / 2.0);
    let at = scene.tissue(TissueId(0)).unwrap().offset();
    scene.edit(EditCommand::GrabBegin { id: 1, center: at + centre + half * DVec3::X, radius: half.length() * 0.5 });
    scene.edit(EditCommand::GrabMove { id: 1, by: half * 0.2 });
    for _ in 0..3 {
        scene.step(1.0 / 90.0);
    }
    let mut hashes = vec![scene.edit_hash()];
    for i in 0..4 {
        let normal = direction(i + 20);
        let plane = Plane::Equation { normal, offset: normal.dot(at + centre + half * 0.1 * i as f64) };
        let report = scene.edit(EditCommand::CutClosed(plane)).pop().unwrap();
        let sum: f64 = report.pieces.iter().map(|p| p.volume).sum();
        assert!(report.pieces.iter().all(|p| p.closed), "cut {i}");
        assert!((sum - report.volume_before).abs() <= 1e-6 * report.volume_before, "cut {i}: {sum} of {}", report.volume_before);
        assert!(report.max_plane_distance.unwrap() <= 1e-6 * 2.0 * half.length(), "cut {i}");
        scene.validate().unwrap();
        scene.step(1.0 / 90.0);
        hashes.push(scene.edit_hash());
    }
    for i in (0..4).rev() {
        scene.edit(EditCommand::Undo);
        assert_eq!(scene.edit_hash(), hashes[i]);
        scene.validate().unwrap();
    }
    for hash in &hashes[1..] {
        scene.edit(EditCommand::Redo);
        assert_eq!(scene.edit_hash(), *hash);
        scene.validate().unwrap();
    }
}

#[test]
fn a_cavity_that_the_plane_misses_stays_with_the_piece_around_it() {
    let (mut scene, _) = scene("heart", 900);
    let tissue = scene.tissue(TissueId(0)).unwrap();
    let shells: Vec<f64> = tissue.component_faces().into_iter().map(|f| tissue.measure(f.into_iter()).volume).collect();
    assert!(shells.len() == 2 && shells.iter().any(|&v| v < 0.0), "{shells:?}");
    let offset = tissue.bounds().0.y + tissue.offset().y + 0.02 * tissue.diagonal();
    let report = scene.edit(EditCommand::CutClosed(Plane::Equation { normal: DVec3::Y, offset })).pop().unwrap();
    assert_eq!((report.outcome, report.pieces.len(), report.caps.loops), (Outcome::Cut, 2, 2));
    assert!(report.pieces.iter().all(|p| p.closed && p.volume > 0.0));
}

/// A scene of balls: centre, radius, and whether it is turned inside out.
fn balls(balls: &[([f64; 3], f64, bool)]) -> Scene {
    let mut text = String::new();
    let mut first = 1;
    for &(centre, radius, turned) in balls {
        let ball = common::Solid::sphere(radius, 3);
        for p in ball.positions.iter().map(|&p| p + DVec3::from_array(centre)) {
            text += &format!("v {} {} {}\n", p.x, p.y, p.z);
        }
        for f in ball.mesh.faces() {
            let [a, b, c] = f.map(|v| v.0 + first);
            text += &if turned { format!("f {a} {c} {b}\n") } else { format!("f {a} {b} {c}\n") };
        }
        first += ball.positions.len() as u32;
    }
    let loaded = model_of_obj(&text);
    let tissue = Tissue::new(loaded.clone(), &settings(&loaded)).unwrap();
    let tools = SceneSettings { sampling: SamplingSettings::default(), sample_distance: None, sample_time: None };
    Scene::new(tissue, tools)
}

/// Volumes of the pieces after a cut at a height, in ball volumes of radius 1, largest first.
fn volumes_cut_at(scene: &mut Scene, y: f64, closed: bool) -> Vec<f64> {
    let plane = Plane::Equation { normal: DVec3::Y, offset: y };
    let command = if closed { EditCommand::CutClosed(plane) } else { EditCommand::Cut(plane) };
    let report = scene.edit(command).pop().unwrap();
    assert_eq!(report.outcome, Outcome::Cut);
    scene.validate().unwrap();
    let ball = common::Solid::sphere(1.0, 3);
    let whole = incise::geometry::measure::measure(&ball.mesh, |v| ball.at(v)).volume;
    let mut volumes: Vec<f64> = report.pieces.iter().map(|p| p.volume / whole).collect();
    volumes.sort_by(|a, b| b.total_cmp(a));
    volumes
}

#[test]
fn a_cavity_stays_with_the_piece_that_encloses_it_not_with_the_largest() {
    let bodies = [([0.0; 3], 1.0, false), ([3.0, 0.0, 0.0], 0.6, false), ([3.0, 0.3, 0.05], 0.2, true)];
    let near = |found: &[f64], wanted: &[f64]| {
        assert_eq!(found.len(), wanted.len(), "{found:?} {wanted:?}");
        assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} {wanted:?}");
    };
    let (half, small, hole) = (0.5, 0.6f64.powi(3) / 2.0, 0.2f64.powi(3));
    near(&volumes_cut_at(&mut balls(&bodies), 0.0, true), &[half, half, small, small - hole]);
    // without caps the volumes mean little, but the pieces are the same
    let mut open = balls(&bodies);
    assert_eq!(volumes_cut_at(&mut open, 0.0, false).len(), 4);
    let hollow: Vec<f64> =
        open.tissues().filter(|(_, t)| t.component_faces().len() == 2).map(|(_, t)| t.bounds().0.x + t.offset().x).collect();
    assert!(hollow.len() == 1 && hollow[0] > 2.0, "{hollow:?}");
}

#[test]
fn a_cavity_of_a_body_inside_a_cavity_stays_with_that_body() {
    let nested =
        [([0.0; 3], 2.0, false), ([0.0, 0.3, 0.0], 1.0, true), ([0.0, 0.3, 0.1], 0.7, false), ([0.1, 0.3, 0.0], 0.3, true)];
    let mut scene = balls(&nested);
    let found = volumes_cut_at(&mut scene, -1.5, true);
    let inner = 0.7f64.powi(3) - 0.3f64.powi(3);
    assert_eq!(found.len(), 3, "{found:?}");
    assert!(found.iter().all(|&v| v > 0.0) && found.iter().any(|v| (v - inner).abs() < 1e-6), "{found:?}");
    assert!((found.iter().sum::<f64>() - (8.0 - 1.0 + inner)).abs() < 1e-6, "{found:?}");
}

#[test]
fn vertices_on_the_cut_are_held_from_their_own_side() {
    let loaded = model("heart", 900);
    let mut tissue = Tissue::new(loaded.clone(), &settings(&loaded)).unwrap();
    let (low, high) = tissue.bounds();
    let normal = direction(7);
    let plane = Plane::Equation { normal, offset: normal.dot((low + high) / 2.0) };
    let first_new = tissue.mesh().vertex_slots();
    let outcome = tissue.cut(&plane, &mut CutScratch::default().split, &mut Stages::default());
    assert!(!outcome.missed());
    let map = &tissue.layer().unwrap().map;
    let farthest = |faces: &mut dyn Iterator<Item = FaceId>| {
        let corners = faces.flat_map(|f| tissue.mesh().face(f)).map(|v| plane.distance(tissue.position(v)));
        corners.fold(0.0f64, |m, d| if d.abs() > m.abs() { d } else { m })
    };
    let (mut own, mut lost) = (0, 0);
    for v in (first_new..tissue.mesh().vertex_slots()).map(VertexId::new) {
        let row = map.influences.row(v.index());
        assert!((row.iter().map(|e| f64::from(e.weight)).sum::<f64>() - 1.0).abs() < 1e-5);
        let side = farthest(&mut tissue.mesh().fan(v).map(|h| h.face()));
        let across =
            |e: &&incise::particles::Influence| plane.distance(tissue.position(map.anchors[e.particle.index()])) * side < 0.0;
        let count = row.iter().filter(across).count();
        assert!(count == 0 || count == row.len(), "{v:?} is held from both sides");
        own += usize::from(count == 0);
        lost += usize::from(count > 0);
    }
    // a few far from every particle of their side keep what their edge had, until the pieces part
    assert!(own > 50 && lost * 20 <= own, "{own} {lost}");
    // the twin: the row of an old vertex near the plane is held from both sides
    let mixed = (0..first_new).filter(|&v| {
        let sides = |e: &incise::particles::Influence| plane.distance(tissue.position(map.anchors[e.particle.index()])) > 0.0;
        let row = map.influences.row(v);
        row.iter().any(sides) && !row.iter().all(sides)
    });
    assert!(mixed.count() > 50);
}

/// A blade that sweeps across the beam means the plane of its sweep, wherever between two poses it first touches; a stab means
/// none, and one that touches nothing neither.
#[test]
fn a_blade_in_the_hand_means_a_plane() {
    let pose = |x: f64, y: f64, z: f64| BladePose { t: 0.0, tip: DVec3::new(x, y - 0.3, z), base: DVec3::new(x, y + 0.3, z) };
    let lean = DVec3::new(1.0, 0.0, -0.4).normalize();
    // coarse poses and fine ones mean the same plane
    for steps in [1, 7, 90] {
        let (mut scene, _) = scene("beam", 2400);
        let volume: f64 = scene.tissues().map(|t| volume(t.1)).sum();
        let at = |k: usize| 0.4 * (2.0 * k as f64 / steps as f64 - 1.0);
        let poses: Vec<BladePose> = (0..=steps).map(|k| pose(0.03 + 0.4 * at(k), 0.0, at(k))).collect();
        let report = scene.edit(EditCommand::CutByBlade { poses, closed: true }).pop().unwrap();
        assert_eq!((report.outcome, report.pieces.len(), report.kind), (Outcome::Cut, 2, "cut"));
        let after: f64 = report.pieces.iter().map(|p| p.volume).sum();
        assert!((after - volume).abs() < 1e-6 * volume);
        for (_, tissue) in scene.tissues() {
            let side = |v: VertexId| (tissue.to_model(tissue.position(v)) - DVec3::X * 0.03).dot(lean);
            let (least, most) =
                tissue.mesh().live_vertices().map(side).fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(x), b.max(x)));
            assert!(least > -1e-6 || most < 1e-6, "the plane of the sweep parts the pieces: {least:e} {most:e}");
        }
    }
    // where the bend has taken the beam, and not where it lay
    let (mut bent, _) = scene("beam", 2400);
    bent.set_animation(Some(0));
    bent.pose(0.5, 0.5);
    let (_, tissue) = bent.tissues().next().unwrap();
    let far = tissue.mesh().live_vertices().map(|v| tissue.to_model(tissue.position(v)));
    let far = far.max_by(|a, b| a.y.abs().total_cmp(&b.y.abs())).unwrap();
    assert!(far.y.abs() > 0.1, "{far}");
    let blade = |z: f64| BladePose { t: 0.0, tip: DVec3::new(far.x, far.y - 0.02, z), base: DVec3::new(far.x, far.y + 0.02, z) };
    let poses = vec![blade(-0.4), blade(0.4)];
    let report = bent.edit(EditCommand::CutByBlade { poses, closed: true }).pop().unwrap();
    assert_eq!((report.outcome, report.pieces.len()), (Outcome::Cut, 2));
    let (mut scene, _) = scene("beam", 2400);
    let stab: Vec<BladePose> = (0..40).map(|k| pose(0.0, 0.5 - 0.02 * f64::from(k), 0.0)).collect();
    let beside = vec![pose(2.0, 0.0, -0.4), pose(2.0, 0.0, 0.4)];
    let nowhere = vec![pose(f64::NAN, 0.0, 0.0); 3];
    for poses in [stab, beside, nowhere, Vec::new()] {
        let report = scene.edit(EditCommand::CutByBlade { poses, closed: false }).pop().unwrap();
        assert_eq!((report.outcome, report.pieces.len(), report.new_vertices), (Outcome::Missed, 1, 0));
        assert!(report.area_before > 0.0 && report.max_plane_distance == Some(0.0));
    }
}
