//! Prints the completions for a shell. See `paig completions --help`.

use anyhow::Result;
use clap::{Args, CommandFactory};
use clap_complete::{Shell, generate};
use paig_terminal::progress::write_text;

use crate::Paig;

/// Prints the completions of commands and options for a shell.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  paig completions bash > ~/.local/share/bash-completion/completions/paig")]
pub struct CompletionsArguments {
    shell: Shell,
}

pub fn run(arguments: &CompletionsArguments) -> Result<()> {
    let mut script = Vec::new();
    generate(arguments.shell, &mut Paig::command(), "paig", &mut script);
    write_text(&String::from_utf8(script)?);
    Ok(())
}
