//! Material libraries of OBJ files: diffuse colour, opacity and diffuse texture.

use super::material::{Material, Picture, decode};
use std::path::Path;
use std::sync::Arc;

/// Reads the materials of a library; what cannot be used is left out with a warning.
pub(crate) fn read(text: &str, folder: &Path, warnings: &mut Vec<String>) -> Vec<Material> {
    let mut materials: Vec<Material> = Vec::new();
    for line in text.lines() {
        let line = line.trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        if keyword == "newmtl" {
            materials.push(Material::named(rest.trim()));
        }
        let Some(material) = materials.last_mut() else { continue };
        let numbers: Vec<f32> =
            rest.split_ascii_whitespace().map_while(|w| w.parse().ok()).filter(|x: &f32| x.is_finite()).collect();
        match (keyword, numbers.as_slice()) {
            ("Kd", &[r, g, b, ..]) => material.base_colour[..3].copy_from_slice(&[r, g, b]),
            ("d", &[opacity, ..]) => material.base_colour[3] = opacity,
            ("Tr", &[transparency, ..]) => material.base_colour[3] = 1.0 - transparency,
            ("map_Kd", _) => {
                let name = texture_name(rest);
                let bytes = super::read_named(&folder.join(name)).map_err(|e| e.to_string());
                let picture = bytes.and_then(Picture::new).and_then(|picture| decode(Arc::new(picture)));
                match picture {
                    Ok(texture) => {
                        material.texture = Some(Arc::new(texture));
                        if material.base_colour[..3] == Material::FLESH[..3] {
                            material.base_colour[..3].fill(1.0); // no colour of its own: the picture's
                        }
                    }
                    Err(error) => warnings.push(format!("texture \"{name}\" is left out: {error}")),
                }
            }
            _ => {}
        }
    }
    materials
}

/// The file name behind options such as `-s 1 1 1`; a name without options may hold blanks.
fn texture_name(rest: &str) -> &str {
    let rest = rest.trim();
    if rest.starts_with('-') { rest.rsplit(char::is_whitespace).next().unwrap_or(rest) } else { rest }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_read_and_broken_lines_are_not() {
        let text = "Kd 1 1 1\nnewmtl a b\nKd 0.5 0.25 0\nd 0.5\nnewmtl c\nKd 0.5\nmap_Kd -s 1 1 1 none.png\n";
        let mut warnings = Vec::new();
        let found = read(text, Path::new("/nonexistent-folder"), &mut warnings);
        assert_eq!((found[0].name.as_str(), found[0].base_colour), ("a b", [0.5, 0.25, 0.0, 0.5]));
        assert_eq!((found[1].base_colour, warnings.len()), (Material::FLESH, 1));
        assert!(warnings[0].contains("\"none.png\""));
    }
}
