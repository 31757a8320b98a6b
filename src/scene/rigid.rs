//! The rigid world of a scene: what a user's instruments push, and pieces that fall once they have come off (MATHS 4.4, 6).

use super::{Scene, TissueId};
use crate::geometry::VertexId;
use crate::physics::{BodyId, LEAST_STEP, MAX_STEP, RigidPose, RigidShape, RigidWorld};
use crate::tissue::Tissue;
use glam::DVec3;
use std::collections::BTreeMap;

/// Which pieces fall once a tissue has come apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fixed {
    /// The largest piece stays.
    #[default]
    Largest,
    /// The piece on the skeleton's first joint stays; without a skeleton, the largest.
    Root,
}

/// How severed pieces behave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PieceSettings {
    /// Whether they fall at all.
    pub fall: bool,
    /// Which one stays.
    pub fixed: Fixed,
    /// Their density, kg/m^3.
    pub density: f64,
}

impl Default for PieceSettings {
    fn default() -> Self {
        Self { fall: false, fixed: Fixed::Largest, density: crate::tissue::touch::DENSITY }
    }
}

/// A rigid body as a user sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColliderView {
    /// The number it was placed with.
    pub id: u32,
    /// Its shape.
    pub shape: RigidShape,
    /// `model_from_collider`.
    pub pose: RigidPose,
    /// Force that tissues put on it, N.
    pub reaction: DVec3,
}

struct Collider {
    body: BodyId,
    shape: RigidShape,
    target: RigidPose,
}

/// The hull of a tissue as a rigid body: a loose one's, or that of one that stays and that loose ones lie on, a stand.
struct Hull {
    body: BodyId,
    /// Empty once they are to be chosen anew.
    vertices: Vec<VertexId>,
    /// Where they were when the body got its shape, and in which pose and under which displacements.
    points: Vec<DVec3>,
    seen: [u64; 2],
}

fn seen(tissue: &Tissue) -> [u64; 2] {
    [tissue.versions().pose, tissue.versions().displacements]
}

impl Hull {
    /// None for a tissue without extent, or whatever `add` refuses.
    fn new(tissue: &Tissue, add: impl FnOnce(&[DVec3]) -> Option<BodyId>) -> Option<Self> {
        let vertices = tissue.hull_vertices(HULL_POINTS);
        let mut points = Vec::new();
        tissue.hull_points(&vertices, &mut points);
        Some(Self { body: add(&points)?, vertices, points, seen: seen(tissue) })
    }

    /// Follows the animation and the soft layer, a little at a time.
    fn follow(&mut self, tissue: &Tissue, world: &mut RigidWorld, points: &mut Vec<DVec3>) {
        if self.vertices.is_empty() {
            self.vertices = tissue.hull_vertices(HULL_POINTS);
        } else if self.seen == seen(tissue) {
            return;
        }
        self.seen = seen(tissue);
        tissue.hull_points(&self.vertices, points);
        let moved = |(a, b): (&DVec3, &DVec3)| a.distance(*b) > FOLLOWS * tissue.diagonal();
        if points.len() != self.points.len() || points.iter().zip(&self.points).any(moved) {
            world.reshape(self.body, points);
            std::mem::swap(&mut self.points, points);
        }
    }
}

/// Bodies of instruments and of loose pieces.
pub(super) struct Rigid {
    world: RigidWorld,
    colliders: BTreeMap<u32, Collider>,
    /// Loose tissues and their bodies, whose origin is the tissue's.
    loose: BTreeMap<TissueId, Hull>,
    /// Of the others, while there are loose ones.
    stands: BTreeMap<TissueId, Hull>,
    /// Pieces have come off or gone back since the stands were made.
    stands_due: bool,
    /// Those that have come off since then.
    came_off: Vec<TissueId>,
    /// Of a hull, for the time of a look at it.
    points: Vec<DVec3>,
    /// For each piece that came off: what it came off, and whether that was loose already.
    parents: BTreeMap<TissueId, (TissueId, bool)>,
    settings: PieceSettings,
    /// Bounds of the model as it was loaded, down to where it goes in the animation: what the table lies under.
    ground: (DVec3, DVec3),
    /// How far down they go as it was loaded.
    lowest_at_rest: f64,
}

