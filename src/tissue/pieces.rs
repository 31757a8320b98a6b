//! Taking a tissue apart into connected pieces (MATHS 6). A piece copies the base parents that its rows use.

use super::{SoftLayer, Tissue};
use crate::geometry::components::components;
use crate::geometry::{Extraction, FaceId, Mesh, ParticleId, SlotCsr, TopologyScratch, VertexId};
use crate::particles::{Influence, Link, ParticleMap};
use crate::rig::{Fades, RowEntry, VertexRows};
use std::collections::BTreeMap;

impl Tissue {
    /// Faces of each connected component, ascending; components by their lowest face.
    pub fn component_faces(&self) -> Vec<Vec<FaceId>> {
        let found = components(&self.mesh);
        let mut faces = vec![Vec::new(); found.count()];
        for f in self.mesh.live_faces() {
            faces[found.component[f.index()] as usize].push(f);
        }
        faces
    }

    /// Moves `faces` (one or more whole components, ascending) into a tissue of their own, with the particles anchored
    /// there. What a vertex was moved by, and no longer is, fades out from where it stood (MATHS 2.2). To be followed by
    /// [`Tissue::restrict_particles`] on what is left.
    pub fn extract_piece(&mut self, faces: &[FaceId], name: String) -> Tissue {
        let parents = row_parents(&self.rows, faces.iter().flat_map(|&f| self.mesh.face(f)));
        let (mesh, map) = self.mesh.extract(faces, &parents);
        let rows = extract_rows(&self.rows, &map);
        let rest = map.vertex_from.iter().map(|&v| self.rest[v.index()]).collect();
        let layer = self.layer.as_ref().map(|layer| layer.extract(&map));
        let fades = Fades {
            entries: if self.fades.entries.is_empty() {
                Vec::new()
            } else {
                map.vertex_from.iter().map(|&v| self.fades.entries.get(v.index()).copied().unwrap_or_default()).collect()
            },
            ..self.fades.clone()
        };
        let mut piece = Tissue {
            name,
            mesh,
            rows,
            rest,
            rig: self.rig.clone(),
            materials: self.materials.clone(),
            layer,
            fades,
            sections: Default::default(),
            scratch: Default::default(),
            pose: self.pose.clone(),
            versions: self.versions,
            ..*self
        };
        piece.build_sections();
        piece.hold_while(|piece| piece.layer_mut().map_or_else(Vec::new, |layer| layer.drop_foreign(None)), &map, self);
        self.mesh.remove_faces(faces, &mut TopologyScratch::default());
        piece
    }

    /// After pieces have left: drops the influence of particles whose anchors left, with fades that hold every vertex.
    pub fn restrict_particles(&mut self) {
        let before: Vec<_> = self.mesh.live_vertices().map(|v| (v, self.position(v))).collect();
        let Some(layer) = &mut self.layer else { return };
        let left: Vec<bool> = layer.map.anchors.iter().map(|a| a.is_some() && self.mesh.vertex_is_live(*a)).collect();
        let mut changed = layer.drop_foreign(Some((&self.mesh, &left)));
        changed.extend(layer.cover(&self.mesh));
        changed.sort_unstable();
        changed.dedup();
        self.fade_from(before.into_iter().filter(|(v, _)| changed.binary_search(v).is_ok()));
        self.sync_network();
    }

    /// Runs `change` on a fresh piece and lets the vertices it names fade from where `parent` shows them.
    fn hold_while(&mut self, change: impl FnOnce(&mut Self) -> Vec<VertexId>, map: &Extraction, parent: &Tissue) {
        let mut changed = change(self);
        if let Some(layer) = &mut self.layer {
            changed.extend(layer.cover(&self.mesh));
        }
        changed.sort_unstable();
        changed.dedup();
        let targets: Vec<_> = changed
            .into_iter()
            .filter(|v| self.mesh.vertex_is_live(*v))
            .map(|v| (v, parent.position(map.vertex_from[v.index()])))
            .collect();
        self.fade_from(targets.into_iter());
        self.sync_network();
        self.discard_delta();
    }
}

