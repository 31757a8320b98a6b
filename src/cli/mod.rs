//! The command line: one file a sub-command. Results on stdout, everything else on stderr; exit 2 for bad usage or input,
//! 1 for a failed run.

mod bench;
mod common;
mod cut;
#[cfg(feature = "desktop")]
mod desktop;
mod generate;
#[cfg(feature = "gpu")]
mod headless;
mod inspect;
mod particles;
mod report_json;
mod tear;
#[cfg(feature = "vr")]
mod vr;

use crate::config::Config;
use clap::{Parser, Subcommand};
use std::path::{Path, PathBuf};

const AFTER_HELP: &str = "\
Without a sub-command: the headset, else the window, or, where there is neither, the headless demo with its pictures in out/.

A MODEL is a .glb, .gltf, .obj or .stl file, or one of the bundled beam, heart and sphere. Lengths are in metres.
Results go to stdout, everything else to stderr. Exit codes: 0 done, 1 the run failed, 2 bad usage or input.

  incise inspect beam
  incise cut heart --plane 1,0,0,0 --out pieces
  incise headless --script assets/scripts/beam.toml --out pictures";

/// Real-time tearing and cutting of soft, rigged, animated models.
#[derive(Parser)]
#[command(version, about, after_help = AFTER_HELP)]
struct Arguments {
    /// More words on stderr; twice for all of them.
    #[arg(short, long, action = clap::ArgAction::Count, global = true, display_order = 900)]
    verbose: u8,
    /// Settings (default: config.toml in the current folder, if there is one).
    #[arg(long, value_name = "FILE.toml", global = true, display_order = 901)]
    config: Option<PathBuf>,
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand)]
enum Command {
    /// Says what a model holds.
    Inspect(inspect::Inspect),
    /// Cuts a model along a plane and writes the pieces.
    Cut(cut::Cut),
    /// Tears a model along a blade path and writes the result.
    Tear(tear::Tear),
    /// Samples the soft layer's particles and says how good they are.
    Particles(particles::Particles),
    /// Writes a bundled model.
    Generate(generate::Generate),
    /// Measures run time against error.
    Bench(bench::Bench),
    /// Renders a scripted scene to pictures, without a window.
    #[cfg(feature = "gpu")]
    Headless(headless::Headless),
    /// Starts on the headset.
    #[cfg(feature = "vr")]
    Vr(vr::Vr),
    /// Opens a window: tear, cut and grab with the mouse.
    #[cfg(feature = "desktop")]
    Desktop(desktop::Desktop),
}

/// Why a command failed, and with which exit code.
#[derive(Debug)]
pub enum CliError {
    /// Bad usage or input: exit code 2.
    Input(String),
    /// A failed run: exit code 1.
    Run(String),
}

impl CliError {
    /// The words, whatever the exit code.
    #[cfg(any(feature = "desktop", feature = "vr"))]
    fn into_message(self) -> String {
        match self {
            Self::Input(message) | Self::Run(message) => message,
        }
    }

    fn input(error: impl std::fmt::Display) -> Self {
        Self::Input(error.to_string())
    }

    fn run(error: impl std::fmt::Display) -> Self {
        Self::Run(error.to_string())
    }
}

/// Runs the command line of this process; returns its exit code. `allocations` counts heap allocations so far.
pub fn main(allocations: fn() -> u64) -> u8 {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            let _ = error.print(); // nothing is left to tell a reader who is gone
            return if error.use_stderr() { 2 } else { 0 };
        }
    };
    let level = [tracing::Level::WARN, tracing::Level::INFO, tracing::Level::DEBUG][usize::from(arguments.verbose.min(2))];
    tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr()))
        .without_time()
        .with_target(false)
        .init();
    let file = arguments.config.as_deref();
    let result = load_config(file).and_then(|config| run(arguments.command, &config, file, allocations));
    match result {
        Ok(()) => 0,
        Err(CliError::Input(message)) => complain(&message, 2),
        Err(CliError::Run(message)) => complain(&message, 1),
    }
}

/// The file that was named, else `config.toml` in the current folder, else the defaults.
fn load_config(named: Option<&Path>) -> Result<Config, CliError> {
    let here = Path::new("config.toml");
    // whatever is there: a folder or a link to nowhere is told of and not passed over
    match named.or_else(|| here.symlink_metadata().is_ok().then_some(here)) {
        Some(path) => Config::load(path).map_err(CliError::input),
        None => Ok(Config::default()),
    }
}

fn run(command: Option<Command>, config: &Config, file: Option<&Path>, allocations: fn() -> u64) -> Result<(), CliError> {
    #[cfg(not(any(feature = "desktop", feature = "vr")))]
    let _ = file;
    match command {
        Some(Command::Inspect(command)) => command.run(),
        Some(Command::Cut(command)) => command.run(config),
        Some(Command::Tear(command)) => command.run(config),
        Some(Command::Particles(command)) => command.run(config),
        Some(Command::Generate(command)) => command.run(),
        Some(Command::Bench(command)) => command.run(config),
        #[cfg(feature = "gpu")]
        Some(Command::Headless(command)) => command.run(config, allocations),
        #[cfg(feature = "vr")]
        Some(Command::Vr(command)) => command.run(config, file, allocations),
        #[cfg(feature = "desktop")]
        Some(Command::Desktop(command)) => command.run(config, file, allocations),
        #[cfg(feature = "gpu")]
        None => best_mode(config, file, allocations),
        #[cfg(not(feature = "gpu"))]
        None => {
            let _ = allocations;
            Err(CliError::Input(
                "this build draws no pictures; give a sub-command (see --help), or build with the feature `gpu`".into(),
            ))
        }
    }
}

/// The best mode there is: the headset, else a window, else the headless demo.
#[cfg(feature = "gpu")]
fn best_mode(config: &Config, file: Option<&Path>, allocations: fn() -> u64) -> Result<(), CliError> {
    #[cfg(feature = "vr")]
    match crate::host::vr::available() {
        Ok(()) => match vr::Vr::plain().open(config, file, allocations)? {
            Ok(()) => return Ok(()),
            Err(why) => tracing::warn!("{why}"),
        },
        Err(why) => tracing::warn!("{why}"),
    }
    #[cfg(feature = "desktop")]
    if crate::host::desktop::has_display() {
        match desktop::Desktop::plain().open(config, file, allocations)? {
            Ok(()) => return Ok(()),
            Err(why) => tracing::warn!("{why}"),
        }
    } else {
        tracing::warn!("no display: neither DISPLAY nor WAYLAND_DISPLAY is set. Playing the headless demo instead");
    }
    #[cfg(not(any(feature = "desktop", feature = "vr")))]
    let _ = file;
    headless::Headless::demo().run(config, allocations)
}

fn complain(message: &str, code: u8) -> u8 {
    eprintln!("incise: {message}");
    code
}
