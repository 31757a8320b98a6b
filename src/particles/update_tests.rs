//! Laws of the map update, on small wounds made by hand.

use super::test_models::{self, Model, noise};
use super::wound_lines::NO_WOUND;
use super::*;
use crate::geometry::topology::{NewFace, TopologyScratch};
use crate::geometry::{FaceId, Mesh, ParticleId, StateHash, VertexId};
use glam::DVec3;

/// A torn tissue's soft layer.
struct Patient {
    mesh: Mesh,
    rest: Vec<DVec3>,
    map: ParticleMap,
    strips: Strips,
    settings: ParticleSettings,
    scratch: UpdateScratch,
}

/// What an edit handed to the update, owned.
#[derive(Default)]
struct Wound {
    new: Vec<NewVertex>,
    removed: Vec<VertexId>,
    lips: Vec<LipVertex>,
    strips: std::ops::Range<usize>,
}

impl Patient {
    fn new((mesh, rest): Model, settings: ParticleSettings) -> Self {
        let anchors = sample(&mesh, &rest, settings.spacing, 3);
        let (map, report) = ParticleMap::build(&mesh, &rest, &anchors, &settings);
        assert_eq!(report.unreached, 0);
        Self { mesh, rest, map, strips: Strips::default(), settings, scratch: UpdateScratch::default() }
    }

    fn hash(&self) -> u64 {
        let mut hash = StateHash::default();
        self.map.hash_into(&mut hash);
        self.strips.hash_into(&mut hash);
        hash.finish()
    }

    fn update(&mut self, wound: &Wound) -> MapUpdateReport {
        let edit = MapEdit {
            new_vertices: &wound.new,
            removed_vertices: &wound.removed,
            new_strips: wound.strips.clone(),
            goes_on_from: None,
            opened: [0.0; 2],
            lips: &wound.lips,
        };
        let Self { mesh, rest, map, strips, settings, scratch } = self;
        update_after_edit(mesh, rest, map, strips, &edit, settings, scratch)
    }

    /// Splits fans around `vertices`; copies become new vertices.
    fn split(&mut self, vertices: &[VertexId], wound: &mut Wound) {
        let mut topology = TopologyScratch::default();
        let faces: Vec<FaceId> = self.mesh.live_faces().collect();
        let mut copies = Vec::new();
        self.mesh.split_fans(vertices, &faces, &mut topology, &mut copies);
        for copy in copies {
            self.rest.push(self.rest[copy.from.index()]);
            let parents = [copy.from, VertexId::NONE, VertexId::NONE];
            wound.new.push(NewVertex { vertex: copy.vertex, parents, is_apart: false });
        }
    }

    /// Opens the edges on the line `y` = const between `x0` and `x1` of a grid without jitter: a slit of width 0, one
    /// strip for each of `pieces`.
    fn slit(&mut self, y: f64, x0: f64, x1: f64, pieces: usize) -> Wound {
        let mut wound = Wound::default();
        let on = |p: DVec3| (p.y - y).abs() < 1e-9 && p.x > x0 - 1e-9 && p.x < x1 + 1e-9;
        let mut line = Vec::new();
        for f in self.mesh.live_faces().collect::<Vec<_>>() {
            for k in 0..3 {
                let h = crate::geometry::HalfEdge::of(f, k);
                let ends = [self.mesh.from(h), self.mesh.to(h)];
                if ends.iter().all(|v| on(self.rest[v.index()])) && self.mesh.opposite(h).is_some() {
                    self.mesh.open_edge(h);
                    line.extend(ends);
                }
            }
        }
        line.sort_unstable();
        line.dedup();
        self.split(&line, &mut wound);
        let first = self.strips.len();
        let slit = self.strips.next_slit();
        let step = (x1 - x0) / pieces as f64;
        for i in 0..pieces {
            let at = |k: usize, z: f64| DVec3::new(x0 + step * (i + k) as f64, y, z);
            self.strips.push([at(0, -0.05), at(1, -0.05), at(1, 0.02), at(0, 0.02)], self.settings.radius, slit).unwrap();
        }
        wound.strips = first..self.strips.len();
        let lips: Vec<VertexId> = line.iter().copied().chain(wound.new.iter().map(|n| n.vertex)).collect();
        for v in lips {
            let x = self.rest[v.index()].x;
            if x < x0 + 1e-9 || x > x1 - 1e-9 {
                continue; // the ends of the slit are not parted
            }
            let above = self.mesh.fan(v).map(|h| self.centre(h.face()).y - y).sum::<f64>() > 0.0;
            let strip = first + (((x - x0) / step) as usize).min(pieces - 1);
            wound.lips.push(LipVertex { vertex: v, strip, side: if above { -1 } else { 1 } });
        }
        wound
    }

