//! Any number of views: stereo in one pass against two, masks, viewports, late poses, culling, targets of others.
#![cfg(feature = "gpu")]

mod gpu_support;

use glam::{DAffine3, DQuat, DVec3};
use gpu_support::{Model, bar, bend, context, plain_context, sphere, write_png};
use incise::gpu::readback::read_texture;
use incise::gpu::{
    AdapterKind, Bounds, Camera, ColourTarget, Context, DrawOptions, Fov, GpuError, Instrument, LineSegment, MOST_VIEWS, Passes,
    RenderTarget, Renderer, Scenery, TissueDirty, Tool, ViewPose, ViewSet, VisibilityMask,
};
use std::collections::BTreeSet;
use std::sync::Arc;

const SIZE: (u32, u32) = (96, 80);

/// Two eyes 64 mm apart in front of a bar of 1 m, with the asymmetric angles of a headset.
fn eyes() -> [ViewPose; 2] {
    let eye = |side: f64| ViewPose {
        position: DVec3::new(0.032 * side, 0.25, 1.1),
        rotation: DQuat::from_rotation_x(-0.2),
        fov: Fov { left: -0.6 - 0.05 * side, right: 0.6 - 0.05 * side, down: -0.5, up: 0.45 },
        near: 0.02,
    };
    [eye(-1.0), eye(1.0)]
}

fn model() -> Model {
    let mut model = bar(8);
    model.pose = bend(0.6);
    model
}

fn renderer(context: Arc<Context>) -> Renderer {
    let mut renderer = Renderer::new(context);
    renderer.sync(1, &model().view(), &TissueDirty::Full).expect("sync");
    renderer
}

fn lines() -> Vec<LineSegment> {
    let a = DVec3::new(-0.3, 0.2, 0.1);
    vec![LineSegment::new(a, -a, [1.0, 0.2, 0.1, 1.0]), LineSegment::point(a, [0.1, 1.0, 0.2, 1.0], 6.0)]
}

fn pictures(renderer: &mut Renderer, views: &[ViewPose], options: &DrawOptions<'_>) -> Vec<Vec<u8>> {
    renderer.draw_views(views, SIZE, options).expect("drawn");
    (0..views.len() as u32).map(|view| renderer.read_picture(view).expect("read")).collect()
}

fn difference(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64
}

/// What a stereo picture shows besides the model.
#[derive(Clone, Default)]
struct Dress {
    lines: Vec<LineSegment>,
    instruments: Vec<Instrument>,
    masks: Vec<VisibilityMask>,
    late: Option<[ViewPose; 2]>,
}

/// Both layers of a stereo picture, and draws; with depth kept where it is not smooth. A driver may resolve samples otherwise
/// in one pass than in two.
fn stereo(passes: Passes, smooth: bool, dress: &Dress) -> (Vec<Vec<u8>>, u64) {
    let context = context();
    let mut renderer = renderer(context.clone());
    renderer.set_visibility_masks(&dress.masks);
    // No tray: it reaches behind the eyes, and what is clipped goes astray in the software driver of Mesa 22 (see
    // `Context::prefers_views_at_once`).
    let scenery = Scenery { tray: false, ..Default::default() };
    let options = DrawOptions { passes, scenery, lines: &dress.lines, instruments: &dress.instruments, ..Default::default() };
    let colour = swapchain(&context, 2, wgpu::TextureFormat::Rgba8UnormSrgb);
    let depth = swapchain(&context, 2, wgpu::TextureFormat::Depth32Float);
    let colour_target = ColourTarget::of_texture(&colour, colour.format());
    let depth_target = ColourTarget::of_texture(&depth, depth.format());
    let depth = if smooth { None } else { Some(&depth_target) };
    let target = RenderTarget { depth, smooth, ..RenderTarget::new(&colour_target) };
    let views = ViewSet { views: &eyes(), masked: !dress.masks.is_empty() };
    encode(&mut renderer, &target, &views, &options, dress.late.as_ref().map(|late| &late[..]));
    ((0..2).map(|l| read_texture(&context, &colour, l).expect("read")).collect(), renderer.take_counters().draws)
}

/// False where there is nothing to compare; the software adapter that the suite runs on always has something.
fn draws_views_at_once(context: &Context) -> bool {
    let has = context.draws_views_at_once(2, context.samples());
    assert!(has || context.adapter_kind() != AdapterKind::Software, "the software adapter has multiview");
    if !has {
        println!("{} has no multiview; nothing to compare", context.adapter_name());
    }
    has
}

