//! Generated tissues for the GPU tests: everything a view borrows, in one place.
#![allow(dead_code)] // each test binary uses its part

pub mod golden;

use glam::{DAffine3, DQuat, DVec3};
use incise::geometry::{Mesh, SlotCsr, Turn, VertexId, Wedge, WedgeId};
use incise::gpu::targets::Picture;
use incise::gpu::{AdapterChoice, Context, ContextOptions, MaterialView, TissueView, ViewVersions};
use incise::particles::{Influence, ParticleMap};
use incise::rig::{BoneWeight, JointMatrix, Pose, VertexRows};
use std::sync::Arc;

/// A software adapter if there is one (pictures are compared on it), else any; with `INCISE_TEST_GPU=1` a real one.
pub fn context() -> Arc<Context> {
    open(false)
}

/// The same without what an adapter may lack: multiview, timestamps.
pub fn plain_context() -> Arc<Context> {
    open(true)
}

fn open(plain: bool) -> Arc<Context> {
    let open = |adapter| Context::headless(ContextOptions { adapter, plain });
    let context = match std::env::var_os("INCISE_TEST_GPU") {
        Some(on) if on == "1" => open(AdapterChoice::Hardware),
        _ => open(AdapterChoice::Software).or_else(|_| open(AdapterChoice::Best)),
    };
    Arc::new(context.expect("a graphics adapter"))
}

/// Two small layers to draw into, as a headset's are.
pub fn eyes(context: &Context) -> Picture {
    Picture::new(context, (32, 24), 2).expect("two layers")
}

/// Owns what a [`TissueView`] borrows.
pub struct Model {
    pub mesh: Mesh,
    pub rows: VertexRows,
    pub map: ParticleMap,
    pub displacements: Vec<DVec3>,
    pub rotations: Vec<Turn>,
    pub fades: Vec<[f32; 4]>,
    pub fade_duration_s: f64,
    pub time_s: f64,
    pub pose: Pose,
    pub materials: Vec<MaterialView<'static>>,
    pub world_from_tissue: DAffine3,
    pub versions: ViewVersions,
}

impl Model {
    /// Every vertex a base vertex with one smooth wedge; `bones` has a row a vertex.
    pub fn new(positions: Vec<[f32; 3]>, faces: Vec<[u32; 3]>, bones: SlotCsr<BoneWeight>) -> Self {
        let n = positions.len();
        let normals = smooth_normals(&positions, &faces);
        let wedges = (0..n).map(|v| wedge(v, normals[v])).collect();
        let corners = faces.iter().map(|f| f.map(VertexId)).collect();
        let face_wedges = faces.iter().map(|f| f.map(WedgeId)).collect();
        let map = ParticleMap { influences: SlotCsr::with_rows(n), ..Default::default() };
        Self {
            mesh: Mesh::build(n, corners, face_wedges, &vec![0; faces.len()], wedges),
            rows: VertexRows::from_base(positions, bones),
            map,
            displacements: Vec::new(),
            rotations: Vec::new(),
            fades: Vec::new(),
            fade_duration_s: 0.3,
            time_s: 0.0,
            pose: Pose::default(),
            materials: Vec::new(),
            world_from_tissue: DAffine3::IDENTITY,
            versions: ViewVersions::default(),
        }
    }

    pub fn view(&self) -> TissueView<'_> {
        TissueView {
            mesh: &self.mesh,
            rows: &self.rows,
            map: &self.map,
            displacements: &self.displacements,
            rotations: &self.rotations,
            fades: &self.fades,
            fades_written: &[],
            fade_duration_s: self.fade_duration_s,
            time_s: self.time_s,
            pose: &self.pose,
            materials: &self.materials,
            diagonal: self.diagonal(),
            world_from_tissue: self.world_from_tissue,
            versions: self.versions,
        }
    }

    pub fn vertices(&self) -> impl Iterator<Item = VertexId> + use<> {
        (0..self.rows.len()).map(VertexId::new)
    }

    pub fn diagonal(&self) -> f64 {
        let at = |v| self.rows.rest(v);
        let min = self.vertices().map(at).fold(DVec3::INFINITY, DVec3::min);
        let max = self.vertices().map(at).fold(DVec3::NEG_INFINITY, DVec3::max);
        (max - min).length()
    }

    /// Particles at `centres` that reach `radius`, with the given displacements.
    pub fn with_particles(mut self, particles: &[(DVec3, DVec3)], radius: f64) -> Self {
        let rows: Vec<Vec<Influence>> = self.vertices().map(|v| influences(self.rows.rest(v), particles, radius)).collect();
        self.map.influences = SlotCsr::from_rows(rows.iter().map(Vec::as_slice));
        self.map.anchors = particles.iter().map(|_| VertexId(0)).collect::<Vec<_>>().into();
        self.map.rest_displacement = vec![[0.0; 3]; particles.len()].into();
        self.map.neighbours = SlotCsr::with_rows(particles.len());
        self.displacements = particles.iter().map(|p| p.1).collect();
        self
    }
}

