//! Control from the command line: what `control` calls.

mod controllers;
mod playing;
mod rows;
mod setting;
mod study;
mod who;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::{Args, Parser};

use self::study::Study;
use self::who::{Method, Who};
use paig::support::{device, storage};
use paig_experiments::control::figures;
use paig_experiments::control::results::{FORMAT, Results};
use paig_terminal::environment;
use paig_terminal::say;

/// Plans with the learned physics, from what is seen, and scores it beside planners that know more or nothing.
///
/// Writes results.json, pictures, and an animation of each planner's first episode. The same seed plays the same episodes.
#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Example:\n  paig control runs/pendulum/fast/seed=0 --planner learned,zero --goal 30 --gravity 6 --model-set g=6"
)]
pub struct Arguments {
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

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    // Before anything is opened: it starts the program over.
    environment::set();
    device::set_threads(arguments.threads)?;
    let out = &arguments.out();
    let rows = match &arguments.study {
        None => arguments.play_all(out)?,
        Some(file) => {
            let text = storage::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
            let study: Study = toml::from_str(&text).with_context(|| format!("{}", file.display()))?;
            let mut parsed = Vec::new();
            for play in &study.play {
                let words = ["control"].into_iter().chain(play.arguments.split_whitespace());
                let line = Line::try_parse_from(words).map(|line| line.arguments);
                parsed.push(line.with_context(|| format!("{}: {}", file.display(), play.name))?);
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

/// A line of a study.
#[derive(Debug, Parser)]
struct Line {
    #[command(flatten)]
    arguments: Arguments,
}

impl Arguments {
    /// The folder of the results.
    fn out(&self) -> PathBuf {
        let usual = || match &self.run {
            Some(run) => run.join("control"),
            None => Path::new("runs/control/played").into(),
        };
        self.out.clone().unwrap_or_else(usual)
    }
}
