//! Random sequences of edits on animated, soft models: every structure is checked from scratch after every step, nothing
//! pops, and undo and redo restore the state bit for bit (MATHS 2.2, 7).

mod common;

use common::models::{self, scene};
use glam::DVec3;
use incise::geometry::Plane;
use incise::scene::{EditCommand, Outcome, Scene, TissueId};
use incise::surgery::BladePose;
use proptest::prelude::*;

#[derive(Clone, Debug)]
enum Step {
    Tear { from: DVec3, to: DVec3, axis: DVec3, width: f64, poses: usize, live: bool },
    Cut { normal: DVec3, at: DVec3 },
    CutPart { tips: [DVec3; 2], axis: DVec3, closed: bool },
    Undo,
    Redo,
    Wait { frames: usize },
}

fn unit() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1.0f64..1.0).prop_map(|v| DVec3::from_array(v).try_normalize().unwrap_or(DVec3::Y))
}

fn inside() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-0.6f64..0.6).prop_map(DVec3::from_array)
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        4 => (inside(), inside(), unit(), prop_oneof![1 => Just(0.0), 2 => 0.005f64..0.15], 2usize..6, any::<bool>())
            .prop_map(|(from, to, axis, width, poses, live)| Step::Tear { from, to, axis, width, poses, live }),
        2 => (unit(), inside()).prop_map(|(normal, at)| Step::Cut { normal, at }),
        1 => (inside(), inside(), unit(), any::<bool>())
            .prop_map(|(a, b, axis, closed)| Step::CutPart { tips: [a, b], axis, closed }),
        2 => Just(Step::Undo),
        2 => Just(Step::Redo),
        2 => (1usize..8).prop_map(|frames| Step::Wait { frames }),
    ]
}

/// The clock and the scale of a run: coordinates of steps are fractions of the model's half size.
struct Run {
    scene: Scene,
    time: f64,
    half: DVec3,
    diagonal: f64,
}

impl Run {
    fn new(model: usize) -> Self {
        let (mut scene, animated) = scene(["beam", "sphere", "heart"][model], [420, 300, 700][model]);
        scene.set_animation(animated.then_some(0));
        scene.pose(0.0, 0.0);
        let tissue = scene.tissue(TissueId(0)).unwrap();
        let (low, high) = tissue.bounds();
        Self { half: (high - low) / 2.0, diagonal: tissue.diagonal(), time: 0.0, scene }
    }

    fn wait(&mut self, frames: usize) {
        for _ in 0..frames {
            self.time += 1.0 / 90.0;
            self.scene.pose(self.time, self.time);
            self.scene.step(1.0 / 90.0);
        }
    }

    /// Seen positions of every tissue's live vertices.
    fn seen(&self) -> Vec<(TissueId, usize, DVec3)> {
        let seen = |(id, t): (TissueId, &incise::tissue::Tissue)| {
            t.mesh().live_vertices().map(|v| (id, v.index(), t.position(v))).collect::<Vec<_>>()
        };
        self.scene.tissues().flat_map(seen).collect()
    }

    fn command(&mut self, command: EditCommand) -> Result<Vec<incise::scene::EditReport>, TestCaseError> {
        let before = self.seen();
        let report = self.scene.edit(command);
        for (id, v, p) in before {
            let Some(tissue) = self.scene.tissue(id) else { continue };
            if v < tissue.mesh().vertex_slots() && tissue.mesh().vertex_is_live(incise::geometry::VertexId::new(v)) {
                let moved = tissue.position(incise::geometry::VertexId::new(v)).distance(p);
                prop_assert!(moved <= 1e-6 * self.diagonal, "vertex {v} popped by {} of the diagonal", moved / self.diagonal);
            }
        }
        Ok(report)
    }

    fn tear(&mut self, step: &Step) -> Result<Outcome, TestCaseError> {
        let Step::Tear { from, to, axis, width, poses, live } = step else { unreachable!() };
        let reach = self.half.length() * 1.5;
        self.command(EditCommand::StrokeBegin { width: width * self.diagonal })?;
        for k in 0..*poses {
            let t = k as f64 / (*poses - 1) as f64;
            let tip = self.half * from.lerp(*to, t);
            self.command(EditCommand::StrokePose(BladePose { t, tip, base: tip + *axis * reach }))?;
            self.scene.validate().map_err(TestCaseError::fail)?;
            if *live {
                self.wait(2);
            }
        }
        let before: f64 = self.scene.tissues().map(|(_, t)| t.measure_all().area).sum();
        let report = self.command(EditCommand::StrokeEnd)?.pop();
        let after: f64 = self.scene.tissues().map(|(_, t)| t.measure_all().area).sum();
        prop_assert!(*width > 0.0 || (after - before).abs() <= 1e-6 * before, "width 0 took out {}", before - after);
        Ok(report.map_or(Outcome::Missed, |r| r.outcome))
    }
}

