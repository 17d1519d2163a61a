//! The options of a program, for a process or for people to copy.

use std::ffi::{OsStr, OsString};

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

    /// The whole command in a shell's notation: the program, its command, the options.
    ///
    /// # Errors
    /// A word that is not UTF-8.
    pub fn shell(&self, program: impl AsRef<OsStr>, command: &str) -> Result<String> {
        let options = self.0.iter().map(OsString::as_os_str);
        let words = [program.as_ref(), OsStr::new(command)].into_iter().chain(options);
        let words: Option<Vec<_>> = words.map(OsStr::to_str).collect();
        shlex::try_join(words.context("a path that is not UTF-8 cannot stand in a command line")?)
            .context("command line")
    }
}
