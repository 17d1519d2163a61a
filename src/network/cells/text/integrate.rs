//! Integration of an equation that stands as text.

use std::sync::Arc;

use tch::Tensor;

use super::contacts::Contacts;
use super::equation::Equation;
use super::evaluate::{Constants, Instant};
use super::plain::PlainText;
use super::walls::TextWalls;
use crate::network::cells::actions::Actions;
use crate::network::cells::cell::Cell;
use crate::network::cells::impact::{LEAST_RESTITUTION, turned_back};
use crate::network::cells::integrands::OnTensors;
use crate::network::cells::plain::PlainCell;
use crate::network::cells::state::{State, Walls};
use crate::network::cells::unilateral::{Support, UnilateralConstraints, holds_any};

/// An equation with its parameters.
#[derive(Debug)]
pub struct TextCell {
    equation: Arc<Equation>,
    /// Scalars, in the order of the equation's parameters.
    unconstrained: Vec<Tensor>,
    walls: Walls,
}

/// A roll-out under way.
struct TextRollOut<'a> {
    cell: &'a TextCell,
    constants: Constants,
    barrier: Option<Barrier>,
    contacts: Option<Contacts<Tensor>>,
    constraints: Option<UnilateralConstraints<Tensor>>,
}

/// The walls with the parameters as they are now.
struct Barrier {
    /// Near and far ones, of each coordinate or one number for all.
    places: [Tensor; 2],
    /// What they leave of a speed; none for all of it.
    left: Option<Tensor>,
}

impl TextCell {
    /// The cell with these unconstrained parameters (scalars, one for each).
    pub fn new(equation: &Arc<Equation>, unconstrained: &[Tensor], walls: Walls) -> Self {
        TextCell {
            equation: equation.clone(),
            unconstrained: unconstrained.iter().map(Tensor::shallow_clone).collect(),
            walls,
        }
    }

    /// The values of the parameters, scalars.
    fn parameters(&self) -> Vec<Tensor> {
        let bounds = self.equation.parameters.iter().map(|parameter| parameter.bounds);
        bounds.zip(&self.unconstrained).map(|(bounds, unconstrained)| bounds.values(unconstrained)).collect()
    }

    /// The same as numbers.
    fn values(&self) -> Vec<f64> {
        let bounds = self.equation.parameters.iter().map(|parameter| parameter.bounds);
        bounds
            .zip(&self.unconstrained)
            .map(|(bounds, unconstrained)| bounds.value(unconstrained.double_value(&[])))
            .collect()
    }

    fn begin(&self, state: &State) -> TextRollOut<'_> {
        let (parameters, options) = (self.parameters(), (state.pos.kind(), state.pos.device()));
        let constants = self.equation.program.constants(&parameters, options);
        let barrier = |walls: &TextWalls| Barrier {
            places: walls.tensors(self.walls, &parameters, options).map(|place| match place.numel() {
                1 => place,
                _ => place.repeat([self.equation.program.objects as i64]),
            }),
            left: walls.left_tensor(&parameters, options),
        };
        let contacts = self.equation.contacts.as_ref();
        let contacts = contacts.map(|it| it.tensors(self.equation.program.objects, &parameters, options));
        let constraints = self.equation.constraints.as_ref().map(|it| it.tensors(&parameters, options));
        TextRollOut { cell: self, constants, barrier: self.equation.walls.as_ref().map(barrier), contacts, constraints }
    }
}

impl Cell for TextCell {
    fn substep(&self, state: &State, action: Option<&Tensor>, h: f64) -> State {
        self.begin(state).go_on(state, action, h, 1)
    }

    fn step(&self, state: &State, action: Option<&Tensor>, dt: f64) -> State {
        self.begin(state).frame(state, action, dt)
    }

    fn roll_out(&self, initial: &State, actions: &Actions, dt: f64, frames: usize) -> Vec<State> {
        let run = self.begin(initial);
        let mut states: Vec<State> = Vec::with_capacity(frames);
        let mut held = None;
        for frame in 0..frames {
            held = match actions.at(frame) {
                // The clock goes on where the dataset ends; without one it begins at 0.
                None if self.equation.program.tells_time() => {
                    Some(held.map_or_else(|| run.constants.zero(), |time| time + dt))
                }
                known => known,
            };
            let next = run.frame(states.last().unwrap_or(initial), held.as_ref(), dt);
            states.push(next);
        }
        states
    }

    fn plain(&self) -> Option<Box<dyn PlainCell>> {
        if self.equation.program.objects > 1 || self.equation.tells_time() {
            return None;
        }
        let values = self.values();
        if let Some(plan) = self.equation.plain.plan {
            return Some(plan(&values));
        }
        let values = values.into_iter().map(|value| value as f32).collect();
        Some(Box::new(PlainText::new(&self.equation, values, self.walls)))
    }

    fn plain_double(&self) -> Option<Box<dyn PlainCell<f64>>> {
        let values = self.values();
        if let Some(fit) = self.equation.plain.fit {
            return Some(fit(&values));
        }
        Some(Box::new(PlainText::new(&self.equation, values, self.walls)))
    }
}

