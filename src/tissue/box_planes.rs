//! The planes of a tear's box, and what lies on which.

use super::Tissue;
use crate::geometry::{FaceId, Plane, VertexId};
use crate::surgery::clip::MAX_PLANES;
use crate::surgery::tear::OnPlanes;
use crate::surgery::walls::Facets;
use crate::surgery::{Side, TearBox};
use glam::DVec3;
use smallvec::SmallVec;

/// The planes of a box, a flat side's two triangles as one.
#[derive(Default)]
pub(super) struct BoxPlanes {
    pub(super) planes: Vec<Plane>,
    pub(super) sides: Vec<Side>,
    /// Bits of the planes that hold edge `k` of the start quad, and of the end quad.
    edge_planes: [[u16; 4]; 2],
    /// Plane bits that every vertex on the start joint has.
    pub(super) start: u16,
    pub(super) facets: Facets,
}

/// How far across the lips before it a box that is drawn back may reach, in widths, on the inner side of a turn and on the outer.
const INNER_REACH: f64 = 0.9;
const OUTER_REACH: f64 = 0.1;

/// Bits of quad edges in tags that wait for the next box.
type EdgeBits = u16;

impl BoxPlanes {
    /// Makes room for the planes of any box.
    pub(super) fn make_room(&mut self) {
        self.planes.reserve(16);
        self.sides.reserve(16);
        self.facets.cycles.reserve(16);
    }

    /// Of another box.
    pub(super) fn set(&mut self, tear_box: &TearBox, flat: f64) {
        let all = self;
        all.planes.clear();
        all.sides.clear();
        all.start = 1;
        all.facets.cycles.clear();
        all.facets.seen_inside = None;
        let push = |all: &mut Self, k: usize| {
            let space = &tear_box.planes[k];
            let plane = Plane::Points(space.points);
            all.planes.push(if space.flipped { plane.flipped() } else { plane });
            all.sides.push(space.side);
            1u16 << (all.planes.len() - 1)
        };
        all.facets.corners = tear_box.corners();
        all.facets.avoided = 1;
        push(all, 0);
        all.facets.push(&[0, 3, 2, 1]);
        push(all, 1);
        all.facets.push(&[4, 5, 6, 7]);
        for k in 0..4 {
            let first = push(all, 2 + 2 * k);
            let is_flat = tear_box.bulge[k] <= flat;
            if is_flat {
                let (a, b) = (k as u8, (k as u8 + 1) % 4);
                all.facets.push(&[a, b, b + 4, a + 4]);
            } else {
                all.facets.push(&tear_box.triangles[2 * k]);
                all.facets.push(&tear_box.triangles[2 * k + 1]);
            }
            let second = if is_flat { first } else { push(all, 3 + 2 * k) };
            all.edge_planes[0][k] = first;
            all.edge_planes[1][k] = second;
        }
    }

    /// Outward normals of the planes, and how far the origin is beyond them at least. Places without a plane keep nothing apart.
    pub(super) fn outward(&self) -> [(DVec3, f64); MAX_PLANES] {
        let mut outward = [(DVec3::ZERO, 0.0); MAX_PLANES];
        for (known, plane) in outward.iter_mut().zip(&self.planes) {
            *known = (plane.normal(), plane.distance(DVec3::ZERO) - plane.rounding(0.0));
        }
        outward
    }

    /// Faces of the sections that reach into the box; `low` and `high` are its bounds.
    pub(super) fn faces_within(&self, tissue: &Tissue, (low, high): (DVec3, DVec3), out: &mut Vec<FaceId>) {
        let (slack, outward) = (1e-9 * tissue.diagonal(), self.outward());
        let meets = |l: DVec3, h: DVec3| {
            let (middle, half) = ((l + h) / 2.0, (h - l) / 2.0);
            let beyond = |&(n, d): &(DVec3, f64)| n.dot(middle) + d > n.abs().dot(half) + slack;
            !(l.cmpgt(high).any() || h.cmplt(low).any() || outward.iter().any(beyond))
        };
        out.clear();
        out.extend(tissue.faces_where(meets));
    }

