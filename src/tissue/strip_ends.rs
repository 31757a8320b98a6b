//! How far along its blades the strip of a box reaches, where its ends are at rest, and where it is in two parts.
//!
//! A strip parts what lies on both sides of it at rest (MATHS 3.2). In a wound that stands open the blade goes through air above what it
//! cuts, and the tissue beside that air lies elsewhere at rest: there a strip ends where the cut does. Across such a wound it goes through
//! air from one lip to the other, which touch at rest: there it ends at one and begins anew at the other.

use super::{SegmentReport, TearStroke, nearest_of, nearest_vertex};
use crate::geometry::VertexId;
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

/// A stretch of a box's strip on whose way the blade crossed no gap.
#[derive(Clone, Copy)]
pub(super) struct StripPart {
    /// The blades `[tip, top]` at both ends as they were seen.
    blades: [[DVec3; 2]; 2],
    /// The same at rest.
    at_rest: [[DVec3; 2]; 2],
    /// Of a part of a box's strip that crosses a gap: that strip as it was seen, and the shares of its way that the part's lips lie between.
    of: Option<([[DVec3; 2]; 2], [f64; 2])>,
    /// A gap lies before it.
    pub(super) is_apart: bool,
}

/// A vertex of the skin that the box has made, and where it lies on the box's way.
type CutLip<'a> = (&'a NewVertex, f64);

/// How the vertex nearest to one end of a strip carries points to rest.
struct EndFrame<F> {
    /// Where the vertex is seen.
    at: DVec3,
    to_rest: F,
    /// How much of the blade there is at rest.
    height: f64,
}

impl StripPart {
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
        let [tip, top] = [0, 1].map(|k| self.blades[0][k].lerp(self.blades[1][k], share.clamp(0.0, 1.0)));
        let blade = [tip, tip.lerp(top, height)];
        (blade, blade.map(tissue.rest_frame(lip.vertex, lip.position)))
    }

    /// Whether it is too short for a strip; `blades` are those at both ends of its box.
    pub(super) fn is_nick(&self, blades: [[DVec3; 2]; 2]) -> bool {
        let [whole, seen, at_rest] = [blades, self.blades, self.at_rest].map(way_between);
        seen < (1.0 - 1e-9) * whole && seen.min(at_rest) < LEAST_PART * whole
    }

    /// Whether a lip that is seen at `p` is one of its.
    fn holds(&self, p: impl FnOnce() -> DVec3) -> bool {
        self.of.is_none_or(|(whole, shares)| (shares[0]..shares[1]).contains(&share_of_way(whole, p())))
    }
}

impl TearStroke {
    /// A vertex that the box has made.
    fn made(&self, v: VertexId) -> Option<&NewVertex> {
        let made = &self.step.new_vertices;
        v.index().checked_sub(made.first()?.vertex.index()).and_then(|i| made.get(i))
    }

    /// Where a vertex is seen while the box's cut is not bound yet: no particle holds its new vertices.
    fn seen(&self, tissue: &Tissue, v: VertexId) -> DVec3 {
        self.made(v).map_or_else(|| self.positions.of(tissue, v), |n| n.position)
    }

