//! Building blocks of the network: layers, the up-sampling, the two U-Nets, learned variables.
//!
//! Original: `nn/network/blocks.py`. Tensors are `[batch, channels, height, width]`, weights are in PyTorch's layouts
//! (`[out, in, kh, kw]` and `[out, in]`); names follow the original's scopes, with `weight` for its `kernel`.

use anyhow::Result;
use serde::{Deserialize, Serialize};
use tch::nn::Path;
use tch::{Kind, Tensor};

use crate::kernels::{self, ConvolutionKernel, Instructions, Kernels, PreparedConvolution, Shape, UNetKernel};
use crate::network::stn::hat_matrix;

/// What follows a layer's affine map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activation {
    None,
    Relu,
    Tanh,
}

impl Activation {
    /// In place: the backward pass of the affine map does not need its result.
    fn apply(self, mut x: Tensor) -> Tensor {
        match self {
            Activation::None => x,
            Activation::Relu => x.relu_(),
            Activation::Tanh => x.tanh_(),
        }
    }
}

/// A square convolution with stride 1 and zero padding that keeps the size (TensorFlow's `SAME`).
#[derive(Debug)]
pub struct Conv2d {
    weight: Tensor,
    bias: Tensor,
    padding: i64,
    activation: Activation,
}

impl Conv2d {
    /// `[batch, in, height, width]` to `[batch, out, height, width]`.
    pub fn forward(&self, x: &Tensor) -> Tensor {
        self.activation.apply(x.conv2d(&self.weight, Some(&self.bias), 1, self.padding, 1, 1))
    }

    /// The layer with its weights as they are now, to be applied many times: by `kernel` where that serves, else by libtorch.
    pub fn prepared(&self, kernel: &ConvolutionKernel) -> PreparedConv2d<'_> {
        let kernel = kernel.serves(&self.weight).then(|| kernel.prepared(&self.weight, &self.bias));
        PreparedConv2d { layer: self, kernel }
    }
}

/// A [`Conv2d`] with the weights of one moment.
#[derive(Debug)]
pub struct PreparedConv2d<'a> {
    layer: &'a Conv2d,
    kernel: Option<PreparedConvolution>,
}

impl PreparedConv2d<'_> {
    /// As [`Conv2d::forward`], of square pictures.
    pub fn forward(&self, x: &Tensor) -> Tensor {
        match &self.kernel {
            Some(kernel) => self.layer.activation.apply(kernel.forward(x)),
            None => self.layer.forward(x),
        }
    }
}

/// What the products of a dense layer are computed in, forward and backward: their factors are rounded to it, and what comes
/// out. The weights that are learned, and all else, stay in float32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    #[default]
    Float32,
    /// Of eight bits, for processors that multiply such numbers several times as fast.
    Bfloat16,
}

/// A fully connected layer on the last axis.
#[derive(Debug)]
pub struct Dense {
    weight: Tensor,
    bias: Tensor,
    activation: Activation,
}

impl Dense {
    /// `[.., in]` to `[.., out]`.
    pub fn forward(&self, x: &Tensor) -> Tensor {
        self.activation.apply(x.linear(&self.weight, Some(&self.bias)))
    }

    /// The same for many inputs, `[rows, in]`, in whichever way is the fastest for them.
    pub fn forward_wide(&self, x: &Tensor, kernels: Kernels, precision: Precision) -> Tensor {
        let product = match precision {
            Precision::Bfloat16 => {
                let [x, weight] = [x, &self.weight].map(|factor| factor.to_kind(Kind::BFloat16));
                x.linear::<Tensor>(&weight, None).to_kind(self.bias.kind()) + &self.bias
            }
            Precision::Float32 if kernels == Kernels::Own && kernels::serve(&[x, &self.weight]) => {
                kernels::linear(x, &self.weight, &self.bias)
            }
            Precision::Float32 => return self.forward(x),
        };
        self.activation.apply(product)
    }

