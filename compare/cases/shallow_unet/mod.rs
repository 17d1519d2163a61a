//! `shallow_unet`: the U-Net for frames under 40 px, and its gradients.

use anyhow::Result;

use crate::harness::case::Case;
use crate::harness::unet;

pub fn compare(case: &mut Case) -> Result<()> {
    unet::compare(case, false)
}
