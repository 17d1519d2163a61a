//! Integration of an equation in plain numbers: many states at a time for planning, or one for long roll-outs, where a tensor
//! of a few numbers costs a hundred times the arithmetic.

use super::Equation;
use super::columns::{Columns, Moment, Number};
use super::table::Integrator;
use super::walls::{LEAST_RESTITUTION, TextWalls};
use crate::network::cells::Walls;
use crate::network::cells::plain::PlainCell;

/// An equation with the values (not the raw numbers) of its parameters. States stand side by side, positions and velocities
/// `[coordinates * objects, batch]` each.
#[derive(Debug)]
pub(super) struct PlainText<F> {
    equation: &'static Equation,
    columns: Columns<F>,
    /// Where balls turn back, near and far on each axis, and what is left of their speed, for all states or for each; none
    /// without walls.
    walls: Option<Vec<([[F; 2]; 2], F)>>,
    /// Columns of the integration's stages: position, velocity, acceleration, sums.
    stages: [Vec<F>; 5],
    /// Positions and velocities where a substep begins, for the walls.
    before: [Vec<F>; 2],
}

impl<F: Number> PlainText<F> {
    /// Of each parameter one value for all states.
    pub(super) fn new(equation: &'static Equation, parameters: Vec<F>, walls: Walls) -> Self {
        Self::of_each(equation, parameters.into_iter().map(|value| vec![value]).collect(), walls)
    }

    /// Of each parameter one value for all states, or one for each.
    fn of_each(equation: &'static Equation, parameters: Vec<Vec<F>>, walls: Walls) -> Self {
        let width = parameters.iter().map(Vec::len).max().unwrap_or(1);
        let of_state = |standing: &TextWalls, state: usize| {
            let value = |place: usize| {
                let values = &parameters[place];
                values[state.min(values.len() - 1)].to_f64().unwrap_or(f64::NAN)
            };
            (standing.places(walls, value).map(|axes| axes.map(F::of)), F::of(standing.left(value)))
        };
        let walls = equation.walls.as_ref().map(|standing| (0..width).map(|state| of_state(standing, state)).collect());
        let columns = Columns::new(&equation.program, equation.table.state.per_object(), parameters);
        PlainText { equation, columns, walls, stages: Default::default(), before: Default::default() }
    }

    /// All states a time `dt` later, one frame. `held` is what the dataset holds for the frame, `[batch]`.
    fn frame(&mut self, pos: &mut [F], vel: &mut [F], held: &[F], dt: F) {
        let substeps = self.equation.table.substeps;
        let h = dt / F::of(substeps as f64);
        for substep in 0..substeps {
            self.substep(pos, vel, (held, F::of(substep as f64) * h), h);
        }
    }

    /// All states a time `h` later, in one step between the walls; `at` is what is held for a frame, and the time since then.
    fn substep(&mut self, pos: &mut [F], vel: &mut [F], at: (&[F], F), h: F) {
        let batch = at.0.len();
        self.columns.make_room(batch);
        self.stages.iter_mut().for_each(|stage| stage.resize(pos.len(), F::zero()));
        if self.walls.is_none() {
            return self.integrate(pos, vel, at, h);
        }
        for (before, now) in self.before.iter_mut().zip([&*pos, &*vel]) {
            before.clear();
            before.extend_from_slice(now);
        }
        self.integrate(pos, vel, at, h);
        self.turn_back(pos, vel, h, batch);
    }

    fn integrate(&mut self, pos: &mut [F], vel: &mut [F], at: (&[F], F), h: F) {
        let half = F::of(0.5);
        match self.equation.table.integrator {
            Integrator::Euler => {
                self.accelerate(pos, vel, at, 0);
                add(vel, &self.stages[0], h);
                add(pos, vel, h);
            }
            Integrator::Verlet => {
                self.accelerate(pos, vel, at, 0);
                let [first, mut full] = [0, 1].map(|stage| std::mem::take(&mut self.stages[stage]));
                add(pos, vel, h);
                add(pos, &first, half * h * h);
                full.copy_from_slice(vel);
                add(&mut full, &first, h);
                self.accelerate(pos, &full, (at.0, at.1 + h), 2);
                add(vel, &first, half * h);
                add(vel, &self.stages[2], half * h);
                (self.stages[0], self.stages[1]) = (first, full);
            }
            Integrator::Rk4 => self.runge_kutta(pos, vel, at, h),
        }
    }

    fn runge_kutta(&mut self, pos: &mut [F], vel: &mut [F], (held, begin): (&[F], F), h: F) {
        let [mut p, mut v, mut sum_p, mut sum_v] = [1, 2, 3, 4].map(|stage| std::mem::take(&mut self.stages[stage]));
        p.copy_from_slice(pos);
        v.copy_from_slice(vel);
        sum_p.fill(F::zero());
        sum_v.fill(F::zero());
        let mut since = begin;
        for (weight, reach) in [(1.0, 0.5), (2.0, 0.5), (2.0, 1.0), (1.0, 0.0)] {
            self.accelerate(&p, &v, (held, since), 0);
            add(&mut sum_p, &v, F::of(weight));
            add(&mut sum_v, &self.stages[0], F::of(weight));
            // The next slope is where this one leads to.
            let reach = F::of(reach) * h;
            p.copy_from_slice(pos);
            add(&mut p, &v, reach);
            v.copy_from_slice(vel);
            add(&mut v, &self.stages[0], reach);
            since = begin + reach;
        }
        let sixth = h / F::of(6.0);
        add(pos, &sum_p, sixth);
        add(vel, &sum_v, sixth);
        (self.stages[1], self.stages[2], self.stages[3], self.stages[4]) = (p, v, sum_p, sum_v);
    }

