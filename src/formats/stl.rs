//! STL, text and binary. A triangle soup: the assembler finds the topology (MATHS 1.6).

use super::FormatError;
use super::stored::{Dress, NO_MARK, Stored, StoredFace, check_finite};
use glam::DVec3;
use std::io::Cursor;

const HEADER: usize = 84;
const RECORD: usize = 50;

/// Reads an STL file.
pub(crate) fn read(bytes: &[u8]) -> Result<Stored, FormatError> {
    if bytes.is_empty() {
        return Err(FormatError::Empty);
    }
    let mut stored = Stored { dresses: vec![Dress::PLAIN], ..Stored::default() };
    // The length decides, not the first word: many binary files begin with "solid".
    if bytes.len() >= HEADER && bytes.len() >= HEADER + RECORD * binary_count(bytes) && !looks_like_text(bytes) {
        read_binary(bytes, &mut stored)?;
    } else if super::without_mark(bytes).trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid")) {
        read_text(bytes, &mut stored)?;
    } else if bytes.len() >= HEADER {
        let detail = format!("it announces {} triangles but holds {} bytes", binary_count(bytes), bytes.len());
        return Err(FormatError::Truncated { detail });
    } else {
        return Err(FormatError::Truncated { detail: format!("{} bytes are less than an STL header", bytes.len()) });
    }
    Ok(stored)
}

fn binary_count(bytes: &[u8]) -> usize {
    bytes[80..HEADER].iter().rev().fold(0, |n, &b| n << 8 | usize::from(b))
}

fn looks_like_text(bytes: &[u8]) -> bool {
    let exact = bytes.len() == HEADER + RECORD * binary_count(bytes);
    !exact && bytes.starts_with(b"solid") && bytes.is_ascii()
}

fn read_binary(bytes: &[u8], stored: &mut Stored) -> Result<(), FormatError> {
    let mut file = bytes.to_vec();
    file[..80].fill(0); // the reader would take a header that begins with "solid" for text
    let mut cursor = Cursor::new(file);
    let wrong = |e: std::io::Error| FormatError::Syntax { format: "STL", detail: e.to_string() };
    for triangle in stl_io::create_stl_reader(&mut cursor).map_err(wrong)? {
        let triangle = triangle.map_err(wrong)?;
        push(stored, triangle.vertices.map(|v| DVec3::from_array(v.0.map(f64::from))));
    }
    Ok(())
}

/// Reads the vertices of all loops of all solids. Normals are computed, so those of the file do not matter.
fn read_text(bytes: &[u8], stored: &mut Stored) -> Result<(), FormatError> {
    let text = super::text_of(bytes);
    let mut corners = Vec::with_capacity(3);
    let mut ended = false;
    let last = text.lines().count();
    for (number, line) in text.lines().enumerate() {
        let syntax = |detail: &str| FormatError::Syntax { format: "STL", detail: format!("line {}: {detail}", number + 1) };
        let mut words = line.split_ascii_whitespace();
        match words.next().unwrap_or("").to_ascii_lowercase().as_str() {
            "vertex" => {
                let mut next = || words.next().and_then(|w| w.parse::<f64>().ok());
                let (Some(x), Some(y), Some(z)) = (next(), next(), next()) else {
                    return Err(syntax("a vertex needs three numbers"));
                };
                let at = DVec3::new(x, y, z);
                check_finite(at).map_err(syntax)?;
                corners.push(at);
            }
            "endloop" => {
                let Ok(triangle) = <[DVec3; 3]>::try_from(std::mem::take(&mut corners)) else {
                    return Err(syntax("a facet needs exactly three vertices"));
                };
                push(stored, triangle);
            }
            "endsolid" => ended = true,
            "solid" => ended = false,
            "facet" | "outer" | "endfacet" | "" => {}
            _ if number + 1 == last => break, // cut off within a word
            _ => return Err(syntax("expected facet, outer loop, vertex, endloop, endfacet or endsolid")),
        }
    }
    if !ended || !corners.is_empty() {
        return Err(FormatError::Truncated { detail: "the closing \"endsolid\" is missing".into() });
    }
    Ok(())
}

fn push(stored: &mut Stored, triangle: [DVec3; 3]) {
    let corners = triangle.map(|p| stored.push(p, NO_MARK, &[]));
    stored.faces.push(StoredFace { corners, dresses: [0; 3], material: 0 });
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "solid\n facet normal nan nan nan\n outer loop\n vertex 0 0 0\n VERTEX 1 0 0\n vertex 0 1e0 0\n endloop\n endfacet\nendsolid\n";

    fn binary(header: &[u8], triangles: usize) -> Vec<u8> {
        let mut bytes = header.to_vec();
        bytes.resize(80, b' ');
        bytes.extend((triangles as u32).to_le_bytes());
        for t in 0..triangles {
            for x in [0.0, 0.0, 1.0, 0.0, 0.0, t as f32, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
                bytes.extend(x.to_le_bytes());
            }
            bytes.extend([0, 0]);
        }
        bytes
    }

    #[test]
    fn text_and_binary() {
        assert_eq!(read(TEXT.as_bytes()).unwrap().positions[2], DVec3::Y);
        for header in [&b"made by hand"[..], b"solid but binary", b"solid"] {
            let stored = read(&binary(header, 3)).unwrap();
            assert_eq!((stored.faces.len(), stored.positions[6].z), (3, 2.0));
        }
    }

    #[test]
    fn what_is_cut_short_says_so() {
        assert!(matches!(read(b""), Err(FormatError::Empty)));
        assert!(matches!(read(&binary(b"x", 3)[..200]), Err(FormatError::Truncated { .. })));
        assert!(matches!(read(&binary(b"x", 3)[..40]), Err(FormatError::Truncated { .. })));
        assert!(matches!(read(&TEXT.as_bytes()[..TEXT.len() - 12]), Err(FormatError::Truncated { .. })));
        let two = TEXT.replace(" VERTEX 1 0 0\n", "");
        assert!(matches!(read(two.as_bytes()), Err(FormatError::Syntax { .. })));
        let far = read(TEXT.replace("VERTEX 1 0 0", "VERTEX 1 1e300 0").as_bytes()).unwrap_err().to_string();
        assert!(far.contains("line 5") && far.contains("beyond 3.4e38"), "{far}");
        let word = TEXT.replace("1e0", "one");
        assert!(read(word.as_bytes()).unwrap_err().to_string().contains("line 6"));
    }
}
