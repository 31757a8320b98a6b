//! Lips of slits that bend, and of those without width.

use super::*;
use crate::common::models::{model_of_obj, users_scene_of};
use crate::common::{Solid, border_loops};

/// Edges of the skin between lips on one side of strips from `first` on: by how much more than their length their ends have moved apart.
pub fn strains_along_lips(tissue: &Tissue, first: usize) -> Vec<(VertexId, VertexId, f64)> {
    let (mesh, rest, strips) = (tissue.mesh(), tissue.rest_positions(), &tissue.layer().unwrap().strips);
    let lip_of = |v: VertexId| strips.lip_sides(v).iter().find(|lip| lip.strip as usize >= first).map(|lip| lip.side);
    let moved = |v: VertexId| tissue.position(v) - rest[v.index()];
    let half_edges = mesh.live_faces().flat_map(|f| (0..3).map(move |k| HalfEdge::of(f, k)));
    let of_skin = half_edges.filter(|h| !mesh.is_interior(h.face())).map(|h| [mesh.from(h), mesh.to(h)]);
    let along = of_skin.filter(|&[a, b]| lip_of(a).is_some() && lip_of(a) == lip_of(b));
    let strain = |a: VertexId, b: VertexId| moved(a).distance(moved(b)) / rest[a.index()].distance(rest[b.index()]);
    let strains: Vec<_> = along.map(|[a, b]| (a, b, strain(a, b))).collect();
    assert!(strains.len() > 60, "{}", strains.len());
    strains
}

/// Where a slit bends, the straight way between two places on its outer lip leads through it; the lip is one piece all the same. The outer
/// lips of bends were steps as high as a third of the gap, without width teeth all along.
#[test]
fn lips_of_a_slit_that_bends_are_smooth() {
    let arc = |x: f64| {
        let angle = (x + 0.25) / 0.5 * 5.0;
        0.12 * DVec3::new(angle.cos(), angle.sin(), 0.0)
    };
    let snake = |x: f64| DVec3::new(0.05 * (25.0 * x).sin(), x, 0.0);
    let bow = |x: f64| DVec3::new(0.5 * x * x, x, 0.0);
    for (width, wall) in [(0.0, WallMode::Open), (WIDTH, WallMode::Open), (WIDTH, WallMode::Closed)] {
        for way in [&arc as &dyn Fn(f64) -> DVec3, &snake, &bow] {
            let mut scene = users_scene("sphere", 17_328, 0.3);
            scene.set_wall(wall);
            stroke(&mut scene, width, 0.0, |x| [0.4 * DVec3::Z + way(x), DVec3::Z + 1.3 * way(x)]);
            let strains = strains_along_lips(only(&scene), 0);
            let steps = strains.iter().filter(|(.., strain)| *strain > 0.5).count();
            // without width lips are all along where the bends' tangents are
            let most = if width > 0.0 { 3 } else { strains.len() / 30 };
            assert!(steps <= most, "{width} {wall:?}: {steps} of {}", strains.len());
            let folded = folded_skin(only(&scene));
            assert!(folded < 5e-5, "{width} {wall:?}: {folded} square metres are folded over");
        }
    }
}

/// Area of the skin that is turned over against how it lies at rest, square metres.
pub fn folded_skin(tissue: &Tissue) -> f64 {
    let (mesh, rest) = (tissue.mesh(), tissue.rest_positions());
    let skin = mesh.live_faces().filter(|f| !mesh.is_interior(*f));
    let cross = |[p, q, r]: [DVec3; 3]| (q - p).cross(r - p);
    let areas = skin.map(|f| [mesh.face(f).map(|v| rest[v.index()]), mesh.face(f).map(|v| tissue.position(v))].map(cross));
    areas.filter(|[at_rest, seen]| at_rest.dot(*seen) < 0.0).map(|[_, seen]| 0.5 * seen.length()).sum()
}

