//! Parting a soft layer with its tissue (MATHS 3.2, 6).
//!
//! A particle that holds vertices on both sides of a cut goes on in both pieces, each with its own; in the piece that its
//! anchor has left it takes the nearest vertex that it holds there. So every vertex keeps its influences to the bit, and
//! nothing moves at the instant of the cut. What parts influences from their particles after that is a strip in their way.

use super::build::nearest_connected;
use super::particle_map::{Influence, Link, ParticleMap};
use super::strips::Strips;
use crate::geometry::{Mesh, ParticleId, VertexId};
use glam::DVec3;

/// Where particles have listed fewer vertices than a fourth of all, those are looked at, else all.
const MANY_HELD: usize = 4;

/// Influences of a vertex before they were changed.
pub type RowBefore = (VertexId, Vec<Influence>);

/// What [`ParticleMap::extract`] took along.
#[derive(Clone, Debug, Default)]
pub struct MapPart {
    /// The map of the piece.
    pub map: ParticleMap,
    /// Old particle of each new one; [`ParticleId::NONE`] for new particles.
    pub from: Vec<ParticleId>,
    /// Vertices of the piece whose influences are not what they were, with those that they had.
    pub rows_before: Vec<RowBefore>,
    /// True if particles that stay together keep the springs between them: no strip has come in between.
    pub keeps_springs: bool,
}

/// What [`ParticleMap::forget`] did.
#[derive(Clone, Debug, Default)]
pub struct Forgotten {
    /// Particles whose springs changed, sorted. New particles are among them.
    pub particles_changed: Vec<ParticleId>,
    /// Vertices whose influences are not what they were, with those that they had.
    pub rows_before: Vec<RowBefore>,
    /// As [`MapPart::keeps_springs`].
    pub keeps_springs: bool,
}

impl ParticleMap {
    /// The part of the map that a piece takes along. `mesh`, `rest` and `strips` are the piece's; `from[new]` is the old
    /// vertex of each of its vertices, `to[old]` the new one of each old vertex ([`VertexId::NONE`] where it stays behind);
    /// `old_rest` has a position for every old vertex.
    ///
    /// Particles anchored in the piece and those that hold any of its vertices come along. A vertex without a particle gets
    /// the nearest connected one, or a particle of its own where there is none that no strip parts from it.
    pub fn extract(
        &self,
        (mesh, rest, strips): (&Mesh, &[DVec3], &Strips),
        (from, to): (&[VertexId], &[VertexId]),
        old_rest: &[DVec3],
    ) -> MapPart {
        let lives = |new: VertexId| new.is_some() && mesh.vertex_is_live(new);
        let live = mesh.all_vertex_half_edges();
        let rows = self.influences.rows();
        let held = from.iter().zip(live);
        let held = held.map(|(old, half)| if half.is_some() && old.index() < rows { *old } else { VertexId::NONE });
        let held: Vec<VertexId> = held.collect();
        let new_anchor = |a: &VertexId| to.get(a.index()).copied().filter(|&new| a.is_some() && lives(new)).unwrap_or_default();
        let mut anchors: Vec<VertexId> = self.anchors.iter().map(new_anchor).collect();
        let strays = self.strays(old_rest, |j| anchors[j].is_none(), held.iter().copied().filter(|v| v.is_some()));
        for &(j, nearest) in &strays {
            anchors[j.index()] = to[nearest.index()];
        }
        let particles: Vec<ParticleId> = (0..self.len()).filter(|&j| anchors[j].is_some()).map(ParticleId::new).collect();
        let mut new_particle = vec![ParticleId::NONE; self.len()];
        for (new, old) in particles.iter().enumerate() {
            new_particle[old.index()] = ParticleId::new(new);
        }
        let renamed = |e: &Influence| Influence { particle: new_particle[e.particle.index()], ..*e };
        let link = |l: &Link| {
            let particle = new_particle[l.particle.index()];
            (Link { particle, ..*l }, particle.is_some())
        };
        let mut map = Self {
            rest_displacement: particles.iter().map(|j| self.rest_displacement[j.index()]).collect::<Vec<_>>().into(),
            influences: self.influences.gather(held.iter().map(|v| v.is_some().then(|| v.index())), renamed),
            neighbours: self.neighbours.gather_some(particles.iter().map(|j| j.index()), link),
            anchors: particles.iter().map(|j| anchors[j.index()]).collect::<Vec<_>>().into(),
            mean_link: self.mean_link,
        };
        map.influences.grow_rows(mesh.vertex_slots());
        let moved: Vec<ParticleId> = strays.iter().map(|s| new_particle[s.0.index()]).collect();
        let keeps_springs = strips.is_empty() || moved.is_empty();
        let mut part = MapPart { from: particles, keeps_springs, ..MapPart::default() };
        map.part_strays(mesh.live_vertices(), rest, strips, &moved, &mut Vec::new(), &mut part.rows_before);
        let without =
            (0..).zip(map.influences.spans().iter().zip(live)).filter(|(_, (row, half))| row.len == 0 && half.is_some());
        let orphans: Vec<VertexId> = without.map(|(v, _)| VertexId(v)).collect();
        let never_held = |v: &VertexId| part.rows_before.binary_search_by_key(v, |row| row.0).is_err();
        let never_held: Vec<RowBefore> = orphans.iter().copied().filter(never_held).map(|v| (v, Vec::new())).collect();
        part.rows_before.extend(never_held);
        map.adopt(mesh, rest, strips, &orphans);
        part.from.resize(map.len(), ParticleId::NONE);
        map.take_delta();
        part.map = map;
        part
    }

