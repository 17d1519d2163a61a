//! The options of a program, for a process or for people to copy.

use std::ffi::{OsStr, OsString};
use std::iter;

use anyhow::{Context, Result};

/// Words of a command line in their order: `--name value` and so on.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct CommandOptions(Vec<OsString>);

impl CommandOptions {
    /// Adds `--name value`.
    #[must_use]
    pub fn with(self, name: &str, value: impl AsRef<OsStr>) -> Self {
        self.with_each(name, [value])
    }

    /// Adds `--name value` for each value.
    #[must_use]
    pub fn with_each(mut self, name: &str, values: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Self {
        for value in values {
            self.0.extend([format!("--{name}").into(), value.as_ref().into()]);
        }
        self
    }

    pub fn words(&self) -> &[OsString] {
        &self.0
    }

    /// The whole command in a shell's notation.
    ///
    /// # Errors
    /// A word that is not UTF-8.
    pub fn shell(&self, program: impl AsRef<OsStr>) -> Result<String> {
        let words: Option<Vec<_>> =
            iter::once(program.as_ref()).chain(self.0.iter().map(|w| w.as_os_str())).map(OsStr::to_str).collect();
        shlex::try_join(words.context("a path that is not UTF-8 cannot stand in a command line")?)
            .context("command line")
    }
}
