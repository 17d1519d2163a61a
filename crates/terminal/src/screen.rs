//! A run on the terminal: a bar for each phase, a line for each record, the results.

use std::time::Duration;

use anyhow::Result;
use indicatif::HumanDuration;
use paig::run::{Event, Observer, Prepared, Program, Stage};
use paig::runs::checkpoint::RunState;
use paig::support::memory;
use paig::tasks::Task;
use paig::training::recorder;

use crate::banner::banner;
use crate::progress::PhaseProgress;
use crate::say;
use crate::table::{print_frames_and_states, print_results};

/// Shows a run.
#[derive(Debug)]
pub struct Screen<'a> {
    program: Program<'a>,
    progress: Option<PhaseProgress>,
    run: Option<RunHeading>,
}

/// What is shown of the run throughout.
#[derive(Debug)]
struct RunHeading {
    folder: String,
    task: Task,
}

impl<'a> Screen<'a> {
    pub fn new(program: Program<'a>) -> Self {
        Screen { program, progress: None, run: None }
    }

    /// A line that stays.
    fn line(&self, text: &str) {
        match &self.progress {
            Some(progress) => progress.line(text),
            None => say!("{text}"),
        }
    }

    fn begins(&mut self, run: &Prepared) {
        say!("{}", banner(self.program, run.device, run.threads));
        let folder = run.folder.path().display().to_string();
        say!("run folder {folder}");
        if let Some([now, most]) = run.memory {
            say!("memory - {} now, about {} in all", memory::gib(now), memory::gib(most));
        }
        self.run = Some(RunHeading { folder, task: run.config.task.clone() });
    }

    fn finish_bar(&mut self) {
        self.progress.take().iter().for_each(PhaseProgress::finish);
    }
}

impl Observer for Screen<'_> {
    fn observe(&mut self, event: &Event) -> Result<()> {
        match event {
            Event::Begins(run) => self.begins(run),
            Event::Resumed { steps, checkpoint, damaged } => {
                damaged.iter().for_each(|what| say!("warning: {what}; the checkpoint before it is taken"));
                say!("resuming after step {steps} ({checkpoint})");
            }
            Event::PhaseBegins { phase, done, of } => {
                self.progress =
                    Some(if *of > 0 { PhaseProgress::new(phase, *of, *done) } else { PhaseProgress::busy(phase) });
            }
            Event::Step { loss, model, seconds_left, .. } => {
                if let Some(progress) = &self.progress {
                    let values =
                        || model.parameter_values().into_iter().map(|(name, value)| format!("{name}={value:.3}"));
                    let left = (*seconds_left).map_or_else(String::new, time_left);
                    progress.step(|| format!("{left}loss {loss:.3} {}", values().collect::<Vec<_>>().join(" ")));
                }
            }
            Event::Recorded { record, .. } => {
                if let Some(line) = recorder::line(record) {
                    self.line(&format!("{:>9} {line} ({:.0} s)", record.phase, record.seconds.unwrap_or_default()));
                }
            }
            Event::Note(line) => self.line(line),
            Event::Checkpoint { .. } => {}
            Event::PhaseEnds { .. } | Event::Ended(_) => self.finish_bar(),
            Event::Begun(Stage::Scoring) => {
                say!("checking what was learned on held-out clips, scoring the test clips, drawing pictures");
                self.progress = Some(PhaseProgress::busy("scoring"));
            }
            Event::Begun(Stage::Pictures) => self.progress = Some(PhaseProgress::busy("pictures")),
            Event::Scored { model, results } => {
                let task = &self.run.as_ref().expect("a run begins before it is scored").task;
                print_frames_and_states(&task.system, &results.scores);
                print_results(task, model, &results.clips, &results.scores.losses);
            }
            Event::Finished { state, .. } => {
                print_end(state, &self.run.as_ref().expect("a run begins before it ends").folder);
            }
        }
        Ok(())
    }
}

/// `run: at most 2 minutes, `.
fn time_left(seconds: f64) -> String {
    format!("run: at most {}, ", HumanDuration(Duration::from_secs_f64(seconds.min(1e9))))
}

/// Prints what each phase took, and what to do next.
fn print_end(state: &RunState, folder: &str) {
    let seconds = |(name, seconds): &(String, f64)| format!("{name} {seconds:.0} s");
    let phases: Vec<_> = state.phase_seconds.iter().map(seconds).collect();
    say!("finished after {} steps, {:.0} s ({}); results in {folder}", state.steps, state.seconds, phases.join(", "));
    say!("look at {folder}/losses.png and {folder}/example0.png; next: paig predict {folder} --frames 60");
}