    /// A blade `[tip, top]` of a box, carried to rest space by the nearest surface vertex. It ends not far above what was torn: a vertex's
    /// frame holds near it, and the next box may have another.
    pub(super) fn rest_edge(&self, tissue: &Tissue, [tip, top]: [DVec3; 2]) -> [DVec3; 2] {
        let seen = |v| self.seen(tissue, v);
        let share = |v: &VertexId| (seen(*v) - tip).dot(top - tip) / (top - tip).length_squared();
        let highest = self.near.iter().filter(|v| tissue.mesh.vertex_is_live(**v)).map(share).fold(0.0, f64::max);
        let top = if highest > 0.0 && highest < 0.5 { tip.lerp(top, 2.0 * highest) } else { top };
        match nearest_of(tissue, &self.near, top, &seen).or_else(|| nearest_vertex(tissue, &self.candidates, top, &seen)) {
            Some(v) => [tip, top].map(tissue.rest_frame(v, seen(v))),
            None => [tip, top],
        }
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

    /// The strip of a box between two blades, and where it ends at rest: in two parts, or the part that there is of it, where the blade crossed
    /// a gap between lips of an older wound, and no longer than those lips let it be. `start` is where it begins at rest, if another box
    /// ended there.
    pub(super) fn strip_parts(
        &self,
        tissue: &Tissue,
        blades: [[DVec3; 2]; 2],
        start: Option<[DVec3; 2]>,
    ) -> ([Option<StripPart>; 2], [DVec3; 2]) {
        let start = start.unwrap_or_else(|| self.rest_edge(tissue, blades[0]));
        let end = self.rest_edge(tissue, blades[1]);
        let whole = StripPart { blades, at_rest: [start, end], of: None, is_apart: false };
        let (Some(layer), Some(frames)) = (&tissue.layer, self.frames(tissue, whole)) else { return ([Some(whole), None], end) };
        let parts = self.parts_at_gap(tissue, layer, whole, &frames);
        (parts.unwrap_or_else(|| [Some(self.between_lips(tissue, layer, whole, &frames)), None]), end)
    }

    /// How the vertex nearest to either end of a strip carries what is near that end to rest; `None` where all are seen where they are at rest.
    fn frames(&self, tissue: &Tissue, whole: StripPart) -> Option<[EndFrame<impl Fn(DVec3) -> DVec3>; 2]> {
        if tissue.posed().rest.is_some() {
            return None;
        }
        let frame = |end: usize| {
            let [tip, top] = whole.blades[end];
            let v = nearest_of(tissue, &self.near, top, &|v| self.seen(tissue, v))?;
            let (frame, at_rest) = (tissue.rest_frame(v, tip), whole.at_rest[end]);
            let moved = at_rest[0] - frame(tip);
            let height = (at_rest[0].distance(at_rest[1]) / tip.distance(top)).clamp(0.0, 1.0);
            Some(EndFrame { at: self.seen(tissue, v), to_rest: move |p: DVec3| frame(p) + moved, height })
        };
        Some([frame(0)?, frame(1)?])
    }

    /// Vertices of the skin that the box has made, with their shares of its way.
    fn cut_skin(&self, tissue: &Tissue, blades: [[DVec3; 2]; 2]) -> impl Iterator<Item = CutLip<'_>> {
        let made = self.step.new_vertices.iter().filter(|n| tissue.mesh.vertex_is_live(n.vertex) && is_skin(tissue, n.vertex));
        made.map(move |n| (n, share_of_way(blades, n.position)))
    }

