//! A whole run: data, training, verdict, scores, pictures.
//!
//! Original: `run_physics.py`. [`Request::open`] finds the run's folder and config, [`Run::prepare`] reads what it needs,
//! [`Prepared::execute`] goes through it. All that is worth showing goes to an [`Observer`].
//!
//! A request is checked before anything is trained:
//!
//! ```
//! use paig::run::{Mode, Request};
//! use paig::training::layers::Overrides;
//!
//! let overrides = Overrides { task: Some("spring_color".into()), seed: Some(3), ..Overrides::default() };
//! let request = Request { overrides, ..Request::default() };
//! assert_eq!(request.config()?.seed, 3);
//!
//! // A run that is to be resumed must exist.
//! let missing = Request { mode: Mode::Resume, out: Some("no/such/run".into()), ..request };
//! assert!(missing.open().is_err());
//! # Ok::<(), paig::Error>(())
//! ```

mod data;
mod observer;
mod pace;
mod preview;
mod request;
mod scoring;

use anyhow::{Context, Result};
use tch::Device;

use crate::network::physics_models::PhysicsNet;
use crate::runs::checkpoint::{SavedWeights, Store};
use crate::runs::folder::RunFolder;
use crate::runs::summary::Summary;
use crate::support::error::Error;
use crate::support::{device, memory};
use crate::training::base::TrainingOutcome;
use crate::training::config::Config;
use crate::training::footprint::footprint;
use crate::training::recorder::Recorder;
use crate::training::saved::load_model;
use crate::training::tensorboard::EventFile;
use crate::training::trainer::Trainer;
use crate::training::verdict::judge;
use crate::viz;

use self::data::TrainingData;
use self::observer::TrainingRelay;
use self::request::RunPlace;
use self::scoring::{read_test, scored, summarize};

pub use observer::{Event, Observer, Stage};
pub use preview::Preview;
pub use request::{Mode, Request};
pub use scoring::TestResults;

/// The program that runs, as the results name it.
#[derive(Debug, Clone, Copy)]
pub struct Program<'a> {
    pub version: &'a str,
    /// Of its sources.
    pub commit: &'a str,
}

/// A run whose folder and config are known.
#[derive(Debug)]
pub struct Run {
    pub config: Config,
    place: RunPlace,
    mode: Mode,
}

/// A run that has what it needs: data, device, memory, a folder of its own.
#[derive(Debug)]
pub struct Prepared {
    pub config: Config,
    pub folder: RunFolder,
    pub device: Device,
    pub threads: usize,
    /// Bytes in memory now, and at most during the training, estimated; on a GPU not known.
    pub memory: Option<[u64; 2]>,
    /// None where an earlier run is only scored.
    data: Option<TrainingData>,
}

/// How a run ended.
#[derive(Debug)]
pub enum Ending {
    Finished(Box<Summary>),
    /// An earlier run was scored.
    Scored,
    /// Asked to stop after so many steps; saved, ready to resume.
    Interrupted {
        steps: u64,
    },
}

impl Run {
    /// Reads the data and checks that the run can go through to its end, then takes its folder.
    ///
    /// # Errors
    /// A device or data that are not there or do not fit the task, too little memory, parameters that the equation cannot
    /// have, a folder that cannot be taken; a config or data that an earlier run was not begun with.
    pub fn prepare(self, observer: &mut dyn Observer) -> Result<Prepared, Error> {
        Ok(self.prepared(observer)?)
    }

    fn prepared(self, observer: &mut dyn Observer) -> Result<Prepared> {
        let Run { config, place, mode } = self;
        let device = device::parse(&config.device)?;
        let threads = device::set_threads(config.threads)?;
        device::set_tf32(device, config.model.tf32);
        let data = match mode {
            Mode::Score => None,
            Mode::Begin | Mode::Resume => Some(TrainingData::load(&config, device, observer)?),
        };
        let needed = data.as_ref().filter(|_| device == Device::Cpu).map(|data| footprint(&config, data.train.len()));
        memory::ensure_free(needed.unwrap_or(0)).context(
            "this training needs more memory than there is; take smaller steps (join.batch, discover.frames)",
        )?;
        // What can fail at once has been tried: a folder is taken only by a run that begins.
        let folder = match place {
            RunPlace::Earlier(folder) => {
                let store = Store::new(folder.path());
                data.iter().try_for_each(|data| store.check_begun_with(&data.checksums))?;
                folder
            }
            RunPlace::New(path) => {
                data.iter().try_for_each(|data| data.check_start(&config, device))?;
                RunFolder::create(&path, &config.to_toml())?
            }
        };
        let now = memory::resident().map_or(0, |(now, _)| now);
        let memory = needed.map(|needed| [now, now + needed]);
        Ok(Prepared { config, folder, device, threads, memory, data })
    }
}

