//! A tissue: mesh, rig, particles and dynamics of one soft body. Tissue space is metres relative to the tissue's origin.

mod bounded_cut;
mod cavities;
mod chords;
mod double_edges;
pub mod edit;
pub mod forces;
mod history;
mod holds;
mod inside;
pub mod measure;
pub mod pieces;
mod positions;
mod rotation;
mod sections;
mod sides;
pub mod stroke;
mod surface;
pub mod touch;
mod walls;

use crate::formats::{Material, Model};
use crate::geometry::room::{headroom, with_headroom};
use crate::geometry::sections::{cluster_faces, join_strays};
use crate::geometry::{Extraction, FaceId, Mesh, MeshDelta, ParticleId, SectionId, StateHash, Turn, VertexId};
use crate::particles::{
    Influence, ParticleMap, ParticleMapDelta, ParticleSettings, PlaneUpdateScratch, Strips, StripsDelta, UpdateScratch, sample,
};
use crate::physics::{Network, NetworkSettings, NetworkTopology, RigidPose, StepScratch};
use crate::rig::{Fades, Pose, PoseScratch, Rig, VertexRows, VertexRowsDelta, final_position};
use glam::DVec3;
use sections::SectionBounds;
use std::sync::Arc;

/// How a tissue is made from a model.
#[derive(Clone, Copy, Debug)]
pub struct TissueSettings {
    /// The soft layer; `None` leaves it out.
    pub particles: Option<ParticleSettings>,
    /// Its springs.
    pub network: NetworkSettings,
    /// Time in which a wound opens, seconds.
    pub opening_s: f64,
    /// Faces a section.
    pub section_faces: usize,
    /// How long offsets take to fade after an edit, seconds (MATHS 2.2).
    pub fade_s: f64,
}

/// The particles of a tissue, with their springs and the strips that keep wounds apart.
#[derive(Clone, Debug)]
pub struct SoftLayer {
    /// Spacing, radii, wound particles.
    pub settings: ParticleSettings,
    /// Anchors, influences, neighbours.
    pub map: ParticleMap,
    /// Wounds.
    pub strips: Strips,
    /// Displacements and velocities.
    pub network: Network,
    /// How far each wound particle has opened towards its rest displacement, in its anchor's rest frame, metres.
    pub opening: Vec<DVec3>,
    /// Time in which a wound opens, seconds: 95 % of the way (MATHS 3.3). 0: at once.
    pub opening_s: f64,
    /// Largest sum of weights that the limit of influences cut off at a vertex when the map was built.
    pub truncation_error: f64,
    /// Mass of a particle, kg: what forces on rigid bodies are scaled by; the network itself is of unit masses.
    pub particle_mass: f64,
}

/// Counters that change whenever what they name does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Versions {
    /// Mesh, rows, particle map.
    pub structure: u64,
    /// Joint matrices.
    pub pose: u64,
    /// Particle displacements.
    pub displacements: u64,
    /// Displacements that edits gave new particles.
    pub starts: u64,
    /// Fades.
    pub fades: u64,
    /// Rotations of the particles.
    pub rotations: u64,
}

/// One soft body.
pub struct Tissue {
    /// For people.
    pub name: String,
    mesh: Mesh,
    rows: VertexRows,
    rest: Vec<DVec3>,
    rig: Arc<Rig>,
    materials: Arc<Vec<Material>>,
    offset: DVec3,
    frame: RigidPose,
    diagonal: f64,
    /// Length of what it came from as loaded, over its length in the space of its rows: 1 for all but models whose joints scale.
    rest_scale: f64,
    layer: Option<SoftLayer>,
    fades: Fades,
    time_s: f64,
    pose: Pose,
    animation: Option<usize>,
    sections: SectionBounds,
    versions: Versions,
    scratch: TissueScratch,
    touch: touch::Touch,
    forces: forces::ForceState,
    section_faces: usize,
    opening_s: f64,
    /// Rows that grew too long and became base vertices, so far.
    promoted_vertices: usize,
    tally: measure::Tally,
    /// Of a piece: what it was in the tissue that it came off.
    came_from: pieces::CameFrom,
}

/// All that final positions depend on, apart from the mesh.
struct Posed<'a> {
    rows: &'a VertexRows,
    pose: &'a Pose,
    fades: &'a Fades,
    layer: Option<&'a SoftLayer>,
    time_s: f64,
    /// True if nothing displaces a vertex: its skinned position is its final one.
    still: bool,
    /// Final positions as they lie there, if no joint moves anything either.
    rest: Option<&'a [DVec3]>,
}

