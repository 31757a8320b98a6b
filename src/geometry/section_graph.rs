//! Connected components by sections: which sections hang together in themselves and with which others is kept between edits,
//! so that finding what a cut has parted looks only at the faces of the sections it went through.

use super::extract::Extraction;
use super::fx::FxHashMap;
use super::ids::{FaceId, HalfEdge, SectionId, VertexId};
use super::mesh::{Mesh, MeshDelta};
use super::room::{fit, headroom};

/// Parts that a stroke may take off before it has to find room for one more.
const SPARE_PARTS: usize = 4;
/// Faces of a part, in sections of several, that there is room for at first.
const MOST_LOOSE: usize = 1 << 14;
/// Sections next to one, as many as there is room for at first.
const NEIGHBOURS: usize = 32;
/// In place of the piece of a face that is in none yet.
const UNSORTED: u32 = u32::MAX;

/// What is known of a section.
#[derive(Clone, Debug, Default)]
struct Facts {
    faces: usize,
    /// Vertices that lean on one of its faces.
    vertices: usize,
    lowest_face: FaceId,
    lowest_origin: u32,
    /// True if it is one component by itself.
    whole: bool,
    /// Sections that it shares an edge with.
    neighbours: Vec<SectionId>,
}

/// A connected component of the mesh.
#[derive(Clone, Debug)]
pub struct Part {
    /// Number of faces.
    pub faces: usize,
    /// Number of vertices.
    pub vertices: usize,
    /// Its lowest face: parts are in this order.
    pub lowest_face: FaceId,
    /// Lowest face of the model as loaded that it has a part of; `u32::MAX` if none.
    pub lowest_origin: u32,
    /// Sections that are a part of it as a whole.
    pub sections: Vec<SectionId>,
    /// Its faces in other sections.
    pub loose: Vec<FaceId>,
}

/// What is known of the sections of one mesh, and buffers.
#[derive(Clone, Debug, Default)]
pub struct SectionGraph {
    facts: Vec<Facts>,
    /// Sections whose faces have changed since their facts were gathered.
    stale: Vec<bool>,
    /// The search that last listed a face, and the face's place in it or the piece it was sorted into.
    slots: Vec<[u32; 2]>,
    search: u32,
    loose: Vec<FaceId>,
    stack: Vec<FaceId>,
    parent: Vec<u32>,
    part_of: Vec<u32>,
    /// The components, while nothing has changed since they were looked for.
    kept: Option<Vec<Part>>,
    /// Room of such that are no more: the parts', and their list's.
    spare: Vec<Part>,
    spare_list: Vec<Part>,
}

/// Calls `mark` with every section of `mesh` that holds or held a face whose row is among `$notes`: the arrays of a mesh or of a
/// delta, which both tell what was touched and what was written over.
macro_rules! mark_touched {
    ($mesh:expr, $notes:expr, $mark:expr) => {{
        let (mesh, notes, mut mark): (&Mesh, _, _) = ($mesh, $notes, $mark);
        // slices of everything: notes are many, and nobody is to look lengths up for each
        let (infos, vertices) = (mesh.all_face_infos(), mesh.all_vertex_half_edges());
        let now = |f: FaceId| infos.get(f.index()).map(|i| i.section);
        // arrays of faces grow together: what one has appended, all have
        let faces = notes.faces.overwritten_at().chain(notes.opposite.overwritten_at()).chain(notes.face_info.touched());
        faces.filter_map(|f| now(FaceId::new(f))).for_each(&mut mark);
        notes.face_info.overwritten().for_each(|i| mark(i.section));
        let leaving = notes.vertex_half_edge.touched().filter_map(|v| vertices.get(v));
        let left = notes.vertex_half_edge.overwritten();
        leaving.chain(left).filter(|h| h.is_some()).filter_map(|h| now(h.face())).for_each(&mut mark);
    }};
}

/// Which component things belonged to at some time: tells of later parts what they were parts of.
#[derive(Clone, Debug, Default)]
pub struct PartsBefore {
    /// By section, for those that were of one component. Empty, as is the other, if there was only one.
    of_section: Vec<u32>,
    /// By the loaded face that it is a part of, for faces of other sections.
    of_origin: FxHashMap<u32, u32>,
}