    fn centre(&self, f: FaceId) -> DVec3 {
        self.mesh.face(f).iter().map(|v| self.rest[v.index()]).sum::<DVec3>() / 3.0
    }

    /// Takes out the faces whose centre is within `width` / 2 of the line from `a` to `b`: a jagged, wide wound.
    fn trench(&mut self, a: DVec3, b: DVec3, width: f64) -> Wound {
        let mut wound = Wound::default();
        let along = (b - a).normalize();
        let inside = |p: DVec3| {
            let t = (p - a).dot(along);
            t > 0.0 && t < a.distance(b) && (p - a - along * t).length() < 0.5 * width
        };
        let removed: Vec<FaceId> = self.mesh.live_faces().filter(|&f| inside(self.centre(f))).collect();
        let mut vertices: Vec<VertexId> = removed.iter().flat_map(|&f| self.mesh.face(f)).collect();
        vertices.sort_unstable();
        vertices.dedup();
        self.mesh.replace_faces(&removed, &[], |_| 0, &mut TopologyScratch::default());
        wound.removed = vertices.iter().copied().filter(|&v| !self.mesh.vertex_is_live(v)).collect();
        self.split(&vertices, &mut wound);
        let (first, slit) = (self.strips.len(), self.strips.next_slit());
        let (low, high) = (DVec3::Z * -0.1, DVec3::Z * 0.1);
        self.strips.push([a + low, b + low, b + high, a + high], self.settings.radius, slit).unwrap();
        wound.strips = first..first + 1;
        wound
    }

    /// Splits the edge of a half-edge at its middle.
    fn split_edge(&mut self, h: crate::geometry::HalfEdge) -> Option<NewVertex> {
        let back = self.mesh.opposite(h);
        if back.is_none() {
            return None;
        }
        let (a, b) = (self.mesh.from(h), self.mesh.to(h));
        let (c, d) = (self.mesh.from(h.prev()), self.mesh.from(back.prev()));
        let m = self.mesh.add_vertex();
        let wedge = self.mesh.wedge(self.mesh.face_wedges(h.face())[0]);
        let w = self.mesh.add_wedge(crate::geometry::Wedge { vertex: m, ..wedge });
        let info = self.mesh.face_info(h.face());
        let face = |corners: [VertexId; 3]| NewFace { corners, wedges: [w; 3], info, side: 0 };
        let added = [face([a, m, c]), face([m, b, c]), face([b, m, d]), face([m, a, d])];
        self.mesh.replace_faces(&[h.face(), back.face()], &added, |_| 0, &mut TopologyScratch::default());
        self.rest.push(0.5 * (self.rest[a.index()] + self.rest[b.index()]));
        Some(NewVertex { vertex: m, parents: [a, b, VertexId::NONE], is_apart: false })
    }

    /// The blade leaves the newest wound.
    fn release(&mut self) {
        let Self { mesh, rest, map, strips, settings, scratch } = self;
        let newest = strips.as_slice().iter().rev().map(|s| s.wound).find(|w| *w != NO_WOUND);
        release_wound((mesh, rest), map, strips, newest.expect("a wound"), settings, scratch);
    }

    /// How far its particles move a vertex when they rest.
    fn moved(&self, v: VertexId) -> DVec3 {
        let row = self.map.influences.row(v.index());
        row.iter().map(|e| DVec3::from_array(self.map.rest_displacement[e.particle.index()]) * f64::from(e.weight)).sum()
    }

    fn validate(&self) {
        self.map.validate(&self.mesh, &self.rest, &self.strips).unwrap();
    }
}

