//! A uniform grid over points: what is near, whatever its sheet.

use crate::geometry::room::headroom;
use glam::DVec3;

/// Most cells a side, so that a tiny reach in a large model stays cheap.
const MAX_SIDE: f64 = 128.0;

/// Points, anchors of particles or vertices, by cell. Derived data: a superset that answers are filtered by, so an entry that an undo or a move has made
/// stale does no harm.
#[derive(Clone, Debug, Default)]
pub struct PointGrid {
    origin: DVec3,
    inverse_cell: f64,
    sides: [usize; 3],
    heads: Vec<u32>,
    /// Index of the point and the next entry of its cell.
    entries: Vec<(u32, u32)>,
    /// For each point the cell it was last put in.
    cell_of: Vec<u32>,
}

impl PointGrid {
    /// A grid over points, numbered as they come (`None` is left out), with cells of about `reach`.
    pub fn build(points: impl Iterator<Item = Option<DVec3>> + Clone, reach: f64) -> Self {
        let mut grid = Self::over(points.clone().flatten(), reach);
        for (j, p) in points.enumerate() {
            if let Some(p) = p {
                grid.insert(j as u32, p);
            }
        }
        grid
    }

    /// An empty grid over the bounds of `points` with cells of about `reach`.
    pub fn over(points: impl Iterator<Item = DVec3>, reach: f64) -> Self {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for p in points.filter(|p| p.is_finite()) {
            (low, high) = (low.min(p), high.max(p));
        }
        if low.x <= high.x { Self::between(low, high, reach) } else { Self::between(DVec3::ZERO, DVec3::ZERO, reach) }
    }

    /// An empty grid over a box, with cells of about `reach`.
    pub fn between(low: DVec3, high: DVec3, reach: f64) -> Self {
        let extent = high - low;
        let cell = reach.max(extent.max_element() / MAX_SIDE).max(f64::MIN_POSITIVE);
        let sides = [extent.x, extent.y, extent.z].map(|e| ((e / cell) as usize).min(MAX_SIDE as usize) + 1);
        Self {
            origin: low,
            inverse_cell: 1.0 / cell,
            sides,
            heads: vec![u32::MAX; sides[0] * sides[1] * sides[2]],
            entries: Vec::new(),
            cell_of: Vec::new(),
        }
    }

    /// True before the first build.
    pub fn is_empty(&self) -> bool {
        self.heads.is_empty()
    }

    /// Makes room for points that come later.
    pub fn make_room(&mut self) {
        self.entries.reserve(headroom(self.entries.len()));
        self.cell_of.reserve(headroom(self.cell_of.len()));
    }

    /// Adds a point at a position; where it was before stays as a stale entry.
    pub fn insert(&mut self, point: u32, at: DVec3) {
        if self.heads.is_empty() {
            return;
        }
        let [x, y, z] = self.cell(at);
        let cell = (z * self.sides[1] + y) * self.sides[0] + x;
        if self.cell_of.len() <= point as usize {
            self.cell_of.resize(point as usize + 1, u32::MAX);
        }
        if self.cell_of[point as usize] == cell as u32 {
            return;
        }
        self.cell_of[point as usize] = cell as u32;
        self.entries.push((point, self.heads[cell]));
        self.heads[cell] = (self.entries.len() - 1) as u32;
    }

    /// Calls `found` for every point of the cells that the box meets. Some lie outside it, some come twice.
    pub fn visit(&self, low: DVec3, high: DVec3, mut found: impl FnMut(u32)) {
        if self.heads.is_empty() {
            return;
        }
        let (a, b) = (self.cell(low), self.cell(high));
        for z in a[2]..=b[2] {
            for y in a[1]..=b[1] {
                for x in a[0]..=b[0] {
                    let mut next = self.heads[(z * self.sides[1] + y) * self.sides[0] + x];
                    while next != u32::MAX {
                        let (point, after) = self.entries[next as usize];
                        found(point);
                        next = after;
                    }
                }
            }
        }
    }

    /// The cell of a position, clamped to the grid; the casts saturate and take NaN for 0.
    fn cell(&self, p: DVec3) -> [usize; 3] {
        let at = (p - self.origin) * self.inverse_cell;
        let clamp = |x: f64, side: usize| (x as usize).min(side - 1);
        [clamp(at.x, self.sides[0]), clamp(at.y, self.sides[1]), clamp(at.z, self.sides[2])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::test_models::noise;

    #[test]
    fn every_point_of_a_box_is_found() {
        let points: Vec<DVec3> =
            (0..300).map(|i| DVec3::new(noise(3 * i), 2.0 * noise(3 * i + 1), noise(3 * i + 2) - 0.5)).collect();
        let mut grid = PointGrid::build(points[..200].iter().map(|&p| Some(p)), 0.2);
        for (j, &p) in points.iter().enumerate().skip(200) {
            grid.insert(j as u32, p + DVec3::X * 0.5); // outside the built bounds: clamped, not lost
        }
        let at = |j: usize| if j < 200 { points[j] } else { points[j] + DVec3::X * 0.5 };
        for i in 0..50 {
            let low = DVec3::new(noise(i + 1000) * 1.5, noise(i + 2000), noise(i + 3000) - 0.5);
            let high = low + DVec3::splat(0.3);
            let mut found = Vec::new();
            grid.visit(low, high, |p| found.push(p as usize));
            for j in 0..300 {
                if at(j).cmpge(low).all() && at(j).cmple(high).all() {
                    assert!(found.contains(&j));
                }
            }
            assert!(found.len() < 300, "a box must not visit everything");
        }
    }
}
