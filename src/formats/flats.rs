//! Faces without an area that close a surface: a T-junction's filling, as mesh boolean tools and CAD exports leave them.
//!
//! Dropping such a face would open the model. The edge across its middle corner is flipped instead: the face beyond it is divided
//! at that corner. The surface stays where it is, closed as before, and every face has an area.

use super::stored::{Dress, Stored, StoredFace};
use super::weld::decided;
use glam::{DVec3, Vec3};
use std::borrow::Cow;
use std::collections::BinaryHeap;

/// No half-edge.
const NONE: u32 = u32::MAX;
/// Flips that a flat face may take on average.
const STEPS_A_FACE: usize = 64;

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

/// The surface with its flat faces flipped away; how many were. `classes` are equal for stored vertices in one place.
///
/// The flat face with the longest edge goes first. Beyond that edge lies a face with an area, which is divided; or nothing, and then the
/// flat face closes nothing and goes; or a flat face whose longest edge it is too. Those two are one on the other, and go both, or the
/// edge between them is flipped, which leaves shorter ones. So this ends.
pub(super) fn flip_flat<'a>(stored: &'a Stored, classes: &[u32]) -> (Cow<'a, Stored>, usize) {
    let flat: Vec<usize> = (0..stored.faces.len()).filter(|&f| is_flat(stored, classes, &stored.faces[f])).collect();
    if flat.is_empty() {
        return (Cow::Borrowed(stored), 0);
    }
    let mut flips = Flips::new(stored, classes);
    let mut queue: BinaryHeap<(u64, usize)> = flat.iter().map(|&f| (flips.longest(f), f)).collect();
    // against edges of no length between vertices that a file tells apart
    let mut left = STEPS_A_FACE * flat.len();
    while let Some((length, f)) = queue.pop().filter(|_| left > 0) {
        left -= 1;
        let stands = !flips.gone[f] && length == flips.longest(f) && is_flat(&flips.stored, classes, &flips.stored.faces[f]);
        if let Some(g) = stands.then(|| flips.settle(f)).flatten() {
            queue.extend([f, g].map(|f| (flips.longest(f), f)));
        }
    }
    let Flips { mut stored, gone, .. } = flips;
    let mut index = 0;
    stored.faces.retain(|_| {
        index += 1;
        !gone[index - 1]
    });
    let stay = stored.faces.iter().filter(|f| is_flat(&stored, classes, f)).count();
    (Cow::Owned(stored), flat.len() - stay)
}

/// The ends of an edge in order, and whether a half-edge runs from the first.
type EdgeKey = (u32, u32, bool);

/// A surface under flips.
struct Flips<'a> {
    stored: Stored,
    classes: &'a [u32],
    /// The half-edge on the other side of half-edge `3 f + k`, which leaves corner `k` of face `f`; [`NONE`] without one.
    twins: Vec<u32>,
    gone: Vec<bool>,
}

