//! Many runs: tasks x seeds, each a process of the training program in a folder of its own.
//!
//! Which folder a run gets is a function of what is asked for alone, and a finished run leaves a marker in it. So the
//! same command may be given again at any time, on one machine or by a scheduler: it goes on where it was cut off.

mod plan;
mod processes;
mod request;
mod seeds;
mod status;

pub use paig::support::run_names::{DONE, OUTPUT};
pub use plan::{JobStage, SweepJob, SweepPlan};
pub use processes::{
    SweepEvent, SweepSummary, Work, failure, forget_failure, last_line, note_failure, run, training_program,
};
pub use request::{SweepRequest, jobs};
pub use seeds::{MOST_RUNS, parse_seeds};
pub use status::{JobState, RunStatus, status};
