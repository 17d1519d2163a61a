//! Masks and the frames seen through them (`masks.cu`), within libtorch's autograd.

use std::ffi::{c_int, c_void};

use tch::Tensor;

use super::launch::{empty_beside, floats, floats_mut, on_stream};
use crate::autograd;

/// `PaigParted` in `masks.cu`.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct GpuMaskSizes {
    frames: c_int,
    objects: c_int,
    channels: c_int,
    pixels: c_int,
}

unsafe extern "C" {
    fn paig_gpu_part(
        sizes: GpuMaskSizes,
        background: f32,
        logits: *const f32,
        frames: *const f32,
        masks: *mut f32,
        masked: *mut f32,
        stream: *mut c_void,
    ) -> bool;
    fn paig_gpu_part_backward(
        sizes: GpuMaskSizes,
        masks: *const f32,
        gradient: *const f32,
        by_logits: *mut f32,
        stream: *mut c_void,
    ) -> bool;
    fn paig_gpu_masked_backward(
        sizes: GpuMaskSizes,
        frames: *const f32,
        gradient: *const f32,
        by_masks: *mut f32,
        stream: *mut c_void,
    ) -> bool;
}

/// Whether the kernels can compute with frames of so many channels.
pub fn can_part(frames: &Tensor) -> bool {
    matches!(frames.size()[1], 1 | 3)
}

/// From logits `[frames, objects, S, S]` and the background's constant one, masks `[frames, objects + 1, S, S]`; and
/// frames `[frames, channels, S, S]` times each but the last, `[objects, frames, channels, S, S]` with the channels
/// innermost in memory. Both are differentiable by the logits.
///
/// # Panics
/// Tensors that do not fit together, and frames of neither 1 nor 3 channels.
pub fn parted(background_logit: f64, logits: &Tensor, frames: &Tensor) -> [Tensor; 2] {
    let (count, objects, side, _) = logits.size4().expect("logits [frames, objects, S, S]");
    let channels = frames.size()[1];
    assert!(can_part(frames), "frames of 1 or 3 channels");
    assert_eq!(logits.size()[2..], [side, side], "square masks");
    assert_eq!(frames.size(), [count, channels, side, side], "frames of these masks");
    assert!(logits.device() == frames.device(), "all on one device");
    let [of_frames, of_objects, of_channels, pixels] =
        [count, objects, channels, side * side].map(|size| size as c_int);
    let sizes = GpuMaskSizes { frames: of_frames, objects: of_objects, channels: of_channels, pixels };
    let [seen, frames] = [logits, frames].map(|tensor| tensor.detach().contiguous());
    let mut masks = empty_beside(logits, &[count, objects + 1, side, side]);
    let mut masked = empty_beside(logits, &[objects, count, side, side, channels]);
    let [to_masks, to_masked] = [&mut masks, &mut masked].map(floats_mut);
    // SAFETY: tensors of the sizes that are said, which live on the stream as long as the launch needs them.
    on_stream(logits, |stream| unsafe {
        let background = background_logit as f32;
        paig_gpu_part(sizes, background, floats(&seen), floats(&frames), to_masks, to_masked, stream)
    });
    if autograd::records(&[logits]) {
        masks = with_softmax_gradient(sizes, masks, logits);
        masked = with_product_gradient(sizes, masked, &masks, frames);
    }
    [masks, masked.permute([0, 1, 4, 2, 3])]
}

fn with_softmax_gradient(sizes: GpuMaskSizes, masks: Tensor, logits: &Tensor) -> Tensor {
    // The same memory without a history, which would hold itself.
    let (values, shape) = (masks.detach(), logits.size());
    autograd::attach(masks, &[logits], move |gradient| {
        let gradient = gradient.contiguous();
        let mut by_logits = empty_beside(&gradient, &shape);
        let to = floats_mut(&mut by_logits);
        // SAFETY: as in `parted`.
        on_stream(&gradient, |stream| unsafe {
            paig_gpu_part_backward(sizes, floats(&values), floats(&gradient), to, stream)
        });
        vec![by_logits]
    })
}

fn with_product_gradient(sizes: GpuMaskSizes, masked: Tensor, masks: &Tensor, frames: Tensor) -> Tensor {
    let shape = masks.size();
    autograd::attach(masked, &[masks], move |gradient| {
        let gradient = gradient.contiguous();
        let mut by_masks = empty_beside(&gradient, &shape);
        let to = floats_mut(&mut by_masks);
        // SAFETY: as in `parted`.
        on_stream(&gradient, |stream| unsafe {
            paig_gpu_masked_backward(sizes, floats(&frames), floats(&gradient), to, stream)
        });
        vec![by_masks]
    })
}

#[cfg(test)]
mod tests {
    use tch::{Kind, Tensor};

    use super::super::testing::{assert_close, test_device};
    use super::parted;
    use crate::backend::Kernels;
    use crate::operations::masked_frames;

    #[test]
    fn masks_are_those_of_libtorch_and_so_are_their_gradients() {
        let Some(device) = test_device() else { return };
        tch::manual_seed(6);
        for (count, objects, channels, side) in [(5, 3, 3, 32), (1, 2, 1, 36), (3, 1, 3, 15), (2, 9, 1, 7)] {
            let logits = Tensor::randn([count, objects, side, side], (Kind::Float, device)) * 3.0;
            let logits = logits.set_requires_grad(true);
            let frames = Tensor::rand([count, channels, side, side], (Kind::Float, device));
            let [own, other] = [parted(1.0, &logits, &frames), masked_frames(Kernels::Libtorch, 1.0, &logits, &frames)];
            let weights = other.each_ref().map(Tensor::randn_like);
            for (own, other) in own.iter().zip(&other) {
                assert_close(own, other);
            }
            let gradients = [own, other].map(|[masks, masked]| {
                let sums = [masks * &weights[0], masked * &weights[1]].map(|terms| terms.sum(Kind::Float));
                Tensor::run_backward(&[&sums[0] + &sums[1]], &[&logits], false, false)
            });
            assert_close(&gradients[0][0], &gradients[1][0]);
        }
    }

    #[test]
    fn a_logit_that_is_no_number_shows_in_its_pixel() {
        let Some(device) = test_device() else { return };
        let logits = Tensor::zeros([1, 2, 4, 4], (Kind::Float, device));
        let _ = logits.narrow(1, 0, 1).narrow(2, 0, 1).narrow(3, 0, 1).fill_(f64::NAN);
        let [masks, masked] = parted(1.0, &logits, &Tensor::ones([1, 3, 4, 4], (Kind::Float, device)));
        let not_numbers = |tensor: &Tensor| tensor.isnan().sum(Kind::Int64).int64_value(&[]);
        assert_eq!([&masks, &masked].map(not_numbers), [3, 6]);
    }
}
