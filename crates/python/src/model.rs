//! A trained model. It lives on a thread of its own: tensors are not shared between threads.

use std::path::PathBuf;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Mutex, PoisonError};
use std::thread;

use anyhow::{Context, Result, anyhow, ensure};
use numpy::{PyArrayDyn, PyReadonlyArrayDyn};
use paig::datasets::files::Split;
use paig::evaluation::rollout::roll_out;
use paig::evaluation::{self, ScoredClips};
use paig::network::cells::{Actions, State};
use paig::network::physics_models::PhysicsNet;
use paig::runs::checkpoint::SavedWeights;
use paig::support::device;
use paig::training::config::Config;
use paig::training::saved::load_model;
use paig_terminal::ending::guarded;
use pyo3::prelude::*;
use tch::{Device, Tensor};

use crate::arrays::{self, Floats};
use crate::errors::raised;

/// What the thread holds.
struct Opened {
    folder: PathBuf,
    config: Config,
    net: PhysicsNet,
    device: Device,
    /// The split that was read last.
    clips: Option<(Split, ScoredClips)>,
}

type ModelJob = Box<dyn FnOnce(&mut Opened) + Send>;

/// The model of a run.
#[pyclass(frozen, module = "paig._paig")]
pub struct Model {
    jobs: Mutex<Sender<ModelJob>>,
}

type Array<'py> = Bound<'py, PyArrayDyn<f32>>;

#[pymethods]
impl Model {
    #[new]
    #[pyo3(signature = (folder, best, device, threads))]
    fn new(py: Python, folder: PathBuf, best: bool, device: &str, threads: usize) -> PyResult<Self> {
        let (jobs, wanted) = channel::<ModelJob>();
        let (opened, news) = channel();
        let which = if best { SavedWeights::Best } else { SavedWeights::Last };
        let device = device.to_string();
        let open = move || -> Result<Opened> {
            let device = device::parse(&device)?;
            device::set_threads(threads)?;
            let (config, net) = load_model(&folder, which, device)?;
            Ok(Opened { folder, config, net, device, clips: None })
        };
        thread::spawn(move || match guarded(open) {
            Ok(mut model) => {
                let _ = opened.send(Ok(()));
                let _guard = tch::no_grad_guard();
                wanted.iter().for_each(|job| job(&mut model));
            }
            Err(error) => drop(opened.send(Err(error))),
        });
        let news = Mutex::new(news);
        let opened = py.detach(|| news.lock().unwrap_or_else(PoisonError::into_inner).recv());
        opened.unwrap_or_else(|_| Err(gone())).map_err(|error| raised(py, error))?;
        Ok(Model { jobs: Mutex::new(jobs) })
    }

    /// Values of the parameters by symbol, lengths in pixels.
    fn parameters(&self, py: Python) -> PyResult<Vec<(String, f64)>> {
        self.ask(py, |model| {
            Ok(model.net.parameter_values().into_iter().map(|(name, value)| (name.to_string(), value)).collect())
        })
    }