impl PartsBefore {
    /// The component that `part` was in, the first of several that walls have joined: a number below that of the components there
    /// were, or `u32::MAX` if no face of it is a part of a loaded one, as with what has walls alone.
    pub fn of(&self, mesh: &Mesh, part: &Part) -> u32 {
        if part.lowest_origin == u32::MAX {
            return u32::MAX;
        }
        if self.of_section.is_empty() {
            return 0;
        }
        let skin = |f: &FaceId| !mesh.is_interior(*f);
        let by_origin = |f: FaceId| self.of_origin.get(&mesh.face_info(f).origin).copied().unwrap_or(u32::MAX);
        let by_section = |s: SectionId| self.of_section.get(s.index()).copied().filter(|&part| part != u32::MAX);
        let mut first = u32::MAX;
        for &s in &part.sections {
            first = first.min(match by_section(s) {
                // one face tells of all
                Some(part) if mesh.section_faces(s).any(|f| skin(&f)) => part,
                Some(_) => u32::MAX,
                None => mesh.section_faces(s).filter(skin).map(by_origin).min().unwrap_or(u32::MAX),
            });
            if first == 0 {
                return 0;
            }
        }
        let loose =
            part.loose.iter().filter(|f| skin(f)).map(|&f| by_section(mesh.face_info(f).section).unwrap_or_else(|| by_origin(f)));
        first.min(loose.min().unwrap_or(u32::MAX))
    }
}

impl SectionGraph {
    /// Makes room for what strokes through `mesh` look for in it: no stroke waits for it.
    pub fn make_room(&mut self, mesh: &Mesh, before: &mut PartsBefore) {
        let count = self.parts(mesh).len() + SPARE_PARTS;
        self.spare.resize_with(count, || Part::with_room(mesh));
        self.spare_list.reserve(count);
        let parts = self.parts(mesh);
        self.keep(parts);
        before.of_section.reserve(2 * mesh.sections());
        before.of_origin.reserve(mesh.face_slots().min(MOST_LOOSE));
        self.slots.reserve(headroom(mesh.face_slots()));
        self.loose.reserve(mesh.face_slots());
        self.stack.reserve(mesh.face_slots());
        let nodes = headroom(mesh.sections());
        self.parent.reserve(nodes);
        self.part_of.reserve(nodes);
    }

    /// Notes what the edits since the last delta have changed. To be called before the delta is taken. True if anything has.
    pub fn note_edits(&mut self, mesh: &Mesh) -> bool {
        let (stale, mut any) = (&mut self.stale[..], false);
        mark_touched!(mesh, mesh, |s| any |= mark(stale, s));
        if any {
            self.forget_parts();
        }
        any
    }

    /// Notes what going back or forth by a delta has changed; `inverse` is what it returned. True if anything has.
    pub fn note_delta(&mut self, mesh: &Mesh, inverse: &MeshDelta) -> bool {
        let (stale, mut any) = (&mut self.stale[..], false);
        mark_touched!(mesh, inverse, |s| any |= mark(stale, s));
        if any {
            self.forget_parts();
        }
        any
    }

    fn forget_parts(&mut self) {
        if let Some(mut list) = self.kept.take() {
            self.spare.extend(list.drain(..).map(Part::emptied));
            self.spare_list = list;
        }
    }

    /// True if the facts of a section hold.
    pub fn is_fresh(&self, s: SectionId) -> bool {
        self.stale.get(s.index()) == Some(&false)
    }

    /// True if a section is known to be one component by itself.
    pub fn is_whole(&self, s: SectionId) -> bool {
        self.is_fresh(s) && self.facts[s.index()].whole && self.facts[s.index()].faces > 0
    }

    /// Gathers the facts of all sections that have changed, calling `gathered` with each and its faces.
    pub fn refresh(&mut self, mesh: &Mesh, mut gathered: impl FnMut(SectionId, &[FaceId])) {
        self.note_edits(mesh);
        self.fit(mesh);
        for s in (0..mesh.sections()).map(SectionId::new) {
            if self.stale[s.index()] {
                self.gather(mesh, s);
                gathered(s, &self.loose);
            }
        }
    }

    /// What is known of the sections that went into a mesh of their own, as whole components: those that were known to be one by
    /// themselves went as a whole.
    pub fn extract(&self, map: &Extraction) -> Self {
        let taken = |s: &SectionId| {
            let facts = self.facts.get(s.index()).filter(|_| self.is_whole(*s))?;
            let neighbours = facts.neighbours.iter().map(|n| map.section_to[n.index()]).collect();
            Some(Facts { lowest_face: map.face_to[facts.lowest_face.index()], neighbours, ..*facts })
        };
        Self {
            facts: map.section_from.iter().map(|s| taken(s).unwrap_or_default()).collect(),
            stale: map.section_from.iter().map(|s| !self.is_whole(*s)).collect(),
            ..Self::default()
        }
    }

