//! `black_box_<dynamics>_<task>`: positions that a black box rolls out, and the gradients to the input positions and to its
//! weights.

use anyhow::{Context, Result};
use paig::network::cells::Actions;
use paig::network::dynamics::DynamicsKind;
use paig::network::physics_models::{ModelOptions, PhysicsNet, VariableGroup};
use paig::tasks;
use tch::{Device, Tensor};

use crate::harness::case::Case;
use crate::tolerances::{FORWARD, GRADIENT};

const KINDS: [(&str, DynamicsKind); 5] = [
    ("lstm_", DynamicsKind::Lstm),
    ("gru_", DynamicsKind::Gru),
    ("interaction_network_", DynamicsKind::InteractionNetwork),
    ("mlp_", DynamicsKind::Mlp),
    ("linear_", DynamicsKind::Linear),
];

pub fn compare(case: &mut Case) -> Result<()> {
    let rest = case.golden.stem.strip_prefix("black_box_").unwrap_or_default().to_string();
    let told = KINDS.iter().find_map(|(name, kind)| Some((rest.strip_prefix(name)?, *kind)));
    let (task, dynamics) = told.with_context(|| format!("{rest}: its name says no dynamics"))?;
    let options = ModelOptions { dynamics, ..case.options() };
    let mut model = PhysicsNet::new(&tasks::find(task)?.system, &options, Device::Cpu, 0)?;
    model.variables.set_kind(case.kind);
    let variables = model.named_variables().into_iter();
    let variables: Vec<_> = variables.filter(|(name, _)| model.group(name) == VariableGroup::Dynamics).collect();
    fill(case, &variables)?;

    let pos = case.leaf("in/pos", 3)?;
    let weight = case.input("in/pos_weight", 3)?;
    let (_, states) = model.roll_out(&pos, &Actions::none(), weight.size()[1] as usize);
    let positions: Vec<_> = states.into_iter().map(|state| state.pos).collect();
    let positions = Tensor::stack(&positions, 1);
    case.check("out/pos", &positions, &FORWARD)?;
    (positions * weight).sum(case.kind).backward();
    case.check("grad/pos", &pos.grad(), &GRADIENT)?;
    check_gradients(case, &variables)
}

/// Sets each variable to the file's `param/<name>`.
pub fn fill(case: &Case, variables: &[(String, Tensor)]) -> Result<()> {
    let _guard = tch::no_grad_guard();
    for (name, variable) in variables {
        let values = case.input(&format!("param/{name}"), variable.dim())?;
        variable.shallow_clone().f_copy_(&values).with_context(|| format!("param/{name}"))?;
    }
    Ok(())
}

/// Holds each variable's gradient against the file's `grad/<name>`.
pub fn check_gradients(case: &mut Case, variables: &[(String, Tensor)]) -> Result<()> {
    for (name, variable) in variables {
        case.check(&format!("grad/{name}"), &variable.grad(), &GRADIENT)?;
    }
    Ok(())
}
