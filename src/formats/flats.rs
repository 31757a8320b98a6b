//! Faces without an area that close a surface: a T-junction's filling, as mesh boolean tools and CAD exports leave them.
//!
//! Dropping such a face would open the model. The edge across its middle corner is flipped instead: the face beyond it is divided
//! at that corner. The surface stays where it is, closed as before, and every face has an area.

use super::stored::{Dress, Stored, StoredFace};
use super::weld::decided;
use glam::{DVec3, Vec3};
use std::borrow::Cow;
use std::collections::{BinaryHeap, HashMap};

/// A directed edge by the classes of its ends: in how many faces it is, and one of them.
type Edges = HashMap<[u32; 2], (u32, usize)>;

/// True if a face has three corners in different places, no area, and a file does not decide that it stays.
pub(super) fn is_flat(stored: &Stored, classes: &[u32], f: &StoredFace) -> bool {
    is_degenerate(stored, classes, f.corners) && !f.corners.iter().all(|&v| decided(stored, v))
}

/// True if corners in different places have no area between them.
fn is_degenerate(stored: &Stored, classes: &[u32], corners: [u32; 3]) -> bool {
    let [a, b, c] = corners.map(|v| classes[v as usize]);
    let [p, q, r] = corners.map(|v| stored.positions[v as usize]);
    a != b && b != c && c != a && (q - p).cross(r - p) == DVec3::ZERO
}

/// The surface with its flat faces flipped away where exactly one face lies beyond their longest edge; how many were. `classes` are
/// equal for stored vertices in one place.
///
/// The longest edge goes first. Where flat faces meet at it, it is the longest of both, and flipping it leaves shorter ones: so
/// this ends, and not before every edge that can be flipped lies between faces with an area.
pub(super) fn flip_flat<'a>(stored: &'a Stored, classes: &[u32]) -> (Cow<'a, Stored>, usize) {
    let mut flat: Vec<usize> = (0..stored.faces.len()).filter(|&f| is_flat(stored, classes, &stored.faces[f])).collect();
    if flat.is_empty() {
        return (Cow::Borrowed(stored), 0);
    }
    let mut flips = Flips::new(stored, classes);
    let mut queue: BinaryHeap<(u64, usize)> = flat.iter().map(|&f| (flips.longest(f), f)).collect();
    let (mut refused, mut progress) = (Vec::new(), false);
    loop {
        if queue.is_empty() && std::mem::take(&mut progress) {
            queue.extend(refused.drain(..)); // flips have made way for others
        }
        let Some((length, f)) = queue.pop() else { break };
        if length != flips.longest(f) || !is_flat(&flips.stored, classes, &flips.stored.faces[f]) {
            continue; // it was changed from its other side
        }
        match flips.flip(f) {
            Some(g) => {
                queue.extend([f, g].map(|f| (flips.longest(f), f)));
                progress = true;
            }
            None => refused.push((length, f)),
        }
    }
    let before = flat.len();
    flat.retain(|&f| is_flat(&flips.stored, classes, &flips.stored.faces[f]));
    let flipped = before - flat.len();
    if flipped == 0 {
        return (Cow::Borrowed(stored), 0);
    }
    (Cow::Owned(flips.stored), flipped)
}

struct Flips<'a> {
    stored: Stored,
    classes: &'a [u32],
    edges: Edges,
}

impl<'a> Flips<'a> {
    fn new(stored: &Stored, classes: &'a [u32]) -> Self {
        let mut flips = Self { stored: stored.clone(), classes, edges: HashMap::with_capacity(3 * stored.faces.len()) };
        for (f, face) in stored.faces.iter().enumerate() {
            for k in 0..3 {
                flips.add(face.corners[k], face.corners[(k + 1) % 3], f);
            }
        }
        flips
    }

    fn key(&self, a: u32, b: u32) -> [u32; 2] {
        [a, b].map(|v| self.classes[v as usize])
    }

    fn add(&mut self, a: u32, b: u32, f: usize) {
        let entry = self.edges.entry(self.key(a, b)).or_default();
        *entry = (entry.0 + 1, f);
    }

    fn remove(&mut self, a: u32, b: u32) {
        if let Some(entry) = self.edges.get_mut(&self.key(a, b)) {
            entry.0 -= 1;
        }
    }

    /// The only face with this directed edge.
    fn only(&self, a: u32, b: u32) -> Option<usize> {
        self.edges.get(&self.key(a, b)).filter(|e| e.0 == 1).map(|e| e.1)
    }

    /// The corner opposite to a face's longest edge, and that edge's squared length.
    fn middle(&self, f: usize) -> (usize, f64) {
        let at = self.stored.faces[f].corners.map(|v| self.stored.positions[v as usize]);
        let lengths = [0, 1, 2].map(|k| at[(k + 1) % 3].distance_squared(at[(k + 2) % 3]));
        let middle = (1..3).fold(0, |best, k| if lengths[k] > lengths[best] { k } else { best });
        (middle, lengths[middle])
    }

