//! Convolutions of pictures `[frames, channels, S, S]` with kernels of 3 x 3 (`convolution.cu`, `weight_gradient.cu`), and what
//! stands between them in the U-Net (`adjoint.cu`, `logits.cu`).

use std::ffi::{c_int, c_long, c_void};

use tch::Tensor;

use super::launch::{empty_beside, floats, floats_mut, index_of, on_stream};

/// How pictures are read (`PaigReading` in `convolution.h`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reading {
    AsTheyAre = 0,
    Pooled = 1,
    Doubled = 2,
}

/// What a convolution sees.
#[derive(Debug)]
pub struct ConvolutionInput<'a> {
    first: &'a Tensor,
    second: Option<&'a Tensor>,
    reading: Reading,
}

#[repr(C)]
#[derive(Clone, Copy)]
struct GpuConvolutionInput {
    first: *const f32,
    second: *const f32,
    first_channels: c_int,
    second_channels: c_int,
    reading: c_int,
}

unsafe extern "C" {
    fn paig_gpu_convolve(
        input: GpuConvolutionInput,
        weight: *const f32,
        bias: *const f32,
        relu: bool,
        result: *mut f32,
        outputs: c_int,
        frames: c_int,
        side: c_int,
        stream: *mut c_void,
    ) -> bool;
    fn paig_gpu_convolve_gradient(
        gradient: *const f32,
        outputs: c_int,
        weight: *const f32,
        first: *mut f32,
        first_channels: c_int,
        second: *mut f32,
        second_channels: c_int,
        passes: *const f32,
        frames: c_int,
        side: c_int,
        stream: *mut c_void,
    ) -> bool;
    fn paig_gpu_weight_gradient_fits(side: c_int, device: c_int) -> bool;
    fn paig_gpu_weight_gradient_shares(
        inputs: c_int,
        outputs: c_int,
        frames: c_int,
        side: c_int,
        device: c_int,
    ) -> c_int;
    fn paig_gpu_weight_gradient(
        input: GpuConvolutionInput,
        gradient: *const f32,
        result: *mut f32,
        workspace: *mut f32,
        outputs: c_int,
        frames: c_int,
        side: c_int,
        stream: *mut c_void,
    ) -> bool;
    fn paig_gpu_pool_backward(
        pooled: *const f32,
        seen: *const f32,
        gradient: *mut f32,
        pictures: c_long,
        side: c_int,
        stream: *mut c_void,
    ) -> bool;
    fn paig_gpu_double_backward(
        doubled: *const f32,
        seen: *const f32,
        gradient: *mut f32,
        pictures: c_long,
        side: c_int,
        stream: *mut c_void,
    ) -> bool;
}

impl<'a> ConvolutionInput<'a> {
    pub fn pictures(pictures: &'a Tensor) -> Self {
        ConvolutionInput { first: pictures, second: None, reading: Reading::AsTheyAre }
    }

    /// The largest of each four pixels.
    pub fn pooled(pictures: &'a Tensor) -> Self {
        ConvolutionInput { first: pictures, second: None, reading: Reading::Pooled }
    }

    /// Pictures of twice the side, as [`crate::resize_bilinear_x2`].
    pub fn doubled(pictures: &'a Tensor) -> Self {
        ConvolutionInput { first: pictures, second: None, reading: Reading::Doubled }
    }

    /// The channels of two one after the other.
    pub fn joined(first: &'a Tensor, second: &'a Tensor) -> Self {
        assert!(first.size()[2..] == second.size()[2..] && first.size()[0] == second.size()[0], "pictures of one size");
        ConvolutionInput { first, second: Some(second), reading: Reading::AsTheyAre }
    }

    fn frames(&self) -> i64 {
        self.first.size()[0]
    }

    /// Of the pictures as they are seen.
    fn side(&self) -> i64 {
        let size = self.first.size();
        assert_eq!(size[2], size[3], "square pictures");
        match self.reading {
            Reading::AsTheyAre => size[2],
            Reading::Pooled => size[2] / 2,
            Reading::Doubled => size[2] * 2,
        }
    }

    fn channels(&self) -> i64 {
        self.first.size()[1] + self.second.map_or(0, |second| second.size()[1])
    }

    fn input(&self) -> GpuConvolutionInput {
        GpuConvolutionInput {
            first: floats(self.first),
            second: self.second.map_or(std::ptr::null(), floats),
            first_channels: self.first.size()[1] as c_int,
            second_channels: self.second.map_or(0, |second| second.size()[1]) as c_int,
            reading: self.reading as c_int,
        }
    }
}

/// Whether the GPU of a tensor has shared memory enough for pictures of this side.
pub fn fits(side: usize, tensor: &Tensor) -> bool {
    // SAFETY: asks what a device is.
    unsafe { paig_gpu_weight_gradient_fits(side as c_int, index_of(tensor)) }
}

