//! Cuts a ring of corners into ears: the middle step of [`super::triangulate`].
//!
//! Cutting any ear off an abstract ring is sound: the ring's edges end in one triangle each, the diagonals in two. Geometry
//! chooses the ear, in levels: proper and empty ones first, then those that are spoilt only by touching, then any. No
//! diagonal may join two points that are joined already, since that would make an edge of four triangles.

use super::fx::FxHashMap;
use super::predicates::orient2d;

/// No half-edge, no node.
pub(super) const NONE: u32 = u32::MAX;

/// Pairs of points that some edge joins.
#[derive(Debug, Default)]
pub(crate) struct Pairs {
    joined: FxHashMap<u64, ()>,
    /// One ring of distinct corners and nothing taken: ears cannot join a pair twice, so nobody counts.
    idle: bool,
}

impl Pairs {
    /// Makes room for so many pairs.
    pub(crate) fn make_room(&mut self, pairs: usize) {
        self.joined.reserve(pairs);
    }
}

fn key(a: u32, b: u32) -> u64 {
    u64::from(a.min(b)) << 32 | u64::from(a.max(b))
}

impl Pairs {
    /// Starts with the edges of `rings` and the pairs in `taken`.
    pub fn reset(&mut self, rings: &[&[u32]], taken: &[[u32; 2]], idle: bool) {
        self.joined.clear();
        self.idle = idle;
        if idle {
            return;
        }
        for ring in rings {
            self.joined.extend((0..ring.len()).map(|i| (key(ring[i], ring[(i + 1) % ring.len()]), ())));
        }
        self.joined.extend(taken.iter().map(|t| (key(t[0], t[1]), ())));
    }

    pub fn contains(&self, a: u32, b: u32) -> bool {
        !self.idle && self.joined.contains_key(&key(a, b))
    }

    /// Notes an edge; false if there was one.
    pub fn insert(&mut self, a: u32, b: u32) -> bool {
        self.idle || self.joined.insert(key(a, b), ()).is_none()
    }

    pub fn remove(&mut self, a: u32, b: u32) {
        if !self.idle {
            self.joined.remove(&key(a, b));
        }
    }
}

/// A corner of the ring.
#[derive(Clone, Copy, Debug)]
struct Node {
    corner: u32,
    prev: u32,
    next: u32,
    /// What lies across the edge to the next node: a half-edge `3 t + k` of a triangle, a bridge (see [`BRIDGE`]), or nothing.
    across: u32,
    /// True if the ring turns right or not at all here.
    reflex: bool,
}

/// Bridges are numbered from here on as `across`.
const BRIDGE: u32 = 1 << 31;

/// The ring and its search grid; buffers are kept.
#[derive(Debug, Default)]
pub(super) struct Ears {
    nodes: Vec<Node>,
    /// Result: opposite half-edge of each half-edge `3 t + k`, `NONE` along the loops.
    pub opposite: Vec<u32>,
    bridges: Vec<u32>,
    grid: Grid,
}

/// How much geometry an ear has to satisfy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Level {
    /// Turns left, nothing in the closed triangle.
    Proper,
    /// Turns left, nothing inside or on the diagonal.
    Touching,
    /// Turns left.
    Crossed,
    /// Anything.
    Forced,
}

