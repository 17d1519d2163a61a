//! What is measured: a run, the videos of its task, and what fits to them begin with.

use anyhow::{Context, Result, ensure};
use tch::Device;

use super::Seen;
use super::clock::Clock;
use super::dynamics::Dynamics;
use super::fit::{Start, Track};
use super::scale::Scale;
use super::sight::{self, Positions, Sight};
use super::source::{Frames, Passed};
use crate::import::TASK;
use crate::import::hold_out::Parts;
use paig::datasets::dataset::{Dataset, are_the_same};
use paig::datasets::files::{ClipShape, Split};
use paig::datasets::film::{FILM, FilmFile};
use paig::datasets::iterators::Clips;
use paig::network::System;
use paig::network::cells::{CellKind, Coordinates, PhysicalParameter};
use paig::network::physics_models::PhysicsNet;
use paig::tasks;
use paig::tasks::video::Video;
use paig::training::config::Config;

/// A run and the videos of its task.
pub(super) struct Subject<'a> {
    config: &'a Config,
    pub(super) model: &'a PhysicsNet,
    pub(super) record: &'a Video,
    film: FilmFile,
    train: Clips,
    pub(super) scale: Scale,
    /// Frames of the film to one of a clip.
    ratio: usize,
    /// When the frames of each video were filmed.
    pub(super) clocks: Vec<Clock>,
    /// Whether the task's file beside the clips says something else of the videos than the run.
    pub(super) imported_again: bool,
}

impl<'a> Subject<'a> {
    /// The videos of a run that learned from the clips with these checksums, if it says from which.
    ///
    /// # Errors
    /// A task without video or film, or one whose clips are others by now: then its film is another, too, and what the run
    /// knows of crop and times is not of that one.
    pub(super) fn read(config: &'a Config, model: &'a PhysicsNet, clips: &str, device: Device) -> Result<Self> {
        let task = &config.task;
        let record =
            task.video().context("the run's task has no video; only what was made by `paig import` can be measured")?;
        let film_step = record.film_step.context("the task was imported without a film; import its videos again")?;
        let path = config.data.train_path();
        let system = &model.system;
        let training = Dataset::open(&path, &ClipShape::training(task))?;
        ensure!(
            clips.is_empty() || are_the_same(&training.learned_from(), clips),
            "the clips in {} are not those that the run learned from: the video was imported again since. Import it as it \
             was, or train a new run on what is there now",
            path.display()
        );
        let film = FilmFile::read(&path.with_file_name(FILM), record.sources.len(), system.side, system.channels)?;
        let train = training.clips(Split::Train, device);
        let there = path.with_file_name(TASK).to_str().and_then(|file| tasks::find(file).ok());
        let imported_again = there.is_some_and(|there| there.video().is_some_and(|video| !video.says_the_same(record)));
        let (scale, ratio) = (Scale::new(record, system), record.step / film_step);
        let clocks = film.videos.iter().map(|frames| Clock::even(frames.dim().0)).collect();
        Ok(Subject { config, model, record, film, train, scale, ratio, clocks, imported_again })
    }

    /// Of each video which frames of it the film holds; empty where that does not say.
    pub(super) fn frame_numbers(&self) -> impl Iterator<Item = &[u64]> {
        self.film.numbers.iter().map(|numbers| numbers.as_slice().unwrap_or_default())
    }

    pub(super) fn look(&self) -> Result<Vec<Sight>> {
        let look = |(video, name): (usize, String)| {
            sight::look(self.model, &self.train, &self.film, video, self.config.seed)
                .with_context(|| format!("video {name}; import the videos again without it"))
        };
        self.record.source_names().into_iter().enumerate().map(look).collect()
    }

    pub(super) fn find_lost_frames(&mut self, sights: &[Sight]) {
        let objects = self.model.system.objects;
        self.clocks = sights.iter().map(|sight| Clock::of(&sight.centroids.pixels, 2 * objects)).collect();
    }