/// Links of `before` that no strip parts and whose ends are as they were, but that `after` lacks.
fn lost(before: &ParticleMap, after: &Patient) -> usize {
    let same = |j: ParticleId| before.anchors[j.index()] == after.map.anchors[j.index()];
    let anchor = |j: ParticleId| before.anchors[j.index()];
    let mut lost = 0;
    for v in (0..before.influences.rows()).map(VertexId::new).filter(|&v| after.mesh.vertex_is_live(v)) {
        for e in before.influences.row(v.index()).iter().filter(|e| same(e.particle)) {
            let kept = after.map.influences.row(v.index()).iter().any(|a| a.particle == e.particle);
            lost += usize::from(!kept && after.strips.connects_vertices(&after.rest, v, anchor(e.particle)));
        }
    }
    for j in (0..before.len()).map(ParticleId::new).filter(|&j| same(j)) {
        for l in before.neighbours.row(j.index()).iter().filter(|l| same(l.particle)) {
            let kept = after.map.neighbours.row(j.index()).iter().any(|a| a.particle == l.particle);
            lost += usize::from(!kept && after.strips.connects_vertices(&after.rest, anchor(j), anchor(l.particle)));
        }
    }
    lost
}

fn settings(spacing: f64, gap: f64) -> ParticleSettings {
    let mut settings = ParticleSettings::with_spacing(spacing);
    settings.wound.gap = gap;
    settings
}

#[test]
fn nothing_links_across_a_slit_and_nothing_else_is_lost() {
    for (gap, pieces) in [(0.0, 1), (0.05, 1), (0.05, 4)] {
        let mut patient = Patient::new(test_models::grid(30, 0.0, 1), settings(0.12, gap));
        let before = patient.map.clone();
        let wound = patient.slit(0.5, 0.3, 0.7, pieces);
        let report = patient.update(&wound);
        patient.validate();
        assert!(report.influences_removed > 50 && report.links_removed > 5, "{report:?}");
        assert_eq!(lost(&before, &patient), 0);
        assert_eq!(report.particles_added.is_empty(), gap == 0.0);
        let mut broken = before.clone();
        broken.influences.grow_rows(patient.mesh.vertex_slots());
        assert!(broken.validate(&patient.mesh, &patient.rest, &patient.strips).is_err(), "the old map must fail");
    }
}

#[test]
fn an_update_is_as_complete_as_a_map_built_anew() {
    let mut all = settings(0.12, 0.0);
    all.max_influences = 16;
    let mut patient = Patient::new(test_models::grid(30, 0.0, 1), all);
    let wound = patient.slit(0.5, 0.3, 0.7, 2);
    patient.update(&wound);
    let (anew, _) = ParticleMap::build(&patient.mesh, &patient.rest, &patient.map.anchors, &all);
    let mut crossing = 0;
    for v in patient.mesh.live_vertices() {
        for e in anew.influences.row(v.index()) {
            if patient.strips.connects_vertices(&patient.rest, v, anew.anchors[e.particle.index()]) {
                let has = patient.map.influences.row(v.index()).iter().any(|x| x.particle == e.particle);
                assert!(has, "{v:?} lacks {:?}", e.particle);
            } else {
                crossing += 1;
            }
        }
    }
    assert!(crossing > 0, "paths around the ends must have joined some across: else this shows nothing");
}

#[test]
fn several_wounds_one_after_the_other() {
    for seed in 0..12 {
        let mut patient = Patient::new(test_models::grid(24, 0.4, seed), settings(0.15, 0.04));
        for i in 0..5 {
            let draw = |k: u64| noise(seed * 1000 + i * 10 + k);
            let a = DVec3::new(0.1 + 0.8 * draw(0), 0.1 + 0.8 * draw(1), 0.0);
            let angle = 6.3 * draw(2);
            let b = a + DVec3::new(angle.cos(), angle.sin(), 0.0) * (0.2 + 0.3 * draw(3));
            let before = patient.map.clone();
            let wound = patient.trench(a, b, 0.06);
            patient.update(&wound);
            patient.validate();
            assert_eq!(lost(&before, &patient), 0, "seed {seed} wound {i}");
        }
    }
}

#[test]
fn slits_close_together_keep_their_sides() {
    let mut patient = Patient::new(test_models::grid(30, 0.0, 1), settings(0.12, 0.03));
    for (row, x0, x1, pieces) in [(15.0, 0.2, 0.8, 3), (16.0, 0.4, 0.9, 2), (14.0, 0.1, 0.5, 1), (15.0, 0.8, 0.9, 1)] {
        let before = patient.map.clone();
        let wound = patient.slit(row / 30.0, x0, x1, pieces);
        patient.update(&wound);
        patient.validate();
        assert_eq!(lost(&before, &patient), 0);
    }
}

