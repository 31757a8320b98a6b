//! Contact of a soft layer with the rigid world (MATHS 4.4).
//!
//! Each particle has a collider sphere that lies under the skin and touches it at the anchor, so that a ball smaller than the
//! particles' spacing does not slip between them. What a rigid body pushes is *held* at the body's surface for the step (a
//! Dirichlet condition of the network, so no stiffness and no step makes it unstable), slides there as far as friction lets it,
//! and is let go as soon as the body would have to pull. The way of a particle through a step is swept in the body's own frame,
//! so a fast instrument carries along what it met instead of jumping over it. The reaction goes to the body.

use super::body::Body;
use super::network::Network;
use super::rigid::{RigidPose, Solid};
use super::world::{BodyId, RigidWorld};
use crate::geometry::ParticleId;
use glam::DVec3;

/// Friction between a body and the skin.
const FRICTION: f64 = 0.4;
/// How much more than friction bears a particle must be pulled before it slides: it comes to rest.
const SLIP: f64 = 1.02;
/// Share of a slide that is made in one step: all particles slide at once.
const SLIDE: f64 = 0.7;
/// A collider sphere under the skin counts for bodies that push against the skin, within this cosine.
const FACING: f64 = -0.2;
/// A gap this small is none, in collider radii.
const TOUCH: f64 = 1e-3;
/// Steps of a sweep at most; each goes as far as the gap allows.
const SWEEP: usize = 48;
/// Rounds in which a particle between two bodies is pushed out of both.
const SQUEEZE: usize = 8;

/// The skin of a soft layer, by particle, in tissue space.
#[derive(Clone, Copy)]
pub struct Skin<'a> {
    /// Where each particle is anchored, posed, without displacement; `None` for retired particles.
    pub anchors: &'a [Option<DVec3>],
    /// Outward unit normals there; zero where there is none.
    pub normals: &'a [DVec3],
    /// Radius of the collider spheres, metres.
    pub radius: f64,
}

/// A particle at a body's surface.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Contact {
    particle: u32,
    body: BodyId,
    /// Where the anchor point stands, in the body's frame.
    local: DVec3,
}

/// What one soft layer touches.
#[derive(Clone, Debug, Default)]
pub struct Contacts {
    held: Vec<Contact>,
    targets: Vec<(ParticleId, DVec3)>,
    /// Pairs that overlapped when the body was born, until they part.
    born_inside: Vec<(u32, BodyId)>,
    before: Vec<Option<DVec3>>,
    frame_before: RigidPose,
    is_held: Vec<bool>,
    /// Pairs that have parted in this step.
    let_go: Vec<(u32, BodyId)>,
    /// Start, end (world) and outward normal of every live particle's way through the step, and the box around them.
    ways: Vec<Option<(DVec3, DVec3, DVec3)>>,
    bounds: (DVec3, DVec3),
    /// Updates of a tissue at rest since its ways were set: they too end where they began.
    still_since_set_out: u32,
    bodies: Vec<BodyId>,
    visited: u64,
}

/// The way of one particle through a step, in the frame of a body.
struct Way {
    from: DVec3,
    to: DVec3,
    /// Outward normal of the skin.
    normal: DVec3,
}

impl Contacts {
    /// The particles that bodies hold, ascending, and the displacements they are to have at the end of the step.
    pub fn targets(&self) -> &[(ParticleId, DVec3)] {
        &self.targets
    }

    /// Particles that were tested against a body, in all: nothing is tested while no body is near.
    pub fn visited(&self) -> u64 {
        self.visited
    }

    /// True if nothing is held.
    pub fn is_empty(&self) -> bool {
        self.held.is_empty()
    }

    /// Lets everything go.
    pub fn clear(&mut self) {
        self.held.clear();
        self.targets.clear();
        self.before.clear();
        self.born_inside.clear();
    }

