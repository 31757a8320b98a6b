//! Wound particles: they draw the lips of a slit apart (MATHS 3.3; the paper's 3.3.4).
//!
//! They sit on lip vertices at even distances along the slit and rest displaced along the strip's normal, away from the
//! slit: a lens with pointed ends, or one that stands open where lips do not meet ([`super::lens`]). It is set anew for the whole slit
//! whenever the slit grows, and for good once the blade has left. Near an advancing blade it stays closed, so that the blade
//! goes on through skin that its own wound does not pull aside.

use super::legs::Leg;
use super::lens::{LEAST_SHARE, Opening, slit_marks};
use super::map_edit::{LipVertex, MapEdit};
use super::map_report::MapUpdateReport;
use super::map_update::{Update, UpdateScratch};
use super::particle_map::ParticleMap;
use super::settings::ParticleSettings;
use super::strip_test::share_between;
use super::strips::{LipSide, Strips, WoundMark};
use crate::geometry::{HalfEdge, Mesh, VertexId};
use glam::DVec3;

/// Vertices that are looked at between the two lips of a slit's end.
const MOST_BETWEEN_LIPS: usize = 128;

/// Sheets that get wound particles of their own where a blade passes through several: two walls of a hollow body, with two skins each.
const MOST_SHEETS: usize = 4;

/// Lips of one strip that are looked at between two of them.
const MOST_LIPS_LOOKED_AT: usize = 64;

/// A strip, and where its lips begin and end along it, [`share_along`].
pub(super) type Stretch = (usize, (f64, f64));

/// Where `p` lies along strip `k`, [`share_between`].
pub(super) fn share_along(strips: &Strips, k: usize, p: DVec3) -> f64 {
    share_between(strips.as_slice()[k].corners.map(DVec3::from_array), strips.geometry(k).normal(), p)
}

/// Where the lips of a strip begin and end along it, [`share_along`]. At rest a strip that was cut in a bent pose may lie beside its lips,
/// and before its blade has met the skin it has none.
fn stretch_of_lips(update: &Update<'_, '_>, k: usize) -> (f64, f64) {
    let lips = update.edit.lips.iter().filter(|l| l.strip == k && update.mesh.vertex_is_live(l.vertex));
    let places = lips.map(|l| share_along(update.strips, k, update.rest[l.vertex.index()]));
    places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), t| (low.min(t), high.max(t)))
}

/// Adds wound particles to the lips of the new strips and sets the rest displacements of their slits.
pub(super) fn add_particles(update: &mut Update<'_, '_>) {
    let wound = update.settings.wound;
    let strips = update.edit.new_strips.clone();
    if wound.gap <= 0.0 || strips.is_empty() || strips.end > update.strips.len() {
        return;
    }
    let mut k = strips.start;
    while k < strips.end {
        let start = update.strips.slit_start(k);
        let mut offset = update.strips.stretch(k).0;
        let slit = update.strips.as_slice()[k].slit;
        let mut room = room_for_marks(update, start);
        while k < strips.end && update.strips.as_slice()[k].slit == slit {
            if update.strips.as_slice()[k].is_beside() {
                k += 1;
                continue;
            }
            let end = offset + update.strips.stretch(k).1;
            let lips = stretch_of_lips(update, k);
            // Places at multiples of the spacing from the slit's start, whatever the strips' lengths: the first holds that end shut,
            // if it is one.
            let is_open = offset == 0.0 && !lips_meet(update, (k, lips), false, None);
            let first = (offset / wound.spacing).ceil().max(if is_open { 1.0 } else { 0.0 });
            let places = (0..room).map(|i| (first + i as f64) * wound.spacing).take_while(|&s| s < end);
            for place in places {
                for side in [1, -1] {
                    room = room.saturating_sub(add_at(update, (k, lips), place - offset, side, room));
                }
            }
            offset = end;
            k += 1;
        }
        let open = (offset - wound.front).max(0.0);
        displace(update, Opening { start, before: 0.0, open, is_shut: true, is_done: false });
    }
}

/// Sets the rest displacements of a slit and notes whose have changed.
fn displace(update: &mut Update<'_, '_>, opening: Opening) {
    let (lens, changed) = (&mut update.scratch.lens, &mut update.report.particles_changed);
    lens.displace_slit(update.map, update.strips, &update.settings.wound, opening, |j| changed.push(j));
}

