//! One episode: see, decide, act, sum the rewards.

use std::time::Duration;

use tch::Tensor;

use super::controller::{Controller, Decision};
use super::environment::Environment;
use super::state::ControlState;
use paig::support::thread_time::thread_time;

/// Decisions in a row without a plan after which the action is no longer held but 0.
const MOST_HELD: usize = 3;

/// What came of an episode.
#[derive(Debug, Default)]
pub struct Episode {
    /// The rewards of all steps.
    pub total: f64,
    /// What acted in each step.
    pub actions: Vec<f64>,
    /// The true states, one more than steps.
    pub states: Vec<ControlState>,
    /// What was seen, `[channels, S, S]` each: those before the episode, then one more than steps. Empty where nobody looked.
    pub frames: Vec<Option<Tensor>>,
    /// The plans that were made, in the order of their steps; empty where nothing is planned.
    pub plans: Vec<Planned>,
    /// Decisions that were computed, and the processor time that they took together on the thread that plays, drawing
    /// excluded.
    pub decisions: usize,
    pub deciding: Duration,
    /// Where there was no sight or no plan, and what acted then.
    pub notes: Vec<String>,
}

/// A plan as it was made.
#[derive(Debug, Clone, PartialEq)]
pub struct Planned {
    /// The step of the episode from which it holds.
    pub step: usize,
    /// The state that it begins at, as far as the planner knew.
    pub from: ControlState,
    /// The actions of its decisions.
    pub actions: Vec<f32>,
    /// Unconstrained parameters of the model then: others may be learned later in the episode. Empty of a model that learns none.
    pub parameters: Vec<f64>,
}

/// Plays an episode. Equal seeds give equal episodes, to the bit with as many threads. `film` keeps the frames even of a
/// controller that does not look.
pub fn play(environment: &mut dyn Environment, controller: &mut Controller, seed: u64, film: bool) -> Episode {
    environment.reset(seed);
    controller.begin(seed);
    let looks = film || controller.sees();
    let mut player = Player { episode: Episode::default(), acted: Vec::new(), action: 0.0, without_plan: 0 };
    if looks {
        player.look_back(environment, seed);
    }
    for step in 0..environment.rules().steps {
        if looks {
            player.episode.frames.push(environment.observe());
        }
        player.episode.states.push(environment.true_state());
        if step % environment.rules().hold == 0 {
            player.decide(environment, controller, step);
        }
        player.episode.total += environment.step(player.action);
        player.episode.actions.push(player.action);
        player.acted.push(player.action);
    }
    if looks {
        player.episode.frames.push(environment.observe());
    }
    player.episode.states.push(environment.true_state());
    player.episode
}

/// An episode on its way.
struct Player {
    episode: Episode,
    /// What acted from each frame to the next.
    acted: Vec<f64>,
    /// What acts now.
    action: f64,
    /// Decisions in a row without a plan.
    without_plan: usize,
}

impl Player {
    /// The frames before the episode: back to the first of them, and then on to the episode's beginning.
    fn look_back(&mut self, environment: &mut dyn Environment, seed: u64) {
        let frames = environment.rules().frames_before;
        environment.go_back(frames);
        for _ in 0..frames {
            self.episode.frames.push(environment.observe());
            environment.step(0.0);
            self.acted.push(0.0);
        }
        // The same beginning to the bit as of those that do not look.
        environment.restart(seed);
    }

    /// What acts from this step on.
    fn decide(&mut self, environment: &dyn Environment, controller: &mut Controller, step: usize) {
        let episode = &mut self.episode;
        let start = thread_time();
        let decision = controller.decide(environment, step, &episode.frames, &self.acted);
        episode.decisions += 1;
        episode.deciding += thread_time() - start;
        let why = match decision {
            Decision::Act { action, from, note } => {
                self.action = action;
                self.without_plan = 0;
                episode.notes.extend(note.map(|note| format!("step {step}: {note}")));
                let (actions, parameters) = (controller.planned().to_vec(), controller.parameters());
                episode.plans.extend(from.map(|from| Planned { step, from, actions, parameters }));
                return;
            }
            Decision::Lost => "what is controlled is not seen",
            Decision::NoPlan => "the model foretells no finite state",
        };
        self.without_plan += 1;
        if self.without_plan > MOST_HELD {
            self.action = 0.0;
        }
        episode.notes.push(format!("step {step}: {why}; {} acts on", self.action));
    }
}
