//! Help and complaints about a command line, printed as all other text: escaped, and a full disk is an error.

use std::process::ExitCode;

use clap::error::ContextValue;
use clap::{Error, Parser};

use crate::progress::{escaped, write_error, write_text};

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
        let words = error.context().flat_map(|(_, value)| match value {
            ContextValue::String(word) => vec![word.clone()],
            ContextValue::Strings(words) => words.clone(),
            _ => Vec::new(),
        });
        write_error(escaped_words(text, words).trim_end());
    } else {
        write_text(&text);
    }
    u8::try_from(error.exit_code()).map_or(ExitCode::FAILURE, ExitCode::from)
}

/// A text with the words of the command line in it, and the values within them, on one line each.
fn escaped_words(text: String, words: impl Iterator<Item = String>) -> String {
    let parts = words.flat_map(|word| {
        let value = word.split_once('=').map(|(_, value)| value.to_string());
        [Some(word), value].into_iter().flatten()
    });
    parts.filter(|part| part.contains('\n')).fold(text, |text, part| text.replace(&part, &escaped(&part)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_of_the_command_line_begins_no_line() {
        let words = ["--out=a\nerror: b", "c\nd", "e"].map(String::from);
        let text = "error: invalid value 'a\nerror: b'\n\n  unexpected 'c\nd'".to_string();
        let shown = "error: invalid value 'a\\nerror: b'\n\n  unexpected 'c\\nd'";
        assert_eq!(escaped_words(text, words.into_iter()), shown);
    }
}
