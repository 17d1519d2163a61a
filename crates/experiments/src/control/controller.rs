//! Who decides what acts: by sight, or, as bounds of what sight can reach, by the truth or without any.

use std::fmt::{self, Debug, Formatter};

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use tch::Tensor;

use super::environment::Environment;
use super::eyes::{Eyes, StateSource};
use super::latent::LatentModel;
use super::learned;
use super::model::{PlanStart, PlanningModel};
use super::planner::Planner;
use super::relearning::Relearning;
use super::state::ControlState;
use super::vision::Vision;
use paig::network::physics_models::PhysicsNet;
use paig::support::random::named_generator;

/// A way to decide.
pub enum Controller<'a> {
    /// Nothing acts.
    Zero,
    /// Anything within the limits, all as likely.
    Random(Box<ChaCha8Rng>),
    /// Plans from the true state; with the true equation as its model, the bound of what sight can reach.
    TrueState { model: Box<dyn PlanningModel + 'a>, planner: Box<dyn Planner> },
    /// Plans from what is seen.
    Seeing(Box<VisionController<'a>>),
    /// Plans in a latent model of what is seen.
    Latent { model: Box<LatentModel>, planner: Box<dyn Planner> },
}

/// A planner that sees.
pub struct VisionController<'a> {
    eyes: Eyes<'a>,
    model: Box<dyn PlanningModel + 'a>,
    planner: Box<dyn Planner>,
    relearning: Option<Relearning>,
    /// Unconstrained parameters of the model as they are when an episode begins; and from how many frames they have been learned
    /// again since.
    unconstrained: Vec<f64>,
    relearned: usize,
    /// The last number of frames among which some showed nothing.
    unseen: usize,
}

impl Debug for Controller<'_> {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        f.write_str(match self {
            Controller::Zero => "Zero",
            Controller::Random(_) => "Random",
            Controller::TrueState { .. } => "TrueState",
            Controller::Seeing(_) => "Seeing",
            Controller::Latent { .. } => "Latent",
        })
    }
}

/// What came of a decision.
#[derive(Debug, Clone, PartialEq)]
pub enum Decision {
    Act {
        action: f64,
        /// The state that was planned from; none where nothing is planned, or where the model knows no states.
        from: Option<ControlState>,
        note: Option<String>,
    },
    /// What is controlled is not seen, or its state is no number.
    Lost,
    /// The model foretells nothing.
    NoPlan,
}

impl<'a> Controller<'a> {
    pub fn random() -> Self {
        Controller::Random(Box::new(named_generator(0, "random torque")))
    }

    /// Plans from what is seen, on the model that was learned.
    pub fn seeing(vision: Vision<'a>, planner: Box<dyn Planner>) -> Self {
        let model = learned::of_net(vision.model);
        Self::seeing_with(vision, model, planner)
    }

    /// Plans from what is seen, on another model.
    pub fn seeing_with(vision: Vision<'a>, model: Box<dyn PlanningModel + 'a>, planner: Box<dyn Planner>) -> Self {
        let unconstrained = unconstrained_parameters(vision.model);
        let eyes = Eyes::new(vision);
        Controller::Seeing(Box::new(VisionController {
            eyes,
            model,
            planner,
            relearning: None,
            unconstrained,
            relearned: 0,
            unseen: 0,
        }))
    }

    /// The same, which learns parameters again in each episode; those of no other controller.
    ///
    /// # Errors
    /// See [`Relearning::check`].
    pub fn relearning(mut self, relearning: Relearning) -> anyhow::Result<Self> {
        if let Controller::Seeing(seeing) = &mut self {
            relearning.check(seeing.eyes.vision.model)?;
            seeing.relearning = Some(relearning);
        }
        Ok(self)
    }

    /// Begins an episode.
    pub fn begin(&mut self, seed: u64) {
        match self {
            Controller::Zero => {}
            Controller::Random(random) => **random = named_generator(seed, "random torque"),
            Controller::TrueState { planner, .. } => planner.begin(seed),
            Controller::Seeing(seeing) => seeing.begin(seed),
            Controller::Latent { model, planner } => {
                model.begin();
                planner.begin(seed);
            }
        }
    }

    /// Whether it looks at frames.
    pub fn sees(&self) -> bool {
        matches!(self, Controller::Seeing(_) | Controller::Latent { .. })
    }

