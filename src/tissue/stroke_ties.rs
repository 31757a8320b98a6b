//! What holds the blade's pending quads to moving tissue (MATHS 5.5).

use super::TearStroke;
use super::joint_fit::Pins;
use super::strip_ends::nearest_vertex;
use crate::geometry::VertexId;
use crate::surgery::{JointId, PendingQuad};
use crate::tissue::Tissue;
use glam::DVec3;

/// A quad goes with so many vertices at most: where it does not go through a face, those at its end of the slot on both lips. One alone may
/// hang by a bone that its neighbours do not.
const TIED: usize = 4;

/// A pending quad tied to the tissue by the frames of vertices near it, of which it takes the mean (MATHS 5.5): that keeps what is plane
/// plane. Those of the face that it goes through weigh as they do where it goes through, which stays with the skin so. One that a box has
/// ended at is fitted to the vertices on it, too.
pub(super) struct Tie {
    serial: u32,
    joint: Option<JointId>,
    pins: Pins,
    anchors: Anchors,
    /// The quad at rest, for each of the vertices: seen from the point of the skin, if there is one, else from the vertex.
    rest: [[DVec3; 4]; TIED],
    posed: [DVec3; 4],
}

/// Vertices, then [`VertexId::NONE`].
type Few = [VertexId; TIED];

fn only(v: VertexId) -> Few {
    let mut few = [VertexId::NONE; TIED];
    few[0] = v;
    few
}

/// What a quad is tied to.
#[derive(Clone, Copy)]
struct Anchors {
    vertices: Few,
    /// They add up to 1.
    weights: [f64; TIED],
    /// The point of the skin that they give, if they are corners of a face.
    point: Option<DVec3>,
}

impl Anchors {
    /// Vertices that weigh all alike.
    fn alike(vertices: Few) -> Self {
        let count = vertices.iter().filter(|v| v.is_some()).count() as f64;
        Self { vertices, weights: vertices.map(|v| if v.is_some() { 1.0 / count } else { 0.0 }), point: None }
    }

    fn are_any(&self) -> bool {
        self.vertices[0].is_some()
    }
}

impl Tie {
    fn new(tissue: &Tissue, quad: &PendingQuad<'_>, anchors: Anchors) -> Self {
        let Anchors { vertices, point, .. } = anchors;
        let (serial, joint, posed) = (quad.serial, quad.joint, *quad.corners);
        let at_rest = |v: VertexId| {
            if v.is_some() { posed.map(tissue.rest_frame(v, point.unwrap_or_else(|| tissue.position(v)))) } else { posed }
        };
        let mut tie = Self { serial, joint, pins: Pins::default(), anchors, rest: vertices.map(at_rest), posed };
        tie.posed = tie.carried(tissue);
        tie
    }

    /// The same, fitted to vertices on the joint that it is.
    fn pinned(mut self, on_joint: impl Iterator<Item = VertexId> + Clone, position: impl Fn(VertexId) -> DVec3) -> Self {
        self.pins = Pins::new(&self.posed, on_joint, position);
        self
    }

    fn vertices(&self) -> impl Iterator<Item = VertexId> + '_ {
        self.anchors.vertices.iter().copied().take_while(|v| v.is_some())
    }

    /// Where the quad's corners are now; `position` gives those of live vertices.
    fn corners(&self, tissue: &Tissue, position: impl Fn(VertexId) -> DVec3) -> [DVec3; 4] {
        self.pins.fit(self.carried(tissue), |v| tissue.mesh.vertex_is_live(v).then(|| position(v)))
    }

    /// Where the frames alone carry them.
    fn carried(&self, tissue: &Tissue) -> [DVec3; 4] {
        let mut sums = [DVec3::ZERO; 4];
        for ((v, corners), weight) in self.vertices().zip(&self.rest).zip(self.anchors.weights) {
            let to_posed = tissue.posed_frame(v);
            sums.iter_mut().zip(corners).for_each(|(sum, &p)| *sum += to_posed(p) * weight);
        }
        sums
    }
}

