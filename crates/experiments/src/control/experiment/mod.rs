//! An experiment: the same episodes, played by one planner after the other.
//!
//! [`Experiment`] holds what is asked for, `scenario` and `controllers` make the world and the controllers of it, `play`
//! plays the episodes, and `rows` says what stands in the results.

mod controllers;
mod planners;
mod play;
mod rows;
mod scenario;

use std::path::{Path, PathBuf};

pub use self::planners::{PlannerKind, SearchMethod};
pub use self::play::Played;

/// Settings of an experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct Experiment {
    /// Run folder of a task with actions; only the planners that see need one.
    pub run: Option<PathBuf>,
    /// The task, where there is no run: a built-in one's name, or a file.
    pub task: String,
    pub planners: Vec<PlannerKind>,
    pub search: SearchMethod,
    /// Episodes of each planner, the same for all.
    pub episodes: usize,
    /// Seed of the first episode; the next ones count on.
    pub seed: u64,
    /// Degrees from upright, clockwise; of a task in the plane x and y in pixels. Empty for upright.
    pub goal: Vec<f64>,
    /// A picture of the goal, as large as a frame, instead.
    pub goal_image: Option<PathBuf>,
    /// Amplitude of a moving goal, degrees or pixels.
    pub goal_swing: f64,
    /// Steps of a full swing.
    pub goal_period: f64,
    /// Gymnasium's cost and start, 200 steps, instead of a goal.
    pub gymnasium: bool,
    /// Frames that the camera has delivered before an episode begins.
    pub frames_before: usize,
    /// Steps of an episode, if not the usual ones.
    pub steps: Option<usize>,
    /// The environment's pendulum, by default that of the task's scene.
    pub gravity: Option<f64>,
    pub length: Option<f64>,
    pub mass: Option<f64>,
    /// Rate with which the pendulum begins, in either direction, instead of one of up to the scene's largest.
    pub start_rate: Option<f64>,
    /// Share of the frames that do not arrive.
    pub dropped: f64,
    /// Share of the frames in which the controlled object is hidden.
    pub hidden: f64,
    /// Parameters of the learned model that are set: `g=6`.
    pub model_set: Vec<String>,
    /// Parameters that the learned planner fits again to the first frames of each episode.
    pub relearn: Vec<String>,
    /// The number of these frames.
    pub relearn_frames: usize,
}

impl Default for Experiment {
    fn default() -> Self {
        Experiment {
            run: None,
            task: "pendulum".into(),
            planners: vec![PlannerKind::Learned],
            search: SearchMethod::CrossEntropy,
            episodes: 100,
            seed: 0,
            goal: Vec::new(),
            goal_image: None,
            goal_swing: 0.0,
            goal_period: 50.0,
            gymnasium: false,
            frames_before: 3,
            steps: None,
            gravity: None,
            length: None,
            mass: None,
            start_rate: None,
            dropped: 0.0,
            hidden: 0.0,
            model_set: Vec::new(),
            relearn: Vec::new(),
            relearn_frames: 25,
        }
    }
}

impl Experiment {
    /// The usual folder of the results.
    pub fn usual_out(&self) -> PathBuf {
        let played = || Path::new("runs/control/played").into();
        self.run.as_ref().map_or_else(played, |run| run.join("control"))
    }
}

/// What happens in an experiment.
#[derive(Debug)]
pub enum ExperimentEvent<'a> {
    /// Settings, models and controllers are sound; the first episode is played next.
    Begins,
    /// Mean return of the planner that knows state and equation.
    UpperBound(f64),
    /// A planner has played `done` episodes; `reward` is the return of the last one.
    Episode { planner: &'static str, done: usize, of: usize, reward: f64 },
    /// A planner has played all its episodes.
    Played(&'a Played),
}

/// Who watches an experiment and stops it, between two episodes.
#[derive(Clone, Copy)]
pub struct ExperimentWatch<'a> {
    pub observe: &'a dyn Fn(ExperimentEvent),
    pub stop: &'a dyn Fn() -> bool,
}
