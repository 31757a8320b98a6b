//! Casting a blade at the tissue as the user sees it, section by section.

use super::Tissue;
use super::sections::SECTION_MARGIN;
use crate::geometry::{FaceId, Plane, SectionId, VertexId};
use glam::DVec3;
use std::cell::Cell;
use std::ops::Range;

/// How far beyond a face that a blade meets others may be that it meets before, as rounding has it: a share of the blade.
const BEYOND: f64 = 1.0 / 128.0;

impl Tissue {
    /// Faces of the sections whose posed bounds, widened by all displacements, meet `low..high` (tissue space), section by section.
    /// Call [`Tissue::refresh_sections`] first.
    pub(super) fn faces_near(&self, low: DVec3, high: DVec3, out: &mut Vec<FaceId>) {
        out.clear();
        out.extend(self.faces_where(move |l, h| boxes_meet((l, h), (low, high))));
    }

    /// Faces of the sections whose widened posed bounds, low and high, satisfy `meets`. What a box does not, no box in it does.
    pub(super) fn faces_where(&self, meets: impl Fn(DVec3, DVec3) -> bool + Copy) -> impl Iterator<Item = FaceId> {
        let widen = self.widening();
        let seen = move |sections: Range<usize>, (low, high): (DVec3, DVec3)| {
            let turned = self.turn_reach(sections);
            meets(low - widen.1 - turned, high + widen.0 + turned)
        };
        let groups = self.sections.groups().filter(move |(group, bounds)| seen(group.clone(), *bounds));
        let sections = groups.flat_map(|(group, _)| group).filter(move |&s| seen(s..s + 1, self.sections.of(s)));
        sections.flat_map(|s| self.mesh.section_faces(SectionId::new(s)))
    }

