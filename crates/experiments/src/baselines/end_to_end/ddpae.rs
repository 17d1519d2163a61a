//! DDPAE, the decompositional disentangled predictive auto-encoder (Hsieh et al. 2018): the video is a sum of components, each
//! with a content that stays and a pose that moves, both latent and random.
//!
//! As published: image latent 256, content 128, pose 3 (scale, x, y), memories of 64, Adam at 1e-3; a component's pose
//! depends on those of the components before it; the pose changes by `beta_t ~ N(mu_t, sigma_t)`; loss = binary
//! cross-entropy of input and future frames + KL to the priors. Ours, where the paper leaves it open or colours need it:
//! three convolutions of 16, 32, 64 channels, contents in colour, the priors of the poses, and what stands still (the
//! median of the training frames) behind the components, which is black where the paper's own frames are.

use tch::nn::VarStore;
use tch::{Device, Kind, Tensor};

use super::frame_model::{Batch, FrameModel};
use super::gaussian::{Gaussian, StandardNormal};
use paig::datasets::iterators::Clips;
use paig::network::System;
use paig::network::blocks::{Activation, Conv2d, Dense, Layers, Mlp};
use paig::network::cells::Actions;
use paig::network::dynamics::LstmCell;
use paig::network::initial_values::glorot_uniform;

const IMAGE: usize = 256;
const CONTENT: usize = 128;
const POSE: usize = 3;
const HIDDEN: usize = 64;
/// Channels of the convolutions, each followed by a pooling.
const CHANNELS: [usize; 3] = [16, 32, 64];
/// Of a frame: a window has half of it, and each convolution halves that.
pub const LEAST_SIDE: usize = 2 << CHANNELS.len();
/// Pixels are predicted no nearer to black and white than this: the cross-entropy of a certain mistake is infinite.
const CERTAIN: f64 = 1e-3;
/// Logit at which contents begin: a sum that is clipped at white has no gradient.
const DIM: f64 = -2.0;
/// Side of a component's window in frames: the scales it may have.
const SCALES: [f64; 2] = [0.15, 0.35];
/// Prior deviation of a pose's change from frame to frame; that of the first pose is 1. With 1 for all, components leap
/// about at first and nothing is learned.
const CHANGE: f64 = 0.1;
/// libtorch's numbers for the interpolation between pixels, and for what lies beyond an image.
const BILINEAR: i64 = 0;
const ZEROS: i64 = 0;
/// Frames whose median is behind the components.
const MEDIAN_FRAMES: usize = 300;

/// The model.
#[derive(Debug)]
pub struct Ddpae {
    variables: VarStore,
    seed: u64,
    objects: usize,
    input_steps: i64,
    side: i64,
    channels: i64,
    image_encoder: PoolingEncoder,
    content_encoder: PoolingEncoder,
    /// Takes in image latents, and the memory of the component before.
    pose_memory: LstmCell,
    /// Goes on from it, and takes in its own poses.
    future_memory: LstmCell,
    content_memory: LstmCell,
    /// Mean and log-variance of the first pose, of a pose's change (in units of its prior's deviation), and of a content.
    first_pose: Dense,
    pose: Dense,
    future_pose: Dense,
    content: Dense,
    decoder: Mlp,
    /// `[1, C, S, S]`
    background: Tensor,
}

/// Convolutions with poolings, then one dense layer.
#[derive(Debug)]
struct PoolingEncoder {
    convolutions: Vec<Conv2d>,
    output: Dense,
}

impl PoolingEncoder {
    fn new(layers: &mut Layers, channels: usize, side: usize, outputs: usize) -> Self {
        let mut inputs = channels;
        let convolutions = CHANNELS.map(|outputs| {
            let layer = layers.conv2d(inputs, outputs, 3, Activation::Relu);
            inputs = outputs;
            layer
        });
        let left = CHANNELS.iter().fold(side, |side, _| side / 2);
        PoolingEncoder {
            convolutions: convolutions.into(),
            output: layers.dense(inputs * left * left, outputs, Activation::Relu),
        }
    }

