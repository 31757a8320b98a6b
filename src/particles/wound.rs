//! Wound particles: they draw the lips of a slit apart (MATHS 3.3; the paper's 3.3.4).
//!
//! They sit on lip vertices at even distances along the slit and rest displaced along the strip's normal, away from the
//! slit: a lens with pointed ends, or one that stands open where lips do not meet ([`super::lens`]). It is set anew for the whole slit
//! whenever the slit grows, and for good once the blade has left. Near an advancing blade it stays closed, so that the blade
//! goes on through skin that its own wound does not pull aside.

use super::legs::Leg;
use super::lens::{LEAST_SHARE, Opening};
use super::map_edit::{LipVertex, MapEdit};
use super::map_report::MapUpdateReport;
use super::map_update::{Update, UpdateScratch};
use super::particle_map::ParticleMap;
use super::settings::ParticleSettings;
use super::slit_line::Strip;
use super::strip_test::share_between;
use super::strips::{Strips, WoundMark};
use crate::geometry::{HalfEdge, Mesh, VertexId};
use glam::DVec3;

/// Where the first wound particles of a slit are that begins where lips do not meet, in spacings: beyond those that would hold it shut.
const FIRST_OF_OPEN: f64 = 0.6;

/// Vertices that are looked at between the two lips of a slit's end.
const MOST_BETWEEN_LIPS: usize = 128;

/// Sheets that get wound particles of their own where a blade passes through several: two walls of a hollow body, with two skins each.
const MOST_SHEETS: usize = 4;

/// Lips of one strip that are looked at between two of them.
const MOST_LIPS_LOOKED_AT: usize = 64;

/// Where the lips of a strip begin and end along it: in the skin that its wound's line is in, metres, and in other skins that the blade went
/// through, [`share_along`].
#[derive(Clone, Copy)]
struct Stretch {
    strip: usize,
    in_skin: (f64, f64),
    elsewhere: (f64, f64),
}

/// Where `p` lies along strip `k`, [`share_between`].
pub(super) fn share_along(strips: &Strips, k: usize, p: DVec3) -> f64 {
    share_between(strips.as_slice()[k].corners.map(DVec3::from_array), strips.geometry(k).normal(), p)
}

impl Stretch {
    /// Of strip `k`, whose lips the edit lists. At rest a strip that was cut in a bent pose may lie beside them, and before its blade has met
    /// the skin it has none.
    fn of(update: &Update<'_, '_>, k: usize) -> Self {
        let none = (f64::INFINITY, f64::NEG_INFINITY);
        let mut stretch = Self { strip: k, in_skin: none, elsewhere: none };
        let lips = update.edit.lips.iter().filter(|l| l.strip == k && update.mesh.vertex_is_live(l.vertex));
        for p in lips.map(|l| update.rest[l.vertex.index()]) {
            let (is_in_skin, at) = stretch.place(update, p);
            let ends = if is_in_skin { &mut stretch.in_skin } else { &mut stretch.elsewhere };
            *ends = (ends.0.min(at), ends.1.max(at));
        }
        stretch
    }

    /// Whether a point (rest space) is near the strip's skin, and where it is along that, or else along the strip.
    fn place(&self, update: &Update<'_, '_>, p: DVec3) -> (bool, f64) {
        let strip = &update.strips.as_slice()[self.strip];
        match strip.is_near_skin(p, update.settings.wound.spacing) {
            true => (true, (p - strip.skin_edge()[0]).dot(strip.along())),
            false => (false, share_along(update.strips, self.strip, p)),
        }
    }

    /// How far along the strip a lip is, metres: its lips go from its one end to the other.
    fn along(&self, update: &Update<'_, '_>, p: DVec3) -> f64 {
        let (is_in_skin, at) = self.place(update, p);
        let (first, last) = if is_in_skin { self.in_skin } else { self.elsewhere };
        ((at - first) / (last - first).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0) * update.strips.as_slice()[self.strip].length
    }
}