    /// The same twice: once differentiable by the input and the layer, once by the layer alone. The products are shared.
    pub fn forward_wide_twice(&self, x: &Tensor, kernels: Kernels, precision: Precision) -> [Tensor; 2] {
        if precision == Precision::Float32 && kernels == Kernels::Own && kernels::serve(&[x, &self.weight]) {
            let by_layer = kernels::linear(&x.detach(), &self.weight, &self.bias);
            let by_both = kernels::taught_through(&by_layer, x, &self.weight);
            return [by_both, by_layer].map(|product| self.activation.apply(product));
        }
        [x.shallow_clone(), x.detach()].map(|x| self.forward_wide(&x, kernels, precision))
    }

    /// Replaces kernel and bias by the least-squares solution of `inputs -> outputs` (`[rows, in]` to `[rows, out]`, before
    /// the activation), with a ridge of weight `ridge` per row around the present values.
    ///
    /// # Errors
    /// A singular system.
    pub fn solve(&self, inputs: &Tensor, outputs: &Tensor, ridge: f64) -> Result<()> {
        let _guard = tch::no_grad_guard();
        let inputs = inputs.to_kind(Kind::Double);
        let design = Tensor::cat(&[&inputs, &inputs.narrow(1, 0, 1).ones_like()], 1);
        let present = Tensor::cat(&[self.weight.transpose(0, 1), self.bias.unsqueeze(0)], 0).to_kind(Kind::Double);
        let normal = design.transpose(0, 1).matmul(&design);
        let identity = Tensor::eye(normal.size()[0], (Kind::Double, normal.device()));
        let missing = outputs.to_kind(Kind::Double) - design.matmul(&present);
        let change = Tensor::f_linalg_solve(
            &(normal + identity * (ridge * design.size()[0] as f64)),
            &design.transpose(0, 1).matmul(&missing),
            true,
        )?;
        let solved = (present + change).to_kind(self.weight.kind());
        let inputs = solved.size()[0] - 1;
        self.weight.shallow_clone().copy_(&solved.narrow(0, 0, inputs).transpose(0, 1));
        self.bias.shallow_clone().copy_(&solved.select(0, inputs));
        Ok(())
    }

    /// Begins the layer at this bias, with its kernel multiplied by a factor.
    pub fn start_at(&self, bias: &Tensor, factor: f64) {
        let _guard = tch::no_grad_guard();
        self.scale(factor);
        self.bias.shallow_clone().copy_(&bias.reshape([-1]));
    }

    /// The same layer as a constant: gradients pass through it, not to it.
    pub fn detached(&self) -> Self {
        Dense { weight: self.weight.detach(), bias: self.bias.detach(), activation: self.activation }
    }

    /// Multiplies the kernel by a factor.
    pub fn scale(&self, factor: f64) {
        let _guard = tch::no_grad_guard();
        let _ = self.weight.shallow_clone().g_mul_scalar_(factor);
    }
}

/// Fully connected layers one after the other.
#[derive(Debug)]
pub struct Mlp(Vec<Dense>);

impl Mlp {
    /// Layers of these widths, the inputs' first; `hidden` follows all but the last, which `output` follows.
    pub fn new(layers: &mut Layers, widths: &[usize], hidden: Activation, output: Activation) -> Self {
        let last = widths.len() - 2;
        let dense = |(place, pair): (usize, &[usize])| {
            layers.dense(pair[0], pair[1], if place == last { output } else { hidden })
        };
        Mlp(widths.windows(2).enumerate().map(dense).collect())
    }

    /// `[.., in]` to `[.., out]`.
    pub fn forward(&self, x: &Tensor) -> Tensor {
        self.0.iter().fold(x.shallow_clone(), |x, layer| layer.forward(&x))
    }

    /// The layer that gives the output.
    pub fn output(&self) -> &Dense {
        self.0.last().expect("there is at least one layer")
    }

