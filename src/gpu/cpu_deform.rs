//! Final positions and normals on the CPU (MATHS 2), for adapters whose shaders may not read as many buffers as the deform pass
//! does: the twin of `shaders/deform.wgsl` and `shaders/normals.wgsl`, in f64, written where they would write.

use super::view::TissueView;
use crate::geometry::{VertexId, WedgeId, cofactor};
use crate::rig::{Fades, displaced};
use glam::{DMat3, DQuat, DVec3, Vec3};

/// What the deform pass leaves behind; kept between frames.
#[derive(Debug, Default)]
pub struct Deformed {
    /// Final position of each vertex slot, metres, tissue space, and 1 where anything displaces it.
    pub positions: Vec<[f32; 4]>,
    /// Final normal of each wedge, and its vertex' distance from the lip of a wound, in diagonals.
    pub normals: Vec<[f32; 4]>,
    exact: Vec<DVec3>,
    lips: Vec<bool>,
    /// Vertices with a lip in the faces around them.
    near_lips: Vec<bool>,
}

/// For what has no lip near it, in diagonals: too far to look like one.
const FAR_FROM_LIP: f64 = 0.03;

/// Height over length, of faces whose normals rounding says more of than they do.
const SLIVER: f64 = 1e-3;

impl Deformed {
    /// Computes both. `fading` is false once all fades have ended.
    pub fn compute(&mut self, view: &TissueView<'_>, fading: bool) {
        let slots = view.mesh.vertex_slots();
        self.exact.clear();
        self.positions.clear();
        for v in (0..slots).map(VertexId::new) {
            let (position, moved) = place(view, v, fading);
            self.exact.push(position);
            self.positions.push(position.as_vec3().extend(f32::from(u8::from(moved))).to_array());
        }
        self.lips.clear();
        self.lips.extend((0..slots).map(|v| is_lip(view, VertexId::new(v))));
        self.near_lips.clear();
        self.near_lips.resize(slots, false);
        for f in view.mesh.live_faces() {
            let corners = view.mesh.face(f);
            if corners.iter().any(|c| self.lips[c.index()]) {
                corners.iter().for_each(|c| self.near_lips[c.index()] = true);
            }
        }
        let mut normals = std::mem::take(&mut self.normals);
        normals.clear();
        normals.extend((0..view.mesh.wedges().len()).map(|w| self.normal(view, WedgeId::new(w))));
        self.normals = normals;
    }

