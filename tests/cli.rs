//! The program from outside: what CONTRACT's commands print, write and refuse.

#[path = "cli/bad_input.rs"]
mod bad_input;
#[path = "cli/bench.rs"]
mod bench;
#[path = "cli/edits.rs"]
mod edits;
#[path = "cli/files.rs"]
mod files;
#[cfg(feature = "gpu")]
#[path = "cli/headless.rs"]
mod headless;
#[path = "cli/models.rs"]
mod models;
#[path = "cli/support.rs"]
mod support;
