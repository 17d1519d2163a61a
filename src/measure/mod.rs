//! What a trained model measures in its own videos: parameters in the units of the scene, with intervals, from whole
//! videos instead of clips; how well what was held out is predicted; and all of it for people to look at.
//!
//! The model says where the objects are in every frame ([`sight`]). The equation is fitted to that as one long trajectory
//! ([`mod@fit`]), in float64 and without images; a bootstrap over time says how far the result can be trusted ([`mod@bootstrap`]).
//! The last quarter of each video is predicted from the rest and held against two baselines. Not in the original.

pub mod bootstrap;
pub mod clock;
pub mod coverage;
pub mod dynamics;
pub mod errors;
pub mod explain;
pub mod fit;
pub mod motion;
pub mod normal_equations;
mod overlay;
mod page;
mod positions_file;
pub mod results;
pub mod scale;
pub mod sight;
mod source;
pub mod table;
pub mod tracker;

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use tch::Device;

use self::bootstrap::{Uncertainty, bootstrap};
use self::clock::Clock;
use self::dynamics::Dynamics;
use self::explain::{Errors, Explained, constant_velocity, explain, positions_of};
use self::fit::{Start, Track};
use self::results::{Alternative, HeldOut, Measurement, Quantity, Residuals};
use self::scale::Scale;
use self::sight::{Positions, Sight};
use self::source::{Frames, Passed};
use crate::datasets::dataset::Dataset;
use crate::datasets::files::{ClipShape, Split};
use crate::datasets::film::{FILM, FilmFile};
use crate::datasets::iterators::Clips;
use crate::import::hold_out::Parts;
use crate::network::System;
use crate::network::cells::{CellKind, Coordinates, PhysicalParameter};
use crate::network::physics_models::PhysicsNet;
use crate::runs::checkpoint::SavedWeights;
use crate::runs::summary::Summary;
use crate::tasks::video::Video;
use crate::training::config::Config;
use crate::training::identify::rank;
use crate::training::saved::load_model;

/// Draws of the bootstrap that are rolled out again: for what only a whole motion shows.
const ROLLED_OUT_DRAWS: usize = 200;
/// Difference of the Bayesian criterion from which on a drift of the camera is believed.
const CLEARLY_BETTER: f64 = 10.0;
/// The acceleration of gravity for which the length of a simple pendulum is given, m/s^2.
const STANDARD_GRAVITY: f64 = 9.80665;

/// An equation to be compared.
#[derive(Debug, Clone)]
pub struct Named {
    /// For people: the file it stands in.
    pub name: String,
    pub cell: &'static CellKind,
}

/// What is to be measured, and how.
#[derive(Debug, Clone, Default)]
pub struct Request {
    /// In place of the run's own equation.
    pub equation: Option<Named>,
    /// Held against it.
    pub against: Vec<Named>,
}

/// A measured run with all that its files are made of.
pub struct Measured<'a> {
    pub measurement: Measurement,
    scale: Scale,
    videos: Vec<Seen>,
    explained: Explained,
    frames: &'a [Passed],
}

/// What was seen in one video.
struct Seen {
    name: String,
    /// When its first frame is shown, seconds.
    first_seconds: f64,
    /// `(x, y)` of each object, pixels of a frame, frame by frame.
    pixels: Vec<f64>,
    trained: usize,
    /// When each frame was filmed.
    ticks: Vec<usize>,
}

