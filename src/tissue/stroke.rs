//! A tear through one tissue: blade poses in, the surface torn box by box, live (MATHS 5).

#[path = "box_planes.rs"]
mod box_planes;
#[path = "joint_fit.rs"]
mod joint_fit;
#[path = "segment_report.rs"]
mod segment_report;
#[path = "slit_stroke.rs"]
mod slit_stroke;
#[path = "strip_bind.rs"]
mod strip_bind;
#[path = "strip_ends.rs"]
mod strip_ends;
#[path = "stroke_room.rs"]
mod stroke_room;
#[path = "stroke_ties.rs"]
mod stroke_ties;
#[path = "wound_line.rs"]
mod wound_line;

use super::inside::{CLEARANCE, Seen, corners_inside, is_buried, is_crumpled};
use super::positions::PositionCache;
use super::walls::ROUNDING;
use super::{Tissue, TissueDelta};
use crate::geometry::{Distinct, FaceId, Plane, VertexId};
use crate::particles::LipVertex;
use crate::surgery::tear::{Body, LipPoint, OnPlanes, TearScratch, TearStep, tear_step};
use crate::surgery::tear_walls::WallSpec;
use crate::surgery::{BladePose, ChainStart, JointId, Sampling, Side, Slit, Stroke, TearBox, TearSegment, WallMode};
use box_planes::BoxPlanes;
use glam::{DMat3, DVec3};
pub use segment_report::SegmentReport;
use slit_stroke::SlitState;
pub(super) use slit_stroke::{distance_to_line, mean_edge, slit_cut};
pub(super) use strip_bind::Cut;
pub(super) use strip_ends::{StripPart, Swath, blade_at, way_between};
use strip_ends::{StripStart, is_skin, nearest_vertex};
use stroke_ties::Tie;
use wound_line::WoundLine;

/// Sides whose two triangles are this flat, as a fraction of the diagonal, are one plane.
const FLAT_SIDE: f64 = 1e-9;

/// What positions stored in f32 cannot tell apart, as a fraction of the diagonal.
const GRAIN: f64 = 1e-7;

/// What may be changed of walls that tissue has bent when they are cut again, in widths of the slit.
const BENT: f64 = 1.0 / 32.0;

/// Faces of old walls that a box may cut where the tissue has moved, below the skin and where it cuts that, too: there a box left out leaves
/// a rung. Walls that lie through each other would be cut into more and more.
const MOST_WALLS_CUT: [usize; 2] = [300, 700];

/// What a box reaches back beyond the vertices on its joint, which have left its plane, in widths.
const MARGIN: f64 = 0.1;

/// Boxes that the next may go on from: the ends of two chains at a pivot, what came before them, and boxes of a cone's tip between.
const ENDS_KEPT: usize = 8;

/// A lip of an open tear that is farther off the next box's side than this part of that one's length is not its.
const LIP_OFF: f64 = 1.0 / 8.0;

/// Vertices on lips that the next box is told of at most, where boxes are short.
const MOST_LIPS: usize = 256;

/// What a box leaves for the next of its chain.
#[derive(Default)]
struct Ended {
    /// Chain of the box, and its last joint.
    chain: u32,
    joint: Option<JointId>,
    /// The tissue has moved that since.
    moved: bool,
    /// Its end edge (tip, top) at rest.
    at_rest: [DVec3; 2],
    /// The line of the wound in which it lies.
    line: Option<WoundLine>,
    /// Vertices on the joint, with the quad edges they lie on, sorted.
    tags: Vec<OnPlanes>,
    /// Its walls: the end wall, which goes when the chain goes on, and the others (both sorted).
    end_wall: Vec<FaceId>,
    other_walls: Vec<FaceId>,
    /// Its lips, and after a short box those of the box before: where the tissue moves they stay on the side that they are on.
    lips: Vec<(VertexId, i8)>,
    /// How far back along the blade's way those reach, metres.
    lips_reach: f64,
    /// Vertices that it touched or made, where another box has come after it.
    near: Vec<VertexId>,
}

