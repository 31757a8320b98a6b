//! Nodes, skins and animations of a glTF file.

use super::FormatError;
use super::gltf_data::Document;
use super::gltf_skins::{self, Listed, SkinUse};
use crate::rig::{Animation, Channel, Interpolation, Keys, LocalTransform, Node, PoseScratch, Property, Rig, Trs};
use glam::{DAffine3, DMat3, DVec3, DVec4};
use gltf::json;
use json::validation::Checked;

/// A rig with the way from the file's numbers to its own.
#[derive(Debug, Default)]
pub(crate) struct ImportedRig {
    pub rig: Rig,
    /// What the file's skins are in the rig.
    pub skins: Vec<SkinUse>,
    /// Rig node of each node of the file, `u32::MAX` where it is not part of the model.
    pub node_of: Vec<u32>,
    /// File node of each rig node.
    pub file_node: Vec<u32>,
    /// Rig nodes up to here are in the chosen scene; later ones are joints outside of it.
    pub scene_nodes: usize,
    /// For each rig node: true if it or an ancestor is animated.
    pub moves: Vec<bool>,
    /// World transforms of the rig's nodes as stored.
    pub worlds: Vec<DAffine3>,
}

/// Reads the chosen scene's nodes, all skins and all animations.
pub(crate) fn read(document: &Document, warnings: &mut Vec<String>) -> Result<ImportedRig, FormatError> {
    let root = &document.root;
    let parents = parents(root)?;
    let mut out = ImportedRig { node_of: vec![u32::MAX; root.nodes.len()], ..ImportedRig::default() };
    for node in scene_roots(root, &parents)? {
        add_tree(root, node, &mut out)?;
    }
    out.scene_nodes = out.rig.nodes.len();
    for skin in &root.skins {
        for joint in &skin.joints {
            let top = top_of(joint.value(), &parents)?;
            add_tree(root, top, &mut out)?;
        }
    }
    out.file_node.iter().for_each(|&node| warn_of_transform(&root.nodes[node as usize], warnings));
    let skins = root.skins.iter().enumerate().map(|(index, skin)| listed(document, index, skin, &out.node_of));
    let skins = skins.collect::<Result<Vec<_>, _>>()?;
    out.skins = gltf_skins::add(&mut out.rig, &skins);
    let mut still = Vec::new();
    for (index, animation) in root.animations.iter().enumerate() {
        let animation = read_animation(document, index, animation, &out.node_of, warnings)?;
        if animation.channels.is_empty() { still.push(animation.name) } else { out.rig.animations.push(animation) }
    }
    if !still.is_empty() {
        warnings.push(format!("animations are left out of which nothing that they move is read: {}", still.join(", ")));
    }
    out.moves = out.rig.moving_nodes();
    let mut scratch = PoseScratch::default();
    out.rig.pose_nodes(None, 0.0, &mut scratch);
    out.worlds = scratch.worlds().to_vec();
    Ok(out)
}

fn parents(root: &json::Root) -> Result<Vec<u32>, FormatError> {
    let mut parents = vec![u32::MAX; root.nodes.len()];
    for (index, node) in root.nodes.iter().enumerate() {
        for child in node.children.iter().flatten().map(|c| c.value()) {
            let what = || format!("node {index}");
            let slot =
                parents.get_mut(child).ok_or_else(|| FormatError::range(what(), "node", child as u64, root.nodes.len()))?;
            if *slot != u32::MAX {
                return Err(FormatError::NodeCycle { node: child });
            }
            *slot = index as u32;
        }
    }
    Ok(parents)
}

fn scene_roots(root: &json::Root, parents: &[u32]) -> Result<Vec<usize>, FormatError> {
    let scene = root.scene.map_or(0, |s| s.value());
    match root.scenes.get(scene) {
        Some(scene) => Ok(scene.nodes.iter().map(|n| n.value()).collect()),
        None if root.scene.is_some() => Err(FormatError::range("the file", "scene", scene as u64, root.scenes.len())),
        None => Ok((0..root.nodes.len()).filter(|&n| parents[n] == u32::MAX).collect()),
    }
}

fn top_of(node: usize, parents: &[u32]) -> Result<usize, FormatError> {
    let mut at = node;
    for _ in 0..=parents.len() {
        match parents.get(at) {
            None => return Err(FormatError::range("a skin", "node", at as u64, parents.len())),
            Some(&u32::MAX) => return Ok(at),
            Some(&parent) => at = parent as usize,
        }
    }
    Err(FormatError::NodeCycle { node })
}

