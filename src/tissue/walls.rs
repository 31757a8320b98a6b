//! What closed walls need of a tissue: corners inside the volume as base vertices (MATHS 1.4), a material, wider sections.

use super::Tissue;
use crate::formats::Material;
use crate::geometry::{FaceId, SectionId, VertexId};
use crate::rig::{BoneWeight, RowEntry, rounded};
use crate::surgery::insert::NewVertex;
use glam::{DAffine3, DMat3, DVec3, Vec3};
use smallvec::SmallVec;
use std::sync::Arc;

/// Below this ratio of the blended matrix's volume to one, the dominant bone poses a corner instead.
const NEAR_SINGULAR: f64 = 0.05;
/// A corner this near to its place, as a fraction of the diagonal, is off by rounding alone.
pub(super) const ROUNDING: f64 = 5e-7;
/// Bones that a corner leans on at most, as in glTF.
const MOST_BONES: usize = 4;
/// Bones that several vertices lean on, as many as there is room for at first.
const BONES_ROOM: usize = 128;
/// Rows longer than this become base vertices.
pub(super) const LONGEST_ROW: usize = 12;

impl Tissue {
    /// The index of the material of walls and floors, made when first asked for. UVs there are metres along the wall.
    pub(crate) fn wound_material(&mut self) -> u32 {
        self.own_material("wound", [0.16, 0.012, 0.012, 1.0])
    }

    /// The index of the material of caps, made when first asked for. UVs there are metres in the plane.
    pub(super) fn cap_material(&mut self) -> u32 {
        self.own_material("cap", [0.19, 0.022, 0.021, 1.0])
    }

    fn own_material(&mut self, name: &str, base_colour: [f32; 4]) -> u32 {
        if let Some(known) = self.materials.iter().position(|m| m.name == name) {
            return known as u32;
        }
        let materials = Arc::make_mut(&mut self.materials);
        if materials.is_empty() {
            // the faces of a model without materials name the first: it must not become this one
            materials.push(Material::named("flesh"));
        }
        materials.push(Material { name: name.into(), base_colour, ..Material::default() });
        materials.len() as u32 - 1
    }

    /// Appends a corner that stands at `n.position` now, moved by what moves `n`'s first parent. It hangs on the skin; where bones move
    /// nothing, or it lies in no body, it is a base vertex with that parent's bones. `made` lists the edit's vertices, whose
    /// influences are not known yet; call [`super::chords::ChordScratch::begin`] with it first.
    pub(super) fn push_corner(&mut self, n: &NewVertex, made: &[NewVertex]) -> VertexId {
        let parent = n.parents[0].0;
        if parent.is_none() {
            return self.push_base_apart(n.vertex, n.position, &[]);
        }
        let skinned = n.position - self.moved_by(parent, made);
        let mut chords = std::mem::take(&mut self.scratch.chords);
        let hanging = self.hang(skinned, n.position, made, &mut chords);
        self.scratch.chords = chords;
        if let Some(hanging) = hanging {
            return self.rows.push_embedded(&hanging);
        }
        let bones = self.blended_bones(&[(parent, 1.0)]);
        let rest = self.solve_rest(&bones, skinned);
        self.push_base_apart(n.vertex, rest, &bones)
    }

    /// Appends `vertex` as a base vertex at `rest`, rounded so that it does not fall upon one that an edge joins it to: planes that nearly
    /// fall together meet in points that the nearest f32 cannot tell apart, and faces there would have no area.
    pub(super) fn push_base_apart(&mut self, vertex: VertexId, rest: DVec3, bones: &[BoneWeight]) -> VertexId {
        let Self { mesh, rows, .. } = &*self;
        let known = |w: &VertexId| w.index() < rows.len();
        let is_apart = |p: &Vec3| mesh.neighbours(vertex).filter(known).all(|w| rows.rest_position[w.index()] != p.to_array());
        let stored = rounded(rest, |p| !mesh.vertex_is_live(vertex) || is_apart(p));
        self.rows.push_base(stored.to_array(), bones)
    }

    /// How far particles and fades move a vertex, which the edit may have made.
    fn moved_by(&self, v: VertexId, made: &[NewVertex]) -> DVec3 {
        let seen = made.iter().find(|m| m.vertex == v).map_or_else(|| self.position(v), |m| m.position);
        seen - self.pose.skin(&self.rows, v)
    }

