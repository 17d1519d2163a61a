//! Roll-outs of an equation over a whole video, one state at a time.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::Result;
use tch::{Kind, Tensor};

use paig::network::System;
use paig::network::cells::text::{Ensemble, Equation, EquationTable, SingleEquation};
use paig::network::cells::{Cell, Coordinates, Integrator, State};

/// Moves a state on from a time by a step.
type Advance = Box<dyn FnMut(&mut Vec<f64>, f64, f64)>;

/// An equation, ready to be rolled out from frame to frame of a film.
#[derive(Debug, Clone)]
pub struct Dynamics {
    pub system: System,
    /// Time between two frames of the film, in the unit of the system's `dt`.
    pub dt: f64,
    /// The equation as text, by the method of Runge and Kutta; none of one that has no text.
    exact: Option<Arc<Equation>>,
}

impl Dynamics {
    /// The equation of `system` with `dt` from frame to frame of the film. What was filmed went on between the frames: Euler's
    /// steps, by which the original learns, would be off by more than the positions are over a long video.
    ///
    /// # Errors
    /// None that the equation itself did not have.
    pub fn new(system: System, dt: f64) -> Result<Self> {
        let exact = system.cell.table().map(|table| Equation::read(&finely(table), system.objects)).transpose()?;
        Ok(Dynamics { system, dt, exact: exact.map(Arc::new) })
    }

    /// Numbers in the positions of all objects.
    pub fn coordinates(&self) -> usize {
        self.system.coordinates()
    }

    /// The values of all parameters from the unconstrained ones.
    pub fn values(&self, unconstrained: &[f64]) -> Vec<f64> {
        self.system
            .cell
            .parameters
            .iter()
            .zip(unconstrained)
            .map(|(parameter, unconstrained)| parameter.bounds.value(*unconstrained))
            .collect()
    }

    /// States at these times, each positions and then velocities; the first is `initial`. Times are in the unit of `dt` and
    /// ascend; at most `dt` is integrated at once. `unconstrained` has all unconstrained parameters. Nothing acts from outside.
    pub fn roll_out(&self, unconstrained: &[f64], initial: &[f64], times: &[f64]) -> Vec<f64> {
        let mut advance: Advance = match &self.exact {
            Some(equation) => {
                // A text's parameters are sorted by name.
                let own = self.system.cell.parameters.iter();
                let named: BTreeMap<_, _> =
                    own.map(|parameter| &*parameter.name).zip(self.values(unconstrained)).collect();
                let values: Vec<f64> = equation.parameters().iter().map(|parameter| named[&*parameter.name]).collect();
                let mut single = SingleEquation::new(equation, &values, self.system.walls);
                Box::new(move |state, time, dt| single.advance(state, time, dt))
            }
            None => {
                let unconstrained = unconstrained.iter().take(self.system.cell.parameters.len());
                let cell = self
                    .system
                    .build_cell(&unconstrained.map(|unconstrained| Tensor::from(*unconstrained)).collect::<Vec<_>>());
                Box::new(move |state, _, dt| *state = by_tensors(&*cell, state, dt))
            }
        };
        let mut state = initial.to_vec();
        let mut states = Vec::with_capacity(times.len() * initial.len());
        for (place, time) in times.iter().enumerate() {
            if let Some(before) = place.checked_sub(1).map(|before| times[before]) {
                self.steps(before, *time).for_each(|(time, step)| advance(&mut state, time, step));
            }
            states.extend(&state);
        }
        states
    }