/// Fails unless both eyes' pictures agree, drawn in one pass and in two. Returns those of one pass.
fn agree(smooth: bool, dress: &Dress, draws: (u64, u64)) -> Vec<Vec<u8>> {
    let (at_once, one_pass) = stereo(Passes::AtOnce, smooth, dress);
    let (in_turn, two_passes) = stereo(Passes::Each, smooth, dress);
    assert_eq!((one_pass, two_passes), draws);
    // A pass each may have no antialiasing (see `Context::resolves_into_layers`): edges differ then, the picture does not.
    let most = if smooth { 1.5 } else { 0.02 };
    for view in 0..2 {
        let found = difference(&at_once[view], &in_turn[view]);
        println!("view {view}: {found:.4} steps a channel");
        if found > most {
            write_png(&format!("failed-at-once-{view}"), SIZE, &at_once[view]);
            write_png(&format!("failed-in-turn-{view}"), SIZE, &in_turn[view]);
            panic!("view {view}: {found} steps a channel");
        }
    }
    // The control: the eyes see different pictures, and swapping them is noticed.
    let swapped = difference(&at_once[0], &in_turn[1]);
    assert!(swapped > 2.0 * most, "{swapped}");
    at_once
}

#[test]
fn stereo_in_one_pass_equals_a_pass_each() {
    if draws_views_at_once(&context()) {
        for smooth in [false, true] {
            // The shadow is drawn once either way; the tissue, backdrop and lines once or twice.
            agree(smooth, &Dress { lines: lines(), ..Default::default() }, (1 + 3, 1 + 2 * 3));
        }
    }
}

/// Scalpel, forceps and the preview of a plane, all in sight of both eyes.
fn instruments() -> Vec<Instrument> {
    let mut forceps = Instrument::scalpel(DVec3::new(-0.2, 0.1, 0.1), DVec3::new(-0.25, 0.2, 0.15), DVec3::X, 2.0);
    forceps.tool = Tool::Forceps { opening: 0.02 };
    let scalpel = Instrument::scalpel(DVec3::new(0.2, 0.05, 0.15), DVec3::new(0.25, 0.2, 0.2), DVec3::X, 2.0);
    let sheet =
        DAffine3::from_scale_rotation_translation(DVec3::splat(0.15), DQuat::from_rotation_y(0.7), DVec3::new(0.0, 0.05, 0.1));
    vec![scalpel, forceps, Instrument { tool: Tool::Plane, world_from_tool: sheet, colour: [0.2, 0.7, 1.0, 0.4] }]
}

/// A corner of each eye's picture, another one each.
fn masks() -> Vec<VisibilityMask> {
    let triangle = |x: f32| VisibilityMask { corners: vec![[x, -0.5], [x, -0.1], [x * 0.3, -0.5]], indices: vec![0, 1, 2] };
    vec![triangle(-0.6), triangle(0.55)]
}

#[test]
fn masks_instruments_lines_and_late_poses_agree_in_one_pass_and_in_two() {
    if !draws_views_at_once(&context()) {
        return;
    }
    let late = eyes().map(|e| ViewPose { position: e.position + e.forward() * 0.1, ..e });
    let full = Dress { lines: lines(), instruments: instruments(), masks: masks(), late: Some(late) };
    // Besides the shadows of the tissue and of two solid instruments: mask, these two, tissue, backdrop, lines, and the plane.
    let draws = (3 + 7, 3 + 2 * 7);
    agree(true, &full, draws);
    let all = agree(false, &full, draws);
    // The control: each part shows in both eyes' pictures.
    for k in 0..6 {
        let mut fewer = full.clone();
        match k {
            0 => fewer.lines.clear(),
            1 => fewer.masks.clear(),
            2 => fewer.late = None,
            _ => drop(fewer.instruments.remove(k - 3)),
        }
        let without = stereo(Passes::AtOnce, false, &fewer).0;
        for view in 0..2 {
            let found = difference(&all[view], &without[view]);
            assert!(found > if k == 2 { 1.0 } else { 0.1 }, "part {k} in view {view}: {found}");
        }
    }
}

