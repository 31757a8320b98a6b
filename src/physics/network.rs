//! The state of a particle network and everything that can be asked of it; `step.rs` moves it.
//!
//! Displacements are in tissue space, metres, f64. Inside, rows are in solver order and hold `e = u - u0`, the
//! displacement from rest, on which the springs act (MATHS 3.3, 4.1).

use super::activity::Activity;
use super::matrix::{Lanes, Matrix, add_scaled, is_zero};
use super::settings::{NetworkSettings, SettingsError};
use super::topology::NetworkTopology;
use crate::geometry::room::headroom;
use crate::geometry::{ParticleId, StateHash, Turn};
use glam::DVec3;
use std::f64::consts::PI;

/// Largest magnitude of any input (metres, m/s or N); beyond it, like NaN, an input is refused and counted.
pub const INPUT_LIMIT: f64 = 1e12;
/// Springs of a particle that there is room for at first.
const SPRINGS: usize = 256;
/// Rest threshold relative to the length given to [`Network::set_length`].
pub const REST_THRESHOLD: f64 = 1e-6;
/// What a tool moves by less than this in a step, relative to the same length, stands still: places that come out of several frames round.
const STILL: f64 = 1e-10;

/// A particle held by a tool: it moves linearly from where it is to `target` over the next step and stays there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grab {
    pub row: u32,
    pub target: Lanes,
}

/// Particles on springs: `M u'' + c M u' + (K_anchor + L)(u - u0) = F` (MATHS 4.1).
#[derive(Clone, Debug)]
pub struct Network {
    pub(super) settings: NetworkSettings,
    pub(super) length: f64,
    pub(super) matrix: Matrix,
    /// Particle of each row, and row of each particle.
    pub(super) order: Vec<u32>,
    pub(super) row_of: Vec<u32>,
    /// Rows with springs; they come first.
    pub(super) linked: usize,
    pub(super) masses: Vec<f64>,
    pub(super) e: Vec<Lanes>,
    pub(super) v: Vec<Lanes>,
    pub(super) rest: Vec<Lanes>,
    pub(super) force: Vec<Lanes>,
    /// Rest displacement at the end of the next step, for the rows listed in `moved`.
    pub(super) next_rest: Vec<Lanes>,
    pub(super) moved: Vec<u32>,
    pub(super) grabs: Vec<Grab>,
    /// Empty but inside [`Self::set_grabs`].
    pub(super) released: Vec<Grab>,
    /// Empty but inside [`Self::update_springs`].
    pub(super) springs: Vec<(u32, f32)>,
    pub(super) held: Vec<bool>,
    /// `u` by particle: what the rest of the program reads.
    pub(super) displacement: Vec<[f64; 3]>,
    /// `R_j` by particle; empty while all are the identity.
    pub(super) turns: Vec<Turn>,
    pub(super) activity: Activity,
    pub(super) quarantined: u64,
    pub(super) quarantined_in_a_row: u32,
    pub(super) refused: u64,
}

impl Default for Network {
    fn default() -> Self {
        Self {
            settings: NetworkSettings::default(),
            length: 1.0,
            matrix: Matrix::default(),
            order: Vec::new(),
            row_of: Vec::new(),
            linked: 0,
            masses: Vec::new(),
            e: Vec::new(),
            v: Vec::new(),
            rest: Vec::new(),
            force: Vec::new(),
            next_rest: Vec::new(),
            moved: Vec::new(),
            grabs: Vec::new(),
            released: Vec::new(),
            springs: Vec::new(),
            held: Vec::new(),
            displacement: Vec::new(),
            turns: Vec::new(),
            activity: Activity::default(),
            quarantined: 0,
            quarantined_in_a_row: 0,
            refused: 0,
        }
    }
}

