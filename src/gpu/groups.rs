//! Which workgroups of the deform pass hang on which particles, so that a poke in one place does not deform the whole model
//! (MATHS 4.5): found out little by little, and only while particles move and nothing else does.

use super::deform::GROUP;
use super::view::TissueView;
use crate::geometry::{VertexId, WedgeId};

/// Workgroups looked at in one call of [`Groups::advance`]: about half a millisecond.
const BUDGET: usize = 1024;

/// Lists of one kind of workgroup, in order.
#[derive(Debug, Default)]
struct Lists {
    ends: Vec<u32>,
    entries: Vec<u32>,
}

impl Lists {
    fn clear(&mut self) {
        self.ends.clear();
        self.entries.clear();
    }

    fn push(&mut self, entries: &mut Vec<u32>) {
        entries.sort_unstable();
        entries.dedup();
        self.entries.append(entries);
        self.ends.push(self.entries.len() as u32);
    }

    fn of(&self, group: usize) -> &[u32] {
        let start = if group == 0 { 0 } else { self.ends[group - 1] };
        &self.entries[start as usize..self.ends[group] as usize]
    }
}

/// Particles by group of vertices, and groups of vertices by group of wedges: a normal needs the positions around it. The distance from a
/// wound's lip needs those a ring farther out, too, which are not looked at: where they alone have moved they are at the end of their
/// particles' reach, and a vertex keeps a distance for its picture that is off by no more than they have moved.
#[derive(Debug, Default)]
pub struct Groups {
    particles: Lists,
    around: Lists,
    scratch: Vec<u32>,
    /// By group of vertices, in [`Groups::visit`].
    moved: Vec<bool>,
}

/// Entries of a workgroup's list that there is room for, on average.
const ENTRIES: usize = 24;

impl Groups {
    /// Makes room for a mesh of so many vertices and wedges.
    pub fn make_room(&mut self, vertices: usize, wedges: usize) {
        for (lists, count) in [(&mut self.particles, vertices), (&mut self.around, wedges)] {
            let groups = count.div_ceil(GROUP as usize);
            lists.ends.reserve(groups);
            lists.entries.reserve(ENTRIES * groups);
        }
        self.moved.reserve(vertices.div_ceil(GROUP as usize));
        self.scratch.reserve(ENTRIES * GROUP as usize);
    }

    /// The mesh or the map has changed.
    pub fn forget(&mut self) {
        self.particles.clear();
        self.around.clear();
    }

    /// Looks at some more groups. True once all are known.
    pub fn advance(&mut self, view: &TissueView<'_>) -> bool {
        let (vertices, wedges) = (view.mesh.vertex_slots(), view.mesh.wedges().len());
        let size = GROUP as usize;
        for _ in 0..BUDGET {
            let (p, w) = (self.particles.ends.len(), self.around.ends.len());
            if p * size < vertices {
                let rows = (p * size..((p + 1) * size).min(vertices)).filter(|&v| v < view.map.influences.rows());
                self.scratch.extend(rows.flat_map(|v| view.map.influences.row(v)).map(|i| i.particle.0));
                self.particles.push(&mut self.scratch);
            } else if w * size < wedges {
                for wedge in (w * size..((w + 1) * size).min(wedges)).map(|w| view.mesh.wedge(WedgeId::new(w))) {
                    let group = |v: VertexId| v.0 / GROUP;
                    if wedge.vertex.index() < vertices && view.mesh.vertex_is_live(wedge.vertex) {
                        self.scratch.push(group(wedge.vertex));
                        self.scratch.extend(view.mesh.neighbours(wedge.vertex).map(group));
                    }
                }
                self.around.push(&mut self.scratch);
            } else {
                return true;
            }
        }
        false
    }

    /// Calls `found` with the stage (0: vertices, 1: wedges) and the first element of each group that hangs on a particle of which
    /// `has_moved` is true. Everything must be known.
    pub fn visit(&mut self, has_moved: impl Fn(usize) -> bool, mut found: impl FnMut(usize, u32)) {
        self.moved.clear();
        for group in 0..self.particles.ends.len() {
            let moved = self.particles.of(group).iter().any(|&j| has_moved(j as usize));
            self.moved.push(moved);
            if moved {
                found(0, group as u32 * GROUP);
            }
        }
        for group in 0..self.around.ends.len() {
            if self.around.of(group).iter().any(|&g| self.moved[g as usize]) {
                found(1, group as u32 * GROUP);
            }
        }
    }
}