impl Posed<'_> {
    #[inline]
    fn position(&self, v: VertexId) -> DVec3 {
        match self.rest {
            Some(rest) => rest[v.index()],
            None if self.still => self.pose.skin(self.rows, v),
            None => self.displaced(v),
        }
    }

    fn displaced(&self, v: VertexId) -> DVec3 {
        let (row, displacements, turns) = match self.layer {
            // a vertex inserted a moment ago has no row yet
            Some(layer) if v.index() < layer.map.influences.rows() => {
                (layer.map.influences.row(v.index()), layer.displacements(), layer.network.turns())
            }
            _ => (&[][..], &[][..], &[][..]),
        };
        final_position(self.rows, self.pose, self.fades, self.time_s, v, motions(row, displacements, turns))
    }
}

/// Displacement, turn and weight of each influence of a row.
fn motions<'a>(
    row: &'a [Influence],
    displacements: &'a [DVec3],
    turns: &'a [Turn],
) -> impl Iterator<Item = (DVec3, Option<&'a Turn>, f64)> {
    row.iter().map(|i| {
        let p = i.particle.index();
        (displacements[p], turns.get(p), f64::from(i.weight))
    })
}

/// Buffers of one tissue, kept between frames.
#[derive(Default)]
struct TissueScratch {
    /// Faces that a cut may reach.
    faces: Vec<FaceId>,
    /// Corners of walls, by section.
    corners: Vec<(SectionId, VertexId)>,
    pose: PoseScratch,
    step: StepScratch,
    update: UpdateScratch,
    /// What an update of the particle map is told of new vertices, and where it is to hold others.
    new_vertices: Vec<crate::particles::NewVertex>,
    targets: Vec<(VertexId, DVec3)>,
    plane_update: PlaneUpdateScratch,
    extraction: Extraction,
    rest_displacements: Vec<[f64; 3]>,
    hands: holds::Hands,
    /// Held particles and their displacements, by hands and by bodies.
    all_held: Vec<(ParticleId, DVec3)>,
    turns: rotation::TurnScratch,
    chords: chords::ChordScratch,
    double_edges: double_edges::DoubleEdgeScratch,
    /// What an edit that was taken back had changed.
    taken_back: MeshDelta,
    crumbs: Vec<VertexId>,
    /// Versions of the pose and of the structure for which all particles are at rest, and told where that is.
    rests: Option<[u64; 2]>,
    /// Versions of the pose and of the structure at the last step.
    stepped: Option<[u64; 2]>,
}

/// Vertices that an edit makes, as many as there is room for at first.
const EDIT_ROOM: usize = 1024;
/// A wound this near to its full opening, as a fraction of the diagonal, has opened.
const OPENED: f64 = 1e-7;
/// Latest time on the clock, s: fades begin in f32, as the GPU has them, where a second is told from the next up to here.
const LATEST_S: f64 = 16_777_216.0;

/// The springs of a particle, as networks take them.
fn springs(map: &ParticleMap, p: usize) -> impl Iterator<Item = (u32, f32)> + '_ {
    map.neighbours.row(p).iter().map(|l| (l.particle.0, l.weight))
}

/// The network of a map.
fn topology(map: &ParticleMap) -> NetworkTopology {
    NetworkTopology::from_rows(map.len(), |p| springs(map, p))
}

impl SoftLayer {
    /// Moves every wound particle's opening towards its rest displacement, which the map may have changed.
    fn open_wounds(&mut self, step_s: f64, diagonal: f64) {
        self.opening.resize(self.map.len(), DVec3::ZERO);
        // e^-3 is 5 % left
        let left = if self.opening_s > 0.0 { (-3.0 * step_s / self.opening_s).exp() } else { 0.0 };
        for (now, goal) in self.opening.iter_mut().zip(self.map.rest_displacement.iter()) {
            let goal = DVec3::from_array(*goal);
            if *now != goal {
                let missing = (*now - goal) * left;
                *now = if missing.length() > OPENED * diagonal { goal + missing } else { goal };
            }
        }
    }

    /// Wound particles go with their anchors as `pose` turns those: nobody wakes. True if any has gone.
    fn carry_wounds(&mut self, rows: &VertexRows, pose: &Pose) -> bool {
        let mut any = false;
        for p in 0..self.opening.len().min(self.map.len()) {
            if self.opening[p] != DVec3::ZERO {
                let rest = self.opened(p, rows, pose);
                any |= self.network.carry_rest(ParticleId::new(p), rest);
            }
        }
        any
    }

