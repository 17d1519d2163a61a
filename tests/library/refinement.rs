//! State refinement: exact positions give the exact state, whatever the estimate, through bounces as well.

use crate::random::numbers;
use paig::network::cells::{Actions, BOUNCING, Cell, CellKind, PENDULUM, SPRING, State, Walls};
use paig::network::physics_models::refinement::refine;
use rand::Rng;
use tch::{Kind, Tensor};

const CLIPS: i64 = 400;
const INPUT: usize = 4;

fn build(kind: &CellKind, logs: &[Tensor]) -> Box<dyn Cell> {
    kind.cell(logs, Walls::new(32, 2.0))
}

fn uniform(purpose: &str, n: i64, low: f64, high: f64) -> Tensor {
    numbers(11, purpose, &[CLIPS, n], |random| random.random_range(low..high))
}

/// Share of the clips whose refined state at the last input frame is within `tolerance` of the truth.
fn share_found(cell: &dyn Cell, first: &State, actions: &Actions, dt: f64, tolerance: f64) -> f64 {
    let mut states = cell.roll_out(first, actions, dt, INPUT - 1);
    let mut positions = vec![first.pos.shallow_clone()];
    positions.extend(states.iter().map(|state| state.pos.shallow_clone()));
    let truth = states.pop().unwrap();
    // An estimate that knows nothing of the velocity.
    let estimate = State { pos: truth.pos.shallow_clone(), vel: truth.vel.zeros_like() };
    let refined = refine(cell, dt, &Tensor::stack(&positions, 1), actions, estimate, 3);
    let error = (refined.joined() - truth.joined()).abs().amax([1i64].as_slice(), false);
    error.le(tolerance).to_kind(Kind::Double).mean(Kind::Double).double_value(&[])
}

/// The paper's spring, and where its clips begin.
fn spring() -> (Box<dyn Cell>, State) {
    let logs = [4f64.ln(), 6f64.ln()].map(|log| Tensor::from(log).to_kind(Kind::Double));
    let apart = Tensor::from_slice(&[6.0, 0.0, -6.0, 0.0]);
    let first = State { pos: uniform("p", 4, 14.0, 18.0) + apart, vel: uniform("v", 4, -6.0, 6.0) };
    (build(&SPRING.kind(2), &logs), first)
}

#[test]
fn spring_states_are_found_from_positions_alone() {
    let (cell, first) = spring();
    // Damping 1e-2 against J^T J of order 1 leaves a thousandth of the first error, 6 px per unit, after three steps.
    let share = share_found(cell.as_ref(), &first, &Actions::none(), 0.3, 0.05);
    assert!(share > 0.98, "{share} of the states found");
}

/// The same clips with time in other units, as of a camera with 240 frames a second and in milliseconds.
#[test]
fn a_state_does_not_depend_on_the_unit_of_time() {
    let refined_by = |unit: f64| {
        let logs = [(4.0 / (unit * unit)).ln(), 6f64.ln()].map(|log| Tensor::from(log).to_kind(Kind::Double));
        let cell = build(&SPRING.kind(2), &logs);
        let (_, first) = spring();
        let (dt, first) = (0.3 * unit, State { pos: first.pos, vel: first.vel / unit });
        let mut states = cell.roll_out(&first, &Actions::none(), dt, INPUT - 1);
        let exact = Tensor::cat(&[first.pos.unsqueeze(1), State::positions(&states)], 1);
        // What an encoder leaves: a tenth of a pixel.
        let seen = exact + uniform("seen", INPUT as i64 * 4, -0.1, 0.1).reshape([CLIPS, INPUT as i64, 4]);
        let estimate = states.pop().unwrap();
        let refined =
            refine(cell.as_ref(), dt, &seen, &Actions::none(), State { vel: estimate.vel.zeros_like(), ..estimate }, 3);
        Tensor::cat(&[refined.pos, refined.vel * unit], 1)
    };
    let usual = refined_by(1.0);
    for unit in [1.0 / 72.0, 110.0] {
        let error = (refined_by(unit) - &usual).abs().max().double_value(&[]);
        // Float64 rounding, enlarged by difference quotients over 0.1.
        assert!(error < 1e-9, "in units of {unit} states differ by {error}");
    }
}

