//! Points inside the body, hung on its skin: a point divides a chord of the body through it, and goes on to divide it in every pose.
//! So it stays between two points of the skin, wherever their bones turn; bones of its own, blended from the skin, would carry it
//! out of the body near a joint, and far from its neighbours.

use super::Tissue;
use super::sections::SECTION_MARGIN;
use crate::geometry::{SectionId, VertexId};
use crate::surgery::insert::NewVertex;
use glam::DVec3;

/// Ways that chords take: across each other, and in no plane that a blade is likely to move in, since corners lie in its walls.
const WAYS: [DVec3; 3] = [
    DVec3::new(6.0 / 7.0, 2.0 / 7.0, 3.0 / 7.0),
    DVec3::new(-3.0 / 7.0, 6.0 / 7.0, 2.0 / 7.0),
    DVec3::new(-2.0 / 7.0, -3.0 / 7.0, 6.0 / 7.0),
];

/// Faces whose projection along a chord is smaller than this, against the squared reach of their corners, are seen edge on.
const EDGE_ON: f64 = 1e-6;

/// Vertices that are kept while faces are looked at.
const RECENT: usize = 256;

/// Corners of the two faces that a chord ends on, with their shares of the point: they sum to 1.
pub(super) type Hanging = [(VertexId, f64); 6];

/// Where a chord leaves the body.
#[derive(Clone, Copy)]
struct Exit {
    /// How far from the point, metres.
    away: f64,
    /// Corners of the face there, with their shares of the place.
    corners: [(VertexId, f64); 3],
    /// False if the face is seen from outside there.
    leaves: bool,
}

/// A line through the origin, along no axis, with two directions across it.
struct Line {
    way: DVec3,
    across: [DVec3; 2],
}

/// A vertex as seen from the point, and across each line.
#[derive(Clone, Copy, Default)]
struct Seen {
    at: DVec3,
    flat: [[f64; 2]; WAYS.len()],
}

impl Tissue {
    /// What `p`, where bones alone move the tissue, hangs on: the shortest chord through it. `None` if none leaves the body both
    /// ways, or no bone moves anything. Walls are passed through. `made` lists an edit's vertices, whose rows may not be known yet. Call
    /// [`Tissue::refresh_sections`] first.
    pub(super) fn hang(&self, p: DVec3, made: &[NewVertex]) -> Option<Hanging> {
        if self.pose.joint_matrices.is_empty() {
            return None;
        }
        let known = |mut v: VertexId| {
            while v.index() >= self.rows.len() {
                v = made.iter().find(|m| m.vertex == v)?.parents[0].0;
            }
            Some(v)
        };
        let lines = WAYS.map(|way| {
            let (u, v) = way.any_orthonormal_pair();
            Line { way, across: [u, v] }
        });
        let mut exits = [[None::<Exit>; 2]; WAYS.len()];
        // faces of a section have their vertices in common
        let mut recent = [(VertexId::NONE, Seen::default()); RECENT];
        let margin = DVec3::splat(SECTION_MARGIN * self.diagonal);
        let near = |b: &(DVec3, DVec3)| lines.iter().any(|l| l.meets_box(b.0 - margin - p, b.1 + margin - p));
        let sections = self.sections.current().iter().enumerate().filter(|(_, b)| near(b));
        let faces = sections.flat_map(|(s, _)| self.mesh.section_faces(SectionId::new(s)));
        for f in faces.filter(|&f| self.mesh.face_info(f).origin != u32::MAX) {
            let [Some(a), Some(b), Some(c)] = self.mesh.face(f).map(known) else { continue };
            let seen = [a, b, c].map(|v| {
                let kept = &mut recent[v.index() % RECENT];
                if kept.0 != v {
                    let at = self.pose.skin(&self.rows, v) - p;
                    *kept = (v, Seen { at, flat: [0, 1, 2].map(|i| lines[i].across.map(|u| at.dot(u))) });
                }
                kept.1
            });
            for (i, ends) in exits.iter_mut().enumerate() {
                let Some(shares) = origin_in(seen.map(|s| s.flat[i])) else { continue };
                let corners = seen.map(|s| s.at);
                let along: f64 = shares.iter().zip(corners).map(|(w, c)| w * c.dot(lines[i].way)).sum();
                let forth = along >= 0.0;
                let end = &mut ends[usize::from(forth)];
                if end.is_none_or(|e| along.abs() < e.away) {
                    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                    let leaves = (normal.dot(lines[i].way) > 0.0) == forth;
                    *end = Some(Exit { away: along.abs(), corners: [(a, shares[0]), (b, shares[1]), (c, shares[2])], leaves });
                }
            }
        }
        let chord = |ends: [Option<Exit>; 2]| match ends {
            [Some(a), Some(b)] => (a.leaves && b.leaves && a.away + b.away > 0.0).then_some((a.away + b.away, a, b)),
            _ => None,
        };
        let (_, a, b) = exits.into_iter().filter_map(chord).min_by(|x, y| x.0.total_cmp(&y.0))?;
        let share = b.away / (a.away + b.away);
        let [a0, a1, a2] = a.corners.map(|(v, w)| (v, w * share));
        let [b0, b1, b2] = b.corners.map(|(v, w)| (v, w * (1.0 - share)));
        Some([a0, a1, a2, b0, b1, b2])
    }

    /// Where a point of the body is at rest, by what it hangs on; outside by the frame of `near`.
    pub(super) fn rest_inside(&self, near: VertexId, p: DVec3) -> DVec3 {
        let skinned = p - (self.position(near) - self.skinned(near));
        self.hang(skinned, &[]).map_or_else(|| self.to_rest(near, p), |h| h.iter().map(|&(v, w)| self.rest[v.index()] * w).sum())
    }
}

impl Line {
    /// False only if the line misses the box.
    fn meets_box(&self, low: DVec3, high: DVec3) -> bool {
        let (one, other) = (low / self.way, high / self.way);
        one.min(other).max_element() <= one.max(other).min_element()
    }
}

/// The corners' shares of the origin, if it lies in their triangle.
fn origin_in([p, q, r]: [[f64; 2]; 3]) -> Option<[f64; 3]> {
    let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
    let parts = [cross(q, r), cross(r, p), cross(p, q)];
    if parts.iter().any(|&w| w < 0.0) && parts.iter().any(|&w| w > 0.0) {
        return None;
    }
    let whole: f64 = parts.iter().sum();
    let reach = [p, q, r].iter().map(|c| c[0] * c[0] + c[1] * c[1]).fold(0.0, f64::max);
    (whole.abs() > EDGE_ON * reach).then(|| parts.map(|w| w / whole))
}
