//! The network's matrix `A = M^-1 K` in solver order, and the three passes over it that a step is made of.
//!
//! `K` is the anchor springs plus the neighbour springs' Laplacian (MATHS 4.1). `A` is similar to `M^-1/2 K M^-1/2`, so
//! functions of it act on displacements directly. With `rate = (2 pi f)^2`, row `i` of `A e` is
//! `rate ((1 + g_i S_i) e_i - g_i sum_j s_ij e_j)`, `s_ij` symmetric, `g_i = coupling / m_i`, `S_i = sum_j s_ij`.

use super::topology::NetworkTopology;
use crate::geometry::room::headroom;
use bytemuck::{Pod, Zeroable};
use std::ops::Range;

/// A 3-vector of one particle, padded with a zero: one load, one multiplication.
pub type Lanes = [f64; 4];

/// Two 3-vectors of one particle that travel through the series together (displacement and velocity): the matrix is read
/// once for both, and a particle is one cache line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Pair {
    /// Displacement, or the velocity that goes into a step.
    pub first: Lanes,
    /// Velocity, or the acceleration that goes into a step.
    pub second: Lanes,
}

/// A [`Pair`] as one vector: the widest registers hold it whole.
type Wide = [f64; 8];

impl Pair {
    #[inline(always)]
    fn wide(&self) -> &Wide {
        bytemuck::cast_ref(self)
    }
}

/// `a x + b y`.
#[inline(always)]
pub fn blend(a: f64, x: &Lanes, b: f64, y: &Lanes) -> Lanes {
    std::array::from_fn(|k| a * x[k] + b * y[k])
}

/// `x + a y`.
#[inline(always)]
pub fn add_scaled(x: &Lanes, a: f64, y: &Lanes) -> Lanes {
    std::array::from_fn(|k| x[k] + a * y[k])
}

/// True if it is 0. Without a branch a component: mostly it is.
#[inline(always)]
pub fn is_zero(x: &Lanes) -> bool {
    x.iter().fold(true, |all, x| all & (*x == 0.0))
}

/// `x + a y`, rounded once. For the inner loops only: they are compiled with the instruction where there is one (everywhere
/// since 2013), and with or without it the bits are the same.
#[inline(always)]
pub fn fused<const N: usize>(x: &[f64; N], a: f64, y: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|k| a.mul_add(y[k], x[k]))
}

/// `a x + b y`, the sum rounded once.
#[inline(always)]
pub fn fused_blend<const N: usize>(a: f64, x: &[f64; N], b: f64, y: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|k| a.mul_add(x[k], b * y[k]))
}

/// `x - y`.
#[inline(always)]
pub fn minus(x: &Lanes, y: &Lanes) -> Lanes {
    std::array::from_fn(|k| x[k] - y[k])
}

/// Entries of a row are padded to whole blocks of this many, with zero springs to the row itself: the inner loop has
/// independent sums and few branches.
const BLOCK: usize = 4;

/// What a row needs beside its springs.
#[derive(Clone, Copy, Debug, Default)]
struct Head {
    /// First block of springs, and one past the last.
    start: u32,
    end: u32,
    /// `1 + g_i S_i`.
    diagonal: f64,
    /// `g_i`.
    gain: f64,
}

/// Four springs of a row. They are f32 by value; held wide, because a pass has no time to convert them.
#[derive(Clone, Copy, Debug, Default)]
struct Block {
    columns: [u32; BLOCK],
    springs: [f64; BLOCK],
}

/// The matrix. Rows are in solver order: linked particles by Cuthill-McKee, then lone ones.
#[derive(Clone, Debug, Default)]
pub struct Matrix {
    heads: Vec<Head>,
    blocks: Vec<Block>,
    /// Scratch: the blocks without the holes.
    packed: Vec<Block>,
    /// Scratch: rows that name one of two.
    namers: Vec<u32>,
    entries: usize,
    /// `(2 pi f)^2`, 1/s^2: also the lower end of the spectrum.
    rate: f64,
    /// Gershgorin's upper end of the spectrum, 1/s^2.
    high: f64,
    /// Largest `g_i S_i`; `None` while it is to be found anew.
    reach: Option<f64>,
    /// Blocks that no row uses any more.
    holes: usize,
    /// Farthest that a spring reaches from its row, in rows; `None` while it is to be found anew.
    width: Option<usize>,
}

