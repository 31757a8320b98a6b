//! Tears on a coarse grid: vertices on planes, edges in planes, coplanar faces, needles, flush bodies, in both wall modes.

mod common;

use common::Solid;
use common::bodies::{Hexahedron, tear};
use glam::{DMat3, DVec3};
use incise::geometry::{FaceId, HalfEdge};

/// A small generator: the cases are the same on every machine.
struct Dice(u64);

impl Dice {
    fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(0x1405_7b7e_f767_814f);
        (self.0 >> 33) % n
    }

    /// `low..high` in halves.
    fn half(&mut self, low: i64, high: i64) -> f64 {
        (low + self.below((high - low) as u64) as i64) as f64 / 2.0
    }
}

/// A closed solid whose vertices lie on the grid: a cube, squeezed to needles or with vertices pulled to other grid points.
fn solid(dice: &mut Dice) -> Solid {
    let mut solid = if dice.below(4) == 0 { Solid::sphere(2.0, 0) } else { Solid::cube(1 + dice.below(3) as i32) };
    match dice.below(4) {
        0 => solid.positions.iter_mut().for_each(|p| p.x *= 1.0 / 1024.0),
        1 => {
            for _ in 0..3 {
                let v = dice.below(solid.positions.len() as u64) as usize;
                solid.positions[v] += DVec3::new(dice.half(-1, 2), dice.half(-1, 2), dice.half(-1, 2));
            }
        }
        _ => {}
    }
    solid
}

fn body(dice: &mut Dice) -> Hexahedron {
    let low = DVec3::new(dice.half(-3, 6), dice.half(-3, 6), dice.half(-3, 6));
    let half = DVec3::new(dice.half(1, 5), dice.half(1, 5), dice.half(1, 5)) / 2.0;
    let axes = match dice.below(5) {
        0 => DMat3::from_cols(DVec3::new(1.0, 1.0, 0.0), DVec3::new(-1.0, 1.0, 0.0), DVec3::Z),
        1 => DMat3::from_cols(DVec3::new(1.0, 0.0, 1.0), DVec3::Y, DVec3::new(-1.0, 0.0, 1.0)),
        2 => DMat3::from_cols(DVec3::new(1.0, 1.0, 0.0), DVec3::new(0.0, 1.0, 1.0), DVec3::new(1.0, -1.0, 2.0)),
        _ => DMat3::IDENTITY,
    };
    // a skewed frame may be left-handed; bodies have outward planes
    let axes = if axes.determinant() < 0.0 { DMat3::from_cols(axes.x_axis, axes.z_axis, axes.y_axis) } else { axes };
    Hexahedron::new(low + half, axes, half)
}

fn fault(solid: &Solid, is_closed: bool) -> Option<String> {
    if let Err(why) = solid.mesh.validate() {
        return Some(why.to_string());
    }
    if let Some(v) = solid.positions.iter().position(|p| !p.is_finite()) {
        return Some(format!("vertex {v} is not finite"));
    }
    let open = solid.open_half_edges().len();
    (is_closed && open > 0).then(|| format!("{open} open edges"))
}

fn run(is_closed: bool) {
    let mut hits = 0;
    for seed in 0..10_000u64 {
        let mut dice = Dice(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) + 1);
        let mut solid = solid(&mut dice);
        for step in 0..1 + dice.below(3) {
            hits += usize::from(tear(&mut solid, &body(&mut dice), is_closed).0);
            if let Some(why) = fault(&solid, is_closed) {
                panic!("case {seed}, body {step}: {why}");
            }
        }
    }
    assert!(hits > 5_000, "only {hits} bodies reached a solid");
}

#[test]
fn ten_thousand_open_tears() {
    run(false);
}

#[test]
fn ten_thousand_closed_tears() {
    run(true);
}

/// The check can fail: one wall face too few is an open edge.
#[test]
fn a_missing_wall_is_found() {
    let mut dice = Dice(7);
    let mut torn = Solid::cube(2);
    tear(&mut torn, &Hexahedron::new(DVec3::new(1.0, 1.0, 2.0), DMat3::IDENTITY, DVec3::splat(0.5)), true);
    assert_eq!(fault(&torn, true), None);
    let faces: Vec<FaceId> = torn.mesh.live_faces().collect();
    let lost = faces[dice.below(faces.len() as u64) as usize];
    assert!(torn.mesh.opposite(HalfEdge::of(lost, 0)).is_some());
    torn.mesh.replace_faces(&[lost], &[], |_| 0, &mut Default::default());
    assert!(fault(&torn, true).is_some());
}
