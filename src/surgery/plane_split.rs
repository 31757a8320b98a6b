//! Splitting the faces that a plane crosses, one after the other along the cut.
//!
//! A plane crosses a face along one segment, so the crossed faces form chains: closed ones, and such as end at a border or at
//! a vertex on the plane. Walking along a chain, each crossed edge is met twice in a row, so that its vertices, one for each
//! side, its wedges and the half-edges to be joined are at hand without a look-up.

use super::clip::edge_parameter;
use super::insert::{NewVertex, along_edge};
use super::plane_cut::{PlaneCutOutcome, PlaneCutScratch};
use crate::geometry::{FaceId, HalfEdge, Mesh, VertexId, WedgeId};
use glam::DVec3;

/// In place of a corner: the chain begins or ends in the face, at a vertex on the plane.
pub(super) const NO_EDGE: u8 = 3;

/// A face that the plane crosses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossed {
    pub face: FaceId,
    /// Places of its corners in the list of visited vertices.
    pub corners: [u32; 3],
    /// Corner that the edge leaves on which the chain enters: from the positive side to the negative.
    pub entry: u8,
    /// Corner that the edge leaves on which the chain leaves: from the negative side to the positive.
    pub exit: u8,
}

/// A crossed edge. Pairs are of the positive side, then of the negative.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    vertices: [VertexId; 2],
    position: DVec3,
    /// Parameter from the end on the positive side.
    t: f64,
    /// Wedges of the edge's ends in the face that made it.
    ends: [WedgeId; 2],
    /// Wedges of its vertices there.
    wedges: [WedgeId; 2],
    /// Halves of the edge in the last face that was split; none yet at a chain's beginning.
    halves: [HalfEdge; 2],
}

/// Vertices and wedges of one corner to be, on the positive and on the negative side.
type Corner = ([VertexId; 2], [WedgeId; 2]);

/// Splits all crossed faces.
pub(super) struct FaceSplitter<'a> {
    pub mesh: &'a mut Mesh,
    pub scratch: &'a mut PlaneCutScratch,
    pub outcome: &'a mut PlaneCutOutcome,
}

