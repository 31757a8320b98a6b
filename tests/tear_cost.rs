//! What a segment of a tear costs follows the wound and not the model (MATHS 5.8): counters, not times.

mod common;

use glam::DVec3;
use incise::geometry::{Plane, VertexId};
use incise::particles::ParticleSettings;
use incise::physics::NetworkSettings;
use incise::scene::{EditCommand, EditReport, Outcome, Scene, SceneSettings};
use incise::surgery::{BladePose, SamplingSettings, WallMode};
use incise::tissue::stroke::{SegmentReport, TearStroke};
use incise::tissue::{Tissue, TissueSettings};

/// A model with about one particle for 80 faces.
fn tissue(name: &str, faces: usize) -> Tissue {
    let model = common::models::model(name, faces);
    let rest: Vec<DVec3> = (0..model.rows.len()).map(|v| model.rows.rest(VertexId::new(v))).collect();
    let settings = TissueSettings {
        particles: Some(ParticleSettings::for_count(&model.mesh, &rest, faces / 80)),
        network: NetworkSettings::SOFT,
        opening_s: 0.5,
        section_faces: 128,
        fade_s: 0.25,
    };
    Tissue::new(model, &settings).unwrap()
}

/// A spiral of `segments` boxes whose width, depth and length go with the edges of the model.
fn tear(faces: usize, wall: WallMode, segments: usize) -> Vec<SegmentReport> {
    let mut tissue = tissue("sphere", faces);
    let (low, high) = tissue.bounds();
    let (centre, diagonal, radius) = ((low + high) / 2.0, tissue.diagonal(), (high - low).min_element() / 2.0);
    let edge = (5_000.0 / faces as f64).sqrt() * diagonal;
    let sampling = SamplingSettings::default().with_distance(0.02 * edge, diagonal);
    let mut stroke = TearStroke::new(&tissue, 0.01 * edge, sampling).walled(wall);
    let (mut angle, mut tilt) = (0.0f64, -0.5f64);
    for i in 0..segments + 2 {
        let out = DVec3::new(tilt.cos() * angle.cos(), tilt.sin(), tilt.cos() * angle.sin());
        let turn = 0.02 * edge / (radius * tilt.cos());
        angle += turn;
        tilt += 0.2 * edge / radius * turn / std::f64::consts::TAU;
        let at = centre + out * radius;
        let (tip, base) = (at - out * (0.03 * edge), at + out * (0.05 * edge));
        stroke.push(&mut tissue, BladePose { t: i as f64 / 90.0, tip, base });
        stroke.drain_deltas(|_| {});
    }
    stroke.release(&mut tissue);
    assert_eq!(tissue.validate(), Ok(()));
    stroke.reports().iter().filter(|r| r.new_vertices > 0).cloned().collect()
}

/// Mean of a counter over the later half of the segments.
fn mean(reports: &[SegmentReport], of: impl Fn(&SegmentReport) -> usize) -> f64 {
    let late = &reports[reports.len() / 2..];
    late.iter().map(of).sum::<usize>() as f64 / late.len() as f64
}

#[test]
fn a_segment_costs_the_same_on_a_model_sixteen_times_as_large() {
    for wall in [WallMode::Open, WallMode::Closed] {
        let (small, large) = (tear(5_000, wall, 40), tear(80_000, wall, 40));
        let faces: [f64; 2] = [&small, &large].map(|r| mean(r, |s| s.faces_visited));
        let vertices = [&small, &large].map(|r| mean(r, |s| s.vertices_visited));
        let bytes = [&small, &large].map(|r| mean(r, |s| s.bytes_changed));
        for ([few, many], what, most) in [(faces, "faces", 1_000.0), (vertices, "vertices", 6_000.0), (bytes, "bytes", 60e3)] {
            // whole sections of faces are looked at: one more or less weighs
            assert!(many < 2.0 * few, "{wall:?}, {what}: {few} and {many}");
            assert!(few > 0.0 && many < most, "{wall:?}, {what}: {many}, a whole model is more");
        }
    }
}

#[test]
fn later_segments_of_a_long_stroke_cost_no_more() {
    let reports = tear(20_000, WallMode::Open, 400);
    assert!(reports.len() > 350, "{} segments", reports.len());
    let mean =
        |part: &[SegmentReport], of: fn(&SegmentReport) -> usize| part.iter().map(of).sum::<usize>() as f64 / part.len() as f64;
    let counters: [fn(&SegmentReport) -> usize; 3] = [|s| s.faces_visited, |s| s.vertices_visited, |s| s.bytes_changed];
    for of in counters {
        let (early, late) = (mean(&reports[50..150], of), mean(&reports[reports.len() - 100..], of));
        assert!(late < 1.6 * early, "{early} at first, {late} in the end");
    }
}