    /// Bounds that hold the tissue as it is seen, from those of its sections: no vertex is posed. Call
    /// [`Tissue::refresh_sections`] first.
    pub(super) fn sections_extent(&self) -> (DVec3, DVec3) {
        let (up, down) = self.widening();
        let (low, high) = self.sections.groups().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), (group, (low, high))| {
            let turned = self.turn_reach(group);
            (l.min(low - turned), h.max(high + turned))
        });
        (low - down, high + up)
    }

    /// Faces of the sections whose widened posed bounds `plane` crosses or touches, and whether there are faces beyond them on
    /// its positive and on its negative side. Call [`Tissue::refresh_sections`] first.
    pub(super) fn faces_across(&self, plane: &Plane, out: &mut Vec<FaceId>) -> [bool; 2] {
        out.clear();
        let widen = self.widening();
        let normal = plane.normal();
        let (size, level) = (normal.abs(), plane.distance(DVec3::ZERO));
        // what is left out must be beyond the plane by exact values, too
        let (rounding, a_metre) = (plane.rounding(0.0), plane.rounding(1.0) - plane.rounding(0.0));
        // the side that all of some sections lie on
        let side = |sections: Range<usize>, (low, high): (DVec3, DVec3)| {
            let turned = self.turn_reach(sections);
            let (low, high) = (low - widen.1 - turned, high + widen.0 + turned);
            let doubt = rounding + a_metre * low.abs().max(high.abs()).max_element();
            let (middle, reach) = (normal.dot((low + high) / 2.0) + level, size.dot((high - low) / 2.0) + doubt);
            if middle > reach { Some(0) } else { (middle < -reach).then_some(1) }
        };
        let faces = |s: usize| self.mesh.section_faces(SectionId::new(s));
        let is_filled = |&s: &usize| faces(s).next().is_some();
        let mut beyond = [false; 2];
        for (mut group, bounds) in self.sections.groups() {
            if let Some(side) = side(group.clone(), bounds) {
                beyond[side] |= group.any(|s| is_filled(&s));
                continue;
            }
            for s in group.filter(is_filled) {
                match side(s..s + 1, self.sections.of(s)) {
                    Some(side) => beyond[side] = true,
                    None => out.extend(faces(s)),
                }
            }
        }
        beyond
    }

    /// A vertex of the section whose posed bounds are nearest to `p`: near enough to tie a point of space to the tissue.
    pub(super) fn any_vertex_near(&self, p: DVec3) -> Option<VertexId> {
        let away = |(low, high): (DVec3, DVec3)| (p.clamp(low.min(high), high.max(low)) - p).length_squared();
        let filled = (0..self.sections.len()).filter(|&s| self.mesh.section_faces(SectionId::new(s)).next().is_some());
        let section = filled.min_by(|&a, &b| away(self.sections.of(a)).total_cmp(&away(self.sections.of(b))))?;
        let vertices = self.mesh.section_faces(SectionId::new(section)).flat_map(|f| self.mesh.face(f));
        let near = |v: &VertexId| self.position(*v).distance_squared(p);
        vertices.min_by(|a, b| near(a).total_cmp(&near(b)).then(a.cmp(b)))
    }

    /// How far displacements and fades may carry a vertex along each axis: (towards high, towards low), metres (MATHS 5.8). What
    /// the particles' turns add differs by section: [`Tissue::turn_reach`].
    pub(super) fn widening(&self) -> (DVec3, DVec3) {
        let margin = DVec3::splat(SECTION_MARGIN * self.diagonal);
        let (mut high, mut low) = (margin, margin);
        if let Some(layer) = &self.layer {
            let (mut u_high, mut u_low) = (DVec3::ZERO, DVec3::ZERO);
            for u in layer.displacements() {
                u_high = u_high.max(*u);
                u_low = u_low.min(*u);
            }
            high += u_high;
            low -= u_low;
        }
        if self.fades.running(self.time_s) {
            let stretch = self.pose.joint_matrices.iter().map(|m| {
                let l = m.linear();
                l.x_axis.length_squared() + l.y_axis.length_squared() + l.z_axis.length_squared()
            });
            let reach = self.fades.longest * stretch.fold(1.0, f64::max).sqrt();
            high += reach;
            low += reach;
        }
        (high, low)
    }

    /// Where the segment `base -> tip` first meets the surface: parameter 0 to 1 from the base, and the face. Touching counts.
    /// A base that lies inside a closed surface gives 0. Call [`Tissue::refresh_sections`] first.
    pub fn blade_entry(&self, tip: DVec3, base: DVec3) -> Option<(f64, FaceId)> {
        self.blade_entry_at(tip, base, |v| self.position(v))
    }

    /// [`Tissue::blade_entry`] with known positions. Hands ask in every frame, so nothing is listed; of faces met at once the first
    /// by index counts. What lies a little beyond a face that was met is not looked at.
    pub(super) fn blade_entry_at(&self, tip: DVec3, base: DVec3, position: impl Fn(VertexId) -> DVec3) -> Option<(f64, FaceId)> {
        let mut first: Option<(f64, FaceId)> = None;
        let end = Cell::new(tip);
        let part = &end;
        let line = Line::through(base, tip);
        for f in self.faces_where(move |low, high| segment_meets_box(part.get(), base, low, high)) {
            let corners = self.mesh.corners(f, &position);
            if line.may_meet(corners)
                && boxes_meet(bounds(corners), (base.min(end.get()), base.max(end.get())))
                && let Some(s) = segment_meets_triangle(base, tip, corners)
                && first.is_none_or(|best| (s, f) < best)
            {
                first = Some((s, f));
                end.set(base.lerp(tip, (s + BEYOND).min(1.0)));
            }
        }
        let (s, f) = first?;
        let [a, b, c] = self.mesh.face(f).map(&position);
        let leaves = (b - a).cross(c - a).dot(tip - base) > 0.0;
        Some((if leaves { 0.0 } else { s }, f))
    }
}

/// A line, as it is seen along itself: a point, and two directions across.
struct Line {
    across: [DVec3; 2],
    at: [f64; 2],
    /// More than roundings of what is seen there.
    slack: f64,
}

impl Line {
    fn through(p: DVec3, q: DVec3) -> Self {
        let (one, other) = (q - p).normalize_or(DVec3::X).any_orthonormal_pair();
        Self { across: [one, other], at: [p.dot(one), p.dot(other)], slack: 1e-12 * (p.abs() + q.abs()).element_sum() }
    }

