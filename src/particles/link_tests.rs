//! Strip tests of the links of particles: the strips that a particle's links may meet are found once and kept.

use super::holders::{above, below};
use super::lists::Lists;
use super::particle_map::ParticleMap;
use super::settings::ParticleSettings;
use super::sight::Sight;
use super::strip_test::{KnownSide, LipView, StripGeometry};
use super::strips::{LipSide, Strips};
use crate::geometry::room::{fit, with_headroom};
use crate::geometry::{ParticleId, VertexId};
use glam::{DVec3, Vec3A, Vec4};

/// More new strips than this are looked up in the tree and not one by one.
const FEW: usize = 24;
/// Strips that a link is looked at together for.
const BATCH: usize = 4;
/// A bit for each of them.
const ALL: u32 = (1 << BATCH) - 1;
/// Strips near particles, over all of them, that are made room for at first.
const ROOM: usize = 1 << 16;

/// Strips near a particle that come at once.
const FOUND: usize = 256;

/// The strips near each particle, by particle. Anchors and strips do not move in rest space, so an update only has to look at the
/// strips that are new; an undo, which takes strips away, forgets everything.
#[derive(Clone, Debug, Default)]
pub(super) struct LinkTests {
    particles: Vec<NearStrips>,
    lists: StripLists,
    found: Vec<u32>,
    /// Scratch: [`Sights`] of one particle that links to vertices near one another may meet.
    batches: Vec<usize>,
    /// Ends of links that were tested, each in the place that its number says, and one for two that share a place.
    ends: Vec<TestedEnd>,
    spare_end: TestedEnd,
    /// Links that were looked at.
    pub(super) tested: usize,
}

/// Ends of links that are remembered: a power of two, more than an edit's wound mostly has.
const ENDS: usize = 256;

/// What was worked out of a vertex for the tests of its links: the next one asks again.
#[derive(Clone, Debug, Default)]
struct TestedEnd {
    of: VertexKey,
    around: StripsAround,
    views: LipViews,
}

/// Places in a particle's list of the strips that parted its last links, the last one first: they often part the next one too.
#[derive(Clone, Copy, Debug)]
struct Parting([u32; PARTING]);

/// As many as are asked first.
const PARTING: usize = 4;

impl Default for Parting {
    fn default() -> Self {
        Self([u32::MAX; PARTING])
    }
}

impl Parting {
    /// The first of them that parts this link too; it comes first then.
    fn find(&mut self, parts: impl FnMut(usize) -> bool) -> Option<usize> {
        let known = self.0.iter().map_while(|&i| (i != u32::MAX).then_some(i as usize));
        let at = known.map(parts).position(|parts| parts)?;
        self.0[..=at].rotate_right(1);
        Some(self.0[0] as usize)
    }

    fn push(&mut self, place: usize) {
        self.0.rotate_right(1);
        self.0[0] = place as u32;
    }
}

/// Strips that parted a vertex from particles: other particles' links to it are tested against them first.
#[derive(Clone, Debug)]
pub(super) struct AskedFirst {
    of: VertexId,
    strips: Vec<u32>,
    /// Of an anchor and of the vertex.
    views: [LipViews; 2],
}

/// As many as are kept.
const ASKED: usize = 8;

impl Default for AskedFirst {
    fn default() -> Self {
        Self { of: VertexId::NONE, strips: Vec::new(), views: Default::default() }
    }
}

impl AskedFirst {
    pub(super) fn make_room(&mut self) {
        self.strips.reserve(ASKED);
        self.views.iter_mut().for_each(|v| v.views.reserve(2 * ASKED));
    }

    /// Forgets all: strips have come or gone since.
    pub(super) fn clear(&mut self) {
        self.of = VertexId::NONE;
    }

