//! Final positions and normals on the CPU (MATHS 2), for adapters whose shaders may not read as many buffers as the deform pass
//! does: the twin of `shaders/deform.wgsl` and `shaders/normals.wgsl`, in f64, written where they would write.

use super::view::TissueView;
use crate::geometry::{VertexId, WedgeId, cofactor};
use crate::rig::{Fades, displaced};
use glam::{DMat3, DVec3, Vec3};

/// What the deform pass leaves behind; kept between frames.
#[derive(Debug, Default)]
pub struct Deformed {
    /// Final position of each vertex slot, metres, tissue space, and 1 where anything displaces it.
    pub positions: Vec<[f32; 4]>,
    /// Final normal of each wedge, and its vertex' distance from the lip of a wound, in diagonals.
    pub normals: Vec<[f32; 4]>,
    exact: Vec<DVec3>,
    lips: Vec<bool>,
}

/// What is farther from a lip than this, in diagonals, does not look like one.
const FAR_FROM_LIP: f64 = 0.03;

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
        let mut normal = (cofactor(view.pose.blended_linear(view.rows, v)) * rest).normalize_or(rest);
        let (mut sum, mut moved) = (DVec3::ZERO, false);
        let mut lip = if self.lips[v.index()] { 0.0 } else { f64::INFINITY };
        for h in view.mesh.fan(v) {
            let f = h.face();
            let corners = view.mesh.face(f);
            moved |= corners.iter().any(|c| self.positions[c.index()][3] > 0.0);
            if view.mesh.wedge(view.mesh.face_wedges(f)[h.corner()]).group == wedge.group {
                let [a, b, c] = corners.map(|c| self.exact[c.index()]);
                sum += (b - a).cross(c - a);
            }
            lip = lip.min(self.lip_in_face(v, corners));
        }
        if moved {
            normal = sum.normalize_or(normal);
        }
        normal.as_vec3().extend((lip / view.diagonal).min(FAR_FROM_LIP) as f32).to_array()
    }

    /// Distance of a corner from the lip's part in its face, metres.
    fn lip_in_face(&self, v: VertexId, corners: [VertexId; 3]) -> f64 {
        let p = self.exact[v.index()];
        let mut ends = corners.into_iter().filter(|&c| c != v && self.lips[c.index()]).map(|c| self.exact[c.index()]);
        let Some(from) = ends.next() else { return f64::INFINITY };
        let along = ends.next().map_or(DVec3::ZERO, |to| to - from);
        let x = if along == DVec3::ZERO { 0.0 } else { ((p - from).dot(along) / along.length_squared()).clamp(0.0, 1.0) };
        p.distance(from + along * x)
    }
}

/// True for a vertex that an edit inserted where the skin ends or meets a wall or cap.
fn is_lip(view: &TissueView<'_>, v: VertexId) -> bool {
    if view.rows.rows.row(v.index()).is_empty() || !view.mesh.vertex_is_live(v) {
        return false;
    }
    let (mut skin, mut inside, mut open) = (false, false, false);
    for h in view.mesh.fan(v) {
        let is_inside = view.mesh.face_info(h.face()).is_interior();
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
