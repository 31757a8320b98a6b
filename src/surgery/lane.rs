//! One chain in the making: from its start to the newest sample (MATHS 5.2, 5.3).
//!
//! A lane may be a part of the blade only: while the blade turns about a point of its own, what is below that point and what
//! is above go their ways side by side, each a lane with a chain of its own. Consecutive boxes of a lane share a joint.

use super::blade_path::Sampling;
use super::boxes::{
    ChainStart, Grid, HalfSpace, Hull, JointFrame, JointId, LATERAL_SIDES, PlaneId, Side, Slit, TearBox, TearSegment,
    boxes_apart, hull,
};
use super::hub::Hub;
use super::path_sampler::reject;
use super::pivot::parts;
use glam::DVec3;

/// A turn beyond this ends the chain: 120 degrees.
const SHARPEST_TURN_COSINE: f64 = -0.5;
/// After so many dropped samples in a row the stretch is given up and the chain starts anew.
const MOST_DROPPED: u32 = 8;

/// Boxes that a chain finds room for at once.
const ROOM: usize = 64;

/// How far a chain that begins where another has come to an end reaches back into it, in widths.
const REACH_BACK: f64 = 0.1;

/// How much shorter, as a share of it, the part of a blade beside a pivot is tried where its box is not valid.
const SHORTER: [f64; 2] = [1e-2, 1e-1];

/// A clipped blade that waits for its joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Blade {
    pub(super) serial: u32,
    pub(super) tip: DVec3,
    pub(super) top: DVec3,
    /// What is left of the blade above `top`, metres.
    pub(super) spare: f64,
    pub(super) raised: f64,
    /// How far motion along the axis has lowered the tip, metres.
    pub(super) deepened: f64,
    pub(super) quad: [DVec3; 4],
}

/// A stretch of a blade, metres from its tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Part {
    pub(super) low: f64,
    /// Infinite for the top, wherever that is.
    pub(super) high: f64,
}

/// Where the next box starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Start {
    /// A chain's first sample: its joint is perpendicular to the travel to the next.
    Fresh(Blade),
    /// A chain's first sample, where another has come to an end: the box starts a little behind it, as two joints that are each
    /// perpendicular to their own travel would leave a film between them. With what it goes on from.
    Again(Blade, ChainStart),
    /// The end of the box before.
    Joint(Joint),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Joint {
    serial: u32,
    ids: Option<(JointId, PlaneId)>,
    frame: JointFrame,
    quad: [DVec3; 4],
}

/// A quad that the next box may be built from.
pub struct PendingQuad<'a> {
    /// The number of its sample.
    pub serial: u32,
    /// The joint that it is, if a box has ended there.
    pub joint: Option<JointId>,
    /// Corners tip-, tip+, base+, base-.
    pub corners: &'a mut [DVec3; 4],
}

/// A box and its bounds.
type KeptBox = (TearBox, [DVec3; 2]);

/// A chain, from the end of its last box to the newest sample.
#[derive(Clone, Debug)]
pub(super) struct Lane {
    start: Start,
    /// What it is of the newest sample's blade.
    pub(super) part: Part,
    dropped: u32,
    chain: u32,
    kept: Vec<KeptBox>,
    hub: Hub,
}

/// What the boxes of a stroke have in common, and its counts.
#[derive(Clone, Debug)]
pub(super) struct Maker {
    pub(super) width: f64,
    pub(super) slit: bool,
    pub(super) grid: Grid,
    pub(super) next_serial: u32,
    next_joint: u32,
    next_plane: u32,
    next_chain: u32,
    pub(super) skipped: u32,
    /// How far the last lanes below and above a pivot kept off it, metres.
    pub(super) insets: [f64; 2],
    /// Rooms of lanes that have ended.
    spare: Vec<Vec<KeptBox>>,
}

impl Blade {
    pub(super) fn up(&self) -> DVec3 {
        (self.top - self.tip).normalize_or_zero()
    }

    pub(super) fn length(&self) -> f64 {
        (self.top - self.tip).length()
    }

