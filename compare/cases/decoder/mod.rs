//! `decoder_<task>`: drawn frames, masks, and the gradients to the positions and the decoder's variables.

use anyhow::{Result, ensure};
use paig::tasks::Task;

use crate::cases::stn::SAMPLED_GRADIENT;
use crate::harness::case::{Case, channels_last};
use crate::harness::formula;
use crate::harness::part::{check_gradients, model};
use crate::tolerances::{FORWARD, GRADIENT};

/// The masks are left out of the files with frames of this side and more.
const MASKS_BELOW_SIDE: usize = 64;

pub fn compare(case: &mut Case, task: &Task) -> Result<()> {
    let golden = case.golden;
    let pos = case.leaf("in/pos", 2)?;
    let frames = pos.size()[0];
    let expected = [frames, 2 * task.system.objects as i64];
    ensure!(pos.size() == expected, "tensor in/pos has shape {:?}, expected {expected:?}", pos.size());

    let (model, variables) = model(case, task, false)?;
    let rendering = model.decoder.forward(&pos);
    // As a training draws, by the port's own kernels; the gradients are of that.
    let [drawn] = model.decoder.draw([&pos]);
    let y = channels_last(&drawn);
    let weight = case.taken_in(&formula::loss_weights(golden.seed("out_weight_seed")?, &y.size()));
    case.check("out/y", &y, &FORWARD)?;
    case.check_also("out/y", "with its masks", &channels_last(&rendering.frames), &FORWARD)?;
    if task.system.side < MASKS_BELOW_SIDE || golden.has("out/masks") {
        case.check("out/masks", &rendering.masks, &FORWARD)?;
    }
    (y * weight).sum(case.kind).backward();
    case.check("grad/pos", &pos.grad(), &GRADIENT)?;
    check_gradients(case, &variables, "decoder.", &SAMPLED_GRADIENT)
}