    fn fit(&mut self, mesh: &Mesh) {
        self.stale.resize(mesh.sections(), true);
        self.facts.resize(mesh.sections(), Facts::default());
    }

    fn begin(&mut self, mesh: &Mesh) {
        if self.search == u32::MAX {
            self.slots.fill([0; 2]);
            self.search = 0;
        }
        self.search += 1;
        if self.slots.is_empty() {
            self.slots = vec![[0; 2]; mesh.face_slots() + mesh.face_slots() / 4];
        } else {
            fit(&mut self.slots, mesh.face_slots(), [0; 2]);
        }
        self.loose.clear();
    }

    fn list(&mut self, mesh: &Mesh, s: SectionId, place: impl Fn(usize) -> u32) {
        let Self { slots, search, loose, .. } = self;
        let slots = &mut slots[..];
        for f in mesh.section_faces(s) {
            slots[f.index()] = [*search, place(loose.len())];
            loose.push(f);
        }
    }

    /// Place of a face among those listed by this search.
    fn place(&self, f: FaceId) -> Option<u32> {
        let [search, place] = self.slots[f.index()];
        (search == self.search).then_some(place)
    }

    fn gather(&mut self, mesh: &Mesh, s: SectionId) {
        self.begin(mesh);
        self.list(mesh, s, |place| place as u32);
        self.parent.clear();
        self.parent.extend(0..self.loose.len() as u32);
        let mut neighbours = std::mem::take(&mut self.facts[s.index()].neighbours);
        neighbours.clear();
        neighbours.reserve(NEIGHBOURS);
        let mut facts = Facts { faces: self.loose.len(), lowest_origin: u32::MAX, neighbours, ..Facts::default() };
        let mut parts = self.loose.len();
        for i in 0..self.loose.len() {
            let f = self.loose[i];
            facts.lowest_face = facts.lowest_face.min(f);
            facts.lowest_origin = facts.lowest_origin.min(mesh.face_info(f).origin);
            facts.vertices += owned(mesh, f);
            for across in mesh.all_opposites()[f.index()].into_iter().filter(|h| h.is_some()) {
                match self.place(across.face()) {
                    // each edge once, as long as there is something to join
                    Some(j) => parts -= usize::from(parts > 1 && j < i as u32 && join(&mut self.parent, i as u32, j)),
                    None => {
                        let other = mesh.face_info(across.face()).section;
                        if !facts.neighbours.contains(&other) {
                            facts.neighbours.push(other);
                        }
                    }
                }
            }
        }
        facts.whole = parts <= 1;
        self.facts[s.index()] = facts;
        self.stale[s.index()] = false;
    }

    /// The connected components of the mesh, ordered by their lowest face.
    pub fn parts(&mut self, mesh: &Mesh) -> Vec<Part> {
        self.note_edits(mesh);
        if let Some(known) = self.kept.take() {
            return known;
        }
        self.fit(mesh);
        self.begin(mesh);
        let sections = mesh.sections();
        for s in 0..sections {
            if self.stale[s] || !self.facts[s].whole {
                self.list(mesh, SectionId::new(s), |_| UNSORTED);
            }
        }
        self.flood_loose(mesh);
        let Self { facts, stale, parent, .. } = &mut *self;
        let is_node = |s: usize| !stale[s] && facts[s].whole;
        for s in (0..sections).filter(|&s| is_node(s)) {
            for &n in facts[s].neighbours.iter().filter(|n| n.index() < s && is_node(n.index())) {
                join(parent, s as u32, n.0);
            }
        }
        self.collect(mesh)
    }

    /// Takes the components back that [`SectionGraph::parts`] has given: as long as nothing changes they are what there is.
    pub fn keep(&mut self, parts: Vec<Part>) {
        self.kept = Some(parts);
    }

    /// Notes the components that there are, for [`PartsBefore::of`].
    pub fn note_parts(&mut self, mesh: &Mesh, before: &mut PartsBefore) {
        let parts = self.parts(mesh);
        let PartsBefore { of_section, of_origin } = before;
        of_section.clear();
        of_origin.clear();
        if parts.len() > 1 {
            of_section.resize(mesh.sections(), u32::MAX);
            for (c, part) in (0u32..).zip(&parts) {
                part.sections.iter().for_each(|s| of_section[s.index()] = c);
                of_origin.extend(part.loose.iter().map(|&f| (mesh.face_info(f).origin, c)));
            }
        }
        self.keep(parts);
    }