/// Where a strip ends at rest, and the line of its wound.
type StripEnd = ([DVec3; 2], Option<WoundLine>);

/// The corners of a box towards the handle, which are above the skin.
const TOP: u8 = 0b1100_1100;

impl Ended {
    /// Whether the box has left vertices of the skin on its end.
    fn ends_in_skin(&self, tissue: &Tissue) -> bool {
        self.tags.iter().any(|t| tissue.mesh.vertex_is_live(t.vertex) && is_skin(tissue, t.vertex))
    }

    /// Nothing, in the same lists.
    fn emptied(mut self) -> Self {
        self.tags.clear();
        self.end_wall.clear();
        self.other_walls.clear();
        self.lips.clear();
        self.near.clear();
        self
    }
}

/// A stroke in progress through one tissue.
pub struct TearStroke {
    stroke: Stroke,
    segments: Vec<TearSegment>,
    /// The last boxes, newest last: two chains take turns where the blade turns about a point of its own.
    ended: Vec<Ended>,
    spare_ended: Vec<Ended>,
    /// The number of its newest slit, its wounds that the blade has not left yet, and its first strip.
    slit: u32,
    wounds: Vec<u32>,
    first_strip: usize,
    candidates: Vec<FaceId>,
    /// Vertices that the last box touched or made, as far as they live.
    near: Vec<VertexId>,
    /// Those, and what the last box of another lane touched.
    nearby: Vec<VertexId>,
    scratch: TearScratch,
    positions: PositionCache,
    step: TearStep,
    boxes: Vec<TearBox>,
    slits: SlitState,
    reports: Vec<SegmentReport>,
    ties: Vec<Tie>,
    /// The newest pose of the blade.
    pose_tie: Option<Tie>,
    /// What the boxes changed, one entry a box, since the last [`TearStroke::drain_deltas`].
    deltas: Vec<TissueDelta>,
    /// Deltas that have been handed over, for their room.
    spare_deltas: Vec<TissueDelta>,
    /// What `deltas` need on the GPU, if that is counted.
    bytes_changed: usize,
    counts_bytes: bool,
    distinct: Distinct,
    planes: BoxPlanes,
    tags: Vec<OnPlanes>,
    /// Faces that the last box put in, sorted.
    made: Vec<FaceId>,
    /// Faces of the loaded model that what a box leaves of the skin around it comes from.
    origins: Vec<u32>,
    lips: Vec<LipVertex>,
    /// Lips of the slit's nicks since its last strip.
    nicked: Vec<LipPoint>,
    removed: Vec<VertexId>,
    /// The tissue has moved a pending quad.
    has_moved: bool,
    wall: WallMode,
    /// As it was asked for, and how far boxes with walls keep from faces that they would touch, metres.
    width: f64,
    clearance: f64,
    /// Vertices around what a closed tear has joined.
    joined: Vec<VertexId>,
}

impl TearStroke {
    /// Takes up the blade over `tissue`: a slit of `width` metres; with 0 nothing is taken out.
    pub fn new(tissue: &Tissue, width: f64, sampling: Sampling) -> Self {
        Self {
            stroke: Stroke::new(width, sampling),
            segments: Vec::new(),
            ended: Vec::new(),
            spare_ended: Vec::new(),
            slit: tissue.layer().map_or(0, |l| l.strips.next_slit()),
            wounds: Vec::new(),
            first_strip: tissue.layer().map_or(0, |l| l.strips.len()),
            candidates: Vec::new(),
            near: Vec::new(),
            nearby: Vec::new(),
            scratch: TearScratch::default(),
            positions: PositionCache::default(),
            step: TearStep::default(),
            boxes: Vec::new(),
            slits: SlitState::default(),
            reports: Vec::new(),
            ties: Vec::new(),
            pose_tie: None,
            deltas: Vec::new(),
            spare_deltas: Vec::new(),
            bytes_changed: 0,
            counts_bytes: true,
            distinct: Distinct::default(),
            planes: BoxPlanes::default(),
            tags: Vec::new(),
            made: Vec::new(),
            origins: Vec::new(),
            lips: Vec::new(),
            nicked: Vec::new(),
            removed: Vec::new(),
            has_moved: false,
            wall: WallMode::Open,
            width,
            clearance: CLEARANCE * tissue.diagonal(),
            joined: Vec::new(),
        }
    }

