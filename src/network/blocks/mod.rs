//! Building blocks of the network: layers, the up-sampling, the two U-Nets, learned variables.
//!
//! Original: `nn/network/blocks.py`. Tensors are `[batch, channels, height, width]`, weights are in PyTorch's layouts
//! (`[out, in, kh, kw]` and `[out, in]`); names follow the original's scopes, with `weight` for its `kernel`.

mod unet;
mod variable_from_network;

use anyhow::Result;
use serde::{Deserialize, Serialize};
use tch::nn::Path;
use tch::{Device, Kind, Tensor};

use paig_kernels::{Convolution, Kernels, PreparedConvolution, linear, linear_twice};

pub use paig_kernels::resize_bilinear_x2;
pub use unet::{UNet, side_multiple, uses_deep_unet};
pub use variable_from_network::VariableFromNetwork;
pub(super) use variable_from_network::{CONSTANT_INPUTS, HIDDEN};

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

    /// The layer with its weights as they are now, to be applied many times.
    pub fn prepared(&self, convolution: &Convolution) -> PreparedConv2d {
        PreparedConv2d { convolution: convolution.prepared(&self.weight, &self.bias), activation: self.activation }
    }
}

/// A [`Conv2d`] with the weights of one moment.
#[derive(Debug)]
pub struct PreparedConv2d {
    convolution: PreparedConvolution,
    activation: Activation,
}

impl PreparedConv2d {
    /// As [`Conv2d::forward`], of square pictures.
    pub fn forward(&self, x: &Tensor) -> Tensor {
        self.activation.apply(self.convolution.forward(x))
    }
}

/// What the products of a dense layer are computed in, forward and backward: their factors are rounded to it, and what comes
/// out. The weights that are learned, and all else, stay in float32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    #[default]
    Float32,
    /// 16 bits, of which eight are significant; for processors that multiply such numbers several times as fast.
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
    pub(crate) fn forward_wide(&self, x: &Tensor, kernels: Kernels, precision: Precision) -> Tensor {
        let product = match precision {
            Precision::Bfloat16 => {
                let [x, weight] = [x, &self.weight].map(|factor| factor.to_kind(Kind::BFloat16));
                x.linear::<Tensor>(&weight, None).to_kind(self.bias.kind()) + &self.bias
            }
            Precision::Float32 => linear(kernels, x, &self.weight, &self.bias),
        };
        self.activation.apply(product)
    }

    /// The same twice: once differentiable by the input and the layer, once by the layer alone. The products are shared.
    pub(crate) fn forward_wide_twice(&self, x: &Tensor, kernels: Kernels, precision: Precision) -> [Tensor; 2] {
        match precision {
            Precision::Bfloat16 => [x.shallow_clone(), x.detach()].map(|x| self.forward_wide(&x, kernels, precision)),
            Precision::Float32 => linear_twice(kernels, x, &self.weight, &self.bias).map(|x| self.activation.apply(x)),
        }
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
        let normal = normal + identity * (ridge * design.size()[0] as f64);
        // A few hundred unknowns: on a GPU the library for one large system would take longer to load than this takes here.
        let [normal, towards] = [normal, design.transpose(0, 1).matmul(&missing)].map(|x| x.to_device(Device::Cpu));
        let change = Tensor::f_linalg_solve(&normal, &towards, true)?.to_device(present.device());
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
    pub(crate) fn detached(&self) -> Self {
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
    pub(crate) fn detached(&self) -> Self {
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