/// Adds wound particles to the lips of the new strips and sets the rest displacements of their wounds.
pub(super) fn add_particles(update: &mut Update<'_, '_>) {
    let wound = update.settings.wound;
    let strips = update.edit.new_strips.clone();
    if wound.gap <= 0.0 || strips.is_empty() || strips.end > update.strips.len() {
        return;
    }
    let (before, first_of_open) = (update.map.len(), FIRST_OF_OPEN * wound.spacing);
    for k in strips.clone() {
        let strip = update.strips.as_slice()[k];
        if strip.is_beside() {
            continue;
        }
        let stretch = Stretch::of(update, k);
        let mut room = room_for_marks(update, strip.wound);
        // Places at multiples of the spacing on the wound's line, whatever the strips' lengths: the first holds that end shut,
        // if it is one.
        let first_strip = update.strips.of_wound(strip.wound).next().unwrap_or(k);
        let is_first = first_strip == k;
        let is_open = is_first && !lips_meet(update, k, false, None);
        let (from, to) = (strip.place * f64::from(strip.way), strip.end_place() * f64::from(strip.way));
        let first = (from / wound.spacing).ceil() + f64::from(u8::from(is_open && from == 0.0));
        let places = (0..room).map(|i| (first + i as f64) * wound.spacing).take_while(|&s| s < to);
        let is_here = strip.way > 0 && from <= first_of_open && first_of_open < to && update.strips.begins_chain(first_strip);
        let starts_open = is_here && if is_first { is_open } else { !starts_held(update, strip.wound, [0.0; 2]) };
        for place in starts_open.then_some(first_of_open).into_iter().chain(places) {
            for side in [1, -1] {
                if !is_first && is_marked(update, &strip, place - from, i32::from(side)) {
                    continue;
                }
                room = room.saturating_sub(add_at(update, stretch, place - from, side, room));
            }
        }
        if strips.contains(&(k + 1)) && update.strips.as_slice()[k + 1].wound == strip.wound {
            continue;
        }
        let open = opened(update, &strip);
        // what lies in an older wound and opens no more of it leaves that as it stands
        if open == update.edit.opened && update.map.len() == before {
            continue;
        }
        // a blade that comes back has been at the other end
        let starts_shut = strip.way < 0 || starts_held(update, strip.wound, open);
        displace(update, Opening { wound: strip.wound, open, is_shut: [starts_shut, true], is_done: false });
    }
}

/// True if a wound particle stands near what lies so many metres along a strip, on this side of it: the blade came back over its wound, or goes
/// on from an older end.
fn is_marked(update: &Update<'_, '_>, strip: &Strip, along: f64, side: i32) -> bool {
    let (at, of_line) = (strip.place_at(along), strip.way * side);
    is_held(update, strip.wound, (at, strip.skin_at(along)), Some(of_line))
}

/// True if a wound particle stands near a place on a wound's line, on this side of that or on any, and no farther than a spacing from the place's
/// point in the skin (rest space): other skins that the blade went through have their own.
fn is_held(update: &Update<'_, '_>, wound: u32, (place, at): (f64, DVec3), on: Option<i32>) -> bool {
    let spacing = update.settings.wound.spacing;
    let is_near = |m: &WoundMark| {
        let (of_mark, side) = update.strips.place_of(m);
        (of_mark - place).abs() < 0.5 * spacing && on.is_none_or(|on| on == side)
    };
    let anchor = |m: &WoundMark| update.map.anchors[m.particle.index()];
    let is_there = |v: VertexId| v.is_some() && update.rest[v.index()].distance(at) < spacing;
    update.strips.marks_of(wound).any(|(_, m)| is_near(m) && is_there(anchor(m)))
}

/// What stands open of a wound while its newest strip is this one: all but the front, or what was open before the blade came.
fn opened(update: &Update<'_, '_>, strip: &Strip) -> [f64; 2] {
    let [low, high] = update.strips.wound_range(strip.wound).unwrap_or_default();
    let (before, tip, front) = (update.edit.opened, strip.end_place(), update.settings.wound.front);
    match strip.way {
        1 if tip >= high => [low, before[1].max(tip - front)],
        -1 if tip <= low => [before[0].min(tip + front), high],
        _ => [low, high],
    }
}

/// True if a wound particle holds the lower end of what stands open of a wound.
fn starts_held(update: &Update<'_, '_>, wound: u32, open: [f64; 2]) -> bool {
    update.strips.is_held(update.map, wound, open[0], 0.5 * update.settings.wound.spacing)
}

/// Sets the rest displacements of a wound and notes whose have changed.
fn displace(update: &mut Update<'_, '_>, opening: Opening) {
    let (lens, changed) = (&mut update.scratch.lens, &mut update.report.particles_changed);
    lens.displace_wound(update.mesh, (update.map, update.rest), update.strips, &update.settings.wound, opening, |j| {
        changed.push(j)
    });
}