    /// [`TearStroke::new`] in the buffers of a stroke that is over.
    pub fn again(mut self, tissue: &Tissue, width: f64, sampling: Sampling) -> Self {
        self.segments.clear();
        self.spare_ended.append(&mut self.ended);
        self.candidates.clear();
        self.near.clear();
        self.boxes.clear();
        self.reports.clear();
        self.ties.clear();
        self.nicked.clear();
        self.wounds.clear();
        self.pose_tie = None;
        self.deltas.clear();
        self.positions.forget();
        self.slits.begin();
        let (slit, first_strip) = tissue.layer().map_or((0, 0), |l| (l.strips.next_slit(), l.strips.len()));
        let (wall, clearance) = (self.wall, CLEARANCE * tissue.diagonal());
        Self { stroke: self.stroke.again(width, sampling), slit, first_strip, has_moved: false, width, clearance, ..self }
            .walled(wall)
    }

    /// The same with walls and a floor, or without.
    pub fn walled(mut self, wall: WallMode) -> Self {
        self.set_wall(wall);
        self
    }

    /// What lines the boxes that come.
    ///
    /// Boxes with walls are wider by a hair (1e-3 of the width at most): sides that a model's faces lie in would leave films of
    /// tissue, or shells of walls in the air.
    pub fn set_wall(&mut self, wall: WallMode) {
        self.wall = wall;
        let wider = if wall == WallMode::Closed { self.clearance.min(1e-3 * self.width) } else { 0.0 };
        self.stroke.set_width(self.width + wider);
    }

    /// Whether the bytes are counted that a GPU mirror needs to follow; they are unless told otherwise.
    pub fn set_counting(&mut self, counts_bytes: bool) {
        self.counts_bytes = counts_bytes;
    }

    /// Width and clearance of the boxes, if they have walls.
    fn walled_by(&self) -> Option<(f64, f64)> {
        (self.wall == WallMode::Closed).then_some((self.width, self.clearance))
    }

    /// Takes the next blade pose (tissue space) and tears as far as it allows: a box is committed when the sample after its
    /// end has come (MATHS 5.4).
    pub fn push(&mut self, tissue: &mut Tissue, pose: BladePose) {
        tissue.scratch.hands.pulls.under_blade = Some(self.first_strip);
        tissue.refresh_sections();
        self.positions.refresh(tissue);
        self.follow_tissue(tissue);
        self.stroke.close_left(&mut self.segments);
        self.tear_segments(tissue);
        let seen = Seen { tissue, positions: &self.positions, walled: self.walled_by() };
        self.stroke.push(pose, &seen, &mut self.segments);
        self.tear_segments(tissue);
        self.tie_quads(tissue);
    }

    /// Ends the stroke where the blade is.
    pub fn release(&mut self, tissue: &mut Tissue) {
        tissue.refresh_sections();
        self.positions.refresh(tissue);
        self.follow_tissue(tissue);
        let seen = Seen { tissue, positions: &self.positions, walled: self.walled_by() };
        self.stroke.release(&seen, &mut self.segments);
        self.tear_segments(tissue);
        let parted = tissue.part_double_edges(&mut self.joined);
        self.joined.clear();
        if let Some(last) = self.reports.last_mut() {
            last.new_vertices += parted;
        }
        self.release_wounds(tissue);
        tissue.scratch.hands.pulls.under_blade = None;
        self.spare_ended.append(&mut self.ended);
        self.slits.release();
    }

