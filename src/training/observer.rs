//! What a training tells those who watch it: progress bars, logs, plots, a program of one's own.

use anyhow::Result;

use crate::network::physics_models::PhysicsNet;
use crate::runs::metrics::Record;

/// Something that happened in a training.
#[derive(Debug)]
pub enum TrainingEvent<'a, M = PhysicsNet> {
    /// It goes on from a checkpoint after this many steps; later ones were damaged, as told.
    Resumed { steps: u64, checkpoint: &'a str, damaged: Option<&'a str> },
    /// A phase begins or goes on: the steps that it has taken, and those that it takes at most; 0 where it takes none.
    PhaseBegins { phase: &'static str, done: u64, of: u64 },
    /// A step was taken, with this loss.
    Step { loss: f64, model: &'a M },
    /// Numbers for metrics.jsonl: of a step, of a validation, of the fit.
    Recorded { record: &'a Record, model: &'a M },
    /// A line for people: what the fit found, what was done about it.
    Note(&'a str),
    /// A checkpoint was saved after this many steps.
    Checkpoint { steps: u64 },
    /// A phase has come to its end, or was stopped.
    PhaseEnds { phase: &'static str },
}

/// Watches the training of a model.
pub trait TrainingObserver<M = PhysicsNet> {
    /// # Errors
    /// What the observer cannot do, such as writing to a full disk: the training ends with this error.
    fn observe(&mut self, event: &TrainingEvent<M>) -> Result<()>;
}
