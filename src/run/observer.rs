//! What a run shows of itself: terminals, pages, notebooks.

use anyhow::Result;

use super::Prepared;
use super::pace::Pace;
use super::preview::Preview;
use super::scoring::TestResults;
use crate::datasets::iterators::Clips;
use crate::network::physics_models::PhysicsNet;
use crate::runs::checkpoint::RunState;
use crate::runs::metrics::Record;
use crate::runs::summary::Summary;
use crate::training::config::Config;
use crate::training::observer::{self as training, TrainingEvent};

/// A part of a run after the training.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The verdict on held-out clips, the scores on test clips.
    Scoring,
    Pictures,
}

/// Something that happened in a run.
#[derive(Debug)]
pub enum Event<'a> {
    /// A remark for people.
    Note(&'a str),
    /// Data, device and folder are ready; what fails from now on is not the input's fault.
    Begins(&'a Prepared),
    /// The training goes on from a checkpoint after so many steps; `damaged` names later checkpoints that cannot be read.
    Resumed {
        steps: u64,
        checkpoint: &'a str,
        damaged: Option<&'a str>,
    },
    /// A phase begins or goes on: steps done, and at most to be done; 0 where it takes none.
    PhaseBegins {
        phase: &'static str,
        done: u64,
        of: u64,
    },
    /// A training step.
    Step {
        loss: f64,
        model: &'a PhysicsNet,
        preview: Preview<'a>,
        /// At most, to the end of the training; none before the first steps of a phase.
        seconds_left: Option<f64>,
    },
    /// Numbers of a step, a validation or a fit, with the parameters; the preview draws a validation clip by the model of
    /// the last step.
    Recorded {
        record: &'a Record,
        preview: Option<Preview<'a>>,
    },
    Checkpoint {
        steps: u64,
    },
    PhaseEnds {
        phase: &'static str,
    },
    Begun(Stage),
    Ended(Stage),
    /// The scores on the test clips.
    Scored {
        model: &'a PhysicsNet,
        results: &'a TestResults,
    },
    /// All files are written.
    Finished {
        summary: &'a Summary,
        state: &'a RunState,
    },
}

/// Watches a run.
pub trait Observer {
    /// # Errors
    /// What the observer cannot do, such as writing to a full disk: the run ends with this error.
    fn observe(&mut self, event: &Event) -> Result<()>;
}

/// Hands the events of a training on to a run's observer, with the time left and a preview.
pub(super) struct TrainingRelay<'a> {
    observer: &'a mut dyn Observer,
    valid: &'a Clips,
    pace: Pace,
}

impl<'a> TrainingRelay<'a> {
    pub fn new(config: &Config, valid: &'a Clips, observer: &'a mut dyn Observer) -> Self {
        TrainingRelay { observer, valid, pace: Pace::new(config) }
    }
}

impl training::TrainingObserver for TrainingRelay<'_> {
    fn observe(&mut self, event: &TrainingEvent) -> Result<()> {
        let event = match *event {
            TrainingEvent::Resumed { steps, checkpoint, damaged } => Event::Resumed { steps, checkpoint, damaged },
            TrainingEvent::PhaseBegins { phase, done, of } => {
                self.pace.begin(phase, done, of);
                Event::PhaseBegins { phase, done, of }
            }
            TrainingEvent::Step { loss, model } => {
                Event::Step { loss, model, preview: Preview::new(model, self.valid), seconds_left: self.pace.step() }
            }
            TrainingEvent::Recorded { record, model } => {
                Event::Recorded { record, preview: Some(Preview::new(model, self.valid)) }
            }
            TrainingEvent::Note(line) => Event::Note(line),
            TrainingEvent::Checkpoint { steps } => Event::Checkpoint { steps },
            TrainingEvent::PhaseEnds { phase } => Event::PhaseEnds { phase },
        };
        self.observer.observe(&event)
    }
}