/// Rows that name one of two, as many as there is room for at first.
const NAMERS: usize = 256;

impl Matrix {
    /// Fills the rows from the springs: `order[row]` is a particle, `row_of` the reverse. A spring's stiffness counts the
    /// mean of its two masses.
    pub fn set_rows(&mut self, topology: &NetworkTopology, order: &[u32], row_of: &[u32], masses: &[f64]) {
        self.heads.clear();
        self.blocks.clear();
        self.entries = 2 * topology.springs();
        self.holes = 0;
        self.width = None;
        for (row, particle) in order.iter().enumerate() {
            let start = self.blocks.len() as u32;
            let (columns, weights) = topology.row(*particle as usize);
            for (columns, weights) in columns.chunks(BLOCK).zip(weights.chunks(BLOCK)) {
                let mut block = Block { columns: [row as u32; BLOCK], springs: [0.0; BLOCK] };
                for (k, (other, weight)) in columns.iter().zip(weights).enumerate() {
                    let mass = 0.5 * (masses[*particle as usize] + masses[*other as usize]);
                    block.columns[k] = row_of[*other as usize];
                    block.springs[k] = f64::from((*weight as f64 * mass) as f32);
                }
                self.blocks.push(block);
            }
            self.heads.push(Head { start, end: self.blocks.len() as u32, ..Head::default() });
        }
    }

    /// Sets stiffness and masses (in row order); cheap beside [`Self::set_rows`].
    pub fn set_stiffness(&mut self, rate: f64, coupling: f64, masses: impl Iterator<Item = f64>) {
        self.rate = rate;
        let mut reach: f64 = 0.0;
        for (head, mass) in self.heads.iter_mut().zip(masses) {
            let blocks = &self.blocks[head.start as usize..head.end as usize];
            let mut sum = 0.0;
            for block in blocks {
                for spring in block.springs {
                    sum += spring;
                }
            }
            head.gain = coupling / mass;
            head.diagonal = 1.0 + head.gain * sum;
            reach = reach.max(head.gain * sum);
        }
        self.reach = Some(reach);
        self.high = rate * (1.0 + 2.0 * reach);
    }

    /// An empty matrix of the same rate with room for so many rows like these.
    pub fn room_like(&self, rows: usize) -> Self {
        let blocks = self.blocks.len() * rows / self.heads.len().max(1);
        let (heads, blocks) = (Vec::with_capacity(rows), Vec::with_capacity(blocks));
        Self { heads, blocks, rate: self.rate, reach: Some(0.0), ..Self::default() }
    }

    /// Appends a row with springs (`(column, spring)`); columns may be rows to come. To be closed by [`Self::settle_rows`].
    pub fn push_row(&mut self, springs: impl Iterator<Item = (u32, f32)>, coupling: f64, mass: f64) {
        self.width = None;
        let (row, start) = (self.heads.len() as u32, self.blocks.len() as u32);
        let empty = Block { columns: [row; BLOCK], springs: [0.0; BLOCK] };
        let (mut block, mut filled, mut sum) = (empty, 0, 0.0);
        for (column, spring) in springs {
            if filled == BLOCK {
                self.blocks.push(block);
                self.entries += BLOCK;
                (block, filled) = (empty, 0);
            }
            let spring = f64::from(spring);
            (block.columns[filled], block.springs[filled]) = (column, spring);
            filled += 1;
            sum += spring;
        }
        self.end_row(start, (block, filled), coupling / mass, sum);
    }

    /// Ends the row that is appended: its first block, its last one with so many springs, `g_i` and the sum of its springs.
    fn end_row(&mut self, start: u32, (last, filled): (Block, usize), gain: f64, sum: f64) {
        if filled > 0 {
            self.blocks.push(last);
            self.entries += filled;
        }
        self.reach = self.reach.map(|reach| reach.max(gain * sum));
        self.heads.push(Head { start, end: self.blocks.len() as u32, diagonal: 1.0 + gain * sum, gain });
    }

