//! Taking a tissue apart into connected pieces (MATHS 6). A piece copies the base parents that its rows use.
//!
//! The work is linear in what leaves: arrays are gathered through tables that tell where each thing went, sections keep their
//! bounds, and the particles' matrix is cut out of the parent's.

use super::{SoftLayer, Tissue, springs};
use crate::geometry::{Components, Extraction, FaceId, HalfEdge, Measures, Part, ParticleId, SectionId, VertexId};
use crate::particles::{RowBefore, StripsDerived};
use crate::rig::{RowEntry, VertexRows};
use glam::DVec3;
use std::sync::Arc;

/// A piece whose sections are on average this much emptier than they may be gets new ones.
const SPARSE: usize = 4;
/// What is severed and has less surface than a square of this side, a fraction of the diagonal, is a crumb and no piece.
const CRUMB: f64 = 1e-4;
/// What is thinner than this, a fraction of the diagonal, has no inside: its two skins differ by what positions are rounded to.
const FLAT: f64 = 5e-6;
/// Nor does it count as flat if its volume is more than this, in cubes of the diagonal.
const FLAT_VOLUME: f64 = 1e-11;
/// Shreds of tissue that moved are shorter than so many widths of the blade.
const SHRED_LENGTH: f64 = 8.0;
/// Solid shreds are thinner than this, in widths of the blade.
const SHRED_THICKNESS: f64 = 0.05;
/// Crumbs have no more faces than this.
const MOST_CRUMB_FACES: usize = 64;
/// What a piece was in the tissue that it came off.
#[derive(Clone, Debug, Default)]
pub(super) struct CameFrom {
    /// Which vertex of that each of its first vertices was.
    vertices: Vec<VertexId>,
    /// Which particle of that each of its first particles was, ascending; then [`ParticleId::NONE`] for those that it got of its own.
    particles: Vec<ParticleId>,
}

/// From this share of changed particles on, the network is cut out anew: one in so many.
const MANY_CHANGED: usize = 8;

impl Tissue {
    /// Faces of each connected component, ascending; components by their lowest face.
    pub fn component_faces(&self) -> Vec<Vec<FaceId>> {
        let found = Components::find(&self.mesh);
        (0..found.count()).map(|c| found.faces(c).to_vec()).collect()
    }

    /// Moves each of `parts` (one or more whole components, faces ascending) into a tissue of its own, with the particles that
    /// hold its vertices; particles that hold vertices on both sides go on in both. Every vertex stays where it is: what moved
    /// it and no longer does fades out (MATHS 2.2).
    pub fn sever(&mut self, parts: &[Vec<FaceId>]) -> Vec<Box<Tissue>> {
        if parts.iter().all(Vec::is_empty) {
            return Vec::new();
        }
        self.note_edits();
        let mut map = std::mem::take(&mut self.scratch.extraction);
        let mut gone = Vec::new();
        let mut pieces = Vec::with_capacity(parts.len());
        let strips = self.layer.as_ref().map(|layer| layer.strips.derived_copy()).unwrap_or_default();
        for faces in parts.iter().filter(|faces| !faces.is_empty()) {
            let piece = self.extract(faces, &mut map, &strips);
            let first = gone.len();
            gone.reserve(map.vertex_from.len());
            let live = map.vertex_from.iter().zip(piece.mesh.all_vertex_half_edges()).filter(|(_, half)| half.is_some());
            gone.extend(live.map(|(v, _)| *v));
            let whole: Vec<bool> = (0..self.mesh.sections()).map(|s| self.tally.is_whole(SectionId::new(s))).collect();
            self.mesh.remove_components(faces, gone[first..].iter().copied(), &whole);
            pieces.push(piece);
        }
        self.scratch.extraction = map;
        self.forget(&gone);
        pieces
    }

