//! Brings what is seen to a goal by planning. See `control --help`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use clap::{Parser, ValueEnum};
use paig::baselines::planet::Planet;
use paig::baselines::training::{self, WholeModel, WholeScores};
use paig::cli::ending::exit_code;
use paig::cli::environment;
use paig::control::controller::Controller;
use paig::control::environment::{Environment, FrameFormat, Rules};
use paig::control::episode::{Episode, play};
use paig::control::faults::{Faults, Faulty};
use paig::control::figures::{self, Course};
use paig::control::latent::LatentModel;
use paig::control::model::Model;
use paig::control::mppi::PathIntegral;
use paig::control::pendulum::{self, PendulumEnvironment, PendulumSettings};
use paig::control::planner::CrossEntropy;
use paig::control::relearning::Relearning;
use paig::control::results::{FORMAT, Results, Row, mean_and_interval};
use paig::control::reward::{Goal, Reward};
use paig::control::scene::SceneEnvironment;
use paig::control::search::{Planner, SearchSettings};
use paig::control::vision::Vision;
use paig::network::cells::Coordinates;
use paig::network::physics_models::PhysicsNet;
use paig::runs::checkpoint::SavedWeights;
use paig::runs::run::Run;
use paig::say;
use paig::support::device;
use paig::tasks::scene::Motion;
use paig::tasks::{self, Task};
use paig::training::saved::load_model;
use serde::Deserialize;
use tch::Device;

/// Notes of a planner that are printed; how many there are is said in any case.
const NOTES: usize = 3;

/// Plans with the learned physics, from what is seen, and scores it beside planners that know more or nothing.
///
/// Writes results.json, pictures, and an animation of each planner's first episode. The same seed plays the same episodes.
#[derive(Parser)]
#[command(
    version,
    allow_negative_numbers = true,
    after_help = "Example:\n  control runs/pendulum/fast/seed=0 --planner learned,zero --goal 30 --gravity 6 --model-set g=6"
)]
struct Arguments {
    /// Run folder of a task with actions; only the planners that see need one
    run: Option<PathBuf>,
    /// A file (TOML) with many lines of arguments, all of which are played; their results go into one file
    #[arg(long, value_name = "FILE", conflicts_with = "run")]
    study: Option<PathBuf>,
    /// Take over the lines of the study that were played before, into the same folder and with the same arguments
    #[arg(long, requires = "study")]
    resume: bool,
    /// The task, where there is no run
    #[arg(long, default_value = "pendulum")]
    task: String,
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
    /// Degrees from upright, clockwise; of a task in the plane x,y in pixels
    #[arg(long, value_delimiter = ',')]
    goal: Vec<f64>,
    /// A picture of the goal, as large as a frame; the model finds where it is
    #[arg(long, value_name = "FILE", conflicts_with = "goal")]
    goal_image: Option<PathBuf>,
    /// By how many degrees or pixels a moving goal swings to either side
    #[arg(long, default_value_t = 0.0)]
    goal_swing: f64,
    /// Steps of a full swing
    #[arg(long, default_value_t = 50.0)]
    goal_period: f64,
    /// Gymnasium's cost and start, 200 steps, instead of a goal
    #[arg(long, conflicts_with_all = ["goal", "goal_image", "goal_swing"])]
    gymnasium: bool,
    /// Frames that the camera has delivered before an episode begins
    #[arg(long, default_value_t = 3)]
    frames_before: usize,
    /// Steps of an episode, if not the usual ones
    #[arg(long)]
    steps: Option<usize>,
    /// Gravity of the environment's pendulum
    #[arg(long, default_value_t = 10.0)]
    gravity: f64,
    /// Length of the environment's pendulum
    #[arg(long, default_value_t = 1.0)]
    length: f64,
    /// Mass of the environment's pendulum
    #[arg(long, default_value_t = 1.0)]
    mass: f64,
    /// Rate with which the pendulum begins, in either direction, instead of one of up to 2
    #[arg(long)]
    start_rate: Option<f64>,
    /// Share of the frames that do not arrive
    #[arg(long, default_value_t = 0.0)]
    dropped: f64,
    /// Share of the frames in which what is controlled is hidden
    #[arg(long, default_value_t = 0.0)]
    hidden: f64,
    /// Set a parameter of the learned model instead of the one that it learned: g=6
    #[arg(long, value_delimiter = ',', value_name = "NAME=VALUE")]
    model_set: Vec<String>,
    /// Parameters that the learned planner learns again from the first frames of each episode, separated by commas
    #[arg(long, value_delimiter = ',', value_name = "NAME")]
    relearn: Vec<String>,
    /// Frames that they are learned from
    #[arg(long, default_value_t = 25)]
    relearn_frames: usize,
    /// Threads to compute with; 0 for one a core
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Folder for the results; files of an earlier one are replaced
    #[arg(long, default_value = "reports/control")]
    out: PathBuf,
}

