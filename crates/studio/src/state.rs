//! What the page shows of a project, read from its files.

use std::fs;

use anyhow::Result;
use paig::runs::names::{METRICS, SUMMARY};
use paig_video::measure::results::{MEASUREMENT, Measurement};
use serde::Serialize;

use crate::jobs::{Job, Progress};
use crate::preview::Preview;
use crate::project::{Project, Record};
use crate::settings::{Settings, command_line};
use crate::training::{IMPORT, LIVE, Live, RUN, TASK};

/// A process and how it ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "state", content = "reason")]
pub enum Work {
    None,
    Running,
    Done,
    Stopped,
    Failed(String),
}

impl Work {
    /// A job has succeeded if its result is there.
    pub fn of(job: &Job, has_result: bool) -> Self {
        match job.progress() {
            Progress::Running => Work::Running,
            _ if has_result => Work::Done,
            Progress::Ended if job.was_stopped() => Work::Stopped,
            Progress::Ended => Work::Failed(job.reason()),
            Progress::None => Work::None,
        }
    }
}

/// A measurement of the project.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measured {
    pub number: usize,
    pub work: Work,
    /// Since it was started.
    pub seconds: Option<u64>,
    /// The settings that it was made with, and the command.
    pub settings: Option<Settings>,
    pub command: Option<String>,
    pub result: Option<Measurement>,
}

/// A training of the project.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trained {
    pub number: usize,
    pub work: Work,
    /// `paig import`, then `paig train`.
    pub commands: Vec<String>,
    pub live: Option<Live>,
    /// Bytes of the run's course so far: it has grown when they change.
    pub records: u64,
    pub result: Option<Measurement>,
}

/// All of a project.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct State {
    pub name: String,
    pub record: Record,
    pub settings: Settings,
    /// The command that measures with these settings.
    pub command: Option<String>,
    pub preview_work: Work,
    pub preview: Preview,
    pub measured: Option<Measured>,
    pub trained: Option<Trained>,
}

/// The settings and the command of a measurement, beside its files.
pub const SETTINGS_OF: &str = "settings.json";
pub const COMMAND_OF: &str = "command.txt";

impl State {
    /// # Errors
    /// A damaged file of the project.
    pub fn read(project: &Project) -> Result<Self> {
        let settings = project.settings()?;
        let preview = Preview::read(&project.preview_folder());
        let number = project.measurements().last().copied();
        Ok(State {
            name: project.name(),
            record: project.record()?,
            command: command(project, &settings).ok(),
            settings,
            preview_work: Work::of(&project.preview_job(), preview.proposals.is_some()),
            preview,
            measured: number.map(|number| measured(project, number)),
            trained: project.trainings().last().map(|number| trained(project, *number)),
        })
    }
}

/// The command that measures next.
fn command(project: &Project, settings: &Settings) -> Result<String> {
    let next = project.measurements().last().map_or(1, |last| last + 1);
    let equation = project.equation(settings)?;
    Ok(command_line(&settings.measure(&project.source()?, &equation, &project.measurement_folder(next))))
}

fn measured(project: &Project, number: usize) -> Measured {
    let folder = project.measurement_folder(number);
    let text = |name: &str| fs::read_to_string(folder.join(name)).ok();
    let job = Job::new(folder.clone());
    Measured {
        number,
        work: Work::of(&job, folder.join(MEASUREMENT).exists()),
        seconds: job.seconds(),
        settings: text(SETTINGS_OF).and_then(|text| serde_json::from_str(&text).ok()),
        command: text(COMMAND_OF),
        result: Measurement::read(&folder).ok(),
    }
}

fn trained(project: &Project, number: usize) -> Trained {
    let folder = project.training_folder(number);
    let (task, run) = (folder.join(TASK).join("task.toml"), folder.join(RUN));
    let import: Vec<String> =
        fs::read(folder.join(IMPORT)).ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default();
    let train = ["train", "--task", &task.display().to_string(), "--out", &run.display().to_string()].map(String::from);
    Trained {
        number,
        work: Work::of(&Job::new(folder.clone()), run.join(SUMMARY).exists()),
        commands: [&import[..], &train].map(command_line).into(),
        live: fs::read(folder.join(LIVE)).ok().and_then(|text| serde_json::from_slice(&text).ok()),
        records: fs::metadata(run.join(METRICS)).map_or(0, |metrics| metrics.len()),
        result: Measurement::read(&run).ok(),
    }
}
