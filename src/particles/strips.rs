//! Strips: what a tear leaves behind so that nothing links across it, now or later (MATHS 3.2).
//!
//! A plane cut leaves none: it parts every edge it meets, so what it separates is no longer connected, and the sheet rule
//! links nothing that is not connected.

use super::holders::VertexSet;
use super::particle_map::ParticleMap;
use super::places::Places;
use super::settings::ParticleSettings;
pub use super::slit_line::Strip;
use super::slit_line::{Along, NONE};
use super::strip_test::{KnownSide, LinkEnd, LipView, StripGeometry};
use super::wound_lines::WoundRange;
use crate::geometry::room::{fit, headroom, rows_headroom, with_headroom};
use crate::geometry::{Delta, Mesh, ParticleId, SlotCsr, SlotCsrDelta, StateHash, Tracked, VertexId};
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use parry3d::bounding_volume::Aabb;
use parry3d::partitioning::Bvh;
use std::sync::Arc;
use thiserror::Error;

/// Strips that room is made for at first.
pub(super) const STROKES_ROOM: usize = 512;
/// Strips that a vertex is a lip of, as many as there is room for at first.
const LIPS_ROOM: usize = 32;

/// Which side of a strip a lip vertex is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct LipSide {
    /// Index of the strip.
    pub strip: u32,
    /// +1 on the side of the strip's normal `(tip1 - tip0) x (base - tip)`, -1 on the other.
    pub side: i32,
}

/// A wound particle of a slit and where along it the particle sits.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct WoundMark {
    /// The particle.
    pub particle: ParticleId,
    /// Index of the strip whose lip it is on.
    pub strip: u32,
    /// Distance along the strip from its earlier end, metres.
    pub along: f64,
    /// +1 or -1, as [`LipSide::side`].
    pub side: i32,
    /// How far out its lip belongs since the blade has left the wound, metres; 0 before.
    pub lip: f32,
}

/// Why a strip was refused.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum StripError {
    /// A corner or the reach is not finite, or the reach is negative.
    #[error("a strip needs finite corners and a finite reach of 0 or more")]
    NotFinite,
}

/// All strips of a tissue, its lip vertices and its wound particles' places. Kept for the tissue's life.
#[derive(Clone, Default)]
pub struct Strips {
    pub(super) strips: Tracked<Strip>,
    /// Row a vertex (rows: those at first, and as many more as the last edit needed).
    pub(super) lips: SlotCsr<LipSide>,
    /// Vertices that are or once were lips: most are none, and a bit says so where a row is far away. Not hashed.
    known_lips: VertexSet,
    pub(super) wounds: Tracked<WoundMark>,
    /// Not hashed.
    pub(super) derived: Arc<StripsDerived>,
    /// Largest [`StripGeometry::margin`] of all strips that ever were, metres.
    largest_margin: f64,
    /// Scratch.
    row: Vec<LipSide>,
    /// StripsDerived from mesh and particle map by the updates; not hashed.
    pub(super) places: Places,
}

/// What is derived from strips, one for one. Pieces that come off together share it until one of them is torn on its own.
#[derive(Clone, Default)]
pub(crate) struct StripsDerived {
    geometry: Vec<StripGeometry>,
    along: Vec<Along>,
    pub(super) ranges: Vec<WoundRange>,
    bvh: Bvh,
}

/// What an edit changed in [`Strips`].
#[derive(Clone, Debug, Default)]
pub struct StripsDelta {
    /// Changes of the strips.
    pub strips: Delta<Strip>,
    /// Changes of the lip vertices.
    pub lips: SlotCsrDelta<LipSide>,
    /// Changes of the wound particles' places.
    pub wounds: Delta<WoundMark>,
}

impl StripsDelta {
    /// [`Delta::make_room`] for every list.
    pub fn make_room(&mut self, edits: usize) {
        self.strips.make_room(edits);
        self.lips.make_room(edits);
        self.wounds.make_room(edits);
    }

    /// True if nothing changed.
    pub fn is_empty(&self) -> bool {
        self.strips.is_empty() && self.lips.is_empty() && self.wounds.is_empty()
    }

    /// Heap bytes held.
    pub fn heap_bytes(&self) -> usize {
        self.strips.heap_bytes() + self.lips.heap_bytes() + self.wounds.heap_bytes()
    }

