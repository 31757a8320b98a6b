//! Thins walls that were cut again (MATHS 5.7).
//!
//! A wall is a flat facet in triangles. A later box puts a vertex on every edge between two of them that it crosses, which the
//! shape does not need; the next box crosses the edges that end there, and so on: vertices would grow by half with every box.
//! And planes that nearly fall together meet in points that stored positions cannot tell apart. So a vertex with walls alone
//! around it is collapsed into a neighbour where that changes no wall by more than the grain of positions; walls that tissue
//! has bent since they were made are flat nowhere, and get a slack of their own. A vertex of a lip goes in the same way, along the lip,
//! where that is straight: parts of one face of the loaded model are a facet, too. No vertex is moved.

use crate::geometry::{FaceId, HalfEdge, Mesh, VertexId, Wedge, WedgeId};
use glam::DVec3;

/// Doubled area over the longest side squared that a collapse may leave a triangle with where there was none worse.
const THINNEST: f64 = 1e-5;

/// An edge that leaves the vertex, with the face to its left, which runs on to the next spoke.
#[derive(Clone, Copy, Debug)]
struct Spoke {
    edge: HalfEdge,
    to: VertexId,
    /// The other end, seen from the vertex.
    at: DVec3,
    sector: usize,
}

/// Successive faces around a vertex that share its wedge's group: one facet.
#[derive(Clone, Copy, Debug, Default)]
struct Sector {
    /// Unit normal; zero where the faces are no wider than the grain.
    normal: DVec3,
    /// How far the corners are off its plane, metres; infinite without a normal.
    off: f64,
    /// It is of the model's own surface.
    is_skin: bool,
}

/// What a collapse may change, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slack {
    /// Of facets that are flat to within this.
    pub grain: f64,
    /// Of facets that the tissue has bent since they were made; the same where it has held still.
    pub bent: f64,
}

impl Slack {
    fn is_still(&self) -> bool {
        self.bent == self.grain
    }

    fn of(&self, sector: &Sector) -> f64 {
        if sector.off <= self.grain { self.grain } else { self.bent }
    }
}

/// Buffers, kept between steps.
#[derive(Debug, Default)]
pub(super) struct Thinner {
    spokes: Vec<Spoke>,
    sectors: Vec<Sector>,
    targets: Vec<(f64, usize)>,
    wedges: Vec<(HalfEdge, WedgeId)>,
    /// Wedges of the neighbour, by sector.
    dressed: Vec<(usize, WedgeId)>,
    next: Vec<VertexId>,
    /// Result: faces with another corner than before, sorted; some may be gone.
    pub changed: Vec<FaceId>,
    /// Result: vertices that are gone.
    pub gone: Vec<VertexId>,
}

impl Thinner {
    /// Makes room for walls on rims of so many edges.
    pub fn make_room(&mut self, edges: usize) {
        self.spokes.reserve(edges);
        self.sectors.reserve(edges);
        self.targets.reserve(edges);
        self.wedges.reserve(edges);
        self.dressed.reserve(edges);
        self.next.reserve(edges);
        self.changed.reserve(edges);
        self.gone.reserve(edges);
    }

    /// Collapses what it can of `vertices` and what is around them; `may` tells whether a vertex may go into another.
    pub fn thin(
        &mut self,
        mesh: &mut Mesh,
        vertices: &mut Vec<VertexId>,
        slack: Slack,
        at: &impl Fn(VertexId) -> DVec3,
        may: &impl Fn(VertexId, VertexId) -> bool,
    ) {
        self.changed.clear();
        self.gone.clear();
        while !vertices.is_empty() {
            vertices.sort_unstable();
            vertices.dedup();
            self.next.clear();
            for &v in vertices.iter() {
                if self.look_around(mesh, v, slack, at) && self.collapse(mesh, v, slack, may) {
                    self.gone.push(v);
                    self.next.extend(self.spokes.iter().map(|s| s.to));
                }
            }
            std::mem::swap(vertices, &mut self.next);
        }
        self.changed.sort_unstable();
        self.changed.dedup();
    }

