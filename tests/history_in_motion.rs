//! Edits, undo and redo in the middle of strokes and of motion: nothing that is there before and after jumps, and every structure holds.

mod common;

use common::models::scene_of;
use glam::DVec3;
use incise::geometry::{Plane, VertexId};
use incise::scene::{EditCommand, Outcome, Scene, TissueId};
use incise::surgery::{BladePose, WallMode};
use incise::tissue::Tissue;

/// Runs a scene in frames of 1/90 s.
struct Clock {
    scene: Scene,
    time_s: f64,
    animation_s: f64,
}

impl Clock {
    fn of(name: &str, faces: usize, soft: bool) -> Self {
        let (mut scene, animated) = scene_of(name, faces, soft);
        scene.set_animation(animated.then_some(0));
        scene.pose(0.0, 0.0);
        Self { scene, time_s: 0.0, animation_s: 0.0 }
    }

    /// `rate`: seconds of the animation to one of the clock.
    fn frames(&mut self, count: usize, rate: f64) {
        for _ in 0..count {
            self.time_s += 1.0 / 90.0;
            self.animation_s += rate / 90.0;
            self.scene.pose(self.time_s, self.animation_s);
            self.scene.step(1.0 / 90.0);
        }
    }

    fn blade(&mut self, t: f64, tip: [f64; 3], base: [f64; 3]) {
        self.scene.edit(EditCommand::StrokePose(BladePose { t, tip: tip.into(), base: base.into() }));
        self.scene.validate().unwrap();
    }

    fn diagonal(&self) -> f64 {
        self.scene.tissue(TissueId(0)).unwrap().diagonal()
    }