    /// Adds what the next edit changed.
    pub fn append(&mut self, later: &Self) {
        self.strips.append(&later.strips);
        self.lips.append(&later.lips);
        self.wounds.append(&later.wounds);
    }
}

impl std::fmt::Debug for Strips {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Strips").field("strips", &self.strips.len()).field("wounds", &self.wounds.len()).finish_non_exhaustive()
    }
}

impl Strips {
    /// None yet, with rows for so many vertices: the first tear is not to bring them all.
    pub fn for_vertices(vertices: usize) -> Self {
        Self { lips: SlotCsr::with_rows(vertices), ..Self::default() }
    }

    /// Number of strips.
    pub fn len(&self) -> usize {
        self.strips.len()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.strips.is_empty()
    }

    /// All strips, oldest first.
    pub fn as_slice(&self) -> &[Strip] {
        &self.strips
    }

    /// Wound particles in the order they were made; some may be retired.
    pub fn wounds(&self) -> &[WoundMark] {
        &self.wounds
    }

    /// Number of the next slit, for [`Strips::push`].
    pub fn next_slit(&self) -> u32 {
        self.strips.last().map_or(0, |s| s.slit + 1)
    }

    /// The sides that a vertex is known to be on; empty for all but lip vertices.
    pub fn lip_sides(&self, v: VertexId) -> &[LipSide] {
        if self.known_lips.contains(v) && v.index() < self.lips.rows() { self.lips.row(v.index()) } else { &[] }
    }

    /// Marks a vertex as a lip of `strip` on `side`. A mark for the same strip is replaced.
    pub fn set_lip(&mut self, v: VertexId, strip: usize, side: i8) {
        let new = LipSide { strip: strip as u32, side: i32::from(side.signum()) };
        if side == 0 || self.lip_sides(v).contains(&new) {
            return;
        }
        self.lips.grow_rows(v.index() + 1);
        let row = &mut self.row;
        row.clear();
        row.extend(self.lips.row(v.index()).iter().filter(|l| l.strip != new.strip));
        row.push(new);
        row.sort_unstable_by_key(|l| l.strip);
        self.lips.set_row(v.index(), row);
        self.known_lips.insert(v);
        self.places.note_lip(v, strip);
    }

    /// Vertices that may know their side of strip `k`: lips of it and of the strips before and after it, and some that are none.
    pub(super) fn lips_near(&self, k: usize) -> impl Iterator<Item = &VertexId> {
        self.around(k).flat_map(|strip| self.lips_of(strip))
    }

    /// Vertices that are or once were lips of strip `k`.
    pub(super) fn lips_of(&self, k: usize) -> &[VertexId] {
        self.places.lips.get(k)
    }

    /// Those of them that live.
    pub(super) fn live_lips<'a>(&'a self, mesh: &'a Mesh, k: usize) -> impl Iterator<Item = VertexId> + 'a {
        self.lips_of(k).iter().copied().filter(|v| v.index() < mesh.vertex_slots() && mesh.vertex_is_live(*v))
    }

    /// True if the segment between two rest positions crosses no strip.
    pub fn connects(&self, a: DVec3, b: DVec3) -> bool {
        let query = aabb(a.min(b), a.max(b));
        !self.derived.bvh.intersect_aabb(&query).any(|k| self.geometry(k as usize).crosses(a, b))
    }

    /// [`Strips::connects`] for two vertices: lip vertices are tested by their known side.
    pub fn connects_vertices(&self, rest: &[DVec3], a: VertexId, b: VertexId) -> bool {
        let mut connects = true;
        self.each_crossed(rest, a, b, |_| {
            connects = false;
            true
        });
        connects
    }

    /// Tells the strips that the link between two vertices crosses, some twice, until `is_enough`.
    pub(super) fn each_crossed(&self, rest: &[DVec3], a: VertexId, b: VertexId, mut is_enough: impl FnMut(usize) -> bool) {
        let (p, q) = (rest[a.index()], rest[b.index()]);
        let images = self.images(rest, a).chain(self.images(rest, b));
        let (low, high) = images.fold((p.min(q), p.max(q)), |(low, high), p| (low.min(p), high.max(p)));
        let query = aabb(low, high);
        if self.derived.bvh.intersect_aabb(&query).any(|k| self.crosses(k as usize, rest, a, b) && is_enough(k as usize)) {
            return;
        }
        // A known side may stand against geometry, so those strips are tested wherever the segment lies.
        let known = self.lip_sides(a).iter().chain(self.lip_sides(b));
        known.flat_map(|l| self.around(l.strip as usize)).any(|k| self.crosses(k, rest, a, b) && is_enough(k));
    }

