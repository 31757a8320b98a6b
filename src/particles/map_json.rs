//! The particle map as `incise particles --out` and `--map-out` write it, for outsiders' checks (see the contract of the
//! command line). Rest positions: strips and links are tested at rest.

use super::particle_map::ParticleMap;
use super::strips::Strips;
use crate::geometry::{Mesh, VertexId};
use glam::DVec3;
use serde::Serialize;

/// The whole file. Dead vertices and retired particles are left out; indices count what is listed.
#[derive(Clone, Debug, Serialize, PartialEq)]
pub struct MapJson {
    /// Particles.
    pub particles: Vec<ParticleJson>,
    /// Rest positions of the live (welded) vertices in model space, metres.
    pub vertices: Vec<[f64; 3]>,
    /// Influences, by vertex.
    pub influences: Vec<InfluenceJson>,
    /// Neighbour pairs, each once, `a < b`.
    pub neighbours: Vec<NeighbourJson>,
    /// Strips, oldest first.
    pub strips: Vec<StripJson>,
    /// Lip vertices and the side of a strip that each is known to be on.
    pub lips: Vec<LipJson>,
}

/// A particle.
#[derive(Clone, Debug, Serialize, PartialEq)]
pub struct ParticleJson {
    /// Its anchor, an index into [`MapJson::vertices`].
    pub vertex: usize,
    /// The anchor's rest position in model space, metres.
    pub anchor: [f64; 3],
    /// Displacement at rest, metres; zero but for wound particles.
    pub rest_displacement: [f64; 3],
}

/// An influence.
#[derive(Clone, Debug, Serialize, PartialEq)]
pub struct InfluenceJson {
    /// Index into [`MapJson::vertices`].
    pub vertex: usize,
    /// Index into [`MapJson::particles`].
    pub particle: usize,
    /// Normalised weight.
    pub weight: f32,
}

/// A pair of neighbours, indices into [`MapJson::particles`].
#[derive(Clone, Debug, Serialize, PartialEq)]
pub struct NeighbourJson {
    /// The lower index.
    pub a: usize,
    /// The higher index.
    pub b: usize,
    /// Relative stiffness.
    pub weight: f32,
}

/// A strip.
#[derive(Clone, Debug, Serialize, PartialEq)]
pub struct StripJson {
    /// `tip0, tip1, base1, base0` in model space at rest, metres, not extended.
    pub corners: [[f64; 3]; 4],
    /// The radius of influence `d` that the test extends it by: `d` above the base, `d / 4` below the tip.
    pub radius: f64,
    /// What is tested: the extended corners' triangles `tip0, tip1, base1` and `tip0, base1, base0`, metres. Those of a strip that is not
    /// flat at rest do not lie in the planes of [`StripJson::corners`]; where one is folded the smaller is turned over, or the larger stands
    /// twice.
    pub tested: [[[f64; 3]; 3]; 2],
}

/// A lip vertex.
#[derive(Clone, Debug, Serialize, PartialEq)]
pub struct LipJson {
    /// Index into [`MapJson::vertices`].
    pub vertex: usize,
    /// Index into [`MapJson::strips`].
    pub strip: usize,
    /// +1 on the side of `(tip1 - tip0) x (base - tip)`, -1 on the other.
    pub side: i32,
}

/// The file of a map. `rest` has a position for every vertex slot; `model_from_tissue` is added to every position.
pub fn map_json(mesh: &Mesh, rest: &[DVec3], map: &ParticleMap, strips: &Strips, model_from_tissue: DVec3) -> MapJson {
    let place = |p: DVec3| (p + model_from_tissue).to_array();
    let mut vertex_index = vec![usize::MAX; mesh.vertex_slots()];
    let mut vertices = Vec::new();
    for v in mesh.live_vertices() {
        vertex_index[v.index()] = vertices.len();
        vertices.push(place(rest[v.index()]));
    }
    let mut particle_index = vec![usize::MAX; map.len()];
    let mut particles = Vec::new();
    for (j, anchor) in map.anchors.iter().enumerate().filter(|(_, a)| a.is_some()) {
        particle_index[j] = particles.len();
        particles.push(ParticleJson {
            vertex: vertex_index[anchor.index()],
            anchor: place(rest[anchor.index()]),
            rest_displacement: map.rest_displacement[j],
        });
    }
    let influences = mesh.live_vertices().flat_map(|v| {
        let vertex = vertex_index[v.index()];
        let entry = |e: &super::Influence| (particle_index[e.particle.index()], e.weight);
        map.influences.row(v.index()).iter().map(entry).map(move |(particle, weight)| InfluenceJson { vertex, particle, weight })
    });
    let neighbours = (0..map.len()).flat_map(|j| {
        let later = map.neighbours.row(j).iter().filter(move |l| l.particle.index() > j);
        let (a, particle_index) = (particle_index[j], &particle_index);
        later.map(move |l| NeighbourJson { a, b: particle_index[l.particle.index()], weight: l.weight })
    });
    let lips = mesh.live_vertices().flat_map(|v: VertexId| {
        let vertex = vertex_index[v.index()];
        strips.lip_sides(v).iter().map(move |l| LipJson { vertex, strip: l.strip as usize, side: l.side })
    });
    MapJson {
        influences: influences.collect(),
        neighbours: neighbours.collect(),
        strips: strips
            .as_slice()
            .iter()
            .enumerate()
            .map(|(s, strip)| StripJson {
                corners: strip.corners.map(|c| place(DVec3::from_array(c))),
                radius: strip.reach,
                tested: strips.geometry(s).triangles.map(|t| t.map(place)),
            })
            .collect(),
        lips: lips.collect(),
        vertices,
        particles,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::{ParticleSettings, sample, test_models};

    #[test]
    fn the_file_has_the_contract_s_keys_and_numbers() {
        let (mesh, rest) = test_models::grid(10, 0.3, 1);
        let settings = ParticleSettings::with_spacing(0.3);
        let anchors = sample(&mesh, &rest, settings.spacing, 1);
        let (map, _) = ParticleMap::build(&mesh, &rest, &anchors, &settings);
        let mut strips = Strips::default();
        strips.push([DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Z, DVec3::Z], 0.5, 0).unwrap();
        let offset = DVec3::new(1.0, 2.0, 3.0);
        let json = serde_json::to_value(map_json(&mesh, &rest, &map, &strips, offset)).unwrap();
        let keys = ["particles", "vertices", "influences", "neighbours", "strips"];
        assert!(keys.iter().all(|k| json[k].as_array().is_some_and(|a| !a.is_empty())));
        assert_eq!(json["vertices"].as_array().unwrap().len(), rest.len());
        assert_eq!(json["influences"].as_array().unwrap().len(), map.influences.len());
        assert_eq!(2 * json["neighbours"].as_array().unwrap().len(), map.neighbours.len());
        assert_eq!(json["strips"][0]["corners"][1], serde_json::json!([2.0, 2.0, 3.0]));
        assert_eq!(json["strips"][0]["tested"][1][2], serde_json::json!([1.0, 2.0, 4.5]), "half a metre above the base");
        let first = &json["particles"][0];
        let vertex = first["vertex"].as_u64().unwrap() as usize;
        assert_eq!(vertex, anchors[0].index());
        assert_eq!(first["anchor"], serde_json::json!((rest[vertex] + offset).to_array()));
        assert_eq!(first["anchor"], json["vertices"][vertex]);
    }
}
