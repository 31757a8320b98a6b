//! What a ray from the eye meets: a bounding volume hierarchy over the surface as the user sees it.

use crate::geometry::measure::vertex_normal;
use crate::geometry::{FaceId, Mesh, Plane};
use crate::physics::RigidPose;
use crate::scene::{Scene, TissueId};
use crate::tissue::{Tissue, Versions};
use glam::DVec3;
use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy};

/// A ray in model space; the direction is a unit vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: DVec3,
    /// Where it goes.
    pub direction: DVec3,
}

/// Where a ray first meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Whose surface.
    pub tissue: TissueId,
    /// Which face.
    pub face: FaceId,
    /// Weights of the face's corners, sum 1.
    pub weights: [f64; 3],
    /// Metres from the ray's origin.
    pub distance: f64,
    /// The point, model space.
    pub point: DVec3,
    /// Unit normal, smooth over the surface, outward.
    pub normal: DVec3,
    /// The face shows its outside to the ray.
    pub outside: bool,
}

/// Boxes are rounded to f32 and widened by this fraction of their coordinates, so that no face slips out of its box.
const WIDEN: f32 = 1e-6;

/// The surface of every tissue in the current pose, ready to be asked. Brought up to date when it is needed, not every frame.
#[derive(Default)]
pub struct Picker {
    tissues: Vec<Pickable>,
}

struct Pickable {
    id: TissueId,
    seen: Versions,
    frame: RigidPose,
    time_s: f64,
    /// Final positions of all vertex slots, model space.
    positions: Vec<DVec3>,
    bvh: Bvh,
}

impl Picker {
    /// Brings the hierarchy to the scene's pose: a tissue that has not changed costs nothing, one that has only moved is
    /// refitted, one that was edited is built anew.
    pub fn refresh(&mut self, scene: &Scene) {
        self.tissues.retain(|p| scene.tissue(p.id).is_some());
        for (id, tissue) in scene.tissues() {
            match self.tissues.iter_mut().find(|p| p.id == id) {
                Some(known) => known.follow(tissue),
                None => self.tissues.push(Pickable::new(id, tissue)),
            }
        }
        self.tissues.sort_by_key(|p| p.id);
    }

    /// Forgets everything: the scene is another one.
    pub fn clear(&mut self) {
        self.tissues.clear();
    }

    /// The first face on the ray. Tissues that were edited since the last [`Picker::refresh`] are not seen.
    pub fn cast(&self, scene: &Scene, ray: &Ray) -> Option<Hit> {
        let hits = self.tissues.iter().filter_map(|p| p.cast(scene.tissue(p.id)?, ray));
        hits.min_by(|a, b| a.distance.total_cmp(&b.distance))
    }

    /// Segments in which `plane` crosses the surfaces; nothing of the model is changed.
    pub fn contour(&self, scene: &Scene, plane: &Plane, out: &mut Vec<[DVec3; 2]>) {
        let mut sides = Vec::new();
        for pickable in &self.tissues {
            let Some(tissue) = scene.tissue(pickable.id).filter(|t| pickable.is_current(t)) else { continue };
            let mesh = tissue.mesh();
            sides.clear();
            sides.extend(pickable.positions.iter().map(|p| if p.is_finite() { plane.distance(*p) } else { 0.0 }));
            for f in mesh.live_faces() {
                out.extend(crossing(mesh.face(f).map(|v| (pickable.positions[v.index()], sides[v.index()]))));
            }
        }
    }

    /// Diagonal of the bounds of everything, metres, and their middle; `None` for an empty scene.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let boxes = self.tissues.iter().filter(|p| !p.bvh.is_empty()).map(|p| p.bvh.root_aabb());
        let all = boxes.reduce(|a, b| Aabb::new(a.mins.min(b.mins), a.maxs.max(b.maxs)))?;
        let wide = |v: Vector| DVec3::new(v.x.into(), v.y.into(), v.z.into());
        Some((wide(all.mins), wide(all.maxs)))
    }
}

impl Pickable {
    fn new(id: TissueId, tissue: &Tissue) -> Self {
        let mut made = Self {
            id,
            seen: tissue.versions(),
            frame: tissue.frame(),
            time_s: tissue.time_s(),
            positions: Vec::new(),
            bvh: Bvh::default(),
        };
        made.rebuild(tissue);
        made
    }

