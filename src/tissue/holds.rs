//! What hands hold, what follows them (MATHS 3.4), and the soft layer's step.

use super::{SoftLayer, Tissue, TissueScratch};
use crate::geometry::{ParticleId, VertexId};
use crate::particles::{Strips, WaysRound};
use crate::physics::direct_displacement::{Followers, target_over};
use glam::DVec3;

/// Of more pairs of held particles and others than this, wounds are looked for between near ones only.
const MOST_PAIRS: usize = 1 << 16;

/// Hands in a tissue.
#[derive(Default)]
pub(super) struct Hands {
    /// Held particles and their displacements, metres.
    pub(super) grabs: Vec<(ParticleId, DVec3)>,
    /// What those are anchored to.
    anchors: Vec<VertexId>,
    /// What others follow, as of the last step: where it is at rest, and its displacement from its rest, metres.
    followed: Vec<(DVec3, DVec3)>,
    followers: Followers,
    pub(super) pulls: Pulls,
}

/// How far the pulls of hands reach.
#[derive(Default)]
pub(super) struct Pulls {
    /// Anchors of what is followed.
    anchors: Vec<VertexId>,
    ways_round: WaysRound,
    /// The first strip of the blade that is in the tissue, if one is.
    pub(super) under_blade: Option<usize>,
    /// Strips that there were at the last step.
    known: usize,
}

impl Hands {
    /// Makes room for hands that hold all of so many particles.
    pub(super) fn make_room(&mut self, particles: usize) {
        let Self { grabs, anchors, followed, followers, pulls } = self;
        grabs.reserve(particles);
        for list in [anchors, &mut pulls.anchors] {
            list.reserve(particles);
        }
        followed.reserve(particles);
        followers.make_room(particles);
        pulls.ways_round.make_room();
    }
}

impl Pulls {
    /// The share of the `k`th pull that reaches a particle at `anchor`. A lip does not follow the hand that pulls at the other, but as far
    /// as the pull goes round the wound; strips from `open` on do not count.
    fn share(&self, strips: &Strips, rest: &[DVec3], anchor: VertexId, k: usize, open: usize) -> f64 {
        if strips.is_empty() { 1.0 } else { self.ways_round.share(strips, rest, anchor, self.anchors[k], open) }
    }

    /// The first strip of the blade at work: a lip that did not follow would fall back into its way.
    fn open(&self) -> usize {
        self.under_blade.unwrap_or(usize::MAX)
    }
}

impl Tissue {
    /// Holds exactly these particles at these displacements (tissue space, metres) until the next call; the particles around
    /// them follow by direct displacement (MATHS 3.4), with weights by distances at rest.
    pub fn hold_particles(&mut self, held: &[(ParticleId, DVec3)]) {
        let Some(layer) = &mut self.layer else { return };
        let Hands { grabs, anchors, .. } = &mut self.scratch.hands;
        if held.is_empty() && grabs.is_empty() {
            return;
        }
        anchors.clear();
        grabs.clear();
        for &(p, u) in held {
            let anchor = layer.map.anchors.get(p.index()).copied().unwrap_or_default();
            if anchor.is_some() {
                anchors.push(anchor);
                grabs.push((p, u));
            }
        }
        self.apply_holds();
    }

    /// Lets go of what an undo has taken away.
    pub(super) fn forget_lost_holds(&mut self) {
        let particles = self.layer.as_ref().map_or(0, |l| l.map.len());
        let Hands { grabs, anchors, followed, pulls, .. } = &mut self.scratch.hands;
        let is_lost = |a: &VertexId| a.index() >= self.rest.len();
        if grabs.iter().any(|g| g.0.index() >= particles) || anchors.iter().any(is_lost) {
            grabs.clear();
            anchors.clear();
        }
        if pulls.anchors.iter().any(is_lost) {
            followed.clear();
            pulls.anchors.clear();
        }
    }

