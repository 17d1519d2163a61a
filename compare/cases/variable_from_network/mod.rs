//! `variable_from_network_<task>`: the decoder's learned arrays, and the gradients to their networks' variables.

use anyhow::{Context, Result};
use paig::tasks::Task;
use tch::Tensor;

use crate::harness::case::{Case, channels_last};
use crate::harness::formula;
use crate::harness::part::{check_gradients, model};
use crate::tolerances::{FORWARD, GRADIENT};

pub fn compare(case: &mut Case, task: &Task) -> Result<()> {
    let (model, variables) = model(case, task, false)?;
    let sprites = model.decoder.sprites().context("a decoder with sprites")?;
    let arrays = [
        ("out/template", channels_last(&sprites.template)),
        ("out/contents", channels_last(&sprites.contents)),
        ("out/background_content", channels_last(&sprites.background)),
    ];
    for (name, array) in &arrays {
        case.check(name, array, &FORWARD)?;
    }
    let flat: Vec<Tensor> = arrays.iter().map(|(_, array)| array.reshape([-1])).collect();
    let flat = Tensor::cat(&flat, 0);
    let weight = case.taken_in(&formula::loss_weights(case.golden.seed("out_weight_seed")?, &flat.size()));
    (flat * weight).sum(case.kind).backward();
    check_gradients(case, &variables, "decoder.dense", &GRADIENT)
}