/// A file of lines of arguments.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Study {
    play: Vec<Play>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Play {
    /// Folder of its pictures, in that of the results.
    name: String,
    arguments: String,
}

impl Play {
    /// Its rows, played now or, where they may be, taken over from this folder.
    fn rows(&self, line: &Arguments, folder: &Path, take_over: bool) -> Result<Vec<Row>> {
        let path = folder.join("results.json");
        if take_over && path.exists() {
            let before = Results::read(&path)?;
            if before.line.as_ref() == Some(&self.arguments) {
                say!("played before");
                return Ok(before.rows);
            }
        }
        let rows = line.play_all(folder).with_context(|| self.name.clone())?;
        let results = Results { format: FORMAT, line: Some(self.arguments.clone()), rows };
        results.write(&path)?;
        Ok(results.rows)
    }
}

/// Who decides.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum Who {
    /// Vision is learned, and what foretells: the physics, or a black box in its place
    Learned,
    /// The true state and the true equation: the upper bound
    TrueState,
    /// Vision is learned, the equation is the true one
    TrueEquation,
    /// A latent model of frames, actions and rewards is learned; its run is one of `planet`
    Latent,
    /// Any action
    Random,
    /// No action
    Zero,
}

impl Who {
    /// As it stands in the results: a black box that was learned stands there by its own name.
    fn name(self, model: Option<&PhysicsNet>) -> &'static str {
        match self {
            Who::Learned => {
                let black_box = model.filter(|model| model.black_box.is_some());
                black_box.map_or("learned", |model| model.options.dynamics.name())
            }
            Who::TrueState => "true state",
            Who::TrueEquation => "true equation",
            Who::Latent => "latent",
            Who::Random => "random",
            Who::Zero => "zero",
        }
    }

    /// Whether it sees objects, by a run's encoder.
    fn sees(self) -> bool {
        matches!(self, Who::Learned | Who::TrueEquation)
    }

    /// Whether it needs a run.
    fn has_run(self) -> bool {
        self.sees() || self == Who::Latent
    }
}

/// How plans are searched for.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum Method {
    CrossEntropy,
    PathIntegral,
}

fn main() -> ExitCode {
    exit_code(|| execute(&Arguments::parse()))
}

fn execute(arguments: &Arguments) -> Result<ExitCode> {
    // Before anything is opened: it starts the program over.
    environment::set();
    device::set_threads(arguments.threads)?;
    let out = &arguments.out;
    let rows = match &arguments.study {
        None => arguments.play_all(out)?,
        Some(file) => {
            let text = fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
            let study: Study = toml::from_str(&text).with_context(|| format!("{}", file.display()))?;
            let mut parsed = Vec::new();
            for play in &study.play {
                let words = ["control"].into_iter().chain(play.arguments.split_whitespace());
                let arguments = Arguments::try_parse_from(words);
                parsed.push(arguments.with_context(|| format!("{}: {}", file.display(), play.name))?);
            }
            let mut rows = Vec::new();
            for (play, line) in study.play.iter().zip(parsed) {
                say!("\n{}", play.name);
                rows.extend(play.rows(&line, &out.join(&play.name), arguments.resume)?);
            }
            rows
        }
    };
    let path = out.join("results.json");
    figures::write_clips(&out.join("clips.png"), &rows)?;
    Results { format: FORMAT, line: None, rows }.write(&path)?;
    say!("results in {}", path.display());
    Ok(ExitCode::SUCCESS)
}

