//! Volumes by an independent boolean (a port of manifold, f64), to compare closed tears with.

use boolmesh::prelude::{Manifold, OpType, compute_boolean};
use glam::DVec3;

/// Volume of a solid given as positions and triangles.
pub fn volume(positions: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    let six = triangles.iter().map(|t| {
        let [a, b, c] = t.map(|i| positions[i as usize]);
        a.dot(b.cross(c))
    });
    six.sum::<f64>() / 6.0
}

fn manifold(positions: &[DVec3], triangles: &[[u32; 3]]) -> Result<Manifold, String> {
    let flat: Vec<f64> = positions.iter().flat_map(|p| p.to_array()).collect();
    let index: Vec<usize> = triangles.iter().flatten().map(|&i| i as usize).collect();
    Manifold::new(&flat, &index)
}

fn manifold_volume(m: &Manifold) -> f64 {
    let six = m.hs.chunks(3).map(|t| {
        let [a, b, c] = [&t[0], &t[1], &t[2]].map(|h| DVec3::from_array(m.ps[h.tail].to_array()));
        a.dot(b.cross(c))
    });
    six.sum::<f64>() / 6.0
}

/// Volume of `solid` less the union of convex bodies, each given by its corners and outward triangles. Found in two ways, body
/// by body and with their union; an error where the two disagree, since then the reference cannot be trusted.
pub fn volume_of_difference(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    bodies: &[(Vec<DVec3>, Vec<[u32; 3]>)],
) -> Result<f64, String> {
    let solid = manifold(positions, triangles)?;
    let mut rest = solid.clone();
    let mut union = None;
    for (corners, faces) in bodies {
        let body = manifold(corners, faces)?;
        rest = compute_boolean(&rest, &body, OpType::Subtract)?;
        union = Some(match union {
            Some(union) => compute_boolean(&union, &body, OpType::Add)?,
            None => body,
        });
    }
    let Some(union) = union else { return Ok(manifold_volume(&rest)) };
    let [one, other] = [manifold_volume(&rest), manifold_volume(&compute_boolean(&solid, &union, OpType::Subtract)?)];
    if (one - other).abs() > 1e-7 * manifold_volume(&solid) {
        return Err(format!("the reference finds {one} and {other}"));
    }
    Ok(one)
}
