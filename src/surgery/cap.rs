//! Caps: what closes the two sides of a plane cut (MATHS 6).
//!
//! The rim comes from the cut itself, edge by edge, and every vertex has one fan, so the loops need no search and no geometry.
//! A cap adds no vertex: its corners are the rim's, which are rows over base vertices, so it follows every pose. Both sides get
//! the same triangles, mirrored. Chains of the rim that end at a border of an open model are left alone.

use crate::geometry::{
    FaceId, FaceInfo, FxHashMap, HalfEdge, Mesh, NO_OPPOSITE, SectionId, TriangulationOutcome, Triangulator, VertexId, Wedge,
    WedgeId,
};
use glam::{DVec2, DVec3};

/// What caps did to the mesh.
#[derive(Clone, Debug, Default)]
pub struct CapOutcome {
    /// Loops that were closed, both sides together.
    pub loops: usize,
    /// Rim edges that belong to no closed loop and stay open, both sides together.
    pub unclosed_edges: usize,
    /// Faces of the positive side's caps, then those of the negative side's.
    pub added_faces: Vec<FaceId>,
    /// How many of them are on the positive side.
    pub positive_faces: usize,
    /// How triangulation went, sums.
    pub triangulation: TriangulationOutcome,
}

/// What a cap looks like.
#[derive(Clone, Copy, Debug)]
pub struct CapDress {
    /// Unit normal of the plane, from its negative to its positive side.
    pub normal: DVec3,
    /// Material of the cap's faces.
    pub material: u32,
}

/// Buffers kept between cuts.
#[derive(Debug, Default)]
pub struct CapScratch {
    triangulator: Triangulator,
    sides: [Side; 2],
    points: Vec<[f64; 2]>,
    at: FxHashMap<HalfEdge, u32>,
    local_of: FxHashMap<VertexId, u32>,
    taken: Vec<[u32; 2]>,
    wedges: Vec<WedgeId>,
}

/// Loops of one side. Rim edge `i` stands for the vertex that its half-edge leaves.
#[derive(Debug, Default)]
struct Side {
    /// Vertex that each rim edge leaves.
    vertices: Vec<VertexId>,
    /// Rim edge after each; `NONE` where the chain ends.
    next: Vec<u32>,
    /// Whether a rim edge is in a closed loop.
    closed: Vec<bool>,
    /// Loops of three edges or more in the cap's direction, against that of the rim.
    corners: Vec<u32>,
    starts: Vec<u32>,
    /// Loops of two edges: they are zipped.
    pairs: Vec<[u32; 2]>,
    triangles: Vec<[u32; 3]>,
    /// Half-edge across from each of theirs, [`NO_OPPOSITE`] along the rim.
    opposite: Vec<u32>,
}

const NONE: u32 = u32::MAX;

/// True if every edge of a rim is in a closed loop, on both sides: the cut goes right through all that it meets.
pub fn closes(mesh: &Mesh, rim: &[[HalfEdge; 2]], scratch: &mut CapScratch) -> bool {
    (0..2).all(|s| {
        trace(mesh, rim, s, scratch);
        scratch.sides[s].closed.iter().all(|&closed| closed)
    })
}