/// Adds a node and all below it, parents first; trees that are there already are left alone.
fn add_tree(root: &json::Root, top: usize, out: &mut ImportedRig) -> Result<(), FormatError> {
    let known = out.node_of.get(top).is_some_and(|&n| n != u32::MAX);
    if known {
        return Ok(());
    }
    let mut stack = vec![(top, None)];
    while let Some((index, parent)) = stack.pop() {
        let node =
            root.nodes.get(index).ok_or_else(|| FormatError::range("the scene", "node", index as u64, root.nodes.len()))?;
        if out.node_of[index] != u32::MAX {
            return Err(FormatError::NodeCycle { node: index });
        }
        let id = out.rig.nodes.len() as u32;
        out.node_of[index] = id;
        out.file_node.push(index as u32);
        let local = local_transform(node);
        if !local.affine().is_finite() {
            return Err(FormatError::NotFinite { what: format!("the transform of node {index}") });
        }
        out.rig.nodes.push(Node { name: node.name.clone(), parent, local });
        stack.extend(node.children.iter().flatten().rev().map(|c| (c.value(), Some(id))));
    }
    Ok(())
}

/// What a node asks for that no affine transform gives.
fn warn_of_transform(node: &json::Node, warnings: &mut Vec<String>) {
    let is_affine = |m: [f32; 16]| [3, 7, 11, 15].map(|k| m[k]) == [0.0, 0.0, 0.0, 1.0];
    if node.matrix.is_some_and(|m| !is_affine(m)) {
        warn_once(warnings, "the last row of a node's matrix is not 0 0 0 1, and taken as that");
    }
    if node.rotation.is_some_and(|q| q.0 == [0.0; 4]) {
        warn_once(warnings, "a node's rotation is a quaternion of zeros, and taken as none");
    }
}

fn local_transform(node: &json::Node) -> LocalTransform {
    if let Some(m) = node.matrix {
        return LocalTransform::Matrix(affine(&m));
    }
    let vector = |v: Option<[f32; 3]>, default| v.map_or(default, |v| DVec3::from_array(v.map(f64::from)));
    let [x, y, z, w] = node.rotation.unwrap_or_default().0.map(f64::from);
    LocalTransform::Trs(Trs {
        translation: vector(node.translation, DVec3::ZERO),
        rotation: crate::rig::animation::quaternion(DVec4::new(x, y, z, w)),
        scale: vector(node.scale, DVec3::ONE),
    })
}

/// A column-major 4 x 4 matrix whose last row is 0 0 0 1.
fn affine(m: &[f32; 16]) -> DAffine3 {
    let column = |c: usize| DVec3::new(m[4 * c].into(), m[4 * c + 1].into(), m[4 * c + 2].into());
    DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
}

fn listed(document: &Document, index: usize, skin: &json::Skin, node_of: &[u32]) -> Result<Listed, FormatError> {
    if skin.joints.is_empty() {
        return Err(FormatError::gltf(format!("skin {index} has no joints")));
    }
    let inverse_binds: Vec<[f32; 16]> = match skin.inverse_bind_matrices {
        Some(accessor) => document.floats(accessor.value())?,
        None => vec![json_identity(); skin.joints.len()],
    };
    if inverse_binds.len() < skin.joints.len() {
        let detail = format!("skin {index} has {} joints but {} inverse bind matrices", skin.joints.len(), inverse_binds.len());
        return Err(FormatError::gltf(detail));
    }
    let mut joints = Vec::with_capacity(skin.joints.len());
    for (k, (node, m)) in skin.joints.iter().zip(&inverse_binds).enumerate() {
        let inverse_bind = affine(m);
        if !inverse_bind.is_finite() {
            return Err(FormatError::NotFinite { what: format!("inverse bind matrix {k} of skin {index}") });
        }
        joints.push((node_of[node.value()], inverse_bind));
    }
    let skeleton = skin.skeleton.and_then(|n| node_of.get(n.value())).copied().filter(|&n| n != u32::MAX);
    Ok(Listed { name: skin.name.clone(), joints, skeleton })
}

fn json_identity() -> [f32; 16] {
    std::array::from_fn(|i| if i % 5 == 0 { 1.0 } else { 0.0 })
}

