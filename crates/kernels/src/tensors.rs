//! The kernels on tensors, within libtorch's autograd. They keep the memory of what they were given until the gradient is asked
//! for: nothing may be written to it in between, and libtorch does not check that.

use std::sync::Arc;

use tch::{Device, Kind, Tensor};

use super::adam::{self, AdamStep, Slices};
use super::autograd;
use super::convolution;
use super::dense::{self, Factors};
use super::error::{self, Rows};
use super::gpu;
use super::lanes::Instructions;
use super::masks;
use super::memory;
use super::sprites::{self, Drawn, Scene};
use super::unet::{Kernel, Shape};
use super::vector_path::vector_path;

/// The U-Net's kernels go through as many frames as a vector has lanes at a time, also where there are fewer. Below this
/// number, libtorch is faster.
const FEWEST_FRAMES: i64 = 5;

/// The U-Net of one shape.
#[derive(Debug)]
pub struct UNetKernel(Kernel);

impl UNetKernel {
    pub fn new(instructions: Instructions, shape: Shape) -> Self {
        UNetKernel(Kernel::new(instructions, shape))
    }

    /// Whether these frames, and weights of this kind, can be computed with, and should be; the gradient by the frames is
    /// not computed.
    pub fn serves(&self, frames: &Tensor, weight: &Tensor) -> bool {
        let tensors = [frames, weight];
        let count = frames.size()[0];
        let by_processor = serve(&tensors) && count >= FEWEST_FRAMES;
        let by_gpu = || gpu::serve(&tensors) && count > 0 && gpu::fits(self.0.shape().side, frames);
        (by_processor || by_gpu()) && !autograd::records(&[frames])
    }

    /// Frames `[frames, channels, S, S]` to logits `[frames, objects, S, S]`, differentiable by the weights. `layers` are
    /// weights and biases in the network's order.
    pub fn forward(&self, layers: &[(&Tensor, &Tensor)], frames: &Tensor) -> Tensor {
        if gpu::serve(&[frames]) {
            return gpu::unet(self.0.shape(), layers, frames);
        }
        let variables: Vec<&Tensor> = layers.iter().flat_map(|&(weight, bias)| [weight, bias]).collect();
        let values: Vec<_> = layers.iter().map(|(weight, bias)| (numbers(weight), numbers(bias))).collect();
        let Shape { side, channels, objects, .. } = self.0.shape();
        let frames = frames.detach().contiguous();
        assert_eq!(frames.size()[1..], [channels, side, side].map(|n| n as i64), "frames of the network's shape");
        let mut logits =
            Tensor::empty([frames.size()[0], objects as i64, side as i64, side as i64], (Kind::Float, Device::Cpu));
        let pass = self.0.forward(&values, floats(&frames), floats_mut(&mut logits), autograd::records(&variables));
        let Some(pass) = pass else { return logits };
        let sizes: Vec<_> = variables.iter().map(|variable| variable.size()).collect();
        autograd::attach(logits, &variables, move |gradient| {
            let gradients = pass.backward(floats(&gradient.contiguous()));
            let gradients = gradients.into_iter().flat_map(|(weight, bias)| [weight, bias]);
            gradients.zip(&sizes).map(|(values, size)| Tensor::from_slice(&values).reshape(size)).collect()
        })
    }
}

/// A convolution 3x3 with zero padding that is applied many times between two changes of its weights.
#[derive(Debug)]
pub struct ConvolutionKernel {
    instructions: Instructions,
    memory: Arc<convolution::Memory>,
}

impl ConvolutionKernel {
    pub fn new(instructions: Instructions) -> Self {
        ConvolutionKernel { instructions, memory: Arc::new(convolution::Memory::new()) }
    }

    /// Whether a layer with this weight `[outputs, inputs, height, width]` can be computed.
    pub fn serves(&self, weight: &Tensor) -> bool {
        let size = weight.size();
        let fits = |channels: i64| convolution::Kernel::fits(self.instructions, channels as usize);
        serve(&[weight]) && size[2..] == [3, 3] && size[..2].iter().all(|channels| fits(*channels))
    }

    /// The layer with its weights as they are now.
    pub fn prepared(&self, weight: &Tensor, bias: &Tensor) -> PreparedConvolution {
        let values = [weight, bias].map(|tensor| tensor.detach().contiguous());
        let [weights, biases] = values.each_ref().map(floats);
        let kernel = convolution::Kernel::new(self.instructions, weights, biases, Arc::clone(&self.memory));
        PreparedConvolution { kernel: Arc::new(kernel), variables: [weight, bias].map(Tensor::shallow_clone) }
    }
}