    /// Hands over what the boxes have changed since the last call, oldest first, and returns how many bytes a GPU mirror needs to
    /// follow, 0 if they are not counted. The room that `each` leaves is used again.
    pub fn drain_deltas(&mut self, mut each: impl FnMut(&mut TissueDelta)) -> usize {
        for mut delta in self.deltas.drain(..) {
            each(&mut delta);
            self.spare_deltas.push(delta);
        }
        std::mem::take(&mut self.bytes_changed)
    }

    /// Closes the notes of a box.
    fn close_notes(&mut self, tissue: &mut Tissue, report: &mut SegmentReport) {
        let mut delta = self.spare_deltas.pop().unwrap_or_default();
        report.stages.time("update_mesh", || tissue.take_delta_into(&mut delta));
        if self.counts_bytes {
            report.bytes_changed = delta.upload_bytes(&mut self.distinct);
            self.bytes_changed += report.bytes_changed;
        }
        self.deltas.push(delta);
    }

    /// Boxes committed so far, in order; in a closed tear without those wholly inside the solid, which take nothing out.
    pub fn boxes(&self) -> &[TearBox] {
        &self.boxes
    }

    /// Strips of a tear of width 0 committed so far, in order.
    pub fn slits(&self) -> &[Slit] {
        self.slits.committed()
    }

    /// Reports of the boxes that tore something.
    pub fn reports(&self) -> &[SegmentReport] {
        &self.reports
    }

    /// Pieces of walls alone, and flakes of skin, that come off and are smaller than this are shreds, metres: in tissue that moves the ends
    /// of boxes do not quite meet, and what is left between them, thinner than the blade, is none of the model's.
    pub(crate) fn shreds(&self) -> f64 {
        if self.has_moved { self.width } else { 0.0 }
    }

    /// True if anything was torn.
    pub fn has_torn(&self) -> bool {
        self.reports.iter().any(|r| r.new_vertices > 0 || r.opened_edges > 0 || r.area_removed > 0.0)
    }

    fn tear_segments(&mut self, tissue: &mut Tissue) {
        let mut segments = std::mem::take(&mut self.segments);
        for segment in segments.drain(..) {
            match &segment {
                TearSegment::Box(tear_box) => self.tear_box(tissue, tear_box),
                TearSegment::Slit(slit) => self.tear_slit(tissue, slit),
            }
        }
        self.segments = segments;
    }

