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
    /// Those that a link may meet, oldest first, with the anchor's outcode; 0 where its known side stands against geometry.
    strips: Vec<(u32, u16)>,
    /// Number of the anchor's lip sides when the outcodes were worked out.
    lips: usize,
    /// Place in `strips` of the one that parted the last link: it often parts the next one too.
    parting: usize,
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
        let known = match lips[1] {
            [] => 0..0,
            [first, .., last] => first.strip.saturating_sub(1)..last.strip + 2,
            [only] => only.strip.saturating_sub(1)..only.strip + 2,
        };
        let crosses = |&(k, code): &(u32, u16)| {
            if code == 0 || known.contains(&k) {
                strips.crosses(k as usize, rest, anchor, v)
            } else {
                let geometry = strips.geometry(k as usize);
                !geometry.parts(code, p) && geometry.crosses(a, p)
            }
        };
        if near.strips.get(near.parting).is_some_and(&crosses) {
            return false;
        }
        let mut group = (usize::MAX, false);
        for (i, strip) in near.strips.iter().enumerate().rev() {
            if group.0 != Strips::group(strip.0) {
                group.0 = Strips::group(strip.0);
                group.1 = strips.is_beside_group(group.0, a, p);
            }
            let is_beside = group.1 && strip.1 != 0 && !known.contains(&strip.0);
            if !is_beside && crosses(strip) {
                near.parting = i;
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

    fn near(&mut self, strips: &Strips, rest: &[DVec3], map: &ParticleMap, reach: f64, j: ParticleId) -> &mut NearStrips {
        if self.particles.len() <= j.index() {
            self.particles.resize(map.len(), NearStrips::default());
        }
        let near = &mut self.particles[j.index()];
        let anchor = map.anchors[j.index()];
        if near.anchor != anchor {
            *near = NearStrips { anchor, ..NearStrips::default() };
        }
        let lips = strips.lip_sides(anchor).len();
        if near.lips != lips {
            near.lips = lips;
            near.strips.iter_mut().for_each(|(k, code)| *code = strips.code_of_anchor(*k as usize, rest, anchor));
        }
        if near.seen < strips.len() {
            let at = rest[anchor.index()];
            let mut look = |k: usize| {
                let geometry = strips.geometry(k);
                let far = reach + geometry.margin;
                if at.cmpge(geometry.low - far).all() && at.cmple(geometry.high + far).all() {
                    near.strips.push((k as u32, strips.code_of_anchor(k, rest, anchor)));
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
