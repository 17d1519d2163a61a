//! Files of a report.

use std::io::Write;
use std::path::Path;

use anyhow::Result;
use paig::support::atomic;
use serde::Serialize;

/// Writes results.json and report.md into a folder.
///
/// # Errors
/// A folder that cannot be written, a full disk.
pub fn write(folder: &Path, rows: &[impl Serialize], page: &str) -> Result<()> {
    std::fs::create_dir_all(folder)?;
    atomic::write_file(&folder.join("results.json"), |file| Ok(serde_json::to_writer_pretty(file, rows)?))?;
    atomic::write_file(&folder.join("report.md"), |file| Ok(file.write_all(page.as_bytes())?))
}
