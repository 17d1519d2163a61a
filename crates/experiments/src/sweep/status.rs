//! How far each run of a sweep is, as the folders tell it.

use std::path::PathBuf;

use anyhow::Result;

use super::plan::{JobStage, SweepJob};
use paig::runs::course::Course;
use paig::runs::folder::RunFolder;
use paig::runs::summary::Summary;

/// One run at a glance.
#[derive(Debug, Clone, PartialEq)]
pub struct RunStatus {
    pub folder: PathBuf,
    pub state: JobState,
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
pub enum JobState {
    Waiting,
    Running,
    CutOff,
    Finished,
    /// Its folder cannot be read, or is of another config.
    Unreadable(String),
}

impl JobState {
    /// In a word.
    pub fn word(&self) -> &str {
        match self {
            JobState::Waiting => "waiting",
            JobState::Running => "running",
            JobState::CutOff => "cut off",
            JobState::Finished => "finished",
            JobState::Unreadable(_) => "unreadable",
        }
    }
}

/// How far the runs are, in their order. Nothing is written, nothing waited for.
pub fn status(jobs: &[SweepJob]) -> Vec<RunStatus> {
    jobs.iter().map(of_job).collect()
}

fn of_job(job: &SweepJob) -> RunStatus {
    let state = match job.stage() {
        Ok(JobStage::New) => JobState::Waiting,
        Ok(JobStage::Finished) => JobState::Finished,
        Ok(JobStage::CutOff) if RunFolder::is_in_use(&job.folder) => JobState::Running,
        Ok(JobStage::CutOff) => JobState::CutOff,
        Err(error) => JobState::Unreadable(format!("{error:#}")),
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
