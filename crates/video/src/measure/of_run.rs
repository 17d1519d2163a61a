//! The scene of a trained run, as its model sees it: the frames of the film beside the clips, encoder and masks as the means
//! of observation.

use anyhow::{Context, Result, ensure};
use tch::Device;

use super::clock::FrameTimes;
use super::compared_positions::{self, ComparedPositions};
use super::recording::{Observation, Positions, RecordedSystem, Recording};
use super::scale::Scale;
use super::starts::KnownParameter;
use crate::import::hold_out::HoldOut;
use crate::import::names::TASK;
use paig::datasets::dataset::Dataset;
use paig::datasets::files::{ClipShape, Split};
use paig::datasets::film::{FILM, FilmFile};
use paig::datasets::iterators::Clips;
use paig::network::physics_models::PhysicsNet;
use paig::runs::checkpoint::DataChecksums;
use paig::support::statistics::upper_median;
use paig::tasks;
use paig::tasks::video::Video;
use paig::training::config::Config;

/// The encoder strays where it differs from the masks by so many times as much in the frames held out as in those learned
/// from, and by so many pixels of a frame.
const STRAYS: f64 = 3.0;
const LEAST_STRAY: f64 = 0.5;

/// A run and the film of its task.
pub(super) struct Learned<'a> {
    config: &'a Config,
    model: &'a PhysicsNet,
    record: &'a Video,
    pub film: FilmFile,
    train: Clips,
    /// Whether the task's file beside the clips says something else of the videos than the run.
    imported_again: bool,
}

impl<'a> Learned<'a> {
    /// The videos of a run that learned from clips and film with these checksums.
    ///
    /// # Errors
    /// A task without video or film, or one whose clips are others by now: then its film is another, too, and what the run
    /// knows of crop and times is not of that one.
    pub fn read(config: &'a Config, model: &'a PhysicsNet, before: &DataChecksums, device: Device) -> Result<Self> {
        let task = &config.task;
        let record =
            task.video().context("the run's task has no video; only what was made by `paig import` can be measured")?;
        record.film_step.context("the task was imported without a film; import its videos again")?;
        let path = config.data.train_path();
        let system = &model.system;
        let training = Dataset::open(&path, &ClipShape::training(task))?;
        let film_path = path.with_file_name(FILM);
        let film = FilmFile::read(&film_path, record.sources.len(), system.side, system.channels)?;
        let now = DataChecksums { clips: training.learned_from(), film: film.checksum(), ..DataChecksums::default() };
        let [same_clips, same_film, _] = now.is_as(before);
        ensure!(
            same_clips,
            "the clips in {} are not those that the run learned from: the video was imported again since. Import it as it \
             was, or train a new run on what is there now",
            path.display()
        );
        ensure!(
            same_film,
            "{} is not the film that lay beside the clips of the run; put it back, or import the video as it was",
            film_path.display()
        );
        let train = training.clips(Split::Train, device);
        let there = path.with_file_name(TASK).to_str().and_then(|file| tasks::find(file).ok());
        let imported_again = there.is_some_and(|there| there.video().is_some_and(|video| !video.says_the_same(record)));
        Ok(Learned { config, model, record, film, train, imported_again })
    }

    /// The scene, what is to be said of it, and the observations by the masks' centroids and by the encoder. Where the encoder
    /// strays it is left out.
    pub fn observe(&self) -> Result<(RecordedSystem, Vec<String>, Vec<Observation>)> {
        let names = self.record.source_names();
        let look = |(video, name): (usize, &String)| {
            compared_positions::look(self.model, &self.train, &self.film, video, self.config.seed)
                .with_context(|| format!("video {name}; import the videos again without it"))
        };
        let sights = names.iter().enumerate().map(look).collect::<Result<Vec<_>>>()?;
        let system = &self.model.system;
        let clocks = sights.iter().map(|sight| FrameTimes::of(&sight.centroids.pixels, 2 * system.objects));
        let clocks: Vec<_> = clocks.collect();
        let ratio = self.ratio();
        let dt = system.dt / ratio as f64;
        let recording = |(video, clock): (usize, &FrameTimes)| Recording {
            name: names[video].clone(),
            first_seconds: self.record.sources[video].first_seconds,
            times: clock.ticks.iter().map(|tick| *tick as f64 * dt).collect(),
            numbers: self.film.numbers[video].to_vec(),
            trained: self.trained(video, ratio),
            teaches: self.teaches(video),
        };
        let scene = RecordedSystem {
            record: self.record.clone(),
            system: system.clone(),
            scale: Scale::new(self.record, system),
            dt,
            piece: self.train.time() * ratio,
            may_drift: true,
            recordings: clocks.iter().enumerate().map(recording).collect(),
        };
        let mut notes = Vec::new();
        for (clock, recording) in clocks.iter().zip(&scene.recordings) {
            let said = clock.text(&recording.numbers);
            notes.extend(said.map(|said| format!("{}: by the steps of what moves, {said}", recording.name)));
        }
        if self.imported_again {
            notes.push(
                "the video was imported again since the run was begun, with another scale, other axes or other times; here \
                 those count with which the run was begun"
                    .into(),
            );
        }
        let strays =
            sights.iter().zip(&scene.recordings).any(|(sight, recording)| self.encoder_strays(sight, recording));
        let observation = |by: &str, of: &dyn Fn(&ComparedPositions) -> Positions| Observation {
            by: by.into(),
            recordings: sights.iter().map(of).collect(),
        };
        let mut observations = vec![observation("the masks' centroids", &|sight| sight.centroids.clone())];
        if !strays {
            observations.push(observation("the encoder's positions", &|sight| sight.encoded.clone()));
        }
        Ok((scene, notes, observations))
    }

