//! `init_vel_<task>`, `init_vel_alt_<task>`: velocities, and the gradients to the positions and the estimator's
//! variables.

use anyhow::{Result, ensure};
use paig::tasks::Task;

use crate::harness::case::Case;
use crate::harness::part::{check_gradients, model};
use crate::tolerances::{FORWARD, GRADIENT};

/// The estimator of positions.
pub fn compare(case: &mut Case, task: &Task) -> Result<()> {
    compare_estimator(case, task, false)
}

/// The estimator of differences (`alt_vel`).
pub fn compare_alternative(case: &mut Case, task: &Task) -> Result<()> {
    compare_estimator(case, task, true)
}

fn compare_estimator(case: &mut Case, task: &Task, alt_vel: bool) -> Result<()> {
    let pos = case.leaf("in/pos", 3)?;
    let weight = case.input("in/vel_weight", 2)?;
    let [batch, coordinates] = [pos.size()[0], 2 * task.system.objects as i64];
    let expected = [batch, task.system.input_steps as i64, coordinates];
    ensure!(pos.size() == expected, "tensor in/pos has shape {:?}, expected {expected:?}", pos.size());
    let expected = [batch, coordinates];
    ensure!(weight.size() == expected, "tensor in/vel_weight has shape {:?}, expected {expected:?}", weight.size());

    let (model, variables) = model(case, task, alt_vel)?;
    let vel = model.velocity.forward(&pos);
    case.check("out/vel", &vel, &FORWARD)?;
    (vel * weight).sum(case.kind).backward();
    case.check("grad/pos", &pos.grad(), &GRADIENT)?;
    check_gradients(case, &variables, "init_vel.", &GRADIENT)
}
