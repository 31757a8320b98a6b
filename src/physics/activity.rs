//! Which rows of a network move (MATHS 4.5): a disturbed corner does not wake the whole model.
//!
//! A polynomial of degree `d` in the matrix reaches `d` springs far, so propagating the rows within `d` springs of any
//! restless row gives *exactly* what propagating all rows would, as long as the others are at rest. The others, and
//! grabbed rows, are held: the passes skip them and read zero for them.

use super::matrix::Matrix;
use std::ops::Range;

/// The rows that are awake and those to propagate.
#[derive(Clone, Debug, Default)]
pub struct Activity {
    /// Rows to start from at the next step: inputs changed.
    pub disturbed: Vec<u32>,
    /// Awake rows that were above the rest threshold at the end of the last step.
    pub restless: Vec<u32>,
    /// All awake rows of the last step, grabbed and lone ones included, ascending.
    pub awake: Vec<u32>,
    /// Awake linked rows that are not grabbed, as ascending ranges.
    pub ranges: Vec<Range<u32>>,
    /// Awake lone rows that are not grabbed.
    pub lone: Vec<u32>,
    stamps: Vec<u32>,
    stamp: u32,
    queue: Vec<u32>,
    /// Rows that the last update found asleep and the one before awake.
    pub dropped: Vec<u32>,
}

impl Activity {
    /// Forgets everything and makes room for `rows` rows.
    pub fn reset(&mut self, rows: usize) {
        for list in [&mut self.disturbed, &mut self.restless, &mut self.awake, &mut self.lone, &mut self.queue, &mut self.dropped]
        {
            list.clear();
            list.reserve(rows);
        }
        self.ranges.clear();
        self.ranges.reserve(rows / 2 + 1);
        self.stamps.clear();
        self.stamps.resize(rows, 0);
        self.stamp = 0;
    }

    /// Makes room for so many rows.
    pub fn make_room(&mut self, rows: usize) {
        for list in [&mut self.disturbed, &mut self.restless, &mut self.awake, &mut self.lone, &mut self.queue, &mut self.dropped]
        {
            list.reserve(rows.saturating_sub(list.len()));
        }
        self.ranges.reserve((rows / 2 + 1).saturating_sub(self.ranges.len()));
        self.stamps.reserve(rows.saturating_sub(self.stamps.len()));
    }

    /// Makes room for rows that were appended; who is awake stays.
    pub fn grow(&mut self, rows: usize) {
        self.make_room(rows);
        self.stamps.resize(rows.max(self.stamps.len()), 0);
    }

    /// True if the next step has nothing to do.
    pub fn asleep(&self) -> bool {
        self.disturbed.is_empty() && self.restless.is_empty()
    }

    /// Marks a row as an origin of motion.
    pub fn disturb(&mut self, row: u32) {
        // Bounded by the rows, so that a caller that sets everything every frame does not allocate.
        if self.disturbed.len() < self.stamps.len() {
            self.disturbed.push(row);
        } else {
            self.disturb_all();
        }
    }

    /// Marks every row as an origin.
    pub fn disturb_all(&mut self) {
        self.disturbed.clear();
        self.disturbed.extend(0..self.stamps.len() as u32);
    }

    /// Finds the awake rows, those within `reach` springs of a restless or disturbed one, and those that fell asleep. `linked`:
    /// number of rows with springs, which come first.
    pub fn update(&mut self, matrix: &Matrix, linked: usize, held: &[bool], reach: usize) {
        self.next_stamp();
        self.queue.clear();
        // Every linked row is awake and most are restless: no search is worth its time.
        let full = linked > 0 && self.awake.get(linked - 1) == Some(&(linked as u32 - 1)) && 2 * self.restless.len() > linked;
        if full {
            self.stamps[..linked].fill(self.stamp);
        }
        self.search(matrix, if full { 0 } else { reach });
        self.dropped.clear();
        let (stamps, stamp) = (&self.stamps, self.stamp);
        self.dropped.extend(self.awake.iter().copied().filter(|row| stamps[*row as usize] != stamp));
        self.disturbed.clear();
        self.collect(linked, held);
    }

    fn next_stamp(&mut self) {
        if self.stamp == u32::MAX {
            self.stamps.fill(0);
            self.stamp = 0;
        }
        self.stamp += 1;
    }

    fn search(&mut self, matrix: &Matrix, reach: usize) {
        for row in self.disturbed.iter().chain(&self.restless) {
            let stamp = &mut self.stamps[*row as usize];
            if *stamp != self.stamp {
                *stamp = self.stamp;
                self.queue.push(*row);
            }
        }
        let (mut at, mut ring_end) = (0, self.queue.len());
        for _ in 0..reach {
            while at < ring_end {
                for other in matrix.neighbours(self.queue[at] as usize) {
                    let stamp = &mut self.stamps[other as usize];
                    if *stamp != self.stamp {
                        *stamp = self.stamp;
                        self.queue.push(other);
                    }
                }
                at += 1;
            }
            if ring_end == self.queue.len() {
                break;
            }
            ring_end = self.queue.len();
        }
    }

    fn collect(&mut self, linked: usize, held: &[bool]) {
        self.awake.clear();
        self.ranges.clear();
        self.lone.clear();
        for (row, stamp) in self.stamps.iter().enumerate() {
            if *stamp != self.stamp {
                continue;
            }
            let row32 = row as u32;
            self.awake.push(row32);
            if held[row] {
                continue;
            }
            if row >= linked {
                self.lone.push(row32);
                continue;
            }
            match self.ranges.last_mut() {
                Some(range) if range.end == row32 => range.end += 1,
                _ => self.ranges.push(row32..row32 + 1),
            }
        }
    }

    /// Heap capacities, in elements: unchanged by a steady step.
    #[cfg(test)]
    pub fn capacities(&self) -> [usize; 5] {
        [&self.disturbed, &self.restless, &self.awake, &self.lone, &self.queue].map(Vec::capacity)
    }

    /// Rows in [`Self::ranges`].
    pub fn moving(&self) -> usize {
        self.ranges.iter().map(|r| (r.end - r.start) as usize).sum()
    }
}
