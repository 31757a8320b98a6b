//! A tear through one tissue: blade poses in, the surface torn box by box, live (MATHS 5).

use super::{Tissue, TissueDelta};
use crate::diagnostics::Stages;
use crate::geometry::{FaceId, Plane, VertexId};
use crate::particles::{LipVertex, MapUpdateReport, release_slit};
use crate::surgery::clip::MAX_PLANES;
use crate::surgery::tear::{Body, OnPlanes, TearScratch, TearStep, tear_step};
use crate::surgery::{BladePose, EntryPoint, Sampling, Side, Stroke, TearBox, TearSegment};
use glam::DVec3;

/// Sides whose two triangles are this flat, as a fraction of the diagonal, are one plane.
const FLAT_SIDE: f64 = 1e-9;

/// The paper's rows for one segment, with what it did.
#[derive(Clone, Debug, Default)]
pub struct SegmentReport {
    /// Milliseconds: perform_tear (clip, retriangulate), bind (rows of the inserted vertices), disconnect_particles (the
    /// strip), update_particles (the map), update_mesh (closing the notes that a mirror and undo follow).
    pub stages: Stages,
    /// Vertices inserted.
    pub new_vertices: usize,
    /// Faces looked at.
    pub faces_visited: usize,
    /// Crossings of planes with edges and faces.
    pub intersection_points: usize,
    /// Area taken out, square metres.
    pub area_removed: f64,
    /// Particles that the wound was given.
    pub wound_particles: usize,
}

/// A pending quad tied to the tissue by the frame of a vertex near it (MATHS 5.5).
struct Tie {
    serial: u32,
    vertex: VertexId,
    rest: [DVec3; 4],
    posed: [DVec3; 4],
}

/// A stroke in progress through one tissue.
pub struct TearStroke {
    stroke: Stroke,
    segments: Vec<TearSegment>,
    tags: Vec<OnPlanes>,
    /// Chain, place and rest-space end edge (tip, top) of the last box.
    last: Option<(u32, u32, [DVec3; 2])>,
    slit: u32,
    candidates: Vec<FaceId>,
    scratch: TearScratch,
    step: TearStep,
    boxes: Vec<TearBox>,
    reports: Vec<SegmentReport>,
    ties: Vec<Tie>,
    /// What the boxes changed, one entry a box, since the last [`TearStroke::take_deltas`].
    deltas: Vec<TissueDelta>,
    /// The tissue has moved since the pending quads were tied.
    moved: bool,
}

impl TearStroke {
    /// Takes up the blade over `tissue`: a slit of `width` metres, above 0.
    pub fn new(tissue: &Tissue, width: f64, sampling: Sampling) -> Self {
        Self {
            stroke: Stroke::new(width, sampling),
            segments: Vec::new(),
            tags: Vec::new(),
            last: None,
            slit: tissue.layer().map_or(0, |l| l.strips.next_slit()),
            candidates: Vec::new(),
            scratch: TearScratch::default(),
            step: TearStep::default(),
            boxes: Vec::new(),
            reports: Vec::new(),
            ties: Vec::new(),
            deltas: Vec::new(),
            moved: false,
        }
    }

    /// Takes the next blade pose (tissue space) and tears as far as it allows: a box is committed when the sample after its
    /// end has come (MATHS 5.4).
    pub fn push(&mut self, tissue: &mut Tissue, pose: BladePose) {
        tissue.refresh_sections();
        self.follow_tissue(tissue);
        let surface = |tip, base| entry(tissue, tip, base);
        self.stroke.push(pose, &surface, &mut self.segments);
        self.tear_segments(tissue);
        self.tie_quads(tissue);
    }

    /// Ends the stroke where the blade is.
    pub fn release(&mut self, tissue: &mut Tissue) {
        tissue.refresh_sections();
        self.follow_tissue(tissue);
        let surface = |tip, base| entry(tissue, tip, base);
        self.stroke.release(&surface, &mut self.segments);
        self.tear_segments(tissue);
        if let Some(layer) = tissue.layer.as_mut().filter(|l| self.has_torn() && l.strips.next_slit() > self.slit) {
            release_slit(&mut layer.map, &layer.strips, &layer.settings.wound);
        }
        self.tags.clear();
        self.last = None;
    }

    /// Moves the pending quads with the tissue (MATHS 5.5). Those it has not moved keep their bits.
    fn follow_tissue(&mut self, tissue: &Tissue) {
        self.moved = false;
        for (serial, quad) in self.stroke.builder().pending_quads_mut() {
            let Some(tie) = self.ties.iter().find(|t| t.serial == serial) else { continue };
            for k in 0..4 {
                let now = tissue.to_posed(tie.vertex, tie.rest[k]);
                if now != tie.posed[k] {
                    quad[k] += now - tie.posed[k];
                    self.moved = true;
                }
            }
        }
    }

