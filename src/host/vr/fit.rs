//! How much of the eyes' pictures is drawn: as much as the GPU has time for.

use crate::gpu::{GpuTimes, Resolution};

/// Whose word on the GPU's load counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GpuLoad {
    /// The GPU's own timestamps.
    Measured,
    /// A test driver's, milliseconds: what the driver does not lead would differ from run to run.
    Told(f64),
}

/// Fits the pictures to the time there is.
#[derive(Debug)]
pub struct Fit {
    resolution: Resolution,
    /// The latest frame whose time was taken in.
    latest: u64,
    least: f64,
}

impl Fit {
    /// Whole pictures, for now; `floor` is the smallest share of each side.
    pub fn new(floor: f64) -> Self {
        Self { resolution: Resolution::new(floor), latest: 0, least: 1.0 }
    }

    /// Takes in what is new of the GPU's load and says what part of a picture of `full` pixels to draw.
    pub fn frame(&mut self, load: GpuLoad, times: Option<GpuTimes>, budget_ms: f64, full: (u32, u32)) -> (u32, u32) {
        match (load, times) {
            (GpuLoad::Told(ms), _) => self.resolution.frame(ms, budget_ms),
            (GpuLoad::Measured, Some(times)) if times.frame() > self.latest => {
                self.latest = times.frame();
                self.resolution.frame(times.total_ms(), budget_ms);
            }
            _ => {}
        }
        self.least = self.least.min(self.resolution.scale());
        self.resolution.viewport(full)
    }

    /// The smallest share of each side so far.
    pub fn least(&self) -> f64 {
        self.least
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FULL: (u32, u32) = (1000, 800);

    #[test]
    fn what_is_told_shrinks_the_picture_and_a_floor_of_one_keeps_it() {
        let mut fit = Fit::new(0.5);
        assert_eq!(fit.frame(GpuLoad::Told(0.0), None, 10.0, FULL), FULL, "nothing is known yet");
        let smaller = fit.frame(GpuLoad::Told(20.0), None, 10.0, FULL);
        assert!(smaller.0 < 720 && smaller.1 < 576, "{smaller:?}");
        assert!(fit.least() < 0.72);
        let mut whole = Fit::new(1.0);
        assert_eq!(whole.frame(GpuLoad::Told(20.0), None, 10.0, FULL), FULL);
        assert_eq!(whole.least(), 1.0);
    }

    #[test]
    fn without_timestamps_the_picture_stays() {
        let mut fit = Fit::new(0.5);
        assert_eq!(fit.frame(GpuLoad::Measured, None, 10.0, FULL), FULL);
        let old = Some(GpuTimes::default());
        assert_eq!(fit.frame(GpuLoad::Measured, old, 10.0, FULL), FULL, "no frame has been timed");
    }
}
