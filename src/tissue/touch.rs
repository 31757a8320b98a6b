//! A tissue in the rigid world: where it stands, and what its skin touches (MATHS 4.4).

use super::Tissue;
use crate::geometry::measure::{Measures, vertex_normal};
use crate::geometry::{ParticleId, VertexId};
use crate::physics::{BodyId, Contacts, RigidPose, RigidWorld, Skin};
use glam::{DVec3, Vec3, Vec4};

/// Radius of the particles' collider spheres under the skin, in particle spacings: neighbouring ones overlap.
const COLLIDER_RADIUS: f64 = 0.8;
/// Density of tissue, kg/m^3: what masses of particles and pieces are guessed from.
pub const DENSITY: f64 = 1000.0;

/// Skin and contacts of a tissue, kept between frames.
#[derive(Default)]
pub(super) struct Touch {
    pub contacts: Contacts,
    anchors: Vec<Option<DVec3>>,
    normals: Vec<DVec3>,
    rest_normals: Vec<DVec3>,
    /// Structure and pose that the skin was made for.
    made_for: Option<(u64, u64, usize)>,
    seen_frame: RigidPose,
}

impl Tissue {
    /// Carries tissue space to model space: a translation until the tissue falls.
    pub fn frame(&self) -> RigidPose {
        self.frame
    }

    /// Puts the tissue elsewhere; nonsense is ignored.
    pub fn set_frame(&mut self, frame: RigidPose) {
        if let Some(frame) = frame.checked() {
            self.frame = frame;
        }
    }

    /// Where the tissue stands as loaded.
    pub fn home(&self) -> RigidPose {
        RigidPose::at(self.offset)
    }

    /// A point of model space in tissue space.
    pub fn to_tissue(&self, p: DVec3) -> DVec3 {
        self.frame.point_in(p)
    }

    /// A point of tissue space in model space.
    pub fn to_model(&self, p: DVec3) -> DVec3 {
        self.frame.point(p)
    }

    /// Finds what touches the skin at the end of a step of `h` seconds and holds those particles at the bodies' surfaces. `own`:
    /// the tissue's own body, if it is loose. To be called after the world's step and before [`Tissue::step`]; then
    /// [`Tissue::react`]. Costs nothing while there is no body, or nothing moves: `world_rests` says [`RigidWorld::is_resting`], which is
    /// the same for all tissues.
    pub fn touch(&mut self, (world, world_rests): (&mut RigidWorld, bool), own: Option<BodyId>, h: f64) {
        if (world.is_empty() && self.touch.contacts.is_empty()) || self.layer.is_none() {
            return;
        }
        let stale = self.refresh_skin();
        let asleep = self.layer.as_ref().is_some_and(|l| !l.network.awake());
        let moved = std::mem::replace(&mut self.touch.seen_frame, self.frame) != self.frame;
        if asleep && !stale && !moved && world_rests && !self.touch.contacts.has_lost_a_body(world) {
            return;
        }
        let Some(layer) = &mut self.layer else { return };
        let Touch { contacts, anchors, normals, .. } = &mut self.touch;
        let grabs = &self.scratch.hands.grabs;
        let skin = Skin { anchors, normals, radius: COLLIDER_RADIUS * layer.settings.spacing };
        let had = !contacts.is_empty();
        let grabbed = |p| grabs.iter().any(|g| g.0 == p);
        let stirred = !asleep || stale || moved;
        contacts.update(world, (&self.frame, own), &skin, (&layer.network, stirred), h, grabbed);
        if had || !contacts.is_empty() {
            self.apply_holds();
        }
    }

    /// Puts the reaction of what touches, and of what hands hold, on the bodies. To be called after [`Tissue::step`].
    pub fn react(&self, world: &mut RigidWorld, own: Option<BodyId>) {
        if let Some(layer) = &self.layer
            && !self.touch.contacts.is_empty()
        {
            self.touch.contacts.react(world, (&self.frame, own), &layer.network, layer.particle_mass);
        }
        if let (Some(layer), Some(own)) = (&self.layer, own) {
            let share = 1.0 / self.scratch.hands.grabs.len().max(1) as f64;
            for &(particle, _) in &self.scratch.hands.grabs {
                let by = self.frame.direction(layer.network.displacement(particle));
                world.carry(own, self.particle_in_model(particle), by, share);
            }
        }
    }

    /// Where a particle is, model space.
    pub fn particle_in_model(&self, particle: ParticleId) -> DVec3 {
        let Some(layer) = &self.layer else { return self.frame.translation };
        let anchor = layer.map.anchors[particle.index()];
        self.to_model(if anchor.is_some() { self.skinned(anchor) } else { DVec3::ZERO } + layer.network.displacement(particle))
    }

