//! Caps: what closes the two sides of a plane cut (MATHS 6).
//!
//! The rim comes from the cut itself, edge by edge, and every vertex has one fan, so the loops need no search and no geometry.
//! A cap adds no vertex: its corners are the rim's, which are rows over base vertices, so it follows every pose. Both sides get
//! the same triangles, mirrored. Chains of the rim that end at a border of an open model are left alone.

use crate::geometry::{
    FaceId, FaceInfo, FxHashMap, HalfEdge, Mesh, NewFace, SectionId, TopologyScratch, TriangulationOutcome, Triangulator,
    VertexId, Wedge, WedgeId,
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
    topology: TopologyScratch,
    sides: [Side; 2],
    points: Vec<[f64; 2]>,
    at: FxHashMap<HalfEdge, u32>,
    local_of: FxHashMap<VertexId, u32>,
    taken: Vec<[u32; 2]>,
    wedges: Vec<WedgeId>,
    faces: Vec<NewFace>,
    rim: Vec<HalfEdge>,
}

/// Loops of one side. Rim edge `i` stands for the vertex that its half-edge leaves.
#[derive(Debug, Default)]
struct Side {
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
}

const NONE: u32 = u32::MAX;

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
        scratch.points.extend(rim.iter().map(|edge| {
            let p = position(mesh.from(edge[s]));
            [across * p.dot(u), p.dot(v)]
        }));
        if s == 1 && taken.is_empty() && mirrored(&scratch.sides) {
            let [first, second] = &mut scratch.sides;
            let twin = |t: &[u32; 3]| [t[0], t[2], t[1]].map(|i| second.next[i as usize]);
            second.triangles = first.triangles.iter().map(twin).collect();
        } else {
            triangulate(mesh, rim, s, taken, scratch, &mut outcome.triangulation);
        }
        stitch(mesh, rim, s, (dress.material, across), |v| normal(v, outward), scratch);
        outcome.added_faces.extend_from_slice(&scratch.topology.added);
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
    let side = &mut sides[s];
    at.clear();
    at.extend(rim.iter().zip(0..).map(|(edge, i)| (edge[s], i)));
    side.next.clear();
    side.next.extend(rim.iter().map(|edge| {
        // the only open half-edge that leaves the vertex comes first in its fan; what replacing faces has joined is not open
        let open = mesh.opposite(edge[s]).is_none().then(|| mesh.fan(mesh.to(edge[s])).next()).flatten();
        open.and_then(|h| at.get(&h).copied()).unwrap_or(NONE)
    }));
    side.closed.clear();
    side.closed.extend(rim.iter().map(|edge| mesh.opposite(edge[s]).is_some()));
    side.corners.clear();
    side.starts.clear();
    side.starts.push(0);
    side.pairs.clear();
    side.triangles.clear();
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

fn triangulate(
    mesh: &Mesh,
    rim: &[[HalfEdge; 2]],
    s: usize,
    taken: &[[VertexId; 2]],
    scratch: &mut CapScratch,
    sum: &mut TriangulationOutcome,
) {
    let CapScratch { triangulator, sides, points, local_of, taken: local_taken, .. } = scratch;
    let side = &mut sides[s];
    local_taken.clear();
    if !taken.is_empty() {
        local_of.clear();
        local_of.extend(side.corners.iter().map(|&i| (mesh.from(rim[i as usize][s]), i)));
        let local = |v: VertexId| local_of.get(&v).copied();
        local_taken.extend(taken.iter().filter_map(|&[a, b]| Some([local(a)?, local(b)?])));
    }
    let one = triangulator.triangulate(points, &side.corners, &side.starts, local_taken, &mut side.triangles);
    sum.forced_ears += one.forced_ears;
    sum.fans += one.fans;
    sum.repeated_edges += one.repeated_edges;
}

/// Puts the triangles of one side into the mesh.
fn stitch(
    mesh: &mut Mesh,
    rim: &[[HalfEdge; 2]],
    s: usize,
    (material, across): (u32, f64),
    normal: impl Fn(VertexId) -> [f32; 3],
    scratch: &mut CapScratch,
) {
    let CapScratch { topology, sides, points, wedges, faces, rim: open, .. } = scratch;
    let side = &sides[s];
    wedges.clear();
    wedges.resize(rim.len(), WedgeId::NONE);
    for &i in &side.corners {
        let vertex = mesh.from(rim[i as usize][s]);
        let [x, y] = points[i as usize];
        let uv = DVec2::new(across * x, y).as_vec2().to_array();
        wedges[i as usize] = mesh.add_wedge(Wedge { vertex, group: WedgeId::NONE, uv, normal: normal(vertex), colour: u32::MAX });
    }
    let section = side.corners.first().map_or(SectionId(0), |&i| mesh.face_info(rim[i as usize][s].face()).section);
    let info = FaceInfo { material, origin: u32::MAX, section };
    faces.clear();
    faces.extend(side.triangles.iter().map(|t| NewFace {
        corners: t.map(|i| mesh.from(rim[i as usize][s])),
        wedges: t.map(|i| wedges[i as usize]),
        info,
        side: 0,
    }));
    open.clear();
    open.extend(side.corners.iter().map(|&i| rim[i as usize][s]));
    mesh.line_rim(open.iter().copied(), faces, topology);
}
