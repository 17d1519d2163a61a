//! A physics cell: roll-out, its loss, and the gradients to the initial state and the parameters.

use anyhow::{Result, ensure};
use paig::network::cells::{Actions, CellKind, State};
use paig::tasks::{self, Task};
use tch::Tensor;

use crate::harness::case::Case;
use crate::tolerances::{FORWARD, GRADIENT};

/// What the loss `sum(pos * weight)` is multiplied by.
const LOSS_FACTOR: f64 = 1e-3;

/// `task_name`: the task whose cell, frame side and time between frames the file was made with.
pub fn compare(case: &mut Case, task_name: &str) -> Result<()> {
    let task = tasks::find(task_name)?;
    let (pos, vel) = (case.leaf("in/pos", 2)?, case.leaf("in/vel", 2)?);
    let weight = case.input("in/pos_weight", 3)?;
    let (shape, frames) = (pos.size(), weight.size()[0]);
    ensure!(
        shape[1] == 2 * task.system.objects as i64,
        "tensor in/pos has shape {shape:?}, expected two coordinates for each of {} objects",
        task.system.objects
    );
    ensure!(vel.size() == shape, "tensor in/vel has shape {:?}, expected {shape:?}", vel.size());
    let rolled = [frames, shape[0], shape[1]];
    ensure!(weight.size() == rolled, "tensor in/pos_weight has shape {:?}, expected {rolled:?}", weight.size());

    let parameters = parameters(case, &task.system.cell)?;
    let cell = task.system.build_cell(&parameters.logs);
    let initial = State { pos: pos.shallow_clone(), vel: vel.shallow_clone() };
    let states = cell.roll_out(&initial, &Actions::none(), task.system.dt, frames as usize);
    let stack = |of: fn(&State) -> &Tensor| Tensor::stack(&states.iter().map(of).collect::<Vec<_>>(), 0);
    let positions = stack(|state| &state.pos);
    let loss = (&positions * weight).sum(case.kind) * LOSS_FACTOR;

    case.check("out/pos", &positions, &FORWARD)?;
    case.check("out/vel", &stack(|state| &state.vel), &FORWARD)?;
    case.check("out/loss", &loss, &FORWARD)?;
    check_single_steps(case, &task, &parameters.logs)?;
    loss.backward();
    case.check("grad/pos", &pos.grad(), &GRADIENT)?;
    case.check("grad/vel", &vel.grad(), &GRADIENT)?;
    for (name, log) in parameters.leaves {
        case.check(&format!("grad/{name}"), &log.grad(), &GRADIENT)?;
    }
    Ok(())
}

/// Each frame from the golden state before it: binds the physics tightly where the trajectory is chaotic.
fn check_single_steps(case: &mut Case, task: &Task, logs: &[Tensor]) -> Result<()> {
    let golden = case.golden;
    let [pos, vel] = ["pos", "vel"].map(|part| -> Result<(Tensor, Tensor)> {
        let (first, after) = (golden.floats(&format!("in/{part}"))?, golden.floats(&format!("out/{part}"))?);
        let before = Tensor::cat(&[first.unsqueeze(0), after.narrow(0, 0, after.size()[0] - 1)], 0);
        Ok((before.flatten(0, 1), after.flatten(0, 1)))
    });
    let ((pos, pos_after), (vel, vel_after)) = (pos?, vel?);
    let before = State { pos: case.taken_in(&pos), vel: case.taken_in(&vel) };
    let stepped = task.system.build_cell(logs).step(&before, None, task.system.dt);
    case.check_single_step("out/pos", "step by step", &pos_after, &stepped.pos);
    case.check_single_step("out/vel", "step by step", &vel_after, &stepped.vel);
    Ok(())
}

/// The file's parameters.
struct CaseParameters {
    /// What the cell is built with.
    logs: Vec<Tensor>,
    /// What the file has gradients to.
    leaves: Vec<(String, Tensor)>,
}

fn parameters(case: &Case, kind: &CellKind) -> Result<CaseParameters> {
    let (mut logs, mut leaves) = (Vec::new(), Vec::new());
    for parameter in &*kind.parameters {
        let log = case.leaf(&format!("param/{}", parameter.variable), 0)?;
        // What the original holds fixed may lack a gradient.
        if parameter.fixed.is_none() || case.golden.has(&format!("grad/{}", parameter.variable)) {
            leaves.push((parameter.variable.to_string(), log.shallow_clone()));
        }
        logs.push(log);
    }
    Ok(CaseParameters { logs, leaves })
}
