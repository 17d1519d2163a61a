//! Many lines of arguments, played after each other.

use std::path::Path;

use anyhow::{Context, Result};
use serde::Deserialize;

use super::Arguments;
use paig_experiments::control::results::{FORMAT, Results, Row};
use paig_terminal::say;

/// A file of lines of arguments.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Study {
    pub(super) play: Vec<Play>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Play {
    /// Folder of its pictures, in that of the results.
    pub(super) name: String,
    pub(super) arguments: String,
}

impl Play {
    /// Its rows, played now or, where they may be, taken over from this folder.
    pub(super) fn rows(&self, line: &Arguments, folder: &Path, take_over: bool) -> Result<Vec<Row>> {
        let path = folder.join("results.json");
        if take_over && path.exists() {
            let before = Results::read(&path)?;
            if before.line.as_ref() == Some(&self.arguments) {
                say!("played before");
                return Ok(before.rows);
            }
        }
        let rows = line.play_all(folder).with_context(|| self.name.clone())?;
        let results = Results { format: FORMAT, line: Some(self.arguments.clone()), rows };
        results.write(&path)?;
        Ok(results.rows)
    }
}