/// Measures a finished run, and writes `measurement.json`, `measurement.html`, `positions.csv` and `overlay.gif` into
/// `out`.
///
/// # Errors
/// A run whose task has no video or no film, an equation that leads nowhere, a folder that cannot be written.
pub fn measure(folder: &Path, request: &Request, out: &Path, device: Device) -> Result<Measurement> {
    let _guard = tch::no_grad_guard();
    let begun = Instant::now();
    let (config, model) = load_model(folder, SavedWeights::Last, device)?;
    let mut subject = Subject::read(&config, &model, device)?;
    let sights = subject.look()?;
    subject.find_lost_frames(&sights);
    let subject = subject;
    let own = Named { name: "the run's own".into(), cell: model.system.cell };
    let main = request.equation.as_ref().unwrap_or(&own);
    let (tracks, by_encoder, explained) = subject.best_of_sights(main.cell, &sights)?;
    let uncertainty = bootstrap(&explained.dynamics, &tracks, &explained.learned, &explained.fitted, config.seed)?;

    let passes = subject.passes()?;
    let tracker = subject.tracker_fit(&explained, &passes);
    let videos = subject.seen(&sights, by_encoder);
    let mut notes = Vec::new();
    if !Summary::read(folder)?.and_then(|summary| summary.verdict).is_none_or(|verdict| verdict.found) {
        notes.push("the run's own verdict is \"not found\": do not trust these numbers before you know why".into());
    }
    notes.extend(subject.notes(&explained, &uncertainty));
    if let Err(error) = &tracker {
        notes.push(format!("colour tracker: {error:#}"));
    }
    let tracker = tracker.ok();
    let steady = constant_velocity(&tracks, explained.dynamics.coordinates());
    let held_out = subject.held_out(&tracks, &explained, &steady, tracker.as_ref());
    let quantities = subject.quantities(&tracks, &explained, &uncertainty, tracker.as_ref());
    let mut measurement = Measurement {
        format: results::FORMAT,
        task: config.task.name.clone(),
        videos: videos.iter().map(|video| video.name.clone()).collect(),
        frames: tracks.iter().map(|track| track.positions.len() / explained.dynamics.coordinates()).sum(),
        learned_frames: tracks.iter().map(|track| track.trained).sum(),
        seconds_between_frames: subject.scale.seconds * explained.dynamics.dt,
        equation: main.name.clone(),
        by: if by_encoder { "the encoder's positions" } else { "the masks' centroids" }.into(),
        quantities,
        held_out,
        residuals: subject.residuals(&explained, &uncertainty),
        alternatives: Vec::new(),
        notes,
        training_seconds: crate::runs::summary::Summary::read(folder)?.map(|summary| summary.wall_seconds),
        seconds: 0.0,
    };
    measurement.alternatives = subject.alternatives(main, &explained, request, &tracks, &uncertainty)?;
    measurement.seconds = begun.elapsed().as_secs_f64();
    std::fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let measured = Measured { measurement, scale: subject.scale.clone(), videos, explained, frames: &passes };
    positions_file::write(&out.join("positions.csv"), &measured)?;
    overlay::write(&out.join("overlay.gif"), &measured)?;
    page::write(out, &measured)?;
    measured.measurement.write(out)?;
    Ok(measured.measurement)
}

/// A run and the videos of its task.
struct Subject<'a> {
    config: &'a Config,
    model: &'a PhysicsNet,
    record: &'a Video,
    film: FilmFile,
    train: Clips,
    scale: Scale,
    /// Frames of the film to one of a clip.
    ratio: usize,
    /// When the frames of each video were filmed.
    clocks: Vec<Clock>,
}

impl<'a> Subject<'a> {
    fn read(config: &'a Config, model: &'a PhysicsNet, device: Device) -> Result<Self> {
        let task = &config.task;
        let record =
            task.video().context("the run's task has no video; only what was made by `import` can be measured")?;
        let film_step = record.film_step.context("the task was imported without a film; import its videos again")?;
        let path = config.data.train_path();
        let system = &model.system;
        let film = FilmFile::read(&path.with_file_name(FILM), record.sources.len(), system.side, system.channels)?;
        let training = Dataset::open(&path, &ClipShape::training(task))?;
        let train = training.clips(Split::Train, device);
        let (scale, ratio) = (Scale::new(record, system), record.step / film_step);
        let clocks = film.videos.iter().map(|frames| Clock::even(frames.dim().0)).collect();
        Ok(Subject { config, model, record, film, train, scale, ratio, clocks })
    }

    fn look(&self) -> Result<Vec<Sight>> {
        let videos = 0..self.film.videos.len();
        videos.map(|video| sight::look(self.model, &self.train, &self.film, video, self.config.seed)).collect()
    }

