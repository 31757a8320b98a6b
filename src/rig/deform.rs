//! Final positions on the CPU: `f = s + sum w (u + (R - I)(s - a)) + alpha A c` (MATHS 2.1, 2.2), the f64 twin of
//! `shaders/deform.wgsl`.

use super::rows::VertexRows;
use super::skinning::Pose;
use crate::geometry::{Turn, VertexId};
use glam::{DVec3, Vec3};

/// Offsets that hold inserted and reweighted vertices where they were at the instant of an edit, and fade (MATHS 2.2).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fades {
    /// `c` in the rest frame (metres) and the start time (seconds) of each vertex; zero `c` for none. Empty: no vertex fades.
    pub entries: Vec<[f32; 4]>,
    /// When the last one ends, seconds.
    pub end_s: f64,
    /// How long one takes, seconds; 0: offsets stay for good.
    pub duration_s: f64,
    /// No `c` of those that run is longer, metres.
    pub longest: f64,
}

impl Fades {
    /// The same rules and times, for other vertices.
    pub fn like(&self) -> Self {
        Self { entries: Vec::new(), end_s: self.end_s, duration_s: self.duration_s, longest: self.longest }
    }

    /// Weight of a fade that began at `start`: a smoothstep from 1 to 0.
    pub fn alpha(&self, start: f32, time_s: f64) -> f64 {
        if self.duration_s <= 0.0 { 1.0 } else { Self::weight(start, time_s, self.duration_s) }
    }

    /// [`Fades::alpha`] of a fade that takes `duration_s`; 0 if that is no time.
    pub fn weight(start: f32, time_s: f64, duration_s: f64) -> f64 {
        if duration_s <= 0.0 {
            return 0.0;
        }
        let x = ((time_s - f64::from(start)) / duration_s).clamp(0.0, 1.0);
        1.0 - x * x * (3.0 - 2.0 * x)
    }

    /// True while any vertex fades.
    pub fn running(&self, time_s: f64) -> bool {
        !self.entries.is_empty() && (time_s < self.end_s || self.duration_s <= 0.0)
    }

    /// Offset of a vertex before the blended matrix `A` is applied, metres, rest frame.
    pub fn offset(&self, v: VertexId, time_s: f64) -> DVec3 {
        match self.entries.get(v.index()) {
            Some(&[x, y, z, start]) if x != 0.0 || y != 0.0 || z != 0.0 => {
                Vec3::new(x, y, z).as_dvec3() * self.alpha(start, time_s)
            }
            _ => DVec3::ZERO,
        }
    }

    /// Starts the fade of `v`: `target - position` is what the vertex must be moved by now, `pose` and `rows` its skin.
    pub fn start(&mut self, rows: &VertexRows, pose: &Pose, v: VertexId, moved: DVec3, time_s: f64) {
        if self.entries.len() < rows.len() {
            self.entries.resize(rows.len(), [0.0; 4]);
        }
        if !self.running(time_s) {
            self.longest = 0.0;
        }
        let linear = pose.blended_linear(rows, v);
        // a blend that is near singular has no inverse worth using: the offset then stays in the posed frame's axes
        let inverse = if linear.determinant().abs() > 1e-9 { linear.inverse() } else { glam::DMat3::IDENTITY };
        let c = (inverse * moved).as_vec3();
        self.entries[v.index()] = [c.x, c.y, c.z, time_s as f32];
        self.longest = self.longest.max(c.as_dvec3().length());
        self.end_s = self.end_s.max(f64::from(time_s as f32) + self.duration_s);
    }

    /// Forgets the fade of `v`.
    pub fn clear(&mut self, v: VertexId) {
        if let Some(entry) = self.entries.get_mut(v.index()) {
            *entry = [0.0; 4];
        }
    }
}

/// Where particles carry a vertex whose skinned position is `skinned`; `influences` as for [`final_position`].
#[inline]
pub fn displaced<'a>(skinned: DVec3, influences: impl Iterator<Item = (DVec3, Option<&'a Turn>, f64)>) -> DVec3 {
    let mut position = skinned;
    for (mut displacement, turn, weight) in influences {
        if let Some(turn) = turn {
            displacement += turn.carries(skinned);
        }
        position += displacement * weight;
    }
    position
}

/// Final position of a vertex. `influences` lists `(displacement of the particle, its turn if it has one, weight)`.
#[inline]
pub fn final_position<'a>(
    rows: &VertexRows,
    pose: &Pose,
    fades: &Fades,
    time_s: f64,
    v: VertexId,
    influences: impl Iterator<Item = (DVec3, Option<&'a Turn>, f64)>,
) -> DVec3 {
    let mut position = displaced(pose.skin(rows, v), influences);
    let offset = fades.offset(v, time_s);
    if offset != DVec3::ZERO {
        position += pose.blended_linear(rows, v) * offset;
    }
    position
}
