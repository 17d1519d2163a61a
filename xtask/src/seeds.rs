//! Several seeds of a task at once, each in a thread of one process. On a GPU they share it, each on a stream of its own: one
//! training alone leaves most of it idle.
//!
//! ```sh
//! paig generate --task spring_color && cargo xtask seeds --task spring_color --seeds 0-9 --device cuda
//! ```
//!
//! Prints a line of JSON for each: when its parameters came within 2 % and 0.5 % of the truth for good, when it ended (seconds
//! since all were begun), and what it has learned. `paig sweep` does the same in processes, and keeps their folders.

use std::path::PathBuf;
use std::thread;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use clap::Args;
use paig::datasets::dataset::Dataset;
use paig::datasets::files::{ClipShape, Split};
use paig::network::physics_models::PhysicsNet;
use paig::runs::metrics::Record;
use paig::support::device;
use paig::training::base::TrainingOutcome;
use paig::training::config::Config;
use paig::training::layers::Overrides;
use paig::training::observer::{TrainingEvent, TrainingObserver};
use paig::training::trainer::Trainer;
use paig_experiments::sweep::parse_seeds;
use serde_json::json;
use tch::Device;

/// Trains several seeds of a task at once, in threads of one process.
#[derive(Debug, Args)]
pub struct SeedsArguments {
    #[arg(long, default_value = "spring_color")]
    task: String,
    #[arg(long, default_value = "0-9")]
    seeds: String,
    #[arg(long, default_value = "data/datasets")]
    data: PathBuf,
    /// cpu, cuda or cuda:n
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Threads of each training
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Set one key of the config; may be repeated
    #[arg(long)]
    set: Vec<String>,
}

/// Keeps what is known of the parameters, and when.
struct ParameterLog {
    seed: u64,
    began: Instant,
    truths: Vec<(String, f64)>,
    /// Seconds, and the largest error of a parameter as a share of its truth.
    errors: Vec<(f64, f64)>,
    /// The best validation of the phase that runs, to which the model returns at its end.
    best: Option<Record>,
    /// Errors up to it.
    kept: usize,
}

impl TrainingObserver for ParameterLog {
    fn observe(&mut self, event: &TrainingEvent) -> Result<()> {
        let now = self.began.elapsed().as_secs_f64();
        match event {
            TrainingEvent::PhaseBegins { phase, .. } => eprintln!("{now:6.2} s  seed {}: {phase} begins", self.seed),
            TrainingEvent::Note(line) => eprintln!("{now:6.2} s  seed {}: {line}", self.seed),
            _ => (),
        }
        let TrainingEvent::Recorded { record, .. } = event else { return Ok(()) };
        let error =
            |(name, truth): &(String, f64)| (record.parameters.get(name).map_or(f64::NAN, |x| x / truth) - 1.0).abs();
        // What is not a number stays.
        let larger = |most: f64, error: f64| if error.is_nan() || error > most { error } else { most };
        self.errors.push((now, self.truths.iter().map(error).fold(0.0, larger)));
        let better = self.best.as_ref().is_none_or(|best| best.phase != record.phase || record.score < best.score);
        if record.score.is_some() && better {
            self.best = Some((*record).clone());
            self.kept = self.errors.len();
        }
        Ok(())
    }
}

impl ParameterLog {
    /// When the parameters came within a share of the truth and stayed there; none where nothing is learned.
    fn seconds_to(&self, share: f64) -> Option<f64> {
        if self.truths.is_empty() {
            return None;
        }
        let kept = &self.errors[..self.kept];
        let outside = kept.iter().rposition(|(_, error)| error.is_nan() || *error > share);
        kept.get(outside.map_or(0, |place| place + 1)).map(|(seconds, _)| *seconds)
    }
}

/// # Errors
/// Data or a device that are not there, a training that fails.
pub fn run(arguments: &SeedsArguments) -> Result<()> {
    let began = Instant::now();
    let device = device::parse(&arguments.device)?;
    let set = [arguments.set.clone(), vec![format!("device={:?}", arguments.device)]].concat();
    let overrides = Overrides {
        task: Some(arguments.task.clone()),
        data: Some(arguments.data.clone()),
        set,
        ..Overrides::default()
    };
    let config = Config::load(None, &overrides)?;
    let dataset = Dataset::open(&config.data.train_path(), &ClipShape::training(&config.task))?;
    let seeds = parse_seeds(&arguments.seeds)?;
    ensure!(!seeds.is_empty(), "no seeds");
    eprintln!("data are there after {:.1} s", began.elapsed().as_secs_f64());
    let begun = Instant::now();
    let train = |seed: u64| -> Result<()> {
        device::set_threads(arguments.threads)?;
        let config = Config { seed, ..config.clone() };
        let course = one(&config, &dataset, device, begun).with_context(|| format!("seed {seed}"))?;
        let best = course.best.as_ref().context("a training is validated")?;
        let line = json!({
            "task": config.task.name, "seed": seed, "device": config.device,
            "seconds_to_2_percent": course.seconds_to(0.02), "seconds_to_half_percent": course.seconds_to(0.005),
            "seconds": begun.elapsed().as_secs_f64(), "parameters": best.parameters,
            "recons_loss": best.recons_loss, "pred_loss": best.pred_loss,
        });
        println!("{line}");
        Ok(())
    };
    thread::scope(|scope| {
        let threads: Vec<_> = seeds.iter().map(|&seed| scope.spawn(move || train(seed))).collect();
        threads.into_iter().try_for_each(|thread| thread.join().expect("a training does not panic"))
    })?;
    eprintln!("all trained {:.1} s after the first was begun", begun.elapsed().as_secs_f64());
    Ok(())
}

fn one(config: &Config, dataset: &Dataset, device: Device, began: Instant) -> Result<ParameterLog> {
    let [train, valid] = [Split::Train, Split::Valid].map(|split| dataset.clips(split, device));
    let truths = config.task.system.cell.parameters.iter().map(|parameter| &*parameter.name);
    let truths = truths.filter_map(|name| Some((name.to_string(), config.task.truth_of(name)?))).collect();
    let mut course = ParameterLog { seed: config.seed, began, truths, errors: Vec::new(), best: None, kept: 0 };
    device::set_tf32(device, config.model.tf32);
    let model = PhysicsNet::new(&config.task.system, &config.model, device, config.seed)?;
    let learned: Vec<_> = model.learned().map(|parameter| parameter.kind.name.to_string()).collect();
    course.truths.retain(|(name, _): &(String, f64)| learned.contains(name));
    let outcome = Trainer::new(config, &model, &train, &valid)?.observed_by(&mut course).run()?;
    ensure!(outcome == TrainingOutcome::Finished, "the training was stopped");
    Ok(course)
}
