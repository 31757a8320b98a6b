//! Direct displacement: what follows a grabbed particle (the paper's Eq. 2, MATHS 3.4).
//!
//! `D_j = I + sum_k W_jk (D'_k - I)` over the grabbed particles `k`; for displacements that is
//! `target_j = sum_k W_jk u'_k`, with `g_jk = min(1, r / |a_j - a_k|)` and `W_jk = g_jk / max(1, sum_k g_jk)`.

use glam::DVec3;

/// The weight of one grabbed particle before normalisation: 1 within `radius`, then falling with the distance.
/// Coinciding particles follow wholly.
#[inline]
pub fn pull(distance: f64, radius: f64) -> f64 {
    if distance <= radius { 1.0 } else { (radius / distance).clamp(0.0, 1.0) }
}

/// Weights `W_jk` of the grabbed anchors on a particle at `anchor`, in the order given, into `weights`. They sum to 1 at
/// most. `radius` (metres) is how far a follower moves as far as the grabbed particle itself.
pub fn weights(anchor: DVec3, grabbed: &[DVec3], radius: f64, weights: &mut Vec<f64>) {
    weights.clear();
    weights.extend(grabbed.iter().map(|a| pull(anchor.distance(*a), radius)));
    let sum = weights.iter().sum::<f64>().max(1.0);
    weights.iter_mut().for_each(|w| *w /= sum);
}

/// Where a follower's spring pulls it while the grab lasts: the displacement `sum_k W_jk u'_k`, metres. `grabbed` pairs a
/// grabbed particle's anchor with its displacement.
pub fn target(anchor: DVec3, grabbed: &[(DVec3, DVec3)], radius: f64) -> DVec3 {
    let (mut sum, mut moved) = (0.0, DVec3::ZERO);
    for (other, displacement) in grabbed {
        let g = pull(anchor.distance(*other), radius);
        sum += g;
        moved += g * *displacement;
    }
    moved / sum.max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_never_sum_to_more_than_one() {
        let grabbed: Vec<DVec3> = (0..5).map(|k| DVec3::new(k as f64 * 0.1, 0.0, 0.0)).collect();
        let mut w = Vec::new();
        for k in 0..50 {
            weights(DVec3::new(0.0, k as f64 * 0.1, 0.0), &grabbed, 0.2, &mut w);
            let sum: f64 = w.iter().sum();
            assert!(sum <= 1.0 + 1e-12 && w.iter().all(|w| *w > 0.0));
        }
        // Broken twin: without the normalisation five grabbed particles would pull a follower five times as far.
        assert!(grabbed.iter().map(|a| pull(a.distance(DVec3::ZERO), 1.0)).sum::<f64>() > 4.0);
    }

    #[test]
    fn one_grab_carries_the_near_wholly_and_the_far_in_proportion() {
        let u = DVec3::new(0.0, 0.0, 0.3);
        let at = |d: f64| target(DVec3::new(d, 0.0, 0.0), &[(DVec3::ZERO, u)], 0.1);
        assert_eq!(at(0.0), u);
        assert_eq!(at(0.1), u);
        assert!((at(0.2) - u / 2.0).length() < 1e-15);
        assert!((at(1.0) - u / 10.0).length() < 1e-15);
        assert!((at(0.2) - u).length() > 0.1);
    }

    #[test]
    fn a_common_move_of_all_grabbed_carries_an_enclosed_follower() {
        let u = DVec3::new(0.1, -0.2, 0.05);
        let ring: Vec<_> = (0..6).map(|k| (DVec3::new((k as f64).cos(), (k as f64).sin(), 0.0) * 0.1, u)).collect();
        assert!((target(DVec3::ZERO, &ring, 0.1) - u).length() < 1e-12);
    }

    #[test]
    fn odd_input_is_harmless() {
        assert_eq!(target(DVec3::ONE, &[], 1.0), DVec3::ZERO);
        assert_eq!(pull(0.0, 0.0), 1.0);
        assert_eq!(pull(1.0, 0.0), 0.0);
        let (mut w, p) = (Vec::new(), DVec3::ONE);
        weights(p, &[p, p], 0.0, &mut w);
        assert_eq!(w, [0.5, 0.5]);
    }
}
