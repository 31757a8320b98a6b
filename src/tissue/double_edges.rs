//! Two edges between the same two vertices, where walls touch each other or the surface: sound in our mesh, whose half-edges know
//! their partners, but four faces at one edge to whoever reads corners alone. One of the two gets a vertex in its middle.

use super::Tissue;
use super::edit::NewStrips;
use crate::geometry::topology::TopologyScratch;
use crate::geometry::{HalfEdge, VertexId};
use crate::surgery::insert::{NewVertex, WedgeMaker};

/// Scratch of [`Tissue::part_double_edges`].
#[derive(Debug, Default)]
pub(super) struct DoubleEdgeScratch {
    /// The edges of a vertex, with the vertices that they lead to.
    spokes: Vec<(VertexId, HalfEdge)>,
    maker: WedgeMaker,
    topology: TopologyScratch,
}

/// Edges of a vertex that there is room for at first.
const SPOKES: usize = 256;
/// Wedges, and faces, that one edge parted takes.
const WEDGES: usize = 8;

impl DoubleEdgeScratch {
    pub(super) fn make_room(&mut self) {
        self.spokes.reserve(SPOKES);
        self.maker.make_room(WEDGES);
        self.topology.make_room(WEDGES);
    }
}

impl Tissue {
    /// Parts all but one of the edges that join a vertex of `vertices` to the same other one. Returns the vertices inserted; no
    /// vertex is moved, and no face changes its shape.
    pub(super) fn part_double_edges(&mut self, vertices: &mut Vec<VertexId>) -> usize {
        vertices.sort_unstable();
        vertices.dedup();
        let mut made = 0;
        let mut scratch = std::mem::take(&mut self.scratch.double_edges);
        for &v in vertices.iter() {
            while self.mesh.vertex_is_live(v) && self.part_one_at(v, &mut scratch) {
                made += 1;
            }
        }
        self.scratch.double_edges = scratch;
        made
    }

    /// Parts one double edge at `v`, whose fan is another then. False if there is none that can be parted.
    fn part_one_at(&mut self, v: VertexId, scratch: &mut DoubleEdgeScratch) -> bool {
        let DoubleEdgeScratch { spokes, maker, topology } = scratch;
        spokes.clear();
        spokes.extend(self.mesh.fan(v).map(|h| (self.mesh.to(h), h)));
        spokes.sort_unstable();
        spokes.windows(2).filter(|pair| pair[0].0 == pair[1].0).any(|pair| {
            let [first, second] = [pair[0].1, pair[1].1];
            let walls = [second, first].map(|h| self.is_of_walls(h));
            let choice = if walls == [false, true] { [first, second] } else { [second, first] };
            choice.into_iter().any(|h| self.split_edge(h, maker, topology))
        })
    }

    /// True if the faces on both sides are walls.
    fn is_of_walls(&self, h: HalfEdge) -> bool {
        let back = self.mesh.opposite(h);
        back.is_some() && [h, back].iter().all(|h| self.mesh.is_interior(h.face()))
    }

    /// Puts a vertex into the middle of an edge. False, with nothing changed, where that would not part anything.
    fn split_edge(&mut self, h: HalfEdge, maker: &mut WedgeMaker, topology: &mut TopologyScratch) -> bool {
        let back = self.mesh.opposite(h);
        if back.is_none() {
            return false;
        }
        let (u, v) = (self.mesh.from(h), self.mesh.to(h));
        let tips = [h, back].map(|h| self.mesh.from(h.prev()));
        let [p, q] = [u, v].map(|v| self.position(v));
        if tips[0] == tips[1] {
            return false;
        }
        let middle = self.mesh.add_vertex();
        maker.clear();
        let faces = [h, back].map(|h| maker.halves(&mut self.mesh, h, middle));
        self.mesh.replace_faces(&[h.face(), back.face()], faces.as_flattened(), |_| 0, topology);
        let new = [NewVertex::on_edge(middle, [(u, p), (v, q)], 0.5)];
        self.add_vertices(&new);
        let report = self.update_map(&new, &[], NewStrips::default(), &[]);
        self.scratch.update.reuse(report);
        self.versions.structure += 1;
        true
    }
}
