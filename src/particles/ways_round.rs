//! Ways round a slit: how much of a pull at one lip the other feels (MATHS 3.4).
//!
//! A slit parts its lips, and they are one at its ends. Were what a strip parts never to follow, a pulled lip would tear off there:
//! the wound would open to a rectangle. So a pull goes round the ends, as in the diffraction method of meshfree crack models
//! (Organ, Fleming, Terry, Belytschko: Continuous meshless approximations for nonconvex bodies by diffraction and transparency,
//! 1996): what goes round is less the longer the way round is over the straight one.

use super::strips::Strips;
use crate::geometry::{Mesh, VertexId};
use glam::DVec3;

/// Slits that may lie between two vertices for a pull to go round them.
const MOST_SLITS: usize = 4;

/// Edges from one lip to the other along which they meet, at most: round the corners of a slit's end, through the skin before it.
const MOST_EDGES: usize = 4;

/// Vertices that those are looked for over, from each: around one in which the dust of many slits meets there are all others.
const MOST_REACHED: usize = 256;

/// Mesh, strips and rest positions.
type Torn<'a> = (&'a Mesh, &'a Strips, &'a [DVec3]);

/// The places where lips meet, slit by slit. They stay as they are until the next edit.
#[derive(Clone, Debug, Default)]
pub struct WaysRound {
    /// Of each slit its first strip and the end of its places.
    slits: Vec<(usize, usize)>,
    ends: Vec<DVec3>,
    /// Scratch: vertices in the order they were reached, each with the place of the one it was reached from.
    reached: Vec<(VertexId, usize)>,
    /// Scratch: edges between lips of a slit, and the middle of the way.
    met: Vec<(usize, DVec3)>,
}

/// Slits, places, vertices and edges that room is made for at first.
const ROOM: usize = 256;

impl WaysRound {
    /// Makes room for the wounds of a usual model.
    pub fn make_room(&mut self) {
        self.slits.reserve(ROOM);
        self.ends.reserve(ROOM);
        self.reached.reserve(ROOM);
        self.met.reserve(8 * ROOM);
    }

    /// Finds them: where few edges and less than `spacing` (metres, at rest) lead from one lip to the other, at a slit's ends or, where a
    /// floor joins its walls, at its bottom; no two nearer to each other than that. A slit that comes back to its start, or runs over a
    /// border, has none there.
    pub fn find(&mut self, mesh: &Mesh, strips: &Strips, rest: &[DVec3], spacing: f64) {
        self.slits.clear();
        self.ends.clear();
        let mut start = 0;
        while start < strips.len() {
            let end = (start..strips.len()).find(|&k| strips.slit_start(k) != start).unwrap_or(strips.len());
            let first = self.ends.len();
            self.met.clear();
            for k in start..end {
                let near = || strips.around(k);
                for v in strips.live_lips(mesh, k) {
                    let met = self.meeting((mesh, strips, rest), v, near, spacing);
                    self.met.extend(met);
                }
            }
            // ends proper before what is met round their corners
            for edges in 1..=MOST_EDGES {
                for &(_, middle) in self.met.iter().filter(|met| met.0 == edges) {
                    if self.ends[first..].iter().all(|e| e.distance_squared(middle) > spacing * spacing) {
                        self.ends.push(middle);
                    }
                }
            }
            self.slits.push((start, self.ends.len()));
            start = end;
        }
    }

    /// The shortest way from a vertex on the positive lip to one on the negative lip of one of the strips `near`, over vertices on neither:
    /// its edges and its middle.
    fn meeting<I: Iterator<Item = usize>>(
        &mut self,
        (mesh, strips, rest): Torn<'_>,
        from: VertexId,
        near: impl Fn() -> I,
        spacing: f64,
    ) -> Option<(usize, DVec3)> {
        let lip = |v: VertexId| strips.lip_sides(v).iter().find(|l| near().any(|k| k == l.strip as usize)).map_or(0, |l| l.side);
        if lip(from) <= 0 {
            return None;
        }
        let reached = &mut self.reached;
        reached.clear();
        reached.push((from, 0));
        let mut ring = 0..1;
        for edge in 1..=MOST_EDGES {
            for i in ring.clone() {
                for w in mesh.neighbours(reached[i].0) {
                    match lip(w) {
                        0 if reached.len() < MOST_REACHED && reached.iter().all(|r| r.0 != w) => reached.push((w, i)),
                        -1 if rest[from.index()].distance_squared(rest[w.index()]) < spacing * spacing => {
                            let mut way = [w; MOST_EDGES + 1];
                            let mut at = i;
                            for back in &mut way[1..=edge] {
                                (*back, at) = reached[at];
                            }
                            let middle = 0.5 * (rest[way[edge / 2].index()] + rest[way[edge.div_ceil(2)].index()]);
                            return Some((edge, middle));
                        }
                        _ => {}
                    }
                }
            }
            ring = ring.end..reached.len();
        }
        None
    }

    /// The share of a pull between two vertices that strips before `open` leave: 1 where none parts them, 0 where there is no way round.
    pub fn share(&self, strips: &Strips, rest: &[DVec3], a: VertexId, b: VertexId, open: usize) -> f64 {
        let (mut between, mut count) = ([0; MOST_SLITS], 0);
        let mut is_lost = false;
        strips.each_crossed(rest, a, b, |k| {
            let slit = strips.slit_start(k);
            if k < open && !between[..count].contains(&slit) {
                is_lost |= count == MOST_SLITS;
                if !is_lost {
                    between[count] = slit;
                    count += 1;
                }
            }
            is_lost
        });
        if is_lost {
            return 0.0;
        }
        let (p, q) = (rest[a.index()], rest[b.index()]);
        let straight = p.distance(q);
        let past = |slit: &usize| {
            let around = self.ends_of(*slit).iter().map(|e| p.distance(*e) + e.distance(q)).fold(f64::INFINITY, f64::min);
            if around > 0.0 { (straight / around).min(1.0).powi(2) } else { 1.0 }
        };
        between[..count].iter().map(past).product()
    }

    fn ends_of(&self, slit: usize) -> &[DVec3] {
        let Ok(i) = self.slits.binary_search_by_key(&slit, |s| s.0) else { return &[] };
        let from = i.checked_sub(1).map_or(0, |before| self.slits[before].1);
        &self.ends[from..self.slits[i].1]
    }
}
