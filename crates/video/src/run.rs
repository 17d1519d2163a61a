//! A whole run that ends with a measurement where its task was made from videos.

use anyhow::Context;
use paig::run::{self, Observer, Prepared, Program};
use paig::runs::summary::Summary;
use paig::training::config::Config;
use paig::{Error, Result};

use crate::measure::results::Measurement;
use crate::measure::{MeasureRequest, measure};

/// How a run ended.
#[derive(Debug)]
pub enum VideoRunEnding {
    Finished {
        summary: Box<Summary>,
        /// Of a task that was made from videos; a measurement that failed leaves the run finished.
        measurement: Option<Result<Box<Measurement>>>,
    },
    /// An earlier run was scored.
    Scored,
    /// Asked to stop after so many steps; saved, ready to resume.
    Interrupted { steps: u64 },
}

/// Goes through a run as [`Prepared::execute`] does, and measures the videos that its task was made from.
///
/// # Errors
/// As [`Prepared::execute`].
pub fn execute(
    run: &Prepared,
    program: Program,
    observer: &mut dyn Observer,
    stop: &dyn Fn() -> bool,
) -> Result<VideoRunEnding> {
    Ok(match run.execute(program, observer, stop)? {
        run::Ending::Finished(summary) => {
            let measurement = is_measured(&run.config).then(|| {
                let out = run.folder.path();
                let measured = measure(out, &MeasureRequest::default(), out, run.device).with_context(|| {
                    format!("the run is finished, but not measured; `paig measure {}` does it", out.display())
                });
                measured.map(Box::new).map_err(Error::of_work)
            });
            VideoRunEnding::Finished { summary, measurement }
        }
        run::Ending::Scored => VideoRunEnding::Scored,
        run::Ending::Interrupted { steps } => VideoRunEnding::Interrupted { steps },
    })
}

/// Whether a run measures videos as a whole: those that its task was made from.
fn is_measured(config: &Config) -> bool {
    config.task.video().is_some_and(|video| video.film_step.is_some())
}
