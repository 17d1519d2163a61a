//! Training of an end-to-end baseline, by the loop and in the files of any other run.
//!
//! The folder of such a run holds `model.toml` (what is trained), `metrics.jsonl`, `log.txt`, `checkpoints/`, and at the end
//! `scores.json` and `outputs.npz`, of the weights of the best validation.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use tch::Tensor;

use super::checkpoint;
use super::config::{self, EndToEndConfig, MODEL};
use super::descent::{Descent, PHASE, Trainee};
use super::frame_model::{self, FrameModel};
use super::scores::{self, EndToEndScores, SCORES};
use paig::network::System;
use paig::runs::checkpoint::{DataChecksums, Store};
use paig::runs::folder::RunFolder;
use paig::runs::metrics::{Record, RecordKind};
use paig::support::atomic;
use paig::training::base::{Intervals, Session, TrainingOutcome, Validation};
use paig::training::objective::Objective;
use paig::training::observer::{TrainingEvent, TrainingObserver};
use paig::training::optimizers::OptimizerKind;
use paig::training::recorder::Recorder;
use paig::{Error, viz};
use paig_kernels::own_stream;

pub use super::data::EndToEndData;

/// Clips on which a model is validated, at most.
const VALIDATION_CLIPS: usize = 100;

/// Begins a run in its folder, or goes on with it, and scores its best weights at its end. `stop` is asked after every step;
/// `tell` is given each validation.
///
/// # Errors
/// A folder that holds another run or one on other clips, a damaged checkpoint, a loss that is not a number, a full disk.
pub fn train(
    config: &EndToEndConfig,
    system: &System,
    data: EndToEndData,
    folder: &Path,
    stop: &dyn Fn() -> bool,
    tell: &mut dyn FnMut(&Record),
) -> Result<TrainingOutcome> {
    config.check()?;
    let least = config.model.least_side();
    ensure!(system.side >= least, "frames of {} pixels: this model needs frames of {least} or more", system.side);
    let run = open(config, folder)?;
    if EndToEndScores::read(folder)?.is_some() {
        return Ok(TrainingOutcome::Finished);
    }
    let device = data.train.device();
    own_stream(device)?;
    let model = config.model.build(system, config.kernels, config.seed, device);
    let trainee = Trainee { model: model.as_ref(), system, kernels: config.kernels };
    let mut descent = Descent::new(config, data)?;
    let mut recorder = Recorder::new(&run)?;
    let mut validations = Validations(tell);
    let validation = Validation { clips: VALIDATION_CLIPS, pass: config.batch, batch: config.batch };
    let intervals = Intervals { print: config.checkpoint_every, checkpoint: config.checkpoint_every };
    let mut session =
        Session::new(&trainee, &config.task, [data.train, data.valid], config.seed, validation, intervals);
    session.save_to(Store::new(folder));
    session.observed_by(&mut recorder);
    session.observed_by(&mut validations);
    session.stop_when(stop);
    let checksums = DataChecksums { clips: data.checksums.into(), ..DataChecksums::default() };
    session.resume(&checksums).with_context(|| folder.display().to_string())?;
    if session.state.step == 0 {
        model.begin(data.train);
    }
    let trained = session.train_phase(PHASE, &mut descent, OptimizerKind::Adam, 0.0).map_err(Error::of_work)?;
    if trained == TrainingOutcome::Interrupted {
        return Ok(trained);
    }
    let (step, error) = session.best_validation(descent.timetable());
    let best = scores::ValidationScore { step, error };
    let results = write_results(config, model.as_ref(), system, data, (session.elapsed(), best), folder);
    results.map_err(Error::of_work)?;
    Ok(TrainingOutcome::Finished)
}

/// Passes validations on.
struct Validations<'a>(&'a mut dyn FnMut(&Record));

impl<M> TrainingObserver<M> for Validations<'_> {
    fn observe(&mut self, event: &TrainingEvent<M>) -> Result<()> {
        if let TrainingEvent::Recorded { record, .. } = event
            && record.kind == RecordKind::Valid
        {
            (self.0)(record);
        }
        Ok(())
    }
}

/// Takes a folder for this run, or finds it there; for this program alone while the folder is open.
fn open(config: &EndToEndConfig, folder: &Path) -> Result<RunFolder> {
    let text = toml::to_string_pretty(config)?;
    let run = RunFolder::enter(folder, MODEL)?;
    match config::read(folder)? {
        Some(saved) => {
            ensure!(saved == *config, "{} was begun with other options; choose another folder", folder.display());
        }
        None => atomic::write_file(&folder.join(MODEL), |file| Ok(std::io::Write::write_all(file, text.as_bytes())?))?,
    }
    checkpoint::ensure_current(folder)?;
    Ok(run)
}