    /// True if one of the strips that are known of `v` parts it from an anchor; it is asked first then.
    fn parts(&mut self, strips: &Strips, rest: &[DVec3], anchor: VertexId, v: VertexId) -> bool {
        if self.of != v {
            self.of = v;
            self.strips.clear();
            self.views[1].views.clear();
        }
        let [from, to] = &mut self.views;
        from.views.clear();
        let is_lip = !strips.lip_sides(anchor).is_empty();
        let mut link = LinkUnderTest { strips, rest, anchor, v, is_lip, views: [from, to] };
        self.strips.iter().position(|&k| link.crosses(k)).is_some_and(|at| {
            self.strips[..=at].rotate_right(1);
            true
        })
    }

    /// Notes a strip that parted the vertex that was asked about last.
    fn note(&mut self, k: u32) {
        self.strips.truncate(ASKED - 1);
        self.strips.insert(0, k);
    }
}

/// Strips that a vertex may know its side of, oldest first, with its outcodes; 0 where a known side stands against geometry.
#[derive(Clone, Debug, Default)]
struct StripsAround {
    strips: Vec<(u32, u16)>,
    /// See [`Strips::is_beyond_own`].
    is_beyond: bool,
    is_known: bool,
}

/// What everything that is worked out of one vertex hangs on: the vertex, the number of all strips, and its lip sides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct VertexKey {
    vertex: VertexId,
    strips: usize,
    /// A hash of them.
    sides: u64,
}

impl VertexKey {
    /// Makes it that of `v` now; true if it was.
    fn renew(&mut self, strips: &Strips, v: VertexId) -> bool {
        let with = |hash: u64, lip: &LipSide| (hash ^ bytemuck::cast::<_, u64>(*lip)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let now = Self { vertex: v, strips: strips.len(), sides: strips.lip_sides(v).iter().fold(1, with) };
        std::mem::replace(self, now) == now
    }
}

impl TestedEnd {
    /// For as many strips as lips mostly know, where wounds cross too.
    fn with_room() -> Self {
        let around = StripsAround { strips: Vec::with_capacity(64), ..StripsAround::default() };
        Self { of: VertexKey::default(), around, views: LipViews { views: Vec::with_capacity(16) } }
    }

    fn look(&mut self, strips: &Strips, v: VertexId) {
        if !self.of.renew(strips, v) {
            self.forget();
        }
    }

    /// Keeps the buffers alone.
    fn forget(&mut self) {
        self.around.is_known = false;
        self.views.views.clear();
    }
}

impl StripsAround {
    fn of(&mut self, strips: &Strips, rest: &[DVec3], v: VertexId) -> &Self {
        if !self.is_known {
            self.is_known = true;
            list_strips_around(strips, v, &mut self.strips, |k| (k, 0));
            self.strips.iter_mut().for_each(|(k, code)| *code = strips.code_of(*k as usize, rest, v));
            self.is_beyond = strips.is_beyond_own(rest, v);
        }
        self
    }
}

/// Lists the strips that a vertex may know its side of, each by its `entry`: those that it is a lip of, and those that share an edge with
/// one. Oldest first, each once.
fn list_strips_around<T: Ord>(strips: &Strips, v: VertexId, list: &mut Vec<T>, entry: impl Fn(u32) -> T) {
    list.clear();
    let sides = strips.lip_sides(v);
    if sides.is_empty() {
        return;
    }
    list.extend(sides.iter().flat_map(|lip| strips.around(lip.strip as usize)).map(|k| entry(k as u32)));
    list.sort_unstable();
    list.dedup();
}

/// The strips near one particle.
#[derive(Clone, Debug, Default)]
struct NearStrips {
    anchor: VertexId,
    /// Strips looked at: all before this one.
    seen: usize,
    /// Number of the anchor's lip sides when the outcodes were worked out.
    lips: usize,
    parting: Parting,
}

/// The strips that a particle's links may meet, by particle.
#[derive(Clone, Debug, Default)]
struct StripLists {
    /// Oldest first, with the anchor's outcode; 0 where its known side stands against geometry.
    strips: Lists<(u32, u16)>,
    /// How the anchor sees them, [`BATCH`] after [`BATCH`].
    sights: Lists<Sights>,
    /// Strips that the anchor may know its side of and that are not among them.
    unlisted: Lists<u32>,
}

/// The strips of one particle.
#[derive(Clone, Copy)]
struct Listed<'a> {
    strips: &'a [(u32, u16)],
    sights: &'a [Sights],
    unlisted: &'a [u32],
}