    /// How far its wound has drawn a particle aside by now, metres, as `pose` turns it.
    fn opened(&self, particle: usize, rows: &VertexRows, pose: &Pose) -> DVec3 {
        let opening = self.opening.get(particle).copied().unwrap_or_default();
        let anchor = self.map.anchors[particle];
        if opening == DVec3::ZERO || anchor.is_none() { DVec3::ZERO } else { pose.blended_carry(rows, anchor, opening) }
    }

    /// True while a wound opens.
    pub fn is_opening(&self) -> bool {
        let differ = |(now, goal): (&DVec3, &[f64; 3])| now.to_array() != *goal;
        self.opening.len() != self.map.len() || self.opening.iter().zip(self.map.rest_displacement.iter()).any(differ)
    }

    /// Displacements `u` of all particles, tissue space, metres.
    pub fn displacements(&self) -> &[DVec3] {
        bytemuck::cast_slice(self.network.displacements())
    }
}

/// Everything that one edit changed in a tissue (MATHS 7). Proportional to what was touched.
#[derive(Clone, Debug, Default)]
pub struct TissueDelta {
    /// Topology and attributes.
    pub mesh: crate::geometry::MeshDelta,
    /// Rows.
    pub rows: VertexRowsDelta,
    /// Particle map.
    pub map: ParticleMapDelta,
    /// Strips.
    pub strips: StripsDelta,
}

impl TissueDelta {
    /// True if nothing changed.
    pub fn is_empty(&self) -> bool {
        let Self { mesh, rows, map, strips } = self;
        let rows_rest = rows.rest_position.is_empty() && rows.rows.is_empty() && rows.bones.is_empty();
        let particles_rest = map.anchors.is_empty() && map.rest_displacement.is_empty();
        mesh.is_empty()
            && rows_rest
            && particles_rest
            && map.influences.is_empty()
            && map.neighbours.is_empty()
            && strips.is_empty()
    }
}

