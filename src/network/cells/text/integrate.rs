//! Integration of an equation that stands as text.

use std::sync::Arc;

use tch::Tensor;

use super::equation::Equation;
use super::evaluate::{Constants, Instant};
use super::plain::PlainText;
use super::walls::{LEAST_RESTITUTION, TextWalls};
use crate::network::cells::actions::Actions;
use crate::network::cells::cell::Cell;
use crate::network::cells::impact::turned_back;
use crate::network::cells::integrands::OnTensors;
use crate::network::cells::plain::PlainCell;
use crate::network::cells::state::{State, Walls};

/// An equation with its parameters.
#[derive(Debug)]
pub struct TextCell {
    equation: Arc<Equation>,
    /// Scalars, in the order of the equation's parameters.
    raw: Vec<Tensor>,
    walls: Walls,
}

/// A roll-out under way.
struct Run<'a> {
    cell: &'a TextCell,
    constants: Constants,
    barrier: Option<Barrier>,
}

/// The walls with the parameters as they are now.
struct Barrier {
    /// Near and far ones, `[2]` each or one number for both axes.
    places: [Tensor; 2],
    /// What they leave of a speed; none for all of it.
    left: Option<Tensor>,
}

/// Positions and velocities, each `[batch, objects, coordinates]`.
struct Grid {
    pos: Tensor,
    vel: Tensor,
}

impl TextCell {
    /// The cell with these raw parameters (scalars, one for each).
    pub fn new(equation: &Arc<Equation>, raw: &[Tensor], walls: Walls) -> Self {
        TextCell { equation: equation.clone(), raw: raw.iter().map(Tensor::shallow_clone).collect(), walls }
    }

    fn begin(&self, state: &State) -> Run<'_> {
        let bounds = self.equation.parameters.iter().map(|parameter| parameter.bounds);
        let parameters: Vec<_> = bounds.zip(&self.raw).map(|(bounds, raw)| bounds.values(raw).reshape([1])).collect();
        let options = (state.pos.kind(), state.pos.device());
        let constants = self.equation.program.constants(&parameters, options);
        let barrier = |walls: &TextWalls| Barrier {
            places: walls.tensors(self.walls, &parameters, options),
            left: walls.left_tensor(&parameters, options),
        };
        Run { cell: self, constants, barrier: self.equation.walls.as_ref().map(barrier) }
    }

    fn grid(&self, state: &State) -> Grid {
        let shape = [-1, self.equation.program.objects as i64, self.equation.table.state.per_object() as i64];
        Grid { pos: state.pos.reshape(shape), vel: state.vel.reshape(shape) }
    }
}

impl Cell for TextCell {
    fn substep(&self, state: &State, action: Option<&Tensor>, h: f64) -> State {
        self.begin(state).go_on(self.grid(state), action, h, 1).state()
    }

    fn step(&self, state: &State, action: Option<&Tensor>, dt: f64) -> State {
        self.begin(state).frame(self.grid(state), action, dt).state()
    }

    fn roll_out(&self, initial: &State, actions: &Actions, dt: f64, frames: usize) -> Vec<State> {
        let run = self.begin(initial);
        let mut grid = self.grid(initial);
        let mut states = Vec::with_capacity(frames);
        let mut held = None;
        for frame in 0..frames {
            held = match actions.at(frame) {
                // The clock goes on where the dataset ends; without one it begins at 0.
                None if self.equation.program.tells_time() => {
                    Some(held.map_or_else(|| run.constants.zero(), |time| time + dt))
                }
                known => known,
            };
            grid = run.frame(grid, held.as_ref(), dt);
            states.push(grid.state());
        }
        states
    }

    fn plain(&self) -> Option<Box<dyn PlainCell>> {
        if self.equation.program.objects > 1 || self.equation.tells_time() {
            return None;
        }
        let bounds = self.equation.parameters.iter().map(|parameter| parameter.bounds);
        let values = bounds.zip(&self.raw).map(|(bounds, raw)| bounds.value(raw.double_value(&[])) as f32);
        Some(Box::new(PlainText::new(&self.equation, values.collect(), self.walls)))
    }

    fn plain_double(&self) -> Option<Box<dyn PlainCell<f64>>> {
        let bounds = self.equation.parameters.iter().map(|parameter| parameter.bounds);
        let values = bounds.zip(&self.raw).map(|(bounds, raw)| bounds.value(raw.double_value(&[])));
        Some(Box::new(PlainText::new(&self.equation, values.collect(), self.walls)))
    }
}

impl Grid {
    /// `[batch, objects * coordinates]` each.
    fn state(&self) -> State {
        State { pos: self.pos.flatten(1, 2), vel: self.vel.flatten(1, 2) }
    }
}

impl Run<'_> {
    fn frame(&self, grid: Grid, held: Option<&Tensor>, dt: f64) -> Grid {
        let substeps = self.cell.equation.table.substeps;
        self.go_on(grid, held, dt / substeps as f64, substeps)
    }

    fn go_on(&self, mut grid: Grid, held: Option<&Tensor>, h: f64, substeps: usize) -> Grid {
        let held = held.map(|held| held.unsqueeze(-1));
        // Backwards a frame begins at its end.
        let begin = if h < 0.0 { -(substeps as f64) * h } else { 0.0 };
        let Equation { table, program, .. } = &*self.cell.equation;
        for substep in 0..substeps {
            let begin = begin + substep as f64 * h;
            let mut accelerated = OnTensors(|pos: &Tensor, vel: &Tensor, since: f64| {
                let at = Instant { pos, vel, held: held.as_ref(), since: begin + since };
                program.acceleration(&self.constants, &at)
            });
            let now = [&grid.pos, &grid.vel].map(Tensor::shallow_clone);
            let [pos, vel] = table.integrator.step(&mut accelerated, now, h);
            grid = self.turned_back(&grid, Grid { pos, vel }, h);
        }
        grid
    }

    /// The state after the walls have turned back what has passed them, each with what is left of its speed.
    fn turned_back(&self, before: &Grid, after: Grid, h: f64) -> Grid {
        let Some(Barrier { places: [near, far], left }) = &self.barrier else { return after };
        let gained = |left: &Tensor| left.clamp_min(LEAST_RESTITUTION).reciprocal();
        let left = left.as_ref().map(|left| if h < 0.0 { gained(left) } else { left.shallow_clone() });
        let [pos, vel] = turned_back([&before.pos, &before.vel], [&after.pos, &after.vel], [near, far], left.as_ref());
        Grid { pos, vel }
    }
}
