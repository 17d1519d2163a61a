//! The world of an experiment and its rules.

use anyhow::{Context, Result, bail, ensure};
use tch::Device;

use super::Experiment;
use crate::baselines::end_to_end::config;
use crate::control::environment::{Environment, FrameFormat, Rules};
use crate::control::faults::{Faults, FaultyCamera};
use crate::control::model::PlanningModel;
use crate::control::pendulum::{self, PendulumEnvironment, PendulumSettings};
use crate::control::reward::{GoalPath, Reward};
use crate::control::scene::SceneEnvironment;
use crate::control::vision::Vision;
use paig::network::cells::Coordinates;
use paig::network::physics_models::PhysicsNet;
use paig::runs::checkpoint::SavedWeights;
use paig::tasks::scene::Motion;
use paig::tasks::{self, Task};
use paig::training::saved::load_model;

/// A world and its rules.
pub(super) struct Scenario {
    pub(super) task: Task,
    /// None of a task whose objects move in the plane.
    pub(super) pendulum: Option<PendulumSettings>,
    pub(super) rules: Rules,
    /// Steps of an episode where none are given.
    pub(super) usual_steps: usize,
    pub(super) faults: Faults,
}

impl Scenario {
    pub(super) fn world(&self) -> Result<Box<dyn Environment>> {
        let rules = self.rules.clone();
        let world: Box<dyn Environment> = match self.pendulum {
            Some(pendulum) => Box::new(PendulumEnvironment::new(pendulum, rules)?),
            None => Box::new(SceneEnvironment::new(&self.task, rules)?),
        };
        Ok(if self.faults == Faults::default() { world } else { Box::new(FaultyCamera::new(world, self.faults)) })
    }

    pub(super) fn true_model(&self) -> Result<Box<dyn PlanningModel>> {
        match self.pendulum {
            Some(pendulum) => Ok(Box::new(pendulum.model())),
            None => SceneEnvironment::true_model(&self.task),
        }
    }
}

impl Experiment {
    pub(super) fn scenario(&self) -> Result<Scenario> {
        let task = match &self.run {
            Some(run) => match config::read(run)? {
                Some(whole) => tasks::find(&whole.task)?,
                None => self.loaded()?.0,
            },
            None => tasks::find(&self.task)?,
        };
        let scene = task.scene.as_ref().with_context(|| format!("task {} has no scene to act in", task.name))?;
        let (largest_action, mut pendulum) = (scene.largest_action(), None);
        let rules = if matches!(scene.motion, Motion::Pendulum { .. }) {
            pendulum = Some(self.pendulum(PendulumSettings::of(&task)?));
            let goal = self.goal_of_pendulum()?.swinging(self.goal_swing.to_radians(), self.goal_period);
            let rules = if self.gymnasium { Rules::gymnasium() } else { Rules::pendulum(goal) };
            Rules { largest_action, ..rules }
        } else {
            ensure!(!self.gymnasium, "--gymnasium is the cost of a pendulum");
            let given = [self.gravity, self.length, self.mass, self.start_rate];
            ensure!(given == [None; 4], "--gravity, --length, --mass and --start-rate are a pendulum's");
            let goal = self.goal_in_plane(&task)?.swinging(self.goal_swing, self.goal_period);
            Rules { steps: 50, hold: 2, largest_action, reward: Reward::Goal(goal), frames_before: 0 }
        };
        ensure!(
            self.goal_period > 0.0 && self.goal_period.is_finite(),
            "--goal-period must be a number above 0, not {}",
            self.goal_period
        );
        ensure!(self.goal_swing.is_finite(), "--goal-swing must be a number, not {}", self.goal_swing);
        let faults = Faults { dropped: self.dropped, hidden: self.hidden };
        faults.check()?;
        let usual_steps = rules.steps;
        let steps = self.steps.unwrap_or(usual_steps);
        ensure!(steps >= rules.hold, "--steps must be at least {}, not {steps}", rules.hold);
        Ok(Scenario {
            pendulum,
            usual_steps,
            rules: Rules { steps, frames_before: self.frames_before, ..rules },
            faults,
            task,
        })
    }

    /// The scene's pendulum with what is given in its place.
    fn pendulum(&self, scene: PendulumSettings) -> PendulumSettings {
        let start = if self.gymnasium { PendulumSettings::gymnasium() } else { scene };
        PendulumSettings {
            gravity: self.gravity.unwrap_or(scene.gravity),
            length: self.length.unwrap_or(scene.length),
            mass: self.mass.unwrap_or(scene.mass),
            actuation: scene.actuation,
            largest_angle: start.largest_angle,
            largest_rate: start.largest_rate,
            rate: self.start_rate,
        }
    }

