//! Strip tests of the links of particles: the strips that a particle's links may meet are found once and kept.

use super::holders::{above, below};
use super::particle_map::ParticleMap;
use super::settings::ParticleSettings;
use super::strip_test::{Sight, StripGeometry};
use super::strips::Strips;
use crate::geometry::{ParticleId, VertexId};
use glam::{DVec3, Vec3A, Vec4};

/// More new strips than this are looked up in the tree and not one by one.
const FEW: usize = 24;
/// Strips that a link is looked at together for.
const BATCH: usize = 4;

/// The strips near each particle, by particle. Anchors and strips do not move in rest space, so an update only has to look at the
/// strips that are new; an undo, which takes strips away, forgets everything.
#[derive(Clone, Debug, Default)]
pub(super) struct LinkTests {
    particles: Vec<NearStrips>,
    found: Vec<u32>,
    lip: Lip,
}

/// The vertex whose link was tested last, which is mostly the next one's too.
#[derive(Clone, Debug, Default)]
struct Lip {
    vertex: VertexId,
    /// Strips that it may know its side of, with its outcodes; 0 where a known side stands against geometry.
    around: Vec<(u32, u16)>,
    /// Number of strips and of its lip sides when that was worked out.
    seen: [usize; 2],
}

impl Lip {
    fn look(&mut self, strips: &Strips, rest: &[DVec3], v: VertexId) {
        let sides = strips.lip_sides(v);
        if (self.vertex, self.seen) == (v, [strips.len(), sides.len()]) {
            return;
        }
        (self.vertex, self.seen) = (v, [strips.len(), sides.len()]);
        self.around.clear();
        for lip in sides {
            for k in lip.strip.saturating_sub(1)..(strips.len() as u32).min(lip.strip + 2) {
                if self.around.iter().all(|a| a.0 != k) {
                    self.around.push((k, strips.code_of(k as usize, rest, v)));
                }
            }
        }
    }
}

/// The strips near one particle.
#[derive(Clone, Debug, Default)]
struct NearStrips {
    anchor: VertexId,
    /// Strips looked at: all before this one.
    seen: usize,
    /// Those that a link may meet, oldest first, with the anchor's outcode; 0 where its known side stands against geometry.
    strips: Vec<(u32, u16)>,
    /// How the anchor sees them, [`BATCH`] after [`BATCH`].
    sights: Vec<Sights>,
    /// Strips that the anchor may know its side of and that are not among `strips`.
    unlisted: Vec<u32>,
    /// Number of the anchor's lip sides when the outcodes were worked out.
    lips: usize,
    /// Place in `strips` of the one that parted the last link: it often parts the next one too.
    parting: usize,
}

/// [`Sight`] of [`BATCH`] strips, one a lane, with their bounds.
#[derive(Clone, Copy, Debug)]
struct Sights {
    bounds: [Vec3A; 2],
    /// Coordinates of the normals of each of the four planes.
    normals: [[Vec4; 3]; 4],
}

impl Sights {
    const NONE: Self = Self { bounds: [Vec3A::INFINITY, Vec3A::NEG_INFINITY], normals: [[Vec4::ZERO; 3]; 4] };

    fn set(&mut self, lane: usize, sight: &Sight, (low, high): (DVec3, DVec3)) {
        self.bounds = [self.bounds[0].min(below(low)), self.bounds[1].max(above(high))];
        for (plane, normals) in self.normals.iter_mut().enumerate() {
            for (d, normals) in normals.iter_mut().enumerate() {
                normals[lane] = sight.normals[d][plane];
            }
        }
    }

    /// Lanes whose strips a link may meet that goes by `d` and no further than `low` and `high`.
    #[inline]
    fn met(&self, d: Vec3A, (low, high): (Vec3A, Vec3A), slack: Vec4) -> u32 {
        if (self.bounds[0].cmpgt(high) | self.bounds[1].cmplt(low)).any() {
            return 0;
        }
        let above = |[x, y, z]: [Vec4; 3]| (x * d.x + y * d.y + z * d.z).cmpge(slack);
        let [a, b, c, d] = self.normals.map(above);
        (a & b & c & d).bitmask()
    }
}

