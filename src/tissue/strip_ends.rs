//! How far along its blades a strip reaches that was cut by a box or without width, where its ends are at rest, and where it is in two parts.
//!
//! A strip parts what lies on both sides of it at rest (MATHS 3.2). In a wound that stands open the blade goes through air above what it
//! cuts, and the tissue beside that air lies elsewhere at rest: there a strip ends where the cut does. Across such a wound it goes through
//! air from one lip to the other, which touch at rest: there it ends at one and begins anew at the other.

use super::TearStroke;
use crate::geometry::{FaceId, VertexId};
use crate::particles::{LipSide, share_between};
use crate::surgery::TearBox;
use crate::surgery::insert::NewVertex;
use crate::tissue::{SoftLayer, Tissue};
use glam::DVec3;

/// A box whose cut reaches so much higher in walls than in skin, in radii of influence, went on in an open wound.
const IN_WOUND: f64 = 0.1;

/// Where the tissue at both ends of a box has moved apart by more than this share of the box's way, the blade may have crossed a gap.
const APART: f64 = 0.25;

/// A part of a strip that is shorter than this share of its box's way, as it was seen or at rest, is none: a box that nicks the lip of an
/// open wound goes no way in tissue, its ends are carried to rest by other vertices, and a strip without length faces anywhere.
const LEAST_PART: f64 = 0.1;

/// What lies so near to an end of a strip's way, as a share of it, lies at that end.
const AT_END: f64 = 1e-6;

/// Skin that is no farther from a blade than so many times half the width of its cut lies on it.
const ON_BLADE: f64 = 1.5;

/// A vertex beside a blade counts as so many times farther from its ends as it is beside it.
const OFF_BLADE: f64 = 4.0;

/// Vertices on a blade that are farther apart than this share of it carry it to rest together.
const BETWEEN_FRAMES: f64 = 0.25;

/// Where a strip begins.
#[derive(Clone, Copy)]
pub(in crate::tissue) enum StripStart {
    /// Where its blade is carried to rest.
    Free,
    /// At this edge (tip, top) at rest, where another ended, and whether that one ended in the skin.
    Edge([DVec3; 2], bool),
    /// On the line of such an edge, as far down and up as its own blade reaches: a strip is as straight at rest as it was seen, which
    /// tissue that bends is not, and one that began where it is carried to would not meet the other.
    Along([DVec3; 2], bool),
}

/// An end of a strip is another's where it is no farther from it than this share of their length.
const SAME_END: f64 = 1e-3;

/// A stretch of a strip on whose way the blade crossed no gap.
#[derive(Clone, Copy)]
pub(in crate::tissue) struct StripPart {
    /// The blades `[tip, top]` at both ends as they were seen.
    pub(super) blades: [[DVec3; 2]; 2],
    /// The same at rest.
    pub(super) at_rest: [[DVec3; 2]; 2],
    /// Of a part of a strip that crosses a gap: that strip as it was seen, and the shares of its way that the part's lips lie between.
    of: Option<([[DVec3; 2]; 2], [f64; 2])>,
    /// A gap lies before it.
    pub(super) is_apart: bool,
}

/// What a box or a slit without width has cut, by which its strip finds its ends at rest.
pub(in crate::tissue) struct Swath<'a, S> {
    pub(in crate::tissue) tissue: &'a Tissue,
    /// Vertices that it has made, in order; where they are seen is told by them: no particle holds them yet.
    pub(in crate::tissue) made: &'a [NewVertex],
    /// Vertices around what it has cut.
    pub(in crate::tissue) near: &'a [VertexId],
    /// Faces that it was looked for in.
    pub(in crate::tissue) candidates: &'a [FaceId],
    /// Half the width of what it has taken out, metres.
    pub(in crate::tissue) half_width: f64,
    /// Where other vertices are seen.
    pub(in crate::tissue) elsewhere: S,
}

/// A vertex of the skin that the cut has made, and where it lies on the blade's way.
type CutLip<'a> = (&'a NewVertex, f64);

