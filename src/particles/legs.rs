//! Where a slit runs over an edge of the model its lips go down there along the blade: a leg of the wound (MATHS 3.3). The wound goes on
//! along it, and ends at its bottom.

use super::map_edit::LipVertex;
use super::map_update::Update;
use super::strips::WoundMark;
use super::wound::{add_marked, room_for_marks};
use crate::geometry::{HalfEdge, VertexId};
use glam::DVec3;

/// Lips so near to the end of the slit, along it, are on the leg if lips lead to them, in spacings of wound particles.
const NEAR: f64 = 0.25;
/// A shorter leg is none, in spacings of wound particles.
const LEAST_DEPTH: f64 = 1.0;
/// Lips of a leg.
pub(super) const MOST_LIPS: usize = 256;

/// A lip on a leg.
#[derive(Clone, Copy, Debug)]
pub(super) struct LegLip {
    vertex: VertexId,
    side: i8,
    /// How far below the leg's upper end, metres.
    depth: f64,
}

/// A leg. Its lips are listed in the scratch until another is looked for.
pub(super) struct Leg {
    strip: usize,
    at_end: bool,
    /// How far its bottom is below its upper end, metres.
    pub(super) depth: f64,
    /// Its deepest lip on the positive side.
    pub(super) bottom: VertexId,
}

impl Leg {
    /// The leg of a strip, at its end or its start, if it has one there. The edit lists the lips.
    pub(super) fn find(update: &mut Update<'_, '_>, k: usize, at_end: bool) -> Option<Self> {
        let Update { mesh, rest, strips, edit, scratch, settings, .. } = update;
        let [tip0, tip1, base1, base0] = strips.as_slice()[k].corners.map(DVec3::from_array);
        let down = if at_end { tip1 - base1 } else { tip0 - base0 }.normalize_or_zero();
        let (strip, spacing) = (&strips.as_slice()[k], settings.wound.spacing);
        let end = strip.skin_edge()[usize::from(at_end)];
        let place = |v: VertexId| -strip.inwards(at_end, rest[v.index()]);
        let at_top =
            |l: &&LipVertex| l.strip == k && mesh.vertex_is_live(l.vertex) && rest[l.vertex.index()].distance(end) < spacing;
        let outermost = edit.lips.iter().filter(at_top).map(|l| place(l.vertex)).fold(0.0, f64::max);
        let is_skin = |h: &HalfEdge| !mesh.is_interior(h.face());
        let is_near = |v: VertexId| {
            mesh.vertex_is_live(v) && (place(v) - outermost).abs() <= NEAR * spacing && mesh.fan(v).any(|h| is_skin(&h))
        };
        let height = |v: VertexId| -rest[v.index()].dot(down);
        let list = &mut scratch.lens.leg;
        list.clear();
        let mut highest = f64::NEG_INFINITY;
        for side in [1, -1] {
            let is_lip = |v: VertexId| edit.lips.iter().any(|l| l.vertex == v && l.strip == k && l.side.signum() == side);
            let of_side = edit.lips.iter().filter(|l| l.strip == k && l.side.signum() == side && is_near(l.vertex));
            let top = of_side.map(|l| l.vertex).max_by(|a, b| height(*a).total_cmp(&height(*b)).then(b.cmp(a)))?;
            highest = highest.max(height(top));
            let mut next = list.len();
            let most = next + MOST_LIPS;
            list.push(LegLip { vertex: top, side, depth: 0.0 });
            while next < list.len().min(most) {
                for h in mesh.fan(list[next].vertex).filter(is_skin) {
                    for w in [mesh.to(h), mesh.from(h.prev())] {
                        if !list.iter().any(|l| l.vertex == w && l.side == side) && is_lip(w) && is_near(w) {
                            list.push(LegLip { vertex: w, side, depth: 0.0 });
                        }
                    }
                }
                next += 1;
            }
        }
        list.iter_mut().for_each(|l| l.depth = highest - height(l.vertex));
        let deepest = |side: i8| list.iter().filter(|l| l.side == side).max_by(|a, b| a.depth.total_cmp(&b.depth));
        let (plus, minus) = deepest(1).zip(deepest(-1))?;
        let depth = plus.depth.max(minus.depth);
        (depth >= LEAST_DEPTH * settings.wound.spacing).then_some(Self { strip: k, at_end, depth, bottom: plus.vertex })
    }

    /// Where a lip of the leg is along the leg's strip, metres: before its start or beyond its end.
    fn along(&self, update: &Update<'_, '_>, depth: f64) -> f64 {
        if self.at_end { update.strips.as_slice()[self.strip].length + depth } else { -depth }
    }

    /// Puts wound particles on the leg, as far as the slit may have more, the lowest at its bottom if that `is_shut`, and tells those that
    /// are on it where they are.
    pub(super) fn fill(&self, update: &mut Update<'_, '_>, is_shut: bool) {
        let spacing = update.settings.wound.spacing;
        let mut room = room_for_marks(update, update.strips.as_slice()[self.strip].wound);
        for i in 0..update.strips.wounds.len() {
            let mark = update.strips.wounds[i];
            if mark.strip as usize != self.strip {
                continue;
            }
            let anchor = update.map.anchors[mark.particle.index()];
            let lip = update.scratch.lens.leg.iter().find(|l| l.vertex == anchor && i32::from(l.side) == mark.side);
            if let Some(depth) = lip.map(|l| l.depth) {
                update.strips.wounds.set(i, WoundMark { along: self.along(update, depth), ..mark });
            }
        }
        for side in [1, -1] {
            let places = (u32::from(!is_shut)..).map(|i| self.depth - f64::from(i) * spacing);
            for place in places.take_while(|&p| p > 0.5 * spacing) {
                if room == 0 {
                    return;
                }
                let off = |l: &LegLip| (l.depth - place).abs();
                let usable = update.scratch.lens.leg.iter().filter(|l| l.side == side && off(l) <= 0.5 * spacing);
                let best = usable
                    .filter(|l| !update.is_anchor(l.vertex))
                    .min_by(|a, b| off(a).total_cmp(&off(b)).then(a.vertex.cmp(&b.vertex)));
                let Some(&LegLip { vertex, depth, .. }) = best else { continue };
                add_marked(update, self.strip, (vertex, side), self.along(update, depth));
                room -= 1;
            }
        }
    }
}
