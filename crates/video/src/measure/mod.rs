//! What a trained model measures in its own videos: parameters in the units of the scene, with intervals, from whole
//! videos instead of clips; how well what was held out is predicted; and all of it for people to look at.
//!
//! The model says where the objects are in every frame ([`compared_positions`]). The equation is fitted to that as one long trajectory
//! ([`mod@fit`]), in float64 and without images; a bootstrap over time says how far the result can be trusted ([`mod@bootstrap`]).
//! The last quarter of each video is predicted from the rest and held against two baselines. Not in the original.

mod attempts;
pub mod bootstrap;
mod candidates;
pub mod clock;
pub mod compare_track;
pub mod compared_positions;
pub mod coverage;
pub mod dynamics;
pub mod errors;
pub mod explain;
mod finished;
pub mod fit;
mod fits;
pub mod free_motion;
pub mod identifiability;
pub mod judgement;
mod jumps;
mod measured;
mod missing_term;
pub mod motion;
mod native;
pub mod normal_equations;
mod obstacles;
mod of_run;
mod of_video;
pub mod other_parts;
mod overlay;
mod page;
mod pictures;
mod positions_file;
mod proposals;
mod quantities;
pub mod recording;
pub mod results;
pub mod scale;
mod selection;
pub mod starts;
pub mod table;
pub mod takes;
pub mod trials;
mod trust;
mod view;
mod walls;

use std::ops::Range;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use tch::Device;

use self::attempts::Attempts;
use self::bootstrap::bootstrap;
use self::candidates::EquationCandidate;
use self::explain::{Explained, constant_velocity};
use self::finished::{FILES, Finished};
use self::fits::Fits;
use self::free_motion::free_motion;
use self::judgement::{Evidence, judge};
use self::missing_term::missing_term;
use self::motion::TrackMotion;
use self::native::{PositionSource, TrackedVideo};
use self::of_run::Learned;
pub use self::of_video::VideoRequest;
use self::other_parts::OtherPart;
use self::pictures::filmed;
use self::recording::{Observation, RecordedSystem};
use self::results::{Measurement, Quantity};
use self::selection::Selection;
use self::starts::KnownParameter;
use paig::Error;
use paig::network::cells::{CellKind, Equations};
use paig::runs::checkpoint::{DataChecksums, SavedWeights};
use paig::runs::summary::Summary;
use paig::support::atomic;
use paig::support::device::set_tf32;
use paig::support::guard::ensure_no_run;
use paig::support::run_names::CONFIG;
use paig::support::storage::storage;
use paig::tasks::equation_file::EquationFile;
use paig::training::saved::load_model;

/// An equation to be compared.
#[derive(Debug, Clone)]
struct ComparedEquation {
    /// For people: the file it stands in.
    name: String,
    cell: Arc<CellKind>,
}

impl ComparedEquation {
    fn of(file: &EquationFile, objects: usize) -> Result<Self> {
        let cell = file
            .equation
            .kind(objects, &Equations::default())
            .with_context(|| format!("equation file {}", file.name))?;
        Ok(ComparedEquation { name: file.name.clone(), cell })
    }
}

/// What is to be measured, and how.
#[derive(Debug, Clone, Default)]
pub struct MeasureRequest {
    /// In place of the run's own equation.
    pub equation: Option<EquationFile>,
    /// Held against it.
    pub against: Vec<EquationFile>,
}

/// Everything that a measurement is made of.
#[derive(Clone)]
struct Subject {
    task: String,
    scene: RecordedSystem,
    /// By one means each, the most precise first where that is known.
    observations: Vec<Observation>,
    /// Whether only the first observation is fitted, the others being held against it.
    first_counts: bool,
    /// Whether frames may be left out in which the object does not move by itself.
    may_be_cut: bool,
    pictures: Vec<pictures::PictureSource>,
    /// Parameters of a run.
    known: Vec<KnownParameter>,
    /// Diameters of the objects, pixels of the video; empty where they are not known.
    diameters: Vec<f64>,
    notes: Vec<String>,
    /// What speaks against every number.
    doubts: Vec<String>,
    /// Measurements of each take alone, whose scatter is part of the intervals.
    takes: Vec<Measurement>,
    /// Parts of the same videos that do not count, and with which the values must agree.
    other_parts: Vec<OtherPart>,
    training_seconds: Option<f64>,
    seed: u64,
}