/// Longest step while rigid bodies touch or fall, s; longer ones are split, [`MOST_PARTS`] at most.
const LONGEST_TOUCH: f64 = 1.0 / 40.0;
/// Most parts of a step.
const MOST_PARTS: usize = 40;
/// Directions in which a loose piece's hull reaches as far as the piece.
const HULL_POINTS: usize = 64;
/// A piece that reaches deeper than this into what it came off, in diagonals of the model, passes through it.
const MOST_OVERLAP: f64 = 0.02;
/// A hull takes another shape once a corner has moved by this, in diagonals of the tissue.
const FOLLOWS: f64 = 0.01;
/// The table lies this far under the model, in half diagonals: where the tray is drawn.
const TABLE_GAP: f64 = 0.015;
/// Times of an animation at which is looked how far down it goes, and vertices that are looked at, at most, at each of them, and where
/// those go lowest.
const GROUND_TIMES: usize = 32;
const GROUND_VERTICES: [usize; 2] = [512, 8192];

impl Rigid {
    pub(super) fn new(tissue: &Tissue) -> Self {
        let (low, high) = tissue.bounds();
        let ground = (tissue.to_model(low), tissue.to_model(high));
        Self {
            world: RigidWorld::new(DVec3::Y, tissue.diagonal()),
            colliders: BTreeMap::new(),
            loose: BTreeMap::new(),
            stands: BTreeMap::new(),
            stands_due: false,
            came_off: Vec::new(),
            points: Vec::new(),
            parents: BTreeMap::new(),
            settings: PieceSettings::default(),
            lowest_at_rest: ground.0.y,
            ground,
        }
    }

    /// Number of equal parts that a step of `h` seconds is made in.
    fn parts(&self, h: f64) -> usize {
        let active = !self.colliders.is_empty() || !self.loose.is_empty();
        if active { ((h / LONGEST_TOUCH - 1e-9).ceil() as usize).clamp(1, MOST_PARTS) } else { 1 }
    }

    /// The body of a loose tissue.
    pub(super) fn body_of(&self, id: TissueId) -> Option<BodyId> {
        self.loose.get(&id).map(|hull| hull.body)
    }

    fn drop_body(&mut self, id: TissueId) {
        if let Some(hull) = self.loose.remove(&id) {
            self.world.remove(hull.body);
        }
    }

    /// Gives a tissue a body where it stands, moving as it did. One without extent stays where it is.
    fn loosen(&mut self, id: TissueId, tissue: &Tissue) {
        let velocity = self.loose.get(&id).map_or(DVec3::ZERO, |hull| self.world.velocity(hull.body));
        self.drop_body(id);
        let mass = tissue.mass_guess() * self.settings.density / crate::tissue::touch::DENSITY;
        let hull = Hull::new(tissue, |points| self.world.add_hull(points, mass, tissue.frame()));
        if let Some(hull) = hull {
            self.world.set_velocity(hull.body, velocity);
            self.loose.insert(id, hull);
        }
    }

    /// Makes what loose pieces may lie on: what stays of the model. Nothing while none is loose.
    fn make_stands(&mut self, tissues: &BTreeMap<TissueId, Box<Tissue>>) {
        for hull in std::mem::take(&mut self.stands).into_values() {
            self.world.remove(hull.body);
        }
        let came_off = std::mem::take(&mut self.came_off);
        if self.loose.is_empty() {
            return;
        }
        for (&id, tissue) in tissues.iter().filter(|(id, _)| !self.loose.contains_key(id)) {
            let hull = Hull::new(tissue, |points| self.world.add_stand(points, tissue.frame()));
            self.stands.extend(hull.map(|hull| (id, hull)));
        }
        // A flap cut out of a hollow: no plane parts it from the rest, and their hulls would throw it out.
        let most = MOST_OVERLAP * (self.ground.1 - self.ground.0).length();
        let Self { world, loose, stands, .. } = self;
        for body in came_off.iter().filter_map(|id| loose.get(id)).map(|hull| hull.body) {
            if stands.values().any(|s| world.overlap(s.body, body) > most) {
                world.pass_stands(body);
            }
        }
    }

    /// To be called for a tissue that an undo or a redo has changed: its vertices may be others.
    pub(super) fn rechoose_hull(&mut self, id: TissueId) {
        let hulls = self.loose.get_mut(&id).into_iter().chain(self.stands.get_mut(&id));
        hulls.for_each(|hull| hull.vertices.clear());
    }

    /// Brings hulls to what is seen.
    fn sync_hulls(&mut self, tissues: &BTreeMap<TissueId, Box<Tissue>>) {
        if std::mem::take(&mut self.stands_due) {
            self.make_stands(tissues);
        }
        for (id, hull) in self.loose.iter_mut().chain(&mut self.stands) {
            if let Some(tissue) = tissues.get(id) {
                hull.follow(tissue, &mut self.world, &mut self.points);
            }
        }
    }
}

/// How high the table lies under something with these bounds.
fn table_under((low, high): (DVec3, DVec3)) -> f64 {
    low.y - TABLE_GAP * 0.5 * (high - low).length()
}