    /// Finds out what touches at the end of a step of `h` seconds. `frame` carries tissue space to the world, `own` is the
    /// tissue's own body, `grabbed` says whom a hand holds, `stirred` whether the tissue is awake or was moved. To be called after [`RigidWorld::step`] and before
    /// [`Network::step`]; after that, [`Contacts::react`].
    pub fn update(
        &mut self,
        world: &mut RigidWorld,
        (frame, own): (&RigidPose, Option<BodyId>),
        skin: &Skin,
        (network, stirred): (&Network, bool),
        h: f64,
        grabbed: impl Fn(ParticleId) -> bool,
    ) {
        if world.is_empty() && self.held.is_empty() {
            self.before.clear();
            return;
        }
        let count = skin.anchors.len().min(network.len());
        if self.before.len() != skin.anchors.len() {
            self.before.clear();
            self.before.extend_from_slice(skin.anchors);
            self.frame_before = *frame;
        }
        self.is_held.clear();
        self.is_held.resize(count, false);
        if stirred || self.ways.len() != count || self.still_since_set_out < 2 {
            self.set_out(frame, skin, network, h);
            self.still_since_set_out = if stirred { 0 } else { self.still_since_set_out + 1 };
        }
        self.keep(world, frame, skin, network, h, &grabbed);
        self.catch(world, own, skin.radius, &grabbed);
        self.separate(world, frame, own, skin, network);
        self.before.copy_from_slice(skin.anchors);
        self.frame_before = *frame;
    }

    /// True if a body that holds something was taken out of the world.
    pub fn has_lost_a_body(&self, world: &RigidWorld) -> bool {
        self.held.iter().any(|contact| world.body(contact.body).is_none())
    }

    /// What is held stays so while the body pushes, and slides where friction does not bear it.
    fn keep(
        &mut self,
        world: &RigidWorld,
        frame: &RigidPose,
        skin: &Skin,
        network: &Network,
        h: f64,
        grabbed: &impl Fn(ParticleId) -> bool,
    ) {
        let Self { is_held, let_go, .. } = self;
        let_go.clear();
        self.held.retain_mut(|contact| {
            let (index, particle) = (contact.particle as usize, ParticleId(contact.particle));
            let anchor = skin.anchors.get(index).copied().flatten().filter(|_| index < is_held.len() && !grabbed(particle));
            let (Some(anchor), Some(body)) = (anchor, world.body(contact.body)) else { return false };
            let normal = body.now.direction_in(frame.direction(skin.normals[index]));
            // a piece that came off while it was stretched has drawn together since
            if body.is_loose() && (is_crumb(body, skin.radius) || is_apart(body, contact, normal, skin.radius)) {
                return false;
            }
            let u = frame.point_in(body.now.point(contact.local)) - anchor;
            let (force, stiffness) = network.holding(particle, (u - network.displacement(particle)) / h);
            let force = body.now.direction_in(frame.direction(force));
            let (_, out) = gap(&body.solid, contact.local, normal, skin.radius);
            let push = force.dot(out);
            if push <= 0.0 {
                let_go.push((contact.particle, contact.body));
                return false;
            }
            let along = force - push * out;
            let (pull, bears) = (along.length(), FRICTION * push);
            if pull > SLIP * bears && stiffness > 0.0 {
                // Towards where the springs would have it: against the force that holds it.
                let way = along / pull * -(SLIDE * (pull - bears) / stiffness).min(0.5 * skin.radius);
                let to = slid(&body.solid, contact.local, way, (normal, out), skin.radius);
                contact.local = pushed_out(&body.solid, to, normal, skin.radius, true);
            }
            is_held[index] = true;
            true
        });
    }

    /// Sweeps free particles against every body that comes near.
    fn catch(&mut self, world: &mut RigidWorld, own: Option<BodyId>, radius: f64, grabbed: &impl Fn(ParticleId) -> bool) {
        let mut bodies = std::mem::take(&mut self.bodies);
        bodies.clear();
        bodies.extend(world.touching(own).map(|(id, _)| id));
        for &id in &bodies {
            if let Some(body) = world.body(id) {
                self.catch_by(body, id, radius, grabbed);
            }
            if let Some(body) = world.body_mut(id)
                && body.moved()
            {
                body.fresh = false;
            }
        }
        self.bodies = bodies;
        self.held.sort_unstable_by_key(|c| c.particle);
    }

