//! A part of a whole model: its file names the task and lists the whole model's variables.

use std::collections::BTreeMap;

use anyhow::Result;
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::tasks::{self, Task};
use tch::Device;

use crate::harness::case::Case;
use crate::harness::golden::as_stored;
use crate::harness::variables::{Variable, VariableListing, fill};
use crate::tolerances::Tolerance;

/// The task of a file whose name goes on with `rest` after the case's prefix: the longest key that `rest` starts with.
pub fn task(rest: &str) -> Option<Task> {
    tasks::all().filter(|task| rest.starts_with(&task.name)).max_by_key(|task| task.name.len())
}

/// The model of a part's file, filled from its `weight_seed`, with its variables.
pub fn model(case: &Case, task: &Task, alt_vel: bool) -> Result<(PhysicsNet, Vec<Variable>)> {
    let options = ModelOptions { alt_vel, ..case.options() };
    let mut model = PhysicsNet::new(&task.system, &options, Device::Cpu, 0)?;
    model.variables.set_kind(case.kind);
    let listing = VariableListing {
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