impl Ears {
    /// Joins the holes `rings[1..]` to `rings[0]` and cuts the ring into ears, appended to `out`. Returns how many were forced,
    /// or `None` if no diagonal was left that joins two points not joined yet: `out` then holds a part, and [`Ears::fan`]
    /// is the way out.
    pub fn cut(&mut self, points: &[[f64; 2]], rings: &[&[u32]], pairs: &mut Pairs, out: &mut Vec<[u32; 3]>) -> Option<usize> {
        self.start(rings);
        let mut start = 0;
        let mut first = rings[0].len() as u32;
        for hole in &rings[1..] {
            start = self.bridge(points, start, first, hole.len() as u32, pairs)?;
            first += hole.len() as u32;
        }
        for n in 0..self.nodes.len() as u32 {
            self.nodes[n as usize].reflex = self.turn(points, n) <= 0.0;
        }
        self.grid.build(points, &self.nodes);
        let mut left = self.nodes.len();
        let (mut at, mut stop, mut level, mut forced) = (start, start, Level::Proper, 0);
        while left > 3 {
            if self.is_ear(points, at, level, pairs) {
                forced += usize::from(level >= Level::Crossed);
                at = self.clip(points, at, pairs, out);
                left -= 1;
                (stop, level) = (at, Level::Proper);
                continue;
            }
            at = self.nodes[at as usize].next;
            if at == stop {
                level = match level {
                    Level::Proper => Level::Touching,
                    Level::Touching => Level::Crossed,
                    Level::Crossed => Level::Forced,
                    Level::Forced => return None,
                };
            }
        }
        self.close(at, out);
        Some(forced)
    }

    /// Rings as nodes, each linked in itself.
    fn start(&mut self, rings: &[&[u32]]) {
        self.nodes.clear();
        self.opposite.clear();
        self.bridges.clear();
        for ring in rings {
            let (first, len) = (self.nodes.len() as u32, ring.len() as u32);
            self.nodes.extend(ring.iter().zip(0..).map(|(&corner, i)| Node {
                corner,
                prev: first + (i + len - 1) % len,
                next: first + (i + 1) % len,
                across: NONE,
                reflex: false,
            }));
        }
    }

    fn point(&self, points: &[[f64; 2]], n: u32) -> [f64; 2] {
        points[self.nodes[n as usize].corner as usize]
    }

    fn turn(&self, points: &[[f64; 2]], n: u32) -> f64 {
        let node = self.nodes[n as usize];
        orient2d(self.point(points, node.prev), self.point(points, n), self.point(points, node.next))
    }

    /// Joins the hole with nodes `first..first + len` to the ring of `ring`; returns a node of the ring. The ring's node `m`
    /// and the hole's leftmost node `h` are doubled: ... m h ... h' m' ... `None` if they are joined already.
    fn bridge(&mut self, points: &[[f64; 2]], ring: u32, first: u32, len: u32, pairs: &mut Pairs) -> Option<u32> {
        let leftmost = |a: &u32, b: &u32| {
            let (p, q) = (self.point(points, *a), self.point(points, *b));
            p[0].total_cmp(&q[0]).then(p[1].total_cmp(&q[1]))
        };
        let h = (first..first + len).min_by(leftmost).unwrap_or(first);
        let m = self.visible(points, ring, h, pairs);
        if !pairs.insert(self.nodes[m as usize].corner, self.nodes[h as usize].corner) {
            return None;
        }
        let (h2, m2) = (self.nodes.len() as u32, self.nodes.len() as u32 + 1);
        let (old_m, old_h) = (self.nodes[m as usize], self.nodes[h as usize]);
        let bridge = BRIDGE + self.bridges.len() as u32;
        self.bridges.push(NONE);
        self.nodes.push(Node { prev: old_h.prev, next: m2, across: bridge, ..old_h });
        self.nodes.push(Node { prev: h2, next: old_m.next, ..old_m });
        self.nodes[old_h.prev as usize].next = h2;
        self.nodes[old_m.next as usize].prev = m2;
        self.nodes[m as usize].next = h;
        self.nodes[m as usize].across = bridge;
        self.nodes[h as usize].prev = m;
        Some(m)
    }