    /// The decisions of the last plan, the one that acts now first; nothing of a controller that does not plan.
    pub fn planned(&self) -> &[f32] {
        match self {
            Controller::Zero | Controller::Random(_) => &[],
            Controller::TrueState { planner, .. } | Controller::Latent { planner, .. } => planner.planned(),
            Controller::Seeing(seeing) => seeing.planner.planned(),
        }
    }

    /// Unconstrained parameters of its model as they are now; none where none can be learned again.
    pub fn parameters(&self) -> Vec<f64> {
        match self {
            Controller::Seeing(seeing) => unconstrained_parameters(seeing.eyes.vision.model),
            _ => Vec::new(),
        }
    }

    /// Where its model leads with these [parameters](Self::parameters) from a state under these actions, one for each step;
    /// nothing of a controller without a model or where the model fails.
    pub fn foretell(&mut self, parameters: &[f64], from: &ControlState, actions: &[f32]) -> Vec<ControlState> {
        match self {
            Controller::Zero | Controller::Random(_) | Controller::Latent { .. } => Vec::new(),
            Controller::TrueState { model, .. } => model.follow(from, actions).unwrap_or_default(),
            Controller::Seeing(seeing) => seeing.foretell(parameters, from, actions),
        }
    }

    /// The model's drawing of states, `[states, channels, S, S]`; none of a controller that does not see.
    pub fn drawn(&self, states: &[&ControlState]) -> Option<Tensor> {
        match self {
            Controller::Seeing(seeing) => Some(seeing.eyes.vision.drawn(states)),
            _ => None,
        }
    }

    /// Decides at a step of an episode, after these frames (`[channels, S, S]` each; those before the episode are the first)
    /// and the actions between them.
    pub fn decide(
        &mut self,
        environment: &dyn Environment,
        step: usize,
        frames: &[Option<Tensor>],
        actions: &[f64],
    ) -> Decision {
        let rules = environment.rules();
        match self {
            Controller::Zero => Decision::Act { action: 0.0, from: None, note: None },
            Controller::Random(random) => {
                let action = rules.largest_action * (2.0 * random.random::<f64>() - 1.0);
                Decision::Act { action, from: None, note: None }
            }
            Controller::TrueState { model, planner } => {
                let state = environment.true_state();
                let planned = planner.plan(model.as_mut(), PlanStart { state: &state, step, reward: &rules.reward });
                acted(planned, Some(state), None)
            }
            Controller::Seeing(seeing) => {
                let relearned = seeing.relearn(frames, actions);
                let (state, note) = match seeing.eyes.look(frames, actions, seeing.model.as_mut()) {
                    StateSource::Seen(state) => (state, relearned),
                    StateSource::Foretold(state, ago) => (state, Some(format!("not seen for {ago} steps: foretold"))),
                    StateSource::Lost => return Decision::Lost,
                };
                let outset = PlanStart { state: &state, step, reward: &rules.reward };
                let planned = seeing.planner.plan(seeing.model.as_mut(), outset);
                acted(planned, Some(state), note)
            }
            Controller::Latent { model, planner } => {
                model.see(frames, actions);
                let nowhere = ControlState::new(Vec::new(), Vec::new());
                let outset = PlanStart { state: &nowhere, step, reward: &rules.reward };
                acted(planner.plan(model.as_mut(), outset), None, None)
            }
        }
    }
}

fn unconstrained_parameters(model: &PhysicsNet) -> Vec<f64> {
    model.parameters.iter().map(|parameter| parameter.unconstrained.double_value(&[])).collect()
}

fn acted(planned: Option<f64>, from: Option<ControlState>, note: Option<String>) -> Decision {
    match planned.filter(|action| action.is_finite()) {
        Some(action) => Decision::Act { action, from, note },
        None => Decision::NoPlan,
    }
}