/// A vertex of the skin on a blade, where it is seen, and how far up the blade, metres.
#[derive(Clone, Copy)]
struct OnBlade {
    vertex: VertexId,
    at: DVec3,
    height: f64,
}

/// How the vertex nearest to one end of a strip carries points to rest.
struct EndFrame<F> {
    /// Where the vertex is seen.
    at: DVec3,
    to_rest: F,
    /// How much of the blade there is at rest.
    height: f64,
}

impl StripPart {
    /// A strip that crosses no gap.
    pub(in crate::tissue) fn whole(blades: [[DVec3; 2]; 2], at_rest: [[DVec3; 2]; 2]) -> Self {
        Self { blades, at_rest, of: None, is_apart: false }
    }

    /// What a blade that moves evenly sweeps, slice by slice: `at_rest` are the blades at the slices' ends.
    pub(in crate::tissue) fn slices(blades: [[DVec3; 2]; 2], at_rest: &[[DVec3; 2]]) -> impl Iterator<Item = Self> {
        let count = at_rest.len().saturating_sub(1);
        let share = move |k: usize| k as f64 / count as f64;
        at_rest.windows(2).enumerate().map(move |(k, ends)| {
            let shares =
                [if k == 0 { f64::NEG_INFINITY } else { share(k) }, if k + 1 == count { f64::INFINITY } else { share(k + 1) }];
            Self {
                blades: [k, k + 1].map(|k| blade_at(blades, share(k))),
                at_rest: [ends[0], ends[1]],
                of: Some((blades, shares)),
                is_apart: false,
            }
        })
    }

    /// Its normal at rest, twice the mean of its triangles' areas long.
    pub(super) fn normal(&self) -> DVec3 {
        let [start, end] = self.at_rest;
        (end[0] - start[1]).cross(end[1] - start[0])
    }

    /// The part of it up to a lip, a share of its way on, that reaches up the blade by `height`.
    fn until(self, tissue: &Tissue, (lip, share): CutLip<'_>, height: f64) -> Self {
        let (blade, at_rest) = self.blade(tissue, lip, (share, height));
        Self { blades: [self.blades[0], blade], at_rest: [self.at_rest[0], at_rest], ..self }
    }

    /// The part of it from a lip on.
    fn since(self, tissue: &Tissue, (lip, share): CutLip<'_>, height: f64) -> Self {
        let (blade, at_rest) = self.blade(tissue, lip, (share, height));
        Self { blades: [blade, self.blades[1]], at_rest: [at_rest, self.at_rest[1]], ..self }
    }

    /// The blade at a share of its way, as it was seen and, by the frame of a lip there, at rest.
    fn blade(&self, tissue: &Tissue, lip: &NewVertex, (share, height): (f64, f64)) -> ([DVec3; 2], [DVec3; 2]) {
        let [tip, top] = blade_at(self.blades, share.clamp(0.0, 1.0));
        let blade = [tip, tip.lerp(top, height)];
        (blade, blade.map(tissue.rest_frame(lip.vertex, lip.position)))
    }

    /// Whether it is too short for a strip; `blades` are those at both ends of its box.
    pub(super) fn is_nick(&self, blades: [[DVec3; 2]; 2]) -> bool {
        let [whole, seen, at_rest] = [blades, self.blades, self.at_rest].map(way_between);
        seen < (1.0 - 1e-9) * whole && seen.min(at_rest) < LEAST_PART * whole
    }

    /// Whether a lip that is seen at `p` is one of its.
    pub(in crate::tissue) fn holds(&self, p: impl FnOnce() -> DVec3) -> bool {
        self.of.is_none_or(|(whole, shares)| (shares[0]..shares[1]).contains(&share_of_way(whole, p())))
    }
}

