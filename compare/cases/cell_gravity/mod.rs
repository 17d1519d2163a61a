//! `cell_gravity`: the roll-out of three bodies under gravity, and its gradients.

use anyhow::Result;

use crate::harness::case::Case;
use crate::harness::cell;

pub fn compare(case: &mut Case) -> Result<()> {
    cell::compare(case, "3bp_color")
}
