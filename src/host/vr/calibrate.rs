//! Where an instrument's tip is, found by hand: the tip rests on a firm point while the hand turns about it. Every pose says
//! `p + R o = c`, with the same offset `o` and the same point `c`; both come out of one least-squares problem. Pure.

use super::space::Pose;
use glam::{DMat3, DVec3};

/// Fewer poses say nothing. Three seconds at 90 a second are 270.
const LEAST_POSES: u32 = 60;
/// Least mean square of how far the hand has turned about the axis that it has turned about least, radians squared: about a
/// tenth of a radian to either side.
const LEAST_TURN: f64 = 0.01;
/// The tip must have stood within this (root mean square), metres.
const STEADY: f64 = 0.004;
/// No instrument is longer, metres.
const LONGEST: f64 = 0.6;

/// Poses of one hand, gathered as sums.
#[derive(Clone, Copy, Debug)]
pub struct Pivot {
    count: u32,
    /// Places are taken from here, so that rounding does not grow with the room.
    origin: DVec3,
    turns: DMat3,
    places: DVec3,
    /// Sum of `R^T p`.
    turned: DVec3,
    squares: f64,
}

impl Default for Pivot {
    fn default() -> Self {
        Self { count: 0, origin: DVec3::ZERO, turns: DMat3::ZERO, places: DVec3::ZERO, turned: DVec3::ZERO, squares: 0.0 }
    }
}

/// A tip that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tip {
    /// From the grip, metres, in the hand's own frame.
    pub offset: DVec3,
    /// How far it strayed from its point: root mean square, metres.
    pub strayed: f64,
}

impl Pivot {
    /// Takes a pose in.
    pub fn add(&mut self, grip: &Pose) {
        if self.count == 0 {
            self.origin = grip.position;
        }
        let (turn, place) = (DMat3::from_quat(grip.rotation), grip.position - self.origin);
        self.count += 1;
        self.turns += turn;
        self.places += place;
        self.turned += turn.transpose() * place;
        self.squares += place.length_squared();
    }

    /// Poses so far.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// The tip. Errors, as sentences for the user: too few poses, too little turning, a tip that moved.
    pub fn tip(&self) -> Result<Tip, String> {
        if self.count < LEAST_POSES {
            return Err("The tip stays where it was: hold the trigger for two seconds or so while the hand turns.".into());
        }
        let n = f64::from(self.count);
        // With the point eliminated, A o = b.
        let a = DMat3::IDENTITY * n - self.turns.transpose() * self.turns * (1.0 / n);
        let b = self.turns.transpose() * self.places * (1.0 / n) - self.turned;
        let inverse = a.inverse();
        let frobenius = inverse.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
        // Between the smallest eigenvalue over the root of 3 and the smallest eigenvalue.
        let least_turn = 1.0 / (frobenius * n);
        if least_turn.is_nan() || least_turn <= LEAST_TURN {
            return Err("The tip stays where it was: turn the hand further, forwards, sideways and about itself.".into());
        }
        let offset = inverse * b;
        let spread = self.squares - self.places.length_squared() / n;
        let strayed = ((spread - b.dot(offset)).max(0.0) / n).sqrt();
        if strayed.is_nan() || strayed >= STEADY {
            let mm = strayed * 1e3;
            return Err(format!("The tip stays where it was: it moved by {mm:.0} mm. Rest it on a firm point."));
        }
        if offset.length() > LONGEST {
            return Err(format!("The tip stays where it was: {:.2} m from the grip is too far.", offset.length()));
        }
        Ok(Tip { offset, strayed })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, EulerRot};

    const OFFSET: DVec3 = DVec3::new(0.012, -0.034, -0.151);
    const POINT: DVec3 = DVec3::new(0.4, 0.9, -0.3);

    /// A hand that turns by `reach` radians to each side about three axes; `stray` moves the tip.
    fn turned(poses: u32, reach: DVec3, mut stray: impl FnMut(u32) -> DVec3) -> Pivot {
        let mut pivot = Pivot::default();
        for i in 0..poses {
            let t = f64::from(i) * 0.07;
            let swing = DVec3::new(t.sin(), (1.3 * t).sin(), (0.7 * t).cos()) * reach;
            let rotation = DQuat::from_euler(EulerRot::YXZ, 1.0 + swing.x, swing.y, swing.z);
            pivot.add(&Pose { position: POINT + stray(i) - rotation * OFFSET, rotation });
        }
        pivot
    }

    #[test]
    fn the_tip_is_found_to_a_micrometre_where_it_stood_still() {
        let tip = turned(200, DVec3::splat(0.5), |_| DVec3::ZERO).tip().expect("found");
        assert!(tip.offset.distance(OFFSET) < 1e-6 && tip.strayed < 1e-6, "{tip:?}");
    }

    #[test]
    fn a_tremor_of_a_millimetre_moves_it_by_less() {
        let tremor =
            |i: u32| 1e-3 * DVec3::new((f64::from(i) * 7.1).sin(), (f64::from(i) * 3.3).cos(), (f64::from(i) * 5.7).sin());
        let tip = turned(300, DVec3::splat(0.5), tremor).tip().expect("found");
        assert!(tip.offset.distance(OFFSET) < 1e-3, "{}", tip.offset.distance(OFFSET));
        assert!((0.5e-3..2e-3).contains(&tip.strayed), "{}", tip.strayed);
    }

    #[test]
    fn what_cannot_be_known_is_refused_with_a_reason() {
        let words = |pivot: Pivot| pivot.tip().expect_err("refused");
        assert!(words(turned(20, DVec3::splat(0.5), |_| DVec3::ZERO)).contains("two seconds"));
        assert!(words(turned(200, DVec3::splat(0.02), |_| DVec3::ZERO)).contains("further"));
        assert!(words(turned(200, DVec3::X * 0.8, |_| DVec3::ZERO)).contains("further"), "one axis leaves the tip free along it");
        let slid = |i: u32| DVec3::X * 1e-4 * f64::from(i);
        assert!(words(turned(200, DVec3::splat(0.5), slid)).contains("moved by"));
        let still = |_: u32| DVec3::ZERO;
        assert!(turned(200, DVec3::splat(0.5), still).tip().is_ok(), "the same hand on a firm point");
    }
}
