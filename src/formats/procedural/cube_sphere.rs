//! A sphere as six grids, with equirectangular texture coordinates.
//!
//! Each grid stores its own vertices; along the seam meridian (-z) vertices are stored once more, and once a triangle at
//! the poles. With 8 quads an edge that makes 6 * 81 + 15 + 14 = 515 stored vertices and 768 faces, the counts of the
//! paper's sphere.

use glam::{DVec3, IVec3};
use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_4, PI, TAU};

/// Stored vertices and faces of the unit sphere.
pub(super) struct CubeSphere {
    /// Unit vectors; copies of a vertex are equal bit for bit.
    pub directions: Vec<DVec3>,
    /// Topological vertex of each.
    pub vertex: Vec<u32>,
    /// Number of topological vertices.
    pub vertices: usize,
    /// Texture coordinates, v down.
    pub uvs: Vec<[f64; 2]>,
    /// Faces by stored vertex, outward.
    pub faces: Vec<[u32; 3]>,
}

/// Faces for `n` quads an edge.
pub(super) fn face_count(n: usize) -> usize {
    12 * n * n
}

/// The even number of quads an edge whose face count is nearest to `faces`.
pub(super) fn edge_for(faces: usize) -> usize {
    let low = (((faces as f64 / 12.0).sqrt() / 2.0).floor() as usize * 2).max(2);
    if face_count(low + 2).abs_diff(faces) < face_count(low).abs_diff(faces) { low + 2 } else { low }
}

/// Builds it with `n` quads an edge (even, so that the seam follows edges).
pub(super) fn build(n: usize) -> CubeSphere {
    let mut builder = Builder { n: n as i32, ..Builder::default() };
    for axis in 0..3 {
        for sign in [1, -1] {
            builder.patch(axis, sign);
        }
    }
    builder.dress();
    let directions = builder.stored.iter().map(|&p| builder.direction(p)).collect();
    CubeSphere { directions, vertex: builder.vertex, vertices: builder.ids.len(), uvs: builder.uvs, faces: builder.faces }
}

#[derive(Default)]
struct Builder {
    n: i32,
    /// Lattice point of each stored vertex, -n to n in steps of 2.
    stored: Vec<IVec3>,
    vertex: Vec<u32>,
    ids: HashMap<[i32; 3], u32>,
    uvs: Vec<[f64; 2]>,
    faces: Vec<[u32; 3]>,
}

impl Builder {
    /// Equal angles along each edge make faces of similar size.
    fn direction(&self, p: IVec3) -> DVec3 {
        (p.as_dvec3() / f64::from(self.n)).to_array().map(|t| (t * FRAC_PI_4).tan()).into()
    }

    fn store(&mut self, p: IVec3) -> u32 {
        let next = self.ids.len() as u32;
        self.vertex.push(*self.ids.entry(p.to_array()).or_insert(next));
        self.stored.push(p);
        self.uvs.push([f64::NAN; 2]);
        self.stored.len() as u32 - 1
    }

    fn patch(&mut self, axis: usize, sign: i32) {
        let unit = |k: usize| IVec3::from_array(std::array::from_fn(|i| i32::from(i == k % 3)));
        let (w, u, v) = (unit(axis) * sign, unit(axis + 1), unit(axis + 2) * sign);
        let (n, start) = (self.n, self.stored.len() as u32);
        for j in 0..=n {
            for i in 0..=n {
                self.store(w * n + u * (2 * i - n) + v * (2 * j - n));
            }
        }
        let at = |i: i32, j: i32| start + (j * (n + 1) + i) as u32;
        for j in 0..n {
            for i in 0..n {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                // Diagonals run out from the middle of the patch.
                if (2 * i < n) == (2 * j < n) {
                    self.faces.extend([[a, b, c], [a, c, d]]);
                } else {
                    self.faces.extend([[a, b, d], [b, c, d]]);
                }
            }
        }
    }

    /// Sets texture coordinates, storing vertices again where the seam and the poles need it.
    fn dress(&mut self) {
        let mut seam: HashMap<u32, u32> = HashMap::new();
        for f in 0..self.faces.len() {
            let face = self.faces[f];
            let east = face.iter().map(|&v| self.stored[v as usize].x).sum::<i32>() > 0;
            let longitude = |p: IVec3| match (p.x, p.z) {
                (0, z) if z < 0 => f64::from(u8::from(east)),
                _ => {
                    let d = self.direction(p);
                    d.x.atan2(d.z) / TAU + 0.5
                }
            };
            let pole = |v: u32| self.stored[v as usize].x == 0 && self.stored[v as usize].z == 0;
            let others: Vec<f64> = face.iter().filter(|&&v| !pole(v)).map(|&v| longitude(self.stored[v as usize])).collect();
            let at_pole = others.iter().sum::<f64>() / others.len().max(1) as f64;
            let us = face.map(|v| if pole(v) { at_pole } else { longitude(self.stored[v as usize]) });
            for k in 0..3 {
                self.faces[f][k] = self.dressed(face[k], us[k], &mut seam);
            }
        }
    }

    /// The stored vertex like `v` with longitude `u`.
    fn dressed(&mut self, v: u32, u: f64, seam: &mut HashMap<u32, u32>) -> u32 {
        let p = self.stored[v as usize];
        let polar = self.direction(p).normalize().y.clamp(-1.0, 1.0).acos() / PI;
        let vertex = self.vertex[v as usize];
        let target = if p.x == 0 && p.z == 0 {
            if self.uvs[v as usize][0].is_nan() { v } else { self.store(p) } // one a triangle
        } else if p.x == 0 && p.z < 0 && u == 0.0 {
            match seam.get(&vertex) {
                Some(&copy) => copy,
                None => {
                    let copy = self.store(p);
                    seam.insert(vertex, copy);
                    copy
                }
            }
        } else {
            v
        };
        self.uvs[target as usize] = [u, polar];
        target
    }
}