/// Lips of a cut that left no strip of its own know their sides of the strip that goes on from it, and lie before that one's start.
#[test]
fn lips_before_the_start_of_a_strip_are_parted_by_it() {
    let mut patient = Patient::new(test_models::grid(30, 0.0, 1), settings(0.12, 0.0));
    let at = |p: &Patient, j: usize| p.rest[p.map.anchors[j].index()];
    let linked = |p: &Patient, j: usize, k: ParticleId| p.map.neighbours.row(j).iter().any(|l| l.particle == k);
    let pairs = (0..patient.map.len()).flat_map(|j| patient.map.neighbours.row(j).iter().map(move |l| (j, l.particle)));
    let (below, above) = pairs
        .max_by(|a, b| {
            f64::total_cmp(
                &(at(&patient, a.1.index()).y - at(&patient, a.0).y),
                &(at(&patient, b.1.index()).y - at(&patient, b.0).y),
            )
        })
        .unwrap();
    let (p, q) = (at(&patient, below), at(&patient, above.index()));
    let (x, y) = (p.x.max(q.x) + 0.01, 0.5 * (p.y + q.y));
    let corner = |x: f64, z: f64| DVec3::new(x, y, z);
    let quad = [corner(x, -0.05), corner(x + 0.05, -0.05), corner(x + 0.05, 0.02), corner(x, 0.02)];
    for knows in [false, true] {
        let strip = patient.strips.push(quad, patient.settings.radius, patient.strips.next_slit()).unwrap();
        let mut wound = Wound { strips: strip..strip + 1, ..Wound::default() };
        if knows {
            let lip = |j: usize, side| LipVertex { vertex: patient.map.anchors[j], strip, side };
            wound.lips = vec![lip(below, 1), lip(above.index(), -1)];
        }
        patient.update(&wound);
        assert_eq!(linked(&patient, below, above), !knows);
        patient.validate();
    }
}

#[test]
fn clipped_anchors_move_or_retire() {
    let mut counts = [0, 0];
    for width in [0.1, 0.4] {
        let mut patient = Patient::new(test_models::grid(30, 0.2, 1), settings(0.1, 0.0));
        let wound = patient.trench(DVec3::new(0.2, 0.5, 0.0), DVec3::new(0.8, 0.52, 0.0), width);
        let clipped = patient.map.anchors.iter().filter(|a| wound.removed.contains(a)).count();
        let report = patient.update(&wound);
        assert_eq!(report.reanchored.len() + report.retired.len(), clipped);
        patient.validate();
        assert!(report.retired.iter().all(|j| patient.map.anchors[j.index()].is_none()));
        counts[0] += report.reanchored.len();
        counts[1] += report.retired.len();
    }
    assert!(counts[0] > 2 && counts[1] > 2, "{counts:?}");
}

#[test]
fn split_edges_inherit_and_complete_their_rows() {
    let mut patient = Patient::new(test_models::sphere(12), settings(0.4, 0.0));
    let mut wound = Wound::default();
    for i in 0..40 {
        let faces: Vec<FaceId> = patient.mesh.live_faces().collect();
        let f = faces[(noise(i) * faces.len() as f64) as usize];
        wound.new.extend(patient.split_edge(crate::geometry::HalfEdge::of(f, (i % 3) as usize)));
    }
    let report = patient.update(&wound);
    patient.validate();
    assert!(wound.new.iter().all(|n| report.vertices_changed.contains(&n.vertex)));
    let (anew, _) = ParticleMap::build(&patient.mesh, &patient.rest, &patient.map.anchors, &patient.settings);
    for n in &wound.new {
        let weight = |map: &ParticleMap, j: ParticleId| {
            map.influences.row(n.vertex.index()).iter().find(|e| e.particle == j).map_or(0.0, |e| e.weight)
        };
        for j in (0..patient.map.len()).map(ParticleId::new) {
            assert!((weight(&patient.map, j) - weight(&anew, j)).abs() < 1e-3);
        }
    }
}

