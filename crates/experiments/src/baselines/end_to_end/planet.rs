//! A small PlaNet (Hafner et al. 2019): a recurrent state-space model of frames, actions and rewards, to plan in.
//!
//! ```text
//! h_t = gru(h_{t-1}, [z_{t-1}, a_{t-1}])
//! z_t ~ p(z_t | h_t)             the prior, what is foretold
//! z_t ~ q(z_t | h_t, o_t)        the posterior, what is seen
//! o_t ~ N(frame(h_t, z_t), 1)    each pixel
//! r_t ~ N(reward(h_t, z_t), 0.1)
//! ```
//!
//! As published: this model, its loss (squared errors, and the KL divergence of q from p beyond some free nats), Adam at
//! 1e-3. Ours: it is smaller (published: h of 200, z of 30, four convolutions), a frame is cut into 4 x 4 patches first, and
//! it learns from given clips instead of collecting its own. It is told the reward of each frame it learns from, which the
//! physics is not.

use tch::nn::VarStore;
use tch::{Device, Kind, Tensor};

use super::frame_model::{Batch, FrameModel};
use super::gaussian::{Gaussian, StandardNormal};
use paig::network::System;
use paig::network::blocks::{Activation, Conv2d, Dense, Layers, Mlp};
use paig::network::cells::Actions;
use paig::network::dynamics::GruCell;
use paig::network::initial_values::glorot_uniform;

/// Numbers in h and in z.
const MEMORY: usize = 100;
const STATE: usize = 10;
/// Units of a hidden layer.
const HIDDEN: usize = 60;
/// What is seen of a frame.
const SEEN: usize = 100;
/// Side of a patch, pixels.
const PATCH: i64 = 4;
/// Channels of the encoder's convolutions, each followed by a pooling, and of the decoder's.
const CHANNELS: [usize; 2] = [16, 32];
/// Of a frame: its patches are halved by each convolution.
pub const LEAST_SIDE: usize = (PATCH as usize) << CHANNELS.len();
const DRAWN: usize = 16;
/// Least standard deviation of z.
const LEAST_DEVIATION: f64 = 0.1;
/// Divergence that costs nothing, in each frame.
const FREE_NATS: f64 = 1.0;
/// Standard deviation of a reward.
const REWARD_DEVIATION: f64 = 0.1;

/// The model.
#[derive(Debug)]
pub struct Planet {
    variables: VarStore,
    side: i64,
    convolutions: Vec<Conv2d>,
    seen: Dense,
    input: Dense,
    memory: GruCell,
    prior: Mlp,
    posterior: Mlp,
    /// Of h and z: patches, and two convolutions on them.
    patches: Dense,
    drawing: [Conv2d; 2],
    reward: Mlp,
}

/// What is known of some worlds at a moment.
#[derive(Debug)]
pub struct Belief {
    /// h, `[batch, 100]`.
    memory: Tensor,
    /// z, `[batch, 10]`.
    state: Tensor,
}

impl Belief {
    /// The same for so many worlds; of one.
    pub fn repeated(&self, times: i64) -> Self {
        let [memory, state] = [&self.memory, &self.state].map(|part| part.expand([times, -1], false));
        Belief { memory, state }
    }

    /// `[batch, 110]`
    fn joined(&self) -> Tensor {
        Tensor::cat(&[&self.memory, &self.state], 1)
    }
}

/// Mean and deviation from a network's output.
fn gaussian(output: &Tensor) -> Gaussian {
    let parts = output.chunk(2, 1);
    Gaussian { mean: parts[0].shallow_clone(), log_variance: (parts[1].softplus() + LEAST_DEVIATION).log() * 2.0 }
}