    /// Positions `[clips, time, objects, coordinates]` of frames `[clips, time, S, S, channels]`.
    fn encode<'py>(&self, py: Python<'py>, frames: PyReadonlyArrayDyn<f32>) -> PyResult<Array<'py>> {
        let frames = arrays::taken(&frames);
        self.array(py, move |model| {
            let frames = model.frames(&frames)?;
            let time = frames.size()[1] as usize;
            model.positions(&model.net.see(&frames, time.min(model.net.system.input_steps)).positions)
        })
    }

    /// States `[clips, 1 + steps, objects, coordinates]` from the last of the positions on: positions and velocities.
    #[pyo3(signature = (positions, steps, actions = None))]
    fn roll_out<'py>(
        &self,
        py: Python<'py>,
        positions: PyReadonlyArrayDyn<f32>,
        steps: usize,
        actions: Option<PyReadonlyArrayDyn<f32>>,
    ) -> PyResult<(Array<'py>, Array<'py>)> {
        let (positions, actions) = (arrays::taken(&positions), actions.as_ref().map(arrays::taken));
        let (positions, velocities) = self.ask(py, move |model| {
            let input = arrays::flat(&positions, model.shape(), model.device)? / model.net.length_per_unit();
            let least = model.net.system.input_steps as i64;
            ensure!(input.size()[1] == least, "positions of {} frames: expected {least}, the input", input.size()[1]);
            ensure!(steps > 0, "steps = 0: at least one frame must be predicted");
            let actions = Actions::new(actions.map(|actions| arrays::tensor(&actions, model.device)));
            let (initial, states) = model.net.roll_out(&input, &actions, steps);
            let states = State::sequence(std::iter::once(&initial).chain(&states));
            let halves = states.chunk(2, 2);
            Ok((model.positions(&halves[0])?, model.positions(&halves[1])?))
        })?;
        Ok((arrays::given(py, positions), arrays::given(py, velocities)))
    }

    /// Frames `[clips, time, S, S, channels]` that positions `[clips, time, objects, coordinates]` look like.
    fn decode<'py>(&self, py: Python<'py>, positions: PyReadonlyArrayDyn<f32>) -> PyResult<Array<'py>> {
        let positions = arrays::taken(&positions);
        self.array(py, move |model| {
            let flat = arrays::flat(&positions, model.shape(), model.device)? / model.net.length_per_unit();
            let [clips, time] = [flat.size()[0], flat.size()[1]];
            let [drawn] = model.net.decoder.draw([&flat.flatten(0, 1)]);
            arrays::array(&arrays::channels_last(&drawn).unflatten(0, [clips, time]))
        })
    }

    /// Frames `[clips, time, S, S, channels]` of a split, as the model sees them.
    #[pyo3(signature = (split, first, count))]
    fn clips<'py>(&self, py: Python<'py>, split: &str, first: usize, count: usize) -> PyResult<Array<'py>> {
        let split = split.to_string();
        self.array(py, move |model| {
            let clips = &model.read(&split)?.clips;
            let chosen: Vec<i64> =
                (first..clips.len().min(first.saturating_add(count))).map(|clip| clip as i64).collect();
            ensure!(!chosen.is_empty(), "clip {first}: the split has {} clips, counted from 0", clips.len());
            arrays::array(&arrays::channels_last(&clips.batch(&chosen, clips.time())))
        })
    }

    /// Number of clips of a split, and of frames in each.
    fn lengths(&self, py: Python, split: &str) -> PyResult<(usize, usize)> {
        let split = split.to_string();
        self.ask(py, move |model| {
            let clips = &model.read(&split)?.clips;
            Ok((clips.len(), clips.time()))
        })
    }

    /// Predicts frames after the input of a clip. Returns the clip's frames, the predicted ones, positions and velocities.
    fn predict<'py>(
        &self,
        py: Python<'py>,
        split: &str,
        clip: usize,
        frames: usize,
    ) -> PyResult<(Array<'py>, Array<'py>, Array<'py>, Array<'py>)> {
        let split = split.to_string();
        let [seen, drawn, positions, velocities] = self.ask(py, move |model| {
            model.read(&split)?;
            let clips = &model.clips.as_ref().expect("it was read").1.clips;
            ensure!(clip < clips.len(), "clip {clip}: the split has {} clips, counted from 0", clips.len());
            let shown = clips.batch(&[clip as i64], clips.time()).squeeze_dim(0);
            let rolled = roll_out(&model.net, &shown, &clips.actions(&[clip as i64]), frames)?;
            let [objects, coordinates] = model.shape().map(|count| count as i64);
            let by_object = |states: &Tensor| arrays::array(&states.unflatten(1, [objects, coordinates]));
            let pixels = |frames: &Tensor| arrays::array(&arrays::channels_last(frames));
            Ok([
                pixels(&rolled.clip)?,
                pixels(&rolled.frames)?,
                by_object(&rolled.positions)?,
                by_object(&rolled.velocities)?,
            ])
        })?;
        let given = |array| arrays::given(py, array);
        Ok((given(seen), given(drawn), given(positions), given(velocities)))
    }

    /// The scores on a split, JSON.
    fn evaluate(&self, py: Python, split: &str) -> PyResult<String> {
        let split = split.to_string();
        self.ask(py, move |model| {
            model.read(&split)?;
            let clips = &model.clips.as_ref().expect("it was read").1;
            Ok(serde_json::to_string(&evaluation::evaluate(&model.net, clips)?)?)
        })
    }
}

impl Model {
    /// Asks the model's thread with the GIL released.
    fn ask<T: Send + 'static>(
        &self,
        py: Python,
        work: impl FnOnce(&mut Opened) -> Result<T> + Send + 'static,
    ) -> PyResult<T> {
        let (sender, answer) = channel();
        let job = move |model: &mut Opened| drop(sender.send(guarded(|| work(model))));
        let sent = self.jobs.lock().unwrap_or_else(PoisonError::into_inner).send(Box::new(job));
        let answer = Mutex::new(answer);
        let answered = py.detach(|| answer.lock().unwrap_or_else(PoisonError::into_inner).recv());
        let answered = if sent.is_ok() { answered.unwrap_or_else(|_| Err(gone())) } else { Err(gone()) };
        answered.map_err(|error| raised(py, error))
    }

    fn array<'py>(
        &self,
        py: Python<'py>,
        work: impl FnOnce(&mut Opened) -> Result<Floats> + Send + 'static,
    ) -> PyResult<Array<'py>> {
        Ok(arrays::given(py, self.ask(py, work)?))
    }
}

fn gone() -> anyhow::Error {
    anyhow!("the model's thread has ended")
}

impl Opened {
    /// Objects, and coordinates of each.
    fn shape(&self) -> [usize; 2] {
        [self.net.system.objects, self.net.system.cell.coordinates.per_object()]
    }

    fn frames(&self, frames: &Floats) -> Result<Tensor> {
        let system = &self.net.system;
        arrays::frames(frames, [system.side, system.channels], self.device)
    }

    /// Coordinates `[clips, time, coordinates * objects]` in pixels or radians, `[clips, time, objects, coordinates]`.
    fn positions(&self, positions: &Tensor) -> Result<Floats> {
        let [objects, coordinates] = self.shape().map(|count| count as i64);
        arrays::array(&(positions * self.net.length_per_unit()).unflatten(2, [objects, coordinates]))
    }

    /// The clips of a split: of the test file where it is `test`, else of the training file. They must be what the run was begun with.
    fn read(&mut self, split: &str) -> Result<&ScoredClips> {
        let split = Split::ALL.into_iter().find(|known| known.name() == split);
        let split = split.ok_or_else(|| anyhow!("split: expected train, valid or test"))?;
        if self.clips.as_ref().is_none_or(|(read, _)| *read != split) {
            let data = &self.config.data;
            let file = if split == Split::Test { data.test_path() } else { data.train_path() };
            let clips = ScoredClips::read(&file, &self.config.task, split, self.device)?;
            clips.ensure_of_run(&self.folder).with_context(|| file.display().to_string())?;
            self.clips = Some((split, clips));
        }
        Ok(&self.clips.as_ref().expect("it was just read").1)
    }
}
