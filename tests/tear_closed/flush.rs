//! Blades, boxes and faces of the model that lie in the same planes, to the bit: everything is on one grid. What is left is held
//! against sums over the cells of that grid.

use super::*;
use std::collections::BTreeMap;

/// Unit cubes joined face to face: their surface as a tissue.
fn block(cells: &[[i32; 3]]) -> Scene {
    let mut ids = BTreeMap::new();
    let (mut text, mut faces) = (String::new(), String::new());
    for &cell in cells {
        for axis in 0..3 {
            for side in [0, 1] {
                let mut beyond = cell;
                beyond[axis] += 2 * side - 1;
                if cells.contains(&beyond) {
                    continue;
                }
                let corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[u, v]| {
                    let mut p = cell;
                    p[axis] += side;
                    p[(axis + 1) % 3] += if side == 1 { u } else { v };
                    p[(axis + 2) % 3] += if side == 1 { v } else { u };
                    let next = ids.len() + 1;
                    *ids.entry(p).or_insert_with(|| {
                        text += &format!("v {} {} {}\n", p[0], p[1], p[2]);
                        next
                    })
                });
                faces +=
                    &format!("f {} {} {}\nf {} {} {}\n", corners[0], corners[1], corners[2], corners[0], corners[2], corners[3]);
            }
        }
    }
    still(model_of_obj(&(text + &faces))).0
}

/// A base of three by two cells, and a tooth on either end of it.
fn comb() -> Vec<[i32; 3]> {
    let base = (0..3).flat_map(|x| (0..2).map(move |z| [x, 0, z]));
    base.chain([[0, 1, 0], [2, 1, 0], [2, 1, 1]]).collect()
}

/// Volume of what is left of `cells` without the boxes, all of them along the axes: the sum over the cells of the finest grid.
fn left(cells: &[[i32; 3]], boxes: &[[DVec3; 2]]) -> f64 {
    let mut ticks: [Vec<f64>; 3] = Default::default();
    for (axis, ticks) in ticks.iter_mut().enumerate() {
        ticks.extend(boxes.iter().flat_map(|b| b.map(|p| p[axis])).chain((-1..5).map(f64::from)));
        ticks.sort_by(f64::total_cmp);
        ticks.dedup();
    }
    let mut sum = 0.0;
    for x in ticks[0].windows(2) {
        for y in ticks[1].windows(2) {
            for z in ticks[2].windows(2) {
                let (low, high) = (DVec3::new(x[0], y[0], z[0]), DVec3::new(x[1], y[1], z[1]));
                let middle = (low + high) / 2.0;
                let cell = middle.floor().as_ivec3().to_array();
                let is_torn = |b: &[DVec3; 2]| b[0].cmple(middle).all() && middle.cmple(b[1]).all();
                if cells.contains(&cell) && !boxes.iter().any(is_torn) {
                    sum += (high - low).element_product();
                }
            }
        }
    }
    sum
}

pub fn volume_of(tissue: &Tissue) -> f64 {
    let mesh = tissue.mesh();
    let positions: Vec<DVec3> = (0..mesh.vertex_slots()).map(|v| tissue.position(VertexId::new(v))).collect();
    volume(&positions, &mesh.live_faces().map(|f| mesh.face(f).map(|v| v.0)).collect::<Vec<_>>())
}

/// A straight stroke on the grid: where the blade's tip starts, the axes along it and along the way (signs), steps, samples, width.
type Straight = ([i32; 3], (usize, usize), (bool, bool), u8, u8, u8);

const STEP: f64 = 0.25;

fn any_stroke() -> impl Strategy<Value = Straight> {
    let axes = (0usize..3, 1usize..3).prop_map(|(up, turn)| (up, (up + turn) % 3));
    ((prop::array::uniform3(-1i32..13)), axes, any::<(bool, bool)>(), 1u8..12, 1u8..4, 0u8..4)
}

fn poses(&(start, (up, way), (down, back), steps, samples, _): &Straight) -> Vec<BladePose> {
    let axis = |k: usize, negative: bool| DVec3::AXES[k] * if negative { -1.0 } else { 1.0 };
    let (up, way) = (axis(up, down) * 8.0, axis(way, back) * f64::from(steps) * STEP);
    let start = DVec3::from_array(start.map(f64::from)) * STEP;
    (0..=samples)
        .map(|k| {
            let u = f64::from(k) / f64::from(samples);
            let tip = start + way * u;
            BladePose { t: 0.2 * f64::from(k), tip, base: tip + up }
        })
        .collect()
}