/// Caps both sides of a cut. `rim` and `taken` are those of [`super::plane_cut::PlaneCutScratch`]; `position` gives final
/// positions, `normal` the rest normal of a vertex whose normal in the pose is to be the one given.
pub fn cap(
    mesh: &mut Mesh,
    rim: &[[HalfEdge; 2]],
    taken: &[[VertexId; 2]],
    dress: CapDress,
    position: impl Fn(VertexId) -> DVec3,
    normal: impl Fn(VertexId, DVec3) -> [f32; 3],
    scratch: &mut CapScratch,
) -> CapOutcome {
    let mut outcome = CapOutcome::default();
    let (u, v) = frame(dress.normal);
    for s in 0..2 {
        trace(mesh, rim, s, scratch);
        let side = &scratch.sides[s];
        outcome.loops += side.starts.len() - 1 + side.pairs.len();
        outcome.unclosed_edges += side.closed.iter().filter(|&&c| !c).count();
        for pair in &side.pairs {
            let [a, b] = pair.map(|i| rim[i as usize][s]);
            mesh.close_edge(a, b);
        }
    }
    for s in 0..2 {
        let outward = if s == 0 { -dress.normal } else { dress.normal };
        // seen from outside, so that each side's region is to the left of its loops
        let across = if s == 0 { -1.0 } else { 1.0 };
        scratch.points.clear();
        scratch.points.extend(scratch.sides[s].vertices.iter().map(|&vertex| {
            let p = position(vertex);
            [across * p.dot(u), p.dot(v)]
        }));
        if s == 1 && taken.is_empty() && mirrored(&scratch.sides) {
            let [first, second] = &mut scratch.sides;
            let twin = |t: &[u32; 3]| [t[0], t[2], t[1]].map(|i| second.next[i as usize]);
            second.triangles.extend(first.triangles.iter().map(twin));
            // edge k, run backwards, is edge 2 - k of the twin
            let back = |h: u32| if h == NO_OPPOSITE { h } else { h - h % 3 + (2 - h % 3) };
            second.opposite.extend(first.opposite.chunks_exact(3).flat_map(|t| [t[2], t[1], t[0]]).map(back));
        } else {
            triangulate(s, taken, scratch, &mut outcome.triangulation);
        }
        stitch(mesh, rim, s, (dress.material, across), |v| normal(v, outward), scratch, &mut outcome.added_faces);
        if s == 0 {
            outcome.positive_faces = outcome.added_faces.len();
        }
    }
    outcome
}

/// Two axes that span the plane, right-handed with its normal.
fn frame(normal: DVec3) -> (DVec3, DVec3) {
    let u = normal.any_orthonormal_vector();
    (u, normal.cross(u))
}

/// Links the rim of one side and collects its loops.
fn trace(mesh: &Mesh, rim: &[[HalfEdge; 2]], s: usize, scratch: &mut CapScratch) {
    let CapScratch { sides, at, .. } = scratch;
    let [first_side, second_side] = sides;
    at.clear();
    let (side, first_next) = if s == 0 { (first_side, &[][..]) } else { (second_side, &first_side.next[..]) };
    let Side { next, closed, vertices, .. } = &mut *side;
    vertices.clear();
    vertices.extend(rim.iter().map(|edge| mesh.from(edge[s])));
    closed.clear();
    closed.extend(rim.iter().map(|edge| mesh.opposite(edge[s]).is_some()));
    next.clear();
    next.resize(rim.len(), NONE);
    for (i, &j) in (0..).zip(first_next).filter(|(_, j)| **j != NONE) {
        next[j as usize] = i;
    }
    // where the rim goes on is mostly next to where it is, or where the loop began, and on the second side where the first comes from
    let mut begin = 0;
    for i in 0..rim.len() {
        let guesses = if s == 0 { [i as u32 + 1, begin] } else { [next[i], NONE] };
        if closed[i] {
            next[i] = NONE;
            continue;
        }
        let v = mesh.to(rim[i][s]);
        let begins = |j: &u32| vertices.get(*j as usize) == Some(&v) && !closed[*j as usize];
        next[i] = if let Some(known) = guesses.into_iter().find(begins) {
            known
        } else {
            if at.is_empty() {
                at.extend(rim.iter().zip(0..).map(|(edge, i)| (edge[s], i)));
            }
            // the only open half-edge that leaves a vertex comes first in its fan
            mesh.fan(v).next().and_then(|h| at.get(&h).copied()).unwrap_or(NONE)
        };
        if next[i] != i as u32 + 1 {
            begin = i as u32 + 1;
        }
    }
    side.corners.clear();
    side.starts.clear();
    side.starts.push(0);
    side.pairs.clear();
    side.triangles.clear();
    side.opposite.clear();
    for first in 0..rim.len() as u32 {
        if side.closed[first as usize] {
            continue;
        }
        let begin = side.corners.len();
        let mut i = first;
        loop {
            side.corners.push(i);
            i = side.next[i as usize];
            if i == NONE || i == first || side.corners.len() - begin > rim.len() {
                break;
            }
        }
        if i != first {
            side.corners.truncate(begin);
            continue;
        }
        side.corners[begin..].iter().for_each(|&i| side.closed[i as usize] = true);
        match side.corners[begin..] {
            [a, b] => {
                side.pairs.push([a, b]);
                side.corners.truncate(begin);
            }
            _ => {
                side.corners[begin..].reverse();
                side.starts.push(side.corners.len() as u32);
            }
        }
    }
}

