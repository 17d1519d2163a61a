//! The program `paig`: its commands, what they print. See `paig --help`.

mod commands;
mod help;
mod measure_display;
mod sweep_display;
mod version;

use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser};
use paig::run::Program;
use paig_terminal::ending::exit_code;
use paig_terminal::usage;

use self::commands::Command;

/// This build, as results name it.
const PROGRAM: Program = Program { version: env!("CARGO_PKG_VERSION"), commit: env!("PAIG_COMMIT") };

/// Physics-as-Inverse-Graphics: learns objects, positions and physical parameters from unlabelled video, given the form of
/// the differential equation.
#[derive(Debug, Parser)]
#[command(name = "paig", subcommand_required = true, arg_required_else_help = true)]
pub struct Paig {
    #[command(subcommand)]
    command: Command,
}

/// Runs the program.
pub fn main() -> ExitCode {
    exit_code(|| match parsed() {
        Ok(command) => command.run(),
        Err(unparsed) => Ok(usage::print(&unparsed)),
    })
}

fn parsed() -> Result<Command, clap::Error> {
    let program = Paig::command().version(version::text());
    let help = help::text(&program);
    let matches = program.override_help(help).try_get_matches()?;
    Ok(Paig::from_arg_matches(&matches)?.command)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_are_sound() {
        Paig::command().debug_assert();
    }
}