    /// Positions of several motions at these times, each from its own unconstrained parameters and its own state at the first.
    pub fn ensemble(&self, motions: &[(Vec<f64>, Vec<f64>)], times: &[f64]) -> Vec<Vec<f64>> {
        let Some(equation) = &self.exact else {
            return motions
                .iter()
                .map(|(unconstrained, initial)| self.positions(unconstrained, initial, times))
                .collect();
        };
        let size = motions.len();
        let values: Vec<Vec<f64>> = motions.iter().map(|(unconstrained, _)| self.values(unconstrained)).collect();
        let columns = equation.parameters().iter().map(|parameter| {
            let place = self.place(&parameter.name);
            values.iter().map(|values| values[place]).collect()
        });
        let mut ensemble = Ensemble::new(equation, columns.collect(), self.system.walls, size);
        let states: Vec<&[f64]> = motions.iter().map(|(_, state)| state.as_slice()).collect();
        let [mut pos, mut vel] = self.side_by_side(&states);
        let mut positions = vec![Vec::with_capacity(times.len() * self.coordinates()); size];
        for (place, time) in times.iter().enumerate() {
            if let Some(before) = place.checked_sub(1).map(|before| times[before]) {
                for (time, step) in self.steps(before, *time) {
                    ensemble.advance(&mut pos, &mut vel, &vec![time; size], step);
                }
            }
            for row in pos.chunks(size) {
                positions.iter_mut().zip(row).for_each(|(positions, x)| positions.push(*x));
            }
        }
        positions
    }

    /// Accelerations in states at times of their own, from what a time `instant` adds to the velocities; without those by surfaces and
    /// strings, which depend on a gap that is less than the noise.
    pub fn accelerations(
        &self,
        unconstrained: &[f64],
        states: &[&[f64]],
        times: &[f64],
        instant: f64,
    ) -> Vec<Vec<f64>> {
        let coordinates = self.coordinates();
        let gained = |before: &[f64], after: &dyn Fn(usize) -> f64| -> Vec<f64> {
            (0..coordinates).map(|row| (after(row) - before[coordinates + row]) / instant).collect()
        };
        let Some(equation) = &self.exact else {
            let of_state = |(state, time): (&&[f64], &f64)| {
                let rolled = self.roll_out(unconstrained, state, &[*time, *time + instant]);
                gained(state, &|row| rolled[3 * coordinates + row])
            };
            return states.iter().zip(times).map(of_state).collect();
        };
        let values = self.values(unconstrained);
        let columns = equation.parameters().iter().map(|parameter| vec![values[self.place(&parameter.name)]]);
        let ensemble = Ensemble::new(equation, columns.collect(), self.system.walls, states.len());
        let [mut pos, mut vel] = self.side_by_side(states);
        ensemble.in_free_motion().advance(&mut pos, &mut vel, times, instant);
        let of_state = |(place, state): (usize, &&[f64])| gained(state, &|row| vel[row * states.len() + place]);
        states.iter().enumerate().map(of_state).collect()
    }

    /// Place of a parameter among the system's; a text's own are sorted by name.
    fn place(&self, name: &str) -> usize {
        let place = self.system.cell.parameters.iter().position(|parameter| parameter.name == name);
        place.expect("a text has the parameters of the equation that it writes")
    }

    /// Positions and velocities of states, `[coordinates, states]` each.
    fn side_by_side(&self, states: &[&[f64]]) -> [Vec<f64>; 2] {
        let coordinates = self.coordinates();
        [0, coordinates]
            .map(|first| (0..coordinates).flat_map(|row| states.iter().map(move |state| state[first + row])).collect())
    }

    /// Beginnings and lengths of the steps from one time to another.
    fn steps(&self, from: f64, to: f64) -> impl Iterator<Item = (f64, f64)> {
        // Rounding of a time makes no further step.
        let count = ((to - from) / self.dt - 1e-6).ceil().max(1.0);
        let step = (to - from) / count;
        (0..count as usize).map(move |number| (from + number as f64 * step, step))
    }

    /// Times of `frames` frames at even intervals of `dt`, from 0 on.
    pub fn even_times(&self, frames: usize) -> Vec<f64> {
        (0..frames).map(|frame| frame as f64 * self.dt).collect()
    }

    /// How many unconstrained numbers behind the parameters' say by how much what is seen lies beside the state: see
    /// [`Dynamics::beside`].
    pub(super) fn numbers_beside(&self) -> usize {
        match (self.system.cell.coordinates, self.system.objects) {
            (Coordinates::Angle, _) => 0,
            (Coordinates::Position, 1) => 2,
            (Coordinates::Position, objects) => 2 * (objects - 1),
        }
    }