    fn find_lost_frames(&mut self, sights: &[Sight]) {
        let objects = self.model.system.objects;
        self.clocks = sights.iter().map(|sight| Clock::of(&sight.centroids.pixels, 2 * objects)).collect();
    }

    /// Frames of a video that may be learned from: those from which clips for training were cut. Of one that was held out
    /// whole it is the first half, which says where its motion begins.
    fn trained(&self, video: usize) -> usize {
        let frames = self.film.videos[video].dim().0;
        let source = &self.record.sources[video];
        if source.is_learned_from() {
            return frames;
        }
        if source.is_held_out() {
            return frames.div_ceil(2);
        }
        (Parts::of(frames.div_ceil(self.ratio)).valid.start * self.ratio).min(frames)
    }

    fn tracks<'b>(&self, positions: impl Iterator<Item = &'b Positions>) -> Vec<Track> {
        let track = |(video, positions): (usize, &Positions)| Track {
            positions: positions.coordinates.clone(),
            ticks: self.clocks[video].ticks.clone(),
            trained: self.trained(video),
        };
        positions.enumerate().map(track).collect()
    }

    fn dynamics(&self, cell: &'static CellKind) -> Result<Dynamics> {
        let system = System { cell, ..self.model.system.clone() };
        system.check()?;
        ensure!(
            cell.coordinates == self.model.system.cell.coordinates,
            "an equation for {:?} cannot be held against one for {:?}",
            cell.coordinates,
            self.model.system.cell.coordinates
        );
        Ok(Dynamics { dt: system.dt / self.ratio as f64, system })
    }

    /// Where fits begin: at what the run has learned, as far as the parameters are called the same, and where the equation
    /// itself starts.
    fn starts(&self, cell: &CellKind) -> Vec<Start> {
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
        let piece = self.train.time() * self.ratio;
        let start = |raw| Start { raw, learned: learned.clone(), piece };
        let mut starts = vec![start(learned_there.clone())];
        if own != learned_there {
            starts.push(start(own));
        }
        starts
    }

    /// The fit to that measure of the positions that the equation explains better; whether it is the encoder's.
    fn best_of_sights(&self, cell: &'static CellKind, sights: &[Sight]) -> Result<(Vec<Track>, bool, Explained)> {
        let (dynamics, starts) = (self.dynamics(cell)?, self.starts(cell));
        let by_centroids = self.tracks(sights.iter().map(|sight| &sight.centroids));
        let explained = explain(&dynamics, &by_centroids, &starts)?;
        // From where the other measure led to.
        let go_on = [Start { raw: explained.fitted.raw.clone(), ..starts[0].clone() }];
        let by_encoder = self.tracks(sights.iter().map(|sight| &sight.encoded));
        let encoded = explain(&dynamics, &by_encoder, &go_on)?;
        let (tracks, by_encoder, explained) = if encoded.fitted.usual_residual < explained.fitted.usual_residual {
            (by_encoder, true, encoded)
        } else {
            (by_centroids, false, explained)
        };
        let explained = self.with_drift(&tracks, &explained)?.unwrap_or(explained);
        Ok((tracks, by_encoder, explained))
    }

    /// The same with a camera that drifts, where that explains clearly more: looked for in a task of one video and one
    /// object.
    fn with_drift(&self, tracks: &[Track], explained: &Explained) -> Result<Option<Explained>> {
        let system = &self.model.system;
        if tracks.len() != 1 || system.objects != 1 || system.cell.coordinates != Coordinates::Position {
            return Ok(None);
        }
        let raw = [&explained.fitted.raw[..], &[0.0; 2]].concat();
        let learned = [&explained.learned[..], &[true; 2]].concat();
        let start = Start { raw, learned, piece: self.train.time() * self.ratio };
        let drifting = explain(&explained.dynamics, tracks, &[start])?;
        let frames_in_one = bootstrap::frames_in_one(&drifting.fitted, drifting.dynamics.coordinates());
        let gain = explained.criteria(frames_in_one).bic - drifting.criteria(frames_in_one).bic;
        Ok((gain > CLEARLY_BETTER).then_some(drifting))
    }

    fn seen(&self, sights: &[Sight], by_encoder: bool) -> Vec<Seen> {
        let names = self.record.source_names();
        let seen = |(video, sight): (usize, &Sight)| Seen {
            name: names[video].clone(),
            first_seconds: self.record.sources[video].first_seconds,
            pixels: if by_encoder { &sight.encoded } else { &sight.centroids }.pixels.clone(),
            trained: self.trained(video),
            ticks: self.clocks[video].ticks.clone(),
        };
        sights.iter().enumerate().map(seen).collect()
    }

    fn passes(&self) -> Result<Vec<Passed>> {
        let pass = |video| Frames::open(self.record, &self.film, video).pass(&self.scale, self.trained(video));
        (0..self.film.videos.len()).map(pass).collect()
    }

    /// The same equation, fitted to what a colour tracker sees.
    fn tracker_fit(&self, explained: &Explained, passes: &[Passed]) -> Result<(Vec<Track>, Explained)> {
        let system = &self.model.system;
        ensure!(
            system.objects == 1 && system.cell.coordinates == Coordinates::Position,
            "it follows one object, by its position"
        );
        let track = |(video, passed): (usize, &Passed)| Track {
            positions: passed.tracked.iter().flatten().copied().collect(),
            ticks: self.clocks[video].ticks.clone(),
            trained: self.trained(video),
        };
        let tracks: Vec<Track> = passes.iter().enumerate().map(track).collect();
        for track in &tracks {
            let missing = track.positions.iter().filter(|x| x.is_nan()).count();
            ensure!(2 * missing < track.positions.len(), "it sees the object in less than half of the frames");
        }
        let piece = self.train.time() * self.ratio;
        let start = Start { raw: explained.fitted.raw.clone(), learned: explained.learned.clone(), piece };
        let fitted = explain(&explained.dynamics, &tracks, &[start])?;
        Ok((tracks, fitted))
    }

    /// From the unit of a coordinate to pixels of the video, or radians.
    fn per_coordinate(&self) -> (f64, &'static str) {
        match self.model.system.cell.coordinates {
            Coordinates::Position => (self.scale.video_pixels, "px"),
            Coordinates::Angle => (1.0, "rad"),
        }
    }

    fn held_out(
        &self,
        tracks: &[Track],
        explained: &Explained,
        steady: &[Vec<f64>],
        tracker: Option<&(Vec<Track>, Explained)>,
    ) -> HeldOut {
        let (times, unit) = self.per_coordinate();
        let coordinates = explained.dynamics.coordinates();
        let along = motion::along_the_way(&positions_of(&explained.states[0], coordinates), coordinates);
        HeldOut {
            frames: tracks.iter().map(|it| it.positions.len() / coordinates - it.trained).sum(),
            unit: unit.into(),
            error: times * explained.errors.held_out,
            constant_velocity: times * Errors::of(tracks, steady, &explained.dynamics).held_out,
            tracker_fit: tracker.map(|(_, fit)| times * fit.errors.held_out),
            percent_of_amplitude: 100.0 * explained.errors.held_out
                / motion::amplitude(&along[..trained_ticks(&tracks[0])]),
            metres_per_unit: (unit == "px" && self.scale.length_unit() == "m")
                .then(|| self.scale.length() / self.scale.video_pixels),
        }
    }

    fn quantities(
        &self,
        tracks: &[Track],
        explained: &Explained,
        uncertainty: &Uncertainty,
        tracker: Option<&(Vec<Track>, Explained)>,
    ) -> Vec<Quantity> {
        let parameters = explained.dynamics.system.cell.parameters.iter().enumerate();
        let parameters = parameters.filter(|(place, _)| explained.learned[*place]).map(|(place, parameter)| {
            let powers = Scale::powers(parameter);
            let value = |raw: &[f64]| parameter.bounds.value(raw[place]);
            let in_frames = value(&explained.fitted.raw);
            let factor = powers.map_or(1.0, |powers| self.scale.factor(powers));
            let draws = uncertainty
                .draws
                .iter()
                .map(|draw| value(&draw.raw) * powers.map_or(1.0, |powers| self.scale.drawn(powers, draw)));
            Quantity::new(parameter.name, factor * in_frames, draws.collect())
                .in_unit(powers.map_or("?".into(), |powers| self.scale.unit(powers)))
                .in_frames(in_frames)
                .of_tracker(tracker.map(|(_, fit)| factor * value(&fit.fitted.raw)))
        });
        let mut quantities: Vec<Quantity> = parameters.collect();
        quantities.extend(self.drift(explained, uncertainty));
        quantities.extend(self.of_the_swing(tracks, explained, uncertainty, tracker));
        quantities
    }

    /// By how much the camera drifts, if it does, pixels of the video in a second.
    fn drift(&self, explained: &Explained, uncertainty: &Uncertainty) -> Vec<Quantity> {
        let first = explained.dynamics.system.cell.parameters.len();
        let times = self.scale.video_pixels / self.scale.seconds;
        let names = ["drift_of_what_is_seen_x", "drift_of_what_is_seen_y"];
        let drifts = explained.fitted.raw[first..].iter().zip(names).enumerate();
        let quantity = |(place, (drift, name)): (usize, (&f64, &str))| {
            let draws = uncertainty.draws.iter().map(|draw| times * draw.raw[first + place]);
            Quantity::new(name, times * drift, draws.collect()).in_unit("px/s".into())
        };
        drifts.map(quantity).collect()
    }

    /// Period and effective length of a motion that swings, in the first video.
    fn of_the_swing(
        &self,
        tracks: &[Track],
        explained: &Explained,
        uncertainty: &Uncertainty,
        tracker: Option<&(Vec<Track>, Explained)>,
    ) -> Vec<Quantity> {
        let coordinates = explained.dynamics.coordinates();
        let second = self.scale.seconds * explained.dynamics.dt;
        let swing = |states: &[f64]| motion::along_the_way(&positions_of(states, coordinates), coordinates);
        let along = swing(&explained.states[0]);
        let Some(frames) = motion::period(&along) else { return Vec::new() };
        let drawn = uncertainty.draws.iter().take(ROLLED_OUT_DRAWS).map(|draw| {
            let states = explained.dynamics.roll_out(&draw.raw, &draw.states[0], 0, along.len());
            let along = swing(&states);
            (
                motion::period(&along).unwrap_or(f64::NAN) * self.scale.drawn([0, 1], draw) * explained.dynamics.dt,
                motion::amplitude(&along[..trained_ticks(&tracks[0])]),
            )
        });
        let (periods, amplitudes): (Vec<f64>, Vec<f64>) = drawn.unzip();
        let of_tracker = tracker.and_then(|(_, fit)| Some(second * motion::period(&swing(&fit.states[0]))?));
        let length = |period: f64| STANDARD_GRAVITY * (period / std::f64::consts::TAU).powi(2);
        let lengths = periods.iter().map(|period| length(*period)).collect();
        let (times, unit) = self.per_coordinate();
        vec![
            Quantity::new("period", second * frames, periods).in_unit("s".into()).of_tracker(of_tracker),
            Quantity::new("length_of_a_simple_pendulum", length(second * frames), lengths)
                .in_unit("m".into())
                .of_tracker(of_tracker.map(length)),
            Quantity::new(
                "amplitude",
                times * motion::amplitude(&along[..trained_ticks(&tracks[0])]),
                amplitudes.into_iter().map(|amplitude| times * amplitude).collect(),
            )
            .in_unit(unit.into()),
        ]
    }

    fn residuals(&self, explained: &Explained, uncertainty: &Uncertainty) -> Residuals {
        let (times, unit) = self.per_coordinate();
        Residuals {
            unit: unit.into(),
            usual: times * explained.fitted.usual_residual,
            usual_in_pieces: times * explained.fitted.piecewise_residual,
            distance: times * explained.errors.learned,
            autocorrelation: uncertainty.autocorrelation.clone(),
            frames_in_one: uncertainty.frames_in_one,
            block: uncertainty.block,
        }
    }

    fn notes(&self, explained: &Explained, uncertainty: &Uncertainty) -> Vec<String> {
        let mut notes = Vec::new();
        for (clock, name) in self.clocks.iter().zip(self.record.source_names()) {
            let said = clock.text();
            notes.extend(said.map(|said| format!("{name}: by the steps of what moves, {said} (taken into account)")));
        }
        let parameters = explained.dynamics.system.cell.parameters.iter().zip(&explained.learned);
        let learned: Vec<_> = parameters.filter(|(_, learned)| **learned).map(|(kind, _)| kind).collect();
        // Those of a drift come last.
        let count = learned.len() as i64;
        let curvature = uncertainty.curvature.narrow(0, 0, count).narrow(1, 0, count);
        notes.extend(rank::indistinct(&curvature, &learned).map(|indistinct| indistinct.text()));
        if explained.learned.len() > explained.dynamics.system.cell.parameters.len() {
            notes.push(
                "all that is seen drifts evenly: the camera or what holds the object moves (taken into account)".into(),
            );
        }
        let (whole, pieces) = (explained.fitted.usual_residual, explained.fitted.piecewise_residual);
        if whole > 2.0 * pieces {
            let (times, unit) = self.per_coordinate();
            notes.push(format!(
                "over the whole video the equation leaves {:.3} {unit} of the positions, over short parts only {:.3} {unit}: \
                 something is missing in it",
                times * whole,
                times * pieces
            ));
        }
        if self.scale.length_unit() == "px" {
            notes.push(
                "the scale is not known (--scale, --pixels-per-metre): lengths are in pixels of the video".into(),
            );
        }
        notes
    }

    /// The equation and those it is compared with, fitted to the same positions.
    fn alternatives(
        &self,
        main: &Named,
        explained: &Explained,
        request: &Request,
        tracks: &[Track],
        uncertainty: &Uncertainty,
    ) -> Result<Vec<Alternative>> {
        if request.against.is_empty() {
            return Ok(Vec::new());
        }
        let (times, _) = self.per_coordinate();
        let mut all = vec![(main.name.clone(), explained.clone())];
        for Named { name, cell } in &request.against {
            let explained = explain(&self.dynamics(cell)?, tracks, &self.starts(cell));
            let explained = explained.with_context(|| format!("equation of {name}"))?;
            all.push((name.clone(), self.with_drift(tracks, &explained)?.unwrap_or(explained)));
        }
        // The residuals of the best one say how many positions are independent.
        let frames_in_one = uncertainty.frames_in_one;
        Ok(all
            .into_iter()
            .map(|(name, explained)| {
                let criteria = explained.criteria(frames_in_one);
                Alternative {
                    equation: name,
                    unknowns: criteria.unknowns,
                    residual: times * explained.errors.learned,
                    held_out_error: times * explained.errors.held_out,
                    aic: criteria.aic,
                    bic: criteria.bic,
                    parameters: explained.parameters(&self.scale),
                }
            })
            .collect())
    }
}

impl Explained {
    /// The learned parameters in the units of the scene.
    fn parameters(&self, scale: &Scale) -> std::collections::BTreeMap<String, f64> {
        let parameters = self.dynamics.system.cell.parameters.iter().enumerate();
        let learned = parameters.filter(|(place, _)| self.learned[*place]);
        let value = |(place, kind): (usize, &PhysicalParameter)| {
            let factor = Scale::powers(kind).map_or(1.0, |powers| scale.factor(powers));
            (kind.name.to_string(), factor * kind.bounds.value(self.fitted.raw[place]))
        };
        learned.map(value).collect()
    }
}

/// Frames of an even clock in the part that may be learned from.
fn trained_ticks(track: &Track) -> usize {
    track.ticks[track.trained - 1] + 1
}
