//! Swings a pendulum that is seen to a goal. See `control --help`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::{Parser, ValueEnum};
use paig::cli::ending::exit_code;
use paig::cli::environment;
use paig::control::controller::Controller;
use paig::control::environment::{PendulumEnvironment, PendulumSettings};
use paig::control::episode::{Episode, play};
use paig::control::model::{CellModel, Model};
use paig::control::mppi::PathIntegral;
use paig::control::pendulum_model::PendulumModel;
use paig::control::planner::CrossEntropy;
use paig::control::results::{FORMAT, Results, Row, mean_and_interval};
use paig::control::search::{Planner, SearchSettings};
use paig::control::vision::Vision;
use paig::network::cells::PENDULUM;
use paig::network::physics_models::PhysicsNet;
use paig::runs::checkpoint::SavedWeights;
use paig::runs::run::Run;
use paig::say;
use paig::support::device;
use paig::training::saved::load_model;
use paig::viz;
use tch::{Device, Tensor};

/// Pixels of the animation for one of a frame.
const ENLARGED: u32 = 4;
/// Notes of a planner that are printed; how many there are is said in any case.
const NOTES: usize = 3;

/// Plans with the learned physics, from what is seen, and scores it beside planners that know more or nothing.
///
/// Writes results.json and, for each planner, an animation of its first episode. The same seed plays the same episodes.
#[derive(Parser)]
#[command(
    version,
    allow_negative_numbers = true,
    after_help = "Example:\n  control runs/pendulum/fast/seed=0 --planner learned,zero --goal 30 --gravity 6 --model-gravity 6"
)]
struct Arguments {
    /// Run folder of a pendulum; only the planners that see need one
    run: Option<PathBuf>,
    /// Who decides, separated by commas
    #[arg(long, value_enum, value_delimiter = ',', default_value = "learned")]
    planner: Vec<Who>,
    /// How plans are searched for
    #[arg(long, value_enum, default_value = "cross-entropy")]
    search: Method,
    /// Episodes of each planner, the same for all
    #[arg(long, default_value_t = 100)]
    episodes: usize,
    /// Seed of the first episode; the next ones count on
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Degrees from upright, clockwise
    #[arg(long, default_value_t = 0.0)]
    goal: f64,
    /// A picture of the goal, as large as a frame; the model finds its angle
    #[arg(long, value_name = "FILE", conflicts_with = "goal")]
    goal_image: Option<PathBuf>,
    /// Gymnasium's cost and start, 200 steps, instead of a goal
    #[arg(long, conflicts_with_all = ["goal", "goal_image"])]
    gymnasium: bool,
    /// Gravity of the environment
    #[arg(long, default_value_t = 10.0)]
    gravity: f64,
    /// Length of the environment's pendulum
    #[arg(long, default_value_t = 1.0)]
    length: f64,
    /// Mass of the environment's pendulum
    #[arg(long, default_value_t = 1.0)]
    mass: f64,
    /// Set the learned model's gravity instead of the one that it learned
    #[arg(long, value_name = "G")]
    model_gravity: Option<f64>,
    /// Threads to compute with; 0 for one a core
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Folder for the results; files of an earlier one are replaced
    #[arg(long, default_value = "reports/control")]
    out: PathBuf,
}

/// Who decides.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum Who {
    /// Vision and physics are learned
    Learned,
    /// The true state and the true equation: the upper bound
    TrueState,
    /// Vision is learned, the equation is the true one
    TrueEquation,
    /// Any torque
    Random,
    /// No torque
    Zero,
}

impl Who {
    fn name(self) -> &'static str {
        match self {
            Who::Learned => "learned",
            Who::TrueState => "true state",
            Who::TrueEquation => "true equation",
            Who::Random => "random",
            Who::Zero => "zero",
        }
    }

    fn sees(self) -> bool {
        matches!(self, Who::Learned | Who::TrueEquation)
    }
}

/// How plans are searched for.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Method {
    CrossEntropy,
    PathIntegral,
}