    /// Whether the encoder misreads frames that were held out: it has learned no places but those where the objects were. Masks
    /// follow them anywhere.
    fn encoder_strays(
        &self,
        ComparedPositions { encoded, centroids }: &ComparedPositions,
        recording: &Recording,
    ) -> bool {
        let apart = encoded.pixels.iter().zip(&centroids.pixels).map(|(encoded, centroid)| (encoded - centroid).abs());
        let apart: Vec<f64> = apart.collect();
        let (learned, held_out) = apart.split_at(2 * self.model.system.objects * recording.trained);
        let usual = |apart: &[f64]| upper_median(apart.iter().copied()).unwrap_or(0.0);
        usual(held_out) > LEAST_STRAY.max(STRAYS * usual(learned))
    }

    /// Parameters as the run has learned them: where a fit begins.
    pub fn known(&self) -> Vec<KnownParameter> {
        let known = |parameter: &paig::network::physics_models::Parameter| KnownParameter {
            name: parameter.kind.name.to_string(),
            value: self.model.true_value(&parameter.kind, parameter.unconstrained.double_value(&[])),
            learned: parameter.learned,
        };
        self.model.parameters.iter().map(known).collect()
    }

    /// Frames of the film to one of a clip.
    fn ratio(&self) -> usize {
        self.record.step / self.record.film_step.unwrap_or(self.record.step)
    }

    /// Frames of a video that may be learned from: those from which clips for training were cut. Films of earlier versions do
    /// not say which frame is which: there the last quarter is held out. Of one that was held out whole it is the first half,
    /// which says how its motion begins.
    fn trained(&self, video: usize, ratio: usize) -> usize {
        let frames = self.film.videos[video].dim().0;
        let source = &self.record.sources[video];
        if source.is_learned_from() {
            return frames;
        }
        if !self.teaches(video) {
            return frames.div_ceil(2);
        }
        let numbers = &self.film.numbers[video];
        if numbers.is_empty() {
            return (HoldOut::of(frames.div_ceil(ratio)).valid.start * ratio).min(frames);
        }
        before_held_out(numbers, source.held_out_from)
    }

    /// Whether the frames of a video that may be learned from teach the parameters.
    fn teaches(&self, video: usize) -> bool {
        !self.record.sources[video].is_held_out()
    }
}

/// Frames of a film before the first one that was held out; `numbers` are those of its frames in the video.
fn before_held_out<'a>(numbers: impl IntoIterator<Item = &'a u64>, held_out_from: usize) -> usize {
    numbers.into_iter().take_while(|number| (**number as usize) < held_out_from).count()
}

#[cfg(test)]
mod tests {
    use super::{HoldOut, before_held_out};

    /// A regular clock shows frame 8 twice, where three quarters end: both were learned from, and no later one.
    #[test]
    fn what_was_held_out_begins_where_the_import_said() {
        let numbers = [0, 1, 2, 3, 4, 5, 6, 7, 8, 8, 9, 10];
        let parts = HoldOut::of(numbers.len());
        assert_eq!(parts.valid.start, 9);
        let held_out_from = numbers[parts.apart(&numbers).valid.start];
        assert_eq!(before_held_out(&numbers.map(|number| number as u64), held_out_from), 10);
    }
}
