//! Tears that once went wrong.

use super::*;

/// A deep tear that wanders about the middle of a ball: walls of later boxes touch those of earlier ones along whole edges.
#[test]
fn walls_that_touch_along_an_edge_have_an_edge_each() {
    let path = [
        ([0.1394, 0.1830, 0.2396], [-0.2584, -0.1094, -0.6071]),
        ([0.0836, 0.0291, 0.2984], [-0.1796, -0.0626, -0.6412]),
        ([0.0366, 0.0043, 0.3078], [-0.2103, -0.0468, -1.3460]),
        ([0.0213, -0.0079, 0.3093], [-0.0938, 0.0349, -1.3591]),
        ([-0.0028, -0.0354, 0.3076], [0.0061, 0.0766, -0.6660]),
        ([-0.0236, -0.0649, 0.3020], [0.1037, 0.2856, -1.3289]),
        ([-0.0350, -0.0985, 0.2929], [0.1534, 0.4314, -1.2827]),
        ([-0.0106, -0.1939, 0.2489], [0.1005, 0.2915, -0.5953]),
        ([-0.0565, -0.1588, 0.2590], [0.1228, 0.3448, -0.5625]),
        ([0.0927, -0.1735, 0.2696], [0.0990, 0.4044, -0.5220]),
        ([-0.0576, -0.2149, 0.2133], [0.2549, 0.9516, -0.9443]),
    ];
    let (mut scene, ..) = still_scene("sphere", 768);
    let poses = poses_of(&path.map(|(tip, base)| [tip, base]), 0.08);
    stroke(&mut scene, 0.001843, &poses);
    let (_, tissue) = scene.tissues().next().unwrap();
    assert_eq!((tissue.validate(), double_edges(tissue)), (Ok(()), 0));
    // the control: a vertex between two others twice is seen
    let mut twice: Vec<[u32; 3]> = tissue.mesh().live_faces().map(|f| tissue.mesh().face(f).map(|v| v.0)).collect();
    twice.extend_from_within(..1);
    assert!(edges_of_more_than_two(&twice) > 0);
}

/// An open tear that crosses its own lips: a corner of 1e-20 of the model's surface comes off there beside a real piece.
#[test]
fn crumbs_are_no_pieces() {
    let path = [
        ([-0.2357, 0.2832, -0.2671], [-0.7063, 0.8485, -0.8003]),
        ([-0.2239, 0.2930, -0.2661], [-0.3301, 0.4320, -0.3923]),
        ([-0.2166, 0.3047, -0.2591], [-0.3193, 0.4492, -0.3820]),
        ([-0.2153, 0.3153, -0.2480], [-0.3174, 0.4646, -0.3655]),
        ([-0.2195, 0.3230, -0.2354], [-0.6780, 0.9530, -0.7025]),
        ([-0.2304, 0.3242, -0.2236], [-0.3392, 0.4775, -0.3294]),
        ([-0.2427, 0.3199, -0.2152], [-0.7267, 0.9579, -0.6443]),
        ([-0.2553, 0.3112, -0.2124], [-0.3763, 0.4587, -0.3131]),
        ([-0.2651, 0.2998, -0.2162], [-0.7946, 0.8987, -0.6479]),
        ([-0.2756, 0.2874, -0.2214], [-0.3736, 0.4301, -0.3501]),
        ([-0.2690, 0.2767, -0.2420], [-0.7788, 0.9106, -0.6466]),
        ([-0.2635, 0.2737, -0.2523], [-0.7080, 0.8976, -0.7407]),
        ([-0.2494, 0.2817, -0.2571], [-0.7082, 0.7917, -0.8528]),
        ([-0.2292, 0.2872, -0.2695], [-0.3681, 0.4223, -0.3643]),
    ];
    let (mut scene, ..) = still_scene("sphere", 768);
    scene.set_wall(WallMode::Open);
    let before = scene.edit_hash();
    let poses = poses_of(&path.map(|(tip, base)| [tip, base]), 0.08);
    let report = stroke(&mut scene, 0.007200, &poses);
    assert_eq!((report.outcome, report.pieces.len()), (Outcome::Severed, 2));
    assert!(report.pieces.iter().all(|p| p.area > 1e-4), "{:?}", report.pieces);
    assert!(scene.tissues().all(|(_, t)| t.validate().is_ok()));
    let torn = scene.edit_hash();
    assert!(scene.undo() && scene.edit_hash() == before && scene.redo() && scene.edit_hash() == torn);
}