    pub(super) fn settle(&mut self, grid: Grid) {
        if self.quad != [self.tip, self.tip, self.top, self.top] {
            let frame = JointFrame::fitted(&self.quad, grid);
            (self.tip, self.top) = (frame.tip, frame.top);
        }
        self.reset_quad();
    }

    pub(super) fn pending(&mut self) -> PendingQuad<'_> {
        PendingQuad { serial: self.serial, joint: None, corners: &mut self.quad }
    }

    pub(super) fn reset_quad(&mut self) {
        self.quad = [self.tip, self.tip, self.top, self.top];
    }

    /// Lifts the top by `amount` metres in all, as far as the blade goes.
    pub(super) fn raise(&mut self, amount: f64, grid: Grid) {
        let extra = amount.min(self.spare) - self.raised;
        if extra > 0.0 {
            self.top = grid.snap(self.top + self.up() * extra);
            self.raised += extra;
            self.reset_quad();
        }
    }
}

impl Part {
    /// The blade from tip to top.
    pub(super) const WHOLE: Self = Self { low: 0.0, high: f64::INFINITY };

    /// What both have of one blade.
    pub(super) fn meet(self, other: Self) -> Self {
        Self { low: self.low.max(other.low), high: self.high.min(other.high) }
    }

    /// How much two stretches of a blade of this length have in common, metres; less than 0 if they are apart.
    pub(super) fn shared(self, other: Self, length: f64) -> f64 {
        self.high.min(other.high).min(length) - self.low.max(other.low)
    }

    /// True if neither end is farther from the other's than `reach`, on a blade of this length.
    pub(super) fn is_near(self, other: Self, length: f64, reach: f64) -> bool {
        (self.low - other.low).abs() <= reach && (self.high.min(length) - other.high.min(length)).abs() <= reach
    }

    /// Of a blade that is this stretch, and so many metres long, what is left without a share at the ends that are not tip or top.
    fn ends_in(self, length: f64, share: f64) -> Self {
        let low = if self.low > 0.0 { share * length } else { 0.0 };
        Self { low, high: if self.high.is_finite() { (1.0 - share) * length } else { f64::INFINITY } }
    }

    /// The same stretch after the tip has gone down by `deeper` metres.
    pub(super) fn lowered(self, deeper: f64) -> Self {
        Self { low: if self.low > 0.0 { (self.low + deeper).max(0.0) } else { 0.0 }, high: self.high + deeper }
    }
}

impl Start {
    /// What a chain goes on from that begins there.
    fn from(&self) -> ChainStart {
        match self {
            Self::Fresh(_) => ChainStart::Free,
            Self::Again(_, from) => *from,
            Self::Joint(joint) => joint.ids.map_or(ChainStart::Free, |ids| ChainStart::Box(ids.0)),
        }
    }

    /// The blade at the start, as far as travel is concerned.
    fn blade(&self) -> Blade {
        match self {
            Self::Fresh(blade) | Self::Again(blade, _) => *blade,
            Self::Joint(j) => {
                let (tip, top) = (j.frame.tip, j.frame.top);
                Blade { serial: j.serial, tip, top, spare: 0.0, raised: 0.0, deepened: 0.0, quad: [tip, tip, top, top] }
            }
        }
    }
}

impl Lane {
    /// A new chain that starts at `first`, of which `on[0]` is its part; `on[1]` is what it is of the blade that comes next. `after` tells
    /// what it goes on from where others have ended at `first`; none at the start of a cut.
    pub(super) fn new(first: &Blade, on: [Part; 2], after: Option<ChainStart>, maker: &mut Maker) -> Self {
        let hub = Hub::again(first, on[0], maker);
        let start = maker.part(first, on[0].inset(hub.inset));
        let kept = maker.spare.pop().unwrap_or_else(|| Vec::with_capacity(ROOM));
        let start = after.map_or(Start::Fresh(start), |from| Start::Again(start, from));
        Self { start, part: on[1], dropped: 0, chain: 0, kept, hub }
    }

    /// The joint at which the last box ended.
    pub(super) fn joint(&self) -> Option<JointId> {
        match self.start {
            Start::Joint(Joint { ids: Some((id, _)), .. }) => Some(id),
            _ => None,
        }
    }