    /// Sorts the loose faces into pieces, nodes behind those of the sections, and joins each to the whole sections it touches.
    fn flood_loose(&mut self, mesh: &Mesh) {
        let sections = mesh.sections() as u32;
        let Self { slots, search, loose, stack, parent, .. } = self;
        let (slots, search, opposites) = (&mut slots[..], *search, mesh.all_opposites());
        parent.clear();
        parent.extend(0..sections);
        for &seed in loose.iter() {
            if slots[seed.index()][1] != UNSORTED {
                continue;
            }
            let node = parent.len() as u32;
            parent.push(node);
            slots[seed.index()][1] = node;
            stack.push(seed);
            let mut last = u32::MAX;
            while let Some(f) = stack.pop() {
                for across in &opposites[f.index()] {
                    if across.is_none() {
                        continue;
                    }
                    let f = across.face();
                    let [met, sorted] = &mut slots[f.index()];
                    if *met != search {
                        let section = mesh.face_info(f).section.0;
                        if section != last {
                            join(parent, node, section);
                            last = section;
                        }
                    } else if *sorted == UNSORTED {
                        *sorted = node;
                        stack.push(f);
                    }
                }
            }
        }
    }

    /// Vertices of all sections and the lowest face of the model as loaded that they have a part of. Of a refreshed graph.
    pub fn totals(&self) -> (usize, u32) {
        let lowest = self.facts.iter().filter(|f| f.faces > 0).map(|f| f.lowest_origin).min();
        (self.facts.iter().map(|f| f.vertices).sum(), lowest.unwrap_or(u32::MAX))
    }

    fn collect(&mut self, mesh: &Mesh) -> Vec<Part> {
        let sections = self.facts.len();
        let Self { facts, stale, loose, slots, parent, part_of, spare, .. } = self;
        let mut parts = std::mem::take(&mut self.spare_list);
        part_of.clear();
        part_of.resize(parent.len(), u32::MAX);
        let mut part = |node: usize, parts: &mut Vec<Part>| {
            let root = find(parent, node as u32) as usize;
            if part_of[root] == u32::MAX {
                part_of[root] = parts.len() as u32;
                // a stroke mostly leaves one, a cut two
                let [whole, few] = if parts.len() < 2 { [sections, loose.len()] } else { [0; 2] };
                let mut new = spare.pop().unwrap_or_default();
                new.sections.reserve(whole);
                new.loose.reserve(few);
                parts.push(new);
            }
            part_of[root] as usize
        };
        for s in (0..sections).filter(|&s| !stale[s] && facts[s].whole && facts[s].faces > 0) {
            let at = part(s, &mut parts);
            let (part, facts) = (&mut parts[at], &facts[s]);
            part.sections.push(SectionId::new(s));
            part.faces += facts.faces;
            part.vertices += facts.vertices;
            part.lowest_face = part.lowest_face.min(facts.lowest_face);
            part.lowest_origin = part.lowest_origin.min(facts.lowest_origin);
        }
        // a face is mostly in the piece that the one before it is in
        let (slots, infos, mut left) = (&slots[..], mesh.all_face_infos(), &loose[..]);
        while let Some(first) = left.first() {
            let node = slots[first.index()][1];
            let at = part(node as usize, &mut parts);
            let part = &mut parts[at];
            let (mut len, mut vertices, mut lowest) = (0, 0, (part.lowest_face, part.lowest_origin));
            for &f in left {
                if slots[f.index()][1] != node {
                    break;
                }
                len += 1;
                vertices += owned(mesh, f);
                lowest = (lowest.0.min(f), lowest.1.min(infos[f.index()].origin));
            }
            let (run, others) = left.split_at(len);
            part.loose.extend_from_slice(run);
            part.faces += len;
            part.vertices += vertices;
            (part.lowest_face, part.lowest_origin) = lowest;
            left = others;
        }
        parts.sort_unstable_by_key(|p| p.lowest_face);
        parts
    }
}

impl Default for Part {
    /// A part of no faces.
    fn default() -> Self {
        let (sections, loose) = (Vec::new(), Vec::new());
        Self { faces: 0, vertices: 0, lowest_face: FaceId::NONE, lowest_origin: u32::MAX, sections, loose }
    }
}

impl Part {
    fn with_room(mesh: &Mesh) -> Self {
        let sections = Vec::with_capacity(headroom(mesh.sections()));
        Self { sections, loose: Vec::with_capacity(mesh.face_slots().min(MOST_LOOSE)), ..Self::default() }
    }

    /// One of no faces, in its room.
    fn emptied(mut self) -> Self {
        self.sections.clear();
        self.loose.clear();
        Self { sections: self.sections, loose: self.loose, ..Self::default() }
    }