/// A shallow slit along the whole bar, floor and all: bent, its floor stays as far below the skin as it was cut. A floor that took its
/// bones from the floor of the box before would go with the joint of the slit's first end.
#[test]
fn the_floor_of_a_long_slit_bends_with_the_skin_above_it() {
    let (mut scene, animated) = models::scene("beam", 2400);
    assert!(animated);
    scene.set_wall(WallMode::Closed);
    let (_, tissue) = scene.tissues().next().unwrap();
    let loaded = tissue.mesh().vertex_slots();
    let (low, high) = tissue.bounds();
    let (low, high) = (low + tissue.offset(), high + tissue.offset());
    let depth = 0.3 * (high.y - low.y);
    let poses: Vec<BladePose> = (0..30)
        .map(|i| {
            let tip = DVec3::new(low.x + (high.x - low.x) * (0.05 + 0.9 * f64::from(i) / 29.0), high.y - depth, 0.0);
            BladePose { t: f64::from(i) * 0.03, tip, base: tip + DVec3::Y }
        })
        .collect();
    assert_eq!(stroke(&mut scene, 0.004, &poses).outcome, Outcome::Torn);
    let below = |scene: &Scene| -> Vec<(f64, f64)> {
        let (_, tissue) = scene.tissues().next().unwrap();
        let made = |v: &VertexId| v.index() >= loaded;
        let is_deep = |&v: &VertexId| common::is_deep(tissue.mesh(), v);
        let (floor, lips): (Vec<VertexId>, Vec<VertexId>) = tissue.mesh().live_vertices().filter(made).partition(is_deep);
        let above = |p: DVec3| lips.iter().map(|&v| tissue.position(v).distance(p)).fold(f64::INFINITY, f64::min);
        floor.iter().map(|&v| (tissue.rows().rest(v).x, above(tissue.position(v)))).collect()
    };
    let flat = below(&scene);
    assert!(flat.len() > 20, "{} corners", flat.len());
    scene.set_animation(Some(0));
    scene.pose(0.5, 0.5);
    let bent = below(&scene);
    for ((x, a), (_, b)) in flat.iter().zip(&bent) {
        assert!((0.6..1.5).contains(&(b / a)), "the floor at {x}: {a} m below the skin, bent {b}");
    }
}

/// A closed slit along a bar whose top a hand pulls up meanwhile: lips open and fold under the blade. Walls line the slit; none stands in
/// the air along the blade.
#[test]
fn no_wall_stands_in_the_air_where_the_tissue_gives() {
    let (mut scene, _) = models::scene("beam", 2400);
    scene.set_wall(WallMode::Closed);
    let (_, tissue) = scene.tissues().next().unwrap();
    let (_, high) = tissue.bounds();
    let top = high.y;
    scene.edit(EditCommand::GrabBegin { id: 1, center: DVec3::new(0.0, 0.06, 0.0), radius: 0.06 });
    let mut time = 0.0;
    let mut step = |scene: &mut Scene| {
        time += 1.0 / 30.0;
        scene.pose(time, 0.0);
        scene.step(1.0 / 30.0);
    };
    for i in 0..36 {
        let share = (f64::from(i) / 6.0).min(1.0);
        scene.edit(EditCommand::GrabMove { id: 1, by: DVec3::Y * 0.1 * share });
        step(&mut scene);
    }
    scene.edit(EditCommand::StrokeBegin { width: 0.006 });
    for i in 0..19 {
        let u = f64::from(i) / 18.0;
        let (tip, base) = (DVec3::new(0.5 * u - 0.25, -0.02, 0.01 * u), DVec3::new(0.5 * u - 0.25, 0.4, 0.01 * u));
        scene.edit(EditCommand::StrokePose(BladePose { t: u * 0.6, tip, base }));
        step(&mut scene);
    }
    let report = scene.edit(EditCommand::StrokeEnd).pop().unwrap();
    assert!(report.new_vertices > 100 && all_closed(&scene), "{} new vertices", report.new_vertices);
    for (_, tissue) in scene.tissues() {
        let highest = tissue.mesh().live_vertices().map(|v| tissue.rows().rest(v).y).fold(f64::NEG_INFINITY, f64::max);
        assert!(highest < top + 0.01, "a wall ends {} m above the skin", highest - top);
    }
}