    /// The same layers as constants; see [`Dense::detached`].
    pub fn detached(&self) -> Self {
        Mlp(self.0.iter().map(Dense::detached).collect())
    }
}

/// Makes the layers of one scope and numbers them as TensorFlow does: `conv2d`, `conv2d_1`, .., `dense`, `dense_1`, ..
///
/// New weights are zero; [`crate::network::initial_values`] fills a finished model.
#[derive(Debug)]
pub struct Layers<'a> {
    scope: Path<'a>,
    convolutions: usize,
    denses: usize,
}

impl<'a> Layers<'a> {
    pub fn new(scope: Path<'a>) -> Self {
        Layers { scope, convolutions: 0, denses: 0 }
    }

    /// A convolution with a `size` x `size` kernel.
    pub fn conv2d(&mut self, inputs: usize, outputs: usize, size: usize, activation: Activation) -> Conv2d {
        let path = &self.scope / numbered("conv2d", &mut self.convolutions);
        Conv2d {
            weight: path.zeros("weight", &[outputs as i64, inputs as i64, size as i64, size as i64]),
            bias: path.zeros("bias", &[outputs as i64]),
            padding: size as i64 / 2,
            activation,
        }
    }

    pub fn dense(&mut self, inputs: usize, outputs: usize, activation: Activation) -> Dense {
        let path = &self.scope / numbered("dense", &mut self.denses);
        Dense {
            weight: path.zeros("weight", &[outputs as i64, inputs as i64]),
            bias: path.zeros("bias", &[outputs as i64]),
            activation,
        }
    }
}

fn numbered(kind: &str, count: &mut usize) -> String {
    let name = if *count == 0 { kind.to_string() } else { format!("{kind}_{count}") };
    *count += 1;
    name
}

/// Doubles height and width as TensorFlow 1's `resize_bilinear` does (`align_corners=False`, no half-pixel centres):
/// `out[2i] = in[i]`, `out[2i+1] = (in[i] + in[min(i+1, n-1)]) / 2` on each axis. No mode of PyTorch's `interpolate`
/// equals it.
pub fn resize_bilinear_x2(x: &Tensor) -> Tensor {
    let (batch, channels, height, width) = x.size4().expect("images [batch, channels, h, w]");
    // A matrix product for each axis, with the channels last: the layout in which the convolutions are fastest.
    let rows = doubling_matrix(height, x).matmul(&x.permute([0, 2, 3, 1]).reshape([batch, height, width * channels]));
    let both = doubling_matrix(width, x).matmul(&rows.reshape([batch * 2 * height, width, channels]));
    both.reshape([batch, 2 * height, 2 * width, channels]).permute([0, 3, 1, 2])
}

/// `[2n, n]`: row r holds the bilinear weights at r / 2, the last element repeated.
fn doubling_matrix(n: i64, like: &Tensor) -> Tensor {
    let halves = Tensor::arange(2 * n, (like.kind(), like.device())) * 0.5;
    hat_matrix(&halves.clamp_max((n - 1) as f64), n)
}

/// A U-Net: `levels` times two convolutions and a 2x2 max pooling with the width doubling, and the way back up with
/// skip connections. Gives one mask logit per object and pixel.
#[derive(Debug)]
pub struct UNet {
    /// Two convolutions for each level, the lowest (not pooled) last.
    down: Vec<[Conv2d; 2]>,
    /// From the lowest level up: the linear convolution after the up-sampling, and the two after the concatenation.
    up: Vec<(Conv2d, [Conv2d; 2])>,
    logits: Conv2d,
    /// Computes it where libtorch need not.
    kernel: Option<UNetKernel>,
}

/// Base width and poolings of the two networks (original: `shallow_unet`, `unet`).
const SHALLOW: (usize, usize) = (8, 2);
const DEEP: (usize, usize) = (16, 3);
/// Frames smaller than this go through the shallow network.
const DEEP_FROM_SIDE: usize = 40;