impl<S: Fn(VertexId) -> DVec3> Swath<'_, S> {
    /// A vertex that the cut has made.
    fn made(&self, v: VertexId) -> Option<&NewVertex> {
        find_made(self.made, v)
    }

    /// What a vertex is a copy of, on the other lip, or the vertex.
    fn original<'a>(&'a self, n: &'a NewVertex) -> &'a NewVertex {
        let copied = |n: &&'a NewVertex| if n.parent_count == 1 { self.made(n.parents[0].0) } else { None };
        std::iter::successors(Some(n), copied).last().unwrap_or(n)
    }

    /// Where a vertex is seen while the cut is not bound yet.
    fn seen(&self, v: VertexId) -> DVec3 {
        self.made(v).map_or_else(|| (self.elsewhere)(v), |n| n.position)
    }

    /// A blade `[tip, top]`, carried to rest space by the vertices on it: the highest and the lowest, which a blade through thick tissue that
    /// bends goes through with different frames, or where they are one, by that one's frame. It ends not far above what was torn: a vertex's
    /// frame holds near it, and the next strip may have another.
    pub(in crate::tissue) fn rest_edge(&self, [tip, top]: [DVec3; 2]) -> [DVec3; 2] {
        let tissue = self.tissue;
        let up = (top - tip).normalize_or_zero();
        let near = || self.near.iter().filter(|v| tissue.mesh.vertex_is_live(**v)).map(|&v| (v, self.seen(v)));
        let highest = near().map(|(_, at)| (at - tip).dot(up)).fold(0.0, f64::max);
        let most = if highest > 0.0 { 2.0 * highest } else { f64::INFINITY };
        let length = (top - tip).length().min(most);
        let top = tip + length * up;
        // what is on the blade is farther up, or down, than what is beside it where the skin leans
        let mut ends: [Option<(f64, OnBlade)>; 2] = [None; 2];
        for (vertex, at) in near() {
            let height = (at - tip).dot(up);
            let off = at.distance(tip + height.clamp(0.0, length) * up);
            if off > ON_BLADE * self.half_width || !is_skin(tissue, vertex) {
                continue;
            }
            for (way, end) in [-1.0, 1.0].into_iter().zip(&mut ends) {
                let far = way * height - OFF_BLADE * off;
                if end.is_none_or(|best| far > best.0) {
                    *end = Some((far, OnBlade { vertex, at, height }));
                }
            }
        }
        let [Some((_, low)), Some((_, high))] = ends else {
            let seen = |v| self.seen(v);
            return match nearest_of(tissue, self.near, top, &seen).or_else(|| nearest_vertex(tissue, self.candidates, top, &seen))
            {
                Some(v) => [tip, top].map(tissue.rest_frame(v, seen(v))),
                None => [tip, top],
            };
        };
        let between = high.height - low.height;
        if between < BETWEEN_FRAMES * length {
            return [tip, top].map(tissue.rest_frame(high.vertex, high.at));
        }
        let [from, to] = [low, high].map(|on| tissue.rest_frame(on.vertex, on.at)(tip + on.height * up));
        [0.0, length].map(|at| from.lerp(to, (at - low.height) / between))
    }

    /// The strip between two blades, and where it ends at rest: in two parts, or the part that there is of it, where the blade crossed
    /// a gap between lips of an older wound, and no longer than those lips let it be. `slit` is the number of its slit.
    pub(super) fn strip_parts(
        &self,
        blades: [[DVec3; 2]; 2],
        start: StripStart,
        slit: u32,
    ) -> ([Option<StripPart>; 2], [DVec3; 2]) {
        let (start, that_ends_in_skin) = match start {
            StripStart::Free => (self.rest_edge(blades[0]), false),
            StripStart::Along(edge, in_skin) => (self.rest_edge(blades[0]).map(|p| onto_line(p, edge)), in_skin),
            StripStart::Edge(edge, in_skin) => (edge, in_skin),
        };
        let end = self.rest_edge(blades[1]);
        let whole = StripPart::whole(blades, [start, end]);
        let (Some(layer), Some(frames)) = (&self.tissue.layer, self.frames(whole)) else { return ([Some(whole), None], end) };
        let parts = self.parts_at_gap(layer, whole, &frames);
        (parts.unwrap_or_else(|| [Some(self.between_lips((layer, slit), (whole, that_ends_in_skin), &frames)), None]), end)
    }

    /// How the vertex nearest to either end of a strip carries what is near that end to rest; `None` where all are seen where they are at rest.
    fn frames(&self, whole: StripPart) -> Option<[EndFrame<impl Fn(DVec3) -> DVec3>; 2]> {
        let tissue = self.tissue;
        if tissue.posed().rest.is_some() {
            return None;
        }
        let frame = |end: usize| {
            let [tip, top] = whole.blades[end];
            let v = nearest_of(tissue, self.near, top, &|v| self.seen(v))?;
            let (frame, at_rest) = (tissue.rest_frame(v, tip), whole.at_rest[end]);
            let moved = at_rest[0] - frame(tip);
            let height = (at_rest[0].distance(at_rest[1]) / tip.distance(top)).clamp(0.0, 1.0);
            Some(EndFrame { at: self.seen(v), to_rest: move |p: DVec3| frame(p) + moved, height })
        };
        Some([frame(0)?, frame(1)?])
    }

    /// Vertices of the skin that the cut has made, with their shares of its way.
    fn cut_skin(&self, blades: [[DVec3; 2]; 2]) -> impl Iterator<Item = CutLip<'_>> {
        let tissue = self.tissue;
        let made = self.made.iter().filter(|n| tissue.mesh.vertex_is_live(n.vertex) && is_skin(tissue, n.vertex));
        made.map(move |n| (n, share_of_way(blades, n.position)))
    }

    /// The parts of a strip that crosses a gap.
    fn parts_at_gap(
        &self,
        layer: &SoftLayer,
        whole: StripPart,
        [before, behind]: &[EndFrame<impl Fn(DVec3) -> DVec3>; 2],
    ) -> Option<[Option<StripPart>; 2]> {
        let (tissue, blades) = (self.tissue, whole.blades);
        let way = way_between(blades);
        let off = |p: DVec3| (before.to_rest)(p).distance((behind.to_rest)(p));
        if off(before.at).max(off(behind.at)) <= APART * way {
            return None;
        }
        // skin that the blade cut goes to the lip whose frame fits it; where an edge leads from one to the other there is no gap
        let is_before = |n: &NewVertex| {
            let [off, off_behind] = [(before.to_rest)(n.position), (behind.to_rest)(n.position)]
                .map(|p| p.distance_squared(tissue.rest[n.vertex.index()]));
            off < off_behind
        };
        // so where it leads to the lips that the strip before has left
        let last = layer.strips.len().checked_sub(1);
        let stands_before = |v: VertexId| match self.made(v) {
            Some(other) => is_before(other),
            None => last.is_some_and(|last| layer.strips.lip_sides(v).iter().any(|lip| lip.strip as usize == last)),
        };
        let (mut from, mut to): (Option<CutLip<'_>>, Option<CutLip<'_>>) = (None, None);
        for (n, share) in self.cut_skin(blades) {
            if is_before(n) {
                from = from.filter(|lip| lip.1 >= share).or(Some((n, share)));
                continue;
            }
            to = to.filter(|lip| lip.1 <= share).or(Some((n, share)));
            let faces = tissue.mesh.fan(n.vertex).map(|h| h.face()).filter(|f| !tissue.mesh.is_interior(*f));
            if faces.flat_map(|f| tissue.mesh.face(f)).any(stands_before) {
                return None;
            }
        }
        let share = |lip: Option<CutLip<'_>>, without: f64| lip.map_or(without, |lip| lip.1.clamp(0.0, 1.0));
        let (end, start) = (share(from, 0.0), share(to, 1.0));
        if start <= end {
            return None;
        }
        let middle = 0.5 * (end + start);
        let first = from
            .map(|lip| StripPart { of: Some((blades, [f64::NEG_INFINITY, middle])), ..whole.until(tissue, lip, before.height) });
        let second = to.map(|lip| StripPart {
            of: Some((blades, [middle, f64::INFINITY])),
            is_apart: true,
            ..whole.since(tissue, lip, behind.height)
        });
        (first.is_some() || second.is_some()).then_some([first, second])
    }

    /// A strip that begins or ends in the air between the lips of an older wound: it begins and ends at the lips that it cut. One that
    /// goes on from another in the skin does not begin in the air, though a wound beside it may be the first that its box cuts.
    fn between_lips(
        &self,
        (layer, slit): (&SoftLayer, u32),
        (whole, goes_on_in_skin): (StripPart, bool),
        [before, behind]: &[EndFrame<impl Fn(DVec3) -> DVec3>; 2],
    ) -> StripPart {
        let tissue = self.tissue;
        // most strokes are the first; slits are numbered in their order
        let strips = layer.strips.as_slice();
        if strips.first().is_none_or(|oldest| oldest.slit == slit) {
            return whole;
        }
        let by_share = |a: &CutLip<'_>, b: &CutLip<'_>| a.1.total_cmp(&b.1);
        // an edge of an older wound has ends on one lip of it, if not of one strip
        let is_of_older = |n: &NewVertex| {
            let mut parents = self.original(n).parents().iter().map(|(v, _)| layer.strips.lip_sides(*v));
            let first = parents.next().unwrap_or_default();
            let of = |lip: &LipSide| (strips[lip.strip as usize].slit, lip.side);
            let is_common = |lip: &&LipSide| parents.clone().all(|other| other.iter().any(|o| of(o) == of(lip)));
            first.iter().filter(is_common).any(|lip| of(lip).0 != slit)
        };
        let is_first = |(n, share): &CutLip<'_>| !goes_on_in_skin && *share > AT_END && is_of_older(n);
        let first = self.cut_skin(whole.blades).min_by(by_share).filter(is_first);
        let is_last = |(n, share): &CutLip<'_>| *share < 1.0 - AT_END && is_of_older(n);
        let last = self.cut_skin(whole.blades).max_by(by_share).filter(is_last);
        let part = last.map_or(whole, |lip| whole.until(tissue, lip, behind.height));
        let since = first.map_or(whole, |lip| whole.since(tissue, lip, before.height));
        StripPart { blades: [since.blades[0], part.blades[1]], at_rest: [since.at_rest[0], part.at_rest[1]], ..whole }
    }
}

