//! The clips of a run.

use std::path::Path;

use anyhow::{Context, Result};
use tch::Device;

use super::observer::{Event, Observer};
use crate::datasets::dataset::Dataset;
use crate::datasets::files::{ClipShape, Split};
use crate::datasets::film::{FILM, FilmFile};
use crate::datasets::iterators::Clips;
use crate::datasets::states::States;
use crate::network::physics_models::PhysicsNet;
use crate::runs::checkpoint::DataChecksums;
use crate::training::config::Config;
use crate::training::trainer::Trainer;

/// The clips that a training learns from and is validated on.
#[derive(Debug)]
pub(super) struct TrainingData {
    pub train: Clips,
    pub valid: Clips,
    /// Checksums of both, of the film beside them and of the test clips.
    pub checksums: DataChecksums,
}

impl TrainingData {
    /// What would stop the scoring at the end must not cost the phases before: the test file is read, too, and dropped.
    pub fn load(config: &Config, device: Device, observer: &mut dyn Observer) -> Result<Self> {
        let path = config.data.train_path();
        let training = Dataset::open(&path, &ClipShape::training(&config.task))?;
        training.check_motion(&path)?;
        if training.is_on_disk() {
            let path = path.display();
            observer.observe(&Event::Note(&format!(
                "note: {path} is too large for the memory; its frames are read from the disk when they are wanted"
            )))?;
        }
        check_settings(&path, config, observer)?;
        let path = config.data.test_path();
        let test = Dataset::open(&path, &ClipShape::test(&config.task))?;
        check_settings(&path, config, observer)?;
        check_states(&path, &test, config).context("the run could not be scored at its end")?;
        let scored_on = test.scored_on();
        drop(test);
        let clips = |split| training.clips(split, device);
        let checksums = DataChecksums { clips: training.learned_from(), film: film_checksum(config)?, test: scored_on };
        let data = TrainingData { train: clips(Split::Train), valid: clips(Split::Valid), checksums };
        config.check_clips(&data.train)?;
        if data.train.flickers() {
            observer.observe(&Event::Note(
                "note: the light flickers from frame to frame; each frame is divided by its own",
            ))?;
        }
        Ok(data)
    }

    /// Refuses parameters that the config gives and the equation cannot have.
    pub(crate) fn check_start(&self, config: &Config, device: Device) -> Result<()> {
        let model = PhysicsNet::new(&config.task.system, &config.model, device, config.seed)?;
        Trainer::new(config, &model, &self.train, &self.valid)?.check_start()
    }
}

/// Checksum of the film that the run is measured by at its end, which must be readable; empty where the task has none.
fn film_checksum(config: &Config) -> Result<String> {
    let task = &config.task;
    let Some(video) = task.video().filter(|video| video.film_step.is_some()) else { return Ok(String::new()) };
    let path = config.data.train_path().with_file_name(FILM);
    let film = FilmFile::read(&path, video.sources.len(), task.system.side, task.system.channels);
    Ok(film.context("the run could not be measured at its end")?.checksum())
}

/// Refuses a file that was made for another system.
fn check_settings(path: &Path, config: &Config, observer: &mut dyn Observer) -> Result<()> {
    match States::settings_beside(path) {
        Ok(Some(settings)) => {
            let context = || format!("{} does not fit task {}", path.display(), config.task.name);
            settings.check(&config.task.system).with_context(context)
        }
        Ok(None) => Ok(()),
        // A training needs nothing of that file; of the test file it is read as a whole.
        Err(error) => {
            observer.observe(&Event::Note(&format!("note: {error:#}; how {} was made is not known", path.display())))
        }
    }
}

/// Refuses true states beside the test file that could not score the run.
fn check_states(path: &Path, test: &Dataset, config: &Config) -> Result<()> {
    let Some(states) = States::read(path, test)? else { return Ok(()) };
    let context = || format!("true states {}", States::path_beside(path).display());
    states.test.check(&config.task.system).with_context(context)
}
