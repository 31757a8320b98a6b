//! Samples in, boxes out (MATHS 5.2 to 5.5): joints, validity, dropped samples, chains, pivots.
//!
//! A joint needs the sample after it, so a box is committed when the sample after its end arrives, or on release. What
//! is pending moves with the tissue ([`ChainBuilder::pending_quads_mut`]). Nothing here knows the clock or how samples
//! were batched: the same samples give the same bits.
//!
//! As a rule there is one lane, the whole blade. Where the blade turns about a point of its own there are two, below and above
//! it, which stop a little short of it; or one, where the point is at an end.

use super::blade_path::{BladePose, Sampling};
use super::boxes::{ChainStart, JointId, TearSegment};
pub use super::lane::PendingQuad;
use super::lane::{Blade, Lane, Maker, Part, ways};
use super::path_sampler::{ClippedSample, SampleKind};
use super::pivot::parts;
use glam::DVec3;

/// How far, as a share of the blade, the pivot may go from one sample to the next for the lanes to go on: so much of the blade is not
/// in either where it turns.
const MOST_DRIFT: f64 = 5e-2;

/// Builds the chains of one stroke.
#[derive(Clone, Debug)]
pub struct ChainBuilder {
    maker: Maker,
    /// The newest sample.
    last: Option<Blade>,
    /// What is cut on the way to it, from the tip up: none, one, or two at a pivot.
    lanes: Vec<Lane>,
    /// Those of the sample before, while it is looked at which of them go on.
    before: Vec<Lane>,
    /// Where lanes have ended at it.
    ends: Vec<End>,
    outside: Option<BladePose>,
    /// The newest sample is the first outside, and the chains are yet to end there.
    is_leaving: bool,
}

/// Where a lane has ended.
#[derive(Clone, Debug)]
struct End {
    joint: JointId,
    /// What it was of the blade there.
    part: Part,
    /// The ways that its lower and its upper end came, across the blade.
    ways: [DVec3; 2],
}

/// Lanes of a stroke that there is room for at first.
const LANES: usize = 4;

/// Shares of the way from a blade outside to the next, inside, that the one outside is drawn back by.
const DRAWN_BACK: [f64; 5] = [0.0, 0.1, 0.25, 0.5, 1.0];

impl ChainBuilder {
    /// A builder for one stroke of `width` metres (0: a slit; negative or NaN counts as 0, callers refuse it earlier).
    pub fn new(width: f64, sampling: &Sampling) -> Self {
        let maker = Maker::new(width, sampling);
        Self { maker, last: None, lanes: Vec::new(), before: Vec::new(), ends: Vec::new(), outside: None, is_leaving: false }
    }

    /// Makes room for a usual stroke.
    pub fn make_room(&mut self) {
        self.lanes.reserve(LANES);
        self.before.reserve(LANES);
        self.ends.reserve(LANES);
        self.maker.make_room(LANES);
    }

    /// A builder for another stroke in the buffers of one that is over.
    pub fn again(mut self, width: f64, sampling: &Sampling) -> Self {
        self.lanes.clear();
        let new = Self::new(width, sampling);
        Self { maker: new.maker.with_rooms_of(self.maker), lanes: self.lanes, before: self.before, ends: self.ends, ..new }
    }

    /// Boxes that come are of `width` metres; slits stay slits.
    pub fn set_width(&mut self, width: f64, sampling: &Sampling) {
        self.maker.set_width(width, sampling);
    }

    /// Stretches that no valid box could be made for, so far.
    pub fn skipped(&self) -> u32 {
        self.maker.skipped
    }

