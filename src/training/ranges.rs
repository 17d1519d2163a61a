//! Ranges of a config's values.

use anyhow::{Result, ensure};

pub(super) fn at_least_one(key: &str, count: u64) -> Result<()> {
    ensure!(count > 0, "config: {key} must be at least 1");
    Ok(())
}

/// Most steps and epochs that a config can ask for: some ten thousand years of steps, and far from what a count holds.
const MOST: u64 = 1_000_000_000_000;

pub(super) fn countable(key: &str, count: u64) -> Result<()> {
    ensure!(count <= MOST, "config: {key} = {count}: at most {MOST}");
    Ok(())
}

/// Tensors are multiplied by it in float32.
pub(super) fn not_negative(key: &str, number: f64) -> Result<()> {
    ensure!(number.is_finite() && number >= 0.0, "config: {key} = {number}: must be 0 or a positive number");
    ensure!(number <= f64::from(f32::MAX), "config: {key} = {number:e}: at most {:e}, the largest float32", f32::MAX);
    Ok(())
}