    /// The displacement that takes a particle to a place in model space.
    pub fn displacement_to(&self, particle: ParticleId, place: DVec3) -> DVec3 {
        let anchor = self.layer.as_ref().map_or(VertexId::NONE, |l| l.map.anchors[particle.index()]);
        if anchor.is_some() { self.to_tissue(place) - self.skinned(anchor) } else { DVec3::ZERO }
    }

    /// Share of its vertices' weights that the skeleton's first joint has; 0 without a skeleton.
    pub fn root_weight(&self) -> f64 {
        let of = |v: VertexId| {
            self.rows.bones.row(v.index()).iter().filter(|b| b.joint == 0).map(|b| f64::from(b.weight)).sum::<f64>()
        };
        self.mesh.live_vertices().map(of).sum()
    }

    /// Number of particles that were tested against rigid bodies so far.
    pub fn contact_tests(&self) -> u64 {
        self.touch.contacts.visited()
    }

    /// Number of particles that rigid bodies hold.
    pub fn contact_count(&self) -> usize {
        self.touch.contacts.targets().len()
    }

    /// Hands the particles that hands and bodies hold to the network.
    pub(super) fn apply_holds(&mut self) {
        let Some(layer) = &mut self.layer else { return };
        self.scratch.all_held.clear();
        self.scratch.all_held.extend_from_slice(&self.scratch.hands.grabs);
        self.scratch.all_held.extend_from_slice(self.touch.contacts.targets());
        layer.network.set_grabs(&self.scratch.all_held);
    }

    /// Lets go of everything that bodies hold.
    pub fn let_go(&mut self) {
        self.touch.contacts.clear();
        self.apply_holds();
    }

    /// Brings anchors and normals to the pose. True if there was anything to do.
    fn refresh_skin(&mut self) -> bool {
        let Some(layer) = &self.layer else { return false };
        let wanted = (self.versions.structure, self.versions.pose, layer.map.len());
        if self.touch.made_for == Some(wanted) {
            return false;
        }
        let same_structure = self.touch.made_for.is_some_and(|made| (made.0, made.2) == (wanted.0, wanted.2));
        let Self { mesh, rest, rows, pose, touch, .. } = self;
        if !same_structure {
            touch.rest_normals.clear();
            let normal = |a: VertexId| vertex_normal(mesh, a, |v| rest[v.index()]);
            let normals = layer.map.anchors.iter().map(|&a| if a.is_some() { normal(a) } else { DVec3::ZERO });
            touch.rest_normals.extend(normals);
        }
        touch.anchors.clear();
        touch.normals.clear();
        for (&anchor, &rest_normal) in layer.map.anchors.iter().zip(&touch.rest_normals) {
            let live = anchor.is_some();
            touch.anchors.push(live.then(|| pose.skin(rows, anchor)));
            let turned = if live { pose.blended_carry(rows, anchor, rest_normal) } else { DVec3::ZERO };
            touch.normals.push(turned.normalize_or_zero());
        }
        touch.made_for = Some(wanted);
        true
    }

    /// Mass guessed from the volume that the surface encloses at rest, at least that of a skin of a hundredth of the diagonal, kg: the
    /// same in every pose, and pieces weigh together what the whole did.
    pub fn mass_guess(&self) -> f64 {
        let rest = self.measure_at_rest();
        let middle = 0.5 * (rest.min + rest.max);
        let volume = (rest.volume - middle.dot(rest.vector_area) / 3.0).abs();
        let scale = self.rest_scale;
        let mass = DENSITY * scale * scale * (scale * volume).max(0.01 * self.diagonal * rest.area);
        if mass.is_finite() { mass.max(1e-9) } else { 1.0 }
    }

    /// Sums and extremes of the surface in the space of its rows, without its edges: nothing is posed for it.
    pub fn measure_at_rest(&self) -> Measures {
        let mut measures = Measures::EMPTY;
        measures.add_faces(&self.mesh, self.mesh.live_faces(), |v| self.rest[v.index()]);
        measures
    }

    /// To be called once the diagonal is known.
    pub(super) fn find_rest_scale(&mut self) {
        let scale = self.diagonal / self.measure_at_rest().diagonal();
        self.rest_scale = if scale.is_finite() && scale > 0.0 { scale } else { 1.0 };
    }

