//! The network's matrix `A = M^-1 K` in solver order, and the three passes over it that a step is made of.
//!
//! `K` is the anchor springs plus the neighbour springs' Laplacian (MATHS 4.1). `A` is similar to `M^-1/2 K M^-1/2`, so
//! functions of it act on displacements directly. With `rate = (2 pi f)^2`, row `i` of `A e` is
//! `rate ((1 + g_i S_i) e_i - g_i sum_j s_ij e_j)`, `s_ij` symmetric, `g_i = coupling / m_i`, `S_i = sum_j s_ij`.

use super::topology::NetworkTopology;
use std::ops::Range;

/// Two 3-vectors of one particle that travel through the series together (displacement and velocity): the matrix is
/// read once for both.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))]
pub struct Pair(pub [f64; 6]);

impl Pair {
    /// From its two halves.
    pub fn new(first: [f64; 3], second: [f64; 3]) -> Self {
        Self([first[0], first[1], first[2], second[0], second[1], second[2]])
    }
}

/// The matrix. Rows are in solver order: linked particles by Cuthill-McKee, then lone ones.
#[derive(Clone, Debug, Default)]
pub struct Matrix {
    offsets: Vec<u32>,
    columns: Vec<u32>,
    springs: Vec<f32>,
    /// `1 + g_i S_i`.
    diagonal: Vec<f64>,
    /// `g_i`.
    gain: Vec<f64>,
    /// `(2 pi f)^2`, 1/s^2: also the lower end of the spectrum.
    rate: f64,
    /// Gershgorin's upper end of the spectrum, 1/s^2.
    high: f64,
}

impl Matrix {
    /// Fills the rows from the springs: `order[row]` is a particle, `row_of` the reverse. A spring's stiffness counts the
    /// mean of its two masses.
    pub fn set_rows(&mut self, topology: &NetworkTopology, order: &[u32], row_of: &[u32], masses: &[f64]) {
        self.offsets.clear();
        self.columns.clear();
        self.springs.clear();
        self.offsets.push(0);
        for particle in order {
            let (columns, weights) = topology.row(*particle as usize);
            for (other, weight) in columns.iter().zip(weights) {
                let mass = 0.5 * (masses[*particle as usize] + masses[*other as usize]);
                self.columns.push(row_of[*other as usize]);
                self.springs.push((*weight as f64 * mass) as f32);
            }
            self.offsets.push(self.columns.len() as u32);
        }
    }

    /// Sets stiffness and masses (in row order); cheap beside [`Self::set_rows`].
    pub fn set_stiffness(&mut self, rate: f64, coupling: f64, masses: impl Iterator<Item = f64>) {
        self.rate = rate;
        self.diagonal.clear();
        self.gain.clear();
        let mut reach: f64 = 0.0;
        for (row, mass) in masses.enumerate() {
            let gain = coupling / mass;
            let sum: f64 = self.springs[self.span(row)].iter().map(|s| *s as f64).sum();
            self.gain.push(gain);
            self.diagonal.push(1.0 + gain * sum);
            reach = reach.max(gain * sum);
        }
        self.high = rate * (1.0 + 2.0 * reach);
    }

    /// Both ends of the spectrum of `A`, 1/s^2 (Gershgorin).
    pub fn spectrum(&self) -> (f64, f64) {
        (self.rate, self.high)
    }

    /// Number of entries off the diagonal.
    pub fn entries(&self) -> usize {
        self.columns.len()
    }

    /// Neighbours of a row.
    #[inline]
    pub fn neighbours(&self, row: usize) -> &[u32] {
        &self.columns[self.span(row)]
    }

    #[inline]
    fn span(&self, row: usize) -> Range<usize> {
        self.offsets[row] as usize..self.offsets[row + 1] as usize
    }

    /// `A_ii`, 1/s^2.
    #[inline]
    pub fn diagonal(&self, row: usize) -> f64 {
        self.rate * self.diagonal[row]
    }

    /// Row `row` of `A e`.
    #[inline]
    pub fn apply_row(&self, row: usize, e: &[[f64; 3]]) -> [f64; 3] {
        let span = self.span(row);
        let mut sum = [0.0; 3];
        for (column, spring) in self.columns[span.clone()].iter().zip(&self.springs[span]) {
            let (other, spring) = (&e[*column as usize], *spring as f64);
            for k in 0..3 {
                sum[k] += spring * other[k];
            }
        }
        let (own, diagonal, gain) = (&e[row], self.rate * self.diagonal[row], self.rate * self.gain[row]);
        std::array::from_fn(|k| diagonal * own[k] - gain * sum[k])
    }

    /// One pass of Clenshaw's recurrence: `newest = input + 2 T newer - newest` on the rows of `range`, with `T` the
    /// matrix mapped to [-1, 1] (`twice`, `shift`: `2 T = twice A / rate - shift`). `input(row)` is the term of this degree.
    #[inline]
    pub fn clenshaw_pass(
        &self,
        range: Range<usize>,
        (twice, shift): (f64, f64),
        input: impl Fn(usize) -> Pair,
        newer: &[Pair],
        newest: &mut [Pair],
    ) {
        for row in range {
            let span = self.span(row);
            let mut sum = [0.0; 6];
            for (column, spring) in self.columns[span.clone()].iter().zip(&self.springs[span]) {
                let (other, spring) = (&newer[*column as usize].0, *spring as f64);
                for k in 0..6 {
                    sum[k] += spring * other[k];
                }
            }
            let diagonal = twice * self.diagonal[row] - shift;
            let gain = twice * self.gain[row];
            let (own, term) = (&newer[row].0, input(row).0);
            let result = &mut newest[row].0;
            for k in 0..6 {
                result[k] = term[k] + diagonal * own[k] - gain * sum[k] - result[k];
            }
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
        let e = [[1.0, -2.0, 3.0]; 4];
        for row in 0..4 {
            let a = matrix.apply_row(row, &e);
            (0..3).for_each(|k| assert!((a[k] - 4.0 * e[0][k]).abs() < 1e-5));
        }
        // Broken twin: a bent chain meets the neighbour springs too.
        let bent = [[0.0; 3], [1.0; 3], [0.0; 3], [0.0; 3]];
        assert!((matrix.apply_row(1, &bent)[0] - 4.0).abs() > 1.0);
    }

    #[test]
    fn springs_pull_both_ends_alike() {
        let masses = [1.0, 30.0, 0.001, 7.0];
        let matrix = chain(2.0, &masses);
        let unit = |i: usize| std::array::from_fn::<_, 4, _>(|j| if i == j { [1.0; 3] } else { [0.0; 3] });
        for i in 0..4 {
            for j in 0..4 {
                let (a, b) = (masses[i] * matrix.apply_row(i, &unit(j))[0], masses[j] * matrix.apply_row(j, &unit(i))[0]);
                assert!((a - b).abs() <= 1e-12 * a.abs(), "{i} {j}: {a} {b}");
            }
        }
    }
}