#[test]
fn an_update_undoes_and_redoes_exactly() {
    let mut patient = Patient::new(test_models::grid(24, 0.3, 5), settings(0.15, 0.04));
    let mut states = vec![patient.hash()];
    let mut undo = Vec::new();
    for i in 0..3 {
        let y = 0.25 + 0.25 * f64::from(i);
        let wound = patient.trench(DVec3::new(0.2, y, 0.0), DVec3::new(0.8, y + 0.05, 0.0), 0.07);
        let report = patient.update(&wound);
        assert!(!report.particles_added.is_empty() || !report.vertices_changed.is_empty());
        undo.push((patient.map.take_delta(), patient.strips.take_delta()));
        states.push(patient.hash());
    }
    let mut redo = Vec::new();
    for state in states[..3].iter().rev() {
        let (map, strips) = undo.pop().unwrap();
        redo.push((patient.map.apply_delta(map), patient.strips.apply_delta(strips)));
        assert_eq!(patient.hash(), *state);
    }
    for state in &states[1..] {
        let (map, strips) = redo.pop().unwrap();
        patient.map.apply_delta(map);
        patient.strips.apply_delta(strips);
        assert_eq!(patient.hash(), *state);
    }
    patient.validate();
}

#[test]
fn an_update_stays_near_the_wound() {
    let visited = |n: usize| {
        let mut patient = Patient::new(test_models::grid(n, 0.0, 1), settings(4.0 / n as f64, 0.5 / n as f64));
        let half = (n / 2) as f64 / n as f64;
        let wound = patient.slit(half, half, half + 3.0 / n as f64, 1);
        let report = patient.update(&wound);
        patient.validate();
        assert!(
            report
                .vertices_changed
                .iter()
                .all(|v| { patient.rest[v.index()].distance(DVec3::new(half, half, 0.0)) < 3.0 * patient.settings.radius })
        );
        report.vertices_visited
    };
    let (large, small) = (visited(120), visited(60));
    assert!(large < small + small / 4, "{large} {small}: cost follows the wound, not the model");
}

#[test]
fn a_wound_opens_like_a_lens() {
    let gap = 0.04;
    let mut patient = Patient::new(test_models::grid(60, 0.0, 1), settings(0.1, gap));
    let wound = patient.slit(0.5, 0.3, 0.7, 4);
    patient.update(&wound);
    patient.release();
    let opening = |x: f64| -> f64 {
        let lips = wound.lips.iter().filter(|l| (patient.rest[l.vertex.index()].x - x).abs() < 1e-9);
        let sides: Vec<f64> = lips.map(|l| -f64::from(l.side) * patient.moved(l.vertex).y).collect();
        assert_eq!(sides.len(), 2);
        assert!(sides.iter().all(|y| *y > 0.0), "each lip moves away from the slit");
        sides.iter().sum()
    };
    let middle = opening(0.5);
    assert!(middle > 0.85 * gap && middle <= gap, "{middle} of {gap}");
    let (left, right) = (opening(19.0 / 60.0), opening(41.0 / 60.0));
    assert!(left < 0.7 * middle && right < 0.7 * middle, "{left} {middle} {right}");
    for v in patient.mesh.live_vertices() {
        let p = patient.rest[v.index()];
        if (p.y - 0.5).abs() > patient.settings.radius || !(0.1..0.9).contains(&p.x) {
            assert_eq!(patient.moved(v), DVec3::ZERO);
        }
    }
}

/// Once the blade has left, each lip stands where the lens is: the particles do not, since a lip follows a blend of them.
#[test]
fn the_lips_are_on_the_lens_and_not_their_particles() {
    let (from, length, half_gap) = (0.3, 0.4, 0.02);
    let mut patient = Patient::new(test_models::grid(60, 0.0, 1), settings(0.1, 2.0 * half_gap));
    let wound = patient.slit(0.5, from, from + length, 4);
    patient.update(&wound);
    patient.release();
    let lens = |m: &WoundMark, patient: &Patient| {
        let x = (patient.rest[patient.map.anchors[m.particle.index()].index()].x - from) / length;
        half_gap * 4.0 * x * (1.0 - x)
    };
    let off = |patient: &Patient| {
        let lip = |m: &WoundMark| patient.moved(patient.map.anchors[m.particle.index()]).y * -f64::from(m.side);
        let off = patient.strips.wounds().iter().map(|m| (lip(m) - lens(m, patient)).abs());
        off.fold(0.0, f64::max) / half_gap
    };
    assert!(off(&patient) < 0.2, "{}", off(&patient));
    for m in patient.strips.wounds().to_vec() {
        let out = -f64::from(m.side) * lens(&m, &patient);
        patient.map.rest_displacement.set(m.particle.index(), [0.0, out, 0.0]);
    }
    assert!(off(&patient) > 0.3, "broken twin, the particles on the lens: {}", off(&patient));
}

