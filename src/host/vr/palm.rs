//! Bare hands have no menu button: who looks at the palm of the left hand, held up to the face, and pinches with that hand opens the
//! panel, and closes it. Pure.

use super::input::Hand;
use super::space::Pose;

/// Head and palm face each other where the cosines of both angles are above the first, until one falls below the second.
const FACING: (f64, f64) = (0.8, 0.65);
/// A pinch begins above the first and ends below the second.
const PINCHED: (f64, f64) = (0.5, 0.3);

/// Watches a hand for the gesture.
#[derive(Clone, Copy, Debug, Default)]
pub struct PalmMenu {
    shown: bool,
    pinched: bool,
    /// The pinch began while the palm was shown: it is the panel's to its end.
    ours: bool,
}

impl PalmMenu {
    /// The hands are somebody else's for a while: a pinch that lasts when they come back was not meant for the panel.
    pub fn look_away(&mut self) {
        *self = Self { pinched: true, ..Self::default() };
    }

    /// Takes the hand of a frame; true if the panel is to open or to close. While the palm is shown, and as long as a pinch lasts that
    /// began so, the hand does nothing else. A pinch that began elsewhere is none of the panel's; nor is one of a hand at work.
    pub fn frame(&mut self, hand: &mut Hand, head: &Pose, at_work: bool) -> bool {
        let limit = if self.shown { FACING.1 } else { FACING.0 };
        self.shown = !at_work && faces(hand, head).is_some_and(|cosine| cosine > limit);
        let was = self.pinched;
        self.pinched = hand.bare && hand.tear > if was { PINCHED.1 } else { PINCHED.0 };
        let begins = self.pinched && !was;
        self.ours = self.pinched && if begins { self.shown } else { self.ours };
        if self.ours || (self.shown && !self.pinched) {
            (hand.tear, hand.grab) = (0.0, 0.0);
        }
        begins && self.ours
    }
}

/// How far a bare hand's palm and a head face each other: the smaller of the cosines of the angles between each and the way to the
/// other. None for a hand that is not tracked, or holds a controller.
fn faces(hand: &Hand, head: &Pose) -> Option<f64> {
    let (at, palm) = hand.grip.zip(hand.palm).filter(|_| hand.bare)?;
    let to_head = (head.position - at.position).try_normalize()?;
    Some(palm.dot(to_head).min(-head.forward().dot(to_head)))
}
