//! Any task whose objects move by its own equation while something acts on them, as a world to act in.
//!
//! Its objects begin, move and look as in the task's dataset; only the action is the agent's. What each clip of the dataset
//! draws for itself, each episode does.

use anyhow::{Context, Result, ensure};
use tch::Tensor;

use super::environment::{Environment, FrameFormat, Rules, check_looks, seen};
use super::model::{self, PlanningModel};
use super::state::ControlState;
use paig::datasets::files::Split;
use paig::generators::render::Renderer;
use paig::generators::simulate::{SceneState, World};
use paig::generators::source_images::SourceImages;
use paig::generators::streams::Streams;
use paig::generators::variant::Variant;
use paig::network::cells::Coordinates;
use paig::support::random::named_generator;
use paig::tasks::Task;
use paig::tasks::scene::Motion;

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

/// The first state of an episode: the first one off the walls that is drawn, or the last one of many.
fn start(world: &World, seed: u64) -> SceneState {
    let mut random = named_generator(seed, "scene's start");
    let mut state = world.draw_initial(&mut random);
    for _ in 1..MAX_DRAWS {
        if is_off_the_walls(world, &state) {
            break;
        }
        state = world.draw_initial(&mut random);
    }
    state
}

fn is_off_the_walls(world: &World, state: &SceneState) -> bool {
    let range = world.wall_margin..world.side - world.wall_margin;
    state.positions.iter().all(|x| range.contains(x))
}

impl SceneEnvironment {
    /// At its first start, until it is reset.
    ///
    /// # Errors
    /// A task without a scene, whose objects do not move by an equation of positions that something acts on, whose scene
    /// looks different from frame to frame, or in which no start off the walls is drawn (with one seed: others hardly differ).
    pub fn new(task: &Task, rules: Rules) -> Result<Self> {
        let variant = Variant::new(task, 0)?;
        let cell = &task.system.cell;
        ensure!(
            variant.scene.motion == (Motion::Equation {})
                && cell.can_be_driven()
                && cell.coordinates == Coordinates::Position,
            "task {}: its objects must move by their own equation (motion = {{ law = \"equation\" }}) with an action u",
            task.name
        );
        check_looks(&variant.scene).with_context(|| format!("task {}", task.name))?;
        let renderer = Renderer::new(&variant, &SourceImages::of(&variant)?)?;
        let world = variant.world();
        let state = start(&world, 0);
        ensure!(
            is_off_the_walls(&world, &state),
            "task {}: no start off the walls in {MAX_DRAWS} draws; let its scene begin farther from them",
            task.name
        );
        let format = FrameFormat { side: variant.side, channels: task.system.channels, dt: variant.dt };
        Ok(SceneEnvironment { rules, format, world, renderer, state, step: 0, seed: 0 })
    }

    /// The task's own equation with its true parameters.
    ///
    /// # Errors
    /// A task whose parameters are not known.
    pub fn true_model(task: &Task) -> Result<Box<dyn PlanningModel>> {
        let kind = &task.system.cell;
        let unconstrained = kind.parameters.iter().map(|parameter| {
            let value = task.truth_of(&parameter.name).or(parameter.fixed);
            let value = value.with_context(|| format!("task {}: {} is not known", task.name, parameter.name))?;
            Ok(Tensor::from(parameter.bounds.unconstrained(value) as f32))
        });
        let cell = task.system.build_cell(&unconstrained.collect::<Result<Vec<_>>>()?);
        Ok(model::of_cell(cell, task.system.dt))
    }

    /// A frame of objects at these positions; none where there is no room for what else the scene shows.
    fn frame(&self, state: &SceneState) -> Option<Tensor> {
        // One take for the whole episode: what lies behind the objects stays where it is.
        let streams = Streams { seed: self.seed, split: Split::Test, index: 0, take: 0 };
        let film = self.renderer.draw(std::slice::from_ref(state), &streams).ok()?;
        Some(seen(&film.frames[0], self.format))
    }
}

impl Environment for SceneEnvironment {
    fn reset(&mut self, seed: u64) {
        self.state = start(&self.world, seed);
        (self.step, self.seed) = (0, seed);
    }