/// What a planner did in all episodes.
struct Played {
    who: Who,
    name: &'static str,
    /// Mean return and its interval.
    mean: [f64; 3],
    returns: Vec<f64>,
    first: Course,
    ms_per_decision: f64,
    notes: Vec<String>,
}

/// What is played: a world and its rules.
struct Setting {
    task: Task,
    pendulum: PendulumSettings,
    rules: Rules,
    faults: Faults,
}

impl Setting {
    fn is_pendulum(&self) -> bool {
        is_pendulum(&self.task)
    }

    fn world(&self) -> Result<Box<dyn Environment>> {
        let rules = self.rules.clone();
        let world: Box<dyn Environment> = if self.is_pendulum() {
            Box::new(PendulumEnvironment::new(self.pendulum, rules)?)
        } else {
            Box::new(SceneEnvironment::new(&self.task, rules)?)
        };
        Ok(if self.faults == Faults::default() { world } else { Box::new(Faulty::new(world, self.faults)) })
    }

    fn true_model(&self) -> Result<Box<dyn Model>> {
        if self.is_pendulum() {
            return Ok(Box::new(self.pendulum.model()));
        }
        SceneEnvironment::true_model(&self.task)
    }
}

fn is_pendulum(task: &Task) -> bool {
    task.scene.as_ref().is_some_and(|scene| matches!(scene.motion, Motion::Pendulum { .. }))
}

impl Arguments {
    /// Plays all planners, prints a table, draws what they did, and returns the rows of the results.
    fn play_all(&self, out: &Path) -> Result<Vec<Row>> {
        ensure!(self.study.is_none(), "a study's lines cannot hold a study");
        ensure!(self.episodes > 0, "--episodes must be at least 1");
        let setting = self.setting()?;
        fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
        // What fails should do so before the first episode.
        for who in self.planner.iter().copied() {
            let model = who.sees().then(|| self.model_of(who, &setting)).transpose()?;
            self.controller(who, &setting, model.as_ref())?;
        }
        if let Reward::Goal(goal) = &setting.rules.reward
            && let Some(frame) = setting.world()?.show(&goal.place)
        {
            figures::write_frame(&out.join("goal.png"), &frame)?;
        }
        // What the bound reached is needed for every row.
        let bound = self.play(Who::TrueState, &setting, out)?;
        let upper_bound = bound.mean[0];
        let mut all = Vec::new();
        say!("{:<14}{:>10}{:>20}{:>14}{:>14}", "planner", "return", "95 %", "upper bound", "ms/decision");
        let others = self.planner.iter().filter(|who| **who != Who::TrueState);
        all.extend(self.planner.contains(&Who::TrueState).then_some(Ok(bound)));
        all.extend(others.map(|who| self.play(*who, &setting, out)));
        let all =
            all.into_iter().map(|played| played.inspect(|it| it.print(upper_bound))).collect::<Result<Vec<_>>>()?;
        let returns: Vec<_> = all.iter().map(|it| (it.name, it.returns.as_slice(), it.mean)).collect();
        figures::write_returns(&out.join("returns.png"), &returns)?;
        let courses: Vec<_> = all.iter().map(|it| (it.name, &it.first)).collect();
        figures::write_courses(
            &out.join("course.png"),
            setting.task.system.cell.coordinates,
            &setting.rules,
            &courses,
        )?;
        Ok(all.iter().map(|played| self.row(&setting, played, upper_bound)).collect())
    }