/// Where a slit runs over a border its lips do not meet, and it stands open there; within the skin both ends are held shut.
#[test]
fn a_wound_is_shut_where_its_lips_meet() {
    let opened = |x0: f64, x1: f64| {
        let mut patient = Patient::new(test_models::grid(60, 0.0, 1), settings(0.1, 0.04));
        let wound = patient.slit(0.5, x0, x1, 4);
        patient.update(&wound);
        patient.release();
        patient.validate();
        let Patient { rest, map, strips, .. } = &patient;
        let anchor = |m: &WoundMark| map.anchors[m.particle.index()];
        let place = |m: &WoundMark| rest[anchor(m).index()].x;
        let width = |m: &WoundMark| 2.0 * patient.moved(anchor(m)).y * -f64::from(m.side);
        let mut marks: Vec<(f64, f64)> = strips.wounds().iter().map(|m| (place(m), width(m))).collect();
        marks.sort_by(|a, b| a.0.total_cmp(&b.0));
        [marks[0].1, marks[marks.len() / 2].1, marks[marks.len() - 1].1].map(|w| w / 0.04)
    };
    let [start, middle, end] = opened(0.2, 0.6);
    assert!(start < 0.1 && middle > 0.9 && end < 0.1, "{start} {middle} {end}");
    let [start, middle, end] = opened(-1.0 / 60.0, 0.4);
    assert!(start > 0.9 && middle < start && end < 0.1, "over the border it starts at: {start} {middle} {end}");
    let [start, middle, end] = opened(0.6, 61.0 / 60.0);
    assert!(start < 0.1 && middle < end && end > 0.9, "over the border it ends at: {start} {middle} {end}");
    let [start, middle, end] = opened(-1.0 / 60.0, 61.0 / 60.0);
    assert!(start.min(middle).min(end) > 0.98, "from border to border: {start} {middle} {end}");
}

#[test]
fn a_growing_slit_keeps_its_wound_particles_within_bounds() {
    let mut limited = settings(0.1, 0.04);
    limited.wound.max_particles = 10;
    let mut patient = Patient::new(test_models::grid(60, 0.0, 1), limited);
    let whole = patient.slit(0.5, 0.1, 0.9, 8);
    let mut largest = Vec::new();
    for k in whole.strips.clone() {
        // The strips come one at a time, as they do while a tear is under way; the mesh is torn already.
        let lips: Vec<LipVertex> = whole.lips.iter().copied().filter(|l| l.strip == k).collect();
        let new: Vec<NewVertex> = if k == 0 { whole.new.clone() } else { Vec::new() };
        patient.update(&Wound { new, lips, strips: k..k + 1, removed: Vec::new() });
        let length = |u: DVec3| u.length();
        let set = patient.map.rest_displacement.iter().map(|u| length(DVec3::from_array(*u))).fold(0.0, f64::max);
        let lip = patient.mesh.live_vertices().map(|v| length(patient.moved(v))).fold(0.0, f64::max);
        largest.push((set, lip));
    }
    patient.validate();
    let wounds = (0..patient.map.len()).filter(|&j| patient.map.is_wound(ParticleId::new(j))).count();
    assert!((4..=10).contains(&wounds), "{wounds}");
    assert!(largest.iter().all(|(set, lip)| *set <= 0.04 + 1e-12 && *lip <= 0.023), "{largest:?}");
}

#[test]
fn an_empty_edit_changes_nothing() {
    let mut patient = Patient::new(test_models::grid(10, 0.0, 1), settings(0.2, 0.04));
    let before = patient.hash();
    assert_eq!(patient.update(&Wound::default()), MapUpdateReport::default());
    assert_eq!(patient.hash(), before);
}