/// [`Sight`] of [`BATCH`] strips, one a lane, with their bounds.
#[derive(Clone, Copy, Debug)]
struct Sights {
    bounds: [Vec3A; 2],
    /// Coordinates of the normals of each of the four planes.
    normals: [[Vec4; 3]; 4],
    /// [`Sight::before`].
    before: [Vec4; 4],
}

impl Sights {
    const NONE: Self = Self {
        bounds: [Vec3A::INFINITY, Vec3A::NEG_INFINITY],
        normals: [[Vec4::ZERO; 3]; 4],
        before: [Vec4::ZERO, Vec4::ZERO, Vec4::ZERO, Vec4::INFINITY],
    };

    fn set(&mut self, lane: usize, sight: &Sight, (low, high): (DVec3, DVec3)) {
        self.bounds = [self.bounds[0].min(below(low)), self.bounds[1].max(above(high))];
        for (plane, normals) in self.normals.iter_mut().enumerate() {
            for (d, normals) in normals.iter_mut().enumerate() {
                normals[lane] = sight.normals[d][plane];
            }
        }
        self.before.iter_mut().zip(sight.before).for_each(|(before, own)| before[lane] = own);
    }

    /// False only if no link from the anchor to a point of a box can meet any of the strips: `d` is the way to the box's middle, `half` its
    /// half-width, and links go no further than `low` and `high`.
    fn may_be_met(&self, (d, half): (Vec3A, Vec3A), (low, high): (Vec3A, Vec3A), slack: Vec4) -> bool {
        if (self.bounds[0].cmpgt(high) | self.bounds[1].cmplt(low)).any() {
            return false;
        }
        let most = |[x, y, z]: [Vec4; 3]| x * d.x + y * d.y + z * d.z + (x.abs() * half.x + y.abs() * half.y + z.abs() * half.z);
        let [x, y, z, height] = self.before;
        let is_reached = most([x, y, z]).cmpge(height + slack);
        let [a, b, c, d] = self.normals.map(|plane| most(plane).cmpge(slack));
        (is_reached & a & b & c & d).any()
    }

    /// Lanes whose strips a link may meet that goes by `d` and no further than `low` and `high`.
    #[inline]
    fn met(&self, d: Vec3A, (low, high): (Vec3A, Vec3A), slack: Vec4) -> u32 {
        if (self.bounds[0].cmpgt(high) | self.bounds[1].cmplt(low)).any() {
            return 0;
        }
        let along = |[x, y, z]: [Vec4; 3]| x * d.x + y * d.y + z * d.z;
        let [x, y, z, height] = self.before;
        let is_reached = along([x, y, z]).cmpge(height + slack);
        let [a, b, c, d] = self.normals.map(|plane| along(plane).cmpge(slack));
        (is_reached & a & b & c & d).bitmask()
    }
}

/// How a vertex lies to the strips that it knows its side of.
#[derive(Clone, Debug, Default)]
struct LipViews {
    views: Vec<(usize, LipView)>,
}

impl LipViews {
    fn view(&mut self, strips: &Strips, rest: &[DVec3], (v, k): (VertexId, usize), known: KnownSide) -> &LipView {
        let at = self.views.iter().position(|view| view.0 == k).unwrap_or_else(|| {
            self.views.push((k, strips.lip_view(k, rest, v, known)));
            self.views.len() - 1
        });
        &self.views[at].1
    }
}

/// A link that is being tested.
struct LinkUnderTest<'a> {
    strips: &'a Strips,
    rest: &'a [DVec3],
    anchor: VertexId,
    v: VertexId,
    /// Whether the anchor knows its side of any strip.
    is_lip: bool,
    /// Of the anchor and of `v`.
    views: [&'a mut LipViews; 2],
}