/// A path that comes back to where it was but for the last digit: the box then lies in its own older slit, plane on plane, where walls
/// once went round corners in the air. And one whose walls join two vertices that nearly coincide twice.
#[test]
fn a_blade_that_retraces_its_slit_but_for_rounding_takes_out_no_more() {
    let cases: [(f64, [[[f64; 3]; 2]; 5]); 2] = [
        (
            0.002138707346300749,
            [
                [
                    [0.22384457139264857, 0.023450668132156172, -0.035310810473509084],
                    [0.8314338250021601, -0.12760253991626483, 0.47955835678175013],
                ],
                [
                    [0.003545260159954376, -0.044289680808521394, 0.006380485334721426],
                    [0.6111345137694659, -0.1953428888569424, 0.5212496525899807],
                ],
                [
                    [-0.13208268205010165, 0.005689697134526942, 0.03212372256863203],
                    [0.4755065715594099, -0.14536351091389407, 0.5469928898238913],
                ],
                [
                    [0.22384457139264863, 0.02345066813215618, -0.03531081047350909],
                    [0.8314338250021602, -0.12760253991626483, 0.47955835678175013],
                ],
                [
                    [0.0035452601599543767, -0.0442896808085214, 0.006380485334721428],
                    [0.6111345137694659, -0.1953428888569424, 0.5212496525899807],
                ],
            ],
        ),
        (
            0.00855090441745536,
            [
                [
                    [0.15474198661511027, -0.026172894222165108, 0.03205485317057976],
                    [-0.345793189491329, -0.6118621791522771, 0.2840561054527004],
                ],
                [
                    [-0.1786283504054721, 0.027315875908492236, -0.003650779061758393],
                    [-0.6791635265119114, -0.5583734090216198, 0.24835047322036222],
                ],
                [
                    [-0.16692872125136418, 0.02581756158576009, -0.011392667763617727],
                    [-0.6674638973578034, -0.559871723344352, 0.2406085845185029],
                ],
                [
                    [0.15474198661511024, -0.0261728942221651, 0.03205485317057975],
                    [-0.34579318949132903, -0.6118621791522771, 0.2840561054527004],
                ],
                [
                    [-0.17862835040547212, 0.027315875908492243, -0.003650779061758394],
                    [-0.6791635265119114, -0.5583734090216198, 0.24835047322036222],
                ],
            ],
        ),
    ];
    for (width, path) in cases {
        let poses = poses_of(&path, 1.0);
        let checked = check_poses("beam", 200, |_| (width, poses.clone())).unwrap();
        assert!(checked.is_some(), "the reference must have an answer");
    }
    let path = Wander {
        start: [-0.047899211048522544, -0.6887206456166627, 0.48627878232547467],
        steps: vec![
            [0.28960620544747323, 0.706233382793121, -0.859263958489275],
            [-0.8618415762583278, -0.6533441566765454, 0.4484091681586647],
            [0.6846184409621101, -0.8765224729773484, 0.6240426882783235],
            [-0.698129089952555, -0.852089419863428, 0.24357228302136175],
        ],
        up: [-0.1731145693945118, 0.8539981195501435, 0.002036697620410087],
        width: 0.04433147678012681,
    };
    check_stroke("heart", 500, &path).unwrap();
}

