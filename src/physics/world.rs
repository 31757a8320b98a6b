//! The rigid world: instruments, hands, loose pieces and the table, as rapier bodies (MATHS 4.4).
//!
//! *Driven* bodies go where they are told; *loose* ones fall, collide and are pushed by the soft layer. Poses are f64 and kept
//! for the beginning and the end of the step, so that contacts can be swept. Without loose bodies rapier is never stepped:
//! an instrument alone costs nothing here.

use super::body::{Body, DAMPING, Push};
use super::hulls::convex;
use super::network::Network;
use super::rigid::{RigidPose, RigidShape, Solid};
use super::step::LEAST_STEP;
use crate::geometry::ParticleId;
use glam::{DQuat, DVec3, Vec3};
use rapier3d::dynamics::{IntegrationParameters, RigidBody, RigidBodyBuilder, RigidBodyHandle};
use rapier3d::geometry::{ColliderBuilder, ColliderHandle, Group, InteractionGroups, InteractionTestMode};
use rapier3d::math::Pose;
use rapier3d::parry::bounding_volume::BoundingVolume;
use rapier3d::parry::query;
use rapier3d::parry::shape::SharedShape;
use rapier3d::pipeline::PhysicsWorld;
use std::collections::BTreeMap;

/// Longest step of rapier, s; longer ones are split, into [`MAX_SUBSTEPS`] at most.
pub const RIGID_STEP: f64 = 1.0 / 120.0;
/// Bodies of this size and more are moved in steps of [`RIGID_STEP`], smaller ones in shorter steps, metres.
const SMALL: f64 = 0.03;
/// Most substeps: beyond them the rigid world runs slower than the clock.
pub const MAX_SUBSTEPS: usize = 16;
/// Standard gravity, m/s^2.
pub const GRAVITY: f64 = 9.81;
/// The world ends this many of its lengths from the origin, and no driven body is larger: rapier counts in f32 and may panic far beyond.
pub const FARTHEST: f64 = 1e4;
/// A loose body moves no faster than this many lengths of the world in a second.
const FASTEST: f64 = 100.0;

/// How fast a piece follows the hand that holds it, Hz.
const CARRYING: f64 = 8.0;
/// Width and depth of the table, in lengths of the world.
const TABLE_WIDTH: f64 = 60.0;
const TABLE_DEPTH: f64 = 5.0;
/// What loose bodies, stands and scraps are among rapier's groups.
const LOOSE: Group = Group::GROUP_1;
const STANDS: Group = Group::GROUP_2;
const SCRAPS: Group = Group::GROUP_3;
/// A piece of a smaller radius than this, in lengths of the world, is a scrap. It lies on the table and on stands, and passes through
/// other pieces: between two that weigh a thousand times as much it would rattle for ever, or be shot out.
const SCRAP: f64 = 0.02;
/// What is this near to a stand, in lengths of the world, may lie on it.
const NEAR: f64 = 0.02;

/// Names a body for as long as the world lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BodyId(pub u32);

/// Bodies, their poses, and rapier.
pub struct RigidWorld {
    world: PhysicsWorld,
    bodies: BTreeMap<BodyId, Body>,
    next: u32,
    up: DVec3,
    length: f64,
    /// The table among `bodies`.
    table: Option<BodyId>,
    loose: usize,
    /// Instruments and the like that soft layers feel, ascending, and how many loose bodies they feel: a heap of pieces is long.
    felt: Vec<BodyId>,
    felt_loose: usize,
    /// Something has come or gone since the last step.
    stirred: bool,
}

/// How much faster bodies of this `length` fall through their own size than those of [`SMALL`] do: contacts have to be as much stiffer
/// for them, and steps shorter.
fn haste(length: f64) -> f64 {
    (SMALL / length).sqrt().max(1.0)
}