fn influences(rest: DVec3, particles: &[(DVec3, DVec3)], radius: f64) -> Vec<Influence> {
    let weight = |p: &(DVec3, DVec3)| {
        let x = (1.0 - rest.distance(p.0) / radius).max(0.0);
        x * x * (3.0 - 2.0 * x)
    };
    let sum: f64 = particles.iter().map(weight).sum();
    let influence = |(j, p): (usize, &(DVec3, DVec3))| Influence {
        particle: incise::geometry::ParticleId::new(j),
        weight: (weight(p) / sum) as f32,
    };
    particles.iter().enumerate().filter(|(_, p)| weight(p) > 0.0).map(influence).collect()
}

fn wedge(v: usize, normal: DVec3) -> Wedge {
    Wedge {
        vertex: VertexId::new(v),
        group: WedgeId::new(v),
        uv: [0.0, 0.0],
        normal: normal.as_vec3().to_array(),
        colour: u32::MAX,
    }
}

fn smooth_normals(positions: &[[f32; 3]], faces: &[[u32; 3]]) -> Vec<DVec3> {
    let at = |v: u32| glam::Vec3::from_array(positions[v as usize]).as_dvec3();
    let mut sums = vec![DVec3::ZERO; positions.len()];
    for f in faces {
        let area = (at(f[1]) - at(f[0])).cross(at(f[2]) - at(f[0]));
        f.iter().for_each(|&v| sums[v as usize] += area);
    }
    sums.into_iter().map(|n| n.normalize_or(DVec3::Z)).collect()
}

/// A cube of `n` x `n` quads a side, blown up to a sphere of the given radius: 12 n^2 faces.
pub fn sphere(n: usize, radius: f64) -> Model {
    let (positions, faces) = box_surface([n, n, n], |p| (p - 0.5).normalize() * radius);
    let bones = SlotCsr::with_rows(positions.len());
    Model::new(positions, faces, bones)
}

/// A rounded bar along x, 1 x 0.2 x 0.2, centred: two joints that blend around the middle.
pub fn bar(n: usize) -> Model {
    let shape = |p: DVec3| {
        let q = (p - 0.5) * DVec3::new(1.0, 0.2, 0.2);
        let section = DVec3::new(0.0, q.y, q.z);
        let blunt = 0.09 * (1.0 - (2.0 * q.x).powi(8)).max(0.0).sqrt() + 0.02;
        DVec3::new(q.x, 0.0, 0.0) + section.normalize_or_zero() * section.abs().max_element() / 0.1 * blunt
    };
    let (positions, faces) = box_surface([5 * n, n, n], shape);
    let bones: Vec<Vec<BoneWeight>> = positions.iter().map(|p| bar_bones(p[0])).collect();
    let mut model = Model::new(positions, faces, SlotCsr::from_rows(bones.iter().map(Vec::as_slice)));
    model.pose = bend(0.0);
    model
}

fn bar_bones(x: f32) -> Vec<BoneWeight> {
    let t = (x / 0.3 + 0.5).clamp(0.0, 1.0);
    let weights = [(0, 1.0 - t), (1, t * 0.9), (2, t * 0.1)];
    weights.iter().filter(|w| w.1 > 0.0).map(|&(joint, weight)| BoneWeight { joint, weight }).collect()
}

/// The bar's pose: joint 1 turns by `angle` around z, joint 2 half as far with a twist; joint 0 leans a little.
pub fn bend(angle: f64) -> Pose {
    let about = |q: DQuat, p: DVec3| DAffine3::from_translation(p) * DAffine3::from_quat(q) * DAffine3::from_translation(-p);
    let joints = [
        about(DQuat::from_rotation_y(0.1 * angle), DVec3::new(-0.5, 0.0, 0.0)),
        about(DQuat::from_rotation_z(angle), DVec3::ZERO),
        about(DQuat::from_rotation_z(0.5 * angle) * DQuat::from_rotation_x(angle), DVec3::new(0.1, 0.02, 0.0)),
    ];
    Pose { joint_matrices: joints.into_iter().map(JointMatrix::from_affine).collect() }
}

/// The surface of a box of unit size, `n` quads along each axis, points mapped by `shape`; faces point outwards.
fn box_surface(n: [usize; 3], shape: impl Fn(DVec3) -> DVec3) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let mut ids = std::collections::BTreeMap::new();
    let mut positions = Vec::new();
    let mut faces = Vec::new();
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for side in 0..2 {
            for (i, j) in (0..n[u]).flat_map(|i| (0..n[v]).map(move |j| (i, j))) {
                let mut corner = |di: usize, dj: usize| {
                    let mut key = [0; 3];
                    (key[axis], key[u], key[v]) = (side * n[axis], i + di, j + dj);
                    *ids.entry(key).or_insert_with(|| {
                        let p = DVec3::from_array(std::array::from_fn(|k| key[k] as f64 / n[k] as f64));
                        positions.push(shape(p).as_vec3().to_array());
                        positions.len() as u32 - 1
                    })
                };
                let quad = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                let mut halves = [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]];
                if side == 0 {
                    halves.iter_mut().for_each(|f| f.swap(1, 2));
                }
                faces.extend(halves);
            }
        }
    }
    (positions, faces)
}

/// Writes a PNG under the target folder and returns its path.
pub fn write_png(name: &str, size: (u32, u32), rgba: &[u8]) -> std::path::PathBuf {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"));
    let path = folder.join(format!("{name}.png"));
    image::save_buffer(&path, rgba, size.0, size.1, image::ExtendedColorType::Rgba8).expect("the target folder is writable");
    path
}