impl Prepared {
    /// Trains, judges, scores, writes numbers and pictures; an earlier run that is only scored is scored.
    ///
    /// `stop` is asked after each step. A run that stops saves a checkpoint and ends the same, to the bit, when it is
    /// resumed.
    ///
    /// # Errors
    /// A loss that is not finite, files that cannot be read or written, an observer's error.
    pub fn execute(
        &self,
        program: Program,
        observer: &mut dyn Observer,
        stop: &dyn Fn() -> bool,
    ) -> Result<Ending, Error> {
        self.go(program, observer, stop).map_err(Error::of_work)
    }

    fn go(&self, program: Program, observer: &mut dyn Observer, stop: &dyn Fn() -> bool) -> Result<Ending> {
        observer.observe(&Event::Begins(self))?;
        match &self.data {
            Some(data) => self.train(data, program, observer, stop),
            None => {
                let (_, model) = load_model(self.folder.path(), SavedWeights::Last, self.device)?;
                let results = scored(&model, read_test(&self.config, self.device)?)?;
                observer.observe(&Event::Scored { model: &model, results: &results })?;
                Ok(Ending::Scored)
            }
        }
    }

    fn train(
        &self,
        data: &TrainingData,
        program: Program,
        observer: &mut dyn Observer,
        stop: &dyn Fn() -> bool,
    ) -> Result<Ending> {
        let Prepared { config, folder, device, threads, .. } = self;
        let model = PhysicsNet::new(&config.task.system, &config.model, *device, config.seed)?;
        let mut recorder = Recorder::new(folder)?;
        let mut events = config.output.tensorboard.then(|| EventFile::new(folder)).transpose()?;
        let mut watch = TrainingRelay::new(config, &data.valid, observer);
        let mut trainer = Trainer::new(config, &model, &data.train, &data.valid)?
            .of_data(&data.checksums)
            .built_from(program.commit)
            .save_to(Store::new(folder.path()))
            .observed_by(&mut recorder)
            .observed_by(&mut watch)
            .stop_when(stop);
        if let Some(events) = &mut events {
            trainer = trainer.observed_by(events);
        }
        let outcome = trainer.run()?;
        let state = trainer.state().clone();
        drop(trainer);
        if outcome == TrainingOutcome::Interrupted {
            return Ok(Ending::Interrupted { steps: state.steps });
        }
        observer.observe(&Event::Begun(Stage::Scoring))?;
        let verdict = judge(config, &model, &data.train, &data.valid)?;
        // The true states lie beside the test file: nothing has learned from them before.
        let test = read_test(config, *device).with_context(|| {
            format!(
                "the training is finished and saved, but not scored; --resume --out {} does it",
                folder.path().display()
            )
        })?;
        let results = scored(&model, test)?;
        observer.observe(&Event::Ended(Stage::Scoring))?;
        observer.observe(&Event::Scored { model: &model, results: &results })?;
        let summary = summarize(
            config,
            &model,
            [data.train.len(), data.valid.len()],
            &results,
            verdict,
            &state,
            *threads,
            program,
        )?;
        summary.write(folder.path())?;
        observer.observe(&Event::Begun(Stage::Pictures))?;
        viz::write_artifacts(folder.path(), &model, &results.clips.clips, config.output.examples)?;
        viz::write_curves(folder.path(), &config.task, &results.clips.truth)?;
        observer.observe(&Event::Ended(Stage::Pictures))?;
        observer.observe(&Event::Finished { summary: &summary, state: &state })?;
        Ok(Ending::Finished(Box::new(summary)))
    }
}
