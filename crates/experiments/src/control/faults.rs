//! A camera that does not always deliver, and something that gets in its way.

use anyhow::{Result, ensure};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use tch::Tensor;

use super::environment::{Environment, FrameFormat, Rules};
use super::state::ControlState;
use paig::support::random::named_generator;

/// How often something goes wrong with a frame, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Faults {
    /// The frame does not arrive.
    pub dropped: f64,
    /// What is controlled is hidden in it.
    pub hidden: f64,
}

impl Faults {
    /// # Errors
    /// A share out of range.
    pub fn check(self) -> Result<()> {
        for (what, share) in [("dropped", self.dropped), ("hidden", self.hidden)] {
            ensure!((0.0..=1.0).contains(&share), "the share of frames that are {what} must be 0 to 1, not {share}");
        }
        Ok(())
    }
}

/// Another environment, seen through a faulty camera.
pub struct FaultyCamera {
    world: Box<dyn Environment>,
    faults: Faults,
    random: ChaCha8Rng,
}

impl FaultyCamera {
    pub fn new(world: Box<dyn Environment>, faults: Faults) -> Self {
        FaultyCamera { world, faults, random: named_generator(0, "camera's faults") }
    }
}

impl Environment for FaultyCamera {
    fn reset(&mut self, seed: u64) {
        self.random = named_generator(seed, "camera's faults");
        self.world.reset(seed);
    }

    fn restart(&mut self, seed: u64) {
        self.world.restart(seed);
    }

    fn go_back(&mut self, steps: usize) {
        self.world.go_back(steps);
    }

    fn observe(&mut self) -> Option<Tensor> {
        // Both are drawn for every frame, so that one fault does not change where the other one falls.
        let [dropped, hidden] = [self.random.random::<f64>(), self.random.random::<f64>()];
        if dropped < self.faults.dropped {
            return None;
        }
        if hidden < self.faults.hidden { Some(self.world.empty_frame()) } else { self.world.observe() }
    }

    fn show(&mut self, positions: &[f64]) -> Option<Tensor> {
        self.world.show(positions)
    }

    fn empty_frame(&self) -> Tensor {
        self.world.empty_frame()
    }

    fn step(&mut self, action: f64) -> f64 {
        self.world.step(action)
    }

    fn true_state(&self) -> ControlState {
        self.world.true_state()
    }

    fn rules(&self) -> &Rules {
        self.world.rules()
    }

    fn format(&self) -> FrameFormat {
        self.world.format()
    }
}