/// Boxes wider than the model, with walls and without: nothing is left, nothing goes wrong with nothing, and an undo brings it back.
#[test]
fn a_model_may_be_swallowed_whole() {
    for wall in [WallMode::Open, WallMode::Closed] {
        let (mut scene, positions, _) = still_scene("sphere", 768);
        let (low, high) = bounds(&positions);
        let (middle, reach) = ((low + high) / 2.0, (high - low).length());
        let through = [-1.0, -0.2, 0.2, 1.0].map(|u| {
            let tip = middle + DVec3::new(u, -1.0, 0.0) * reach;
            BladePose { t: u + 1.0, tip, base: tip + DVec3::Y * 2.0 * reach }
        });
        let before = scene.edit_hash();
        scene.set_wall(wall);
        let report = stroke(&mut scene, 2.0 * reach, &through);
        assert_eq!((report.outcome, report.faces, report.pieces.len()), (Outcome::Torn, 0, 0), "{wall:?}");
        let again = stroke(&mut scene, 2.0 * reach, &through);
        assert_eq!((again.outcome, again.pieces.len()), (Outcome::Missed, 0));
        scene.pose(0.1, 0.1);
        scene.step(0.02);
        assert_eq!(scene.validate(), Ok(()));
        scene.edit(EditCommand::Undo);
        assert_eq!(scene.edit_hash(), before);
        let restored = scene.edit(EditCommand::Redo).pop().unwrap();
        assert_eq!((restored.faces, restored.pieces.len()), (0, 0));
    }
}

/// Poses of one after another `[tip, base]`, so many seconds apart.
fn poses_of(path: &[[[f64; 3]; 2]], apart: f64) -> Vec<BladePose> {
    let pose =
        |(i, [tip, base]): (i32, &[[f64; 3]; 2])| BladePose { t: apart * f64::from(i), tip: (*tip).into(), base: (*base).into() };
    (0..).zip(path).map(pose).collect()
}

/// Long blades that turn about in a cube of 12 faces: boxes lie wholly in voids that films of rounding run through. A look that took the
/// side of a film that it met first for the solid had a wound lined inside out, and too much was taken out.
#[test]
fn a_box_in_a_void_with_films_takes_nothing_out() {
    let corners = (0..8).map(|k| [k >> 2, k >> 1 & 1, k & 1].map(|bit| f64::from(bit) - 0.5));
    let mut text: String = corners.map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    text += "f 2 4 1\nf 5 2 1\nf 1 4 3\nf 3 5 1\nf 2 8 4\nf 6 2 5\nf 6 8 2\nf 4 8 3\nf 7 5 3\nf 3 8 7\nf 7 6 5\nf 8 6 7\n";
    let path = [
        [
            [-0.3040875169854105, -0.1398940334290775, -0.021483871270080307],
            [0.3451123778366868, 0.02448275496685302, 1.6521695407706416],
        ],
        [
            [-0.23747276793585598, -0.6493193668679281, 0.04824856118104666],
            [0.4310394980639547, 0.20666153607143212, -0.7173329671817276],
        ],
        [
            [0.29432168283991594, -0.10212191958281416, 0.03828651715481175],
            [-1.9823560273313723, 0.5921740070266649, 0.09126606041278018],
        ],
        [
            [-0.5565079879270728, -0.0448774700245089, -1.3051194393689383],
            [1.0052465769770227, -0.32246917403387926, 0.33948626970110174],
        ],
        [
            [0.1302708338629874, -0.07652993186454043, 0.14357903815500758],
            [-0.6692647780204402, 0.30187860217720863, 0.36257060456042034],
        ],
    ];
    let poses = |_| (0.018558368244692067, poses_of(&path, 0.8333333333333333));
    let torn = check_solid("cube", still(model_of_obj(&text)), poses).unwrap();
    assert!(torn.is_some(), "the reference must have an answer");
}

/// An icosahedron, 0.2 m across.
fn icosahedron() -> Model {
    const FACES: &str = "f 1 12 6\nf 1 6 2\nf 1 2 8\nf 1 8 11\nf 1 11 12\nf 2 6 10\nf 6 12 5\nf 12 11 3\nf 11 8 7\nf 8 2 9\n\
        f 4 10 5\nf 4 5 3\nf 4 3 7\nf 4 7 9\nf 4 9 10\nf 5 10 6\nf 3 5 12\nf 7 3 11\nf 9 7 8\nf 10 9 2\n";
    const CORNERS: &str = "v -0.0525741987 0.085065797 0\nv 0.0525741987 0.085065797 0\nv -0.0525741987 -0.085065797 0\n\
        v 0.0525741987 -0.085065797 0\nv 0 -0.0525722988 0.085065797\nv 0 0.0525722988 0.085065797\n\
        v 0 -0.0525722988 -0.085065797\nv 0 0.0525722988 -0.085065797\nv 0.0850638971 0 -0.0525722988\n\
        v 0.0850638971 0 0.0525722988\nv -0.0850638971 0 -0.0525722988\nv -0.0850638971 0 0.0525722988\n";
    model_of_obj(&format!("{CORNERS}{FACES}"))
}