/// True if the lips of strip `k` meet at its start, or at its end: from the outermost lip, or from that given, skin leads to the other
/// side. Over a border, in an older wound, or where a model that moves has carried the blade back into its slit they do not.
fn lips_meet(update: &mut Update<'_, '_>, k: usize, at_end: bool, from: Option<VertexId>) -> bool {
    let Update { mesh, rest, strips, edit, scratch, settings, .. } = update;
    let is_skin = |h: &HalfEdge| !mesh.is_interior(h.face());
    let of = &strips.as_slice()[k];
    let end = of.skin_edge()[usize::from(at_end)];
    let is_far = |v: VertexId| rest[v.index()].distance(end) >= settings.wound.spacing;
    let on_line = |strip: usize, side: i32| match &strips.as_slice()[strip] {
        other if other.wound == of.wound => side * other.way * of.way,
        _ => 0,
    };
    let is_lip = |l: &&LipVertex| {
        on_line(l.strip, i32::from(l.side)) > 0
            && mesh.vertex_is_live(l.vertex)
            && (l.strip == k || !is_far(l.vertex))
            && mesh.fan(l.vertex).any(|h| is_skin(&h))
    };
    let lips = edit.lips.iter().filter(is_lip);
    let place = |v: VertexId| of.inwards(at_end, rest[v.index()]);
    // on the skin that the wound's line is in; where the blade came back over it, another strip's may be the outermost
    let before = |a: &VertexId, b: &VertexId| is_far(*a).cmp(&is_far(*b)).then(place(*a).total_cmp(&place(*b))).then(a.cmp(b));
    let outermost = || lips.map(|l| l.vertex).min_by(before);
    let Some(from) = from.or_else(outermost) else { return false };
    let sides = |v: VertexId| strips.lip_sides(v).iter().map(|l| on_line(l.strip as usize, l.side));
    let side = |v: VertexId| sides(v).find(|side| *side != 0).unwrap_or(0);
    // the way round the other end of a short wound is none
    let middle = if strips.of_wound(of.wound).nth(1).is_some() {
        let [low, high] = strips.wound_range(of.wound).unwrap_or_default();
        0.5 * (high - low)
    } else {
        let own = edit.lips.iter().filter(|l| l.strip == k && mesh.vertex_is_live(l.vertex) && !is_far(l.vertex));
        let ends = own.map(|l| place(l.vertex)).fold([f64::MAX, f64::MIN], |[low, high], p| [low.min(p), high.max(p)]);
        0.5 * (ends[0] + ends[1])
    };
    let is_near = |v: VertexId| rest[v.index()].distance(rest[from.index()]) < settings.wound.spacing && place(v) <= middle;
    let reached = &mut scratch.work;
    reached.clear();
    reached.push(from);
    let mut next = 0;
    while next < reached.len().min(MOST_BETWEEN_LIPS) {
        let v = reached[next];
        next += 1;
        for h in mesh.fan(v).filter(is_skin) {
            for w in [mesh.to(h), mesh.from(h.prev())] {
                match side(w) {
                    -1 => return true,
                    0 if !reached.contains(&w) && is_near(w) => reached.push(w),
                    _ => {}
                }
            }
        }
    }
    false
}

/// Adds up to two particles, `room` at most, on one lip of a strip, and one on each further sheet:
/// a blade that passes through a thin part leaves two lips on a side, and each is drawn by its own. Returns how many.
fn add_at(update: &mut Update<'_, '_>, stretch: Stretch, place: f64, side: i8, room: usize) -> usize {
    let k = stretch.strip;
    let spacing = update.settings.wound.spacing;
    let mut taken = [VertexId::NONE; MOST_SHEETS];
    for i in 0..MOST_SHEETS.min(room) {
        let mut best: Option<(f64, VertexId)> = None;
        for LipVertex { vertex, .. } in update.edit.lips.iter().filter(|l| l.strip == k && l.side.signum() == side) {
            let p = update.rest[vertex.index()];
            let off = (stretch.along(update, p) - place).abs();
            let is_far = |t: &VertexId| i < 2 && update.rest[t.index()].distance(p) > 1.5 * spacing;
            let is_apart = || taken[..i].iter().all(|t| is_far(t) || is_beyond(update, k, *t, *vertex));
            let usable = off <= 0.5 * spacing && update.mesh.vertex_is_live(*vertex) && !update.is_anchor(*vertex);
            if usable && best.is_none_or(|b| (off, *vertex) < b) && is_apart() {
                best = Some((off, *vertex));
            }
        }
        let Some((_, vertex)) = best else { return i };
        let at = stretch.along(update, update.rest[vertex.index()]);
        add_marked(update, k, (vertex, side), at);
        taken[i] = vertex;
    }
    MOST_SHEETS.min(room)
}