    /// Vertices whose hull is nearly that of the tissue as it is seen: the farthest in `count` directions, of a fine mesh among some
    /// thousands of its vertices. Of what is thin along an axis, directions are those to points of a sphere that is as thin.
    pub fn hull_vertices(&self, count: usize) -> Vec<VertexId> {
        const MOST_VERTICES: usize = 4096;
        const THIN: f32 = 0.25;
        let stride = (self.mesh.vertex_slots() / MOST_VERTICES).max(1);
        let posed = self.posed();
        let mut middle = None;
        let from_first = |v: VertexId| {
            let p = posed.position(v);
            (v, (p - *middle.get_or_insert(p)).as_vec3())
        };
        let points: Vec<(VertexId, Vec3)> = self.mesh.live_vertices().step_by(stride).map(from_first).collect();
        let bounds = points.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), (_, p)| (l.min(*p), h.max(*p)));
        let extent = bounds.1 - bounds.0;
        let longest = extent.max_element();
        let is_thin = extent.min_element() < THIN * longest && longest.is_finite();
        let thickness = if is_thin { extent / longest } else { Vec3::ONE }.max(Vec3::splat(1e-3));
        let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        let direction = |k: usize| {
            let y = 1.0 - (2 * k + 1) as f64 / count as f64;
            let (sin, cos) = (golden * k as f64).sin_cos();
            DVec3::new((1.0 - y * y).sqrt() * cos, y, (1.0 - y * y).sqrt() * sin).as_vec3() / thickness
        };
        // four directions at a time; of two vertices that a rounding of an f32 lies between, either will do
        let four = |k: usize| {
            let d: [Vec3; 4] = std::array::from_fn(|lane| direction((4 * k + lane).min(count - 1)));
            let axes = [0, 1, 2].map(|axis| Vec4::from_array(d.map(|d| d[axis])));
            (axes, Vec4::NEG_INFINITY, [VertexId::NONE; 4])
        };
        let mut farthest: Vec<([Vec4; 3], Vec4, [VertexId; 4])> = (0..count.div_ceil(4)).map(four).collect();
        for (v, p) in points {
            for ([x, y, z], most, vertices) in &mut farthest {
                let reach = *x * p.x + *y * p.y + *z * p.z;
                let further = reach.cmpgt(*most).bitmask();
                if further != 0 {
                    *most = most.max(reach);
                    (0..4).filter(|lane| further >> lane & 1 == 1).for_each(|lane| vertices[lane] = v);
                }
            }
        }
        let mut vertices: Vec<VertexId> = farthest.into_iter().flat_map(|f| f.2).filter(|v| v.is_some()).collect();
        vertices.sort_unstable();
        vertices.dedup();
        vertices
    }

    /// Writes where those still are (tissue space), drawn in by a hundredth so that pieces do not start inside each other.
    pub fn hull_points(&self, vertices: &[VertexId], points: &mut Vec<DVec3>) {
        const SHRUNK: f64 = 0.99;
        points.clear();
        points.extend(vertices.iter().filter(|v| self.mesh.vertex_is_live(**v)).map(|v| self.position(*v)));
        let middle = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
        points.iter_mut().for_each(|p| *p = middle + SHRUNK * (*p - middle));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::SlotCsr;
    use crate::physics::NetworkSettings;
    use crate::rig::{BoneWeight, VertexRows};
    use crate::tissue::TissueSettings;

    /// The most that a hull of 64 vertices falls short of a squeezed ball in any direction, as a share of the ball's extent there.
    fn lacks(squeezed: DVec3) -> f64 {
        let mut model = crate::formats::load("sphere").unwrap();
        let at = |v| (squeezed * model.rows.rest(VertexId::new(v))).as_vec3().to_array();
        let bones: Vec<Vec<BoneWeight>> = (0..model.rows.len()).map(|v| model.rows.bones.row(v).to_vec()).collect();
        model.rows =
            VertexRows::from_base((0..bones.len()).map(at).collect(), SlotCsr::from_rows(bones.iter().map(Vec::as_slice)));
        let (network, section_faces) = (NetworkSettings::FIRM, 64);
        let settings = TissueSettings { particles: None, network, opening_s: 0.2, section_faces, fade_s: 0.25 };
        let tissue = Tissue::new(model, &settings).unwrap();
        let held: Vec<DVec3> = tissue.hull_vertices(64).iter().map(|v| tissue.position(*v)).collect();
        let (low, high) = tissue.bounds();
        let farthest = |points: &mut dyn Iterator<Item = DVec3>, way: DVec3| points.map(|p| p.dot(way)).fold(f64::MIN, f64::max);
        let ways =
            (0..400).map(|k| DVec3::new((f64::from(k) * 0.7).sin(), (f64::from(k) * 1.3).cos(), (f64::from(k) * 2.9).sin()));
        let missing = ways.map(|way| {
            // across what is thin
            let way = (way / (high - low)).normalize_or(DVec3::Y);
            let all = farthest(&mut tissue.mesh.live_vertices().map(|v| tissue.position(v)), way);
            (all - farthest(&mut held.iter().copied(), way)) / (way.abs() * (high - low)).element_sum()
        });
        missing.fold(0.0, f64::max)
    }

    #[test]
    fn a_thin_body_is_as_near_its_hull_as_a_round_one() {
        let round = lacks(DVec3::ONE);
        assert!(round < 0.02, "{round}");
        for squeezed in [DVec3::new(1.0, 0.03, 1.0), DVec3::new(0.05, 1.0, 0.4)] {
            let thin = lacks(squeezed);
            assert!(thin < 1.3 * round, "{squeezed}: {thin} of its extent, {round} if it is round");
        }
    }
}
