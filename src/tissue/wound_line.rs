//! On which wound's line a new strip lies: that of the strip it goes on from, that of an older wound it begins in, or a new one (MATHS 3.3).

use super::strip_bind::Cut;
use super::strip_ends::{StripPart, find_made, is_skin, normal_of_way, way_between};
use crate::geometry::VertexId;
use crate::particles::wound_lines::OnLine;
use crate::particles::{LipSide, Strips, share_between};
use crate::tissue::Tissue;
use glam::DVec3;

/// A strip that begins in an older wound and whose way is at most so far off that one's, as a cosine, runs along it: 14 degrees.
const ALONG: f64 = 0.97;

/// The same where it leaves the older one's end: 60 degrees.
const ONWARDS: f64 = 0.5;

/// An edge in the skin that is shorter than this share of half a spacing of wound particles has no way of its own.
const NEXT_TO_NONE: f64 = 0.1;

/// What is so much farther from an end of a strip than the nearest, as a share of its way, is not there.
const AT_END: f64 = 0.1;

/// A vertex at an end of a strip: how far from it, as a share of the strip's way, and how far up the blade, metres.
#[derive(Clone, Copy)]
struct EndVertex {
    vertex: VertexId,
    off: f64,
    height: f64,
}

/// The line of a wound, as far as a stroke has come on it.
#[derive(Clone, Copy, Debug)]
pub(in crate::tissue) struct WoundLine {
    pub(in crate::tissue) wound: u32,
    /// Where on the line, metres, +1 or -1 for on along it or back, and where that is in rest space.
    place: f64,
    way: i32,
    pub(super) end: DVec3,
    /// What of it stood open before the stroke came to it, metres.
    pub(super) opened: [f64; 2],
    /// What the next strips are to go by if they lie on it, too.
    offer: Option<Offer>,
}

/// The line of an older wound, to what begins in that and has not come to its end: a blade that crosses it may run along it first, or cut hardly more
/// than a dot of its lip, before it leaves.
#[derive(Clone, Copy, Debug)]
struct Offer {
    /// Where the line goes there, and the least cosine of a strip's way with that.
    along: DVec3,
    least: f64,
    /// A strip with a way of its own lies on it.
    is_taken: bool,
}

impl WoundLine {
    /// On it, a strip that cuts the skin from here to `to` and counts as so long, metres.
    pub(super) fn strip(&self, to: DVec3, length: f64) -> OnLine {
        OnLine { wound: self.wound, place: self.place, way: self.way, skin: [self.end, to], length }
    }

    /// The same at the end of a strip of it.
    pub(super) fn after(&self, strip: &OnLine) -> Self {
        let place = self.place + f64::from(self.way) * strip.length;
        let offer = self.offer.filter(|o| !o.is_taken || place > self.opened[0] && place < self.opened[1]);
        Self { place, end: strip.skin[1], offer, ..*self }
    }

    fn new(strips: &Strips, at: DVec3) -> Self {
        Self { wound: strips.next_wound(), place: 0.0, way: 1, end: at, opened: [0.0; 2], offer: None }
    }

    /// True if nothing lies on the line yet that has a way of its own.
    pub(super) fn is_on_offer(&self) -> bool {
        self.offer.is_some_and(|o| !o.is_taken)
    }

    /// The line for a strip that goes this way, or has no way of its own; `None` if that goes elsewhere.
    fn taken(self, way: Option<DVec3>) -> Option<Self> {
        let (Some(way), Some(offer)) = (way, self.offer) else { return Some(self) };
        let offer = Offer { is_taken: true, ..offer };
        (way.dot(offer.along).abs() >= offer.least).then_some(Self { offer: Some(offer), ..self })
    }
}