impl Network {
    /// A network of unit masses at rest, `length` (metres) as for [`Self::set_length`].
    pub fn new(topology: &NetworkTopology, settings: NetworkSettings, length: f64) -> Result<Self, SettingsError> {
        let mut network = Self { settings: settings.checked()?, ..Self::default() };
        network.set_length(length);
        network.set_topology(topology, None);
        Ok(network)
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// True if there are no particles.
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// The material.
    pub fn settings(&self) -> NetworkSettings {
        self.settings
    }

    /// Changes the material; state and targets stay.
    pub fn set_settings(&mut self, settings: NetworkSettings) -> Result<(), SettingsError> {
        if settings.checked()? != self.settings {
            self.settings = settings;
            self.refresh_stiffness();
            self.disturb_unrested();
        }
        Ok(())
    }

    /// The size that "at rest" is measured against, metres: the model's diagonal. A particle is at rest when it is within
    /// [`REST_THRESHOLD`] of it from its equilibrium, in displacement and in velocity over its frequency.
    pub fn set_length(&mut self, length: f64) {
        self.length = if length.is_finite() && length > 0.0 { length } else { 1.0 };
    }

    /// Replaces springs and masses (kg, by particle; default 1; those not finite and positive become 1). Particles keep
    /// displacement, velocity, rest displacement and force by id; new ones start at rest at 0, and grabs are kept. Only
    /// particles away from rest are woken. Costs a pass over all springs: for edits, not for frames.
    pub fn set_topology(&mut self, topology: &NetworkTopology, masses: Option<&[f64]>) {
        let n = topology.particles();
        let old = std::mem::take(&mut self.row_of);
        let mut seen = Vec::new();
        self.linked = topology.cuthill_mckee(&mut self.order, &mut seen);
        self.row_of = vec![0; n];
        for (row, particle) in self.order.iter().enumerate() {
            self.row_of[*particle as usize] = row as u32;
        }
        for vector in [&mut self.e, &mut self.v, &mut self.rest, &mut self.force, &mut self.next_rest] {
            *vector = permuted(vector, &old, &self.order, [0.0; 4]);
        }
        let sound = |m: &f64| m.is_finite() && *m > 0.0 && *m < INPUT_LIMIT;
        let mass = |p: usize| masses.and_then(|m| m.get(p)).copied().filter(sound).unwrap_or(1.0);
        let by_particle: Vec<f64> = (0..n).map(mass).collect();
        self.masses = self.order.iter().map(|p| by_particle[*p as usize]).collect();
        self.matrix.set_rows(topology, &self.order, &self.row_of, &by_particle);
        self.refresh_stiffness();
        self.rename_rows(&old, n);
        self.displacement = (0..n).map(|p| unpadded(&self.u(self.row_of[p] as usize)).into()).collect();
        self.resize_turns(n);
        self.disturb_unrested();
    }

    /// Carries the lists of rows (grabs, moved rests) over to the new order.
    fn rename_rows(&mut self, old: &[u32], n: usize) {
        let mut particle_of = vec![u32::MAX; old.len()];
        for (particle, row) in old.iter().enumerate() {
            particle_of[*row as usize] = particle as u32;
        }
        let row_of = &self.row_of;
        let renamed = |row: u32| row_of.get(particle_of[row as usize] as usize).copied();
        self.moved = self.moved.iter().filter_map(|row| renamed(*row)).collect();
        self.moved.reserve(n);
        self.grabs = self.grabs.iter().filter_map(|g| Some(Grab { row: renamed(g.row)?, ..*g })).collect();
        self.grabs.reserve(n);
        self.released.reserve(n);
        self.held = vec![false; n];
        for grab in &self.grabs {
            self.held[grab.row as usize] = true;
        }
        self.reset_activity();
    }

    /// Makes room for particles that edits will add.
    pub fn make_room(&mut self) {
        let more = headroom(self.len());
        for list in [&mut self.order, &mut self.row_of] {
            list.reserve(more);
        }
        for vector in [&mut self.e, &mut self.v, &mut self.rest, &mut self.force, &mut self.next_rest] {
            vector.reserve(more);
        }
        self.masses.reserve(more);
        self.held.reserve(more);
        self.displacement.reserve(more);
        self.springs.reserve(SPRINGS);
        self.matrix.make_room(more);
        self.activity.make_room(self.len() + more);
        self.reserve_lists(self.len() + more);
    }

    /// Makes room in the lists of rows, so that a step allocates nothing.
    pub(super) fn reserve_lists(&mut self, n: usize) {
        self.moved.reserve(n.saturating_sub(self.moved.len()));
        self.grabs.reserve(n.saturating_sub(self.grabs.len()));
        self.released.reserve(n.saturating_sub(self.released.len()));
    }

    /// Forgets who is awake but for what is prescribed.
    fn reset_activity(&mut self) {
        self.activity.reset(self.order.len());
        for k in 0..self.moved.len() {
            self.activity.disturb(self.moved[k]);
        }
        for k in 0..self.grabs.len() {
            self.activity.disturb(self.grabs[k].row);
        }
    }

    /// After rows have traded places: wakes what is prescribed or away from rest.
    pub(super) fn restart_activity(&mut self) {
        self.reset_activity();
        self.disturb_unrested();
    }

    fn refresh_stiffness(&mut self) {
        self.matrix.set_stiffness(self.settings.anchor_rate(), self.settings.coupling, self.masses.iter().copied());
    }

    /// Wakes the rows that are away from rest: after a change of what pulls at them.
    fn disturb_unrested(&mut self) {
        for row in 0..self.e.len() {
            self.disturb_if_unrested(row);
        }
    }

    pub(super) fn disturb_if_unrested(&mut self, row: usize) {
        if !(is_zero(&self.e[row]) && is_zero(&self.v[row]) && is_zero(&self.force[row])) {
            self.activity.disturb(row as u32);
        }
    }

    /// `u` of a row.
    pub(super) fn u(&self, row: usize) -> Lanes {
        add_scaled(&self.e[row], 1.0, &self.rest[row])
    }

    /// The row of a particle, if there is one and all of `inputs` are finite and of sane size; else counts a refusal.
    fn accept(&mut self, particle: ParticleId, inputs: &[DVec3]) -> Option<usize> {
        let sound = inputs.iter().all(|x| x.abs().cmple(DVec3::splat(INPUT_LIMIT)).all());
        let row = self.row_of.get(particle.0 as usize).filter(|_| sound).map(|row| *row as usize);
        if row.is_none() {
            self.refused += 1;
        }
        row
    }

    /// Displacements `u` by particle, metres: read after [`Network::step`].
    pub fn displacements(&self) -> &[[f64; 3]] {
        &self.displacement
    }

    /// True if no particle is displaced. Looked at a few at a time, without a branch for each.
    pub fn is_undisplaced(&self) -> bool {
        let is_zero = |some: &[[f64; 3]]| some.as_flattened().iter().fold(true, |all, x| all & (*x == 0.0));
        self.displacement.chunks(16).all(is_zero)
    }

    /// Displacement of one particle; 0 for an unknown one.
    pub fn displacement(&self, particle: ParticleId) -> DVec3 {
        self.displacement.get(particle.0 as usize).map_or(DVec3::ZERO, |u| DVec3::from(*u))
    }

    /// Velocity of one particle, m/s.
    pub fn velocity(&self, particle: ParticleId) -> DVec3 {
        self.row_of.get(particle.0 as usize).map_or(DVec3::ZERO, |row| unpadded(&self.v[*row as usize]))
    }

    /// How far its velocity takes a particle in `h` seconds, metres: less than straight on, as its springs turn it round. None of it is left
    /// after half a swing (all others held, where `sin(x) / x` is drawn as the parabola with its zero).
    pub(super) fn way(&self, particle: ParticleId, h: f64) -> DVec3 {
        let Some(row) = self.row_of.get(particle.0 as usize).map(|row| *row as usize) else { return DVec3::ZERO };
        let swung = self.matrix.diagonal(row) * h * h / (PI * PI);
        unpadded(&self.v[row]) * (h * (1.0 - swung).max(0.0))
    }

    /// Rest displacement `u0` of one particle, metres.
    pub fn rest_displacement(&self, particle: ParticleId) -> DVec3 {
        self.row_of.get(particle.0 as usize).map_or(DVec3::ZERO, |row| unpadded(&self.rest[*row as usize]))
    }

    /// Puts a particle somewhere: displacement (metres) and velocity (m/s).
    pub fn set_state(&mut self, particle: ParticleId, displacement: DVec3, velocity: DVec3) {
        let Some(row) = self.accept(particle, &[displacement, velocity]) else { return };
        self.e[row] = padded(displacement - unpadded(&self.rest[row]));
        self.v[row] = padded(velocity);
        self.displacement[particle.0 as usize] = displacement.into();
        self.activity.disturb(row as u32);
    }

    /// Puts a new particle somewhere: it rests at `rest` from now on, and is `off` that (metres) with a velocity (m/s).
    pub fn set_start(&mut self, particle: ParticleId, rest: DVec3, off: DVec3, velocity: DVec3) {
        let Some(row) = self.accept(particle, &[rest, off, velocity]) else { return };
        (self.rest[row], self.next_rest[row]) = (padded(rest), padded(rest));
        self.set_state(particle, rest + off, velocity);
    }

    /// Where a particle rests from the end of the next step on (metres); over that step its rest displacement moves
    /// there linearly, which the step takes into account exactly.
    pub fn set_rest_displacement(&mut self, particle: ParticleId, rest: DVec3) {
        let Some(row) = self.accept(particle, &[rest]) else { return };
        self.move_rest(row, padded(rest));
    }

    /// A row is listed in `moved` once its next rest displacement differs from the present one.
    fn move_rest(&mut self, row: usize, rest: Lanes) {
        if self.next_rest[row] == self.rest[row] && rest != self.rest[row] {
            self.moved.push(row as u32);
            self.activity.disturb(row as u32);
        }
        self.next_rest[row] = rest;
    }

    /// [`Self::set_rest_displacement`] for every particle, in one pass; shape: as [`Self::len`].
    pub fn set_rest_displacements(&mut self, rest: &[[f64; 3]]) {
        for (particle, rest) in rest.iter().enumerate().take(self.row_of.len()) {
            if rest.iter().all(|x| x.abs() <= INPUT_LIMIT) {
                self.move_rest(self.row_of[particle] as usize, padded(DVec3::from(*rest)));
            } else {
                self.refused += 1;
            }
        }
    }

    /// Where a particle rests from now on (metres), with the particle: it is as far off its rest as it was, and whoever sleeps sleeps on.
    /// True if that is elsewhere than before.
    pub fn carry_rest(&mut self, particle: ParticleId, rest: DVec3) -> bool {
        let Some(row) = self.accept(particle, &[rest]) else { return false };
        let rest = padded(rest);
        let moves = self.rest[row] != rest;
        if moves {
            (self.rest[row], self.next_rest[row]) = (rest, rest);
            self.displacement[particle.index()] = unpadded(&self.u(row)).into();
        }
        moves
    }

    /// The external force on a particle, N, from now on until it is changed; constant over a step.
    pub fn set_force(&mut self, particle: ParticleId, force: DVec3) {
        let Some(row) = self.accept(particle, &[force]) else { return };
        if self.force[row] != padded(force) {
            self.force[row] = padded(force);
            self.activity.disturb(row as u32);
        }
    }

    /// Takes all external forces away.
    pub fn clear_forces(&mut self) {
        for row in 0..self.force.len() {
            if self.force[row] != [0.0; 4] {
                self.force[row] = [0.0; 4];
                self.activity.disturb(row as u32);
            }
        }
    }

    /// Holds exactly these particles (MATHS 4.1: eliminated as Dirichlet conditions), each with the displacement it is to
    /// have: it moves there linearly over the next step, which the step takes into account exactly, and stays until the
    /// next call. Particles held before and not named are let go with the velocity they had.
    pub fn set_grabs(&mut self, grabs: &[(ParticleId, DVec3)]) {
        std::mem::swap(&mut self.grabs, &mut self.released);
        for grab in &self.released {
            self.held[grab.row as usize] = false;
        }
        self.grabs.clear();
        for (particle, target) in grabs {
            let Some(row) = self.accept(*particle, &[*target]) else { continue };
            if std::mem::replace(&mut self.held[row], true) {
                continue;
            }
            self.grabs.push(Grab { row: row as u32, target: padded(*target) });
            let way = *target - DVec3::from(self.displacement[particle.0 as usize]);
            if self.is_motion(way) || self.v[row] != [0.0; 4] {
                self.activity.disturb(row as u32);
            }
        }
        for k in 0..self.released.len() {
            let row = self.released[k].row;
            if !self.held[row as usize] {
                self.activity.disturb(row);
            }
        }
        self.released.clear();
    }

    /// True if what a tool moves so far in a step is moved, and not only rounded.
    pub(super) fn is_motion(&self, way: DVec3) -> bool {
        way.length() > STILL * self.length
    }

    /// What holds a particle where it is: the force (N) that a hand must exert on it against springs, damping at `velocity`
    /// (m/s) and external force, its inertia left out; and the stiffness (N/m) that it meets there, all others held.
    pub fn holding(&self, particle: ParticleId, velocity: DVec3) -> (DVec3, f64) {
        let Some(row) = self.row_of.get(particle.0 as usize).map(|row| *row as usize) else { return (DVec3::ZERO, 0.0) };
        let mass = self.masses[row];
        let pull = unpadded(&self.matrix.apply_row(row, &self.e));
        let force = mass * (pull + self.settings.damping_rate() * velocity) - unpadded(&self.force[row]);
        (force, mass * self.matrix.diagonal(row))
    }

    /// True if a particle is held.
    pub fn is_grabbed(&self, particle: ParticleId) -> bool {
        self.row_of.get(particle.0 as usize).is_some_and(|row| self.held[*row as usize])
    }

    /// True if the next step has anything to do, if only to put what came to rest exactly there.
    pub fn awake(&self) -> bool {
        !self.activity.asleep() || !self.activity.awake.is_empty()
    }

    /// Particles that the last step moved.
    pub fn awake_particles(&self) -> usize {
        self.activity.awake.len()
    }

    /// The particles that the last step moved, in no particular order but always the same.
    pub fn awake_list(&self) -> impl Iterator<Item = ParticleId> + '_ {
        self.activity.awake.iter().map(|row| ParticleId(self.order[*row as usize]))
    }

