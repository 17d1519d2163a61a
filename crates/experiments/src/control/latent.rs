//! Planning in a latent model that was learned from frames, actions and rewards: no states are foretold, only rewards.

use anyhow::{Result, bail};
use tch::{Kind, Tensor};

use super::model::{PlanStart, PlanningModel};
use super::plans::{Plans, Trajectories};
use super::state::ControlState;
use crate::baselines::end_to_end::planet::{Belief, Planet};

/// The model, and what it believes in an episode.
#[derive(Debug)]
pub struct LatentModel {
    planet: Planet,
    belief: Belief,
    /// Frames that the belief takes into account.
    frames: usize,
}

impl LatentModel {
    pub fn new(planet: Planet) -> Self {
        LatentModel { belief: planet.start(1), planet, frames: 0 }
    }

    /// Forgets the last episode.
    pub fn begin(&mut self) {
        self.belief = self.planet.start(1);
        self.frames = 0;
    }

    /// Takes in those of an episode's frames so far (`[channels, S, S]`; none where the camera delivered nothing) that are
    /// new, and the actions between them.
    pub fn see(&mut self, frames: &[Option<Tensor>], actions: &[f64]) {
        let _guard = tch::no_grad_guard();
        for (place, frame) in frames.iter().enumerate().skip(self.frames) {
            let acted = if place == 0 { 0.0 } else { actions[place - 1] };
            let acted = Tensor::from(acted as f32).reshape([1, 1]);
            self.belief = match frame {
                Some(frame) => self.planet.see(&self.belief, &acted, &frame.unsqueeze(0)),
                None => self.planet.imagine(&self.belief, &acted),
            };
        }
        self.frames = frames.len();
    }
}

impl PlanningModel for LatentModel {
    fn roll_out(&mut self, _start: &ControlState, _plans: &Plans, _into: &mut Trajectories) -> Result<()> {
        bail!("a latent model foretells rewards, no states")
    }

    /// From what it believes now, by the most likely latents; the rewards are those it was told of in its training, whatever
    /// the outset's.
    fn returns(&mut self, _: PlanStart, plans: &Plans, _: &mut Trajectories, returns: &mut [f32]) -> Result<()> {
        let _guard = tch::no_grad_guard();
        let candidates = plans.candidates as i64;
        let mut belief = self.belief.repeated(candidates);
        let actions = Tensor::from_slice(plans.actions).reshape([-1, candidates, 1]);
        let mut sum = Tensor::zeros([candidates], (Kind::Float, tch::Device::Cpu));
        for step in 0..plans.steps() {
            belief = self.planet.imagine(&belief, &actions.get((step / plans.hold) as i64));
            sum += self.planet.reward(&belief);
        }
        returns.copy_from_slice(&Vec::<f32>::try_from(sum)?);
        Ok(())
    }
}