/// Base vertices that the rows of `vertices` combine, ascending.
fn row_parents(rows: &VertexRows, vertices: impl Iterator<Item = VertexId>) -> Vec<VertexId> {
    let mut parents: Vec<VertexId> = vertices.flat_map(|v| rows.rows.row(v.index())).map(|e| e.base).collect();
    parents.sort_unstable();
    parents.dedup();
    parents
}

fn extract_rows(rows: &VertexRows, map: &Extraction) -> VertexRows {
    let row = |v: VertexId| -> Vec<RowEntry> {
        rows.rows.row(v.index()).iter().map(|e| RowEntry { base: map.vertex_to[e.base.index()], ..*e }).collect()
    };
    let kept: Vec<Vec<RowEntry>> = map.vertex_from.iter().map(|&v| row(v)).collect();
    VertexRows {
        rest_position: map.vertex_from.iter().map(|v| rows.rest_position[v.index()]).collect::<Vec<_>>().into(),
        rows: SlotCsr::from_rows(kept.iter().map(Vec::as_slice)),
        bones: SlotCsr::from_rows(map.vertex_from.iter().map(|v| rows.bones.row(v.index()))),
    }
}

impl SoftLayer {
    /// The particles anchored in a piece, renumbered, with their state; influences by others are kept for now as
    /// [`ParticleId::NONE`].
    fn extract(&self, map: &Extraction) -> SoftLayer {
        let kept: Vec<ParticleId> = (0..self.map.len())
            .map(ParticleId::new)
            .filter(|p| {
                let anchor = self.map.anchors[p.index()];
                anchor.is_some() && map.vertex_to[anchor.index()].is_some()
            })
            .collect();
        let to: BTreeMap<ParticleId, ParticleId> = kept.iter().enumerate().map(|(new, &old)| (old, ParticleId::new(new))).collect();
        let influences: Vec<Vec<Influence>> = map
            .vertex_from
            .iter()
            .map(|v| {
                let row = self.map.influences.row(v.index());
                row.iter().map(|i| Influence { particle: to.get(&i.particle).copied().unwrap_or_default(), ..*i }).collect()
            })
            .collect();
        let neighbours: Vec<Vec<Link>> = kept
            .iter()
            .map(|p| {
                let row = self.map.neighbours.row(p.index());
                row.iter().filter_map(|l| to.get(&l.particle).map(|&particle| Link { particle, ..*l })).collect()
            })
            .collect();
        let extracted = ParticleMap {
            anchors: kept.iter().map(|p| map.vertex_to[self.map.anchors[p.index()].index()]).collect::<Vec<_>>().into(),
            rest_displacement: kept.iter().map(|p| self.map.rest_displacement[p.index()]).collect::<Vec<_>>().into(),
            influences: SlotCsr::from_rows(influences.iter().map(Vec::as_slice)),
            neighbours: SlotCsr::from_rows(neighbours.iter().map(Vec::as_slice)),
        };
        SoftLayer { map: extracted, strips: self.strips.extract(&map.vertex_from, &kept), network: self.network.extract(&kept), settings: self.settings }
    }

    /// Drops influences of particles that are gone ([`ParticleId::NONE`], or not `kept`), and renormalises. Returns the
    /// vertices whose rows changed; a row may be left empty.
    fn drop_foreign(&mut self, kept: Option<(&Mesh, &[bool])>) -> Vec<VertexId> {
        let stays = |p: ParticleId| p.is_some() && kept.is_none_or(|(_, kept)| kept[p.index()]);
        let mut changed = Vec::new();
        for v in 0..self.map.influences.rows() {
            let row = self.map.influences.row(v);
            if row.iter().all(|i| stays(i.particle)) || kept.is_some_and(|(mesh, _)| !mesh.vertex_is_live(VertexId::new(v))) {
                continue;
            }
            let mut left: Vec<Influence> = row.iter().copied().filter(|i| stays(i.particle)).collect();
            let sum: f32 = left.iter().map(|i| i.weight).sum();
            left.iter_mut().for_each(|i| i.weight /= sum);
            self.map.influences.set_row(v, &left);
            changed.push(VertexId::new(v));
        }
        if let Some((_, kept)) = kept {
            for p in (0..self.map.len()).filter(|&p| !kept[p]) {
                self.map.anchors.set(p, VertexId::NONE);
                self.map.neighbours.set_row(p, &[]);
            }
        }
        changed
    }
}
