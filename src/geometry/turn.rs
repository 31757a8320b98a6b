//! Rotations of neighbourhoods: how a handful of offsets has turned as a whole (shape matching, MATHS 2.1).

use glam::{DMat3, DVec3, DVec4};

/// A rotation about a point, kept as the difference from no rotation: at rest it is exactly zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// `R - I`.
    pub spin: DMat3,
    /// The point that stays, metres.
    pub about: DVec3,
}

impl Default for Turn {
    fn default() -> Self {
        Self { spin: DMat3::ZERO, about: DVec3::ZERO }
    }
}

impl Turn {
    /// `(R - I)(p - about)`: how far `p` is carried.
    #[inline]
    pub fn carries(&self, p: DVec3) -> DVec3 {
        self.spin * (p - self.about)
    }

    /// `|R - I|`, the farthest that a point at distance 1 is carried: 0 to 2.
    pub fn size(&self) -> f64 {
        let columns = [self.spin.x_axis, self.spin.y_axis, self.spin.z_axis];
        (0.5 * columns.iter().map(|c| c.length_squared()).sum::<f64>()).sqrt()
    }
}

/// Cofactor matrix of `m`: how area vectors transform where points do by `m` (MATHS 2.3).
pub fn cofactor(m: DMat3) -> DMat3 {
    DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}

/// How strongly the fit leans towards no rotation, relative to the offsets' moments: it decides only what the offsets leave
/// open (all on one line, all zero).
const LEANING: f64 = 1e-10;
/// Jacobi sweeps; four suffice as a rule.
const SWEEPS: usize = 12;

/// `R - I` of the rotation that best carries the offsets `a` onto the offsets `b`, given `moments = sum w b a^T`: the rotation
/// of its polar decomposition, found as the dominant eigenvector of Horn's 4 x 4 matrix. Unlike the decomposition it is defined
/// for offsets that lie in a plane or on a line, and never mirrors. Zero for moments that are zero or not finite.
pub fn best_spin(moments: DMat3) -> DMat3 {
    let size = [moments.x_axis, moments.y_axis, moments.z_axis].iter().map(|c| c.abs().max_element()).fold(0.0, f64::max);
    if !(size > 0.0 && size.is_finite()) {
        return DMat3::ZERO;
    }
    // m.x_axis[r]: row r (of b), column x (of a)
    let m = moments * (1.0 / size);
    let (xx, yy, zz) = (m.x_axis.x, m.y_axis.y, m.z_axis.z);
    let (sum_yz, sum_zx, sum_xy) = (m.y_axis.z + m.z_axis.y, m.z_axis.x + m.x_axis.z, m.x_axis.y + m.y_axis.x);
    let axis = DVec3::new(m.y_axis.z - m.z_axis.y, m.z_axis.x - m.x_axis.z, m.x_axis.y - m.y_axis.x);
    let horn = [
        [xx + yy + zz + LEANING, axis.x, axis.y, axis.z],
        [axis.x, xx - yy - zz, sum_xy, sum_zx],
        [axis.y, sum_xy, yy - xx - zz, sum_yz],
        [axis.z, sum_zx, sum_yz, zz - xx - yy],
    ];
    spin_of(dominant_eigenvector(horn))
}

/// `R - I` of a unit quaternion (w first), without taking the difference of near-equal numbers.
fn spin_of(q: DVec4) -> DMat3 {
    let (w, v) = (q.x, DVec3::new(q.y, q.z, q.w));
    let (ww, square) = (2.0 * w * v, 2.0 * v * v);
    let (xy, yz, zx) = (2.0 * v.x * v.y, 2.0 * v.y * v.z, 2.0 * v.z * v.x);
    DMat3::from_cols(
        DVec3::new(-square.y - square.z, xy + ww.z, zx - ww.y),
        DVec3::new(xy - ww.z, -square.x - square.z, yz + ww.x),
        DVec3::new(zx + ww.y, yz - ww.x, -square.x - square.y),
    )
}

