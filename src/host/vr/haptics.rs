//! What the hands feel: short pulses on contact, for each torn segment, and when a piece comes off. Pure.

/// Why a hand feels something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// Its instrument came to tissue.
    Contact,
    /// It tore a segment.
    Segment,
    /// A piece came off, or a cut was done.
    Severed,
}

/// One vibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pulse {
    /// 0 left, 1 right.
    pub hand: usize,
    /// What for.
    pub cause: Cause,
    /// 0 to 1.
    pub amplitude: f64,
    /// Seconds.
    pub seconds: f64,
}

/// What happened to the tissue in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Felt {
    /// The instrument of each hand touches tissue.
    pub touches: [bool; 2],
    /// Something was torn by this hand.
    pub torn: Option<usize>,
    /// A piece came off, or a cut was done, by this hand.
    pub severed: Option<usize>,
}

/// Turns what happens into pulses.
#[derive(Clone, Copy, Debug)]
pub struct Haptics {
    strength: f64,
    touched: [bool; 2],
    fired: u64,
}

impl Haptics {
    /// With a strength from 0 (none) to 1.
    pub fn new(strength: f64) -> Self {
        Self { strength, touched: [false; 2], fired: 0 }
    }

    /// Another strength, 0 to 1.
    pub fn set_strength(&mut self, strength: f64) {
        self.strength = strength;
    }

    /// The pulse of each hand in this frame: the strongest of what it feels. Contact is felt when it begins.
    pub fn frame(&mut self, felt: Felt) -> [Option<Pulse>; 2] {
        let mut pulses = [None; 2];
        for (hand, pulse) in pulses.iter_mut().enumerate() {
            let begins = felt.touches[hand] && !self.touched[hand];
            let (cause, amplitude, seconds) = if felt.severed == Some(hand) {
                (Cause::Severed, 1.0, 0.08)
            } else if felt.torn == Some(hand) {
                (Cause::Segment, 0.6, 0.02)
            } else if begins {
                (Cause::Contact, 0.35, 0.015)
            } else {
                continue;
            };
            if self.strength > 0.0 {
                *pulse = Some(Pulse { hand, cause, amplitude: amplitude * self.strength, seconds });
                self.fired += 1;
            }
        }
        self.touched = felt.touches;
        pulses
    }

    /// Pulses so far.
    pub fn fired(&self) -> u64 {
        self.fired
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contact_is_felt_once_and_tearing_at_every_segment() {
        let mut haptics = Haptics::new(0.5);
        let touch = Felt { touches: [false, true], ..Felt::default() };
        let first = haptics.frame(touch);
        assert!(first[0].is_none() && first[1].is_some());
        assert_eq!(haptics.frame(touch), [None, None], "a hand at rest in tissue feels nothing");
        let torn = Felt { torn: Some(1), ..touch };
        let tearing = haptics.frame(torn)[1].expect("felt");
        assert_eq!(haptics.frame(torn)[1], Some(tearing), "every segment");
        assert!(tearing.amplitude > first[1].expect("felt").amplitude);
        let severed = haptics.frame(Felt { severed: Some(1), ..torn })[1].expect("felt");
        assert!(severed.amplitude > tearing.amplitude && severed.amplitude <= 0.5);
        assert_eq!(haptics.fired(), 4);
    }

    #[test]
    fn without_strength_nothing_is_felt() {
        let mut haptics = Haptics::new(0.0);
        assert_eq!(haptics.frame(Felt { touches: [true; 2], torn: Some(0), severed: Some(1) }), [None, None]);
        assert_eq!(haptics.fired(), 0);
    }
}