impl<'a> Flips<'a> {
    /// Pairs half-edges as the weld does: by stored vertices, then what is left by place. Where several lie in one place and flat faces
    /// are among them, any pairs will do: on a line, what has an area runs one way on one side and the other way on the other.
    fn new(stored: &Stored, classes: &'a [u32]) -> Self {
        let mut twins = vec![NONE; 3 * stored.faces.len()];
        let corner = |h: u32| stored.faces[h as usize / 3].corners[h as usize % 3];
        let repeats = |h: u32| {
            let [a, b, c] = stored.faces[h as usize / 3].corners.map(|v| classes[v as usize]);
            a == b || b == c || c == a
        };
        let of_flat = |h: &(EdgeKey, u32)| is_flat(stored, classes, &stored.faces[h.1 as usize / 3]);
        let mut pair = |name: &dyn Fn(u32) -> u32, several: bool| {
            let key = |h: u32| {
                let [a, b] = [h, h - h % 3 + (h + 1) % 3].map(|h| name(corner(h)));
                (a.min(b), a.max(b), a < b)
            };
            let alone = (0..twins.len() as u32).filter(|&h| twins[h as usize] == NONE && !repeats(h));
            let mut open: Vec<(EdgeKey, u32)> = alone.map(|h| (key(h), h)).collect();
            open.sort_unstable();
            for run in open.chunk_by(|a, b| (a.0.0, a.0.1) == (b.0.0, b.0.1)) {
                let (back, forth) = run.split_at(run.partition_point(|h| !h.0.2));
                if back.len() == forth.len() && (back.len() == 1 || several && run.iter().any(of_flat)) {
                    for (g, h) in back.iter().zip(forth) {
                        (twins[g.1 as usize], twins[h.1 as usize]) = (h.1, g.1);
                    }
                }
            }
        };
        pair(&|v| v, false);
        pair(&|v| classes[v as usize], true);
        Self { stored: stored.clone(), classes, twins, gone: vec![false; stored.faces.len()] }
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

    fn glue(&mut self, g: u32, h: u32) {
        for (of, to) in [(g, h), (h, g)] {
            if of != NONE {
                self.twins[of as usize] = to;
            }
        }
    }

    /// Flips the longest edge of a flat face, or takes the face away. Tells the face beyond if that was changed.
    fn settle(&mut self, f: usize) -> Option<usize> {
        let face = self.stored.faces[f];
        let b = self.middle(f).0;
        let [c, a] = [1, 2].map(|k| (b + k) % 3);
        let twin_of = |f: usize, k: usize| self.twins[3 * f + k];
        let (long, before, after) = (twin_of(f, c), twin_of(f, a), twin_of(f, b));
        if long == NONE {
            self.gone[f] = true;
            self.glue(before, NONE);
            self.glue(after, NONE);
            return None;
        }
        let (g, ga) = (long as usize / 3, long as usize % 3);
        let [gc, gd] = [1, 2].map(|k| (ga + k) % 3);
        let beyond = self.stored.faces[g];
        let (far, near) = (twin_of(g, gc), twin_of(g, gd));
        let [wa, wc, wd] = [ga, gc, gd].map(|k| beyond.corners[k]);
        let vb = face.corners[b];
        if self.classes[vb as usize] == self.classes[wd as usize] {
            (self.gone[f], self.gone[g]) = (true, true);
            if before as usize != 3 * g + gd {
                self.glue(before, near);
            }
            if after as usize != 3 * g + gc {
                self.glue(after, far);
            }
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
        let [f0, g0] = [3 * f as u32, 3 * g as u32];
        for (of, to) in [(f0, before), (f0 + 1, g0 + 2), (f0 + 2, near), (g0, after), (g0 + 1, far)] {
            self.twins[of as usize] = NONE;
            self.glue(of, to);
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

    /// A cube each of whose edges is divided anew on either side, now and then in the same places; what lies between is triangulated
    /// at random.
    fn filled(seed: u64) -> (Vec<[i32; 3]>, Vec<[usize; 3]>) {
        let (mut points, coarse) = divided(seed, 0);
        let (mut faces, mut flats, mut drawn) = (Vec::new(), Vec::new(), 0);
        let mut random = |below: usize| {
            drawn += 1;
            draw(seed, drawn) as usize % below
        };
        let number = |p: [i32; 3], points: &mut Vec<[i32; 3]>| {
            points.iter().position(|q| *q == p).unwrap_or_else(|| {
                points.push(p);
                points.len() - 1
            })
        };
        let mut chains = std::collections::BTreeMap::new();
        for (a, b) in coarse.iter().flat_map(|f| (0..3).map(|k| (f[k], f[(k + 1) % 3]))) {
            let most = random(8);
            let mut shares: Vec<i32> = (0..most).map(|_| 1 + random(15) as i32).collect();
            shares.sort_unstable();
            shares.dedup();
            let (p, q) = (points[a], points[b]);
            let at = |share: i32| std::array::from_fn(|k| p[k] + (q[k] - p[k]) / 16 * share);
            let chain: Vec<usize> = shares.iter().map(|&share| number(at(share), &mut points)).collect();
            chains.insert((a, b), chain);
        }
        for (&(a, b), chain) in chains.iter().filter(|(edge, _)| edge.0 < edge.1) {
            let mut polygon = vec![b];
            polygon.extend(chain.iter().rev());
            polygon.push(a);
            polygon.extend(chains[&(b, a)].iter().rev());
            while polygon.len() > 2 {
                let (k, n) = (random(polygon.len()), polygon.len());
                flats.push([polygon[(k + n - 1) % n], polygon[k], polygon[(k + 1) % n]]);
                polygon.remove(k);
            }
        }
        for face in &coarse {
            let [p, q, r] = face.map(|v| points[v]);
            let middle = number(std::array::from_fn(|k| p[k] + (q[k] - p[k]) / 4 + (r[k] - p[k]) / 4), &mut points);
            let mut rim = Vec::new();
            for k in 0..3 {
                rim.push(face[k]);
                rim.extend(&chains[&(face[k], face[(k + 1) % 3])]);
            }
            faces.extend((0..rim.len()).map(|k| [rim[k], rim[(k + 1) % rim.len()], middle]));
        }
        faces.append(&mut flats);
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
    fn flat_faces_in_any_order_close_a_model() {
        for seed in 0..200 {
            let (points, faces) = filled(seed);
            for format in [Format::Obj, Format::Stl] {
                let model = load(&points, &faces, format);
                let measured = measure(&model.mesh, |v| model.rows.rest(v));
                assert!(measured.closed() && model.report.warnings.is_empty(), "seed {seed}, {format:?}");
                assert!((measured.volume - 1024f64.powi(3)).abs() < 1e-6 * measured.volume);
                assert!((measured.area - 6.0 * 1024f64.powi(2)).abs() < 1e-6 * measured.area);
            }
        }
    }

    /// Two flat faces in a row on a border: each flip between them would make way for the flip back.
    #[test]
    fn flat_faces_on_a_border_end() {
        let points = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [0, 1, 0]];
        let model = load(&points, &[[1, 0, 4], [2, 1, 4], [3, 2, 4], [0, 1, 2], [0, 2, 3]], Format::Obj);
        assert_eq!((model.report.degenerate_faces, model.mesh.face_count()), (2, 3));
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