    /// Advances the soft layer by `step_s`: wound rests follow their anchors, springs are propagated (MATHS 4.2).
    pub fn step(&mut self, step_s: f64) {
        self.push_particles(step_s);
        let Some(layer) = &mut self.layer else { return };
        let TissueScratch { step, rest_displacements, hands, rests, stepped, .. } = &mut self.scratch;
        let Hands { grabs, anchors, followed, followers, pulls } = hands;
        let stands = !layer.network.awake() && !layer.is_opening() && grabs.is_empty();
        let now = Some([self.versions.pose, self.versions.structure]);
        if stands && *rests == now {
            return;
        }
        *rests = now.filter(|_| stands);
        let before = stepped.replace([self.versions.pose, self.versions.structure]);
        let is_posed = before.is_some_and(|[pose, structure]| pose != self.versions.pose && structure == self.versions.structure);
        let is_carried = is_posed && grabs.is_empty() && followed.is_empty() && layer.carry_wounds(&self.rows, &self.pose);
        layer.open_wounds(step_s, self.diagonal);
        let SoftLayer { map, strips, settings, .. } = &*layer;
        let (rest, opened) = (&self.rest, |p: usize| layer.opened(p, &self.rows, &self.pose));
        pulls.anchors.clone_from(anchors);
        pulls.known = strips.len();
        followed.clear();
        followed.extend(grabs.iter().zip(&*anchors).map(|(&(p, u), a)| (rest[a.index()], u - opened(p.index()))));
        if followers.set_grabbed(followed, settings.spacing, self.versions.structure) && !followed.is_empty() {
            pulls.ways_round.find(&self.mesh, strips, rest, settings.wound.spacing);
        }
        let few = followed.len() * map.len() < MOST_PAIRS;
        rest_displacements.clear();
        for (p, &anchor) in map.anchors.iter().enumerate() {
            let mut displacement = opened(p);
            if !followed.is_empty() && anchor.is_some() {
                let near = |k: usize| few || followed[k].0.distance(rest[anchor.index()]) < settings.reach();
                let reaches = |k: usize| if near(k) { pulls.share(strips, rest, anchor, k, pulls.open()) } else { 1.0 };
                displacement += followers.target(p, rest[anchor.index()], reaches);
            }
            rest_displacements.push(displacement.to_array());
        }
        let network = &mut layer.network;
        network.set_rest_displacements(rest_displacements);
        let is_awake = network.awake();
        if is_awake {
            network.step(step_s, step);
        }
        if is_awake || is_carried {
            self.versions.displacements += 1;
            self.refresh_turns();
        }
    }

    /// New particles start where hands hold the tissue now, as if wounds since the last step were none, and as far off as those around
    /// them are off their rest. In tissue that is held aside they would fall back first, under the blade.
    pub(super) fn start_particles(&mut self, new: &[ParticleId]) {
        let Some(SoftLayer { map, strips, settings, network, .. }) = &mut self.layer else { return };
        let Hands { followed, pulls, .. } = &mut self.scratch.hands;
        let open = pulls.open().min(pulls.known);
        for &p in new {
            let anchor = map.anchors[p.index()];
            let at = self.rest[anchor.index()];
            let pull = |k: usize| (followed[k].0, followed[k].1, pulls.share(strips, &self.rest, anchor, k, open) as f32);
            let rest = target_over(at, (0..followed.len()).map(pull), settings.spacing);
            let (mut weight, mut off, mut velocity) = (0.0, DVec3::ZERO, DVec3::ZERO);
            for link in map.neighbours.row(p.index()).iter().filter(|l| l.particle < p) {
                let (w, q) = (f64::from(link.weight), link.particle);
                weight += w;
                off += w * (network.displacement(q) - network.rest_displacement(q));
                velocity += w * network.velocity(q);
            }
            let [off, velocity] = if weight > 0.0 { [off / weight, velocity / weight] } else { [DVec3::ZERO; 2] };
            if (rest, off, velocity) != (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO) {
                network.set_start(p, rest, off, velocity);
                self.versions.starts += 1;
            }
        }
    }
}