/// Why a tissue could not be made.
#[derive(Debug, thiserror::Error)]
pub enum TissueError {
    /// Bad particle settings.
    #[error("particles: {0}")]
    Particles(#[from] crate::particles::SettingsError),
    /// Bad spring settings.
    #[error("dynamics: {0}")]
    Dynamics(#[from] crate::physics::SettingsError),
}

impl Tissue {
    /// Builds a tissue in the model's rest pose, with its particles at rest.
    pub fn new(model: Model, settings: &TissueSettings) -> Result<Self, TissueError> {
        let Model { name, mesh, rows, rig, materials, offset, .. } = model;
        let rest: Vec<DVec3> = (0..rows.len()).map(|v| rows.rest(VertexId::new(v))).collect();
        let pose = rig.rest_pose();
        let mut tissue = Self {
            name,
            mesh,
            rows,
            rest,
            rig: Arc::new(rig),
            materials: Arc::new(materials),
            offset,
            frame: RigidPose::at(offset),
            diagonal: 0.0,
            rest_scale: 1.0,
            layer: None,
            fades: Fades::new(settings.fade_s),
            time_s: 0.0,
            pose,
            animation: None,
            sections: SectionBounds::default(),
            versions: Versions { structure: 1, pose: 1, displacements: 1, starts: 0, fades: 1, rotations: 1 },
            scratch: TissueScratch::default(),
            touch: touch::Touch::default(),
            forces: forces::ForceState::default(),
            section_faces: settings.section_faces,
            opening_s: settings.opening_s,
            promoted_vertices: 0,
            tally: measure::Tally::default(),
            came_from: Default::default(),
        };
        tissue.build_sections();
        let (low, high) = tissue.bounds();
        tissue.diagonal = (high - low).length();
        tissue.find_rest_scale();
        if let Some(particles) = settings.particles {
            let mut layer = tissue.build_layer(particles, settings.network.checked()?)?;
            layer.particle_mass = tissue.mass_guess() / layer.map.len().max(1) as f64;
            tissue.layer = Some(layer);
        }
        tissue.discard_delta();
        tissue.make_room();
        tissue.refresh_tally();
        Ok(tissue)
    }

    fn build_layer(&self, settings: ParticleSettings, network: NetworkSettings) -> Result<SoftLayer, TissueError> {
        for warning in settings.validate()? {
            tracing::warn!("{warning}");
        }
        let anchors = sample(&self.mesh, &self.rest, settings.spacing, settings.seed);
        let (map, report) = ParticleMap::build(&self.mesh, &self.rest, &anchors, &settings);
        tracing::debug!(particles = anchors.len(), truncation = report.truncation_error, "soft layer");
        let network = Network::new(&topology(&map), network, self.diagonal)?;
        let (opening, opening_s) = (vec![DVec3::ZERO; map.len()], self.opening_s);
        let mut strips = Strips::for_vertices(self.rest.len());
        strips.prepare(&self.rest, &map, &settings);
        let truncation_error = report.truncation_error;
        Ok(SoftLayer { settings, map, strips, network, opening, opening_s, truncation_error, particle_mass: 1.0 })
    }

    fn build_sections(&mut self) {
        let (count, mut section) = cluster_faces(&self.mesh, |v| self.rest[v.index()], self.section_faces);
        join_strays(&self.mesh, count, &mut section);
        self.mesh.assign_sections(count, &section);
        self.sections = SectionBounds::build(&self.mesh, &self.rows);
        self.refresh_sections();
    }

    /// Topology, wedges, sections.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Rest positions, bones and rows.
    pub fn rows(&self) -> &VertexRows {
        &self.rows
    }

    /// Nodes, joints and animations, shared by all pieces of a model.
    pub fn rig(&self) -> &Arc<Rig> {
        &self.rig
    }

    /// Materials, shared by all pieces of a model.
    pub fn materials(&self) -> &Arc<Vec<Material>> {
        &self.materials
    }

    /// Origin of tissue space in model space as loaded, metres; where it stands now is [`Tissue::frame`].
    pub fn offset(&self) -> DVec3 {
        self.offset
    }

    /// Diagonal of the bounds at rest of the model it came from, metres: the yardstick of tolerances.
    pub fn diagonal(&self) -> f64 {
        self.diagonal
    }

    /// Vertices so far whose rows grew too long and that became base vertices (MATHS 1.4).
    pub fn promoted_vertices(&self) -> usize {
        self.promoted_vertices
    }

    /// The soft layer, if there is one.
    pub fn layer(&self) -> Option<&SoftLayer> {
        self.layer.as_ref()
    }

    /// The soft layer, to grab, push and set.
    pub fn layer_mut(&mut self) -> Option<&mut SoftLayer> {
        self.layer.as_mut()
    }

    /// Joint matrices now.
    pub fn pose(&self) -> &Pose {
        &self.pose
    }

    /// Fades now.
    pub fn fades(&self) -> &Fades {
        &self.fades
    }

    /// The tissue's clock, seconds.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Change counters.
    pub fn versions(&self) -> Versions {
        self.versions
    }

    /// Rest positions of all vertex slots, f64.
    pub fn rest_positions(&self) -> &[DVec3] {
        &self.rest
    }

    /// Sets the clock and the pose: `animation` at `animation_time_s` (looped by the caller). Times that are not finite, and a clock
    /// that half a year would not bring there, change nothing: what fades in would be nowhere.
    pub fn set_pose(&mut self, time_s: f64, animation: Option<usize>, animation_time_s: f64) {
        if !(time_s.abs() <= LATEST_S && animation_time_s.is_finite()) {
            return;
        }
        self.time_s = time_s;
        if animation.is_none() && self.animation.is_none() && self.versions.pose > 1 {
            return; // a resting pose is set once
        }
        self.animation = animation;
        let rig = self.rig.clone();
        rig.pose(animation, animation_time_s, &mut self.scratch.pose, &mut self.pose);
        self.versions.pose += 1;
        self.refresh_turns();
    }

    /// Final position of a vertex as the user sees it, tissue space (MATHS 2.1, 2.2).
    pub fn position(&self, v: VertexId) -> DVec3 {
        let Self { rows, pose, fades, layer, time_s, .. } = self;
        Posed { rows, pose, fades, layer: layer.as_ref(), time_s: *time_s, still: false, rest: None }.displaced(v)
    }

    /// [`Tissue::position`] for many vertices.
    fn posed(&self) -> Posed<'_> {
        let still = self.is_still();
        let Self { rows, rest, pose, fades, layer, time_s, .. } = self;
        let rest = (still && pose.joint_matrices.is_empty()).then_some(rest.as_slice());
        Posed { rows, pose, fades, layer: layer.as_ref(), time_s: *time_s, still, rest }
    }

    /// True if neither particles nor fades displace anything now: final positions are skinned ones, bit for bit.
    fn is_still(&self) -> bool {
        let at_rest = |l: &SoftLayer| l.network.turns().is_empty() && l.network.is_undisplaced();
        self.layer.as_ref().is_none_or(at_rest) && !self.fades.running(self.time_s)
    }

    /// Carries posed points (tissue space) to rest space with the frame of vertex `v`, which is seen at `at`.
    fn rest_frame(&self, v: VertexId, at: DVec3) -> impl Fn(DVec3) -> DVec3 + use<> {
        let linear = self.linear(v);
        let inverse = if linear.determinant().abs() > 1e-9 { linear.inverse() } else { glam::DMat3::IDENTITY };
        let rest = self.rest[v.index()];
        move |p| rest + inverse * (p - at)
    }

    /// Carries rest-space points to the pose with the frame of vertex `v`: the way back of [`Tissue::rest_frame`].
    fn posed_frame(&self, v: VertexId) -> impl Fn(DVec3) -> DVec3 + use<> {
        let (rest, at, linear) = (self.rest[v.index()], self.position(v), self.linear(v));
        move |p| at + linear * (p - rest)
    }

    /// Brings the section bounds to the current pose: [`Tissue::blade_entry`] looks by them. Costs next to nothing while the pose stays.
    pub fn refresh_sections(&mut self) {
        let version = self.versions.pose;
        self.sections.refresh(&self.pose, version);
        self.refresh_turn_reach();
    }

    /// Skinned position of a vertex, without displacement, tissue space.
    pub fn skinned(&self, v: VertexId) -> DVec3 {
        self.pose.skin(&self.rows, v)
    }

    /// Bounds of all live vertices' final positions, tissue space.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.mesh
            .live_vertices()
            .map(|v| self.position(v))
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)))
    }

    /// True if neither springs nor fades move the tissue.
    pub fn is_asleep(&self) -> bool {
        !self.layer.as_ref().is_some_and(|l| l.network.awake() || l.is_opening()) && !self.fades.running(self.time_s)
    }

    /// Everything that edits have changed since the last call.
    pub fn take_delta(&mut self) -> TissueDelta {
        let mut delta = TissueDelta::default();
        self.take_delta_into(&mut delta);
        delta
    }

    /// [`Tissue::take_delta`] into a delta whose room is used again.
    pub fn take_delta_into(&mut self, delta: &mut TissueDelta) {
        self.note_edits();
        if let Some(layer) = &mut self.layer {
            layer.map.take_delta_into(&mut delta.map);
            layer.strips.take_delta_into(&mut delta.strips);
        } else {
            (delta.map, delta.strips) = Default::default();
        }
        self.mesh.take_delta_into(&mut delta.mesh);
        self.rows.take_delta_into(&mut delta.rows);
    }

    /// Makes room in every array for what edits append, so that none is copied as a whole in an edit.
    fn make_room(&mut self) {
        self.mesh.make_room_for_walls();
        self.mesh.make_room();
        self.rows.make_room();
        self.sections.make_room();
        self.rest.reserve(headroom(self.rest.len()));
        self.scratch.new_vertices.reserve(EDIT_ROOM);
        self.scratch.targets.reserve(EDIT_ROOM);
        self.scratch.corners.reserve(EDIT_ROOM);
        self.scratch.double_edges.make_room();
        self.scratch.taken_back.make_room(1);
        self.scratch.crumbs.reserve(EDIT_ROOM);
        if !self.rig.skins.is_empty() {
            self.scratch.chords.make_room(with_headroom(self.rest.len()));
        }
        self.fades.make_room(self.rest.len());
        if let Some(layer) = &mut self.layer {
            layer.map.make_room();
            layer.strips.make_room(self.rest.len(), layer.map.len());
            layer.network.make_room();
            self.scratch.update.make_room(self.rest.len(), layer.map.len());
            let particles = with_headroom(layer.map.len());
            self.scratch.rest_displacements.reserve(particles);
            self.scratch.step.make_room(particles);
            self.scratch.hands.make_room(particles);
            self.scratch.all_held.reserve(particles);
            layer.opening.reserve(particles);
        }
    }

    fn discard_delta(&mut self) {
        self.take_delta();
    }

    /// Hash of topology, rows, attributes, particle map and strips (MATHS 7).
    pub fn edit_hash(&self, hash: &mut StateHash) {
        self.mesh.hash_arrays(hash);
        self.rows.hash_into(hash);
        if let Some(layer) = &self.layer {
            layer.map.hash_into(hash);
            layer.strips.hash_into(hash);
        }
    }

    /// Adds dynamics to [`Tissue::edit_hash`]: displacements, velocities, fades.
    pub fn state_hash(&self, hash: &mut StateHash) {
        self.edit_hash(hash);
        hash.bytes(bytemuck::cast_slice(self.fades.entries()));
        let RigidPose { rotation, translation } = self.frame;
        rotation.to_array().into_iter().chain(translation.to_array()).for_each(|x| hash.word(x.to_bits()));
        if let Some(layer) = &self.layer {
            layer.network.hash_into(hash);
            hash.bytes(bytemuck::cast_slice(&layer.opening));
        }
    }
}
