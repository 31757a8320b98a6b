//! A heart: an organic closed surface around a closed cavity whose faces point inward, so that a cross-section has a hole.
//! About 0.12 m tall, seven joints, an animation `beat`. Both surfaces are star-shaped about the origin, the inner one
//! inside the outer in every direction, so neither can cross itself or the other.

use super::cube_sphere::{CubeSphere, build, face_count};
use super::four_bones;
use crate::formats::glb_writer::{GlbMesh, GlbPrimitive, GlbScene, GlbSkin};
use crate::formats::material::Material;
use crate::rig::animation::{Animation, Channel, Interpolation, Keys, Property, key3};
use crate::rig::skeleton::{LocalTransform, Node, Trs};
use glam::{DAffine3, DVec3};

const HEIGHT: f64 = 0.12;
const DURATION_S: f64 = 0.9;
/// How far a joint's influence reaches (standard deviation), metres.
const REACH: f64 = 0.024;
/// Joints and where they are, metres; the first is the root of the others.
const JOINTS: [(&str, DVec3); 7] = [
    ("heart", DVec3::new(0.0, 0.012, 0.0)),
    ("left-ventricle", DVec3::new(-0.020, -0.014, 0.006)),
    ("right-ventricle", DVec3::new(0.020, -0.008, 0.008)),
    ("apex", DVec3::new(-0.012, -0.050, 0.010)),
    ("left-atrium", DVec3::new(-0.022, 0.030, -0.008)),
    ("right-atrium", DVec3::new(0.024, 0.028, -0.002)),
    ("aorta", DVec3::new(0.002, 0.050, -0.004)),
];

pub(super) fn scene(faces: Option<usize>) -> GlbScene<'static> {
    let (outer, inner) = edges_for(faces.unwrap_or(18_000));
    let scale = scale();
    let mut primitive = GlbPrimitive { bones: vec![(Vec::new(), Vec::new())], ..GlbPrimitive::default() };
    add_surface(&mut primitive, &build(outer), false, &|d| d * (outer_radius(d) * scale));
    add_surface(&mut primitive, &build(inner), true, &|d| d * (inner_radius(d) * scale));
    let joints = (0..).zip(JOINTS).map(|(i, (_, at))| (i, DAffine3::from_translation(-at))).collect();
    GlbScene {
        nodes: nodes(),
        animations: animations(),
        skins: vec![GlbSkin { name: Some("heart".into()), joints, skeleton: Some(0) }],
        meshes: vec![GlbMesh { name: "heart".into(), skin: Some(0), primitives: vec![primitive] }],
        materials: vec![Material { name: "muscle".into(), base_colour: [0.62, 0.13, 0.11, 1.0], ..Material::default() }],
        ..GlbScene::default()
    }
}

/// Quads an edge of the outer and the inner surface: edges of about the same length on both.
fn edges_for(faces: usize) -> (usize, usize) {
    let total = |(outer, inner): (usize, usize)| face_count(outer) + face_count(inner);
    let around = ((faces as f64 / 12.0 / 1.45).sqrt() / 2.0).round() as usize;
    let candidates = (around.saturating_sub(2).max(1)..=around + 2).flat_map(|o| {
        let inner = (o as f64 * 0.67).round().max(1.0) as usize;
        [(2 * o, 2 * inner), (2 * o, 2 * (inner + 1)), (2 * o, 2 * inner.saturating_sub(1).max(1))]
    });
    candidates.min_by_key(|&c| total(c).abs_diff(faces)).unwrap_or((2, 2))
}

/// A bump on the unit sphere around `towards`, `sharpness` large for a narrow one.
fn bump(d: DVec3, towards: DVec3, sharpness: f64) -> f64 {
    (sharpness * (d.dot(towards.normalize()) - 1.0)).exp()
}

/// The groove between the ventricles: a band around the great circle across `across`, on the lower side.
fn groove(d: DVec3) -> f64 {
    let off = d.dot(DVec3::new(0.94, 0.1, -0.32).normalize()) / 0.16;
    (-off * off).exp() * (0.5 - 0.5 * d.y).clamp(0.0, 1.0)
}

fn outer_radius(d: DVec3) -> f64 {
    let ellipsoid = 1.0 / (d.x * d.x / 0.92 + d.y * d.y + d.z * d.z / 0.66).sqrt();
    ellipsoid
        + 0.34 * bump(d, DVec3::new(-0.24, -0.95, 0.18), 7.0)
        + 0.16 * bump(d, DVec3::new(-0.62, 0.68, -0.30), 9.0)
        + 0.18 * bump(d, DVec3::new(0.70, 0.62, 0.02), 9.0)
        + 0.42 * bump(d, DVec3::new(0.04, 0.99, -0.08), 22.0)
        - 0.09 * groove(d)
}

