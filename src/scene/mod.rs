//! The scene: tissues by id, the edits of a user, what they did, and the way back (MATHS 7).

mod blade_cut;
mod bounded_cut;
mod changes;
mod edit;
mod grab;
mod history;
pub mod report;
mod rigid;
mod strokes;

pub use edit::EditCommand;
pub use report::{EditReport, Outcome, PieceReport};
pub use rigid::{ColliderView, Fixed, PieceSettings};

use crate::geometry::StateHash;
use crate::surgery::{Sampling, Slit, TearBox, WallMode};
use crate::tissue::edit::CutScratch;
use crate::tissue::measure::Sums;
use crate::tissue::{Tissue, TissueDelta};
use changes::Changes;
use glam::DVec3;
use grab::Grabs;
use history::History;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Names a tissue for as long as the scene lives; a piece gets an id of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TissueId(pub u32);

/// What the scene needs to know of the tools.
#[derive(Clone, Copy, Debug)]
pub struct SceneSettings {
    /// How blade paths are sampled, as fractions of the model.
    pub sampling: crate::surgery::SamplingSettings,
    /// Length of one sample, metres, where given; else from the settings and the model.
    pub sample_distance: Option<f64>,
    /// Longest time between samples, seconds, where given.
    pub sample_time: Option<f64>,
}

/// Tissues and their history. Positions are in model space, where each tissue stands by its frame.
pub struct Scene {
    tissues: BTreeMap<TissueId, Box<Tissue>>,
    next_id: u32,
    history: History,
    strokes: Vec<strokes::StrokeOf>,
    wall: WallMode,
    /// Strokes that are over, whose buffers the next ones use.
    spare_strokes: Vec<strokes::StrokeOf>,
    /// Reports that came back, whose room the next ones use.
    spare_reports: Vec<EditReport>,
    /// Scratch: what tissues measure.
    sums: Vec<(TissueId, Sums)>,
    changes: Changes,
    last_boxes: Vec<TearBox>,
    last_slits: Vec<Slit>,
    grabs: Grabs,
    settings: SceneSettings,
    cut_scratch: CutScratch,
    animation: Option<usize>,
    measuring: bool,
    rigid: rigid::Rigid,
}

/// Tissues that there is room for at first.
const TISSUES_ROOM: usize = 16;
/// Boxes of a stroke that there is room for at first.
const BOXES_ROOM: usize = 256;

impl Scene {
    /// A scene with one tissue.
    pub fn new(mut tissue: Tissue, settings: SceneSettings) -> Self {
        let rigid = rigid::Rigid::new(&tissue);
        let sampling = settings.sampling(&tissue);
        let first = TissueId(0);
        let particles = tissue.layer().map_or(0, |layer| layer.map.len());
        Self {
            spare_strokes: strokes::StrokeOf::spares(first, &mut tissue, sampling),
            tissues: BTreeMap::from([(first, Box::new(tissue))]),
            next_id: 1,
            history: History::with_room(),
            strokes: Vec::with_capacity(TISSUES_ROOM),
            wall: WallMode::Open,
            spare_reports: vec![EditReport::with_room()],
            sums: Vec::with_capacity(TISSUES_ROOM),
            changes: Changes::default(),
            last_boxes: Vec::with_capacity(BOXES_ROOM),
            last_slits: Vec::with_capacity(BOXES_ROOM),
            grabs: Grabs::with_room(particles),
            settings,
            cut_scratch: CutScratch::default(),
            animation: None,
            measuring: true,
            rigid,
        }
    }

    /// Tissues, by id.
    pub fn tissues(&self) -> impl Iterator<Item = (TissueId, &Tissue)> {
        self.tissues.iter().map(|(id, t)| (*id, &**t))
    }

    /// One tissue.
    pub fn tissue(&self, id: TissueId) -> Option<&Tissue> {
        self.tissues.get(&id).map(|tissue| &**tissue)
    }

    /// One tissue, to change.
    pub fn tissue_mut(&mut self, id: TissueId) -> Option<&mut Tissue> {
        self.tissues.get_mut(&id).map(|tissue| &mut **tissue)
    }

    /// Starts keeping the deltas of every edit for [`Scene::take_changes`]: for those who mirror the scene.
    pub fn watch_changes(&mut self) {
        self.changes.watch();
    }

    /// Makes room for the next stroke, where one before has used some: a frame does it once it is on its way.
    pub fn make_room(&mut self) {
        self.history.make_room();
    }