impl Planet {
    /// A fresh model with initial values drawn from `seed`.
    pub fn new(system: &System, seed: u64, device: Device) -> Self {
        let variables = VarStore::new(device);
        let scope = |name: &str| Layers::new(variables.root() / name);
        let mlp = |name: &str, widths: &[usize]| Mlp::new(&mut scope(name), widths, Activation::Relu, Activation::None);
        let (patch, side) = (system.channels * (PATCH * PATCH) as usize, system.side / PATCH as usize);
        let mut encoder = scope("encoder");
        let mut inputs = patch;
        let convolutions = CHANNELS.map(|outputs| {
            let layer = encoder.conv2d(inputs, outputs, 3, Activation::Relu);
            inputs = outputs;
            layer
        });
        let left = CHANNELS.iter().fold(side, |side, _| side / 2);
        let mut dynamics = scope("dynamics");
        let mut decoder = scope("decoder");
        let model = Planet {
            convolutions: convolutions.into(),
            seen: encoder.dense(inputs * left * left, SEEN, Activation::Relu),
            input: dynamics.dense(STATE + 1, HIDDEN, Activation::Relu),
            memory: GruCell::new(&mut dynamics, HIDDEN, MEMORY),
            prior: mlp("prior", &[MEMORY, HIDDEN, 2 * STATE]),
            posterior: mlp("posterior", &[MEMORY + SEEN, HIDDEN, 2 * STATE]),
            patches: decoder.dense(MEMORY + STATE, DRAWN * side * side, Activation::Relu),
            drawing: [(DRAWN, Activation::Relu), (patch, Activation::None)]
                .map(|(outputs, activation)| decoder.conv2d(DRAWN, outputs, 3, activation)),
            reward: mlp("reward", &[MEMORY + STATE, HIDDEN, 1]),
            side: side as i64,
            variables,
        };
        glorot_uniform(&model.variables, seed);
        model
    }

    /// Before the first frame.
    pub fn start(&self, batch: i64) -> Belief {
        let [memory, state] =
            [MEMORY, STATE].map(|count| Tensor::zeros([batch, count as i64], (Kind::Float, self.variables.device())));
        Belief { memory, state }
    }

    /// h in the next frame, after what acted (`[batch, 1]`).
    fn carried(&self, belief: &Belief, action: &Tensor) -> Tensor {
        let input = self.input.forward(&Tensor::cat(&[&belief.state, action], 1));
        self.memory.step(&input, &belief.memory)
    }

    fn prior(&self, memory: &Tensor) -> Gaussian {
        gaussian(&self.prior.forward(memory))
    }

    fn posterior(&self, memory: &Tensor, seen: &Tensor) -> Gaussian {
        gaussian(&self.posterior.forward(&Tensor::cat(&[memory, seen], 1)))
    }

    /// What is seen of frames `[batch, channels, S, S]`, `[batch, 100]`.
    fn encoded(&self, frames: &Tensor) -> Tensor {
        let pooled = |x: Tensor, layer: &Conv2d| layer.forward(&x).max_pool2d(2, 2, 0, 1, false);
        let patches = (frames - 0.5).pixel_unshuffle(PATCH);
        self.seen.forward(&self.convolutions.iter().fold(patches, pooled).flatten(1, -1))
    }

    /// The frames of beliefs (joined), `[batch, channels, S, S]`.
    fn drawn(&self, joined: &Tensor) -> Tensor {
        let patches = self.patches.forward(joined).reshape([-1, DRAWN as i64, self.side, self.side]);
        let [first, second] = &self.drawing;
        second.forward(&first.forward(&patches)).pixel_shuffle(PATCH) + 0.5
    }

    /// The most likely belief in the next frame, which is not seen, after what acted (`[batch, 1]`).
    pub fn imagine(&self, belief: &Belief, action: &Tensor) -> Belief {
        let memory = self.carried(belief, action);
        Belief { state: self.prior(&memory).mean, memory }
    }