impl TearStroke {
    /// What the last box has cut.
    pub(super) fn swath<'a>(&'a self, tissue: &'a Tissue) -> Swath<'a, impl Fn(VertexId) -> DVec3> {
        let elsewhere = |v| self.positions.of(tissue, v);
        let half_width = 0.5 * self.width;
        Swath { tissue, made: &self.step.new_vertices, near: &self.near, candidates: &self.candidates, half_width, elsewhere }
    }

    /// How far up blade `end` of a box its cut reaches, as a share of the blade: in all, and where it cut skin.
    fn cut_heights(&self, tissue: &Tissue, tear_box: &TearBox, end: usize) -> [f64; 2] {
        let [tip, top] = tear_box.blades[end];
        let share = |p: DVec3| (p - tip).dot(top - tip) / (top - tip).length_squared();
        self.step.new_vertices.iter().filter(|n| tissue.mesh.vertex_is_live(n.vertex)).fold([0.0; 2], |[all, skin], n| {
            let height = share(n.position).min(1.0);
            [height.max(all), if height > skin && is_skin(tissue, n.vertex) { height } else { skin }]
        })
    }

    /// True for a box that cut walls alone, or skin farther down: it went on in a wound that stood open.
    pub(super) fn is_in_wound(&self, tissue: &Tissue, tear_box: &TearBox) -> bool {
        let Some(layer) = tissue.layer.as_ref().filter(|_| self.step.walls_cut > 0) else { return false };
        if self.step.skin_cut == 0 {
            return true;
        }
        let [all, skin] = self.cut_heights(tissue, tear_box, 0);
        let [tip, top] = tear_box.blades[0];
        (all - skin) * tip.distance(top) > IN_WOUND * layer.settings.radius
    }