impl RigidWorld {
    /// An empty world whose bodies are about `length` metres in size; things fall against `up`.
    pub fn new(up: DVec3, length: f64) -> Self {
        let up = up.try_normalize().unwrap_or(DVec3::Y);
        let length = if length.is_finite() && length > 0.0 { length } else { 1.0 };
        let mut world = PhysicsWorld { gravity: (-GRAVITY * up).as_vec3(), ..PhysicsWorld::default() };
        let IntegrationParameters { length_unit, contact_softness, static_contact_softness, .. } =
            &mut world.integration_parameters;
        *length_unit = length as f32;
        contact_softness.natural_frequency *= haste(length) as f32;
        static_contact_softness.natural_frequency *= haste(length) as f32;
        let (felt, felt_loose, stirred) = (Vec::new(), 0, false);
        Self { world, bodies: BTreeMap::new(), next: 0, up, length, table: None, loose: 0, felt, felt_loose, stirred }
    }

    /// A pose that a driven body may have: what is farther away than the world reaches stands at its edge. `None` for none at all.
    pub fn within(&self, pose: RigidPose) -> Option<RigidPose> {
        let far = |x: f64| x.clamp(-FARTHEST * self.length, FARTHEST * self.length);
        pose.checked().map(|pose| RigidPose { translation: pose.translation.map(far), ..pose })
    }

    fn insert(&mut self, body: Body) -> BodyId {
        // loose bodies may come to lie on it
        self.stirred = true;
        let id = BodyId(self.next);
        self.next += 1;
        let soft = body.soft;
        self.bodies.insert(id, Body { soft: false, ..body });
        self.set_felt(id, soft);
        id
    }

    /// Says whether soft layers feel a body.
    fn set_felt(&mut self, id: BodyId, felt: bool) {
        let Some(body) = self.bodies.get_mut(&id).filter(|b| b.soft != felt) else { return };
        body.soft = felt;
        match (body.is_loose(), felt) {
            (true, true) => self.felt_loose += 1,
            (true, false) => self.felt_loose -= 1,
            (false, true) => self.felt.insert(self.felt.partition_point(|f| *f < id), id),
            (false, false) => self.felt.retain(|f| *f != id),
        }
    }

    /// Adds an instrument or a hand that goes where [`RigidWorld::drive`] says. `None` if shape or pose make no sense.
    pub fn add_driven(&mut self, shape: RigidShape, pose: RigidPose) -> Option<BodyId> {
        let (shape, pose) = (shape.checked().filter(|s| s.reach() <= FARTHEST * self.length)?, self.within(pose)?);
        let shared = match shape {
            RigidShape::Sphere { radius } => SharedShape::ball(radius as f32),
            RigidShape::Capsule { half_length, radius } => SharedShape::capsule_y(half_length as f32, radius as f32),
        };
        let builder = RigidBodyBuilder::kinematic_position_based().pose(to_rapier(&pose));
        let (handle, _) = self.world.insert(builder, ColliderBuilder::new(shared));
        Some(self.insert(Body::new(Some(handle), Solid::Simple(shape), pose, 0.0)))
    }

    /// Adds a ball that falls: `mass` in kg.
    pub fn add_ball(&mut self, radius: f64, mass: f64, pose: RigidPose) -> Option<BodyId> {
        let (shape, pose) = (RigidShape::Sphere { radius }.checked()?, pose.checked()?);
        let ball = (SharedShape::ball(radius as f32), Solid::Simple(shape));
        self.add_loose(ball, groups(LOOSE, Group::ALL), mass, pose)
    }

    /// Adds a piece of tissue that falls, the convex hull of `points` (its own frame, metres): `mass` in kg. It lies on stands and on
    /// other pieces, and no soft layer feels it: both at once would push it twice. `None` if there is no such hull or the mass makes
    /// no sense.
    pub fn add_hull(&mut self, points: &[DVec3], mass: f64, pose: RigidPose) -> Option<BodyId> {
        let pose = pose.checked()?;
        let (shape, solid) = convex(points)?;
        let is_scrap = solid.ball().1 < SCRAP * self.length;
        let (is, touches) = if is_scrap { (SCRAPS, Group::ALL & !LOOSE & !SCRAPS) } else { (LOOSE, Group::ALL) };
        let id = self.add_loose((shape, solid), groups(is, touches), mass, pose)?;
        self.set_felt(id, false);
        Some(id)
    }