    /// The most likely belief in the next frame, `[batch, channels, S, S]`, after what acted (`[batch, 1]`; 0 before the
    /// first).
    pub fn see(&self, belief: &Belief, action: &Tensor, frame: &Tensor) -> Belief {
        let memory = self.carried(belief, action);
        Belief { state: self.posterior(&memory, &self.encoded(frame)).mean, memory }
    }

    /// The reward that a frame is worth, `[batch]`.
    pub fn reward(&self, belief: &Belief) -> Tensor {
        self.reward.forward(&belief.joined()).squeeze_dim(1)
    }

    /// Beliefs in the frames of clips (joined, `[batch, time, 110]`) and the divergence of what is seen from what was
    /// foretold, `[batch, time]`.
    fn inferred(&self, frames: &Tensor, actions: &Actions, noise: &mut StandardNormal<'_>) -> (Tensor, Tensor) {
        let (batch, time) = (frames.size()[0], frames.size()[1]);
        let seen = self.encoded(&frames.flatten(0, 1)).reshape([batch, time, -1]);
        let mut belief = self.start(batch);
        let (mut beliefs, mut divergences) = (Vec::new(), Vec::new());
        for frame in 0..time {
            let memory = self.carried(&belief, &self.acted(actions, frame, batch));
            let posterior = self.posterior(&memory, &seen.select(1, frame));
            divergences.push(posterior.divergence_from(&self.prior(&memory)));
            let state = posterior.sample(noise.like(&posterior.mean));
            belief = Belief { memory, state };
            beliefs.push(belief.joined());
        }
        (Tensor::stack(&beliefs, 1), Tensor::stack(&divergences, 1))
    }

    /// What acted from the frame before to this one, `[batch, 1]`; 0 before the first.
    fn acted(&self, actions: &Actions, frame: i64, batch: i64) -> Tensor {
        let before = (frame > 0).then(|| actions.at(frame as usize - 1)).flatten();
        before.unwrap_or_else(|| Tensor::zeros([batch, 1], (Kind::Float, self.variables.device())))
    }
}

impl FrameModel for Planet {
    fn variables(&self) -> &VarStore {
        &self.variables
    }

    fn draws(&self, clips: usize, time: usize) -> usize {
        clips * time * STATE
    }

    /// The negative evidence lower bound of whole clips, per frame, with the free nats. Without rewards none are learned.
    fn loss(&self, batch: &Batch) -> Tensor {
        let (clips, time) = (batch.frames.size()[0], batch.frames.size()[1]);
        let count = (clips * time) as f64;
        let (beliefs, divergence) =
            self.inferred(&batch.frames, &batch.actions, &mut StandardNormal::of(batch.noise.as_ref()));
        let joined = beliefs.flatten(0, 1);
        let frames = (self.drawn(&joined) - batch.frames.flatten(0, 1)).square().sum(Kind::Float) * (0.5 / count);
        let mut loss = frames + divergence.clamp_min(FREE_NATS).mean(Kind::Float);
        if let Some(rewards) = &batch.rewards {
            let missed = (self.reward.forward(&joined).reshape([clips, time]) - rewards).square().mean(Kind::Float);
            loss += missed * (0.5 / REWARD_DEVIATION.powi(2));
        }
        loss
    }

    fn predict(&self, input: &Tensor, actions: &Actions, frames: usize) -> Tensor {
        let (batch, seen) = (input.size()[0], input.size()[1]);
        let mut belief = self.start(batch);
        for frame in 0..seen {
            belief = self.see(&belief, &self.acted(actions, frame, batch), &input.select(1, frame));
        }
        let mut joined = Vec::with_capacity(frames);
        for frame in seen..seen + frames as i64 {
            belief = self.imagine(&belief, &self.acted(actions, frame, batch));
            joined.push(belief.joined());
        }
        let drawn = self.drawn(&Tensor::stack(&joined, 1).flatten(0, 1)).clamp(0.0, 1.0);
        let size = input.size();
        drawn.reshape([batch, -1, size[2], size[3], size[4]])
    }
}
