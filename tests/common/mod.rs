//! Small meshes and measures for the laws.
#![allow(dead_code, missing_docs)]

pub mod bodies;
pub mod models;
pub mod reference;
pub mod strokes;

use glam::DVec3;
use incise::geometry::{FaceId, HalfEdge, Mesh, VertexId, Wedge, WedgeId};

/// A mesh with its positions; new vertices are appended as an edit makes them.
#[derive(Clone)]
pub struct Solid {
    pub mesh: Mesh,
    pub positions: Vec<DVec3>,
}

impl Solid {
    pub fn new(positions: Vec<DVec3>, faces: Vec<[u32; 3]>) -> Self {
        let wedge = |v: usize| Wedge {
            vertex: VertexId::new(v),
            group: WedgeId::new(v),
            uv: [0.0; 2],
            normal: [0.0, 0.0, 1.0],
            colour: u32::MAX,
        };
        let wedges = (0..positions.len()).map(wedge).collect();
        let ids = faces.iter().map(|f| f.map(VertexId)).collect();
        let corners = faces.iter().map(|f| f.map(WedgeId)).collect();
        let mesh = Mesh::build(positions.len(), ids, corners, &vec![0; faces.len()], wedges);
        Self { mesh, positions }
    }

    /// An octahedron split `levels` times and blown up to a sphere of `radius`.
    pub fn sphere(radius: f64, levels: usize) -> Self {
        let mut positions = vec![DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z];
        let mut faces: Vec<[u32; 3]> =
            vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
        for _ in 0..levels {
            let mut middles = std::collections::BTreeMap::new();
            let mut next = Vec::new();
            for f in &faces {
                let mut middle = |a: u32, b: u32| {
                    *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                        positions.push((positions[a as usize] + positions[b as usize]).normalize());
                        positions.len() as u32 - 1
                    })
                };
                let [a, b, c] = *f;
                let (x, y, z) = (middle(a, b), middle(b, c), middle(c, a));
                next.extend([[a, x, z], [x, b, y], [z, y, c], [x, y, z]]);
            }
            faces = next;
        }
        Self::new(positions.iter().map(|p| *p * radius).collect(), faces)
    }

    /// A closed box of `n` cells a side, of edge `n`, one corner at the origin: integer coordinates, every tie possible.
    pub fn cube(n: i32) -> Self {
        let mut ids = std::collections::BTreeMap::new();
        let mut positions = Vec::new();
        let mut faces = Vec::new();
        for axis in 0..3 {
            for &side in &[0, n] {
                for i in 0..n {
                    for j in 0..n {
                        let mut at = |u: i32, v: i32| {
                            let mut p = [0; 3];
                            p[axis] = side;
                            p[(axis + 1) % 3] = u;
                            p[(axis + 2) % 3] = v;
                            *ids.entry(p).or_insert_with(|| {
                                positions.push(DVec3::new(p[0] as f64, p[1] as f64, p[2] as f64));
                                positions.len() as u32 - 1
                            })
                        };
                        let q = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                        let (a, b) = if side == n {
                            ([q[0], q[1], q[2]], [q[0], q[2], q[3]])
                        } else {
                            ([q[0], q[2], q[1]], [q[0], q[3], q[2]])
                        };
                        faces.extend([a, b]);
                    }
                }
            }
        }
        Self::new(positions, faces)
    }

    pub fn at(&self, v: VertexId) -> DVec3 {
        self.positions[v.index()]
    }

    pub fn area(&self) -> f64 {
        self.mesh.live_faces().map(|f| self.face_area(f)).sum()
    }

    pub fn face_area(&self, f: FaceId) -> f64 {
        let [a, b, c] = self.mesh.face(f).map(|v| self.at(v));
        (b - a).cross(c - a).length() / 2.0
    }

    pub fn open_half_edges(&self) -> Vec<HalfEdge> {
        open_half_edges(&self.mesh)
    }
}

pub fn open_half_edges(mesh: &Mesh) -> Vec<HalfEdge> {
    let all = mesh.live_faces().flat_map(|f| (0..3).map(move |k| HalfEdge::of(f, k)));
    all.filter(|&h| mesh.opposite(h).is_none()).collect()
}

/// Number of closed lines that the open edges make.
pub fn border_loops(mesh: &Mesh) -> usize {
    let mut left = open_half_edges(mesh);
    let mut loops = 0;
    while let Some(first) = left.pop() {
        loops += 1;
        let mut at = mesh.to(first);
        while let Some(i) = left.iter().position(|&h| mesh.from(h) == at) {
            at = mesh.to(left.swap_remove(i));
        }
    }
    loops
}

/// True for a corner of walls and floors alone.
pub fn is_deep(mesh: &Mesh, v: VertexId) -> bool {
    mesh.fan(v).all(|h| mesh.is_interior(h.face()))
}