/// A mask's slanting edge over the backdrop: of four samples none to four are hidden, of one sample none or one.
#[test]
fn smooth_targets_have_four_samples_and_others_one() {
    let context = context();
    assert!(context.samples() == 4 || context.adapter_kind() != AdapterKind::Software, "the software adapter has four");
    let linear = |byte: u8| {
        let c = f64::from(byte) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    };
    // How many quarters of a pixel are seen, over all pixels.
    let quarters = |smooth: bool| -> BTreeSet<u32> {
        let mut renderer = Renderer::new(context.clone());
        let corners = vec![[-0.6, -0.5], [0.5, -0.5], [-0.6, 0.37]];
        renderer.set_visibility_masks(&[VisibilityMask { corners, indices: vec![0, 1, 2] }]);
        let texture = swapchain(&context, 1, wgpu::TextureFormat::Rgba8UnormSrgb);
        let colour = ColourTarget::of_texture(&texture, texture.format());
        let target = RenderTarget { smooth, ..RenderTarget::new(&colour) };
        let mut draw = |masked: bool| {
            let views = ViewSet { views: &eyes()[..1], masked };
            into_target(&mut renderer, &texture, &target, &views, None)
        };
        let (masked, free) = (draw(true), draw(false));
        let share = |(masked, free): (&u8, &u8)| (4.0 * linear(*masked) / linear(*free)).round() as u32;
        masked.iter().zip(&free).skip(1).step_by(4).map(share).collect()
    };
    let four = if context.samples() == 4 { vec![0, 1, 2, 3, 4] } else { vec![0, 4] };
    assert_eq!(quarters(true).into_iter().collect::<Vec<_>>(), four);
    assert_eq!(quarters(false).into_iter().collect::<Vec<_>>(), [0, 4]);
}

#[test]
fn an_adapter_without_multiview_draws_stereo_all_the_same() {
    assert!(!plain_context().draws_views_at_once(2, 1));
    // asked for or not, there it is a pass each
    assert!([Passes::Auto, Passes::AtOnce, Passes::Each].iter().all(|p| !p.at_once(&plain_context(), 2, 1)));
    let ours = context();
    let (has, samples) = (draws_views_at_once(&ours), ours.samples());
    assert!(Passes::AtOnce.at_once(&ours, 2, samples) == has && !Passes::Each.at_once(&ours, 2, samples));
    let plain = pictures(&mut renderer(plain_context()), &eyes(), &DrawOptions::default());
    let usual = pictures(&mut renderer(context()), &eyes(), &DrawOptions { passes: Passes::Each, ..Default::default() });
    // positions come from the CPU there, with other roundings
    let off = plain.iter().zip(&usual).map(|(a, b)| difference(a, b)).fold(0.0, f64::max);
    assert!(off < 0.02 && difference(&plain[0], &plain[1]) > 2.0, "{off}");
}

#[test]
fn a_view_equals_its_camera() {
    let camera = Camera { eye: DVec3::new(0.3, 0.4, 1.5), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.7 };
    let mut renderer = renderer(context());
    let by_camera = renderer.render_to_image(&camera, SIZE, &DrawOptions::default()).expect("drawn");
    let view = ViewPose::from_camera(&camera, f64::from(SIZE.0) / f64::from(SIZE.1)).expect("a view");
    assert!(pictures(&mut renderer, &[view], &DrawOptions::default())[0] == by_camera);
}

#[test]
fn many_views_are_drawn_and_more_are_refused() {
    let mut renderer = renderer(context());
    let turned = |k: usize| {
        let turn = DQuat::from_rotation_y(0.8 * k as f64);
        ViewPose { position: turn * eyes()[0].position, rotation: turn * eyes()[0].rotation, ..eyes()[0] }
    };
    let views: Vec<ViewPose> = (0..MOST_VIEWS).map(turned).collect();
    let all = pictures(&mut renderer, &views, &DrawOptions::default());
    let steps: Vec<f64> = (1..all.len()).map(|k| difference(&all[k], &all[k - 1])).collect();
    assert!(steps.iter().all(|s| *s > 0.5), "{steps:?}");
    for bad in [0, MOST_VIEWS + 1] {
        let views = vec![eyes()[0]; bad];
        let refused = renderer.draw_views(&views, SIZE, &DrawOptions::default());
        assert!(matches!(refused, Err(GpuError::BadViews { .. })), "{bad}");
    }
}