impl FaceSplitter<'_> {
    pub fn split_all(&mut self) {
        let crossed = std::mem::take(&mut self.scratch.crossed);
        self.outcome.new_vertices.reserve(2 * crossed.len() + 2);
        self.outcome.added_faces.reserve(3 * crossed.len());
        self.scratch.rim.reserve(crossed.len());
        for at in 0..crossed.len() {
            if self.waits(crossed[at].face) {
                let first = self.first_of_chain(&crossed, at);
                self.split_chain(&crossed, first);
            }
        }
        self.scratch.crossed = crossed;
    }

    fn waits(&self, f: FaceId) -> bool {
        // faces made a moment ago may lie behind the stamps
        self.scratch.waiting.get(f.index()).is_some_and(|w| w[0] == self.scratch.cut)
    }

    fn place(&self, f: FaceId) -> usize {
        self.scratch.waiting[f.index()][1] as usize
    }

    /// Walks back to where the chain begins; around once if it is closed.
    fn first_of_chain(&self, crossed: &[Crossed], from: usize) -> usize {
        let mut at = from;
        loop {
            let Crossed { face, entry, .. } = crossed[at];
            if entry == NO_EDGE {
                return at;
            }
            let back = self.mesh.opposite(HalfEdge::of(face, usize::from(entry)));
            debug_assert!(back.is_none() || self.waits(back.face()), "the plane crosses faces that were left out");
            if back.is_none() || !self.waits(back.face()) {
                return at;
            }
            at = self.place(back.face());
            if at == from {
                return at;
            }
        }
    }

    fn split_chain(&mut self, crossed: &[Crossed], first: usize) {
        let mut at = first;
        let begin = (crossed[at].entry != NO_EDGE).then(|| self.crossing(&crossed[at], crossed[at].entry));
        let mut entry = begin;
        let mut begin_halves = [HalfEdge::NONE; 2];
        loop {
            let face = &crossed[at];
            self.scratch.waiting[face.face.index()] = [0; 2];
            let mut next = None;
            let mut exit = None;
            if face.exit != NO_EDGE {
                let across = self.mesh.opposite(HalfEdge::of(face.face, usize::from(face.exit)));
                if across.is_some() && self.waits(across.face()) {
                    next = Some(self.place(across.face()));
                } else if across.is_some() {
                    exit = begin; // around once
                }
                exit = exit.or_else(|| Some(self.crossing(face, face.exit)));
            }
            let halves = match (entry, exit) {
                (Some(entry), Some(exit)) => self.split_in_three(face, &entry, &exit),
                (entry, exit) => self.split_at_corner(face, entry, exit),
            };
            if let Some(entry) = entry {
                for s in 0..2 {
                    self.mesh.join(entry.halves[s], halves[0][s]);
                }
            }
            if at == first {
                begin_halves = halves[0];
            }
            match (next, exit) {
                (Some(next), Some(exit)) => {
                    entry = Some(Crossing { halves: halves[1], ..exit });
                    at = next;
                }
                (None, Some(exit)) if begin.is_some_and(|b| b.vertices == exit.vertices) => {
                    for s in 0..2 {
                        self.mesh.join(halves[1][s], begin_halves[s]);
                    }
                    return;
                }
                _ => return,
            }
        }
    }

    /// Makes the two vertices where the plane crosses the edge that leaves corner `k` of a face.
    fn crossing(&mut self, face: &Crossed, k: u8) -> Crossing {
        let (k, l) = (usize::from(k), usize::from(k + 1) % 3);
        let (corners, wedges) = (self.mesh.face(face.face), self.mesh.face_wedges(face.face));
        let [from, to] = [k, l].map(|c| self.scratch.visited[face.corners[c] as usize]);
        // the same value from either side of the edge
        let turned = corners[l] < corners[k];
        let (a, b, low, high) = if turned { (corners[l], corners[k], to, from) } else { (corners[k], corners[l], from, to) };
        let t = edge_parameter(low.value, high.value);
        let position = low.position.lerp(high.position, t);
        let vertices = [self.mesh.add_vertex(), self.mesh.add_vertex()];
        let none = (VertexId::NONE, 0.0);
        let made = [([(a, 1.0 - t), (b, t), none], 2), ([(vertices[0], 1.0), none, none], 1)];
        for (vertex, (parents, parent_count)) in vertices.into_iter().zip(made) {
            self.outcome.new_vertices.push(NewVertex { vertex, parents, parent_count, position });
        }
        let rises = from.value < 0.0;
        let ends = if rises { [wedges[l], wedges[k]] } else { [wedges[k], wedges[l]] };
        let t = if low.value > 0.0 { t } else { 1.0 - t };
        let mut crossing = Crossing { vertices, position, t, ends, wedges: [WedgeId::NONE; 2], halves: [HalfEdge::NONE; 2] };
        crossing.wedges = self.dress(&crossing, ends);
        crossing
    }

    /// Wedges of a crossing's vertices between the wedges `ends`: those it has on a smooth edge, new ones at a seam.
    fn dress(&mut self, crossing: &Crossing, ends: [WedgeId; 2]) -> [WedgeId; 2] {
        let known = crossing.wedges[0].is_some();
        if known && crossing.ends == ends {
            return crossing.wedges;
        }
        let [a, b] = ends.map(|w| self.mesh.wedge(w));
        let smooth = known && crossing.ends.map(|w| self.mesh.wedge(w).group) == [a.group, b.group];
        let mut wedge = along_edge(&a, &b, crossing.t);
        std::array::from_fn(|s| {
            wedge.vertex = crossing.vertices[s];
            wedge.group = if smooth { self.mesh.wedge(crossing.wedges[s]).group } else { WedgeId::NONE };
            self.mesh.add_wedge(wedge)
        })
    }

    fn corner(&mut self, face: &Crossed, crossing: &Crossing, k: u8) -> Corner {
        let (k, l) = (usize::from(k), usize::from(k + 1) % 3);
        let wedges = self.mesh.face_wedges(face.face);
        let rises = self.scratch.visited[face.corners[k] as usize].value < 0.0;
        let ends = if rises { [wedges[l], wedges[k]] } else { [wedges[k], wedges[l]] };
        (crossing.vertices, self.dress(crossing, ends))
    }

    /// Splits a face with two crossed edges: a triangle at the corner that is alone on its side, which keeps the slot, and a
    /// quadrangle. Returns the halves of the entry's edge and of the exit's.
    fn split_in_three(&mut self, face: &Crossed, entry: &Crossing, exit: &Crossing) -> [[HalfEdge; 2]; 2] {
        let f = face.face;
        let value = |k: usize| self.scratch.visited[face.corners[k] as usize].value;
        let position = |k: usize| self.scratch.visited[face.corners[k] as usize].position;
        // the edge that leaves the lone corner falls if that corner is on the positive side
        let positive = (face.exit + 1) % 3 == face.entry;
        let i = usize::from(if positive { face.entry } else { face.exit });
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        debug_assert!((value(i) > 0.0) == positive && (value(j) > 0.0) != positive && (value(k) > 0.0) != positive);
        let (own, other) = if positive { (0, 1) } else { (1, 0) };
        let (on_p, on_q) = if positive { (entry, exit) } else { (exit, entry) };
        // the quadrangle p, j, k, q along its better diagonal
        let [pp, pj, pk, pq] = [on_p.position, position(j), position(k), on_q.position];
        let [p_j, j_k, k_q, q_p, p_k, j_q] =
            [(pp, pj), (pj, pk), (pk, pq), (pq, pp), (pp, pk), (pj, pq)].map(|(a, b)| (b - a).length_squared());
        let along_pk = shape([pp, pj, pk], [p_j, j_k, p_k]).min(shape([pp, pk, pq], [p_k, k_q, q_p]))
            >= shape([pp, pj, pq], [p_j, j_q, q_p]).min(shape([pj, pk, pq], [j_k, k_q, j_q]));
        let p = self.corner(face, on_p, i as u8);
        let q = self.corner(face, on_q, k as u8);
        let (corners, wedges) = (self.mesh.face(f), self.mesh.face_wedges(f));
        let outer = self.mesh.opposite(HalfEdge::of(f, j));
        let (n2, n1) = (self.mesh.put_beside(f), self.mesh.put_beside(f));
        let half = HalfEdge::of;
        let none = HalfEdge::NONE;
        let turned = |points: [(VertexId, WedgeId); 3]| {
            let mut at = points;
            at.rotate_right(i);
            (at.map(|c| c.0), at.map(|c| c.1))
        };
        let at = |c: usize| (corners[c], wedges[c]);
        let of = |corner: &Corner, s: usize| (corner.0[s], corner.1[s]);
        let (tip, tip_wedges) = turned([at(i), of(&p, own), of(&q, own)]);
        self.mesh.write_face(f, tip, tip_wedges, [none; 3]);
        let (p2, q2) = (of(&p, other), of(&q, other));
        let ([a1, b1, c1], [a2, b2, c2], across, outer_half, far_rim);
        if along_pk {
            ([a1, b1, c1], [a2, b2, c2]) = ([p2, at(j), at(k)], [p2, at(k), q2]);
            across = ([none, outer, half(n2, 0)], [half(n1, 2), none, none]);
            (outer_half, far_rim) = (half(n1, 1), half(n2, 2));
        } else {
            ([a1, b1, c1], [a2, b2, c2]) = ([p2, at(j), q2], [at(j), at(k), q2]);
            across = ([none, half(n2, 2), none], [outer, none, half(n1, 1)]);
            (outer_half, far_rim) = (half(n2, 0), half(n1, 2));
        }
        self.mesh.write_face(n1, [a1.0, b1.0, c1.0], [a1.1, b1.1, c1.1], across.0);
        self.mesh.write_face(n2, [a2.0, b2.0, c2.0], [a2.1, b2.1, c2.1], across.1);
        self.mesh.face_across(outer, outer_half);
        self.mesh.move_leaving(corners[j], half(f, j), half(n1, 1));
        self.mesh.move_leaving(corners[k], half(f, k), half(n2, 1));
        let near_rim = half(f, j);
        self.mesh.set_leaving(p.0[own], near_rim);
        self.mesh.set_leaving(p.0[other], half(n1, 0));
        self.mesh.set_leaving(q.0[own], half(f, k));
        self.mesh.set_leaving(q.0[other], far_rim);
        self.scratch.rim.push(if positive { [near_rim, far_rim] } else { [far_rim, near_rim] });
        self.outcome.added_faces.extend([f, n1, n2]);
        let sides = |own_half, other_half| if positive { [own_half, other_half] } else { [other_half, own_half] };
        let (halves_p, halves_q) = (sides(half(f, i), half(n1, 0)), sides(half(f, k), half(n2, 1)));
        if positive { [halves_p, halves_q] } else { [halves_q, halves_p] }
    }

    /// Splits a face in two from its corner on the plane. Returns the halves of its crossed edge, in the place of the entry or
    /// of the exit.
    fn split_at_corner(&mut self, face: &Crossed, entry: Option<Crossing>, exit: Option<Crossing>) -> [[HalfEdge; 2]; 2] {
        let (f, none, half) = (face.face, HalfEdge::NONE, HalfEdge::of);
        let Some((crossing, j)) = entry.map(|c| (c, face.entry)).or(exit.map(|c| (c, face.exit))) else {
            return [[none; 2]; 2];
        };
        let m = self.corner(face, &crossing, j);
        let j = usize::from(j);
        let (k, i) = ((j + 1) % 3, (j + 2) % 3);
        // side of j and side of k
        let (first, second) = if entry.is_some() { (0, 1) } else { (1, 0) };
        let (mut corners, mut wedges) = (self.mesh.face(f), self.mesh.face_wedges(f));
        let (far, far_wedge) = (corners[k], wedges[k]);
        let [kept, outer] = [i, k].map(|c| self.mesh.opposite(half(f, c)));
        let n = self.mesh.put_beside(f);
        self.mesh.write_face(n, [corners[i], m.0[second], far], [wedges[i], m.1[second], far_wedge], [none, none, outer]);
        (corners[k], wedges[k]) = (m.0[first], m.1[first]);
        let mut across = [none; 3];
        across[i] = kept;
        self.mesh.write_face(f, corners, wedges, across);
        self.mesh.face_across(outer, half(n, 2));
        self.mesh.move_leaving(far, half(f, k), half(n, 2));
        self.mesh.set_leaving(m.0[first], half(f, k));
        self.mesh.set_leaving(m.0[second], half(n, 1));
        // the half-edge m, i on the side of j, and i, m on that of k
        let (rim_j, rim_k) = (half(f, k), half(n, 0));
        self.scratch.rim.push(if first == 0 { [rim_j, rim_k] } else { [rim_k, rim_j] });
        self.outcome.added_faces.extend([f, n]);
        let (half_j, half_k) = (half(f, j), half(n, 1));
        let halves = if first == 0 { [half_j, half_k] } else { [half_k, half_j] };
        if entry.is_some() { [halves, [none; 2]] } else { [[none; 2], halves] }
    }
}

/// Shape of a triangle with sides of these squared lengths: its doubled area over its longest side squared, the whole squared.
fn shape([a, b, c]: [DVec3; 3], squared: [f64; 3]) -> f64 {
    let longer = |a: f64, b: f64| if a > b { a } else { b };
    let longest = longer(longer(squared[0], squared[1]), squared[2]);
    if longest > 0.0 { (b - a).cross(c - a).length_squared() / (longest * longest) } else { 0.0 }
}