    /// Lets go of vertices (each once) that have left `mesh`. Their particles stay: none is anchored in them.
    pub fn let_go(&mut self, mesh: &Mesh, gone: impl Iterator<Item = VertexId>) {
        self.influences.grow_rows(mesh.vertex_slots());
        self.influences.clear_rows(gone.map(VertexId::index));
    }

    /// Lets go of vertices (each once) that have left `mesh` with a piece, and of the particles that hold nothing else.
    /// `rest` has a position for every vertex slot.
    pub fn forget(
        &mut self,
        mesh: &Mesh,
        rest: &[DVec3],
        strips: &mut Strips,
        gone: impl Iterator<Item = VertexId>,
    ) -> Forgotten {
        let mut done = Forgotten::default();
        self.let_go(mesh, gone);
        let left = |a: &VertexId| a.is_some() && !mesh.vertex_is_live(*a);
        let leaving: Vec<bool> = self.anchors.iter().map(left).collect();
        // a small piece is all that its particles hold, and a little more
        let away = (0..self.len()).map(ParticleId::new).filter(|j| leaving[j.index()]);
        let held = strips.places.held_by(away, mesh.vertex_slots() / MANY_HELD);
        let held = held.map(|mut held| {
            held.retain(|&v| v.index() < self.influences.rows() && mesh.vertex_is_live(v));
            held
        });
        let strays = match &held {
            Some(held) => self.strays(rest, |j| leaving[j], held.iter().copied()),
            None => self.strays(rest, |j| leaving[j], mesh.live_vertices()),
        };
        let mut retired = leaving;
        for &(j, nearest) in &strays {
            self.anchors.set(j.index(), nearest);
            strips.note_moved(self, rest, j);
            retired[j.index()] = false;
        }
        for j in (0..self.len()).filter(|&j| retired[j]) {
            self.anchors.set(j, VertexId::NONE);
            if self.rest_displacement[j] != [0.0; 3] {
                self.rest_displacement.set(j, [0.0; 3]);
            }
        }
        self.drop_links_of(&retired, &mut done.particles_changed);
        let moved: Vec<ParticleId> = strays.iter().map(|s| s.0).collect();
        done.keeps_springs = strips.is_empty() || moved.is_empty();
        let Forgotten { particles_changed, rows_before, .. } = &mut done;
        match held {
            Some(held) => self.part_strays(held.into_iter(), rest, strips, &moved, particles_changed, rows_before),
            None => self.part_strays(mesh.live_vertices(), rest, strips, &moved, particles_changed, rows_before),
        }
        let before = self.len();
        let lost_all = |v: &VertexId| self.influences.row(v.index()).is_empty();
        let orphans: Vec<VertexId> = done.rows_before.iter().map(|row| row.0).filter(lost_all).collect();
        self.adopt(mesh, rest, strips, &orphans);
        for &v in &orphans {
            strips.note_held(v, rest[v.index()], self.influences.row(v.index()), true);
        }
        for j in before..self.len() {
            strips.places.anchors.insert(j as u32, rest[self.anchors[j].index()]);
            done.particles_changed.push(ParticleId::new(j));
        }
        done.particles_changed.sort_unstable();
        done.particles_changed.dedup();
        done
    }

