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
const INFLUENCE: [f32; 4] = [0.5, 1.0, 0.4, 0.5];
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
                Layer::Boxes => {}
            }
        }
        if layer == Layer::Boxes {
            for tear_box in view.scene.last_tear_boxes() {
                outline(tear_box.corners(), &mut lines);
            }
        }
    }
    lines
}

fn particles(tissue: &Tissue, lines: &mut Vec<LineSegment>) {
    let Some(layer) = tissue.layer() else { return };
    let at = |p: usize| {
        let anchor = layer.map.anchors[p];
        anchor.is_some().then(|| tissue.skinned(anchor) + layer.displacements()[p] + tissue.offset())
    };
    for p in 0..layer.map.len() {
        let Some(a) = at(p) else { continue };
        lines.push(LineSegment::point(a, PARTICLE, 5.0));
        for link in layer.map.neighbours.row(p).iter().filter(|l| l.particle.index() > p) {
            lines.extend(at(link.particle.index()).map(|b| LineSegment::new(a, b, LINK)));
        }
    }
}

fn wireframe(tissue: &Tissue, lines: &mut Vec<LineSegment>) {
    let mesh = tissue.mesh();
    for f in mesh.live_faces() {
        let corners = mesh.face(f).map(|v| tissue.position(v) + tissue.offset());
        for k in 0..3 {
            let h = crate::geometry::HalfEdge::of(f, k);
            if mesh.opposite(h).is_none() || mesh.from(h) < mesh.to(h) {
                lines.push(LineSegment::new(corners[k], corners[(k + 1) % 3], WIRE));
            }
        }
    }
}

fn influences(tissue: &Tissue, lines: &mut Vec<LineSegment>) {
    let Some(layer) = tissue.layer() else { return };
    for v in tissue.mesh().live_vertices() {
        for i in layer.map.influences.row(v.index()) {
            let anchor = layer.map.anchors[i.particle.index()];
            if anchor.is_some() && anchor != v {
                let mut colour = INFLUENCE;
                colour[3] *= i.weight;
                lines.push(LineSegment::new(
                    tissue.position(v) + tissue.offset(),
                    tissue.position(anchor) + tissue.offset(),
                    colour,
                ));
            }
        }
    }
}

fn sections(tissue: &Tissue, lines: &mut Vec<LineSegment>) {
    let mesh = tissue.mesh();
    for s in 0..mesh.sections() {
        let points =
            mesh.section_faces(SectionId::new(s)).flat_map(|f| mesh.face(f)).map(|v| tissue.position(v) + tissue.offset());
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
        let corners = strip.corners.map(|c| DVec3::from_array(c) + tissue.offset());
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
