//! Integration of an equation in plain numbers: many states at a time for planning, or one for long roll-outs, where a tensor
//! of a few numbers costs a hundred times the arithmetic.

use std::sync::Arc;

use super::columns::{Columns, Moment, Number};
use super::contacts::Contacts;
use super::equation::Equation;
use super::walls::TextWalls;
use crate::network::cells::impact::{LEAST_RESTITUTION, Single, turned_back};
use crate::network::cells::integrands::{NumberRow, OnRows};
use crate::network::cells::plain::PlainCell;
use crate::network::cells::state::Walls;
use crate::network::cells::unilateral::{Support, UnilateralConstraints, holds_any};

/// An equation with the values (not the unconstrained parameters) of its parameters. States stand side by side, positions
/// and velocities `[coordinates * objects, batch]` each.
#[derive(Debug)]
pub(super) struct PlainText<F> {
    equation: Arc<Equation>,
    columns: Columns<F>,
    /// Where balls turn back, near and far on each axis, and what is left of their speed, for all states or for each; none
    /// without walls.
    walls: Option<Vec<([[F; 2]; 2], F)>>,
    /// Rows for what is computed on the way.
    spare: Vec<Vec<F>>,
    /// Contacts, for all states or for each; none without.
    contacts: Option<Vec<Contacts<Single<F>>>>,
    /// Surfaces and strings, for all states or for each; none without.
    constraints: Option<Vec<UnilateralConstraints<Single<F>>>>,
    /// Positions and velocities where a substep begins, for walls and contacts.
    before: [Vec<F>; 2],
}

impl<F: Number> PlainText<F> {
    /// Of each parameter one value for all states.
    pub(super) fn new(equation: &Arc<Equation>, parameters: Vec<F>, walls: Walls) -> Self {
        Self::of_each(equation, parameters.into_iter().map(|value| vec![value]).collect(), walls)
    }

    /// Of each parameter one value for all states, or one for each.
    fn of_each(equation: &Arc<Equation>, parameters: Vec<Vec<F>>, walls: Walls) -> Self {
        let width = parameters.iter().map(Vec::len).max().unwrap_or(1);
        let value = |state: usize, place: usize| {
            let values = &parameters[place];
            values[state.min(values.len() - 1)].to_f64().unwrap_or(f64::NAN)
        };
        let of_state = |standing: &TextWalls, state: usize| {
            let value = |place: usize| value(state, place);
            (standing.places(walls, value).map(|axes| axes.map(F::of)), F::of(standing.left(value)))
        };
        let walls = equation.walls.as_ref().map(|standing| (0..width).map(|state| of_state(standing, state)).collect());
        let contacts = equation.contacts.as_ref().map(|contacts| {
            (0..width).map(|state| contacts.numbers(equation.objects(), |place| value(state, place))).collect()
        });
        let constraints = equation
            .constraints
            .as_ref()
            .map(|constraints| (0..width).map(|state| constraints.numbers(|place| value(state, place))).collect());
        let columns = Columns::new(&equation.program, equation.table.state.per_object(), parameters);
        PlainText {
            equation: equation.clone(),
            columns,
            walls,
            contacts,
            constraints,
            spare: Vec::new(),
            before: Default::default(),
        }
    }

    /// All states a time `dt` later, one frame. `held` is what the dataset holds for the frame, `[batch]`.
    fn frame(&mut self, pos: &mut [F], vel: &mut [F], held: &[F], dt: F) {
        let substeps = self.equation.table.substeps;
        let h = dt / F::of(substeps as f64);
        for substep in 0..substeps {
            self.substep(pos, vel, (held, F::of(substep as f64) * h), h);
        }
    }

    /// All states a time `h` later, in one step between walls and contacts; `at` is what is held for a frame, and the time since then.
    fn substep(&mut self, pos: &mut [F], vel: &mut [F], at: (&[F], F), h: F) {
        let batch = at.0.len();
        self.columns.make_room(batch);
        if self.walls.is_none() && self.contacts.is_none() && self.constraints.is_none() {
            return self.integrate(pos, vel, at, h, &[]);
        }
        let supports = self.support(pos, vel, at, h);
        for (before, now) in self.before.iter_mut().zip([&*pos, &*vel]) {
            before.clear();
            before.extend_from_slice(now);
        }
        self.integrate(pos, vel, at, h, &supports);
        self.collide(pos, vel, h, batch);
        self.rebound(pos, vel, &supports, h);
        self.turn_back(pos, vel, h, batch);
    }

    /// Lets objects recoil that touched in a time `h`.
    fn collide(&self, pos: &mut [F], vel: &mut [F], h: F, batch: usize) {
        let Some(contacts) = &self.contacts else { return };
        let h = h.to_f64().unwrap_or(f64::NAN);
        for state in 0..batch {
            let before = self.before.each_ref().map(|values| of_state(values, state, batch));
            let [mut own_pos, mut own_vel] = [&*pos, &*vel].map(|values| of_state(values, state, batch));
            let contacts = &contacts[state.min(contacts.len() - 1)];
            contacts.after(before.each_ref().map(Vec::as_slice), [&mut own_pos, &mut own_vel], h);
            write_state(pos, own_pos, state, batch);
            write_state(vel, own_vel, state, batch);
        }
    }