/// How far down a tissue goes in an animation, model space; infinite without one.
fn lowest_in(tissue: &Tissue, animation: Option<usize>) -> f64 {
    let Some(duration) = animation.and_then(|a| tissue.rig().animations.get(a)).map(|a| a.duration_s) else {
        return f64::INFINITY;
    };
    let [few, more] = GROUND_VERTICES.map(|most| tissue.mesh().vertex_slots().div_ceil(most).max(1));
    let lowest_at = |k: usize, each: usize| {
        let pose = tissue.rig().pose_at(animation, duration * k as f64 / GROUND_TIMES as f64);
        let heights = tissue.mesh().live_vertices().step_by(each).map(|v| tissue.to_model(pose.skin(tissue.rows(), v)).y);
        heights.fold(f64::INFINITY, f64::min)
    };
    let low = (0..GROUND_TIMES).map(|k| (lowest_at(k, few), k)).min_by(|a, b| a.0.total_cmp(&b.0));
    low.map_or(f64::INFINITY, |(low, k)| if more < few { low.min(lowest_at(k, more)) } else { low })
}

impl Scene {
    /// How pieces behave from now on. They do not fall unless this says so.
    pub fn set_pieces(&mut self, settings: PieceSettings) {
        self.rigid.settings = settings;
        let table = table_under(self.rigid.ground);
        self.rigid.world.set_table(settings.fall.then_some(table));
    }

    /// The table, and with it the tray, lies under what the animation sends below that of the model at rest.
    pub(super) fn place_table(&mut self) {
        let (low, high) = self.rigid.ground;
        let at_rest = (low.with_y(self.rigid.lowest_at_rest), high);
        // what lies on the table does not let it down
        let stand = self.tissues.iter().filter(|(id, _)| !self.rigid.loose.contains_key(id));
        let lowest = stand.map(|(_, t)| lowest_in(t, self.animation)).fold(f64::INFINITY, f64::min);
        let low = if lowest < table_under(at_rest) { low.with_y(lowest) } else { at_rest.0 };
        if self.rigid.ground.0 != low {
            self.rigid.ground.0 = low;
            self.set_pieces(self.rigid.settings);
        }
    }

    /// How much of weight and inertia the particles of every tissue feel.
    pub fn set_body_forces(&mut self, forces: crate::tissue::forces::BodyForces) {
        self.tissues.values_mut().for_each(|t| t.set_body_forces(forces));
    }

    /// Bounds of the model as it was loaded, model space: what the table and the tray lie under, wherever pieces roll. Down to where it goes
    /// in the animation, if that is below the table of the model at rest.
    pub fn ground_bounds(&self) -> (DVec3, DVec3) {
        self.rigid.ground
    }