    /// The particles that are `away` and yet hold one of `vertices` (ascending), ascending, each with the nearest such vertex.
    fn strays(
        &self,
        rest: &[DVec3],
        away: impl Fn(usize) -> bool,
        vertices: impl Iterator<Item = VertexId>,
    ) -> Vec<(ParticleId, VertexId)> {
        let away: Vec<bool> = (0..self.len()).map(|j| away(j) && self.anchors[j].is_some()).collect();
        if !away.contains(&true) {
            return Vec::new();
        }
        // where those away are, and the nearest yet
        let stand = |j: usize| if away[j] { rest[self.anchors[j].index()] } else { DVec3::ZERO };
        let mut nearest: Vec<_> = (0..self.len()).map(|j| (stand(j), f64::INFINITY, VertexId::NONE)).collect();
        let (spans, arena) = (self.influences.spans(), self.influences.arena());
        for v in vertices {
            let span = spans[v.index()];
            let row = &arena[span.start as usize..(span.start + span.len) as usize];
            // few rows have any, so that one branch a row is foreseen
            if !row.iter().fold(false, |any, e| any | away[e.particle.index()]) {
                continue;
            }
            let p = rest[v.index()];
            for j in row.iter().map(|e| e.particle.index()).filter(|&j| away[j]) {
                let (at, least, best) = &mut nearest[j];
                let distance = at.distance_squared(p);
                if distance < *least {
                    (*least, *best) = (distance, v);
                }
            }
        }
        let found = nearest.into_iter().enumerate().filter(|(_, (.., best))| best.is_some());
        found.map(|(j, (.., best))| (ParticleId::new(j), best)).collect()
    }

    /// Drops the springs of the particles that are `gone`.
    fn drop_links_of(&mut self, gone: &[bool], changed: &mut Vec<ParticleId>) {
        let (mut is_left, mut left) = (vec![false; self.len()], Vec::with_capacity(self.len()));
        changed.reserve(self.len());
        for j in (0..self.len()).filter(|&j| gone[j]).map(ParticleId::new) {
            let row = self.neighbours.row(j.index());
            if row.is_empty() {
                continue;
            }
            for other in row.iter().map(|l| l.particle).filter(|other| !gone[other.index()]) {
                if !std::mem::replace(&mut is_left[other.index()], true) {
                    left.push(other);
                }
            }
            self.neighbours.set_row(j.index(), &[]);
            changed.push(j);
        }
        let mut kept: Vec<Link> = Vec::new();
        for &j in &left {
            kept.clear();
            kept.extend(self.neighbours.row(j.index()).iter().filter(|l| !gone[l.particle.index()]));
            self.neighbours.set_row(j.index(), &kept);
        }
        changed.append(&mut left);
    }

    /// Drops the springs that are `lost`, which is asked with the lower end first.
    fn drop_links(&mut self, lost: impl Fn(ParticleId, ParticleId) -> bool, changed: &mut Vec<ParticleId>) {
        let mut kept: Vec<Link> = Vec::new();
        for j in (0..self.len()).map(ParticleId::new) {
            let row = self.neighbours.row(j.index());
            let stays = |l: &&Link| !lost(j.min(l.particle), j.max(l.particle));
            if row.iter().all(|l| stays(&l)) {
                continue;
            }
            kept.clear();
            kept.extend(row.iter().filter(stays));
            self.neighbours.set_row(j.index(), &kept);
            changed.push(j);
        }
    }