    /// A node of the ring that `h` can see to its left (Eberly, "Triangulation by Ear Clipping"): the nearer end of the edge
    /// that a ray hits first, or the reflex corner in between with the smallest angle to the ray. Where rounding leaves
    /// none, the nearest one.
    fn visible(&self, points: &[[f64; 2]], ring: u32, h: u32, pairs: &Pairs) -> u32 {
        let p = self.point(points, h);
        let (mut hit, mut found) = (f64::NEG_INFINITY, NONE);
        let mut n = ring;
        loop {
            let node = self.nodes[n as usize];
            let (a, b) = (self.point(points, n), self.point(points, node.next));
            if a[1] >= p[1] && p[1] >= b[1] && a[1] != b[1] {
                let x = a[0] + (p[1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1]);
                if x <= p[0] && x > hit {
                    hit = x;
                    found = if a[0] < b[0] { n } else { node.next };
                }
            }
            n = node.next;
            if n == ring {
                break;
            }
        }
        let free = |n: u32| !pairs.contains(self.nodes[n as usize].corner, self.nodes[h as usize].corner);
        let mut best = (f64::INFINITY, f64::INFINITY, NONE);
        if found != NONE {
            let m = self.point(points, found);
            let corners = if p[1] < m[1] { [[hit, p[1]], p, m] } else { [p, [hit, p[1]], m] };
            let mut n = ring;
            loop {
                let q = self.point(points, n);
                let inside = (0..3).all(|k| orient2d(corners[k], corners[(k + 1) % 3], q) >= 0.0);
                if q[0] <= p[0] && (inside || q == m) && self.in_cone(points, n, p) && free(n) {
                    let distance = p[0] - q[0];
                    let slope = if distance > 0.0 { (p[1] - q[1]).abs() / distance } else { 0.0 };
                    if (slope, distance) < (best.0, best.1) {
                        best = (slope, distance, n);
                    }
                }
                n = self.nodes[n as usize].next;
                if n == ring {
                    break;
                }
            }
        }
        if best.2 != NONE { best.2 } else { self.nearest(points, ring, p, free) }
    }

    fn nearest(&self, points: &[[f64; 2]], ring: u32, p: [f64; 2], free: impl Fn(u32) -> bool) -> u32 {
        let mut best = (f64::INFINITY, ring);
        let mut n = ring;
        loop {
            let q = self.point(points, n);
            let penalty = if self.in_cone(points, n, p) { 1.0 } else { 1e6 } * if free(n) { 1.0 } else { 1e12 };
            let distance = penalty * ((p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2));
            if distance < best.0 {
                best = (distance, n);
            }
            n = self.nodes[n as usize].next;
            if n == ring {
                return best.1;
            }
        }
    }

    /// True if `p` lies in the ring's inner angle at node `n`.
    fn in_cone(&self, points: &[[f64; 2]], n: u32, p: [f64; 2]) -> bool {
        let node = self.nodes[n as usize];
        let (a, b, c) = (self.point(points, node.prev), self.point(points, n), self.point(points, node.next));
        let (after, before) = (orient2d(b, c, p), orient2d(a, b, p));
        if orient2d(a, b, c) > 0.0 { after >= 0.0 && before >= 0.0 } else { after >= 0.0 || before >= 0.0 }
    }

    fn is_ear(&self, points: &[[f64; 2]], n: u32, level: Level, pairs: &Pairs) -> bool {
        let node = self.nodes[n as usize];
        let (prev, next) = (self.nodes[node.prev as usize], self.nodes[node.next as usize]);
        if prev.corner == next.corner || prev.corner == node.corner || node.corner == next.corner {
            return false;
        }
        if level == Level::Proper && node.reflex {
            return false;
        }
        if pairs.contains(prev.corner, next.corner) {
            return false;
        }
        let corners = [prev.corner, node.corner, next.corner].map(|c| points[c as usize]);
        match level {
            Level::Forced => true,
            Level::Crossed => !node.reflex,
            _ => !node.reflex && !self.grid.blocks(points, &self.nodes, corners, level == Level::Touching),
        }
    }

