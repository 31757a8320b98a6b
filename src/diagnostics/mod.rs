//! Counters and timings. The core has no clock of its own: it hands stages to a [`Stages`], which alone looks at one.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

static AUDITS: AtomicBool = AtomicBool::new(true);

/// Whether a build with assertions looks at whole models after an edit, in lists of its own. It does until [`set_audits`] says otherwise;
/// a release build never does.
pub fn audits() -> bool {
    AUDITS.load(Ordering::Relaxed)
}

/// Sets [`audits`] for the whole program: off for one that counts what its frames allocate.
pub fn set_audits(audits: bool) {
    AUDITS.store(audits, Ordering::Relaxed);
}

/// Milliseconds by stage name, in the order the stages first ran.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stages {
    rows: [(&'static str, f64); MOST_STAGES],
    len: usize,
}

/// Stages that are told apart; the time of any more goes to the last. Inline, so that timing a frame allocates nothing.
const MOST_STAGES: usize = 16;

impl Stages {
    /// Runs `work` and adds its time to `stage`.
    pub fn time<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.add(stage, start.elapsed().as_secs_f64() * 1e3);
        result
    }

    /// Adds milliseconds to a stage.
    pub fn add(&mut self, stage: &'static str, ms: f64) {
        match self.rows[..self.len].iter_mut().find(|r| r.0 == stage) {
            Some(row) => row.1 += ms,
            None if self.len < MOST_STAGES => {
                self.rows[self.len] = (stage, ms);
                self.len += 1;
            }
            None => self.rows[MOST_STAGES - 1].1 += ms,
        }
    }

    /// Adds every stage of `other`.
    pub fn merge(&mut self, other: &Stages) {
        for &(stage, ms) in other.rows() {
            self.add(stage, ms);
        }
    }

    /// Milliseconds of one stage; 0 if it never ran.
    pub fn get(&self, stage: &str) -> f64 {
        self.rows().iter().find(|r| r.0 == stage).map_or(0.0, |r| r.1)
    }

    /// All stages with their milliseconds.
    pub fn rows(&self) -> &[(&'static str, f64)] {
        &self.rows[..self.len]
    }

    /// Sum of all stages, milliseconds.
    pub fn total(&self) -> f64 {
        self.rows().iter().fold(0.0, |sum, r| sum + r.1)
    }
}

/// Seconds for which the calling thread has run on a core since it began: time in which it waited, or in which the system ran
/// something else in its place, does not count. None where the system does not tell.
pub fn core_seconds() -> Option<f64> {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Some(time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64)
    }
    #[cfg(not(unix))]
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn a_thread_that_waits_uses_no_core() {
        let seconds = || core_seconds().expect("told");
        let start = seconds();
        std::thread::sleep(std::time::Duration::from_millis(50));
        let slept = seconds();
        let mut sum = 0u64;
        while seconds() - slept < 0.02 {
            sum = std::hint::black_box(sum + 1);
        }
        assert!(slept - start < 0.02 && sum > 0, "{} s while asleep", slept - start);
    }

    #[test]
    fn stages_add_up() {
        let mut stages = Stages::default();
        stages.add("clip", 1.0);
        stages.add("bind", 2.0);
        stages.add("clip", 0.5);
        let mut sum = Stages::default();
        sum.merge(&stages);
        sum.merge(&stages);
        assert_eq!((sum.get("clip"), sum.get("none"), sum.total()), (3.0, 0.0, 7.0));
        assert_eq!(stages.time("work", || 7), 7);
    }
}
