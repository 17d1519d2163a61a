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
mod fits;
pub mod motion;
pub mod normal_equations;
mod overlay;
mod page;
mod positions_file;
mod quantities;
pub mod results;
pub mod scale;
pub mod shown;
pub mod sight;
mod source;
mod subject;
pub mod table;
pub mod tracker;
mod trust;

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use tch::Device;

use self::bootstrap::bootstrap;
use self::explain::{Explained, constant_velocity};
use self::results::Measurement;
use self::scale::Scale;
use self::source::Passed;
use self::subject::Subject;
use paig::Error;
use paig::network::cells::CellKind;
use paig::runs::checkpoint::{SavedWeights, clips_of};
use paig::runs::summary::Summary;
use paig::support::atomic;
use paig::support::device::set_tf32;
use paig::support::storage::storage;
use paig::tasks::equation_file::EquationFile;
use paig::training::saved::load_model;

/// An equation to be compared.
#[derive(Debug, Clone)]
struct Named {
    /// For people: the file it stands in.
    name: String,
    cell: &'static CellKind,
}

impl Named {
    fn of(file: &EquationFile, objects: usize) -> Result<Self> {
        let cell = file.equation.kind(objects).with_context(|| format!("equation file {}", file.name))?;
        Ok(Named { name: file.name.clone(), cell })
    }
}

/// What is to be measured, and how.
#[derive(Debug, Clone, Default)]
pub struct Request {
    /// In place of the run's own equation.
    pub equation: Option<EquationFile>,
    /// Held against it.
    pub against: Vec<EquationFile>,
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
    /// Whether those frames taught, or only said how the motion begins.
    teaches: bool,
    /// When each frame was filmed.
    ticks: Vec<usize>,
    /// Which frames of the video they are, counted from 0; empty where the film does not say.
    numbers: Vec<u64>,
}

/// Measures a finished run, and writes `measurement.json`, `measurement.html`, `measurement-positions.png`, `positions.csv` and
/// `overlay.gif` into `out`.
///
/// # Errors
/// A run whose task has no video or no film, or was imported again since; an equation that leads nowhere, a folder that
/// cannot be written.
pub fn measure(folder: &Path, request: &Request, out: &Path, device: Device) -> Result<Measurement, Error> {
    Ok(measured(folder, request, out, device)?)
}

fn measured(folder: &Path, request: &Request, out: &Path, device: Device) -> Result<Measurement> {
    let _guard = tch::no_grad_guard();
    let begun = Instant::now();
    let (config, model) = load_model(folder, SavedWeights::Last, device)?;
    set_tf32(device, config.model.tf32);
    let mut subject = Subject::read(&config, &model, &clips_of(folder)?, device)?;
    // Only for what can be measured: a name that is misspelt makes no folder.
    storage().create_folder(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    atomic::check_place(&out.join("measurement.html"))?;
    let sights = subject.look()?;
    subject.find_lost_frames(&sights);
    let subject = subject;
    let named = |file: &EquationFile| Named::of(file, model.system.objects);
    let own = Named { name: "the run's own".into(), cell: model.system.cell };
    let main = request.equation.as_ref().map(named).transpose()?.unwrap_or(own);
    let against = request.against.iter().map(named).collect::<Result<Vec<_>>>()?;
    let (tracks, by_encoder, explained) = subject.best_of_sights(main.cell, &sights)?;
    let uncertainty = bootstrap(&explained.dynamics, &tracks, &explained.learned, &explained.fitted, config.seed)?;

    let passes = subject.passes()?;
    let tracker = subject.tracker_fit(&explained, &passes);
    let videos = subject.seen(&sights, by_encoder);
    let summary = Summary::read(folder)?;
    let verdict = summary.as_ref().and_then(|summary| summary.verdict.as_ref());
    let mut notes = Vec::new();
    if !verdict.is_none_or(|verdict| verdict.found) {
        notes.push("the run's own verdict is \"not found\": do not trust these numbers before you know why".into());
    }
    notes.extend(subject.notes(&tracks, &explained, &uncertainty));
    let gone = videos.iter().zip(&passes).filter(|(_, passed)| !passed.as_filmed).map(|(video, _)| video.name.as_str());
    let gone: Vec<&str> = gone.collect();
    if !gone.is_empty() {
        notes.push(format!(
            "{}: no longer where it was imported from, or another video by now; the colour tracker and the overlay take the \
             frames as the model sees them",
            gone.join(", ")
        ));
    }
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
        learned_frames: tracks.iter().filter(|track| track.teaches).map(|track| track.trained).sum(),
        seconds_between_frames: subject.scale.seconds * explained.dynamics.dt,
        equation: main.name.clone(),
        by: if by_encoder { "the encoder's positions" } else { "the masks' centroids" }.into(),
        quantities,
        held_out,
        residuals: subject.residuals(&explained, &uncertainty),
        alternatives: Vec::new(),
        notes,
        training_seconds: summary.map(|summary| summary.wall_seconds),
        seconds: 0.0,
    };
    measurement.alternatives = subject.alternatives(&main, &explained, &against, &tracks)?;
    measurement.seconds = begun.elapsed().as_secs_f64();
    let measured = Measured { measurement, scale: subject.scale.clone(), videos, explained, frames: &passes };
    positions_file::write(&out.join("positions.csv"), &measured)?;
    overlay::write(&out.join("overlay.gif"), &measured)?;
    page::write(out, &measured)?;
    measured.measurement.write(out)?;
    Ok(measured.measurement)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_that_is_not_there_makes_no_folder() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("rum");
        let error = measure(&run, &Request::default(), &run, Device::Cpu).err().unwrap();
        assert!(format!("{error:#}").contains("is not a run folder") && !run.exists(), "{error:#}");
    }
}