    /// What one body catches.
    fn catch_by(&mut self, body: &Body, id: BodyId, radius: f64, grabbed: &impl Fn(ParticleId) -> bool) {
        if is_crumb(body, radius) {
            return;
        }
        let (middle, reach) = body.solid.ball();
        let (from, to) = (body.before.point(middle), body.now.point(middle));
        let reach = reach + 2.0 * radius;
        if boxes_apart((from.min(to), from.max(to)), self.bounds) > reach {
            return;
        }
        for index in 0..self.is_held.len() {
            let Some((start, end, normal)) = self.ways[index] else { continue };
            let apart = boxes_apart((from.min(to), from.max(to)), (start.min(end), start.max(end)));
            if apart > reach || self.is_held[index] || grabbed(ParticleId(index as u32)) {
                continue;
            }
            self.visited += 1;
            // what is pulled off goes where it is pulled first: by its last motion alone it may seem to come on, for ever
            if self.let_go.contains(&(index as u32, id)) {
                continue;
            }
            let normal = body.now.direction_in(normal);
            let way = Way { from: body.before.point_in(start), to: body.now.point_in(end), normal };
            if body.is_loose() && self.is_born_inside(body, id, index as u32, &way, radius) {
                continue;
            }
            if let Some(local) = swept(&body.solid, &way, radius) {
                self.held.push(Contact { particle: index as u32, body: id, local });
                self.is_held[index] = true;
            }
        }
    }

    /// Where every particle goes in a step of `h` seconds if nothing touches it, and the box around all ways, in the world.
    fn set_out(&mut self, frame: &RigidPose, skin: &Skin, network: &Network, h: f64) {
        self.ways.clear();
        self.bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for index in 0..self.is_held.len() {
            let particle = ParticleId(index as u32);
            let way = skin.anchors[index].zip(self.before[index]).map(|(anchor, before)| {
                let u = network.displacement(particle);
                let start = self.frame_before.point(before + u);
                let end = frame.point(anchor + u + network.way(particle, h));
                self.bounds = (self.bounds.0.min(start).min(end), self.bounds.1.max(start).max(end));
                (start, end, frame.direction(skin.normals[index]))
            });
            self.ways.push(way);
        }
    }

    /// A piece that has come off overlaps what it came from; such pairs touch only once they have parted.
    fn is_born_inside(&mut self, body: &Body, id: BodyId, particle: u32, way: &Way, radius: f64) -> bool {
        let pair = (particle, id);
        let inside = gap(&body.solid, way.from, way.normal, radius).0 < 0.0;
        let known = self.born_inside.contains(&pair);
        match (inside, known) {
            (true, false) if body.fresh => self.born_inside.push(pair),
            (false, true) => self.born_inside.retain(|p| *p != pair),
            _ => return known,
        }
        inside
    }

    /// Takes held particles out of the other bodies they would be pushed into: squeezing.
    fn separate(&mut self, world: &RigidWorld, frame: &RigidPose, own: Option<BodyId>, skin: &Skin, network: &Network) {
        self.targets.clear();
        for contact in &mut self.held {
            let index = contact.particle as usize;
            let (Some(anchor), Some(body)) = (skin.anchors[index], world.body(contact.body)) else { continue };
            let normal = frame.direction(skin.normals[index]);
            let mut place = body.now.point(contact.local);
            let others = || world.touching(own).filter(|(id, body)| *id != contact.body && !is_crumb(body, skin.radius));
            for _ in 0..SQUEEZE {
                let mut moved = false;
                for (id, other) in others() {
                    let local = other.now.point_in(place);
                    let normal = other.now.direction_in(normal);
                    let inside = gap(&other.solid, local, normal, skin.radius).0 < -TOUCH * skin.radius;
                    if inside && !self.born_inside.contains(&(contact.particle, id)) {
                        place = other.now.point(pushed_out(&other.solid, local, normal, skin.radius, false));
                        moved = true;
                    }
                }
                if !moved {
                    break;
                }
                let local = pushed_out(&body.solid, body.now.point_in(place), body.now.direction_in(normal), skin.radius, false);
                place = body.now.point(local);
                contact.local = local;
            }
            let u = frame.point_in(place) - anchor;
            // Nonsense would be refused and counted by the network every step; the particle stays where it is instead.
            let u = if u.is_finite() { u } else { network.displacement(ParticleId(contact.particle)) };
            self.targets.push((ParticleId(contact.particle), u));
        }
    }

    /// The reaction: what holds the particles (of `mass` kg each) pushes the bodies. With the state after the step, so that the
    /// force belongs to the place where the body now is.
    /// The tissue's `own` body, if it is loose, is pushed the other way.
    pub fn react(&self, world: &mut RigidWorld, (frame, own): (&RigidPose, Option<BodyId>), network: &Network, mass: f64) {
        for contact in &self.held {
            let Some(body) = world.body(contact.body) else { continue };
            let (at, particle) = (body.now.point(contact.local), ParticleId(contact.particle));
            world.press(contact.body, at, frame, (network, particle), -mass);
            if let Some(own) = own {
                world.press(own, at, frame, (network, particle), mass);
            }
        }
    }
}

