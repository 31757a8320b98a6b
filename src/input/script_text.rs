//! From a script's text to a checked [`Script`]. Every value keeps its place in the text, so that an error can name the
//! line it is on.

use super::script::{Action, ActionKind, Camera, CutPlane, Layer, Motion, ParticleOverrides, Script, ScriptError, TearOverrides};
use crate::geometry::Plane;
use crate::physics::NetworkSettings;
use crate::surgery::leaf::Leaf;
use crate::surgery::{BladePath, BladePose, PathError, WallMode};
use glam::DVec3;
use serde::Deserialize;
use std::ops::Range;
use std::path::Path;
use toml::Spanned;

type Number = Spanned<f64>;
type Point = Spanned<[f64; 3]>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawScript {
    model: Option<String>,
    animation: Option<String>,
    speed: Option<Number>,
    step: Option<Number>,
    frames: Option<Spanned<i64>>,
    seed: Option<Spanned<i64>>,
    #[serde(default)]
    camera: RawCamera,
    #[serde(default)]
    particles: RawParticles,
    #[serde(default)]
    tear: RawTear,
    #[serde(default, rename = "action")]
    actions: Vec<Spanned<RawAction>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawCamera {
    eye: Option<Point>,
    target: Option<Point>,
    up: Option<Point>,
    fov_y: Option<Number>,
    orbit: Option<Number>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawParticles {
    spacing: Option<Number>,
    radius: Option<Number>,
    neighbours: Option<Number>,
    frequency: Option<Number>,
    damping: Option<Number>,
    coupling: Option<Number>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawTear {
    width: Option<Number>,
    wall: Option<WallMode>,
    gap: Option<Number>,
    opening_time: Option<Number>,
    sample_distance: Option<Number>,
    sample_time: Option<Number>,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Tear,
    Cut,
    Grab,
    Poke,
    Squeeze,
    Undo,
    Redo,
    Reset,
    Show,
}

/// All keys of all kinds; which of them a kind takes is checked after, so that the error can say it. (A tagged enum
/// would lose the places.)
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawAction {
    kind: Spanned<Kind>,
    at: Number,
    poses: Option<Spanned<Vec<Spanned<RawPose>>>>,
    plane: Option<Spanned<[f64; 4]>>,
    points: Option<Spanned<Vec<[f64; 3]>>>,
    bounded: Option<Spanned<bool>>,
    cap: Option<Spanned<bool>>,
    center: Option<Point>,
    radius: Option<Number>,
    until: Option<Number>,
    moves: Option<Spanned<Vec<RawMove>>>,
    path: Option<Spanned<Vec<RawPlace>>>,
    a: Option<Point>,
    b: Option<Point>,
    layer: Option<Spanned<Layer>>,
    on: Option<Spanned<bool>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawPose {
    t: f64,
    tip: [f64; 3],
    base: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawMove {
    t: Number,
    by: Point,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawPlace {
    t: Number,
    at: Point,
}

/// A broken rule and where.
struct Fault {
    span: Range<usize>,
    message: String,
}

fn fault<T>(span: Range<usize>, message: impl Into<String>) -> Result<T, Fault> {
    Err(Fault { span, message: message.into() })
}

type Checked<T> = Result<T, Fault>;

/// Line, from 1, of a place in `text`.
fn line_of(text: &str, at: usize) -> usize {
    1 + text.as_bytes()[..at.min(text.len())].iter().filter(|b| **b == b'\n').count()
}

/// Parses and checks a script; `frames`, where given, go before its own.
pub(super) fn parse(text: &str, origin: &Path, frames: Option<u32>) -> Result<Script, ScriptError> {
    let name = || origin.display().to_string();
    let raw: RawScript = toml::from_str(text).map_err(|e| ScriptError::Parse { origin: name(), source: Box::new(e) })?;
    check(raw, (text, origin), frames).map_err(|f| ScriptError::Invalid {
        origin: name(),
        line: line_of(text, f.span.start),
        message: f.message,
    })
}

fn check(raw: RawScript, (text, origin): (&str, &Path), wanted: Option<u32>) -> Checked<Script> {
    let default = Script::default();
    let step = number("step", raw.step.as_ref(), |x| x > 1e-6 && x <= 1.0, "more than 1e-6 and at most 1 (seconds)")?;
    let speed = number("speed", raw.speed.as_ref(), |x| x >= 0.0, "0 or more")?;
    let own_frames = integer("frames", raw.frames.as_ref(), 1, i64::from(Script::MOST_FRAMES))?;
    let frames = wanted.or(own_frames.map(|n| n as u32));
    let seed = integer("seed", raw.seed.as_ref(), 0, i64::MAX)?;
    let mut actions = Vec::with_capacity(raw.actions.len());
    for spanned in raw.actions {
        let line = line_of(text, spanned.span().start);
        let span = spanned.span();
        let action = action(spanned, line)?;
        let lasts = action.end() / step.unwrap_or(default.step);
        if frames.is_none() && lasts > f64::from(Script::MOST_FRAMES) {
            let most = Script::MOST_FRAMES;
            return fault(
                span,
                format!("the action ends after {lasts:.3e} frames, {most} are the most; give `frames` to end sooner"),
            );
        }
        actions.push(action);
    }
    actions.sort_by(|a, b| a.at.total_cmp(&b.at));
    Ok(Script {
        model: raw.model,
        animation: raw.animation,
        speed: speed.unwrap_or(default.speed),
        step: step.unwrap_or(default.step),
        frames,
        seed: seed.map_or(default.seed, |n| n as u64),
        camera: camera(&raw.camera)?,
        particles: particles(&raw.particles)?,
        tear: tear(&raw.tear)?,
        actions,
        origin: origin.to_owned(),
    })
}

fn number(key: &str, value: Option<&Number>, holds: fn(f64) -> bool, rule: &str) -> Checked<Option<f64>> {
    let Some(value) = value else { return Ok(None) };
    let x = *value.get_ref();
    if x.is_finite() && holds(x) {
        Ok(Some(x))
    } else {
        fault(value.span(), format!("{key} = {}: it has to be {rule}", shown(x)))
    }
}

/// A number as a person would write it: without hundreds of zeros.
fn shown(x: f64) -> String {
    if x == 0.0 || (1e-6..1e15).contains(&x.abs()) { format!("{x}") } else { format!("{x:e}") }
}

fn positive(key: &str, value: Option<&Number>) -> Checked<Option<f64>> {
    number(key, value, |x| x > 0.0, "a finite number above 0")
}

fn not_negative(key: &str, value: Option<&Number>) -> Checked<Option<f64>> {
    number(key, value, |x| x >= 0.0, "a finite number, 0 or more")
}

fn integer(key: &str, value: Option<&Spanned<i64>>, low: i64, high: i64) -> Checked<Option<i64>> {
    let Some(value) = value else { return Ok(None) };
    let x = *value.get_ref();
    if (low..=high).contains(&x) {
        Ok(Some(x))
    } else {
        fault(value.span(), format!("{key} = {x}: it has to be from {low} to {high}"))
    }
}

fn point(key: &str, value: &Point) -> Checked<DVec3> {
    let p = DVec3::from(*value.get_ref());
    // Beyond this the exact predicates would overflow; nothing a model can hold is that far.
    if p.abs().cmple(DVec3::splat(1e12)).all() {
        Ok(p)
    } else {
        fault(
            value.span(),
            format!("{key} = [{}]: it has to be three finite numbers, none beyond 1e12", p.to_array().map(shown).join(", ")),
        )
    }
}

fn optional_point(key: &str, value: Option<&Point>) -> Checked<Option<DVec3>> {
    value.map(|v| point(key, v)).transpose()
}

fn camera(raw: &RawCamera) -> Checked<Camera> {
    let default = Camera::default();
    let up = optional_point("up", raw.up.as_ref())?;
    if let (Some(DVec3::ZERO), Some(value)) = (up, &raw.up) {
        return fault(value.span(), "up has to point somewhere: it is zero");
    }
    let camera = Camera {
        eye: optional_point("eye", raw.eye.as_ref())?,
        target: optional_point("target", raw.target.as_ref())?,
        up: up.unwrap_or(default.up),
        fov_y: number("fov_y", raw.fov_y.as_ref(), |x| (1e-3..3.1).contains(&x), "at least 0.001 and below 3.1 radians")?
            .unwrap_or(default.fov_y),
        orbit: number("orbit", raw.orbit.as_ref(), |_| true, "a finite number")?.unwrap_or(default.orbit),
    };
    match &raw.eye {
        Some(eye) if camera.eye == camera.target => fault(eye.span(), "the camera's eye is on its target"),
        _ => Ok(camera),
    }
}

fn particles(raw: &RawParticles) -> Checked<ParticleOverrides> {
    let overrides = ParticleOverrides {
        spacing: positive("spacing", raw.spacing.as_ref())?,
        radius: positive("radius", raw.radius.as_ref())?,
        neighbours: not_negative("neighbours", raw.neighbours.as_ref())?,
        frequency: number(
            "frequency",
            raw.frequency.as_ref(),
            |x| NetworkSettings::FREQUENCIES_HZ.contains(&x),
            "from 0.001 to 1e6 Hz",
        )?,
        damping: number("damping", raw.damping.as_ref(), |x| NetworkSettings::DAMPING_RATIOS.contains(&x), "from 0 to 100")?,
        coupling: number("coupling", raw.coupling.as_ref(), |x| NetworkSettings::COUPLINGS.contains(&x), "from 0 to 1e6")?,
    };
    match (overrides.spacing, overrides.radius, &raw.radius) {
        (Some(r), Some(d), Some(at)) if d <= r => {
            fault(at.span(), format!("radius = {d}: it has to be above the spacing, {r} (MATHS 2.1)"))
        }
        _ => Ok(overrides),
    }
}

fn tear(raw: &RawTear) -> Checked<TearOverrides> {
    Ok(TearOverrides {
        width: not_negative("width", raw.width.as_ref())?,
        wall: raw.wall,
        gap: not_negative("gap", raw.gap.as_ref())?,
        opening_time: not_negative("opening_time", raw.opening_time.as_ref())?,
        sample_distance: positive("sample_distance", raw.sample_distance.as_ref())?,
        sample_time: positive("sample_time", raw.sample_time.as_ref())?,
    })
}

impl RawAction {
    /// The keys that are given, besides `kind` and `at`, and where.
    fn given(&self) -> impl Iterator<Item = (&'static str, Range<usize>)> {
        fn at<T>(key: &'static str, value: &Option<Spanned<T>>) -> Option<(&'static str, Range<usize>)> {
            value.as_ref().map(|v| (key, v.span()))
        }
        [
            at("poses", &self.poses),
            at("plane", &self.plane),
            at("points", &self.points),
            at("bounded", &self.bounded),
            at("cap", &self.cap),
            at("center", &self.center),
            at("radius", &self.radius),
            at("until", &self.until),
            at("moves", &self.moves),
            at("path", &self.path),
            at("a", &self.a),
            at("b", &self.b),
            at("layer", &self.layer),
            at("on", &self.on),
        ]
        .into_iter()
        .flatten()
    }
}

impl Kind {
    fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }

    fn keys(self) -> &'static [&'static str] {
        match self {
            Self::Tear => &["poses"],
            Self::Cut => &["plane", "points", "poses", "bounded", "cap"],
            Self::Grab => &["center", "radius", "until", "moves"],
            Self::Poke => &["radius", "until", "path"],
            Self::Squeeze => &["a", "b", "radius", "until"],
            Self::Undo | Self::Redo | Self::Reset => &[],
            Self::Show => &["layer", "on"],
        }
    }
}

/// What an action's keys are checked against.
struct Context {
    kind: Kind,
    at: f64,
    span: Range<usize>,
}

impl Context {
    fn need<'a, T>(&self, key: &str, value: Option<&'a T>) -> Checked<&'a T> {
        match value {
            Some(value) => Ok(value),
            None => fault(self.span.clone(), format!("a {} needs the key `{key}`", self.kind.name())),
        }
    }

    fn radius(&self, raw: &RawAction) -> Checked<f64> {
        let value = self.need("radius", raw.radius.as_ref())?;
        positive("radius", Some(value)).map(Option::unwrap_or_default)
    }

    fn until(&self, raw: &RawAction) -> Checked<f64> {
        let value = self.need("until", raw.until.as_ref())?;
        let until = *value.get_ref();
        if until.is_finite() && until >= self.at {
            return Ok(until);
        }
        fault(value.span(), format!("until = {until}: it has to be at = {} or later, seconds from the start", self.at))
    }

    fn point(&self, key: &str, value: Option<&Point>) -> Checked<DVec3> {
        point(key, self.need(key, value)?)
    }
}

fn action(spanned: Spanned<RawAction>, line: usize) -> Checked<Action> {
    let span = spanned.span();
    let raw = spanned.into_inner();
    let kind = *raw.kind.get_ref();
    if let Some((key, at)) = raw.given().find(|(key, _)| !kind.keys().contains(key)) {
        let takes = match kind.keys() {
            [] => "no keys but `at`".to_owned(),
            keys => format!("`{}`", keys.join("`, `")),
        };
        return fault(at, format!("unknown key `{key}`: a {} takes {takes}", kind.name()));
    }
    let at = not_negative("at", Some(&raw.at))?.unwrap_or_default();
    let context = Context { kind, at, span };
    let kind = match kind {
        Kind::Tear => ActionKind::Tear { path: blade_path(context.need("poses", raw.poses.as_ref())?)? },
        Kind::Cut => cut(&raw, &context)?,
        Kind::Grab => ActionKind::Grab {
            center: context.point("center", raw.center.as_ref())?,
            radius: context.radius(&raw)?,
            until: context.until(&raw)?,
            moves: motions("by", raw.moves.iter().flat_map(|m| m.get_ref()).map(|m| (&m.t, &m.by)))?,
        },
        Kind::Poke => {
            let path = context.need("path", raw.path.as_ref())?;
            if path.get_ref().is_empty() {
                return fault(path.span(), "the path of a poke needs at least one place");
            }
            let path = motions("at", path.get_ref().iter().map(|p| (&p.t, &p.at)))?;
            ActionKind::Poke { radius: context.radius(&raw)?, until: context.until(&raw)?, path }
        }
        Kind::Squeeze => ActionKind::Squeeze {
            a: context.point("a", raw.a.as_ref())?,
            b: context.point("b", raw.b.as_ref())?,
            radius: context.radius(&raw)?,
            until: context.until(&raw)?,
        },
        Kind::Undo => ActionKind::Undo,
        Kind::Redo => ActionKind::Redo,
        Kind::Reset => ActionKind::Reset,
        Kind::Show => {
            let layer = *context.need("layer", raw.layer.as_ref())?.get_ref();
            ActionKind::Show { layer, on: raw.on.is_none_or(Spanned::into_inner) }
        }
    };
    Ok(Action { at, line, kind })
}

fn blade_path(raw: &Spanned<Vec<Spanned<RawPose>>>) -> Checked<BladePath> {
    let poses = raw.get_ref();
    if let Some(first) = poses.first().filter(|p| p.get_ref().t < 0.0) {
        return fault(first.span(), "a pose's t counts from the action's `at`: it cannot be below 0");
    }
    let pose = |p: &Spanned<RawPose>| {
        let p = p.get_ref();
        BladePose { t: p.t, tip: p.tip.into(), base: p.base.into() }
    };
    BladePath::new(poses.iter().map(pose).collect()).or_else(|e| {
        let at = match e {
            PathError::NotFinite { pose } | PathError::ZeroLengthBlade { pose } | PathError::TimeDecreases { pose } => {
                poses[pose].span()
            }
            _ => raw.span(),
        };
        fault(at, e.to_string())
    })
}

fn cut(raw: &RawAction, context: &Context) -> Checked<ActionKind> {
    let cap = raw.cap.as_ref().is_none_or(|c| *c.get_ref());
    if let Some(poses) = &raw.poses {
        if let Some((key, span)) = raw.given().find(|(key, _)| !["poses", "cap"].contains(key)) {
            return fault(span, format!("a cut by the `poses` of a blade takes no `{key}`"));
        }
        return Ok(ActionKind::CutByBlade { path: blade_path(poses)?, cap });
    }
    let plane = plane(raw, context)?;
    let Some(flag) = raw.bounded.as_ref().filter(|b| *b.get_ref()) else {
        return Ok(ActionKind::Cut { plane, cap, bounded: Vec::new() });
    };
    let Some(points) = &raw.points else {
        return fault(flag.span(), "a bounded cut needs `points`: the corners of what the blade swept");
    };
    let onto = |p: &[f64; 3]| DVec3::from(*p) - plane.normal * (plane.normal.dot(DVec3::from(*p)) - plane.distance);
    let bounded: Vec<DVec3> = points.get_ref().iter().map(onto).collect();
    let whole = Plane::Equation { normal: plane.normal, offset: plane.distance };
    match Leaf::in_plane(whole, &bounded) {
        Some(_) => Ok(ActionKind::Cut { plane, cap, bounded }),
        None => {
            fault(points.span(), "the points of a bounded cut have to be the corners of a convex polygon, in order around it")
        }
    }
}

fn plane(raw: &RawAction, context: &Context) -> Checked<CutPlane> {
    match (&raw.plane, &raw.points) {
        (Some(plane), None) => {
            let [x, y, z, d] = *plane.get_ref();
            CutPlane::new(DVec3::new(x, y, z), d)
                .map_or_else(|| fault(plane.span(), "a plane is [nx, ny, nz, d], finite, with a normal that is not zero"), Ok)
        }
        (None, Some(points)) => {
            let most = if raw.bounded.as_ref().is_some_and(|b| *b.get_ref()) { 4 } else { 3 };
            let given = points.get_ref();
            match given.first_chunk::<3>().filter(|_| given.len() <= most && given.iter().flatten().all(|x| x.abs() <= 1e12)) {
                Some(first) => CutPlane::through(first.map(DVec3::from))
                    .map_or_else(|| fault(points.span(), "the three points of a plane have to be finite and not in line"), Ok),
                None => fault(points.span(), "a cut takes three finite points, or with `bounded = true` three or four"),
            }
        }
        (Some(_), Some(points)) => fault(points.span(), "a cut takes either `plane` or `points`, not both"),
        (None, None) => fault(context.span.clone(), "a cut needs `plane`, `points` or `poses`"),
    }
}

fn motions<'a>(key: &str, raw: impl Iterator<Item = (&'a Number, &'a Point)>) -> Checked<Vec<Motion>> {
    let mut before = 0.0;
    raw.map(|(time, place)| {
        let t = *time.get_ref();
        if !(t.is_finite() && t >= before) {
            return fault(time.span(), format!("t = {t}: times count from the action's `at` and do not decrease"));
        }
        before = t;
        Ok(Motion { t, to: point(key, place)? })
    })
    .collect()
}

#[cfg(test)]
#[path = "script_tests.rs"]
mod tests;