/// Well inside: at most 0.7 of the outer radius, with a deeper groove between its two chambers.
fn inner_radius(d: DVec3) -> f64 {
    let smooth = 0.52 / (d.x * d.x / 0.92 + d.y * d.y + d.z * d.z / 0.66).sqrt();
    smooth + 0.10 * bump(d, DVec3::new(-0.24, -0.95, 0.18), 5.0) - 0.10 * groove(d)
}

/// Brings the outer surface to its height; found on a fixed grid so that it does not depend on the face count's own.
fn scale() -> f64 {
    let mut range = (f64::INFINITY, f64::NEG_INFINITY);
    for d in build(64).directions {
        let y = d.normalize().y * outer_radius(d.normalize());
        range = (range.0.min(y), range.1.max(y));
    }
    HEIGHT / (range.1 - range.0)
}

fn add_surface(out: &mut GlbPrimitive, sphere: &CubeSphere, inward: bool, place: &dyn Fn(DVec3) -> DVec3) {
    let positions: Vec<DVec3> = sphere.directions.iter().map(|d| place(d.normalize())).collect();
    let mut normals = vec![DVec3::ZERO; sphere.vertices];
    let start = out.positions.len() as u32;
    for face in &sphere.faces {
        let face = if inward { [face[0], face[2], face[1]] } else { *face };
        let [a, b, c] = face.map(|v| positions[v as usize]);
        for v in face {
            normals[sphere.vertex[v as usize] as usize] += (b - a).cross(c - a);
        }
        out.indices.extend(face.map(|v| v + start));
    }
    for (i, p) in positions.iter().enumerate() {
        let [u, v] = sphere.uvs[i];
        let v = if inward { 0.6 + 0.4 * v } else { 0.6 * v }; // the cavity has its own part of the texture
        out.positions.push(p.as_vec3().to_array());
        out.normals.push(normals[sphere.vertex[i] as usize].normalize_or(DVec3::Y).as_vec3().to_array());
        out.uvs.push([u as f32, v as f32]);
        let weights = JOINTS.map(|(_, at)| (-p.distance_squared(at) / (2.0 * REACH * REACH)).exp());
        let (joints, weights) = four_bones(&weights);
        out.bones[0].0.push(joints);
        out.bones[0].1.push(weights);
    }
}

fn nodes() -> Vec<Node> {
    let node = |(i, (name, at)): (usize, (&str, DVec3))| Node {
        name: Some(name.into()),
        parent: (i > 0).then_some(0),
        local: LocalTransform::Trs(Trs { translation: if i > 0 { at - JOINTS[0].1 } else { at }, ..Trs::IDENTITY }),
    };
    JOINTS.into_iter().enumerate().map(node).collect()
}

fn animations() -> &'static [Animation] {
    static BEAT: std::sync::LazyLock<Vec<Animation>> = std::sync::LazyLock::new(|| {
        const TIMES: [f64; 6] = [0.0, 0.12, 0.22, 0.38, 0.6, DURATION_S];
        let ventricle = |depth: f64| {
            [0.0, -0.15, 0.0, 1.0, 0.1, 0.0].map(|t| DVec3::new(1.0 - depth * t, 1.0 - 0.5 * depth * t, 1.0 - depth * t))
        };
        let atrium = |depth: f64| [0.0, 1.0, 0.3, -0.15, 0.0, 0.0].map(|t| DVec3::splat(1.0 - depth * t));
        let shift = |joint: usize, by: DVec3| [0.0, 0.1, 0.0, 1.0, 0.2, 0.0].map(|t| JOINTS[joint].1 - JOINTS[0].1 + by * t);
        let spline = |node, property, values: [DVec3; 6]| Channel {
            node,
            property,
            keys: Keys {
                interpolation: Interpolation::CubicSpline,
                times: TIMES.iter().map(|&t| t as f32).collect(),
                values: values.iter().flat_map(|&v| [key3(DVec3::ZERO), key3(v), key3(DVec3::ZERO)]).collect(),
            },
        };
        let channels = vec![
            spline(1, Property::Scale, ventricle(0.17)),
            spline(2, Property::Scale, ventricle(0.14)),
            spline(3, Property::Scale, ventricle(0.10)),
            spline(3, Property::Translation, shift(3, DVec3::new(0.002, 0.006, 0.001))),
            spline(4, Property::Scale, atrium(0.13)),
            spline(5, Property::Scale, atrium(0.13)),
            spline(6, Property::Scale, ventricle(-0.06)),
            spline(6, Property::Translation, shift(6, DVec3::new(0.0, -0.003, 0.0))),
        ];
        vec![Animation { name: "beat".into(), duration_s: DURATION_S, channels }]
    });
    &BEAT
}
