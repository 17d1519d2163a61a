//! Runs: training, their folders, configs and parameters.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use paig::network::cells::{Coordinates, PhysicalParameter};
use paig::run::{Mode, Request};
use paig::runs::find::find_runs;
use paig::support::run_names::CONFIG;
use paig::training::config::Config;
use paig::training::layers::Overrides;
use paig_video::run::{VideoRunEnding, execute};
use pyo3::prelude::*;
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::PROGRAM;
use crate::attend::attended;
use crate::errors;
use crate::events::EventReporter;

/// The arguments of `paig.train`.
#[derive(Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
struct TrainKeywords {
    task: Option<String>,
    config: Option<PathBuf>,
    recipe: Option<String>,
    seed: Option<u64>,
    device: Option<String>,
    threads: Option<usize>,
    data: Option<PathBuf>,
    set: Vec<String>,
    out: Option<PathBuf>,
    resume: bool,
    score: bool,
}

impl TrainKeywords {
    fn request(self) -> Request {
        let TrainKeywords { task, config, recipe, seed, device, threads, data, set, out, resume, score } = self;
        let mode = match (score, resume) {
            (true, _) => Mode::Score,
            (false, true) => Mode::Resume,
            (false, false) => Mode::Begin,
        };
        Request { config, overrides: Overrides { task, recipe, seed, device, threads, data, set }, out, mode }
    }
}

fn read<'a, T: Deserialize<'a>>(request: &'a str) -> Result<T> {
    Ok(serde_json::from_str(request)?)
}

/// Goes through a run. Returns `{"ending": "finished" | "scored" | "interrupted", "folder": .., "steps": .., "measurement":
/// error or null}`.
#[pyfunction]
#[pyo3(signature = (request, listener = None))]
pub fn train(py: Python, request: &str, listener: Option<&Bound<PyAny>>) -> PyResult<String> {
    attended(py, listener, |reporter| {
        let mut teller = EventReporter::new(reporter);
        let run = read::<TrainKeywords>(request)?.request().open()?.prepare(&mut teller)?;
        let folder = run.folder.path();
        let ending = match execute(&run, PROGRAM, &mut teller, &|| reporter.stopped())? {
            VideoRunEnding::Finished { measurement, .. } => {
                let failed = measurement.and_then(Result::err).map(|error| format!("{error:#}"));
                json!({"ending": "finished", "folder": folder, "measurement": failed})
            }
            VideoRunEnding::Scored => json!({"ending": "scored", "folder": folder}),
            VideoRunEnding::Interrupted { steps } => json!({"ending": "interrupted", "folder": folder, "steps": steps}),
        };
        let interrupted = ending["ending"] == "interrupted";
        if interrupted {
            reporter.tell(json!({"event": "interrupted", "folder": folder, "step": ending["steps"]}));
        }
        Ok(ending.to_string())
    })
}

/// The complete config of a run that `train` would begin with, TOML.
#[pyfunction]
pub fn config(py: Python, request: &str) -> PyResult<String> {
    let config = || Ok(read::<TrainKeywords>(request)?.request().config()?.to_toml());
    config().map_err(|error| errors::raised(py, error))
}

/// What a run folder is of: task, recipe, data files, system, and the powers of length and time in each parameter's unit.
#[pyfunction]
pub fn describe(py: Python, folder: PathBuf) -> PyResult<String> {
    described(&folder).map(|run| run.to_string()).map_err(|error| errors::raised(py, error))
}

fn described(folder: &Path) -> Result<Value> {
    let config = Config::read(&folder.join(CONFIG))?;
    let system = &config.task.system;
    let powers = |parameter: &PhysicalParameter| json!(parameter.time_power.map(|time| [parameter.length_power, time]));
    let parameters = system.cell.parameters.iter();
    let units: Map<_, _> = parameters.map(|parameter| (parameter.name.to_string(), powers(parameter))).collect();
    Ok(json!({
        "task": config.task.name, "recipe": config.recipe, "seed": config.seed, "train_file": config.data.train_path(),
        "test_file": config.data.test_path(), "side": system.side, "channels": system.channels, "objects": system.objects,
        "coordinates": if system.cell.coordinates == Coordinates::Angle { ["angle"].as_slice() } else { &["x", "y"] },
        "input_steps": system.input_steps, "pred_steps": system.pred_steps, "dt": system.dt, "units": units,
        "filmed": config.task.video().is_some(),
    }))
}

/// The folders of the runs in and under some folders, in the order of their names.
#[pyfunction]
pub fn run_folders(py: Python, folders: Vec<PathBuf>) -> PyResult<Vec<PathBuf>> {
    let found = find_runs(&folders, &|_| false).context("looking for runs");
    let found = found.map_err(|error| errors::raised(py, error))?;
    Ok(found.runs.into_iter().map(|run| run.folder).collect())
}