    fn follow(&mut self, tissue: &Tissue) {
        let now = tissue.versions();
        let time_s = tissue.time_s();
        let fading = time_s != self.time_s && (tissue.fades().running(time_s) || tissue.fades().running(self.time_s));
        let edited = now.structure != self.seen.structure || tissue.mesh().vertex_slots() != self.positions.len();
        if now == self.seen && tissue.frame() == self.frame && !fading && !edited {
            return;
        }
        (self.seen, self.frame, self.time_s) = (now, tissue.frame(), time_s);
        if edited {
            self.rebuild(tissue);
        } else {
            self.refit(tissue);
        }
    }

    fn place(&mut self, tissue: &Tissue) {
        self.positions.clear();
        self.positions.resize(tissue.mesh().vertex_slots(), DVec3::NAN);
        for v in tissue.mesh().live_vertices() {
            self.positions[v.index()] = tissue.to_model(tissue.position(v));
        }
    }

    fn rebuild(&mut self, tissue: &Tissue) {
        self.place(tissue);
        let leaves = tissue.mesh().live_faces().map(|f| (f.index(), self.aabb(tissue.mesh(), f)));
        self.bvh = Bvh::from_iter(BvhBuildStrategy::Binned, leaves);
    }

    fn refit(&mut self, tissue: &Tissue) {
        self.place(tissue);
        for f in tissue.mesh().live_faces() {
            let aabb = self.aabb(tissue.mesh(), f);
            self.bvh.insert_or_update_partially(aabb, f.0, 0.0);
        }
        self.bvh.refit_without_opt();
    }

    fn aabb(&self, mesh: &Mesh, f: FaceId) -> Aabb {
        let corners = mesh.face(f).map(|v| self.positions[v.index()]);
        let narrow = |p: DVec3| Vector::new(p.x as f32, p.y as f32, p.z as f32);
        let low = narrow(corners[0].min(corners[1]).min(corners[2]));
        let high = narrow(corners[0].max(corners[1]).max(corners[2]));
        Aabb::new(low - low.abs() * WIDEN, high + high.abs() * WIDEN)
    }

    /// The mesh is still the one that the hierarchy was built over.
    fn is_current(&self, tissue: &Tissue) -> bool {
        tissue.versions().structure == self.seen.structure && tissue.mesh().vertex_slots() == self.positions.len()
    }

    fn cast(&self, tissue: &Tissue, ray: &Ray) -> Option<Hit> {
        if !self.is_current(tissue) {
            return None;
        }
        let narrow = |p: DVec3| Vector::new(p.x as f32, p.y as f32, p.z as f32);
        let boxes = parry3d::query::Ray::new(narrow(ray.origin), narrow(ray.direction));
        let mesh = tissue.mesh();
        // the tree only chooses candidates, in f32; the nearest is decided in f64
        let mut nearest = f64::INFINITY;
        let mut best: Option<(FaceId, [f64; 3])> = None;
        let slack = 1.0 + 1e-5;
        self.bvh.traverse(|node| {
            use parry3d::partitioning::TraversalAction::{Continue, Prune};
            if f64::from(node.cast_ray(&boxes, f32::MAX)) > nearest * slack {
                return Prune;
            }
            if let Some(leaf) = node.leaf_data() {
                let f = FaceId(leaf);
                let corners = mesh.face(f).map(|v| self.positions[v.index()]);
                if let Some((t, weights)) = meet(ray, corners)
                    && (t < nearest || t == nearest && best.is_some_and(|b| f < b.0))
                {
                    (nearest, best) = (t, Some((f, weights)));
                }
            }
            Continue
        });
        let (face, weights) = best?;
        let corners = mesh.face(face);
        let [a, b, c] = corners.map(|v| self.positions[v.index()]);
        let flat = (b - a).cross(c - a);
        let normal = |v| vertex_normal(mesh, v, |w| self.positions[w.index()]);
        let smooth: DVec3 = corners.iter().zip(weights).map(|(&v, w)| normal(v) * w).sum();
        let normal = if smooth.dot(flat) > 0.0 { smooth.normalize() } else { flat.normalize_or(-ray.direction) };
        let point = a * weights[0] + b * weights[1] + c * weights[2];
        Some(Hit { tissue: self.id, face, weights, distance: nearest, point, normal, outside: flat.dot(ray.direction) < 0.0 })
    }
}