    /// Collects spokes and sectors. False if anything but walls is around the vertex and, in tissue that has held still, parts of one face
    /// of the loaded model, or an edge is open.
    fn look_around(&mut self, mesh: &Mesh, v: VertexId, slack: Slack, at: &impl Fn(VertexId) -> DVec3) -> bool {
        self.spokes.clear();
        self.sectors.clear();
        if !mesh.vertex_is_live(v) {
            return false;
        }
        let here = at(v);
        let mut skin = None;
        for edge in mesh.fan(v) {
            let info = mesh.face_info(edge.face());
            let may_go = info.is_interior() || slack.is_still() && *skin.get_or_insert(info.origin) == info.origin;
            if !may_go || mesh.opposite(edge).is_none() {
                return false;
            }
            let to = mesh.to(edge);
            self.spokes.push(Spoke { edge, to, at: at(to) - here, sector: 0 });
        }
        let n = self.spokes.len();
        if n < 3 {
            return false;
        }
        let is_skin = |s: &Spoke| !mesh.is_interior(s.edge.face());
        let group = |s: &Spoke| match is_skin(s) {
            true => WedgeId::NONE,
            false => mesh.wedge(mesh.face_wedges(s.edge.face())[s.edge.corner()]).group,
        };
        let begins = |spokes: &[Spoke], i: usize| group(&spokes[i]) != group(&spokes[(i + n - 1) % n]);
        let first = (0..n).find(|&i| begins(&self.spokes, i)).unwrap_or(0);
        self.spokes.rotate_left(first);
        for i in 0..n {
            if i == 0 || begins(&self.spokes, i) {
                self.sectors.push(Sector { is_skin: is_skin(&self.spokes[i]), ..Sector::default() });
            }
            self.spokes[i].sector = self.sectors.len() - 1;
        }
        for k in 0..self.sectors.len() {
            self.sectors[k] = Sector { is_skin: self.sectors[k].is_skin, ..self.sector(k, slack.grain) };
        }
        true
    }

    fn sector(&self, k: usize, grain: f64) -> Sector {
        let faces = || self.faces().filter(move |f| f.2 == k);
        let across: DVec3 = faces().map(|(p, q, _)| p.cross(q)).sum();
        let corners = || faces().flat_map(|(p, q, _)| [p, q]);
        let reach = corners().map(DVec3::length).fold(0.0, f64::max);
        if across.length() <= grain * reach {
            return Sector { off: f64::INFINITY, ..Sector::default() };
        }
        let normal = across.normalize_or_zero();
        Sector { normal, off: corners().map(|p| p.dot(normal).abs()).fold(0.0, f64::max), is_skin: false }
    }

