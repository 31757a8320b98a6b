//! `incise generate`.

use super::CliError;
use super::common::{print_line, write_file};
use crate::formats::generate;
use clap::Args;
use std::path::PathBuf;

/// Arguments.
#[derive(Args)]
pub struct Generate {
    /// sphere, beam or heart.
    name: String,
    /// Number of faces to aim at.
    #[arg(long, value_name = "N")]
    faces: Option<usize>,
    /// The .glb file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

impl Generate {
    pub fn run(self) -> Result<(), CliError> {
        let bytes = generate(&self.name, self.faces).map_err(CliError::input)?;
        write_file(&self.out, &bytes)?;
        print_line(&self.out.display().to_string());
        Ok(())
    }
}