    /// Steps taken back because they were not finite or beyond [`INPUT_LIMIT`].
    pub fn quarantined(&self) -> u64 {
        self.quarantined
    }

    /// Inputs refused because they were not finite, too large or named no particle.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Spectrum of `M^-1 K`, 1/s^2: softest mode and Gershgorin's bound of the stiffest.
    pub fn spectrum(&self) -> (f64, f64) {
        self.matrix.spectrum()
    }

    /// Kinetic and elastic energy, less the work of the constant external forces, J.
    pub fn energy(&self) -> f64 {
        let mut energy = 0.0;
        for row in 0..self.e.len() {
            let pull = self.matrix.apply_row(row, &self.e);
            for (k, pull) in pull.iter().enumerate() {
                let (e, v, mass) = (self.e[row][k], self.v[row][k], self.masses[row]);
                energy += 0.5 * mass * (v * v + pull * e) - self.force[row][k] * e;
            }
        }
        energy
    }

    /// Feeds state and targets, by particle, into `hash`.
    pub fn hash_into(&self, hash: &mut StateHash) {
        for row in &self.row_of {
            let row = *row as usize;
            for vector in [&self.e, &self.v, &self.rest, &self.force] {
                vector[row].iter().for_each(|x| hash.word(x.to_bits()));
            }
            hash.word(self.held[row] as u64);
        }
    }
}

pub(super) fn padded(x: DVec3) -> Lanes {
    [x.x, x.y, x.z, 0.0]
}

pub(super) fn unpadded(x: &Lanes) -> DVec3 {
    DVec3::new(x[0], x[1], x[2])
}

/// `values`, which are by old row, in the new order; `fill` for particles that had no row.
fn permuted<T: Copy>(values: &[T], old_row_of: &[u32], order: &[u32], fill: T) -> Vec<T> {
    let value = |particle: &u32| old_row_of.get(*particle as usize).map_or(fill, |row| values[*row as usize]);
    order.iter().map(value).collect()
}