/// A texture as a window's or a headset's swapchain would hand it over.
fn swapchain(context: &Context, layers: u32, format: wgpu::TextureFormat) -> wgpu::Texture {
    context.device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: SIZE.0, height: SIZE.1, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

/// Encodes into a target, lets `late` have its say, and submits.
fn encode(
    renderer: &mut Renderer,
    target: &RenderTarget<'_>,
    views: &ViewSet<'_>,
    options: &DrawOptions<'_>,
    late: Option<&[ViewPose]>,
) {
    let context = renderer.context().clone();
    let mut encoder = context.device().create_command_encoder(&Default::default());
    renderer.encode(&mut encoder, views, target, options).expect("encoded");
    if let Some(late) = late {
        renderer.set_late_views(late).expect("late views");
    }
    context.queue().submit([encoder.finish()]);
    context.check().expect("no error");
}

/// [`encode`] with all that a picture has, and what came out in the first layer.
fn into_target(
    renderer: &mut Renderer,
    texture: &wgpu::Texture,
    target: &RenderTarget<'_>,
    views: &ViewSet<'_>,
    late: Option<&[ViewPose]>,
) -> Vec<u8> {
    encode(renderer, target, views, &DrawOptions::default(), late);
    read_texture(renderer.context(), texture, 0).expect("read")
}

#[test]
fn targets_of_others_take_the_same_picture_in_any_format() {
    let mut renderer = renderer(context());
    let context = renderer.context().clone();
    let ours = pictures(&mut renderer, &eyes()[..1], &DrawOptions::default()).remove(0);
    for format in [
        wgpu::TextureFormat::Rgba8UnormSrgb,
        wgpu::TextureFormat::Rgba8Unorm,
        wgpu::TextureFormat::Bgra8UnormSrgb,
        wgpu::TextureFormat::Bgra8Unorm,
    ] {
        let texture = swapchain(&context, 1, format);
        let target = ColourTarget::of_texture(&texture, format);
        let views = eyes();
        let mut theirs = into_target(&mut renderer, &texture, &RenderTarget::new(&target), &ViewSet::new(&views[..1]), None);
        if matches!(format, wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Bgra8UnormSrgb) {
            theirs.chunks_exact_mut(4).for_each(|p| p.swap(0, 2));
        }
        // Without an sRGB format edges are blended after the curve, not before it.
        let most = if format.is_srgb() { 0.0 } else { 1.0 };
        assert!(difference(&ours, &theirs) <= most, "{format:?}: {}", difference(&ours, &theirs));
    }
}

#[test]
fn a_depth_target_is_filled_whatever_the_samples_and_a_wrong_one_refused() {
    let mut renderer = renderer(context());
    let context = renderer.context().clone();
    let colour = swapchain(&context, 1, wgpu::TextureFormat::Rgba8UnormSrgb);
    let depth = swapchain(&context, 1, wgpu::TextureFormat::Depth32Float);
    let colour_target = ColourTarget::of_texture(&colour, colour.format());
    let depth_target = ColourTarget::of_texture(&depth, depth.format());
    let views = eyes();
    let drawn: Vec<Vec<f32>> = [false, true]
        .into_iter()
        .map(|smooth| {
            let target = RenderTarget { depth: Some(&depth_target), smooth, ..RenderTarget::new(&colour_target) };
            into_target(&mut renderer, &colour, &target, &ViewSet::new(&views[..1]), None);
            let bytes = read_texture(&context, &depth, 0).expect("depth");
            bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
        })
        .collect();
    for depths in &drawn {
        let depth_at = |x: u32, y: u32| depths[(y * SIZE.0 + x) as usize];
        // The bar is about 1.1 m away; the corner above is the backdrop, infinitely far.
        let middle = depth_at(SIZE.0 / 2, SIZE.1 / 2);
        assert!((0.02 / 1.4..0.02 / 0.9).contains(&f64::from(middle)), "{middle}");
        assert_eq!(depth_at(1, 1), 0.0);
    }
    // A sample lies beside the pixel's middle, so only edges and slopes differ.
    let close = |(a, b): &(&f32, &f32)| (**a - **b).abs() <= 0.02 * a.max(**b);
    let agree = drawn[0].iter().zip(&drawn[1]).filter(close).count();
    assert!(agree as f64 > 0.9 * drawn[0].len() as f64, "{agree} of {}", drawn[0].len());
    let target = RenderTarget { depth: Some(&depth_target), ..RenderTarget::new(&colour_target) };
    let wrong = RenderTarget { depth: Some(&colour_target), ..RenderTarget::new(&colour_target) };
    assert!(matches!(wrong.check(1), Err(GpuError::BadTarget(_))) && matches!(target.check(2), Err(GpuError::BadTarget(_))));
}

#[test]
fn a_viewport_is_the_same_picture_in_a_corner() {
    let mut renderer = renderer(context());
    let context = renderer.context().clone();
    let texture = swapchain(&context, 1, wgpu::TextureFormat::Rgba8UnormSrgb);
    let target = ColourTarget::of_texture(&texture, texture.format());
    let small = (48, 40);
    let views = eyes();
    let part = RenderTarget { viewport: Some(small), ..RenderTarget::new(&target) };
    let picture = into_target(&mut renderer, &texture, &part, &ViewSet::new(&views[..1]), None);
    let rows = |from: &[u8], width: u32| -> Vec<u8> {
        (0..small.1).flat_map(|y| from[(y * width * 4) as usize..][..(small.0 * 4) as usize].to_vec()).collect()
    };
    let mut alone = Renderer::new(context.clone());
    alone.sync(1, &model().view(), &TissueDirty::Full).expect("sync");
    alone.draw_views(&views[..1], small, &DrawOptions::default()).expect("drawn");
    assert!(difference(&rows(&picture, SIZE.0), &alone.read_picture(0).expect("read")) < 0.02);
    // Outside the viewport there is nothing.
    assert_eq!(&picture[((SIZE.0 - 1) * 4) as usize..][..3], &[0, 0, 0]);
}

#[test]
fn late_poses_take_effect_without_encoding_again() {
    let mut renderer = renderer(context());
    let context = renderer.context().clone();
    let texture = swapchain(&context, 1, wgpu::TextureFormat::Rgba8UnormSrgb);
    let target = ColourTarget::of_texture(&texture, texture.format());
    let early = eyes();
    // A movement along the line of sight leaves the headlamp where it is.
    let late = early.map(|e| ViewPose { position: e.position + e.forward() * 0.1, ..e });
    let mut draw = |first: &[ViewPose], later: Option<&[ViewPose]>| {
        into_target(&mut renderer, &texture, &RenderTarget::new(&target), &ViewSet::new(first), later)
    };
    let (wanted, old) = (draw(&late[..1], None), draw(&early[..1], None));
    let corrected = draw(&early[..1], Some(&late[..1]));
    assert!(difference(&wanted, &corrected) < 0.02, "{}", difference(&wanted, &corrected));
    assert!(difference(&wanted, &old) > 1.0, "the poses must differ visibly");
    assert!(draw(&early[..1], None) == old, "a late pose lasts one submission");
}

#[test]
fn masked_pixels_are_black_and_the_others_as_without() {
    let square = |view: usize| {
        // The lower left quarter of the left view, the lower right one of the right.
        let (x0, x1) = if view == 0 { (-2.0, 0.0) } else { (0.0, 2.0) };
        VisibilityMask {
            corners: vec![[x0, -2.0], [x1, -2.0], [x1, 0.0], [x0, 0.0], [f32::NAN, 0.0]],
            indices: vec![0, 1, 2, 0, 2, 3, 0, 1, 4, 0, 1, 99, 7],
        }
    };
    for context in [context(), plain_context()] {
        let mut renderer = renderer(context);
        let free = pictures(&mut renderer, &eyes(), &DrawOptions::default());
        renderer.set_visibility_masks(&[square(0), square(1)]);
        let unused = pictures(&mut renderer, &eyes(), &DrawOptions::default());
        assert!(free == unused, "masks are used where they are asked for");
        let masked = pictures(&mut renderer, &eyes(), &DrawOptions { masked: true, ..Default::default() });
        for (view, x) in [(0, 4), (1, SIZE.0 - 4)] {
            let pixel = |p: &[u8], x: u32, y: u32| p[((y * SIZE.0 + x) * 4) as usize..][..3].to_vec();
            assert_eq!(pixel(&masked[view], x, SIZE.1 - 4), [0, 0, 0], "view {view}");
            assert_ne!(pixel(&free[view], x, SIZE.1 - 4), [0, 0, 0]);
            let other = SIZE.0 - x;
            assert_eq!(pixel(&masked[view], other, SIZE.1 - 4), pixel(&free[view], other, SIZE.1 - 4));
            assert_eq!(pixel(&masked[view], x, 4), pixel(&free[view], x, 4));
        }
        renderer.set_visibility_masks(&[]);
        assert!(pictures(&mut renderer, &eyes(), &DrawOptions { masked: true, ..Default::default() }) == free);
    }
}

#[test]
fn tissues_out_of_sight_are_not_drawn() {
    let mut renderer = renderer(context());
    // Another tissue far away in the arena (past the gap that one draw spans), behind the eyes.
    let mut filler = sphere(24, 0.1);
    filler.world_from_tissue = glam::DAffine3::from_translation(DVec3::new(0.0, 0.0, 9.0));
    renderer.sync(2, &filler.view(), &TissueDirty::Full).expect("sync");
    let mut behind = sphere(6, 0.1);
    behind.world_from_tissue = glam::DAffine3::from_translation(DVec3::new(0.0, 0.0, 9.5));
    renderer.sync(3, &behind.view(), &TissueDirty::Full).expect("sync");
    renderer.take_counters();
    let seen = pictures(&mut renderer, &eyes()[..1], &DrawOptions::default());
    assert_eq!(renderer.take_counters().culled, 2);
    // Turned round, the bar is the one out of sight.
    let back = ViewPose { rotation: DQuat::from_rotation_y(std::f64::consts::PI), ..eyes()[0] };
    let turned = pictures(&mut renderer, &[back], &DrawOptions::default());
    assert_eq!(renderer.take_counters().culled, 1);
    assert!(difference(&seen[0], &turned[0]) > 1.0);
    // With a view each way, none is.
    pictures(&mut renderer, &[eyes()[0], back], &DrawOptions::default());
    assert_eq!(renderer.take_counters().culled, 0);
    assert!(!renderer.bounds().is_empty() && eyes()[0].may_see(&Bounds { min: DVec3::splat(-0.1), max: DVec3::splat(0.1) }));
}

/// With a second view that sees the whole bar nothing is left out, so the first view's picture is what it must be.
#[test]
fn the_part_of_a_large_model_that_no_view_sees_is_not_drawn() {
    let near = ViewPose { position: DVec3::new(-0.45, 0.05, 0.35), ..eyes()[0] };
    let pull = [(DVec3::new(0.42, 0.0, 0.0), DVec3::new(-0.8, 0.1, 0.0))];
    let mut pulled = bar(24).with_particles(&pull, 0.2);
    pulled.pose = bend(0.2);
    let mut still = bar(24);
    still.pose = bend(0.2);
    let mut painted = Vec::new();
    for (name, model) in [("still", still), ("pulled", pulled)] {
        let mut renderer = Renderer::new(context());
        renderer.sync(1, &model.view(), &TissueDirty::Full).expect("sync");
        let options = DrawOptions { passes: Passes::Each, ..Default::default() };
        renderer.take_counters();
        let alone = pictures(&mut renderer, &[near, near], &options);
        let counters = renderer.take_counters();
        let faces = model.mesh.face_slots() as u64;
        assert_eq!(counters.culled, 0);
        if name == "still" {
            assert!((faces / 8..faces).contains(&counters.faces_culled), "{} of {faces}", counters.faces_culled);
        }
        let both = pictures(&mut renderer, &[near, eyes()[0]], &options);
        assert_eq!(renderer.take_counters().faces_culled, 0, "{name}");
        assert!(alone[0] == both[0], "{name}");
        painted.push(alone[0].clone());
    }
    assert!(difference(&painted[0], &painted[1]) > 0.5, "what is pulled into the picture from out of sight is drawn");
}

#[test]
fn passes_are_timed_where_the_adapter_can_and_only_when_asked() {
    let mut renderer = renderer(context());
    pictures(&mut renderer, &eyes(), &DrawOptions::default());
    renderer.context().wait().expect("done");
    assert!(renderer.gpu_times().is_none());
    let can = renderer.context().device().features().contains(wgpu::Features::TIMESTAMP_QUERY);
    assert_eq!(renderer.set_timing(true), can);
    if !can {
        return;
    }
    for frame in 0..12 {
        let mut model = model();
        model.pose = bend(0.1 * f64::from(frame));
        model.versions.pose = frame as u64 + 1;
        renderer.sync(1, &model.view(), &TissueDirty::clean()).expect("sync");
        pictures(&mut renderer, &eyes(), &DrawOptions { passes: Passes::Each, ..Default::default() });
    }
    renderer.context().wait().expect("done");
    let times = renderer.gpu_times().expect("times have come back");
    let names: Vec<&str> = times.passes().iter().map(|p| p.0).collect();
    assert_eq!(names, ["deform", "shadow", "views", "views"]);
    assert!(times.passes().iter().all(|p| p.1 >= 0.0) && times.total_ms() > 0.0, "{times:?}");
    renderer.set_timing(false);
}