/// A convolution with zero padding of what is seen, by a weight `[outputs, inputs, 3, 3]` and a bias, and a ReLU if there is to be
/// one: `[frames, outputs, S, S]`.
pub fn convolve(seen: &ConvolutionInput, [weight, bias]: [&Tensor; 2], relu: bool) -> Tensor {
    let (frames, side, outputs) = (seen.frames(), seen.side(), bias.size()[0]);
    assert_eq!(weight.size(), [outputs, seen.channels(), 3, 3], "a weight for what is seen");
    let mut result = empty_beside(seen.first, &[frames, outputs, side, side]);
    let into = floats_mut(&mut result);
    let [outputs, frames, side] = [outputs, frames, side].map(|n| n as c_int);
    // SAFETY: tensors of the sizes that are said, which live on the stream as long as the launch needs them.
    on_stream(seen.first, |stream| unsafe {
        paig_gpu_convolve(seen.input(), floats(weight), floats(bias), relu, into, outputs, frames, side, stream)
    });
    result
}

/// From the gradient of a convolution's result that of the first `channels` channels that it saw, 0 where `passes` is not above 0,
/// and that of the others.
pub fn input_gradient(gradient: &Tensor, weight: &Tensor, channels: i64, passes: Option<&Tensor>) -> [Tensor; 2] {
    let (frames, outputs, side, _) = gradient.size4().expect("gradients of pictures");
    let rest = weight.size()[1] - channels;
    assert_eq!(weight.size(), [outputs, channels + rest, 3, 3], "a weight of the result");
    let [mut first, mut second] = [channels, rest].map(|n| empty_beside(gradient, &[frames, n, side, side]));
    assert!(passes.is_none_or(|passes| passes.size() == first.size()), "a condition for each number");
    let into = [&mut first, &mut second].map(floats_mut);
    let passes = passes.map_or(std::ptr::null(), floats);
    let [outputs, channels, rest, frames, side] = [outputs, channels, rest, frames, side].map(|n| n as c_int);
    // SAFETY: as above.
    on_stream(gradient, |stream| unsafe {
        let (from, weight) = (floats(gradient), floats(weight));
        paig_gpu_convolve_gradient(
            from, outputs, weight, into[0], channels, into[1], rest, passes, frames, side, stream,
        )
    });
    [first, second]
}

/// From what a convolution saw and the gradient of its result those of its weight and bias.
pub fn weight_gradient(seen: &ConvolutionInput, gradient: &Tensor) -> [Tensor; 2] {
    let (frames, outputs, side, _) = gradient.size4().expect("gradients of pictures");
    assert_eq!([frames, side], [seen.frames(), seen.side()], "a gradient of what was seen");
    let inputs = seen.channels();
    let (weights, numbers) = (outputs * inputs * 9, outputs * (inputs * 9 + 1));
    let mut result = empty_beside(gradient, &[numbers]);
    let [of_inputs, of_outputs, of_frames, of_side] = [inputs, outputs, frames, side].map(|n| n as c_int);
    let device = index_of(gradient);
    // SAFETY: asks what a device is.
    let shares = unsafe { paig_gpu_weight_gradient_shares(of_inputs, of_outputs, of_frames, of_side, device) };
    let mut workspace = empty_beside(gradient, &[i64::from(shares) * numbers]);
    let [to, room] = [&mut result, &mut workspace].map(floats_mut);
    // SAFETY: as above, and room for all shares.
    on_stream(gradient, |stream| unsafe {
        let from = floats(gradient);
        paig_gpu_weight_gradient(seen.input(), from, to, room, of_outputs, of_frames, of_side, stream)
    });
    [result.narrow(0, 0, weights).view([outputs, inputs, 3, 3]), result.narrow(0, weights, outputs)]
}

/// Adds to the gradient of pictures that of what [`ConvolutionInput::pooled`] makes of them; then 0 where they are not above 0.
pub fn pool_backward(pooled_gradient: &Tensor, pictures: &Tensor, mut gradient: Tensor) -> Tensor {
    let (frames, channels, side, _) = pooled_gradient.size4().expect("gradients of pictures");
    assert_eq!(pictures.size(), [frames, channels, 2 * side, 2 * side], "pictures of twice the side");
    assert_eq!(pictures.size(), gradient.size(), "a gradient of the pictures");
    let into = floats_mut(&mut gradient);
    // SAFETY: as above.
    on_stream(pictures, |stream| unsafe {
        let (from, seen) = (floats(pooled_gradient), floats(pictures));
        paig_gpu_pool_backward(from, seen, into, frames * channels, side as c_int, stream)
    });
    gradient
}

/// From the gradient of doubled pictures that of the pictures, 0 where they are not above 0.
pub fn double_backward(doubled_gradient: &Tensor, pictures: &Tensor) -> Tensor {
    let (frames, channels, side, _) = pictures.size4().expect("pictures");
    assert_eq!(doubled_gradient.size(), [frames, channels, 2 * side, 2 * side], "gradients of twice the side");
    let mut gradient = empty_beside(pictures, &pictures.size());
    let into = floats_mut(&mut gradient);
    // SAFETY: as above.
    on_stream(pictures, |stream| unsafe {
        let (from, seen) = (floats(doubled_gradient), floats(pictures));
        paig_gpu_double_backward(from, seen, into, frames * channels, side as c_int, stream)
    });
    gradient
}
