//! Samples in, boxes out (MATHS 5.2 to 5.5): joints, validity, dropped samples, chains, pivots.
//!
//! A joint needs the sample after it, so a box is committed when the sample after its end arrives, or on release. What
//! is pending moves with the tissue ([`ChainBuilder::pending_quads_mut`]). Nothing here knows the clock or how samples
//! were batched: the same samples give the same bits.

use super::blade_path::{BladePose, Sampling};
use super::boxes::{
    Grid, HalfSpace, Hull, JointFrame, JointId, LATERAL_SIDES, PlaneId, Side, Slit, TearBox, TearSegment, boxes_apart, hull,
};
use super::path_sampler::{ClippedSample, SampleKind, reject};
use glam::DVec3;

/// A turn beyond this ends the chain: 120 degrees.
const SHARPEST_TURN_COSINE: f64 = -0.5;
/// Below this share of the faster end's travel, the slower end of the blade counts as a pivot.
const PIVOT_SHARE: f64 = 1e-6;
/// How far past the pivot (share of the blade) each part may reach; negative leaves a gap. The first valid one is used.
const PIVOT_OVERLAPS: [f64; 5] = [1e-2, -1e-4, -1e-3, -1e-2, -1e-1];
/// After so many dropped samples in a row the stretch is given up and the chain starts anew.
const MOST_DROPPED: u32 = 8;

/// A clipped blade that waits for its joint.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Blade {
    serial: u32,
    tip: DVec3,
    top: DVec3,
    /// What is left of the blade above `top`, metres.
    spare: f64,
    raised: f64,
    /// How far motion along the axis has lowered the tip, metres.
    deepened: f64,
    quad: [DVec3; 4],
}