    /// By how much a coordinate of what is seen lies beside the state's at a time, if unconstrained numbers stand for it.
    /// One object drifts with the camera, by so much in a unit of `dt`. Of several each is seen so much more beside its
    /// middle than the first one: light falls from one side, or a sprite is not round.
    pub fn beside(&self, unconstrained: &[f64], time: f64, coordinate: usize) -> f64 {
        match self.system.objects {
            1 => self.drift(unconstrained, coordinate) * time,
            _ => coordinate.checked_sub(2).map_or(0.0, |place| self.number_beside(unconstrained, place)),
        }
    }

    /// By how much that grows in a unit of `dt`.
    pub fn drift(&self, unconstrained: &[f64], coordinate: usize) -> f64 {
        if self.system.objects == 1 { self.number_beside(unconstrained, coordinate) } else { 0.0 }
    }

    /// One of the unconstrained numbers behind the parameters'; 0 where it does not stand.
    fn number_beside(&self, unconstrained: &[f64], place: usize) -> f64 {
        unconstrained.get(self.system.cell.parameters.len() + place).copied().unwrap_or(0.0)
    }

    /// Value of an unconstrained number: a parameter, or what is seen beside the state.
    pub(super) fn name(&self, place: usize) -> String {
        let parameters = &self.system.cell.parameters;
        let Some(beside) = place.checked_sub(parameters.len()) else { return parameters[place].name.to_string() };
        let axis = ["x", "y"][beside % 2];
        match self.system.objects {
            1 => format!("drift_of_what_is_seen_{axis}"),
            _ => format!("object_{}_seen_beside_{axis}", beside / 2 + 2),
        }
    }

    /// Whether something turns the objects back: the frame's edges, or walls, surfaces and strings that the equation names.
    pub(super) fn has_walls(&self) -> bool {
        let exact = self.exact.as_ref();
        exact.map_or(self.system.cell.walls, |equation| equation.table().has_obstacles())
    }

    /// The positions alone, frame by frame.
    pub fn positions(&self, unconstrained: &[f64], initial: &[f64], times: &[f64]) -> Vec<f64> {
        let states = self.roll_out(unconstrained, initial, times);
        states.chunks(initial.len()).flat_map(|state| &state[..state.len() / 2]).copied().collect()
    }
}

/// The state a time `dt` later.
fn by_tensors(cell: &dyn Cell, state: &[f64], dt: f64) -> Vec<f64> {
    let _guard = tch::no_grad_guard();
    let state = State::from_joined(&Tensor::from_slice(state).unsqueeze(0));
    cell.step(&state, None, dt).joined().to_kind(Kind::Double).flatten(0, 1).try_into().expect("float64 numbers")
}

/// The same equation by the method of Runge and Kutta. A step of it is as exact as many of Euler's; what bounces keeps its
/// steps, at whose ends walls are looked for.
fn finely(table: EquationTable) -> EquationTable {
    let few = table.integrator == Integrator::Euler && !table.has_obstacles();
    let substeps = if few { table.substeps.div_ceil(2) } else { table.substeps };
    EquationTable { integrator: Integrator::Rk4, substeps, ..table }
}

#[cfg(test)]
mod tests {
    use super::*;
    use paig::tasks;

    #[test]
    fn walls_are_those_of_the_frame_and_those_that_are_named() {
        let has_walls = |system: System| Dynamics::new(system, 0.1).unwrap().has_walls();
        assert!(has_walls(tasks::builtin("bouncing_balls").unwrap().system));
        let of_text = |text: &str| has_walls(tasks::Task::from_toml(text).unwrap().system);
        assert!(of_text(include_str!("../../../../configs/gallery/bounce_on_a_floor.toml")));
        assert!(!of_text(include_str!("../../../../configs/gallery/swing.toml")));
    }
}
