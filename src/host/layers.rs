//! Inspection layers as line segments. Built only while a layer is on.

use crate::app::FrameView;
use crate::geometry::SectionId;
use crate::gpu::LineSegment;
use crate::input::Layer;
use crate::tissue::Tissue;
use glam::DVec3;

const PARTICLE: [f32; 4] = [1.0, 0.85, 0.2, 1.0];
const LINK: [f32; 4] = [0.2, 0.75, 1.0, 0.8];
const WIRE: [f32; 4] = [0.05, 0.05, 0.06, 0.6];
const EDGE: [f32; 4] = [1.0, 0.95, 0.1, 1.0];
const SECTION: [f32; 4] = [1.0, 0.4, 0.9, 0.8];
const STRIP: [f32; 4] = [1.0, 0.3, 0.2, 0.9];

/// Lines of all layers that are on, in world space.
pub(super) fn layer_lines(view: &FrameView) -> Vec<LineSegment> {
    let mut lines = Vec::new();
    for &layer in view.layers {
        for (_, tissue) in view.scene.tissues() {
            match layer {
                Layer::Particles => particles(tissue, &mut lines),
                Layer::Wireframe => wireframe(tissue, &mut lines),
                Layer::Sections => sections(tissue, &mut lines),
                Layer::Influences => influences(tissue, &mut lines),
                Layer::Strips => strips(tissue, &mut lines),
                Layer::Edges => edges(tissue, &mut lines),
                Layer::Boxes | Layer::Errors => {}
            }
        }
        if layer == Layer::Boxes {
            for tear_box in view.scene.last_tear_boxes() {
                outline(tear_box.corners(), &mut lines);
            }
            for slit in view.scene.last_tear_slits() {
                let [a, b, c, d] = slit.corners;
                outline([a, b, b, a, d, c, c, d], &mut lines);
            }
        }
    }
    lines
}

/// How far the GPU's positions lie from the f64 reference: blue at 1e-9 of the diagonal, green in between, red from 1e-6 on.
pub fn error_points(tissue: &Tissue, gpu: &[[f32; 3]], lines: &mut Vec<LineSegment>) {
    for v in tissue.mesh().live_vertices() {
        let Some(found) = gpu.get(v.index()) else { continue };
        let wanted = tissue.position(v);
        let error = glam::Vec3::from_array(*found).as_dvec3().distance(wanted) / tissue.diagonal();
        let heat = (error.max(1e-12).log10() + 9.0) / 3.0;
        lines.push(LineSegment::point(tissue.to_model(wanted), heat_colour(heat), 5.0));
    }
}

/// Blue at 0, green half-way, red at 1.
fn heat_colour(heat: f64) -> [f32; 4] {
    let x = heat.clamp(0.0, 1.0) as f32;
    [(2.0 * x - 1.0).max(0.0), 1.0 - (2.0 * x - 1.0).abs(), (1.0 - 2.0 * x).max(0.0), 1.0]
}

/// Where wounds and cuts end: edges of the surface, or between skin and wall, with an end that an edit inserted.
fn edges(tissue: &Tissue, lines: &mut Vec<LineSegment>) {
    let mesh = tissue.mesh();
    let wall = |f: crate::geometry::FaceId| mesh.is_interior(f);
    for f in mesh.live_faces().filter(|f| !wall(*f)) {
        for k in 0..3 {
            let h = crate::geometry::HalfEdge::of(f, k);
            let (a, b) = (mesh.from(h), mesh.to(h));
            let opposite = mesh.opposite(h);
            let ends = opposite.is_none() || wall(opposite.face());
            if ends && !(tissue.rows().is_base(a) && tissue.rows().is_base(b)) {
                let [a, b] = [a, b].map(|v| tissue.to_model(tissue.position(v)));
                lines.push(LineSegment { width: 2.5, ..LineSegment::new(a, b, EDGE) });
            }
        }
    }
}