impl NearStrips {
    /// True if no strip lies between the anchor and `v`. `around` are the strips that `v` may know its side of.
    fn connects(&mut self, strips: &Strips, rest: &[DVec3], radius: f64, v: VertexId, around: &[(u32, u16)]) -> bool {
        let (a, p) = (rest[self.anchor.index()], rest[v.index()]);
        // where geometry says of both ends what is known of them, it settles most
        let is_plain = |code: u16, own: u16| code != 0 && own != 0 && self.lips == 0;
        let is_crossed = |k: u32, code: u16, own: u16| match StripGeometry::planes_part(code, own) {
            true => false,
            false if is_plain(code, own) => strips.geometry(k as usize).crosses(a, p),
            false => strips.crosses(k as usize, rest, self.anchor, v),
        };
        let crosses = |&(k, code): &(u32, u16)| match around.iter().find(|a| a.0 == k) {
            Some(&(_, own)) => is_crossed(k, code, own),
            None if code == 0 => strips.crosses(k as usize, rest, self.anchor, v),
            None => strips.geometry(k as usize).crosses(a, p),
        };
        if self.strips.get(self.parting).is_some_and(&crosses) {
            return false;
        }
        let (d, slack) = ((p - a).as_vec3a(), Vec4::splat(Sight::slack(radius)));
        let bounds = (below(a.min(p)), above(a.max(p)));
        for (batch, sights) in self.sights.iter().enumerate().rev() {
            let mut met = sights.met(d, bounds, slack);
            while met != 0 {
                let i = BATCH * batch + met.trailing_zeros() as usize;
                met &= met - 1;
                if self.strips.get(i).is_some_and(&crosses) {
                    self.parting = i;
                    return false;
                }
            }
        }
        // a known side may stand against geometry, so those strips are tested wherever they are
        let code = |k: u32| self.strips.binary_search_by_key(&k, |s| s.0).map_or(0, |i| self.strips[i].1);
        !around.iter().any(|&(k, own)| is_crossed(k, code(k), own))
            && !self.unlisted.iter().any(|&k| strips.crosses(k as usize, rest, self.anchor, v))
    }

    fn push(&mut self, strips: &Strips, rest: &[DVec3], reach: f64, k: usize) {
        let code = strips.code_of(k, rest, self.anchor);
        let lane = self.strips.len() % BATCH;
        self.strips.push((k as u32, code));
        if lane == 0 {
            self.sights.push(Sights::NONE);
        }
        let (at, geometry) = (rest[self.anchor.index()], strips.geometry(k));
        let (sight, bounds) = match code {
            0 => (Sight::everywhere(at), (DVec3::NEG_INFINITY, DVec3::INFINITY)),
            _ => (geometry.sight(at, reach), (geometry.low, geometry.high)),
        };
        if let Some(sights) = self.sights.last_mut() {
            sights.set(lane, &sight, bounds);
        }
    }
}

impl LinkTests {
    /// Forgets all strips.
    pub(super) fn clear(&mut self) {
        self.particles.clear();
        self.lip = Lip::default();
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
        let radius = settings.radius_of(map, j);
        self.lip.look(strips, rest, v);
        let around = std::mem::take(&mut self.lip.around);
        let connects = self.near(strips, rest, map, radius, j).connects(strips, rest, radius, v, &around);
        self.lip.around = around;
        connects
    }

    fn near(&mut self, strips: &Strips, rest: &[DVec3], map: &ParticleMap, reach: f64, j: ParticleId) -> &mut NearStrips {
        if self.particles.len() <= j.index() {
            self.particles.resize(map.len(), NearStrips::default());
        }
        let near = &mut self.particles[j.index()];
        let anchor = map.anchors[j.index()];
        let lips = strips.lip_sides(anchor);
        if near.anchor != anchor {
            *near = NearStrips { anchor, ..NearStrips::default() };
        }
        let is_stale = near.lips != lips.len() || near.seen < strips.len();
        if near.lips != lips.len() {
            near.lips = lips.len();
            near.sights.clear();
            for (k, _) in std::mem::take(&mut near.strips) {
                near.push(strips, rest, reach, k as usize);
            }
        }
        if near.seen < strips.len() {
            let at = rest[anchor.index()];
            let from = near.seen;
            let mut look = |k: usize| {
                let geometry = strips.geometry(k);
                let far = reach + geometry.margin;
                if at.cmpge(geometry.low - far).all() && at.cmple(geometry.high + far).all() {
                    near.push(strips, rest, reach, k);
                }
            };
            if strips.len() - from <= FEW {
                (from..strips.len()).for_each(look);
            } else {
                let far = reach + strips.largest_margin();
                strips.near(at - far, at + far, &mut self.found);
                self.found.iter().filter(|&&k| k as usize >= from).for_each(|&k| look(k as usize));
            }
            near.seen = strips.len();
        }
        if is_stale {
            let around = lips.iter().flat_map(|lip| lip.strip.saturating_sub(1)..(strips.len() as u32).min(lip.strip + 2));
            let is_listed = |k: &u32| near.strips.binary_search_by_key(k, |s| s.0).is_ok();
            near.unlisted.clear();
            near.unlisted.extend(around.filter(|k| !is_listed(k)));
        }
        near
    }
}
