//! Slits of one edge.

use super::{SlitScratch, SlitStep};
use crate::geometry::{HalfEdge, Mesh};
use crate::surgery::insert::NewVertex;

impl SlitScratch {
    /// A slit of one edge has both lips between the same two vertices: by corners alone, which is all that files have, it would be closed.
    /// Each lip gets a vertex in its middle. To be called once the edges are open and the fans parted.
    pub(super) fn part_single_edges(&mut self, mesh: &mut Mesh, out: &mut SlitStep) {
        for i in 0..self.opened.len() {
            let [h, back] = self.opened[i];
            if mesh.from(h) == mesh.to(back) && mesh.to(h) == mesh.from(back) {
                let [[to_middle, onward], [back_to_middle, back_onward]] = [h, back].map(|h| self.part_lip(mesh, h, out));
                self.opened[i] = [to_middle, back_onward];
                self.opened.push([onward, back_to_middle]);
                out.opened_edges += 1;
            }
        }
    }

    /// Puts a vertex into the middle of an open edge. Returns the two that it becomes, in its direction.
    fn part_lip(&mut self, mesh: &mut Mesh, h: HalfEdge, out: &mut SlitStep) -> [HalfEdge; 2] {
        let [start, end, tip] = [mesh.from(h), mesh.to(h), mesh.from(h.prev())];
        let middle = mesh.add_vertex();
        let faces = self.wedges.halves(mesh, h, middle);
        mesh.replace_faces(&[h.face()], &faces, |_| 0, &mut self.topology);
        let ends = [start, end].map(|v| (v, self.place_of(v, out)));
        out.new_vertices.push(NewVertex::on_edge(middle, ends, 0.5));
        out.touched.push(tip);
        out.added_faces.retain(|&f| f != h.face());
        out.added_faces.extend_from_slice(&self.topology.added);
        [0, 1].map(|i| HalfEdge::of(self.topology.added[i], 0))
    }
}
