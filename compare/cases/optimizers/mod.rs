//! The four optimizers: the end of every whole-model file, the loss before each step and the variables after the last.

use anyhow::Result;
use paig::network::cells::Actions;
use paig::network::physics_models::PhysicsNet;
use paig::network::physics_models::losses::Losses;
use paig::training::optimizers::Optimizer;
use tch::Tensor;

use crate::harness::case::Case;
use crate::harness::golden::as_stored;
use crate::harness::meta::Meta;
use crate::harness::variables::Variable;
use crate::tolerances::{FORWARD, Tolerance};

/// The original clips every element of a gradient to +- this.
const GRADIENT_CLIP: f64 = 1.0;
/// Variables after some steps, whose length is some per cent of the scale: an element whose gradient is near zero
/// takes a step of either sign under Adam, and any that a window's edge has touched takes a full one. The limit is that of
/// the goldens, which take four steps: full ones of rate 6e-4 in either direction make 4.8e-2 of a bias of 0.1.
static TRAINED: Tolerance = Tolerance { relative: 5e-5, chaotic: 5e-2 };

/// Steps on the one batch; the gradients of the first are there.
pub fn check_steps(
    case: &mut Case,
    meta: &Meta,
    model: &PhysicsNet,
    clips: &Tensor,
    first_loss: &Tensor,
    variables: &[Variable],
) -> Result<()> {
    let steps = case.golden.with_axes("train/loss_before_each_step", 1)?.numel();
    let named = model.named_variables();
    let mut optimizer = Optimizer::new(meta.rule, Some(GRADIENT_CLIP), &named);
    let mut losses = vec![first_loss.detach()];
    while losses.len() < steps {
        optimizer.step(&named, |_| meta.task.base_lr);
        let loss =
            Losses::new(&model.forward(clips, &Actions::none())?, clips, &meta.task.system).train(meta.task.alpha);
        loss.backward();
        losses.push(loss.detach());
    }
    optimizer.step(&named, |_| meta.task.base_lr);
    case.check("train/loss_before_each_step", &Tensor::stack(&losses, 0), &FORWARD)?;
    for variable in variables {
        let name = format!("train/var_after/{}", variable.original_name);
        case.check(&name, &as_stored(&variable.in_original_layout()?), &TRAINED)?;
    }
    Ok(())
}