/// The live ones of `vertices` that are seen nearest to `p` and within `reach` of it, nearest first, each once.
fn nearest_few(tissue: &Tissue, vertices: &[VertexId], (p, reach): (DVec3, f64), position: &impl Fn(VertexId) -> DVec3) -> Few {
    let mut found = [(f64::INFINITY, VertexId::NONE); TIED];
    for &v in vertices.iter().filter(|v| tissue.mesh.vertex_is_live(**v)) {
        let near = (position(v).distance_squared(p), v);
        let is_nearer = |a: (f64, VertexId), b: (f64, VertexId)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).is_lt();
        if near.0 > reach * reach || found.contains(&near) || !is_nearer(near, found[TIED - 1]) {
            continue;
        }
        let at = found.iter().position(|f| is_nearer(near, *f)).unwrap_or(TIED - 1);
        found[at..].rotate_right(1);
        found[at] = near;
    }
    found.map(|f| f.1)
}

/// The corners of the face where a blade, tip and top, first goes through the skin, and how they weigh there.
fn through(tissue: &Tissue, [tip, top]: [DVec3; 2], position: &impl Fn(VertexId) -> DVec3) -> Option<Anchors> {
    let (along, face) = tissue.blade_entry_at(tip, top, position)?;
    let corners = tissue.mesh.face(face);
    let [a, b, c] = corners.map(position);
    let normal = (b - a).cross(c - a);
    let p = top.lerp(tip, along);
    let share = |q: DVec3, r: DVec3| (q - p).cross(r - p).dot(normal) / normal.length_squared();
    let weights = [share(b, c), share(c, a), share(a, b)];
    let is_inside = weights.iter().all(|w| (-0.01..=1.01).contains(w));
    is_inside.then(|| Anchors {
        vertices: [corners[0], corners[1], corners[2], VertexId::NONE],
        weights: [weights[0], weights[1], weights[2], 0.0],
        point: Some(p),
    })
}

impl TearStroke {
    /// Moves the pending quads with the tissue (MATHS 5.5). Those it has not moved keep their bits.
    pub(super) fn follow_tissue(&mut self, tissue: &Tissue) {
        let Self { stroke, ties, pose_tie, ended, positions, has_moved, .. } = self;
        if let Some(tie) = pose_tie {
            let now = tie.carried(tissue);
            if now != tie.posed {
                let by = |k: usize| now[k] - tie.posed[k];
                stroke.carry([[by(0), by(1)], [by(2), by(3)]]);
            }
        }
        for quad in stroke.builder().pending_quads_mut() {
            let Some(tie) = ties.iter_mut().find(|t| t.serial == quad.serial) else { continue };
            let mut moved = false;
            for (k, now) in tie.corners(tissue, |v| positions.of(tissue, v)).into_iter().enumerate() {
                if now != tie.posed[k] {
                    quad.corners[k] += now - tie.posed[k];
                    tie.posed[k] = now;
                    moved = true;
                }
            }
            if moved {
                ended.iter_mut().filter(|e| e.joint == quad.joint).for_each(|e| e.moved = true);
                *has_moved = true;
            }
        }
    }

