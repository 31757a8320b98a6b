//! Models out: pieces of one rig as a .glb with skin, nodes and all animations (MATHS 1.6, 1.8).

use super::FormatError;
use super::export_weights::{PlainVertex, STATIC, blend, plain};
use super::glb_writer::{self, BoneSet, GlbMesh, GlbPrimitive, GlbScene, GlbSkin};
use super::gltf_tangents;
use super::material::Material;
use super::stored::WHITE;
use crate::geometry::{FaceId, Mesh, VertexId};
use crate::rig::{LocalTransform, Node, Pose, PoseScratch, Rig, RoundedApart, Trs, VertexRows};
use glam::{DAffine3, DQuat, DVec3};
use std::collections::BTreeMap;

/// Marks are written as f32, exact up to here.
const MAX_MARKS: usize = 1 << 24;
/// Times at which each animation is sampled for the deviation.
const SAMPLES: usize = 16;
/// Positions are written about the tissue's origin where it is farther from that of model space than this many times the
/// farthest vertex is from it: about four diagonals.
const FAR: f64 = 8.0;

/// A mesh to be exported. All pieces of a file share one rig and its origin.
#[derive(Clone, Copy, Debug)]
pub struct ExportPiece<'a> {
    /// Name of its node.
    pub name: &'a str,
    /// Its faces and wedges.
    pub mesh: &'a Mesh,
    /// Its rows and rest positions, tissue space of the rig's origin.
    pub rows: &'a VertexRows,
    /// What its faces' material indices refer to.
    pub materials: &'a [Material],
}

/// How far the exported skinning is from the rows it stands for (MATHS 1.8).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExportReport {
    /// Largest distance of a vertex from where its row puts it, rounding to the file's f32 included, over sampled times of
    /// all animations, metres.
    pub deviation_m: f64,
    /// The same as a fraction of the bounding diagonal in the exported pose: the `export_deviation` of CONTRACT.
    pub deviation: f64,
    /// The same distance in the exported pose alone, metres.
    pub deviation_in_pose_m: f64,
}