    /// Appends a row of another matrix with its springs to rows that go on: `new_row` of each, or `u32::MAX`. To be closed by
    /// [`Self::settle_rows`].
    pub fn push_part(&mut self, from: &Self, row: usize, new_row: &[u32]) {
        self.width = None;
        let (own, start) = (self.heads.len() as u32, self.blocks.len() as u32);
        let empty = Block { columns: [own; BLOCK], springs: [0.0; BLOCK] };
        let (mut block, mut filled, mut sum) = (empty, 0, 0.0);
        for old in from.blocks(&from.heads[row]) {
            let columns = old.columns.map(|c| new_row[c as usize]);
            if filled == 0 && !columns.contains(&u32::MAX) {
                self.blocks.push(Block { columns, springs: old.springs });
                self.entries += old.springs.iter().map(|s| usize::from(*s != 0.0)).sum::<usize>();
                sum += old.springs.iter().sum::<f64>();
                continue;
            }
            for k in 0..BLOCK {
                let (column, spring) = (columns[k], old.springs[k]);
                if column == u32::MAX || spring == 0.0 {
                    continue;
                }
                (block.columns[filled], block.springs[filled]) = (column, spring);
                filled += 1;
                sum += spring;
                if filled == BLOCK {
                    self.blocks.push(block);
                    self.entries += BLOCK;
                    (block, filled) = (empty, 0);
                }
            }
        }
        self.end_row(start, (block, filled), from.heads[row].gain, sum);
    }

    /// Makes room for so many rows more, and for rows that are written anew.
    pub fn make_room(&mut self, rows: usize) {
        self.heads.reserve(rows);
        self.blocks.reserve(4 * headroom(self.blocks.len()));
        self.packed.reserve(self.blocks.capacity());
        self.namers.reserve(NAMERS);
    }

    /// Appends a row without springs.
    pub fn push_lone_row(&mut self, coupling: f64, mass: f64) {
        let end = self.blocks.len() as u32;
        self.heads.push(Head { start: end, end, diagonal: 1.0, gain: coupling / mass });
    }

    /// Removes the last row, which has no springs.
    pub fn pop_row(&mut self) {
        let row = self.heads.pop();
        debug_assert!(row.is_some_and(|head| head.start == head.end), "a row without springs");
    }

    /// Rewrites the springs (`(column, spring)`) of one row, in place where they fit. To be closed by [`Self::settle_rows`].
    pub fn replace_row(&mut self, row: usize, springs: &[(u32, f32)], coupling: f64, mass: f64) {
        self.width = None;
        let head = &mut self.heads[row];
        let (had, needs) = ((head.end - head.start) as usize, springs.len().div_ceil(BLOCK));
        let before: usize = self.blocks[head.start as usize..head.end as usize]
            .iter()
            .map(|b| b.springs.iter().filter(|s| **s != 0.0).count())
            .sum();
        self.entries = self.entries + springs.len() - before;
        if needs > had {
            head.start = self.blocks.len() as u32;
            self.blocks.resize(self.blocks.len() + needs, Block::default());
            self.holes += had;
        } else {
            self.holes += had - needs;
        }
        head.end = head.start + needs as u32;
        for (block, springs) in self.blocks[head.start as usize..head.end as usize].iter_mut().zip(springs.chunks(BLOCK)) {
            *block = Block { columns: [row as u32; BLOCK], springs: [0.0; BLOCK] };
            for (k, (column, spring)) in springs.iter().enumerate() {
                (block.columns[k], block.springs[k]) = (*column, f64::from(*spring));
            }
        }
        let was = head.diagonal - 1.0;
        let sum: f64 = springs.iter().map(|s| f64::from(s.1)).sum();
        head.gain = coupling / mass;
        head.diagonal = 1.0 + head.gain * sum;
        let now = head.diagonal - 1.0;
        self.reach = match self.reach {
            Some(reach) if now >= reach => Some(now),
            // the row that set the bound may have lost springs; rounding makes `was` fall a little short of it
            Some(reach) if was < reach * (1.0 - 1e-12) => Some(reach),
            _ => None,
        };
    }

