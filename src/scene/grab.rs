//! Direct displacement: particles inside a sphere follow the hand, the others follow them (the paper's Eq. 2, MATHS 3.4).

use super::{Scene, TissueId};
use crate::geometry::ParticleId;
use glam::DVec3;

/// A particle, its displacement and its place (model space) when it was taken hold of.
type Held = (ParticleId, DVec3, DVec3);

/// A hand that holds particles.
#[derive(Clone, Debug)]
pub(super) struct Grab {
    id: u32,
    by: DVec3,
    held: Vec<(TissueId, Vec<Held>)>,
}

impl Grab {
    /// What it holds of a tissue, ascending.
    fn particles_of(&self, tissue: TissueId) -> &[Held] {
        self.held.iter().find(|h| h.0 == tissue).map_or(&[], |h| &h.1)
    }
}

impl Scene {
    /// Takes hold of every particle whose anchor is seen within `radius` of `center` (model space).
    pub(super) fn begin_grab(&mut self, id: u32, center: DVec3, radius: f64) {
        self.end_grab(id);
        let mut held = Vec::new();
        for (&tissue_id, tissue) in &self.tissues {
            let Some(layer) = tissue.layer() else { continue };
            let center = tissue.to_tissue(center);
            let particles: Vec<_> = (0..layer.map.len())
                .map(ParticleId::new)
                .filter(|p| {
                    let anchor = layer.map.anchors[p.index()];
                    anchor.is_some() && tissue.position(anchor).distance(center) <= radius
                })
                .map(|p| (p, layer.displacements()[p.index()], tissue.particle_in_model(p)))
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

    /// Lets go of particles that an undo has taken away, before others get their numbers.
    pub(super) fn prune_grabs(&mut self) {
        let Self { grabs, tissues, .. } = self;
        for (id, held) in grabs.iter_mut().flat_map(|grab| &mut grab.held) {
            let map = tissues.get(id).and_then(|t| t.layer()).map(|l| &l.map);
            held.retain(|h| map.is_some_and(|map| map.anchors.get(h.0.index()).is_some_and(|a| a.is_some())));
        }
    }

    /// Lets go: the springs take over.
    pub(super) fn end_grab(&mut self, id: u32) {
        self.grabs.retain(|g| g.id != id);
        self.move_grabs();
    }

    /// Hands the grabbed particles and their places to the networks.
    pub(super) fn move_grabs(&mut self) {
        let mut all = std::mem::take(&mut self.held);
        for (id, tissue) in &mut self.tissues {
            // A fixed tissue's particles keep their offset from the moving anchors; a loose piece's stay in the hand.
            let loose = self.rigid.body_of(*id).is_some();
            all.clear();
            for (k, grab) in self.grabs.iter().enumerate() {
                for &(p, u, at) in grab.particles_of(*id) {
                    // who came first holds it
                    let taken = self.grabs[..k].iter().any(|g| g.particles_of(*id).binary_search_by_key(&p, |h| h.0).is_ok());
                    if !taken {
                        all.push((p, if loose { tissue.displacement_to(p, at + grab.by) } else { u + grab.by }));
                    }
                }
            }
            all.sort_unstable_by_key(|h| h.0);
            tissue.hold_particles(&all);
        }
        all.clear();
        self.held = all;
    }
}