/// Where the next box starts.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Start {
    /// A chain's first sample: its joint is perpendicular to the travel to the next.
    Fresh(Blade),
    /// The end of the box before.
    Joint(Joint),
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Joint {
    serial: u32,
    ids: Option<(JointId, PlaneId)>,
    frame: JointFrame,
    quad: [DVec3; 4],
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum State {
    #[default]
    Empty,
    One(Blade),
    Two {
        start: Start,
        last: Blade,
        dropped: u32,
    },
}

/// Builds the chains of one stroke.
#[derive(Clone, Debug)]
pub struct ChainBuilder {
    width: f64,
    slit: bool,
    grid: Grid,
    state: State,
    outside: Option<BladePose>,
    chain: u32,
    kept: Vec<(TearBox, [DVec3; 2])>,
    next_serial: u32,
    next_joint: u32,
    next_plane: u32,
    skipped: u32,
}

impl Blade {
    fn up(&self) -> DVec3 {
        (self.top - self.tip).normalize_or_zero()
    }

    fn part(&self, low: f64, high: f64, grid: Grid) -> Self {
        let at = |s: f64| if s >= 1.0 { self.top } else { grid.snap(self.tip + (self.top - self.tip) * s) };
        Self { tip: at(low), top: at(high), ..*self }
    }

    fn settle(&mut self, grid: Grid) {
        if self.quad != [self.tip, self.tip, self.top, self.top] {
            let frame = JointFrame::fitted(&self.quad, grid);
            (self.tip, self.top) = (frame.tip, frame.top);
        }
        self.quad = [self.tip, self.tip, self.top, self.top];
    }
}

impl Start {
    /// The blade at the start, as far as travel is concerned.
    fn blade(&self) -> Blade {
        match self {
            Self::Fresh(blade) => *blade,
            Self::Joint(j) => {
                let (tip, top) = (j.frame.tip, j.frame.top);
                Blade { serial: j.serial, tip, top, spare: 0.0, raised: 0.0, deepened: 0.0, quad: [tip, tip, top, top] }
            }
        }
    }

    fn settle(&mut self, grid: Grid) {
        match self {
            Self::Fresh(blade) => blade.settle(grid),
            Self::Joint(j) => {
                if j.quad != j.frame.quad() {
                    j.frame = JointFrame::fitted(&j.quad, grid);
                }
                j.quad = j.frame.quad();
            }
        }
    }
}

impl ChainBuilder {
    /// A builder for one stroke of `width` metres (0: a slit; negative or NaN counts as 0, callers refuse it earlier).
    pub fn new(width: f64, sampling: &Sampling) -> Self {
        let grid = Grid::new(sampling.diagonal);
        let slit = !(width.is_finite() && width > 0.0);
        let nominal = if slit { sampling.distance * 1e-3 } else { width };
        Self {
            // A hair thinner than the grid resolves is cut as the thinnest box that the grid holds well.
            width: nominal.max(grid.step * 1024.0),
            slit,
            grid,
            state: State::Empty,
            outside: None,
            chain: 0,
            kept: Vec::new(),
            next_serial: 0,
            next_joint: 0,
            next_plane: 0,
            skipped: 0,
        }
    }

    /// Stretches that no valid box could be made for, so far.
    pub fn skipped(&self) -> u32 {
        self.skipped
    }

    /// The quads that the next box may be built from, with the serial number of their sample: the joint where the last
    /// box ended, and the samples after it (degenerate quads tip, tip, top, top). Re-pose the corners with the tissue
    /// before the next push (MATHS 5.5): they are brought back into a plane then, and stay as they are, bit for bit, if
    /// none was moved. The list changes with every push.
    pub fn pending_quads_mut(&mut self) -> impl Iterator<Item = (u32, &mut [DVec3; 4])> {
        let (a, b) = match &mut self.state {
            State::Empty => (None, None),
            State::One(blade) => (Some((blade.serial, &mut blade.quad)), None),
            State::Two { start, last, .. } => {
                let first = match start {
                    Start::Fresh(blade) => (blade.serial, &mut blade.quad),
                    Start::Joint(joint) => (joint.serial, &mut joint.quad),
                };
                (Some(first), Some((last.serial, &mut last.quad)))
            }
        };
        a.into_iter().chain(b)
    }

    /// The joint at which the last box ended, while the chain may still go on from it (its end wall is provisional).
    pub fn open_joint(&self) -> Option<JointId> {
        match self.state {
            State::Two { start: Start::Joint(Joint { ids: Some((id, _)), .. }), .. } => Some(id),
            _ => None,
        }
    }

    /// Lifts the top of the newest pending sample by `amount` metres in all, as far as the blade goes.
    pub fn raise_last(&mut self, amount: f64) {
        let grid = self.grid;
        if let State::One(last) | State::Two { last, .. } = &mut self.state {
            raise(last, amount, grid);
        }
    }

    /// Takes the next sample and appends the segments that it completes: usually one, none at a chain's start, several
    /// at a pivot.
    pub fn push(&mut self, sample: &ClippedSample, out: &mut Vec<TearSegment>) {
        self.settle();
        let blade = self.blade(sample);
        match (sample.kind, blade) {
            (SampleKind::Move, Some(blade)) => {
                if let (State::Empty, Some(before)) = (self.state, self.outside)
                    && let Some(before) = self.extended(&before, &blade)
                {
                    // The rim between the last blade outside and this one is cut too.
                    self.accept(before, out);
                }
                self.accept(blade, out);
            }
            (SampleKind::Move, None) => {
                if let State::One(last) | State::Two { last, .. } = self.state
                    && let Some(blade) = self.extended(&sample.pose, &last)
                {
                    self.accept(blade, out);
                }
                self.release(out);
            }
            (SampleKind::Axial, Some(blade)) => self.deepen(blade),
            (SampleKind::End, Some(blade)) => self.end_at(blade, out),
            (SampleKind::Axial | SampleKind::End, None) => self.release(out),
        }
        self.outside = blade.is_none().then_some(sample.pose);
    }

    /// Ends the stroke where the blade is (perpendicular end) and appends what was pending. The builder can go on with
    /// a new chain.
    pub fn release(&mut self, out: &mut Vec<TearSegment>) {
        self.settle();
        if let State::Two { start, last, .. } = self.state {
            self.close(start, last, out);
        }
        self.state = State::Empty;
        self.outside = None;
        self.end_chain();
    }

    fn settle(&mut self) {
        let grid = self.grid;
        match &mut self.state {
            State::Empty => {}
            State::One(blade) => blade.settle(grid),
            State::Two { start, last, .. } => {
                start.settle(grid);
                last.settle(grid);
            }
        }
    }

    fn blade(&mut self, sample: &ClippedSample) -> Option<Blade> {
        let top = sample.top?;
        let mut blade = self.blade_of(sample.pose.tip, top, (sample.pose.base - top).length())?;
        raise(&mut blade, sample.raise, self.grid);
        Some(blade)
    }

    fn blade_of(&mut self, tip: DVec3, top: DVec3, spare: f64) -> Option<Blade> {
        let (tip, top) = (self.grid.snap(tip), self.grid.snap(top));
        let long_enough = (top - tip).length() > 1024.0 * self.grid.step;
        let serial = self.next_serial;
        self.next_serial += u32::from(long_enough);
        long_enough.then_some(Blade { serial, tip, top, spare, raised: 0.0, deepened: 0.0, quad: [tip, tip, top, top] })
    }

    /// A blade outside the tissue, clipped to the length of its neighbour inside.
    fn extended(&mut self, outside: &BladePose, inside: &Blade) -> Option<Blade> {
        let length = (inside.top - inside.tip).length().min((outside.base - outside.tip).length());
        self.blade_of(outside.tip, outside.tip + outside.up() * length, 0.0)
    }

    /// Motion along the axis: the newest sample reaches down to the new tip, or the stroke starts here.
    fn deepen(&mut self, blade: Blade) {
        match &mut self.state {
            State::Empty => self.state = State::One(blade),
            State::One(last) | State::Two { last, .. } => {
                let down = -last.up();
                let deeper = (blade.tip - last.tip).dot(down);
                if deeper > 0.0 {
                    last.tip = self.grid.snap(last.tip + down * deeper);
                    last.deepened += deeper;
                    last.quad = [last.tip, last.tip, last.top, last.top];
                }
            }
        }
    }

    /// The path's last pose, close to the newest sample: it takes that one's place, at the greater depth.
    fn end_at(&mut self, mut blade: Blade, out: &mut Vec<TearSegment>) {
        let grid = self.grid;
        if let State::Two { last, .. } = &mut self.state {
            let withdrawn = (last.tip - blade.tip).dot(-blade.up()).clamp(0.0, last.deepened);
            blade.tip = grid.snap(blade.tip - blade.up() * withdrawn);
            blade.quad = [blade.tip, blade.tip, blade.top, blade.top];
            *last = blade;
        } else {
            self.accept(blade, out);
        }
    }

    fn accept(&mut self, blade: Blade, out: &mut Vec<TearSegment>) {
        match self.state {
            State::Empty => self.state = State::One(blade),
            State::One(first) => self.begin(first, blade, out),
            State::Two { start, last, dropped } => self.step(start, last, blade, dropped, out),
        }
    }

    /// A chain's first two samples.
    fn begin(&mut self, first: Blade, next: Blade, out: &mut Vec<TearSegment>) {
        if self.pivot(&first, &next, out) {
            self.state = State::One(next);
        } else {
            self.state = State::Two { start: Start::Fresh(first), last: next, dropped: 0 };
        }
    }

    /// `next` has arrived, so `last` can have its joint and the box that ends there can be built.
    fn step(&mut self, start: Start, last: Blade, next: Blade, dropped: u32, out: &mut Vec<TearSegment>) {
        if is_pivot(&last, &next, self.grid) {
            self.close(start, last, out);
            self.begin(last, next, out);
            return;
        }
        let from = start.blade();
        let (incoming, outgoing) = (direction(&from, &last, &last), direction(&last, &next, &last));
        if incoming.dot(outgoing) < SHARPEST_TURN_COSINE {
            self.close(start, last, out);
            self.begin(last, next, out);
        } else if let Some(joint) = self.build(start, &last, incoming, outgoing, out) {
            self.state = State::Two { start: Start::Joint(joint), last: next, dropped: 0 };
        } else if dropped == 0 {
            self.state = State::Two { start, last: next, dropped: 1 };
        } else {
            self.give_up(start, last, next, dropped, out);
        }
    }

    /// A sample was dropped and the box is still invalid: end the chain and start a new one.
    fn give_up(&mut self, start: Start, last: Blade, next: Blade, dropped: u32, out: &mut Vec<TearSegment>) {
        let incoming = direction(&start.blade(), &last, &last);
        if self.build(start, &last, incoming, incoming, out).is_some() {
            self.end_chain();
            self.begin(last, next, out);
            return;
        }
        match start {
            Start::Joint(_) => {
                self.end_chain();
                self.step(Start::Fresh(start.blade()), last, next, dropped, out);
            }
            Start::Fresh(_) if dropped < MOST_DROPPED => {
                self.state = State::Two { start, last: next, dropped: dropped + 1 };
            }
            Start::Fresh(_) => {
                self.skipped += 1;
                self.begin(last, next, out);
            }
        }
    }

    /// Ends the chain at `last`, perpendicular to the travel.
    fn close(&mut self, start: Start, last: Blade, out: &mut Vec<TearSegment>) {
        let incoming = direction(&start.blade(), &last, &last);
        if self.build(start, &last, incoming, incoming, out).is_none() {
            self.end_chain();
            let fresh = Start::Fresh(start.blade());
            let built = matches!(start, Start::Joint(_)) && self.build(fresh, &last, incoming, incoming, out).is_some();
            self.skipped += u32::from(!built);
        }
        self.end_chain();
    }

    fn end_chain(&mut self) {
        self.chain += u32::from(!self.kept.is_empty());
        self.kept.clear();
    }

    /// The box from `start` to a joint at `end`, mitred between the two unit directions (MATHS 5.2), if it is valid.
    fn build(
        &mut self,
        start: Start,
        end: &Blade,
        incoming: DVec3,
        outgoing: DVec3,
        out: &mut Vec<TearSegment>,
    ) -> Option<Joint> {
        let mut start = match start {
            Start::Joint(joint) => joint,
            Start::Fresh(blade) => {
                let way = direction(&blade, end, &blade);
                self.joint(&blade, way, way)?
            }
        };
        let mut end = self.joint(end, incoming, outgoing)?;
        let hull = hull(&start.frame, &end.frame)?;
        let start_ids = *start.ids.get_or_insert_with(|| self.joint_ids());
        let end_ids = *end.ids.get_or_insert_with(|| self.joint_ids());
        let mut made = self.assemble(&start, &end, start_ids, end_ids, &hull);
        let bounds = made.bounds();
        // The box before is behind the shared joint by construction. (After the joint was re-posed the kept boxes are
        // those of an older pose: the test may then end a chain needlessly, which costs nothing.)
        let before = |k: &TearBox| k.joints[1] == made.joints[0];
        if !self.kept.iter().rev().all(|(k, b)| boxes_apart(b, &bounds) || before(k) || k.is_apart_from(&made)) {
            // The path crosses its own chain: go on from the same joint as a new chain (MATHS 5.3).
            self.end_chain();
        }
        (made.chain, made.index) = (self.chain, self.kept.len() as u32);
        out.push(if self.slit { TearSegment::Slit(Box::new(slit_of(&made))) } else { TearSegment::Box(Box::new(made.clone())) });
        self.kept.push((made, bounds));
        Some(end)
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
        }
    }

    /// Where tip and top move in opposite directions: two chains of one box each, cut at the pivot. False if they do not.
    fn pivot(&mut self, first: &Blade, next: &Blade, out: &mut Vec<TearSegment>) -> bool {
        let Some(pivot) = pivot_share(first, next, self.grid) else { return false };
        for lower in [true, false] {
            let ends = PIVOT_OVERLAPS
                .iter()
                .map(|o| if lower { (0.0, (pivot + o).clamp(0.0, 1.0)) } else { ((pivot - o).clamp(0.0, 1.0), 1.0) });
            for (low, high) in ends.filter(|(low, high)| high - low > 2e-3) {
                let (a, b) = (first.part(low, high, self.grid), next.part(low, high, self.grid));
                let way = direction(&a, &b, &b);
                self.end_chain();
                if self.build(Start::Fresh(a), &b, way, way, out).is_some() {
                    break;
                }
            }
            self.end_chain();
        }
        true
    }
}