    /// `[frames, channels, side, side]` to `[frames, outputs]`.
    fn forward(&self, frames: &Tensor) -> Tensor {
        let pooled = |x: Tensor, layer: &Conv2d| layer.forward(&x).max_pool2d(2, 2, 0, 1, false);
        self.output.forward(&self.convolutions.iter().fold(frames.shallow_clone(), pooled).flatten(1, -1))
    }
}

/// Mean and log-variance from a network's output.
fn gaussian(output: &Tensor) -> Gaussian {
    let parts = output.chunk(2, 1);
    Gaussian { mean: parts[0].shallow_clone(), log_variance: parts[1].clamp(-8.0, 4.0) }
}

/// What the model makes of the input.
struct Inferred {
    /// All frames, input and future, `[batch, frames, C, S, S]`.
    frames: Tensor,
    divergence: Tensor,
}

impl Ddpae {
    /// A fresh model with initial values drawn from `seed`.
    pub fn new(system: &System, seed: u64, device: Device) -> Self {
        let variables = VarStore::new(device);
        let scope = |name: &str| Layers::new(variables.root() / name);
        let (side, window) = (system.side, system.side / 2);
        let image_encoder = PoolingEncoder::new(&mut scope("image_encoder"), system.channels, side, IMAGE);
        let content_encoder = PoolingEncoder::new(&mut scope("content_encoder"), system.channels, window, IMAGE);
        let mut pose = scope("pose");
        let pose_memory = LstmCell::new(&mut pose, IMAGE + HIDDEN, HIDDEN);
        let future_memory = LstmCell::new(&mut pose, POSE + HIDDEN, HIDDEN);
        let [first_pose, pose, future_pose] = [(); 3].map(|()| pose.dense(HIDDEN, 2 * POSE, Activation::None));
        let mut content = scope("content");
        let content_memory = LstmCell::new(&mut content, IMAGE, HIDDEN);
        let content = content.dense(HIDDEN, 2 * CONTENT, Activation::None);
        let pixels = system.channels * window * window;
        let decoder = Mlp::new(&mut scope("decoder"), &[CONTENT, IMAGE, pixels], Activation::Relu, Activation::None);
        let frame = [1, system.channels as i64, side as i64, side as i64];
        let background = variables.root().zeros_no_train("background", &frame);
        glorot_uniform(&variables, seed);
        decoder.output().start_at(&Tensor::full([pixels as i64], DIM, (Kind::Float, device)), 1.0);
        Ddpae {
            variables,
            seed,
            objects: system.objects,
            input_steps: system.input_steps as i64,
            side: side as i64,
            channels: system.channels as i64,
            image_encoder,
            content_encoder,
            pose_memory,
            future_memory,
            content_memory,
            first_pose,
            pose,
            future_pose,
            content,
            decoder,
            background,
        }
    }

    /// Goes through the components one after the other.
    fn infer(&self, input: &Tensor, future: usize, noise: &mut StandardNormal<'_>) -> Inferred {
        let (batch, seen) = (input.size()[0], input.size()[1]);
        let images = self.image_encoder.forward(&input.flatten(0, 1)).reshape([batch, seen, -1]);
        let none = Tensor::zeros([batch, HIDDEN as i64], (Kind::Float, input.device()));
        let mut before: Vec<Tensor> = (0..seen as usize + future).map(|_| none.shallow_clone()).collect();
        let mut frames = Tensor::zeros([1], (Kind::Float, input.device()));
        let mut divergence = Tensor::zeros([1], (Kind::Float, input.device()));
        for _ in 0..self.objects {
            let (poses, memories, kl) = self.poses(&images, future, &before, noise);
            let (content, content_kl) = self.content(input, &poses[..seen as usize], noise);
            frames = &frames + self.drawn(&content, &Tensor::stack(&poses, 1));
            divergence += kl + content_kl;
            before = memories;
        }
        Inferred { frames: (frames + &self.background).clamp(0.0, 1.0), divergence }
    }

