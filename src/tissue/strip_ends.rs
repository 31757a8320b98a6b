//! How far along its blades the strip of a box reaches, and where its ends are at rest.
//!
//! A strip parts what lies on both sides of it at rest (MATHS 3.2). In a wound that stands open the blade goes through air above what it
//! cuts, and the tissue beside that air lies elsewhere at rest: there a strip ends where the cut does.

use super::{TearStroke, nearest_of, nearest_vertex};
use crate::geometry::VertexId;
use crate::surgery::TearBox;
use crate::tissue::Tissue;
use glam::DVec3;

/// A box whose cut reaches so much higher in walls than in skin, in radii of influence, went on in an open wound.
const IN_WOUND: f64 = 0.1;

impl TearStroke {
    /// A blade `[tip, top]` of a box, carried to rest space by the nearest surface vertex. It ends not far above what was torn: a vertex's
    /// frame holds near it, and the next box may have another.
    pub(super) fn rest_edge(&self, tissue: &Tissue, [tip, top]: [DVec3; 2]) -> [DVec3; 2] {
        let seen = |v| self.positions.of(tissue, v);
        let share = |v: &VertexId| (seen(*v) - tip).dot(top - tip) / (top - tip).length_squared();
        let highest = self.near.iter().filter(|v| tissue.mesh.vertex_is_live(**v)).map(share).fold(0.0, f64::max);
        let top = if highest > 0.0 && highest < 0.5 { tip.lerp(top, 2.0 * highest) } else { top };
        match nearest_of(tissue, &self.near, top, &seen).or_else(|| nearest_vertex(tissue, &self.candidates, top, &seen)) {
            Some(v) => [tip, top].map(tissue.rest_frame(v)),
            None => [tip, top],
        }
    }

    /// How far up blade `end` of a box its cut reaches, as a share of the blade: in all, and where it cut skin.
    fn cut_heights(&self, tissue: &Tissue, tear_box: &TearBox, end: usize) -> [f64; 2] {
        let [tip, top] = tear_box.blades[end];
        let share = |p: DVec3| (p - tip).dot(top - tip) / (top - tip).length_squared();
        let is_skin = |v: VertexId| tissue.mesh.fan(v).any(|h| !tissue.mesh.face_info(h.face()).is_interior());
        self.step.new_vertices.iter().filter(|n| tissue.mesh.vertex_is_live(n.vertex)).fold([0.0; 2], |[all, skin], n| {
            let height = share(n.position).min(1.0);
            [height.max(all), if height > skin && is_skin(n.vertex) { height } else { skin }]
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
