//! Meshes of the instruments, generated: a scalpel with a No. 10 blade, tissue forceps, a sphere, a plane. Metres.

use super::types::ToolVertex;
use glam::DVec3;
use std::f64::consts::TAU;

/// What a part is made of; the shader knows it by number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Stuff {
    /// Brushed steel.
    Steel = 0,
    /// Ground steel, brighter towards its edge.
    Blade = 1,
    /// A translucent sheet with a grid.
    Sheet = 2,
    /// A smooth, translucent solid.
    Glass = 3,
}

/// Corners round a section.
const ROUND: usize = 16;

/// A cross section of a lofted body: its middle and half extents along x and z.
#[derive(Clone, Copy, Debug)]
struct Section {
    middle: DVec3,
    half: (f64, f64),
}

/// Triangles as corners, three each, in the tool's own space.
pub type Corners = Vec<ToolVertex>;

fn vertex(position: DVec3, normal: DVec3, stuff: Stuff) -> ToolVertex {
    ToolVertex { position: position.as_vec3().to_array(), stuff: stuff as u32, normal: normal.as_vec3().to_array(), opens: 0.0 }
}

/// Skins sections that follow each other along y; `square` from 2 (an ellipse) up makes them rectangles with round corners.
fn loft(sections: &[Section], square: f64, stuff: Stuff, out: &mut Corners) {
    let rim = |v: f64| v.signum() * v.abs().powf(2.0 / square);
    let at = |s: &Section, k: usize| {
        let angle = TAU * k as f64 / ROUND as f64;
        s.middle + DVec3::new(s.half.0 * rim(angle.cos()), 0.0, s.half.1 * rim(angle.sin()))
    };
    let normal = |i: usize, k: usize| {
        let (before, after) = (i.saturating_sub(1), (i + 1).min(sections.len() - 1));
        let along = at(&sections[after], k) - at(&sections[before], k);
        let round = at(&sections[i], (k + 1) % ROUND) - at(&sections[i], (k + ROUND - 1) % ROUND);
        along.cross(round).normalize_or(at(&sections[i], k) - sections[i].middle)
    };
    for i in 0..sections.len() - 1 {
        for k in 0..ROUND {
            let next = (k + 1) % ROUND;
            let corner = |i: usize, k: usize| vertex(at(&sections[i], k), normal(i, k), stuff);
            let quad = [corner(i, k), corner(i + 1, k), corner(i + 1, next), corner(i, next)];
            out.extend([quad[0], quad[1], quad[2], quad[0], quad[2], quad[3]]);
        }
    }
    for (end, up) in [(0, DVec3::NEG_Y), (sections.len() - 1, DVec3::Y)] {
        let s = &sections[end];
        for k in 0..ROUND {
            let (a, b) = (at(s, k), at(s, (k + 1) % ROUND));
            let (a, b) = if end == 0 { (a, b) } else { (b, a) };
            out.extend([s.middle, a, b].map(|p| vertex(p, up, stuff)));
        }
    }
}

/// Tip of the blade at the origin, the handle along +y, the edge towards +x: 16 cm.
pub fn scalpel(out: &mut Corners) {
    let mm = 1e-3;
    let blade: Vec<Section> = (0..=24)
        .map(|k| {
            let y = 34.0 * (f64::from(k) / 24.0).powi(2);
            // The belly of a No. 10 blade: round to 12 mm, then straight.
            let rise = 1.0 - (1.0 - (y / 12.0).min(1.0)).powi(2);
            let edge = 0.15 + 6.6 * rise.sqrt();
            Section { middle: DVec3::new(0.5 * edge, y, 0.0) * mm, half: (0.5 * edge * mm, 0.22 * mm) }
        })
        .collect();
    loft(&blade, 2.2, Stuff::Blade, out);
    let profile = [(28.0, 1.6, 0.5), (32.0, 2.6, 1.1), (38.0, 2.9, 1.5), (48.0, 3.2, 1.8), (70.0, 4.6, 2.0), (120.0, 4.8, 2.0)];
    let tail = [(150.0, 4.2, 1.8), (158.0, 3.4, 1.5), (160.0, 2.2, 1.0)];
    let handle: Vec<Section> = profile
        .iter()
        .chain(&tail)
        .map(|&(y, x, z)| Section { middle: DVec3::new(3.2, y, 0.0) * mm, half: (x * mm, z * mm) })
        .collect();
    loft(&handle, 4.0, Stuff::Steel, out);
}

/// Length of the forceps, metres.
const FORCEPS: f64 = 0.13;

/// Every tool's mesh, one after the other.
#[derive(Debug, Default)]
pub struct ToolMeshes {
    /// All corners.
    pub corners: Corners,
    /// Where each tool's lie: sheet, scalpel, forceps, sphere. The sheet is first: the shader counts its corners.
    pub ranges: [std::ops::Range<u32>; 4],
}