    /// Brings the spectrum's bound up to date after [`Self::push_row`] or [`Self::replace_row`], and closes holes once they are half of all blocks.
    pub fn settle_rows(&mut self) {
        let reach = self.reach.unwrap_or_else(|| self.heads.iter().map(|h| h.diagonal - 1.0).fold(0.0, f64::max));
        self.reach = Some(reach);
        self.high = self.rate * (1.0 + 2.0 * reach);
        if 2 * self.holes > self.blocks.len() {
            let Self { heads, blocks, packed, .. } = self;
            packed.clear();
            packed.reserve(blocks.capacity());
            for head in heads {
                let kept = &blocks[head.start as usize..head.end as usize];
                head.start = packed.len() as u32;
                packed.extend_from_slice(kept);
                head.end = packed.len() as u32;
            }
            std::mem::swap(blocks, packed);
            self.holes = 0;
        }
    }

    /// Two rows trade places; their neighbours' rows name them anew. The matrix must be symmetric.
    pub fn swap_rows(&mut self, a: usize, b: usize) {
        let mut namers = std::mem::take(&mut self.namers);
        namers.clear();
        namers.extend(self.neighbours(a).chain(self.neighbours(b)).chain([a as u32, b as u32]));
        namers.sort_unstable();
        namers.dedup();
        self.width = None;
        for &namer in &namers {
            let head = self.heads[namer as usize];
            for column in self.blocks[head.start as usize..head.end as usize].iter_mut().flat_map(|block| &mut block.columns) {
                if *column == a as u32 {
                    *column = b as u32;
                } else if *column == b as u32 {
                    *column = a as u32;
                }
            }
        }
        self.heads.swap(a, b);
        self.namers = namers;
    }

    /// Farthest that any spring reaches from its row, in rows. Found by a pass over all springs after they have changed.
    pub fn width(&mut self) -> usize {
        if let Some(width) = self.width {
            return width;
        }
        let farthest = |row: usize| self.neighbours(row).map(|c| (c as usize).abs_diff(row)).max().unwrap_or(0);
        let width = (0..self.heads.len()).map(farthest).max().unwrap_or(0);
        self.width = Some(width);
        width
    }

    /// Both ends of the spectrum of `A`, 1/s^2 (Gershgorin).
    pub fn spectrum(&self) -> (f64, f64) {
        (self.rate, self.high)
    }

    /// Number of entries off the diagonal.
    pub fn entries(&self) -> usize {
        self.entries
    }

