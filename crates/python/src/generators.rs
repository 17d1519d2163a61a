//! Generated clips.

use std::path::PathBuf;

use anyhow::{Context, Result};
use ndarray::Array3;
use paig::datasets::files::Split;
use paig::generators::source_images::SourceImages;
use paig::generators::variant::{Changes, Variant};
use paig::generators::{Counts, DatasetJob, GeneratorEvent};
use paig::support::device;
use paig::tasks;
use paig::tasks::scene::Background;
use paig::training::layers::usual_data_folder;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Deserialize;
use serde_json::json;

use crate::arrays;
use crate::attend::{Reporter, attended};

/// The arguments of `paig.generate`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GenerateKeywords {
    task: String,
    train: usize,
    valid: usize,
    test: usize,
    seed: u64,
    threads: usize,
    out: Option<PathBuf>,
    force: bool,
    scene: SceneChanges,
}

/// Numbers of the scene to change, by the names of `paig generate`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneChanges {
    k: Option<f64>,
    equil: Option<f64>,
    damping: Option<f64>,
    g: Option<f64>,
    m: Option<f64>,
    length: Option<f64>,
    a: Option<f64>,
    torque: Option<f64>,
    angle: Option<f64>,
    spin: Option<f64>,
    vx: Option<f64>,
    vy: Option<f64>,
    radius: Option<f64>,
    dt: Option<f64>,
    substeps: Option<usize>,
    size: Option<usize>,
    background: Option<String>,
}

impl SceneChanges {
    fn changes(&self) -> Result<Changes> {
        let &SceneChanges {
            k,
            equil,
            damping,
            g,
            m,
            length,
            a,
            torque,
            angle,
            spin,
            vx,
            vy,
            radius,
            dt,
            substeps,
            size,
            ..
        } = self;
        let background = self.background.as_deref().map(background).transpose()?;
        Ok(Changes {
            k,
            equil,
            damping,
            g,
            m,
            length,
            a,
            torque,
            angle,
            spin,
            vx,
            vy,
            radius,
            dt,
            substeps,
            size,
            background,
        })
    }
}

fn background(name: &str) -> Result<Background> {
    let known = Background::NAMED.into_iter().find(|(known, _)| *known == name).map(|(_, background)| background);
    let names = || Background::NAMED.map(|(name, _)| name).join(", ");
    known.with_context(|| format!("background {name:?}: expected one of {}", names()))
}

impl GenerateKeywords {
    fn job(&self) -> Result<DatasetJob> {
        let task = tasks::find(&self.task)?;
        let variant = Variant::new(&task, self.seed)?.with(&self.scene.changes()?)?;
        let images = SourceImages::of(&variant)?;
        let counts = Counts { train: self.train, valid: self.valid, test: self.test };
        let folder = self.out.clone().unwrap_or_else(|| usual_data_folder(&task, &self.task).into());
        Ok(DatasetJob { variant, counts, images, folder, force: self.force })
    }

    fn on_threads<T: Send>(&self, work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
        let threads = rayon::ThreadPoolBuilder::new().num_threads(device::threads(self.threads)?).build();
        threads.with_context(|| format!("cannot start {} threads", self.threads))?.install(work)
    }
}

fn tell(reporter: &Reporter, event: &GeneratorEvent) {
    reporter.leave_if_stopped();
    match event {
        GeneratorEvent::Ready { clips, total } if clips % 50 == 0 || clips == total => {
            reporter.tell(json!({"event": "clips", "step": clips, "of": total}));
        }
        GeneratorEvent::Begins { .. } | GeneratorEvent::Ready { .. } => {}
        GeneratorEvent::Wrote { path, .. } => reporter.tell(json!({"event": "wrote", "path": path})),
        GeneratorEvent::Kept { path, .. } => reporter.tell(json!({"event": "kept", "path": path})),
    }
}

/// Makes a task's training and test file. Returns their paths.
#[pyfunction]
#[pyo3(signature = (request, listener = None))]
pub fn generate(py: Python, request: &str, listener: Option<&Bound<PyAny>>) -> PyResult<Vec<PathBuf>> {
    attended(py, listener, |reporter| {
        let given: GenerateKeywords = serde_json::from_str(request)?;
        let job = given.job()?;
        given.on_threads(|| Ok(paig::generators::generate(&job, &|event| tell(reporter, &event))?))?;
        Ok(job.variant.files().map(|(_, file)| job.folder.join(file)).to_vec())
    })
}

/// Makes clips in memory. Returns `{split: {"frames": .., "positions": .., "velocities": ..}}`.
#[pyfunction]
#[pyo3(signature = (request, frames = None, listener = None))]
pub fn generate_clips<'py>(
    py: Python<'py>,
    request: &str,
    frames: Option<usize>,
    listener: Option<&Bound<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let (made, states, objects) = attended(py, listener, |reporter| {
        let given: GenerateKeywords = serde_json::from_str(request)?;
        let DatasetJob { variant, counts, images, .. } = given.job()?;
        let frames = frames.unwrap_or(variant.task.train_frames);
        let watch = |event: GeneratorEvent| tell(reporter, &event);
        let make = || paig::generators::generate_clips(&variant, &images, frames, counts, &watch);
        let (made, states) = given.on_threads(make)?;
        Ok((made, states, variant.task.system.objects))
    })?;
    let splits = PyDict::new(py);
    for split in Split::ALL {
        let arrays = PyDict::new(py);
        let of = states.split(split);
        arrays.set_item("frames", arrays::given_bytes(py, made.split(split)))?;
        arrays.set_item("positions", arrays::given(py, by_object(&of.positions, objects)))?;
        arrays.set_item("velocities", arrays::given(py, by_object(&of.velocities, objects)))?;
        if let Some(actions) = made.actions(split) {
            arrays.set_item("actions", arrays::given(py, actions.clone().into_dyn()))?;
        }
        splits.set_item(split.name(), arrays)?;
    }
    Ok(splits)
}

/// `[clips, frames, coordinates * objects]` as `[clips, frames, objects, coordinates]`.
fn by_object(states: &Array3<f32>, objects: usize) -> arrays::Floats {
    let (clips, frames, coordinates) = states.dim();
    let shape = [clips, frames, objects, coordinates / objects];
    states.as_standard_layout().into_owned().into_shape_with_order(shape).expect("a whole number for each").into_dyn()
}
