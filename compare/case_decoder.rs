//! `decoder_<task>`: drawn frames, masks, and the gradients to the positions and the decoder's variables.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::tasks::{TASKS, Task};
use tch::Device;

use crate::checks::{Case, channels_last};
use crate::formula;
use crate::golden::as_stored;
use crate::tolerances::{FORWARD, GRADIENT, SAMPLED_GRADIENT, Tolerance};
use crate::variables::{Listing, Variable, fill};

/// The masks are left out of the files with frames of this side and more.
const MASKS_BELOW_SIDE: usize = 64;

/// The task of a file whose name goes on with `rest` after the case's prefix: the longest key that `rest` starts with.
pub fn task(rest: &str) -> Option<&'static Task> {
    TASKS.iter().filter(|task| rest.starts_with(task.key)).max_by_key(|task| task.key.len())
}

pub fn compare(case: &mut Case, task: &Task) -> Result<()> {
    let golden = case.golden;
    let pos = case.leaf("in/pos", 2)?;
    let frames = pos.size()[0];
    let expected = [frames, 2 * task.objects as i64];
    ensure!(pos.size() == expected, "tensor in/pos has shape {:?}, expected {expected:?}", pos.size());

    let (model, variables) = model(case, task, false)?;
    let rendering = model.decoder.forward(&pos);
    let y = channels_last(&rendering.frames);
    let weight = case.taken_in(&formula::loss_weights(golden.seed("out_weight_seed")?, &y.size()));
    case.check("out/y", &y, &FORWARD)?;
    if task.side < MASKS_BELOW_SIDE || golden.has("out/masks") {
        case.check("out/masks", &rendering.masks, &FORWARD)?;
    }
    (y * weight).sum(case.kind).backward();
    case.check("grad/pos", &pos.grad(), &GRADIENT)?;
    check_gradients(case, &variables, "decoder.", &SAMPLED_GRADIENT)
}

/// The model of a submodule's file, filled from its `weight_seed`, with its variables.
pub fn model(case: &Case, task: &Task, alt_vel: bool) -> Result<(PhysicsNet, Vec<Variable>)> {
    let options = ModelOptions { alt_vel, ..ModelOptions::original() };
    let mut model = PhysicsNet::new(task, &options, Device::Cpu, 0);
    model.variables.set_kind(case.kind);
    let listing = Listing {
        names: "var_names_all",
        shapes: "var_shapes_all",
        prefix: "",
        weight_seed: case.golden.seed("weight_seed")?,
        scalars: BTreeMap::from([("log_k", 0.0), ("log_l", 0.0), ("log_g", 0.0), ("logsigma", 1.3f64.ln())]),
        factors: BTreeMap::new(),
    };
    let variables = fill(case, &listing, &model.variables)?;
    Ok((model, variables))
}

/// Gradients to the variables whose name starts with `part`.
pub fn check_gradients(
    case: &mut Case,
    variables: &[Variable],
    part: &str,
    tolerance: &'static Tolerance,
) -> Result<()> {
    for variable in variables.iter().filter(|variable| variable.name.starts_with(part)) {
        let name = format!("grad/{}", variable.original_name);
        case.check(&name, &as_stored(&variable.gradient()?), tolerance)?;
    }
    Ok(())
}