    /// Neighbours of a row (and, as padding, the row itself).
    pub fn neighbours(&self, row: usize) -> impl Iterator<Item = u32> + '_ {
        self.blocks(&self.heads[row]).iter().flat_map(|b| b.columns)
    }

    /// Springs of a row, as (column, spring); the padding is springs of 0 to the row itself.
    pub fn springs(&self, row: usize) -> impl Iterator<Item = (u32, f64)> + '_ {
        self.blocks(&self.heads[row]).iter().flat_map(|b| b.columns.into_iter().zip(b.springs))
    }

    #[inline(always)]
    fn blocks(&self, head: &Head) -> &[Block] {
        &self.blocks[head.start as usize..head.end as usize]
    }

    /// `A_ii`, 1/s^2.
    #[inline(always)]
    pub fn diagonal(&self, row: usize) -> f64 {
        self.rate * self.heads[row].diagonal
    }

    /// Row `row` of `A e`.
    #[inline(always)]
    pub fn apply_row(&self, row: usize, e: &[Lanes]) -> Lanes {
        let head = &self.heads[row];
        let (mut even, mut odd) = ([0.0; 4], [0.0; 4]);
        for block in self.blocks(head) {
            let [a, b, c, d] = block.columns.map(|column| &e[column as usize]);
            let [p, q, r, s] = block.springs;
            even = add_scaled(&add_scaled(&even, p, a), r, c);
            odd = add_scaled(&add_scaled(&odd, q, b), s, d);
        }
        let sum = add_scaled(&even, 1.0, &odd);
        blend(self.rate * head.diagonal, &e[row], -self.rate * head.gain, &sum)
    }

    /// One pass of Clenshaw's recurrence: `newest = term + 2 T newer - newest` on the rows of `range`, with `T` the matrix
    /// mapped to [-1, 1] (`twice`, `shift`: `2 T = twice A / rate - shift`). `term(row)` is what this degree adds.
    #[inline(always)]
    pub fn clenshaw_pass(
        &self,
        range: Range<usize>,
        (twice, shift): (f64, f64),
        term: impl Fn(usize) -> Pair,
        newer: &[Pair],
        newest: &mut [Pair],
    ) {
        let heads = self.heads[range.clone()].iter().zip(&newer[range.clone()]);
        for (row, ((head, own), result)) in range.clone().zip(heads.zip(&mut newest[range])) {
            let (mut even, mut odd): (Wide, Wide) = ([0.0; 8], [0.0; 8]);
            for block in self.blocks(head) {
                let [a, b, c, d] = block.columns.map(|column| newer[column as usize].wide());
                let [p, q, r, s] = block.springs;
                even = fused(&fused(&even, p, a), r, c);
                odd = fused(&fused(&odd, q, b), s, d);
            }
            let (diagonal, gain) = (twice * head.diagonal - shift, -twice * head.gain);
            let sum = fused(&even, 1.0, &odd);
            let made = fused(&fused_blend(diagonal, own.wide(), gain, &sum), 1.0, term(row).wide());
            let before = *result.wide();
            *result = bytemuck::cast(std::array::from_fn::<f64, 8, _>(|k| made[k] - before[k]));
        }
    }

    /// `twice` and `shift` of [`Self::clenshaw_pass`] for an interval (middle, half-width).
    pub fn mapping(&self, (middle, half): (f64, f64)) -> (f64, f64) {
        (2.0 * self.rate / half, 2.0 * middle / half)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chain(coupling: f64, masses: &[f64]) -> Matrix {
        let n = masses.len() as u32;
        let topology = NetworkTopology::from_pairs(n as usize, (1..n).map(|a| (a - 1, a, 0.5)));
        let order: Vec<u32> = (0..n).collect();
        let mut matrix = Matrix::default();
        matrix.set_rows(&topology, &order, &order, masses);
        matrix.set_stiffness(4.0, coupling, masses.iter().copied());
        matrix
    }

    #[test]
    fn a_rigid_shift_meets_only_the_anchors() {
        let matrix = chain(2.0, &[1.0, 3.0, 0.1, 7.0]);
        let e = [[1.0, -2.0, 3.0, 0.0]; 4];
        for row in 0..4 {
            let a = matrix.apply_row(row, &e);
            (0..3).for_each(|k| assert!((a[k] - 4.0 * e[0][k]).abs() < 1e-5));
        }
        // Broken twin: a bent chain meets the neighbour springs too.
        let bent = [[0.0; 4], [1.0; 4], [0.0; 4], [0.0; 4]];
        assert!((matrix.apply_row(1, &bent)[0] - 4.0).abs() > 1.0);
    }

    #[test]
    fn springs_pull_both_ends_alike() {
        let masses = [1.0, 30.0, 0.001, 7.0];
        let matrix = chain(2.0, &masses);
        let unit = |i: usize| std::array::from_fn::<_, 4, _>(|j| if i == j { [1.0; 4] } else { [0.0; 4] });
        for i in 0..4 {
            for j in 0..4 {
                let (a, b) = (masses[i] * matrix.apply_row(i, &unit(j))[0], masses[j] * matrix.apply_row(j, &unit(i))[0]);
                assert!((a - b).abs() <= 1e-12 * a.abs(), "{i} {j}: {a} {b}");
            }
        }
    }
}
