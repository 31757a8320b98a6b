use super::*;
use crate::surgery::BladePose;

const BUNDLED: [(&str, &str); 3] = [
    ("demo.toml", include_str!("../../assets/scripts/demo.toml")),
    ("touch.toml", include_str!("../../assets/scripts/touch.toml")),
    ("beam.toml", include_str!("../../assets/scripts/beam.toml")),
];

fn load(text: &str) -> Script {
    Script::parse(text, Path::new("dir/my.toml")).unwrap_or_else(|e| panic!("{e}"))
}

fn error(text: &str) -> String {
    Script::parse(text, Path::new("dir/my.toml")).expect_err(text).to_string()
}

const FULL: &str = r#"
model = "beam"
animation = "bend"
speed = 0.5
step = 0.0111111
frames = 180
seed = 7
[camera]
eye = [0, 0.1, 0.5]
target = [0, 0, 0]
up = [0, 1, 0]
fov_y = 0.8
orbit = 0.1
[particles]
spacing = 0.01
radius = 0.02
neighbours = 0.02
frequency = 4
damping = 0.2
coupling = 1.0
[tear]
width = 0.002
wall = "closed"
gap = 0.004
opening_time = 0.6
sample_distance = 0.003
sample_time = 0.05
[[action]]
kind = "tear"
at = 0.5
poses = [ { t = 0.0, tip = [0,0,0], base = [0,0.2,0] }, { t = 1.0, tip = [0.1,0,0], base = [0.1,0.2,0] } ]
[[action]]
kind = "cut"
at = 2
plane = [0, 2, 0, 1]
cap = false
[[action]]
kind = "cut"
at = 2.5
points = [[0,0,1],[1,0,1],[0,1,1]]
[[action]]
kind = "grab"
at = 3
center = [0, 0, 0]
radius = 0.1
until = 4
moves = [ { t = 0.5, by = [0, 1, 0] } ]
[[action]]
kind = "poke"
at = 3
radius = 0.1
until = 4.5
path = [ { t = 0, at = [0, 1, 0] }, { t = 1, at = [0, 0, 0] } ]
[[action]]
kind = "squeeze"
at = 3
a = [0, 1, 0]
b = [0, -1, 0]
radius = 0.1
until = 4
[[action]]
kind = "undo"
at = 5
[[action]]
kind = "redo"
at = 5.5
[[action]]
kind = "reset"
at = 6
[[action]]
kind = "show"
at = 0.1
layer = "wireframe"
"#;

#[test]
fn a_cut_takes_a_plane_points_or_the_poses_of_a_blade() {
    let cut = |rest: &str| format!("model = \"beam\"\n[[action]]\nkind = \"cut\"\nat = 0.0\n{rest}\n");
    let parsed = |rest: &str| Script::parse(&cut(rest), Path::new("s.toml"));
    let quad = "points = [[0,0,0], [1,0,0], [1,0,1], [0,0.5,1]]";
    let script = parsed(&format!("{quad}\nbounded = true")).unwrap();
    let ActionKind::Cut { plane, cap, bounded } = &script.actions[0].kind else { panic!("a cut") };
    assert!(*cap && bounded.len() == 4 && bounded.iter().all(|p| (plane.normal.dot(*p) - plane.distance).abs() < 1e-15));
    let script = parsed("points = [[0,0,0], [1,0,0], [1,0,1]]\nbounded = false").unwrap();
    assert!(matches!(&script.actions[0].kind, ActionKind::Cut { cap: true, bounded, .. } if bounded.is_empty()));
    let poses = "poses = [{ t = 0.0, tip = [0,0,0], base = [0,1,0] }, { t = 1.0, tip = [1,0,0], base = [1,1,0] }]";
    let script = parsed(&format!("{poses}\ncap = false")).unwrap();
    assert!(matches!(&script.actions[0].kind, ActionKind::CutByBlade { cap: false, path } if path.poses().len() == 2));
    for (rest, words) in [
        (format!("{poses}\nplane = [0,1,0,0]"), "takes no `plane`"),
        (quad.to_owned(), "three or four"),
        ("plane = [0,1,0,0]\nbounded = true".to_owned(), "needs `points`"),
        ("points = [[0,0,0], [1,0,1], [1,0,0], [0,0,1]]\nbounded = true".to_owned(), "convex"),
        ("points = [[0,0,0], [1,0,1]]".to_owned(), "three finite points"),
    ] {
        let error = parsed(&rest).unwrap_err().to_string();
        assert!(error.contains(words), "{rest}: {error}");
    }
}

#[test]
fn a_number_that_cannot_be_is_told_as_it_was_written() {
    for (text, words) in [
        ("step = 1e-300", "step = 1e-300: it"),
        ("step = 0", "step = 0: it"),
        ("speed = -0.25", "speed = -0.25: it"),
        ("speed = nan", "speed = NaN: it"),
        ("[camera]\neye = [1e300, 0, 0.5]", "eye = [1e300, 0, 0.5]: it has to be three finite numbers, none beyond 1e12"),
    ] {
        let error = Script::parse(text, Path::new("s.toml")).unwrap_err().to_string();
        assert!(error.contains(words), "{text}: {error}");
    }
}

