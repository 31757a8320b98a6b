//! The particle map after a plane cut (MATHS 3.2). A plane parts every edge it meets, so no strip is left and none is asked:
//! a vertex on the cut knows its side by the edge it was made on, a particle by its anchor, and they are linked only if these
//! are the same. Links of vertices that were there before go when the pieces are taken apart, since by then no anchor of one
//! side is connected to a vertex of the other.

use super::build::{normalise, sigmoid_weight};
use super::map_update::EXTRA_INFLUENCES;
use super::particle_map::{Influence, ParticleMap};
use super::settings::ParticleSettings;
use super::strips::Strips;
use crate::geometry::{ParticleId, VertexId};
use glam::DVec3;

/// What the rows of a cut need to know of a particle.
#[derive(Clone, Copy, Debug)]
struct Known {
    at: DVec3,
    radius: f64,
    strength: f64,
    positive: bool,
}

/// Scratch of [`update_after_plane_cut`], kept between cuts.
#[derive(Clone, Debug, Default)]
pub struct PlaneUpdateScratch {
    /// The cut that last asked for a particle, and the particle's place in `known`.
    slots: Vec<[u32; 2]>,
    cut: u32,
    known: Vec<Known>,
    candidates: Vec<ParticleId>,
    /// Of the positive side, then of the negative.
    weighted: [Vec<(f64, ParticleId)>; 2],
    row: Vec<Influence>,
}

/// Vertices that a plane cut made, in order of their ids: first the pairs.
#[derive(Clone, Copy, Debug)]
pub struct PlaneCutVertices<'a, P> {
    /// Vertices made on a crossed edge, on the positive side and on the negative, and the edge's ends.
    pub pairs: P,
    /// Copies of vertices that lay on the plane: the copy, and what it is a copy of.
    pub copies: &'a [(VertexId, VertexId)],
}

/// Gives rows to the vertices that a plane cut made. `rest` has a position for every vertex slot; `on_positive_side` tells on
/// which side of the cut an anchor is. A vertex none of whose parents' particles is on its side keeps theirs, until the
/// pieces part. False if some vertex is left without a particle, since strips part it from all that its parents have.
pub fn update_after_plane_cut(
    rest: &[DVec3],
    map: &mut ParticleMap,
    strips: &mut Strips,
    made: PlaneCutVertices<'_, impl Iterator<Item = ([VertexId; 2], [VertexId; 2])>>,
    on_positive_side: impl Fn(&ParticleMap, VertexId) -> bool,
    settings: &ParticleSettings,
    scratch: &mut PlaneUpdateScratch,
) -> bool {
    let mut all_held = true;
    scratch.begin(map.len());
    for (vertices, parents) in made.pairs {
        map.influences.grow_rows(vertices[0].index());
        if !strips.is_empty() {
            share_lips(strips, vertices, parents);
        }
        scratch.gather(map, parents);
        let at = rest[vertices[0].index()];
        for i in 0..scratch.candidates.len() {
            let j = scratch.candidates[i];
            let known = scratch.known(map, rest, settings, &on_positive_side, j);
            let weight = known.strength * sigmoid_weight(known.at.distance(at), known.radius);
            let side = usize::from(!known.positive);
            if strips.is_empty() || strips.connects_vertices(rest, vertices[side], map.anchors[j.index()]) {
                scratch.weighted[side].push((weight, j));
            }
        }
        for side in 0..2 {
            let within_reach = scratch.fill_row(side, settings);
            map.influences.push_row(&scratch.row);
            strips.note_held(vertices[side], at, &scratch.row, !within_reach);
            all_held &= !scratch.row.is_empty();
        }
    }
    for &(copy, from) in made.copies {
        map.influences.grow_rows(copy.index());
        if !strips.is_empty() {
            share_lips(strips, [copy; 2], [from; 2]);
        }
        scratch.row.clear();
        scratch.row.extend_from_slice(map.influences.row(from.index()));
        map.influences.push_row(&scratch.row);
        strips.note_held(copy, rest[copy.index()], &scratch.row, true);
    }
    all_held
}

/// A vertex between two that are on one lip is on it too.
fn share_lips(strips: &mut Strips, vertices: [VertexId; 2], parents: [VertexId; 2]) {
    if parents.iter().any(|&p| strips.lip_sides(p).is_empty()) {
        return;
    }
    let mut common = strips.lip_sides(parents[0]).to_vec();
    common.retain(|lip| strips.lip_sides(parents[1]).contains(lip));
    for lip in common {
        for v in vertices {
            strips.set_lip(v, lip.strip as usize, lip.side as i8);
        }
    }
}

impl PlaneUpdateScratch {
    fn begin(&mut self, particles: usize) {
        if self.cut == u32::MAX {
            self.slots.fill([0; 2]);
            self.cut = 0;
        }
        self.cut += 1;
        self.slots.resize(self.slots.len().max(particles), [0; 2]);
        self.known.clear();
    }

    /// Particles of both parents, ascending.
    fn gather(&mut self, map: &ParticleMap, parents: [VertexId; 2]) {
        self.weighted.iter_mut().for_each(Vec::clear);
        self.candidates.clear();
        let [mut a, mut b] = parents.map(|p| map.influences.row(p.index()));
        while let (Some(x), Some(y)) = (a.first(), b.first()) {
            self.candidates.push(x.particle.min(y.particle));
            (a, b) = (&a[usize::from(x.particle <= y.particle)..], &b[usize::from(y.particle <= x.particle)..]);
        }
        self.candidates.extend(a.iter().chain(b).map(|e| e.particle));
    }

    fn known(
        &mut self,
        map: &ParticleMap,
        rest: &[DVec3],
        settings: &ParticleSettings,
        on_positive_side: &impl Fn(&ParticleMap, VertexId) -> bool,
        j: ParticleId,
    ) -> &Known {
        let slot = &mut self.slots[j.index()];
        if slot[0] != self.cut {
            *slot = [self.cut, self.known.len() as u32];
            let anchor = map.anchors[j.index()];
            self.known.push(Known {
                at: rest[anchor.index()],
                radius: settings.radius_of(map, j),
                strength: if map.is_wound(j) { settings.wound.strength } else { 1.0 },
                positive: on_positive_side(map, anchor),
            });
        }
        &self.known[slot[1] as usize]
    }

    /// The row of one side from what was weighed. False if its particles are out of reach.
    fn fill_row(&mut self, side: usize, settings: &ParticleSettings) -> bool {
        let limit = settings.max_influences + EXTRA_INFLUENCES / 2;
        self.row.clear();
        if self.weighted[side].iter().all(|e| e.0 <= 0.0) {
            // out of reach of all that its parents have, as in a map built from few anchors
            let others = usize::from(self.weighted[side].is_empty());
            let held = &self.weighted[side ^ others];
            let share = 1.0 / held.len().min(limit) as f32;
            self.row.extend(held.iter().take(limit).map(|&(_, particle)| Influence { particle, weight: share }));
            return false;
        }
        let own = &mut self.weighted[side];
        if own.len() > limit {
            normalise(own, limit);
        }
        let sum: f64 = own.iter().map(|e| e.0).sum();
        let influence = |&(w, particle): &(f64, ParticleId)| Influence { particle, weight: (w / sum) as f32 };
        self.row.extend(own.iter().map(influence).filter(|e| e.weight >= f32::MIN_POSITIVE));
        true
    }
}