/// The largest box along the axes in one that is nearly so; the top may lean where the blade enters at different heights.
fn inner(b: &TearBox) -> [DVec3; 2] {
    let middle = b.corners().into_iter().sum::<DVec3>() / 8.0;
    let mut inner = b.bounds();
    for p in b.corners() {
        for axis in 0..3 {
            if p[axis] < middle[axis] {
                inner[0][axis] = inner[0][axis].max(p[axis]);
            } else {
                inner[1][axis] = inner[1][axis].min(p[axis]);
            }
        }
    }
    inner
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn a_stroke_on_the_models_own_grid_takes_out_its_boxes(one in any_stroke()) {
        let cells = comb();
        let mut scene = block(&cells);
        let report = stroke(&mut scene, [0.05, 0.25, 0.5, 1.0][one.5 as usize], &poses(&one));
        for (_, tissue) in scene.tissues() {
            prop_assert_eq!(tissue.validate(), Ok(()));
            prop_assert_eq!(double_edges(tissue), 0);
        }
        let torn = if report.outcome == Outcome::Missed { &[] } else { scene.last_tear_boxes() };
        prop_assert!(torn.is_empty() || report.pieces.iter().all(|p| p.closed), "{:?}", report.pieces);
        let [most, least] = [inner, TearBox::bounds].map(|b| left(&cells, &torn.iter().map(b).collect::<Vec<_>>()));
        let found: f64 = scene.tissues().map(|(_, t)| volume_of(t)).sum();
        let whole = cells.len() as f64;
        let slack = (1e-6 * whole).min(1e-3 * (whole - least) + 2e-7 * whole);
        prop_assert!(
            least - slack <= found && found <= most + slack,
            "{found}, {:e} under {most}, {:e} over {least}",
            most - found,
            found - least
        );
    }
}

/// An end of each kind in a face: the tip in the top of a tooth, the blade in the side that it leaves through, sides of the box
/// in both sides of the tooth.
#[test]
fn a_blade_flush_with_faces_leaves_no_film_and_no_shell() {
    let cells = [[0, 0, 0], [1, 0, 0], [0, 1, 0]];
    let through = |tip: [f64; 3], way: DVec3, width: f64| {
        let mut scene = block(&cells);
        let poses = [0.0, 0.5, 1.0].map(|u| {
            let tip = DVec3::from_array(tip) + way * u;
            BladePose { t: u, tip, base: tip + DVec3::Y * 4.0 }
        });
        let report = stroke(&mut scene, width, &poses);
        (report.outcome, report.pieces.iter().map(|p| p.volume).sum::<f64>(), report.pieces.len())
    };
    // the tooth is cut off where it stands: a groove whose floor is flush with the top of the base, as wide as the tooth
    let (outcome, volume, pieces) = through([0.5, 1.0, -0.5], DVec3::Z * 2.0, 1.0);
    assert_ne!(outcome, Outcome::Missed);
    assert!((volume - 2.0).abs() < 1e-6 && pieces == 1, "{volume} in {pieces}");
    // right down to the bottom: two pieces
    let (outcome, volume, pieces) = through([1.5, 0.0, -0.5], DVec3::Z * 2.0, 0.5);
    assert_eq!((outcome, pieces), (Outcome::Severed, 2));
    assert!((volume - 2.5).abs() < 1e-6, "{volume}");
    // on top of the base and no deeper: nothing is there
    let (outcome, ..) = through([1.5, 1.0, 0.25], DVec3::Z * 0.5, 0.25);
    assert_eq!(outcome, Outcome::Missed);
}

/// The reference sees a box that is left out, and one that is moved.
#[test]
fn the_sum_over_cells_tells_boxes_apart() {
    let cells = comb();
    let whole = cells.len() as f64;
    let torn = [DVec3::new(0.25, 0.5, -1.0), DVec3::new(0.5, 4.0, 1.0)];
    assert_eq!(left(&cells, &[]), whole);
    assert_eq!(left(&cells, &[torn]), whole - 0.25 * 1.5);
    assert_eq!(left(&cells, &[torn, torn]), whole - 0.25 * 1.5);
    assert_eq!(left(&cells, &[torn.map(|p| p + DVec3::X * 0.75)]), whole - 0.25 * 0.5);
}