/// A convolution with the weights of one moment, differentiable by what it sees and by them.
#[derive(Debug)]
pub struct PreparedConvolution {
    kernel: Arc<convolution::Kernel>,
    variables: [Tensor; 2],
}

impl PreparedConvolution {
    /// `[pictures, inputs, S, S]` to `[pictures, outputs, S, S]`.
    pub fn forward(&self, pictures: &Tensor) -> Tensor {
        let [weight, bias] = &self.variables;
        let inputs = [pictures, weight, bias];
        let sizes = inputs.map(|input| input.size());
        let (count, channels, side, width) = pictures.size4().expect("pictures [pictures, channels, S, S]");
        assert!(side == width && channels == sizes[1][1], "square pictures of the layer's channels");
        let mut results = Tensor::empty([count, self.kernel.outputs() as i64, side, side], (Kind::Float, Device::Cpu));
        let seen = pictures.detach().contiguous();
        let pass = self.kernel.forward(side as usize, floats(&seen), floats_mut(&mut results));
        if !autograd::records(&inputs) {
            return results;
        }
        autograd::attach(results, &inputs, move |gradient| {
            let mut by_pictures = Tensor::empty(&sizes[0], (Kind::Float, Device::Cpu));
            let (weight, bias) = pass.backward(floats(&gradient.contiguous()), floats_mut(&mut by_pictures));
            vec![by_pictures, Tensor::from_slice(&weight).reshape(&sizes[1]), Tensor::from_slice(&bias)]
        })
    }
}

/// Whether the kernels can compute with these tensors: float32 in the main memory, in a process where libtorch does not
/// replace the kernels ([`vector_path`]).
pub fn serve(tensors: &[&Tensor]) -> bool {
    *vector_path() != Ok(None)
        && tensors.iter().all(|tensor| tensor.kind() == Kind::Float && tensor.device() == Device::Cpu)
}

/// Sprites moved and composed over a background: what [`Scene`] says, of sprites `[objects, layers, height, width]` (logits of
/// the mask, then colours), a background `[channels, side, side]`, and where each row and column of the frames `[objects, frames,
/// side]` is taken from; frames `[frames, channels, side, side]`, differentiable by all of them.
pub fn draw(scene: Scene, sprites: &Tensor, background: &Tensor, rows: &Tensor, columns: &Tensor) -> Tensor {
    let inputs = [sprites, background, rows, columns];
    let values = inputs.map(|input| input.detach().contiguous());
    let [channels, side] = [scene.channels, scene.side].map(|n| n as i64);
    let mut frames = Tensor::empty([rows.size()[1], channels, side, side], (Kind::Float, Device::Cpu));
    sprites::draw(Instructions::best(), &scene, &drawn(&values), floats_mut(&mut frames));
    if !autograd::records(&inputs) {
        return frames;
    }
    let sizes = inputs.map(|input| input.size());
    autograd::attach(frames, &inputs, move |gradient| {
        let gradient = gradient.contiguous();
        let gradients = sprites::draw_backward(Instructions::best(), &scene, &drawn(&values), floats(&gradient));
        let gradients = [gradients.sprites, gradients.background, gradients.rows, gradients.columns];
        gradients.iter().zip(&sizes).map(|(values, size)| Tensor::from_slice(values).reshape(size)).collect()
    })
}

fn drawn(values: &[Tensor; 4]) -> Drawn<'_> {
    let [sprites, background, rows, columns] = values.each_ref().map(floats);
    Drawn { sprites, background, rows, columns }
}

/// The first `objects` of masks `[frames, masks, S, S]` times frames `[frames, channels, S, S]`, differentiable by the
/// masks: `[objects, frames, channels, S, S]`, with the channels innermost in memory.
pub fn masked(objects: i64, masks: &Tensor, frames: &Tensor) -> Tensor {
    let (count, channels, side, _) = frames.size4().expect("frames [frames, channels, S, S]");
    let sizes = masks::Sizes {
        frames: count as usize,
        objects: objects as usize,
        masks: masks.size()[1] as usize,
        channels: channels as usize,
        pixels: (side * side) as usize,
    };
    let frames = frames.detach().contiguous();
    let mut product = Tensor::empty([objects, count, side, side, channels], (Kind::Float, Device::Cpu));
    masks::apply(sizes, floats(&masks.detach().contiguous()), floats(&frames), floats_mut(&mut product));
    if autograd::records(&[masks]) {
        let size = masks.size();
        product = autograd::attach(product, &[masks], move |gradient| {
            let gradient = masks::apply_backward(sizes, floats(&gradient.contiguous()), floats(&frames));
            vec![Tensor::from_slice(&gradient).reshape(&size)]
        });
    }
    product.permute([0, 1, 4, 2, 3])
}

