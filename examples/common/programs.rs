//! The built programs, and what they leave.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use anyhow::{Context, Result, ensure};
use paig::runs::checkpoint::{SavedWeights, find_weights};

/// The folder of the programs.
pub fn folder() -> Result<PathBuf> {
    // This is target/release/examples/NAME.
    let programs = std::env::current_exe()?.ancestors().nth(2).context("no folder of programs")?.to_path_buf();
    ensure!(programs.join("run_physics").exists(), "build the programs first: cargo build --release");
    Ok(programs)
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
