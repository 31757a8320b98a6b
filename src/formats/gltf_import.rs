//! glTF 2.0: all triangle primitives of all mesh nodes of the chosen scene, with materials, skins and animations.

use super::gltf_data::Document;
use super::gltf_extensions::DRACO;
use super::gltf_materials::{self, Laid};
use super::gltf_primitive::{Attributes, read_attributes, triangles};
use super::gltf_rig::{self, ImportedRig, warn_once};
use super::gltf_skins::BindChange;
use super::material::Material;
use super::stored::{Dress, Stored, StoredFace};
use super::{FormatError, LoadReport, Model, assemble};
use crate::geometry::cofactor;
use crate::rig::{BoneWeight, Joint};
use glam::{DAffine3, DMat3, DVec3};
use gltf::json;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Most stored vertices of a model: beyond this the 32-bit half-edge numbers of its faces would not fit.
const MAX_VERTICES: usize = 1 << 27;

/// Vertices of different skins that are nearer to each other than this, in diagonals, are in one place.
const NEAR: f64 = 1e-5;

/// Reads a .glb or .gltf file; external files are looked up in `folder`.
pub(crate) fn read(bytes: &[u8], name: &str, folder: Option<&Path>) -> Result<Model, FormatError> {
    let document = Document::parse(bytes, folder)?;
    let mut report = LoadReport { skins_stored: document.root.skins.len(), ..LoadReport::default() };
    if document.extensions.have_channels_without_node() {
        report.warnings.push("animation channels that name no node are left out".into());
    }
    let rig = gltf_rig::read(&document, &mut report.warnings)?;
    let rigid_joints = vec![u32::MAX; rig.rig.nodes.len()];
    let (mut materials, laid) = gltf_materials::read(&document, folder, &mut report.warnings);
    let (stored, skinned) = (Stored::default(), Vec::new());
    let mut import = Import { document, rig, rigid_joints, stored, skinned, laid, report };
    import.read_meshes()?;
    if import.stored.faces.iter().any(|f| f.material as usize == materials.len()) {
        materials.push(Material { finish: Some(Arc::default()), ..Material::default() });
    }
    import.finish(name, materials)
}

struct Import<'a> {
    document: Document<'a>,
    rig: ImportedRig,
    /// Rigid joint of each rig node, `u32::MAX` where it has none.
    rigid_joints: Vec<u32>,
    stored: Stored,
    skinned: Vec<Skinned>,
    /// How the file's materials are laid.
    laid: Vec<Laid>,
    report: LoadReport,
}

/// What a skinned primitive stored.
struct Skinned {
    /// Of the rig.
    skin: usize,
    vertices: Range<usize>,
    faces: Range<usize>,
}