impl Cut<'_> {
    /// Where a part of the cut has met skin at both of its ends, in the plane of its strip (rest space); the upper corners of that where it
    /// has met none.
    pub(super) fn skin_edge(&self, tissue: &Tissue, part: &StripPart) -> [DVec3; 2] {
        let [[tip, top], [next_tip, next_top]] = part.blades;
        let (seen_normal, ups) = (normal_of_way(part.blades), [top - tip, next_top - next_tip].map(DVec3::normalize_or_zero));
        let near = AT_END * way_between(part.blades);
        // the outermost on either side, at both ends
        let mut found: [[Option<EndVertex>; 2]; 2] = Default::default();
        // without width both sides are where the slit is, which ends in vertices that are on neither
        let lips = self.lips.iter().filter_map(|l| Some((find_made(self.made, l.vertex)?, usize::from(l.side > 0))));
        let made = self.made.iter().map(|n| (n, 0));
        let (lips, made) = if self.has_width { (Some(lips), None) } else { (None, Some(made)) };
        for (n, side) in lips.into_iter().flatten().chain(made.into_iter().flatten()) {
            if !tissue.mesh.vertex_is_live(n.vertex) || !is_skin(tissue, n.vertex) || !part.holds(|| n.position) {
                continue;
            }
            let share = share_between([tip, next_tip, next_top, top], seen_normal, n.position);
            for (end, found) in found.iter_mut().enumerate() {
                let (off, height) = ((share - end as f64).abs(), (n.position - part.blades[end][0]).dot(ups[end]));
                let found = &mut found[side];
                let is_better = found.is_none_or(|best| match off - best.off {
                    farther if farther.abs() > AT_END => farther < 0.0,
                    // where skin leans, what lies a little way on is higher or lower; another skin is by more
                    farther if (height - best.height).abs() <= near => farther < 0.0,
                    _ => height > best.height,
                });
                if is_better {
                    *found = Some(EndVertex { vertex: n.vertex, off, height });
                }
            }
        }
        let (start, normal) = (part.at_rest[0], part.normal().normalize_or_zero());
        [0, 1].map(|end| {
            let mut sum = (DVec3::ZERO, 0.0);
            for at in found[end].iter().flatten() {
                sum = (sum.0 + tissue.rest[at.vertex.index()], sum.1 + 1.0);
            }
            let skin = if sum.1 > 0.0 { sum.0 / sum.1 } else { return part.at_rest[end][1] };
            skin - normal * (skin - start[0]).dot(normal)
        })
    }

    /// The line that a strip of this cut lies on, of which the skin's `edge` is given: that which the cut goes on along,
    /// if it `is_first` of its strips and begins where that ends, else that of an older wound whose lips it met there and which it
    /// goes on from or runs along, else a new one.
    pub(super) fn line(
        &self,
        tissue: &Tissue,
        strips: &Strips,
        (part, is_first): (&StripPart, bool),
        edge: [DVec3; 2],
    ) -> WoundLine {
        let [from, to] = edge;
        let near = tissue.layer.as_ref().map_or(0.0, |layer| 0.5 * layer.settings.wound.spacing);
        let way = (from.distance(to) > NEXT_TO_NONE * near).then(|| (to - from).normalize_or_zero());
        if let Some(line) = self.goes_on_along.filter(|_| is_first)
            && (self.shares_edge || line.end.distance(from) <= near)
            && let Some(line) = line.taken(way)
        {
            return line;
        }
        let normal = part.normal();
        let mut best: Option<(f64, WoundLine)> = None;
        let mut looked_at = None;
        let mut look_at = |lip: &LipSide| {
            let strip = &strips.as_slice()[lip.strip as usize];
            if looked_at == Some(lip.strip) || strip.is_beside() {
                return;
            }
            looked_at = Some(lip.strip);
            let [start, end] = strip.skin_edge();
            let along = end - start;
            let share = ((from - start).dot(along) / along.length_squared()).clamp(0.0, 1.0);
            let at = start + along * share;
            let off = at.distance(from);
            let Some([low, high]) = strips.wound_range(strip.wound) else { return };
            let place = strip.place + f64::from(strip.way) * strip.length * share;
            // its own sides are those of the line, or the other way round
            let onwards = if normal.dot(strips.geometry(lip.strip as usize).normal()) < 0.0 { -strip.way } else { strip.way };
            let leaves = if onwards > 0 { place >= high - near } else { place <= low + near };
            let is_better = best.is_none_or(|(least, line)| (off, strip.wound) < (least, line.wound));
            let least = if leaves { ONWARDS } else { ALONG };
            let offer = Some(Offer { along: along.normalize_or_zero(), least, is_taken: false });
            let line = WoundLine { wound: strip.wound, place, way: onwards, end: from, opened: [low, high], offer };
            if off <= near
                && is_better
                && let Some(line) = line.taken(way)
            {
                best = Some((off, line));
            }
        };
        let parents = self.made.iter().flat_map(|n| n.parents().iter().map(|p| p.0));
        let old = |v: &VertexId| find_made(self.made, *v).is_none();
        let met = self.lips.iter().map(|l| l.vertex).chain(self.closed.iter().copied());
        for v in parents.chain(met).filter(old) {
            strips.lip_sides(v).iter().for_each(&mut look_at);
        }
        best.map_or_else(|| WoundLine::new(strips, from), |(_, line)| line)
    }
}