    fn tear_box(&mut self, tissue: &mut Tissue, tear_box: &TearBox) {
        let mut report = SegmentReport::default();
        let mut planes = std::mem::take(&mut self.planes);
        planes.set(tear_box, FLAT_SIDE * tissue.diagonal());
        // a chain that crosses itself goes on from the same joint under another number
        let follows = |e: &Ended| e.joint == Some(tear_box.joints[0]);
        if let Some(last) = self.ended.last_mut() {
            std::mem::swap(&mut last.near, &mut self.near);
        }
        let before = self.ended.iter().position(follows).map(|i| self.ended.remove(i));
        let resumes = |e: &&Ended| e.joint.is_some_and(|joint| tear_box.from == ChainStart::Box(joint));
        let resumed = self.ended.iter().find(resumes);
        let line = before.as_ref().or(resumed).and_then(|e| e.line);
        let start = match (&before, resumed) {
            (Some(e), _) => StripStart::Edge(e.at_rest, e.ends_in_skin(tissue)),
            (None, Some(e)) => StripStart::Along(e.at_rest, e.ends_in_skin(tissue)),
            (None, None) => StripStart::Free,
        };
        if matches!(start, StripStart::Free) {
            self.begin_slit(tissue, tear_box.from == ChainStart::Hairpin);
        }
        let mut before = before.or_else(|| self.spare_ended.pop().map(Ended::emptied)).unwrap_or_default();
        if before.moved && !before.tags.is_empty() {
            let off = |t: &OnPlanes| planes.planes[0].distance(self.positions.of(tissue, t.vertex)).abs();
            let farthest = before.tags.iter().map(off).fold(0.0, f64::max);
            planes.reach_back(tear_box, 2.0 * farthest + MARGIN * self.width);
        }
        let mut tags = std::mem::take(&mut self.tags);
        planes.start_tags(&before.tags, &mut tags);
        if planes.start == 0 {
            // a blade that turns leaves lips that are none of the next box's; walls have to meet all the same
            let most = if self.wall == WallMode::Closed { f64::INFINITY } else { LIP_OFF * tear_box.length() };
            let seen = &self.positions;
            let off = |v: VertexId, plane: &Plane| plane.distance(seen.of(tissue, v));
            planes.tag_lips(&before.lips, off, [most, ROUNDING * tissue.diagonal()], &mut tags);
        }
        let material = if self.wall == WallMode::Closed { tissue.wound_material() } else { 0 };
        let [low, high] = tear_box.bounds();
        let reach = if planes.start == 0 { (high - low).max_element() } else { 1e-9 * tissue.diagonal() };
        let margin = DVec3::splat(reach);
        let mut hit =
            report.stages.time("perform_tear", || self.clip(tissue, tear_box, &mut planes, (&before, &tags), material, margin));
        let mut given_up = false;
        if hit && self.went_wrong(tissue, &planes) {
            // The joint is not where it was, or the box lies in an older slit but for rounding: what the box before has left is cut like
            // any other surface. Where lips lie through each other, or planes on each other, even that may make no sense, and skin
            // that stays is better than a wall in the air.
            tissue.step_back();
            (before, given_up) = (before.emptied(), true);
            tags.clear();
            // what cuts too many walls with its joint cuts no fewer without
            hit = !self.cuts_too_many()
                && report
                    .stages
                    .time("perform_tear", || self.clip(tissue, tear_box, &mut planes, (&before, &tags), material, margin));
            if hit && self.went_wrong(tissue, &planes) {
                tissue.step_back();
                hit = false;
            }
            if !hit {
                self.step.clear();
            }
        }
        report.faces_visited = self.step.faces_visited;
        let end = if hit {
            self.bind(tissue, tear_box, (start, line), &mut report)
        } else {
            self.near.clear();
            (self.swath(tissue).rest_edge(tear_box.blades[1]), line)
        };
        self.keep_end(tissue, tear_box, &planes, (&before, end));
        self.spare_ended.push(before);
        (self.planes, self.tags) = (planes, tags);
        if hit || self.wall == WallMode::Open || !(given_up || is_buried(tissue, &self.positions, tear_box)) {
            self.boxes.push(tear_box.clone());
        }
        self.reports.push(report);
    }

    /// True if old walls were cut to pieces.
    fn cuts_too_many(&self) -> bool {
        self.has_moved && self.step.walls_cut > MOST_WALLS_CUT[usize::from(self.step.skin_cut > 0)]
    }

    /// True if walls stand in the air, up along the blade, or line folds of the skin, or old walls were cut to pieces.
    fn went_wrong(&mut self, tissue: &Tissue, planes: &BoxPlanes) -> bool {
        let reaches_back = self.wall == WallMode::Closed && planes.start == 0;
        self.cuts_too_many()
            || self.step.corners_outside & TOP != 0
            || reaches_back && is_crumpled(tissue, &self.step.added_faces, &mut self.origins)
    }

