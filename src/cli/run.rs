//! One run from the command line: what the runners call.
//!
//! Original: `run_physics.py`. The runners in `runners/` hold only a task's name and this call.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::{Args, Parser};
use tch::Device;

use super::ending::{begin_work, exit_code};
use super::measure_display::print_measurement;
use super::progress::{Progress, Screen};
use super::table::{print_frames_and_states, print_results};
use super::{environment, interrupt};
use crate::datasets::dataset::Dataset;
use crate::datasets::files::{ClipShape, Split};
use crate::datasets::iterators::Clips;
use crate::datasets::states::States;
use crate::evaluation::{self, ScoredClips};
use crate::measure::{Request, measure};
use crate::network::physics_models::PhysicsNet;
use crate::runs::checkpoint::{RunState, SavedWeights, Store};
use crate::runs::folder::RunFolder;
use crate::runs::names::CONFIG;
use crate::runs::summary::{self, Hardware, LearnedParameter, Summary, TestScores};
use crate::runs::verdict::Verdict;
use crate::support::device::{self, COMMIT};
use crate::support::memory;
use crate::training::base::Outcome;
use crate::training::config::Config;
use crate::training::footprint::footprint;
use crate::training::layers::Overrides;
use crate::training::recorder::Recorder;
use crate::training::saved::load_model;
use crate::training::tensorboard::EventFile;
use crate::training::trainer::Trainer;
use crate::training::verdict::judge;
use crate::{say, tasks, viz};

/// Learns objects, positions and physical parameters from unlabelled video: trains, scores, writes pictures.
#[derive(Debug, Parser)]
#[command(
    version,
    about,
    long_about = None,
    allow_negative_numbers = true,
    after_help = "Examples:\n  run_physics --task spring_color --seed 1\n  \
                  run_physics --task 3bp_color --set join.max_steps=400 --out runs/longer\n  \
                  run_physics --resume --out runs/spring_color/fast/seed=1"
)]
pub struct AnyTask {
    #[arg(long, help = format!(
        "The system to learn: a task file (.toml), or one of {}. Required, unless --config names it, or --resume or \
         --test-mode takes the run in --out",
        tasks::names()
    ))]
    task: Option<String>,
    #[command(flatten)]
    run: RunArgs,
}

/// The same for the task of a per-task runner.
#[derive(Debug, Parser)]
#[command(
    version,
    allow_negative_numbers = true,
    about = "Trains PAIG on one task; run_physics --task does the same for any"
)]
struct OneTask {
    #[command(flatten)]
    run: RunArgs,
}

#[derive(Debug, Args)]
struct RunArgs {
    /// A config (TOML) with what differs from the recipe
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// The recipe to start from: fast (default) or paper
    #[arg(long)]
    recipe: Option<String>,
    /// Set one key of the config, for example --set join.batch=50; may be repeated. --print-config shows all keys, the
    /// recipes in configs/ say what they mean
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Run folder [default: runs/TASK/RECIPE/seed=N]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Folder of the datasets [default: data/datasets; the folder of the task's file where its data.folder is "."]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Seed of initial values and of the order of the data [default: 0]
    #[arg(long)]
    seed: Option<u64>,
    /// cpu, cuda or cuda:n [default: cpu]
    #[arg(long)]
    device: Option<String>,
    /// Threads to compute with; 0 for one a core [default: 0]
    #[arg(long)]
    threads: Option<usize>,
    /// Go on with the run in --out, to the same result as if it had never stopped (to the bit with as many threads). Of
    /// the other options only --device, --threads and --data may differ from the run's own
    #[arg(long)]
    resume: bool,
    /// Do not train: score the last checkpoint of the run in --out on the test file
    #[arg(long)]
    test_mode: bool,
    /// Print the complete config and stop
    #[arg(long)]
    print_config: bool,
}

/// Entry of `run_physics`.
pub fn any_task() -> ExitCode {
    exit_code(|| {
        let AnyTask { task, run } = AnyTask::parse();
        run.execute(task)
    })
}

/// Entry of a task's own runner.
pub fn one_task(key: &str) -> ExitCode {
    exit_code(|| OneTask::parse().run.execute(Some(key.to_string())))
}

impl RunArgs {
    fn execute(self, task: Option<String>) -> Result<ExitCode> {
        // Before anything is opened: it starts the program over.
        environment::set();
        if self.print_config {
            let config = Config::load(self.config.as_deref(), &self.overrides(task))?;
            say!("{}", config.to_toml().trim_end());
            return Ok(ExitCode::SUCCESS);
        }
        let (opened, config) = self.open(task)?;
        let device = device::parse(&config.device)?;
        let threads = device::set_threads(config.threads)?;
        let data = if self.test_mode { None } else { Some(TrainingData::load(&config, device)?) };
        let needed = data.as_ref().filter(|_| device == Device::Cpu).map(|data| footprint(&config, data.train.len()));
        memory::ensure_free(needed.unwrap_or(0)).context(
            "this training needs more memory than there is; take smaller steps (join.batch, discover.frames)",
        )?;
        // What can fail at once has been tried: a folder is taken only by a run that begins.
        let folder = match opened {
            Opened::Earlier(folder) => folder,
            Opened::New(path) => {
                data.iter().try_for_each(|data| data.check_start(&config, device))?;
                RunFolder::create(&path, &config.to_toml())?
            }
        };
        say!("{}", environment::banner(device, threads));
        say!("run folder {}", folder.path().display());
        if let Some(more) = needed {
            let now = memory::resident().map_or(0, |(now, _)| now);
            say!("memory - {} now, about {} in all", memory::gib(now), memory::gib(now + more));
        }
        begin_work();
        match data {
            Some(data) => train(&config, &folder, &data, device, threads),
            None => score(&config, &folder, device),
        }
    }