    fn row(&self, setting: &Setting, played: &Played, upper_bound: f64) -> Row {
        let run = self.run.as_ref().filter(|_| played.who.has_run());
        let degrees = |angle: f64| if setting.is_pendulum() { angle.to_degrees() } else { angle };
        let goal = match &setting.rules.reward {
            Reward::Goal(goal) => Some(degrees(goal.place[0])),
            Reward::Gymnasium => None,
        };
        Row {
            task: setting.task.name.clone(),
            planner: played.name.into(),
            model: run.map(|run| run.display().to_string()),
            clips: run.and_then(|run| training_clips(run)),
            goal,
            gravity: setting.is_pendulum().then_some(self.gravity),
            setting: self.unusual(played.who),
            episodes: self.episodes,
            return_mean: played.mean[0],
            return_low: played.mean[1],
            return_high: played.mean[2],
            upper_bound,
            ms_per_decision: played.ms_per_decision,
        }
    }

    /// What of the setting is not as usual, beyond goal and gravity.
    fn unusual(&self, who: Who) -> String {
        let mut parts = Vec::new();
        let mut say = |shown: bool, text: String| parts.extend(shown.then_some(text));
        say(self.gymnasium, "Gymnasium's cost".into());
        say(self.search == Method::PathIntegral, "path integrals".into());
        say(self.goal_image.is_some(), "goal by image".into());
        say(self.goal_swing != 0.0, format!("goal swings by {} in {} steps", self.goal_swing, self.goal_period));
        say(self.frames_before != 3, format!("{} frames before", self.frames_before));
        say(self.length != 1.0, format!("length {}", self.length));
        say(self.mass != 1.0, format!("mass {}", self.mass));
        say(self.start_rate.is_some(), format!("first rate {}", self.start_rate.unwrap_or_default()));
        say(self.dropped > 0.0, format!("{:.0} % of the frames dropped", 100.0 * self.dropped));
        say(self.hidden > 0.0, format!("{:.0} % of the frames hidden", 100.0 * self.hidden));
        let learned = who == Who::Learned;
        say(learned && !self.model_set.is_empty(), format!("model's {}", self.model_set.join(", ")));
        let again = format!("{} learned again from {} frames", self.relearn.join(", "), self.relearn_frames);
        say(learned && !self.relearn.is_empty(), again);
        parts.join("; ")
    }

    fn setting(&self) -> Result<Setting> {
        let task = match &self.run {
            Some(run) => match training::read_config(run)? {
                Some(whole) => tasks::find(&whole.task)?,
                None => self.loaded()?.0,
            },
            None => tasks::find(&self.task)?,
        };
        let scene = task.scene.as_ref().with_context(|| format!("task {} has no scene to act in", task.name))?;
        let rules = if is_pendulum(&task) {
            let goal = self.goal_of_pendulum()?.swinging(self.goal_swing.to_radians(), self.goal_period);
            if self.gymnasium { Rules::gymnasium() } else { Rules::pendulum(goal) }
        } else {
            ensure!(!self.gymnasium, "--gymnasium is the cost of a pendulum");
            ensure!(
                (self.gravity, self.length, self.mass, self.start_rate) == (10.0, 1.0, 1.0, None),
                "--gravity, --length, --mass and --start-rate are a pendulum's"
            );
            let goal = self.goal_in_plane(&task)?.swinging(self.goal_swing, self.goal_period);
            let reward = Reward::Goal(goal);
            Rules { steps: 50, hold: 2, largest_action: scene.largest_action(), reward, frames_before: 0 }
        };
        ensure!(self.goal_period > 0.0, "--goal-period must be above 0, not {}", self.goal_period);
        let usual = if self.gymnasium { PendulumSettings::gymnasium() } else { PendulumSettings::default() };
        let (gravity, length, mass, rate) = (self.gravity, self.length, self.mass, self.start_rate);
        let faults = Faults { dropped: self.dropped, hidden: self.hidden };
        faults.check()?;
        let steps = self.steps.unwrap_or(rules.steps);
        ensure!(steps >= rules.hold, "--steps must be at least {}, not {steps}", rules.hold);
        Ok(Setting {
            pendulum: PendulumSettings { gravity, length, mass, rate, ..usual },
            rules: Rules { steps, frames_before: self.frames_before, ..rules },
            faults,
            task,
        })
    }