/// A short, wide blade that turns about a point below the skin: its boxes lie over one another, each a little on, and cut the lips of all
/// those before them. The lips are thinned, as walls are: without that there were 73,000 faces, most of them dust on one face of the model.
#[test]
fn lips_cut_again_and_again_stay_bounded() {
    let axis = DVec3::new(-0.483, 0.328, 0.812).normalize();
    let along = DVec3::new(0.577, -0.577, 0.578).reject_from_normalized(axis).normalize();
    let pose = |i: i32| {
        let (sin, cos) = (1.55 * f64::from(i) / 13.0).sin_cos();
        let way = along * cos + axis.cross(along) * sin;
        let about = DVec3::new(0.044, -0.0277, 0.066) + 0.00024 * axis * (f64::from(i) - 6.5);
        BladePose { t: 0.4 * f64::from(i), tip: about - 0.0162 * way, base: about + 0.0014 * way }
    };
    let torn = check_solid("icosahedron", still(icosahedron()), |_| (0.05, (0..14).map(pose).collect())).unwrap();
    let [faces, _] = torn.expect("the reference must have an answer");
    assert!(faces < 30_000, "{faces} faces");
}

/// Hair-wide slits along the planes of symmetry of an icosahedron, over one another: films between their walls, and vertices in which more
/// than one edge is double.
#[test]
fn hairs_along_planes_of_symmetry_take_out_their_union() {
    let (x, low, high) = (0.08506389707326889, 0.05257229879498482, 0.08411567807197429);
    let path = [
        [[x, 0.0, high], [x, 0.0, -low]],
        [[x, 0.0, -high], [x, 0.0, low]],
        [[-1.6 * x, 0.0, high], [x, 0.0, -low]],
        [[-1.6 * x, 0.0, -high], [x, 0.0, low]],
    ];
    let poses = |_| (5.414828353825306e-05, poses_of(&path, 0.3333333333333333));
    let torn = check_solid("icosahedron", still(icosahedron()), poses).unwrap();
    assert!(torn.is_some(), "the reference must have an answer");
}

/// A blade that goes round the tip of a cone in a ball, `beyond` it or short of it, in shares of the ball's diagonal.
fn cone([radius, depth, beyond, width]: [f64; 4], (low, high): (DVec3, DVec3)) -> (f64, Vec<BladePose>) {
    let size = high.z - low.z;
    let skin = DVec3::new((low.x + high.x) / 2.0, (low.y + high.y) / 2.0, high.z);
    let apex = skin - depth * size * DVec3::Z;
    let pose = |k: i32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 63.0).sin_cos();
        let way = (skin + radius * size * DVec3::new(cos, sin, 0.0) - apex).normalize();
        BladePose { t: 0.022 * f64::from(k), tip: apex - beyond * size * way, base: apex + 0.7 * size * way }
    };
    (width * size, (0..=63).map(pose).collect())
}