    /// Ties the pending quads: one that a slit has just ended in to the slit's end, which the next strip has to start from, others to the
    /// nearest live vertices. A tie whose vertices live is kept, but for that.
    pub(super) fn tie_quads(&mut self, tissue: &Tissue) {
        let Self { stroke, ties, near, nearby, candidates, positions, ended, slits, .. } = self;
        nearby.clear();
        nearby.extend_from_slice(near);
        for chain in stroke.builder().open_chains() {
            // what the other lane's last box has touched
            nearby.extend(ended.iter().filter(|e| e.chain == chain).flat_map(|e| &e.near));
        }
        let pending = stroke.builder().pending_quads_mut();
        let mut kept = 0;
        for quad in pending {
            let corners = *quad.corners;
            let [tip, top] = [(corners[0] + corners[1]) / 2.0, (corners[2] + corners[3]) / 2.0];
            let end = slits.end_on(tissue, [tip, top]);
            let is_there = |t: &Tie| t.vertices().all(|v| tissue.mesh.vertex_is_live(v));
            let keeps = |t: &Tie| t.joint == quad.joint && is_there(t) && end.is_none_or(|v| t.anchors.vertices == only(v));
            let old = ties[kept..].iter().position(|t| t.serial == quad.serial && keeps(t));
            if let Some(at) = old {
                ties.swap(kept, kept + at);
                kept += 1;
                continue;
            }
            // the blade may have gone elsewhere since the last box
            let reach = 2.0 * corners[0].distance(corners[2]);
            let seen = |v| positions.of(tissue, v);
            let through = || through(tissue, [tip, top], &seen);
            let near = || Some(Anchors::alike(nearest_few(tissue, nearby, (top, reach), &seen))).filter(Anchors::are_any);
            let nearest = || nearest_vertex(tissue, candidates, top, &seen).or_else(|| tissue.any_vertex_near(top));
            let one = |v| Anchors::alike(only(v));
            let anchors = end.map(one).or_else(through).or_else(near).or_else(|| nearest().map(one));
            if let Some(anchors) = anchors {
                let boxes = ended.iter().filter(|e| quad.joint.is_some() && e.joint == quad.joint);
                let on_joint = boxes.flat_map(|e| &e.tags).map(|t| t.vertex);
                ties.insert(kept, Tie::new(tissue, &quad, anchors).pinned(on_joint, seen));
                kept += 1;
            }
        }
        ties.truncate(kept);
        // the newest sample is the nearest to the newest pose
        let newest = ties.iter().max_by_key(|t| t.serial).map(|t| Anchors { point: None, ..t.anchors });
        self.pose_tie = newest.zip(self.stroke.carried()).map(|(anchors, [[tip, base], [sample_tip, sample_base]])| {
            let anchors = through(tissue, [tip, base], &|v| positions.of(tissue, v)).unwrap_or(anchors);
            let mut corners = [tip, base, sample_tip, sample_base];
            Tie::new(tissue, &PendingQuad { serial: 0, joint: None, corners: &mut corners }, anchors)
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tissue::TissueSettings;

    fn tissue(model: &str) -> Tissue {
        let settings =
            TissueSettings { particles: None, network: Default::default(), opening_s: 0.2, section_faces: 64, fade_s: 0.25 };
        Tissue::new(crate::formats::load(model).unwrap(), &settings).unwrap()
    }

    #[test]
    fn the_nearest_few_come_in_order_each_once_and_within_reach() {
        let tissue = tissue("beam");
        let all: Vec<VertexId> = tissue.mesh.live_vertices().collect();
        let twice: Vec<VertexId> = all.iter().rev().chain(&all).copied().collect();
        let p = DVec3::new(0.01, 0.03, 0.02);
        let away = |v: &VertexId| tissue.position(*v).distance(p);
        let mut sorted = all.clone();
        sorted.sort_by(|a, b| away(a).total_cmp(&away(b)).then(a.cmp(b)));
        let seen = |v| tissue.position(v);
        assert_eq!(nearest_few(&tissue, &twice, (p, f64::INFINITY), &seen)[..], sorted[..TIED]);
        let reach = 0.5 * (away(&sorted[0]) + away(&sorted[TIED - 1]));
        let within = sorted.iter().filter(|v| away(v) <= reach).count();
        let few = nearest_few(&tissue, &twice, (p, reach), &seen);
        assert_eq!(few.iter().filter(|v| v.is_some()).count(), within);
        assert!((1..TIED).contains(&within) && few[..within] == sorted[..within]);
    }

    /// Vertices that hang by different bones carry a quad to places of their own; their mean is as flat as what it was.
    #[test]
    fn a_tied_quad_stays_plane_while_the_tissue_bends() {
        let mut tissue = tissue("beam");
        let quad = [[0.0, 0.0, 0.0], [0.0, 0.01, 0.001], [0.02, 0.01, 0.001], [0.02, 0.0, 0.0]].map(DVec3::from_array);
        let (low, high) = tissue.bounds();
        let at = |share: f64| tissue.any_vertex_near(low.lerp(high, share)).unwrap();
        let vertices = [at(0.2), at(0.45), at(0.7), at(0.9)];
        let mut corners = quad;
        let tie = Tie::new(&tissue, &PendingQuad { serial: 0, joint: None, corners: &mut corners }, Anchors::alike(vertices));
        let animation = tissue.rig.animation_by_name("bend");
        tissue.set_pose(0.3, animation, 0.3);
        let height = |q: [DVec3; 4]| (q[1] - q[0]).cross(q[3] - q[0]).normalize().dot(q[2] - q[0]).abs();
        let (mean, one) = (tie.carried(&tissue), quad.map(|p| tissue.posed_frame(vertices[3])(p)));
        assert!(mean.iter().zip(quad).any(|(a, b)| a.distance(b) > 1e-3), "the tissue has moved");
        assert!(mean.iter().zip(one).any(|(a, b)| a.distance(b) > 1e-3), "and not all alike");
        assert!(height(mean) < 1e-12, "{}", height(mean));
    }
}
