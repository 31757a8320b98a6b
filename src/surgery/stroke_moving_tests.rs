//! Strokes through tissue that moves (MATHS 5.5): the way that counts is the one through the tissue.

use super::*;
use crate::surgery::blade_path::{EntryPoint, SamplingSettings};
use crate::surgery::boxes::TearBox;

const STEP: f64 = 1.0 / 60.0;
const SLOPE: f64 = 0.3;

fn sampling() -> Sampling {
    SamplingSettings { distance: 0.01, ..Default::default() }.scaled(1.0)
}

/// Boxes of a blade that goes along x at `speed` (m/s) while a slope goes by along z at another, both for a second; carried to where the
/// slope was at first.
fn boxes(speed: f64, tissue_speed: f64) -> Vec<TearBox> {
    let slope = |tip: DVec3, base: DVec3| {
        let [low, high] = [tip, base].map(|p| p.y - SLOPE * p.x);
        (low < 0.0).then_some(EntryPoint { s: (high / (high - low)).max(0.0), rise: 0.0 })
    };
    let (mut stroke, mut out, mut all) = (Stroke::new(0.002, sampling()), Vec::new(), Vec::new());
    let by = DVec3::Z * tissue_speed * STEP;
    for k in 0..=60 {
        let t = f64::from(k) * STEP;
        if k > 0 {
            stroke.carry([[by; 2]; 2]);
            stroke.builder().pending_quads_mut().for_each(|quad| quad.corners.iter_mut().for_each(|c| *c += by));
        }
        let tip = DVec3::new(speed * t, SLOPE * speed * t - 0.05, 0.0);
        stroke.push(BladePose { t, tip, base: tip + DVec3::Y * 0.2 }, &slope, &mut out);
        if k == 60 {
            stroke.release(&slope, &mut out);
        }
        let back = |p: DVec3| p - DVec3::Z * tissue_speed * t;
        all.extend(out.drain(..).filter_map(|s| s.as_box().cloned()).map(|mut b| {
            b.blades = b.blades.map(|blade| blade.map(back));
            b
        }));
    }
    all
}

#[test]
fn the_cut_is_where_the_blade_went_through_the_tissue() {
    let (speed, tissue_speed) = (0.1, 0.3);
    let boxes = boxes(speed, tissue_speed);
    // three hundredths of a second apart in a tissue that passes thrice as fast as the blade
    assert!((28..=36).contains(&boxes.len()), "{} boxes", boxes.len());
    let off = |p: DVec3| (p.z + tissue_speed / speed * p.x).abs();
    let worst = boxes.iter().flat_map(|b| b.blades).flatten().map(off).fold(0.0, f64::max);
    assert!(worst < 1e-9, "{worst} m off the way");
    let [first, last] = [boxes[0].blades[0][0], boxes.last().unwrap().blades[1][0]];
    assert!(first.x.abs() < 1e-9 && (last.x - speed).abs() < 1e-9, "from {first} to {last}");
}

/// Nobody who holds a blade still means to cut, though the tissue beats against it.
#[test]
fn a_blade_that_stands_in_tissue_that_passes_cuts_nothing() {
    assert!(boxes(0.0, 0.3).is_empty());
}