    fn normal(&self, view: &TissueView<'_>, w: WedgeId) -> [f32; 4] {
        let wedge = view.mesh.wedge(w);
        let rest = Vec3::from_array(wedge.normal).as_dvec3().normalize_or(DVec3::Z);
        let v = wedge.vertex;
        if v.index() >= self.exact.len() || !view.mesh.vertex_is_live(v) {
            return rest.as_vec3().extend(FAR_FROM_LIP as f32).to_array();
        }
        let still = cofactor(view.pose.blended_linear(view.rows, v));
        let mut normal = (still * rest).normalize_or(rest);
        let (mut now, mut before, mut size, mut moved, mut edited) = (DVec3::ZERO, DVec3::ZERO, 0.0, false, false);
        for h in view.mesh.fan(v) {
            let f = h.face();
            let corners = view.mesh.face(f);
            moved |= corners.iter().any(|c| self.positions[c.index()][3] > 0.0);
            if view.mesh.wedge(view.mesh.face_wedges(f)[h.corner()]).group == wedge.group {
                edited |= !view.mesh.is_interior(f) && corners.iter().any(|&c| !view.rows.is_base(c));
                let area = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a);
                now += area(corners.map(|c| self.exact[c.index()]));
                let at_rest = corners.map(|c| view.rows.rest(c));
                before += area(at_rest);
                let k = h.corner();
                size += [1, 2].map(|i| at_rest[k].distance(at_rest[(k + i) % 3])).iter().product::<f64>();
            }
        }
        if moved {
            let now = now.normalize_or(normal);
            normal = if edited && before.length() > SLIVER * size {
                turned(normal, (still * before).normalize_or(now), now)
            } else {
                now
            };
        }
        let lip = Some(self.lip_distance(view, v)).filter(|lip| lip.is_finite()).map_or(FAR_FROM_LIP, |lip| lip / view.diagonal);
        normal.as_vec3().extend(lip as f32).to_array()
    }

    /// Distance of a vertex from the lip over the faces around it and around its neighbours, metres; infinite where none has one.
    fn lip_distance(&self, view: &TissueView<'_>, v: VertexId) -> f64 {
        if self.lips[v.index()] {
            return 0.0;
        }
        let p = self.exact[v.index()];
        let neighbours = view.mesh.neighbours(v).filter(|u| self.near_lips[u.index()]);
        let faces = neighbours.flat_map(|u| view.mesh.fan(u)).map(|h| view.mesh.face(h.face()));
        faces.map(|corners| self.lip_in_face(p, corners)).fold(f64::INFINITY, f64::min)
    }

    /// Distance of a point from the lip's part in a face, metres.
    fn lip_in_face(&self, p: DVec3, corners: [VertexId; 3]) -> f64 {
        let mut nearest = f64::INFINITY;
        for k in 0..3 {
            let [a, b] = [corners[k], corners[(k + 1) % 3]];
            let (at, along) = match (self.lips[a.index()], self.lips[b.index()]) {
                (false, _) => continue,
                (true, false) => (self.exact[a.index()], DVec3::ZERO),
                (true, true) => (self.exact[a.index()], self.exact[b.index()] - self.exact[a.index()]),
            };
            let x = if along == DVec3::ZERO { 0.0 } else { ((p - at).dot(along) / along.length_squared()).clamp(0.0, 1.0) };
            nearest = nearest.min(p.distance(at + along * x));
        }
        nearest
    }
}

/// Turns `v` as the shortest turn that takes `from` to `to`, both of unit length. What is turned round altogether turns nothing.
fn turned(v: DVec3, from: DVec3, to: DVec3) -> DVec3 {
    if from.dot(to) > -0.9 { DQuat::from_rotation_arc(from, to) * v } else { to }
}

/// True for a vertex that an edit inserted where the skin ends or meets a wall or cap.
pub(super) fn is_lip(view: &TissueView<'_>, v: VertexId) -> bool {
    if view.rows.rows.row(v.index()).is_empty() || !view.mesh.vertex_is_live(v) {
        return false;
    }
    let (mut skin, mut inside, mut open) = (false, false, false);
    for h in view.mesh.fan(v) {
        let is_inside = view.mesh.is_interior(h.face());
        (skin, inside) = (skin | !is_inside, inside | is_inside);
        open |= view.mesh.opposite(h).is_none() || view.mesh.opposite(h.prev()).is_none();
    }
    skin && (inside || open)
}

fn place(view: &TissueView<'_>, v: VertexId, fading: bool) -> (DVec3, bool) {
    let known = v.index() < view.map.influences.rows();
    let influences = if known { view.map.influences.row(v.index()) } else { &[] };
    let mut moved = false;
    let carried = influences.iter().map(|i| {
        let j = i.particle.index();
        let turn = view.rotations.get(j);
        moved |= view.displacements[j] != DVec3::ZERO || turn.is_some_and(|t| t.spin != DMat3::ZERO);
        (view.displacements[j], turn, f64::from(i.weight))
    });
    let mut position = displaced(view.pose.skin(view.rows, v), carried);
    if fading && let Some(&[x, y, z, start]) = view.fades.get(v.index()) {
        let alpha = Fades::weight(start, view.time_s, view.fade_duration_s);
        let offset = Vec3::new(x, y, z).as_dvec3() * alpha;
        if offset != DVec3::ZERO {
            position += view.pose.blended_carry(view.rows, v, offset);
            moved = true;
        }
    }
    (position, moved)
}
