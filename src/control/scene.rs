//! Any task whose objects move by its own equation while something acts on them, as a world to act in.
//!
//! Its objects begin, move and look as in the task's dataset; only the action is the agent's.

use anyhow::{Context, Result, ensure};
use tch::Tensor;

use super::environment::{Environment, FrameFormat, Rules, seen};
use super::model::{self, Model};
use super::state::ControlState;
use crate::datasets::files::Split;
use crate::generators::render::Renderer;
use crate::generators::simulate::{SceneState, World};
use crate::generators::source_images::SourceImages;
use crate::generators::streams::Streams;
use crate::generators::variant::Variant;
use crate::network::cells::Coordinates;
use crate::support::random::named_generator;
use crate::tasks::Task;
use crate::tasks::scene::Motion;

/// Draws of a first state off the walls: far more than any task needs.
const MAX_DRAWS: usize = 10_000;

/// A task's scene under an agent's actions.
#[derive(Debug)]
pub struct SceneEnvironment {
    rules: Rules,
    format: FrameFormat,
    world: World,
    renderer: Renderer,
    state: SceneState,
    step: usize,
    /// Seed of the episode: what a scene draws by chance.
    seed: u64,
}

impl SceneEnvironment {
    /// At its first start, until it is reset.
    ///
    /// # Errors
    /// A task without a scene, or whose objects do not move by an equation of positions that something acts on.
    pub fn new(task: &Task, rules: Rules) -> Result<Self> {
        let variant = Variant::new(task, 0)?;
        let cell = task.system.cell;
        ensure!(
            variant.scene.motion == (Motion::Equation {})
                && cell.can_be_driven()
                && cell.coordinates == Coordinates::Position,
            "task {}: its objects must move by their own equation (motion = {{ law = \"equation\" }}) with an action u",
            task.name
        );
        let renderer = Renderer::new(&variant, &SourceImages::of(&variant)?)?;
        let world = variant.world();
        let state = world.draw_initial(&mut named_generator(0, "scene's start"));
        let format = FrameFormat { side: variant.side, channels: task.system.channels, dt: variant.dt };
        Ok(SceneEnvironment { rules, format, world, renderer, state, step: 0, seed: 0 })
    }

    /// The task's own equation with its true parameters.
    ///
    /// # Errors
    /// A task whose parameters are not known.
    pub fn true_model(task: &Task) -> Result<Box<dyn Model>> {
        let kind = task.system.cell;
        let raw = kind.parameters.iter().map(|parameter| {
            let value = task.truth_of(parameter.name).or(parameter.fixed);
            let value = value.with_context(|| format!("task {}: {} is not known", task.name, parameter.name))?;
            Ok(Tensor::from(parameter.bounds.raw(value) as f32))
        });
        let cell = task.system.build_cell(&raw.collect::<Result<Vec<_>>>()?);
        Ok(model::of_cell(cell, task.system.dt))
    }
}

impl Environment for SceneEnvironment {
    fn reset(&mut self, seed: u64) {
        let mut random = named_generator(seed, "scene's start");
        let inside = |state: &SceneState| {
            let range = self.world.wall_margin..self.world.side - self.world.wall_margin;
            state.positions.iter().all(|x| range.contains(x))
        };
        for _ in 0..MAX_DRAWS {
            self.state = self.world.draw_initial(&mut random);
            if inside(&self.state) {
                break;
            }
        }
        (self.step, self.seed) = (0, seed);
    }

    fn go_back(&mut self, steps: usize) {
        let backwards = World { dt: -self.world.dt, ..self.world.clone() };
        self.state.action = 0.0;
        (0..steps * backwards.substeps).for_each(|_| backwards.substep(&mut self.state));
    }

    fn observe(&mut self) -> Option<Tensor> {
        let streams = Streams { seed: self.seed, split: Split::Test, index: 0, take: self.step };
        let film = self.renderer.draw(std::slice::from_ref(&self.state), &streams).ok()?;
        Some(seen(&film.frames[0], self.format))
    }

    fn show(&mut self, positions: &[f64]) -> Option<Tensor> {
        self.state.positions[..positions.len()].copy_from_slice(positions);
        self.state.velocities.fill(0.0);
        self.observe()
    }

    fn empty_frame(&self) -> Tensor {
        seen(&vec![0.0; self.format.channels * self.format.side.pow(2)], self.format)
    }

    fn step(&mut self, action: f64) -> f64 {
        let before = self.true_state();
        self.state.action = self.rules.within_limits(action);
        (0..self.world.substeps).for_each(|_| self.world.substep(&mut self.state));
        self.step += 1;
        self.rules.reward.of(self.step - 1, &before, self.state.action, &self.true_state())
    }

    fn true_state(&self) -> ControlState {
        ControlState::new(self.state.positions.clone(), self.state.velocities.clone())
    }

    fn rules(&self) -> &Rules {
        &self.rules
    }

    fn format(&self) -> FrameFormat {
        self.format
    }
}
