//! Cavities that a cut did not reach stay with the piece around them.

use super::Tissue;
use super::surface::{bounds, boxes_meet};
use crate::geometry::{FaceId, HalfEdge, Part, Plane, VertexId};
use glam::DVec3;

/// Directions tried for a ray that meets no edge and no vertex.
const MOST_RAYS: usize = 24;

impl Tissue {
    /// The connected components after a cut along `plane` (tissue space) with `rim`, by their lowest face. A component without
    /// rim whose faces point inward is a cavity: it joins the piece around it, the innermost if there are several. All others
    /// are pieces of their own.
    pub fn parts_after_cut(&mut self, plane: &Plane, rim: &[[HalfEdge; 2]]) -> Vec<Part> {
        let mut parts = self.parts();
        // the cut left at least one component on each side
        if parts.len() < 3 {
            return parts;
        }
        let mut cut: Vec<FaceId> = rim.iter().flatten().map(|h| h.face()).collect();
        cut.sort_unstable();
        let is_cut = |p: &Part| p.loose.iter().any(|f| cut.binary_search(f).is_ok());
        let measured: Vec<_> = parts.iter().map(|p| self.measure_part(p).measures).collect();
        let is_cavity: Vec<bool> = parts.iter().zip(&measured).map(|(p, m)| m.closed() && m.volume < 0.0 && !is_cut(p)).collect();
        let around: Vec<Option<usize>> = (0..parts.len())
            .map(|c| {
                if !is_cavity[c] {
                    return None;
                }
                let from = self.farthest_from(plane, &parts[c]);
                let holds = |&k: &usize| !is_cavity[k] && self.winding(plane, &parts[k], from) > 0;
                (0..parts.len()).filter(holds).min_by(|&a, &b| measured[a].volume.total_cmp(&measured[b].volume))
            })
            .collect();
        for c in (0..parts.len()).rev() {
            if let Some(around) = around[c] {
                let cavity = parts[c].take();
                parts[around].absorb(cavity);
            }
        }
        parts.retain(|p| p.faces > 0);
        parts.sort_unstable_by_key(|p| p.lowest_face);
        parts
    }

    /// Components that are cavities of others: of a stroke's or a bounded cut's `parts` those of `kept`, as indices, that lie inside a
    /// part which is not, each with the part around it. Parts that are open have no inside.
    pub(crate) fn severed_cavities(&self, parts: &[Part], kept: &[usize]) -> Vec<(usize, usize)> {
        if kept.len() < 2 || kept.len() == parts.len() {
            return Vec::new(); // nothing but the body itself stays, or all does
        }
        let volume = |k: usize| Some(self.measure_part(&parts[k]).measures).filter(|m| m.closed()).map(|m| m.volume);
        // what has come off is small: it is measured first
        let bodies: Vec<usize> = (0..parts.len()).filter(|k| !kept.contains(k) && volume(*k).is_some_and(|v| v > 0.0)).collect();
        let plane = Plane::Equation { normal: DVec3::new(0.36, 0.48, 0.8), offset: 0.0 };
        let around = |c: usize| {
            let from = self.position(self.mesh.face(parts[c].all_faces(&self.mesh).next()?)[0]);
            let holds = |k: &usize| *k != c && self.winding(&plane, &parts[*k], from) > 0;
            if !bodies.iter().any(holds) || volume(c).is_none_or(|v| v >= 0.0) {
                return None;
            }
            let holding = (0..parts.len()).filter(holds).filter_map(|k| Some((k, volume(k).filter(|v| *v > 0.0)?)));
            holding.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, _)| (c, k))
        };
        kept.iter().filter_map(|&c| around(c)).filter(|(_, k)| !kept.contains(k)).collect()
    }

    fn farthest_from(&self, plane: &Plane, part: &Part) -> DVec3 {
        let corners = part.all_faces(&self.mesh).flat_map(|f| self.mesh.face(f)).map(|v| self.position(v));
        let away = |p: &DVec3| plane.distance(*p).abs();
        corners.max_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or_default()
    }

    /// How often a part of a cut surface winds around `p`, which lies off the plane: counted along a ray parallel to the plane,
    /// which does not meet what the plane took away, capped or not.
    fn winding(&self, plane: &Plane, part: &Part, p: DVec3) -> i32 {
        let u = plane.normal().any_orthonormal_vector();
        let v = plane.normal().cross(u);
        // far beyond all that is seen
        let (low, high) = self.sections_extent();
        let reach = 2.0 * (high.max(p) - low.min(p)).length().max(self.diagonal);
        let rays = (0..MOST_RAYS).map(|i| {
            let (sin, cos) = (0.7 + i as f64).sin_cos();
            p + (u * cos + v * sin) * reach
        });
        let mut last = 0;
        for q in rays {
            let (count, sound) = self.crossings(part, p, q);
            last = count;
            if sound {
                break;
            }
        }
        last
    }

    /// Crossings of the segment from `p` to `q` with a part's faces: out of it less into it. False if it touches an edge or a
    /// vertex.
    fn crossings(&self, part: &Part, p: DVec3, q: DVec3) -> (i32, bool) {
        let at = |p: DVec3| robust::Coord3D { x: p.x, y: p.y, z: p.z };
        let (low, high) = (p.min(q), p.max(q));
        let (up, down) = self.widening();
        let near = part.sections.iter().filter(|s| {
            let (section_low, section_high) = self.sections.of(s.index());
            boxes_meet((section_low - down, section_high + up), (low, high))
        });
        let (mut count, mut sound) = (0, true);
        let faces = near.flat_map(|&s| self.mesh.section_faces(s)).chain(part.loose.iter().copied());
        for corners in faces.map(|f| self.mesh.face(f).map(|v: VertexId| self.position(v))) {
            if !boxes_meet(bounds(corners), (low, high)) {
                continue;
            }
            let [a, b, c] = corners;
            let side = |x: DVec3| robust::orient3d(at(a), at(b), at(c), at(x));
            let (from, to) = (side(p), side(q));
            let turns = [(a, b), (b, c), (c, a)].map(|(x, y)| robust::orient3d(at(p), at(q), at(x), at(y)));
            let (left, right) = (turns.iter().all(|&t| t >= 0.0), turns.iter().all(|&t| t <= 0.0));
            if from * to > 0.0 || !(left || right) {
                continue;
            }
            if from == 0.0 || to == 0.0 || turns.contains(&0.0) {
                sound = false;
                continue;
            }
            // leaving if the ray's end is in front of the face: `orient3d` is negative there
            count += if to < 0.0 { 1 } else { -1 };
        }
        (count, sound)
    }
}
