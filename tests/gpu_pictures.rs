//! Golden pictures of plain models (see gpu_support/golden.rs for how they are compared), and what may differ from them.
#![cfg(feature = "gpu")]

mod gpu_support;

use glam::{DAffine3, DVec3};
use gpu_support::golden::{TOLERANCE, compare, difference, load};
use gpu_support::{Model, bar, bend, context, sphere};
use incise::geometry::FaceId;
use incise::gpu::{Camera, DrawOptions, LineSegment, MaterialView, Renderer, Scenery, TextureView, TissueDirty};

const SIZE: (u32, u32) = (160, 120);

fn camera(renderer: &Renderer, direction: DVec3) -> Camera {
    Camera::framing(renderer.bounds(), direction, DVec3::Y, 0.7, f64::from(SIZE.0) / f64::from(SIZE.1))
}

fn picture(models: &[&Model], direction: DVec3, options: &DrawOptions<'_>) -> Vec<u8> {
    let mut renderer = Renderer::new(context());
    for (key, model) in models.iter().enumerate() {
        renderer.sync(key as u64, &model.view(), &TissueDirty::Full).expect("sync");
    }
    let camera = camera(&renderer, direction);
    renderer.render_to_image(&camera, SIZE, options).expect("a picture")
}

/// The bar, bent, with a slit along its top.
fn wounded_bar() -> Model {
    let mut model = bar(10);
    model.pose = bend(0.7);
    let in_slit = |model: &Model, f: FaceId| {
        let p = model.mesh.face(f).map(|v| model.rows.rest(v)).iter().sum::<DVec3>() / 3.0;
        p.x.abs() < 0.2 && p.y > 0.03 && p.z.abs() < 0.02
    };
    let removed: Vec<_> = model.mesh.live_faces().filter(|&f| in_slit(&model, f)).collect();
    assert!(!removed.is_empty());
    model.mesh.replace_faces(&removed, &[], |_| 0, &mut Default::default());
    model
}

#[test]
fn a_sphere_of_flesh() {
    compare("sphere", SIZE, &picture(&[&sphere(16, 1.0)], DVec3::new(0.2, 0.4, 1.0), &DrawOptions::default()));
}

#[test]
fn an_open_wound_shows_its_inside() {
    compare("wound", SIZE, &picture(&[&wounded_bar()], DVec3::new(0.2, 1.0, 0.8), &DrawOptions::default()));
}

#[test]
fn the_wrong_picture_fails() {
    let other = picture(&[&sphere(16, 1.0)], DVec3::new(0.2, 0.4, 1.0), &DrawOptions::default());
    assert!(difference(&other, &load("wound")) > 3.0 * TOLERANCE);
    assert!(difference(&other, &[]) > TOLERANCE, "a golden picture that is missing must fail");
    // Even a change as small as a highlight that has gone: the same sphere, dry.
    let mut dry = sphere(16, 1.0);
    dry.materials = vec![MaterialView { wetness: 0.0, ..MaterialView::FLESH }];
    let dry = picture(&[&dry], DVec3::new(0.2, 0.4, 1.0), &DrawOptions::default());
    assert!(difference(&dry, &load("sphere")) > TOLERANCE, "{}", difference(&dry, &load("sphere")));
}

#[test]
fn a_picture_that_fails_is_written_out() {
    if std::env::var_os("INCISE_BLESS").is_some() {
        return; // it would become the golden one
    }
    let wrong = picture(&[&sphere(8, 1.0)], DVec3::new(0.2, 0.4, 1.0), &DrawOptions::default());
    let failed = std::panic::catch_unwind(|| compare("wound", SIZE, &wrong)).expect_err("another model");
    let text = failed.downcast_ref::<String>().expect("a sentence");
    let path = text.split_once("see ").and_then(|(_, rest)| rest.split_once(" and ")).expect("a path").0;
    let written = image::open(path).expect("the failing picture").to_rgba8().into_raw();
    assert_eq!(written, wrong);
}

#[test]
fn several_tissues_textures_and_lines() {
    const TEXELS: [u8; 16] = [230, 200, 60, 255, 40, 90, 160, 255, 40, 90, 160, 255, 230, 200, 60, 255];
    let mut left = sphere(12, 0.5);
    left.world_from_tissue = DAffine3::from_translation(DVec3::new(-0.6, 0.0, 0.0));
    let uv = |w: &incise::geometry::Wedge| [w.normal[0] * 2.0, w.normal[1] * 2.0];
    let wedges = left.mesh.wedges().iter().map(|w| incise::geometry::Wedge { uv: uv(w), ..*w }).collect();
    let (faces, face_wedges) = (left.mesh.faces().to_vec(), left.mesh.all_face_wedges().to_vec());
    left.mesh = incise::geometry::Mesh::build(left.rows.len(), faces.clone(), face_wedges, &vec![0; faces.len()], wedges);
    let texture = Some(TextureView { width: 2, height: 2, rgba: &TEXELS });
    left.materials = vec![MaterialView { base_colour: [1.0; 4], texture, ..MaterialView::FLESH }];
    let mut right = sphere(12, 0.5);
    right.world_from_tissue = DAffine3::from_translation(DVec3::new(0.6, 0.0, 0.0));
    let lines: Vec<_> = (0..12)
        .map(|k| {
            let a = f64::from(k) * std::f64::consts::TAU / 12.0;
            let p = DVec3::new(0.6 + 0.55 * a.cos(), 0.55 * a.sin(), 0.1);
            if k % 2 == 0 {
                LineSegment::point(p, [1.0, 0.8, 0.1, 1.0], 6.0)
            } else {
                LineSegment::new(DVec3::new(0.6, 0.0, 0.55), p, [0.1, 0.9, 1.0, 1.0])
            }
        })
        .collect();
    let options = DrawOptions { lines: &lines, ..Default::default() };
    compare("several", SIZE, &picture(&[&left, &right], DVec3::new(0.0, 0.3, 1.0), &options));
    let without = picture(&[&left, &right], DVec3::new(0.0, 0.3, 1.0), &DrawOptions::default());
    assert!(difference(&without, &load("several")) > TOLERANCE, "lines must show");
}

#[test]
fn scenery_can_be_left_out() {
    let model = sphere(8, 1.0);
    let bare = Scenery { tray: false, shadow: false, ..Default::default() };
    let plain = picture(&[&model], DVec3::Z, &DrawOptions { scenery: bare, ..Default::default() });
    let full = picture(&[&model], DVec3::Z, &DrawOptions::default());
    assert!(difference(&plain, &full) > TOLERANCE);
}

#[test]
fn the_same_scene_gives_the_same_bits() {
    let model = wounded_bar();
    let draw = || picture(&[&model], DVec3::new(0.2, 1.0, 0.8), &DrawOptions::default());
    assert!(draw() == draw());
}