    /// True if the link between two vertices crosses strip `k`.
    pub fn crosses(&self, k: usize, rest: &[DVec3], a: VertexId, b: VertexId) -> bool {
        let ends = [a, b];
        let view = |end: usize, known| self.lip_view(k, rest, ends[end], known);
        self.geometry(k).crosses_viewed(ends.map(|end| self.link_end(k, rest, end)), view) && !self.are_of_one_lip(k, ends)
    }

    /// True if two vertices are lips of the slit of strip `k`, on one side of it, and little turns between them and it: the tissue goes
    /// along the slit from one to the other, and where that bends the straight way between the outer lips leads through it.
    pub(super) fn are_of_one_lip(&self, k: usize, [a, b]: [VertexId; 2]) -> bool {
        let along = &self.derived.along;
        let is_near = |lip: &&LipSide| along[lip.strip as usize].is_in_line(&along[k]);
        let others = self.lip_sides(b).iter().filter(is_near);
        let mut lips = self.lip_sides(a).iter().filter(is_near);
        let in_line = |lip: &LipSide, other: &LipSide| along[lip.strip as usize].is_in_line(&along[other.strip as usize]);
        lips.any(|lip| others.clone().any(|other| other.side == lip.side && in_line(lip, other)))
    }

    /// A vertex as the end of a link that may cross strip `k`.
    pub(super) fn link_end(&self, k: usize, rest: &[DVec3], v: VertexId) -> LinkEnd {
        let side = self.known_side(k, v);
        // one that knows its side is looked at by its view
        let image = if side.is_none() { self.image(k, rest, v) } else { None };
        LinkEnd { at: image.unwrap_or(rest[v.index()]), side }
    }

    /// Where links of a vertex across strip `k` are tested from that is a lip of a strip in line with `k` and lies beyond that one: its
    /// mirror image, which is on its side ([`StripGeometry::on_side`]), if that is no farther away than the margin that links across `k`
    /// are looked for within. Where tissue was drawn out of all shape as it was cut, a lip may be anywhere beside its strip.
    pub(super) fn image(&self, k: usize, rest: &[DVec3], v: VertexId) -> Option<DVec3> {
        let along = &self.derived.along;
        let in_line = |lip: &&LipSide| along[lip.strip as usize].is_in_line(&along[k]);
        let within = |image: &DVec3| image.distance(rest[v.index()]) <= self.geometry(k).margin;
        self.lip_sides(v).iter().filter(in_line).find_map(|lip| self.image_by(lip, rest, v)).filter(within)
    }

    fn image_by(&self, lip: &LipSide, rest: &[DVec3], v: VertexId) -> Option<DVec3> {
        self.geometry(lip.strip as usize).on_side(rest[v.index()], lip.side as i8)
    }

    /// All mirror images of a vertex that lies beyond strips that it is a lip of: mostly none.
    fn images<'a>(&'a self, rest: &'a [DVec3], v: VertexId) -> impl Iterator<Item = DVec3> + 'a {
        self.lip_sides(v).iter().filter_map(move |lip| self.image_by(lip, rest, v))
    }

    /// True if a vertex lies beyond a strip that it is a lip of: its links are tested from elsewhere than where it is.
    pub(super) fn is_beyond_own(&self, rest: &[DVec3], v: VertexId) -> bool {
        self.images(rest, v).next().is_some()
    }

    /// False if no lip of strip `m` lies beyond a strip of its own, which is looked up once for as long as it gets no other lips.
    pub(super) fn may_have_lips_beyond(&mut self, rest: &[DVec3], m: usize) -> bool {
        fit(&mut self.places.none_beyond, m + 1, false);
        if !self.places.none_beyond[m] {
            let is_beyond = |v: &VertexId| v.index() < rest.len() && self.is_beyond_own(rest, *v);
            self.places.none_beyond[m] = !self.lips_of(m).iter().any(is_beyond);
        }
        !self.places.none_beyond[m]
    }