    /// The poses of one component in all frames (each `[batch, 3]`), its memories, and their divergence.
    fn poses(
        &self,
        images: &Tensor,
        future: usize,
        before: &[Tensor],
        noise: &mut StandardNormal<'_>,
    ) -> (Vec<Tensor>, Vec<Tensor>, Tensor) {
        let seen = images.size()[1] as usize;
        let [mut h, mut c] = self.pose_memory.start(&images.select(1, 0));
        let mut pose = Tensor::zeros([images.size()[0], POSE as i64], (Kind::Float, images.device()));
        let mut divergence = Tensor::zeros([1], (Kind::Float, images.device()));
        let (mut poses, mut memories) = (Vec::new(), Vec::new());
        for (frame, earlier) in before.iter().enumerate().take(seen + future) {
            let (cell, x) = if frame < seen {
                (&self.pose_memory, images.select(1, frame as i64))
            } else {
                (&self.future_memory, pose.shallow_clone())
            };
            let (head, deviation) = match frame {
                0 => (&self.first_pose, 1.0),
                _ if frame < seen => (&self.pose, CHANGE),
                _ => (&self.future_pose, CHANGE),
            };
            [h, c] = cell.step(&Tensor::cat(&[&x, earlier], 1), [&h, &c]);
            let change = gaussian(&head.forward(&h));
            divergence += change.divergence();
            pose = &pose + change.sample(noise.like(&change.mean)) * deviation;
            poses.push(pose.shallow_clone());
            memories.push(h.shallow_clone());
        }
        (poses, memories, divergence)
    }

    /// The content `[batch, 128]` of what lies in a component's windows.
    fn content(&self, input: &Tensor, poses: &[Tensor], noise: &mut StandardNormal<'_>) -> (Tensor, Tensor) {
        let mut memory: Option<[Tensor; 2]> = None;
        for (frame, pose) in poses.iter().enumerate() {
            let seen = moved(&input.select(1, frame as i64), &window(pose), self.side / 2);
            let x = self.content_encoder.forward(&seen);
            let [h, c] = memory.unwrap_or_else(|| self.content_memory.start(&x));
            memory = Some(self.content_memory.step(&x, [&h, &c]));
        }
        let [h, _] = memory.expect("there is at least one input frame");
        let content = gaussian(&self.content.forward(&h));
        (content.sample(noise.like(&content.mean)), content.divergence())
    }

    /// A component at its poses `[batch, frames, 3]`, before black: `[batch, frames, C, S, S]`.
    fn drawn(&self, content: &Tensor, poses: &Tensor) -> Tensor {
        let (batch, frames, half) = (poses.size()[0], poses.size()[1], self.side / 2);
        let sprite = self.decoder.forward(content).sigmoid().reshape([batch, 1, self.channels, half, half]);
        let sprites = sprite.expand([-1, frames, -1, -1, -1], false).reshape([-1, self.channels, half, half]);
        let drawn = moved(&sprites, &placed(&poses.flatten(0, 1)), self.side);
        drawn.reshape([batch, frames, self.channels, self.side, self.side])
    }
}

/// Images `[n, C, h, w]` under maps `[n, 6]` of a grid of `side` x `side`, as PyTorch's `grid_sample` has them: beyond its
/// edge an image fades to black within a pixel. The equation's models sample with edges that are sharp ([`paig::network::stn`]);
/// through those a window of one colour is not pulled anywhere, and contents turn dark before they have a shape.
fn moved(images: &Tensor, theta: &Tensor, side: i64) -> Tensor {
    let (count, channels) = (images.size()[0], images.size()[1]);
    let grid = Tensor::affine_grid_generator(&theta.reshape([count, 2, 3]), [count, channels, side, side], true);
    images.grid_sampler(&grid, BILINEAR, ZEROS, true)
}

/// Scale, x and y (each `[n]`, in half frames) of poses `[n, 3]`.
fn parts(pose: &Tensor) -> [Tensor; 3] {
    let scale = pose.select(1, 0).sigmoid() * (SCALES[1] - SCALES[0]) + SCALES[0];
    [scale, pose.select(1, 1).tanh(), pose.select(1, 2).tanh()]
}