/// `x weight^T + bias`, differentiable by all three: `[rows, inputs]`, `[outputs, inputs]` and `[outputs]` to
/// `[rows, outputs]`.
///
/// # Panics
/// Tensors that do not fit, or that the kernels do not [`serve`]; so does each function here.
pub fn linear(x: &Tensor, weight: &Tensor, bias: &Tensor) -> Tensor {
    let (inputs, teaches_x) = ([x, weight, bias], x.requires_grad());
    let values = [x, weight].map(|tensor| tensor.detach().contiguous());
    let (rows, terms) = values[0].size2().expect("rows of inputs");
    let mut result = Tensor::empty([rows, bias.size()[0]], (Kind::Float, Device::Cpu));
    let [x, weight] = values.each_ref().map(floats);
    dense::by_rows(Instructions::best(), terms as usize, x, weight, floats_mut(&mut result));
    let result = result.g_add_(&bias.detach());
    if !autograd::records(&inputs) {
        return result;
    }
    autograd::attach(result, &inputs, move |gradient| {
        let gradient = gradient.contiguous();
        let [x, weight] = values.each_ref();
        let by_x = if teaches_x { combined(factors(&gradient), weight) } else { Tensor::new() };
        let by_weight = combined(factors(&gradient).transposed(), x);
        vec![by_x, by_weight, gradient.sum_dim_intlist([0i64].as_slice(), false, None)]
    })
}

/// A copy of `linear` (`[rows, outputs]`) that is differentiable also by `x` (`[rows, inputs]`), as if it were `x weight^T`:
/// where a linear map of a constant `x` was computed, and a part of what follows is to teach `x`, too.
pub fn taught_through(linear: &Tensor, x: &Tensor, weight: &Tensor) -> Tensor {
    let copy = linear.detach().copy();
    let inputs = [linear, x];
    if !autograd::records(&inputs) {
        return copy;
    }
    let weight = weight.detach().contiguous();
    autograd::attach(copy, &inputs, move |gradient| {
        let gradient = gradient.contiguous();
        let by_x = combined(factors(&gradient), &weight);
        vec![gradient, by_x]
    })
}

/// A tensor `[rows, terms]`, contiguous in memory.
fn factors(tensor: &Tensor) -> Factors<'_> {
    Factors::new(floats(tensor), tensor.size()[1] as usize)
}

/// The product with a matrix `[terms, columns]`, contiguous in memory.
fn combined(factors: Factors, matrix: &Tensor) -> Tensor {
    let mut product = Tensor::empty([factors.rows() as i64, matrix.size()[1]], (Kind::Float, Device::Cpu));
    dense::combined(Instructions::best(), factors, floats(matrix), floats_mut(&mut product));
    product
}

/// `sum (a - b)^2`, a scalar, differentiable by `a`. Both `[batch, time, ..]`, the frames side by side in memory or not.
pub fn squared_error(a: &Tensor, b: &Tensor) -> Tensor {
    assert_eq!(a.size(), b.size());
    let values = [a, b].map(|tensor| framewise(&tensor.detach()));
    let [first, second] = values.each_ref().map(rows);
    let sum = Tensor::from(error::squared_error(Instructions::best(), &first, &second) as f32);
    if !autograd::records(&[a]) {
        return sum;
    }
    let size = a.size();
    autograd::attach(sum, &[a], move |gradient| {
        let [first, second] = values.each_ref().map(rows);
        let mut difference = Tensor::empty(&size, (Kind::Float, Device::Cpu));
        let factor = 2.0 * gradient.double_value(&[]) as f32;
        error::difference(&first, &second, factor, floats_mut(&mut difference));
        vec![difference]
    })
}

