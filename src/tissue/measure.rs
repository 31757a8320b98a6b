//! Areas, volumes and counts of a tissue or of a part of it, in the pose the user sees. Sums are kept section by section, so
//! that a report after an edit measures what the edit has changed.

use super::Tissue;
use crate::diagnostics::audits;
use crate::geometry::measure::{OpenEdge, measure_faces, open_edges};
use crate::geometry::{Extraction, FaceId, Measures, Part, PartsBefore, Plane, SectionGraph, SectionId, VertexId};
use glam::DVec3;

/// What a report says of a tissue or of a part of it.
#[derive(Clone, Debug)]
pub struct Sums {
    /// Areas, volumes, edges.
    pub measures: Measures,
    /// Live vertices.
    pub vertices: usize,
    /// Lowest face of the model as loaded that it has a part of; `u32::MAX` if none.
    pub lowest_origin: u32,
}

/// What is known of a tissue's sections.
#[derive(Debug, Default)]
pub(super) struct Tally {
    graph: SectionGraph,
    /// Measures of each section without edges, and how many of its half-edges are open.
    sections: Vec<(Measures, usize)>,
    /// What final positions hung on when the sections were measured.
    key: Option<[u64; 3]>,
    /// The whole tissue, and what its final positions hung on.
    whole: Option<([u64; 3], Sums)>,
    /// Number of vertices and lowest loaded face, where an edit has told.
    counts: Option<(usize, u32)>,
}

impl Tally {
    /// True if a section is known to be one component by itself: it goes or stays as a whole.
    pub(super) fn is_whole(&self, s: SectionId) -> bool {
        self.graph.is_whole(s)
    }

    /// What is known of a piece that has become a tissue; its sections have the sums they had here, if those hold at `key`.
    pub(super) fn extract(&self, map: &Extraction, key: [u64; 3]) -> Self {
        let sums = |s: &SectionId| self.sections.get(s.index()).copied().unwrap_or((Measures::EMPTY, 0));
        let holds = self.key == Some(key);
        let sections = if holds { map.section_from.iter().map(sums).collect() } else { Vec::new() };
        Self { graph: self.graph.extract(map), sections, ..Self::default() }
    }
}

impl Tissue {
    /// Measures `faces` at their final positions. f64 sums; square and cubic metres.
    pub fn measure(&self, faces: impl Iterator<Item = FaceId>) -> Measures {
        let posed = self.posed();
        measure_faces(&self.mesh, faces, |v| posed.position(v))
    }

    /// Measures the whole tissue.
    pub fn measure_all(&self) -> Measures {
        let positions = self.positions();
        measure_faces(&self.mesh, self.mesh.live_faces(), |v| positions[v.index()])
    }

    /// Final positions of all live vertices, each posed once.
    fn positions(&self) -> Vec<DVec3> {
        let posed = self.posed();
        let position = |v: VertexId| if self.mesh.vertex_is_live(v) { posed.position(v) } else { DVec3::ZERO };
        (0..self.mesh.vertex_slots()).map(|v| position(VertexId::new(v))).collect()
    }

    /// Everything that final positions hang on now, but for the rows: equal keys, equal positions.
    pub(super) fn position_key(&self) -> [u64; 3] {
        if self.is_still() {
            return [self.versions.pose, u64::MAX, u64::MAX];
        }
        let time = if self.fades.running(self.time_s) { self.time_s.to_bits() } else { 0 };
        let displacements = self.layer.as_ref().map_or(&[][..], |l| l.displacements());
        let mut hash = crate::geometry::StateHash::default();
        hash.bytes(bytemuck::cast_slice(displacements));
        hash.word(self.versions.rotations);
        [self.versions.pose, hash.finish() ^ time, self.versions.fades]
    }

    /// After an edit that moved no vertex it did not make: what was measured with `before` still holds.
    pub(super) fn positions_kept(&mut self, before: [u64; 3]) {
        if self.tally.key == Some(before) {
            self.tally.key = Some(self.position_key());
        }
    }

    /// To be called before a delta is taken.
    pub(super) fn note_edits(&mut self) {
        if self.tally.graph.note_edits(&self.mesh) {
            (self.tally.whole, self.tally.counts) = (None, None);
        }
    }

    /// To be called after going back or forth by a delta.
    pub(super) fn note_travel(&mut self, inverse: &crate::geometry::MeshDelta) {
        self.scratch.chords.forget();
        self.tally.graph.note_delta(&self.mesh, inverse);
        (self.tally.whole, self.tally.counts) = (None, None);
    }