    /// The strip that strip `m` goes on from, if little turns between that and strip `k` and its bounds are within `reach` of those of `k`.
    pub(super) fn last_in_line(&self, m: usize, k: usize, reach: f64) -> Option<usize> {
        let StripGeometry { low, high, .. } = *self.geometry(k);
        let along = &self.derived.along;
        self.last_of(m).filter(|&l| along[l].is_in_line(&along[k]) && !self.geometry(l).is_beside(low, high, reach))
    }

    /// How a vertex that knows its side of strip `k` lies to it.
    pub(super) fn lip_view(&self, k: usize, rest: &[DVec3], v: VertexId, known: KnownSide) -> LipView {
        let at = rest[v.index()];
        self.geometry(k).view_of_lip(at, known, self.telling_lip(k, v).and_then(|lip| self.beside(k, lip, at)))
    }

    /// Where a vertex at `at` that knows its side of strip `k` by `lip`, of a neighbour of it, is on its side of that one, if it lies
    /// beyond it.
    fn beside(&self, k: usize, lip: &LipSide, at: DVec3) -> Option<DVec3> {
        let by = lip.strip as usize;
        if by == k { None } else { self.geometry(by).on_side(at, lip.side as i8) }
    }

    /// Outcode of a vertex to strip `k`; 0, which parts it from nothing, where it knows its side and geometry does not say the same, and where
    /// its links are tested from elsewhere.
    pub(super) fn code_of(&self, k: usize, rest: &[DVec3], v: VertexId) -> u16 {
        let code = self.geometry(k).outcode(rest[v.index()]);
        let stands_against =
            |lip: &LipSide| !StripGeometry::is_on_side(code, lip.side as i8) || self.beside(k, lip, rest[v.index()]).is_some();
        let is_elsewhere = match self.telling_lip(k, v) {
            Some(lip) => stands_against(lip),
            None => self.image(k, rest, v).is_some(),
        };
        if is_elsewhere { 0 } else { code }
    }

    /// True if `v` knows its side of strip `k`, whatever geometry says.
    pub fn knows_side(&self, k: usize, v: VertexId) -> bool {
        self.known_side(k, v).is_some()
    }

    /// True if `v` knows its side of strip `k` from being a lip of strip `by` and from nothing else.
    pub(super) fn knows_side_by(&self, k: usize, by: usize, v: VertexId) -> bool {
        self.telling_lip(k, v).is_some_and(|l| l.strip as usize == by)
    }

    /// Side of strip `k` that `v` is known to be on, from the strip itself or from a neighbour in its slit.
    pub(super) fn known_side(&self, k: usize, v: VertexId) -> Option<KnownSide> {
        let found = self.telling_lip(k, v)?;
        Some(KnownSide { side: found.side as i8, own: found.strip as usize == k })
    }

    /// The mark that tells the side of strip `k`: its own, else that of the strip before it in its slit, else of the one after it.
    fn telling_lip(&self, k: usize, v: VertexId) -> Option<&LipSide> {
        let sides = self.lip_sides(v);
        if sides.is_empty() {
            return None;
        }
        let Along { last, next, .. } = self.derived.along[k];
        let mut by = [None; 2];
        for lip in sides {
            match lip.strip {
                strip if strip as usize == k => return Some(lip),
                strip if strip == last => by[0] = Some(lip),
                strip if strip == next => by[1] = Some(lip),
                _ => {}
            }
        }
        by[0].or(by[1])
    }

    /// The strip that strip `k` goes on from, if there is one: they share an edge.
    pub(super) fn last_of(&self, k: usize) -> Option<usize> {
        Some(self.derived.along[k].last).filter(|&m| m != NONE).map(|m| m as usize)
    }

    /// True if strip `k` goes on from another: they share an edge.
    pub fn goes_on(&self, k: usize) -> bool {
        self.last_of(k).is_some()
    }

    /// Strip `k` and those that share an edge with it, in the order of the blade.
    pub(super) fn around(&self, k: usize) -> impl Iterator<Item = usize> + use<> {
        let Along { last, next, .. } = self.derived.along[k];
        [last, k as u32, next].into_iter().filter(|&m| m != NONE).map(|m| m as usize)
    }

    /// The extended geometry of strip `k`.
    pub fn geometry(&self, k: usize) -> &StripGeometry {
        &self.derived.geometry[k]
    }