/// `[h', c']` of a long short-term memory, each `[batch, ..]`, from the gates i, f, g, o `[batch, 4 units, ..]` before their
/// activations and from c; `forget_bias` is added to f. Differentiable by both.
pub fn memory_step(gates: &Tensor, c: &Tensor, forget_bias: f32) -> [Tensor; 2] {
    let inputs = [gates, c];
    let sizes = inputs.map(|input| input.size());
    let [seen, before] = inputs.map(|input| input.detach().contiguous());
    let units = before.numel() / sizes[1][0] as usize;
    let both: Vec<i64> = [2].iter().chain(&sizes[1]).copied().collect();
    let mut after = Tensor::empty(&both, (Kind::Float, Device::Cpu));
    let [h, c] = halves_mut(&mut after);
    let pass = memory::forward(Instructions::best(), units, floats(&seen), floats(&before), forget_bias, [h, c]);
    if autograd::records(&inputs) {
        after = autograd::attach(after, &inputs, move |gradient| {
            let mut by = sizes.each_ref().map(|size| Tensor::empty(size, (Kind::Float, Device::Cpu)));
            let gradient = gradient.contiguous();
            let pull = floats(&gradient).split_at(before.numel());
            let [by_gates, by_before] = by.each_mut().map(floats_mut);
            pass.backward(Instructions::best(), units, floats(&before), pull.into(), [by_gates, by_before]);
            by.into()
        });
    }
    after.unbind(0).try_into().expect("h and c")
}

fn halves_mut(tensor: &mut Tensor) -> [&mut [f32]; 2] {
    let half = tensor.numel() / 2;
    floats_mut(tensor).split_at_mut(half).into()
}

/// A step of Adam: changes a variable and its means of gradients and of their squares by the gradient. All of one shape, and
/// contiguous in memory.
///
/// # Panics
/// Two of them in the same memory.
pub fn adam(step: AdamStep, gradient: &Tensor, [variable, mean, square]: [&mut Tensor; 3]) {
    let place = |tensor: &Tensor| (tensor.data_ptr() as usize, size_of::<f32>() * tensor.numel());
    let mut places = [place(gradient), place(variable), place(mean), place(square)];
    places.sort_unstable();
    let apart = places.windows(2).all(|pair| pair[0].0 + pair[0].1 <= pair[1].0);
    assert!(apart || gradient.numel() == 0, "each has memory of its own");
    let slices = Slices {
        variable: floats_mut(variable),
        gradient: floats(gradient),
        mean: floats_mut(mean),
        square: floats_mut(square),
    };
    adam::step(Instructions::best(), step, slices);
}

/// The tensor itself where what follows the first two axes stands side by side in memory, else a copy.
fn framewise(tensor: &Tensor) -> Tensor {
    let side_by_side = tensor.numel() == 0 || tensor.select(0, 0).select(0, 0).is_contiguous();
    if side_by_side { tensor.shallow_clone() } else { tensor.contiguous() }
}

/// The frames of a tensor `[batch, time, ..]` whose frames stand side by side.
fn rows(tensor: &Tensor) -> Rows<'_> {
    let (size, stride) = (tensor.size(), tensor.stride());
    let width = size[2..].iter().product::<i64>() as usize;
    assert!(tensor.kind() == Kind::Float && tensor.device() == Device::Cpu);
    if tensor.numel() == 0 {
        return Rows { data: &[], starts: Vec::new(), width };
    }
    let starts = (0..size[0]).flat_map(|clip| (0..size[1]).map(move |time| (clip, time)));
    let starts: Vec<_> = starts.map(|(clip, time)| (clip * stride[0] + time * stride[1]) as usize).collect();
    let floats = starts.iter().max().map_or(0, |last| last + width);
    // SAFETY: the memory from the first element of the first frame to the last one of the last.
    let data = unsafe { std::slice::from_raw_parts(tensor.data_ptr().cast(), floats) };
    Rows { data, starts, width }
}

fn numbers(tensor: &Tensor) -> Vec<f32> {
    floats(&tensor.detach().contiguous()).to_vec()
}

/// The memory of a tensor.
fn floats(tensor: &Tensor) -> &[f32] {
    check(tensor);
    match tensor.numel() {
        // It has no address.
        0 => &[],
        // SAFETY: as many floats as the tensor has, side by side, which live as long as it does.
        count => unsafe { std::slice::from_raw_parts(tensor.data_ptr().cast(), count) },
    }
}

/// The memory of a tensor, which no other slice may be of meanwhile: it was made just now, or is compared with the others.
fn floats_mut(tensor: &mut Tensor) -> &mut [f32] {
    check(tensor);
    match tensor.numel() {
        0 => &mut [],
        // SAFETY: as above; the tensor is borrowed alone, and its memory is in no other slice.
        count => unsafe { std::slice::from_raw_parts_mut(tensor.data_ptr().cast(), count) },
    }
}

/// # Panics
/// A tensor whose memory is not a list of floats.
fn check(tensor: &Tensor) {
    assert!(tensor.kind() == Kind::Float && tensor.device() == Device::Cpu && tensor.is_contiguous());
}