    /// False only if the line misses the triangle: all of its corners are seen on one side, this way or that.
    #[inline]
    fn may_meet(&self, [a, b, c]: [DVec3; 3]) -> bool {
        (0..2).all(|k| {
            let seen = |p: DVec3| p.dot(self.across[k]) - self.at[k];
            let (a, b, c, slack) = (seen(a), seen(b), seen(c), self.slack);
            (a <= slack || b <= slack || c <= slack) && (a >= -slack || b >= -slack || c >= -slack)
        })
    }
}

/// False if two boxes, low and high corner each, are apart.
pub(super) fn boxes_meet((low, high): (DVec3, DVec3), (other_low, other_high): (DVec3, DVec3)) -> bool {
    !(low.cmpgt(other_high).any() || high.cmplt(other_low).any())
}

/// Low and high corner of a triangle's box.
pub(super) fn bounds([a, b, c]: [DVec3; 3]) -> (DVec3, DVec3) {
    (a.min(b).min(c), a.max(b).max(c))
}

/// False only if the segment `p -> q` misses the box.
pub(super) fn segment_meets_box(p: DVec3, q: DVec3, low: DVec3, high: DVec3) -> bool {
    let (half, half_way) = ((high - low) / 2.0, (q - p) / 2.0);
    let (middle, reach) = ((p + q) / 2.0 - (low + high) / 2.0, half_way.abs());
    if middle.abs().cmpgt(half + reach).any() {
        return false;
    }
    // the axes across the segment and an edge of the box, by more than rounding
    let turn = half_way.cross(middle).abs();
    let most =
        DVec3::new(half.y * reach.z + half.z * reach.y, half.z * reach.x + half.x * reach.z, half.x * reach.y + half.y * reach.x);
    let slack = 1e-12 * (reach.length() + half.length()) * (middle.length() + half.length());
    turn.cmple(most + slack).all()
}