/// A slit without width has two lips, and nothing hangs between them: round its border an end lies between a lip and the other. Where skin
/// beside the end of one strip had come over the blade's line, the next one cut a flap from its lip, and a thread was drawn over the slit;
/// and what a particle on the lip had held of the strips before stood in steps; so did lips that lie beyond their strip, which particles on
/// the other lip held. Of these sixteen, ten had threads, and 28 edges were steps.
#[test]
fn a_slit_without_width_has_two_lips() {
    let (mut threads, mut steps) = (0, 0);
    for (faces, poses) in [(768, 60), (768, 45), (4_800, 60), (4_800, 45)] {
        for bend in [0.5, -0.5, 1.0, 0.25] {
            let mut scene = users_scene("sphere", faces, 0.3);
            scene.set_wall(WallMode::Open);
            scene.edit(EditCommand::StrokeBegin { width: 0.0 });
            for k in 0..2 * poses {
                let (y, t) = (0.5 * f64::from(k.min(poses)) / f64::from(poses) - 0.25, f64::from(k) * STEP);
                let way = DVec3::new(bend * y * y, y, 0.0);
                if k <= poses {
                    let [tip, base] = [0.4 * DVec3::Z + way, DVec3::Z + 1.3 * way];
                    scene.edit(EditCommand::StrokePose(BladePose { t, tip, base }));
                }
                if k == poses {
                    scene.edit(EditCommand::StrokeEnd);
                }
                scene.pose(t, 0.0);
                scene.step(STEP);
            }
            assert_eq!(scene.validate(), Ok(()), "{faces} faces, {poses} poses, bend {bend}");
            threads += changes_of_side(only(&scene));
            steps += strains_along_lips(only(&scene), 0).iter().filter(|(.., strain)| *strain > 0.5).count();
        }
    }
    assert!(threads == 0 && steps == 0, "{threads} threads, {steps} steps");
}

/// Where tissue moves, strips part at rest what they did not part as they were cut, by as little as it moved in between. What lies right
/// beside lips goes with them all the same: skin hung over lips in tongues as high as half the gap, and bites were taken out of them.
#[test]
fn a_slit_in_a_beating_heart_has_lips_without_tongues() {
    let mut folded = 0.0;
    for k in 0..8 {
        let (y, lean) = (f64::from(k % 4) * 0.01 - 0.01, f64::from(k) / 7.0 - 0.5);
        let [from, to] = [-1.0, 1.0].map(|end: f64| 0.024 * end * DVec3::new(lean.cos(), lean.sin(), 0.0) + DVec3::Y * y);
        let poses = 30 + 4 * k;
        let mut scene = users_scene("heart", 18_000, 0.5);
        scene.set_animation(Some(0));
        scene.set_wall(WallMode::Open);
        for i in 0..100 {
            let t = 0.06 * f64::from(k) + f64::from(i) / 60.0;
            scene.pose(t, t);
            if i == 0 {
                scene.edit(EditCommand::StrokeBegin { width: 0.0 });
            }
            if i <= poses {
                let at = from.lerp(to, f64::from(i) / f64::from(poses));
                scene.edit(EditCommand::StrokePose(BladePose { t, tip: at + 0.024 * DVec3::Z, base: at + 0.2 * DVec3::Z }));
            }
            if i == poses {
                scene.edit(EditCommand::StrokeEnd);
            }
            scene.step(1.0 / 60.0);
        }
        let tissue = only(&scene);
        assert!(tissue.layer().unwrap().strips.len() > 8 && changes_of_side(tissue) == 0, "stroke {k}");
        folded += folded_skin(tissue);
    }
    assert!(folded < 2e-7, "{folded} square metres are folded over");
}

/// Edges of borders that lead from a lip on one side of a slit to one on the other.
fn changes_of_side(tissue: &Tissue) -> usize {
    let (mesh, strips) = (tissue.mesh(), &tissue.layer().unwrap().strips);
    let half_edges = mesh.live_faces().flat_map(|f| (0..3).map(move |k| HalfEdge::of(f, k)));
    let side = |v: VertexId| strips.lip_sides(v).first().map(|lip| lip.side);
    let of_borders = half_edges.filter(|h| mesh.opposite(*h).is_none()).map(|h| [mesh.from(h), mesh.to(h)].map(side));
    of_borders.filter(|[a, b]| a.is_some() && b.is_some() && a != b).count()
}

/// A plate of 1.2 by 0.9 metres, `thick` along z, of squares.
fn plate(thick: f64) -> Model {
    let (columns, rows) = (72, 54);
    let at = |x: usize, y: usize, z: f64| {
        let share = |k: usize, of: usize| k as f64 / of as f64 - 0.5;
        format!("v {} {} {}\n", 1.2 * share(x, columns), 0.9 * share(y, rows), z)
    };
    let grid = || (0..=rows).flat_map(|y| (0..=columns).map(move |x| (x, y)));
    let skin = |z: f64| grid().map(move |(x, y)| at(x, y, z)).collect::<String>();
    let upper = |x: usize, y: usize| y * (columns + 1) + x + 1;
    let below = (rows + 1) * (columns + 1);
    let mut text = skin(0.5 * thick) + &skin(-0.5 * thick);
    let mut quad = |[a, b, c, d]: [usize; 4]| text += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
    for (x, y) in grid().filter(|&(x, y)| x < columns && y < rows) {
        let corners = [upper(x, y), upper(x + 1, y), upper(x + 1, y + 1), upper(x, y + 1)];
        quad(corners);
        quad([3, 2, 1, 0].map(|k| corners[k] + below));
    }
    let mut side = |a: usize, b: usize| quad([b, a, a + below, b + below]);
    (0..columns).for_each(|x| side(upper(x, 0), upper(x + 1, 0)));
    (0..columns).for_each(|x| side(upper(x + 1, rows), upper(x, rows)));
    (0..rows).for_each(|y| side(upper(0, y + 1), upper(0, y)));
    (0..rows).for_each(|y| side(upper(columns, y), upper(columns, y + 1)));
    model_of_obj(&text)
}