    /// Brings the sums of all sections to what they are now.
    pub(super) fn refresh_tally(&mut self) {
        let mut tally = std::mem::take(&mut self.tally);
        let key = Some(self.position_key());
        let (mesh, posed) = (&self.mesh, self.posed());
        tally.sections.resize(mesh.sections(), (Measures::EMPTY, 0));
        let mut open: Vec<OpenEdge> = Vec::new();
        let mut measured = |faces: &[FaceId], position: &dyn Fn(VertexId) -> DVec3| {
            let mut measures = Measures::EMPTY;
            measures.add_faces(mesh, faces.iter().copied(), position);
            open.clear();
            open_edges(mesh, faces.iter().copied(), &mut open);
            (measures, open.len())
        };
        if tally.key == key {
            let Tally { graph, sections, .. } = &mut tally;
            graph.refresh(mesh, |s, faces| sections[s.index()] = measured(faces, &|v| posed.position(v)));
        } else {
            let positions = self.positions();
            tally.graph.refresh(mesh, |_, _| {});
            let mut faces = Vec::new();
            for (s, sums) in tally.sections.iter_mut().enumerate() {
                faces.clear();
                faces.extend(mesh.section_faces(SectionId::new(s)));
                *sums = measured(&faces, &|v| positions[v.index()]);
            }
            tally.key = key;
        }
        self.tally = tally;
    }

    /// What a report says of the whole tissue. Measures the sections that have changed since the last call, or all if the
    /// tissue has moved.
    pub fn sums(&mut self) -> Sums {
        self.note_edits();
        let key = self.position_key();
        if let Some((known, sums)) = &self.tally.whole
            && *known == key
        {
            return sums.clone();
        }
        self.refresh_tally();
        let mut measures = Measures::EMPTY;
        self.tally.sections.iter().for_each(|s| measures.add(&s.0));
        let mut open = Vec::new();
        for s in (0..self.tally.sections.len()).filter(|&s| self.tally.sections[s].1 > 0) {
            open_edges(&self.mesh, self.mesh.section_faces(SectionId::new(s)), &mut open);
        }
        measures.count_edges(&mut open);
        let (vertices, lowest_origin) = self.tally.graph.totals();
        let sums = Sums { measures, vertices, lowest_origin };
        debug_assert!(self.are_right(&sums, 1e-9, 0.0), "{sums:?} and {:?}", self.measure_all());
        self.tally.whole = Some((key, sums.clone()));
        sums
    }

    /// [`Tissue::sums`], or if they are not asked for only the counts of faces and vertices, with NaN for areas and volumes.
    pub(crate) fn sums_if(&mut self, measuring: bool) -> Sums {
        if measuring {
            return self.sums();
        }
        self.note_edits();
        let (vertices, lowest_origin) = self.tally.counts.unwrap_or_else(|| {
            self.refresh_facts();
            self.tally.graph.totals()
        });
        debug_assert_eq!(vertices, self.mesh.live_vertices().count());
        let measures = Measures { faces: self.mesh.face_count(), area: f64::NAN, volume: f64::NAN, ..Measures::EMPTY };
        Sums { measures, vertices, lowest_origin }
    }

    /// [`Tissue::sums_if`] before an edit, which is to find the facts of all sections as they are.
    pub(crate) fn sums_before(&mut self, measuring: bool) -> Sums {
        if !measuring {
            self.refresh_facts();
        }
        self.sums_if(measuring)
    }

    fn refresh_facts(&mut self) {
        self.note_edits();
        let Tally { graph, key, .. } = &mut self.tally;
        // the sums of these sections do not follow
        graph.refresh(&self.mesh, |_, _| *key = None);
    }

    /// Tells what [`Tissue::sums_if`] would count, from a part that has become this tissue.
    pub(crate) fn adopt_counts(&mut self, vertices: usize, lowest_origin: u32) {
        self.note_edits();
        self.tally.counts = Some((vertices, lowest_origin));
    }

    /// Notes the components that there are now, to tell what parts of later on were parts of.
    pub fn note_parts(&mut self, before: &mut PartsBefore) {
        self.tally.graph.note_parts(&self.mesh, before);
    }

    /// Makes room for what strokes look for in their components.
    pub fn make_room_for_parts(&mut self, before: &mut PartsBefore) {
        self.tally.graph.make_room(&self.mesh, before);
    }

    /// Takes back what [`Tissue::parts`] has given, where nothing has come off since: it need not be found again.
    pub fn keep_parts(&mut self, parts: Vec<Part>) {
        let lowest = parts.iter().map(|p| p.lowest_origin).min();
        self.adopt_counts(parts.iter().map(|p| p.vertices).sum(), lowest.unwrap_or(u32::MAX));
        self.tally.graph.keep(parts);
    }