    /// Orders faces by their longest edge.
    fn longest(&self, f: usize) -> u64 {
        self.middle(f).1.to_bits() // of numbers that are not negative
    }

    /// Flips the longest edge of a flat face, and tells the face beyond. `None` if there is not exactly one, or nothing is gained.
    fn flip(&mut self, f: usize) -> Option<usize> {
        let face = self.stored.faces[f];
        let middle = self.middle(f).0;
        let [a, b, c] = [2, 0, 1].map(|k| (middle + k) % 3);
        let [va, vb, vc] = [a, b, c].map(|k| face.corners[k]);
        if self.only(vc, va) != Some(f) {
            return None;
        }
        let g = self.only(va, vc).filter(|&g| g != f)?;
        let beyond = self.stored.faces[g];
        let ga = (0..3).find(|&k| self.key(beyond.corners[k], beyond.corners[(k + 1) % 3]) == self.key(va, vc))?;
        let [gc, gd] = [(ga + 1) % 3, (ga + 2) % 3];
        let [wa, wc, wd] = [ga, gc, gd].map(|k| beyond.corners[k]);
        if self.key(vb, wd)[0] == self.key(vb, wd)[1] {
            return None;
        }
        let has_area = |corners| !is_degenerate(&self.stored, self.classes, corners);
        if has_area(beyond.corners) && !(has_area([wa, vb, wd]) && has_area([vb, wc, wd])) {
            return None; // rounding
        }
        let dress = self.dress_between(&face, [a, b, c], &beyond, [ga, gc]);
        let [da, dc, dd] = [ga, gc, gd].map(|k| beyond.dresses[k]);
        let material = beyond.material;
        self.stored.faces[f] = StoredFace { corners: [wa, vb, wd], dresses: [da, dress, dd], material };
        self.stored.faces[g] = StoredFace { corners: [vb, wc, wd], dresses: [dress, dc, dd], material };
        for (from, to) in [(vc, va), (va, vc), (vb, vc), (wd, wa)] {
            self.remove(from, to);
        }
        for (from, to, of) in [(vb, wc, g), (wd, wa, f), (vb, wd, f), (wd, vb, g)] {
            self.add(from, to, of);
        }
        Some(g)
    }

    /// What the middle corner of a flat face wears in the face beyond: its own dress where both faces wear the same at the ends
    /// of their edge, else what lies between the ends.
    fn dress_between(&mut self, flat: &StoredFace, [a, b, c]: [usize; 3], beyond: &StoredFace, [ga, gc]: [usize; 2]) -> u32 {
        if flat.dresses[a] == beyond.dresses[ga] && flat.dresses[c] == beyond.dresses[gc] {
            return flat.dresses[b];
        }
        let [p, q, r] = [a, b, c].map(|k| self.stored.positions[flat.corners[k] as usize]);
        let share = (q.distance(p) / r.distance(p)).clamp(0.0, 1.0) as f32;
        let [from, to] = [ga, gc].map(|k| self.stored.dresses[beyond.dresses[k] as usize]);
        self.stored.dresses.push(between(&from, &to, share));
        self.stored.dresses.len() as u32 - 1
    }
}

fn between(from: &Dress, to: &Dress, share: f32) -> Dress {
    let mix = |a: f32, b: f32| a + share * (b - a);
    let normal = from.normal.zip(to.normal).and_then(|(a, b)| {
        let mixed = Vec3::from(a).lerp(Vec3::from(b), share).try_normalize()?;
        Some(mixed.to_array())
    });
    let [a, b] = [from.colour, to.colour].map(u32::to_le_bytes);
    let colour = std::array::from_fn(|k| mix(f32::from(a[k]), f32::from(b[k])).round() as u8);
    Dress { uv: [mix(from.uv[0], to.uv[0]), mix(from.uv[1], to.uv[1])], normal, colour: u32::from_le_bytes(colour) }
}

#[cfg(test)]
mod tests {
    use crate::formats::{Format, Model, load_bytes};
    use crate::geometry::measure::measure;
    use crate::particles::random::draw;
    use glam::DVec3;
    use std::fmt::Write;

