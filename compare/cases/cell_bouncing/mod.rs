//! `cell_bouncing`: the roll-out of balls between walls, and its gradients.

use anyhow::Result;

use crate::harness::case::Case;
use crate::harness::cell;

pub fn compare(case: &mut Case) -> Result<()> {
    cell::compare(case, "bouncing_balls")
}
