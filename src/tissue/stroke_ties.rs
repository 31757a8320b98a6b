//! What holds the blade's pending quads to moving tissue (MATHS 5.5).

use super::{TearStroke, nearest_of, nearest_vertex};
use crate::geometry::VertexId;
use crate::tissue::Tissue;
use glam::DVec3;

/// A pending quad tied to the tissue by the frame of a vertex near it (MATHS 5.5).
pub(super) struct Tie {
    serial: u32,
    vertex: VertexId,
    rest: [DVec3; 4],
    posed: [DVec3; 4],
}

impl TearStroke {
    /// Moves the pending quads with the tissue (MATHS 5.5). Those it has not moved keep their bits.
    pub(super) fn follow_tissue(&mut self, tissue: &Tissue) {
        self.moved = false;
        for (serial, quad) in self.stroke.builder().pending_quads_mut() {
            let Some(tie) = self.ties.iter_mut().find(|t| t.serial == serial) else { continue };
            for k in 0..4 {
                let now = tissue.to_posed(tie.vertex, tie.rest[k]);
                if now != tie.posed[k] {
                    quad[k] += now - tie.posed[k];
                    tie.posed[k] = now;
                    (self.moved, self.has_moved) = (true, true);
                }
            }
        }
    }

    /// Ties the pending quads: one that a slit has just ended in to the slit's end, which the next strip has to start from, others to the
    /// nearest live vertices. A tie whose vertex lives is kept, but for that.
    pub(super) fn tie_quads(&mut self, tissue: &Tissue) {
        let Self { stroke, ties, near, nearby, candidates, positions, ended, slits, .. } = self;
        nearby.clear();
        nearby.extend_from_slice(near);
        for chain in stroke.builder().open_chains() {
            // what the other lane's last box has touched
            nearby.extend(ended.iter().filter(|e| e.chain == chain).flat_map(|e| &e.near));
        }
        let pending = stroke.builder().pending_quads_mut();
        let mut kept = 0;
        for (serial, quad) in pending {
            let [tip, top] = [(quad[0] + quad[1]) / 2.0, (quad[2] + quad[3]) / 2.0];
            let end = slits.end_on(tissue, [tip, top]);
            let keeps = |t: &Tie| tissue.mesh.vertex_is_live(t.vertex) && end.is_none_or(|v| v == t.vertex);
            let old = ties[kept..].iter().position(|t| t.serial == serial && keeps(t));
            if let Some(at) = old {
                ties.swap(kept, kept + at);
                kept += 1;
                continue;
            }
            // the blade may have gone elsewhere since the last box
            let reach = 2.0 * quad[0].distance(quad[2]);
            let seen = |v| positions.of(tissue, v);
            let close = nearest_of(tissue, nearby, top, &seen).filter(|&v| seen(v).distance(top) <= reach);
            let nearest = || close.or_else(|| nearest_vertex(tissue, candidates, top, &seen));
            if let Some(vertex) = end.or_else(nearest).or_else(|| tissue.any_vertex_near(top)) {
                let rest = quad.map(|p| tissue.to_rest(vertex, p));
                ties.insert(kept, Tie { serial, vertex, rest, posed: rest.map(|p| tissue.to_posed(vertex, p)) });
                kept += 1;
            }
        }
        ties.truncate(kept);
    }
}