    /// The quads that the next boxes may be built from: the joints where the last boxes ended, and the sample after them (a
    /// degenerate quad tip, tip, top, top). Re-pose the corners with the tissue before the next push (MATHS 5.5): they are brought back into a plane then, and stay as they are, bit for bit, if
    /// none was moved. The list changes with every push.
    pub fn pending_quads_mut(&mut self) -> impl Iterator<Item = PendingQuad<'_>> {
        let last = self.last.as_mut().map(Blade::pending);
        self.lanes.iter_mut().flat_map(Lane::start_quads_mut).chain(last)
    }

    /// The joints at which the last boxes ended, while their chains may still go on from them (their end walls are provisional):
    /// two at a pivot.
    pub fn open_joints(&self) -> impl Iterator<Item = JointId> {
        self.lanes.iter().filter_map(Lane::joint)
    }

    /// The chains that may still go on.
    pub fn open_chains(&self) -> impl Iterator<Item = u32> {
        self.lanes.iter().filter_map(Lane::chain)
    }

    /// True while one chain is cut and nothing beside it.
    pub fn is_alone(&self) -> bool {
        self.lanes.iter().map(|lane| usize::from(lane.chain().is_some()) + usize::from(lane.has_hub())).sum::<usize>() <= 1
    }

    /// Lifts the top of the newest pending sample by `amount` metres in all, as far as the blade goes.
    pub fn raise_last(&mut self, amount: f64) {
        if let Some(last) = &mut self.last {
            // where the tissue has carried it
            last.settle(self.maker.grid);
            last.raise(amount, self.maker.grid);
        }
    }

    /// Draws the last blade outside back from the next, inside, as far as it takes to be outside still: skin may have come over it since.
    pub fn keep_outside(&mut self, inside: &BladePose, is_outside: impl Fn(&BladePose) -> bool) {
        let Some(outside) = &mut self.outside else { return };
        let back = |share: f64| {
            let [tip, base] =
                [(outside.tip, inside.tip), (outside.base, inside.base)].map(|(from, to)| from + (from - to) * share);
            BladePose { tip, base, ..*outside }
        };
        if let Some(drawn) = DRAWN_BACK.into_iter().map(back).find(is_outside) {
            *outside = drawn;
        }
    }

    /// Takes the next sample and appends the segments that it completes: usually one, none at a chain's start, several
    /// at a pivot. Where the blade leaves, the last segment comes with the next sample or with [`ChainBuilder::close_left`].
    pub fn push(&mut self, sample: &ClippedSample, out: &mut Vec<TearSegment>) {
        self.close_left(out);
        self.settle();
        let blade = self.blade(sample);
        match (sample.kind, blade) {
            (SampleKind::Move, Some(blade)) => {
                if let (None, Some(before)) = (self.last, self.outside)
                    && let Some(before) = self.extended(&before, &blade)
                {
                    // The rim between the last blade outside and this one is cut too.
                    self.accept(before, out);
                }
                self.accept(blade, out);
            }
            (SampleKind::Move, None) => {
                if let Some(last) = self.last
                    && let Some(blade) = self.extended(&sample.pose, &last)
                {
                    self.accept(blade, out);
                    self.is_leaving = true;
                } else {
                    self.release(out);
                }
            }
            (SampleKind::Axial, Some(blade)) => self.deepen(blade),
            (SampleKind::End, Some(blade)) => self.end_at(blade, out),
            (SampleKind::Axial | SampleKind::End, None) => self.release(out),
        }
        self.outside = blade.is_none().then_some(sample.pose);
    }

    /// Ends the chains of a blade that has left, where it left, and appends their last segments. A caller that edits live does so when
    /// the next pose comes: two segments in one frame are a hitch.
    pub fn close_left(&mut self, out: &mut Vec<TearSegment>) {
        if self.is_leaving {
            let outside = self.outside;
            self.release(out);
            self.outside = outside;
        }
    }

    /// Ends the stroke where the blade is (perpendicular end) and appends what was pending. The builder can go on with
    /// a new chain.
    pub fn release(&mut self, out: &mut Vec<TearSegment>) {
        self.settle();
        if let Some(last) = self.last.take() {
            for lane in self.lanes.drain(..) {
                lane.close(&last, &mut self.maker, out);
            }
        }
        (self.outside, self.is_leaving) = (None, false);
    }

    fn settle(&mut self) {
        let grid = self.maker.grid;
        self.lanes.iter_mut().for_each(|lane| lane.settle(grid));
        self.last.iter_mut().for_each(|blade| blade.settle(grid));
    }

    fn blade(&mut self, sample: &ClippedSample) -> Option<Blade> {
        let top = sample.top?;
        let mut blade = self.blade_of(sample.pose.tip, top, (sample.pose.base - top).length())?;
        blade.raise(sample.raise, self.maker.grid);
        Some(blade)
    }

    fn blade_of(&mut self, tip: DVec3, top: DVec3, spare: f64) -> Option<Blade> {
        let Maker { grid, next_serial, .. } = &mut self.maker;
        let (tip, top) = (grid.snap(tip), grid.snap(top));
        let long_enough = (top - tip).length() > 1024.0 * grid.step;
        let serial = *next_serial;
        *next_serial += u32::from(long_enough);
        long_enough.then_some(Blade { serial, tip, top, spare, raised: 0.0, deepened: 0.0, quad: [tip, tip, top, top] })
    }

    /// A blade outside the tissue, clipped to the length of its neighbour inside.
    fn extended(&mut self, outside: &BladePose, inside: &Blade) -> Option<Blade> {
        let length = inside.length().min((outside.base - outside.tip).length());
        self.blade_of(outside.tip, outside.tip + outside.up() * length, 0.0)
    }

    /// Motion along the axis: the newest sample reaches down to the new tip, or the stroke starts here.
    fn deepen(&mut self, blade: Blade) {
        let Some(last) = &mut self.last else {
            self.last = Some(blade);
            return;
        };
        let down = -last.up();
        let deeper = (blade.tip - last.tip).dot(down);
        if deeper > 0.0 {
            last.tip = self.maker.grid.snap(last.tip + down * deeper);
            last.deepened += deeper;
            last.reset_quad();
            self.lanes.iter_mut().for_each(|lane| lane.part = lane.part.lowered(deeper));
        }
    }

    /// The path's last pose, close to the newest sample: it takes that one's place, at the greater depth.
    fn end_at(&mut self, mut blade: Blade, out: &mut Vec<TearSegment>) {
        let Some(last) = self.last.as_mut().filter(|_| !self.lanes.is_empty()) else {
            self.accept(blade, out);
            return;
        };
        let up = blade.up();
        let withdrawn = (last.tip - blade.tip).dot(-up).clamp(0.0, last.deepened);
        blade.tip = self.maker.grid.snap(blade.tip - up * withdrawn);
        blade.reset_quad();
        let deeper = (last.tip - blade.tip).dot(up);
        *last = blade;
        self.lanes.iter_mut().for_each(|lane| lane.part = lane.part.lowered(deeper));
    }

    /// Lanes go on, end and begin at the newest sample as the way from it to `next` asks; that is the newest then.
    fn accept(&mut self, next: Blade, out: &mut Vec<TearSegment>) {
        let Some(last) = self.last.replace(next) else { return };
        let Self { maker, lanes, before, ends, .. } = self;
        let (wanted, count) = parts(&last, &next, maker.grid);
        let wanted = &wanted[..count];
        let reach = MOST_DRIFT * last.length();
        let goes_on = |lane: &Lane, on: &[Part; 2]| lane.part.is_near(on[0], last.length(), reach);
        let is_new = lanes.is_empty();
        ends.clear();
        for lane in lanes.extract_if(.., |lane| !wanted.iter().any(|on| goes_on(lane, on))) {
            let part = lane.part;
            let ways = lane.ways_to(&maker.part(&last, part));
            ends.extend(lane.close(&last, maker, out).map(|joint| End { joint, part, ways }));
        }
        std::mem::swap(lanes, before);
        for &on in wanted {
            match before.iter().position(|lane| goes_on(lane, &on)) {
                Some(i) => {
                    let mut lane = before.swap_remove(i);
                    lane.step(&last, &next, on, maker, out);
                    lanes.push(lane);
                }
                None => {
                    let ways = ways(&maker.part(&last, on[0]), &maker.part(&next, on[1]), &last);
                    let from = goes_on_from(ends, on[0], ways, last.length());
                    let after = (!is_new).then_some(from);
                    lanes.push(Lane::new(&last, on, after, maker));
                }
            }
        }
        before.clear();
    }
}

/// What a chain goes on from that begins with this part of a blade so many metres long, where others have come to an end. Ways are compared
/// where both have a piece of the blade: at the top if they have that, as it is what is there that cuts the wound in the skin that the blade
/// enters by.
fn goes_on_from(ends: &[End], on: Part, ways: [DVec3; 2], length: f64) -> ChainStart {
    let is_upper = |part: Part| part.high == f64::INFINITY;
    let shared = |e: &End| e.part.shared(on, length);
    let end = match ends.iter().find(|e| is_upper(on) && is_upper(e.part)) {
        Some(end) if end.ways[1].dot(ways[1]) < 0.0 => return ChainStart::Hairpin,
        Some(end) => Some(end),
        None => {
            let same_way = |e: &&End| (e.ways[0] + e.ways[1]).dot(ways[0] + ways[1]) > 0.0;
            let meets = ends.iter().filter(|e| shared(e) > 0.0).filter(same_way);
            meets.max_by(|a, b| shared(a).total_cmp(&shared(b)))
        }
    };
    end.map_or(ChainStart::Free, |end| ChainStart::Box(end.joint))
}
