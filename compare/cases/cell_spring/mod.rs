//! `cell_spring`: the roll-out of two bodies on a spring, and its gradients.

use anyhow::Result;

use crate::harness::case::Case;
use crate::harness::cell;

pub fn compare(case: &mut Case) -> Result<()> {
    cell::compare(case, "spring_color")
}
