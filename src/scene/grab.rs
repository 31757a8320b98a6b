//! Direct displacement: particles inside a sphere follow the hand, the others follow them (the paper's Eq. 2, MATHS 3.4).

use super::{Scene, TissueId};
use crate::geometry::ParticleId;
use glam::DVec3;

/// A hand that holds particles.
#[derive(Clone, Debug)]
pub(super) struct Grab {
    id: u32,
    by: DVec3,
    held: Vec<(TissueId, Vec<(ParticleId, DVec3)>)>,
}

impl Scene {
    /// Takes hold of every particle whose anchor is seen within `radius` of `center` (model space).
    pub(super) fn begin_grab(&mut self, id: u32, center: DVec3, radius: f64) {
        self.end_grab(id);
        let mut held = Vec::new();
        for (&tissue_id, tissue) in &self.tissues {
            let Some(layer) = tissue.layer() else { continue };
            let center = center - tissue.offset();
            let particles: Vec<_> = (0..layer.map.len())
                .map(ParticleId::new)
                .filter(|p| {
                    let anchor = layer.map.anchors[p.index()];
                    anchor.is_some() && tissue.position(anchor).distance(center) <= radius
                })
                .map(|p| (p, layer.displacements()[p.index()]))
                .collect();
            if !particles.is_empty() {
                held.push((tissue_id, particles));
            }
        }
        self.grabs.push(Grab { id, by: DVec3::ZERO, held });
    }

    /// The hand has moved by `by` since it took hold.
    pub(super) fn move_grab(&mut self, id: u32, by: DVec3) {
        for grab in self.grabs.iter_mut().filter(|g| g.id == id) {
            grab.by = by;
        }
    }

    /// Lets go: the springs take over.
    pub(super) fn end_grab(&mut self, id: u32) {
        self.grabs.retain(|g| g.id != id);
        self.move_grabs();
    }

    /// Hands the grabbed particles and their places to the networks.
    pub(super) fn move_grabs(&mut self) {
        for (id, tissue) in &mut self.tissues {
            let held = self.grabs.iter().flat_map(|g| {
                let by = g.by;
                g.held.iter().filter(|h| h.0 == *id).flat_map(move |h| h.1.iter().map(move |&(p, u)| (p, u + by)))
            });
            let mut held: Vec<(ParticleId, DVec3)> = held.collect();
            held.sort_by_key(|h| h.0);
            held.dedup_by_key(|h| h.0);
            tissue.hold_particles(&held);
        }
    }
}
