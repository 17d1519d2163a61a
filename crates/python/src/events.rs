//! Events of a run as JSON.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use anyhow::Result;
use paig::network::physics_models::PhysicsNet;
use paig::run::{Event, Observer, Stage};
use paig::training::recorder;
use serde_json::json;

use crate::attend::Reporter;

/// From one step that is told to the next.
const PAUSE: Duration = Duration::from_millis(100);

/// Tells a run's events: their key `event` has the kind.
pub struct EventReporter<'a> {
    reporter: &'a Reporter,
    phase: &'static str,
    done: u64,
    of: u64,
    /// When the last step was told.
    told: Option<Instant>,
}

impl<'a> EventReporter<'a> {
    pub fn new(reporter: &'a Reporter) -> Self {
        EventReporter { reporter, phase: "", done: 0, of: 0, told: None }
    }

    fn step(&mut self, loss: f64, model: &PhysicsNet, seconds_left: Option<f64>) {
        self.done += 1;
        if self.told.is_some_and(|told| told.elapsed() < PAUSE) && self.done < self.of {
            return;
        }
        self.told = Some(Instant::now());
        let parameters: BTreeMap<_, _> = model.parameter_values().into_iter().collect();
        self.reporter.tell(json!({
            "event": "step", "phase": self.phase, "step": self.done, "of": self.of, "loss": loss,
            "parameters": parameters, "seconds_left": seconds_left,
        }));
    }
}

impl Observer for EventReporter<'_> {
    fn observe(&mut self, event: &Event) -> Result<()> {
        let told = match event {
            Event::Begins(run) => json!({
                "event": "begin", "folder": run.folder.path(), "task": run.config.task.name, "threads": run.threads,
            }),
            Event::Resumed { steps, damaged, .. } => json!({"event": "resumed", "step": steps, "damaged": damaged}),
            Event::PhaseBegins { phase, done, of } => {
                (self.phase, self.done, self.of, self.told) = (phase, *done, *of, None);
                json!({"event": "phase", "phase": phase, "step": done, "of": of})
            }
            Event::Step { loss, model, seconds_left, .. } => {
                self.step(*loss, model, *seconds_left);
                return Ok(());
            }
            Event::Recorded { record, .. } => {
                json!({"event": "record", "record": record, "line": recorder::line(record)})
            }
            Event::Note(line) => json!({"event": "note", "line": line}),
            Event::Checkpoint { steps } => json!({"event": "checkpoint", "step": steps}),
            Event::Begun(Stage::Scoring) => json!({"event": "phase", "phase": "scoring", "step": 0, "of": 0}),
            Event::Begun(Stage::Pictures) => json!({"event": "phase", "phase": "pictures", "step": 0, "of": 0}),
            Event::Scored { results, .. } => json!({"event": "scores", "scores": results.scores}),
            Event::Finished { summary, .. } => json!({"event": "finished", "summary": summary}),
            Event::PhaseEnds { .. } | Event::Ended(_) => return Ok(()),
        };
        self.reporter.tell(told);
        Ok(())
    }
}