impl Method {
    fn planner(self, hold: usize) -> Box<dyn Planner> {
        let settings = SearchSettings { hold, ..SearchSettings::default() };
        match self {
            Method::CrossEntropy => Box::new(CrossEntropy::new(settings)),
            Method::PathIntegral => Box::new(PathIntegral::new(settings)),
        }
    }
}

fn main() -> ExitCode {
    exit_code(|| execute(&Arguments::parse()))
}

fn execute(arguments: &Arguments) -> Result<ExitCode> {
    // Before anything is opened: it starts the program over.
    environment::set();
    device::set_threads(arguments.threads)?;
    ensure!(arguments.episodes > 0, "--episodes must be at least 1");
    let goal = arguments.goal()?;
    let settings = arguments.settings(goal);
    let mut world = PendulumEnvironment::new(settings)?;
    fs::create_dir_all(&arguments.out).with_context(|| format!("cannot create {}", arguments.out.display()))?;
    // What fails should do so before the first episode.
    for who in arguments.planner.iter().copied().filter(|who| who.sees()) {
        Vision::new(&arguments.model_of(who, &settings)?)?;
    }
    // What the bound reached is needed for every row.
    let bound = arguments.play(Who::TrueState, &settings, &mut world)?;
    let upper_bound = bound.mean[0];
    let mut rows = Vec::new();
    say!("{:<14}{:>10}{:>20}{:>14}{:>14}", "planner", "return", "95 %", "upper bound", "ms/decision");
    for who in arguments.planner.iter().copied() {
        let played = if who == Who::TrueState { bound.clone() } else { arguments.play(who, &settings, &mut world)? };
        let [mean, low, high] = played.mean;
        let ms = played.ms_per_decision;
        let interval = format!("{low:.2} to {high:.2}");
        say!("{:<14}{mean:>10.2}{interval:>20}{upper_bound:>14.2}{ms:>14.1}", who.name());
        played.notes.iter().take(NOTES).for_each(|note| say!("  note: {note}"));
        if played.notes.len() > NOTES {
            say!("  and {} more notes like these", played.notes.len() - NOTES);
        }
        rows.push(Row {
            planner: who.name().into(),
            model: arguments.run.as_ref().filter(|_| who.sees()).map(|run| run.display().to_string()),
            clips: arguments.run.as_ref().filter(|_| who.sees()).and_then(|run| training_clips(run)),
            goal: (!arguments.gymnasium).then_some(goal.to_degrees()),
            gravity: arguments.gravity,
            episodes: arguments.episodes,
            return_mean: mean,
            return_low: low,
            return_high: high,
            upper_bound,
            ms_per_decision: ms,
        });
    }
    let path = arguments.out.join("results.json");
    Results { format: FORMAT, rows }.write(&path)?;
    say!("results in {}", path.display());
    Ok(ExitCode::SUCCESS)
}

/// What a planner did in all episodes.
#[derive(Debug, Clone)]
struct Played {
    /// Mean return and its interval.
    mean: [f64; 3],
    ms_per_decision: f64,
    notes: Vec<String>,
}

impl Arguments {
    /// The goal, radians.
    fn goal(&self) -> Result<f64> {
        match &self.goal_image {
            Some(file) => Vision::new(&self.model()?)?.goal(file),
            None => {
                ensure!(self.goal.is_finite(), "--goal must be a number of degrees, not {}", self.goal);
                Ok(self.goal.to_radians())
            }
        }
    }

    fn settings(&self, goal: f64) -> PendulumSettings {
        let usual = if self.gymnasium { PendulumSettings::gymnasium() } else { PendulumSettings::to_goal(goal) };
        PendulumSettings { gravity: self.gravity, length: self.length, mass: self.mass, ..usual }
    }

    /// The run's model as it was saved.
    fn model(&self) -> Result<PhysicsNet> {
        let run = self.run.as_ref().context("this needs a run folder, for the model that sees")?;
        Ok(load_model(run, SavedWeights::Last, Device::Cpu)?.1)
    }