    /// Ties the pending quads to the nearest live vertices.
    fn tie_quads(&mut self, tissue: &Tissue) {
        self.ties.clear();
        for (serial, quad) in self.stroke.builder().pending_quads_mut() {
            let top = (quad[2] + quad[3]) / 2.0;
            if let Some(vertex) = nearest_vertex(tissue, &self.candidates, top).or_else(|| tissue.any_vertex_near(top)) {
                let rest = quad.map(|p| tissue.to_rest(vertex, p));
                self.ties.push(Tie { serial, vertex, rest, posed: rest.map(|p| tissue.to_posed(vertex, p)) });
            }
        }
    }

    /// Hands over what the boxes have changed since the last call, oldest first.
    pub fn take_deltas(&mut self) -> Vec<TissueDelta> {
        std::mem::take(&mut self.deltas)
    }

    /// Boxes committed so far, in order.
    pub fn boxes(&self) -> &[TearBox] {
        &self.boxes
    }

    /// Reports of the boxes that tore something.
    pub fn reports(&self) -> &[SegmentReport] {
        &self.reports
    }

    /// True if anything was torn.
    pub fn has_torn(&self) -> bool {
        self.reports.iter().any(|r| r.new_vertices > 0 || r.area_removed > 0.0)
    }

    fn tear_segments(&mut self, tissue: &mut Tissue) {
        for segment in std::mem::take(&mut self.segments) {
            if let Some(tear_box) = segment.as_box() {
                self.tear_box(tissue, tear_box);
            }
        }
    }

    fn tear_box(&mut self, tissue: &mut Tissue, tear_box: &TearBox) {
        let mut report = SegmentReport::default();
        let mut planes = BoxPlanes::new(tear_box, FLAT_SIDE * tissue.diagonal());
        if self.last.is_none_or(|(chain, index, _)| (chain, index + 1) != (tear_box.chain, tear_box.index)) {
            self.tags.clear();
        }
        if self.moved && !self.tags.is_empty() {
            planes.reach_back(tear_box);
        }
        let tags = planes.start_tags(&self.tags);
        let [low, high] = tear_box.bounds();
        let reach = if planes.start == 0 { (high - low).max_element() } else { 1e-9 * tissue.diagonal() };
        let margin = DVec3::splat(reach);
        let hit = report.stages.time("perform_tear", || {
            tissue.faces_near(low - margin, high + margin, &mut self.candidates);
            let body = Body { planes: &planes.planes, sides: &planes.sides, min: low - margin, max: high + margin };
            let (mesh, posed) = tissue.split_borrow();
            tear_step(mesh, &body, &self.candidates, &|v| posed.position(v), &tags, &mut self.scratch, &mut self.step)
        });
        report.faces_visited = self.step.faces_visited;
        let end = if hit { self.bind(tissue, tear_box, &mut report) } else { self.rest_edge(tissue, tear_box, 1) };
        self.tags = planes.end_edges(&self.step.on_end);
        self.last = Some((tear_box.chain, tear_box.index, end));
        self.boxes.push(tear_box.clone());
        self.reports.push(report);
    }

    /// Rows, strip and particle map of what the box tore. Returns the strip's end edge at rest.
    fn bind(&mut self, tissue: &mut Tissue, tear_box: &TearBox, report: &mut SegmentReport) -> [DVec3; 2] {
        let step = &self.step;
        report.stages.time("bind", || tissue.add_vertices(&step.new_vertices));
        report.new_vertices = step.new_vertices.len();
        report.intersection_points = step.intersection_points;
        report.area_removed = step.area_removed;
        let start = match self.last {
            Some((chain, index, edge)) if (chain, index + 1) == (tear_box.chain, tear_box.index) => edge,
            _ => self.rest_edge(tissue, tear_box, 0),
        };
        let end = self.rest_edge(tissue, tear_box, 1);
        let strip = report.stages.time("disconnect_particles", || {
            let layer = tissue.layer.as_mut()?;
            let corners = [start[0], end[0], end[1], start[1]];
            layer.strips.push(corners, layer.settings.radius, self.slit).ok()
        });
        let lips: Vec<LipVertex> = strip.map_or_else(Vec::new, |strip| {
            // a strip's normal, travel x up, points to the box's minus side
            self.step.lips.iter().map(|l| LipVertex { vertex: l.vertex, strip, side: -l.side }).collect()
        });
        let removed: Vec<VertexId> = step.touched.iter().copied().filter(|&v| !tissue.mesh.vertex_is_live(v)).collect();
        let update: MapUpdateReport = report.stages.time("update_particles", || {
            let strips = strip.map_or(0..0, |s| s..s + 1);
            tissue.update_map(&self.step.new_vertices, &removed, strips, &lips)
        });
        report.wound_particles = update.particles_added.len();
        tissue.versions.structure += 1;
        let delta = report.stages.time("update_mesh", || tissue.take_delta());
        self.deltas.push(delta);
        end
    }