/// The side of strip `k` that a vertex is on as a lip of its.
fn own_side(strips: &Strips, k: usize, v: VertexId) -> Option<i32> {
    strips.lip_sides(v).iter().find(|l| l.strip as usize == k).map(|l| l.side)
}

/// True if lip `v` of strip `k` is on another sheet than lip `t`: farther along the blade than along the slit, and no chain of lips leads
/// from the one to the other.
fn is_beyond(update: &Update<'_, '_>, k: usize, t: VertexId, v: VertexId) -> bool {
    let Update { mesh, rest, strips, .. } = update;
    let [tip0, tip1, base1, base0] = strips.as_slice()[k].corners.map(DVec3::from_array);
    let (up, way) = ((base0 - tip0 + base1 - tip1).normalize_or_zero(), rest[v.index()] - rest[t.index()]);
    let height = way.dot(up).abs();
    if 2.0 * height * height < way.length_squared() {
        return false;
    }
    let own = own_side(strips, k, t);
    let mut reached = [VertexId::NONE; MOST_LIPS_LOOKED_AT];
    reached[0] = t;
    let (mut next, mut count) = (0, 1);
    while next < count {
        for w in mesh.neighbours(reached[next]) {
            if w == v {
                return false;
            }
            if own_side(strips, k, w) == own && !reached[..count].contains(&w) {
                if count == MOST_LIPS_LOOKED_AT {
                    return false;
                }
                reached[count] = w;
                count += 1;
            }
        }
        next += 1;
    }
    true
}

/// Adds a wound particle on a lip of strip `k`, so many metres along it.
pub(super) fn add_marked(update: &mut Update<'_, '_>, k: usize, (vertex, side): (VertexId, i8), along: f64) {
    let outwards = update.strips.geometry(k).normal() * f64::from(side);
    let particle = update.add_particle(vertex, outwards * (LEAST_SHARE * update.settings.wound.gap));
    update.strips.wounds.push(WoundMark { particle, strip: k as u32, along, side: i32::from(side), lip: 0.0 });
}

/// How many more wound particles a wound may have.
pub(super) fn room_for_marks(update: &Update<'_, '_>, wound: u32) -> usize {
    update.settings.wound.max_particles.saturating_sub(update.strips.marks_of(wound).count())
}

/// Live lips of a strip.
fn lips_of<'a>(strips: &'a Strips, mesh: &'a Mesh, strip: usize) -> impl Iterator<Item = LipVertex> + 'a {
    strips
        .live_lips(mesh, strip)
        .filter_map(move |vertex| Some(LipVertex { vertex, strip, side: own_side(strips, strip, vertex)? as i8 }))
}

/// An end of a wound: the outermost of its strips there that has lips, whether the wound ends with that one's end, and where on the line.
#[derive(Clone, Copy)]
struct WoundEnd {
    strip: usize,
    at_end: bool,
    place: f64,
}

/// Both ends of a wound; `None` where none of its strips has lips: where the blade went on in the air there are none.
fn ends_of(strips: &Strips, mesh: &Mesh, wound: u32) -> Option<[WoundEnd; 2]> {
    let with_lips = strips.of_wound(wound).filter(|&k| lips_of(strips, mesh, k).next().is_some());
    // a strip's earlier end is the lower one unless it runs back
    with_lips.fold(None, |found: Option<[WoundEnd; 2]>, strip| {
        let of = &strips.as_slice()[strip];
        let ends = [(false, of.place), (true, of.end_place())].map(|(at_end, place)| WoundEnd { strip, at_end, place });
        let [lowest, highest] = if of.way > 0 { ends } else { [ends[1], ends[0]] };
        let Some([low, high]) = found else { return Some([lowest, highest]) };
        Some([if lowest.place < low.place { lowest } else { low }, if highest.place >= high.place { highest } else { high }])
    })
}

