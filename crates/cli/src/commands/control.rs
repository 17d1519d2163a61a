//! Control with the learned physics. See `paig control --help`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, ensure};
use clap::{Args, Parser, ValueEnum};
use paig::support::device;
use paig_experiments::control::experiment::{
    Experiment, ExperimentEvent, ExperimentWatch, PlannerKind, Played, SearchMethod,
};
use paig_experiments::control::study::{self, StudyEvent};
use paig_terminal::{interrupt, say};

/// Notes of a planner that are printed; their number is printed in any case.
const NOTES: usize = 3;

/// Who decides.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum PlannerChoice {
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

impl From<PlannerChoice> for PlannerKind {
    fn from(planner: PlannerChoice) -> Self {
        match planner {
            PlannerChoice::Learned => PlannerKind::Learned,
            PlannerChoice::TrueState => PlannerKind::TrueState,
            PlannerChoice::TrueEquation => PlannerKind::TrueEquation,
            PlannerChoice::Latent => PlannerKind::Latent,
            PlannerChoice::Random => PlannerKind::Random,
            PlannerChoice::Zero => PlannerKind::Zero,
        }
    }
}

/// How plans are searched for.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum SearchChoice {
    CrossEntropy,
    PathIntegral,
}

impl From<SearchChoice> for SearchMethod {
    fn from(search: SearchChoice) -> Self {
        match search {
            SearchChoice::CrossEntropy => SearchMethod::CrossEntropy,
            SearchChoice::PathIntegral => SearchMethod::PathIntegral,
        }
    }
}

/// Plans with the learned physics, from what is seen, and scores it beside planners that know more or nothing.
///
/// Writes results.json, pictures, and an animation of each planner's first episode. The same seed plays the same episodes.
#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Example:\n  paig control runs/pendulum/fast/seed=0 --planner learned,zero --goal 30 --gravity 6 --model-set g=6"
)]
pub struct ControlArguments {
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
    planner: Vec<PlannerChoice>,
    /// How plans are searched for
    #[arg(long, value_enum, default_value = "cross-entropy")]
    search: SearchChoice,
    /// Episodes of each planner, the same for all
    #[arg(long, default_value_t = 100)]
    episodes: usize,
    /// Seed of the first episode; the next ones count on
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Degrees from upright, clockwise; of a task in the plane x,y in pixels
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true)]
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
    /// Gravity of the environment's pendulum [default: that of the task's scene]
    #[arg(long)]
    gravity: Option<f64>,
    /// Length of the environment's pendulum [default: that of the task's scene]
    #[arg(long)]
    length: Option<f64>,
    /// Mass of the environment's pendulum [default: that of the task's scene]
    #[arg(long)]
    mass: Option<f64>,
    /// Rate with which the pendulum begins, in either direction, instead of one of up to the scene's largest
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
    /// Folder for the results; files of an earlier one are replaced [default: control in the run's folder; without a run,
    /// runs/control/played]
    #[arg(long)]
    out: Option<PathBuf>,
}

/// A line of a study.
#[derive(Debug, Parser)]
struct LineArguments {
    #[command(flatten)]
    arguments: ControlArguments,
}

pub fn run(arguments: &ControlArguments) -> Result<ExitCode> {
    device::set_threads(arguments.threads)?;
    interrupt::catch()?;
    let experiment = arguments.experiment();
    let out = &arguments.out.clone().unwrap_or_else(|| experiment.usual_out());
    let rows = match &arguments.study {
        None => experiment.run(out, ExperimentWatch { observe: &show, stop: &interrupt::asked })?,
        Some(file) => {
            let lines = study::read(file, &experiment_of_line)?;
            study::play(&lines, out, arguments.resume, &show_study, &interrupt::asked)?
        }
    };
    let Some(rows) = rows else {
        say!("stopped; a study goes on with --resume");
        return Ok(interrupt::exit_code());
    };
    say!("results in {}", study::write(out, rows)?.display());
    Ok(ExitCode::SUCCESS)
}

/// The experiment of a study's line.
fn experiment_of_line(text: &str) -> Result<Experiment> {
    let words = ["control"].into_iter().chain(text.split_whitespace());
    let LineArguments { arguments } = LineArguments::try_parse_from(words)?;
    ensure!(arguments.study.is_none(), "a study's lines cannot hold a study");
    Ok(arguments.experiment())
}

impl ControlArguments {
    fn experiment(&self) -> Experiment {
        Experiment {
            run: self.run.clone(),
            task: self.task.clone(),
            planners: self.planner.iter().map(|planner| (*planner).into()).collect(),
            search: self.search.into(),
            episodes: self.episodes,
            seed: self.seed,
            goal: self.goal.clone(),
            goal_image: self.goal_image.clone(),
            goal_swing: self.goal_swing,
            goal_period: self.goal_period,
            gymnasium: self.gymnasium,
            frames_before: self.frames_before,
            steps: self.steps,
            gravity: self.gravity,
            length: self.length,
            mass: self.mass,
            start_rate: self.start_rate,
            dropped: self.dropped,
            hidden: self.hidden,
            model_set: self.model_set.clone(),
            relearn: self.relearn.clone(),
            relearn_frames: self.relearn_frames,
        }
    }
}

/// Prints what happens in a study.
fn show_study(event: StudyEvent) {
    match event {
        StudyEvent::Begins(name) => {
            say!();
            say!("{name}");
        }
        StudyEvent::TakenOver => say!("played before"),
        StudyEvent::Experiment(event) => show(event),
    }
}

/// Prints a table with a line for each planner.
fn show(event: ExperimentEvent) {
    match event {
        ExperimentEvent::UpperBound(_) => {
            say!("{:<14}{:>10}{:>20}{:>14}{:>14}", "planner", "return", "95 %", "upper bound", "ms/decision");
        }
        ExperimentEvent::Begins | ExperimentEvent::Episode { .. } => {}
        ExperimentEvent::Played(played) => print(played),
    }
}

fn print(played: &Played) {
    let Played { name, mean: [mean, low, high], upper_bound, ms_per_decision, notes, .. } = played;
    let interval = format!("{low:.2} to {high:.2}");
    say!("{name:<14}{mean:>10.2}{interval:>20}{upper_bound:>14.2}{ms_per_decision:>14.1}");
    notes.iter().take(NOTES).for_each(|note| say!("  note: {note}"));
    if notes.len() > NOTES {
        say!("  and {} more notes like these", notes.len() - NOTES);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_those_of_the_library() {
        assert_eq!(experiment_of_line("").unwrap(), Experiment::default());
    }

    #[test]
    fn a_study_in_a_study_is_refused() {
        let error = experiment_of_line("--study other.toml").unwrap_err().to_string();
        assert_eq!(error, "a study's lines cannot hold a study");
    }
}