    /// A cube whose faces have been divided at edges' middles, each time on one side only: flat faces fill the gaps.
    fn divided(seed: u64, rounds: u64) -> (Vec<[i32; 3]>, Vec<[usize; 3]>) {
        let mut points: Vec<[i32; 3]> = (0..8).map(|k| [k & 1, k >> 1 & 1, k >> 2 & 1].map(|x| 1024 * x)).collect();
        let mut faces = vec![[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]];
        faces.extend([[2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]]);
        for round in 0..rounds {
            let h = draw(seed, round) as usize % (3 * faces.len());
            let face = faces[h / 3];
            let [a, c, d] = [0, 1, 2].map(|k| face[(h + k) % 3]);
            let sum = [0, 1, 2].map(|k| points[a][k] + points[c][k]);
            let middle = sum.map(|x| x / 2);
            if sum.iter().any(|x| x % 2 != 0) || points.contains(&middle) {
                continue;
            }
            let b = points.len();
            points.push(middle);
            faces[h / 3] = [a, b, d];
            faces.extend([[b, c, d], [a, c, b]]);
        }
        (points, faces)
    }

    fn is_flat(points: &[[i32; 3]], face: &[usize; 3]) -> bool {
        let [p, q, r] = face.map(|v| DVec3::from(points[v].map(f64::from)));
        (q - p).cross(r - p) == DVec3::ZERO
    }

    fn load(points: &[[i32; 3]], faces: &[[usize; 3]], format: Format) -> Model {
        let mut text = String::from("solid\n");
        for p in points.iter().filter(|_| format == Format::Obj) {
            writeln!(text, "v {} {} {}\nvt {} {}", p[0], p[1], p[2], p[0] as f64 / 1024.0, p[1] as f64 / 1024.0).unwrap();
        }
        for f in faces {
            match format {
                Format::Obj => {
                    let [a, b, c] = f.map(|v| v + 1);
                    writeln!(text, "f {a}/{a} {b}/{b} {c}/{c}").unwrap();
                }
                _ => {
                    let [p, q, r] = f.map(|v| points[v].map(|x| x.to_string()).join(" "));
                    writeln!(text, "facet normal 0 0 0\nouter loop\nvertex {p}\nvertex {q}\nvertex {r}\nendloop\nendfacet")
                        .unwrap();
                }
            }
        }
        let text = if format == Format::Obj { text.replacen("solid\n", "", 1) } else { text + "endsolid\n" };
        load_bytes(text.as_bytes(), format, "cube", None).unwrap()
    }

    #[test]
    fn flat_faces_that_close_a_model_are_flipped_and_not_dropped() {
        let (mut divided_flat, mut opened) = (0, 0);
        for seed in 0..300 {
            let (points, faces) = divided(seed, 1 + seed / 8);
            let flat = faces.iter().filter(|f| is_flat(&points, f)).count();
            divided_flat += flat;
            for format in [Format::Obj, Format::Stl] {
                let model = load(&points, &faces, format);
                let (found, at) = (&model.mesh, |v: crate::geometry::VertexId| model.rows.rest(v));
                let measured = measure(found, at);
                assert!(measured.closed(), "seed {seed}: {flat} flat faces");
                assert_eq!(model.report.degenerate_faces, flat);
                assert_eq!(found.face_count(), faces.len(), "seed {seed}");
                assert!((measured.volume - 1024f64.powi(3)).abs() < 1e-6 * measured.volume);
                assert!((measured.area - 6.0 * 1024f64.powi(2)).abs() < 1e-6 * measured.area);
                let area = |f| {
                    let [p, q, r] = found.face(f).map(at);
                    (q - p).cross(r - p).length()
                };
                assert!(found.live_faces().all(|f| area(f) > 0.0), "seed {seed}");
            }
            // Texture coordinates are still where their places are.
            let model = load(&points, &faces, Format::Obj);
            for w in model.mesh.live_faces().flat_map(|f| model.mesh.face_wedges(f)) {
                let wedge = model.mesh.wedge(w);
                let place = (model.rows.rest(wedge.vertex) + model.offset) / 1024.0;
                assert!((f64::from(wedge.uv[0]) - place.x).abs() < 1e-6 && (1.0 - f64::from(wedge.uv[1]) - place.y).abs() < 1e-6);
            }
            // Without the flat faces the model is open, but where all of them lie back to back.
            let kept: Vec<_> = faces.iter().copied().filter(|f| !is_flat(&points, f)).collect();
            let model = load(&points, &kept, Format::Obj);
            opened += usize::from(flat > 0 && !measure(&model.mesh, |v| model.rows.rest(v)).closed());
        }
        assert!(divided_flat > 1000 && opened > 200, "{divided_flat} flat faces, {opened} models opened without them");
    }

    #[test]
    fn flat_faces_that_close_nothing_are_dropped() {
        let (points, mut faces) = divided(0, 0);
        let mut points = points;
        points.push([512, 0, 0]);
        faces.push([0, 1, 8]);
        let model = load(&points, &faces, Format::Obj);
        assert_eq!((model.report.degenerate_faces, model.mesh.face_count()), (1, 12));
        assert!(measure(&model.mesh, |v| model.rows.rest(v)).closed() && model.report.warnings.is_empty());
    }
}
