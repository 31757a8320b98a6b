//! Influence rows under work in an update: who holds which vertex, before weights are known.

use super::map_update::EXTRA_INFLUENCES;
use super::particle_map::ParticleMap;
use super::settings::MAX_INFLUENCES;
use crate::geometry::room::fit;
use crate::geometry::{ParticleId, VertexId};

/// Particles a row may hold while it is worked on; the strongest survive the write.
const ROOM: usize = 2 * (MAX_INFLUENCES + EXTRA_INFLUENCES);

/// One row under work.
#[derive(Clone, Debug)]
pub struct WorkRow {
    vertex: VertexId,
    is_new: bool,
    len: u8,
    refused: u8,
    /// Those that hold the vertex, from the front; from the back, as far as there is room, some that a strip parts from it.
    particles: [ParticleId; ROOM],
    /// For a new vertex: what its parents had, tested or not, for the vertices made from it.
    inherited: (u32, u32),
}

impl WorkRow {
    /// Adds a particle unless it is there or the row is full.
    pub fn add(&mut self, j: ParticleId) {
        let len = usize::from(self.len);
        if len < ROOM && !self.particles[..len].contains(&j) {
            self.particles[len] = j;
            self.len += 1;
            self.refused = self.refused.min((ROOM - len - 1) as u8);
        }
    }

    /// Notes that a strip parts a particle from the vertex: it need not be asked again.
    pub fn refuse(&mut self, j: ParticleId) {
        let (len, refused) = (usize::from(self.len), usize::from(self.refused));
        if len + refused < ROOM {
            self.particles[ROOM - 1 - refused] = j;
            self.refused += 1;
        }
    }

    /// Particles that [`WorkRow::refuse`] was told of, as far as there was room for them.
    pub fn refused(&self) -> &[ParticleId] {
        &self.particles[ROOM - usize::from(self.refused)..]
    }

    /// Removes a particle; false if it is not there.
    pub fn remove(&mut self, j: ParticleId) -> bool {
        let len = usize::from(self.len);
        let Some(at) = self.particles[..len].iter().position(|&p| p == j) else { return false };
        self.particles.copy_within(at + 1..len, at);
        self.len -= 1;
        true
    }

    /// Removes a particle that a strip parts from the vertex; false if it is not there.
    pub fn part(&mut self, j: ParticleId) -> bool {
        let is_there = self.remove(j);
        if is_there {
            self.refuse(j);
        }
        is_there
    }

    /// True for the row of a vertex that the edit has made.
    pub fn is_new(&self) -> bool {
        self.is_new
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        usize::from(self.len)
    }
}

/// Rows under work, found by vertex through a stamped table.
#[derive(Clone, Debug, Default)]
pub struct WorkRows {
    /// Round and row of each vertex slot.
    slots: Vec<(u32, u32)>,
    round: u32,
    rows: Vec<WorkRow>,
    inherited: Vec<ParticleId>,
}

impl WorkRows {
    /// Makes room for an update of so many rows on a mesh of so many vertices.
    pub(super) fn make_room(&mut self, rows: usize, slots: usize) {
        self.slots.reserve(slots);
        self.rows.reserve(rows);
        self.inherited.reserve(8 * rows);
    }

    /// Starts an update of a mesh with `vertices` slots: no row is open.
    pub fn begin(&mut self, vertices: usize) {
        if self.round == u32::MAX {
            self.slots.fill((0, 0));
            self.round = 0;
        }
        self.round += 1;
        fit(&mut self.slots, vertices, (0, 0));
        self.rows.clear();
        self.inherited.clear();
    }

    /// The row of `v`, opened with what the map has.
    pub fn open(&mut self, v: VertexId, map: &ParticleMap) -> &mut WorkRow {
        if !self.is_open(v) {
            self.push(v);
            let row = self.rows.last_mut().expect("just pushed");
            // the map lists each once, and no more than there is room for
            let known = map.influences.row(v.index());
            row.particles.iter_mut().zip(known).for_each(|(j, known)| *j = known.particle);
            row.len = known.len().min(ROOM) as u8;
        }
        &mut self.rows[self.slots[v.index()].1 as usize]
    }

    /// Opens the empty row of a new vertex whose parents had `inherited`.
    pub fn open_new(&mut self, v: VertexId, inherited: &[ParticleId]) {
        let start = self.inherited.len() as u32;
        self.inherited.extend_from_slice(inherited);
        if !self.is_open(v) {
            self.push(v);
        }
        let row = &mut self.rows[self.slots[v.index()].1 as usize];
        row.is_new = true;
        row.inherited = (start, self.inherited.len() as u32);
    }

    fn push(&mut self, v: VertexId) {
        self.slots[v.index()] = (self.round, self.rows.len() as u32);
        let particles = [ParticleId::NONE; ROOM];
        self.rows.push(WorkRow { vertex: v, is_new: false, len: 0, refused: 0, particles, inherited: (0, 0) });
    }

    /// True if the row of `v` is open.
    pub fn is_open(&self, v: VertexId) -> bool {
        self.slots[v.index()].0 == self.round
    }

    /// What [`WorkRows::open_new`] noted for `v`; empty for old vertices.
    pub fn inherited(&self, v: VertexId) -> &[ParticleId] {
        if !self.is_open(v) {
            return &[];
        }
        let (start, end) = self.rows[self.slots[v.index()].1 as usize].inherited;
        &self.inherited[start as usize..end as usize]
    }

    /// Particle `i` of the row of `v`, open or not.
    pub fn particle(&self, v: VertexId, i: usize, map: &ParticleMap) -> Option<ParticleId> {
        if self.is_open(v) {
            let row = &self.rows[self.slots[v.index()].1 as usize];
            return row.particles[..row.len()].get(i).copied();
        }
        map.influences.row(v.index()).get(i).map(|e| e.particle)
    }

    /// Calls `found` for the particles of the row of `v`, open or not.
    #[inline]
    pub fn each(&self, v: VertexId, map: &ParticleMap, mut found: impl FnMut(ParticleId)) {
        if self.is_open(v) {
            let row = &self.rows[self.slots[v.index()].1 as usize];
            row.particles[..row.len()].iter().for_each(|&j| found(j));
        } else {
            map.influences.row(v.index()).iter().for_each(|e| found(e.particle));
        }
    }

    /// Particles that a strip was seen to part from `v` in this update.
    pub fn refused(&self, v: VertexId) -> &[ParticleId] {
        if self.is_open(v) { self.rows[self.slots[v.index()].1 as usize].refused() } else { &[] }
    }

    /// True if `j` holds `v`.
    pub fn holds(&self, v: VertexId, j: ParticleId, map: &ParticleMap) -> bool {
        (0..).map_while(|i| self.particle(v, i, map)).any(|p| p == j)
    }

    /// Number of open rows.
    pub fn count(&self) -> usize {
        self.rows.len()
    }

    /// Vertex of open row `i`.
    pub fn vertex(&self, i: usize) -> VertexId {
        self.rows[i].vertex
    }

    /// True if open row `i` is a new vertex's.
    pub fn is_new(&self, i: usize) -> bool {
        self.rows[i].is_new
    }

    /// Particles of open row `i`.
    pub fn particles(&self, i: usize) -> &[ParticleId] {
        &self.rows[i].particles[..self.rows[i].len()]
    }

    /// Puts the vertices of all open rows into `out`, in the order they were opened.
    pub fn list(&self, out: &mut Vec<VertexId>) {
        out.clear();
        out.extend(self.rows.iter().map(|row| row.vertex));
    }
}
