//! The controller of each planner, with its model.

use anyhow::{Context, Result, ensure};
use tch::Device;

use super::scenario::Scenario;
use super::{Experiment, PlannerKind, SearchMethod};
use crate::baselines::end_to_end::checkpoint::load_weights;
use crate::baselines::end_to_end::config::{self, EndToEndModel};
use crate::baselines::end_to_end::planet::Planet;
use crate::control::controller::Controller;
use crate::control::cross_entropy::CrossEntropy;
use crate::control::environment::Rules;
use crate::control::latent::LatentModel;
use crate::control::mppi::PathIntegral;
use crate::control::planner::{Planner, SearchSettings};
use crate::control::relearning::Relearning;
use crate::control::reward::Reward;
use crate::control::vision::Vision;
use paig::network::physics_models::PhysicsNet;

impl Experiment {
    /// The run's latent model.
    pub(super) fn planet(&self, scenario: &Scenario) -> Result<Planet> {
        let run =
            self.run.as_ref().context("the planner latent needs the run folder of `paig train-baseline planet`")?;
        let config = config::read(run)?.filter(|config| config.model == EndToEndModel::Planet);
        let config =
            config.with_context(|| format!("{} is not the run of `paig train-baseline planet`", run.display()))?;
        let upright = matches!(&scenario.rules.reward, Reward::Goal(goal) if goal.place == [0.0] && goal.swing == 0.0);
        let world = scenario.world()?.format();
        world.check(&scenario.task.system)?;
        ensure!(upright, "a latent model knows no other goal than the one that it was told the rewards of: upright");
        let planet = Planet::new(&scenario.task.system, config.seed, Device::Cpu);
        load_weights(run, &planet)?;
        Ok(planet)
    }

    /// The model of a planner that sees, with the physics that its refinement goes by.
    pub(super) fn model_of(&self, kind: PlannerKind, scenario: &Scenario) -> Result<PhysicsNet> {
        let model = self.loaded()?.1;
        ensure!(
            model.black_box.is_none() || (kind == PlannerKind::Learned && self.model_set.is_empty()),
            "the run's model.dynamics is {}, not physics: it can be the planner learned, and has no parameters to set",
            model.options.dynamics.name()
        );
        let set = |name: &str, value: f64| -> Result<()> {
            let parameter = model.parameters.iter().find(|parameter| parameter.kind.name == name);
            let cell = &model.system.cell.name;
            model.set_value(parameter.with_context(|| format!("equation {cell} has no parameter {name}"))?, value)
        };
        if let (PlannerKind::TrueEquation, Some(pendulum)) = (kind, scenario.pendulum) {
            // The cell counts lengths in rods, and its rod has mass and length 1.
            set("g", pendulum.gravity_acceleration() / 1.5)?;
            set("a", pendulum.torque_acceleration() / 3.0)?;
        } else if kind == PlannerKind::TrueEquation {
            scenario.task.truth.iter().try_for_each(|truth| set(&truth.name, truth.value))?;
        } else {
            for given in &self.model_set {
                let (name, value) = given.split_once('=').context("--model-set takes NAME=VALUE")?;
                let value = value.parse().with_context(|| format!("--model-set {given}: no number"))?;
                set(name, value).with_context(|| format!("--model-set {given}"))?;
            }
        }
        Ok(model)
    }

    pub(super) fn controller<'a>(
        &self,
        kind: PlannerKind,
        scenario: &Scenario,
        seeing: Option<&'a PhysicsNet>,
    ) -> Result<Controller<'a>> {
        let planner = self.search_method(&scenario.rules);
        let format = scenario.world()?.format();
        Ok(match (kind, seeing) {
            (PlannerKind::Zero, _) => Controller::Zero,
            (PlannerKind::Random, _) => Controller::random(),
            (PlannerKind::Latent, _) => {
                let model = Box::new(LatentModel::new(self.planet(scenario)?));
                Controller::Latent { model, planner }
            }
            (PlannerKind::Learned, Some(net)) => {
                let learned = Controller::seeing(Vision::new(net, format)?, planner);
                if self.relearn.is_empty() {
                    return Ok(learned);
                }
                let relearning = Relearning { names: self.relearn.clone(), frames: self.relearn_frames };
                learned.relearning(relearning).context("--relearn")?
            }
            (PlannerKind::TrueEquation, Some(net)) => {
                Controller::seeing_with(Vision::new(net, format)?, scenario.true_model()?, planner)
            }
            _ => Controller::TrueState { model: scenario.true_model()?, planner },
        })
    }

    pub(super) fn search_method(&self, rules: &Rules) -> Box<dyn Planner> {
        let settings = SearchSettings { hold: rules.hold, largest: rules.largest_action, ..SearchSettings::default() };
        match self.search {
            SearchMethod::CrossEntropy => Box::new(CrossEntropy::new(settings)),
            SearchMethod::PathIntegral => Box::new(PathIntegral::new(settings)),
        }
    }
}
