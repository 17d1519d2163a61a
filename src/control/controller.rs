//! Who decides the torque: by sight, or, as bounds of what sight can reach, by the truth or without any.

use std::fmt::{self, Debug, Formatter};

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use tch::Tensor;

use super::environment::{Environment, MAX_TORQUE};
use super::model::Model;
use super::search::Planner;
use super::vision::Vision;
use crate::support::random::named_generator;

/// A way to decide.
pub enum Controller<'a> {
    /// No torque at all.
    Zero,
    /// Any torque within the limits, all as likely.
    Random(Box<ChaCha8Rng>),
    /// Plans from the true state; with the true equation as its model, the bound of what sight can reach.
    TrueState { model: Box<dyn Model + 'a>, planner: Box<dyn Planner> },
    /// Plans from what is seen.
    Seeing { vision: Vision<'a>, model: Box<dyn Model + 'a>, planner: Box<dyn Planner> },
}

impl Debug for Controller<'_> {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        f.write_str(match self {
            Controller::Zero => "Zero",
            Controller::Random(_) => "Random",
            Controller::TrueState { .. } => "TrueState",
            Controller::Seeing { .. } => "Seeing",
        })
    }
}

/// What came of a decision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Decision {
    Torque(f64),
    /// Too few frames were seen yet.
    TooEarly,
    /// The pendulum is not seen, or its state is no number.
    Lost,
    /// The model foretells nothing.
    NoPlan,
}

impl Controller<'_> {
    pub fn random() -> Self {
        Controller::Random(Box::new(named_generator(0, "random torque")))
    }

    /// Begins an episode.
    pub fn begin(&mut self, seed: u64) {
        match self {
            Controller::Zero => {}
            Controller::Random(random) => **random = named_generator(seed, "random torque"),
            Controller::TrueState { planner, .. } | Controller::Seeing { planner, .. } => planner.begin(seed),
        }
    }

    /// Whether it looks at frames.
    pub fn sees(&self) -> bool {
        matches!(self, Controller::Seeing { .. })
    }

    /// Decides after these frames (`[channels, S, S]` each) of an episode and the torques between them.
    pub fn decide(&mut self, environment: &dyn Environment, frames: &[Tensor], torques: &[f64]) -> Decision {
        let plan =
            |planned: Option<f64>| planned.filter(|it| it.is_finite()).map_or(Decision::NoPlan, Decision::Torque);
        match self {
            Controller::Zero => Decision::Torque(0.0),
            Controller::Random(random) => Decision::Torque(MAX_TORQUE * (2.0 * random.random::<f64>() - 1.0)),
            Controller::TrueState { model, planner } => {
                plan(planner.plan(model.as_ref(), environment.true_state(), environment.reward()))
            }
            Controller::Seeing { vision, model, planner } => {
                let input = vision.input_frames();
                let Some(first) = frames.len().checked_sub(input) else { return Decision::TooEarly };
                match vision.state(&Tensor::stack(&frames[first..], 0), &torques[first..]) {
                    Some(state) => plan(planner.plan(model.as_ref(), state, environment.reward())),
                    None => Decision::Lost,
                }
            }
        }
    }
}
