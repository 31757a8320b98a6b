//! Points inside the body, hung on its skin: a point divides a chord of the body through it, and goes on to divide it in every pose.
//! So it stays between two points of the skin, wherever their bones turn; bones of its own, blended from the skin, would carry it
//! out of the body near a joint, and far from its neighbours.

use super::Tissue;
use super::positions::Skins;
use super::sections::SECTION_MARGIN;
use crate::geometry::{FaceId, SectionId, VertexId};
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

/// Corners of the two faces that a chord ends on, with their shares of the point: they sum to 1.
pub(super) type Hanging = [(VertexId, f64); 6];

/// What a search for chords needs, kept between edits.
#[derive(Clone, Debug, Default)]
pub(super) struct ChordScratch {
    pub(super) skins: Skins,
    /// Sections that a chord may pass through, and how far from the point it may enter them, metres.
    ahead: Vec<(f64, u32)>,
}

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

impl Tissue {
    /// What `p`, where bones alone move the tissue, hangs on: the shortest of three chords through it. That which goes most straight
    /// through the skin at `near` comes first: it bounds what the others have to look at. `None` if none leaves the body both ways, or
    /// no bone moves anything. Walls are passed through. `made` lists an edit's vertices, whose rows may not be known yet. Call
    /// [`Tissue::refresh_sections`] first.
    pub(super) fn hang(&self, near: VertexId, p: DVec3, made: &[NewVertex], scratch: &mut ChordScratch) -> Option<Hanging> {
        if self.pose.joint_matrices.is_empty() {
            return None;
        }
        let ChordScratch { skins, ahead } = scratch;
        skins.refresh(self);
        let known = |mut v: VertexId| {
            while v.index() >= self.rows.len() {
                v = made.iter().find(|m| m.vertex == v)?.parents[0].0;
            }
            Some(v)
        };
        let is_skin = |f: &FaceId| !self.mesh.face_info(*f).is_interior();
        let fan = self.mesh.vertex_is_live(near).then(|| self.mesh.fan(near));
        let mut normal = DVec3::ZERO;
        for f in fan.into_iter().flatten().map(|h| h.face()).filter(is_skin) {
            if let [Some(a), Some(b), Some(c)] = self.mesh.face(f).map(known) {
                let [a, b, c] = [a, b, c].map(|v| skins.of(self, v));
                normal += (b - a).cross(c - a);
            }
        }
        let mut ways = WAYS;
        ways.sort_by(|a, b| b.dot(normal).abs().total_cmp(&a.dot(normal).abs()));
        let mut best: Option<(f64, Hanging)> = None;
        for way in ways {
            let limit = best.map_or(f64::INFINITY, |b| b.0);
            best = self.chord(p, way, limit, known, skins, ahead).or(best);
        }
        best.map(|b| b.1)
    }

    /// Length and ends of the chord of the body through `p` along a way, if it is shorter than `limit`.
    fn chord(
        &self,
        p: DVec3,
        way: DVec3,
        limit: f64,
        known: impl Fn(VertexId) -> Option<VertexId>,
        skins: &Skins,
        ahead: &mut Vec<(f64, u32)>,
    ) -> Option<(f64, Hanging)> {
        let (across, inverse) = (way.any_orthonormal_pair(), way.recip());
        let margin = DVec3::splat(SECTION_MARGIN * self.diagonal);
        let span = |(low, high): (DVec3, DVec3)| line_in_box(inverse, low - margin - p, high + margin - p);
        let away = |bounds: (DVec3, DVec3)| span(bounds).map(|(from, to)| from.max(-to)).filter(|&away| away <= limit);
        ahead.clear();
        let groups = self.sections.groups().filter(|(_, bounds)| away(*bounds).is_some());
        ahead.extend(groups.flat_map(|(group, _)| group).filter_map(|s| Some((away(self.sections.of(s))?, s as u32))));
        // what is near shows how far the chord goes, back and forth: what lies beyond need not be looked at
        ahead.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut exits = [None::<Exit>; 2];
        let mut limits = [limit; 2];
        for &(_, s) in ahead.iter() {
            if span(self.sections.of(s as usize)).is_none_or(|(from, to)| from.max(-limits[0]) > to.min(limits[1])) {
                continue;
            }
            let is_skin = |f: &FaceId| !self.mesh.face_info(*f).is_interior();
            for f in self.mesh.section_faces(SectionId(s)).filter(is_skin) {
                let [Some(a), Some(b), Some(c)] = self.mesh.face(f).map(&known) else { continue };
                let corners = [a, b, c].map(|v| skins.of(self, v) - p);
                let aside = corners.map(|c| c.dot(across.0));
                if aside.iter().all(|&x| x > 0.0) || aside.iter().all(|&x| x < 0.0) {
                    continue;
                }
                let Some(shares) = origin_in([0, 1, 2].map(|k| [aside[k], corners[k].dot(across.1)])) else { continue };
                let along: f64 = shares.iter().zip(corners).map(|(w, c)| w * c.dot(way)).sum();
                let forth = along >= 0.0;
                let end = &mut exits[usize::from(forth)];
                if end.is_none_or(|e| along.abs() < e.away) {
                    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                    let leaves = (normal.dot(way) > 0.0) == forth;
                    limits[usize::from(forth)] = along.abs().min(limit);
                    *end = Some(Exit { away: along.abs(), corners: [(a, shares[0]), (b, shares[1]), (c, shares[2])], leaves });
                }
            }
        }
        let [Some(a), Some(b)] = exits else { return None };
        let length = a.away + b.away;
        if !(a.leaves && b.leaves && length > 0.0 && length < limit) {
            return None;
        }
        let share = b.away / length;
        let [a0, a1, a2] = a.corners.map(|(v, w)| (v, w * share));
        let [b0, b1, b2] = b.corners.map(|(v, w)| (v, w * (1.0 - share)));
        Some((length, [a0, a1, a2, b0, b1, b2]))
    }
}

/// From where to where, along it, the line through the origin lies in a box; `inverse` has one over its direction's coordinates.
fn line_in_box(inverse: DVec3, low: DVec3, high: DVec3) -> Option<(f64, f64)> {
    let (one, other) = (low * inverse, high * inverse);
    let (from, to) = (one.min(other).max_element(), one.max(other).min_element());
    (from <= to).then_some((from, to))
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