    /// Draws the start plane back by `reach` metres, and by half the box at most. Where the tissue moves, the end of the slit does not stay
    /// in a plane, and skin behind the joint would be left as a strand across the slit. What is farther back than that is not to be cut
    /// again. Where the path turns, the box would leave the lips, and cut a film off the outer one: it goes back as far as to the outer
    /// lip on its inner side, and hardly beyond on the other.
    pub(super) fn reach_back(&mut self, tear_box: &TearBox, reach: f64) {
        let [start, end] = &tear_box.quads;
        let way = (0..4).map(|k| end[k] - start[k]).sum::<DVec3>() / 4.0;
        let (along, back) = (way.normalize_or_zero(), reach.min(way.length() / 2.0));
        // from the minus side to the plus; the outer side of a turn lies farther back
        let across = (start[1] + start[2] - start[0] - start[3]) / 2.0;
        let lag = across.dot(along);
        let width = across.reject_from(along).length();
        let turn = 2.0 * lag.abs() * width / across.length_squared();
        let most = |widths: f64| if turn * back > widths * width { widths * width / turn } else { back };
        let plus_is_outer = lag < 0.0;
        let by = [most(INNER_REACH), most(OUTER_REACH)];
        let moved = |k: usize, corner: DVec3| {
            let is_plus = k == 1 || k == 2;
            let edge = (end[k] - start[k]).normalize_or_zero();
            corner - edge * (by[usize::from(is_plus == plus_is_outer)] / edge.dot(along).max(0.1))
        };
        if let Plane::Points(points) = &mut self.planes[0] {
            *points = points.map(|p| start.iter().position(|q| *q == p).map_or(p, |k| moved(k, p)));
        }
        for k in 0..4 {
            self.facets.corners[k] = moved(k, self.facets.corners[k]);
        }
        self.start = 0;
    }

    /// Vertices on the lips of the box before are on this one's sides, however the tissue has moved them, if they are no farther than `most`
    /// from one of the side's planes; `off` gives distances. Where a side is not flat they are on its outermost plane, and on others only if
    /// they are not `inside` of those, metres: faces that meet in a lip would be cut along a plane that passes it by, and at an angle.
    pub(super) fn tag_lips(
        &self,
        lips: &[(VertexId, i8)],
        off: impl Fn(VertexId, &Plane) -> f64,
        [most, inside]: [f64; 2],
        tags: &mut Vec<OnPlanes>,
    ) {
        let of_lip = |&(vertex, side): &(VertexId, i8)| {
            let side = if side < 0 { Side::Minus } else { Side::Plus };
            let of_side = (0..self.sides.len()).filter(|&k| self.sides[k] == side);
            let planes: SmallVec<[(usize, f64); 2]> = of_side.map(|k| (k, off(vertex, &self.planes[k]))).collect();
            let outermost = planes.iter().map(|p| p.1).fold(f64::NEG_INFINITY, f64::max);
            let is_beside = planes.iter().any(|p| p.1.abs() <= most);
            let on = planes.iter().filter(|p| p.1 >= outermost.min(-inside)).fold(0, |m, (k, _)| m | 1 << k);
            is_beside.then_some(OnPlanes { vertex, planes: on })
        };
        tags.extend(lips.iter().filter_map(of_lip));
        tags.sort_unstable_by_key(|t| t.vertex);
        tags.dedup_by(|a, b| {
            b.planes |= if a.vertex == b.vertex { a.planes } else { 0 };
            a.vertex == b.vertex
        });
    }

    /// Tags for this box from the quad edges that vertices of the box before ended on.
    pub(super) fn start_tags(&self, ended: &[OnPlanes], tags: &mut Vec<OnPlanes>) {
        let planes = |edges: EdgeBits| {
            let sides = (0..4).filter(|k| edges >> k & 1 == 1).fold(self.start, |m, k| m | self.edge_planes[0][k]);
            // where two edges meet is a corner, which lies on every facet that holds it
            let corners = (0..4u8).filter(|&c| edges >> c & 1 == 1 && edges >> ((c + 3) % 4) & 1 == 1);
            corners.fold(sides, |m, c| m | self.facets.planes_at(c) & !1)
        };
        tags.clear();
        tags.extend(ended.iter().map(|t| OnPlanes { vertex: t.vertex, planes: planes(t.planes) }));
    }

    /// Vertices on the end joint, with the quad edges they lie on, sorted.
    pub(super) fn end_edges(&self, on_end: &[OnPlanes], ended: &mut Vec<OnPlanes>) {
        let edges = |planes: u16| (0..4).filter(|&k| planes & self.edge_planes[1][k] != 0).fold(0, |m, k| m | 1 << k);
        ended.extend(on_end.iter().map(|t| OnPlanes { vertex: t.vertex, planes: edges(t.planes) }));
        ended.sort_unstable_by_key(|t| t.vertex);
        ended.dedup_by(|a, b| {
            b.planes |= if a.vertex == b.vertex { a.planes } else { 0 };
            a.vertex == b.vertex
        });
    }
}