fn run(model: usize, steps: &[Step]) -> Result<(), TestCaseError> {
    let mut run = Run::new(model);
    let mut hashes = vec![run.scene.edit_hash()];
    let mut at = 0;
    for step in steps {
        let changed = match step {
            Step::Tear { .. } => run.tear(step)? != Outcome::Missed,
            Step::Cut { normal, at } => {
                let plane = Plane::Equation { normal: *normal, offset: normal.dot(run.half * *at) };
                let before = run.scene.tissues().map(|(_, t)| t.measure_all().area).sum::<f64>();
                let report = run.command(EditCommand::Cut(plane))?.pop().unwrap();
                let after = report.pieces.iter().map(|p| p.area).sum::<f64>();
                prop_assert!((after - before).abs() <= 1e-6 * before, "areas {before} {after}");
                prop_assert!(report.max_plane_distance.unwrap() <= 1e-6 * run.diagonal);
                report.outcome != Outcome::Missed
            }
            Step::CutPart { tips, axis, closed } => {
                let [a, b] = tips.map(|t| run.half * t);
                let up = *axis * run.half.length();
                let plane = Plane::Points([a, b, b + up]);
                let before = run.scene.tissues().map(|(_, t)| t.measure_all().area).sum::<f64>();
                let corners = vec![a, b, b + up, a + up];
                let report = run.command(EditCommand::CutBounded { plane, corners, closed: *closed })?.pop().unwrap();
                let after = report.pieces.iter().map(|p| p.area).sum::<f64>();
                // caps add area; of several tissues some may be cut right through and others not
                let least = if report.caps.loops > 0 { f64::NEG_INFINITY } else { -1e-6 * before };
                prop_assert!((least..=1e-6 * before).contains(&(before - after)), "areas {before} {after}");
                prop_assert!(report.caps.loops == 0 || *closed);
                prop_assert!(report.max_plane_distance.unwrap() <= 1e-6 * run.diagonal);
                report.outcome != Outcome::Missed
            }
            Step::Undo => {
                prop_assert_eq!(run.scene.undo_depth(), at);
                run.command(EditCommand::Undo)?;
                at = at.saturating_sub(1);
                prop_assert_eq!(run.scene.edit_hash(), hashes[at]);
                false
            }
            Step::Redo => {
                prop_assert_eq!(run.scene.redo_depth(), hashes.len() - 1 - at);
                run.command(EditCommand::Redo)?;
                at = (at + 1).min(hashes.len() - 1);
                prop_assert_eq!(run.scene.edit_hash(), hashes[at]);
                false
            }
            Step::Wait { frames } => {
                run.wait(*frames);
                false
            }
        };
        run.scene.validate().map_err(TestCaseError::fail)?;
        if changed {
            hashes.truncate(at + 1);
            hashes.push(run.scene.edit_hash());
            at += 1;
        }
        prop_assert_eq!(run.scene.edit_hash(), hashes[at]);
    }
    run.command(EditCommand::Reset)?;
    prop_assert_eq!(run.scene.edit_hash(), hashes[0]);
    run.scene.validate().map_err(TestCaseError::fail)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_sequence_of_edits_holds(model in 0usize..3, steps in prop::collection::vec(step(), 2..7)) {
        run(model, &steps)?;
    }
}

/// A piece is looked through when it is first torn; an undo then brings back what an earlier cut had taken from it.
#[test]
fn a_piece_knows_what_an_undo_brings_back() {
    let cut = |normal: [f64; 3], at: [f64; 3]| Step::Cut { normal: normal.into(), at: at.into() };
    let tear = Step::Tear {
        from: DVec3::ZERO,
        to: DVec3::new(0.0, 0.0, -0.22290464663475146),
        axis: DVec3::new(0.0, 0.4611899600282001, -0.8873014261056877),
        width: 0.0,
        poses: 2,
        live: false,
    };
    let first = cut([0.3707463916646802, 0.0, 0.9287341455269208], [-0.5901847925605302, 0.0, 0.4423962956276295]);
    run(0, &[first, cut([0.0, 0.0, 1.0], [0.0; 3]), tear, Step::Undo, Step::Undo]).unwrap();
}

/// A cut gives a particle another anchor, which may make its springs longer than any were: a tear looks at those too.
#[test]
fn a_spring_that_a_cut_has_made_long_is_cut_too() {
    let normal = DVec3::new(-0.24898905871798774, 0.31786316370694245, 0.9148592557311447);
    let cut = Step::Cut { normal, at: DVec3::new(0.49463033396097145, -0.12504450088392952, 0.35050399721902636) };
    let tear = Step::Tear {
        from: DVec3::new(0.558902124045795, -0.47097174277353615, 0.4589584470002582),
        to: DVec3::ZERO,
        axis: DVec3::new(0.993669609365741, 0.0, -0.11234192193004186),
        width: 0.0,
        poses: 2,
        live: false,
    };
    run(2, &[cut, tear]).unwrap();
}

/// The checks above can fail: a tissue whose particle map was tampered with is caught, and so is a lost undo.
#[test]
fn tampering_is_caught() {
    let mut run = Run::new(0);
    let untouched = run.scene.edit_hash();
    let plane = Plane::Equation { normal: DVec3::X, offset: 0.01 };
    run.scene.edit(EditCommand::Cut(plane));
    assert_ne!(run.scene.edit_hash(), untouched);
    let layer = run.scene.tissue_mut(TissueId(0)).unwrap().layer_mut().unwrap();
    let row = layer.map.influences.row(models::first_row(layer)).to_vec();
    layer.map.influences.set_row(models::first_row(layer), &row[..row.len() - 1]);
    assert!(run.scene.validate().is_err());
}
