//! `resize_bilinear`: the up-sampling by two.

use anyhow::Result;
use paig::network::blocks::resize_bilinear_x2;

use crate::harness::case::{Case, channels_first, channels_last};
use crate::tolerances::FORWARD;

pub fn compare(case: &mut Case) -> Result<()> {
    let x = case.input("in/x", 4)?;
    case.check("out/y", &channels_last(&resize_bilinear_x2(&channels_first(&x))), &FORWARD)
}
