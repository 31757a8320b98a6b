//! The simulation step of a frame, from what the runtime predicts.

/// Headsets run between these; a predicted period outside them is nonsense. Seconds.
const PERIODS: std::ops::RangeInclusive<f64> = 1.0 / 500.0..=1.0 / 20.0;
/// Where the runtime predicts nonsense.
const DEFAULT_PERIOD_S: f64 = 1.0 / 90.0;
/// After a pause the scene goes on where it was, and does not leap. Seconds.
const LONGEST_STEP_S: f64 = 0.1;

/// Seconds of a predicted period, if it is one that a headset can have.
fn sane_period(period_ns: i64) -> Option<f64> {
    Some(period_ns as f64 * 1e-9).filter(|period| PERIODS.contains(period))
}

/// Milliseconds that the GPU has for a frame: as long as a picture is shown. The rate that was agreed upon counts more than what is
/// predicted, since a runtime may predict every other picture only once we are late.
pub fn budget_ms(refresh_hz: Option<f32>, period_ns: i64) -> f64 {
    let agreed = refresh_hz.map(|hz| 1.0 / f64::from(hz)).filter(|period| PERIODS.contains(period));
    1e3 * agreed.or(sane_period(period_ns)).unwrap_or(DEFAULT_PERIOD_S)
}

/// Turns predicted display times into steps.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepClock {
    last_display_ns: Option<i64>,
    nonsense: u64,
}

impl StepClock {
    /// Seconds from the last frame's display to this one's. The first frame, one after [`StepClock::pause`], and one whose
    /// time does not advance take the predicted period; a period that no headset has is replaced and counted.
    pub fn step(&mut self, display_ns: i64, period_ns: i64) -> f64 {
        let sane = sane_period(period_ns);
        self.nonsense += u64::from(sane.is_none());
        let period = sane.unwrap_or(DEFAULT_PERIOD_S);
        let since = self.last_display_ns.replace(display_ns).map(|last| display_ns.saturating_sub(last) as f64 * 1e-9);
        match since {
            Some(step) if step > 0.0 => step.min(LONGEST_STEP_S),
            _ => period,
        }
    }

    /// The user has taken the headset off: the time until the next frame does not count.
    pub fn pause(&mut self) {
        self.last_display_ns = None;
    }

    /// Frames whose predicted period was nonsense.
    pub fn nonsense(&self) -> u64 {
        self.nonsense
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: i64 = 11_111_111;

    #[test]
    fn steps_are_differences_of_display_times() {
        let mut clock = StepClock::default();
        assert!((clock.step(1_000, PERIOD) - 1.0 / 90.0).abs() < 1e-9);
        assert!((clock.step(1_000 + 2 * PERIOD, PERIOD) - 2.0 / 90.0).abs() < 1e-9, "a dropped frame is two periods long");
        assert_eq!(clock.nonsense(), 0);
    }

    #[test]
    fn the_gpu_has_as_long_as_a_picture_is_shown() {
        assert!((budget_ms(Some(72.0), PERIOD) - 1e3 / 72.0).abs() < 1e-4);
        assert!((budget_ms(None, PERIOD) - 11.1111).abs() < 1e-3);
        for (hz, period) in [(Some(0.0), 0), (Some(f32::NAN), -1), (None, i64::MAX)] {
            assert!((budget_ms(hz, period) - 1e3 / 90.0).abs() < 1e-9);
        }
    }

    #[test]
    fn nonsense_is_replaced_and_counted() {
        let mut clock = StepClock::default();
        for bad in [0, -5, i64::MAX, i64::MIN, 1, 10_000_000_000] {
            assert_eq!(clock.step(7, bad), 1.0 / 90.0, "a display time that stands still takes the period");
        }
        assert_eq!(clock.nonsense(), 6);
        assert_eq!(clock.step(i64::MAX, PERIOD), 0.1, "never longer than a tenth of a second");
        assert!(clock.step(i64::MIN, PERIOD) > 0.0, "time that runs backwards does not");
    }

    #[test]
    fn a_pause_does_not_count() {
        let mut clock = StepClock::default();
        clock.step(0, PERIOD);
        clock.pause();
        assert!((clock.step(60_000_000_000, PERIOD) - 1.0 / 90.0).abs() < 1e-9);
    }
}
