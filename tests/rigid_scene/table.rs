//! Where the table lies under what moves.

use super::{bounds, cut, falling, frames};
use crate::common::models::scene;
use glam::DVec3;

/// The table lies under a model in all poses of its animation, and where it did once that is off.
#[test]
fn the_table_lies_under_an_animation() {
    let (mut scene, _) = scene("beam", 2_816);
    let id = scene.tissues().next().unwrap().0;
    let at_rest = scene.ground_bounds();
    scene.set_animation(Some(0));
    let (low, high) = scene.ground_bounds();
    assert!(low.y < at_rest.0.y - 0.05 && low.with_y(at_rest.0.y) == at_rest.0 && high == at_rest.1, "{low} {at_rest:?}");
    let mut lowest = f64::INFINITY;
    for k in 0..100 {
        scene.pose(0.01 * f64::from(k), 0.02 * f64::from(k));
        lowest = lowest.min(bounds(&scene, id).0.y);
    }
    // between two of the times that are looked at it may go a little lower: the table is lower than that by as much
    assert!((low.y - lowest).abs() < 0.015 * 0.5 * (high - low).length(), "{} {lowest}", low.y);
    scene.set_animation(None);
    assert_eq!(scene.ground_bounds(), at_rest);
}

/// A piece that has fallen is animated where it lies: it goes below the table, which stays under what stands.
#[test]
fn a_loose_piece_does_not_let_the_table_down() {
    let mut scene = falling("beam", 768);
    scene.edit(cut(DVec3::X, 0.0));
    frames(&mut scene, 270);
    scene.set_animation(Some(0));
    let mut lowest = [f64::INFINITY; 2];
    for k in 0..32 {
        scene.pose(3.0, f64::from(k) / 16.0);
        for (id, _) in scene.tissues() {
            let of_kind = &mut lowest[usize::from(scene.is_loose(id))];
            *of_kind = of_kind.min(bounds(&scene, id).0.y);
        }
    }
    let ([stands, loose], low) = (lowest, scene.ground_bounds().0.y);
    assert!(low > loose + 0.01 && low <= stands + 1e-3 && loose.is_finite(), "{low}: {loose} {stands}");
}
