//! The tip of a cone. A blade that turns about a point of its own and goes round an axis at the same time sweeps a cone, and boxes that
//! share a joint cannot reach its tip: nearer than half the width times the slope the inner lip would run backwards. So the lane keeps
//! off the tip by that much, its inset, and what it leaves there is cut by boxes of their own, short and perpendicular at both ends.
//! They need not be as many as the lane's: a new one comes when the blade has gone a quarter of the width.

use super::boxes::{Grid, TearSegment};
use super::lane::{Blade, Maker, Part, PendingQuad, direction};

/// By how much a lane keeps off more than it has to.
const SPARE: f64 = 1.5;
/// The inset is no more than this share of the blade's part: else it is no cone's tip that is in the way.
const MOST_INSET: f64 = 0.5;
/// Boxes of the tip reach so far into those of the lane, in widths.
const OVERLAP: f64 = 0.5;
/// Their width, as a share of the lane's: sides that lie in those of the lane's boxes would leave films.
const NARROWER: f64 = 0.9375;
/// How far the blade goes, where tip and lane meet, from one box of the tip to the next, in widths.
const TRAVEL: f64 = 0.25;

/// How far a lane keeps off its pivot, and the blade where the next box of the tip starts.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Hub {
    /// Metres along the blade.
    pub(super) inset: f64,
    start: Option<Blade>,
    /// A box of the tip has ended there.
    goes_on: bool,
}

impl Part {
    /// Without so many metres at the ends that are not tip or top.
    pub(super) fn inset(self, by: f64) -> Self {
        Self { low: if self.low > 0.0 { self.low + by } else { 0.0 }, high: self.high - by }
    }

    /// 0 for what ends at a pivot, 1 for what begins there.
    fn side(self) -> usize {
        usize::from(self.low > 0.0)
    }

    /// What [`Part::inset`] leaves out, and so many metres more; `None` where neither end or both are a pivot's.
    fn tip(self, by: f64) -> Option<Self> {
        match (self.low > 0.0, self.high.is_finite()) {
            (true, false) => Some(Self { high: self.low + by, ..self }),
            (false, true) => Some(Self { low: (self.high - by).max(0.0), ..self }),
            _ => None,
        }
    }
}

/// The farthest that a lane keeps off a tip on this part of a blade, metres.
fn most_inset(blade: &Blade, part: Part) -> f64 {
    MOST_INSET * (part.high.min(blade.length()) - part.low)
}

impl Hub {
    /// For a lane that starts anew at `blade`, of which `part` is its own. `turns` are those of the blade and of the way across it in
    /// the box that was not valid, as lengths of the differences of unit vectors.
    pub(super) fn begin(&mut self, blade: &Blade, part: Part, [up, across]: [f64; 2], maker: &mut Maker) {
        let least = SPARE * 0.5 * maker.width * across / up;
        if !maker.slit && least <= most_inset(blade, part) {
            self.inset = self.inset.max(least);
            maker.insets[part.side()] = self.inset;
        }
        self.start = None;
        self.go_on_from(blade, part, maker);
    }

    /// For a new lane at `blade`: it keeps off the tip as the one before it on this side of the pivot did.
    pub(super) fn again(blade: &Blade, part: Part, maker: &mut Maker) -> Self {
        let inset = if part == Part::WHOLE { 0.0 } else { maker.insets[part.side()] };
        let mut hub = Self { inset: if inset <= most_inset(blade, part) { inset } else { 0.0 }, start: None, goes_on: false };
        hub.go_on_from(blade, part, maker);
        hub
    }

    /// The next box of the tip starts at `blade`.
    pub(super) fn go_on_from(&mut self, blade: &Blade, part: Part, maker: &mut Maker) {
        if self.inset > 0.0 {
            self.start = part.tip(self.inset + OVERLAP * maker.width).map(|tip| maker.part(blade, tip));
            self.goes_on = false;
        }
    }

    /// The blade has come to `end`, whose part is the lane's: a box, if it is time for one or the lane ends here.
    pub(super) fn step(&mut self, end: &Blade, part: Part, is_last: bool, maker: &mut Maker, out: &mut Vec<TearSegment>) {
        let Some((start, tip)) = self.start.zip(part.tip(self.inset + OVERLAP * maker.width)) else { return };
        let here = maker.part(end, tip);
        let way = (here.tip - start.tip).length().max((here.top - start.top).length());
        if is_last || way >= TRAVEL * maker.width {
            let start = if self.goes_on { maker.drawn_back(&start, direction(&start, &here, &start)) } else { start };
            maker.push_alone([&start, &here], NARROWER, out);
            (self.start, self.goes_on) = (Some(here), true);
        }
    }

    pub(super) fn settle(&mut self, grid: Grid) {
        self.start.iter_mut().for_each(|blade| blade.settle(grid));
    }

    pub(super) fn start_quad_mut(&mut self) -> Option<PendingQuad<'_>> {
        self.start.as_mut().map(Blade::pending)
    }

    /// True while boxes of the tip are to come.
    pub(super) fn is_open(&self) -> bool {
        self.start.is_some()
    }
}