/// Distance along the ray and weights of the corners; `None` if the ray passes by, starts behind, or lies in the plane.
fn meet(ray: &Ray, [a, b, c]: [DVec3; 3]) -> Option<(f64, [f64; 3])> {
    let (ab, ac) = (b - a, c - a);
    let p = ray.direction.cross(ac);
    let det = ab.dot(p);
    if det == 0.0 {
        return None;
    }
    let from_a = ray.origin - a;
    let u = from_a.dot(p) / det;
    let q = from_a.cross(ab);
    let v = ray.direction.dot(q) / det;
    let t = ac.dot(q) / det;
    // a hair of tolerance, so that no ray slips through between two faces
    let least = -1e-12;
    (u >= least && v >= least && u + v <= 1.0 - least && t > 0.0).then_some((t, [1.0 - u - v, u, v]))
}

/// Where a plane crosses a triangle whose corners come with their distances.
fn crossing(corners: [(DVec3, f64); 3]) -> Option<[DVec3; 2]> {
    let mut ends = [DVec3::ZERO; 2];
    let mut found = 0;
    for k in 0..3 {
        let ((p, sp), (q, sq)) = (corners[k], corners[(k + 1) % 3]);
        if (sp >= 0.0) != (sq >= 0.0) && found < 2 {
            ends[found] = p + (q - p) * (sp / (sp - sq));
            found += 1;
        }
    }
    (found == 2).then_some(ends)
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{beam, sphere};
    use super::*;
    use crate::scene::EditCommand;
    use crate::surgery::BladePose;

    /// The first hit without any hierarchy.
    fn by_force(scene: &Scene, ray: &Ray) -> Option<(TissueId, FaceId, f64)> {
        let mut best: Option<(TissueId, FaceId, f64)> = None;
        for (id, tissue) in scene.tissues() {
            for f in tissue.mesh().live_faces() {
                let corners = tissue.mesh().face(f).map(|v| tissue.to_model(tissue.position(v)));
                if let Some((t, _)) = meet(ray, corners)
                    && best.is_none_or(|b| t < b.2)
                {
                    best = Some((id, f, t));
                }
            }
        }
        best
    }

    fn rays() -> Vec<Ray> {
        let spread = |i: usize| {
            let (a, b) = (i as f64 * 2.399_963, (i as f64 * 0.618_034).fract() * 2.0 - 1.0);
            let flat = (1.0 - b * b).sqrt();
            DVec3::new(flat * a.cos(), b, flat * a.sin())
        };
        (0..200).map(|i| Ray { origin: spread(i) * 2.0, direction: (spread(i * 7 + 3) * 0.12 - spread(i)).normalize() }).collect()
    }

    /// Rays whose answer differs from the slow search, and rays that hit.
    fn differing(picker: &Picker, scene: &Scene) -> (usize, usize) {
        let mut counts = (0, 0);
        for ray in rays() {
            let (fast, slow) = (picker.cast(scene, &ray), by_force(scene, &ray));
            let same = match (fast, slow) {
                (Some(hit), Some(slow)) => {
                    let on_ray = (hit.point - ray.origin - ray.direction * hit.distance).length() < 1e-9;
                    (hit.distance - slow.2).abs() < 1e-12 && on_ray
                }
                (fast, slow) => fast.is_none() == slow.is_none(),
            };
            counts.0 += usize::from(!same);
            counts.1 += usize::from(slow.is_some());
        }
        counts
    }

    /// A picker that has seen a ball, with its middle and radius.
    fn looked_at(scene: &Scene) -> (Picker, DVec3, f64) {
        let mut picker = Picker::default();
        picker.refresh(scene);
        let (low, high) = picker.bounds().unwrap();
        (picker, (low + high) / 2.0, (high - low).x / 2.0)
    }

    #[test]
    fn the_hierarchy_answers_as_the_slow_search_in_every_state() {
        let mut scene = beam();
        let mut picker = Picker::default();
        picker.refresh(&scene);
        let (wrong, hits) = differing(&picker, &scene);
        assert_eq!(wrong, 0);
        assert!(hits > 20 && hits < 200, "{hits} rays hit");

        scene.set_animation(Some(0));
        scene.pose(0.7, 0.7);
        assert!(differing(&picker, &scene).0 > 0, "what was not refreshed is wrong");
        picker.refresh(&scene);
        assert_eq!(differing(&picker, &scene).0, 0, "moved");

        let reports = scene.edit(EditCommand::Cut(Plane::Equation { normal: DVec3::X, offset: 0.01 }));
        assert_eq!(reports[0].pieces.len(), 2);
        picker.refresh(&scene);
        assert_eq!(differing(&picker, &scene).0, 0, "cut");
        scene.edit(EditCommand::Undo);
        picker.refresh(&scene);
        assert_eq!(differing(&picker, &scene).0, 0, "undone");
    }

    #[test]
    fn a_sphere_is_hit_where_it_is_and_its_normal_points_outward() {
        let scene = sphere();
        let (picker, middle, radius) = looked_at(&scene);
        let direction = DVec3::new(-0.3, -0.5, -0.8).normalize();
        let ray = Ray { origin: middle - direction * (3.0 * radius), direction };
        let hit = picker.cast(&scene, &ray).unwrap();
        assert!((hit.point - middle).length() > 0.98 * radius && hit.outside);
        assert!(hit.normal.dot(-direction) > 0.99, "{}", hit.normal);
        assert!((hit.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let inside = picker.cast(&scene, &Ray { origin: middle, direction }).unwrap();
        assert!(!inside.outside, "seen from inside");
        assert!(picker.cast(&scene, &Ray { origin: middle + DVec3::Y * (3.0 * radius), direction: DVec3::Y }).is_none());
    }

    #[test]
    fn a_torn_surface_lets_the_ray_through() {
        let mut scene = sphere();
        let (mut picker, middle, radius) = looked_at(&scene);
        let ray = Ray { origin: middle + DVec3::Y * (2.0 * radius), direction: DVec3::NEG_Y };
        assert!(picker.cast(&scene, &ray).is_some_and(|h| h.distance < 1.1 * radius));
        scene.edit(EditCommand::StrokeBegin { width: 0.3 * radius });
        for i in 0..=8 {
            let at = |r: f64| middle + DVec3::new(0.05 * radius * (f64::from(i) - 4.0), r, 0.0);
            scene.edit(EditCommand::StrokePose(BladePose { t: f64::from(i), tip: at(0.7 * radius), base: at(1.3 * radius) }));
        }
        scene.edit(EditCommand::StrokeEnd);
        assert!(picker.cast(&scene, &ray).is_none(), "edited, and not looked at again");
        picker.refresh(&scene);
        let hit = picker.cast(&scene, &ray).unwrap();
        assert!(hit.distance > 2.9 * radius && !hit.outside, "the far wall, from inside");
    }

    /// What comes off does so when the blade leaves, although nothing is cut then.
    #[test]
    fn what_has_come_off_is_seen_where_it_went() {
        let mut scene = sphere();
        let (mut picker, middle, radius) = looked_at(&scene);
        scene.edit(EditCommand::StrokeBegin { width: 0.02 * radius });
        for i in 0..=40 {
            let at = |z: f64| middle + radius * DVec3::new(0.1 * f64::from(i) - 1.5, 0.3, z);
            scene.edit(EditCommand::StrokePose(BladePose { t: f64::from(i), tip: at(-1.5), base: at(1.5) }));
        }
        picker.refresh(&scene);
        let reports = scene.edit(EditCommand::StrokeEnd);
        assert_eq!(reports[0].pieces.len(), 2);
        picker.refresh(&scene);
        let (wrong, hits) = differing(&picker, &scene);
        assert!(wrong == 0 && hits > 20, "{wrong} of {hits}");
    }

    #[test]
    fn a_contour_lies_on_plane_and_surface() {
        let scene = sphere();
        let (picker, middle, radius) = looked_at(&scene);
        let plane = |by: f64| {
            let normal = DVec3::new(1.0, 2.0, -0.5).normalize();
            Plane::Equation { normal, offset: normal.dot(middle) + by * radius }
        };
        let mut segments = Vec::new();
        picker.contour(&scene, &plane(0.2), &mut segments);
        let length: f64 = segments.iter().map(|[a, b]| a.distance(*b)).sum();
        let circle = 2.0 * std::f64::consts::PI * radius * (1.0f64 - 0.04).sqrt();
        assert!((length / circle - 1.0).abs() < 0.02, "{length} of {circle}");
        assert!(segments.iter().flatten().all(|p| plane(0.2).distance(*p).abs() < 1e-9));
        segments.clear();
        picker.contour(&scene, &plane(1.5), &mut segments);
        assert!(segments.is_empty());
    }
}