    /// What is given besides a config file.
    fn overrides(&self, task: Option<String>) -> Overrides {
        Overrides {
            task,
            recipe: self.recipe.clone(),
            seed: self.seed,
            device: self.device.clone(),
            threads: self.threads,
            data: self.data.clone(),
            set: self.set.clone(),
        }
    }

    /// The run's folder and config.
    fn open(&self, task: Option<String>) -> Result<(Opened, Config)> {
        let load = || Config::load(self.config.as_deref(), &self.overrides(task.clone()));
        let own = |c: Config| Path::new("runs").join(&c.task.name).join(&c.recipe).join(format!("seed={}", c.seed));
        if !(self.resume || self.test_mode) {
            let out = self.out.clone().map_or_else(|| load().map(own), Ok)?;
            RunFolder::ensure_free(&out)?;
            return Ok((Opened::New(out), load()?));
        }
        let which = "say which run with --out, or with the options that it was begun with";
        let out = self.out.clone().map_or_else(|| load().map(own).context(which), Ok)?;
        let folder = RunFolder::reopen(&out)?;
        let saved = Config::read(&out.join(CONFIG))?;
        if let Some(task) = &task {
            let (asked, name) = (tasks::find(task)?, &saved.task.name);
            ensure!(*name == asked.name, "{} holds a run of task {name}, not of {}", out.display(), asked.name);
        }
        let config = self.going_on(&saved, task, &out)?;
        Ok((Opened::Earlier(folder), config))
    }

