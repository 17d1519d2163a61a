//! One episode: see, decide, act, sum the rewards.
//!
//! A controller that sees acts from the first decision on at which there are L frames; until then the torque is 0. With
//! L = 4 and torques that are held for two steps, that is for the first four steps.

use std::time::{Duration, Instant};

use tch::Tensor;

use super::controller::{Controller, Decision};
use super::environment::Environment;

/// What came of an episode.
#[derive(Debug, Default)]
pub struct Episode {
    /// The rewards of all steps.
    pub total: f64,
    /// What acted in each step.
    pub torques: Vec<f64>,
    /// What was seen, `[channels, S, S]` each: one more than steps. Empty where nobody looked.
    pub frames: Vec<Tensor>,
    /// Decisions that were computed, and the time that they took together, drawing excluded.
    pub decisions: usize,
    pub deciding: Duration,
    /// Where the last torque was held for want of a plan, and why.
    pub notes: Vec<String>,
}

/// Plays an episode. Equal seeds give equal episodes, to the bit with as many threads. `film` keeps the frames even of a
/// controller that does not look.
pub fn play(environment: &mut dyn Environment, controller: &mut Controller, seed: u64, film: bool) -> Episode {
    environment.reset(seed);
    controller.begin(seed);
    let looks = film || controller.sees();
    let mut episode = Episode::default();
    let mut torque = 0.0;
    for step in 0..environment.steps() {
        if looks {
            episode.frames.push(environment.observe());
        }
        if step % environment.hold() == 0 {
            torque = episode.decide(environment, controller, step, torque);
        }
        episode.total += environment.step(torque);
        episode.torques.push(torque);
    }
    if looks {
        episode.frames.push(environment.observe());
    }
    episode
}

impl Episode {
    /// The torque from this step on, after `last`.
    fn decide(&mut self, environment: &dyn Environment, controller: &mut Controller, step: usize, last: f64) -> f64 {
        let start = Instant::now();
        let decision = controller.decide(environment, &self.frames, &self.torques);
        let why = match decision {
            Decision::TooEarly => return 0.0,
            Decision::Torque(_) => None,
            Decision::Lost => Some("the pendulum is not seen"),
            Decision::NoPlan => Some("the model foretells no finite state"),
        };
        self.decisions += 1;
        self.deciding += start.elapsed();
        self.notes.extend(why.map(|why| format!("step {step}: {why}; the torque stays {last}")));
        if let Decision::Torque(torque) = decision { torque } else { last }
    }
}