    fn go_back(&mut self, steps: usize) {
        let backwards = World { dt: -self.world.dt, ..self.world.clone() };
        self.state.action = 0.0;
        (0..steps * backwards.substeps).for_each(|_| backwards.substep(&mut self.state));
    }

    fn observe(&mut self) -> Option<Tensor> {
        self.frame(&self.state)
    }

    fn show(&mut self, positions: &[f64]) -> Option<Tensor> {
        self.state.positions[..positions.len()].copy_from_slice(positions);
        self.state.velocities.fill(0.0);
        self.observe()
    }

    fn empty_frame(&self) -> Tensor {
        // So far outside that nothing of an object hangs over the border.
        let outside =
            SceneState { positions: vec![-2.0 * self.world.side; self.state.positions.len()], ..self.state.clone() };
        let black = || seen(&vec![0.0; self.format.channels * self.format.side.pow(2)], self.format);
        self.frame(&outside).unwrap_or_else(black)
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

#[cfg(test)]
mod tests {
    use std::fs;

    use tch::Kind;

    use super::*;
    use crate::control::reward::{GoalPath, Reward};

    fn puck_with(looks: &str) -> Result<SceneEnvironment> {
        let task = Task::from_toml(
            &(fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/control/puck.toml"))? + looks),
        )?;
        let reward = Reward::Goal(GoalPath::point([22.0, 16.0], 32.0));
        SceneEnvironment::new(&task, Rules { steps: 50, hold: 2, largest_action: 1.0, reward, frames_before: 3 })
    }

    /// Only what is controlled moves before a background and a distractor that each episode draws for itself.
    #[test]
    fn what_lies_behind_the_objects_stays_for_an_episode() {
        let looks =
            "[scene.background]\nkind = \"random_texture\"\n[[scene.distractors]]\ncolour = [0.9]\nradius = 2.0\n";
        let mut world = puck_with(looks).unwrap();
        world.reset(3);
        let empty = world.empty_frame();
        for _ in 0..3 {
            let changed = world.observe().unwrap().ne_tensor(&empty).sum(Kind::Int64).int64_value(&[]);
            // A ball of radius 2.5, and the two pixels to each side that shrinking blurs: 9 x 9, or 10 x 10 off the grid.
            assert!((10..=100).contains(&changed), "{changed} pixels");
            world.step(1.0);
        }
        world.reset(4);
        assert_ne!(world.empty_frame(), empty);
        let mut plain = puck_with("").unwrap();
        plain.reset(3);
        assert_eq!(plain.empty_frame().max().double_value(&[]), 0.0);
    }

    #[test]
    fn a_scene_in_which_nothing_begins_off_the_walls_is_refused() {
        let puck = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/control/puck.toml")).unwrap();
        let mut task: toml::Table = toml::from_str(&puck).unwrap();
        // A ball of radius 2.5 touches the wall from 2.5 on.
        let begin = toml::Table::from_iter([("positions".into(), toml::Value::from(vec![vec![1.0, 16.0]]))]);
        task["scene"].as_table_mut().unwrap().insert("begin".into(), begin.into());
        let task = Task::from_toml(&toml::to_string(&task).unwrap()).unwrap();
        let reward = Reward::Goal(GoalPath::point([22.0, 16.0], 32.0));
        let rules = Rules { steps: 50, hold: 2, largest_action: 1.0, reward, frames_before: 3 };
        let error = format!("{:#}", SceneEnvironment::new(&task, rules).unwrap_err());
        assert!(error.contains("no start off the walls") && error.contains("task puck"), "{error}");
    }

    #[test]
    fn a_scene_that_changes_by_itself_is_refused() {
        for (looks, complaint) in [
            ("[scene.camera]\nnoise = 5.0\n", "scene.camera"),
            ("[scene.background]\nkind = \"drifting\"\n", "a drifting background"),
            ("[[scene.distractors]]\ncolour = [0.9]\nradius = 2.0\nspeed = 1.0\n", "distractors that move"),
        ] {
            let error = format!("{:#}", puck_with(looks).unwrap_err());
            assert!(error.contains(complaint) && error.contains("task puck"), "{error}");
        }
    }
}