    fn stands(&self) -> Vec<(TissueId, VertexId, DVec3)> {
        let of = |(id, t): (TissueId, &'_ Tissue)| t.mesh().live_vertices().map(|v| (id, v, t.position(v))).collect::<Vec<_>>();
        self.scene.tissues().flat_map(of).collect()
    }

    /// How far the vertices that are there still have moved, in diagonals.
    fn farthest(&self, before: &[(TissueId, VertexId, DVec3)]) -> f64 {
        let now = self.stands();
        let key = |s: &(TissueId, VertexId, DVec3)| (s.0, s.1);
        let moved = before.iter().filter_map(|b| {
            let at = now.binary_search_by_key(&key(b), key).ok()?;
            Some(now[at].2.distance(b.2))
        });
        moved.fold(0.0, f64::max) / self.diagonal()
    }
}

/// A wide stroke whose end drops a crumb.
fn stroke_with_crumb() -> Clock {
    let mut run = Clock::of("heart", 420, true);
    let width = 0.13892 * run.diagonal();
    run.scene.edit(EditCommand::StrokeBegin { width });
    run.blade(0.0667, [-0.0625695, -0.00304036, 0.160088], [0.0659424, -0.0437772, -0.149877]);
    run.blade(0.2333, [-0.0684463, 0.0078532, 0.1562198], [0.0600656, -0.0328836, -0.1537454]);
    run.frames(3, 0.0);
    run
}

/// The undo ends the stroke, which drops a crumb or severs a piece, and brings back at once what came off.
#[test]
fn undo_in_mid_stroke_moves_nothing() {
    let mut run = stroke_with_crumb();
    let before = run.stands();
    let reports = run.scene.edit(EditCommand::Undo);
    assert_eq!(reports.iter().map(|r| r.outcome).collect::<Vec<_>>(), [Outcome::Torn, Outcome::Undone]);
    assert!(run.farthest(&before) < 1e-9, "{:e}", run.farthest(&before));

    let mut beam = Clock::of("beam", 420, true);
    beam.frames(26, 15.0);
    beam.scene.edit(EditCommand::StrokeBegin { width: 0.0 });
    beam.blade(0.0, [0.059729, 0.046954, -0.718035], [0.059729, 0.046954, 0.449095]);
    beam.frames(1, 15.0);
    beam.blade(0.0333, [0.031872, 0.078129, -0.718035], [0.031872, 0.078129, 0.449095]);
    beam.frames(2, 15.0);
    beam.blade(0.0555, [-0.0087208, 0.088129, -0.718035], [-0.0087208, 0.088129, 0.449095]);
    beam.frames(1, 15.0);
    let before = beam.stands();
    assert_eq!(beam.scene.edit(EditCommand::Undo)[0].outcome, Outcome::Torn);
    assert!(beam.farthest(&before) < 1e-9, "{:e}", beam.farthest(&before));

    for width in [0.0, 0.004] {
        let mut beam = Clock::of("beam", 420, true);
        beam.frames(26, 2.0);
        beam.scene.edit(EditCommand::StrokeBegin { width });
        for k in 0..=20 {
            let y = 0.2 - 0.02 * f64::from(k);
            beam.blade(f64::from(k) / 90.0, [-0.1, y, -0.3], [-0.1, y, 0.3]);
            beam.frames(1, 2.0);
        }
        let before = beam.stands();
        assert_eq!(beam.scene.edit(EditCommand::Undo)[0].outcome, Outcome::Severed, "{width} m");
        assert!(beam.farthest(&before) < 1e-9, "{:e}", beam.farthest(&before));
    }
}

/// Wounds that are still opening in a heart that beats, while a hand pulls: taken back and made again one after the other, over and over.
#[test]
fn undo_and_redo_in_motion_move_nothing() {
    let mut run = Clock::of("heart", 1500, true);
    run.frames(9, 1.0);
    run.scene.edit(EditCommand::GrabBegin { id: 1, center: DVec3::new(0.0, -0.01, 0.04), radius: 0.02 });
    for (stroke, width) in [0.003, 0.0, 0.004].into_iter().enumerate() {
        run.scene.set_wall(if stroke == 2 { WallMode::Closed } else { WallMode::Open });
        run.scene.edit(EditCommand::GrabMove { id: 1, by: 0.004 * (stroke + 1) as f64 * DVec3::Z });
        run.scene.edit(EditCommand::StrokeBegin { width });
        for k in 0..12 {
            let (x, y) = (0.004 * f64::from(k) - 0.022, 0.02 - 0.02 * stroke as f64 + 0.001 * f64::from(k));
            run.blade(f64::from(k) / 90.0, [x, y, 0.02], [x, y, 0.12]);
            run.frames(1, 1.0);
        }
        assert_eq!(run.scene.edit(EditCommand::StrokeEnd)[0].outcome, Outcome::Torn);
    }
    let mut steps = 0;
    for command in [EditCommand::Undo, EditCommand::Redo, EditCommand::Undo, EditCommand::Redo] {
        for _ in 0..3 {
            let before = run.stands();
            run.scene.edit(command.clone());
            // fades are kept in f32, and reach far
            assert!(run.farthest(&before) < 1e-8, "step {steps}: {:e}", run.farthest(&before));
            run.scene.validate().unwrap();
            let before = run.stands();
            run.frames(2 + steps % 3, 1.0);
            assert!(run.farthest(&before) > 1e-6, "the measure sees what moves");
            steps += 1;
        }
    }
    assert_eq!((run.scene.undo_depth(), run.scene.redo_depth()), (3, 0));
}

/// A piece that was cut off in one pose and went back in another comes off and goes back without a jump: what it knows of where its
/// tissue stands is of long ago.
#[test]
fn pieces_come_off_and_go_back_where_they_are() {
    let mut run = Clock::of("heart", 1500, true);
    run.frames(20, 1.0);
    run.scene.edit(EditCommand::GrabBegin { id: 1, center: DVec3::new(0.0, 0.0, 0.04), radius: 0.03 });
    run.scene.edit(EditCommand::GrabMove { id: 1, by: DVec3::new(0.01, 0.0, 0.01) });
    run.frames(12, 1.0);
    run.scene.edit(EditCommand::CutClosed(Plane::Equation { normal: DVec3::X, offset: 0.003 }));
    let piece = run.scene.tissues().last().unwrap().0;
    assert_ne!(piece, TissueId(0));
    // those of the plane are the cut's own, and nowhere else
    let is_own = |s: &&(TissueId, VertexId, DVec3)| (s.2.x - 0.003).abs() < 1e-6;
    let own: Vec<VertexId> = run.stands().iter().filter(is_own).filter(|s| s.0 == piece).map(|s| s.1).collect();
    let of_piece = |run: &Clock| -> Vec<DVec3> {
        let stands = run.stands();
        stands.iter().filter(|s| s.0 == piece && own.binary_search(&s.1).is_err()).map(|s| s.2).collect()
    };
    let limit = 1e-6 * run.diagonal();
    let are_in = |points: &[DVec3], all: &[(TissueId, VertexId, DVec3)]| {
        let lost = points.iter().filter(|p| !all.iter().any(|s| s.2.distance(**p) < limit)).count();
        assert_eq!(lost, 0, "of {}", points.len());
    };
    run.frames(7, 1.0);
    let stood = of_piece(&run);
    assert!(stood.len() > 100 && own.len() > 50);
    run.scene.edit(EditCommand::Undo);
    are_in(&stood, &run.stands());
    run.frames(40, 1.0);
    let whole = run.stands();
    run.scene.edit(EditCommand::Redo);
    let again = of_piece(&run);
    assert_eq!(again.len(), stood.len());
    are_in(&again, &whole);
}

/// A vertex of a slit whose row grew too long is a base vertex with few bones, and lies in its section's bounds all the same.
#[test]
fn promoted_vertices_lie_in_their_sections() {
    let mut run = Clock::of("heart", 3200, false);
    run.frames(37, 1.0);
    run.scene.set_wall(WallMode::Closed);
    let width = 1e-5 * run.diagonal();
    run.scene.edit(EditCommand::StrokeBegin { width });
    run.blade(0.3, [0.080491, -0.016003, 0.035036], [0.158733, -0.042042, -0.063650]);
    run.frames(12, 1.0);
    run.blade(0.433333, [0.012031, -0.013578, -0.018388], [0.100350, -0.039814, -0.108110]);
    run.frames(15, 1.0);
    run.blade(0.6, [-0.056429, -0.011154, -0.071812], [0.040788, -0.037303, -0.151834]);
    run.frames(40, 1.0);
    run.scene.edit(EditCommand::StrokeEnd);
    run.scene.edit(EditCommand::StrokeBegin { width: 0.0 });
    run.frames(6, 1.0);
    run.blade(0.066666, [0.015444, -0.000782, -0.020439], [-0.055176, -0.169661, -0.004328]);
    run.frames(3, 4.0);
    run.blade(0.266666, [-0.016492, -0.000782, 0.025307], [0.016432, -0.169661, -0.039212]);
    run.frames(9, 4.0);
    run.scene.validate().unwrap();
    let promoted: usize = run.scene.tissues().map(|(_, t)| t.promoted_vertices()).sum();
    assert!(promoted > 0, "the case must promote vertices");
}