    /// The chain of the last box, if the next may belong to it.
    pub(super) fn chain(&self) -> Option<u32> {
        self.kept.last().map(|k| k.0.chain)
    }

    /// The quads where the next boxes start.
    pub(super) fn start_quads_mut(&mut self) -> impl Iterator<Item = PendingQuad<'_>> {
        let joint = self.joint();
        let start = match &mut self.start {
            Start::Fresh(blade) | Start::Again(blade, _) => blade.pending(),
            Start::Joint(start) => PendingQuad { serial: start.serial, joint, corners: &mut start.quad },
        };
        std::iter::once(start).chain(self.hub.start_quad_mut())
    }

    /// True while boxes of a cone's tip are to come beside it.
    pub(super) fn has_hub(&self) -> bool {
        self.hub.is_open()
    }

    pub(super) fn settle(&mut self, grid: Grid) {
        self.hub.settle(grid);
        match &mut self.start {
            Start::Fresh(blade) | Start::Again(blade, _) => blade.settle(grid),
            Start::Joint(j) => {
                if j.quad != j.frame.quad() {
                    j.frame = JointFrame::fitted(&j.quad, grid);
                }
                j.quad = j.frame.quad();
            }
        }
    }

    /// The next sample has arrived, so that the one before can have its joint and the box that ends there can be built. `on` is
    /// the lane's part of the blade on its way from `last` to `next`.
    pub(super) fn step(&mut self, last: &Blade, next: &Blade, on: [Part; 2], maker: &mut Maker, out: &mut Vec<TearSegment>) {
        let part = self.part.meet(on[0]);
        let inset = self.hub.inset;
        let end = maker.part(last, part.inset(inset));
        let begin = if part == on[0] { end } else { maker.part(last, on[0].inset(inset)) };
        let outgoing = direction(&begin, &maker.part(next, on[1].inset(inset)), &end);
        let incoming = direction(&self.start.blade(), &end, &end);
        if incoming.dot(outgoing) < SHARPEST_TURN_COSINE {
            self.close_at(&end, part, maker, out);
            self.hub.step(last, part, true, maker, out);
            (self.start, self.dropped) = (Start::Fresh(begin), 0);
            self.kept.clear();
            self.hub.go_on_from(last, on[0], maker);
        } else if part == Part::WHOLE {
            self.go_on(&end, begin, incoming, outgoing, maker, out);
        } else if let Some(joint) = self.build(self.start, &end, incoming, outgoing, maker, out) {
            (self.start, self.dropped) = (Start::Joint(joint), 0);
            self.hub.step(last, part, false, maker, out);
        } else {
            // beside a pivot a dropped sample would leave much uncut
            let turns = self.turns(&end, incoming, outgoing);
            let end = self.close_at(&end, part, maker, out);
            self.hub.step(last, part, true, maker, out);
            self.hub.begin(last, on[0], turns, maker);
            let first = maker.part(last, on[0].inset(self.hub.inset));
            self.begin(first, end.map_or(ChainStart::Free, ChainStart::Box));
        }
        self.part = on[1];
    }

    /// A new chain, of this lane, where the last has come to an end.
    fn begin(&mut self, first: Blade, from: ChainStart) {
        (self.start, self.dropped) = (Start::Again(first, from), 0);
        self.kept.clear();
    }

    fn go_on(
        &mut self,
        end: &Blade,
        begin: Blade,
        incoming: DVec3,
        outgoing: DVec3,
        maker: &mut Maker,
        out: &mut Vec<TearSegment>,
    ) {
        if let Some(joint) = self.build(self.start, end, incoming, outgoing, maker, out) {
            (self.start, self.dropped) = (Start::Joint(joint), 0);
        } else if self.dropped == 0 {
            self.dropped = 1;
        } else if let Some(end) = self.build_straight(self.start, end, maker, out) {
            // A sample was dropped and the box was still invalid: end the chain and start a new one.
            self.begin(begin, ChainStart::Box(end));
        } else if let Start::Joint(_) = self.start {
            self.kept.clear();
            self.start = Start::Again(self.start.blade(), self.start.from());
            self.go_on(end, begin, incoming, outgoing, maker, out);
        } else if self.turn_back(end, maker, out) {
            self.begin(begin, ChainStart::Free);
        } else if self.dropped < MOST_DROPPED {
            self.dropped += 1;
        } else {
            maker.skipped += 1;
            self.begin(begin, ChainStart::Free);
        }
    }

    /// How far the blade turns from the start to the joint at `end`, and the way across it: lengths of differences of unit vectors. A
    /// start perpendicular to the way has half the turn of one that is between two.
    fn turns(&self, end: &Blade, incoming: DVec3, outgoing: DVec3) -> [f64; 2] {
        let across = |up: DVec3, way: DVec3| up.cross(reject(way, up)).normalize_or_zero();
        let (start, times) = match &self.start {
            Start::Fresh(blade) | Start::Again(blade, _) => (across(blade.up(), direction(blade, end, blade)), 2.0),
            Start::Joint(joint) => (joint.frame.half.normalize_or_zero(), 1.0),
        };
        let turned = start.distance(across(end.up(), incoming + outgoing));
        [self.start.blade().up().distance(end.up()), times * turned]
    }

    /// The ways of the last box that comes to `last`, see [`ways`].
    pub(super) fn ways_to(&self, last: &Blade) -> [DVec3; 2] {
        ways(&self.start.blade(), last, last)
    }

    /// Ends the chain at the newest sample, perpendicular to the travel.
    /// Gives the joint there, if a box has come to it.
    pub(super) fn close(mut self, last: &Blade, maker: &mut Maker, out: &mut Vec<TearSegment>) -> Option<JointId> {
        let end = maker.part(last, self.part.inset(self.hub.inset));
        let joint = self.close_at(&end, self.part, maker, out);
        self.hub.step(last, self.part, true, maker, out);
        self.kept.clear();
        maker.spare.push(self.kept);
        joint
    }

    /// Where tissue that moves has turned the start since, so that the whole blade comes to `end` about a point of its own: what is below
    /// that and what is above, each as a chain. False if it has not.
    fn turn_back(&self, end: &Blade, maker: &mut Maker, out: &mut Vec<TearSegment>) -> bool {
        let start = self.start.blade();
        let (wanted, count) = parts(&start, end, maker.grid);
        let turns = wanted[0] != [Part::WHOLE; 2];
        if turns {
            for &on in &wanted[..count] {
                Lane::new(&start, on, Some(ChainStart::Free), maker).close(end, maker, out);
            }
        }
        turns
    }

    fn close_at(&mut self, end: &Blade, part: Part, maker: &mut Maker, out: &mut Vec<TearSegment>) -> Option<JointId> {
        let joint = self.build_straight(self.start, end, maker, out);
        if joint.is_some() {
            return joint;
        }
        self.kept.clear();
        let (start, from) = (self.start.blade(), self.start.from());
        if matches!(self.start, Start::Joint(_)) {
            let joint = self.build_straight(Start::Again(start, from), end, maker, out);
            if joint.is_some() {
                return joint;
            }
        }
        if part == Part::WHOLE {
            maker.skipped += u32::from(!self.turn_back(end, maker, out));
            return None;
        }
        let joint = SHORTER.into_iter().find_map(|by| {
            let [start, end] = [&start, end].map(|blade| maker.part(blade, part.ends_in(blade.length(), by)));
            self.build_straight(Start::Again(start, from), &end, maker, out)
        });
        maker.skipped += u32::from(joint.is_none());
        joint
    }

    /// A box that ends perpendicular to its travel, if it is valid; gives the joint there.
    fn build_straight(&mut self, start: Start, end: &Blade, maker: &mut Maker, out: &mut Vec<TearSegment>) -> Option<JointId> {
        let incoming = direction(&start.blade(), end, end);
        self.build(start, end, incoming, incoming, maker, out)?.ids.map(|ids| ids.0)
    }

    /// The box from `start` to a joint at `end`, mitred between the two unit directions (MATHS 5.2), if it is valid.
    fn build(
        &mut self,
        start: Start,
        end: &Blade,
        incoming: DVec3,
        outgoing: DVec3,
        maker: &mut Maker,
        out: &mut Vec<TearSegment>,
    ) -> Option<Joint> {
        let mut from = ChainStart::Free;
        let mut start = match start {
            Start::Joint(joint) => joint,
            Start::Fresh(blade) => {
                let way = direction(&blade, end, &blade);
                maker.joint(&blade, way, way)?
            }
            Start::Again(blade, of) => {
                from = of;
                let way = direction(&blade, end, &blade);
                maker.joint(&maker.drawn_back(&blade, way), way, way)?
            }
        };
        let mut end = maker.joint(end, incoming, outgoing)?;
        let hull = hull(&start.frame, &end.frame)?;
        let start_ids = *start.ids.get_or_insert_with(|| maker.joint_ids());
        let end_ids = *end.ids.get_or_insert_with(|| maker.joint_ids());
        let mut made = maker.assemble(&start, &end, start_ids, end_ids, &hull);
        let bounds = made.bounds();
        // The box before is behind the shared joint by construction. (After the joint was re-posed the kept boxes are
        // those of an older pose: the test may then end a chain needlessly, which costs nothing.)
        let before = |k: &TearBox| k.joints[1] == made.joints[0];
        if !self.kept.iter().rev().all(|(k, b)| boxes_apart(b, &bounds) || before(k) || k.is_apart_from(&made)) {
            // The path crosses its own chain: go on from the same joint as a new chain (MATHS 5.3).
            self.kept.clear();
        }
        if self.kept.is_empty() {
            self.chain = maker.next_chain;
            maker.next_chain += 1;
        }
        (made.chain, made.index, made.from) = (self.chain, self.kept.len() as u32, from);
        let is_slit = maker.slit;
        out.push(if is_slit { TearSegment::Slit(slit_of(&made)) } else { TearSegment::Box(made.clone()) });
        self.kept.push((made, bounds));
        Some(end)
    }
}

