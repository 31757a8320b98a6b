//! Falling, lying and resting bodies of the rigid world.

use super::{GRAVITY, RigidPose, RigidShape, RigidWorld};
use glam::{DQuat, DVec3};
use std::f64::consts::TAU;

fn corners() -> Vec<DVec3> {
    (0..8).map(|k| DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2 & 1)) * 0.2 - 0.1).collect()
}

#[test]
fn a_hull_falls_onto_the_table_and_sleeps() {
    let mut world = RigidWorld::new(DVec3::Y, 0.3);
    world.set_table(Some(-0.5));
    let piece = world.add_hull(&corners(), 0.5, RigidPose::IDENTITY).unwrap();
    assert!(!world.is_resting());
    for frame in 0..600 {
        world.step(1.0 / 60.0);
        let y = world.pose(piece).unwrap().translation.y;
        assert!(y > -0.44, "frame {frame}: {y}");
    }
    let at = world.pose(piece).unwrap();
    assert!((at.translation.y + 0.4).abs() < 5e-3, "{at:?}");
    assert!(world.is_resting());
    // Broken twin: without the table it goes on falling.
    world.set_table(None);
    let loose = world.add_hull(&corners(), 0.5, RigidPose::IDENTITY).unwrap();
    (0..60).for_each(|_| world.step(1.0 / 60.0));
    assert!(world.pose(loose).unwrap().translation.y < -2.0);
}

/// What a soft layer feels is kept beside the bodies, as they come, change and go.
#[test]
fn a_soft_layer_is_told_what_it_feels() {
    let mut world = RigidWorld::new(DVec3::Y, 0.3);
    let told = |world: &RigidWorld, own| world.touching(own).map(|(id, _)| id).collect::<Vec<_>>();
    world.set_table(Some(-0.5));
    let piece = world.add_hull(&corners(), 0.5, RigidPose::IDENTITY).unwrap();
    assert!(world.is_empty() && told(&world, None).is_empty() && told(&world, Some(piece)).is_empty());
    let sphere = RigidShape::Sphere { radius: 0.1 };
    let first = world.add_driven(sphere, RigidPose::at(DVec3::X)).unwrap();
    let ball = world.add_ball(0.1, 1.0, RigidPose::at(DVec3::Z)).unwrap();
    let second = world.add_driven(sphere, RigidPose::at(2.0 * DVec3::X)).unwrap();
    assert!(!world.is_empty());
    assert_eq!(told(&world, None), [first, ball, second]);
    assert_eq!(told(&world, Some(piece)), [first, second], "loose bodies meet as rigid ones");
    world.pass_stands(piece);
    assert_eq!(told(&world, None), [piece, first, ball, second]);
    [first, ball, first].into_iter().for_each(|id| world.remove(id));
    assert_eq!((told(&world, None), told(&world, Some(piece))), (vec![piece, second], vec![second]));
    [piece, second].into_iter().for_each(|id| world.remove(id));
    assert!(world.is_empty() && told(&world, None).is_empty());
}

/// What a hand or the tissue puts on a body that sleeps is of one step: while others move it must not gather in rapier.
#[test]
fn a_held_body_that_sleeps_is_not_flung_when_it_wakes() {
    let mut world = RigidWorld::new(DVec3::Y, 0.3);
    world.set_table(Some(-0.5));
    let piece = world.add_hull(&corners(), 0.5, RigidPose::IDENTITY).unwrap();
    (0..600).for_each(|_| world.step(1.0 / 60.0));
    assert!(world.is_resting());
    let at = world.pose(piece).unwrap().translation;
    let ball = world.add_ball(0.05, 0.1, RigidPose::at(DVec3::new(3.0, 0.0, 0.0))).unwrap();
    for frame in 0..120 {
        // a tenth of what would lift it, always the same: no reason to wake
        world.carry(piece, at, 0.1 * GRAVITY / (TAU * 8.0).powi(2) * DVec3::Y, 1.0);
        world.set_velocity(ball, DVec3::X * if frame % 2 == 0 { 0.5 } else { -0.5 });
        world.step(1.0 / 60.0);
    }
    let mut highest = at.y;
    for _ in 0..30 {
        // nothing holds it any more, which wakes it
        world.step(1.0 / 60.0);
        highest = highest.max(world.pose(piece).unwrap().translation.y);
    }
    assert!(highest < at.y + 1e-3, "{highest} above {}", at.y);
}