    /// The parts of a strip that crosses a gap.
    fn parts_at_gap(
        &self,
        tissue: &Tissue,
        layer: &SoftLayer,
        whole: StripPart,
        [before, behind]: &[EndFrame<impl Fn(DVec3) -> DVec3>; 2],
    ) -> Option<[Option<StripPart>; 2]> {
        let blades = whole.blades;
        let way = way_between(blades);
        let off = |p: DVec3| (before.to_rest)(p).distance((behind.to_rest)(p));
        if off(before.at).max(off(behind.at)) <= APART * way {
            return None;
        }
        // skin that the box cut goes to the lip whose frame fits it; where an edge leads from one to the other there is no gap
        let is_before = |n: &NewVertex| {
            let [off, off_behind] = [(before.to_rest)(n.position), (behind.to_rest)(n.position)]
                .map(|p| p.distance_squared(tissue.rest[n.vertex.index()]));
            off < off_behind
        };
        // so where it leads to the lips that the box before has left
        let last = layer.strips.len().checked_sub(1);
        let stands_before = |v: VertexId| match self.made(v) {
            Some(other) => is_before(other),
            None => last.is_some_and(|last| layer.strips.lip_sides(v).iter().any(|lip| lip.strip as usize == last)),
        };
        let (mut from, mut to): (Option<CutLip<'_>>, Option<CutLip<'_>>) = (None, None);
        for (n, share) in self.cut_skin(tissue, blades) {
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

    /// A strip whose box begins or ends in the air between the lips of an older wound: it begins and ends at the lips that it cut.
    fn between_lips(
        &self,
        tissue: &Tissue,
        layer: &SoftLayer,
        whole: StripPart,
        [before, behind]: &[EndFrame<impl Fn(DVec3) -> DVec3>; 2],
    ) -> StripPart {
        // most strokes are the first; slits are numbered in their order
        let strips = layer.strips.as_slice();
        if strips.first().is_none_or(|oldest| oldest.slit == self.slit) {
            return whole;
        }
        let by_share = |a: &CutLip<'_>, b: &CutLip<'_>| a.1.total_cmp(&b.1);
        let is_of_older = |n: &NewVertex| {
            let mut sides = n.parents[..n.parent_count].iter().map(|(v, _)| layer.strips.lip_sides(*v));
            let first = sides.next().unwrap_or_default();
            let is_common = |lip: &&LipSide| sides.clone().all(|other| other.contains(lip));
            n.parent_count > 0 && first.iter().filter(is_common).any(|lip| strips[lip.strip as usize].slit != self.slit)
        };
        let first = self.cut_skin(tissue, whole.blades).min_by(by_share).filter(|(n, share)| *share > 0.0 && is_of_older(n));
        let last = self.cut_skin(tissue, whole.blades).max_by(by_share).filter(|(n, share)| *share < 1.0 && is_of_older(n));
        let part = last.map_or(whole, |lip| whole.until(tissue, lip, behind.height));
        let since = first.map_or(whole, |lip| whole.since(tissue, lip, before.height));
        StripPart { blades: [since.blades[0], part.blades[1]], at_rest: [since.at_rest[0], part.at_rest[1]], ..whole }
    }

    /// The new strip of a part of the box's, unless it is a nick, and what that does to the particle map. What the box has made and removed
    /// comes with its first part. Lips of a nick are lips of the strip that goes on from it.
    pub(super) fn bind_strip(
        &mut self,
        tissue: &mut Tissue,
        (part, is_first, is_nick): (&StripPart, bool, bool),
        reach: f64,
        report: &mut SegmentReport,
    ) {
        let strip = report.stages.time("disconnect_particles", || {
            let layer = tissue.layer.as_mut().filter(|_| !is_nick)?;
            let [start, end] = part.at_rest;
            let corners = [start[0], end[0], end[1], start[1]];
            layer.strips.push_strip(corners, reach, self.slit, self.step.skin_cut == 0).ok()
        });
        let (mut lips, mut removed) = (std::mem::take(&mut self.lips), std::mem::take(&mut self.removed));
        lips.clear();
        let mut nicked = std::mem::take(&mut self.nicked);
        let points = self.step.lips.iter().filter(|l| part.holds(|| self.seen(tissue, l.vertex))).copied();
        if is_nick {
            nicked.extend(points);
        } else if let Some(strip) = strip {
            let points = points.chain(nicked.drain(..));
            let seen = |v| self.positions.of(tissue, v);
            tissue.list_lips((strip, part.blades), (points, &self.step.new_vertices, &[]), true, seen, &mut lips);
        }
        let made = if is_first { self.step.new_vertices.as_slice() } else { &[] };
        removed.clear();
        removed.extend(self.step.touched.iter().filter(|&&v| is_first && !tissue.mesh.vertex_is_live(v)));
        let update = report.stages.time("update_particles", || {
            let strips = strip.map_or(0..0, |s| s..s + 1);
            tissue.update_map(made, &removed, (strips, None), &lips)
        });
        (self.lips, self.removed, self.nicked) = (lips, removed, nicked);
        let made = self.step.new_vertices.iter().map(|n| n.vertex);
        self.positions.edited(tissue, update.vertices_changed.iter().copied().chain(made));
        report.wound_particles += update.particles_added.len();
        report.vertices_visited += update.vertices_visited;
        tissue.scratch.update.reuse(update);
    }
}

/// How far the blade's ends go from the one blade to the other: the farther of both, metres.
pub(super) fn way_between([from, to]: [[DVec3; 2]; 2]) -> f64 {
    (0..2).map(|k| from[k].distance(to[k])).fold(0.0, f64::max)
}

/// Where `p` lies on the way from the one blade to the other.
fn share_of_way([[tip, top], [next_tip, next_top]]: [[DVec3; 2]; 2], p: DVec3) -> f64 {
    let normal = (next_tip - tip).cross(next_top - tip) + (next_top - tip).cross(top - tip);
    share_between([tip, next_tip, next_top, top], normal.normalize_or_zero(), p)
}

fn is_skin(tissue: &Tissue, v: VertexId) -> bool {
    tissue.mesh.fan(v).any(|h| !tissue.mesh.is_interior(h.face()))
}