    fn add_loose(
        &mut self,
        (shape, solid): (SharedShape, Solid),
        groups: InteractionGroups,
        mass: f64,
        pose: RigidPose,
    ) -> Option<BodyId> {
        if !(mass.is_finite() && mass > 0.0) {
            return None;
        }
        let builder = RigidBodyBuilder::dynamic().pose(to_rapier(&pose)).ccd_enabled(true);
        let builder = builder.linear_damping(DAMPING[0]).angular_damping(DAMPING[1]);
        let collider = ColliderBuilder::new(shape).mass(mass as f32).friction(0.6).collision_groups(groups);
        let (handle, _) = self.world.insert(builder, collider);
        self.loose += 1;
        Some(self.insert(Body::new(Some(handle), solid, pose, mass)))
    }

    /// Adds a body that loose ones may lie on, the convex hull of `points` (its own frame, metres): what is under the soft layer of
    /// a tissue that stays. Soft layers do not feel it.
    pub fn add_stand(&mut self, points: &[DVec3], pose: RigidPose) -> Option<BodyId> {
        let pose = pose.checked()?;
        let (shape, solid) = convex(points)?;
        let collider = ColliderBuilder::new(shape).friction(0.6).collision_groups(groups(STANDS, Group::ALL));
        let (handle, _) = self.world.insert(RigidBodyBuilder::fixed().pose(to_rapier(&pose)), collider);
        Some(self.insert(Body { soft: false, ..Body::new(Some(handle), solid, pose, 0.0) }))
    }

    /// Gives a hull another shape, for bodies and soft layers, which wakes what lies on it or comes to; nothing happens if there is no such
    /// hull.
    pub fn reshape(&mut self, id: BodyId, points: &[DVec3]) {
        let handle = self.bodies.get(&id).and_then(|b| b.handle);
        let Self { world, bodies, length, .. } = self;
        let (Some(collider), Some((shape, solid))) = (collider_of(world, handle), convex(points)) else { return };
        if let Some(body) = bodies.get_mut(&id) {
            body.solid = solid;
        }
        let collider = &mut world.colliders[collider];
        let before = collider.compute_aabb();
        collider.set_shape(shape);
        let reached = collider.compute_aabb().merged(&before).loosened((NEAR * *length) as f32);
        for body in bodies.values_mut().filter(|b| b.mass > 0.0) {
            let collider = collider_of(world, body.handle);
            if collider.is_some_and(|c| world.colliders[c].compute_aabb().intersects(&reached)) {
                body.rouse(world);
            }
        }
    }

    /// How far two bodies reach into each other, metres; 0 if they do not.
    pub fn overlap(&self, a: BodyId, b: BodyId) -> f64 {
        let side = |id: BodyId| {
            let collider = self.world.colliders.get(collider_of(&self.world, self.bodies.get(&id)?.handle)?)?;
            Some((to_rapier(&self.pose(id)?), collider.shape()))
        };
        let (Some((pose_a, a)), Some((pose_b, b))) = (side(a), side(b)) else { return 0.0 };
        let contact = query::contact(&pose_a, a, &pose_b, b, 0.0).ok().flatten();
        contact.map_or(0.0, |c| f64::from(-c.dist).max(0.0))
    }

    /// Lets a loose body pass through all stands: soft layers bear it from now on.
    pub fn pass_stands(&mut self, id: BodyId) {
        self.set_felt(id, true);
        if let Some(collider) = collider_of(&self.world, self.bodies.get(&id).and_then(|b| b.handle)) {
            let collider = &mut self.world.colliders[collider];
            let groups = collider.collision_groups();
            collider.set_collision_groups(InteractionGroups { filter: groups.filter & !STANDS, ..groups });
        }
    }

    /// Puts the table's top at this height along up, or takes it away.
    pub fn set_table(&mut self, height: Option<f64>) {
        if let Some(id) = self.table.take() {
            self.remove(id);
        }
        let Some(height) = height.filter(|h| h.is_finite()) else { return };
        let pose = RigidPose::at(self.up * height);
        let builder = RigidBodyBuilder::fixed().pose(to_rapier(&pose));
        // No half-space: of a hull, rapier holds one face against that, and not the deepest vertex, so that rolling pieces sink in.
        let (wide, deep) = (TABLE_WIDTH * self.length, TABLE_DEPTH * self.length);
        let upright = RigidPose { rotation: DQuat::from_rotation_arc(DVec3::Y, self.up), translation: -0.5 * deep * self.up };
        let slab = SharedShape::cuboid(0.5 * wide as f32, 0.5 * deep as f32, 0.5 * wide as f32);
        let (handle, _) = self.world.insert(builder, ColliderBuilder::new(slab).position(to_rapier(&upright)).friction(0.8));
        let body = Body::new(Some(handle), Solid::below(self.up), pose, 0.0);
        self.table = Some(self.insert(Body { soft: false, ..body }));
    }

