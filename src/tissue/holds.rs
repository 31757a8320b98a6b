//! What hands hold, what follows them (MATHS 3.4), and the soft layer's step.

use super::{SoftLayer, Tissue, TissueScratch};
use crate::geometry::ParticleId;
use glam::DVec3;

/// Of more pairs of held particles and others than this, wounds are looked for between near ones only.
const MOST_PAIRS: usize = 1 << 16;

impl Tissue {
    /// Holds exactly these particles at these displacements (tissue space, metres) until the next call; the particles around
    /// them follow by direct displacement (MATHS 3.4), with weights by distances at rest.
    pub fn hold_particles(&mut self, held: &[(ParticleId, DVec3)]) {
        let Some(layer) = &mut self.layer else { return };
        if held.is_empty() && self.scratch.grabs.is_empty() {
            return;
        }
        self.scratch.anchors_held.clear();
        self.scratch.grabs.clear();
        for &(p, u) in held {
            let anchor = layer.map.anchors.get(p.index()).copied().unwrap_or_default();
            if anchor.is_some() {
                self.scratch.anchors_held.push(anchor);
                self.scratch.grabs.push((p, u));
            }
        }
        self.apply_holds();
    }

    /// Advances the soft layer by `step_s`: wound rests follow their anchors, springs are propagated (MATHS 4.2).
    pub fn step(&mut self, step_s: f64) {
        self.push_particles(step_s);
        let Some(layer) = &mut self.layer else { return };
        let TissueScratch {
            step,
            rest_displacements,
            grabs,
            anchors_held,
            followed,
            followers,
            ways_round,
            rests,
            under_blade,
            ..
        } = &mut self.scratch;
        let stands = !layer.network.awake() && !layer.is_opening() && grabs.is_empty();
        let now = Some([self.versions.pose, self.versions.structure]);
        if stands && *rests == now {
            return;
        }
        *rests = now.filter(|_| stands);
        layer.open_wounds(step_s, self.diagonal);
        let SoftLayer { map, opening, strips, settings, network, .. } = layer;
        let (rest, rows, pose) = (&self.rest, &self.rows, &self.pose);
        let opened = |p: usize| {
            let (u0, anchor) = (opening[p], map.anchors[p]);
            if u0 == DVec3::ZERO || anchor.is_none() { DVec3::ZERO } else { pose.blended_linear(rows, anchor) * u0 }
        };
        if grabs.iter().any(|g| g.0.index() >= map.len()) || anchors_held.iter().any(|a| a.index() >= rest.len()) {
            (*grabs, *anchors_held) = Default::default(); // by an undo
        }
        followed.clear();
        followed.extend(grabs.iter().zip(&*anchors_held).map(|(&(p, u), a)| (rest[a.index()], u - opened(p.index()))));
        if followers.set_grabbed(followed, settings.spacing, self.versions.structure) && !followed.is_empty() {
            ways_round.find(&self.mesh, strips, rest, settings.wound.spacing);
        }
        let few = followed.len() * map.len() < MOST_PAIRS;
        rest_displacements.clear();
        for (p, &anchor) in map.anchors.iter().enumerate() {
            let mut displacement = opened(p);
            if !followed.is_empty() && anchor.is_some() {
                // a lip does not follow the hand that pulls at the other, but as far as the pull goes round the wound; while the blade is
                // at work it does, or would fall back into its way
                let near = |k: usize| few || followed[k].0.distance(rest[anchor.index()]) < settings.reach();
                let share = |k: usize| ways_round.share(strips, rest, anchor, anchors_held[k], under_blade.unwrap_or(usize::MAX));
                let reaches = |k: usize| if strips.is_empty() || !near(k) { 1.0 } else { share(k) };
                displacement += followers.target(p, rest[anchor.index()], reaches);
            }
            rest_displacements.push(displacement.to_array());
        }
        network.set_rest_displacements(rest_displacements);
        if layer.network.awake() {
            layer.network.step(step_s, step);
            self.versions.displacements += 1;
            self.refresh_turns();
        }
    }
}