/// One frame shows both objects half-way between their places, as an encoder does that cannot tell them apart.
#[test]
fn a_frame_that_was_misread_does_not_spoil_the_state() {
    let (cell, first) = spring();
    let mut states = cell.roll_out(&first, &Actions::none(), 0.3, INPUT - 1);
    let seen: Vec<Tensor> = std::iter::once(&first.pos)
        .chain(states.iter().map(|state| &state.pos))
        .map(|pos| pos.shallow_clone())
        .collect();
    let positions = Tensor::stack(&seen, 1);
    let truth = states.pop().unwrap();
    for misread in 0..INPUT as i64 {
        let seen = positions.copy();
        let pair = positions.select(1, misread).reshape([CLIPS, 2, 2]);
        let middle = pair.mean_dim([1i64].as_slice(), true, Kind::Double).expand_as(&pair).reshape([CLIPS, 4]);
        seen.select(1, misread).copy_(&middle);
        let estimate = State { pos: seen.select(1, INPUT as i64 - 1), vel: truth.vel.zeros_like() };
        let refined = refine(cell.as_ref(), 0.3, &seen, &Actions::none(), estimate, 3);
        let error = (refined.pos - &truth.pos).abs().amax([1i64].as_slice(), false);
        // The middle is 6 px beside the balls' places or more; least squares would take over a third of that and more.
        let share = error.le(0.5).to_kind(Kind::Double).mean(Kind::Double).double_value(&[]);
        // Where the last frame was misread, the three before it tell less.
        let least = if misread + 1 < INPUT as i64 { 0.95 } else { 0.75 };
        assert!(share > least, "frame {misread}: {share} of the states found");
    }
}

#[test]
fn bounces_during_the_input_are_seen_through() {
    let cell = build(&BOUNCING.kind(2), &[]);
    let first = State { pos: uniform("p", 4, 2.5, 29.5), vel: uniform("v", 4, -8.0, 8.0) };
    let last = cell.roll_out(&first, &Actions::none(), 0.3, INPUT - 1).pop().unwrap();
    let bounced = (&first.vel * &last.vel).amin([1i64].as_slice(), false).lt(0.0).to_kind(Kind::Double);
    let bounced = bounced.mean(Kind::Double).double_value(&[]);
    assert!(bounced > 0.3, "only {bounced} of the clips bounce: the test would show nothing");
    // Left over are clips in which every pair of frames holds a bounce of one ball or the other.
    let share = share_found(cell.as_ref(), &first, &Actions::none(), 0.3, 0.05);
    assert!(share > 0.95, "{share} of the states found, while {bounced} of the clips bounce");
}

/// A time step of 0.05 and torques that differ from frame to frame.
#[test]
fn a_driven_pendulum_is_found_from_its_angles() {
    let logs = [10f64, 1.0].map(|value| Tensor::from(value.ln()).to_kind(Kind::Double));
    let cell = build(&PENDULUM.kind(1), &logs);
    let first = State { pos: uniform("p", 1, -3.0, 3.0), vel: uniform("v", 1, -4.0, 4.0) };
    let actions = Actions::new(Some(uniform("u", 3, -2.0, 2.0)));
    // As for the spring; the first error is 4 per time unit, a thousandth of it is left.
    let share = share_found(cell.as_ref(), &first, &actions, 0.05, 0.02);
    assert!(share > 0.98, "{share} of the states found");
}

/// Where one of the starts leaves the numbers, another is taken: with drag that grows with the square of the speed, a frame that
/// was misread by many pixels sends a start back in time to speeds without end.
#[test]
fn a_start_that_leaves_the_numbers_is_not_taken() {
    let text = "acceleration = \"vec(0, 1.5) - c * norm(v) * v\"\nparameters.c.unit = [-1, 0]";
    let kind = CellKind::of_text(&toml::from_str(text).unwrap(), 1).unwrap();
    let cell = build(&kind, &[Tensor::from(0.05f64.ln()).to_kind(Kind::Double)]);
    let seen = Tensor::from_slice(&[10.0, 8.0, 10.0, 10.0, 10.0, 12.0, 10.0, 26.0]).reshape([1, 4, 2]);
    let estimate = State { pos: seen.select(1, 3), vel: Tensor::from_slice(&[0.0, 6.0]).unsqueeze(0) };
    let refined = refine(cell.as_ref(), 0.3, &seen, &Actions::none(), estimate, 3);
    assert!(refined.joined().isfinite().all().int64_value(&[]) == 1, "{:?}", refined.joined());
}

/// Positions that are all shifted alike shift the state as much: the state learns from all of them, and so does the encoder.
#[test]
fn gradients_pass_to_all_positions() {
    let (cell, first) = spring();
    let mut states = cell.roll_out(&first, &Actions::none(), 0.3, INPUT - 1);
    let seen = Tensor::cat(&[first.pos.unsqueeze(1), State::positions(&states)], 1).set_requires_grad(true);
    let truth = states.pop().unwrap();
    let estimate = State { pos: truth.pos, vel: truth.vel };
    refine(cell.as_ref(), 0.3, &seen, &Actions::none(), estimate, 3).pos.sum(Kind::Double).backward();
    // Inner forces do not move the middle, of which a shift of one ball is half. The damping takes 0.2 % off.
    let shift = seen.grad().sum_dim_intlist([1i64].as_slice(), false, Kind::Double);
    let error = (shift - 1.0).abs().max().double_value(&[]);
    assert!(error < 0.01, "a shift of the positions shifts the state by {error} too much or too little");
}