/// True if a body has no more to do with what it holds: it has taken another shape.
fn is_apart(body: &Body, contact: &Contact, normal: DVec3, radius: f64) -> bool {
    gap(&body.solid, contact.local, normal, radius).0 > 2.0 * TOUCH * radius
}

/// True for a loose piece smaller than the collider spheres: shreds in a wound lie among the spheres of both its lips, which would be
/// thrown apart by their own radius. Such a piece weighs nothing to the tissue; it lies on what the world has.
fn is_crumb(body: &Body, radius: f64) -> bool {
    body.is_loose() && body.solid.ball().1 < radius
}

/// How far a skin point with its collider sphere is from a solid, negative inside, and the way out. All in the solid's frame.
fn gap(solid: &Solid, point: DVec3, normal: DVec3, radius: f64) -> (f64, DVec3) {
    let bare = solid.distance(point);
    sphere_gap(solid, point, normal, radius).filter(|gap| gap.0 < bare.0).unwrap_or(bare)
}

/// The same of the collider sphere alone; `None` where it does not count.
fn sphere_gap(solid: &Solid, point: DVec3, normal: DVec3, radius: f64) -> Option<(f64, DVec3)> {
    let (distance, out) = solid.distance(point - normal * radius);
    (out.dot(normal) < FACING).then_some((distance - radius, out))
}

/// Where a skin point that a solid holds comes to that slides by `way`; `out` is the way out of the solid there. A point that its collider
/// sphere keeps off the solid goes along the line beyond which the sphere counts no more, not over it: it would fall onto the solid by the
/// sphere's radius, come under it again and go to and fro for ever.
fn slid(solid: &Solid, from: DVec3, way: DVec3, (normal, out): (DVec3, DVec3), radius: f64) -> DVec3 {
    let counts = |point: DVec3| sphere_gap(solid, point, normal, radius).is_some();
    if !counts(from) || counts(from + way) {
        return from + way;
    }
    let over = normal.reject_from(out).normalize_or_zero();
    let along = from + way - over * way.dot(over);
    if counts(along) { along } else { from }
}

/// The point brought to the surface: out of the solid, and with `onto` also back to it.
fn pushed_out(solid: &Solid, mut point: DVec3, normal: DVec3, radius: f64, onto: bool) -> DVec3 {
    for _ in 0..4 {
        let (distance, out) = gap(solid, point, normal, radius);
        if distance.abs() < TOUCH * radius || (distance > 0.0 && !onto) {
            break;
        }
        point -= out * distance;
    }
    point
}

/// Where a particle is caught, if it is: the first place on its way that touches (in the body's frame, so that the body carries
/// it from there to the end of the step), or the nearest way out if it was inside from the start.
fn swept(solid: &Solid, way: &Way, radius: f64) -> Option<DVec3> {
    let length = (way.to - way.from).length();
    let touch = TOUCH * radius;
    let start = gap(solid, way.from, way.normal, radius).0;
    if start <= touch {
        let end = gap(solid, way.to, way.normal, radius).0;
        // Leaving by itself, or resting against it: nothing to push.
        return (end < 0.0 && end <= start).then(|| pushed_out(solid, way.to, way.normal, radius, false));
    }
    let (mut t, mut distance) = (0.0, start);
    for _ in 0..SWEEP {
        t += distance.max(touch) / length;
        if t.is_nan() || t >= 1.0 {
            let (end, _) = gap(solid, way.to, way.normal, radius);
            return (end < 0.0).then(|| pushed_out(solid, way.to, way.normal, radius, false));
        }
        let at = way.from.lerp(way.to, t);
        distance = gap(solid, at, way.normal, radius).0;
        if distance <= touch {
            return Some(pushed_out(solid, at, way.normal, radius, false));
        }
    }
    None
}

/// Distance of two boxes, each given by its corners.
fn boxes_apart(a: (DVec3, DVec3), b: (DVec3, DVec3)) -> f64 {
    (a.0 - b.1).max(b.0 - a.1).max(DVec3::ZERO).length()
}