impl Maker {
    /// For boxes of `width` metres; slits with 0, less or NaN.
    pub(super) fn new(width: f64, sampling: &Sampling) -> Self {
        let (slit, grid) = (!(width.is_finite() && width > 0.0), Grid::new(sampling.diagonal));
        let mut maker = Self {
            width,
            slit,
            grid,
            next_serial: 0,
            next_joint: 0,
            next_plane: 0,
            next_chain: 0,
            skipped: 0,
            insets: [0.0; 2],
            spare: Vec::new(),
        };
        maker.set_width(width, sampling);
        maker
    }

    /// A hair thinner than the grid resolves is cut as the thinnest box that the grid holds well.
    pub(super) fn set_width(&mut self, width: f64, sampling: &Sampling) {
        let nominal = if self.slit { sampling.distance * 1e-3 } else { width };
        self.width = nominal.max(self.grid.step * 1024.0);
    }

    /// Makes room for so many lanes.
    pub(super) fn make_room(&mut self, lanes: usize) {
        self.spare.reserve(2 * lanes);
        self.spare.resize_with(lanes, || Vec::with_capacity(ROOM));
    }

    /// Another's rooms, which it needs no more.
    pub(super) fn with_rooms_of(self, other: Self) -> Self {
        Self { spare: other.spare, ..self }
    }