    /// Clips the box out of the mesh, and lines what that leaves. `before` and `tags` tell what the box before has left at the joint.
    fn clip(
        &mut self,
        tissue: &mut Tissue,
        tear_box: &TearBox,
        planes: &mut BoxPlanes,
        (before, tags): (&Ended, &[OnPlanes]),
        material: u32,
        margin: DVec3,
    ) -> bool {
        let [low, high] = tear_box.bounds();
        let is_closed = self.wall == WallMode::Closed;
        planes.faces_within(tissue, (low - margin, high + margin), &mut self.candidates);
        if is_closed && (planes.start == 0 || self.meets_old_walls(tissue, planes, before)) {
            planes.facets.seen_inside = Some(corners_inside(tissue, &self.positions, &planes.facets.corners, &self.candidates));
        }
        let body = Body { planes: &planes.planes, sides: &planes.sides, min: low - margin, max: high + margin };
        let (at, seen) = (tear_box.blades[1][1], &self.positions);
        let width = tear_box.quads[1][0].distance(tear_box.quads[1][1]);
        let grain = (GRAIN * tissue.diagonal()).min(width / 16.0);
        let walls = is_closed.then(|| WallSpec {
            facets: &planes.facets,
            remove: &before.end_wall,
            keep: &before.other_walls,
            material,
            grain,
            bent: if self.has_moved { BENT * width } else { grain },
            rest_from_posed: rest_from_posed(tissue, nearest_vertex(tissue, &self.candidates, at, &|v| seen.of(tissue, v))),
        });
        let (mesh, posed) = tissue.split_borrow();
        let position = |v| seen.get(v, || posed.position(v));
        tear_step(mesh, &body, walls.as_ref(), &self.candidates, &position, tags, &mut self.scratch, &mut self.step)
    }

    /// True if the box meets walls of others than the box before it: some that no plane of it keeps apart by more than the grain.
    fn meets_old_walls(&self, tissue: &Tissue, planes: &BoxPlanes, before: &Ended) -> bool {
        let (outward, grain) = (planes.outward(), GRAIN * tissue.diagonal());
        let is_new = |f: FaceId| [&before.end_wall, &before.other_walls].iter().any(|walls| walls.binary_search(&f).is_ok());
        let is_wall = |f: FaceId| tissue.mesh.is_live(f) && tissue.mesh.is_interior(f);
        let is_apart = |f: FaceId| {
            let corners = tissue.mesh.corners(f, |v| self.positions.of(tissue, v));
            outward.iter().any(|&(n, d)| corners.iter().all(|p| n.dot(*p) + d > grain))
        };
        self.candidates.iter().any(|&f| is_wall(f) && !is_new(f) && !is_apart(f))
    }

    /// Remembers where the box ended, its walls and lips, for the next of its chain.
    fn keep_end(&mut self, tissue: &Tissue, tear_box: &TearBox, planes: &BoxPlanes, (before, end): (&Ended, StripEnd)) {
        let step = &self.step;
        // the box may have cut what those of the other chain have left; a face's slot may be in use again
        let made = &mut self.made;
        made.clear();
        if !self.ended.is_empty() {
            made.extend(step.added_faces.iter().copied().chain(step.walls.iter().map(|w| w.0)));
            made.sort_unstable();
        }
        let stands = |f: &FaceId| tissue.mesh.is_live(*f) && made.binary_search(f).is_err();
        self.spare_ended.extend(self.ended.drain(..self.ended.len().saturating_sub(ENDS_KEPT - 1)));
        for other in &mut self.ended {
            for walls in [&mut other.end_wall, &mut other.other_walls] {
                let known = walls.len();
                // sorted up to there
                for &(from, to) in &step.recut {
                    if walls[..known].binary_search(&from).is_ok() && tissue.mesh.is_live(to) {
                        walls.push(to);
                    }
                }
                walls.extract_if(..known, |f| !stands(f)).for_each(drop);
                walls.sort_unstable();
                walls.dedup();
            }
            other.tags.retain(|t| tissue.mesh.vertex_is_live(t.vertex));
            other.lips.retain(|l| tissue.mesh.vertex_is_live(l.0));
        }
        let (at_rest, line) = end;
        let mut end = self.spare_ended.pop().unwrap_or_default().emptied();
        (end.chain, end.joint, end.moved) = (tear_box.chain, Some(tear_box.joints[1]), false);
        (end.at_rest, end.line) = (at_rest, line);
        planes.end_edges(&step.on_end, &mut end.tags);
        if self.wall == WallMode::Closed {
            for &(face, side) in &step.walls {
                (if side == Side::End { &mut end.end_wall } else { &mut end.other_walls }).push(face);
            }
            end.end_wall.sort_unstable();
            end.other_walls.sort_unstable();
        }
        end.lips.extend(step.lips.iter().map(|l| (l.vertex, l.side)));
        end.lips_reach = tear_box.length();
        // the next box reaches back by half its length, which may be more than this one's
        if 2.0 * end.lips_reach < before.lips_reach && end.lips.len() + before.lips.len() <= MOST_LIPS {
            end.lips.extend(before.lips.iter().filter(|l| tissue.mesh.vertex_is_live(l.0)));
            end.lips_reach += before.lips_reach;
        }
        self.ended.push(end);
    }