    pub(super) fn goal_of_pendulum(&self) -> Result<GoalPath> {
        if let Some(file) = &self.goal_image {
            return Ok(GoalPath::angle(Vision::new(&self.loaded()?.1, pendulum::FORMAT)?.goal(file)?[0]));
        }
        match self.goal[..] {
            [] => Ok(GoalPath::angle(0.0)),
            [degrees] if degrees.is_finite() => Ok(GoalPath::angle(degrees.to_radians())),
            _ => bail!("--goal of a pendulum is one number of degrees, not {:?}", self.goal),
        }
    }

    pub(super) fn goal_in_plane(&self, task: &Task) -> Result<GoalPath> {
        let side = task.system.side as f64;
        ensure!(task.system.cell.coordinates == Coordinates::Position, "task {}: there is no such world", task.name);
        if let Some(file) = &self.goal_image {
            let model = self.loaded()?.1;
            let seen = Vision::new(&model, format_of(task))?.goal(file)?;
            return Ok(GoalPath::point([seen[0], seen[1]], side));
        }
        match self.goal[..] {
            [x, y] if x.is_finite() && y.is_finite() => Ok(GoalPath::point([x, y], side)),
            _ => bail!("--goal of task {} is x,y in pixels, not {:?}", task.name, self.goal),
        }
    }

    /// The run's task and its model as it was saved.
    pub(super) fn loaded(&self) -> Result<(Task, PhysicsNet)> {
        let run = self.run.as_ref().context("this needs a run folder, for the model that sees")?;
        ensure!(
            !matches!(config::read(run), Ok(Some(_))),
            "{} is the run of an end-to-end baseline; that of `paig train-baseline planet` goes with --planner latent, without --goal-image",
            run.display()
        );
        let (config, model) = load_model(run, SavedWeights::Last, Device::Cpu)?;
        Ok((config.task, model))
    }
}

fn format_of(task: &Task) -> FrameFormat {
    let system = &task.system;
    FrameFormat { side: system.side, channels: system.channels, dt: system.dt }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// The scenario of the built-in pendulum with one text in the place of another one.
    fn scenario_of([from, to]: [&str; 2], experiment: Experiment) -> Result<Scenario> {
        let folder = tempfile::tempdir()?;
        let file = folder.path().join("task.toml");
        let text = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/tasks/pendulum.toml"))?
            .replace("name = \"pendulum\"", "name = \"mine\"");
        assert!(text.contains(from), "{from}");
        fs::write(&file, text.replace(from, to))?;
        Experiment { task: file.to_str().unwrap().into(), ..experiment }.scenario()
    }

    #[test]
    fn what_the_scene_says_is_played() {
        let numbers = [
            "g = 10.0, m = 1.0, length = 1.0, a = 1.0, torque = 2.0",
            "g = 5.0, m = 1.0, length = 1.0, a = 1.5, torque = 1.0",
        ];
        let scenario = scenario_of(numbers, Experiment::default()).unwrap();
        let pendulum = scenario.pendulum.unwrap();
        assert_eq!((pendulum.gravity, pendulum.torque_acceleration(), scenario.rules.largest_action), (5.0, 4.5, 1.0));
        let experiment = Experiment { gravity: Some(6.0), gymnasium: true, ..Experiment::default() };
        let changed = scenario_of(numbers, experiment).unwrap();
        let pendulum = changed.pendulum.unwrap();
        assert_eq!((pendulum.gravity, pendulum.actuation, pendulum.largest_rate), (6.0, 1.5, 1.0));
        // The usual scene is the paper's pendulum, to the bit.
        let usual = Experiment::default().scenario().unwrap();
        assert_eq!(usual.pendulum, Some(PendulumSettings::default()));
        assert_eq!(usual.rules, Rules::pendulum(GoalPath::angle(0.0).swinging(0.0, 50.0)));
    }

    #[test]
    fn a_scene_that_is_not_drawn_so_is_refused() {
        for (change, complaint) in [
            (
                ["look = \"bar\"", "look = \"bar\"\ncamera = { noise = 10.0 }"],
                "task mine: control does not draw the effects of scene.camera",
            ),
            (["side = 64", "side = 32"], "task mine: the model sees frames of 32 x 32"),
            (["dt = 0.05", "dt = 0.1"], "velocities would not agree"),
            (["torque = 2.0", "torque = 0.0"], "task mine: nothing can act"),
        ] {
            let error = format!("{:#}", scenario_of(change, Experiment::default()).err().unwrap());
            assert!(error.contains(complaint), "{error}");
        }
    }
}