/// Measures a finished run, and writes `measurement.json`, `measurement.html`, `measurement-positions.png`, `positions.csv` and
/// `overlay.gif` into `out`.
///
/// # Errors
/// A run whose task has no video or no film, or was imported again since; an equation that leads nowhere, a folder that
/// cannot be written.
pub fn measure(folder: &Path, request: &MeasureRequest, out: &Path, device: Device) -> Result<Measurement, Error> {
    Ok(measured_run(folder, request, out, device)?)
}

fn measured_run(folder: &Path, request: &MeasureRequest, out: &Path, device: Device) -> Result<Measurement> {
    let _guard = tch::no_grad_guard();
    let begun = Instant::now();
    let (config, model) = load_model(folder, SavedWeights::Last, device)?;
    set_tf32(device, config.model.tf32);
    let learned = Learned::read(&config, &model, &DataChecksums::of_run(folder)?, device)?;
    // Only for what can be measured: a name that is misspelt makes no folder.
    if !is_same(folder, out) {
        ensure_no_run(out)?;
    }
    FILES.settle(out)?;
    make_folder(out)?;
    let (scene, mut notes, by_model) = learned.observe()?;
    let record = config.task.video().context("the run's task has no video")?;
    let mut pictures = Vec::new();
    let mut tracked = Vec::new();
    for (video, recording) in scene.recordings.iter().enumerate() {
        match filmed(record, &learned.film, video) {
            Some((film, numbers)) => {
                notes.extend(pictures::other_times(record, &film, &numbers));
                let first = *numbers.iter().min().unwrap_or(&0);
                let end = numbers.iter().max().unwrap_or(&0) + 1;
                let options = paig_track::TrackingOptions { frames: Some(first..end), ..Default::default() };
                match TrackedVideo::of(&film, &options, scene.system.objects) {
                    Ok(mut of_film) => {
                        let units = (&scene.scale, &scene.system);
                        of_film.name_after(&by_model[0].recordings[video].pixels, &numbers, units);
                        tracked.push(of_film.positions(&numbers, PositionSource::Template, units));
                    }
                    Err(error) => notes.push(format!("tracker: {error:#}")),
                }
                pictures.push(pictures::PictureSource::Filmed(Rc::new(film)));
            }
            None => {
                notes.push(format!(
                    "{}: no longer where it was imported from, or another video by now; it is not tracked at its own \
                     resolution, and the overlay takes the frames as the model sees them",
                    recording.name
                ));
                pictures.push(pictures::PictureSource::Seen(learned.film.videos[video].clone()));
            }
        }
    }
    let by_tracker = (tracked.len() == scene.recordings.len())
        .then(|| Observation { by: "the tracker at the video's resolution".into(), recordings: tracked });
    let first_counts = by_tracker.is_some();
    let summary = Summary::read(folder)?;
    let subject = Subject {
        task: config.task.name.clone(),
        scene,
        observations: by_tracker.into_iter().chain(by_model).collect(),
        first_counts,
        may_be_cut: false,
        pictures,
        known: learned.known(),
        diameters: Vec::new(),
        notes,
        doubts: Vec::new(),
        takes: Vec::new(),
        other_parts: Vec::new(),
        training_seconds: summary.map(|summary| summary.wall_seconds),
        seed: config.seed,
    };
    let own = ComparedEquation { name: "the run's own".into(), cell: model.system.cell.clone() };
    subject.measured(own, Vec::new(), request, begun)?.write(out)
}

/// Whether a path is a run's folder rather than a video.
pub fn is_run(path: &Path) -> bool {
    path.is_dir() && path.join(CONFIG).exists()
}

/// Measures videos without a run: tracks the objects at the videos' resolution, fits the equation, and writes the same files as
/// [`measure`].
///
/// # Errors
/// A video that cannot be read, too few frames, nothing that moves, fewer objects than the equation has, an equation that leads
/// nowhere, a folder that cannot be written.
pub fn measure_videos(videos: &VideoRequest, against: &[EquationFile], out: &Path) -> Result<Measurement, Error> {
    let begun = Instant::now();
    let measured = || {
        let _guard = tch::no_grad_guard();
        ensure_no_run(out)?;
        FILES.settle(out)?;
        FILES.check(out)?;
        let films = videos.films()?;
        make_folder(out)?;
        let request = MeasureRequest { equation: None, against: against.to_vec() };
        let attempts = Attempts { videos, films: &films, request: &request, begun };
        let finished = if videos.takes { attempts.takes(out)? } else { attempts.best()? };
        finished.write(out)
    };
    Ok(measured()?)
}

fn is_same(one: &Path, other: &Path) -> bool {
    one.canonicalize().ok().zip(other.canonicalize().ok()).is_some_and(|(one, other)| one == other)
}