impl TextRollOut<'_> {
    fn frame(&self, state: &State, held: Option<&Tensor>, dt: f64) -> State {
        let substeps = self.cell.equation.table.substeps;
        self.go_on(state, held, dt / substeps as f64, substeps)
    }

    fn go_on(&self, state: &State, held: Option<&Tensor>, h: f64, substeps: usize) -> State {
        // Backwards a frame begins at its end.
        let begin = if h < 0.0 { -(substeps as f64) * h } else { 0.0 };
        let Equation { table, program, renews_parameters, .. } = &*self.cell.equation;
        let [mut pos, mut vel] = [&state.pos, &state.vel].map(Tensor::shallow_clone);
        for substep in 0..substeps {
            let begin = begin + substep as f64 * h;
            let renewed = renews_parameters.then(|| program.renewed(&self.constants, &self.cell.parameters()));
            let constants = renewed.as_ref().unwrap_or(&self.constants);
            let acceleration = |pos: &Tensor, vel: &Tensor, since: f64| {
                let at = Instant { pos, vel, held, since: begin + since };
                program.acceleration(constants, &at)
            };
            let supports;
            ([pos, vel], supports) = self.supported([pos, vel], acceleration, h);
            let mut accelerated = OnTensors(|pos: &Tensor, vel: &Tensor, since: f64| {
                self.held(acceleration(pos, vel, since), [pos, vel], &supports)
            });
            let before = [&pos, &vel].map(Tensor::shallow_clone);
            let after = table.integrator.step(&mut accelerated, [pos, vel], h);
            let after = self.collided(&before, after, h);
            let after = self.rebounded(&before, after, &supports, h);
            [pos, vel] = self.turned_back(before, after, h);
        }
        State { pos, vel }
    }

    /// The state with what rests on a constraint at rest, and what does so.
    fn supported(
        &self,
        state: [Tensor; 2],
        acceleration: impl Fn(&Tensor, &Tensor, f64) -> Tensor,
        h: f64,
    ) -> ([Tensor; 2], Vec<Support<Tensor>>) {
        let Some(constraints) = &self.constraints else { return (state, Vec::new()) };
        let mut acceleration = acceleration(&state[0], &state[1], 0.0).unbind(1);
        let [mut pos, mut vel] = state.map(|state| state.unbind(1));
        let supports = constraints.support([&mut pos, &mut vel], &mut acceleration, h);
        ([Tensor::stack(&pos, 1), Tensor::stack(&vel, 1)], supports)
    }

    /// The acceleration less what constraints cancel.
    fn held(&self, acceleration: Tensor, state: [&Tensor; 2], supports: &[Support<Tensor>]) -> Tensor {
        let constraints = self.constraints.as_ref().filter(|_| holds_any(supports));
        let Some(constraints) = constraints else { return acceleration };
        let [pos, vel] = state.map(|state| state.unbind(1));
        let mut acceleration = acceleration.unbind(1);
        constraints.hold([&pos, &vel], &mut acceleration, supports);
        Tensor::stack(&acceleration, 1)
    }

    /// The state after impacts on constraints.
    fn rebounded(&self, before: &[Tensor; 2], after: [Tensor; 2], supports: &[Support<Tensor>], h: f64) -> [Tensor; 2] {
        let Some(constraints) = &self.constraints else { return after };
        let before = before.each_ref().map(|state| state.unbind(1));
        let [mut pos, mut vel] = after.map(|state| state.unbind(1));
        constraints.rebound(before.each_ref().map(Vec::as_slice), [&mut pos, &mut vel], supports, h);
        [Tensor::stack(&pos, 1), Tensor::stack(&vel, 1)]
    }

    /// The state after the objects that touched have recoiled.
    fn collided(&self, before: &[Tensor; 2], after: [Tensor; 2], h: f64) -> [Tensor; 2] {
        let Some(contacts) = &self.contacts else { return after };
        let columns = |state: &Tensor| state.unbind(1);
        let before = before.each_ref().map(columns);
        let [mut pos, mut vel] = after.each_ref().map(columns);
        let before = before.each_ref().map(Vec::as_slice);
        contacts.after(before, [&mut pos, &mut vel], h);
        [Tensor::stack(&pos, 1), Tensor::stack(&vel, 1)]
    }

    /// The state after the walls have turned back what has passed them, each with what is left of its speed.
    fn turned_back(&self, before: [Tensor; 2], after: [Tensor; 2], h: f64) -> [Tensor; 2] {
        let Some(Barrier { places: [near, far], left }) = &self.barrier else { return after };
        let gained = |left: &Tensor| left.clamp_min(LEAST_RESTITUTION).reciprocal();
        let left = left.as_ref().map(|left| if h < 0.0 { gained(left) } else { left.shallow_clone() });
        turned_back(before.each_ref(), after.each_ref(), [near, far], left.as_ref())
    }
}
