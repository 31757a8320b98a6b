//! Taking a tissue apart into connected pieces (MATHS 6). A piece copies the base parents that its rows use.

use super::{SoftLayer, Tissue, topology};
use crate::geometry::{Components, Extraction, FaceId, ParticleId, SlotCsr, TopologyScratch, VertexId};
use crate::physics::Network;
use crate::rig::{Fades, RowEntry, VertexRows};
use glam::DVec3;

impl Tissue {
    /// Faces of each connected component, ascending; components by their lowest face.
    pub fn component_faces(&self) -> Vec<Vec<FaceId>> {
        let found = Components::find(&self.mesh);
        (0..found.count()).map(|c| found.faces(c).to_vec()).collect()
    }

    /// Moves `faces` (one or more whole components, ascending) into a tissue of their own, with the particles anchored
    /// there. What a vertex was moved by, and no longer is, fades out from where it stood (MATHS 2.2). To be followed by
    /// [`Tissue::forget_vertices`] on what is left.
    pub fn extract_piece(&mut self, faces: &[FaceId]) -> Tissue {
        let parents = row_parents(&self.rows, faces.iter().flat_map(|&f| self.mesh.face(f)));
        let (mesh, map) = self.mesh.extract(faces, &parents);
        let rows = extract_rows(&self.rows, &map);
        let kept_fade = |v: &VertexId| self.fades.entries.get(v.index()).copied().unwrap_or_default();
        let entries = if self.fades.entries.is_empty() { Vec::new() } else { map.vertex_from.iter().map(kept_fade).collect() };
        let mut piece = Tissue {
            name: self.name.clone(),
            mesh,
            rows,
            rest: map.vertex_from.iter().map(|&v| self.rest[v.index()]).collect(),
            rig: self.rig.clone(),
            materials: self.materials.clone(),
            layer: None,
            fades: Fades { entries, ..self.fades.clone() },
            pose: self.pose.clone(),
            sections: Default::default(),
            scratch: Default::default(),
            touch: Default::default(),
            tally: Default::default(),
            forces: self.forces.fresh(),
            ..*self
        };
        piece.build_sections();
        if let Some(layer) = &self.layer {
            let targets: Vec<(VertexId, DVec3)> =
                piece.mesh.live_vertices().map(|v| (v, self.position(map.vertex_from[v.index()]))).collect();
            piece.layer = layer.extract(&piece, &map);
            piece.fade_from(targets.into_iter());
        }
        piece.discard_delta();
        self.mesh.remove_faces(faces, &mut TopologyScratch::default());
        piece
    }

    /// After pieces have left: particles anchored there go, and what they moved is taken over by others, with fades that hold
    /// every vertex. `removed` lists the vertices that no face uses any more.
    pub fn forget_vertices(&mut self, removed: &[VertexId]) {
        self.update_map(&[], removed, 0..0, &[]);
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
    /// The layer of a piece: the particles anchored in it, with their displacements and velocities.
    fn extract(&self, piece: &Tissue, map: &Extraction) -> Option<SoftLayer> {
        let mut strips = self.strips.extract(&map.vertex_from, &[]);
        let (particles, kept) = self.map.extract(&piece.mesh, &piece.rest, &strips, &map.vertex_from);
        strips = self.strips.extract(&map.vertex_from, &kept);
        let mut network = Network::new(&topology(&particles), self.network.settings(), piece.diagonal).ok()?;
        for (new, old) in kept.iter().enumerate().filter(|(_, old)| old.is_some()) {
            let new = ParticleId::new(new);
            network.set_state(new, self.network.displacement(*old), self.network.velocity(*old));
        }
        let opened = |old: &ParticleId| self.opening.get(old.index()).copied().unwrap_or_default();
        let opening = kept.iter().map(opened).collect();
        Some(SoftLayer {
            opening,
            opening_s: self.opening_s,
            settings: self.settings,
            map: particles,
            strips,
            network,
            truncation_error: self.truncation_error,
            particle_mass: self.particle_mass,
        })
    }
}
