//! A bar of 0.6 x 0.12 x 0.12 m along x that bends at two joints: the test bench for skinned tearing.

use super::{four_bones, smoothstep};
use crate::formats::glb_writer::{GlbMesh, GlbPrimitive, GlbScene, GlbSkin};
use crate::formats::material::Material;
use crate::rig::animation::{Animation, Channel, Interpolation, Keys, Property};
use crate::rig::skeleton::{LocalTransform, Node, Trs};
use glam::{DAffine3, DVec3, IVec3};
use std::f64::consts::TAU;

const SIZE: DVec3 = DVec3::new(0.6, 0.12, 0.12);
/// Where the joints are along x, metres; the first is the root.
const JOINTS: [f64; 3] = [-0.3, -0.1, 0.1];
/// Half of the length over which a joint's influence fades, metres.
const BLEND: f64 = 0.07;
/// Largest angle of each joint, radians.
const SWING: f64 = 0.7;
const DURATION_S: f64 = 2.0;
const KEYS: usize = 32;

pub(super) fn scene(faces: Option<usize>) -> GlbScene<'static> {
    let primitive = surface(divisions(faces.unwrap_or(2816)));
    let joints = JOINTS.iter().enumerate().map(|(i, &x)| (i as u32, DAffine3::from_translation(DVec3::X * -x))).collect();
    GlbScene {
        nodes: nodes(),
        animations: animations(),
        skins: vec![GlbSkin { name: Some("beam".into()), joints, skeleton: Some(0) }],
        meshes: vec![GlbMesh { name: "beam".into(), skin: Some(0), primitives: vec![primitive] }],
        materials: vec![Material { name: "gel".into(), base_colour: [0.85, 0.55, 0.45, 1.0], ..Material::default() }],
        ..GlbScene::default()
    }
}

/// Quads along x, y and z: about square, with 8 (nx m) + 4 m^2 faces near to the wish.
fn divisions(faces: usize) -> IVec3 {
    let m = ((faces as f64 / 44.0).sqrt().round() as usize).max(1);
    let nx = (faces.saturating_sub(4 * m * m) as f64 / (8 * m) as f64).round().max(1.0);
    IVec3::new(nx as i32, m as i32, m as i32)
}

fn nodes() -> Vec<Node> {
    let names = ["root", "joint-1", "joint-2"];
    (0..3)
        .map(|i| {
            let from = if i == 0 { 0.0 } else { JOINTS[i - 1] };
            let translation = DVec3::X * (JOINTS[i] - from);
            Node {
                name: Some(names[i].into()),
                parent: i.checked_sub(1).map(|p| p as u32),
                local: LocalTransform::Trs(Trs { translation, ..Trs::IDENTITY }),
            }
        })
        .collect()
}

fn animations() -> &'static [Animation] {
    static BEND: std::sync::LazyLock<Vec<Animation>> = std::sync::LazyLock::new(|| {
        let at = |k: usize| k as f64 / KEYS as f64;
        let turn = |k: usize| {
            let half = 0.5 * SWING * (TAU * at(k % KEYS)).sin();
            [0.0, 0.0, half.sin(), half.cos()]
        };
        let channel = |node| Channel {
            node,
            property: Property::Rotation,
            keys: Keys {
                interpolation: Interpolation::Linear,
                times: (0..=KEYS).map(|k| (DURATION_S * at(k)) as f32).collect(),
                values: (0..=KEYS).map(turn).collect(),
            },
        };
        vec![Animation { name: "bend".into(), duration_s: DURATION_S, channels: vec![channel(1), channel(2)] }]
    });
    &BEND
}

/// Six sides with their own vertices, so that edges are sharp; the texture has a band for each long side and one for both
/// ends.
fn surface(n: IVec3) -> GlbPrimitive {
    let mut out = GlbPrimitive { bones: vec![(Vec::new(), Vec::new())], ..GlbPrimitive::default() };
    let mut band = 0;
    for axis in [1, 2, 0] {
        for sign in [1, -1] {
            side(&mut out, n, axis, sign, band);
            band += 1;
        }
    }
    out
}

fn side(out: &mut GlbPrimitive, n: IVec3, axis: usize, sign: i32, band: usize) {
    // u runs along x on the long sides; (u, v, normal) is right-handed for a positive sign.
    let (u, v) = [(1, 2), (2, 0), (0, 1)][axis];
    let (u, v) = if sign > 0 { (u, v) } else { (v, u) };
    let start = out.positions.len() as u32;
    let normal = DVec3::from_array(std::array::from_fn(|i| if i == axis { f64::from(sign) } else { 0.0 }));
    for j in 0..=n[v] {
        for i in 0..=n[u] {
            let mut lattice = IVec3::ZERO;
            lattice[axis] = if sign > 0 { n[axis] } else { 0 };
            (lattice[u], lattice[v]) = (i, j);
            let p = (lattice.as_dvec3() / n.as_dvec3() - 0.5) * SIZE;
            out.positions.push(p.as_vec3().to_array());
            out.normals.push(normal.as_vec3().to_array());
            out.uvs.push(texture_place(lattice.as_dvec3() / n.as_dvec3(), axis, band).map(|x| x as f32));
            let (joints, weights) = bones(p.x);
            out.bones[0].0.push(joints);
            out.bones[0].1.push(weights);
        }
    }
    let at = |i: i32, j: i32| start + (j * (n[u] + 1) + i) as u32;
    for j in 0..n[v] {
        for i in 0..n[u] {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            let quad = if (i + j) % 2 == 0 { [a, b, c, a, c, d] } else { [a, b, d, b, c, d] };
            out.indices.extend(quad);
        }
    }
}

/// Bands of a fifth of the texture: four long sides, then both ends side by side.
fn texture_place(at: DVec3, axis: usize, band: usize) -> [f64; 2] {
    match axis {
        0 => [(at.y + (band - 4) as f64) * 0.2, (4.0 + at.z) * 0.2],
        1 => [at.x, (band as f64 + at.z) * 0.2],
        _ => [at.x, (band as f64 + at.y) * 0.2],
    }
}

fn bones(x: f64) -> ([u16; 4], [f32; 4]) {
    let past = |joint: usize| smoothstep(JOINTS[joint] - BLEND, JOINTS[joint] + BLEND, x);
    let (first, second) = (past(1), past(2));
    four_bones(&[1.0 - first, first - second, second])
}