    /// From its new anchor a stray may lie across a strip from what it held, or was tied to: that is given up. `vertices` has all that
    /// strays hold.
    fn part_strays(
        &mut self,
        vertices: impl Iterator<Item = VertexId>,
        rest: &[DVec3],
        strips: &Strips,
        strays: &[ParticleId],
        changed: &mut Vec<ParticleId>,
        before: &mut Vec<RowBefore>,
    ) {
        if strips.is_empty() || strays.is_empty() {
            return;
        }
        let mut is_stray = vec![false; self.len()];
        strays.iter().for_each(|j| is_stray[j.index()] = true);
        let anchors = self.anchors.to_vec();
        let connects = |v: VertexId, j: ParticleId| strips.connects_vertices(rest, v, anchors[j.index()]);
        for v in vertices {
            let row = self.influences.row(v.index());
            let stays = |e: &&Influence| !is_stray[e.particle.index()] || connects(v, e.particle);
            if !row.iter().all(|e| stays(&e)) {
                let kept: Vec<Influence> = row.iter().filter(stays).copied().collect();
                before.push((v, row.to_vec()));
                let sum: f32 = kept.iter().map(|e| e.weight).sum();
                let kept: Vec<Influence> = kept.iter().map(|e| Influence { weight: e.weight / sum, ..*e }).collect();
                self.influences.set_row(v.index(), &kept);
            }
        }
        let of_stray = |a: ParticleId, b: ParticleId| is_stray[a.index()] || is_stray[b.index()];
        self.drop_links(|a, b| of_stray(a, b) && !connects(anchors[a.index()], b), changed);
    }

