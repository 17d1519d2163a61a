//! The equation in a file: a whole task's, or one that says nothing else.

use std::path::Path;

use anyhow::{Context, Result};
use serde::Deserialize;

use crate::network::system::EquationEntry;
use crate::support::storage;

/// An equation that was read from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct EquationFile {
    /// The file, for people.
    pub name: String,
    /// What moves, in one line; empty where nothing is said.
    pub summary: String,
    pub equation: EquationEntry,
    /// How many objects the file speaks of, if it does.
    pub objects: Option<usize>,
    /// Side of the frame in whose pixels its starts and bounds are, and the time between frames in whose unit, if it says.
    pub side: Option<usize>,
    pub dt: Option<f64>,
}

/// What is read of it; the rest is for those who learn or generate.
#[derive(Deserialize)]
struct Contents {
    #[serde(default)]
    summary: String,
    system: FilePart,
}

#[derive(Deserialize)]
struct FilePart {
    objects: Option<usize>,
    side: Option<usize>,
    dt: Option<f64>,
    equation: EquationEntry,
}

impl EquationFile {
    /// A built-in equation.
    pub fn built_in(name: &str) -> Self {
        EquationFile {
            name: name.into(),
            summary: super::builtin(name).map(|task| task.summary().to_string()).unwrap_or_default(),
            equation: EquationEntry::Name(name.into()),
            objects: None,
            side: None,
            dt: None,
        }
    }

    /// Reads `[system.equation]`, `system.objects`, `system.side` and `system.dt` where they are given.
    ///
    /// # Errors
    /// A file that cannot be read or holds no such table; the message names the key.
    pub fn read(path: &Path) -> Result<Self> {
        let read = || Self::from_text(&path.display().to_string(), &storage::read_to_string(path)?);
        read().with_context(|| format!("equation file {}", path.display()))
    }

    /// The same of a file's text.
    ///
    /// # Errors
    /// A text without such a table.
    pub fn from_text(name: &str, text: &str) -> Result<Self> {
        let Contents { summary, system: FilePart { objects, side, dt, equation } } = toml::from_str(text)?;
        Ok(EquationFile { name: name.into(), summary, equation, objects, side, dt })
    }
}