fn make_folder(out: &Path) -> Result<()> {
    FILES.check(out)?;
    storage().create_folder(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    atomic::check_place(&out.join(page::PAGE))
}

/// Leaves out of the only recording what comes before and after the part that the equation explains; a note, where that leaves
/// out anything.
fn cut_to_free_motion(
    scene: &mut RecordedSystem,
    observations: &mut [Observation],
    cell: &Arc<CellKind>,
) -> Result<Option<String>> {
    let track = recording::whole(&scene.tracks(&observations[0])).remove(0);
    let all = track.times.len();
    let Some(free) = free_motion(&scene.dynamics(cell)?, &track) else { return Ok(None) };
    if free.frames.len() == all {
        return Ok(None);
    }
    let note = note_of_part(&scene.recordings[0].numbers, &free.frames, all);
    observations.iter_mut().for_each(|observation| observation.cut(&free.frames, all));
    scene.cut(free.frames);
    Ok(Some(note))
}

/// Share of the frames that an equation with walls must explain: impacts are no reason to leave frames out.
const EXPLAINED_WITH_WALLS: f64 = 0.5;

impl RecordedSystem {
    /// Doubt about an equation with walls that explains less than half of the only recording in `before`.
    fn left_out(&self, cell: &Arc<CellKind>, before: &RecordedSystem) -> Result<Option<String>> {
        let frames =
            |scene: &RecordedSystem| scene.recordings.iter().map(|recording| recording.times.len()).sum::<usize>();
        let (taken, all) = (frames(self), frames(before));
        let few = (taken as f64) < EXPLAINED_WITH_WALLS * all as f64;
        Ok((few && self.dynamics(cell)?.has_walls()).then(|| {
            format!(
                "the equation explains {taken} of {all} frames, though it has walls: the motion has another cause, too"
            )
        }))
    }
}

/// Which of `all` frames are taken, by their numbers in the video.
fn note_of_part(numbers: &[u64], part: &Range<usize>, all: usize) -> String {
    let number = |place: usize| numbers.get(place).copied().unwrap_or(place as u64);
    format!(
        "the equation explains frames {}..{} of {} to {}: the others are left out (--frames chooses a part)",
        number(part.start),
        number(part.end - 1) + 1,
        number(0),
        number(all - 1)
    )
}

/// An observation whose fit leaves more than so many times the residual of the quoted one checks nothing.
const WORSE: f64 = 2.0;

/// Fit to another observation.
struct CrossCheck {
    judged: Explained,
    quantities: Vec<Quantity>,
    /// Whether its residuals are small enough to count against the quoted values.
    counts: bool,
}

impl Subject {
    fn cross_check(&self, scene: &RecordedSystem, explained: &Explained, other: &Observation) -> Result<CrossCheck> {
        let tracks = scene.tracks(other);
        let judged = scene.go_on(explained, &tracks)?;
        let tracks = recording::whole(&tracks);
        let whole = scene.go_on(&judged, &tracks)?;
        let counts = whole.fitted.usual_residual <= WORSE * explained.fitted.usual_residual;
        let quantities = scene.quantities_alone(&tracks, &whole, self.seed)?;
        Ok(CrossCheck { judged, quantities, counts })
    }

    /// Measured by the equation that explains it best, beside those it was chosen from.
    fn by_the_best(
        mut self,
        candidates: &[EquationCandidate],
        request: &MeasureRequest,
        begun: Instant,
    ) -> Result<Finished> {
        let numbers = self.scene.recordings[0].numbers.clone();
        let selection = Selection::of(&mut self.scene, &mut self.observations, candidates)?;
        self.notes.extend(selection.part.as_ref().map(|part| note_of_part(&numbers, part, numbers.len())));
        self.notes.extend(selection.notes());
        self.doubts.extend(selection.doubt());
        let mut ranked = selection.ranked.into_iter().map(|ranked| (ranked.candidate, ranked.explained));
        let (best, _) = ranked.next().context("no equation was fitted")?;
        self.scene.system.cell = best.cell.clone();
        let others = ranked.map(|(candidate, explained)| (candidate.name, explained)).collect();
        self.measured(ComparedEquation { name: best.name, cell: best.cell }, others, request, begun)
    }

    /// `compared`: equations that were fitted already.
    fn measured(
        &self,
        own: ComparedEquation,
        compared: Vec<(String, Explained)>,
        request: &MeasureRequest,
        begun: Instant,
    ) -> Result<Finished> {
        let Subject { known, .. } = self;
        let (mut scene, mut observations) = (self.scene.clone(), self.observations.clone());
        let named = |file: &EquationFile| ComparedEquation::of(file, scene.system.objects);
        let main = request.equation.as_ref().map(named).transpose()?.unwrap_or(own);
        let against = request.against.iter().map(named).collect::<Result<Vec<_>>>()?;
        let mut notes = self.notes.clone();
        let count = if self.first_counts { 1 } else { observations.len() };
        let mut fits = scene.fits(&main.cell, &observations[..count], known);
        if self.may_be_cut
            && scene.recordings.len() == 1
            && !fits.as_ref().is_ok_and(Fits::explain)
            && let Some(note) = cut_to_free_motion(&mut scene, &mut observations, &main.cell)?
        {
            notes.push(note);
            fits = scene.fits(&main.cell, &observations[..count], known);
        }
        let mut doubts = self.doubts.clone();
        doubts.extend(scene.left_out(&main.cell, &self.scene)?);
        doubts.extend(scene.jumps(&observations[0], &self.diameters));
        let Fits { observation, tracks, judged, whole_tracks, whole } = fits?;
        let uncertainty = bootstrap(&whole.dynamics, &whole_tracks, &whole.learned, &whole.fitted, self.seed)?;
        let other = observations.get(1).filter(|_| self.first_counts).map(|other| {
            let fit = self.cross_check(&scene, &judged, other);
            fit.with_context(|| format!("fit to {}", other.by))
        });
        let other = other.and_then(|fit| fit.map_err(|error| notes.push(format!("{error:#}"))).ok());
        let checked = other.as_ref().is_some_and(|other| other.counts);
        if other.is_some() && !checked {
            notes.push(format!("the cross-check ({}) is too noisy to count against the values", observations[1].by));
        }
        notes.extend(scene.notes(&whole_tracks, &whole, &uncertainty));
        let steady = constant_velocity(&tracks, judged.dynamics.coordinates());
        let held_out = scene.held_out(&tracks, &judged, &steady, other.as_ref().map(|other| &other.judged));
        let of_other = |name: &str| other.as_ref()?.quantities.iter().find(|quantity| quantity.name == name);
        let quantities = scene.quantities(&whole_tracks, &whole, &uncertainty).into_iter();
        let mut quantities: Vec<_> = quantities
            .map(|quantity| {
                let other = of_other(&quantity.name);
                quantity.beside(other)
            })
            .collect();
        takes::pool(&mut quantities, &self.takes);
        let residuals = scene.residuals(&whole, &uncertainty);
        let motion = TrackMotion::of(&tracks[0], judged.dynamics.coordinates());
        let (times, _) = scene.per_coordinate();
        let missing = missing_term(&scene, &tracks, &judged, self.seed);
        let frames = tracks[0].times.len();
        let parts = self.other_parts.iter().filter_map(|part| part.estimate(&main.cell, frames, self.seed));
        let parts: Vec<_> = parts.collect();
        let evidence = Evidence {
            missing: missing.as_ref(),
            checked,
            parts: &parts,
            doubts: &doubts,
            seen: motion.seen,
            chance: motion.chance,
            held_out: &held_out,
            residuals: &residuals,
            amplitude: times * motion.amplitude,
            noise: times * motion.noise,
        };
        let verdict = judge(&evidence, &mut quantities);
        let mut measurement = Measurement {
            format: results::FORMAT,
            task: self.task.clone(),
            videos: scene.recordings.iter().map(|recording| recording.name.clone()).collect(),
            frames: tracks.iter().map(|track| track.times.len()).sum(),
            learned_frames: tracks.iter().filter(|track| track.teaches).map(|track| track.trained).sum(),
            seconds_between_frames: scene.scale.seconds * scene.dt,
            equation: main.name.clone(),
            by: observations[observation].by.clone(),
            quantities,
            held_out,
            residuals,
            alternatives: Vec::new(),
            missing,
            scene: Some(scene.record_of(&main.cell)),
            diameters: self.diameters.clone(),
            notes,
            verdict: Some(verdict),
            training_seconds: self.training_seconds,
            seconds: 0.0,
        };
        let others = compared.into_iter().chain(scene.others(&against, &tracks, known)?).collect();
        measurement.alternatives = scene.alternatives((main.name, judged.clone()), others);
        measurement.seconds = begun.elapsed().as_secs_f64();
        let (observation, pictures) = (observations.swap_remove(observation), self.pictures.clone());
        Ok(Finished { measurement, scene, observation, explained: judged, pictures })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_that_is_not_there_makes_no_folder() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("rum");
        let error = measure(&run, &MeasureRequest::default(), &run, Device::Cpu).err().unwrap();
        assert!(format!("{error:#}").contains("is not a run folder") && !run.exists(), "{error:#}");
    }
}