/// Boxes that go on from one another, with those of the other side of the tip between them, take out no more and no less than their
/// union, and leave no film where one has cut the end of another.
#[test]
fn a_cone_comes_off() {
    for shape in [
        [0.1, 0.12, 0.02, 0.006],
        [0.15, 0.2, 0.02, 0.006],
        [0.15, 0.2, 0.0, 0.01],
        [0.1, 0.3, 0.1, 0.004],
        [0.2, 0.15, 0.05, 0.02],
    ] {
        let torn = check_poses("sphere", 768, |bounds| cone(shape, bounds));
        let torn = torn.unwrap_or_else(|e| panic!("{shape:?}: {e}"));
        assert!(torn.is_some_and(|[_, pieces]| pieces > 1), "{shape:?}: {torn:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn cones_out_of_a_sphere(
        radius in 0.05f64..0.3,
        depth in 0.05f64..0.5,
        beyond in prop_oneof![Just(0.0), 0.0f64..0.1],
        width in 0.002f64..0.03,
    ) {
        check_poses("sphere", 768, |bounds| cone([radius, depth, beyond, width], bounds))?;
    }
}

/// A block cut free all around inside a solid has no face of the skin it was cut from: walls alone. It comes off all the same. (Of such
/// blocks the largest stayed, counted with the body.)
#[test]
fn what_has_walls_alone_comes_off_as_well() {
    let (mut scene, _) = models::scene_of("sphere", 4_800, false);
    scene.set_wall(WallMode::Closed);
    let tissue = scene.tissues().next().unwrap().1;
    let radius = tissue.diagonal() / 12.0f64.sqrt();
    // four upright slots around the block, then one over it, which frees the lid, and one under it
    let upright = |at: f64, along_x: bool| {
        let place = |s: f64, z: f64| if along_x { DVec3::new(s, at, z) } else { DVec3::new(at, s, z) };
        [-1.5, 1.5].map(|s| [place(s, -0.3), place(s, 1.5)])
    };
    let level = |z: f64| [-1.5, 1.5].map(|s| [DVec3::new(-0.4, s, z), DVec3::new(1.5, s, z)]);
    let strokes = [upright(-0.3, true), upright(0.3, true), upright(-0.3, false), upright(0.3, false), level(0.4), level(-0.1)];
    let mut outcomes = Vec::new();
    for [from, to] in strokes {
        scene.edit(EditCommand::StrokeBegin { width: 0.02 * radius });
        for i in 0..=20 {
            let t = f64::from(i) / 20.0;
            let [tip, base] = [0, 1].map(|k| radius * from[k].lerp(to[k], t));
            scene.edit(EditCommand::StrokePose(BladePose { t, tip, base }));
        }
        outcomes.extend(scene.edit(EditCommand::StrokeEnd).iter().map(|r| r.outcome));
    }
    assert_eq!(outcomes.last(), Some(&Outcome::Severed), "{outcomes:?}");
    let of_walls_alone = |tissue: &Tissue| tissue.mesh().live_faces().all(|f| tissue.mesh().is_interior(f));
    assert_eq!(scene.tissues().filter(|(_, tissue)| of_walls_alone(tissue)).count(), 1);
    for (id, tissue) in scene.tissues() {
        assert_eq!((tissue.component_faces().len(), tissue.validate()), (1, Ok(())), "{id:?}");
    }
}

/// Planes of boxes that nearly fall together meet in points that the nearest f32 cannot tell apart.
#[test]
fn no_edge_of_a_wall_joins_two_vertices_in_one_place() {
    for i in 100..140 {
        let (mut scene, ..) = still_scene(["heart", "sphere", "beam"][i % 3], 3000);
        let (_, tissue) = scene.tissues().next().unwrap();
        let (low, high) = tissue.bounds();
        let (centre, size) = (tissue.offset() + (low + high) / 2.0, high - low);
        let along = DVec3::new((i as f64).cos(), 0.0, (i as f64).sin());
        let (across, height) = (along.cross(DVec3::Y), 0.4 - 0.01 * (i % 37) as f64);
        let (count, reach) = (12 + i % 17, 0.05 + 0.01 * (i % 43) as f64);
        let pose = |k: usize| {
            let t = k as f64 / (count - 1) as f64;
            let lean = (DVec3::Y + 0.5 * (t - 0.5) * along).normalize();
            let way = along * (t - 0.5) + across * 0.2 * (std::f64::consts::TAU * t).sin();
            let tip = centre + way * size.x * reach + DVec3::Y * size.y * (height + 0.04 * (91.0 * t * t + i as f64).sin());
            BladePose { t, tip, base: tip + lean * size.length() }
        };
        let poses: Vec<BladePose> = (0..count).map(pose).collect();
        let report = stroke(&mut scene, size.length() * 1e-4 * 1.08f64.powi((i % 61) as i32), &poses);
        assert_eq!(report.outcome, Outcome::Torn);
        assert!(report.pieces.iter().all(|p| p.closed && p.degenerate_faces == 0), "stroke {i}: {:?}", report.pieces);
    }
}
