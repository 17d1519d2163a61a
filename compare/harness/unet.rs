//! Both U-Nets: mask logits, and the gradients to all variables.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use paig::network::blocks::{Layers, UNet, uses_deep_unet};
use tch::Device;
use tch::nn::VarStore;

use crate::harness::case::{Case, channels_first, channels_last};
use crate::harness::golden::as_stored;
use crate::harness::variables::{VariableListing, fill};
use crate::tolerances::{FORWARD, GRADIENT};

/// More frames than these go through the network.
const FRAMES: i64 = 16;
/// Scope of the variables.
const SCOPE: &str = "unet";

/// `deep`: whether the file's name says the deep U-Net.
pub fn compare(case: &mut Case, deep: bool) -> Result<()> {
    let x = case.input("in/x", 4)?;
    let weight = case.input("in/out_weight", 4)?;
    let (shape, logits) = (x.size(), weight.size());
    let side = shape[1];
    ensure!(
        uses_deep_unet(side as usize) == deep,
        "tensor in/x has shape {shape:?}: frames of this side go through the other U-Net than the file's name says"
    );
    // Each pooling halves the side.
    let multiple = if deep { 8 } else { 4 };
    ensure!(
        shape[2] == side && side % multiple == 0,
        "tensor in/x has shape {shape:?}, expected square frames with a side that is a multiple of {multiple}"
    );
    ensure!(
        logits[..3] == shape[..3],
        "tensor in/out_weight has shape {logits:?}, which does not go with in/x of {shape:?}"
    );

    let mut store = VarStore::new(Device::Cpu);
    let net = {
        let mut layers = Layers::new(store.root() / SCOPE);
        UNet::for_side(&mut layers, side as usize, shape[3] as usize, logits[3] as usize, case.kernels)
    };
    store.set_kind(case.kind);
    let listing = VariableListing {
        names: "var_names",
        shapes: "var_shapes",
        prefix: "net/",
        weight_seed: case.golden.seed("weight_seed")?,
        scalars: BTreeMap::new(),
        factors: BTreeMap::new(),
    };
    let variables = fill(case, &listing, &store)?;
    // More frames than the file has, of which the first are compared: the port's own kernels serve from some frames on.
    let repeated = channels_first(&x).repeat([FRAMES.div_euclid(shape[0]) + 1, 1, 1, 1]);
    let y = channels_last(&net.forward(&repeated).narrow(0, 0, shape[0]));
    case.check("out/y", &y, &FORWARD)?;
    (y * weight).sum(case.kind).backward();
    for variable in &variables {
        let name = format!("grad/{}", variable.original_name);
        case.check(&name, &as_stored(&variable.gradient()?), &GRADIENT)?;
    }
    Ok(())
}