    /// Instruments, hands and other rigid bodies, by id.
    pub fn colliders(&self) -> impl Iterator<Item = ColliderView> + '_ {
        self.rigid.colliders.iter().map(|(&id, c)| ColliderView {
            id,
            shape: c.shape,
            pose: self.rigid.world.pose(c.body).unwrap_or(c.target),
            reaction: self.rigid.world.reaction(c.body),
        })
    }

    /// True for a piece that has come off and falls.
    pub fn is_loose(&self, id: TissueId) -> bool {
        self.rigid.loose.contains_key(&id)
    }

    /// Puts a rigid body into the scene, or moves it: over the next step it goes from where it is to `pose` (model space) and
    /// takes along what is in its way. Another shape under the same id is a new body. Nonsense is ignored.
    pub(super) fn place_collider(&mut self, id: u32, shape: RigidShape, pose: RigidPose) {
        let rigid = &mut self.rigid;
        let Some(pose) = rigid.world.within(pose) else { return };
        if let Some(known) = rigid.colliders.get_mut(&id)
            && known.shape == shape
        {
            known.target = pose;
            return;
        }
        self.remove_collider(id);
        if let Some(body) = self.rigid.world.add_driven(shape, pose) {
            self.rigid.colliders.insert(id, Collider { body, shape, target: pose });
        }
    }

    /// Takes a rigid body away.
    pub(super) fn remove_collider(&mut self, id: u32) {
        if let Some(collider) = self.rigid.colliders.remove(&id) {
            self.rigid.world.remove(collider.body);
        }
    }

    /// Advances rigid bodies and soft layers by `step_s` seconds. A step of less than a microsecond does nothing; one over a second
    /// counts as a second; while rigid bodies touch or fall, long steps are made in parts.
    pub fn step(&mut self, step_s: f64) {
        let h = if step_s >= LEAST_STEP { step_s.min(MAX_STEP) } else { 0.0 };
        let parts = self.rigid.parts(h);
        self.rigid.sync_hulls(&self.tissues);
        for part in 0..parts {
            self.step_part(h / parts as f64, parts - part);
        }
    }

    /// One part; `left` parts remain, this one included.
    fn step_part(&mut self, h: f64, left: usize) {
        let Rigid { world, colliders, loose, .. } = &mut self.rigid;
        for collider in colliders.values() {
            let Some(from) = world.pose(collider.body) else { continue };
            let share = 1.0 / left as f64;
            world.drive(collider.body, from.toward(&collider.target, share));
        }
        world.step(h);
        for (id, hull) in loose.iter() {
            if let (Some(tissue), Some(pose)) = (self.tissues.get_mut(id), world.pose(hull.body)) {
                tissue.set_frame(pose);
            }
        }
        self.move_grabs();
        let Rigid { world, loose, .. } = &mut self.rigid;
        let rests = world.is_resting();
        for (id, tissue) in &mut self.tissues {
            tissue.touch((world, rests), loose.get(id).map(|hull| hull.body), h);
            tissue.step(h);
        }
        for (id, tissue) in &self.tissues {
            tissue.react(world, loose.get(id).map(|hull| hull.body));
        }
    }

    /// True if no rigid body moves.
    pub(super) fn rigid_rests(&self) -> bool {
        let placed = |c: &Collider| self.rigid.world.pose(c.body) == Some(c.target);
        self.rigid.world.is_resting() && self.rigid.colliders.values().all(placed)
    }

    /// Pieces have come off `parent`: all but the one that is fixed fall from now on.
    pub(super) fn pieces_came_off(&mut self, parent: TissueId, made: &[TissueId]) {
        if !self.rigid.settings.fall || made.is_empty() {
            return;
        }
        let was_loose = self.rigid.loose.contains_key(&parent);
        let all: Vec<TissueId> = std::iter::once(parent).chain(made.iter().copied()).collect();
        let stays = if was_loose { None } else { self.fixed_among(&all) };
        for &id in &all {
            if id != parent {
                self.rigid.parents.insert(id, (parent, was_loose));
            }
            if let Some(tissue) = self.tissues.get(&id).filter(|_| Some(id) != stays) {
                self.rigid.loosen(id, tissue);
            }
        }
        self.rigid.stands_due = true;
        self.rigid.came_off.extend(all);
    }

    /// The piece that stays: by the root if that is what holds, then by area at rest, the first among equals.
    fn fixed_among(&self, pieces: &[TissueId]) -> Option<TissueId> {
        let by_root = self.rigid.settings.fixed == Fixed::Root;
        let root = |id: &TissueId| self.tissues.get(id).filter(|_| by_root).map_or(0.0, |tissue| tissue.root_weight());
        let roots: Vec<f64> = pieces.iter().map(root).collect();
        let most = roots.iter().copied().fold(0.0, f64::max);
        let best: Vec<TissueId> = pieces.iter().zip(&roots).filter(|(_, root)| **root == most).map(|(id, _)| *id).collect();
        if best.len() < 2 {
            return best.first().copied();
        }
        let area = |id: &TissueId| self.tissues.get(id).map_or(0.0, |t| t.measure_at_rest().area);
        // the last of equals is taken, so backwards
        best.iter().rev().map(|id| (*id, area(id))).max_by(|a, b| a.1.total_cmp(&b.1)).map(|(id, _)| id)
    }

    /// A severing was undone: the piece is gone, and what it came off is back where it was.
    pub(super) fn piece_went_back(&mut self, piece: TissueId) {
        self.rigid.drop_body(piece);
        if let Some(&(parent, was_loose)) = self.rigid.parents.get(&piece) {
            if !was_loose {
                self.rigid.drop_body(parent);
                if let Some(tissue) = self.tissues.get_mut(&parent) {
                    tissue.set_frame(tissue.home());
                }
            } else if let Some(tissue) = self.tissues.get(&parent) {
                self.rigid.loosen(parent, tissue);
            }
        }
        self.rigid.stands_due = true;
    }

    /// A severing was done again: pieces start from where their parents are.
    pub(super) fn pieces_came_back(&mut self, pieces: &[TissueId]) {
        let mut by_parent: BTreeMap<TissueId, Vec<TissueId>> = BTreeMap::new();
        for piece in pieces {
            if let Some(&(parent, _)) = self.rigid.parents.get(piece) {
                by_parent.entry(parent).or_default().push(*piece);
            }
        }
        for (parent, made) in by_parent {
            let frame = self.tissues.get(&parent).map(|tissue| tissue.frame());
            for id in &made {
                if let (Some(tissue), Some(frame)) = (self.tissues.get_mut(id), frame) {
                    tissue.set_frame(frame);
                }
            }
            self.pieces_came_off(parent, &made);
        }
    }
}