impl ToolMeshes {
    /// Makes them.
    pub fn new() -> Self {
        let mut corners = Corners::new();
        let ranges = [sheet, scalpel, forceps, sphere].map(|make: fn(&mut Corners)| {
            let first = corners.len() as u32;
            make(&mut corners);
            first..corners.len() as u32
        });
        Self { corners, ranges }
    }
}

/// Closed tips at the origin, jaws along x, joined 13 cm up +y. The tips open by half a metre each for every metre, the joint not
/// at all.
pub fn forceps(out: &mut Corners) {
    let mm = 1e-3;
    for side in [-1.0, 1.0] {
        let first = out.len();
        let arm: Vec<Section> = (0..=20)
            .map(|k| {
                let t = f64::from(k) / 20.0;
                let spring = 9.0 * mm * (std::f64::consts::PI * t.powf(0.8)).sin().powf(0.9);
                let x = side * (spring + (0.35 + 0.6 * t) * mm);
                let width = 0.7 + 4.4 * (1.0 - (1.0 - t).powi(2)) - 1.2 * t.powi(6);
                Section { middle: DVec3::new(x, FORCEPS * t, 0.0), half: ((0.35 + 0.45 * t) * mm, width * mm) }
            })
            .collect();
        loft(&arm, 4.0, Stuff::Steel, out);
        for corner in &mut out[first..] {
            corner.opens = (0.5 * side * (1.0 - f64::from(corner.position[1]) / FORCEPS)) as f32;
        }
    }
}

/// The plane z = 0 from -1 to 1 both ways.
pub fn sheet(out: &mut Corners) {
    let corner = |x: f64, y: f64| vertex(DVec3::new(x, y, 0.0), DVec3::Z, Stuff::Sheet);
    let quad = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    out.extend([quad[0], quad[1], quad[2], quad[0], quad[2], quad[3]]);
}

/// The unit sphere.
pub fn sphere(out: &mut Corners) {
    let at = |i: usize, k: usize| {
        let (polar, round) = (0.5 * TAU * i as f64 / 16.0, TAU * k as f64 / 32.0);
        DVec3::new(polar.sin() * round.cos(), polar.cos(), polar.sin() * round.sin())
    };
    for (i, k) in (0..16).flat_map(|i| (0..32).map(move |k| (i, k))) {
        let quad = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)].map(|p| vertex(p, p, Stuff::Glass));
        out.extend([quad[0], quad[2], quad[1], quad[0], quad[3], quad[2]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds(corners: &Corners) -> (glam::Vec3, glam::Vec3) {
        let points = corners.iter().map(|c| glam::Vec3::from_array(c.position));
        points.fold((glam::Vec3::INFINITY, glam::Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
    }

    #[test]
    fn instruments_have_the_size_of_real_ones_and_their_tips_at_the_origin() {
        let mut blade = Corners::new();
        scalpel(&mut blade);
        let (low, high) = bounds(&blade);
        assert!(low.y == 0.0 && (high.y - 0.16).abs() < 1e-6 && high.x < 0.012 && low.x > -0.005, "{low} {high}");
        let tip = blade.iter().filter(|c| c.position[1] == 0.0).map(|c| glam::Vec3::from_array(c.position).length());
        assert!(tip.fold(0.0, f32::max) < 3e-4);
        for opening in [0.0, 0.01] {
            let mut arms = Corners::new();
            forceps(&mut arms);
            arms.iter_mut().for_each(|c| c.position[0] += c.opens * opening as f32);
            let nearest = arms.iter().filter(|c| c.position[1] == 0.0).map(|c| c.position[0].abs());
            assert!((nearest.fold(f32::INFINITY, f32::min) - 0.5 * opening as f32).abs() < 1e-6);
            let joined = |x: f32| arms.iter().filter(|c| c.position[1] > 0.1299).any(|c| c.position[0] * x > 0.0);
            assert!(joined(1.0) && joined(-1.0), "both arms reach the joint");
        }
    }

    #[test]
    fn normals_are_unit_and_point_outwards() {
        let mut all = Corners::new();
        scalpel(&mut all);
        forceps(&mut all);
        sphere(&mut all);
        let (mut agree, mut count) = (0, 0);
        for triangle in all.as_chunks::<3>().0 {
            let [a, b, c] = triangle.map(|v| glam::Vec3::from_array(v.position).as_dvec3());
            let face = (b - a).cross(c - a);
            for corner in triangle {
                let n = glam::Vec3::from_array(corner.normal).as_dvec3();
                assert!((n.length() - 1.0).abs() < 1e-4, "{corner:?}");
                if face.length() > 0.0 {
                    count += 1;
                    agree += usize::from(face.dot(n) > -1e-12);
                }
            }
        }
        assert!(agree as f64 > 0.97 * f64::from(count), "{agree} of {count}");
    }
}
