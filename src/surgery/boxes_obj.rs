//! Boxes as Wavefront OBJ (CONTRACT, `--boxes`).

use super::boxes::{Slit, TearBox};
use glam::DVec3;
use std::io::{self, Write};

/// Writes one object per box, named `chain<k>_box<i>`: eight vertices, twelve triangles, closed and outward, 17
/// significant digits (an f64 survives). `offset` takes tissue space to the file's model space (MATHS 1.7).
pub fn write_boxes<'a>(out: &mut impl Write, boxes: impl IntoIterator<Item = &'a TearBox>, offset: DVec3) -> io::Result<()> {
    writeln!(out, "# incise tear boxes, metres")?;
    for (i, b) in boxes.into_iter().enumerate() {
        writeln!(out, "o chain{}_box{}", b.chain, b.index)?;
        for corner in b.corners() {
            let p = corner + offset;
            writeln!(out, "v {:.16e} {:.16e} {:.16e}", p.x, p.y, p.z)?;
        }
        for triangle in b.hull_triangles() {
            let [a, b, c] = triangle.map(|k| 8 * i + k as usize + 1);
            writeln!(out, "f {a} {b} {c}")?;
        }
    }
    Ok(())
}

/// Writes one object per strip of a tear of width 0, named `chain<k>_slit<i>`: four vertices and the two triangles along
/// which the surface was opened, positive side outward. They enclose nothing. Digits and `offset` as in [`write_boxes`].
pub fn write_slits<'a>(out: &mut impl Write, slits: impl IntoIterator<Item = &'a Slit>, offset: DVec3) -> io::Result<()> {
    writeln!(out, "# incise tear strips of width 0, metres")?;
    for (i, s) in slits.into_iter().enumerate() {
        writeln!(out, "o chain{}_slit{}", s.chain, s.index)?;
        for corner in s.corners {
            let p = corner + offset;
            writeln!(out, "v {:.16e} {:.16e} {:.16e}", p.x, p.y, p.z)?;
        }
        for triangle in Slit::TRIANGLES {
            let [a, b, c] = triangle.map(|k| 4 * i + k as usize + 1);
            writeln!(out, "f {a} {b} {c}")?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::{BladePose, EntryPoint, SamplingSettings, TearBox, tear_segments};
    use super::*;

    fn boxes() -> Vec<TearBox> {
        let pose = |t: f64, x: f64, z: f64| {
            let tip = DVec3::new(x, -0.1, z);
            BladePose { t, tip, base: tip + DVec3::new(0.01, 0.2, 0.1 * x) }
        };
        let poses = [pose(0.0, 0.0, 0.0), pose(0.1, 0.1, 0.0), pose(0.2, 0.0, 0.02)];
        let everywhere = |_: DVec3, _: DVec3| Some(EntryPoint { s: 0.25, rise: 0.0 });
        let sampling = SamplingSettings::default().scaled(1.0);
        tear_segments(&poses, 0.003, sampling, &everywhere).iter().filter_map(|s| s.as_box().cloned()).collect()
    }

    /// Vertices, faces (0-based) and names of an OBJ text.
    fn parse(text: &str) -> (Vec<DVec3>, Vec<[usize; 3]>, Vec<&str>) {
        let (mut v, mut f, mut o) = (Vec::new(), Vec::new(), Vec::new());
        for line in text.lines() {
            let words: Vec<_> = line.split(' ').collect();
            match words[0] {
                "v" => v.push(DVec3::from_slice(&words[1..].iter().map(|w| w.parse().unwrap()).collect::<Vec<f64>>())),
                "f" => f.push([1, 2, 3].map(|k| words[k].parse::<usize>().unwrap() - 1)),
                "o" => o.push(words[1]),
                _ => {}
            }
        }
        (v, f, o)
    }

    #[test]
    fn every_box_is_an_object_and_every_bit_survives() {
        let boxes = boxes();
        let mut text = Vec::new();
        write_boxes(&mut text, &boxes, DVec3::ZERO).unwrap();
        let text = String::from_utf8(text).unwrap();
        let (v, f, o) = parse(&text);
        assert!(boxes.len() > 5 && boxes.last().unwrap().chain > 0);
        assert_eq!((v.len(), f.len(), o.len()), (8 * boxes.len(), 12 * boxes.len(), boxes.len()));
        assert_eq!(v, boxes.iter().flat_map(TearBox::corners).collect::<Vec<_>>());
        for (b, name) in boxes.iter().zip(&o) {
            assert_eq!(**name, format!("chain{}_box{}", b.chain, b.index));
        }
        let rounded: Vec<_> = v.iter().map(|p| p.as_vec3().as_dvec3()).collect();
        assert_ne!(rounded, v, "f32 would not do");
        let volume: f64 = f.iter().map(|t| v[t[0]].dot(v[t[1]].cross(v[t[2]])) / 6.0).sum();
        let sum: f64 = boxes.iter().map(TearBox::volume).sum();
        assert!((volume - sum).abs() < 1e-12 && volume > 0.0);
    }

    #[test]
    fn other_readers_read_it() {
        let mut text = Vec::new();
        write_boxes(&mut text, &boxes(), DVec3::X).unwrap();
        let load = |_: &std::path::Path| Err(tobj::LoadError::OpenFileFailed);
        let (models, _) = tobj::load_obj_buf(&mut text.as_slice(), &tobj::LoadOptions::default(), load).unwrap();
        assert_eq!(models.len(), boxes().len());
        assert!(models.iter().all(|m| m.mesh.indices.len() == 36 && m.mesh.positions.len() == 24));
        assert_eq!(models[0].name, "chain0_box0");
    }
}
