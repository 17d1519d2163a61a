//! Masks of frames, and the frames seen through them.

use tch::{Device, Kind, Tensor};

use crate::autograd;
use crate::backend::{Backend, Kernels};
use crate::gpu;
use crate::masks;
use crate::tensors::{floats, floats_mut};

/// From logits `[frames, objects, S, S]` and the background's constant one, masks `[frames, objects + 1, S, S]` that sum to 1;
/// and the frames `[frames, channels, S, S]` times each mask but the last, `[objects, frames, channels, S, S]`.
/// Differentiable by the logits; the gradient by the frames is libtorch's alone.
pub fn masked_frames(kernels: Kernels, background_logit: f64, logits: &Tensor, frames: &Tensor) -> [Tensor; 2] {
    let objects = logits.size()[1];
    let backend = match kernels.backend(&[logits, frames]) {
        _ if frames.requires_grad() => Backend::Libtorch,
        Backend::Gpu if gpu::can_part(frames) => return gpu::parted(background_logit, logits, frames),
        backend => backend,
    };
    let background = logits.narrow(1, 0, 1).full_like(background_logit);
    let masks = Tensor::cat(&[logits, &background], 1).softmax(1, frames.kind());
    let masked = match backend {
        Backend::Cpu(_) => masked_on_cpu(objects, &masks, frames),
        Backend::Gpu | Backend::Libtorch => {
            masks.narrow(1, 0, objects).transpose(0, 1).unsqueeze(2) * frames.unsqueeze(0)
        }
    };
    [masks, masked]
}

/// The first `objects` of masks `[frames, masks, S, S]` times frames, with the channels innermost in memory.
fn masked_on_cpu(objects: i64, masks: &Tensor, frames: &Tensor) -> Tensor {
    let (count, channels, side, _) = frames.size4().expect("frames [frames, channels, S, S]");
    let sizes = masks::MaskSizes {
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
