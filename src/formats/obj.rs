//! OBJ. The indices of `v` are the topology, so faces of several groups, objects and materials stay joined; texture
//! coordinates and normals dress the corners.

use super::FormatError;
use super::material::Material;
use super::mtl;
use super::polygon::PolygonCutter;
use super::stored::{Dress, NO_MARK, Stored, StoredFace, WHITE, check_finite};
use glam::DVec3;
use std::collections::HashMap;
use std::path::Path;

/// A comment in the OBJ files that we write: their indices decide the topology (MATHS 1.6).
pub(crate) const TOPOLOGY_COMMENT: &str = "# incise: indices are the topology";

/// What [`read`] finds.
pub(crate) struct ObjFile {
    pub stored: Stored,
    pub materials: Vec<Material>,
    pub warnings: Vec<String>,
}

/// Reads an OBJ file; material libraries and textures are looked up in `folder`.
pub(crate) fn read(bytes: &[u8], folder: Option<&Path>) -> Result<ObjFile, FormatError> {
    if bytes.trim_ascii().is_empty() {
        return Err(FormatError::Empty);
    }
    let text = super::text_of(bytes);
    let mut reader = Reader { folder, materials: vec![Material::default()], ..Reader::default() };
    reader.stored.indices_decide = text.lines().take(8).any(|line| line.trim_end() == TOPOLOGY_COMMENT);
    let mut continued = String::new();
    for (number, line) in text.lines().enumerate() {
        reader.line_number = number + 1;
        if let Some(start) = line.trim_end().strip_suffix('\\') {
            continued.push_str(start);
            continued.push(' ');
        } else if continued.is_empty() {
            reader.line(line)?;
        } else {
            continued.push_str(line);
            reader.line(&std::mem::take(&mut continued))?;
        }
    }
    reader.finish()
}

#[derive(Default)]
struct Reader<'a> {
    folder: Option<&'a Path>,
    line_number: usize,
    stored: Stored,
    colours: Vec<u32>,
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    /// Dress by (texture coordinate, normal, colour); looked up only.
    dress_ids: HashMap<[u32; 3], u32>,
    materials: Vec<Material>,
    material: u32,
    unknown_materials: Vec<String>,
    skipped: usize,
    polygon: Vec<[u32; 2]>,
    cutter: PolygonCutter,
    warnings: Vec<String>,
}

