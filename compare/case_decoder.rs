//! `decoder_<task>`: drawn frames, masks, and the gradients to the positions and the decoder's variables.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use paig::physics_models::{ModelOptions, PhysicsNet};
use paig::tasks::{TASKS, Task};
use tch::Device;

use crate::checks::{Case, channels_last};
use crate::formula;
use crate::golden::as_stored;
use crate::tolerances::{FORWARD, GRADIENT, SAMPLED_GRADIENT};
use crate::variables::{Listing, fill};

/// The masks are left out of the files with frames of this side and more.
const MASKS_BELOW_SIDE: usize = 64;

/// The task of a file of this name: the longest key that it starts with.
pub fn task(stem: &str) -> Option<&'static Task> {
    let rest = stem.strip_prefix("decoder_")?;
    TASKS.iter().filter(|task| rest.starts_with(task.key)).max_by_key(|task| task.key.len())
}

pub fn compare(case: &mut Case, task: &Task) -> Result<()> {
    let golden = case.golden;
    let pos = case.leaf("in/pos", 2)?;
    let frames = pos.size()[0];
    let expected = [frames, 2 * task.objects as i64];
    ensure!(pos.size() == expected, "tensor in/pos has shape {:?}, expected {expected:?}", pos.size());

    let mut model = PhysicsNet::new(task, &ModelOptions::original(), Device::Cpu, 0);
    model.variables.set_kind(case.kind);
    let listing = Listing {
        names: "var_names_all",
        shapes: "var_shapes_all",
        prefix: "",
        weight_seed: golden.seed("weight_seed")?,
        scalars: BTreeMap::from([("log_k", 0.0), ("log_l", 0.0), ("log_g", 0.0), ("logsigma", 1.3f64.ln())]),
        factors: BTreeMap::new(),
    };
    let variables = fill(case, &listing, &model.variables)?;
    let rendering = model.decoder.forward(&pos);
    let y = channels_last(&rendering.frames);
    let weight = case.taken_in(&formula::loss_weights(golden.seed("out_weight_seed")?, &y.size()));
    case.check("out/y", &y, &FORWARD)?;
    if task.side < MASKS_BELOW_SIDE || golden.has("out/masks") {
        case.check("out/masks", &rendering.masks, &FORWARD)?;
    }
    (y * weight).sum(case.kind).backward();
    case.check("grad/pos", &pos.grad(), &GRADIENT)?;
    for variable in variables.iter().filter(|variable| variable.name.starts_with("decoder.")) {
        let name = format!("grad/{}", variable.original_name);
        case.check(&name, &as_stored(&variable.gradient()?), &SAMPLED_GRADIENT)?;
    }
    Ok(())
}