/// A blade through a plate leaves two lips on each side, one above the other, and all four open: wound particles on the one were too near
/// for the other to get any. The plate is thinner than they are apart, or thicker.
#[test]
fn both_skins_of_a_plate_open() {
    for thick in [0.003, 0.01, 0.06] {
        let model = plate(thick);
        assert_eq!(model.mesh.live_faces().count(), 4 * 72 * 54 + 4 * (72 + 54));
        let mut scene = users_scene_of(model, 0.3);
        stroke(&mut scene, 0.002, 0.0, |x| [DVec3::new(x, 0.004, -0.1), DVec3::new(x, 0.004, 0.5)]);
        let tissue = only(&scene);
        let rest = tissue.rest_positions();
        let open = |v: VertexId| (tissue.position(v) - rest[v.index()]).y;
        let lips = |above: bool, beyond: bool, from: f64, to: f64| {
            let is_one = |v: &VertexId| {
                let p = rest[v.index()];
                (p.z > 0.0) == above && (p.y > 0.004) == beyond && (p.y - 0.004).abs() < 0.0011 && (from..to).contains(&p.x)
            };
            let opened: Vec<f64> = tissue.mesh().live_vertices().filter(is_one).map(open).collect();
            assert!(!opened.is_empty(), "{thick} {above} {beyond} {from}");
            opened.iter().sum::<f64>() / opened.len() as f64
        };
        for beyond in [false, true] {
            for k in -4..4 {
                let (from, to) = (0.05 * f64::from(k), 0.05 * f64::from(k + 1));
                let [upper, lower] = [true, false].map(|above| lips(above, beyond, from, to));
                let (sum, off) = (upper + lower, (upper - lower).abs());
                assert!(off < 0.2 * sum.abs() && (sum > 0.0) == beyond && sum.abs() > 0.01, "{thick} {from}: {upper} {lower}");
            }
        }
    }
}

/// A slit along edges of the model, or beside them by less than its own wound stirs the skin as it opens, is one opening from end to end.
/// Beside an edge the cut left slivers that folded over, and of these strokes every third left bands of skin from lip to lip.
#[test]
fn a_slit_along_edges_is_one_opening() {
    let cube = Solid::cube(16);
    let place = |v: usize| (cube.positions[v] / 16.0 - 0.5) * 0.2;
    let corners = (0..cube.positions.len()).map(|v| place(v).to_array().map(|x| x.to_string()).join(" "));
    let faces = cube.mesh.live_faces().map(|f| cube.mesh.face(f).map(|v| (v.index() + 1).to_string()).join(" "));
    let obj: String = corners.map(|p| format!("v {p}\n")).chain(faces.map(|f| format!("f {f}\n"))).collect();
    let model = model_of_obj(&obj);
    let mut strokes = 0;
    for (off, frames) in [0.0, 1e-6, 1e-5, 3e-5].into_iter().flat_map(|off| [18, 31, 45, 90].map(|frames| (off, frames))) {
        for [from, to] in [[-1.0, 1.0], [1.0, -1.0]] {
            for along in [DVec3::X, DVec3::Y] {
                let mut scene = users_scene_of(model.clone(), 0.5);
                let aside = off * DVec3::Z.cross(along);
                scene.edit(EditCommand::StrokeBegin { width: 0.0 });
                for k in 0..=frames {
                    let (t, way) = (f64::from(k) * STEP, f64::from(k) / f64::from(frames));
                    let tip = 0.07 * (from + (to - from) * way) * along + aside + 0.07 * DVec3::Z;
                    scene.edit(EditCommand::StrokePose(BladePose { t, tip, base: tip + 0.23 * DVec3::Z }));
                    scene.pose(t, 0.0);
                    scene.step(STEP);
                }
                assert_eq!(scene.edit(EditCommand::StrokeEnd)[0].outcome.as_str(), "torn");
                let tissue = only(&scene);
                assert_eq!(
                    border_loops(tissue.mesh()),
                    1,
                    "{off} m beside the edges in {frames} frames along {along}, from {from}"
                );
                assert_eq!(changes_of_side(tissue), 0, "{off} m beside the edges in {frames} frames along {along}, from {from}");
                strokes += 1;
            }
        }
    }
    assert_eq!(strokes, 64);
}