    fn goal_of_pendulum(&self) -> Result<Goal> {
        if let Some(file) = &self.goal_image {
            return Ok(Goal::angle(Vision::new(&self.loaded()?.1, pendulum::FORMAT)?.goal(file)?[0]));
        }
        match self.goal[..] {
            [] => Ok(Goal::angle(0.0)),
            [degrees] if degrees.is_finite() => Ok(Goal::angle(degrees.to_radians())),
            _ => bail!("--goal of a pendulum is one number of degrees, not {:?}", self.goal),
        }
    }

    fn goal_in_plane(&self, task: &Task) -> Result<Goal> {
        let side = task.system.side as f64;
        ensure!(task.system.cell.coordinates == Coordinates::Position, "task {}: there is no such world", task.name);
        if let Some(file) = &self.goal_image {
            let model = self.loaded()?.1;
            let seen = Vision::new(&model, format_of(task))?.goal(file)?;
            return Ok(Goal::point([seen[0], seen[1]], side));
        }
        match self.goal[..] {
            [x, y] if x.is_finite() && y.is_finite() => Ok(Goal::point([x, y], side)),
            _ => bail!("--goal of task {} is x,y in pixels, not {:?}", task.name, self.goal),
        }
    }

    /// The run's task and its model as it was saved.
    fn loaded(&self) -> Result<(Task, PhysicsNet)> {
        let run = self.run.as_ref().context("this needs a run folder, for the model that sees")?;
        let (config, model) = load_model(run, SavedWeights::Last, Device::Cpu)?;
        Ok((config.task, model))
    }

    /// The run's latent model.
    fn planet(&self, setting: &Setting) -> Result<Planet> {
        let run = self.run.as_ref().context("the planner latent needs the run folder of a `planet`")?;
        let config = training::read_config(run)?.filter(|config| config.model == WholeModel::Planet);
        let config = config.with_context(|| format!("{} is not the run of a `planet`", run.display()))?;
        let upright = matches!(&setting.rules.reward, Reward::Goal(goal) if goal.place == [0.0] && goal.swing == 0.0);
        ensure!(upright, "a latent model knows no other goal than the one that it was told the rewards of: upright");
        let planet = Planet::new(&setting.task.system, config.seed, Device::Cpu);
        training::load_weights(run, &planet)?;
        Ok(planet)
    }

    /// Plays all episodes of one planner and writes the animation of the first.
    fn play(&self, who: Who, setting: &Setting, out: &Path) -> Result<Played> {
        let mut world = setting.world()?;
        let model = who.sees().then(|| self.model_of(who, setting)).transpose()?;
        let mut controller = self.controller(who, setting, model.as_ref())?;
        let mut episodes: Vec<Episode> = Vec::new();
        for index in 0..self.episodes {
            let mut episode = play(world.as_mut(), &mut controller, self.seed.wrapping_add(index as u64), index == 0);
            if index == 0 {
                let film = out.join(format!("{}.gif", who.name(model.as_ref()).replace(' ', "_")));
                figures::write_film(&film, &episode, &mut controller, world.as_ref())?;
            }
            episode.frames.clear();
            episodes.push(episode);
        }
        let returns: Vec<f64> = episodes.iter().map(|episode| episode.total).collect();
        let seconds: f64 = episodes.iter().map(|episode| episode.deciding.as_secs_f64()).sum();
        let decisions: usize = episodes.iter().map(|episode| episode.decisions).sum();
        let notes = episodes.iter().enumerate();
        Ok(Played {
            who,
            name: who.name(model.as_ref()),
            mean: mean_and_interval(&returns, self.seed).context("no episodes")?,
            ms_per_decision: 1000.0 * seconds / decisions.max(1) as f64,
            notes: notes
                .flat_map(|(index, played)| played.notes.iter().map(move |note| format!("episode {index}, {note}")))
                .collect(),
            first: Course::of(&episodes[0]),
            returns,
        })
    }