    /// Strips whose extended bounds meet a box, sorted, into `out` (cleared first).
    pub fn near(&self, low: DVec3, high: DVec3, out: &mut Vec<u32>) {
        out.clear();
        out.extend(self.derived.bvh.intersect_aabb(&aabb(low, high)));
        out.sort_unstable();
    }

    /// First strip of the slit that strip `k` belongs to.
    pub fn slit_start(&self, k: usize) -> usize {
        self.derived.along[k].start
    }

    /// At least the largest [`StripGeometry::margin`] of all strips, metres.
    pub(super) fn largest_margin(&self) -> f64 {
        self.largest_margin
    }

    /// Prepares for updates of this mesh and map: the first update would do it, in one pass over the model; done at
    /// load, no tear pays for it.
    pub fn prepare(&mut self, rest: &[DVec3], map: &ParticleMap, settings: &ParticleSettings) {
        if !self.places.is_built {
            self.places = Places::build(rest, map, &self.lips, settings);
        }
    }

    /// The same in an update.
    pub(super) fn prepare_late(&mut self, rest: &[DVec3], map: &ParticleMap, settings: &ParticleSettings) {
        if !self.places.is_built {
            self.prepare(rest, map, settings);
            self.places.is_late = true;
        }
    }

    /// Makes room for the strips, and all that goes with them, of many strokes through this many vertices and particles.
    pub fn make_room(&mut self, vertices: usize, particles: usize) {
        self.strips.make_room();
        self.lips.reserve(headroom(vertices), rows_headroom(vertices));
        self.known_lips.reserve(headroom(vertices), with_headroom(vertices));
        self.wounds.make_room();
        self.row.reserve(LIPS_ROOM);
        let derived = Arc::make_mut(&mut self.derived);
        derived.geometry.reserve(STROKES_ROOM);
        derived.along.reserve(STROKES_ROOM);
        derived.ranges.reserve(STROKES_ROOM);
        self.places.make_room(vertices, particles);
        if derived.bvh.is_empty() {
            // a tree keeps the room of its leaves
            let leaf = |k: u32| aabb(DVec3::splat(f64::from(k)), DVec3::splat(f64::from(k)));
            (0..STROKES_ROOM as u32).for_each(|k| derived.bvh.insert(leaf(k), k));
            (0..STROKES_ROOM as u32).for_each(|k| derived.bvh.remove(k));
        }
    }

    /// What is derived from the strips, for pieces that come off together: this tissue goes on with its own, and the room that it has.
    pub(crate) fn derived_copy(&self) -> Arc<StripsDerived> {
        Arc::new((*self.derived).clone())
    }

    /// The strips as a severed piece keeps them: all of them, with the lips of its own vertices; wound marks are to follow by
    /// [`Strips::take_wounds`]. `vertices[new]` is the old vertex of each of the piece's, `derived` [`Strips::derived_copy`].
    pub(crate) fn extract(&self, vertices: &[VertexId], derived: &Arc<StripsDerived>) -> Self {
        let known = self.lips.rows();
        let row = |v: &VertexId| (v.index() < known).then(|| v.index());
        let lips = match self.len() {
            0 => SlotCsr::with_rows(vertices.len()),
            _ => self.lips.gather(vertices.iter().map(row), |lip| *lip),
        };
        Self {
            strips: self.strips.to_vec().into(),
            known_lips: (0..lips.rows()).filter(|&v| !lips.row(v).is_empty()).map(VertexId::new).collect(),
            lips,
            derived: derived.clone(),
            largest_margin: self.largest_margin,
            ..Self::default()
        }
    }

    /// Takes over the wound marks of `whole` that name a particle of this piece. `particles[new]` is the old particle of each
    /// of the piece's, ascending, [`ParticleId::NONE`] last.
    pub fn take_wounds(&mut self, whole: &Self, particles: &[ParticleId]) {
        let renamed = |mark: &WoundMark| {
            let new = particles.binary_search(&mark.particle).ok()?;
            Some(WoundMark { particle: ParticleId::new(new), ..*mark })
        };
        self.wounds = whole.wounds.iter().filter_map(renamed).collect::<Vec<_>>().into();
    }

