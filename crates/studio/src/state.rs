//! What the page shows of a project, read from its files.

use std::fs;

use anyhow::Result;
use paig::support::run_names::{METRICS, SUMMARY};
use paig_video::measure::results::{MEASUREMENT, Measurement};
use serde::Serialize;

use crate::jobs::{ProcessStatus, ProjectJob};
use crate::preview::ProjectPreview;
use crate::project::{Project, ProjectRecord};
use crate::settings::{ProjectSettings, command_line};
use crate::training::{IMPORT, LIVE, Live, RUN, TASK};

/// A process and how it ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "state", content = "reason")]
pub enum WorkStatus {
    None,
    Running,
    Done,
    Stopped,
    Failed(String),
}

impl WorkStatus {
    /// A job has succeeded if its result is there.
    pub fn of(job: &ProjectJob, has_result: bool) -> Self {
        match job.progress() {
            ProcessStatus::Running => WorkStatus::Running,
            _ if has_result => WorkStatus::Done,
            ProcessStatus::Ended if job.was_stopped() => WorkStatus::Stopped,
            ProcessStatus::Ended => WorkStatus::Failed(job.reason()),
            ProcessStatus::None => WorkStatus::None,
        }
    }
}

/// A measurement of the project.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProjectMeasurement {
    pub number: usize,
    pub work: WorkStatus,
    /// Since it was started.
    pub seconds: Option<u64>,
    /// The settings that it was made with, and the command.
    pub settings: Option<ProjectSettings>,
    pub command: Option<String>,
    pub result: Option<Measurement>,
}

/// A training of the project.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProjectTraining {
    pub number: usize,
    pub work: WorkStatus,
    /// `paig import`, then `paig train`.
    pub commands: Vec<String>,
    pub live: Option<Live>,
    /// Bytes of the run's course so far: it has grown when they change.
    pub records: u64,
    pub result: Option<Measurement>,
}

/// All of a project.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProjectState {
    pub name: String,
    pub record: ProjectRecord,
    pub settings: ProjectSettings,
    /// The command that measures with these settings.
    pub command: Option<String>,
    pub preview_work: WorkStatus,
    pub preview: ProjectPreview,
    pub measured: Option<ProjectMeasurement>,
    pub trained: Option<ProjectTraining>,
}

/// The settings and the command of a measurement, beside its files.
pub const SETTINGS_OF: &str = "settings.json";
pub const COMMAND_OF: &str = "command.txt";

impl ProjectState {
    /// # Errors
    /// A damaged file of the project.
    pub fn read(project: &Project) -> Result<Self> {
        let settings = project.settings()?;
        let preview = ProjectPreview::read(&project.preview_folder());
        let number = project.measurements().last().copied();
        Ok(ProjectState {
            name: project.name(),
            record: project.record()?,
            command: command(project, &settings).ok(),
            settings,
            preview_work: WorkStatus::of(&project.preview_job(), preview.proposals.is_some()),
            preview,
            measured: number.map(|number| measured(project, number)),
            trained: project.trainings().last().map(|number| trained(project, *number)),
        })
    }
}

/// The command that measures next.
fn command(project: &Project, settings: &ProjectSettings) -> Result<String> {
    let next = project.measurements().last().map_or(1, |last| last + 1);
    let equation = project.equation(settings)?;
    Ok(command_line(&settings.measure(&project.source()?, &equation, &project.measurement_folder(next))))
}

fn measured(project: &Project, number: usize) -> ProjectMeasurement {
    let folder = project.measurement_folder(number);
    let text = |name: &str| fs::read_to_string(folder.join(name)).ok();
    let job = ProjectJob::new(folder.clone());
    ProjectMeasurement {
        number,
        work: WorkStatus::of(&job, folder.join(MEASUREMENT).exists()),
        seconds: job.seconds(),
        settings: text(SETTINGS_OF).and_then(|text| serde_json::from_str(&text).ok()),
        command: text(COMMAND_OF),
        result: Measurement::read(&folder).ok(),
    }
}

fn trained(project: &Project, number: usize) -> ProjectTraining {
    let folder = project.training_folder(number);
    let (task, run) = (folder.join(TASK).join("task.toml"), folder.join(RUN));
    let import: Vec<String> =
        fs::read(folder.join(IMPORT)).ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default();
    let train = ["train", "--task", &task.display().to_string(), "--out", &run.display().to_string()].map(String::from);
    ProjectTraining {
        number,
        work: WorkStatus::of(&ProjectJob::new(folder.clone()), run.join(SUMMARY).exists()),
        commands: [&import[..], &train].map(command_line).into(),
        live: fs::read(folder.join(LIVE)).ok().and_then(|text| serde_json::from_slice(&text).ok()),
        records: fs::metadata(run.join(METRICS)).map_or(0, |metrics| metrics.len()),
        result: Measurement::read(&run).ok(),
    }
}