    /// Tells a driven body where to be at the end of the next step. Nonsense is refused.
    pub fn drive(&mut self, id: BodyId, pose: RigidPose) {
        let pose = self.within(pose);
        if let (Some(body), Some(pose)) = (self.bodies.get_mut(&id), pose) {
            body.next = Some(pose);
        }
    }

    /// Takes a body away; unknown ones are ignored.
    pub fn remove(&mut self, id: BodyId) {
        // loose bodies may have lain on it
        self.stirred = true;
        self.set_felt(id, false);
        if let Some(body) = self.bodies.remove(&id) {
            self.loose -= usize::from(body.mass > 0.0);
            if let Some(handle) = body.handle {
                self.world.remove_body(handle);
            }
        }
    }

    /// Where a body is.
    pub fn pose(&self, id: BodyId) -> Option<RigidPose> {
        self.bodies.get(&id).map(|b| b.now)
    }

    /// Mass of a loose body, kg; 0 for others.
    pub fn mass(&self, id: BodyId) -> f64 {
        self.bodies.get(&id).map_or(0.0, |b| b.mass)
    }

    /// Velocity of a loose body, m/s.
    pub fn velocity(&self, id: BodyId) -> DVec3 {
        let handle = self.bodies.get(&id).and_then(|b| b.handle);
        handle.and_then(|h| self.world.bodies.get(h)).map_or(DVec3::ZERO, |b| b.linvel().as_dvec3())
    }

    /// Gives a loose body this velocity, m/s.
    pub fn set_velocity(&mut self, id: BodyId, velocity: DVec3) {
        let handle = self.bodies.get(&id).filter(|b| b.mass > 0.0).and_then(|b| b.handle);
        if let Some(rigid) = handle.and_then(|h| self.world.bodies.get_mut(h)).filter(|_| velocity.is_finite()) {
            rigid.set_linvel(velocity.as_vec3(), true);
        }
    }

    /// Puts on a body what holds a particle of a soft layer in `frame` at the place `at` (world), for particles of `mass` kg:
    /// with a negative mass, the reaction to it.
    pub fn press(&mut self, id: BodyId, at: DVec3, frame: &RigidPose, (network, particle): (&Network, ParticleId), mass: f64) {
        let (force, stiffness) = network.holding(particle, network.velocity(particle));
        let force = frame.direction(force) * mass;
        let (stiffness, damping) = (stiffness * mass.abs(), network.settings().damping_rate() * mass.abs());
        self.push_at(id, at, force, stiffness, damping);
    }

    /// Carries a `share` of a loose body's mass by a place (world) that is held `by` metres away from where it is on the body. The
    /// springs of the soft layer alone would be drawn out: tissue that is pulled at stiffens.
    pub fn carry(&mut self, id: BodyId, at: DVec3, by: DVec3, share: f64) {
        let (mass, rate) = (share * self.mass(id), std::f64::consts::TAU * CARRYING);
        let (stiffness, damping) = (mass * rate * rate, 2.0 * mass * rate);
        self.push_at(id, at, stiffness * by - damping * self.velocity(id), stiffness, damping);
    }

    fn push_at(&mut self, id: BodyId, at: DVec3, force: DVec3, stiffness: f64, damping: f64) {
        let Some(body) = self.bodies.get_mut(&id).filter(|_| force.is_finite() && at.is_finite()) else { return };
        let arm = at.distance_squared(body.now.translation);
        body.push.force += force;
        body.push.torque += at.cross(force);
        body.push.stiffness += stiffness;
        body.push.damping += damping;
        body.push.turn_stiffness += stiffness * arm;
        body.push.turn_damping += damping * arm;
    }

    /// Force that the soft layers put on a body in the last step, N: what a hand would feel.
    pub fn reaction(&self, id: BodyId) -> DVec3 {
        self.bodies.get(&id).map_or(DVec3::ZERO, |b| b.push.force)
    }