fn write_results(
    config: &EndToEndConfig,
    model: &dyn FrameModel,
    system: &System,
    data: EndToEndData,
    (seconds, best): (f64, scores::ValidationScore),
    folder: &Path,
) -> Result<()> {
    let (mut input, mut output) = (Vec::new(), Vec::new());
    let saved = viz::saved_clips(system, data.test.time());
    frame_model::each_prediction(model, system, data.test, saved, |clips, predicted| {
        input.push(clips.shallow_clone());
        output.push(predicted.shallow_clone());
        Ok(())
    })?;
    viz::write_predictions(&folder.join("outputs.npz"), &Tensor::cat(&input, 0), &Tensor::cat(&output, 0))?;
    let scores = EndToEndScores {
        config: config.clone(),
        weights: frame_model::weights(model),
        training_clips: data.train.len(),
        seconds,
        best: Some(best),
        scores: frame_model::scores(model, system, data.test, data.test.len())?,
    };
    atomic::write_file(&folder.join(SCORES), |file| Ok(serde_json::to_writer_pretty(file, &scores)?))
}

#[cfg(test)]
mod tests {
    use ndarray::{Array5, s};
    use tch::Device;

    use super::super::config::EndToEndModel;
    use super::super::frame_model::prediction_error;
    use super::*;
    use paig::datasets::iterators::Clips;
    use paig::tasks;
    use paig_kernels::Kernels;

    /// Trained on bright clips, validated on clips that begin alike and end black: each step towards the ones leads away from the
    /// others, and the first is the best. Also where it was cut off.
    #[test]
    fn the_weights_of_the_best_validation_are_scored_and_loaded() {
        let folder = tempfile::tempdir().unwrap();
        let plain = tasks::builtin("spring_color").unwrap().system;
        let system = System { side: 16, pred_steps: 3, ..plain };
        let config = EndToEndConfig {
            model: EndToEndModel::VideoLstm,
            task: "spring_color".into(),
            data: "noise".into(),
            seed: 4,
            learning_rate: 1e-2,
            batch: 2,
            steps: 6,
            checkpoint_every: 1,
            kernels: Kernels::Own,
        };
        let bright = Array5::from_shape_fn((6, 8, 16, 16, 3), |(clip, time, y, x, colour)| {
            240 + ((clip * 3 + time + y * x + colour) % 16) as u8
        });
        let mut darkened = bright.clone();
        darkened.slice_mut(s![.., system.input_steps as isize.., .., .., ..]).fill(0);
        let [train_clips, clips] = [bright, darkened].map(|pixels| Clips::new(&pixels, None, Device::Cpu));
        let data = EndToEndData { train: &train_clips, rewards: None, valid: &clips, test: &clips, checksums: "those" };
        let train = |name: &str, stop: bool| {
            let mut errors = Vec::new();
            let tell = &mut |record: &Record| errors.push(record.score.unwrap());
            let outcome = train(&config, &system, data, &folder.path().join(name), &|| stop, tell).unwrap();
            assert_eq!(outcome == TrainingOutcome::Interrupted, stop);
            errors
        };
        let errors = train("whole", false);
        // Stopped after each of its first steps.
        (0..5).for_each(|_| _ = train("cut", true));
        // With other clips it does not go on.
        let other = EndToEndData { checksums: "others", ..data };
        let cut = folder.path().join("cut");
        let refused = super::train(&config, &system, other, &cut, &|| false, &mut |_| ()).unwrap_err();
        let refused = format!("{refused:#}");
        assert!(refused.contains("the clips are not those"), "{refused}");
        train("cut", false);
        let [best, of_cut] = ["whole", "cut"]
            .map(|name| EndToEndScores::read(&folder.path().join(name)).unwrap().unwrap().best.unwrap());
        assert_eq!((best.step, best.error.to_bits()), (of_cut.step, of_cut.error.to_bits()));
        // The first validation, before the first step, counts as any other.
        let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(least < errors[6], "the test shows nothing: {errors:?}");
        assert_eq!((best.error, errors[best.step as usize]), (least, least));
        for name in ["whole", "cut"] {
            let model = config.model.build(&system, config.kernels, 9, Device::Cpu);
            checkpoint::load_weights(&folder.path().join(name), model.as_ref()).unwrap();
            assert_eq!(prediction_error(model.as_ref(), &system, &clips, VALIDATION_CLIPS).unwrap(), least, "{name}");
        }
    }
}
