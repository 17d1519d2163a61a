//! `unet`: the U-Net for frames from 40 px, and its gradients.

use anyhow::Result;

use crate::harness::case::Case;
use crate::harness::unet;

pub fn compare(case: &mut Case) -> Result<()> {
    unet::compare(case, true)
}