    /// Which way is up.
    pub fn up(&self) -> DVec3 {
        self.up
    }

    /// True if there is no body that soft layers may feel.
    pub fn is_empty(&self) -> bool {
        self.felt.is_empty() && self.felt_loose == 0
    }

    /// True if no body moves or is about to.
    pub fn is_resting(&self) -> bool {
        self.bodies.values().all(|b| !b.moved() && b.next.is_none_or(|n| n == b.now) && !self.is_falling(b))
    }

    fn is_falling(&self, body: &Body) -> bool {
        let rigid = body.handle.and_then(|h| self.world.bodies.get(h));
        body.mass > 0.0 && rigid.is_some_and(|r| r.is_enabled() && !r.is_sleeping())
    }

    /// Bodies that a soft layer feels, given the body that it is on itself, if any: loose pieces meet as rigid bodies.
    pub(super) fn touching(&self, own: Option<BodyId>) -> impl Iterator<Item = (BodyId, &Body)> {
        let among_all = own.is_none() && self.felt_loose > 0;
        let all = self.bodies.iter().take_while(move |_| among_all).filter(|(_, body)| body.soft);
        let instruments = self.felt.iter().take_while(move |_| !among_all);
        all.map(|(id, body)| (*id, body)).chain(instruments.filter_map(|id| Some((*id, self.bodies.get(id)?))))
    }

    pub(super) fn body(&self, id: BodyId) -> Option<&Body> {
        self.bodies.get(&id)
    }

    pub(super) fn body_mut(&mut self, id: BodyId) -> Option<&mut Body> {
        self.bodies.get_mut(&id)
    }

    /// Moves everything by `h` seconds: driven bodies to where they are wanted, loose ones by rapier, with the forces that soft
    /// layers have put on them since the last step. A step of less than a microsecond is none.
    pub fn step(&mut self, h: f64) {
        // in rapier's f32 a shorter one may be zero, after which it may panic
        if !(h >= LEAST_STEP && h.is_finite()) {
            return;
        }
        for body in self.bodies.values_mut() {
            body.before = body.now;
            body.now = body.next.take().unwrap_or(body.now);
        }
        if std::mem::take(&mut self.stirred) {
            // none is about to lie still
            self.bodies.values_mut().for_each(|b| b.still_s = 0.0);
        }
        self.wake_by_force();
        let driven = self.bodies.values().any(Body::moved);
        if self.loose > 0 && (driven || self.bodies.values().any(|b| self.is_falling(b))) {
            self.step_rapier(h);
        }
        for body in self.bodies.values_mut() {
            body.push = Push::default();
        }
    }

    fn step_rapier(&mut self, h: f64) {
        let longest = RIGID_STEP / haste(self.length);
        let substeps = ((h / longest - 1e-9).ceil() as usize).clamp(1, MAX_SUBSTEPS);
        let part = (h / substeps as f64).min(longest);
        self.world.integration_parameters.dt = part as f32;
        self.push(h);
        self.wake_near_driven();
        for k in 1..=substeps {
            let share = k as f64 / substeps as f64;
            for body in self.bodies.values().filter(|b| b.moved()) {
                if let Some(rigid) = body.handle.and_then(|handle| self.world.bodies.get_mut(handle)) {
                    rigid.set_next_kinematic_position(to_rapier(&body.before.toward(&body.now, share)));
                }
            }
            self.world.step();
        }
        let table = self.table.and_then(|id| self.bodies.get(&id)).map(|b| b.now.translation.dot(self.up));
        for body in self.bodies.values_mut().filter(|b| b.mass > 0.0) {
            // rapier takes every body that it hands out for writing as changed; what was pushed has forces to be taken back
            let pushed = body.push.stiffness > 0.0;
            let sleeps = |r: &RigidBody| !pushed && r.is_sleeping() && from_rapier(r.position()) == body.now;
            if body.handle.and_then(|handle| self.world.bodies.get(handle)).is_some_and(sleeps) {
                continue;
            }
            let Some(rigid) = body.handle.and_then(|handle| self.world.bodies.get_mut(handle)) else { continue };
            rigid.reset_forces(false);
            rigid.reset_torques(false);
            match from_rapier(rigid.position()).checked() {
                Some(pose) => body.now = pose,
                // Rapier has quarantined it, or should have: it stays at the last good place.
                None => rigid.set_enabled(false),
            }
            // A body that is smaller than its fall in a step may pass the table.
            let (middle, radius) = body.solid.ball();
            let under = table.map_or(0.0, |table| table - body.now.point(middle).dot(self.up));
            if under > radius {
                body.now.translation += (under + 0.5 * radius) * self.up;
                rigid.set_position(to_rapier(&body.now), false);
                rigid.set_linvel(Vec3::ZERO, false);
            }
            if rigid.linvel().length() > (FASTEST * self.length) as f32 {
                rigid.set_linvel(rigid.linvel().clamp_length_max((FASTEST * self.length) as f32), false);
            }
            if !rigid.is_sleeping() {
                body.calm(rigid, h);
            }
        }
    }

