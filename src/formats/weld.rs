//! From stored indices to topology (MATHS 1.6): open edges that form exactly one oppositely oriented coincident pair are
//! zipped; nothing else is. A plain weld by position would glue touching parts and close width-0 slits.

use super::flats::is_flat;
use super::stored::{NO_MARK, Stored, StoredFace};
use crate::geometry::VertexId;
use crate::rig::BoneWeight;

/// Topology of a stored surface.
#[derive(Debug, Default)]
pub(crate) struct Welded {
    /// Faces kept, with their stored indices.
    pub faces: Vec<StoredFace>,
    /// Topological corners of each.
    pub corners: Vec<[VertexId; 3]>,
    /// Lowest stored vertex of each topological one: it gives position and bones.
    pub first: Vec<u32>,
    /// Class of each topological vertex: equal where positions coincide (and marks agree).
    pub class: Vec<u32>,
    pub degenerate_faces: usize,
    /// Of these, such as have three corners in different places and no area.
    pub flat_faces: usize,
    pub duplicate_faces: usize,
    /// Largest difference of one joint's weight between stored copies of a vertex.
    pub largest_weight_difference: f32,
}

/// Decides the topology. `classes` is [`classes`] of the vertices.
pub(crate) fn weld(stored: &Stored, classes: &[u32]) -> Welded {
    let mut welded = Welded::default();
    let mut sets = Sets::new(stored.positions.len());
    union_marked(stored, classes, &mut sets);
    let mut faces = drop_flat(stored, classes, &mut welded);
    drop_repeats(&mut faces, &mut welded.duplicate_faces, |f| {
        let [a, b, c] = f.corners.map(|v| classes[v as usize]);
        [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap_or([a, b, c])
    });
    zip(stored, &faces, classes, &mut sets);
    let before = faces.len();
    faces.retain(|f| {
        let [a, b, c] = f.corners.map(|v| sets.find(v));
        a != b && b != c && c != a
    });
    welded.degenerate_faces += before - faces.len();
    drop_repeats(&mut faces, &mut welded.duplicate_faces, |f| {
        let mut set = f.corners.map(|v| sets.find(v));
        if f.corners.iter().any(|&v| !decided(stored, v)) {
            set.sort_unstable();
        } else {
            let lowest = (0..3).min_by_key(|&k| set[k]).unwrap_or(0);
            set.rotate_left(lowest); // what we exported is kept as it is
        }
        set
    });
    number(stored, faces, classes, &mut sets, &mut welded);
    welded
}

/// True if the file says which stored vertices are one.
pub(super) fn decided(stored: &Stored, v: u32) -> bool {
    stored.indices_decide || stored.marks[v as usize] != NO_MARK
}

/// Equal numbers for stored vertices that coincide bit for bit (minus zero counts as zero), in one place, and carry the same mark.
pub(crate) fn classes(stored: &Stored) -> Vec<u32> {
    let key = |v: u32| {
        let mark = if stored.indices_decide { v } else { stored.marks[v as usize] };
        let place = stored.places.get(v as usize).copied().unwrap_or(0);
        (mark, place, (stored.positions[v as usize] + 0.0).to_array().map(f64::to_bits))
    };
    let mut order: Vec<u32> = (0..stored.positions.len() as u32).collect();
    order.sort_unstable_by_key(|&v| (key(v), v));
    let mut classes = vec![0; order.len()];
    for run in order.chunk_by(|&a, &b| key(a) == key(b)) {
        for &v in run {
            classes[v as usize] = run[0];
        }
    }
    classes
}

fn union_marked(stored: &Stored, classes: &[u32], sets: &mut Sets) {
    for v in 0..stored.positions.len() as u32 {
        if decided(stored, v) {
            sets.union(v, classes[v as usize]);
        }
    }
}

/// Faces without repeated positions and, where the file leaves topology to us, with an area.
fn drop_flat(stored: &Stored, classes: &[u32], welded: &mut Welded) -> Vec<StoredFace> {
    let mut keep = |f: &&StoredFace| {
        let [a, b, c] = f.corners.map(|v| classes[v as usize]);
        if a == b || b == c || c == a {
            return false;
        }
        let is_flat = is_flat(stored, classes, f);
        welded.flat_faces += usize::from(is_flat);
        !is_flat
    };
    let kept: Vec<StoredFace> = stored.faces.iter().filter(|f| keep(f)).copied().collect();
    welded.degenerate_faces += stored.faces.len() - kept.len();
    kept
}

/// Keeps the first face of each key.
fn drop_repeats(faces: &mut Vec<StoredFace>, dropped: &mut usize, mut key: impl FnMut(&StoredFace) -> [u32; 3]) {
    let mut keys: Vec<([u32; 3], u32)> = faces.iter().enumerate().map(|(i, f)| (key(f), i as u32)).collect();
    keys.sort_unstable();
    let mut repeats: Vec<u32> = keys.windows(2).filter(|w| w[0].0 == w[1].0).map(|w| w[1].1).collect();
    repeats.sort_unstable();
    *dropped += repeats.len();
    let mut index = 0;
    faces.retain(|_| {
        index += 1;
        repeats.binary_search(&(index - 1)).is_err()
    });
}

/// A half-edge for pairing: its undirected key, whether it runs from the lower end, and its stored ends.
type Edge = ((u32, u32), bool, [u32; 2]);

fn zip(stored: &Stored, faces: &[StoredFace], classes: &[u32], sets: &mut Sets) {
    let mut edges: Vec<Edge> = Vec::with_capacity(faces.len() * 3);
    for face in faces {
        for k in 0..3 {
            let ends = [face.corners[k], face.corners[(k + 1) % 3]];
            let [a, b] = ends.map(|v| sets.find(v));
            edges.push(((a.min(b), a.max(b)), a < b, ends));
        }
    }
    edges.sort_unstable();
    let mut open: Vec<Edge> = Vec::new();
    for run in edges.chunk_by(|a, b| a.0 == b.0) {
        if let [(_, _, ends)] = *run
            && ends.iter().all(|&v| !decided(stored, v))
        {
            let [a, b] = ends.map(|v| classes[v as usize]);
            open.push(((a.min(b), a.max(b)), a < b, ends));
        }
    }
    open.sort_unstable();
    for run in open.chunk_by(|a, b| a.0 == b.0) {
        if let [(_, forward, [a, b]), (_, back, [c, d])] = *run
            && forward != back
        {
            sets.union(a, d);
            sets.union(b, c);
        }
    }
}

/// Numbers the vertices in use by their lowest stored index.
fn number(stored: &Stored, faces: Vec<StoredFace>, classes: &[u32], sets: &mut Sets, welded: &mut Welded) {
    let mut used = vec![false; stored.positions.len()];
    for v in faces.iter().flat_map(|f| f.corners) {
        used[v as usize] = true;
    }
    let mut vertex_of = vec![VertexId::NONE; stored.positions.len()];
    for v in (0..stored.positions.len() as u32).filter(|&v| used[v as usize]) {
        let root = sets.find(v) as usize;
        if vertex_of[root].is_none() {
            vertex_of[root] = VertexId::new(welded.first.len());
            welded.first.push(v);
            welded.class.push(classes[v as usize]);
        }
        vertex_of[v as usize] = vertex_of[root];
        let first = welded.first[vertex_of[root].index()];
        let difference = weight_difference(stored, first as usize, v as usize);
        welded.largest_weight_difference = welded.largest_weight_difference.max(difference);
    }
    welded.corners = faces.iter().map(|f| f.corners.map(|v| vertex_of[v as usize])).collect();
    welded.faces = faces;
}

/// Largest difference of a joint's weight between two stored vertices.
fn weight_difference(stored: &Stored, a: usize, b: usize) -> f32 {
    let (a, b) = (stored.bones(a), stored.bones(b));
    let is_still = |bones: &[BoneWeight]| bones.iter().all(|w| stored.still.binary_search(&w.joint).is_ok());
    if (a.is_empty() && is_still(b)) || (b.is_empty() && is_still(a)) {
        return 0.0;
    }
    let weight = |bones: &[BoneWeight], joint| bones.iter().find(|w| w.joint == joint).map_or(0.0, |w| w.weight);
    a.iter().chain(b).map(|w| (weight(a, w.joint) - weight(b, w.joint)).abs()).fold(0.0, f32::max)
}

/// Disjoint sets whose representative is the lowest member.
struct Sets {
    parent: Vec<u32>,
}

impl Sets {
    fn new(len: usize) -> Self {
        Self { parent: (0..len as u32).collect() }
    }

    fn find(&mut self, mut v: u32) -> u32 {
        while self.parent[v as usize] != v {
            self.parent[v as usize] = self.parent[self.parent[v as usize] as usize];
            v = self.parent[v as usize];
        }
        v
    }

    fn union(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}