impl LinkUnderTest<'_> {
    fn ends(&self) -> [DVec3; 2] {
        [self.anchor, self.v].map(|end| self.rest[end.index()])
    }

    /// [`Strips::crosses`].
    fn crosses(&mut self, k: u32) -> bool {
        let k = k as usize;
        let (strips, rest, views, ends) = (self.strips, self.rest, &mut self.views, [self.anchor, self.v]);
        let known_ends = ends.map(|end| strips.link_end(k, rest, end));
        let crosses =
            strips.geometry(k).crosses_viewed(known_ends, |end, known| views[end].view(strips, rest, (ends[end], k), known));
        crosses && !strips.are_of_one_lip(k, ends)
    }

    /// The same with the outcodes of both ends. Where geometry says of both what is known of them, it settles most.
    fn crosses_coded(&mut self, k: u32, codes: [u16; 2]) -> bool {
        if StripGeometry::planes_part(codes[0], codes[1]) {
            return false;
        }
        let [a, p] = self.ends();
        if !self.is_lip && !codes.contains(&0) { self.strips.geometry(k as usize).crosses(a, p) } else { self.crosses(k) }
    }

    /// The same with the anchor's outcode, and that of `v` where `around` has it.
    fn crosses_listed(&mut self, (k, code): (u32, u16), around: &StripsAround) -> bool {
        let [a, p] = self.ends();
        match around.strips.iter().find(|a| a.0 == k) {
            Some(&(_, own)) => self.crosses_coded(k, [code, own]),
            None if code == 0 || around.is_beyond => self.crosses(k),
            None => {
                let k = k as usize;
                self.strips.geometry(k).crosses(a, p) && !(self.is_lip && self.strips.are_of_one_lip(k, [self.anchor, self.v]))
            }
        }
    }
}

impl NearStrips {
    /// A strip between the anchor and `v`, if there is one. `around` are the strips that `v` may know its side of, `batches` the [`Sights`]
    /// that the link may meet, newest first.
    fn parted_by(
        &mut self,
        link: &mut LinkUnderTest<'_>,
        listed: Listed<'_>,
        radius: f64,
        around: &StripsAround,
        batches: &[usize],
    ) -> Option<u32> {
        let [a, p] = link.ends();
        let (d, slack) = ((p - a).as_vec3a(), Vec4::splat(Sight::slack(radius)));
        let bounds = (below(a.min(p)), above(a.max(p)));
        // where a link is tested from elsewhere, what it looks like from here tells nothing
        let met = |batch: usize| if around.is_beyond { ALL } else { listed.sights[batch].met(d, bounds, slack) };
        let is_met = |i: usize| met(i / BATCH) >> (i % BATCH) & 1 == 1;
        let parts = |i: usize| listed.strips.get(i).is_some_and(|&strip| is_met(i) && link.crosses_listed(strip, around));
        if let Some(i) = self.parting.find(parts) {
            return Some(listed.strips[i].0);
        }
        let all = around.is_beyond.then(|| (0..listed.sights.len()).rev());
        let seen = if around.is_beyond { &[] } else { batches };
        for batch in all.into_iter().flatten().chain(seen.iter().copied()) {
            let mut met = met(batch);
            while met != 0 {
                let i = BATCH * batch + met.trailing_zeros() as usize;
                met &= met - 1;
                if let Some(&strip) = listed.strips.get(i)
                    && link.crosses_listed(strip, around)
                {
                    self.parting.push(i);
                    return Some(strip.0);
                }
            }
        }
        // a known side may stand against geometry, so those strips are tested wherever they are
        let mut older = listed.strips;
        for &(k, own) in around.strips.iter().rev() {
            while let [rest @ .., (last, _)] = older
                && *last > k
            {
                older = rest;
            }
            let code = older.last().filter(|s| s.0 == k).map_or(0, |s| s.1);
            if link.crosses_coded(k, [code, own]) {
                return Some(k);
            }
        }
        listed.unlisted.iter().copied().find(|&k| link.crosses(k))
    }
}