    /// Cuts the ear at `n` off; returns where to look on.
    fn clip(&mut self, points: &[[f64; 2]], n: u32, pairs: &mut Pairs, out: &mut Vec<[u32; 3]>) -> u32 {
        let Node { corner, prev, next, across, .. } = self.nodes[n as usize];
        let (a, c) = (self.nodes[prev as usize], self.nodes[next as usize]);
        let t = self.push([a.corner, corner, c.corner], [a.across, across, NONE], out);
        pairs.insert(a.corner, c.corner);
        self.nodes[n as usize].reflex = false;
        self.nodes[prev as usize].next = next;
        self.nodes[prev as usize].across = 3 * t + 2;
        self.nodes[next as usize].prev = prev;
        for k in [prev, next] {
            if self.nodes[k as usize].reflex {
                self.nodes[k as usize].reflex = self.turn(points, k) <= 0.0;
            }
        }
        self.nodes[next as usize].next
    }

    /// The last three nodes.
    fn close(&mut self, n: u32, out: &mut Vec<[u32; 3]>) {
        let b = self.nodes[n as usize];
        let (a, c) = (self.nodes[b.prev as usize], self.nodes[b.next as usize]);
        self.push([a.corner, b.corner, c.corner], [a.across, b.across, c.across], out);
    }

    /// Adds a triangle whose edge `k` has `across[k]` on its other side; returns its number among those of this ring.
    fn push(&mut self, corners: [u32; 3], across: [u32; 3], out: &mut Vec<[u32; 3]>) -> u32 {
        let t = self.opposite.len() as u32 / 3;
        out.push(corners);
        for k in 0..3 {
            let h = 3 * t + k;
            let mut other = across[k as usize];
            if other != NONE && other >= BRIDGE {
                other = std::mem::replace(&mut self.bridges[(other - BRIDGE) as usize], h);
            }
            self.opposite.push(other);
            if other != NONE {
                self.opposite[other as usize] = h;
            }
        }
        t
    }

    /// The way out that always works for rings of distinct corners: each hole is joined by two triangles, which leaves a ring
    /// of distinct corners, and the ring is laid out as a fan from a corner that no inner edge meets. Returns how many
    /// inner edges join points that were joined before.
    pub fn fan(&mut self, rings: &[&[u32]], pairs: &mut Pairs, out: &mut Vec<[u32; 3]>) -> usize {
        self.start(rings);
        let mut repeated = 0;
        let mut first = rings[0].len() as u32;
        // the edge of the ring that the next hole is joined to, and the fan's corner
        let (mut r0, mut apex) = (0, 0);
        for hole in &rings[1..] {
            let len = hole.len() as u32;
            let r1 = self.nodes[r0 as usize].next;
            let (h0, h1) = (first, first + 1);
            let [cr0, cr1, ch0, ch1] = [r0, r1, h0, h1].map(|n| self.nodes[n as usize].corner);
            for (a, b) in [(cr0, ch0), (ch0, cr1), (cr0, ch1)] {
                repeated += usize::from(!pairs.insert(a, b));
            }
            let across = self.nodes[r0 as usize].across;
            let t = self.push([cr0, cr1, ch0], [across, NONE, NONE], out);
            let u = self.push([cr0, ch0, ch1], [3 * t + 2, NONE, NONE], out);
            self.nodes[r0 as usize].next = h1;
            self.nodes[r0 as usize].across = 3 * u + 2;
            self.nodes[h1 as usize].prev = r0;
            self.nodes[h0 as usize].next = r1;
            self.nodes[h0 as usize].across = 3 * t + 1;
            self.nodes[r1 as usize].prev = h0;
            (r0, apex) = (h1, first + 2);
            first += len;
        }
        let chords = |ears: &Self, pairs: &Pairs, apex: u32| {
            let node = ears.nodes[apex as usize];
            let mut n = ears.nodes[node.next as usize].next;
            let mut count = 0;
            while n != node.prev && n != apex {
                count += usize::from(pairs.contains(node.corner, ears.nodes[n as usize].corner));
                n = ears.nodes[n as usize].next;
            }
            count
        };
        // pairs that are taken from outside may stand against this corner: look for a better one
        let mut best = (chords(self, pairs, apex), apex);
        let mut n = self.nodes[apex as usize].next;
        while best.0 > 0 && n != apex {
            best = best.min((chords(self, pairs, n), n));
            n = self.nodes[n as usize].next;
        }
        apex = best.1;
        loop {
            let node = self.nodes[apex as usize];
            let tip = self.nodes[node.next as usize];
            if tip.next == node.prev {
                self.close(node.next, out);
                return repeated;
            }
            let far = self.nodes[tip.next as usize].corner;
            let t = self.push([node.corner, tip.corner, far], [node.across, tip.across, NONE], out);
            repeated += usize::from(!pairs.insert(node.corner, far));
            self.nodes[apex as usize].next = tip.next;
            self.nodes[apex as usize].across = 3 * t + 2;
            self.nodes[tip.next as usize].prev = apex;
        }
    }
}