/// Whether frames of this side go through the deep U-Net (and its masked frames are halved before the dense layers).
pub fn uses_deep_unet(side: usize) -> bool {
    side >= DEEP_FROM_SIDE
}

/// What the side of a frame must be a multiple of, so that every pooling halves it: 4, or 8 in the deep U-Net.
pub fn side_multiple(side: usize) -> usize {
    let (_, poolings) = if uses_deep_unet(side) { DEEP } else { SHALLOW };
    1 << poolings
}

impl UNet {
    /// The shape of the U-Net the original uses for frames of this side.
    pub fn shape(side: usize, channels: usize, objects: usize) -> Shape {
        let (base, poolings) = if uses_deep_unet(side) { DEEP } else { SHALLOW };
        Shape { side, channels, objects, base, poolings }
    }

    /// The U-Net the original uses for frames of this side.
    pub fn for_side(layers: &mut Layers, side: usize, channels: usize, objects: usize, kernels: Kernels) -> Self {
        Self::of_shape(layers, Self::shape(side, channels, objects), kernels)
    }

    pub fn of_shape(layers: &mut Layers, shape: Shape, kernels: Kernels) -> Self {
        let Shape { channels, objects, base, poolings, .. } = shape;
        let mut down = Vec::new();
        let (mut inputs, mut width) = (channels, base);
        for _ in 0..=poolings {
            down.push([
                layers.conv2d(inputs, width, 3, Activation::Relu),
                layers.conv2d(width, width, 3, Activation::Relu),
            ]);
            inputs = width;
            width *= 2;
        }
        let mut up = Vec::new();
        for level in (0..poolings).rev() {
            let skip = base << level;
            let upsampled = layers.conv2d(inputs, 2 * base, 3, Activation::None);
            up.push((
                upsampled,
                [
                    layers.conv2d(2 * base + skip, skip, 3, Activation::Relu),
                    layers.conv2d(skip, skip, 3, Activation::Relu),
                ],
            ));
            inputs = skip;
        }
        let kernel = (kernels == Kernels::Own).then(|| UNetKernel::new(Instructions::best(), shape));
        UNet { down, up, logits: layers.conv2d(base, objects, 1, Activation::None), kernel }
    }

    /// Weights and biases of all layers, in their order.
    fn layers(&self) -> Vec<(&Tensor, &Tensor)> {
        let down = self.down.iter().flatten();
        let up = self.up.iter().flat_map(|(upsampled, after)| std::iter::once(upsampled).chain(after));
        down.chain(up).chain([&self.logits]).map(|layer| (&layer.weight, &layer.bias)).collect()
    }

    /// `[frames, channels, S, S]` in \[0, 1\] to logits `[frames, objects, S, S]`.
    pub fn forward(&self, frames: &Tensor) -> Tensor {
        match &self.kernel {
            Some(kernel) if kernel.serves(frames, &self.logits.weight) => kernel.forward(&self.layers(), frames),
            _ => self.forward_by_libtorch(frames),
        }
    }

    fn forward_by_libtorch(&self, frames: &Tensor) -> Tensor {
        let mut skips: Vec<Tensor> = Vec::new();
        let mut h = frames.shallow_clone();
        for [first, second] in &self.down {
            if !skips.is_empty() {
                h = h.max_pool2d(2, 2, 0, 1, false);
            }
            h = second.forward(&first.forward(&h));
            skips.push(h.shallow_clone());
        }
        skips.pop();
        for (upsampled, [first, second]) in &self.up {
            let skip = skips.pop().expect("one skip connection for each level");
            h = Tensor::cat(&[upsampled.forward(&resize_bilinear_x2(&h)), skip], 1);
            h = second.forward(&first.forward(&h));
        }
        self.logits.forward(&h)
    }

    /// Gives the logits another order: the one that was `order[i]` (`[objects]`) is i from now on.
    pub fn reorder_logits(&self, order: &Tensor) {
        let _guard = tch::no_grad_guard();
        let Conv2d { weight, bias, .. } = &self.logits;
        for values in [weight, bias] {
            values.shallow_clone().copy_(&values.index_select(0, order));
        }
    }

