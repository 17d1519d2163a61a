//! `stn`: the spatial transformer with any affine map, and its gradients.

use anyhow::{Result, ensure};
use paig::network::stn;

use crate::harness::case::{Case, channels_first, channels_last};
use crate::tolerances::{FORWARD, GRADIENT, Tolerance};

/// Gradients to a sampled image. TensorFlow adds the cancelling weights of every output point outside the image to
/// its corners; the weights are products of distances, and float32 leaves a rest. Ours is the same in double
/// precision.
pub static SAMPLED_GRADIENT: Tolerance = Tolerance { relative: 1e-3, chaotic: 1e-2 };

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
