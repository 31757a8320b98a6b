//! Counters and timings.
