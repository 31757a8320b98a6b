//! Whatever a tracker that has lost its way, a careless caller or a malicious script may hand to a scene, in any order: nothing panics,
//! what is seen stays finite, and the model can be brought back as it was loaded.

mod common;

use common::models::scene;
use glam::{DQuat, DVec3};
use incise::geometry::Plane;
use incise::physics::{RigidPose, RigidShape};
use incise::scene::{EditCommand, Outcome, PieceSettings, Scene, TissueId};
use incise::surgery::{BladePose, WallMode};
use proptest::prelude::*;

#[derive(Clone, Debug)]
enum Step {
    Edit(EditCommand),
    Wall(WallMode),
    Animate(Option<usize>),
    Time { clock: f64, animation: f64, step: f64 },
}

const ODD: [f64; 12] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, -1e300, 1e160, 1e30, -1e9, 1e4, 1e-300, -0.0, 0.0];

/// Mostly a number of the size of the model, else anything.
fn number(size: f64) -> impl Strategy<Value = f64> {
    prop_oneof![30 => -size..size, 1 => prop::sample::select(&ODD[..])]
}

fn point() -> impl Strategy<Value = DVec3> {
    [number(0.1), number(0.1), number(0.1)].prop_map(DVec3::from_array)
}

fn sized() -> impl Strategy<Value = f64> {
    number(0.05).prop_map(|x| if x.abs() < 1.0 { x.abs() } else { x })
}

fn blade() -> impl Strategy<Value = BladePose> {
    (number(1.0), point(), point()).prop_map(|(t, tip, base)| BladePose { t, tip, base: tip + 3.0 * base })
}

fn plane() -> impl Strategy<Value = Plane> {
    prop_oneof![
        (point(), number(0.002)).prop_map(|(normal, offset)| Plane::Equation { normal, offset }),
        [point(), point(), point()].prop_map(Plane::Points),
        point().prop_map(|p| Plane::Points([p; 3])),
    ]
}

fn shape() -> impl Strategy<Value = RigidShape> {
    prop_oneof![
        sized().prop_map(|radius| RigidShape::Sphere { radius }),
        (sized(), sized()).prop_map(|(half_length, radius)| RigidShape::Capsule { half_length, radius }),
    ]
}

fn command() -> impl Strategy<Value = EditCommand> {
    use EditCommand as C;
    let id = || 0u32..3;
    let turn = || [number(1.0), number(1.0), number(1.0), number(1.0)].prop_map(DQuat::from_array);
    prop_oneof![
        3 => sized().prop_map(|width| C::StrokeBegin { width }),
        12 => blade().prop_map(C::StrokePose),
        2 => Just(C::StrokeEnd),
        1 => plane().prop_map(C::Cut),
        1 => plane().prop_map(C::CutClosed),
        1 => (plane(), prop::collection::vec(point(), 0..5), any::<bool>())
            .prop_map(|(plane, corners, closed)| C::CutBounded { plane, corners, closed }),
        1 => (prop::collection::vec(blade(), 0..4), any::<bool>()).prop_map(|(poses, closed)| C::CutByBlade { poses, closed }),
        2 => Just(C::Undo),
        2 => Just(C::Redo),
        1 => Just(C::Reset),
        2 => (id(), point(), sized()).prop_map(|(id, center, radius)| C::GrabBegin { id, center, radius }),
        3 => (id(), point()).prop_map(|(id, by)| C::GrabMove { id, by }),
        1 => id().prop_map(|id| C::GrabEnd { id }),
        2 => (id(), shape(), turn(), point())
            .prop_map(|(id, shape, rotation, translation)| C::PlaceCollider { id, shape, pose: RigidPose { rotation, translation } }),
        1 => id().prop_map(|id| C::RemoveCollider { id }),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        8 => command().prop_map(Step::Edit),
        1 => prop::sample::select(&[WallMode::Open, WallMode::Closed][..]).prop_map(Step::Wall),
        1 => prop::sample::select(&[None, Some(0), Some(99)][..]).prop_map(Step::Animate),
        4 => (number(1.0), number(1.0), number(0.03)).prop_map(|(clock, animation, step)| Step::Time { clock, animation, step }),
    ]
}

/// What a scene may grow to before its steps end: a wide blade that turns about its tip makes the square of its boxes in faces, and the
/// laws are asked of all of them after each step.
const MOST_FACES: usize = 10_000;

fn check(scene: &Scene) -> Result<(), TestCaseError> {
    scene.validate().map_err(TestCaseError::fail)?;
    for (id, tissue) in scene.tissues() {
        for v in tissue.mesh().live_vertices() {
            let at = tissue.position(v);
            prop_assert!(at.is_finite(), "vertex {} of tissue {} is at {at}", v.index(), id.0);
        }
    }
    Ok(())
}

fn run(model: usize, steps: &[Step]) -> Result<(), TestCaseError> {
    let (mut scene, _) = scene(["beam", "sphere", "heart"][model], [300, 200, 500][model]);
    scene.set_pieces(PieceSettings { fall: true, ..PieceSettings::default() });
    scene.pose(0.0, 0.0);
    let untouched = scene.edit_hash();
    for step in steps {
        match step {
            Step::Edit(command) => drop(scene.edit(command.clone())),
            Step::Wall(wall) => scene.set_wall(*wall),
            Step::Animate(animation) => scene.set_animation(*animation),
            Step::Time { clock, animation, step } => {
                scene.pose(*clock, *animation);
                scene.step(*step);
            }
        }
        check(&scene)?;
        if scene.tissues().map(|(_, tissue)| tissue.mesh().live_faces().count()).sum::<usize>() > MOST_FACES {
            break;
        }
    }
    scene.edit(EditCommand::Reset);
    check(&scene)?;
    prop_assert_eq!(scene.tissues().filter(|(_, t)| t.mesh().live_faces().next().is_some()).count(), 1);
    prop_assert!(scene.tissue(TissueId(0)).is_some());
    prop_assert_eq!(scene.edit_hash(), untouched);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_that_comes_in_breaks_a_scene(model in 0usize..3, steps in prop::collection::vec(step(), 1..40)) {
        run(model, &steps)?;
    }
}

