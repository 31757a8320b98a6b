//! Golden pictures: small, from a software adapter, compared with a tolerance. `INCISE_BLESS=1` writes new ones; look at them
//! before you keep them. A picture that fails is written to the target folder.

use super::write_png;

/// Mean difference of a channel, in 8-bit steps. Drivers round differently; another picture differs by far more.
pub const TOLERANCE: f64 = 1.0;

pub fn difference(a: &[u8], b: &[u8]) -> f64 {
    if a.len() != b.len() {
        return f64::INFINITY;
    }
    a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64
}

/// Most of the pixels that may be visibly off: walls of a small wound are more.
pub const MOST_OFF: f64 = 0.003;

/// Share of the pixels that are off by more than 24 steps in some colour.
pub fn share_off(a: &[u8], b: &[u8]) -> f64 {
    let ((a, _), (b, _)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    if a.len() != b.len() || a.is_empty() {
        return 1.0;
    }
    let is_off = |(a, b): &(&[u8; 4], &[u8; 4])| (0..3).any(|k| a[k].abs_diff(b[k]) > 24);
    a.iter().zip(b).filter(is_off).count() as f64 / a.len() as f64
}

fn golden_path(name: &str) -> std::path::PathBuf {
    std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(format!("{name}.png"))
}

/// Pixels of a golden picture; none if it is missing.
pub fn load(name: &str) -> Vec<u8> {
    image::open(golden_path(name)).map(|i| i.to_rgba8().into_raw()).unwrap_or_default()
}

pub fn compare(name: &str, size: (u32, u32), rgba: &[u8]) {
    if std::env::var_os("INCISE_BLESS").is_some() {
        image::save_buffer(golden_path(name), rgba, size.0, size.1, image::ExtendedColorType::Rgba8).expect("writable");
    }
    let golden = load(name);
    let (found, share) = (difference(rgba, &golden), share_off(rgba, &golden));
    if found > TOLERANCE || share > MOST_OFF {
        let path = write_png(&format!("failed-{name}"), size, rgba);
        let share = 100.0 * share;
        panic!(
            "{name} differs by {found:.2} steps a channel, {share:.2} % of it visibly; see {} and tests/golden",
            path.display()
        );
    }
}