fn read_animation(
    document: &Document,
    index: usize,
    animation: &json::Animation,
    node_of: &[u32],
    warnings: &mut Vec<String>,
) -> Result<Animation, FormatError> {
    let name = animation.name.clone().unwrap_or_else(|| format!("animation-{index}"));
    let mut out = Animation { name, duration_s: 0.0, channels: Vec::new() };
    for channel in &animation.channels {
        let target = channel.target.node.value();
        let node = *node_of
            .get(target)
            .ok_or_else(|| FormatError::range(format!("animation {index}"), "node", target as u64, node_of.len()))?;
        let Checked::Valid(path) = channel.target.path else {
            return Err(FormatError::gltf(format!("animation {index} changes an unknown property")));
        };
        let property = match path {
            json::animation::Property::Translation => Property::Translation,
            json::animation::Property::Rotation => Property::Rotation,
            json::animation::Property::Scale => Property::Scale,
            json::animation::Property::MorphTargetWeights => {
                warn_once(warnings, "morph targets are left out");
                continue;
            }
        };
        let sampler = channel.sampler.value();
        let sampler = animation.samplers.get(sampler).ok_or_else(|| {
            FormatError::range(format!("animation {index}"), "sampler", sampler as u64, animation.samplers.len())
        })?;
        let keys = read_keys(document, index, sampler, property)?;
        if keys.times.is_empty() || node == u32::MAX {
            continue; // nothing to play, or a node of another scene
        }
        out.duration_s = keys.times.iter().fold(out.duration_s, |d, &t| d.max(t.into()));
        out.channels.push(Channel { node, property, keys });
    }
    Ok(out)
}

fn read_keys(
    document: &Document,
    animation: usize,
    sampler: &json::animation::Sampler,
    property: Property,
) -> Result<Keys, FormatError> {
    let times = document.floats::<1>(sampler.input.value())?.concat();
    let wide = |v: [f32; 3]| [v[0].into(), v[1].into(), v[2].into(), 0.0];
    let output = sampler.output.value();
    let values: Vec<[f64; 4]> = match property {
        Property::Rotation => document.floats::<4>(output)?.into_iter().map(|v| v.map(f64::from)).collect(),
        _ => document.floats::<3>(output)?.into_iter().map(wide).collect(),
    };
    let interpolation = match sampler.interpolation {
        Checked::Valid(json::animation::Interpolation::Step) => Interpolation::Step,
        Checked::Valid(json::animation::Interpolation::Linear) => Interpolation::Linear,
        Checked::Valid(json::animation::Interpolation::CubicSpline) => Interpolation::CubicSpline,
        Checked::Invalid => return Err(FormatError::gltf(format!("animation {animation} has an unknown interpolation"))),
    };
    if times.iter().any(|t| !t.is_finite()) || values.iter().flatten().any(|v| !v.is_finite()) {
        return Err(FormatError::NotFinite { what: format!("a key of animation {animation}") });
    }
    let keys = Keys { interpolation, times, values };
    if !keys.times.is_empty() && !keys.are_valid() {
        let detail = format!("the times of animation {animation} decrease or do not match its values");
        return Err(FormatError::gltf(detail));
    }
    Ok(keys)
}

/// Leaves out the leaves that only held a mesh: their meshes are in the model now, and a file that goes out gets mesh nodes
/// of its own. `holds_mesh` by rig node.
pub(crate) fn drop_mesh_leaves(rig: &mut Rig, holds_mesh: &[bool]) {
    let mut needed: Vec<bool> = holds_mesh.iter().map(|m| !m).collect();
    for node in &rig.nodes {
        if let Some(parent) = node.parent {
            needed[parent as usize] = true;
        }
    }
    let channels = rig.animations.iter().flat_map(|a| &a.channels).map(|c| c.node);
    let skeletons = rig.skins.iter().filter_map(|s| s.skeleton);
    for node in rig.joints.iter().map(|j| j.node).chain(channels).chain(skeletons) {
        needed[node as usize] = true;
    }
    let mut next = 0;
    let number: Vec<u32> = needed
        .iter()
        .map(|&n| {
            next += u32::from(n);
            next.wrapping_sub(1)
        })
        .collect();
    let mut keep = needed.iter();
    rig.nodes.retain(|_| keep.next() == Some(&true));
    let parents = rig.nodes.iter_mut().filter_map(|n| n.parent.as_mut());
    let joints = rig.joints.iter_mut().map(|j| &mut j.node);
    let skeletons = rig.skins.iter_mut().filter_map(|s| s.skeleton.as_mut());
    let channels = rig.animations.iter_mut().flat_map(|a| &mut a.channels).map(|c| &mut c.node);
    for node in parents.chain(joints).chain(skeletons).chain(channels) {
        *node = number[*node as usize];
    }
}

pub(crate) fn warn_once(warnings: &mut Vec<String>, text: &str) {
    if !warnings.iter().any(|w| w == text) {
        warnings.push(text.into());
    }
}