    /// The part of the blade at one end of a box that went through what the box cut, and below it as far as a strip parts.
    pub(super) fn cut_part(&self, tissue: &Tissue, tear_box: &TearBox, end: usize) -> [DVec3; 2] {
        let [tip, top] = tear_box.blades[end];
        let below = tissue.layer.as_ref().map_or(0.0, |layer| 0.25 * layer.settings.radius);
        let [highest, _] = self.cut_heights(tissue, tear_box, end);
        [tip - below * (top - tip).normalize_or_zero(), if highest > 0.0 { tip.lerp(top, highest) } else { top }]
    }
}

/// How far the blade's ends go from the one blade to the other: the farther of both, metres.
pub(in crate::tissue) fn way_between([from, to]: [[DVec3; 2]; 2]) -> f64 {
    (0..2).map(|k| from[k].distance(to[k])).fold(0.0, f64::max)
}

/// `v` among vertices that a cut has made, in order.
pub(super) fn find_made(made: &[NewVertex], v: VertexId) -> Option<&NewVertex> {
    v.index().checked_sub(made.first()?.vertex.index()).and_then(|i| made.get(i))
}

/// The blade at a share of its way.
pub(in crate::tissue) fn blade_at(blades: [[DVec3; 2]; 2], share: f64) -> [DVec3; 2] {
    [0, 1].map(|k| blades[0][k].lerp(blades[1][k], share))
}