    /// Gives vertices without influence the nearest connected particle, or one of their own.
    fn adopt(&mut self, mesh: &Mesh, rest: &[DVec3], strips: &Strips, orphans: &[VertexId]) {
        let mut nearest = Vec::new();
        let mut stale = true;
        for &v in orphans {
            if std::mem::take(&mut stale) {
                nearest = nearest_connected(mesh, rest, &self.anchors);
            }
            let mut j = nearest[v.index()];
            if j.is_none() || !strips.connects_vertices(rest, v, self.anchors[j.index()]) {
                stale = j.is_none(); // its component had none: look again for the rest of it
                j = ParticleId::new(self.anchors.push(v));
                self.rest_displacement.push([0.0; 3]);
                self.neighbours.push_row(&[]);
            }
            self.influences.set_row(v.index(), &[Influence { particle: j, weight: 1.0 }]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::{ParticleSettings, sample, test_models};

    struct Whole {
        mesh: Mesh,
        rest: Vec<DVec3>,
        map: ParticleMap,
        settings: ParticleSettings,
    }

    fn whole(spacing: f64) -> Whole {
        let (mesh, rest) = test_models::grid(20, 0.3, 1);
        let settings = ParticleSettings::with_spacing(spacing);
        let anchors = sample(&mesh, &rest, settings.spacing, 1);
        let (map, _) = ParticleMap::build(&mesh, &rest, &anchors, &settings);
        Whole { mesh, rest, map, settings }
    }

    /// A piece: the vertices with x below `cut` of a grid, and which vertices those were.
    struct Piece {
        mesh: Mesh,
        rest: Vec<DVec3>,
        from: Vec<VertexId>,
        to: Vec<VertexId>,
    }

    fn piece(whole: &Whole, cut: f64) -> Piece {
        let Whole { mesh, rest, .. } = whole;
        let from: Vec<VertexId> = mesh.live_vertices().filter(|v| rest[v.index()].x < cut).collect();
        let new = |v: VertexId| from.binary_search(&v).ok().map(|i| i as u32);
        let to = (0..mesh.vertex_slots()).map(|v| new(VertexId::new(v)).map_or(VertexId::NONE, VertexId)).collect();
        let faces = mesh.live_faces().filter_map(|f| {
            let [a, b, c] = mesh.face(f).map(new);
            Some([a?, b?, c?])
        });
        let (mesh, rest) = test_models::build(from.iter().map(|v| rest[v.index()]).collect(), faces.collect());
        Piece { mesh, rest, from, to }
    }

    fn extract(whole: &Whole, piece: &Piece, strips: &Strips) -> MapPart {
        whole.map.extract((&piece.mesh, &piece.rest, strips), (&piece.from, &piece.to), &whole.rest)
    }

    /// A strip along x = `x` over the whole grid.
    fn strip(x: f64, settings: &ParticleSettings) -> Strips {
        let mut strips = Strips::default();
        let at = |y: f64, z: f64| DVec3::new(x, y, z);
        strips.push([at(-1.0, -1.0), at(2.0, -1.0), at(2.0, 1.0), at(-1.0, 1.0)], settings.radius, 0).unwrap();
        strips
    }

    #[test]
    fn a_piece_keeps_its_influences_to_the_bit() {
        let whole = whole(0.15);
        for cut in [0.55, 0.08] {
            let piece = piece(&whole, cut);
            let part = extract(&whole, &piece, &Strips::default());
            part.map.validate(&piece.mesh, &piece.rest, &Strips::default()).unwrap();
            assert!(part.from.len() == part.map.len() && part.rows_before.is_empty());
            for v in piece.mesh.live_vertices() {
                let old = whole.map.influences.row(piece.from[v.index()].index());
                let new = part.map.influences.row(v.index());
                let named = |e: &Influence| (part.from[e.particle.index()], e.weight.to_bits());
                let same = |e: &Influence| (e.particle, e.weight.to_bits());
                assert_eq!(new.iter().map(named).collect::<Vec<_>>(), old.iter().map(same).collect::<Vec<_>>());
            }
            let (mut stayed, mut strays) = (0, 0);
            for (j, k) in part.from.iter().enumerate() {
                let (new, old) = (part.map.anchors[j], whole.map.anchors[k.index()]);
                if piece.to[old.index()].is_some() {
                    assert_eq!(piece.to[old.index()], new);
                    stayed += 1;
                    continue;
                }
                strays += 1;
                // the nearest of those it holds
                let held = piece
                    .mesh
                    .live_vertices()
                    .filter(|v| part.map.influences.row(v.index()).iter().any(|e| e.particle.index() == j));
                let distance = |v: VertexId| piece.rest[v.index()].distance(whole.rest[old.index()]);
                let nearest = held.map(distance).fold(f64::INFINITY, f64::min);
                assert_eq!(distance(new), nearest);
            }
            assert!(stayed > 0 && strays > 0);
        }
    }

    #[test]
    fn what_a_strip_parts_from_a_strays_new_anchor_is_given_up() {
        let whole = whole(0.15);
        let piece = piece(&whole, 0.5);
        let strips = strip(0.4, &whole.settings);
        let part = extract(&whole, &piece, &strips);
        // strays from beyond 0.5 stay on their side of the strip
        let is_stray = |j: ParticleId| whole.rest[whole.map.anchors[part.from[j.index()].index()].index()].x >= 0.5;
        let held = |v: VertexId| part.map.influences.row(v.index());
        let beyond = |v: &VertexId| piece.rest[v.index()].x < 0.4;
        assert!(piece.mesh.live_vertices().filter(beyond).all(|v| held(v).iter().all(|e| !is_stray(e.particle))));
        assert!(part.rows_before.iter().any(|(v, before)| beyond(v) && before.len() > held(*v).len()));
        assert!(part.rows_before.iter().all(|(v, _)| (held(*v).iter().map(|e| e.weight).sum::<f32>() - 1.0).abs() < 1e-5));
    }

    #[test]
    fn a_vertex_without_a_particle_gets_one() {
        let mut whole = whole(3.0);
        for v in 0..whole.mesh.vertex_slots() {
            whole.map.influences.set_row(v, &[]);
        }
        let piece = piece(&whole, 0.3);
        whole.map.anchors = vec![VertexId(440)].into(); // it lies outside
        let part = extract(&whole, &piece, &Strips::default());
        part.map.validate(&piece.mesh, &piece.rest, &Strips::default()).unwrap();
        assert_eq!(part.from, [ParticleId::NONE]);
        assert!(piece.mesh.live_vertices().all(|v| part.map.influences.row(v.index()).len() == 1));
        assert_eq!(part.rows_before.len(), piece.mesh.live_vertices().count());
    }

    #[test]
    fn what_stays_forgets_what_has_left() {
        let mut whole = whole(0.15);
        let gone: Vec<VertexId> = whole.mesh.live_vertices().filter(|v| whole.rest[v.index()].x < 0.4).collect();
        let before = whole.map.clone();
        let faces: Vec<crate::geometry::FaceId> = whole.mesh.live_faces().collect();
        let touches = |f: &crate::geometry::FaceId| whole.mesh.face(*f).iter().any(|v| gone.contains(v));
        let faces: Vec<_> = faces.into_iter().filter(touches).collect();
        whole.mesh.replace_faces(&faces, &[], |_| 0, &mut crate::geometry::TopologyScratch::default());
        let Whole { mesh, rest, map, .. } = &mut whole;
        let gone: Vec<VertexId> = (0..rest.len()).map(VertexId::new).filter(|v| !mesh.vertex_is_live(*v)).collect();
        map.take_delta();
        let done = map.forget(mesh, rest, &mut Strips::default(), gone.iter().copied());
        map.validate(mesh, rest, &Strips::default()).unwrap();
        assert!(done.rows_before.is_empty());
        assert!(mesh.live_vertices().all(|v| map.influences.row(v.index()) == before.influences.row(v.index())));
        let retired = map.anchors.iter().filter(|a| a.is_none()).count();
        let moved = map.anchors.iter().zip(before.anchors.iter()).filter(|(now, was)| now.is_some() && now != was).count();
        assert!(retired > 0 && moved > 0 && retired + moved < map.len(), "{retired} retired, {moved} moved");
        let changed = |j: usize| map.neighbours.row(j) != before.neighbours.row(j);
        let expected: Vec<ParticleId> = (0..map.len()).filter(|&j| changed(j)).map(ParticleId::new).collect();
        assert_eq!(done.particles_changed, expected);
        let delta = map.take_delta();
        map.apply_delta(delta);
        let hash = |map: &ParticleMap| {
            let mut hash = crate::geometry::StateHash::default();
            map.hash_into(&mut hash);
            hash.finish()
        };
        assert_eq!(hash(map), hash(&before));
    }

    /// What a small piece has left behind is looked for among what its particles hold: the same is found as in all there is.
    #[test]
    fn known_holders_tell_what_a_look_at_everything_tells() {
        let Whole { mesh: before, rest, map, settings } = whole(0.1);
        let mut mesh = before.clone();
        let leaves = |f: &crate::geometry::FaceId| before.face(*f).iter().all(|v| rest[v.index()].max_element() < 0.2);
        let faces: Vec<_> = before.live_faces().filter(leaves).collect();
        mesh.replace_faces(&faces, &[], |_| 0, &mut crate::geometry::TopologyScratch::default());
        let gone = || before.live_vertices().filter(|v| !mesh.vertex_is_live(*v));
        let [all, known] = [false, true].map(|known| {
            let (mut map, mut strips) = (map.clone(), strip(0.225, &settings));
            if known {
                strips.prepare(&rest, &map, &settings);
                let leaving = (0..map.len()).filter(|&j| !mesh.vertex_is_live(map.anchors[j])).map(ParticleId::new);
                let held = strips.places.held_by(leaving, rest.len() / MANY_HELD).expect("a few");
                assert!(held.len() > gone().count() && held.is_sorted());
            }
            let done = map.forget(&mesh, &rest, &mut strips, gone());
            (map, done)
        });
        assert!((0..rest.len()).all(|v| all.0.influences.row(v) == known.0.influences.row(v)));
        assert_eq!((&all.0.anchors[..], &all.1.particles_changed), (&known.0.anchors[..], &known.1.particles_changed));
        assert_eq!(all.1.rows_before, known.1.rows_before);
        assert!(!known.1.rows_before.is_empty());
    }
}
