//! Where a blade turns about a point of its own: what is below that and what is above go in opposite directions (MATHS 5.3).

use super::boxes::Grid;
use super::lane::{Blade, Part};
use super::path_sampler::reject;
use glam::DVec3;

/// Below this share of the faster end's travel, the slower end of the blade counts as a pivot.
const PIVOT_SHARE: f64 = 1e-6;
/// How far from the pivot the parts of the blade stop, as a share of it: boxes of a fan would share an edge there, and a valid box
/// has its ends strictly apart.
const PIVOT_GAP: f64 = 2e-3;
/// The least part of the blade that is a lane, as a share of it.
const LEAST_PART: f64 = 1e-2;

/// What goes its way from `first` to `next` without turning back, as parts of either: the whole blade, or where tip and top move in
/// opposite directions what is below the pivot and what is above. Gives how many there are, too.
pub(super) fn parts(first: &Blade, next: &Blade, grid: Grid) -> ([[Part; 2]; 2], usize) {
    let pivots =
        turned_share(first, next, first.up(), grid).filter(|p| p.is_pivot).zip(turned_share(first, next, next.up(), grid));
    let Some((on_next, on_first)) = pivots else { return ([[Part::WHOLE; 2]; 2], 1) };
    let on = [(first, on_first.share), (next, on_next.share)];
    let below = on.map(|(blade, share)| Part { low: 0.0, high: (share - PIVOT_GAP) * blade.length() });
    let above = on.map(|(blade, share)| Part { low: (share + PIVOT_GAP) * blade.length(), high: f64::INFINITY });
    let is_long = |part: &[Part; 2]| {
        part.iter().zip(on).all(|(p, (blade, _))| p.high.min(blade.length()) - p.low >= LEAST_PART * blade.length())
    };
    match [below, above].map(|part| is_long(&part)) {
        [true, true] => ([below, above], 2),
        [false, true] => ([above; 2], 1),
        [is_below, _] => ([below; 2], usize::from(is_below)),
    }
}

/// Where the way between two blades, seen across one of them, has no part in the direction of the end that goes farther.
struct Turned {
    /// Along the other blade, from tip (0) to top (1).
    share: f64,
    /// It lies on the blade, or so near to its end that this goes nowhere.
    is_pivot: bool,
}

/// Where `next` crosses the line of `first`, if `up` is that of `first`; or where `first` crosses that of `next`.
fn turned_share(first: &Blade, next: &Blade, up: DVec3, grid: Grid) -> Option<Turned> {
    let (tip, top) = (reject(next.tip - first.tip, up), reject(next.top - first.top, up));
    let main = if tip.length_squared() >= top.length_squared() { tip } else { top };
    let scale = main.length_squared();
    if scale.sqrt() <= 1024.0 * grid.step {
        return None;
    }
    let (a, b) = (tip.dot(main) / scale, top.dot(main) / scale);
    Some(Turned { share: (a / (a - b)).clamp(0.0, 1.0), is_pivot: a.min(b) <= PIVOT_SHARE })
}