fn is_pivot(first: &Blade, next: &Blade, grid: Grid) -> bool {
    pivot_share(first, next, grid).is_some()
}

/// Where along the blade, tip (0) to top (1), it stands still while one end goes forward and the other does not.
fn pivot_share(first: &Blade, next: &Blade, grid: Grid) -> Option<f64> {
    let up = first.up();
    let (tip, top) = (reject(next.tip - first.tip, up), reject(next.top - first.top, up));
    let main = if tip.length_squared() >= top.length_squared() { tip } else { top };
    let scale = main.length_squared();
    if scale.sqrt() <= 1024.0 * grid.step {
        return None;
    }
    let (a, b) = (tip.dot(main) / scale, top.dot(main) / scale);
    (a.min(b) <= PIVOT_SHARE).then(|| (a / (a - b)).clamp(0.0, 1.0))
}

/// Unit direction of travel from `a` to `b`, across the line of `at`; zero if there is none.
fn direction(a: &Blade, b: &Blade, at: &Blade) -> DVec3 {
    let up = at.up();
    reject((b.tip - a.tip) + (b.top - a.top), up).normalize_or_zero()
}

fn raise(blade: &mut Blade, amount: f64, grid: Grid) {
    let extra = amount.min(blade.spare) - blade.raised;
    if extra > 0.0 {
        blade.top = grid.snap(blade.top + blade.up() * extra);
        blade.raised += extra;
        blade.quad = [blade.tip, blade.tip, blade.top, blade.top];
    }
}

fn slit_of(b: &TearBox) -> Slit {
    let ends = [b.planes[0], b.planes[1]];
    let plane_ids = [b.planes[2].id, b.planes[3].id];
    Slit { corners: b.strip_corners(), joints: b.joints, ends, plane_ids, chain: b.chain, index: b.index }
}
