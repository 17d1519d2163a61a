//! The time that a training still takes at most.

use std::time::Instant;

use crate::training::config::Config;

/// How fast the phases of a training go.
#[derive(Debug)]
pub(super) struct Pace {
    /// The phases to come, with the frames that they take at most.
    later: Vec<(&'static str, f64)>,
    phase: Option<PhasePace>,
}

/// The phase at hand.
#[derive(Debug)]
struct PhasePace {
    since: Instant,
    steps: u64,
    left: u64,
    frames_per_step: f64,
}

impl Pace {
    pub fn new(config: &Config) -> Self {
        let phases = config.phases();
        let later = phases.iter().map(|phase| (phase.name(), phase.frames(&config.task.system))).collect();
        Pace { later, phase: None }
    }

    /// A phase begins or goes on: steps done, and at most to be done.
    pub fn begin(&mut self, phase: &str, done: u64, of: u64) {
        let place = self.later.iter().position(|(name, _)| *name == phase);
        let here = place.map(|place| self.later.drain(..=place).next_back().map_or(0.0, |(_, frames)| frames));
        self.phase = here.filter(|frames| *frames > 0.0 && of > 0).map(|frames| PhasePace {
            since: Instant::now(),
            steps: 0,
            left: of.saturating_sub(done),
            frames_per_step: frames / of as f64,
        });
    }

    /// Counts a step. Returns the seconds to the end of the training if every phase takes all its steps; none where the
    /// phase has no steps.
    pub fn step(&mut self) -> Option<f64> {
        let later: f64 = self.later.iter().map(|(_, frames)| frames).sum();
        let phase = self.phase.as_mut()?;
        phase.steps += 1;
        phase.left = phase.left.saturating_sub(1);
        let seconds_per_step = phase.since.elapsed().as_secs_f64() / phase.steps as f64;
        Some(seconds_per_step * (phase.left as f64 + later / phase.frames_per_step))
    }
}