    /// A part of a blade; one that is not the whole has a serial number of its own.
    pub(super) fn part(&mut self, blade: &Blade, part: Part) -> Blade {
        if part == Part::WHOLE {
            return *blade;
        }
        let (up, length) = (blade.up(), blade.length());
        let at =
            |along: f64, end: DVec3| if (1e-12..length).contains(&along) { self.grid.snap(blade.tip + up * along) } else { end };
        let (tip, top) = (at(part.low, blade.tip), at(part.high, blade.top));
        self.next_serial += 1;
        Blade { serial: self.next_serial - 1, tip, top, quad: [tip, tip, top, top], ..*blade }
    }

    /// A box of its own between two blades, perpendicular to its way at both ends and of this share of the width; nothing if it is not
    /// valid.
    pub(super) fn push_alone(&mut self, [start, end]: [&Blade; 2], share: f64, out: &mut Vec<TearSegment>) {
        let joint = |blade: &Blade| {
            let way = direction(start, end, blade);
            self.joint(blade, way, way)
                .map(|j| Joint { frame: JointFrame { half: self.grid.snap(j.frame.half * share), ..j.frame }, ..j })
        };
        let Some((start, end)) = joint(start).zip(joint(end)) else { return };
        let Some(hull) = hull(&start.frame, &end.frame) else { return };
        let ids = [self.joint_ids(), self.joint_ids()];
        let made = self.assemble(&start, &end, ids[0], ids[1], &hull);
        self.next_chain += 1;
        out.push(TearSegment::Box(TearBox { chain: self.next_chain - 1, ..made }));
    }

