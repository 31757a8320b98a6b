//! Which side of a new strip the vertices beside its lips lie on, where the strip at rest says otherwise.
//!
//! A strip is straight at rest, and the blade went straight through tissue that was bent or held aside: by a little they part other
//! vertices. What was seen counts, for the mesh was cut there; such vertices know their side as lips do (MATHS 3.2). So do vertices right
//! beside a slit without width, where it bends: lips hang together along it, and skin that does not follow them is folded.

use super::Tissue;
use crate::geometry::VertexId;
use crate::particles::strip_test::distance_squared_to_triangle;
use crate::particles::{LipVertex, StripGeometry};
use crate::surgery::insert::NewVertex;
use crate::surgery::tear::LipPoint;
use glam::DVec3;

/// Vertices that are nearer to a slit without width go with its lips, as a share of the radius of influence, where the skin stands where it
/// does at rest: in skin that a hand or a pose holds elsewhere they left more threads across the slit.
const GOES_ALONG: f64 = 0.03;

/// Lips and vertices beside them that are looked at.
const MOST_LOOKED_AT: usize = 1024;

impl Tissue {
    /// Lists the lips of strip `strip`: those the cut has told (`points`), and the vertices beside them that were `seen` over or under it as
    /// it was cut, between two blades (`[tip, base]`), and lie on the other side of it at rest, or right beside it if it has no width.
    /// Vertices that the cut has `made` are not looked at, but for those along what it has left `closed`.
    pub(super) fn list_lips(
        &self,
        (strip, [[tip, base], [next_tip, next_base]]): (usize, [[DVec3; 2]; 2]),
        (points, made, closed): (impl Iterator<Item = LipPoint>, &[NewVertex], &[VertexId]),
        has_width: bool,
        seen: impl Fn(VertexId) -> DVec3,
        lips: &mut Vec<LipVertex>,
    ) {
        // a strip's normal, travel x up, points to the minus side of boxes and leaves
        lips.extend(points.map(|l| LipVertex { vertex: l.vertex, strip, side: -l.side }));
        let turned = if self.is_turned(strip, lips) { -1 } else { 1 };
        lips.iter_mut().for_each(|l| l.side *= turned);
        // where all vertices are seen where they are at rest, nothing differs
        let Some(layer) = self.layer.as_ref().filter(|_| !has_width || self.posed().rest.is_none()) else { return };
        let cut = StripGeometry::new([tip, next_tip, next_base, base], layer.strips.as_slice()[strip].reach);
        let (at_rest, first_new) = (layer.strips.geometry(strip), made.first().map_or(VertexId::NONE, |n| n.vertex));
        let near = if has_width { 0.0 } else { GOES_ALONG * layer.settings.radius };
        let goes_along = |p: DVec3, seen: DVec3, side: i8| {
            let is_beside = |t: &[DVec3; 3]| distance_squared_to_triangle(p, *t) < near * near;
            (p.distance_squared(seen) < near * near || at_rest.side_over(p) == side) && at_rest.triangles.iter().any(is_beside)
        };
        let mut next = 0;
        while next < lips.len().min(MOST_LOOKED_AT) {
            let from = lips[next];
            next += 1;
            if !self.mesh.vertex_is_live(from.vertex) {
                continue;
            }
            let is_told = |v: VertexId| v >= first_new || layer.strips.knows_side(strip, v);
            let goes_with = |v: VertexId| {
                let (p, seen) = (self.rest[v.index()], seen(v));
                let is_hidden = at_rest.side_near(p) == -from.side || goes_along(p, seen, from.side);
                is_hidden && cut.side_over(seen) == from.side * turned
            };
            for v in self.mesh.neighbours(from.vertex).filter(|v| closed.contains(v) || !is_told(*v) && goes_with(*v)) {
                if lips.iter().all(|l| l.vertex != v) {
                    lips.push(LipVertex { vertex: v, ..from });
                }
            }
        }
    }

    /// True if all lips of a strip stand on its other side at rest: a blade that went along itself goes the other way there. One that goes on
    /// from another has that one's sides.
    fn is_turned(&self, strip: usize, lips: &[LipVertex]) -> bool {
        let Some(layer) = self.layer.as_ref().filter(|layer| !layer.strips.goes_on(strip)) else { return false };
        let at_rest = layer.strips.geometry(strip);
        let side = |l: &LipVertex| at_rest.side_near(self.rest[l.vertex.index()]) * l.side;
        !lips.is_empty() && lips.iter().all(|l| self.mesh.vertex_is_live(l.vertex) && side(l) < 0)
    }
}
