//! The built program, and what it leaves.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use anyhow::{Result, ensure};
use paig::runs::checkpoint::{SavedWeights, find_weights};

/// `paig`, beside this program.
///
/// # Errors
/// It was not built.
pub fn paig() -> Result<PathBuf> {
    let paig = std::env::current_exe()?.with_file_name("paig");
    ensure!(paig.exists(), "{} is missing; build it with `make build`", paig.display());
    Ok(paig)
}

/// # Errors
/// A program that failed.
pub fn done(output: &Output) -> Result<()> {
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "a program failed with {}: {said}", output.status);
    Ok(())
}

/// The bytes of a run's last weights.
pub fn last_weights(run: &Path) -> Result<Vec<u8>> {
    Ok(fs::read(find_weights(run, SavedWeights::Last)?)?)
}
