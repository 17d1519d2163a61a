//! `stn`: the spatial transformer with any affine map, and its gradients.

use anyhow::{Result, ensure};
use paig::network::stn;

use crate::checks::{Case, channels_first, channels_last};
use crate::tolerances::{FORWARD, GRADIENT, SAMPLED_GRADIENT};

pub fn compare(case: &mut Case) -> Result<()> {
    let (images, theta) = (case.leaf("in/U", 4)?, case.leaf("in/theta", 2)?);
    let weight = case.input("in/out_weight", 4)?;
    let batch = images.size()[0];
    ensure!(theta.size() == [batch, 6], "tensor in/theta has shape {:?}, expected {:?}", theta.size(), [batch, 6]);
    let side = weight.size()[1];
    let expected = [batch, side, side, images.size()[3]];
    ensure!(weight.size() == expected, "tensor in/out_weight has shape {:?}, expected {expected:?}", weight.size());

    let y = channels_last(&stn::transform(&channels_first(&images), &theta, side));
    case.check("out/y", &y, &FORWARD)?;
    (y * weight).sum(case.kind).backward();
    case.check("grad/U", &images.grad(), &SAMPLED_GRADIENT)?;
    case.check("grad/theta", &theta.grad(), &GRADIENT)
}