    /// Replaces each logit y by `scale (y - mean) + centre`; `mean` is `[objects]`.
    pub fn rescale_logits(&self, scale: &Tensor, mean: &Tensor, centre: f64) {
        let _guard = tch::no_grad_guard();
        let Conv2d { weight, bias, .. } = &self.logits;
        bias.shallow_clone().copy_(&((bias - mean) * scale + centre));
        let _ = weight.shallow_clone().g_mul_(scale);
    }
}

/// A learned array written as the output of a small network on a constant input, which conditions its training better
/// than a bare variable (original: `variable_from_network`).
#[derive(Debug)]
pub struct VariableFromNetwork {
    hidden: Dense,
    output: Dense,
    shape: Vec<i64>,
}

/// Of a learned array's network: its constant inputs and its hidden units.
pub(super) const CONSTANT_INPUTS: usize = 10;
pub(super) const HIDDEN: usize = 200;

impl VariableFromNetwork {
    pub fn new(layers: &mut Layers, shape: &[i64]) -> Self {
        let values: i64 = shape.iter().product();
        VariableFromNetwork {
            hidden: layers.dense(CONSTANT_INPUTS, HIDDEN, Activation::Tanh),
            output: layers.dense(HIDDEN, values as usize, Activation::None),
            shape: shape.to_vec(),
        }
    }

    /// The array, of the shape given at construction.
    pub fn value(&self) -> Tensor {
        let weight = &self.hidden.weight;
        let ones = Tensor::ones([1, CONSTANT_INPUTS as i64], (weight.kind(), weight.device()));
        self.output.forward(&self.hidden.forward(&ones)).reshape(&self.shape)
    }

    /// Begins the array at `values` (as many as it has, in its order), with the output kernel scaled by `kernel`.
    pub fn start_at(&self, values: &Tensor, kernel: f64) {
        self.output.start_at(values, kernel);
    }

    /// The same array as a constant; see [`Dense::detached`].
    pub fn detached(&self) -> Self {
        VariableFromNetwork {
            hidden: self.hidden.detached(),
            output: self.output.detached(),
            shape: self.shape.clone(),
        }
    }

    /// Begins the array as another one of the same hidden layer; `map`, a linear map, makes this array's shape of that
    /// one's; it takes and gives `[shape.., columns]`.
    pub fn begin_as(&self, other: &Self, map: impl Fn(&Tensor) -> Tensor) {
        let _guard = tch::no_grad_guard();
        for (mine, others) in [(&self.hidden.weight, &other.hidden.weight), (&self.hidden.bias, &other.hidden.bias)] {
            mine.shallow_clone().copy_(others);
        }
        self.set_columns(&map(&other.columns()));
    }

    /// Applies a linear map to the array by applying it to the output layer; `map` takes and gives
    /// `[shape.., columns]`.
    pub fn map(&self, map: impl Fn(&Tensor) -> Tensor) {
        let _guard = tch::no_grad_guard();
        self.set_columns(&map(&self.columns()));
    }

    /// The output layer's kernel and bias, `[shape.., columns]`.
    fn columns(&self) -> Tensor {
        let Dense { weight, bias, .. } = &self.output;
        let shape: Vec<i64> = self.shape.iter().copied().chain([-1]).collect();
        Tensor::cat(&[weight, &bias.unsqueeze(1)], 1).reshape(shape)
    }

    fn set_columns(&self, columns: &Tensor) {
        let Dense { weight, bias, .. } = &self.output;
        let (values, inputs) = weight.size2().expect("a kernel [values, inputs]");
        let flat = columns.reshape([values, inputs + 1]);
        weight.shallow_clone().copy_(&flat.narrow(1, 0, inputs));
        bias.shallow_clone().copy_(&flat.select(1, inputs));
    }
}
