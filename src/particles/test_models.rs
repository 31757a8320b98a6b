//! Small generated models for the tests of the soft layer.

use crate::geometry::{Mesh, VertexId, Wedge, WedgeId};
use glam::DVec3;

/// A mesh and its rest positions.
pub type Model = (Mesh, Vec<DVec3>);

/// Uniform in [0, 1) from a counter.
pub fn noise(seed: u64) -> f64 {
    (crate::particles::random::mix(seed) >> 11) as f64 / (1u64 << 53) as f64
}

/// From positions and faces, with a wedge a vertex.
pub fn build(rest: Vec<DVec3>, faces: Vec<[u32; 3]>) -> Model {
    let wedges = (0..rest.len())
        .map(|v| Wedge {
            vertex: VertexId::new(v),
            group: WedgeId::new(v),
            uv: [0.0; 2],
            normal: [0.0, 0.0, 1.0],
            colour: u32::MAX,
        })
        .collect();
    let corners = faces.iter().map(|f| f.map(VertexId)).collect();
    let face_wedges = faces.iter().map(|f| f.map(WedgeId)).collect();
    (Mesh::build(rest.len(), corners, face_wedges, &vec![0; faces.len()], wedges), rest)
}

/// Faces of an `n` x `n` grid of quads whose vertices start at `first`, row by row.
fn grid_faces(n: usize, first: usize) -> Vec<[u32; 3]> {
    let mut faces = Vec::new();
    let at = |x: usize, y: usize| (first + y * (n + 1) + x) as u32;
    for y in 0..n {
        for x in 0..n {
            faces.push([at(x, y), at(x + 1, y), at(x + 1, y + 1)]);
            faces.push([at(x, y), at(x + 1, y + 1), at(x, y + 1)]);
        }
    }
    faces
}

/// The unit square in z = 0, `n` quads a side, vertices moved by up to `jitter` / 2 of an edge.
pub fn grid(n: usize, jitter: f64, seed: u64) -> Model {
    let mut rest = Vec::new();
    for y in 0..=n {
        for x in 0..=n {
            let i = seed.wrapping_mul(1 << 40).wrapping_add(2 * rest.len() as u64);
            let (dx, dy) = (noise(i) - 0.5, noise(i + 1) - 0.5);
            rest.push(DVec3::new(x as f64 + jitter * dx, y as f64 + jitter * dy, 0.0) / n as f64);
        }
    }
    build(rest, grid_faces(n, 0))
}

/// Two unit squares, `gap` apart, not connected.
pub fn two_sheets(n: usize, gap: f64) -> Model {
    let (_, low) = grid(n, 0.3, 1);
    let (_, high) = grid(n, 0.3, 2);
    let mut faces = grid_faces(n, 0);
    faces.extend(grid_faces(n, low.len()));
    build(low.into_iter().chain(high.into_iter().map(|p| p + DVec3::Z * gap)).collect(), faces)
}

/// A sheet of length 2 folded over at x = 1 into two leaves `gap` apart, with a round edge between them.
pub fn fold(n: usize, gap: f64) -> Model {
    let (mesh, rest) = grid(n, 0.3, 3);
    let radius = gap / 2.0;
    let bend = radius * std::f64::consts::PI;
    let rest = rest
        .into_iter()
        .map(|p| {
            let s = 2.0 * p.x - (1.0 - bend / 2.0);
            if s < 0.0 {
                DVec3::new(s, p.y, 0.0)
            } else if s < bend {
                let angle = s / radius;
                DVec3::new(radius * angle.sin(), p.y, radius * (1.0 - angle.cos()))
            } else {
                DVec3::new(bend - s, p.y, gap)
            }
        })
        .collect();
    (mesh, rest)
}

/// The unit square with every vertex lifted at random by up to `height`: folds at the scale of the edges, where paths near
/// one end of a pair and near the other differ.
pub fn spikes(n: usize, height: f64) -> Model {
    let (mesh, rest) = grid(n, 0.5, 9);
    let lift = |i: usize| DVec3::Z * (height * noise(77 + i as u64));
    (mesh, rest.into_iter().enumerate().map(|(i, p)| p + lift(i)).collect())
}

/// The unit sphere: an octahedron, each face split into `n` x `n`.
pub fn sphere(n: usize) -> Model {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];
    let octants = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]];
    let mut keys: Vec<[i64; 3]> = Vec::new();
    let mut corners = Vec::new();
    for [a, b, c] in octants {
        let at = |i: usize, j: usize| axes[a] * (n - i - j) as f64 + axes[b] * i as f64 + axes[c] * j as f64;
        for i in 0..n {
            for j in 0..n - i {
                corners.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
                if i + j + 1 < n {
                    corners.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
    }
    let key = |p: DVec3| [p.x as i64, p.y as i64, p.z as i64];
    keys.extend(corners.iter().flatten().map(|&p| key(p)));
    keys.sort_unstable();
    keys.dedup();
    let faces = corners.iter().map(|t| t.map(|p| keys.binary_search(&key(p)).unwrap() as u32)).collect();
    let rest = keys.iter().map(|k| DVec3::new(k[0] as f64, k[1] as f64, k[2] as f64).normalize()).collect();
    build(rest, faces)
}

/// Mean edge length.
pub fn mean_edge(mesh: &Mesh, rest: &[DVec3]) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for f in mesh.live_faces() {
        let [a, b, c] = mesh.face(f).map(|v| rest[v.index()]);
        sum += a.distance(b) + b.distance(c) + c.distance(a);
        count += 3;
    }
    sum / count.max(1) as f64
}