#[test]
fn the_whole_format_parses() {
    let s = load(FULL);
    assert_eq!((s.model.as_deref(), s.animation.as_deref(), s.speed, s.seed), (Some("beam"), Some("bend"), 0.5, 7));
    assert_eq!((s.total_frames(), s.end()), (180, 6.0));
    assert_eq!(s.camera.eye, Some(DVec3::new(0.0, 0.1, 0.5)));
    assert_eq!((s.tear.wall, s.tear.sample_time, s.particles.frequency), (Some(WallMode::Closed), Some(0.05), Some(4.0)));
    assert_eq!(s.actions.len(), 10);
    assert_eq!(s.actions[0].kind, ActionKind::Show { layer: Layer::Wireframe, on: true }, "in order of time");
    let ActionKind::Tear { path } = &s.actions[1].kind else { panic!() };
    assert_eq!(path.poses()[1], BladePose { t: 1.0, tip: DVec3::X * 0.1, base: DVec3::new(0.1, 0.2, 0.0) });
    assert_eq!(s.actions[1].end(), 1.5);
    let y = CutPlane { normal: DVec3::Y, distance: 0.5 };
    assert_eq!(s.actions[2].kind, ActionKind::Cut { plane: y, cap: false, bounded: Vec::new() });
    let z = CutPlane { normal: DVec3::Z, distance: 1.0 };
    assert_eq!(s.actions[3].kind, ActionKind::Cut { plane: z, cap: true, bounded: Vec::new() }, "caps are the default");
    let ActionKind::Grab { moves, .. } = &s.actions[4].kind else { panic!() };
    assert_eq!(Motion::sample(moves, DVec3::ZERO, 0.25), DVec3::Y * 0.5);
    assert_eq!(Motion::sample(moves, DVec3::ZERO, 9.0), DVec3::Y);
    assert_eq!(s.resolve("../m.glb"), Path::new("dir/../m.glb"));
}

#[test]
fn defaults_are_those_of_the_contract() {
    let s = load("");
    assert_eq!(s, Script { origin: "dir/my.toml".into(), ..Script::default() });
    assert_eq!((s.step, s.speed, s.camera.up, s.camera.fov_y, s.camera.orbit), (1.0 / 90.0, 1.0, DVec3::Y, 0.9, 0.0));
    assert_eq!(s.total_frames(), 90, "one second");
    let undo = "step = 0.01\n[[action]]\nkind = \"undo\"\nat = 0.5\n";
    assert_eq!(load(undo).total_frames(), 150);
    assert_eq!(load(&format!("frames = 3\n{undo}")).total_frames(), 3);
    assert!((s.time_of(90) - 1.0).abs() < 1e-12);
}

#[test]
fn unknown_keys_are_errors_that_name_the_line() {
    for (text, line, key) in [
        ("modle = \"beam\"\n", 1, "modle"),
        ("\n\n[camera]\neye = [0,0,1]\nzoom = 2\n", 5, "zoom"),
        ("[particles]\nr = 2\n", 2, "`r`"),
        ("[tear]\nwidht = 2\n", 2, "widht"),
        ("[[action]]\nkind = \"undo\"\nat = 1\nwhen = 2\n", 4, "when"),
        ("[[action]]\nkind = \"undo\"\nat = 1\n\nradius = 2\n", 5, "radius"),
        ("[[action]]\nkind = \"tear\"\nat = 1\nposes = [\n {t=0,tip=[0,0,0],base=[0,1,0]},\n {t=1,tp=[0,0,0]}]\n", 6, "tp"),
        ("[[action]]\nkind = \"slice\"\nat = 1\n", 2, "slice"),
        ("[[actions]]\nkind = \"undo\"\nat = 1\n", 1, "actions"),
    ] {
        let e = error(text);
        assert!(e.contains(&format!("line {line}")) && e.contains(key) && e.contains("my.toml"), "{text}: {e}");
    }
}

