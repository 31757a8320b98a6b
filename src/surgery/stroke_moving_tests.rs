//! Strokes through tissue that moves (MATHS 5.5): the way that counts is the one through the tissue. And blades whose pivot moves along
//! them, as tissue that bends makes it do.

use super::*;
use crate::surgery::blade_path::{EntryPoint, SamplingSettings};
use crate::surgery::boxes::{ChainStart, TearBox};

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

/// A blade of 0.2 in the plane z = 0 that rolls over a circle, which it touches with its middle: on each blade the point that it has turned
/// about and the one that it goes on to turn about are apart, and lanes end and begin anew. A box that begins where one ended the same way
/// goes on from it, and reaches so far into it that no film is left between the two.
#[test]
fn boxes_of_one_wound_leave_no_film_where_one_chain_ends_and_another_begins() {
    const WIDTH: f64 = 0.002;
    let deep = |_: DVec3, _: DVec3| Some(EntryPoint { s: 0.0, rise: 0.0 });
    let (mut stroke, mut out) = (Stroke::new(WIDTH, sampling()), Vec::new());
    let mut pose = |k: u32| {
        let t = f64::from(k) / 60.0;
        let (sin, cos) = t.sin_cos();
        let (touched, up) = (0.2 * DVec3::new(-cos, sin, 0.0), 0.2 * DVec3::new(sin, cos, 0.0));
        let tip = touched - 0.5 * up;
        stroke.push(BladePose { t, tip, base: tip + up }, &deep, &mut out);
    };
    (0..=60).for_each(&mut pose);
    stroke.release(&deep, &mut out);
    let boxes: Vec<&TearBox> = out.iter().filter_map(TearSegment::as_box).collect();
    let mut resumed = 0;
    for b in &boxes {
        let ChainStart::Box(joint) = b.from else { continue };
        let before = boxes.iter().find(|other| other.joints[1] == joint).unwrap();
        let normal = |b: &TearBox, end: usize| if end == 0 { -b.planes[0].normal() } else { b.planes[1].normal() };
        assert!(before.chain != b.chain && normal(before, 1).dot(normal(b, 0)) > 0.5);
        // its start is behind the other's end, as far as that reaches along the blade
        let beyond = b.quads[0].map(|corner| before.planes[1].normal().dot(corner - before.quads[1][0]));
        assert!(beyond.iter().all(|d| (-0.2 * WIDTH..0.0).contains(d)), "{beyond:?}");
        resumed += 1;
    }
    assert!(resumed > 3, "{resumed} of {} boxes", boxes.len());
    assert_eq!(boxes[0].from, ChainStart::Free, "a stroke begins where nothing has ended");
}
