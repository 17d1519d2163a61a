//! Who decides, with which model.

use anyhow::{Context, Result, ensure};
use tch::Device;

use super::setting::Setting;
use super::{Arguments, Method, Who};
use paig::network::physics_models::PhysicsNet;
use paig_experiments::baselines::whole_models::checkpoint::load_weights;
use paig_experiments::baselines::whole_models::config::{self, WholeModel};
use paig_experiments::baselines::whole_models::planet::Planet;
use paig_experiments::control::controller::Controller;
use paig_experiments::control::cross_entropy::CrossEntropy;
use paig_experiments::control::environment::Rules;
use paig_experiments::control::latent::LatentModel;
use paig_experiments::control::mppi::PathIntegral;
use paig_experiments::control::planner::{Planner, SearchSettings};
use paig_experiments::control::relearning::Relearning;
use paig_experiments::control::reward::Reward;
use paig_experiments::control::vision::Vision;

impl Arguments {
    /// The run's latent model.
    pub(super) fn planet(&self, setting: &Setting) -> Result<Planet> {
        let run =
            self.run.as_ref().context("the planner latent needs the run folder of `paig train-baseline planet`")?;
        let config = config::read(run)?.filter(|config| config.model == WholeModel::Planet);
        let config =
            config.with_context(|| format!("{} is not the run of `paig train-baseline planet`", run.display()))?;
        let upright = matches!(&setting.rules.reward, Reward::Goal(goal) if goal.place == [0.0] && goal.swing == 0.0);
        let world = setting.world()?.format();
        world.check(&setting.task.system)?;
        ensure!(upright, "a latent model knows no other goal than the one that it was told the rewards of: upright");
        let planet = Planet::new(&setting.task.system, config.seed, Device::Cpu);
        load_weights(run, &planet)?;
        Ok(planet)
    }

    /// The model of a planner that sees, with the physics that its refinement goes by.
    pub(super) fn model_of(&self, who: Who, setting: &Setting) -> Result<PhysicsNet> {
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
        if let (Who::TrueEquation, Some(pendulum)) = (who, setting.pendulum) {
            // The cell counts lengths in rods, and its rod has mass and length 1.
            set("g", pendulum.gravity_acceleration() / 1.5)?;
            set("a", pendulum.torque_acceleration() / 3.0)?;
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

    pub(super) fn controller<'a>(
        &self,
        who: Who,
        setting: &Setting,
        seeing: Option<&'a PhysicsNet>,
    ) -> Result<Controller<'a>> {
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

    pub(super) fn search_method(&self, rules: &Rules) -> Box<dyn Planner> {
        let settings = SearchSettings { hold: rules.hold, largest: rules.largest_action, ..SearchSettings::default() };
        match self.search {
            Method::CrossEntropy => Box::new(CrossEntropy::new(settings)),
            Method::PathIntegral => Box::new(PathIntegral::new(settings)),
        }
    }
}