    /// The config of an earlier run with what may change: where it computes and where its data lie. Anything else that is
    /// given must be as it was.
    fn going_on(&self, saved: &Config, task: Option<String>, out: &Path) -> Result<Config> {
        let mut config = saved.clone();
        config.device = self.device.clone().unwrap_or(config.device);
        config.threads = self.threads.unwrap_or(config.threads);
        config.data.folder = self.data.clone().unwrap_or(config.data.folder);
        let recipe = self.recipe.clone().unwrap_or(saved.recipe.clone());
        let seed = self.seed.unwrap_or(saved.seed);
        let changes = self.config.is_some() || !self.set.is_empty();
        let task = match task {
            Some(task) if changes || tasks::builtin(&task).is_none() => tasks::find(&task)?,
            // The name of a built-in task, alone, changes nothing in the task that the run may have begun with.
            _ => saved.task.clone(),
        };
        let asked = if changes {
            let given = Overrides { recipe: Some(recipe), seed: Some(seed), ..self.overrides(None) };
            Config::load_task(task, self.config.as_deref(), &given)?
        } else {
            // Nor does nothing given change its recipe.
            Config { task, recipe, seed, ..saved.clone() }
        };
        let (begun, asked) = (saved.differences(&asked), asked.differences(saved));
        ensure!(
            begun.is_empty() && asked.is_empty(),
            "{0} was begun with another config ({0}/config.toml: [{1}], asked for: [{2}]); resume it with --out {0} and no \
             option but --device, --threads, --data, or choose another folder",
            out.display(),
            begun.join(", "),
            asked.join(", ")
        );
        Ok(config)
    }
}

/// Where a run goes.
enum Opened {
    /// A folder that is free.
    New(PathBuf),
    Earlier(RunFolder),
}

/// What a training sees.
struct TrainingData {
    train: Clips,
    valid: Clips,
    /// Checksums of both.
    checksums: String,
}

impl TrainingData {
    /// What would stop the scoring at the end must not cost the phases before: the test file is read, too, and dropped.
    fn load(config: &Config, device: Device) -> Result<Self> {
        let path = config.data.train_path();
        let training = Dataset::open(&path, &ClipShape::training(&config.task))?;
        training.check_motion(&path)?;
        if training.is_on_disk() {
            say!(
                "note: {} is too large for the memory; its frames are read from the disk when they are wanted",
                path.display()
            );
        }
        check_settings(&path, config)?;
        let path = config.data.test_path();
        let test = Dataset::open(&path, &ClipShape::test(&config.task))?;
        check_settings(&path, config)?;
        check_states(&path, &test, config).context("the run could not be scored at its end")?;
        drop(test);
        let clips = |split| training.clips(split, device);
        let checksums = training.learned_from();
        let data = TrainingData { train: clips(Split::Train), valid: clips(Split::Valid), checksums };
        config.check_clips(&data.train)?;
        if data.train.flickers() {
            say!("note: the light flickers from frame to frame; each frame is divided by its own");
        }
        Ok(data)
    }
}

impl TrainingData {
    /// Refuses parameters that the config gives and the equation cannot have.
    fn check_start(&self, config: &Config, device: Device) -> Result<()> {
        let model = PhysicsNet::new(&config.task.system, &config.model, device, config.seed)?;
        Trainer::new(config, &model, &self.train, &self.valid)?.check_start()
    }
}

/// Refuses a file that was made for another system.
fn check_settings(path: &Path, config: &Config) -> Result<()> {
    match States::settings_beside(path) {
        Ok(Some(settings)) => {
            let context = || format!("{} does not fit task {}", path.display(), config.task.name);
            settings.check(&config.task.system).with_context(context)
        }
        Ok(None) => Ok(()),
        // A training needs nothing of that file; of the test file it is read as a whole.
        Err(error) => {
            say!("note: {error:#}; how {} was made is not known", path.display());
            Ok(())
        }
    }
}

/// Refuses true states beside the test file that could not score the run.
fn check_states(path: &Path, test: &Dataset, config: &Config) -> Result<()> {
    let Some(states) = States::read(path, test)? else { return Ok(()) };
    let context = || format!("true states {}", States::path_beside(path).display());
    states.test.check(&config.task.system).with_context(context)
}

/// Scores a run's last checkpoint on the test file.
fn score(config: &Config, folder: &RunFolder, device: Device) -> Result<ExitCode> {
    let (_, model) = load_model(folder.path(), SavedWeights::Last, device)?;
    let mut test = ScoredClips::read(&config.data.test_path(), &config.task, Split::Test, device)?;
    let scores = evaluation::evaluate(&model, &test)?;
    test.number_objects_as(&model, scores.states.as_ref().map(|states| &states.objects[..]));
    print_frames_and_states(&config.task.system, &scores);
    print_results(&config.task, &model, &test, &scores.losses);
    Ok(ExitCode::SUCCESS)
}

/// Trains, scores, writes numbers and pictures.
fn train(config: &Config, folder: &RunFolder, data: &TrainingData, device: Device, threads: usize) -> Result<ExitCode> {
    interrupt::catch()?;
    let model = PhysicsNet::new(&config.task.system, &config.model, device, config.seed)?;
    let (mut recorder, mut screen) = (Recorder::new(folder)?, Screen::new(config));
    let mut events = config.output.tensorboard.then(|| EventFile::new(folder)).transpose()?;
    let mut trainer = Trainer::new(config, &model, &data.train, &data.valid)?
        .of_clips(&data.checksums)
        .save_to(Store::new(folder.path()))
        .observed_by(&mut recorder)
        .observed_by(&mut screen)
        .stop_when(interrupt::asked);
    if let Some(events) = &mut events {
        trainer = trainer.observed_by(events);
    }
    if trainer.run()? == Outcome::Interrupted {
        say!("stopped after step {}; go on with --resume --out {}", trainer.state().steps, folder.path().display());
        return Ok(interrupt::exit_code());
    }
    let state = trainer.state().clone();
    say!("checking what was learned on held-out clips, scoring the test clips, drawing pictures");
    let waiting = Progress::busy("scoring");
    let verdict = judge(config, &model, &data.train, &data.valid)?;
    // The true states lie beside the test file: nothing has learned from them before.
    let mut test =
        ScoredClips::read(&config.data.test_path(), &config.task, Split::Test, device).with_context(|| {
            format!(
                "the training is finished and saved, but not scored; --resume --out {} does it",
                folder.path().display()
            )
        })?;
    let scores = evaluation::evaluate(&model, &test)?;
    test.number_objects_as(&model, scores.states.as_ref().map(|states| &states.objects[..]));
    waiting.finish();
    print_frames_and_states(&config.task.system, &scores);
    print_results(&config.task, &model, &test, &scores.losses);
    let parameters = model.parameter_values().into_iter();
    let summary = Summary {
        format: summary::FORMAT,
        task: config.task.name.clone(),
        recipe: config.recipe.clone(),
        seed: config.seed,
        parameters: parameters
            .map(|(name, learned)| (name.to_string(), LearnedParameter { learned, truth: test.truth_of(name) }))
            .collect(),
        test: TestScores { scores, made_with: test.made_with.clone() },
        verdict: Some(verdict.clone()),
        training_clips: Some(data.train.len()),
        validation_clips: Some(data.valid.len()),
        overrides: config.differences_from_recipe()?,
        steps: state.steps,
        wall_seconds: state.seconds,
        phase_seconds: state.phase_seconds.iter().cloned().collect(),
        device: config.device.clone(),
        threads,
        hardware: Some(Hardware { processor: device::processor(), cores: device::cores() }),
        versions: versions(&state),
    };
    summary.write(folder.path())?;
    let waiting = Progress::busy("pictures");
    viz::write_artifacts(folder.path(), &model, &test.clips, config.output.examples)?;
    viz::write_curves(folder.path(), &config.task, &test.truth)?;
    waiting.finish();
    print_end(&state, folder.path());
    let measured = measure_videos(config, folder, device);
    if is_measured(config) {
        // What is to be quoted are the measurement's intervals, not those of short clips in pixels of small frames.
        say!("{}", Verdict { intervals: BTreeMap::new(), ..verdict });
    } else {
        say!("{verdict}");
    }
    measured.map(|()| ExitCode::SUCCESS)
}

/// Prints what each phase took, and what to do next.
fn print_end(state: &RunState, folder: &Path) {
    let seconds = |(name, seconds): &(String, f64)| format!("{name} {seconds:.0} s");
    let phases: Vec<_> = state.phase_seconds.iter().map(seconds).collect();
    let folder = folder.display();
    say!("finished after {} steps, {:.0} s ({}); results in {folder}", state.steps, state.seconds, phases.join(", "));
    say!("look at {folder}/losses.png and {folder}/example0.png; next: predict {folder} --frames 60");
}

/// Whether a run measures videos as a whole: those that its task was made from.
fn is_measured(config: &Config) -> bool {
    config.task.video().is_some_and(|video| video.film_step.is_some())
}

/// Of a task that was made from videos: what the run measures in them as a whole.
fn measure_videos(config: &Config, folder: &RunFolder, device: Device) -> Result<()> {
    if !is_measured(config) {
        return Ok(());
    }
    let out = folder.path();
    let measurement = measure(out, &Request::default(), out, device)
        .with_context(|| format!("the run is finished, but not measured; `measure {}` does it", out.display()))?;
    print_measurement(&measurement);
    say!("look at {}", out.join("measurement.html").display());
    Ok(())
}

/// What trained the run, and what scored it where that was another build.
fn versions(state: &RunState) -> BTreeMap<String, String> {
    let trained = if state.commits.is_empty() { "unknown".to_string() } else { state.commits.join(", then ") };
    let scored =
        (state.commits.last().map(String::as_str) != Some(COMMIT)).then(|| ("scored by".to_string(), COMMIT.into()));
    let versions = [
        ("paig".to_string(), env!("CARGO_PKG_VERSION").into()),
        ("libtorch".to_string(), device::LIBTORCH_VERSION.into()),
        ("commit".to_string(), trained),
    ];
    versions.into_iter().chain(scored).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_with_a_changed_task_goes_on_by_the_tasks_name() {
        let begun = Overrides {
            task: Some("spring_color".into()),
            set: vec!["task.system.dt=0.2".into()],
            ..Overrides::default()
        };
        let saved = Config::load(None, &begun).unwrap();
        let going_on = |words: &[&str]| {
            let asked = ["run_physics", "--task", "spring_color", "--resume", "--out", "r"];
            let AnyTask { task, run } = AnyTask::try_parse_from(asked.iter().chain(words)).unwrap();
            run.going_on(&saved, task, Path::new("r"))
        };
        assert_eq!(going_on(&[]).unwrap(), saved);
        assert_eq!(going_on(&["--set", "task.system.dt=0.2"]).unwrap(), saved);
        let error = going_on(&["--set", "task.system.dt=0.1"]).unwrap_err().to_string();
        assert!(error.contains("begun with another config") && error.contains("dt"), "{error}");
    }
}
