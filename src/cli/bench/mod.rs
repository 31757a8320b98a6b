//! `incise bench`: run time against error, for every approximation that the program makes.
//!
//! Each line has a time and the error that goes with it, measured in the same run against an exact law or an f64 reference.
//! The finer benchmarks, with other libraries beside ours, are cargo's (`cargo bench`).

mod edits;
mod layer;

use super::CliError;
use super::common::{make_folder, print_line, write_file};
use crate::config::Config;
use clap::Args;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments.
#[derive(Args)]
pub struct Bench {
    /// Small models and few repetitions: a minute's work becomes seconds.
    #[arg(long)]
    quick: bool,
    /// Folder for bench.json and bench.md.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// One measurement.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Row {
    /// What was done.
    task: String,
    /// To what.
    case: String,
    /// Milliseconds, the middle one.
    median_ms: f64,
    /// Milliseconds, 99th percentile.
    p99_ms: f64,
    /// How far off the result was.
    error: f64,
    /// What the error is of.
    error_of: &'static str,
}

impl Row {
    fn new(task: &str, case: impl Into<String>, times: &mut [f64], error: f64, error_of: &'static str) -> Self {
        let [median_ms, p99_ms] = [0.5, 0.99].map(|q| quantile(times, q));
        Self { task: task.into(), case: case.into(), median_ms, p99_ms, error, error_of }
    }

    fn line(&self) -> String {
        let Self { task, case, median_ms, p99_ms, error, error_of } = self;
        format!("{task:<24} {case:<34} {median_ms:>10.4} {p99_ms:>10.4}   {error:>9.2e}  {error_of}")
    }
}

/// The value below which a fraction `q` of `values` lies; NaN for none.
fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    values.get((last as f64 * q).round() as usize).copied().unwrap_or(f64::NAN)
}

/// Milliseconds that `work` takes.
fn time_ms<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let start = Instant::now();
    let result = work();
    (start.elapsed().as_secs_f64() * 1e3, result)
}

impl Bench {
    pub fn run(self, config: &Config) -> Result<(), CliError> {
        if cfg!(debug_assertions) {
            tracing::warn!("this is a debug build: its times say little; use cargo run --release");
        }
        // before minutes of work whose result could not be kept
        if let Some(folder) = &self.out {
            make_folder(folder)?;
        }
        print_line(&format!("{:<24} {:<34} {:>10} {:>10}   {:>9}", "", "", "median ms", "p99 ms", "error"));
        let mut rows = Vec::new();
        let mut note = |row: Row| {
            print_line(&row.line());
            rows.push(row);
        };
        edits::measure(self.quick, config, &mut note)?;
        layer::measure(self.quick, &mut note)?;
        let Some(folder) = &self.out else { return Ok(()) };
        let json = serde_json::to_vec_pretty(&serde_json::json!({ "quick": self.quick, "rows": rows })).map_err(CliError::run)?;
        write_file(&folder.join("bench.json"), &json)?;
        write_file(&folder.join("bench.md"), table(&rows).as_bytes())
    }
}

/// The rows as a Markdown table.
fn table(rows: &[Row]) -> String {
    let mut text = String::from("| what | on | median ms | p99 ms | error | of |\n|---|---|---|---|---|---|\n");
    for Row { task, case, median_ms, p99_ms, error, error_of } in rows {
        text += &format!("| {task} | {case} | {median_ms:.4} | {p99_ms:.4} | {error:.2e} | {error_of} |\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::quantile;

    #[test]
    fn quantiles_are_of_the_sorted_values() {
        let mut values: Vec<f64> = (0..101).rev().map(f64::from).collect();
        assert_eq!((quantile(&mut values, 0.5), quantile(&mut values, 0.99)), (50.0, 99.0));
        assert!(quantile(&mut [], 0.5).is_nan());
    }
}