fn time(clock: f64, step: f64) -> Step {
    Step::Time { clock, animation: 0.0, step }
}

fn cut(normal: DVec3) -> Step {
    Step::Edit(EditCommand::CutClosed(Plane::Equation { normal, offset: 0.0 }))
}

/// What fades in was nowhere once the clock was no number.
#[test]
fn a_clock_that_stops_telling_the_time_moves_nothing() {
    let pose = |base: DVec3| Step::Edit(EditCommand::StrokePose(BladePose { t: 0.0, tip: DVec3::ZERO, base }));
    let stroke = [Step::Edit(EditCommand::StrokeBegin { width: 0.0 }), pose(0.28 * DVec3::Z), pose(-0.28 * DVec3::Y)];
    for nonsense in [f64::NAN, f64::INFINITY, -1e300, 1e30, -1e9] {
        let clock = [time(0.0, 0.028), time(nonsense, 0.02), cut(DVec3::Z)];
        run(2, &[&stroke[..], &clock[..]].concat()).unwrap();
    }
}

/// Rapier panics over what is far too large for its f32, and after a step that is zero in it.
#[test]
fn a_piece_falls_beside_an_endless_shaft_and_after_a_step_of_no_length() {
    let shape = RigidShape::Capsule { half_length: 1e30, radius: 0.004 };
    let shaft = EditCommand::PlaceCollider { id: 0, shape, pose: RigidPose::at(-0.0137 * DVec3::Y) };
    run(0, &[Step::Edit(shaft), cut(DVec3::Y), time(0.0, 0.019)]).unwrap();
    let back = [EditCommand::Reset, EditCommand::Redo].map(Step::Edit);
    let falls = [cut(DVec3::Y), cut(DVec3::X), time(0.0, 0.0), time(0.0, 1e-300)];
    run(2, &[&falls[..], &back[..], &[time(0.0, 0.015)]].concat()).unwrap();
}

/// What a collider moves in nearly no time would go on at its way over that, and everything that is worked out from it be no number.
#[test]
fn tissue_inside_a_huge_collider_stays_within_bounds_after_a_step_of_no_length() {
    let shape = RigidShape::Sphere { radius: 1e4 };
    let place = EditCommand::PlaceCollider { id: 0, shape, pose: RigidPose::at(DVec3::splat(0.02)) };
    let moves = [time(0.0, 0.01), Step::Edit(place), time(0.0, 1e-300), time(0.0, 0.02), time(0.0, 1e-6), time(0.0, 0.02)];
    run(1, &[&moves[..], &[cut(DVec3::Y), time(0.0, 0.02), cut(DVec3::X)]].concat()).unwrap();
}

/// Distances from a plane whose points are far away are worth nothing; the cut goes by exact values.
#[test]
fn a_plane_given_by_points_far_away_cuts_where_it_is() {
    for name in ["sphere", "heart"] {
        let volumes = |plane: Plane| {
            let (mut scene, _) = scene(name, 500);
            let report = scene.edit(EditCommand::CutClosed(plane)).pop().unwrap();
            assert_eq!(report.outcome, Outcome::Cut);
            let sides: Vec<(i8, f64)> = report.pieces.iter().map(|p| (p.side, p.volume)).collect();
            assert_eq!(scene.validate(), Ok(()));
            sides
        };
        let near = volumes(Plane::Equation { normal: DVec3::Z, offset: 0.003 });
        for far in [1e6, 1e12, 1e30, 1e70] {
            let corners = [DVec3::new(far, far, 0.003), DVec3::new(-far, far, 0.003), DVec3::new(0.0, -far, 0.003)];
            let cut = volumes(Plane::Points(corners));
            assert_eq!(cut.len(), near.len());
            for (a, b) in cut.iter().zip(&near) {
                assert!(a.0 == b.0 && (a.1 - b.1).abs() <= 1e-9 * near[0].1.abs(), "{name} {far}: {cut:?}, not {near:?}");
            }
        }
    }
}

#[test]
fn what_is_no_plane_cuts_nothing() {
    for normal in [DVec3::ZERO, DVec3::NAN, DVec3::X * f64::INFINITY, DVec3::Y * 1e200] {
        let (mut scene, _) = scene("sphere", 200);
        let untouched = scene.edit_hash();
        let plane = Plane::Equation { normal, offset: 0.0 };
        let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Z];
        for command in [
            EditCommand::Cut(plane),
            EditCommand::CutClosed(plane),
            EditCommand::CutBounded { plane, corners: corners.clone(), closed: true },
        ] {
            let report = scene.edit(command).pop().unwrap();
            assert_eq!((report.outcome, report.pieces.len()), (Outcome::Missed, 1), "{normal}");
        }
        assert_eq!((scene.edit_hash(), scene.undo_depth()), (untouched, 0));
    }
}
