//! Roll-outs of an equation over a whole video, one state at a time.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::Result;
use tch::{Kind, Tensor};

use paig::network::System;
use paig::network::cells::text::{Equation, EquationTable, SingleEquation, WallTable};
use paig::network::cells::{Actions, Coordinates, Integrator, State};

/// An equation, ready to be rolled out from frame to frame of a film.
#[derive(Debug, Clone)]
pub struct Dynamics {
    pub system: System,
    /// Time between two frames of the film, in the unit of the system's `dt`.
    pub(super) dt: f64,
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

    /// The values that raw numbers of all parameters stand for.
    pub fn values(&self, raw: &[f64]) -> Vec<f64> {
        self.system.cell.parameters.iter().zip(raw).map(|(parameter, raw)| parameter.bounds.value(*raw)).collect()
    }

    /// States of `frames` frames, each positions and then velocities, the initial one first: it is that of the frame
    /// `begin`. `raw` are the raw numbers of all parameters. Nothing acts from outside.
    pub fn roll_out(&self, raw: &[f64], initial: &[f64], begin: usize, frames: usize) -> Vec<f64> {
        let Some(equation) = &self.exact else { return self.by_tensors(raw, initial, frames) };
        // A text's parameters are sorted by name.
        let own = self.system.cell.parameters.iter();
        let named: BTreeMap<_, _> = own.map(|parameter| &*parameter.name).zip(self.values(raw)).collect();
        let values: Vec<f64> = equation.parameters().iter().map(|parameter| named[&*parameter.name]).collect();
        SingleEquation::new(equation, &values, self.system.walls).roll_out(
            initial,
            begin as f64 * self.dt,
            self.dt,
            frames,
        )
    }

    fn by_tensors(&self, raw: &[f64], initial: &[f64], frames: usize) -> Vec<f64> {
        let _guard = tch::no_grad_guard();
        let raw: Vec<_> = raw.iter().take(self.system.cell.parameters.len()).map(|raw| Tensor::from(*raw)).collect();
        let first = State::from_joined(&Tensor::from_slice(initial).unsqueeze(0));
        let rest = self.system.build_cell(&raw).roll_out(&first, &Actions::none(), self.dt, frames.saturating_sub(1));
        let states = std::iter::once(&first).chain(&rest).take(frames);
        let states: Vec<_> = states.map(State::joined).collect();
        Tensor::cat(&states, 0).to_kind(Kind::Double).flatten(0, 1).try_into().expect("float64 numbers")
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

    /// By how much a coordinate of what is seen lies beside the state's at a tick, if raw numbers stand for it. One object drifts
    /// with the camera, by so much in a unit of `dt`. Of several each is seen so much more beside its middle than the first
    /// one: light falls from one side, or a sprite is not round.
    pub fn beside(&self, raw: &[f64], tick: usize, coordinate: usize) -> f64 {
        match self.system.objects {
            1 => self.drift(raw, coordinate) * self.dt * tick as f64,
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
        let parameters = &self.system.cell.parameters;
        let Some(beside) = place.checked_sub(parameters.len()) else { return parameters[place].name.to_string() };
        let axis = ["x", "y"][beside % 2];
        match self.system.objects {
            1 => format!("drift_of_what_is_seen_{axis}"),
            _ => format!("object_{}_seen_beside_{axis}", beside / 2 + 2),
        }
    }

    /// Whether something turns the objects back: the frame's edges, or walls that the equation names.
    pub(super) fn has_walls(&self) -> bool {
        let exact = self.exact.as_ref();
        exact.map_or(self.system.cell.walls, |equation| equation.table().walls != WallTable::default())
    }

    /// The positions alone, frame by frame.
    pub fn positions(&self, raw: &[f64], initial: &[f64], begin: usize, frames: usize) -> Vec<f64> {
        let states = self.roll_out(raw, initial, begin, frames);
        states.chunks(initial.len()).flat_map(|state| &state[..state.len() / 2]).copied().collect()
    }
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