/// The map from a window to the frame: theta `[n, 6]`.
fn window(pose: &Tensor) -> Tensor {
    let [scale, x, y] = parts(pose);
    let none = x.zeros_like();
    Tensor::stack(&[&scale, &none, &x, &none, &scale, &y], 1)
}

/// The map from the frame to the window.
fn placed(pose: &Tensor) -> Tensor {
    let [scale, x, y] = parts(pose);
    let (none, inverse) = (x.zeros_like(), scale.reciprocal());
    Tensor::stack(&[&inverse, &none, &(-x * &inverse), &none, &inverse, &(-y * &inverse)], 1)
}

impl FrameModel for Ddpae {
    fn variables(&self) -> &VarStore {
        &self.variables
    }

    fn begin(&self, train: &Clips) {
        let median = train.median_frame(MEDIAN_FRAMES, self.seed);
        tch::no_grad(|| self.background.shallow_clone().copy_(&median.unsqueeze(0)));
    }

    /// Of each component its poses and its content.
    fn draws(&self, clips: usize, time: usize) -> usize {
        self.objects * clips * (time * POSE + CONTENT)
    }

    /// The negative evidence lower bound of whole clips, per frame.
    fn loss(&self, batch: &Batch) -> Tensor {
        let clips = &batch.frames;
        let mut noise = StandardNormal::of(batch.noise.as_ref());
        let (batch, time) = (clips.size()[0], clips.size()[1]);
        let input = clips.narrow(1, 0, self.input_steps);
        let Inferred { frames, divergence } = self.infer(&input, (time - self.input_steps) as usize, &mut noise);
        let bright = frames * (1.0 - 2.0 * CERTAIN) + CERTAIN;
        // libtorch takes no picture that is not one of numbers: such a one shows in what is added, which is 0 otherwise.
        let wrong = (&bright * 0.0).sum(Kind::Float);
        let bright = bright.nan_to_num(0.5, 0.5, 0.5);
        let entropy = bright.binary_cross_entropy(clips, None::<&Tensor>, tch::Reduction::Sum) + wrong;
        (entropy / batch as f64 + divergence).sum(Kind::Float) / time as f64
    }

    fn predict(&self, input: &Tensor, _actions: &Actions, frames: usize) -> Tensor {
        let inferred = self.infer(input, frames, &mut StandardNormal::none());
        inferred.frames.narrow(1, input.size()[1], frames as i64)
    }
}

#[cfg(test)]
mod tests {
    use tch::{Device, Kind, Tensor};

    use super::{moved, placed, window};

    /// What lies in a component's window is drawn where it was.
    #[test]
    fn a_window_is_drawn_where_it_was_seen() {
        let axis = Tensor::arange(32, (Kind::Float, Device::Cpu)) - 13.5;
        let frame = (-(axis.square().unsqueeze(0) + axis.square().unsqueeze(1)) / 8.0).exp().reshape([1, 1, 32, 32]);
        let pose = Tensor::from_slice(&[3.0f32, -0.1, -0.1]).unsqueeze(0);
        let drawn = moved(&moved(&frame, &window(&pose), 16), &placed(&pose), 32);
        // What is lost is the tail of the blob beyond the window (0.04) and what two interpolations take from its peak; a
        // pixel to the side would be 0.3.
        assert!((drawn - frame).abs().max().double_value(&[]) < 0.1);
    }

    /// A component of one colour is pulled to what it should cover: by its edge, for inside of it nothing changes.
    #[test]
    fn a_window_of_one_colour_is_pulled() {
        let pose = Tensor::from_slice(&[-1.0f32, 0.0, 0.0]).unsqueeze(0).set_requires_grad(true);
        let drawn = moved(&Tensor::ones([1, 1, 16, 16], (Kind::Float, Device::Cpu)), &placed(&pose), 32);
        // What is to be covered lies to the right: columns 18 to 22; the window covers 12.3 to 18.7, and fades over 19.
        drawn.narrow(3, 18, 5).sum(Kind::Float).backward();
        let [x, y] = [1, 2].map(|part| pose.grad().double_value(&[0, part]));
        assert!(x > 10.0 && y.abs() < 1e-2, "{x} {y}");
    }
}
