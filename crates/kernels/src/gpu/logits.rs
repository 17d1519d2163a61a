//! The last layer of the U-Net: pictures `[frames, channels, S, S]` to logits `[frames, objects, S, S]` (`logits.cu`).

use std::ffi::{c_int, c_void};

use tch::Tensor;

use super::launch::{empty_beside, floats, floats_mut, on_stream};

unsafe extern "C" {
    fn paig_gpu_logits(
        seen: *const f32,
        weight: *const f32,
        bias: *const f32,
        logits: *mut f32,
        channels: c_int,
        objects: c_int,
        frames: c_int,
        pixels: c_int,
        stream: *mut c_void,
    ) -> bool;
    fn paig_gpu_logits_workspace(channels: c_int, objects: c_int) -> usize;
    fn paig_gpu_logits_backward(
        logits_gradient: *const f32,
        seen: *const f32,
        weight: *const f32,
        gradient: *mut f32,
        weight_gradient: *mut f32,
        bias_gradient: *mut f32,
        workspace: *mut f32,
        channels: c_int,
        objects: c_int,
        frames: c_int,
        pixels: c_int,
        stream: *mut c_void,
    ) -> bool;
}

/// By a weight `[objects, channels, 1, 1]` and a bias.
pub fn forward(pictures: &Tensor, [weight, bias]: [&Tensor; 2]) -> Tensor {
    let (frames, channels, side, _) = pictures.size4().expect("pictures");
    let objects = bias.size()[0];
    assert!(weight.size() == [objects, channels, 1, 1] && side % 2 == 0, "a weight for these pictures");
    let mut logits = empty_beside(pictures, &[frames, objects, side, side]);
    let into = floats_mut(&mut logits);
    let [channels, objects, frames, pixels] = [channels, objects, frames, side * side].map(|n| n as c_int);
    // SAFETY: tensors of the sizes that are said, which live on the stream as long as the launch needs them.
    on_stream(pictures, |stream| unsafe {
        let [seen, weight, bias] = [pictures, weight, bias].map(floats);
        paig_gpu_logits(seen, weight, bias, into, channels, objects, frames, pixels, stream)
    });
    logits
}

/// From the gradient of the logits that of the pictures, 0 where these are not above 0, and those of the weight and the bias.
pub fn backward(logits_gradient: &Tensor, pictures: &Tensor, weight: &Tensor) -> [Tensor; 3] {
    let (frames, channels, side, _) = pictures.size4().expect("pictures");
    let objects = weight.size()[0];
    assert_eq!(logits_gradient.size(), [frames, objects, side, side], "a gradient of the logits");
    // SAFETY: computes with numbers alone.
    let room = unsafe { paig_gpu_logits_workspace(channels as c_int, objects as c_int) };
    let sizes = [pictures.size(), weight.size(), vec![objects], vec![room as i64]];
    let mut results = sizes.map(|size| empty_beside(pictures, &size));
    let [gradient, weight_gradient, bias_gradient, workspace] = results.each_mut().map(floats_mut);
    let [channels, objects, frames, pixels] = [channels, objects, frames, side * side].map(|n| n as c_int);
    // SAFETY: as above.
    on_stream(pictures, |stream| unsafe {
        let [from, seen, weight] = [logits_gradient, pictures, weight].map(floats);
        let into = (gradient, weight_gradient, bias_gradient, workspace);
        paig_gpu_logits_backward(
            from, seen, weight, into.0, into.1, into.2, into.3, channels, objects, frames, pixels, stream,
        )
    });
    let [gradient, weight, bias, _] = results;
    [gradient, weight, bias]
}
