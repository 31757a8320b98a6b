//! Checking a particle map from scratch, rule by rule.

use super::particle_map::ParticleMap;
use super::strips::Strips;
use crate::geometry::{Mesh, ParticleId, VertexId};
use glam::DVec3;

/// Largest deviation of a vertex's weights from a sum of 1: f32 rounding of some twenty terms.
const WEIGHT_TOLERANCE: f64 = 1e-5;

impl ParticleMap {
    /// Checks shapes, anchors, influences, neighbours and that nothing links across a strip (MATHS 3.1, 3.2). Recomputed
    /// from scratch, in proportion to the map. The message names the first breach.
    pub fn validate(&self, mesh: &Mesh, rest: &[DVec3], strips: &Strips) -> Result<(), String> {
        self.check_shapes(mesh, rest)?;
        self.check_particles(mesh)?;
        self.check_influences(mesh, rest, strips)?;
        self.check_neighbours(rest, strips)?;
        self.check_reached(mesh)?;
        strips.check_places(self, rest)?;
        strips.validate()
    }

    fn check_shapes(&self, mesh: &Mesh, rest: &[DVec3]) -> Result<(), String> {
        let counts = [self.rest_displacement.len(), self.neighbours.rows()];
        if counts != [self.len(); 2] {
            return Err(format!("{} particles, but {counts:?} rest displacements and neighbour rows", self.len()));
        }
        if self.influences.rows() != mesh.vertex_slots() || rest.len() < mesh.vertex_slots() {
            return Err(format!("{} influence rows for {} vertices", self.influences.rows(), mesh.vertex_slots()));
        }
        Ok(())
    }

    fn check_particles(&self, mesh: &Mesh) -> Result<(), String> {
        for (j, &anchor) in self.anchors.iter().enumerate() {
            let is_retired = anchor.is_none();
            if !is_retired && (anchor.index() >= mesh.vertex_slots() || !mesh.vertex_is_live(anchor)) {
                return Err(format!("particle {j} has a dead anchor, vertex {anchor:?}"));
            }
            let u0 = self.rest_displacement[j];
            if !u0.iter().all(|x| x.is_finite()) || (is_retired && u0 != [0.0; 3]) {
                return Err(format!("particle {j} has rest displacement {u0:?}"));
            }
            if is_retired && !self.neighbours.row(j).is_empty() {
                return Err(format!("retired particle {j} has neighbours"));
            }
        }
        Ok(())
    }

    fn is_live_particle(&self, j: ParticleId) -> bool {
        self.anchors.get(j.index()).is_some_and(|a| a.is_some())
    }

    fn check_influences(&self, mesh: &Mesh, rest: &[DVec3], strips: &Strips) -> Result<(), String> {
        for v in (0..mesh.vertex_slots()).map(VertexId::new) {
            let row = self.influences.row(v.index());
            if !mesh.vertex_is_live(v) {
                if !row.is_empty() {
                    return Err(format!("dead vertex {v:?} has influences"));
                }
                continue;
            }
            if !row.is_sorted_by(|a, b| a.particle < b.particle) {
                return Err(format!("influences of vertex {v:?} are not sorted, each particle once"));
            }
            for e in row {
                if !self.is_live_particle(e.particle) {
                    return Err(format!("vertex {v:?} is influenced by {:?}, which is retired or missing", e.particle));
                }
                if !(e.weight > 0.0 && e.weight <= 1.0) {
                    return Err(format!("vertex {v:?} has weight {}", e.weight));
                }
                if !strips.connects_vertices(rest, v, self.anchors[e.particle.index()]) {
                    return Err(format!("the influence of {:?} on vertex {v:?} crosses a strip", e.particle));
                }
            }
            let sum: f64 = row.iter().map(|e| f64::from(e.weight)).sum();
            if !row.is_empty() && (sum - 1.0).abs() > WEIGHT_TOLERANCE {
                return Err(format!("weights of vertex {v:?} sum to {sum}"));
            }
        }
        Ok(())
    }

    fn check_neighbours(&self, rest: &[DVec3], strips: &Strips) -> Result<(), String> {
        for j in (0..self.len()).map(ParticleId::new) {
            let row = self.neighbours.row(j.index());
            if !row.is_sorted_by(|a, b| a.particle < b.particle) {
                return Err(format!("neighbours of {j:?} are not sorted, each particle once"));
            }
            for link in row {
                let k = link.particle;
                if k == j || !self.is_live_particle(k) {
                    return Err(format!("{j:?} is a neighbour of {k:?}, which is itself, retired or missing"));
                }
                if !(link.weight.is_finite() && link.weight > 0.0) {
                    return Err(format!("the link of {j:?} and {k:?} has weight {}", link.weight));
                }
                let back = self.neighbours.row(k.index()).iter().find(|l| l.particle == j);
                if back.map(|l| l.weight) != Some(link.weight) {
                    return Err(format!("the link of {j:?} and {k:?} is not symmetric"));
                }
                if !strips.connects_vertices(rest, self.anchors[j.index()], self.anchors[k.index()]) {
                    return Err(format!("the link of {j:?} and {k:?} crosses a strip"));
                }
            }
        }
        Ok(())
    }