    /// Frames of a video that may be learned from: those from which clips for training were cut. Films of earlier versions do
    /// not say which frame is which: there the last quarter is held out. Of one that was held out whole it is the first half,
    /// which says how its motion begins.
    pub(super) fn trained(&self, video: usize) -> usize {
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
            return (Parts::of(frames.div_ceil(self.ratio)).valid.start * self.ratio).min(frames);
        }
        before_held_out(numbers, source.held_out_from)
    }

    /// Whether the frames of a video that may be learned from teach the parameters.
    pub(super) fn teaches(&self, video: usize) -> bool {
        !self.record.sources[video].is_held_out()
    }

    pub(super) fn tracks<'b>(&self, positions: impl Iterator<Item = &'b Positions>) -> Vec<Track> {
        let track = |(video, positions): (usize, &Positions)| Track {
            positions: positions.coordinates.clone(),
            ticks: self.clocks[video].ticks.clone(),
            trained: self.trained(video),
            teaches: self.teaches(video),
        };
        positions.enumerate().map(track).collect()
    }

    pub(super) fn dynamics(&self, cell: &'static CellKind) -> Result<Dynamics> {
        let system = System { cell, ..self.model.system.clone() };
        system.check()?;
        ensure!(
            cell.coordinates == self.model.system.cell.coordinates,
            "an equation for {:?} cannot be held against one for {:?}",
            cell.coordinates,
            self.model.system.cell.coordinates
        );
        let dt = system.dt / self.ratio as f64;
        Dynamics::new(system, dt)
    }

    /// Frames of the film in the pieces with which a fit begins: as many as a clip spans.
    pub(super) fn piece(&self) -> usize {
        self.train.time() * self.ratio
    }

    /// Where fits begin: at what the run has learned, as far as the parameters are called the same, and where the equation
    /// itself starts.
    pub(super) fn starts(&self, cell: &CellKind) -> Vec<Start> {
        let model = self.model;
        let of_run = |name: &str| model.parameters.iter().find(|parameter| parameter.kind.name == name);
        let own =
            cell.parameters.iter().map(|kind| kind.fixed.or(kind.start).map_or(0.0, |value| kind.bounds.raw(value)));
        let own: Vec<f64> = own.collect();
        // What another equation gives as fixed stays as it is given there.
        let taken_over =
            |kind: &PhysicalParameter| of_run(kind.name).filter(|_| kind.fixed.is_none() || model.system.cell == cell);
        let learned_there = cell.parameters.iter().zip(&own).map(|(kind, own)| match taken_over(kind) {
            Some(it) => Some(kind.bounds.raw(model.true_value(it.kind, it.raw.double_value(&[]))))
                .filter(|raw| raw.is_finite())
                .unwrap_or(*own),
            None => *own,
        });
        let learned_there: Vec<f64> = learned_there.collect();
        let learned: Vec<bool> = cell
            .parameters
            .iter()
            .map(|kind| match of_run(kind.name) {
                Some(it) if model.system.cell == cell => it.learned,
                _ => kind.fixed.is_none(),
            })
            .collect();
        // What is not learned is given in every start.
        let raw = learned.iter().zip(own.iter().zip(&learned_there));
        let own: Vec<f64> = raw.map(|(learned, (own, there))| if *learned { *own } else { *there }).collect();
        let start = |raw| Start { raw, learned: learned.clone(), piece: self.piece() };
        let mut starts = vec![start(learned_there.clone())];
        if own != learned_there {
            starts.push(start(own));
        }
        starts
    }

    pub(super) fn seen(&self, sights: &[Sight], by_encoder: bool) -> Vec<Seen> {
        let names = self.record.source_names();
        let seen = |(video, sight): (usize, &Sight)| Seen {
            name: names[video].clone(),
            first_seconds: self.record.sources[video].first_seconds,
            pixels: if by_encoder { &sight.encoded } else { &sight.centroids }.pixels.clone(),
            trained: self.trained(video),
            teaches: self.teaches(video),
            ticks: self.clocks[video].ticks.clone(),
            numbers: self.film.numbers[video].to_vec(),
        };
        sights.iter().enumerate().map(seen).collect()
    }

    pub(super) fn passes(&self) -> Result<Vec<Passed>> {
        let pass = |video| Frames::open(self.record, &self.film, video).pass(&self.scale, self.trained(video));
        (0..self.film.videos.len()).map(pass).collect()
    }

    /// From the unit of a coordinate to pixels of the video, or radians.
    pub(super) fn per_coordinate(&self) -> (f64, &'static str) {
        match self.model.system.cell.coordinates {
            Coordinates::Position => (self.scale.video_pixels, "px"),
            Coordinates::Angle => (1.0, "rad"),
        }
    }
}

/// Frames of an even clock in the part that may be learned from.
pub(super) fn trained_ticks(track: &Track) -> usize {
    track.ticks[track.trained - 1] + 1
}

/// Frames of a film before the first one that was held out; `numbers` are those of its frames in the video.
fn before_held_out<'a>(numbers: impl IntoIterator<Item = &'a u64>, held_out_from: usize) -> usize {
    numbers.into_iter().take_while(|number| (**number as usize) < held_out_from).count()
}

#[cfg(test)]
mod tests {
    use super::{Parts, before_held_out};

    /// A regular clock shows frame 8 twice, where three quarters end: both were learned from, and no later one.
    #[test]
    fn what_was_held_out_begins_where_the_import_said() {
        let numbers = [0, 1, 2, 3, 4, 5, 6, 7, 8, 8, 9, 10];
        let parts = Parts::of(numbers.len());
        assert_eq!(parts.valid.start, 9);
        let held_out_from = numbers[parts.apart(&numbers).valid.start];
        assert_eq!(before_held_out(&numbers.map(|number| number as u64), held_out_from), 10);
    }
}