impl Import<'_> {
    fn read_meshes(&mut self) -> Result<(), FormatError> {
        for node in 0..self.rig.scene_nodes {
            let file_node = self.rig.file_node[node] as usize;
            let (mesh, skin) = {
                let n = &self.document.root.nodes[file_node];
                (n.mesh.map(|m| m.value()), n.skin.map(|s| s.value()))
            };
            let Some(mesh) = mesh else { continue };
            if self.document.extensions.is_instanced(file_node) {
                let warning = "instances (EXT_mesh_gpu_instancing) are left out: their mesh is read once";
                warn_once(&mut self.report.warnings, warning);
            }
            let meshes = self.document.root.meshes.len();
            if mesh >= meshes {
                return Err(FormatError::range(format!("node {file_node}"), "mesh", mesh as u64, meshes));
            }
            if let Some(skin) = skin.filter(|&s| s >= self.rig.skins.len()) {
                let skins = self.rig.skins.len();
                return Err(FormatError::range(format!("node {file_node}"), "skin", skin as u64, skins));
            }
            for index in 0..self.document.root.meshes[mesh].primitives.len() {
                self.read_primitive(node, mesh, index, skin)?;
            }
        }
        Ok(())
    }

    fn read_primitive(&mut self, node: usize, mesh: usize, index: usize, skin: Option<usize>) -> Result<(), FormatError> {
        let primitive = &self.document.root.meshes[mesh].primitives[index];
        if primitive.targets.as_ref().is_some_and(|t| !t.is_empty()) {
            warn_once(&mut self.report.warnings, "morph targets are left out");
        }
        let label = match &self.document.root.meshes[mesh].name {
            Some(name) => format!("mesh \"{name}\", primitive {index}"),
            None => format!("mesh {mesh}, primitive {index}"),
        };
        let bare = |a: &json::Index<json::Accessor>| {
            self.document.root.accessors.get(a.value()).is_some_and(|a| a.buffer_view.is_none() && a.sparse.is_none())
        };
        if self.document.extensions.is_compressed(mesh, index) && primitive.attributes.values().any(bare) {
            return Err(FormatError::UnsupportedExtension { name: DRACO.into() });
        }
        let Some(faces) = triangles(&self.document, primitive, &label, &mut self.report.warnings)? else { return Ok(()) };
        let materials = self.laid.len();
        let material = primitive.material.map_or(materials, |m| m.value());
        if material > materials || (primitive.material.is_some() && material == materials) {
            return Err(FormatError::range(label, "material", material as u64, materials));
        }
        let joints = skin.map(|s| self.rig.skins[s].palette.as_slice());
        let laid = primitive.material.and_then(|m| self.laid.get(m.value())).copied().unwrap_or_default();
        let mut attributes = read_attributes(&self.document, primitive, laid.uv_set, joints, &faces, &label)?;
        if let Some(transform) = laid.transform {
            attributes.uvs.iter_mut().for_each(|uv| *uv = transform.apply(*uv));
        }
        let total = self.stored.positions.len() + attributes.positions.len();
        if total > MAX_VERTICES {
            return Err(FormatError::TooLarge { what: "vertices", count: total as u64, limit: MAX_VERTICES as u64 });
        }
        let start = self.stored.positions.len();
        let flip = match (skin, attributes.bones.is_empty()) {
            (Some(skin), false) => {
                let first = self.stored.faces.len();
                let used = &self.rig.skins[skin];
                self.skinned.push(Skinned { skin: used.skin, vertices: start..total, faces: first..first + faces.len() });
                let change = used.bind_change;
                self.push_skinned(&attributes, change);
                change.mirrors // else by its joints: see `normalise_bind_space`
            }
            _ => self.push_rigid(&attributes, node),
        };
        for mut face in faces {
            if flip {
                face.swap(1, 2);
            }
            let corners = face.map(|v| v + start as u32);
            self.stored.faces.push(StoredFace { corners, dresses: corners, material: material as u32 });
        }
        Ok(())
    }

    /// A skinned mesh ignores its own node's transform.
    fn push_skinned(&mut self, attributes: &Attributes, change: BindChange) {
        for (i, p) in attributes.positions.iter().enumerate() {
            self.stored.push(change.point(widen(*p)), attributes.mark(i), attributes.bones(i));
            self.stored.dresses.push(attributes.dress(i, attributes.normals.get(i).map(|&n| change.normal(n))));
        }
    }

    /// Bakes a mesh into model space; where its node moves, a rigid joint carries it. True if faces are mirrored.
    fn push_rigid(&mut self, attributes: &Attributes, node: usize) -> bool {
        let world = self.rig.worlds[node];
        let determinant = world.matrix3.determinant();
        let moves = self.rig.moves[node];
        let flat = determinant.abs() < 1e-18;
        let inverse_bind = if flat { DAffine3::IDENTITY } else { world.inverse() };
        let bone = moves.then(|| BoneWeight { joint: self.rigid_joint(node, inverse_bind), weight: 1.0 });
        let bones = bone.as_slice();
        let place = if moves && flat { DAffine3::IDENTITY } else { world };
        let cofactor = cofactor(place.matrix3) * place.matrix3.determinant().signum();
        for (i, p) in attributes.positions.iter().enumerate() {
            self.stored.push(place.transform_point3(widen(*p)), attributes.mark(i), bones);
            let normal = attributes.normals.get(i).map(|n| (cofactor * widen(*n)).normalize_or_zero().as_vec3().to_array());
            self.stored.dresses.push(attributes.dress(i, normal));
        }
        place.matrix3.determinant() < 0.0
    }

    fn rigid_joint(&mut self, node: usize, inverse_bind: DAffine3) -> u32 {
        if self.rigid_joints[node] == u32::MAX {
            self.rigid_joints[node] = self.rig.rig.joints.len() as u32;
            self.rig.rig.joints.push(Joint { node: node as u32, inverse_bind, skin: None });
        }
        self.rigid_joints[node]
    }

    fn finish(mut self, name: &str, materials: Vec<Material>) -> Result<Model, FormatError> {
        if let Some(v) = self.stored.positions.iter().position(|p| !p.is_finite()) {
            return Err(FormatError::NotFinite { what: format!("the position of vertex {v}") });
        }
        for skin in 0..self.rig.rig.skins.len() {
            self.normalise_bind_space(skin);
        }
        let still = |j: &u32| {
            !self.rig.moves[self.rig.rig.joints[*j as usize].node as usize] && self.rest_matrix(*j) == DAffine3::IDENTITY
        };
        self.stored.still = (0..self.rig.rig.joints.len() as u32).filter(still).collect();
        let all = self.posed_bounds(0..self.stored.positions.len());
        let origin = assemble::origin_of(all.0, all.1);
        self.tell_bind_spaces_apart((all.1 - all.0).length());
        let nodes = &self.document.root.nodes;
        let holds_mesh: Vec<bool> = self.rig.file_node.iter().map(|&n| nodes[n as usize].mesh.is_some()).collect();
        let mut rig = self.rig.rig;
        gltf_rig::drop_mesh_leaves(&mut rig, &holds_mesh);
        rig.origin = origin;
        let (mesh, rows) = assemble::assemble(&self.stored, origin, &mut self.report)?;
        Ok(Model { name: name.into(), mesh, rows, rig, materials, offset: origin, report: self.report })
    }

    /// Bounds in the pose of the stored node transforms, model space.
    fn posed_bounds(&self, vertices: impl Iterator<Item = usize>) -> (DVec3, DVec3) {
        bounds(vertices.map(|v| self.posed(v)))
    }

    /// Where a vertex is in that pose.
    fn posed(&self, v: usize) -> DVec3 {
        let (p, bones) = (self.stored.positions[v], self.stored.bones(v));
        if bones.is_empty() {
            return p;
        }
        bones.iter().map(|b| self.rest_matrix(b.joint).transform_point3(p) * f64::from(b.weight)).sum()
    }

    /// Rest positions of different skins may be equal in numbers and yet in different places, as those of a mesh that two
    /// figures wear: they are told apart by where the stored pose puts them. `diagonal` is that of the model.
    fn tell_bind_spaces_apart(&mut self, diagonal: f64) {
        let mut space = vec![0u32; self.stored.positions.len()]; // all that is rigid is in model space
        for skinned in &self.skinned {
            space[skinned.vertices.clone()].fill(skinned.skin as u32 + 1);
        }
        if space.windows(2).all(|w| w[0] == w[1]) {
            return;
        }
        let key = |v: u32| ((self.stored.positions[v as usize] + 0.0).to_array().map(f64::to_bits), space[v as usize]);
        let mut order: Vec<u32> = (0..space.len() as u32).collect();
        order.sort_unstable_by_key(|&v| (key(v), v));
        let mut places = vec![0u32; space.len()];
        for run in order.chunk_by(|&a, &b| key(a).0 == key(b).0).filter(|run| key(run[0]).1 != key(run[run.len() - 1]).1) {
            let mut seen: Vec<DVec3> = Vec::new();
            for copies in run.chunk_by(|&a, &b| key(a).1 == key(b).1) {
                let here = self.posed(copies[0] as usize);
                let known = seen.iter().position(|there| there.distance(here) <= NEAR * diagonal);
                copies.iter().for_each(|&v| places[v as usize] = known.unwrap_or(seen.len()) as u32);
                seen.extend(known.is_none().then_some(here));
            }
        }
        self.stored.places = places;
    }

    fn rest_matrix(&self, joint: u32) -> DAffine3 {
        let joint = &self.rig.rig.joints[joint as usize];
        self.rig.worlds[joint.node as usize] * joint.inverse_bind
    }

    /// Moves the bind space of a skin near to model space where they differ by a factor of 2 in size or by more than the
    /// model's diagonal: rest positions then have the size of the posed model (distances at rest mean something) and f32
    /// suffices. Where the joints mirror the skin, bind space is mirrored too: faces point outward at rest and posed, and a
    /// file that goes out needs no turning. The same similarity goes into the inverse binds, so every pose stays as it is.
    fn normalise_bind_space(&mut self, skin: usize) {
        let joints = self.rig.rig.skins[skin].joints.clone();
        let mut scales: Vec<f64> = joints.iter().map(|&j| self.rest_matrix(j).matrix3.determinant().abs().cbrt()).collect();
        scales.sort_unstable_by(f64::total_cmp);
        let median = scales.get(scales.len() / 2).copied().unwrap_or(1.0);
        let usable = median.is_finite() && median > 1e-12;
        let scale = if usable && !(0.5..=2.0).contains(&median) { median } else { 1.0 };
        let mirror = self.mirror_of(skin);
        let scale = mirror.unwrap_or(DVec3::ONE) * scale;
        let of_skin = || self.skinned.iter().filter(|s| s.skin == skin);
        let vertices: Vec<usize> = of_skin().flat_map(|s| s.vertices.clone()).collect();
        let faces: Vec<usize> = of_skin().flat_map(|s| s.faces.clone()).collect();
        let posed = self.posed_bounds(vertices.iter().copied());
        let bind = bounds(vertices.iter().map(|&v| self.stored.positions[v] * scale));
        let apart = ((posed.0 + posed.1) - (bind.0 + bind.1)).length() * 0.5 > (posed.1 - posed.0).length();
        let shift = if apart { assemble::origin_of(posed.0, posed.1) - assemble::origin_of(bind.0, bind.1) } else { DVec3::ZERO };
        if (scale == DVec3::ONE && shift == DVec3::ZERO) || !shift.is_finite() {
            return;
        }
        for v in vertices {
            self.stored.positions[v] = self.stored.positions[v] * scale + shift;
            if let (Some(mirror), Some(normal)) = (mirror, &mut self.stored.dresses[v].normal) {
                *normal = (widen(*normal) * mirror).as_vec3().to_array();
            }
        }
        for face in faces.into_iter().filter(|_| mirror.is_some()) {
            let face = &mut self.stored.faces[face];
            face.corners.swap(1, 2);
            face.dresses.swap(1, 2);
        }
        let back = DAffine3 { matrix3: DMat3::from_diagonal(scale.recip()), translation: -shift / scale };
        for joint in joints {
            let joint = &mut self.rig.rig.joints[joint as usize];
            joint.inverse_bind *= back;
        }
    }

    /// A reflection in the axis that the joints turn over most, if all joints that vertices of the skin follow mirror them
    /// in the stored pose. Joints that flatten decide nothing.
    fn mirror_of(&self, skin: usize) -> Option<DVec3> {
        let mut used = vec![false; self.rig.rig.joints.len()];
        for v in self.skinned.iter().filter(|s| s.skin == skin).flat_map(|s| s.vertices.clone()) {
            for bone in self.stored.bones(v).iter().filter(|b| b.weight > 0.0) {
                used[bone.joint as usize] = true;
            }
        }
        let matrices = || (0..).zip(&used).filter(|(_, used)| **used).map(|(joint, _)| self.rest_matrix(joint).matrix3);
        let flat = matrices().map(|m| m.determinant().abs()).fold(0.0, f64::max) * 1e-9;
        let mut clear = matrices().filter(|m| m.determinant().abs() > flat).peekable();
        clear.peek()?;
        if !clear.all(|m| m.determinant() < 0.0) {
            return None;
        }
        let diagonal = matrices().map(|m| DVec3::new(m.x_axis.x, m.y_axis.y, m.z_axis.z)).sum::<DVec3>();
        let axis = (0..3).min_by(|&a, &b| diagonal[a].total_cmp(&diagonal[b]))?;
        Some(DVec3::ONE - 2.0 * DVec3::AXES[axis])
    }
}

fn bounds(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(p), max.max(p)))
}

fn widen(p: [f32; 3]) -> DVec3 {
    DVec3::from_array(p.map(f64::from))
}

impl Attributes {
    fn mark(&self, i: usize) -> u32 {
        self.marks.get(i).copied().unwrap_or(super::stored::NO_MARK)
    }

    fn dress(&self, i: usize, normal: Option<[f32; 3]>) -> Dress {
        let usable = |n: &[f32; 3]| n.iter().all(|x| x.is_finite()) && n.iter().any(|&x| x != 0.0);
        let finite = |uv: &[f32; 2]| uv.iter().all(|x| x.is_finite());
        Dress {
            uv: self.uvs.get(i).copied().filter(finite).unwrap_or_default(),
            normal: normal.filter(usable),
            colour: self.colours.get(i).copied().unwrap_or(super::stored::WHITE),
        }
    }
}