fn orient(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> f64 {
    let [a, b, c, d] = [a, b, c, d].map(|p| robust::Coord3D { x: p.x, y: p.y, z: p.z });
    robust::orient3d(a, b, c, d)
}

pub(super) fn edges([a, b, c]: [DVec3; 3]) -> [(DVec3, DVec3); 3] {
    [(a, b), (b, c), (c, a)]
}

/// On which side of a triangle's plane the ends of a segment are, exact in sign.
fn heights(p: DVec3, q: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 2] {
    [p, q].map(|end| orient(a, b, c, end))
}

/// True if the bounds of a segment and a triangle meet.
fn bounds_meet(p: DVec3, q: DVec3, triangle: [DVec3; 3]) -> bool {
    boxes_meet((p.min(q), p.max(q)), bounds(triangle))
}

/// Parameter at which the segment `p -> q` meets a triangle, edges and corners included; `None` if it does not, or lies in its
/// plane.
pub(super) fn segment_triangle(p: DVec3, q: DVec3, triangle: [DVec3; 3]) -> Option<f64> {
    if bounds_meet(p, q, triangle) { segment_meets_triangle(p, q, triangle) } else { None }
}

/// [`segment_triangle`] of a triangle whose bounds meet those of the segment.
fn segment_meets_triangle(p: DVec3, q: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let [dp, dq] = heights(p, q, [a, b, c]);
    if dp == 0.0 && dq == 0.0 || dp * dq > 0.0 {
        return None;
    }
    let turns = edges([a, b, c]).map(|(u, v)| orient(p, q, u, v));
    let inside = turns.iter().all(|&t| t >= 0.0) || turns.iter().all(|&t| t <= 0.0);
    inside.then(|| (dp / (dp - dq)).clamp(0.0, 1.0))
}

/// Where ends of segments count as being that lie in a plane, edge or corner of a triangle: beside it by next to nothing this way.
const BESIDE: DVec3 = DVec3::new(0.613_7, 0.290_3, 0.734_2);

/// Parameter at which the segment `p -> q` goes through a triangle, and whether it goes out through its front; `None` if it does not.
/// Of triangles that meet in an edge or a corner, a segment through it goes through as many as one beside it.
pub(super) fn segment_crosses(p: DVec3, q: DVec3, [a, b, c]: [DVec3; 3]) -> Option<(f64, bool)> {
    if !bounds_meet(p, q, [a, b, c]) {
        return None;
    }
    let [dp, dq] = heights(p, q, [a, b, c]);
    let is_behind = |d: f64| if d == 0.0 { (b - a).cross(c - a).dot(BESIDE) < 0.0 } else { d > 0.0 };
    if is_behind(dp) == is_behind(dq) {
        return None;
    }
    let turns_left = edges([a, b, c]).map(|(u, v)| {
        let turn = orient(p, q, u, v);
        if turn == 0.0 { BESIDE.dot((q - p).cross(u - v)) > 0.0 } else { turn > 0.0 }
    });
    let inside = turns_left.iter().all(|&t| t) || turns_left.iter().all(|&t| !t);
    inside.then(|| ((dp / (dp - dq)).clamp(0.0, 1.0), is_behind(dp)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_segment_meets_the_boxes_that_its_points_are_in() {
        let mut drawn = 0;
        let mut unit = || {
            drawn += 1;
            (crate::particles::random::draw(5, drawn) >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut at = |scale: f64| DVec3::new(unit(), unit(), unit()) * scale;
        let mut missed = 0;
        for _ in 0..2000 {
            let (p, q) = (at(3.0), at(3.0));
            let low = at(2.5);
            let high = low + at(0.7);
            let inside = (0..=400).any(|i| {
                let x = p.lerp(q, f64::from(i) / 400.0);
                x.cmpge(low).all() && x.cmple(high).all()
            });
            let meets = segment_meets_box(p, q, low, high);
            assert!(meets || !inside);
            missed += usize::from(!meets);
        }
        assert!(missed > 1000, "{missed}");
    }

    #[test]
    fn segments_meet_triangles_at_edges_too() {
        let t = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let hit = |x: f64, y: f64| segment_triangle(DVec3::new(x, y, 1.0), DVec3::new(x, y, -3.0), t);
        assert_eq!(hit(0.25, 0.25), Some(0.25));
        assert_eq!(hit(0.5, 0.5), Some(0.25));
        assert_eq!(hit(0.0, 0.0), Some(0.25));
        assert_eq!(hit(0.6, 0.6), None);
        assert_eq!(segment_triangle(DVec3::new(0.2, 0.2, 2.0), DVec3::new(0.2, 0.2, 1.0), t), None);
    }
    /// Segments through edges and corners of a cube leave it once more often than they enter it where they begin inside, and only there.
    #[test]
    fn segments_through_edges_and_corners_count_once() {
        let corner = |k: usize| DVec3::new((k & 1) as f64, (k >> 1 & 1) as f64, (k >> 2) as f64);
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces: Vec<_> = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]].map(|t| t.map(corner))).collect();
        let grid = |k: i32| DVec3::new(f64::from(k % 7), f64::from(k / 7 % 7), f64::from(k / 49)) / 2.0 - 1.0;
        let is_inside = |p: DVec3| p.cmpgt(DVec3::ZERO).all() && p.cmplt(DVec3::ONE).all();
        let on_surface = |p: DVec3| p.cmpge(DVec3::ZERO).all() && p.cmple(DVec3::ONE).all() && !is_inside(p);
        let mut touching = 0;
        for (p, q) in (0..343).flat_map(|i| (0..343).map(move |j| (grid(i), grid(j)))) {
            if p == q || on_surface(p) || on_surface(q) {
                continue;
            }
            let crossings = faces.iter().filter_map(|f| segment_crosses(p, q, *f));
            let sum: i32 = crossings.map(|(_, leaves)| if leaves { 1 } else { -1 }).sum();
            assert_eq!(sum, i32::from(is_inside(p)) - i32::from(is_inside(q)), "{p} to {q}");
            touching += usize::from(faces.iter().filter(|f| segment_triangle(p, q, **f).is_some()).count() > 2);
        }
        assert!(touching > 1000, "{touching}");
    }
}
