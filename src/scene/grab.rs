//! Direct displacement: particles inside a sphere follow the hand, the others follow them (the paper's Eq. 2, MATHS 3.4).

use super::{Scene, TissueId};
use crate::geometry::ParticleId;
use glam::DVec3;

/// Hands that room is made for.
const HANDS: usize = 4;

/// A particle that a hand holds.
#[derive(Clone, Copy, Debug)]
struct Held {
    tissue: TissueId,
    particle: ParticleId,
    /// Its displacement when it was taken hold of.
    displacement: DVec3,
    /// Its place then, in model space.
    place: DVec3,
}

/// A hand that holds particles.
#[derive(Clone, Debug, Default)]
pub(super) struct Grab {
    id: u32,
    by: DVec3,
    /// By tissue, then particle.
    held: Vec<Held>,
}

impl Grab {
    /// What it holds of a tissue, ascending.
    fn particles_of(&self, tissue: TissueId) -> &[Held] {
        let from = self.held.partition_point(|h| h.tissue < tissue);
        let count = self.held[from..].partition_point(|h| h.tissue == tissue);
        &self.held[from..from + count]
    }
}

/// What hands hold.
pub(super) struct Grabs {
    /// In the order they took hold.
    at_work: Vec<Grab>,
    /// Hands that hold nothing: room for others.
    spare: Vec<Grab>,
    /// Scratch: particles held in one tissue, and where.
    all: Vec<(ParticleId, DVec3)>,
}

impl Grabs {
    /// None, with room for a few hands in a scene of so many particles.
    pub(super) fn with_room(particles: usize) -> Self {
        let spare = || Grab { held: Vec::with_capacity(particles), ..Grab::default() };
        Self {
            at_work: Vec::with_capacity(HANDS),
            spare: (0..HANDS).map(|_| spare()).collect(),
            all: Vec::with_capacity(particles),
        }
    }

    /// True if no hand holds.
    pub(super) fn are_empty(&self) -> bool {
        self.at_work.is_empty()
    }

    /// All hands let go.
    pub(super) fn let_go(&mut self) {
        self.spare.append(&mut self.at_work);
    }
}

impl Scene {
    /// Takes hold of every particle whose anchor is seen within `radius` of `center` (model space).
    pub(super) fn begin_grab(&mut self, id: u32, center: DVec3, radius: f64) {
        self.end_grab(id);
        let mut grab = self.grabs.spare.pop().unwrap_or_default();
        grab.held.clear();
        for (&id, tissue) in &self.tissues {
            let Some(layer) = tissue.layer() else { continue };
            let center = tissue.to_tissue(center);
            let is_near = |p: &ParticleId| {
                let anchor = layer.map.anchors[p.index()];
                anchor.is_some() && tissue.position(anchor).distance(center) <= radius
            };
            grab.held.extend((0..layer.map.len()).map(ParticleId::new).filter(is_near).map(|particle| Held {
                tissue: id,
                particle,
                displacement: layer.displacements()[particle.index()],
                place: tissue.particle_in_model(particle),
            }));
        }
        (grab.id, grab.by) = (id, DVec3::ZERO);
        self.grabs.at_work.push(grab);
    }

    /// The hand has moved by `by` since it took hold.
    pub(super) fn move_grab(&mut self, id: u32, by: DVec3) {
        for grab in self.grabs.at_work.iter_mut().filter(|g| g.id == id) {
            grab.by = by;
        }
    }

    /// Lets go of particles that an undo has taken away, before others get their numbers.
    pub(super) fn prune_grabs(&mut self) {
        let Self { grabs, tissues, .. } = self;
        let lives = |h: &Held| {
            let layer = tissues.get(&h.tissue).and_then(|t| t.layer());
            layer.is_some_and(|l| l.map.anchors.get(h.particle.index()).is_some_and(|a| a.is_some()))
        };
        grabs.at_work.iter_mut().for_each(|grab| grab.held.retain(lives));
    }

    /// Lets go: the springs take over.
    pub(super) fn end_grab(&mut self, id: u32) {
        let Grabs { at_work, spare, .. } = &mut self.grabs;
        while let Some(i) = at_work.iter().position(|g| g.id == id) {
            spare.push(at_work.remove(i));
        }
        self.move_grabs();
    }

    /// Hands the grabbed particles and their places to the networks.
    pub(super) fn move_grabs(&mut self) {
        let Self { grabs: Grabs { at_work, all, .. }, tissues, rigid, .. } = self;
        for (id, tissue) in tissues {
            // A fixed tissue's particles keep their offset from the moving anchors; a loose piece's stay in the hand.
            let loose = rigid.body_of(*id).is_some();
            all.clear();
            for (k, grab) in at_work.iter().enumerate() {
                for held in grab.particles_of(*id) {
                    let p = held.particle;
                    // who came first holds it
                    let is_taken = |g: &Grab| g.particles_of(*id).binary_search_by_key(&p, |h| h.particle).is_ok();
                    if !at_work[..k].iter().any(is_taken) {
                        let at = || tissue.displacement_to(p, held.place + grab.by);
                        all.push((p, if loose { at() } else { held.displacement + grab.by }));
                    }
                }
            }
            all.sort_unstable_by_key(|h| h.0);
            tissue.hold_particles(all);
        }
    }
}
