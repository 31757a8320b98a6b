//! Convex bodies to tear bare meshes with.

use super::Solid;
use glam::{DMat3, DQuat, DVec3};
use incise::geometry::{FaceId, Plane, VertexId};
use incise::surgery::Side;
use incise::surgery::tear::{Body, TearScratch, TearStep, tear_step};
use incise::surgery::tear_walls::WallSpec;
use incise::surgery::walls::Facets;
use proptest::prelude::*;

/// A box with axes `axes` (columns), centre and half extents, as six planes through its corners.
#[derive(Clone, Debug)]
pub struct Hexahedron {
    pub planes: Vec<Plane>,
    pub sides: Vec<Side>,
    pub min: DVec3,
    pub max: DVec3,
    pub facets: Facets,
}

impl Hexahedron {
    pub fn new(centre: DVec3, axes: DMat3, half: DVec3) -> Self {
        let corner = |x: f64, y: f64, z: f64| centre + axes * (half * DVec3::new(x, y, z));
        let mut planes = Vec::new();
        let mut facets = Facets::default();
        for axis in 0..3 {
            for s in [-1.0, 1.0] {
                let at = |u: f64, v: f64| {
                    let mut c = [0.0; 3];
                    c[axis] = s;
                    c[(axis + 1) % 3] = u * s;
                    c[(axis + 2) % 3] = v;
                    corner(c[0], c[1], c[2])
                };
                planes.push(Plane::Points([at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0)]));
                let index = |u: f64, v: f64| {
                    let mut bit = [0u8; 3];
                    bit[axis] = u8::from(s > 0.0);
                    bit[(axis + 1) % 3] = u8::from(u * s > 0.0);
                    bit[(axis + 2) % 3] = u8::from(v > 0.0);
                    bit[0] | bit[1] << 1 | bit[2] << 2
                };
                facets.push(&[index(-1.0, -1.0), index(1.0, -1.0), index(1.0, 1.0), index(-1.0, 1.0)]);
            }
        }
        let corners: Vec<DVec3> = (0..8)
            .map(|i| corner(f64::from(i & 1) * 2.0 - 1.0, f64::from(i >> 1 & 1) * 2.0 - 1.0, f64::from(i >> 2) * 2.0 - 1.0))
            .collect();
        facets.corners = corners.clone().try_into().unwrap();
        let sides = vec![Side::Start, Side::End, Side::Minus, Side::Plus, Side::Floor, Side::Top];
        let min = corners.iter().copied().reduce(DVec3::min).unwrap();
        let max = corners.iter().copied().reduce(DVec3::max).unwrap();
        for plane in &planes {
            assert!(plane.distance(centre) < 0.0);
        }
        Self { planes, sides, min, max, facets }
    }

    pub fn body(&self) -> Body<'_> {
        Body { planes: &self.planes, sides: &self.sides, min: self.min, max: self.max }
    }

    pub fn depth(&self, p: DVec3) -> f64 {
        self.planes.iter().map(|k| k.distance(p)).fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Takes the body out of the solid, with walls or without; false if no face reaches inside.
pub fn tear(solid: &mut Solid, body: &Hexahedron, is_closed: bool) -> (bool, TearStep) {
    let candidates: Vec<FaceId> = solid.mesh.live_faces().collect();
    let (mut out, mut scratch) = (TearStep::default(), TearScratch::default());
    let positions = solid.positions.clone();
    let at = |v: VertexId| positions[v.index()];
    let walls = WallSpec {
        facets: &body.facets,
        remove: &[],
        keep: &[],
        material: 0,
        grain: 0.0,
        bent: 0.0,
        rest_from_posed: DMat3::IDENTITY,
    };
    let walls = is_closed.then_some(&walls);
    let hit = tear_step(&mut solid.mesh, &body.body(), walls, &candidates, &at, &[], &mut scratch, &mut out);
    append(solid, &out.new_vertices);
    (hit, out)
}

pub fn append(solid: &mut Solid, new: &[incise::surgery::insert::NewVertex]) {
    for n in new {
        assert_eq!(n.vertex.index(), solid.positions.len());
        // a corner of a wall leans on no one
        assert!(n.parent_count == 0 || (n.parents().iter().map(|p| p.1).sum::<f64>() - 1.0).abs() < 1e-14);
        solid.positions.push(n.position);
    }
}

pub fn any_box(centre: f64, half: f64) -> impl Strategy<Value = Hexahedron> {
    let axis = prop::array::uniform3(-1.0f64..1.0);
    (prop::array::uniform3(-centre..centre), prop::array::uniform3(0.01..half), axis, 0.0f64..6.0).prop_map(
        |(c, h, axis, angle)| {
            let axis = DVec3::from_array(axis).try_normalize().unwrap_or(DVec3::X);
            Hexahedron::new(DVec3::from_array(c), DMat3::from_quat(DQuat::from_axis_angle(axis, angle)), DVec3::from_array(h))
        },
    )
}

pub fn grid_box(n: i32) -> impl Strategy<Value = Hexahedron> {
    (prop::array::uniform3(-1..2 * n + 2), prop::array::uniform3(1..2 * n), 0..4i32).prop_map(|(low, size, turn)| {
        // half-integer corners: planes through vertices, edges and whole faces
        let low = DVec3::from_array(low.map(|x| f64::from(x) * 0.5));
        let half = DVec3::from_array(size.map(|x| f64::from(x) * 0.25));
        let axes = match turn {
            0 | 1 => DMat3::IDENTITY,
            2 => DMat3::from_cols(DVec3::new(1.0, 1.0, 0.0), DVec3::new(-1.0, 1.0, 0.0), DVec3::Z),
            _ => DMat3::from_cols(DVec3::new(1.0, 0.0, 1.0), DVec3::Y, DVec3::new(-1.0, 0.0, 1.0)),
        };
        Hexahedron::new(low + half, axes, half)
    })
}
