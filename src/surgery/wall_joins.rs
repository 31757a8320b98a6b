//! How a wall goes on where a rim loop leaves a facet: from facet to facet, and along the body's edges.

use super::{BodyEdge, Chain, End, Facets, NONE, WallPoint, Walls, segment_distance};
use glam::DVec3;

/// Facets of a body: a bit each of those that hold an edge.
const MOST_FACETS: usize = u16::BITS as usize;

/// Scratch: what opens and closes pieces of one edge of the body.
#[derive(Debug, Default)]
pub(super) struct Pairing {
    order: Vec<u32>,
    opened: Vec<End>,
    early: Vec<End>,
    pieces: Vec<(End, End)>,
}

impl Pairing {
    /// Makes room for so many crossings.
    pub(super) fn make_room(&mut self, crossings: usize) {
        self.order.reserve(crossings);
        self.opened.reserve(crossings);
        self.early.reserve(crossings);
        self.pieces.reserve(crossings);
    }
}

impl Walls {
    /// Facets to pass through between two that share no edge, those around the corner nearest to `p`, and how many they are.
    pub(super) fn route(&self, from: u8, to: u8, p: DVec3, facets: &Facets) -> ([u8; MOST_FACETS], usize) {
        let (mut path, mut len) = ([0; MOST_FACETS], 0);
        if self.edge_between(from, to).is_some() {
            return (path, len);
        }
        let n = facets.cycles.len().min(MOST_FACETS);
        let hop = 1e-9 * facets.size();
        let (mut cost, mut before, mut done) = ([f64::INFINITY; MOST_FACETS], [NONE; MOST_FACETS], [false; MOST_FACETS]);
        cost[from as usize] = 0.0;
        for _ in 0..n {
            let open = (0..n).filter(|&k| !done[k] && cost[k].is_finite());
            let Some(k) = open.min_by(|&a, &b| cost[a].total_cmp(&cost[b])) else { break };
            done[k] = true;
            for edge in self.edges.iter().filter(|e| e.facets.contains(&(k as u8))) {
                let m = usize::from(edge.facets[usize::from(edge.facets[0] == k as u8)]);
                let [a, b] = edge.ends.map(|c| facets.corners[c as usize]);
                let detour = if facets.avoided >> m & 1 == 1 { 1e3 * hop } else { hop };
                let through = cost[k] + segment_distance(a, b, p) + detour;
                if through < cost[m] {
                    (cost[m], before[m]) = (through, k as u32);
                }
            }
        }
        let mut at = before[to as usize];
        while at != NONE && at != u32::from(from) && len < n {
            path[len] = at as u8;
            len += 1;
            at = before[at as usize];
        }
        path[..len].reverse();
        (path, len)
    }

    /// Pairs what opens a piece of edge `e` with what closes it, like parentheses, and joins the chains of both facets.
    pub(super) fn join_along(&mut self, e: usize, facets: &Facets) {
        let BodyEdge { facets: [low, high], ends } = self.edges[e];
        let Self { crossings, flags, pairing, .. } = self;
        let Pairing { order, opened, early, pieces } = pairing;
        [&mut *opened, early].into_iter().for_each(Vec::clear);
        pieces.clear();
        order.clear();
        order.extend((0..crossings.len() as u32).filter(|&x| crossings[x as usize].edge as usize == e));
        order.sort_unstable_by(|&a, &b| {
            let (x, y) = (&crossings[a as usize], &crossings[b as usize]);
            x.t.total_cmp(&y.t).then(y.rises.cmp(&x.rises)).then(a.cmp(&b))
        });
        opened.extend((0..flags[ends[0] as usize]).map(|i| End::Corner(ends[0], i)));
        for &x in order.iter() {
            if crossings[x as usize].rises {
                match early.pop() {
                    Some(close) => pieces.push((End::Crossing(x), close)),
                    None => opened.push(End::Crossing(x)),
                }
            } else {
                match opened.pop() {
                    Some(open) => pieces.push((open, End::Crossing(x))),
                    None => early.push(End::Crossing(x)),
                }
            }
        }
        pieces.extend(opened.drain(..).enumerate().map(|(i, open)| (open, End::Corner(ends[1], i as u16))));
        for k in 0..self.pairing.pieces.len() {
            let (open, close) = self.pairing.pieces[k];
            let (from, to) = (self.chain_at(open, low, facets), self.chain_at(close, low, facets));
            self.chains[from as usize].next = to;
            let (from, to) = (self.chain_at(close, high, facets), self.chain_at(open, high, facets));
            self.chains[from as usize].next = to;
        }
    }

    /// The chain on `facet` that ends or starts at one end of a piece.
    fn chain_at(&mut self, end: End, facet: u8, facets: &Facets) -> u32 {
        match end {
            End::Crossing(x) => {
                let x = self.crossings[x as usize];
                if self.chains[x.leaves as usize].facet == facet { x.leaves } else { x.enters }
            }
            End::Corner(c, copy) => {
                if let Some(known) = self.corner_chains.iter().find(|k| (k.0, k.1, k.2) == (facet, c, copy)) {
                    return known.3;
                }
                let point = self.corner_point(c, copy, facets);
                let first = self.chain_points.len() as u32;
                self.chain_points.push(point);
                let chain = self.chains.len() as u32;
                self.chains.push(Chain { facet, first, len: 1, next: NONE });
                self.corner_chains.push((facet, c, copy, chain));
                chain
            }
        }
    }

    fn corner_point(&mut self, c: u8, copy: u16, facets: &Facets) -> u32 {
        if let Some(known) = self.corner_points.iter().find(|k| (k.0, k.1) == (c, copy)) {
            return known.2;
        }
        let point = self.points.len() as u32;
        self.points.push((WallPoint::Corner(c), facets.corners[c as usize]));
        self.corner_points.push((c, copy, point));
        point
    }
}