impl StripLists {
    fn of(&self, j: ParticleId) -> Listed<'_> {
        let j = j.index();
        Listed { strips: self.strips.get(j), sights: self.sights.get(j), unlisted: self.unlisted.get(j) }
    }

    fn empty(&mut self, j: ParticleId) {
        self.strips.empty(j.index());
        self.sights.empty(j.index());
        self.unlisted.empty(j.index());
    }

    /// Adds a strip to those of a particle.
    fn push(&mut self, strips: &Strips, rest: &[DVec3], (j, anchor): (ParticleId, VertexId), reach: f64, k: usize) {
        let lane = self.strips.get(j.index()).len();
        if lane.is_multiple_of(BATCH) {
            self.sights.push(j.index(), Sights::NONE);
        }
        self.strips.push(j.index(), (k as u32, 0));
        self.look(strips, rest, (j, anchor), reach, lane);
    }

    /// Works out how the anchor sees the strip at a place of the particle's list.
    fn look(&mut self, strips: &Strips, rest: &[DVec3], (j, anchor): (ParticleId, VertexId), reach: f64, place: usize) {
        let listed = &mut self.strips.get_mut(j.index())[place];
        let k = listed.0 as usize;
        let code = strips.code_of(k, rest, anchor);
        listed.1 = code;
        let (at, geometry) = (rest[anchor.index()], strips.geometry(k));
        let (sight, bounds) = match code {
            0 => (Sight::everywhere(at), (DVec3::NEG_INFINITY, DVec3::INFINITY)),
            _ => (geometry.sight(at, reach), (geometry.low, geometry.high)),
        };
        if let Some(sights) = self.sights.get_mut(j.index()).get_mut(place / BATCH) {
            sights.set(place % BATCH, &sight, bounds);
        }
    }
}

impl LinkTests {
    /// Forgets all strips.
    pub(super) fn clear(&mut self) {
        self.particles.clear();
        self.lists.strips.clear();
        self.lists.sights.clear();
        self.lists.unlisted.clear();
        self.ends.iter_mut().chain([&mut self.spare_end]).for_each(TestedEnd::forget);
    }

    /// True if no strip lies between the anchor of `j` and the vertex `v`, which is within the particle's radius. Other particles that
    /// strips part from the vertex have `asked` before: a few strips are all around a shred.
    pub(super) fn connects(
        &mut self,
        all: (&Strips, &[DVec3], &ParticleMap, &ParticleSettings),
        (j, v): (ParticleId, VertexId),
        asked: &mut AskedFirst,
    ) -> bool {
        let (strips, rest, map, _) = all;
        if asked.parts(strips, rest, map.anchors[j.index()], v) {
            return false;
        }
        let mut parted = None;
        self.each_near(all, j, &[v], |_, by| parted = by);
        parted.into_iter().for_each(|k| asked.note(k));
        parted.is_none()
    }

