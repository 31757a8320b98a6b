//! The soft layer of a severed piece, taken from its parent's.

use super::build::nearest_connected;
use super::particle_map::{Influence, Link, ParticleMap};
use super::strips::Strips;
use crate::geometry::{Mesh, ParticleId, SlotCsr, VertexId};
use glam::DVec3;

impl ParticleMap {
    /// The part of the map that a piece keeps, and the old particle of each of its new ones ([`ParticleId::NONE`] for new
    /// particles). `mesh`, `rest` and `strips` are the piece's; `vertices[new]` is the old vertex of each of its vertices
    /// ([`VertexId::NONE`] where it has none).
    ///
    /// Particles anchored in the piece stay; weights are normalised again; a vertex left without a particle gets the
    /// nearest connected one, or a particle of its own where there is none that no strip parts from it.
    pub fn extract(&self, mesh: &Mesh, rest: &[DVec3], strips: &Strips, vertices: &[VertexId]) -> (Self, Vec<ParticleId>) {
        let old_vertices = vertices.iter().filter(|v| v.is_some()).map(|v| v.index() + 1).max().unwrap_or(0);
        let mut new_vertex = vec![VertexId::NONE; old_vertices];
        for (new, old) in vertices.iter().enumerate().filter(|(_, old)| old.is_some()) {
            new_vertex[old.index()] = VertexId::new(new);
        }
        let mut kept: Vec<ParticleId> = Vec::new();
        let mut new_particle = vec![ParticleId::NONE; self.len()];
        let mut anchors = Vec::new();
        for (j, anchor) in self.anchors.iter().enumerate().filter(|(_, a)| a.is_some()) {
            let anchor = new_vertex.get(anchor.index()).copied().unwrap_or_default();
            if anchor.is_some() && mesh.vertex_is_live(anchor) {
                new_particle[j] = ParticleId::new(kept.len());
                kept.push(ParticleId::new(j));
                anchors.push(anchor);
            }
        }
        let neighbours: Vec<(u32, Link)> = kept
            .iter()
            .flat_map(|j| self.neighbours.row(j.index()).iter().map(move |l| (*j, *l)))
            .map(|(j, l)| (new_particle[j.index()].0, Link { particle: new_particle[l.particle.index()], ..l }))
            .filter(|(_, l)| l.particle.is_some())
            .collect();
        let mut rows: Vec<Vec<Influence>> = vertices.iter().map(|v| self.kept_influences(*v, &new_particle)).collect();
        rows.resize(mesh.vertex_slots(), Vec::new());
        for (v, row) in rows.iter_mut().enumerate() {
            if !mesh.vertex_is_live(VertexId::new(v)) {
                row.clear();
            }
        }
        adopt(mesh, rest, strips, &mut rows, &mut anchors, &mut kept);
        let displacement = |j: &ParticleId| if j.is_some() { self.rest_displacement[j.index()] } else { [0.0; 3] };
        let map = Self {
            rest_displacement: kept.iter().map(displacement).collect::<Vec<_>>().into(),
            influences: SlotCsr::from_rows(rows.iter().map(Vec::as_slice)),
            neighbours: SlotCsr::from_pairs(anchors.len(), &neighbours),
            anchors: anchors.into(),
        };
        (map, kept)
    }

    fn kept_influences(&self, old: VertexId, new_particle: &[ParticleId]) -> Vec<Influence> {
        if old.is_none() || old.index() >= self.influences.rows() {
            return Vec::new();
        }
        let row = self.influences.row(old.index());
        let kept = || row.iter().filter(|e| new_particle[e.particle.index()].is_some());
        let sum: f32 = kept().map(|e| e.weight).sum();
        // What every particle of keeps its weights to the bit.
        let scale = if kept().count() == row.len() { 1.0 } else { 1.0 / sum };
        kept().map(|e| Influence { particle: new_particle[e.particle.index()], weight: e.weight * scale }).collect()
    }
}

/// Gives live vertices without influence the nearest connected particle, or one of their own.
fn adopt(
    mesh: &Mesh,
    rest: &[DVec3],
    strips: &Strips,
    rows: &mut [Vec<Influence>],
    anchors: &mut Vec<VertexId>,
    kept: &mut Vec<ParticleId>,
) {
    let orphans: Vec<VertexId> = mesh.live_vertices().filter(|v| rows[v.index()].is_empty()).collect();
    let mut nearest = Vec::new();
    let mut stale = true;
    for v in orphans {
        if std::mem::take(&mut stale) {
            nearest = nearest_connected(mesh, rest, anchors);
        }
        let mut j = nearest[v.index()];
        if j.is_none() || !strips.connects_vertices(rest, v, anchors[j.index()]) {
            stale = j.is_none(); // its component had none: look again for the rest of it
            j = ParticleId::new(anchors.len());
            anchors.push(v);
            kept.push(ParticleId::NONE);
        }
        rows[v.index()].push(Influence { particle: j, weight: 1.0 });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::{ParticleSettings, sample, test_models};

    /// A piece: the vertices with x below `cut` of a grid, and which vertices those were.
    fn piece(mesh: &Mesh, rest: &[DVec3], cut: f64) -> (Mesh, Vec<DVec3>, Vec<VertexId>) {
        let old: Vec<VertexId> = mesh.live_vertices().filter(|v| rest[v.index()].x < cut).collect();
        let new = |v: VertexId| old.binary_search(&v).ok().map(|i| i as u32);
        let faces = mesh.live_faces().filter_map(|f| {
            let [a, b, c] = mesh.face(f).map(new);
            Some([a?, b?, c?])
        });
        let (piece, positions) = test_models::build(old.iter().map(|v| rest[v.index()]).collect(), faces.collect());
        (piece, positions, old)
    }

    #[test]
    fn a_piece_keeps_its_own_particles() {
        let (mesh, rest) = test_models::grid(20, 0.3, 1);
        let settings = ParticleSettings::with_spacing(0.15);
        let anchors = sample(&mesh, &rest, settings.spacing, 1);
        let (map, _) = ParticleMap::build(&mesh, &rest, &anchors, &settings);
        for cut in [0.55, 0.08] {
            let (mesh, positions, old) = piece(&mesh, &rest, cut);
            let (part, kept) = map.extract(&mesh, &positions, &Strips::default(), &old);
            part.validate(&mesh, &positions, &Strips::default()).unwrap();
            assert_eq!(part.len(), kept.len());
            for (j, k) in kept.iter().enumerate().filter(|(_, k)| k.is_some()) {
                assert_eq!(old[part.anchors[j].index()], map.anchors[k.index()]);
            }
        }
    }

    #[test]
    fn a_piece_without_a_particle_gets_one() {
        let (mesh, rest) = test_models::grid(20, 0.3, 1);
        let settings = ParticleSettings::with_spacing(3.0);
        let (map, _) = ParticleMap::build(&mesh, &rest, &[VertexId(440)], &settings);
        let (mesh, positions, old) = piece(&mesh, &rest, 0.3);
        let (part, kept) = map.extract(&mesh, &positions, &Strips::default(), &old);
        part.validate(&mesh, &positions, &Strips::default()).unwrap();
        assert_eq!(kept, [ParticleId::NONE]);
        assert!(mesh.live_vertices().all(|v| part.influences.row(v.index()).len() == 1));
    }
}