    /// Takes it out and leaves a part without faces.
    pub fn take(&mut self) -> Self {
        let empty = Self { sections: Vec::new(), loose: Vec::new(), faces: 0, vertices: 0, ..*self };
        std::mem::replace(self, empty)
    }

    /// Takes in another part, which is not connected to it.
    pub fn absorb(&mut self, other: Part) {
        self.faces += other.faces;
        self.vertices += other.vertices;
        self.lowest_face = self.lowest_face.min(other.lowest_face);
        self.lowest_origin = self.lowest_origin.min(other.lowest_origin);
        self.sections.extend(other.sections);
        self.loose.extend(other.loose);
    }

    /// Its faces, in no particular order.
    pub fn all_faces<'a>(&'a self, mesh: &'a Mesh) -> impl Iterator<Item = FaceId> + 'a {
        self.sections.iter().flat_map(|&s| mesh.section_faces(s)).chain(self.loose.iter().copied())
    }

    /// Its faces, ascending: by a bit each, which is faster than to sort them.
    pub fn sorted_faces(&self, mesh: &Mesh) -> Vec<FaceId> {
        let mut bits = vec![0u64; mesh.face_slots().div_ceil(64)];
        self.all_faces(mesh).for_each(|f| bits[f.index() / 64] |= 1 << (f.index() % 64));
        let mut faces = Vec::with_capacity(self.faces);
        for (i, &word) in bits.iter().enumerate().filter(|(_, word)| **word != 0) {
            let mut left = word;
            while left != 0 {
                faces.push(FaceId::new(64 * i + left.trailing_zeros() as usize));
                left &= left - 1;
            }
        }
        faces
    }
}

/// How many vertices lean on this face.
fn owned(mesh: &Mesh, f: FaceId) -> usize {
    let leaving = mesh.all_vertex_half_edges();
    let leans = |(v, k): (&VertexId, usize)| usize::from(leaving[v.index()] == HalfEdge::of(f, k));
    mesh.face(f).iter().zip(0..).map(leans).sum()
}

fn mark(stale: &mut [bool], s: SectionId) -> bool {
    if let Some(stale) = stale.get_mut(s.index()) {
        *stale = true;
    }
    true
}

fn find(parent: &mut [u32], mut node: u32) -> u32 {
    while parent[node as usize] != node {
        let above = parent[parent[node as usize] as usize];
        parent[node as usize] = above;
        node = above;
    }
    node
}

/// Joins two nodes; false if they were.
fn join(parent: &mut [u32], a: u32, b: u32) -> bool {
    let (a, b) = (find(parent, a), find(parent, b));
    parent[a.max(b) as usize] = a.min(b);
    a != b
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::TopologyScratch;
    use crate::geometry::extract::tests::pair;
    use crate::geometry::validate::tests::octahedron;

    #[test]
    fn parts_know_what_they_were_parts_of() {
        let (one, mesh) = (octahedron(), pair());
        let opposite = (1..8).find(|&f| one.face(FaceId(f)).iter().all(|v| !one.face(FaceId(0)).contains(v))).unwrap();
        for sections in [vec![0; 16], (0..16).map(|f| f / 8).collect(), (0..16).map(|f| f % 2).collect()] {
            let mut mesh = mesh.clone();
            mesh.assign_sections(2, &sections.into_iter().map(SectionId).collect::<Vec<_>>());
            let mut graph = SectionGraph::default();
            graph.refresh(&mesh, |_, _| {});
            let mut before = PartsBefore::default();
            graph.note_parts(&mesh, &mut before);
            // all but two faces of the second go
            let gone: Vec<FaceId> = (8..16).filter(|f| ![8, 8 + opposite].contains(f)).map(FaceId).collect();
            mesh.remove_faces(&gone, &mut TopologyScratch::default());
            let parts = graph.parts(&mesh);
            assert_eq!(parts.iter().map(|p| (p.faces, before.of(&mesh, p))).collect::<Vec<_>>(), [(8, 0), (1, 1), (1, 1)]);
            // walls have joined both: no matter which is met first
            let joined = Part { loose: vec![FaceId(8), FaceId(0)], sections: Vec::new(), ..parts[0].clone() };
            assert_eq!(before.of(&mesh, &joined), 0);
            // of one component everything is a part, but what has no loaded face
            assert_eq!(PartsBefore::default().of(&mesh, &parts[1]), 0);
            assert_eq!(before.of(&mesh, &Part { lowest_origin: u32::MAX, ..parts[1].clone() }), u32::MAX);
        }
    }
}