    /// `off` is how far vertices may be from where they were measured, metres.
    fn are_right(&self, sums: &Sums, tolerance: f64, off: f64) -> bool {
        let (known, new) = (sums.measures, self.measure_all());
        let counts = |m: &Measures| [m.faces, m.boundary_edges, m.non_manifold_edges];
        let reach = if new.faces > 0 { new.max.abs().max(new.min.abs()).max_element() } else { 0.0 };
        // a needle's area and volume may be less than what rounding makes of products of its corners
        let rounding = new.faces as f64 * reach * (1e-15 * reach + off);
        let near = |a: f64, b: f64, lever: f64| (a - b).abs() <= (tolerance * new.area + rounding) * lever;
        counts(&known) == counts(&new)
            && near(known.area, new.area, 1.0)
            && near(known.volume, new.volume, reach)
            && sums.vertices == self.mesh.live_vertices().count()
    }

    /// Fades, in f32, hold the vertices of a new piece: so far they may be off, metres.
    fn rounding_of_fades(&self) -> f64 {
        let longest = self.mesh.live_vertices().map(|v| self.faded(v).length()).fold(0.0, f64::max);
        f64::from(f32::EPSILON) * longest
    }

    /// Sets what [`Tissue::sums`] would find, from what a part that has become this tissue was measured as.
    pub fn adopt_sums(&mut self, sums: Sums) {
        self.note_edits();
        debug_assert!(self.are_right(&sums, 1e-5, self.rounding_of_fades()), "{sums:?} and {:?}", self.measure_all());
        let key = self.position_key();
        self.tally.whole = Some((key, sums));
        if self.tally.key.is_none() && self.tally.sections.len() == self.mesh.sections() {
            self.tally.key = Some(key);
        }
    }

    /// The connected components, by their lowest face. Looks only at faces of sections that have changed since the last
    /// [`Tissue::sums`].
    pub fn parts(&mut self) -> Vec<Part> {
        let parts = self.tally.graph.parts(&self.mesh);
        let are_components = |parts: &[Part]| parts.iter().map(|p| p.sorted_faces(&self.mesh)).eq(self.component_faces());
        debug_assert!(!audits() || are_components(&parts), "a part is not a component");
        parts
    }

    /// Measures a part that [`Tissue::parts`] has found.
    pub fn measure_part(&self, part: &Part) -> Sums {
        let posed = self.posed();
        let known = self.tally.key == Some(self.position_key());
        let (mut measures, mut open) = (Measures::EMPTY, Vec::new());
        for &s in &part.sections {
            let (sums, open_half_edges) = self.tally.sections.get(s.index()).copied().unwrap_or((Measures::EMPTY, 1));
            let faces = || self.mesh.section_faces(s);
            if known && self.tally.graph.is_fresh(s) {
                measures.add(&sums);
            } else {
                measures.add_faces(&self.mesh, faces(), |v| posed.position(v));
            }
            if open_half_edges > 0 {
                open_edges(&self.mesh, faces(), &mut open);
            }
        }
        measures.add_faces(&self.mesh, part.loose.iter().copied(), |v| posed.position(v));
        open_edges(&self.mesh, part.loose.iter().copied(), &mut open);
        measures.count_edges(&mut open);
        Sums { measures, vertices: part.vertices, lowest_origin: part.lowest_origin }
    }

    /// How far the farthest of `vertices` is off `plane` (tissue space), metres.
    pub fn farthest_off(&self, plane: &Plane, vertices: impl Iterator<Item = VertexId>) -> f64 {
        let posed = self.posed();
        vertices.map(|v| plane.distance(posed.position(v)).abs()).fold(0.0, f64::max)
    }

    /// The side of `plane` (tissue space) that a part lies on, +1 or -1: by a vertex well off it, or the farthest there is.
    pub fn side_of_part(&self, part: &Part, plane: &Plane) -> i8 {
        let (mut farthest, mut value) = (0.0f64, 0.0);
        for v in part.all_faces(&self.mesh).flat_map(|f| self.mesh.face(f)) {
            let at = self.position(v);
            let distance = plane.distance(at).abs();
            if distance > farthest {
                (farthest, value) = (distance, plane.value(at));
            }
            if farthest > 1e-3 * self.diagonal && value != 0.0 {
                break;
            }
        }
        if value < 0.0 { -1 } else { 1 }
    }
}
