//! What the library knows: tasks, equations, versions.

use anyhow::{Context, Result};
use paig::kernels::{Instructions, libtorch_capability, vector_path};
use paig::network::cells::Equations;
use paig::network::system::EquationEntry;
use paig::support::device::{LIBTORCH_VERSION, cores, processor};
use paig::tasks::{Task, all, find};
use pyo3::prelude::*;
use serde::Deserialize;
use serde_json::{Value, json};
use tch::Cuda;

use crate::PROGRAM;
use crate::errors::raised;

/// The built-in tasks, `{name: summary}`.
#[pyfunction]
pub fn tasks() -> String {
    let described = |task: Task| (task.name.clone(), Value::from(task.summary()));
    Value::Object(all().map(described).collect()).to_string()
}

/// A task by its name or file, as JSON of its file.
#[pyfunction]
pub fn task(py: Python, named: &str) -> PyResult<String> {
    let read = || -> Result<String> { Ok(serde_json::to_string(&find(named)?.to_table())?) };
    read().map_err(|error| raised(py, error))
}

/// The text of a task file, checked.
#[pyfunction]
pub fn task_file(py: Python, table: &str) -> PyResult<String> {
    let text = || -> Result<String> {
        let text = toml::to_string(&serde_json::from_str::<Value>(table)?).context("task")?;
        Task::from_toml(&text)?;
        Ok(text)
    };
    text().map_err(|error| raised(py, error))
}

/// An equation and how many objects it is for.
#[derive(Deserialize)]
struct EquationForObjects {
    equation: EquationEntry,
    objects: usize,
}

/// The names of an equation's parameters.
#[pyfunction]
pub fn check_equation(py: Python, given: &str) -> PyResult<Vec<String>> {
    let kind = || -> Result<Vec<String>> {
        let EquationForObjects { equation, objects } = serde_json::from_str(given)?;
        let kind = equation.kind(objects, &Equations::default())?;
        Ok(kind.parameters.iter().map(|parameter| parameter.name.to_string()).collect())
    };
    kind().map_err(|error| raised(py, error))
}

/// Of this build, of libtorch, and where it computes.
#[pyfunction]
pub fn versions() -> String {
    let path = match vector_path() {
        Ok(instructions) => instructions.map_or("libtorch", Instructions::name),
        Err(why) => why,
    };
    json!({
        "paig": PROGRAM.version, "commit": PROGRAM.commit, "libtorch": LIBTORCH_VERSION,
        "cpu_capability": libtorch_capability(), "vector_path": path, "processor": processor(), "cores": cores(),
        "gpus": if Cuda::is_available() { Cuda::device_count() } else { 0 },
    })
    .to_string()
}
