//! Direct displacement: particles inside a sphere follow the hand, the others follow them (the paper's Eq. 2, MATHS 3.4).

use super::{Scene, TissueId};
use crate::geometry::{ParticleId, VertexId};
use crate::tissue::Tissue;
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

    /// Hands keep the particles where they are whatever moves the tissue from now on.
    fn keep_in_place(&mut self, id: TissueId, tissue: &Tissue) {
        for grab in &mut self.at_work {
            let by = grab.by;
            let held = grab.held.iter_mut().filter(|h| h.tissue == id);
            held.for_each(|h| h.place = tissue.particle_in_model(h.particle) - by);
        }
    }

    /// Hands go on holding what they hold under another name, or let go of it.
    fn rename(&mut self, new: impl Fn(&Held) -> Option<(TissueId, ParticleId)>) {
        for grab in &mut self.at_work {
            grab.held.retain_mut(|held| {
                let now = new(held);
                now.inspect(|&(tissue, particle)| (held.tissue, held.particle) = (tissue, particle)).is_some()
            });
            grab.held.sort_unstable_by_key(|h| (h.tissue, h.particle));
        }
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

    /// What hands hold of a tissue, and what it is anchored to there, to be known before pieces come off it; what is loose from then on
    /// stays in the hand.
    pub(super) fn held_before_parting(&mut self, id: TissueId) -> Vec<(ParticleId, VertexId)> {
        let Some(tissue) = self.tissues.get(&id).filter(|_| !self.grabs.are_empty()) else { return Vec::new() };
        let Some(layer) = tissue.layer() else { return Vec::new() };
        if self.rigid.body_of(id).is_none() {
            self.grabs.keep_in_place(id, tissue);
        }
        let held = self.grabs.at_work.iter().flat_map(|grab| grab.particles_of(id));
        held.map(|h| (h.particle, layer.map.anchors.get(h.particle.index()).copied().unwrap_or_default())).collect()
    }

    /// Hands go on holding in `pieces` what has come off `parent` with them; `held` is what [`Scene::held_before_parting`] told.
    pub(super) fn hold_pieces(&mut self, parent: TissueId, pieces: &[TissueId], held: &[(ParticleId, VertexId)]) {
        let Self { grabs, tissues, .. } = self;
        let anchors = tissues.get(&parent).and_then(|t| t.layer()).map(|layer| &layer.map.anchors);
        let Some(anchors) = anchors.filter(|_| !held.is_empty()) else { return };
        grabs.rename(|h| {
            let known = held.iter().find(|k| h.tissue == parent && k.0 == h.particle);
            let Some(&(p, anchor)) = known.filter(|k| anchors.get(k.0.index()) != Some(&k.1)) else {
                return Some((h.tissue, h.particle));
            };
            pieces.iter().find_map(|id| Some((*id, tissues.get(id)?.particle_that_was(p, anchor)?)))
        });
    }

    /// Hands go on holding in `parent` what they held of a piece that has gone back into it.
    pub(super) fn hold_parent(&mut self, parent: TissueId, id: TissueId, piece: &Tissue) {
        self.grabs.rename(|h| match h.tissue == id {
            true => Some((parent, piece.particle_before(h.particle)?)),
            false => Some((h.tissue, h.particle)),
        });
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
