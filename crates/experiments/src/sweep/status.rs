//! How far each run of a sweep is, as the folders tell it.

use std::path::PathBuf;

use anyhow::Result;

use super::plan::{Job, Stage};
use paig::runs::course::Course;
use paig::runs::folder::RunFolder;
use paig::runs::summary::Summary;

/// One run at a glance.
#[derive(Debug, Clone, PartialEq)]
pub struct RunStatus {
    pub folder: PathBuf,
    pub state: RunState,
    /// Where its training stands; none before the first record.
    pub phase: Option<String>,
    /// Steps and seconds of training so far.
    pub steps: u64,
    pub seconds: f64,
    /// Whether it found what it looked for, by its own verdict.
    pub found: Option<bool>,
}

/// What a run does now.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RunState {
    Waiting,
    Running,
    CutOff,
    Finished,
    /// Its folder cannot be read, or is of another config.
    Unreadable(String),
}

impl RunState {
    /// In a word.
    pub fn word(&self) -> &str {
        match self {
            RunState::Waiting => "waiting",
            RunState::Running => "running",
            RunState::CutOff => "cut off",
            RunState::Finished => "finished",
            RunState::Unreadable(_) => "unreadable",
        }
    }
}

/// How far the runs are, in their order. Nothing is written, nothing waited for.
pub fn status(jobs: &[Job]) -> Vec<RunStatus> {
    jobs.iter().map(of_job).collect()
}

fn of_job(job: &Job) -> RunStatus {
    let state = match job.stage() {
        Ok(Stage::New) => RunState::Waiting,
        Ok(Stage::Finished) => RunState::Finished,
        Ok(Stage::CutOff) if RunFolder::is_in_use(&job.folder) => RunState::Running,
        Ok(Stage::CutOff) => RunState::CutOff,
        Err(error) => RunState::Unreadable(format!("{error:#}")),
    };
    let course = Course::read(&job.folder).ok();
    let summary: Result<Option<Summary>> = Summary::read(&job.folder);
    RunStatus {
        folder: job.folder.clone(),
        state,
        phase: course.as_ref().and_then(|course| course.phase().map(String::from)),
        steps: course.as_ref().map_or(0, Course::steps),
        seconds: course.as_ref().and_then(Course::seconds).unwrap_or(0.0),
        found: summary.ok().flatten().and_then(|summary| Some(summary.verdict?.found)),
    }
}
