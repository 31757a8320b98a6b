//! Strip tests of the links of particles: the strips that a particle's links may meet are found once and kept.

use super::particle_map::ParticleMap;
use super::settings::ParticleSettings;
use super::strips::Strips;
use crate::geometry::{ParticleId, VertexId};
use glam::DVec3;

/// More new strips than this are looked up in the tree and not one by one.
const FEW: usize = 24;

/// The strips near each particle, by particle. Anchors and strips do not move in rest space, so an update only has to look at the
/// strips that are new; an undo, which takes strips away, forgets everything.
#[derive(Clone, Debug, Default)]
pub(super) struct LinkTests {
    particles: Vec<NearStrips>,
    found: Vec<u32>,
}

/// The strips near one particle.
#[derive(Clone, Debug, Default)]
struct NearStrips {
    anchor: VertexId,
    /// Strips looked at: all before this one.
    seen: usize,
    /// Those that a link may meet, oldest first, with the anchor's outcode.
    strips: Vec<(u32, u16)>,
}

impl LinkTests {
    /// Forgets all strips.
    pub(super) fn clear(&mut self) {
        self.particles.clear();
    }

    /// True if no strip lies between the anchor of `j` and the vertex `v`, which is within the particle's radius.
    pub(super) fn connects(
        &mut self,
        strips: &Strips,
        rest: &[DVec3],
        map: &ParticleMap,
        settings: &ParticleSettings,
        (j, v): (ParticleId, VertexId),
    ) -> bool {
        let anchor = map.anchors[j.index()];
        let near = self.near(strips, rest, map, settings.radius_of(map, j), j);
        let (a, p) = (rest[anchor.index()], rest[v.index()]);
        let lips = [anchor, v].map(|end| strips.lip_sides(end));
        // a lip knows its side of its own strips and of those next to them
        let known = lips.map(|l| match l {
            [] => (1, 0),
            [first, .., last] => (first.strip.saturating_sub(1), last.strip + 1),
            [only] => (only.strip.saturating_sub(1), only.strip + 1),
        });
        for &(k, code) in near.strips.iter().rev() {
            let may_know = known.iter().any(|range| (range.0..=range.1).contains(&k));
            let geometry = strips.geometry(k as usize);
            let crosses = if may_know {
                strips.crosses(k as usize, rest, anchor, v)
            } else {
                !geometry.parts(code, p) && geometry.crosses(a, p)
            };
            if crosses {
                return false;
            }
        }
        // a known side may stand against geometry, so those strips are tested wherever they are
        let is_near = |k: u32| near.strips.binary_search_by_key(&k, |s| s.0).is_ok();
        !lips.iter().copied().flatten().any(|lip| {
            let last = (strips.len() as u32).min(lip.strip + 2);
            (lip.strip.saturating_sub(1)..last).any(|k| !is_near(k) && strips.crosses(k as usize, rest, anchor, v))
        })
    }

    fn near(&mut self, strips: &Strips, rest: &[DVec3], map: &ParticleMap, reach: f64, j: ParticleId) -> &NearStrips {
        if self.particles.len() <= j.index() {
            self.particles.resize(map.len(), NearStrips::default());
        }
        let near = &mut self.particles[j.index()];
        let anchor = map.anchors[j.index()];
        if near.anchor != anchor {
            *near = NearStrips { anchor, ..NearStrips::default() };
        }
        if near.seen < strips.len() {
            let at = rest[anchor.index()];
            let mut look = |k: usize| {
                let geometry = strips.geometry(k);
                let far = reach + geometry.margin;
                if at.cmpge(geometry.low - far).all() && at.cmple(geometry.high + far).all() {
                    near.strips.push((k as u32, geometry.outcode(at)));
                }
            };
            if strips.len() - near.seen <= FEW {
                (near.seen..strips.len()).for_each(look);
            } else {
                let far = reach + strips.largest_margin();
                strips.near(at - far, at + far, &mut self.found);
                self.found.iter().filter(|&&k| k as usize >= near.seen).for_each(|&k| look(k as usize));
            }
            near.seen = strips.len();
        }
        near
    }
}
