//! Vertices that lost all their particles get the nearest connected one (MATHS 3.2).

use super::SoftLayer;
use crate::geometry::{Mesh, ParticleId, VertexId};
use crate::particles::Influence;
use std::collections::VecDeque;

impl SoftLayer {
    /// Gives every live vertex without an influence the strongest particle of the nearest covered vertex, in edge steps;
    /// a component without any particle gets one of its own. Returns the vertices it covered.
    pub(super) fn cover(&mut self, mesh: &Mesh) -> Vec<VertexId> {
        let bare = |layer: &Self, v: VertexId| layer.map.influences.row(v.index()).is_empty();
        let mut queue: VecDeque<VertexId> = VecDeque::new();
        let missing: Vec<VertexId> = mesh.live_vertices().filter(|&v| bare(self, v)).collect();
        for &v in &missing {
            queue.extend(mesh.neighbours(v).filter(|&n| !bare(self, n)));
        }
        let mut covered = self.spread(mesh, queue);
        for v in missing {
            if bare(self, v) {
                let particle = self.add_particle(v);
                self.map.influences.set_row(v.index(), &[Influence { particle, weight: 1.0 }]);
                covered.push(v);
                covered.extend(self.spread(mesh, VecDeque::from([v])));
            }
        }
        covered.sort_unstable();
        covered.dedup();
        covered
    }

    fn spread(&mut self, mesh: &Mesh, mut queue: VecDeque<VertexId>) -> Vec<VertexId> {
        let mut covered = Vec::new();
        while let Some(v) = queue.pop_front() {
            let strongest = self.map.influences.row(v.index()).iter().max_by(|a, b| a.weight.total_cmp(&b.weight)).copied();
            let Some(strongest) = strongest else { continue };
            for n in mesh.neighbours(v).filter(|n| self.map.influences.row(n.index()).is_empty()).collect::<Vec<_>>() {
                self.map.influences.set_row(n.index(), &[Influence { weight: 1.0, ..strongest }]);
                covered.push(n);
                queue.push_back(n);
            }
        }
        covered
    }

    fn add_particle(&mut self, anchor: VertexId) -> ParticleId {
        self.map.rest_displacement.push([0.0; 3]);
        self.map.neighbours.push_row(&[]);
        ParticleId::new(self.map.anchors.push(anchor))
    }
}