    /// The model of a planner that sees, with the physics that its refinement goes by.
    fn model_of(&self, who: Who, setting: &Setting) -> Result<PhysicsNet> {
        let model = self.loaded()?.1;
        ensure!(
            model.black_box.is_none() || (who == Who::Learned && self.model_set.is_empty()),
            "the run's model.dynamics is {}, not physics: it can be the planner learned, and has no parameters to set",
            model.options.dynamics.name()
        );
        let set = |name: &str, value: f64| -> Result<()> {
            let parameter = model.parameters.iter().find(|parameter| parameter.kind.name == name);
            let cell = model.system.cell.name;
            model.set_value(parameter.with_context(|| format!("equation {cell} has no parameter {name}"))?, value)
        };
        if who == Who::TrueEquation && setting.is_pendulum() {
            // The cell counts lengths in rods, and its rod has mass and length 1.
            set("g", setting.pendulum.gravity_acceleration() / 1.5)?;
            set("a", setting.pendulum.torque_acceleration() / 3.0)?;
        } else if who == Who::TrueEquation {
            setting.task.truth.iter().try_for_each(|truth| set(&truth.name, truth.value))?;
        } else {
            for given in &self.model_set {
                let (name, value) = given.split_once('=').context("--model-set takes NAME=VALUE")?;
                let value = value.parse().with_context(|| format!("--model-set {given}: no number"))?;
                set(name, value).with_context(|| format!("--model-set {given}"))?;
            }
        }
        Ok(model)
    }

    fn controller<'a>(&self, who: Who, setting: &Setting, seeing: Option<&'a PhysicsNet>) -> Result<Controller<'a>> {
        let planner = self.search_method(&setting.rules);
        let format = setting.world()?.format();
        Ok(match (who, seeing) {
            (Who::Zero, _) => Controller::Zero,
            (Who::Random, _) => Controller::random(),
            (Who::Latent, _) => {
                let model = Box::new(LatentModel::new(self.planet(setting)?));
                Controller::Latent { model, planner }
            }
            (Who::Learned, Some(net)) => {
                let learned = Controller::seeing(Vision::new(net, format)?, planner);
                if self.relearn.is_empty() {
                    return Ok(learned);
                }
                let relearning = Relearning { names: self.relearn.clone(), frames: self.relearn_frames };
                learned.relearning(relearning).context("--relearn")?
            }
            (Who::TrueEquation, Some(net)) => {
                Controller::seeing_with(Vision::new(net, format)?, setting.true_model()?, planner)
            }
            _ => Controller::TrueState { model: setting.true_model()?, planner },
        })
    }

    fn search_method(&self, rules: &Rules) -> Box<dyn Planner> {
        let settings = SearchSettings { hold: rules.hold, largest: rules.largest_action, ..SearchSettings::default() };
        match self.search {
            Method::CrossEntropy => Box::new(CrossEntropy::new(settings)),
            Method::PathIntegral => Box::new(PathIntegral::new(settings)),
        }
    }
}

fn format_of(task: &Task) -> FrameFormat {
    let system = &task.system;
    FrameFormat { side: system.side, channels: system.channels, dt: system.dt }
}

impl Played {
    fn print(&self, upper_bound: f64) {
        let [mean, low, high] = self.mean;
        let interval = format!("{low:.2} to {high:.2}");
        let ms = self.ms_per_decision;
        say!("{:<14}{mean:>10.2}{interval:>20}{upper_bound:>14.2}{ms:>14.1}", self.name);
        self.notes.iter().take(NOTES).for_each(|note| say!("  note: {note}"));
        if self.notes.len() > NOTES {
            say!("  and {} more notes like these", self.notes.len() - NOTES);
        }
    }
}

/// Clips that a run was trained on, if it says so.
fn training_clips(run: &Path) -> Option<usize> {
    let whole = WholeScores::read(run).ok().flatten().map(|scores| scores.training_clips);
    whole.or_else(|| Run::read(run).ok()?.data.map(|data| data.clips[0]))
}