    /// Deltas of edits, undone and redone ones too, since the last call; empty unless watched.
    pub fn take_changes(&mut self) -> Vec<(TissueId, Arc<TissueDelta>)> {
        self.changes.take()
    }

    /// Hands over what [`Scene::take_changes`] gave and is needed no more, to be used again.
    pub fn give_back_changes(&mut self, changes: Vec<(TissueId, Arc<TissueDelta>)>) {
        self.changes.give_back(changes);
    }

    /// Boxes of the last stroke, in model space, tissue by tissue.
    pub fn last_tear_boxes(&self) -> &[TearBox] {
        &self.last_boxes
    }

    /// Bounds of all that is seen, model space: of each tissue's, turned as it is. Low and high; infinite the wrong way round for an
    /// empty scene.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let tissues = self.tissues().map(|(_, t)| {
            let (low, high) = t.bounds();
            let corner = |k: usize| DVec3::from_array(std::array::from_fn(|m| if k >> m & 1 == 0 { low[m] } else { high[m] }));
            let corners = (0..8).map(|k| t.to_model(corner(k)));
            corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)))
        });
        tissues.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), (low, high)| (l.min(low), h.max(high)))
    }

    /// Whether reports tell areas, volumes and open edges, which needs a look at every face that has moved since the last report:
    /// in a model that beats, at all. They do until told otherwise; a frame that waits for its edits has no time for it. Without,
    /// areas and volumes are NaN, pieces count as open, with no edges, and bytes are those of tears alone.
    pub fn set_measuring(&mut self, measuring: bool) {
        self.measuring = measuring;
    }

    /// What lines the strokes from now on. A width of 0 has no walls. The material that walls will have is made now.
    pub fn set_wall(&mut self, wall: WallMode) {
        self.wall = wall;
        if wall == WallMode::Closed {
            for tissue in self.tissues.values_mut() {
                tissue.wound_material();
            }
        }
    }

    /// Strips of the last stroke of width 0, model space, in the order they were opened.
    pub fn last_tear_slits(&self) -> &[Slit] {
        &self.last_slits
    }

    /// The animation to play, by index into the rig; `None` rests. Looks at a share of its poses: the table lies under all of them.
    pub fn set_animation(&mut self, animation: Option<usize>) {
        self.animation = animation;
        self.place_table();
    }

    /// The animation that plays, by index into the rig.
    pub fn animation(&self) -> Option<usize> {
        self.animation
    }

    /// Poses every tissue at `time_s` on the scene's clock; `animation_time_s` is looped over the animation's length.
    pub fn pose(&mut self, time_s: f64, animation_time_s: f64) {
        for tissue in self.tissues.values_mut() {
            let duration = self.animation.and_then(|a| tissue.rig().animations.get(a)).map_or(0.0, |a| a.duration_s);
            let at = if duration > 0.0 { animation_time_s.rem_euclid(duration) } else { 0.0 };
            tissue.set_pose(time_s, self.animation, at);
        }
    }

    /// True if nothing moves but, maybe, the pose.
    pub fn is_asleep(&self) -> bool {
        let tools_rest = self.strokes.is_empty() && self.grabs.are_empty();
        tools_rest && self.rigid_rests() && self.tissues.values().all(|tissue| tissue.is_asleep())
    }

    /// Hash of everything that edits change, over all tissues; undo restores it exactly.
    pub fn edit_hash(&self) -> u64 {
        let mut hash = StateHash::default();
        for (id, tissue) in &self.tissues {
            hash.word(u64::from(id.0));
            tissue.edit_hash(&mut hash);
        }
        hash.finish()
    }

    /// Hash of everything that a frame shows: [`Scene::edit_hash`] and dynamics.
    pub fn state_hash(&self) -> u64 {
        let mut hash = StateHash::default();
        for (id, tissue) in &self.tissues {
            hash.word(u64::from(id.0));
            tissue.state_hash(&mut hash);
        }
        hash.finish()
    }

    /// Checks every structure of every tissue from scratch.
    pub fn validate(&self) -> Result<(), String> {
        self.tissues.iter().try_for_each(|(id, t)| t.validate().map_err(|e| format!("tissue {}: {e}", id.0)))
    }
}

impl SceneSettings {
    fn sampling(&self, tissue: &Tissue) -> Sampling {
        let mut settings = self.sampling;
        settings.time = self.sample_time.unwrap_or(settings.time);
        match self.sample_distance {
            Some(distance) => settings.with_distance(distance, tissue.diagonal()),
            None => settings.scaled(tissue.diagonal()),
        }
    }
}