#[test]
fn values_without_sense_are_errors_that_name_the_line() {
    let act = |body: &str| format!("[[action]]\nat = 1.0\n{body}\n");
    let tear = |poses: &str| act(&format!("kind = \"tear\"\nposes = [\n{poses}\n]"));
    let pose = |t: f64, x: &str| format!("{{ t = {t:?}, tip = [{x}, 0, 0], base = [0, 1, 0] }}");
    for (text, line, word) in [
        ("step = 0.0".to_owned(), 1, "step"),
        ("speed = nan".to_owned(), 1, "speed"),
        ("seed = 1\nframes = 0".to_owned(), 2, "frames"),
        ("seed = -1".to_owned(), 1, "seed"),
        ("[camera]\neye = [0, inf, 0]".to_owned(), 2, "eye"),
        ("[camera]\neye = [nan, 0, 1]".to_owned(), 2, "eye"),
        ("[[action]]\nkind = \"undo\"\nat = 1e12".to_owned(), 1, "frames"),
        ("[camera]\neye = [1, 2, 3]\ntarget = [1, 2, 3]".to_owned(), 2, "target"),
        ("[camera]\nup = [0, 0, 0]".to_owned(), 2, "up"),
        ("[camera]\nfov_y = 4.0".to_owned(), 2, "fov_y"),
        ("[camera]\nfov_y = 0.0009".to_owned(), 2, "at least 0.001"),
        ("[tear]\nwidth = -0.1".to_owned(), 2, "width"),
        ("[tear]\nwidth = nan".to_owned(), 2, "width"),
        ("[particles]\nspacing = 0.2\nradius = 0.1".to_owned(), 3, "radius"),
        (act("kind = \"undo\"").replace("1.0", "-1.0"), 2, "at"),
        (act("kind = \"cut\"\nplane = [0, 0, 0, 1]"), 4, "normal"),
        (act("kind = \"cut\"\nplane = [0, nan, 1, 1]"), 4, "normal"),
        (act("kind = \"cut\"\npoints = [[0,0,0],[1,1,1],[2,2,2]]"), 4, "in line"),
        (act("kind = \"cut\""), 1, "plane"),
        (act("kind = \"cut\"\nplane = [0,0,1,1]\npoints = [[0,0,0],[1,0,0],[0,1,0]]"), 5, "either"),
        (tear(""), 4, "0 pose(s)"),
        (tear(&pose(0.0, "0")), 4, "1 pose(s)"),
        (tear(&format!("{},\n{}", pose(0.0, "0"), pose(1.0, "0"))), 4, "coincide"),
        (tear(&format!("{},\n{}", pose(0.0, "0"), pose(1.0, "nan"))), 6, "finite"),
        (tear(&format!("{},\n{}", pose(1.0, "0"), pose(0.0, "1"))), 6, "earlier"),
        (tear(&format!("{},\n{}", pose(-1.0, "0"), pose(0.0, "1"))), 5, "below 0"),
        (act("kind = \"tear\""), 1, "poses"),
        (act("kind = \"grab\"\ncenter = [0,0,0]\nradius = 1\nuntil = 0.5"), 6, "until"),
        (act("kind = \"grab\"\ncenter = [0,0,0]\nradius = -1\nuntil = 2"), 5, "radius"),
        (
            act("kind = \"grab\"\ncenter = [0,0,0]\nradius = 1\nuntil = 2\nmoves = [{t=1,by=[0,0,0]},\n{t=0,by=[0,0,0]}]"),
            8,
            "decrease",
        ),
        (act("kind = \"poke\"\nradius = 1\nuntil = 2\npath = []"), 6, "place"),
        (act("kind = \"squeeze\"\na = [0,0,0]\nradius = 1\nuntil = 2"), 1, "`b`"),
        (act("kind = \"show\""), 1, "layer"),
    ] {
        let e = error(&text);
        assert!(e.contains(&format!("line {line}:")) && e.contains(word), "{text}\n-> {e}");
    }
    assert!(error("[[action]]\nkind = \"undo\"\n").contains("`at`"));
    assert!(error("step = \"fast\"").contains("line 1"));
    let missing = Script::load(Path::new("no/such/file.toml")).unwrap_err();
    assert!(matches!(missing, ScriptError::Unreadable { .. }));
    load(&tear(&format!("{},\n{}", pose(0.0, "0"), pose(1.0, "1"))));
}

/// Frames that the command line gives bound a script whose last action ends later than any script may.
#[test]
fn frames_that_are_given_go_before_the_script_s() {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), "[[action]]\nkind = \"undo\"\nat = 20000").unwrap();
    assert!(Script::load(file.path()).is_err());
    assert_eq!(Script::load_for(file.path(), Some(5)).unwrap().total_frames(), 5);
}

#[test]
fn planes_are_normalised_and_degenerate_ones_refused() {
    let far = CutPlane::new(DVec3::new(0.0, 0.0, 3e-200), 6e-200).unwrap();
    assert_eq!(far, CutPlane { normal: DVec3::Z, distance: 2.0 });
    assert!(CutPlane::new(DVec3::ZERO, 1.0).is_none() && CutPlane::new(DVec3::X, f64::NAN).is_none());
    assert!(CutPlane::through([DVec3::ONE; 3]).is_none());
}

#[test]
fn bundled_scripts_parse() {
    for (name, text) in BUNDLED {
        let s = Script::parse(text, Path::new(name)).unwrap_or_else(|e| panic!("{e}"));
        assert!(s.model.is_some() && s.actions.len() >= 2, "{name}");
        assert!(s.actions.iter().any(|a| matches!(a.kind, ActionKind::Tear { .. })), "{name}");
        assert!((90..900).contains(&s.total_frames()), "{name}: {}", s.total_frames());
    }
}