    /// Corners are stored in f32, so they stand a rounding off their place: there they are, rather than being held by a
    /// fade, which would make the next box depend on the time that has passed.
    pub(super) fn settle_corners(&self, made: &mut [NewVertex]) {
        for i in 0..made.len() {
            let (vertex, parent) = (made[i].vertex, made[i].parents[0].0);
            if made[i].parent_count == 0 && parent.is_some() {
                let stands = self.pose.skin(&self.rows, vertex) + self.moved_by(parent, made);
                if stands.distance(made[i].position) < ROUNDING * self.diagonal {
                    made[i].position = stands;
                }
            }
        }
    }

    /// Bones of a combination of vertices: the heaviest few, with weights that sum to 1.
    pub(super) fn blended_bones(&self, parents: &[(VertexId, f64)]) -> SmallVec<[BoneWeight; MOST_BONES]> {
        let mut all: SmallVec<[(u32, f64); BONES_ROOM]> = SmallVec::new();
        for &(parent, share) in parents {
            let itself = [RowEntry { base: parent, padding: 0, weight: 1.0 }];
            let row = self.rows.rows.row(parent.index());
            for entry in if row.is_empty() { &itself[..] } else { row } {
                for bone in self.rows.bones.row(entry.base.index()) {
                    let weight = f64::from(bone.weight) * entry.weight * share;
                    match all.iter_mut().find(|b| b.0 == bone.joint) {
                        Some(known) => known.1 += weight,
                        None => all.push((bone.joint, weight)),
                    }
                }
            }
        }
        all.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        all.truncate(MOST_BONES);
        all.retain(|b| b.1 > 1e-6);
        let sum: f64 = all.iter().map(|b| b.1).sum();
        all.iter().map(|&(joint, weight)| BoneWeight { joint, weight: (weight / sum) as f32 }).collect()
    }

    /// The rest position whose skinned place is `skinned` in the current pose.
    pub(super) fn solve_rest(&self, bones: &[BoneWeight], skinned: DVec3) -> DVec3 {
        let Some(first) = bones.first() else { return skinned };
        let matrix = |joint: u32| self.pose.joint_matrices[joint as usize].affine();
        let blended = bones.iter().fold(DAffine3 { matrix3: DMat3::ZERO, translation: DVec3::ZERO }, |sum, b| {
            let (m, w) = (matrix(b.joint), f64::from(b.weight));
            DAffine3 { matrix3: sum.matrix3 + m.matrix3 * w, translation: sum.translation + m.translation * w }
        });
        let singular = blended.matrix3.determinant().abs() <= NEAR_SINGULAR;
        let m = if singular { matrix(first.joint) } else { blended };
        let rest = m.inverse().transform_point3(skinned);
        if rest.is_finite() { rest } else { skinned }
    }

    /// Widens the sections that list `faces`, so that their corners lie inside.
    pub(super) fn widen_sections(&mut self, faces: impl Iterator<Item = FaceId>) {
        let Self { mesh, scratch, .. } = self;
        scratch.corners.clear();
        scratch.corners.extend(faces.flat_map(|f| mesh.face(f).map(|v| (mesh.face_info(f).section, v))));
        self.widen_by_corners();
    }

    /// Widens the sections around those of the inserted vertices that were promoted: a base vertex with few bones is no longer a mean of
    /// what its parents lean on.
    pub(super) fn widen_around_promoted(&mut self, new: &[NewVertex]) {
        let Self { mesh, rows, scratch, .. } = self;
        let promoted = |n: &&NewVertex| n.parent_count > 0 && rows.is_base(n.vertex) && mesh.vertex_is_live(n.vertex);
        let sections = |n: &NewVertex| mesh.fan(n.vertex).map(|h| mesh.face_info(h.face()).section);
        scratch.corners.clear();
        scratch.corners.extend(new.iter().filter(promoted).flat_map(|n| sections(n).map(|s| (s, n.vertex))));
        self.widen_by_corners();
    }

    /// Widens the sections of the pairs in the scratch.
    fn widen_by_corners(&mut self) {
        let Self { rows, rest, sections, scratch, .. } = self;
        let corners = &mut scratch.corners;
        corners.sort_unstable();
        corners.dedup();
        for run in corners.chunk_by(|a, b| a.0 == b.0) {
            sections.widen_by(run[0].0, rows, rest, run.iter().map(|c| c.1));
        }
    }

    /// Widens one section by many vertices at once.
    pub(super) fn widen_section(&mut self, section: SectionId, vertices: impl Iterator<Item = VertexId>) {
        self.sections.widen_by(section, &self.rows, &self.rest, vertices);
    }
}