    /// A body that lies still on the skin or in a hand may sleep: another force wakes it, and so does none.
    fn wake_by_force(&mut self) {
        for body in self.bodies.values_mut().filter(|b| b.mass > 0.0) {
            let change = (body.push.force - body.last_force).length();
            body.last_force = body.push.force;
            if change > 1e-3 * GRAVITY * body.mass {
                body.rouse(&mut self.world);
            }
        }
    }

    /// A driven body that moves wakes the loose ones it may reach.
    fn wake_near_driven(&mut self) {
        let reach = |b: &Body| {
            let (middle, radius) = b.solid.ball();
            let (from, to) = (b.before.point(middle), b.now.point(middle));
            (0.5 * (from + to), radius + 0.5 * from.distance(to))
        };
        let driven: Vec<(DVec3, f64)> = self.bodies.values().filter(|b| b.mass == 0.0 && b.moved()).map(reach).collect();
        for body in self.bodies.values_mut().filter(|b| b.mass > 0.0) {
            let (at, radius) = reach(body);
            if driven.iter().any(|(d, r)| d.distance(at) < radius + r) {
                body.rouse(&mut self.world);
            }
        }
    }

    /// Hands the soft layers' forces over, linearly implicit: a body of mass `m` on springs of stiffness `k` and damping `c` moves
    /// as if it had the mass `m + h c + h^2 k`, so that no stiffness and no step throws it back further than it came. The same
    /// for turns.
    fn push(&mut self, h: f64) {
        for body in self.bodies.values_mut().filter(|b| b.mass > 0.0 && b.push.stiffness > 0.0) {
            let Some(rigid) = body.handle.and_then(|handle| self.world.bodies.get_mut(handle)) else { continue };
            let Push { force, torque, stiffness, damping, turn_stiffness, turn_damping } = body.push;
            let (velocity, spin) = (rigid.linvel().as_dvec3(), rigid.angvel().as_dvec3());
            let share = body.mass / (body.mass + h * damping + h * h * stiffness);
            // Rapier adds the weight itself; it too meets the larger mass.
            let weight = -GRAVITY * body.mass * self.up;
            let whole = share * (force + weight - h * stiffness * velocity) - weight;
            let about = torque - rigid.center_of_mass().as_dvec3().cross(force);
            let inertia = f64::from(rigid.mass_properties().local_mprops.principal_inertia().min_element());
            let share = inertia / (inertia + h * turn_damping + h * h * turn_stiffness);
            rigid.add_force(whole.as_vec3(), false);
            rigid.add_torque((share * (about - h * turn_stiffness * spin)).as_vec3(), false);
        }
    }
}

/// What a collider is among rapier's groups, and what it touches.
fn groups(is: Group, touches: Group) -> InteractionGroups {
    InteractionGroups::new(is, touches, InteractionTestMode::And)
}

fn collider_of(world: &PhysicsWorld, body: Option<RigidBodyHandle>) -> Option<ColliderHandle> {
    world.bodies.get(body?)?.colliders().first().copied()
}

fn to_rapier(pose: &RigidPose) -> Pose {
    Pose::from_parts(pose.translation.as_vec3(), pose.rotation.as_quat())
}

fn from_rapier(pose: &Pose) -> RigidPose {
    RigidPose { rotation: pose.rotation.as_dquat().normalize(), translation: pose.translation.as_dvec3() }
}