    /// Every live vertex of a component with a particle has an influence.
    fn check_reached(&self, mesh: &Mesh) -> Result<(), String> {
        let mut has_particle = vec![false; mesh.vertex_slots()];
        let mut queue: Vec<VertexId> = self.anchors.iter().copied().filter(|a| a.is_some()).collect();
        for v in &queue {
            has_particle[v.index()] = true;
        }
        while let Some(v) = queue.pop() {
            for n in mesh.neighbours(v) {
                if !std::mem::replace(&mut has_particle[n.index()], true) {
                    queue.push(n);
                }
            }
        }
        match mesh.live_vertices().find(|v| has_particle[v.index()] && self.influences.row(v.index()).is_empty()) {
            Some(v) => Err(format!("vertex {v:?} has no influence, but its component has particles")),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::{Influence, Link, ParticleSettings, sample, test_models};

    fn good() -> (Mesh, Vec<DVec3>, ParticleMap) {
        let (mesh, rest) = test_models::grid(12, 0.3, 1);
        let settings = ParticleSettings::with_spacing(0.25);
        let anchors = sample(&mesh, &rest, settings.spacing, 1);
        let (map, _) = ParticleMap::build(&mesh, &rest, &anchors, &settings);
        (mesh, rest, map)
    }

    fn message(break_it: impl FnOnce(&mut ParticleMap)) -> String {
        let (mesh, rest, mut map) = good();
        break_it(&mut map);
        map.validate(&mesh, &rest, &Strips::default()).unwrap_err()
    }

    fn rewrite(map: &mut ParticleMap, v: usize, change: impl FnOnce(&mut Vec<Influence>)) {
        let mut row = map.influences.row(v).to_vec();
        change(&mut row);
        map.influences.set_row(v, &row);
    }

    fn relink(map: &mut ParticleMap, j: usize, change: impl FnOnce(&mut Vec<Link>)) {
        let mut row = map.neighbours.row(j).to_vec();
        change(&mut row);
        map.neighbours.set_row(j, &row);
    }

    #[test]
    fn a_built_map_is_valid() {
        let (mesh, rest, map) = good();
        map.validate(&mesh, &rest, &Strips::default()).unwrap();
    }

    #[test]
    fn each_rule_of_the_particles_is_checked() {
        assert!(message(|m| _ = m.rest_displacement.push([0.0; 3])).contains("rest displacements"));
        assert!(message(|m| _ = m.influences.push_row(&[])).contains("influence rows"));
        assert!(message(|m| m.anchors.set(0, VertexId(1 << 20))).contains("dead anchor"));
        assert!(message(|m| m.rest_displacement.set(0, [f64::NAN; 3])).contains("rest displacement"));
        assert!(message(|m| m.anchors.set(0, VertexId::NONE)).contains("has neighbours"));
    }

    #[test]
    fn each_rule_of_the_influences_is_checked() {
        let v = 80;
        assert!(message(|m| rewrite(m, v, |r| r.swap(0, 1))).contains("sorted"));
        assert!(message(|m| rewrite(m, v, |r| r[1] = r[0])).contains("sorted"));
        assert!(message(|m| rewrite(m, v, |r| r.last_mut().unwrap().particle = ParticleId(999))).contains("missing"));
        assert!(message(|m| rewrite(m, v, |r| r[0].weight = f32::NAN)).contains("has weight"));
        assert!(message(|m| rewrite(m, v, |r| r[0].weight *= 0.9)).contains("sum to"));
        assert!(message(|m| rewrite(m, v, Vec::clear)).contains("no influence"));
    }

    #[test]
    fn each_rule_of_the_neighbours_is_checked() {
        assert!(message(|m| relink(m, 2, |r| r.swap(0, 1))).contains("sorted"));
        assert!(message(|m| relink(m, 0, |r| r[0].weight = -1.0)).contains("weight"));
        assert!(message(|m| relink(m, 2, |r| r.truncate(1))).contains("symmetric"));
        assert!(message(|m| relink(m, 2, |r| r[0].weight *= 1.5)).contains("symmetric"));
        let myself = |m: &mut ParticleMap| {
            relink(m, 0, |r| {
                r.clear();
                r.push(Link { particle: ParticleId(0), weight: 1.0 });
            });
        };
        assert!(message(myself).contains("itself"));
    }

    #[test]
    fn a_dead_vertex_has_no_influences() {
        let (mut mesh, mut rest, mut map) = good();
        mesh.add_vertex();
        rest.push(DVec3::ZERO);
        map.influences.push_row(&[Influence { particle: ParticleId(0), weight: 1.0 }]);
        assert!(map.validate(&mesh, &rest, &Strips::default()).unwrap_err().contains("dead vertex"));
    }

    #[test]
    fn links_across_a_strip_are_found() {
        let (mesh, rest, map) = good();
        let mut strips = Strips::default();
        let corner = |x: f64, z: f64| DVec3::new(x, 0.47, z);
        strips.push([corner(0.3, -0.1), corner(0.7, -0.1), corner(0.7, 0.0), corner(0.3, 0.0)], 0.4, 0).unwrap();
        assert!(map.validate(&mesh, &rest, &strips).unwrap_err().contains("crosses a strip"));
        let mut no_influences = map.clone();
        for v in 0..rest.len() {
            rewrite(&mut no_influences, v, Vec::clear);
        }
        assert!(no_influences.check_neighbours(&rest, &strips).unwrap_err().contains("crosses a strip"));
    }
}
