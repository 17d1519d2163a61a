//! The model that a run learned, to plan with: its equation, or the black box that is in the place of it.

use anyhow::Result;
use tch::Tensor;

use super::model::{PlanningModel, of_cell, row};
use super::plans::{Plans, Trajectories};
use super::state::ControlState;
use paig::network::cells::Actions;
use paig::network::dynamics::BlackBox;
use paig::network::physics_models::PhysicsNet;

/// What a net foretells by, with its parameters as they are now.
pub fn of_net(net: &PhysicsNet) -> Box<dyn PlanningModel + '_> {
    match &net.black_box {
        Some(network) => {
            let (look_back, dt) = (net.system.input_steps - 1, net.system.dt);
            Box::new(BlackBoxModel { network, look_back, dt })
        }
        None => of_cell(net.cell.as_ref(), net.system.dt),
    }
}

/// A network that carries positions on, all candidates in one batch of tensors.
#[derive(Debug)]
pub struct BlackBoxModel<'a> {
    pub network: &'a BlackBox,
    /// Frames before the state's that it takes in.
    pub look_back: usize,
    /// Time units between two frames.
    pub dt: f64,
}

impl BlackBoxModel<'_> {
    /// What the network keeps of the frames before a state. Where they are not known nothing acted, and what is controlled
    /// moved evenly.
    fn memory(&self, state: &ControlState) -> Vec<Tensor> {
        let known = &state.before[state.before.len().saturating_sub(self.look_back)..];
        let missing = self.look_back - known.len();
        let first = known.first().map_or(&state.positions, |moment| &moment.positions);
        let (mut positions, mut actions) = (Vec::new(), Vec::new());
        for ago in (1..=missing).rev() {
            let even = |(at, rate): (&f64, &f64)| at - rate * self.dt * ago as f64;
            positions.extend(first.iter().zip(&state.velocities).map(even));
            actions.push(0.0);
        }
        for moment in known {
            positions.extend(&moment.positions);
            actions.push(moment.action);
        }
        let shape = [1, self.look_back as i64, state.coordinates() as i64];
        self.network.remember(&row(&positions).reshape(shape), &Actions::new(Some(row(&actions).unsqueeze(0))))
    }
}

impl PlanningModel for BlackBoxModel<'_> {
    fn roll_out(&mut self, start: &ControlState, plans: &Plans, into: &mut Trajectories) -> Result<()> {
        let _guard = tch::no_grad_guard();
        let candidates = plans.candidates as i64;
        // All begin with one memory.
        let mut memory: Vec<Tensor> =
            self.memory(start).iter().map(|part| part.expand([candidates, -1], false)).collect();
        let mut positions = row(&start.positions).expand([candidates, -1], false);
        let actions = Tensor::from_slice(plans.actions).reshape([-1, candidates, 1]);
        into.make_room(plans.candidates, start.coordinates(), plans.steps());
        for step in 0..plans.steps() {
            let acting = actions.get((step / plans.hold) as i64);
            let state = self.network.step(&mut memory, &positions, Some(acting));
            into.write(step, &state)?;
            positions = state.pos;
        }
        Ok(())
    }
}