    /// Everything changed since the last call.
    pub fn take_delta(&mut self) -> StripsDelta {
        let mut delta = StripsDelta::default();
        self.take_delta_into(&mut delta);
        delta
    }

    /// The same into a delta whose room is used again.
    pub fn take_delta_into(&mut self, delta: &mut StripsDelta) {
        self.strips.take_delta_into(&mut delta.strips);
        self.lips.take_delta_into(&mut delta.lips);
        self.wounds.take_delta_into(&mut delta.wounds);
    }

    /// Goes back by the newest delta and returns the way forward.
    pub fn apply_delta(&mut self, delta: StripsDelta) -> StripsDelta {
        let inverse = StripsDelta {
            strips: self.strips.apply(delta.strips),
            lips: self.lips.apply_delta(delta.lips),
            wounds: self.wounds.apply(delta.wounds),
        };
        self.places.note_travel();
        self.derive();
        inverse
    }

    /// Feeds strips, lips and wound marks into `hash`.
    pub fn hash_into(&self, hash: &mut StateHash) {
        self.strips.hash_into(hash);
        self.lips.hash_into(hash);
        self.wounds.hash_into(hash);
    }

    /// Checks that strips are finite, lips and wound marks name strips that exist, and derived data fit. Recomputed.
    pub fn validate(&self) -> Result<(), String> {
        for (k, strip) in self.strips.iter().enumerate() {
            if !strip.corners.iter().flatten().chain([&strip.reach]).all(|x| x.is_finite()) {
                return Err(format!("strip {k} is not finite"));
            }
            let fresh = StripGeometry::new(strip.corners.map(DVec3::from_array), strip.reach);
            if self.derived.geometry.get(k).map(|g| g.triangles) != Some(fresh.triangles) {
                return Err(format!("strip {k} has stale geometry"));
            }
        }
        if self.derived.geometry.len() != self.len() || self.derived.bvh.leaf_count() as usize != self.len() {
            return Err(format!("{} strips, {} in the tree", self.len(), self.derived.bvh.leaf_count()));
        }
        for v in 0..self.lips.rows() {
            for lip in self.lips.row(v) {
                if lip.strip as usize >= self.len() || lip.side.abs() != 1 {
                    return Err(format!("vertex {v} is a lip on side {} of strip {}", lip.side, lip.strip));
                }
            }
        }
        match self.wounds.iter().find(|m| m.strip as usize >= self.len() || m.side.abs() != 1) {
            Some(mark) => Err(format!("wound particle {:?} is on strip {}", mark.particle, mark.strip)),
            None => Ok(()),
        }
    }

    /// Brings derived data in line: strips are only ever appended, or taken away from the end by an undo.
    pub(super) fn derive(&mut self) {
        let (strips, StripsDerived { geometry, along, ranges, bvh }) = (&self.strips, Arc::make_mut(&mut self.derived));
        for k in strips.len()..geometry.len() {
            bvh.remove(k as u32);
        }
        geometry.truncate(strips.len());
        if along.len() > strips.len() {
            along.truncate(strips.len());
            let len = strips.len() as u32;
            along.iter_mut().filter(|a| a.next >= len).for_each(|a| a.next = NONE);
            ranges.clear();
            strips.iter().enumerate().for_each(|(k, strip)| WoundRange::take(ranges, k, strip));
        }
        for k in geometry.len()..strips.len() {
            let strip = &strips[k];
            let new = StripGeometry::new(strip.corners.map(DVec3::from_array), strip.reach);
            bvh.insert(aabb(new.low, new.high), k as u32);
            self.largest_margin = self.largest_margin.max(new.margin);
            geometry.push(new);
            let new = Along::new(strips, along, k);
            along.push(new);
            WoundRange::take(ranges, k, strip);
        }
    }
}

/// Bounds in f32, rounded outwards.
fn aabb(low: DVec3, high: DVec3) -> Aabb {
    let down = |x: f64| (x.clamp(-1e30, 1e30) as f32).next_down();
    let up = |x: f64| (x.clamp(-1e30, 1e30) as f32).next_up();
    let mins = Vec3::new(down(low.x), down(low.y), down(low.z));
    let maxs = Vec3::new(up(high.x), up(high.y), up(high.z));
    Aabb::new(mins, maxs)
}

#[cfg(test)]
#[path = "strips_tests.rs"]
mod tests;
