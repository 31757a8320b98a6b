//! Laws of the tear step and the plane cut on bare meshes.

mod common;

use common::Solid;
use common::bodies::{Hexahedron, any_box, append, grid_box, tear};
use glam::{DMat3, DVec3};
use incise::geometry::{FaceId, Plane};
use incise::surgery::plane_cut::{PlaneCutScratch, plane_cut};
use incise::surgery::tear::TearStep;
use proptest::prelude::*;

/// What must hold after a tear by a convex body.
fn check_tear(before: &Solid, after: &Solid, body: &Hexahedron, hit: bool, step: &TearStep) -> Result<(), TestCaseError> {
    prop_assert_eq!(after.mesh.validate(), Ok(()));
    let scale = before.area();
    prop_assert!(
        (before.area() - after.area() - step.area_removed).abs() < 1e-9 * scale,
        "{} {} {}",
        before.area(),
        after.area(),
        step.area_removed
    );
    prop_assert_eq!(hit, step.faces_removed > 0);
    for f in after.mesh.live_faces() {
        let centre = after.mesh.face(f).iter().map(|&v| after.at(v)).sum::<DVec3>() / 3.0;
        prop_assert!(body.depth(centre) > -1e-9 || after.face_area(f) < 1e-9, "a face was left inside");
    }
    // no T-junction and no crack: a closed surface is open only along the body's boundary
    for h in after.open_half_edges() {
        for v in [after.mesh.from(h), after.mesh.to(h)] {
            prop_assert!(body.depth(after.at(v)).abs() < 1e-9, "an open edge away from the body");
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn tears_leave_a_sound_surface(boxes in prop::collection::vec(any_box(1.2, 0.8), 1..5), levels in 0usize..4) {
        let mut solid = Solid::sphere(1.0, levels);
        let mut bodies: Vec<Hexahedron> = Vec::new();
        for body in boxes {
            let before = solid.clone();
            let (hit, step) = tear(&mut solid, &body, false);
            if bodies.is_empty() {
                check_tear(&before, &solid, &body, hit, &step)?;
            }
            prop_assert_eq!(solid.mesh.validate(), Ok(()));
            prop_assert!((before.area() - solid.area() - step.area_removed).abs() < 1e-9);
            bodies.push(body);
        }
        for h in solid.open_half_edges() {
            let v = solid.mesh.from(h);
            prop_assert!(bodies.iter().any(|b| b.depth(solid.at(v)).abs() < 1e-9));
        }
    }

    #[test]
    fn degenerate_tears_hold(boxes in prop::collection::vec(grid_box(3), 1..4)) {
        let mut solid = Solid::cube(3);
        for (i, body) in boxes.iter().enumerate() {
            let before = solid.clone();
            let (hit, step) = tear(&mut solid, body, false);
            if i == 0 {
                check_tear(&before, &solid, body, hit, &step)?;
            }
            prop_assert_eq!(solid.mesh.validate(), Ok(()));
            prop_assert!((before.area() - solid.area() - step.area_removed).abs() < 1e-9);
            prop_assert!(solid.positions.iter().all(|p| p.is_finite()));
        }
    }

    #[test]
    fn cuts_open_a_closed_surface_along_the_plane_only(normal in prop::array::uniform3(-2i32..3), offset in -4i32..20, fine in any::<bool>(), tilt in -0.3f64..0.3) {
        prop_assume!(normal != [0; 3]);
        let mut solid = if fine { Solid::sphere(3.0, 3) } else { Solid::cube(3) };
        let mut normal = DVec3::from_array(normal.map(f64::from));
        if fine { normal.x += tilt; }
        prop_assume!(normal.length() > 0.1);
        let plane = Plane::Equation { normal, offset: f64::from(offset) * 0.5 };
        let before = solid.clone();
        let outcome = plane_cut(&mut solid.mesh, &plane, |v| before.at(v), &mut PlaneCutScratch::default());
        append(&mut solid, &outcome.new_vertices);
        prop_assert_eq!(solid.mesh.validate(), Ok(()));
        prop_assert!((solid.area() - before.area()).abs() < 1e-9 * before.area());
        for n in &outcome.new_vertices { prop_assert!(plane.distance(n.position).abs() < 1e-12); }
        for h in solid.open_half_edges() {
            prop_assert!(plane.distance(solid.at(solid.mesh.from(h))).abs() < 1e-12);
        }
        // every face lies on one side, and no edge joins the sides
        let side = |f: FaceId| solid.mesh.face(f).iter().map(|&v| plane.distance(solid.at(v))).fold(0.0f64, |m, d| if d.abs() > m.abs() { d } else { m });
        for f in solid.mesh.live_faces() {
            for v in solid.mesh.face(f) { prop_assert!(plane.distance(solid.at(v)) * side(f) > -1e-11); }
        }
        let both = solid.mesh.live_faces().any(|f| side(f) > 1e-9) && solid.mesh.live_faces().any(|f| side(f) < -1e-9);
        let across = before.positions.iter().any(|&p| plane.value(p) > 0.0) && before.positions.iter().any(|&p| plane.value(p) < 0.0);
        prop_assert_eq!(outcome.missed(), !across);
        if across { prop_assert!(both && !solid.open_half_edges().is_empty()); }
    }
}

/// The laws above can fail: a surface with one face too few is caught.
#[test]
fn a_broken_tear_is_caught() {
    let before = Solid::sphere(1.0, 2);
    let body = Hexahedron::new(DVec3::X, DMat3::IDENTITY, DVec3::splat(0.3));
    let mut after = before.clone();
    let (hit, step) = tear(&mut after, &body, false);
    assert!(check_tear(&before, &after, &body, hit, &step).is_ok());
    let away = after.mesh.live_faces().find(|&f| after.mesh.face(f).iter().all(|&v| after.at(v).x < 0.0)).unwrap();
    after.mesh.replace_faces(&[away], &[], |_| 0, &mut Default::default());
    assert!(check_tear(&before, &after, &body, hit, &step).is_err());
}