    /// Tells of each of `vertices`, which lie near one another and within the radius of `j`, a strip that parts it from the anchor, if one
    /// does.
    pub(super) fn each_near(
        &mut self,
        (strips, rest, map, settings): (&Strips, &[DVec3], &ParticleMap, &ParticleSettings),
        j: ParticleId,
        vertices: &[VertexId],
        mut tell: impl FnMut(VertexId, Option<u32>),
    ) {
        let radius = settings.radius_of(map, j);
        self.tested += vertices.len();
        self.bring_up(strips, rest, map, radius, j);
        let anchor = map.anchors[j.index()];
        let at = rest[anchor.index()];
        let grow = |(low, high): (DVec3, DVec3), v: &VertexId| (low.min(rest[v.index()]), high.max(rest[v.index()]));
        let (low, high) = vertices.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), grow);
        let to = ((0.5 * (low + high) - at).as_vec3a(), (0.5 * (high - low)).as_vec3a());
        let (bounds, slack) = ((below(at.min(low)), above(at.max(high))), Vec4::splat(Sight::slack(radius)));
        self.make_ends();
        let Self { particles, lists, batches, ends, spare_end, .. } = self;
        let (near, listed) = (&mut particles[j.index()], lists.of(j));
        batches.clear();
        let sights = listed.sights.iter().enumerate().rev();
        batches.extend(sights.filter(|(_, sights)| sights.may_be_met(to, bounds, slack)).map(|(batch, _)| batch));
        // a vertex that shares the anchor's place gets what was spare
        std::mem::swap(&mut ends[anchor.index() % ENDS], spare_end);
        let from = &mut *spare_end;
        from.look(strips, anchor);
        for &v in vertices {
            let to = &mut ends[v.index() % ENDS];
            to.look(strips, v);
            let TestedEnd { around, views, .. } = to;
            let is_lip = near.lips > 0;
            let mut link = LinkUnderTest { strips, rest, anchor, v, is_lip, views: [&mut from.views, views] };
            tell(v, near.parted_by(&mut link, listed, radius, around.of(strips, rest, v), batches));
        }
        std::mem::swap(&mut ends[anchor.index() % ENDS], spare_end);
    }

    #[inline]
    fn make_ends(&mut self) {
        if self.ends.is_empty() {
            self.ends.resize_with(ENDS, TestedEnd::with_room);
        }
    }

    /// Makes room for the strips of all particles that there are.
    pub(super) fn make_room(&mut self, particles: usize) {
        self.make_ends();
        self.particles.reserve(with_headroom(particles));
        self.lists.strips.reserve(ROOM);
        self.lists.sights.reserve(ROOM / BATCH);
        self.lists.unlisted.reserve(ROOM / BATCH);
        self.found.reserve(FOUND);
        self.batches.reserve(FOUND);
        self.spare_end = TestedEnd::with_room();
    }

    /// Finds the strips near a particle that have come since it was last looked at.
    fn bring_up(&mut self, strips: &Strips, rest: &[DVec3], map: &ParticleMap, reach: f64, j: ParticleId) {
        fit(&mut self.particles, map.len(), NearStrips::default());
        let Self { particles, lists, found, .. } = self;
        let near = &mut particles[j.index()];
        let anchor = map.anchors[j.index()];
        let lips = strips.lip_sides(anchor);
        if near.anchor != anchor {
            *near = NearStrips { anchor, ..NearStrips::default() };
            lists.empty(j);
        }
        let is_stale = near.lips != lips.len() || near.seen < strips.len();
        if near.lips != lips.len() {
            near.lips = lips.len();
            lists.sights.get_mut(j.index()).fill(Sights::NONE);
            for place in 0..lists.strips.get(j.index()).len() {
                lists.look(strips, rest, (j, anchor), reach, place);
            }
        }
        if near.seen < strips.len() {
            let at = rest[anchor.index()];
            let from = near.seen;
            let mut look = |k: usize| {
                let geometry = strips.geometry(k);
                let far = reach + geometry.margin;
                if at.cmpge(geometry.low - far).all() && at.cmple(geometry.high + far).all() {
                    lists.push(strips, rest, (j, anchor), reach, k);
                }
            };
            if strips.len() - from <= FEW {
                (from..strips.len()).for_each(look);
            } else {
                let far = reach + strips.largest_margin();
                strips.near(at - far, at + far, found);
                found.iter().filter(|&&k| k as usize >= from).for_each(|&k| look(k as usize));
            }
            near.seen = strips.len();
        }
        if is_stale {
            lists.unlisted.empty(j.index());
            list_strips_around(strips, anchor, found, |k| k);
            for &k in &*found {
                if lists.strips.get(j.index()).binary_search_by_key(&k, |s| s.0).is_err() {
                    lists.unlisted.push(j.index(), k);
                }
            }
        }
    }
}