impl Reader<'_> {
    fn syntax(&self, detail: &str) -> FormatError {
        FormatError::Syntax { format: "OBJ", detail: format!("line {}: {detail}", self.line_number) }
    }

    fn line(&mut self, line: &str) -> Result<(), FormatError> {
        let line = line.split('#').next().unwrap_or("").trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        match keyword {
            "v" => self.vertex(rest),
            "vt" => {
                let [u, v, ..] = self.numbers::<2>(rest, 1)?;
                self.uvs.push([u as f32, 1.0 - v as f32]); // OBJ counts v upward
                Ok(())
            }
            "vn" => {
                let normal = DVec3::from_array(self.numbers::<3>(rest, 3)?).normalize_or(DVec3::Z);
                self.normals.push(normal.as_vec3().to_array());
                Ok(())
            }
            "f" => self.face(rest),
            "usemtl" => {
                self.use_material(rest.trim());
                Ok(())
            }
            "mtllib" => {
                self.load_libraries(rest.trim());
                Ok(())
            }
            "l" | "p" | "curv" | "surf" => {
                self.skipped += 1;
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Up to `N` numbers, at least `least`.
    fn numbers<const N: usize>(&self, rest: &str, least: usize) -> Result<[f64; N], FormatError> {
        let mut out = [0.0; N];
        let mut count = 0;
        for (slot, word) in out.iter_mut().zip(rest.split_ascii_whitespace()) {
            *slot = word.parse().map_err(|_| self.syntax(&format!("\"{word}\" is not a number")))?;
            count += 1;
        }
        if count < least { Err(self.syntax(&format!("expected {least} numbers"))) } else { Ok(out) }
    }

    fn vertex(&mut self, rest: &str) -> Result<(), FormatError> {
        let [x, y, z, r, g, b] = self.numbers::<6>(rest, 3)?;
        let at = DVec3::new(x, y, z);
        check_finite(at).map_err(|detail| self.syntax(detail))?;
        let coloured = rest.split_ascii_whitespace().count() >= 6;
        let byte = |c: f64| (c.clamp(0.0, 1.0) * 255.0).round() as u32;
        self.colours.push(if coloured { byte(r) | byte(g) << 8 | byte(b) << 16 | 0xff << 24 } else { WHITE });
        if self.stored.positions.len() as u64 >= u64::from(u32::MAX) {
            return Err(self.syntax("too many vertices"));
        }
        self.stored.push(at, NO_MARK, &[]);
        Ok(())
    }

    fn face(&mut self, rest: &str) -> Result<(), FormatError> {
        let mut polygon = std::mem::take(&mut self.polygon);
        polygon.clear();
        for word in rest.split_ascii_whitespace() {
            polygon.push(self.corner(word)?);
        }
        if polygon.len() < 3 {
            self.skipped += 1;
        }
        for triangle in self.cutter.cut(polygon.iter().map(|c| self.stored.positions[c[0] as usize])) {
            let triangle = triangle.map(|k| polygon[k as usize]);
            self.stored.faces.push(StoredFace {
                corners: triangle.map(|c| c[0]),
                dresses: triangle.map(|c| c[1]),
                material: self.material,
            });
        }
        self.polygon = polygon;
        Ok(())
    }

    /// Stored vertex and dress of `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&mut self, word: &str) -> Result<[u32; 2], FormatError> {
        let mut parts = word.split('/');
        let v = self.index(parts.next().unwrap_or(""), self.stored.positions.len(), "vertex")?;
        let mut optional = |count, what| match parts.next() {
            None | Some("") => Ok(u32::MAX),
            Some(part) => self.index(part, count, what),
        };
        let uv = optional(self.uvs.len(), "texture coordinate")?;
        let normal = optional(self.normals.len(), "normal")?;
        let colour = self.colours[v as usize];
        let dress = Dress {
            uv: self.uvs.get(uv as usize).copied().unwrap_or_default(),
            normal: self.normals.get(normal as usize).copied(),
            colour,
        };
        let next = self.stored.dresses.len() as u32;
        let id = *self.dress_ids.entry([uv, normal, colour]).or_insert(next);
        if id == next {
            self.stored.dresses.push(dress);
        }
        Ok([v, id])
    }

    /// From 1, or from -1 backwards.
    fn index(&self, part: &str, count: usize, target: &'static str) -> Result<u32, FormatError> {
        let number: i64 = part.parse().map_err(|_| self.syntax(&format!("\"{part}\" is not an index")))?;
        let index = if number < 0 { count as i64 + number } else { number - 1 };
        if index < 0 || index as u64 >= count as u64 {
            let what = format!("the face in line {}", self.line_number);
            return Err(FormatError::range(what, target, number.unsigned_abs(), count));
        }
        Ok(index as u32)
    }

    fn use_material(&mut self, name: &str) {
        match self.materials.iter().position(|m| m.name == name) {
            Some(index) => self.material = index as u32,
            None => {
                self.material = self.materials.len() as u32;
                self.materials.push(Material::named(name));
                self.unknown_materials.push(name.into());
            }
        }
    }

    /// Reads what follows `mtllib`: a name, which may hold blanks, or, if there is no such file, a list of names.
    fn load_libraries(&mut self, names: &str) {
        let Some(folder) = self.folder else { return };
        let open = |name| super::read_named(&folder.join(name));
        let found = match open(names) {
            Ok(bytes) => vec![(names, Ok(bytes))],
            Err(error) => {
                let list: Vec<_> = names.split_whitespace().map(|name| (name, open(name))).collect();
                // a name with blanks is not told of in pieces
                if list.iter().any(|(_, bytes)| bytes.is_ok()) { list } else { vec![(names, Err(error))] }
            }
        };
        let mut materials: Vec<Material> = Vec::new();
        for (name, bytes) in found {
            match bytes {
                Ok(bytes) => {
                    let mut more = mtl::read(&super::text_of(&bytes), folder, &mut self.warnings);
                    // the first library of a list that knows a name counts
                    more.retain(|m| !materials.iter().any(|known| known.name == m.name));
                    materials.append(&mut more);
                }
                Err(error) => self.warnings.push(format!("material library \"{name}\" is left out: {error}")),
            }
        }
        for material in materials {
            self.unknown_materials.retain(|n| *n != material.name);
            match self.materials.iter_mut().find(|m| m.name == material.name) {
                Some(known) => *known = material,
                None => self.materials.push(material),
            }
        }
    }

    fn finish(mut self) -> Result<ObjFile, FormatError> {
        if self.skipped > 0 {
            self.warnings.push(format!("{} lines, points, curves or faces with fewer than 3 corners are left out", self.skipped));
        }
        if !self.unknown_materials.is_empty() {
            self.warnings
                .push(format!("materials without a definition are drawn as flesh: {}", self.unknown_materials.join(", ")));
        }
        drop_unused_materials(&mut self.stored.faces, &mut self.materials);
        Ok(ObjFile { stored: self.stored, materials: self.materials, warnings: self.warnings })
    }
}

/// Keeps the materials that faces use, in order; at least one.
pub(crate) fn drop_unused_materials(faces: &mut [StoredFace], materials: &mut Vec<Material>) {
    let mut used = vec![false; materials.len()];
    for face in faces.iter() {
        used[face.material as usize] = true;
    }
    let mut next = 0;
    let renumbered: Vec<u32> = used
        .iter()
        .map(|&u| {
            next += u32::from(u);
            next.saturating_sub(1)
        })
        .collect();
    for face in faces {
        face.material = renumbered[face.material as usize];
    }
    let mut keep = used.iter();
    materials.retain(|_| *keep.next().unwrap_or(&false));
    if materials.is_empty() {
        materials.push(Material::default());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUAD: &str = "v 0 0 0\nv 1 0 0 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0.25\nvn 0 0 2\n";

    fn of(faces: &str) -> Result<ObjFile, FormatError> {
        read(format!("{QUAD}{faces}").as_bytes(), None)
    }

    #[test]
    fn every_kind_of_corner() {
        let file = of("usemtl a\nf 1/1/1 2/2/1 -2//1 \\\n 4\nl 1 2\n").unwrap();
        let stored = &file.stored;
        assert_eq!(stored.faces.iter().map(|f| f.corners).collect::<Vec<_>>(), [[0, 1, 2], [0, 2, 3]]);
        let dress = |f: usize, k: usize| stored.dresses[stored.faces[f].dresses[k] as usize];
        assert_eq!(dress(0, 1).uv, [1.0, 0.75], "v counts downward inside");
        assert_eq!((dress(0, 1).colour, dress(0, 0).colour), (0xff00_00ff, WHITE));
        assert_eq!((dress(0, 2).normal, dress(1, 2).normal), (Some([0.0, 0.0, 1.0]), None));
        assert_eq!((file.materials.len(), file.warnings.len()), (1, 2));
    }

    #[test]
    fn wrong_indices_and_numbers_name_the_line() {
        for (faces, line) in
            [("f 1 2 9\n", "line 8"), ("f 1 2 0\n", "line 8"), ("f 1 2 -5\n", "line 8"), ("f 1/3 2 3\n", "line 8")]
        {
            let error = of(faces).err().unwrap();
            assert!(matches!(error, FormatError::IndexOutOfRange { .. }) && error.to_string().contains(line), "{error}");
        }
        assert!(matches!(of("v 1 x 3\n"), Err(FormatError::Syntax { .. })));
        assert!(matches!(of("f a b c\n"), Err(FormatError::Syntax { .. })));
        assert!(matches!(read(b" \n", None), Err(FormatError::Empty)));
        assert!(of("f 1 2 3\n").is_ok());
    }

    const L_PRISM: &str = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\n\
        v 0 0 1\nv 2 0 1\nv 2 1 1\nv 1 1 1\nv 1 2 1\nv 0 2 1\n\
        f 1 2 8 7\nf 2 3 9 8\nf 3 4 10 9\nf 4 5 11 10\nf 5 6 12 11\nf 6 1 7 12\n";

    #[test]
    fn an_l_prism_is_closed_and_has_its_area_from_whichever_corner() {
        for start in 0..6 {
            let mut top: Vec<u32> = (7..13).collect();
            let mut bottom: Vec<u32> = (1..7).rev().collect();
            top.rotate_left(start);
            bottom.rotate_left(start);
            let words = |face: &[u32]| face.iter().map(|v| format!(" {v}")).collect::<String>();
            let file = read(format!("{L_PRISM}f{}\nf{}\n", words(&top), words(&bottom)).as_bytes(), None).unwrap();
            let stored = &file.stored;
            assert_eq!(stored.faces.len(), 20);
            let (mut area, mut volume, mut edges) = (0.0, 0.0, HashMap::new());
            for face in &stored.faces {
                let [a, b, c] = face.corners.map(|v| stored.positions[v as usize]);
                area += (b - a).cross(c - a).length() / 2.0;
                volume += a.dot(b.cross(c)) / 6.0;
                for k in 0..3 {
                    *edges.entry([face.corners[k], face.corners[(k + 1) % 3]]).or_insert(0) += 1;
                }
            }
            assert!((area - 14.0_f64).abs() < 1e-12 && (volume - 3.0_f64).abs() < 1e-12, "{start}: {area}, {volume}");
            assert!(edges.iter().all(|(&[a, b], &count)| count == 1 && edges.contains_key(&[b, a])), "{start}");
        }
    }

    #[test]
    fn corners_of_a_concave_polygon_keep_their_dress() {
        let text = "v 0 0 0\nv 2 -1 0\nv 0.5 0 0\nv 2 1 0\nvt 0.1 0\nvt 0.2 0\nvt 0.3 0\nvt 0.4 0\nf 2/2 3/3 4/4 1/1\n";
        let stored = read(text.as_bytes(), None).unwrap().stored;
        assert_eq!(stored.faces.iter().map(|f| f.corners).collect::<Vec<_>>(), [[2, 3, 0], [2, 0, 1]]);
        for face in &stored.faces {
            for k in 0..3 {
                assert_eq!(stored.dresses[face.dresses[k] as usize].uv[0], [0.1, 0.2, 0.3, 0.4][face.corners[k] as usize]);
            }
        }
    }

    #[test]
    fn a_library_may_have_blanks_or_be_a_list() {
        let folder = std::env::temp_dir().join(format!("incise-obj-libraries-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        for (name, text) in [
            ("a.mtl", "newmtl a\nKd 0.25 0 0\n"),
            ("b.mtl", "newmtl a\nKd 0.5 0 0\nnewmtl b\nKd 0.75 0 0\n"),
            ("a b.mtl", "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 0\n"),
        ] {
            std::fs::write(folder.join(name), text).unwrap();
        }
        let reds = |libraries: &str| {
            let text = format!("{QUAD}mtllib {libraries}\nusemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n");
            let file = read(text.as_bytes(), Some(&folder)).unwrap();
            (file.materials.iter().map(|m| m.base_colour[0]).collect::<Vec<_>>(), file.warnings)
        };
        assert_eq!(reds("a.mtl  b.mtl"), (vec![0.25, 0.75], vec![]), "the first that knows a name counts");
        assert_eq!(reds("a b.mtl"), (vec![1.0, 0.0], vec![]));
        let (found, warnings) = reds("none.mtl b.mtl");
        assert_eq!((found, warnings.len()), (vec![0.5, 0.75], 1));
        assert!(warnings[0].contains("\"none.mtl\""), "{warnings:?}");
        let (_, warnings) = reds("no such.mtl");
        assert!(warnings.len() == 2 && warnings[0].contains("\"no such.mtl\""), "{warnings:?}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