    /// The surface in square metres of a part that has come off, where it is a crumb and no piece: rounding, as where a blade crosses its
    /// own slit and leaves corners that no stored position can tell apart, or flakes without thickness; or, in tissue that moved under
    /// the blade, what is thinner than `shreds` metres: the ends of boxes do not quite meet there.
    pub fn crumb_area(&self, part: &Part, shreds: f64) -> Option<f64> {
        if part.faces > MOST_CRUMB_FACES {
            return None;
        }
        let faces = || part.all_faces(&self.mesh);
        let mut measured = Measures::EMPTY;
        measured.add_faces(&self.mesh, faces(), |v| self.position(v));
        let (size, Measures { area, volume, .. }) = (measured.diagonal(), measured);
        let diagonal = self.diagonal();
        let is_open = faces().any(|f| (0..3).any(|k| self.mesh.opposite(HalfEdge::of(f, k)).is_none()));
        let thickness = 2.0 * volume.abs() / area;
        let is_tiny = area < (CRUMB * diagonal).powi(2);
        let is_flat = !is_open && thickness < FLAT * diagonal && volume.abs() < FLAT_VOLUME * diagonal.powi(3);
        let is_shred = if is_open {
            size < shreds || (size < SHRED_LENGTH * shreds && area < 0.5 * shreds * size)
        } else {
            let is_wall = || faces().all(|f| self.mesh.is_interior(f));
            (size < shreds && is_wall()) || (size < SHRED_LENGTH * shreds && thickness < SHRED_THICKNESS * shreds)
        };
        (is_tiny || is_flat || is_shred).then_some(area)
    }

    /// Takes out crumbs: `faces` (ascending, each once) of whole components.
    pub fn drop_crumbs(&mut self, faces: &[FaceId]) {
        self.note_edits();
        let mut gone = std::mem::take(&mut self.scratch.crumbs);
        gone.clear();
        gone.extend(faces.iter().flat_map(|&f| self.mesh.face(f)));
        gone.sort_unstable();
        gone.dedup();
        self.mesh.remove_components(faces, gone.iter().copied(), &[]);
        self.forget(&gone);
        self.scratch.crumbs = gone;
    }

    /// Each of a piece's first vertices, with the one of the tissue it came off that it was.
    fn own_and_parents(&self) -> impl Iterator<Item = (VertexId, VertexId)> + '_ {
        self.came_from.vertices.iter().enumerate().map(|(own, &parents)| (VertexId::new(own), parents))
    }

    /// What a particle of the tissue that this piece came off is here, if what it was anchored to came along.
    pub fn particle_that_was(&self, parents: ParticleId, anchor: VertexId) -> Option<ParticleId> {
        let known = self.came_from.particles.partition_point(|p| p.is_some());
        let own = self.came_from.particles[..known].binary_search(&parents).ok()?;
        let at = self.layer.as_ref()?.map.anchors.get(own)?;
        (self.came_from.vertices.get(at.index()) == Some(&anchor)).then(|| ParticleId::new(own))
    }

    /// What a particle of this piece was in the tissue that it came off.
    pub fn particle_before(&self, own: ParticleId) -> Option<ParticleId> {
        self.came_from.particles.get(own.index()).copied().filter(|p| p.is_some())
    }

    /// Where the vertices stand that came from the tissue this piece was severed from, by their numbers there.
    pub(super) fn stands_in_parent(&self) -> impl Iterator<Item = (VertexId, DVec3)> + '_ {
        let live = self.own_and_parents().filter(|(v, _)| self.mesh.vertex_is_live(*v));
        live.map(|(v, from)| (from, self.position(v)))
    }

    /// A piece is about to come off `parent` again, as it did before: it has the pose and the clock of that, and those of its vertices
    /// that are there already fade from where they stand.
    pub fn come_off_again(&mut self, parent: &Tissue) {
        self.pose.clone_from(&parent.pose);
        (self.animation, self.time_s) = (parent.animation, parent.time_s);
        self.versions.pose += 1;
        self.refresh_turns();
        let there = self
            .own_and_parents()
            .filter(|&(_, from)| from.index() < parent.mesh.vertex_slots() && parent.mesh.vertex_is_live(from));
        self.hold(there.map(|(v, from)| (v, parent.position(from))).collect());
    }

    /// A tissue of `faces`. They stay here as well.
    fn extract(&self, faces: &[FaceId], map: &mut Extraction, strips: &Arc<StripsDerived>) -> Box<Tissue> {
        let rows = &self.rows;
        let mesh = self.mesh.extract(faces, |v| rows.rows.row(v.index()).iter().map(|e| e.base), map);
        let mut piece = Box::new(Tissue {
            name: self.name.clone(),
            mesh,
            rows: extract_rows(rows, map),
            rest: map.vertex_from.iter().map(|&v| self.rest[v.index()]).collect(),
            rig: self.rig.clone(),
            materials: self.materials.clone(),
            layer: None,
            fades: self.fades.extract(&map.vertex_from),
            pose: self.pose.clone(),
            sections: self.sections.extract(&map.section_from),
            scratch: Default::default(),
            touch: Default::default(),
            tally: self.tally.extract(map, self.position_key()),
            forces: self.forces.fresh(),
            came_from: CameFrom { vertices: map.vertex_from.clone(), particles: Vec::new() },
            ..*self
        });
        if piece.mesh.sections() > SPARSE * (1 + faces.len() / self.section_faces.max(1)) {
            piece.build_sections();
            piece.tally = Default::default();
        }
        if let Some(layer) = &self.layer {
            let (own, particles, rows_before) = layer.extract(&piece, map, &self.rest, strips);
            (piece.layer, piece.came_from.particles) = (Some(own), particles);
            if layer.network.settings().rotations {
                let stood = |v: VertexId| (v, self.position(map.vertex_from[v.index()]));
                let targets: Vec<(VertexId, DVec3)> = piece.mesh.live_vertices().map(stood).collect();
                piece.refresh_turns();
                piece.fade_from(targets.into_iter());
            } else {
                piece.hold_relinked(rows_before.iter().map(|(v, row)| (*v, row.as_slice())));
            }
        }
        piece
    }

    /// After pieces have left with the vertices `gone`: particles that hold nothing else go too.
    fn forget(&mut self, gone: &[VertexId]) {
        self.versions.structure += 1;
        if let Some(SoftLayer { map, .. }) = &mut self.layer
            && map.anchors.iter().all(|a| a.is_none() || self.mesh.vertex_is_live(*a))
        {
            map.let_go(&self.mesh, gone.iter().copied());
            return;
        }
        // particles that have lost neighbours turn otherwise, which moves all that they hold
        let turns = self.layer.as_ref().is_some_and(|l| l.network.settings().rotations);
        let stood: Vec<(VertexId, DVec3)> =
            if turns { self.mesh.live_vertices().map(|v| (v, self.position(v))).collect() } else { Vec::new() };
        let Some(layer) = &mut self.layer else { return };
        let done = layer.map.forget(&self.mesh, &self.rest, &mut layer.strips, gone.iter().copied());
        let (len, before, map) = (layer.map.len(), layer.network.len(), &layer.map);
        if MANY_CHANGED * done.particles_changed.len() < len {
            layer.network.update_springs(len, &done.particles_changed, |p| springs(map, p));
        } else {
            let old = |j: usize| if j < before { ParticleId::new(j) } else { ParticleId::NONE };
            let kept: Vec<ParticleId> = (0..len).map(old).collect();
            layer.network = if done.keeps_springs {
                layer.network.part(&kept, |p| map.anchors[p].is_some())
            } else {
                layer.network.subset(&kept, |p| springs(map, p))
            };
        }
        if turns {
            self.refresh_turns();
            self.fade_from(stood.into_iter());
        } else {
            self.hold_relinked(done.rows_before.iter().map(|(v, row)| (*v, row.as_slice())));
        }
    }
}