    /// Puts to rest what rests on a constraint for a time `h`, of each state; nothing without constraints.
    fn support(&mut self, pos: &mut [F], vel: &mut [F], (held, since): (&[F], F), h: F) -> Vec<Supports<F>> {
        let PlainText { equation, columns, constraints: Some(constraints), .. } = self else { return Vec::new() };
        let batch = held.len();
        let h = h.to_f64().unwrap_or(f64::NAN);
        let mut acceleration = vec![F::zero(); pos.len()];
        accelerations(equation, columns, &Moment { pos, vel, held, since }, &mut acceleration);
        let supported = |state: usize| {
            let [mut own_pos, mut own_vel] = [&*pos, &*vel].map(|values| of_state(values, state, batch));
            let constraints = &constraints[state.min(constraints.len() - 1)];
            let mut own = of_state(&acceleration, state, batch);
            let supports = constraints.support([&mut own_pos, &mut own_vel], &mut own, h);
            write_state(pos, own_pos, state, batch);
            write_state(vel, own_vel, state, batch);
            supports
        };
        (0..batch).map(supported).collect()
    }

    /// Impacts on constraints in a time `h`.
    fn rebound(&self, pos: &mut [F], vel: &mut [F], supports: &[Supports<F>], h: F) {
        let Some(constraints) = &self.constraints else { return };
        let (batch, h) = (supports.len(), h.to_f64().unwrap_or(f64::NAN));
        for (state, supports) in supports.iter().enumerate() {
            let before = self.before.each_ref().map(|values| of_state(values, state, batch));
            let [mut own_pos, mut own_vel] = [&*pos, &*vel].map(|values| of_state(values, state, batch));
            let constraints = &constraints[state.min(constraints.len() - 1)];
            constraints.rebound(before.each_ref().map(Vec::as_slice), [&mut own_pos, &mut own_vel], supports, h);
            write_state(pos, own_pos, state, batch);
            write_state(vel, own_vel, state, batch);
        }
    }

    /// `begin` is the time since the frame.
    fn integrate(&mut self, pos: &mut [F], vel: &mut [F], (held, begin): (&[F], F), h: F, supports: &[Supports<F>]) {
        let PlainText { equation, columns, constraints, spare, .. } = self;
        let accelerate = |pos: &[F], vel: &[F], since: F, into: &mut [F]| {
            accelerations(equation, columns, &Moment { pos, vel, held, since: begin + since }, into);
            for (state, supports) in supports.iter().enumerate().filter(|(_, supports)| holds_any(supports)) {
                let all = constraints.as_deref().unwrap_or_default();
                let [own_pos, own_vel] = [pos, vel].map(|values| of_state(values, state, held.len()));
                let mut own = of_state(into, state, held.len());
                all[state.min(all.len() - 1)].hold([&own_pos, &own_vel], &mut own, supports);
                write_state(into, own, state, held.len());
            }
        };
        let state = [NumberRow::Lent(pos), NumberRow::Lent(vel)];
        equation.table.integrator.step(&mut OnRows { accelerate, spare }, state, h);
    }

    /// Turns back what has passed a wall in a time `h`, with what is left of its speed. Coordinates stand one after the other,
    /// each for all states of the `batch`.
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
            if *x > far || *x < near || x.is_nan() {
                let [before, now] = [[from, speed], [&*x, &*v]].map(|state| state.map(|number| Single(*number)));
                let walls = [Single(near), Single(far)];
                let turned = turned_back(before.each_ref(), now.each_ref(), walls.each_ref(), Some(&Single(left)));
                [*x, *v] = turned.map(|number| number.0);
            }
        }
    }
}

/// What rests of one state.
type Supports<F> = Vec<Support<Single<F>>>;

/// The numbers of one of `batch` states that stand side by side.
fn of_state<F: Number>(values: &[F], state: usize, batch: usize) -> Vec<Single<F>> {
    values.iter().skip(state).step_by(batch).map(|number| Single(*number)).collect()
}

fn write_state<F: Number>(values: &mut [F], own: Vec<Single<F>>, state: usize, batch: usize) {
    values.iter_mut().skip(state).step_by(batch).zip(own).for_each(|(value, number)| *value = number.0);
}

/// The accelerations of all states.
fn accelerations<F: Number>(equation: &Equation, columns: &mut Columns<F>, at: &Moment<F>, into: &mut [F]) {
    let (places, coordinates) = (&equation.program.accelerations, equation.table.state.per_object());
    columns.compute_moving(at);
    for (number, into) in into.chunks_exact_mut(at.held.len()).enumerate() {
        let (object, coordinate) = (number / coordinates, number % coordinates);
        // One for all objects, or one of each.
        let place = if places.len() == 1 { places[0] } else { places[object] };
        into.copy_from_slice(columns.column(place, object, coordinate));
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
    /// The equation with these values (not the unconstrained parameters) of its parameters.
    pub fn new(equation: &Arc<Equation>, parameters: &[f64], walls: Walls) -> Self {
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
    /// The equation with these values (not the unconstrained parameters) of its parameters: one for all of the `size`
    /// states, or one for each.
    pub fn new(equation: &Arc<Equation>, parameters: Vec<Vec<f64>>, walls: Walls, size: usize) -> Self {
        Ensemble { plain: PlainText::of_each(equation, parameters, walls), nothing: vec![0.0; size] }
    }

    /// The same without surfaces and strings.
    pub fn in_free_motion(mut self) -> Self {
        self.plain.constraints = None;
        self
    }

    /// Moves all states on by one frame of `dt` that begins at the time `times` has for each: positions and velocities of all
    /// objects, `[coordinates * objects, size]` each. Nothing acts from outside.
    pub fn advance(&mut self, pos: &mut [f64], vel: &mut [f64], times: &[f64], dt: f64) {
        let held = if self.plain.equation.tells_time() { times } else { &self.nothing };
        self.plain.frame(pos, vel, held, dt);
    }
}