/// Rapier's contacts give way by so many metres under a body's weight, whatever its size; here by so much of it.
#[test]
fn small_pieces_lie_on_the_table_as_large_ones_do() {
    for length in [3.0, 0.3, 0.03, 0.003, 1e-3, 5e-4] {
        let (mut world, scale) = (RigidWorld::new(DVec3::Y, length), length / 0.3);
        world.set_table(Some(-0.5 * scale));
        let points: Vec<DVec3> = corners().iter().map(|p| DVec3::new(1.0, 0.8, 0.6) * *p * scale).collect();
        let tilted = RigidPose { rotation: DQuat::from_rotation_z(0.3), ..RigidPose::IDENTITY };
        let piece = world.add_hull(&points, 0.5 * scale.powi(3), tilted).unwrap();
        (0..400).for_each(|_| world.step(1.0 / 90.0));
        let y = world.pose(piece).unwrap().translation.y / scale;
        assert!(world.is_resting() && (y + 0.42).abs() < 2e-3, "{length}: {y}");
    }
}

#[test]
fn a_fast_instrument_does_not_pass_a_loose_body() {
    let mut world = RigidWorld::new(DVec3::Y, 0.3);
    world.set_table(Some(-0.1));
    let piece = world.add_hull(&corners(), 0.5, RigidPose::IDENTITY).unwrap();
    let shape = RigidShape::Sphere { radius: 0.03 };
    let tool = world.add_driven(shape, RigidPose::at(DVec3::new(-0.5, 0.0, 0.0))).unwrap();
    (0..60).for_each(|_| world.step(1.0 / 60.0));
    let start = world.pose(piece).unwrap().translation.x;
    for k in 1..=4 {
        world.drive(tool, RigidPose::at(DVec3::new(-0.5 + 0.1 * f64::from(k), 0.0, 0.0)));
        world.step(1.0 / 60.0);
    }
    (0..30).for_each(|_| world.step(1.0 / 60.0));
    let x = world.pose(piece).unwrap().translation.x;
    assert!(x > start + 0.02, "{start} {x}");
}

#[test]
fn nonsense_is_refused_and_steps_are_survived() {
    let mut world = RigidWorld::new(DVec3::ZERO, f64::NAN);
    assert!(world.add_driven(RigidShape::Sphere { radius: -1.0 }, RigidPose::IDENTITY).is_none());
    assert!(world.add_ball(0.1, 0.0, RigidPose::IDENTITY).is_none());
    assert!(world.add_hull(&[], 1.0, RigidPose::IDENTITY).is_none());
    assert!(world.add_hull(&[DVec3::ONE; 5], 1.0, RigidPose::IDENTITY).is_none());
    let flat: Vec<DVec3> = corners().into_iter().map(|p| DVec3::new(p.x, p.x + p.y, p.y)).collect();
    let line: Vec<DVec3> = corners().into_iter().map(|p| DVec3::new(p.x, p.x, p.x)).collect();
    let a = world.add_hull(&flat, 1.0, RigidPose::IDENTITY).unwrap();
    let b = world.add_hull(&line, 1.0, RigidPose::IDENTITY).unwrap();
    for h in [f64::NAN, -1.0, 0.0, 1e-5, 1.0, 1.0] {
        world.step(h);
    }
    assert!([a, b].into_iter().all(|id| world.pose(id).unwrap().translation.is_finite()));
    world.drive(a, RigidPose::at(DVec3::NAN));
    world.remove(a);
    world.remove(a);
    world.step(0.1);
    assert!(world.is_empty() && world.pose(b).is_some(), "soft layers feel no hulls");
}

#[test]
fn a_force_of_any_stiffness_holds_a_ball() {
    for stiffness in [10.0, 1e5, 1e9] {
        let mut world = RigidWorld::new(DVec3::Y, 0.3);
        let ball = world.add_ball(0.05, 0.2, RigidPose::at(DVec3::Y * 0.01)).unwrap();
        let mut lowest: f64 = 0.0;
        for _ in 0..3000 {
            world.step(1.0 / 60.0);
            let y = world.pose(ball).unwrap().translation.y;
            lowest = lowest.min(y);
            let body = world.body_mut(ball).unwrap();
            body.push.force = DVec3::Y * (-stiffness * y).max(0.0);
            body.push.stiffness = if y < 0.0 { stiffness } else { 0.0 };
        }
        let y = world.pose(ball).unwrap().translation.y;
        let still = -0.2 * GRAVITY / stiffness;
        assert!((y - still).abs() < 0.05 * still.abs() + 2e-3 && lowest > 3.0 * still - 0.05, "{stiffness}: {y} {lowest}");
    }
}