/// Where `p` lies on the way from the one blade to the other.
fn share_of_way(blades: [[DVec3; 2]; 2], p: DVec3) -> f64 {
    let [[tip, top], [next_tip, next_top]] = blades;
    share_between([tip, next_tip, next_top, top], normal_of_way(blades), p)
}

/// Unit normal of what the blade sweeps from the one to the other.
pub(super) fn normal_of_way([[tip, top], [next_tip, next_top]]: [[DVec3; 2]; 2]) -> DVec3 {
    let normal = (next_tip - tip).cross(next_top - tip) + (next_top - tip).cross(top - tip);
    normal.normalize_or_zero()
}

pub(super) fn is_skin(tissue: &Tissue, v: VertexId) -> bool {
    tissue.mesh.fan(v).any(|h| !tissue.mesh.is_interior(h.face()))
}

/// The point nearest to `p` on the line of an edge, which is an end of the edge if it lies there but for rounding.
fn onto_line(p: DVec3, [from, to]: [DVec3; 2]) -> DVec3 {
    let along = to - from;
    let share = (p - from).dot(along) / along.length_squared();
    match share {
        s if s.abs() <= SAME_END => from,
        s if (s - 1.0).abs() <= SAME_END => to,
        s if s.is_finite() => from + along * s,
        _ => p,
    }
}

/// The vertex of `faces` that is seen nearest to `p`; dead faces are passed over. `position` gives final positions.
pub(super) fn nearest_vertex(
    tissue: &Tissue,
    faces: &[FaceId],
    p: DVec3,
    position: &impl Fn(VertexId) -> DVec3,
) -> Option<VertexId> {
    nearest(faces.iter().filter(|f| tissue.mesh.is_live(**f)).flat_map(|&f| tissue.mesh.face(f)), p, position)
}

/// The live one of `vertices` that is seen nearest to `p`.
pub(super) fn nearest_of(
    tissue: &Tissue,
    vertices: &[VertexId],
    p: DVec3,
    position: &impl Fn(VertexId) -> DVec3,
) -> Option<VertexId> {
    nearest(vertices.iter().copied().filter(|&v| tissue.mesh.vertex_is_live(v)), p, position)
}

fn nearest(vertices: impl Iterator<Item = VertexId>, p: DVec3, position: &impl Fn(VertexId) -> DVec3) -> Option<VertexId> {
    let near = vertices.map(|v| (position(v).distance_squared(p), v));
    near.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))).map(|n| n.1)
}