/// A blade that goes back through its own slit makes old vertices lips, which know their side of the strip before from then on: whatever
/// is anchored there loses what it holds across, and not one particle of two.
#[test]
fn all_particles_of_a_new_lip_let_go() {
    let (mesh, rest) = test_models::grid(12, 0.3, 1);
    let settings = settings(0.2, 0.04);
    let mut anchors = sample(&mesh, &rest, settings.spacing, 3);
    let near = |v: &&VertexId| rest[v.index()].distance(DVec3::new(0.45, 0.47, 0.0));
    let lip = *anchors.iter().min_by(|a, b| near(a).total_cmp(&near(b))).unwrap();
    anchors.push(lip);
    let (map, _) = ParticleMap::build(&mesh, &rest, &anchors, &settings);
    let twins = (0..map.len()).filter(|&j| map.anchors[j] == lip).count();
    assert_eq!(twins, 2);
    let mut patient = Patient { mesh, rest, map, strips: Strips::default(), settings, scratch: UpdateScratch::default() };
    let strip = |[from, to]: [[f64; 2]; 2]| {
        let corners = [(from, -0.1), (to, -0.1), (to, 0.0), (from, 0.0)];
        corners.map(|([x, y], z)| DVec3::new(x, y, z))
    };
    patient.strips.push(strip([[0.3, 0.47], [0.6, 0.47]]), settings.radius, 0).unwrap();
    patient.update(&Wound { strips: 0..1, ..Wound::default() });
    patient.map.validate(&patient.mesh, &patient.rest, &patient.strips).unwrap();
    patient.strips.push(strip([[0.6, 0.47], [0.3, 0.56]]), settings.radius, 0).unwrap();
    let [last, side] = [0, 1].map(|k| patient.strips.geometry(k).side_near(patient.rest[lip.index()]));
    assert_eq!(side, -last, "the blade turns round between the slit and the lip");
    let lips = vec![LipVertex { vertex: lip, strip: 1, side }];
    let held = |patient: &Patient| (0..patient.rest.len()).map(|v| patient.map.influences.row(v).len()).sum::<usize>();
    let before = held(&patient);
    patient.update(&Wound { strips: 1..2, lips, ..Wound::default() });
    assert!(held(&patient) < before);
    patient.map.validate(&patient.mesh, &patient.rest, &patient.strips).unwrap();
}

/// A pull goes round the ends of a slit, and less of it the longer the way round; a slit that leaves no way round lets nothing by.
#[test]
fn a_pull_goes_round_the_ends_of_a_slit() {
    let settings = ParticleSettings::with_spacing(0.2);
    let mut patient = Patient::new(test_models::grid(40, 0.0, 1), settings);
    let at = |patient: &Patient, x: f64, y: f64| {
        let off = |v: &VertexId| patient.rest[v.index()].distance(DVec3::new(x, y, 0.0));
        patient.mesh.live_vertices().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap()
    };
    let share = |patient: &Patient, a: [f64; 2], b: [f64; 2]| {
        let mut ways = WaysRound::default();
        ways.find(&patient.mesh, &patient.strips, &patient.rest, settings.wound.spacing);
        let share = |a, b| ways.share(&patient.strips, &patient.rest, a, b, usize::MAX);
        let ends = [at(patient, a[0], a[1]), at(patient, b[0], b[1])];
        assert_eq!(share(ends[0], ends[1]), share(ends[1], ends[0]));
        share(ends[0], ends[1])
    };
    assert_eq!(share(&patient, [0.5, 0.4], [0.5, 0.6]), 1.0, "no strip");
    let wound = patient.slit(0.5, 0.2, 0.8, 4);
    patient.update(&wound);
    // straight 0.2, round 2 sqrt(0.3^2 + 0.1^2)
    let middle = share(&patient, [0.5, 0.4], [0.5, 0.6]);
    assert!((middle - 0.1).abs() < 1e-6, "{middle}");
    let [nearer, near] = [0.6, 0.75].map(|x| share(&patient, [x, 0.4], [x, 0.6]));
    assert!(middle < nearer && nearer < near && near < 1.0, "{nearer} {near}");
    assert!(share(&patient, [0.775, 0.475], [0.8, 0.55]) > 0.8, "the lips are one at the end");
    assert_eq!(share(&patient, [0.1, 0.4], [0.1, 0.6]), 1.0, "beyond the slit");
    assert_eq!(share(&patient, [0.5, 0.6], [0.7, 0.6]), 1.0, "along a lip");
    let across = patient.slit(0.25, -1.0, 2.0, 8);
    patient.update(&across);
    assert_eq!(share(&patient, [0.5, 0.2], [0.5, 0.3]), 0.0, "from border to border there is no way round");
    assert_eq!(share(&patient, [0.5, 0.2], [0.5, 0.6]), 0.0, "nor where another slit could be gone round");
}