#[test]
fn a_stand_that_moves_wakes_what_is_at_it_and_nothing_else() {
    let mut world = RigidWorld::new(DVec3::Y, 0.3);
    world.set_table(Some(-0.1));
    let stand = world.add_stand(&corners(), RigidPose::IDENTITY).unwrap();
    let at = [DVec3::Y * 0.25, DVec3::X].map(|p| world.add_hull(&corners(), 0.5, RigidPose::at(p)).unwrap());
    (0..600).for_each(|_| world.step(1.0 / 90.0));
    let places = |world: &RigidWorld| at.map(|id| world.pose(id).unwrap().translation);
    let before = places(&world);
    assert!(world.is_resting() && before[0].y > 0.19 && before[1].y < 1e-3, "{before:?}");
    let lower: Vec<DVec3> = corners().iter().map(|p| DVec3::new(p.x, p.y.min(0.05), p.z)).collect();
    world.reshape(stand, &lower);
    (0..60).for_each(|_| world.step(1.0 / 90.0));
    let after = places(&world);
    assert!((after[0].y - before[0].y + 0.05).abs() < 5e-3 && after[1] == before[1], "{before:?} {after:?}");
    // moved ten times a second, it keeps awake what lies on it alone
    for _ in 0..60 {
        world.reshape(stand, &corners());
        (0..9).for_each(|_| world.step(1.0 / 90.0));
    }
    assert!(!world.is_resting() && places(&world)[1] == before[1]);
}

#[test]
fn scraps_lie_on_the_table_and_in_no_pieces_way() {
    let mut world = RigidWorld::new(DVec3::Y, 0.3);
    world.set_table(Some(-0.1));
    let piece = world.add_hull(&corners(), 0.5, RigidPose::IDENTITY).unwrap();
    let of_size = |share: f64| corners().iter().map(|p| *p * share).collect::<Vec<_>>();
    let above = RigidPose::at(DVec3::Y * 0.2);
    let scrap = world.add_hull(&of_size(0.03), 1e-5, above).unwrap();
    let larger = world.add_hull(&of_size(0.05), 1e-5, above).unwrap();
    (0..600).for_each(|_| world.step(1.0 / 90.0));
    let y = |id| world.pose(id).unwrap().translation.y;
    assert!(world.is_resting() && y(piece).abs() < 2e-3, "{}", y(piece));
    assert!((y(scrap) + 0.097).abs() < 2e-3 && (y(larger) - 0.105).abs() < 2e-3, "{} {}", y(scrap), y(larger));
}

#[test]
fn a_driven_body_is_no_larger_than_the_world_and_stays_in_it() {
    let mut world = RigidWorld::new(DVec3::Y, 0.3);
    world.set_table(Some(-0.1));
    world.add_hull(&corners(), 0.5, RigidPose::IDENTITY).unwrap();
    for (half_length, radius) in [(1e30, 0.01), (0.01, 1e30), (f64::MAX, 1.0), (0.01, f64::NAN)] {
        assert!(world.add_driven(RigidShape::Capsule { half_length, radius }, RigidPose::IDENTITY).is_none());
    }
    let ball = world.add_driven(RigidShape::Sphere { radius: 0.05 }, RigidPose::at(DVec3::X * 1e300)).unwrap();
    assert_eq!(world.pose(ball).unwrap().translation, DVec3::X * 3000.0);
    let before = world.pose(ball);
    world.drive(ball, RigidPose::IDENTITY);
    [0.0, 1e-300, 1e-9, -1.0, f64::NAN, f64::INFINITY].into_iter().for_each(|h| world.step(h));
    assert_eq!(world.pose(ball), before, "such steps are none");
    for far in [DVec3::splat(-1e38), DVec3::ZERO, DVec3::Y * f64::MAX] {
        world.drive(ball, RigidPose::at(far));
        (0..3).for_each(|_| world.step(1.0 / 90.0));
        let at = world.pose(ball).unwrap();
        assert_eq!(Some(at), world.within(RigidPose::at(far)), "a pose that is reached is one that can be asked for");
    }
}