    /// A blade so far behind this one that a box which starts there leaves no film where another ends. Slits leave none.
    pub(super) fn drawn_back(&self, blade: &Blade, way: DVec3) -> Blade {
        let back = if self.slit { DVec3::ZERO } else { self.grid.snap(way * (REACH_BACK * self.width)) };
        Blade { tip: blade.tip - back, top: blade.top - back, ..*blade }
    }

    fn joint(&self, blade: &Blade, incoming: DVec3, outgoing: DVec3) -> Option<Joint> {
        let cos_half = ((1.0 + incoming.dot(outgoing)) * 0.5).sqrt();
        let up = blade.up();
        let normal = reject(incoming + outgoing, up).normalize_or_zero();
        if normal == DVec3::ZERO || cos_half.is_nan() {
            return None;
        }
        let half = self.grid.snap(up.cross(normal) * (self.width * 0.5 / cos_half.min(1.0)));
        let frame = JointFrame { tip: blade.tip, top: blade.top, half };
        Some(Joint { serial: blade.serial, ids: None, frame, quad: frame.quad() })
    }

    fn joint_ids(&mut self) -> (JointId, PlaneId) {
        self.next_joint += 1;
        self.next_plane += 1;
        (JointId(self.next_joint - 1), PlaneId(self.next_plane - 1))
    }

    fn assemble(&mut self, start: &Joint, end: &Joint, a: (JointId, PlaneId), b: (JointId, PlaneId), hull: &Hull) -> TearBox {
        let quads = [start.frame.quad(), end.frame.quad()];
        let corner = |k: u8| quads[k as usize / 4][k as usize % 4];
        let cap = |quad: &[DVec3; 4], flipped: bool, id: PlaneId, side: Side| HalfSpace {
            points: [quad[0], quad[1], quad[2]],
            flipped,
            id,
            side,
        };
        let start_plane = cap(&quads[0], true, a.1, Side::Start);
        let mut planes = [start_plane; 10];
        planes[1] = cap(&quads[1], false, b.1, Side::End);
        for (k, triangle) in hull.triangles.iter().enumerate() {
            let id = PlaneId(self.next_plane + k as u32);
            planes[2 + k] = HalfSpace { points: triangle.map(corner), flipped: false, id, side: LATERAL_SIDES[k / 2] };
        }
        self.next_plane += 8;
        TearBox {
            quads,
            blades: [[start.frame.tip, start.frame.top], [end.frame.tip, end.frame.top]],
            joints: [a.0, b.0],
            planes,
            triangles: hull.triangles,
            bulge: hull.bulge,
            chain: 0,
            index: 0,
            from: ChainStart::Free,
        }
    }
}

/// Unit direction of travel from `a` to `b`, across the line of `at`; zero if there is none.
pub(super) fn direction(a: &Blade, b: &Blade, at: &Blade) -> DVec3 {
    let up = at.up();
    reject((b.tip - a.tip) + (b.top - a.top), up).normalize_or_zero()
}

/// How far the tip and the top go from `a` to `b`, across the line of `at`.
pub(super) fn ways(a: &Blade, b: &Blade, at: &Blade) -> [DVec3; 2] {
    let up = at.up();
    [reject(b.tip - a.tip, up), reject(b.top - a.top, up)]
}

fn slit_of(b: &TearBox) -> Slit {
    let ends = [b.planes[0], b.planes[1]];
    let plane_ids = [b.planes[2].id, b.planes[3].id];
    Slit { corners: b.strip_corners(), joints: b.joints, ends, plane_ids, chain: b.chain, index: b.index }
}