/// Of a symmetric matrix, by cyclic Jacobi rotations: slow to write home about, but it cannot fail.
fn dominant_eigenvector(mut a: [[f64; 4]; 4]) -> DVec4 {
    let mut vectors = [DVec4::X, DVec4::Y, DVec4::Z, DVec4::W];
    for _ in 0..SWEEPS {
        let mut off = 0.0;
        for p in 0..3 {
            for q in p + 1..4 {
                off += a[p][q].abs();
                if a[p][q] == 0.0 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
                let sine = tangent * cosine;
                for k in 0..4 {
                    (a[k][p], a[k][q]) = (cosine * a[k][p] - sine * a[k][q], sine * a[k][p] + cosine * a[k][q]);
                }
                for k in 0..4 {
                    (a[p][k], a[q][k]) = (cosine * a[p][k] - sine * a[q][k], sine * a[p][k] + cosine * a[q][k]);
                }
                (vectors[p], vectors[q]) = (cosine * vectors[p] - sine * vectors[q], sine * vectors[p] + cosine * vectors[q]);
            }
        }
        if off < 1e-15 {
            break;
        }
    }
    let best = (1..4).fold(0, |best, k| if a[k][k] > a[best][best] { k } else { best });
    vectors[best].normalize_or(DVec4::X)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn moments(pairs: &[(DVec3, DVec3)]) -> DMat3 {
        let outer = |(a, b): &(DVec3, DVec3)| DMat3::from_cols(*b * a.x, *b * a.y, *b * a.z);
        pairs.iter().fold(DMat3::ZERO, |sum, pair| sum + outer(pair))
    }

    fn largest(m: DMat3) -> f64 {
        m.to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max)
    }

    fn turned(offsets: &[DVec3], q: DQuat) -> Vec<(DVec3, DVec3)> {
        offsets.iter().map(|a| (*a, q * *a)).collect()
    }

    #[test]
    fn rigid_rotations_come_back_from_solid_and_flat_offsets() {
        let solid =
            [DVec3::new(1.0, 0.2, 0.0), DVec3::new(-0.3, 1.0, 0.1), DVec3::new(0.1, -0.4, 2.0), DVec3::new(-1.0, -1.0, 0.3)];
        let flat = [DVec3::new(1.0, 0.2, 0.0), DVec3::new(-0.3, 0.01, 0.0), DVec3::new(-0.5, -0.1, 0.0)];
        for offsets in [&solid[..], &flat[..]] {
            for angle in [1e-9, 1e-3, 0.5, 2.0, 3.1, std::f64::consts::PI] {
                for axis in [DVec3::X, DVec3::Z, DVec3::new(1.0, -2.0, 0.5).normalize()] {
                    let q = DQuat::from_axis_angle(axis, angle);
                    for scale in [1e-9, 1.0, 1e9] {
                        let scaled: Vec<DVec3> = offsets.iter().map(|a| *a * scale).collect();
                        let found = best_spin(moments(&turned(&scaled, q)));
                        let expected = DMat3::from_quat(q) - DMat3::IDENTITY;
                        assert!(largest(found - expected) < 1e-7, "{angle} {axis} {scale}: {found} {expected}");
                        // Broken twin: another angle.
                        let other = DMat3::from_axis_angle(axis, angle + 1e-3) - DMat3::IDENTITY;
                        assert!(largest(found - other) > 1e-4);
                    }
                }
            }
        }
    }

    #[test]
    fn stretching_turns_nothing() {
        let offsets = [DVec3::X, DVec3::new(0.3, 1.0, 0.0), DVec3::new(0.0, 0.2, -1.0)];
        let stretched: Vec<_> = offsets.iter().map(|a| (*a, DMat3::from_diagonal(DVec3::new(3.0, 0.2, 1.0)) * *a)).collect();
        let stretch = moments(&stretched);
        // only if the moments are symmetric is the stretch free of rotation
        let symmetric = 0.5 * (stretch + stretch.transpose());
        assert!(largest(best_spin(symmetric)) < 1e-8);
        assert!(largest(best_spin(DMat3::from_rotation_x(0.1) * symmetric)) > 0.05);
    }

    /// Offsets on one line leave the turn about it open: there is none. Mirrored ones give a rotation all the same.
    #[test]
    fn what_the_offsets_leave_open_is_no_turn() {
        let line = [DVec3::X, DVec3::X * -0.5];
        let found = best_spin(moments(&turned(&line, DQuat::from_rotation_z(0.7) * DQuat::from_rotation_x(1.3))));
        assert!(largest(found - (DMat3::from_rotation_z(0.7) - DMat3::IDENTITY)) < 1e-5, "{found}");
        for broken in [DMat3::ZERO, DMat3::from_cols(DVec3::NAN, DVec3::X, DVec3::X), DMat3::IDENTITY * f64::INFINITY] {
            assert_eq!(best_spin(broken), DMat3::ZERO);
        }
        let mirrored = best_spin(DMat3::from_diagonal(DVec3::new(1.0, 1.0, -0.5))) + DMat3::IDENTITY;
        assert!((mirrored.determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_size_of_a_turn_is_how_far_it_carries() {
        for angle in [0.0, 1e-8, 0.4, 3.0] {
            let turn = Turn { spin: best_spin(DMat3::from_rotation_y(angle)), about: DVec3::X };
            assert!((turn.size() - 2.0 * (0.5 * angle).sin()).abs() < 1e-9);
            assert!((turn.carries(DVec3::new(1.0, 5.0, 1.0)).length() - turn.size()).abs() < 1e-12);
        }
    }
}
