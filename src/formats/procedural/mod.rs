//! Procedural models, written as .glb so that they take the same way in as any file. Closed, 2-manifold, outward.

mod beam;
mod cube_sphere;
mod heart;
mod sphere;

use super::FormatError;
use super::glb_writer::{self, GlbScene};

/// Names that [`generate`] and [`super::load`] know.
pub const NAMES: [&str; 3] = ["beam", "heart", "sphere"];

/// A procedural model as .glb. `faces` is a wish: the nearest count that the construction allows is made. The bytes depend
/// on the arguments alone.
pub fn generate(name: &str, faces: Option<usize>) -> Result<Vec<u8>, FormatError> {
    const MOST: usize = 20_000_000;
    if let Some(count) = faces.filter(|&f| f > MOST) {
        return Err(FormatError::TooLarge { what: "faces to generate", count: count as u64, limit: MOST as u64 });
    }
    let scene: GlbScene<'static> = match name {
        "beam" => beam::scene(faces),
        "heart" => heart::scene(faces),
        "sphere" => sphere::scene(faces),
        _ => return Err(FormatError::UnknownGenerator { name: name.into(), known: NAMES.join(", ") }),
    };
    glb_writer::write(&scene)
}

/// The bundled bytes of a name: what [`generate`] makes without a wish.
pub(super) fn bundled(name: &str) -> Option<&'static [u8]> {
    match name {
        "beam" => Some(include_bytes!("../../../assets/models/beam.glb")),
        "heart" => Some(include_bytes!("../../../assets/models/heart.glb")),
        "sphere" => Some(include_bytes!("../../../assets/models/sphere.glb")),
        _ => None,
    }
}

/// 0 below `from`, 1 above `to`, smooth between.
fn smoothstep(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The four largest weights, normalised, as JOINTS_0 and WEIGHTS_0 rows.
fn four_bones(weights: &[f64]) -> ([u16; 4], [f32; 4]) {
    let mut order: Vec<usize> = (0..weights.len()).collect();
    order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]));
    let kept = order.iter().take(4).map(|&j| weights[j]);
    let sum: f64 = kept.sum();
    let slot = |k: usize| order.get(k).filter(|&&j| weights[j] > 0.0);
    (
        std::array::from_fn(|k| slot(k).map_or(0, |&j| j as u16)),
        std::array::from_fn(|k| slot(k).map_or(0.0, |&j| (weights[j] / sum) as f32)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::{Model, inspect, load};
    use crate::geometry::Components;
    use crate::geometry::measure::{measure, measure_components};

    fn model(name: &str, faces: Option<usize>) -> Model {
        let bytes = generate(name, faces).unwrap();
        crate::formats::gltf_import::read(&bytes, name, None).unwrap()
    }

    /// Writes the bundled files: `cargo test -- --ignored write_bundled`.
    #[test]
    #[ignore = "writes assets/models"]
    fn write_bundled() {
        for name in NAMES {
            let path = format!("{}/assets/models/{name}.glb", env!("CARGO_MANIFEST_DIR"));
            std::fs::write(path, generate(name, None).unwrap()).unwrap();
        }
    }

    #[test]
    fn the_bundled_files_are_what_the_generator_makes() {
        for name in NAMES {
            assert!(generate(name, None).unwrap() == bundled(name).unwrap(), "{name}: run write_bundled");
        }
        assert!(generate("sphere", Some(48)).unwrap() != bundled("sphere").unwrap());
    }

    #[test]
    fn the_sphere_has_the_papers_counts() {
        let sphere = load("sphere").unwrap();
        let found = inspect(&sphere, &sphere.rig.rest_pose());
        assert_eq!((found.vertices_stored, found.vertices_welded, found.faces), (515, 386, 768));
        assert!(found.closed && found.components == 1 && found.joints == 0);
        assert!(found.volume > 0.5 && found.volume < std::f64::consts::PI / 6.0);
    }

    #[test]
    fn all_are_closed_outward_and_keep_to_the_wish() {
        for name in NAMES {
            for faces in [None, Some(1), Some(200), Some(5_000), Some(30_000)] {
                let model = model(name, faces);
                let found = inspect(&model, &model.rig.rest_pose());
                assert!(found.closed && found.volume > 0.0, "{name} {faces:?}: {found:?}");
                assert_eq!((found.degenerate_faces, found.duplicate_faces, found.warnings.len()), (0, 0, 0));
                if let Some(wish) = faces.filter(|&f| f >= 5_000) {
                    let off = (found.faces as f64 / wish as f64 - 1.0).abs();
                    assert!(off < 0.08, "{name}: {} instead of {wish}", found.faces);
                }
            }
        }
    }

    #[test]
    fn the_beam_bends_at_two_joints() {
        let beam = load("beam").unwrap();
        let found = inspect(&beam, &beam.rig.rest_pose());
        assert_eq!((found.joints, found.skins, found.animations[0].name.as_str()), (3, 1, "bend"));
        assert!((found.volume - 0.6 * 0.12 * 0.12).abs() < 1e-8 && (found.animations[0].duration - 2.0).abs() < 1e-6);
        let end = |time: f64| {
            let pose = beam.rig.pose_at(Some(0), time);
            let last = beam.mesh.live_vertices().max_by(|&a, &b| beam.rows.rest(a).x.total_cmp(&beam.rows.rest(b).x)).unwrap();
            pose.skin(&beam.rows, last)
        };
        assert!((end(0.0) - end(2.0)).length() < 1e-6, "it loops");
        assert!((end(0.5) - end(0.0)).length() > 0.2, "it bends");
    }

    #[test]
    fn the_heart_has_a_cavity_and_beats() {
        let heart = load("heart").unwrap();
        let rest = heart.rig.rest_pose();
        let found = inspect(&heart, &rest);
        assert_eq!((found.components, found.animations[0].name.as_str()), (2, "beat"));
        assert!(found.faces.abs_diff(18_000) < 900 && (found.bounds.max[1] - found.bounds.min[1] - 0.12).abs() < 2e-4);
        let parts = measure_components(&heart.mesh, &Components::find(&heart.mesh), |v| rest.skin(&heart.rows, v));
        assert!(parts[0].volume > 0.0 && parts[1].volume < 0.0, "the cavity faces inward");
        assert!(parts[0].min.cmplt(parts[1].min).all() && parts[0].max.cmpgt(parts[1].max).all());
        let volume = |time: f64| {
            let pose = heart.rig.pose_at(Some(0), time);
            measure(&heart.mesh, |v| pose.skin(&heart.rows, v)).volume
        };
        assert!((volume(0.0) - volume(0.9)).abs() < 1e-9 && volume(0.35) < 0.95 * volume(0.0));
    }

    #[test]
    fn unknown_names_and_absurd_wishes_are_refused() {
        assert!(generate("liver", None).unwrap_err().to_string().contains("beam, heart, sphere"));
        assert!(matches!(generate("beam", Some(usize::MAX)), Err(FormatError::TooLarge { .. })));
    }
}