    /// Rows, strip and particle map of what the box tore.
    fn bind(
        &mut self,
        tissue: &mut Tissue,
        tear_box: &TearBox,
        (start, line): (StripStart, Option<WoundLine>),
        report: &mut SegmentReport,
    ) -> StripEnd {
        let step = &mut self.step;
        let promoted = tissue.promoted_vertices;
        report.stages.time("bind", || {
            tissue.add_vertices(&step.new_vertices);
            tissue.settle_corners(&mut step.new_vertices);
            tissue.widen_sections(step.walls.iter().map(|w| w.0).chain(step.widened_faces.iter().copied()));
        });
        self.near.clear();
        self.near.extend(step.touched.iter().copied().chain(step.new_vertices.iter().map(|n| n.vertex)));
        if self.wall == WallMode::Closed {
            self.joined.extend_from_slice(&self.near);
        }
        report.promoted_vertices = tissue.promoted_vertices - promoted;
        (report.wall_faces, report.unclosed_edges) = (step.walls.len(), step.unclosed_edges);
        report.smallest_angle = step.smallest_sine.min(1.0).asin();
        let step = &self.step;
        report.new_vertices = step.new_vertices.len();
        report.intersection_points = step.intersection_points;
        report.area_removed = step.area_removed;
        // in an open wound, what the blade swept above what it cut was air, and is elsewhere at rest
        let is_in_wound = self.is_in_wound(tissue, tear_box);
        let blades = [0, 1].map(|end| if is_in_wound { self.cut_part(tissue, tear_box, end) } else { tear_box.blades[end] });
        let reach = if is_in_wound { 0.0 } else { tissue.layer.as_ref().map_or(0.0, |layer| layer.settings.radius) };
        let (parts, end) = self.swath(tissue).strip_parts(blades, start, self.slit);
        let (step, mut removed) = (std::mem::take(&mut self.step), std::mem::take(&mut self.removed));
        removed.clear();
        removed.extend(step.touched.iter().filter(|&&v| !tissue.mesh.vertex_is_live(v)));
        let mut cut = Cut {
            lips: &step.lips,
            made: &step.new_vertices,
            removed: &removed,
            has_width: true,
            is_beside: step.skin_cut == 0,
            reach,
            goes_on_along: line,
            shares_edge: matches!(start, StripStart::Edge(_, true)),
            ..Cut::default()
        };
        let (_, line) = self.bind_strips(tissue, &mut cut, (&parts, tear_box.blades), report);
        (self.step, self.removed) = (step, removed);
        let corners = self.step.new_vertices.iter().filter(|n| n.parent_count == 0);
        report.wall_deviation = corners.map(|n| tissue.faded(n.vertex).length()).fold(0.0, f64::max);
        tissue.versions.structure += 1;
        self.close_notes(tissue, report);
        (end, line)
    }
}

/// Turns normals near a vertex into normals at rest: the transpose of the blended matrix (MATHS 2.3).
fn rest_from_posed(tissue: &Tissue, near: Option<VertexId>) -> DMat3 {
    near.map_or(DMat3::IDENTITY, |v| tissue.pose.blended_linear(&tissue.rows, v).transpose())
}
