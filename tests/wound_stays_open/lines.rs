//! A wound that is cut in several strokes is one wound.

use super::*;

/// How far lips stand open on both sides of the line of a wound over the front of a sphere, by place, metres: the mean of each eighth of its
/// length, of what several strokes have cut from place to place along x.
fn opened(width: f64, strokes: &[[f64; 2]]) -> Vec<[f64; 2]> {
    const Y: f64 = 0.004;
    let mut scene = users_scene("sphere", 17_328, 0.3);
    for (k, [from, to]) in strokes.iter().enumerate() {
        let blade = |x: f64| {
            let x = from + (to - from) * (x + 0.25) / 0.5;
            [DVec3::new(x, Y, 0.4), DVec3::new(1.3 * x, Y, 1.0)]
        };
        stroke(&mut scene, width, 2.0 * k as f64, blade);
    }
    assert_eq!(scene.validate(), Ok(()));
    let tissue = only(&scene);
    let strips = &tissue.layer().unwrap().strips;
    let ends = strokes.iter().flatten();
    let [low, high] = [ends.clone().copied().fold(f64::MAX, f64::min), ends.copied().fold(f64::MIN, f64::max)];
    let part = |k: usize| low + (high - low) * k as f64 / 8.0;
    let mean = |k: usize, side: f64| {
        let is_one = |v: &VertexId| {
            let p = tissue.rest_positions()[v.index()];
            !strips.lip_sides(*v).is_empty() && p.z > 0.3 && (part(k)..part(k + 1)).contains(&p.x) && (p.y - Y) * side > -1e-9
        };
        let moved = |v: VertexId| side * (tissue.position(v) - tissue.rest_positions()[v.index()]).y;
        let lips: Vec<f64> = tissue.mesh().live_vertices().filter(is_one).map(moved).filter(|y| *y > -1e-3).collect();
        assert!(!lips.is_empty(), "{width} {strokes:?}: no lip in part {k}");
        lips.iter().sum::<f64>() / lips.len() as f64
    };
    (0..8).map(|k| [mean(k, -1.0), mean(k, 1.0)]).collect()
}

/// Lengthened at its end, from where it began, or cut back over and beyond, a wound opens as if it had been cut at once. Each stroke had a
/// lens of its own: the pins of the older one's end held the wound shut in its middle.
#[test]
fn a_wound_that_is_lengthened_has_no_waist() {
    let whole = opened(0.002, &[[-0.25, 0.25]]);
    let widest = whole.iter().flatten().copied().fold(0.0, f64::max);
    for strokes in
        [[[-0.25, 0.0], [0.0, 0.25]], [[0.0, 0.25], [0.0, -0.25]], [[-0.1, 0.25], [0.25, -0.25]], [[-0.25, 0.1], [0.0, 0.25]]]
    {
        let parts = opened(0.002, &strokes);
        for (k, (a, b)) in whole.iter().flatten().zip(parts.iter().flatten()).enumerate() {
            assert!((a - b).abs() < 0.15 * widest, "{strokes:?}, part {}: {b} where {a} of {widest}", k / 2);
        }
    }
    // the control: one that is not of the same line stands open by itself
    let apart = opened(0.002, &[[-0.25, -0.05], [0.05, 0.25]]);
    assert!(apart[1][0].min(apart[6][0]) > 0.2 * widest, "{apart:?}");
}
