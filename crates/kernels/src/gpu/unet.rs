//! The U-Net on a GPU, forward and backward: that of [`crate::UNetOperation`].
//!
//! Pictures are pooled, doubled and joined where a convolution reads them, so that each layer is one pass through the memory.

use tch::Tensor;

use super::convolution::{ConvolutionInput, convolve, double_backward, input_gradient, pool_backward, weight_gradient};
use super::logits;
use crate::autograd;
use crate::unet::Shape;

/// What a forward pass leaves for the gradient.
struct GpuUnetPass {
    shape: Shape,
    /// Weights and biases in the network's order.
    layers: Vec<[Tensor; 2]>,
    frames: Tensor,
    /// On the way down, of each level: the results of its two convolutions.
    firsts: Vec<Tensor>,
    seconds: Vec<Tensor>,
    /// On the way up, from the lowest level that takes something from below: what came up, and the results of the two
    /// convolutions after it.
    risen: Vec<Tensor>,
    up_firsts: Vec<Tensor>,
    outputs: Vec<Tensor>,
}

/// Frames `[frames, channels, S, S]` to logits `[frames, objects, S, S]`, differentiable by the weights. `layers` are weights and
/// biases in the network's order.
pub fn unet(shape: Shape, layers: &[(&Tensor, &Tensor)], frames: &Tensor) -> Tensor {
    let variables: Vec<&Tensor> = layers.iter().flat_map(|&(weight, bias)| [weight, bias]).collect();
    let values =
        layers.iter().map(|(weight, bias)| [weight, bias].map(|values| values.detach().contiguous())).collect();
    let pass = GpuUnetPass::forward(shape, values, frames.detach().contiguous());
    let logits = pass.logits();
    if !autograd::records(&variables) {
        return logits;
    }
    autograd::attach(logits, &variables, move |gradient| pass.backward(&gradient.contiguous()))
}

impl GpuUnetPass {
    fn forward(shape: Shape, layers: Vec<[Tensor; 2]>, frames: Tensor) -> Self {
        let layer = |number: usize| layers[number].each_ref();
        let (mut firsts, mut seconds): (Vec<Tensor>, Vec<Tensor>) = (Vec::new(), Vec::new());
        for level in shape.levels() {
            let seen = seconds.last().map_or_else(|| ConvolutionInput::pictures(&frames), ConvolutionInput::pooled);
            let first = convolve(&seen, layer(shape.down(level)), true);
            let second = convolve(&ConvolutionInput::pictures(&first), layer(shape.down(level) + 1), true);
            firsts.push(first);
            seconds.push(second);
        }
        let (mut risen, mut up_firsts, mut outputs): (Vec<Tensor>, Vec<Tensor>, Vec<Tensor>) = Default::default();
        for level in (0..shape.poolings).rev() {
            let below = outputs.last().unwrap_or(&seconds[shape.poolings]);
            let up = convolve(&ConvolutionInput::doubled(below), layer(shape.up(level)), false);
            let first = convolve(&ConvolutionInput::joined(&up, &seconds[level]), layer(shape.up(level) + 1), true);
            outputs.push(convolve(&ConvolutionInput::pictures(&first), layer(shape.up(level) + 2), true));
            risen.push(up);
            up_firsts.push(first);
        }
        GpuUnetPass { shape, layers, frames, firsts, seconds, risen, up_firsts, outputs }
    }

    /// What the last layer sees.
    fn output(&self) -> &Tensor {
        self.outputs.last().unwrap_or(&self.seconds[self.shape.poolings])
    }

    fn last(&self) -> [&Tensor; 2] {
        self.layers.last().expect("a network has layers").each_ref()
    }

    fn logits(&self) -> Tensor {
        logits::forward(self.output(), self.last())
    }

    /// From the gradient of the logits those of weights and biases in the network's order.
    fn backward(&self, gradient: &Tensor) -> Vec<Tensor> {
        let shape = self.shape;
        let mut found: Vec<[Tensor; 2]> = self.layers.iter().map(|_| [Tensor::new(), Tensor::new()]).collect();
        let weight = |number: usize| &self.layers[number][0];
        let [mut gradient, last_weight, last_bias] = logits::backward(gradient, self.output(), self.last()[0]);
        found[self.layers.len() - 1] = [last_weight, last_bias];
        // Of the second convolutions on the way down, by what was joined.
        let mut joined = Vec::new();
        for level in 0..shape.poolings {
            let (place, layer) = (shape.poolings - 1 - level, shape.up(level));
            let (up_first, up) = (&self.up_firsts[place], &self.risen[place]);
            found[layer + 2] = weight_gradient(&ConvolutionInput::pictures(up_first), &gradient);
            let [by_first, _] = input_gradient(&gradient, weight(layer + 2), shape.width(level) as i64, Some(up_first));
            found[layer + 1] = weight_gradient(&ConvolutionInput::joined(up, &self.seconds[level]), &by_first);
            let [by_up, by_second] = input_gradient(&by_first, weight(layer + 1), shape.raised() as i64, None);
            joined.push(by_second);
            let below = if place == 0 { &self.seconds[shape.poolings] } else { &self.outputs[place - 1] };
            found[layer] = weight_gradient(&ConvolutionInput::doubled(below), &by_up);
            let [by_doubled, _] = input_gradient(&by_up, weight(layer), shape.width(level + 1) as i64, None);
            gradient = double_backward(&by_doubled, below);
        }
        for level in shape.levels().rev() {
            let (layer, first) = (shape.down(level), &self.firsts[level]);
            found[layer + 1] = weight_gradient(&ConvolutionInput::pictures(first), &gradient);
            let [by_first, _] = input_gradient(&gradient, weight(layer + 1), shape.width(level) as i64, Some(first));
            let Some(above) = level.checked_sub(1) else {
                found[layer] = weight_gradient(&ConvolutionInput::pictures(&self.frames), &by_first);
                break;
            };
            found[layer] = weight_gradient(&ConvolutionInput::pooled(&self.seconds[above]), &by_first);
            let [by_pooled, _] = input_gradient(&by_first, weight(layer), shape.width(above) as i64, None);
            let by_second = joined.pop().expect("a gradient for each level above");
            gradient = pool_backward(&by_pooled, &self.seconds[above], by_second);
        }
        found.into_iter().flatten().collect()
    }
}