    /// Writes the accelerations in a state into a stage; `held` at the frame, and the time since then.
    fn accelerate(&mut self, pos: &[F], vel: &[F], (held, since): (&[F], F), stage: usize) {
        self.columns.compute_moving(&Moment { pos, vel, held, since });
        let (places, coordinates) = (&self.equation.program.accelerations, self.equation.table.state.per_object());
        for (number, into) in self.stages[stage].chunks_exact_mut(held.len()).enumerate() {
            let (object, coordinate) = (number / coordinates, number % coordinates);
            // One for all objects, or one of each.
            let place = if places.len() == 1 { places[0] } else { places[object] };
            into.copy_from_slice(self.columns.column(place, object, coordinate));
        }
    }

    /// Turns back what has passed a wall in a time `h`, with what is left of its speed; what the force gave after the impact
    /// counts on the way back. Coordinates stand one after the other, each for all states of the `batch`.
    fn turn_back(&self, pos: &mut [F], vel: &mut [F], h: F, batch: usize) {
        let walls = self.walls.as_deref().unwrap_or_default();
        let before = self.before[0].iter().zip(&self.before[1]);
        for (place, ((x, v), (from, speed))) in pos.iter_mut().zip(vel).zip(before).enumerate() {
            let Some(&([near, far], left)) = walls.get((place % batch).min(walls.len().saturating_sub(1))) else {
                return;
            };
            // Back in time a wall gives what it took.
            let left = if h < F::zero() { left.max(F::of(LEAST_RESTITUTION)).recip() } else { left };
            let axis = place / batch % 2;
            let (near, far) = (near[axis], far[axis]);
            let wall = if *x > far { far } else { near };
            if *x <= far && *x >= near {
                continue;
            }
            let (beyond, way) = (*x - wall, *x - *from);
            let since = if way == F::zero() { beyond } else { beyond / way };
            let gained = (*v - *speed) * since.max(F::zero()).min(F::one());
            *v = gained - (*v - gained) * left;
            *x = wall - beyond * left;
        }
    }
}

impl<F: Number> PlainCell<F> for PlainText<F> {
    fn step(&mut self, positions: &mut [F], velocities: &mut [F], action: &[F], dt: F) {
        self.frame(positions, velocities, action, dt);
    }
}

/// An equation that moves one state on, in double precision.
#[derive(Debug)]
pub struct SingleEquation(PlainText<f64>);

impl SingleEquation {
    /// The equation with these values (not the raw numbers) of its parameters.
    pub(super) fn new(equation: &'static Equation, parameters: &[f64], walls: Walls) -> Self {
        SingleEquation(PlainText::new(equation, parameters.to_vec(), walls))
    }

    /// Moves a state on by a time `h` in one step. `held` acts meanwhile, or is the time at the beginning.
    pub fn substep(&mut self, pos: &mut [f64], vel: &mut [f64], held: f64, h: f64) {
        self.0.substep(pos, vel, (&[held], 0.0), h);
    }

    /// Moves a state, positions and then velocities of all objects, on by one frame of `dt` that begins at `time`. Nothing acts
    /// from outside.
    pub fn advance(&mut self, state: &mut [f64], time: f64, dt: f64) {
        let held = if self.0.equation.tells_time() { time } else { 0.0 };
        let (pos, vel) = state.split_at_mut(state.len() / 2);
        self.0.frame(pos, vel, &[held], dt);
    }
}

/// An equation that moves many states on side by side, each with parameters of its own, in double precision.
#[derive(Debug)]
pub struct Ensemble {
    plain: PlainText<f64>,
    /// What is held where nothing acts and the equation does not tell the time.
    nothing: Vec<f64>,
}

impl Ensemble {
    /// The equation with these values (not the raw numbers) of its parameters: one for all of the `size` states, or one for each.
    pub(super) fn new(equation: &'static Equation, parameters: Vec<Vec<f64>>, walls: Walls, size: usize) -> Self {
        Ensemble { plain: PlainText::of_each(equation, parameters, walls), nothing: vec![0.0; size] }
    }

    /// Moves all states on by one frame of `dt` that begins at the time `times` has for each: positions and velocities of all
    /// objects, `[coordinates * objects, size]` each. Nothing acts from outside.
    pub fn advance(&mut self, pos: &mut [f64], vel: &mut [f64], times: &[f64], dt: f64) {
        let held = if self.plain.equation.tells_time() { times } else { &self.nothing };
        self.plain.frame(pos, vel, held, dt);
    }
}

/// `to += by * times`.
fn add<F: Number>(to: &mut [F], by: &[F], times: F) {
    to.iter_mut().zip(by).for_each(|(to, by)| *to = *to + times * *by);
}