    /// The blade `[tip, top]` at one end of a box, carried to rest space by the nearest surface vertex.
    fn rest_edge(&self, tissue: &Tissue, tear_box: &TearBox, end: usize) -> [DVec3; 2] {
        let [tip, top] = tear_box.blades[end];
        match nearest_vertex(tissue, &self.candidates, top) {
            Some(v) => [tip, top].map(|p| tissue.to_rest(v, p)),
            None => [tip, top],
        }
    }
}

/// The vertex of `faces` that is seen nearest to `p`; dead faces are passed over.
fn nearest_vertex(tissue: &Tissue, faces: &[FaceId], p: DVec3) -> Option<VertexId> {
    let near = |v: &VertexId| tissue.position(*v).distance_squared(p);
    let vertices = faces.iter().filter(|f| tissue.mesh.is_live(**f)).flat_map(|&f| tissue.mesh.face(f));
    vertices.min_by(|a, b| near(a).total_cmp(&near(b)).then(a.cmp(b)))
}

fn entry(tissue: &Tissue, tip: DVec3, base: DVec3) -> Option<EntryPoint> {
    tissue.blade_entry(tip, base).map(|(s, _)| EntryPoint { s, rise: 0.0 })
}

/// The planes of a box, a flat side's two triangles as one.
struct BoxPlanes {
    planes: Vec<Plane>,
    sides: Vec<Side>,
    /// Bits of the planes that hold edge `k` of the start quad, and of the end quad.
    edge_planes: [[u16; 4]; 2],
    /// Plane bits that every vertex on the start joint has.
    start: u16,
}

/// Bits of quad edges in tags that wait for the next box.
type EdgeBits = u16;

impl BoxPlanes {
    fn new(tear_box: &TearBox, flat: f64) -> Self {
        let mut all = Self { planes: Vec::with_capacity(MAX_PLANES), sides: Vec::new(), edge_planes: [[0; 4]; 2], start: 1 };
        let push = |all: &mut Self, k: usize| {
            let space = &tear_box.planes[k];
            let plane = Plane::Points(space.points);
            all.planes.push(if space.flipped { plane.flipped() } else { plane });
            all.sides.push(space.side);
            1u16 << (all.planes.len() - 1)
        };
        push(&mut all, 0);
        push(&mut all, 1);
        for k in 0..4 {
            let first = push(&mut all, 2 + 2 * k);
            let second = if tear_box.bulge[k] <= flat { first } else { push(&mut all, 3 + 2 * k) };
            all.edge_planes[0][k] = first;
            all.edge_planes[1][k] = second;
        }
        all
    }

    /// Draws the start plane back by half the box. Where the tissue moves, the end of the slit does not stay in a plane, and
    /// skin behind the joint would be left as a strand across the slit; between the lips there is nothing else to reach.
    fn reach_back(&mut self, tear_box: &TearBox) {
        let [[tip, top], [next_tip, next_top]] = tear_box.blades;
        let by = ((tip + top) - (next_tip + next_top)) / 4.0;
        if let Plane::Points(points) = &mut self.planes[0] {
            *points = points.map(|p| p + by);
        }
        self.start = 0;
    }

    /// Tags for this box from the quad edges that vertices of the box before ended on.
    fn start_tags(&self, ended: &[OnPlanes]) -> Vec<OnPlanes> {
        let planes = |edges: EdgeBits| (0..4).filter(|k| edges >> k & 1 == 1).fold(self.start, |m, k| m | self.edge_planes[0][k]);
        ended.iter().map(|t| OnPlanes { vertex: t.vertex, planes: planes(t.planes) }).collect()
    }

    /// Vertices on the end joint, with the quad edges they lie on, sorted.
    fn end_edges(&self, on_end: &[OnPlanes]) -> Vec<OnPlanes> {
        let edges = |planes: u16| (0..4).filter(|&k| planes & self.edge_planes[1][k] != 0).fold(0, |m, k| m | 1 << k);
        let mut ended: Vec<OnPlanes> = on_end.iter().map(|t| OnPlanes { vertex: t.vertex, planes: edges(t.planes) }).collect();
        ended.sort_unstable_by_key(|t| t.vertex);
        ended.dedup_by(|a, b| {
            b.planes |= if a.vertex == b.vertex { a.planes } else { 0 };
            a.vertex == b.vertex
        });
        ended
    }
}
