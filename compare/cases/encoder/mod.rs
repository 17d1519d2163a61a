//! `encoder_<task>`: masks, masked frames and positions, and the gradients to the encoder's variables.

use anyhow::{Result, ensure};
use paig::tasks::Task;

use crate::harness::case::{Case, channels_first, channels_last};
use crate::harness::part::{check_gradients, model};
use crate::tolerances::{FORWARD, GRADIENT};

pub fn compare(case: &mut Case, task: &Task) -> Result<()> {
    let x = case.input("in/x", 4)?;
    let weight = case.input("in/pos_weight", 2)?;
    let [frames, side, objects] = [x.size()[0], task.system.side as i64, task.system.objects as i64];
    let expected = [frames, side, side, task.system.channels as i64];
    ensure!(x.size() == expected, "tensor in/x has shape {:?}, expected {expected:?}", x.size());
    let expected = [frames, 2 * objects];
    ensure!(weight.size() == expected, "tensor in/pos_weight has shape {:?}, expected {expected:?}", weight.size());

    let (model, variables) = model(case, task, false)?;
    let encoding = model.encoder.forward(&channels_first(&x));
    case.check("out/pos", &encoding.positions, &FORWARD)?;
    case.check("out/masks", &channels_last(&encoding.masks), &FORWARD)?;
    case.check("out/masked_objs", &channels_last(&encoding.masked), &FORWARD)?;
    (encoding.positions * weight).sum(case.kind).backward();
    check_gradients(case, &variables, "encoder.", &GRADIENT)
}
