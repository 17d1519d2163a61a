//! Help and complaints about a command line, printed as all other text: escaped, and a full disk is an error.

use std::process::ExitCode;

use clap::{Error, Parser};

use crate::progress::{write_error_line, write_line};

/// Parses the command line; where there is nothing to run, prints why and returns the exit code.
///
/// # Errors
/// Help, the version, or a command line that cannot be.
pub fn parsed<P: Parser>() -> Result<P, ExitCode> {
    P::try_parse().map_err(|error| print(&error))
}

/// Prints what clap has to say in place of a command; the exit code.
pub fn print(error: &Error) -> ExitCode {
    let text = error.render().to_string();
    if error.use_stderr() {
        write_error_line(text.trim_end());
    } else {
        write_line(format_args!("{text}"));
    }
    u8::try_from(error.exit_code()).map_or(ExitCode::FAILURE, ExitCode::from)
}
