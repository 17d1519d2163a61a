//! An equation as a list of operations on single numbers, for the kernel that rolls it out on a GPU.
//!
//! What an equation computes with vectors, objects and their others is taken apart (`lowering`) into single numbers
//! (`numbers`).

mod lowering;
mod numbers;

use self::lowering::Lowering;
use self::numbers::{Integration, Numbers};
use super::equation::Equation;
use crate::network::cells::parameter::PhysicalParameter;
use crate::network::cells::state::Walls;
use paig_kernels::gpu::roll_out::SubstepListing;

/// The list of a substep; `unconstrained` are the parameters in the order in which they will be given. None if there is no
/// such list.
pub fn listing(
    equation: &Equation,
    unconstrained: &[PhysicalParameter],
    walls: Walls,
    dt: f64,
) -> Option<SubstepListing> {
    // The kernel has no contacts, surfaces or strings.
    if equation.contacts.is_some() || equation.constraints.is_some() {
        return None;
    }
    let mut lowering = Lowering { equation, parameters: Vec::new(), numbers: Numbers::default() };
    for parameter in &equation.parameters {
        let value = match unconstrained.iter().position(|unconstrained| unconstrained.name == parameter.name) {
            Some(place) => lowering.numbers.bounded(place, parameter.bounds),
            None => lowering.numbers.number(parameter.fixed?),
        };
        lowering.parameters.push(value);
    }
    let moved = lowering.moved(dt / equation.table.substeps as f64)?;
    let barrier = equation.walls.as_ref().map(|standing| lowering.barrier(standing, walls));
    let integration = Integration {
        coordinates: lowering.coordinates(),
        parameters: unconstrained.len(),
        tells_time: equation.tells_time(),
        substeps: equation.table.substeps,
        dt,
    };
    Some(lowering.numbers.listing(integration, &moved, barrier))
}