    /// Plays all episodes of one planner and writes the animation of the first.
    fn play(&self, who: Who, settings: &PendulumSettings, world: &mut PendulumEnvironment) -> Result<Played> {
        let model = who.sees().then(|| self.model_of(who, settings)).transpose()?;
        let mut controller = self.controller(who, settings, model.as_ref())?;
        let episode = |index: usize| play(world, &mut controller, self.seed.wrapping_add(index as u64), index == 0);
        let episodes: Vec<Episode> = (0..self.episodes).map(episode).collect();
        let returns: Vec<f64> = episodes.iter().map(|episode| episode.total).collect();
        let seconds: f64 = episodes.iter().map(|episode| episode.deciding.as_secs_f64()).sum();
        let decisions: usize = episodes.iter().map(|episode| episode.decisions).sum();
        let film = self.out.join(format!("{}.gif", who.name().replace(' ', "_")));
        viz::write_film(&film, &Tensor::stack(&episodes[0].frames, 0), ENLARGED)?;
        let notes = episodes.iter().enumerate();
        Ok(Played {
            mean: mean_and_interval(&returns, self.seed).context("no episodes")?,
            ms_per_decision: 1000.0 * seconds / decisions.max(1) as f64,
            notes: notes
                .flat_map(|(index, played)| played.notes.iter().map(move |note| format!("episode {index}, {note}")))
                .collect(),
        })
    }

    /// The model of a planner that sees, with the physics that its refinement goes by.
    fn model_of(&self, who: Who, settings: &PendulumSettings) -> Result<PhysicsNet> {
        let model = self.model()?;
        let set = |name: &str, value: f64| -> Result<()> {
            let parameter = model.parameters.iter().find(|parameter| parameter.kind.name == name);
            let cell = model.system.cell.name;
            model.set_value(parameter.with_context(|| format!("equation {cell} has no parameter {name}"))?, value)
        };
        if who == Who::TrueEquation {
            // The cell counts lengths in rods, and its rod has mass and length 1.
            set("g", settings.gravity_acceleration() / 1.5)?;
            set("a", settings.torque_acceleration() / 3.0)?;
        } else if let Some(gravity) = self.model_gravity {
            set("g", gravity).context("--model-gravity")?;
        }
        Ok(model)
    }

    fn controller<'a>(
        &self,
        who: Who,
        settings: &PendulumSettings,
        seeing: Option<&'a PhysicsNet>,
    ) -> Result<Controller<'a>> {
        let planner = self.search.planner(settings.hold);
        let truth = Box::new(PendulumModel::of_environment(settings));
        Ok(match (who, seeing) {
            (Who::Zero, _) => Controller::Zero,
            (Who::Random, _) => Controller::random(),
            (Who::Learned, Some(net)) => {
                Controller::Seeing { vision: Vision::new(net)?, model: planned_with(net)?, planner }
            }
            (Who::TrueEquation, Some(net)) => Controller::Seeing { vision: Vision::new(net)?, model: truth, planner },
            _ => Controller::TrueState { model: truth, planner },
        })
    }
}

/// The learned cell; that of the pendulum in plain numbers, which takes a fraction of the time.
fn planned_with(net: &PhysicsNet) -> Result<Box<dyn Model + '_>> {
    if *net.system.cell != PENDULUM {
        return Ok(Box::new(CellModel { cell: net.cell.as_ref(), dt: net.system.dt }));
    }
    let value = |name: &str| {
        let parameter = net.parameters.iter().find(|parameter| parameter.kind.name == name);
        let parameter = parameter.with_context(|| format!("the pendulum's cell has no parameter {name}"))?;
        Ok::<f64, anyhow::Error>(net.true_value(parameter.kind, parameter.raw.double_value(&[])))
    };
    Ok(Box::new(PendulumModel::of_cell(value("g")?, value("a")?, net.system.dt)))
}

/// Clips that a run was trained on, if it says so.
fn training_clips(run: &Path) -> Option<usize> {
    Run::read(run).ok()?.data.map(|data| data.clips[0])
}
