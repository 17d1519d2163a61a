//! Roll-outs of an equation over a whole video, one state at a time.

use std::collections::BTreeMap;

use anyhow::Result;
use tch::{Kind, Tensor};

use paig::network::System;
use paig::network::cells::text::{self, EquationTable, Integrator, WallTable, written};
use paig::network::cells::{Build, Cell, CellKind, Coordinates, State};

/// Moves a state on from a time by a step.
type Advance = Box<dyn FnMut(&mut Vec<f64>, f64, f64)>;

/// An equation, ready to be rolled out from frame to frame of a film.
#[derive(Debug, Clone)]
pub struct Dynamics {
    pub system: System,
    /// Time between two frames of the film, in the unit of the system's `dt`.
    pub dt: f64,
    /// The equation as text, by the method of Runge and Kutta; none of one that has no text.
    exact: Option<&'static CellKind>,
}

impl Dynamics {
    /// The equation of `system` with `dt` from frame to frame of the film. What was filmed went on between the frames: Euler's
    /// steps, by which the original learns, would be off by more than the positions are over a long video.
    ///
    /// # Errors
    /// None that the equation itself did not have.
    pub fn new(system: System, dt: f64) -> Result<Self> {
        let table = match system.cell.build {
            Build::Text(equation) => Some(equation.table().clone()),
            Build::Rust(_) => written(system.cell),
        };
        let exact = table.map(|table| text::kind(&finely(table), system.objects)).transpose()?;
        Ok(Dynamics { system, dt, exact })
    }

    /// Numbers in the positions of all objects.
    pub fn coordinates(&self) -> usize {
        self.system.coordinates()
    }

    /// The values that raw numbers of all parameters stand for.
    pub fn values(&self, raw: &[f64]) -> Vec<f64> {
        self.system.cell.parameters.iter().zip(raw).map(|(parameter, raw)| parameter.bounds.value(*raw)).collect()
    }

    /// States at these times, each positions and then velocities; the first is `initial`. Times are in the unit of `dt` and
    /// ascend; at most `dt` is integrated at once. `raw` are the raw numbers of all parameters. Nothing acts from outside.
    pub fn roll_out(&self, raw: &[f64], initial: &[f64], times: &[f64]) -> Vec<f64> {
        let mut advance: Advance = match self.exact {
            Some(CellKind { build: Build::Text(equation), parameters, .. }) => {
                // A text's parameters are sorted by name.
                let own = self.system.cell.parameters.iter();
                let named: BTreeMap<_, _> = own.map(|parameter| parameter.name).zip(self.values(raw)).collect();
                let values: Vec<f64> = parameters.iter().map(|parameter| named[parameter.name]).collect();
                let mut single = equation.single(&values, self.system.walls);
                Box::new(move |state, time, dt| single.advance(state, time, dt))
            }
            _ => {
                let raw = raw.iter().take(self.system.cell.parameters.len());
                let cell = self.system.build_cell(&raw.map(|raw| Tensor::from(*raw)).collect::<Vec<_>>());
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

    /// Positions of several motions at these times, each from its own raw numbers and its own state at the first.
    pub fn ensemble(&self, motions: &[(Vec<f64>, Vec<f64>)], times: &[f64]) -> Vec<Vec<f64>> {
        let Some(CellKind { build: Build::Text(equation), parameters, .. }) = self.exact else {
            return motions.iter().map(|(raw, initial)| self.positions(raw, initial, times)).collect();
        };
        let size = motions.len();
        let values: Vec<Vec<f64>> = motions.iter().map(|(raw, _)| self.values(raw)).collect();
        let columns = parameters.iter().map(|parameter| {
            let place = self.place(parameter.name);
            values.iter().map(|values| values[place]).collect()
        });
        let mut ensemble = equation.ensemble(columns.collect(), self.system.walls, size);
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

    /// Accelerations in states at times of their own, from what a time `instant` adds to the velocities.
    pub fn accelerations(&self, raw: &[f64], states: &[&[f64]], times: &[f64], instant: f64) -> Vec<Vec<f64>> {
        let coordinates = self.coordinates();
        let gained = |before: &[f64], after: &dyn Fn(usize) -> f64| -> Vec<f64> {
            (0..coordinates).map(|row| (after(row) - before[coordinates + row]) / instant).collect()
        };
        let Some(CellKind { build: Build::Text(equation), parameters, .. }) = self.exact else {
            let of_state = |(state, time): (&&[f64], &f64)| {
                let rolled = self.roll_out(raw, state, &[*time, *time + instant]);
                gained(state, &|row| rolled[3 * coordinates + row])
            };
            return states.iter().zip(times).map(of_state).collect();
        };
        let values = self.values(raw);
        let columns = parameters.iter().map(|parameter| vec![values[self.place(parameter.name)]]);
        let mut ensemble = equation.ensemble(columns.collect(), self.system.walls, states.len());
        let [mut pos, mut vel] = self.side_by_side(states);
        ensemble.advance(&mut pos, &mut vel, times, instant);
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

    /// How many raw numbers behind the parameters' say by how much what is seen lies beside the state: see
    /// [`Dynamics::beside`].
    pub(super) fn numbers_beside(&self) -> usize {
        match (self.system.cell.coordinates, self.system.objects) {
            (Coordinates::Angle, _) => 0,
            (Coordinates::Position, 1) => 2,
            (Coordinates::Position, objects) => 2 * (objects - 1),
        }
    }

    /// By how much a coordinate of what is seen lies beside the state's at a time, if raw numbers stand for it. One object drifts
    /// with the camera, by so much in a unit of `dt`. Of several each is seen so much more beside its middle than the first
    /// one: light falls from one side, or a sprite is not round.
    pub fn beside(&self, raw: &[f64], time: f64, coordinate: usize) -> f64 {
        match self.system.objects {
            1 => self.drift(raw, coordinate) * time,
            _ => coordinate.checked_sub(2).map_or(0.0, |place| self.number_beside(raw, place)),
        }
    }

    /// By how much that grows in a unit of `dt`.
    pub fn drift(&self, raw: &[f64], coordinate: usize) -> f64 {
        if self.system.objects == 1 { self.number_beside(raw, coordinate) } else { 0.0 }
    }

    /// One of the raw numbers behind the parameters'; 0 where it does not stand.
    fn number_beside(&self, raw: &[f64], place: usize) -> f64 {
        raw.get(self.system.cell.parameters.len() + place).copied().unwrap_or(0.0)
    }

    /// What a raw number stands for: a parameter, or what is seen beside the state.
    pub(super) fn name(&self, place: usize) -> String {
        let parameters = self.system.cell.parameters;
        let Some(beside) = place.checked_sub(parameters.len()) else { return parameters[place].name.to_string() };
        let axis = ["x", "y"][beside % 2];
        match self.system.objects {
            1 => format!("drift_of_what_is_seen_{axis}"),
            _ => format!("object_{}_seen_beside_{axis}", beside / 2 + 2),
        }
    }

    /// Whether something turns the objects back: the frame's edges, or walls that the equation names.
    pub(super) fn has_walls(&self) -> bool {
        let cell = self.exact.unwrap_or(self.system.cell);
        match cell.build {
            Build::Text(equation) => equation.table().walls != WallTable::default(),
            Build::Rust(_) => cell.walls,
        }
    }

    /// The positions alone, frame by frame.
    pub fn positions(&self, raw: &[f64], initial: &[f64], times: &[f64]) -> Vec<f64> {
        let states = self.roll_out(raw, initial, times);
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
    let few = table.integrator == Integrator::Euler && table.walls == WallTable::default();
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