/// The blade has left a wound: it opens over its whole length, its front too, and wound particles hold its ends shut, so that the last is as
/// pointed as the first.
pub fn release_wound(
    (mesh, rest): (&Mesh, &[DVec3]),
    map: &mut ParticleMap,
    strips: &mut Strips,
    wound: u32,
    settings: &ParticleSettings,
    scratch: &mut UpdateScratch,
) -> MapUpdateReport {
    let Some(range) = strips.wound_range(wound) else { return MapUpdateReport::default() };
    let ends = ends_of(strips, mesh, wound);
    let mut lips = std::mem::take(&mut scratch.lips);
    lips.clear();
    for end in ends.iter().flatten() {
        for k in strips_at(strips, wound, end.place, settings).chain([end.strip]) {
            if lips.iter().all(|l| l.strip != k) {
                lips.extend(lips_of(strips, mesh, k));
            }
        }
    }
    let edit = MapEdit { lips: &lips, ..MapEdit::default() };
    let mut update = Update::begin((mesh, rest), map, strips, &edit, settings, scratch);
    let is_shut = [starts_held(&update, wound, range), true];
    let mut opening = Opening { wound, open: range, is_shut, is_done: true };
    if let Some(ends) = ends
        && settings.wound.gap > 0.0
        && update.find_zone()
    {
        let mut first_bottom = None;
        for (which, end) in ends.into_iter().enumerate() {
            let WoundEnd { strip, at_end, place } = end;
            // a nick in an edge is hardly longer than what counts as its end, and has one leg
            let is_another = |leg: &Leg| first_bottom != Some(leg.bottom);
            let leg = Leg::find(&mut update, strip, at_end).filter(is_another);
            let point = update.strips.as_slice()[strip].skin_edge()[usize::from(at_end)];
            // how a wound began has been looked at then
            let is_held = !at_end && is_held(&update, wound, (place, point), None);
            if leg.is_none() && (is_held || !at_end && update.strips.of_wound(wound).next() == Some(strip)) {
                opening.is_shut[which] = is_held;
                continue;
            }
            let is_shut = lips_meet(&mut update, strip, at_end, leg.as_ref().map(|leg| leg.bottom));
            opening.is_shut[which] = is_shut;
            let outwards = [-1.0, 1.0][which];
            opening.open[which] = place + outwards * leg.as_ref().map_or(0.0, |leg| leg.depth);
            match leg {
                Some(leg) => {
                    leg.fill(&mut update, is_shut);
                    first_bottom = Some(leg.bottom);
                }
                None if is_shut => hold_shut(&mut update, wound, end),
                None => {}
            }
        }
        update.link_particles(0);
        update.write_rows();
    }
    displace(&mut update, opening);
    let report = update.finish();
    scratch.lips = lips;
    report
}

/// Strips of a wound that begin or end within half a spacing of wound particles of a place on its line.
fn strips_at<'a>(
    strips: &'a Strips,
    wound: u32,
    place: f64,
    settings: &ParticleSettings,
) -> impl Iterator<Item = usize> + use<'a> {
    let near = 0.5 * settings.wound.spacing;
    let is_there = move |k: &usize| {
        let strip = &strips.as_slice()[*k];
        [strip.place, strip.end_place()].iter().any(|p| (p - place).abs() < near)
    };
    strips.of_wound(wound).filter(is_there)
}

/// Wound particles at an end of a wound, where there are none as yet: on lips of its outermost strip there, or else on the nearest.
fn hold_shut(update: &mut Update<'_, '_>, wound: u32, end: WoundEnd) {
    let strip = update.strips.as_slice()[end.strip];
    let (along, spacing) = ((end.place - strip.place) * f64::from(strip.way), update.settings.wound.spacing);
    for side in [1, -1] {
        if is_marked(update, &strip, along, side) {
            continue;
        }
        let (room, stretch) = (room_for_marks(update, wound), Stretch::of(update, end.strip));
        add_at(update, stretch, along, side as i8, room);
        if is_marked(update, &strip, along, side) || room_for_marks(update, wound) == 0 {
            continue;
        }
        let strips = update.strips.as_slice();
        let of_line = |l: &LipVertex| i32::from(l.side) * strips[l.strip].way == side * strip.way;
        let usable = |l: &&LipVertex| {
            strips[l.strip].wound == wound && of_line(l) && update.mesh.vertex_is_live(l.vertex) && !update.is_anchor(l.vertex)
        };
        let off = |l: &LipVertex| update.rest[l.vertex.index()].distance(strip.skin_at(along));
        let nearest =
            update.edit.lips.iter().filter(usable).min_by(|a, b| off(a).total_cmp(&off(b)).then(a.vertex.cmp(&b.vertex)));
        if let Some(l) = nearest.filter(|l| off(l) < 0.5 * spacing).copied() {
            let on = &strips[l.strip];
            add_marked(update, l.strip, (l.vertex, l.side), (end.place - on.place) * f64::from(on.way));
        }
    }
}