/// Encodes pieces as .glb. Positions are in model space at rest, or about the tissue's origin where that is far away; for
/// embedded vertices the rest position is solved so that they are exact in `pose`.
pub fn export_glb(rig: &Rig, pieces: &[ExportPiece<'_>], pose: &Pose) -> Result<(Vec<u8>, ExportReport), FormatError> {
    let origin = file_origin(rig, pieces);
    let shift = rig.origin - origin;
    let vertices: Vec<Vec<Option<PlainVertex>>> = pieces.iter().map(|p| plain_vertices(shift, p, pose)).collect();
    let mut export = Export::new(rig, origin, &joined_skins(rig, pieces, &vertices));
    for (piece, vertices) in pieces.iter().zip(&vertices) {
        export.piece(piece, vertices)?;
    }
    let bytes = glb_writer::write(&export.scene)?;
    Ok((bytes, deviation(rig, pieces, &vertices, pose)))
}

/// What positions in the file are relative to, model space: zero, or the tissue's origin (MATHS 1.7) where model space is too
/// coarse for f32. As a file can hold it.
fn file_origin(rig: &Rig, pieces: &[ExportPiece<'_>]) -> DVec3 {
    let reach = pieces.iter().flat_map(|p| p.mesh.live_vertices().map(|v| p.rows.rest(v).length_squared()));
    let far = rig.origin.length_squared() > FAR * FAR * reach.fold(0.0, f64::max);
    if far { rig.origin.as_vec3().as_dvec3() } else { DVec3::ZERO }
}

/// Plain form of each live vertex, with the rest position as the file can hold it: f32, `shift` from tissue space. Where the nearest f32
/// is another vertex's already, whose place is another one, it is the next: a reader that welds by position would join them, and faces
/// between them would have no area.
fn plain_vertices(shift: DVec3, piece: &ExportPiece<'_>, pose: &Pose) -> Vec<Option<PlainVertex>> {
    let mut apart = RoundedApart::default();
    let mut rounded = |v: PlainVertex| PlainVertex { rest: apart.round(v.rest + shift).as_dvec3() - shift, ..v };
    let live = |v: usize| piece.mesh.vertex_is_live(VertexId::new(v));
    (0..piece.mesh.vertex_slots()).map(|v| live(v).then(|| rounded(plain(piece.rows, pose, VertexId::new(v))))).collect()
}

/// The first of the rig's skins that each is written with: those that the corners of a face have between them. Each by itself
/// would have to hold joints of the other, and a reader, who cannot know them for the same, would have them twice.
fn joined_skins(rig: &Rig, pieces: &[ExportPiece<'_>], vertices: &[Vec<Option<PlainVertex>>]) -> Vec<usize> {
    let mut first: Vec<usize> = (0..rig.skins.len()).collect();
    for (piece, vertices) in pieces.iter().zip(vertices).filter(|_| rig.skins.len() > 1) {
        for f in piece.mesh.live_faces() {
            let bones = piece.mesh.face(f).into_iter().filter_map(|v| vertices[v.index()].as_ref()).flat_map(|v| &v.bones);
            let mut skins = bones.filter(|b| b.0 != STATIC).filter_map(|b| rig.joints[b.0 as usize].skin).map(|s| s as usize);
            let Some(one) = skins.next() else { continue };
            for other in skins {
                let (a, b) = (first[one], first[other]);
                if a != b {
                    first.iter_mut().filter(|s| **s == a.max(b)).for_each(|s| *s = a.min(b));
                }
            }
        }
    }
    first
}

fn deviation(rig: &Rig, pieces: &[ExportPiece<'_>], vertices: &[Vec<Option<PlainVertex>>], pose: &Pose) -> ExportReport {
    let in_pose = largest_deviation(pieces, vertices, pose);
    let mut worst = in_pose;
    let (mut scratch, mut sampled) = (PoseScratch::default(), Pose::default());
    let differs = pieces.iter().zip(vertices).any(|(p, vertices)| changed(p, vertices).next().is_some());
    for animation in 0..if differs { rig.animations.len() } else { 0 } {
        for i in 0..=SAMPLES {
            let time = rig.animations[animation].duration_s * i as f64 / SAMPLES as f64;
            rig.pose(Some(animation), time, &mut scratch, &mut sampled);
            worst = worst.max(largest_deviation(pieces, vertices, &sampled));
        }
    }
    let points = pieces.iter().flat_map(|p| p.mesh.live_vertices().map(|v| pose.skin(p.rows, v)));
    let (min, max) = points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
    let diagonal = (max - min).length();
    let relative = if diagonal > 0.0 && diagonal.is_finite() { worst / diagonal } else { 0.0 };
    ExportReport { deviation_m: worst, deviation: relative, deviation_in_pose_m: in_pose }
}

/// Vertices that the file cannot hold as they are: embedded ones, and base vertices that rounding moves.
fn changed<'a>(
    piece: &'a ExportPiece<'_>,
    vertices: &'a [Option<PlainVertex>],
) -> impl Iterator<Item = (VertexId, &'a PlainVertex)> {
    let all = vertices.iter().enumerate().filter_map(|(v, vertex)| Some((VertexId::new(v), vertex.as_ref()?)));
    all.filter(|(v, vertex)| !piece.rows.is_base(*v) || vertex.rest != piece.rows.rest(*v))
}

fn largest_deviation(pieces: &[ExportPiece<'_>], vertices: &[Vec<Option<PlainVertex>>], pose: &Pose) -> f64 {
    let mut worst = 0.0f64;
    for (piece, vertices) in pieces.iter().zip(vertices) {
        for (v, vertex) in changed(piece, vertices) {
            let exported = match vertex.bones.is_empty() {
                true => vertex.rest,
                false => blend(pose, &vertex.bones).transform_point3(vertex.rest),
            };
            worst = worst.max((exported - pose.skin(piece.rows, v)).length());
        }
    }
    worst
}

/// The f32 numbers that a reader, who normalises, gets nearest to a unit quaternion from: the file it came from had others
/// than its own rounded ones in few cases, but with far things below it the difference shows.
fn held(q: DQuat) -> DQuat {
    let rounded = |k: i32| {
        let length = 1.0 + f64::from(k) * 2f64.powi(-27);
        DQuat::from_array((q * length).to_array().map(|x| f64::from(x as f32)))
    };
    let error = |r: &DQuat| (r.normalize() - q).length_squared();
    let tried = (0..=16).flat_map(|k| [k, -k]).map(rounded);
    tried.min_by(|a, b| error(a).total_cmp(&error(b))).unwrap_or(q)
}

struct Export<'a> {
    rig: &'a Rig,
    /// From tissue space to the file's.
    shift: DVec3,
    scene: GlbScene<'a>,
    /// Position in its skin of each joint, for each skin to be written.
    locals: Vec<BTreeMap<u32, u16>>,
    /// Skin to be written of each of the rig's.
    skins: Vec<usize>,
    /// Where nodes are in the rest pose, and which of them an animation may move.
    worlds: Vec<DAffine3>,
    moves: Vec<bool>,
    /// Which skin of the file carries rigid joints, once there is one.
    rigid_skin: Option<usize>,
    marks: usize,
}

impl<'a> Export<'a> {
    fn new(rig: &'a Rig, origin: DVec3, joined: &[usize]) -> Self {
        let mut scratch = PoseScratch::default();
        rig.pose_nodes(None, 0.0, &mut scratch);
        let mut nodes = rig.nodes.clone();
        for node in nodes.iter_mut().filter(|_| origin != DVec3::ZERO) {
            if let LocalTransform::Trs(trs) = &mut node.local {
                trs.rotation = held(trs.rotation);
            }
        }
        let mut export = Self {
            rig,
            shift: rig.origin - origin,
            scene: GlbScene { nodes, animations: &rig.animations, mesh_origin: origin, ..GlbScene::default() },
            locals: Vec::new(),
            skins: Vec::new(),
            worlds: scratch.worlds().to_vec(),
            moves: rig.moving_nodes(),
            rigid_skin: None,
            marks: 0,
        };
        for (k, skin) in rig.skins.iter().enumerate() {
            let index = match joined[k] < k {
                true => export.skins[joined[k]],
                false => export.add_skin(skin.name.clone(), skin.skeleton),
            };
            export.skins.push(index);
            for &joint in &skin.joints {
                export.local(index, joint);
            }
        }
        export
    }

    fn add_skin(&mut self, name: Option<String>, skeleton: Option<u32>) -> usize {
        self.scene.skins.push(GlbSkin { name, joints: Vec::new(), skeleton });
        self.locals.push(BTreeMap::new());
        self.locals.len() - 1
    }

    /// Position of a joint in a skin of the file; added where it is not there yet. A skin may list a node once, so a node
    /// that is seen through another inverse bind gets a child that stays with it.
    fn local(&mut self, skin: usize, joint: u32) -> u16 {
        if let Some(&local) = self.locals[skin].get(&joint) {
            return local;
        }
        if joint == STATIC
            && let Some(still) = self.still_joint(skin)
        {
            self.locals[skin].insert(STATIC, still);
            return still;
        }
        let (mut node, inverse_bind) = match joint {
            STATIC => (u32::MAX, DAffine3::IDENTITY),
            _ => (self.rig.joints[joint as usize].node, self.rig.joints[joint as usize].inverse_bind),
        };
        if joint == STATIC || self.scene.skins[skin].joints.iter().any(|j| j.0 == node) {
            let parent = (joint != STATIC).then_some(node);
            node = self.scene.nodes.len() as u32;
            self.scene.nodes.push(Node { name: None, parent, local: LocalTransform::Trs(Trs::IDENTITY) });
        }
        let origin = self.scene.mesh_origin;
        let inverse_bind = if origin == DVec3::ZERO { inverse_bind } else { inverse_bind * DAffine3::from_translation(origin) };
        let local = self.scene.skins[skin].joints.len() as u16;
        self.scene.skins[skin].joints.push((node, inverse_bind));
        self.locals[skin].insert(joint, local);
        local
    }

    /// A joint of a skin of the file that leaves vertices where they are, such as an earlier export has added.
    fn still_joint(&self, skin: usize) -> Option<u16> {
        let is_still = |joint: u32| {
            let joint = &self.rig.joints[joint as usize];
            !self.moves[joint.node as usize] && self.worlds[joint.node as usize] * joint.inverse_bind == DAffine3::IDENTITY
        };
        self.locals[skin].iter().find(|(joint, _)| **joint != STATIC && is_still(**joint)).map(|(_, local)| *local)
    }

    /// The skin of the file that a face goes to; `None` for a face that nothing moves.
    fn skin_of(&mut self, corners: [VertexId; 3], vertices: &[Option<PlainVertex>]) -> Option<usize> {
        let mut rigid = false;
        for (joint, _) in corners.iter().filter_map(|v| vertices[v.index()].as_ref()).flat_map(|v| &v.bones) {
            if *joint != STATIC {
                match self.rig.joints[*joint as usize].skin {
                    Some(skin) => return Some(self.skins[skin as usize]),
                    None => rigid = true,
                }
            }
        }
        if rigid && self.rigid_skin.is_none() {
            self.rigid_skin = Some(self.add_skin(Some("rigid parts".into()), None));
        }
        if rigid { self.rigid_skin } else { None }
    }

    fn piece(&mut self, piece: &ExportPiece<'_>, vertices: &[Option<PlainVertex>]) -> Result<(), FormatError> {
        let materials: Vec<u32> = piece.materials.iter().map(|m| self.material(m)).collect();
        let marks = self.number(vertices)?;
        let mut groups: BTreeMap<(Option<usize>, u32), Vec<FaceId>> = BTreeMap::new();
        for f in piece.mesh.live_faces() {
            let skin = self.skin_of(piece.mesh.face(f), vertices);
            let material = materials.get(piece.mesh.face_info(f).material as usize).copied();
            let material = material.unwrap_or_else(|| self.material(&Material::default()));
            groups.entry((skin, material)).or_default().push(f);
        }
        let first_mesh = self.scene.meshes.len();
        for ((skin, material), faces) in groups {
            let mut primitive = self.primitive(piece, vertices, &marks, skin, &faces);
            primitive.material = material;
            self.dress(&mut primitive);
            let skin = skin.map(|s| s as u32);
            match self.scene.meshes[first_mesh..].last_mut() {
                Some(mesh) if mesh.skin == skin => mesh.primitives.push(primitive),
                _ => self.scene.meshes.push(GlbMesh { name: piece.name.into(), skin, primitives: vec![primitive] }),
            }
        }
        Ok(())
    }

    /// Gives a primitive the tangents that its material needs; drops texture coordinates that nothing needs.
    fn dress(&self, primitive: &mut GlbPrimitive) {
        let material = &self.scene.materials[primitive.material as usize];
        if let Some(laid) = material.finish.as_ref().and_then(|finish| gltf_tangents::laid(finish)) {
            gltf_tangents::add(primitive, laid);
        }
        if !material.is_textured() && primitive.uvs.iter().all(|uv| *uv == [0.0; 2]) {
            primitive.uvs.clear();
        }
    }

    fn material(&mut self, material: &Material) -> u32 {
        let known = self.scene.materials.iter().position(|m| m == material);
        known.unwrap_or_else(|| {
            self.scene.materials.push(material.clone());
            self.scene.materials.len() - 1
        }) as u32
    }

    /// A number for each live vertex, unique in the file.
    fn number(&mut self, vertices: &[Option<PlainVertex>]) -> Result<Vec<f32>, FormatError> {
        let live = vertices.iter().flatten().count();
        if self.marks + live > MAX_MARKS {
            let count = (self.marks + live) as u64;
            return Err(FormatError::TooLarge { what: "vertices for one file", count, limit: MAX_MARKS as u64 });
        }
        let mut next = self.marks;
        self.marks += live;
        let number = |v: &Option<PlainVertex>| {
            let mark = next as f32;
            next += usize::from(v.is_some());
            mark
        };
        Ok(vertices.iter().map(number).collect())
    }

    fn primitive(
        &mut self,
        piece: &ExportPiece<'_>,
        vertices: &[Option<PlainVertex>],
        marks: &[f32],
        skin: Option<usize>,
        faces: &[FaceId],
    ) -> GlbPrimitive {
        let mut out = GlbPrimitive::default();
        let mut index_of = vec![u32::MAX; piece.mesh.wedges().len()];
        let mut bones: Vec<Vec<(u16, f32)>> = Vec::new();
        for w in faces.iter().flat_map(|&f| piece.mesh.face_wedges(f)) {
            let slot = &mut index_of[w.index()];
            if *slot == u32::MAX {
                *slot = out.positions.len() as u32;
                let wedge = piece.mesh.wedge(w);
                let vertex = vertices[wedge.vertex.index()].as_ref();
                let rest = vertex.map_or(DVec3::ZERO, |v| v.rest);
                out.positions.push((rest + self.shift).as_vec3().to_array());
                out.normals.push(wedge.normal);
                out.uvs.push(wedge.uv);
                out.colours.push(wedge.colour);
                out.marks.push(marks[wedge.vertex.index()]);
                if let Some(skin) = skin {
                    let plain = vertex.map_or(&[][..], |v| &v.bones);
                    let plain = if plain.is_empty() { &[(STATIC, 1.0)][..] } else { plain };
                    let mut row: Vec<(u16, f32)> = Vec::with_capacity(plain.len());
                    for &(joint, weight) in plain {
                        let local = self.local(skin, joint);
                        match row.iter_mut().find(|b| b.0 == local) {
                            Some(known) => known.1 += weight as f32,
                            None => row.push((local, weight as f32)),
                        }
                    }
                    bones.push(row);
                }
            }
            out.indices.push(*slot);
        }
        if out.colours.iter().all(|&c| c == WHITE) {
            out.colours.clear();
        }
        out.bones = bone_sets(&bones);
        out
    }
}

/// As many sets of four as the vertex with most bones needs.
fn bone_sets(bones: &[Vec<(u16, f32)>]) -> Vec<BoneSet> {
    let sets = bones.iter().map(|b| b.len().div_ceil(4)).max().unwrap_or(0);
    let entry = |b: &Vec<(u16, f32)>, i: usize| b.get(i).copied().unwrap_or((0, 0.0));
    (0..sets)
        .map(|set| {
            let joints = bones.iter().map(|b| std::array::from_fn(|k| entry(b, 4 * set + k).0)).collect();
            let weights = bones.iter().map(|b| std::array::from_fn(|k| entry(b, 4 * set + k).1)).collect();
            (joints, weights)
        })
        .collect()
}