/// True if the lips of strip `k` meet at its start, or at its end: from the outermost lip, or from that given, skin leads to the other
/// side. Over a border, in an older wound, or where a model that moves has carried the blade back into its slit they do not.
fn lips_meet(update: &mut Update<'_, '_>, (k, (first, last)): Stretch, at_end: bool, from: Option<VertexId>) -> bool {
    let Update { mesh, rest, strips, edit, scratch, settings, .. } = update;
    let is_skin = |h: &HalfEdge| !mesh.is_interior(h.face());
    let is_lip =
        |l: &&LipVertex| l.strip == k && l.side > 0 && mesh.vertex_is_live(l.vertex) && mesh.fan(l.vertex).any(|h| is_skin(&h));
    let lips = edit.lips.iter().filter(is_lip);
    let ahead = if at_end { -1.0 } else { 1.0 };
    let place = |v: VertexId| share_along(strips, k, rest[v.index()]) * ahead;
    let outermost = || lips.map(|l| l.vertex).min_by(|a, b| place(*a).total_cmp(&place(*b)).then(a.cmp(b)));
    let Some(from) = from.or_else(outermost) else { return false };
    let near = |l: &&LipSide| strips.around(k).any(|m| m == l.strip as usize);
    let side = |v: VertexId| strips.lip_sides(v).iter().find(near).map_or(0, |l| l.side);
    // the way round the other end of a short strip is none
    let is_near = |v: VertexId| {
        rest[v.index()].distance(rest[from.index()]) < settings.wound.spacing && place(v) <= 0.5 * (first + last) * ahead
    };
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

/// Adds up to two particles, `room` at most, on one lip of strip `k`, whose [`stretch_of_lips`] is given, and one on each further sheet:
/// a blade that passes through a thin part leaves two lips on a side, and each is drawn by its own. Returns how many.
fn add_at(update: &mut Update<'_, '_>, (k, lips): Stretch, place: f64, side: i8, room: usize) -> usize {
    let along = |strips: &Strips, p: DVec3| {
        let t = (share_along(strips, k, p) - lips.0) / (lips.1 - lips.0).max(f64::MIN_POSITIVE);
        t.clamp(0.0, 1.0) * strips.stretch(k).1
    };
    let spacing = update.settings.wound.spacing;
    let mut taken = [VertexId::NONE; MOST_SHEETS];
    for i in 0..MOST_SHEETS.min(room) {
        let mut best: Option<(f64, VertexId)> = None;
        for LipVertex { vertex, .. } in update.edit.lips.iter().filter(|l| l.strip == k && l.side.signum() == side) {
            let p = update.rest[vertex.index()];
            let off = (along(update.strips, p) - place).abs();
            let is_far = |t: &VertexId| i < 2 && update.rest[t.index()].distance(p) > 1.5 * spacing;
            let is_apart = || taken[..i].iter().all(|t| is_far(t) || is_beyond(update, k, *t, *vertex));
            let usable = off <= 0.5 * spacing && update.mesh.vertex_is_live(*vertex) && !update.is_anchor(*vertex);
            if usable && best.is_none_or(|b| (off, *vertex) < b) && is_apart() {
                best = Some((off, *vertex));
            }
        }
        let Some((_, vertex)) = best else { return i };
        let at = along(update.strips, update.rest[vertex.index()]);
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
    update.strips.wounds.push(WoundMark { particle, strip: k as u32, along, side: i32::from(side), padding: 0 });
}

/// How many more wound particles the slit that starts at strip `start` may have.
pub(super) fn room_for_marks(update: &Update<'_, '_>, start: usize) -> usize {
    update.settings.wound.max_particles.saturating_sub(slit_marks(update.strips, start).count())
}

/// Live lips of a strip.
fn lips_of<'a>(strips: &'a Strips, mesh: &'a Mesh, strip: usize) -> impl Iterator<Item = LipVertex> + 'a {
    strips
        .live_lips(mesh, strip)
        .filter_map(move |vertex| Some(LipVertex { vertex, strip, side: own_side(strips, strip, vertex)? as i8 }))
}

/// The blade has left the slit that the newest strip belongs to: it opens over its whole length, its front too, and wound particles
/// hold its end shut, so that it is as pointed as the start.
pub fn release_slit(
    (mesh, rest): (&Mesh, &[DVec3]),
    map: &mut ParticleMap,
    strips: &mut Strips,
    settings: &ParticleSettings,
    scratch: &mut UpdateScratch,
) -> MapUpdateReport {
    let Some(last) = strips.len().checked_sub(1) else { return MapUpdateReport::default() };
    let (start, wound) = (strips.slit_start(last), settings.wound);
    // where the blade went on in the air there are none
    let has_lips = |&k: &usize| !strips.as_slice()[k].is_beside() && lips_of(strips, mesh, k).next().is_some();
    let end = (start..=last).rev().find(has_lips).unwrap_or(last);
    let first = (start..=end).find(has_lips).unwrap_or(end);
    let mut lips = std::mem::take(&mut scratch.lips);
    lips.clear();
    lips.extend(lips_of(strips, mesh, end));
    if first < end {
        lips.extend(lips_of(strips, mesh, first));
    }
    let edit = MapEdit { lips: &lips, ..MapEdit::default() };
    let mut update = Update::begin((mesh, rest), map, strips, &edit, settings, scratch);
    let (before, length) = update.strips.stretch(end);
    let mut opening = Opening { start, before: 0.0, open: before + length, is_shut: true, is_done: true };
    if wound.gap > 0.0 && !lips.is_empty() && update.find_zone() {
        let stretch = (first, stretch_of_lips(&update, first));
        let started = Leg::find(&mut update, stretch, false);
        if let Some(leg) = &started {
            let is_shut = lips_meet(&mut update, stretch, false, Some(leg.bottom));
            leg.fill(&mut update, is_shut);
            opening.before = leg.depth - update.strips.stretch(first).0;
        }
        let stretch = (end, stretch_of_lips(&update, end));
        // a nick in an edge is hardly longer than what counts as its end, and has one leg
        let is_another = |leg: &Leg| started.as_ref().is_none_or(|first| first.bottom != leg.bottom);
        let leg = Leg::find(&mut update, stretch, true).filter(is_another);
        opening.is_shut = lips_meet(&mut update, stretch, true, leg.as_ref().map(|leg| leg.bottom));
        if let Some(leg) = &leg {
            leg.fill(&mut update, opening.is_shut);
            opening.open += leg.depth;
        }
        for side in [1, -1].into_iter().filter(|_| opening.is_shut && leg.is_none()) {
            let marks = slit_marks(update.strips, start).filter(|m| m.side == i32::from(side));
            let furthest = marks.map(|m| update.strips.stretch(m.strip as usize).0 + m.along).fold(f64::NEG_INFINITY, f64::max);
            if furthest < before + length - 0.5 * wound.spacing {
                let room = room_for_marks(&update, start);
                add_at(&mut update, stretch, length, side, room);
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