    /// The two far corners of each face around the vertex, and its sector.
    fn faces(&self) -> impl Iterator<Item = (DVec3, DVec3, usize)> + '_ {
        let n = self.spokes.len();
        (0..n).map(move |i| (self.spokes[i].at, self.spokes[(i + 1) % n].at, self.spokes[i].sector))
    }

    /// Collapses `v`, the vertex looked at, into the neighbour that leaves the best shapes.
    fn collapse(&mut self, mesh: &mut Mesh, v: VertexId, slack: Slack, may: &impl Fn(VertexId, VertexId) -> bool) -> bool {
        let n = self.spokes.len();
        let worst = self.faces().map(|(p, q, k)| shape(DVec3::ZERO, p, q, self.sectors[k].normal)).fold(THINNEST, f64::min);
        let mut targets = std::mem::take(&mut self.targets);
        targets.clear();
        targets.extend((0..n).filter_map(|j| Some((self.worth(j, worst.max(0.0), slack)?, j))));
        targets.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let found = targets.iter().map(|t| t.1).find(|&j| may(v, self.spokes[j].to) && self.keeps_manifold(mesh, j));
        self.targets = targets;
        if let Some(j) = found {
            self.dress(mesh, j);
            mesh.collapse_edge(self.spokes[j].edge, &self.wedges);
            self.changed.extend(self.wedges.iter().map(|w| w.0.face()));
        }
        found.is_some()
    }

    /// Worst shape of the faces that a collapse into spoke `j` leaves, if it is allowed.
    fn worth(&self, j: usize, worst: f64, slack: Slack) -> Option<f64> {
        let n = self.spokes.len();
        let u = self.spokes[j].at;
        let left = || self.faces().enumerate().filter(move |(i, _)| *i != j && (i + 1) % n != j).map(|f| f.1);
        let [before, after] = [self.spokes[(j + n - 1) % n].sector, self.spokes[j].sector];
        if self.sectors.iter().any(|k| k.is_skin) && ![before, after].iter().any(|&k| self.sectors[k].is_skin) {
            return None; // a vertex of the skin goes into another
        }
        let widest = self.sectors.iter().map(|k| slack.of(k)).fold(slack.grain, f64::max);
        if u.length() <= widest {
            // all within the slack, however the triangles turn in it
            let turned =
                |p: DVec3, q: DVec3, k: usize| (p - u).cross(q - u).dot(self.sectors[k].normal) < -widest * (q - p).length();
            return left().all(|(p, q, k)| !turned(p, q, k)).then_some(f64::INFINITY);
        }
        // only inside a facet, or along an edge between two
        let held = |k: &Sector| k.off <= slack.of(k) && k.normal.dot(u).abs() <= slack.of(k);
        if self.sectors.len() > 2 || (self.sectors.len() == 2 && before == after) || !self.sectors.iter().all(held) {
            return None;
        }
        if self.sectors[before].is_skin != self.sectors[after].is_skin && !self.is_straight(j, slack.grain) {
            return None;
        }
        let least = left().map(|(p, q, k)| shape(u, p, q, self.sectors[k].normal)).fold(f64::INFINITY, f64::min);
        (least > 0.0 && least >= worst).then_some(least)
    }

    /// True if the lip that spoke `j` is of goes straight on at the vertex.
    fn is_straight(&self, j: usize, grain: f64) -> bool {
        let n = self.spokes.len();
        let u = self.spokes[j].at;
        let other = (0..n).filter(|&i| i != j && self.spokes[i].sector != self.spokes[(i + n - 1) % n].sector);
        other.map(|i| self.spokes[i].at).all(|w| w.cross(u).length() <= grain * w.distance(u))
    }

    /// The link condition: no two faces fall together.
    fn keeps_manifold(&self, mesh: &Mesh, j: usize) -> bool {
        let n = self.spokes.len();
        let u = self.spokes[j].to;
        let is_near = |w: VertexId| self.spokes.iter().filter(|s| s.to == w).count();
        let beside = [self.spokes[(j + n - 1) % n].to, self.spokes[(j + 1) % n].to];
        self.spokes.iter().all(|s| is_near(s.to) == 1)
            && mesh.neighbours(u).map(is_near).sum::<usize>() == 2
            && beside.iter().all(|&w| mesh.fan(w).take(4).count() > 3)
    }

    /// The wedges at the neighbour for the faces that stay.
    fn dress(&mut self, mesh: &mut Mesh, j: usize) {
        let n = self.spokes.len();
        let (edge, u) = (self.spokes[j].edge, self.spokes[j].to);
        let back = mesh.opposite(edge);
        let beyond = [(j + n - 1) % n, j].map(|i| self.spokes[i].sector);
        let there = [back, edge.next()].map(|h| mesh.face_wedges(h.face())[h.corner()]);
        self.wedges.clear();
        let copies = &mut self.dressed;
        copies.clear();
        copies.extend([(beyond[1], there[1]), (beyond[0], there[0])]);
        for i in (0..n).filter(|&i| i != j && (i + 1) % n != j) {
            let Spoke { edge, sector, .. } = self.spokes[i];
            let known = copies.iter().find(|c| c.0 == sector).map(|c| c.1);
            let wedge = known.unwrap_or_else(|| {
                let old = mesh.wedge(mesh.face_wedges(edge.face())[edge.corner()]);
                let copy = mesh.add_wedge(Wedge { vertex: u, group: WedgeId::NONE, ..old });
                copies.push((sector, copy));
                copy
            });
            self.wedges.push((edge, wedge));
        }
    }
}

/// Doubled area along `normal` over the longest side squared.
fn shape(a: DVec3, b: DVec3, c: DVec3, normal: DVec3) -> f64 {
    let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    if longest > 0.0 { (b - a).cross(c - a).dot(normal) / longest } else { 0.0 }
}
