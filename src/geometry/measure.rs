//! Areas, volumes and audits of a mesh at given positions. Sums in f64.

use super::components::Components;
use super::ids::{FaceId, HalfEdge, VertexId};
use super::mesh::Mesh;
use glam::DVec3;

/// Area-weighted outward normal of a live vertex (unit; zero where there is none), at positions that `position` gives.
pub fn vertex_normal(mesh: &Mesh, v: VertexId, position: impl Fn(VertexId) -> DVec3) -> DVec3 {
    let faces = mesh.fan(v).map(|h| mesh.face(h.face()).map(&position));
    faces.map(|[a, b, c]| (b - a).cross(c - a)).sum::<DVec3>().normalize_or_zero()
}

/// What [`measure`] finds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measures {
    /// Number of faces.
    pub faces: usize,
    /// Surface area, square metres.
    pub area: f64,
    /// Sum of the signed tetrahedra over the faces and the origin of the given positions, cubic metres: the enclosed volume
    /// of a closed surface, positive where faces point outward. For an open surface see [`Measures::volume_about`].
    pub volume: f64,
    /// Sum of the faces' area vectors, square metres: zero for a closed surface.
    pub vector_area: DVec3,
    /// Edges with a face on one side only.
    pub boundary_edges: usize,
    /// Edges (by vertex) that more than two faces share, or two in the same direction.
    pub non_manifold_edges: usize,
    /// Faces with a repeated vertex or an area of exactly zero.
    pub degenerate_faces: usize,
    /// Lowest coordinates of the vertices in use; infinite without faces.
    pub min: DVec3,
    /// Highest coordinates of the vertices in use; minus infinity without faces.
    pub max: DVec3,
}

impl Measures {
    /// True if every edge has exactly two faces.
    pub fn closed(&self) -> bool {
        self.faces > 0 && self.boundary_edges == 0 && self.non_manifold_edges == 0
    }

    /// Length of the bounding diagonal, metres; zero without faces.
    pub fn diagonal(&self) -> f64 {
        if self.faces == 0 { 0.0 } else { (self.max - self.min).length() }
    }

    /// The volume sum about a point given in the same space: differs from [`Measures::volume`] only for open surfaces.
    pub fn volume_about(&self, point: DVec3) -> f64 {
        if self.closed() { self.volume } else { self.volume - point.dot(self.vector_area) / 3.0 }
    }

    /// What nothing measures.
    pub const EMPTY: Self = Self {
        faces: 0,
        area: 0.0,
        volume: 0.0,
        vector_area: DVec3::ZERO,
        boundary_edges: 0,
        non_manifold_edges: 0,
        degenerate_faces: 0,
        min: DVec3::INFINITY,
        max: DVec3::NEG_INFINITY,
    };

    /// Adds the sums and extremes of other faces. Edges are counted apart: see [`Measures::count_edges`].
    pub fn add(&mut self, other: &Self) {
        self.faces += other.faces;
        self.area += other.area;
        self.volume += other.volume;
        self.vector_area += other.vector_area;
        self.degenerate_faces += other.degenerate_faces;
        (self.min, self.max) = (self.min.min(other.min), self.max.max(other.max));
    }

    /// Adds faces without their edges.
    pub fn add_faces(&mut self, mesh: &Mesh, faces: impl IntoIterator<Item = FaceId>, position: impl Fn(VertexId) -> DVec3) {
        for f in faces {
            let corners = mesh.face(f);
            self.add_face(corners, corners.map(&position));
        }
    }

    /// Counts boundary and non-manifold edges from all open half-edges of what is measured; sorts them.
    pub fn count_edges(&mut self, open: &mut [OpenEdge]) {
        (self.boundary_edges, self.non_manifold_edges) = (0, 0);
        open.sort_unstable();
        for run in open.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            match run {
                // One face, or the two lips of an opened edge whose ends are still shared.
                [_] => self.boundary_edges += 1,
                [a, b] if a.2 != b.2 => self.boundary_edges += 2,
                _ => self.non_manifold_edges += 1,
            }
        }
    }

    fn add_face(&mut self, corners: [VertexId; 3], [a, b, c]: [DVec3; 3]) {
        let cross = (b - a).cross(c - a);
        let area = 0.5 * cross.length();
        self.faces += 1;
        self.area += area;
        self.vector_area += 0.5 * cross;
        self.volume += a.dot(b.cross(c)) / 6.0;
        let repeated = corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0];
        self.degenerate_faces += usize::from(repeated || cross == DVec3::ZERO);
        for p in [a, b, c] {
            self.min = self.min.min(p);
            self.max = self.max.max(p);
        }
    }
}