/// True if the loops of the second side are those of the first run backwards.
fn mirrored([first, second]: &[Side; 2]) -> bool {
    let same_size = first.corners.len() == second.corners.len();
    same_size
        && first.corners.iter().all(|&i| {
            let j = first.next[i as usize];
            second.next[j as usize] == i && second.closed[i as usize]
        })
}

fn triangulate(s: usize, taken: &[[VertexId; 2]], scratch: &mut CapScratch, sum: &mut TriangulationOutcome) {
    let CapScratch { triangulator, sides, points, local_of, taken: local_taken, .. } = scratch;
    let side = &mut sides[s];
    local_taken.clear();
    if !taken.is_empty() {
        local_of.clear();
        local_of.extend(side.corners.iter().map(|&i| (side.vertices[i as usize], i)));
        let local = |v: VertexId| local_of.get(&v).copied();
        local_taken.extend(taken.iter().filter_map(|&[a, b]| Some([local(a)?, local(b)?])));
    }
    let one = triangulator.triangulate(points, &side.corners, &side.starts, local_taken, &mut side.triangles);
    side.opposite.extend_from_slice(triangulator.opposite());
    sum.forced_ears += one.forced_ears;
    sum.fans += one.fans;
    sum.repeated_edges += one.repeated_edges;
}

/// Puts the triangles of one side into the mesh, joined to each other and to the rim.
fn stitch(
    mesh: &mut Mesh,
    rim: &[[HalfEdge; 2]],
    s: usize,
    (material, across): (u32, f64),
    normal: impl Fn(VertexId) -> [f32; 3],
    scratch: &mut CapScratch,
    added: &mut Vec<FaceId>,
) {
    let CapScratch { sides, points, wedges, .. } = scratch;
    let side = &sides[s];
    wedges.clear();
    wedges.resize(rim.len(), WedgeId::NONE);
    for &i in &side.corners {
        let vertex = side.vertices[i as usize];
        let [x, y] = points[i as usize];
        let uv = DVec2::new(across * x, y).as_vec2().to_array();
        wedges[i as usize] = mesh.add_wedge(Wedge { vertex, group: WedgeId::NONE, uv, normal: normal(vertex), colour: u32::MAX });
    }
    let section = side.corners.first().map_or(SectionId(0), |&i| mesh.face_info(rim[i as usize][s].face()).section);
    let info = FaceInfo { material, origin: u32::MAX, section };
    let first = added.len();
    added.extend(side.triangles.iter().map(|_| mesh.put_slot(info)));
    for ((t, corners), opposite) in side.triangles.iter().enumerate().zip(side.opposite.chunks_exact(3)) {
        let f = added[first + t];
        let across = |k: usize| match opposite[k] {
            // the loop runs against the rim: its edge lies across from the half-edge that leaves its end
            NO_OPPOSITE => rim[corners[if k == 2 { 0 } else { k + 1 }] as usize][s],
            h => HalfEdge::of(added[first + h as usize / 3], h as usize % 3),
        };
        let across = [across(0), across(1), across(2)];
        let [a, b, c] = corners.map(|i| i as usize);
        let vertices = [side.vertices[a], side.vertices[b], side.vertices[c]];
        mesh.write_face(f, vertices, [wedges[a], wedges[b], wedges[c]], across);
        for k in (0..3).filter(|&k| opposite[k] == NO_OPPOSITE) {
            debug_assert_eq!(mesh.to(across[k]), mesh.face(f)[k]);
            mesh.face_across(across[k], HalfEdge::of(f, k));
        }
    }
}