/// Corners of walls hang on both sides of a skinned body; the sections of their faces are to stay as small as they look.
#[test]
fn a_stroke_across_an_old_wound_looks_at_little_more_with_walls_than_without() {
    let visited = |wall: WallMode| {
        let mut heart = tissue("heart", 8_000);
        let ((low, high), diagonal) = (heart.bounds(), heart.diagonal());
        let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
        let mut stroke = |along: DVec3, aside: DVec3| {
            let sampling = SamplingSettings::default().with_distance(0.02 * diagonal, diagonal);
            let mut stroke = TearStroke::new(&heart, 0.01 * diagonal, sampling).walled(wall);
            for i in 0..24 {
                let over = middle + aside + along * (f64::from(i) / 23.0 * 1.2 - 0.6) + DVec3::Z * diagonal;
                let Some((s, _)) = heart.blade_entry(over - 2.0 * diagonal * DVec3::Z, over) else { continue };
                let at = over - s * 2.0 * diagonal * DVec3::Z;
                let (tip, base) = (at - 0.03 * diagonal * DVec3::Z, at + 0.05 * diagonal * DVec3::Z);
                stroke.push(&mut heart, BladePose { t: f64::from(i) / 90.0, tip, base });
                stroke.drain_deltas(|_| {});
            }
            stroke.release(&mut heart);
            stroke.reports().iter().filter(|r| r.new_vertices > 0).cloned().collect::<Vec<_>>()
        };
        for k in -2..=2 {
            stroke(half * DVec3::X, half * DVec3::Y * 0.25 * f64::from(k));
        }
        let reports = stroke(half * DVec3::Y, DVec3::ZERO);
        assert!(reports.len() > 8 && heart.validate() == Ok(()), "{} segments", reports.len());
        reports.iter().map(|r| r.faces_visited).sum::<usize>() as f64 / reports.len() as f64
    };
    let [open, closed] = [WallMode::Open, WallMode::Closed].map(visited);
    assert!(closed < 3.0 * open, "{closed} faces with walls, {open} without");
}

#[test]
fn what_nobody_asks_for_is_not_measured_and_changes_nothing() {
    let edits = |measuring: bool| {
        let tools = SceneSettings { sampling: SamplingSettings::default(), sample_distance: None, sample_time: None };
        let mut scene = Scene::new(tissue("sphere", 2_000), tools);
        scene.set_measuring(measuring);
        let tissue = scene.tissues().next().unwrap().1;
        let ((low, high), offset) = (tissue.bounds(), tissue.offset());
        let (centre, size) = ((low + high) / 2.0 + offset, (high - low).min_element());
        let cut = |normal: DVec3| EditCommand::CutClosed(Plane::Equation { normal, offset: normal.dot(centre) + 0.1 * size });
        let mut reports = scene.edit(cut(DVec3::Y));
        // through what the cut left, so that something comes off
        reports.extend(scene.edit(EditCommand::StrokeBegin { width: 0.01 * size }));
        for i in 0..12 {
            let x = DVec3::X * size * (f64::from(i) * 0.12 - 0.66);
            let (tip, base) = (centre + x - size * DVec3::new(0.0, 0.1, 0.7), centre + x + size * DVec3::new(0.0, -0.1, 0.7));
            reports.extend(scene.edit(EditCommand::StrokePose(BladePose { t: f64::from(i) / 90.0, tip, base })));
        }
        reports.extend(scene.edit(EditCommand::StrokeEnd));
        reports.extend(scene.edit(cut(DVec3::new(0.2, 1.0, 0.5))));
        reports.extend(scene.edit(cut(DVec3::X)));
        (reports, scene.edit_hash(), scene.validate())
    };
    let ((told, hash, valid), (untold, same, _)) = (edits(true), edits(false));
    assert_eq!((hash, valid), (same, Ok(())));
    let counts = |reports: &[EditReport]| -> Vec<_> {
        let of =
            |r: &EditReport| (r.outcome, r.vertices, r.faces, r.pieces.len(), r.pieces.iter().map(|p| p.faces).sum::<usize>());
        reports.iter().map(of).collect()
    };
    assert_eq!(counts(&told), counts(&untold));
    assert_eq!(told.iter().map(|r| r.outcome).collect::<Vec<_>>(), [Outcome::Cut, Outcome::Severed, Outcome::Cut, Outcome::Cut]);
    assert!(told.iter().all(|r| r.area_before > 0.0) && untold.iter().all(|r| r.area_before.is_nan()));
}

/// A blade stirred by a hand that trembles cuts the tissue around its tip to shreds: each has its own particles and no strip lets others
/// in. An update there must not look at everything in reach for each of them.
#[test]
fn a_trembling_blade_that_is_stirred_pays_for_what_it_shreds() {
    let mut tissue = tissue("sphere", 5_000);
    let (low, high) = tissue.bounds();
    let (centre, diagonal) = ((low + high) / 2.0, tissue.diagonal());
    let mut stroke =
        TearStroke::new(&tissue, 0.002 * diagonal, SamplingSettings::default().with_distance(0.012 * diagonal, diagonal));
    stroke = stroke.walled(WallMode::Closed);
    let mut seed = 7u64;
    let mut tremble = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((seed >> 33) as f64 / f64::from(1u32 << 31) - 0.5) * 0.003 * diagonal
    };
    for i in 0..=120 {
        let angle = i as f64 / 60.0 * std::f64::consts::TAU;
        let at = centre + DVec3::new(0.0, 0.0, 0.23 * diagonal);
        let tip = at + DVec3::new(tremble(), tremble(), 0.0);
        let base = at + DVec3::new(0.06 * angle.cos(), 0.06 * angle.sin(), 0.15) * diagonal;
        stroke.push(&mut tissue, BladePose { t: i as f64 / 90.0, tip, base });
        stroke.drain_deltas(|_| {});
    }
    stroke.release(&mut tissue);
    assert_eq!(tissue.validate(), Ok(()));
    let reports = stroke.reports();
    let sum = |of: fn(&SegmentReport) -> usize| reports.iter().map(of).sum::<usize>() as f64;
    let (visited, made) = (sum(|r| r.vertices_visited), sum(|r| r.new_vertices));
    assert!(reports.len() > 80 && made > 2_000.0, "{} segments, {made} vertices", reports.len());
    assert!(visited < 270.0 * made, "{visited} vertices looked at, {made} made");
}
