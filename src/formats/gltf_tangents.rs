//! Tangents of surfaces that go out with a map of normals, whose directions they are: as MikkTSpace has them, which glTF asks for
//! where a file brings none. They are made anew, since a cut changes the surface that they lie on.

use super::glb_writer::GlbPrimitive;
use super::gltf_extensions::{TextureInfo, TextureTransform};
use super::material::Finish;
use glam::{DVec2, DVec3};

/// Where a finish has a texture that needs tangents, the first of them.
const NEED: [&str; 3] = [
    "/normalTexture",
    "/extensions/KHR_materials_clearcoat/clearcoatNormalTexture",
    "/extensions/KHR_materials_anisotropy/anisotropyTexture",
];

/// How the texture is laid along whose u tangents go; None if there is no need of any.
pub(crate) fn laid(finish: &Finish) -> Option<TextureTransform> {
    let texture = NEED.into_iter().find_map(|place| finish.value(place)?.as_object())?;
    Some(TextureInfo(texture).transform(&mut Vec::new()).unwrap_or_default())
}

/// Adds tangents to a primitive with normals and texture coordinates. A vertex between faces that show the picture and faces that
/// show its mirror image becomes two.
pub(crate) fn add(primitive: &mut GlbPrimitive, laid: TextureTransform) {
    let faces = primitive.indices.as_chunks::<3>().0.to_vec();
    let directions: Vec<Option<Direction>> = faces.iter().map(|&face| direction(primitive, face, laid)).collect();
    let count = primitive.positions.len();
    let mut hands = vec![[false; 2]; count]; // of the faces round a vertex: plain, mirrored
    for (face, direction) in faces.iter().zip(&directions) {
        if let Some(direction) = direction {
            face.iter().for_each(|&v| hands[v as usize][usize::from(direction.mirrored)] = true);
        }
    }
    let twins: Vec<u32> = (0..count).map(|v| if hands[v] == [true; 2] { repeat(primitive, v) } else { v as u32 }).collect();
    let mut sums = vec![DVec3::ZERO; primitive.positions.len()];
    for (i, (face, direction)) in faces.iter().zip(&directions).enumerate() {
        let Some(direction) = direction else { continue };
        for k in 0..3 {
            let [v, before, after] = [face[k], face[(k + 1) % 3], face[(k + 2) % 3]];
            let at = if direction.mirrored { twins[v as usize] } else { v };
            let normal = vector(primitive.normals[v as usize]);
            let flat = |d: DVec3| (d - normal * normal.dot(d)).normalize_or_zero();
            let side = |to: u32| flat(vector(primitive.positions[to as usize]) - vector(primitive.positions[v as usize]));
            let angle = side(before).dot(side(after)).clamp(-1.0, 1.0).acos();
            sums[at as usize] += flat(direction.along_u) * angle;
            primitive.indices[3 * i + k] = at;
        }
    }
    let tangent = |(v, sum): (usize, DVec3)| {
        let normal = vector(primitive.normals[v]).try_normalize().unwrap_or(DVec3::Z);
        let along = (sum - normal * normal.dot(sum)).try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector());
        let mirrored = v >= count || hands[v] == [false, true];
        along.as_vec3().extend(if mirrored { -1.0 } else { 1.0 }).to_array()
    };
    primitive.tangents = sums.into_iter().enumerate().map(tangent).collect();
}

/// Where u of a face's texture coordinates goes.
struct Direction {
    along_u: DVec3,
    /// True if the picture is seen from behind.
    mirrored: bool,
}

/// None where a face shows nothing of the picture.
fn direction(primitive: &GlbPrimitive, face: [u32; 3], laid: TextureTransform) -> Option<Direction> {
    let place = |v: u32| vector(primitive.positions[v as usize]);
    let uv = |v: u32| DVec2::from(laid.apply(primitive.uvs[v as usize]).map(f64::from));
    let [one, two] = [face[1], face[2]].map(|v| (place(v) - place(face[0]), uv(v) - uv(face[0])));
    let area = two.1.perp_dot(one.1); // v points down: this is positive where the picture is seen from its front
    let along_u = (two.0 * one.1.y - one.0 * two.1.y) * area.signum();
    let shown = area != 0.0 && area.is_finite() && along_u.length_squared() > 0.0 && along_u.is_finite();
    shown.then_some(Direction { along_u, mirrored: area < 0.0 })
}

/// Appends a copy of a vertex and returns its number.
fn repeat(primitive: &mut GlbPrimitive, v: usize) -> u32 {
    fn again<T: Copy>(list: &mut Vec<T>, v: usize) {
        list.extend(list.get(v).copied());
    }
    again(&mut primitive.positions, v);
    again(&mut primitive.normals, v);
    again(&mut primitive.uvs, v);
    again(&mut primitive.colours, v);
    again(&mut primitive.marks, v);
    for (joints, weights) in &mut primitive.bones {
        again(joints, v);
        again(weights, v);
    }
    primitive.positions.len() as u32 - 1
}

fn vector(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture upright on the plane z = 0, and beside it its mirror image, which shares an edge with it.
    fn pair() -> GlbPrimitive {
        GlbPrimitive {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0]],
            normals: vec![[0.0, 0.0, 1.0]; 6],
            uvs: vec![[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0], [0.0, 1.0], [0.0, 0.0]],
            marks: (0u8..6).map(f32::from).collect(),
            indices: vec![0, 1, 2, 0, 2, 3, 1, 4, 5, 1, 5, 2, 0, 1, 1],
            ..GlbPrimitive::default()
        }
    }

    #[test]
    fn tangents_go_along_u_and_vertices_between_mirror_images_are_two() {
        let mut found = pair();
        add(&mut found, TextureTransform::default());
        let (plain, mirrored) = ([1.0, 0.0, 0.0, 1.0], [-1.0, 0.0, 0.0, -1.0]);
        assert_eq!(found.tangents, [plain, plain, plain, plain, mirrored, mirrored, mirrored, mirrored]);
        assert_eq!(found.indices, [0, 1, 2, 0, 2, 3, 6, 4, 5, 6, 5, 7, 0, 1, 1]);
        assert_eq!((&found.marks[6..], found.positions[7], found.uvs[7]), (&[1.0, 2.0][..], [1.0, 1.0, 0.0], [1.0, 0.0]));
        // u of a picture that is turned by a quarter, and v upwards
        let turned = serde_json::from_str(r#"{ "rotation": 1.5707963267948966 }"#).unwrap();
        let mut found = pair();
        add(&mut found, turned);
        assert!(
            (vector([found.tangents[0][0], found.tangents[0][1], 0.0]) - DVec3::NEG_Y).length() < 1e-6,
            "{:?}",
            found.tangents
        );
        let flipped = serde_json::from_str(r#"{ "scale": [1, -1] }"#).unwrap();
        let mut found = pair();
        add(&mut found, flipped);
        assert_eq!(found.tangents[0], [1.0, 0.0, 0.0, -1.0]);
    }

    #[test]
    fn surfaces_without_a_picture_have_some_tangents() {
        let mut none = pair();
        none.uvs.fill([0.0; 2]);
        add(&mut none, TextureTransform::default());
        for [x, y, z, hand] in none.tangents {
            assert!((x.hypot(y) - 1.0).abs() < 1e-6 && z == 0.0 && hand == 1.0);
        }
    }
}