/// Reflex nodes by place.
#[derive(Debug, Default)]
struct Grid {
    low: [f64; 2],
    per_metre: [f64; 2],
    size: [usize; 2],
    starts: Vec<u32>,
    nodes: Vec<u32>,
}

impl Grid {
    fn build(&mut self, points: &[[f64; 2]], nodes: &[Node]) {
        let at = |n: &Node| points[n.corner as usize];
        let reflex = || nodes.iter().filter(|n| n.reflex);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for p in reflex().map(at) {
            for k in 0..2 {
                low[k] = low[k].min(p[k]);
                high[k] = high[k].max(p[k]);
            }
        }
        let side = ((reflex().count() as f64).sqrt().ceil() as usize).clamp(1, 512);
        self.size = [side; 2];
        self.low = low;
        self.per_metre = std::array::from_fn(|k| if high[k] > low[k] { side as f64 / (high[k] - low[k]) } else { 0.0 });
        self.starts.clear();
        self.starts.resize(side * side + 1, 0);
        for n in reflex() {
            let cell = self.cell(at(n));
            self.starts[cell] += 1;
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        self.nodes.clear();
        self.nodes.resize(sum as usize, NONE);
        // each cell is filled from its end, so that what counted its end becomes its start
        for (i, n) in nodes.iter().enumerate().filter(|(_, n)| n.reflex) {
            let cell = self.cell(at(n));
            self.starts[cell] -= 1;
            self.nodes[self.starts[cell] as usize] = i as u32;
        }
    }

    fn axis(&self, k: usize, x: f64) -> usize {
        (((x - self.low[k]) * self.per_metre[k]) as usize).min(self.size[k] - 1)
    }

    fn cell(&self, p: [f64; 2]) -> usize {
        self.axis(1, p[1]) * self.size[0] + self.axis(0, p[0])
    }

    /// True if a reflex node lies in the triangle, or on it; with `touching`, only inside or on the edge from the last
    /// corner to the first. Nodes at a corner's place do not count.
    fn blocks(&self, points: &[[f64; 2]], nodes: &[Node], [a, b, c]: [[f64; 2]; 3], touching: bool) -> bool {
        let low: [f64; 2] = std::array::from_fn(|k| a[k].min(b[k]).min(c[k]));
        let high: [f64; 2] = std::array::from_fn(|k| a[k].max(b[k]).max(c[k]));
        let blocked = |n: u32| {
            let node = nodes[n as usize];
            let p = points[node.corner as usize];
            if !node.reflex || p == a || p == b || p == c || (0..2).any(|k| p[k] < low[k] || p[k] > high[k]) {
                return false;
            }
            let (ab, bc, ca) = (orient2d(a, b, p), orient2d(b, c, p), orient2d(c, a, p));
            if touching { ab > 0.0 && bc > 0.0 && ca >= 0.0 } else { ab >= 0.0 && bc >= 0.0 && ca >= 0.0 }
        };
        (self.axis(1, low[1])..=self.axis(1, high[1])).any(|row| {
            let from = self.starts[row * self.size[0] + self.axis(0, low[0])];
            let to = self.starts[row * self.size[0] + self.axis(0, high[0]) + 1];
            self.nodes[from as usize..to as usize].iter().any(|&n| blocked(n))
        })
    }
}
