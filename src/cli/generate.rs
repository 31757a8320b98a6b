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
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), allow_negative_numbers = true)]
    faces: Option<u64>,
    /// The .glb file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

impl Generate {
    pub fn run(self) -> Result<(), CliError> {
        if self.out.extension().is_none_or(|e| !e.eq_ignore_ascii_case("glb")) {
            return Err(CliError::Input(format!("--out {}: only .glb is written; end the name in .glb", self.out.display())));
        }
        let faces = self.faces.map(|n| usize::try_from(n).unwrap_or(usize::MAX));
        let bytes = generate(&self.name, faces).map_err(CliError::input)?;
        write_file(&self.out, &bytes)?;
        print_line(&self.out.display().to_string());
        Ok(())
    }
}