impl VisionController<'_> {
    fn begin(&mut self, seed: u64) {
        self.planner.begin(seed);
        self.eyes.begin();
        if self.relearned > 0 {
            self.set(&self.unconstrained.clone());
        }
        (self.relearned, self.unseen) = (0, 0);
    }

    /// Sets the unconstrained parameters.
    fn set(&mut self, unconstrained: &[f64]) {
        let model = self.eyes.vision.model;
        model
            .parameters
            .iter()
            .zip(unconstrained)
            .for_each(|(parameter, unconstrained)| model.set_unconstrained(parameter, *unconstrained));
        self.rebuild();
    }

    /// See [`Controller::foretell`]. The parameters are the same afterwards.
    fn foretell(&mut self, parameters: &[f64], from: &ControlState, actions: &[f32]) -> Vec<ControlState> {
        let now = unconstrained_parameters(self.eyes.vision.model);
        // A model that is not the learned one never has others.
        let others = self.relearned > 0 && parameters != now;
        if others {
            self.set(parameters);
        }
        let states = self.model.follow(from, actions).unwrap_or_default();
        if others {
            self.set(&now);
        }
        states
    }

    /// The planned-with model with the parameters as they are now.
    fn rebuild(&mut self) {
        self.model = learned::of_net(self.eyes.vision.model);
    }

    /// Learns parameters again where there are frames enough; what went wrong.
    fn relearn(&mut self, frames: &[Option<Tensor>], actions: &[f64]) -> Option<String> {
        let relearning = self.relearning.as_ref()?;
        let due = relearning.due(frames.len(), self.relearned)?;
        self.eyes.see(frames);
        let Some((positions, mask)) = self.eyes.first(due) else {
            // What the newest frame does not show is foretold after this: the next decision tries again, and says no more.
            let said = std::mem::replace(&mut self.unseen, due) == due;
            let note = "nothing is learned again yet: some frames do not show what is controlled";
            return (!said).then(|| note.into());
        };
        self.relearned = due;
        let result = relearning.learn(self.eyes.vision.model, &positions, mask, actions);
        self.rebuild();
        result.err().map(|error| format!("nothing was learned again: {error:#}"))
    }
}

#[cfg(test)]
mod tests {
    use tch::Device;

    use super::*;
    use crate::control::cross_entropy::CrossEntropy;
    use crate::control::environment::Rules;
    use crate::control::pendulum::{FORMAT, PendulumEnvironment, PendulumSettings};
    use crate::control::planner::SearchSettings;
    use crate::control::reward::GoalPath;
    use paig::network::physics_models::ModelOptions;
    use paig::tasks;

    fn untrained() -> PhysicsNet {
        let options = ModelOptions { refinement_steps: 2, exact_shift: true, ..ModelOptions::original() };
        let system = tasks::builtin("pendulum").unwrap().system;
        PhysicsNet::new(&system, &options, Device::Cpu, 1).unwrap()
    }

    fn relearning(net: &PhysicsNet) -> Controller<'_> {
        let search = SearchSettings { candidates: 20, iterations: 2, ..SearchSettings::default() };
        let controller = Controller::seeing(Vision::new(net, FORMAT).unwrap(), Box::new(CrossEntropy::new(search)));
        controller.relearning(Relearning { names: vec!["g".into()], frames: 25 }).unwrap()
    }

    /// The seventh frame, from which parameters are first learned, does not arrive; it is foretold, and counts then.
    #[test]
    fn what_a_missing_frame_holds_back_is_learned_at_the_next_decision() {
        let net = untrained();
        let mut controller = relearning(&net);
        let rules = Rules::pendulum(GoalPath::angle(0.0));
        let mut world = PendulumEnvironment::new(PendulumSettings::default(), rules).unwrap();
        world.reset(2);
        let mut frames = Vec::new();
        let mut learned_from = |frame: usize| {
            frames.push(if frame == 6 { None } else { world.observe() });
            world.step(0.5);
            if frame >= 5 {
                controller.decide(&world, 0, &frames, &vec![0.5; frame]);
            }
            let Controller::Seeing(seeing) = &controller else { unreachable!("it sees") };
            seeing.relearned
        };
        assert_eq!([0, 1, 2, 3, 4, 5, 6, 7].map(&mut learned_from), [0, 0, 0, 0, 0, 0, 0, 7]);
    }

    /// What a film shows of a plan is what the model foretold then, not what it would foretell after it has learned.
    #[test]
    fn a_plan_is_foretold_with_the_parameters_of_its_time() {
        let net = untrained();
        let mut controller = relearning(&net);
        let (from, actions) = (ControlState::turning(0.4, -1.0), [0.5; 8]);
        let early = controller.parameters();
        let foretold = controller.foretell(&early, &from, &actions);
        let Controller::Seeing(seeing) = &mut controller else { unreachable!("it sees") };
        // As if they had been learned again.
        seeing.set(&early.iter().map(|unconstrained| unconstrained + 0.5).collect::<Vec<_>>());
        seeing.relearned = 7;
        let late = controller.parameters();
        assert_ne!(controller.foretell(&late, &from, &actions), foretold);
        assert_eq!(controller.foretell(&early, &from, &actions), foretold);
        assert_eq!(controller.parameters(), late);
    }
}
