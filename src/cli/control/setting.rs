//! What is played, by the arguments.

use anyhow::{Context, Result, bail, ensure};
use tch::Device;

use super::Arguments;
use crate::baselines::training;
use crate::control::environment::{Environment, FrameFormat, Rules};
use crate::control::faults::{Faults, Faulty};
use crate::control::model::Model;
use crate::control::pendulum::{self, PendulumEnvironment, PendulumSettings};
use crate::control::reward::{Goal, Reward};
use crate::control::scene::SceneEnvironment;
use crate::control::vision::Vision;
use crate::network::cells::Coordinates;
use crate::network::physics_models::PhysicsNet;
use crate::runs::checkpoint::SavedWeights;
use crate::tasks::scene::Motion;
use crate::tasks::{self, Task};
use crate::training::saved::load_model;

/// What is played: a world and its rules.
pub(super) struct Setting {
    pub(super) task: Task,
    pub(super) pendulum: PendulumSettings,
    pub(super) rules: Rules,
    pub(super) faults: Faults,
}

impl Setting {
    pub(super) fn is_pendulum(&self) -> bool {
        is_pendulum(&self.task)
    }

    pub(super) fn world(&self) -> Result<Box<dyn Environment>> {
        let rules = self.rules.clone();
        let world: Box<dyn Environment> = if self.is_pendulum() {
            Box::new(PendulumEnvironment::new(self.pendulum, rules)?)
        } else {
            Box::new(SceneEnvironment::new(&self.task, rules)?)
        };
        Ok(if self.faults == Faults::default() { world } else { Box::new(Faulty::new(world, self.faults)) })
    }

    pub(super) fn true_model(&self) -> Result<Box<dyn Model>> {
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
    pub(super) fn setting(&self) -> Result<Setting> {
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

    pub(super) fn goal_of_pendulum(&self) -> Result<Goal> {
        if let Some(file) = &self.goal_image {
            return Ok(Goal::angle(Vision::new(&self.loaded()?.1, pendulum::FORMAT)?.goal(file)?[0]));
        }
        match self.goal[..] {
            [] => Ok(Goal::angle(0.0)),
            [degrees] if degrees.is_finite() => Ok(Goal::angle(degrees.to_radians())),
            _ => bail!("--goal of a pendulum is one number of degrees, not {:?}", self.goal),
        }
    }

    pub(super) fn goal_in_plane(&self, task: &Task) -> Result<Goal> {
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
    pub(super) fn loaded(&self) -> Result<(Task, PhysicsNet)> {
        let run = self.run.as_ref().context("this needs a run folder, for the model that sees")?;
        let (config, model) = load_model(run, SavedWeights::Last, Device::Cpu)?;
        Ok((config.task, model))
    }
}

fn format_of(task: &Task) -> FrameFormat {
    let system = &task.system;
    FrameFormat { side: system.side, channels: system.channels, dt: system.dt }
}