fn particles(tissue: &Tissue, lines: &mut Vec<LineSegment>) {
    let Some(layer) = tissue.layer() else { return };
    let at = |p: usize| {
        let anchor = layer.map.anchors[p];
        anchor.is_some().then(|| tissue.to_model(tissue.skinned(anchor) + layer.displacements()[p]))
    };
    for p in 0..layer.map.len() {
        let Some(a) = at(p) else { continue };
        for link in layer.map.neighbours.row(p).iter().filter(|l| l.particle.index() > p) {
            lines.extend(at(link.particle.index()).map(|b| LineSegment { over: true, ..LineSegment::new(a, b, LINK) }));
        }
    }
    let point = |a| LineSegment { over: true, ..LineSegment::point(a, PARTICLE, 9.0) };
    lines.extend((0..layer.map.len()).filter_map(at).map(point));
}

fn wireframe(tissue: &Tissue, lines: &mut Vec<LineSegment>) {
    let mesh = tissue.mesh();
    for f in mesh.live_faces() {
        let corners = mesh.face(f).map(|v| tissue.to_model(tissue.position(v)));
        for k in 0..3 {
            let h = crate::geometry::HalfEdge::of(f, k);
            if mesh.opposite(h).is_none() || mesh.from(h) < mesh.to(h) {
                lines.push(LineSegment::new(corners[k], corners[(k + 1) % 3], WIRE));
            }
        }
    }
}

/// Each vertex in the mixture of its particles' colours: where one particle rules, its own colour, and grey in between.
fn influences(tissue: &Tissue, lines: &mut Vec<LineSegment>) {
    let Some(layer) = tissue.layer() else { return };
    for v in tissue.mesh().live_vertices() {
        let row = layer.map.influences.row(v.index());
        if !row.is_empty() {
            let mut colour = [0.0, 0.0, 0.0, 1.0];
            for i in row {
                let hue = particle_colour(i.particle.index());
                (0..3).for_each(|c| colour[c] += i.weight * hue[c]);
            }
            lines.push(LineSegment::point(tissue.to_model(tissue.position(v)), colour, 5.0));
        }
    }
}

/// Hues a golden angle apart, so that neighbours differ.
fn particle_colour(particle: usize) -> [f32; 3] {
    let hue = (particle as f64 * 0.618_033_988_749_895).fract();
    let channel = |shift: f64| {
        let x = ((hue + shift).fract() * 6.0 - 3.0).abs() - 1.0;
        x.clamp(0.0, 1.0) as f32
    };
    [channel(0.0), channel(2.0 / 3.0), channel(1.0 / 3.0)]
}

fn sections(tissue: &Tissue, lines: &mut Vec<LineSegment>) {
    let mesh = tissue.mesh();
    for s in 0..mesh.sections() {
        let points =
            mesh.section_faces(SectionId::new(s)).flat_map(|f| mesh.face(f)).map(|v| tissue.to_model(tissue.position(v)));
        let (low, high) = points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        if low.cmple(high).all() {
            let corner = |i: u32| DVec3::new(pick(i & 1, low.x, high.x), pick(i & 2, low.y, high.y), pick(i & 4, low.z, high.z));
            for (a, b) in [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)] {
                lines.push(LineSegment::new(corner(a), corner(b), SECTION));
            }
        }
    }
}

fn pick(bit: u32, low: f64, high: f64) -> f64 {
    if bit == 0 { low } else { high }
}

/// Strips at rest: where links may not pass.
fn strips(tissue: &Tissue, lines: &mut Vec<LineSegment>) {
    let Some(layer) = tissue.layer() else { return };
    for strip in layer.strips.as_slice() {
        let corners = strip.corners.map(|c| tissue.to_model(DVec3::from_array(c)));
        for k in 0..4 {
            lines.push(LineSegment::new(corners[k], corners[(k + 1) % 4], STRIP));
        }
    }
}

/// Edges of a box given by its start and end quads.
fn outline(corners: [DVec3; 8], lines: &mut Vec<LineSegment>) {
    for k in 0..4 {
        let next = (k + 1) % 4;
        for (a, b) in [(k, next), (k + 4, next + 4), (k, k + 4)] {
            lines.push(LineSegment::new(corners[a], corners[b], STRIP));
        }
    }
}