fn extract_rows(rows: &VertexRows, map: &Extraction) -> VertexRows {
    let all = map.vertex_from.iter().map(|v| Some(v.index()));
    VertexRows {
        rest_position: map.vertex_from.iter().map(|v| rows.rest_position[v.index()]).collect::<Vec<_>>().into(),
        rows: rows.rows.gather(all.clone(), |e| RowEntry { base: map.vertex_to[e.base.index()], ..*e }),
        bones: rows.bones.gather(all, |bone| *bone),
        scratch: Vec::new(),
    }
}

impl SoftLayer {
    /// The layer of a piece, with the displacements and velocities of its particles, what those were here, and the rows of its vertices
    /// that changed.
    fn extract(
        &self,
        piece: &Tissue,
        map: &Extraction,
        rest: &[DVec3],
        strips: &Arc<StripsDerived>,
    ) -> (SoftLayer, Vec<ParticleId>, Vec<RowBefore>) {
        let mut strips = self.strips.extract(&map.vertex_from, strips);
        let vertices = (&map.vertex_from[..], &map.vertex_to[..]);
        let part = self.map.extract((&piece.mesh, &piece.rest, &strips), vertices, rest);
        strips.take_wounds(&self.strips, &part.from);
        let mut network = if part.keeps_springs {
            self.network.part(&part.from, |_| true)
        } else {
            self.network.subset(&part.from, |p| springs(&part.map, p))
        };
        network.set_grabs(&[]);
        let opened = |old: &ParticleId| self.opening.get(old.index()).copied().unwrap_or_default();
        let layer = SoftLayer {
            opening: part.from.iter().map(opened).collect(),
            opening_s: self.opening_s,
            settings: self.settings,
            map: part.map,
            strips,
            network,
            truncation_error: self.truncation_error,
            particle_mass: self.particle_mass,
        };
        (layer, part.from, part.rows_before)
    }
}