/// Measures all live faces with vertices at `position`.
pub fn measure(mesh: &Mesh, position: impl Fn(VertexId) -> DVec3) -> Measures {
    measure_faces(mesh, mesh.live_faces(), position)
}

/// A half-edge without partner: its lower vertex, its higher one, and whether it runs from the lower to the higher.
pub type OpenEdge = (u32, u32, bool);

/// Appends the open half-edges of `faces`.
pub fn open_edges(mesh: &Mesh, faces: impl IntoIterator<Item = FaceId>, out: &mut Vec<OpenEdge>) {
    for f in faces {
        let row = mesh.all_opposites()[f.index()];
        for k in (0..3).filter(|&k| row[k].is_none()) {
            let h = HalfEdge::of(f, k);
            let (a, b) = (mesh.from(h).0, mesh.to(h).0);
            out.push((a.min(b), a.max(b), a < b));
        }
    }
}

/// Measures some faces of a mesh (each once). An edge counts as boundary by the mesh's own adjacency.
pub fn measure_faces(mesh: &Mesh, faces: impl IntoIterator<Item = FaceId>, position: impl Fn(VertexId) -> DVec3) -> Measures {
    let mut measures = Measures::EMPTY;
    let mut open = Vec::new();
    for f in faces {
        measures.add_faces(mesh, [f], &position);
        open_edges(mesh, [f], &mut open);
    }
    measures.count_edges(&mut open);
    measures
}

/// Measures each component. Shape: one entry a component, in the order of `components`.
pub fn measure_components(mesh: &Mesh, components: &Components, position: impl Fn(VertexId) -> DVec3) -> Vec<Measures> {
    (0..components.count()).map(|c| measure_faces(mesh, components.faces(c).iter().copied(), &position)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Wedge, WedgeId};

    const CORNERS: [[f64; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

    fn mesh(faces: &[[u32; 3]]) -> Mesh {
        let wedges = (0..4)
            .map(|v| Wedge { vertex: VertexId(v), group: WedgeId(v), uv: [0.0; 2], normal: [0.0; 3], colour: u32::MAX })
            .collect();
        let corners = faces.iter().map(|f| f.map(VertexId)).collect();
        Mesh::build(4, corners, faces.iter().map(|f| f.map(WedgeId)).collect(), &vec![0; faces.len()], wedges)
    }

    fn at(v: VertexId) -> DVec3 {
        DVec3::from_array(CORNERS[v.index()])
    }

    #[test]
    fn a_tetrahedron() {
        let m = measure(&mesh(&TETRAHEDRON), at);
        assert!((m.volume - 1.0 / 6.0).abs() < 1e-15 && (m.area - (1.5 + 0.75f64.sqrt())).abs() < 1e-15);
        assert!(m.closed() && m.vector_area.length() < 1e-15 && m.degenerate_faces == 0);
        let far = measure(&mesh(&TETRAHEDRON), |v| at(v) + DVec3::splat(3.0));
        assert!((far.volume - m.volume).abs() < 1e-13);
    }

    #[test]
    fn an_open_one_is_not_closed_and_its_volume_depends_on_the_point() {
        let open = mesh(&TETRAHEDRON[..3]);
        let m = measure(&open, at);
        assert_eq!((m.boundary_edges, m.closed()), (3, false));
        let shift = DVec3::new(0.3, -2.0, 1.0);
        let moved = measure(&open, |v| at(v) + shift);
        assert!((moved.volume_about(shift) - m.volume).abs() < 1e-14);
        assert!((moved.volume - m.volume).abs() > 0.1);
    }

    #[test]
    fn three_faces_at_an_edge_and_flat_ones_are_counted() {
        let m = measure(&mesh(&[[0, 1, 2], [1, 0, 3], [0, 1, 3]]), at);
        assert_eq!((m.non_manifold_edges, m.boundary_edges), (1, 2)); // edge 01 has three faces, 12 and 20 one each
        let flat = measure(&mesh(&TETRAHEDRON), |v| DVec3::X * f64::from(v.0));
        assert_eq!(flat.degenerate_faces, 4);
    }
}
