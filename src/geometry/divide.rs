//! Dividing faces where they are: the parts of a face stay in its section, and the caller, who knows how they meet, joins
//! them. No search and no sorting, unlike [`Mesh::replace_faces`].

use super::ids::{FaceId, HalfEdge, VertexId, WedgeId};
use super::mesh::{FaceInfo, Mesh};

impl Mesh {
    /// A slot for a part of `of`, with its info and listed behind it in its section. To be written by [`Mesh::write_face`].
    pub(crate) fn put_beside(&mut self, of: FaceId) -> FaceId {
        let info = self.face_info[of.index()];
        let [prev, next] = self.section_links[of.index()];
        let id = match self.free_faces.pop() {
            Some(f) => {
                self.face_info.set(f.index(), info);
                self.section_links.set(f.index(), [of, next]);
                f
            }
            None => {
                self.faces.push([VertexId::NONE; 3]);
                self.face_wedges.push([WedgeId::NONE; 3]);
                self.opposite.push([HalfEdge::NONE; 3]);
                self.face_info.push(info);
                FaceId::new(self.section_links.push([of, next]))
            }
        };
        self.section_links.set(of.index(), [prev, id]);
        if next.is_some() {
            let [_, after] = self.section_links[next.index()];
            self.section_links.set(next.index(), [id, after]);
        }
        id
    }

    /// A slot for a face with `info`. To be written by [`Mesh::write_face`].
    pub(crate) fn put_slot(&mut self, info: FaceInfo) -> FaceId {
        let id = match self.free_faces.pop() {
            Some(f) => {
                self.face_info.set(f.index(), info);
                f
            }
            None => {
                self.faces.push([VertexId::NONE; 3]);
                self.face_wedges.push([WedgeId::NONE; 3]);
                self.opposite.push([HalfEdge::NONE; 3]);
                self.section_links.push([FaceId::NONE; 2]);
                FaceId::new(self.face_info.push(info))
            }
        };
        self.link_section(id, info.section);
        id
    }

    /// Writes corners, wedges and opposite half-edges of a slot. What lies across is written by [`Mesh::face_across`].
    pub(crate) fn write_face(&mut self, f: FaceId, corners: [VertexId; 3], wedges: [WedgeId; 3], opposite: [HalfEdge; 3]) {
        self.faces.set(f.index(), corners);
        self.face_wedges.set(f.index(), wedges);
        self.opposite.set(f.index(), opposite);
    }

    /// Tells a half-edge, unless it is none, what lies across from it now.
    pub(crate) fn face_across(&mut self, h: HalfEdge, to: HalfEdge) {
        if h.is_some() {
            let f = h.face().index();
            let mut row = self.opposite[f];
            row[h.corner()] = to;
            self.opposite.set(f, row);
        }
    }

    /// Joins two half-edges of written faces; none where either is missing.
    pub(crate) fn join(&mut self, a: HalfEdge, b: HalfEdge) {
        if a.is_some() && b.is_some() {
            self.face_across(a, b);
            self.face_across(b, a);
        }
    }

    /// Names a half-edge that leaves `v`.
    pub(crate) fn set_leaving(&mut self, v: VertexId, h: HalfEdge) {
        self.vertex_half_edge.set(v.index(), h);
    }

    /// If `from` is the half-edge that stands for `v`, `to` takes its place.
    pub(crate) fn move_leaving(&mut self, v: VertexId, from: HalfEdge, to: HalfEdge) {
        if self.vertex_half_edge[v.index()] == from {
            self.vertex_half_edge.set(v.index(), to);
        }
    }
}
